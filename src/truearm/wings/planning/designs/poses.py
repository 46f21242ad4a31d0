"""Poses in the order of measurement, and those that fill ranges of the joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.sampling import joint_travel_limits, spread_angles
from truearm.typing import FloatArray, NameArray

HALF_WIDTH_RAD = float(np.radians(20.0))
"""Box of the experiment of Gao et al. 2017, inferred: their network has the stated error in a box of this size."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses in the order of measurement.

    Attributes
    ----------
    angles : (n, n_joints) array
        Inside the joint limits [rad, or mm for prismatic joints].
    rejected : mapping of str to int
        Number of rejected candidates, by reason.
    seat : (n,) array of str, optional
        The seat that holds the tip.
    seat_points : (n, 3) array, optional
        Position of that seat in the base frame [mm]; the nominal tip is in it.
    """

    angles: FloatArray
    rejected: Mapping[str, int] = field(default_factory=dict)
    seat: NameArray | None = None
    seat_points: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.angles)


def checked_count(n: int, what: str = "poses") -> int:
    """Check a number of poses, seats or places."""
    if n < 1:
        raise InputError(f"expected at least one of {what}, got {n}")
    return n


def checked_seed(seed: int) -> int:
    """Check a seed."""
    if seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed}")
    return seed


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
    return spread_angles(lower, upper, checked_count(n), seed=checked_seed(seed), sobol=sobol)
