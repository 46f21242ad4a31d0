"""The session file: readings in CSV or Parquet, units in the column names."""

from __future__ import annotations

import csv
import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_writable
from truearm.files.delimited import MAX_NAME, quoted_cell, read_columns, read_sheet
from truearm.readings.columns import ANGLE, FACTOR, QUATERNION, TEMPERATURE, Columns, recognise_columns, unit_of
from truearm.readings.session import DIRECTION, NAMED, SPHERE_DISTANCE, Session
from truearm.typing import FloatArray, NameArray

AngleUnit = Literal["deg", "rad"]

# Numbers in a Parquet file before they are unpacked: a small file can hold very many equal ones.
MAX_CELLS = 2**27

# Rows that are turned into text together: few enough to stay small, many enough to be fast.
_CHUNK = 20_000


def read_session(path: str | Path, *, n_joints: int | None = None) -> Session:
    """Read a session file (docs/session-file.md).

    Parameters
    ----------
    path : path
        CSV (comma, decimal point, UTF-8), or Parquet with the same columns (needs ``truearm[parquet]``).
    n_joints : int, optional
        The arm's number of joints; any number by default.

    Returns
    -------
    Session
        Angles in rad (sliding joints in mm), points in mm.

    Raises
    ------
    InputError
        If anything is not as the format demands: the file, the line and the column, and what to try.
    """
    path = Path(path)
    if _begins_as_parquet(path) or path.suffix in (".parquet", ".pq"):
        return _read_parquet(path, n_joints)
    sheet = read_sheet(path, importable=True)
    columns = recognise_columns(sheet.names, file=path, line=1, n_joints=n_joints)
    groups = ([sheet.names.index(c) for c in g] for g in (columns.numbers, columns.words, columns.optional))
    numbers, words = read_columns(sheet, *groups)
    return _readings(columns, numbers, words, file=path, first_line=sheet.first_line)


def write_session(
    readings: Session,
    path: str | Path,
    *,
    prismatic: npt.ArrayLike | None = None,
    angle_unit: AngleUnit | None = None,
) -> None:
    """Write a session file; an interrupted or failed run leaves none, or the one that was there.

    Numbers are written with as many digits as they need to come back the same; angles in degrees come back to one
    part in 1e12.

    Parameters
    ----------
    readings : Session
        Any readings.
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
        words = getattr(readings, name)
        if words is not None and (broken := _first_broken(words)) is not None:
            raise InputError(
                f"a {name} must be one line of text, got {quoted_cell(str(broken))}", file=path, column=name
            )
    columns = _table(readings, _units(readings, prismatic, angle_unit))
    with atomic_file(path) as beside:
        if path.suffix == ".parquet":
            arrow, parquet = _pyarrow(path)
            # from_pandas: what is missing (NaN) becomes an empty cell.
            table = {
                n: arrow.array(v.tolist() if v.dtype.kind == "U" else v, from_pandas=True) for n, v in columns.items()
            }
            parquet.write_table(arrow.table(table), beside)
        else:
            _write_csv(columns, beside)


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
        _pyarrow(path)


def _readings(
    columns: Columns, numbers: FloatArray, words: Sequence[NameArray], *, file: Path, first_line: int | None
) -> Session:
    """Make the record, in the units of the house."""
    references = (columns.points, columns.point_std, columns.quaternion, columns.sphere_distance)
    groups = (columns.angles, *references, columns.temperature, columns.directions)
    parts = np.split(numbers, np.cumsum([len(group) for group in groups]), axis=1)
    for names, part in zip(groups[1:5], parts[1:5], strict=True):
        _check_whole(names, part, file=file, first_line=first_line)
    angles, points, std = (
        part * [FACTOR[unit_of(name)] for name in names] for part, names in zip(parts, groups[:3], strict=False)
    )
    quaternion, sphere_distance, temperature, directions, loads = parts[3:]
    return Session(
        angles,
        points if columns.points else None,
        point_std=std if columns.point_std else None,
        temperature_degC=temperature[:, 0] if columns.temperature else None,
        quaternion=quaternion if columns.quaternion else None,
        sphere_distance=sphere_distance if columns.sphere_distance else None,
        directions=directions if columns.directions else None,
        columns=dict(zip(columns.loads, loads.T, strict=True)),
        file=file,
        angle_columns=columns.angles,
        first_line=first_line,
        **cast(Any, dict(zip(columns.words, words, strict=True))),
    )


def _check_whole(names: Sequence[str], values: FloatArray, *, file: Path, first_line: int | None) -> None:
    """Refuse a row (n, len(names)) of which only some cells are empty."""
    missing = np.isnan(values)
    partly = missing.any(axis=1) & ~missing.all(axis=1)
    if partly.any():
        row = int(np.argmax(partly))
        where = f" in reading {row + 1}" if first_line is None else ""
        raise InputError(
            f"expected a number as in the columns that go with it, got an empty cell{where}",
            file=file,
            line=None if first_line is None else first_line + row,
            column=names[int(np.argmax(missing[row]))],
            hint=f"fill it in, or leave {', '.join(names)} empty together",
        )


def _units(readings: Session, prismatic: npt.ArrayLike | None, angle_unit: AngleUnit | None) -> list[str]:
    """Choose the unit in which each joint is written."""
    if angle_unit not in (None, "deg", "rad"):
        raise InputError(f"expected the angle unit deg or rad, got {quoted_cell(angle_unit)}")
    known = [ANGLE.fullmatch(name) for name in readings.angle_columns or ()]
    units = [match[2] if match else "deg" for match in known] or ["deg"] * readings.n_joints
    if angle_unit is not None:
        units = ["mm" if unit == "mm" else angle_unit for unit in units]
    if prismatic is not None:
        slides = np.asarray(prismatic, dtype=bool)
        if slides.shape != (readings.n_joints,):
            raise InputError(f"expected {readings.n_joints} joint types, got shape {slides.shape}")
        turning = [angle_unit or "deg" if unit == "mm" else unit for unit in units]
        units = ["mm" if slide else unit for slide, unit in zip(slides, turning, strict=True)]
    return units


def _table(readings: Session, units: Sequence[str]) -> dict[str, FloatArray | NameArray]:
    """Lay out the columns as they are written, in the order of the format."""
    table: dict[str, FloatArray | NameArray] = {}
    for i, unit in enumerate(units):
        table[f"q{i + 1}_{unit}"] = readings.angles[:, i] / FACTOR[unit]
    for prefix, values in (("", readings.points), ("s", readings.point_std)):
        if values is not None:
            table |= {f"{prefix}{axis}_mm": values[:, k] for k, axis in enumerate("xyz")}
    if readings.quaternion is not None:
        table |= {name: readings.quaternion[:, k] for k, name in enumerate(QUATERNION)}
    for name in NAMED:
        if (words := getattr(readings, name)) is not None:
            table[name] = words
    if readings.sphere_distance is not None:
        table |= {name: readings.sphere_distance[:, k] for k, name in enumerate(SPHERE_DISTANCE)}
    if readings.temperature_degC is not None:
        table[TEMPERATURE] = readings.temperature_degC
    if readings.directions is not None:
        table |= {f"{DIRECTION}{i + 1}": readings.directions[:, i] for i in range(readings.n_joints)}
    table.update(readings.columns)
    return table


def _write_csv(table: dict[str, FloatArray | NameArray], path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(table)
        values = list(table.values())
        for start in range(0, len(values[0]), _CHUNK):
            # Python's floats write themselves with the fewest digits that come back the same.
            writer.writerows(zip(*(_cells(v[start : start + _CHUNK]) for v in values), strict=True))


def _cells(values: FloatArray | NameArray) -> list[Any]:
    """Cells of a column as the writer takes them; a number that is missing is an empty cell."""
    cells: list[Any] = values.tolist()
    if values.dtype.kind == "f" and np.isnan(values).any():
        return ["" if cell != cell else cell for cell in cells]
    return cells


def _first_broken(words: NameArray) -> str | None:
    return next((w for w in np.unique(words).tolist() if any(sign in w for sign in "\n\r\0")), None)


def _begins_as_parquet(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(4) == b"PAR1"
    except OSError:
        return False  # read_sheet says what is wrong


def _pyarrow(path: Path) -> tuple[Any, Any]:
    try:
        importlib.import_module("pyarrow.compute")
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            "Parquet needs the package pyarrow, which is not installed",
            file=path,
            hint="pip install 'truearm[parquet]', or use a .csv file",
        ) from None


def _read_parquet(path: Path, n_joints: int | None) -> Session:
    if not path.is_file():
        raise InputError("the file does not exist" if not path.exists() else "expected a file, got a folder", file=path)
    arrow, parquet = _pyarrow(path)
    try:
        columns, table = _parquet_table(parquet, path, n_joints)
        numbers = np.stack(
            [_parquet_numbers(arrow, table[c], c, path, c in columns.optional) for c in columns.numbers], axis=1
        )
        words = [_parquet_words(arrow, table[c], c, path) for c in columns.words]
    except InputError:
        raise
    except (arrow.ArrowException, OSError, ValueError) as error:  # a damaged file fails in many ways
        reason = (str(error).splitlines() or [""])[0]
        raise InputError(f"expected a Parquet file, got one that cannot be read ({reason[:200]})", file=path) from None
    return _readings(columns, numbers, words, file=path, first_line=None)


def _parquet_table(parquet: Any, path: Path, n_joints: int | None) -> tuple[Columns, Any]:
    """Read the known columns, after a look at what they would unpack to."""
    with parquet.ParquetFile(path) as file:
        names = file.schema_arrow.names
        columns = recognise_columns(names, file=path, line=None, n_joints=n_joints)
        n_rows = file.metadata.num_rows
        if n_rows * len(names) > MAX_CELLS:
            raise InputError(f"expected at most {MAX_CELLS} cells, got {n_rows} rows", file=path)
        if not n_rows:
            raise InputError("expected at least one reading, got none", file=path)
        return columns, file.read([*columns.numbers, *columns.words])


def _parquet_numbers(arrow: Any, column: Any, name: str, path: Path, optional: bool) -> FloatArray:
    if optional and arrow.types.is_null(column.type):  # every cell is empty
        return np.full(len(column), np.nan)
    if not (arrow.types.is_floating(column.type) or arrow.types.is_integer(column.type)):
        raise InputError(f"expected numbers, got a column of type {column.type}", file=path, column=name)
    values: FloatArray = column.to_numpy().astype(float)
    # Makers of Parquet files write either an empty cell or NaN for what is missing.
    good = np.isfinite(values) | np.isnan(values) if optional else np.isfinite(values)
    if not good.all():
        row = int(np.argmin(good))
        got = "an empty cell" if column[row].as_py() is None else repr(float(values[row]))
        raise InputError(f"expected a finite number, got {got} in reading {row + 1}", file=path, column=name)
    return values


def _parquet_words(arrow: Any, column: Any, name: str, path: Path) -> NameArray:
    if arrow.types.is_dictionary(column.type):  # pandas' categories
        column = arrow.chunked_array([chunk.dictionary_decode() for chunk in column.chunks])
    if arrow.types.is_null(column.type):  # every cell is empty
        return np.full(len(column), "")
    if not (arrow.types.is_string(column.type) or arrow.types.is_large_string(column.type)):
        raise InputError(f"expected names (text), got a column of type {column.type}", file=path, column=name)
    if column.null_count:
        column = column.fill_null("")
    longest = arrow.compute.max(arrow.compute.utf8_length(column)).as_py() or 0
    if longest > MAX_NAME:
        raise InputError(f"expected names of at most {MAX_NAME} signs, got one of {longest}", file=path, column=name)
    words = np.array(column.to_pylist(), dtype=np.str_)
    broken = [row for row, word in enumerate(column.to_pylist()) if {"\0", "\n", "\r"} & set(word)]
    if broken:
        raise InputError(
            f"expected a name on one line, got control signs in reading {broken[0] + 1}", file=path, column=name
        )
    return words
