"""The order of poses that moves the joints little: a short path through them.

The path begins at any pose, goes to the nearest that is left, and is improved by reversals of a piece (2-opt) and by
moves of pieces of one to three poses to another place (or-opt), until neither shortens it. Sources: G. A. Croes, "A
method for solving traveling-salesman problems", Operations Research 6 (1958) 791; I. Or, thesis, Northwestern
University 1976 [recalled].
"""

from __future__ import annotations

import numpy as np

from truearm.arm import Arm
from truearm.typing import FloatArray, IntArray, NameArray

# Smallest gain of a change, as a share of the path: rounding must not go on for ever.
_LEAST = 1e-9
_LONGEST_PIECE = 3
# Starts times points: of few points every one is tried as the first.
_WORK = 600


def joint_moves(arm: Arm, start: FloatArray, end: FloatArray) -> FloatArray:
    """Largest move of a joint from poses to others, (...) for angles (..., n_joints) [rad].

    A joint without limits goes the shorter way round. Sliding joints are not counted.
    """
    move = np.abs(end - start)
    whole = np.isinf(arm.limits).all(axis=1)
    move = np.where(whole, np.minimum(move % (2 * np.pi), -move % (2 * np.pi)), move)
    return np.asarray(np.where(arm.chain.is_prismatic, 0.0, move).max(axis=-1))


def mean_joint_move(arm: Arm, angles: FloatArray) -> float:
    """Mean over the moves from pose to pose of the largest move of a joint [rad]; 0 for a single pose."""
    return float(joint_moves(arm, angles[:-1], angles[1:]).mean()) if len(angles) > 1 else 0.0


def shortest_path(distances: FloatArray, first: FloatArray | None = None) -> IntArray:
    """Find a short path through all points, from any of them to any other.

    Parameters
    ----------
    distances : (n, n) array
        Symmetric.
    first : (n,) array, optional
        Distance from where the path comes from to each point; zeros by default.

    Returns
    -------
    (n,) int array
        The points in the order of the path. No reversal of a piece and no move of up to three points shortens it.
    """
    n = len(distances)
    # Point n is where the path comes from, point n + 1 where it goes on to: anywhere.
    all_points = np.zeros((n + 2, n + 2))
    all_points[:n, :n] = distances
    if first is not None:
        all_points[n, :n] = all_points[:n, n] = first
    starts = np.unique(np.linspace(0, n - 1, int(np.clip(_WORK // n, 1, n))).round()).astype(int).tolist()
    paths = (_improved(_nearest_neighbours(all_points, start), all_points) for start in starts)
    return min(paths, key=lambda path: _length(path, all_points))[1:-1]


def order_of_few_moves(arm: Arm, angles: FloatArray, seat: NameArray | None = None) -> IntArray:
    """Order poses so that the joints move little: those of one seat in a row, the seats in their order.

    Parameters
    ----------
    arm : Arm
    angles : (n, n_joints) array
        [rad, or mm].
    seat : (n,) array of str, optional
        All poses are in one row without it.

    Returns
    -------
    (n,) int array
    """
    names = np.full(len(angles), "") if seat is None else seat
    order: list[int] = []
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name)
        here = angles[rows]
        first = joint_moves(arm, angles[order[-1]], here) if order else None
        order += rows[shortest_path(joint_moves(arm, here[:, None], here), first)].tolist()
    return np.array(order, dtype=np.intp)


def _nearest_neighbours(distances: FloatArray, start: int) -> IntArray:
    n = len(distances) - 2
    path, left = [n, start], set(range(n)) - {start}
    while left:
        path.append(min(left, key=lambda point: (distances[path[-1], point], point)))
        left.remove(path[-1])
    return np.array([*path, n + 1], dtype=np.intp)


def _improved(path: IntArray, distances: FloatArray) -> IntArray:
    tolerance = _LEAST * max(_length(path, distances), 1e-300)
    while True:
        changed = _reversed_piece(path, distances, tolerance)
        if changed is None:
            changed = _moved_piece(path, distances, tolerance)
        if changed is None:
            return path
        path = changed


def _reversed_piece(path: IntArray, distances: FloatArray, tolerance: float) -> IntArray | None:
    """The path with the piece reversed whose reversal shortens it most."""
    a, b = path[:-1], path[1:]  # edges; piece i + 1 .. j between edges i and j
    gain = distances[a, b][:, None] + distances[a, b] - distances[np.ix_(a, a)] - distances[np.ix_(b, b)]
    gain[np.tril_indices(len(a), 1)] = -np.inf
    i, j = divmod(int(np.argmax(gain)), len(a))
    if gain[i, j] <= tolerance:
        return None
    return np.concatenate([path[: i + 1], path[i + 1 : j + 1][::-1], path[j + 1 :]])


def _moved_piece(path: IntArray, distances: FloatArray, tolerance: float) -> IntArray | None:
    """The path with a piece of up to three points at another place, the first that shortens it."""
    for size in range(1, min(_LONGEST_PIECE, len(path) - 3) + 1):
        for at in range(1, len(path) - size):
            piece, rest = path[at : at + size], np.delete(path, np.s_[at : at + size])
            gone = distances[path[at - 1], piece[0]] + distances[piece[-1], path[at + size]]
            gone -= distances[path[at - 1], path[at + size]]
            for turned in (piece, piece[::-1]):
                added = distances[rest[:-1], turned[0]] + distances[turned[-1], rest[1:]]
                added -= distances[rest[:-1], rest[1:]]
                if gone - added.min() > tolerance:
                    return np.insert(rest, int(np.argmin(added)) + 1, turned)
    return None


def _length(path: IntArray, distances: FloatArray) -> float:
    return float(distances[path[:-1], path[1:]].sum())
