"""Tables from arrays of NumPy (.npy, .npz) and MATLAB (.mat), without pickle and unpacked only to a limit."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import MAX_BYTES
from truearm.files.file_reading import read_limited
from truearm.files.tables.named_arrays import table_of_arrays
from truearm.files.tables.table import Table, TableForm

# What a damaged or hostile file makes the readers of NumPy and SciPy raise.
_DAMAGE = (ValueError, TypeError, KeyError, IndexError, EOFError, OSError, OverflowError, MemoryError, SyntaxError)
_UNPACKED = 2**29  # bytes
_COMPRESSED = 15  # the tag of a compressed element (MAT-File Format, "Level 5 MAT-File Data Types")


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
    except (*_DAMAGE, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        if "allow_pickle" in str(error):
            problem = "the file holds Python objects (pickle), which truearm does not load"
            hint = "save plain arrays: numpy.savez('readings.npz', q=numpy.array(q, float), ..)"
            raise InputError(problem, file=path, hint=hint) from None
        raise _damaged(path, "a NumPy file", error) from None
    return table_of_arrays(arrays, form, file=path)


def read_matlab_table(path: Path, form: TableForm) -> Table:
    """Read the numeric variables of a MATLAB file of version 4 to 7, and the numeric fields of its structs.

    Raises
    ------
    InputError
        If it is of version 7.3 (HDF5), damaged, too large when unpacked, or holds no arrays.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    data = read_limited(path, limit_bytes=MAX_BYTES)
    if data[:10] == b"MATLAB 7.3" or data.startswith(b"\x89HDF"):
        hint = "save it in MATLAB with save('readings.mat', '-v7')"
        raise InputError("the file is of MATLAB 7.3 (HDF5), which truearm does not read", file=path, hint=hint)
    try:
        _check_elements(data, path)
        variables = loadmat(cast(Any, io.BytesIO(data)), simplify_cells=True)
    except InputError:
        raise
    except (*_DAMAGE, MatReadError, zlib.error, struct.error, NotImplementedError, AttributeError) as error:
        raise _damaged(path, "a MATLAB file", error) from None
    arrays = {name: value for name, value in variables.items() if not name.startswith("__")}
    numeric = dict(_numeric(arrays))
    if not numeric:
        hint = "save a table with S = table2struct(T, 'ToScalar', true); save('readings.mat', '-struct', 'S', '-v7')"
        raise InputError(
            "expected numeric arrays, got none: tables and objects of MATLAB are none", file=path, hint=hint
        )
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


def _check_elements(data: bytes, path: Path) -> None:
    """Unpack the compressed elements of a level 5 file in small pieces, and stop where they are too large."""
    if data[126:128] not in (b"IM", b"MI"):
        return
    order = "<" if data[126:128] == b"IM" else ">"
    at, total = 128, 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        packed, unpack = data[at + 8 : at + 8 + size], zlib.decompressobj()
        while kind == _COMPRESSED and packed:
            total += len(unpack.decompress(packed, 2**24))
            packed = unpack.unconsumed_tail
            if total > _UNPACKED:
                problem = f"the file would unpack to more than {_UNPACKED / 1e6:.0f} MB"
                raise InputError(problem, file=path, hint="save only the readings in it")
        at += 8 + size


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
        elif (array := np.asarray(value)).dtype.kind in "fiub" and array.ndim in (0, 1, 2, 3):
            yield label, array


def _damaged(path: Path, what: str, error: Exception) -> InputError:
    reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
    return InputError(f"expected {what}, got one that cannot be read ({reason})", file=path, hint="save it again")
