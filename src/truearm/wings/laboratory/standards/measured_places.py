"""The places where an arm was tested: each artefact at each of its positions, with the test values measured there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.decision import ConformityResult, Verdict
from truearm.wings.laboratory.standards.measured_points import PointGroup
from truearm.wings.laboratory.standards.specification import SYMBOLS

# Values of all lengths together, which are measured at no single place.
_OF_ALL = ("Volumetric.2s", "Volumetric.2RMS")


@dataclass(frozen=True, eq=False)
class MeasuredPlace:
    """An artefact where it was measured: a point, or the two ends of a length.

    Attributes
    ----------
    ends : (1, 3) or (2, 3) array
        Means of the measured points [mm].
    name : str
        Artefact and position.
    values : tuple of ConformityResult
        Every value with a limit that was measured here, nearest to its limit first.
    decisive : ConformityResult or None
        The value for which this place decides that the arm does not conform, or that nothing is decided.
    """

    ends: FloatArray
    name: str
    values: tuple[ConformityResult, ...]
    decisive: ConformityResult | None

    @property
    def middle(self) -> FloatArray:
        """Mean of the ends, (3,) [mm]."""
        return np.asarray(self.ends.mean(axis=0))

    @property
    def verdict(self) -> Verdict | None:
        """Not conform or undecided where the place decides that, else None."""
        return None if self.decisive is None else self.decisive.verdict


def share_of_limit(row: ConformityResult) -> float:
    """Magnitude of a value with its expanded uncertainty, in its limit; 1 is the limit, 0 stands for none."""
    return 0.0 if row.limit is None else (abs(row.value) + row.uncertainty) / row.limit


def measured_places(
    tests: Mapping[str, Sequence[PointGroup]], rows: Sequence[ConformityResult]
) -> tuple[MeasuredPlace, ...]:
    """Each artefact at each of its positions.

    Parameters
    ----------
    tests : mapping of str to sequence of PointGroup
        The measured groups of every test.
    rows : sequence of ConformityResult
        With limits; the place of a row is the one that decides it, those of its individual results are all others.
    """
    return tuple(place for test, groups in tests.items() for place in _places(test, groups, rows))


def _places(test: str, groups: Sequence[PointGroup], rows: Sequence[ConformityResult]) -> list[MeasuredPlace]:
    ends: dict[tuple[str, str, str], dict[str, list[FloatArray]]] = {}
    first: dict[tuple[str, str, str], PointGroup] = {}
    for group in groups:
        # Repeats are at one place; the lengths of a bar at one position are several.
        key = (group.artefact, group.keys.get("length", ""), group.keys.get("position", ""))
        ends.setdefault(key, {}).setdefault(group.keys.get("end", "A"), []).append(group.points)
        first.setdefault(key, group)
    places = []
    for key, points in ends.items():
        deciding = [row for row in rows if _was_measured(row, test, first[key]) and row.verdict in _UNMET]
        values = [one for row in rows for one in row.individual or (row,) if _was_measured(one, test, first[key])]
        artefact, length, position = key
        name = f"{artefact}{length and f', {length}'}{position and f', position {position}'}"
        places.append(
            MeasuredPlace(
                np.stack([np.concatenate(one).mean(axis=0) for one in points.values()]),
                name,
                tuple(sorted(values, key=share_of_limit, reverse=True)),
                min(deciding, key=lambda row: _UNMET.index(row.verdict), default=None),
            )
        )
    return places


_UNMET: list[Verdict | None] = [Verdict.NOT_CONFORM, Verdict.UNDECIDED]


def _was_measured(row: ConformityResult, test: str, group: PointGroup) -> bool:
    """Whether the value of a row comes from the place of a group."""
    symbol, _, length = row.label.partition(", ")
    if row.limit is None or symbol in _OF_ALL or SYMBOLS.get(symbol, (None,))[0] != test:
        return False
    if "length" in group.keys and group.keys["length"] != (length or row.where.partition(", position ")[0]):
        return False
    position = group.keys.get("position")
    return position is None or f"position {position}" in row.where.split(", ")
