"""The histories of interim checks in a fleet's registry, one an arm, and what the last check of each says."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import sqlalchemy as sql
from pydantic import TypeAdapter, ValidationError

from truearm.errors import InputError
from truearm.files.dates import format_date
from truearm.wings.fleet.database import CHECK_HEADS, CHECKS, Database, lock_arm
from truearm.wings.laboratory.monitor.assessment import Assessment, RecalibrationAdvice, assess, describe_assessment
from truearm.wings.laboratory.monitor.history import History
from truearm.wings.laboratory.monitor.history_rows import HistoryRows, checksum_of_new, linked_rows
from truearm.wings.laboratory.monitor.interim_check import InterimCheck, counted


@dataclass(frozen=True)
class CheckVerdict:
    """What the interim checks of an arm say.

    Attributes
    ----------
    model : str
        SHA-256 of the model that was checked.
    recalibrate : RecalibrationAdvice
    date : str
        Of the last check.
    n_checks : int
        Those of this model that count.
    message : str
        The advice in a sentence.
    """

    model: str
    recalibrate: RecalibrationAdvice
    date: str
    n_checks: int
    message: str

    @classmethod
    def of(cls, checks: Sequence[InterimCheck], assessment: Assessment) -> CheckVerdict:
        """The verdict on the checks of a model."""
        last, message = counted(checks)[-1], describe_assessment(assessment, checks)
        return cls(last.model, assessment.recalibrate, format_date(last.date), len(counted(checks)), message)


_VERDICT = TypeAdapter(CheckVerdict)


@dataclass(frozen=True)
class RegisteredHistory:
    """The history of an arm in the registry; see `HistoryStore`."""

    database: Database
    serial_number: str

    @property
    def name(self) -> str:
        """See `HistoryStore`."""
        return f"checks of {self.serial_number} in {self.database.place}"

    @property
    def files(self) -> tuple[Path, ...]:
        """See `HistoryStore`."""
        return ()

    def error(self, problem: str, hint: str | None = None) -> InputError:
        """See `HistoryStore`."""
        return InputError(f"{self.name}: {problem}", hint=hint)

    def read(self) -> HistoryRows:
        """See `HistoryStore`."""
        return self.database.do(self._read)

    def add(self, row: Callable[[HistoryRows], str | None]) -> bool:
        """See `HistoryStore`."""

        def work(database: sql.Connection) -> bool:
            lock_arm(database, self.serial_number)
            before = self._read(database)
            text = row(before)
            if text is None:
                return False
            number, checksum = len(before.rows) + 1, checksum_of_new(text, before)
            of = {"serial_number": self.serial_number, "sha256": checksum}
            database.execute(sql.insert(CHECKS).values(**of, number=number, record=text))
            database.execute(sql.delete(CHECK_HEADS).where(CHECK_HEADS.c.serial_number == self.serial_number))
            database.execute(sql.insert(CHECK_HEADS).values(**of, rows=number, verdict=""))
            return True

        return self.database.do(work)

    def _read(self, database: sql.Connection) -> HistoryRows:
        of_arm = CHECKS.c.serial_number == self.serial_number
        stored = database.execute(
            sql.select(CHECKS.c.number, CHECKS.c.record, CHECKS.c.sha256).where(of_arm).order_by(CHECKS.c.number)
        ).all()
        head = database.execute(
            sql.select(CHECK_HEADS.c.rows, CHECK_HEADS.c.sha256).where(
                CHECK_HEADS.c.serial_number == self.serial_number
            )
        ).all()
        if not stored and not head:
            return HistoryRows(())
        try:
            return linked_rows([tuple(row) for row in stored], [tuple(row) for row in head])
        except ValueError as error:
            raise self.error(f"the history is damaged ({error})", hint="restore the database from a backup") from None


def keep_verdict(database: Database, serial_number: str, head: tuple[int, str], verdict: CheckVerdict) -> None:
    """Keep what the checks of an arm say, unless there are others than those of `head` by now."""
    of_head = (CHECK_HEADS.c.serial_number == serial_number) & (CHECK_HEADS.c.sha256 == head[1])
    text = json.dumps(asdict(verdict))
    database.do(lambda opened: opened.execute(sql.update(CHECK_HEADS).where(of_head).values(verdict=text)))


def verdicts(database: Database) -> dict[str, CheckVerdict]:
    """What the checks of each arm say that has some."""
    found = {}
    columns = CHECK_HEADS.c.serial_number, CHECK_HEADS.c.verdict
    for serial_number, text in database.do(lambda opened: opened.execute(sql.select(*columns)).all()):
        verdict = _verdict(text) or _assess(History(RegisteredHistory(database, serial_number)))
        if verdict is not None:
            found[serial_number] = verdict
    return found


def _verdict(text: str) -> CheckVerdict | None:
    """The verdict as it was kept; None after a withdrawal, or after a program that ended before it kept one."""
    try:
        return _VERDICT.validate_json(text)
    except ValidationError:
        return None


def _assess(history: History) -> CheckVerdict | None:
    """The verdict on the model of the last check that counts."""
    of_model = [checks for model in history.models() if counted(checks := history.checks(model))]
    return CheckVerdict.of(of_model[0], assess(of_model[0])) if of_model else None
