"""The spread of residuals: the part that no reference uncertainty explains, and how far each is to be trusted."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.stats import chi2

FloatArray = npt.NDArray[np.float64]

# A residual longer than this many standard deviations weighs less: of Gaussian ones in space, one in 900 is.
HUBER_STDS = 4.0
# The mean of a squared Gaussian length in space, cut off there: a hair below 3.
CUT_SQUARE = float(3 * chi2.cdf(HUBER_STDS**2, 5) + HUBER_STDS**2 * chi2.sf(HUBER_STDS**2, 3))
# A nanometre: it keeps weights finite where the data are exact.
FLOOR_MM2 = 1e-12


def huber_weights(residuals: FloatArray, variance: FloatArray) -> FloatArray:
    """Huber's weights on the length of whitened residuals: 1 up to `HUBER_STDS`, as one over the length beyond.

    Source: P. J. Huber, Ann. Math. Stat. 35 (1964) 73.

    Parameters
    ----------
    residuals, variance : (n, 3) array
        [mm], [mm^2].

    Returns
    -------
    (n,) array
    """
    lengths = np.sqrt((residuals**2 / variance).sum(axis=1))
    return np.asarray(HUBER_STDS / np.maximum(lengths, HUBER_STDS))


def unexplained_variance(
    residuals: FloatArray, reference_variance: FloatArray, *, n_effective: float, robust: bool
) -> float:
    """The variance v of a coordinate for which the whitened residuals have the size that their freedom says.

    Solves ``sum |r|^2 / (s^2 + v) = 3 n - n_effective`` (restricted maximum likelihood); robustly, squared lengths are
    cut off at `HUBER_STDS` and their expectation with them (Huber's proposal 2), so that gross errors hardly raise v.

    Parameters
    ----------
    residuals : (n, 3) array
        [mm].
    reference_variance : (n, 3) array
        Of the reference points, s^2 [mm^2].
    n_effective : float
        Parameters that the residuals, rather than priors, determined.
    robust : bool
        Whether gross errors may be among them.

    Returns
    -------
    float
        [mm^2], a nanometre squared where the references explain everything.
    """
    n = len(residuals)
    squares = residuals**2
    per_reading = CUT_SQUARE if robust else 3.0
    # Where parameters are as many as data there is no freedom to learn the noise from: a thousandth of it stands in.
    freedom = max(per_reading * n - n_effective, 1e-3 * n)
    most = HUBER_STDS**2 if robust else np.inf

    def excess(log_v: float) -> float:
        lengths_squared = (squares / (reference_variance + np.exp(log_v))).sum(axis=1)
        return float(np.minimum(lengths_squared, most).sum()) - freedom

    lowest, highest = np.log(FLOOR_MM2), np.log(1.01 * squares.sum() / freedom + 2 * FLOOR_MM2)
    if excess(lowest) <= 0:
        return FLOOR_MM2
    return float(np.exp(brentq(excess, lowest, highest, xtol=1e-6)))
