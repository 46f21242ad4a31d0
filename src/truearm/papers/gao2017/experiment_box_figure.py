"""Figure of the experiment's error against its box of joint angles, with the stops of the trainings."""

from __future__ import annotations

from collections.abc import Mapping

from truearm.number_format import capitalize, format_count, format_exact, format_number
from truearm.pages.palette import INK, LIMIT, PAPER
from truearm.pages.plotting import Figure, Style, figure_style, make_panel, set_log_scale
from truearm.papers.gao2017.experiment_box import BoxRun, ExperimentBoxStudy
from truearm.papers.gao2017.results import GOAL_MET, METHODS
from truearm.papers.gao2017.tables import FINAL_TEST, TABLES

_WIDTH_IN = 5.2


def experiment_box_figure(study: ExperimentBoxStudy, *, chosen: float, styles: Mapping[str, Style]) -> Figure:
    """Draw the error of every training against the half-width of its box, and the paper's values as lines.

    Parameters
    ----------
    study : ExperimentBoxStudy
    chosen : float
        The half-width of the reproduction [deg].
    styles : mapping of str to Style
        For ``trainlm`` and ``varpro``.
    """
    published = {"Table 4": TABLES[4][-1].mean_mm, "final test": FINAL_TEST.network_mean_mm}
    errors = [run.mean_mm for run in study.runs]
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 3.1, top_in=0.32)
        drawing.subplots_adjust(left=0.8 / _WIDTH_IN, right=1 - 1.05 / _WIDTH_IN)
        for method in METHODS:
            medians, style = study.median_mm(method), styles[method]
            axes.plot([*medians], [*medians.values()], color=style.colour, linestyle=style.dash, label=method)
            for run in (run for run in study.runs if run.method == method):
                met = run.stop == GOAL_MET
                axes.plot(
                    [run.half_width_deg],
                    [run.mean_mm],
                    style.marker,
                    color=style.colour,
                    markersize=6,
                    markerfacecolor=style.colour if met or method == "varpro" else PAPER,
                )
        for k, (name, value) in enumerate(published.items()):
            axes.axhline(value, color=INK, linewidth=1.0, linestyle=(0, (1.5, 2)))
            axes.annotate(
                f"{name} {format_exact(value)}",
                xy=(1.01, value),
                xycoords=axes.get_yaxis_transform(),
                xytext=(0, 5 - 10 * k),
                textcoords="offset points",
                va="center",
                fontsize="small",
            )
        axes.axvline(chosen, color=LIMIT, linewidth=1.0, linestyle=(0, (4, 3)))
        set_log_scale(axes, "y", min(errors) / 1.5, max([*errors, *published.values()]) * 1.5)
        axes.set(xlabel="half-width of the box of joint angles [deg]", ylabel="mean error [mm]")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=2, handlelength=1.8, borderpad=0.2)
    faithful = [run for run in study.runs if run.method == "trainlm"]
    n_met = sum(run.stop == GOAL_MET for run in faithful)
    summary = (
        f"trainlm {_span(study, 'trainlm')}; varpro {_span(study, 'varpro')}; "
        f"{n_met} of {format_count(len(faithful), 'training')} by trainlm met the goal"
    )
    return Figure(
        (drawing,),
        caption="Row 4 of Table 4, trained and tested in boxes of several half-widths. A filled mark of trainlm is a "
        "training that met the paper's goal, an open one ended otherwise; dotted lines are the paper's values, the "
        f"dashed line is the box of this reproduction, \u00b1{format_exact(chosen)} deg. {capitalize(summary)}.",
        alt=f"Mean error against the half-width of the box: {summary}.",
    )


def _span(study: ExperimentBoxStudy, method: str) -> str:
    runs: list[BoxRun] = sorted((r for r in study.runs if r.method == method), key=lambda run: run.half_width_deg)
    first, last = runs[0], runs[-1]
    return (
        f"{format_number(first.mean_mm)} mm at \u00b1{format_exact(first.half_width_deg)} deg to "
        f"{format_number(last.mean_mm)} mm at \u00b1{format_exact(last.half_width_deg)} deg"
    )
