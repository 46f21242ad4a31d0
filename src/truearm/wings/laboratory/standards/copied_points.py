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
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

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
# Points that are the same to the last digit are certain to be copies where the chance is less, of all pairs of a test
# together; they are remarked where it is less than the second.
CERTAIN_CHANCE, REMARKED_CHANCE = 1e-4, 1e-2
# Points nearer than this are at one place; they scatter by the second or more where no others show it [mm].
PLACE_MM, LEAST_MM = 0.5, 1e-3
# Where none of equal vectors between points is seen, as many may be expected (95 %).
UNSEEN = 3.0


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


def find_repeated(groups: Sequence[PointGroup]) -> tuple[PointGroup, str, bool] | None:
    """Return the group of a point of a test that repeats another one, how, and whether it is certain to be a copy.

    Honest points repeat where digits or encoders are coarse against the scatter. How often is known by two signs: the
    spread of points at one place against their step, and vectors between them that are the same, as on any grid.
    Certain is a point stored twice in a row, or at two positions, on no grid; and a block of rows, or more copies than
    any grid explains that shows so few equal vectors.

    Returns
    -------
    (PointGroup, str, bool) or None
        None where points repeat no more often than by chance.
    """
    points = np.concatenate([group.points for group in groups])
    first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)[1:]
    source, n = first[same.reshape(-1)], len(points)
    copies = np.flatnonzero(source != np.arange(n))
    if len(copies) == 0:
        return None
    of = [(group, line) for group in groups for line in group.lines]
    places = _Places.of(points[first], max(_step(points), 1e-6))
    tree = cKDTree(points)
    pairs = (tree.count_neighbors(tree, PLACE_MM) - n) / 2
    twice = [
        i
        for i in copies
        if of[i][0].keys.get("position") != of[source[i]][0].keys.get("position")
        or (of[i][0] is of[i - 1][0] and source[i - 1] == source[i])
    ]
    is_twice = len(twice) == len(copies)  # on a grid, points that do not follow each other repeat too
    seen = places.alike(0.0)
    if min(_chance_of_many(len(copies), pairs * seen), n * seen if is_twice else 1.0) >= REMARKED_CHANCE:
        return None
    # The longest block whose rows repeat rows in the same order.
    broken = (np.diff(copies) != 1) | (np.diff(source[copies]) != 1)
    block = max(map(len, np.split(copies, np.flatnonzero(broken) + 1)))
    most = places.alike(UNSEEN)
    certain = (
        (is_twice and places.equal == 0 and n * places.chance < CERTAIN_CHANCE)
        or (block > 1 and n**2 / 2 * most**block < CERTAIN_CHANCE)
        or _chance_of_many(len(copies), pairs * most) < CERTAIN_CHANCE
    )
    copy = int(twice[0] if twice else copies[0])
    (group, line), (other, before) = of[copy], of[source[copy]]
    said = f"{group.where}: the point of line {line} has the same coordinates as line {before}, {other.where}"
    return group, said, certain


@dataclass(frozen=True)
class _Places:
    """Vectors between different points at one place, and by them how often two points are the same by chance.

    `chance` is that of a pair by the spread of the vectors against the step of the digits, whatever directions the
    spread has. Of `compared` pairs of vectors at one place `equal` are the same.
    """

    chance: float
    equal: float
    compared: float

    @classmethod
    def of(cls, points: FloatArray, step: float) -> _Places:
        near = cKDTree(points).query_pairs(PLACE_MM, output_type="ndarray")
        if len(near) == 0:
            return cls((step / (4 * LEAST_MM)) ** 3, 0.0, 0.0)
        vectors = points[near[:, 1]] - points[near[:, 0]]
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(vectors.T @ vectors / len(vectors)), 1e-18))
        chance = float(np.prod(np.minimum(1.0, step / (np.sqrt(2 * np.pi) * spread))))
        graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(points), len(points)))
        place = connected_components(graph, directed=False)[1][near[:, 0]]
        apart = 10 * PLACE_MM * place[:, None]
        tree, turned = (cKDTree(np.hstack([each, apart])) for each in (vectors, -vectors))
        # Of four rounded points; on the grid of the digits its neighbours count too.
        within = 1.01 * step
        equal = (tree.count_neighbors(tree, within) - len(near) + tree.count_neighbors(turned, within)) / 2
        of_place = np.bincount(place).astype(float)
        return cls(chance, float(equal), float((of_place * (of_place - 1)).sum() / 2))

    def alike(self, unseen: float) -> float:
        """The chance that a pair is the same, by the larger sign; `unseen` equal vectors more may be expected.

        Vectors of a normal spread are equal 2**1.5 times more rarely than points: by sqrt(2) in each direction.
        """
        equal = self.equal + unseen
        by_grid = min(1.0, 2**1.5 * equal / self.compared) if self.compared else float(unseen > 0)
        return max(self.chance, by_grid)


def _chance_of_many(n: int, expected: float) -> float:
    """An upper bound of the chance of n or more (Poisson)."""
    return float(np.exp(min(0.0, n * log(expected) - lgamma(n + 1))))


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
