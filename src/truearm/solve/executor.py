"""Who computes many tasks: the interface between sums, or fits of many arms, and their engine.

Here is the engine that needs nothing, one task after the other in this process; `truearm.solve.executors` has processes
and Dask clusters. All give the same results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from truearm.errors import TruearmError

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
