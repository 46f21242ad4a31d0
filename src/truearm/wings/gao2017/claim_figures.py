"""Figures of the paper's claims about a direct network: scatter of starts, learning rate, box, outside the box.

The error of row 4 of Table 4 against the box of joint angles, and what the stops of the trainings say about the box.

The paper's training ran all 1000 epochs without meeting its goal, and its network errs by 0.0149 mm. A goal is a mean
squared error of outputs scaled to [-1, 1]: in mm it grows with the box. In a box in which a training that just met its
goal errs by more than the paper's network, the paper's training would have met it too. So that box, where the error of
`trainlm` at the goal is the paper's, is the widest that agrees with the stop of the paper.

The trainings take hours of CPU time. Their numbers are kept in ``experiment_box.json``, which
``python -m benchmarks paper box`` makes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.number_format import capitalize, format_count, format_exact, format_in_text, format_number
from truearm.pages.palette import INK, LIMIT, PAPER
from truearm.pages.plotting import LEFT_IN, Figure, figure_style, join_phrases, make_panel, set_log_scale, shorten
from truearm.typing import FloatArray
from truearm.wings.gao2017.results import GOAL_MET, METHODS, BoxStudy, LearningRate, Method, OutsideErrors, Scatter
from truearm.wings.gao2017.table_figure import PAPER_STYLE, STYLES
from truearm.wings.gao2017.tables import FINAL_TEST, TABLES

EXPERIMENT_BOX_FILE = Path(__file__).with_name("experiment_box.json")


@dataclass(frozen=True)
class BoxRun:
    """A training of row 4 of Table 4 in a box.

    Attributes
    ----------
    half_width_deg : float
    method : {"trainlm", "varpro"}
    seed, epochs : int
    stop : str
        In MATLAB's words.
    mean_mm, max_mm : float
        Absolute error of a coordinate on 2000 further poses.
    seconds : float
        CPU time.
    """

    half_width_deg: float
    method: Method
    seed: int
    epochs: int
    stop: str
    mean_mm: float
    max_mm: float
    seconds: float


@dataclass(frozen=True)
class ExperimentBoxStudy:
    """The trainings, and how they were made."""

    how: str
    runs: tuple[BoxRun, ...]

    def of(self, method: Method) -> dict[float, tuple[BoxRun, ...]]:
        """The starts of a trainer by half-width, in order."""
        widths = sorted({run.half_width_deg for run in self.runs if run.method == method})
        return {
            width: tuple(run for run in self.runs if (run.method, run.half_width_deg) == (method, width))
            for width in widths
        }

    def median_mm(self, method: Method) -> dict[float, float]:
        """Median mean error of the starts by half-width."""
        return {width: float(median(run.mean_mm for run in runs)) for width, runs in self.of(method).items()}


@cache
def load_experiment_box() -> ExperimentBoxStudy:
    """The study that is kept with the program."""
    kept = json.loads(EXPERIMENT_BOX_FILE.read_text(encoding="utf-8"))
    runs = tuple(BoxRun(**run) for run in kept["runs"])
    assert all(run.method in METHODS for run in runs)  # written by the benchmark
    return ExperimentBoxStudy(kept["how"], runs)


def widths_at(study: ExperimentBoxStudy, level_mm: float) -> list[float]:
    """Half-widths [deg] at which the median error of trainlm is `level_mm`, interpolated in its logarithm."""
    medians = study.median_mm("trainlm")
    return crossings([*medians], [*medians.values()], level_mm)


def crossings(x: npt.ArrayLike, y: npt.ArrayLike, level: float) -> list[float]:
    """Every x where a curve through points crosses a level, interpolated linearly in the logarithm of y."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    order = np.argsort(x)
    x, height = x[order], np.log(y[order] / level)
    places = [float(x[i]) for i in np.flatnonzero(height == 0)]
    for i in np.flatnonzero(height[:-1] * height[1:] < 0):
        places.append(float(x[i] + (x[i + 1] - x[i]) * height[i] / (height[i] - height[i + 1])))
    return sorted(places)


_WIDTH_IN = 5.2


def scatter_figure(claim: Scatter) -> Figure:
    """Draw the errors of one training from many starts, and the paper's values that differ by a setting.

    Parameters
    ----------
    claim : Scatter
    """
    style, starts, published = STYLES["trainlm"], np.array(claim.mean_mm), np.array(claim.paper_rows_mean_mm)
    summary = (
        f"{format_count(len(starts), 'start')} {_from_to(starts)}, "
        f"{format_count(len(published), 'published value')} {_from_to(published)}"
    )
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 1.75, top_in=0.1)
        _set_left(drawing, 0.95)
        spread = 0.5 * ((np.arange(len(starts)) * 0.6180339887498949) % 1 - 0.5)  # golden ratio: even, not random
        axes.plot(starts, 1 + spread, style.marker, color=style.colour, markersize=4, alpha=0.7, markeredgewidth=0)
        axes.plot([np.median(starts)] * 2, [0.65, 1.35], color=INK, linewidth=1.4)
        axes.plot(published, 0 * published, PAPER_STYLE.marker, color=PAPER_STYLE.colour, markersize=5, alpha=0.8)
        axes.axvspan(starts.min(), starts.max(), color=style.colour, alpha=0.08, linewidth=0)
        axes.set_yticks([1, 0], [f"{len(starts)} starts", f"paper, {len(published)} rows"])
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        axes.spines["left"].set_visible(False)
        axes.set(ylim=(-0.5, 1.55), xlabel="mean error of a coordinate [mm]")
        axes.locator_params(axis="x", nbins=8)
    return Figure(
        (drawing,),
        caption=f"{shorten(claim.what, longest=120)}: {summary}. The bar is the median; the band spans the starts.",
        alt=f"Strip of dots: {summary}.",
    )


def learning_rate_figure(claim: LearningRate) -> Figure:
    """Draw the paper's errors against the learning rate, and the error of the one training that they share."""
    rates, published = np.array(claim.rates), np.array(claim.paper_mean_mm)
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 2.5, top_in=0.32)
        axes.plot(rates, published, "D", color=PAPER_STYLE.colour, markersize=5, label="paper")
        axes.axhline(claim.mean_mm, color=STYLES["trainlm"].colour, linewidth=1.4, label="here, median of the starts")
        set_log_scale(axes, "x", rates.min() / 2, rates.max() * 2)
        axes.set_ylim(0, 1.15 * max(claim.mean_mm, published.max()))
        axes.set(xlabel="learning rate", ylabel="mean error [mm]")
        _key(axes)
    summary = f"the paper's rows {_from_to(published)}; here one training, {format_number(claim.mean_mm)} mm"
    return Figure(
        (drawing,), caption=f"Mean error against the learning rate: {summary}.", alt=f"Mean errors: {summary}."
    )


def box_figure(claim: BoxStudy, *, chosen: float) -> Figure:
    """Draw the error of networks against the half-width of their box, and the paper's values.

    Parameters
    ----------
    claim : BoxStudy
    chosen : float
        The half-width of the reproduction [deg].
    """
    order = np.argsort(claim.half_width_deg)
    widths = np.array(claim.half_width_deg)[order]
    errors = {f"row {row}": np.array(values)[order] for row, values in claim.mean_mm.items()}
    published = {f"row {row}": value for row, value in claim.paper_mean_mm.items()}
    met = {name: crossings(widths, values, published[name]) for name, values in errors.items()}
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 3.1, top_in=0.32)
        drawing.subplots_adjust(right=1 - 0.62 / _WIDTH_IN)
        for name, values in errors.items():
            _curve(axes, widths, values, name)
            axes.axhline(published[name], color=STYLES[name].colour, linewidth=1.0, linestyle=(0, (1.5, 2)))
            at = [published[name]] * len(met[name])
            axes.plot(met[name], at, "D", color=PAPER_STYLE.colour, markersize=5.5, zorder=5)
            axes.annotate(
                f"paper\n{format_exact(published[name])}",
                xy=(1.01, published[name]),
                xycoords=axes.get_yaxis_transform(),
                va="center",
            )
        axes.axvline(chosen, color=LIMIT, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.annotate(
            f"chosen: \u00b1{format_exact(chosen)} deg",
            xy=(chosen, 0.02),
            xycoords=axes.get_xaxis_transform(),
            xytext=(4, 0),
            textcoords="offset points",
            color=INK,
        )
        _error_scale(axes, [*errors.values(), *published.values()])
        axes.set(xlabel="half-width of the box of joint angles [deg]", ylabel="mean error [mm]")
        _key(axes)
    summary = join_phrases(f"{name} {_met(met[name], widths)}" for name in errors)
    return Figure(
        (drawing,),
        caption="Mean error of networks that are trained and tested in boxes of several widths (marks). Dotted lines "
        f"are the paper's values, diamonds where the networks have them: {summary}.",
        alt=f"Mean error against the half-width of the box for {len(errors)} networks; the paper's values: {summary}.",
    )


def experiment_box_figure(study: ExperimentBoxStudy, *, chosen: float) -> Figure:
    """Draw the error of every training against the half-width of its box, and the paper's values as lines.

    Parameters
    ----------
    study : ExperimentBoxStudy
    chosen : float
        The half-width of the reproduction [deg].
    """
    published = {"Table 4": TABLES[4][-1].mean_mm, "final test": FINAL_TEST["network"].mean_mm}
    errors = [run.mean_mm for run in study.runs]
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 3.1, top_in=0.32)
        drawing.subplots_adjust(left=0.8 / _WIDTH_IN, right=1 - 1.05 / _WIDTH_IN)
        for method in METHODS:
            medians, style = study.median_mm(method), STYLES[method]
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
        f"trainlm {_over_widths(study, 'trainlm')}; varpro {_over_widths(study, 'varpro')}; "
        f"{n_met} of {format_count(len(faithful), 'training')} by trainlm met the goal"
    )
    return Figure(
        (drawing,),
        caption="Row 4 of Table 4, trained and tested in boxes of several half-widths. A filled mark of trainlm is a "
        "training that met the paper's goal, an open one ended otherwise; dotted lines are the paper's values, the "
        f"dashed line is the box of this reproduction, \u00b1{format_exact(chosen)} deg. {capitalize(summary)}.",
        alt=f"Mean error against the half-width of the box: {summary}.",
    )


def _over_widths(study: ExperimentBoxStudy, method: str) -> str:
    runs: list[BoxRun] = sorted((r for r in study.runs if r.method == method), key=lambda run: run.half_width_deg)
    first, last = runs[0], runs[-1]
    return (
        f"{format_number(first.mean_mm)} mm at \u00b1{format_exact(first.half_width_deg)} deg to "
        f"{format_number(last.mean_mm)} mm at \u00b1{format_exact(last.half_width_deg)} deg"
    )


def outside_figure(claim: OutsideErrors) -> Figure:
    """Draw the errors of the network and of other models against the distance outside the box of the training."""
    order = np.argsort(claim.distance_deg)
    distance, p95 = np.array(claim.distance_deg)[order], np.array(claim.varpro_p95_mm)[order]
    medians = {name: np.array(values)[order] for name, values in claim.median_mm.items()}
    colour = STYLES["varpro"].colour
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 3.0, top_in=0.32)
        axes.fill_between(distance, medians["varpro"], p95, color=colour, alpha=0.15, linewidth=0)
        axes.plot(distance, p95, color=colour, linewidth=0.8, linestyle=(0, (4, 2)))
        for name, values in medians.items():
            _curve(axes, distance, values, name)
        _error_scale(axes, [p95, *medians.values()])
        axes.set(xlabel="farthest joint outside the box [deg]", ylabel="error [mm]")
        _key(axes)
    near, far = (f"{format_in_text(distance[end])} deg" for end in (0, -1))
    summary = join_phrases(
        f"{name} {format_number(float(values[0]), digits=2)} mm at {near} and "
        f"{format_number(float(values[-1]), digits=2)} mm at {far}"
        for name, values in medians.items()
    )
    return Figure(
        (drawing,),
        caption="Error of a coordinate outside the box in which varpro was trained, on a logarithmic scale: medians, "
        f"and for varpro a band up to the 95th percentile. {capitalize(summary)}.",
        alt=f"Error against the distance outside the box, on a logarithmic scale. {summary}.",
    )


def share_figure(errors: Mapping[str, float], *, before: str) -> Figure:
    """Draw mean errors on a logarithmic scale with, above it, the share of one of them that is removed.

    Parameters
    ----------
    errors : mapping of str to float
        Mean error of each model [mm], and the noise floor.
    before : str
        The model before compensation, among them.
    """
    first = errors[before]
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 0.92 + 0.3 * len(errors), top_in=0.46)
        _set_left(drawing, 0.28 + 0.075 * max(map(len, errors)))
        low, high = min(errors.values()) / 1.6, max(errors.values()) * 4
        heights = range(len(errors) - 1, -1, -1)
        for height, (name, value) in zip(heights, errors.items(), strict=True):
            axes.plot([value], [height], STYLES[name].marker, color=STYLES[name].colour, markersize=7)
            text = f"{format_number(value)} mm"
            axes.annotate(text, xy=(value, height), xytext=(8, 0), textcoords="offset points", va="center")
        set_log_scale(axes, "x", low, high)
        axes.set_yticks(list(heights), list(errors))
        axes.tick_params(axis="y", length=0)
        axes.set(ylim=(-0.6, len(errors) - 0.4), xlabel="mean error of a coordinate [mm]")
        axes.spines["left"].set_visible(False)
        _share_scale(axes, first, low, high)
    summary = "; ".join(
        f"{name} {format_number(value)} mm{'' if name == before else _removed(value / first, before)}"
        for name, value in errors.items()
    )
    return Figure(
        (drawing,),
        caption=f"Mean errors on a logarithmic scale, and above it the removed share of {before}. {summary}.",
        alt=f"Mean errors on a logarithmic scale: {summary}.",
    )


def _removed(ratio: float, before: str) -> str:
    return f", {_percent(1 - ratio)} removed" if ratio <= 1 else f", {format_in_text(ratio)} times {before}"


def _share_scale(axes: Axes, first: float, low: float, high: float) -> None:
    top = axes.secondary_xaxis("top")
    shares = [
        s for s in (0, 0.5, 0.8, 0.9, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998, 0.999) if low < first * (1 - s) < high
    ]
    kept, last = [], np.inf
    for share in shares:
        place = np.log(first * (1 - share) / low) / np.log(high / low)
        if last - place > 0.085:  # else the numbers overlap
            kept.append(share)
            last = place
    top.set_xticks([first * (1 - share) for share in kept], [_percent(share) for share in kept])
    top.minorticks_off()
    top.set_xlabel("share removed [%]", labelpad=4)
    top.spines["top"].set_color(LIMIT)


def _curve(axes: Axes, x: FloatArray, y: FloatArray, name: str) -> None:
    style = STYLES[name]
    axes.plot(x, y, style.marker, linestyle=style.dash, color=style.colour, markersize=5, label=name)


def _error_scale(axes: Axes, values: Sequence[FloatArray | float]) -> None:
    everything = np.concatenate([np.atleast_1d(one) for one in values])
    set_log_scale(axes, "y", everything.min() / 1.6, everything.max() * 1.6)


def _percent(share: float) -> str:
    return f"{format_in_text(round(100 * share, 2))} %"


def _met(places: Sequence[float], widths: FloatArray) -> str:
    if not places:
        return f"nowhere from \u00b1{format_in_text(widths.min())} to \u00b1{format_in_text(widths.max())} deg"
    return "at " + " and ".join(f"\u00b1{format_in_text(place)} deg" for place in places)


def _from_to(values: FloatArray) -> str:
    low, high = format_number(float(values.min())), format_number(float(values.max()))
    return f"{low} mm throughout" if low == high else f"from {low} to {high} mm"


def _key(axes: Axes) -> None:
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=4, handlelength=1.8, columnspacing=1.0, borderpad=0.2
    )


def _set_left(drawing: Drawing, left_in: float) -> None:
    drawing.subplots_adjust(left=max(left_in, LEFT_IN) / _WIDTH_IN)
