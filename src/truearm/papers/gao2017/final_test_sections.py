"""The final test of Gao et al. (2017): poses before and after compensation, and what the share removed means."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import median

from truearm.compensation.models.error_figures import coordinates_by_reading, errors_by_reading
from truearm.pages.number_format import format_count, format_in_text, format_mm, format_percent
from truearm.pages.page import Cell, Column, Section, Table
from truearm.pages.plotting import Figure, Style, join_phrases
from truearm.papers.gao2017.claim_figures import share_removed
from truearm.papers.gao2017.phrases import (
    TRAINING_SHARES_NOTE,
    MissingPart,
    as_count,
    median_and_range,
    with_figure_number,
)
from truearm.papers.gao2017.reproduction_file import FinalTest, ReproductionResult


def final_test_section(found: ReproductionResult, *, styles: Mapping[str, Style]) -> Section | MissingPart:
    """Set the final test beside the paper's, with Figures 6 to 8."""
    title = "Error before and after (Figures 6 to 8)"
    drawn = found.figures
    pictures: list[Figure] = []
    if drawn.figure_6 is not None:
        pictures.append(
            with_figure_number(6, errors_by_reading({"nominal": drawn.figure_6.deviation_mm}, styles=styles))
        )
    if drawn.figure_7 is not None and drawn.figure_7.predicted_mm["ours"] is not None:
        points, predicted = drawn.figure_7.points_mm, drawn.figure_7.predicted_mm["ours"]
        pictures.append(with_figure_number(7, coordinates_by_reading(points, {"lm": predicted}, styles=styles)))
    if drawn.figure_8 is not None:
        pictures.append(with_figure_number(8, errors_by_reading({"lm": drawn.figure_8.deviation_mm}, styles=styles)))
    made = {6: drawn.figure_6, 7: drawn.figure_7, 8: drawn.figure_8}
    told = [str(MissingPart(f"Figure {k}", f"--figure {k}")) for k, part in made.items() if part is None]
    missing = MissingPart("The final test", "--table 4")
    if found.final_test is None and not pictures:
        return missing
    if found.final_test is None:
        return Section(title, "\n\n".join([str(missing), *told]), figures=tuple(pictures))
    test = found.final_test
    removed = test.removed_percent()
    beside = join_phrases(f"{name} {format_percent(share / 100)}" for name, share in removed.items())
    first = (
        f"The paper's final test: {test.poses} further poses, and the share of the nominal error that is gone. The "
        f"paper says {format_percent(test.paper.network.removed_percent / 100)}. On "
        f"{format_count(len(test.runs), 'virtual arm')} the "
        f"median is: {beside or 'nothing was fitted'}. An error is the absolute error of one coordinate, of "
        f"{3 * test.poses} in all. {TRAINING_SHARES_NOTE}"
    )
    return Section(title, "\n\n".join([first, *told]), tables=(_final_table(test),), figures=tuple(pictures))


def _final_table(test: FinalTest) -> Table:
    runs = test.runs
    lines: list[tuple[Cell, ...]] = [
        ("paper, nominal", test.paper.nominal.mean_mm, None, test.paper.nominal.max_mm, None, *[None] * 4),
        (
            "paper, network",
            test.paper.network.mean_mm,
            None,
            test.paper.network.max_mm,
            None,
            test.paper.network.over_0_05,
            test.paper.network.over_0_08,
            test.paper.network.removed_percent,
            None,
        ),
        (
            "nominal",
            *median_and_range([run.nominal.mean_mm for run in runs]),
            *median_and_range([run.nominal.max_mm for run in runs]),
            *[None] * 4,
        ),
    ]
    for name, fits in test.fits().items():
        lines.append(
            (
                name,
                *median_and_range([fit.mean_mm for fit in fits]),
                *median_and_range([fit.max_mm for fit in fits]),
                as_count(float(median(fit.over_0_05 for fit in fits))),
                as_count(float(median(fit.over_0_08 for fit in fits))),
                float(median(fit.removed_percent for fit in fits)),
                float(median(fit.seconds or 0.0 for fit in fits)),
            )
        )
    lines.append(("noise floor", *median_and_range([run.noise_floor_mm for run in runs]), *[None] * 6))
    return Table(
        (
            Column("model"),
            Column("median", "mm", group="mean error"),
            Column("range", "mm", group="mean error"),
            Column("median", "mm", group="largest error"),
            Column("range", "mm", group="largest error"),
            Column("> 0.05\u00a0mm", group=f"of {3 * test.poses} coordinates"),
            Column("> 0.08\u00a0mm", group=f"of {3 * test.poses} coordinates"),
            Column("removed", "%"),
            Column("fit", "s"),
        ),
        tuple(lines),
        f"The final test on {format_count(len(runs), 'virtual arm')}: medians and ranges",
    )


def share_section(found: ReproductionResult, *, styles: Mapping[str, Style]) -> Section | MissingPart:
    """Say what the share removed means."""
    test = found.final_test
    if test is None or "lm" not in test.fits():
        return MissingPart("What a share removed means", "--table 4")
    nominal, floor = (
        float(median(values))
        for values in ([run.nominal.mean_mm for run in test.runs], [run.noise_floor_mm for run in test.runs])
    )
    errors = {name: float(median(fit.mean_mm for fit in fits)) for name, fits in test.fits().items()}
    left = errors["lm"]
    told = (
        f"With lm {format_percent(1 - left / nominal)} removed of a mean error of {format_mm(nominal)} leaves "
        f"{format_mm(left)}. The noise of the readings alone, which no model can know, makes {format_mm(floor)}: "
        f"more than {format_percent(1 - floor / nominal)} could not be removed, and the error of lm is "
        f"{format_in_text(left / floor)} times that floor.\n\n"
        "A share says as much of the state before as of the model. Had the arm been ten times better before, "
        f"{format_mm(nominal / 10)}, the same {format_mm(left)} left would be "
        f"{format_percent(1 - left / (nominal / 10))} removed. What counts in use is the error that is left, and where: "
        f"the share holds inside the box of joint angles that the network was trained in. {TRAINING_SHARES_NOTE}"
    )
    drawn = {"nominal": nominal, "paper": test.paper.network.mean_mm, **errors, "noise floor": floor}
    return Section(
        f"What {format_percent(test.paper.network.removed_percent / 100)} means",
        told,
        figures=(share_removed(drawn, before="nominal", styles=styles),),
    )
