"""The layout of a test plan: which artefact stands where, and the points and directions in which it is touched.

Lengths are shares of the measuring range, as the plan asks for them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import floor

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.artefacts import Artefacts, CalibratedBar, CalibratedLength, CalibratedSphere
from truearm.wings.laboratory.standards.positions import (
    SEAT_HEIGHT,
    SEATS,
    SHOULDER_SHARE,
    SPHERES,
    UPRIGHT,
    ZONES,
    about_z,
    bar_lines,
    directions,
    frame_about,
    hemisphere,
    seat_normal,
)
from truearm.wings.laboratory.standards.verification_plan import (
    Articulation,
    EffectiveDiameter,
    LengthTest,
    PlannedTest,
    Probing,
    SinglePoint,
    VerificationPlan,
    Volumetric,
)

# Sizes and shares are compared with the rounding of their arithmetic.
_ROUNDING = 1e-9


def length_fault(
    name: str, test: LengthTest | Volumetric, lengths_mm: Sequence[float], measuring_range_mm: float
) -> tuple[str, str] | None:
    """Return what is wrong with the sizes of a test's lengths, and what to do; None if they are as planned.

    Parameters
    ----------
    name : str
        Of the test.
    test : LengthTest or Volumetric
    lengths_mm : sequence of float
        The calibrated lengths [mm].
    measuring_range_mm : float
        Diameter of the spherical reach [mm].

    Returns
    -------
    (str, str) or None
        Problem and hint.
    """
    sizes = sorted(map(float, lengths_mm))
    for which, length_mm, key, share, is_least in _bounds(test, sizes):
        needed = share * measuring_range_mm
        if length_mm < needed * (1 - _ROUNDING) if is_least else length_mm > needed * (1 + _ROUNDING):
            side, bar = ("more", "longer") if is_least else ("less", "shorter")
            problem = (
                f"test {name!r}: the {which} length is {length_mm:.5g} mm, the plan asks for {needed:.5g} mm or "
                f"{side}, {100 * share:.3g}% of the measuring range"
            )
            return problem, f"use a {bar} bar, or correct {key} in the plan by your copy of the standard"
    if isinstance(test, LengthTest) and sizes[-1] > sizes[0]:
        widest, mean = max(b - a for a, b in pairwise(sizes)), (sizes[-1] - sizes[0]) / (len(sizes) - 1)
        if widest > test.gap_ratio.value * mean * (1 + _ROUNDING):
            problem = (
                f"test {name!r}: the widest gap between two of its {len(sizes)} lengths is {widest:.4g} mm, "
                f"{widest / mean:.2g} times the mean one; the plan asks for {test.gap_ratio.value:g} times or less"
            )
            return problem, "use lengths that lie evenly, or correct gap_ratio in the plan by your copy of the standard"
    return None


def _bounds(test: LengthTest | Volumetric, sizes: Sequence[float]) -> Iterator[tuple[str, float, str, float, bool]]:
    """Which length, its size [mm], the key of the share and its value, and whether that is the least size."""
    shortest, longest = sizes[0], sizes[-1]
    yield "longest", longest, "longest_share", test.longest_share.value, True
    if isinstance(test, Volumetric):
        yield "longest", longest, "longest_most_share", test.longest_most_share.value, False
    if len(sizes) > 1:  # a single length is the longest
        yield "shortest", shortest, "shortest_most_share", test.shortest_most_share.value, False
        if isinstance(test, Volumetric):
            yield "shortest", shortest, "shortest_share", test.shortest_share.value, True


# Points on a face lie this far from its middle [mm]: the face of a gauge block is 9 mm wide.
FACE_MM = 3.5


@dataclass(frozen=True, eq=False)
class Placement:
    """A group of points to measure on one artefact at one position.

    Attributes
    ----------
    test : str
        Name of the test: ``probing``, ``uni``, ..
    artefact : str
        Its name in the file of artefacts.
    keys : dict of str to str
        Position, repeat, end etc. of the group, by column of the points file.
    points : (k, 3) array
        Nominal points of contact, on the ball's surface or at the centre of the seat, in the arm's base frame [mm].
    normals : (k, 3) array
        Outward unit normals of the surface or the seat.
    at : (3,) array
        Centre of the ball or seat [mm].
    approach : (k, 3) array
        Unit vectors from the artefact to the stylus.
    """

    test: str
    artefact: str
    keys: Mapping[str, str]
    points: FloatArray
    normals: FloatArray
    at: FloatArray
    approach: FloatArray

    @property
    def where(self) -> str:
        """Test and keys: ``uni, length 150, position 3, repeat 2, end A``."""
        return ", ".join([self.test, *(f"{key} {value}" for key, value in self.keys.items())])


def lay_out_tests(
    plan: VerificationPlan, artefacts: Artefacts, measuring_range_mm: float, *, shoulder_mm: float | None = None
) -> tuple[Placement, ...]:
    """Lay out the required tests of a plan, in the order in which an operator measures them.

    Parameters
    ----------
    plan : VerificationPlan
    artefacts : Artefacts
        The first artefact of each kind that fits the plan is used; the lengths come from all bars: the longest one, and
        others evenly spread below it.
    measuring_range_mm : float
        Diameter of the spherical reach [mm].
    shoulder_mm : float, optional
        Height of the centre of that sphere above the base [mm]; `SHOULDER_SHARE` of the reach by default.

    Returns
    -------
    tuple of Placement

    Raises
    ------
    InputError
        If an artefact that a test needs is missing or does not fit the plan or the measuring range.
    """
    if not (np.isfinite(measuring_range_mm) and measuring_range_mm > 0):
        raise InputError(f"expected a positive measuring range in mm, got {measuring_range_mm}")
    reach = measuring_range_mm / 2
    room = _Room(artefacts, reach, SHOULDER_SHARE * reach if shoulder_mm is None else shoulder_mm)
    needed = {name: test for name, test in plan.tests.items() if test.required}
    if not needed:
        raise InputError(
            f"the plan {plan.name!r} requires no test", hint="write required = true in the tests to lay out"
        )
    stations: dict[tuple[int, float], list[Placement]] = {}  # placements between two moves of an artefact
    for order, (name, test) in enumerate(needed.items()):
        for station, placement in _placements(room, name, test):
            # Tests on spheres share their stations; each other test has its own.
            kind = 0 if isinstance(test, Probing | Articulation | EffectiveDiameter) else 1 + order
            stations.setdefault((kind, station), []).append(placement)
    return tuple(placement for key in sorted(stations) for placement in stations[key])


def select_sphere(
    artefacts: Artefacts, name: str, test: Probing | Articulation | EffectiveDiameter
) -> CalibratedSphere:
    """Return the first sphere of a size that the plan allows."""
    smallest, largest = test.smallest_sphere_mm.value, test.largest_sphere_mm.value
    for sphere in artefacts.spheres:
        if smallest <= sphere.diameter_mm <= largest:
            return sphere
    raise InputError(
        f"test {name!r} needs a sphere of {smallest:g} to {largest:g} mm, the file of artefacts has none",
        hint="add a sphere under [[spheres]]",
    )


def select_lengths(
    artefacts: Artefacts, name: str, test: LengthTest | Volumetric, measuring_range_mm: float
) -> tuple[tuple[CalibratedBar, CalibratedLength], ...]:
    """Return as many calibrated lengths as the plan asks for, from all bars, in increasing order."""
    pool = sorted(((bar, length) for bar in artefacts.bars for length in bar.lengths), key=lambda one: one[1].length_mm)
    n, reach = test.lengths.value, measuring_range_mm / 2
    if len(pool) < n:
        raise InputError(
            f"test {name!r} needs {n} calibrated lengths, the file of artefacts has {len(pool)}",
            hint="add them under [[bars]]" + (f", or {_fewer(name, test, pool, measuring_range_mm)}" if pool else ""),
        )
    longest = pool[-1][1].length_mm
    wanted = np.linspace(longest, pool[0][1].length_mm, n)  # the longest is compulsory: it comes first
    if isinstance(test, Volumetric) and n == len(ZONES):
        wanted = reach * np.mean(ZONES, axis=1)
    chosen: list[int] = []
    for want in wanted:
        free = [i for i in range(len(pool)) if i not in chosen]
        chosen.append(min(free, key=lambda i: abs(pool[i][1].length_mm - want)))
    selected = tuple(pool[i] for i in sorted(chosen))
    if fault := length_fault(name, test, [length.length_mm for _, length in selected], measuring_range_mm):
        raise InputError(fault[0], hint=fault[1])
    return selected


def _fewer(
    name: str,
    test: LengthTest | Volumetric,
    pool: Sequence[tuple[CalibratedBar, CalibratedLength]],
    measuring_range_mm: float,
) -> str:
    """The changes of a plan for which the available lengths are sufficient."""
    changed = [f"{name}.lengths = {len(pool)}"]
    share = floor(100 * pool[-1][1].length_mm / measuring_range_mm) / 100
    if share < test.longest_share.value:
        changed.append(f"{name}.longest_share = {share:g}")
    return f"use a plan with {' and '.join(changed)} (truearm verify plan writes one to edit)"


@dataclass(frozen=True, eq=False)
class _Room:
    """The artefacts and the measuring volume."""

    artefacts: Artefacts
    reach: float
    shoulder: float

    def sphere_at(self, station: int) -> FloatArray:
        """The centre of a sphere at a station, (3,) [mm]; stations after the second have other azimuths."""
        away, height, azimuth = SPHERES[station % len(SPHERES)]
        out = about_z(azimuth + 50.0 * (station // len(SPHERES))) @ [away * self.reach, 0.0, 0.0]
        out[2] = self.shoulder + height * self.reach
        return out


def _placements(room: _Room, name: str, test: PlannedTest) -> Iterator[tuple[float, Placement]]:
    """The groups of a test, each with its station."""
    if isinstance(test, Probing):
        for station in range(test.positions.value):
            keys = {"position": str(station + 1)}
            yield station, _hemisphere_on(room, name, test, station, keys)
    elif isinstance(test, EffectiveDiameter):
        for repeat in range(test.repeats.value):
            yield 0.5, _hemisphere_on(room, name, test, 0.5, {"repeat": str(repeat + 1)})
    elif isinstance(test, Articulation):
        for station in range(test.positions.value):
            yield from ((station, one) for one in _articulation(room, name, test, station))
    elif isinstance(test, SinglePoint):
        yield from _seats(room, name, test)
    elif isinstance(test, LengthTest):
        yield from _bars(room, name, test)
    else:
        assert isinstance(test, Volumetric)
        yield from _volumetric(room, name, test)


def _hemisphere_on(
    room: _Room, name: str, test: Probing | EffectiveDiameter, station: float, keys: dict[str, str]
) -> Placement:
    sphere = select_sphere(room.artefacts, name, test)
    # Effective diameter: at about half the reach (recalled).
    middle = room.sphere_at(int(station)) if station == int(station) else _half_way(room)
    normals = hemisphere(test.points.value)
    # The stylus points half way between the normal and the pole: near the table the hand has no room.
    approach = normals + [0.0, 0.0, 1.0]
    approach /= np.linalg.norm(approach, axis=1, keepdims=True)
    return Placement(name, sphere.name, keys, middle + sphere.diameter_mm / 2 * normals, normals, middle, approach)


def _half_way(room: _Room) -> FloatArray:
    return about_z(-25.0) @ [0.5 * room.reach, 0.0, 0.0] + [0.0, 0.0, room.shoulder - 0.2 * room.reach]


def _articulation(room: _Room, name: str, test: Articulation, station: int) -> Iterator[Placement]:
    sphere = select_sphere(room.artefacts, name, test)
    middle = room.sphere_at(station)
    for i, direction in enumerate(directions(test.groups.value, float(np.arctan2(middle[1], middle[0])))):
        normals = hemisphere(test.points.value) @ frame_about(direction).T
        yield Placement(
            name,
            sphere.name,
            {"position": str(station + 1), "group": group_name(i)},
            middle + sphere.diameter_mm / 2 * normals,
            normals,
            middle,
            np.tile(direction, (len(normals), 1)),
        )


def group_name(i: int) -> str:
    """A, B, .. Z, then 27, 28, .."""
    return chr(ord("A") + i) if i < 26 else str(i + 1)


def _seats(room: _Room, name: str, test: SinglePoint) -> Iterator[tuple[float, Placement]]:
    if not room.artefacts.seats:
        raise InputError(
            f"test {name!r} needs a seat, the file of artefacts has none", hint="add a seat under [[seats]]"
        )
    n, seat = test.positions.value, room.artefacts.seats[0]
    shares = SEATS if n == len(SEATS) else np.linspace(SEATS[0], SEATS[-1], n) if n > 1 else SEATS[1:2]
    for i, share in enumerate(shares):
        at = np.array([share * room.reach, 0.0, room.shoulder + SEAT_HEIGHT * room.reach])
        up = np.tile([0.0, 0.0, 1.0], (test.points.value, 1))
        yield i, Placement(name, seat.name, {"position": str(i + 1)}, np.tile(at, (len(up), 1)), up, at, up)


def _bars(room: _Room, name: str, test: LengthTest) -> Iterator[tuple[float, Placement]]:
    lengths = select_lengths(room.artefacts, name, test, 2 * room.reach)
    lengths_mm = [length.length_mm for _, length in lengths]  # all begin at the same ball
    places = bar_lines(name, test.positions.value, lengths_mm, room.reach, room.shoulder)
    for position, (start, along) in enumerate(places):
        for repeat in range(test.repeats.value):
            for bar, length in lengths:
                keys = {"length": length.name, "position": str(position + 1), "repeat": str(repeat + 1)}
                for end in _ends(
                    name, bar, length, keys, start, along, shoulder_mm=room.shoulder, opposite=name == "bi"
                ):
                    yield position, end


def _volumetric(room: _Room, name: str, test: Volumetric) -> Iterator[tuple[float, Placement]]:
    lengths = select_lengths(room.artefacts, name, test, 2 * room.reach)
    n = test.positions.value  # in all, over the lengths in turn
    places = [
        bar_lines(name, len(range(i, n, len(lengths))), [length.length_mm], room.reach, room.shoulder)
        for i, (_, length) in enumerate(lengths[:n])
    ]
    for position in range(n):
        bar, length = lengths[position % len(lengths)]
        start, along = places[position % len(lengths)][position // len(lengths)]
        keys = {"length": length.name, "position": str(position + 1)}
        for end in _ends(name, bar, length, keys, start, along, shoulder_mm=room.shoulder, opposite=False):
            yield position, end


def _ends(
    name: str,
    bar: CalibratedBar,
    length: CalibratedLength,
    keys: Mapping[str, str],
    start: FloatArray,
    along: FloatArray,
    *,
    shoulder_mm: float,
    opposite: bool,
) -> Iterator[Placement]:
    """Both ends of a length: a point each, in a seat or at the centre of a ball, or one or three on opposite faces."""
    beside = np.zeros((1, 3))
    if opposite and bar.u_alignment_mm is None:
        turns = np.radians([90.0, 210.0, 330.0])
        beside = FACE_MM * np.stack([np.cos(turns), np.sin(turns), np.zeros(3)], axis=1) @ frame_about(along).T
    for end, at, outward in (("A", start, -along), ("B", start + length.length_mm * along, along)):
        normal = outward if opposite else seat_normal(along, at)
        approach = normal
        if not opposite and abs(along[2]) > UPRIGHT and at[2] < shoulder_mm:  # low seats are touched from above
            approach = (normal + [0.0, 0.0, 0.5]) / np.linalg.norm(normal + [0.0, 0.0, 0.5])
        normals, approaches = (np.tile(one, (len(beside), 1)) for one in (normal, approach))
        yield Placement(name, bar.name, {**keys, "end": end}, at + beside, normals, at, approaches)
