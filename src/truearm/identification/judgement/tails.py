"""Tails: how much farther than Gaussian errors the deviations of held-out readings scatter.

Residual variances are such that Gaussian ellipsoids of 95 % contain 95 % of the held-out readings
(`truearm.identification.estimation.residual_variance`). What lies outside says how the ellipsoids grow beyond: squared
whitened lengths of Student's distribution of k coordinates with nu degrees of freedom are k times an F(k, nu), and nu
is that of the largest posterior density of those above the quantile of 95 %. The body of the distribution has no part
in it, as it would outvote the tail (the peaks over a threshold of J. Pickands, Ann. Stat. 3 (1975) 119).
"""

from __future__ import annotations

import numpy as np

from truearm.errors import InputError
from truearm.identification.estimation.residual_variance import LEVEL, HeldOutReadings
from truearm.solve.distributions import chi2_quantile, f_log_density, f_quantile

# Prior of the degrees of freedom, a gamma density of this shape and rate, of their logarithm: M. A. Juarez, M. F. J.
# Steel, "Model-based clustering of non-Gaussian panel data based on skew-t distributions", J. Bus. Econ. Stat. 28
# (2010) 52.
FREEDOM_SHAPE, FREEDOM_RATE = 2.0, 0.1
# Bounds of the degrees of freedom: the variance is finite above two; above a thousand the distribution is Gaussian.
LEAST_FREEDOM, MOST_FREEDOM = 2.0, 1e3


def tail_freedom(held_out: HeldOutReadings, variance: float) -> float:
    """Degrees of freedom of the tails of held-out deviations.

    Parameters
    ----------
    held_out : HeldOutReadings
        Without gross errors.
    variance : float
        Residual variance of a coordinate, by which their 95 % ellipsoids contain 95 % of them [mm^2].

    Returns
    -------
    float
        Twenty where no deviation shows the tails.
    """
    from scipy.optimize import minimize_scalar

    known, along = held_out.along_axes
    squares = (along / (known + variance * held_out.freedom)).sum(axis=0)
    k = held_out.n_coordinates
    beyond = squares[squares > chi2_quantile(LEVEL, k)]

    def deviance(log_freedom: float) -> float:
        freedom = float(np.exp(log_freedom))
        unit = _squared_unit(freedom, k)
        prior = FREEDOM_SHAPE * log_freedom - FREEDOM_RATE * freedom
        return float(-(f_log_density(beyond / unit, k, freedom) - np.log(unit)).sum() - prior)

    bounds = (float(np.log(LEAST_FREEDOM)), float(np.log(MOST_FREEDOM)))
    return float(np.exp(minimize_scalar(deviance, bounds=bounds, method="bounded").x))


def ellipsoid_factor(level: float, *, freedom: float) -> float:
    """Half axis, in standard uncertainties, of an ellipsoid that contains a point with probability `level`.

    At 95 % it is that of Gaussian errors, 2.80, whatever the tails.

    Parameters
    ----------
    level : float
        Between 0 and 1.
    freedom : float
        Degrees of freedom of the tails; infinite for Gaussian errors.

    Raises
    ------
    InputError
        If the level is not between 0 and 1.
    """
    if not 0 < level < 1:
        raise InputError(f"expected a level between 0 and 1, got {level}", hint="95 % is 0.95")
    if np.isinf(freedom):
        return float(np.sqrt(chi2_quantile(level, 3)))
    return float(np.sqrt(_squared_unit(freedom) * f_quantile(level, 3, freedom)))


def _squared_unit(freedom: float, k: int = 3) -> float:
    """Squared whitened length of an F of 1: at the level of 95 % both lengths are equal."""
    return float(chi2_quantile(LEVEL, k) / f_quantile(LEVEL, k, freedom))
