"""The least-squares cylinder."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.shapes.orthogonal_regression import (
    LinearisedResiduals,
    NormalisedPoints,
    ShapeFit,
    covariance_of,
    direction_sign,
    gauss_newton,
    normalise_points,
    principal_axes,
    radial_distances,
    scatter_std,
    tilt_frame,
    undetermined_error,
)

# Start directions of the axis: all over half a sphere, about eight degrees apart, of which the best are used; and about
# each principal axis of the points, about two degrees apart. Each start gets some steps; the lowest one then converges.
DIRECTIONS, FOLLOWED, NEARBY, STEPS = 400, 6, 60, 30


@dataclass(frozen=True, eq=False)
class Cylinder(ShapeFit):
    """A cylinder fitted to points; its parameters are the point, the axis' direction and the radius, seven.

    Attributes
    ----------
    point : (3,) array
        The point of the axis nearest to the mean of the points [mm].
    direction : (3,) array
        Unit vector; its largest component is positive.
    radius_mm : float
    """

    point: FloatArray
    direction: FloatArray
    radius_mm: float


class _Placed(NamedTuple):
    origin: FloatArray
    frame: FloatArray


def fit_cylinder(points: npt.ArrayLike, *, std_mm: float | None = None) -> Cylinder:
    """Fit a cylinder by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least six, not in one plane [mm]: through five points pass up to six cylinders (O. Devillers et al.,
        "Circular cylinders through four or five points in space", 2003).
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default.

    Raises
    ------
    InputError
        If the points are too few, in one place, on a line or in a plane, or determine no cylinder.

    Notes
    -----
    The sum of squares has several minima. The iteration starts from the best of some hundred directions, each with
    the circle through the points seen along it (D. Eberly, "Least squares fitting of data by linear or quadratic
    structures", Geometric Tools, searches the half sphere likewise); the lowest minimum is the result.
    """
    normal = normalise_points(points, least=6, shape="cylinder")
    spreads, axes = principal_axes(normal)
    if spreads[2] <= normal.nothing * spreads[0]:
        raise InputError(
            "expected points all round a cylinder, got points in one plane",
            hint="measure points all round the cylinder",
        )

    def linearised(placed: _Placed) -> LinearisedResiduals:
        distance, jacobian = radial_distances((normal.points - placed.origin) @ placed.frame, moves=(0, 1))
        return LinearisedResiduals(distance - distance.mean(), jacobian)

    def moved(placed: _Placed, step: FloatArray) -> _Placed:
        frame = tilt_frame(placed.frame, step[2], step[3])
        origin = placed.origin + placed.frame[:, :2] @ step[:2]
        return _Placed(origin - (origin @ frame[:, 2]) * frame[:, 2], frame)

    def size(placed: _Placed) -> float:
        return float(np.abs(placed.origin).max())

    minima: list[tuple[float, _Placed]] = []
    for start in _starts(normal, axes):
        try:
            placed, at = gauss_newton(
                start, linearised, moved, size=size, shape="cylinder", most_steps=STEPS, arrive=False
            )
        except InputError:  # another start may converge
            continue
        minima.append((float(at.residuals @ at.residuals), placed))
    if not minima:
        raise undetermined_error("cylinder")
    lowest = min(minima, key=lambda one: one[0])[1]
    placed, at = gauss_newton(lowest, linearised, moved, size=size, shape="cylinder")
    frame = placed.frame * direction_sign(placed.frame[:, 2])
    at = linearised(_Placed(placed.origin, frame))
    std = scatter_std(at, normal.scale, std_mm)
    to_parameters = np.zeros((7, 5))
    to_parameters[:3, :2] = frame[:, :2]
    to_parameters[3:6, 2:4] = np.column_stack([-frame[:, 1], frame[:, 0]]) / normal.scale
    to_parameters[6, 4] = 1.0
    return Cylinder(
        residuals=normal.scale * at.residuals,
        std_mm=std,
        covariance=covariance_of(at, to_parameters, std, "cylinder"),
        point=normal.middle + normal.scale * placed.origin,
        direction=frame[:, 2].copy(),
        radius_mm=float(normal.scale * radial_distances((normal.points - placed.origin) @ frame, moves=())[0].mean()),
    )


def _starts(normal: NormalisedPoints, axes: FloatArray) -> list[_Placed]:
    """The best start positions of the axis: along the best different directions, and along the principal axes.

    A long rod looks circular from a narrow cone only, and the longest principal axis lies in or near that cone.
    """
    own = [axes[:, [1, 2, 0]], axes[:, [2, 0, 1]], axes]
    starts = []
    for frames, count in (
        (_directions(DIRECTIONS, np.pi / 2), FOLLOWED),
        *((frame[None], 1) for frame in own),
        *((frame @ _directions(NEARBY, np.radians(8)), 1) for frame in own),
    ):
        centres, cost = _circles_along(normal, frames)
        best: list[FloatArray] = []
        for i in np.argsort(cost):
            if all(abs(frames[i, :, 2] @ other[:, 2]) < 0.97 for other in best):  # 14 degrees apart
                best.append(frames[i])
                starts.append(_Placed(frames[i, :, :2] @ centres[i], frames[i]))
            if len(best) == count:
                break
    return starts


def _circles_along(normal: NormalisedPoints, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres (d, 2) of the circles through the points seen along the third axes of frames (d, 3, 3), and their cost.

    By the normal equations of Kasa's fit; the cost (d,) is the variance of the distances.
    """
    seen = normal.points @ frames[:, :, :2]
    A = np.concatenate([2 * seen, np.ones((*seen.shape[:2], 1))], axis=2)
    square = (seen**2).sum(axis=2)[:, :, None]
    turned = A.transpose(0, 2, 1)
    centres = (np.linalg.pinv(turned @ A, hermitian=True) @ (turned @ square))[:, :2, 0]
    return centres, np.sqrt(((seen - centres[:, None]) ** 2).sum(axis=2)).var(axis=1)


@cache
def _directions(count: int, reach: float) -> FloatArray:
    """Frames (count, 3, 3) whose third axes lie evenly on a spiral from the pole to `reach` [rad] from it."""
    k = np.arange(count) + 0.5
    height, angle = 1 - (1 - np.cos(reach)) * k / count, k * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    third = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])
    first = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros(count)])
    return np.stack([first, np.cross(third, first), third], axis=2)
