"""Postures of a person who measures a feature."""

from __future__ import annotations

from collections import Counter

import numpy as np

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.planning.sampling.measuring import (
    check_five_rotary_joints,
    describe_rejections,
    inner_limits,
    reach,
)
from truearm.identification.planning.sampling.workspace import Stance, azimuth_of, stance, within_cone
from truearm.typing import FloatArray
from truearm.verification.tasks.features import Feature

# A working model, as hardly anything has been published: from one measurement of the feature to the next the elbow
# swings by N(0, 35 deg), as in `truearm.identification.planning.sampling.measuring`, and the stylus leans within 30
# deg; from point to point of one measurement by N(0, 10 deg) and within 10 deg more.
_SWING_RAD, _LEAN_RAD = np.radians(35.0), np.radians(30.0)
_SWING_OF_POINT_RAD, _LEAN_OF_POINT_RAD = np.radians(10.0), np.radians(10.0)
# If all coordinates are smaller [mm], they are probably in metres.
_METRES = 5.0
_ROUNDS = 6  # of drawing the missing sets of postures
_TRIES = 3  # per point, before a set of postures is rejected


def feature_postures(arm: Arm, feature: Feature, n: int, *, seed: int) -> FloatArray:
    """Joint angles with the nominal tip on a feature's points, in n sets of postures.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five rotary joints.
    feature : Feature
    n : int
        Maximum number of sets: fewer if hardly any is feasible.
    seed : int

    Returns
    -------
    (m, k, n_joints) array
        For each of the k points [rad], m from 1 to n.

    Raises
    ------
    InputError
        If the arm has too few joints, or does not reach the feature.
    """
    check_five_rotary_joints(arm)
    rng = np.random.default_rng([5, seed])
    where, k = stance(arm), len(feature.points)
    found: list[FloatArray] = []
    rejected: Counter[str] = Counter()
    for _ in range(_ROUNDS):
        ways = n - sum(map(len, found))
        lean = within_cone(np.tile([0.0, 0.0, 1.0], (ways, 1)), half_angle_rad=_LEAN_RAD, rng=rng)
        approach = np.stack([_turned(feature.approach, one) for one in lean]).reshape(-1, 3)
        swing = np.repeat(_SWING_RAD * rng.standard_normal((ways, arm.n_joints)), k, axis=0)
        tips = np.tile(feature.points, (ways, 1))
        angles = np.empty((len(tips), arm.n_joints))
        reason = np.full(len(tips), "not tried")
        for _ in range(_TRIES):
            rows = np.flatnonzero(reason != "")
            if not len(rows):
                break
            axes = -within_cone(approach[rows], half_angle_rad=_LEAN_OF_POINT_RAD, rng=rng)
            posture = _postures(arm, tips[rows], where, swing[rows], rng)
            angles[rows], why = reach(arm, tips[rows], axes, posture)
            reason = reason.astype(object)
            reason[rows] = why
        reached = reason.reshape(ways, k) == ""
        good = reached.all(axis=1)
        found.append(angles.reshape(ways, k, -1)[good])
        rejected.update(str(one) for one in reason if one != "")
        if good.all() or not reached.any(axis=0).all():  # a point that no set reaches is out of reach
            break
    sets = np.concatenate(found)
    if not len(sets):
        hint = f"choose a place about {0.6 * where.reach_mm:.0f} mm in front of the shoulder, or another direction"
        if np.abs(feature.points.mean(axis=0)).max() < _METRES:
            hint = "state its place in mm: 600,0,300, not 0.6,0,0.3"
        raise InputError(
            f"arm {arm.name!r} does not reach all points of the {feature.name} in any posture: "
            f"{describe_rejections(rejected)}",
            hint=hint,
        )
    return sets


def middle_of(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Middle (3,) [mm] of the volume that a person works in, and the level direction (3,) across its front."""
    where = stance(arm)
    front = np.array([np.cos(where.front_rad), np.sin(where.front_rad), 0.0])
    return where.shoulder_in_base + where.reach_mm * (0.6 * front + [0.0, 0.0, 0.05]), np.cross(front, [0.0, 0.0, -1.0])


def _postures(arm: Arm, tips: FloatArray, where: Stance, swing: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Nominal postures: the working pose turned to the tips and swung, (n, n_joints) [rad]."""
    out = arm.working + swing + _SWING_OF_POINT_RAD * rng.standard_normal(swing.shape)
    out[:, 0] += azimuth_of(tips, where)
    inside: FloatArray = np.clip(out, *inner_limits(arm))
    return inside


def _turned(directions: FloatArray, lean: FloatArray) -> FloatArray:
    """Directions (n, 3) turned by the shortest rotation from straight up to `lean`."""
    axis = np.array([-lean[1], lean[0], 0.0])
    # Rodrigues' formula with |axis| the sine of the angle.
    across = np.cross(axis, directions)
    turned: FloatArray = directions + across + np.cross(axis, across) / (1 + lean[2])
    return turned
