"""The figure of every joint's own error: over its angle with its uncertainty, and by order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import FixedLocator, MaxNLocator

from truearm.number_format import format_number
from truearm.pages.drawings.joint_figures import joint_matrix, joint_names
from truearm.pages.palette import LIMIT
from truearm.pages.plotting import (
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
from truearm.wings.reports.term_effects import JointError

ARCSEC = float(np.degrees(1.0) * 3600)  # of a radian
COVERAGE_FACTOR = 1.96  # 95 % of a normal distribution
_LABELLED = 3  # orders with the best known amplitudes
_SMALLEST = 0.003  # smallest amplitude that is drawn, as a share of the largest


def joint_error_figure(
    errors: Mapping[str, Sequence[JointError]],
    angles: npt.ArrayLike,
    *,
    names: Sequence[str] | None = None,
    styles: Mapping[str, Style] | None = None,
) -> Figure:
    """Draw the own errors of joints, two panels per joint: against its angle, and by order.

    Parameters
    ----------
    errors : mapping of str to sequence of JointError
        For each model, at least one of them significant; joints without a significant error are not drawn.
    angles : (n, joints) array
        Joint angles of the readings, to show their distribution [rad].
    names : sequence of str, optional
        Of the joints; J1, J2, ... by default.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    read = joint_matrix(angles)
    names = joint_names(names, read.shape[1])
    by_joint: dict[int, dict[str, JointError]] = {}
    for model, found in errors.items():
        for error in found:
            if any(other.is_significant for every in errors.values() for other in every if other.joint == error.joint):
                by_joint.setdefault(error.joint, {})[model] = error
    pens = styles_of(errors, styles)
    several = len(errors) > 1
    with figure_style():
        panels = tuple(
            drawing
            for joint in sorted(by_joint)
            for drawing in (
                _curves(by_joint[joint], pens, read[:, joint - 1], names[joint - 1], named=several),
                _spectra(by_joint[joint], pens, names[joint - 1]),
            )
        )
    sizes = [
        f"{shorten(names[joint - 1])} "
        + ", ".join(
            f"{_rms(error)} arcsec{f' ({shorten(model)})' if several else ''}" for model, error in found.items()
        )
        for joint, found in sorted(by_joint.items())
    ]
    none = [shorten(name) for joint, name in enumerate(names, 1) if joint not in by_joint]
    without = f" {', '.join(none)}: no error larger than its uncertainty." if none else ""
    return Figure(
        panels,
        caption="Rotation of each joint minus the encoder's reading, against the joint angle and by order (periods in "
        f"a full turn{'' if several else '; the best known are labelled'}). Bands and whiskers are 95 % intervals. The "
        "grey area shows where the readings were; the band widens outside. 10 arcsec move a point 1 m away by "
        "0.048 mm. Where a joint did not make a full turn, neighbouring orders are not identifiable one by one: the "
        "curve is known better than its orders." + without,
        alt=f"Error of {len(by_joint)} joints about their own axes against their angles, and its amplitude by order. "
        f"Root mean square: {join_phrases(sizes, most=8)}.",
        columns=2,
    )


def _rms(error: JointError) -> str:
    return format_number(error.rms * ARCSEC, digits=2)


def _curves(
    errors: Mapping[str, JointError], pens: Mapping[str, Style], read: FloatArray, name: str, *, named: bool
) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 2.0)
    largest = max(float(np.abs(error.error).max()) for error in errors.values()) * ARCSEC or 1e-6
    for model, error in errors.items():
        pen, at, middle = pens[model], np.degrees(error.angles), error.error * ARCSEC
        half = COVERAGE_FACTOR * error.std * ARCSEC
        axes.fill_between(at, middle - half, middle + half, color=pen.colour, alpha=0.22, linewidth=0)
        axes.plot(at, middle, color=pen.colour, linestyle=pen.dash, linewidth=1.0)
    axes.set_xlim(
        min(float(np.degrees(error.angles.min())) for error in errors.values()),
        max(float(np.degrees(error.angles.max())) for error in errors.values()),
    )
    axes.set_ylim(-1.5 * largest, 1.25 * largest)
    _histogram(axes, np.degrees(read))
    axes.axhline(0, color=LIMIT, linewidth=0.6, zorder=1)
    sizes = [f"{_rms(error)}{f' ({shorten(model)})' if named else ''}" for model, error in errors.items()]
    axes.set_title(f"{shorten(name, longest=14)}: {', '.join(sizes)} arcsec rms")
    axes.set(xlabel="joint angle [deg]", ylabel="error [arcsec]")
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    return drawing


def _histogram(axes: Axes, read: FloatArray) -> None:
    """Draw the distribution of the readings, as a low histogram on the lower edge."""
    left, right = axes.get_xlim()
    counts, edges = np.histogram(read, np.linspace(left, right, 121))
    if counts.any():
        low, high = axes.get_ylim()
        height = 0.12 * (high - low) * np.sqrt(counts / counts.max())
        axes.stairs(low + height, edges, baseline=low, fill=True, color=LIMIT, alpha=0.55, zorder=2, linewidth=0)


def _spectra(errors: Mapping[str, JointError], pens: Mapping[str, Style], name: str) -> Drawing:
    drawing, (axes,) = make_panel(4.6, 2.0)
    highest = max(float(error.amplitudes.max(initial=0.0)) for error in errors.values()) * ARCSEC or 1e-6
    floor = _SMALLEST * highest
    tops = [highest]
    for i, (model, error) in enumerate(errors.items()):
        at = error.orders * 1.015 ** (i - (len(errors) - 1) / 2)  # side by side
        high, half = error.amplitudes * ARCSEC, COVERAGE_FACTOR * error.amplitudes_std * ARCSEC
        seen = high > floor
        axes.vlines(at, np.maximum(high - half, floor), high + half, color=pens[model].colour, linewidth=0.6, alpha=0.4)
        axes.scatter(at[seen], high[seen], s=5, color=pens[model].colour, linewidths=0, zorder=3)
        tops += (high + half).tolist()
        for order in _best_known(error) if len(errors) == 1 else ():
            label = str(error.orders[order])
            place = (float(at[order]), float(high[order] + half[order]))
            axes.annotate(label, place, xytext=(0, 2), textcoords="offset points", ha="center", fontsize=7.5)
    set_log_scale(axes, "x", 0.85, 1.18 * max(int(error.orders.max(initial=2)) for error in errors.values()))
    axes.xaxis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, 50, 100, 200, 500]))
    set_log_scale(axes, "y", floor, 1.6 * max(tops))
    axes.set_title(f"{shorten(name, longest=14)} by order")
    axes.set(xlabel="order: periods in a full turn", ylabel="amplitude [arcsec]")
    return drawing


def _best_known(error: JointError) -> list[int]:
    """Rows of the best known amplitudes, none beside another: there is no room for two labels."""
    chosen: list[int] = []
    for i in np.argsort(-error.amplitudes / np.maximum(error.amplitudes_std, 1e-12), kind="stable").tolist():
        apart = all(abs(np.log(error.orders[i] / error.orders[j])) > 0.2 for j in chosen)
        if len(chosen) < _LABELLED and apart and error.amplitudes[i] > COVERAGE_FACTOR * error.amplitudes_std[i]:
            chosen.append(i)
    return chosen
