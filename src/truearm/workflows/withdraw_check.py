"""`withdraw_check`: a wrong interim check no longer counts; it stays in the history with the reason."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from truearm.errors import InputError
from truearm.files.file_reading import check_readable
from truearm.solve.threads import one_blas_thread
from truearm.verification.monitor.assessment import Assessment, assess, describe_assessment
from truearm.verification.monitor.history import MAX_BYTES, History
from truearm.verification.monitor.interim_check import InterimCheck, Withdrawal, counted
from truearm.verification.standards.dates import format_date, now
from truearm.workflows.check import model_file_fingerprint
from truearm.workflows.inputs import ModelLike, to_model
from truearm.workflows.outputs import PageRecord, input_files, version_row
from truearm.workflows.record import TextTable

if TYPE_CHECKING:
    from truearm.pages.page import Page


@dataclass(frozen=True, eq=False, repr=False)
class WithdrawalResult(PageRecord):
    """A check that no longer counts, and the assessment of the others.

    Attributes
    ----------
    check : InterimCheck
        With its withdrawal.
    number : int
        Counted from 1; other checks keep theirs.
    checks : tuple of InterimCheck
        All checks of the model.
    assessment : Assessment or None
        Of those that count; None where there is none.
    model : model or path
    history : Path
        The file of the history.
    head : (int, str)
        Its number of rows and its last checksum after the withdrawal.
    """

    check: InterimCheck
    number: int
    checks: tuple[InterimCheck, ...]
    assessment: Assessment | None
    model: ModelLike
    history: Path
    head: tuple[int, str]

    @property
    def input_files(self) -> tuple[Path, ...]:
        """See `PageRecord`."""
        return (*input_files(self.model), self.history)

    def page(self) -> Page:
        """The control charts without the withdrawn check, which is struck through.

        Raises
        ------
        InputError
            If no check is left that counts.
        """
        from truearm.show.interim_check_page import drift_page

        if self.assessment is None:
            raise InputError("no check of this model is left that counts: there is nothing to draw")
        arm = to_model(self.model).arm
        facts = [
            ("model", f"SHA-256 {self.check.model}"),
            ("arm", f"{arm.name}: {arm.title}. {arm.source}"),
            ("history", f"{self.history.name}: {self.head[0]} rows, last checksum {self.head[1]}"),
            version_row(),
        ]
        return drift_page(self.checks, self.assessment, arm=arm.name, facts=facts)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        assert self.check.withdrawn is not None
        yield f"Check {self.number} of {format_date(self.check.date)} is withdrawn: {self.check.withdrawn.reason}"
        yield "It stays in the history with the reason, and no longer counts."
        if self.assessment is None:
            yield "No check of this model is left that counts, and there is nothing to draw on a page."
        else:
            yield f"Without it: {describe_assessment(self.assessment, self.checks)}"

    def to_dict(self) -> dict[str, Any]:
        """See `Record`."""
        assert self.check.withdrawn is not None
        return {
            "check": self.number,
            "date": format_date(self.check.date),
            "reason": self.check.withdrawn.reason,
            "n_checks": len(counted(self.checks)),
            "recalibrate": None if self.assessment is None else self.assessment.recalibrate.value,
        }


@one_blas_thread()
def withdraw_check(
    model: ModelLike, history: History | str | Path, which: str | int, *, reason: str
) -> WithdrawalResult:
    """Withdraw a wrong check: it stays in the history with the reason, and no longer counts.

    Parameters
    ----------
    model : model or path
    history : History or path
        The file of its checks.
    which : str or int
        The number of the check, counted from 1, or its date.
    reason : str
        What was wrong with it.

    Returns
    -------
    WithdrawalResult

    Raises
    ------
    InputError
        If there is no history, no such check or more than one, it is withdrawn already, or the reason is empty.

    Examples
    --------
    >>> import tempfile
    >>> import truearm as ta
    >>> readings = ta.simulate("gao2017", poses=30, preset="perfect").session
    >>> model = ta.NominalModel(ta.load_arm("gao2017")).fit_readings(readings)
    >>> in_seats = ta.simulate("gao2017", poses=8, strategy="seat", seats=2, preset="perfect", seed=1).session
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = ta.check(model, in_seats, f"{folder}/history.sqlite")
    ...     withdrawn = ta.withdraw_check(model, f"{folder}/history.sqlite", 1, reason="the seat was loose")
    >>> withdrawn.check.withdrawn.reason
    'the seat was loose'
    """
    kept = history if isinstance(history, History) else _existing(Path(history))
    whose = model_file_fingerprint(model)
    known = kept.checks(whose)
    number = _number_of(str(which).strip(), known, kept.path)
    withdrawal = Withdrawal(now(), reason)
    kept.withdraw(known[number - 1], withdrawal)
    checks = kept.checks(whose)
    assessment = assess(checks) if counted(checks) else None
    return WithdrawalResult(checks[number - 1], number, checks, assessment, model, kept.path, kept.head)


def _existing(path: Path) -> History:
    """The history in a file: a withdrawal creates none."""
    check_readable(path, limit_bytes=MAX_BYTES, hint="name the file of the checks with --history")
    return History(path)


def _number_of(which: str, checks: Sequence[InterimCheck], file: Path) -> int:
    """The number of the check that counts and has this number or date."""
    counting = {i: one for i, one in enumerate(checks, start=1) if one.withdrawn is None}
    listed = [f"{i} of {format_date(one.date)}" for i, one in counting.items()]
    hint = f"use one of {', '.join(listed[-8:])}" if listed else "check the model file: each model has its own checks"
    if which.isdecimal():
        found = [int(which)] if int(which) in counting else []
    else:
        found = [
            i for i, one in counting.items() if which.replace("T", " ") in (format_date(one.date), f"{one.date.date()}")
        ]
    if len(found) != 1:
        what = "no check that counts has" if not found else f"checks {', '.join(map(str, found))} have"
        raise InputError(f"{what} the number or date {which!r:.40}", file=file, hint=hint)
    return found[0]
