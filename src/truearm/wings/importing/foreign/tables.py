"""Import of foreign tables: other names, separators, units and kinds of file than those of a session file."""

from __future__ import annotations

import shlex
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

import numpy as np

from truearm.errors import FaultCollector, InputError
from truearm.files.delimited import quoted_cell
from truearm.readings import Session, has_reference
from truearm.readings.readings import ANCHOR_DISTANCE, DIRECTION, LOAD, SHARED_UNCERTAINTIES, SPHERE_DISTANCE
from truearm.readings.session import similar_names
from truearm.typing import BoolArray, FloatArray, NameArray
from truearm.wings.exports.targets.lerobot_motors import check_no_data_set
from truearm.wings.importing.foreign.column_units import (
    PointUnit,
    length_unit,
    lerobot_meaning,
    mm_of,
    numbers_in_unit,
    settle_joint_units,
    settle_point_units,
    stated_point_units,
    unit_of_name,
)
from truearm.wings.importing.foreign.joined_logs import STANDSTILL_MM, STANDSTILL_S, join_tables, measured_columns
from truearm.wings.importing.foreign.no_readings import (
    far_turned,
    is_status,
    lost_targets,
    lost_zero,
    not_seen,
    statistics_at_ends,
)
from truearm.wings.importing.foreign.orientations import OrientationUnit, check_orientation_columns, read_orientations
from truearm.wings.importing.foreign.program_columns import ProgramColumns, recognise_program_columns
from truearm.wings.importing.foreign.table_columns import OTHER_NAMES, JointScale, TableColumns
from truearm.wings.importing.tables import read_table
from truearm.wings.importing.tables.table import Table, TableForm, columns_named, listed

if TYPE_CHECKING:
    import pandas as pd


# Goal coordinates that differ by less than this many decimals name one position.
_POSITION_DECIMALS = 6


# Separators by their names.
BLANKS = {"TAB": "\t", "\\t": "\t", "SPACE": " "}


@dataclass(frozen=True, eq=False)
class ImportedTable:
    """A session read from a foreign table, and what was assumed.

    Attributes
    ----------
    session : Session
    columns : TableColumns
        Those that were read.
    units : tuple of str
        Unit of each joint in the table.
    assumed : tuple of str
        Form, columns and units that were recognised, a phrase each.
    remarks : tuple of str
        Rows that are no readings, and points that are none, a sentence each.
    """

    session: Session
    columns: TableColumns
    units: tuple[str, ...]
    assumed: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def import_table(
    table: str | Path | Table | pd.DataFrame,
    columns: TableColumns | None = None,
    scale: JointScale | None = None,
    *,
    motors: str | None = None,
    points_from: str | Path | Table | pd.DataFrame | None = None,
    by: str = "row",
    time_offset_s: float | None = None,
    standstill_s: float = STANDSTILL_S,
    standstill_mm: float = STANDSTILL_MM,
    point_unit: PointUnit | None = None,
    u_mm: float | None = None,
    orientation_unit: OrientationUnit | None = None,
    orientation_order: str | None = None,
    separator: str | None = None,
    decimal: str | None = None,
    thousands: str | None = None,
    header: bool | None = None,
    skip_lines: int | None = None,
    encoding: str | None = None,
    part: str | Sequence[str] | None = None,
    session_name: str | None = None,
    serial_number: str | None = None,
) -> Session:
    r"""Read a session from a table with other columns and units than the session file.

    What is not stated is recognised: how the table is written, and the columns of programs that truearm knows. Only
    where two interpretations differ in a number, the table is refused with both.

    Parameters
    ----------
    table : path or pandas.DataFrame
        Delimited text, a workbook, an array, a log: see docs/import.md.
    columns : TableColumns, optional
        Which column holds what. Those not stated are recognised by their names.
    scale : JointScale, optional
        How its joint values become angles.
    motors : str, optional
        LeRobot's calibration file, also ``so100:FILE``, of a recording in the unit of `scale`: deg, counts or percent.
    points_from : path or pandas.DataFrame, optional
        A second table, which holds the points.
    by : str
        What joins the two tables: ``row``, ``name``, ``time``, or a column of names (``POSE``, or ``POSE=POINT``).
    time_offset_s : float, optional
        Add to the times of the second table [s]; by default estimated.
    standstill_s : float
        For how long the arm stands still at a reading [s].
    standstill_mm : float
        By how much the tip moves at most in that time [mm].
    point_unit : {"mm", "m", "cm", "um", "in"}, optional
        Unit of the points, their uncertainties and of distances.
    u_mm : float, optional
        Standard uncertainty of every coordinate of every point, or of every distance, that has none of its own [mm].
    orientation_unit : {"deg", "rad"}, optional
        Unit of a rotation vector or of Euler angles.
    orientation_order : str, optional
        Of a quaternion, ``wxyz`` (the default) or ``xyzw``; of Euler angles, ``ZYX`` about the axes as turned before
        (KUKA), ``xyz`` about fixed ones (Fanuc), and so on. Three columns without an order are a rotation vector.
    separator, decimal, thousands : str, optional
        One character; as separator also TAB, and a blank or SPACE for one or more; '' for no thousands; recognised.
    header : bool, optional
        Whether a line names the columns; without, columns go by number; recognised.
    skip_lines : int, optional
        Lines above the header, or above the first row, that do not belong to the table; recognised.
    encoding : str, optional
        utf-8, cp1252, utf-16 or another that Python knows; recognised.
    part : str or sequence of str, optional
        Which sheet of a workbook, variable of an archive, or topic of a recording; of two tables one each, in their
        order, empty for none.
    session_name, serial_number : str, optional
        That of all readings, if no column holds it.

    Returns
    -------
    Session
        Angles in rad (sliding joints in mm), points in mm. A reading whose target was lost has no point.

    Raises
    ------
    InputError
        If the table does not fit what is stated, or may mean two things; with file, line, column and what to do.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> from truearm.wings.importing.foreign import JointScale, TableColumns
    >>> _ = Path("table.txt").write_text("J1;J2;X;Y;Z\n0,1;-0,2;0,5;0,0;0,25\n")
    >>> columns = TableColumns(["J1", "J2"], points=["X", "Y", "Z"])
    >>> session = ta.import_table("table.txt", columns, JointScale("rad"), point_unit="m")
    >>> session.points.tolist()
    [[500.0, 0.0, 250.0]]
    """
    form = TableForm(BLANKS.get(separator or "", separator), decimal, thousands, header, skip_lines, encoding)
    sources = [one for one in (table, points_from) if one is not None]
    tables = as_tables(sources, form, [part] if isinstance(part, str) else part or ())
    return read_foreign_tables(
        tables,
        columns or TableColumns(),
        scale or JointScale(),
        motors=motors,
        by=by,
        time_offset_s=time_offset_s,
        standstill_s=standstill_s,
        standstill_mm=standstill_mm,
        point_unit=point_unit,
        u_mm=u_mm,
        orientation_unit=orientation_unit,
        orientation_order=orientation_order,
        session_name=session_name,
        serial_number=serial_number,
    ).session


def as_tables(
    sources: Sequence[str | Path | Table | pd.DataFrame], form: TableForm, parts: Sequence[str]
) -> list[Table]:
    """Read the cells of one table or two that are written in one form, a part of each, in their order.

    Raises
    ------
    InputError
        If one cannot be read as a table, or more parts are stated than there are tables.
    """
    if len(parts) > len(sources):
        problem = f"{len(parts)} parts are stated, expected one for each of {len(sources)} tables"
        raise InputError(problem, hint="--part once for TABLE and, with --with, once for the second one")
    of_each = zip_longest(sources, parts, fillvalue="")
    return [as_table(source, replace(form, part=part or None)) for source, part in of_each]


def as_table(table: str | Path | Table | pd.DataFrame, form: TableForm) -> Table:
    """Read a table's cells; a data frame has them already.

    Raises
    ------
    InputError
        If the file cannot be read as a table.
    """
    if isinstance(table, Table):
        return table
    if isinstance(table, str | Path):
        check_no_data_set(Path(table))
        return read_table(table, form)
    import pandas as pd

    from truearm.wings.importing.tables.array_files import table_of_frame

    if isinstance(table, pd.DataFrame):
        return table_of_frame(table)
    raise InputError(f"expected the path of a table or a data frame, got {type(table).__name__}")


def read_foreign_tables(
    tables: Sequence[Table],
    columns: TableColumns,
    scale: JointScale,
    *,
    motors: str | None = None,
    by: str = "row",
    time_offset_s: float | None = None,
    standstill_s: float = STANDSTILL_S,
    standstill_mm: float = STANDSTILL_MM,
    **meaning: Any,
) -> ImportedTable:
    """Read a session from one table, or from one of angles and one of points; see `import_table` and `interpret_table`.

    Raises
    ------
    InputError
        As `import_table`.
    """
    first, *more = tables
    if motors:
        first, columns, scale = lerobot_meaning(first, columns, scale, motors)
    known, *of_more = (recognise_program_columns(one.names, one.units, columns, one.columns) for one in (first, *more))
    if not more:
        return interpret_table(first, columns, scale, known=known, **meaning)
    points, tip = more[0], of_more[0]
    faults = FaultCollector()
    for one, fault in ((first, known.no_angles), (points, tip.no_points)):
        with faults.collect():
            _raise_of(one, fault)
    faults.raise_any()
    # Where names tell nothing, the columns of numbers that are no times and do not count the rows do.
    angles = columns.angles or known.columns.angles or [str(i + 1) for i in measured_columns(first)]
    at = columns.points or tip.columns.points or [str(i + 1) for i in measured_columns(points)]
    unit = meaning.get("point_unit") or length_unit(points, at[0]) or tip.point_unit or "mm"
    joined = join_tables(
        first,
        points,
        by,
        angles=[first.index(column) for column in angles],
        point=[points.index(column) for column in at[:3]],
        point_unit_mm=mm_of(unit),
        time_offset_s=time_offset_s,
        standstill_s=standstill_s,
        standstill_mm=standstill_mm,
    )
    n = len(joined.names) - len(points.names)

    def there(column: Any) -> Any:
        """Columns of the table of points, by what they are called in the joined one."""
        if isinstance(column, str):
            return joined.names[n + points.index(column)]
        if isinstance(column, Mapping):
            return {name: there(one) for name, one in column.items()}
        return column and tuple(there(one) for one in column)

    of_tip = {f.name: there(getattr(tip.columns, f.name)) for f in fields(TableColumns)}
    if len(at) == 3:
        of_tip["points"] = there(at)
    stated = replace(columns, points=there(columns.points), point_std=there(columns.point_std))
    with suppress(InputError):  # of the first table
        stated = replace(stated, orientation=there(columns.orientation))
    recognised = _recognised_of_both(replace(known, columns=replace(known.columns, angles=angles)), tip, of_tip)
    return interpret_table(joined, stated, scale, known=recognised, **meaning)


def _raise_of(table: Table, fault: InputError | None) -> None:
    """Raise a fault of a table's columns, if there is one, with the file and the line."""
    if fault is not None:
        raise table.error(fault.problem, hint=fault.hint)


def _state_name(fields: dict[str, Any], name: str, stated: str | None, column: object, n: int) -> None:
    """Give all n readings a stated name, which no column may give them too."""
    if stated is None:
        return
    if column:
        raise InputError(f"the {name.replace('_', ' ')} is given twice, by a column and by a name")
    fields[name] = np.full(n, stated)


def _recognised_of_both(known: ProgramColumns, tip: ProgramColumns, of_tip: Mapping[str, Any]) -> ProgramColumns:
    """What is recognised in a joined table: of the tip in the table of points, of all else first in the other.

    `of_tip` are the columns of the table of points as the joined one calls them.
    """
    measured = {name: of_tip[name] for name in ("points", "point_std", "orientation")}
    return replace(
        tip,
        columns=replace(known.columns, **measured).or_else(TableColumns(**of_tip)),
        angle_units=known.angle_units or (None,) * len(known.columns.angles),
        phrases={k: said for k, said in known.phrases.items() if k not in measured}
        | {k: said for k, said in tip.phrases.items() if k in measured or k not in known.phrases},
        remarks=(*known.remarks, *tip.remarks),
    )


def interpret_table(
    table: Table,
    columns: TableColumns,
    scale: JointScale,
    *,
    known: ProgramColumns | None = None,
    point_unit: PointUnit | None = None,
    u_mm: float | None = None,
    orientation_unit: OrientationUnit | None = None,
    orientation_order: str | None = None,
    session_name: str | None = None,
    serial_number: str | None = None,
) -> ImportedTable:
    """Give a table's columns their meaning.

    Parameters
    ----------
    table : Table
    columns : TableColumns
        Those that a person states.
    scale : JointScale
    known : ProgramColumns, optional
        Those that are recognised by their names, for what is not stated.
    point_unit, u_mm, orientation_unit, orientation_order, session_name, serial_number
        As `import_table` has them.

    Raises
    ------
    InputError
        As `import_table`.
    """
    _check_stated(point_unit, u_mm)
    assumed, remarks = list(table.assumed), list[str]()
    units: Sequence[str | None] = ()
    by_hand = columns
    if known is not None:
        units = () if columns.angles else known.angle_units
        if not columns.orientation:
            orientation_unit = orientation_unit or cast(Any, known.orientation_unit)
            orientation_order = orientation_order or known.orientation_order
        columns = _whole_columns(table, columns, known, orientation_unit, remarks)
        assumed += [said for k, said in known.phrases.items() if getattr(columns, k) == getattr(known.columns, k)]
        remarks += known.remarks
    faults = _column_faults(table, columns, known)
    with faults.collect():
        check_orientation_columns(len(columns.orientation), orientation_unit, orientation_order)
    if scale.unit is not None and columns.angles:  # wrong numbers of signs or zeros before all else
        with faults.collect():
            scale.to_angles(np.zeros((1, len(columns.angles))))
    if columns.angles:
        table = _readings_of(table, columns, remarks)
    values, points = _numbers(table, columns.angles), _numbers(table, columns.coordinates)
    if columns.angles:
        with faults.collect():
            scale = settle_joint_units(scale, table, columns.angles, units, values, assumed)
            if not faults.error():
                scale.to_angles(values[:1])
    of_program = None if known is None or columns.points != known.columns.points else known.point_unit
    point_units: list[PointUnit] = []
    with faults.collect():
        point_units = settle_point_units(table, columns.coordinates, of_program, points, assumed, point_unit)
    faults.raise_any()
    unit, points = point_units[0], points * [mm_of(one) for one in point_units]
    fields = _tip_fields(table, columns, points, unit, orientation_unit, orientation_order, remarks)
    fields |= _other_fields(table, columns, unit)
    _state_name(fields, "session", session_name, by_hand.session, len(table))
    _state_name(fields, "serial_number", serial_number, by_hand.others.get("serial_number"), len(table))
    if u_mm is not None:
        _state_uncertainty(fields, u_mm)
    session = Session(
        scale.to_angles(values),
        **fields,
        file=table.file,
        angle_columns=tuple(table.names[table.index(c)] for c in columns.angles),
        numbers=table.lines if table.place == "line" else None,
        by_line=table.place == "line",
    )
    remarks += map(str, similar_names(session))
    _name_unread(table, columns, session, remarks)
    return ImportedTable(session, columns, tuple(scale.units(session.n_joints)), tuple(assumed), tuple(remarks))


def _column_faults(table: Table, columns: TableColumns, known: ProgramColumns | None) -> FaultCollector:
    """What is missing or ambiguous among the columns.

    Raises
    ------
    InputError
        With all of it, if a column that is stated is none of the table's: nothing is read then.
    """
    faults = FaultCollector()
    with faults.collect():
        _raise_of(table, None if known is None or columns.angles else known.no_angles)
        if not columns.angles:
            problem = f"no column of joint angles is known among {listed(table.names)}"
            raise table.error(problem, hint=_columns_hint(table))
    with faults.collect():
        _raise_of(table, None if known is None or columns.points else known.no_points)
    stated = FaultCollector()
    with stated.collect():
        _check_columns(table, columns)
    with faults.collect():
        stated.raise_any()
    if stated.error() is not None:
        faults.raise_any()
    return faults


def _whole_columns(
    table: Table, stated: TableColumns, known: ProgramColumns, orientation_unit: str | None, remarks: list[str]
) -> TableColumns:
    """Columns as stated, or as recognised where those have a number in every row and a unit."""
    columns = known.columns
    if len(columns.orientation) == 3 and orientation_unit is None and not stated.orientation:
        names = ",".join(columns.orientation)
        remarks.append(
            f"{names} have no unit: not read. Use --orientation {shlex.quote(names)} with --orientation-unit."
        )
        columns = replace(columns, orientation=())
    others = {}
    for name, column in columns.others.items():
        if name in OTHER_NAMES or name in ANCHOR_DISTANCE or name in SPHERE_DISTANCE or name in stated.others:
            others[name] = column
        elif why := _why_not(table, column, unit_of_name(name), every_row=True):
            remarks.append(f"{column}: {why}: not read. Use --column {name}={column} to insist.")
        else:
            others[name] = column
    if columns.temperature and (why := _why_not(table, columns.temperature, "degC")) and not stated.temperature:
        remarks.append(f"{columns.temperature}: {why}: not read.")
        columns = replace(columns, temperature=None)
    indices = [table.index(column) for column in columns.position]
    if not stated.position and any("" in table.words(i) for i in indices):
        remarks.append(f"{', '.join(columns.position)} are empty in some rows: not read.")
        columns = replace(columns, position=())
    return stated.or_else(replace(columns, others=others))


def _why_not(table: Table, column: str, unit: str, *, every_row: bool = False) -> str:
    """Why a recognised column cannot be read; empty if it can."""
    try:
        lacks = np.isnan(numbers_in_unit(table, column, unit))
    except InputError as error:
        return error.problem
    if lacks.all():
        return "no numbers"
    return "no number in some rows" if every_row and lacks.any() else ""


def _readings_of(table: Table, columns: TableColumns, remarks: list[str]) -> Table:
    """Return the rows that are readings: all their angles are there, and they are no means of the rows above."""
    values, points = _numbers(table, columns.angles), _numbers(table, columns.coordinates)
    whole = np.ones(len(table), bool)
    if (summed := statistics_at_ends(np.hstack([values, points]))).any():
        whole &= ~summed
        remarks.append(f"{_called(table, whole)}: means, limits or the like of the other rows: no reading.")
    if (gone := np.isnan(values).any(axis=1) & whole).any():
        whole &= ~gone
        remarks.append(f"{_called(table, ~gone)}: a joint angle is missing: no reading.")
    if (empty := (values == 0).all(axis=1) & lost_zero(points) & whole).any():
        whole &= ~empty
        remarks.append(f"{_called(table, ~empty)}: nothing but zeros: no reading.")
    if (odd := far_turned(values) & whole).any():
        whole &= ~odd
        remarks.append(f"{_called(table, ~odd)}: a joint turned further than any joint does: no reading.")
    if not whole.any():
        raise table.error("expected at least one row of numbers, got none", hint=remarks[-1] if remarks else None)
    return table if whole.all() else table.rows(np.flatnonzero(whole))


def _columns_hint(table: Table) -> str:
    """Options that state the columns of a table whose names tell nothing; the point is usually the last of them."""
    n = len(measured_columns(table))
    if table.header_line is None and n == len(table.names) > 3:
        return f"--angles 1-{n - 3} --point {n - 2}-{n}, if the first {n - 3} of its {n} columns are the joint angles"
    return "--angles 'A,B,C' and --point 'X,Y,Z': their names, or their numbers as 1-6"


def import_points(
    path: str | Path | Table,
    columns: Sequence[str],
    *,
    point_unit: PointUnit | None = None,
    form: TableForm | None = None,
) -> FloatArray:
    r"""Read points from a table, such as the export of a metrology program.

    Parameters
    ----------
    path : path
        As `import_table` takes it.
    columns : sequence of three str
        x, y and z: each by its name in the header, or by its number counted from 1.
    point_unit : {"mm", "m", "cm", "um", "in"}, optional
        Unit of the points; by default that which the table states, or mm.
    form : TableForm, optional
        How the table is written, as far as it is stated.

    Returns
    -------
    (n, 3) array
        In the order of the table [mm].

    Raises
    ------
    InputError
        If the table does not fit `columns`, or a point is missing; with file, line, column and what to do.

    Examples
    --------
    >>> from pathlib import Path
    >>> from truearm.wings.importing.foreign import import_points
    >>> _ = Path("export.txt").write_text("point 1  0.5  0.25  1.0\npoint 2  0.5  0.75  1.0\n")
    >>> import_points("export.txt", ["3", "4", "5"], point_unit="in").tolist()
    [[12.7, 6.35, 25.4], [12.7, 19.05, 25.4]]
    """
    _check_stated(point_unit, None)
    if len(columns) != 3:
        raise InputError(f"expected three columns of points, got {len(columns)}", hint="--point 'X,Y,Z'")
    table = as_table(path, form or TableForm())
    _check_columns(table, TableColumns(points=tuple(columns)))
    points = _numbers(table, columns)
    if np.isnan(points).any():
        row, k = np.argwhere(np.isnan(points))[0].tolist()
        hint = "measure the point, or delete its row"
        raise table.error("expected a number, got an empty cell", row, column=table.index(columns[k]), hint=hint)
    return points * [mm_of(unit or "mm") for unit in stated_point_units(table, columns, points, point_unit)]


def _check_stated(point_unit: str | None, u_mm: float | None) -> None:
    if point_unit is not None and point_unit not in get_args(PointUnit):
        hint = f"one of {', '.join(get_args(PointUnit))}"
        raise InputError(f"unknown unit of points {quoted_cell(point_unit)}", hint=hint)
    if u_mm is not None and not 0 < u_mm < np.inf:
        raise InputError(f"expected a standard uncertainty above zero, got {u_mm:g} mm", hint="--u-mm 0.05")


def _check_columns(table: Table, columns: TableColumns) -> None:
    """Refuse columns that are not there, all of them at once, and one that holds two different numbers."""
    missing = [quoted_cell(one) for one in dict.fromkeys(columns.all()) if not columns_named(table.names, one)]
    if len(missing) > 1:
        problem = f"there are no columns {', '.join(missing)}; the columns are {listed(table.names)}"
        raise table.error(problem, hint="give a column by its number if its name is hard to type")
    others = {name: column for name, column in columns.others.items() if name not in OTHER_NAMES}
    numbers = replace(columns, seat=None, session=None, position=(), others=others)
    indices = [table.index(column) for column in numbers.all()]
    for i in indices:
        if indices.count(i) > 1:
            raise table.error("the column is used for two things", column=i)


def _numbers(table: Table, columns: Sequence[str]) -> FloatArray:
    """(n, len(columns)) numbers, NaN where a cell is empty."""
    found = [table.numbers(table.index(column)) for column in columns]
    return np.stack(found, axis=1) if found else np.empty((len(table), 0))


def _called(table: Table, kept: BoolArray, most: int = 5) -> str:
    """Name the rows that are not `kept`, at the beginning of a sentence."""
    places = table.lines[~kept].tolist()
    shown = ", ".join(map(str, places[:most])) + (f" and {len(places) - most} more" if len(places) > most else "")
    return f"{table.place.capitalize()}{'s' if len(places) > 1 else ''} {shown}"


def _tip_fields(
    table: Table,
    columns: TableColumns,
    points: FloatArray,
    unit: str,
    orientation_unit: OrientationUnit | None,
    orientation_order: str | None,
    remarks: list[str],
) -> dict[str, Any]:
    """Points, their uncertainties and orientations; lost targets have none."""
    fields: dict[str, Any] = {}
    if columns.orientation:
        indices = [table.index(column) for column in columns.orientation]

        def refuse(row: int, problem: str, hint: str, column: int) -> InputError:
            return table.error(problem, row, column=indices[column], hint=hint)

        values = _numbers(table, columns.orientation)
        fields["quaternion"] = read_orientations(values, orientation_unit, orientation_order, refuse)
    if not points.size:
        return fields
    in_table = points / mm_of(unit)
    lost = lost_targets(in_table) | (np.isnan(points).any(axis=1) & ~np.isnan(points).all(axis=1))
    lost |= _said_lost(table, remarks)
    _name_frozen(table, points, lost, remarks)
    _name_lost(table, in_table, lost, remarks)
    points = np.where(lost[:, None], np.nan, points)
    fields["points"] = points
    if columns.point_std:
        std = np.stack([numbers_in_unit(table, column, "mm", unit) for column in columns.point_std], axis=1)
        fields["point_std"] = np.where(np.isnan(points), np.nan, std)
    return fields


def _said_lost(table: Table, remarks: list[str]) -> BoolArray:
    """Rows of which another column says that the point was not seen."""
    lost = np.zeros(len(table), bool)
    for i, name in enumerate(table.names):
        if table.columns[i].dtype.kind == "f" and not is_status(name):
            continue
        if (said := not_seen(name, table.words(i))).any():
            remarks.append(f"Column {name} says of {np.count_nonzero(said)} rows that their point was not seen.")
            lost |= said
    return lost


def _name_lost(table: Table, points: FloatArray, lost: BoolArray, remarks: list[str]) -> None:
    """Name the rows whose point is none by what they hold."""
    rows, held = np.flatnonzero(lost), defaultdict[str, list[int]](list)
    for row, point in zip(rows.tolist(), points[rows].tolist(), strict=True):
        got = f"{', '.join(f'{v:g}' for v in point)} is no point"
        half = 0 < np.count_nonzero(np.isnan(point)) < len(point)
        what = "a coordinate is missing" if half else f"{got} (target lost)" if len({*point}) == 1 else "target lost"
        held[what].append(row)
    for what, those in held.items():
        kept = np.ones(len(table), bool)
        kept[those] = False
        remarks.append(f"{_called(table, kept)}: {what}; the reading has no point.")


def _name_frozen(table: Table, points: FloatArray, lost: BoolArray, remarks: list[str]) -> None:
    """Name points that repeat the one above to the last digit: an instrument that lost its target may do that."""
    same = np.r_[False, (np.diff(points, axis=0) == 0).all(axis=1)] & ~lost
    if same.any() and np.abs(points % 1.0).any():
        remarks.append(f"{_called(table, ~same)}: the same point as in the row above, to the last digit.")


def _name_unread(table: Table, columns: TableColumns, session: Session, remarks: list[str]) -> None:
    """Name the columns of numbers that were not read, and a session without any reference."""
    known = {table.index(column) for column in columns.all()}
    unread = [table.names[i] for i in measured_columns(table) if i not in known]
    if not has_reference(session).any():
        remarks.append("No reference is read: no points, seats or distances. A fit needs some: --point X,Y,Z")
    if unread:
        remarks.append(f"Not read: {listed(unread, most=8)}.")


def _other_fields(table: Table, columns: TableColumns, unit: str) -> dict[str, Any]:
    """Names, temperature, loads, distances and what else a session holds beside angles and tips."""
    fields: dict[str, Any] = {"position": _positions(table, columns.position)}
    named = {"seat": columns.seat, "session": columns.session}
    named |= {name: column for name, column in columns.others.items() if name in OTHER_NAMES}
    fields |= {name: table.words(table.index(column)) for name, column in named.items() if column}
    if columns.temperature:
        fields["temperature_degC"] = _carried_on(numbers_in_unit(table, columns.temperature, "degC"))
    numbers = {
        name: numbers_in_unit(table, column, unit_of_name(name), unit if name.endswith("_mm") else None)
        for name, column in columns.others.items()
        if name not in OTHER_NAMES
    }
    fields |= {name: v for name, v in numbers.items() if name in (*ANCHOR_DISTANCE, *SHARED_UNCERTAINTIES)}
    if sphere := [numbers[name] for name in SPHERE_DISTANCE if name in numbers]:
        if len(sphere) < 2:
            raise InputError(f"expected both {' and '.join(SPHERE_DISTANCE)}, got one of them")
        fields["sphere_distance"] = np.stack(sphere, axis=1)
    directions = {int(name.removeprefix(DIRECTION)): v for name, v in numbers.items() if name.startswith(DIRECTION)}
    if directions:
        if sorted(directions) != list(range(1, len(columns.angles) + 1)):
            raise InputError(f"expected a direction of each of {len(columns.angles)} joints, got {sorted(directions)}")
        fields["directions"] = np.stack([directions[i] for i in sorted(directions)], axis=1)
    fields["columns"] = {name: v for name, v in numbers.items() if LOAD.fullmatch(name)}
    return fields


def _state_uncertainty(fields: dict[str, Any], u_mm: float) -> None:
    """State one standard uncertainty for all points, or all distances, that have none [mm]."""
    points = fields.get("points")
    if points is not None and "point_std" not in fields:
        fields["point_std"] = np.where(np.isnan(points), np.nan, u_mm)
    elif fields.get("distance_mm") is not None and "u_distance_mm" not in fields:
        fields["u_distance_mm"] = np.where(np.isnan(fields["distance_mm"]), np.nan, u_mm)
    else:
        raise InputError("an uncertainty is given, but there is no point or distance without one", hint="omit --u-mm")


def _carried_on(degC: FloatArray) -> FloatArray:
    """Temperatures that were not logged in every row: the last one above, or the first below."""
    import pandas as pd

    return np.asarray(pd.Series(degC).ffill().bfill(), dtype=float)


def _positions(table: Table, columns: Sequence[str]) -> NameArray | None:
    """Join columns to one name; numbers are rounded first, so that 0.8 and 0.80000001 name one position."""
    if not columns:
        return None
    texts = [_rounded(table, table.index(column)) for column in columns]
    return np.array([" ".join(row) for row in zip(*texts, strict=True)], dtype=np.str_)


def _rounded(table: Table, index: int) -> list[str]:
    if table.columns[index].dtype.kind != "f" or not np.isfinite(numbers := table.numbers(index)).all():
        return list(table.words(index).tolist())
    return [f"{v:.15g}" for v in (np.round(numbers, _POSITION_DECIMALS) + 0.0).tolist()]  # + 0.0: no "-0"
