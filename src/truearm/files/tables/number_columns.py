"""Columns of cells as numbers: decimal signs and thousands by what the whole file writes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from truearm.files.delimited import MAX_NAME, quoted_cell
from truearm.files.tables.cells import DOUBTFUL, clean, number_of, parse_cell, split_label
from truearm.files.tables.table import TableForm
from truearm.files.tables.units import canonical_unit
from truearm.number_format import MINUS
from truearm.typing import FloatArray, NameArray

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
