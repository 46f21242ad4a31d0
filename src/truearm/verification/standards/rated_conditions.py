"""The rated conditions of a specification, and whether the points were measured within them.

A maximum permissible error applies within the conditions that the arm's maker rates it for (ISO 10360-1 [recalled]):
outside them the values show neither conformity nor the contrary. The specification states ranges, the points the
conditions of their measurement, in columns of the same names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Self

from pydantic import model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Real
from truearm.verification.standards.measured_points import CONDITION_COLUMNS, PointGroup

# Name and unit of each condition that may be rated.
CONDITIONS: Mapping[str, tuple[str, str]] = {
    "air_degC": ("temperature of the air", "degC"),
    "air_K_per_h": ("change of the air's temperature", "K/h"),
    "air_K_per_m": ("gradient of the air's temperature", "K/m"),
    "warm_up_min": ("warm-up time", "min"),
    "humidity_percent": ("relative humidity", "%"),
}
assert tuple(CONDITIONS) == CONDITION_COLUMNS


class RatedRange(Document):
    """The range of a rated condition; one end may be missing."""

    min: Real | None = None
    max: Real | None = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.min is None and self.max is None:
            raise InputError("expected min, max or both, got none", hint="write { min = 18, max = 22 }")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise InputError(f"min = {self.min:g} is larger than max = {self.max:g}", hint="exchange the two")
        return self

    def contains(self, low: float, high: float) -> bool:
        """Whether all values between two are in the range."""
        return (-inf if self.min is None else self.min) <= low and high <= (inf if self.max is None else self.max)

    def describe(self, unit: str) -> str:
        """The range in words: ``18 to 22 degC``, ``30 min or more``."""
        if self.min is None:
            return f"{self.max:g} {unit} or less"
        return f"{self.min:g} {unit} or more" if self.max is None else f"{self.min:g} to {self.max:g} {unit}"


@dataclass(frozen=True)
class ConditionResult:
    """A rated condition and what was measured.

    Attributes
    ----------
    name, unit : str
    rated : RatedRange
    measured : (float, float) or None
        The lowest and the highest value; None if the points do not state it.
    """

    name: str
    unit: str
    rated: RatedRange
    measured: tuple[float, float] | None

    @property
    def met(self) -> bool | None:
        """Whether the condition was met; None if that is not stated."""
        return None if self.measured is None else self.rated.contains(*self.measured)

    def __str__(self) -> str:
        rated = f"rated {self.rated.describe(self.unit)}"
        if self.measured is None:
            return f"{self.name} ({rated})"
        low, high = self.measured
        values = " to ".join(dict.fromkeys((f"{low:.4g}", f"{high:.4g}")))
        return f"{self.name} {values} {self.unit}, {rated}"


def compare_conditions(rated: Mapping[str, RatedRange], groups: Sequence[PointGroup]) -> tuple[ConditionResult, ...]:
    """Compare the conditions of measured groups with the rated ones.

    The artefacts have the temperature of the air after some hours: where the temperature of the air is rated, theirs is
    compared too.
    """
    results = []
    for key, limits in rated.items():
        name, unit = CONDITIONS[key]
        stated = [group.conditions[key] for group in groups if key in group.conditions]
        measured = (min(low for low, _ in stated), max(high for _, high in stated)) if stated else None
        degC = [group.degC for group in groups if not isnan(group.degC)] if key == "air_degC" else []
        if degC:
            results.append(ConditionResult("temperature of the artefacts", unit, limits, (min(degC), max(degC))))
        if measured is not None or not degC:
            results.append(ConditionResult(name, unit, limits, measured))
    return tuple(results)
