"""What the makers' configurations state: signs and turns of joints, and the sides on which wrist and elbow are."""

from __future__ import annotations

import numpy as np

from truearm.typing import FloatArray
from truearm.wings.exports.programs.branches import N_JOINTS, Screws

QUANTITIES = (*(f"J{i}" for i in range(1, N_JOINTS + 1)), "shoulder", "elbow", "|J4|")


def quantities_of(screws: Screws, joints: FloatArray, counted: FloatArray) -> FloatArray:
    """What configurations are stated by, in the order of `QUANTITIES`.

    Parameters
    ----------
    screws : Screws
        Of the controller's arm.
    joints, counted : (.., 6) array
        Of the chain's joints, and as the controller counts them [rad].

    Returns
    -------
    (.., 9) array
        Joints [deg]; how far the wrist centre is in front of axis 1, and of the line from axis 2 to axis 3 [mm]; the
        magnitude of joint 4 [deg].
    """
    h, p = screws.axes, screws.points
    front, up = np.cross(h[1], h[0]), h[0] * (np.sign(h[0, 2]) or 1.0)  # of an axis 1 that points down, too
    front *= np.sign(front[0]) or 1.0
    # In the plane of the arm as it is before joint 1 turns.
    second, third = joints[..., 1], joints[..., 2] * (h[1] @ h[2])
    lower = _turned(h[1], second, p[2] - p[1])
    fore = _turned(h[1], second + third, screws.wrist - p[2])
    shoulder = (p[1] - p[0] + lower + fore) @ front
    link = lower / np.linalg.norm(p[2] - p[1])
    elbow = (fore @ front) * (link @ up) - (fore @ up) * (link @ front)
    degrees = np.degrees(counted)
    more = np.stack([shoulder, elbow, np.abs(degrees[..., 3])], axis=-1)
    return np.concatenate([degrees, more], axis=-1)


def _turned(axis: FloatArray, angle: FloatArray, v: FloatArray) -> FloatArray:
    along = axis * (axis @ v)
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    return np.asarray(along + c * (v - along) + s * np.cross(axis, v))
