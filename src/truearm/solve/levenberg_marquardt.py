"""Levenberg-Marquardt, assembled from a problem, a damping rule and stopping rules."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from truearm.errors import TruearmError
from truearm.solve.damping import Damping, NielsenDamping
from truearm.solve.least_squares_problem import NormalEquations, Problem
from truearm.solve.stop_criteria import (
    CostConverged,
    MaxEpochs,
    MinGradient,
    OptimizerState,
    StopCriterion,
    StopReason,
    first_stop_reason,
)
from truearm.typing import FloatArray

MOST_DAMPING = np.finfo(float).max
# A promise below this share of the cost is rounding: where no step keeps it, the minimum is found. So it is where the
# fit is exact: what is left over is itself rounding, and steps promise to take some of it away, as of any noise. There
# the cost is a staircase, level under short steps that promise more than that; under wrong derivatives it slopes.
ROUNDING = 1e-9
LAST_DIGITS = 1e-12
# A bend is a correction: a longer one comes from where its own derivatives no longer hold. Transtrum and Sethna propose
# 3/8; with the lower of both costs taken, 1/2 needed fewer epochs.
MOST_BENDING = 0.5
SETTLED = StopReason("No step lowers the cost any more.", True)
STUCK = StopReason("No step lowers the cost, though the derivatives promise it: they may be wrong.", False)
UNSOLVED = StopReason("No step can be computed: the normal equations have no solution at any damping.", False)
DEFAULT_STOPS: tuple[StopCriterion, ...] = (MinGradient(0.0), CostConverged(), MaxEpochs(200))


@dataclass(frozen=True, eq=False)
class LevenbergMarquardtResult:
    """The outcome of a minimisation.

    Attributes
    ----------
    x : (p,) array
        The best parameters found.
    equations : NormalEquations
        Cost, gradient and Gauss-Newton matrix there.
    reason : StopReason
        Why it ended.
    epochs : int
        Epochs done.
    """

    x: FloatArray
    equations: NormalEquations
    reason: StopReason
    epochs: int

    @property
    def cost(self) -> float:
        """Half the sum of squared residuals at `x`."""
        return self.equations.cost

    def covariance(self) -> FloatArray:
        """(p, p) covariance of `x` if the residuals have unit variance: see `NormalEquations.covariance`."""
        return self.equations.covariance()


def levenberg_marquardt(
    problem: Problem,
    start: npt.ArrayLike | OptimizerState,
    *,
    damping: Damping | None = None,
    stops: Sequence[StopCriterion] = DEFAULT_STOPS,
    callback: Callable[[OptimizerState], None] | None = None,
    update_problem: Callable[[FloatArray, NormalEquations], tuple[Problem, NormalEquations]] | None = None,
    acceleration: Callable[[FloatArray, FloatArray], FloatArray] | None = None,
) -> LevenbergMarquardtResult:
    """Minimise half a sum of squares.

    An epoch evaluates the normal equations once and raises the damping until a step lowers the cost; rejected steps
    use the same equations again.

    Parameters
    ----------
    problem : Problem
        Gives cost and normal equations.
    start : (p,) array or OptimizerState
        Where to begin; or the state after an epoch of an earlier call, which then goes on as if it had not ended there.
        Of it the epoch, parameters, damping, time and reason are used.
    damping : Damping, optional
        `NielsenDamping()` by default. A state brings its own.
    stops : sequence of StopCriterion
        Asked in this order after every epoch, and at the start.
    callback : callable, optional
        Told the state after every epoch, and at the start, once the stops were asked.
    update_problem : callable, optional
        Given the parameters (p,) and their equations after every epoch that moved, gives the problem to go on with and
        its equations there: weights that follow the data.
    acceleration : callable, optional
        Given the parameters (p,) and a step (p,), gives ``J^T r''`` (p,), with the second derivative of the residuals
        along the step. Steps are then bent by ``-(J^T J + mu I)^-1 J^T r'' / 2`` where that is at most half as long as
        the step and lowers the cost further (geodesic acceleration; M. K. Transtrum, J. P. Sethna, "Improvements to
        the Levenberg-Marquardt algorithm for nonlinear least-squares minimization", arXiv:1201.5885, 2012).

    Returns
    -------
    LevenbergMarquardtResult
        Not converging is no exception: see its `reason`.

    Raises
    ------
    TruearmError
        If the cost at the start is not a finite number.
    """
    given = start if isinstance(start, OptimizerState) else None
    begun = time.perf_counter() - (0.0 if given is None else given.seconds)
    x = np.array(start if given is None else given.x, dtype=float)
    equations = problem.normal_equations(x)
    if not np.isfinite(equations.cost):
        raise TruearmError("the cost at the start is not a finite number: check the data for NaN and overflow")

    def stand(epoch: int, damping: Damping, previous_cost: float, no_step: StopReason | None = None) -> OptimizerState:
        """The state after an epoch, as told; `no_step` is why it did not move, if it did not."""
        state = OptimizerState(
            epoch=epoch,
            x=x,
            cost=equations.cost,
            previous_cost=previous_cost,
            gradient_norm=float(np.linalg.norm(equations.gradient)),
            seconds=time.perf_counter() - begun,
            step_accepted=no_step is None,
            damping=damping,
        )
        state = replace(state, reason=first_stop_reason(stops, state) or no_step)
        if callback is not None:
            callback(state)
        return state

    state = given or stand(0, (damping or NielsenDamping()).at_start(equations), np.inf)
    while state.reason is None:
        assert state.damping is not None  # every state of this solver has one
        damping, moved, promised, level, higher = state.damping, False, -np.inf, False, False
        while damping.mu <= min(damping.maximum, MOST_DAMPING) and not moved:
            solved = equations.damped(damping.mu)
            step = None if solved is None else solved(-equations.gradient)
            if solved is None or step is None:
                damping = damping.after_failure()
                continue
            cost, promise = problem.cost(x + step), equations.predicted_decrease(step)
            bend = None if acceleration is None else solved(-acceleration(x, step) / 2)
            if bend is not None and np.linalg.norm(bend) <= MOST_BENDING * np.linalg.norm(step):
                bent_cost = problem.cost(x + (step + bend))
                if bent_cost < cost:
                    cost, step = bent_cost, step + bend
            # A step in the last digits of x has nothing to keep.
            promised = max(promised, promise if np.linalg.norm(step) > LAST_DIGITS * np.linalg.norm(x) else 0.0)
            if cost < equations.cost:
                damping = damping.after_success((equations.cost - cost) / promise if promise > 0 else 0.0)
                x, moved = x + step, True
            else:
                damping = damping.after_failure()
                level = level or (cost == equations.cost and promise > ROUNDING * cost)
                higher = higher or cost > equations.cost
        previous_cost = equations.cost
        if moved:
            del equations, solved  # as large as the parameters squared: matrix and factor make room for the new ones
            equations = problem.normal_equations(x)
            if update_problem is not None:
                problem, equations = update_problem(x, equations)
        no_step = None
        if not moved:
            settled = (level and higher) or promised <= ROUNDING * equations.cost
            no_step = UNSOLVED if promised == -np.inf else SETTLED if settled else STUCK
        state = stand(state.epoch + 1, damping, previous_cost, no_step)
    return LevenbergMarquardtResult(x, equations, state.reason, state.epoch)
