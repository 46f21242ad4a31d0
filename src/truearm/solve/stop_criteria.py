"""Stop criteria: each examines the state after an epoch and may return a reason to end the minimisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from truearm.typing import FloatArray

if TYPE_CHECKING:
    from truearm.solve.least_squares_problem import Damping


@dataclass(frozen=True)
class StopReason:
    """Why a minimisation ended: a sentence, and whether that means success."""

    text: str
    converged: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class OptimizerState:
    """The state of a minimisation after an epoch.

    Attributes
    ----------
    epoch : int
        Number of epochs; 0 at the start.
    x : (p,) array
        The parameters.
    cost, previous_cost : float
        Half the sum of squares, now and one epoch before (infinite at the start).
    gradient_norm : float
        Euclidean norm of ``J^T r``.
    seconds : float
        Time since the start [s].
    step_accepted : bool
        Whether the last epoch reached a better point.
    damping : Damping or None
        The rule for the next epoch; None for a method without damping.
    predicted : float
        The decrease of the cost that the quadratic model predicted for the last step; NaN without one.
    reason : StopReason or None
        Why the minimisation ends here; None while it continues.
    """

    epoch: int
    x: Any
    cost: float
    previous_cost: float
    gradient_norm: float
    seconds: float
    step_accepted: bool = True
    damping: Damping | None = None
    predicted: float = np.nan
    reason: StopReason | None = None

    @property
    def mu(self) -> float:
        """The damping parameter; NaN for a method without damping."""
        return np.nan if self.damping is None else self.damping.mu


class StopCriterion(Protocol):
    """A rule that may end a minimisation."""

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """A reason to end at `state`, or None to continue."""
        ...


def first_stop_reason(stops: Sequence[StopCriterion], state: OptimizerState) -> StopReason | None:
    """The first criterion's reason to end at `state`, or None to continue."""
    # Every criterion sees every state: one that collects them (validation) must not miss any.
    return next((reason for reason in [stop(state) for stop in stops] if reason is not None), None)


@dataclass(frozen=True)
class CostGoal:
    """Stop at a cost (half the sum of squares)."""

    cost: float

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Stop when the cost is at or below the goal."""
        return StopReason("Performance goal met.", True) if state.cost <= self.cost else None


@dataclass(frozen=True)
class MaxEpochs:
    """Stop after a number of epochs."""

    maximum: int

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Stop when the number of epochs is reached."""
        return StopReason("Maximum epoch reached.", False) if state.epoch >= self.maximum else None


@dataclass(frozen=True)
class MaxSeconds:
    """Stop after a time [s]."""

    maximum: float

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Stop when the time has passed."""
        return StopReason("Maximum time elapsed.", False) if state.seconds >= self.maximum else None


@dataclass(frozen=True)
class MinGradient:
    """Stop where the cost is flat: norm of ``J^T r`` at or below `minimum`."""

    minimum: float

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Stop when the gradient is as small."""
        return StopReason("Minimum gradient reached.", True) if state.gradient_norm <= self.minimum else None


@dataclass(frozen=True)
class DampingLimit:
    """Stop when the damping is at its maximum: no step, however short, lowers the cost."""

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Stop when the damping is at its maximum."""
        at_limit = state.mu >= getattr(state.damping, "maximum", np.inf)
        return StopReason("Maximum MU reached.", False) if at_limit else None


@dataclass(frozen=True)
class CostConverged:
    """Stop when an epoch lowers the cost by less than `relative` of it.

    An epoch that does not lower it at all ends the minimisation by itself, with its own reason.
    """

    relative: float = 1e-10

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Stop when the cost has all but stopped falling."""
        if (
            state.epoch == 0
            or not state.step_accepted
            or state.previous_cost - state.cost > self.relative * state.previous_cost
        ):
            return None
        return StopReason("The cost has settled.", True)


@dataclass(frozen=True, eq=False)
class BestPoint:
    """The point of smallest error so far. A value: each further point returns a new one.

    Attributes
    ----------
    epoch : int
        Epoch of the point.
    x : (p,) array
        The point.
    error : float
        Its error.
    failures : int
        Number of worse points since then.
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
    """Stop when the error on held-out data was worse than the best `max_fail` times; remember the best point.

    Create one for every minimisation, as it collects states.

    Parameters
    ----------
    error : callable
        Error on the held-out data at parameters (p,).
    max_fail : float
        Number of failures since the best point that ends the minimisation.

    Attributes
    ----------
    best : BestPoint or None
        None before the first state.
    last_error : float
        Error at the last state.
    """

    error: Callable[[FloatArray], float]
    max_fail: float = 6
    best: BestPoint | None = field(default=None, init=False)
    last_error: float = field(default=np.nan, init=False)

    def __call__(self, state: OptimizerState) -> StopReason | None:
        """Stop when the last `max_fail` epochs did not lower the error on the held-out data."""
        error = self.last_error = self.error(state.x)
        self.best = (
            BestPoint(state.epoch, state.x, error) if self.best is None else self.best.updated_with(state, error)
        )
        return StopReason("Validation stop.", True) if self.best.failures >= self.max_fail else None
