"""The points file of a test to fill in: one row for each point to measure, and its coordinates filled in later."""

from __future__ import annotations

import csv
import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_new_file
from truearm.files.dates import check_past
from truearm.files.delimited import Sheet, check_names, escape_formula, read_columns, read_form
from truearm.number_format import format_count
from truearm.readings.thermal_expansion import ThermalExpansion
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.wings.laboratory.standards.coordinate_origin import FROM as ORIGIN
from truearm.wings.laboratory.standards.coordinate_origin import NOT_STATED, OUTSIDE, CoordinateOrigin
from truearm.wings.laboratory.standards.layout import Placement
from truearm.wings.laboratory.standards.measured_points import (
    ACCEPTED,
    ARTEFACT_SERIAL,
    CONDITIONS,
    KEY_COLUMNS,
    OPTIONAL_COLUMNS,
    POINT,
    REQUIRED_COLUMNS,
    SAID_COLUMNS,
    SERIAL_NUMBER,
    SIZE_TESTS,
    TEMPERATURE,
    TIP,
    TIP_SIZES,
    is_tip_diameter,
)

KEYS = OPTIONAL_COLUMNS[:5]
PLANNED, FROM = ("note_x_mm", "note_y_mm", "note_z_mm"), ("note_from_x", "note_from_y", "note_from_z")
"""Columns of the planned point of contact [mm], and of the direction from there to the stylus, in the base frame."""

# Tests whose points are on a surface: the centre of the tip is half its diameter away from it.
ON_SURFACES = ("probing", "articulation", "effective_diameter", "bi")
# A point taken by hand is about this near to the planned one; a wrong row is farther where it matters [mm].
NEAR_MM = 20.0
# Artefacts stand some centimetres from their planned places. Where one is farther away than this, as seen from the
# others, and so many times nearer to the place of another one of its kind, the two are exchanged: chosen here.
AWAY_MM, NEARER = 100.0, 3.0


def write_points_form(
    layout: Sequence[Placement], path: str | Path, *, tip_diameter_mm: float | None = None, force: bool = False
) -> None:
    """Write the points of a layout to fill in, in the order of measuring.

    Coordinates, dates, temperatures and all that is stated of the arm are empty. The planned point and the direction of
    the stylus are in columns of notes, which `read_points` ignores.

    Parameters
    ----------
    layout : sequence of Placement
    path : path
        Ends in ``.csv``; must be new, as there may be points in it, unless `force` replaces it.
    tip_diameter_mm : float, optional
        Of the stylus tip, where the points will be its centres [mm]; written to the points on surfaces.

    Raises
    ------
    InputError
        If the file exists or cannot be written, or the diameter is that of no stylus tip.
    """
    check_new_file(path, force=force, endings=(".csv",))
    if tip_diameter_mm is not None and not is_tip_diameter(np.array(tip_diameter_mm)):
        raise InputError(f"expected {TIP_SIZES}, got {tip_diameter_mm:g}", hint="write it in mm: 6 for a ball of 6 mm")
    heads = (
        "test",
        "artefact",
        "date",
        *KEYS,
        *POINT,
        TEMPERATURE,
        TIP,
        SERIAL_NUMBER,
        ARTEFACT_SERIAL,
        ACCEPTED,
        ORIGIN,
        "note",
        *PLANNED,
        *FROM,
    )
    with atomic_file(path, read=read_planned_points) as beside, beside.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(heads)
        number = 0
        for one in layout:
            tip = "" if tip_diameter_mm is None or one.test not in ON_SURFACES else f"{tip_diameter_mm:g}"
            named = [escape_formula(cell) for cell in (one.test, one.artefact)]
            keys = [escape_formula(one.keys.get(key, "")) for key in KEYS]
            for at, approach in zip(one.points, one.approach, strict=True):
                number += 1
                aims = [f"{value:.3f}" for value in (*at, *approach)]
                writer.writerow([*named, "", *keys, "", "", "", "", tip, "", "", "", "", f"point {number}", *aims])


def fill_points_form(
    path: str | Path,
    points: npt.ArrayLike,
    *,
    day: datetime.date,
    artefact_degC: float | None = None,
    serial_number: str = "",
    accepted: str = "",
    origin: CoordinateOrigin = NOT_STATED,
    outside: BoolArray | None = None,
) -> int:
    """Enter measured points into the rows of a form that have no coordinates yet, in their order.

    Parameters
    ----------
    path : path
        File of `write_points_form`; written whole or not at all.
    points : (n, 3) array
        Centres of the stylus tip [mm].
    day : datetime.date
        Day of the measurement, entered where none is stated.
    artefact_degC : float, optional
        Temperature of the artefacts [degC], entered where a test needs one and none is stated.
    serial_number : str
        Of the arm, entered where the form has a column for it; empty if it is not known.
    accepted : str
        What was accepted of model or readings, with the reason; empty if nothing.
    origin : CoordinateOrigin, optional
        Where the coordinates come from.
    outside : (n,) array of bool, optional
        Which readings are outside the range that the model was trained on.

    Returns
    -------
    int
        Number of rows filled in.

    Raises
    ------
    InputError
        If there are more or fewer points than empty rows (the message says which point is likely missing or one too
        many), distances between points are not the planned ones (a point missed and another taken twice, or another
        order; the message names the first), a point on a surface has no tip diameter or a test lacks the temperature
        that it needs, the form states another serial
        number or has points of another origin, or day or temperature are implausible.
    """
    check_past(day)
    _check_temperature(artefact_degC)
    points = np.asarray(points, dtype=float)
    form = _read_form(path)
    form.check_same_item(serial_number, origin)
    rows = form.rows_of(points)
    if artefact_degC is None:
        form.check_temperatures(rows)
    same = {SERIAL_NUMBER: serial_number, ACCEPTED: accepted, **origin.cells}
    for at, (row, point) in enumerate(zip(rows.tolist(), points.tolist(), strict=True)):
        form.enter_point(row, point, day, artefact_degC)
        form.enter_texts(row, same if outside is None else {**same, OUTSIDE: str(int(outside[at]))})
    form.write()
    return len(rows)


def _check_temperature(artefact_degC: float | None) -> None:
    if (
        artefact_degC is not None
        and not ThermalExpansion.coldest_degC <= artefact_degC <= ThermalExpansion.warmest_degC
    ):
        raise InputError(
            f"expected an artefact at {ThermalExpansion.coldest_degC:g} to {ThermalExpansion.warmest_degC:g} degC, "
            f"got {artefact_degC:g}",
            hint="convert from Fahrenheit: (F - 32) / 1.8",
        )


def read_planned_points(path: str | Path) -> tuple[PlannedPoints, ...]:
    """Read the planned points of a form, group by group; what was filled in is not read.

    Raises
    ------
    InputError
        If the file is no form of `write_points_form`.
    """
    sheet = read_form(Path(path))
    _check_form(sheet)
    if missing := [name for name in (*PLANNED, *FROM) if name not in sheet.names]:
        raise sheet.error(
            f"expected the planned points, got no column {missing[0]}", hint="give the file of truearm verify sheet"
        )
    index = sheet.names.index
    numeric, words = [*PLANNED, *FROM, TIP], ["test", "artefact", *KEYS]
    numbers, texts = read_columns(sheet, list(map(index, numeric)), list(map(index, words)), [index(TIP)])
    cells = dict(zip(words, texts, strict=True))
    groups: dict[tuple[str, ...], list[int]] = {}
    for row in range(len(numbers)):
        test = str(cells["test"][row])
        if test not in KEY_COLUMNS:
            raise sheet.error(f"unknown test {test!r:.80}", row, column="test", hint=", ".join(KEY_COLUMNS))
        keys = (str(cells[key][row]) for key in KEY_COLUMNS[test])
        groups.setdefault((test, str(cells["artefact"][row]), *keys), []).append(row)
    return tuple(_planned(sheet, numbers, identity, np.array(rows)) for identity, rows in groups.items())


@dataclass(frozen=True, eq=False)
class PlannedPoints:
    """A group of points to measure on one artefact at one place, read from a form.

    Attributes
    ----------
    test, artefact : str
    keys : dict of str to str
        As of a `Placement`.
    points : (k, 3) array
        Planned points of contact in the base frame [mm].
    approach : (k, 3) array
        Unit vectors from there to the stylus.
    tip_mm : float
        Diameter of the stylus tip [mm]; 0 where none is stated.
    rows : (k,) int array
        Rows of the file, counted from 0.
    """

    test: str
    artefact: str
    keys: dict[str, str]
    points: FloatArray
    approach: FloatArray
    tip_mm: float
    rows: IntArray


def _planned(sheet: Sheet, numbers: FloatArray, identity: tuple[str, ...], rows: IntArray) -> PlannedPoints:
    approach, tip = numbers[rows, 3:6], np.nan_to_num(numbers[rows, 6])
    size = np.linalg.norm(approach, axis=1)
    if (wrong := np.abs(size - 1) > 0.01).any():
        raise sheet.error("expected a direction of length 1", int(rows[np.argmax(wrong)]), column=FROM[0])
    if np.ptp(tip) > 0 or tip[0] < 0:
        raise sheet.error("expected one tip diameter of 0 or more for the group", int(rows[0]), column=TIP)
    test, artefact, *keys = identity
    named = dict(zip(KEY_COLUMNS[test], keys, strict=True))
    return PlannedPoints(
        test, artefact, named, numbers[rows, :3], approach / size[:, None], float(tip[0]), rows.astype(np.intp)
    )


def _check_form(sheet: Sheet) -> None:
    check_names(sheet, REQUIRED_COLUMNS, (*OPTIONAL_COLUMNS, *CONDITIONS, *SAID_COLUMNS))
    for name in OPTIONAL_COLUMNS:
        if name not in sheet.names:
            raise sheet.error(f"the column {name} is missing", hint="give the file of truearm verify sheet")


def _read_form(path: str | Path) -> _Form:
    sheet = read_form(Path(path))
    _check_form(sheet)
    return _Form(sheet, list(sheet.names), [list(cells) for cells in sheet.rows()])


@dataclass(frozen=True, eq=False)
class _Form:
    """A form with all its cells as text."""

    sheet: Sheet
    names: list[str]
    cells: list[list[str]]

    def cell(self, row: int, column: str) -> str:
        """The text of a cell; empty where there is no such column."""
        return self.cells[row][self.names.index(column)].strip() if column in self.names else ""

    def number(self, row: int, column: str) -> float:
        """The number in a cell; ValueError where there is none."""
        return float(self.cell(row, column).replace(self.sheet.decimal, "."))

    def enter_number(self, row: int, column: str, text: str) -> None:
        self.enter(row, column, text.replace(".", self.sheet.decimal))

    def enter(self, row: int, column: str, text: str) -> None:
        """Write a cell; a column that the form lacks is appended."""
        if column not in self.names:
            self.names.append(column)
            for cells in self.cells:
                cells.append("")
        self.cells[row][self.names.index(column)] = text

    def enter_point(self, row: int, point: Sequence[float], day: datetime.date, artefact_degC: float | None) -> None:
        """Write coordinates, and the day and the temperature of the artefact where the row has none."""
        for name, value in zip(POINT, point, strict=True):
            self.enter_number(row, name, f"{value:.6f}")
        if not self.cell(row, "date"):
            self.enter(row, "date", day.isoformat())
        if artefact_degC is not None and self._lacks_temperature(row):
            self.enter_number(row, TEMPERATURE, f"{artefact_degC:g}")

    def enter_texts(self, row: int, texts: Mapping[str, str]) -> None:
        """Write texts, by their columns; an empty one leaves the cell."""
        for name, text in texts.items():
            if text:
                self.enter(row, name, escape_formula(text))

    def rows_of(self, points: FloatArray) -> IntArray:
        """The rows without coordinates that points (k, 3) fill in; refuses other points than the planned ones."""
        rows = self.empty_rows()
        if not len(rows):
            self.check_temperatures(np.arange(len(self.cells)))
            raise self.sheet.error("all points have coordinates already", hint="write a new form: truearm verify sheet")
        if len(points) != len(rows):
            raise self.mismatch(points, rows)
        if (first := self.first_elsewhere(points, rows)) is not None:
            raise self.elsewhere(int(rows[first]), first + 1)
        self._check_not_exchanged(points, rows)
        self._check_tips(rows)
        return rows

    def check_temperatures(self, rows: IntArray) -> None:
        """Check that the temperature of the artefact is stated in rows whose test needs it.

        Raises
        ------
        InputError
            With these tests, if it is not.
        """
        if lacking := [row for row in rows.tolist() if self._lacks_temperature(row)]:
            tests = dict.fromkeys(self.cell(row, "test") for row in lacking)
            raise self.sheet.error(
                f"the temperature of the artefacts is missing in {format_count(len(lacking), 'row')} of tests that "
                f"need it ({', '.join(tests)})",
                lacking[0],
                column=TEMPERATURE,
                hint="state it with --artefact-temperature; in rows that have coordinates, enter it in the file",
            )

    def _lacks_temperature(self, row: int) -> bool:
        return self.cell(row, "test") in SIZE_TESTS and not self.cell(row, TEMPERATURE)

    def _check_tips(self, rows: IntArray) -> None:
        """Check that the diameter of the tip is stated where points are on a surface."""
        for row in rows.tolist():
            if self.cell(row, "test") in ON_SURFACES and not self.cell(row, TIP):
                raise self.sheet.error(
                    "the point is the centre of the stylus tip, and the diameter of the tip is missing",
                    row,
                    column=TIP,
                    hint="enter it in all rows (0: the point itself), or write the form with --tip-diameter",
                )

    def check_same_item(self, serial_number: str, origin: CoordinateOrigin) -> None:
        """Check that no row states the serial number of another arm, and no point that is there has another origin.

        Raises
        ------
        InputError
            If one does.
        """
        new = ", ".join(filter(None, origin.cells.values())) or "not stated"
        for row in range(len(self.cells)):
            number = self.cell(row, SERIAL_NUMBER)
            if serial_number and number not in ("", serial_number, escape_formula(serial_number)):
                raise self.sheet.error(
                    f"the points are of the arm with serial number {number!r:.80}, the model is of "
                    f"{serial_number!r:.80}",
                    row,
                    column=SERIAL_NUMBER,
                    hint="give the model and the readings of the arm that is verified, or correct the number",
                )
            there = ", ".join(filter(None, (self.cell(row, name) for name in origin.cells))) or "not stated"
            if self.cell(row, POINT[0]) and there != new:
                raise self.sheet.error(
                    f"the coordinates of this point have another origin ({there}) than the new ones ({new})",
                    row,
                    column=ORIGIN,
                    hint="fill in a new form for points of another origin, or state the origin of these points",
                )

    def empty_rows(self) -> IntArray:
        """Rows without coordinates.

        Raises
        ------
        InputError
            If a row has some of its coordinates.
        """
        rows = []
        for row in range(len(self.cells)):
            given = [name for name in POINT if self.cell(row, name)]
            if given and len(given) < len(POINT):
                raise self.sheet.error("expected all three coordinates, or none", row, column=given[0])
            if not given:
                rows.append(row)
        return np.array(rows, dtype=np.intp)

    def mismatch(self, points: FloatArray, rows: IntArray) -> InputError:
        """The error of another number of points than rows, with the point that is likely missing or one too many."""
        problem = f"expected {len(rows)} readings for the points without coordinates, got {len(points)}"
        suspect = self._suspect(points, rows)
        hint = "one reading for each point, in the order of the file"
        if suspect is None:
            return self.sheet.error(problem, hint=hint)
        if len(points) < len(rows):
            row = int(rows[suspect])
            missing = f"{problem}; the reading of this point is likely missing: {self._where(row)}"
            return self.sheet.error(missing, row, hint=hint)
        return self.sheet.error(f"{problem}; reading {suspect + 1} is likely one too many", hint=hint)

    def first_elsewhere(self, points: FloatArray, rows: IntArray) -> int | None:
        """The first point that is not where the plan puts it, seen from the points of its group before it.

        Distances are the same in all frames, and within a group wherever its artefact stands. The points are centres
        of the tip, which may be on another side of the artefact than planned.
        """
        planned = self._planned(rows)
        if planned is None:
            return None
        groups: dict[tuple[str, ...], list[int]] = {}
        for at, row in enumerate(rows.tolist()):
            identity = tuple(self.cell(row, name) for name in ("test", "artefact"))
            keys = KEY_COLUMNS.get(identity[0], KEYS)
            groups.setdefault((*identity, *(self.cell(row, key) for key in keys)), []).append(at)
        bad = []
        for group in groups.values():
            off = np.abs(_distances(points[group]) - _distances(planned[group]))
            slack = NEAR_MM + max(self._tip_mm(int(rows[at])) for at in group)
            if (wrong := np.tril(off > slack).any(axis=1)).any():
                bad.append(group[int(np.argmax(wrong))])
        return min(bad, default=None)

    def _check_not_exchanged(self, points: FloatArray, rows: IntArray) -> None:
        """Refuse points of an artefact that lie where the plan has another one of its kind: by them it is that one.

        Distances to the other artefacts are the same in all frames; those to the origin count too, where they fit: a
        few artefacts in a line may look the same from both sides.
        """
        planned = self._planned(rows)
        if planned is None:
            return
        places: dict[tuple[str, ...], list[int]] = {}
        for at, row in enumerate(rows.tolist()):
            named = (self.cell(row, name) for name in ("test", "artefact", "length", "position"))
            places.setdefault(tuple(named), []).append(at)
        names = list(places)
        for origin in (False, True):
            seen, aimed = (self._seen_from(each, rows, places, origin=origin) for each in (points, planned))
            for i, one in enumerate(names):
                kind = [j for j, other in enumerate(names) if other[0] == one[0]]
                off = {
                    j: _median_off(seen[i], aimed[j], i, j) for j in kind if len(places[names[j]]) == len(places[one])
                }
                nearest = min(off, key=lambda j: off[j])
                if off[i] > AWAY_MM > off[nearest] and NEARER * off[nearest] < off[i]:
                    here, there = (int(rows[places[name][0]]) for name in (one, names[nearest]))
                    raise self.sheet.error(
                        f"reading {places[one][0] + 1} and those of its place are {off[i]:.3g} mm away from it, as "
                        f"seen from the other artefacts, and where the plan has {self._where(there)}: exchanged with "
                        f"{self._where(here)}",
                        here,
                        hint="bring the readings into the order of the file; if the artefacts stood elsewhere than "
                        "planned, correct note_x_mm, note_y_mm and note_z_mm",
                    )

    def _seen_from(
        self, points: FloatArray, rows: IntArray, places: Mapping[tuple[str, ...], list[int]], *, origin: bool
    ) -> FloatArray:
        """Distances of both ends of each place (twice its middle if it has none) to all middles, (n, m, 2) [mm]."""
        at = []
        for inside in places.values():
            of = [points[[i for i in inside if self.cell(int(rows[i]), "end") != end]] for end in "BA"]
            at.append([(one if len(one) else points[inside]).mean(axis=0) for one in of])
        ends = np.array(at)
        middles = ends.mean(axis=1)
        if origin:
            middles = np.concatenate([middles, np.zeros((1, 3))])
        # The nearest first: a bar turned end for end is in the same place.
        return np.sort(np.linalg.norm(ends[:, None] - middles[None, :, None], axis=3), axis=2)

    def elsewhere(self, row: int, reading: int) -> InputError:
        """The error of a point that is not where the plan puts it."""
        return self.sheet.error(
            f"reading {reading} is not at its place in the plan, by its distances to the points of its group before "
            f"it: {self._where(row)}",
            row,
            hint="look for a point missed, taken twice or in another order; from there on the readings fit other rows",
        )

    def _where(self, row: int) -> str:
        named = [self.cell(row, "test"), *(f"{key} {self.cell(row, key)}" for key in KEYS if self.cell(row, key))]
        note = self.cell(row, "note")
        return ", ".join([*named, *([note] if note else [])])

    def _tip_mm(self, row: int) -> float:
        try:
            return abs(self.number(row, TIP)) if self.cell(row, TIP) else 0.0
        except ValueError:  # read_points says so
            return 0.0

    def _planned(self, rows: IntArray) -> FloatArray | None:
        """Planned points of rows, or None without such columns or where their cells were changed."""
        try:
            planned = np.array([[self.number(row, name) for name in PLANNED] for row in rows.tolist()])
        except (ValueError, IndexError):
            return None
        return planned if np.isfinite(planned).all() else None

    def _suspect(self, points: FloatArray, rows: IntArray) -> int | None:
        """Which point is missing (or which reading one too many), by the distances from point to point.

        The distances are the same in all frames. Artefacts stand some centimetres from their planned places, which
        matters between artefacts only, and there in all candidates.
        """
        if abs(len(points) - len(rows)) != 1 or min(len(points), len(rows)) < 2:
            return None
        planned = self._planned(rows)
        if planned is None:
            return None
        long, short = (planned, points) if len(planned) > len(points) else (points, planned)
        off = [np.abs(_steps(np.delete(long, i, axis=0)) - _steps(short)).sum() for i in range(len(long))]
        return int(np.argmin(off))

    def write(self) -> None:
        # A spreadsheet that separates by semicolons takes UTF-8 for Windows' encoding if there is no byte order mark.
        encoding = "utf-8" if self.sheet.separator == "," else "utf-8-sig"
        with atomic_file(self.sheet.file) as beside, beside.open("w", encoding=encoding, newline="") as out:
            writer = csv.writer(out, delimiter=self.sheet.separator, lineterminator="\n")
            writer.writerow(self.names)
            writer.writerows(self.cells)


def _median_off(seen: FloatArray, aimed: FloatArray, i: int, j: int) -> float:
    """How far a place i is from the planned place j, as seen from most others (m, 2), of up to four from all [mm]."""
    others = np.setdiff1d(np.arange(len(seen)), [i, j])
    if len(others) < 2:  # one distance agrees by chance
        return np.inf
    off = np.abs(seen[others] - aimed[others]).max(axis=1)
    return float(np.median(off) if len(others) > 4 else off.max())


def _distances(points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(points[:, None] - points, axis=2))


def _steps(points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1))
