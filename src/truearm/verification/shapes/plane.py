"""The least-squares plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.shapes.orthogonal_regression import (
    LinearisedResiduals,
    ShapeFit,
    covariance_of,
    direction_sign,
    normalise_points,
    principal_axes,
    scatter_std,
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
    spreads, axes = principal_axes(normal)
    if spreads[1] - spreads[2] <= normal.nothing * spreads[0]:
        what = "on a line" if spreads[1] <= normal.nothing * spreads[0] else "with equal spreads in two directions"
        raise InputError(
            f"expected points all over a plane, got points {what}: they determine no normal",
            hint="measure points all over the plane",
        )
    frame = axes * direction_sign(axes[:, 2])
    x, y, z = (normal.points @ frame).T
    # By the move along the normal, and the tilts about the first and second axis.
    at = LinearisedResiduals(z, np.column_stack([-np.ones(len(z)), -y, x]))
    std = scatter_std(at, normal.scale, std_mm)
    to_parameters = np.zeros((6, 3))
    to_parameters[:3, 0] = frame[:, 2]
    to_parameters[3:, 1:] = np.column_stack([-frame[:, 1], frame[:, 0]]) / normal.scale
    return Plane(
        residuals=normal.scale * z,
        std_mm=std,
        covariance=covariance_of(at, to_parameters, std, "plane"),
        point=normal.middle,
        normal=frame[:, 2].copy(),
    )
