"""Delimited text (CSV): read by the standard library row by row, converted once; every fault has its line and column.

One row of a table is one line of the file, so that the line of row i is ``first_line + i`` everywhere.

A form that a person filled in is read whatever the separators of the country of the spreadsheet that saved it. A German
spreadsheet writes semicolons, decimal commas and Windows' encoding; an English one commas, points and, if asked, UTF-8.
The numbers are the same.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from truearm.errors import InputError
from truearm.files.file_reading import CHINESE, WINDOWS, read_limited, recognise_encoding
from truearm.printable_text import printable
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray

# Characters in a name of a seat, position or session: an array of names reserves the longest for each of them.
MAX_NAME = 200

# About three million readings; reading them takes about five times the size in memory.
MAX_BYTES = 2**29

# Rows that are converted together: few enough to stay in the cache, many enough to be fast.
_CHUNK = 500

_OF_WORKBOOKS = "export the sheet as CSV; of readings, truearm import TABLE --out session.csv"
# Files that people offer instead of text, by how they begin.
_FOREIGN = {
    b"PK\x03\x04": ("a spreadsheet or zip file", _OF_WORKBOOKS),
    b"\xd0\xcf\x11\xe0": ("an old spreadsheet (.xls)", _OF_WORKBOOKS),
    b"\x1f\x8b": ("a gzip file", "unpack it first"),
    b"%PDF": ("a PDF", "export the numbers as CSV"),
    b"\x89HDF": ("an HDF5 file", "export the numbers as CSV"),
}

_NO_NAME = "delete the column, or let its name start with 'note'"
_SWAP = str.maketrans(",.", ".,")  # decimal commas to points, and points to something that is no number

# Cells that a spreadsheet would run as a formula (OWASP, "CSV Injection"). An apostrophe in front makes them text; one
# more in front of those that have one makes that reversible. Numbers with a sign are no formulas.
_FORMULA = re.compile(r"'*(?:[=@\t\r]|[+-](?![\d. +-]*$))")
# Comma first: it is the separator of the files that truearm writes.
SEPARATORS = ",;\t"

_WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
# 1,234 is a number with three decimals, or one with a thousands separator; 0,234 and 1,2340 are decimals.
_MAY_BE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?", re.ASCII)
_WITH_POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, eq=False)
class Sheet:
    """Delimited text: its header, and where its rows begin.

    Attributes
    ----------
    file : Path
        Where it was read from.
    names : tuple of str
        The header's cells, or ``1``, ``2``, .. where there is no header.
    first_line : int
        The line of the first row in `file`, counted from 1.
    head : str
        The header's line, or the first row's.
    separator, decimal : str
        One character each.
    data : bytes
        The whole file in UTF-8, or its lines from `data_line` on.
    data_line : int
        The line of `file` with which `data` begins.
    """

    file: Path
    names: tuple[str, ...]
    first_line: int
    head: str
    separator: str
    decimal: str
    data: bytes
    data_line: int = 1

    def error(
        self, problem: str, row: int | None = None, *, column: str | int | None = None, hint: str | None = None
    ) -> InputError:
        """Make an error that states this file and the line of `row` (counted from 0), or of the header."""
        line = self.first_line + row if row is not None else self.first_line - 1 or None
        return InputError(problem, file=self.file, line=line, column=column, hint=hint)

    def rows(self) -> Iterator[list[str]]:
        """Iterate over the cells of the rows; empty rows at the end of the file are none.

        Raises
        ------
        InputError
            If a row has too many or too few cells, a line break, or nothing at all while others follow.
        """
        lines = physical_lines(self.data)
        for _ in range(self.first_line - self.data_line):
            next(lines)
        reader, width, empty = _cells_of(lines, self.separator), len(self.names), None
        row = -1
        try:
            for row, cells in enumerate(reader):
                if reader.line_num != row + 1:
                    hint = 'remove the line break from the cell, or close the quotation mark (")'
                    raise self.error("expected one line a reading, got a line break inside quotes", row, hint=hint)
                if (len(cells) != width or not cells[0].strip()) and not "".join(cells).strip():
                    empty = row if empty is None else empty
                    continue
                if len(cells) > width and not "".join(cells[width:]).strip():
                    del cells[width:]  # columns without a name that a spreadsheet appended
                if empty is not None:  # skipped silently, it would hide that something is missing there
                    raise self.error("expected numbers, got an empty row", empty, hint="delete the row")
                if len(cells) != width:
                    raise self._ragged(row, cells)
                yield cells
        except csv.Error as error:
            hint = 'close the quotation mark (")'
            raise self.error(f"the line cannot be split into cells ({error})", row + 1, hint=hint) from None

    def _ragged(self, row: int, cells: list[str]) -> InputError:
        hint = None
        if len(cells) == len(split_line(self.head, self.separator)) > len(self.names):
            raise self.error("the column has no name", column=len(self.names) + 1, hint=_NO_NAME)
        if self.separator == "," and len(cells) > len(self.names):
            hint = "write decimal points, not commas, and a name that holds a comma in quotation marks"
        elif len(cells) < len(self.names):
            hint = "a separator or a value is missing"
            if self.first_line + row == self.data_line + self.data.count(b"\n"):  # no line break ends it
                hint += "; a recording that was cut short removes its last line when it is continued"
        problem = f"expected {len(self.names)} values as in the line above, got {len(cells)}"
        return self.error(problem, row, hint=hint)


def first_line(data: bytes, path: Path, skip_lines: int, expected: str) -> str:
    """Return the first line of a table without its end.

    Raises
    ------
    InputError
        If it is empty where a line with what is `expected` should be.
    """
    head = next(islice(physical_lines(data), skip_lines, None), "").rstrip("\r\n")
    if not head.strip():
        raise InputError(f"expected {expected}, got an empty line", file=path, line=skip_lines + 1)
    return head


def split_line(line: str, separator: str) -> list[str]:
    """Split a line into its cells, without blanks around them."""
    return [cell.strip() for cell in next(iter(_cells_of(iter([line]), separator)), [])]


def _cells_of(lines: Iterator[str], separator: str) -> Any:  # the reader's type has no public name
    """The reader of the cells of lines; cells may be separated by more than one blank."""
    if separator != " ":
        return csv.reader(lines, delimiter=separator)
    return csv.reader((line.strip(" \r\n") for line in lines), delimiter=separator, skipinitialspace=True)


def check_names(
    sheet: Sheet, needed: Sequence[str], optional: Sequence[str], *, meant: Callable[[str], str | None] | None = None
) -> None:
    """Check a header: it has the columns `needed`, and otherwise only those `optional` and notes, none twice.

    Raises
    ------
    InputError
        If a column is missing, repeated or unknown; `meant` gives the name that an unknown one may have meant.
    """
    known = (*needed, *optional)
    check_header(sheet.names, file=sheet.file, line=sheet.first_line - 1)
    for name in sheet.names:
        if name not in known and not name.startswith("note"):
            hint = (meant(name) if meant else None) or ", ".join(known)
            raise sheet.error(f"unknown column {quoted_cell(name)}", column=name, hint=hint)
    if missing := [name for name in needed if name not in sheet.names]:
        raise sheet.error(f"the column {missing[0]} is missing", hint=", ".join(needed))


def check_header(names: Sequence[str], *, file: Path | None, line: int | None) -> None:
    """Check that every column has a name, and one of its own."""
    for i, name in enumerate(names):
        if not name:
            raise InputError("the column has no name", file=file, line=line, column=i + 1, hint=_NO_NAME)
        if name in names[:i]:
            hint = "delete one of the two"
            raise InputError("two columns have this name", file=file, line=line, column=name, hint=hint)


def read_columns(
    sheet: Sheet,
    numbers: Sequence[int],
    words: Sequence[int] = (),
    optional: Sequence[int] = (),
    *,
    unfilled: list[int] | None = None,
) -> tuple[FloatArray, list[NameArray]]:
    """Read the columns `numbers` as (n, len(numbers)) floats, exactly as written, and the columns `words` as text.

    An empty cell in those of `numbers` that are `optional` is read as NaN. Rows without any number are those of a form
    that is not filled in yet: they are refused, or their numbers from 0 are appended to `unfilled`.

    Raises
    ------
    InputError
        If a row does not fit the header, there is no row, a cell of `numbers` is not a finite number (the first such
        cell in the file), or a name is too long.
    """
    parts: list[FloatArray] = []
    texts: list[list[NameArray]] = [[] for _ in words]
    rows, start = sheet.rows(), 0
    while chunk := list(islice(rows, _CHUNK)):
        columns = list(zip(*chunk, strict=True))
        values, bad = np.empty((len(chunk), len(numbers))), np.zeros((len(chunk), len(numbers)), bool)
        for k, i in enumerate(numbers):
            values[:, k], bad[:, k] = _floats(columns[i], sheet.decimal, may_be_empty=i in optional)
        if unfilled is not None and bad.any():
            is_filled = np.array([any(row[i].strip() for i in numbers) for row in chunk])
            unfilled += (start + np.flatnonzero(~is_filled)).tolist()
            bad &= is_filled[:, None]
        if bad.any():
            row = int(np.argmax(bad.any(axis=1)))
            column = min(numbers[k] for k in np.flatnonzero(bad[row]).tolist())
            problem, hint = _described(chunk[row][column], sheet)
            raise sheet.error(problem, start + row, column=sheet.names[column], hint=hint)
        parts.append(values)
        for text, i in zip(texts, words, strict=True):
            text.append(_names(columns[i], sheet, start, i))
        start += len(chunk)
    if parts and unfilled is not None and len(unfilled) == start:
        raise InputError(f"none of {start} rows has a number", file=sheet.file, hint="fill in what was measured")
    if not parts:
        line = sheet.first_line - 1 or 1
        raise InputError("expected at least one row of numbers, got none", file=sheet.file, line=line)
    return np.concatenate(parts), [np.concatenate(text) for text in texts]


def write_columns(
    path: Path, columns: Mapping[str, FloatArray | IntArray | NameArray], *, decimals: int | None = None
) -> None:
    """Write columns of one length as CSV, what is missing (NaN) empty.

    Numbers have as many digits as they need to come back the same, or a number of `decimals`; whole numbers (an array
    of integers) have none.

    A name that a spreadsheet would run as a formula gets an apostrophe in front; `read_columns` removes it.
    """
    with path.open("w", encoding="utf-8", newline="") as out:
        append_rows(out, columns, decimals=decimals, header=True)


def append_rows(
    out: TextIO,
    columns: Mapping[str, FloatArray | IntArray | NameArray],
    *,
    decimals: int | None = None,
    header: bool = False,
) -> None:
    """Append rows to a table as `write_columns` writes it, after its header where it has none yet."""
    if header:
        csv.writer(out, lineterminator="\n").writerow(columns)
    empty = '""' if len(columns) == 1 else ""  # a line without anything is no row
    for start in range(0, len(next(iter(columns.values()))), _CHUNK):
        parts = [_cells(values[start : start + _CHUNK], decimals, empty) for values in columns.values()]
        line = ",".join(form for form, _ in parts) + "\n"
        out.write("".join(map(line.__mod__, zip(*(cells for _, cells in parts), strict=True))))


def as_utf8(data: bytes, path: Path, encoding: str, *, hint: str = "save it as 'CSV UTF-8'") -> bytes:
    """Return `data` as text in UTF-8 without a byte order mark.

    Raises
    ------
    InputError
        If it is empty, binary, or not in `encoding`.
    """
    for beginning, (what, remedy) in _FOREIGN.items():
        if data.startswith(beginning):
            raise InputError(f"expected text (CSV), got {what}", file=path, hint=remedy)
    try:
        codec = codecs.lookup(encoding)
        if not getattr(codec, "_is_text_encoding", True):  # hex, zip, rot13: no encodings of text
            raise LookupError
        name = codec.name
    except LookupError:
        raise InputError(f"unknown encoding {quoted_cell(encoding)}", hint="utf-8, latin-1, cp1252 or utf-16") from None
    if name == "utf-8" and data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        raise InputError("expected UTF-8 text, got UTF-16", file=path, hint="save it as 'CSV UTF-8'")
    if not (name == "utf-8" and data.isascii()):
        try:
            data = data.decode(name).removeprefix("\ufeff").encode()
        except (UnicodeError, AttributeError) as error:
            line = data.count(b"\n", 0, error.start) + 1 if isinstance(error, UnicodeDecodeError) else None
            raise InputError(
                f"expected text in {name}, got bytes that are not", file=path, line=line, hint=hint
            ) from None
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        raise InputError("expected text (CSV), got a binary file", file=path, line=line)
    if not data.strip(b"\r\n"):
        raise InputError("expected a table, got an empty file", file=path)
    return data


def physical_lines(data: bytes) -> Iterator[str]:
    """Iterate over lines with their ends, whether those are of Unix, Windows or the old Macintosh."""
    return io.TextIOWrapper(io.BytesIO(data), "utf-8", newline="")


def escape_formula(cell: str) -> str:
    """The printable text of a cell, with an apostrophe in front of one that a spreadsheet would run as a formula."""
    return printable(f"'{cell}" if _FORMULA.match(cell) else cell)


def quoted_cell(cell: object) -> str:
    """Show a cell in a message: quoted and not too long."""
    text = repr(cell)
    return text if len(text) <= 40 else f"{text[:36]}...{text[0]}"


def _cells(values: FloatArray | IntArray | NameArray, decimals: int | None, empty: str) -> tuple[str, list[Any]]:
    """The cells of a column, and their form; what is missing is `empty`."""
    cells: list[Any] = values.tolist()
    if values.dtype.kind == "i":
        return "%d", cells
    if values.dtype.kind == "f":
        # Python's floats write themselves with the fewest digits that come back the same.
        form = "%r" if decimals is None else f"%.{decimals}f"
        if np.isnan(values).any():
            return "%s", [empty if cell != cell else form % cell for cell in cells]
        return form, cells
    safe = {cell: _quoted(escape_formula(cell)) or empty for cell in set(cells)}  # names are repeated
    return "%s", [safe[cell] for cell in cells]


def _quoted(cell: str) -> str:
    """A cell as CSV, in quotes where it needs them."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow([cell, ""])
    return out.getvalue().removesuffix(",\n")


def _floats(cells: Sequence[str], decimal: str, *, may_be_empty: bool) -> tuple[FloatArray, BoolArray]:
    """Numbers of a column, and which of its cells are not finite numbers."""
    text = "\n".join(cells)
    if decimal == ",":
        text = text.translate(_SWAP)
        cells = text.split("\n")
    empty = cells.count("") if may_be_empty else 0
    if text.isascii() and "_" not in text:  # `float` reads 1_000 and the digits of all scripts
        try:
            values = np.fromiter(map(float, (c or "nan" for c in cells) if empty else cells), float, len(cells))
            if np.count_nonzero(~np.isfinite(values)) == empty:
                return values, np.zeros(len(cells), bool)
        except ValueError:
            pass
    number = re.compile(r"[ \t]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?[ \t]*", re.ASCII)
    values = np.array([float(cell) if number.fullmatch(cell) else np.nan for cell in cells])
    blank = np.array([cell == "" for cell in cells]) & may_be_empty
    return values, ~(np.isfinite(values) | blank)


def _names(cells: Sequence[str], sheet: Sheet, start: int, column: int) -> NameArray:
    longest = max(map(len, cells))
    if longest > MAX_NAME:
        row = next(i for i, cell in enumerate(cells) if len(cell) > MAX_NAME)
        problem = f"expected a name of at most {MAX_NAME} characters, got one of {len(cells[row])}"
        raise sheet.error(problem, start + row, column=sheet.names[column])
    return np.array([c[1:] if c[:1] == "'" and _FORMULA.match(c, 1) else c for c in cells], dtype=np.str_)


def _described(cell: str, sheet: Sheet) -> tuple[str, str | None]:
    """Say what is wrong with a cell that should be a number, and what to do."""
    text = cell.strip()
    if cell and not text:
        return (
            f"expected a number, got {quoted_cell(cell)}",
            "fill in the number, or leave nothing where none is needed",
        )
    if not text:
        return "expected a number, got an empty cell", "delete the reading, or fill in its number"
    if text.lower().lstrip("+-") in ("nan", "na", "n/a", "null", "none", "inf", "infinity"):
        return f"expected a finite number, got {quoted_cell(text)}", "delete the reading, or fill in its number"
    if (
        re.fullmatch(r"[+-]?\d{1,3}([., '\u2019_]\d{3})+([.,]\d+)?", text)
        and len(re.findall(r"\D", text.lstrip("+-"))) > 1
    ):
        return f"expected a number, got {quoted_cell(text)}", "write numbers without thousands separators"
    if re.fullmatch(r"[+-]?\d*[.,]\d*([eE][+-]?\d+)?", text):
        problem = f"expected a number with decimal {sheet.decimal!r}, got {quoted_cell(text)}"
        other = "," if sheet.decimal == "." else "."
        if other == sheet.separator:
            return problem, "write decimal points"
        return problem, "write all numbers with the same decimal sign"
    return f"expected a number, got {quoted_cell(text)}", None


def read_form(path: str | Path) -> Sheet:
    """Read a form, whatever the separators of the spreadsheet that saved it.

    Cells are separated by commas, semicolons or tabs. Numbers have decimal points throughout or, not between commas,
    decimal commas throughout. The text is UTF-8 or, not between commas, that of Windows (cp1252). Columns at the end
    that have neither name nor cells are none.

    Raises
    ------
    InputError
        If the file is missing, too large or binary, a row does not fit the header, or 1,234 may mean 1.234 as well as
        1234.
    """
    return form_of(read_limited(path, limit_bytes=MAX_BYTES), Path(path))


def form_of(data: bytes, path: Path) -> Sheet:
    """The form in the bytes of a file; see `read_form`."""
    text = as_utf8(data, path, encoding_of_form(data))
    head = first_line(text, path, 0, "a header line with the names of the columns")
    separator = _separator(head)
    names = split_line(head, separator)
    while len(names) > 1 and not names[-1]:
        names.pop()
    sheet = Sheet(path, tuple(names), 2, head, separator, ".", text)
    return sheet if separator == "," else replace(sheet, decimal=_decimal(sheet))


def _separator(head: str) -> str:
    return max(SEPARATORS, key=head.count)


def encoding_of_form(data: bytes) -> str:
    """UTF-8, or Windows' encoding where the separator is a local one too."""
    encoding = recognise_encoding(data)
    head = data.partition(b"\n")[0].decode("latin-1")
    return WINDOWS if encoding in (WINDOWS, CHINESE) and _separator(head) != "," else "utf-8"


def _decimal(sheet: Sheet) -> str:
    """The decimal sign of the numbers in cells that are not separated by commas.

    Raises
    ------
    InputError
        If no number tells it and one may mean two.
    """
    doubtful: tuple[int, int, str] | None = None
    thousands = False
    for row, cells in enumerate(sheet.rows()):
        for column, cell in enumerate(map(str.strip, cells)):
            if _MAY_BE_THOUSANDS.fullmatch(cell):
                doubtful = doubtful or (row, column, cell)
            elif _WITH_COMMA.fullmatch(cell):
                return ","
            elif _THOUSANDS.fullmatch(cell) or _WITH_POINT.fullmatch(cell):
                thousands = True
    if doubtful is None or thousands:
        return "."
    row, column, cell = doubtful
    raise sheet.error(
        f"expected a number with a known decimal sign, got {quoted_cell(cell)}, which may be {cell.replace(',', '.')} "
        f"or {cell.replace(',', '')}",
        row,
        column=sheet.names[column],
        hint=f"write {cell}0 if the comma is the decimal sign, {cell.replace(',', '')} if it separates thousands",
    )
