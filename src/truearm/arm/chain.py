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

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm.rigid_motions import (
    apply_motions,
    cos_sin,
    cross_matrix,
    rotations,
    rotations_and_jacobians,
    turn_matrices,
)
from truearm.arm.rigid_motions import exponential_derivative as exponential_derivative
from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray

# Poses that are evaluated together: 4096 doubles a component keep the working set of one pass
# (about 60 components) inside a 2 MiB cache.
CHUNK = 4096
FEW = 64  # poses up to which the number of array operations counts, not their length
IN_ONE_ROW = 512  # poses up to which the rotations of all places are computed at once: they stay in the cache
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
        for rows, q, chunk in self._pieces(angles, motions):
            if q.shape[1] <= FEW:
                tips[:, rows] = self._frames_of_few(q, chunk, None if chunk is None else _turned_by(chunk)).tips.T
            else:
                tips[:, rows] = _last(self._outward(q, cos_sin(q), chunk))
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
        R, tip = np.empty((3, 3, len(angles))), np.empty((3, len(angles)))
        for rows, q, chunk in self._pieces(angles, motions):
            turns = cos_sin(q)
            R[:, :, rows] = self._flange(turns, None if chunk is None else _turned_by(chunk))
            tip[:, rows] = _last(self._outward(q, turns, chunk))
        return Pose(R.transpose(2, 0, 1), tip.T)

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
        finite = None if motions is None else _turned_by_with_jacobians(motions)
        tip, _ = self._small_motions_into(q, by_motion[:, :, :3], motions, finite)
        axes = by_motion[:, 3:, :3]  # (place, axis, component, m): translations along the axes of every place
        R = axes[-1].transpose(1, 0, 2)
        if finite is None:
            by_motion[:, :3, 3:] = axes
        else:
            turned_by, jacobians = finite
            np.einsum("pdcm,pdbm->pcbm", jacobians, axes, out=by_motion[:, :3, 3:])
            R = _product(R, turned_by[-1])
        by_joint = np.zeros((self.n_joints, 6, q.shape[1]))
        for place, v in self._outward(q, cos_sin(q), motions):
            if place < 1:
                break  # past joint 1
            x_axis, y_axis, z_axis = axes[place]
            if self.is_prismatic[place - 1]:
                by_joint[place - 1, :3] = z_axis
            else:
                by_joint[place - 1, :3] = v[0] * y_axis - v[1] * x_axis  # z x (p - o)
                by_joint[place - 1, 3:] = z_axis
        return PoseDerivatives(R, tip, by_joint, by_motion)

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
            tip[:, rows], _ = self._small_motions_into(_by_component(angles[rows]), motion_jacobian[..., rows])
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
            yield rows, *self._small_motions_into(q, work, None if motions is None else motions(rows))

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

    def _outward(
        self,
        q: FloatArray,
        turns: tuple[FloatArray, FloatArray],
        motions: FloatArray | None,
        turned_by: FloatArray | None = None,
    ) -> Iterator[tuple[int, FloatArray]]:
        """Yield (place, tip in that place's frame) from the last joint to the base (0), then (-1, tip in base).

        `turned_by` (n_places, 3, 3, m) are the rotations of the motions, if the caller has them.
        """
        cos, sin = turns
        if motions is not None and turned_by is None and q.shape[1] <= FEW:
            turned_by = _turned_by(motions)  # of all places in one pass
        v = np.empty((3, q.shape[1]))
        v[:] = self.tip_in_flange[:, None]
        if motions is not None:
            v += motions[-1, 3:]
        turn = turn_matrices(cos, sin) if q.shape[1] == 1 else None
        for i in range(self.n_joints, 0, -1):
            v = self.fixed[i, :3, :3].dot(v)  # of a single pose a quarter of the time of `matmul`
            v += self.fixed[i, :3, 3, None]
            if motions is not None:
                v = _moved(v, motions[i], None if turned_by is None else turned_by[i])
            yield i, v
            if turn is None or self.is_prismatic[i - 1]:
                v = self._joint(i, q, cos, sin, v)
            else:
                v = turn[i - 1].dot(v)
        if motions is not None:
            v = _moved(v, motions[0], None if turned_by is None else turned_by[0])
        yield 0, v
        v = self.fixed[0, :3, :3].dot(v)
        v += self.fixed[0, :3, 3, None]
        yield -1, v

    def _joint(self, i: int, q: FloatArray, cos: FloatArray, sin: FloatArray, v: FloatArray) -> FloatArray:
        """Turn or shift the vectors `v` (3, m) from joint i's moving frame to its fixed one."""
        out = np.empty_like(v)
        if self.is_prismatic[i - 1]:
            out[:2] = v[:2]
            np.add(v[2], q[i - 1], out=out[2])
            return out
        c, s = cos[i - 1], sin[i - 1]
        np.multiply(c, v[0], out=out[0])
        out[0] -= s * v[1]
        np.multiply(s, v[0], out=out[1])
        out[1] += c * v[1]
        out[2] = v[2]
        return out

    def _inward(
        self, turns: tuple[FloatArray, FloatArray], turned_by: FloatArray | None = None
    ) -> Iterator[tuple[int, FloatArray]]:
        """Yield (place, R_base_place (3 rows, 3 columns, m)) from the base to the last joint.

        The rotations `turned_by` (n_places, 3, 3, m) of motions act after their places.
        """
        cos, sin = turns
        R = np.empty((3, 3, cos.shape[1]))
        R[:] = self.fixed[0, :3, :3, None]
        yield 0, R
        for i in range(1, self.n_joints + 1):
            if turned_by is not None:
                R = _product(R, turned_by[i - 1])
            if i > 1:
                R = np.matmul(self.fixed[i - 1, :3, :3].T, R)
            if not self.is_prismatic[i - 1]:
                c, s = cos[i - 1], sin[i - 1]
                turned = np.empty_like(R)
                np.multiply(c, R[:, 0], out=turned[:, 0])
                turned[:, 0] += s * R[:, 1]
                np.multiply(c, R[:, 1], out=turned[:, 1])
                turned[:, 1] -= s * R[:, 0]
                turned[:, 2] = R[:, 2]
                R = turned
            yield i, R

    def _flange(self, turns: tuple[FloatArray, FloatArray], turned_by: FloatArray | None) -> FloatArray:
        """(3, 3, m) orientations of the flange in the base frame, turned by a motion at the tip."""
        R = _last(self._inward(turns, turned_by))
        if turned_by is None:
            return np.asarray(np.matmul(self.fixed[-1, :3, :3].T, R))
        R = np.matmul(self.fixed[-1, :3, :3].T, _product(R, turned_by[-2]))
        return _product(R, turned_by[-1])

    def _small_motions_into(
        self,
        q: FloatArray,
        out: FloatArray,
        motions: FloatArray | None = None,
        finite: tuple[FloatArray, FloatArray] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Tips and derivatives; `finite` are the rotations of the motions, if the caller has them."""
        turned_by, jacobians = None, None
        if motions is not None:
            turned_by, jacobians = finite or _turned_by_with_jacobians(motions)
        if q.shape[1] <= FEW:
            return self._small_motions_of_few(q, out, motions, turned_by, jacobians), out
        turns = cos_sin(q)
        tip_in_place = dict(self._outward(q, turns, motions, turned_by))
        for place, R in self._inward(turns, turned_by):
            tip, moved = tip_in_place[place], out[place]
            tip = tip if motions is None else tip - motions[place, 3:]
            x, y, z = tip[:, None]
            axes = np.swapaxes(R, 0, 1)  # (3 axes, 3 components, m)
            # z x (p - o) with p - o = R (x, y, z): a combination of the two other axes.
            np.multiply(y, axes[2], out=moved[0])
            moved[0] -= z * axes[1]
            np.multiply(z, axes[0], out=moved[1])
            moved[1] -= x * axes[2]
            np.multiply(x, axes[1], out=moved[2])
            moved[2] -= y * axes[0]
            moved[3:] = axes
            if jacobians is not None:
                moved[:3] = _by_rotation_vector(moved[:3], jacobians[place])
        if turned_by is not None:
            R = _product(R, turned_by[-2])
        out[-1, :3] = 0.0
        out[-1, 3:] = np.matmul(self.fixed[-1, :3, :3].T, R).transpose(1, 0, 2)
        return tip_in_place[-1], out

    def _small_motions_of_few(
        self,
        q: FloatArray,
        out: FloatArray,
        motions: FloatArray | None,
        turned_by: FloatArray | None,
        jacobians: FloatArray | None,
    ) -> FloatArray:
        """The tips, and the derivatives into `out`, by matrices of all places: the number of operations counts."""
        frames, flange, tips = self._frames_of_few(q, motions, turned_by)
        R, axes_of_flange = frames[..., :3, :3], flange[:, :3, :3]
        arm = frames[..., :3, 3] - tips
        if motions is not None:
            arm = arm + (R @ motions[:-1, 3:].transpose(0, 2, 1)[..., None])[..., 0]
        turns = cross_matrix(arm) @ R  # z x (p - o), for all three axes
        if jacobians is not None:
            turns = turns @ jacobians[:-1].transpose(0, 3, 1, 2)
        out[:-1, :3], out[:-1, 3:] = turns.transpose(0, 3, 2, 1), R.transpose(0, 3, 2, 1)
        out[-1, :3], out[-1, 3:] = 0.0, axes_of_flange.transpose(2, 1, 0)
        return np.asarray(tips.T)

    def _frames_of_few(self, q: FloatArray, motions: FloatArray | None, turned_by: FloatArray | None) -> _Frames:
        """The frames of all places but the tip in the base frame, before the motions there; the flange, and the tips.

        `turned_by` are the rotations of the motions, if there are any.
        """
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
        if motions is not None:
            assert turned_by is not None
            finite = np.zeros((n + 1, motions.shape[2], 4, 4))
            finite[..., :3, :3] = turned_by[:-1].transpose(0, 3, 1, 2)
            finite[..., :3, 3] = motions[:-1, 3:].transpose(0, 2, 1)
            finite[..., 3, 3] = 1.0
            steps, last, tip = finite[:-1] @ steps, finite[-1] @ last, tip + motions[-1, 3:].T
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
    ) -> Iterator[tuple[slice, FloatArray, FloatArray | None]]:
        """Poses that are evaluated together: which, their angles (n_joints, m) and motions (n_places, 6, m)."""
        angles = self.joint_angles(angles)
        moved, shape = None if motions is None else np.asarray(motions, dtype=float), (len(angles), self.n_places, 6)
        if moved is not None and moved.shape != shape:
            raise InputError(f"expected motions of shape {shape}, got {moved.shape}")
        for rows in _chunks(len(angles)):
            chunk = None if moved is None else np.ascontiguousarray(moved[rows].transpose(1, 2, 0))
            yield rows, _by_component(angles[rows]), chunk


def _turned_by(motions: FloatArray) -> FloatArray:
    """Rotations (n_places, 3, 3, m) of motions (n_places, 6, m)."""
    if motions.shape[2] <= IN_ONE_ROW:
        return _by_place(rotations(_in_one_row(motions)), motions)
    return np.stack([rotations(motion[:3]) for motion in motions])


def _turned_by_with_jacobians(motions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations of motions (n_places, 6, m) and their left Jacobians, (n_places, 3, 3, m) each."""
    if motions.shape[2] <= IN_ONE_ROW:
        R, J = rotations_and_jacobians(_in_one_row(motions))
        return _by_place(R, motions), _by_place(J, motions)
    both = [rotations_and_jacobians(motion[:3]) for motion in motions]
    turned_by, jacobians = (np.stack(arrays) for arrays in zip(*both, strict=True))
    return turned_by, jacobians


def _in_one_row(motions: FloatArray) -> FloatArray:
    """Rotation vectors (3, n_places m) of motions, for all places in one pass."""
    return motions[:, :3].transpose(1, 0, 2).reshape(3, -1)


def _by_place(matrices: FloatArray, motions: FloatArray) -> FloatArray:
    """Matrices (n_places, 3, 3, m) from those (3, 3, n_places m) of one pass."""
    n_places, _, m = motions.shape
    return matrices.reshape(3, 3, n_places, m).transpose(2, 0, 1, 3)


def _product(R: FloatArray, turned: FloatArray) -> FloatArray:
    """Products of matrices (3, 3, m)."""
    if R.shape[2] == turned.shape[2] == 1:
        return np.asarray(R[:, :, 0].dot(turned[:, :, 0]))[:, :, None]  # a fifth of the time of `einsum`
    if turned.shape[2] == 1:  # the same in every pose
        return np.asarray(np.matmul(turned[:, :, 0].T, R))
    return np.asarray(np.einsum("abm,bcm->acm", R, turned))


def _by_rotation_vector(by_axes: FloatArray, jacobians: FloatArray) -> FloatArray:
    """Derivatives (.., 3, 3, m) by rotation vectors, of Jacobians (.., 3, 3, m) or (.., 3, 3, 1), by those by axes."""
    if jacobians.shape[-1] > 1:
        return np.asarray(np.einsum("...dcm,...dbm->...cbm", jacobians, by_axes))
    flat = by_axes.reshape(*by_axes.shape[:-2], -1)
    return np.asarray(np.matmul(np.swapaxes(jacobians[..., 0], -1, -2), flat)).reshape(by_axes.shape)


def _moved(v: FloatArray, motion: FloatArray, R: FloatArray | None) -> FloatArray:
    """Vectors (3, m) after finite motions (6, m), whose rotations (3, 3, m) may be known."""
    if R is None:
        return apply_motions(v, motion)
    if R.shape[2] == v.shape[1] == 1:
        return np.asarray(R[:, :, 0].dot(v) + motion[3:])
    moved: FloatArray = R[:, 0] * v[0]
    moved += R[:, 1] * v[1]
    moved += R[:, 2] * v[2]
    moved += motion[3:]
    return moved


def _last(places: Iterator[tuple[int, FloatArray]]) -> FloatArray:
    return deque(places, maxlen=1)[0][1]


def _by_component(angles: FloatArray) -> FloatArray:
    return np.ascontiguousarray(angles.T)


def _chunks(n: int, size: int = CHUNK) -> Iterator[slice]:
    for start in range(0, n, size):
        yield slice(start, min(start + size, n))
