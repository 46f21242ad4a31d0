"""The minimum circumscribed sphere of points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray

# The work grows with the fourth power of the number: 30 points are 32,000 spheres.
MAX_POINTS = 30


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
        1 to `MAX_POINTS`, anywhere [mm].

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
    if not 1 <= len(given) <= MAX_POINTS:
        raise InputError(f"expected 1 to {MAX_POINTS} points for a circumscribed sphere, got {len(given)}")
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
