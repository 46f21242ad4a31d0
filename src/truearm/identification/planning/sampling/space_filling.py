"""Poses spread over ranges of the joints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.planning.sampling.poses import Poses, checked_count, checked_seed, joint_travel_limits
from truearm.typing import FloatArray

HALF_WIDTH_RAD = float(np.radians(20.0))
"""What the founding paper's experiment must have been: its network leaves the paper's error in a box of this size."""


def box(arm: Arm, n: int, *, seed: int, half_width: npt.ArrayLike = HALF_WIDTH_RAD, sobol: bool = False) -> Poses:
    """Poses about the working pose, each joint evenly within `half_width` and its limits.

    Parameters
    ----------
    arm : Arm
    n : int
        Number of poses.
    seed : int
    half_width : float or (n_joints,) array
        [rad]; a sliding joint needs its own, in mm.
    sobol : bool
        Scrambled Sobol points, which cover the box more evenly, instead of independent ones.

    Raises
    ------
    InputError
        If a number is not what it must be.
    """
    half = np.asarray(half_width, dtype=float)
    if half.shape not in ((), (arm.n_joints,)) or not (np.isfinite(half) & (half > 0)).all():
        raise InputError(f"expected one positive half-width or {arm.n_joints}, got {half_width!r}")
    if half.ndim == 0 and arm.chain.is_prismatic.any():
        raise InputError(f"arm {arm.name!r} has sliding joints: half_width must be given for each joint, in rad or mm")
    lower, upper = arm.limits.T
    return Poses(
        _between(
            np.maximum(lower, arm.working - half), np.minimum(upper, arm.working + half), n, seed=seed, sobol=sobol
        )
    )


def uniform(arm: Arm, n: int, *, seed: int, sobol: bool = False) -> Poses:
    """Poses over the joints' whole ranges, each joint evenly; joints without limits over one full turn.

    Parameters
    ----------
    arm : Arm
    n : int
        Number of poses.
    seed : int
    sobol : bool
        Scrambled Sobol points, which cover the ranges more evenly, instead of independent ones.

    Raises
    ------
    InputError
        If a number is not what it must be, or a sliding joint has no limits.
    """
    return Poses(_between(*joint_travel_limits(arm), n, seed=seed, sobol=sobol))


def _between(lower: FloatArray, upper: FloatArray, n: int, *, seed: int, sobol: bool) -> FloatArray:
    rng = np.random.default_rng(checked_seed(seed))
    shape = checked_count(n), len(lower)
    unit = _sobol(*shape, rng) if sobol else rng.random(shape)
    # Rounding may step over the upper end by its last bit.
    return np.clip(lower + unit * (upper - lower), lower, upper)


def _sobol(n: int, dimensions: int, rng: np.random.Generator) -> FloatArray:
    """Sobol points balance over powers of two: make the next one and take the first n."""
    points: FloatArray = qmc.Sobol(dimensions, scramble=True, rng=rng).random_base2(int(np.ceil(np.log2(n))))[:n]
    return points
