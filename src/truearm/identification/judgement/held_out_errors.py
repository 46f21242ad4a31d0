"""Errors of the training readings that were held out of an identification, in short."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import LEAST_FREEDOM as LEAST_RESIDUAL_FREEDOM
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.judgement.cross_validation import LEAST_FREEDOM
from truearm.identification.judgement.gross_errors import excluded_readings, own_variance
from truearm.typing import FloatArray

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
        residuals, used = part.residuals.T, part.robust_weight > 0
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
