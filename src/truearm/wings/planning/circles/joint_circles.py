"""Which readings are the circle of which joint, and the axis of each: the first step of circle point analysis.

Each joint is moved alone while the others stand, and the instrument sees a target on the last link (B. W. Mooring,
Z. S. Roth, M. R. Driels, "Fundamentals of Manipulator Calibration", 1991; J. M. Hollerbach, C. W. Wampler, "The
Calibration Index and Taxonomy for Robot Kinematic Calibration Methods", Int. J. Robotics Research 15 (1996) 573).
The angles are known, so that a circle is linear in its unknowns and has a direction: the angle grows counter-clockwise
about the axis. A sliding joint describes a line.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from truearm.errors import InputError
from truearm.readings import Session
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
