"""Figures over the readings in their order: errors and coordinates, as in Figures 6 to 8 of Gao et al. (2017)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.errors import InputError
from truearm.pages.arrays import finite_array, finite_arrays
from truearm.pages.number_format import format_number
from truearm.pages.plotting import (
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

_MOST_COORDINATES = 100  # more cannot be told apart


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
        panels = tuple(_error_panel(by_name, pens, coordinate) for coordinate in range(3))
    before, *after = (shorten(name) for name in by_name)
    told = join_phrases(
        f"{shorten(name)} {format_number(float(np.abs(values).mean()), digits=2)} mm on average and "
        f"{format_number(float(np.abs(values).max()), digits=2)} mm at most"
        for name, values in by_name.items()
    )
    closer = f" Above, all on one scale; below, the same without {before} on its own." if after else ""
    return Figure(
        panels,
        caption=f"Error of x, y and z, reading by reading.{closer} Error of a single coordinate: {told}.",
        alt=f"Errors of the coordinates x, y and z of {reading_count(count)}. {told}.",
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
    which = f"the first {drawn} of {reading_count(count)}" if drawn < count else reading_count(count)
    return Figure(
        panels,
        caption=f"Coordinates of {which}: the reference as a line, the models as marks. On this scale a mark beside "
        "its line would be a gross error.",
        alt=f"Coordinates x, y and z of {which} by the reference and by {', '.join(shorten(name) for name in by_name)}.",
        columns=3,
    )


def _error_panel(errors: Mapping[str, FloatArray], pens: Mapping[str, Style], coordinate: int) -> Drawing:
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
    axes.scatter(
        np.arange(1, n + 1),
        values,
        s=float(np.clip(1600 / n, 1.2, 9)),
        alpha=0.3 if n > RASTER_FROM else 0.75,
        color=pen.colour,
        marker=pen.marker,
        linewidths=0,
        rasterized=n > RASTER_FROM,
    )


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
    """Give the height [in] that the names of the models need beyond the line of the title."""
    letters = sum(len(shorten(name, longest=14)) + 3 for name in names)
    return 0.0 if letters <= 36 else 0.17 * math.ceil(len(names) / 2)


def _key(axes: Axes, names: Mapping[str, FloatArray], pens: Mapping[str, Style]) -> None:
    """Name the models above the axes, where no dot is: beside the title if they fit there, else below it."""
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
