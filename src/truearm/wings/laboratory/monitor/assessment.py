"""The assessment of an arm's interim checks: whether the arm has changed since the first of them."""

from __future__ import annotations

import datetime
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from truearm.errors import InputError
from truearm.files.dates import format_date
from truearm.typing import IntArray
from truearm.wings.laboratory.monitor.control_chart import (
    CHECKS_NEEDED,
    DETECTED_WITHIN,
    MIN_BASELINE_CHECKS,
    MIN_CORRELATION_VALUES,
    MIN_LIMIT_VALUES,
    ControlChart,
    ControlRules,
    control_chart,
    control_rules,
)
from truearm.wings.laboratory.monitor.interim_check import CHECK_QUANTITIES, CheckValue, InterimCheck
from truearm.wings.laboratory.monitor.whole_check import LEAST_READINGS, SEEN, WholeCheck, whole_check
from truearm.wings.laboratory.standards.decision import Verdict, decide
from truearm.wings.laboratory.standards.specification import Specification

UNDECIDED_TEXT = (
    "Undecided: repeat the check before you recalibrate. Clean the artefacts first, and check that they are fixed."
)

WHOLE_CHECK_TEXT = (
    "Undecided: this check as a whole differs from the earlier ones. Make sure that it is of this arm, with this tip, "
    "and repeat it before you recalibrate."
)

_AFTER_UNEXPECTED = (
    "if a repeated check shows less, withdraw this one (--withdraw), or it counts among the first; if not, the arm has "
    "changed since its readings, or the model states too little: fit it again"
)

_START = datetime.datetime(2000, 1, 1)


class RecalibrationAdvice(StrEnum):
    """Whether to recalibrate."""

    YES = "yes"
    NO = "no"
    UNDECIDED = "undecided"
    NOT_ENOUGH = "not enough checks yet"


_NEXT_STEPS = {
    RecalibrationAdvice.YES: "Next: measure the arm again and fit a new model (truearm fit), which starts new charts.",
    RecalibrationAdvice.NO: "Next: measure the same poses again at your next check.",
    RecalibrationAdvice.UNDECIDED: "Next: repeat the check with clean artefacts, as a check of its own.",
    RecalibrationAdvice.NOT_ENOUGH: "Next: measure the same poses again on another day, and check again.",
}


@dataclass(frozen=True, eq=False)
class Trend:
    """A series of a history with its chart.

    Attributes
    ----------
    latest : CheckValue
        The latest value of the series.
    current : bool
        Whether that belongs to the last check.
    checks : (n,) int array
        The checks that contain the value, counted from 0.
    chart : ControlChart or None
        None where the quantity has no chart.
    limit_mm : float or None
        The limit of the specification; None where it states none.
    over_limit : bool
        Whether the latest value exceeds that limit by more than its uncertainty.
    over_before : bool
        Whether the value before did too, with the same sign.
    unexpected : bool
        Whether the latest value deviates by more than the uncertainty of the model explains, where its chart has too
        few checks to say whether it has changed.
    """

    latest: CheckValue
    current: bool
    checks: IntArray
    chart: ControlChart | None
    limit_mm: float | None
    over_limit: bool
    over_before: bool
    unexpected: bool

    @property
    def is_whole_check(self) -> bool:
        """Whether it compares all readings of a check with those before."""
        return CHECK_QUANTITIES[self.latest.quantity].artefact == "whole check"

    @property
    def since(self) -> int | None:
        """The first check of the present change; None where nothing has changed."""
        changed = None if self.chart is None else self.chart.since
        return None if changed is None else int(self.checks[changed])

    @property
    def explained_mm(self) -> float | None:
        """What deviation the uncertainty of the model explains, where that is compared: with few checks [mm]."""
        return None if self.chart is None or self.chart.enough else self.latest.largest_expected_mm

    @property
    def single_value_out_of_limits(self) -> bool:
        """Whether only the latest value is beyond the limits of its chart: dirt in a seat may be the cause."""
        return self.chart is not None and self.chart.change_index is None and self.since == int(self.checks[-1])

    @property
    def alarm(self) -> bool:
        """Whether it asks for recalibration or for another check."""
        return self.since is not None or self.over_limit

    @property
    def confirmed(self) -> bool:
        """Whether the alarm rests on more than the latest value."""
        return (self.since is not None and not self.single_value_out_of_limits) or (
            self.over_limit and self.over_before
        )

    @property
    def enough(self) -> bool:
        """Whether it has enough checks for the statement that nothing has changed."""
        return self.chart is not None and self.chart.enough


@dataclass(frozen=True, eq=False)
class Assessment:
    """The result of the control charts at the last check.

    Attributes
    ----------
    recalibrate : RecalibrationAdvice
    since : int or None
        The first check of the change, counted from 0; None where there is none, or none that is confirmed.
    reasons : tuple of str
        Why to recalibrate or to repeat the check.
    remarks : tuple of str
        What could not be assessed.
    n_before : int
        Number of earlier checks of that chart of the last check which has fewest.
    trends : tuple of Trend
        Those of the values of the last check in their order, of the whole check, then those of earlier checks.
    seen_mm : float or None
        The change of the readings against each other that this check would have shown with the probability
        `truearm.wings.laboratory.monitor.whole_check.SEEN`; None where there are too few checks in the same poses [mm].
    """

    recalibrate: RecalibrationAdvice
    since: int | None
    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    n_before: int
    trends: tuple[Trend, ...]
    seen_mm: float | None = None


def assess(
    checks: Sequence[InterimCheck], specification: Specification | None = None, *, retired: Collection[str] = ()
) -> Assessment:
    """Assess whether the arm has changed since the first checks.

    Yes: a chart signals a change (see `control_chart`), by its evidence or by two or more values in a row beyond
    the same limit; or the latest two values have the same sign and exceed their limit in the
    specification by more than the uncertainty of the artefact (ISO 14253-1). Quantities that the last check does not
    contain count with their latest values. Undecided: that is true of the latest value only, for which dirt in a
    seat may be the cause; or, with few checks, a value deviates by more than the uncertainty of the model explains.
    No: neither, and every chart of the last check has enough earlier checks.

    Parameters
    ----------
    checks : sequence of InterimCheck
        All of one model, in the order of their dates. Withdrawn ones are numbered and do not count.
    specification : Specification, optional
    retired : collection of str, optional
        Artefacts that were repaired or replaced, and are no longer assessed; for a length, one of its seats.

    Raises
    ------
    InputError
        If there is no check that counts, or a retired artefact is in the last check or in none.

    Notes
    -----
    The check as a whole has a chart of its own (`whole_check`). The rate of false alarms is shared among the charts
    that existed at each check, so that later checks do not change the result of an earlier one.
    """
    counted = [i for i, check in enumerate(checks) if check.withdrawn is None]
    if not counted:
        raise InputError("expected one check or more, got none")
    series, rules = _series(checks)
    _check_retired(retired, checks[counted[-1]], [checks[i] for i in counted])
    days = [(check.date - _START) / datetime.timedelta(days=1) for check in checks]
    by_key = [{value.key: value for value in check.values} for check in checks]
    trends = tuple(
        _trend([by_key[i][key] for i in series[key]], series[key], counted[-1], days, rules, specification)
        for key in dict.fromkeys((*by_key[counted[-1]], *series))
        if not any(by_key[series[key][-1]][key].uses(name) for name in retired)
    )
    current = [trend for trend in trends if trend.current and trend.chart is not None]
    whole = whole_check([_without(check, retired) for check in checks], rules, days)
    if whole is not None:
        of_last = sum(trend.current for trend in trends)
        trends = (*trends[:of_last], _whole_trend(whole, counted[-1]), *trends[of_last:])
    unexpected = [_unexpected(trend) for trend in current if trend.unexpected]
    first_checks = [trend.since for trend in trends if trend.since is not None and not trend.single_value_out_of_limits]
    reasons = [_reason(trend, trend.since) for trend in trends if trend.since is not None]
    reasons += [_over(trend) for trend in trends if trend.over_limit] + unexpected
    n_before = min((int(trend.chart.n_before[-1]) for trend in current if trend.chart is not None), default=0)
    remarks = (
        *_remarks(trends),
        *_poses_remark(checks, counted, whole),
        *([_AFTER_UNEXPECTED] if unexpected else []),
        *_not_compared(trends, specification),
    )
    seen = whole.seen_mm if whole is not None and whole.checks[-1] == counted[-1] else None
    advice = _advice(trends, current, is_unexpected=bool(unexpected))
    return Assessment(advice, min(first_checks, default=None), tuple(reasons), remarks, n_before, trends, seen)


def _series(checks: Sequence[InterimCheck]) -> tuple[dict[tuple[str, str, bool], list[int]], list[ControlRules]]:
    """The checks that have each value, and the rules of each check, which share the false alarms among its charts."""
    series: dict[tuple[str, str, bool], list[int]] = {}
    rules, has_readings = [], False
    for i, check in enumerate(checks):
        for value in check.values if check.withdrawn is None else ():
            series.setdefault(value.key, []).append(i)
        charted = [CHECK_QUANTITIES[name] for name, *_ in series if CHECK_QUANTITIES[name].charted]
        has_readings |= check.withdrawn is None and bool(check.readings)
        rules.append(control_rules(max(1, sum(quantity.n_sides for quantity in charted) + has_readings)))
    return series, rules


def _advice(trends: Sequence[Trend], current: Sequence[Trend], *, is_unexpected: bool) -> RecalibrationAdvice:
    if any(trend.confirmed for trend in trends):
        return RecalibrationAdvice.YES
    if is_unexpected or any(trend.alarm for trend in trends):
        return RecalibrationAdvice.UNDECIDED
    if current and all(trend.enough for trend in current):
        return RecalibrationAdvice.NO
    return RecalibrationAdvice.NOT_ENOUGH


def describe_assessment(assessment: Assessment, checks: Sequence[InterimCheck]) -> str:
    """The advice in one sentence."""
    advice = assessment.recalibrate
    if advice is RecalibrationAdvice.NO:
        return "No need to recalibrate: no value has changed by more than the scatter of the earlier checks."
    if advice is RecalibrationAdvice.NOT_ENOUGH:
        return (
            f"Not enough checks yet: {1 + assessment.n_before} with this one, {CHECKS_NEEDED} are needed to say that "
            "the arm has not changed."
        )
    if advice is RecalibrationAdvice.UNDECIDED:
        of_whole = any(trend.is_whole_check and trend.alarm for trend in assessment.trends)
        return WHOLE_CHECK_TEXT if of_whole else UNDECIDED_TEXT
    if assessment.since is None:
        return "Recalibrate: a value exceeds its limit in the specification, as it did in the check before."
    return (
        f"Recalibrate: a value has changed since check {assessment.since + 1} of "
        f"{format_date(checks[assessment.since].date)}."
    )


def describe_next_step(assessment: Assessment) -> str:
    """What people do after this check, in one sentence."""
    return _NEXT_STEPS[assessment.recalibrate]


def describe_power(assessment: Assessment) -> tuple[str, ...]:
    """What size of change this check would have shown; with few checks, what they cannot show yet."""
    n = assessment.n_before
    if assessment.recalibrate is RecalibrationAdvice.NO and assessment.seen_mm is not None:
        change = f"A change that moves these readings against each other by {assessment.seen_mm:.3f} mm"
        return (f"{change} (root mean square) would have been seen in {10 * SEEN:.0f} of 10 cases.",)
    if n >= MIN_BASELINE_CHECKS or assessment.recalibrate is RecalibrationAdvice.YES:
        return ()
    now = ["whether a value lies far from those before"] if n >= 2 else []
    if any(trend.latest.largest_expected_mm is not None for trend in assessment.trends):
        now.insert(0, "whether a value deviates by more than the uncertainty of the model explains")
    if any(trend.limit_mm is not None for trend in assessment.trends):
        now.append("whether a value exceeds its limit in the specification")
    phrase = " and ".join(part for part in (", ".join(now[:-1]), *now[-1:]) if part)
    shown = f"The checks show {phrase}" if now else "There is nothing yet to compare the values with"
    return (
        f"{shown}; that the arm is unchanged does not show before there are {CHECKS_NEEDED} checks.",
        (
            f"After {MIN_BASELINE_CHECKS} checks a gross change shows; after {2 * MIN_BASELINE_CHECKS} checks, in half "
            f"of the cases, a change of three standard deviations within {DETECTED_WITHIN} further checks."
        ),
    )


def describe_withdrawals(checks: Sequence[InterimCheck]) -> tuple[str, ...]:
    """The withdrawn checks, a sentence each."""
    return tuple(
        f"Check {i} of {format_date(one.date)} was withdrawn on {one.withdrawn.date.date()}: {one.withdrawn.reason}"
        for i, one in enumerate(checks, start=1)
        if one.withdrawn is not None
    )


def describe_acceptances(checks: Sequence[InterimCheck], *, but: str = "") -> tuple[str, ...]:
    """The checks that count though their readings were contradicted, but for that of a session, a sentence each."""
    return tuple(
        f"Check {i} of {format_date(one.date)}: {' '.join(one.accepted)}"
        for i, one in enumerate(checks, start=1)
        if one.accepted and one.withdrawn is None and one.session != but
    )


def describe_missing_limits(assessment: Assessment) -> str | None:
    """From how many checks the charts of the last check have limits; None where all have them."""
    charts = [trend.chart for trend in assessment.trends if trend.current and trend.chart is not None]
    if all(chart.shows_limits[-1] for chart in charts):
        return None
    return (
        f"limits of the charts are shown from {1 + MIN_LIMIT_VALUES} checks on; from fewer they would be many times "
        "too wide"
    )


def describe_correlations(assessment: Assessment) -> str:
    """How consecutive checks correlate, in the middle of the charts, in one phrase."""
    charts = [trend.chart for trend in assessment.trends if trend.chart is not None]
    known = [chart.correlation for chart in charts if chart.shows_correlation]
    if not known:
        u = MIN_CORRELATION_VALUES**-0.5
        return (
            f"the correlation of consecutive checks is stated from {MIN_CORRELATION_VALUES} checks on, which show it "
            f"with a standard uncertainty of {u:.1f}"
        )
    mean, low, high = np.median(known, axis=0)
    return (
        f"correlation of consecutive checks: {mean:.2f}, between {low:.2f} and {high:.2f} (median of "
        f"{len(known)} {'chart' if len(known) == 1 else 'charts'}); the limits allow for it"
    )


def is_measured(artefact: str, checks: Sequence[InterimCheck]) -> bool:
    """Whether a check has a value of an artefact; for a length, of one of its seats."""
    return any(value.uses(artefact) for check in checks for value in check.values)


def _check_retired(retired: Collection[str], last: InterimCheck, checks: Sequence[InterimCheck]) -> None:
    for name in retired:
        if is_measured(name, [last]):
            raise InputError(
                f"{name!r} is retired but is in the last check",
                hint="give a repaired or replaced artefact a new name in the session",
            )
        if not is_measured(name, checks):
            known = dict.fromkeys(value.artefact for check in checks for value in check.values)
            raise InputError(
                f"no check contains the retired artefact {name!r:.80}", hint=f"use one of {', '.join(known)}"[:200]
            )


def _trend(
    values: Sequence[CheckValue],
    at: Sequence[int],
    last: int,
    days: Sequence[float],
    rules: Sequence[ControlRules],
    specification: Specification | None,
) -> Trend:
    """The series `values` of the checks `at`; `days` and `rules` have those of every check, `last` is the last one."""
    latest = values[-1]
    quantity = CHECK_QUANTITIES[latest.quantity]
    chart = None
    if quantity.charted:
        chart = control_chart(
            [one.value_mm for one in values],
            u=[one.u_mm for one in values],
            rules=[rules[i] for i in at],
            days=[days[i] for i in at],
            scale=quantity.scale,
        )
    limit, over = _compare(latest, specification)
    over_before = (
        len(values) > 1 and _compare(values[-2], specification)[1] and values[-2].value_mm * latest.value_mm > 0
    )
    unexpected = (
        chart is not None and not chart.enough and latest.exceeds_expected([one.value_mm for one in values[:-1]])
    )
    return Trend(latest, at[-1] == last, np.array(at), chart, limit, over, over_before, unexpected)


def _without(check: InterimCheck, retired: Collection[str]) -> InterimCheck:
    """A check without the readings on retired artefacts."""
    return replace(check, readings=tuple(one for one in check.readings if one.name not in retired))


def _whole_trend(whole: WholeCheck, last: int) -> Trend:
    """The series of whole checks; no specification limits it, and no model states what to expect of it."""
    return Trend(
        whole.values[-1],
        whole.checks[-1] == last,
        np.array(whole.checks),
        whole.chart,
        limit_mm=None,
        over_limit=False,
        over_before=False,
        unexpected=False,
    )


def _poses_remark(checks: Sequence[InterimCheck], counted: Sequence[int], whole: WholeCheck | None) -> tuple[str, ...]:
    """Why a check with readings is not compared as a whole."""
    if (whole is not None and whole.checks[-1] == counted[-1]) or not checks[counted[-1]].readings:
        return ()
    if not any(checks[i].readings for i in counted[:-1]):
        return ()
    few = f"this check is not compared as a whole: fewer than {LEAST_READINGS} readings are in poses of earlier ones"
    return (f"{few}; measure the poses of the first check again",)


def _compare(value: CheckValue, specification: Specification | None) -> tuple[float | None, bool]:
    """The limit of the specification [mm], and whether a value exceeds it by more than its uncertainty."""
    if specification is None or not _comparable(value, specification):
        return None, False
    stated = [specification.limit(symbol, value.length_mm) for symbol in CHECK_QUANTITIES[value.quantity].symbols]
    limit = min((one for one in stated if one is not None), default=None)
    # k = 2
    over = limit is not None and decide(value.value_mm, 2 * value.u_artefact_mm, limit) is Verdict.NOT_CONFORM
    return limit, over


def _comparable(value: CheckValue, specification: Specification) -> bool:
    """Whether the limits of the specification apply to a value: to lengths, only at 20 degC."""
    if CHECK_QUANTITIES[value.quantity].artefact != "length":
        return True
    return value.length_mm is not None and specification.corrected_to_20_degC


def _reason(trend: Trend, since: int) -> str:
    assert trend.chart is not None
    if trend.single_value_out_of_limits:
        return f"{trend.latest.label}: beyond the limits of its chart in check {since + 1} only{_when_last(trend)}"
    if trend.chart.change_index is None:
        what = "beyond the limits of its chart since"
    elif trend.chart.gradual:
        what = "drift since about"
    else:
        what = "step at about"
    return f"{trend.latest.label}: {what} check {since + 1}{_when_last(trend)}"


def _over(trend: Trend) -> str:
    sign = "" if CHECK_QUANTITIES[trend.latest.quantity].scale else "+"
    only = "" if trend.over_before else f" in check {trend.checks[-1] + 1} only"
    return (
        f"{trend.latest.label}: {trend.latest.value_mm:{sign}.4f} mm exceeds the limit of {trend.limit_mm:.4f} mm"
        f"{only}{_when_last(trend)}"
    )


def _unexpected(trend: Trend) -> str:
    latest = trend.latest
    if latest.quantity == "diameter":
        what = f"{latest.value_mm:.4f} mm differs from the earlier checks by more than"
    else:
        sign = "" if CHECK_QUANTITIES[latest.quantity].scale else "+"
        what = f"{latest.value_mm:{sign}.4f} mm is beyond the {latest.largest_expected_mm:.4f} mm that"
    return f"{latest.label}: {what} the uncertainty of the model explains"


def _when_last(trend: Trend) -> str:
    return "" if trend.current else f", last measured in check {trend.checks[-1] + 1}"


def _remarks(trends: Sequence[Trend]) -> tuple[str, ...]:
    """Charts with too few checks beside others with enough, and charts without a value in the last check."""
    remarks = []
    some_enough = any(trend.enough for trend in trends)
    for trend in trends:
        if trend.chart is None or trend.alarm or trend.is_whole_check:
            continue
        n = f"{1 + trend.chart.n_before[-1]} of {CHECKS_NEEDED} checks"
        if not trend.current:
            then = "unchanged" if trend.enough else f"not assessed, {n},"
            remarks.append(f"{trend.latest.label}: not in this check; {then} in check {trend.checks[-1] + 1}")
        elif some_enough and not trend.enough:
            remarks.append(f"{trend.latest.label}: not assessed yet, {n}")
    return tuple(remarks)


def _not_compared(trends: Sequence[Trend], specification: Specification | None) -> tuple[str, ...]:
    """Lengths of the last check to which the limits of the specification do not apply."""
    if specification is None:
        return ()
    if not specification.corrected_to_20_degC:
        why = "its limits apply to lengths that are not corrected to 20 degC"
    else:
        why = "lengths are compared at 20 degC, and the expansion or the session's temperature is not known"
    return tuple(
        f"{trend.latest.label}: not compared with the specification: {why}"
        for trend in trends
        if trend.current
        and not _comparable(trend.latest, specification)
        and any(symbol in specification.limits for symbol in CHECK_QUANTITIES[trend.latest.quantity].symbols)
    )
