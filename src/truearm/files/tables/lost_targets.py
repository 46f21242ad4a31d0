"""Points that an instrument wrote while it saw no target: the same number for every coordinate."""

from __future__ import annotations

import numpy as np

from truearm.typing import BoolArray, FloatArray

# What instruments and their programs write; a coordinate of 1e15 is beyond every instrument.
SIGNS = (0.0, -1.0, 999.0, -999.0, 999.9, -999.9, 999.99, -999.99, 9999.0, -9999.0, 99999.0, -99999.0)
BEYOND = 1e15


def lost_targets(points: FloatArray) -> BoolArray:
    """Say which of (n, 3) points are no points, because all coordinates are one and the same sign of a lost target.

    Examples
    --------
    >>> lost_targets(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0], [-9999, -9999, -9999], [1e30, 1e30, 1e30]])).tolist()
    [True, False, True, True]
    """
    same = (points == points[:, :1]).all(axis=1)
    return np.asarray(same & (np.isin(points[:, 0], SIGNS) | (np.abs(points[:, 0]) >= BEYOND)), dtype=bool)
