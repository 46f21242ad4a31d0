"""LeRobot's calibration file with the zeros of a model: with it the nominal arm is as near to the model as zeros allow.

Only the homing offsets change. Zeros of the first and of the last joint are those of the base and of the tip, and stay
unless these are known. What else a model has learned is no part of the file.
"""

from __future__ import annotations

import numpy as np

from truearm.arm.arm import joint_zeros
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.typing import IntArray
from truearm.wings.exports.formats.constants_table import ConstantsFile, ConstantsRequest, writer
from truearm.wings.exports.formats.rigid_arm import zeros_alone
from truearm.wings.exports.targets.lerobot_motors import (
    MAX_BYTES,
    MAX_HOMING,
    MOTORS,
    TICKS_PER_RAD,
    homing_changes,
    parse_motors,
    read_motors,
    with_homing,
)


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    arm = request.model.arm_
    if request.source is None:
        raise InputError("the calibration that LeRobot uses is not stated", hint="--original CALIBRATION.json")
    if arm.n_joints != len(MOTORS) or arm.chain.is_prismatic.any():
        raise InputError(f"expected the model of an SO-100 or SO-101, got one of {arm.name!r}")
    content = read_limited(request.source, limit_bytes=MAX_BYTES)
    with InputError.of_file(request.source):
        motors = parse_motors(content)
    rigid = request.rigid_arm(terms_of=zeros_alone)
    zeros = joint_zeros(rigid.arm.chain, rigid.nominal, free=rigid.free)
    changes = homing_changes(zeros, arm.name)
    homing = motors.homing + changes
    for name, ticks in zip(MOTORS, homing.tolist(), strict=True):
        if abs(ticks) > MAX_HOMING:
            raise InputError(
                f"the homing offset of {name} would be {ticks}, the servo takes {MAX_HOMING} at most",
                file=request.source,
                hint="calibrate in LeRobot with the arm nearer to the middle of its ranges, and measure again",
            )
    made = with_homing(content, dict(zip(MOTORS, homing.tolist(), strict=True)))
    return ConstantsFile(rigid, rigid.arm.chain, lambda _: made, tuple(_remarks(motors.homing, changes)))


def _remarks(homing: IntArray, changes: IntArray) -> list[str]:
    changed = [
        f"{name} {old} to {old + change} ({360 * change / (2 * np.pi * TICKS_PER_RAD):+.2f} deg)"
        for name, old, change in zip(MOTORS, homing.tolist(), changes.tolist(), strict=True)
        if change
    ]
    what = f"Homing offsets: {', '.join(changed)}." if changed else "No zero is off by a tick: the file is the same."
    return [
        what,
        "The original must be the calibration of the readings: no file says that it is corrected already.",
        "The limits of the servos turn with the zeros. Readings of the old calibration need the old model.",
    ]


write = writer("lerobot", _file_of, read=read_motors)
