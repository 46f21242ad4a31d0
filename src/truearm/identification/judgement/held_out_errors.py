"""Errors of the training readings that were held out of an identification, in short.

Paired comparison of models on the same held-out readings, by position or seat, robust against a few wrong ones.

An error that all models share, such as a far-out pose or a seat that is hard to predict, cancels in the difference.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import LEAST_FREEDOM as LEAST_RESIDUAL_FREEDOM
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.judgement.cross_validation import LEAST_FREEDOM
from truearm.identification.judgement.gross_errors import excluded_readings, own_variance
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


# Identifications without some of the readings, at most: a tenth of them at once where every one asks for it.
MOST_REFITS = 10


def predicted_by_refits(
    held_out: HeldOutReadings,
    fit: IdentificationResult,
    kinds: Sequence[str],
    identify: Callable[[FloatArray], IdentificationResult],
    n: int,
    *,
    freedom: float,
) -> HeldOutReadings:
    """Held-out readings, those that the others hardly determine as predicted by an arm that was identified again.

    The closed form bounds their deviations (`LEAST_FREEDOM`), and has the noise and the sizes of the terms that they
    had a part in: where the arm passes through nearly all readings it says nothing of any. A reading that nothing else
    determines is predicted by the drawing, as far as base and tip are known.

    Parameters
    ----------
    held_out : HeldOutReadings
    fit : IdentificationResult
    kinds : sequence of str
        Of the references that are compared.
    identify : callable
        Returns the identification with weights (n,) of the readings: 0 excludes one.
    n : int
        Number of readings.
    freedom : float
        Number of residuals less that of the parameters that they determine.
    """
    compared = tuple(part for part in fit.references if part.kind in kinds)
    most = own_variance(compared, held_out.rows) / LEAST_FREEDOM
    is_open = held_out.along_axes[0].max(axis=0) > most
    open_groups = np.unique(held_out.group[is_open | (freedom < LEAST_RESIDUAL_FREEDOM)])
    if not len(open_groups):
        return held_out
    deviations = held_out.deviations.copy()
    for fold in range(min(len(open_groups), MOST_REFITS)):
        of_fold = np.flatnonzero(np.isin(held_out.group, open_groups[fold::MOST_REFITS]))
        weights = np.ones(n)
        weights[excluded_readings(fit)] = weights[held_out.rows[of_fold]] = 0.0
        found = _residuals(identify(weights), kinds)
        deviations[of_fold] = np.stack([found[row] for row in held_out.rows[of_fold].tolist()])
    return replace(held_out, deviations=deviations)


def _residuals(fit: IdentificationResult, kinds: Sequence[str]) -> dict[int, FloatArray]:
    """Residuals (k,) by reading [mm]; of readings in a seat of which none took part, about their mean."""
    found: dict[int, FloatArray] = {}
    for part in reversed([part for part in fit.references if part.kind in kinds]):  # points judge where there are both
        residuals, used = part.residuals[:3].T, part.robust_weight > 0  # of a pose the first three: displacements
        if part.kind == "seat":
            for seat in np.setdiff1d(part.artefact, part.artefact[used]):
                rows = part.artefact == seat
                residuals = np.where(rows[:, None], residuals - residuals[rows].mean(axis=0), residuals)
        found |= dict(zip(part.rows.tolist(), residuals, strict=True))
    return found


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors of the training readings that were held out of the identification, in short.

    Attributes
    ----------
    n, n_groups : int
        Readings, and the positions or seats that were held out together.
    n_excluded : int
        Readings that are gross errors, and not among these.
    mean_mm, standard_error_mm : float
        Mean error and its standard error; infinite where one reading was held out.
    p95_mm, max_mm : float
    """

    n: int
    n_groups: int
    mean_mm: float
    standard_error_mm: float
    p95_mm: float
    max_mm: float
    n_excluded: int = 0

    @classmethod
    def of(cls, held_out: HeldOutReadings, *, n_excluded: int = 0) -> Self | None:
        """Of readings held out; None if there are none."""
        if not len(held_out.rows):
            return None
        errors, n_groups = held_out.errors_mm, len(np.unique(held_out.group))
        p95, largest = float(np.quantile(errors, 0.95)), float(errors.max())
        return cls(len(errors), n_groups, held_out.mean_mm, held_out.standard_error_mm, p95, largest, n_excluded)
