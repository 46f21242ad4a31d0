"""Drawing of a network: its layers from left to right, units as circles, biases as squares."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Circle, Rectangle

from truearm.number_format import format_count, format_number
from truearm.pages.palette import INK, LIMIT, NAVY, ORANGE, PAPER, SOFT
from truearm.pages.plotting import Figure, figure_style
from truearm.typing import FloatArray

_HIDDEN, _OUTPUT, _INPUT, _BIAS = NAVY, ORANGE, SOFT, LIMIT
_MOST = 8  # a layer of more units is drawn as its first four, dots, and its last two
_STEP_IN, _RADIUS_IN, _HEAD_IN, _FOOT_IN = 0.36, 0.115, 0.32, 0.62


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
    height_in = _HEAD_IN + _STEP_IN * (rows + 1) + _FOOT_IN
    drawing = Drawing(figsize=(width_in, height_in))
    axes = drawing.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width_in), ylim=(0, height_in))
    axes.axis("off")
    middle = _FOOT_IN + _STEP_IN * (rows + 1) / 2 + 0.5 * _STEP_IN
    places = []
    for layer, units in enumerate(shown):
        heights = middle + _STEP_IN * ((len(units) - 1) / 2 - np.arange(len(units)))
        places.append(np.column_stack([np.full(len(units), 0.55 + layer * apart_in), heights]))
    for layer in range(len(sizes) - 1):
        bias = np.array([places[layer][0, 0], _FOOT_IN + 0.22])
        _connect(
            axes, np.vstack([places[layer][_real(shown[layer])]]), places[layer + 1][_real(shown[layer + 1])], LIMIT
        )
        _connect(axes, bias[None], places[layer + 1][_real(shown[layer + 1])], _BIAS, dash=(0, (3, 2)))
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
        filled = layer not in (0, layers - 1)
        axes.add_patch(
            Circle((x, y), _RADIUS_IN, facecolor=colour if filled else PAPER, edgecolor=colour, linewidth=1.3, zorder=3)
        )
        if layer == 0:
            axes.text(x - 0.2, y, f"J{unit}", ha="right", va="center")
        elif layer == layers - 1:
            outputs = units[-1]
            axes.text(x + 0.2, y, "xyz"[unit - 1] if outputs == 3 else f"y{unit}", ha="left", va="center")


def _below(axes: Axes, x: float, sizes: Sequence[int], layer: int, activation: str) -> None:
    size = sizes[layer]
    last = layer == len(sizes) - 1
    what = "input" if layer == 0 else "output" if last else "unit"
    axes.text(x, 0.42, format_count(size, what), ha="center", va="center", color=INK)
    kind = "joint angles" if layer == 0 else "linear" if last else activation
    axes.text(x, 0.22, kind, ha="center", va="center", color=_INPUT, style="italic")
