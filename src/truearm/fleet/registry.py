"""The registry of a fleet: arms, their readings, every fit and the model in force, in any SQL database.

Tables are those of SQLAlchemy Core, in SQL that SQLite and PostgreSQL both have. A fit and the model that it puts in
force are one transaction, and its key is unique: a writer that was cut off repeats it, and nothing is lost or double.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from truearm.errors import InputError, MissingTool, TruearmError
from truearm.fleet.arm_list import RegisteredArm
from truearm.fleet.fit_task import FitRow

try:
    import sqlalchemy as sql
    from sqlalchemy.exc import ArgumentError, DBAPIError, IntegrityError, NoSuchModuleError, OperationalError
except ModuleNotFoundError:
    raise MissingTool(
        "a fleet needs the package SQLAlchemy, which is not installed", hint="pip install 'truearm[fleet]'"
    ) from None

T = TypeVar("T")

_ROW = TypeAdapter(FitRow)

VERSION = 1
# How long a writer waits for a database that does not answer, and between attempts.
PATIENCE_S, PAUSE_S = 60.0, 0.5

_TABLES = sql.MetaData()
_VERSION = sql.Table("truearm_fleet", _TABLES, sql.Column("version", sql.Integer, primary_key=True))
_ARMS = sql.Table(
    "arms",
    _TABLES,
    sql.Column("serial_number", sql.String(200), primary_key=True),
    sql.Column("arm", sql.Text, nullable=False),
    sql.Column("site", sql.Text, nullable=False),
    sql.Column("model", sql.String(20), nullable=False),
    sql.Column("every_days", sql.Integer),
    sql.Column("added_at", sql.String(40), nullable=False),
)
_SESSIONS = sql.Table(
    "sessions",
    _TABLES,
    sql.Column("id", sql.Integer, primary_key=True),
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), nullable=False),
    sql.Column("file", sql.Text, nullable=False),
    sql.Column("added_at", sql.String(40), nullable=False),
    sql.UniqueConstraint("serial_number", "file"),
)
_FITS = sql.Table(
    "fits",
    _TABLES,
    sql.Column("key", sql.String(64), primary_key=True),
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), nullable=False),
    sql.Column("state", sql.String(10), nullable=False),
    sql.Column("row", sql.Text, nullable=False),
)
_IN_FORCE = sql.Table(
    "models_in_force",
    _TABLES,
    sql.Column("id", sql.Integer, primary_key=True),
    sql.Column("serial_number", sql.ForeignKey("arms.serial_number"), nullable=False),
    sql.Column("key", sql.ForeignKey("fits.key"), nullable=False),
    sql.Column("since", sql.String(40), nullable=False),
)


class Registry:
    """The registry in a database.

    Parameters
    ----------
    url : str
        Of the database, as SQLAlchemy writes it: ``sqlite:////data/fleet/registry.sqlite``,
        ``postgresql+psycopg://user@host/fleet``. It has no password, as it is written to files and shown.
    beside : Path, optional
        Folder of relative files of SQLite; by default the current one.
    create : bool
        Create the tables; otherwise they must be there.

    Raises
    ------
    TruearmError
        If the database cannot be opened, or is none of a fleet or of a later version.
    """

    def __init__(self, url: str, *, beside: Path | None = None, create: bool = False) -> None:
        try:
            checked = _checked_url(sql.make_url(url), beside or Path.cwd(), create=create)
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
        if create:
            self._do(_create)
        version = self._do(_version)
        if version != VERSION:
            raise InputError(
                f"expected the registry of a fleet of version {VERSION} in {self.place}, got "
                f"{'another database' if version is None else f'version {version}'}",
                hint="truearm fleet init creates one; a later version needs a later truearm",
            )

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    def add(self, arms: Iterable[RegisteredArm]) -> int:
        """Add arms, or what is new of arms that are there: readings, site, model, days; all of them or none.

        Returns
        -------
        int
            Of how many arms something is new.

        Raises
        ------
        InputError
            If an arm is there as an arm of another type.
        """
        given = list(arms)
        return self._do(lambda database: sum(_add(database, one) for one in given))

    def arms(self) -> list[RegisteredArm]:
        """All arms by their serial number, each with its last readings."""
        last = sql.select(sql.func.max(_SESSIONS.c.id)).group_by(_SESSIONS.c.serial_number)
        of_last = sql.select(_SESSIONS).where(_SESSIONS.c.id.in_(last)).subquery()
        columns = [_ARMS.c[one.name] for one in fields(RegisteredArm) if one.name != "session"]
        query = (
            sql.select(*columns, sql.func.coalesce(of_last.c.file, "").label("session"))
            .select_from(_ARMS.outerjoin(of_last, _ARMS.c.serial_number == of_last.c.serial_number))
            .order_by(_ARMS.c.serial_number)
        )
        return [RegisteredArm(**row) for row in self._do(lambda database: database.execute(query).mappings().all())]

    def fits(self) -> dict[str, FitRow]:
        """All fits by their keys."""
        rows = self._do(lambda database: database.execute(sql.select(_FITS.c.key, _FITS.c.row)).all())
        try:
            return {key: _ROW.validate_json(row) for key, row in rows}
        except ValidationError as error:
            raise TruearmError(
                f"{self.place}: the table of fits is damaged ({error.errors()[0]['msg']}). Try: restore a backup"
            ) from None

    def histories(self) -> dict[str, list[tuple[str, str]]]:
        """The models that were in force, by serial number, the last one last: since when (UTC), and the fit's key."""
        found: dict[str, list[tuple[str, str]]] = {}
        for row in self._do(lambda database: database.execute(sql.select(_IN_FORCE).order_by(_IN_FORCE.c.id)).all()):
            found.setdefault(row.serial_number, []).append((row.since, row.key))
        return found

    def models_in_force(self) -> dict[str, str]:
        """The key of the fit whose model is in force, by serial number."""
        return {serial_number: models[-1][1] for serial_number, models in self.histories().items()}

    def record(self, row: FitRow, *, in_force: bool) -> None:
        """Keep the result of a fit; a fit that is there already with a result stays as it is.

        Parameters
        ----------
        row : FitRow
        in_force : bool
            Whether its model replaces the one in force, unless other readings were added meanwhile.
        """
        self._do(lambda database: _record(database, row, in_force=in_force))

    def put_in_force(self, serial_number: str, key: str) -> None:
        """Put the model of a fit in force that is there already."""
        self._do(lambda database: _put_in_force(database, serial_number, key))

    def _do(self, work: Callable[[sql.Connection], T]) -> T:
        """Do work in one transaction; again where the connection was lost, or another writer was faster."""
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                with self._engine.begin() as database:
                    return work(database)
            except DBAPIError as error:
                code = getattr(error.orig, "sqlite_errorcode", sqlite3.SQLITE_BUSY) & 0xFF
                passes = isinstance(error, IntegrityError) or (
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
    if url.password or "password" in url.query:
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


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _create(database: sql.Connection) -> None:
    _TABLES.create_all(database)
    if database.scalar(sql.select(_VERSION.c.version)) is None:
        database.execute(sql.insert(_VERSION).values(version=VERSION))


def _version(database: sql.Connection) -> int | None:
    if not sql.inspect(database).has_table(_VERSION.name):
        return None
    return database.scalar(sql.select(_VERSION.c.version))


def _add(database: sql.Connection, one: RegisteredArm) -> int:
    """Add an arm, or what is new of it; 1 if anything was."""
    known = database.execute(sql.select(_ARMS).where(_ARMS.c.serial_number == one.serial_number)).mappings().first()
    given = {name: value for name, value in asdict(one).items() if name != "session" and value not in ("", None)}
    new = given if known is None else {name: value for name, value in given.items() if known[name] != value}
    if known is None:
        database.execute(sql.insert(_ARMS).values(**{"site": "", "model": "auto", "added_at": _now(), **given}))
    elif "arm" in new:
        raise InputError(
            f"serial number {one.serial_number!r} is in the registry as an arm {known['arm']!r}, got {one.arm!r}",
            hint="check the serial number",
        )
    elif new:
        database.execute(sql.update(_ARMS).where(_ARMS.c.serial_number == one.serial_number).values(**new))
    if not one.session or one.session == _last_session(database, one.serial_number):
        return int(bool(new))
    # Readings of before that are added again are the last ones.
    of_arm = _SESSIONS.c.serial_number == one.serial_number
    database.execute(sql.delete(_SESSIONS).where(of_arm, _SESSIONS.c.file == one.session))
    database.execute(sql.insert(_SESSIONS).values(serial_number=one.serial_number, file=one.session, added_at=_now()))
    return 1


def _last_session(database: sql.Connection, serial_number: str) -> str | None:
    of_arm = sql.select(_SESSIONS.c.file).where(_SESSIONS.c.serial_number == serial_number)
    return database.scalar(of_arm.order_by(_SESSIONS.c.id.desc()).limit(1))


def _record(database: sql.Connection, row: FitRow, *, in_force: bool) -> None:
    _lock(database, row.serial_number)
    text = json.dumps(asdict(row))
    state = database.scalar(sql.select(_FITS.c.state).where(_FITS.c.key == row.key))
    if state == "lost":
        database.execute(sql.update(_FITS).where(_FITS.c.key == row.key).values(state=row.state, row=text))
    elif state is None:
        database.execute(
            sql.insert(_FITS).values(key=row.key, serial_number=row.serial_number, state=row.state, row=text)
        )
    if in_force and _last_session(database, row.serial_number) in (None, row.session):
        _put_in_force(database, row.serial_number, row.key)


def _lock(database: sql.Connection, serial_number: str) -> None:
    """Make other writers of the arm wait for the end of this transaction, which a write does in any database."""
    of_arm = sql.update(_ARMS).where(_ARMS.c.serial_number == serial_number)
    database.execute(of_arm.values(serial_number=serial_number))


def _put_in_force(database: sql.Connection, serial_number: str, key: str) -> None:
    _lock(database, serial_number)
    last = (
        sql.select(_IN_FORCE.c.key)
        .where(_IN_FORCE.c.serial_number == serial_number)
        .order_by(_IN_FORCE.c.id.desc())
        .limit(1)
    )
    if database.scalar(last) != key:
        database.execute(sql.insert(_IN_FORCE).values(serial_number=serial_number, key=key, since=_now()))
