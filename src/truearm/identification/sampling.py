"""Joint angles that fill ranges of the joints."""

from __future__ import annotations

import numpy as np

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.typing import FloatArray, IntArray


def joint_travel_limits(arm: Arm, *, slides: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Lower and upper ends of the joint ranges [rad, or mm].

    A rotary joint without limits gets one full turn about its working pose; with one limit, a full turn from it.

    Parameters
    ----------
    arm : Arm
    slides : (n_joints, 2) array, optional
        Lower and upper ends of prismatic joints without limits [mm].

    Raises
    ------
    InputError
        If a prismatic joint has no limits, and none are stated.
    """
    lower, upper = arm.limits.T.copy()
    open_slide = arm.chain.is_prismatic & ~(np.isfinite(lower) & np.isfinite(upper))
    if slides is not None:
        lower[open_slide], upper[open_slide] = slides[open_slide].T
    elif open_slide.any():
        joint = int(np.argmax(open_slide)) + 1
        raise InputError(
            f"prismatic joint J{joint} of arm {arm.name!r} has no limits", hint="state its limits in the arm file"
        )
    free_below, free_above = np.isinf(lower), np.isinf(upper)
    both = free_below & free_above
    lower[both], upper[both] = arm.working[both] - np.pi, arm.working[both] + np.pi
    lower = np.where(free_below & ~both, upper - 2 * np.pi, lower)
    upper = np.where(free_above & ~both, lower + 2 * np.pi, upper)
    return lower, upper


def farthest_points(angles: FloatArray, n: int) -> IntArray:
    """Choose n rows, each the farthest from those before it; the first is the farthest from the mean."""
    chosen = [int(np.linalg.norm(angles - angles.mean(axis=0), axis=1).argmax())]
    nearest = np.full(len(angles), np.inf)
    while len(chosen) < n:
        nearest = np.minimum(nearest, np.linalg.norm(angles - angles[chosen[-1]], axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)


def spread_angles(lower: FloatArray, upper: FloatArray, n: int, *, seed: int, sobol: bool = False) -> FloatArray:
    """Angles (n, n_joints) uniform between two ends: independent, or scrambled Sobol points, which are more even."""
    rng = np.random.default_rng(seed)
    shape = n, len(lower)
    unit = _sobol(*shape, rng) if sobol else rng.random(shape)
    # Rounding may exceed the upper end by the last bit.
    return np.clip(lower + unit * (upper - lower), lower, upper)


def _sobol(n: int, dimensions: int, rng: np.random.Generator) -> FloatArray:
    """Sobol points are balanced for powers of two: make the next power and return the first n."""
    from scipy.stats import qmc

    points: FloatArray = qmc.Sobol(dimensions, scramble=True, rng=rng).random_base2(int(np.ceil(np.log2(n))))[:n]
    return points
