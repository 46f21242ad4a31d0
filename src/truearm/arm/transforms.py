"""Rigid motions as 4 x 4 matrices: screws along z and x, roll-pitch-yaw, and the turn that brings z to an axis."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray


def screw_z(angle: float, distance: float) -> FloatArray:
    """(4, 4) turn about z by `angle` [rad] and shift along it by `distance` [mm]; the two commute."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, distance], [0, 0, 0, 1]], dtype=float)


def screw_x(angle: float, distance: float) -> FloatArray:
    """(4, 4) turn about x by `angle` [rad] and shift along it by `distance` [mm]; the two commute."""
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
    roll, pitch, yaw = np.asarray(rpy, dtype=float)
    c, s = np.cos(pitch), np.sin(pitch)
    turn_y = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    frame: FloatArray = screw_z(yaw, 0.0) @ turn_y @ screw_x(roll, 0.0)
    frame[:3, 3] = xyz
    return frame


def xyz_rpy_from_frame(frame: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Position [mm] and roll, pitch, yaw [rad] of a frame: the inverse of `frame_from_xyz_rpy`.

    Each angle is taken from what the ones before leave over, so the three together are exact even where roll and
    yaw turn about the same line (pitch of +-90 deg); there one of many answers is given.

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
    # At +-90 deg of pitch the first column is rounding noise, and any yaw will do: take none.
    yaw = np.arctan2(R[1, 0], R[0, 0]) if np.hypot(R[1, 0], R[0, 0]) > 1e-12 else 0.0
    left = screw_z(-yaw, 0.0)[:3, :3] @ R
    pitch = np.arctan2(-left[2, 0], left[0, 0])
    roll = np.arctan2(-left[1, 2], left[1, 1])
    return frame[:3, 3].copy(), np.array([roll, pitch, yaw])


def rotation_from_z_to(axis: npt.ArrayLike) -> FloatArray:
    """(3, 3) smallest rotation that brings the z axis to the unit vector `axis` (3,); about x for the opposite one."""
    axis = np.asarray(axis, dtype=float)
    if axis[2] < 0:  # go round by -z, so that 1 + z below stays away from zero
        return rotation_from_z_to(-axis) @ np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    K = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])  # cross product with z x axis
    turn: FloatArray = np.eye(3) + K + K @ K / (1 + z)
    return turn
