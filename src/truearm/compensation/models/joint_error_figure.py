"""The figure of every joint's own error: over its angle with its uncertainty, and by order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import FixedLocator, MaxNLocator

from truearm.compensation.models.error_figures import joint_matrix, joint_names
from truearm.errors import InputError
from truearm.identification.estimation.diagnostics import JointError
from truearm.pages.number_format import format_number
from truearm.pages.plotting import (
    LIMIT,
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

ARCSEC = float(np.degrees(1.0) * 3600)  # of a radian
COVERAGE_FACTOR = 1.96  # 95 % of a normal distribution
_LABELLED = 3  # orders whose amplitudes are known best
_SMALLEST = 0.003  # amplitude that is drawn, by the largest


def joint_error_figure(
    errors: Mapping[str, Sequence[JointError]],
    angles: npt.ArrayLike,
    *,
    names: Sequence[str] | None = None,
    styles: Mapping[str, Style] | None = None,
) -> Figure:
    """Draw the own errors of joints, two panels a joint: over its angle, and by order.

    Parameters
    ----------
    errors : mapping of str to sequence of JointError
        For each model; joints of whose errors no readings tell are left out.
    angles : (n, joints) array
        Of readings, to show where there were some [rad].
    names : sequence of str, optional
        Of the joints; J1, J2, ... by default.
    styles : mapping of str to Style, optional
        From `styles_of`.

    Raises
    ------
    InputError
        If the readings tell of no joint's error, or an error is of a joint without angles.
    """
    read = joint_matrix(angles)
    names = joint_names(names, read.shape[1])
    by_joint: dict[int, dict[str, JointError]] = {}
    for model, found in errors.items():
        for error in found:
            if not 1 <= error.joint <= len(names):
                raise InputError(f"expected errors of joints 1 to {len(names)}, got one of joint {error.joint}")
            if any(other.is_significant for every in errors.values() for other in every if other.joint == error.joint):
                by_joint.setdefault(error.joint, {})[model] = error
    if not by_joint:
        raise InputError("expected a joint of whose error readings tell, got none")
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
    without = f" Of {', '.join(none)} the readings tell nothing that is larger than its uncertainty." if none else ""
    return Figure(
        panels,
        caption="What each joint turns further than its encoder shows, over its angle and by order, waves in a full "
        f"turn{'' if several else ' (numbers at those known best)'}. Bands and whiskers hold the true value with 95 % "
        "probability. The grey hill is where the readings stood; away from them the band widens. 10 arcsec move a "
        "point 1 m away by 0.048 mm. Where a joint did not turn all round, neighbouring orders cannot be told apart: "
        "the curve is known better than its orders are." + without,
        alt=f"Error of {len(by_joint)} joints about their own axes over their angles, and its amplitude by order. "
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
    _hill(axes, np.degrees(read))
    axes.axhline(0, color=LIMIT, linewidth=0.6, zorder=1)
    told = [f"{_rms(error)}{f' ({shorten(model)})' if named else ''}" for model, error in errors.items()]
    axes.set_title(f"{shorten(name, longest=14)}: {', '.join(told)} arcsec rms")
    axes.set(xlabel="joint angle [deg]", ylabel="error [arcsec]")
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    return drawing


def _hill(axes: Axes, read: FloatArray) -> None:
    """Draw where the readings stood, as a low hill on the lower edge."""
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
        for order in _surest(error) if len(errors) == 1 else ():
            label = str(error.orders[order])
            place = (float(at[order]), float(high[order] + half[order]))
            axes.annotate(label, place, xytext=(0, 2), textcoords="offset points", ha="center", fontsize=7.5)
    set_log_scale(axes, "x", 0.85, 1.18 * max(int(error.orders.max(initial=2)) for error in errors.values()))
    axes.xaxis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, 50, 100, 200, 500]))
    set_log_scale(axes, "y", floor, 1.6 * max(tops))
    axes.set_title(f"{shorten(name, longest=14)} by order")
    axes.set(xlabel="order: waves in a full turn", ylabel="amplitude [arcsec]")
    return drawing


def _surest(error: JointError) -> list[int]:
    """Give where the amplitudes stand that are known best, none beside another: there is no room for two labels."""
    found: list[int] = []
    for i in np.argsort(-error.amplitudes / np.maximum(error.amplitudes_std, 1e-12), kind="stable").tolist():
        apart = all(abs(np.log(error.orders[i] / error.orders[j])) > 0.2 for j in found)
        if len(found) < _LABELLED and apart and error.amplitudes[i] > COVERAGE_FACTOR * error.amplitudes_std[i]:
            found.append(i)
    return found
