"""The least-squares circle in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.shapes.orthogonal_regression import (
    LinearisedResiduals,
    ShapeFit,
    circle_start,
    covariance_of,
    direction_sign,
    gauss_newton,
    normalise_points,
    principal_axes,
    radial_distances,
    scatter_std,
    tilt_frame,
)


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


class _Placed(NamedTuple):
    centre: FloatArray
    frame: FloatArray


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
    spreads, axes = principal_axes(normal)
    if spreads[1] - spreads[2] <= normal.nothing * spreads[0]:
        what = "on a line" if spreads[1] <= normal.nothing * spreads[0] else "with equal spreads in two directions"
        raise InputError(
            f"expected points all round a circle, got points {what}: they determine no plane",
            hint="measure more points all round the circle",
        )
    frame = axes * direction_sign(axes[:, 2])

    def linearised(placed: _Placed) -> LinearisedResiduals:
        local = (normal.points - placed.centre) @ placed.frame
        x, y, z = local.T
        distance, by_radial = radial_distances(local)
        none = np.zeros(len(z))
        by_z = np.column_stack([none, none, none - 1, -y, x, none])
        return LinearisedResiduals(np.concatenate([distance - distance.mean(), z]), np.concatenate([by_radial, by_z]))

    placed, at = gauss_newton(
        _Placed(frame[:, :2] @ circle_start(normal.points @ frame[:, :2]), frame),
        linearised,
        lambda placed, step: _Placed(
            placed.centre + placed.frame @ step[:3], tilt_frame(placed.frame, step[3], step[4])
        ),
        size=lambda placed: float(np.abs(placed.centre).max()),
        shape="circle",
    )
    frame = placed.frame * direction_sign(placed.frame[:, 2])
    radius = radial_distances((normal.points - placed.centre) @ frame)[0].mean()
    at = linearised(_Placed(placed.centre, frame))
    std = scatter_std(at, normal.scale, std_mm)
    to_parameters = np.zeros((7, 6))
    to_parameters[:3, :3] = frame
    to_parameters[3:6, 3:5] = np.column_stack([-frame[:, 1], frame[:, 0]]) / normal.scale
    to_parameters[6, 5] = 1.0
    return Circle(
        residuals=normal.scale * at.residuals.reshape(2, -1).T,
        std_mm=std,
        covariance=covariance_of(at, to_parameters, std, "circle"),
        centre=normal.middle + normal.scale * placed.centre,
        normal=frame[:, 2].copy(),
        radius_mm=float(normal.scale * radius),
    )
