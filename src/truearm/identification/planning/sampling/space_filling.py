"""Poses that fill ranges of the joints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.planning.sampling.poses import Poses, checked_count, checked_seed, joint_travel_limits
from truearm.typing import FloatArray

HALF_WIDTH_RAD = float(np.radians(20.0))
"""Box of the experiment of Gao et al. 2017, inferred: their network has the stated error in a box of this size."""


def box(arm: Arm, n: int, *, seed: int, half_width: npt.ArrayLike = HALF_WIDTH_RAD, sobol: bool = False) -> Poses:
    """Poses about the working pose, each joint uniform within `half_width` and its limits.

    Parameters
    ----------
    arm : Arm
    n : int
        Number of poses.
    seed : int
    half_width : float or (n_joints,) array
        [rad]; a prismatic joint needs a value of its own, in mm.
    sobol : bool
        Scrambled Sobol points, which cover the box more evenly, instead of independent ones.

    Raises
    ------
    InputError
        If a number is out of bounds.
    """
    half = np.asarray(half_width, dtype=float)
    if half.shape not in ((), (arm.n_joints,)) or not (np.isfinite(half) & (half > 0)).all():
        raise InputError(f"expected one positive half-width or {arm.n_joints}, got {half_width!r}")
    if half.ndim == 0 and arm.chain.is_prismatic.any():
        raise InputError(f"arm {arm.name!r} has prismatic joints: state half_width for each joint, in rad or mm")
    lower, upper = arm.limits.T
    return Poses(
        _between(
            np.maximum(lower, arm.working - half), np.minimum(upper, arm.working + half), n, seed=seed, sobol=sobol
        )
    )


def uniform(arm: Arm, n: int, *, seed: int, sobol: bool = False, slides: FloatArray | None = None) -> Poses:
    """Poses uniform over the ranges of all joints; joints without limits over one full turn.

    Parameters
    ----------
    arm : Arm
    n : int
        Number of poses.
    seed : int
    sobol : bool
        Scrambled Sobol points, which cover the ranges more evenly, instead of independent ones.
    slides : (n_joints, 2) array, optional
        Lower and upper ends of prismatic joints without limits [mm].

    Raises
    ------
    InputError
        If a number is out of bounds, or a prismatic joint has no limits and none are stated.
    """
    return Poses(_between(*joint_travel_limits(arm, slides=slides), n, seed=seed, sobol=sobol))


def _between(lower: FloatArray, upper: FloatArray, n: int, *, seed: int, sobol: bool) -> FloatArray:
    rng = np.random.default_rng(checked_seed(seed))
    shape = checked_count(n), len(lower)
    unit = _sobol(*shape, rng) if sobol else rng.random(shape)
    # Rounding may exceed the upper end by the last bit.
    return np.clip(lower + unit * (upper - lower), lower, upper)


def _sobol(n: int, dimensions: int, rng: np.random.Generator) -> FloatArray:
    """Sobol points are balanced for powers of two: make the next power and return the first n."""
    from scipy.stats import qmc

    points: FloatArray = qmc.Sobol(dimensions, scramble=True, rng=rng).random_base2(int(np.ceil(np.log2(n))))[:n]
    return points
