"""Paired comparison of models on the same held-out readings, by position or seat, robust against a few wrong ones.

An error that all models share, such as a far-out pose or a seat that is hard to predict, cancels in the difference.
"""

from __future__ import annotations

import numpy as np

from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.typing import FloatArray

# Share of the differences that is trimmed at either end.
TRIMMED_SHARE = 0.1


def group_means(held_out: HeldOutReadings) -> FloatArray:
    """Mean error of every group; of a single group the errors of its readings [mm]."""
    group = np.unique(held_out.group, return_inverse=True)[1]
    errors = held_out.errors_mm
    if group.max() == 0:
        return errors
    return np.asarray(np.bincount(group, errors) / np.bincount(group))


def trimmed_mean(values: FloatArray) -> tuple[float, float]:
    """Mean without the largest and smallest tenth, and its standard error.

    The standard error is that of K. K. Yuen, "The two-sample trimmed t for unequal population variances", Biometrika 61
    (1974) 165: from the sum of squares in which the trimmed values count as the nearest remaining one.

    Parameters
    ----------
    values : (n,) array

    Returns
    -------
    mean, standard_error : float
        The error is infinite for one value.
    """
    n = len(values)
    trimmed = int(TRIMMED_SHARE * n)
    remaining = n - 2 * trimmed
    if n < 2:
        return float(values.mean()), float("inf")
    ordered = np.sort(values)
    winsorised = np.clip(values, ordered[trimmed], ordered[n - 1 - trimmed])
    squares = float(((winsorised - winsorised.mean()) ** 2).sum())
    mean = float(ordered[trimmed : n - trimmed].mean())
    return mean, float(np.sqrt(squares / (remaining * (remaining - 1))))
