"""The least-squares cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.normalised_points import normalise_points, principal_axes
from truearm.wings.laboratory.shapes.orthogonal_regression import (
    FARTHEST,
    Distances,
    Element,
    Fitted,
    Place,
    ShapeFit,
    fitted,
    minimise,
    radial_distances,
    undetermined_error,
)
from truearm.wings.laboratory.shapes.starts import best_places, centres_across, linear_solutions


@dataclass(frozen=True, eq=False)
class Cone(ShapeFit):
    """A cone fitted to points; its parameters are the apex, the axis and the half angle, seven.

    Attributes
    ----------
    apex : (3,) array
        [mm]
    axis : (3,) array
        Unit vector from the apex into the cone.
    half_angle_rad : float
        Between axis and surface: half of the angle that a drawing states.
    """

    apex: FloatArray
    axis: FloatArray
    half_angle_rad: float


def _distances(local: FloatArray, sizes: FloatArray) -> Distances:
    """Sizes: the radius in the plane of the origin, and the angle by which it grows along the axis."""
    distance, gradient = radial_distances(local)
    (radius, angle), z = sizes, local[:, 2]
    cos, sin = np.cos(angle), np.sin(angle)
    away = distance - radius
    by_sizes = np.column_stack([np.full(len(z), -cos), -away * sin - z * cos])
    return Distances(away * cos - z * sin, cos * gradient - [0.0, 0.0, sin], by_sizes)


CONE = Element("cone", _distances, (0, 1, 3, 4), (True, False))


def fit_cone(points: npt.ArrayLike, *, std_mm: float | None = None) -> Cone:
    """Fit a cone by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least six, at several heights of one half of the cone [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs seven points.

    Raises
    ------
    InputError
        If the points are too few or determine no cone, such as those of a cylinder or of a plane.

    Examples
    --------
    >>> import numpy as np, truearm as ta
    >>> turn, height = np.arange(9), 2.0 + np.arange(9) % 3
    >>> seat = np.column_stack([height * np.cos(turn), height * np.sin(turn), height])
    >>> round(np.degrees(ta.shapes.fit_cone(seat).half_angle_rad), 9)
    45.0
    """
    normal = normalise_points(points, least=6, shape="cone")
    spreads, axes = principal_axes(normal)
    place = minimise(CONE, normal, best_places(normal, axes, _judged), spreads[2:])
    axis, (radius, angle) = place.frame[:, 2], place.sizes
    shift = -float(place.origin @ axis)
    side = 1.0 if angle > 0 else -1.0
    sizes = np.array([radius + shift * np.tan(angle), side * angle])
    if not 0 < abs(sizes[0]) < FARTHEST * abs(np.tan(angle)):
        raise undetermined_error("cone")
    return _with_apex(fitted(CONE, normal, Place(place.origin + shift * axis, side * place.frame, sizes), std_mm))


def _with_apex(fit: Fitted) -> Cone:
    """The cone with its apex in place of the point and the radius there."""
    radius, angle = fit.sizes
    height = -radius / np.tan(angle)  # of the apex above the point
    T = np.zeros((7, 8))
    T[:3, :3], T[:3, 3:6] = np.eye(3), height * np.eye(3)
    T[:3, 6], T[:3, 7] = -fit.axis / np.tan(angle), fit.axis * radius / np.sin(angle) ** 2
    T[3:6, 3:6], T[6, 7] = np.eye(3), 1.0
    residuals, std, covariance = fit.scatter
    apex = fit.origin + height * fit.axis
    return Cone(residuals, std, T @ covariance @ T.T, apex=apex, axis=fit.axis, half_angle_rad=float(angle))


def _judged(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    z = local[:, :, 2]
    one = np.ones_like(z)
    # The squared radius is linear in the place of the axis, and quadratic in the height.
    centres, distances = centres_across(local, np.stack([z**2, z], axis=2))
    radius, slope = linear_solutions(np.stack([one, z], axis=2), distances).T
    angle = np.arctan(slope)
    rest = (distances - radius[:, None] - slope[:, None] * z) * np.cos(angle)[:, None]
    return (rest**2).mean(axis=1), np.column_stack([centres, 0 * angle, radius, angle])
