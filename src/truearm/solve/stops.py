"""Stopping rules: each looks at the state after an epoch and may give a reason to end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class State:
    """Where a minimisation stands after an epoch.

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
    mu, mu_maximum : float
        Damping and its limit.
    seconds : float
        Time since the start [s].
    moved : bool
        Whether the last epoch found a better point.
    """

    epoch: int
    x: FloatArray
    cost: float
    previous_cost: float
    gradient_norm: float
    mu: float
    mu_maximum: float
    seconds: float
    moved: bool = True


@dataclass(frozen=True)
class Reason:
    """Why a minimisation ended: a sentence, and whether that means success."""

    text: str
    converged: bool


class Stop(Protocol):
    """A stopping rule."""

    def __call__(self, state: State) -> Reason | None:
        """A reason to end at `state`, or None to go on."""
        ...


@dataclass(frozen=True)
class Goal:
    """Stop at a cost (half the sum of squares)."""

    cost: float

    def __call__(self, state: State) -> Reason | None:
        """Met when the cost is at or below the goal."""
        return Reason("Performance goal met.", True) if state.cost <= self.cost else None


@dataclass(frozen=True)
class Epochs:
    """Stop after a number of epochs."""

    maximum: int

    def __call__(self, state: State) -> Reason | None:
        """Reached when so many epochs are done."""
        return Reason("Maximum epoch reached.", False) if state.epoch >= self.maximum else None


@dataclass(frozen=True)
class Seconds:
    """Stop after a time [s]."""

    maximum: float

    def __call__(self, state: State) -> Reason | None:
        """Reached when so much time has passed."""
        return Reason("Maximum time elapsed.", False) if state.seconds >= self.maximum else None


@dataclass(frozen=True)
class Gradient:
    """Stop where the cost is flat: norm of ``J^T r`` at or below `minimum`."""

    minimum: float

    def __call__(self, state: State) -> Reason | None:
        """Reached when the gradient is so small."""
        return Reason("Minimum gradient reached.", True) if state.gradient_norm <= self.minimum else None


@dataclass(frozen=True)
class DampingLimit:
    """Stop when no step, however short, lowers the cost."""

    def __call__(self, state: State) -> Reason | None:
        """Reached when the damping is at its limit."""
        return Reason("Maximum MU reached.", False) if state.mu >= state.mu_maximum else None


@dataclass(frozen=True)
class Settled:
    """Stop when an epoch lowers the cost by less than `relative` of it, or not at all."""

    relative: float = 1e-10

    def __call__(self, state: State) -> Reason | None:
        """Settled when the cost has stopped falling."""
        if state.epoch == 0:
            return None
        if state.moved and state.previous_cost - state.cost > self.relative * state.previous_cost:
            return None
        return Reason("The cost has settled.", True)


@dataclass(eq=False)
class Validation:
    """Stop when an error on data set aside has grown `max_fail` times in a row; remember the best point.

    Made anew for every minimisation: it collects what it saw.

    Parameters
    ----------
    error : callable
        Error on the data set aside at parameters (p,).
    max_fail : int
        Failures in a row that end the minimisation.
    """

    error: Callable[[FloatArray], float]
    max_fail: int = 6
    errors: list[float] = field(default_factory=list)
    failures: list[int] = field(default_factory=list)
    best_epoch: int = 0
    best_x: FloatArray | None = None

    def __call__(self, state: State) -> Reason | None:
        """Reached when the last `max_fail` epochs brought nothing to the data set aside."""
        error = self.error(state.x)
        best = self.errors[self.best_epoch] if self.errors else np.inf
        failures = self.failures[-1] if self.failures else 0
        self.errors.append(error)
        if error < best or self.best_x is None:
            self.best_epoch, self.best_x, failures = state.epoch, state.x.copy(), 0
        elif error > best:
            failures += 1
        self.failures.append(failures)
        return Reason("Validation stop.", True) if failures >= self.max_fail else None
