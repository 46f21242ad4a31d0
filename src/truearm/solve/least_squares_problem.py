"""What the solver asks of a nonlinear least-squares problem: its cost and its normal equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from array_api_compat import array_namespace

from truearm.solve.arrays import Array, add_to_diagonal, as_array_like, cholesky_solver, to_numpy
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The quadratic model of a least-squares cost at a point.

    Attributes
    ----------
    cost : float
        Half the sum of squared residuals.
    gradient : (p,) array
        ``J^T r``.
    gram : (p, p) array
        ``J^T J``, symmetric; of NumPy or PyTorch, wherever the samples are.
    """

    cost: float
    gradient: FloatArray
    gram: Array

    def damped_step(self, mu: float) -> FloatArray | None:
        """The step of ``(J^T J + mu I) step = -J^T r``, or None where that matrix is not positive definite."""
        solved = self.damped(mu)
        return None if solved is None else solved(-self.gradient)

    def damped(self, mu: float) -> Callable[[FloatArray], FloatArray | None] | None:
        """``(J^T J + mu I)^-1`` as a function of a vector (p,); None where that matrix is not positive definite.

        One factorisation serves every vector; a solution that is not finite is None.
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

    def covariance(self) -> FloatArray:
        """(p, p) inverse of ``J^T J``: the parameters' covariance if the residuals have unit variance.

        Directions that the data do not determine to working precision keep a large but finite variance.
        """
        gram = to_numpy(self.gram)
        scale = 1 / np.sqrt(np.maximum(gram.diagonal(), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
        root = (scale[:, None] * vectors) / np.sqrt(np.maximum(values, 1e-14 * values[-1]))
        return np.asarray(root @ root.T)

    def predicted_decrease(self, step: FloatArray) -> float:
        """Decrease of the cost by `step` if the model were exact."""
        curvature = to_numpy(self.gram @ as_array_like(step, self.gram))
        return float(-step @ self.gradient - 0.5 * step @ curvature)


class Problem(Protocol):
    """A least-squares problem in p parameters."""

    def cost(self, x: FloatArray) -> float:
        """Half the sum of squared residuals at `x` (p,)."""
        ...

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton matrix at `x` (p,)."""
        ...
