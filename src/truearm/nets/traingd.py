"""MATLAB's ``traingd`` and ``traingdx``: gradient descent, plain and with momentum and an adaptive rate.

Names, defaults and stops are MATLAB's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError, TruearmError
from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import TrainingLog, TrainingOptions, TrainingRecord, checked_start
from truearm.solve.stop_criteria import (
    CostGoal,
    MinGradient,
    OptimizerState,
    StopCriterion,
    StopReason,
    first_stop_reason,
)
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

Gradient: TypeAlias = Callable[[FloatArray], tuple[float, FloatArray]]

# Squares of larger values approach the largest double.
LOST = 1e100
DIVERGED = StopReason("The error has grown beyond all bounds: the learning rate is too large.", False)


@dataclass(frozen=True, eq=False, kw_only=True)
class DescentState(OptimizerState):
    """The state of a descent after an epoch; costs and gradients are those of its problem.

    Attributes
    ----------
    gradient : (p,) array
    rate : float
        The learning rate of the next epoch.
    step : (p,) array
        The step that momentum continues: the last one, or ``-rate * gradient`` at the start and after a refused step.
    """

    gradient: FloatArray
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
    gradient: Gradient,
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
    gradient : callable
        Cost, and its gradient (p,), at a point (p,).
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

    def judged(state: DescentState) -> DescentState:
        """The state with its time, and with the reason to stop if there is one."""
        state = replace(state, seconds=clock() - begun)
        state = replace(state, reason=first_stop_reason(stops, state) or state.reason)
        if callback is not None:
            callback(state)
        return state

    state = judged(_at_start(gradient, np.array(start, dtype=float), rate))
    while state.reason is None:
        state = judged(_after_another_epoch(gradient, state, rate))
    return state


def _at_start(gradient_at: Gradient, x: FloatArray, rate: LearningRate) -> DescentState:
    """The state before the first epoch; its time is not yet known."""
    cost, gradient = gradient_at(x)
    if not np.isfinite(cost):
        raise TruearmError("the cost at the start is not a finite number: check the data for NaN and overflow")
    return DescentState(
        epoch=0,
        x=x,
        cost=cost,
        previous_cost=np.inf,
        gradient_norm=float(np.linalg.norm(gradient)),
        seconds=0.0,
        gradient=gradient,
        rate=rate.start,
        step=-rate.start * gradient,
    )


def _after_another_epoch(gradient_at: Gradient, before: DescentState, rate: LearningRate) -> DescentState:
    """The state after one step more, made or refused; its time is not yet known."""
    now = before.rate
    step = rate.momentum * before.step - (1 - rate.momentum) * now * before.gradient
    with np.errstate(over="ignore", invalid="ignore"):  # too large a rate shows in its cost
        cost, gradient = gradient_at(before.x + step)
    same = replace(before, epoch=before.epoch + 1, previous_cost=before.cost)
    if cost <= LOST and (cost <= before.cost or cost <= rate.max_cost_ratio * before.cost):
        return replace(
            same,
            x=before.x + step,
            cost=cost,
            gradient=gradient,
            gradient_norm=float(np.linalg.norm(gradient)),
            rate=now * (rate.increase if cost < before.cost else 1.0),
            step=step,
            step_accepted=True,
        )
    now *= rate.decrease
    # Where the rate does not fall, the same step would be refused again.
    lost = DIVERGED if rate.decrease == 1 else None
    return replace(same, rate=now, step=-now * before.gradient, step_accepted=False, reason=lost)


@dataclass(frozen=True, eq=False, kw_only=True)
class DescentOptions(TrainingOptions):
    """Options of `traingd`, as MATLAB's.

    Parameters
    ----------
    lr : float
        The step for a unit of the gradient of the mean squared error of scaled outputs.
    max_fail : int
        Validation failures since the best epoch that end it.
    min_grad : float
        Norm of the gradient to stop at.
    """

    lr: float = 0.01
    max_fail: int = 6
    min_grad: float = 1e-5


def traingd(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, TrainingRecord]:
    """Train a network's weights by ``weights - lr * gradient of the mean squared error``.

    It takes very many epochs; it is here because others report it. It ends, asked in this order after every epoch,
    when `perf` is at `goal`, after `epochs`, after `time`, when `gradient` is at `min_grad`, and when the validation
    error was above its best `max_fail` times. An error that grows beyond all bounds ends it too.

    Source: defaults and stops as https://www.mathworks.com/help/deeplearning/ref/traingd.html has them.

    Parameters and results are those of `trainlm`, with options of `DescentOptions`; `mu` of the record is NaN.
    """
    chosen = DescentOptions(**options)
    if not 0 < chosen.lr < float("inf"):
        raise InputError(f"expected a learning rate lr above zero, got {chosen.lr}")
    log = descend(training, weights, chosen, LearningRate(chosen.lr))
    return log.best_weights(), log.record(TrainingRecord)


def descend(training: FitProblem, weights: FloatArray, options: DescentOptions, rate: LearningRate) -> TrainingLog:
    """The log of a training by gradient descent."""
    start, log = checked_start(training, weights, options), TrainingLog(training, options)

    def mean_square(x: FloatArray) -> tuple[float, FloatArray]:
        """MATLAB's ``mse`` of the scaled outputs, and its gradient."""
        cost, gradient = training.gradient(x)
        half = training.n_errors / 2
        return cost / half, gradient / half

    with one_blas_thread():
        gradient_descent(
            mean_square,
            start,
            rate=rate,
            stops=log.stops(CostGoal(options.goal), MinGradient(options.min_grad)),
            callback=lambda state: log.keep(state, perf=state.cost, gradient=state.gradient_norm, lr=state.rate),
            clock=options.clock,
        )
    return log


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveDescentOptions(DescentOptions):
    """Options of `traingdx`, as MATLAB's.

    Parameters
    ----------
    lr_inc, lr_dec : float
        Factors of `lr` after a step that lowered the error, and after one that was not made.
    max_perf_inc : float
        A step is not made if it multiplies the error by more than this.
    mc : float
        Momentum: the share of the last step in the next.
    """

    lr_inc: float = 1.05
    lr_dec: float = 0.7
    max_perf_inc: float = 1.04
    mc: float = 0.9


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveRecord(TrainingRecord):
    """A training record with the learning rate after every epoch.

    Attributes
    ----------
    lr : (epochs + 1,) array
        As the next epoch uses it.
    """

    lr: FloatArray


def traingdx(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, AdaptiveRecord]:
    """Train a network's weights by gradient descent with momentum and an adaptive rate.

    A step is ``mc * last step - (1 - mc) * lr * gradient``. If it multiplies the error by more than `max_perf_inc` it
    is not made, `lr` is multiplied by `lr_dec`, and the next step is without momentum. If it lowers the error, `lr` is
    multiplied by `lr_inc`. It ends as `traingd` does.

    Source: defaults, stops and the rate's rule as https://www.mathworks.com/help/deeplearning/ref/traingdx.html has
    them; the step as M. T. Hagan, H. B. Demuth, M. Beale, "Neural Network Design" (1996), chapter 12. (MATLAB's page
    writes ``lr * mc`` for ``(1 - mc) * lr``, unlike that of ``traingdm``.)

    Parameters and results are those of `trainlm`, with options of `AdaptiveDescentOptions`; `mu` of the record is NaN.
    """
    o = AdaptiveDescentOptions(**options)
    if not (0 < o.lr < float("inf") and o.lr_inc >= 1 and 0 < o.lr_dec < 1 and o.max_perf_inc >= 1 and 0 <= o.mc < 1):
        raise InputError(
            "expected lr > 0, lr_inc >= 1, 0 < lr_dec < 1, max_perf_inc >= 1 and 0 <= mc < 1, got "
            f"{o.lr}, {o.lr_inc}, {o.lr_dec}, {o.max_perf_inc}, {o.mc}"
        )
    log = descend(training, weights, o, LearningRate(o.lr, o.mc, o.lr_inc, o.lr_dec, o.max_perf_inc))
    return log.best_weights(), log.record(AdaptiveRecord)
