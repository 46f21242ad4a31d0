"""The result of a sampling strategy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.typing import FloatArray, NameArray


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
            f"prismatic joint J{joint} of arm {arm.name!r} has no limits",
            hint="state its limits in the arm file",
        )
    free_below, free_above = np.isinf(lower), np.isinf(upper)
    both = free_below & free_above
    lower[both], upper[both] = arm.working[both] - np.pi, arm.working[both] + np.pi
    lower = np.where(free_below & ~both, upper - 2 * np.pi, lower)
    upper = np.where(free_above & ~both, lower + 2 * np.pi, upper)
    return lower, upper
