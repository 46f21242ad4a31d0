"""Figures of the paper: a table beside the reproduction, with a mark for every start to show the scatter; a network.

A network is drawn by its layers from left to right, units as circles, biases as squares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from truearm.number_format import format_count, format_number
from truearm.pages.palette import FAINT, INK, LIMIT, NAVY, ORANGE, PAPER, SOFT
from truearm.pages.plotting import Figure, Style, figure_style, set_log_scale, shorten, styles_of
from truearm.typing import FloatArray
from truearm.wings.gao2017.results import METHODS, MODELS

PAPER_STYLE = Style(INK, "D", ":")  # the paper's own numbers, in every figure
STYLES: dict[str, Style] = {
    **styles_of((*METHODS, *MODELS, "noise floor", "nominal")),
    "paper": PAPER_STYLE,
    **styles_of(("row 1", "row 15")),
    "network": styles_of(METHODS)["varpro"],
}
_WIDTH_IN, _ROW_IN, _HEAD_IN, _FOOT_IN = 4.7, 0.25, 0.52, 0.44
_LETTER_IN = 0.082


@dataclass(frozen=True)
class TableFigureRow:
    """One row of a table of the paper, and the starts of its trainings.

    Parameters
    ----------
    label : tuple of str
        Settings of the row, a cell for each heading of the figure.
    paper_mm, paper_s : float
        Mean error [mm] and training time [s] as published.
    errors_mm : mapping of str to sequence of float
        For each trainer the mean error of each of its starts [mm].
    seconds : mapping of str to sequence of (float or None)
        For each trainer, when each start first reached the paper's mean error [s]; None for one that never did.
    """

    label: tuple[str, ...]
    paper_mm: float
    paper_s: float
    errors_mm: Mapping[str, Sequence[float]]
    seconds: Mapping[str, Sequence[float | None]]


def table_figure(rows: Sequence[TableFigureRow], *, headings: Sequence[str]) -> Figure:
    """Draw the mean error of every start beside the paper's, and the time until it reached the paper's mean error.

    Parameters
    ----------
    rows : sequence of TableFigureRow
    headings : sequence of str
        Of the cells of the labels.
    """
    pens = {trainer: STYLES[trainer] for row in rows for trainer in row.errors_mm}
    with figure_style():
        panels = (_errors(rows, headings, pens), _times(rows, headings[:1], pens))
    return Figure(
        panels,
        caption="Left: mean error of each start (small marks) and the median (large) beside the paper's value ("
        "diamond). Right: time until the error first was at or below the paper's, median of the starts that reached "
        "it, beside the paper's training time, which was measured on another machine; the numbers at the edge are the "
        "starts that reached it. trainlm fits 70 % of the poses, varpro all. Both scales are logarithmic.",
        alt=f"Dot plots, a row for each of {len(rows)} rows of the paper's table: mean errors, and times to the "
        "paper's accuracy.",
        columns=2,
    )


def _errors(rows: Sequence[TableFigureRow], headings: Sequence[str], pens: Mapping[str, Style]) -> Drawing:
    drawing, axes = _sheet(rows, headings, pens, title="mean error", right_in=0.14)
    starts = {name: [list(row.errors_mm.get(name, ())) for row in rows] for name in pens}
    medians = {name: [bool(values) for values in by_row] for name, by_row in starts.items()}
    _draw(axes, [row.paper_mm for row in rows], starts, medians, pens)
    axes.set_xlabel("mean error of a coordinate [mm]")
    return drawing


def _times(rows: Sequence[TableFigureRow], headings: Sequence[str], pens: Mapping[str, Style]) -> Drawing:
    title = "time to the paper's mean error"
    drawing, axes = _sheet(rows, headings, pens, title=title, right_in=0.2 + 0.36 * len(pens))
    got = {name: [[s for s in row.seconds.get(name, ()) if s is not None] for row in rows] for name in pens}
    # A median only where at least half of the starts reached the error.
    medians = {
        name: [0 < len(row.seconds.get(name, ())) <= 2 * len(times) for row, times in zip(rows, got[name], strict=True)]
        for name in pens
    }
    _draw(axes, [row.paper_s for row in rows], got, medians, pens)
    for k, name in enumerate(pens):
        for base, row, times in zip(_bases(rows), rows, got[name], strict=True):
            started = len(row.seconds.get(name, ()))
            if started:
                axes.annotate(
                    f"{len(times)}/{started}",
                    xy=(1, base),
                    xycoords=axes.get_yaxis_transform(),
                    xytext=(22 + 26 * k, 0),
                    textcoords="offset points",
                    ha="center",
                    va="center",
                    fontsize=7.5,
                )
    axes.set_xlabel("time [s]")
    return drawing


def _draw(
    axes: Axes,
    paper: Sequence[float],
    found: Mapping[str, Sequence[Sequence[float]]],
    with_median: Mapping[str, Sequence[bool]],
    pens: Mapping[str, Style],
) -> None:
    """Draw the paper's value of every row, and each trainer's values with a median where it is wanted."""
    white: Any = {"linestyle": "none", "markeredgecolor": PAPER, "markeredgewidth": 0.65}
    positive = [value for value in paper if value > 0]
    heights = [base for base, value in zip(_bases(paper), paper, strict=True) if value > 0]
    values = [value for by_row in found.values() for row in by_row for value in row if value > 0]
    # A logarithmic scale has no zero.
    set_log_scale(axes, "x", min([*positive, *values], default=1.0) / 1.5, max([*positive, *values], default=1.0) * 1.5)
    for shift, (name, pen) in zip(_shifts(pens), pens.items(), strict=True):
        dots, middles = [], []
        for base, row, wanted in zip(_bases(paper), found[name], with_median[name], strict=True):
            dots += [(value, base + shift) for value in row if value > 0]
            middles += [(float(np.median(row)), base + shift)] if wanted and np.median(row) > 0 else []
        small: Any = {"markersize": 2.6, "alpha": 0.55, "markeredgewidth": 0, "linestyle": "none"}
        axes.plot(*_columns(dots), marker=pen.marker, color=pen.colour, **small)
        axes.plot(*_columns(middles), marker=pen.marker, color=pen.colour, markersize=5.2, **white)
    axes.plot(positive, heights, marker=PAPER_STYLE.marker, color=PAPER_STYLE.colour, markersize=4.4, zorder=4, **white)


def _columns(places: Sequence[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in places], [y for _, y in places]


def _sheet(
    rows: Sequence[TableFigureRow], headings: Sequence[str], pens: Mapping[str, Style], *, title: str, right_in: float
) -> tuple[Drawing, Axes]:
    """Panel with a line for each row, the cells of its label in columns on the left, and a key."""
    widths = [
        _LETTER_IN * max(len(headings[k]), *(len(shorten(row.label[k], longest=24)) for row in rows)) + 0.1
        for k in range(len(headings))
    ]
    left_in = 0.06 + sum(widths)
    height_in = _HEAD_IN + _FOOT_IN + _ROW_IN * len(rows)
    drawing = Drawing(figsize=(_WIDTH_IN, height_in))
    axes = drawing.add_axes(
        (
            left_in / _WIDTH_IN,
            _FOOT_IN / height_in,
            1 - (left_in + right_in) / _WIDTH_IN,
            1 - (_HEAD_IN + _FOOT_IN) / height_in,
        )
    )
    axes.set_ylim(-0.5, len(rows) - 0.5)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.hlines(list(_bases(rows)), 0, 1, transform=axes.get_yaxis_transform(), color=FAINT, linewidth=0.5, zorder=0)
    _labels(axes, rows, headings, widths, left_in)
    drawing.text(0.06 / _WIDTH_IN, 1 - 0.06 / height_in, title, va="top", fontsize=9, weight="bold")
    _key(drawing, pens, height_in)
    return drawing, axes


def _labels(
    axes: Axes, rows: Sequence[TableFigureRow], headings: Sequence[str], widths: Sequence[float], left_in: float
) -> None:
    """Write the headings and the cells of the labels in columns left of the axes."""
    where_in = 0.06
    for k, width in enumerate(widths):
        cells = [(float(base), shorten(row.label[k], longest=24)) for base, row in zip(_bases(rows), rows, strict=True)]
        place = (where_in - left_in) * 72
        for height, text in [(len(rows) - 0.25, headings[k]), *cells]:
            axes.annotate(
                text,
                xy=(0, height),
                xycoords=axes.get_yaxis_transform(),
                xytext=(place, 0),
                textcoords="offset points",
                va="center",
                color=SOFT if height > len(rows) - 0.5 else INK,
            )
        where_in += width


def _key(drawing: Drawing, pens: Mapping[str, Style], height_in: float) -> None:
    entries = {"paper": PAPER_STYLE, **pens}
    handles = [
        Line2D([], [], color=pen.colour, marker=pen.marker, linestyle="none", markersize=4.5)
        for pen in entries.values()
    ]
    drawing.legend(
        handles,
        [f" {shorten(name, longest=14)}" for name in entries],
        loc="upper right",
        bbox_to_anchor=(1.0, 1 - 0.01 / height_in),
        ncols=len(entries),
        handlelength=0.8,
        handletextpad=0.2,
        columnspacing=0.9,
        borderpad=0.2,
        labelcolor=INK,
    )


def _bases(rows: Sequence[object]) -> range:
    """Heights of the rows, the first on top."""
    return range(len(rows) - 1, -1, -1)


def _shifts(pens: Mapping[str, Style]) -> list[float]:
    """Height of each trainer within a row, the first on top."""
    return [0.22 - 0.44 * k / max(len(pens) - 1, 1) if len(pens) > 1 else 0.0 for k in range(len(pens))]


_HIDDEN, _OUTPUT, _INPUT, _BIAS = NAVY, ORANGE, SOFT, LIMIT
_MOST = 8  # a layer of more units is drawn as its first four, dots, and its last two
_UNIT_STEP_IN, _UNIT_RADIUS_IN, _LAYERS_HEAD_IN, _LAYERS_FOOT_IN = 0.36, 0.115, 0.32, 0.62


def network_layers(sizes: Sequence[int], *, activation: str = "tansig") -> Figure:
    """Draw a network of connected layers.

    Parameters
    ----------
    sizes : sequence of int
        Inputs, units of each hidden layer, outputs.
    activation : str
        Of the hidden units; the outputs are linear.
    """
    with figure_style():
        drawing = _draw_network(sizes, activation)
    name = "-".join(str(size) for size in sizes)
    weights = sum((before + 1) * after for before, after in pairwise(sizes))
    hidden = [format_count(size, f"{activation} unit") for size in sizes[1:-1]]
    inside = f"hidden layers: {', then '.join(hidden)}" if hidden else "no hidden layer"
    summary = f"{format_count(sizes[0], 'input')}, {inside}, and {format_count(sizes[-1], 'linear output')}"
    return Figure(
        (drawing,),
        caption=f"The network {name}: {summary}. Every unit is connected to all units of the layer before and to a "
        f"bias (square): {format_number(weights)} weights.",
        alt=f"Drawing of a network of connected layers: {summary}; {format_number(weights)} weights with biases.",
    )


def _draw_network(sizes: Sequence[int], activation: str) -> Drawing:
    shown = [_shown(size) for size in sizes]
    apart_in = max(0.72, min(1.55, 4.4 / (len(sizes) - 1)))
    width_in = 2 * 0.55 + apart_in * (len(sizes) - 1)
    rows = max(len(units) for units in shown)
    # One place more for the bias below each layer but the last.
    height_in = _LAYERS_HEAD_IN + _UNIT_STEP_IN * (rows + 1) + _LAYERS_FOOT_IN
    drawing = Drawing(figsize=(width_in, height_in))
    axes = drawing.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width_in), ylim=(0, height_in))
    axes.axis("off")
    middle = _LAYERS_FOOT_IN + _UNIT_STEP_IN * (rows + 1) / 2 + 0.5 * _UNIT_STEP_IN
    places = []
    for layer, units in enumerate(shown):
        heights = middle + _UNIT_STEP_IN * ((len(units) - 1) / 2 - np.arange(len(units)))
        places.append(np.column_stack([np.full(len(units), 0.55 + layer * apart_in), heights]))
    for layer in range(len(sizes) - 1):
        bias = np.array([places[layer][0, 0], _LAYERS_FOOT_IN + 0.22])
        ends = places[layer + 1][_real(shown[layer + 1])]
        _connect(axes, places[layer][_real(shown[layer])], ends, LIMIT)
        _connect(axes, bias[None], ends, _BIAS, dash=(0, (3, 2)))
        axes.add_patch(Rectangle((bias[0] - 0.1, bias[1] - 0.1), 0.2, 0.2, facecolor=PAPER, edgecolor=_BIAS, zorder=3))
        axes.text(bias[0], bias[1], "1", ha="center", va="center", fontsize=8, zorder=4)
    for layer, (units, where) in enumerate(zip(shown, places, strict=True)):
        _layer(axes, units, where, layer, len(sizes))
        _below(axes, float(where[0, 0]), sizes, layer, activation)
    return drawing


def _shown(size: int) -> list[int | None]:
    """The units that are drawn, counted from 1; None for the others."""
    if size <= _MOST:
        return list(range(1, size + 1))
    return [1, 2, 3, 4, None, size - 1, size]


def _real(units: Sequence[int | None]) -> list[int]:
    return [place for place, unit in enumerate(units) if unit is not None]


def _connect(axes: Axes, starts: FloatArray, ends: FloatArray, colour: str, *, dash: object = "-") -> None:
    lines = [(tuple(start), tuple(end)) for start in starts for end in ends]
    axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.45, linestyles=[dash], alpha=0.8, zorder=1))


def _layer(axes: Axes, units: Sequence[int | None], where: FloatArray, layer: int, layers: int) -> None:
    colour = _INPUT if layer == 0 else _OUTPUT if layer == layers - 1 else _HIDDEN
    for unit, (x, y) in zip(units, where, strict=True):
        if unit is None:
            axes.plot([x] * 3, y + np.array([-0.09, 0, 0.09]), "o", color=colour, markersize=2.2, zorder=3)
            continue
        face = PAPER if layer in (0, layers - 1) else colour
        axes.add_patch(Circle((x, y), _UNIT_RADIUS_IN, facecolor=face, edgecolor=colour, linewidth=1.3, zorder=3))
        if layer == 0:
            axes.text(x - 0.2, y, f"J{unit}", ha="right", va="center")
        elif layer == layers - 1:
            axes.text(x + 0.2, y, "xyz"[unit - 1] if units[-1] == 3 else f"y{unit}", ha="left", va="center")


def _below(axes: Axes, x: float, sizes: Sequence[int], layer: int, activation: str) -> None:
    size = sizes[layer]
    last = layer == len(sizes) - 1
    what = "input" if layer == 0 else "output" if last else "unit"
    axes.text(x, 0.42, format_count(size, what), ha="center", va="center", color=INK)
    kind = "joint angles" if layer == 0 else "linear" if last else activation
    axes.text(x, 0.22, kind, ha="center", va="center", color=_INPUT, style="italic")
