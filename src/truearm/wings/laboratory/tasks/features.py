"""Features of a part: their measured points, and the evaluation of the points by least-squares shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.least_squares_shapes import (
    fit_circle,
    fit_cone,
    fit_cylinder,
    fit_plane,
    fit_sphere,
)
from truearm.wings.laboratory.shapes.orthogonal_regression import around, frame_of, on_sphere
from truearm.wings.laboratory.shapes.relations import distance

UP = np.array([0.0, 0.0, 1.0])
# A smaller size was probably meant in metres.
MIN_MM = 1.0
MAX_POINTS = 1000
MIN_ANGLE_RAD = float(np.radians(1.0))
COS_OF_VERTICAL = 0.99
# One more than the parameters of the shape, so that there is a form deviation; of two planes twice as many.
MIN_POINTS = {
    "length": 2, "sphere": 5, "plane": 4, "circle": 5, "cylinder": 6, "cone": 7, "distance": 8, "angle": 8,
}  # fmt: skip


class FeatureQuantity(NamedTuple):
    """A measured quantity of a feature.

    Attributes
    ----------
    name : str
    nominal_mm : float
        Zero of a deviation of form or direction.
    is_form : bool
        Whether it is a deviation of form or direction, never negative: errors add to it, its tolerance is one-sided.
    """

    name: str
    nominal_mm: float
    is_form: bool = False


@dataclass(frozen=True, eq=False)
class Feature:
    """A feature of a perfect part.

    Attributes
    ----------
    name : str
        Kind and sizes.
    points : (n, 3) array
        Measured points in the arm's base frame [mm].
    approach : (n, 3) array
        Unit vectors from which the stylus approaches.
    quantities : tuple of FeatureQuantity
        A tolerance refers to the first.
    evaluate : callable
        From points (n, 3) [mm] to the value of each quantity [mm].
    """

    name: str
    points: FloatArray
    approach: FloatArray
    quantities: tuple[FeatureQuantity, ...]
    evaluate: Callable[[FloatArray], tuple[float, ...]]

    def errors(self, points: FloatArray) -> FloatArray:
        """Evaluated minus nominal values, (n_quantities,) [mm], of points measured (n, 3) [mm]."""
        return np.array(self.evaluate(points)) - [quantity.nominal_mm for quantity in self.quantities]


def length(ends: npt.ArrayLike, *, points: int = 2) -> Feature:
    """Distance of two places, each the mean of half of the points, measured from above.

    Parameters
    ----------
    ends : (2, 3) array
        [mm]
    points : int
        Number of points, half of them at each end, each in its own posture.
    """
    placed = np.asarray(ends, dtype=float)
    if placed.shape != (2, 3) or not np.isfinite(placed).all():
        raise InputError(f"expected the two ends of a length, (2, 3) in mm, got shape {placed.shape}")
    nominal = _size(float(np.linalg.norm(placed[1] - placed[0])), "distance of the two ends")
    n = _checked(points, "length")
    if n % 2:
        raise InputError(f"expected an even number of points for a length, half of them at each end, got {n}")

    def evaluate(measured: FloatArray) -> tuple[float]:
        return (float(np.linalg.norm(measured[n // 2 :].mean(axis=0) - measured[: n // 2].mean(axis=0))),)

    return Feature(
        f"length of {nominal:g} mm", np.repeat(placed, n // 2, axis=0), np.tile(UP, (n, 1)),
        (FeatureQuantity("length", nominal),), evaluate,
    )  # fmt: skip


def length_at(at: npt.ArrayLike, along: npt.ArrayLike, length_mm: float, *, points: int = 2) -> Feature:
    """A length about its middle `at` (3,) [mm], along a direction (3,)."""
    half = _size(length_mm, "length") / 2 * unit(along)
    middle = _place(at)
    return length([middle - half, middle + half], points=points)


def sphere(at: npt.ArrayLike, diameter_mm: float, *, points: int = 25) -> Feature:
    """Diameter and form of a ball, measured uniformly over its upper half.

    The stylus approaches between the surface normal and straight above, since a ball is not accessible from all sides.
    The form deviation is that of the least-squares sphere: largest minus smallest distance from its centre.
    """
    diameter, n = _size(diameter_mm, "diameter"), _checked(points, "sphere")
    normals = on_sphere(2 * n)[:n]

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        fitted = fit_sphere(measured)
        return 2 * fitted.radius_mm, fitted.form_mm

    return Feature(
        f"ball of {diameter:g} mm diameter, {n} points",
        _place(at) + diameter / 2 * normals,
        _from_above(normals),
        (FeatureQuantity("diameter", diameter), FeatureQuantity("form", 0.0, is_form=True)),
        evaluate,
    )


def plane(at: npt.ArrayLike, normal: npt.ArrayLike, size_mm: float, *, points: int = 25) -> Feature:
    """Flatness and direction of a square plate, measured in rows over all of it.

    Flatness is that of the least-squares plane: largest minus smallest distance from it. The direction is relative to
    the arm's frame: the angle between measured and true normal, as a deviation over the size of the plate.
    """
    size, n = _size(size_mm, "size"), _checked(points, "plane")
    up = unit(normal)

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        fitted = fit_plane(measured)
        return fitted.form_mm, size * _tilt(fitted.normal, up)

    return Feature(
        f"plate of {size:g} x {size:g} mm, {n} points",
        _place(at) + _in_rows(up, size, n),
        np.tile(up, (n, 1)),
        (FeatureQuantity("flatness", 0.0, is_form=True), FeatureQuantity("direction", 0.0, is_form=True)),
        evaluate,
    )


def circle(at: npt.ArrayLike, axis: npt.ArrayLike, diameter_mm: float, *, points: int = 25) -> Feature:
    """Diameter and roundness of a bore, measured around at one height with the stylus along its axis."""
    diameter, n = _size(diameter_mm, "diameter"), _checked(points, "circle")
    up = unit(axis)

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        fitted = fit_circle(measured)
        return 2 * fitted.radius_mm, float(np.ptp(fitted.residuals[:, 0]))

    return Feature(
        f"bore of {diameter:g} mm diameter, {n} points",
        _place(at) + diameter / 2 * _around(up, n),
        np.tile(up, (n, 1)),
        (FeatureQuantity("diameter", diameter), FeatureQuantity("roundness", 0.0, is_form=True)),
        evaluate,
    )


def cylinder(
    at: npt.ArrayLike, axis: npt.ArrayLike, diameter_mm: float, depth_mm: float, *, points: int = 25
) -> Feature:
    """Diameter, cylindricity and direction of a bore, measured around at three heights with the stylus along its axis.

    The direction is relative to the arm's frame: the angle between measured and true axis, as a deviation over the
    depth.
    """
    diameter, depth = _size(diameter_mm, "diameter"), _size(depth_mm, "depth")
    n, up = _checked(points, "cylinder"), unit(axis)

    def evaluate(measured: FloatArray) -> tuple[float, float, float]:
        fitted = fit_cylinder(measured)
        return 2 * fitted.radius_mm, fitted.form_mm, depth * _tilt(fitted.axis, up)

    return Feature(
        f"bore of {diameter:g} mm diameter and {depth:g} mm depth, {n} points",
        _place(at) + diameter / 2 * _around(up, n) + depth * np.outer(_heights(n), up),
        np.tile(up, (n, 1)),
        (
            FeatureQuantity("diameter", diameter),
            FeatureQuantity("cylindricity", 0.0, is_form=True),
            FeatureQuantity("direction", 0.0, is_form=True),
        ),
        evaluate,
    )


def cone(at: npt.ArrayLike, axis: npt.ArrayLike, diameter_mm: float, angle_rad: float, *, points: int = 25) -> Feature:
    """Angle and form of a countersink, measured around at three depths with the stylus along its axis.

    `diameter_mm` is that of its upper edge about `at`; the lowest ring has half of it. The angle (the whole one, as on
    a drawing) is a deviation over the height between the rings.
    """
    diameter, n, up = _size(diameter_mm, "diameter"), _checked(points, "cone"), unit(axis)
    if not MIN_ANGLE_RAD <= angle_rad <= np.pi - MIN_ANGLE_RAD:
        raise InputError(f"expected an angle of a cone of 1 to 179 deg, got {np.degrees(angle_rad):g}")
    share = 0.5 + _heights(n)  # 0 of the lowest ring
    height = diameter / 4 / np.tan(angle_rad / 2)

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        fitted = fit_cone(measured)
        return height * (2 * fitted.half_angle_rad - angle_rad), fitted.form_mm

    return Feature(
        f"countersink of {diameter:g} mm diameter and {np.degrees(angle_rad):g} deg, {n} points",
        _place(at) + (diameter / 4 * (1 + share))[:, None] * _around(up, n) + height * np.outer(share - 1, up),
        np.tile(up, (n, 1)),
        (FeatureQuantity("angle over the height", 0.0), FeatureQuantity("form", 0.0, is_form=True)),
        evaluate,
    )


def plane_distance(
    at: npt.ArrayLike, along: npt.ArrayLike, distance_mm: float, size_mm: float, *, points: int = 24
) -> Feature:
    """Distance and parallelism of two square faces of a block about `at`, half of the points on each.

    Parallelism is the angle between both normals, as a deviation over the size of a face.
    """
    apart, size = _size(distance_mm, "distance"), _size(size_mm, "size")
    n, up = _halved(points, "distance"), unit(along)
    normals = np.repeat([up, -up], n, axis=0)

    def evaluate(measured: FloatArray) -> tuple[float, float]:
        faces = [fit_plane(part) for part in (measured[:n], measured[n:])]
        return distance(*faces).value, size * _tilt(faces[0].normal, faces[1].normal)

    return Feature(
        f"distance of {apart:g} mm of two faces of {size:g} x {size:g} mm, {2 * n} points",
        _place(at) + apart / 2 * normals + np.tile(_in_rows(up, size, n), (2, 1)),
        _from_above(normals),
        (FeatureQuantity("distance", apart), FeatureQuantity("parallelism", 0.0, is_form=True)),
        evaluate,
    )


def plane_angle(
    at: npt.ArrayLike, edge: npt.ArrayLike, angle_rad: float, size_mm: float, *, points: int = 24
) -> Feature:
    """Angle of two square faces that meet in an edge through `at`, as a deviation over their size."""
    size, n, along = _size(size_mm, "size"), _halved(points, "angle"), unit(edge)
    if not MIN_ANGLE_RAD <= angle_rad <= np.pi - MIN_ANGLE_RAD:
        raise InputError(f"expected an angle of two planes of 1 to 179 deg, got {np.degrees(angle_rad):g}")
    across = np.cross(along, UP if abs(along @ UP) < COS_OF_VERTICAL else np.eye(3)[0])
    across = across / np.linalg.norm(across)
    top = np.cross(across, along)
    half = angle_rad / 2
    down = [side * np.sin(half) * across - np.cos(half) * top for side in (1, -1)]  # each face away from the edge
    normals = [side * np.cos(half) * across + np.sin(half) * top for side in (1, -1)]

    def evaluate(measured: FloatArray) -> tuple[float]:
        found = [fit_plane(part).normal for part in (measured[:n], measured[n:])]
        one, other = (normal * np.sign(normal @ like) for normal, like in zip(found, normals, strict=True))
        turned = np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)
        return (size * float(np.pi - turned - angle_rad),)

    faces = [
        _place(at) + size / 2 * away + _in_rows(normal, size, n, along=along)
        for away, normal in zip(down, normals, strict=True)
    ]
    return Feature(
        f"angle of {np.degrees(angle_rad):g} deg of two faces of {size:g} x {size:g} mm, {2 * n} points",
        np.concatenate(faces),
        _from_above(np.repeat(normals, n, axis=0)),
        (FeatureQuantity("angle over the size", 0.0),),
        evaluate,
    )


def unit(direction: npt.ArrayLike) -> FloatArray:
    """A direction (3,) of length one."""
    given = np.asarray(direction, dtype=float)
    size = float(np.linalg.norm(given)) if given.shape == (3,) and np.isfinite(given).all() else 0.0
    if not 0 < size < np.inf:
        raise InputError(f"expected a direction as three numbers, not all zero, got {np.ravel(given).tolist()}")
    return given / size


def _around(up: FloatArray, n: int) -> FloatArray:
    """Unit vectors (n, 3) around an axis."""
    return np.asarray(around(n) @ frame_of(up)[:, :2].T)


def _heights(n: int) -> FloatArray:
    """Three heights from -1/2 to 1/2, one after the other."""
    return np.arange(n) % 3 / 2 - 0.5


def _in_rows(up: FloatArray, size: float, n: int, *, along: FloatArray | None = None) -> FloatArray:
    """Points (n, 3) in rows all over a square about the origin, square to `up`; rows follow `along` if it is given."""
    rows = np.array_split(np.arange(n), max(2, round(np.sqrt(n))))
    places = [
        (x, y)
        for row, y in zip(rows, np.linspace(-0.5, 0.5, len(rows)), strict=True)
        for x in (np.linspace(-0.5, 0.5, len(row)) if len(row) > 1 else [0.0])
    ]
    sides = frame_of(up)[:, :2].T if along is None else np.stack([along, np.cross(up, along)])
    return np.asarray(size * np.array(places) @ sides)


def _from_above(normals: FloatArray) -> FloatArray:
    """Directions (n, 3) between the normals and straight above, as no part is accessible from all sides."""
    approach = normals + UP
    size = np.linalg.norm(approach, axis=1, keepdims=True)
    return np.where(size > MIN_ANGLE_RAD, approach / np.maximum(size, MIN_ANGLE_RAD), UP)


def _tilt(measured: FloatArray, true: FloatArray) -> float:
    """Angle [rad] between two directions up to their signs."""
    return float(np.arctan2(np.linalg.norm(np.cross(measured, true)), abs(measured @ true)))


def _halved(points: int, kind: str) -> int:
    n = _checked(points, kind)
    if n % 2:
        raise InputError(f"expected an even number of points for two planes, half of them on each, got {n}")
    return n // 2


def _place(at: npt.ArrayLike) -> FloatArray:
    given = np.asarray(at, dtype=float)
    if given.shape != (3,) or not np.isfinite(given).all():
        raise InputError(f"expected a place as three finite coordinates in mm, got {np.ravel(given).tolist()}")
    return given


def _size(size_mm: float, what: str) -> float:
    if not MIN_MM <= size_mm < np.inf:
        raise InputError(
            f"expected a {what} of {MIN_MM:g} mm or more, got {size_mm:g}", hint="state it in mm: half a metre is 500"
        )
    return float(size_mm)


def _checked(points: int, kind: str) -> int:
    if not MIN_POINTS[kind] <= points <= MAX_POINTS:
        raise InputError(f"expected {MIN_POINTS[kind]} to {MAX_POINTS} points of a {kind}, got {points}")
    return points
