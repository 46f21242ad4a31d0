"""The spread of residuals: the part that no reference uncertainty explains, and how far each is to be trusted.

A reading has k residuals: three of a point, one of a plane or a sphere, two of a line.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

from truearm.typing import FloatArray

# A residual in space longer than this many standard deviations weighs less: of Gaussian ones, one in 900 is.
HUBER_STDS = 4.0
# Whatever its number of residuals, the same share of Gaussian readings weighs less.
SHARE_BEYOND = float(chi2.sf(HUBER_STDS**2, 3))
# A nanometre: it keeps weights finite where the data are exact.
FLOOR_MM2 = 1e-12


@cache
def huber_threshold_squared(k: int) -> float:
    """Squared whitened length of k residuals from which on a reading weighs less."""
    return float(chi2.isf(SHARE_BEYOND, k))


@cache
def expected_clipped_square(k: int) -> float:
    """Mean of the squared length of k Gaussian residuals, cut off there: a hair below k."""
    cut = huber_threshold_squared(k)
    return float(k * chi2.cdf(cut, k + 2) + cut * chi2.sf(cut, k))


def huber_weights(residuals: FloatArray, variance: FloatArray) -> FloatArray:
    """Huber's weights on the length of whitened residuals: 1 up to a cut, as one over the length beyond.

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
    """The variance v of a residual for which the whitened residuals have the size that their freedom says.

    Solves ``sum |r|^2 / (s^2 + v) = k n - n_effective``, whose left side falls with v: moments, not likelihood, which
    is the same where all s are (R. C. Paule, J. Mandel, "Consensus values and weighting factors", J. Res. Natl. Bur.
    Stand. 87 (1982) 377). Robustly, squared lengths are cut off as in `huber_weights` and their expectation with them
    (Huber's proposal 2), so that gross errors hardly raise v.

    Parameters
    ----------
    residuals : (n, k) array
        [mm].
    reference_variance : (n, k) array
        Of the references, s^2 [mm^2].
    n_effective : float
        Parameters that the residuals, rather than priors, determined.
    robust : bool
        Whether gross errors may be among them.

    Returns
    -------
    float
        [mm^2], a nanometre squared where the references explain everything.
    """
    n, k = residuals.shape
    squares = residuals**2
    per_reading = expected_clipped_square(k) if robust else float(k)
    # Where parameters are as many as data there is no freedom to learn the noise from: a thousandth of it stands in.
    freedom: float = max(per_reading * n - n_effective, 1e-3 * n)
    most = huber_threshold_squared(k) if robust else np.inf

    def excess(log_v: float) -> float:
        lengths_squared = (squares / (reference_variance + np.exp(log_v))).sum(axis=1)
        return float(np.minimum(lengths_squared, most).sum()) - freedom

    lowest, highest = np.log(FLOOR_MM2), np.log(1.01 * squares.sum() / freedom + 2 * FLOOR_MM2)
    if excess(lowest) <= 0:
        return FLOOR_MM2
    return float(np.exp(brentq(excess, lowest, highest, xtol=1e-6)))
