"""The database of a fleet's registry: its tables, and transactions that are repeated where a connection was lost.

The SQL is what SQLite and PostgreSQL both have.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

import sqlalchemy as sql
from sqlalchemy.exc import ArgumentError, DBAPIError, IntegrityError, NoSuchModuleError, OperationalError

from truearm.errors import InputError, TruearmError

VERSION = 2

TABLES = sql.MetaData()
FLEET = sql.Table("truearm_fleet", TABLES, sql.Column("version", sql.Integer, primary_key=True))
ARMS = sql.Table(
    "arms",
    TABLES,
    sql.Column("serial_number", sql.String(200), primary_key=True),
    sql.Column("arm", sql.Text, nullable=False),
    sql.Column("site", sql.Text, nullable=False),
    sql.Column("model", sql.String(20), nullable=False),
    sql.Column("every_days", sql.Integer),
    sql.Column("added_at", sql.String(40), nullable=False),
)
SESSIONS = sql.Table(
    "sessions",
    TABLES,
    sql.Column("id", sql.Integer, primary_key=True),
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), nullable=False),
    sql.Column("file", sql.Text, nullable=False),
    sql.Column("added_at", sql.String(40), nullable=False),
    sql.UniqueConstraint("serial_number", "file"),
)
FITS = sql.Table(
    "fits",
    TABLES,
    sql.Column("key", sql.String(64), primary_key=True),
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), nullable=False),
    sql.Column("state", sql.String(10), nullable=False),
    sql.Column("row", sql.Text, nullable=False),
)
IN_FORCE = sql.Table(
    "models_in_force",
    TABLES,
    sql.Column("id", sql.Integer, primary_key=True),
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), nullable=False),
    sql.Column("key", sql.ForeignKey("fits.key"), nullable=False),
    sql.Column("since", sql.String(40), nullable=False),
)
# The history of an arm's interim checks: rows with a chain of checksums, as in a file of a history.
CHECKS = sql.Table(
    "checks",
    TABLES,
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), primary_key=True),
    sql.Column("number", sql.Integer, primary_key=True, autoincrement=False),
    sql.Column("record", sql.Text, nullable=False),
    sql.Column("sha256", sql.String(64), nullable=False),
)
# Its number of rows and last checksum, and what the last check says (empty while that is not known).
CHECK_HEADS = sql.Table(
    "check_heads",
    TABLES,
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), primary_key=True),
    sql.Column("rows", sql.Integer, nullable=False),
    sql.Column("sha256", sql.String(64), nullable=False),
    sql.Column("verdict", sql.Text, nullable=False),
)
CERTIFICATES = sql.Table(
    "certificates",
    TABLES,
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), primary_key=True),
    sql.Column("sha256", sql.String(64), primary_key=True),
    sql.Column("number", sql.Text, nullable=False),
    sql.Column("issued", sql.String(10), nullable=False),
    sql.Column("verdict", sql.Text, nullable=False),
    sql.Column("due", sql.String(10), nullable=False),
    sql.Column("file", sql.Text, nullable=False),
)
# The SHA-256 of files, and by what it is seen that they are as they were.
FILES = sql.Table(
    "files",
    TABLES,
    sql.Column("file", sql.Text, primary_key=True),
    sql.Column("stamp", sql.String(200), nullable=False),
    sql.Column("sha256", sql.String(64), nullable=False),
)


def lock_arm(database: sql.Connection, serial_number: str) -> None:
    """Make other writers of the arm wait for the end of this transaction, which a write does in any database."""
    of_arm = sql.update(ARMS).where(ARMS.c.serial_number == serial_number)
    database.execute(of_arm.values(serial_number=serial_number))


def utc_now() -> str:
    """The time of a row."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


T = TypeVar("T")

# How long a writer waits for a database that does not answer, and between attempts.
PATIENCE_S, PAUSE_S = 60.0, 0.5
# Attempts where a row is there already: another writer was faster, and the next attempt sees its row.
MAX_CONFLICTS = 3


class Database:
    """A database, without an open connection.

    Parameters
    ----------
    url : str
        As SQLAlchemy writes it: ``sqlite:////data/fleet/registry.sqlite``, ``postgresql+psycopg://user@host/fleet``.
        It has no password, as it is written to files and shown.
    beside : Path
        Folder of relative files of SQLite.
    create : bool
        Make a file of SQLite that does not exist; otherwise it must be there.

    Raises
    ------
    InputError
        If the URL is none.
    """

    def __init__(self, url: str, *, beside: Path, create: bool) -> None:
        try:
            checked = _checked_url(sql.make_url(url), beside, create=create)
            # A connection for each transaction: none is stale after a pause, and none is left open.
            self._engine = sql.create_engine(checked, poolclass=sql.NullPool)
        except InputError:
            raise
        except (ArgumentError, NoSuchModuleError, ModuleNotFoundError, ValueError) as error:
            raise InputError(
                f"the database cannot be opened ({error})",
                hint="a URL as sqlite:///registry.sqlite or postgresql+psycopg://user@host/fleet (pip install psycopg)",
            ) from None
        self.place = self._engine.url.render_as_string(hide_password=True)

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    def do(self, work: Callable[[sql.Connection], T]) -> T:
        """Do work in one transaction; again where the connection was lost, or another writer was faster.

        Raises
        ------
        TruearmError
            If the database cannot be used, or does not answer within `PATIENCE_S`.
        """
        end, conflicts = time.monotonic() + PATIENCE_S, 0
        while True:
            try:
                with self._engine.begin() as connection:
                    return work(connection)
            except DBAPIError as error:
                code = getattr(error.orig, "sqlite_errorcode", sqlite3.SQLITE_BUSY) & 0xFF
                conflicts += isinstance(error, IntegrityError)
                passes = (isinstance(error, IntegrityError) and conflicts < MAX_CONFLICTS) or (
                    isinstance(error, OperationalError) and code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
                )
                if not (passes or error.connection_invalidated) or time.monotonic() > end:
                    raise TruearmError(
                        f"{self.place}: the database cannot be used ({' '.join(str(error.orig).split())}). "
                        "Try: see that it runs, may be written and has room; the same command then goes on"
                    ) from None
            time.sleep(PAUSE_S)


def _checked_url(url: sql.URL, beside: Path, *, create: bool) -> sql.URL:
    """The URL, with a file of SQLite as a whole path."""
    if url.password or not {"password", "passwd", "sslpassword"}.isdisjoint(url.query):
        raise InputError(
            "expected the URL of a database without a password: it is written to files",
            hint="a password in ~/.pgpass or PGPASSWORD",
        )
    if url.get_backend_name() != "sqlite":
        return url
    if url.database in (None, "", ":memory:"):
        raise InputError("a database in memory is gone with the program", hint="sqlite:///registry.sqlite")
    file = beside / str(url.database)
    if not create and not file.is_file():  # which SQLite would make
        raise InputError("the registry does not exist", file=file, hint="restore it from a backup")
    return url.set(database=file.as_posix())
