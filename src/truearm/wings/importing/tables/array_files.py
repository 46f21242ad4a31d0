"""Tables from arrays: NumPy, MATLAB, Parquet, Arrow, data frames; without pickle and unpacked only to a limit."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truearm.errors import InputError, extra_module
from truearm.files.delimited import MAX_BYTES
from truearm.files.file_reading import check_readable, read_limited
from truearm.wings.importing.tables.named_arrays import MAX_CELLS, columns_of, table_of_arrays, table_of_columns
from truearm.wings.importing.tables.table import Table, TableForm, unreadable

if TYPE_CHECKING:
    import pandas as pd

_UNPACKED = 2**29  # bytes
# Elements and classes of a level 5 file (MathWorks, "MAT-File Format"). SciPy's reader of such files is not used, as
# damaged ones crash it.
_COMPRESSED, _MATRIX, _CELL, _STRUCT, _DEEPEST = 15, 14, 1, 2, 20
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_NUMERIC_CLASSES, _IS_COMPLEX = range(6, 16), 0x800


def read_numpy_table(path: Path, form: TableForm) -> Table:
    """Read a .npy file of one array (n, k), or with named fields, or a .npz archive of several.

    Raises
    ------
    InputError
        If it is damaged, too large when unpacked, or holds Python objects.
    """
    data = read_limited(path, limit_bytes=MAX_BYTES)
    try:
        if data.startswith(b"PK"):
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                check_unpacked(archive, path)
        loaded = np.load(io.BytesIO(data), allow_pickle=False)
        arrays = {"": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
    except InputError:
        raise
    except Exception as error:  # damage makes NumPy and zipfile raise many kinds
        if "allow_pickle" in str(error):
            problem = "the file holds Python objects (pickle), which truearm does not load"
            hint = "save plain arrays: numpy.savez('readings.npz', q=numpy.array(q, float), ..)"
            raise InputError(problem, file=path, hint=hint) from None
        raise unreadable(path, "a NumPy file", error, "save it again") from None
    return table_of_arrays(arrays, form, file=path)


def read_matlab_table(path: Path, form: TableForm) -> Table:
    """Read the numeric variables of a MATLAB file of version 5 to 7, and the numeric fields of its structs.

    Raises
    ------
    InputError
        If it is of version 7.3 (HDF5), damaged, too large when unpacked, or holds no arrays.
    """
    data = read_limited(path, limit_bytes=MAX_BYTES)
    if data[:10] == b"MATLAB 7.3" or data.startswith(b"\x89HDF"):
        hint = "save it in MATLAB with save('readings.mat', '-v7')"
        raise InputError("the file is of MATLAB 7.3 (HDF5), which truearm does not read", file=path, hint=hint)
    try:
        numeric = dict(_numeric(dict(_matlab_variables(data, path))))
    except InputError:
        raise
    except (ValueError, KeyError, IndexError, TypeError, OverflowError, zlib.error, struct.error) as error:
        hint = "save it in MATLAB with save('readings.mat', '-v7')"
        raise unreadable(path, "a MATLAB file of version 5 to 7", error, hint) from None
    if not numeric:
        hint = "save a table with S = table2struct(T, 'ToScalar', true); save('readings.mat', '-struct', 'S', '-v7')"
        problem = "expected numeric arrays, got none: tables and objects of MATLAB are none"
        raise InputError(problem, file=path, hint=hint)
    return table_of_arrays(numeric, form, file=path)


def check_unpacked(archive: zipfile.ZipFile, path: Path) -> None:
    """Check the size to which a zip archive unpacks; Python's reader stops at the size that a member states.

    Raises
    ------
    InputError
    """
    members = archive.infolist()
    if (total := sum(member.file_size for member in members)) > _UNPACKED:
        problem = f"the file would unpack to {total / 1e6:.3g} MB, more than {_UNPACKED / 1e6:.0f} MB"
        raise InputError(problem, file=path, hint="save only the readings in it")
    if any(member.flag_bits & 1 for member in members):
        raise InputError("the file is protected by a password", file=path, hint="save it without a password")


def _matlab_variables(data: bytes, path: Path) -> Iterator[tuple[str, Any]]:
    """Variables of a level 5 file by name: numbers, or structs as mappings or lists of them; None for all else."""
    if data[126:128] not in (b"IM", b"MI"):
        raise ValueError("no file of MATLAB 5 or later")
    order = "<" if data[126:128] == b"IM" else ">"
    total = 0
    for kind, element in _elements(memoryview(data)[128:], order, padded=False):
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(element, _UNPACKED - total + 1)
            total += len(unpacked)
            if total > _UNPACKED:
                problem = f"the file would unpack to more than {_UNPACKED / 1e6:.0f} MB"
                raise InputError(problem, file=path, hint="save only the readings in it")
            kind, element = next(_elements(memoryview(unpacked), order), (0, element))
        if kind == _MATRIX:
            yield _matlab_array(element, order)


def _elements(data: memoryview, order: str, *, padded: bool = True) -> Iterator[tuple[int, memoryview]]:
    """Types and contents of elements; small ones hold theirs in the tag, and within an array each is padded."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        small, kind = kind >> 16, kind & 0xFFFF
        begin, size = (at + 4, small) if small else (at + 8, size)
        if small > 4 or begin + size > len(data):
            raise ValueError("an element does not end within the file")
        yield kind, data[begin : begin + size]
        at += 8 if small else 8 + (-(-size // 8) * 8 if padded and kind != _COMPRESSED else size)


def _matlab_array(data: memoryview, order: str, depth: int = 0) -> tuple[str, Any]:
    """Name and value of an array."""
    if not len(data) or depth > _DEEPEST:
        return "", None
    (_, flags), (_, dimensions), (_, name), *parts = _elements(data, order)
    (flag,) = struct.unpack_from(f"{order}I", flags)
    shape = np.frombuffer(dimensions, f"{order}i4").tolist()
    value: Any = None
    if flag & 0xFF in _NUMERIC_CLASSES and not flag & _IS_COMPLEX:
        kind, numbers = parts[0]
        value = np.frombuffer(numbers, order + _NUMBERS[kind]).reshape(shape, order="F").squeeze()
    elif flag & 0xFF == _CELL:
        value = [_matlab_array(part, order, depth + 1)[1] for _, part in parts]
    elif flag & 0xFF == _STRUCT:
        (length,) = struct.unpack_from(f"{order}i", parts[0][1])
        text = bytes(parts[1][1])
        fields = [text[i : i + length].split(b"\0")[0].decode("latin-1") for i in range(0, len(text), length)]
        values = [_matlab_array(part, order, depth + 1)[1] for _, part in parts[2:]]
        records = [dict(zip(fields, values[i:], strict=False)) for i in range(0, len(values), max(len(fields), 1))]
        value = records[0] if len(records) == 1 else records
    return bytes(name).decode("latin-1"), value


def _numeric(record: Mapping[str, Any], prefix: str = "") -> Any:
    """Numeric arrays of a record and of the records in it, by names such as ``robot.q``."""
    for name, value in record.items():
        label = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _numeric(value, f"{label}.")
        elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            fields = {key: [np.asarray(one.get(key)) for one in value] for key in value[0]}
            alike = {key: np.stack(cells) for key, cells in fields.items() if len({c.shape for c in cells}) == 1}
            yield from _numeric(alike, f"{label}.")
        elif isinstance(value, list) and len({np.shape(one) for one in value}) > 1:
            continue  # a cell of unlike arrays
        elif (array := np.asarray(value)).dtype.kind in "fiub":
            yield label, array


def read_arrow_table(path: Path, _: TableForm | None = None) -> Table:
    """Read a Parquet, Feather or Arrow file; lists of one length become columns such as ``q[0]``.

    Raises
    ------
    InputError
        If it is damaged, too large when unpacked, or pyarrow is missing.
    """
    check_readable(path, limit_bytes=MAX_BYTES)
    needs, hint = "Parquet needs the package pyarrow", "pip install 'truearm[parquet]', or save it as CSV"
    parquet, feather = (extra_module(f"pyarrow.{kind}", needs, hint, file=path) for kind in ("parquet", "feather"))
    try:
        with path.open("rb") as file:
            if file.read(4) == b"PAR1":
                size = parquet.read_metadata(path)
                if (n_cells := size.num_rows * size.num_columns) > MAX_CELLS:
                    raise InputError(f"expected at most {MAX_CELLS} cells, got {n_cells}", file=path)
                frame = parquet.ParquetFile(file).read().to_pandas()
            else:
                frame = feather.read_table(file).to_pandas()
    except InputError:
        raise
    except Exception as error:  # it can be damaged in many ways
        raise unreadable(path, "a Parquet or Arrow file", error, "save it again") from None
    return table_of_frame(frame, path)


def table_of_frame(frame: pd.DataFrame, file: Path | None = None) -> Table:
    """Make a table of a data frame, of a file or not; its rows are counted from 1 in their order, whatever its index.

    Names of several levels are joined by blanks. Missing values are NaN in columns of numbers, and empty in text.

    Raises
    ------
    InputError
        If it has no rows or no columns.

    Examples
    --------
    >>> import pandas as pd
    >>> from truearm.wings.importing.tables.array_files import table_of_frame
    >>> table = table_of_frame(pd.DataFrame({"J1": [10, 20], "point": [[1.0, 2.0], [3.0, 4.0]]}))
    >>> table.names
    ('J1', 'point[0]', 'point[1]')
    """
    import pandas as pd

    columns = []
    for name, series in frame.items():
        parts = (str(part) for part in name if str(part)) if isinstance(name, tuple) else (str(name),)
        if pd.api.types.is_timedelta64_dtype(series):
            series = series.dt.total_seconds()
        if pd.api.types.is_any_real_numeric_dtype(series):
            values = series.to_numpy(dtype=float, na_value=np.nan)
        else:
            values = series.astype(object).where(series.notna(), None).to_numpy()
        columns += columns_of(" ".join(parts), values, file)
    return table_of_columns(columns, file=file)
