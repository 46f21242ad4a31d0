"""All joints of a six-axis arm that bring its flange to a pose, in closed form, and the configuration that each has.

Two kinds of arms are solved: those whose last three axes meet in a point (a spherical wrist), and those with three
parallel axes (2, 3 and 4), as those of Universal Robots. Axes 2 and 3 are parallel in both. Each joint follows from one
of two small problems (D. H. Pieper, 1968; B. Paden, 1986): an angle that turns a vector into another, and one that
gives a turned vector a component. Newton's method then removes what rounding left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.arm import Chain, Pose
from truearm.typing import BoolArray, FloatArray, IntArray

N_JOINTS = 6
N_BRANCHES = 8
_PARALLEL = 1e-6  # [rad]
_MEETING_MM = 1e-3
_NEWTON_STEPS = 5
_EXACT_MM = 1e-10
_REACHED_MM = 1e-6
_DAMPING = 1e-9
_ROUNDING = 1e-9
_TILTED = np.radians(0.05)  # a printed orientation is off by less


@dataclass(frozen=True, eq=False)
class Screws:
    """The axes of a chain in its base frame, all joints at zero.

    Attributes
    ----------
    axes, points : (6, 3) array
        Directions, and a point of each [mm].
    home : (4, 4) array
        Flange in the base.
    wrist : (3,) array
        Point where axes 5 and 6 meet; of a spherical wrist axis 4 as well [mm].
    is_spherical : bool
    """

    axes: FloatArray
    points: FloatArray
    home: FloatArray
    wrist: FloatArray
    is_spherical: bool

    @classmethod
    def of(cls, chain: Chain) -> Screws | None:
        """The axes of a chain, or None where no closed form is known here."""
        if chain.n_joints != N_JOINTS or chain.is_prismatic.any():
            return None
        axes, points, home = _at_home(chain)
        wrist = _meeting(axes[4:6], points[4:6])
        if wrist is None or not _are_parallel(axes[1], axes[2]) or _are_parallel(axes[0], axes[1]):
            return None
        to_wrist = wrist - points[3]
        is_spherical = bool(np.linalg.norm(np.cross(axes[3], to_wrist)) < _MEETING_MM)
        if not is_spherical and not _are_parallel(axes[2], axes[3]):
            return None
        return cls(axes, points, home, wrist, is_spherical)


@dataclass(frozen=True, eq=False)
class ParallelAxes:
    """The axes of a SCARA: of four parallel joints one slides.

    Attributes
    ----------
    axes, points : (4, 3) array
        As those of `Screws`.
    home : (4, 4) array
    turning : (3,) int array
        Joints that turn, from the base on.
    sliding : int
    """

    axes: FloatArray
    points: FloatArray
    home: FloatArray
    turning: IntArray
    sliding: int

    @classmethod
    def of(cls, chain: Chain) -> ParallelAxes | None:
        """The axes of a chain, or None of another arm."""
        slides = np.flatnonzero(chain.is_prismatic)
        if chain.n_joints != len(slides) + 3 or len(slides) != 1 or chain.coupling is not None:
            return None
        axes, points, home = _at_home(chain)
        if not all(_are_parallel(axes[0], axis) for axis in axes[1:]):
            return None
        return cls(axes, points, home, np.flatnonzero(~chain.is_prismatic), int(slides[0]))

    def branches(self, flange: FloatArray) -> FloatArray:
        """Joints (n, 2, 4) that bring the flange to poses (n, 4, 4); NaN where none do, as of a tilted flange."""
        a, (i, j, k), h, p = self.axes[0], self.turning, self.axes, self.points
        E = np.repeat((flange @ np.linalg.inv(self.home))[:, None], 2, axis=1)
        R, across = E[..., :3, :3], np.eye(3) - np.outer(a, a)
        q = np.empty((len(E), 2, len(h)))
        upper, fore = across @ (p[j] - p[i]), across @ (p[k] - p[j])
        target = (R @ p[k] + E[..., :3, 3] - p[i]) @ across
        far = (_dot(target, target) - upper @ upper - fore @ fore) / 2
        with np.errstate(invalid="ignore"):  # what no angle reaches is NaN from here on
            q[..., j] = _with_component(h[j], np.broadcast_to(fore, target.shape), upper, far, np.array([1.0, -1.0]))
            q[..., i] = _turning(h[i], upper + _turns(h[j], q[..., j]) @ fore, target)
            aside = np.cross(a, np.eye(3)[np.abs(a).argmin()])
            turn = _turning(a, np.broadcast_to(aside, R.shape[:-1]), R @ aside)
            turn = (turn - q[..., i] * (h[i] @ a) - q[..., j] * (h[j] @ a)) * (h[k] @ a)
            q[..., k] = np.pi - np.remainder(np.pi - turn, 2 * np.pi)
        q[..., self.sliding] = (flange[:, None, :3, 3] - self.home[:3, 3]) @ h[self.sliding]
        q[np.arccos(np.clip(_dot(R @ a, np.broadcast_to(a, R.shape[:-1])), -1, 1)) > _TILTED] = np.nan
        return q


def _at_home(chain: Chain) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Directions and points of the axes, and the flange, in the base at the zeros of the joints."""
    frames = [chain.fixed[0]]
    for fixed in chain.fixed[1:]:
        frames.append(frames[-1] @ fixed)
    axes = np.array([T[:3, 2] for T in frames[:-1]])
    return axes, np.array([T[:3, 3] for T in frames[:-1]]), frames[-1]


def inverse_branches(chain: Chain, screws: Screws, flange: FloatArray) -> FloatArray:
    """Joints (n, 8, 6) that bring the flange to poses (n, 4, 4), in (-pi, pi]; NaN where a branch does not exist."""
    E = flange @ np.linalg.inv(screws.home)
    h, p = screws.axes, screws.points
    R_E = np.repeat(E[:, None, :3, :3], N_BRANCHES, axis=1)
    c = np.repeat((E[:, :3, :3] @ screws.wrist + E[:, :3, 3])[:, None], N_BRANCHES, axis=1)
    first, second, third = (np.array([1.0, -1.0])[(np.arange(N_BRANCHES) >> bit) & 1] for bit in range(3))
    q = np.empty((len(E), N_BRANCHES, N_JOINTS))
    with np.errstate(invalid="ignore"):  # what no angle reaches is NaN from here on
        # The component along axis 2 does not change when joints parallel to it turn.
        v = c - p[0]
        q[..., 0] = -_with_component(h[0], v, h[1], (screws.wrist - p[0]) @ h[1], -first)
        R1 = _turns(h[0], q[..., 0])
        x, R = _back(R1, v) + p[0], np.swapaxes(R1, -1, -2) @ R_E
        if screws.is_spherical:
            _shoulder(q, screws, screws.wrist, x, second)
            R3 = np.swapaxes(_turns(h[1], q[..., 1]) @ _turns(h[2], q[..., 2]), -1, -2) @ R
            q[..., 4] = _with_component(h[4], h[5], h[3], _dot(R3 @ h[5], h[3]), third)
            R5 = _turns(h[4], q[..., 4])
            q[..., 3] = _turning(h[3], R5 @ h[5], R3 @ h[5])
            q[..., 5] = -_turning(h[5], _back(R5, h[3]), _back(R3, h[3]))
        else:
            q[..., 4] = _with_component(h[4], h[5], h[1], _dot(R @ h[5], h[1]), third)
            R5 = _turns(h[4], q[..., 4])
            q[..., 5] = -_turning(h[5], _back(R5, h[1]), _back(R, h[1]))
            R56 = R5 @ _turns(h[5], q[..., 5])
            R234 = R @ np.swapaxes(R56, -1, -2)
            # The point of axis 4, as seen from the flange.
            point = x + (R234 @ (p[3] - screws.wrist)[:, None])[..., 0]
            _shoulder(q, screws, p[3], point, second)
            across = np.cross(h[1], np.eye(3)[np.abs(h[1]).argmin()])
            turn = _turning(h[1], np.broadcast_to(across, R234.shape[:-1]), R234 @ across)
            q[..., 3] = (turn - q[..., 1] - q[..., 2] * (h[1] @ h[2])) * (h[1] @ h[3])
    q = np.pi - np.remainder(np.pi - q, 2 * np.pi)
    return q if chain.coupling is None else np.asarray(q @ np.linalg.inv(chain.coupling).T)


def _shoulder(q: FloatArray, screws: Screws, at_home: FloatArray, there: FloatArray, sign: FloatArray) -> None:
    """Joints 2 and 3 that bring a point from its place at home to another."""
    h, p = screws.axes, screws.points
    target, upper, fore = there - p[1], p[2] - p[1], at_home - p[2]
    far = (_dot(target, target) - upper @ upper - fore @ fore) / 2
    q[..., 2] = _with_component(h[2], np.broadcast_to(fore, target.shape), upper, far, sign)
    bent = upper + _turns(h[2], q[..., 2]) @ fore
    q[..., 1] = _turning(h[1], bent, target)


def polished(
    chain: Chain,
    flange: FloatArray,
    joints: FloatArray,
    *,
    turns: FloatArray | None = None,
    locked: BoolArray | None = None,
) -> FloatArray:
    """Joints after Newton's steps to flange poses.

    Parameters
    ----------
    chain : Chain
    flange : (n, 4, 4) array
    joints : (n, n_joints) array
    turns : (k, 3) array, optional
        Directions about which the orientation counts; all by default.
    locked : (n_joints,) bool array, optional
        Joints that stay.

    Returns
    -------
    (n, n_joints) array
        NaN where the flange remains elsewhere.
    """
    plain = chain.with_tip(np.zeros(3))
    turns = np.eye(3) if turns is None else turns
    which = np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros_like(turns), turns]])
    scale = np.array([1, 1, 1, *[max(chain.reach, 3.0) / 3] * len(turns)])
    moving = np.ones(chain.n_joints) if locked is None else ~locked
    q = joints.copy()
    rows = np.flatnonzero(np.isfinite(q).all(axis=1))
    for _ in range(_NEWTON_STEPS):
        missing = _missing(plain.pose(q[rows]), flange[rows]) @ which.T * scale
        away = np.abs(missing).max(axis=1) > _EXACT_MM
        rows, missing = rows[away], missing[away]
        if not len(rows):
            break
        A = which @ plain.pose_jacobians(q[rows])[1] * scale[:, None] * moving
        # Damped: at a singular pose a step goes only where the flange can move.
        gram = np.swapaxes(A, 1, 2) @ A + _DAMPING * np.eye(len(moving))
        q[rows] += np.linalg.solve(gram, np.einsum("nij,ni->nj", A, missing)[..., None])[..., 0]
    missing = np.abs(_missing(plain.pose(q[rows]), flange[rows]) @ which.T * scale).max(axis=1, initial=0.0)
    q[rows[missing > _REACHED_MM]] = np.nan
    return q


def _missing(pose: Pose, flange: FloatArray) -> FloatArray:
    """(n, 6) small motions from poses to others: translation [mm], then rotation [rad]."""
    turn = 0.5 * np.cross(pose.R_base_tip, flange[:, :3, :3], axis=1).sum(axis=2)
    return np.concatenate([flange[:, :3, 3] - pose.tip_in_base, turn], axis=1)


def _meeting(axes: FloatArray, points: FloatArray) -> FloatArray | None:
    """The point where two lines meet."""
    normal = np.cross(*axes)
    between = points[1] - points[0]
    if np.linalg.norm(normal) < _PARALLEL or abs(between @ normal) > _MEETING_MM * np.linalg.norm(normal):
        return None
    return np.asarray(points[0] + axes[0] * (np.cross(between, axes[1]) @ normal) / (normal @ normal))


def _are_parallel(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.linalg.norm(np.cross(a, b)) < _PARALLEL)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=-1))


def _back(R: FloatArray, v: FloatArray) -> FloatArray:
    """Vectors turned by the inverses of rotations."""
    return np.asarray(np.einsum("...ji,...j->...i", R, np.broadcast_to(v, R.shape[:-1])))


def _turns(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """(.., 3, 3) rotations about an axis."""
    K = np.cross(np.eye(3), axis)
    sine, cosine = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.asarray(np.eye(3) + sine * K + (1 - cosine) * (K @ K))


def _turning(axis: FloatArray, v: FloatArray, target: FloatArray) -> FloatArray:
    """Angles about an axis that turn vectors into others."""
    along, across = _dot(v, target) - (v @ axis) * (target @ axis), _dot(np.cross(axis, v), target)
    return np.asarray(np.arctan2(across, along))


def _with_component(
    axis: FloatArray, v: FloatArray, direction: FloatArray, component: FloatArray | float, sign: FloatArray
) -> FloatArray:
    """Angles about an axis after which vectors have a component; `sign` chooses one of the two."""
    along = (v @ axis)[..., None] * axis
    across = v - along
    cosine, sine = across @ direction, np.cross(axis, across) @ direction
    share = (component - along @ direction) / np.hypot(cosine, sine)
    # A stretched arm is reached from both sides of it, whatever the rounding of a printed target.
    share = np.where(np.abs(share) < 1 + _ROUNDING, np.clip(share, -1, 1), share)
    return np.asarray(np.arctan2(sine, cosine) + sign * np.arccos(share))


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
