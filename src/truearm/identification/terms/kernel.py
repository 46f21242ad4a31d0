"""Basis of a Gaussian process over all joints: covariances with inducing points, made independent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cholesky
from scipy.linalg.blas import dtrsm

from truearm.errors import InputError
from truearm.identification.terms.basis import Basis, register_basis
from truearm.identification.terms.state import ArmState
from truearm.typing import BoolArray, FloatArray

MOST_POINTS = 1000
# Variance of the process at an inducing point, given those before it: less is lost to rounding.
LEAST_PIVOT = 1e-6
ROWS = 512  # rows of a covariance of readings that are in memory together


@register_basis
@dataclass(frozen=True)
class InducedProcess(Basis):
    """A smooth unknown function of all joints: a Gaussian process of variance one, spanned by inducing points.

    The covariance of two poses q and z is the product over the joints of ``exp((cos(q - z) - 1) / l^2)``, which knows
    no turns, or of ``exp(-(q - z)^2 / 2 l^2)`` for a sliding joint. With K that of the inducing points Z among
    themselves and its Cholesky factor L, the functions are ``L^-1 k(Z, q)``, so that coefficients of unit variance give
    the process its covariance at the inducing points. Between them ``1 - |functions|^2`` of its variance is missing
    (`remainder`): to the variance along the term's direction add the prior variance times 1 less the sum of the squares
    of the functions. Source: J. Quinonero-Candela, C. E. Rasmussen, "A unifying view of sparse approximate Gaussian
    process regression", J. Mach. Learn. Res. 6 (2005) 1939, section 6 (FITC); the covariance on the circle: D. J. C.
    MacKay, "Introduction to Gaussian processes", 1998, eq. 47.

    Parameters
    ----------
    angles : tuple of float
        Joint angles of the inducing points [rad, or mm], point by point.
    length_scales : tuple of float
        Of each joint: l [rad, or mm].
    sliding : tuple of int
        The joints that slide, counted from 1.
    """

    angles: tuple[float, ...]
    length_scales: tuple[float, ...]
    sliding: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("angles", "length_scales", "sliding"):
            values = getattr(self, name)
            if not isinstance(values, tuple) or not all(_is_finite(value) for value in values):
                raise InputError(f"expected {name} of a process as finite numbers, got {values!r:.60}")
        if not all(isinstance(joint, int) for joint in self.sliding):
            raise InputError(f"expected whole numbers of sliding joints, got {self.sliding!r:.60}")
        n_joints = len(self.length_scales)
        if not n_joints or min(self.length_scales) <= 0:
            raise InputError(f"expected a length scale above zero for each joint, got {self.length_scales!r:.60}")
        if not self.angles or len(self.angles) % n_joints or len(self.angles) > MOST_POINTS * n_joints:
            raise InputError(
                f"expected 1 to {MOST_POINTS} inducing points of {n_joints} joints each, got {len(self.angles)} angles"
            )
        if any(joint not in range(1, n_joints + 1) for joint in self.sliding):
            raise InputError(f"expected sliding joints from 1 to {n_joints}, got {self.sliding!r:.60}")
        try:
            pivots = self._factor.diagonal()
        except LinAlgError:
            pivots = np.zeros(1)
        if not pivots.min() ** 2 > LEAST_PIVOT / 2:
            raise InputError("two inducing points of a process are the same, or nearly so")

    @property
    def n_functions(self) -> int:
        """Number of functions: one for each inducing point."""
        return len(self.angles) // len(self.length_scales)

    def labels(self) -> tuple[str, ...]:
        """One function for each inducing point."""
        return tuple(f"inducing point {i + 1}" for i in range(self.n_functions))

    def values(self, state: ArmState) -> FloatArray:
        """(n_functions, n) values."""
        if state.angles.shape[1] != len(self.length_scales):
            raise InputError(f"expected {len(self.length_scales)} joints of a process, got {state.angles.shape[1]}")
        across = kernel(self._at_points, self._embedded(state.angles))
        # The transpose is in the order of columns that BLAS solves for in place.
        return np.asarray(dtrsm(1.0, self._factor, across.T, side=1, lower=1, trans_a=1, overwrite_b=1).T)

    @property
    def has_stated_inputs(self) -> bool:
        """False: it is of joint angles."""
        return False

    @property
    def is_approximate(self) -> bool:
        """True."""
        return True

    def remainder(self, state: ArmState) -> FloatArray:
        """(n,) variance of the process that the functions do not span: zero at inducing points, one far from them."""
        return np.asarray(np.maximum(1.0 - (self.values(state) ** 2).sum(axis=0), 0.0))

    def remainder_of_sums(self, state: ArmState, weights: FloatArray) -> FloatArray:
        """(k,) variance of sums, with weights (k, n) of the readings, of what the functions do not span."""
        points, total = self._embedded(state.angles), np.zeros(len(weights))
        for start in range(0, len(points), ROWS):
            rows = slice(start, start + ROWS)
            total += ((weights[:, rows] @ kernel(points[rows], points)) * weights).sum(axis=1)
        spanned = ((weights @ self.values(state).T) ** 2).sum(axis=1)
        return np.asarray(np.maximum(total - spanned, 0.0))

    def _embedded(self, angles: FloatArray) -> FloatArray:
        return embedded(angles, np.array(self.length_scales), self._is_sliding)

    @cached_property
    def _is_sliding(self) -> BoolArray:
        out = np.zeros(len(self.length_scales), dtype=bool)
        out[[joint - 1 for joint in self.sliding]] = True
        return out

    @cached_property
    def _at_points(self) -> FloatArray:
        return self._embedded(np.reshape(self.angles, (-1, len(self.length_scales))))

    @cached_property
    def _factor(self) -> FloatArray:
        """Lower Cholesky factor of the covariance of the process at the inducing points."""
        return np.asarray(cholesky(kernel(self._at_points, self._at_points), lower=True))


def embedded(angles: FloatArray, length_scales: FloatArray, is_sliding: BoolArray) -> FloatArray:
    """(n, d) points in whose Euclidean distance r the covariance is ``exp(-r^2 / 2)``."""
    turning, scales = angles[:, ~is_sliding], length_scales[~is_sliding]
    return np.hstack(
        [np.cos(turning) / scales, np.sin(turning) / scales, angles[:, is_sliding] / length_scales[is_sliding]]
    )


def kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) covariances of embedded points a (n, d) and b (m, d)."""
    square = (2 * a) @ b.T
    np.subtract((a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1), square, out=square)
    return _covariance(square)


def _covariance(square: FloatArray) -> FloatArray:
    """Covariances at squared distances, in their place: of many points pages of new memory take half of the time."""
    np.maximum(square, 0.0, out=square)
    square *= -0.5
    return np.asarray(np.exp(square, out=square))


def inducing_points(points: FloatArray, most: int) -> list[int]:
    """Rows of embedded points (n, d) that leave the least variance of the process at the others: pivoted Cholesky.

    Each next one is where the most variance is left, so they are far from one another (S. Fine, K. Scheinberg, J. Mach.
    Learn. Res. 2 (2001) 243).
    """
    left, factor, chosen = np.ones(len(points)), np.zeros((min(most, len(points)), len(points))), []
    squares = (points**2).sum(axis=1)
    for k in range(len(factor)):
        row = int(left.argmax())
        if left[row] < LEAST_PIVOT:
            break
        chosen.append(row)
        across = _covariance(squares + (squares[row] - points @ (2 * points[row])))
        factor[k] = (across - factor[:k, row] @ factor[:k]) / math.sqrt(left[row])
        left = np.maximum(left - factor[k] ** 2, 0.0)
        left[row] = 0.0
    return chosen


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
