"""Import of tables with other column names, separators, decimal signs and units, or encoder counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar, get_args

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import Sheet, quoted_cell, read_columns, read_sheet
from truearm.readings.orientations import OrientationUnit, check_orientation_columns, read_orientations
from truearm.readings.session import Session
from truearm.typing import FloatArray, NameArray

JointUnit = Literal["deg", "rad", "counts", "mm"]
PointUnit = Literal["mm", "m", "um", "in"]
_T = TypeVar("_T")

_TO_MM: dict[str, float] = {"mm": 1.0, "m": 1000.0, "um": 0.001, "in": 25.4}

# Goal coordinates that differ by less than this many decimals name one position.
_POSITION_DECIMALS = 6


@dataclass(frozen=True)
class TableColumns:
    """Which column of a table holds what: each by its name in the header, or by its number counted from 1.

    Parameters
    ----------
    angles : sequence of str
        One column a joint, base to tip.
    points, point_std : sequence of three str, optional
        Reference point and its standard uncertainties, x, y, z.
    seat, session, temperature : str, optional
        Temperature in degC.
    position : sequence of str
        One column, or several that together name the position a reading aimed at, as its goal x, y and z.
    orientation : sequence of str
        Orientation of the flange in the frame of the points: 3 columns of a rotation vector, 4 of a quaternion (w
        first), or 9, 12 or 16 of a matrix, row by row. A matrix of 12 or 16 has the point too, in its last column.
    """

    angles: Sequence[str]
    points: Sequence[str] = ()
    point_std: Sequence[str] = ()
    seat: str | None = None
    session: str | None = None
    temperature: str | None = None
    position: Sequence[str] = ()
    orientation: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not self.angles:
            raise InputError("expected at least one column of angles, got none", hint="--angles 'J1,J2,J3'")
        for name in ("points", "point_std"):
            if len(getattr(self, name)) not in (0, 3):
                raise InputError(f"expected three columns (x, y, z) for {name}, got {len(getattr(self, name))}")
        if len(self.orientation) in (12, 16) and self.points:
            raise InputError("the points are given twice, by columns of their own and by the last column of a matrix")
        if self.point_std and not self.points and len(self.orientation) not in (12, 16):
            raise InputError("point_std needs points: without a reference point it has no meaning")


@dataclass(frozen=True)
class JointScale:
    """Conversion of a table's joint values to angles: ``sign (value - zero) factor``, in rad (sliding joints in mm).

    Parameters
    ----------
    unit : str or sequence of str
        ``deg``, ``rad``, ``counts`` of an encoder, or ``mm`` for a sliding joint; one for all joints or one each.
    counts_per_turn : float or sequence, optional
        For ``counts``: how many make a full turn; one for all joints or one each.
    sign : sequence of {1, -1}, optional
        One a joint; all 1 by default.
    zero : sequence of float, optional
        The table's value where the angle is zero, in the table's unit, one a joint; all 0 by default.
    """

    unit: JointUnit | Sequence[JointUnit]
    counts_per_turn: float | Sequence[float] | None = None
    sign: Sequence[float] | None = None
    zero: Sequence[float] | None = None

    def units(self, n_joints: int) -> list[str]:
        """List the unit of each joint."""
        units = [self.unit] if isinstance(self.unit, str) else list(self.unit)
        if bad := [u for u in units if u not in get_args(JointUnit)]:
            raise InputError(
                f"unknown unit of angles {quoted_cell(bad[0])}", hint=f"one of {', '.join(get_args(JointUnit))}"
            )
        return [str(u) for u in _for_each(units, n_joints, "angle unit")]

    def to_angles(self, values: FloatArray) -> FloatArray:
        """Scale (n, n_joints) values of a table to angles [rad], or displacements of sliding joints [mm]."""
        n = values.shape[1]
        factor = np.array([{"deg": np.pi / 180, "rad": 1.0, "mm": 1.0}.get(u, 2 * np.pi) for u in self.units(n)])
        counted = np.array([unit == "counts" for unit in self.units(n)])
        if counted.any():
            factor = factor / np.where(counted, self._per_turn(n), 1.0)
        sign = np.ones(n) if self.sign is None else np.array(_each(self.sign, n, "sign"), dtype=float)
        if not np.isin(sign, (1, -1)).all():
            raise InputError(f"signs must be + or - for each joint, got {quoted_cell(self.sign)}")
        zero = np.zeros(n) if self.zero is None else np.array(_for_each(self.zero, n, "zero"), dtype=float)
        if not np.isfinite(zero).all():
            raise InputError(f"zeros must be finite numbers, got {quoted_cell(self.zero)}")
        return np.asarray(sign * (values - zero) * factor + 0.0)  # + 0.0: no "-0"

    def _per_turn(self, n: int) -> FloatArray:
        if self.counts_per_turn is None:
            raise InputError("encoder counts need the counts of a full turn", hint="--counts-per-turn 65536")
        given = np.atleast_1d(np.asarray(self.counts_per_turn, dtype=float)).tolist()
        counts = np.array(_for_each(given, n, "counts per turn"))
        if not (np.isfinite(counts) & (counts > 0)).all():
            raise InputError(f"counts per turn must be positive, got {quoted_cell(self.counts_per_turn)}")
        return counts


def import_table(
    path: str | Path,
    columns: TableColumns,
    scale: JointScale,
    *,
    point_unit: PointUnit = "mm",
    orientation_unit: OrientationUnit | None = None,
    separator: str = ",",
    decimal: str = ".",
    header: bool = True,
    skip_lines: int = 0,
    encoding: str = "utf-8",
    session_name: str | None = None,
) -> Session:
    r"""Read a session from a table with other columns and units than the session file.

    Parameters
    ----------
    path : path
        Delimited text.
    columns : TableColumns
        Which column holds what.
    scale : JointScale
        How its joint values become angles.
    point_unit : {"mm", "m", "um", "in"}
        Unit of the points and their uncertainties.
    orientation_unit : {"deg", "rad"}, optional
        Unit of a rotation vector; it has no default.
    separator, decimal : str
        One character each; a blank as separator stands for one blank or more.
    header : bool
        Whether the first line names the columns; without, columns go by number.
    skip_lines : int
        Lines above the header, or above the first row, that do not belong to the table.
    encoding : str
        Any text encoding that Python knows.
    session_name : str, optional
        Name of the session of all readings, if no column holds it.

    Returns
    -------
    Session
        Angles in rad (sliding joints in mm), points in mm.

    Raises
    ------
    InputError
        If the table does not fit `columns` and `scale`; with file, line, column and what to do.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> from truearm.readings import JointScale, TableColumns
    >>> _ = Path("table.txt").write_text("J1;J2;X;Y;Z\n0,1;-0,2;0,5;0,0;0,25\n")
    >>> columns = TableColumns(["J1", "J2"], points=["X", "Y", "Z"])
    >>> session = ta.import_table("table.txt", columns, JointScale("rad"), point_unit="m", separator=";", decimal=",")
    >>> session.points.tolist()
    [[500.0, 0.0, 250.0]]
    """
    _check_point_unit(point_unit)
    if columns.session and session_name is not None:
        raise InputError("the session is given twice, by a column and by a name")
    check_orientation_columns(len(columns.orientation), orientation_unit)
    scale.to_angles(np.zeros((1, len(columns.angles))))  # wrong numbers of signs or zeros before the file is read
    sheet = read_sheet(
        path,
        separator=separator,
        decimal=decimal,
        encoding=encoding,
        header=header,
        skip_lines=skip_lines,
    )
    degC, named = (
        _optional(columns.temperature),
        (_optional(columns.seat), _optional(columns.session), columns.position),
    )
    groups = (columns.angles, columns.points, columns.point_std, degC, columns.orientation)
    numeric = [[_index(sheet, c) for c in g] for g in groups]
    words = [[_index(sheet, c) for c in g] for g in named]
    _check_once(sheet, [i for group in numeric for i in group])
    numbers, texts = read_columns(sheet, [i for g in numeric for i in g], [i for g in words for i in g])
    values, points, std, temperature, turned = np.split(numbers, np.cumsum([len(g) for g in numeric])[:-1], axis=1)
    quaternion = None
    if columns.orientation:
        names = [sheet.names[i] for i in numeric[4]]
        quaternion, inside = read_orientations(
            turned, orientation_unit, file=sheet.file, first_line=sheet.first_line, names=names
        )
        points = points if inside is None else inside
    seat, sessions = (
        next(iter(group), None) for group in (texts[: len(words[0])], texts[len(words[0]) :][: len(words[1])])
    )
    if session_name is not None:
        sessions = np.full(len(numbers), session_name)
    return Session(
        scale.to_angles(values),
        points * _TO_MM[point_unit] if points.size else None,
        point_std=std * _TO_MM[point_unit] if columns.point_std else None,
        seat=seat,
        position=_positions(texts[len(texts) - len(columns.position) :], decimal),
        session=sessions,
        quaternion=quaternion,
        temperature_degC=temperature[:, 0] if degC else None,
        file=sheet.file,
        angle_columns=tuple(sheet.names[i] for i in numeric[0]),
        numbers=np.arange(len(numbers)) + sheet.first_line,
        by_line=True,
    )


def import_points(
    path: str | Path,
    columns: Sequence[str],
    *,
    point_unit: PointUnit = "mm",
    separator: str = ",",
    decimal: str = ".",
    header: bool = True,
    skip_lines: int = 0,
    encoding: str = "utf-8",
) -> FloatArray:
    r"""Read points from a table, such as the export of a metrology program.

    Parameters
    ----------
    path : path
        Delimited text.
    columns : sequence of three str
        x, y and z: each by its name in the header, or by its number counted from 1.
    point_unit : {"mm", "m", "um", "in"}
        Unit of the points.
    separator, decimal, header, skip_lines, encoding
        See `import_table`.

    Returns
    -------
    (n, 3) array
        In the order of the table [mm].

    Raises
    ------
    InputError
        If the table does not fit `columns`; with file, line, column and what to do.

    Examples
    --------
    >>> from pathlib import Path
    >>> from truearm.readings import import_points
    >>> _ = Path("export.txt").write_text("point 1  0.5  0.25  1.0\npoint 2  0.5  0.75  1.0\n")
    >>> import_points("export.txt", ["3", "4", "5"], point_unit="in", separator=" ", header=False).tolist()
    [[12.7, 6.35, 25.4], [12.7, 19.05, 25.4]]
    """
    _check_point_unit(point_unit)
    if len(columns) != 3:
        raise InputError(f"expected three columns of points, got {len(columns)}", hint="--points 'X,Y,Z'")
    sheet = read_sheet(
        path, separator=separator, decimal=decimal, encoding=encoding, header=header, skip_lines=skip_lines
    )
    where = [_index(sheet, column) for column in columns]
    _check_once(sheet, where)
    numbers, _ = read_columns(sheet, where)
    return numbers * _TO_MM[point_unit]


def _check_point_unit(unit: str) -> None:
    if unit not in _TO_MM:
        raise InputError(f"unknown unit of points {quoted_cell(unit)}", hint=f"one of {', '.join(_TO_MM)}")


def _optional(column: str | None) -> tuple[str, ...]:
    return () if column is None else (column,)


def _index(sheet: Sheet, column: str) -> int:
    """Return the index of a column, given by its name in the header or by its number counted from 1."""
    name = column.strip()
    found = [i for i, n in enumerate(sheet.names) if n == name]
    if len(found) > 1:
        numbers = " and ".join(str(i + 1) for i in found)
        raise sheet.error(f"{quoted_cell(name)} names columns {numbers}", hint="give its number")
    if found:
        return found[0]
    if name.isdecimal() and 1 <= int(name) <= len(sheet.names):
        return int(name) - 1
    raise sheet.error(
        f"there is no column {quoted_cell(name)}; the columns are {_listed(sheet.names)}", hint=_other_separator(sheet)
    )


def _listed(names: Sequence[str], most: int = 30) -> str:
    if names[0] == "1":
        return f"1 .. {len(names)}"
    listed = ", ".join(name or "''" for name in names[:most])
    shortened = listed if len(listed) <= 600 else f"{listed[:600]}.."
    return shortened + (f" and {len(names) - most} more" if len(names) > most else "")


def _other_separator(sheet: Sheet) -> str | None:
    if len(sheet.names) > 1:
        return "give a column by its number if its name is hard to type"
    best = max(";,\t ", key=sheet.head.count)
    return f"--separator {'TAB' if best == chr(9) else repr(best)}" if best in sheet.head else None


def _check_once(sheet: Sheet, indices: Sequence[int]) -> None:
    for i in indices:
        if indices.count(i) > 1:
            raise InputError("the column is used for two things", file=sheet.file, column=sheet.names[i])


def _positions(parts: Sequence[NameArray], decimal: str) -> NameArray | None:
    """Join columns to one name; numbers are rounded first, so that 0.8 and 0.80000001 name one position."""
    if not parts:
        return None
    texts = [_rounded(part, decimal) for part in parts]
    return np.array([" ".join(row) for row in zip(*texts, strict=True)], dtype=np.str_)


def _rounded(words: NameArray, decimal: str) -> list[str]:
    try:
        numbers = np.char.replace(words, decimal, ".").astype(float)
    except ValueError:
        numbers = np.array([np.nan])
    if not np.isfinite(numbers).all():
        return list(words.tolist())
    return [f"{v:.15g}" for v in (np.round(numbers, _POSITION_DECIMALS) + 0.0).tolist()]  # + 0.0: no "-0"


def _for_each(given: Sequence[_T], n: int, what: str) -> list[_T]:
    """Repeat one value for all joints, or return one for each."""
    return list(given) * n if len(given) == 1 else _each(given, n, what)


def _each(given: Sequence[_T], n: int, what: str) -> list[_T]:
    if len(given) != n:
        raise InputError(f"expected one {what} for each of the {n} joints, got {len(given)}")
    return list(given)
