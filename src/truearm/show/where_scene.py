"""The places of a verification in space, coloured by how much of its limit each value and its uncertainty take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truearm.number_format import format_count
from truearm.pages.plotting import shorten
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.show.where_figure import where_figure
from truearm.typing import FloatArray
from truearm.verification.standards.decision import ConformityResult
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
