"""The least-squares sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.shapes.orthogonal_regression import (
    LinearisedResiduals,
    ShapeFit,
    circle_start,
    covariance_of,
    gauss_newton,
    normalise_points,
    scatter_std,
)


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

    Notes
    -----
    For any centre the best radius is the mean distance from it, so that only the centre is iterated.
    """
    normal = normalise_points(points, least=4, shape="sphere")
    if np.linalg.svd(normal.points, compute_uv=False)[2] <= normal.nothing * np.sqrt(len(normal.points)):
        raise InputError(
            "expected points all over a sphere, got points in one plane, which determine no radius",
            hint="add a point at the pole",
        )

    def linearised(centre: FloatArray) -> LinearisedResiduals:
        away = normal.points - centre
        distance = np.sqrt((away * away).sum(axis=1))
        jacobian = np.full((len(away), 4), -1.0)
        np.divide(away, -np.where(distance > 0, distance, 1.0)[:, None], out=jacobian[:, :3])
        return LinearisedResiduals(distance - distance.mean(), jacobian)

    centre, at = gauss_newton(
        circle_start(normal.points),
        linearised,
        lambda centre, step: centre + step[:3],
        size=lambda centre: float(np.abs(centre).max()),
        shape="sphere",
    )
    radius = float(np.sqrt(((normal.points - centre) ** 2).sum(axis=1)).mean())
    std = scatter_std(at, normal.scale, std_mm)
    return Sphere(
        residuals=normal.scale * at.residuals,
        std_mm=std,
        covariance=covariance_of(at, np.eye(4), std, "sphere"),
        centre=normal.middle + normal.scale * centre,
        radius_mm=normal.scale * radius,
    )
