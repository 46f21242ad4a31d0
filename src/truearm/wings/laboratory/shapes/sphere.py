"""The least-squares sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.normalised_points import normalise_points, principal_axes
from truearm.wings.laboratory.shapes.orthogonal_regression import Distances, Element, ShapeFit, fitted, minimise
from truearm.wings.laboratory.shapes.starts import round_starts


@dataclass(frozen=True, eq=False)
class Sphere(ShapeFit):
    """A sphere fitted to points; its parameters are the centre and the radius, four.

    Attributes
    ----------
    centre : (3,) array
        [mm]
    radius_mm : float
    """

    centre: FloatArray
    radius_mm: float


def _distances(local: FloatArray, sizes: FloatArray) -> Distances:
    distance = np.sqrt((local * local).sum(axis=1))
    gradient = local / np.where(distance > 0, distance, 1.0)[:, None]
    return Distances(distance - sizes[0], gradient, np.full((len(local), 1), -1.0))


SPHERE = Element("sphere", _distances, (0, 1, 2), (True,))


def fit_sphere(points: npt.ArrayLike, *, std_mm: float | None = None) -> Sphere:
    """Fit a sphere by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least four, not in one plane [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs five points.

    Raises
    ------
    InputError
        If the points are too few, in one place, on a line or in a plane, or determine no sphere: their
        curvature is within their scatter.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.shapes.fit_sphere([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]]).radius_mm
    1.0
    """
    normal = normalise_points(points, least=4, shape="sphere")
    spreads, _ = principal_axes(normal)
    if spreads[2] <= normal.nothing:
        raise InputError(
            "expected points all over a sphere, got points in one plane, which determine no radius",
            hint="add a point at the pole",
        )
    place = minimise(SPHERE, normal, round_starts(normal.points, np.eye(3)), spreads[2:])
    fit = fitted(SPHERE, normal, place, std_mm)
    residuals, std, covariance = fit.scatter
    own = np.ix_([0, 1, 2, 6], [0, 1, 2, 6])
    return Sphere(residuals, std, covariance[own], centre=fit.origin, radius_mm=float(fit.sizes[0]))
