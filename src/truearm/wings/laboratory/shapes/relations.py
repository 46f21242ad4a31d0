"""Relations of two fitted shapes: angle, distance, parallelism, perpendicularity, concentricity, with uncertainties.

Each is the length of a vector, or a signed number, of the parameters of both shapes; their covariances are propagated
to first order (JCGM 100:2008, 5.1.2). The points of the two shapes scatter independently.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.least_squares_shapes import Circle, Cone, Cylinder, Line, Plane, Sphere, Torus
from truearm.wings.laboratory.shapes.orthogonal_regression import ShapeFit

Directed: TypeAlias = Plane | Line | Circle | Cylinder | Cone | Torus
# Planes and axes at a larger angle have no distance that a drawing could mean.
PARALLEL_RAD = np.radians(5.0)


class Relation(NamedTuple):
    """A relation of two shapes.

    Attributes
    ----------
    value : float
        [mm, or rad of an angle]
    u : float
        Standard uncertainty by the scatter of the points, to first order; NaN where a shape has no covariance. Of a
        length near zero, that of its largest component.
    """

    value: float
    u: float


class Located(NamedTuple):
    """Place (3,) and direction (3,) of a shape; the direction of a sphere is zero."""

    place: FloatArray
    direction: FloatArray


def angle(one: Directed, other: Directed) -> Relation:
    """Return the angle between two planes, two axes, or a plane and an axis, 0 to pi/2 [rad].

    Parameters
    ----------
    one, other : Plane, Line, Circle, Cylinder, Cone or Torus
        Of a circle and a torus the axis.

    Raises
    ------
    InputError
        If one is a sphere, which has no direction.

    Examples
    --------
    >>> import numpy as np, truearm as ta
    >>> floor = ta.shapes.fit_plane([[0, 0, 0], [1, 0, 0], [0, 1, 0]], std_mm=0.01)
    >>> wall = ta.shapes.fit_plane([[0, 0, 0], [1, 0, 0], [0, 0, 1]], std_mm=0.01)
    >>> round(np.degrees(ta.shapes.angle(floor, wall).value), 9)
    90.0
    """
    if isinstance(one, Sphere) or isinstance(other, Sphere):
        raise InputError("expected two shapes with directions, got a sphere", hint="measure a plane, a line or an axis")
    found = _length(turn, one, other)
    if isinstance(one, Plane) != isinstance(other, Plane):
        return Relation(float(np.pi / 2 - found.value), found.u)
    return found


def parallelism(one: Directed, other: Directed, length_mm: float) -> Relation:
    """Return how far two planes or axes are from parallel over a length [mm]: length times sine of their angle."""
    found = angle(one, other)
    return Relation(length_mm * float(np.sin(found.value)), length_mm * float(np.cos(found.value)) * found.u)


def perpendicularity(one: Directed, other: Directed, length_mm: float) -> Relation:
    """Return how far two planes or axes are from square over a length [mm]: length times cosine of their angle."""
    found = angle(one, other)
    return Relation(length_mm * float(np.cos(found.value)), length_mm * float(np.sin(found.value)) * found.u)


def distance(one: Directed | Sphere, other: Directed | Sphere) -> Relation:
    """Return the distance of two shapes [mm].

    Parameters
    ----------
    one, other : shapes
        Spheres, circles and tori count as their centres, cones as their apices, lines and cylinders as their axes. Of
        two planes it is the distance half way between their points, of two axes the shortest, of parallel ones that of
        their points across them.

    Raises
    ------
    InputError
        If two planes, or a plane and an axis, are not parallel within 5 deg.
    """
    planes = [isinstance(shape, Plane) for shape in (one, other)]
    axes = [isinstance(shape, Line | Cylinder) for shape in (one, other)]
    if planes[1] and not planes[0]:
        return distance(other, one)
    if planes[0]:
        if (planes[1] or axes[1]) and (found := angle(one, other).value) > PARALLEL_RAD:  # type: ignore[arg-type]
            raise InputError(
                f"expected parallel shapes for a distance, got an angle of {np.degrees(found):.1f} deg",
                hint="measure the angle, or the distance of a point from the plane",
            )
        return _length(between_planes if planes[1] else from_plane, one, other)
    if all(axes):
        skew = angle(one, other).value > PARALLEL_RAD  # type: ignore[arg-type]
        return _length(between_skew if skew else across_axis, one, other)
    return (
        _length(across_axis, other, one)
        if axes[1]
        else _length(across_axis if axes[0] else between_centres, one, other)
    )


def concentricity(one: Directed | Sphere, other: Directed | Sphere) -> Relation:
    """Return twice the distance of two centres or axes [mm]: the diameter of the zone about the first.

    Raises
    ------
    InputError
        If one is a plane, which has no centre.
    """
    if isinstance(one, Plane) or isinstance(other, Plane):
        raise InputError("expected two shapes with centres or axes, got a plane", hint="distance or parallelism")
    found = distance(one, other)
    return Relation(2 * found.value, 2 * found.u)


def turn(one: Located, other: Located) -> FloatArray:
    """Rotation vector between two directions."""
    across = np.cross(one.direction, other.direction)
    sine, cosine = float(np.linalg.norm(across)), float(one.direction @ other.direction)
    turned = np.arctan2(sine, cosine) / sine if sine > 0 else 1.0
    return np.asarray(turned * across)


def between_centres(one: Located, other: Located) -> FloatArray:
    """Vector from one place to the other."""
    return other.place - one.place


def from_plane(plane: Located, other: Located) -> FloatArray:
    """Signed distance (1,) of a place from a plane."""
    return np.array([plane.direction @ (other.place - plane.place)])


def between_planes(one: Located, other: Located) -> FloatArray:
    """Distance (1,) of two planes, with normals to one side, half way between their points."""
    return np.array([(one.direction + other.direction) / 2 @ (other.place - one.place)])


def across_axis(axis: Located, other: Located) -> FloatArray:
    """Vector from an axis to a place, across it."""
    away = other.place - axis.place
    return np.asarray(away - (away @ axis.direction) * axis.direction)


def between_skew(one: Located, other: Located) -> FloatArray:
    """Signed shortest distance (1,) of two axes."""
    across = np.cross(one.direction, other.direction)
    return np.array([across @ (other.place - one.place) / np.linalg.norm(across)])


def _length(vector: Callable[[Located, Located], FloatArray], one: ShapeFit, other: ShapeFit) -> Relation:
    """The length of a vector of two shapes, its uncertainty by differences of it."""
    (a, C_a), (b, C_b) = located(one), located(other)
    at = np.concatenate([*a, *b])
    # Directions have no sign: the second one to the side of the first, and there in all differences.
    side = -1.0 if a.direction @ b.direction < 0 else 1.0
    steps = np.diag(np.tile([1e-3, 1e-3, 1e-3, 1e-6, 1e-6, 1e-6], 2))

    def moved(step: FloatArray) -> FloatArray:
        p = at + step
        return vector(Located(p[:3], p[3:6]), Located(p[6:9], side * p[9:]))

    D = np.column_stack([(moved(step) - moved(-step)) / (2 * step.max()) for step in steps])
    value = moved(np.zeros(12))
    size = float(np.linalg.norm(value))
    covariance = D[:, :6] @ C_a @ D[:, :6].T + D[:, 6:] @ C_b @ D[:, 6:].T
    if not np.isfinite(covariance).all():
        return Relation(size, np.nan)
    largest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    along = value / size if size > largest else None
    return Relation(size, largest if along is None else float(np.sqrt(along @ covariance @ along)))


def located(shape: ShapeFit) -> tuple[Located, FloatArray]:
    """Return place and direction of a shape, and their covariance (6, 6)."""
    names = [("point", "centre", "apex"), ("normal", "axis", "direction")]
    place, direction = (
        next((np.asarray(getattr(shape, name)) for name in of if hasattr(shape, name)), np.zeros(3)) for of in names
    )
    covariance, n = np.zeros((6, 6)), 3 if isinstance(shape, Sphere) else 6
    covariance[:n, :n] = shape.covariance[:n, :n]
    return Located(place, direction), covariance
