"""The minimum zone: the narrowest zone between two shapes of one kind that contains all points.

The Chebyshev fit: the largest distance of a point from the shape in the middle of the zone is minimised, by a sequence
of linear programmes with the derivatives of the distances (G. A. Watson, "Approximation Theory and Numerical Methods",
Wiley 1980, recalled; C. M. Shakarji, A. Clement, "Reference algorithms for Chebyshev and one-sided data fitting for
coordinate metrology", CIRP Ann. 53 (2004) 439, recalled). Form deviations of drawings mean this zone.

The smallest sphere around points, `circumscribed_sphere`, is exact and needs no search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray
from truearm.wings.laboratory.shapes.least_squares_shapes import (
    CYLINDER,
    PLANE,
    SPHERE,
    fit_circle,
    fit_cylinder,
    fit_plane,
    fit_sphere,
)
from truearm.wings.laboratory.shapes.normalised_points import normalise_points
from truearm.wings.laboratory.shapes.orthogonal_regression import Element, Place, frame_of, towards_positive
from truearm.wings.laboratory.shapes.relations import located

# The work grows with the fourth power of the number: 30 points are 32,000 spheres.
MAX_SPHERE_POINTS = 30


@dataclass(frozen=True, eq=False)
class CircumscribedSphere:
    """The minimum circumscribed sphere of points.

    Attributes
    ----------
    centre : (3,) array
        [mm]
    radius_mm : float
    """

    centre: FloatArray
    radius_mm: float

    @property
    def diameter_mm(self) -> float:
        """Twice the radius."""
        return 2 * self.radius_mm


def circumscribed_sphere(points: npt.ArrayLike) -> CircumscribedSphere:
    """Return the smallest sphere that contains all of a few points, exactly.

    Parameters
    ----------
    points : (n, 3) array
        1 to `MAX_SPHERE_POINTS`, anywhere [mm].

    Raises
    ------
    InputError
        If they are not (n, 3) finite numbers, or there are none or too many.

    Notes
    -----
    The two, three or four points that it touches determine the sphere: it is the smallest through them. So its centre
    is among those of all pairs, triples and quadruples; it is the one with the smallest distance to the farthest point.
    There is no tolerance: for coincident, collinear, coplanar or cospherical points some candidates are lost or
    inaccurate, but never the one that is needed.
    """
    given = np.asarray(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 3 or not np.isfinite(given).all():
        raise InputError(f"expected finite points as an array (n, 3), got shape {given.shape}")
    if not 1 <= len(given) <= MAX_SPHERE_POINTS:
        raise InputError(f"expected 1 to {MAX_SPHERE_POINTS} points for a circumscribed sphere, got {len(given)}")
    centres, radii = _spheres(given[None])
    return CircumscribedSphere(centres[0], float(radii[0]))


def circumscribed_diameters(points: FloatArray) -> FloatArray:
    """Return the diameters of the smallest spheres around sets of points (.., n, 3), as `circumscribed_sphere`."""
    return 2 * _spheres(points.reshape(-1, *points.shape[-2:]))[1].reshape(points.shape[:-2])


def _spheres(given: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 3) and radii (m,) of the smallest spheres around m sets of n points, (m, n, 3)."""
    n = given.shape[1]
    middle = (given / n).sum(axis=1, keepdims=True)
    unit = np.abs(given - middle).max(axis=(1, 2), keepdims=True)
    unit[unit == 0] = 1.0
    centred = np.moveaxis((given - middle) / unit, 2, 0).copy()
    centres = np.concatenate([centred[..., :1], *(_centres(centred, k) for k in range(2, min(n, 4) + 1))], axis=2)
    farthest = np.sqrt(((centred[:, :, None] - centres[..., None]) ** 2).sum(axis=0).max(axis=2))
    best = np.where(np.isfinite(farthest), farthest, np.inf).argmin(axis=1)
    rows = np.arange(len(given))
    return middle[:, 0] + unit[:, 0] * centres[:, rows, best].T, unit[:, 0, 0] * farthest[rows, best]


def _centres(points: FloatArray, k: int) -> FloatArray:
    """Centres (3, m, c) of the smallest spheres through any k of n points (3, m, n); not finite where there is none.

    The circumcentre by products of the edges u, v, w from the first point, which lose fewer digits for
    thin triangles and tetrahedra than a linear solve does. Coordinates come first: sums over them are of whole arrays.
    """
    first, *others = (points[..., one] for one in np.array(list(combinations(range(points.shape[2]), k))).T)
    edges = [other - first for other in others]
    square = [(edge * edge).sum(axis=0) for edge in edges]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if k == 2:
            return np.asarray(first + edges[0] / 2)
        u, v = edges[:2]
        across = np.cross(u, v, axis=0)
        if k == 3:
            area = (across * across).sum(axis=0)
            return np.asarray(first + np.cross(square[0] * v - square[1] * u, across, axis=0) / (2 * area))
        w = edges[2]
        volume = (across * w).sum(axis=0)
        towards = square[0] * np.cross(v, w, axis=0) + square[1] * np.cross(w, u, axis=0) + square[2] * across
        return np.asarray(first + towards / (2 * volume))


ZoneKind = Literal["plane", "circle", "sphere", "cylinder"]
MOST_STEPS = 100
# Of the facets of the points' hull, the zones across them that are tried.
MOST_FACETS = 6
# A step that narrows the zone by less than this share is none.
ARRIVED = 1e-12
# Points within this share of the width from its limits touch them.
TOUCHES = 1e-6

# In the plane of the points a zone of circles is that of a cylinder that neither tilts nor turns.
_ELEMENTS: dict[str, Element] = {
    "plane": PLANE,
    "circle": replace(CYLINDER, name="circle", moves=(0, 1)),
    "sphere": SPHERE,
    "cylinder": CYLINDER,
}
_FITS = {"plane": fit_plane, "circle": fit_circle, "sphere": fit_sphere, "cylinder": fit_cylinder}


@dataclass(frozen=True, eq=False)
class MinimumZone:
    """The narrowest zone that contains all points.

    Attributes
    ----------
    kind : {"plane", "circle", "sphere", "cylinder"}
    form_mm : float
        Width of the zone: flatness, roundness, sphericity or cylindricity.
    centre : (3,) array
        Of the sphere or circle, a point of the plane or axis in the middle of the zone [mm].
    axis : (3,) array or None
        Normal of the plane or of the circle's plane, axis of the cylinder; None of a sphere.
    radius_mm : float or None
        Half way between both limits; None of a plane.
    touches : (n,) array of bool
        Which points lie on a limit of the zone.
    """

    kind: str
    form_mm: float
    centre: FloatArray
    axis: FloatArray | None
    radius_mm: float | None
    touches: BoolArray


def minimum_zone(kind: ZoneKind, points: npt.ArrayLike) -> MinimumZone:
    """Return the narrowest zone of planes, circles, spheres or cylinders that contains all points.

    Parameters
    ----------
    kind : {"plane", "circle", "sphere", "cylinder"}
        A circle is that in the least-squares plane of the points, to which they are projected.
    points : (n, 3) array
        As for `fit_plane` and the others, one more at least [mm].

    Raises
    ------
    InputError
        If the kind is another one, or the points do not determine the least-squares shape.

    Notes
    -----
    The search begins at the least-squares shape, of planes at facets of the points' convex hull too, and ends where no
    small move narrows the zone. For points close to the shape, as those of a part are, that is the narrowest of all.

    Examples
    --------
    >>> import truearm as ta
    >>> plate = [[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0], [4, 4, 0.02], [5, 4, 0.01]]
    >>> round(ta.shapes.minimum_zone("plane", plate).form_mm, 4)
    0.02
    """
    if kind not in get_args(ZoneKind):
        raise InputError(f"expected a zone of {', '.join(get_args(ZoneKind))}, got {kind!r}")
    element, normal = _ELEMENTS[kind], normalise_points(points, least=3, shape=kind)
    fit = _FITS[kind](normal.points, std_mm=1.0)
    (at, direction), _ = located(fit)
    sizes = np.array([getattr(fit, "radius_mm", ())]).ravel()
    starts = [Place(at, frame_of(direction) if direction.any() else np.eye(3), sizes)]
    if kind == "plane":
        starts += [Place(at, frame_of(one), sizes) for one in _facets(normal.points)]
    zones = [_narrowed(element, normal.points, start) for start in starts]
    place, half = min(zones, key=lambda zone: zone[1])
    axis = None if kind == "sphere" else towards_positive(place).frame[:, 2]
    distances = np.abs(element.linearised(normal.points, place).residuals)
    return MinimumZone(
        kind=kind,
        form_mm=2 * normal.scale * half,
        centre=normal.middle + normal.scale * place.origin,
        axis=axis,
        radius_mm=float(normal.scale * place.sizes[0]) if len(place.sizes) else None,
        touches=np.asarray(distances > half - TOUCHES * 2 * half - normal.rounding),
    )


def _facets(points: FloatArray) -> FloatArray:
    """Normals (k, 3) of the facets of the hull across which it is thinnest; none of points in one plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        normals = np.asarray(ConvexHull(points).equations[:, :3])
    except QhullError:
        return np.empty((0, 3))
    return normals[np.argsort(np.ptp(points @ normals.T, axis=0))[:MOST_FACETS]]


def _narrowed(element: Element, points: FloatArray, place: Place) -> tuple[Place, float]:
    """The place where no small move narrows the zone, and half of its width."""
    place, half = _centred(element, points, place)
    trust = 0.1
    for _ in range(MOST_STEPS):
        if half <= 8 * np.finfo(float).eps:
            break
        step, narrowed = _best_step(element, points, place, half, trust)
        if half - narrowed <= ARRIVED * half:
            break
        moved, found = _centred(element, points, element.moved(place, step))
        if found < half:
            trust *= 2 if half - found > 0.75 * (half - narrowed) else 1
            place, half = moved, found
        else:
            trust /= 8
            if trust < np.finfo(float).eps:
                break
    return place, half


def _centred(element: Element, points: FloatArray, place: Place) -> tuple[Place, float]:
    """The place with its shape in the middle of its zone, and half of the width."""
    distances = element.linearised(points, place).residuals
    low, high = float(distances.min()), float(distances.max())
    shift = (low + high) / 2
    if element.is_length:
        return place._replace(sizes=place.sizes + shift), (high - low) / 2
    return place._replace(origin=place.origin + shift * place.frame[:, 2]), (high - low) / 2


def _best_step(
    element: Element, points: FloatArray, place: Place, half: float, trust: float
) -> tuple[FloatArray, float]:
    """The step within `trust` that narrows the linearised zone most, and half of its width then."""
    from scipy.optimize import linprog

    at = element.linearised(points, place)
    # All numbers in units of the zone: the programme's tolerances are absolute.
    d, J = at.residuals / half, at.jacobian
    n, p = J.shape
    one = np.ones((n, 1))
    result = linprog(
        np.r_[np.zeros(p), 1.0],
        A_ub=np.block([[J, -one], [-J, -one]]),
        b_ub=np.concatenate([-d, d]),
        bounds=[(-trust / half, trust / half)] * p + [(0, None)],
        method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if result.x is None:
        return np.zeros(p), half
    return half * result.x[:p], half * float(result.x[p])
