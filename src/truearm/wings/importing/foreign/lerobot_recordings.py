"""LeRobot's recordings: which columns are the joints, and how their values become joint angles."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.targets.joint_files.tables import READ, motor_columns
from truearm.wings.exports.targets.lerobot_motors import (
    MOTORS,
    Motors,
    check_motor_values,
    joint_values,
    motors_and_arm,
)
from truearm.wings.importing.foreign.table_columns import JointScale, TableColumns
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
        If the table has no column of a motor, the scale has more than one unit, or as `check_ranges` and
        `joint_values`.
    """
    if (scale.counts_per_turn, scale.sign, scale.zero) != (None, None, None):
        raise InputError("LeRobot's calibration states counts, signs and zeros", hint="omit them, or --motors")
    motors, arm = motors_and_arm(calibration)
    units = {scale.unit} if scale.unit is None or isinstance(scale.unit, str) else {*scale.unit}
    unit = units.pop() if len(units) == 1 else "several"
    gain, zero = joint_values(unit, motors, arm)
    table = _with_numbers_of_lists(table)
    if not columns.angles:
        names = motor_columns(table.names, READ)
        if names is None:
            raise table.error(
                f"expected columns of {', '.join(MOTORS)}, or {READ}", hint="--angles names the columns base to tip"
            )
        columns = replace(columns, angles=names)
    if len(columns.angles) == len(MOTORS):
        values = np.stack([table.numbers(table.index(name)) for name in columns.angles], axis=1)
        check_ranges(table, values, str(unit), motors)
    of_motors = JointScale("counts", (2 * np.pi / np.abs(gain)).tolist(), np.sign(gain).tolist(), zero.tolist())
    said = (
        f"{unit} of LeRobot in columns {columns.angles[0]} .. {columns.angles[-1]}, as angles of the {arm or 'so101'}"
    )
    return replace(table, assumed=(*table.assumed, said)), columns, of_motors


def check_ranges(table: Table, values: FloatArray, unit: str, motors: Motors | None) -> None:
    """Check that (n, 5) values of a table can be in their unit; see `check_motor_values`.

    Raises
    ------
    InputError
        With the row.
    """
    try:
        check_motor_values(values, [str(row) for row in range(len(table))], unit=unit, motors=motors)
    except InputError as error:
        raise table.error(error.problem, int(str(error.row)), hint=error.hint) from None


def _with_numbers_of_lists(table: Table) -> Table:
    """A table whose lists are text, as pandas writes them, with a column for each of their numbers."""
    if READ not in table.names:
        return table
    at = table.names.index(READ)
    lists = [re.sub(r"[\[\](),]", " ", cell).split() for cell in table.words(at).tolist()]
    width = len(lists[0]) if lists else 0
    for row, cells in enumerate(lists):
        if len(cells) != width:
            raise table.error(f"expected a list of {width} numbers, got {len(cells)}", row, column=at)
    return replace(
        table,
        names=(*table.names, *(f"{READ}[{i}]" for i in range(width))),
        units=(*table.units, *[""] * width),
        columns=(*table.columns, *(np.array([cells[i] for cells in lists], dtype=np.str_) for i in range(width))),
    )
