"""The places of a verification in space, coloured by how much of its limit each value and its uncertainty take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.number_format import format_count
from truearm.pages.palette import BAD, DOUBTFUL, INK, LIMIT, PAPER
from truearm.pages.plotting import Figure, figure_style, join_phrases, make_view, shorten
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.typing import FloatArray
from truearm.verification.standards.decision import ConformityResult, Verdict
from truearm.verification.standards.measured_places import MeasuredPlace, measured_places, share_of_limit
from truearm.verification.standards.measured_points import PointGroup

_CROSS_OF_EXTENT = 0.04  # arms of the cross at the origin


def where_scene(tests: Mapping[str, Sequence[PointGroup]], rows: Sequence[ConformityResult]) -> Scene:
    """The measured balls, seats and lengths in the frame of the points.

    Each has the colour of its value that is nearest to the limit. The nearest of all, and those that decide against
    conformity, are named.

    Parameters
    ----------
    tests : mapping of str to sequence of PointGroup
        The measured groups of every test.
    rows : sequence of ConformityResult
        With limits.
    """
    places = measured_places(tests, rows)
    judged = [place for place in places if place.values]
    others = [place.ends for place in places if not place.values and len(place.ends) > 1]
    what = f"{format_count(len(places), 'measured place')} in space"
    return Scene(
        f"{what}, coloured by share of the limit" if judged else what,
        "mm",
        where_figure(places),
        cloud=_cloud(judged) if judged else None,
        lines=[*_origin(places), *others],
    )


def _cloud(places: Sequence[MeasuredPlace]) -> PointCloud:
    nearest = [place.values[0] for place in places]
    shares = [100 * share_of_limit(one) for one in nearest]
    named = {int(np.argmax(shares)), *(i for i, place in enumerate(places) if place.decisive is not None)}
    return PointCloud(
        np.array([place.middle for place in places]),
        [f"{place.name}: {one.label}" for place, one in zip(places, nearest, strict=True)],
        [
            # A value at its limit has the darkest colour, so that a good arm looks good.
            PointColumn("share of the limit", "%", shares, top=100.0),
            PointColumn("value without its sign", "mm", [abs(one.value) for one in nearest]),
        ],
        axes=[
            PointColumn("from the origin", "mm", [float(np.linalg.norm(place.middle)) for place in places]),
            PointColumn("height", "mm", [float(place.middle[2]) for place in places]),
        ],
        notes=[
            PointColumn("value", "mm", [one.value for one in nearest]),
            PointColumn("U", "mm", [one.uncertainty for one in nearest]),
            PointColumn("limit", "mm", [one.limit or 0.0 for one in nearest]),
        ],
        noun="place",
        spans={i: place.ends for i, place in enumerate(places) if len(place.ends) == 2},
        marked={i: shorten((places[i].decisive or nearest[i]).label, longest=20) for i in sorted(named)},
    )


def _origin(places: Sequence[MeasuredPlace]) -> list[FloatArray]:
    """A cross at the origin of the frame: the arm stands there, if the points are in its frame."""
    seen = np.concatenate([*(place.ends for place in places), np.zeros((1, 3))])
    arm = _CROSS_OF_EXTENT * max(float(np.ptp(seen, axis=0).max()), 1.0)
    return [np.stack([-arm * axis, arm * axis]) for axis in np.eye(3)]


# The figure on paper -------------------------------------------------------------------------------------------------

_VIEWS = (("from above", 0, 1), ("from the front", 0, 2))
# Names of marked places [points]: width of a bold letter, height of a line, and distances above the place to try.
_LETTER_PT, _LINE_PT = 6.2, 11.0
_LABEL_UPS = [6 + sign * step * 11 for step in range(8) for sign in ((1,) if step == 0 else (1, -1))]
_PENS = {Verdict.NOT_CONFORM: (BAD, "X"), Verdict.UNDECIDED: (DOUBTFUL, "D")}


def where_figure(places: Sequence[MeasuredPlace]) -> Figure:
    """Draw where artefacts were measured, and at which places a value is beyond its limit or undecided.

    Parameters
    ----------
    places : sequence of MeasuredPlace
        At least one.
    """
    marked = [place for place in places if place.decisive is not None]
    with figure_style():
        panels = tuple(_panel(places, view) for view in _VIEWS)
    names = join_phrases(dict.fromkeys(place.decisive.name for place in marked if place.decisive is not None))
    verdicts = (
        f"On paper red with a cross: beyond the limit; amber with a diamond: undecided; grey: the others. {names}."
    )
    return Figure(
        panels,
        caption="Where the arm was tested, in the frame of the points: dots are balls and seats, lines are lengths. "
        "On a screen the colour shows how much of its limit a value takes with its uncertainty, of several values the "
        f"nearest to its limit; a ring marks the nearest of all and what is named here. "
        f"{verdicts if marked else 'Every value of a single place is within its limit.'}",
        alt=f"{format_count(len(places), 'measured place')} from above and from the front"
        f"{f'; marked: {names}' if marked else ''}.",
        columns=2,
    )


def _panel(places: Sequence[MeasuredPlace], view: tuple[str, int, int]) -> Drawing:
    title, *both = view
    seen = np.concatenate([*(place.ends[:, both] for place in places), np.zeros((1, 2))])
    labels = (f"{'xyz'[axis]} [mm]" for axis in both)
    drawing, axes = make_view((4.6, 3.2), seen.min(axis=0), seen.max(axis=0), labels=labels, title=title)
    axes.locator_params(nbins=6)
    for place in sorted(places, key=lambda one: one.verdict is not None):
        _draw(axes, place.ends[:, both], place)
    mm_per_pt = np.ptp(axes.get_xlim()) / (72 * 4.6 * axes.get_position().width)
    _label(axes, [place for place in places if place.decisive is not None], both, mm_per_pt=float(mm_per_pt))
    return drawing


def _draw(axes: Axes, ends: FloatArray, place: MeasuredPlace) -> None:
    """Draw a place."""
    marked = place.verdict is not None
    colour, marker = (LIMIT, "o") if place.verdict is None else _PENS[place.verdict]
    if len(ends) > 1:
        axes.plot(*ends.T, color=colour, linewidth=2.6 if marked else 1.0, zorder=4 if marked else 2)
    at = ends.mean(axis=0)
    if marked or len(ends) == 1:
        axes.plot(*at, marker, color=colour, markersize=9 if marked else 6, markeredgecolor=PAPER, zorder=5)


def _label(axes: Axes, places: Sequence[MeasuredPlace], view: list[int], *, mm_per_pt: float) -> None:
    """Name places, each on the side that has more room, above or below the names that are there already."""
    left_half, taken = sum(axes.get_xlim()) / 2, list[FloatArray]()
    for place in places:
        assert place.decisive is not None
        at = place.ends[:, view].mean(axis=0)
        name = shorten(place.decisive.name.partition(", position")[0], longest=20)
        side = 1 if at[0] < left_half else -1
        for up in _LABEL_UPS:
            start = at / mm_per_pt + [7 * side, up]
            box = np.array([min(start[0], start[0] + side * _LETTER_PT * len(name)), start[1]])
            box = np.concatenate([box, box + [_LETTER_PT * len(name), _LINE_PT]])
            if not any((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all() for other in taken):
                break
        taken.append(box)
        axes.annotate(
            name, at, xytext=(7 * side, up), color=INK, textcoords="offset points",
            ha="left" if side > 0 else "right", weight="bold", zorder=6,
            arrowprops=None if up == _LABEL_UPS[0] else {"arrowstyle": "-", "color": LIMIT, "linewidth": 0.7},
        )  # fmt: skip
