"""The least-squares circle in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.normalised_points import frame_across, normalise_points
from truearm.wings.laboratory.shapes.orthogonal_regression import (
    Distances,
    Element,
    ShapeFit,
    fitted,
    minimise,
    radial_distances,
    towards_positive,
)
from truearm.wings.laboratory.shapes.starts import round_starts


@dataclass(frozen=True, eq=False)
class Circle(ShapeFit):
    """A circle fitted to points; its parameters are the centre, the normal of its plane and the radius, seven.

    Residuals are (n, 2): in the plane, positive outside, and along the normal.

    Attributes
    ----------
    centre : (3,) array
        [mm]
    normal : (3,) array
        Unit vector; its largest component is positive.
    radius_mm : float
    """

    centre: FloatArray
    normal: FloatArray
    radius_mm: float


def _distances(local: FloatArray, sizes: FloatArray) -> Distances:
    """In the plane, then along its normal."""
    distance, gradient = radial_distances(local)
    by_size = np.repeat([[-1.0], [0.0]], len(local), axis=0)
    along = np.broadcast_to([0.0, 0.0, 1.0], local.shape)
    return Distances(np.concatenate([distance - sizes[0], local[:, 2]]), np.concatenate([gradient, along]), by_size)


CIRCLE = Element("circle", _distances, (0, 1, 2, 3, 4), (True,))


def fit_circle(points: npt.ArrayLike, *, std_mm: float | None = None) -> Circle:
    """Fit a circle in space by least squares of the points' distances from it.

    The distance combines that within and across the plane. A plane fitted first, and a circle in it, would differ where
    points scatter far across the plane.

    Parameters
    ----------
    points : (n, 3) array
        At least three, not on a line [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs four points.

    Raises
    ------
    InputError
        If the points are too few, in one place or on a line, or determine no circle: their
        curvature is within their scatter.
    """
    normal = normalise_points(points, least=3, shape="circle")
    spreads, axes = frame_across(normal, "all round a circle")
    place = minimise(CIRCLE, normal, round_starts(normal.points @ axes[:, :2], axes), spreads[1:])
    fit = fitted(CIRCLE, normal, towards_positive(place), std_mm)
    return Circle(*fit.scatter, centre=fit.origin, normal=fit.axis, radius_mm=float(fit.sizes[0]))
