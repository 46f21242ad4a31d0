"""The page of the paper's procedure on readings of a person's own: the answer, its Table 4, its Figures 6 to 8."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm import __version__
from truearm.number_format import format_count
from truearm.pages.drawings.error_figures import coordinates_by_reading, errors_by_reading
from truearm.pages.page import Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.plotting import Figure
from truearm.wings.gao2017.claim_figures import share_figure
from truearm.wings.gao2017.network_drawing import network_layers
from truearm.wings.gao2017.procedure import Procedure
from truearm.wings.gao2017.table_figure import STYLES


def procedure_page(results: Procedure, *, arm: str | None, remarks: tuple[str, ...]) -> Page:
    """Make the page.

    Parameters
    ----------
    results : Procedure
    arm : str or None
        Its name.
    remarks : tuple of str
        What to know before using the result.
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
        sections=(_comparison(results, remarks), _search(results), _network(results)),
        facts=(
            ("arm", arm or "no description"),
            ("readings", f"{results.n_readings}, fingerprint {results.network.data_fingerprint_}"),
            ("trained range", _ranges(results)),
            ("seed", str(results.grid.seed)),
            ("versions", f"truearm {__version__}, NumPy {np.__version__}"),
        ),
        verdict=PageVerdict(results.summary(), state, remarks[0]),
    )


def paper_figures(results: Procedure) -> dict[int, Figure]:
    """Figures 6 (nominal errors, of an arm that is known), 7 (predicted coordinates) and 8 (their errors)."""
    figures = {7: coordinates_by_reading(results.points, {"network": results.predicted["network"]}, styles=STYLES)}
    for number, name in ((6, "nominal"), (8, "network")):
        if name in results.predicted:
            figures[number] = errors_by_reading({name: results.predicted[name] - results.points}, styles=STYLES)
    return {
        number: replace(figure, caption=f"Figure {number} of the paper, of this arm. {figure.caption}")
        for number, figure in sorted(figures.items())
    }


def _comparison(results: Procedure, remarks: tuple[str, ...]) -> Section:
    """The errors of all models, and the paper's figures."""
    own, means = results.errors["network"], {name: one.mean_mm for name, one in results.errors.items()}
    shares = (share_figure(means, before="nominal"),) if "nominal" in means and min(means.values()) > 0 else ()
    heads, rows = results.error_table()
    table = Table(
        Column.of(*heads),
        tuple(rows),
        f"Absolute error of a coordinate {results.test_phrase()}, {3 * own.n} coordinates; how many exceed a length. "
        "2 sigma is twice the root mean square error",
    )
    text = "\n\n".join((own.two_sigma_sentence(), *remarks[1:]))
    figures = (*shares, *paper_figures(results).values())
    return Section("Error before and after (Figures 6 to 8)", text, tables=(table,), figures=figures)


def _search(results: Procedure) -> Section:
    grid, folds = results.grid, results.chosen.fold_mean_mm
    text = (
        f"Each network is trained {grid.folds} times without one of {grid.folds} folds, from another random start, and "
        "tested on this fold. Kept is the smallest mean error, as in the paper. Folds and starts alone make the chosen "
        f"one err by {min(folds):.3g} to {max(folds):.3g} mm. Readings of one position or pose are in one fold; there "
        f"are {results.n_groups} of them. Without a goal (0) 15 % of the readings end a training when their error "
        "grows. There is no learning rate: the Levenberg-Marquardt method has none; what the paper varies by it is the "
        f"random start.{'' if grid.hidden else ' Larger networks than coordinates to fit are not tried.'}"
        f"\n\n{results.amounts_sentence()}"
    )
    heads, rows = results.search_table()
    table = Table(Column.of(*heads), tuple(rows), "Table 4 of this arm; last the chosen network with fewer readings")
    return Section("The search (Tables 2 and 4)", text, tables=(table,))


def _network(results: Procedure) -> Section:
    network, record = results.network, results.network.record_
    text = (
        f"Trained on all {format_count(results.n_readings, 'reading')}: {format_count(record.num_epochs, 'epoch')}, "
        f"stop: {record.stop.rstrip('.')}. It is in network.truearm, which truearm predict and evaluate take."
    )
    sizes = (network.arm_.n_joints, *network.hidden, 3)
    return Section("The network (Figure 3)", text, figures=(network_layers(sizes),), folded=True)


def _ranges(results: Procedure) -> str:
    network = results.network
    joints = zip(network.angle_ranges_, network.arm_.chain.is_prismatic, strict=True)
    return "; ".join(
        f"J{i}: {low:.2f} to {high:.2f} mm" if slides else f"J{i}: {np.degrees(low):.2f} to {np.degrees(high):.2f} deg"
        for i, ((low, high), slides) in enumerate(joints, start=1)
    )
