"""Whether readings are of an arm (number and kind of joints, limits, serial number), and what they show of one.

Where most poses are outside the trained range of a model, their angles may be in another unit, order or sign.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms.type_prior import kinematics_sha256
from truearm.models.training_conditions import TrainingConditions
from truearm.readings.checks import check_angles, serial_number_of, skip_beyond_limits
from truearm.readings.columns import ANGLE
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray, IntArray

# Another unit, order or sign is likely where most poses as stated are outside, and most poses so read are inside.
MOST = 0.5
# Poses that are compared, evenly spaced.
MAX_COMPARED = 500
WAYS_TO_AN_ARM = (
    "a name of `truearm arms`, an arm file or URDF, or an arm measured by its circles (truearm arms --from-circles "
    "CIRCLES); model 'network' needs none"
)


def doubt_about_angles(training: TrainingConditions, angles: FloatArray, prismatic: BoolArray) -> tuple[str, ...]:
    """That most poses (n, n_joints) are outside the trained range, and what may be wrong; nothing if most are inside.

    Parameters
    ----------
    training : TrainingConditions
    angles : (n, n_joints) array
        [rad, or mm].
    prismatic : (n_joints,) bool array
        Which joints slide.
    """
    outside = training.poses_outside(angles, prismatic)
    if outside.mean() <= MOST:
        return ()
    said = f"{outside.sum()} of {len(angles)} poses are outside the trained range"
    some = angles[np.linspace(0, len(angles) - 1, min(len(angles), MAX_COMPARED)).round().astype(int)]
    found = [(1 - training.poses_outside(q, prismatic).mean(), what) for what, q in _interpretations(some, prismatic)]
    share, what = max(found, key=lambda one: one[0])
    if share < MOST:
        return (f"{said}: the model was not fitted to such poses.",)
    return (f"{said}, and {share:.0%} would be inside if {what}.",)


def _interpretations(angles: FloatArray, prismatic: BoolArray) -> Iterator[tuple[str, FloatArray]]:
    """What else angles may be, the more likely before the less likely."""
    n, turning = angles.shape[1], np.flatnonzero(~prismatic)
    for unit, factor in (("rad", np.degrees(1.0)), ("deg", np.radians(1.0))):
        what = f"the angles were in {unit}: check the unit in the names of the columns"
        yield what, angles * np.where(prismatic, 1.0, factor)
    for number in sorted({1, 2, len(turning)}):
        for joints in combinations(turning.tolist(), number):
            names = "all joints" if number == n > 1 else " and ".join(f"J{joint + 1}" for joint in joints)
            yield f"{names} turned the other way: check the sign", angles * np.where(np.isin(range(n), joints), -1, 1)
    order: IntArray = np.arange(n)
    orders = {f"J{a + 1} and J{b + 1} were exchanged": _exchanged(order, a, b) for a, b in combinations(range(n), 2)}
    orders |= {"the joints were in reverse order": order[::-1], "the last joint came first": np.roll(order, 1)}
    orders |= {"the first joint came last": np.roll(order, -1)}
    for what, columns in orders.items():
        yield f"{what}: check the order of the columns", angles[:, columns]


def _exchanged(order: IntArray, a: int, b: int) -> IntArray:
    out = order.copy()
    out[[a, b]] = b, a
    return out


def arm_of_readings(readings: Session) -> Arm:
    """What readings show of an arm without a description: how many joints, and by their units which of them slide.

    Its chain has no lengths (`Arm.has_kinematics`). A network needs no more, as in Gao et al. (2017).
    """
    units = [ANGLE.fullmatch(column) for column in readings.angle_columns or ()]
    slides = np.array([unit is not None and unit[2] == "mm" for unit in units] or [False] * readings.n_joints)
    motions = np.tile(np.eye(4), (readings.n_joints + 1, 1, 1))
    return Arm(
        "unknown arm",
        Chain(motions, np.zeros(3), slides),
        title="no kinematics: its joints are known from readings",
        working_pose=np.median(readings.angles, axis=0),
    )


def check_has_kinematics(arm: Arm, what: str) -> None:
    """Refuse what needs kinematics, named at the begin of the message, for an arm that is known from readings only.

    Raises
    ------
    InputError
    """
    if not arm.has_kinematics:
        raise InputError(f"{what} the kinematics of an arm, and none is given", hint=f"give one: {WAYS_TO_AN_ARM}")


def check_readings_of(arm: Arm, readings: Session) -> None:
    """Refuse readings of another number or kind of joints, mostly outside their limits, or in another unit.

    Raises
    ------
    InputError
    """
    if readings.n_joints != arm.n_joints:
        raise InputError(f"expected readings of {arm.n_joints} joints for arm {arm.name!r}, got {readings.n_joints}")
    check_angles(readings, n_joints=arm.n_joints, prismatic=arm.chain.is_prismatic)
    skip_beyond_limits(readings, arm.limits, prismatic=arm.chain.prismatic)


def with_read_angles(arm: Arm, readings: Session) -> Session:
    """The readings with zero for joints that only mimic others: they have no encoder, and a table may hold anything."""
    chain = arm.chain
    return readings if chain.coupling is None else replace(readings, angles=readings.angles * chain.is_read)


def read_by(arm: Arm, readings: Session) -> Session:
    """The readings `with_read_angles`, of an arm with their serial number (`with_serial_number`)."""
    with_serial_number(arm, readings)
    return with_read_angles(arm, readings)


def with_serial_number(arm: Arm, readings: Session) -> Arm:
    """The arm with the serial number that its readings state, if it has none itself.

    Raises
    ------
    InputError
        If both state one, and they differ; where that is accepted, the arm keeps its own.
    """
    stated = serial_number_of(readings)
    if not stated or stated == arm.serial_number:
        return arm
    if arm.serial_number:
        readings.contradict(
            f"the readings are of the arm with serial number {stated!r}, arm {arm.name!r} has {arm.serial_number!r}",
            column="serial_number",
            hint="check the session and the arm or model file: units of one type have errors of their own",
        )
        return arm
    return replace(arm, serial_number=stated)


def other_arm(one: Arm, other: Arm) -> str:
    """Why two models are of different arms: the differing joints, serial numbers or names; empty if they may be of one.

    Other serial numbers are other arms, but two makers may give the same one. An arm file that was corrected is one of
    the same arm: two arms have other names and other kinematics.
    """
    if one.n_joints != other.n_joints:
        return f"{one.n_joints} and {other.n_joints} joints"
    if one.serial_number and other.serial_number and one.serial_number != other.serial_number:
        return f"serial numbers {one.serial_number!r} and {other.serial_number!r}"
    have_kinematics = one.has_kinematics and other.has_kinematics
    if have_kinematics and one.name != other.name and kinematics_sha256(one) != kinematics_sha256(other):
        return f"arms {one.name!r} and {other.name!r}"
    return ""
