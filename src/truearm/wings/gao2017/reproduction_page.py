"""The page that compares the paper's tables and figures with their reproduction.

Every number in a sentence comes from the results; a part that was not run is listed with the command that runs it.

Learning curves show the error on the fitted poses against the time of the training, one for a row of each table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure as Drawing

from truearm.arm import load_arm
from truearm.number_format import format_count, format_in_text
from truearm.pages.drawings.arm_drawing import arm_figure, frame_figure
from truearm.pages.drawings.arm_scene import arm_mechanism
from truearm.pages.drawings.error_figures import coordinates_by_reading, errors_by_reading
from truearm.pages.drawings.workspace_figures import error_in_workspace
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, Table
from truearm.pages.palette import PAPER
from truearm.pages.plotting import Figure, figure_style, join_phrases, make_panel, set_log_scale
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.typing import FloatArray
from truearm.wings.gao2017.claim_sections import (
    final_test_section,
    joint_ranges_section,
    learning_rate_section,
    outside_section,
    removed_percent,
    scatter_section,
    share_section,
)
from truearm.wings.gao2017.phrases import COMMAND, MissingPart, as_count, format_degrees, mark_cut, with_figure_number
from truearm.wings.gao2017.results import METHODS, ArmPose, Predictions, Reproduction, RowResult, Run
from truearm.wings.gao2017.table_figure import STYLES, network_layers
from truearm.wings.gao2017.table_sections import (
    count_cut,
    count_verdicts,
    describe_accuracy,
    describe_skipped_rows,
    speedups,
    table_section,
)
from truearm.wings.gao2017.tables import TABLE_1
from truearm.wings.gao2017.training import ARM

_SHORTEST_S = 1e-3


def learning_curves_section(results: Reproduction) -> Section | None:
    """How the error falls while networks are trained, for the row of each table with the longest training.

    None where no training has a curve: none was run, or all are results of earlier versions, which kept none.
    """
    longest = {
        number: row
        for number, rows in results.tables.items()
        if (row := max(filter(_has_curves, rows or ()), key=lambda row: row.paper.seconds, default=None)) is not None
    }
    if not longest:
        return None
    return Section(
        "Learning curves",
        "The error on the fitted poses while a network is trained, in each table for the row with the longest training "
        "in the paper. Time is CPU time, without the evaluation on further poses.",
        figures=(learning_curves_figure(longest),),
    )


def learning_curves_figure(rows: Mapping[int, RowResult]) -> Figure:
    """Draw the root mean square error on the fitted poses against the time, a line a start, a panel a row.

    Parameters
    ----------
    rows : mapping of int to RowResult
        By the number of their table; all with curves.
    """
    with figure_style():
        panels = tuple(_panel(number, row) for number, row in rows.items())
    ends = join_phrases(
        f"Table {number}, row {row.paper.row}: "
        + ", ".join(
            f"{name} {format_in_text(min(run.curve[-1][2] for run in runs), unit='mm')}"
            for name, runs in _runs(row).items()
        )
        for number, row in rows.items()
    )
    cut = any(run.was_cut for row in rows.values() for runs in _runs(row).values() for run in runs)
    note = " An open mark: the time limit ended this training." if cut else ""
    return Figure(
        panels,
        caption="Root mean square error of a coordinate on the fitted poses against the CPU time, a line a random "
        f"start, both scales logarithmic. Smallest at the end: {ends}.{note}",
        alt=f"Falling curves of the training error against the time. Smallest at the end: {ends}.",
        columns=3 if len(panels) > 1 else 1,
    )


def _runs(row: RowResult) -> dict[str, list[Run]]:
    """The starts of each trainer that have a curve."""
    by_method = {name: [run for run in result.runs if run.curve] for name in METHODS if (result := row.results[name])}
    return {name: runs for name, runs in by_method.items() if runs}


def _has_curves(row: RowResult) -> bool:
    return row.timed and bool(_runs(row))


def _panel(number: int, row: RowResult) -> Drawing:
    drawing, (axes,) = make_panel(3.2, 2.7, top_in=0.46)
    seconds, errors = [], []
    for name, runs in _runs(row).items():
        style = STYLES[name]
        for k, run in enumerate(runs):
            x = [max(at, _SHORTEST_S) for _, at, _ in run.curve]
            y = [max(error, 1e-12) for _, _, error in run.curve]
            axes.plot(x, y, color=style.colour, linestyle=style.dash, linewidth=1.1, label=name if k == 0 else None)
            axes.plot(
                x[-1], y[-1], style.marker, color=style.colour, markersize=4.5,
                markerfacecolor=PAPER if run.was_cut else style.colour,
            )  # fmt: skip
            seconds += x
            errors += y
    set_log_scale(axes, "x", min(seconds) / 1.3, max(seconds) * 1.3)
    set_log_scale(axes, "y", min(errors) / 1.5, max(errors) * 1.5)
    axes.set(xlabel="time [s]", ylabel="error [mm]")
    units = ", ".join(map(str, row.paper.hidden))
    axes.set_title(f"Table {number}, row {row.paper.row}: {units} units", pad=16)
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, handlelength=1.4, columnspacing=1.0, borderpad=0.0
    )
    return drawing


IN_SPACE = "Where the networks err"
TITLE = "Gao et al. 2017, reproduced"
CITATION = (
    "Gao, Zhang, San, Wu, Wang: Modeling and Error Compensation of Robotic Articulated Arm Coordinate Measuring "
    "Machines Using BP Neural Network. Complexity 2017, article 5156264"
)
_PURPOSE = (
    "The paper trains networks that calculate x, y and z from the six joint angles of a measuring arm. This page sets "
    "its tables and figures beside a reproduction. trainlm is the paper's own way: MATLAB's training functions by "
    "their documentation (two rows of Table 3 use gradient descent), with the settings and stops of each row. varpro "
    "is the trainer of truearm: it solves the output layer exactly at every step, with the damping of Nielsen's rule."
)


def reproduction_page(results: Reproduction) -> Page:
    """Make the page of a reproduction."""
    parts: list[Section | MissingPart | None] = [
        _answer(results),
        _in_space(results),
        *(table_section(number, rows, results.rule) for number, rows in results.tables.items()),
        learning_curves_section(results),
        final_test_section(results),
        share_section(results),
        learning_rate_section(results),
        scatter_section(results),
        joint_ranges_section(results),
        outside_section(results),
        _arm(results),
        _network(results),
        _ten_poses(results),
    ]
    sections = [part for part in parts if isinstance(part, Section)]
    missing = [str(part) for part in parts if isinstance(part, MissingPart)]
    if missing:
        sections.append(Section("Not part of this run", "\n\n".join(missing)))
    if results.skipped:
        table = Table((Column("skipped"),), tuple((part,) for part in results.skipped), "Parts that this run skipped")
        sections.append(Section("Skipped parts", f"To make all of them: {COMMAND} --all", tables=(table,)))
    quick = " A quick run; the skipped parts are listed at the end." if results.quick and results.skipped else ""
    return Page(
        title=TITLE,
        subtitle=f"{CITATION}.{quick}",
        summary=_summary(results),
        sections=tuple(sections),
        facts=_facts(results),
        verdict=_page_verdict(results),
    )


def paper_figure(page: Page, number: int) -> Figure | None:
    """The reproduction of a figure of the paper on the page; None if it was not made."""
    sections = [section for section in page.sections if section.title != IN_SPACE]
    figures = (
        figure for section in sections for figure in (*(scene.still for scene in section.scenes), *section.figures)
    )
    return next((figure for figure in figures if figure.caption.startswith(f"Figure {number} of the paper")), None)


def _summary(results: Reproduction) -> tuple[LabelledValue, ...]:
    rows = []
    for method in METHODS:
        verdicts = count_verdicts(results.rows(), method)
        if verdicts:
            good = verdicts["reproduced"] + verdicts["better"]
            if not good + verdicts["not reached"]:  # a quick run has rows that nothing can be said of
                continue
            value = f"{good} of {good + verdicts['not reached']}"
            label = f"judged table rows reproduced or better, {method}"
            judged = [
                row for row in results.rows() if row.verdicts.get(method) in ("reproduced", "better", "not reached")
            ]
            n_cut = count_cut(judged, method)
            rows.append(LabelledValue(mark_cut(label, n_cut), value, state="doubtful" if n_cut else "none"))
    times = speedups(results.rows())
    if times:
        label = "speed-up of varpro over trainlm to the paper's mean error, median of rows"
        rows.append(LabelledValue(label, float(np.median(times)), "times"))
    test = results.final_test
    if test is not None:
        for name, share in removed_percent(test).items():
            n_cut = test.n_cut(name)
            label = mark_cut(f"error removed on {test.poses} further poses, {name}", n_cut)
            rows.append(LabelledValue(label, share, "%", state="doubtful" if n_cut else "none"))
    return tuple(rows)


def _page_verdict(results: Reproduction) -> PageVerdict | None:
    """In how many rows of the tables the paper's accuracy is reached; None if no row was run."""
    judged = {name: count_verdicts(results.rows(), name) for name in METHODS}
    shares = {name: (counts["reproduced"] + counts["better"], counts["not reached"]) for name, counts in judged.items()}
    parts = [
        f"{good} of {format_count(good + missed, 'judged table row')} with {name}"
        for name, (good, missed) in shares.items()
        if good + missed
    ]
    if not parts:
        return None
    n_cut = sum(count_cut(results.rows(), name) for name in METHODS)
    missed = sum(missed for _, missed in shares.values())
    cut = f"The time limit cut trainings of {format_count(n_cut, 'row')}: what they would have reached is not known."
    detail = " ".join(part for part in (describe_skipped_rows(results.tables), cut if n_cut else "") if part)
    sentence = f"The paper's accuracy is reached or surpassed in {' and in '.join(parts)}."
    return PageVerdict(sentence, "doubtful" if missed or n_cut else "good", detail)


def _answer(results: Reproduction) -> Section:
    rows = results.rows()
    run = [row for row in rows if any(row.results.values())]
    text = []
    if rows:
        text.append(f"{format_count(len(run), 'row')} of {len(rows)} were run. {describe_accuracy(rows)}")
    times = speedups(rows)
    if times:
        span = f" (from {format_in_text(min(times))} to {format_in_text(max(times))})" if len(times) > 1 else ""
        text.append(
            f"In {format_count(len(times), 'row')} both reach it; on the same machine trainlm then takes "
            f"{format_in_text(float(np.median(times)))} times as long as varpro in the median{span}. The paper does "
            "not describe the machine of its own times."
        )
    tables = (_verdict_table(results),) if rows else ()
    return Section("In short", "\n\n".join([*text, _PURPOSE]), tables=tables)


def _verdict_table(results: Reproduction) -> Table:
    heads = [(name, verdict) for name in METHODS for verdict in count_verdicts(results.rows(), name)]
    return Table(
        Column.of("table", "rows", *(Column(verdict, group=f"{name}, rows") for name, verdict in heads)),
        tuple(
            (f"Table {number}", len(rows), *(count_verdicts(rows, name)[verdict] for name, verdict in heads))
            for number, rows in results.tables.items()
            if rows
        ),
        "Verdicts of the trainings that were run, each once; each table's section states the rule",
        folded=True,
    )


def _in_space(results: Reproduction) -> Section | None:
    """The test poses in space: those of the final test, else those of Figure 4; None where neither was run."""
    figures = results.figures
    final = [one for one in (figures.figure_6, figures.figure_7) if one is not None]
    tested = final or [one for one in (figures.figure_4,) if one is not None]
    if not tested:
        return None
    what = "the final test on a virtual arm" if final else "the test of Table 2, row 1"
    poses = tested[0]
    distances = {name: np.linalg.norm(values, axis=1) for each in tested for name, values in each.deviations().items()}
    return Section(
        IN_SPACE,
        f"Error in space, predicted to true point, at {format_count(len(poses.points_mm), 'pose')} of {what}.",
        scenes=(_errors_scene(poses, distances),),
    )


def _errors_scene(poses: Predictions, distances: dict[str, FloatArray]) -> Scene:
    arm = load_arm(ARM)
    shown = next((name for name in reversed(METHODS) if name in distances), next(iter(distances)))
    points, errors = poses.points_mm, distances[shown]
    worst = int(np.argmax(errors))
    cloud = PointCloud(
        points,
        [f"pose {number}" for number in range(1, len(points) + 1)],
        [PointColumn(f"error, {name}", "mm", values) for name, values in distances.items()],
        [PointColumn(f"J{i}", "deg", column) for i, column in enumerate(poses.angles_deg.T, start=1)],
        noun="pose",
        shown=list(distances).index(shown),
        marked={worst: f"pose {worst + 1}"},
    )
    label = f"{format_count(len(points), 'pose')} in space, coloured by error; the arm goes to the one pointed at"
    still = error_in_workspace(points, errors, name=shown)
    caption = still.caption.partition(" Clusters of large errors")[0]
    return Scene(
        label,
        "mm",
        replace(still, caption=f"{caption} On a screen a ring marks the largest."),
        cloud=cloud,
        mechanism=arm_mechanism(arm, start=np.radians(poses.angles_deg[worst]), follows=[*range(arm.n_joints)]),
    )


def _arm(results: Reproduction) -> Section | MissingPart:
    arm = results.figures.arm
    if arm is None:
        return MissingPart("The drawing of the arm", "--figure 1")
    angles = ", ".join(f"J{i} = {format_degrees(angle)}" for i, angle in enumerate(arm.angles_deg.tolist(), start=1))
    return Section(
        "The arm (Figures 1 and 2)",
        "The paper's arm has six revolute joints and a stylus. It is drawn at the centre of the boxes of joint "
        "angles: "
        f"{angles}. The paper gives no such pose; it was chosen here.",
        tables=(_parameter_table(arm),),
        scenes=(
            Scene(
                "The paper's arm in space: links, joint axes and tip",
                "mm",
                with_figure_number(1, arm_figure(arm.frames, arm.tip_mm)),
                mechanism=arm_mechanism(load_arm(ARM), controls=True),
            ),
        ),
        figures=(with_figure_number(2, frame_figure(arm.frames, arm.tip_mm)),),
        folded=bool(results.rows()),
    )


def _parameter_table(arm: ArmPose) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for i, (joint, angle) in enumerate(zip(TABLE_1, arm.angles_deg, strict=True), start=1):
        numbers = joint.a_mm, joint.d_mm, joint.theta_deg + float(angle), joint.alpha_deg
        rows.append((f"J{i}", *(as_count(round(float(number), 6) + 0.0) for number in numbers)))
    return Table(
        Column.of("joint", "a [mm]", "d [mm]", "theta [deg]", "alpha [deg]"),
        tuple(rows),
        "Denavit-Hartenberg parameters of each joint at this pose (the paper's Table 1 has theta at zero joint angles)",
    )


def _network(results: Reproduction) -> Section | MissingPart:
    sizes = results.figures.network
    if sizes is None:
        return MissingPart("The drawing of the network", "--figure 3")
    return Section(
        "The network (Figure 3)", figures=(with_figure_number(3, network_layers(sizes)),), folded=bool(results.rows())
    )


def _ten_poses(results: Reproduction) -> Section | MissingPart:
    poses = results.figures.figure_4
    if poses is None:
        return MissingPart("Figure 4", "--figure 4")
    coordinates = coordinates_by_reading(poses.points_mm, poses.predicted_mm, styles=STYLES)
    figures = (with_figure_number(4, coordinates), errors_by_reading(poses.deviations(), styles=STYLES))
    return Section("Some poses in detail (Figure 4)", figures=figures, folded=bool(results.rows()))


def _facts(results: Reproduction) -> tuple[tuple[str, str], ...]:
    boxes, seconds = results.boxes, results.training_seconds
    time = f"{format_in_text(seconds, unit='s')} ({format_in_text(seconds / 60, unit='min')})"
    if results.trained:
        time += f", ended {' to '.join(dict.fromkeys(results.trained))}"
    simulation, experiment = format_degrees(boxes.simulation_deg), format_degrees(boxes.experiment_deg)
    machines = [
        f"{one['cpu']}, {format_count(int(one['cores']), 'core')}, Python {one['python']}, NumPy {one['numpy']}"
        for one in results.machines
    ]
    skipped = format_count(len(results.skipped), "part")
    return (
        *(("machine", machine) for machine in machines),
        ("version", f"truearm {results.truearm}"),
        ("training time", time),
        ("extent", f"quick; {skipped} skipped" if results.quick else "full settings"),
        ("boxes of joint angles", f"simulations \u00b1{simulation}, experiment \u00b1{experiment}"),
        ("paper", CITATION),
    )
