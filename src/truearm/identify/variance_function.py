"""Where in the joint space an arm errs more than elsewhere: what its model cannot explain, as a function of the angles.

An arm is less repeatable, and its terms describe it less well, in some poses than in others. With z the angles in
units of their scatter about their mean, a coordinate's unexplained variance is that of all readings times the share

    exp(sum_j b_j z_j + c_j (z_j^2 - 1)) / its mean over the readings,

a log-linear variance function (R. J. Carroll, D. Ruppert, "Transformation and Weighting in Regression", 1988, chapter
3), found from readings held out. Its coefficients are shrunk, so that few readings leave it flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from truearm.errors import InputError
from truearm.identify.calibration import FLOOR_MM2, HeldOut

FloatArray = npt.NDArray[np.float64]

# Prior standard deviation of a coefficient: a joint makes out a fifth of the variance a standard deviation of it.
COEFFICIENT_STD = 0.18
# Angles count as if they were no farther from their mean: the shares of rare poses are not told by common ones.
FARTHEST = 2.0
# Deviations are Student's of so many degrees of freedom, so that a few wrong readings do not bend the function.
STUDENT_FREEDOM = 6.0
# Steps of L-BFGS-B; it needs about twenty.
MOST_STEPS = 200
# A joint whose angles scatter by less stood still [rad, or mm].
LEAST_SCATTER = 1e-6


@dataclass(frozen=True, eq=False)
class VarianceFunction:
    """The share of the unexplained variance that angles have, 1 on average over the readings it was found from.

    Parameters
    ----------
    centre, spread : (n_joints,) array
        Mean and standard deviation of the angles [rad, or mm].
    slope, curvature : (n_joints,) array
        Of the logarithm, by the angles in units of `spread`.
    mean : float
        Of the exponential over the readings.
    """

    centre: FloatArray
    spread: FloatArray
    slope: FloatArray
    curvature: FloatArray
    mean: float = 1.0

    def __post_init__(self) -> None:
        arrays = (self.centre, self.spread, self.slope, self.curvature)
        shapes = {np.shape(array) for array in arrays}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1 or not np.isfinite(np.stack(arrays)).all():
            raise InputError(f"expected four finite numbers a joint of a variance function, got shapes {shapes}")
        if not (self.spread > 0).all() or not 0 < self.mean < np.inf:
            raise InputError("expected a positive spread of every joint and a positive mean of a variance function")

    @classmethod
    def flat(cls, n_joints: int) -> Self:
        """The same everywhere."""
        zeros = np.zeros(n_joints)
        return cls(zeros, np.ones(n_joints), zeros, zeros)

    def share(self, angles: npt.ArrayLike) -> FloatArray:
        """(n,) shares at angles (n, n_joints) [rad, or mm]."""
        features = _features(np.asarray(angles, dtype=float), self.centre, self.spread)
        return np.asarray(np.exp(features @ np.concatenate([self.slope, self.curvature])) / self.mean)


def variance_function_of(held_out: HeldOut, angles: FloatArray) -> VarianceFunction:
    """Find where readings held out scatter more, beyond what their covariances make expected.

    Parameters
    ----------
    held_out : HeldOut
    angles : (n, n_joints) array
        Of all readings [rad, or mm].

    Returns
    -------
    VarianceFunction
        Flat where nothing was held out.
    """
    n_joints = angles.shape[1]
    if not len(held_out.rows):
        return VarianceFunction.flat(n_joints)
    at = angles[held_out.rows]
    centre, scatter = at.mean(axis=0), at.std(axis=0)
    spread = np.where(scatter > LEAST_SCATTER, scatter, 1.0)
    features = _features(at, centre, spread)
    features[:, np.tile(scatter <= LEAST_SCATTER, 2)] = 0.0
    found = minimize(
        _Deviance.of(held_out, features),
        np.zeros(1 + 2 * n_joints),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": MOST_STEPS},
    ).x[1:]
    mean = float(np.exp(features @ found).mean())
    return VarianceFunction(centre, spread, found[:n_joints], found[n_joints:], mean)


def _features(angles: FloatArray, centre: FloatArray, spread: FloatArray) -> FloatArray:
    z = np.clip((angles - centre) / spread, -FARTHEST, FARTHEST)
    return np.hstack([z, z**2 - 1])


@dataclass(frozen=True, eq=False)
class _Deviance:
    """Negative logarithm of the posterior, by the variance's logarithm and the coefficients, with its gradient.

    Deviations stand along the axes of their covariances: `known` (m, 3) are the variances there, `squares` (m, 3) the
    deviations squared. Readings of a group err alike and count together as one.
    """

    squares: FloatArray
    known: FloatArray
    freedom: FloatArray
    features: FloatArray
    typical: float
    weight: float

    @classmethod
    def of(cls, held_out: HeldOut, features: FloatArray) -> Self:
        """Of readings held out."""
        known, axes = np.linalg.eigh(held_out.covariance)
        squares = np.einsum("nij,ni->nj", axes, held_out.deviations) ** 2
        typical = max(float(np.median(squares.sum(axis=1) / held_out.freedom)) / 3, FLOOR_MM2)
        weight = len(np.unique(held_out.group)) / len(held_out.rows)
        return cls(squares, np.maximum(known, 0.0), held_out.freedom[:, None], features, typical, weight)

    def __call__(self, parameters: FloatArray) -> tuple[float, FloatArray]:
        """Value and gradient."""
        level, coefficients = parameters[0], parameters[1:]
        log_share = np.clip(level + self.features @ coefficients, -50.0, 50.0)
        own = self.typical * np.exp(log_share)[:, None] * self.freedom
        variance = self.known + own
        n = STUDENT_FREEDOM
        length = (self.squares / variance).sum(axis=1)
        value = 0.5 * np.log(variance).sum() + 0.5 * (n + 3) * np.log1p(length / n).sum()
        pull = ((n + 3) / (n + length))[:, None]
        by_log = (0.5 * own / variance * (1 - pull * self.squares / variance)).sum(axis=1)
        prior = coefficients / COEFFICIENT_STD**2
        gradient = np.concatenate([[by_log.sum()], self.features.T @ by_log]) * self.weight
        gradient[1:] += prior
        return float(self.weight * value + 0.5 * coefficients @ prior), gradient
