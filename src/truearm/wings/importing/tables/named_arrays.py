"""A table of named arrays, as array files, logs and data frames have them: one column for each number of a row.

Tables from JSON: a record a line, an array of records, or a record of arrays.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.file_reading import read_limited, utf8_text
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.importing.tables.table import Place, Table, TableForm, listed

# Cells of a table: a small file can hold very many equal ones.
MAX_CELLS = 2**27
MAX_COLUMNS = 4096
# Larger than any matrix that belongs to a whole file, such as a pose or a covariance.
_LARGEST_MATRIX = 16
# More numbers than this belong to no reading: an array of few rows and very many columns has a reading in each column.
_MOST_A_READING = 64

Column = tuple[str, FloatArray | NameArray]


def table_of_columns(
    columns: Sequence[Column],
    *,
    file: Path | None,
    units: Sequence[str] | None = None,
    lines: IntArray | None = None,
    place: Place = "record",
    assumed: Sequence[str] = (),
) -> Table:
    """Make a table of columns of one length."""
    if not columns or not len(columns[0][1]):
        raise InputError("expected rows of numbers, got none", file=file, hint="one row, record or message a reading")
    names, values = zip(*columns, strict=True)
    stated = tuple(units) if units is not None else ("",) * len(names)
    numbers = np.arange(1, len(values[0]) + 1) if lines is None else lines
    return Table(names, stated, values, numbers, place, file, assumed=tuple(assumed))


def table_of_arrays(arrays: Mapping[str, Any], form: TableForm, *, file: Path | None) -> Table:
    """Make a table of those of named arrays that have a row for each reading.

    The rows are along the axis whose length most arrays share; an array that has it along its second axis is turned.
    Arrays of other lengths are ignored, which `Table.assumed` says.

    Raises
    ------
    InputError
        If no array has rows, or two sets of arrays have different numbers of them; `TableForm.part` names some.
    """
    arrays = dict(_chosen({name: np.asarray(values) for name, values in arrays.items()}, form.part, file))
    n_rows = _common_length(arrays, file)
    columns: list[Column] = []
    assumed, ignored = [], []
    for name, values in arrays.items():
        along = _axis(values, n_rows)
        if along is None:
            ignored.append(f"{name} ({' x '.join(map(str, values.shape)) or 'one value'})")
            continue
        if along == 1:
            values = values.T
            assumed += [] if 1 in values.shape else [f"{name} has a reading in each column, not in each row"]
        columns += columns_of(name, values[:, 0] if values.shape[1:] == (1,) else values, file)
    if ignored:
        assumed.append(f"ignored, of another length than {n_rows}: {listed(ignored)}")
    return table_of_columns(columns, file=file, assumed=assumed)


def columns_of(name: str, values: npt.ArrayLike, file: Path | None = None) -> list[Column]:
    """Take apart (n, ..) values into columns named ``name``, or ``name[0]``, ``name[1][2]``, ``name.field``.

    Numbers become floats, times ISO 8601 text, durations seconds, and logical values ``true`` or ``false``.
    """
    array = np.asarray(values)
    if array.dtype.names:
        return [c for field in array.dtype.names for c in columns_of(f"{name}.{field}".lstrip("."), array[field], file)]
    if array.ndim > 1:
        width = int(np.prod(array.shape[1:]))
        if width > MAX_COLUMNS or array.size > MAX_CELLS:
            what = f"expected at most {MAX_COLUMNS} numbers a reading, got {width} in {name}"
            raise InputError(what, file=file, hint="save the readings alone")
        places = itertools.product(*map(range, array.shape[1:]))
        flat = array.reshape(len(array), width).T
        labels = [f"{name}{''.join(f'[{i}]' for i in at)}" if name else str(k + 1) for k, at in enumerate(places)]
        return [c for label, part in zip(labels, flat, strict=True) for c in columns_of(label, part, file)]
    if array.dtype.kind == "O":
        return _columns_of_objects(name, array.tolist(), file)
    if array.dtype.kind == "M":
        text = np.datetime_as_string(array, unit="us")
        return [(name, np.where(np.isnat(array), "", text).astype(np.str_))]
    if array.dtype.kind == "m":
        return [(name, array / np.timedelta64(1, "s"))]
    if array.dtype.kind in "fiu":
        return [(name, array.astype(float))]
    if array.dtype.kind in "bSU":
        return [(name, np.array([_text(cell) for cell in array.tolist()], dtype=np.str_))]
    return []  # complex numbers, raw bytes


def columns_of_records(records: Sequence[Mapping[str, Any]], file: Path | None = None) -> list[Column]:
    """Take apart records with fields, lists and records in them; a field that a record lacks is empty there.

    Two lists ``name`` and ``position`` of one record are joint names and their values, as in ROS's JointState.
    """
    found: dict[str, list[Any]] = {}
    for row, record in enumerate(records):
        for name, value in _flattened(record):
            cells = found.setdefault(name, [None] * row)
            if len(cells) == row:
                cells.append(value)
        if len(found) > MAX_COLUMNS:
            what = f"expected records of at most {MAX_COLUMNS} numbers"
            raise InputError(what, file=file, hint="save the readings alone")
        for cells in found.values():
            if len(cells) == row:
                cells.append(None)
    return [column for name, cells in found.items() for column in _columns_of_objects(name, cells, file)]


def choose_part(parts: Sequence[str], form: TableForm, what: str, file: Path | None) -> str:
    """Choose one of several parts, or ask which: sheets, arrays, topics.

    Raises
    ------
    InputError
        If `TableForm.part` names none of them, or names none where there are several.
    """
    if form.part is None and len(parts) == 1:
        return parts[0]
    if form.part in parts:
        return str(form.part)
    problem = f"there is no {what} {form.part!r}" if form.part is not None else f"which {what} is meant is not stated"
    raise InputError(f"{problem}; the file has {listed(parts)}", file=file, hint=f"--part {parts[0]!r}")


def _chosen(arrays: dict[str, np.ndarray[Any, Any]], part: str | None, file: Path | None) -> dict[str, Any]:
    """The arrays that `part` names, several by commas; or a record, by its name, with all that it holds."""
    if part is None:
        return arrays
    wanted = [name.strip() for name in part.split(",")]
    if missing := [w for w in wanted if not any(n == w or n.startswith(f"{w}.") for n in arrays)]:
        problem = f"there is no array {missing[0]!r}; the file has {listed(list(arrays))}"
        raise InputError(problem, file=file, hint=f"--part {next(iter(arrays), '')!r}")
    return {n: a for n, a in arrays.items() if any(n == w or n.startswith(f"{w}.") for w in wanted)}


def _common_length(arrays: Mapping[str, np.ndarray[Any, Any]], file: Path | None) -> int:
    """The length that most arrays share; of those the larger, as matrices of one frame are small."""
    lengths = {n for a in arrays.values() for n in a.shape[:2]}
    members = {n: {name for name, a in arrays.items() if _axis(a, n) is not None} for n in lengths}
    weight = {n: sum(1.0 if _axis(arrays[a], n) == 0 else 0.5 for a in members[n]) for n in lengths}
    ranked: list[int] = sorted((n for n in lengths if members[n]), key=lambda n: (weight[n], n), reverse=True)
    if not ranked:
        what = f"expected arrays with a row for each reading, got {listed(list(arrays))}"
        raise InputError(what, file=file, hint="an array (readings, joints)")
    best, second = ranked[0], next(iter(ranked[1:]), 0)
    if second > _LARGEST_MATRIX and weight[second] == weight[best] and not members[best] & members[second]:
        sets = " and ".join(f"{listed(sorted(members[n]))} ({n} rows)" for n in (best, second))
        hint = f"--part {','.join(sorted(members[best]))}"
        raise InputError(f"arrays of two lengths may be meant: {sets}", file=file, hint=hint)
    return best


def _axis(array: np.ndarray[Any, Any], n_rows: int) -> int | None:
    """The axis of an array along which its readings are; None if it has none for each."""
    if not array.ndim or n_rows < 1:
        return None
    if array.shape[0] == n_rows and (array.ndim != 2 or array.shape[1] <= max(n_rows, _MOST_A_READING)):
        return 0
    return 1 if array.ndim == 2 and array.shape[1] == n_rows else None


def _flattened(record: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    names = record.get("name")
    for key, value in record.items():
        label = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{label}.")
        elif not isinstance(value, list | tuple | np.ndarray):
            yield label, value
        elif isinstance(names, list) and len(names) == len(value) and len(names) and isinstance(names[0], str):
            yield from ((f"{joint}/{key}", one) for joint, one in zip(names, value, strict=True) if key != "name")
        else:
            yield from _flattened({f"[{i}]": one for i, one in enumerate(value)}, label)


def _columns_of_objects(name: str, cells: list[Any], file: Path | None) -> list[Column]:
    """Columns of the values of Python: numbers with None for what is missing, or text, or lists and records."""
    if any(isinstance(cell, list | tuple | np.ndarray | Mapping) for cell in cells):
        return columns_of_records([{} if cell is None else {name: cell} for cell in cells], file)
    if all(cell is None or (isinstance(cell, int | float) and not isinstance(cell, bool)) for cell in cells):
        try:
            return [(name, np.array([np.nan if cell is None else float(cell) for cell in cells]))]
        except OverflowError:  # a whole number beyond 1e308
            pass
    return [(name, np.array([_text(cell) for cell in cells], dtype=np.str_))]


def _text(cell: Any) -> str:
    if cell is None or cell != cell:  # NaN and NaT
        return ""
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, bytes):
        return cell.decode("utf-8", "replace")
    return cell.isoformat() if hasattr(cell, "isoformat") else str(cell)


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
