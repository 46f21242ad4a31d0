"""Paired comparison of models on the same held-out readings, by position or seat, robust against a few wrong ones.

An error that all models share, such as a far-out pose or a seat that is hard to predict, cancels in the difference.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.solve.distributions import chi2_probability, f_quantile
from truearm.typing import FloatArray

# Share of the differences that is trimmed at either end.
TRIMMED_SHARE = 0.1
# A gain of a smaller share of the error is none: of two equal models of few readings the simpler one is kept.
LEAST_GAIN = 1e-3
# Fewer groups, as a few seats are, hardly show their own standard error: the better model is kept, not the simpler one.
FEW_GROUPS = 10


def group_means(held_out: HeldOutReadings) -> FloatArray:
    """Mean error of every group; of a single group the errors of its readings [mm]."""
    group = np.unique(held_out.group, return_inverse=True)[1]
    errors = held_out.errors_mm
    if group.max() == 0:
        return errors
    return np.asarray(np.bincount(group, errors) / np.bincount(group))


def exceeds(errors: FloatArray, others: FloatArray) -> bool:
    """Whether errors by group exceed others by more than a standard error of their difference.

    Of few groups by more than as many standard errors as hold the mean with the same probability of 68 %, of Student's
    distribution: 1.2 of four groups, 1.01 of forty.
    """
    excess, error = trimmed_mean(errors - others)
    if not np.isfinite(error):
        return False
    freedom = len(errors) - 2 * int(TRIMMED_SHARE * len(errors)) - 1
    wide = np.sqrt(f_quantile(chi2_probability(1.0, 1), 1, freedom))
    return bool(excess > max(wide * error, LEAST_GAIN * trimmed_mean(others)[0]))


def selected(errors: Mapping[str, FloatArray], n_groups: int) -> tuple[str, str]:
    """The model to keep, and the one of the least error, by errors by group of models that are named simplest first.

    One standard error rule (L. Breiman and others, "Classification and Regression Trees", 1984, section 3.4.3) on
    paired differences: the simplest model whose error exceeds the least by no more than one standard error of their
    difference. Of fewer than ten groups it is the one of the least error, if it is a tenth of a per cent better; of one
    group `errors` are those of its readings.
    """
    mean = {name: trimmed_mean(by_group)[0] for name, by_group in errors.items()}
    best = min(mean, key=lambda name: mean[name])
    if n_groups < FEW_GROUPS:
        return next(name for name in errors if mean[name] <= (1 + LEAST_GAIN) * mean[best]), best
    return next(name for name in errors if not exceeds(errors[name], errors[best])), best


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
