"""Tables that are written part by part, as CSV or Parquet: they appear whole or not at all."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from truearm.errors import MissingTool
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import append_rows
from truearm.typing import FloatArray, IntArray, NameArray

Columns: TypeAlias = "Mapping[str, FloatArray | IntArray | NameArray]"


@contextmanager
def table_writer(path: str | Path, *, decimals: int | None = None) -> Iterator[Callable[[Columns], None]]:
    """Yield a function that appends columns of one length to a table, each time the same ones.

    Parameters
    ----------
    path : path
        Parquet if it ends in ``.parquet``, otherwise CSV. It appears when the block ends without an exception.
    decimals : int, optional
        Of numbers in CSV; as many as they need to come back the same by default.

    Raises
    ------
    InputError, TruearmError
        As `atomic_file`.
    """
    with atomic_file(path) as beside:
        parts = _parquet_parts(beside) if beside.suffix == ".parquet" else _csv_parts(beside, decimals)
        with parts as append:
            yield append


def pyarrow_modules(path: str | Path) -> tuple[Any, Any]:
    """The modules `pyarrow` and `pyarrow.parquet`, for a Parquet file.

    Raises
    ------
    MissingTool
        If the package is not installed.
    """
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise MissingTool(
            "Parquet needs the package pyarrow, which is not installed",
            file=path,
            hint="pip install 'truearm[parquet]', or use a .csv file",
        ) from None


@contextmanager
def _csv_parts(path: Path, decimals: int | None) -> Iterator[Callable[[Columns], None]]:
    with path.open("w", encoding="utf-8", newline="") as out:
        yield lambda columns: append_rows(out, columns, decimals=decimals, header=not out.tell())


@contextmanager
def _parquet_parts(path: Path) -> Iterator[Callable[[Columns], None]]:
    arrow, parquet = pyarrow_modules(path)
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
