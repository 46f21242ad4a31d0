"""Rigid motions: frames as 4 x 4 matrices, finite motions ``v -> t + Rot(r) v`` and their derivatives.

SciPy's `Rotation` makes the frames. Motions of thousands of poses go through functions of our own: they take arrays
with the poses last, as the chain has them, and give rotations together with their Jacobians, which SciPy has not.
"""

from __future__ import annotations

from math import factorial

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.typing import FloatArray

# K(v) = v @ CROSS by rows, with K(v) w = v x w.
CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(0, 2, 1).reshape(3, 9)

FEW = 256  # rotation vectors up to which the number of array operations counts, not their length
SERIES_BELOW = 0.1  # squares of angles [rad^2] below which six terms of their series are exact to 1e-17
_SERIES = np.array([[(-1) ** k / factorial(2 * k + 2), (-1) ** k / factorial(2 * k + 3)] for k in range(6)])


def motion(R: FloatArray, t: npt.ArrayLike) -> FloatArray:
    """(.., 4, 4) rigid motions of rotations (.., 3, 3), or of one, and translations (.., 3), or one [mm]."""
    T = np.zeros((*(R.shape[:-2] or np.shape(t)[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def inverse(T: FloatArray) -> FloatArray:
    """(.., 4, 4) inverses of rigid motions."""
    back = np.swapaxes(T[..., :3, :3], -1, -2)
    return motion(back, -(back @ T[..., :3, 3:])[..., 0])


def exponential_derivative(motions: npt.ArrayLike) -> FloatArray:
    """Return the small motion that corresponds to a change of the components of a finite motion.

    Changing ``(r, t)`` to ``(r + dr, t + dt)`` composes on the left the small motion with rotation ``J dr`` and
    translation ``dt - (J dr) x t``, where ``J`` is the left Jacobian of the rotation group (Sola, Deray, Atchuthan,
    "A micro Lie theory for state estimation in robotics", arXiv 1812.01537, eq. 145).

    Parameters
    ----------
    motions : (..., 6) array
        Rotation vectors [rad], shorter than pi, and translations [mm].

    Returns
    -------
    (..., 6, 6) array
        Column k is the small motion by component k.
    """
    motions = np.asarray(motions, dtype=float)
    r, t = motions[..., :3], motions[..., 3:]
    J = rotations_and_jacobians(r.reshape(-1, 3).T)[1].transpose(2, 0, 1).reshape(*r.shape, 3)
    out = np.zeros((*motions.shape[:-1], 6, 6))
    out[..., :3, :3] = J
    out[..., 3:, :3] = cross_matrix(t) @ J
    out[..., 3:, 3:] = np.eye(3)
    return out


def cross_matrix(v: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices K of vectors v (..., 3) with ``K w = v x w``."""
    return np.asarray(v @ CROSS).reshape(*v.shape, 3)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products a x b of vectors (3, m), row by row: half the time of `numpy.cross`, which goes through copies."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=out[i])
        out[i] -= a[k] * b[j]
    return out


def rotations(r: FloatArray) -> FloatArray:
    """Rotation matrices (3, 3, m) of rotation vectors (3, m) [rad]."""
    square, sinc, b, _ = _angle_functions(r)
    return _combined(r, 1 - b * square, sinc, b)


def rotations_and_jacobians(r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation matrices of rotation vectors and their left Jacobians.

    Parameters
    ----------
    r : (3, m) array
        [rad], shorter than pi.

    Returns
    -------
    R, J : (3, 3, m) array
        ``Rot(r + dr) = Rot(J dr) Rot(r)`` to first order in dr; see `exponential_derivative`.
    """
    square, sinc, b, c = _angle_functions(r)
    return _combined(r, 1 - b * square, sinc, b), _combined(r, 1 - c * square, b, c)


def _angle_functions(r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Square of the angle a, sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3, each (m,), to rounding.

    Of many small angles, as motions nearly always have, by series in a third of the time. Otherwise an angle below 1e-6
    counts as that.
    """
    square = (r * r).sum(axis=0)
    if len(square) > FEW and square.max() < SERIES_BELOW:
        of_series = np.multiply.outer(_SERIES[-1], square)
        for coefficients in _SERIES[-2:0:-1]:
            of_series += coefficients[:, None]
            of_series *= square
        b, c = of_series + _SERIES[0][:, None]
        return square, 1 - c * square, b, c
    angle = np.sqrt(np.maximum(square, 1e-12))
    half, sinc = np.sin(0.5 * angle) / angle, np.sin(angle) / angle
    # What the last loses to cancellation is rounding once it is times r r^T.
    return square, sinc, 2 * half * half, (1 - sinc) / (angle * angle)


def _combined(r: FloatArray, of_identity: FloatArray, of_cross: FloatArray, of_outer: FloatArray) -> FloatArray:
    """Sums (3, 3, m) of multiples (m,) of the identity, of the matrix of r x and of r r^T."""
    out = np.empty((3, 3, r.shape[1]))  # in this order, whatever that of `r`: the last line needs a view
    np.multiply((of_outer * r)[:, None], r, out=out)
    x, y, z = of_cross * r
    out[2, 1] += x
    out[1, 2] -= x
    out[0, 2] += y
    out[2, 0] -= y
    out[1, 0] += z
    out[0, 1] -= z
    out.reshape(9, -1)[::4] += of_identity
    return out


def cos_sin(q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosines and sines by the tangent of half the angle, to 1e-15.

    NumPy computes double sines and cosines one by one, but tangents eight at a time if the processor has AVX-512.
    Forward kinematics, most of whose time they were, is four times as fast there.
    """
    t = np.tan(0.5 * q)
    twice = 2.0 / (1.0 + t * t)
    return twice - 1.0, t * twice


def turn_matrices(cos: FloatArray, sin: FloatArray) -> FloatArray:
    """Rotations of a single pose about the joints' own axes, (n_joints, 3, 3), from cosines and sines (n_joints, 1)."""
    Z = np.zeros((len(cos), 3, 3))
    Z[:, 0, 0] = Z[:, 1, 1] = cos[:, 0]
    Z[:, 1, 0], Z[:, 0, 1] = sin[:, 0], -sin[:, 0]
    Z[:, 2, 2] = 1.0
    return Z


def screw_z(angle: float, distance: float) -> FloatArray:
    """(4, 4) rotation about z by `angle` [rad] and translation along it by `distance` [mm]; the two commute."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, distance], [0, 0, 0, 1]], dtype=float)


def screw_x(angle: float, distance: float) -> FloatArray:
    """(4, 4) rotation about x by `angle` [rad] and translation along it by `distance` [mm]; the two commute."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, distance], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]], dtype=float)


def frame_from_xyz_rpy(xyz: npt.ArrayLike, rpy: npt.ArrayLike) -> FloatArray:
    """Frame with a position and roll, pitch, yaw about the fixed axes x, y, z in this order, as URDF has it.

    Parameters
    ----------
    xyz : (3,) array
        Position [mm].
    rpy : (3,) array
        Roll, pitch, yaw [rad]: the rotation is Rz(yaw) Ry(pitch) Rx(roll).

    Returns
    -------
    (4, 4) array
    """
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_euler("xyz", np.asarray(rpy, dtype=float)).as_matrix()
    frame[:3, 3] = xyz
    return frame


def xyz_rpy_from_frame(frame: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Position [mm] and roll, pitch, yaw [rad] of a frame: the inverse of `frame_from_xyz_rpy`.

    Each angle is computed from the rotation that remains after the previous ones, so that the three together are exact
    even where roll and yaw turn about the same line (pitch of +-90 deg), a case in which SciPy's `Rotation.as_euler`
    warns and loses digits; there one of many answers is returned.

    Parameters
    ----------
    frame : (4, 4) array

    Returns
    -------
    xyz : (3,) array
        [mm].
    rpy : (3,) array
        [rad].
    """
    frame = np.asarray(frame, dtype=float)
    R = frame[:3, :3]
    # At +-90 deg of pitch the first column is rounding noise, and any yaw is right: use 0.
    yaw = np.arctan2(R[1, 0], R[0, 0]) if np.hypot(R[1, 0], R[0, 0]) > 1e-12 else 0.0
    left = screw_z(-yaw, 0.0)[:3, :3] @ R
    pitch = np.arctan2(-left[2, 0], left[0, 0])
    roll = np.arctan2(-left[1, 2], left[1, 1])
    return frame[:3, 3].copy(), np.array([roll, pitch, yaw])


def rotation_from_z_to(axis: npt.ArrayLike) -> FloatArray:
    """(3, 3) smallest rotation that brings the z axis to the unit vector `axis` (3,); about x for the opposite one."""
    axis = np.asarray(axis, dtype=float)
    if axis[2] < 0:  # by way of -z, so that 1 + z below is not near zero
        return rotation_from_z_to(-axis) @ np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    K = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])  # cross product with z x axis
    turn: FloatArray = np.eye(3) + K + K @ K / (1 + z)
    return turn
