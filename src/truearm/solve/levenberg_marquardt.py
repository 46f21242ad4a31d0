"""Levenberg-Marquardt, assembled from a problem, a damping rule and stopping rules."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import TruearmError
from truearm.solve.damping import Damping, Nielsen
from truearm.solve.problem import NormalEquations, Problem
from truearm.solve.stops import Epochs, Gradient, Reason, Settled, State, Stop

FloatArray = npt.NDArray[np.float64]

# A promise below this share of the cost is rounding: where no step keeps it, the minimum is found.
ROUNDING = 1e-9
SETTLED = Reason("No step lowers the cost any more.", True)
STUCK = Reason("No step lowers the cost, though the derivatives promise it: they may be wrong.", False)
DEFAULT_STOPS: tuple[Stop, ...] = (Gradient(0.0), Settled(), Epochs(200))


@dataclass(frozen=True, eq=False)
class Result:
    """The outcome of a minimisation.

    Attributes
    ----------
    x : (p,) array
        The best parameters found.
    equations : NormalEquations
        Cost, gradient and Gauss-Newton matrix there.
    reason : Reason
        Why it ended.
    history : tuple of State
        One entry an epoch, the start first.
    evaluations : int
        Evaluations of the cost, the rejected steps included.
    """

    x: FloatArray
    equations: NormalEquations
    reason: Reason
    history: tuple[State, ...]
    evaluations: int

    @property
    def cost(self) -> float:
        """Half the sum of squared residuals at `x`."""
        return self.equations.cost

    @property
    def epochs(self) -> int:
        """Epochs done."""
        return self.history[-1].epoch

    def covariance(self) -> FloatArray:
        """(p, p) covariance of `x` if the residuals have unit variance: see `NormalEquations.covariance`."""
        return self.equations.covariance()


def levenberg_marquardt(
    problem: Problem,
    start: npt.ArrayLike,
    *,
    damping: Damping | None = None,
    stops: Sequence[Stop] = DEFAULT_STOPS,
    callback: Callable[[State], None] | None = None,
    renew: Callable[[FloatArray, NormalEquations], tuple[Problem, NormalEquations]] | None = None,
) -> Result:
    """Minimise half a sum of squares.

    An epoch evaluates the normal equations once and raises the damping until a step lowers the cost; rejected steps
    use the same equations again.

    Parameters
    ----------
    problem : Problem
        Gives cost and normal equations.
    start : (p,) array
        Where to begin.
    damping : Damping, optional
        `Nielsen()` by default.
    stops : sequence of Stop
        Asked in this order after every epoch, and at the start.
    callback : callable, optional
        Told the state after every epoch, and at the start, once the stops were asked.
    renew : callable, optional
        Given the parameters (p,) and their equations after every epoch that moved, gives the problem to go on with and
        its equations there: weights that follow the data.

    Returns
    -------
    Result
        Not converging is no exception: see its `reason`.

    Raises
    ------
    TruearmError
        If the cost at the start is not a finite number.
    """
    x = np.array(start, dtype=float)
    equations = problem.normal_equations(x)
    if not np.isfinite(equations.cost):
        raise TruearmError("the cost at the start is not a finite number: check the data for NaN and overflow")
    damping = (damping or Nielsen()).started(equations)
    history: list[State] = []
    previous_cost, moved, promised, evaluations, begun = np.inf, True, 0.0, 1, time.perf_counter()
    while True:
        state = State(
            epoch=len(history),
            x=x,
            cost=equations.cost,
            previous_cost=previous_cost,
            gradient_norm=float(np.linalg.norm(equations.gradient)),
            mu=damping.mu,
            mu_maximum=damping.maximum,
            seconds=time.perf_counter() - begun,
            moved=moved,
        )
        history.append(state)
        # Every rule sees every state: one that collects (validation) must not miss any.
        reasons = [reason for reason in [stop(state) for stop in stops] if reason is not None]
        if callback is not None:
            callback(state)
        if not moved:
            reasons.append(SETTLED if promised <= ROUNDING * equations.cost else STUCK)
        if reasons:
            return Result(x, equations, reasons[0], tuple(history), evaluations)
        previous_cost, moved, promised = equations.cost, False, 0.0
        while damping.mu < damping.maximum and not moved:
            step = equations.damped_step(damping.mu)
            if step is None:
                damping = damping.failed()
                continue
            cost, promise = problem.cost(x + step), equations.predicted_decrease(step)
            evaluations += 1
            promised = max(promised, promise)
            if cost < equations.cost:
                damping = damping.succeeded((equations.cost - cost) / promise if promise > 0 else 0.0)
                x, moved = x + step, True
            else:
                damping = damping.failed()
        if moved:
            equations = problem.normal_equations(x)
            if renew is not None:
                problem, equations = renew(x, equations)
