"""The tables of a fleet's registry, in SQL that SQLite and PostgreSQL both have."""

from __future__ import annotations

from datetime import UTC, datetime

import sqlalchemy as sql

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
