"""Session files: CSV or Parquet, units in the column names; tables of readings and results are written part by part."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError, extra_module
from truearm.files.atomic_write import atomic_file, check_writable
from truearm.files.delimited import MAX_BYTES, Sheet, append_rows, quoted_cell, read_columns, read_form
from truearm.files.file_reading import check_readable
from truearm.readings.columns import AngleUnit, fields_of_columns, fields_of_frame, recognise_columns, session_columns
from truearm.readings.readings import NAMED, Readings
from truearm.typing import FloatArray, IntArray, NameArray

if TYPE_CHECKING:
    import pandas as pd

Columns: TypeAlias = "Mapping[str, FloatArray | IntArray | NameArray]"
# Cells of a Parquet file before they are unpacked: a small file can hold very many equal ones.
MAX_CELLS = 2**27
# Cells of a session that is read back when it is written; of a longer one that would take seconds.
READ_BACK_CELLS = 2**18
LARGE = (
    "truearm fit, predict, evaluate, split and report read folders and larger files by parts (docs/large-sessions.md)"
)


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


def read_fields(path: str | Path, *, n_joints: int | None = None) -> dict[str, Any]:
    """Fields of the readings in a session file, by name; see `truearm.readings.session.read_session`."""
    path = Path(path)
    try:
        check_readable(path, limit_bytes=MAX_BYTES)
    except InputError as error:
        raise error.with_hint(LARGE) if path.is_dir() or path.is_file() else error from None
    if is_parquet(path):
        return fields_of_frame(_read_parquet(path, n_joints), file=path, n_joints=n_joints)
    return fields_of_sheet(read_form(path), n_joints=n_joints)


def fields_of_sheet(sheet: Sheet, *, n_joints: int | None = None) -> dict[str, Any]:
    """Fields of the readings in the rows of a session file, by name."""
    path = sheet.file
    columns = recognise_columns(sheet.names, file=path, line=1, n_joints=n_joints)
    groups = ([sheet.names.index(c) for c in g] for g in (columns.numbers, columns.words, columns.optional))
    unfilled: list[int] = []
    numbers, words = read_columns(sheet, *groups, unfilled=unfilled)
    is_filled = np.ones(len(numbers), bool)
    is_filled[unfilled] = False
    lines = (np.arange(len(numbers)) + sheet.first_line)[is_filled]
    fields = fields_of_columns(columns, numbers[is_filled], [one[is_filled] for one in words], file=path, lines=lines)
    if not unfilled:
        return fields
    seats = words[columns.words.index("seat")][unfilled].tolist() if "seat" in columns.words else [""] * len(unfilled)
    return fields | {"unfilled": tuple(seats)}


def write_session(
    session: Readings, path: str | Path, *, prismatic: npt.ArrayLike | None = None, angle_unit: AngleUnit | None = None
) -> None:
    """Write a session file; an interrupted or failed run leaves none, or the previous one.

    Numbers are written with as many digits as they need to come back the same; angles in degrees come back to one
    part in 1e12.

    Parameters
    ----------
    session : Readings
    path : path
        Ends in ``.csv`` or ``.parquet``.
    prismatic : (n_joints,) bool array, optional
        Which joints slide [mm]; by default those that were in mm in the session file that the readings came from.
    angle_unit : {"deg", "rad"}, optional
        By default the unit of the session file that the readings came from, else degrees.

    Raises
    ------
    InputError
        If the file cannot be written, or a name holds a line break.
    """
    path = Path(path)
    check_session_path(path)
    for name in NAMED:
        words = getattr(session, name)
        if words is not None and (broken := _first_broken(words)) is not None:
            raise InputError(
                f"a {name} must be one line of text, got {quoted_cell(str(broken))}", file=path, column=name
            )
    columns = session_columns(session, prismatic, angle_unit)
    is_short = len(columns) * len(session.angles) <= READ_BACK_CELLS
    with table_writer(path, read=read_fields if is_short else None) as append:
        append(columns)


def check_session_path(path: str | Path) -> None:
    """Check, before long work, that a session file can be written to `path`.

    Raises
    ------
    InputError
        If the name ends in neither ``.csv`` nor ``.parquet``, its folder does not exist, or pyarrow is missing.
    """
    path = Path(path)
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"expected a file name that ends in .csv or .parquet, got {path.name!r}", file=path)
    check_writable(path)
    if path.suffix == ".parquet":
        pyarrow_modules(path)


def _first_broken(words: NameArray) -> str | None:
    return next((w for w in np.unique(words).tolist() if any(sign in w for sign in "\n\r\0")), None)


def is_large(path: object) -> TypeGuard[str | Path]:
    """Whether a session is read part by part: that of a folder, or of a file beyond the limits of `read_fields`."""
    if not isinstance(path, str | Path):
        return False
    path = Path(path)
    if path.is_dir():
        return True
    if not path.is_file() or not is_parquet(path):
        return path.is_file() and path.stat().st_size > MAX_BYTES
    with open_parquet(path) as file:
        return path.stat().st_size > MAX_BYTES or file.metadata.num_rows * len(file.schema_arrow.names) > MAX_CELLS


def is_parquet(path: Path) -> bool:
    """Whether a file is of Parquet, by its name or by how it begins."""
    if path.suffix in (".parquet", ".pq"):
        return True
    try:
        with path.open("rb") as file:
            return file.read(4) == b"PAR1"
    except OSError:
        return False  # read_form says what is wrong


def _read_parquet(path: Path, n_joints: int | None) -> pd.DataFrame:
    """Read the columns of a session, after a check of the size to which they would unpack."""
    with open_parquet(path) as file:
        names = file.schema_arrow.names
        columns = recognise_columns(names, file=path, line=None, n_joints=n_joints)
        n_rows = file.metadata.num_rows
        if n_rows * len(names) > MAX_CELLS:
            raise InputError(f"expected at most {MAX_CELLS} cells, got {n_rows} rows", file=path, hint=LARGE)
        frame: pd.DataFrame = file.read([*columns.numbers, *columns.words]).to_pandas(ignore_metadata=True)
        return frame


@contextmanager
def open_parquet(path: Path) -> Iterator[Any]:
    """A Parquet file (`pyarrow.parquet.ParquetFile`), whose damage is reported as such.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    arrow, parquet = pyarrow_modules(path)
    try:
        with parquet.ParquetFile(path) as file:
            yield file
    except InputError:
        raise
    except (arrow.ArrowException, OSError, ValueError) as error:  # a damaged file fails in many ways
        reason = (str(error).splitlines() or [""])[0]
        raise InputError(f"expected a Parquet file, got one that cannot be read ({reason[:200]})", file=path) from None
