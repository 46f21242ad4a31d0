"""Figures by joint position: the range of each joint, and the errors of models against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import MaxNLocator

from truearm.errors import InputError
from truearm.number_format import format_count, format_number
from truearm.pages.arrays import finite_array, finite_arrays
from truearm.pages.palette import FAINT, INK, LIMIT, NAVY
from truearm.pages.plotting import Figure, Style, dot_style, figure_style, join_phrases, make_panel, shorten, styles_of
from truearm.typing import FloatArray

_USUAL_DEG = 180.0  # the least that is shown to each side where a joint has no limits


def joint_ranges(
    angles: npt.ArrayLike,
    *,
    names: Sequence[str] | None = None,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
    sliding: Sequence[bool] | None = None,
    caption: str = "",
) -> Figure:
    """Draw how often each joint was where, against its limits.

    Parameters
    ----------
    angles : (n, joints) array
        Joint angles [rad], or displacements of sliding joints [mm].
    names : sequence of str, optional
        Of the joints; J1, J2, ... by default.
    lower, upper : (joints,) array, optional
        Limits [rad or mm]; an infinite one is no limit.
    sliding : sequence of bool, optional
        Which joints slide; none by default.
    caption : str
        What the figure shows; that of readings by default.
    """
    angles = joint_matrix(angles)
    of_readings = f"Range of each joint over {format_count(len(angles), 'reading')}; positions outside are not tested."
    slides = np.zeros(angles.shape[1], dtype=bool) if sliding is None else np.array(sliding, dtype=bool)
    scale = np.where(slides, 1.0, np.degrees(1.0))
    low, high = -np.inf if lower is None else np.asarray(lower), np.inf if upper is None else np.asarray(upper)
    positions, names = angles * scale, joint_names(names, len(slides))
    lower, upper = (np.broadcast_to(limit * scale, slides.shape) for limit in (low, high))
    units = ["mm" if slide else "deg" for slide in slides]
    of_unit = {unit: np.flatnonzero([one == unit for one in units]) for unit in units}
    with figure_style():
        panels = tuple(
            _range_panel(positions[:, k], [names[i] for i in k], lower[k], upper[k], unit)
            for unit, k in of_unit.items()
        )
    ranges = "; ".join(
        f"{shorten(name)} {_span(column)} {unit}" for name, unit, column in zip(names, units, positions.T, strict=True)
    )
    limited = np.isfinite([lower, upper]).any()
    limits = "the grey bar is the range within its limits" if limited else "no limits are given"
    return Figure(
        panels,
        caption=f"{caption or of_readings} The histogram shows how often each value occurred; {limits}.",
        alt=f"Histogram of each joint position. {ranges}.",
        columns=1 if len(panels) == 1 else 2,
    )


def _range_panel(values: FloatArray, names: Sequence[str], low: FloatArray, high: FloatArray, unit: str) -> Drawing:
    count = len(names)
    drawing, (axes,) = make_panel(4.6, 0.75 + 0.36 * count)
    names = [shorten(name, longest=14) for name in names]
    drawing.subplots_adjust(left=(0.25 + 0.08 * max(map(len, names))) / 4.6, right=1 - 1.35 / 4.6)
    left, right = _view(values, low, high, usual=_USUAL_DEG if unit == "deg" else 0.0)
    for i in range(count):
        base = count - 1 - i
        ends = max(low[i], left), min(high[i], right)
        if np.isfinite(low[i]) or np.isfinite(high[i]):
            axes.barh(base, ends[1] - ends[0], left=ends[0], height=0.1, align="edge", color=FAINT, zorder=1)
        _histogram(axes, values[:, i], base + 0.1, (right - left) / 120)
        span = f"{_span(values[:, i])} {unit}"
        axes.text(1.02, base + 0.1, span, transform=axes.get_yaxis_transform(), va="bottom")
    axes.set(xlim=(left, right), ylim=(-0.15, count), xlabel=f"joint position [{unit}]")
    axes.set_yticks(np.arange(count)[::-1] + 0.1, names, va="bottom")
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 1.5, 3, 4.5, 6, 9, 10] if unit == "deg" else [1, 2, 5, 10]))
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    return drawing


def _histogram(axes: Axes, values: FloatArray, base: float, step: float) -> None:
    """Draw a histogram of fixed height on `base`."""
    edges = np.arange(np.floor(values.min() / step), np.floor(values.max() / step) + 2) * step
    counts, edges = np.histogram(values, edges)
    axes.stairs(base + 0.72 * counts / counts.max(), edges, baseline=base, fill=True, color=NAVY, alpha=0.85, zorder=2)


def _view(values: FloatArray, low: FloatArray, high: FloatArray, *, usual: float) -> tuple[float, float]:
    """Range to draw: values and finite limits, and without limits at least the usual range."""
    ends = np.concatenate([[values.min(), values.max()], low[np.isfinite(low)], high[np.isfinite(high)]])
    left, right = float(ends.min()), float(ends.max())
    if not np.isfinite(low).any() and not np.isfinite(high).any():
        left, right = min(left, -usual), max(right, usual)
    margin = max(0.02 * (right - left), 0.5)
    return left - margin, right + margin


def _span(values: FloatArray) -> str:
    return f"{format_number(round(values.min()))} to {format_number(round(values.max()))}"


def error_against_joint(
    angles: npt.ArrayLike,
    errors: Mapping[str, npt.ArrayLike],
    *,
    names: Sequence[str] | None = None,
    sliding: Sequence[bool] | None = None,
    styles: Mapping[str, Style] | None = None,
) -> Figure:
    """Draw errors against the position of each joint, a panel a joint, with a running median.

    Parameters
    ----------
    angles : (n, joints) array
        Joint angles [rad], or displacements of sliding joints [mm].
    errors : mapping of str to (n,) array
        For each model the error of each reading [mm], signed or not.
    names, sliding
        As in `joint_ranges`.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    by_name = finite_arrays(errors, "errors", same_length=True)
    count = len(next(iter(by_name.values())))
    angles = joint_matrix(angles, readings=count)
    names = joint_names(names, angles.shape[1])
    slides = np.zeros(angles.shape[1], dtype=bool) if sliding is None else np.array(sliding, dtype=bool)
    pens = styles_of(by_name, styles)
    with figure_style():
        panels = tuple(
            _joint_panel(angles[:, i] if slides[i] else np.degrees(angles[:, i]), by_name, pens, names[i], slides[i])
            for i in range(len(names))
        )
    models = join_phrases(shorten(name) for name in by_name).replace(";", ",")
    return Figure(
        panels,
        caption=f"Error against the position of each joint ({models}, each on its own scale). The line "
        "is the running median. A trend means that the error depends on this joint's position; its cause can be in any "
        "joint before it. A level line alone proves nothing: compare the size of the error too.",
        alt=f"For each of {len(names)} joints the error of {format_count(count, 'reading')} against its position, "
        f"with a running median, for {models}.",
        columns=3,
    )


def running_median(x: FloatArray, y: FloatArray, *, windows: int = 60) -> tuple[FloatArray, FloatArray]:
    """Running median of `y` over `x`, in windows of equal numbers of readings.

    Returns
    -------
    x, y : (windows,) arrays
        Medians of both in each window; empty with too few readings for a running median.
    """
    width = max(15, min(len(x) // 6, 40), len(x) // 40)
    if len(x) < 2 * width or np.ptp(x) == 0:
        return np.empty(0), np.empty(0)
    order = np.argsort(x, kind="stable")
    starts = np.unique(np.linspace(0, len(x) - width, windows).round().astype(int))
    rows = starts[:, None] + np.arange(width)
    return np.median(x[order][rows], axis=1), np.median(y[order][rows], axis=1)


def _joint_panel(
    x: FloatArray, errors: Mapping[str, FloatArray], pens: Mapping[str, Style], name: str, slides: bool
) -> Drawing:
    drawing, rows = make_panel(3.0, 0.9 + 0.85 * len(errors), rows=len(errors))
    for axes, (model, values) in zip(rows, errors.items(), strict=True):
        pen = pens[model]
        axes.scatter(x, values, color=pen.colour, **dot_style(len(x), 1500))
        axes.plot(*running_median(x, values), color=INK, linewidth=1.5)
        _level(axes, values)
        axes.set_ylabel("error [mm]")
        axes.text(0.985, 0.97, shorten(model), transform=axes.transAxes, ha="right", va="top")
    rows[0].set_title(shorten(name))
    rows[-1].locator_params(axis="x", nbins=6)
    rows[-1].set_xlabel("joint position [mm]" if slides else "joint angle [deg]")
    return drawing


def _level(axes: Axes, values: FloatArray) -> None:
    """Set the scale: from zero for distances, symmetric for signed errors; with room for the name."""
    largest = float(np.abs(values).max()) or 1e-6
    if values.min() < 0:
        axes.set_ylim(-1.1 * largest, 1.35 * largest)
        axes.axhline(0, color=LIMIT, linewidth=0.8, zorder=1)
    else:
        axes.set_ylim(0, 1.3 * largest)
    axes.locator_params(axis="y", nbins=4)


def joint_names(names: Sequence[str] | None, joints: int) -> list[str]:
    """Names of the joints: `names`, or J1, J2, ... by default."""
    if names is None:
        return [f"J{i + 1}" for i in range(joints)]
    return [str(name) for name in names]


def joint_matrix(angles: npt.ArrayLike, *, readings: int | None = None) -> FloatArray:
    """Joint positions as a copy (n, joints); `readings` is the n that is expected."""
    shape = np.shape(angles)
    if len(shape) != 2 or shape[1] == 0:
        raise InputError(f"expected angles as an array (n, joints), got the shape {shape}")
    array = finite_array(angles, "angles", width=shape[1])
    if readings is not None and len(array) != readings:
        raise InputError(f"expected angles of the same {readings} readings as the errors, got {len(array)}")
    return array
