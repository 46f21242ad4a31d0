"""The least-squares cylinder."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.verify.orthogonal import (
    MOST_STEPS,
    Fit,
    FloatArray,
    Linearised,
    Normalised,
    covariance_of,
    gauss_newton,
    normalised,
    principal_axes,
    radial,
    scatter,
    signed,
    tilted,
    undetermined,
)

# Directions that are tried for the axis, all over half a sphere: about eight degrees apart; and how many of the best
# are followed to their minimum.
DIRECTIONS = 400
FOLLOWED = 6
# A start that has not arrived after so many steps is on its way to somewhere else.
STEPS = 30


@dataclass(frozen=True, eq=False)
class Cylinder(Fit):
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
    The sum of squares has several minima. Gauss-Newton steps start from the best of some hundred directions, each with
    the circle through the points seen along it (D. Eberly, "Least squares fitting of data by linear or quadratic
    structures", Geometric Tools, searches the half sphere likewise), and the lowest minimum is taken.
    """
    normal = normalised(points, least=6, shape="cylinder")
    spreads, axes = principal_axes(normal)
    if spreads[2] <= normal.nothing * spreads[0]:
        raise InputError("expected points all round a cylinder, got points in one plane")

    def linearised(placed: _Placed) -> Linearised:
        distance, jacobian = radial((normal.points - placed.origin) @ placed.frame, moves=(0, 1))
        return Linearised(distance - distance.mean(), jacobian)

    def moved(placed: _Placed, step: FloatArray) -> _Placed:
        frame = tilted(placed.frame, step[2], step[3])
        origin = placed.origin + placed.frame[:, :2] @ step[:2]
        return _Placed(origin - (origin @ frame[:, 2]) * frame[:, 2], frame)

    def followed(start: _Placed, most_steps: int) -> tuple[float, _Placed] | None:
        try:
            placed, at = gauss_newton(
                start,
                linearised,
                moved,
                size=lambda placed: float(np.abs(placed.origin).max()),
                shape="cylinder",
                most_steps=most_steps,
            )
        except InputError:  # this start leads nowhere; another may
            return None
        return float(at.residuals @ at.residuals), placed

    starts = _starts(normal, axes)
    found = [one for start in starts if (one := followed(start, STEPS)) is not None]
    if not found:
        found = [one for start in starts if (one := followed(start, MOST_STEPS)) is not None]
    if not found:
        raise undetermined("cylinder")
    placed = min(found, key=lambda one: one[0])[1]
    frame = placed.frame * signed(placed.frame[:, 2])
    at = linearised(_Placed(placed.origin, frame))
    std = scatter(at, normal.scale, std_mm)
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
        radius_mm=float(normal.scale * radial((normal.points - placed.origin) @ frame, moves=())[0].mean()),
    )


def _starts(normal: Normalised, axes: FloatArray) -> list[_Placed]:
    """The most promising places of the axis, with directions that differ."""
    # The points' own axes are tried too.
    frames = np.concatenate([_half_sphere(), [axes[:, [1, 2, 0]], axes[:, [2, 0, 1]], axes]])
    seen = np.einsum("nk,dkc->dnc", normal.points, frames[:, :, :2])
    # The circle through the points seen along each, by the normal equations of Kasa's fit.
    A = np.concatenate([2 * seen, np.ones((*seen.shape[:2], 1))], axis=2)
    square = (seen**2).sum(axis=2)
    gram = np.einsum("dni,dnj->dij", A, A)
    solved = np.linalg.pinv(gram, hermitian=True) @ np.einsum("dni,dn->di", A, square)[:, :, None]
    centres = solved[:, :2, 0]
    distance = np.sqrt(((seen - centres[:, None]) ** 2).sum(axis=2))
    cost = distance.var(axis=1)
    starts: list[_Placed] = []
    for best in np.argsort(cost):
        if all(abs(frames[best, :, 2] @ start.frame[:, 2]) < 0.97 for start in starts):  # 14 degrees apart
            starts.append(_Placed(frames[best, :, :2] @ centres[best], frames[best]))
        if len(starts) == FOLLOWED:
            break
    return starts


@cache
def _half_sphere() -> FloatArray:
    """Frames (d, 3, 3) whose third axes cover half a sphere evenly, on a spiral from the pole to the equator."""
    k = np.arange(DIRECTIONS) + 0.5
    height, angle = k / DIRECTIONS, k * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    third = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])
    first = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros(DIRECTIONS)])
    return np.stack([first, np.cross(third, first), third], axis=2)
