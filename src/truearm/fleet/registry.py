"""The registry of a fleet: arms, their readings, every fit and the model in force, in any SQL database.

Tables are those of SQLAlchemy Core, in SQL that SQLite and PostgreSQL both have. A fit and the model that it puts in
force are one transaction, and its key is unique: a writer that was cut off repeats it, and nothing is lost or double.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from typing import TypeVar

from pydantic import TypeAdapter

from truearm.choices import ModelName
from truearm.errors import InputError, MissingTool, TruearmError
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


@dataclass(frozen=True)
class RegisteredArm:
    """An arm of the fleet.

    Attributes
    ----------
    serial_number, site : str
    arm : str
        The nominal arm: a name of the catalogue, or a file.
    model : str
        Kind of model that is fitted, as `truearm.fit` takes it.
    every_days : int or None
        Days after which readings are due again.
    session : str
        File of the last readings; empty if there are none.
    """

    serial_number: str
    arm: str
    site: str = ""
    model: ModelName = "auto"
    every_days: int | None = None
    session: str = ""


class Registry:
    """The registry in a database.

    Parameters
    ----------
    url : str
        Of the database, as SQLAlchemy writes it: ``sqlite:////data/fleet/registry.sqlite``,
        ``postgresql+psycopg://user@host/fleet``.
    create : bool
        Create the tables; otherwise they must be there.

    Raises
    ------
    TruearmError
        If the database cannot be opened, or is none of a fleet or of a later version.
    """

    def __init__(self, url: str, *, create: bool = False) -> None:
        try:
            self._engine = sql.create_engine(url, pool_pre_ping=True)
        except (ArgumentError, NoSuchModuleError, ModuleNotFoundError) as error:
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
        """Add arms, or new readings of arms that are there; all of them or none.

        Returns
        -------
        int
            How many arms or readings are new.

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

    def fits(self, keys: Iterable[str] | None = None) -> dict[str, FitRow]:
        """The fits by their keys: of all keys, or those of some that are there."""
        wanted = None if keys is None else set(keys)
        rows = self._do(lambda database: database.execute(sql.select(_FITS.c.key, _FITS.c.row)).all())
        return {key: _ROW.validate_json(row) for key, row in rows if wanted is None or key in wanted}

    def models_in_force(self) -> dict[str, str]:
        """The key of the fit whose model is in force, by serial number."""
        last = sql.select(sql.func.max(_IN_FORCE.c.id)).group_by(_IN_FORCE.c.serial_number)
        query = sql.select(_IN_FORCE.c.serial_number, _IN_FORCE.c.key).where(_IN_FORCE.c.id.in_(last))
        return {row.serial_number: row.key for row in self._do(lambda database: database.execute(query).all())}

    def models_of(self, serial_number: str) -> list[tuple[str, str]]:
        """The models that were in force for an arm, the last one last: since when (UTC), and the key of the fit."""
        query = (
            sql.select(_IN_FORCE.c.since, _IN_FORCE.c.key)
            .where(_IN_FORCE.c.serial_number == serial_number)
            .order_by(_IN_FORCE.c.id)
        )
        return [(row.since, row.key) for row in self._do(lambda database: database.execute(query).all())]

    def record(self, row: FitRow, *, in_force: bool) -> None:
        """Keep the result of a fit; a fit that is there already with a result stays as it is.

        Parameters
        ----------
        row : FitRow
        in_force : bool
            Whether its model replaces the one in force.
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
            except IntegrityError:
                if time.monotonic() > end:
                    raise
            except (OperationalError, DBAPIError) as error:
                lost = isinstance(error, OperationalError) or error.connection_invalidated
                if not lost or time.monotonic() > end:
                    raise TruearmError(f"{self.place}: the database does not answer ({error.orig})") from None
            time.sleep(PAUSE_S)


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
    """Add an arm, and its readings if they are new; 1 if anything was."""
    known = database.execute(sql.select(_ARMS).where(_ARMS.c.serial_number == one.serial_number)).mappings().first()
    if known is None:
        values = {name: value for name, value in asdict(one).items() if name != "session"}
        database.execute(sql.insert(_ARMS).values(added_at=_now(), **values))
    elif known["arm"] != one.arm:
        raise InputError(
            f"serial number {one.serial_number!r} is in the registry as an arm {known['arm']!r}, got {one.arm!r}",
            hint="check the serial number",
        )
    if not one.session:
        return int(known is None)
    there = sql.select(_SESSIONS.c.id).where(
        _SESSIONS.c.serial_number == one.serial_number, _SESSIONS.c.file == one.session
    )
    if database.scalar(there) is not None:
        return int(known is None)
    database.execute(sql.insert(_SESSIONS).values(serial_number=one.serial_number, file=one.session, added_at=_now()))
    return 1


def _record(database: sql.Connection, row: FitRow, *, in_force: bool) -> None:
    text = json.dumps(asdict(row), allow_nan=False)
    state = database.scalar(sql.select(_FITS.c.state).where(_FITS.c.key == row.key))
    if state == "lost":
        database.execute(sql.update(_FITS).where(_FITS.c.key == row.key).values(state=row.state, row=text))
    elif state is None:
        database.execute(
            sql.insert(_FITS).values(key=row.key, serial_number=row.serial_number, state=row.state, row=text)
        )
    if in_force:
        _put_in_force(database, row.serial_number, row.key)


def _put_in_force(database: sql.Connection, serial_number: str, key: str) -> None:
    last = (
        sql.select(_IN_FORCE.c.key)
        .where(_IN_FORCE.c.serial_number == serial_number)
        .order_by(_IN_FORCE.c.id.desc())
        .limit(1)
    )
    if database.scalar(last) != key:
        database.execute(sql.insert(_IN_FORCE).values(serial_number=serial_number, key=key, since=_now()))
