"""The page of the paper's procedure on readings of a person's own: the answer, its Table 4, its Figures 6 to 8."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm import __version__
from truearm.number_format import format_count, format_in_text, format_mm, format_number
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.plotting import Figure, figure_style, join_phrases, make_panel, set_log_scale
from truearm.papers.gao2017.claim_figures import share_figure
from truearm.papers.gao2017.network_drawing import network_layers
from truearm.papers.gao2017.procedure import Procedure
from truearm.papers.gao2017.table_figure import STYLES
from truearm.papers.gao2017.tables import FINAL_TEST, N_FINAL_TEST
from truearm.papers.gao2017.training import machine_data
from truearm.show.error_figures import coordinates_by_reading, errors_by_reading


def procedure_page(results: Procedure, *, arm: str | None, remarks: tuple[str, ...]) -> Page:
    """Make the page.

    Parameters
    ----------
    results : Procedure
    arm : str or None
        Its name.
    remarks : tuple of str
    """
    own, best = results.errors["network"], results.best
    shown = {"network": own} if best is None else {"network": own, best: results.errors[best]}
    state: State = "none" if best is None else "good" if best == "network" else "doubtful"
    return Page(
        title="The procedure of Gao et al. 2017 on these readings",
        subtitle=f"{arm or 'An arm without a description'}, {format_count(results.n_readings, 'reading')}: a network "
        "is chosen by cross-validation, trained on all of them and tested, where the arm is known beside its models.",
        summary=(
            *(LabelledValue(f"mean error of a coordinate, {name}", one.mean_mm, "mm") for name, one in shown.items()),
            LabelledValue("2 sigma, network", own.two_sigma_mm, "mm"),
        ),
        sections=(_comparison(results, remarks), _search(results), _amounts(results), _network(results)),
        facts=_facts(results, arm),
        verdict=PageVerdict(results.summary(), state, results.advice()),
    )


def paper_figures(results: Procedure) -> dict[int, Figure]:
    """Figures 6 (nominal errors, of an arm that is known), 7 (predicted coordinates) and 8 (their errors)."""
    deviations = {name: points - results.points for name, points in results.predicted.items()}
    network = {"network": results.predicted["network"]}
    figures = {7: coordinates_by_reading(results.points, network, styles=STYLES)}
    figures |= {
        number: errors_by_reading({name: deviations[name]}, styles=STYLES)
        for number, name in ((6, "nominal"), (8, "network"))
        if name in deviations
    }
    return {
        number: replace(
            figures[number], caption=f"Figure {number} of the paper, of this arm. {figures[number].caption}"
        )
        for number in sorted(figures)
    }


def _comparison(results: Procedure, remarks: tuple[str, ...]) -> Section:
    """The errors of all models, and the paper's figures."""
    own, means = results.errors["network"], {name: one.mean_mm for name, one in results.errors.items()}
    text = [own.two_sigma_sentence(), results.test_sentence(), *remarks]
    if results.n_outside:
        text.append(
            f"{format_count(results.n_outside, 'test reading')} of {len(results.points)} lie outside the joint ranges "
            "of the training, where no network is valid."
        )
    text += [f"There is no {name} model: {why}." for name, why in results.refused.items()]
    shares = (share_figure(means, before="nominal"),) if "nominal" in means and min(means.values()) > 0 else ()
    columns = Column.of(
        "model", "mean [mm]", "rms [mm]", "95 % [mm]", "max [mm]", "2 sigma [mm]",
        *(Column(f"> {level:g}\u00a0mm", group="coordinates") for level in own.over_mm), "distance [mm]",
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, one in results.errors.items():
        sizes = one.mean_mm, one.rms_mm, one.p95_mm, one.max_mm, one.two_sigma_mm
        rows.append((name, *sizes, *one.over_mm.values(), one.mean_distance_mm))
    for name, printed in FINAL_TEST.items():
        sizes_printed = printed.mean_mm, None, None, printed.max_mm, None
        rows.append((f"the paper's, {name}", *sizes_printed, *(printed.over_mm.values() or (None, None)), None))
    caption = (
        f"Absolute error of a coordinate {results.test_phrase()}, {3 * own.n} coordinates. 2 sigma is twice the root "
        "mean square error, distance the mean distance of the points. The last rows are the paper's own arm, "
        f"{N_FINAL_TEST} poses"
    )
    figures = (*shares, *paper_figures(results).values())
    table = Table(columns, tuple(rows), caption)
    return Section("Error before and after (Figures 6 to 8)", "\n\n".join(text), tables=(table,), figures=figures)


def _search(results: Procedure) -> Section:
    chosen, grid = results.chosen, results.grid
    rated = any(row.setting.learning_rate is not None for row in results.search)
    text = (
        f"{format_count(len(results.search), 'network')}, each trained {grid.folds} times without one of {grid.folds} "
        "folds, from another random start, and tested on this fold. Kept is the smallest mean error, as in the paper. "
        f"Folds and starts alone make the chosen one err by {_span(chosen.fold_mean_mm)} mm. "
        f"Readings of one position or pose are in one fold; there are {format_number(results.n_groups)} of them. "
        "Without a goal (0) 15 % of the readings end a training when their error grows. "
    )
    if not rated:
        text += (
            "There is no learning rate: the Levenberg-Marquardt method has none; what the paper varies by it is the "
            "random start. "
        )
    if not grid.hidden:
        text += "Networks with more weights than training coordinates are not tried."
    columns = Column.of(
        "network", "trainer", "goal", *(["learning rate"] if rated else []), "weights", "mean [mm]", "folds [mm]",
        "max [mm]", "2 sigma [mm]", "epochs", "training [s]", "",
    )  # fmt: skip
    rows = tuple(
        (
            ", ".join(map(str, row.setting.hidden)),
            row.setting.trainer,
            f"{row.setting.goal:g}",
            *([row.setting.learning_rate] if rated else []),
            row.n_weights,
            row.errors.mean_mm,
            _span(row.fold_mean_mm),
            row.errors.max_mm,
            row.errors.two_sigma_mm,
            round(row.epochs),
            row.seconds,
            "chosen" if row is chosen else None,
        )
        for row in results.search
    )
    caption = f"Table 4 of this arm, about {format_number(chosen.n_train)} training readings a fold"
    return Section("The search (Table 4)", text, tables=(Table(columns, rows, caption),))


def _amounts(results: Procedure) -> Section:
    rows = results.amounts
    models = [name for name in ("nominal", "kinematic") if name in results.errors]
    values = [row.errors.mean_mm for row in rows]
    with figure_style():
        drawing, (axes,) = make_panel(5.2, 2.6, top_in=0.32)
        style = STYLES["network"]
        axes.plot(
            [row.n_train for row in rows],
            values,
            style.marker,
            linestyle=style.dash,
            color=style.colour,
            label="network",
        )
        for name in models:
            style, level = STYLES[name], results.errors[name].mean_mm
            axes.axhline(level, color=style.colour, linestyle=style.dash, linewidth=1.2, label=f"{name}, all readings")
            values.append(level)
        set_log_scale(axes, "x", rows[0].n_train / 1.3, rows[-1].n_train * 1.3)
        set_log_scale(axes, "y", max(min(values), 1e-9) / 1.5, max(*values, 1e-9) * 1.5)
        axes.set(xlabel="training readings", ylabel="mean error [mm]")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=3, handlelength=1.8, borderpad=0.2)
    summary = join_phrases(f"{format_mm(row.errors.mean_mm)} from {format_number(row.n_train)}" for row in rows)
    caption = f"Mean error of a coordinate on held-out readings against the number of training readings: {summary}."
    return Section("Amount of data", results.amounts_sentence(), figures=(Figure((drawing,), caption, caption),))


def _network(results: Procedure) -> Section:
    network, record = results.network, results.network.record_
    text = (
        f"Trained on all {format_count(results.n_readings, 'reading')}: {format_count(record.num_epochs, 'epoch')}, "
        f"stop: {record.stop.rstrip('.')}. It is in network.truearm, which truearm predict and evaluate take."
    )
    sizes = (network.arm_.n_joints, *network.hidden, 3)
    return Section("The network (Figure 3)", text, figures=(network_layers(sizes),), folded=True)


def _span(values: tuple[float, ...]) -> str:
    return f"{format_number(min(values))} to {format_number(max(values))}"


def _facts(results: Procedure, arm: str | None) -> tuple[tuple[str, str], ...]:
    machine, network = machine_data(), results.network
    seconds = sum(row.seconds for row in (*results.search, *results.amounts[:-1]))
    ranges = [
        f"J{i}: {low:.2f} to {high:.2f} mm" if slides else f"J{i}: {np.degrees(low):.2f} to {np.degrees(high):.2f} deg"
        for i, ((low, high), slides) in enumerate(
            zip(network.angle_ranges_, network.arm_.chain.is_prismatic, strict=True), start=1
        )
    ]
    cores = format_count(int(machine["cores"]), "core")
    return (
        ("arm", arm or "no description"),
        ("readings", f"{results.n_readings}, fingerprint {network.data_fingerprint_}"),
        ("trained range", "; ".join(ranges)),
        ("CPU time of the search", format_in_text(seconds, unit="s")),
        ("seed", str(results.grid.seed)),
        ("machine", f"{machine['cpu']}, {cores}, Python {machine['python']}, NumPy {machine['numpy']}"),
        ("version", f"truearm {__version__}"),
    )
