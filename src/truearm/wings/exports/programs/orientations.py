"""Orientations as controllers write them: three angles (KUKA, Fanuc, Yaskawa), quaternions (ABB); one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, radians, sin, sqrt

import numpy as np

from truearm.typing import FloatArray

# At P = 90 deg only the sum or the difference of W and R is determined [cosine of P].
_LOCKED = 1e-9


def rotation_of(wpr_deg: Sequence[float]) -> FloatArray:
    """(3, 3) rotation Rz(R) Ry(P) Rx(W) of W, P, R [deg]; of KUKA these are C, B, A."""
    w, p, r = map(radians, wpr_deg)
    sw, cw, sp, cp, sr, cr = sin(w), cos(w), sin(p), cos(p), sin(r), cos(r)
    return np.array([
        [cr * cp, cr * sp * sw - sr * cw, cr * sp * cw + sr * sw],
        [sr * cp, sr * sp * sw + cr * cw, sr * sp * cw - cr * sw],
        [-sp, cp * sw, cp * cw],
    ])  # fmt: skip


def rotation_of_quaternion(q: Sequence[float]) -> FloatArray:
    """(3, 3) rotation of a quaternion of any length, scalar first."""
    length = sqrt(sum(one * one for one in q))
    w, x, y, z = (one / length for one in q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def quaternion_of(R: FloatArray, near: Sequence[float]) -> list[float]:
    """Unit quaternion of a rotation, scalar first; of its two signs the one next to another quaternion."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    # The largest component is computed without cancellation.
    largest = max((a + e + i, 0), (a - e - i, 1), (e - a - i, 2), (i - a - e, 3))[1]
    if largest == 0:
        q = [1 + a + e + i, h - f, c - g, d - b]
    elif largest == 1:
        q = [h - f, 1 + a - e - i, b + d, c + g]
    elif largest == 2:
        q = [c - g, b + d, 1 - a + e - i, f + h]
    else:
        q = [d - b, c + g, f + h, 1 - a - e + i]
    length = sqrt(sum(one * one for one in q))
    if sum(one * other for one, other in zip(q, near, strict=True)) < 0:
        length = -length
    return [one / length for one in q]


def angles_of(R: FloatArray, near_deg: Sequence[float]) -> FloatArray:
    """(3,) W, P, R [deg] of a rotation, of its several sets those next to other angles.

    Examples
    --------
    >>> angles_of(rotation_of([170.0, 100.0, 200.0]), [170.0, 100.0, 200.0]).round(9).tolist()
    [170.0, 100.0, 200.0]
    """
    near = np.asarray(near_deg, dtype=float)
    cosine = float(np.hypot(R[0, 0], R[1, 0]))
    if cosine < _LOCKED:
        w = np.radians(near[0])
        turn = np.arctan2(-R[0, 1], R[1, 1])  # of R - W, or of R + W
        found = np.array([[w, np.arctan2(-R[2, 0], cosine), turn + (w if R[2, 0] < 0 else -w)]])
    else:
        both = np.array([1.0, -1.0])
        w = np.arctan2(both * R[2, 1], both * R[2, 2])
        found = np.stack([w, np.arctan2(-R[2, 0], both * cosine), np.arctan2(both * R[1, 0], both * R[0, 0])], axis=1)
    degrees = np.degrees(found)
    degrees += 360.0 * np.round((near - degrees) / 360.0)
    return np.asarray(degrees[np.abs(degrees - near).max(axis=1).argmin()])
