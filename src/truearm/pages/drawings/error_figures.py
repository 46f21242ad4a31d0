"""Figures of the errors of models: distribution, before and after, by reading and by coordinate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from truearm.errors import InputError
from truearm.number_format import format_count, format_number
from truearm.pages.arrays import finite_array, finite_arrays, nonnegative_errors
from truearm.pages.palette import INK, LIMIT, PAPER
from truearm.pages.plotting import (
    LEFT_IN,
    Figure,
    Style,
    dot_style,
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
_MOST_COORDINATES = 100  # more marks overlap


def error_distribution(errors: Mapping[str, npt.ArrayLike], *, styles: Mapping[str, Style] | None = None) -> Figure:
    """Draw how the errors of each model are distributed: the share below a size, and a histogram.

    Parameters
    ----------
    errors : mapping of str to (n,) array
        Distance between measured and true point [mm].
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    by_name = nonnegative_errors(errors)
    pens = styles_of(by_name, styles)
    logarithmic = _needs_log(by_name)
    with figure_style():
        panels = (_cumulative(by_name, pens, logarithmic), _histogram(by_name, pens, logarithmic))
    summary = join_phrases(f"{shorten(name)} {_most(values)}" for name, values in by_name.items())
    scale = " The lower scale is logarithmic." if logarithmic else ""
    return Figure(
        panels,
        caption="Distribution of the distance between a model's point and the reference's. Left: the share of readings "
        f"with an error below the value on the lower scale; right: how many readings err by how much.{scale} "
        f"Errors: {summary}.",
        alt=f"Cumulative distribution and histogram of the error. Errors: {summary}.",
        columns=2,
    )


def before_after(errors: Mapping[str, npt.ArrayLike], *, styles: Mapping[str, Style] | None = None) -> Figure:
    """Draw every reading as a dot, before and after compensation.

    Parameters
    ----------
    errors : mapping of str to (n,) array
        Distance between measured and true point [mm]; the first is the state before compensation.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    by_name = nonnegative_errors(errors)
    pens = styles_of(by_name, styles)
    logarithmic = _needs_log(by_name)
    with figure_style():
        drawing = _clouds(by_name, pens, logarithmic)
    summary = join_phrases(f"{shorten(name)} {_mean(values)} mm" for name, values in by_name.items())
    return Figure(
        (drawing,),
        caption=f"Every dot is one reading; the further right, the larger its error. "
        f"{'The scale is logarithmic. ' if logarithmic else ''}Mean error: {summary}.",
        alt=f"Errors of all readings as clouds of dots, one row a model. Mean error: {summary}.",
    )


def errors_by_reading(errors: Mapping[str, npt.ArrayLike], *, styles: Mapping[str, Style] | None = None) -> Figure:
    """Draw the error of each coordinate by reading: all models on one scale, then the later ones on their own.

    Parameters
    ----------
    errors : mapping of str to (n, 3) array
        Measured minus true coordinates [mm] of each model; the first is the state before compensation.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    by_name = finite_arrays(errors, "errors", width=3, same_length=True)
    pens = styles_of(by_name, styles)
    count = len(next(iter(by_name.values())))
    with figure_style():
        panels = tuple(_coordinate_error_panel(by_name, pens, coordinate) for coordinate in range(3))
    before, *after = (shorten(name) for name in by_name)
    summary = join_phrases(
        f"{shorten(name)} {format_number(float(np.abs(values).mean()), digits=2)} mm on average and "
        f"{format_number(float(np.abs(values).max()), digits=2)} mm at most"
        for name, values in by_name.items()
    )
    closer = f" Above, all on one scale; below, the same without {before} on its own." if after else ""
    return Figure(
        panels,
        caption=f"Error of x, y and z, reading by reading.{closer} Error of a single coordinate: {summary}.",
        alt=f"Errors of the coordinates x, y and z of {format_count(count, 'reading')}. {summary}.",
        columns=3,
    )


def coordinates_by_reading(
    truth: npt.ArrayLike, measured: Mapping[str, npt.ArrayLike], *, styles: Mapping[str, Style] | None = None
) -> Figure:
    """Draw true and measured coordinates by reading, of the first 100 readings.

    Parameters
    ----------
    truth : (n, 3) array
        Coordinates by the reference [mm].
    measured : mapping of str to (n, 3) array
        Coordinates by each model [mm].
    """
    truth = finite_array(truth, "truth", width=3)
    by_name = finite_arrays(measured, "measured points", width=3, same_length=True)
    count = len(next(iter(by_name.values())))
    if len(truth) != count:
        raise InputError(f"expected measured points of the same {len(truth)} readings as the truth, got {count}")
    pens = styles_of(by_name, styles)
    with figure_style():
        panels = tuple(_coordinate_panel(truth, by_name, pens, coordinate) for coordinate in range(3))
    drawn = min(count, _MOST_COORDINATES)
    which = (
        f"the first {drawn} of {format_count(count, 'reading')}" if drawn < count else format_count(count, "reading")
    )
    return Figure(
        panels,
        caption=f"Coordinates of {which}: the reference as a line, the models as marks. A mark that "
        "is visibly beside its line is a gross error.",
        alt=f"Coordinates x, y and z of {which} by the reference and by "
        f"{', '.join(shorten(name) for name in by_name)}.",
        columns=3,
    )


def _clouds(errors: Mapping[str, FloatArray], pens: Mapping[str, Style], logarithmic: bool) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 0.72 + 0.66 * len(errors))
    drawing.subplots_adjust(left=0.12 / 4.6, right=1 - 0.16 / 4.6)
    low, high = _ends(errors, logarithmic)
    edges = np.geomspace(low, high, 81) if logarithmic else np.linspace(low, high, 81)
    for i, (name, values) in enumerate(errors.items()):
        base = float(len(errors) - 1 - i)
        _cloud(axes, np.clip(values, low, high), base, edges, pens[name])
        axes.plot([values.mean()] * 2, [base - 0.34, base + 0.34], color=INK, linewidth=1.4)
        on = axes.get_yaxis_transform()
        axes.text(0.01, base + 0.43, shorten(name, longest=18), weight="bold", transform=on)
        axes.text(0.99, base + 0.43, f"mean {_mean(values)} mm,  {_most(values)}", ha="right", transform=on)
    axes.set(ylim=(-0.45, len(errors) - 0.2))
    _error_axis(axes, errors, logarithmic)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    return drawing


def _cloud(axes: Axes, values: FloatArray, base: float, edges: FloatArray, pen: Style) -> None:
    n = len(values)
    counts, edges = np.histogram(values, edges)
    density = np.sqrt(counts / counts.max())
    height = np.interp(values, (edges[1:] + edges[:-1]) / 2, density)
    spread = (np.arange(n) * 0.6180339887498949) % 1 - 0.5  # golden ratio: even and not random
    axes.scatter(values, base + 0.62 * height * spread, color=pen.colour, **dot_style(n, 2400))


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
        axes.plot(p95, [95] * len(p95), marker=pen.marker, color=pen.colour, markersize=5, markeredgecolor=PAPER)
    axes.axhline(95, color=LIMIT, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
    axes.set(ylim=(0, 101.5), ylabel="share of readings [%]")
    axes.yaxis.set_major_locator(FixedLocator([0, 25, 50, 75, 95]))
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
    errors: Mapping[str, FloatArray], pens: Mapping[str, Style], title: str, number: Callable[[FloatArray], str]
) -> tuple[Drawing, Axes]:
    """Panel with a line for each model above the axes: its style, its name, and one number."""
    line_in, title_in = 0.17, 0.3
    height_in = 2.9 + line_in * len(errors)
    drawing, (axes,) = make_panel(4.6, height_in, top_in=title_in + line_in * len(errors))
    for i, (name, values) in enumerate(errors.items()):
        pen, y = pens[name], 1 - (title_in + line_in * (i + 0.25)) / height_in
        left = LEFT_IN / 4.6
        drawing.add_artist(Line2D([left, left + 0.07], [y, y], color=pen.colour, linestyle=pen.dash, linewidth=1.6))
        drawing.text(left + 0.085, y, shorten(name), va="center_baseline")
        drawing.text(1 - 0.12 / 4.6, y, number(values), va="center_baseline", ha="right")
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
    """Smallest error drawn on a logarithmic scale: the 0.5 % quantile."""
    return max(min(float(np.percentile(values, 0.5)) for values in errors.values()), 1e-9)


def _mean(values: FloatArray) -> str:
    return format_number(float(values.mean()))


def _median(values: FloatArray) -> str:
    return format_number(float(np.median(values)), digits=2)


def _most(values: FloatArray) -> str:
    """The 95th percentile, or the largest error of fewer than 20."""
    if len(values) < _FEW:
        return f"largest {format_number(float(values.max()), digits=2)} mm"
    return f"95 % below {format_number(float(np.percentile(values, 95)), digits=2)} mm"


def _coordinate_error_panel(errors: Mapping[str, FloatArray], pens: Mapping[str, Style], coordinate: int) -> Drawing:
    two, room = len(errors) > 1, _key_room(errors)
    drawing, rows = make_panel(3.0, (3.1 if two else 2.1) + room, rows=2 if two else 1, top_in=0.26 + room)
    _error_rows(rows[0], errors, pens, coordinate)
    if two:
        _error_rows(rows[1], dict(list(errors.items())[1:]), pens, coordinate)
    rows[0].set_title("xyz"[coordinate])
    rows[-1].set_xlabel("reading")
    rows[-1].locator_params(axis="x", nbins=5, integer=True)
    if coordinate == 0:
        _key(rows[0], errors, pens)
    return drawing


def _error_rows(axes: Axes, errors: Mapping[str, FloatArray], pens: Mapping[str, Style], coordinate: int) -> None:
    for name, values in errors.items():
        _marks(axes, values[:, coordinate], pens[name])
    # One scale for x, y and z, so that the panels can be compared.
    largest = max(float(np.abs(values).max()) for values in errors.values()) or 1e-6
    axes.set_ylim(-1.15 * largest, 1.15 * largest)
    axes.axhline(0, color=LIMIT, linewidth=0.8, zorder=1)
    axes.set_ylabel("error [mm]")
    axes.locator_params(axis="y", nbins=5)


def _marks(axes: Axes, values: FloatArray, pen: Style) -> None:
    n = len(values)
    axes.scatter(np.arange(1, n + 1), values, color=pen.colour, marker=pen.marker, **dot_style(n, 1600))


def _coordinate_panel(
    truth: FloatArray, measured: Mapping[str, FloatArray], pens: Mapping[str, Style], coordinate: int
) -> Drawing:
    room = _key_room(measured)
    drawing, (axes,) = make_panel(3.0, 2.2 + room, top_in=0.26 + room)
    drawn = slice(None, _MOST_COORDINATES)
    values = truth[drawn, coordinate]
    axes.plot(np.arange(1, len(values) + 1), values, color=LIMIT, linewidth=0.9, zorder=1)
    for name, points in measured.items():
        _marks(axes, points[drawn, coordinate], pens[name])
    axes.set(title="xyz"[coordinate], xlabel="reading", ylabel=f"{'xyz'[coordinate]} [mm]")
    axes.locator_params(axis="x", nbins=5, integer=True)
    if coordinate == 0:
        _key(axes, measured, pens)
    return drawing


def _key_room(names: Mapping[str, FloatArray]) -> float:
    """Height [in] that the names of the models need beyond the line of the title."""
    letters = sum(len(shorten(name, longest=14)) + 3 for name in names)
    return 0.0 if letters <= 36 else 0.17 * math.ceil(len(names) / 2)


def _key(axes: Axes, names: Mapping[str, FloatArray], pens: Mapping[str, Style]) -> None:
    """Name the models above the axes: beside the title if they fit there, else below it."""
    handles = [
        axes.plot([], [], color=pens[name].colour, marker=pens[name].marker, linestyle="none", markersize=4)[0]
        for name in names
    ]
    # A leading space: matplotlib leaves out labels that start with an underscore.
    labels = [f" {shorten(name, longest=14)}" for name in names]
    axes.legend(
        handles,
        labels,
        loc="lower right",
        bbox_to_anchor=(1.02, 0.985),
        ncols=2 if _key_room(names) else len(labels),
        handlelength=1.0,
        handletextpad=0.1,
        fontsize=7.5,
        columnspacing=0.6,
        borderpad=0.2,
        labelcolor=INK,
    )
