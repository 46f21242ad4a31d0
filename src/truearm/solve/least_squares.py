"""Nonlinear least squares: one loop, assembled from a problem, a step, a damping rule and stop criteria.

A named method is a choice of these: Levenberg-Marquardt damps the step by Nielsen's or Marquardt's rule, Gauss-Newton
halves it. `damped_step` is one epoch by itself, for callers whose weights or priors change from epoch to epoch.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import numpy.typing as npt

from truearm.errors import TruearmError
from truearm.solve.least_squares_problem import (
    Cost,
    Damping,
    Linearisation,
    MarquardtDamping,
    NielsenDamping,
    NormalEquations,
    Problem,
    StepHalving,
)
from truearm.solve.stop_criteria import (
    CostConverged,
    MaxEpochs,
    MinGradient,
    OptimizerState,
    StopCriterion,
    StopReason,
    first_stop_reason,
)
from truearm.typing import BoolArray, FloatArray, IntArray

# A predicted decrease below this share of the cost is rounding: where no step achieves it, the minimum is reached. The
# same holds where the fit is exact: the remaining residuals are rounding, and steps predict to remove some of it, as of
# any noise. There the cost is a staircase, level under short steps that predict more; wrong derivatives make it slope.
ROUNDING = 1e-9
LAST_DIGITS = 1e-12
# A bend is a correction; a longer one starts where its own derivatives are no longer valid. Transtrum and Sethna
# propose 3/8; as the lower of both costs is used, 1/2 needed fewer epochs.
MOST_BENDING = 0.5
SETTLED = StopReason("No step lowers the cost any more.", True)
STUCK = StopReason("No step lowers the cost, although the derivatives predict it: they may be wrong.", False)
UNSOLVED = StopReason("No step can be computed: the normal equations have no solution at any damping.", False)
DEFAULT_STOPS: tuple[StopCriterion, ...] = (MinGradient(0.0), CostConverged(), MaxEpochs(200))


@dataclass(frozen=True, eq=False)
class LeastSquaresResult:
    """The outcome of a minimisation.

    Attributes
    ----------
    x : (p,) array
        The best parameters.
    equations : Linearisation
        The quadratic model there.
    reason : StopReason
        Why the minimisation ended.
    epochs : int
        Number of epochs.
    """

    x: Any
    equations: Any
    reason: StopReason
    epochs: int

    @property
    def cost(self) -> float:
        """Half the sum of squared residuals at `x`."""
        return float(self.equations.cost)


class Trial(NamedTuple):
    """A point that a step leads to.

    Attributes
    ----------
    x : (p,) array
        The point.
    cost : float
        Half the sum of squares there.
    predicted : float
        The decrease of the cost that the quadratic model predicts.
    in_last_digits : bool
        Whether the step changes only the last digits of the point.
    """

    x: Any
    cost: float
    predicted: float
    in_last_digits: bool = False


StepRule = Callable[[Cost, Any, Any, Damping], Trial | None]
"""Given a problem, a point, the model there and a damping, returns a trial point, or None without a solution."""


def newton_step(
    problem: Cost,
    x: Any,
    equations: Linearisation,
    damping: Damping,
    *,
    move: Callable[[Any, FloatArray], Any] = np.add,
) -> Trial | None:
    """Try the damped Gauss-Newton step.

    `move` is how a step (p,) changes a point: a sum, or on a manifold a retraction.
    """
    step = equations.damped_step(damping.mu)
    if step is None:
        return None
    step = damping.share * step
    there = move(x, step)
    return Trial(there, problem.cost(there), equations.predicted_decrease(step), move is np.add and _is_tiny(step, x))


def accelerated_step(
    problem: Cost,
    x: FloatArray,
    equations: NormalEquations,
    damping: Damping,
    *,
    acceleration: Callable[[FloatArray, FloatArray], FloatArray],
) -> Trial | None:
    """Try the damped Gauss-Newton step, bent by the second derivative along it (geodesic acceleration).

    `acceleration` returns ``J^T r''`` (p,) at a point for a step (p,), with r'' the second derivative of the residuals
    along the step. The step is bent by ``-(J^T J + mu I)^-1 J^T r'' / 2`` where that is at most half as long as the
    step and lowers the cost further. Source: M. K. Transtrum, J. P. Sethna, "Improvements to the Levenberg-Marquardt
    algorithm for nonlinear least-squares minimization", arXiv:1201.5885, 2012.
    """
    solve = equations.damped(damping.mu)
    step = None if solve is None else solve(-equations.gradient)
    if solve is None or step is None:
        return None
    cost, predicted, bend = (
        problem.cost(x + step),
        equations.predicted_decrease(step),
        solve(-acceleration(x, step) / 2),
    )
    if bend is not None and np.linalg.norm(bend) <= MOST_BENDING * np.linalg.norm(step):
        bent_cost = problem.cost(x + (step + bend))
        if bent_cost < cost:
            cost, step = bent_cost, step + bend
    return Trial(x + step, cost, predicted, _is_tiny(step, x))


def step_in_valley(
    rows: Callable[[FloatArray], FloatArray],
    solve: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    step: FloatArray,
    here: FloatArray,
    there: FloatArray,
) -> FloatArray:
    """The best step in the plane of a Gauss-Newton step and of its geodesic acceleration.

    Where a valley of the cost bends, the step leads out of it, and so may the step with the whole acceleration, see
    `accelerated_step`. In t steps and u accelerations the residuals are taken for ``r + b t + c t^2 + e u + f t u``, as
    where parameters multiply each other; the sum of their squares is a polynomial.

    Parameters
    ----------
    rows : callable
        Residuals (m,) at a point (p,), with those of priors.
    solve : callable
        ``(J^T J)^-1 J^T`` of residuals (m,) at `x`, (p,).
    x, step : (p,) array
        The point and its Gauss-Newton step.
    here, there : (m,) array
        Residuals at `x` and ``x + step``.
    """
    from scipy.optimize import minimize  # slow to import, and most steps need no bend

    back = rows(x - step)
    curved = (there + back) / 2 - here
    bend = -solve(curved)
    along = rows(x + bend) - here
    across = rows(x + step + bend) - there - along
    coefficients = np.array([here, (there - back) / 2, curved, along, across])
    gram = coefficients @ coefficients.T

    def cost(shares: FloatArray) -> tuple[float, FloatArray]:
        t, u = shares
        powers, by_shares = np.array([1, t, t * t, u, t * u]), np.array([[0, 1, 2 * t, 0, u], [0, 0, 0, 1, t]])
        return 0.5 * float(powers @ gram @ powers), by_shares @ gram @ powers

    return np.asarray(minimize(cost, [1.0, 0.5], jac=True, method="BFGS").x @ np.array([step, bend]))


def _is_tiny(step: FloatArray, x: FloatArray) -> bool:
    return bool(np.linalg.norm(step) <= LAST_DIGITS * np.linalg.norm(x))


class Epoch(NamedTuple):
    """One accepted step, or the reason why there was none.

    Attributes
    ----------
    trial : Trial or None
        The accepted point.
    damping : Damping
        The rule for the next epoch.
    reason : StopReason or None
        Why no step was accepted.
    """

    trial: Trial | None
    damping: Any
    reason: StopReason | None


def damped_step(
    problem: Cost, x: Any, equations: Linearisation, damping: Damping, *, step: StepRule = newton_step
) -> Epoch:
    """Raise the damping until a step does not raise the cost beyond rounding.

    Parameters
    ----------
    problem : Cost
    x : (p,) array
    equations : Linearisation
        The model at `x`; rejected steps use it again.
    damping : Damping
    step : callable
        The step rule.
    """
    predicted, level, higher = -np.inf, False, False
    while not damping.is_exhausted:
        trial = step(problem, x, equations, damping)
        if trial is None:
            damping = damping.after_failure()
            continue
        if trial.cost < equations.cost + equations.tolerance:
            gain = (equations.cost - trial.cost) / trial.predicted if trial.predicted > 0 else 0.0
            return Epoch(trial, damping.after_success(gain), None)
        predicted = np.fmax(predicted, 0.0 if trial.in_last_digits else trial.predicted)
        level = level or (trial.cost == equations.cost and trial.predicted > ROUNDING * trial.cost)
        higher = higher or trial.cost > equations.cost
        damping = damping.after_failure()
    settled = (level and higher) or predicted <= ROUNDING * equations.cost
    return Epoch(None, damping, UNSOLVED if predicted == -np.inf else SETTLED if settled else STUCK)


def minimise(
    problem: Problem,
    start: npt.ArrayLike,
    *,
    damping: Damping,
    step: StepRule = newton_step,
    stops: Sequence[StopCriterion] = DEFAULT_STOPS,
    callback: Callable[[OptimizerState], None] | None = None,
    update_problem: Callable[[FloatArray, NormalEquations], tuple[Problem, NormalEquations]] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> LeastSquaresResult:
    """Minimise half a sum of squares.

    An epoch evaluates the quadratic model once and raises the damping until a step lowers the cost.

    Parameters
    ----------
    problem : Problem
        Returns cost and quadratic model.
    start : point
        The first point, an array (p,) unless `step` moves other things.
    damping : Damping
    step : callable
        The step rule.
    stops : sequence of StopCriterion
        Evaluated in this order at the start and after every epoch.
    callback : callable, optional
        Called with the state at the start and after every epoch, once the stops were evaluated.
    update_problem : callable, optional
        Given the parameters (p,) and their equations after every epoch that moved, returns the problem to continue with
        and its equations there: weights that follow the data.
    clock : callable
        Returns the time [s] that the states count: passed time, or `time.process_time`.

    Returns
    -------
    LeastSquaresResult
        A minimisation that does not converge raises no exception: see its `reason`.

    Raises
    ------
    TruearmError
        If the cost at the start is not a finite number.
    """
    begun = clock()
    x: Any = start
    equations = problem.normal_equations(x)
    if not np.isfinite(equations.cost):
        raise TruearmError("the cost at the start is not a finite number: check the data for NaN and overflow")

    def state_after(epoch: int, damping: Damping, previous_cost: float, **more: Any) -> OptimizerState:
        """The state, with the reason to stop if there is one."""
        state = OptimizerState(
            epoch=epoch,
            x=x,
            cost=equations.cost,
            previous_cost=previous_cost,
            gradient_norm=float(np.linalg.norm(equations.gradient)),
            seconds=clock() - begun,
            damping=damping,
            **more,
        )
        reason = first_stop_reason(stops, state)
        if reason is not None:
            state = replace(state, reason=reason)
        if callback is not None:
            callback(state)
        return state

    state = state_after(0, damping.at_start(equations), np.inf)
    while state.reason is None:
        assert state.damping is not None  # every state of this loop has one
        epoch = damped_step(problem, x, equations, state.damping, step=step)
        previous_cost, predicted = equations.cost, np.nan
        if epoch.trial is not None:
            x, predicted = epoch.trial.x, epoch.trial.predicted
            del equations  # as large as the parameters squared: make room for the new ones
            equations = problem.normal_equations(x)
            if update_problem is not None:
                problem, equations = update_problem(x, equations)
        state = state_after(
            state.epoch + 1,
            epoch.damping,
            previous_cost,
            predicted=predicted,
            step_accepted=epoch.trial is not None,
            reason=epoch.reason,
        )
    return LeastSquaresResult(x, equations, state.reason, state.epoch)


def levenberg_marquardt(
    problem: Problem,
    start: npt.ArrayLike,
    *,
    damping: Damping | None = None,
    acceleration: Callable[[FloatArray, FloatArray], FloatArray] | None = None,
    **options: Any,
) -> LeastSquaresResult:
    """Minimise with damped steps, by Nielsen's rule unless `damping` is another, with geodesic acceleration if given.

    See `minimise` for the other options, and `accelerated_step` for `acceleration`.
    """
    step = newton_step if acceleration is None else partial(accelerated_step, acceleration=acceleration)
    return minimise(problem, np.array(start, dtype=float), damping=damping or NielsenDamping(), step=step, **options)


def gauss_newton(
    problem: Problem,
    start: Any,
    *,
    move: Callable[[Any, FloatArray], Any] = np.add,
    stops: Sequence[StopCriterion] = DEFAULT_STOPS,
) -> LeastSquaresResult:
    """Minimise with undamped steps, halved until they do not raise the cost; `move` as in `newton_step`."""
    return minimise(problem, start, damping=StepHalving(), step=partial(newton_step, move=move), stops=stops)


class RowProblem(Protocol):
    """Many small independent problems, one a row."""

    def rows(self, which: IntArray, /) -> Self:
        """Some of the problems."""
        ...

    def linearise(self, x: FloatArray, /) -> tuple[FloatArray, FloatArray]:
        """Residuals (n, m) and their Jacobians (n, m, p) at points (n, p)."""
        ...

    def move(self, x: FloatArray, residuals: FloatArray, jacobian: FloatArray, mu: FloatArray, /) -> FloatArray:
        """The points (n, p) after a step of every row under dampings `mu` (n,)."""
        ...

    def has_converged(self, residuals: FloatArray, /) -> BoolArray:
        """(n,) which rows need no further step."""
        ...


class RowsResult(NamedTuple):
    """Where many small minimisations ended, row by row.

    Attributes
    ----------
    x : (n, p) array
        The best points.
    residuals : (n, m) array
        Their residuals.
    jacobian : (n, m, p) array
        Their Jacobians.
    steps : (n,) int array
        Steps tried, the rejected ones included.
    """

    x: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    steps: IntArray


def levenberg_marquardt_by_row(
    problem: RowProblem, start: FloatArray, *, damping: MarquardtDamping, max_epochs: int
) -> RowsResult:
    """Minimise many small problems at once, each row with its own damping by Marquardt's rule."""
    x = start.copy()
    residuals, jacobian = problem.linearise(x)
    mu = np.full(len(x), damping.mu)
    steps = np.zeros(len(x), dtype=np.intp)
    live = np.arange(len(x))
    for _ in range(max_epochs):
        live = live[~problem.rows(live).has_converged(residuals[live]) & (mu[live] < damping.maximum)]
        if not live.size:
            break
        part = problem.rows(live)
        steps[live] += 1
        tried = part.move(x[live], residuals[live], jacobian[live], mu[live])
        residuals_there, jacobian_there = part.linearise(tried)
        better = (residuals_there**2).sum(axis=1) < (residuals[live] ** 2).sum(axis=1)
        rows = live[better]
        x[rows], residuals[rows], jacobian[rows] = tried[better], residuals_there[better], jacobian_there[better]
        mu[live] = np.where(
            better, np.maximum(mu[live] * damping.decrease, damping.minimum), mu[live] * damping.increase
        )
    return RowsResult(x, residuals, jacobian, steps)
