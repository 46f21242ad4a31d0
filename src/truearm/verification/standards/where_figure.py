"""The figure of where an arm was tested: the measured places in the volume, those that do not conform in red."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing

from truearm.pages.number_format import format_count
from truearm.pages.palette import BAD, DOUBTFUL, INK, LIMIT, PAPER
from truearm.pages.plotting import Figure, figure_style, join_phrases, shorten
from truearm.typing import FloatArray
from truearm.verification.standards.decision import ConformityResult, Verdict
from truearm.verification.standards.measured_points import PointGroup

# The test of each symbol of a test value.
_TESTS = {
    "P_Size.Sph.1x25": "probing",
    "P_Form.Sph.1x25": "probing",
    "L_Dia.5x5": "articulation",
    "E_Uni": "uni",
    "E_Bi": "bi",
    "EffectiveDiameter": "effective_diameter",
    "SPAT.Max": "single_point",
    "SPAT.2s": "single_point",
    "Volumetric.Max": "volumetric",
}
_VIEWS = (("from above", 0, 1), ("from the front", 0, 2))
_WIDTH_IN, _HEIGHT_IN = 4.6, 3.2
_ACROSS_IN, _UP_IN = 3.74, 2.44  # of the axes
_PENS = {Verdict.NOT_CONFORM: (BAD, "X"), Verdict.UNDECIDED: (DOUBTFUL, "D")}


@dataclass(frozen=True, eq=False)
class _Place:
    """An artefact where it was measured: a point, or the two ends of a length [mm]."""

    ends: FloatArray
    verdict: Verdict | None
    name: str


def where_figure(tests: Mapping[str, Sequence[PointGroup]], rows: Sequence[ConformityResult]) -> Figure | None:
    """Draw where artefacts were measured, and at which places a value is beyond its limit or undecided.

    Parameters
    ----------
    tests : mapping of str to sequence of PointGroup
        The measured groups of every test.
    rows : sequence of ConformityResult
        With limits; the place of a row is the one that decides it.

    Returns
    -------
    Figure or None
        None where every value conforms: no place deserves attention.
    """
    decisive = [row for row in rows if row.verdict in _PENS]
    places = [place for test, groups in tests.items() for place in _places(test, groups, decisive)]
    marked = [place for place in places if place.verdict is not None]
    if not marked:
        return None
    with figure_style():
        panels = tuple(_panel(places, view) for view in _VIEWS)
    names = join_phrases(dict.fromkeys(place.name for place in marked))
    return Figure(
        panels,
        caption="Where the arm was tested, in the frame of the points: dots are balls and seats, lines are lengths. "
        f"Red with a cross: not conform; amber with a diamond: undecided; grey: the others. {names}.",
        alt=f"{format_count(len(places), 'measured place')} from above and from the front; marked: {names}.",
        columns=2,
    )


def _places(test: str, groups: Sequence[PointGroup], rows: Sequence[ConformityResult]) -> list[_Place]:
    """Each artefact at each of its places, with the verdict of the values that it decides."""
    ends: dict[tuple[str, str, str], dict[str, FloatArray]] = {}
    deciding: dict[tuple[str, str, str], ConformityResult] = {}
    for group in groups:
        # Repeats are at one place; the lengths of a bar at one position are several.
        key = (group.artefact, group.keys.get("length", ""), group.keys.get("position", ""))
        ends.setdefault(key, {})[group.keys.get("end", "A")] = group.points.mean(axis=0)
        for one in rows:
            if _decides(one, test, group) and (key not in deciding or one.verdict is Verdict.NOT_CONFORM):
                deciding[key] = one
    places = []
    for key, points in ends.items():
        row = deciding.get(key)
        verdict, name = (None, "") if row is None else (row.verdict, row.name)
        places.append(_Place(np.stack(list(points.values())), verdict, name))
    return places


def _decides(row: ConformityResult, test: str, group: PointGroup) -> bool:
    """Whether the value of a row comes from the place of a group."""
    symbol, _, length = row.label.partition(", ")
    if _TESTS.get(symbol) != test or ("length" in group.keys and length and length != group.keys["length"]):
        return False
    position = group.keys.get("position")
    return position is None or f"position {position}" in row.where.split(", ")


def _panel(places: Sequence[_Place], view: tuple[str, int, int]) -> Drawing:
    title, across, up = view
    drawing = Drawing(figsize=(_WIDTH_IN, _HEIGHT_IN))
    FigureCanvasAgg(drawing)
    axes = drawing.add_axes((0.72 / _WIDTH_IN, 0.46 / _HEIGHT_IN, _ACROSS_IN / _WIDTH_IN, _UP_IN / _HEIGHT_IN))
    axes.plot(0, 0, marker="+", markersize=8, markeredgewidth=1.2, color=INK, zorder=5)
    seen = np.concatenate([*(place.ends[:, [across, up]] for place in places), np.zeros((1, 2))])
    middle, spans = (seen.max(axis=0) + seen.min(axis=0)) / 2, np.ptp(seen, axis=0)
    scale = 1.12 * max(float(spans[0]) / _ACROSS_IN, float(spans[1]) / _UP_IN, 1.0)  # [mm per inch], the same for both
    half = scale * np.array([_ACROSS_IN, _UP_IN]) / 2
    axes.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]", title=title)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.locator_params(nbins=6)
    for place in sorted(places, key=lambda one: one.verdict is not None):
        _draw(axes, place.ends[:, [across, up]], place, left_half=middle[0])
    return drawing


def _draw(axes: Axes, ends: FloatArray, place: _Place, *, left_half: float) -> None:
    """Draw a place; its name is on the side that has more room."""
    marked = place.verdict is not None
    colour, marker = (LIMIT, "o") if place.verdict is None else _PENS[place.verdict]
    if len(ends) > 1:
        axes.plot(*ends.T, color=colour, linewidth=2.6 if marked else 1.0, zorder=4 if marked else 2)
    at = ends.mean(axis=0)
    if marked or len(ends) == 1:
        axes.plot(*at, marker, color=colour, markersize=9 if marked else 6, markeredgecolor=PAPER, zorder=5)
    if marked:
        side = 1 if at[0] < left_half else -1
        axes.annotate(
            shorten(place.name.partition(", position")[0], longest=20), at, xytext=(7 * side, 6), color=INK,
            textcoords="offset points", ha="left" if side > 0 else "right", weight="bold", zorder=6,
        )  # fmt: skip
