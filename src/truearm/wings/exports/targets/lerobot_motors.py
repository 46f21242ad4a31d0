"""LeRobot's calibration of the motors of an SO-100 or SO-101: its values as joint angles, and its zeros corrected.

The file has for each motor ``id``, ``drive_mode``, ``homing_offset``, ``range_min`` and ``range_max`` in ticks. LeRobot
counts ``tick = encoder - homing_offset`` and shows a joint in one of three ways: ticks; degrees from the middle of the
range, 360 of 4095 ticks; or -100 to 100 over the range, turned round by the drive mode.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from truearm.errors import InputError
from truearm.files.file_reading import parse_file, utf8_text
from truearm.typing import BoolArray, FloatArray, IntArray

MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
GRIPPER = "gripper"
MotorUnit = Literal["deg", "percent", "counts"]
# Of a full turn, as LeRobot has it: of its 4096 ticks the last one.
TICKS_PER_TURN = 4095
TICKS_PER_RAD = TICKS_PER_TURN / (2 * np.pi)
# The servo keeps the offset in 11 bits and a sign.
MAX_HOMING = 2047
MAX_BYTES = 100_000
# Of a range, on either side: it was found by hand, a motor can be beyond it, and a target before it is sent.
_BEYOND = 0.05
_KEYS = ("id", "drive_mode", "homing_offset", "range_min", "range_max")
# joint angle = sign * LeRobot's angle + offset [deg], from where both descriptions have the same pose. Of the others
# the angles are LeRobot's own.
ARMS = ("so100", "so101")
_DESCRIPTIONS = {"so100": ((-1, 1, 1, 1, 1), (0.0, 103.132403124, -90.0, -32.704220487, 0.0))}


class JointValues(NamedTuple):
    """How values of joints become angles: ``gain * (value - zero)``.

    Attributes
    ----------
    gain : (n_joints,) array
        [rad] of a unit of the value.
    zero : (n_joints,) array
        Value at the angle 0.
    """

    gain: FloatArray
    zero: FloatArray

    def to_angles(self, values: FloatArray) -> FloatArray:
        """(n, n_joints) angles [rad] of values."""
        return self.gain * (values - self.zero)

    def to_values(self, angles: FloatArray) -> FloatArray:
        """(n, n_joints) values of angles [rad]."""
        return angles / self.gain + self.zero


class Motors(NamedTuple):
    """The calibration of an arm's five motors, without the gripper's.

    Attributes
    ----------
    homing : (5,) int array
    lowest, highest : (5,) array
        Range [ticks].
    is_inverted : (5,) array
        Whether the drive mode turns the shares of the range round.
    """

    homing: IntArray
    lowest: FloatArray
    highest: FloatArray
    is_inverted: BoolArray


def read_motors(path: str | Path) -> Motors:
    """Read a calibration file.

    Raises
    ------
    InputError
        If the file is missing, too large or no JSON, has other motors or keys, or numbers that are no ticks.
    """
    return parse_file(path, parse_motors, limit_bytes=MAX_BYTES)


def parse_motors(content: bytes) -> Motors:
    """The calibration in the content of a file; errors as of `read_motors`."""
    try:
        found = json.loads(utf8_text(content), object_pairs_hook=_unique, parse_float=str, parse_constant=str)
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the file is no JSON ({str(error)[:80]})", line=getattr(error, "lineno", None)) from None
    if not isinstance(found, dict) or not set(MOTORS) <= set(found) <= {*MOTORS, GRIPPER}:
        names = ", ".join(map(str, found))[:200] if isinstance(found, dict) else type(found).__name__
        raise InputError(
            f"expected the calibration of an SO-100 or SO-101, with the motors {', '.join(MOTORS)}, got {names}",
            hint="LeRobot writes it: ~/.cache/huggingface/lerobot/calibration/robots/so101_follower/NAME.json",
        )
    rows = np.array([_ticks_of(name, motor) for name, motor in found.items()])
    if len(np.unique(rows[:, 0])) < len(rows):
        raise InputError("expected every motor with an id of its own")
    _, drive, homing, lowest, highest = rows[[list(found).index(name) for name in MOTORS]].T
    return Motors(homing, lowest.astype(float), highest.astype(float), drive == 1)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = [name for name, _ in pairs]
    if len(set(names)) < len(names):
        raise InputError(f"a key is stated twice among {', '.join(names)[:200]}")
    return dict(pairs)


def _ticks_of(name: str, motor: Any) -> list[int]:
    """Numbers of one motor in the order of the keys."""
    if not isinstance(motor, dict) or set(motor) != set(_KEYS):
        raise InputError(f"expected {name} with the keys {', '.join(_KEYS)}")
    least = {"homing_offset": -MAX_HOMING}
    most = {"id": 253, "drive_mode": 1, "homing_offset": MAX_HOMING}
    for key in _KEYS:
        low, high = least.get(key, 0), most.get(key, TICKS_PER_TURN)
        if type(motor[key]) is not int or not low <= motor[key] <= high:
            raise InputError(f"expected {key} of {name} as a whole number from {low} to {high}, got {motor[key]!r:.40}")
    if motor["range_min"] >= motor["range_max"]:
        raise InputError(f"expected range_min of {name} below range_max")
    return [motor[key] for key in _KEYS]


def motors_and_arm(text: str) -> tuple[Motors | None, str]:
    """The calibration and the arm of ``FILE``, ``ARM:FILE`` or ``ARM``; None and empty where they are not stated."""
    arm, colon, file = (text, ":", "") if text in ARMS else text.partition(":")
    if not colon or arm not in ARMS:
        arm, file = "", text
    return read_motors(file) if file else None, arm


def joint_values(unit: str | None, motors: Motors | None, arm: str) -> JointValues:
    """How the values of a recording become joint angles of an arm.

    Parameters
    ----------
    unit : {"deg", "percent", "counts"}
    motors : Motors, optional
        Not needed for degrees.
    arm : str
        The name of an arm: `so100` has other zeros than LeRobot.

    Raises
    ------
    InputError
        If the unit is missing, or another one; if the calibration is missing.
    """
    if unit not in get_args(MotorUnit):
        problem = "LeRobot's values do not say their unit" if unit is None else f"LeRobot has no unit {unit!r:.40}"
        raise InputError(
            problem, hint="--angle-unit deg (use_degrees), percent (-100 to 100 over the range) or counts (ticks)"
        )
    signs, offsets = _DESCRIPTIONS.get(arm, ((1,) * len(MOTORS), (0.0,) * len(MOTORS)))
    sign = np.array(signs, dtype=float)
    if unit == "deg":
        gain, middle = np.full(len(MOTORS), np.pi / 180), np.zeros(len(MOTORS))
    elif motors is None:
        raise InputError(f"{unit} need LeRobot's calibration of this arm", hint="--motors CALIBRATION.json")
    elif unit == "counts":
        gain, middle = np.full(len(MOTORS), 1 / TICKS_PER_RAD), (motors.lowest + motors.highest) / 2
    else:
        turned = np.where(motors.is_inverted, -1.0, 1.0)
        gain, middle = turned * (motors.highest - motors.lowest) / 200 / TICKS_PER_RAD, np.zeros(len(MOTORS))
    gain = sign * gain
    return JointValues(gain, middle - np.deg2rad(offsets) / gain)


def check_motor_values(values: FloatArray, rows: Sequence[str], *, unit: str, motors: Motors | None) -> None:
    """Check that (n, 5) values are in the ranges of the motors, or in a full turn: else they are in another unit.

    Raises
    ------
    InputError
        With the name of the row, and the units that the values can have.
    """
    middle, ranges = _ranges(motors)
    beyond = {name: np.abs(values - middle[name]) > ranges[name] * (1 + 2 * _BEYOND) for name in ranges}
    if not beyond[unit].any():
        return
    row, joint = np.argwhere(beyond[unit])[0].tolist()
    low, high = (middle[unit][joint] + side * ranges[unit][joint] for side in (-1, 1))
    possible = [f"--angle-unit {name}" for name in ranges if (motors or name == "deg") and not beyond[name].any()]
    raise InputError(
        f"expected {MOTORS[joint]} from {low:.4g} to {high:.4g} {unit}"
        f"{', its range in the calibration' * bool(motors)}, got {values[row, joint]:.6g}",
        row=rows[row],
        hint=" or ".join(possible) or "another --angle-unit, or --motors with the calibration of this arm",
    )


def _ranges(motors: Motors | None) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Middles and halves (5,) of the motors' ranges in each unit, or of a full turn."""
    lowest, highest = (motors.lowest, motors.highest) if motors else (np.zeros(5), np.full(5, float(TICKS_PER_TURN)))
    half, shift = (highest - lowest) / 2, (highest + lowest) / 2
    middle = {"deg": np.zeros(5), "percent": np.zeros(5), "counts": shift}
    return middle, {"deg": np.degrees(half / TICKS_PER_RAD), "percent": np.full(5, 100.0), "counts": half}


def sent_range(unit: str, motors: Motors) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest values (5,) that reach the motors, to half a tick: LeRobot or the servo cuts off the rest."""
    middle, ranges = _ranges(motors)
    half = ranges[unit] * (1 + 0.5 / ranges["counts"])
    return middle[unit] - half, middle[unit] + half


def check_no_data_set(path: Path) -> None:
    """Refuse a folder with a data set of LeRobot, and name its first file.

    Raises
    ------
    InputError
    """
    if (path / "meta" / "info.json").is_file():
        first = min(path.glob("data/*/*.parquet"), default=path / "data/chunk-000/episode_000000.parquet")
        raise InputError("expected a file, got the folder of a data set of LeRobot", file=path, hint=str(first))


def homing_changes(zeros: FloatArray, arm: str) -> IntArray:
    """Ticks (5,) to add to the homing offsets, so that LeRobot's angles are those of an arm with other zeros [rad]."""
    gain = joint_values("deg", None, arm).gain * 180 / np.pi
    return np.asarray(-np.rint(gain * zeros * TICKS_PER_RAD), dtype=int)


def with_homing(content: bytes, homing: Mapping[str, int]) -> bytes:
    """The content of a checked file with other homing offsets, and no other byte changed."""
    for name, ticks in homing.items():
        place = rb'("%b"\s*:\s*\{[^{}]*"homing_offset"\s*:\s*)-?\d+' % name.encode()
        content = re.sub(place, rb"\g<1>%d" % ticks, content)
    return content
