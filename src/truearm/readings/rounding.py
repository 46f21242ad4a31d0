"""Rounding of joint angles, from the angles themselves: all are whole steps apart.

Digits of a file, counts of an encoder or a controller's display: the largest step of which all differences between
the values of a joint are multiples. An error of rounding to a step s is uniform, of standard uncertainty
``s / sqrt(12)`` (JCGM 100:2008, F.2.2.1).
"""

from __future__ import annotations

import numpy as np

from truearm.typing import FloatArray

# With fewer different values a step may be chance, or that of a plan.
LEAST_VALUES = 10
# Larger steps [rad or mm] are those of a plan: no encoder reads in whole degrees.
LARGEST_STEP = 0.0175
# Smaller ones are below the noise of any arm [rad or mm]: 3 um at the end of two metres.
LEAST_STEP = 5e-6
# The nearest two values are no more steps apart: of forty values among a hundred thousand steps some sixty.
MOST_STEPS = 200
# Values differ from whole steps by up to this share of one, where counts were written in degrees with few decimals; by
# chance ten values would in one case of ten million.
MOST_OFF = 0.1
# A step becomes sharper from the nearest values to the farthest in so many turns.
REACHES = 12


def rounding_steps(angles: FloatArray) -> FloatArray:
    """Step to which the angles of each joint are rounded [rad, or mm]; 0 where none is seen.

    Parameters
    ----------
    angles : (n, n_joints) array
        [rad, or mm], as they were read.

    Examples
    --------
    >>> import numpy as np
    >>> angles = np.deg2rad(np.round(np.random.default_rng(1).uniform(-90, 90, (50, 2)), [1, 5]))
    >>> np.rad2deg(rounding_steps(angles)).round(6).tolist()
    [0.1, 0.0]
    """
    return np.array([_step(np.unique(values)) for values in np.asarray(angles).T])


def _step(values: FloatArray) -> float:
    """Common step of rising values; 0 if there is none."""
    differences: FloatArray = np.diff(values)
    differences = differences[differences > LEAST_STEP]
    if len(values) < LEAST_VALUES or not len(differences):
        return 0.0
    from_first, nearest = values - values[0], float(differences.min())
    for n in range(1, MOST_STEPS + 1):
        if step := _sharpened(nearest / n, from_first):
            return step if step <= LARGEST_STEP else 0.0
    return 0.0


def _sharpened(step: float, values: FloatArray) -> float:
    """A step near `step` of which all values, rising from 0, are multiples; 0 if there is none."""
    if step < LEAST_STEP:
        return 0.0
    for reach in np.geomspace(max(10 * step, float(values[1])), float(values[-1]), REACHES):
        near = values[: np.searchsorted(values, 1.0001 * reach)]
        multiples = np.round(near / step)
        step = float(near @ multiples / max(float(multiples @ multiples), 1.0)) or step
        if np.abs(near - step * multiples).max() > MOST_OFF * step:
            return 0.0
    return step
