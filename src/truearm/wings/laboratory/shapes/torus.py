"""The least-squares torus."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.normalised_points import normalise_points, principal_axes
from truearm.wings.laboratory.shapes.orthogonal_regression import (
    Distances,
    Element,
    ShapeFit,
    fitted,
    minimise,
    radial_distances,
    towards_positive,
    undetermined_error,
)
from truearm.wings.laboratory.shapes.starts import RADII, around, best_places, centres_across


@dataclass(frozen=True, eq=False)
class Torus(ShapeFit):
    """A torus fitted to points; its parameters are the centre, the axis and both radii, eight.

    Attributes
    ----------
    centre : (3,) array
        [mm]
    axis : (3,) array
        Unit vector; its largest component is positive.
    major_radius_mm : float
        Of the circle in the middle of the tube.
    minor_radius_mm : float
        Of the tube.
    """

    centre: FloatArray
    axis: FloatArray
    major_radius_mm: float
    minor_radius_mm: float


def _distances(local: FloatArray, sizes: FloatArray) -> Distances:
    """Sizes: the radius of the ring and that of the tube."""
    distance, gradient = radial_distances(local)
    away, z = distance - sizes[0], local[:, 2]
    from_ring = np.sqrt(away * away + z * z)
    safe = np.where(from_ring > 0, from_ring, 1.0)
    outwards = gradient * (away / safe)[:, None]
    outwards[:, 2] = z / safe
    return Distances(from_ring - sizes[1], outwards, np.column_stack([-away / safe, np.full(len(z), -1.0)]))


TORUS = Element("torus", _distances, (0, 1, 2, 3, 4), (True, True))


def fit_torus(points: npt.ArrayLike, *, std_mm: float | None = None) -> Torus:
    """Fit a torus by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least seven, around the ring and around the tube [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs eight points.

    Raises
    ------
    InputError
        If the points are too few or determine no torus.

    Examples
    --------
    >>> import numpy as np, truearm as ta
    >>> ring, tube = np.arange(12), 1.7 * np.arange(12)
    >>> across = 30 + 5 * np.cos(tube)
    >>> points = np.column_stack([across * np.cos(ring), across * np.sin(ring), 5 * np.sin(tube)])
    >>> round(ta.shapes.fit_torus(points).minor_radius_mm, 9)
    5.0
    """
    normal = normalise_points(points, least=7, shape="torus")
    spreads, axes = principal_axes(normal)
    starts = chain.from_iterable(best_places(normal, axes, judge) for judge in (_judged, _judged_as_bend))
    place = minimise(TORUS, normal, starts, spreads[2:])
    if place.sizes.min() <= 0:
        raise undetermined_error("torus")
    fit = fitted(TORUS, normal, towards_positive(place), std_mm)
    ring, tube = fit.sizes.tolist()
    return Torus(*fit.scatter, centre=fit.origin, axis=fit.axis, major_radius_mm=ring, minor_radius_mm=tube)


def _judged(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    centres, distances = centres_across(local)
    section = np.stack([distances, local[:, :, 2]], axis=2)
    # A section of the tube, in which distance from the axis and height are the coordinates.
    rings, from_ring = centres_across(section)
    parameters = np.column_stack([centres, rings[:, 1], rings[:, 0], from_ring.mean(axis=1)])
    return from_ring.var(axis=1), parameters


def _judged_as_bend(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A short bend of a pipe: rings about centres on all sides, at the height of the points."""
    centres = np.multiply.outer(RADII, around(16)).reshape(-1, 2)
    distances = np.sqrt(((local[:, None, :, :2] - centres[:, None]) ** 2).sum(axis=3))
    rings = distances.mean(axis=2)
    from_ring = np.hypot(distances - rings[:, :, None], local[:, None, :, 2])
    squares = from_ring.var(axis=2)
    rows, best = np.arange(len(local)), squares.argmin(axis=1)
    sizes = rings[rows, best], from_ring.mean(axis=2)[rows, best]
    return squares[rows, best], np.column_stack([centres[best], np.zeros(len(local)), *sizes])
