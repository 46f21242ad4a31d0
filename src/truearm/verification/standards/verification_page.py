"""A verification as a page: the decision, every value against its limit, its uncertainty budget, and the artefacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal
from math import inf, isinf

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Rectangle

from truearm.pages.number_format import (
    RoundedNumber,
    capitalize,
    format_count,
    format_exact,
    format_in_text,
    format_number,
    format_percent,
)
from truearm.pages.page import Cell, Column, LabelledValue, Page, Section, Table
from truearm.pages.plotting import INK, LIMIT, Figure, Style, figure_style, join_phrases, shorten
from truearm.verification.standards import decision
from truearm.verification.standards.artefacts import CalibratedBar, CalibratedSphere
from truearm.verification.standards.decision import (
    COVERAGE_PROBABILITY,
    SIMPLE_RATIO,
    Budget,
    DecisionRule,
    Verdict,
    simple_applies,
)
from truearm.verification.standards.verification_plan import CHECK_STANDARD
from truearm.verification.standards.verification_record import VerificationRecord

# Shape, colour and place of each verdict, told apart in black and white too.
_PENS = {
    Verdict.CONFORM: Style("#12407a", "o", "-"),
    Verdict.UNDECIDED: Style("#a8488f", "D", "-"),
    Verdict.NOT_CONFORM: Style("#d9730d", "X", "-"),
}
_INSIDE = "#dce6f2"
_WIDTH_IN, _LABELS_IN, _ROW_IN, _HEAD_IN, _FOOT_IN = 6.0, 2.15, 0.31, 0.12, 0.95
_MOST_ROWS = 60
_UNROUNDED = "Compared are the values before rounding."
LEVEL_TEXT = format_in_text(round(100 * COVERAGE_PROBABILITY, 2), unit="%", digits=4)


def verification_page(outcome: VerificationRecord, *, facts: Sequence[tuple[str, str]] = ()) -> Page:
    """Lay out a verification.

    Parameters
    ----------
    outcome : VerificationRecord
    facts : sequence of (str, str)
        What the page rests on.
    """
    nearest = max(outcome.rows_with_limit, key=_share_of_limit)
    taken = f"of its limit taken by value and uncertainty: {name_of(nearest)}"
    return Page(
        title=f"{outcome.specification.name}: {outcome.verification.verdict.value}",
        subtitle=f"{outcome.plan.title}. Limits: {outcome.specification.source}.",
        summary=(
            LabelledValue("decision", outcome.verification.verdict.value),
            LabelledValue(taken, format_percent(_share_of_limit(nearest))),
            LabelledValue("values with a limit", len(outcome.rows_with_limit)),
        ),
        sections=verification_sections(outcome),
        facts=tuple(facts),
    )


def certificate_page(
    outcome: VerificationRecord,
    *,
    number: str,
    administrative_data: Sequence[tuple[str, Sequence[tuple[str, str]]]],
    facts: Sequence[tuple[str, str]] = (),
) -> Page:
    """Lay out a calibration certificate: a verification with who, what, when and where.

    Parameters
    ----------
    outcome : VerificationRecord
    number : str
        Of the certificate.
    administrative_data : sequence of (str, sequence of (str, str))
        Titled lists of what is stated beside the results, and its text.
    facts : sequence of (str, str)
        What the page rests on.
    """
    page = verification_page(outcome, facts=facts)
    lines = [("" if at else title, *row) for title, rows in administrative_data for at, row in enumerate(rows)]
    table = Table((Column("of"), Column("what"), Column("stated")), tuple(lines), "")
    return replace(
        page,
        title=f"Calibration certificate {number}",
        subtitle=f"{outcome.specification.name}. {page.subtitle}",
        sections=(Section("Certificate", tables=(table,)), *page.sections),
    )


def verification_sections(outcome: VerificationRecord) -> tuple[Section, ...]:
    """The sections of a verification, for a page of its own or as part of another."""
    sections = [_decision(outcome), _values(outcome), _artefacts(outcome), _budgets(outcome), _to_check(outcome)]
    return tuple(section for section in sections if section is not None)


def name_of(row: decision.ConformityResult) -> str:
    """The test of a row, with its place where one name stands for several rows."""
    return f"{row.label}, {row.where}" if row.where else row.label


def describe_decision(outcome: VerificationRecord) -> str:
    """The decision in words, as paragraphs."""
    rows, verdict = outcome.rows_with_limit, outcome.verification.verdict
    by = {one: [row for row in rows if row.verdict is one] for one in Verdict}
    parts = [f"{outcome.specification.name}: {verdict.value}. Limits: {outcome.specification.source}."]
    if verdict is Verdict.CONFORM:
        parts.append(f"The values tested are within their limits: {format_count(len(rows), 'value')} with a limit.")
    if outside := by[Verdict.NOT_CONFORM]:
        parts.append(f"Outside {'its limit' if len(outside) == 1 else 'their limits'}: {_told(outside)}.")
    if between := by[Verdict.UNDECIDED]:
        parts.append(
            f"Undecided, within the uncertainty of {'the limit' if len(between) == 1 else 'the limits'}: "
            f"{_told(between)}. A better artefact or set-up decides."
        )
    return f"{' '.join(parts)}\n\n{describe_rule(outcome.rule)}"


def describe_rule(rule: DecisionRule) -> str:
    """The decision rule, in a few sentences: what it does, and which edition of a standard has it."""
    whole = (
        "a value conforms if it is within its limit with the whole expanded uncertainty U, it does not conform if it "
        "is beyond it with U, and is undecided between"
    )
    if rule == "simple":
        return (
            "Rule: simple acceptance where the expanded uncertainty U is at most "
            f"1/{SIMPLE_RATIO:g} of the limit: a value conforms if it is not beyond its limit. Where U is more, simple "
            f"acceptance does not apply: {whole}. {_UNROUNDED}"
        )
    return (
        f"Rule: {whole}. This is the rule of ISO 14253-1:2013; the smaller guard bands of the edition of 2017 are not "
        f"used. {_UNROUNDED}"
    )


def describe_budget(budget: Budget) -> str:
    """What the expanded uncertainty of a budget is: level, k and degrees of freedom."""
    dof = "infinite" if isinf(budget.dof) else format_in_text(budget.dof)
    return f"k = {budget.coverage_factor:.2f} for {LEVEL_TEXT}, effective degrees of freedom {dof}"


def limits_figure(rows: Sequence[decision.ConformityResult], *, rule: DecisionRule) -> Figure:
    """Draw values in shares of their limits, with their uncertainties and guard bands.

    Parameters
    ----------
    rows : sequence of ConformityResult
        With limits.
    rule : {"iso14253-1", "simple"}
        Guard bands are U on either side; simple acceptance has some only where it does not apply.
    """
    shown = list(rows[:_MOST_ROWS])
    height_in = _HEAD_IN + _ROW_IN * len(shown) + _FOOT_IN
    with figure_style():
        drawing = Drawing(figsize=(_WIDTH_IN, height_in))
        FigureCanvasAgg(drawing)
        axes = drawing.add_axes(
            (
                _LABELS_IN / _WIDTH_IN,
                _FOOT_IN / height_in,
                (_WIDTH_IN - _LABELS_IN - 0.15) / _WIDTH_IN,
                _ROW_IN * len(shown) / height_in,
            )
        )
        for at, row in enumerate(shown):
            _draw(axes, at, row, rule)
        reach = max([1.35, *((abs(row.value) + 1.5 * row.uncertainty) / (row.limit or inf) for row in shown)])
        axes.set(xlim=(-1.05 * reach, 1.05 * reach), ylim=(len(shown) - 0.5, -0.5), xlabel="value / limit [%]")
        axes.set_yticks(range(len(shown)), [shorten(name_of(row), longest=34) for row in shown])
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", visible=False)
        ticks = [tick for tick in axes.get_xticks() if abs(tick) <= reach]
        axes.set_xticks(ticks, [format_number(round(100 * tick)) for tick in ticks])
        _legend(axes, shown, rule)
    guard = " Hatched: the guard bands, U on either side of a limit, where nothing can be decided."
    left_out = f" Drawn are the first {_MOST_ROWS}." if len(rows) > _MOST_ROWS else ""
    told = join_phrases(
        f"{name_of(row)} {format_percent(row.value / (row.limit or inf))}, {_verdict(row)}" for row in shown
    )
    return Figure(
        (drawing,),
        caption="Each value as a share of its limit, with its expanded uncertainty U as a bar. Shaded: between the "
        f"limits.{guard if any(_guarded(row, rule) for row in shown) else ''}{left_out}",
        alt=f"Values against their limits: {told}.",
    )


def _guarded(row: decision.ConformityResult, rule: DecisionRule) -> bool:
    """Whether the whole uncertainty counts in the decision on a row."""
    return row.uncertainty > 0 and (rule != "simple" or not simple_applies(row.uncertainty, row.limit or inf))


def _draw(axes: Axes, at: int, row: decision.ConformityResult, rule: DecisionRule) -> None:
    assert row.limit is not None
    assert row.verdict is not None
    value, u, half = row.value / row.limit, row.uncertainty / row.limit, 0.36
    axes.add_patch(Rectangle((-1, at - half), 2, 2 * half, facecolor=_INSIDE, linewidth=0, zorder=1))
    for side in (-1, 1):
        if _guarded(row, rule):
            axes.add_patch(
                Rectangle(
                    (side - u, at - half),
                    2 * u,
                    2 * half,
                    facecolor="#ffffff",
                    edgecolor=LIMIT,
                    hatch="//////",
                    linewidth=0,
                    zorder=2,
                )
            )
        axes.plot([side, side], [at - half, at + half], color=INK, linewidth=1.1, zorder=3)
    pen = _PENS[row.verdict]
    axes.plot([value - u, value + u], [at, at], color=pen.colour, linewidth=1.6, zorder=4, solid_capstyle="butt")
    axes.plot(
        [value], [at], marker=pen.marker, markersize=6.5, color=pen.colour, markeredgecolor="white",
        markeredgewidth=0.5, linestyle="", zorder=5,
    )  # fmt: skip


def _legend(axes: Axes, rows: Sequence[decision.ConformityResult], rule: DecisionRule) -> None:
    handles: list[Artist] = []
    for verdict, pen in _PENS.items():
        if any(row.verdict is verdict for row in rows):
            handles += axes.plot([], [], color=pen.colour, marker=pen.marker, markersize=5.5, label=verdict.value)
    handles.append(axes.add_patch(Rectangle((0, 0), 0, 0, facecolor=_INSIDE, label="between the limits")))
    if any(_guarded(row, rule) for row in rows):
        guard = Rectangle((0, 0), 0, 0, facecolor="#ffffff", edgecolor=LIMIT, hatch="//////", linewidth=0)
        guard.set_label("guard band")
        handles.append(axes.add_patch(guard))
    # Below the axes, a fixed distance in inches.
    down = -0.48 / (_ROW_IN * len(rows))
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.3, down), ncols=3, columnspacing=1.2)


def _decision(outcome: VerificationRecord) -> Section:
    days = sorted({group.date for group in outcome.groups})
    points = sum(len(group.points) for group in outcome.groups)
    on = f"on {days[0]}" if len(days) == 1 else f"from {days[0]} to {days[-1]}"
    source = "" if outcome.measured.file is None else f" of {outcome.measured.file.name}"
    taken = f"{format_count(points, 'point')}{source}, taken {on}"
    if outcome.temperatures is not None:
        low, high = outcome.temperatures
        degC = format_in_text(high, unit="°C")
        if low < high:
            degC = f"{format_in_text(low)} to {degC}"
        taken += f"; artefacts at {degC}, means of groups of points"
    others = [remark for remark in outcome.verification.remarks if CHECK_STANDARD not in remark]
    text = "\n\n".join([describe_decision(outcome), f"{taken}.", *(f"{capitalize(remark)}." for remark in others)])
    return Section("Decision", text)


def _values(outcome: VerificationRecord) -> Section:
    cells: list[tuple[Cell, ...]] = []
    for row in outcome.verification.rows:
        if row.unit != "mm":  # a count
            cells.append((row.label, format_number(row.value), None, None, _verdict(row), row.where))
            continue
        u = row.uncertainty
        limit = None if row.limit is None else RoundedNumber(row.limit, _in_full(row.limit))
        cells.append((row.label, RoundedNumber(row.value, u), RoundedNumber(u, u), limit, _verdict(row), row.where))
    columns = (
        Column("test"),
        Column("value", "mm"),
        Column("U", "mm"),
        Column("limit", "mm"),
        Column("verdict"),
        Column("where"),
    )
    return Section(
        "Values against limits",
        f"U is the expanded uncertainty of the test value, from artefact and set-up, for a level of {LEVEL_TEXT}; "
        "the arm's own errors are what is tested and are not in it. A limit is one of the value's magnitude. Values "
        f"are shown to the last digit of U, limits in full, to the nanometre. {_UNROUNDED}",
        figures=(limits_figure(outcome.rows_with_limit, rule=outcome.rule),),
        tables=(Table(columns, tuple(cells), "Test values, their uncertainties and limits."),),
    )


def _artefacts(outcome: VerificationRecord) -> Section:
    cells: list[tuple[Cell, ...]] = []
    for one in outcome.used_artefacts:
        told = (one.certificate, str(one.date), str(one.expires))
        if isinstance(one, CalibratedSphere):
            u = one.u_diameter_mm
            cells.append((f"{one.name}, sphere", RoundedNumber(one.diameter_mm, u), RoundedNumber(u, u), *told))
        elif isinstance(one, CalibratedBar):
            taken = outcome.lengths_of(one.name)
            for length in one.lengths:
                if length.name in taken:
                    size = RoundedNumber(length.length_mm, length.u_mm)
                    cells.append(
                        (f"{one.name}, length {length.name}", size, RoundedNumber(length.u_mm, length.u_mm), *told)
                    )
        else:
            cells.append((f"{one.name}, seat", None, None, *told))
    columns = (
        Column("artefact"),
        Column("calibrated at 20 °C", "mm"),
        Column("u (k = 1)", "mm"),
        Column("certificate"),
        Column("calibrated on"),
        Column("serves until"),
    )
    return Section(
        "Artefacts",
        "What was measured, and by which certificates it is known. Each served on the days of its points.",
        tables=(Table(columns, tuple(cells), "Artefacts that points were taken on."),),
    )


def _budgets(outcome: VerificationRecord) -> Section:
    by_budget: dict[Budget, list[decision.ConformityResult]] = {}
    for row in outcome.verification.rows:
        if row.budget.contributions:
            by_budget.setdefault(row.budget, []).append(row)
    return Section(
        "Uncertainty budgets",
        "What each contribution gives the test value as a standard uncertainty. They are independent: their squares "
        "add. Effective degrees of freedom by Welch and Satterthwaite (GUM G.4.1); U = k u.",
        tables=tuple(_budget(budget, rows) for budget, rows in by_budget.items()),
    )


def _budget(budget: Budget, rows: Sequence[decision.ConformityResult]) -> Table:
    total = budget.u
    cells: list[tuple[Cell, ...]] = []
    for one in budget.contributions:
        share = RoundedNumber(100 * one.u**2 / total**2, 1.0) if total else None  # to a tenth
        cells.append((one.label, RoundedNumber(one.u, one.u), _dof(one.dof), share))
    cells.append(("combined standard uncertainty u", RoundedNumber(total, total), _dof(budget.dof), None))
    expanded = f"expanded uncertainty U, k = {budget.coverage_factor:.2f}"
    cells.append((expanded, RoundedNumber(budget.expanded, budget.expanded), None, None))
    columns = (
        Column("contribution"),
        Column("u", "mm"),
        Column("degrees of freedom"),
        Column("share of u²", "%"),
    )
    return Table(columns, tuple(cells), f"{'; '.join(dict.fromkeys(map(name_of, rows)))}.")


def _to_check(outcome: VerificationRecord) -> Section | None:
    cells: list[tuple[Cell, ...]] = []
    for key, value, source in outcome.plan.unconfirmed():
        name, _, number = key.partition(".")
        if name in outcome.measured.tests:
            cells.append((name, number, format_exact(value), source))
    if not cells:
        return None
    return Section(
        "To check against the standard",
        "The standard's text was not at hand when the plan was written. These numbers of the plan are recalled: "
        f"{CHECK_STANDARD}.",
        tables=(
            Table(
                (Column("test"), Column("number"), Column("in the plan"), Column("where it comes from")),
                tuple(cells),
                f"Numbers of the plan {outcome.plan.name} that are not confirmed.",
            ),
        ),
    )


def _told(rows: Sequence[decision.ConformityResult]) -> str:
    """Rows with value, uncertainty and limit, as a sentence has them."""
    return "; ".join(
        f"{name_of(row)}, {_with_uncertainty(row)} for a limit of "
        f"{format_number(row.limit, uncertainty=_in_full(row.limit))}\u202fmm"
        for row in rows
        if row.limit is not None
    )


def _in_full(limit: float) -> float:
    """The uncertainty to whose digits a limit stands with all of its own, to the nanometre: A + L/K has more."""
    exponent = Decimal(f"{limit:.6f}").normalize().as_tuple().exponent
    assert isinstance(exponent, int)
    return float(10.0 ** (1 + min(exponent, 0)))


def _with_uncertainty(row: decision.ConformityResult) -> str:
    u = row.uncertainty
    value = format_number(row.value, uncertainty=u)
    return f"({value} ± {format_number(u, uncertainty=u)})\u202fmm" if u else f"{value}\u202fmm"


def _share_of_limit(row: decision.ConformityResult) -> float:
    return (abs(row.value) + row.uncertainty) / (row.limit or inf)


def _verdict(row: decision.ConformityResult) -> str | None:
    return None if row.verdict is None else row.verdict.value


def _dof(dof: float) -> Cell:
    return "∞" if isinf(dof) else format_number(dof)
