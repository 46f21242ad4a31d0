"""Configurations of an arm: joints of the same one are joined by a path that meets no singular pose.

The sign of the determinant of the Jacobian alone would not tell them apart: two flips, such as elbow and wrist, restore
it. So it is followed along a path. Poses leave redundant arms a continuum of joints, and arms of fewer than six joints
may have no square Jacobian: their configurations have no sign, and are not compared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import InverseKinematicsResult, Pose
from truearm.typing import BoolArray, FloatArray
from truearm.wings.exports.targets.inverse import PoseTask, scaled_jacobian, solve_poses, turn_between

# The condition of the Jacobian in everyday poses is 5 to 100. Above this one a micrometre at the tip is half a degree.
MAX_CONDITION = 1e4
# Parts of a path between start and solution; two flips within one part would remain unseen.
PARTS = 16
# Newton steps from one pose of a path to the next; three are usual.
_STEPS = 10


def keeps_configuration(task: PoseTask, start: FloatArray, joints: FloatArray) -> BoolArray:
    """(n,) whether the straight path in the joints from start to solution meets no singular pose."""
    sign = _sign(task, start)
    # A singular start is at the border of configurations and chooses none.
    sign = np.where(_condition(task, start) > MAX_CONDITION, _sign(task, joints), sign)
    kept = np.ones(len(start), dtype=bool)
    for share in np.arange(1, PARTS + 1) / PARTS:
        kept &= _sign(task, start + share * (joints - start)) == sign
    return kept


def follow(task: PoseTask, start: FloatArray, at_start: Pose) -> tuple[InverseKinematicsResult, BoolArray]:
    """Solve a task by continuation: along poses between those at the start and the target.

    Returns
    -------
    InverseKinematicsResult
    (n,) bool array
        Whether the path arrived without meeting a singular pose, so that the configuration is that of the start.
    """
    shift = task.target.tip_in_base - at_start.tip_in_base
    turn = turn_between(at_start.R_base_tip, task.target.R_base_tip)
    kept, joints = np.ones(len(start), dtype=bool), start
    for share in np.arange(1, PARTS + 1) / PARTS:
        R = Rotation.from_rotvec(share * turn).as_matrix() @ at_start.R_base_tip
        found = solve_poses(
            replace(task, target=Pose(R, at_start.tip_in_base + share * shift)), joints, max_steps=_STEPS
        )
        kept &= found.reached & keeps_configuration(task, joints, found.angles)
        joints = found.angles
    return found, kept


def _sign(task: PoseTask, joints: FloatArray) -> FloatArray:
    """(n,) sign of the determinant of the Jacobian, 0 where it is not square."""
    J = scaled_jacobian(task, joints)
    return np.asarray(np.linalg.slogdet(J)[0]) if J.shape[1] == J.shape[2] else np.zeros(len(joints))


def _condition(task: PoseTask, joints: FloatArray) -> FloatArray:
    """(n,) condition of the scaled Jacobian."""
    values = np.linalg.svd(scaled_jacobian(task, joints), compute_uv=False)
    return np.asarray(values[:, 0] / np.maximum(values[:, -1], 1e-300))
