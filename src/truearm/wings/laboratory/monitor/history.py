"""The history of an arm's interim checks: rows that are only added, with a chain of checksums, in a file or elsewhere.

Each row stores one check as JSON text, with the SHA-256 checksum of the row before and of that text. Reading verifies
the whole chain, so that no stored value changes by accident and unnoticed, and the number of rows and the last checksum
beside it, so that no last row disappears by accident and unnoticed. Neither has a key: who changes a history on purpose
can calculate both again, and only a copy elsewhere shows it. A row that repeats the session of an earlier one completes
it; a row that names an earlier one withdraws its check, with the reason.

A history belongs to one arm. Checks of other models of that arm are stored too and not compared, since each model has
its own errors.

In a file it is append-only SQLite. The file identifies itself by its application id and version (``PRAGMA
application_id``, ``PRAGMA user_version``; https://www.sqlite.org/pragma.html). The table `head` has the number of rows
and the last checksum. SQLite adds a row whole or not at all, also when the program is killed, and creates no file but
its journal, which the next program that opens the history removes.
"""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import check_writable
from truearm.files.dates import format_date
from truearm.files.file_reading import access_error, check_readable
from truearm.wings.laboratory.monitor.assessment import Assessment, assess, describe_assessment, is_measured
from truearm.wings.laboratory.monitor.history_rows import (
    CheckRow,
    HistoryRows,
    checksum_of_new,
    encode_check,
    encode_withdrawal,
    is_name,
    linked_rows,
)
from truearm.wings.laboratory.monitor.interim_check import InterimCheck, Withdrawal, counted
from truearm.wings.laboratory.standards.specification import Specification

# "tArm", as the four bytes of SQLite's header have it.
APPLICATION_ID = int.from_bytes(b"tArm", "big")
VERSION = 2
# A check takes some six kilobytes: room for ten years with a check every two hours.
MAX_BYTES = 256 * 2**20

_TABLE = "CREATE TABLE checks (id INTEGER PRIMARY KEY, record TEXT NOT NULL, sha256 TEXT NOT NULL)"
_HEAD = "CREATE TABLE head (id INTEGER PRIMARY KEY CHECK (id = 1), rows INTEGER NOT NULL, sha256 TEXT NOT NULL)"
# Tables that ANALYZE, run by a database tool, adds.
_STATISTICS = {"CREATE TABLE sqlite_stat1(tbl,idx,stat)", "CREATE TABLE sqlite_stat4(tbl,idx,neq,nlt,ndlt,sample)"}


class HistoryFile:
    """The rows of a history in a file.

    Parameters
    ----------
    path : path
        The first row creates it.

    Raises
    ------
    InputError
        If the file is not a history, is damaged, or has another version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.exists():
            self.read()
        else:
            check_writable(self.path)

    @property
    def name(self) -> str:
        """See `HistoryStore`."""
        return self.path.name

    @property
    def files(self) -> tuple[Path, ...]:
        """See `HistoryStore`."""
        return (self.path,)

    @property
    def serial_number(self) -> str:
        """See `HistoryStore`."""
        return ""

    def error(self, problem: str, hint: str | None = None) -> InputError:
        """See `HistoryStore`."""
        return InputError(problem, file=self.path, hint=hint)

    def read(self) -> HistoryRows:
        """See `HistoryStore`."""
        if not self.path.exists():
            return HistoryRows(())
        check_readable(self.path, limit_bytes=sys.maxsize)
        size = self.path.stat().st_size
        if size > MAX_BYTES:
            raise self._foreign(f"a file of {size >> 20} MiB, larger than a history can be")
        if not Path(f"{self.path}-journal").exists():  # else SQLite first restores the file from that
            try:
                with self.path.open("rb") as file:
                    header = file.read(16)
            except OSError as error:
                raise access_error(self.path, error) from None
            if header not in (b"", b"SQLite format 3\0"):
                raise self._foreign("something else")
        with self._opened("rw") as database:
            return self._read(database)

    def add(self, row: Callable[[HistoryRows], str | None]) -> bool:
        """See `HistoryStore`."""
        check_writable(self.path)
        with self._opened("rwc") as database:
            database.execute("BEGIN IMMEDIATE")
            with database:  # commits, or takes everything back
                _create_tables(database)
                rows = self._read(database)
                text = row(rows)
                if text is not None:
                    _insert(database, text, rows)
        return text is not None

    @contextmanager
    def _opened(self, mode: str) -> Iterator[sqlite3.Connection]:
        """A connection; `mode` is that of SQLite's URIs, "rw" or "rwc" to create the file."""
        try:
            where = f"{self.path.resolve().as_uri()}?mode={mode}"
            with closing(sqlite3.connect(where, uri=True, isolation_level=None)) as database:
                database.text_factory = bytes.decode  # the default calls text that is not UTF-8 an operational error
                database.execute("PRAGMA trusted_schema = OFF")
                yield database
        except sqlite3.OperationalError as error:
            raise TruearmError(f"{self.path}: the history cannot be read or written ({error})") from error
        except sqlite3.DatabaseError as error:
            raise self._damaged(str(error)) from None
        except UnicodeDecodeError:  # also in SQLite's messages, which quote the file
            raise self._damaged("text that is not UTF-8") from None

    def _read(self, database: sqlite3.Connection) -> HistoryRows:
        """All rows; refuses anything but an undamaged history."""
        # SQLite would execute triggers and views of the file along with our statements.
        made = {row[0] for row in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")}
        identity, version = (_pragma(database, name) for name in ("application_id", "user_version"))
        if not made and identity == version == 0:
            return HistoryRows(())  # an empty file, left by a program that was stopped before its first check
        if identity != APPLICATION_ID:
            raise self._foreign("an SQLite file of another program")
        if version > VERSION:
            problem = f"expected a history of version {VERSION}, got version {version}"
            raise self.error(problem, "update truearm to read it")
        if 0 < version < VERSION:
            raise self.error(
                f"expected a history of version {VERSION}, got version {version}, which was never released and is no "
                "longer read",
                "keep the file, and name a new file to start a new history",
            )
        if version != VERSION or made - _STATISTICS != {_TABLE, _HEAD}:
            raise self._damaged("its tables are not those of a history")
        if (state := _pragma(database, "quick_check(1)")) != "ok":
            raise self._damaged(str(state))
        stored = database.execute("SELECT id, record, sha256 FROM checks ORDER BY id").fetchall()
        head = database.execute("SELECT rows, sha256 FROM head").fetchall()
        try:
            return linked_rows(stored, head)
        except ValueError as error:
            raise self._damaged(str(error)) from None

    def _foreign(self, what: str) -> InputError:
        hint = "name another file: the first check creates it"
        return self.error(f"expected a history of checks, got {what}", hint)

    def _damaged(self, why: str) -> InputError:
        hint = "restore the file from a backup, or name a new file to start a new history"
        return self.error(f"the history is damaged ({why})", hint)


def _insert(database: sqlite3.Connection, text: str, before: HistoryRows) -> None:
    checksum = checksum_of_new(text, before)
    database.execute("INSERT INTO checks (record, sha256) VALUES (?, ?)", (text, checksum))
    database.execute("INSERT OR REPLACE INTO head VALUES (1, ?, ?)", (len(before.rows) + 1, checksum))


def _create_tables(database: sqlite3.Connection) -> None:
    """Create the tables in an empty file, within the transaction of its first row."""
    if _pragma(database, "application_id") == _pragma(database, "schema_version") == 0:
        for statement in (_TABLE, _HEAD, "INSERT INTO head VALUES (1, 0, '')"):
            database.execute(statement)
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")


def _pragma(database: sqlite3.Connection, name: str) -> Any:
    return database.execute(f"PRAGMA {name}").fetchone()[0]


class HistoryStore(Protocol):
    """Where the rows of a history are."""

    @property
    def name(self) -> str:
        """What a page calls it."""
        ...

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that it writes, over which no page is written."""
        ...

    @property
    def serial_number(self) -> str:
        """Of the arm whose history it is; empty if the rows alone say."""
        ...

    def read(self) -> HistoryRows:
        """All rows.

        Raises
        ------
        InputError
            If they are damaged.
        """
        ...

    def add(self, row: Callable[[HistoryRows], str | None]) -> bool:
        """Add a row in one transaction, whole or not at all.

        Parameters
        ----------
        row : callable
            Makes the text of the row from all rows before, to which another program may have added some; None: none.

        Returns
        -------
        bool
            Whether there was a row to add.
        """
        ...

    def error(self, problem: str, hint: str | None = None) -> InputError:
        """An error of this history."""
        ...


@dataclass(frozen=True)
class OtherModel:
    """A model with checks in a history that are not compared.

    Attributes
    ----------
    model : str
        Its fingerprint.
    name, arm : str
        Names of its file and of its arm; empty where the history does not contain them.
    checks : tuple of InterimCheck
        One or more, in the order of their dates.
    """

    model: str
    name: str
    arm: str
    checks: tuple[InterimCheck, ...]

    @property
    def last(self) -> InterimCheck:
        """The last check that counts."""
        return counted(self.checks)[-1]

    def assess(self, specification: Specification | None = None, *, retired: Collection[str] = ()) -> Assessment:
        """Assess its checks; of the retired artefacts, those are ignored that its last check no longer contains."""
        ignored = [
            name for name in retired if is_measured(name, counted(self.checks)) and not is_measured(name, [self.last])
        ]
        return assess(self.checks, specification, retired=ignored)

    def describe(self, assessment: Assessment) -> str:
        """The number of its checks and the result of the last one, in one sentence."""
        n, last = len(counted(self.checks)), self.last
        name = self.name or f"another model (SHA-256 {self.model[:12]}..)"
        return (
            f"{n} {'check' if n == 1 else 'checks'} of {name} in this history, not compared; result of the last one, "
            f'{format_date(last.date)}: "{describe_assessment(assessment, self.checks)}"'
        )


class History:
    """A history on disk, or elsewhere.

    Parameters
    ----------
    where : path or HistoryStore
        A file, which the first check creates; or another place.

    Raises
    ------
    InputError
        If the file is not a history, is damaged, or has another version.
    """

    def __init__(self, where: str | Path | HistoryStore) -> None:
        self.store: HistoryStore = HistoryFile(where) if isinstance(where, str | Path) else where

    def checks(self, model: str) -> tuple[InterimCheck, ...]:
        """Return the checks of a model in the order of their dates, with those that were withdrawn.

        Parameters
        ----------
        model : str
            Its fingerprint.

        Raises
        ------
        InputError
            If the file is damaged.
        """
        return self.store.read().checks_of(model)

    def models(self) -> tuple[str, ...]:
        """The fingerprints of the models with checks, the last used one first."""
        return tuple(dict.fromkeys(one.check.model for one in reversed(self.store.read().check_rows)))

    @property
    def head(self) -> tuple[int, str]:
        """The number of rows and the last checksum: a copy that lacks the last checks has others."""
        contents = self.store.read()
        return len(contents.rows), contents.checksum

    def other_models(self, model: str, *, arm: str, serial_number: str = "") -> tuple[OtherModel, ...]:
        """Return the other models with checks in the history, the last used one first.

        Parameters
        ----------
        model : str
            A fingerprint.
        arm, serial_number : str
            Name and serial number of its arm.

        Raises
        ------
        InputError
            If all checks of the history belong to models of other arms, or the file is damaged.
        """
        contents = self.store.read()
        self._check_arm(contents.check_rows, arm, serial_number)
        first = {one.check.model: one for one in reversed(contents.check_rows)}
        last_used = dict.fromkeys(one.check.model for one in reversed(contents.check_rows) if one.check.model != model)
        return tuple(
            OtherModel(other, first[other].name, first[other].arm, checks)
            for other in last_used
            if counted(checks := contents.checks_of(other))
        )

    def with_check(self, check: InterimCheck) -> tuple[InterimCheck, ...]:
        """Return the checks of a model with one more; the file does not change.

        They are the same if the check is in the history already. If it has the session of the last one and more values
        than that, it replaces the last one and keeps its date. Withdrawn checks do not count.

        Raises
        ------
        InputError
            If the check is older than the last one of its model, or cannot be stored.
        """
        return self._with(self.checks(check.model), check)

    def append(self, check: InterimCheck, *, name: str = "", arm: str = "", serial_number: str = "") -> bool:
        """Add a check, or complete the last one, whole or not at all: see `with_check`.

        Parameters
        ----------
        check : InterimCheck
        name, arm : str
            Names of the model's file and of its arm; those of a model's first check count. A name that cannot be
            printed is stored as an empty one. With the name of an arm, a history of another arm refuses the check.
        serial_number : str
            Of the arm; a history with another serial number refuses the check.

        Returns
        -------
        bool
            False if the history contains this check already; nothing is written then.

        Raises
        ------
        InputError
            As `with_check`; if the history belongs to another arm, or the file cannot be written.
        """
        known = self.checks(check.model)
        if self._with(known, check) == known:
            return False

        def row(contents: HistoryRows) -> str | None:
            known = contents.checks_of(check.model)
            checks = self._with(known, check)
            if checks == known:
                return None
            if arm:
                self._check_arm(contents.check_rows, arm, serial_number)
            stated = (text if is_name(text) else "" for text in (name, arm, serial_number))
            (new,) = [one for one in checks if one not in known]
            return encode_check(CheckRow(new, *stated))

        return self.store.add(row)

    def withdraw(self, check: InterimCheck, withdrawal: Withdrawal) -> None:
        """Withdraw a check: it stays in the file with the reason, and no longer counts.

        Parameters
        ----------
        check : InterimCheck
            One of `checks` that counts.
        withdrawal : Withdrawal

        Raises
        ------
        InputError
            If the history does not have the check, or it is withdrawn already; if the file cannot be written.
        """

        def row(contents: HistoryRows) -> str:
            if check not in counted(contents.checks_of(check.model)):
                raise self.store.error(
                    f"the check of {format_date(check.date)} is withdrawn already, or not in this history"
                )
            return encode_withdrawal(contents.row_of(check), withdrawal)

        self.store.add(row)

    def _with(self, known: tuple[InterimCheck, ...], check: InterimCheck) -> tuple[InterimCheck, ...]:
        """`known` and a check, see `with_check`."""
        counting = counted(known)
        for one in counting:
            if one.has_session_of(check):
                before, now = ({value.key for value in each.values} for each in (one, check))
                # A length that can now be corrected to 20 degC is more than before.
                names_before, names_now = ({key[:2] for key in keys} for keys in (before, now))
                if one is counting[-1] and names_before <= names_now and before != now:
                    completed = replace(check, date=one.date, session=one.session)
                    return tuple(completed if each is one else each for each in known)
                return known
        if counting and check.date < counting[-1].date:
            raise self.store.error(
                f"the check is of {format_date(check.date)}, before the last one of {format_date(counting[-1].date)}",
                hint="add checks in the order of their dates; --date states the date of a check, and --withdraw "
                "withdraws one with a wrong date",
            )
        return (*known, check)

    def _check_arm(self, records: Sequence[CheckRow], arm: str, serial_number: str) -> None:
        """Refuse another arm; a model without the name of an arm may belong to any, and so may one without a number."""
        numbers = {self.store.serial_number, *(one.serial_number for one in records)} - {""}
        if serial_number and numbers and serial_number not in numbers:
            raise self.store.error(
                f"the checks in this history are of serial number {', '.join(map(repr, sorted(numbers)))}, "
                f"the model is of {serial_number!r}",
                hint="check the model file, or name another history: checks of two arms are never compared",
            )
        first = {one.check.model: one.arm for one in reversed(records)}
        arms = set(first.values())
        if arms and arms.isdisjoint(("", arm)):
            raise self.store.error(
                f"the checks in this history are of arm {', '.join(map(repr, sorted(arms)))}, "
                f"the model is of arm {arm!r}",
                hint="check the model file, or name another history: checks of two arms are never compared",
            )


def existing_history(path: Path) -> History:
    """The history in a file that exists: a withdrawal creates none."""
    check_readable(path, limit_bytes=MAX_BYTES, hint="name the file of the checks with --history")
    return History(path)


def number_of_check(which: str, checks: Sequence[InterimCheck], store: HistoryStore) -> int:
    """The number, counted from 1, of the check that counts and has this number or date.

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    counting = {i: one for i, one in enumerate(checks, start=1) if one.withdrawn is None}
    listed = [f"{i} of {format_date(one.date)}" for i, one in counting.items()]
    hint = f"use one of {', '.join(listed[-8:])}" if listed else "check the model file: each model has its own checks"
    if which.isdecimal():
        found = [int(which)] if int(which) in counting else []
    else:
        found = [
            i for i, one in counting.items() if which.replace("T", " ") in (format_date(one.date), f"{one.date.date()}")
        ]
    if len(found) != 1:
        what = "no check that counts has" if not found else f"checks {', '.join(map(str, found))} have"
        raise store.error(f"{what} the number or date {which!r:.40}", hint)
    return found[0]
