"""Whether an arm is fit for a tolerance, by its uncertainty of a measured feature."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from truearm.errors import InputError
from truearm.wings.laboratory.tasks.estimate import Estimate

# Tolerance over the expanded uncertainty to both sides: the "4:1 rule" of laboratories.
GOOD_RATIO = 4.0


class FitnessDecision(Enum):
    """Whether an arm is fit for a tolerance."""

    YES = "yes"
    NO = "no"
    GUARDED = "only with guard bands"


@dataclass(frozen=True)
class Fitness:
    """Fitness of an arm for a tolerance.

    Attributes
    ----------
    answer : FitnessDecision
    tolerance_mm : float
        Width T of the tolerance zone: 0.1 for +-0.05 mm; the permitted deviation if the zone is one-sided, as of form.
    ratio : float
        T / 2U, or T / U of a one-sided zone.
    acceptance_zone_mm : float
        Width of the zone in which a measured value proves conformity: T - 2U, or T - U if one-sided; zero or more.
    """

    answer: FitnessDecision
    tolerance_mm: float
    ratio: float
    acceptance_zone_mm: float

    def to_dict(self) -> dict[str, Any]:
        """Return the decision as plain data; an infinite ratio is None."""
        return {
            "tolerance_mm": self.tolerance_mm,
            "answer": self.answer.value,
            "ratio": self.ratio if np.isfinite(self.ratio) else None,
            "acceptance_zone_mm": self.acceptance_zone_mm,
        }


def fitness(estimate: Estimate, tolerance_mm: float) -> Fitness:
    """Decide whether an arm is fit to prove that parts conform to a tolerance.

    By ISO 14253-1 a part is proven to conform if the measured value lies inside the tolerance zone by the expanded
    uncertainty U: of a zone of width T the acceptance zone T - 2U remains. The answer is yes if T is at least four
    times 2U, the usual rule of laboratories, and no if no acceptance zone remains.

    Deviations of form and direction are norms of vectors, as ranges of residuals are. By the triangle inequality the
    measured value differs from the part's own by no more than the value of the errors alone, which U bounds. The errors
    add to the form of a nearly perfect part: a value within T then proves conformity, and parts lose U of T. Without an
    acceptance zone, even a perfect part may be found not to conform.

    Parameters
    ----------
    estimate : Estimate
    tolerance_mm : float
        Width of the zone.

    Raises
    ------
    InputError
        If the tolerance is not a positive number.
    """
    if not 0 < tolerance_mm < np.inf:
        raise InputError(f"expected a tolerance above zero in mm, got {tolerance_mm}", hint="0.1 for +-0.05 mm")
    used = estimate.expanded_mm * (1 if estimate.quantity.is_form else 2)
    ratio = tolerance_mm / used if used > 0 else np.inf
    answer = (
        FitnessDecision.YES if ratio >= GOOD_RATIO else FitnessDecision.NO if ratio <= 1 else FitnessDecision.GUARDED
    )
    return Fitness(answer, tolerance_mm, float(ratio), max(tolerance_mm - used, 0.0))


def describe_fitness(estimate: Estimate, fit: Fitness) -> str:
    """Describe whether the arm is fit for the tolerance, in sentences."""
    one_sided, tolerance, accepted = estimate.quantity.is_form, fit.tolerance_mm, fit.acceptance_zone_mm
    name = estimate.quantity.name
    zone = f"{tolerance:g} mm" if one_sided else f"+-{tolerance / 2:g} mm"
    answer = {
        FitnessDecision.YES: f"Yes, this arm is fit for {name} {zone}",
        FitnessDecision.NO: f"No, this arm is not fit for {name} {zone}",
        FitnessDecision.GUARDED: f"This arm is fit for {name} {zone} only with guard bands",
    }[fit.answer]
    usual = "" if fit.answer is FitnessDecision.NO else " (usual: 4 or more)"
    evidence = f"{'T / U' if one_sided else 'T / 2U'} = {fit.ratio:.1f}{usual}, U = {estimate.expanded_mm:.4f} mm"
    if not one_sided and accepted > 0:
        meaning = f"Measured values within +-{accepted / 2:.4f} mm prove conformity (ISO 14253-1)."
    elif not one_sided:
        meaning = "No measured value would prove conformity (ISO 14253-1)."
    elif accepted > 0:
        meaning = (
            f"Parts that deviate by up to {accepted:.4f} mm are found to conform. Measured values up to "
            f"{accepted:.4f} mm prove conformity of any part, values up to {tolerance:g} mm that of a nearly perfect "
            f"part: errors only add to its {name}."
        )
    else:
        meaning = (
            f"Even a perfect part may be found not to conform. Measured values up to {tolerance:g} mm prove conformity "
            f"of a nearly perfect part only: errors only add to its {name}."
        )
    return f"{answer}: {evidence}. {meaning}"
