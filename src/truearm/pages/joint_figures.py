"""Figures over the joints: the range each one used, and the error against each one's position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import MaxNLocator

from truearm.errors import InputError
from truearm.pages.arrays import finite_arrays, joint_matrix, joint_names
from truearm.pages.number_format import format_number
from truearm.pages.plotting import (
    FAINT,
    INK,
    LIMIT,
    RASTER_FROM,
    Figure,
    Style,
    figure_style,
    join_phrases,
    make_panel,
    reading_count,
    shorten,
    styles_of,
)
from truearm.typing import FloatArray

_BAR = "#12407a"
_FULL_TURN_DEG = 360.0


def joint_ranges(
    angles: npt.ArrayLike,
    *,
    names: Sequence[str] | None = None,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
    sliding: Sequence[bool] | None = None,
) -> Figure:
    """Draw how often each joint was where, against its limits.

    Parameters
    ----------
    angles : (n, joints) array
        Joint angles [rad], or displacements of sliding joints [mm].
    names : sequence of str, optional
        A name a joint; q1, q2, ... where left out.
    lower, upper : (joints,) array, optional
        Limits [rad or mm]; an infinite one is no limit.
    sliding : sequence of bool, optional
        Which joints slide; none where left out.
    """
    angles = joint_matrix(angles)
    joints = angles.shape[1]
    names = joint_names(names, joints)
    slides = _slides(sliding, joints)
    scale = np.where(slides, 1.0, np.degrees(1.0))
    low, high = _limits(lower, upper, joints)
    shown, low, high = angles * scale, low * scale, high * scale
    with figure_style():
        groups = [group for group in (np.flatnonzero(~slides), np.flatnonzero(slides)) if len(group)]
        panels = tuple(
            _ranges_panel(shown[:, group], [names[i] for i in group], low[group], high[group], slides[group[0]])
            for group in groups
        )
    used = "; ".join(
        f"{shorten(name)} {_span(a, b)} {'mm' if slide else 'deg'}"
        for name, a, b, slide in zip(names, shown.min(axis=0), shown.max(axis=0), slides, strict=True)
    )
    limits = "the grey bar is what its limits permit" if np.isfinite([low, high]).any() else "no limits are given"
    return Figure(
        panels,
        caption=f"Range of each joint over {reading_count(len(angles))}. The hill shows how often the joint "
        f"was where; {limits}. What lies outside the hills has not been tested.",
        alt=f"Histogram of the position of each joint. {used}.",
        columns=1 if len(panels) == 1 else 2,
    )


def error_against_joint(
    angles: npt.ArrayLike,
    errors: Mapping[str, npt.ArrayLike],
    *,
    names: Sequence[str] | None = None,
    sliding: Sequence[bool] | None = None,
    styles: Mapping[str, Style] | None = None,
    quantity: str = "error",
) -> Figure:
    """Draw errors against the position of each joint, a panel a joint, with a running median.

    Parameters
    ----------
    angles : (n, joints) array
        Joint angles [rad], or displacements of sliding joints [mm].
    errors : mapping of str to (n,) array
        For each model (or for each coordinate of one model) an error of each reading [mm], with or without sign.
    names, sliding
        As in `joint_ranges`.
    styles : mapping of str to Style, optional
        From `styles_of`.
    quantity : str
        What the errors are, without the unit.
    """
    by_name = finite_arrays(errors, "errors", same_length=True)
    count = len(next(iter(by_name.values())))
    angles = joint_matrix(angles, readings=count)
    names = joint_names(names, angles.shape[1])
    slides = _slides(sliding, angles.shape[1])
    pens = styles_of(by_name, styles)
    with figure_style():
        panels = tuple(
            _error_panel(angles[:, i] if slides[i] else np.degrees(angles[:, i]), by_name, pens, names[i], slides[i])
            for i in range(len(names))
        )
    told = join_phrases(shorten(name) for name in by_name).replace(";", ",")
    return Figure(
        panels,
        caption=f"{quantity.capitalize()} against the position of each joint ({told}, each on its own scale). The line "
        "is the running median. A trend says that the error follows this joint's position; its cause may be in any "
        "joint before it. A level line alone proves nothing: look at the size of the error too.",
        alt=f"For each of {len(names)} joints the {quantity} of {reading_count(count)} against the joint's position, "
        f"with a running median, for {told}.",
        columns=3,
    )


def running_median(x: FloatArray, y: FloatArray, *, windows: int = 60) -> tuple[FloatArray, FloatArray]:
    """Give the median of `y` in windows of neighbouring `x`, all of the same number of readings.

    Returns
    -------
    x, y : (windows,) arrays
        Medians of both in each window; empty where there are too few readings to speak of a course.
    """
    width = max(15, min(len(x) // 6, 40), len(x) // 40)
    if len(x) < 2 * width or np.ptp(x) == 0:
        return np.empty(0), np.empty(0)
    order = np.argsort(x, kind="stable")
    starts = np.unique(np.linspace(0, len(x) - width, windows).round().astype(int))
    rows = starts[:, None] + np.arange(width)
    return np.median(x[order][rows], axis=1), np.median(y[order][rows], axis=1)


def _ranges_panel(shown: FloatArray, names: Sequence[str], low: FloatArray, high: FloatArray, slides: bool) -> Drawing:
    joints, unit = len(names), "mm" if slides else "deg"
    drawing, (axes,) = make_panel(4.6, 0.75 + 0.36 * joints)
    names = [shorten(name, longest=14) for name in names]
    drawing.subplots_adjust(left=(0.25 + 0.08 * max(map(len, names))) / 4.6, right=1 - 1.35 / 4.6)
    left, right = _view(shown, low, high, usual=_FULL_TURN_DEG / 2 if not slides else 0.0)
    for i in range(joints):
        base = joints - 1 - i
        ends = max(low[i], left), min(high[i], right)
        if np.isfinite(low[i]) or np.isfinite(high[i]):
            axes.barh(base, ends[1] - ends[0], left=ends[0], height=0.1, align="edge", color=FAINT, zorder=1)
        _hill(axes, shown[:, i], base + 0.1, (right - left) / 120)
        span = f"{_span(shown[:, i].min(), shown[:, i].max())} {unit}"
        axes.text(1.02, base + 0.1, span, transform=axes.get_yaxis_transform(), va="bottom")
    axes.set(xlim=(left, right), ylim=(-0.15, joints), xlabel=f"joint position [{unit}]")
    axes.set_yticks(np.arange(joints)[::-1] + 0.1, names, va="bottom")
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10] if slides else [1, 1.5, 3, 4.5, 6, 9, 10]))
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    return drawing


def _hill(axes: Axes, values: FloatArray, base: float, step: float) -> None:
    """Draw a histogram as a hill of one height, on `base`."""
    edges = np.arange(np.floor(values.min() / step), np.floor(values.max() / step) + 2) * step
    counts, edges = np.histogram(values, edges)
    axes.stairs(base + 0.72 * counts / counts.max(), edges, baseline=base, fill=True, color=_BAR, alpha=0.85, zorder=2)


def _view(shown: FloatArray, low: FloatArray, high: FloatArray, *, usual: float) -> tuple[float, float]:
    """Give the range to draw: readings and finite limits, and of a joint without limits a usual range."""
    ends = np.concatenate([[shown.min(), shown.max()], low[np.isfinite(low)], high[np.isfinite(high)]])
    left, right = float(ends.min()), float(ends.max())
    if not np.isfinite(low).any() and not np.isfinite(high).any():
        left, right = min(left, -usual), max(right, usual)
    margin = max(0.02 * (right - left), 0.5)
    return left - margin, right + margin


def _error_panel(
    x: FloatArray, errors: Mapping[str, FloatArray], pens: Mapping[str, Style], name: str, slides: bool
) -> Drawing:
    drawing, rows = make_panel(3.0, 0.9 + 0.85 * len(errors), rows=len(errors))
    many = len(x) > RASTER_FROM
    for axes, (model, values) in zip(rows, errors.items(), strict=True):
        pen = pens[model]
        axes.scatter(
            x,
            values,
            s=float(np.clip(1500 / len(x), 1.2, 7)),
            alpha=0.25 if many else 0.5,
            color=pen.colour,
            linewidths=0,
            rasterized=many,
        )
        axes.plot(*running_median(x, values), color=INK, linewidth=1.5)
        _level(axes, values)
        axes.set_ylabel("error [mm]")
        axes.text(0.985, 0.97, shorten(model), transform=axes.transAxes, ha="right", va="top", color=pen.colour)
    rows[0].set_title(shorten(name))
    rows[-1].locator_params(axis="x", nbins=6)
    rows[-1].set_xlabel("joint position [mm]" if slides else "joint angle [deg]")
    return drawing


def _level(axes: Axes, values: FloatArray) -> None:
    """Settle the scale: from zero for distances, even about zero where there are signs; a little room for the name."""
    largest = float(np.abs(values).max()) or 1e-6
    if values.min() < 0:
        axes.set_ylim(-1.1 * largest, 1.35 * largest)
        axes.axhline(0, color=LIMIT, linewidth=0.8, zorder=1)
    else:
        axes.set_ylim(0, 1.3 * largest)
    axes.locator_params(axis="y", nbins=4)


def _span(low: float, high: float) -> str:
    return f"{format_number(round(low))} to {format_number(round(high))}"


def _slides(sliding: Sequence[bool] | None, joints: int) -> npt.NDArray[np.bool_]:
    slides = np.zeros(joints, dtype=bool) if sliding is None else np.array(sliding, dtype=bool)
    if slides.shape != (joints,):
        raise InputError(f"expected sliding for each of {joints} joints, got {slides.size}")
    return slides


def _limits(lower: npt.ArrayLike | None, upper: npt.ArrayLike | None, joints: int) -> tuple[FloatArray, FloatArray]:
    low = np.full(joints, -np.inf) if lower is None else np.array(lower, dtype=np.float64)
    high = np.full(joints, np.inf) if upper is None else np.array(upper, dtype=np.float64)
    for what, limit in (("lower", low), ("upper", high)):
        if limit.shape != (joints,) or np.isnan(limit).any():
            raise InputError(f"expected {what} limits of {joints} joints, got {limit.tolist()}")
    if (low > high).any():
        worst = int(np.argmax(low > high))
        raise InputError(f"expected the lower limit of joint {worst + 1} below the upper, got {low[worst]:g} rad or mm")
    return low, high
