"""``truearm check``: the five-minute test, put down in a history that tells whether the arm has changed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import (
    Json,
    SessionFile,
    check_output_is_not_input,
    check_page_path,
    print_json,
    print_line,
    print_status,
    print_table,
    progress,
    version_row,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from truearm.compensation.models import Compensator
    from truearm.readings import Lengths, Session
    from truearm.typing import BoolArray
    from truearm.verification.monitor.assessment import Assessment, Trend
    from truearm.verification.monitor.history import OtherModel
    from truearm.verification.monitor.interim_check import CheckValue, InterimCheck

CODES = {"no": 0, "yes": 1, "inconclusive": 3, "not enough checks yet": 3}


def check(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    session: SessionFile,
    history: Annotated[
        Path, typer.Option("--history", help="File of the checks so far, .sqlite; the first check makes it.")
    ],
    lengths: Annotated[
        Path | None, typer.Option("--lengths", help="File of known lengths between the session's seats, .csv.")
    ] = None,
    retired: Annotated[
        list[str] | None,
        typer.Option("--retired", help="Artefact that was mended or replaced, and is not asked any more."),
    ] = None,
    mpe: Annotated[
        Path | None, typer.Option("--mpe", help="The arm's specification: limits for the values, .toml.")
    ] = None,
    date: Annotated[
        str | None, typer.Option("--date", help="Day of the check, as 2026-11-03 or 2026-11-03T08:30; now by default.")
    ] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Page with the trend charts to write, .html.")] = None,
    as_json: Json = False,
) -> None:
    """Check whether the arm is still as it was identified.

    A few readings in a seat, in both seats of a bar, on a sphere. Scatter, error of the length, form and diameter are
    added to the history and charted: is it time to recalibrate, and since when? What was found on an artefact stands
    while it is left out. A session that is in the history already is not added again; the last one is completed if it
    comes with more, such as --lengths. Exit code 0: no need; 1: recalibrate; 3: check once more, or not enough checks
    to say.
    """
    from truearm.compensation.models.compensator import fingerprint
    from truearm.verification.monitor.history import History
    from truearm.verification.monitor.interim_check import InterimCheck
    from truearm.verification.monitor.recorded_check import record_check
    from truearm.verification.standards.dates import now, parse_moment
    from truearm.verification.standards.specification import read_specification

    files = [model, session, *(path for path in (lengths, mpe) if path is not None)]
    check_output_is_not_input(history, *files)
    if report is not None:
        check_page_path(report, *files, history)
    day = now() if date is None else parse_moment(date)
    specification = None if mpe is None else read_specification(mpe)
    kept = History(history)
    with progress(f"checking {session.name}"):
        fitted, readings = _readings(model, session)
        values, name = _values(fitted, readings, lengths), fitted.arm.name
        new = InterimCheck(day, _fingerprint(model), fingerprint(readings), _temperature(readings), values)
        record = record_check(kept, new, specification=specification, retired=retired or (), name=model.name, arm=name)
        checks, assessment = record.checks, record.assessment
        if report is not None:
            from truearm.pages.html import write_page
            from truearm.verification.monitor.interim_check_page import drift_page

            facts = _facts(fitted, model, history)
            write_page(drift_page(checks, assessment, arm=name, remarks=record.remarks, facts=facts), report)
    if as_json:
        entries = {"added": record.added, "completed": record.completed, **_for_machines(checks, assessment)}
        print_json({**entries, "other_models": [_of_another(*one) for one in record.other_models]})
    else:
        if record.completed:
            print_line("this session is in the history already and is completed")
        elif not record.added:
            print_line(
                f"this session is check {record.number} of {_when(checks[record.number - 1])} in the history already, "
                "and is not added again; the results are those of the last check"
            )
        _tell(checks, assessment, record.remarks, model=model, outside=fitted.outside_training(readings.angles))
        if report is not None:
            print_line(f"{report}: the trend charts")
    raise typer.Exit(CODES[assessment.recalibrate.value])


def _readings(model: Path, session: Path) -> tuple[Compensator, Session]:
    from truearm.workflows.inputs import check_angles_fit, to_model, to_session

    fitted = to_model(model)
    readings = to_session(session, n_joints=fitted.arm.n_joints)
    for remark in check_angles_fit(readings, fitted.arm):
        print_status(remark)
    if fitted.is_trained_on(readings):
        raise readings.error(
            "these are the readings that the model learned from, and they agree with it whatever the arm does",
            hint="readings taken since",
        )
    return fitted, readings


def _note_lone(readings: Session, lengths: Lengths | None) -> None:
    """Name seats of one reading, which say nothing: they are often another seat's, misspelt."""
    from collections import Counter
    from difflib import get_close_matches

    if readings.seat is None:
        return
    counts = Counter(readings.seat.tolist())
    ends = set() if lengths is None else {*lengths.seat_a.tolist(), *lengths.seat_b.tolist()}
    for name in sorted(name for name, count in counts.items() if name and count == 1 and name not in ends):
        close = get_close_matches(name, [other for other, count in counts.items() if other and count > 1], n=1)
        meant = f"; {close[0]!r}, misspelt?" if close else ""
        print_status(f"seat {name!r} has one reading, which is left out{meant}")


def _values(fitted: Compensator, readings: Session, lengths: Path | None) -> tuple[CheckValue, ...]:
    """The test values of the points that the model makes of the readings."""
    import numpy as np

    from truearm.errors import InputError
    from truearm.readings import check_sessions
    from truearm.verification.monitor.interim_check import interim_values
    from truearm.workflows.inputs import session_lengths

    known, remarks = session_lengths(lengths, readings)
    for remark in remarks:
        print_status(remark)
    _note_lone(readings, known)
    check_sessions(readings, known, own_frame="base" not in fitted.free)
    # What the model does not explain: the other part of its uncertainty is the same in every check.
    _, unexplained = fitted.covariance_parts(readings)
    std = np.sqrt(np.trace(unexplained, axis1=1, axis2=2) / 3)
    try:
        return interim_values(
            fitted.predict_readings(readings),
            std_mm=std,
            seat=readings.seat,
            sphere=readings.sphere,
            lengths=known,
            temperature_degC=_temperature(readings),
        )
    except InputError as error:
        raise error.in_file(readings.file) if readings.file is not None and error.file is None else error from None


def _temperature(readings: Session) -> float | None:
    return None if readings.temperature_degC is None else float(readings.temperature_degC.mean())


def _fingerprint(model: Path) -> str:
    """SHA-256 of the model file: another model, even of the same readings, starts a new baseline."""
    import hashlib

    with model.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _when(one: InterimCheck) -> str:
    from truearm.verification.standards.dates import format_date

    return format_date(one.date)


def _tell(
    checks: tuple[InterimCheck, ...], found: Assessment, changed: Sequence[str], *, model: Path, outside: BoolArray
) -> None:
    from truearm.verification.monitor.assessment import describe_assessment

    last = checks[-1]
    warm = "" if last.temperature_degC is None else f", {last.temperature_degC:.1f} degC"
    print_line(f"check {len(checks)} of {model.name}, {_when(last)}{warm}")
    current = [trend for trend in found.trends if trend.current]
    charts = [trend.chart for trend in current if trend.chart is not None and trend.chart.n_before[-1] > 1]
    heads = ["value", "found [mm]", "mean before [mm]", "limits of the chart [mm]", "drift", "MPE [mm]", ""]
    rows = [_cells(trend) for trend in current]
    shown = [i for i, head in enumerate(heads) if i < 2 or any(row[i] for row in rows)]
    print_table(
        [heads[i] for i in shown],
        [[row[i] for i in shown] for row in rows],
        left_aligned=(0, *(at for at, i in enumerate(shown) if not heads[i])),
    )
    if charts:
        interval = charts[0].rules.decision_interval
        print_line(
            f"drift: the larger cumulative sum, in standard deviations; above {interval:.2f} it tells of a change"
        )
    if outside.any():
        print_line(f"{int(outside.sum())} of {len(outside)} readings have a joint away from the training angles.")
    for remark in (*found.reasons, *found.remarks, *changed, describe_assessment(found, checks)):
        print_line(remark)


def _cells(trend: Trend) -> list[str]:
    chart, latest = trend.chart, trend.latest
    limit = "" if trend.limit_mm is None else f"{trend.limit_mm:.4f}"
    sign = "+" if latest.quantity == "length error" else ""
    if chart is None or chart.centre[-1] != chart.centre[-1]:
        return [latest.label, f"{latest.value_mm:{sign}.4f}", "", "", "", limit, "over" if trend.over_limit else ""]
    low, high = chart.lower[-1], chart.upper[-1]
    between = f"up to {high:.4f}" if low != low else f"{low:{sign}.4f} to {high:{sign}.4f}"
    said = [
        *(["beyond"] if chart.out_of_limits[-1] else []),
        *(["drift"] if chart.signal_index is not None else []),
        *(["over"] if trend.over_limit else []),
    ]
    return [
        latest.label,
        f"{latest.value_mm:{sign}.4f}",
        f"{chart.centre[-1]:{sign}.4f}",
        between,
        f"{chart.cusum[:, -1].max():.2f}",
        limit,
        ", ".join(said),
    ]


def _for_machines(checks: tuple[InterimCheck, ...], found: Assessment) -> dict[str, Any]:
    from truearm.verification.monitor.control_chart import MIN_BASELINE_CHECKS

    last = checks[-1]
    since = None if found.since is None else {"check": found.since + 1, "date": _when(checks[found.since])}
    return {
        "model": last.model,
        "session": last.session,
        "date": _when(last),
        "temperature_degC": last.temperature_degC,
        "n_checks": len(checks),
        "n_needed": MIN_BASELINE_CHECKS,
        "recalibrate": found.recalibrate.value,
        "since": since,
        "reasons": list(found.reasons),
        "remarks": list(found.remarks),
        "values": [_of_trend(trend) for trend in found.trends],
    }


def _of_trend(trend: Trend) -> dict[str, Any]:
    latest, chart = trend.latest, trend.chart
    row = {
        "check": int(trend.checks[-1]) + 1,
        "quantity": latest.quantity,
        "artefact": latest.artefact,
        "value_mm": latest.value_mm,
        "u_mm": latest.u_mm,
        "u_artefact_mm": latest.u_artefact_mm,
        "at_20_degC": latest.length_mm is not None if latest.quantity == "length error" else None,
        "n": latest.n,
        "mpe_mm": trend.limit_mm,
        "over_mpe": trend.over_limit,
    }
    if chart is not None:
        row |= {
            "n_before": int(chart.n_before[-1]),
            "mean_before_mm": _or_none(chart.centre[-1]),
            "lower_mm": _or_none(chart.lower[-1]),
            "upper_mm": _or_none(chart.upper[-1]),
            "beyond": bool(chart.out_of_limits[-1]),
            "cusum_up": float(chart.cusum[0, -1]),
            "cusum_down": float(chart.cusum[1, -1]),
            "decision_interval": chart.rules.decision_interval,
            "changed_since_check": None if trend.since is None else trend.since + 1,
        }
    return row


def _of_another(model: OtherModel, found: Assessment) -> dict[str, Any]:
    return {
        "model": model.model,
        "name": model.name or None,
        "n_checks": len(model.checks),
        "last": _when(model.checks[-1]),
        "recalibrate": found.recalibrate.value,
    }


def _or_none(number: float) -> float | None:
    return float(number) if number == number else None


def _facts(fitted: Compensator, model: Path, history: Path) -> list[tuple[str, str]]:
    return [
        ("model", f"{model.name}, {fitted.n_train_} training readings, SHA-256 of the file {_fingerprint(model)}"),
        ("arm", f"{fitted.arm.name}: {fitted.arm.title}. {fitted.arm.source}"),
        ("history", history.name),
        version_row(),
    ]
