"""Where a person works with an arm: the front sector, seen from the shoulder, and what stands around the arm.

That is the table that carries seats and bars, and boxes that the arm must not enter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from truearm.arm import Arm, Chain
from truearm.errors import InputError
from truearm.identification.terms import link_vectors
from truearm.typing import BoolArray, FloatArray

# The stylus may touch what lies on the table [mm].
_TOUCH_MM = 1.0
_BOTTOMLESS_MM = -1e6


@dataclass(frozen=True)
class Box:
    """A box along the axes of the base frame.

    Parameters
    ----------
    low, high : three floats
        Its corners [mm].

    Raises
    ------
    InputError
        If a side is not positive, or a number not finite.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not (np.isfinite([*self.low, *self.high]).all() and np.less(self.low, self.high).all()):
            raise InputError(f"expected a box with the smaller coordinates first, got {self.low} to {self.high}")

    def cuts(self, start: FloatArray, end: FloatArray) -> BoolArray:
        """(...) Whether the segments from `start` to `end` (..., 3) have a point in the box."""
        along = end - start
        # A segment of next to no length along an axis overflows to infinity, which compares as it should.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ends = np.stack([(np.asarray(side) - start) / along for side in (self.low, self.high)])
        # Parallel to a pair of faces: between them always, or never.
        between = (start >= self.low) & (start <= self.high)
        enter = np.where(along == 0, np.where(between, -np.inf, np.inf), ends.min(axis=0)).max(axis=-1)
        leave = np.where(along == 0, np.where(between, np.inf, -np.inf), ends.max(axis=0)).min(axis=-1)
        return np.asarray((enter <= leave) & (enter <= 1) & (leave >= 0))


@dataclass(frozen=True)
class Surroundings:
    """Table and boxes about an arm.

    Parameters
    ----------
    table_mm : float
        Height of the table above the base [mm]. Seats, bars and tips are on or above it; by default at the base.
    x_mm, y_mm : pair of floats, optional
        The table's extent in the base frame [mm]: seats and bars are above it. The arm may be beside it and below its
        top. Without an extent, it is everywhere: all joints beyond the shoulder, and the tip, are above it.
    avoid : sequence of Box
        Neither arm nor artefact is in these.

    Raises
    ------
    InputError
        If a range is empty.
    """

    table_mm: float = 0.0
    x_mm: tuple[float, float] | None = None
    y_mm: tuple[float, float] | None = None
    avoid: Sequence[Box] = ()

    def __post_init__(self) -> None:
        if (self.x_mm is None) != (self.y_mm is None):
            raise InputError("a table has an extent in x and y, or none")
        if not np.isfinite(self.table_mm):
            raise InputError(f"expected the height of the table in mm, got {self.table_mm}")
        _ = self._obstacles  # checks the extent

    @property
    def _obstacles(self) -> tuple[Box, ...]:
        """Boxes that links must not cut; the table with an extent is one of them."""
        if self.x_mm is None or self.y_mm is None:
            return tuple(self.avoid)
        (x0, x1), (y0, y1) = self.x_mm, self.y_mm
        return (Box((x0, y0, _BOTTOMLESS_MM), (x1, y1, self.table_mm - _TOUCH_MM)), *self.avoid)

    def holds(self, points: FloatArray) -> BoolArray:
        """(n,) Whether seats at points (n, 3) are on or above the table, and in no box."""
        inside = points[:, 2] >= self.table_mm
        for axis, extent in ((0, self.x_mm), (1, self.y_mm)):
            if extent is not None:
                inside &= (points[:, axis] >= extent[0]) & (points[:, axis] <= extent[1])
        for box in self.avoid:
            inside &= ~box.cuts(points, points)
        return np.asarray(inside)

    def holds_bars(self, first: FloatArray, second: FloatArray) -> BoolArray:
        """(n,) Whether bars between points (n, 3) are above the table and cut no box."""
        inside = self.holds(first) & self.holds(second)
        for box in self.avoid:
            inside &= ~box.cuts(first, second)
        return np.asarray(inside)

    def leaves_free(self, chain: Chain, angles: FloatArray) -> BoolArray:
        """(n,) Whether an arm in poses (n, n_joints) is in no box, nor in the table; its column may be.

        The links are lines from joint to joint, from the shoulder to the tip.
        """
        line = np.concatenate([joint_origins(chain, angles)[:, 1:], chain.tip_in_base(angles)[:, None]], axis=1)
        free = np.ones(len(angles), bool)
        if self.x_mm is None:
            # A half space: links between two points above it are above it. Joints in the shoulder are of the column.
            beyond = np.linalg.norm(line - line[:, :1], axis=2) > _TOUCH_MM
            free &= ~(beyond & (line[..., 2] < self.table_mm - _TOUCH_MM)).any(axis=1)
        for box in self._obstacles:
            free &= ~box.cuts(line[:, :-1], line[:, 1:]).any(axis=1)
        return free


def surroundings_of(table: Sequence[float] | None, avoid: Sequence[Sequence[float]]) -> Surroundings:
    """The table and the boxes from their numbers [mm]: Z or Z, X0, X1, Y0, Y1; six of each box.

    Raises
    ------
    InputError
        If a table has neither one nor five numbers, a box has not six, or a range is empty.
    """
    boxes = []
    for box in avoid:
        if len(box) != 6:
            problem = f"a box needs six numbers X0,X1,Y0,Y1,Z0,Z1, got {len(box)}"
            raise InputError(problem, hint="0,200,-300,300,0,900")
        x0, x1, y0, y1, z0, z1 = map(float, box)
        boxes.append(Box((x0, y0, z0), (x1, y1, z1)))
    numbers = [0.0] if table is None else list(map(float, table))
    if len(numbers) == 1:
        return Surroundings(numbers[0], avoid=tuple(boxes))
    if len(numbers) != 5:
        raise InputError(
            f"a table needs its height Z, or Z,X0,X1,Y0,Y1 with its extent, got {len(numbers)} numbers",
            hint="-40,200,900,-400,400",
        )
    height, x0, x1, y0, y1 = numbers
    return Surroundings(height, (x0, x1), (y0, y1), avoid=tuple(boxes))


@dataclass(frozen=True)
class Sector:
    """The sector in which parts are measured, relative to the reach.

    Parameters
    ----------
    near, far : float
        Horizontal distance from the shoulder.
    low, high : float
        Height above the shoulder.
    half_angle_deg : float
        To both sides of the front, the azimuth of the tip in the working pose.
    """

    near: float = 0.30
    far: float = 0.85
    low: float = -0.30
    high: float = 0.40
    half_angle_deg: float = 60.0


@dataclass(frozen=True, eq=False)
class Stance:
    """Shoulder, reach and front of an arm.

    Attributes
    ----------
    shoulder_in_base : (3,) array
        Origin of joint 2 at the working pose (of joint 1 if there is no other) [mm].
    reach_mm : float
        Sum of the links from the shoulder to the tip.
    front_rad : float
        Azimuth of the working pose's tip about the shoulder.
    """

    shoulder_in_base: FloatArray
    reach_mm: float
    front_rad: float


def stance(arm: Arm) -> Stance:
    """Find shoulder, reach and front of an arm that stands upright (base z up)."""
    chain = arm.chain
    shoulder = joint_origins(chain, arm.working[None])[0, :2][-1]
    reach = float(np.linalg.norm(link_vectors(chain)[min(2, chain.n_joints) :], axis=1).sum())
    ahead = chain.tip_in_base(arm.working[None])[0] - shoulder
    return Stance(shoulder, reach, float(np.arctan2(ahead[1], ahead[0])))


def joint_origins(chain: Chain, angles: FloatArray) -> FloatArray:
    """Origins of the joints, (n, n_joints, 3) [mm] in the base frame."""
    angles, out = chain.joint_angles(angles), np.empty((len(angles), chain.n_joints, 3))
    out[:, 0] = chain.fixed[0, :3, 3]
    for i in range(1, chain.n_joints):  # the chain cut at the next joint has its tip there
        out[:, i] = Chain(chain.fixed[: i + 1], np.zeros(3), chain.is_prismatic[:i]).tip_in_base(angles[:, :i])
    return out


def is_above_table(chain: Chain, angles: FloatArray, tips: FloatArray) -> BoolArray:
    """(n,) Whether no joint is below the table, at the height of the base, or of the tip (n, 3) if that is lower."""
    return np.asarray(joint_origins(chain, angles)[:, :, 2].min(axis=1) >= np.minimum(tips[:, 2], 0.0))


def draw_points(where: Stance, n: int, *, sector: Sector, rng: np.random.Generator) -> FloatArray:
    """Draw points uniform in the volume of the sector, (n, 3) [mm] in the base frame."""
    # Uniform over an area between two radii: the square of the radius is uniform.
    radius = where.reach_mm * np.sqrt(rng.uniform(sector.near**2, sector.far**2, n))
    azimuth = where.front_rad + np.radians(rng.uniform(-sector.half_angle_deg, sector.half_angle_deg, n))
    height = where.reach_mm * rng.uniform(sector.low, sector.high, n)
    return where.shoulder_in_base + np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height])


def azimuth_of(points: FloatArray, where: Stance) -> FloatArray:
    """Azimuths of points as seen from the shoulder, from the front, (n,) [rad] in -pi .. pi."""
    ahead = points - where.shoulder_in_base
    return (np.arctan2(ahead[:, 1], ahead[:, 0]) - where.front_rad + np.pi) % (2 * np.pi) - np.pi


def in_sector(points: FloatArray, where: Stance, sector: Sector) -> BoolArray:
    """(n,) Whether points (n, 3) of the base frame [mm] are in a sector."""
    ahead = (points - where.shoulder_in_base) / where.reach_mm
    radius = np.hypot(ahead[:, 0], ahead[:, 1])
    return np.asarray(
        (radius >= sector.near)
        & (radius <= sector.far)
        & (ahead[:, 2] >= sector.low)
        & (ahead[:, 2] <= sector.high)
        & (np.abs(azimuth_of(points, where)) <= np.radians(sector.half_angle_deg))
    )


def within_cone(axes: FloatArray, *, half_angle_rad: float, rng: np.random.Generator) -> FloatArray:
    """Draw directions uniform in the cones about unit vectors `axes` (n, 3)."""
    n = len(axes)
    cosine = rng.uniform(np.cos(half_angle_rad), 1.0, n)
    turn = rng.uniform(0, 2 * np.pi, n)
    sine = np.sqrt(1 - cosine**2)
    first = np.cross(axes, np.eye(3)[np.abs(axes).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axes, first)
    out: FloatArray = (
        cosine[:, None] * axes + (sine * np.cos(turn))[:, None] * first + (sine * np.sin(turn))[:, None] * second
    )
    return out


def sector_of(volume_mm: Sequence[float], arm: Arm) -> Sector:
    """The sector of an arm from nearest and farthest distance, lowest and highest height [mm] and half angle [deg].

    Raises
    ------
    InputError
        If these are not five numbers of a volume.
    """
    numbers = tuple(map(float, volume_mm))
    near, far, low, high, half_angle_deg = numbers if len(numbers) == 5 else (0.0,) * 5
    if not (all(map(isfinite, numbers)) and 0 <= near < far and low < high and 0 < half_angle_deg <= 180):
        raise InputError(
            "the volume needs five numbers NEAR,FAR,LOW,HIGH,HALF_ANGLE: distances and heights in mm, each the smaller "
            f"first, and an angle in deg; got {','.join(f'{number:g}' for number in numbers)}",
            hint="300,800,-200,400,60",
        )
    reach = stance(arm).reach_mm
    return Sector(near / reach, far / reach, low / reach, high / reach, half_angle_deg)
