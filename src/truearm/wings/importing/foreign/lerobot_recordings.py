"""LeRobot's recordings: which columns are the joints, and how their values become joint angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.errors import InputError
from truearm.wings.exports.targets.joint_files.tables import READ, motor_columns
from truearm.wings.exports.targets.lerobot_motors import MOTORS, joint_values, motors_and_arm
from truearm.wings.importing.foreign.joint_scale import JointScale
from truearm.wings.importing.foreign.table_columns import TableColumns
from truearm.wings.importing.tables.table import Table


def lerobot_meaning(
    table: Table, columns: TableColumns, scale: JointScale, calibration: str
) -> tuple[Table, TableColumns, JointScale]:
    """The table with what was assumed, the columns and the scale of a recording.

    Parameters
    ----------
    table : Table
    columns : TableColumns
        Those that a person states.
    scale : JointScale
        With the unit alone.
    calibration : str
        File, and arm before it, as the option --motors has them.

    Raises
    ------
    InputError
        If the table has no column of a motor, the scale has more than one unit, or as `joint_values`.
    """
    if (scale.counts_per_turn, scale.sign, scale.zero) != (None, None, None):
        raise InputError("LeRobot's calibration states counts, signs and zeros", hint="omit them, or --motors")
    motors, arm = motors_and_arm(calibration)
    units = {scale.unit} if scale.unit is None or isinstance(scale.unit, str) else {*scale.unit}
    unit = units.pop() if len(units) == 1 else "several"
    gain, zero = joint_values(unit, motors, arm)
    if not columns.angles:
        names = motor_columns(table.names, READ)
        if names is None:
            raise table.error(
                f"expected columns of {', '.join(MOTORS)}, or {READ}", hint="--angles names the columns base to tip"
            )
        columns = replace(columns, angles=names)
    of_motors = JointScale("counts", (2 * np.pi / np.abs(gain)).tolist(), np.sign(gain).tolist(), zero.tolist())
    said = (
        f"{unit} of LeRobot in columns {columns.angles[0]} .. {columns.angles[-1]}, as angles of the {arm or 'so101'}"
    )
    return replace(table, assumed=(*table.assumed, said)), columns, of_motors
