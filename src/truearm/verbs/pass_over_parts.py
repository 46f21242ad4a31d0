"""A pass over the parts of a large session: what an engine computes of each, one after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from operator import add
from typing import Generic, TypeVar

from truearm.arm import Arm
from truearm.readings import Session
from truearm.readings.checks import MAX_SKIPPED_SHARE
from truearm.readings.large_sessions import LargeSession, Part
from truearm.solve.executors import Executor, Serial, results_in_order
from truearm.solve.sums import Sums
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import CheckedSession, Limits, within_limits

S = TypeVar("S", bound=Sums)

# Remarks of parts that are repeated.
MAX_REMARKS = 6


class PartTask(ABC, Generic[S]):
    """What is computed of each part, with all that it needs of the model: it is sent to the workers."""

    @abstractmethod
    def sums(self, readings: Session, part: Part) -> S:
        """Sums over some consecutive readings of a part."""


@one_blas_thread()
def sums_of_part(task: tuple[PartTask[S], Part]) -> S:
    """Sums over one part."""
    work, part = task
    return reduce(add, (work.sums(readings, part) for readings in part.sessions()))


def pass_over_parts(
    large: LargeSession,
    tasks: Sequence[PartTask[S]],
    executor: Executor | None,
    progress: Callable[[int, str], None] | None,
    *,
    label: str = "",
) -> Iterator[S]:
    """Iterate over the sums of the parts, in the order of the parts: what follows does not depend on the engine.

    Parameters
    ----------
    large : LargeSession
    tasks : sequence of PartTask
        Of each part.
    executor : Executor, optional
        This process by default.
    progress : callable, optional
        Called with the number of readings done and a note, which begins with a `label`.
    """
    done, pairs = 0, list(zip(tasks, large.parts, strict=True))
    for part, sums in zip(large.parts, results_in_order(executor or Serial(), sums_of_part, pairs), strict=True):
        yield sums
        done += part.n_readings
        if progress is not None:
            progress(done, f"{label}{done} of {len(large)} readings")


def allowed_in_part(readings: Session, arm: Arm, limits: Limits, accept: str | None) -> CheckedSession:
    """The readings of a part within the joint limits, by `within_limits`.

    How many are beyond them is judged over all parts. Where a person accepts it, it is judged in each, to skip none.
    """
    return within_limits(readings, arm, limits, most=1.0 if accept is None else MAX_SKIPPED_SHARE)


def joined_remarks(a: tuple[str, ...], b: tuple[str, ...]) -> tuple[str, ...]:
    """The first different remarks of parts."""
    return tuple(dict.fromkeys((*a, *b)))[:MAX_REMARKS]
