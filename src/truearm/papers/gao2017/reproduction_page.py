"""The page that sets a paper's tables and figures beside what was found: Gao et al. (2017), reproduced.

Every sentence with a number is made from the findings; what was not run is said to be missing, with the command for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from truearm.pages.number_format import format_count, format_in_text
from truearm.pages.page import Cell, Column, LabelledValue, Page, Section, Table
from truearm.pages.plotting import Style, styles_of
from truearm.papers.gao2017.arm_drawing import arm_figure, denavit_hartenberg, frame_figure
from truearm.papers.gao2017.claim_sections import (
    joint_ranges_section,
    learning_rate_section,
    outside_section,
    scatter_section,
)
from truearm.papers.gao2017.final_test_sections import final_test_section, share_section
from truearm.papers.gao2017.network_drawing import network_layers
from truearm.papers.gao2017.phrases import COMMAND, MissingPart, as_count, format_degrees, with_figure_number
from truearm.papers.gao2017.prediction_figure import predictions_by_pose
from truearm.papers.gao2017.reproduction_file import ArmFrames, ReproductionResult, read_reproduction
from truearm.papers.gao2017.table_figure import PAPER_STYLE
from truearm.papers.gao2017.table_sections import count_verdicts, describe_accuracy, speedups, table_section

TITLE = "Gao et al. 2017, reproduced"
CITED = (
    "Gao, Zhang, San, Wu, Wang: Modeling and Error Compensation of Robotic Articulated Arm Coordinate Measuring "
    "Machines Using BP Neural Network. Complexity 2017, article 5156264"
)
_PURPOSE = (
    "The paper trains networks that turn the six joint angles of a measuring arm into x, y and z. Here its tables and "
    "figures stand beside ours. Faithful is the paper's own way: MATLAB's training functions by their documentation, "
    "with each row's settings and stops. lm is the trainer of truearm: the output layer is solved exactly at every "
    "step, and the damping follows Nielsen's rule."
)
_PENS: dict[str, Style] = {
    **styles_of(("faithful", "lm", "kinematic", "noise floor", "nominal")),
    "paper": PAPER_STYLE,
    "row 1": styles_of(("row 1", "row 15"))["row 1"],
    "row 15": styles_of(("row 1", "row 15"))["row 15"],
}


def reproduction_page(found: Mapping[str, Any]) -> Page:
    """Make the page of a reproduction.

    Parameters
    ----------
    found : mapping
        The findings as ``reproduction.json`` holds them: lengths in mm, times in s; a part that was not run is None.

    Returns
    -------
    Page

    Raises
    ------
    InputError
        If a key is missing, or a value is not what it must be. The key is named with its place.
    """
    all_found = read_reproduction(found)
    tables = all_found.rows_by_table()
    parts: list[Section | MissingPart] = [
        _in_short(all_found),
        _arm(all_found),
        _network(all_found),
        *(table_section(number, tables.get(number), all_found.rule, styles=_PENS) for number in (2, 3, 4)),
        _some_poses(all_found),
        final_test_section(all_found, styles=_PENS),
        share_section(all_found, styles=_PENS),
        learning_rate_section(all_found, styles=_PENS),
        scatter_section(all_found, styles=_PENS),
        joint_ranges_section(all_found, styles=_PENS),
        outside_section(all_found, styles=_PENS),
    ]
    sections = [part for part in parts if isinstance(part, Section)]
    if len(sections) < len(parts):
        missing = [str(part) for part in parts if isinstance(part, MissingPart)]
        sections.append(Section("Not part of this run", "\n\n".join(missing)))
    if all_found.left_out:
        sections.append(_left_out(all_found))
    quick = " A quick run; what it left out stands at the end." if all_found.quick and all_found.left_out else ""
    return Page(
        title=TITLE,
        subtitle=f"{CITED}.{quick}",
        summary=_summary(all_found),
        sections=tuple(sections),
        facts=_facts(all_found),
    )


def _summary(found: ReproductionResult) -> tuple[LabelledValue, ...]:
    rows = []
    for name in ("faithful", "lm"):
        verdicts = count_verdicts(found.rows(), name)
        if verdicts:
            good = verdicts["reproduced"] + verdicts["better"]
            counted_rows = good + verdicts["not reached"]
            rows.append(LabelledValue(f"table rows reproduced or better, {name}", f"{good} of {counted_rows}"))
    times = speedups(found.rows())
    if times:
        label = "as fast as faithful is lm at the paper's mean error, median of rows"
        rows.append(LabelledValue(label, float(np.median(times)), "times"))
    if found.final_test is not None:
        for name, share in found.final_test.removed_percent().items():
            if name != "kinematic":
                rows.append(
                    LabelledValue(f"error removed on {found.final_test.poses} further poses, {name}", share, "%")
                )
    return tuple(rows)


def _in_short(found: ReproductionResult) -> Section:
    rows = found.rows()
    run = [row for row in rows if row.by_trainer()]
    told = [_PURPOSE]
    if rows:
        told.append(f"{format_count(len(run), 'row')} of {len(rows)} were run. " + describe_accuracy(rows))
    times = speedups(rows)
    if times:
        span = f" (from {format_in_text(min(times))} to {format_in_text(max(times))})" if len(times) > 1 else ""
        told.append(
            f"In {format_count(len(times), 'row')} both get there; on the same machine faithful then takes "
            f"{format_in_text(float(np.median(times)))} times as long as lm in the median{span}. The paper's own times "
            "are of a machine it does not describe."
        )
    tables = (_verdicts(found),) if rows else ()
    return Section("In short", "\n\n".join(told), tables=tables)


def _verdicts(found: ReproductionResult) -> Table:
    by_trainer = {name: count_verdicts(found.rows(), name) for name in ("faithful", "lm")}
    heads = [(name, verdict) for name, verdicts in by_trainer.items() for verdict in verdicts]
    return Table(
        (Column("table"), Column("rows"), *(Column(verdict, group=f"{name}, rows") for name, verdict in heads)),
        tuple(
            (f"Table {number}", len(rows), *(count_verdicts(rows, name)[verdict] for name, verdict in heads))
            for number, rows in found.rows_by_table().items()
        ),
        "Trainings by verdict, of those that were run, each once; the rule stands with each table",
    )


def _arm(found: ReproductionResult) -> Section | MissingPart:
    arm = found.figures.arm
    title = "The arm (Figures 1 and 2)"
    if arm is None:
        return MissingPart("The drawing of the arm", "--figure 1")
    frames, tip = [list(frame) for frame in arm.frames], arm.tip_mm
    pictures = (with_figure_number(1, arm_figure(frames, tip)), with_figure_number(2, frame_figure(frames, tip)))
    return Section(
        title,
        "The paper's arm has six turning joints and a stylus. It is drawn at the pose that the boxes of joint angles "
        f"lie around: {', '.join(f'q{i} = {format_degrees(a)}' for i, a in enumerate(arm.angles_deg, start=1))}. The paper "
        "gives no such pose; it was chosen here.",
        tables=(_parameters(arm),),
        figures=pictures,
    )


def _parameters(arm: ArmFrames) -> Table:
    parameters = denavit_hartenberg([list(frame) for frame in arm.frames])
    rows: list[tuple[Cell, ...]] = []
    for i, (a, d, theta, alpha) in enumerate(parameters, start=1):
        rows.append((i, *(as_count(round(float(v), 6) + 0.0) for v in (a, d, np.degrees(theta), np.degrees(alpha)))))
    return Table(
        (Column("joint"), Column("a", "mm"), Column("d", "mm"), Column("theta", "deg"), Column("alpha", "deg")),
        tuple(rows),
        "Parameters of Denavit and Hartenberg that lead from each frame to the next at this pose, taken from the "
        "drawing's own frames (the paper's Table 1 has theta at zero angles)",
    )


def _network(found: ReproductionResult) -> Section | MissingPart:
    title = "The network (Figure 3)"
    if found.figures.network is None:
        return MissingPart("The drawing of the network", "--figure 3")
    return Section(title, figures=(with_figure_number(3, network_layers(found.figures.network.sizes)),))


def _some_poses(found: ReproductionResult) -> Section | MissingPart:
    title = "Some poses in detail (Figure 4)"
    poses = found.figures.figure_4
    by_name = {} if poses is None else {key: points for key, points in poses.predicted_mm.items() if points is not None}
    if poses is None or not by_name:
        return MissingPart("Figure 4", "--figure 4")
    predicted = {"lm" if key == "ours" else key: points for key, points in by_name.items()}
    pens = {**styles_of(predicted), **_PENS}
    return Section(
        title, figures=(with_figure_number(4, predictions_by_pose(poses.points_mm, predicted, styles=pens)),)
    )


def _left_out(found: ReproductionResult) -> Section:
    return Section(
        "What was left out",
        f"All of it is made by: {COMMAND} --all",
        tables=(Table((Column("left out"),), tuple((part,) for part in found.left_out), "Parts left out of this run"),),
    )


def _facts(found: ReproductionResult) -> tuple[tuple[str, str], ...]:
    boxes, seconds = found.boxes, found.training_seconds
    trained = f"{format_in_text(seconds, unit='s')} ({format_in_text(seconds / 60, unit='min')})"
    if found.trained:
        trained += f", ended {' to '.join(dict.fromkeys(found.trained))}"
    return (
        *(
            ("machine", f"{one.cpu}, {format_count(one.cores, 'core')}, Python {one.python}, NumPy {one.numpy}")
            for one in found.machines
        ),
        ("version", f"truearm {found.truearm}"),
        ("training time", trained),
        ("extent", f"quick; {format_count(len(found.left_out), 'part')} left out" if found.quick else "full settings"),
        (
            "boxes of joint angles",
            f"simulations \u00b1{format_degrees(boxes.simulation_deg)}, experiment \u00b1{format_degrees(boxes.experiment_deg)}",
        ),
        ("paper", CITED),
    )
