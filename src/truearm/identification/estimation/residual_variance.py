"""Residual variance: the part of the residuals that neither the terms nor the uncertainty of the references explain.

Three estimates of it. The noise of one kind of reference, by moments (R. C. Paule, J. Mandel), with Huber's weights for
outliers, while terms are identified. The residual variance of a model, such that its stated uncertainty covers the
share of held-out readings that it should. A variance function of the joint angles: an arm is less repeatable, and its
terms describe it less well, in some poses than in others. With z the angles about their mean in units of their scatter,
a coordinate's residual variance is that of all readings times the share

    exp(sum_j b_j z_j + c_j (z_j^2 - 1)) / its mean over the readings,

a log-linear variance function (R. J. Carroll, D. Ruppert, "Transformation and Weighting in Regression", 1988, chapter
3) estimated from held-out readings. Evidence gives the size of its coefficients (D. J. C. MacKay, Neural Computation 4
(1992) 415, eq. 4.8): where readings do not show a dependence on the angles, the function is flat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.identification.estimation.extrapolation import Extrapolation
from truearm.solve.distributions import (
    chi2_probability,
    chi2_probability_beyond,
    chi2_quantile,
    chi2_quantile_beyond,
    f_quantile,
)
from truearm.typing import BoolArray, FloatArray, IntArray

# Residual vectors longer than this many standard deviations get less weight: one Gaussian vector in 900.
HUBER_STDS = 4.0
# The same share of Gaussian readings gets less weight, whatever their number of residuals.
SHARE_BEYOND = chi2_probability_beyond(HUBER_STDS**2, 3)
# A nanometre squared; it keeps weights finite where the data are exact.
FLOOR_MM2 = 1e-12


@cache
def huber_threshold_squared(k: int) -> float:
    """Squared whitened length of k residuals above which a reading gets less weight."""
    return chi2_quantile_beyond(SHARE_BEYOND, k)


@cache
def expected_clipped_square(k: int) -> float:
    """Mean squared length of k Gaussian residuals, clipped at that threshold: slightly below k."""
    cut = huber_threshold_squared(k)
    return k * chi2_probability(cut, k + 2) + cut * chi2_probability_beyond(cut, k)


def huber_weights(residuals: FloatArray, variance: FloatArray) -> FloatArray:
    """Huber's weights on the length of whitened residuals: 1 up to a threshold, then falling as one over the length.

    Source: P. J. Huber, Ann. Math. Stat. 35 (1964) 73.

    Parameters
    ----------
    residuals, variance : (n, k) array
        [mm], [mm^2].

    Returns
    -------
    (n,) array
    """
    lengths = np.sqrt((residuals**2 / variance).sum(axis=1))
    cut = np.sqrt(huber_threshold_squared(residuals.shape[1]))
    return np.asarray(cut / np.maximum(lengths, cut))


def paule_mandel_variance(
    residuals: FloatArray, reference_variance: FloatArray, *, n_effective: float, robust: bool
) -> float:
    """The variance v of a residual that gives whitened residuals the expected size.

    Solves ``sum |r|^2 / (s^2 + v) = k n - n_effective``, whose left side falls with v: a moment estimator, equal to
    maximum likelihood where all s are equal (R. C. Paule, J. Mandel, "Consensus values and weighting factors", J. Res.
    Natl. Bur. Stand. 87 (1982) 377). The robust estimator clips squared lengths, as in `huber_weights`, and their
    expectation (Huber's proposal 2), so that gross errors hardly raise v.

    Parameters
    ----------
    residuals : (n, k) array
        [mm].
    reference_variance : (n, k) array
        Of the references, s^2 [mm^2].
    n_effective : float
        Number of parameters that the residuals, rather than priors, determine.
    robust : bool
        Whether the residuals may contain gross errors.

    Returns
    -------
    float
        [mm^2]; a nanometre squared where the uncertainties of the references explain the residuals.
    """
    from scipy.optimize import brentq

    n, k = residuals.shape
    squares, known = (np.ascontiguousarray(part.T) for part in (residuals**2, reference_variance))
    per_reading = expected_clipped_square(k) if robust else float(k)
    # With as many parameters as data no freedom remains to estimate the noise: use a thousandth instead.
    freedom: float = max(per_reading * n - n_effective, 1e-3 * n)
    most = huber_threshold_squared(k) if robust else np.inf

    def excess(log_v: float) -> float:
        lengths_squared = (squares / (known + np.exp(log_v))).sum(axis=0)
        return float(np.minimum(lengths_squared, most).sum()) - freedom

    lowest, highest = np.log(FLOOR_MM2), np.log(1.01 * squares.sum() / freedom + 2 * FLOOR_MM2)
    if excess(lowest) <= 0:
        return FLOOR_MM2
    return float(np.exp(brentq(excess, lowest, highest, xtol=1e-6)))


LEVEL = 0.95
# With fewer the factor says more of the prior of the scale than of the readings: it would exceed 2.
LEAST_FREEDOM = 10.0
# Readings whose prediction from the others has a variance above this multiple of their own say nothing about it.
MAX_VARIANCE_RATIO = 100.0


@dataclass(frozen=True, eq=False)
class HeldOutReadings:
    """Deviations of readings from models that were identified without them.

    Attributes
    ----------
    rows : (m,) int array
        The readings.
    group : (m,) int array
        Readings with the same number were held out together: a position, a seat.
    deviations : (m, k) array
        Three coordinates: predicted less reference point; for a seat, less its position by the readings of other groups
        or, without such readings, less the mean of the points predicted in it. One: predicted less stated distance
        [mm].
    covariance : (m, k, k) array
        Of the deviations, by the uncertainty of the parameters and of the reference [mm^2].
    freedom : (m,) array
        Share of a reading's own variance in its deviation: 1, or 1 - 1/n for n readings about their own mean.
    """

    rows: IntArray
    group: IntArray
    deviations: FloatArray
    covariance: FloatArray
    freedom: FloatArray

    def select_informative(self, own_mm2: FloatArray) -> HeldOutReadings:
        """Select the readings that are informative about their own variance: the other groups predict them well.

        Where the other groups leave a direction open, for example the frame of a session, the covariance is that of the
        prior, and any reading lies within it; such a reading must not count as covered.

        Parameters
        ----------
        own_mm2 : (m,) array
            Approximate variance of a coordinate of each reading [mm^2].
        """
        return self.select(self.along_axes[0].max(axis=0) <= MAX_VARIANCE_RATIO * own_mm2)

    def select(self, which: BoolArray | IntArray) -> HeldOutReadings:
        """Some of the readings, by a mask (m,) or by their numbers among them."""
        new = HeldOutReadings(*(getattr(self, part.name)[which] for part in fields(self)))
        if (known := vars(self).get("along_axes")) is not None:
            vars(new)["along_axes"] = tuple(np.ascontiguousarray(part[:, which]) for part in known)
        return new

    def scaled(self, *, covariance: float = 1.0, freedom: FloatArray | float = 1.0) -> HeldOutReadings:
        """The same with all covariances, and the shares of own variances, times a factor."""
        new = replace(self, covariance=covariance * self.covariance, freedom=freedom * self.freedom)
        variances, squares = self.along_axes
        vars(new)["along_axes"] = covariance * variances, squares
        return new

    def and_also(self, others: HeldOutReadings) -> HeldOutReadings:
        """These readings and others."""
        if not len(others.rows):
            return self
        names = [part.name for part in fields(self)]
        return HeldOutReadings(*(np.concatenate([getattr(self, name), getattr(others, name)]) for name in names))

    @property
    def n_coordinates(self) -> int:
        """Number k of coordinates that are compared: 3 of points, 1 of distances."""
        return int(self.deviations.shape[1])

    @cached_property
    def along_axes(self) -> tuple[FloatArray, FloatArray]:
        """Variances (k, m) along the principal axes of the covariances, and squared deviations there [mm^2]."""
        known, axes = np.linalg.eigh(self.covariance)
        squares = np.einsum("nij,ni->jn", axes, self.deviations) ** 2
        return np.ascontiguousarray(np.maximum(known, 0.0).T), squares

    @property
    def errors_mm(self) -> FloatArray:
        """(m,) lengths of the deviations, scaled for those about the own mean of a seat [mm]."""
        return np.asarray(np.linalg.norm(self.deviations, axis=1) / np.sqrt(self.freedom))

    @property
    def mean_mm(self) -> float:
        """Mean error [mm]."""
        return float(self.errors_mm.mean())

    @property
    def standard_error_mm(self) -> float:
        """Standard error of the mean, from the scatter between groups [mm]."""
        errors = self.errors_mm
        group = np.unique(self.group, return_inverse=True)[1]
        counts = np.bincount(group)
        sums = np.bincount(group, errors)
        if len(counts) < 2:  # one group only: use the scatter of the readings
            return float(errors.std(ddof=1) / np.sqrt(len(errors))) if len(errors) > 1 else float("inf")
        scatter = sums - counts * self.mean_mm
        return float(np.sqrt((scatter**2).sum() * len(counts) / (len(counts) - 1)) / counts.sum())


NONE_HELD_OUT = HeldOutReadings(
    np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
)


def conformal_residual_variance(held_out: HeldOutReadings, *, level: float = LEVEL) -> float:
    """The variance v of a coordinate for which ellipsoids cover a share `level` of the held-out readings.

    With v added to their covariances, the quantile of the squared Mahalanobis length is that of as many Gaussian
    coordinates as are compared. The order statistic is that of conformal prediction, number ``ceil((m + 1) level)`` of
    m, so that a new reading is covered with at least that probability if readings are exchangeable (V. Vovk,
    A. Gammerman, G. Shafer, "Algorithmic Learning in a Random World", 2005, section 2.2).

    Returns
    -------
    float
        [mm^2].
    """
    from scipy.optimize import brentq

    m = len(held_out.rows)
    known, squares = held_out.along_axes
    rank = min(int(np.ceil((m + 1) * level)), m) - 1
    radius = chi2_quantile(level, held_out.n_coordinates)

    def excess(log_v: float) -> float:
        variance = known + np.exp(log_v) * held_out.freedom
        return float(np.partition((squares / variance).sum(axis=0), rank)[rank]) - radius

    lowest = float(np.log(FLOOR_MM2))
    highest = float(np.log(squares.sum(axis=0).max() / held_out.freedom.min() + 2 * FLOOR_MM2))
    if excess(lowest) <= 0:
        return FLOOR_MM2
    return float(np.exp(brentq(excess, lowest, highest, xtol=1e-6)))


def few_readings_factor(freedom: float) -> float:
    """Factor on a covariance whose common scale was estimated with few degrees of freedom.

    With n degrees of freedom a point lies in the ellipsoid of ``3 F(LEVEL; 3, n)`` with probability `LEVEL`, where
    ``chi2(LEVEL; 3)`` would hold it if the scale were known (H. Hotelling, Ann. Math. Stat. 2 (1931) 360; for a
    coordinate JCGM 100:2008, G.3.3). The covariance times the ratio of both keeps the usual coverage factors.

    Parameters
    ----------
    freedom : float
        Number of residuals less that of the parameters that they determine; at least `LEAST_FREEDOM` are assumed.
    """
    return 3 * f_quantile(LEVEL, 3, max(freedom, LEAST_FREEDOM)) / chi2_quantile(LEVEL, 3)


# Prior standard deviation of a coefficient: start value of the evidence and its bounds. It is the relative change of
# the variance over a standard deviation of a joint; at the lower bound the function is flat.
COEFFICIENT_STD, LEAST_STD, MOST_STD = 0.2, 1e-3, 0.5
MOST_ROUNDS = 30
SETTLED = 0.02  # relative change of the prior's precision
# Angles are clipped at this distance from their mean: common poses say nothing about the variance at rare ones.
FARTHEST = 2.0
# Above this many standard deviations of a joint from the mean, shares below one are not trusted: no readings are there.
BEYOND = 3.0
# Degrees of freedom of Student's distribution of the deviations: a few wrong readings do not distort the function.
STUDENT_FREEDOM = 6.0
# With fewer held-out groups per coefficient the function is flat, as chance might look like a dependence.
LEAST_GROUPS = 5
# Estimated coefficients are far below this bound; a larger one in a file is an error.
STEEPEST = 10.0
# Maximum steps of the scoring, of which it needs about five, and halvings of one; it ends where a step would lower the
# deviance by less than this.
MOST_STEPS, MAX_HALVINGS, LEAST_FALL = 50, 10, 1e-7
# A joint whose angles scatter by less did not move [rad, or mm].
LEAST_SCATTER = 1e-6


@dataclass(frozen=True, eq=False)
class VarianceFunction:
    """The share of the residual variance at given angles, 1 on average over the readings of its estimation.

    Parameters
    ----------
    centre, spread : (n_joints,) array
        Mean and standard deviation of the angles [rad, or mm].
    slope, curvature : (n_joints,) array
        Of the logarithm, by the angles in units of `spread`.
    mean : float
        Of the exponential over the readings.
    beyond : Extrapolation, optional
        Its growth outside the range of the readings; None in files of models that were trained before it was kept.
    """

    centre: FloatArray
    spread: FloatArray
    slope: FloatArray
    curvature: FloatArray
    mean: float = 1.0
    beyond: Extrapolation | None = None

    def __post_init__(self) -> None:
        arrays = (self.centre, self.spread, self.slope, self.curvature)
        shapes = {np.shape(array) for array in arrays}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1 or not np.isfinite(np.stack(arrays)).all():
            raise InputError(f"expected four finite numbers for each joint of a variance function, got shapes {shapes}")
        if max(np.abs(self.slope).max(), np.abs(self.curvature).max()) > STEEPEST:
            raise InputError(f"expected slopes and curvatures of a variance function within {STEEPEST:g}")
        if not (self.spread > 0).all() or not 0 < self.mean < np.inf:
            raise InputError("expected a positive spread of every joint and a positive mean of a variance function")

    @classmethod
    def flat(cls, n_joints: int) -> Self:
        """A share of 1 everywhere."""
        zeros = np.zeros(n_joints)
        return cls(zeros, np.ones(n_joints), zeros, zeros)

    @cached_property
    def _coefficients(self) -> FloatArray:
        return np.concatenate([self.slope, self.curvature])

    def share(self, angles: npt.ArrayLike) -> FloatArray:
        """(n,) shares at angles (n, n_joints) [rad, or mm]; at least 1 far from the readings of the estimation."""
        angles = np.asarray(angles, dtype=float)
        counted = angles if self.beyond is None else self.beyond.counted_near(angles)
        z = (counted - self.centre) / self.spread
        share = np.exp(_features(z) @ self._coefficients) / self.mean
        share = np.maximum(share, (np.abs(z) > BEYOND).any(axis=1))
        return np.asarray(share if self.beyond is None else share * self.beyond.factor(angles))


def fit_variance_function(held_out: HeldOutReadings, angles: FloatArray) -> VarianceFunction:
    """Estimate how the scatter of held-out readings, beyond their covariances, depends on the angles.

    Parameters
    ----------
    held_out : HeldOutReadings
    angles : (n, n_joints) array
        Of all readings [rad, or mm].

    Returns
    -------
    VarianceFunction
        Flat if too few groups were held out.
    """
    n_joints = angles.shape[1]
    if len(np.unique(held_out.group)) < LEAST_GROUPS * 2 * n_joints:
        return VarianceFunction.flat(n_joints)
    at = angles[held_out.rows]
    centre, scatter = at.mean(axis=0), at.std(axis=0)
    spread = np.where(scatter > LEAST_SCATTER, scatter, 1.0)
    features = _features((at - centre) / spread)
    features[:, np.tile(scatter <= LEAST_SCATTER, 2)] = 0.0
    deviance = _posterior(held_out, features)
    x, precision = np.zeros(1 + 2 * n_joints), COEFFICIENT_STD**-2
    for _ in range(MOST_ROUNDS):
        x, information = _least(deviance, x, precision)
        determined = np.clip(1 - precision * np.linalg.inv(information).diagonal()[1:], 0.0, 1.0).sum()
        before, square = precision, float(x[1:] @ x[1:])
        precision = float(np.clip(determined / max(square, 1e-300), MOST_STD**-2, LEAST_STD**-2))
        if abs(precision - before) < SETTLED * before:
            break
    coefficients = x[1:]
    mean = float(np.exp(features @ coefficients).mean())
    return VarianceFunction(centre, spread, coefficients[:n_joints], coefficients[n_joints:], mean)


def _features(z: FloatArray) -> FloatArray:
    z = np.minimum(np.maximum(z, -FARTHEST), FARTHEST)
    return np.concatenate([z, z**2 - 1], axis=1)


def _least(
    deviance: Callable[[FloatArray, float], tuple[float, FloatArray, FloatArray]], x: FloatArray, precision: float
) -> tuple[FloatArray, FloatArray]:
    """The parameters of least deviance, by Fisher's scoring from `x`, and the information there."""
    value, gradient, information = deviance(x, precision)
    for _ in range(MOST_STEPS):
        step = -np.linalg.solve(information, gradient)
        if -gradient @ step < LEAST_FALL:
            break
        for _ in range(MAX_HALVINGS):
            trial = deviance(x + step, precision)
            if trial[0] < value:
                break
            step /= 2
        else:
            break
        x, (value, gradient, information) = x + step, trial
    return x, information


def _posterior(
    held_out: HeldOutReadings, features: FloatArray
) -> Callable[[FloatArray, float], tuple[float, FloatArray, FloatArray]]:
    """The deviance, minus the logarithm of the posterior, by the parameters and the prior's precision.

    With its gradient and its expected information. The parameters are the variance's logarithm and the coefficients.
    Readings of a group have common errors and count together as one.
    """
    known, squares = held_out.along_axes
    n, k = STUDENT_FREEDOM, len(squares)
    typical = max(float(np.median(squares.sum(axis=0) / held_out.freedom)) / k, FLOOR_MM2)
    weight = len(np.unique(held_out.group)) / len(held_out.rows)
    design, own_typical = np.vstack([np.ones(len(features)), features.T]), typical * held_out.freedom

    @cache  # the last of one precision of the prior is the first of the next
    def by_readings(parameters: tuple[float, ...]) -> tuple[float, FloatArray, FloatArray]:
        own = own_typical * np.exp(np.clip(parameters @ design, -50.0, 50.0))
        variance = known + own
        parts, share = squares / variance, own / variance
        length = parts.sum(axis=0)
        value = 0.5 * np.log(variance.prod(axis=0)).sum() + 0.5 * (n + k) * np.log(1 + length / n).sum()
        pull = (n + k) / (n + length)
        by_log = 0.5 * (share.sum(axis=0) - pull * np.einsum("km,km->m", share, parts))
        # By the expected information of Student's log scale: for p coordinates and n degrees of freedom it is
        # p n / 2 (n + p + 2) (K. L. Lange, R. J. A. Little, J. M. G. Taylor, J. Am. Stat. Assoc. 84 (1989) 881,
        # section 4); f^2 times as much where the scale is a share f of the variance.
        each = np.sqrt(0.5 * weight * n / (n + k + 2) * np.einsum("km,km->m", share, share)) * design
        information = each @ each.T
        information[0, 0] += 1e-12  # in case the covariances explain all deviations
        return float(weight * value), weight * (design @ by_log), information

    def deviance(parameters: FloatArray, precision: float) -> tuple[float, FloatArray, FloatArray]:
        value, gradient, information = by_readings(tuple(parameters.tolist()))
        precisions = np.full(len(parameters), precision)
        precisions[0] = 0.0
        prior = precisions * parameters
        return value + 0.5 * float(parameters @ prior), gradient + prior, information + np.diag(precisions)

    return deviance
