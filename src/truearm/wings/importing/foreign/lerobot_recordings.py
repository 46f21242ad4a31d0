"""LeRobot's recordings: which columns are the joints, and how their values become joint angles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np

from truearm.wings.exports.targets.joint_files.tables import READ, motor_columns
from truearm.wings.exports.targets.lerobot_motors import MOTORS, joint_values, motors_and_arm
from truearm.wings.importing.foreign.joint_scale import JointScale
from truearm.wings.importing.foreign.table_columns import TableColumns
from truearm.wings.importing.tables.table import Table


def lerobot_meaning(
    table: Table, columns: TableColumns, unit: str, calibration: str
) -> tuple[TableColumns, JointScale, str]:
    """Columns and scale of a recording, and what was assumed.

    Parameters
    ----------
    table : Table
    columns : TableColumns
        Those that a person states.
    unit : str
        As `joint_values` takes it, empty where it is not stated.
    calibration : str
        File, and arm before it, as the option --motors has them.

    Raises
    ------
    InputError
        If the table has no column of a motor, or as `joint_values`.
    """
    motors, arm = motors_and_arm(calibration)
    gain, zero = joint_values(unit or None, motors, arm)
    if not columns.angles:
        names = motor_columns(table.names, READ)
        if names is None:
            raise table.error(
                f"expected columns of {', '.join(MOTORS)}, or {READ}", hint="--angles names the columns base to tip"
            )
        columns = replace(columns, angles=names)
    per_turn = (2 * np.pi / np.abs(gain)).tolist()
    scale = JointScale("counts", per_turn, np.sign(gain).tolist(), cast(Any, zero.tolist()))
    said = f"{unit} of LeRobot in columns {columns.angles[0]} .. {columns.angles[-1]}"
    return columns, scale, f"{said}, as angles of the {arm or 'so101'}"
