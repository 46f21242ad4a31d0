"""Poses of a person who measures parts.

There is hardly any publication on how operators place the joints. This is a working model: targets in the front sector,
the stylus within a cone about the surface normal, which points up or sideways, and the elbow to either side, but not
below the table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from truearm.arm import Arm, solve_inverse_kinematics
from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray, NameArray
from truearm.wings.planning.designs.poses import Poses, checked_count, checked_seed
from truearm.wings.planning.designs.sampling.workspace import (
    Sector,
    Stance,
    azimuth_of,
    draw_points,
    is_above_table,
    stance,
    within_cone,
)

END_STOP_MARGIN_RAD = float(np.radians(2.0))
"""Operators stay away from the end stops, where the tubes bend and no encoder measures it."""

TRIES_PER_POSE = 30
# Half angle of the cone of stylus directions, and the scatter of elbow and handle about the working pose.
CONE_DEG, SWING_STD_DEG, ROLL_STD_DEG = 40.0, 35.0, 60.0
# Share of the surfaces that face up.
FROM_ABOVE = 0.6
OUT_OF_REACH, AT_LIMIT, UNDER_TABLE = (
    "target not reached",
    "target reached at a joint limit only",
    "joint below the table",
)


def measuring_poses(arm: Arm, n: int, *, seed: int, sector: Sector | None = None) -> Poses:
    """Poses of a person who measures parts in front of an upright arm.

    Each pose has a target point, uniform in `sector`, and a surface normal: up with probability `FROM_ABOVE`, else
    sideways and not away from the arm. The stylus points against the normal up to an angle within the cone. The
    remaining freedom follows a posture drawn about the working pose turned to the target: the elbow swings by
    N(0, `SWING_STD_DEG`) and a freely turning handle (7 axes) rolls by N(0, `ROLL_STD_DEG`). Inverse kinematics solves
    for the angles, 2 deg within the limits; no joint may be below both base and target.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five joints.
    n : int
        Number of poses.
    seed : int
    sector : Sector, optional
        Where the targets are.

    Returns
    -------
    Poses
        With the number of rejected targets, by reason.

    Raises
    ------
    InputError
        If the arm has too few joints, or thirty targets per pose do not give enough poses.
    """
    check_five_rotary_joints(arm)
    rng = np.random.default_rng(checked_seed(seed))
    where, sector = stance(arm), sector or Sector()
    accepted: list[FloatArray] = []
    rejected: Counter[str] = Counter()
    tries_left = TRIES_PER_POSE * checked_count(n)
    missing = n
    while missing and tries_left > 0:
        m = min(max(2 * missing, 50), tries_left)
        tips = draw_points(where, m, sector=sector, rng=rng)
        normals = surface_normals(tips, where, rng)
        axes = -within_cone(normals, half_angle_rad=np.radians(CONE_DEG), rng=rng)
        posture = postures(arm, tips, where, swing_std_deg=SWING_STD_DEG, roll_std_deg=ROLL_STD_DEG, rng=rng)
        angles, reason = reach(arm, tips, axes, posture)
        enough = _rows_until(reason == "", missing)
        rejected.update(reason[:enough][reason[:enough] != ""].tolist())
        accepted.append(angles[:enough][reason[:enough] == ""])
        missing -= len(accepted[-1])
        tries_left -= enough
    if missing:
        summary = f"arm {arm.name!r} takes only {n - missing} of {n} poses in {TRIES_PER_POSE * n} targets"
        raise InputError(
            f"{summary}: {describe_rejections(rejected)}",
            hint="use a nearer sector or the strategy box",
        )
    return Poses(np.concatenate(accepted), dict(rejected))


def check_five_rotary_joints(arm: Arm) -> None:
    """Refuse an arm that cannot choose the direction of its stylus, or has prismatic joints."""
    if arm.n_joints < 5:
        raise InputError(
            f"a tip position and a stylus direction need five joints; arm {arm.name!r} has {arm.n_joints}",
            hint="use the strategy box or uniform",
        )
    if arm.chain.is_prismatic.any():
        joint = int(np.argmax(arm.chain.is_prismatic)) + 1
        raise InputError(
            f"postures need rotary joints; J{joint} of arm {arm.name!r} is prismatic",
            hint="use the strategy uniform",
        )


def surface_normals(tips: FloatArray, where: Stance, rng: np.random.Generator) -> FloatArray:
    """Draw normals of the measured surfaces: up, or sideways within 110 deg of the direction to the arm, (n, 3)."""
    back = np.arctan2(*(where.shoulder_in_base - tips)[:, 1::-1].T)
    azimuth = back + np.radians(rng.uniform(-110, 110, len(tips)))
    sideways = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(tips))])
    up = rng.random((len(tips), 1)) < FROM_ABOVE
    normals: FloatArray = np.where(up, np.array([0.0, 0.0, 1.0]), sideways)
    return normals


def postures(
    arm: Arm, tips: FloatArray, where: Stance, *, swing_std_deg: float, roll_std_deg: float, rng: np.random.Generator
) -> FloatArray:
    """Draw nominal postures: the working pose, turned to the targets and swung at random, (n, n_joints) [rad]."""
    out = arm.working + np.radians(swing_std_deg) * rng.standard_normal((len(tips), arm.n_joints))
    out[:, 0] += azimuth_of(tips, where)
    if arm.n_joints > 6:
        out[:, -1] += np.radians(roll_std_deg) * rng.standard_normal(len(tips))
    lower, upper = inner_limits(arm)
    inside: FloatArray = np.clip(out, lower, upper)
    return inside


def inner_limits(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Joint limits with a margin, so that no pose is at an end stop; the working pose is always inside."""
    lower, upper = arm.limits.T
    margin = np.where(arm.chain.is_prismatic, 0.0, END_STOP_MARGIN_RAD)
    return np.minimum(lower + margin, arm.working), np.maximum(upper - margin, arm.working)


def reach(arm: Arm, tips: FloatArray, axes: FloatArray, posture: FloatArray) -> tuple[FloatArray, NameArray]:
    """Angles that reach targets, and for each the reason of a failure, or an empty string."""
    lower, upper = inner_limits(arm)
    found = solve_inverse_kinematics(
        arm.chain, tips, start=posture, probe_axis_in_base=axes, posture=posture, lower=lower, upper=upper
    )
    at_limit = ((found.angles <= lower) | (found.angles >= upper)).any(axis=1)
    above = is_above_table(arm.chain, found.angles, tips)
    reason = np.where(~found.reached, np.where(at_limit, AT_LIMIT, OUT_OF_REACH), np.where(above, "", UNDER_TABLE))
    return found.angles, reason


def describe_rejections(rejected: Mapping[str, int]) -> str:
    """Describe the rejected poses in a few words."""
    return ", ".join(f"{count} x {reason}" for reason, count in sorted(rejected.items())) or "none rejected"


def _rows_until(good: BoolArray, wanted: int) -> int:
    """Count the rows up to and including the wanted-th good one; all if there are fewer."""
    places = np.flatnonzero(good)
    return int(places[wanted - 1]) + 1 if len(places) >= wanted else len(good)
