"""The page of a task: whether the arm is fit for a tolerance, and the errors of the measured feature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure as Drawing

from truearm.arm import Arm
from truearm.number_format import RoundedNumber, capitalize, format_count, show_mm
from truearm.pages.drawings.arm_scene import arm_mechanism, joint_columns
from truearm.pages.drawings.workspace_figures import error_in_workspace
from truearm.pages.page import Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.palette import LIMIT, NAVY, ORANGE
from truearm.pages.plotting import Figure, figure_style, make_panel
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.wings.laboratory.tasks.estimate import Estimate, Fitness, FitnessDecision, describe_fitness
from truearm.wings.laboratory.tasks.task import TaskAssessment, TaskEstimates

_BINS = 40


def task_page(task: TaskAssessment, *, arm: Arm, source: str, facts: Sequence[tuple[str, str]] = ()) -> Page:
    """Lay out the uncertainty of a measured feature.

    Parameters
    ----------
    task : TaskAssessment
    arm : Arm
        The nominal arm.
    source : str
        Source of the arm's errors, in a few words.
    facts : sequence of (str, str)
        Inputs, as label and value.
    """
    result, fit = task.result, task.fitness
    first = result.estimates[0]
    summary = [
        LabelledValue(f"{first.quantity.name}: expanded uncertainty U (95 %)", first.expanded_mm, "mm"),
        LabelledValue("standard uncertainty u", first.u_mm, "mm"),
    ]
    if result.at_limit is not None:
        summary.append(LabelledValue("U of arms at their limit", result.at_limit.expanded_mm, "mm"))
    verdict = PageVerdict(f"U = {first.expanded_mm:.4f}\u202fmm for the {first.quantity.name} (95\u202f% coverage).")
    if fit is not None:
        answer, _, meaning = describe_fitness(first, fit).replace("+-", "\u00b1").partition(". ")
        verdict = PageVerdict(f"{answer}.", _STATES[fit.answer], meaning)
    sections = (
        Section(
            "Errors of the measured feature",
            f"Measured minus true value of {format_count(result.n_arms, 'arm')}, drawn from {source}. "
            "The interval is the shortest one that contains 95 % of the errors.",
            figures=(errors_figure(result.estimates, fit),),
            tables=(_table(result),),
        ),
        Section("The points in the volume", scenes=(task_scene(result, arm),)),
        Section(
            "Would more points help?",
            f"{task.advice}\n\nSystematic errors are the same in the same pose and similar in similar poses. Random "
            "errors differ from point to point; averaging reduces them.",
        ),
        Section("Assumptions", "\n\n".join(task.remarks)),
    )
    return Page(
        title=capitalize(result.feature.name),
        subtitle=f"Uncertainty of measurement by {source}",
        summary=tuple(summary),
        sections=sections,
        facts=tuple(facts),
        verdict=verdict,
    )


_STATES: dict[FitnessDecision, State] = {
    FitnessDecision.YES: "good",
    FitnessDecision.GUARDED: "doubtful",
    FitnessDecision.NO: "bad",
}


def errors_figure(estimates: Sequence[Estimate], fit: Fitness | None = None) -> Figure:
    """Draw the distribution of the errors of each quantity, its interval, and the tolerance of the first."""
    with figure_style():
        panels = tuple(_spread(one, fit if one is estimates[0] else None) for one in estimates)
    intervals = "; ".join(f"{one.quantity.name} {_between(one)}" for one in estimates)
    zone = " Grey lines: the tolerance." if fit is not None else ""
    return Figure(
        panels,
        caption=f"Errors of the drawn arms. Orange: the shortest interval that contains 95 %: {intervals}.{zone}",
        alt=f"Histograms of the errors; 95 % of them are in: {intervals}.",
        columns=min(len(panels), 2),
    )


def _spread(estimate: Estimate, fit: Fitness | None) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 2.8)
    low, high = estimate.interval_mm
    axes.axvspan(low, high, color=ORANGE, alpha=0.18, linewidth=0)
    axes.hist(estimate.errors, bins=_BINS, color=NAVY)
    if fit is not None:
        ends = (fit.tolerance_mm,) if estimate.quantity.is_form else (-fit.tolerance_mm / 2, fit.tolerance_mm / 2)
        for end in ends:
            axes.axvline(end, color=LIMIT, linestyle="--")
    axes.set(xlabel=f"error of the {estimate.quantity.name} [mm]", ylabel="arms")
    axes.locator_params(axis="x", nbins=6)
    return drawing


def _between(estimate: Estimate) -> str:
    low, high = estimate.interval_mm
    return f"{show_mm(low)} to {show_mm(high)}"


def _table(task: TaskEstimates) -> Table:
    columns = Column.of(
        "quantity",
        "nominal [mm]",
        "bias [mm]",
        "u [mm]",
        Column("systematic", "mm", group="u"),
        Column("random", "mm", group="u"),
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
    caption = "u: standard uncertainty. The number of decimals follows from the number of draws."
    return Table(columns, tuple(rows), caption)


def task_scene(task: TaskEstimates, arm: Arm) -> Scene:
    """The points of the feature with the standard uncertainty of each, and the arm in the first set of postures.

    Parameters
    ----------
    task : TaskEstimates
    arm : Arm
        The nominal arm.
    """
    points, n = task.feature.points, len(task.feature.points)
    u = np.linalg.norm(task.point_u_mm, axis=1)
    worst = int(np.argmax(u))
    postures = task.angles[0]
    cloud = PointCloud(
        points,
        [f"point {number}" for number in range(1, n + 1)],
        [PointColumn("standard uncertainty u of the point", "mm", u)],
        joint_columns(arm.chain.joint_angles(postures), arm.chain.is_prismatic),
        [PointColumn(f"u of {axis}", "mm", column) for axis, column in zip("xyz", task.point_u_mm.T, strict=True)],
        marked={worst: f"u = {show_mm(float(u[worst]))}"},
    )
    what = f"{format_count(n, 'point')} of the {task.feature.name} in space, coloured by standard uncertainty"
    caption = (
        "Standard uncertainty of the place of each point: the root of the sum of the squares of its three coordinates, "
        "over all drawn arms. On a screen a ring marks the largest. Errors that points share cancel in a length "
        "or a form, so the uncertainty of the feature does not follow from these alone. The arm is shown in one of the "
        "sets of postures."
    )
    still = error_in_workspace(points, u)
    return Scene(
        f"{what}; the arm goes to the point that is pointed at",
        "mm",
        replace(still, caption=caption, alt=f"{what}, in four views. Largest: {show_mm(float(u[worst]))}."),
        cloud=cloud,
        mechanism=arm_mechanism(arm, start=postures[worst], follows=[*range(arm.n_joints)]),
        lines=[points] if n == 2 else [],  # a length between two points
    )
