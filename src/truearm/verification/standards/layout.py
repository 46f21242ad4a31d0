"""Where artefacts stand in the measuring volume, and where and whence they are touched.

The arm stands upright, z up, and works towards x. Places are shares of the reach, which is half the measuring
range. All of them are chosen here, so that near and far, low and high, along, across and oblique occur; what the
standards say of places was recalled and not read:

- probing and articulation: one sphere near, one far (that there are two positions of the probing test: Kreon's page on
  ISO 10360-12);
- lengths: horizontal along and across, vertical, diagonal in planes and in space (recalled);
- seats: one in each of three zones of the reach, 0 to 20 %, 20 to 80 % and 80 to 100 % (recalled);
- volumetric: a length of 50 to 75 %, another of 120 to 150 % of the reach (recalled).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.standards.artefacts import Artefacts, CalibratedBar, CalibratedLength, CalibratedSphere
from truearm.verification.standards.verification_plan import (
    Articulation,
    EffectiveDiameter,
    LengthTest,
    PlannedTest,
    Probing,
    SinglePoint,
    VerificationPlan,
    Volumetric,
)

SHOULDER_SHARE = 0.25
"""Height of the shoulder above the base in shares of the reach, where it is not given: about that of arms in use."""

# Nothing stands farther from the shoulder than this share of the reach: there an arm is stretched out.
FARTHEST = 0.88
# Spheres: horizontal distance from the arm's axis and height above the shoulder in shares of the reach, azimuth [deg].
SPHERES = ((0.42, -0.15, 15.0), (0.65, 0.10, -30.0))
# Seats stand before the arm at the height of its base or a little above; the first and the last zone's middle is where
# few postures reach, so that they stand on its inner side.
SEATS = (0.19, 0.50, 0.82)
SEAT_HEIGHT = -0.15
# Lines of bars: direction, and the direction from the shoulder in which their middle lies.
LINES: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = (
    ((0, 1, 0), (1, 0, -0.3)),  # across
    ((1, 0, 0), (0, 1, -0.3)),  # along, beside the arm
    ((0, 0, 1), (1, 0, 0.2)),  # upright
    ((0, 1, 1), (1, 0, 0)),  # rising to the left
    ((0, -1, 1), (1, 0, 0)),  # rising to the right
    ((1, 0, 1), (0, -1, 0)),  # rising away from the arm, beside it
    ((1, -1, 1), (1, 1, 0)),  # diagonal in space
)
LINE_DISTANCE, NEAREST_LINE = 0.5, 0.15
# More positions than lines: the same again, turned about the arm, by halves of what lies between.
AZIMUTHS_DEG = (
    0.0,
    *(side * 90.0 * odd / 2**level for level in range(1, 8) for odd in range(1, 2**level, 2) for side in (1, -1)),
)
# At two positions of a length one end or the other is so far from where it was [mm]: 10 mm and what the rounding of
# both places to 10 mm in x, y and z can take off, 17.3 mm.
LEAST_APART_MM = 30.0
UPRIGHT = 0.9  # a bar is from here on: the cosine of its lean off the vertical
ZONES = ((0.50, 0.75), (1.20, 1.50))  # of the two volumetric lengths, in shares of the reach: recalled
# Of the probe off the vertical in the groups of an articulation: to the sides and the arm, and beyond the sphere.
LEAN_DEG, LEAN_BEYOND_DEG = 60.0, 40.0


@dataclass(frozen=True, eq=False)
class Placement:
    """One group of points to take: in one go, on one thing that stands in one place.

    Attributes
    ----------
    test : str
        Of the plan: ``probing``, ``uni``, ..
    artefact : str
        Its name in the file of artefacts.
    keys : dict of str to str
        What tells the group from the others of its test, by column of the points file.
    points : (k, 3) array
        Nominal points of contact: on the ball's surface, or the middle of the seat [mm], in the arm's base frame.
    normals : (k, 3) array
        Unit vectors out of the surface there; out of a seat.
    at : (3,) array
        The middle of the ball or seat [mm].
    approach : (k, 3) array
        Unit vectors to where the probe comes from: against them points the stylus. As the normals by default.
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
        """Test and keys in words: ``uni, length 150, position 3, repeat 2, end A``."""
        return ", ".join([self.test, *(f"{key} {value}" for key, value in self.keys.items())])


def lay_out_tests(
    plan: VerificationPlan, artefacts: Artefacts, measuring_range_mm: float, *, shoulder_mm: float | None = None
) -> tuple[Placement, ...]:
    """Lay out the tests that a plan requires, in the order in which an operator measures them.

    Parameters
    ----------
    plan : VerificationPlan
    artefacts : Artefacts
        Of each kind that the plan needs, the first that fits; lengths from all bars: the longest, and others evenly
        spread below it.
    measuring_range_mm : float
        Diameter of the spherical reach [mm].
    shoulder_mm : float, optional
        Height of the middle of that sphere above the base [mm]; `SHOULDER_SHARE` of the reach by default.

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
        raise InputError(f"the plan {plan.name!r} requires no test", hint="required = true where a test is wanted")
    stations: dict[tuple[int, float], list[Placement]] = {}  # what is measured before an artefact is moved
    for order, (name, test) in enumerate(needed.items()):
        for station, placement in _placements(room, name, test):
            # Tests on spheres share their stations; each other test has its own.
            kind = 0 if isinstance(test, Probing | Articulation | EffectiveDiameter) else 1 + order
            stations.setdefault((kind, station), []).append(placement)
    return tuple(placement for key in sorted(stations) for placement in stations[key])


def hemisphere(n: int) -> FloatArray:
    """Unit vectors evenly over the hemisphere about z, (n, 3), the pole first.

    25: rows of 1, 4, 8, 4 and 8 at 0, 22.5, 45, 67.5 and 90 deg from the pole, each turned by 22.5 deg against the one
    before (ISO 10360-5, recalled). 9: the pole, 4 at 45 deg, 4 on the equator (ASME B89.4.22, recalled). 5: the pole
    and 4 on the equator (recalled). Other numbers: a spiral of even area (chosen here).
    """
    rows: dict[int, tuple[tuple[int, float, float], ...]] = {
        5: ((1, 0, 0), (4, 90, 0)),
        9: ((1, 0, 0), (4, 45, 0), (4, 90, 45)),
        25: ((1, 0, 0), (4, 22.5, 0), (8, 45, 22.5), (4, 67.5, 45), (8, 90, 67.5)),
    }
    if n in rows:
        polar = np.radians(np.concatenate([np.full(count, angle) for count, angle, _ in rows[n]]))
        turn = np.radians(np.concatenate([start + 360 * np.arange(count) / count for count, _, start in rows[n]]))
    else:
        polar = np.arccos(1 - np.arange(n) / max(n - 1, 1))
        turn = np.pi * (1 + np.sqrt(5)) * np.arange(n)  # the golden angle
    return np.column_stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)])


def directions(n: int, azimuth: float) -> FloatArray:
    """Where the probe comes from in the groups of an articulation, (n, 3): above, then all round, 40 to 60 deg off it.

    Parameters
    ----------
    n : int
    azimuth : float
        Of the sphere about the arm [rad]: the second direction is back to the arm.
    """
    turn = azimuth + np.pi + 2 * np.pi * np.arange(n - 1) / max(n - 1, 1)
    beyond = np.maximum(0.0, np.cos(turn - azimuth))  # where the hand must reach over
    lean = np.radians(LEAN_DEG + (LEAN_BEYOND_DEG - LEAN_DEG) * beyond)
    round_it = np.column_stack([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.cos(lean)])
    return np.concatenate([[[0.0, 0.0, 1.0]], round_it])


def select_sphere(
    artefacts: Artefacts, name: str, test: Probing | Articulation | EffectiveDiameter
) -> CalibratedSphere:
    """The first sphere of a size that the plan allows."""
    smallest, largest = test.smallest_sphere_mm.value, test.largest_sphere_mm.value
    for sphere in artefacts.spheres:
        if smallest <= sphere.diameter_mm <= largest:
            return sphere
    raise InputError(
        f"test {name!r} needs a sphere of {smallest:g} to {largest:g} mm, the file of artefacts has none",
        hint="add it under [[spheres]]",
    )


def select_lengths(
    artefacts: Artefacts, name: str, test: LengthTest | Volumetric, measuring_range_mm: float
) -> tuple[tuple[CalibratedBar, CalibratedLength], ...]:
    """As many calibrated lengths as the plan wants, from all bars, in growing order."""
    pool = sorted(((bar, length) for bar in artefacts.bars for length in bar.lengths), key=lambda one: one[1].length_mm)
    n, reach = test.lengths.value, measuring_range_mm / 2
    if len(pool) < n:
        raise InputError(
            f"test {name!r} needs {n} calibrated lengths, the file of artefacts has {len(pool)}",
            hint="add them under [[bars]]" + (f", or {_fewer(name, test, pool, measuring_range_mm)}" if pool else ""),
        )
    longest = pool[-1][1].length_mm
    least = test.longest_share.value * measuring_range_mm
    if longest < least:
        raise InputError(
            f"test {name!r} needs a length of {least:.5g} mm or more, {test.longest_share.value:.0%} of the "
            f"measuring range; the longest in the file of artefacts is {longest:.5g} mm",
            hint="a longer bar, or longest_share in the plan as your copy of the standard has it",
        )
    wanted = np.linspace(longest, pool[0][1].length_mm, n)  # the longest first: it is the one that must be
    if isinstance(test, Volumetric) and n == len(ZONES):
        wanted = reach * np.mean(ZONES, axis=1)
    taken: list[int] = []
    for want in wanted:
        free = [i for i in range(len(pool)) if i not in taken]
        taken.append(min(free, key=lambda i: abs(pool[i][1].length_mm - want)))
    return tuple(pool[i] for i in sorted(taken))


def _fewer(
    name: str,
    test: LengthTest | Volumetric,
    pool: Sequence[tuple[CalibratedBar, CalibratedLength]],
    measuring_range_mm: float,
) -> str:
    """What a plan says that makes do with the lengths there are."""
    changed = [f"{name}.lengths = {len(pool)}"]
    share = floor(100 * pool[-1][1].length_mm / measuring_range_mm) / 100
    if share < test.longest_share.value:
        changed.append(f"{name}.longest_share = {share:g}")
    return f"agree on a plan with {' and '.join(changed)} (truearm verify --print-plan writes one to edit)"


def lines(
    name: str, positions: int, lengths_mm: Sequence[float], reach_mm: float, shoulder_mm: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Where a bar lies: where all its lengths begin (3,) [mm] and its direction (3,), for each position.

    No length lies twice in one place, also not turned end for end: some lines, turned about the arm, are others.

    Parameters
    ----------
    name : str
        Of the test, for messages.
    positions : int
        How many.
    lengths_mm : sequence of float
        In growing order [mm].
    reach_mm, shoulder_mm : float
        Radius of the spherical reach and height of its middle above the base [mm].

    Raises
    ------
    InputError
        If the longest length is too long to be reached at both ends, or there are not as many different places.
    """
    longest, found = lengths_mm[-1], []
    taken = np.empty((0, len(lengths_mm), 2, 3))  # the ends of each length at each position so far
    for candidate in range(len(AZIMUTHS_DEG) * len(LINES)):
        middle, along = _line(candidate, longest, reach_mm, shoulder_mm)
        start = middle - longest / 2 * along
        ends = np.array([[start, start + length * along] for length in lengths_mm])
        away, turned = (np.linalg.norm(taken - one, axis=3).max(axis=2) for one in (ends, ends[:, ::-1]))
        if (np.minimum(away, turned) < LEAST_APART_MM).any():
            continue
        taken = np.concatenate([taken, ends[None]])
        found.append((start, along))
        if len(found) == positions:
            return found
    raise InputError(
        f"test {name!r}: a length of {longest:.5g} mm has {len(found)} places {LEAST_APART_MM:g} mm apart before an "
        f"arm with a reach of {reach_mm:.5g} mm, the plan wants {positions}",
        hint="fewer positions in the plan, or the measuring range as the specification has it",
    )


def _line(candidate: int, longest_mm: float, reach_mm: float, shoulder_mm: float) -> tuple[FloatArray, FloatArray]:
    """The middle of a bar's longest length (3,) [mm] and the bar's direction (3,): all lines, then all turned."""
    along, towards = (np.array(one, dtype=float) for one in LINES[candidate % len(LINES)])
    along /= np.linalg.norm(along)
    towards /= np.linalg.norm(towards)
    half, lean = longest_mm / 2, abs(float(along @ towards))
    room = (FARTHEST * reach_mm) ** 2 - half**2
    # The far end, at |d t + l a| from the shoulder, is to be within.
    most = np.sqrt((half * lean) ** 2 + room) - half * lean if room > 0 else 0.0
    if most < NEAREST_LINE * reach_mm:
        raise InputError(
            f"a length of {longest_mm:.5g} mm has no place before an arm with a reach of {reach_mm:.5g} mm",
            hint="a shorter bar, or the measuring range as the specification has it",
        )
    away = min(LINE_DISTANCE * reach_mm, float(most))
    turn = _about_z(AZIMUTHS_DEG[candidate // len(LINES)])
    return turn @ (away * towards) + [0.0, 0.0, shoulder_mm], turn @ along


@dataclass(frozen=True, eq=False)
class _Room:
    """What there is to lay out with."""

    artefacts: Artefacts
    reach: float
    shoulder: float

    def sphere_at(self, station: int) -> FloatArray:
        """The middle of a sphere at a station, (3,) [mm]; more stations than two lie on in azimuth."""
        away, height, azimuth = SPHERES[station % len(SPHERES)]
        out = _about_z(azimuth + 50.0 * (station // len(SPHERES))) @ [away * self.reach, 0.0, 0.0]
        out[2] = self.shoulder + height * self.reach
        return out


def _placements(room: _Room, name: str, test: PlannedTest) -> Iterator[tuple[float, Placement]]:
    """The groups of a test, each with the station at which it is taken."""
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
    # The stylus leans half way between the normal and the pole, as near the table the hand has no room.
    approach = normals + [0.0, 0.0, 1.0]
    approach /= np.linalg.norm(approach, axis=1, keepdims=True)
    return Placement(name, sphere.name, keys, middle + sphere.diameter_mm / 2 * normals, normals, middle, approach)


def _half_way(room: _Room) -> FloatArray:
    return _about_z(-25.0) @ [0.5 * room.reach, 0.0, 0.0] + [0.0, 0.0, room.shoulder - 0.2 * room.reach]


def _articulation(room: _Room, name: str, test: Articulation, station: int) -> Iterator[Placement]:
    sphere = select_sphere(room.artefacts, name, test)
    middle = room.sphere_at(station)
    for i, direction in enumerate(directions(test.groups.value, float(np.arctan2(middle[1], middle[0])))):
        normals = hemisphere(test.points.value) @ _frame_about(direction).T
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
        raise InputError(f"test {name!r} needs a seat, the file of artefacts has none", hint="add it under [[seats]]")
    n, seat = test.positions.value, room.artefacts.seats[0]
    shares = SEATS if n == len(SEATS) else np.linspace(SEATS[0], SEATS[-1], n) if n > 1 else SEATS[1:2]
    for i, share in enumerate(shares):
        at = np.array([share * room.reach, 0.0, room.shoulder + SEAT_HEIGHT * room.reach])
        up = np.tile([0.0, 0.0, 1.0], (test.points.value, 1))
        yield i, Placement(name, seat.name, {"position": str(i + 1)}, np.tile(at, (len(up), 1)), up, at, up)


def _bars(room: _Room, name: str, test: LengthTest) -> Iterator[tuple[float, Placement]]:
    lengths = select_lengths(room.artefacts, name, test, 2 * room.reach)
    lengths_mm = [length.length_mm for _, length in lengths]  # all begin at the same ball
    places = lines(name, test.positions.value, lengths_mm, room.reach, room.shoulder)
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
        lines(name, len(range(i, n, len(lengths))), [length.length_mm], room.reach, room.shoulder)
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
    """Both ends of a length: one point each, in a seat or the middle of a ball, or on faces that look apart."""
    for end, at, outward in (("A", start, -along), ("B", start + length.length_mm * along, along)):
        normal = outward if opposite else seat_normal(along, at)
        approach = normal
        if not opposite and abs(along[2]) > UPRIGHT and at[2] < shoulder_mm:  # down there it comes from above
            approach = (normal + [0.0, 0.0, 0.5]) / np.linalg.norm(normal + [0.0, 0.0, 0.5])
        yield Placement(name, bar.name, {**keys, "end": end}, at[None], normal[None], at, approach[None])


def seat_normal(along: FloatArray, at: FloatArray) -> FloatArray:
    """Which way the seats of a bar look: across the bar, up as far as that goes; of an upright bar, towards the arm."""
    look = np.array([0.0, 0.0, 1.0])
    if abs(along[2]) > UPRIGHT:
        look = np.array([-at[0], -at[1], 0.0])
    across: FloatArray = look - (look @ along) * along
    return across / np.linalg.norm(across)


def _frame_about(axis: FloatArray) -> FloatArray:
    """(3, 3) frame whose z is a unit vector, its x as level as can be."""
    x = np.cross([0.0, 0.0, 1.0], axis)
    x = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(x) < 1e-9 else x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def _about_z(angle_deg: float) -> FloatArray:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
