"""Delimited text from others: checked for its shape, read fast, and every fault traced to its line and column."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray, NameArray

# Signs in a name of a seat, position or session: in an array of names each takes the room of the longest.
MAX_NAME = 200

# About three million readings: more than anybody took, and reading them (five times the size) fits a small machine.
MAX_BYTES = 2**29

# Bytes that are searched for a fault together.
_BLOCK = 2**20

# Files that people offer instead of text, by how they begin.
_FOREIGN = {
    b"PK\x03\x04": "a spreadsheet or zip file; export the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an old spreadsheet (.xls); export the sheet as CSV",
    b"\x1f\x8b": "a gzip file; unpack it first",
    b"%PDF": "a PDF; export the numbers as CSV",
    b"\x89HDF": "an HDF5 file; export the numbers as CSV",
}


@dataclass(frozen=True, eq=False)
class Sheet:
    r"""Delimited text of which every row has as many cells as the first.

    Attributes
    ----------
    file : Path
        Where it was read from.
    names : tuple of str
        The header's cells, or ``1``, ``2``, .. where there is no header.
    rows : bytes
        The rows below the header in UTF-8, each ended by one ``\n``.
    first_line : int
        The line of the first row in `file`, counted from 1.
    separator, decimal : str
        One character each.
    """

    file: Path
    names: tuple[str, ...]
    rows: bytes
    first_line: int
    separator: str
    decimal: str

    def cells(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of each row, slowly."""
        text = self.rows.decode().split("\n")[:-1]
        reader = csv.reader(text, delimiter=self.separator)
        try:
            for row in reader:
                yield self.first_line + reader.line_num - 1, row
        except csv.Error as error:
            line = self.first_line + reader.line_num - 1
            raise InputError(
                f"expected separated cells, got a line that cannot be split ({error})", file=self.file, line=line
            ) from None


def read_sheet(
    path: str | Path,
    *,
    separator: str = ",",
    decimal: str = ".",
    encoding: str = "utf-8",
    header: bool = True,
    skip_lines: int = 0,
    importable: bool = False,
) -> Sheet:
    """Read delimited text whole and check its shape. Rows at the end in which every cell is empty are none.

    Parameters
    ----------
    path : path
        At most `MAX_BYTES`.
    separator, decimal : str
        One character each, different from each other.
    encoding : str
        Any text encoding that Python knows. A byte order mark is skipped.
    header : bool
        Whether the first line names the columns.
    skip_lines : int
        Lines before the header (or before the first row) that are not part of the table.
    importable : bool
        Whether `truearm import` reads such tables, and messages may name it.

    Raises
    ------
    InputError
        If the file is missing, too large, binary, or not in `encoding`, its cells are separated by another sign, or a
        row has too many or too few cells.
    """
    path = Path(path)
    _check_signs(separator, decimal)
    data = _as_utf8(_bytes(path), path, encoding, importable)
    lines_above = skip_lines + header
    above = data.split(b"\n", lines_above)[:lines_above]
    rows = _without_empty_end(data[sum(len(line) + 1 for line in above) :], separator)
    if header and (len(above) <= skip_lines or not above[-1].strip()):
        raise InputError(
            "expected a header line with the names of the columns, got an empty line", file=path, line=lines_above
        )
    if not rows:
        raise InputError("expected at least one row of numbers, got none", file=path, line=lines_above or 1)
    head = above[-1] if header else rows.split(b"\n", 1)[0]
    cells = _split_line(head.decode(), separator, path, lines_above if header else lines_above + 1)
    names = tuple(cell.strip() for cell in cells) if header else tuple(str(i + 1) for i in range(len(cells)))
    sheet = Sheet(path, names, rows, lines_above + 1, separator, decimal)
    if header:
        _check_separator(sheet, importable)
    _check_shape(sheet)
    return sheet


def check_names(
    sheet: Sheet, needed: Sequence[str], optional: Sequence[str], *, meant: Callable[[str], str | None] | None = None
) -> None:
    """Check that a header has the columns `needed`, and none twice or beside these, those `optional` and notes.

    Parameters
    ----------
    sheet : Sheet
    needed, optional : sequence of str
    meant : callable, optional
        What to try in place of an unknown column; where it says nothing, or by default, all that are known.

    Raises
    ------
    InputError
        For the first column at fault.
    """
    line, known = sheet.first_line - 1, (*needed, *optional)
    for i, name in enumerate(sheet.names):
        if not name:
            hint = "delete the column, or let its name start with 'note'"
            raise InputError("the column has no name", file=sheet.file, line=line, column=i + 1, hint=hint)
        if name in sheet.names[:i]:
            hint = "delete one of the two"
            raise InputError("the column stands twice", file=sheet.file, line=line, column=name, hint=hint)
        if name not in known and not name.startswith("note"):
            hint = (meant(name) if meant else None) or ", ".join(known)
            raise InputError(f"unknown column {quoted_cell(name)}", file=sheet.file, line=line, column=name, hint=hint)
    if missing := [name for name in needed if name not in sheet.names]:
        raise InputError(f"the column {missing[0]} is missing", file=sheet.file, line=line, hint=", ".join(needed))


def read_columns(
    sheet: Sheet, numbers: Sequence[int], words: Sequence[int] = (), optional: Sequence[int] = ()
) -> tuple[FloatArray, list[NameArray]]:
    """Read the columns `numbers` as (n, len(numbers)) floats, exactly as written, and the columns `words` as text.

    An empty cell in those of `numbers` that are `optional` is read as NaN.

    Raises
    ------
    InputError
        If a cell of `numbers` is not a finite number: the first such cell in the file, with what to try; or if a name
        is too long.
    """
    for empty in ((), optional) if optional else ((),):  # looking for empty cells takes time, and most files have none
        try:
            return _read(sheet, numbers, words, empty)
        except InputError:
            raise
        except (ValueError, OverflowError):
            continue
    raise _first_fault(sheet, numbers, optional)


def _read(
    sheet: Sheet, numbers: Sequence[int], words: Sequence[int], optional: Sequence[int]
) -> tuple[FloatArray, list[NameArray]]:
    """Do the work of `read_columns`; a ValueError does not say where the fault is."""
    table = _parsed(sheet, {**dict.fromkeys(numbers, float), **dict.fromkeys(words, str)}, optional)
    found = np.empty((len(table), len(numbers)))
    for k, i in enumerate(numbers):
        found[:, k] = table[i].to_numpy()
    missing = np.isnan(found) & np.isin(numbers, optional)
    if not (np.isfinite(found) | missing).all():
        raise ValueError("a number is not finite")
    if missing.any():  # pandas takes the word nan for an empty cell
        cells = _parsed(sheet, dict.fromkeys(optional, str), ())
        if any((cells[i].to_numpy()[missing[:, k]] != "").any() for k, i in enumerate(numbers) if i in optional):
            raise ValueError("nan is no number")
    # pandas takes a column of nothing but True and False for noughts and ones.
    truth = any(word in sheet.rows for word in (b"rue", b"RUE", b"alse", b"ALSE"))
    if truth and ((found == 0) | (found == 1) | missing).all(axis=0).any() and _fault_in(sheet, numbers, optional):
        raise ValueError("a truth value is no number")
    return found, [_names(table[i].to_numpy(), sheet, i) for i in words]


def _parsed(sheet: Sheet, kinds: dict[int, Any], optional: Sequence[int]) -> Any:
    """Parse the columns `kinds` as what they are said to be; empty cells of the columns `optional` as NaN."""
    import io

    import pandas as pd

    missing: dict[str, Any] = {"na_filter": False}
    if optional:
        missing = {"keep_default_na": False, "na_values": {i: [""] for i in optional}}
    return pd.read_csv(
        io.BytesIO(sheet.rows),
        sep=sheet.separator,
        decimal=sheet.decimal,
        header=None,
        usecols=sorted(kinds),
        dtype=kinds,
        index_col=False,
        skip_blank_lines=False,
        engine="c",
        encoding="utf-8",
        **missing,
        **_exactly(pd.__version__),
    )


def _names(cells: npt.NDArray[np.object_], sheet: Sheet, index: int) -> NameArray:
    """Names as one array, in which each takes the room of the longest."""
    lengths = np.fromiter(map(len, cells), dtype=int, count=len(cells))
    if lengths.max(initial=0) > MAX_NAME:
        row = int(lengths.argmax())
        raise InputError(
            f"expected a name of at most {MAX_NAME} signs, got one of {lengths[row]}",
            file=sheet.file,
            line=sheet.first_line + row,
            column=sheet.names[index],
        )
    return cells.astype(np.str_)


def _exactly(pandas_version: str) -> dict[str, Any]:
    """Make pandas read every number to the last bit; since 3.1 it does so by itself and warns of the option."""
    major, minor = (int(part) for part in pandas_version.split(".")[:2])
    return {} if (major, minor) >= (3, 1) else {"float_precision": "round_trip"}


def quoted_cell(cell: object) -> str:
    """Show a cell in a message: quoted and not too long."""
    text = repr(cell)
    return text if len(text) <= 40 else f"{text[:36]}...{text[0]}"


def _check_signs(separator: str, decimal: str) -> None:
    if len(separator) != 1 or separator in '\r\n"' or separator.isalnum():
        raise InputError(f"the separator must be one character such as , or ; got {quoted_cell(separator)}")
    if decimal not in (".", ","):
        raise InputError(f"the decimal sign must be . or , got {quoted_cell(decimal)}")
    if separator == decimal:
        raise InputError(
            f"the separator and the decimal sign are both {separator!r}",
            hint="--separator ';' --decimal ','",
        )


def _bytes(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise InputError("expected a file, got a folder", file=path)
        if size > MAX_BYTES:
            raise InputError(
                f"expected at most {MAX_BYTES / 2**20:.0f} MiB, got {size / 2**20:.0f} MiB",
                file=path,
                hint="split the file, or write it as Parquet",
            )
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError("the file does not exist", file=path) from None
    except OSError as error:
        raise InputError(f"the file cannot be read ({error.strerror})", file=path) from None
    for beginning, what in _FOREIGN.items():
        if data.startswith(beginning):
            raise InputError(
                f"expected text (CSV), got {what.partition('; ')[0]}", file=path, hint=what.partition("; ")[2]
            )
    return data


def _as_utf8(data: bytes, path: Path, encoding: str, importable: bool) -> bytes:
    """Turn `data` into UTF-8 with plain line ends, no byte order mark and no empty lines at its end."""
    try:
        codec = codecs.lookup(encoding)
        if not getattr(codec, "_is_text_encoding", True):  # hex, zip, rot13: no encodings of text
            raise LookupError
        name = codec.name
    except LookupError:
        raise InputError(f"unknown encoding {quoted_cell(encoding)}", hint="utf-8, latin-1, cp1252 or utf-16") from None
    if name == "utf-8" and data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        raise InputError("expected UTF-8 text, got UTF-16", file=path, hint="save it as 'CSV UTF-8'")
    if name == "utf-8":
        data = data.removeprefix(codecs.BOM_UTF8)
    if not (name == "utf-8" and data.isascii()):
        try:
            data = data.decode(name).removeprefix("\ufeff").encode()
        except (UnicodeError, AttributeError) as error:
            line = data.count(b"\n", 0, error.start) + 1 if isinstance(error, UnicodeDecodeError) else None
            raise InputError(
                f"expected text in {name}, got bytes that are not",
                file=path,
                line=line,
                hint="save it as 'CSV UTF-8'"
                + (", or give `truearm import` its --encoding (often cp1252)" if importable else ""),
            ) from None
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        raise InputError("expected text (CSV), got a binary file", file=path, line=line)
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = data.rstrip(b"\n")
    if not data:
        raise InputError("expected a table, got an empty file", file=path)
    return data + b"\n"


def _without_empty_end(rows: bytes, separator: str) -> bytes:
    """Rows up to the last that has anything in its cells: spreadsheets append some that have nothing."""
    filled = len(rows.rstrip(b" \t\n" + separator.encode()))
    return rows[: rows.find(b"\n", filled) + 1] if filled else b""


def _split_line(line: str, separator: str, path: Path, number: int) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator))
    except csv.Error as error:
        raise InputError(
            f"expected separated cells, got a line that cannot be split ({error})", file=path, line=number
        ) from None


def _check_separator(sheet: Sheet, importable: bool) -> None:
    """Refuse a table whose header is one piece that holds another separator."""
    for separator, name, typed in ((";", "semicolons", "';'"), ("\t", "tabs", "TAB")):
        if sheet.separator == "," and len(sheet.names) == 1 and separator in sheet.names[0]:
            first, decimal = "", ""
            if re.search(rb"\d,\d", sheet.rows):
                first, decimal = "decimal commas by points, then ", " --decimal ','"
            hint = (
                f"in a text editor replace {first}{name} by commas; "
                "or save it as 'CSV UTF-8 (comma delimited)' where Windows has the list separator ','"
            )
            if importable:
                hint += f"; or truearm import {sheet.file.name} --separator {typed}{decimal} --angles .. --out SESSION"
            problem = f"cells are separated by {name}, expected commas"
            raise InputError(problem, file=sheet.file, line=sheet.first_line - 1, hint=hint)


def _check_shape(sheet: Sheet) -> None:
    """Every row must have as many cells as there are names."""
    width = len(sheet.names)
    if b'"' not in sheet.rows:
        end, mark = np.uint8(ord("\n")), sheet.separator.encode()
        text = np.frombuffer(sheet.rows, dtype=np.uint8)
        if len(mark) == 1:
            marks = text[(text == end) | (text == mark[0])]
            if len(marks) % width == 0:
                ends = marks.reshape(-1, width) == end
                if ends[:, -1].all() and not ends[:, :-1].any() and not (width == 1 and b"\n\n" in sheet.rows):
                    return
    for expected, (line, cells) in enumerate(sheet.cells(), sheet.first_line):
        if line != expected:
            raise InputError(
                "expected one line a reading, got a line break inside quotes",
                file=sheet.file,
                line=expected,
                hint='take the line break out of the cell, or close the quotation mark (")',
            )
        if len(cells) != width and _is_empty(cells):
            raise _empty_row(sheet, line)
        if len(cells) != width:
            raise _ragged(sheet, line, cells)


def _ragged(sheet: Sheet, line: int, cells: list[str]) -> InputError:
    width = len(sheet.names)
    hint = None
    if sheet.separator == "," and len(cells) > width:
        hint = "write decimal points, not commas, and a name that holds a comma in quotation marks"
    elif len(cells) < width:
        hint = "a separator or a value is missing"
    problem = f"expected {width} values as in the line above, got {len(cells)}"
    return InputError(problem, file=sheet.file, line=line, hint=hint)


def _is_empty(cells: Sequence[str]) -> bool:
    return not any(cell.strip() for cell in cells)


def _empty_row(sheet: Sheet, line: int) -> InputError:
    # Left out in silence, it would hide that something is missing there.
    return InputError("expected numbers, got an empty row", file=sheet.file, line=line, hint="delete the row")


def _first_fault(sheet: Sheet, numbers: Sequence[int], optional: Sequence[int]) -> InputError:
    """Find the first cell of the columns `numbers` that is no finite number: the faulty block fast, then its cells."""
    start, line = 0, sheet.first_line
    while start < len(sheet.rows):
        end = sheet.rows.find(b"\n", start + _BLOCK) + 1 or len(sheet.rows)
        block = replace(sheet, rows=sheet.rows[start:end], first_line=line)
        try:
            _read(block, numbers, (), optional)
        except (ValueError, OverflowError):
            if fault := _fault_in(block, numbers, optional):
                return fault
        start, line = end, line + block.rows.count(b"\n")
    return InputError("expected numbers, got cells that cannot be read as numbers", file=sheet.file)


def _fault_in(sheet: Sheet, numbers: Sequence[int], optional: Sequence[int]) -> InputError | None:
    """Look at every cell of the columns `numbers`, slowly, for the first that is no finite number."""
    sign = re.escape(sheet.decimal)
    number = re.compile(rf"[+-]?(\d+{sign}?\d*|{sign}\d+)([eE][+-]?\d+)?", re.ASCII)
    for line, cells in sheet.cells():
        for i in sorted(numbers):
            if cells[i] == "" and i in optional:
                continue
            cell = cells[i].strip(" \t")
            if not number.fullmatch(cell) or not np.isfinite(float(cell.replace(sheet.decimal, "."))):
                if _is_empty(cells):
                    return _empty_row(sheet, line)
                problem, hint = _said_of(cells[i], sheet)
                return InputError(problem, file=sheet.file, line=line, column=sheet.names[i], hint=hint)
    return None


def _said_of(cell: str, sheet: Sheet) -> tuple[str, str | None]:
    """Say what is wrong with a cell that should be a number, and what to try."""
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
        other = "," if sheet.decimal == "." else "."
        return (
            f"expected a number with decimal {sheet.decimal!r}, got {quoted_cell(text)}",
            "write decimal points" if other == sheet.separator else f"--decimal '{other}'",
        )
    return f"expected a number, got {quoted_cell(text)}", None
