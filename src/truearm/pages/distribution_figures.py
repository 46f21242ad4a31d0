"""Figures of the size of the error: how it is distributed, and what compensation did to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from truearm.pages.arrays import nonnegative_arrays
from truearm.pages.number_format import format_number
from truearm.pages.plotting import (
    INK,
    LEFT_IN,
    LIMIT,
    RASTER_FROM,
    Figure,
    Style,
    figure_style,
    join_phrases,
    make_panel,
    set_log_scale,
    shorten,
    styles_of,
)
from truearm.typing import FloatArray

_FEW = 20  # one in twenty is beyond the 95th percentile
_FAR_APART = 5.0  # from this ratio of medians on, a linear scale would hide the smaller errors


def error_distribution(errors: Mapping[str, npt.ArrayLike], *, styles: Mapping[str, Style] | None = None) -> Figure:
    """Draw how the errors of each model are distributed: the share below a size, and a histogram.

    Parameters
    ----------
    errors : mapping of str to (n,) array
        Distance between measured and true point [mm].
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    by_name = nonnegative_arrays(errors, "errors")
    pens = styles_of(by_name, styles)
    logarithmic = _needs_log(by_name)
    with figure_style():
        panels = (_cumulative(by_name, pens, logarithmic), _histogram(by_name, pens, logarithmic))
    told = join_phrases(f"{shorten(name)} {_most(values)}" for name, values in by_name.items())
    scale = " The lower scale is logarithmic." if logarithmic else ""
    return Figure(
        panels,
        caption="Distribution of the distance between a model's point and the reference's. Left: the share of readings "
        f"with an error below the value on the lower scale; right: how many readings err by how much.{scale} "
        f"Errors: {told}.",
        alt=f"Cumulative distribution and histogram of the error. Errors: {told}.",
        columns=2,
    )


def before_after(errors: Mapping[str, npt.ArrayLike], *, styles: Mapping[str, Style] | None = None) -> Figure:
    """Draw in one picture what compensation does: every reading a dot, before and after.

    Parameters
    ----------
    errors : mapping of str to (n,) array
        Distance between measured and true point [mm]; the first is the state before compensation.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    by_name = nonnegative_arrays(errors, "errors")
    pens = styles_of(by_name, styles)
    with figure_style():
        drawing = _clouds(by_name, pens)
    told = join_phrases(f"{shorten(name)} {_mean(values)} mm" for name, values in by_name.items())
    return Figure(
        (drawing,),
        caption=f"Every dot is one reading; the further right, the larger its error. Mean error: {told}.",
        alt=f"Errors of all readings as clouds of dots, one row a model. Mean error: {told}.",
    )


def _clouds(errors: Mapping[str, FloatArray], pens: Mapping[str, Style]) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 0.72 + 0.66 * len(errors))
    drawing.subplots_adjust(left=0.12 / 4.6, right=1 - 0.16 / 4.6)
    largest = max(float(values.max()) for values in errors.values()) or 1e-6
    for i, (name, values) in enumerate(errors.items()):
        base = float(len(errors) - 1 - i)
        _cloud(axes, values, base, largest, pens[name])
        axes.text(0.0, base + 0.43, shorten(name, longest=18), weight="bold", color=pens[name].colour)
        axes.text(largest, base + 0.43, f"mean {_mean(values)} mm,  {_most(values)}", ha="right")
    axes.set(xlim=(-0.012 * largest, 1.02 * largest), ylim=(-0.45, len(errors) - 0.2), xlabel="error [mm]")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    return drawing


def _cloud(axes: Axes, values: FloatArray, base: float, largest: float, pen: Style) -> None:
    n = len(values)
    counts, edges = np.histogram(values, bins=80, range=(0.0, largest))
    density = np.sqrt(counts / counts.max())
    height = np.interp(values, (edges[1:] + edges[:-1]) / 2, density)
    spread = (np.arange(n) * 0.6180339887498949) % 1 - 0.5  # golden ratio: even, and no chance in it
    many = n > RASTER_FROM
    axes.scatter(
        values,
        base + 0.62 * height * spread,
        s=float(np.clip(2400 / n, 1.2, 9)),
        alpha=0.3 if many else 0.7,
        color=pen.colour,
        linewidths=0,
        rasterized=many,
    )
    axes.plot([values.mean()] * 2, [base - 0.34, base + 0.34], color=INK, linewidth=1.4)


def _cumulative(errors: Mapping[str, FloatArray], pens: Mapping[str, Style], logarithmic: bool) -> Drawing:
    drawing, axes = _with_key(errors, pens, "share of readings below an error", _most)
    floor = _floor(errors)
    for name, values in errors.items():
        pen = pens[name]
        x = np.maximum(np.sort(values), floor)
        share = np.arange(1, len(x) + 1) / len(x) * 100
        keep = np.unique(np.linspace(0, len(x) - 1, 500).round().astype(int))  # more steps cannot be seen
        axes.plot(x[keep], share[keep], color=pen.colour, linestyle=pen.dash, linewidth=1.6)
        p95 = [max(float(np.percentile(values, 95)), floor)] if len(values) >= _FEW else []
        axes.plot(p95, [95] * len(p95), marker=pen.marker, color=pen.colour, markersize=5, markeredgecolor="white")
    axes.axhline(95, color=LIMIT, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
    axes.set(ylim=(0, 101.5), ylabel="share of readings [%]")
    axes.set_yticks([0, 25, 50, 75, 95])
    _error_axis(axes, errors, logarithmic)
    return drawing


def _histogram(errors: Mapping[str, FloatArray], pens: Mapping[str, Style], logarithmic: bool) -> Drawing:
    drawing, axes = _with_key(errors, pens, "readings by size of error", lambda values: f"median {_median(values)} mm")
    floor = _floor(errors)
    low, high = _ends(errors, logarithmic)
    edges = np.geomspace(low, high, 61) if logarithmic else np.linspace(low, high, 41)
    for name, values in errors.items():
        pen = pens[name]
        counts, _ = np.histogram(np.clip(values, max(floor, low), high), edges)
        axes.stairs(counts, edges, fill=True, color=pen.colour, alpha=0.18)
        axes.stairs(counts, edges, color=pen.colour, linestyle=pen.dash, linewidth=1.3)
    axes.set(ylabel="readings in each class")
    axes.set_ylim(bottom=0)
    _error_axis(axes, errors, logarithmic)
    return drawing


def _with_key(
    errors: Mapping[str, FloatArray], pens: Mapping[str, Style], title: str, told: Callable[[FloatArray], str]
) -> tuple[Drawing, Axes]:
    """Make a panel with a line a model above the axes: its pen, its name, and one number."""
    line_in, title_in = 0.17, 0.3
    height_in = 2.9 + line_in * len(errors)
    drawing, (axes,) = make_panel(4.6, height_in, top_in=title_in + line_in * len(errors))
    for i, (name, values) in enumerate(errors.items()):
        pen, y = pens[name], 1 - (title_in + line_in * (i + 0.25)) / height_in
        left = LEFT_IN / 4.6
        drawing.add_artist(Line2D([left, left + 0.07], [y, y], color=pen.colour, linestyle=pen.dash, linewidth=1.6))
        drawing.text(left + 0.085, y, shorten(name), va="center_baseline")
        drawing.text(1 - 0.12 / 4.6, y, told(values), va="center_baseline", ha="right")
    drawing.text(LEFT_IN / 4.6, 1 - 0.06 / height_in, title, va="top", fontsize=9, fontweight="bold")
    return drawing, axes


def _error_axis(axes: Axes, errors: Mapping[str, FloatArray], logarithmic: bool) -> None:
    axes.set_xlabel("error [mm]")
    if logarithmic:
        set_log_scale(axes, "x", *_ends(errors, logarithmic))
    else:
        axes.locator_params(axis="x", nbins=6)
        axes.set_xlim(*_ends(errors, logarithmic))


def _needs_log(errors: Mapping[str, FloatArray]) -> bool:
    medians = np.array([np.median(values) for values in errors.values()])
    return bool(medians.min() > 0 and medians.max() > _FAR_APART * medians.min())


def _ends(errors: Mapping[str, FloatArray], logarithmic: bool) -> tuple[float, float]:
    largest = max(float(values.max()) for values in errors.values()) or 1e-6
    return (_floor(errors) * 0.9, largest * 1.2) if logarithmic else (0.0, largest * 1.05)


def _floor(errors: Mapping[str, FloatArray]) -> float:
    """Give the smallest error drawn on a log scale: below one in two hundred, a dot says nothing more."""
    return max(min(float(np.percentile(values, 0.5)) for values in errors.values()), 1e-9)


def _mean(values: FloatArray) -> str:
    return format_number(float(values.mean()), digits=2)


def _median(values: FloatArray) -> str:
    return format_number(float(np.median(values)), digits=2)


def _most(values: FloatArray) -> str:
    """Give how large errors get: the 95th percentile, or the largest where there are too few to have one."""
    if len(values) < _FEW:
        return f"largest {format_number(float(values.max()), digits=2)} mm"
    return f"95 % below {format_number(float(np.percentile(values, 95)), digits=2)} mm"
