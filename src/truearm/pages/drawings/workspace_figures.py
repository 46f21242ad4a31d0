"""Figures of tip positions in space: the workspace of the readings, and the error in it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import MaxNLocator

from truearm.errors import InputError
from truearm.number_format import format_count, format_number
from truearm.pages.arrays import finite_array, nonnegative_errors
from truearm.pages.palette import FAINT, LIMIT, NAVY
from truearm.pages.plotting import RASTER_FROM, Figure, dot_style, figure_style, make_view
from truearm.typing import FloatArray

SIZE_IN = (4.6, 3.7)
_CELLS = 26  # cells across a view
_VIEWS = (("front (x, z)", 0, 2), ("side (y, z)", 1, 2), ("top (x, y)", 0, 1))
# Light to dark, so that large errors stand out, also in black and white.
_HEAT: Colormap = LinearSegmentedColormap.from_list("error", ["#f6d9a8", "#f0a04b", "#c5477a", "#5b1e79", "#1b0c3b"])


def workspace(points: npt.ArrayLike) -> Figure:
    """Draw the tip positions: one view in space, and from the front, the side and above.

    Parameters
    ----------
    points : (n, 3) array
        The tip in the arm's base frame [mm].

    Raises
    ------
    InputError
        If there is no point, or a coordinate is not finite.
    """
    points = finite_array(points, "points", width=3)
    with figure_style():
        panels = _four_views(points, {"color": NAVY})
    return Figure(
        panels,
        caption=f"Tip positions of {format_count(len(points), 'reading')} in the frame of the reference. "
        f"{_extent(points)}. A cross marks the origin if it is in view. A model is tested only where there are dots.",
        alt=f"Four scatter plots of {len(points)} tip positions: in space, from the front, the side and above. "
        f"{_extent(points)}.",
        columns=2,
    )


def error_in_workspace(points: npt.ArrayLike, errors: npt.ArrayLike, *, name: str = "") -> Figure:
    """Draw the tip positions, coloured by the size of the error.

    Parameters
    ----------
    points : (n, 3) array
        The tip in the arm's base frame [mm].
    errors : (n,) array
        Distance between measured and true point [mm].
    name : str
        The model whose error it is.
    """
    points = finite_array(points, "points", width=3)
    (errors,) = nonnegative_errors({name or "the model": errors}).values()
    if len(points) != len(errors):
        raise InputError(f"expected one error a point, got {len(points)} points and {len(errors)} errors")
    order = np.argsort(errors, kind="stable")  # the largest on top, else the many small ones hide them
    scale, clipped = _scale(errors)
    with figure_style():
        pen = {"c": errors[order], "cmap": _HEAT, "norm": scale}
        panels = _four_views(points[order], pen, opaque=True)
        _colour_bar(panels[0], pen, clipped=clipped)
    worst = points[np.argmax(errors)]
    where = ", ".join(f"{axis} {format_number(round(value))}" for axis, value in zip("xyz", worst, strict=True))
    of_model = f" of {name}" if name else ""
    summary = f"the largest, {format_number(float(errors.max()))} mm, at {where} mm"
    cells = (
        "From the front, side and top, a cell shows the mean of the readings in it. "
        if len(points) > RASTER_FROM
        else ""
    )
    return Figure(
        panels,
        caption=f"Error{of_model} in space, by colour; {summary}. "
        f"{cells}Clusters of large errors indicate an error source that the model does not describe; "
        "scattered ones indicate noise.",
        alt=f"Four scatter plots of {len(points)} tip positions, coloured by the error{of_model}; {summary}.",
        columns=2,
        light_paper=True,
    )


def _four_views(points: FloatArray, pen: dict[str, Any], *, opaque: bool = False) -> tuple[Drawing, ...]:
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    # One scale in all views; a single point gets a span too.
    half = max(float(np.ptp(points, axis=0).max()) / 2, 1.0) * 1.08
    pen = pen | dot_style(len(points), 3000) | ({"alpha": 1.0} if opaque else {})
    space = _space_view(points, pen, middle, half)
    return (space, *(_plane_view(points, pen, middle, half, view) for view in _VIEWS))


def _space_view(points: FloatArray, pen: dict[str, Any], middle: FloatArray, half: float) -> Drawing:
    drawing = Drawing(figsize=SIZE_IN)
    axes: Any = drawing.add_axes((0.04, 0.04, 0.9, 0.9), projection="3d", computed_zorder=False)
    axes.view_init(elev=22, azim=-55)
    axes.set_proj_type("ortho")
    axes.set_box_aspect((1, 1, 1), zoom=0.98)
    axes.scatter(points[:, 0], points[:, 1], points[:, 2], depthshade=False, **pen)
    for letter, centre in zip("xyz", middle, strict=True):
        getattr(axes, f"set_{letter}lim")(centre - half, centre + half)
        axis = getattr(axes, f"{letter}axis")
        axis.set_pane_color((1, 1, 1, 1))
        axis.set_major_locator(_few_ticks())
        axis.line.set_color(LIMIT)
        axis._axinfo["grid"].update(color=FAINT, linewidth=0.5)
        getattr(axes, f"set_{letter}label")(f"{letter} [mm]")
    drawing.text(0.02, 0.97, "in space", va="top", fontsize=9, fontweight="bold")
    return drawing


def _plane_view(
    points: FloatArray, pen: dict[str, Any], middle: FloatArray, half: float, view: tuple[str, int, int]
) -> Drawing:
    title, *both = view
    ends = (middle[both] + side * half / 1.08 for side in (-1, 1))
    drawing, axes = make_view(SIZE_IN, *ends, labels=(f"{'xyz'[axis]} [mm]" for axis in both), title=title)
    across, up = points[:, both].T
    if "c" in pen and len(points) > RASTER_FROM:
        _cells(axes, across, up, pen)
    else:
        axes.scatter(across, up, **pen)
    return drawing


def _cells(axes: Axes, across: FloatArray, up: FloatArray, pen: dict[str, Any]) -> None:
    """Draw the mean error in cells: of thousands of overlapping dots only the last ones would be visible."""
    ratio = max(float(np.ptp(up)), 1.0) / max(float(np.ptp(across)), 1.0)
    size = (_CELLS, max(1, round(_CELLS * min(ratio, 3.0) / np.sqrt(3))))
    axes.hexbin(
        across,
        up,
        pen["c"],
        gridsize=size,
        reduce_C_function=np.mean,
        cmap=pen["cmap"],
        norm=pen["norm"],
        linewidths=0.2,
        rasterized=True,  # more than a thousand cells
    )


def _colour_bar(drawing: Drawing, pen: dict[str, Any], *, clipped: bool) -> None:
    place = drawing.add_axes((0.62, 0.915, 0.34, 0.022))
    bar = drawing.colorbar(
        ScalarMappable(pen["norm"], pen["cmap"]),
        cax=place,
        orientation="horizontal",
        extend="max" if clipped else "neither",
    )
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=7.5, length=2, pad=1)
    bar.locator = _few_ticks()
    bar.update_ticks()
    place.set_title("error [mm]", fontsize=8, fontweight="normal", pad=3)


def _scale(errors: FloatArray) -> tuple[Normalize, bool]:
    """The colour scale, and whether single outliers lie beyond it."""
    usual, largest = float(np.percentile(errors, 99)), float(errors.max())
    clipped = len(errors) > 20 and largest > 1.5 * usual > 0
    return Normalize(0, usual if clipped else max(largest, 1e-12)), clipped


def _few_ticks() -> MaxNLocator:
    return MaxNLocator(4, steps=[1, 2, 2.5, 5, 10])


def _extent(points: FloatArray) -> str:
    spans = zip("xyz", points.min(axis=0), points.max(axis=0), strict=True)
    return ", ".join(
        f"{axis} from {format_number(round(low))} to {format_number(round(high))} mm" for axis, low, high in spans
    )
