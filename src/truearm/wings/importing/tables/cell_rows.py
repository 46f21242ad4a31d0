"""Rows of cells become a table: names, units and numbers, whichever kind of file they come from.

Cells become numbers with the decimal signs and thousands that the whole file writes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import MAX_NAME, quoted_cell
from truearm.number_format import MINUS
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.importing.tables.cells import DOUBTFUL, clean, is_number, number_of, parse_cell, split_label
from truearm.wings.importing.tables.layout import Layout, foot_length, is_text, numeric_columns, recognise_layout
from truearm.wings.importing.tables.table import Place, Table, TableForm, listed
from truearm.wings.importing.tables.units import canonical_unit

OTHER = {".": ",", ",": "."}


def _cells(pattern: str) -> re.Pattern[str]:
    """Cells of a column, a line each, that hold numbers of a form."""
    return re.compile(rf"^[ \t]*[+-]?(?:{pattern})[ \t]*$", re.MULTILINE)


def _patterns(s: str, o: str) -> tuple[re.Pattern[str], ...]:
    """Numbers in which the sign `s` can only be decimal, can only separate thousands, and can be either."""
    return (
        _cells(
            rf"(?:0\d*|\d{{4,}})?{s}\d+|\d{{1,3}}{s}(?:\d{{0,2}}|\d{{4,}})|\d*{s}\d*[eEdD][+-]?\d+"
            rf"|\d{{1,3}}(?:[{o}' ]\d{{2,3}})*[{o}' ]\d{{3}}{s}\d*"
        ),
        _cells(rf"\d{{1,3}}(?:(?:{s}\d{{3}}){{2,}}|(?:{s}\d{{3}})+{o}\d*|(?:{s}\d{{2,3}})+{s}\d{{3}})"),
        _cells(rf"[1-9]\d{{0,2}}{s}\d{{3}}"),
    )


_PATTERNS = {".": _patterns(r"\.", ","), ",": _patterns(",", r"\.")}
_SHORT, _LONG = _cells(r"\d{1,3}"), _cells(r"\d{4,}")


@dataclass
class NumberColumn:
    """The cells of a column, as they are read, and what they tell about its notation.

    Parameters
    ----------
    thousands : str
        Signs that group digits where a cell leaves it open.
    label : str
        What stands before each number.
    """

    thousands: str = ""
    label: str = ""
    parts: list[FloatArray] = field(default_factory=list)
    decimal_signs: set[str] = field(default_factory=set)
    thousands_signs: set[str] = field(default_factory=set)
    doubtful: dict[str, tuple[int, str]] = field(default_factory=dict)
    has_short: bool = False
    has_long: bool = False
    unit: str = ""
    other_unit: tuple[int, str] | None = None
    sexagesimal: bool = False
    without_value: int = 0
    words: int = 0
    numbers: int = 0

    def add(self, cells: Sequence[str], start: int) -> None:
        """Read more cells, the first of them in row `start`."""
        text = "\n".join(cells)
        if MINUS in text and text.count("\n") == len(cells) - 1:
            text = text.replace(MINUS, "-")
            cells = text.split("\n")
        if (values := self._plain(cells, text)) is None:
            self.parts.append(self._parsed(cells, start))
            return
        self.numbers += len(cells)
        self.parts.append(values)
        if not self.decimal_signs or ("," in text and "," not in self.decimal_signs):
            self._notice(text, start)

    def _plain(self, cells: Sequence[str], text: str) -> FloatArray | None:
        """Numbers that Python reads, possibly with decimal commas."""
        if "_" in text or any(sign in text for sign in self.thousands):
            return None
        if "," in text and "." not in text and "," not in self.thousands and text.count("\n") == len(cells) - 1:
            cells = text.replace(",", ".").split("\n")
        elif "," in text or (self.decimal_signs == {","} and "." in text):
            return None
        try:
            values = np.fromiter(map(float, cells), float, len(cells))
        except ValueError:
            return None
        return values if np.isfinite(values).all() else None

    def _parsed(self, cells: Sequence[str], start: int) -> FloatArray:
        values = np.full(len(cells), np.nan)
        written = [""] * len(cells)
        for i, text in enumerate(cells):
            cell = parse_cell(split_label(text)[1] if self.label else text)
            if cell is None:
                self.words += 1
                continue
            if not cell.digits:
                self.without_value += bool(text.strip())
                continue
            self.numbers += 1
            values[i] = cell.angle if cell.angle is not None else number_of(cell.digits, self.thousands)
            self.words += bool(np.isinf(values[i]))
            if cell.angle is None:
                written[i] = cell.digits
            self.sexagesimal |= cell.angle is not None
            if cell.unit and not self.unit:
                self.unit = cell.unit
            elif cell.unit and canonical_unit(cell.unit) != canonical_unit(self.unit) and not self.other_unit:
                self.other_unit = (start + i, text)
        self._notice("\n".join(written), start)
        return values

    def _notice(self, text: str, start: int) -> None:
        """Keep what cells tell about the signs."""
        for sign, (decimal, thousands, in_doubt) in _PATTERNS.items():
            if sign not in text:
                continue
            if decimal.search(text):
                self.decimal_signs.add(sign)
            if thousands.search(text):
                self.thousands_signs.add(sign)
            if sign not in self.doubtful and (match := in_doubt.search(text)):
                self.doubtful[sign] = (start + text.count("\n", 0, match.start()), match[0].strip())
        self.has_short |= bool(_SHORT.search(text))
        self.has_long |= bool(_LONG.search(text))


def thousands_of(
    columns: Sequence[NumberColumn], form: TableForm, *, point_is_decimal: bool = False
) -> list[str | None]:
    """Which signs separate thousands in each column, where cells leave it open; None where a person must say.

    Notes
    -----
    ``1.235`` is 1.235, or 1235. Its column decides if another cell has one reading only (``1.235,5``, ``12,5``,
    ``0.25``, ``1.2345``, ``1235``). Else the file's other columns do, unless whole numbers stand beside it. In a file
    of nothing but such numbers, or between commas (`point_is_decimal`), the point is decimal.
    """
    in_file = {sign for column in columns if not column.words for sign in column.decimal_signs}
    if not in_file and (point_is_decimal or not any(column.has_short for column in columns if not column.words)):
        in_file = {"."}
    found: list[str | None] = []
    for column in columns:
        groups = {sign: _groups_digits(sign, column, form, in_file) for sign in column.doubtful}
        found.append(None if None in groups.values() else "".join(sign for sign, does in groups.items() if does))
    return found


def _groups_digits(sign: str, column: NumberColumn, form: TableForm, in_file: set[str]) -> bool | None:
    if form.thousands is not None:
        return sign == form.thousands
    if form.decimal is not None:
        return sign != form.decimal
    is_decimal = sign in column.decimal_signs or OTHER[sign] in column.thousands_signs or column.has_long
    is_thousands = sign in column.thousands_signs or OTHER[sign] in column.decimal_signs
    if is_decimal != is_thousands:
        return is_thousands
    if in_file == {OTHER[sign]}:
        return True
    return False if not column.has_short and in_file == {sign} else None


def two_readings(cell: str) -> tuple[str, str, str]:
    """What a cell may mean as a sentence, and the options that settle it.

    Examples
    --------
    >>> two_readings("-1.235")[0]
    "expected a number with a known decimal sign, got '-1.235', which may be -1.235 or -1235"
    """
    match = DOUBTFUL.fullmatch(cell)
    sign = match[1] if match else "."
    decimal, whole = cell.replace(sign, "."), cell.replace(sign, "")
    problem = f"expected a number with a known decimal sign, got {quoted_cell(cell)}, which may be {decimal} or {whole}"
    return problem, f"--decimal '{sign}' ({decimal})", f"--thousands '{sign}' ({whole})"


def words_of(cells: Sequence[str], column: NumberColumn, *, as_written: bool = False) -> NameArray:
    """Cells as words; in a column of numbers those of its numbers that Python does not read are written plainly."""
    words = [cell.strip() for cell in cells]
    if column.numbers >= column.words and not as_written:
        words = [_plainly(cell, column) for cell in words]
    # A longer one is no name, nor a number that its first digits make.
    return np.array([word if len(word) <= MAX_NAME else f"{word[:MAX_NAME]}…" for word in words], dtype=np.str_)


def _plainly(cell: str, column: NumberColumn) -> str:
    parsed = parse_cell(split_label(cell)[1] if column.label else cell)
    if parsed is None or not parsed.digits:
        return clean(cell) if parsed is None else ""
    return repr(parsed.angle if parsed.angle is not None else number_of(parsed.digits, column.thousands))


_CHUNK = 500
_FOOT = 60  # rows at the end that may be statistics or remarks
_MOST_COLUMNS = 4096
_MOST_GAPS = 10_000
_FEWEST_NUMBERS = 3  # in a row of another table: its points
_BEGIN = "0123456789+-. "  # how most numbers begin


@dataclass(frozen=True)
class CellRows:
    """Rows of cells that can be read more than once; empty rows and comments are not among them.

    Attributes
    ----------
    numbers : sequence of int
        Where each row stands in the file, counted from 1.
    cells : callable
        Returns the cells of the rows from a first to before a last, with the blanks around them.
    head : list of list of str
        Cells of the first rows, at most `HEAD`, without blanks around them.
    may_be_short : bool
        Whether cells that a row lacks are those at its end.
    point_is_decimal : bool
        Whether 1.235 is no 1235 unless other cells say so.
    """

    numbers: Sequence[int]
    cells: Callable[[int, int], list[list[str]]]
    head: list[list[str]]
    may_be_short: bool = True
    point_is_decimal: bool = True


def table_of_rows(rows: CellRows, path: Path | None, form: TableForm, place: Place, assumed: Sequence[str]) -> Table:
    """Make a table of rows of cells: recognise its head, foot and notation, and read its columns.

    Raises
    ------
    InputError
        If no row holds a number, or a row does not fit the names.
    """
    layout = recognise_layout(rows.head, form.header)
    if layout is None:
        raise InputError("expected rows of numbers, got none", file=path)
    if len(layout.names) > _MOST_COLUMNS:
        raise InputError(f"expected at most {_MOST_COLUMNS} columns, got {len(layout.names)}", file=path)
    body = _Body(rows, layout, path, place)
    body.check_names(form)
    if body.second is not None and form.part is None:
        at = rows.numbers[body.second]
        hint = f"--part 1 for the first table alone, or --skip-lines {at - 1} for this one"
        raise body.error("another table begins here", 0, hint, lines=np.array([at]))
    columns, texts, questions = _columns(body, form)
    names = layout.names
    units = tuple(unit or column.unit for unit, column in zip(layout.units, columns, strict=True))
    header_line = None if layout.header is None else rows.numbers[layout.header]
    said = (*assumed, *_said_of_head(body), *body.said, *_said_of_columns(columns, names, form))
    return Table(names, units, tuple(texts), np.concatenate(body.lines), place, path, header_line, said, questions)


class _Body:
    """The rows below the head, without the foot."""

    def __init__(self, rows: CellRows, layout: Layout, path: Path | None, place: Place) -> None:
        self.rows, self.layout, self.path, self.place = rows, layout, path, place
        self.width = len(layout.names)
        self.said: list[str] = []
        self.lines: list[np.ndarray] = []
        self.repeated: list[int] = []
        self.second: int | None = None
        self._heads = {_without_case(row) for row in rows.head[: layout.first]}
        self._numeric = numeric_columns(rows.head[layout.first :], self.width)
        self.stop = self._stop()

    def check_names(self, form: TableForm) -> None:
        """Refuse a header with fewer names than the rows have cells, or more between blanks: which is whose is open."""
        layout, rows, head = self.layout, self.rows, self.rows.head
        widths, i = [len(row) for row in head[layout.first :]], layout.unmatched
        if layout.header is not None and len(head[layout.header]) > max(widths) and not rows.may_be_short:
            i = layout.header
        if i is None or form.header is False:
            return
        n = len(head[i])
        other = next(k for k, width in enumerate(widths) if width != n)
        hint = f"--no-header, and columns by number, 1 to {widths[other]}, or name every column"
        if self.place == "line" and rows.point_is_decimal and not form.thousands:
            hint += " (--thousands ',' if some commas group digits)"
        problem = f"the header has {n} names, expected as many cells, got {widths[other]}"
        raise self.error(problem, other, hint, lines=np.array(rows.numbers[layout.first :]))

    def _stop(self) -> int:
        """Index behind the last row of the table."""
        numbers, first, numeric = self.rows.numbers, self.layout.first, self._numeric
        stop = len(numbers)
        tail = self._stripped(max(first + 1, stop - _FOOT), stop)
        if n := foot_length(tail, numeric, self.width):
            foot = next(filter(None, tail[-n]), "")
            self.said.append(f"foot from {self.place} {numbers[stop - n]}: {foot[:40]}")
            stop -= n
        gaps = np.flatnonzero(np.diff(np.asarray(numbers[first:stop])) > 1) + first + 1
        for gap in gaps.tolist() if len(gaps) < _MOST_GAPS else ():
            row = self._stripped(gap, gap + 1)[0]
            if any(row[self.width :]) or (is_text(row, numeric) and _without_case(row) not in self._heads):
                self.said.append(f"from {self.place} {numbers[gap]} on ignored")
                after = self._stripped(gap, gap + _FOOT)
                if sum(sum(map(is_number, one)) >= _FEWEST_NUMBERS for one in after) > 1:
                    self.second = int(gap)
                return int(gap)
        return stop

    def _stripped(self, start: int, stop: int) -> list[list[str]]:
        return [[cell.strip() for cell in row] for row in self.rows.cells(start, stop)]

    def chunks(self) -> Iterator[tuple[int, list[tuple[str, ...]]]]:
        """Cells column by column, with the number of rows before them; they fit the names."""
        n, self.lines, self.repeated = 0, [], []
        last = self._numeric[-1] if self._heads and self._numeric else self.width
        for start in range(self.layout.first, self.stop, _CHUNK):
            end = min(start + _CHUNK, self.stop)
            cells, lines = self.rows.cells(start, end), np.asarray(self.rows.numbers[start:end])
            if again := [
                i for i, row in enumerate(cells)
                if len(row) > last and row[last][:1] not in _BEGIN and _without_case(row) in self._heads
            ]:  # fmt: skip
                self.repeated += lines[again].tolist()
            if (
                again
                or set(map(len, cells)) != {self.width}
                or not all(row[0] or "".join(row).strip() for row in cells)
            ):
                filled = [i for i, row in enumerate(cells) if "".join(row).strip() and i not in again]
                cells, lines = [self._fitting(cells[i], int(lines[i])) for i in filled], lines[filled]
            if cells:
                self.lines.append(lines)
                yield n, list(zip(*cells, strict=True))
                n += len(cells)

    def _fitting(self, row: list[str], line: int) -> list[str]:
        """A row with as many cells as there are names; those missing at its end are empty."""
        if len(row) > self.width and row[self.width].lstrip()[:1] in ("#", "%", "!", "/"):
            row = row[: self.width]  # a remark on the reading
        if len(row) < self.width and not self.rows.may_be_short:
            problem = f"expected {self.width} values between blanks, got {len(row)}: which are missing?"
            hint = "write - where there is no value, or separate by --separator TAB"
            raise self.error(problem, 0, hint, lines=np.array([line]))
        if "".join(row[self.width :]).strip():
            problem = f"expected {self.width} values, got {len(row)}"
            names = self.layout.names
            hint = f"the columns are {listed(names)}: state --separator, --skip-lines, or --no-header if these are not"
            raise self.error(problem, 0, hint, lines=np.array([line]))
        return row[: self.width] + [""] * (self.width - len(row))

    def error(
        self, problem: str, row: int, hint: str, *, column: int | None = None, lines: IntArray | None = None
    ) -> InputError:
        """An error in `row`, by default of the rows that were read."""
        lines = np.concatenate(self.lines) if lines is None else lines
        table = Table(self.layout.names, (), (), lines, self.place, self.path)
        return table.error(problem, row, column=column, hint=hint)


def _without_case(row: Sequence[str]) -> tuple[str, ...]:
    return tuple(cell.strip().casefold() for cell in row)


def _columns(
    body: _Body, form: TableForm
) -> tuple[list[NumberColumn], list[FloatArray | NameArray], dict[int, InputError]]:
    """Read all columns; those whose notation turns out to be another one are read again."""
    labels = [name if body.layout.header is None and not name.isdigit() else "" for name in body.layout.names]
    columns = [NumberColumn(label=label) for label in labels]
    for start, cells in body.chunks():
        for column, of_column in zip(columns, cells, strict=True):
            column.add(of_column, start)
    if not body.lines:
        raise InputError("expected at least one row of numbers, got none", file=body.path)
    signs = thousands_of(columns, form, point_is_decimal=body.rows.point_is_decimal)
    asked = {i for i, sign in enumerate(signs) if sign is None and not columns[i].words}
    again = {i: NumberColumn(s, labels[i]) for i, s in enumerate(signs) if s and not columns[i].words}
    words: dict[int, list[NameArray]] = {i: [] for i in range(body.width) if columns[i].words or i in asked}
    for start, cells in body.chunks() if again or words else ():
        for i, column in again.items():
            column.add(cells[i], start)
        for i, parts in words.items():
            parts.append(words_of(cells[i], columns[i], as_written=i in asked))
    questions = {}
    for i, column in enumerate(columns):
        if i in asked:
            row, cell = next(iter(column.doubtful.values()))
            problem, *options = two_readings(cell)
            questions[i] = body.error(problem, row, " or ".join(options), column=i)
        elif column.other_unit:
            row, cell = column.other_unit
            problem = f"expected a number in {column.unit}, got {quoted_cell(cell)}"
            questions[i] = body.error(problem, row, "write the column in one unit", column=i)
    columns = [again.get(i, column) for i, column in enumerate(columns)]
    found = [np.concatenate(words[i]) if i in words else np.concatenate(c.parts) for i, c in enumerate(columns)]
    return columns, found, questions


def _said_of_head(body: _Body) -> list[str]:
    layout, place, numbers = body.layout, body.place, body.rows.numbers
    titles = min(i for i in (layout.header, layout.unit_row, layout.first) if i is not None) - layout.group_rows
    labelled = any(not name.isdigit() for name in layout.names)
    unnamed = "names of columns before the numbers" if labelled else "no header: columns go by number"
    said = [
        f"{titles} line{'s' * (titles > 1)} above the table" if titles > 0 else "",
        unnamed if layout.header is None else "",
        "names of groups in front of repeated names" if layout.group_rows else "",
        "row names in the first column" if layout.row_names else "",
        f"{place} {body.repeated[0]} repeats the head: ignored" if body.repeated else "",
        "" if layout.unit_row is None else f"units from {place} {numbers[layout.unit_row]}",
    ]
    return [phrase for phrase in said if phrase]


def _said_of_columns(columns: Sequence[NumberColumn], names: Sequence[str], form: TableForm) -> list[str]:
    """How numbers are written, where that is not plainly."""

    def where(holds: Callable[[NumberColumn], object]) -> str:
        found = [name for name, column in zip(names, columns, strict=True) if not column.words and holds(column)]
        return listed(found, most=4) if found else ""

    said = []
    commas = where(lambda column: "," in column.decimal_signs)
    points = where(lambda column: "." in column.decimal_signs)
    if commas and form.decimal != ",":
        said.append(f"decimal comma in {commas}" if points or form.decimal else "decimal comma")
    if points and form.decimal == ",":
        said.append(f"decimal point in {points}")
    for sign, name in ((".", "points"), (",", "commas")):
        if found := where(lambda column, sign=sign: sign in column.thousands or sign in column.thousands_signs):  # type: ignore[misc]
            said.append(f"{name} between thousands in {found}")
    if found := where(lambda column: column.sexagesimal):
        said.append(f"degrees, minutes and seconds in {found}")
    if n := sum(column.without_value for column in columns if column.numbers > column.words):
        said.append(f"{n} cell{'s' * (n > 1)} that say there is no value")
    return said
