"""Inverse kinematics for many targets at once, by damped least squares.

Near a singularity an exact step runs away; damping trades exactness for bounded steps (Nakamura and Hanafusa, "Inverse
kinematic solutions with singularity robustness for robot manipulator control", ASME J. Dyn. Syst. Meas. Control 108,
1986; Wampler, "Manipulator inverse kinematic solutions based on vector formulations and damped least-squares methods",
IEEE Trans. Syst. Man Cybern. 16, 1986). Each row has its own damping, which falls when a step brings its tip closer
and rises when it does not (Levenberg, Marquardt), so that the last steps are Newton's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.solve.least_squares import levenberg_marquardt_by_row
from truearm.solve.least_squares_problem import MarquardtDamping
from truearm.typing import BoolArray, FloatArray, IntArray

# Rows that are solved together: the derivatives by all six motions at all places take 144 bytes a place each.
_ROWS = 4096
_LONGEST_STEP = 0.5  # [rad]; sliding joints: that times the length scale [mm]
_PULLED_STEPS = 25  # steps with a pull to the posture, before those without
# At the maximum damping a row is abandoned: its steps no longer reduce its error.
_DAMPING = MarquardtDamping(mu=1e-2, decrease=0.1, increase=10.0, maximum=1e6, minimum=1e-12)
_PULL = 0.3  # share of the way to the posture in the first of them


@dataclass(frozen=True, eq=False)
class InverseKinematicsResult:
    """Joint angles that bring the tip to its targets, row by row, and the remaining errors.

    Attributes
    ----------
    angles : (n, n_joints) array
        Within the limits in any case [rad, or mm for sliding joints].
    reached : (n,) bool array
        Whether both errors are within the tolerances.
    distance_mm : (n,) array
        From the tip to the target [mm].
    angle_rad : (n,) array
        Between the probe axis, or the flange, and its target [rad]; zero if only the tip was requested.
    steps : (n,) int array
    jacobian : (n, 3, 5 or 6, n_joints) array
        Of the pose by the joints, both as lengths: a radian counts as the usual lever of a joint [mm].
    """

    angles: FloatArray
    reached: BoolArray
    distance_mm: FloatArray
    angle_rad: FloatArray
    steps: IntArray
    jacobian: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[InverseKinematicsResult]) -> InverseKinematicsResult:
        """The targets of several results, one after the other."""
        return cls(*(np.concatenate([getattr(part, name.name) for part in parts]) for name in fields(cls)))

    def rows(self, which: IntArray | BoolArray) -> InverseKinematicsResult:
        """Some of the targets."""
        return InverseKinematicsResult(*(getattr(self, field.name)[which] for field in fields(self)))

    def replaced(self, rows: IntArray, others: InverseKinematicsResult) -> InverseKinematicsResult:
        """The same with other solutions in some rows; their steps are added."""
        parts = [getattr(self, field.name).copy() for field in fields(self)]
        for field, part in zip(fields(self), parts, strict=True):
            part[rows] = getattr(others, field.name)
        found = InverseKinematicsResult(*parts)
        found.steps[rows] += self.steps[rows]
        return found

    @property
    def condition(self) -> FloatArray:
        """(n,) largest by smallest singular value of the Jacobian."""
        values = np.linalg.svd(self.jacobian, compute_uv=False)
        return np.asarray(values[:, 0] / np.maximum(values[:, -1], 1e-300))


def within_longest_step(step: FloatArray, scale: FloatArray | float) -> FloatArray:
    """Steps (n, n_joints) [mm], none longer than half a radian: beyond it a linearisation is worth little."""
    longest = np.maximum(np.abs(step).max(axis=1), 1e-300)
    return np.asarray(step * np.minimum(1.0, _LONGEST_STEP * scale / longest)[:, None])


def solve_inverse_kinematics(
    chain: Chain,
    tips_in_base: npt.ArrayLike,
    *,
    start: npt.ArrayLike,
    probe_axis_in_base: npt.ArrayLike | None = None,
    R_base_tip: npt.ArrayLike | None = None,
    posture: npt.ArrayLike | None = None,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
    tolerance_mm: float = 1e-6,
    tolerance_rad: float = 1e-8,
    max_steps: int = 100,
) -> InverseKinematicsResult:
    """Compute joint angles that put the tip on each target.

    A local method: it descends from `start` and may stop at a limit or in a folded posture although another
    configuration would reach the target. Such rows are reported as not reached; start them elsewhere.

    Parameters
    ----------
    chain : Chain
    tips_in_base : (n, 3) array
        Targets [mm].
    start : (n_joints,) or (n, n_joints) array
        Initial joint angles [rad, or mm].
    probe_axis_in_base : (3,) or (n, 3) array, optional
        Required direction of the probe axis, the flange's z axis. Any by default.
    R_base_tip : (3, 3) or (n, 3, 3) array, optional
        Required orientation of the flange, in place of that of its z axis alone. Any by default.
    posture : (n_joints,) or (n, n_joints) array, optional
        Joint angles to stay near, as far as the targets leave freedom. The pull decreases to zero before the last
        steps.
    lower, upper : (n_joints,) array, optional
        Limits [rad, or mm]; none by default. `start` is clipped to them.
    tolerance_mm, tolerance_rad : float
        Largest errors of a row that counts as reached.
    max_steps : int
        Maximum number of steps.

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, an axis is zero, an orientation is no rotation (1e-6), axis and
        orientation are both given, or limits are crossed.
    """
    problem = _problem(chain, tips_in_base, start, posture, lower, upper)
    axes, rotations = _orientations(probe_axis_in_base, R_base_tip, len(problem.targets))
    problem = replace(problem, axes=axes, rotations=rotations, tolerance_mm=tolerance_mm, tolerance_rad=tolerance_rad)
    parts = []
    for first in range(0, max(len(problem.targets), 1), _ROWS):
        part = problem.rows(slice(first, first + _ROWS))
        q = part.start if part.posture is None else _pulled(part)
        q, missing, J, steps = levenberg_marquardt_by_row(part, q, damping=_DAMPING, max_epochs=max_steps)
        parts.append(InverseKinematicsResult(q, part.has_converged(missing), *part.errors(missing), steps, J))
    return InverseKinematicsResult.joined(parts)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Targets and limits of the joints, all in mm: radians count as arcs at the radius `scale` (n,)."""

    chain: Chain
    targets: FloatArray
    start: FloatArray
    posture: FloatArray | None
    lower: FloatArray
    upper: FloatArray
    scale: FloatArray
    axes: FloatArray | None = None
    rotations: FloatArray | None = None
    tolerance_mm: float = 0.0
    tolerance_rad: float = 0.0

    @property
    def mm_per_unit(self) -> FloatArray:
        """(n, n_joints) `scale` for joints that turn, 1 for joints that slide."""
        return np.where(self.chain.is_prismatic, 1.0, self.scale[:, None])

    def rows(self, which: slice | IntArray) -> _Problem:
        return replace(
            self,
            targets=self.targets[which],
            axes=None if self.axes is None else self.axes[which],
            rotations=None if self.rotations is None else self.rotations[which],
            start=self.start[which],
            posture=None if self.posture is None else self.posture[which],
            scale=self.scale[which],
        )

    def linearise(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals (n, 3, 5 or 6) [mm] and their Jacobian by the joints (.., n_joints) [mm/mm]."""
        tips, motion_jacobian = self.chain.tip_derivatives(q)
        joints = motion_jacobian[:, 1:-1]
        own = np.where(self.chain.is_prismatic[:, None], joints[:, :, 5], joints[:, :, 2])
        missing, J = self.targets - tips, own.transpose(0, 2, 1)
        about = motion_jacobian[:, -1, 3:]  # x, y, z axes of the flange
        if self.axes is not None:
            turn, about = _turn_between(about[:, 2], self.axes), about[:, :2]  # a turn about z does not move z
        elif self.rotations is not None:
            turn = Rotation.from_matrix(self.rotations @ about).as_rotvec()
        if self.axes is not None or self.rotations is not None:
            joint_axes = np.where(self.chain.is_prismatic[:, None], 0.0, joints[:, :, 5])
            about = np.ascontiguousarray(about) * self.scale[:, None, None]
            missing = np.concatenate([missing, np.einsum("nkc,nc->nk", about, turn)], axis=1)
            J = np.concatenate([J, np.einsum("nkc,njc->nkj", about, joint_axes)], axis=1)
        return missing, self.chain.by_encoders(J) / self.mm_per_unit[:, None]

    def errors(self, missing: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance [mm] and angle between axes or orientations [rad]."""
        return np.linalg.norm(missing[:, :3], axis=1), np.linalg.norm(missing[:, 3:], axis=1) / self.scale

    def has_converged(self, missing: FloatArray) -> BoolArray:
        """(n,) whether both errors are within the tolerances."""
        distance, angle = self.errors(missing)
        return np.asarray((distance <= self.tolerance_mm) & (angle <= self.tolerance_rad))

    def move(
        self, q: FloatArray, missing: FloatArray, J: FloatArray, damping: FloatArray, pull: FloatArray | float = 0.0
    ) -> FloatArray:
        """Take one damped step within the limits; `pull` (n, n_joints) [mm] acts in the null space of the task."""
        pull = np.broadcast_to(pull, q.shape)
        free = np.ones(q.shape, dtype=bool)
        for _ in range(3):  # the others take over the share of a joint at its limit
            step = _damped_step(missing, J * free[:, None], damping, pull * free)
            held = free & (((q <= self.lower) & (step < 0)) | ((q >= self.upper) & (step > 0)))
            if not held.any():
                break
            free &= ~held
        step = within_longest_step(step * free, self.scale)
        return np.clip(q + step / self.mm_per_unit, self.lower, self.upper)


def _damped_step(missing: FloatArray, J: FloatArray, damping: FloatArray, pull: FloatArray) -> FloatArray:
    """``pull + J^T (J J^T + damping)^-1 (missing - J pull)``: the pull's part in the null space of J stays."""
    JT = J.transpose(0, 2, 1)
    A = J @ JT + damping[:, None, None] * np.eye(J.shape[1])
    rest = missing - np.einsum("nkj,nj->nk", J, pull)
    step: FloatArray = pull + (JT @ np.linalg.solve(A, rest[:, :, None]))[:, :, 0]
    return step


def _pulled(problem: _Problem) -> FloatArray:
    """Joint angles near the targets and near the posture: steps with a pull that fades out."""
    assert problem.posture is not None
    q = problem.start
    for k in range(_PULLED_STEPS):
        missing, J = problem.linearise(q)
        # The step to a far target is damped more, as its linearisation is worth less (Chan and Lawrence 1988).
        damping = 1e-3 + 0.1 * (missing**2).sum(axis=1) / problem.scale**2
        pull = _PULL * (1 - k / _PULLED_STEPS) * (problem.posture - q) * problem.mm_per_unit
        q = problem.move(q, missing, J, damping, pull)
    return q


def _turn_between(axis: FloatArray, target: FloatArray) -> FloatArray:
    """(n, 3) rotation vectors of the shortest rotations from unit vectors to others [rad]."""
    cross = np.cross(axis, target)
    sin = np.linalg.norm(cross, axis=1)
    angle = np.arctan2(sin, (axis * target).sum(axis=1))
    # Opposite vectors have no shortest rotation: any across them is a start.
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    opposite = (sin < 1e-12) & (angle > 1)
    cross = np.where(opposite[:, None], across, cross)
    length = np.linalg.norm(cross, axis=1)
    turn: FloatArray = cross * (angle / np.where(length > 0, length, 1.0))[:, None]
    return turn


def _problem(
    chain: Chain,
    targets: npt.ArrayLike,
    start: npt.ArrayLike,
    posture: npt.ArrayLike | None,
    lower: npt.ArrayLike | None,
    upper: npt.ArrayLike | None,
) -> _Problem:
    targets = np.asarray(targets, dtype=float)
    if targets.ndim != 2 or targets.shape[1] != 3:
        raise InputError(f"expected targets of shape (n, 3), got {targets.shape}")
    if not np.isfinite(targets).all():
        raise InputError(f"targets must be finite, got {targets[~np.isfinite(targets).all(axis=1)][0]}")
    n, joints = len(targets), chain.n_joints
    far = np.linalg.norm(targets - chain.fixed[0, :3, 3], axis=1)
    low = _rows_of("lower", -np.full(joints, np.inf) if lower is None else lower, (joints,), bounded=False)
    high = _rows_of("upper", np.full(joints, np.inf) if upper is None else upper, (joints,), bounded=False)
    if not (low <= high).all():
        raise InputError(f"the lower limits {low.tolist()} must not be above the upper ones {high.tolist()}")
    return _Problem(
        chain=chain,
        targets=targets,
        start=np.clip(_rows_of("start", start, (n, joints)), low, high),
        posture=None if posture is None else _rows_of("posture", posture, (n, joints)),
        lower=low,
        upper=high,
        scale=np.maximum(np.maximum(chain.reach, far) / 3, 1.0),  # a third of the reach: the usual lever of a joint
    )


def _orientations(
    axes: npt.ArrayLike | None, rotations: npt.ArrayLike | None, n: int
) -> tuple[FloatArray | None, FloatArray | None]:
    """Unit vectors of the probe axis (n, 3) or orientations of the flange (n, 3, 3), as far as they are given."""
    if axes is not None and rotations is not None:
        raise InputError("expected probe_axis_in_base or R_base_tip, got both: an orientation states the axis")
    if rotations is None:
        return None if axes is None else _unit(_rows_of("probe_axis_in_base", axes, (n, 3))), None
    R = _rows_of("R_base_tip", rotations, (n, 3, 3))
    skew = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    if (bad := (skew > 1e-6) | (np.linalg.det(R) < 0)).any():
        raise InputError(f"expected rotation matrices as R_base_tip, number {int(bad.argmax())} is none")
    return None, R


def _unit(axes: FloatArray) -> FloatArray:
    length = np.linalg.norm(axes, axis=1, keepdims=True)
    if not (length > 1e-9).all():
        raise InputError("probe_axis_in_base must not be zero")
    unit: FloatArray = axes / length
    return unit


def _rows_of(name: str, value: npt.ArrayLike, shape: tuple[int, ...], *, bounded: bool = True) -> FloatArray:
    """Return one for each from one for all, or one for each."""
    array = np.asarray(value, dtype=float)
    one = shape[1:] or shape
    if array.shape not in (one, shape):
        raise InputError(f"expected {name} of shape {one} or {shape}, got {array.shape}")
    if not (np.isfinite(array).all() if bounded else not np.isnan(array).any()):
        raise InputError(f"{name} must be numbers, got {array[~np.isfinite(array)][0]}")
    return np.broadcast_to(array, shape).copy()
