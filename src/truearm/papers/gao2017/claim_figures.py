"""Pictures of what claims about a direct network are worth: scatter of starts, rates, ranges, and the world outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.errors import InputError
from truearm.pages.figures import finite_array, nonnegative_arrays
from truearm.pages.number_format import format_exact, format_in_text, format_number
from truearm.pages.plotting import (
    INK,
    LEFT_IN,
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
from truearm.papers.gao2017.table_figure import PAPER_STYLE
from truearm.typing import FloatArray

_WIDTH_IN = 5.2


def scatter_of_starts(
    starts: npt.ArrayLike, published: npt.ArrayLike, *, name: str = "starts", style: Style | None = None
) -> Figure:
    """Draw the error of one training from many starts, and published values that are said to differ by a setting.

    Parameters
    ----------
    starts : (n,) array
        Mean error of each start [mm].
    published : (k,) array
        Published mean errors [mm].
    name : str
        What was started.
    style : Style, optional
        Of the starts.
    """
    starts, published = _positive(starts, "starts"), _positive(published, "published errors")
    pen = style or styles_of([name])[name]
    told = f"{len(starts)} starts {_from_to(starts)}, {len(published)} published values {_from_to(published)}"
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 1.75, top_in=0.1)
        _roomy_left(drawing, 0.95)
        spread = 0.5 * ((np.arange(len(starts)) * 0.6180339887498949) % 1 - 0.5)  # golden ratio: even, no chance in it
        axes.plot(starts, 1 + spread, pen.marker, color=pen.colour, markersize=4, alpha=0.7, markeredgewidth=0)
        axes.plot([np.median(starts)] * 2, [0.65, 1.35], color=INK, linewidth=1.4)
        axes.plot(
            published, np.zeros(len(published)), PAPER_STYLE.marker, color=PAPER_STYLE.colour, markersize=5, alpha=0.8
        )
        axes.axvspan(starts.min(), starts.max(), color=pen.colour, alpha=0.08, linewidth=0)
        axes.set_yticks([1, 0], [f"{len(starts)} starts", f"paper, {len(published)} rows"])
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        axes.spines["left"].set_visible(False)
        axes.set(ylim=(-0.5, 1.55), xlabel="mean error of a coordinate [mm]")
        axes.locator_params(axis="x", nbins=8)
    return Figure(
        (drawing,),
        caption=f"{shorten(name, longest=120)}: {told}. The bar is the median; the tint reaches from the least to the "
        "largest start.",
        alt=f"Strip of dots: {told}.",
    )


def error_against_rate(
    rates: npt.ArrayLike, published: npt.ArrayLike, found: float, *, style: Style | None = None
) -> Figure:
    """Draw published errors against the learning rate, and the error of the one training that they are.

    Parameters
    ----------
    rates, published : (n,) arrays
        Published learning rates, and mean errors [mm].
    found : float
        Mean error found, at whatever rate [mm].
    style : Style, optional
        Of what was found.
    """
    rates, published, (found,) = _positive(rates, "rates"), _positive(published, "errors"), _positive([found], "errors")
    if len(rates) != len(published):
        raise InputError(f"expected an error for each of {len(rates)} rates, got {len(published)}")
    pen = style or styles_of(["found"])["found"]
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 2.5, top_in=0.32)
        axes.plot(rates, published, "D", color=PAPER_STYLE.colour, markersize=5, label="paper")
        axes.axhline(found, color=pen.colour, linewidth=1.4, label="here, median of the starts")
        set_log_scale(axes, "x", rates.min() / 2, rates.max() * 2)
        axes.set_ylim(0, 1.15 * max(found, published.max()))
        axes.set(xlabel="learning rate", ylabel="mean error [mm]")
        _key(axes)
    told = f"the paper's rows {_from_to(published)}; here one training, {format_number(float(found))} mm"
    return Figure((drawing,), caption=f"Mean error against the learning rate: {told}.", alt=f"Mean errors: {told}.")


def error_against_box(
    half_widths: npt.ArrayLike,
    errors: Mapping[str, npt.ArrayLike],
    published: Mapping[str, float],
    *,
    chosen: float,
    styles: Mapping[str, Style] | None = None,
) -> Figure:
    """Draw the error of networks against the width of the box they are trained and tested in, and published values.

    Parameters
    ----------
    half_widths : (n,) array
        Half-widths of the box of joint angles [deg].
    errors : mapping of str to (n,) array
        Mean error of each network [mm].
    published : mapping of str to float
        The published mean error of each network [mm].
    chosen : float
        The half-width that was chosen [deg].
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    widths = _positive(half_widths, "half-widths")
    by_name = {name: _positive(values, f"errors of {name!r}") for name, values in errors.items()}
    for name, values in by_name.items():
        if len(values) != len(widths):
            raise InputError(f"expected errors of {name!r} for {len(widths)} half-widths, got {len(values)}")
        if name not in published:
            raise InputError(f"expected a published error for every network, got none for {name!r}")
    pens = styles_of(by_name, styles)
    order = np.argsort(widths)
    met = {name: crossings(widths, values, published[name]) for name, values in by_name.items()}
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 3.1, top_in=0.32)
        drawing.subplots_adjust(right=1 - 0.62 / _WIDTH_IN)
        for name, values in by_name.items():
            pen = pens[name]
            axes.plot(
                widths[order],
                values[order],
                pen.marker,
                linestyle=pen.dash,
                color=pen.colour,
                markersize=5,
                label=shorten(name),
            )
            axes.axhline(published[name], color=pen.colour, linewidth=1.0, linestyle=(0, (1.5, 2)))
            axes.plot(
                met[name], [published[name]] * len(met[name]), "D", color=PAPER_STYLE.colour, markersize=5.5, zorder=5
            )
        axes.axvline(chosen, color=LIMIT, linewidth=1.0, linestyle=(0, (4, 3)))
        everything = np.concatenate([*by_name.values(), [published[name] for name in by_name]])
        set_log_scale(axes, "y", everything.min() / 1.6, everything.max() * 1.6)
        axes.annotate(
            f"chosen: \u00b1{format_exact(chosen)} deg",
            xy=(chosen, 0.02),
            xycoords=axes.get_xaxis_transform(),
            xytext=(4, 0),
            textcoords="offset points",
            color=INK,
        )
        for name in by_name:
            axes.annotate(
                f"paper\n{format_exact(published[name])}",
                xy=(1.01, published[name]),
                xycoords=axes.get_yaxis_transform(),
                va="center",
                color=pens[name].colour,
            )
        axes.set(xlabel="half-width of the box of joint angles [deg]", ylabel="mean error [mm]")
        _key(axes)
    told = join_phrases(f"{shorten(name)} {_met(met[name], widths)}" for name in by_name)
    return Figure(
        (drawing,),
        caption="Mean error of networks that are trained and tested in boxes of several widths (marks). Dotted lines "
        f"are the paper's values, black diamonds where they are met: {told}.",
        alt=f"Mean error against the half-width of the box for {len(by_name)} networks. The paper's values are met: "
        f"{told}.",
    )


def crossings(x: npt.ArrayLike, y: npt.ArrayLike, level: float) -> list[float]:
    """Give every x where a curve through points crosses a level, straight between them on a logarithmic scale of y."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    order = np.argsort(x)
    x, height = x[order], np.log(y[order] / level)
    found = []
    for i in range(len(x) - 1):
        if height[i] == 0:
            found.append(float(x[i]))
        elif height[i] * height[i + 1] < 0:
            found.append(float(x[i] + (x[i + 1] - x[i]) * height[i] / (height[i] - height[i + 1])))
    if len(x) and height[-1] == 0:
        found.append(float(x[-1]))
    return found


def error_outside(
    beyond: npt.ArrayLike,
    lm: tuple[npt.ArrayLike, npt.ArrayLike],
    others: Mapping[str, npt.ArrayLike],
    *,
    styles: Mapping[str, Style] | None = None,
) -> Figure:
    """Draw the error of a direct network, lm, against how far outside its box the arm stands.

    Parameters
    ----------
    beyond : (n,) array
        How far the farthest joint lies beyond the box [deg]; zero inside.
    lm : pair of (n,) arrays
        Median and 95th percentile of the network's error there [mm].
    others : mapping of str to (n,) array
        Median errors of other models there [mm].
    styles : mapping of str to Style, optional
        From `styles_of`, with ``"lm"``.
    """
    beyond = finite_array(beyond, "distances from the box")
    median, p95 = (_positive(values, "errors of lm") for values in lm)
    by_name = {name: _positive(values, f"errors of {name!r}") for name, values in others.items()}
    for name, values in {"lm": median, "lm, 95 %": p95, **by_name}.items():
        if len(values) != len(beyond):
            raise InputError(f"expected errors of {name!r} at {len(beyond)} distances, got {len(values)}")
    pens = styles_of(["lm", *by_name], styles)
    order = np.argsort(beyond)
    pen = pens["lm"]
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 3.0, top_in=0.32)
        axes.fill_between(beyond[order], median[order], p95[order], color=pen.colour, alpha=0.15, linewidth=0)
        axes.plot(beyond[order], p95[order], color=pen.colour, linewidth=0.8, linestyle=(0, (4, 2)))
        axes.plot(beyond[order], median[order], pen.marker, linestyle="-", color=pen.colour, markersize=5, label="lm")
        for name, values in by_name.items():
            other = pens[name]
            axes.plot(
                beyond[order],
                values[order],
                other.marker,
                linestyle=other.dash,
                color=other.colour,
                markersize=4,
                label=name,
            )
        everything = np.concatenate([median, p95, *by_name.values()])
        set_log_scale(axes, "y", everything.min() / 1.6, everything.max() * 1.6)
        axes.set(xlabel="farthest joint beyond the box [deg]", ylabel="error [mm]")
        _key(axes)
    farthest = int(order[-1])
    told = join_phrases(
        f"{shorten(name)} {format_number(float(values[order[0]]), digits=2)} mm at "
        f"{format_in_text(beyond[order[0]])} deg and {format_number(float(values[farthest]), digits=2)} mm at "
        f"{format_in_text(beyond[farthest])} deg"
        for name, values in {"lm": median, **by_name}.items()
    )
    return Figure(
        (drawing,),
        caption="Error of a coordinate outside the box that lm was trained in, on a logarithmic scale: medians, and of "
        "lm a tint up to the 95th percentile. "
        f"{told[0].upper()}{told[1:]}.",
        alt=f"Error against the distance outside the box, on a logarithmic scale. {told}.",
    )


def share_removed(errors: Mapping[str, float], *, before: str, styles: Mapping[str, Style] | None = None) -> Figure:
    """Draw mean errors on a logarithmic scale with, above it, the share of the first that is removed.

    Parameters
    ----------
    errors : mapping of str to float
        Mean error of each model [mm], and what no model can beat.
    before : str
        The name of the state before compensation, among them.
    styles : mapping of str to Style, optional
        From `styles_of`.
    """
    by_name = {name: float(_positive([value], f"error of {name!r}")[0]) for name, value in errors.items()}
    if before not in by_name:
        raise InputError(f"expected the error of {before!r} among the errors, got {', '.join(by_name)}")
    first = by_name[before]
    pens = styles_of(by_name, styles)
    with figure_style():
        drawing, (axes,) = make_panel(_WIDTH_IN, 0.92 + 0.3 * len(by_name), top_in=0.46)
        _roomy_left(drawing, 0.28 + 0.075 * max(len(shorten(name, longest=22)) for name in by_name))
        low, high = min(by_name.values()) / 1.6, max(by_name.values()) * 4
        for base, (name, value) in zip(range(len(by_name) - 1, -1, -1), by_name.items(), strict=True):
            axes.plot([value], [base], pens[name].marker, color=pens[name].colour, markersize=7)
            text = f"{format_number(value)} mm"
            axes.annotate(text, xy=(value, base), xytext=(8, 0), textcoords="offset points", va="center")
        set_log_scale(axes, "x", low, high)
        axes.set_yticks(range(len(by_name) - 1, -1, -1), [shorten(name, longest=22) for name in by_name])
        axes.tick_params(axis="y", length=0)
        axes.set(ylim=(-0.6, len(by_name) - 0.4), xlabel="mean error of a coordinate [mm]")
        axes.spines["left"].set_visible(False)
        _shares(axes, first, low, high)
    told = "; ".join(
        f"{shorten(name)} {format_number(value)} mm"
        + ("" if name == before else f", {_percent(1 - value / first)} removed")
        for name, value in by_name.items()
    )
    return Figure(
        (drawing,),
        caption=f"Mean errors on a logarithmic scale, and above it the share of the first that is removed. {told}.",
        alt=f"Mean errors on a logarithmic scale: {told}.",
    )


def _shares(axes: Axes, first: float, low: float, high: float) -> None:
    top = axes.secondary_xaxis("top")
    shares = [
        s for s in (0.0, 0.5, 0.8, 0.9, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998, 0.999) if low < first * (1 - s) < high
    ]
    kept, last = [], np.inf
    for share in shares:
        place = np.log(first * (1 - share) / low) / np.log(high / low)
        if last - place > 0.085:  # else the numbers run into each other
            kept.append(share)
            last = place
    top.set_xticks([first * (1 - share) for share in kept], [_percent(share) for share in kept])
    top.minorticks_off()
    top.set_xlabel("share removed [%]", labelpad=4)
    top.spines["top"].set_color(LIMIT)


def _percent(share: float) -> str:
    return f"{format_in_text(round(100 * share, 2))} %"


def _met(places: Sequence[float], widths: FloatArray) -> str:
    if not places:
        return f"nowhere from \u00b1{format_in_text(widths.min())} to \u00b1{format_in_text(widths.max())} deg"
    return "at " + " and ".join(f"\u00b1{format_in_text(place)} deg" for place in places)


def _from_to(values: FloatArray) -> str:
    low, high = format_number(float(values.min())), format_number(float(values.max()))
    return f"{low} mm throughout" if low == high else f"from {low} to {high} mm"


def _key(axes: Axes) -> None:
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=4, handlelength=1.8, columnspacing=1.0, borderpad=0.2
    )


def _roomy_left(drawing: Drawing, left_in: float) -> None:
    drawing.subplots_adjust(left=max(left_in, LEFT_IN) / _WIDTH_IN)


def _positive(values: npt.ArrayLike, what: str) -> FloatArray:
    (array,) = nonnegative_arrays({what: values}, "numbers").values()
    if array.min() <= 0:
        raise InputError(f"expected {what} above zero, got {array.min():g} at place {array.argmin() + 1}")
    return array
