"""The rows of a history of interim checks: checks and withdrawals, and their JSON texts."""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256

from truearm.files.atomic_write import read_back
from truearm.wings.laboratory.monitor.interim_check import CheckReading, CheckValue, InterimCheck, Withdrawal

_FINGERPRINT = re.compile("[0-9a-f]{64}")
MOST_NAME = 1000


@dataclass(frozen=True)
class CheckRow:
    """A check in a row of the file."""

    check: InterimCheck
    name: str
    arm: str
    serial_number: str = ""


@dataclass(frozen=True)
class WithdrawalRow:
    """The withdrawal of the check in an earlier row, counted from 1."""

    row: int
    withdrawal: Withdrawal


@dataclass(frozen=True)
class HistoryRows:
    """All rows of the file and the last checksum; rows are numbered from 1."""

    rows: tuple[CheckRow | WithdrawalRow, ...]
    checksum: str = ""

    @property
    def check_rows(self) -> list[CheckRow]:
        """The rows with checks."""
        return [row for row in self.rows if isinstance(row, CheckRow)]

    def checks_of(self, model: str) -> tuple[InterimCheck, ...]:
        """A model's checks in the order of addition, with their withdrawals; a row may complete the check before."""
        checks: list[InterimCheck] = []
        by_row: dict[int, int] = {}
        for number, row in enumerate(self.rows, start=1):
            if isinstance(row, WithdrawalRow):
                if (at := by_row.get(row.row)) is not None:
                    checks[at] = replace(checks[at], withdrawn=row.withdrawal)
            elif row.check.model == model:
                same = [i for i, one in enumerate(checks) if _is_same(one, row.check)]
                by_row[number] = same[0] if same else len(checks)
                checks[by_row[number] :] = [row.check, *checks[by_row[number] + 1 :]]
        return tuple(checks)

    def row_of(self, check: InterimCheck) -> int:
        """The number of the row with a check that counts."""
        wanted = replace(check, withdrawn=None)
        return max(
            number for number, row in enumerate(self.rows, start=1) if isinstance(row, CheckRow) and row.check == wanted
        )


def _is_same(stored: InterimCheck, check: InterimCheck) -> bool:
    """Whether a check completes a stored one: the same readings, and not withdrawn."""
    return stored.session == check.session and stored.withdrawn is None


def checksum_of_new(text: str, before: HistoryRows) -> str:
    """The checksum of a row to be added to others, which is read back first."""
    read_back(lambda written: decode_row(written, before.rows), text)
    return _next_checksum(before.checksum, text)


def _next_checksum(before: str, text: str) -> str:
    """The checksum of a row after that of the row before; of the first row that is empty."""
    return sha256(f"{before}\n{text}".encode()).hexdigest()


def linked_rows(stored: Iterable[tuple[object, object, object]], head: Sequence[tuple[object, object]]) -> HistoryRows:
    """The rows of a store, if they are as they were added.

    Parameters
    ----------
    stored : iterable of (object, object, object)
        Number, text and checksum of each row.
    head : sequence of (object, object)
        One: the number of rows and the last checksum.

    Raises
    ------
    ValueError
        If a row was changed, added or removed; or is not a row.
    """
    rows: list[CheckRow | WithdrawalRow] = []
    checksum = ""
    for expected, (number, text, sum_of_row) in enumerate(stored, start=1):
        if isinstance(text, str):
            checksum = _next_checksum(checksum, text)
        if number != expected or not isinstance(text, str) or sum_of_row != checksum:
            raise ValueError(f"the checksum of row {expected} does not match its content")
        try:
            rows.append(decode_row(text, rows))
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError) as error:
            raise ValueError(f"row {expected} is not a check: {error!s:.200}") from None
    if list(map(tuple, head)) != [(len(rows), checksum)]:
        raise ValueError("the last rows are missing, or were added by another program")
    return HistoryRows(tuple(rows), checksum)


def encode_check(record: CheckRow) -> str:
    """Return the JSON text of a row with a check."""
    check = {**asdict(record.check), "date": record.check.date.isoformat(sep=" ")}
    del check["withdrawn"]
    if not record.check.readings:
        del check["readings"]
    if not record.check.accepted:
        del check["accepted"]
    for value in check["values"]:  # nor has a value that nothing is expected of
        if value["largest_expected_mm"] is None:
            del value["largest_expected_mm"]
    # Without a number the row is as it was before there were any.
    number = {"serial_number": record.serial_number} if record.serial_number else {}
    return json.dumps({"name": record.name, "arm": record.arm, **number, **check}, allow_nan=False)


def encode_withdrawal(row: int, withdrawal: Withdrawal) -> str:
    """Return the JSON text of a row that withdraws the check in an earlier one."""
    stated = {"date": withdrawal.date.isoformat(sep=" "), "reason": withdrawal.reason}
    return json.dumps({"withdraws": row, **stated}, allow_nan=False)


def decode_row(text: str, rows: Sequence[CheckRow | WithdrawalRow]) -> CheckRow | WithdrawalRow:
    """The row of a JSON text after other rows; raises what `linked_rows` catches."""
    fields = json.loads(text)
    if "withdraws" in fields:
        row, date = fields.pop("withdraws"), datetime.datetime.fromisoformat(fields.pop("date"))
        if type(row) is not int or not 1 <= row <= len(rows) or not isinstance(rows[row - 1], CheckRow):
            raise ValueError("expected the row of an earlier check")
        return WithdrawalRow(row, Withdrawal(date, **fields))
    stated = (fields.pop("name"), fields.pop("arm"), fields.pop("serial_number", ""))
    date = datetime.datetime.fromisoformat(fields.pop("date"))
    values = tuple(CheckValue(**value) for value in fields.pop("values"))
    readings = tuple(
        CheckReading(artefact, tuple(pose), tuple(deviation))
        for artefact, pose, deviation in (
            (one["artefact"], one["pose"], one["deviation_mm"]) for one in fields.pop("readings", ())
        )
    )
    if "withdrawn" in fields:
        raise ValueError("expected a check that counts")
    accepted = tuple(fields.pop("accepted", ()))
    check = InterimCheck(date=date, values=values, readings=readings, accepted=accepted, **fields)
    if date.tzinfo is not None or not all(map(_FINGERPRINT.fullmatch, (check.model, check.session))):
        raise ValueError("expected a local date and SHA-256 fingerprints")
    if not all(map(is_name, stated)):
        raise ValueError("expected printable names")
    return CheckRow(check, *stated)


def is_name(value: object) -> bool:
    """Whether a value is a name that can be printed."""
    return isinstance(value, str) and len(value) <= MOST_NAME and value.isprintable()
