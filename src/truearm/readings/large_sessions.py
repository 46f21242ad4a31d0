"""Sessions in parts: one large file, or a folder of files, that do not fit into the memory, or a long session in it.

A part is what one task reads: some lines of a CSV file, a row group of a Parquet file, or some rows in memory. Parts
depend on the readings alone, not on who reads them, so that sums over them in their order are always the same. Every
row is checked as in a small session.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce
from itertools import accumulate, pairwise
from operator import add
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import Sheet, as_utf8, encoding_of_form, form_of
from truearm.files.file_reading import access_error, check_readable
from truearm.readings.columns import QUATERNION, Columns, fields_of_frame, recognise_columns, session_columns
from truearm.readings.files import MAX_CELLS, fields_of_sheet, is_parquet, open_parquet
from truearm.readings.session import Session, chosen_groups, group_names
from truearm.solve.executors import Executor, Serial, results_in_order
from truearm.solve.sums import Sums
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray

S = TypeVar("S", bound=Sums)

# Bytes of the lines of a part: some ten thousand readings, in the memory some ten times as large.
PART_BYTES = 2**23
# Readings of a Parquet file that are in the memory at once.
MAX_READINGS = 2**16
# Bytes at the beginning of a file that show its separators; a line is shorter.
HEAD_BYTES = 2**16
# No file is larger: a petabyte. One that is counted must have an end.
LARGEST_BYTES = 2**50
# Parts of a session in memory: each is held out in turn.
LEAST_PARTS = 10
# Readings of a sample: its judgements cost some seconds of a kinematic model, and some ten of a physical one.
SAMPLE = 20_000
# Consecutive readings that stay together in a split by rows.
STRETCH = 2**13
# Groups of a split: their names are in the memory.
MAX_GROUPS = 10**6
SUFFIXES = (".csv", ".parquet", ".pq")


@dataclass(frozen=True)
class Part(ABC):
    """Consecutive readings of one file.

    Attributes
    ----------
    file : Path
    n_readings : int
    n_before : int
        Readings before them in the file.
    n_joints : int or None
        The arm's number of joints, if it is known.
    """

    file: Path
    n_readings: int
    n_before: int
    n_joints: int | None

    @abstractmethod
    def sessions(self) -> Iterator[Session]:
        """Iterate over the readings, some ten thousand at a time.

        Raises
        ------
        InputError
            As `read_session`.
        """

    @abstractmethod
    def rows(self, which: IntArray) -> Session:
        """Some of the readings, counted from 0 in the part, rising."""

    @property
    @abstractmethod
    def first_number(self) -> int:
        """The number of the first reading: its line, or its place in the file."""


@dataclass(frozen=True)
class Lines(Part):
    """Lines of a CSV file.

    Attributes
    ----------
    form : Sheet
        Header and separators of the file.
    encoding : str
        Of all of the file.
    start, stop : int
        Bytes of the file.
    """

    form: Sheet
    encoding: str
    start: int
    stop: int

    def sessions(self) -> Iterator[Session]:
        """See `Part.sessions`."""
        session = self._session(_bytes(self.file, self.start, self.stop))
        n = len(session) + len(session.unfilled)
        if n != self.n_readings:  # an empty line at the end is none, but there may be readings after this part
            raise InputError(
                "expected numbers, got an empty row, or the file has changed",
                file=self.file,
                line=self.first_number + n,
                hint="delete the row",
            )
        yield session

    def rows(self, which: IntArray) -> Session:
        """See `Part.rows`."""
        lines = _bytes(self.file, self.start, self.stop).split(b"\n")
        try:
            session = self._session(b"\n".join(lines[row] for row in which.tolist()))
        except InputError as error:
            raise self._in_line(error, which) from None
        rows = cast(IntArray, session.numbers) - self.first_number
        return replace(session, numbers=self.first_number + which[rows])

    @property
    def first_number(self) -> int:
        """See `Part.first_number`."""
        return self.form.first_line + self.n_before

    def _session(self, data: bytes) -> Session:
        first = self.first_number
        text = as_utf8(data, self.file, self.encoding)
        sheet = replace(self.form, data=text, first_line=first, data_line=first)
        return Session(**fields_of_sheet(sheet, n_joints=self.n_joints))

    def _in_line(self, error: InputError, which: IntArray) -> InputError:
        error.line = None if error.line is None else self.first_number + int(which[error.line - self.first_number])
        return error.in_file(self.file)


@dataclass(frozen=True)
class RowGroup(Part):
    """A row group of a Parquet file.

    Attributes
    ----------
    number : int
        Of the row group.
    columns : tuple of str
        Those of a session; others are not read.
    """

    number: int
    columns: tuple[str, ...]

    def sessions(self) -> Iterator[Session]:
        """See `Part.sessions`."""
        for start, batch in self._batches():
            yield self._session(batch, np.arange(start, start + batch.num_rows))

    def rows(self, which: IntArray) -> Session:
        """See `Part.rows`."""
        found = []
        for start, batch in self._batches():
            own = which[(which >= start) & (which < start + batch.num_rows)]
            if len(own):
                found.append(self._session(batch.take((own - start).tolist()), own))
        return joined_sessions(found)

    @property
    def first_number(self) -> int:
        """See `Part.first_number`."""
        return self.n_before + 1

    def _batches(self) -> Iterator[tuple[int, Any]]:
        with open_parquet(self.file) as file:
            start = 0
            for batch in file.iter_batches(MAX_READINGS, row_groups=[self.number], columns=list(self.columns)):
                yield start, batch
                start += batch.num_rows

    def _session(self, batch: Any, which: IntArray) -> Session:
        try:
            fields = fields_of_frame(batch.to_pandas(ignore_metadata=True), file=self.file, n_joints=self.n_joints)
            return Session(**fields | {"numbers": self.n_before + which + 1})
        except InputError as error:
            name, _, number = (error.row or "").partition(" ")
            if number.isdecimal() and int(number) <= len(which):  # counted from the first of these rows
                error.row = f"{name} {self.n_before + which[int(number) - 1] + 1}"
            raise error.in_file(self.file) from None


@dataclass(frozen=True, eq=False)
class Rows(Part):
    """Rows of a session in memory.

    Attributes
    ----------
    session : Session
        These rows.
    """

    session: Session

    def sessions(self) -> Iterator[Session]:
        """See `Part.sessions`."""
        yield self.session

    def rows(self, which: IntArray) -> Session:
        """See `Part.rows`."""
        return self.session.rows(which)

    @property
    def first_number(self) -> int:
        """See `Part.first_number`."""
        return int(cast(IntArray, self.session.numbers)[0])


@dataclass(frozen=True)
class LargeSession:
    """A session in one large file, in the files of a folder, in the order of their names, or in memory.

    Attributes
    ----------
    path : Path
    parts : tuple of Part
        In the order of the readings.
    columns : Columns
        Of the first file; the others have the same ones.
    executor : Executor
        Who reads the parts and computes of them.
    progress : callable or None
        Called with the number of readings done and a note.
    """

    path: Path
    parts: tuple[Part, ...]
    columns: Columns
    executor: Executor
    progress: Callable[[int, str], None] | None

    def __len__(self) -> int:
        return sum(part.n_readings for part in self.parts)

    @classmethod
    def open(
        cls,
        path: str | Path,
        *,
        n_joints: int | None = None,
        part_bytes: int = PART_BYTES,
        executor: Executor | None = None,
        progress: Callable[[int, str], None] | None = None,
    ) -> LargeSession:
        """Find the parts of a session.

        Parameters
        ----------
        path : path
            A file, or a folder: all of its files ``.csv`` and ``.parquet`` in all its folders, but hidden ones, belong
            to the session and have the same columns.
        n_joints : int, optional
            The arm's number of joints; any number by default.
        part_bytes : int
            Bytes of the lines of a part of a CSV file.
        executor : Executor, optional
            This process by default.
        progress : callable, optional

        Raises
        ------
        InputError
            If a file cannot be read, is none of a session, or has other columns than the first.
        """
        path = Path(path)
        parts: list[Part] = []
        first: tuple[Path, Columns] | None = None
        for file in session_files(path):
            check_readable(file, limit_bytes=LARGEST_BYTES)
            columns, found = _row_groups(file, n_joints) if is_parquet(file) else _lines(file, n_joints, part_bytes)
            first = first or (file, columns)
            if different := sorted(_names(columns) ^ _names(first[1])):
                raise InputError(
                    f"expected the columns of {first[0].name}, which differ in {different[0]}",
                    file=file,
                    hint="put sessions with other columns into another folder",
                )
            parts += found
        if first is None or not sum(part.n_readings for part in parts):
            raise InputError("expected at least one reading, got none", file=path)
        return cls(path, tuple(parts), first[1], executor or Serial(), progress)

    @classmethod
    def of(
        cls, session: Session, *, executor: Executor | None = None, progress: Callable[[int, str], None] | None = None
    ) -> LargeSession:
        """The parts of a session in memory, ten at least."""
        path, n = session.file or Path("session"), len(session)
        starts = range(0, n, min(MAX_READINGS, -(-n // LEAST_PARTS)))
        parts = [session.rows(np.arange(start, min(start + starts.step, n))) for start in starts]
        parts[1:] = [replace(part, unfilled=()) for part in parts[1:]]
        found = [Rows(path, len(one), start, one.n_joints, one) for start, one in zip(starts, parts, strict=True)]
        return cls(path, tuple(found), Columns(()), executor or Serial(), progress)

    def table(self, readings: Session) -> dict[str, FloatArray | NameArray]:
        """Columns of some readings in a session file: the same for all parts, those without a point among them."""
        found = session_columns(readings)
        of_points = {"{}_mm": self.columns.points, "s{}_mm": self.columns.point_std}
        names = [form.format(axis) for form, given in of_points.items() if given for axis in "xyz"]
        names += QUATERNION if self.columns.quaternion else []
        return found | {name: np.full(len(readings), np.nan) for name in names if name not in found}

    def sample(self, n: int | None = None) -> Session:
        """Up to n readings, by default `SAMPLE`, evenly spaced in their order."""
        rows = np.unique(np.linspace(0, len(self) - 1, n or SAMPLE).astype(np.intp))
        limits = pairwise(accumulate((part.n_readings for part in self.parts), initial=0))
        chosen = [
            (part, a, rows[(rows >= a) & (rows < b)] - a) for part, (a, b) in zip(self.parts, limits, strict=True)
        ]
        tasks = [(part, own) for part, _, own in chosen if len(own)]
        sessions = list(results_in_order(self.executor, _rows_of_part, tasks))
        found = replace(joined_sessions(sessions), stride=len(self) / len(rows))
        if len({part.file for part in self.parts}) == 1:
            return found
        # A line would be one of many files; a row that is not filled in is no reading.
        firsts = [start + 1 - part.first_number for part, start, own in chosen if len(own)]
        numbers = [cast(IntArray, one.numbers) + first for one, first in zip(sessions, firsts, strict=True)]
        known = {one.name: getattr(found, one.name) for one in fields(Session)}
        known |= {"numbers": np.concatenate(numbers), "by_line": False, "file": self.path}
        return _OfFiles(**known, parts=self.parts)

    def sums(self, works: Sequence[Callable[[Session, Part], S]], label: str = "") -> Iterator[S]:
        """Iterate over the sums of the parts, in the order of the parts: what follows does not depend on the engine.

        Parameters
        ----------
        works : sequence of callable
            What is computed of each part, from some consecutive readings of it and the part; it is sent to the workers.
        label : str
            With which the notes on the progress begin.
        """
        done, tasks = 0, list(zip(works, self.parts, strict=True))
        for part, sums in zip(self.parts, results_in_order(self.executor, sums_of_part, tasks), strict=True):
            yield sums
            done += part.n_readings
            if self.progress is not None:
                self.progress(done, f"{label}{done} of {len(self)} readings")


@dataclass(frozen=True, eq=False, repr=False)
class _OfFiles(Session):
    """Readings of several files, whose numbers count them through all parts; messages name the line of a file."""

    parts: tuple[Part, ...] = ()

    def called(self, row: int) -> str:
        """See `Session.called`."""
        n = int(cast(IntArray, self.numbers)[row]) - 1
        for part in self.parts:
            if n < part.n_readings:
                return f"{'line' if isinstance(part, Lines) else 'reading'} {part.first_number + n} of {part.file.name}"
            n -= part.n_readings
        raise IndexError(row)


def _rows_of_part(task: tuple[Part, IntArray]) -> Session:
    part, which = task
    return part.rows(which)


@one_blas_thread()
def sums_of_part(task: tuple[Callable[[Session, Part], S], Part]) -> S:
    """Sums over the readings of one part."""
    work, part = task
    return reduce(add, (work(readings, part) for readings in part.sessions()))


def held_out_rows(large: LargeSession, *, by: str, fraction: float, seed: int) -> Callable[[Session, int], BoolArray]:
    """A function that says which readings of a session, the first of which is number n of all, are held out.

    Parameters
    ----------
    large : LargeSession
    by : {"position", "seat", "session", "row"}
        What names the groups; ``row``: stretches of `STRETCH` consecutive readings, as neighbours are much alike.
    fraction : float
        Share of the groups to hold out.
    seed : int

    Raises
    ------
    InputError
        As `Session.split`; or if there are more than `MAX_GROUPS` groups.
    """
    if by == "row":
        n = -(-len(large) // STRETCH)
        chosen = chosen_groups(n, fraction=fraction, seed=seed, by=by, file=large.path)
        return lambda session, start: chosen[(start + np.arange(len(session))) // STRETCH]
    names: set[str] = set()
    for part in large.parts:
        for session in part.sessions():
            names.update(np.unique(group_names(session, by)).tolist())
        if len(names) > MAX_GROUPS:
            raise InputError(f"expected up to {MAX_GROUPS} names of a {by}, got more", file=large.path, hint="--by row")
    ordered = np.array(sorted(names))
    chosen = chosen_groups(len(ordered), fraction=fraction, seed=seed, by=by, file=large.path)
    return lambda session, _: chosen[np.searchsorted(ordered, group_names(session, by))]


def joined_sessions(sessions: list[Session]) -> Session:
    """The readings of sessions with the same columns, one after the other; they name the file of the first."""
    first = sessions[0]
    if len(sessions) == 1:
        return first
    joined: dict[str, Any] = {}
    for name in (field.name for field in fields(first)):
        values = [getattr(one, name) for one in sessions]
        if (known := next((value for value in values if isinstance(value, np.ndarray)), None)) is not None:
            nothing = "" if known.dtype.kind == "U" else np.nan  # where no reading of a part has a point
            joined[name] = np.concatenate(
                [
                    np.full((len(one), *known.shape[1:]), nothing) if value is None else value
                    for one, value in zip(sessions, values, strict=True)
                ]
            )
    columns = {name: np.concatenate([one.columns[name] for one in sessions]) for name in first.columns}
    unfilled = tuple(seat for one in sessions for seat in one.unfilled)
    return replace(first, **joined, columns=columns, unfilled=unfilled)


def session_files(path: Path) -> list[Path]:
    """The files of a session: the path itself, or all in a folder, in the order of their names.

    Raises
    ------
    InputError
        If a folder has none.
    """
    if not path.is_dir():
        return [path]
    found = sorted(
        file
        for file in path.rglob("*")
        if file.suffix.lower() in SUFFIXES
        and not any(part[0] in "._" for part in file.relative_to(path).parts)
        and not file.is_dir()
    )
    if not found:
        raise InputError(f"expected session files ({', '.join(SUFFIXES)}), got a folder without any", file=path)
    return found


def _lines(path: Path, n_joints: int | None, part_bytes: int) -> tuple[Columns, Sequence[Part]]:
    """Columns and parts of a CSV file."""
    size = path.stat().st_size
    head = _bytes(path, 0, HEAD_BYTES)
    if b"\n" not in head and b"\r" in head:  # read as one line, its readings would be missing
        raise InputError(
            "expected lines with the ends of Unix or Windows, got those of the old Macintosh",
            file=path,
            hint="save it as 'CSV UTF-8'",
        )
    form = form_of(head if len(head) < HEAD_BYTES else head[: head.rfind(b"\n") + 1], path)
    columns = recognise_columns(form.names, file=path, line=1, n_joints=n_joints)
    parts: list[Lines] = []
    start = 1 + head.find(b"\n")
    n_before, encoding, form = 0, "utf-8", replace(form, data=b"")
    with path.open("rb") as stream:
        while 0 < start < size:
            stream.seek(start)
            data = stream.read(part_bytes)
            data += stream.readline(HEAD_BYTES)
            end = _end_of_rows(data, form.separator) if start + len(data) >= size else len(data)
            n = data.count(b"\n", 0, end) + (not data[:end].endswith(b"\n") and end > 0)
            if n:
                parts.append(Lines(path, n, n_before, n_joints, form, "", start, start + end))
            if encoding == "utf-8" and not data.isascii():
                encoding = encoding_of_form(form.head.encode() + b"\n" + data)
            start, n_before = start + len(data), n_before + n
    return columns, [replace(part, encoding=encoding) for part in parts]


def _end_of_rows(data: bytes, separator: str) -> int:
    """Bytes without the empty rows at the end, such as ``,,,``."""
    nothing, end = b'\r\n\t "' + separator.encode(), len(data)
    while end:
        start = data.rfind(b"\n", 0, end - 1) + 1
        if data[start:end].strip(nothing):
            break
        end = start
    return end


def _row_groups(path: Path, n_joints: int | None) -> tuple[Columns, Sequence[Part]]:
    """Columns and parts of a Parquet file."""
    with open_parquet(path) as file:
        columns = recognise_columns(file.schema_arrow.names, file=path, line=None, n_joints=n_joints)
        names = (*columns.numbers, *columns.words)
        counts = [file.metadata.row_group(i).num_rows for i in range(file.metadata.num_row_groups)]
        if max(counts, default=0) * len(names) > MAX_CELLS:
            raise InputError(
                f"expected at most {MAX_CELLS // len(names)} rows in a row group, got {max(counts)}",
                file=path,
                hint="write it with row groups of a million rows or fewer",
            )
        starts = [0, *accumulate(counts)]
        parts: list[Part] = [RowGroup(path, n, starts[i], n_joints, i, names) for i, n in enumerate(counts) if n]
        return columns, parts


def _names(columns: Columns) -> set[str]:
    return {*columns.numbers, *columns.words}


def _bytes(path: Path, start: int, stop: int) -> bytes:
    try:
        with path.open("rb") as stream:
            stream.seek(start)
            return stream.read(stop - start)
    except OSError as error:
        raise access_error(path, error) from None
