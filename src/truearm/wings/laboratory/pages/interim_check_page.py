"""The page of an arm's interim checks: whether to recalibrate, and the trend charts with their limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.files.dates import format_date
from truearm.models import Compensator
from truearm.number_format import RoundedNumber, capitalize, format_count, show_mm
from truearm.pages.drawings.arm_scene import arm_at_readings, readings_scene
from truearm.pages.drawings.workspace_figures import error_in_workspace
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.palette import FAINT, INK, LIMIT, NAVY, ORANGE
from truearm.pages.plotting import Figure, figure_style, join_phrases, make_panel, shorten, styles_of
from truearm.readings import Lengths, Session
from truearm.readings.thermal_expansion import ThermalExpansion
from truearm.typing import FloatArray, IntArray
from truearm.wings.laboratory.monitor.assessment import (
    Assessment,
    RecalibrationAdvice,
    Trend,
    describe_assessment,
    describe_correlations,
    describe_missing_limits,
    describe_power,
    describe_withdrawals,
)
from truearm.wings.laboratory.monitor.control_chart import MIN_BASELINE_CHECKS, MIN_LIMIT_VALUES, ControlChart
from truearm.wings.laboratory.monitor.expected_values import U_OF_STATED
from truearm.wings.laboratory.monitor.interim_check import InterimCheck, artefacts_of, counted, interim_deviations

_MOST_ROWS = 60
_MOST_TICKS = 4
_DATE_SHARE = 0.3  # of an axis: from a date to the next one, of which one may be at an end
_REASONS_ABOVE = 2  # with the verdict; the answer below has the others


def drift_page(
    checks: Sequence[InterimCheck],
    assessment: Assessment,
    *,
    arm: str,
    remarks: Sequence[str] = (),
    more: Sequence[Section] = (),
    facts: Sequence[tuple[str, str]] = (),
) -> Page:
    """Lay out the page of an arm's interim checks.

    Parameters
    ----------
    checks : sequence of InterimCheck
        All of one model in the order of their dates; one or more.
    assessment : Assessment
        Of these checks.
    arm : str
        Its name.
    remarks : sequence of str
        On checks of other models.
    more : sequence of Section
        After the answer, such as the points of this check.
    facts : sequence of (str, str)
        Model, arm, history and versions.
    """
    first, last = format_date(checks[0].date), format_date(checks[-1].date)
    rows = [
        LabelledValue("is it time to recalibrate?", assessment.recalibrate.value, state=_STATES[assessment.recalibrate])
    ]
    if assessment.since is not None:
        rows += [LabelledValue("changed since", format_date(checks[assessment.since].date))]
    rows.append(LabelledValue("checks with this model", len(counted(checks))))
    return Page(
        title=f"{arm}: interim checks",
        subtitle=f"{format_count(len(checks), 'check')}, {first} to {last}."
        if len(checks) > 1
        else f"One check, {first}.",
        summary=tuple(rows),
        sections=drift_sections(checks, assessment, remarks, more=more),
        facts=tuple(facts),
        verdict=PageVerdict(
            describe_assessment(assessment, checks),
            _STATES[assessment.recalibrate],
            " ".join(f"{capitalize(reason)}." for reason in assessment.reasons[:_REASONS_ABOVE])
            or " ".join(describe_power(assessment)),
        ),
    )


_STATES: dict[RecalibrationAdvice, State] = {
    RecalibrationAdvice.NO: "good",
    RecalibrationAdvice.NOT_ENOUGH: "doubtful",
    RecalibrationAdvice.UNDECIDED: "doubtful",
    RecalibrationAdvice.YES: "bad",
}


def drift_sections(
    checks: Sequence[InterimCheck], assessment: Assessment, remarks: Sequence[str] = (), *, more: Sequence[Section] = ()
) -> tuple[Section, ...]:
    """Sections: the answer with the last check's values, `more`, the charts, all checks, and the method."""
    return (
        Section(
            "Is it time to recalibrate?",
            _answer(checks, assessment, remarks),
            tables=(_last_table([trend for trend in assessment.trends if trend.current]),),
        ),
        *more,
        *([Section("Trends", figures=figures)] if (figures := _figures(checks, assessment)) else []),
        Section("The checks", tables=(_checks_table(checks, assessment.trends),), folded=True),
        Section("Method", _METHOD, folded=True),
    )


_METHOD = (
    "Each value is compared with the values of the earlier checks since the arm was identified: their mean and their "
    "scatter show how well it repeats. The limits become narrower with every check.\n\n"
    "Lengths are compared with the "
    "specification at 20 degC only. A length is corrected to 20 degC where the artefact's expansion and the "
    f"temperature are known, the temperature to {ThermalExpansion.artefact_u_K:g} K (standard uncertainty). The "
    "result of an artefact remains until the artefact is measured again or retired.\n\n"
    "A value beyond its limits shows a large change, the evidence for a change a small or slow one: how many times "
    "better a step or a drift explains the values than none, as a power of ten. Its beginning is where a step or a "
    "drift fits the values best; for a slow drift it is uncertain. The limits and the evidence that is needed depend "
    "on the number of charts in the history: for an arm that has not changed, one check in 370 has a value beyond its "
    "limits, and one in 370 evidence of a change. Checks of consecutive days may resemble each other; limits and "
    "evidence allow for a correlation of consecutive checks up to 0.75, as these checks leave it possible.\n\n"
    "The whole check: the deviations of its readings from their seats and spheres, less the mean of the earlier checks "
    "in the same poses, root mean square. Another arm, a bent link or another tip changes this pattern, even where "
    "scatter and length stay the same.\n\n"
    "One value beyond its limits, or over the "
    "limit of the specification, may be caused by dirt in a seat: repeat the check. Recalibrate after two in a row on "
    f"the same side, or when the evidence shows a change.\n\n"
    f"With fewer than {MIN_BASELINE_CHECKS} "
    "earlier checks, the scatter is at least that which the model expects, and the answer is never “no”. Then values "
    "are also compared with what the uncertainty of the model explains: a scatter and a form up to that value, a "
    "length error of either sign up to it, a diameter in its difference from the earlier ones. One check in 370 of an "
    "arm that is as its model states is beyond; the stated uncertainty itself is taken as known to "
    f"{100 * U_OF_STATED:.0f} %. Interim "
    "checks take fewer points than the tests of the standards and do not replace them."
)


def trend_figure(trends: Sequence[Trend], checks: Sequence[InterimCheck]) -> Figure:
    """Draw the charts of the trends that have one, the values above and the evidence of a change below.

    Parameters
    ----------
    trends : sequence of Trend
        At least one with a chart.
    checks : sequence of InterimCheck
        All checks, for their dates.
    """
    charted = [(trend, trend.chart) for trend in trends if trend.chart is not None]
    with figure_style():
        panels = tuple(_panel(trend, chart, checks) for trend, chart in charted)
    ends = join_phrases(f"{trend.latest.label} {trend.latest.value_mm:.4f} mm" for trend, _ in charted)
    return Figure(
        panels,
        caption="Above: the value of each check; grey: its limits and the mean, from earlier checks "
        f"(from check {1 + MIN_LIMIT_VALUES} on); orange: beyond the limits; dotted: the limit of the specification. "
        "Below: the evidence of a change, as a power of ten, with what shows one. Orange line: its beginning. "
        "Below the axis: number and date of the check.",
        alt=f"Control charts of {format_count(len(charted), 'value')} over the checks. Their last values: {ends}.",
        columns=2,
    )


def few_checks_figure(trends: Sequence[Trend], checks: Sequence[InterimCheck]) -> Figure:
    """Draw the values of the first checks in one panel, each as a share of what the model explains.

    Parameters
    ----------
    trends : sequence of Trend
        With a chart and an explained deviation.
    checks : sequence of InterimCheck
        All checks, for their dates; fewer than charts need. Withdrawn ones do not count.
    """
    needed, n = 1 + MIN_LIMIT_VALUES, len(counted(checks))
    end = max(len(checks), len(checks) + needed - n)
    height_in = 2.9 + 0.19 * -(-len(trends) // 2)  # the names stand below
    with figure_style():
        drawing, (axes,) = make_panel(4.6, height_in)
        pens = styles_of(trend.latest.label for trend in trends)
        for trend in trends:
            assert trend.chart is not None
            assert trend.explained_mm is not None
            pen, values = pens[trend.latest.label], trend.chart.values
            is_absolute = trend.latest.quantity == "diameter"  # of a sphere: nobody states it
            share = 100 * (values - (values.mean() if is_absolute else 0.0)) / trend.explained_mm
            axes.plot(
                trend.checks + 1, share, color=pen.colour, marker=pen.marker, linestyle=pen.dash, markersize=3.5,
                label=shorten(trend.latest.label),
            )  # fmt: skip
        for edge in (-100.0, 100.0):
            axes.axhline(edge, color=LIMIT, linewidth=0.9)
        axes.axvspan(len(checks) + 0.5, end + 0.5, color=FAINT, alpha=0.4, linewidth=0)
        axes.set_title(f"too few yet: {n} of {needed} checks for limits")
        axes.set_ylabel("value / explained [%]")
        axes.set_xlim(0.4, end + 0.6)
        ends = [1, len(checks)] if len(checks) - 1 >= _DATE_SHARE * end else [len(checks)]
        dates = {i: f"\n{checks[i - 1].date.date()}" for i in ends}
        axes.set_xticks(range(1, end + 1), [f"{i}{dates.get(i, '')}" for i in range(1, end + 1)])
        drawing.subplots_adjust(bottom=(height_in - 2.4) / height_in)
        drawing.legend(loc="lower left", ncols=2, bbox_to_anchor=(0.0, 0.0), borderaxespad=0.0)
    return Figure(
        (drawing,),
        caption="Each value as a share of what the uncertainty of the model explains, between the grey lines; a "
        f"diameter by its difference from the mean. The charts with limits begin with check {end}.",
        alt=f"Values of {n} checks as shares of what the model explains; {needed} checks are needed.",
        columns=2,
    )


def temperature_figure(checks: Sequence[InterimCheck]) -> Figure:
    """Draw the temperature of the checks that have one; at least one has."""
    known = [
        (i, check.temperature_degC)
        for i, check in enumerate(checks, start=1)
        if check.temperature_degC is not None and check.withdrawn is None
    ]
    number, degC = zip(*known, strict=True)
    with figure_style():
        drawing, (axes,) = make_panel(4.6, 1.9)
        axes.plot(number, degC, "o-", color=INK, markersize=3, linewidth=0.7)
        middle, half = (max(degC) + min(degC)) / 2, max((max(degC) - min(degC)) * 0.6, 0.5)
        axes.set(ylabel="temperature [degC]", ylim=(middle - half, middle + half))
        _checks_axis(axes, checks)
    return Figure(
        (drawing,),
        caption="Mean temperature of the readings of each check. A trend that follows it is not due to the arm alone.",
        alt=f"Temperature of the checks, {min(degC):.1f} to {max(degC):.1f} degC.",
        columns=2,
    )


def _answer(checks: Sequence[InterimCheck], assessment: Assessment, remarks: Sequence[str]) -> str:
    """What the verdict above does not say already."""
    phrases = (*assessment.reasons[_REASONS_ABOVE:], *assessment.remarks, *remarks)
    sentences = [f"{capitalize(phrase)}." for phrase in phrases]
    sentences += [f"{one}." for one in describe_withdrawals(checks)]
    on_charts = [describe_missing_limits(assessment), describe_correlations(assessment)]
    sentences.append(" ".join(f"{capitalize(phrase)}." for phrase in on_charts if phrase is not None))
    power = describe_power(assessment) if assessment.reasons else ()
    return "\n\n".join([*power, *sentences])


def _last_table(trends: Sequence[Trend]) -> Table:
    with_model = any(trend.explained_mm is not None for trend in trends)
    with_limit = any(trend.limit_mm is not None for trend in trends)
    columns = [
        Column("value"),
        Column("measured", "mm"),
        Column("readings"),
        *([Column("the model explains", "mm")] if with_model else []),
        Column("mean of earlier checks", "mm"),
        Column("lower limit", "mm"),
        Column("upper limit", "mm"),
        Column("evidence of a change"),
        *([Column("limit of the specification", "mm")] if with_limit else []),
        Column("state"),
    ]
    rows: list[tuple[Cell, ...]] = []
    for trend in trends:
        chart = trend.chart
        u = trend.latest.u_mm
        cells: list[Cell] = [trend.latest.label, RoundedNumber(trend.latest.value_mm, u), trend.latest.n]
        if with_model:
            cells.append(None if trend.explained_mm is None else RoundedNumber(trend.explained_mm, u))
        if chart is None or np.isnan(chart.centre[-1]):
            cells += [None] * 4
        else:
            limits = (chart.lower[-1], chart.upper[-1]) if chart.shows_limits[-1] else (np.nan, np.nan)
            edges = (float(edge) for edge in (chart.centre[-1], *limits))
            cells += [None if np.isnan(edge) else RoundedNumber(edge, u) for edge in edges]
            cells.append(None if np.isinf(chart.evidence[-1]) else float(chart.evidence[-1]))
        if with_limit:
            cells.append(None if trend.limit_mm is None else RoundedNumber(trend.limit_mm, u))
        rows.append((*cells, _verdict(trend)))
    # Of few checks there are no limits yet: an empty column says nothing, and on a telephone takes the room of others.
    shown = [i for i in range(len(columns)) if any(row[i] is not None for row in rows)]
    return Table(
        tuple(columns[i] for i in shown),
        tuple(tuple(row[i] for i in shown) for row in rows),
        "The last check and the earlier ones.",
        states=tuple(_state(trend) for trend in trends),
    )


def _state(trend: Trend) -> State:
    if trend.alarm or trend.unexpected:
        return "bad" if trend.confirmed else "doubtful"
    return "good" if trend.enough else "none"


def _verdict(trend: Trend) -> str:
    chart = trend.chart
    states = ["exceeds the limit of the specification"] if trend.over_limit else []
    if chart is not None:
        states += ["changed"] if chart.signal_index is not None else []
        states += ["beyond its limits"] if chart.out_of_limits[-1] else []
        states += ["beyond what the model explains"] if trend.unexpected else []
        if not states:
            states = ["unchanged"] if chart.enough else ["too few checks"]
    return ", ".join(states) or "without a chart"


def _figures(checks: Sequence[InterimCheck], assessment: Assessment) -> tuple[Figure, ...]:
    figures = []
    charts = [trend.chart for trend in assessment.trends if trend.chart is not None]
    if any(chart.shows_limits.any() for chart in charts):
        figures.append(trend_figure(assessment.trends, checks))
    elif len(checks) > 1 and (explained := [trend for trend in assessment.trends if trend.explained_mm]):
        figures.append(few_checks_figure(explained, checks))
    if sum(check.temperature_degC is not None for check in counted(checks)) > 1:
        figures.append(temperature_figure(checks))
    return tuple(figures)


def _checks_table(checks: Sequence[InterimCheck], trends: Sequence[Trend]) -> Table:
    columns = [Column("check"), Column("date"), Column("temperature", "degC")]
    columns += [Column(trend.latest.label, "mm") for trend in trends]
    any_withdrawn = len(counted(checks)) < len(checks)
    if any_withdrawn:
        columns.append(Column("withdrawn"))
    rows: list[tuple[Cell, ...]] = []
    for number, check in list(enumerate(checks, start=1))[-_MOST_ROWS:]:
        values = {value.key: RoundedNumber(value.value_mm, value.u_mm) for value in check.values}
        degC = None if check.temperature_degC is None else RoundedNumber(check.temperature_degC, 1.0)
        rows.append(
            (
                number,
                format_date(check.date).replace("-", "\u2011"),
                degC,
                *(values.get(trend.latest.key) for trend in trends),
                *([check.withdrawn.reason if check.withdrawn else None] if any_withdrawn else []),
            )
        )
    which = f"The last {_MOST_ROWS} of {len(checks)} checks." if len(checks) > _MOST_ROWS else "All checks."
    states: list[State] = ["withdrawn" if check.withdrawn else "none" for check in checks[-_MOST_ROWS:]]
    return Table(tuple(columns), tuple(rows), which, states=tuple(states))


def _panel(trend: Trend, chart: ControlChart, checks: Sequence[InterimCheck]) -> Drawing:
    drawing, (above, below) = make_panel(4.6, 3.4, rows=2)
    number = trend.checks + 1
    _values(above, number, chart)
    if trend.limit_mm is not None and trend.limit_mm < above.get_ylim()[1]:
        above.axhline(trend.limit_mm, color=INK, linewidth=0.8, linestyle=":")
    above.set_title(shorten(trend.latest.label, longest=44))
    above.set_ylabel("[mm]")
    below.plot(number, chart.evidence, color=NAVY, linewidth=1.0)
    needed = chart.rules.evidence
    below.axhline(needed, color=LIMIT, linewidth=0.9)
    below.set_ylim(-2.0, 1.25 * max(needed, float(chart.evidence.max())))
    below.set_ylabel("evidence")
    _checks_axis(below, checks)
    if trend.since is not None:
        for axes in (above, below):
            axes.axvline(trend.since + 0.5, color=ORANGE, linewidth=1.0, zorder=1)
    return drawing


def _values(axes: Axes, number: IntArray, chart: ControlChart) -> None:
    drawn = chart.shows_limits
    shown = [chart.values, chart.upper[drawn], chart.lower[drawn][~np.isnan(chart.lower[drawn])]]
    low, high = (float(f(np.concatenate(shown))) for f in (np.min, np.max))
    room = max(0.08 * (high - low), 0.0005)
    lower = np.where(np.isnan(chart.lower), low - room, chart.lower)
    axes.fill_between(number[drawn], lower[drawn], chart.upper[drawn], color=FAINT, alpha=0.6, linewidth=0, zorder=0)
    axes.plot(number[drawn], chart.centre[drawn], color=LIMIT, linewidth=0.9, zorder=1)
    for edge in (chart.lower, chart.upper):
        axes.plot(number[drawn], edge[drawn], color=LIMIT, linewidth=0.9, zorder=1)
    axes.plot(number, chart.values, "o-", color=NAVY, markersize=3, linewidth=0.7, zorder=2)
    axes.plot(
        number[chart.out_of_limits], chart.values[chart.out_of_limits], "o", color=ORANGE, markersize=4.5, zorder=3
    )
    axes.set_ylim(low - room, high + room)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.locator_params(axis="y", nbins=5)


def _checks_axis(axes: Axes, checks: Sequence[InterimCheck]) -> None:
    """Number and date of some of the checks; equal steps, so that many checks of one day can be read too."""
    n = len(checks)
    low, high = 0.4, max(n, 2) + 0.6
    axes.set_xlim(low, high)
    shown = sorted({1 + round(share * (n - 1)) for share in np.linspace(0, 1, _MOST_TICKS)})
    dated: list[int] = []
    for i in (shown[0], shown[-1], *shown[1:-1]):
        if all(abs(i - other) >= _DATE_SHARE * (high - low) for other in dated):
            dated.append(i)
    axes.set_xticks(shown, [f"{i}\n{checks[i - 1].date.date()}" if i in dated else str(i) for i in shown])
    if n > 1:  # a date at an end is wider than the margin
        labels = axes.get_xticklabels()
        labels[0].set_horizontalalignment("left")
        labels[-1].set_horizontalalignment("right")


def check_section(model: Compensator, readings: Session, lengths: Lengths | None) -> Section | None:
    """The points of a check with how far each lies from its seat's mean, or from its sphere.

    Parameters
    ----------
    model : Compensator
    readings : Session
    lengths : Lengths or None
        Known lengths between the seats.

    Returns
    -------
    Section or None
        None where no seat has two readings, and there is no sphere.
    """
    points = model.predict_readings(readings)
    # Unexplained by the model: the other part of its uncertainty moves the points of a seat alike.
    _, unexplained = model.covariance_parts(readings)
    std_mm = np.sqrt(np.trace(unexplained, axis1=1, axis2=2) / 3)
    deviation = np.linalg.norm(interim_deviations(points, seat=readings.seat, sphere=readings.sphere), axis=1)
    rows = np.flatnonzero(np.isfinite(deviation))
    if not len(rows):
        return None
    artefacts = artefacts_of(readings.seat, readings.sphere, len(readings))
    worst = int(np.argmax(deviation[rows]))
    where = f"{readings.called(int(rows[worst]))}, {artefacts[rows[worst]]}"
    still = error_in_workspace(points[rows], deviation[rows])
    caption = (
        "Each point has the colour of its distance from the mean of its seat, or from the sphere through the points of "
        f"its sphere. On a screen a ring marks the largest, {show_mm(float(deviation[rows[worst]]))}: {where}."
    )
    mechanism = arm_at_readings({"": model}, readings)
    scene = readings_scene(
        points[rows],
        {"": deviation[rows]},
        readings.angles[rows],
        what="deviation",
        names=[f"{readings.called(row)}, {artefacts[row]}" for row in rows.tolist()],
        joint_names=model.arm.joint_names,
        sliding=model.arm.chain.is_prismatic.tolist(),
        still=replace(still, caption=caption, alt=f"{format_count(len(rows), 'point')} of the check. {caption}"),
        shown="",
        std_mm=std_mm[rows],
        mechanism=mechanism,
        lines=_bars(points, readings, lengths),
        marked={worst: str(artefacts[rows[worst]])},
    )
    return Section("The points of this check", scenes=(scene,))


def _bars(points: FloatArray, readings: Session, lengths: Lengths | None) -> Sequence[FloatArray]:
    """Lines between the means of seats whose distance is known."""
    seats = readings.seat
    if lengths is None or seats is None:
        return []
    pairs = zip(lengths.seat_a.tolist(), lengths.seat_b.tolist(), strict=True)
    ends = [[seats == one for one in pair] for pair in pairs]
    return [np.stack([points[rows].mean(axis=0) for rows in pair]) for pair in ends if all(rows.any() for rows in pair)]
