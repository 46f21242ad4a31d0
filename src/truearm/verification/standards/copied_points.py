"""Measurements that are copies of others, as they stand or moved and turned: noise does not repeat.

How points lie to each other is the same wherever a copy is moved. Two measurements whose distances agree far below the
noise of any arm are one measurement. A length between two points has one distance only, which agrees by chance: there
the vector between its ends counts, and the lengths of a whole position or run, which a turned copy keeps too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import TypeAlias

import numpy as np

from truearm.typing import FloatArray
from truearm.verification.standards.measured_points import PointGroup

# A measurement: its groups, of a length both ends; and its keys without the end, with the artefact.
_Keys: TypeAlias = tuple[str, ...]
_Measurement: TypeAlias = tuple[_Keys, list[PointGroup]]
_Copy: TypeAlias = tuple[PointGroup, str] | None

# Root mean square of differences that no noise leaves [mm]: above what rounding to 0.00001 mm makes of a turned copy.
AGREE_MM = 2e-5
# Numbers of two measurements scatter by this or more [mm]; it gives the chance that one of them agrees.
SCATTER_MM = 5e-3
# Agreement is a copy where its chance is less: three numbers, of coordinates that are written to 0.00001 mm.
CHANCE = 2e-8


def find_copy(groups: Sequence[PointGroup], before: Sequence[PointGroup] | None = None) -> _Copy:
    """Return the first measurement of a test that is a copy, and of what; None if none is.

    Parameters
    ----------
    groups : sequence of PointGroup
        Of one test.
    before : sequence of PointGroup, optional
        Of the same test in another campaign, to compare with; by default those of `groups` are compared.

    Returns
    -------
    (PointGroup, str) or None
        The copy, and a sentence such as "position 2 has the same coordinates as position 1".
    """
    later = _measurements(groups)
    earlier = None if before is None else _measurements(before)
    chance = _chance_of_one([*groups, *(before or ())])
    for one, other in _pairs(later, earlier):
        n = sum(len(group.points) for group in one[1])
        if n != sum(len(group.points) for group in other[1]) or (n == 2 and one[0][:2] != other[0][:2]):
            continue
        points = [np.concatenate([group.points for group in each[1]]) for each in (one, other)]
        if same := np.array_equal(points[0], points[1]):
            numbers = 3 * n
        else:
            numbers = 3 if n == 2 else 3 * n - 6
        if chance**numbers < CHANCE and (same or _agree(_shape(points[0]), _shape(points[1]))):
            how = "has the same coordinates as" if same else "has its points to each other to 20 nm as"
            return one[1][0], f"{one[1][0].where} {how} {other[1][0].where}"
    if groups and "end" in groups[0].keys:
        return _copied_lengths(later, earlier, chance)
    return None


def _measurements(groups: Sequence[PointGroup]) -> list[_Measurement]:
    found: dict[_Keys, list[PointGroup]] = {}
    for group in groups:
        keys = (group.artefact, *(value for key, value in group.keys.items() if key != "end"))
        found.setdefault(keys, []).append(group)
    return [(keys, sorted(ends, key=lambda one: one.keys.get("end", ""))) for keys, ends in found.items()]


def _pairs(
    later: list[_Measurement], earlier: list[_Measurement] | None
) -> Iterator[tuple[_Measurement, _Measurement]]:
    if earlier is not None:
        return product(later, earlier)
    return ((one, other) for other, one in combinations(later, 2))


def _shape(points: FloatArray) -> FloatArray:
    """What a moved copy has in common: the vector of two points; of more, their distances, which turning keeps too."""
    if len(points) == 2:
        return np.asarray(points[1] - points[0])
    first, second = np.triu_indices(len(points), 1)
    return np.asarray(np.linalg.norm(points[first] - points[second], axis=1))


def _agree(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.sqrt(np.mean((one - other) ** 2)) <= AGREE_MM)


def _chance_of_one(groups: Sequence[PointGroup]) -> float:
    """The chance that a number of two measurements agrees: with coordinates written to few digits it is larger."""
    points = np.concatenate([group.points for group in groups])
    step = next((10.0**-n for n in range(6) if np.abs(points - points.round(n)).max() < 1e-9), 0.0)
    return min(1.0, max(2 * AGREE_MM, step) / (4 * SCATTER_MM))


def _copied_lengths(later: list[_Measurement], earlier: list[_Measurement] | None, chance: float) -> _Copy:
    """Positions and runs whose lengths agree one by one, and tests of which most lengths agree with another."""
    names = [key for key in later[0][1][0].keys if key in ("position", "repeat")]
    mm = [{keys: _length_mm(ends) for keys, ends in each} for each in (later, earlier or later)]
    for sought in (some for count in range(len(names), -1, -1) for some in combinations(names, count)):
        at = [2 + names.index(name) for name in sought]
        columns, others = (_columns(each, at) for each in mm)
        for one, other in product(columns, others):
            common = [rest for rest in columns[one] if rest in others[other]]
            if (earlier is None and one <= other) or not common or chance ** len(common) >= CHANCE:
                continue
            if _agree(*(np.array([each[rest] for rest in common]) for each in (columns[one], others[other]))):
                copy, source = (
                    ", ".join(map(" ".join, zip(sought, keys, strict=True))) or "the test" for keys in (one, other)
                )
                first = next(ends[0] for keys, ends in later if tuple(keys[i] for i in at) == one)
                return first, f"{copy} has {len(common)} lengths to 20 nm as {source}"
    if earlier is not None or chance > 2 * AGREE_MM / (4 * SCATTER_MM):  # rounded lengths along an axis are equal
        return None
    of_length = _columns(mm[0], [0, 1]).values()
    gaps = np.concatenate([np.diff(sorted(each.values())) for each in of_length])
    same = int((gaps <= AGREE_MM).sum())
    if 2 * same >= len(gaps) and chance**same < CHANCE:
        return later[0][1][0], f"{same} of {len(later)} measured lengths are to 20 nm as another one"
    return None


def _length_mm(ends: Sequence[PointGroup]) -> float:
    return float(np.linalg.norm(ends[-1].points.mean(axis=0) - ends[0].points.mean(axis=0)))


def _columns(mm: dict[_Keys, float], at: Sequence[int]) -> dict[_Keys, dict[_Keys, float]]:
    """Measured lengths by their keys at some places, and in these by the other keys."""
    found: dict[_Keys, dict[_Keys, float]] = {}
    for keys, length in mm.items():
        rest = tuple(key for i, key in enumerate(keys) if i not in at)
        found.setdefault(tuple(keys[i] for i in at), {})[rest] = length
    return found
