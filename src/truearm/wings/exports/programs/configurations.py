"""The nominal joints of Cartesian targets: the branch and the turns that a configuration, or joints nearby, choose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.arm import Arm, Chain
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray
from truearm.wings.exports.programs.branches import N_JOINTS, Screws, inverse_branches, polished
from truearm.wings.exports.programs.program import Language, Target, inverse

QUANTITIES = (*(f"J{i}" for i in range(1, N_JOINTS + 1)), "shoulder", "elbow", "|J4|")
# A target is printed with two or three decimals: its joints may be this far across a border [deg, mm].
_ACROSS = 0.05
_TURNS = np.array([0, 1, -1, 2, -2])
_SAME = np.radians(0.1)


def quantities_of(screws: Screws, joints: FloatArray, counted: FloatArray) -> FloatArray:
    """What configurations are stated by, in the order of `QUANTITIES`.

    Parameters
    ----------
    screws : Screws
        Of the controller's arm.
    joints, counted : (.., 6) array
        Of the chain's joints, and as the controller counts them [rad].

    Returns
    -------
    (.., 9) array
        Joints [deg]; how far the wrist centre is in front of axis 1, and of the line from axis 2 to axis 3 [mm]; the
        magnitude of joint 4 [deg].
    """
    h, p = screws.axes, screws.points
    front, up = np.cross(h[1], h[0]), h[0] * (np.sign(h[0, 2]) or 1.0)  # of an axis 1 that points down, too
    front *= np.sign(front[0]) or 1.0
    # In the plane of the arm as it is before joint 1 turns.
    second, third = joints[..., 1], joints[..., 2] * (h[1] @ h[2])
    lower = _turned(h[1], second, p[2] - p[1])
    fore = _turned(h[1], second + third, screws.wrist - p[2])
    shoulder = (p[1] - p[0] + lower + fore) @ front
    link = lower / np.linalg.norm(p[2] - p[1])
    elbow = (fore @ front) * (link @ up) - (fore @ up) * (link @ front)
    degrees = np.degrees(counted)
    more = np.stack([shoulder, elbow, np.abs(degrees[..., 3])], axis=-1)
    return np.concatenate([degrees, more], axis=-1)


def _turned(axis: FloatArray, angle: FloatArray, v: FloatArray) -> FloatArray:
    along = axis * (axis @ v)
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    return np.asarray(along + c * (v - along) + s * np.cross(axis, v))


def nominal_joints(
    arm: Arm, chain: Chain, language: Language, targets: Sequence[Target]
) -> tuple[FloatArray, list[str]]:
    """Joints of the controller's arm at Cartesian targets.

    Parameters
    ----------
    arm : Arm
        Of the model: its limits.
    chain : Chain
        Of the controller.
    language : Language
    targets : sequence of Target
        Cartesian ones, with both frames.

    Returns
    -------
    (n, 6) array
        Of the model [rad]; NaN where there is a reason.
    list of str
        Why a target has no joints; empty for those that have.
    """
    screws = Screws.of(arm.chain)
    n = len(targets)
    if screws is None:
        return np.full((n, N_JOINTS), np.nan), ["the joints of this arm at a pose are not known in closed form"] * n
    works, poses, tools = (
        np.array([getattr(target, name) for target in targets]) for name in ("T_base_work", "pose", "T_flange_tool")
    )
    flange = works @ poses @ inverse(tools)
    branches = inverse_branches(arm.chain, screws, flange)
    low, high = np.full((2, n, len(QUANTITIES)), [[[-np.inf]], [[np.inf]]])
    near, stated = np.full((n, N_JOINTS), np.nan), np.zeros(n, dtype=bool)
    for row, target in enumerate(targets):
        for condition in target.conditions:
            at = QUANTITIES.index(condition.quantity)
            low[row, at], high[row, at] = condition.low, condition.high
        if target.near is not None:
            near[row] = target.near
        stated[row] = bool(target.conditions) or target.near is not None
    turned, off, far = _with_turns(arm, language, screws, branches, (low, high), near)
    exists = np.isfinite(branches).all(axis=2)
    limits = arm.limits.T
    beyond = (turned < limits[0] - Session.limit_tolerance) | (turned > limits[1] + Session.limit_tolerance)
    inside: BoolArray = exists & ~beyond.any(axis=2)
    fits = inside & (off <= _ACROSS)
    rank = np.where(fits, off + np.where(np.isfinite(far), far, 0.0) * 1e3, np.inf)
    rows, best = np.arange(n), rank.argmin(axis=1)
    joints = turned[rows, best]
    rivals = fits & (np.abs(_wrapped(turned - joints[:, None])).max(axis=2) > _SAME)
    rivals &= np.isnan(near).any(axis=1)[:, None] & ((off == 0) | (off[rows, best] > 0)[:, None])
    rows_of = (exists, inside, fits, rivals, stated[:, None])
    reasons = [_reason(*row) for row in np.stack([np.any(one, axis=1) for one in rows_of], axis=1).tolist()]
    good = np.array([not reason for reason in reasons], dtype=bool)
    joints[good] = polished(chain, flange[good], joints[good])
    for row in np.flatnonzero(good & np.isnan(joints).any(axis=1)).tolist():
        reasons[row] = "out of reach of the controller's own kinematics"
    joints[[bool(reason) for reason in reasons]] = np.nan
    return joints, reasons


def _with_turns(
    arm: Arm,
    language: Language,
    screws: Screws,
    branches: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    near: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Branches in the turns that fit best, how far they are from what is stated [deg, mm], and from joints nearby."""
    low, high = (bound[:, None] for bound in bounds)
    limits = arm.limits.T
    n = len(branches)
    shape = (n, branches.shape[1], N_JOINTS)
    found, least = branches.copy(), np.full(shape, np.inf)
    with np.errstate(invalid="ignore"):
        for turn in 2 * np.pi * _TURNS:
            joints = branches + turn
            counted = language.controller_joints(arm.chain, joints.reshape(-1, N_JOINTS)).reshape(shape)
            degrees = np.degrees(counted)
            off = np.maximum(np.maximum(low[..., :N_JOINTS] - degrees, degrees - high[..., :N_JOINTS]), 0.0)
            beyond = np.maximum(np.maximum(limits[0] - joints, joints - limits[1]), 0.0)
            # What is stated counts most, then the limits, then joints nearby, then the fewest turns.
            beside = np.nan_to_num(np.abs(counted - near[:, None]))
            cost = 1e6 * off + 1e3 * beyond + beside + 1e-3 * abs(turn)
            better = cost < least
            found, least = np.where(better, joints, found), np.where(better, cost, least)
        counted = language.controller_joints(arm.chain, found.reshape(-1, N_JOINTS)).reshape(shape)
        quantities = quantities_of(screws, arm.chain.joint_angles(found), counted)
        off = np.maximum(np.maximum(low - quantities, quantities - high), 0.0).max(axis=2)
    return found, off, np.abs(counted - near[:, None]).max(axis=2)


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray(np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


# What the targets of another robot are, too.
ROBOT = "check its tool, its work frame and the robot"


def _reason(exists: bool, inside: bool, fits: bool, rivals: bool, stated: bool) -> str:
    if not exists:
        return f"out of reach of the nominal arm: {ROBOT}"
    if not inside:
        return f"only reached beyond a joint limit: {ROBOT}"
    if not fits:
        return f"no posture within the limits has its configuration: {ROBOT}"
    if rivals and stated:
        return "several postures have its configuration"
    return "its configuration is not stated: --start states joints nearby" if rivals else ""
