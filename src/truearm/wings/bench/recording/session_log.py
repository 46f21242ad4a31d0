"""A session file that grows reading by reading, each on the disk within a tenth of a second, and what is said of it.

Events are for people and for machines.
"""

from __future__ import annotations

import csv
import io
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import check_writable, entry_to_disk, lock
from truearm.files.delimited import MAX_BYTES, escape_formula, form_of
from truearm.files.file_reading import access_error, check_readable
from truearm.readings import Session, read_session
from truearm.readings.files import fields_of_sheet
from truearm.readings.large_sessions import joined_sessions
from truearm.verbs.record import to_plain

Kind = Literal["ready", "sample", "reading", "undone", "learned", "next", "enough", "model", "notice", "refused", "end"]


@dataclass(frozen=True)
class Event:
    """Something that a recording says.

    Attributes
    ----------
    kind : {"ready", "sample", "reading", "undone", "learned", "next", "enough", "model", "notice", "refused", "end"}
        ``reading``: it is in the file. ``learned``: how well the arm is known with it. ``next``: the pose that comes
        next. ``enough``: further readings would add little. ``model``: another one is in force. ``refused``: what a
        person asked for was not done.
    text : str
        In one sentence.
    values : mapping of str to object
        For machines; the keys state their units.
    """

    kind: Kind
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The event for machines: its kind, its text and its values."""
        plain: dict[str, Any] = to_plain({"event": self.kind, "text": self.text, **self.values})
        return plain


Row = Mapping[str, float | str]
# The shortest time from one fsync to the next: a robot that reports each millisecond does not wait for the disk.
SYNC_S = 0.1


class SessionLog:
    """An open session file (CSV) to which readings are appended.

    A row is one write: after `append` has returned, the end of the program does not lose it. fsync follows, so that the
    end of the system does not either: at once, or `SYNC_S` after the one before by `settle`. A row that a power failure
    cut short is removed when the file is opened again (the last column is a note, so that a row with all its cells is
    one). The last reading is undone by truncating the file at the end of the one before, which is one step too.

    Parameters
    ----------
    path : Path
        Ends in ``.csv``. A file with the same columns is continued.
    columns : sequence of str
        Of the session file; notes among them.

    Attributes
    ----------
    rows : list of dict
        The cells of the readings in the file.
    repaired : str
        What was removed when the file was opened; empty if nothing was.

    Raises
    ------
    InputError
        If the name has another ending, the file has other columns or a row of another number of cells, another program
        records to it, or it cannot be written.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        check_log_path(path)
        self.path, self.columns, self.repaired = path, tuple(columns), ""
        self._synced_s, self._is_synced = -np.inf, True
        self._read: Session | None = None
        if path.exists():
            check_readable(path, limit_bytes=MAX_BYTES)
        # Not a temporary file that is renamed: of two programs that start at once, one would replace the other's.
        try:
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        except OSError as error:
            raise access_error(path, error) from None
        try:
            self._open()
        except OSError as error:
            self.close()
            raise access_error(path, error, purpose="written") from None
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        """Lock the file, and read or begin it."""
        path, header = self.path, _line(self.columns)
        if lock(self._handle) is False:
            raise InputError(
                "another program records to the file", file=path, hint="end it, or choose another file name"
            )
        content = path.read_bytes()
        if len(content) < len(header) and header.startswith(content):  # new, or begun when the power failed
            os.ftruncate(self._handle, 0)
            os.lseek(self._handle, 0, os.SEEK_SET)
            os.write(self._handle, header)
            entry_to_disk(path)
            content = header
        whole = content[: content.rfind(b"\n") + 1]
        lines = whole.splitlines(keepends=True)
        if not lines or _cells(lines[0]) != list(self.columns):
            raise InputError(
                f"the file exists, with other columns than {','.join(self.columns)}",
                file=path,
                line=1,
                hint="choose another name, or the source and options with which it was recorded",
            )
        self.rows = [self._row(line, number) for number, line in enumerate(lines[1:], start=2)]
        self._ends = [int(end) for end in np.cumsum([len(line) for line in lines])]
        if tail := content[len(whole) :]:
            self._mend(tail)
        os.fsync(self._handle)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, all of it on the disk."""
        try:
            if not self._is_synced:
                os.fsync(self._handle)
        except OSError as error:
            raise TruearmError(f"{self.path}: the readings cannot be written ({error.strerror or error})") from None
        finally:
            os.close(self._handle)

    def settle(self) -> float | None:
        """Write to the disk what is due; the time until more is due [s], None if all is there.

        Raises
        ------
        TruearmError
            If the disk is full, or fails.
        """
        try:
            self._to_disk()
        except OSError as error:
            raise TruearmError(f"{self.path}: the readings cannot be written ({error.strerror or error})") from None
        return None if self._is_synced else max(self._synced_s + SYNC_S - time.monotonic(), 0.0)

    def append(self, row: Row) -> None:
        """Append a reading.

        Raises
        ------
        TruearmError
            If another program changed or replaced the file, or the disk is full; the file is as before.
        """
        self._append([_cell(row.get(name, "")) for name in self.columns])

    def name_seat(self, seat: str) -> None:
        """State the seat of the last reading, which has none; at every moment it is in the file.

        Raises
        ------
        TruearmError
            As `append`.
        """
        start, before = self._ends[-2], self.rows[-1]
        cells = [seat if name == "seat" else before[name] for name in self.columns]
        try:
            self._write(start, _line(cells))  # longer than the line that it replaces
        except TruearmError:
            with suppress(TruearmError):
                self._write(start, _line(before.values()))
            raise
        self._ends[-1] = start + len(_line(cells))
        self.rows[-1] = dict(zip(self.columns, cells, strict=True))
        self._read = None

    def _append(self, cells: Sequence[str]) -> None:
        line = _line(cells)
        self._write(self._ends[-1], line)
        self._ends.append(self._ends[-1] + len(line))
        self.rows.append(dict(zip(self.columns, cells, strict=True)))

    def _write(self, at: int, line: bytes) -> None:
        self._check_own()
        try:
            os.lseek(self._handle, at, os.SEEK_SET)
            written = os.write(self._handle, line)
            if written < len(line):
                raise OSError("the disk is full")
            self._is_synced = False
            self._to_disk()
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._handle, self._ends[-1])
            raise TruearmError(f"{self.path}: the reading cannot be written ({error.strerror or error})") from None

    def undo(self) -> dict[str, str] | None:
        """Remove the last reading and return its cells; None if there is none.

        Raises
        ------
        TruearmError
            As `append`.
        """
        self._check_own()
        if not self.rows:
            return None
        try:
            os.ftruncate(self._handle, self._ends[-2])
            self._ends.pop()
            removed, self._read = self.rows.pop(), None
            self._is_synced = False
            self._to_disk()
        except OSError as error:
            raise TruearmError(f"{self.path}: the reading cannot be removed ({error.strerror or error})") from None
        return removed

    def session(self) -> Session:
        """The readings in the file, as `read_session` gives them; those since the last call are read alone.

        Raises
        ------
        InputError
            As `read_session`.
        """
        known, self._read = self._read if self._is_own() else None, None
        lines = [] if known is None else [_line(row.values()) for row in self.rows[len(known) :]]
        if known is None:
            found = read_session(self.path)
        elif lines:
            sheet = form_of(_line(self.columns) + b"".join(lines), self.path)
            new = replace(sheet, data_line=len(known) + 1, first_line=len(known) + 2)
            found = joined_sessions([known, Session(**fields_of_sheet(new))])
        else:
            found = known
        self._read = found if self._is_own() else None
        return found

    def _row(self, line: bytes, number: int) -> dict[str, str]:
        cells = _cells(line)
        if len(cells) != len(self.columns):
            raise InputError(
                f"expected {len(self.columns)} values, got {len(cells)}",
                file=self.path,
                line=number,
                hint="correct or delete the line, or record to another file",
            )
        return dict(zip(self.columns, cells, strict=True))

    def _mend(self, tail: bytes) -> None:
        """Remove a last line without its end. With all its cells, it is one that an editor saved so."""
        os.ftruncate(self._handle, self._ends[-1])
        if len(cells := _cells(tail)) == len(self.columns):
            self._append(cells)
        else:
            self.repaired = "the last line was incomplete, and its reading not acknowledged; removed"

    def _to_disk(self) -> None:
        if not self._is_synced and time.monotonic() - self._synced_s >= SYNC_S:
            os.fsync(self._handle)
            self._synced_s, self._is_synced = time.monotonic(), True

    def _check_own(self) -> None:
        """An editor that saves the file replaces it: rows would go to a file without a name."""
        if not self._is_own():
            raise TruearmError(f"{self.path}: another program changed the file while it grew. Record to another file")

    def _is_own(self) -> bool:
        """Whether the file is as this log has written it."""
        own = os.fstat(self._handle)
        try:
            return os.path.samestat(own, os.stat(self.path)) and own.st_size == self._ends[-1]
        except FileNotFoundError:
            return False


def check_log_path(path: Path) -> None:
    """Check, before readings are taken, that a session log can be written.

    Raises
    ------
    InputError
        If the name does not end in ``.csv``, or the file cannot be written.
    """
    if path.suffix != ".csv":
        raise InputError(f"expected a file name that ends in .csv, got {path.name!r}", file=path)
    check_writable(path)


def _cell(value: float | str) -> str:
    """Text, or a number with as many digits as it needs to come back the same; NaN is empty."""
    if isinstance(value, str):
        return escape_formula(value)
    return "" if value != value else repr(value)


def _line(cells: Iterable[str]) -> bytes:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(cells)
    return out.getvalue().encode()


def _cells(line: bytes) -> list[str]:
    return next(csv.reader([line.decode("utf-8", "replace")]), [])
