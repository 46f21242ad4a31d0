"""Tables from JSON: a record a line, an array of records, or a record of arrays."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from truearm.errors import InputError
from truearm.files.file_reading import read_limited, utf8_text
from truearm.wings.importing.tables.named_arrays import (
    choose_part,
    columns_of,
    columns_of_records,
    table_of_arrays,
    table_of_columns,
)
from truearm.wings.importing.tables.table import Table, TableForm

# Text becomes about ten times as large in memory.
_MAX_BYTES = 2**27


def read_json_table(path: Path, form: TableForm) -> Table:
    """Read JSON or JSON lines; lists in a record become columns such as ``q[0]``, records in it such as ``tip.x``.

    Raises
    ------
    InputError
        If it is no JSON, with the line; or holds no table, or several of which `TableForm.part` names none.
    """
    text = utf8_text(read_limited(path, limit_bytes=_MAX_BYTES))
    try:
        whole = json.loads(text)
    except RecursionError:
        raise InputError("the records are nested too deeply", file=path) from None
    except ValueError as error:
        return _of_lines(text, path, error)
    if isinstance(whole, Mapping) and any(_is_column(value) for value in whole.values()) and not any(_tables(whole)):
        return table_of_arrays({k: v for k, v in whole.items() if isinstance(v, list | int | float)}, form, file=path)
    tables = {"": whole} if isinstance(whole, list) else dict(_tables(whole) if isinstance(whole, Mapping) else {})
    if not tables:
        hint = 'one record a reading: [{"q": [0.1, 0.2], "x": 1.5}, ..]'
        raise InputError("expected a list of records, got none", file=path, hint=hint)
    rows = tables[choose_part(list(tables), form, "list of records", path)]
    if all(isinstance(row, Mapping) for row in rows):
        return table_of_columns(columns_of_records(rows, path), file=path)
    try:
        return table_of_columns(columns_of("", np.array(rows, dtype=float), path), file=path)
    except (ValueError, TypeError):
        raise InputError("expected records, or rows of numbers of one length", file=path) from None


def _of_lines(text: str, path: Path, whole: ValueError) -> Table:
    records: list[Mapping[str, Any]] = []
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
        except (ValueError, RecursionError) as error:
            # A file that fails at its first record was meant as one piece.
            at, fault = (number, error) if records else (getattr(whole, "lineno", number), whole)
            reason = getattr(fault, "msg", "a number or a nesting that is too large")
            raise InputError(f"expected JSON, got a line that is none ({reason})", file=path, line=at) from None
        records.append(record if isinstance(record, Mapping) else {"": record})
        lines.append(number)
    return table_of_columns(columns_of_records(records, path), file=path, lines=np.array(lines), place="line")


def _tables(record: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, list[Any]]]:
    """Lists of records in a record and in those in it, by their names."""
    for name, value in record.items():
        if isinstance(value, Mapping):
            yield from _tables(value, f"{prefix}{name}.")
        elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            yield f"{prefix}{name}", value


def _is_column(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0 and isinstance(value[0], int | float | str | list)
