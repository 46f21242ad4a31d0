"""A table of another program, whatever kind of file holds it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from truearm.files.file_reading import access_error
from truearm.files.tables.table import Table, TableForm
from truearm.files.tables.text_tables import read_text_table

# How a file of each kind begins; a zip archive is of NumPy by its suffix.
_BEGINNINGS = (
    (b"\x93NUMPY", "numpy"),
    (b"MATLAB ", "matlab"),
    (b"\x89HDF", "matlab"),
    (b"PAR1", "arrow"),
    (b"ARROW1", "arrow"),
    (b"FEA1", "arrow"),
    (b"PK\x03\x04", "workbook"),
    (b"PK\x05\x06", "workbook"),
    (b"\xd0\xcf\x11\xe0", "workbook"),
    (b"\x89MCAP", "recording"),
    (b"SQLite format 3", "recording"),
    (b"#ROSBAG", "recording"),
    (b"LabVIEW Measurement", "labview"),
    (b'{"', "json"),
    (b'[{"', "json"),
)
_SUFFIXES = {
    ".npz": "numpy",
    ".mat": "matlab",
    ".bag": "recording",
    ".mcap": "recording",
    ".db3": "recording",
    ".json": "json",
    ".jsonl": "json",
    ".ndjson": "json",
}
# Imported when they are needed: a prediction needs none.
_READERS = {
    "workbook": "workbooks.read_workbook",
    "numpy": "array_files.read_numpy_table",
    "matlab": "array_files.read_matlab_table",
    "arrow": "arrow_files.read_arrow_table",
    "json": "json_tables.read_json_table",
    "labview": "labview.read_labview_table",
    "recording": "recordings.read_recording",
}


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
    kind = _kind(path)
    if not kind:
        return read_text_table(path, form or TableForm())
    module, function = _READERS[kind].split(".")
    read: Callable[[Path, TableForm], Table] = getattr(import_module(f"truearm.files.tables.{module}"), function)
    return read(path, form or TableForm())


def _kind(path: Path) -> str:
    if path.is_dir():
        return "recording"
    begin = b""
    if path.is_file():
        try:
            with path.open("rb") as file:
                begin = file.read(64)
        except OSError as error:
            raise access_error(path, error) from None
    begin = begin.removeprefix(b"\xef\xbb\xbf").lstrip()
    kind = next((kind for beginning, kind in _BEGINNINGS if begin.startswith(beginning)), "")
    by_suffix = _SUFFIXES.get(path.suffix.lower(), "")
    return by_suffix if by_suffix == "numpy" and kind == "workbook" else kind or by_suffix
