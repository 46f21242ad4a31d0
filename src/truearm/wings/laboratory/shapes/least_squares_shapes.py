"""The least-squares line, plane, circle, sphere, cylinder, cone and torus in space."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.normalised_points import frame_across, normalise_points, principal_axes
from truearm.wings.laboratory.shapes.orthogonal_regression import (
    FARTHEST,
    RADII,
    Distances,
    Element,
    Fitted,
    Place,
    ShapeFit,
    around,
    best_places,
    centres_across,
    fitted,
    linear_solutions,
    minimise,
    radial_distances,
    round_starts,
    towards_positive,
    undetermined_error,
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


def _line_distances(local: FloatArray, _: FloatArray) -> Distances:
    across = np.repeat(np.eye(3)[:2], len(local), axis=0)
    return Distances(local[:, :2].T.ravel(), across, np.empty((2 * len(local), 0)))


LINE = Element("line", _line_distances, (0, 1, 3, 4))


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


def _plane_distances(local: FloatArray, _: FloatArray) -> Distances:
    return Distances(local[:, 2], np.broadcast_to([0.0, 0.0, 1.0], local.shape), np.empty((len(local), 0)))


PLANE = Element("plane", _plane_distances, (2, 3, 4))


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
    _, axes = frame_across(normal, "all over a plane")
    fit = fitted(PLANE, normal, towards_positive(Place(np.zeros(3), axes, np.empty(0))), std_mm)
    return Plane(*fit.scatter, point=fit.origin, normal=fit.axis)


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


def _circle_distances(local: FloatArray, sizes: FloatArray) -> Distances:
    """In the plane, then along its normal."""
    distance, gradient = radial_distances(local)
    by_size = np.repeat([[-1.0], [0.0]], len(local), axis=0)
    along = np.broadcast_to([0.0, 0.0, 1.0], local.shape)
    return Distances(np.concatenate([distance - sizes[0], local[:, 2]]), np.concatenate([gradient, along]), by_size)


CIRCLE = Element("circle", _circle_distances, (0, 1, 2, 3, 4), (True,))


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
    spreads, axes = frame_across(normal, "all round a circle")
    place = minimise(CIRCLE, normal, round_starts(normal.points @ axes[:, :2], axes), spreads[1:])
    fit = fitted(CIRCLE, normal, towards_positive(place), std_mm)
    return Circle(*fit.scatter, centre=fit.origin, normal=fit.axis, radius_mm=float(fit.sizes[0]))


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


def _sphere_distances(local: FloatArray, sizes: FloatArray) -> Distances:
    distance = np.sqrt((local * local).sum(axis=1))
    gradient = local / np.where(distance > 0, distance, 1.0)[:, None]
    return Distances(distance - sizes[0], gradient, np.full((len(local), 1), -1.0))


SPHERE = Element("sphere", _sphere_distances, (0, 1, 2), (True,))


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

    Examples
    --------
    >>> import truearm as ta
    >>> ta.shapes.fit_sphere([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]]).radius_mm
    1.0
    """
    normal = normalise_points(points, least=4, shape="sphere")
    spreads, _ = principal_axes(normal)
    if spreads[2] <= normal.nothing:
        raise InputError(
            "expected points all over a sphere, got points in one plane, which determine no radius",
            hint="add a point at the pole",
        )
    place = minimise(SPHERE, normal, round_starts(normal.points, np.eye(3)), spreads[2:])
    fit = fitted(SPHERE, normal, place, std_mm)
    residuals, std, covariance = fit.scatter
    own = np.ix_([0, 1, 2, 6], [0, 1, 2, 6])
    return Sphere(residuals, std, covariance[own], centre=fit.origin, radius_mm=float(fit.sizes[0]))


@dataclass(frozen=True, eq=False)
class Cylinder(ShapeFit):
    """A cylinder fitted to points; its parameters are the point, the axis and the radius, seven.

    Attributes
    ----------
    point : (3,) array
        Of the axis, nearest to the mean of the points [mm].
    axis : (3,) array
        Unit vector; its largest component is positive.
    radius_mm : float
    """

    point: FloatArray
    axis: FloatArray
    radius_mm: float


def _cylinder_distances(local: FloatArray, sizes: FloatArray) -> Distances:
    distance, gradient = radial_distances(local)
    return Distances(distance - sizes[0], gradient, np.full((len(local), 1), -1.0))


CYLINDER = Element("cylinder", _cylinder_distances, (0, 1, 3, 4), (True,))


def fit_cylinder(points: npt.ArrayLike, *, std_mm: float | None = None) -> Cylinder:
    """Fit a cylinder by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least five, at two heights or more [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs six points.

    Raises
    ------
    InputError
        If the points are too few or determine no cylinder, such as points of one section, of a plane or of a line.

    Notes
    -----
    The sum of squares has a minimum for each of several axes; the fit begins with axes to all sides.

    Examples
    --------
    >>> import numpy as np, truearm as ta
    >>> turn = np.arange(8)
    >>> bore = np.column_stack([6 * np.cos(turn), 6 * np.sin(turn), 3 * (turn % 3)])
    >>> round(ta.shapes.fit_cylinder(bore).radius_mm, 9)
    6.0
    """
    normal = normalise_points(points, least=5, shape="cylinder")
    spreads, axes = principal_axes(normal)
    place = minimise(CYLINDER, normal, best_places(normal, axes, _judged_cylinders), spreads[2:])
    axis = place.frame[:, 2]
    place = place._replace(origin=place.origin - (place.origin @ axis) * axis)
    fit = fitted(CYLINDER, normal, towards_positive(place), std_mm)
    return Cylinder(*fit.scatter, point=fit.origin, axis=fit.axis, radius_mm=float(fit.sizes[0]))


def _judged_cylinders(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    centres, distances = centres_across(local)
    return distances.var(axis=1), np.column_stack([centres, np.zeros(len(local)), distances.mean(axis=1)])


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


def _cone_distances(local: FloatArray, sizes: FloatArray) -> Distances:
    """Sizes: the radius in the plane of the origin, and the angle by which it grows along the axis."""
    distance, gradient = radial_distances(local)
    (radius, angle), z = sizes, local[:, 2]
    cos, sin = np.cos(angle), np.sin(angle)
    away = distance - radius
    by_sizes = np.column_stack([np.full(len(z), -cos), -away * sin - z * cos])
    return Distances(away * cos - z * sin, cos * gradient - [0.0, 0.0, sin], by_sizes)


CONE = Element("cone", _cone_distances, (0, 1, 3, 4), (True, False))


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
    place = minimise(CONE, normal, best_places(normal, axes, _judged_cones), spreads[2:])
    axis, (radius, angle) = place.frame[:, 2], place.sizes
    shift = -float(place.origin @ axis)
    side = 1.0 if angle > 0 else -1.0
    sizes = np.array([radius + shift * np.tan(angle), side * angle])
    if not 0 < abs(sizes[0]) < FARTHEST * abs(np.tan(angle)):
        raise undetermined_error("cone")
    return _cone_with_apex(fitted(CONE, normal, Place(place.origin + shift * axis, side * place.frame, sizes), std_mm))


def _cone_with_apex(fit: Fitted) -> Cone:
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


def _judged_cones(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    z = local[:, :, 2]
    one = np.ones_like(z)
    # The squared radius is linear in the place of the axis, and quadratic in the height.
    centres, distances = centres_across(local, np.stack([z**2, z], axis=2))
    radius, slope = linear_solutions(np.stack([one, z], axis=2), distances).T
    angle = np.arctan(slope)
    rest = (distances - radius[:, None] - slope[:, None] * z) * np.cos(angle)[:, None]
    return (rest**2).mean(axis=1), np.column_stack([centres, 0 * angle, radius, angle])


@dataclass(frozen=True, eq=False)
class Torus(ShapeFit):
    """A torus fitted to points; its parameters are the centre, the axis and both radii, eight.

    Attributes
    ----------
    centre : (3,) array
        [mm]
    axis : (3,) array
        Unit vector; its largest component is positive.
    major_radius_mm : float
        Of the circle in the middle of the tube.
    minor_radius_mm : float
        Of the tube.
    """

    centre: FloatArray
    axis: FloatArray
    major_radius_mm: float
    minor_radius_mm: float


def _torus_distances(local: FloatArray, sizes: FloatArray) -> Distances:
    """Sizes: the radius of the ring and that of the tube."""
    distance, gradient = radial_distances(local)
    away, z = distance - sizes[0], local[:, 2]
    from_ring = np.sqrt(away * away + z * z)
    safe = np.where(from_ring > 0, from_ring, 1.0)
    outwards = gradient * (away / safe)[:, None]
    outwards[:, 2] = z / safe
    return Distances(from_ring - sizes[1], outwards, np.column_stack([-away / safe, np.full(len(z), -1.0)]))


TORUS = Element("torus", _torus_distances, (0, 1, 2, 3, 4), (True, True))


def fit_torus(points: npt.ArrayLike, *, std_mm: float | None = None) -> Torus:
    """Fit a torus by least squares of the points' distances from it.

    Parameters
    ----------
    points : (n, 3) array
        At least seven, around the ring and around the tube [mm].
    std_mm : float, optional
        Standard deviation of a coordinate [mm]; from the residuals by default, which needs eight points.

    Raises
    ------
    InputError
        If the points are too few or determine no torus.

    Examples
    --------
    >>> import numpy as np, truearm as ta
    >>> ring, tube = np.arange(12), 1.7 * np.arange(12)
    >>> across = 30 + 5 * np.cos(tube)
    >>> points = np.column_stack([across * np.cos(ring), across * np.sin(ring), 5 * np.sin(tube)])
    >>> round(ta.shapes.fit_torus(points).minor_radius_mm, 9)
    5.0
    """
    normal = normalise_points(points, least=7, shape="torus")
    spreads, axes = principal_axes(normal)
    starts = chain.from_iterable(best_places(normal, axes, judge) for judge in (_judged_tori, _judged_bends))
    place = minimise(TORUS, normal, starts, spreads[2:])
    if place.sizes.min() <= 0:
        raise undetermined_error("torus")
    fit = fitted(TORUS, normal, towards_positive(place), std_mm)
    ring, tube = fit.sizes.tolist()
    return Torus(*fit.scatter, centre=fit.origin, axis=fit.axis, major_radius_mm=ring, minor_radius_mm=tube)


def _judged_tori(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    centres, distances = centres_across(local)
    section = np.stack([distances, local[:, :, 2]], axis=2)
    # A section of the tube, in which distance from the axis and height are the coordinates.
    rings, from_ring = centres_across(section)
    parameters = np.column_stack([centres, rings[:, 1], rings[:, 0], from_ring.mean(axis=1)])
    return from_ring.var(axis=1), parameters


def _judged_bends(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A short bend of a pipe: rings about centres on all sides, at the height of the points."""
    centres = np.multiply.outer(RADII, around(16)).reshape(-1, 2)
    distances = np.sqrt(((local[:, None, :, :2] - centres[:, None]) ** 2).sum(axis=3))
    rings = distances.mean(axis=2)
    from_ring = np.hypot(distances - rings[:, :, None], local[:, None, :, 2])
    squares = from_ring.var(axis=2)
    rows, best = np.arange(len(local)), squares.argmin(axis=1)
    sizes = rings[rows, best], from_ring.mean(axis=2)[rows, best]
    return squares[rows, best], np.column_stack([centres[best], np.zeros(len(local)), *sizes])
