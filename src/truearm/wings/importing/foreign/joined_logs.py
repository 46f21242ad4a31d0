"""A table of angles and a table of points joined into one: by time, by row or by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from truearm.errors import InputError
from truearm.number_format import format_number
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.importing.foreign.clock_offset import (
    ClockOffset,
    Log,
    clock_offset,
    common_times,
    offset_of_points,
    robust_mean,
    standstills,
)
from truearm.wings.importing.foreign.joined_tables import (
    JoinedTable,
    beside,
    join_by_name,
    join_by_row,
    named,
    numeric_columns,
    rows_said,
)
from truearm.wings.importing.foreign.no_readings import lost_targets
from truearm.wings.importing.foreign.time_columns import Times, time_columns, time_of
from truearm.wings.importing.tables.table import Table, listed

# A standstill lasts so long at least, and the tip moves by no more [s, mm].
STANDSTILL_S, STANDSTILL_MM = 0.5, 0.05
# Points that come more slowly were taken one by one, at rest [s].
SPORADIC_S = 0.5
# Both logs rest at once for this share of the time of a standstill; repeated values are of a lost target after [s].
COMMON, HELD_S = 0.5, 0.2
# No encoder has larger steps, as a share of how far its joint goes.
MOST_STEP = 5e-3
# Times that differ by less are equal [s].
TIME_ROUNDING_S = 1e-6


def join_tables(
    joints: Table,
    points: Table,
    by: str,
    *,
    angles: Sequence[int] = (),
    point: Sequence[int] = (),
    point_unit_mm: float = 1.0,
    time_offset_s: float | None = None,
    standstill_s: float = STANDSTILL_S,
    standstill_mm: float = STANDSTILL_MM,
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
        columns of numbers in `joints` that are no time, and the first three of `points`.
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
    if by != "time":
        return join_by_name(joints, points, None if by == "name" else by)
    if not standstill_s > 0 or not standstill_mm > 0:
        raise InputError("a standstill needs a time and a span above zero", hint="--still 0.5")
    of_joints, of_points = _times(joints), _times(points)
    angle_columns = list(angles) or measured_columns(joints)
    point_columns = list(point) or measured_columns(points)[:3]
    if not angle_columns or len(point_columns) != 3:
        table, what = (joints, "angles") if not angle_columns else (points, "x, y, z")
        raise table.error(f"expected columns of {what}, got {listed(table.names)}", hint="--angles, --point X,Y,Z")
    values = np.stack([joints.numbers(i) for i in angle_columns], axis=1)
    q = _log(joints, of_joints, _without_turns(values))
    p, said = _log_of_points(points, of_points, point_columns, point_unit_mm)
    said = [*of_joints.assumed, *of_points.assumed, *said]
    sides = _Side(joints, q, angle_columns), _Side(points, p, point_columns, point_unit_mm)
    return _join(*sides, time_offset_s, standstill_s, standstill_mm, said)


@dataclass(frozen=True, eq=False)
class _Side:
    """A table, its log, the columns from which that is, and how many units of the log a unit of the table is."""

    table: Table
    log: Log
    columns: list[int]
    unit: float = 1.0

    def means(self, spans: FloatArray) -> tuple[Table, FloatArray]:
        """A table with a row for each time, and the uncertainty of its mean and the number of samples (n, 2).

        Numbers are means, those of the log without stray samples; text is that of the first sample.
        """
        ends = np.searchsorted(self.log.times, spans + [-TIME_ROUNDING_S, TIME_ROUNDING_S])
        parts = [slice(a, b) for a, b in ends.tolist()]
        rows = [self.log.rows[part] for part in parts]
        found = [robust_mean(self.log.values[part]) for part in parts]
        columns = [
            column[self.log.rows[ends[:, 0]]] if column.dtype.kind == "U" else _means(column, rows)
            for column in self.table.columns
        ]
        for place, i in enumerate(self.columns):
            columns[i] = np.array([mean[place] for mean, _, _ in found]) / self.unit
        table = replace(self.table.rows(self.log.rows[ends[:, 0]]), columns=tuple(columns))
        return table, np.array([[u, n] for _, u, n in found])


def _join(
    joints: _Side, points: _Side, given_s: float | None, seconds: float, span_mm: float, said: list[str]
) -> JoinedTable:
    q, p = joints.log, points.log
    if min(q.step, p.step) >= SPORADIC_S:
        raise points.table.error(
            f"both tables have single rows, {q.step:.2g} and {p.step:.2g} s apart: nothing shows which belong together",
            hint="--by row, or --by name",
        )
    for side, what in ((joints, "joints"), (points, "points")):
        if not side.log.values.std(axis=0).any():
            raise side.table.error(f"the {what} never move", column=side.columns[0])
    if q.step >= SPORADIC_S:  # poses that the robot's program wrote down at rest
        still = standstills(p, span_mm, seconds)
        if not len(still):
            raise _no_standstill(points, p, span_mm, seconds, "the tip")
        # t_joints - offset lies in a standstill: as an offset of the points, with all signs turned.
        turned = offset_of_points(-q.times, -still[:, ::-1][::-1]) if given_s is None else ClockOffset(given_s)
        clock = replace(turned, at_s=float(p.times.mean()))
        tips, angles, more = _single_rows(points, joints, still, replace(clock, offset_s=-clock.offset_s))
        return replace(beside(angles, tips, [*said, _clocks(joints, points, clock), *more]), clock=clock)
    # A span of the tip in the unit of the joints, by how far both go: a tip goes as far as its joints, whatever these
    # are counted in.
    lever = float(np.linalg.norm(p.values.std(axis=0))) / float(np.linalg.norm(q.values.std(axis=0)))
    still = standstills(q, span_mm / lever + 2 * _steps(q), seconds)
    if not len(still):
        raise _no_standstill(joints, q, span_mm / lever, seconds, "the joints")
    if p.step >= SPORADIC_S:
        clock = offset_of_points(p.times, still) if given_s is None else ClockOffset(given_s)
        angles, tips, more = _single_rows(joints, points, still, clock)
        return replace(beside(angles, tips, [*said, _clocks(joints, points, clock), *more]), clock=clock)
    clock = clock_offset(q, p, still, given_s)
    said = [*said, _clocks(joints, points, clock)]
    p = replace(p, times=clock.to_joints(p.times))
    of_tip = standstills(p, span_mm, seconds)
    both = common_times(still, of_tip, COMMON * seconds)
    if not len(both):
        raise _no_standstill(points, p, span_mm, seconds, "the tip" if not len(of_tip) else "both logs at once")
    angles, _ = joints.means(both)
    tips, scatter = replace(points, log=p).means(both)
    said.append(
        f"{len(both)} standstills of {seconds:g} s or more within {span_mm:g} mm, a reading each: the mean of some "
        f"{np.median(scatter[:, 1]):.0f} points, which repeats to {np.median(scatter[:, 0]):.2g} mm"
    )
    if n_skipped := len(still) - len(both):
        said.append(f"{n_skipped} more of the joints alone skipped")
    return replace(beside(angles, tips, said), clock=clock)


def _single_rows(
    resting: _Side, single: _Side, still: FloatArray, clock: ClockOffset
) -> tuple[Table, Table, list[str]]:
    """Means of the standstills in which single rows were taken, these rows, and what is to be said of them."""
    times = clock.to_joints(single.log.times)
    place = np.searchsorted(still[:, 0], times, side="right") - 1
    inside = (place >= 0) & (times <= still[place, 1])
    if not inside.any():
        raise single.table.error(f"no row lies in a standstill of {named(resting.table)}", hint="check --time-offset")
    said = [f"{rows_said(int(inside.sum()))} in standstills of the other file, a reading each"]
    if not inside.all():
        said.append(f"{(~inside).sum()} outside of standstills skipped")
    return resting.means(still)[0].rows(place[inside]), single.table.rows(single.log.rows[inside]), said


def _clocks(joints: _Side, points: _Side, clock: ClockOffset) -> str:
    """Say when the points begin, and what is added to their times, as the option takes it."""
    late = float(clock.to_joints(points.log.times[:1])[0] - joints.log.times[0])
    said = f"{named(points.table)} starts {abs(late):.3f} s {'after' if late >= 0 else 'before'} {named(joints.table)}"
    said += f" (its times {clock.offset_s:+.4f} s"
    if clock.u_offset_s:
        said += f", u {format_number(clock.u_offset_s, digits=2)} s"
    if clock.drift:
        drift, u = 1e6 * clock.drift, 1e6 * clock.u_drift
        said += f"; drift {format_number(drift, uncertainty=u)} ppm, u {format_number(u, digits=2)} ppm"
    return said + (f"; from {clock.n_moves} moves)" if clock.n_moves else ")")


def _no_standstill(side: _Side, log: Log, span: float, seconds: float, what: str) -> InputError:
    """Say what the longest standstill is, and how to record."""
    longest = 0.0
    for shorter in (2.0, 4.0, 8.0):
        if len(found := standstills(log, span, seconds / shorter)):
            longest = float((found[:, 1] - found[:, 0]).max())
            break
    return side.table.error(
        f"no standstill of {seconds:g} s: {what} stood still for {longest:.2g} s at most",
        hint="let the arm rest at each pose for a second or more; or --still for shorter rests, "
        "--standstill-mm for an instrument or an arm that moves more while it rests",
    )


# What the tables hold ------------------------------------------------------------------------------------------------


def _times(table: Table) -> Times:
    if (times := time_of(table)) is None:
        raise table.error(
            f"no column holds times; the columns are {listed(table.names)}",
            hint="--by row, or --by name; or name the column of times 'time'",
        )
    return times


def measured_columns(table: Table) -> list[int]:
    """Indices of the columns of numbers that are no times and do not count the rows."""
    times = time_columns(table)
    return [
        i
        for i, column in numeric_columns(table).items()
        if i not in times and not (len(column) > 1 and (np.diff(column) == 1).all())
    ]


def _log(table: Table, times: Times, values: FloatArray) -> Log:
    """The samples that have a time, other than that of the one before, and all values."""
    rows = np.flatnonzero(np.isfinite(times.seconds) & np.isfinite(values).all(axis=1))
    t = times.seconds[rows]
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0)
    if len(first) < 2:
        raise table.error(f"expected two or more rows with different times and values, got {len(first)}")
    if 2 * len(first) < len(rows):  # stamps of whole seconds: rows of one stamp are spread over the time to the next
        n, step = np.median(np.diff(first)), np.median(np.diff(t[first]))
        knots = [first[1] - n, *first[1:], first[-1] + n]  # the log begins and ends within a second
        t = np.interp(np.arange(len(t)), knots, [t[first[1]] - step, *t[first[1:]], t[-1] + step])
        first = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0)
    return Log(t[first], values[rows[first]], rows[first])


def _without_turns(angles: FloatArray) -> FloatArray:
    """Angles that are written within a turn, of 360 or 2 pi, continued over its ends."""
    known = np.isfinite(angles).all(axis=1)
    for column in angles.T:
        for turn in (360.0, 2 * np.pi):
            if known.any() and 0.9 * turn < np.ptp(column[known]) < 1.01 * turn:
                column[known] = np.unwrap(column[known], period=turn)
    return angles


def _log_of_points(table: Table, times: Times, columns: list[int], unit: float) -> tuple[Log, list[str]]:
    """The samples that have a point, and how many have none."""
    points = np.stack([table.numbers(i) for i in columns], axis=1) * unit
    points[lost_targets(points)] = np.nan
    log = _log(table, times, points)
    held = _held(log)
    log = Log(np.delete(log.times, held), np.delete(log.values, held, axis=0), np.delete(log.rows, held))
    n_lost = int(np.isnan(points).any(axis=1).sum()) + len(held)
    return log, [f"{rows_said(n_lost)} of {named(table)} without a point skipped"] if n_lost else []


def _held(log: Log) -> IntArray:
    """Samples that an instrument without a target repeats, where it has noise while it sees one."""
    if len(log.times) < 10 or log.step >= SPORADIC_S or not (log.noise() > 0).all():
        return np.empty(0, dtype=np.intp)
    same = np.r_[False, (np.diff(log.values, axis=0) == 0).all(axis=1)]
    run = np.cumsum(~same)
    count = np.bincount(run)
    return np.flatnonzero(same & (count[run] * log.step >= HELD_S) & (count[run] >= 5))


def _steps(log: Log) -> FloatArray:
    """(k,) steps in which values are written, such as counts: the least difference between neighbours that differ."""
    steps = np.abs(np.diff(log.values[:20000], axis=0))
    spans = np.ptp(log.values, axis=0)
    least = np.where(steps > 1e-9 * spans, steps, np.inf).min(axis=0, initial=np.inf)
    return np.asarray(np.minimum(least, MOST_STEP * spans))


def _means(column: FloatArray | NameArray, rows: list[IntArray]) -> FloatArray:
    """Mean of a column over some rows each, without empty cells."""
    numbers = np.asarray(column, dtype=float)
    known = [numbers[some][np.isfinite(numbers[some])] for some in rows]
    return np.array([float(some.mean()) if len(some) else np.nan for some in known])
