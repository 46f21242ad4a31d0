"""Measurements that are copies of others, as they stand or moved and turned: noise does not repeat.

How points lie to each other is the same wherever a copy is moved. Two measurements whose distances agree far below the
noise of any arm are one measurement, in whatever order its points stand. A length between two points has one distance
only, which agrees by chance: there the vector between its ends counts, and the lengths of a whole position or run,
which a turned copy keeps too. A run that is the mean of two others was not measured either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations, product
from math import lgamma, log
from typing import TypeAlias

import numpy as np

from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.measured_points import PointGroup

_Keys: TypeAlias = tuple[str, ...]
_Copy: TypeAlias = tuple[PointGroup, str] | None

# Root mean square of differences that no noise leaves [mm]: above what rounding to 0.00001 mm makes of a turned copy.
AGREE_MM = 2e-5
# Numbers of two measurements scatter by this or more [mm]; it gives the chance that one of them agrees.
SCATTER_MM = 5e-3
# Agreement is a copy where its chance is less: three numbers, of coordinates that are written to 0.00001 mm.
CHANCE = 2e-8
# Of points that are the same to the last digit, of all pairs of a test together.
CHANCE_OF_REPEATED = 1e-6


@dataclass(frozen=True, eq=False)
class _Measurement:
    """Its keys without the end, with the artefact; its groups, of a length both ends. Each is compared with many."""

    keys: _Keys
    groups: list[PointGroup]

    @cached_property
    def points(self) -> FloatArray:
        return np.concatenate([group.points for group in self.groups])

    @cached_property
    def shape(self) -> FloatArray:
        """What a moved copy has too: the vector of two points; of more, their distances, which turning keeps too."""
        if len(self.points) == 2:
            return np.asarray(self.points[1] - self.points[0])
        first, second = np.triu_indices(len(self.points), 1)
        return np.asarray(np.linalg.norm(self.points[first] - self.points[second], axis=1))

    @cached_property
    def sorted_shape(self) -> FloatArray:
        return np.sort(self.shape)


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
        n = len(one.points)
        if n != len(other.points) or (n == 2 and one.keys[:2] != other.keys[:2]):
            continue
        if (how := _how_copied(one, other, chance)) is not None:
            return one.groups[0], f"{one.groups[0].where} {how} {other.groups[0].where}"
    if before is None and (found := _mean_of_two(later, chance)) is not None:
        return found
    if groups and "end" in groups[0].keys:
        return _copied_lengths(later, earlier, chance)
    return None


def find_repeated(groups: Sequence[PointGroup]) -> _Copy:
    """Return the group of the first point of a test that repeats another one more often than rounding explains.

    A trigger that bounces stores a point twice, in a seat too; a row pasted twice may lie in two repeats or positions.
    """
    points = np.concatenate([group.points for group in groups])
    first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)[1:]
    copies = len(points) - len(first)
    # Of as many pairs as points of one place make.
    pairs = len(points) * max(len(group.points) for group in groups) / 2
    scatter = min(SCATTER_MM, max(1e-3, float(np.median([group.points.std(axis=0).mean() for group in groups]))))
    expected = pairs * (max(_step(points), 1e-6) / (4 * scatter)) ** 3
    if copies == 0 or copies * log(expected) - lgamma(copies + 1) >= log(CHANCE_OF_REPEATED):
        return None
    copy = int(np.flatnonzero(first[same.reshape(-1)] != np.arange(len(points)))[0])
    of = [(group, line) for group in groups for line in group.lines]
    group, line = of[copy]
    source, before = of[first[same.reshape(-1)[copy]]]
    return group, f"{group.where}: the point of line {line} has the same coordinates as line {before}, {source.where}"


def find_shared(groups: Sequence[PointGroup], before: Sequence[PointGroup]) -> _Copy:
    """Return the first measurement of a test that is one of another test of the campaign, or points of it.

    Lengths are compared as in `find_copy`; groups on a ball or in a seat by their coordinates.
    """
    if groups and before and "end" in groups[0].keys and "end" in before[0].keys:
        return find_copy(groups, before)
    chance = _chance_of_one([*groups, *before])
    for one in groups:
        for other in before:
            if one.artefact != other.artefact:
                continue
            shared = int((one.points[:, None] == other.points).all(axis=2).any(axis=1).sum())
            if 2 * shared > len(one.points) and chance ** (3 * shared) < CHANCE:
                return one, f"{one.where} has {shared} points with the same coordinates as {other.where}"
    return None


def _measurements(groups: Sequence[PointGroup]) -> list[_Measurement]:
    found: dict[_Keys, list[PointGroup]] = {}
    for group in groups:
        keys = (group.artefact, *(value for key, value in group.keys.items() if key != "end"))
        found.setdefault(keys, []).append(group)
    return [_Measurement(keys, sorted(ends, key=lambda one: one.keys.get("end", ""))) for keys, ends in found.items()]


def _pairs(
    later: list[_Measurement], earlier: list[_Measurement] | None
) -> Iterator[tuple[_Measurement, _Measurement]]:
    if earlier is not None:
        return product(later, earlier)
    return ((one, other) for other, one in combinations(later, 2))


def _how_copied(one: _Measurement, other: _Measurement, chance: float) -> str | None:
    """In what two measurements of as many points agree beyond chance: a phrase; None if they do not."""
    n = len(one.points)
    if (is_alike := _agree(one.shape, other.shape)) and np.array_equal(one.points, other.points):
        return "has the same coordinates as" if chance ** (3 * n) < CHANCE else None
    numbers = 3 if n == 2 else 3 * n - 6
    if not chance**numbers < CHANCE:
        return None
    if is_alike:
        return "has its points to each other to 20 nm as"
    # By chance they agree in one of n! orders.
    if n > 2 and numbers * log(chance) + lgamma(n + 1) < log(CHANCE) and _agree_in_some_order(one, other):
        return "has its points, in another order, to each other to 20 nm as"
    return None


def _mean_of_two(measured: list[_Measurement], chance: float) -> _Copy:
    """The first run that is the mean of two others at its place, moved or not."""
    runs: dict[_Keys, list[_Measurement]] = {}
    for one in measured:
        if "repeat" in (of_group := one.groups[0].keys):
            place = (one.keys[0], *(value for key, value in of_group.items() if key not in ("repeat", "end")))
            runs.setdefault(place, []).append(one)
    for at in runs.values():
        centred = {one.keys: one.points - one.points.mean(axis=0) for one in at}
        for one, first, second in permutations(at, 3):
            sizes = {len(each.points) for each in (one, first, second)}
            if first.keys > second.keys or len(sizes) > 1 or not chance ** (3 * sizes.pop() - 3) < CHANCE:
                continue
            if _agree(centred[one.keys], (centred[first.keys] + centred[second.keys]) / 2):
                of = " and ".join(each.groups[0].where for each in (first, second))
                return one.groups[0], f"{one.groups[0].where} is to 20 nm the mean of {of}"
    return None


def _agree(one: FloatArray, other: FloatArray) -> bool:
    off = (one - other).ravel()
    return bool(off @ off <= AGREE_MM**2 * off.size)


def _agree_in_some_order(points: _Measurement, others: _Measurement) -> bool:
    """Whether points lie to each other as others do, each matched with that whose distances are most like its own."""
    if not _agree(points.sorted_shape, others.sorted_shape):
        return False
    one, other = (np.linalg.norm(each.points[:, None] - each.points, axis=2) for each in (points, others))
    own, theirs = (np.sort(each, axis=1) for each in (one, other))
    match = ((own[:, None] - theirs) ** 2).sum(axis=2).argmin(axis=1)
    return len(set(match.tolist())) == len(match) and _agree(one, other[np.ix_(match, match)])


def _chance_of_one(groups: Sequence[PointGroup]) -> float:
    """The chance that a number of two measurements agrees: with coordinates written to few digits it is larger."""
    step = _step(np.concatenate([group.points for group in groups]))
    return min(1.0, max(2 * AGREE_MM, step) / (4 * SCATTER_MM))


def _step(points: FloatArray) -> float:
    """What coordinates are rounded to [mm]; 0 below 0.00001 mm."""
    return next((10.0**-n for n in range(6) if np.abs(points - points.round(n)).max() < 1e-9), 0.0)


def _copied_lengths(later: list[_Measurement], earlier: list[_Measurement] | None, chance: float) -> _Copy:
    """Positions and runs whose lengths agree one by one, and tests of which most lengths agree with another."""
    names = [key for key in later[0].groups[0].keys if key in ("position", "repeat")]
    mm = [{one.keys: _length_mm(one.groups) for one in each} for each in (later, earlier or later)]
    for sought in (some for count in range(len(names), -1, -1) for some in combinations(names, count)):
        at = [2 + names.index(name) for name in sought]
        columns, others = (_columns(each, at) for each in mm)
        for one, other in product(columns, others):
            if earlier is None and one <= other:
                continue
            common = [rest for rest in columns[one] if rest in others[other]]
            if not common or chance ** len(common) >= CHANCE:
                continue
            if _agree(*(np.array([each[rest] for rest in common]) for each in (columns[one], others[other]))):
                copy, source = (
                    ", ".join(map(" ".join, zip(sought, keys, strict=True))) or "the test" for keys in (one, other)
                )
                first = next(each.groups[0] for each in later if tuple(each.keys[i] for i in at) == one)
                return first, f"{copy} has {len(common)} lengths to 20 nm as {source}"
    if earlier is not None or chance > 2 * AGREE_MM / (4 * SCATTER_MM):  # rounded lengths along an axis are equal
        return None
    of_length = _columns(mm[0], [0, 1]).values()
    gaps = np.concatenate([np.diff(sorted(each.values())) for each in of_length])
    same = int((gaps <= AGREE_MM).sum())
    if 2 * same >= len(gaps) and chance**same < CHANCE:
        return later[0].groups[0], f"{same} of {len(later)} measured lengths are to 20 nm as another one"
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
