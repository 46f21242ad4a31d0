"""The history of an arm's interim checks: one SQLite file, to which checks are added and from which none is taken.

The file says what it is: its application id and its version stand in its header (``PRAGMA application_id``,
``PRAGMA user_version``; https://www.sqlite.org/pragma.html). A check and its values are added in one transaction.
"""

from __future__ import annotations

import datetime
import math
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from truearm.errors import InputError, TruearmError
from truearm.verify.interim import QUANTITIES, Check, Value, told
from truearm.writing import check_writable, whole_file

# "tArm", as the four bytes of SQLite's header have it.
APPLICATION_ID = int.from_bytes(b"tArm", "big")
VERSION = 1
# A check has some ten values of a hundred bytes: room for ten years of a check an hour.
MAX_BYTES = 256 * 2**20
MOST_NAME = 1000

_TABLES = (
    """CREATE TABLE checks (
    id INTEGER PRIMARY KEY,
    date TEXT NOT NULL,
    model TEXT NOT NULL,
    session TEXT NOT NULL,
    temperature_degC REAL,
    UNIQUE (model, session)
)""",
    """CREATE TABLE test_values (
    check_id INTEGER NOT NULL REFERENCES checks (id),
    number INTEGER NOT NULL,
    quantity TEXT NOT NULL,
    artefact TEXT NOT NULL,
    value_mm REAL NOT NULL,
    u_mm REAL NOT NULL,
    u_artefact_mm REAL NOT NULL,
    n INTEGER NOT NULL,
    length_mm REAL,
    PRIMARY KEY (check_id, number),
    UNIQUE (check_id, quantity, artefact)
)""",
)
_FINGERPRINT = re.compile("[0-9a-f]{64}")


class History:
    """A history on disk.

    Parameters
    ----------
    path : path
        The file; it is made by the first check that is added.

    Raises
    ------
    InputError
        If there is something that is no history, a damaged one, or one of a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.exists():
            self._check_size()
            with self._opened():
                pass
        else:
            check_writable(self.path)

    def checks(self, model: str) -> tuple[Check, ...]:
        """The checks of a model, in the order of their dates, and as they were added where these are the same.

        Parameters
        ----------
        model : str
            Its fingerprint.

        Raises
        ------
        InputError
            If the file is damaged.
        """
        if not self.path.exists():
            return ()
        with self._opened() as database:
            rows = database.execute(
                "SELECT id, date, session, temperature_degC FROM checks WHERE model = ? ORDER BY date, id", (model,)
            ).fetchall()
            found = database.execute(
                "SELECT check_id, quantity, artefact, value_mm, u_mm, u_artefact_mm, n, length_mm FROM test_values "
                "WHERE check_id IN (SELECT id FROM checks WHERE model = ?) ORDER BY check_id, number",
                (model,),
            ).fetchall()
        values: dict[int, list[Value]] = {}
        for number, *row in found:
            values.setdefault(number, []).append(self._value(row))
        return tuple(self._check(row, model, tuple(values.get(row[0], ()))) for row in rows)

    def append(self, check: Check) -> bool:
        """Add a check, whole or not at all.

        Returns
        -------
        bool
            False if the history has this model's check of this session already; nothing is added then.

        Raises
        ------
        InputError
            If the check is older than the last one of its model, or cannot be written.
        """
        known = self.checks(check.model)
        if any(one.session == check.session for one in known):
            return False
        if known and check.date < known[-1].date:
            raise InputError(
                f"the check is of {told(check.date)}, before the last one of {told(known[-1].date)}",
                file=self.path,
                hint="add checks in the order in which they were made, with --date",
            )
        if not self.path.exists():
            with whole_file(self.path) as beside:
                _create(beside)
        check_writable(self.path)
        with self._opened() as database:
            database.execute("BEGIN IMMEDIATE")
            with database:  # commits, or takes everything back
                added = database.execute(
                    "INSERT OR IGNORE INTO checks (date, model, session, temperature_degC) VALUES (?, ?, ?, ?)",
                    (check.date.isoformat(sep=" "), check.model, check.session, check.temperature_degC),
                )
                if not added.rowcount:  # by another program meanwhile
                    return False
                database.executemany(
                    "INSERT INTO test_values VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    [
                        (
                            added.lastrowid,
                            number,
                            one.quantity,
                            one.artefact,
                            float(one.value_mm),
                            float(one.u_mm),
                            float(one.u_artefact_mm),
                            int(one.n),
                            one.length_mm,
                        )
                        for number, one in enumerate(check.values)
                    ],
                )
        return True

    def _check_size(self) -> None:
        if self.path.is_dir():
            raise InputError("expected a history, got a folder", file=self.path)
        size = self.path.stat().st_size
        if size > MAX_BYTES:
            raise self._foreign(f"a file of {size >> 20} MiB, larger than one can be")
        with self.path.open("rb") as file:
            if file.read(16) != b"SQLite format 3\0":
                raise self._foreign("an empty file" if not size else "something else")

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        """A connection to the file, checked to be a history of a version that is known, and sound."""
        try:
            # mode=rw: a file that is gone meanwhile is not made anew, empty.
            where = f"{self.path.resolve().as_uri()}?mode=rw"
            with closing(sqlite3.connect(where, uri=True, isolation_level=None)) as database:
                database.execute("PRAGMA trusted_schema = OFF")
                self._check_header(database)
                yield database
        except sqlite3.OperationalError as error:
            raise TruearmError(f"{self.path}: the history cannot be read or written ({error})") from error
        except sqlite3.DatabaseError as error:
            raise self._damaged(str(error)) from None

    def _check_header(self, database: sqlite3.Connection) -> None:
        identity, version = (_pragma(database, name) for name in ("application_id", "user_version"))
        if identity != APPLICATION_ID:
            raise self._foreign("another program's SQLite file")
        if version > VERSION:
            raise InputError(
                f"expected a history of version {VERSION} or older, got version {version}",
                file=self.path,
                hint="update truearm to read it",
            )
        # Statements that the file brings along (triggers, views) would be run with ours.
        made = {row[0] for row in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")}
        if version != VERSION or made != set(_TABLES):
            raise self._damaged("its tables are not those of a history")
        sound = _pragma(database, "quick_check(1)")
        if sound != "ok":
            raise self._damaged(str(sound))

    def _check(self, row: Any, model: str, values: tuple[Value, ...]) -> Check:
        _, date, session, degC = row
        try:
            day = datetime.datetime.fromisoformat(date)
        except (TypeError, ValueError):
            raise self._damaged(f"expected a date, got {date!r:.80}") from None
        if day.tzinfo is not None or not isinstance(session, str) or not _FINGERPRINT.fullmatch(session):
            raise self._damaged(f"the check of {date!r:.80} is not as truearm writes it")
        if degC is not None and not _is_number(degC):
            raise self._damaged(f"expected a temperature, got {degC!r:.80}")
        if not values:
            raise self._damaged(f"the check of {date} has no values")
        return Check(day, model, session, degC, values)

    def _value(self, row: list[Any]) -> Value:
        quantity, artefact, value, u, u_artefact, n, length = row
        named = quantity in QUANTITIES and isinstance(artefact, str) and len(artefact) <= MOST_NAME
        numbers = all(map(_is_number, (value, u, u_artefact))) and (length is None or _is_number(length))
        if not named or not numbers or type(n) is not int:
            raise self._damaged(f"a value is not as truearm writes it: {row!r:.200}")
        if n < 1 or min(u, u_artefact) < 0 or (QUANTITIES[quantity].scale and value < 0):
            raise self._damaged(f"a value cannot be: {row!r:.200}")
        return Value(quantity, artefact, value, u, u_artefact, n, length)

    def _foreign(self, what: str) -> InputError:
        return InputError(
            f"expected a history of checks, got {what}", file=self.path, hint="another name: the first check makes it"
        )

    def _damaged(self, why: str) -> InputError:
        return InputError(f"the history is damaged ({why})", file=self.path, hint="a copy of it that is whole")


def _create(path: Path) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        for table in _TABLES:
            database.execute(table)


def _pragma(database: sqlite3.Connection, name: str) -> Any:
    return database.execute(f"PRAGMA {name}").fetchone()[0]


def _is_number(value: object) -> bool:
    return isinstance(value, float | int) and math.isfinite(value)
