"""Variable projection: the linear output layer is solved for at every step, only hidden weights are searched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_solve, cholesky, lstsq, solve_triangular

from truearm.nets.normal_equations import FitProblem
from truearm.solve import NormalEquations

FloatArray = npt.NDArray[np.float64]

# A ridge on the output layer's Gram matrix, relative to its mean diagonal: hidden units that have become alike leave it
# singular to rounding, and any of their shares then fits as well.
RIDGE = 1e-14


@dataclass(frozen=True, eq=False)
class ProjectedProblem:
    """A network's fit as a problem in its hidden weights alone.

    At hidden weights theta the output layer takes its least-squares value; the Gauss-Newton matrix is the Schur
    complement of the full one, and the gradient by the output layer is zero.

    Source: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; L. Kaufman, BIT 15 (1975) 49 (the approximation
    that drops the projector's second derivative); J. Sjoberg, M. Viberg, "Separable non-linear least-squares
    minimization", NNSP 1997 (for networks).

    Parameters
    ----------
    full : FitProblem
        The fit in all weights.
    """

    full: FitProblem

    @property
    def n_hidden_weights(self) -> int:
        """Number of weights below the output layer: the first ones of a network's weights."""
        m, n = self.full.network.shapes[-1]
        return self.full.network.n_weights - m * n

    def completed(self, hidden_weights: FloatArray) -> FloatArray:
        """All weights (n_weights,): the hidden ones given, with the output layer that fits best."""
        output_shape = self.full.network.shapes[-1]
        weights = np.concatenate([hidden_weights, np.zeros(output_shape[0] * output_shape[1])])
        last_hidden = self.full.network.forward(weights, self.full.inputs)[-2]
        A = np.concatenate([last_hidden, np.ones((1, last_hidden.shape[1]))])
        weights[len(hidden_weights) :] = _least_squares(A, self.full.targets).ravel()
        return weights

    def cost(self, x: FloatArray) -> float:
        """Half the sum of squared errors at hidden weights `x` with the best output layer."""
        return self.full.cost(self.completed(x))

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """The equations in the hidden weights, the output layer eliminated."""
        full = self.full.normal_equations(self.completed(x))
        p = len(x)
        outputs = full.gram[p:, p:].copy()
        outputs.flat[:: len(outputs) + 1] += RIDGE * outputs.diagonal().mean()
        half = solve_triangular(cholesky(outputs, lower=True), full.gram[p:, :p], lower=True, check_finite=False)
        return NormalEquations(full.cost, full.gradient[:p], full.gram[:p, :p] - half.T @ half)


def _least_squares(A: FloatArray, targets: FloatArray) -> FloatArray:
    """W (k, o) with ``W^T A`` nearest to `targets` (o, n), for A (k, n): normal equations, then one refinement.

    The refinement brings back the digits that squaring the condition number cost.
    """
    gram = A @ A.T
    gram.flat[:: len(gram) + 1] += RIDGE * gram.diagonal().mean()
    try:
        factor = cholesky(gram, lower=True)
    except np.linalg.LinAlgError:
        return np.asarray(lstsq(A.T, targets.T)[0])
    W = cho_solve((factor, True), A @ targets.T)
    return np.asarray(W + cho_solve((factor, True), A @ (targets - W.T @ A).T))
