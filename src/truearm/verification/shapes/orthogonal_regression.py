"""Orthogonal distance regression: the common part of the least-squares ("Gauss") shapes.

Residuals are distances [mm] from the nearest point of the shape; the sum of their squares is minimised: A. B. Forbes,
"Least-squares best-fit geometric elements", NPL Report DITC 140/89, National Physical Laboratory 1989; C. M. Shakarji,
"Least-squares fitting algorithms of the NIST Algorithm Testing System", J. Res. Natl. Inst. Stand. Technol. 103 (1998)
633. Points are first moved to their mean and scaled to a root mean square distance of 1, so that neither far-away
coordinates nor units cost digits. A shape moves in a frame of its own that every step updates: no direction is
singular.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from truearm import solve
from truearm.errors import InputError
from truearm.typing import FloatArray

ShapeParameters = TypeVar("ShapeParameters")

# Spreads below this share of the largest count as zero: points on a line, in a plane.
NOTHING = 1e-9
# Singular values of the derivative below this share of the largest: parameters that the points do not determine.
RANK = 1e-11
# In spreads of the points: a larger radius is that of a straight object.
FARTHEST = 1e6
MOST_STEPS = 1000
# Steps that change residuals by less than this share, and no longer by less and less, are rounding.
STALLED = 1e-10


class NormalisedPoints(NamedTuple):
    """Points about their mean, in units of their spread.

    Attributes
    ----------
    points : (n, 3) array
        Their mean is 0, the mean of their squared lengths 1.
    middle : (3,) array
        Where the mean was [mm].
    scale : float
        The unit [mm].
    rounding : float
        What the rounding of the given coordinates is in that unit.
    """

    points: FloatArray
    middle: FloatArray
    scale: float
    rounding: float

    @property
    def nothing(self) -> float:
        """Spreads up to here, in units of the largest, count as none."""
        return max(NOTHING, 16 * self.rounding)


class LinearisedResiduals(NamedTuple):
    """Residuals (m,) at a state and their derivative (m, p) by the shape's parameters."""

    residuals: FloatArray
    jacobian: FloatArray


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """A shape fitted to points.

    Attributes
    ----------
    residuals : (n,) or (n, 2) array
        Signed distances [mm] of the points from the shape; where the shape is a curve, their two components.
    std_mm : float
        Standard deviation of a point's coordinate [mm]: as given, or from the residuals; NaN if there are no more
        residuals than parameters.
    covariance : (p, p) array
        Of the parameters, in the order that the shape's description gives them, to first order and for points with
        independent errors alike in all directions. It is singular where points and directions move only across the
        shape, or keep length 1. NaN where `std_mm` is.
    """

    residuals: FloatArray
    std_mm: float
    covariance: FloatArray

    @property
    def form_mm(self) -> float:
        """Least-squares form deviation: largest less smallest residual; of a curve, twice the largest distance."""
        if self.residuals.ndim == 1:
            return float(np.ptp(self.residuals))
        return 2 * float(np.sqrt((self.residuals**2).sum(axis=1)).max())


def normalise_points(points: npt.ArrayLike, *, least: int, shape: str) -> NormalisedPoints:
    """Check points (n, 3) [mm], move them to their mean and scale them to unit spread.

    Raises
    ------
    InputError
        If they are not (n, 3) finite numbers, are fewer than `least`, or all in one place.
    """
    given = np.asarray(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 3:
        raise InputError(f"expected points of a {shape} as an array (n, 3), got shape {given.shape}")
    if not np.isfinite(given).all():
        row = int(np.argmin(np.isfinite(given).all(axis=1)))
        raise InputError(f"expected finite coordinates of a {shape}, got {given[row].tolist()} at point {row + 1}")
    if len(given) < least:
        raise InputError(f"expected {least} points or more for a {shape}, got {len(given)}", hint="measure more points")
    largest = np.abs(given).max()
    unit = float(largest) or 1.0  # neither squares of huge numbers nor of tiny ones
    centred = given / unit
    middle = centred.mean(axis=0)
    centred = centred - middle
    rest = centred.mean(axis=0)  # what the rounding of the mean of far-away points leaves
    centred, middle = centred - rest, unit * (middle + rest)
    spread = float(np.sqrt((centred**2).sum(axis=1).mean()))
    if spread <= 16 * np.finfo(float).eps:
        raise InputError(
            f"expected points all over a {shape}, got {len(given)} in one place", hint="measure points farther apart"
        )
    scale = spread * unit
    return NormalisedPoints(centred / spread, middle, scale, float(np.finfo(float).eps * largest / scale))


def principal_axes(normal: NormalisedPoints) -> tuple[FloatArray, FloatArray]:
    """Return the spreads (3,) of the points, largest first, and the right-handed frame (3, 3) of their axes."""
    n = len(normal.points)
    three = np.concatenate([normal.points, np.zeros((max(3 - n, 0), 3))])  # rows of zeros change neither
    _, spreads, axes = np.linalg.svd(three, full_matrices=False)
    spreads = spreads / np.sqrt(n)
    frame = axes.T.copy()
    frame[:, 1] *= np.sign(np.linalg.det(frame))
    return spreads, frame


def gauss_newton(
    start: ShapeParameters,
    linearised: Callable[[ShapeParameters], LinearisedResiduals],
    moved: Callable[[ShapeParameters, FloatArray], ShapeParameters],
    *,
    size: Callable[[ShapeParameters], float],
    shape: str,
) -> tuple[ShapeParameters, LinearisedResiduals]:
    """Minimise a sum of squares by Gauss-Newton steps (`truearm.solve.gauss_newton`).

    Parameters
    ----------
    start : state
        Near the minimum.
    linearised : callable
        Residuals and derivative at a state.
    moved : callable
        The state after a step (p,).
    size : callable
        The largest length of a state, in spreads of the points.
    shape : str
        The name of the shape, for messages.

    Raises
    ------
    InputError
        If the points do not determine the shape: the sum has no minimum nearby, or a whole line of minima.
    """
    n_residuals = 0

    def counted(state: ShapeParameters) -> LinearisedResiduals:
        nonlocal n_residuals
        at = linearised(state)
        n_residuals = len(at.residuals)
        return at

    def rounding(state: ShapeParameters) -> float:
        """Rounding of the norm of the residuals, for this number of points at distances of this size."""
        return float(4 * np.finfo(float).eps * np.sqrt(n_residuals) * max(1.0, size(state)))

    result = solve.gauss_newton(
        solve.DenseProblem(counted, rounding=rounding),
        start,
        move=moved,
        stops=[_Arrival(size, rounding, shape), solve.MaxEpochs(MOST_STEPS)],
    )
    if result.reason is solve.UNSOLVED or (not result.reason.converged and result.epochs >= MOST_STEPS):
        raise undetermined_error(shape)
    return result.x, LinearisedResiduals(result.equations.residuals, result.equations.jacobian)


class _Arrival:
    """Stop at steps that change the residuals by no more than rounding; refuse a shape that grows beyond bounds."""

    def __init__(self, size: Callable[[Any], float], rounding: Callable[[Any], float], shape: str) -> None:
        self._size, self._rounding, self._shape = size, rounding, shape
        self._before = np.inf

    def __call__(self, state: solve.OptimizerState) -> solve.StopReason | None:
        """A reason to stop, by the change of the residuals that the last step predicted."""
        if np.isnan(state.predicted):
            return None
        size = self._size(state.x)
        if size > FARTHEST:
            raise undetermined_error(self._shape)
        change = float(np.sqrt(max(2 * state.predicted, 0.0)))
        is_stalled = change < STALLED * max(1.0, size) and change > 0.9 * self._before
        self._before = change
        return _ARRIVED if is_stalled or change < self._rounding(state.x) else None


_ARRIVED = solve.StopReason("The residuals do not change any more.", True)


def undetermined_error(shape: str) -> InputError:
    """Return the error for points that do not determine a shape."""
    return InputError(
        f"the points do not determine a {shape}: within their scatter it may be of any size or direction",
        hint="measure points spread wider over it, and remove points that belong to another surface",
    )


def scatter_std(at: LinearisedResiduals, scale: float, std_mm: float | None) -> float:
    """Return the standard deviation of a coordinate [mm]: the given one, or from the residuals; NaN without redundancy.

    Raises
    ------
    InputError
        If a given one is not a positive number.
    """
    if std_mm is not None:
        if not (np.isfinite(std_mm) and std_mm > 0):
            raise InputError(f"expected a positive standard deviation of a point, got {std_mm} mm")
        return float(std_mm)
    m, p = at.jacobian.shape
    return scale * float(np.sqrt(at.residuals @ at.residuals / (m - p))) if m > p else np.nan


def covariance_of(at: LinearisedResiduals, to_parameters: FloatArray, std: float, shape: str) -> FloatArray:
    """Propagate the points' scatter `std` through the fit: ``std^2 G (J^T J)^-1 G^T`` with ``G = to_parameters``."""
    r: FloatArray = np.asarray(np.linalg.qr(at.jacobian, mode="r"))
    diagonal = np.abs(r.diagonal())
    if diagonal.min() <= RANK * diagonal.max():
        raise undetermined_error(shape)
    root = std * to_parameters @ np.linalg.inv(r)
    return np.asarray(root @ root.T)


def tilt_frame(frame: FloatArray, a: float, b: float) -> FloatArray:
    """Return the frame (3, 3) turned about its own first two axes by small angles `a`, `b` [rad]."""
    third = frame[:, 2] + b * frame[:, 0] - a * frame[:, 1]
    third = third / np.sqrt(third @ third)
    first = frame[:, 0] - (frame[:, 0] @ third) * third
    first = first / np.sqrt(first @ first)
    return np.column_stack([first, cross(third, first), third])


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the cross product of two vectors (3,), faster than the general one."""
    (a, b, c), (d, e, f) = one, other
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])


def radial_distances(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distances from the third axis of the shape's frame, and their derivatives.

    Parameters
    ----------
    local : (n, 3) array
        Points in the frame.

    Returns
    -------
    distance : (n,) array
    jacobian : (n, 6) array
        Derivatives of distance less radius by the moves along the axes, the tilts about the first and second axis, and
        the radius.
    """
    x, y, z = local.T
    distance = np.sqrt(x * x + y * y)
    safe = np.where(distance > 0, distance, 1.0)
    cos, sin, none = x / safe, y / safe, np.zeros(len(local))
    return distance, np.column_stack([-cos, -sin, none, z * sin, -z * cos, none - 1])


def direction_sign(direction: FloatArray) -> float:
    """Return the sign that makes the largest component of a direction (3,) positive."""
    return 1.0 if direction[np.argmax(np.abs(direction))] > 0 else -1.0


def circle_start(plane: FloatArray) -> FloatArray:
    """Return the centre (2,) of the circle through points (n, 2), or (3,) of the sphere through (n, 3), algebraically.

    Linear in centre and ``r^2 - c^2``: I. Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8.
    """
    square = (plane**2).sum(axis=1)
    A = np.column_stack([2 * plane, np.ones(len(plane))])
    solution, *_ = np.linalg.lstsq(A, square, rcond=None)
    return np.asarray(solution[:-1])
