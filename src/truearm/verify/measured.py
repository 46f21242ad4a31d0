"""Measured points: which test, artefact, place and run each belongs to.

The file (CSV, docs/verification.md) has one row a point. Which of the columns a test needs stands in `KEYS`; the cells
of the others stay empty. Points that come from elsewhere than a file are made into groups (`Measured.of`).
"""

from __future__ import annotations

import datetime
import difflib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.readings.delimited import Sheet, check_names, read_columns, read_sheet, shown
from truearm.readings.expansion import COLDEST_DEGC, WARMEST_DEGC
from truearm.verify.days import check_past
from truearm.verify.documents import without_controls
from truearm.verify.orthogonal import FloatArray

NameArray = npt.NDArray[np.str_]

# The columns that tell the groups of a test's points apart, outermost first.
KEYS: dict[str, tuple[str, ...]] = {
    "probing": ("position",),
    "articulation": ("position", "group"),
    "uni": ("length", "position", "repeat", "end"),
    "bi": ("length", "position", "repeat", "end"),
    "effective_diameter": ("repeat",),
    "single_point": ("position",),
    "volumetric": ("length", "position", "end"),
}
ENDS = ("A", "B")
# Tests that compare with a calibrated size, which grows with temperature.
SIZED = ("probing", "uni", "bi", "effective_diameter", "volumetric")

# Chosen here: temperatures of one group, or of both ends of a length, that differ by more are not averaged.
MOST_K_APART = 2.0
# A kilometre; no arm reaches there.
FARTHEST_MM = 1e6

POINT = ("x_mm", "y_mm", "z_mm")
TEMPERATURE, TIP = "artefact_degC", "tip_diameter_mm"
# Names that are listed in a message; of more, how many.
MOST_NAMED = 12
NEEDED = ("test", "artefact", "date", *POINT)
OPTIONAL = ("position", "length", "repeat", "end", "group", TEMPERATURE, TIP)


def named(names: Sequence[str], separator: str = ", ") -> str:
    """List names, the first of them if they are many."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return separator.join(names[:MOST_NAMED]) + more


@dataclass(frozen=True, eq=False)
class Group:
    """Points that belong together: touched in one go on one thing.

    Attributes
    ----------
    artefact : str
    keys : dict of str to str
        What tells it from the other groups of its test, by column.
    points : (n, 3) array
        [mm]
    degC : float
        Mean temperature of the artefact; NaN where the test needs none and none is given.
    tip_mm : float
        Diameter of the stylus tip where points are its centres; 0 where they are compensated.
    date : datetime.date
        The day it was measured.
    lines : tuple of int
        Of its points in the file, counted from 1; empty of points that come from no file.
    """

    artefact: str
    keys: dict[str, str]
    points: FloatArray
    degC: float
    tip_mm: float
    date: datetime.date
    lines: tuple[int, ...] = ()

    @property
    def line(self) -> int | None:
        """Of its first point in the file."""
        return self.lines[0] if self.lines else None

    @property
    def where(self) -> str:
        """The keys in words: ``position 3, repeat 2``."""
        return ", ".join(f"{key} {value}" for key, value in self.keys.items() if key != "end")


@dataclass(frozen=True, eq=False)
class Measured:
    """The groups of every test, as `read_points` finds them.

    Attributes
    ----------
    tests : dict of str to tuple of Group
    file : Path or None
        None of points that come from no file.
    """

    tests: dict[str, tuple[Group, ...]]
    file: Path | None = None

    @classmethod
    def of(cls, groups: Iterable[tuple[str, Group]]) -> Measured:
        """Points that come from no file: groups, each with the name of its test.

        Raises
        ------
        InputError
            If there is no such test, a group's keys are not its test's, or its points are not finite (n, 3) in mm.
        """
        tests: dict[str, list[Group]] = {}
        for test, group in groups:
            if test not in KEYS:
                raise InputError(f"unknown test {shown(test)}", hint=", ".join(KEYS))
            if set(group.keys) != set(KEYS[test]):
                came = ", ".join(group.keys) or "none"
                raise InputError(f"a group of test {test!r} is told by {', '.join(KEYS[test])}, got {came}")
            points = group.points
            if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0 or not np.isfinite(points).all():
                raise InputError(f"test {test!r}, {group.where}: expected finite points (n, 3), got {points.shape}")
            tests.setdefault(test, []).append(group)
        return cls({test: tuple(members) for test, members in tests.items()})

    def error(self, problem: str, group: Group | None = None, *, hint: str | None = None) -> InputError:
        """Make an error that knows the file, and the line of a group."""
        return InputError(problem, file=self.file, line=None if group is None else group.line, hint=hint)


def read_points(path: str | Path) -> Measured:
    """Read a file of measured points.

    Raises
    ------
    InputError
        If anything is not as the format demands: the file, the line and the column, and what to try.
    """
    path = Path(path)
    sheet = read_sheet(path)
    check_names(sheet, NEEDED, OPTIONAL, meant=_in_mm)
    columns = _columns(sheet)
    tests = {}
    for test in dict.fromkeys(columns.words["test"].tolist()):
        if test not in KEYS:
            close = difflib.get_close_matches(test, KEYS, n=1)
            raise columns.error(
                f"unknown test {shown(test)}",
                int(np.argmax(columns.words["test"] == test)),
                "test",
                hint=close[0] if close else ", ".join(KEYS),
            )
        tests[test] = tuple(_groups(columns, test))
    return Measured(tests, path)


@dataclass(frozen=True, eq=False)
class _Columns:
    """The columns of the file as arrays; those that are not there are full of empty cells."""

    numbers: dict[str, FloatArray]
    words: dict[str, NameArray]
    sheet: Sheet

    def error(self, problem: str, row: int, column: str, *, hint: str | None = None) -> InputError:
        return InputError(problem, file=self.sheet.file, line=self.sheet.first_line + row, column=column, hint=hint)


def _in_mm(column: str) -> str | None:
    """The name that a coordinate in another unit, or in none, should have."""
    is_coordinate = column[:1] in ("x", "y", "z") and column[1:2] in ("", "_")
    return f"{column[0]}_mm: coordinates in mm; convert others first" if is_coordinate else None


def _columns(sheet: Sheet) -> _Columns:
    numbers = [*POINT, *(name for name in (TEMPERATURE, TIP) if name in sheet.names)]
    words = [name for name in (*NEEDED, *OPTIONAL) if name in sheet.names and name not in numbers]
    index = sheet.names.index
    optional = [index(name) for name in numbers if name not in POINT]
    found, texts = read_columns(sheet, [index(n) for n in numbers], [index(n) for n in words], optional)
    by_name = {name: np.char.strip(text) for name, text in zip(words, texts, strict=True)}
    empty = np.full(len(found), "")
    return _Columns(
        {
            name: found[:, numbers.index(name)] if name in numbers else np.full(len(found), np.nan)
            for name in (*POINT, TEMPERATURE, TIP)
        },
        {name: by_name.get(name, empty) for name in (*NEEDED[:3], *OPTIONAL[:5])},
        sheet,
    )


def _groups(columns: _Columns, test: str) -> Iterator[Group]:
    """The groups of a test in the order of their first points."""
    keys = KEYS[test]
    rows = np.flatnonzero(columns.words["test"] == test)
    for key in ("artefact", "date", *keys):
        cells = columns.words[key][rows]
        if (cells == "").any():
            row = int(rows[np.argmax(cells == "")])
            raise columns.error(f"a point of test {test!r} needs {key!r}, got an empty cell", row, key)
        for cell in np.unique(cells):
            try:
                without_controls(str(cell))
            except InputError as error:
                raise columns.error(error.problem, int(rows[np.argmax(cells == cell)]), key) from None
        if key == "repeat" and not np.char.isdecimal(cells).all():
            row = int(rows[np.argmin(np.char.isdecimal(cells))])
            raise columns.error(
                f"expected a whole number 1, 2, .., got {shown(str(columns.words[key][row]))}", row, key
            )
        if key == "end" and not np.isin(cells, ENDS).all():
            row = int(rows[np.argmin(np.isin(cells, ENDS))])
            raise columns.error(f"expected A or B, got {shown(str(columns.words[key][row]))}", row, key)
    for key in ("position", "length", "repeat", "end", "group"):
        cells = columns.words[key][rows]
        if key not in keys and (cells != "").any():
            row = int(rows[np.argmax(cells != "")])
            raise columns.error(
                f"a point of test {test!r} has no {key!r}, got {shown(str(columns.words[key][row]))}",
                row,
                key,
                hint=f"it is told by artefact, {', '.join(keys)}: leave the cell empty",
            )
    members: dict[tuple[str, ...], list[int]] = {}
    for row in rows.tolist():
        told = tuple(str(columns.words[key][row]) for key in ("artefact", *keys))
        members.setdefault(told, []).append(row)
    for told, inside in members.items():
        yield _group(columns, test, told, inside)


def _group(columns: _Columns, test: str, told: tuple[str, ...], rows: list[int]) -> Group:
    days = columns.words["date"][rows]
    if (days != days[0]).any():
        row = rows[int(np.argmax(days != days[0]))]
        raise columns.error(
            f"points of one group were taken on {days[0]} and on {columns.words['date'][row]}", row, "date"
        )
    try:
        day = datetime.date.fromisoformat(str(days[0]))
    except ValueError:
        raise columns.error(
            f"expected a date, got {shown(str(days[0]))}", rows[0], "date", hint="2026-03-31: year, month, day"
        ) from None
    try:
        check_past(day)
    except InputError as error:
        raise columns.error(error.problem, rows[0], "date", hint=error.hint) from None
    degC = columns.numbers[TEMPERATURE][rows]
    if test in SIZED and np.isnan(degC).any():
        raise columns.error(
            f"a point of test {test!r} needs the temperature of the artefact, to compare with its size at 20 degC",
            rows[int(np.argmax(np.isnan(degC)))],
            TEMPERATURE,
            hint="fill in what the thermometer on the artefact showed",
        )
    if (absurd := (degC < COLDEST_DEGC) | (degC > WARMEST_DEGC)).any():
        row = rows[int(np.argmax(absurd))]
        raise columns.error(
            f"expected the temperature of the artefact in degC, got {columns.numbers[TEMPERATURE][row]:g}",
            row,
            TEMPERATURE,
            hint="degrees Fahrenheit less 32, over 1.8, are degC",
        )
    tip = np.nan_to_num(columns.numbers[TIP][rows])
    if (tip != tip[0]).any() or tip[0] < 0:
        row = rows[int(np.argmax(tip != tip[0]))]
        raise columns.error(
            f"expected one tip diameter of 0 or more for the group, got {tip.min():g} to {tip.max():g} mm", row, TIP
        )
    points = np.column_stack([columns.numbers[name][rows] for name in POINT])
    if (np.abs(points) > FARTHEST_MM).any():
        row, axis = (int(i) for i in np.argwhere(np.abs(points) > FARTHEST_MM)[0])
        problem = f"expected a coordinate within {FARTHEST_MM:g} mm, got {points[row, axis]:g} mm"
        raise columns.error(problem, rows[row], POINT[axis])
    known = degC[~np.isnan(degC)]
    if len(known) and np.ptp(known) > MOST_K_APART:
        raise columns.error(
            f"points of one group were taken at {known.min():g} and at {known.max():g} degC: their mean tells nothing",
            rows[0],
            TEMPERATURE,
            hint="measure the group again when the artefact keeps its temperature",
        )
    return Group(
        artefact=told[0],
        keys=dict(zip(KEYS[test], told[1:], strict=True)),
        points=points,
        degC=float(known.mean()) if len(known) else float("nan"),
        tip_mm=float(tip[0]),
        date=day,
        lines=tuple(columns.sheet.first_line + row for row in rows),
    )
