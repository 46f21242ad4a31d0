"""The kinematic chain: forward kinematics and the tip's derivative by small motions at every place.

The chain is ``F0 J1(q1) F1 J2(q2) F2 ... Jn(qn) Fn tip``: constant rigid motions ``F`` between joints that turn about
(revolute) or slide along (prismatic) their own z axis. *Places* are where a real arm may differ from this one:

====== ================== ==================================================================
place  name               frame
====== ================== ==================================================================
0      base               right after ``F0``: fixed, joint 1 turns about its z axis
i      joint i            right after ``Ji(qi)``: moves with the joint, z is the joint's axis
n + 1  tip                axes of the flange (right after ``Fn``), origin at the tip
====== ================== ==================================================================

A *motion* at a place has six components ``(rx, ry, rz, tx, ty, tz)``: a rotation vector [rad], then a translation
[mm], both along the place's own axes. As a finite motion it turns first and is then shifted, ``v -> t + Rot(r) v``.
It is inserted at its place: ``F0 E0 J1 E1 F1 ... Jn En Fn (tip + E(n+1))``; at the tip a rotation turns the
flange's axes, as a tool is turned on its flange, and does not move the tip.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm.rigid_motions import CROSS, cos_sin, cross_matrix, rotations, rotations_and_jacobians
from truearm.arm.rigid_motions import exponential_derivative as exponential_derivative
from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray

CHUNK = 4096  # poses that are evaluated together: of fewer the number of array operations counts
FEW = 64  # poses up to which the number of array operations counts, not their length
# A hundred kilometres: longer lengths have a wrong unit, or were made to overflow.
MAX_LENGTH_MM = 1e8


class Pose(NamedTuple):
    """Tip poses.

    Attributes
    ----------
    R_base_tip : (n, 3, 3) array
        Orientations of the flange: its axes in the base frame are the columns.
    tip_in_base : (n, 3) array
        [mm].
    """

    R_base_tip: FloatArray
    tip_in_base: FloatArray


class _Frames(NamedTuple):
    """Of m poses: frames (n_joints + 1, m, 4, 4) of places, and the flange's (m, 4, 4), in the base frame; tips."""

    places: FloatArray
    flange: FloatArray
    tips: FloatArray


class _Finite(NamedTuple):
    """Finite motions: shifts (n_places, 3, m), rotations and their left Jacobians, transposed, (n_places, 3, 3, m)."""

    shifts: FloatArray
    turned_back: FloatArray
    jacobians: FloatArray

    @classmethod
    def of(cls, motions: FloatArray) -> _Finite:
        """Of motions (n_places, 6, m)."""
        R, J = rotations_and_jacobians(_back(motions))
        return cls(motions[:, 3:], _by_place(R, motions), _by_place(J, motions))

    @classmethod
    def without_jacobians(cls, motions: FloatArray) -> _Finite:
        """Of motions (n_places, 6, m), whose Jacobians nobody needs."""
        R = _by_place(rotations(_back(motions)), motions)
        return cls(motions[:, 3:], R, R[:0])


class TipDerivatives(NamedTuple):
    """Tip positions and their derivatives by the six small motions at every place.

    Attributes
    ----------
    tip_in_base : (n, 3) array
        [mm].
    motion_jacobian : (n, n_places, 6, 3) array
        Derivative of the tip by a motion at a place: rotations about the place's x, y, z [mm/rad], then
        translations along them [mm/mm].
    """

    tip_in_base: FloatArray
    motion_jacobian: FloatArray


class PoseDerivatives(NamedTuple):
    """Tip poses and their derivatives, laid out by component, poses last.

    A derivative of a pose has six components: translation of the tip [mm], then rotation of the flange [rad], both
    along the axes of the base frame.

    Attributes
    ----------
    R_base_tip : (3, 3, m) array
        Orientations of the flange.
    tip_in_base : (3, m) array
        [mm].
    by_joint : (n_joints, 6, m) array
        Derivative by each joint [per rad, or per mm for sliding joints].
    by_motion : (n_places, 6, 6, m) array
        Derivative by each component of the motion at each place [per rad, then per mm].
    """

    R_base_tip: FloatArray
    tip_in_base: FloatArray
    by_joint: FloatArray
    by_motion: FloatArray


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain of revolute and prismatic joints.

    Parameters
    ----------
    fixed : (n_joints + 1, 4, 4) array
        The constant rigid motions F0 .. Fn as homogeneous matrices, translations in mm. Rotations that are exact to
        1e-6 only, as printed numbers are, are replaced by the nearest exact ones.
    tip_in_flange : (3,) array
        The tip in the frame after Fn [mm].
    prismatic : (n_joints,) bool array, optional
        Which joints slide along their z axis [mm] instead of turning about it [rad]. None by default.
    coupling : (n_joints, n_joints) array, optional
        ``joint = coupling @ encoder``, see `truearm.arm.couplings`: the angles that methods take are then those of the
        encoders. None by default, as for the identity.

    Raises
    ------
    InputError
        If the shapes do not fit, a number is not finite, or an F is not a rigid motion (1e-6).
    """

    fixed: FloatArray
    tip_in_flange: FloatArray
    prismatic: BoolArray | None = None
    coupling: FloatArray | None = None

    def __post_init__(self) -> None:
        fixed = np.array(self.fixed, dtype=float)
        tip = np.array(self.tip_in_flange, dtype=float)
        if fixed.ndim != 3 or fixed.shape[1:] != (4, 4) or len(fixed) < 2:
            raise InputError(
                f"a chain needs (n_joints + 1, 4, 4) fixed motions and at least one joint, got {fixed.shape}"
            )
        if tip.shape != (3,):
            raise InputError(f"the tip must be three coordinates in mm, got shape {tip.shape}")
        prismatic = np.zeros(len(fixed) - 1, bool) if self.prismatic is None else np.array(self.prismatic, dtype=bool)
        if prismatic.shape != (len(fixed) - 1,):
            raise InputError(f"expected {len(fixed) - 1} joint types, got shape {prismatic.shape}")
        if not (np.isfinite(fixed).all() and np.isfinite(tip).all()):
            raise InputError("a chain's constants must be finite numbers")
        if max(np.abs(fixed).max(), np.abs(tip).max()) > MAX_LENGTH_MM:
            raise InputError(f"a chain's lengths must stay below {MAX_LENGTH_MM:g} mm: check their units")
        R = fixed[:, :3, :3]
        skew = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        rigid = (skew < 1e-6) & (np.linalg.det(R) > 0) & (np.abs(fixed[:, 3] - [0, 0, 0, 1]).max(axis=1) < 1e-12)
        if not rigid.all():
            raise InputError(f"F{int(np.argmin(rigid))} of the chain is not a rigid motion (rotation and translation)")
        if skew.max() > 1e-12:  # numbers printed with few digits: use the nearest rotations
            U, _, Vt = np.linalg.svd(R)
            fixed[:, :3, :3] = U @ Vt
        for name, value in (("fixed", fixed), ("tip_in_flange", tip), ("prismatic", prismatic)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if self.coupling is not None:
            object.__setattr__(self, "coupling", self._checked_coupling())

    def _checked_coupling(self) -> FloatArray | None:
        matrix, n = np.array(self.coupling, dtype=float), self.n_joints
        if matrix.shape != (n, n) or not np.isfinite(matrix).all():
            raise InputError(f"expected a coupling of {n} x {n} finite numbers, got shape {matrix.shape}")
        if not matrix.any(axis=1).all():
            raise InputError(f"no encoder moves joint {int(np.argmin(matrix.any(axis=1))) + 1} of the coupling")
        matrix.flags.writeable = False
        return None if np.array_equal(matrix, np.eye(n)) else matrix

    def __repr__(self) -> str:
        return f"Chain({self.n_joints} joints, tip {self.tip_in_flange.tolist()} mm)"

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.fixed) - 1

    @property
    def is_prismatic(self) -> BoolArray:
        """(n_joints,) True for the joints that slide along their z axis instead of turning about it."""
        assert self.prismatic is not None  # set in __post_init__
        return self.prismatic

    @cached_property
    def has_slides(self) -> bool:
        """Whether any of its joints slides."""
        return bool(self.is_prismatic.any())

    @property
    def n_places(self) -> int:
        """Number of places of small motions: base, every joint, tip."""
        return self.n_joints + 2

    @property
    def reach(self) -> float:
        """Upper bound of the distance from joint 1 to the tip with sliding joints at zero [mm]."""
        return float(np.linalg.norm(self.fixed[1:, :3, 3], axis=1).sum() + np.linalg.norm(self.tip_in_flange))

    @property
    def is_read(self) -> BoolArray:
        """(n_joints,) Whether the angle in a joint's column moves a joint: not that of one that only mimics others."""
        return np.ones(self.n_joints, dtype=bool) if self.coupling is None else np.asarray(self.coupling.any(axis=0))

    def joint_angles(self, angles: FloatArray) -> FloatArray:
        """(n, n_joints) angles of the joints by those of the encoders [rad, or mm]; the same without a coupling."""
        return angles if self.coupling is None else angles @ self.coupling.T

    def by_encoders(self, by_joints: FloatArray) -> FloatArray:
        """Derivatives (.., n_joints) by the encoders from those by the joints; the same without a coupling."""
        return by_joints if self.coupling is None else by_joints @ self.coupling

    def tip_in_base(self, angles: npt.ArrayLike, motions: npt.ArrayLike | None = None) -> FloatArray:
        """Tip positions.

        Parameters
        ----------
        angles : (n, n_joints) array
            Joint angles [rad], or displacements of sliding joints [mm].
        motions : (n, n_places, 6) array, optional
            Finite motions composed exactly at every place, a set for each pose.

        Returns
        -------
        (n, 3) array
            [mm].
        """
        angles = self._checked(angles)
        tips = np.empty((3, len(angles)))
        for rows, q, finite in self._pieces(angles, motions):
            few = q.shape[1] <= FEW
            tips[:, rows] = self._frames_of_few(q, finite).tips.T if few else self._outward(q, finite)[0]
        return tips.T

    def pose(self, angles: npt.ArrayLike, motions: npt.ArrayLike | None = None) -> Pose:
        """Tip poses: orientation of the flange and position of the tip.

        Parameters
        ----------
        angles : (n, n_joints) array
            Joint angles [rad], or displacements of sliding joints [mm].
        motions : (n, n_places, 6) array, optional
            Finite motions composed exactly at every place, a set for each pose.
        """
        angles = self._checked(angles)
        R, tip = np.empty((len(angles), 3, 3)), np.empty((3, len(angles)))
        for rows, q, finite in self._pieces(angles, motions):
            axes = np.empty((self.n_places, 3, 3, q.shape[1]))
            self._inward(q, finite, axes)
            R[rows], tip[:, rows] = _flange(axes, finite).transpose(2, 0, 1), self._outward(q, finite)[0]
        return Pose(R, tip.T)

    def pose_derivatives(self, angles: npt.ArrayLike, motions: FloatArray | None = None) -> PoseDerivatives:
        """Tip poses and their derivatives by the joints and by the motions at every place.

        Parameters
        ----------
        angles : (m, n_joints) array
            Joint angles [rad], or displacements of sliding joints [mm].
        motions : (n_places, 6, m) or (n_places, 6, 1) array, optional
            Finite motions composed exactly at every place [rad, mm]; the derivatives by motions are those by their
            components, and those by joints are at constant motions.
        """
        q = _by_component(self.joint_angles(self._checked(angles)))
        by_motion = np.zeros((self.n_places, 6, 6, q.shape[1]))
        finite = None if motions is None else _Finite.of(motions)
        tips = self._small_motions_into(q, by_motion[:, :, :3], finite)
        axes = by_motion[:, 3:, :3]  # (place, axis, component, m): translations along the axes of every place
        by_motion[:, :3, 3:] = axes if finite is None else _by_rotation_vectors(axes, finite.jacobians)
        by_joint = np.zeros((self.n_joints, 6, q.shape[1]))
        _, arms = self._outward(q, finite)
        if finite is not None:  # about the joint's axis, where the place was before its shift
            arms += finite.shifts[:-1]
        x_axes, y_axes, z_axes = axes[1:-1].transpose(1, 0, 2, 3)
        by_joint[:, :3] = arms[1:, :1] * y_axes - arms[1:, 1:2] * x_axes  # z x (p - o)
        by_joint[:, 3:] = z_axes
        by_joint[self.is_prismatic, :3], by_joint[self.is_prismatic, 3:] = z_axes[self.is_prismatic], 0.0
        return PoseDerivatives(_flange(axes, finite), tips, by_joint, by_motion)

    def pose_jacobians(
        self, angles: npt.ArrayLike, derivatives: Callable[[slice], PoseDerivatives] | None = None
    ) -> tuple[Pose, FloatArray]:
        """Tip poses and their derivatives by the joints.

        Parameters
        ----------
        angles : (n, n_joints) array
            Joint angles [rad], or displacements of sliding joints [mm].
        derivatives : callable, optional
            Returns the derivatives of some poses; by default those of this chain without motions.

        Returns
        -------
        Pose
        (n, 6, n_joints) array
            Translation of the tip [mm], then rotation of the flange [rad], along the axes of the base frame, per rad or
            mm of the joint, or of its encoder where joints are coupled.
        """
        angles = self._checked(angles)
        R, tip = np.empty((len(angles), 3, 3)), np.empty((len(angles), 3))
        jacobian = np.empty((len(angles), 6, self.n_joints))
        for rows in _chunks(len(angles)):
            here = self.pose_derivatives(angles[rows]) if derivatives is None else derivatives(rows)
            R[rows], tip[rows] = here.R_base_tip.transpose(2, 0, 1), here.tip_in_base.T
            jacobian[rows] = self.by_encoders(here.by_joint.transpose(2, 1, 0))
        return Pose(R, tip), jacobian

    def tip_derivatives(self, angles: npt.ArrayLike) -> TipDerivatives:
        """Tip positions and their derivatives by the six small motions at every place.

        With ``z`` an axis of the place and ``o`` its origin, the derivative of the tip ``p`` is ``z x (p - o)`` for a
        rotation and ``z`` for a translation; at the tip a rotation does nothing.

        Parameters
        ----------
        angles : (n, n_joints) array
            Joint angles [rad], or displacements of sliding joints [mm].
        """
        angles = self._checked(angles)
        angles = self.joint_angles(angles)
        tip = np.empty((3, len(angles)))
        motion_jacobian = np.empty((self.n_places, 6, 3, len(angles)))
        for rows in _chunks(len(angles)):
            tip[:, rows] = self._small_motions_into(_by_component(angles[rows]), motion_jacobian[..., rows])
        return TipDerivatives(tip.T, motion_jacobian.transpose(3, 0, 1, 2))

    def tip_derivatives_by_chunk(
        self, angles: npt.ArrayLike, motions: Callable[[slice], FloatArray] | None = None, *, chunk: int = CHUNK
    ) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Yield `tip_derivatives` in cache-sized pieces laid out by component, for sums over many poses.

        Parameters
        ----------
        angles : (n, n_joints) array
            Joint angles [rad], or displacements of sliding joints [mm].
        motions : callable, optional
            Returns the finite motions (n_places, 6, m) [rad, mm] of a piece, composed exactly; of length 1 in place of
            m if they are the same in every pose. The derivatives are then those by the motions' components.
        chunk : int
            Poses of a piece.

        Yields
        ------
        rows : slice
            The poses of this piece.
        tip_in_base : (3, m) array
            [mm].
        motion_jacobian : (n_places, 6, 3, m) array
            As in `TipDerivatives`, poses last. The array is overwritten by the next piece.
        """
        angles = self.joint_angles(self._checked(angles))
        work = np.empty((self.n_places, 6, 3, min(chunk, len(angles))))
        for rows in _chunks(len(angles), chunk):
            q = _by_component(angles[rows])
            if q.shape[1] < work.shape[3]:  # the last piece
                work = np.empty((*work.shape[:3], q.shape[1]))
            finite = None if motions is None else _Finite.of(motions(rows))
            yield rows, self._small_motions_into(q, work, finite), work

    def with_motions(self, motions: npt.ArrayLike) -> Chain:
        """Build the chain with a constant finite motion composed at every place.

        Parameters
        ----------
        motions : (n_places, 6) array
            Rotation vectors [rad] and translations [mm] along the places' axes.
        """
        motions = np.asarray(motions, dtype=float)
        if motions.shape != (self.n_places, 6):
            raise InputError(f"expected motions of shape {(self.n_places, 6)}, got {motions.shape}")
        E = np.tile(np.eye(4), (self.n_joints + 1, 1, 1))
        E[:, :3, :3] = Rotation.from_rotvec(motions[:-1, :3]).as_matrix()
        E[:, :3, 3] = motions[:-1, 3:]
        fixed = np.concatenate([(self.fixed[0] @ E[0])[None], E[1:] @ self.fixed[1:]])
        tip = self.tip_in_flange + motions[-1, 3:]
        if motions[-1, :3].any():
            turned = Rotation.from_rotvec(motions[-1, :3]).as_matrix()
            fixed[-1, :3, :3] = fixed[-1, :3, :3] @ turned
            tip = turned.T @ tip
        return Chain(fixed, tip, self.prismatic, self.coupling)

    def with_reference_frame(self, T_reference_base: npt.ArrayLike) -> Chain:
        """Build the chain in another frame: its tips are then in the reference frame.

        Parameters
        ----------
        T_reference_base : (4, 4) array
            The arm's base frame in the reference frame, translation in mm.
        """
        fixed = self.fixed.copy()
        fixed[0] = np.asarray(T_reference_base, dtype=float) @ fixed[0]
        return Chain(fixed, self.tip_in_flange, self.prismatic, self.coupling)

    def with_tip(self, tip_in_flange: npt.ArrayLike) -> Chain:
        """Build the chain with another tip (3,) [mm]."""
        return Chain(self.fixed, np.asarray(tip_in_flange, dtype=float), self.prismatic, self.coupling)

    # One pass from the tip to the base carries the tip through every frame; one pass from the base to the flange
    # carries the frames' axes. Everything above is one or both of them. Arrays are laid out by component, poses last.
    # Rotations of motions are transposed: sums over the last index take two thirds of the time.

    def _outward(self, q: FloatArray, finite: _Finite | None) -> tuple[FloatArray, FloatArray]:
        """Tips (3, m), and arms (n_joints + 1, 3, m) from where the rotation of each place's motion turns them.

        Arms are along the place's axes before the motion: across an axis that the tip is on they are zero, which
        differences of points in the base frame are not.
        """
        (cos, sin), v = cos_sin(q), np.empty((3, q.shape[1]))
        arms = np.empty((self.n_joints + 1, *v.shape))
        v[:] = self.tip_in_flange[:, None] if finite is None else self.tip_in_flange[:, None] + finite.shifts[-1]
        for place in range(self.n_joints, -1, -1):
            if place:
                v = self.fixed[place, :3, :3] @ v
                v += self.fixed[place, :3, 3, None]
            if finite is not None:
                v = np.einsum("bam,bm->am", finite.turned_back[place], v)
            arms[place] = v
            if finite is not None:
                v += finite.shifts[place]
            if place and self.is_prismatic[place - 1]:
                v[2] += q[place - 1]
            elif place:
                _turn(v[0], v[1], cos[place - 1], sin[place - 1])
        return self.fixed[0, :3, :3] @ v + self.fixed[0, :3, 3, None], arms

    def _inward(self, q: FloatArray, finite: _Finite | None, axes: FloatArray) -> None:
        """Write the axes (n_places, 3 axes, 3 components, m) of the places, before the motions there, into `axes`."""
        (cos, sin), R = cos_sin(q), np.repeat(self.fixed[0, :3, :3, None], q.shape[1], axis=2)
        for place in range(self.n_joints + 1):
            axes[place] = R.swapaxes(0, 1)
            if finite is not None:
                R = _product(R, finite.turned_back[place])
            if place:
                R = np.matmul(self.fixed[place, :3, :3].T, R)
            if place < self.n_joints and not self.is_prismatic[place]:
                _turn(R[:, 0], R[:, 1], cos[place], -sin[place])
        axes[-1] = R.swapaxes(0, 1)

    def _small_motions_into(self, q: FloatArray, out: FloatArray, finite: _Finite | None = None) -> FloatArray:
        """The tips (3, m), and the derivatives into `out`."""
        if q.shape[1] <= FEW:
            return self._small_motions_of_few(q, out, finite)
        (tips, arms), axes = self._outward(q, finite), out[:, 3:]
        self._inward(q, finite, axes)
        turned = np.matmul(CROSS.T, arms).reshape(-1, 3, *arms.shape[1:])  # (place, axis x y z, along x y z, m)
        if finite is not None:
            turned = _by_rotation_vectors(turned, finite.jacobians[:-1])
        np.einsum("pabm,pbcm->pacm", turned, axes[:-1], out=out[:-1, :3])
        out[-1, :3] = 0.0
        return tips

    def _small_motions_of_few(self, q: FloatArray, out: FloatArray, finite: _Finite | None) -> FloatArray:
        """The same by matrices of all places: the number of operations counts."""
        frames, flange, tips = self._frames_of_few(q, finite)
        R, axes_of_flange = frames[..., :3, :3], flange[:, :3, :3]
        arm = frames[..., :3, 3] - tips
        if finite is not None:
            arm = arm + (R @ finite.shifts[:-1].transpose(0, 2, 1)[..., None])[..., 0]
        turns = cross_matrix(arm) @ R  # z x (p - o), for all three axes
        if finite is not None:
            turns = turns @ finite.jacobians[:-1].transpose(0, 3, 2, 1)
        out[:-1, :3], out[:-1, 3:] = turns.transpose(0, 3, 2, 1), R.transpose(0, 3, 2, 1)
        out[-1, :3], out[-1, 3:] = 0.0, axes_of_flange.transpose(2, 1, 0)
        return np.asarray(tips.T)

    def _frames_of_few(self, q: FloatArray, finite: _Finite | None) -> _Frames:
        """The frames of all places but the tip in the base frame, before the motions there; flange and tips."""
        (n, m), slides = q.shape, self.is_prismatic
        steps = np.zeros((n, m, 4, 4))
        cos, sin = cos_sin(q)
        steps[..., 0, 0] = steps[..., 1, 1] = cos
        steps[..., 2, 2] = steps[..., 3, 3] = 1.0
        steps[..., 0, 1], steps[..., 1, 0] = -sin, sin
        if self.has_slides:
            steps[slides, :, :2, :2] = np.eye(2)
            steps[slides, :, 2, 3] = q[slides]
        steps[1:] = self.fixed[1:-1, None] @ steps[1:]
        last, tip = self.fixed[-1], self.tip_in_flange
        if finite is not None:
            moved = np.zeros((n + 1, finite.shifts.shape[2], 4, 4))
            moved[..., :3, :3] = finite.turned_back[:-1].transpose(0, 3, 2, 1)
            moved[..., :3, 3] = finite.shifts[:-1].transpose(0, 2, 1)
            moved[..., 3, 3] = 1.0
            steps, last, tip = moved[:-1] @ steps, moved[-1] @ last, tip + finite.shifts[-1].T
        frames = np.empty((n + 1, m, 4, 4))
        frames[0] = self.fixed[0]
        for place, step in enumerate(steps):
            np.matmul(frames[place], step, out=frames[place + 1])
        flange = frames[-1] @ last
        return _Frames(frames, flange, (flange[:, :3, :3] @ tip[..., None])[..., 0] + flange[:, :3, 3])

    def _checked(self, angles: npt.ArrayLike) -> FloatArray:
        angles = np.asarray(angles, dtype=float)
        if angles.ndim != 2 or angles.shape[1] != self.n_joints:
            raise InputError(f"expected angles of shape (n, {self.n_joints}), one column a joint, got {angles.shape}")
        return angles

    def _pieces(
        self, angles: FloatArray, motions: npt.ArrayLike | None
    ) -> Iterator[tuple[slice, FloatArray, _Finite | None]]:
        """Poses that are evaluated together: which, their angles (n_joints, m), and their motions."""
        angles = self.joint_angles(angles)
        moved, shape = None if motions is None else np.asarray(motions, dtype=float), (len(angles), self.n_places, 6)
        if moved is not None and moved.shape != shape:
            raise InputError(f"expected motions of shape {shape}, got {moved.shape}")
        for rows in _chunks(len(angles)):
            finite = None if moved is None else _Finite.without_jacobians(moved[rows].transpose(1, 2, 0))
            yield rows, _by_component(angles[rows]), finite


def _back(motions: FloatArray) -> FloatArray:
    """Rotation vectors (3, n_places m) back from motions, for all places in one pass."""
    return -motions[:, :3].transpose(1, 0, 2).reshape(3, -1)


def _by_place(matrices: FloatArray, motions: FloatArray) -> FloatArray:
    """Matrices (n_places, 3, 3, m) from those (3, 3, n_places m) of one pass."""
    n_places, _, m = motions.shape
    return matrices.reshape(3, 3, n_places, m).transpose(2, 0, 1, 3)


def _turn(x: FloatArray, y: FloatArray, cos: FloatArray, sin: FloatArray) -> None:
    """Turn vectors about z, their components where they are."""
    by_x = sin * x
    x *= cos
    x -= sin * y
    y *= cos
    y += by_x


def _product(R: FloatArray, turned_back: FloatArray) -> FloatArray:
    """Products of matrices (3, 3, m) with transposed ones, (3, 3, m) or (3, 3, 1)."""
    if turned_back.shape[2] == 1:  # the same in every pose
        return np.asarray(np.matmul(turned_back[:, :, 0], R))
    return np.asarray(np.einsum("cam,bam->cbm", R, turned_back))


def _flange(axes: FloatArray, finite: _Finite | None) -> FloatArray:
    """(3, 3, m) orientations of the flange in the base frame, turned by a motion at the tip."""
    R = axes[-1].swapaxes(0, 1)
    return R if finite is None else _product(R, finite.turned_back[-1])


def _by_rotation_vectors(by_axes: FloatArray, jacobians: FloatArray) -> FloatArray:
    """Derivatives (.., 3, k, m) by rotation vectors from those by axes, by transposed Jacobians (.., 3, 3, m or 1)."""
    return np.asarray(np.einsum("...acm,...bam->...bcm", by_axes, jacobians))


def _by_component(angles: FloatArray) -> FloatArray:
    return np.ascontiguousarray(angles.T)


def _chunks(n: int, size: int = CHUNK) -> Iterator[slice]:
    for start in range(0, n, size):
        yield slice(start, min(start + size, n))
