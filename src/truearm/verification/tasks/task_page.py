"""The page of a task: the error of a measured feature, and whether the arm is good enough for a tolerance."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure as Drawing

from truearm.pages.number_format import RoundedNumber, capitalize, format_count, format_mm
from truearm.pages.page import Column, LabelledValue, Page, Section, Table
from truearm.pages.plotting import LIMIT, Figure, figure_style, make_panel
from truearm.verification.tasks.task import Estimate, Fitness, TaskResult, advice, describe_fitness

_ORANGE, _NAVY = "#d9730d", "#12407a"
_BINS = 40


def task_page(
    task: TaskResult,
    fit: Fitness | None,
    *,
    about: str,
    remarks: Sequence[str] = (),
    facts: Sequence[tuple[str, str]] = (),
) -> Page:
    """Lay out the uncertainty of a measured feature.

    Parameters
    ----------
    task : TaskResult
    fit : Fitness, optional
        Against a tolerance of its first quantity.
    about : str
        What is known of the arm, in a few words.
    remarks : sequence of str
        Assumptions, in sentences.
    facts : sequence of (str, str)
        What the page rests on.
    """
    first = task.estimates[0]
    summary = [
        LabelledValue(f"{first.quantity.name}: standard uncertainty", first.u_mm, "mm"),
        LabelledValue("not exceeded by 95 % of errors", first.expanded_mm, "mm"),
    ]
    if task.at_limit is not None:
        summary.append(LabelledValue("the same of arms at their limit", task.at_limit.expanded_mm, "mm"))
    sections = []
    if fit is not None:
        summary.append(LabelledValue("good enough?", fit.answer.value))
        sections.append(Section("Is the arm good enough?", describe_fitness(first, fit).replace("+-", "\u00b1")))
    sections.append(
        Section(
            "Errors of the measured feature",
            f"Measured less true value of {format_count(task.n_arms, 'drawn arm')}; what is known of the arm: {about}. The "
            "interval is the shortest one that holds 95 % of the errors.",
            figures=(errors_figure(task.estimates, fit),),
            tables=(_table(task),),
        )
    )
    sections.append(
        Section(
            "Would more points help?",
            "The errors of the arm are the same whenever it is held the same way, and alike where it is held nearly "
            f"so; those of the points change from one to the next, and averaging makes them smaller.\n\n{advice(task)}",
        )
    )
    if remarks:
        sections.append(Section("What it rests on", "\n\n".join(remarks)))
    return Page(
        title=capitalize(task.feature.name),
        subtitle=f"Uncertainty of measurement by {about}",
        summary=tuple(summary),
        sections=tuple(sections),
        facts=tuple(facts),
    )


def errors_figure(estimates: Sequence[Estimate], fit: Fitness | None = None) -> Figure:
    """Draw how the errors of each quantity are spread, with their interval and the tolerance of the first."""
    with figure_style():
        panels = tuple(_spread(one, fit if one is estimates[0] else None) for one in estimates)
    told = "; ".join(f"{one.quantity.name} {_between(one)}" for one in estimates)
    zone = " Grey lines: the tolerance." if fit is not None else ""
    return Figure(
        panels,
        caption=f"Errors of the drawn arms. Orange: the shortest interval that holds 95 %: {told}.{zone}",
        alt=f"Histograms of the errors; 95 % of them lie in: {told}.",
        columns=min(len(panels), 2),
    )


def _spread(estimate: Estimate, fit: Fitness | None) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 2.8)
    low, high = estimate.interval_mm
    axes.axvspan(low, high, color=_ORANGE, alpha=0.18, linewidth=0)
    axes.hist(estimate.errors, bins=_BINS, color=_NAVY)
    if fit is not None:
        ends = (fit.tolerance_mm,) if estimate.quantity.is_form else (-fit.tolerance_mm / 2, fit.tolerance_mm / 2)
        for end in ends:
            axes.axvline(end, color=LIMIT, linestyle="--")
    axes.set(xlabel=f"error of the {estimate.quantity.name} [mm]", ylabel="arms")
    return drawing


def _between(estimate: Estimate) -> str:
    low, high = estimate.interval_mm
    return f"{format_mm(low)} to {format_mm(high)}"


def _table(task: TaskResult) -> Table:
    columns = (
        Column("quantity"),
        Column("nominal", "mm"),
        Column("mean error", "mm"),
        Column("u", "mm"),
        Column("of the arm", "mm", group="u"),
        Column("of the points", "mm", group="u"),
        Column("from", "mm", group="95 % of the errors"),
        Column("to", "mm", group="95 % of the errors"),
    )
    rows = [
        (
            one.quantity.name,
            float(one.quantity.nominal_mm),
            RoundedNumber(one.bias_mm, one.standard_errors.bias_mm),
            RoundedNumber(one.u_mm, one.standard_errors.u_mm),
            RoundedNumber(one.u_systematic_mm, one.standard_errors.u_mm),
            RoundedNumber(one.u_random_mm, one.standard_errors.u_mm),
            RoundedNumber(one.interval_mm[0], one.standard_errors.low_mm),
            RoundedNumber(one.interval_mm[1], one.standard_errors.high_mm),
        )
        for one in task.estimates
    ]
    caption = "u is the standard uncertainty. Numbers have the decimals that the number of draws supports."
    return Table(columns, tuple(rows), caption)
