"""The nominal joints of Cartesian targets: the branch and the turns that a configuration, or joints nearby, choose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.arm.rigid_motions import inverse
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray
from truearm.wings.exports.programs.branches import QUANTITIES
from truearm.wings.exports.programs.machines import Machine
from truearm.wings.exports.programs.program import Target

# A target is printed with two or three decimals: its joints may be this far across a border [deg, mm].
_ACROSS = 0.05
_TURNS = np.array([0, 1, -1, 2, -2])
_SAME = np.radians(0.1)


def nominal_joints(machine: Machine, targets: Sequence[Target], rail: FloatArray) -> tuple[FloatArray, list[str]]:
    """Joints of the controller's arm at Cartesian targets.

    Parameters
    ----------
    machine : Machine
    targets : sequence of Target
        Cartesian ones, with both frames.
    rail : (n,) array
        Where the rail under the robot is; of no effect without one [mm].

    Returns
    -------
    (n, n_joints) array
        Of the model [rad, or mm]; NaN where there is a reason.
    list of str
        Why a target has no joints; empty for those that have.
    """
    n, arm = len(targets), machine.arm
    works, poses, tools = (
        np.array([getattr(target, name) for target in targets]) for name in ("T_base_work", "pose", "T_flange_tool")
    )
    flange = works @ poses @ inverse(tools)
    branches = machine.branches(flange, rail)
    low, high = np.full((2, n, len(QUANTITIES)), [[[-np.inf]], [[np.inf]]])
    near, stated = np.full((n, machine.n_axes), np.nan), np.zeros(n, dtype=bool)
    for row, target in enumerate(targets):
        for condition in target.conditions:
            at = QUANTITIES.index(condition.quantity)
            low[row, at], high[row, at] = condition.low, condition.high
        if target.near is not None:
            near[row] = target.near
        stated[row] = bool(target.conditions) or target.near is not None
    turned, off, far = _with_turns(machine, branches, (low, high), near)
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
    joints[good] = machine.polished(flange[good], joints[good])
    for row in np.flatnonzero(good & np.isnan(joints).any(axis=1)).tolist():
        reasons[row] = "out of reach of the controller's own kinematics"
    joints[[bool(reason) for reason in reasons]] = np.nan
    return joints, reasons


def _with_turns(
    machine: Machine, branches: FloatArray, bounds: tuple[FloatArray, FloatArray], near: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Branches in the turns that fit best, how far they are from what is stated [deg, mm], and from joints nearby."""
    low, high = (bound[:, None] for bound in bounds)
    limits, turning, n_axes = machine.arm.limits.T, ~machine.arm.chain.is_prismatic, machine.n_axes
    found, least = branches.copy(), np.full(branches.shape, np.inf)
    with np.errstate(invalid="ignore"):
        for turn in 2 * np.pi * _TURNS:
            joints = branches + turn * turning
            counted = machine.axes(joints)
            degrees = np.degrees(counted)
            off = np.maximum(np.maximum(low[..., :n_axes] - degrees, degrees - high[..., :n_axes]), 0.0)
            beyond = np.maximum(np.maximum(limits[0] - joints, joints - limits[1]), 0.0)
            # What is stated counts most, then the limits, then joints nearby, then the fewest turns.
            beside = np.nan_to_num(np.abs(counted - near[:, None]))
            cost = 1e3 * beyond + 1e-3 * abs(turn)
            cost[..., int(machine.has_rail) :] += 1e6 * off + beside
            better = cost < least
            found, least = np.where(better, joints, found), np.where(better, cost, least)
        counted, quantities = machine.axes(found), machine.quantities(found)
        off = np.maximum(np.maximum(low - quantities, quantities - high), 0.0).max(axis=2)
    away = np.abs(counted - near[:, None])[..., ~machine.robot.is_prismatic]  # mm and rad do not compare
    return found, off, away.max(axis=2)


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
