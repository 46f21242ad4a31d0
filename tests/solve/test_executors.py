"""The same results whoever computes, whatever happens to the workers."""

import os
import re
import signal
import socket
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from worker_tasks import begun_before, killed_always, killed_once, process_of, slow, square, touched

import truearm as ta
from refusals import refuses
from truearm.errors import TruearmError
from truearm.solve import executors
from truearm.solve.executors import AHEAD, Dask, Processes, Serial, WorkerLost, chosen_executor, results_in_order

needs_kill = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")


def local_cluster(n_workers, threads):
    """A cluster of two threads, in one process or in two."""
    distributed = pytest.importorskip("distributed", reason="Dask is an extra: pip install 'truearm[dask]'")
    return distributed.LocalCluster(
        n_workers=n_workers, threads_per_worker=threads, dashboard_address=":0", worker_dashboard_address=None
    )


@pytest.fixture(scope="module")
def cluster():
    with local_cluster(1, 2) as found:
        yield found


@pytest.fixture(scope="module")
def cluster_of_two():
    """One worker takes the task of the other."""
    with local_cluster(2, 1) as found:
        yield found


def by_number(executor, function, tasks):
    found = list(executor.results(function, tasks))
    assert sorted(i for i, _ in found) == list(range(len(tasks)))  # each once
    return [result for _, result in sorted(found, key=lambda one: one[0])]


@pytest.mark.parametrize("n", [0, 1, 2])
def test_every_task_has_its_result(n):
    executor = Processes(n) if n else Serial()
    assert by_number(executor, square, [1.0, 2.0, 3.0]) == [1.0, 4.0, 9.0]
    assert by_number(executor, square, []) == []


@needs_kill
def test_processes_serve_pass_after_pass_and_others_take_the_place_of_killed_ones():
    executor = Processes(1)
    first, second = (by_number(executor, process_of, [0, 1]) for _ in range(2))
    assert {*first, *second} == {first[0]}
    os.kill(first[0], signal.SIGKILL)
    third = by_number(executor, process_of, [0, 1])
    assert first[0] not in third
    executor.close()
    assert third[0] not in by_number(executor, process_of, [0])


@needs_kill
def test_a_killed_process_costs_no_task(tmp_path):
    tasks = [(i, str(tmp_path / "mark") if i == 1 else "") for i in range(5)]
    assert by_number(Processes(2), killed_once, tasks) == [0, 1, 2, 3, 4]


@needs_kill
@pytest.mark.parametrize("n", [1, pytest.param(2, marks=pytest.mark.weekly)])
def test_a_task_that_kills_every_process_is_given_up(n):
    *found, last = by_number(Processes(n), killed_always, [0, 1, 3, 2])
    assert found == [0, 1, 3]
    assert isinstance(last, WorkerLost)
    assert "3 times" in last.reason


def test_results_that_nobody_wants_any_more_are_not_computed(tmp_path):
    results = Processes(2).results(touched, [str(tmp_path / f"{i}") for i in range(50)])
    next(results)
    results.close()  # as Ctrl-C does
    assert 1 <= len(list(tmp_path.iterdir())) <= 3


def test_behind_a_slow_task_a_few_results_wait_and_not_all(tmp_path):
    tasks = [(i, str(tmp_path)) for i in range(60)]
    begun, *others = results_in_order(Processes(2), begun_before, tasks)
    assert 1 < begun <= 2 * AHEAD
    assert others == list(range(1, 60))


def test_dask_begins_a_few_tasks_behind_a_slow_one(cluster, tmp_path):
    tasks = [(i, str(tmp_path)) for i in range(60)]
    begun, *others = results_in_order(Dask(cluster.scheduler_address), begun_before, tasks)
    assert 1 < begun <= 2 * AHEAD
    assert others == list(range(1, 60))


def test_what_a_task_raises_reaches_the_caller():
    for executor in (Serial(), Processes(1)):
        with pytest.raises(TypeError):
            list(executor.results(square, ["x"]))


def test_dask_gives_the_same(cluster):
    assert by_number(Dask(cluster.scheduler_address), square, [1.0, 2.0, 3.0]) == [1.0, 4.0, 9.0]


@pytest.mark.weekly
@needs_kill
def test_dask_gives_the_task_of_a_killed_worker_to_another(cluster_of_two, tmp_path):
    tasks = [(i, str(tmp_path / "mark") if i == 1 else "") for i in range(5)]
    assert by_number(Dask(cluster_of_two.scheduler_address), killed_once, tasks) == [0, 1, 2, 3, 4]


@pytest.mark.weekly
@needs_kill
def test_dask_gives_up_a_task_that_kills_its_workers(cluster_of_two):
    *found, last = by_number(Dask(cluster_of_two.scheduler_address), killed_always, [0, 1, 3, 2])
    assert found == [0, 1, 3]
    assert isinstance(last, WorkerLost)


def test_a_scheduler_lost_in_a_long_task_is_waited_for(monkeypatch):
    now, lost = [0.0], []

    def of_client(client, function, tasks, ahead):
        now[0] += 1000  # seconds, more than the patience
        if not lost:
            lost.append(True)
            raise OSError("no connection")
        yield from ((i, function(task)) for i, task in list(tasks.items()))

    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=lambda _: None)
    monkeypatch.setattr(executors, "time", clock)
    monkeypatch.setattr(executors, "_of_client", of_client)
    monkeypatch.setattr(executors, "_distributed", lambda: SimpleNamespace(Client=lambda *_, **__: nullcontext()))
    assert by_number(Dask("tcp://host:1"), square, [1.0, 2.0]) == [1.0, 4.0]


def test_a_scheduler_that_does_not_answer_is_named():
    pytest.importorskip("distributed", reason="Dask is an extra: pip install 'truearm[dask]'")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(TruearmError, match="does not answer; 1 tasks are left"):
        list(Dask(address, patience_s=0.5).results(square, [1.0]))


@pytest.mark.parametrize(
    "address", ["", "10.0.0.7", "10.0.0.7:8786", "tcp://10.0.0.7", "tcp://host:port", "teapot://host:1"]
)
def test_what_is_no_address_of_a_scheduler_is_refused(address):
    refuses("expected the address of a scheduler, got .*tcp://10.0.0.7:8786", chosen_executor, None, address)
    assert chosen_executor(None, "tcp://[::1]:8786") == Dask("tcp://[::1]:8786")


@pytest.mark.weekly
@pytest.mark.skipif(sys.platform == "win32", reason="processes are ended by signals")
def test_a_restarted_scheduler_gets_what_is_left(tmp_path):
    pytest.importorskip("distributed", reason="Dask is an extra: pip install 'truearm[dask]'")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    def start(*command: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", *command],
            cwd=Path(__file__).parent,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def scheduler() -> subprocess.Popen[bytes]:
        return start(
            "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--dashboard-address", ":0"
        )

    running = [scheduler()]
    running.append(start("distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--no-dashboard"))
    try:
        results = Dask(f"tcp://127.0.0.1:{port}", patience_s=60).results(slow, list(range(12)))
        found = [next(results)]
        for process in running:
            process.kill()
            process.wait()
        running = [scheduler()]
        running.append(
            start("distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--no-dashboard")
        )
        found += results
    finally:
        for process in running:
            process.kill()
            process.wait()
    assert sorted(found) == [(i, i) for i in range(12)]


def test_sums_over_a_large_session_are_the_same_on_a_cluster(cluster, tmp_path):
    session = ta.simulate("ur10", poses=300, seed=1).session
    model = ta.fit("ur10", session.rows(np.arange(60)), model="nominal").model
    for name, rows in (("a", np.arange(200)), ("b", np.arange(200, 300))):
        session.rows(rows).save(tmp_path / f"{name}.csv")
    found = ta.evaluate(model, tmp_path, executor=Dask(cluster.scheduler_address))
    assert found.n_parts == 2
    assert found.to_dict() == ta.evaluate(model, tmp_path).to_dict()
    one, other = (
        ta.fit("ur10", tmp_path, model="nominal", executor=executor).model.fit_
        for executor in (None, Dask(cluster.scheduler_address))
    )
    assert np.array_equal(one.coefficients, other.coefficients)
    assert np.array_equal(one.covariance, other.covariance)


def test_only_the_room_of_fleets_knows_dask():
    package = Path(ta.__file__).parent
    names = "(?:dask|distributed|joblib)"
    importing = re.compile(rf" *(?:import|from) {names}\b|.*_module\(\"{names}\b")
    naming = {path: path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    named = {path: text for path, text in naming.items() if any(name in text for name in names[3:-1].split("|"))}
    found = [path for path, text in named.items() if any(map(importing.match, text.splitlines()))]
    assert [path.relative_to(package).as_posix() for path in found] == ["solve/executors.py"]
