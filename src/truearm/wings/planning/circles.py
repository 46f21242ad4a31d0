"""Axes of an arm without a drawing, from the circles that its joints draw one by one: circle point analysis.

Each joint is moved alone while the others stand, and the instrument sees a target on the last link (B. W. Mooring,
Z. S. Roth, M. R. Driels, "Fundamentals of Manipulator Calibration", 1991; J. M. Hollerbach, C. W. Wampler, "The
Calibration Index and Taxonomy for Robot Kinematic Calibration Methods", Int. J. Robotics Research 15 (1996) 573).
The angles are known, so that a circle is linear in its unknowns and has a direction: the angle grows counter-clockwise
about the axis. A sliding joint describes a line.

Then the axes of all joints in one pose, estimated from all circles together: a product of exponentials.

In the pose `q0` joint i turns about a line through ``c_i`` along ``w_i``, or slides along it, and the target is at
``p``; elsewhere it is at ``exp(S_1 (q_1 - q0_1)) ... exp(S_n (q_n - q0_n)) p`` (R. M. Murray, Z. Li, S. S. Sastry, "A
Mathematical Introduction to Robotic Manipulation", 1994, chapter 3). Four numbers a turning joint, two a sliding one
and three of the target are all that points can show, whatever the other joints stood at.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Chain
from truearm.arm.nearest_table import NEARLY_PARALLEL
from truearm.arm.rigid_motions import rotation_from_z_to, screw_z
from truearm.errors import InputError
from truearm.readings import Session
from truearm.solve import least_squares
from truearm.solve.least_squares_problem import DenseProblem
from truearm.typing import BoolArray, FloatArray, IntArray

# Others within these of each other stand still: robots hold 0.01 deg, a hand that turns one hinge of a measuring arm
# moves its neighbours by tenths. The axes are estimated with the angles as they are.
STILL_RAD, STILL_MM = float(np.radians(1.0)), 5.0
# An axis that is more uncertain than this describes no arm [rad].
MAX_DIRECTION_STD = 0.1
# A circle or line of less is none.
LEAST_POINTS, LEAST_ARC, LEAST_TRAVEL_MM = 5, float(np.radians(10.0)), 10.0
# A target nearer to an axis shows nothing of it.
LEAST_RADIUS_MM = 2.0


class JointCircle(NamedTuple):
    """The circle of a turning joint, or the line of a sliding one.

    Attributes
    ----------
    joint : int
        Counted from 0.
    rows : (m,) array of int
        Its readings.
    direction : (3,) array
        Unit vector along the axis, about which the angle grows counter-clockwise; of a line the way it grows.
    point : (3,) array
        Centre of the circle, or a point on the line [mm].
    radius_mm : float
        Of a line 0.
    travel : float
        From the smallest to the largest angle [rad, or mm].
    residual_std_mm : float
        Standard deviation of a coordinate about the circle.
    direction_std : float
        Largest standard uncertainty of the direction [rad].
    """

    joint: int
    rows: IntArray
    direction: FloatArray
    point: FloatArray
    radius_mm: float
    travel: float
    residual_std_mm: float
    direction_std: float


class Circles(NamedTuple):
    """The circles of a session, and the joints that have none.

    Attributes
    ----------
    circles : tuple of JointCircle
        In the order of the joints; of every joint that has one.
    failed : dict of int to InputError
        Joints, counted from 0, whose axis does not show, and why.
    """

    circles: tuple[JointCircle, ...]
    failed: dict[int, InputError]


def joint_circles(session: Session, is_prismatic: BoolArray) -> Circles:
    """Every circle in a session.

    Raises
    ------
    InputError
        If no joint has a circle that shows its axis.
    """
    if session.points is None:
        raise session.error("expected the points of circles (x_mm, y_mm, z_mm), got none")
    circles: list[JointCircle] = []
    failed: dict[int, InputError] = {}
    for joint in range(session.n_joints):
        blocks = list(_blocks(session, joint, is_prismatic))
        found = [_fitted(session, joint, rows, slides=bool(is_prismatic[joint])) for rows in blocks]
        fault = _missing(session, joint, is_prismatic) if not found else _too_small(session, found)
        if fault is None:
            circles += found
        else:
            failed[joint] = fault
    if not circles:
        raise failed[0]
    return Circles(tuple(circles), failed)


def direction_std(turns: FloatArray, noise_mm: float, radius_mm: float) -> float:
    """Largest standard uncertainty of the direction of an axis from one circle [rad].

    Noise of the circle's two coefficient vectors across their plane tilts it.

    Parameters
    ----------
    turns : (m,) array
        Angles of the points on the circle [rad].
    noise_mm : float
        Standard uncertainty of a coordinate.
    radius_mm : float
    """
    design = np.stack([np.ones(len(turns)), np.cos(turns), np.sin(turns)], axis=1)
    return noise_mm * float(np.sqrt(_coefficient_variance(design))) / radius_mm


def radius_needed(turns: FloatArray, noise_mm: float, direction_std_rad: float) -> float:
    """Distance of a target from an axis [mm] at which its direction is known so well; see `direction_std`."""
    return direction_std(turns, noise_mm, 1.0) / direction_std_rad


def _coefficient_variance(design: FloatArray) -> float:
    """Largest variance of the coefficients but the first, of unit noise."""
    return float(np.linalg.pinv(design.T @ design).diagonal()[1:].max())


def _blocks(session: Session, joint: int, is_prismatic: BoolArray) -> Iterator[IntArray]:
    """Readings in which a joint alone moves, those of one pose of the other joints together."""
    still = np.where(is_prismatic, STILL_MM, STILL_RAD)
    still[joint] = np.inf
    left = session.has_point.copy()
    least = LEAST_TRAVEL_MM if is_prismatic[joint] else LEAST_ARC
    while left.any():
        together = left & (np.abs(session.angles - session.angles[np.argmax(left)]) <= still).all(axis=1)
        left &= ~together
        if together.sum() >= LEAST_POINTS and np.ptp(session.angles[together, joint]) >= least:
            yield np.flatnonzero(together)


def _missing(session: Session, joint: int, is_prismatic: BoolArray) -> InputError:
    slides = bool(is_prismatic[joint])
    verb, least = ("slides", f"{LEAST_TRAVEL_MM:g} mm") if slides else ("turns", f"{np.degrees(LEAST_ARC):.0f} deg")
    still = np.where(is_prismatic, STILL_MM, STILL_RAD)
    moves = np.abs(np.diff(session.angles, axis=0)) > still
    with_others = np.flatnonzero(moves[:, joint] & (moves.sum(axis=1) > 1))
    alone = moves[:, joint] & (moves.sum(axis=1) == 1)
    note, row = "", None
    if len(with_others) > alone.sum():
        row = int(with_others[0]) + 1
        others = [f"J{other + 1}" for other in np.flatnonzero(moves[row - 1]).tolist() if other != joint]
        note = f": it moves together with {', '.join(others)}"
    return session.error(
        f"J{joint + 1} has no circle, {LEAST_POINTS} points or more over {least} in which it alone {verb}{note}",
        row,
        hint=f"move J{joint + 1} alone, the others still, and read 12 points over {'200 mm' if slides else '60 deg'} "
        "or more; truearm arms --circles-plan writes the file to fill in",
    )


def _fitted(session: Session, joint: int, rows: IntArray, *, slides: bool) -> JointCircle:
    """The circle ``c + A cos q + B sin q`` of points, or the line ``c + B q``, by linear least squares."""
    assert session.points is not None  # checked by the caller
    angles, points = session.angles[rows, joint], session.points[rows]
    middle = (angles.max() + angles.min()) / 2
    turn = angles - middle
    one = np.ones(len(rows))
    design = np.stack([one, turn] if slides else [one, np.cos(turn), np.sin(turn)], axis=1)
    found, _, rank, _ = np.linalg.lstsq(design, points, rcond=None)
    residuals = points - design @ found
    n_free = 3 * (len(rows) - design.shape[1])
    std = float(np.sqrt((residuals**2).sum() / max(n_free, 1)))
    along = found[1] if slides else np.cross(found[1], found[2])
    size = float(np.linalg.norm(along))
    radius = 0.0 if slides else float(np.sqrt(size))
    direction = along / size if size > 0 else np.array([0.0, 0.0, 1.0])
    lever = size if slides else radius
    is_determined = lever > 0 and rank == design.shape[1]
    tilt = std * float(np.sqrt(_coefficient_variance(design))) / lever if is_determined else np.inf
    return JointCircle(joint, rows, direction, found[0], radius, float(np.ptp(angles)), std, tilt)


def _too_small(session: Session, circles: list[JointCircle]) -> InputError | None:
    """The fault of a joint whose best circle is too small to show its axis."""
    circle = min(circles, key=lambda one: one.direction_std)
    if not 0 < circle.radius_mm < LEAST_RADIUS_MM:
        return None
    return session.error(
        f"the target is {circle.radius_mm:.2g} mm from the axis of J{circle.joint + 1}, and its circle shows no axis",
        int(circle.rows[0]),
        hint="mount the target some 100 mm off that axis (a plate or an angle on the flange) for all circles",
    )


# Circles that scatter together by so many times as much as one by one, and by so much, are not of one arm, base and
# target: arms bend by less.
MAX_SCATTER_RATIO, MAX_SCATTER_MM = 3.0, 2.0


@dataclass(frozen=True, eq=False)
class Axes:
    """Axes of joints and a target in one pose, in the frame of the instrument.

    Attributes
    ----------
    pose : (n_joints,) array
        [rad, or mm for sliding joints].
    directions : (n_joints, 3) array
        Unit vectors.
    points : (n_joints, 3) array
        A point on each axis [mm]; that of a sliding joint has no meaning.
    is_prismatic : (n_joints,) array of bool
    target : (3,) array
        [mm].
    is_measured : (n_joints,) array of bool
        Whether circles show the axis; one that none shows stays where it is.
    """

    pose: FloatArray
    directions: FloatArray
    points: FloatArray
    is_prismatic: BoolArray
    target: FloatArray
    is_measured: BoolArray

    @property
    def n_parameters(self) -> int:
        """Number of components of a step of `moved`."""
        return 3 + int(self.n_own.sum())

    @property
    def n_own(self) -> IntArray:
        """(n_joints,) the number of those of each axis."""
        return np.where(self.is_measured, np.where(self.is_prismatic, 2, 4), 0)

    def moved(self, step: FloatArray) -> Self:
        """A step is the target's shift, then from the last joint to the first tilt and shift of its axis."""
        directions, points, at = self.directions.copy(), self.points.copy(), 3
        for i in reversed(np.flatnonzero(self.is_measured).tolist()):
            across = rotation_from_z_to(self.directions[i])[:, :2]
            directions[i] += across @ step[at : at + 2]
            directions[i] /= np.linalg.norm(directions[i])
            at += 2
            if not self.is_prismatic[i]:
                points[i] += across @ step[at : at + 2]
                at += 2
        return replace(self, directions=directions, points=points, target=self.target + step[:3])

    def targets(self, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The target at joint angles (m, n_joints), and its derivatives.

        Returns
        -------
        points : (m, 3) array
            [mm].
        by_step : (m, 3, n_parameters) array
            By the components of a step of `moved` [mm per rad or mm].
        by_gain : (m, 3, n_joints) array
            By the gain of each joint, the factor of its angles from `pose` [mm], last joint first.
        """
        m = len(angles)
        p = np.tile(self.target, (m, 1))
        by_step, by_gain = np.tile(np.eye(3), (m, 1, 1)), np.zeros((m, 3, 0))
        for i in reversed(range(len(self.pose))):
            w, c, turn = self.directions[i], self.points[i], (angles[:, i] - self.pose[i])[:, None]
            across = rotation_from_z_to(w)[:, :2].T
            if self.is_prismatic[i]:
                own = [turn * u for u in across]
                p, gained = p + turn * w, turn * w
            else:
                R, v = Rotation.from_rotvec(turn * w).as_matrix(), p - c
                sin, versine = np.sin(turn), 1 - np.cos(turn)
                own = [np.cross(u, v) * sin + (u * (v @ w)[:, None] + w * (v @ u)[:, None]) * versine for u in across]
                own += [u - R @ u for u in across]
                moved = np.einsum("mxy,my->mx", R, v)
                p, gained = c + moved, np.cross(w, moved) * turn
                by_step, by_gain = R @ by_step, R @ by_gain
            if self.is_measured[i]:
                by_step = np.concatenate([by_step, np.stack(own, axis=2)], axis=2)
            by_gain = np.concatenate([by_gain, gained[:, :, None]], axis=2)
        return p, by_step, by_gain

    def frames(self) -> FloatArray:
        """(n_joints, 4, 4) a frame on each axis, z along it, where a D-H table has them [mm].

        At the foot of the common normal with the axis before, at its height where both are nearly parallel; that of a
        sliding joint at the frame before.
        """
        frames = np.tile(np.eye(4), (len(self.pose), 1, 1))
        for i, (w, c) in enumerate(zip(self.directions, self.points, strict=True)):
            frames[i, :3, :3] = rotation_from_z_to(w)
            origin = self.target if self.is_prismatic[i] else c
            if i:
                before, z = frames[i - 1, :3, 3], frames[i - 1, :3, 2]
                cos = float(w @ z)
                if self.is_prismatic[i]:
                    origin = before
                elif abs(cos) > np.cos(NEARLY_PARALLEL):
                    origin = c + w * ((before - c) @ z) / cos
                else:
                    origin = c + w * ((before - c) @ (w - cos * z)) / (1 - cos**2)
            frames[i, :3, 3] = origin
        return frames

    def chain(self) -> Chain:
        """The arm in the frame of the instrument."""
        frames = self.frames()
        fixed = [frames[0], *(np.linalg.inv(one) @ other for one, other in pairwise(frames))]
        back = [
            screw_z(0.0, -q) if slides else screw_z(-q, 0.0)
            for q, slides in zip(self.pose, self.is_prismatic, strict=True)
        ]
        tip = np.linalg.inv(frames[-1]) @ [*self.target, 1.0]
        return Chain(
            np.array([*(F @ J for F, J in zip(fixed, back, strict=True)), np.eye(4)]), tip[:3], self.is_prismatic
        )


@dataclass(frozen=True, eq=False)
class EstimatedAxes:
    """Axes with their uncertainty.

    Attributes
    ----------
    axes : Axes
    covariance : (p, p) array
        Of a step of `Axes.moved`.
    residual_std_mm : float
        Standard deviation of a coordinate about the circles.
    gains : (n_joints,) array
        Factor of each joint's angles that fits its circles best, beside all else; 1 of an encoder that is right.
    gain_std : (n_joints,) array
        Their standard uncertainties; NaN of a joint without circles.
    """

    axes: Axes
    covariance: FloatArray
    residual_std_mm: float
    gains: FloatArray
    gain_std: FloatArray

    @property
    def direction_std(self) -> FloatArray:
        """(n_joints,) largest standard uncertainty of each axis's direction [rad]; infinite of one not measured."""
        first = 3 + np.cumsum([0, *self.axes.n_own[:0:-1]])[::-1]
        blocks = [self.covariance[i : i + 2, i : i + 2] for i in first.tolist()]
        stds = [
            np.sqrt(np.linalg.eigvalsh(block)[-1]) if measured else np.inf
            for block, measured in zip(blocks, self.axes.is_measured, strict=True)
        ]
        return np.array(stds)


def estimate_axes(session: Session, measured: Circles, is_prismatic: BoolArray) -> EstimatedAxes:
    """Axes by least squares over all points of all circles, weighted by their uncertainties where these are stated.

    The axis of a joint that failed goes through the target, across the axis before (after the first joint).

    Raises
    ------
    InputError
        If the circles do not determine the axes.
    """
    circles = measured.circles
    assert session.points is not None  # the circles are of points
    rows = np.unique(np.concatenate([circle.rows for circle in circles]))
    angles, points = session.angles[rows], session.points[rows]
    stated = None if session.point_std is None else session.point_std[rows]
    is_stated = stated is not None and bool((stated > 0).all())
    weight = 1 / stated if is_stated and stated is not None else np.ones_like(points)

    def residuals_and_jacobian(axes: Axes) -> tuple[FloatArray, FloatArray]:
        found, by_step, _ = axes.targets(angles)
        return (weight * (found - points)).ravel(), (weight[:, :, None] * by_step).reshape(points.size, -1)

    is_measured = np.array([joint not in measured.failed for joint in range(session.n_joints)])
    start = _start(session, circles, is_prismatic, is_measured)
    axes = least_squares.gauss_newton(DenseProblem(residuals_and_jacobian), start, move=Axes.moved).x
    found, by_step, by_gain = axes.targets(angles)
    residuals = found - points
    jacobian = (weight[:, :, None] * by_step).reshape(points.size, -1)
    n_free = points.size - axes.n_parameters
    if n_free < 1 or np.linalg.matrix_rank(jacobian) < axes.n_parameters:
        raise session.error(
            "these circles do not determine the axes of all joints", hint="more points over longer arcs of every joint"
        )
    variance = float(((weight * residuals) ** 2).sum()) / n_free
    if is_stated:
        variance = max(variance, 1.0)
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    # One Gauss-Newton step of all gains beside the axes.
    of_gains = (weight[:, :, None] * by_gain[:, :, ::-1] * is_measured).reshape(points.size, -1)
    beside = of_gains - jacobian @ np.linalg.lstsq(jacobian, of_gains, rcond=None)[0]
    gram = np.linalg.pinv(beside.T @ beside)
    gains = 1 - gram @ (beside.T @ (weight * residuals).ravel())
    left = (weight * residuals).ravel() + beside @ (gains - 1)
    gain_std = np.sqrt(np.maximum(gram.diagonal(), 0.0) * float(left @ left) / max(n_free - len(gains), 1))
    gain_std[~is_measured] = np.nan
    std = float(np.sqrt((residuals**2).sum() / n_free))
    estimated = EstimatedAxes(axes, covariance, std, gains, gain_std)
    _check(session, measured, estimated, angles)
    return estimated


def _check(session: Session, measured: Circles, estimated: EstimatedAxes, angles: FloatArray) -> None:
    """Refuse circles that are not of one arm; a joint that failed may be why, if it stood at several angles."""
    each = float(np.sqrt(np.mean([circle.residual_std_mm**2 for circle in measured.circles])))
    if estimated.residual_std_mm <= max(MAX_SCATTER_RATIO * each, MAX_SCATTER_MM):
        return
    scatter = f"scatter by {estimated.residual_std_mm:.2g} mm together and by {each:.2g} mm one by one"
    hint = (
        "base, instrument and target must stay where they are between the circles; the angles of the joints that stand "
        "must be right, too, and no joint may pull another along (import --couple)"
    )
    moved = np.ptp(angles, axis=0) > np.where(estimated.axes.is_prismatic, STILL_MM, STILL_RAD)
    not_still = [joint for joint in sorted(measured.failed) if moved[joint]]
    if not not_still:
        first = "".join(f"{fault.problem}; " for _, fault in sorted(measured.failed.items()))
        session.contradict(
            f"{first}the circles {scatter}: they are not of one arm with one base and one target", hint=hint
        )
        return
    names = " and ".join(f"J{joint + 1}" for joint in not_still)
    problems = "; ".join(measured.failed[joint].problem for joint in not_still)
    session.contradict(
        f"{names} is not measured and stood at several angles in the circles of the other joints, which {scatter}: "
        f"{problems}",
        hint=f"{measured.failed[not_still[0]].hint}; or hold {names} at one angle in all other circles. {hint}",
    )


def uncertain_directions(
    session: Session, circles: Sequence[JointCircle], estimated: EstimatedAxes
) -> dict[int, InputError]:
    """The joints whose axes are too uncertain to describe an arm, and why."""
    faults = {}
    uncertain = estimated.axes.is_measured & (estimated.direction_std > MAX_DIRECTION_STD)
    for joint in np.flatnonzero(uncertain).tolist():
        own = max((one for one in circles if one.joint == joint), key=lambda one: one.travel)
        slides, noise = own.radius_mm == 0, estimated.residual_std_mm
        travel = f"{own.travel:.0f} mm" if slides else f"{np.degrees(own.travel):.0f} deg"
        tilt = np.degrees(min(estimated.direction_std[joint], np.pi))
        needed = radius_needed(session.angles[own.rows, joint], noise, MAX_DIRECTION_STD)
        farther = "" if slides else f", with the target {max(needed, own.radius_mm):.0f} mm or more from that axis"
        faults[joint] = session.error(
            f"the axis of J{joint + 1} is uncertain by {tilt:.2g} deg: {len(own.rows)} points over {travel}, "
            f"{own.radius_mm:.0f} mm from the axis, scatter by {noise:.2g} mm",
            int(own.rows[0]),
            hint=f"read more points over a longer arc{farther}",
        )
    return faults


def _start(session: Session, circles: Sequence[JointCircle], is_prismatic: BoolArray, is_measured: BoolArray) -> Axes:
    """Axes from the circles one by one, base first: each is brought to the pose by the joints before it."""
    assert session.points is not None
    pose = np.median(session.angles[np.concatenate([circle.rows for circle in circles])], axis=0)
    n = len(pose)
    axes = Axes(pose, np.tile([0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 3)), is_prismatic, np.zeros(3), is_measured)
    for joint in np.flatnonzero(is_measured).tolist():
        best = min((one for one in circles if one.joint == joint), key=lambda one: one.direction_std)
        stood = np.median(session.angles[best.rows], axis=0)
        stood[joint:] = pose[joint:]
        ends = np.stack([best.point, best.point + best.direction])
        first, second = (_before(axes, stood, end, joint) for end in ends)
        axes.points[joint], axes.directions[joint] = first, (second - first) / np.linalg.norm(second - first)
    rows = circles[-1].rows
    targets = [_before(axes, session.angles[row], session.points[row], n) for row in rows.tolist()]
    axes = replace(axes, target=np.mean(targets, axis=0))
    for joint in np.flatnonzero(~is_measured).tolist():
        known = np.flatnonzero(is_measured)
        beside = int(known[known < joint][-1] if (known < joint).any() else known[0])
        axes.points[joint], axes.directions[joint] = axes.target, _across(axes, beside)
    return axes


def _across(axes: Axes, joint: int) -> FloatArray:
    """The direction from the axis of a joint to the target, at a right angle to it."""
    w = axes.directions[joint]
    from_axis = axes.target - axes.points[joint]
    across = from_axis - w * (w @ from_axis)
    size = float(np.linalg.norm(across))
    return across / size if size > 0 else rotation_from_z_to(w)[:, 0]


def _before(axes: Axes, angles: FloatArray, point: FloatArray, n: int) -> FloatArray:
    """Where a point that the first n joints carry is in the pose of the axes, if it is at `point` at `angles`."""
    for i in np.flatnonzero(axes.is_measured[:n]).tolist():
        w, c, turn = axes.directions[i], axes.points[i], angles[i] - axes.pose[i]
        point = point - turn * w if axes.is_prismatic[i] else c + Rotation.from_rotvec(-turn * w).apply(point - c)
    return point
