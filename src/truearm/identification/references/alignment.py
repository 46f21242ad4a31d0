"""Rigid motions between two sets of corresponding points, and small rigid motions of one set."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray

# With a third of the points wrong, at least a fifth of the triples are right: all of 80 triples are wrong with a
# probability of 2e-8.
TRIPLES = 80
# In units of the median distance; one Gaussian point in ten thousand is farther.
MAX_DISTANCE = 3.0


def align(points_in_b: FloatArray, points_in_a: FloatArray) -> FloatArray:
    """The rigid motion ``T_a_b`` of least squares that maps points in frame b to the same points in frame a.

    Source: K. S. Arun, T. S. Huang, S. D. Blostein, IEEE PAMI 9 (1987) 698. Where the points lie on a line, the
    rotation about it is arbitrary, and that of a single point is none.

    Parameters
    ----------
    points_in_b, points_in_a : (.., n, 3) array
        The same points in both frames [mm].

    Returns
    -------
    (.., 4, 4) array
        Translation in mm.
    """
    centre_b, centre_a = points_in_b.mean(axis=-2, keepdims=True), points_in_a.mean(axis=-2, keepdims=True)
    U, _, Vt = np.linalg.svd((points_in_a - centre_a).swapaxes(-1, -2) @ (points_in_b - centre_b))
    U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    T = np.zeros((*U.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., 3, 3] = U @ Vt, 1.0
    T[..., :3, 3:] = centre_a.swapaxes(-1, -2) - T[..., :3, :3] @ centre_b.swapaxes(-1, -2)
    return T


def rigid_motions(points: npt.ArrayLike, *, scale: bool = False) -> FloatArray:
    """Displacements of points by small rigid motions of all of them, about their mean and scaled to similar size.

    Parameters
    ----------
    points : (n, 3) array
        [mm].
    scale : bool
        Whether to include a common scale of all distances.

    Returns
    -------
    (3 n, 6) array, (3 n, 7) with the scale
        Three translations, three rotations, the scale.

    Raises
    ------
    InputError
        If there are no points, or they are not finite or have another shape.
    """
    where = np.asarray(points, dtype=float)
    if where.ndim != 2 or where.shape[1] != 3 or not len(where) or not np.isfinite(where).all():
        raise InputError(f"expected finite points of shape (n, 3), got {where.shape}")
    apart = where - where.mean(axis=0)
    apart /= np.abs(apart).max() or 1.0
    turns = np.cross(np.eye(3)[None], apart[:, None]).transpose(0, 2, 1)
    motions = [np.tile(np.eye(3), (len(where), 1, 1)), turns, *([apart[:, :, None]] if scale else [])]
    return np.concatenate(motions, axis=2).reshape(3 * len(where), -1)


def align_robust(points_in_b: FloatArray, points_in_a: FloatArray) -> FloatArray:
    """The rigid motion `align` of the majority of the points; outliers have no influence.

    Among the motions of random triples of points, the one with the least median distance selects the points: those
    within `MAX_DISTANCE` times that distance, and the three nearest in any case. Source: P. J. Rousseeuw, "Least
    median of squares regression", J. Am. Stat. Assoc. 79 (1984) 871.

    Parameters
    ----------
    points_in_b, points_in_a : (n, 3) array
        The same points in both frames [mm]; three or more.

    Returns
    -------
    (4, 4) array
        Translation in mm.
    """
    rng = np.random.default_rng(0)
    least, best = np.inf, np.zeros(len(points_in_a))
    some = np.array([rng.permutation(len(points_in_a))[:3] for _ in range(TRIPLES)])
    for T in align(points_in_b[some], points_in_a[some]):
        off = np.linalg.norm(points_in_b @ T[:3, :3].T + T[:3, 3] - points_in_a, axis=1)
        if np.median(off) < least:
            least, best = float(np.median(off)), off
    # Two points leave the rotation about their line open; without noise, distances of right points are rounding.
    together = best <= max(MAX_DISTANCE * least, np.partition(best, 2)[2])
    return align(points_in_b[together], points_in_a[together])


def rms_distance_from_line(points: FloatArray) -> float:
    """Root mean square distance of points (n, 3) from the line that fits them best [mm].

    An alignment of points on a line leaves the rotation about it open.
    """
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(np.sqrt((values[1:] ** 2).sum() / len(points)))
