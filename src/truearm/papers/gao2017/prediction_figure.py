"""A few poses in detail: true and predicted coordinates and the errors, as in Figure 4 of Gao et al. (2017)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.errors import InputError
from truearm.pages.figures import finite_array, finite_arrays
from truearm.pages.number_format import format_number
from truearm.pages.plotting import INK, LIMIT, Figure, Style, figure_style, join_phrases, make_panel, shorten, styles_of
from truearm.typing import FloatArray


def predictions_by_pose(
    truth: npt.ArrayLike, predicted: Mapping[str, npt.ArrayLike], *, styles: Mapping[str, Style] | None = None
) -> Figure:
    """Draw true and predicted coordinates pose by pose, and below them the errors.

    Parameters
    ----------
    truth : (n, 3) array
        True coordinates [mm].
    predicted : mapping of str to (n, 3) array
        Coordinates by each model [mm].
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    truth = finite_array(truth, "truth", width=3)
    by_name = finite_arrays(predicted, "predicted points", width=3, same_length=True)
    count = len(next(iter(by_name.values())))
    if len(truth) != count:
        raise InputError(f"expected predicted points of the same {len(truth)} poses as the truth, got {count}")
    pens = styles_of(by_name, styles)
    errors = {name: points - truth for name, points in by_name.items()}
    with figure_style():
        panels = tuple(_panel(truth, by_name, errors, pens, coordinate) for coordinate in range(3))
    told = join_phrases(
        f"{shorten(name)} {format_number(float(np.abs(values).mean()), digits=2)} mm on average and "
        f"{format_number(float(np.abs(values).max()), digits=2)} mm at most"
        for name, values in errors.items()
    )
    return Figure(
        panels,
        caption=f"Coordinates of {format_number(count)} poses: above, the truth as black crosses and the predictions "
        f"as marks; below, predicted minus true. Error of a single coordinate: {told}.",
        alt=f"Coordinates x, y and z of {format_number(count)} poses, true and predicted, and the errors. {told}.",
        columns=3,
    )


def _panel(
    truth: FloatArray,
    predicted: Mapping[str, FloatArray],
    errors: Mapping[str, FloatArray],
    pens: Mapping[str, Style],
    coordinate: int,
) -> Drawing:
    drawing, (above, below) = make_panel(3.0, 3.4, rows=2, top_in=0.44)
    poses = np.arange(1, len(truth) + 1)
    above.plot(poses, truth[:, coordinate], "x", color=INK, markersize=7, markeredgewidth=1.0, zorder=2, label="true")
    shifts = 0.24 * (np.arange(len(predicted)) - (len(predicted) - 1) / 2)
    for shift, (name, points) in zip(shifts, predicted.items(), strict=True):
        _marks(above, poses + shift, points[:, coordinate], pens[name], name)
        values = errors[name][:, coordinate]
        below.vlines(poses + shift, 0, values, color=pens[name].colour, linewidth=1.2)
        _marks(below, poses + shift, values, pens[name], name)
    # One scale for x, y and z, so that the panels can be compared.
    largest = max(float(np.abs(values).max()) for values in errors.values()) or 1e-6
    below.set_ylim(-1.15 * largest, 1.15 * largest)
    below.axhline(0, color=LIMIT, linewidth=0.8, zorder=1)
    above.set_title("xyz"[coordinate])
    above.set_ylabel(f"{'xyz'[coordinate]} [mm]")
    below.set(ylabel="error [mm]", xlabel="pose", xlim=(0.4, len(truth) + 0.6))
    below.locator_params(axis="x", nbins=6, integer=True)
    if coordinate == 0:
        above.legend(
            loc="lower right",
            bbox_to_anchor=(1.02, 0.98),
            ncols=3,
            handlelength=1.0,
            handletextpad=0.1,
            columnspacing=0.6,
        )
    return drawing


def _marks(axes: Axes, x: FloatArray, y: FloatArray, pen: Style, name: str) -> None:
    axes.plot(
        x, y, pen.marker, color=pen.colour, markersize=3.4, markeredgewidth=0, label=f" {shorten(name, longest=12)}"
    )
