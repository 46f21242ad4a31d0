"""Tables of text: named columns of numbers or words, however a program wrote them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import MAX_BYTES, as_utf8
from truearm.files.file_reading import read_limited
from truearm.files.tables.table import Table, TableForm
from truearm.typing import FloatArray, NameArray


def read_text_table(path: Path, form: TableForm) -> Table:
    """Read a table of text; what `form` does not state is recognised.

    Raises
    ------
    InputError
        If the file is missing, too large, binary or no table.
    """
    text = as_utf8(read_limited(path, limit_bytes=MAX_BYTES), path, form.encoding or "utf-8").decode()
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    skipped = form.skip_lines or 0
    separator = form.separator or max(",;\t", key=lines[skipped].count)
    rows = [
        (number, [cell.strip() for cell in next(csv.reader([line], delimiter=separator))])
        for number, line in enumerate(lines, 1)
        if number > skipped and line.strip()
    ]
    header = form.header if form.header is not None else not any(map(_is_number, rows[0][1]))
    names = rows[0][1] if header else [str(i + 1) for i in range(len(rows[0][1]))]
    body = rows[1:] if header else rows
    for number, cells in body:
        if len(cells) != len(names):
            raise InputError(f"expected {len(names)} values, got {len(cells)}", file=path, line=number)
    columns = tuple(_column(cells, form.decimal or ".") for cells in zip(*(cells for _, cells in body), strict=True))
    numbers = np.array([number for number, _ in body], dtype=int)
    return Table(tuple(names), ("",) * len(names), columns, numbers, "line", path, rows[0][0] if header else None)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _column(cells: tuple[str, ...], decimal: str) -> FloatArray | NameArray:
    try:
        return np.array([float(cell.replace(decimal, ".") or "nan") for cell in cells])
    except ValueError:
        return np.array(cells, dtype=np.str_)
