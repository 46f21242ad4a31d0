"""Where the fit of a shape begins: centres and axes on all sides, judged by algebraic fits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np

from truearm.typing import FloatArray, IntArray
from truearm.wings.laboratory.shapes.normalised_points import NormalisedPoints
from truearm.wings.laboratory.shapes.orthogonal_regression import Place, cross

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
