"""Finite motions ``v -> t + Rot(r) v``: their action on vectors and axes, and their derivative."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray


def exponential_derivative(motions: npt.ArrayLike) -> FloatArray:
    """Give the small motion that a change of a finite motion's components amounts to.

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
    angle = np.linalg.norm(r, axis=-1)[..., None, None]
    K = cross_matrix(r)
    small = angle < 1e-4  # the series' next term is angle^4/720: below rounding
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    b = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    J = np.eye(3) + a * K + b * (K @ K)
    out = np.zeros((*motions.shape[:-1], 6, 6))
    out[..., :3, :3] = J
    out[..., 3:, :3] = cross_matrix(t) @ J
    out[..., 3:, 3:] = np.eye(3)
    return out


def cross_matrix(v: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices K of vectors v (..., 3) with ``K w = v x w``."""
    K = np.zeros((*v.shape, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return K - np.swapaxes(K, -1, -2)


def apply_motions(v: FloatArray, motion: FloatArray) -> FloatArray:
    """Apply finite motions (6, m) to vectors (3, m) by Rodrigues' formula."""
    r, t = motion[:3], motion[3:]
    angle = np.sqrt((r * r).sum(axis=0))
    sinc = np.sinc(angle / np.pi)
    half = np.sinc(angle / (2 * np.pi))  # (1 - cos a) / a^2 = half^2 / 2 without cancellation
    rv = _cross(r, v)
    moved: FloatArray = v + sinc * rv + (0.5 * half * half) * _cross(r, rv) + t
    return moved


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products a x b of vectors (3, m), row by row: half the time of `numpy.cross`, which goes through copies."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=out[i])
        out[i] -= a[k] * b[j]
    return out


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
    square = (r * r).sum(axis=0)
    angle = np.sqrt(square)
    small = angle < 1e-4  # the next terms are angle^4 / 120: below rounding
    safe = np.where(small, 1.0, angle)
    sinc = np.where(small, 1 - square / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    c = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    outer = r[:, None] * r[None, :]  # K^2 = r r^T - |r|^2
    eye = np.eye(3)[:, :, None]
    K = np.zeros((3, 3, r.shape[1]))
    K[0, 1], K[0, 2], K[1, 2] = -r[2], r[1], -r[0]
    K -= K.transpose(1, 0, 2)
    K2 = outer - square * eye
    return eye + sinc * K + b * K2, eye + b * K + c * K2
