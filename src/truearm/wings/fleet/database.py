"""The database of a fleet's registry: transactions that are repeated where a connection was lost."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import sqlalchemy as sql
from sqlalchemy.exc import ArgumentError, DBAPIError, IntegrityError, NoSuchModuleError, OperationalError

from truearm.errors import InputError, TruearmError

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
