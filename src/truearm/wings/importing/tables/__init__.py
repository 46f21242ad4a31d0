"""A table of another program, whatever kind of file holds it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from truearm.files.delimited import MAX_BYTES
from truearm.files.file_reading import access_error, check_readable
from truearm.wings.importing.tables.table import Table, TableForm
from truearm.wings.importing.tables.text_tables import read_text_table

# What reads a kind of file; how such files begin, and how their names end where that does not show.
_READERS: tuple[tuple[str, tuple[bytes, ...], tuple[str, ...]], ...] = (
    ("workbooks.read_workbook", (b"PK\x03\x04", b"PK\x05\x06", b"\xd0\xcf\x11\xe0"), ()),
    ("array_files.read_numpy_table", (b"\x93NUMPY",), (".npz",)),
    ("array_files.read_matlab_table", (b"MATLAB ", b"\x89HDF"), (".mat",)),
    ("array_files.read_arrow_table", (b"PAR1", b"ARROW1", b"FEA1"), ()),
    ("recordings.read_recording", (b"\x89MCAP", b"SQLite format 3", b"#ROSBAG"), (".bag", ".mcap", ".db3")),
    ("text_tables.read_labview_table", (b"LabVIEW Measurement",), ()),
    ("named_arrays.read_json_table", (b'{"', b'[{"'), (".json", ".jsonl", ".ndjson")),
)


def read_table(path: str | Path, form: TableForm | None = None) -> Table:
    """Read a table; its content decides its kind, then the suffix of its name.

    Parameters
    ----------
    path : path
        Delimited text, a workbook, arrays, JSON, or a recording: see docs/import.md.
    form : TableForm, optional
        What a person states about how it is written.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        If the file is missing, too large, no table, or its numbers have two readings; with the place and what to do.
    """
    path = Path(path)
    if not path.is_dir():  # a recording of ROS is a folder
        check_readable(path, limit_bytes=MAX_BYTES)
    reader = _reader(path)
    if reader is None:
        return read_text_table(path, form or TableForm())
    module, function = reader.split(".")  # imported when it is needed: a prediction needs none
    read: Callable[[Path, TableForm], Table] = getattr(
        import_module(f"truearm.wings.importing.tables.{module}"), function
    )
    return read(path, form or TableForm())


def _reader(path: Path) -> str | None:
    begin, suffix = b"", ".bag" if path.is_dir() else path.suffix.lower()
    if path.is_file() and suffix != ".npz":  # which begins as a workbook does
        try:
            with path.open("rb") as file:
                begin = file.read(64).removeprefix(b"\xef\xbb\xbf").lstrip()
        except OSError as error:
            raise access_error(path, error) from None
    by_content = (name for name, beginnings, _ in _READERS if begin.startswith(beginnings))
    return next(by_content, None) or next((name for name, _, suffixes in _READERS if suffix in suffixes), None)
