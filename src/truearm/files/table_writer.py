"""Tables that are written part by part, as CSV or Parquet: they appear whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import append_rows
from truearm.files.extra_packages import extra_module
from truearm.typing import FloatArray, IntArray, NameArray

Columns: TypeAlias = "Mapping[str, FloatArray | IntArray | NameArray]"


@contextmanager
def table_writer(
    path: str | Path, *, decimals: int | None = None, read: Callable[[Path], object] | None = None
) -> Iterator[Callable[[Columns], None]]:
    """Yield a function that appends columns of one length to a table: those of the first time, or fewer.

    Numbers and names of columns that come no more are missing.

    Parameters
    ----------
    path : path
        Parquet if it ends in ``.parquet``, otherwise CSV. It appears when the block ends without an exception.
    decimals : int, optional
        Of numbers in CSV; as many as they need to come back the same by default.
    read : callable, optional
        As of `atomic_file`.

    Raises
    ------
    InputError, TruearmError
        As `atomic_file`; or if a later part has a column that the first has not.
    """
    with atomic_file(path, read=read) as beside:
        first: Columns = {}

        def complete(columns: Columns) -> Columns:
            nonlocal first
            first = first or columns
            if further := [name for name in columns if name not in first]:
                raise InputError(f"the column {further[0]} is not in the first part of the table", file=path)
            n = len(next(iter(columns.values())))
            return {name: columns.get(name, _missing(known, n)) for name, known in first.items()}

        is_parquet = beside.suffix == ".parquet"
        parts = _parquet_parts(beside, *pyarrow_modules(path)) if is_parquet else _csv_parts(beside, decimals)
        with parts as append:
            yield lambda columns: append(complete(columns))


def _missing(column: FloatArray | IntArray | NameArray, n: int) -> FloatArray | NameArray:
    return np.full(n, "") if column.dtype.kind == "U" else np.full(n, np.nan)


def pyarrow_modules(path: str | Path) -> tuple[Any, Any]:
    """The modules `pyarrow` and `pyarrow.parquet`, for a Parquet file.

    Raises
    ------
    MissingTool
        If the package is not installed.
    """
    needs, hint = "Parquet needs the package pyarrow", "pip install 'truearm[parquet]', or use a .csv file"
    arrow, parquet = (extra_module(name, needs, hint, file=path) for name in ("pyarrow", "pyarrow.parquet"))
    return arrow, parquet


@contextmanager
def _csv_parts(path: Path, decimals: int | None) -> Iterator[Callable[[Columns], None]]:
    with path.open("w", encoding="utf-8", newline="") as out:
        yield lambda columns: append_rows(out, columns, decimals=decimals, header=not out.tell())


@contextmanager
def _parquet_parts(path: Path, arrow: Any, parquet: Any) -> Iterator[Callable[[Columns], None]]:
    writer: Any = None

    def append(columns: Columns) -> None:
        nonlocal writer
        # from_pandas: what is missing (NaN) becomes an empty cell.
        table = arrow.table(
            {n: arrow.array(v.tolist() if v.dtype.kind == "U" else v, from_pandas=True) for n, v in columns.items()}
        )
        if writer is None:
            writer = parquet.ParquetWriter(path, table.schema)
        writer.write_table(table)

    try:
        yield append
    finally:
        if writer is not None:
            writer.close()
