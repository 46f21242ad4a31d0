"""Who computes many tasks: this process, one after the other, several processes, or a Dask cluster.

All give the same results, in the order in which they are ready. What a task raises passes through to the caller,
so a task that may fail returns its failure. A worker that is killed costs the task that it had, not the run.
"""

from __future__ import annotations

import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from math import inf
from multiprocessing import get_context
from typing import Any, Protocol, TypeVar
from urllib.parse import urlsplit

from truearm.errors import InputError, TruearmError, extra_module

T = TypeVar("T")
R = TypeVar("R")

# Results of each worker that may wait for a task before them; a worker idles where one takes so much longer.
AHEAD = 4


@dataclass(frozen=True)
class WorkerLost:
    """A task without a result: its workers were killed, each time that it was tried."""

    reason: str


class Executor(Protocol):
    """Computes tasks."""

    def results(
        self, function: Callable[[T], R], tasks: Sequence[T], *, ahead: int | None = None
    ) -> Iterator[tuple[int, R | WorkerLost]]:
        """Compute ``function(task)`` for each task.

        Parameters
        ----------
        function : callable
            Of a module, and so are its tasks: other processes import them by name.
        tasks : sequence
        ahead : int, optional
            Tasks of each worker that are begun before the first one without a result is finished; any by default.

        Yields
        ------
        tuple of int and object
            The number of a task, counted from 0, with its result; each once, as they become ready.
        """
        ...


class Serial:
    """One task after the other, in this process."""

    def results(
        self, function: Callable[[T], R], tasks: Sequence[T], *, ahead: int | None = None
    ) -> Iterator[tuple[int, R | WorkerLost]]:
        """See `Executor.results`."""
        del ahead  # each is finished before the next
        for i, task in enumerate(tasks):
            yield i, function(task)


def results_in_order(executor: Executor, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
    """Iterate over the results in the order of the tasks, so that sums over them do not depend on the engine.

    Those behind a slow task wait in memory: `AHEAD` of each worker, not all.

    Raises
    ------
    TruearmError
        If a task was lost with its workers.
    """
    waiting: dict[int, R] = {}
    due = 0
    for i, result in executor.results(function, tasks, ahead=AHEAD):
        if isinstance(result, WorkerLost):
            raise TruearmError(f"part {i + 1} of {len(tasks)} was not computed: {result.reason}")
        waiting[i] = result
        while due in waiting:
            yield waiting.pop(due)
            due += 1


SCHEMES = ("tcp", "tls", "ws", "wss")  # of the addresses of schedulers
# Workers that one task may lose before it is given up.
MAX_LOST = 3


@dataclass(eq=False)
class Processes:
    """Several processes of this machine: they start with the first task, and end with this object.

    Parameters
    ----------
    n : int
        Their number. The system has as many tasks as processes at any time, so that a killed process names few
        suspects; these then run one by one.
    """

    n: int
    _pool: ProcessPoolExecutor | None = field(default=None, init=False, repr=False)

    def results(
        self, function: Callable[[T], R], tasks: Sequence[T], *, ahead: int | None = None
    ) -> Iterator[tuple[int, R | WorkerLost]]:
        """See `Executor.results`."""
        waiting, suspects = deque(range(len(tasks))), deque[int]()
        lost = dict.fromkeys(range(len(tasks)), 0)  # of tasks without a result
        reach = len(tasks) if ahead is None else ahead * self.n
        while waiting or suspects:
            alone = bool(suspects)
            queue, width = (suspects, 1) if alone else (waiting, self.n)
            running: dict[Future[R], int] = {}
            # Spawned, not forked: threads of a BLAS do not survive a fork.
            self._pool = pool = self._pool or ProcessPoolExecutor(self.n, get_context("spawn"), _end_silently)
            try:
                while queue or running:
                    while queue and len(running) < width and queue[0] < next(iter(lost)) + reach:
                        running[pool.submit(function, tasks[queue[0]])] = queue[0]
                        queue.popleft()
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        result = future.result()
                        del lost[i := running.pop(future)]
                        yield i, result
            except BrokenProcessPool:
                self.close()
                for i in running.values():
                    lost[i] += alone
                    if lost[i] < MAX_LOST:
                        suspects.append(i)
                    else:
                        del lost[i]
                        yield i, WorkerLost(f"its process was killed {MAX_LOST} times (not enough memory?)")
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """End the processes when they have finished what they compute; later tasks start others."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(cancel_futures=True)


def _end_silently() -> None:
    """In a process: Ctrl-C, which goes to all of them, ends it without a trace back."""
    signal.signal(signal.SIGINT, lambda number, _: sys.exit(128 + number))


@dataclass(frozen=True)
class Dask:
    """The workers of a Dask cluster (the extra ``dask``), which see the same files.

    A killed worker's task goes to another one; a scheduler that is restarted gets the tasks again that it had not
    finished.

    Parameters
    ----------
    address : str
        Of the scheduler, as ``tcp://10.0.0.7:8786``.
    patience_s : float
        How long to wait for a scheduler that does not answer.
    """

    address: str
    patience_s: float = 300.0

    def results(
        self, function: Callable[[T], R], tasks: Sequence[T], *, ahead: int | None = None
    ) -> Iterator[tuple[int, R | WorkerLost]]:
        """See `Executor.results`.

        Raises
        ------
        TruearmError
            If Dask is not installed, or the scheduler does not answer within `patience_s`.
        """
        distributed = _distributed()
        left, answered = dict(enumerate(tasks)), time.monotonic()
        while left:
            try:
                with distributed.Client(
                    self.address, timeout=min(10.0, self.patience_s), set_as_default=False
                ) as client:
                    try:
                        for i, result in _of_client(client, function, left, ahead):
                            del left[i]
                            yield i, result
                    finally:  # a task may have taken longer than the patience
                        answered = time.monotonic()
            except OSError as error:  # no connection, or a time-out
                if time.monotonic() - answered > self.patience_s:
                    raise TruearmError(
                        f"the Dask scheduler {self.address} does not answer; {len(left)} tasks are left. "
                        "Try: start it again, and run the same command"
                    ) from error
                time.sleep(1.0)


def _of_client(
    client: Any, function: Callable[[T], R], left: dict[int, T], ahead: int | None
) -> Iterator[tuple[int, R | WorkerLost]]:
    """Results of the tasks that a scheduler finishes before it is lost, if it is; the caller takes them from `left`."""
    distributed = _distributed()
    waiting, futures = deque(left), dict[Any, int]()
    ready = distributed.as_completed(loop=client.loop)

    def submit() -> None:
        reach = inf if ahead is None or not waiting else ahead * max(sum(client.nthreads().values()), 1)
        while waiting and waiting[0] < next(iter(left)) + reach:
            future = client.submit(function, left[waiting[0]], pure=False)
            futures[future] = waiting.popleft()
            ready.add(future)

    submit()
    for future in ready:
        i = futures.pop(future)
        try:
            result = future.result()
        except distributed.KilledWorker as error:
            result = WorkerLost(f"its workers were killed (not enough memory?): {error}")
        except (distributed.CancelledError, OSError):
            continue  # the scheduler is gone; the next one gets this task
        yield i, result
        future.release()
        submit()


def _distributed() -> Any:
    return extra_module("distributed", "a Dask cluster needs the package distributed", "pip install 'truearm[dask]'")


def chosen_executor(workers: int | None, scheduler: str | None) -> Executor:
    """The engine that the options ``--workers`` and ``--scheduler`` choose; without both, this process.

    Raises
    ------
    InputError
        If both are given, or the scheduler has no address with a port.
    """
    if workers is not None and scheduler is not None:
        raise InputError("expected --workers or --scheduler, got both")
    if scheduler is not None:
        _check_address(scheduler)
        return Dask(scheduler)
    return Serial() if workers is None else Processes(workers)


def _check_address(scheduler: str) -> None:
    try:
        place = urlsplit(scheduler)
        is_address = place.scheme in SCHEMES and bool(place.hostname and place.port)
    except ValueError:
        is_address = False
    if not is_address:
        raise InputError(f"expected the address of a scheduler, got {scheduler!r:.80}", hint="tcp://10.0.0.7:8786")
