"""Where the joints stood when a model learned: between their least and largest angles there may be gaps."""

from __future__ import annotations

import numpy as np

from truearm.typing import BoolArray, FloatArray

# An angle this near to one that the model learned from is no other [rad, of a sliding joint as a share of its range]:
# a gear's errors of order 80 turn by a quarter of their period in 1.1 degrees.
LEAST_TURN = float(np.radians(1.0))
LEAST_SLIDE = 0.01


def find_angle_gaps(angles: FloatArray, slides: BoolArray) -> FloatArray:
    """Gaps between a joint's training angles that are wide for their number.

    Of n angles spread evenly at random over a range, the largest gap is ``range * ln(n) / n`` or so. A gap counts from
    three times that on; an angle within half as much of a training angle is not in it.

    Parameters
    ----------
    angles : (n, n_joints) array
        [rad, or mm].
    slides : (n_joints,) bool array

    Returns
    -------
    (k, 3) array
        The joint, counted from 0, and where its gap begins and ends [rad, or mm].
    """
    found = [np.zeros((0, 3))]
    n = len(angles)
    for joint, slide in enumerate(slides):
        stood = np.unique(angles[:, joint])
        span = float(stood[-1] - stood[0])
        near = max(LEAST_SLIDE * span if slide else LEAST_TURN, 1.5 * span * np.log(n) / n)
        wide = np.flatnonzero(np.diff(stood) > 2 * near)
        found.append(np.stack([np.full(len(wide), float(joint)), stood[wide] + near, stood[wide + 1] - near], axis=1))
    return np.concatenate(found)


def outside_ranges(angles: FloatArray, ranges: FloatArray, gaps: FloatArray) -> BoolArray:
    """(n,) True where a joint is beyond its range (n_joints, 2), or in one of the gaps."""
    lower, upper = ranges.T
    away = ((angles < lower) | (angles > upper)).any(axis=1)
    for joint, begin, end in gaps:
        at = angles[:, int(joint)]
        away |= (at > begin) & (at < end)
    return np.asarray(away)
