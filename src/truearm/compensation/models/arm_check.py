"""Whether readings are of an arm: number and kind of joints, limits, serial number."""

from __future__ import annotations

from dataclasses import replace

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.readings.checks import check_angles, serial_number_of, skip_beyond_limits
from truearm.readings.session import Session


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
            column=None if readings.file is None else "serial_number",
            hint="check the session and the arm or model file: units of one type have errors of their own",
        )
        return arm
    return replace(arm, serial_number=stated)
