"""Rows of a foreign table that are no readings: targets that were lost, and statistics below the last reading."""

from __future__ import annotations

import numpy as np

from truearm.typing import BoolArray, FloatArray

# What programs write for a point that they did not see, beside three zeros: all coordinates alike.
NO_POINT = [-1.0, -99.0, *(s * v for s in (-1.0, 1.0) for v in (999.0, 999.9, 999.99, 9999.0, 99999.0, 999999.0))]
# No tip is as far away [table's unit]; 9.9E+37 and 1e30 are "no value" of several instruments.
FAR_AWAY = 1e15
# A point this near the origin makes another of three zeros possible [share of the largest distance].
NEAR_ORIGIN = 1e-3
# A row of means differs from the means of the rows above by its rounding [share of a column's standard deviation]; that
# a reading does so in all columns by chance is impossible for a handful of columns.
OF_A_MEAN = 1e-3
FEWEST_ABOVE = 4


def lost_targets(points: FloatArray) -> BoolArray:
    """(n,) Which of (n, 3) points are no points: three zeros away from all others, or a number that says so."""
    if not len(points):
        return np.zeros(0, bool)
    alike = np.all(points == points[:, :1], axis=1)
    said = alike & np.isin(points[:, 0], NO_POINT)
    far = (np.abs(points) > FAR_AWAY).any(axis=1)
    zero = np.all(points == 0, axis=1)
    seen = np.linalg.norm(points[~(zero | said | far | np.isnan(points).any(axis=1))], axis=1)
    if not len(seen) or seen.min() < NEAR_ORIGIN * seen.max():
        zero[:] = False
    return np.asarray(said | far | zero)


def mean_row(numbers: FloatArray) -> bool:
    """Whether the last of (n, k) rows, n above 4 and k above 3, holds the means of the rows above."""
    above, last = numbers[:-1], numbers[-1]
    moves = np.ptp(above, axis=0) > 0 if len(above) else np.zeros(numbers.shape[1], bool)
    if len(above) < FEWEST_ABOVE or np.count_nonzero(moves) < 4 or np.isnan(numbers[:, moves]).any():
        return False
    off = np.abs(last - above.mean(axis=0))[moves]
    return bool((off <= OF_A_MEAN * above.std(axis=0)[moves]).all())
