"""Posterior from fewer data than parameters: the matrices have the size of the data.

With normal equations ``G = R^T R`` of rank r, right side ``R^T y`` and priors of standard deviations s, the data alone
have the covariance ``M = I + R S^2 R^T`` (r, r), and parameters follow from it as in a Gaussian process. Parameters
whose priors are wide compared with what the data know (a base, a seat) would spoil the digits of M; they are found by
generalised least squares with M of the others.

Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, section 2.7, eqs. 2.39 to
2.42; the factor, N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., section 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.linalg.lapack import dpstrf

from truearm.solve.square_roots import MIN_PIVOT, ROUNDING, unit_diagonal
from truearm.typing import BoolArray, FloatArray, IntArray

# Largest rank, as a share of the parameters, at which this costs less than the equations of the parameters.
MAX_RANK = 0.4
# Priors are wide if the data know a parameter alone this many times better, as a ratio of variances.
WIDE = 1e4
# A right side must follow from data to this share.
MAX_REMAINDER = 1e-9


@dataclass(frozen=True, eq=False)
class LowRankEquations:
    """Normal equations as the square of a matrix with few rows.

    Attributes
    ----------
    root : (r, p) array
        R with ``R^T R`` the matrix.
    data : (r,) array
        y with ``R^T y`` the right side.
    """

    root: FloatArray
    data: FloatArray

    @classmethod
    def of(cls, gram: FloatArray, right: FloatArray, size: FloatArray) -> LowRankEquations | None:
        """Factorise equations; None if the rank is not low, or if the right side does not follow from data."""
        p = len(gram)
        matrix, scale = unit_diagonal(gram, np.maximum(size, 0))
        factor, pivots, rank, _ = dpstrf(np.asfortranarray(matrix), tol=ROUNDING, overwrite_a=1)
        if not 0 < rank <= MAX_RANK * p:
            return None
        pivots = pivots - 1  # LAPACK counts from 1
        upper = np.triu(factor[:rank])
        root = np.empty((rank, p))
        root[:, pivots] = upper
        data = solve_triangular(upper[:, :rank], (right / scale)[pivots[:rank]], trans="T")
        if np.abs(root.T @ data - right / scale).max() > MAX_REMAINDER * np.abs(right / scale).max():
            return None
        return cls(root * scale, data)

    def solve(self, std: FloatArray) -> LowRankPosterior | None:
        """Posterior with priors of standard deviations `std` (p,); None if rounding spoils it."""
        root = self.root * std
        is_wide = (root**2).sum(axis=0) > WIDE
        narrow, wide = root[:, ~is_wide], root[:, is_wide]
        M = narrow @ narrow.T
        M.flat[:: len(M) + 1] += 1.0
        both = solve_triangular(cholesky(M, lower=True), np.column_stack([root, self.data]), lower=True)
        U, z = both[:, :-1], both[:, -1]
        H = U[:, is_wide].T @ U[:, is_wide]
        H.flat[:: len(H) + 1] += 1.0
        matrix, scale = unit_diagonal(H)
        try:
            lower = cholesky(matrix, lower=True) * scale[:, None] if wide.size else H
        except LinAlgError:
            return None
        if (lower.diagonal() ** 2 < MIN_PIVOT * H.diagonal()).any():
            return None
        return LowRankPosterior(std, is_wide, U, z, lower)


@dataclass(frozen=True, eq=False)
class LowRankPosterior:
    """Posterior of parameters by whitened data.

    Attributes
    ----------
    std : (p,) array
        Of the priors.
    is_wide : (p,) bool array
    columns : (r, p) array
        Whitened columns of the parameters in units of their priors.
    data : (r,) array
        Whitened data.
    lower : (w, w) array
        Cholesky factor of the precision of the wide parameters, in units of their priors.
    """

    std: FloatArray
    is_wide: BoolArray
    columns: FloatArray
    data: FloatArray
    lower: FloatArray

    @cached_property
    def x(self) -> FloatArray:
        """(p,) means."""
        narrow, wide = self.columns[:, ~self.is_wide], self.columns[:, self.is_wide]
        x = np.empty(len(self.std))
        right = solve_triangular(self.lower, wide.T @ self.data, lower=True) if len(self.lower) else np.zeros(0)
        x[self.is_wide] = solve_triangular(self.lower, right, lower=True, trans="T") if len(right) else right
        x[~self.is_wide] = narrow.T @ (self.data - wide @ x[self.is_wide])
        return x * self.std

    @cached_property
    def variance(self) -> FloatArray:
        """(p,) variances."""
        narrow, across, inverse = self._blocks()
        variance = np.empty(len(self.std))
        variance[self.is_wide] = (inverse**2).sum(axis=0)
        variance[~self.is_wide] = 1 - (narrow**2).sum(axis=0) + (across**2).sum(axis=0)
        return np.asarray(np.maximum(variance, 0.0) * self.std**2)

    @cached_property
    def covariance(self) -> FloatArray:
        """(p, p) covariance."""
        narrow, across, inverse = self._blocks()
        found = np.empty((len(self.std),) * 2)
        of_wide, of_narrow = np.flatnonzero(self.is_wide), np.flatnonzero(~self.is_wide)
        found[np.ix_(of_wide, of_wide)] = inverse.T @ inverse
        own = across.T @ across - narrow.T @ narrow
        own.flat[:: len(own) + 1] += 1.0
        found[np.ix_(of_narrow, of_narrow)] = own
        coupled = -across.T @ inverse
        found[np.ix_(of_narrow, of_wide)] = coupled
        found[np.ix_(of_wide, of_narrow)] = coupled.T
        return np.asarray(found * self.std * self.std[:, None])

    def block(self, rows: IntArray) -> FloatArray:
        """(m, m) covariance of some parameters."""
        return np.asarray(self.covariance[np.ix_(rows, rows)])

    def _blocks(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Narrow columns, their products with the wide ones, and the root of the latter's covariance."""
        narrow, wide = self.columns[:, ~self.is_wide], self.columns[:, self.is_wide]
        if not len(self.lower):
            return narrow, np.zeros((0, narrow.shape[1])), np.zeros((0, 0))
        inverse = solve_triangular(self.lower, np.eye(len(self.lower)), lower=True)
        return narrow, inverse @ (wide.T @ narrow), inverse
