"""The least-squares line."""

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
class Line(ShapeFit):
    """A line fitted to points; its parameters are the point and the direction, six. Residuals are (n, 2).

    Attributes
    ----------
    point : (3,) array
        The mean of the points, which lies on the line [mm].
    direction : (3,) array
        Unit vector; its largest component is positive.
    """

    point: FloatArray
    direction: FloatArray


def fit_line(points: npt.ArrayLike, *, std_mm: float | None = None) -> Line:
    """Fit a line in space by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least two [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs three points.

    Raises
    ------
    InputError
        If the points are too few, in one place, or have equal spreads along two axes.

    Notes
    -----
    In closed form: the line contains the points' mean and follows the axis along which they spread most.
    """
    normal = normalise_points(points, least=2, shape="line")
    spreads, axes = principal_axes(normal)
    if spreads[0] - spreads[1] <= normal.nothing * spreads[0]:
        raise InputError(
            "expected points along a line, got points with equal spreads in two directions",
            hint="measure points farther apart along the line",
        )
    # The frame's third axis is the line's direction.
    frame = axes[:, [1, 2, 0]] * direction_sign(axes[:, 0])
    x, y, z = (normal.points @ frame).T
    one, none = np.ones(len(z)), np.zeros(len(z))
    # By the moves along the first and second axis, and the tilts about them.
    by_x, by_y = np.column_stack([-one, none, none, -z]), np.column_stack([none, -one, z, none])
    at = LinearisedResiduals(np.concatenate([x, y]), np.concatenate([by_x, by_y]))
    std = scatter_std(at, normal.scale, std_mm)
    to_parameters = np.zeros((6, 4))
    to_parameters[:3, :2] = frame[:, :2]
    to_parameters[3:, 2:] = np.column_stack([-frame[:, 1], frame[:, 0]]) / normal.scale
    return Line(
        residuals=normal.scale * np.column_stack([x, y]),
        std_mm=std,
        covariance=covariance_of(at, to_parameters, std, "line"),
        point=normal.middle,
        direction=frame[:, 2].copy(),
    )
