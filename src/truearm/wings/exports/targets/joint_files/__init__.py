"""Joint targets in files of other programs: which these are, and what is in them; all but the numbers is kept."""

from __future__ import annotations

from pathlib import Path

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.file_reading import check_readable, read_limited
from truearm.wings.exports.targets import TargetDirection
from truearm.wings.exports.targets.joint_files.joint_file import JointFile, is_marked
from truearm.wings.exports.targets.joint_files.tables import read_csv, read_parquet
from truearm.wings.exports.targets.joint_files.text_files import GCODE, TRAJECTORIES, read_gcode, read_trajectory
from truearm.wings.exports.targets.lerobot_motors import check_no_data_set

MAX_BYTES = 64 * 2**20
# A parser of YAML takes some microseconds a byte.
MAX_YAML_BYTES = 8 * 2**20
# The unit of those that have one.
_UNITS = {**dict.fromkeys(TRAJECTORIES, "rad"), **dict.fromkeys(GCODE, "deg")}


def read_joint_file(
    path: Path, arm: Arm, *, direction: TargetDirection, angle_unit: str | None = None, motors: str = ""
) -> JointFile | None:
    """The joint targets of a file of another program; None of a table of targets.

    Parameters
    ----------
    path : Path
    arm : Arm
        The model's arm.
    direction : {"command", "feedback"}
    angle_unit : str, optional
        Of a table that does not state it.
    motors : str
        LeRobot's calibration, as the option --motors has it.

    Raises
    ------
    InputError
        If the file is damaged, of another arm, or corrected in this direction already.
    """
    check_no_data_set(path)
    suffix = path.suffix.lower()
    unit = _UNITS.get(suffix)
    if unit is not None and (angle_unit not in (None, unit) or motors):
        option = "--motors" if motors else f"--angle-unit {angle_unit}"
        raise InputError(f"{option} does not apply: joints in {suffix} are in {unit}", file=path, hint="omit it")
    if suffix == ".json":
        raise InputError(
            "JSON has no place to say that a file is corrected, so that it would be corrected twice",
            file=path,
            hint="save the same text under a name that ends in .yaml: JSON is YAML, which has comments",
        )
    with InputError.of_file(path):
        if suffix == ".parquet":
            check_readable(path, limit_bytes=MAX_BYTES)
            return read_parquet(path, arm, direction, angle_unit, motors)
        if suffix in TRAJECTORIES:
            return read_trajectory(read_limited(path, limit_bytes=MAX_YAML_BYTES), arm, direction)
        content = read_limited(path, limit_bytes=MAX_BYTES)
        if suffix in GCODE:
            return read_gcode(content, arm, direction)
        return read_csv(content, arm, direction, angle_unit, motors)


def read_corrected(path: Path) -> None:
    """Check that a file says that truearm has written it: no other is replaced.

    Raises
    ------
    InputError
    """
    if not is_marked(read_limited(path, limit_bytes=MAX_BYTES).decode("latin-1")):
        raise InputError("it does not say that truearm has written it", file=path)
