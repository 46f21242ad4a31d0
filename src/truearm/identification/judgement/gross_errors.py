"""Gross errors: readings that belong to no distribution of honest errors, found by what is held out.

A reading of high leverage draws the arm to itself: its residual is small, and no weight by residuals names it. Its
deviation from an arm identified without it is as large as its error. These deviations are described as a mixture: a
share p of gross errors whose size is unknown by decades, and honest ones of Student's distribution with a scale and
nu degrees of freedom. The three numbers are those of the largest posterior density; a reading is gross if it is more
probably so than not. The limit thus follows from the readings themselves: 5.5 standard deviations where honest errors
are Gaussian, some twenty where they have tails as those of a geared robot do.

Rounds of fitting and judging decide which readings take part; a reading may come back. Sources: a share of gross
errors, G. E. P. Box, G. C. Tiao, "A Bayesian approach to some outlier problems", Biometrika 55 (1968) 119; a mixture by
maximum likelihood, M. Aitkin, G. T. Wilson, "Mixture models, outliers, and the EM algorithm", Technometrics 22 (1980)
325; Student's distribution, K. L. Lange, R. J. A. Little, J. M. G. Taylor, J. Am. Stat. Assoc. 84 (1989) 881.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import digamma, expit, gammaln

from truearm.identification.estimation.identification import select_evenly
from truearm.identification.estimation.identification_result import IdentificationResult, ReferenceFit
from truearm.identification.estimation.residual_variance import FLOOR_MM2, HeldOutReadings
from truearm.identification.judgement.tails import FREEDOM_RATE, FREEDOM_SHAPE
from truearm.solve.distributions import chi2_quantile
from truearm.typing import FloatArray, IntArray

# Bounds of the share of gross errors: one in a thousand is expected before anything is known; where four in ten are
# wrong, no reading is known to be right.
LEAST_SHARE, MOST_SHARE = 1e-3, 0.4
# Bounds of the degrees of freedom: real arms have more than three; above a thousand the distribution is Gaussian.
LEAST_FREEDOM, MOST_FREEDOM = 3.0, 1e3
# Degrees of freedom and share to start from: a far reading may be a gross error or show a tail, and both be maxima.
STARTS = ((30.0, 0.02), (30.0, 0.2), (5.0, LEAST_SHARE))
# Units of the minimiser's numbers, log variance, one over the degrees of freedom and log share, in which the density is
# about as wide along each: a third fewer steps, and no leap to a variance of zero.
UNITS = np.array([0.1, 0.01, 0.3])
# Of more readings so many, evenly spaced, show which maximum is the largest, and it is near.
MOST_STARTED = 4000
# Gross errors begin at this many standard deviations, and have any size up to this many decades above.
LEAST_GROSS_STDS, DECADES = 4.0, 4.0
# Measure of the unit sphere in k dimensions: two ends, a circle, or a surface.
UNIT_SPHERE = {1: 2.0, 2: 2 * np.pi, 3: 4 * np.pi}
# With fewer held-out readings no reading is judged: their distribution is unknown.
LEAST_READINGS = 12
# With fewer degrees of freedom, many gross errors of one size may look like tails. Student's weights then move the arm
# to the majority, once, and show them.
HEAVY_TAILS = 3.5
# Maximum fits to find the set of gross errors, beside the one with Student's weights; two find it, as a rule.
MAX_FITS = 4


@dataclass(frozen=True)
class ErrorDistribution:
    """Distribution of the deviations of held-out readings.

    Attributes
    ----------
    variance : float
        Squared scale of the honest deviations of a coordinate, beyond their covariances [mm^2].
    freedom : float
        Degrees of freedom of Student's distribution of the honest deviations.
    gross_share : float
        Share of gross errors.
    """

    variance: float
    freedom: float
    gross_share: float

    def gross_probability(self, held_out: HeldOutReadings) -> FloatArray:
        """(m,) probability of each reading to be a gross error."""
        honest, gross = _densities(*held_out.along_axes, held_out.freedom, self).logs
        return np.asarray(expit(gross - honest))

    def student_weights(self, held_out: HeldOutReadings) -> FloatArray:
        """(m,) weights from 0 to 1 by which readings of this distribution are averaged best.

        (nu + k) / (nu + t^2) of the squared whitened length t^2 of k coordinates, at most 1; times the probability to
        be honest.
        """
        known, squares = held_out.along_axes
        t2 = (squares / (known + self.variance * held_out.freedom)).sum(axis=0)
        weights = np.minimum((self.freedom + len(squares)) / (self.freedom + t2), 1.0)
        return np.asarray(weights * (1 - self.gross_probability(held_out)))


HONEST = ErrorDistribution(1.0, MOST_FREEDOM, LEAST_SHARE)


def fit_error_distribution(held_out: HeldOutReadings) -> ErrorDistribution:
    """Estimate the distribution of held-out deviations: the maximum of the posterior density of its three numbers.

    Parameters
    ----------
    held_out : HeldOutReadings
        Of one reading or more.

    Returns
    -------
    ErrorDistribution
    """
    from scipy.optimize import minimize

    known, squares = held_out.along_axes
    typical = _typical_variance(held_out)

    def distribution(x: FloatArray) -> ErrorDistribution:
        log_variance, inverse, log_share = (x * UNITS).tolist()
        return ErrorDistribution(float(np.exp(log_variance)), 1 / inverse, float(np.exp(log_share)))

    def deviance(x: FloatArray) -> tuple[float, FloatArray]:
        value, slope = _deviance(known, squares, held_out.freedom, distribution(x))
        return value, slope * UNITS

    lowest = np.array([np.log(FLOOR_MM2), 1 / MOST_FREEDOM, np.log(LEAST_SHARE)]) / UNITS
    highest = np.array([np.log(typical) + 5, 1 / LEAST_FREEDOM, np.log(MOST_SHARE)]) / UNITS
    bounds = list(zip(lowest, highest, strict=True))
    numbers = [(typical, freedom, share) for freedom, share in STARTS]
    if len(held_out.rows) > MOST_STARTED:
        near = fit_error_distribution(held_out.select(select_evenly(np.arange(len(held_out.rows)), MOST_STARTED)))
        numbers = [(near.variance, near.freedom, near.gross_share)]
    starts = [np.array([np.log(variance), 1 / freedom, np.log(share)]) / UNITS for variance, freedom, share in numbers]
    ends = [minimize(deviance, start, jac=True, method="L-BFGS-B", bounds=bounds) for start in starts]
    return distribution(min(ends, key=lambda end: float(end.fun)).x)


def _deviance(
    known: FloatArray, squares: FloatArray, freedom: FloatArray, of: ErrorDistribution
) -> tuple[float, FloatArray]:
    """Minus the logarithm of the posterior density, and its derivatives by the minimiser's numbers.

    These are the logarithm of the variance, one over the degrees of freedom and the logarithm of the share.
    """
    nu, share, k = of.freedom, of.gross_share, len(squares)
    (honest, gross), variance, parts, t2, power, log_tail = _densities(known, squares, freedom, of)
    of_gross = expit(gross - honest)
    of_honest = 1 - of_gross
    relative = of.variance * freedom / variance  # of the logarithm of each axis' variance by that of the scale
    t2_slope, half_slope = -np.einsum("km,km->m", parts, relative), 0.5 * relative.sum(axis=0)
    # By the logarithm of t^2, whose power of one coordinate has no slope at zero.
    log_slope = np.divide(t2_slope, t2, out=np.zeros_like(t2), where=t2 > 0)
    inside = of_honest * (nu + k) * t2 / (nu + t2)
    of_length = inside + of_gross * k * power / (LEAST_GROSS_STDS**k + power)
    by_variance = float(-0.5 * of_length @ log_slope - half_slope.sum())
    norm_slope = 0.5 * (digamma((nu + k) / 2) - digamma(nu / 2)) - k / (2 * nu)
    by_freedom = float(of_honest @ (norm_slope - 0.5 * log_tail)) + 0.5 * float(inside.sum()) / nu
    by_freedom += FREEDOM_SHAPE / nu - FREEDOM_RATE
    by_share = float(of_gross.sum() - of_honest.sum() * share / (1 - share))
    prior = FREEDOM_SHAPE * np.log(nu) - FREEDOM_RATE * nu  # of the logarithm
    density = float(np.logaddexp(honest, gross).sum() + prior)
    return -density, np.array([-by_variance, by_freedom * nu**2, -by_share])


def _typical_variance(held_out: HeldOutReadings) -> float:
    """Variance of a coordinate from the median deviation, which stands half of the readings being wrong [mm^2]."""
    squares = (held_out.deviations**2).sum(axis=1) / held_out.freedom
    return max(float(np.median(squares)) / chi2_quantile(0.5, held_out.n_coordinates), FLOOR_MM2)


class _Densities(NamedTuple):
    """Logarithms of share times density, honest and gross, both without the common Jacobian of the whitening.

    And what they are of: variances (k, m) of the axes, squares in their units and the sum t^2, |t|^k and the logarithm
    of 1 + t^2 / nu.
    """

    logs: tuple[FloatArray, FloatArray]
    variance: FloatArray
    parts: FloatArray
    t2: FloatArray
    power: FloatArray
    log_tail: FloatArray


def _densities(known: FloatArray, squares: FloatArray, freedom: FloatArray, of: ErrorDistribution) -> _Densities:
    """Densities of deviations with squares (k, m) along axes, of known variances (k, m) beside the scale's."""
    variance, nu, k = known + of.variance * freedom, of.freedom, len(squares)
    parts = squares / variance
    t2 = parts.sum(axis=0)
    power = t2 ** (k // 2) * np.sqrt(t2) ** (k % 2)  # a tenth of the time of a power that is no whole number
    log_tail, half_log_det = np.log(1 + t2 / nu), 0.5 * np.log(variance.prod(axis=0))
    norm = gammaln((nu + k) / 2) - gammaln(nu / 2) - k / 2 * np.log(nu * np.pi) + np.log1p(-of.gross_share)
    honest = norm - 0.5 * (nu + k) * log_tail - half_log_det
    # A density 1/t of the length, between the first gross errors and the largest; smooth below these.
    decades = np.log(UNIT_SPHERE[k] * DECADES * np.log(10.0))
    gross = np.log(of.gross_share) - decades - np.log(LEAST_GROSS_STDS**k + power) - half_log_det
    return _Densities((honest, gross), variance, parts, t2, power, log_tail)


def identify_without_gross_errors(
    identify: Callable[[FloatArray, IdentificationResult | None], IdentificationResult],
    cross_validate: Callable[[IdentificationResult], HeldOutReadings],
    weights: FloatArray,
) -> tuple[IdentificationResult, HeldOutReadings]:
    """Identify an arm from the readings that are no gross errors of it.

    Parameters
    ----------
    identify : callable
        Returns the identification with weights (n,) of the readings: 0 excludes one. The second argument is that of
        the round before, from which one that excludes a few readings more or less is a step or two away.
    cross_validate : callable
        Returns the held-out readings of an identification, excluded ones among them.
    weights : (n,) array
        To start from, by a simpler model or all 1.

    Returns
    -------
    fit : IdentificationResult
        Excluded readings have a robust weight of 0.
    held_out : HeldOutReadings
        Of it, with the excluded readings.
    """
    tried: dict[bytes, tuple[IdentificationResult, HeldOutReadings]] = {}
    is_soft = is_softened = False
    before: IdentificationResult | None = None
    while True:
        # Many gross errors drew the arm to themselves where weights are Student's: these start anew.
        fit = before = identify(weights, None if is_soft else before)
        held_out = cross_validate(fit)
        # The fit with Student's weights only shows which readings to exclude: it excludes none itself.
        if not is_soft:
            tried[weights.tobytes()] = fit, held_out
            if len(tried) == MAX_FITS:
                return fit, held_out
        judged, distribution = _judge(fit, held_out)
        probability = distribution.gross_probability(judged)
        weights = np.ones(len(weights))
        is_soft = distribution.freedom < HEAVY_TAILS and not is_softened
        if is_soft:
            weights[judged.rows] = distribution.student_weights(judged)
            is_softened = True
            continue
        weights[judged.rows[probability > 0.5]] = 0.0
        # A reading at the limit could come and go without end.
        if weights.tobytes() in tried:
            return tried[weights.tobytes()]


def _judge(fit: IdentificationResult, held_out: HeldOutReadings) -> tuple[HeldOutReadings, ErrorDistribution]:
    """Held-out readings as they are judged, and the distribution of their errors."""
    judged = _about_seat_medians(held_out, fit.references)
    own = own_variance(fit.references, judged.rows)
    informative = judged.select_informative(own)
    if len(informative.rows) < LEAST_READINGS:
        return judged.select(np.zeros(0, dtype=np.intp)), HONEST
    # Where one reading in five is wrong, the noise of the fit is theirs, and its covariance is as much too large.
    ratio = min(1.0, _typical_variance(informative) / float(np.median(own)))
    return judged.scaled(covariance=ratio), fit_error_distribution(informative.scaled(covariance=ratio))


def has_gross_errors(fit: IdentificationResult, held_out: HeldOutReadings) -> bool:
    """Whether some held-out reading is a gross error, or deviations scatter so widely that some may be hidden."""
    judged, distribution = _judge(fit, held_out)
    probability = distribution.gross_probability(judged)
    return bool((probability > 0.5).any()) or distribution.freedom < HEAVY_TAILS


def gross_error_limit(fit: IdentificationResult, held_out: HeldOutReadings) -> float:
    """Whitened length from which a point is more probably a gross error than not, by held-out readings like it."""
    distribution = _judge(fit, held_out)[1]
    lengths = np.geomspace(LEAST_GROSS_STDS, LEAST_GROSS_STDS * 10**DECADES, 4000)
    squares = np.repeat(lengths[None] ** 2 * distribution.variance / 3, 3, axis=0)
    honest, gross = _densities(np.zeros_like(squares), squares, np.ones(len(lengths)), distribution).logs
    return float(lengths[min(int(np.count_nonzero(gross <= honest)), len(lengths) - 1)])


def nearer_half(fit: IdentificationResult, n: int) -> FloatArray:
    """(n,) weights of the readings for a fit to the half of the points that is nearest to an arm: 1 or 0.

    With more than one gross error in six, their residuals raise the noise until Huber's weights take all for honest. A
    concentration step of least trimmed squares stands nearly half (P. J. Rousseeuw, K. Van Driessen, "Computing LTS
    regression for large data sets", Data Min. Knowl. Discov. 12 (2006) 29). Of fewer than `LEAST_READINGS` points, all
    have weight 1.
    """
    weights = np.ones(n)
    for part in fit.references:
        if part.kind in ("point", "pose") and len(part.rows) >= LEAST_READINGS:
            distances = np.linalg.norm(part.residuals[:3], axis=0)
            weights[part.rows[distances > np.median(distances)]] = 0.0
    return weights


def median_distance(fit: IdentificationResult) -> float:
    """Median distance of the points from an arm [mm], excluded ones among them; infinite without points."""
    distances = [
        np.linalg.norm(part.residuals[:3], axis=0) for part in fit.references if part.kind in ("point", "pose")
    ]
    return float(np.median(distances[0])) if distances else float("inf")


def excluded_readings(fit: IdentificationResult) -> IntArray:
    """Rows of the readings that took no part in an identification."""
    rows = [part.rows[part.robust_weight == 0] for part in fit.references]
    return np.asarray(np.unique(np.concatenate(rows)))


def own_variance(references: tuple[ReferenceFit, ...], rows: IntArray) -> FloatArray:
    """(m,) variance of a coordinate by noise and reference, of readings of these [mm^2]."""
    own = np.zeros(1 + max([0, *(int(part.rows.max(initial=0)) for part in references)]))
    for part in reversed(references):  # points come first, and judge where there are both
        own[part.rows] = part.noise_std**2 + (part.std**2).mean(axis=0)
    return np.asarray(own[rows])


def _about_seat_medians(held_out: HeldOutReadings, references: tuple[ReferenceFit, ...]) -> HeldOutReadings:
    """Held-out readings, those about the mean of their own seat carried to its median: a wrong one moves the mean."""
    for part in references:
        if part.kind != "seat":
            continue
        seat_of = np.full(1 + max(int(part.rows.max()), int(held_out.rows.max(initial=0))), -1)
        seat_of[part.rows] = part.artefact
        own = np.flatnonzero(held_out.freedom < 1 - 1e-9)
        deviations = held_out.deviations.copy()
        for seat in np.unique(seat_of[held_out.rows[own]]):
            rows = own[seat_of[held_out.rows[own]] == seat]
            deviations[rows] -= np.median(deviations[rows], axis=0)
        held_out = replace(held_out, deviations=deviations)
    return held_out
