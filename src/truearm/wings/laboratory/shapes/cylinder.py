"""The least-squares cylinder."""

from __future__ import annotations

from dataclasses import dataclass

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
)
from truearm.wings.laboratory.shapes.starts import best_places, centres_across


@dataclass(frozen=True, eq=False)
class Cylinder(ShapeFit):
    """A cylinder fitted to points; its parameters are the point, the axis and the radius, seven.

    Attributes
    ----------
    point : (3,) array
        Of the axis, nearest to the mean of the points [mm].
    axis : (3,) array
        Unit vector; its largest component is positive.
    radius_mm : float
    """

    point: FloatArray
    axis: FloatArray
    radius_mm: float


def _distances(local: FloatArray, sizes: FloatArray) -> Distances:
    distance, gradient = radial_distances(local)
    return Distances(distance - sizes[0], gradient, np.full((len(local), 1), -1.0))


CYLINDER = Element("cylinder", _distances, (0, 1, 3, 4), (True,))


def fit_cylinder(points: npt.ArrayLike, *, std_mm: float | None = None) -> Cylinder:
    """Fit a cylinder by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least five, at two heights or more [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs six points.

    Raises
    ------
    InputError
        If the points are too few or determine no cylinder, such as points of one section, of a plane or of a line.

    Notes
    -----
    The sum of squares has a minimum for each of several axes; the fit begins with axes to all sides.

    Examples
    --------
    >>> import numpy as np, truearm as ta
    >>> turn = np.arange(8)
    >>> bore = np.column_stack([6 * np.cos(turn), 6 * np.sin(turn), 3 * (turn % 3)])
    >>> round(ta.shapes.fit_cylinder(bore).radius_mm, 9)
    6.0
    """
    normal = normalise_points(points, least=5, shape="cylinder")
    spreads, axes = principal_axes(normal)
    place = minimise(CYLINDER, normal, best_places(normal, axes, _judged), spreads[2:])
    axis = place.frame[:, 2]
    place = place._replace(origin=place.origin - (place.origin @ axis) * axis)
    fit = fitted(CYLINDER, normal, towards_positive(place), std_mm)
    return Cylinder(*fit.scatter, point=fit.origin, axis=fit.axis, radius_mm=float(fit.sizes[0]))


def _judged(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    centres, distances = centres_across(local)
    return distances.var(axis=1), np.column_stack([centres, np.zeros(len(local)), distances.mean(axis=1)])
