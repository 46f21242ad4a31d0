"""The least-squares plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.normalised_points import frame_across, normalise_points
from truearm.wings.laboratory.shapes.orthogonal_regression import (
    Distances,
    Element,
    Place,
    ShapeFit,
    fitted,
    towards_positive,
)


@dataclass(frozen=True, eq=False)
class Plane(ShapeFit):
    """A plane fitted to points; its parameters are the point and the normal, six.

    Attributes
    ----------
    point : (3,) array
        The mean of the points, which lies in the plane [mm].
    normal : (3,) array
        Unit vector; its largest component is positive.
    """

    point: FloatArray
    normal: FloatArray


def _distances(local: FloatArray, _: FloatArray) -> Distances:
    return Distances(local[:, 2], np.broadcast_to([0.0, 0.0, 1.0], local.shape), np.empty((len(local), 0)))


PLANE = Element("plane", _distances, (2, 3, 4))


def fit_plane(points: npt.ArrayLike, *, std_mm: float | None = None) -> Plane:
    """Fit a plane by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least three, not on a line [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs four points.

    Raises
    ------
    InputError
        If the points are too few, on a line, or spread as far across every plane as along it.

    Notes
    -----
    In closed form: the plane contains the points' mean and is normal to the axis along which they spread least.
    """
    normal = normalise_points(points, least=3, shape="plane")
    _, axes = frame_across(normal, "all over a plane")
    fit = fitted(PLANE, normal, towards_positive(Place(np.zeros(3), axes, np.empty(0))), std_mm)
    return Plane(*fit.scatter, point=fit.origin, normal=fit.axis)
