"""The figure of a verification: each value as a share of its limit, with its uncertainty and the guard bands."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Rectangle

from truearm.number_format import format_number, format_percent
from truearm.pages.palette import BAD, DOUBTFUL, GOOD, INK, LIMIT, NAVY, PALE, PAPER
from truearm.pages.plotting import Figure, Style, figure_style, join_phrases, shorten
from truearm.wings.laboratory.standards.decision import ConformityResult, DecisionRule, Verdict

# Colour and shape of each verdict; the shapes differ in black and white too.
_PENS = {
    Verdict.CONFORM: Style(GOOD, "o", "-"),
    Verdict.UNDECIDED: Style(DOUBTFUL, "D", "-"),
    Verdict.NOT_CONFORM: Style(BAD, "X", "-"),
}
_WIDTH_IN, _LABELS_IN, _ROW_IN, _HEAD_IN, _FOOT_IN = 6.0, 2.15, 0.31, 0.12, 0.95
_MOST_ROWS = 60


def limits_figure(rows: Sequence[ConformityResult], *, rule: DecisionRule, decides: bool = True) -> Figure:
    """Draw values as shares of their limits, with their uncertainties and guard bands.

    Parameters
    ----------
    rows : sequence of ConformityResult
        With limits.
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}
        It determines the guard bands; with simple acceptance, values have some only where it does not apply.
    decides : bool
        Whether the numbers of the plan are confirmed; otherwise nothing conforms, and nothing is green.
    """
    shown = list(rows[:_MOST_ROWS])
    height_in = _HEAD_IN + _ROW_IN * len(shown) + _FOOT_IN
    with figure_style():
        drawing = Drawing(figsize=(_WIDTH_IN, height_in))
        axes = drawing.add_axes(
            (
                _LABELS_IN / _WIDTH_IN,
                _FOOT_IN / height_in,
                (_WIDTH_IN - _LABELS_IN - 0.15) / _WIDTH_IN,
                _ROW_IN * len(shown) / height_in,
            )
        )
        for at, row in enumerate(shown):
            _draw(axes, at, row, rule, decides)
        reach = max([1.35, *((abs(row.value) + 1.5 * row.uncertainty) / (row.limit or inf) for row in shown)])
        axes.set(xlim=(-1.05 * reach, 1.05 * reach), ylim=(len(shown) - 0.5, -0.5), xlabel="value / limit [%]")
        axes.set_yticks(range(len(shown)), [shorten(row.name, longest=34) for row in shown])
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", visible=False)
        ticks = [tick for tick in axes.get_xticks() if abs(tick) <= reach]
        axes.set_xticks(ticks, [format_number(round(100 * tick)) for tick in ticks])
        _legend(axes, shown, rule, decides)
    guard = " Hatched: the guard bands about a limit, in which a value is undecided."
    more = f" The figure shows the first {_MOST_ROWS}." if len(rows) > _MOST_ROWS else ""
    phrases = join_phrases(
        f"{row.name} {format_percent(row.value / (row.limit or inf))}, {row.verdict.describe(decides=decides)}"
        for row in shown
        if row.verdict is not None
    )
    return Figure(
        (drawing,),
        caption="Each value as a share of its limit, with its expanded uncertainty U as a bar. Shaded: between the "
        f"limits.{guard if any(_guarded(row, rule) for row in shown) else ''}{more}",
        alt=f"Values against their limits: {phrases}.",
    )


def _guarded(row: ConformityResult, rule: DecisionRule) -> bool:
    """Whether a row has guard bands."""
    zone = row.undecided_zone(rule)
    return zone is not None and zone[1] > zone[0]


def _draw(axes: Axes, at: int, row: ConformityResult, rule: DecisionRule, decides: bool) -> None:
    assert row.limit is not None
    assert row.verdict is not None
    value, u, half = row.value / row.limit, row.uncertainty / row.limit, 0.36
    axes.add_patch(Rectangle((-1, at - half), 2, 2 * half, facecolor=PALE, linewidth=0, zorder=1))
    low, high = (edge / row.limit for edge in row.undecided_zone(rule) or (row.limit, row.limit))
    for side in (-1, 1):
        if high > low:
            axes.add_patch(
                Rectangle(
                    (low if side > 0 else -high, at - half),
                    high - low,
                    2 * half,
                    facecolor=PAPER,
                    edgecolor=LIMIT,
                    hatch="//////",
                    linewidth=0,
                    zorder=2,
                )
            )
        axes.plot([side, side], [at - half, at + half], color=INK, linewidth=1.1, zorder=3)
    pen = _pen(row.verdict, decides)
    axes.plot([value - u, value + u], [at, at], color=pen.colour, linewidth=1.6, zorder=4, solid_capstyle="butt")
    axes.plot(
        [value], [at], marker=pen.marker, markersize=6.5, color=pen.colour, markeredgecolor=PAPER,
        markeredgewidth=0.5, linestyle="", zorder=5,
    )  # fmt: skip


def _pen(verdict: Verdict, decides: bool) -> Style:
    return _PENS[verdict] if decides or verdict is not Verdict.CONFORM else Style(NAVY, "o", "-")


def _legend(axes: Axes, rows: Sequence[ConformityResult], rule: DecisionRule, decides: bool) -> None:
    handles: list[Artist] = []
    for verdict in _PENS:
        if any(row.verdict is verdict for row in rows):
            pen, label = _pen(verdict, decides), verdict.describe(decides=decides)
            handles += axes.plot([], [], color=pen.colour, marker=pen.marker, markersize=5.5, label=label)
    handles.append(axes.add_patch(Rectangle((0, 0), 0, 0, facecolor=PALE, label="between the limits")))
    if any(_guarded(row, rule) for row in rows):
        guard = Rectangle((0, 0), 0, 0, facecolor=PAPER, edgecolor=LIMIT, hatch="//////", linewidth=0)
        guard.set_label("guard band")
        handles.append(axes.add_patch(guard))
    # Below the axes, a fixed distance in inches.
    down = -0.48 / (_ROW_IN * len(rows))
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.3, down), ncols=3, columnspacing=1.2)
