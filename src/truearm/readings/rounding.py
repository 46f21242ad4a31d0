"""Rounding of joint angles, from the angles themselves: all are whole steps apart.

Digits of a file, counts of an encoder or a controller's display: the largest step of which all differences between
the values of a joint are multiples. An error of rounding to a step s is uniform, of standard uncertainty
``s / sqrt(12)`` (JCGM 100:2008, F.2.2.1).
"""

from __future__ import annotations

import numpy as np

from truearm.typing import BoolArray, FloatArray

# With fewer different values a step may be chance, or that of a plan.
LEAST_VALUES = 10
# Larger steps [rad; mm] are those of a plan: no encoder reads in whole degrees, and no scale of an axis above whole mm.
LARGEST_STEP, LARGEST_STEP_MM = 0.0175, 1.01
# Smaller ones are below the noise of any arm [rad; mm]: 3 um at the end of two metres, 0.5 um of an axis.
LEAST_STEP, LEAST_STEP_MM = 5e-6, 5e-4
# The nearest two values are no more steps apart: of forty values among a hundred thousand steps some sixty.
MOST_STEPS = 200
# Values differ from whole steps by up to this share of one, where counts were written in degrees with few decimals; by
# chance ten values would in one case of ten million.
MOST_OFF = 0.1
# A step becomes sharper from the nearest values to the farthest in so many turns.
REACHES = 12
# By this number of values steps are refused, all at once, before the others are tried on all values.
FEW = 40


def rounding_steps(angles: FloatArray, is_prismatic: BoolArray | None = None) -> FloatArray:
    """Step to which the angles of each joint are rounded [rad, or mm]; 0 where none is seen.

    Parameters
    ----------
    angles : (n, n_joints) array
        [rad, or mm], as they were read.
    is_prismatic : (n_joints,) bool array, optional
        Which joints slide; by default all turn.

    Examples
    --------
    >>> import numpy as np
    >>> angles = np.deg2rad(np.round(np.random.default_rng(1).uniform(-90, 90, (50, 2)), [1, 5]))
    >>> np.rad2deg(rounding_steps(angles)).round(6).tolist()
    [0.1, 0.0]
    """
    angles = np.asarray(angles)
    slides = np.zeros(angles.shape[1], dtype=bool) if is_prismatic is None else is_prismatic
    limits = [(LEAST_STEP_MM, LARGEST_STEP_MM) if one else (LEAST_STEP, LARGEST_STEP) for one in slides]
    return np.array([_step(np.unique(values), *of) for values, of in zip(angles.T, limits, strict=True)])


def _step(values: FloatArray, least: float, largest: float) -> float:
    """Common step of rising values; 0 if there is none."""
    differences: FloatArray = np.diff(values)
    differences = differences[differences > least]
    if len(values) < LEAST_VALUES or not len(differences):
        return 0.0
    from_first, nearest = values - values[0], float(differences.min())
    steps = nearest / np.arange(1, MOST_STEPS + 1)
    for one in _possible(steps[steps >= least], from_first):
        if step := _sharpened(float(one), from_first):
            return step if step <= largest else 0.0
    return 0.0


def _possible(steps: FloatArray, values: FloatArray) -> FloatArray:
    """Steps of which the first few values may be multiples; the others `_sharpened` refuses by these values alone."""
    few = values[:FEW]
    reaches = np.geomspace(np.maximum(10 * steps, values[1]), values[-1], REACHES)
    left, sharper = np.arange(len(steps)), steps
    refused = np.zeros(len(steps), dtype=bool)
    for reach in 1.0001 * reaches:
        within = reach[left] <= few[-1]
        left, sharper = left[within], sharper[within]
        near = np.where(few < reach[left, None], few, 0.0)
        multiples = np.round(near / sharper[:, None])
        sharpened = (near * multiples).sum(axis=1) / np.maximum((multiples**2).sum(axis=1), 1.0)
        sharper = np.where(sharpened > 0, sharpened, sharper)
        off = np.abs(near - sharper[:, None] * multiples).max(axis=1, initial=0.0) > (MOST_OFF + 1e-9) * sharper
        refused[left[off]] = True
        left, sharper = left[~off], sharper[~off]
    return steps[~refused]


def _sharpened(step: float, values: FloatArray) -> float:
    """A step near `step` of which all values, rising from 0, are multiples; 0 if there is none."""
    for reach in np.geomspace(max(10 * step, float(values[1])), float(values[-1]), REACHES):
        near = values[: np.searchsorted(values, 1.0001 * reach)]
        multiples = np.round(near / step)
        step = float(near @ multiples / max(float(multiples @ multiples), 1.0)) or step
        if np.abs(near - step * multiples).max() > MOST_OFF * step:
            return 0.0
    return step
