"""Figures of arrays: checks that an array can be drawn, and the distribution of several quantities within limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import MaxNLocator

from truearm.errors import InputError
from truearm.number_format import format_number
from truearm.pages.palette import FAINT, NAVY
from truearm.pages.plotting import Figure, figure_style, make_panel, shorten
from truearm.typing import FloatArray

_USUAL_RANGE = {"deg": 180.0}  # the least that is shown to each side where a quantity has no limits


def finite_array(values: npt.ArrayLike, what: str, *, width: int | None = None) -> FloatArray:
    """Check an array and return a copy of shape (n,), or (n, width) where `width` is given.

    Raises
    ------
    InputError
        If the shape is another, the array is empty, or a number is not finite.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"expected numbers as {what}, got {type(values).__name__}") from None
    wanted = "(n,)" if width is None else f"(n, {width})"
    if array.ndim != (1 if width is None else 2) or (width is not None and array.shape[1] != width):
        raise InputError(f"expected {what} as an array {wanted}, got the shape {array.shape}")
    if array.shape[0] == 0:
        raise InputError(f"expected at least one value in {what}, got none")
    bad = ~np.isfinite(array)
    if bad.any():
        place = np.argwhere(bad)[0]
        raise InputError(
            f"expected finite numbers in {what}, got {array[tuple(place)]} as number {place[0] + 1} "
            f"({int(np.count_nonzero(bad))} in all)",
            hint="remove them before drawing the figure",
        )
    return array


def finite_arrays(
    values: Mapping[str, npt.ArrayLike], what: str, *, width: int | None = None, same_length: bool = False
) -> dict[str, FloatArray]:
    """Check every array of a mapping with `finite_array`; `same_length` requires equal lengths."""
    if not values:
        raise InputError(f"expected {what} under at least one name, got none")
    arrays = {name: finite_array(array, f"{what} of {name!r}", width=width) for name, array in values.items()}
    counts = {name: len(array) for name, array in arrays.items()}
    if same_length and len(set(counts.values())) > 1:
        lengths = ", ".join(f"{name!r} {count}" for name, count in counts.items())
        raise InputError(f"expected {what} of the same length under every name, got {lengths}")
    return arrays


def nonnegative_arrays(values: Mapping[str, npt.ArrayLike], what: str) -> dict[str, FloatArray]:
    """Check every (n,) array of a mapping; a negative number is refused."""
    arrays = finite_arrays(values, what)
    for name, array in arrays.items():
        if array.min() < 0:
            raise InputError(
                f"expected {what} of {name!r} of zero or more, got {array.min():g} as number {array.argmin() + 1}"
            )
    return arrays


def range_figure(
    values: npt.ArrayLike,
    *,
    names: Sequence[str],
    units: Sequence[str],
    lower: FloatArray,
    upper: FloatArray,
    label: str,
    caption: str,
) -> Figure:
    """Draw a histogram of each quantity on one scale a unit, against its limits.

    Parameters
    ----------
    values : (n, k) array
        A column for each quantity, in its unit.
    names, units : sequences of str
        Of the k quantities.
    lower, upper : (k,) arrays
        Limits; an infinite one is no limit.
    label : str
        Of the scale, without the unit.
    caption : str
        First sentence of the caption.

    Raises
    ------
    InputError
        If a value is not finite.
    """
    values = finite_array(values, f"{label}s", width=len(names))
    with figure_style():
        panels = tuple(
            _range_panel(values[:, k], [names[i] for i in k], lower[k], upper[k], f"{label} [{unit}]", unit)
            for unit in dict.fromkeys(units)
            for k in [[i for i, other in enumerate(units) if other == unit]]
        )
    ranges = "; ".join(
        f"{shorten(name)} {_span(column)} {unit}" for name, unit, column in zip(names, units, values.T, strict=True)
    )
    limited = np.isfinite([lower, upper]).any()
    limits = "the grey bar is the range within its limits" if limited else "no limits are given"
    return Figure(
        panels,
        caption=f"{caption} The histogram shows how often each value occurred; {limits}.",
        alt=f"Histogram of each {label}. {ranges}.",
        columns=1 if len(panels) == 1 else 2,
    )


def _range_panel(
    values: FloatArray, names: Sequence[str], low: FloatArray, high: FloatArray, label: str, unit: str
) -> Drawing:
    count = len(names)
    drawing, (axes,) = make_panel(4.6, 0.75 + 0.36 * count)
    names = [shorten(name, longest=14) for name in names]
    drawing.subplots_adjust(left=(0.25 + 0.08 * max(map(len, names))) / 4.6, right=1 - 1.35 / 4.6)
    left, right = _view(values, low, high, usual=_USUAL_RANGE.get(unit, 0.0))
    for i in range(count):
        base = count - 1 - i
        ends = max(low[i], left), min(high[i], right)
        if np.isfinite(low[i]) or np.isfinite(high[i]):
            axes.barh(base, ends[1] - ends[0], left=ends[0], height=0.1, align="edge", color=FAINT, zorder=1)
        _histogram(axes, values[:, i], base + 0.1, (right - left) / 120)
        span = f"{_span(values[:, i])} {unit}"
        axes.text(1.02, base + 0.1, span, transform=axes.get_yaxis_transform(), va="bottom")
    axes.set(xlim=(left, right), ylim=(-0.15, count), xlabel=label)
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
