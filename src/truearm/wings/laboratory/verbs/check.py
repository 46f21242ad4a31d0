"""`check`: an interim check in a history of checks, which shows whether the arm has changed; `withdraw_check`."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truearm.acceptance import acceptance_remarks, accepting, accepts
from truearm.errors import InputError
from truearm.files.dates import format_date, now, parse_moment
from truearm.models import Compensator
from truearm.models.arm_check import with_serial_number
from truearm.pages.drawings.page_record import PageRecord, arm_row, input_files, version_row
from truearm.readings import Lengths, Session, check_sessions
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import (
    LengthsLike,
    ModelLike,
    SessionLike,
    check_angles_fit,
    model_file_fingerprint,
    session_lengths,
    to_model,
    to_session,
)
from truearm.verbs.outputs import check_output_is_not_input
from truearm.verbs.record import TableRecord, TextTable, agree, columns_of, format_fixed, number_of
from truearm.wings.laboratory.monitor.assessment import (
    Assessment,
    RecalibrationAdvice,
    Trend,
    assess,
    describe_acceptances,
    describe_assessment,
    describe_correlations,
    describe_missing_limits,
    describe_next_step,
    describe_power,
    describe_withdrawals,
)
from truearm.wings.laboratory.monitor.control_chart import CHECKS_NEEDED
from truearm.wings.laboratory.monitor.history import History, OtherModel, existing_history, number_of_check
from truearm.wings.laboratory.monitor.interim_check import (
    CHECK_QUANTITIES,
    InterimCheck,
    Withdrawal,
    artefacts_of,
    copy_remarks,
    counted,
    single_reading_remarks,
)
from truearm.wings.laboratory.monitor.recorded_check import RecordedCheck, record_check
from truearm.wings.laboratory.tasks.model_check import check_of_model
from truearm.wings.laboratory.verbs.verify import SpecificationLike, to_specification

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.pages.page import Page
    from truearm.pages.plotting import Figure


@dataclass(frozen=True, eq=False, repr=False)
class CheckResult(TableRecord, PageRecord):
    """An interim check beside the earlier checks of the model, and whether it is time to recalibrate.

    Attributes
    ----------
    record : RecordedCheck
        The check with its history and assessment.
    model : Compensator
    model_name : str
        Name of the model file, or of the kind of model.
    history : History
    head : (int, str)
        Its number of rows and its last checksum after this check.
    input_remarks : tuple of str
        What was ignored of session and lengths, and readings outside the trained range.
    readings : Session
        Those of this check.
    lengths : Lengths or None
        Known lengths between its seats.
    files : tuple of Path
        The files that were read.
    accept : str or None
        Why the readings are right where the model would refuse them.
    accepted : tuple of str
        What that overrode.
    """

    record: RecordedCheck
    model: Compensator
    model_name: str
    history: History
    head: tuple[int, str]
    input_remarks: tuple[str, ...]
    readings: Session
    lengths: Lengths | None
    files: tuple[Path, ...] = ()
    accept: str | None = None
    accepted: tuple[str, ...] = ()

    @property
    def input_files(self) -> tuple[Path, ...]:
        """See `PageRecord`."""
        return (*self.files, *self.history.store.files)

    @property
    def recalibrate(self) -> RecalibrationAdvice:
        """Whether to recalibrate."""
        return self.assessment.recalibrate

    @property
    def assessment(self) -> Assessment:
        """The charts of the values and what follows from them."""
        return self.record.assessment

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was accepted and ignored, what could not be judged, withdrawn checks, and results of other models."""
        withdrawn = describe_withdrawals(self.record.checks)
        return (*self._accepted, *self.input_remarks, *self.assessment.remarks, *withdrawn, *self.record.remarks)

    @property
    def _accepted(self) -> tuple[str, ...]:
        """What was accepted in this check, when the model was fitted, and in the checks of the history."""
        said = self.record.check.session if self.accepted else ""
        stored = describe_acceptances(self.record.checks, but=said)
        return (*self.accepted, *self.model.doubts(), *stored)

    def page(self) -> Page:
        """The advice, the points of this check in space, and the control charts."""
        from truearm.wings.laboratory.pages.interim_check_page import check_section, drift_page

        model = f"{self.model_name}, {self.model.n_train_} training readings, SHA-256 {self.record.check.model}"
        with accepting(self.accept):
            section = check_section(self.model, self.readings, self.lengths)
        return drift_page(
            self.record.checks,
            self.assessment,
            arm=self.model.arm.name,
            remarks=(*self._accepted, *self.record.remarks),
            more=() if section is None else (section,),
            facts=_page_facts(model, self.model.arm, self.history, self.head),
        )

    def figure(self) -> Figure | None:
        """The control charts."""
        from truearm.wings.laboratory.pages.interim_check_page import trend_figure

        charted = [trend for trend in self.assessment.trends if trend.chart is not None]
        return trend_figure(charted, self.record.checks) if charted else None

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        checks, record = self.record.checks, self.record
        yield describe_assessment(self.assessment, checks)
        yield from self.assessment.reasons
        yield from describe_power(self.assessment)
        last = record.last
        temperature = "" if last.temperature_degC is None else f", {last.temperature_degC:.1f} degC"
        yield f"check {1 + checks.index(last)} of {self.model_name}, {format_date(last.date)}{temperature}"
        if record.completed:
            yield "this session completes the last check of the history"
        elif not record.added:
            yield (
                f"this session is check {record.number} of {format_date(checks[record.number - 1].date)} in the "
                "history already, and is not added again; the results are those of the last check"
            )
        current = [trend for trend in self.assessment.trends if trend.current]
        rows = [_cells(trend) for trend in current]
        heads = [head for head in _HEADS if head in _HEADS[:2] or any(row[head] for row in rows)]
        words = (0, *(at for at, head in enumerate(heads) if head == "state"))
        yield TextTable(heads, [[row[head] for head in heads] for row in rows], words)
        charts = [trend.chart for trend in current if trend.chart is not None and trend.chart.n_before[-1] > 1]
        if charts:
            yield (
                "evidence: for a change against none, as a power of ten; above "
                f"{charts[0].rules.evidence:.2f} it shows a change"
            )
            if (missing := describe_missing_limits(self.assessment)) is not None:
                yield missing
            yield describe_correlations(self.assessment)
        yield from self.remarks
        yield describe_next_step(self.assessment)

    def columns(self) -> dict[str, list[Any]]:
        """A row for each value that is charted, with its last check."""
        return columns_of(map(_trend_json, self.assessment.trends))

    def _json(self) -> object:
        record, assessment = self.record, self.assessment
        last, since = record.last, assessment.since
        return {
            "added": record.added,
            "completed": record.completed,
            "model": last.model,
            "session": last.session,
            "date": format_date(last.date),
            "temperature_degC": last.temperature_degC,
            "n_checks": len(counted(record.checks)),
            "n_needed": CHECKS_NEEDED,
            "recalibrate": assessment.recalibrate,
            "seen_mm": assessment.seen_mm,
            "since": None if since is None else {"check": since + 1, "date": format_date(record.checks[since].date)},
            "reasons": assessment.reasons,
            "remarks": self.remarks,
            "withdrawn": [
                {
                    "check": number,
                    "date": format_date(one.date),
                    "withdrawn": format_date(one.withdrawn.date),
                    "reason": one.withdrawn.reason,
                }
                for number, one in enumerate(record.checks, start=1)
                if one.withdrawn is not None
            ],
            "history": dict(zip(("rows", "sha256"), self.head, strict=True)),
            "values": [_trend_json(trend) for trend in assessment.trends],
            "other_models": [_model_json(*one) for one in record.other_models],
        }


@one_blas_thread()
@accepts
def check(
    model: ModelLike,
    session: SessionLike,
    history: History | str | Path,
    *,
    lengths: LengthsLike | None = None,
    specification: SpecificationLike | None = None,
    retired: Sequence[str] = (),
    date: datetime.datetime | str | None = None,
    accept: str | None = None,
) -> CheckResult:
    """Check whether the arm is still as it was identified, and add the check to its history.

    Scatter, length error, form and diameter of a few readings in a seat, in both seats of a bar or on a sphere are
    compared with those of the earlier checks (control charts). A session that is in the history already is not added
    again; the last one is completed if it comes with more, such as lengths.

    Parameters
    ----------
    model : model or path
    session : Session, DataFrame or path
        Readings measured since the model was identified.
    history : History or path
        File of the checks so far, ``.sqlite``; the first check creates it.
    lengths : Lengths or path, optional
        Known lengths between seats of the session.
    specification : Specification or path, optional
        Limits for the values.
    retired : sequence of str
        Artefacts that were repaired or replaced, and are no longer assessed.
    date : datetime or str, optional
        Date of the check, such as ``2026-11-03`` or ``2026-11-03T08:30``; by default now.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept in the history, and later checks say them (docs/imperfect-readings.md).

    Returns
    -------
    CheckResult

    Raises
    ------
    InputError
        If the session has no readings to check, the model was trained on them, or the history is of another arm or
        has a later check. The history stays as it was.

    Examples
    --------
    >>> import tempfile
    >>> import truearm as ta
    >>> readings = ta.simulate("gao2017", poses=30, preset="perfect").session
    >>> model = ta.NominalModel(ta.load_arm("gao2017")).fit_readings(readings)
    >>> in_seats = ta.simulate("gao2017", poses=8, strategy="seat", seats=2, preset="perfect", seed=1).session
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result = ta.check(model, in_seats, f"{folder}/history.sqlite")
    >>> result.recalibrate.value
    'not enough checks yet'
    """
    files = input_files(model, session, lengths, specification)
    if isinstance(history, str | Path):
        check_output_is_not_input(history, *files)
    moment = now() if date is None else date if isinstance(date, datetime.datetime) else parse_moment(date)
    limits = None if specification is None else to_specification(specification)
    kept = history if isinstance(history, History) else History(history)
    fitted = to_model(model)
    readings = to_session(session, n_joints=fitted.arm.n_joints)
    remarks = [*map(str, check_angles_fit(readings, fitted.arm))]
    if fitted.is_trained_on(readings):
        raise readings.error(
            "these are the training readings of the model, which agree with it whatever the arm does",
            hint="use readings measured since",
        )
    known, ignored = session_lengths(lengths, readings)
    remarks += [*map(str, ignored), *single_reading_remarks(readings.seat, known)]
    remarks += copy_remarks(readings.angles, artefacts_of(readings.seat, readings.sphere, len(readings)))
    check_sessions(readings, known, own_frame="base" not in fitted.free)
    if outside := int(fitted.outside_training(readings.angles).sum()):
        have = agree(outside, "have")
        remarks.append(f"{outside} of {number_of(len(readings))} {have} a joint outside the trained range.")
    new = check_of_model(fitted, readings, known, date=moment, model_sha256=model_file_fingerprint(model))
    name = Path(model).name if isinstance(model, str | Path) else type(fitted).__name__
    unit = with_serial_number(fitted.arm_, readings).serial_number
    record = record_check(
        kept, new, specification=limits, retired=retired, name=name, arm=fitted.arm.name, serial_number=unit
    )
    return CheckResult(
        record,
        fitted,
        name,
        kept,
        kept.head,
        tuple(remarks),
        readings,
        known,
        files,
        accept,
        acceptance_remarks(accept),
    )


# Columns of the table; those after the second are shown where one of the values has an entry.
_HEADS = (
    *("value", "result [mm]", "model explains [mm]", "mean before [mm]"),
    *("limits of the chart [mm]", "evidence", "MPE [mm]", "state"),
)


def _cells(trend: Trend) -> dict[str, str]:
    """A row of the table."""
    chart, latest = trend.chart, trend.latest
    sign, quantity = latest.quantity == "length error", CHECK_QUANTITIES[latest.quantity]
    explained = "" if trend.explained_mm is None else f"{'up to ' if quantity.scale else '±'}{trend.explained_mm:.4f}"
    verdicts, mean, limits, evidence = {"over MPE": trend.over_limit}, "", "", ""
    if chart is not None and not np.isnan(chart.centre[-1]):
        mean = format_fixed(chart.centre[-1], sign=sign)
        low, high = chart.lower[-1], format_fixed(chart.upper[-1], sign=sign)
        limits = f"up to {high}" if np.isnan(low) else f"{format_fixed(low, sign=sign)} to {high}"
        limits = limits if chart.shows_limits[-1] else "\u2013"
        evidence = "" if np.isinf(chart.evidence[-1]) else f"{chart.evidence[-1]:.2f}"
        verdicts = {"beyond": chart.out_of_limits[-1], "changed": chart.signal_index is not None, **verdicts}
    limit = "" if trend.limit_mm is None else f"{trend.limit_mm:.4f}"
    state = ", ".join(verdict for verdict, applies in verdicts.items() if applies)
    cells = (latest.label, format_fixed(latest.value_mm, sign=sign), explained, mean, limits, evidence, limit, state)
    return dict(zip(_HEADS, cells, strict=True))


def _trend_json(trend: Trend) -> dict[str, object]:
    latest, chart = trend.latest, trend.chart
    row = {
        "check": trend.checks[-1] + 1,
        "quantity": latest.quantity,
        "artefact": latest.artefact,
        "value_mm": latest.value_mm,
        "u_mm": latest.u_mm,
        "u_artefact_mm": latest.u_artefact_mm,
        "largest_expected_mm": latest.largest_expected_mm,
        "unexpected": trend.unexpected,
        "at_20_degC": latest.length_mm is not None if latest.quantity == "length error" else None,
        "n": latest.n,
        "mpe_mm": trend.limit_mm,
        "over_mpe": trend.over_limit,
    }
    if chart is None:
        return row
    correlation = dict(zip(("mean", "low", "high"), chart.correlation, strict=True))
    return row | {
        "n_before": chart.n_before[-1],
        "mean_before_mm": chart.centre[-1],
        "lower_mm": chart.lower[-1],
        "upper_mm": chart.upper[-1],
        "beyond": chart.out_of_limits[-1],
        "correlation": correlation if chart.shows_correlation else None,
        "evidence": None if np.isinf(chart.evidence[-1]) else chart.evidence[-1],
        "evidence_of_a_change": chart.rules.evidence,
        "changed_since_check": None if trend.since is None else trend.since + 1,
    }


def _model_json(model: OtherModel, assessment: Assessment) -> dict[str, object]:
    return {
        "model": model.model,
        "name": model.name or None,
        "n_checks": len(counted(model.checks)),
        "last": format_date(model.last.date),
        "recalibrate": assessment.recalibrate,
    }


def _page_facts(model: str, arm: Arm, history: History, head: tuple[int, str]) -> list[tuple[str, str]]:
    """The sources of the charts."""
    stored = f"{history.store.name}: {head[0]} rows, last checksum {head[1]}"
    return [("model", model), arm_row(arm), ("history", stored), version_row()]


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
    history : History
    head : (int, str)
        Its number of rows and its last checksum after the withdrawal.
    """

    check: InterimCheck
    number: int
    checks: tuple[InterimCheck, ...]
    assessment: Assessment | None
    model: ModelLike
    history: History
    head: tuple[int, str]

    @property
    def input_files(self) -> tuple[Path, ...]:
        """See `PageRecord`."""
        return (*input_files(self.model), *self.history.store.files)

    def page(self) -> Page:
        """The control charts without the withdrawn check, which is struck through.

        Raises
        ------
        InputError
            If no check is left that counts.
        """
        from truearm.wings.laboratory.pages.interim_check_page import drift_page

        if self.assessment is None:
            raise InputError("no check of this model is left that counts: there is nothing to draw")
        arm = to_model(self.model).arm
        facts = _page_facts(f"SHA-256 {self.check.model}", arm, self.history, self.head)
        return drift_page(self.checks, self.assessment, arm=arm.name, facts=facts)

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        assert self.check.withdrawn is not None
        yield f"Check {self.number} of {format_date(self.check.date)} is withdrawn: {self.check.withdrawn.reason}"
        yield "It stays in the history with the reason, and no longer counts."
        if self.assessment is None:
            yield "No check of this model is left that counts, and there is nothing to draw on a page."
        else:
            yield f"Without it: {describe_assessment(self.assessment, self.checks)}"

    def _json(self) -> object:
        assert self.check.withdrawn is not None
        return {
            "check": self.number,
            "date": format_date(self.check.date),
            "reason": self.check.withdrawn.reason,
            "n_checks": len(counted(self.checks)),
            "recalibrate": None if self.assessment is None else self.assessment.recalibrate,
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
    kept = history if isinstance(history, History) else existing_history(Path(history))
    whose = model_file_fingerprint(model)
    known = kept.checks(whose)
    number = number_of_check(str(which).strip(), known, kept.store)
    withdrawal = Withdrawal(now(), reason)
    kept.withdraw(known[number - 1], withdrawal)
    checks = kept.checks(whose)
    assessment = assess(checks) if counted(checks) else None
    return WithdrawalResult(checks[number - 1], number, checks, assessment, model, kept, kept.head)
