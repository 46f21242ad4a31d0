"""Stopping rules: each looks at the state after an epoch and may give a reason to end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from truearm.solve.damping import Damping
from truearm.typing import FloatArray


@dataclass(frozen=True)
class StopReason:
    """Why a minimisation ended: a sentence, and whether that means success."""

    text: str
    converged: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class OptimizerState:
    """Where a minimisation stands after an epoch: enough to go on from.

    Attributes
    ----------
    epoch : int
        Epochs done; 0 is the start.
    x : (p,) array
        The parameters.
    cost, previous_cost : float
        Half the sum of squares, now and an epoch ago (infinite at the start).
    gradient_norm : float
        Euclidean norm of ``J^T r``.
    seconds : float
        Time since the start [s].
    step_accepted : bool
        Whether the last epoch found a better point.
    damping : Damping or None
        As the next epoch will use it; None for a method that has none.
    reason : StopReason or None
        Why the minimisation ends here; None while it goes on.
    """

    epoch: int
    x: FloatArray
    cost: float
    previous_cost: float
    gradient_norm: float
    seconds: float
    step_accepted: bool = True
    damping: Damping | None = None
    reason: StopReason | None = None

    @property
    def mu(self) -> float:
        """The damping parameter; NaN for a method without damping."""
        return np.nan if self.damping is None else self.damping.mu


class StopCriterion(Protocol):
    """A stopping rule."""

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """A reason to end at `state`, or None to go on."""
        ...


def first_stop_reason(stops: Sequence[StopCriterion], state: OptimizerState) -> StopReason | None:
    """The first rule's reason to end at `state`, or None to go on."""
    # Every rule sees every state: one that collects (validation) must not miss any.
    return next((reason for reason in [stop(state) for stop in stops] if reason is not None), None)


@dataclass(frozen=True)
class CostGoal:
    """Stop at a cost (half the sum of squares)."""

    cost: float

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Met when the cost is at or below the goal."""
        return StopReason("Performance goal met.", True) if state.cost <= self.cost else None


@dataclass(frozen=True)
class MaxEpochs:
    """Stop after a number of epochs."""

    maximum: int

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Reached when so many epochs are done."""
        return StopReason("Maximum epoch reached.", False) if state.epoch >= self.maximum else None


@dataclass(frozen=True)
class MaxSeconds:
    """Stop after a time [s]."""

    maximum: float

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Reached when so much time has passed."""
        return StopReason("Maximum time elapsed.", False) if state.seconds >= self.maximum else None


@dataclass(frozen=True)
class MinGradient:
    """Stop where the cost is flat: norm of ``J^T r`` at or below `minimum`."""

    minimum: float

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Reached when the gradient is so small."""
        return StopReason("Minimum gradient reached.", True) if state.gradient_norm <= self.minimum else None


@dataclass(frozen=True)
class DampingLimit:
    """Stop when no step, however short, lowers the cost."""

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Reached when the damping is at its limit."""
        at_limit = state.damping is not None and state.damping.mu >= state.damping.maximum
        return StopReason("Maximum MU reached.", False) if at_limit else None


@dataclass(frozen=True)
class CostConverged:
    """Stop when an epoch lowers the cost by less than `relative` of it.

    One that does not lower it at all ends the minimisation by itself, and tells why.
    """

    relative: float = 1e-10

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Settled when the cost has all but stopped falling."""
        if (
            state.epoch == 0
            or not state.step_accepted
            or state.previous_cost - state.cost > self.relative * state.previous_cost
        ):
            return None
        return StopReason("The cost has settled.", True)


@dataclass(frozen=True, eq=False)
class BestPoint:
    """The best point so far, as an error judges it. A value: a further point gives a new one.

    Attributes
    ----------
    epoch : int
        When it was found.
    x : (p,) array
        The point.
    error : float
        Its error.
    failures : int
        How many points since then were worse.
    """

    epoch: int
    x: FloatArray
    error: float
    failures: int = 0

    def updated_with(self, state: OptimizerState, error: float) -> BestPoint:
        """The best after one more point; an equal error neither counts as a failure nor clears them, as in MATLAB."""
        if error < self.error or np.isnan(self.error):
            return BestPoint(state.epoch, state.x, error)
        return self if error == self.error else replace(self, failures=self.failures + 1)


@dataclass(eq=False)
class ValidationStop:
    """Stop when the error on data set aside was worse `max_fail` times than the best; remember the best point.

    Made anew for every minimisation: it collects what it saw. One that goes on is given the `best` so far.

    Parameters
    ----------
    error : callable
        Error on the data set aside at parameters (p,).
    max_fail : float
        Failures since the best that end the minimisation.
    best : BestPoint, optional
        The best of earlier epochs.

    Attributes
    ----------
    last_error : float
        Error at the last state seen.
    """

    error: Callable[[FloatArray], float]
    max_fail: float = 6
    best: BestPoint | None = None
    last_error: float = np.nan

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Reached when the last `max_fail` epochs brought nothing to the data set aside."""
        error = self.last_error = self.error(state.x)
        self.best = (
            BestPoint(state.epoch, state.x, error) if self.best is None else self.best.updated_with(state, error)
        )
        return StopReason("Validation stop.", True) if self.best.failures >= self.max_fail else None
