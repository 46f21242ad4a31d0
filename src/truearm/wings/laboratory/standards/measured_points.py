"""Measured points: the test, artefact, position and run of each.

The file (CSV, docs/verification.md) has one row for each point. `KEY_COLUMNS` lists the columns that a test needs; the
cells of the others are empty. Points from a program are given as groups (`MeasuredPoints.of`).
"""

from __future__ import annotations

import datetime
import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from truearm.errors import InputError
from truearm.files.dates import parse_day
from truearm.files.delimited import Sheet, check_names, quoted_cell, read_columns, read_form
from truearm.files.toml_documents import reject_control_characters
from truearm.readings.thermal_expansion import ThermalExpansion
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray
from truearm.wings.laboratory.standards.coordinate_origin import (
    NOT_STATED,
    ORIGIN_COLUMNS,
    CoordinateOrigin,
    origin_of_cells,
)

T = TypeVar("T")

# The columns that identify a group of points in a test, outermost first.
KEY_COLUMNS: dict[str, tuple[str, ...]] = {
    "probing": ("position",),
    "articulation": ("position", "group"),
    "uni": ("length", "position", "repeat", "end"),
    "bi": ("length", "position", "repeat", "end"),
    "effective_diameter": ("repeat",),
    "single_point": ("position",),
    "volumetric": ("length", "position", "end"),
}
ENDS = ("A", "B")
# Tests that compare with a calibrated size, which depends on temperature.
SIZE_TESTS = ("probing", "uni", "bi", "effective_diameter", "volumetric")

# Chosen here: temperatures within a group, or at both ends of a length, that differ by more are not averaged.
MAX_TEMPERATURE_SPREAD_K = 2.0
# A kilometre; no arm reaches there.
FARTHEST_MM = 1e6

POINT = ("x_mm", "y_mm", "z_mm")
TEMPERATURE, TIP = "artefact_degC", "tip_diameter_mm"
# The smallest balls of styli, and the largest tips in use [mm]; 0: the points are compensated.
SMALLEST_TIP_MM, LARGEST_TIP_MM = 0.1, 50.0
TIP_SIZES = f"0, or the diameter of a stylus tip from {SMALLEST_TIP_MM:g} to {LARGEST_TIP_MM:g} mm"
# No room where people measure is drier: 0.40 is a share.
LEAST_HUMIDITY_PERCENT = 2.0
# Conditions of the measurement that a specification may rate, in any row of a group: words and unit, and the least and
# the largest possible value; others are in another unit.
CONDITIONS: Mapping[str, tuple[str, str, float, float]] = {
    "air_degC": ("temperature of the air", "degC", ThermalExpansion.coldest_degC, ThermalExpansion.warmest_degC),
    "air_K_per_h": ("change of the air's temperature", "K/h", 0.0, 100.0),
    "air_K_per_m": ("gradient of the air's temperature", "K/m", 0.0, 100.0),
    "warm_up_min": ("warm-up time", "min", 0.0, 1e5),
    "humidity_percent": ("relative humidity", "%", LEAST_HUMIDITY_PERCENT, 100.0),
}
# The greatest number of names in a message.
MOST_NAMED = 12
REQUIRED_COLUMNS = ("test", "artefact", "date", *POINT)
OPTIONAL_COLUMNS = ("position", "length", "repeat", "end", "group", TEMPERATURE, TIP)
# Of the arm that measured, in any row; what was accepted of its readings, with the reason; origin of coordinates.
SERIAL_NUMBER, ACCEPTED = "serial_number", "accepted"
# Of the artefact, as engraved, in any row of a group.
ARTEFACT_SERIAL = "artefact_serial_number"
SAID_COLUMNS = (SERIAL_NUMBER, ACCEPTED, ARTEFACT_SERIAL, *ORIGIN_COLUMNS)


def join_names(names: Sequence[str], separator: str = ", ") -> str:
    """Join names to a list; of many, the first ones and the number of the others."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return separator.join(names[:MOST_NAMED]) + more


def is_tip_diameter(diameter_mm: FloatArray) -> BoolArray:
    """Whether diameters are 0 or those of stylus tips."""
    return np.asarray((diameter_mm == 0) | ((diameter_mm >= SMALLEST_TIP_MM) & (diameter_mm <= LARGEST_TIP_MM)))


@dataclass(frozen=True, eq=False)
class PointGroup:
    """Points that belong together: measured in one go on one artefact.

    Attributes
    ----------
    artefact : str
    keys : dict of str to str
        Position, repeat, end etc., by column.
    points : (n, 3) array
        [mm]
    degC : float
        Mean temperature of the artefact; NaN where it is not given and the test needs none.
    tip_mm : float
        Diameter of the stylus tip where points are its centres; 0 where they are compensated.
    date : datetime.date
        Day of the measurement.
    serial_number : str
        Of the artefact, as the points state it; empty if they state none.
    lines : tuple of int
        Lines of its points in the file, counted from 1; empty for points from a program.
    conditions : dict of str to (float, float)
        The lowest and the highest value of each of `CONDITIONS` that is stated.
    """

    artefact: str
    keys: dict[str, str]
    points: FloatArray
    degC: float
    tip_mm: float
    date: datetime.date
    lines: tuple[int, ...] = ()
    conditions: dict[str, tuple[float, float]] = field(default_factory=dict)
    serial_number: str = ""

    @property
    def line(self) -> int | None:
        """The line of its first point in the file; None for points from a program."""
        return self.lines[0] if self.lines else None

    @property
    def where(self) -> str:
        """The keys as text: ``position 3, repeat 2``."""
        return ", ".join(f"{key} {value}" for key, value in self.keys.items() if key != "end")


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """The groups of every test.

    Attributes
    ----------
    tests : dict of str to tuple of PointGroup
    file : Path or None
        None for points from a program.
    serial_number : str
        Of the arm that measured them; empty if it is not stated.
    accepted : tuple of str
        Contradictions that were accepted where points were predicted from joint angles, with the reasons.
    origin : CoordinateOrigin
        Where the coordinates come from.

    Examples
    --------
    >>> import truearm as ta
    >>> points = ta.simulate_verification("perfect", n_arms=1).points(0)
    >>> len(points.tests) > 1
    True
    """

    tests: dict[str, tuple[PointGroup, ...]]
    file: Path | None = None
    serial_number: str = ""
    accepted: tuple[str, ...] = ()
    origin: CoordinateOrigin = NOT_STATED

    @classmethod
    def of(
        cls, groups: Iterable[tuple[str, PointGroup]], *, serial_number: str = "", origin: CoordinateOrigin = NOT_STATED
    ) -> MeasuredPoints:
        """Make measured points from groups, each with the name of its test; serial number of the arm, and origin.

        Raises
        ------
        InputError
            If there is no such test, a group's keys are not its test's, or its points are not finite (n, 3) in mm.
        """
        tests: dict[str, list[PointGroup]] = {}
        for test, group in groups:
            if test not in KEY_COLUMNS:
                raise InputError(f"unknown test {quoted_cell(test)}", hint=f"use one of {', '.join(KEY_COLUMNS)}")
            if set(group.keys) != set(KEY_COLUMNS[test]):
                came = ", ".join(group.keys) or "none"
                raise InputError(f"a group of test {test!r} has the keys {', '.join(KEY_COLUMNS[test])}, got {came}")
            points = group.points
            if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0 or not np.isfinite(points).all():
                raise InputError(f"test {test!r}, {group.where}: expected finite points (n, 3), got {points.shape}")
            tests.setdefault(test, []).append(group)
        by_test = {test: tuple(members) for test, members in tests.items()}
        return cls(by_test, serial_number=serial_number, origin=origin)

    def error(self, problem: str, group: PointGroup | None = None, *, hint: str | None = None) -> InputError:
        """Return an error with the file, and the line of a group."""
        return InputError(problem, file=self.file, line=None if group is None else group.line, hint=hint)


def read_points(path: str | Path) -> MeasuredPoints:
    r"""Read a file of measured points.

    Raises
    ------
    InputError
        If anything breaks a rule of the format: with file, line, column and remedy.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> rows = [f"single_point,cone,2026-01-20,1,0,0,{i / 1000}" for i in range(10)]
    >>> _ = Path("points.csv").write_text("test,artefact,date,position,x_mm,y_mm,z_mm\n" + "\n".join(rows) + "\n")
    >>> list(ta.read_points("points.csv").tests)
    ['single_point']
    """
    path = Path(path)
    sheet = read_form(path)
    check_names(sheet, REQUIRED_COLUMNS, (*OPTIONAL_COLUMNS, *CONDITIONS, *SAID_COLUMNS), meant=_in_mm)
    columns = _columns(sheet)
    tests = {}
    for test in dict.fromkeys(columns.words["test"].tolist()):
        if test not in KEY_COLUMNS:
            close = difflib.get_close_matches(test, KEY_COLUMNS, n=1)
            row, hint = (
                int(np.argmax(columns.words["test"] == test)),
                f"use {close[0] if close else ', '.join(KEY_COLUMNS)}",
            )
            raise columns.error(f"unknown test {quoted_cell(test)}", row, "test", hint=hint)
        tests[test] = tuple(_groups(columns, test))
    said = {
        columns.parsed(reject_control_characters, row, ACCEPTED)
        for row in np.flatnonzero(columns.words[ACCEPTED]).tolist()
    }
    origin = origin_of_cells(columns.words, sheet.first_line, columns.error)
    every = range(len(columns.words["test"]))
    number = _one_serial_number(columns, every, SERIAL_NUMBER, "points of one arm")
    return MeasuredPoints(tests, path, number, tuple(sorted(said)), origin)


@dataclass(frozen=True, eq=False)
class _Columns:
    """The columns of the file as arrays; missing columns are filled with empty cells."""

    numbers: dict[str, FloatArray]
    words: dict[str, NameArray]
    sheet: Sheet

    @cached_property
    def conditions(self) -> tuple[str, ...]:
        """Conditions that some row of the file states."""
        return tuple(name for name in CONDITIONS if not np.isnan(self.numbers[name]).all())

    def error(self, problem: str, row: int, column: str, hint: str | None = None) -> InputError:
        return InputError(problem, file=self.sheet.file, line=self.sheet.first_line + row, column=column, hint=hint)

    def refuse(
        self,
        wrong: BoolArray,
        rows: Sequence[int] | IntArray,
        column: str,
        problem: str | tuple[str, str],
        hint: str | None = None,
    ) -> None:
        """Refuse the first of some rows that is wrong; a problem in two parts has its cell between them."""
        if wrong.any():
            row = int(rows[int(np.argmax(wrong))])
            cell = (
                quoted_cell(str(self.words[column][row])) if column in self.words else f"{self.numbers[column][row]:g}"
            )
            raise self.error(problem if isinstance(problem, str) else cell.join(problem), row, column, hint=hint)

    def parsed(self, parse: Callable[[str], T], row: int, column: str) -> T:
        """What the text of a cell means; an error of `parse` gets its place."""
        try:
            return parse(str(self.words[column][row]))
        except InputError as error:
            raise self.error(error.problem, row, column, hint=error.hint) from None


def _in_mm(column: str) -> str | None:
    """The correct name of a coordinate in another unit, or in none."""
    is_coordinate = column[:1] in ("x", "y", "z") and column[1:2] in ("", "_")
    return f"{column[0]}_mm, with coordinates in mm; convert other units first" if is_coordinate else None


def _columns(sheet: Sheet) -> _Columns:
    numbers = [*POINT, *(name for name in (TEMPERATURE, TIP, *CONDITIONS) if name in sheet.names)]
    texts_of = (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS, *SAID_COLUMNS)
    words = [name for name in texts_of if name in sheet.names and name not in numbers]
    index = sheet.names.index
    optional = [index(name) for name in numbers if name not in POINT]
    found, texts = read_columns(sheet, [index(n) for n in numbers], [index(n) for n in words], optional)
    by_name = {name: np.char.strip(text) for name, text in zip(words, texts, strict=True)}
    empty = np.full(len(found), "")
    return _Columns(
        {
            name: found[:, numbers.index(name)] if name in numbers else np.full(len(found), np.nan)
            for name in (*POINT, TEMPERATURE, TIP, *CONDITIONS)
        },
        {name: by_name.get(name, empty) for name in (*REQUIRED_COLUMNS[:3], *OPTIONAL_COLUMNS[:5], *SAID_COLUMNS)},
        sheet,
    )


def _one_serial_number(columns: _Columns, rows: Sequence[int] | IntArray, column: str, expected: str) -> str:
    """The serial number that some of the rows state; empty if none does, refused if they state two."""
    cells = columns.words[column][rows]
    stated = np.asarray(rows, dtype=np.intp)[cells != ""]
    if not len(stated):
        return ""
    number = columns.parsed(reject_control_characters, int(stated[0]), column)
    columns.refuse(
        columns.words[column][stated] != number,
        stated,
        column,
        (f"expected {expected}, got serial numbers {quoted_cell(number)} and ", ""),
        "correct the serial number that is wrong, or divide the file or the group",
    )
    return number


def _groups(columns: _Columns, test: str) -> Iterator[PointGroup]:
    """The groups of a test, in the order of their first points."""
    keys = KEY_COLUMNS[test]
    rows = np.flatnonzero(columns.words["test"] == test)
    for key in ("artefact", "date", *keys):
        cells = columns.words[key][rows]
        needed = f"a point of test {test!r} needs {key!r}, got an empty cell"
        columns.refuse(cells == "", rows, key, needed, "fill the cell in")
        for at in np.unique(cells, return_index=True)[1]:
            columns.parsed(reject_control_characters, int(rows[at]), key)
        if key == "repeat":
            columns.refuse(~np.char.isdecimal(cells), rows, key, ("expected a whole number 1, 2, .., got ", ""))
        if key == "end":
            columns.refuse(~np.isin(cells, ENDS), rows, key, ("expected A or B, got ", ""))
    for key in ("position", "length", "repeat", "end", "group"):
        if key not in keys:
            hint = f"leave the cell empty: this test uses artefact, {', '.join(keys)}"
            stated = columns.words[key][rows] != ""
            columns.refuse(stated, rows, key, (f"a point of test {test!r} has no {key!r}, got ", ""), hint)
    _check_numbers(columns, test, rows)
    members: dict[tuple[str, ...], list[int]] = {}
    for row in rows.tolist():
        identity = tuple(str(columns.words[key][row]) for key in ("artefact", *keys))
        members.setdefault(identity, []).append(row)
    for identity, inside in members.items():
        yield _group(columns, test, identity, inside)


def _check_numbers(columns: _Columns, test: str, rows: IntArray) -> None:
    """Refuse numbers of a test that cannot be what they are called."""
    degC = columns.numbers[TEMPERATURE][rows]
    columns.refuse(
        np.isnan(degC) & (test in SIZE_TESTS),
        rows,
        TEMPERATURE,
        f"a point of test {test!r} needs the temperature of the artefact, to compare with its size at 20 degC",
        "enter the temperature that the thermometer on the artefact showed",
    )
    columns.refuse(
        (degC < ThermalExpansion.coldest_degC) | (degC > ThermalExpansion.warmest_degC),
        rows,
        TEMPERATURE,
        ("expected the temperature of the artefact in degC, got ", ""),
        "convert from Fahrenheit: (F - 32) / 1.8",
    )
    no_tip, in_mm = (f"expected {TIP_SIZES}, got ", ""), "write it in mm: 6 for a ball of 6 mm"
    columns.refuse(~is_tip_diameter(np.nan_to_num(columns.numbers[TIP][rows])), rows, TIP, no_tip, in_mm)
    for name in POINT:
        problem = (f"expected a coordinate within {FARTHEST_MM:g} mm, got ", " mm")
        columns.refuse(
            np.abs(columns.numbers[name][rows]) > FARTHEST_MM, rows, name, problem, "write coordinates in mm"
        )
    for name, (_, _, least, most) in CONDITIONS.items():
        values, hint = columns.numbers[name][rows], "check the unit, which is in the name of the column"
        problem = (f"expected {name} from {least:g} to {most:g}, got ", "")
        columns.refuse((values < least) | (values > most), rows, name, problem, hint)


def _artefact_degC(columns: _Columns, rows: list[int]) -> float:
    """Mean temperature of the artefact of a group of points [degC]; NaN if none is stated."""
    degC = columns.numbers[TEMPERATURE][rows]
    known = degC[~np.isnan(degC)]
    if len(known) and np.ptp(known) > MAX_TEMPERATURE_SPREAD_K:
        raise columns.error(
            f"points of one group were measured at {known.min():g} and at {known.max():g} degC: no definite "
            "temperature",
            rows[0],
            TEMPERATURE,
            hint="measure the group again when the temperature of the artefact is stable",
        )
    return float(known.mean()) if len(known) else float("nan")


def _group(columns: _Columns, test: str, identity: tuple[str, ...], rows: list[int]) -> PointGroup:
    days = columns.words["date"][rows]
    if (others := days != days[0]).any():
        row = rows[int(np.argmax(others))]
        raise columns.error(
            f"points of one group were measured on {days[0]} and on {columns.words['date'][row]}",
            row,
            "date",
            hint="measure a group on one day; correct the date if it is mistyped",
        )
    day = columns.parsed(parse_day, rows[0], "date")
    degC = _artefact_degC(columns, rows)
    tip = np.nan_to_num(columns.numbers[TIP][rows])
    columns.refuse(
        tip != tip[0],
        rows,
        TIP,
        f"expected one tip diameter for the group, got {tip.min():g} to {tip.max():g} mm",
        "write the same diameter in all rows of the group",
    )
    return PointGroup(
        artefact=identity[0],
        keys=dict(zip(KEY_COLUMNS[test], identity[1:], strict=True)),
        points=np.column_stack([columns.numbers[name][rows] for name in POINT]),
        degC=degC,
        tip_mm=float(tip[0]),
        date=day,
        lines=tuple(columns.sheet.first_line + row for row in rows),
        conditions=_conditions(columns, rows),
        serial_number=_one_serial_number(columns, rows, ARTEFACT_SERIAL, "a group on one artefact"),
    )


def _conditions(columns: _Columns, rows: list[int]) -> dict[str, tuple[float, float]]:
    """The conditions that some of the rows state."""
    values = ((name, columns.numbers[name][rows]) for name in columns.conditions)
    return {name: (float(np.nanmin(one)), float(np.nanmax(one))) for name, one in values if not np.isnan(one).all()}
