"""The registry of a fleet: arms, their readings, fits, models in force, checks and certificates, in any SQL database.

A fit and the model that it puts in
force are one transaction, and its key is unique: a writer that was cut off repeats it, and nothing is lost or double.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from truearm.errors import InputError, MissingTool, TruearmError
from truearm.files.atomic_write import read_back
from truearm.wings.fleet.arm_list import RegisteredArm
from truearm.wings.fleet.certificates import RegisteredCertificate
from truearm.wings.fleet.fit_task import FitRow
from truearm.wings.laboratory.monitor.assessment import Assessment
from truearm.wings.laboratory.monitor.history import History
from truearm.wings.laboratory.monitor.interim_check import InterimCheck

try:
    import sqlalchemy as sql
except ModuleNotFoundError:
    raise MissingTool(
        "a fleet needs the package SQLAlchemy, which is not installed", hint="pip install 'truearm[fleet]'"
    ) from None
from truearm.wings.fleet.check_history import CheckVerdict, RegisteredHistory, keep_verdict, verdicts
from truearm.wings.fleet.database import (
    ARMS,
    CERTIFICATES,
    FILES,
    FITS,
    FLEET,
    IN_FORCE,
    SESSIONS,
    TABLES,
    VERSION,
    Database,
    lock_arm,
    utc_now,
)

_ROW = TypeAdapter(FitRow)


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
        self.database = Database(url, beside=beside or Path.cwd(), create=create)
        self.place = self.database.place
        if create:
            self.database.do(_create)
        version = self.database.do(_version)
        if version != VERSION:
            raise InputError(
                f"expected the registry of a fleet of version {VERSION} in {self.place}, got "
                f"{'another database' if version is None else f'version {version}'}",
                hint="truearm fleet init creates one; version 1 was never released, a later one needs a later truearm",
            )

    def close(self) -> None:
        """Close the connections."""
        self.database.close()

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
        return self.database.do(lambda database: sum(_add(database, one) for one in given))

    def remove(self, serial_number: str) -> dict[str, int]:
        """Remove all rows of an arm.

        Returns
        -------
        dict of str to int
            How many rows went, by the table's name.

        Raises
        ------
        InputError
            If there is no such arm.
        """
        return self.database.do(lambda database: _remove(database, serial_number))

    def nominal_arm(self, serial_number: str) -> str:
        """The nominal arm of a serial number.

        Raises
        ------
        InputError
            If there is no such arm.
        """
        found = self.database.do(lambda database: _nominal_arm(database, serial_number))
        if found is None:
            raise _unknown(serial_number)
        return found

    def arms(self) -> list[RegisteredArm]:
        """All arms by their serial number, each with its last readings."""
        last = sql.select(sql.func.max(SESSIONS.c.id)).group_by(SESSIONS.c.serial_number)
        of_last = sql.select(SESSIONS).where(SESSIONS.c.id.in_(last)).subquery()
        columns = [ARMS.c[one.name] for one in fields(RegisteredArm) if one.name != "session"]
        query = (
            sql.select(*columns, sql.func.coalesce(of_last.c.file, "").label("session"))
            .select_from(ARMS.outerjoin(of_last, ARMS.c.serial_number == of_last.c.serial_number))
            .order_by(ARMS.c.serial_number)
        )
        return [
            RegisteredArm(**row) for row in self.database.do(lambda database: database.execute(query).mappings().all())
        ]

    def fits(self) -> dict[str, FitRow]:
        """All fits by their keys."""
        rows = self.database.do(lambda database: database.execute(sql.select(FITS.c.key, FITS.c.row)).all())
        try:
            return {key: _ROW.validate_json(row) for key, row in rows}
        except ValidationError as error:
            raise TruearmError(
                f"{self.place}: the table of fits is damaged ({error.errors()[0]['msg']}). Try: restore a backup"
            ) from None

    def histories(self) -> dict[str, list[tuple[str, str]]]:
        """The models that were in force, by serial number, the last one last: since when (UTC), and the fit's key."""
        found: dict[str, list[tuple[str, str]]] = {}
        for row in self.database.do(
            lambda database: database.execute(sql.select(IN_FORCE).order_by(IN_FORCE.c.id)).all()
        ):
            found.setdefault(row.serial_number, []).append((row.since, row.key))
        return found

    def models_in_force(self) -> dict[str, str]:
        """The key of the fit whose model is in force, by serial number."""
        return {serial_number: models[-1][1] for serial_number, models in self.histories().items()}

    def record(self, row: FitRow, *, in_force: bool) -> None:
        """Keep the result of a fit; one that is there already with a result stays, one of a removed arm is not kept.

        Parameters
        ----------
        row : FitRow
        in_force : bool
            Whether its model replaces the one in force, unless other readings were added meanwhile.
        """
        self.database.do(lambda database: _record(database, row, in_force=in_force))

    def put_in_force(self, serial_number: str, key: str) -> None:
        """Put the model of a fit in force that is there already."""
        self.database.do(lambda database: _put_in_force(database, serial_number, key))

    def keep_certificates(self, certificates: Iterable[RegisteredCertificate]) -> int:
        """Keep certificates, all or none; of one that is there already another due date or file name.

        Returns
        -------
        int
            Of how many something is new.

        Raises
        ------
        InputError
            If an arm has a certificate of the same number with another content.
        """
        given = list(certificates)
        return self.database.do(lambda database: sum(_keep_certificate(database, one) for one in given))

    def certificates(self) -> dict[str, list[RegisteredCertificate]]:
        """The certificates by serial number, the last one last."""
        query = sql.select(CERTIFICATES).order_by(CERTIFICATES.c.issued, CERTIFICATES.c.number)
        found: dict[str, list[RegisteredCertificate]] = {}
        for row in self.database.do(lambda database: database.execute(query).mappings().all()):
            found.setdefault(row["serial_number"], []).append(RegisteredCertificate(**row))
        return found

    def history(self, serial_number: str) -> History:
        """The history of an arm's interim checks.

        Raises
        ------
        InputError
            If there is no such arm.
        """
        self.nominal_arm(serial_number)
        return History(RegisteredHistory(self.database, serial_number))

    def keep_verdict(
        self, serial_number: str, head: tuple[int, str], checks: Sequence[InterimCheck], assessment: Assessment
    ) -> None:
        """Keep what the checks of an arm say, unless there are others than those of `head` by now."""
        keep_verdict(self.database, serial_number, head, CheckVerdict.of(checks, assessment))

    def verdicts(self) -> dict[str, CheckVerdict]:
        """What the interim checks say, by serial number."""
        return verdicts(self.database)

    def file_hashes(self) -> dict[str, tuple[str, str]]:
        """Stamp and SHA-256 of the files that were read, by their names."""
        rows = self.database.do(lambda database: database.execute(sql.select(FILES)).all())
        return {row.file: (row.stamp, row.sha256) for row in rows}

    def keep_file_hashes(self, hashes: Mapping[str, tuple[str, str]]) -> None:
        """Keep stamps and SHA-256 of files, in place of those before."""
        if not hashes:
            return
        rows = [{"file": file, "stamp": stamp, "sha256": digest} for file, (stamp, digest) in hashes.items()]
        before = sql.delete(FILES).where(FILES.c.file == sql.bindparam("of"))

        def work(database: sql.Connection) -> None:
            database.execute(before, [{"of": file} for file in hashes])
            database.execute(sql.insert(FILES), rows)

        self.database.do(work)


def _create(database: sql.Connection) -> None:
    TABLES.create_all(database)
    if database.scalar(sql.select(FLEET.c.version)) is None:
        database.execute(sql.insert(FLEET).values(version=VERSION))


def _version(database: sql.Connection) -> int | None:
    if not sql.inspect(database).has_table(FLEET.name):
        return None
    return database.scalar(sql.select(FLEET.c.version))


def _add(database: sql.Connection, one: RegisteredArm) -> int:
    """Add an arm, or what is new of it; 1 if anything was."""
    known = database.execute(sql.select(ARMS).where(ARMS.c.serial_number == one.serial_number)).mappings().first()
    given = {name: value for name, value in asdict(one).items() if name != "session" and value not in ("", None)}
    new = given if known is None else {name: value for name, value in given.items() if known[name] != value}
    if known is None:
        database.execute(sql.insert(ARMS).values(**{"site": "", "model": "auto", "added_at": utc_now(), **given}))
    elif "arm" in new:
        raise InputError(
            f"serial number {one.serial_number!r} is in the registry as an arm {known['arm']!r}, got {one.arm!r}",
            hint="check the serial number",
        )
    elif new:
        database.execute(sql.update(ARMS).where(ARMS.c.serial_number == one.serial_number).values(**new))
    if not one.session or one.session == _last_session(database, one.serial_number):
        return int(bool(new))
    # Readings of before that are added again are the last ones.
    of_arm = SESSIONS.c.serial_number == one.serial_number
    database.execute(sql.delete(SESSIONS).where(of_arm, SESSIONS.c.file == one.session))
    database.execute(sql.insert(SESSIONS).values(serial_number=one.serial_number, file=one.session, added_at=utc_now()))
    return 1


def _nominal_arm(database: sql.Connection, serial_number: str) -> str | None:
    return database.scalar(sql.select(ARMS.c.arm).where(ARMS.c.serial_number == serial_number))


def _unknown(serial_number: str) -> InputError:
    return InputError(
        f"no arm {serial_number!r} is in the registry",
        hint="truearm fleet add FOLDER SERIAL ARM adds one, status lists them",
    )


def _remove(database: sql.Connection, serial_number: str) -> dict[str, int]:
    lock_arm(database, serial_number)
    if _nominal_arm(database, serial_number) is None:
        raise _unknown(serial_number)
    of_arms = [table for table in reversed(TABLES.sorted_tables) if "serial_number" in table.c]  # referring rows first
    return {
        table.name: database.execute(sql.delete(table).where(table.c.serial_number == serial_number)).rowcount
        for table in of_arms
    }


def _last_session(database: sql.Connection, serial_number: str) -> str | None:
    of_arm = sql.select(SESSIONS.c.file).where(SESSIONS.c.serial_number == serial_number)
    return database.scalar(of_arm.order_by(SESSIONS.c.id.desc()).limit(1))


def _record(database: sql.Connection, row: FitRow, *, in_force: bool) -> None:
    lock_arm(database, row.serial_number)
    if _nominal_arm(database, row.serial_number) is None:  # removed during the fit
        return
    text = json.dumps(asdict(row))
    read_back(_ROW.validate_json, text)
    state = database.scalar(sql.select(FITS.c.state).where(FITS.c.key == row.key))
    if state == "lost":
        database.execute(sql.update(FITS).where(FITS.c.key == row.key).values(state=row.state, row=text))
    elif state is None:
        database.execute(
            sql.insert(FITS).values(key=row.key, serial_number=row.serial_number, state=row.state, row=text)
        )
    if in_force and _last_session(database, row.serial_number) in (None, row.session):
        _put_in_force(database, row.serial_number, row.key)


def _put_in_force(database: sql.Connection, serial_number: str, key: str) -> None:
    lock_arm(database, serial_number)
    last = (
        sql.select(IN_FORCE.c.key)
        .where(IN_FORCE.c.serial_number == serial_number)
        .order_by(IN_FORCE.c.id.desc())
        .limit(1)
    )
    if database.scalar(last) != key:
        database.execute(sql.insert(IN_FORCE).values(serial_number=serial_number, key=key, since=utc_now()))


def _keep_certificate(database: sql.Connection, one: RegisteredCertificate) -> bool:
    lock_arm(database, one.serial_number)
    of_arm = sql.select(CERTIFICATES).where(CERTIFICATES.c.serial_number == one.serial_number)
    known = [RegisteredCertificate(**row) for row in database.execute(of_arm).mappings().all()]
    if one in known:
        return False
    if any(other.number == one.number and other.sha256 != one.sha256 for other in known):
        raise InputError(
            f"{one.serial_number} has a certificate {one.number} with another content",
            file=one.file,
            hint="a certificate that replaces another has a number of its own: ask the laboratory which one is valid",
        )
    same = (CERTIFICATES.c.serial_number == one.serial_number) & (CERTIFICATES.c.sha256 == one.sha256)
    database.execute(sql.delete(CERTIFICATES).where(same))
    database.execute(sql.insert(CERTIFICATES).values(**asdict(one)))
    return True
