"""The learning curves: the error on the fitted poses against the time of the training, one row of each table."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure as Drawing

from truearm.number_format import format_in_text
from truearm.pages.page import Section
from truearm.pages.palette import PAPER
from truearm.pages.plotting import Figure, figure_style, join_phrases, make_panel, set_log_scale
from truearm.papers.gao2017.results import METHODS, Reproduction, RowResult, Run
from truearm.papers.gao2017.table_figure import STYLES

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
