"""Tables from LabVIEW's text files (.lvm), whose headers state how numbers are written.

Source: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)".
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from truearm.errors import InputError
from truearm.files.delimited import MAX_BYTES
from truearm.files.file_reading import read_limited
from truearm.wings.importing.tables.table import Table, TableForm
from truearm.wings.importing.tables.text_tables import read_text_table

_END = "***End_of_Header***"


def read_labview_table(path: Path, form: TableForm) -> Table:
    """Read the rows below the last header of a LabVIEW file, with the separator and the decimal sign that it states.

    Raises
    ------
    InputError
        If it has several segments, each with a header of its own, or is no table below it.
    """
    lines = read_limited(path, limit_bytes=MAX_BYTES).decode("latin-1").splitlines()
    ends = [i for i, line in enumerate(lines) if line.strip().startswith(_END)]
    if not ends:
        raise InputError(f"expected the line {_END} of a LabVIEW file, got none", file=path)
    if len(ends) > 2:
        hint = "write the file with 'One header only', or save one segment"
        raise InputError(f"the file has {len(ends) - 1} segments", file=path, line=ends[2] + 1, hint=hint)
    stated = dict(line.split(maxsplit=1) for line in lines[: ends[0]] if len(line.split(maxsplit=1)) == 2)
    separator = {"Tab": "\t", "Comma": ","}.get(stated.get("Separator", ""))
    decimal = stated.get("Decimal_Separator", "").strip() or None
    form = replace(
        form,
        separator=form.separator or separator,
        decimal=form.decimal or decimal,
        skip_lines=ends[-1] + 1 if form.skip_lines is None else form.skip_lines,
    )
    return read_text_table(path, form)
