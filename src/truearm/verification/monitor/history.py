"""The history of an arm's interim checks: an append-only SQLite file with a chain of checksums.

Each row of the table `checks` stores one check as JSON text, with the SHA-256 checksum of the row before and of that
text. Reading verifies the whole chain, so that no stored value can change unnoticed. A row that repeats the session of
an earlier one completes it. The file identifies itself by its application id and version (``PRAGMA application_id``,
``PRAGMA user_version``; https://www.sqlite.org/pragma.html). SQLite adds a row whole or not at all, also when the
program is killed, and creates no file but its journal, which the next program that opens the history removes.

A history belongs to one arm. Checks of other models of that arm are stored too and not compared, since each model has
its own errors.
"""

from __future__ import annotations

import datetime
import json
import re
import sqlite3
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import check_writable
from truearm.files.file_reading import access_error, check_readable
from truearm.verification.monitor.assessment import Assessment, assess, describe_assessment, is_measured
from truearm.verification.monitor.interim_check import CheckValue, InterimCheck
from truearm.verification.standards.dates import format_date
from truearm.verification.standards.specification import Specification

# "tArm", as the four bytes of SQLite's header have it.
APPLICATION_ID = int.from_bytes(b"tArm", "big")
VERSION = 1
# A check takes some two kilobytes: room for ten years with a check an hour.
MAX_BYTES = 256 * 2**20
MOST_NAME = 1000

_TABLE = "CREATE TABLE checks (id INTEGER PRIMARY KEY, record TEXT NOT NULL, sha256 TEXT NOT NULL)"
# Tables that ANALYZE, run by a database tool, adds.
_STATISTICS = {
    "CREATE TABLE sqlite_stat1(tbl,idx,stat)",
    "CREATE TABLE sqlite_stat4(tbl,idx,neq,nlt,ndlt,sample)",
}
_FINGERPRINT = re.compile("[0-9a-f]{64}")


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

    def assess(self, specification: Specification | None = None, *, retired: Collection[str] = ()) -> Assessment:
        """Assess its checks; of the retired artefacts, those are ignored that its last check no longer contains."""
        ignored = [
            name for name in retired if is_measured(name, self.checks) and not is_measured(name, self.checks[-1:])
        ]
        return assess(self.checks, specification, retired=ignored)

    def describe(self, assessment: Assessment) -> str:
        """The number of its checks and the result of the last one, in one sentence."""
        n, last = len(self.checks), self.checks[-1]
        name = self.name or f"another model (SHA-256 {self.model[:12]}..)"
        return (
            f"{n} {'check' if n == 1 else 'checks'} of {name} in this history, not compared; result of the last one, "
            f'{format_date(last.date)}: "{describe_assessment(assessment, self.checks)}"'
        )


@dataclass(frozen=True)
class _Record:
    """A row of the file."""

    check: InterimCheck
    name: str
    arm: str


class History:
    """A history on disk.

    Parameters
    ----------
    path : path
        The file; the first check creates it.

    Raises
    ------
    InputError
        If the file is not a history, is damaged, or has a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.exists():
            self._records()
        else:
            check_writable(self.path)

    def checks(self, model: str) -> tuple[InterimCheck, ...]:
        """Return the checks of a model in the order of their dates; of the same date, in the order of addition.

        Parameters
        ----------
        model : str
            Its fingerprint.

        Raises
        ------
        InputError
            If the file is damaged.
        """
        return _checks_of(model, self._records())

    def other_models(self, model: str, *, arm: str) -> tuple[OtherModel, ...]:
        """Return the other models with checks in the history, the last used one first.

        Parameters
        ----------
        model : str
            A fingerprint.
        arm : str
            Name of its arm.

        Raises
        ------
        InputError
            If all checks of the history belong to models of other arms, or the file is damaged.
        """
        records = self._records()
        self._check_arm(records, arm)
        first = {one.check.model: one for one in reversed(records)}
        last_used = dict.fromkeys(one.check.model for one in reversed(records) if one.check.model != model)
        return tuple(
            OtherModel(other, first[other].name, first[other].arm, _checks_of(other, records)) for other in last_used
        )

    def with_check(self, check: InterimCheck) -> tuple[InterimCheck, ...]:
        """Return the checks of a model with one more; the file does not change.

        They are the same if the check is in the history already. If it has the session of the last one and more values
        than that, it replaces the last one and keeps its date.

        Raises
        ------
        InputError
            If the check is older than the last one of its model, or cannot be stored.
        """
        return self._with(self.checks(check.model), check)

    def append(self, check: InterimCheck, *, name: str = "", arm: str = "") -> bool:
        """Add a check, or complete the last one, whole or not at all: see `with_check`.

        Parameters
        ----------
        check : InterimCheck
        name, arm : str
            Names of the model's file and of its arm; those of a model's first check count. A name that cannot be
            printed is stored as an empty one. With the name of an arm, a history of another arm refuses the check.

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
        check_writable(self.path)
        with self._opened("rwc") as database:
            database.execute("BEGIN IMMEDIATE")
            with database:  # commits, or takes everything back
                _create_table(database)
                records, checksum = self._read(database)  # another program may have added one meanwhile
                known = _checks_of(check.model, records)
                checks = self._with(known, check)
                if checks == known:
                    return False
                if arm:
                    self._check_arm(records, arm)
                name, arm = (text if _is_name(text) else "" for text in (name, arm))
                _insert(database, _encode(_Record(checks[-1], name, arm)), checksum)
        return True

    def _with(self, known: tuple[InterimCheck, ...], check: InterimCheck) -> tuple[InterimCheck, ...]:
        """`known` and a check, see `with_check`."""
        for one in known:
            if one.session == check.session:
                before, now = ({value.key for value in each.values} for each in (one, check))
                # A length that can now be corrected to 20 degC is more than before.
                names_before, names_now = ({key[:2] for key in keys} for keys in (before, now))
                if one is known[-1] and names_before <= names_now and before != now:
                    return (*known[:-1], replace(check, date=one.date))
                return known
        if known and check.date < known[-1].date:
            raise InputError(
                f"the check is of {format_date(check.date)}, before the last one of {format_date(known[-1].date)}",
                file=self.path,
                hint="add checks in the order of their dates; --date states the date of a check",
            )
        return (*known, check)

    def _check_arm(self, records: Sequence[_Record], arm: str) -> None:
        """Refuse another arm; a model without the name of an arm may belong to any."""
        first = {one.check.model: one.arm for one in reversed(records)}
        arms = set(first.values())
        if arms and arms.isdisjoint(("", arm)):
            raise InputError(
                f"the checks in this history are of arm {', '.join(map(repr, sorted(arms)))}, "
                f"the model is of arm {arm!r}",
                file=self.path,
                hint="check the model file, or name another file with --history: checks of two arms are never compared",
            )

    def _records(self) -> list[_Record]:
        if not self.path.exists():
            return []
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
            return self._read(database)[0]

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

    def _read(self, database: sqlite3.Connection) -> tuple[list[_Record], str]:
        """All records and the last checksum; refuses anything but an undamaged history."""
        # SQLite would execute triggers and views of the file along with our statements.
        made = {row[0] for row in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")}
        identity, version = (_pragma(database, name) for name in ("application_id", "user_version"))
        if not made and identity == version == 0:
            return [], ""  # an empty file, left by a program that was stopped before its first check
        if identity != APPLICATION_ID:
            raise self._foreign("an SQLite file of another program")
        if version > VERSION:
            raise InputError(
                f"expected a history of version {VERSION}, got version {version}",
                file=self.path,
                hint="update truearm to read it",
            )
        if version != VERSION or made - _STATISTICS != {_TABLE}:
            raise self._damaged("its tables are not those of a history")
        if (state := _pragma(database, "quick_check(1)")) != "ok":
            raise self._damaged(str(state))
        records, checksum = [], ""
        for number, (row, text, stored) in enumerate(
            database.execute("SELECT id, record, sha256 FROM checks ORDER BY id"), start=1
        ):
            if row != number or not isinstance(text, str) or stored != (checksum := _checksum(checksum, text)):
                raise self._damaged(f"the checksum of row {number} does not match its content")
            try:
                records.append(_decode(text))
            except (ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError) as error:
                raise self._damaged(f"row {number} is not a check: {error!s:.200}") from None
        return records, checksum

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


def _checks_of(model: str, records: Sequence[_Record]) -> tuple[InterimCheck, ...]:
    """A model's checks; a later record of the same session replaces the earlier one."""
    checks = {one.check.session: one.check for one in records if one.check.model == model}
    return tuple(sorted(checks.values(), key=lambda check: check.date))


def _encode(record: _Record) -> str:
    check = {**asdict(record.check), "date": record.check.date.isoformat(sep=" ")}
    return json.dumps({"name": record.name, "arm": record.arm, **check}, allow_nan=False)


def _decode(text: str) -> _Record:
    """The record of a JSON text; raises what `History._read` catches."""
    fields = json.loads(text)
    name, arm = fields.pop("name"), fields.pop("arm")
    date = datetime.datetime.fromisoformat(fields.pop("date"))
    values = tuple(CheckValue(**value) for value in fields.pop("values"))
    check = InterimCheck(date=date, values=values, **fields)
    if date.tzinfo is not None or not all(map(_FINGERPRINT.fullmatch, (check.model, check.session))):
        raise ValueError("expected a local date and SHA-256 fingerprints")
    if not (_is_name(name) and _is_name(arm)):
        raise ValueError("expected printable names")
    return _Record(check, name, arm)


def _checksum(before: str, text: str) -> str:
    return sha256(f"{before}\n{text}".encode()).hexdigest()


def _insert(database: sqlite3.Connection, text: str, checksum: str) -> None:
    database.execute("INSERT INTO checks (record, sha256) VALUES (?, ?)", (text, _checksum(checksum, text)))


def _create_table(database: sqlite3.Connection) -> None:
    """Create the table in an empty file, within the transaction of the first check."""
    if _pragma(database, "application_id") == _pragma(database, "schema_version") == 0:
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        database.execute(_TABLE)


def _pragma(database: sqlite3.Connection, name: str) -> Any:
    return database.execute(f"PRAGMA {name}").fetchone()[0]


def _is_name(value: object) -> bool:
    return isinstance(value, str) and len(value) <= MOST_NAME and value.isprintable()
