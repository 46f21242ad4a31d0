"""Gradient descent with momentum and an adaptive rate."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from truearm.errors import TruearmError
from truearm.solve.stop_criteria import OptimizerState, StopCriterion, StopReason, first_stop_reason
from truearm.typing import FloatArray

# Squares of larger values approach the largest double.
LOST = 1e100
DIVERGED = StopReason("The error has grown beyond all bounds: the learning rate is too large.", False)


class DifferentiableProblem(Protocol):
    """A problem in p parameters with a gradient."""

    def gradient(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Cost, and its gradient (p,), at `x` (p,)."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class DescentState(OptimizerState):
    """The state of a descent after an epoch; costs and gradients are those of its problem.

    Attributes
    ----------
    rate : float
        The learning rate of the next epoch.
    step : (p,) array
        The step that momentum continues: the last one, or ``-rate * gradient`` at the start and after a refused step.
    """

    rate: float
    step: FloatArray


@dataclass(frozen=True)
class LearningRate:
    """The learning rate of a descent, and how it adapts to the steps.

    Parameters
    ----------
    start : float
        The first rate.
    momentum : float
        The share of the last step in the next.
    increase, decrease : float
        Factors of the rate after a step that lowered the cost, and after one that was refused.
    max_cost_ratio : float
        A step is refused if it multiplies the cost by more than this.
    """

    start: float
    momentum: float = 0.0
    increase: float = 1.0
    decrease: float = 1.0
    max_cost_ratio: float = float("inf")


def gradient_descent(
    problem: DifferentiableProblem,
    start: npt.ArrayLike,
    *,
    rate: LearningRate,
    stops: Sequence[StopCriterion],
    callback: Callable[[DescentState], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> DescentState:
    """Follow the gradient down.

    Every epoch tries ``step = momentum * last step - (1 - momentum) * rate * gradient``; at the start, and after a
    refused step, without momentum it is ``-rate * gradient``.

    Source: T. P. Vogl, J. K. Mangis, A. K. Rigler, W. T. Zink, D. L. Alkon, "Accelerating the convergence of the
    back-propagation method", Biological Cybernetics 59 (1988) 257; M. T. Hagan, H. B. Demuth, M. Beale, "Neural Network
    Design" (1996), chapter 12, "variable learning rate".

    Parameters
    ----------
    problem : DifferentiableProblem
        Returns cost and gradient.
    start : (p,) array
        The first point.
    rate : LearningRate
    stops : sequence of StopCriterion
        Evaluated in this order at the start and after every epoch.
    callback : callable, optional
        Called with the state at the start and after every epoch, once the stops were evaluated.
    clock : callable
        Returns the time [s] that the states count.

    Returns
    -------
    DescentState
        The last state.

    Raises
    ------
    TruearmError
        If the cost at the start is not a finite number.
    """
    begun = clock()
    x = np.array(start, dtype=float)
    cost, gradient = problem.gradient(x)
    if not np.isfinite(cost):
        raise TruearmError("the cost at the start is not a finite number: check the data for NaN and overflow")

    def state_after(epoch: int, previous_cost: float, now: float, step: FloatArray, **more: Any) -> DescentState:
        """The state, with the reason to stop if there is one."""
        state = DescentState(
            epoch=epoch,
            x=x,
            cost=cost,
            previous_cost=previous_cost,
            gradient_norm=float(np.linalg.norm(gradient)),
            seconds=clock() - begun,
            rate=now,
            step=step,
            **more,
        )
        state = replace(state, reason=first_stop_reason(stops, state) or state.reason)
        if callback is not None:
            callback(state)
        return state

    state = state_after(0, np.inf, rate.start, -rate.start * gradient)
    while state.reason is None:
        now, previous_cost, lost = state.rate, cost, None
        step = rate.momentum * state.step - (1 - rate.momentum) * now * gradient
        with np.errstate(over="ignore", invalid="ignore"):  # too large a rate shows in its cost
            tried_cost, tried_gradient = problem.gradient(x + step)
        moved = tried_cost <= LOST and (tried_cost <= cost or tried_cost <= rate.max_cost_ratio * cost)
        if moved:
            now *= rate.increase if tried_cost < cost else 1.0
            x, cost, gradient = x + step, tried_cost, tried_gradient
        else:
            # The same step would be refused again.
            lost = DIVERGED if rate.decrease == 1 else None
            now *= rate.decrease
            step = -now * gradient
        state = state_after(state.epoch + 1, previous_cost, now, step, step_accepted=moved, reason=lost)
    return state
