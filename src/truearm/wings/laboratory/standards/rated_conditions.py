"""The rated conditions of a specification, and whether the points were measured within them.

A maximum permissible error applies within the conditions that the arm's maker rates it for (ISO 10360-1 [recalled]):
outside them the values show neither conformity nor the contrary. The specification states ranges, the points the
conditions of their measurement, in columns of the same names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan
from types import MappingProxyType
from typing import Self

from pydantic import model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Real
from truearm.wings.laboratory.standards.measured_points import CONDITIONS, PointGroup

# Chosen here: thermometers of the room and of the artefacts that are farther apart contradict each other [K].
APART_K = 0.5


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
        The lowest and the highest value; None if it is stated nowhere.
    missing : str
        What to fill in where a group of points does not state the condition, nor the room; empty if all do.
    """

    name: str
    unit: str
    rated: RatedRange
    measured: tuple[float, float] | None
    missing: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the condition was met; None if nothing contradicts it, but it is not stated for all points."""
        if self.measured is not None and not self.rated.contains(*self.measured):
            return False
        return None if self.missing else True

    def __str__(self) -> str:
        rated = f"rated {self.rated.describe(self.unit)}"
        if self.measured is None:
            return f"{self.name} ({rated})"
        low, high = self.measured
        values = " to ".join(dict.fromkeys((f"{low:.4g}", f"{high:.4g}")))
        some = " at some of the points" if self.missing else ""
        return f"{self.name} {values} {self.unit}{some}, {rated}"


def compare_conditions(
    rated: Mapping[str, RatedRange],
    groups: Sequence[PointGroup],
    room: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> tuple[ConditionResult, ...]:
    """Compare the conditions of measured groups with the rated ones.

    The artefacts have the temperature of the air after some hours: where the temperature of the air is rated, theirs is
    compared too. What is stated of the room, lowest and highest, holds for all groups; what one group states holds for
    that group only.
    """
    results = []
    for key, limits in rated.items():
        name, unit, *_ = CONDITIONS[key]
        stated = [group.conditions[key] for group in groups if key in group.conditions]
        if key in room:
            stated.append(room[key])
        measured = (min(low for low, _ in stated), max(high for _, high in stated)) if stated else None
        by_artefact = key == "air_degC"
        degC = [group.degC for group in groups if by_artefact and not isnan(group.degC)]
        whole = key in room or all(
            key in group.conditions or (by_artefact and not isnan(group.degC)) for group in groups
        )
        if degC:
            results.append(ConditionResult("temperature of the artefacts", unit, limits, (min(degC), max(degC))))
        if measured is not None or not whole:
            results.append(ConditionResult(name, unit, limits, measured, "" if whole else _where_to_state(key)))
    return tuple(results)


def _where_to_state(key: str) -> str:
    room = " or relative_humidity_percent of the room" if key == "humidity_percent" else ""
    return f"fill in the column {key} of the points{room}"


def describe_disagreement(air: tuple[float, float] | None, artefacts: tuple[float, float] | None) -> str | None:
    """Say by how much artefacts were outside the stated range of the air, whose temperature they have after hours.

    Parameters
    ----------
    air, artefacts : (float, float) or None
        Lowest and highest temperature [degC]; None where none is stated.

    Returns
    -------
    str or None
        None if the ranges agree to `APART_K`.
    """
    if air is None or artefacts is None:
        return None
    apart = max(air[0] - artefacts[0], artefacts[1] - air[1])
    if apart <= APART_K:
        return None
    room, bodies = (" to ".join(dict.fromkeys(f"{one:g}" for one in pair)) for pair in (air, artefacts))
    return (
        f"the air was stated at {room} degC, the artefacts at {bodies} degC, up to {apart:.2g} K outside: artefacts "
        "that have stood in the room for hours have its temperature; check both thermometers, or state the whole range "
        "of the room"
    )
