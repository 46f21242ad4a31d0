"""Tables from workbooks of spreadsheets: .xlsx, .xlsm, .xls and .ods."""

from __future__ import annotations

import datetime
import io
import re
import zipfile
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.wings.importing.tables.array_files import check_unpacked
from truearm.wings.importing.tables.cell_rows import CellRows, table_of_rows
from truearm.wings.importing.tables.layout import HEAD
from truearm.wings.importing.tables.named_arrays import choose_part
from truearm.wings.importing.tables.table import Table, TableForm, listed, unreadable

_MAX_BYTES = 2**27
# Cells between the first and the last that are filled: the reader makes an array of them, and one cell in the last
# corner of an empty sheet would be 550 GB. Characters: a sheet can name one long text in every cell.
_MAX_CELLS, _MAX_CHARACTERS = 2**25, 2**30

_PLACE = re.compile(rb"\sr\s*=\s*[\"']([A-Za-z]{0,7})(\d{1,19})[\"']")
_ODS_TAG = re.compile(rb"<table:(table-row|table-cell|covered-table-cell)\b([^>]*)>")
_REPEATED = re.compile(rb"-repeated\s*=\s*[\"'](\d{1,19})")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")
_THREE_DECIMALS = re.compile(r"-?[1-9]\d{0,2}\.\d{3}")
_REMARK = re.compile(r"\s*(?:#|%|//|!)")


def _rows(sheet: Sequence[Sequence[Any]], skip: int) -> CellRows:
    """Rows of a sheet that hold something, as text; the first `skip` do not belong to the table."""
    # Numbers are typed: beside text with decimal commas they are written without any sign.
    exact = any(isinstance(cell, str) and _DECIMAL_COMMA.fullmatch(cell) for row in sheet for cell in row)
    rows: dict[int, list[str]] = {}
    for number, row in enumerate(sheet[skip:], start=skip + 1):
        cells = [_text(cell, exact) for cell in row]
        filled = [cell for cell in cells if cell.strip()]
        if filled and not (len(filled) == 1 and _REMARK.match(filled[0])):
            rows[number] = cells
    found = list(rows.values())
    head = [[cell.strip() for cell in row] for row in found[:HEAD]]
    return CellRows(list(rows), lambda start, stop: found[start:stop], head)


def read_workbook(path: Path, form: TableForm) -> Table:
    """Read the table of a workbook: of the sheet that `TableForm.part` names, or of the first that holds one.

    Raises
    ------
    InputError
        If the workbook is encrypted, damaged, too large when unpacked, or no sheet holds a table; or two hold tables
        with the same columns.
    """
    from python_calamine import CalamineError, PasswordError, SheetTypeEnum, SheetVisibleEnum, load_workbook

    data = read_limited(path, limit_bytes=_MAX_BYTES)
    if "EncryptedPackage".encode("utf-16-le") in data:
        raise _encrypted(path)
    if data.startswith(b"PK"):
        data = _checked_archive(data, path)
    try:
        with load_workbook(io.BytesIO(data)) as book:
            visible = [
                sheet.name
                for sheet in book.sheets_metadata
                if sheet.typ == SheetTypeEnum.WorkSheet and sheet.visible == SheetVisibleEnum.Visible
            ]
            names = visible if form.part is None else [choose_part(book.sheet_names, form, "sheet", path)]
            rows = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in names}
    except PasswordError:
        raise _encrypted(path) from None
    except BaseException as error:  # faults of the reader, written in Rust, are no exceptions
        if not isinstance(error, CalamineError) and type(error).__name__ != "PanicException":
            raise
        hint = "open it in a spreadsheet program and save it as .xlsx"
        raise unreadable(path, "a workbook", error, hint) from None
    return _table(rows, path, form)


def _table(sheets: dict[str, list[list[Any]]], path: Path, form: TableForm) -> Table:
    tables: dict[str, Table] = {}
    fault: InputError | None = None
    for name, rows in sheets.items():
        said = [f"sheet {name}"] if len(sheets) > 1 else []
        if path.suffix.lower() not in (".xlsx", ".xlsm", ".xls", ".ods"):
            said.append(f"a workbook, whatever {path.suffix or 'its name'} says")
        try:
            tables[name] = table_of_rows(_rows(rows, form.skip_lines or 0), path, form, "row", said)
        except InputError as error:
            if any(any(row) for row in rows):
                fault = fault or error
    if not tables:
        hint = "unhide it, or --part NAME"
        raise fault or InputError("expected a table, got no sheet with cells", file=path, hint=hint)
    first, *others = tables
    if alike := [name for name in others if tables[name].names == tables[first].names]:
        problem = f"sheets {listed([first, *alike])} hold tables with the same columns"
        raise InputError(problem, file=path, hint=f"--part {first!r}")
    return tables[first]


def _checked_archive(data: bytes, path: Path) -> bytes:
    """Pack an archive again without compression, once its contents are known to be of bounded size.

    Raises
    ------
    InputError
        If it is damaged, no workbook, or would fill the memory.
    """
    unpacked = io.BytesIO()
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(unpacked, "w") as plain:
            check_unpacked(archive, path)
            names = archive.namelist()
            if "xl/workbook.xml" not in names and "content.xml" not in names:
                what = "a binary workbook (.xlsb)" if "xl/workbook.bin" in names else "another zip file"
                raise InputError(f"expected a workbook, got {what}", file=path, hint="save the sheet as .xlsx or .csv")
            members = {name: archive.read(name) for name in names}
            longest = max((len(text) for m in members.values() if b"<sst" in m for text in m.split(b"<si")), default=0)
            for name, member in members.items():
                cells, characters = _area_of_ods(member) if name == "content.xml" else _area_of_xlsx(member, longest)
                if cells > _MAX_CELLS or characters > _MAX_CHARACTERS:
                    hint = "delete the cells far below and beside the table"
                    raise InputError(f"a sheet spans {cells:.3g} cells", file=path, hint=hint)
                plain.writestr(name, member)
    except InputError:
        raise
    except Exception as error:  # damage makes zipfile raise many kinds
        raise unreadable(path, "a workbook", error, "save or copy it again") from None
    return unpacked.getvalue()


def _area_of_xlsx(member: bytes, longest: int) -> tuple[int, int]:
    """Cells between the first and the last of a part of a workbook, and the characters they may show."""
    places = _PLACE.findall(member)
    columns, last = {b"A", *(place[0].upper() for place in places)}, max((int(place[1]) for place in places), default=1)
    letters = max(columns, key=lambda name: (len(name), name))
    width = sum(26**k * (letter - 64) for k, letter in enumerate(reversed(letters)))
    return last * width, longest * member.count(b"<c ")


def _area_of_ods(content: bytes) -> tuple[int, int]:
    """Cells between the first and the last that is filled, of all sheets, and the characters they show."""
    rows = rows_to_last = repeat = width = widest = characters = 0
    tags = list(_ODS_TAG.finditer(content))
    for tag, after in zip(tags, [*tags[1:], None], strict=True):
        match = _REPEATED.search(tag[2])
        times = int(match[1]) if match else 1
        if tag[1] == b"table-row":
            rows, repeat, width = rows + times, times, 0
            continue
        width += times
        if not tag[2].endswith(b"/") or b"value" in tag[2]:
            rows_to_last, widest = rows, max(widest, width)
            characters += times * repeat * ((after.start() if after else len(content)) - tag.end())
    return rows_to_last * widest, characters


def _text(cell: Any, exact: bool) -> str:
    """A value as text that has one reading as a number."""
    if isinstance(cell, str):
        return cell.replace("\n", " ")
    if isinstance(cell, datetime.timedelta):
        cell = cell.total_seconds()
    if isinstance(cell, bool) or not isinstance(cell, int | float):
        return str(cell).lower() if isinstance(cell, bool) else str(cell.isoformat())
    if cell == int(cell) and abs(cell) < 1e15:
        return str(int(cell))
    if exact:
        sign, digits, power = Decimal(repr(cell)).as_tuple()
        return f"{'-' * sign}{''.join(map(str, digits))}e{power}"
    text = repr(cell)
    return f"{text}0" if _THREE_DECIMALS.fullmatch(text) else text


def _encrypted(path: Path) -> InputError:
    return InputError("the workbook is protected by a password", file=path, hint="save it without a password")
