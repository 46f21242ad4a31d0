"""A history of interim checks as a file: append-only SQLite.

The file identifies itself by its application id and version (``PRAGMA application_id``, ``PRAGMA user_version``;
https://www.sqlite.org/pragma.html). The table `head` has the number of rows and the last checksum. SQLite adds a row
whole or not at all, also when the program is killed, and creates no file but its journal, which the next program that
opens the history removes.
"""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import check_writable
from truearm.files.file_reading import access_error, check_readable
from truearm.verification.monitor.history_rows import HistoryRows, checksum_of_new, linked_rows

# "tArm", as the four bytes of SQLite's header have it.
APPLICATION_ID = int.from_bytes(b"tArm", "big")
VERSION = 2
# A check takes some six kilobytes: room for ten years with a check every two hours.
MAX_BYTES = 256 * 2**20

_TABLE = "CREATE TABLE checks (id INTEGER PRIMARY KEY, record TEXT NOT NULL, sha256 TEXT NOT NULL)"
_HEAD = "CREATE TABLE head (id INTEGER PRIMARY KEY CHECK (id = 1), rows INTEGER NOT NULL, sha256 TEXT NOT NULL)"
# Tables that ANALYZE, run by a database tool, adds.
_STATISTICS = {
    "CREATE TABLE sqlite_stat1(tbl,idx,stat)",
    "CREATE TABLE sqlite_stat4(tbl,idx,neq,nlt,ndlt,sample)",
}


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
            raise InputError(
                f"expected a history of version {VERSION}, got version {version}",
                file=self.path,
                hint="update truearm to read it",
            )
        if 0 < version < VERSION:
            raise InputError(
                f"expected a history of version {VERSION}, got version {version}, which was never released and is no "
                "longer read",
                file=self.path,
                hint="keep the file, and name a new file to start a new history",
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
        return InputError(
            f"expected a history of checks, got {what}",
            file=self.path,
            hint="name another file: the first check creates it",
        )

    def _damaged(self, why: str) -> InputError:
        return InputError(
            f"the history is damaged ({why})",
            file=self.path,
            hint="restore the file from a backup, or name a new file to start a new history",
        )


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
