"""The page of a verification: the decision, the values against their limits, artefacts and uncertainty budgets."""

from __future__ import annotations

from collections.abc import Sequence
from math import isinf

from truearm.number_format import (
    RoundedNumber,
    capitalize,
    format_count,
    format_in_text,
    format_number,
    format_percent,
)
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.plotting import Figure
from truearm.show.limits_figure import limits_figure
from truearm.show.where_scene import where_scene
from truearm.verification.standards.decision import Budget, ConformityResult, Verdict
from truearm.verification.standards.measured_places import share_of_limit
from truearm.verification.standards.verification import Verification
from truearm.verification.standards.verification_plan import CHECK_STANDARD, is_confirmed
from truearm.verification.standards.verification_text import (
    LEVEL_TEXT,
    UNROUNDED_TEXT,
    describe_decision,
    describe_rule,
    limit_uncertainty,
    verdict_sentence,
    worst_values,
)


def verification_page(verification: Verification, *, facts: Sequence[tuple[str, str]] = ()) -> Page:
    """Lay out the page of a verification.

    Parameters
    ----------
    verification : Verification
    facts : sequence of (str, str)
        Plan, files with their SHA-256, versions.
    """
    nearest = max(verification.rows_with_limit, key=share_of_limit)
    nearest_label = f"of its limit, value and uncertainty together: {nearest.name}"
    return Page(
        title=f"{verification.specification.name}: {verification.conclusion.value}",
        subtitle=f"{verification.plan.heading}. Limits: {verification.specification.source}, for a measuring range of "
        f"{verification.specification.measuring_range_mm:g} mm.",
        summary=(
            LabelledValue(nearest_label, format_percent(share_of_limit(nearest)), state=_state(nearest, verification)),
            LabelledValue("values with a limit", len(verification.rows_with_limit)),
            LabelledValue("measured points", sum(len(group.points) for group in verification.groups)),
        ),
        sections=verification_sections(verification),
        facts=tuple(facts),
        verdict=PageVerdict(
            verdict_sentence(verification), _STATES[verification.conclusion], worst_values(verification)
        ),
    )


def verification_sections(verification: Verification) -> tuple[Section, ...]:
    """The sections of a verification, for a page of its own or as part of another."""
    return (
        _decision(verification),
        _values(verification),
        _artefacts(verification),
        _budgets(verification),
        sources_section(verification),
    )


def shares_figure(verification: Verification) -> Figure:
    """Draw the values that have a limit as shares of it, the most urgent ones first."""
    rows = sorted(verification.rows_with_limit, key=_urgency)
    return limits_figure(rows, rule=verification.rule, decides=verification.gap is None)


def _decision(verification: Verification) -> Section:
    days = sorted({group.date for group in verification.groups})
    points = sum(len(group.points) for group in verification.groups)
    on = f"on {days[0]}" if len(days) == 1 else f"from {days[0]} to {days[-1]}"
    source = "" if verification.measured.file is None else f" of {verification.measured.file.name}"
    sources = f"{format_count(points, 'point')}{source}, measured {on}"
    if verification.temperatures is not None:
        low, high = verification.temperatures
        degC = format_in_text(high, unit="°C")
        if low < high:
            degC = f"{format_in_text(low)} to {degC}"
        sources += f"; artefacts at {degC} (means of the groups of points)"
    remarks = [remark for remark in verification.remarks if CHECK_STANDARD not in remark]
    origin = verification.measured.origin.describe()
    paragraphs = [describe_decision(verification), origin, *(f"{capitalize(remark)}." for remark in remarks)]
    rule = describe_rule(verification.rule, confirmed=verification.gap is None)
    text = "\n\n".join([*paragraphs, f"{sources}.", rule])
    return Section("Decision", text, scenes=(where_scene(verification.measured.tests, verification.rows_with_limit),))


def _values(verification: Verification) -> Section:
    cells: list[tuple[Cell, ...]] = []
    rows = sorted(verification.rows, key=_urgency)
    for row in rows:
        u, limit = row.uncertainty, None
        if row.limit is not None:
            limit = RoundedNumber(row.limit, limit_uncertainty(row.limit))
        numbers: tuple[Cell, ...] = (RoundedNumber(row.value, u), RoundedNumber(u, u), limit)
        if row.unit != "mm":  # a count
            numbers = (format_number(row.value), None, None)
        cells.append((row.label, *numbers, verification.describe_row(row), row.where))
    columns = Column.of("test", "value [mm]", "U [mm]", "limit [mm]", "verdict", "where")
    return Section(
        "Values against limits",
        f"U is the expanded uncertainty of the test value from artefact and set-up, for a level of {LEVEL_TEXT}; it "
        "does not contain the errors of the arm, which are tested. Limits apply to magnitudes. Values are printed to "
        f"the last digit of U, limits to the nanometre. {UNROUNDED_TEXT}",
        figures=(shares_figure(verification),),
        tables=(
            Table(
                columns,
                tuple(cells),
                "Test values, their uncertainties and limits; those that do not conform come first.",
                states=tuple(_state(row, verification) for row in rows),
            ),
        ),
    )


def _artefacts(verification: Verification) -> Section:
    cells: list[tuple[Cell, ...]] = []
    for one in verification.used_artefacts:
        dates = (one.certificate, str(one.date), str(one.expires))
        if not (sizes := verification.sizes(one)):
            cells.append((f"{verification.describe_artefact(one)}, {one.kind}", None, None, *dates))
        for name, size, u in sizes:
            what = one.kind if one.kind == "sphere" else name
            cells.append(
                (f"{verification.describe_artefact(one)}, {what}", RoundedNumber(size, u), RoundedNumber(u, u), *dates)
            )
    columns = Column.of(
        "artefact", "calibrated at 20 °C [mm]", "u (k = 1) [mm]", "certificate", "calibrated on", "valid until"
    )
    return Section(
        "Artefacts",
        "All certificates were valid on the days of the measurements.",
        tables=(Table(columns, tuple(cells), "Measured artefacts."),),
    )


def _budgets(verification: Verification) -> Section:
    by_budget: dict[Budget, list[ConformityResult]] = {}
    for row in verification.rows:
        if row.budget.contributions:
            by_budget.setdefault(row.budget, []).append(row)
    return Section(
        "Uncertainty budgets",
        "The contributions to the standard uncertainty of a test value are independent: their squares add. Effective "
        "degrees of freedom by Welch and Satterthwaite (GUM G.4.1); U = k u.",
        tables=tuple(_budget(budget, rows) for budget, rows in by_budget.items()),
        folded=True,
    )


def _budget(budget: Budget, rows: Sequence[ConformityResult]) -> Table:
    total = budget.u
    cells: list[tuple[Cell, ...]] = []
    for one in budget.contributions:
        share = RoundedNumber(100 * one.u**2 / total**2, 1.0) if total else None  # to a tenth
        cells.append((one.label, RoundedNumber(one.u, one.u), _dof(one.dof), share))
    cells.append(("combined standard uncertainty u", RoundedNumber(total, total), _dof(budget.dof), None))
    expanded = f"expanded uncertainty U, k = {budget.coverage_factor:.2f}"
    cells.append((expanded, RoundedNumber(budget.expanded, budget.expanded), None, None))
    columns = Column.of("contribution", "u [mm]", "degrees of freedom", "share of u² [%]")
    return Table(columns, tuple(cells), f"{'; '.join(dict.fromkeys(row.name for row in rows))}.")


def sources_section(verification: Verification) -> Section:
    """Where each number and formula of the plan stands, and whether somebody looked it up there."""
    entries = list(verification.plan.entries(verification.measured.tests))
    open_ = sum(not is_confirmed(one) for one in entries)
    rows: list[tuple[Cell, ...]] = [
        (one.test, one.describe(), one.source, "confirmed" if is_confirmed(one) else "not confirmed") for one in entries
    ]
    text = f"Every number and formula that enters a verdict. {capitalize(verification.plan.heading)}."
    if open_:
        text += (
            " The text of the standard was not available when the plan was written. Not confirmed, "
            f"{CHECK_STANDARD}: {open_} of {len(entries)}."
        )
    return Section(
        "Where each number stands",
        text,
        tables=(
            Table(
                Column.of("test", "number or formula", "where it stands", "looked up"),
                tuple(rows),
                f"Entries of the plan {verification.plan.name}.",
                states=tuple("none" if is_confirmed(one) else "doubtful" for one in entries),
            ),
        ),
        folded=True,
    )


_STATES: dict[Verdict | None, State] = {
    Verdict.CONFORM: "good",
    Verdict.UNDECIDED: "doubtful",
    Verdict.NOT_FOR_DECISIONS: "doubtful",
    Verdict.NOT_CONFORM: "bad",
    None: "none",
}


def _urgency(row: ConformityResult) -> int:
    """Values that do not conform come first, then those that are undecided."""
    return 0 if row.verdict is Verdict.NOT_CONFORM else 1 if row.verdict is Verdict.UNDECIDED else 2


def _state(row: ConformityResult, verification: Verification) -> State:
    """Its colour; nothing is good by numbers that nobody confirmed."""
    return "none" if row.verdict is Verdict.CONFORM and verification.gap is not None else _STATES[row.verdict]


def _dof(dof: float) -> Cell:
    return "∞" if isinf(dof) else format_number(dof)
