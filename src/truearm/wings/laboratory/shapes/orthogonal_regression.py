"""Orthogonal distance regression: the common part of the least-squares ("Gauss") shapes.

Residuals are distances [mm] from the nearest point of the shape; the sum of their squares is minimised: A. B. Forbes,
"Least-squares best-fit geometric elements", NPL Report DITC 140/89, National Physical Laboratory 1989; C. M. Shakarji,
"Least-squares fitting algorithms of the NIST Algorithm Testing System", J. Res. Natl. Inst. Stand. Technol. 103 (1998)
633. Points are first moved to their mean and scaled to a root mean square distance of 1, so that neither far-away
coordinates nor units cost digits. An `Element` is its parameters, its signed distance and the derivatives of it; all
else is common. It moves in a frame of its own that every step updates: no direction is singular.

A sum of squares of distances may have several minima and saddles between them (N. Chernov, C. Lesort, "Least squares
fitting of circles and lines", arXiv:cs/0301001): where residuals are large, several starts are compared, the second
derivative is checked, and a shape that fits no better than a flat one is refused. They are centres and axes on all
sides, judged by algebraic fits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from truearm.errors import InputError
from truearm.solve import least_squares, stop_criteria
from truearm.solve.least_squares_problem import DenseProblem
from truearm.typing import FloatArray, IntArray
from truearm.wings.laboratory.shapes.normalised_points import NormalisedPoints

# Singular values of the derivative below this share of the largest: parameters that the points do not determine.
RANK = 1e-11
# In spreads of the points: a larger radius is that of a straight object.
FARTHEST = 1e6
# Fits of shapes take some 10 steps, of slight arcs up to 60; more are a way to a flat shape, without end.
MOST_STEPS = 200
# Steps that change residuals by less than this share, and no longer by less and less, are rounding.
STALLED = 1e-10
# Root mean square residuals up to this share of the points' smallest spread: close to the shape, where the
# best start leads to the one minimum.
CLOSE = 0.02
# An eigenvalue of the second derivative below minus this share of the largest is that of a saddle.
SADDLE = 1e-6


class LinearisedResiduals(NamedTuple):
    """Residuals (m,) at a state and their derivative (m, p) by the shape's parameters."""

    residuals: FloatArray
    jacobian: FloatArray


class Distances(NamedTuple):
    """Signed distances of points from a shape in its own frame, with derivatives.

    Attributes
    ----------
    values : (m,) array
        Of n points; of a curve the two components, one after the other (m = 2n).
    gradient : (m, 3) array
        By the coordinates of the point.
    by_sizes : (m, k) array
        By the sizes of the shape.
    """

    values: FloatArray
    gradient: FloatArray
    by_sizes: FloatArray


class Place(NamedTuple):
    """Where a shape is and how large: the origin (3,) and axes (3, 3), as columns, of its frame, and sizes (k,)."""

    origin: FloatArray
    frame: FloatArray
    sizes: FloatArray


@dataclass(frozen=True)
class Element:
    """A geometric element: what `minimise` and the minimum zone need to know of a shape.

    Parameters
    ----------
    name : str
    distances : callable
        From points (n, 3) in the frame of the shape and its sizes (k,) to `Distances`.
    moves : tuple of int
        The moves that change it: 0 to 2 along the axes of its frame, 3 and 4 tilts about the first and second of them.
    is_length : tuple of bool
        Whether each size is a length; otherwise it is an angle.
    """

    name: str
    distances: Callable[[FloatArray, FloatArray], Distances]
    moves: tuple[int, ...]
    is_length: tuple[bool, ...] = ()

    def linearised(self, points: FloatArray, place: Place) -> LinearisedResiduals:
        """Distances of points (n, 3), and their derivatives by the moves and the sizes."""
        local = (points - place.origin) @ place.frame
        values, gradient, by_sizes = self.distances(local, place.sizes)
        x, y, z = local.T if len(local) == len(values) else np.tile(local, (2, 1)).T
        u, v, w = gradient.T
        by_moves = np.column_stack([-u, -v, -w, v * z - w * y, w * x - u * z])
        return LinearisedResiduals(values, np.concatenate([by_moves[:, self.moves], by_sizes], axis=1))

    def moved(self, place: Place, step: FloatArray) -> Place:
        """The place after a step (p,)."""
        moves = np.zeros(5)
        n = len(self.moves)
        moves[list(self.moves)] = step[:n]
        return Place(
            place.origin + place.frame @ moves[:3], tilt_frame(place.frame, moves[3], moves[4]), place.sizes + step[n:]
        )


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


def minimise(element: Element, normal: NormalisedPoints, starts: Iterable[Place], spreads: FloatArray) -> Place:
    """Minimise the sum of squared distances from several starts.

    Parameters
    ----------
    element : Element
    normal : NormalisedPoints
    starts : iterable
        Near the minima, the most likely first; the others are tried only where residuals are large.
    spreads : (k,) array
        Spreads of the points across the flat shape that this one becomes as it grows without bound, the largest first,
        in units of theirs. The shape must explain the first; of several minima and the flat shape the lowest is the
        best fit.

    Raises
    ------
    InputError
        If the points do not determine the shape: the sum has no minimum, it is lowest for the flat shape, or the
        lowest point that was found is a saddle.
    """
    best, lowest = None, np.inf
    close, flat = (CLOSE * float(spreads[0])) ** 2, float(spreads @ spreads)
    for start in starts:
        try:
            place, at = gauss_newton(element, normal.points, start)
        except (InputError, np.linalg.LinAlgError):
            continue
        square = float(at.residuals @ at.residuals) / len(normal.points)
        if square < lowest:
            best, lowest = place, square
        if lowest <= close:
            break
    if best is None or not (lowest <= close or (lowest < flat and _is_minimum(element, normal.points, best))):
        raise undetermined_error(element.name)
    return best


def _is_minimum(element: Element, points: FloatArray, place: Place) -> bool:
    """Whether the second derivative of the sum of squares has no negative eigenvalue, by differences of the first."""
    jacobian = element.linearised(points, place).jacobian
    steps = np.diag(1e-5 / np.maximum(np.sqrt((jacobian**2).sum(axis=0)), 1e-12))

    def gradient(step: FloatArray) -> FloatArray:
        residuals, jacobian = element.linearised(points, element.moved(place, step))
        return jacobian.T @ residuals

    second = np.array([(gradient(step) - gradient(-step)) / 2e-5 for step in steps]) @ steps / 1e-5
    values = np.linalg.eigvalsh((second + second.T) / 2)
    return bool(values[0] > -SADDLE * values[-1])


def gauss_newton(element: Element, points: FloatArray, start: Place) -> tuple[Place, LinearisedResiduals]:
    """Minimise the sum of squared distances by Gauss-Newton steps (`truearm.solve.least_squares.gauss_newton`).

    Raises
    ------
    InputError
        If the sum has no minimum near the start, or a whole line of minima.
    """
    root = float(np.sqrt(len(points)))

    def rounding(place: Place) -> float:
        """Rounding of the norm of the residuals, for this number of points at distances of this size."""
        return 4 * float(np.finfo(float).eps) * root * max(1.0, _extent(place))

    result = least_squares.gauss_newton(
        DenseProblem(partial(element.linearised, points), rounding=rounding),
        start,
        move=element.moved,
        stops=[_Arrival(rounding, element.name), stop_criteria.MaxEpochs(MOST_STEPS)],
    )
    if result.reason is least_squares.UNSOLVED or (not result.reason.converged and result.epochs >= MOST_STEPS):
        raise undetermined_error(element.name)
    return result.x, LinearisedResiduals(result.equations.residuals, result.equations.jacobian)


def _extent(place: Place) -> float:
    """The largest length of a place, in spreads of the points."""
    return float(np.abs(np.concatenate([place.origin, place.sizes])).max())


class _Arrival:
    """Stop at steps that change the residuals by no more than rounding; refuse a shape that grows beyond bounds."""

    def __init__(self, rounding: Callable[[Place], float], shape: str) -> None:
        self._rounding, self._shape = rounding, shape
        self._before = np.inf

    def __call__(self, state: stop_criteria.OptimizerState) -> stop_criteria.StopReason | None:
        """A reason to stop, by the change of the residuals that the last step predicted."""
        if np.isnan(state.predicted):
            return None
        size = _extent(state.x)
        if size > FARTHEST:
            raise undetermined_error(self._shape)
        change = float(np.sqrt(max(2 * state.predicted, 0.0)))
        is_stalled = change < STALLED * max(1.0, size) and change > 0.9 * self._before
        self._before = change
        return _ARRIVED if is_stalled or change < self._rounding(state.x) else None


_ARRIVED = stop_criteria.StopReason("The residuals do not change any more.", True)


class Fitted(NamedTuple):
    """A shape at its best place, in mm.

    Attributes
    ----------
    origin, axis : (3,) array
        Origin and third axis of its frame.
    sizes : (k,) array
        [mm or rad]
    scatter : ((n,) or (n, 2) array, float, (6 + k, 6 + k) array)
        Residuals [mm], `std_mm`, and covariance of origin, axis and sizes.
    """

    origin: FloatArray
    axis: FloatArray
    sizes: FloatArray
    scatter: tuple[FloatArray, float, FloatArray]


def fitted(element: Element, normal: NormalisedPoints, place: Place, std_mm: float | None) -> Fitted:
    """What is known of a shape at the minimum of its sum of squares; the scatter is given, or that of the residuals.

    Raises
    ------
    InputError
        If the given scatter is not a positive number, or the points do not determine the shape.
    """
    at = element.linearised(normal.points, place)
    if std_mm is not None and not (np.isfinite(std_mm) and std_mm > 0):
        raise InputError(f"expected a positive standard deviation of a point, got {std_mm} mm")
    m, p = at.jacobian.shape
    scatter = normal.scale * float(np.sqrt(at.residuals @ at.residuals / (m - p))) if m > p else np.nan
    std = scatter if std_mm is None else float(std_mm)
    r: FloatArray = np.asarray(np.linalg.qr(at.jacobian, mode="r"))
    diagonal = np.abs(r.diagonal())
    if diagonal.min() <= RANK * diagonal.max():
        raise undetermined_error(element.name)
    n, k = len(element.moves), len(element.is_length)
    units = np.where(element.is_length, normal.scale, 1.0)
    by_moves = np.zeros((6, 5))
    by_moves[:3, :3] = place.frame
    by_moves[3:, 3:] = np.column_stack([-place.frame[:, 1], place.frame[:, 0]]) / normal.scale
    to_parameters = np.zeros((6 + k, n + k))
    to_parameters[:6, :n] = by_moves[:, element.moves]
    to_parameters[6:, n:] = np.diag(units / normal.scale)
    residuals = at.residuals if m == len(normal.points) else at.residuals.reshape(2, -1).T
    root = std * to_parameters @ np.linalg.inv(r)
    return Fitted(
        origin=normal.middle + normal.scale * place.origin,
        axis=place.frame[:, 2].copy(),
        sizes=units * place.sizes,
        scatter=(normal.scale * residuals, std, root @ root.T),
    )


def undetermined_error(shape: str) -> InputError:
    """Return the error for points that do not determine a shape."""
    return InputError(
        f"the points do not determine a {shape}: within their scatter it may be of any size or direction",
        hint="measure points spread wider over it, and remove points that belong to another surface",
    )


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
    """Return the distances (n,) of points (n, 3) from the third axis, and their gradient (n, 3)."""
    x, y, _ = local.T
    distance = np.sqrt(x * x + y * y)
    safe = np.where(distance > 0, distance, 1.0)
    return distance, np.column_stack([x / safe, y / safe, np.zeros(len(local))])


def towards_positive(place: Place) -> Place:
    """Return the place with all axes reversed if the largest component of the third is negative."""
    axis = place.frame[:, 2]
    return place if axis[np.argmax(np.abs(axis))] > 0 else place._replace(frame=-place.frame)


# Of more points a start needs an even selection only.
MOST_POINTS = 200
MOST_STARTS = 4
N_DIRECTIONS = 200
# In spreads of the points: centres nearer are those of a round object, farther ones those of a slight arc.
RADII = np.geomspace(0.1, 100.0, 16)
# Directions closer than this (cosine) are neighbours: some 26 deg.
NEIGHBOURS = 0.9
_GOLDEN_RAD = float(np.pi * (3 - np.sqrt(5)))


def algebraic_centre(points: FloatArray) -> FloatArray:
    """Return the centre (2,) of the circle through points (n, 2), or (3,) of the sphere through (n, 3), algebraically.

    Linear in centre and ``r^2 - c^2``: I. Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8.
    """
    square = (points**2).sum(axis=1)
    solution, *_ = np.linalg.lstsq(np.column_stack([2 * points, np.ones(len(points))]), square, rcond=None)
    return np.asarray(solution[:-1])


def centres_around(points: FloatArray) -> FloatArray:
    """Return centres (k, d), on all sides of points (n, d), from which distances vary least: the best of each side."""
    some = _selection(points)
    if points.shape[1] == 2:
        directions = around(64)
    else:
        directions = on_sphere(N_DIRECTIONS)
    centres = directions[:, None] * RADII[:, None]
    distances = np.sqrt(((some - centres[:, :, None]) ** 2).sum(axis=3))
    squares = distances.var(axis=2)
    nearest = squares.argmin(axis=1)
    rows = np.arange(len(directions))
    best = lowest_of_neighbours(directions @ directions.T, squares[rows, nearest])
    return np.asarray(centres[best, nearest[best]])


def round_starts(points: FloatArray, frame: FloatArray) -> Iterator[Place]:
    """Yield places of a circle or sphere about the centres of points (n, 2) or (n, 3) in a frame (3, 3)."""

    def about(centre: FloatArray) -> Place:
        radius = np.sqrt(((points - centre) ** 2).sum(axis=1)).mean(keepdims=True)
        return Place(frame[:, : len(centre)] @ centre, frame, radius)

    yield about(algebraic_centre(points))
    yield from map(about, centres_around(points))


def frames_around(axes: FloatArray) -> FloatArray:
    """Return frames (m, 3, 3) whose third axes point along `axes` (3, 3), and to all sides of a half space."""
    return np.concatenate([[frame_of(up) for up in axes.T], _frames_to_all_sides()])


@cache
def _frames_to_all_sides() -> FloatArray:
    return np.array([frame_of(up) for up in on_sphere(N_DIRECTIONS)[: N_DIRECTIONS // 2]])


def frame_of(up: FloatArray) -> FloatArray:
    """Return a right-handed frame (3, 3) whose third axis is the direction `up` (3,) of length one."""
    first = cross(np.eye(3)[np.abs(up).argmin()], up)
    first = first / np.sqrt(first @ first)
    return np.column_stack([first, cross(up, first), up])


def best_places(
    normal: NormalisedPoints, axes: FloatArray, judge: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
) -> Iterator[Place]:
    """Yield places of a shape with its axis to the best of each side, the best first.

    `judge` gives for points (m, n, 3) in frames the mean square distances (m,), and origins and sizes (m, 3 + k).
    """
    frames = frames_around(axes)
    squares, found = judge(_selection(normal.points) @ frames)
    up = frames[:, :, 2]
    for i in lowest_of_neighbours(np.abs(up @ up.T), np.where(np.isfinite(squares), squares, np.inf)):
        yield Place(frames[i] @ found[i, :3], frames[i], found[i, 3:])


def lowest_of_neighbours(cosines: FloatArray, values: FloatArray) -> IntArray:
    """Return which values (m,) are the lowest among their neighbours, the lowest first, at most `MOST_STARTS`."""
    around = np.where(cosines > NEIGHBOURS, values, np.inf).min(axis=1)
    lowest = np.flatnonzero(np.isfinite(values) & (values <= around))
    return lowest[np.argsort(values[lowest], kind="stable")][:MOST_STARTS]


def centres_across(local: FloatArray, also: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the centres (m, 2) of circles through the first two coordinates of points (m, n, 2 or 3), and distances.

    Algebraic as `algebraic_centre`; `also` (m, n, k) are further functions of which the squared radius is a sum.
    """
    flat = local[:, :, :2]
    columns = [2 * flat, np.ones((*flat.shape[:2], 1)), *(() if also is None else (also,))]
    centres = linear_solutions(np.concatenate(columns, axis=2), (flat**2).sum(axis=2))[:, :2]
    return centres, np.sqrt(((flat - centres[:, None]) ** 2).sum(axis=2))


def linear_solutions(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solutions (m, p) of m systems with columns (m, n, p) and right sides (m, n)."""
    solutions: FloatArray = (np.linalg.pinv(columns) @ right[:, :, None])[:, :, 0]
    return solutions


def around(n: int) -> FloatArray:
    """Return unit vectors (n, 2), even around a circle."""
    turn = 2 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(turn), np.sin(turn)])


def on_sphere(n: int) -> FloatArray:
    """Return unit vectors (n, 3), even over the sphere from the top down: equal heights, by the golden angle."""
    height, turn = 1 - (2 * np.arange(n) + 1) / n, _GOLDEN_RAD * np.arange(n)
    across = np.sqrt(1 - height**2)
    return np.asarray(np.column_stack([across * np.cos(turn), across * np.sin(turn), height]))


def _selection(points: FloatArray) -> FloatArray:
    rows = np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).astype(int)
    selected: FloatArray = points[rows]
    return selected
