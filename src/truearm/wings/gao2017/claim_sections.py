"""Sections on the final test and on the paper's claims; every number in a sentence comes from the results."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

import numpy as np

from truearm.number_format import format_count, format_exact, format_in_text, format_percent, show_mm
from truearm.pages.drawings.error_figures import coordinates_by_reading, errors_by_reading
from truearm.pages.page import Cell, Column, Section, Table
from truearm.pages.plotting import join_phrases
from truearm.typing import FloatArray
from truearm.wings.gao2017.claim_figures import (
    box_figure,
    crossings,
    experiment_box_figure,
    learning_rate_figure,
    load_experiment_box,
    outside_figure,
    scatter_figure,
    share_figure,
    widths_at,
)
from truearm.wings.gao2017.phrases import (
    SHARES_NOTE,
    MissingPart,
    as_count,
    cut_note,
    format_degrees,
    format_row_numbers,
    mark_cut,
    range_cell,
    with_figure_number,
)
from truearm.wings.gao2017.results import FITTED_BOX, METHODS, FinalTestResult, Reproduction, RowResult
from truearm.wings.gao2017.table_figure import STYLES
from truearm.wings.gao2017.tables import TABLES, ModelErrors

# The final test ------------------------------------------------------------------------------------------------------


def final_test_section(results: Reproduction) -> Section | MissingPart:
    """The final test beside the paper's, with Figures 6 to 8."""
    title = "Error before and after (Figures 6 to 8)"
    data, test = results.figures, results.final_test
    seven = data.figure_7
    made = {
        6: data.figure_6 and errors_by_reading(data.figure_6.deviations(), styles=STYLES),
        7: seven and coordinates_by_reading(seven.points_mm, seven.predicted_mm, styles=STYLES),
        8: data.figure_8 and errors_by_reading(data.figure_8.deviations(), styles=STYLES),
    }
    figures = [with_figure_number(k, figure) for k, figure in made.items() if figure]
    missing = [str(MissingPart(f"Figure {k}", f"--figure {k}")) for k, figure in made.items() if not figure]
    if test is None:
        no_test = MissingPart("The final test", "--table 4")
        return Section(title, "\n\n".join([str(no_test), *missing]), figures=tuple(figures)) if figures else no_test
    removed = join_phrases(
        f"{mark_cut(name, test.n_cut(name))} {format_percent(share / 100)}"
        for name, share in removed_percent(test).items()
    )
    n_cut = sum(test.n_cut(name) for name in METHODS)
    text = (
        f"Share of the nominal error that is removed, median on {format_count(len(test.runs), 'virtual arm')}: "
        f"{removed or 'no model was fitted'}. The paper reports "
        f"{format_percent(test.paper['network'].removed_percent / 100)}. The test has {test.poses} further poses; an "
        f"error is the absolute error of one coordinate, of {3 * test.poses} in all. {SHARES_NOTE}{cut_note(n_cut)}"
    )
    return Section(
        title, "\n\n".join([text, *missing]), tables=(_final_table(test),), figures=tuple(figures), folded=True
    )


def removed_percent(test: FinalTestResult) -> dict[str, float]:
    """Median share of the nominal error that each fitted model removes."""
    return {name: median(one.removed_percent for one in errors) for name, errors in test.models().items()}


def _final_table(test: FinalTestResult) -> Table:
    def spread(values: Sequence[float]) -> list[Cell]:
        return [float(median(values)), range_cell(values)]

    def line(name: str, errors: Sequence[ModelErrors], *, compensated: bool = True) -> tuple[Cell, ...]:
        cells = [*spread([one.mean_mm for one in errors]), *spread([one.max_mm for one in errors])]
        if not compensated:
            return (name, *cells, *[None] * 4)
        counts = [as_count(float(median(one.over_mm[level] for one in errors))) for level in levels]
        seconds = [one.seconds for one in errors if one.seconds is not None]
        removed = float(median(one.removed_percent for one in errors))
        return (name, *cells, *counts, removed, float(median(seconds)) if seconds else None)

    levels = list(test.paper["network"].over_mm)
    rows = [
        line("paper, nominal", [test.paper["nominal"]], compensated=False),
        line("paper, network", [test.paper["network"]]),
        line("nominal", test.of("nominal"), compensated=False),
        *(line(mark_cut(name, test.n_cut(name)), errors) for name, errors in test.models().items()),
        ("noise floor", *spread([run.noise_floor_mm for run in test.runs]), *[None] * 6),
    ]
    return Table(
        Column.of(
            "model",
            Column("median", "mm", group="mean error"),
            Column("range", "mm", group="mean error"),
            Column("median", "mm", group="largest error"),
            Column("range", "mm", group="largest error"),
            *(Column(f"> {level:g}\u00a0mm", group=f"of {3 * test.poses} coordinates") for level in levels),
            "removed [%]",
            "fit [s]",
        ),
        tuple(rows),
        f"The final test on {format_count(len(test.runs), 'virtual arm')}: medians and ranges",
    )


def share_section(results: Reproduction) -> Section | MissingPart:
    """What the removed share means."""
    test = results.final_test
    if test is None or not test.of("varpro"):
        return MissingPart("The meaning of a removed share", "--table 4")
    nominal = float(median(one.mean_mm for one in test.of("nominal")))
    floor = float(median(run.noise_floor_mm for run in test.runs))
    errors = {name: float(median(one.mean_mm for one in fits)) for name, fits in test.models().items()}
    remaining = errors["varpro"]
    text = (
        f"With varpro, {format_percent(1 - remaining / nominal)} of a mean error of {show_mm(nominal)} is removed; "
        f"{show_mm(remaining)} remains. The noise of the readings alone, which no model can predict, causes "
        f"{show_mm(floor)}: more than {format_percent(1 - floor / nominal)} could not be removed, and the error of "
        f"varpro is {format_in_text(remaining / floor)} times that floor.\n\n"
        "A share depends on the arm before compensation as much as on the model. With an arm that is ten times better, "
        f"{show_mm(nominal / 10)}, the same remaining {show_mm(remaining)} would be "
        f"{format_percent(1 - remaining / (nominal / 10))} removed. In use, the remaining error counts, and where it "
        f"applies: inside the box of joint angles in which the network was trained. {SHARES_NOTE}"
        f"{cut_note(sum(test.n_cut(name) for name in METHODS))}"
    )
    drawn = {"nominal": nominal, "paper": test.paper["network"].mean_mm, **errors, "noise floor": floor}
    return Section(
        f"What {format_percent(test.paper['network'].removed_percent / 100)} means",
        text,
        figures=(share_figure(drawn, before="nominal"),),
    )


# The claims ----------------------------------------------------------------------------------------------------------


def learning_rate_section(results: Reproduction) -> Section | MissingPart:
    """The learning rate has no effect."""
    claim = results.claims.learning_rate
    if claim is None:
        return MissingPart("The effect of the learning rate", "--table 2")
    rates = ", ".join(format_exact(rate) for rate in sorted(claim.rates))
    text = (
        "The learning rate has no effect: the damping alone determines a step of the Levenberg-Marquardt method, and "
        f"trainlm has no learning rate. The paper's {format_row_numbers(claim.rows)}, with the rates {rates}, "
        f"are one training. Here its mean error is {show_mm(claim.mean_mm)}, the median of its starts; "
        f"the paper's values range from {show_mm(min(claim.paper_mean_mm))} to "
        f"{show_mm(max(claim.paper_mean_mm))}.{cut_note(claim.n_cut)}"
    )
    return Section("The learning rate", text, figures=(learning_rate_figure(claim),), folded=True)


def scatter_section(results: Reproduction) -> Section | MissingPart:
    """The spread of the paper's values beside that of random starts."""
    claim = results.claims.scatter
    if claim is None:
        return MissingPart("The scatter of starts", "--table 2")
    starts, many, published = claim.mean_mm, claim.mean_many_mm, claim.paper_rows_mean_mm
    text = (
        f"Random starts alone spread the mean error by {format_percent(claim.relative_spread)} of the median, from "
        f"{show_mm(min(starts))} to {show_mm(max(starts))} ({claim.what.strip().rstrip('.')}). The paper's "
        f"{format_count(len(published), 'value')} ({format_row_numbers(claim.paper_rows)}), from "
        f"{show_mm(min(published))} to {show_mm(max(published))}, spread by "
        f"{format_percent(claim.paper_relative_spread)}; the paper attributes this to other goals and learning rates. "
        "Only the spreads are comparable: the level depends on the box. On 2000 poses the same starts range from "
        f"{show_mm(min(many))} to {show_mm(max(many))}; the choice of ten test poses causes the rest."
        f"{cut_note(claim.n_cut)}"
    )
    return Section("The scatter of starts", text, figures=(scatter_figure(claim),), folded=True)


def joint_ranges_section(results: Reproduction) -> Section:
    """How the joint ranges were chosen, and the consequences if they are wrong."""
    title = "The joint ranges"
    boxes, claim = results.boxes, results.claims.boxes
    study = load_experiment_box()
    widest = " and ".join(f"\u00b1{format_degrees(round(p, 1))}" for p in widths_at(study, TABLES[4][-1].mean_mm))
    first = (
        "Every joint angle is drawn uniformly from a range about one working pose: "
        f"\u00b1{format_degrees(boxes.simulation_deg)} in simulations, \u00b1{format_degrees(boxes.experiment_deg)} in "
        f"the experiment. {boxes.how}"
    )
    about = (
        f"Row 4 of Table 4 has the paper's mean error with trainlm at {widest}, by trainings in boxes of many widths "
        f"that are kept with the program ({study.how}). All numbers of Table 4 and of the final test depend on the "
        "choice, and so do those of truearm demo."
    )
    text = [first, about, *_remaining_ratios(results.tables.get(2) or ())]
    if claim is None:
        missing = str(MissingPart("The study of boxes of other widths", "--all"))
        return Section(title, "\n\n".join([*text, missing]))
    for row, errors in claim.mean_mm.items():
        published = claim.paper_mean_mm[row]
        places = " and ".join(
            f"\u00b1{format_degrees(place)}" for place in crossings(claim.half_width_deg, errors, published)
        )
        text.append(
            f"Row {row} of Table 2 has the paper's mean error, {show_mm(published)}, "
            + (f"in a box of {places}." if places else "in none of the boxes tried.")
            + _nearby_errors(claim.half_width_deg, errors, boxes.simulation_deg)
        )
    if claim.n_cut:
        text.append(cut_note(claim.n_cut).strip())
    simulation = box_figure(claim, chosen=boxes.simulation_deg)
    experiment = experiment_box_figure(study, chosen=boxes.experiment_deg)
    return Section(title, "\n\n".join(text), figures=(simulation, experiment), folded=True)


def _remaining_ratios(rows: Sequence[RowResult]) -> list[str]:
    """How well the rows that were used to fit the box agree with it."""
    ratios = [ratio for row in rows if row.verdict["trainlm"] == FITTED_BOX and (ratio := row.ratio["trainlm"])]
    if not ratios:
        return []
    mean = format_in_text(float(np.exp(np.mean(np.log(ratios)))))
    text = (
        f"In this run the {format_count(len(ratios), 'row')} of Table 2 that were used to fit the box have, with "
        f"trainlm, {format_in_text(min(ratios))} to {format_in_text(max(ratios))} times the paper's mean error, {mean} "
        "times in the geometric mean."
    )
    return [text]


def _nearby_errors(widths: Sequence[float], errors: Sequence[float], chosen: float, *, by: float = 5.0) -> str:
    """Errors in boxes somewhat narrower and wider, inside the range that was tried."""
    order = np.argsort(widths)
    x, y = np.array(widths)[order], np.log(np.array(errors)[order])
    parts = [
        f"{show_mm(float(np.exp(np.interp(width, x, y))))} at \u00b1{format_degrees(width)}"
        for width in (chosen - by, chosen, chosen + by)
        if x[0] <= width <= x[-1]
    ]
    return f" The error is {', '.join(parts)}." if parts else ""


def outside_section(results: Reproduction) -> Section | MissingPart:
    """The errors of the direct network outside its box."""
    claim = results.claims.outside
    if claim is None:
        return MissingPart("The error outside the box", "--table 4")
    order = np.argsort(claim.distance_deg)
    distance = np.array(claim.distance_deg)[order]
    errors = {name: np.array(values)[order] for name, values in claim.median_mm.items()}
    varpro, nominal = errors["varpro"], errors["nominal"]
    worse = [float(distance[0]), *crossings(distance, varpro / nominal, 1.0)] if varpro[-1] > nominal[-1] else []
    near, far = format_degrees(float(distance[0])), format_degrees(float(distance[-1]))
    text = (
        "A direct network is valid only in the range of joint angles it was trained on. "
        f"Median errors with the farthest joint {near} and {far} outside the box: varpro {_pair(varpro)}; the nominal "
        f"arm without compensation {_pair(nominal)}; a kinematic model identified from the same readings "
        f"{_pair(errors['kinematic'])}."
        + (
            f" From {format_degrees(worse[-1])} on the error of varpro exceeds that of the nominal arm."
            if worse
            else ""
        )
        + cut_note(claim.n_cut)
    )
    return Section("Outside the box", text, figures=(outside_figure(claim),))


def _pair(values: FloatArray) -> str:
    return f"{show_mm(float(values[0]))} and {show_mm(float(values[-1]))}"
