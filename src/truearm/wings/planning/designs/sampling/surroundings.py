"""What stands around an arm: the table that carries seats and bars, and boxes that the arm must not enter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truearm.arm import Chain
from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray
from truearm.wings.planning.designs.sampling.workspace import joint_origins

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
