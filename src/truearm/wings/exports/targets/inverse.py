"""Joints that bring a model's tip to poses: Newton's method on the model itself, near start joints.

Harmonics and gravity make the model's joints no simple function of the nominal ones, so steps are repeated. The exact
Jacobian gives quadratic convergence (C. W. Wampler, "Manipulator inverse kinematic solutions based on vector
formulations and damped least-squares methods", IEEE Trans. Syst. Man Cybern. 16 (1986) 93); damping only matters where
start and target are far apart.

Joints that the pose leaves free stay where they are: with the Jacobian J and the projector ``N = I - J^+ J`` onto its
null space, ``N (q - q_hold) = 0`` is solved together with the pose. If N is computed at the encoder's joints in both
directions, compensation of commands and of feedback remain inverse to each other on redundant arms too.

Configurations of an arm: joints of the same one are joined by a path that meets no singular pose.

The sign of the determinant of the Jacobian alone would not tell them apart: two flips, such as elbow and wrist, restore
it. So it is followed along a path. Poses leave redundant arms a continuum of joints, and arms of fewer than six joints
may have no square Jacobian: their configurations have no sign, and are not compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import InverseKinematicsResult, Pose
from truearm.arm.inverse_kinematics import within_longest_step
from truearm.solve.least_squares import RowsResult, levenberg_marquardt_by_row
from truearm.solve.least_squares_problem import MarquardtDamping
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.wings.exports.targets.pose_models import PoseModel

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


# Where the search ends. One more step follows with the last Jacobian, which leaves a thousandth of it.
TOLERANCE_MM = 1e-7
TOLERANCE_RAD = 1e-10
MAX_STEPS = 100
_DAMPING = MarquardtDamping(mu=1e-10, decrease=0.1, increase=100.0, maximum=1e5, minimum=1e-12)
_ROWS = 16384  # targets that are solved together
# Smaller singular values of the scaled Jacobian, relative to the largest, are directions that the arm cannot move in.
_RANK = 1e-8


@dataclass(frozen=True, eq=False)
class PoseTask:
    """Poses that a model shall reach.

    Parameters
    ----------
    model : PoseModel
    target : Pose
        (n, 3, 3) orientations and (n, 3) tips [mm].
    prismatic : (n_joints,) bool array
    scale : float
        Length at which an angle counts as a length [mm]: a third of the reach, the usual lever of a joint.
    turns : (k, 3) array
        Directions about which the orientation counts: all, none, or those about which an arm of fewer joints turns.
    hold : (n, n_joints) array, optional
        Joints to stay near, as far as the pose leaves freedom [rad, or mm]; by default every step is the shortest.
    free : (n, n_joints, n_joints) array, optional
        Projectors onto the freedom, those of `freedom`; by default computed at the joints of the solution.
    locked : (n, n_joints) bool array, optional
        Joints that must not move; none by default.
    which : (n,) int array, optional
        The targets by their numbers in `model`; all of them by default.
    """

    model: PoseModel
    target: Pose
    prismatic: BoolArray
    scale: float
    turns: FloatArray
    hold: FloatArray | None = None
    free: FloatArray | None = None
    locked: BoolArray | None = None
    which: IntArray | None = None

    @property
    def unit(self) -> FloatArray:
        """(n_joints,) length that a unit of a joint counts as [mm]."""
        return np.where(self.prismatic, 1.0, self.scale)

    def rows(self, which: IntArray) -> PoseTask:
        """See `truearm.solve.least_squares.RowProblem`."""
        return replace(
            self,
            target=Pose(self.target.R_base_tip[which], self.target.tip_in_base[which]),
            hold=None if self.hold is None else self.hold[which],
            free=None if self.free is None else self.free[which],
            locked=None if self.locked is None else self.locked[which],
            which=which if self.which is None else self.which[which],
        )

    def linearise(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what is missing [mm], (n, width + n_joints), and its derivative by the scaled joints."""
        rows = np.arange(len(joints)) if self.which is None else self.which
        pose, by_joint = self.model.linearise(joints, rows)
        missing, J = self._missing(pose), self._scaled(by_joint)
        if self.locked is not None:
            J = J * ~self.locked[:, None]
        if self.hold is not None:
            N = freedom(J) if self.free is None else self.free
            away = (self.hold - joints) * self.unit
            missing = np.concatenate([missing, np.einsum("nij,nj->ni", N, away)], axis=1)
            J = np.concatenate([J, N], axis=1)
        return missing, J

    def move(self, joints: FloatArray, missing: FloatArray, J: FloatArray, mu: FloatArray) -> FloatArray:
        """Take one damped step, (J^T J + mu)^-1 J^T missing, not longer than half a radian."""
        JT = J.transpose(0, 2, 1)
        gram = JT @ J + mu[:, None, None] * np.eye(J.shape[2])
        step = np.asarray(np.linalg.solve(gram, JT @ missing[:, :, None])[:, :, 0], dtype=float)
        return np.asarray(joints + within_longest_step(step, self.scale) / self.unit)

    def polished(self, found: RowsResult) -> FloatArray:
        """Joints after one more step where the search has ended, without another evaluation of the model."""
        joints = found.x.copy()
        rows = np.flatnonzero(self.has_converged(found.residuals))
        mu = np.full(len(rows), _DAMPING.minimum)
        joints[rows] = self.rows(rows).move(joints[rows], found.residuals[rows], found.jacobian[rows], mu)
        return joints

    def has_converged(self, missing: FloatArray) -> BoolArray:
        """(n,) whether all that is missing is rounding."""
        turn, held = missing[:, 3 : self.width], missing[:, self.width :]
        return np.asarray(
            (np.linalg.norm(missing[:, :3], axis=1) <= TOLERANCE_MM)
            & (np.linalg.norm(turn, axis=1) <= TOLERANCE_RAD * self.scale)
            & (np.abs(held).max(axis=1, initial=0.0) <= TOLERANCE_MM)
        )

    def solution(
        self, joints: FloatArray, missing: FloatArray, J: FloatArray, steps: IntArray
    ) -> InverseKinematicsResult:
        """What was found, in words of poses; the errors are those before the last step."""
        width = self.width
        distance = np.linalg.norm(missing[:, :3], axis=1)
        angle = np.linalg.norm(missing[:, 3:width], axis=1) / self.scale
        reached = (distance <= TOLERANCE_MM) & (angle <= TOLERANCE_RAD)
        return InverseKinematicsResult(joints, np.asarray(reached), distance, angle, steps, J[:, :width])

    @property
    def width(self) -> int:
        """Number of equations of a pose."""
        return 3 + len(self.turns)

    def _missing(self, pose: Pose) -> FloatArray:
        shift = self.target.tip_in_base - pose.tip_in_base
        if not len(self.turns):
            return shift
        turn = turn_between(pose.R_base_tip, self.target.R_base_tip) @ self.turns.T
        return np.concatenate([shift, self.scale * turn], axis=1)

    def _scaled(self, by_joint: FloatArray) -> FloatArray:
        J = np.concatenate([by_joint[:, :3], self.turns @ by_joint[:, 3:]], axis=1) / self.unit
        J[:, 3:] *= self.scale
        return np.asarray(J)


def solve_poses(task: PoseTask, start: FloatArray, *, max_steps: int = MAX_STEPS) -> InverseKinematicsResult:
    """Solve a task from start joints (n, n_joints) [rad, or mm].

    A local method: it finds the solution of the start's configuration. What it does not reach stays at the nearest
    pose that it found.
    """
    parts = []
    for first in range(0, len(start), _ROWS):
        rows = np.arange(first, min(first + _ROWS, len(start)))
        part = task.rows(rows)
        found = levenberg_marquardt_by_row(part, start[rows], damping=_DAMPING, max_epochs=max_steps)
        parts.append(part.solution(part.polished(found), *found[1:]))
    return InverseKinematicsResult.joined(parts)


def scaled_jacobian(task: PoseTask, joints: FloatArray) -> FloatArray:
    """(n, width, n_joints) derivatives of a task's poses by the joints, scaled as in `InverseKinematicsResult`."""
    return replace(task, hold=None).linearise(joints)[1]


def freedom(J: FloatArray) -> FloatArray:
    """(n, n_joints, n_joints) projectors onto the null spaces of scaled Jacobians."""
    return np.asarray(np.eye(J.shape[2]) - np.linalg.pinv(J, rcond=_RANK) @ J)


def turn_between(R: FloatArray, R_target: FloatArray) -> FloatArray:
    """(n, 3) rotation vectors in the base frame that turn orientations into others [rad]."""
    return np.asarray(Rotation.from_matrix(R_target @ R.transpose(0, 2, 1)).as_rotvec())
