"""A table of angles and a table of points joined into one: by time, by row or by name."""

from __future__ import annotations

from collections.abc import Sequence

from truearm.errors import InputError
from truearm.files.tables.table import Table
from truearm.readings.joined_tables import JoinedTable, join_by_name, join_by_row


def join_tables(
    joints: Table,
    points: Table,
    by: str,
    *,
    angles: Sequence[int] = (),
    point: Sequence[int] = (),
    point_unit_mm: float = 1.0,
    time_offset_s: float | None = None,
    standstill_s: float = 0.5,
    standstill_mm: float = 0.05,
) -> JoinedTable:
    """Join a table of angles and a table of points.

    Parameters
    ----------
    joints, points : Table
        As their files have them.
    by : str
        ``row``, ``name``, ``time``; or the column of names, ``pose``, or ``pose=point`` where its name differs.
    angles, point : sequence of int, optional
        For ``time``: indices of the columns of the angles in `joints`, and of x, y, z in `points`. By default all
        columns of numbers in `joints` that are no time, and the columns of `points` that are so named, or its first.
    point_unit_mm : float
        How many mm a unit of the points is.
    time_offset_s : float, optional
        What to add to the times of `points` to have those of `joints` [s]; estimated by default.
    standstill_s, standstill_mm : float
        A standstill lasts so long at least [s], and the tip moves by no more [mm].

    Returns
    -------
    JoinedTable
        A row a reading. Its `assumed` says what was recognised, estimated and skipped.

    Raises
    ------
    InputError
        If rows, names or times do not say which angles belong to which point; with the option that settles it.
    """
    if by == "row":
        return join_by_row(joints, points)
    if by == "name":
        return join_by_name(joints, points)
    if by != "time":
        return join_by_name(joints, points, by)
    del angles, point, point_unit_mm, time_offset_s, standstill_s, standstill_mm
    raise InputError("joining by time is not available yet", hint="--by row")
