"""Nonlinear least-squares problems: a cost, and its quadratic model at a point.

A model answers one question of the loop, the damped step; how it solves for the step (Cholesky factors of ``J^T J``,
orthogonal factors of a dense J, a Schur complement) is its own affair.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from array_api_compat import array_namespace

from truearm.solve.linear_algebra import Array, add_to_diagonal, as_array_like, cholesky_solver, to_numpy
from truearm.typing import FloatArray

# Singular values of a dense Jacobian below this share of the largest: the data do not tell the parameters apart.
RANK = 1e-11


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
