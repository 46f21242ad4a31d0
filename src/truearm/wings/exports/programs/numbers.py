"""Numbers as controllers write them: literal ones of a program, and orientations, one at a time.

Orientations are three angles (KUKA, Fanuc, Yaskawa) or quaternions (ABB).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, degrees, hypot, radians, sin, sqrt
from typing import NamedTuple

import numpy as np

from truearm.typing import FloatArray

NOT_THERE = 8.9e9  # 9E9 of RAPID: no such axis


class Number(NamedTuple):
    """A literal number: its bytes in the program, and its value in the unit of the language."""

    start: int
    end: int
    text: bytes

    @property
    def value(self) -> float:
        """What the bytes state."""
        try:
            return float(self.text)
        except ValueError:  # a blank behind its sign
            return float(self.text.translate(None, b" \t"))


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


def angles_of(R: FloatArray, near_deg: Sequence[float]) -> list[float]:
    """W, P, R [deg] of a rotation, of its several sets those next to other angles.

    Examples
    --------
    >>> [round(one, 9) for one in angles_of(rotation_of([170.0, 100.0, 200.0]), [170.0, 100.0, 200.0])]
    [170.0, 100.0, 200.0]
    """
    (a, b, _), (d, e, _), (g, h, i) = R.tolist()
    cosine = hypot(a, d)
    if cosine < _LOCKED:
        turn = atan2(-b, e)  # of R - W, or of R + W
        w = radians(near_deg[0])
        sets = [(w, atan2(-g, cosine), turn + (w if g < 0 else -w))]
    else:
        sets = [(atan2(s * h, s * i), atan2(-g, s * cosine), atan2(s * d, s * a)) for s in (1.0, -1.0)]
    found = []
    for angles in sets:
        whole = [degrees(one) for one in angles]
        turned = [one + 360.0 * round((near - one) / 360.0) for one, near in zip(whole, near_deg, strict=True)]
        found.append((max(abs(one - near) for one, near in zip(turned, near_deg, strict=True)), turned))
    return min(found)[1]
