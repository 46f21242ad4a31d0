"""The rigid motion between two sets of corresponding points, and small ones of one set."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.readings.session import Session
from truearm.typing import FloatArray

# With a third of the points wrong a fifth of the triples or more are right: that none of so many is has odds of 2e-8.
TRIPLES = 80
# In units of the median distance; of Gaussian points one in ten thousand is farther.
FARTHEST_OF_MOST = 3.0


def align(points_in_b: FloatArray, points_in_a: FloatArray) -> FloatArray:
    """The rigid motion ``T_a_b`` that brings points nearest, in least squares, to where they stand in frame a.

    Source: K. S. Arun, T. S. Huang, S. D. Blostein, IEEE PAMI 9 (1987) 698; S. Umeyama, IEEE PAMI 13 (1991) 376 (the
    sign that keeps the result a rotation). Where the points lie on a line the turn about it is arbitrary.

    Parameters
    ----------
    points_in_b, points_in_a : (n, 3) array
        The same points in both frames [mm].

    Returns
    -------
    (4, 4) array
        Translation in mm.
    """
    centre_b, centre_a = points_in_b.mean(axis=0), points_in_a.mean(axis=0)
    U, _, Vt = np.linalg.svd((points_in_a - centre_a).T @ (points_in_b - centre_b))
    U[:, -1] *= np.sign(np.linalg.det(U @ Vt))
    T = np.eye(4)
    T[:3, :3] = U @ Vt
    T[:3, 3] = centre_a - T[:3, :3] @ centre_b
    return T


def rigid_motions(points: npt.ArrayLike, *, scale: bool = False) -> FloatArray:
    """Shifts of points by small rigid motions of all of them, about their mean and of like size.

    Parameters
    ----------
    points : (n, 3) array
        [mm].
    scale : bool
        Whether a growth of all distances alike counts as one.

    Returns
    -------
    (3 n, 6) array, (3 n, 7) with the scale
        Three shifts, three turns, the growth.

    Raises
    ------
    InputError
        If the points are none, not finite or of another shape.
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
    """The rigid motion `align` of most of the points, whatever the others do.

    Of motions by three points each, drawn at random, the one that leaves the least median distance tells which points
    go together: those not farther than `FARTHEST_OF_MOST` times that. Source: P. J. Rousseeuw, "Least median of squares
    regression", J. Am. Stat. Assoc. 79 (1984) 871.

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
    for _ in range(TRIPLES):
        some = rng.permutation(len(points_in_a))[:3]
        T = align(points_in_b[some], points_in_a[some])
        off = np.linalg.norm(points_in_b @ T[:3, :3].T + T[:3, 3] - points_in_a, axis=1)
        if np.median(off) < least:
            least, best = float(np.median(off)), off
    together = best <= FARTHEST_OF_MOST * least
    return align(points_in_b[together], points_in_a[together])


def rms_distance_from_line(points: FloatArray) -> float:
    """Root mean square distance of points (n, 3) from the line that fits them best [mm].

    About a line on which all points lie, an alignment may turn as it likes.
    """
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(np.sqrt((values[1:] ** 2).sum() / len(points)))


def place_base_coarsely(chain: Chain, readings: Session, free: tuple[str, ...]) -> Chain:
    """The chain moved as a whole to where its tips come nearest to the readings' points, if its base is free."""
    if "base" not in free or readings.points is None:
        return chain
    seen = readings.has_point
    return chain.with_reference_frame(align(chain.tip_in_base(readings.angles[seen]), readings.points[seen]))
