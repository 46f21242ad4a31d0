"""Chi-squared and F distributions by `scipy.special`: importing `scipy.stats` takes longer than most commands."""

from __future__ import annotations

import numpy as np
from scipy.special import betaln, chdtr, chdtrc, chdtri, fdtri, gammaincinv

from truearm.typing import FloatArray


def chi2_probability(x: float, freedom: float) -> float:
    """Probability of a chi-squared variable of `freedom` degrees of freedom up to x."""
    return float(chdtr(freedom, x))


def chi2_probability_beyond(x: float, freedom: float) -> float:
    """Probability of a chi-squared variable beyond x."""
    return float(chdtrc(freedom, x))


def chi2_quantile(probability: float, freedom: float) -> float:
    """Value up to which a chi-squared variable is with a probability."""
    return float(2 * gammaincinv(freedom / 2, probability))


def chi2_quantile_beyond(probability: float, freedom: float) -> float:
    """Value beyond which a chi-squared variable is with a probability, accurate where that is small."""
    return float(chdtri(freedom, probability))


def f_quantile(probability: float, of_numerator: float, of_denominator: float) -> float:
    """Value up to which an F variable is with a probability."""
    return float(fdtri(of_numerator, of_denominator, probability))


def f_log_density(x: FloatArray, of_numerator: float, of_denominator: float) -> FloatArray:
    """(n,) logarithm of the density of an F variable at x (n,), positive."""
    n, m = of_numerator, of_denominator
    density: FloatArray = (
        n / 2 * np.log(n / m) + (n / 2 - 1) * np.log(x) - (n + m) / 2 * np.log1p(n * x / m) - betaln(n / 2, m / 2)
    )
    return density
