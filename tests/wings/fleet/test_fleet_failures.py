"""A full disk and a lost database: they are said, what was done is kept, and the same command does the rest."""

import errno
import tempfile
from pathlib import Path

import pandas as pd
import pytest

import truearm as ta
from truearm.errors import TruearmError
from truearm.wings.fleet import database
from truearm.wings.fleet.arm_list import RegisteredArm
from truearm.wings.fleet.fleet import Fleet

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")
from sqlalchemy import event

ARMS = [f"virtual-research-{i}" for i in range(3)]


@pytest.fixture(scope="module")
def sessions(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sessions")
    for i in range(3):
        ta.simulate("ur10", poses=12, seed=i, arm_seed=i).save(folder / f"{i}.csv")
    return folder


@pytest.fixture
def fleet(tmp_path, sessions):
    found = Fleet.create(tmp_path / "fleet")
    found.add_all(
        RegisteredArm(arm, "ur10", model="nominal", session=str(sessions / f"{i}.csv")) for i, arm in enumerate(ARMS)
    )
    yield found
    found.close()


@pytest.fixture
def full(monkeypatch):
    """A disk that has no room for files below these folders; all others have."""
    folders = []

    def no_room(*args, **options):
        if any(Path(options["dir"]).is_relative_to(folder) for folder in folders):
            raise OSError(errno.ENOSPC, "No space left on device")
        return made(*args, **options)

    made = tempfile.mkstemp
    monkeypatch.setattr("truearm.files.atomic_write.tempfile.mkstemp", no_room)
    return folders


def check_complete(fleet):
    assert sorted(pd.read_parquet(fleet.folder / "results").serial_number) == ARMS
    assert sorted(fleet.registry.models_in_force()) == ARMS
    assert {one.what for one in fleet.status().arms} == {"in force"}


def test_no_room_for_models_is_the_state_of_their_arms_until_there_is(fleet, full):
    full.append(fleet.folder / "models")
    found = fleet.run()
    assert all("the file cannot be written (No space left on device)" in row.message for row in found.failures)
    assert {one.what for one in fleet.status().arms} == {"failed"}
    full.clear()
    assert fleet.run().n_fitted == 3
    check_complete(fleet)


def test_no_room_for_the_data_set_loses_no_result(truearm, fleet, full):
    full.append(fleet.folder / "results")
    ran = truearm("fleet", "run", fleet.folder)
    assert ran.code == 2
    assert "fits.parquet: the file cannot be written (No space left on device)" in ran.err
    assert sorted(fleet.registry.models_in_force()) == ARMS
    assert list((fleet.folder / "results").iterdir()) == []
    full.clear()
    assert fleet.run().summary() == "Nothing to fit: 3 arms are unchanged."
    check_complete(fleet)


def test_no_room_in_the_registry_ends_the_run_and_keeps_what_it_has(fleet, monkeypatch, capsys):
    """A limit of SQLite itself, from the second result on."""
    monkeypatch.setattr(database, "PATIENCE_S", 0.0)
    opened = fleet.registry.database._engine
    recorded = []

    def no_more(connection, _):
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count = {pages if recorded else pages + 100}")

    def after_one(n, _):
        recorded.append(n)

    event.listen(opened, "connect", no_more)
    with pytest.raises(TruearmError, match=r"database or disk is full.*the same command then goes on"):
        fleet.run(progress=after_one)
    event.remove(opened, "connect", no_more)
    kept = fleet.registry.fits()
    assert 1 <= len(kept) < 3
    assert sorted(pd.read_parquet(fleet.folder / "results").key) == sorted(kept)
    assert fleet.run().n_fitted == 3 - len(kept)
    check_complete(fleet)
