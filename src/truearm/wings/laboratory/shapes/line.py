"""The least-squares line in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.normalised_points import normalise_points, principal_axes
from truearm.wings.laboratory.shapes.orthogonal_regression import (
    Distances,
    Element,
    Place,
    ShapeFit,
    fitted,
    towards_positive,
)


@dataclass(frozen=True, eq=False)
class Line(ShapeFit):
    """A line fitted to points; its parameters are the point and the direction, six.

    Residuals are (n, 2): across the line.

    Attributes
    ----------
    point : (3,) array
        The mean of the points, which lies on the line [mm].
    direction : (3,) array
        Unit vector; its largest component is positive.
    """

    point: FloatArray
    direction: FloatArray


def _distances(local: FloatArray, _: FloatArray) -> Distances:
    across = np.repeat(np.eye(3)[:2], len(local), axis=0)
    return Distances(local[:, :2].T.ravel(), across, np.empty((2 * len(local), 0)))


LINE = Element("line", _distances, (0, 1, 3, 4))


def fit_line(points: npt.ArrayLike, *, std_mm: float | None = None) -> Line:
    """Fit a line by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least two [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs three points.

    Raises
    ------
    InputError
        If the points are too few, in one place, or spread as far across every line as along it.

    Notes
    -----
    In closed form: the line goes through the points' mean along the axis of their largest spread.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.shapes.fit_line([[0, 0, 1], [2, 0, 1], [5, 0, 1]]).direction.tolist()
    [1.0, 0.0, 0.0]
    """
    normal = normalise_points(points, least=2, shape="line")
    spreads, axes = principal_axes(normal)
    if spreads[0] - spreads[1] <= normal.nothing * spreads[0]:
        raise InputError(
            "expected points along a line, got points with equal spreads in two directions: they determine none",
            hint="measure points all along the line",
        )
    place = towards_positive(Place(np.zeros(3), axes[:, [1, 2, 0]], np.empty(0)))
    fit = fitted(LINE, normal, place, std_mm)
    return Line(*fit.scatter, point=fit.origin, direction=fit.axis)
