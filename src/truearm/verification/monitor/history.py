"""The history of an arm's interim checks: one SQLite file, to which checks are added and from which none is taken.

Only the last one of a model may still be completed, by values that were left out of its session. A history is of one
arm; checks of other models of it are kept beside and not compared, since each model has its own errors.

The file says what it is: its application id and its version stand in its header (``PRAGMA application_id``,
``PRAGMA user_version``; https://www.sqlite.org/pragma.html). A check and its values are added in one transaction.
Version 2 added the names of models and their arms; a file of version 1 becomes one of version 2 with its next check.
"""

from __future__ import annotations

import datetime
import math
import os
import re
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import check_writable
from truearm.verification.monitor.interim import (
    CHECK_QUANTITIES,
    Assessment,
    CheckValue,
    InterimCheck,
    assess,
    describe_assessment,
    format_date,
    has_measured,
)
from truearm.verification.standards.specification import Specification

# "tArm", as the four bytes of SQLite's header have it.
APPLICATION_ID = int.from_bytes(b"tArm", "big")
VERSION = 2
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
    """CREATE TABLE models (
    model TEXT PRIMARY KEY,
    name TEXT NOT NULL,
    arm TEXT NOT NULL
)""",
)
_TABLES_OF_VERSION_1 = _TABLES[:2]
# What ANALYZE of a database's tools adds.
_STATISTICS = {
    "CREATE TABLE sqlite_stat1(tbl,idx,stat)",
    "CREATE TABLE sqlite_stat4(tbl,idx,neq,nlt,ndlt,sample)",
}
_FINGERPRINT = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True)
class OtherModel:
    """A model of which a history has checks that are not compared.

    Attributes
    ----------
    model : str
        Its fingerprint.
    name, arm : str
        Of its file and of its arm; empty where the history does not say.
    checks : tuple of InterimCheck
        One or more, in their order.
    """

    model: str
    name: str
    arm: str
    checks: tuple[InterimCheck, ...]

    def assess(self, specification: Specification | None = None, *, retired: Collection[str] = ()) -> Assessment:
        """What its charts say, as `assess`; of the artefacts that are retired, without those that it had left out."""
        gone = [
            name for name in retired if has_measured(name, self.checks) and not has_measured(name, self.checks[-1:])
        ]
        return assess(self.checks, specification, retired=gone)

    def describe(self, found: Assessment) -> str:
        """How many checks it has, and what their charts say, in words."""
        n, last = len(self.checks), self.checks[-1]
        name = self.name or f"another model (SHA-256 {self.model[:12]}..)"
        return (
            f"{n} {'check' if n == 1 else 'checks'} of {name} in this history, not compared; "
            f'the charts of the last one, of {format_date(last.date)}, say "{describe_assessment(found, self.checks)}"'
        )


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

    def checks(self, model: str) -> tuple[InterimCheck, ...]:
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
            return self._read(database, model)

    def other_models(self, model: str, *, arm: str) -> tuple[OtherModel, ...]:
        """Other models than this that the history has checks of, the one that was used last first.

        Parameters
        ----------
        model : str
            A fingerprint.
        arm : str
            Name of its arm.

        Raises
        ------
        InputError
            If all checks of the history are of models of other arms, or the file is damaged.
        """
        if not self.path.exists():
            return ()
        with self._opened() as database:
            self._check_arm(database, arm)
            return tuple(
                OtherModel(other, *self._names(database, other), self._read(database, other))
                for (other,) in database.execute(
                    "SELECT model FROM checks WHERE model != ? GROUP BY model ORDER BY max(id) DESC", (model,)
                ).fetchall()
            )

    def with_check(self, check: InterimCheck) -> tuple[InterimCheck, ...]:
        """The checks of its model as they are once a check is added; the history stays as it is.

        These are the same as before if it is there already. If it is of the same session as the last one, and has what
        that has and more, it takes its place and its date.

        Raises
        ------
        InputError
            If the check is older than the last one of its model, or is none: a name without end, a number that is not
            finite.
        """
        return self._with(self.checks(check.model), check)

    def append(self, check: InterimCheck, *, name: str = "", arm: str = "") -> bool:
        """Add a check, or complete the last one, whole or not at all: see `with_check`.

        Parameters
        ----------
        check : InterimCheck
        name, arm : str
            Of the model's file and of its arm: kept with the first check of a model. A name that cannot be printed is
            left out. With the name of an arm, the check is refused by a history of another one.

        Returns
        -------
        bool
            False if the history has this model's check of this session already; nothing is written then.

        Raises
        ------
        InputError
            As `with_check`, if the history is of another arm, or if the file cannot be written.
        """
        known = self.checks(check.model)
        if self._with(known, check) == known:
            return False
        check_writable(self.path)
        if not self.path.exists():
            self._make()
        with self._opened() as database:
            database.execute("BEGIN IMMEDIATE")
            with database:  # commits, or takes everything back
                known = self._read(database, check.model)  # another program may have added one meanwhile
                found = self._with(known, check)
                if found == known:
                    return False
                if arm:
                    self._check_arm(database, arm)
                if len(found) == len(known):
                    which = (check.model, check.session)
                    database.execute(
                        "DELETE FROM test_values WHERE check_id = "
                        "(SELECT id FROM checks WHERE model = ? AND session = ?)",
                        which,
                    )
                    database.execute("DELETE FROM checks WHERE model = ? AND session = ?", which)
                if _pragma(database, "user_version") == 1:
                    database.execute(_TABLES[-1])
                    database.execute(f"PRAGMA user_version = {VERSION}")
                names = (text if _is_name(text) else "" for text in (name, arm))
                database.execute("INSERT OR IGNORE INTO models VALUES (?, ?, ?)", (check.model, *names))
                _insert(database, found[-1])
        return True

    def _check_arm(self, database: sqlite3.Connection, arm: str) -> None:
        """Refuse an arm that the history is not of; where it does not say so of every model, it may be of that one."""
        models = database.execute("SELECT DISTINCT model FROM checks").fetchall()
        arms = {self._names(database, model)[1] for (model,) in models}
        if arms and arms.isdisjoint(("", arm)):
            raise InputError(
                f"the checks in this history are of arm {', '.join(map(repr, sorted(arms)))}, "
                f"the model is of arm {arm!r}",
                file=self.path,
                hint="the model file; or --history with another name: checks of two arms are never compared",
            )

    def _names(self, database: sqlite3.Connection, model: str) -> tuple[str, str]:
        """Names of a model's file and arm; empty where they are not known: all its checks are of version 1."""
        if _pragma(database, "user_version") == 1:
            return "", ""
        row = database.execute("SELECT name, arm FROM models WHERE model = ?", (model,)).fetchone()
        if row is None:
            return "", ""
        if not all(map(_is_name, row)):
            raise self._damaged(f"a model is not as truearm writes it: {row!r:.200}")
        return row[0], row[1]

    def _read(self, database: sqlite3.Connection, model: str) -> tuple[InterimCheck, ...]:
        rows = database.execute(
            "SELECT id, date, session, temperature_degC FROM checks WHERE model = ? ORDER BY date, id", (model,)
        ).fetchall()
        found = database.execute(
            "SELECT check_id, quantity, artefact, value_mm, u_mm, u_artefact_mm, n, length_mm FROM test_values "
            "WHERE check_id IN (SELECT id FROM checks WHERE model = ?) ORDER BY check_id, number",
            (model,),
        ).fetchall()
        values: dict[int, list[CheckValue]] = {}
        for number, *row in found:
            values.setdefault(number, []).append(CheckValue(*row))
        return tuple(self._check(row, model, tuple(values.get(row[0], ()))) for row in rows)

    def _with(self, known: tuple[InterimCheck, ...], check: InterimCheck) -> tuple[InterimCheck, ...]:
        """`known` and a check, as `with_check` has it."""
        if fault := _fault(check):
            raise InputError(f"the check cannot be kept: {fault}", file=self.path)
        for one in known:
            if one.session == check.session:
                before, now = ({value.key for value in each.values} for each in (one, check))
                # A length that can now be corrected to 20 degC is more than it was.
                names_before, names_now = ({key[:2] for key in keys} for keys in (before, now))
                if one is known[-1] and names_before <= names_now and before != now:
                    return (*known[:-1], replace(check, date=one.date))
                return known
        if known and check.date < known[-1].date:
            raise InputError(
                f"the check is of {format_date(check.date)}, before the last one of {format_date(known[-1].date)}",
                file=self.path,
                hint="add checks in the order in which they were made, with --date",
            )
        return (*known, check)

    def _make(self) -> None:
        """Make the file, without checks; if another program has made it meanwhile, that one stays."""
        target = Path(os.path.realpath(self.path))
        try:
            with tempfile.TemporaryDirectory(prefix=".history-", dir=target.parent) as folder:
                made = Path(folder) / target.name
                _create(made)
                try:
                    os.link(made, target)
                except FileExistsError:
                    pass
                except OSError:  # a file system without links
                    with suppress(FileExistsError), target.open("xb") as file:
                        file.write(made.read_bytes())
        except (OSError, sqlite3.Error) as error:
            why = getattr(error, "strerror", None) or error
            raise TruearmError(
                f"{self.path}: the history cannot be made: no file can be written in the folder {target.parent} ({why})"
            ) from error

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
                database.text_factory = bytes.decode  # its own calls it an operational error where text is no UTF-8
                database.execute("PRAGMA trusted_schema = OFF")
                self._check_header(database)
                yield database
        except sqlite3.OperationalError as error:
            raise TruearmError(f"{self.path}: the history cannot be read or written ({error})") from error
        except sqlite3.DatabaseError as error:
            raise self._damaged(str(error)) from None
        except UnicodeDecodeError:  # also of SQLite's messages, which quote the file
            raise self._damaged("text that is no UTF-8") from None

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
        if version < 1 or made - _STATISTICS != set(_TABLES_OF_VERSION_1 if version == 1 else _TABLES):
            raise self._damaged("its tables are not those of a history")
        sound = _pragma(database, "quick_check(1)")
        if sound != "ok":
            raise self._damaged(str(sound))

    def _check(self, row: Any, model: str, values: tuple[CheckValue, ...]) -> InterimCheck:
        _, date, session, degC = row
        try:
            day = datetime.datetime.fromisoformat(date)
        except (TypeError, ValueError):
            raise self._damaged(f"expected a date, got {date!r:.80}") from None
        prints = all(isinstance(one, str) and _FINGERPRINT.fullmatch(one) for one in (model, session))
        if day.tzinfo is not None or not prints:
            raise self._damaged(f"the check of {date!r:.80} is not as truearm writes it")
        found = InterimCheck(day, model, session, degC, values)
        if fault := _fault(found):
            raise self._damaged(fault)
        return found

    def _foreign(self, what: str) -> InputError:
        return InputError(
            f"expected a history of checks, got {what}", file=self.path, hint="another name: the first check makes it"
        )

    def _damaged(self, why: str) -> InputError:
        return InputError(f"the history is damaged ({why})", file=self.path, hint="a copy of it that is whole")


def _fault(check: InterimCheck) -> str:
    """What keeps a check from being one, as it is to be written or was read; empty if nothing does."""
    if check.temperature_degC is not None and not _is_number(check.temperature_degC):
        return f"expected a temperature, got {check.temperature_degC!r:.80}"
    if not check.values:
        return f"the check of {format_date(check.date)} has no values"
    for one in check.values:
        if one.quantity not in CHECK_QUANTITIES or not isinstance(one.artefact, str) or len(one.artefact) > MOST_NAME:
            return f"a value is not as truearm writes it: {one!r:.200}"
        numbers = (one.value_mm, one.u_mm, one.u_artefact_mm, *(() if one.length_mm is None else (one.length_mm,)))
        if not all(map(_is_number, numbers)) or type(one.n) is not int:
            return f"a value is not as truearm writes it: {one!r:.200}"
        if (
            one.n < 1
            or min(one.u_mm, one.u_artefact_mm) < 0
            or (CHECK_QUANTITIES[one.quantity].scale and one.value_mm < 0)
        ):
            return f"a value cannot be: {one!r:.200}"
    names = [(one.quantity, one.artefact) for one in check.values]
    return "" if len(set(names)) == len(names) else "it has a value twice"


def _insert(database: sqlite3.Connection, check: InterimCheck) -> None:
    added = database.execute(
        "INSERT INTO checks (date, model, session, temperature_degC) VALUES (?, ?, ?, ?)",
        (check.date.isoformat(sep=" "), check.model, check.session, check.temperature_degC),
    )
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


def _create(path: Path) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        for table in _TABLES:
            database.execute(table)


def _pragma(database: sqlite3.Connection, name: str) -> Any:
    return database.execute(f"PRAGMA {name}").fetchone()[0]


def _is_name(value: object) -> bool:
    return isinstance(value, str) and len(value) <= MOST_NAME and value.isprintable()


def _is_number(value: object) -> bool:
    return isinstance(value, float | int) and math.isfinite(value)
