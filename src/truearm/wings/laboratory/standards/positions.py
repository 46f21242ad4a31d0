"""Positions in the measuring volume and directions of the stylus: where spheres, seats and bars can stand.

The arm stands upright, z up, and works towards x. Positions are shares of the reach, which is half the measuring range.
All are chosen here, so that near and far, low and high, along, across and oblique positions occur; what the standards
state about positions is recalled, not confirmed:

- probing and articulation: one sphere near, one far (that the probing test has two positions: Kreon's page on
  ISO 10360-12);
- lengths: horizontal along and across, vertical, diagonal in planes and in space (recalled);
- seats: one in each of three zones of the reach, 0 to 20 %, 20 to 80 % and 80 to 100 % (recalled);
- volumetric: a length of 50 to 75 %, another of 120 to 150 % of the reach (recalled).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray

SHOULDER_SHARE = 0.25
"""Height of the shoulder above the base as a share of the reach, where it is not given; typical of arms in use."""

# The farthest position from the shoulder as a share of the reach: beyond, an arm is stretched out.
FARTHEST = 0.88
# Spheres: horizontal distance from the arm's axis and height above the shoulder in shares of the reach, azimuth [deg].
SPHERES = ((0.42, -0.15, 15.0), (0.65, 0.10, -30.0))
# Seats stand before the arm at the height of its base or a little above. Few postures reach the centres of the first
# and the last zone: the seats stand nearer to the middle of the reach.
SEATS = (0.19, 0.50, 0.82)
SEAT_HEIGHT = -0.15
# Lines of bars: direction of the bar, and direction from the shoulder to its middle.
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
# For more positions than lines, the lines are turned about the arm, by successive halves of the angle between them.
AZIMUTHS_DEG = (
    0.0,
    *(side * 90.0 * odd / 2**level for level in range(1, 8) for odd in range(1, 2**level, 2) for side in (1, -1)),
)
# The least distance of one of the ends between two positions of a length [mm]: 10 mm, and 17.3 mm that the rounding of
# both positions to 10 mm in x, y and z can remove.
LEAST_APART_MM = 30.0
UPRIGHT = 0.9  # the least cosine of the angle between an upright bar and the vertical
ZONES = ((0.50, 0.75), (1.20, 1.50))  # of the two volumetric lengths, in shares of the reach: recalled
# Angle between stylus and vertical in the groups of an articulation: to the sides and the arm, and beyond the sphere.
LEAN_DEG, LEAN_BEYOND_DEG = 60.0, 40.0


def hemisphere(n: int) -> FloatArray:
    """Return unit vectors evenly over the hemisphere about z, (n, 3), the pole first.

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
    """Return the directions to the stylus in the groups of an articulation, (n, 3): from above, then all round it.

    Parameters
    ----------
    n : int
    azimuth : float
        Azimuth of the sphere about the arm [rad]; the second direction points back to the arm.
    """
    turn = azimuth + np.pi + 2 * np.pi * np.arange(n - 1) / max(n - 1, 1)
    beyond = np.maximum(0.0, np.cos(turn - azimuth))  # where the hand reaches over the sphere
    lean = np.radians(LEAN_DEG + (LEAN_BEYOND_DEG - LEAN_DEG) * beyond)
    round_it = np.column_stack([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.cos(lean)])
    return np.concatenate([[[0.0, 0.0, 1.0]], round_it])


def bar_lines(
    name: str, positions: int, lengths_mm: Sequence[float], reach_mm: float, shoulder_mm: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the positions of a bar: the point (3,) [mm] where all its lengths begin, and its direction (3,).

    No length has the same position twice, nor turned end for end.

    Parameters
    ----------
    name : str
        Name of the test, for messages.
    positions : int
        Number of positions.
    lengths_mm : sequence of float
        In growing order [mm].
    reach_mm, shoulder_mm : float
        Radius of the spherical reach and height of its middle above the base [mm].

    Raises
    ------
    InputError
        If the arm cannot reach both ends of the longest length, or there are too few different positions.
    """
    longest, lines = lengths_mm[-1], []
    used = np.empty((0, len(lengths_mm), 2, 3))  # the ends of each length at each position so far
    for candidate in range(len(AZIMUTHS_DEG) * len(LINES)):
        middle, along = _line(candidate, longest, reach_mm, shoulder_mm)
        start = middle - longest / 2 * along
        ends = np.array([[start, start + length * along] for length in lengths_mm])
        away, turned = (np.linalg.norm(used - one, axis=3).max(axis=2) for one in (ends, ends[:, ::-1]))
        if (np.minimum(away, turned) < LEAST_APART_MM).any():
            continue
        used = np.concatenate([used, ends[None]])
        lines.append((start, along))
        if len(lines) == positions:
            return lines
    raise InputError(
        f"test {name!r}: a length of {longest:.5g} mm has {len(lines)} positions {LEAST_APART_MM:g} mm apart before an "
        f"arm with a reach of {reach_mm:.5g} mm, the plan asks for {positions}",
        hint="reduce the positions in the plan, or correct the measuring range in the specification",
    )


def _line(candidate: int, longest_mm: float, reach_mm: float, shoulder_mm: float) -> tuple[FloatArray, FloatArray]:
    """The middle of a bar's longest length (3,) [mm] and the bar's direction (3,) at one of the candidate positions."""
    along, towards = (np.array(one, dtype=float) for one in LINES[candidate % len(LINES)])
    along /= np.linalg.norm(along)
    towards /= np.linalg.norm(towards)
    half, lean = longest_mm / 2, abs(float(along @ towards))
    room = (FARTHEST * reach_mm) ** 2 - half**2
    # The far end is |d t + l a| away from the shoulder.
    most = np.sqrt((half * lean) ** 2 + room) - half * lean if room > 0 else 0.0
    if most < NEAREST_LINE * reach_mm:
        raise InputError(
            f"a length of {longest_mm:.5g} mm has no position before an arm with a reach of {reach_mm:.5g} mm",
            hint="use a shorter bar, or correct the measuring range in the specification",
        )
    away = min(LINE_DISTANCE * reach_mm, float(most))
    turn = about_z(AZIMUTHS_DEG[candidate // len(LINES)])
    return turn @ (away * towards) + [0.0, 0.0, shoulder_mm], turn @ along


def seat_normal(along: FloatArray, at: FloatArray) -> FloatArray:
    """Return the normal of a bar's seats: across the bar and up; for an upright bar, towards the arm."""
    look = np.array([0.0, 0.0, 1.0])
    if abs(along[2]) > UPRIGHT:
        look = np.array([-at[0], -at[1], 0.0])
    across: FloatArray = look - (look @ along) * along
    return across / np.linalg.norm(across)


def frame_about(axis: FloatArray) -> FloatArray:
    """Return the frame (3, 3) with a given z axis and a horizontal x axis."""
    x = np.cross([0.0, 0.0, 1.0], axis)
    x = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(x) < 1e-9 else x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def about_z(angle_deg: float) -> FloatArray:
    """Return the rotation (3, 3) about z."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
