"""Errors of the training readings that were held out of an identification, in short."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.identification.estimation.identification_result import ReferenceFit
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.judgement.cross_validation import LEAST_FREEDOM
from truearm.identification.judgement.gross_errors import own_variance


def select_determined(held_out: HeldOutReadings, references: tuple[ReferenceFit, ...]) -> HeldOutReadings:
    """Readings that the others determine; the deviations of the rest are bounded (`LEAST_FREEDOM`), and no errors."""
    if held_out.n_coordinates == 1:  # distances, beside points with a noise of their own
        references = tuple(part for part in references if part.kind == "distance")
    return held_out.select_informative(own_variance(references, held_out.rows), most=1 / LEAST_FREEDOM)


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
