"""Nonlinear least-squares problems: a cost, its quadratic model at a point, and rules that damp the steps of the model.

A model answers one question of the loop, the damped step; how it solves for the step (Cholesky factors of ``J^T J``,
orthogonal factors of a dense J, a Schur complement) is its own affair. A damping rule says how much of a step to trust,
adapted to how the last steps turned out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from array_api_compat import array_namespace

from truearm.errors import InputError
from truearm.solve.linear_algebra import Array, add_to_diagonal, as_array_like, cholesky_solver, to_numpy
from truearm.typing import FloatArray

# Singular values of a dense Jacobian below this share of the largest: the data do not tell the parameters apart.
RANK = 1e-11
SMALLEST = 1e-20
LARGEST = float(np.finfo(float).max)


class Linearisation(Protocol):
    """The quadratic model of a least-squares cost at a point."""

    @property
    def cost(self) -> float:
        """Half the sum of squared residuals at the point."""
        ...

    @property
    def tolerance(self) -> float:
        """By how much a step may raise the cost, since rounding may; 0 if every step must lower it."""
        ...

    def damped_step(self, mu: float) -> FloatArray | None:
        """The step (p,) under damping `mu`, or None if the system has no solution."""
        ...

    def predicted_decrease(self, step: FloatArray) -> float:
        """The decrease of the cost by `step` if the model were exact; NaN if it is not evaluated."""
        ...


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """A quadratic model by its Gauss-Newton matrix.

    Attributes
    ----------
    cost : float
        Half the sum of squared residuals.
    gradient : (p,) array
        ``J^T r``.
    gram : (p, p) array
        ``J^T J``, symmetric; a NumPy or PyTorch array, on the device of the samples.
    """

    cost: float
    gradient: FloatArray
    gram: Array
    tolerance = 0.0

    def damped_step(self, mu: float) -> FloatArray | None:
        """The step of ``(J^T J + mu I) step = -J^T r``, or None where that matrix is not positive definite."""
        solved = self.damped(mu)
        return None if solved is None else solved(-self.gradient)

    def damped(self, mu: float) -> Callable[[FloatArray], FloatArray | None] | None:
        """``(J^T J + mu I)^-1`` as a function of a vector (p,); None where that matrix is not positive definite.

        All vectors share one factorisation. The function returns None for a solution that is not finite.
        """
        matrix = array_namespace(self.gram).asarray(self.gram, copy=True)
        add_to_diagonal(matrix, mu)
        solver = cholesky_solver(matrix)
        if solver is None:
            return None

        def solved(right: FloatArray) -> FloatArray | None:
            solution = to_numpy(solver(as_array_like(right, self.gram)))
            return solution if np.isfinite(solution).all() else None

        return solved

    def predicted_decrease(self, step: FloatArray) -> float:
        """Decrease of the cost by `step` if the model were exact."""
        curvature = to_numpy(self.gram @ as_array_like(step, self.gram))
        return float(-step @ self.gradient - 0.5 * step @ curvature)


@dataclass(frozen=True, eq=False)
class DenseEquations:
    """A quadratic model by residuals and a dense Jacobian, solved by orthogonal factors: no digits are squared away.

    Attributes
    ----------
    residuals : (m,) array
    jacobian : (m, p) array
    rounding : float
        By how much rounding may change the norm of the residuals.
    """

    residuals: FloatArray
    jacobian: FloatArray
    rounding: float = 0.0

    @cached_property
    def cost(self) -> float:
        """Half the sum of squared residuals."""
        return 0.5 * float(self.residuals @ self.residuals)

    @property
    def tolerance(self) -> float:
        """By how much rounding may raise the cost."""
        return self.rounding * (float(np.sqrt(2 * self.cost)) + self.rounding / 2)

    @property
    def gradient(self) -> FloatArray:
        """(p,) ``J^T r``."""
        return self.jacobian.T @ self.residuals

    def damped_step(self, mu: float) -> FloatArray | None:
        """The step of ``(J^T J + mu I) step = -J^T r``, or None if the data do not tell the parameters apart."""
        p = self.jacobian.shape[1]
        matrix, right = self.jacobian, -self.residuals
        if mu:
            matrix = np.concatenate([matrix, np.sqrt(mu) * np.eye(p)])
            right = np.concatenate([right, np.zeros(p)])
        step, _, _, singular = np.linalg.lstsq(matrix, right, rcond=None)
        return None if singular[-1] <= RANK * singular[0] else np.asarray(step)

    def predicted_decrease(self, step: FloatArray) -> float:
        """The decrease of the cost by `step` if the residuals were linear."""
        change = self.jacobian @ step
        return -float(change @ (self.residuals + change / 2))


@dataclass(frozen=True, eq=False)
class KnownStep:
    """A model whose step was solved for elsewhere.

    Attributes
    ----------
    cost : float
        Half the sum of squared residuals at the point.
    step : (p,) array
        The undamped step.
    tolerance : float
        By how much rounding may raise the cost.
    """

    cost: float
    step: FloatArray
    tolerance: float = 0.0

    def damped_step(self, mu: float) -> FloatArray:
        """The step; the only damping is a fraction of it."""
        assert mu == 0
        return self.step

    def predicted_decrease(self, step: FloatArray) -> float:
        """NaN: not evaluated."""
        del step
        return np.nan


class Cost(Protocol):
    """A least-squares cost."""

    def cost(self, x: Any) -> float:
        """Half the sum of squared residuals at `x`."""
        ...


class Problem(Cost, Protocol):
    """A least-squares problem in p parameters."""

    def normal_equations(self, x: Any) -> Any:
        """The `Linearisation` at `x`."""
        ...


class DenseProblem:
    """A small problem by one function that returns residuals and Jacobian.

    Parameters
    ----------
    residuals_and_jacobian : callable
        Given a point, returns residuals (m,) and their derivatives (m, p) by the components of a step.
    rounding : callable, optional
        Given a point, returns by how much rounding may change the norm of the residuals there.
    """

    def __init__(
        self,
        residuals_and_jacobian: Callable[[Any], tuple[FloatArray, FloatArray]],
        *,
        rounding: Callable[[Any], float] | None = None,
    ) -> None:
        self._evaluate, self._rounding = residuals_and_jacobian, rounding
        self._last: tuple[Any, tuple[FloatArray, FloatArray]] | None = None

    def _at(self, x: Any) -> tuple[FloatArray, FloatArray]:
        """Residuals and Jacobian; the loop asks for those of an accepted trial point again."""
        if self._last is None or self._last[0] is not x:
            self._last = x, self._evaluate(x)
        return self._last[1]

    def cost(self, x: Any) -> float:
        """Half the sum of squared residuals at `x`."""
        residuals, _ = self._at(x)
        return 0.5 * float(residuals @ residuals)

    def normal_equations(self, x: Any) -> DenseEquations:
        """The model at `x`."""
        return DenseEquations(*self._at(x), 0.0 if self._rounding is None else self._rounding(x))


class Damping(Protocol):
    """A damping parameter and the rule by which it changes. Rules are values: each change returns a new rule."""

    @property
    def mu(self) -> float:
        """The number added to the diagonal of ``J^T J``."""
        ...

    @property
    def share(self) -> float:
        """The fraction of the damped step to try."""
        ...

    @property
    def is_exhausted(self) -> bool:
        """Whether the rule has no further step to try."""
        ...

    def at_start(self, equations: NormalEquations) -> Self:
        """The rule at the start of a minimisation."""
        ...

    def after_success(self, gain: float) -> Self:
        """The rule after a step that lowered the cost by `gain` times what the quadratic model predicted."""
        ...

    def after_failure(self) -> Self:
        """The rule after a step that did not lower the cost."""
        ...


@dataclass(frozen=True)
class MarquardtDamping:
    """Marquardt's rule with the defaults of MATLAB's ``trainlm``: a fixed factor down, a fixed factor up.

    Source: D. W. Marquardt, J. SIAM 11 (1963) 431; M. T. Hagan, M. Menhaj, IEEE Trans. Neural Networks 5 (1994) 989.

    Parameters
    ----------
    mu, decrease, increase, maximum : float
        MATLAB's ``mu, mu_dec, mu_inc, mu_max``. A step is still tried at `maximum`, as in MATLAB.
    minimum : float
        The damping never falls below this value; from zero it could not grow again.
    """

    mu: float = 1e-3
    decrease: float = 0.1
    increase: float = 10.0
    maximum: float = 1e10
    minimum: float = SMALLEST
    share = 1.0

    def __post_init__(self) -> None:
        if not (self.mu > 0 and 0 < self.decrease < 1 < self.increase < float("inf") and self.maximum > 0):
            raise InputError(
                "expected mu > 0, 0 < mu_dec < 1, mu_inc > 1 and mu_max > 0, "
                f"got {self.mu}, {self.decrease}, {self.increase}, {self.maximum}"
            )

    @property
    def is_exhausted(self) -> bool:
        """Whether the damping is above its maximum."""
        return self.mu > min(self.maximum, LARGEST)

    def at_start(self, equations: Linearisation) -> MarquardtDamping:  # noqa: ARG002 - the start is a constant
        """The rule itself."""
        return self

    def after_success(self, gain: float) -> MarquardtDamping:  # noqa: ARG002 - any success counts
        """Damping times `decrease`."""
        return replace(self, mu=max(self.mu * self.decrease, self.minimum))

    def after_failure(self) -> MarquardtDamping:
        """Damping times `increase`."""
        return replace(self, mu=self.mu * self.increase)


@dataclass(frozen=True)
class NielsenDamping:
    """Nielsen's rule: the damping falls with the gain ratio and rises ever faster.

    Source: H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05, eq. 2.4; K. Madsen,
    H. B. Nielsen, O. Tingleff, "Methods for non-linear least squares problems" (2004), algorithm 3.16.

    Parameters
    ----------
    relative_start : float
        The first damping, relative to the largest diagonal element of ``J^T J`` (tau).
    mu, growth, maximum : float
        Damping, its factor at the next failure and its limit; set at the start and updated by every step.
    """

    relative_start: float = 1e-3
    mu: float = 0.0
    growth: float = 2.0
    maximum: float = float("inf")
    share = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.relative_start < float("inf"):
            raise InputError(f"expected a first damping above zero, got {self.relative_start}")
        if not (self.mu >= 0 and self.growth > 1 and self.maximum > 0):
            raise InputError(
                f"expected mu >= 0, growth > 1 and a maximum > 0, got {self.mu}, {self.growth}, {self.maximum}"
            )

    @property
    def is_exhausted(self) -> bool:
        """Whether the damping is above its maximum."""
        return self.mu > min(self.maximum, LARGEST)

    def at_start(self, equations: NormalEquations) -> NielsenDamping:
        """The rule with a damping in proportion to the size of ``J^T J``."""
        # The largest element is zero where every unit is saturated, or NaN; in this order `max` returns neither.
        largest = max(SMALLEST, float(equations.gram.diagonal().max()))
        return replace(self, mu=max(self.relative_start * largest, SMALLEST), growth=2.0, maximum=1e16 * largest)

    def after_success(self, gain: float) -> NielsenDamping:
        """Damping times ``max(1/3, 1 - (2 gain - 1)^3)``; never below 1e-20, as with `MarquardtDamping`."""
        factor = max(1 / 3, 1 - (2 * min(gain, 2.0) - 1) ** 3)
        return replace(self, mu=max(self.mu * factor, SMALLEST), growth=2.0)

    def after_failure(self) -> NielsenDamping:
        """Damping times 2, 4, 8, ... at consecutive failures."""
        return replace(self, mu=self.mu * self.growth, growth=2 * self.growth)


@dataclass(frozen=True)
class StepHalving:
    """No damping: the Gauss-Newton step, halved until it does not raise the cost.

    Parameters
    ----------
    share : float
        The fraction of the step to try next.
    max_halvings : int
        After this many halvings the rule has no further step to try.
    halvings : int
        Halvings since the last step that was accepted.
    """

    share: float = 1.0
    max_halvings: int = 40
    halvings: int = 0
    mu = 0.0

    @property
    def is_exhausted(self) -> bool:
        """Whether the step was halved more often than allowed."""
        return self.halvings > self.max_halvings

    def at_start(self, equations: Linearisation) -> StepHalving:  # noqa: ARG002 - the start is a constant
        """The rule itself."""
        return self

    def after_success(self, gain: float) -> StepHalving:  # noqa: ARG002 - any success counts
        """The full step again."""
        return replace(self, share=1.0, halvings=0)

    def after_failure(self) -> StepHalving:
        """Half the step."""
        return replace(self, share=self.share / 2, halvings=self.halvings + 1)
