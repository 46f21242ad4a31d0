"""Forms that a person filled in with a spreadsheet, which saves them with the separators of its country.

A German spreadsheet writes semicolons, decimal commas and Windows' encoding; an English one commas, points and, if
asked, UTF-8. The numbers are the same.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from truearm.files.delimited import MAX_BYTES, Sheet, as_utf8, first_line, quoted_cell, split_line
from truearm.files.file_reading import CHINESE, WINDOWS, read_limited, recognise_encoding

# Comma first: it is the separator of the files that truearm writes.
SEPARATORS = ",;\t"

_WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
# 1,234 is a number with three decimals, or one with a thousands separator; 0,234 and 1,2340 are decimals.
_MAY_BE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?", re.ASCII)
_WITH_POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?", re.ASCII)


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
