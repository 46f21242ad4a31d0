"""The registry with many writers at once: no result is lost or double, also when the database is killed."""

import datetime
import itertools
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")

import sqlalchemy as sql

import truearm as ta
from truearm.errors import TruearmError
from truearm.wings.fleet import database
from truearm.wings.fleet.arm_list import RegisteredArm
from truearm.wings.fleet.database import ARMS
from truearm.wings.fleet.fit_task import FitRow
from truearm.wings.fleet.fleet import Fleet
from truearm.wings.fleet.registry import Registry
from truearm.wings.laboratory.monitor.interim_check import CheckValue, InterimCheck

N_WRITERS, N_EACH = 8, 8


def row_of(number: int) -> FitRow:
    return FitRow(f"{number:064x}", f"A-{number % 5}", "ur10", "s.csv", "fitted", held_out_mm=0.1)


def write_all(url: str, during=lambda: None) -> Registry:
    """Eight writers, each with a connection of its own, whose fits overlap by half."""
    registry = Registry(url, create=True)
    registry.add(RegisteredArm(f"A-{i}", "ur10") for i in range(5))

    def write(writer: int) -> None:
        mine = Registry(url)
        for i in range(N_EACH):
            mine.record(row_of(writer * N_EACH // 2 + i), in_force=True)
        mine.close()

    with ThreadPoolExecutor(N_WRITERS + 1) as threads:
        pending = [threads.submit(write, i) for i in range(N_WRITERS)]
        during()
        for one in pending:
            one.result()
    return registry


def check_complete(registry: Registry) -> None:
    expected = {row_of(i).key: row_of(i).serial_number for i in range((N_WRITERS + 1) * N_EACH // 2)}
    assert {key: row.serial_number for key, row in registry.fits().items()} == expected
    histories = [registry.histories()[f"A-{i}"] for i in range(5)]
    for i, history in enumerate(histories):
        keys = [key for _, key in history]
        assert {key for key, serial in expected.items() if serial == f"A-{i}"} == set(keys)
        assert registry.models_in_force()[f"A-{i}"] == keys[-1]
        assert all(one != after for one, after in itertools.pairwise(keys))
    registry.close()


def test_eight_writers_of_a_file(tmp_path):
    check_complete(write_all(f"sqlite:///{(tmp_path / 'registry.sqlite').as_posix()}"))


def test_a_lost_worker_is_replaced_by_a_result_and_no_result_by_another(tmp_path):
    registry = Registry(f"sqlite:///{(tmp_path / 'registry.sqlite').as_posix()}", create=True)
    registry.add([RegisteredArm("A-1", "ur10")])
    lost, found = FitRow("k", "A-1", "ur10", "s.csv", "lost", "killed"), FitRow("k", "A-1", "ur10", "s.csv", "fitted")
    for row in (lost, found, lost):
        registry.record(row, in_force=row.is_usable)
    assert registry.fits()["k"] == found
    registry.close()


@pytest.fixture
def registry(tmp_path):
    found = Registry(f"sqlite:///{(tmp_path / 'registry.sqlite').as_posix()}", create=True)
    yield found
    found.close()


def test_a_run_that_ends_late_replaces_no_model_of_later_readings(registry):
    first, second = FitRow("1", "A", "ur10", "1.csv", "fitted"), FitRow("2", "A", "ur10", "2.csv", "fitted")
    for row in (first, second):
        registry.add([RegisteredArm("A", "ur10", session=row.session)])
    for row in (second, first):
        registry.record(row, in_force=True)
    assert registry.models_in_force() == {"A": "2"}
    assert set(registry.fits()) == {"1", "2"}


def test_a_number_without_bounds_stops_no_run(registry):
    registry.add([RegisteredArm("A", "ur10")])
    row = FitRow("1", "A", "ur10", "1.csv", "fitted", residual_std_mm=float("inf"))
    registry.record(row, in_force=True)
    assert registry.fits() == {"1": row}


def test_a_row_that_can_never_be_is_not_tried_for_long(registry, monkeypatch):
    pauses = []
    monkeypatch.setattr(database.time, "sleep", pauses.append)
    with pytest.raises(TruearmError, match="NOT NULL constraint failed"):
        registry.database.do(lambda opened: opened.execute(sql.insert(ARMS).values(serial_number="A")))
    assert len(pauses) == database.MAX_CONFLICTS - 1


def test_what_waiting_does_not_mend_is_said_at_once(tmp_path, registry, monkeypatch):
    monkeypatch.setattr(database.time, "sleep", lambda _: pytest.fail("it waits"))
    with closing(sqlite3.connect(tmp_path / "registry.sqlite")) as opened:
        opened.execute("DROP TABLE models_in_force")
    with pytest.raises(TruearmError, match="cannot be used .*no such table.*Try: "):
        registry.models_in_force()


def test_a_damaged_table_is_named(tmp_path, registry):
    registry.add([RegisteredArm("A", "ur10")])
    registry.record(FitRow("1", "A", "ur10", "1.csv", "fitted"), in_force=False)
    with closing(sqlite3.connect(tmp_path / "registry.sqlite")) as opened:
        opened.execute("UPDATE fits SET row = '{}'")
        opened.commit()
    with pytest.raises(TruearmError, match="table of fits is damaged .*Try: restore a backup"):
        registry.fits()


class Server:
    """A PostgreSQL server of Debian's package, in a folder of its own."""

    def __init__(self, folder: Path, port: int) -> None:
        found = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"))
        if not found or sys.platform == "win32":
            pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
        pytest.importorskip("psycopg", reason="pip install 'psycopg[binary]'")
        self.bin, self.folder, self.port = found[-1].parent, folder, port
        # The server refuses to run as root.
        self.user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
        if self.user:
            shutil.chown(folder, "postgres")
        self.run("initdb", "--auth", "trust", "--no-sync", "-U", "fleet", "-D", str(folder / "data"))

    def run(self, command: str, *arguments: str) -> None:
        ran = subprocess.run(
            [*self.user, str(self.bin / command), *arguments],
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 0, ran.stdout + ran.stderr

    def start(self) -> None:
        options = f"-F -p {self.port} -c listen_addresses=127.0.0.1 -k {self.folder}"
        log = str(self.folder / "log")
        self.run("pg_ctl", "-w", "-D", str(self.folder / "data"), "-l", log, "-o", options, "start")

    def kill(self) -> None:
        """Without any goodbye: connections break, transactions are lost."""
        self.run("pg_ctl", "-w", "-D", str(self.folder / "data"), "-m", "immediate", "stop")


@pytest.fixture(scope="module")
def server():
    """A server of two databases: postgres, and fleets."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # Not in pytest's own folders, which are closed to the server's user.
    with tempfile.TemporaryDirectory(prefix="truearm-postgresql-") as folder:
        found = Server(Path(folder), port)
        found.start()
        found.run("createdb", "-h", "127.0.0.1", "-p", str(port), "-U", "fleet", "fleets")
        yield found
        found.kill()


def test_eight_writers_of_a_server_that_is_killed_and_started_again(server, monkeypatch):
    monkeypatch.setattr(database, "PAUSE_S", 0.05)

    def killed_twice() -> None:
        for _ in range(2):
            server.kill()
            server.start()

    url = f"postgresql+psycopg://fleet@127.0.0.1:{server.port}/postgres"
    check_complete(write_all(url, killed_twice))


def test_a_server_that_is_lost_in_a_run_is_said_and_the_next_run_does_the_rest(server, tmp_path, monkeypatch):
    sessions = [tmp_path / f"{i}.csv" for i in range(3)]
    url = f"postgresql+psycopg://fleet@127.0.0.1:{server.port}/fleets"
    fleet = Fleet.create(tmp_path / "fleet", database=url)
    for i, path in enumerate(sessions):
        ta.simulate("ur10", poses=12, seed=i, arm_seed=i).save(path)
        fleet.add(f"virtual-research-{i}", "ur10", session=path, model="nominal")
    monkeypatch.setattr(database, "PATIENCE_S", 0.1)
    monkeypatch.setattr(database, "PAUSE_S", 0.05)
    with pytest.raises(TruearmError, match=r"database cannot be used .* the same command then goes on"):
        fleet.run(progress=lambda n, _: server.kill() if n == 1 else None)
    server.start()
    assert len(fleet.registry.fits()) == 1
    assert fleet.run().n_fitted == 2
    history = fleet.history("virtual-research-0")
    values = (CheckValue("SPAT.2s", "cone", 0.01, 0.001, 0.0, 10),)
    assert history.append(InterimCheck(datetime.datetime(2026, 1, 1), "a" * 64, "b" * 64, 20.5, values))
    assert len(Registry(url).history("virtual-research-0").checks("a" * 64)) == 1
    assert {one.what for one in fleet.status().arms} == {"in force"}
    fleet.close()
