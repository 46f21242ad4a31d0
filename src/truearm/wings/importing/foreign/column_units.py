"""Units of the columns of a foreign table: as stated, as the table writes them, or the only ones possible.

LeRobot's recordings have a scale of their own, and say which columns are the joints.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, cast, get_args

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
from truearm.wings.importing.foreign.no_readings import lost_targets
from truearm.wings.importing.foreign.program_columns import split_unit
from truearm.wings.importing.foreign.table_columns import JointScale, JointUnit, TableColumns, certain_unit
from truearm.wings.importing.tables.table import Table
from truearm.wings.importing.tables.units import canonical_unit, conversion, unit_in_name


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


PointUnit = Literal["mm", "m", "um", "in", "cm"]

# Half of a session's points span more than 15 mm and less than ten metres [mm]; where a table's numbers do not, as
# those of an arm in metres or micrometres, their unit is asked. Fewer points than these do not tell.
_SMALLEST_SPAN, _LARGEST_SPAN, _FEWEST_POINTS = 15.0, 10_000.0, 5

# Units that the lines above a table state in words: Units: Inches, all coordinates in metres.
_MAX_HEAD_BYTES = 65_536
_WORD = re.compile(
    r"\b(inch(?:es)?|zoll|centimet(?:er|re)s?|millimet(?:er|re)s?|met(?:er|re)s?|micromet(?:er|re)s?|microns?)\b"
    r"|\b(?:units?|einheit(?:en)?|unit\u00e9s?|unidades|lengths?|coordinates?)\b\W{1,3}(?:in\W+)?(mm|cm|m|um|\u00b5m|in)\b",
    re.IGNORECASE,
)


def settle_joint_units(
    scale: JointScale,
    table: Table,
    angles: Sequence[str],
    known: Sequence[str | None],
    values: FloatArray,
    assumed: list[str],
) -> JointScale:
    """Settle the unit of the joints: as stated, as the table or its program has it, or the only one possible.

    Raises
    ------
    InputError
        If it is not known, or the table states another one than `scale` or than its numbers can have.
    """
    written = [canonical_unit(table.units[table.index(column)]) for column in angles]
    of_motors = motor_columns(angles, READ) is not None
    if scale.unit is not None:
        if of_motors and scale.zero is None and set(scale.units(len(angles))) == {"deg"}:
            check_ranges(table, values, "deg", None)
        for name, of_table, of_option in zip(angles, written, scale.units(len(angles)), strict=True):
            is_known = of_table in get_args(JointUnit) and not _is_wrong_angle_unit(of_table, values)
            if is_known and of_table != of_option:
                raise _two_units(table, name, of_table, "--angle-unit", of_option)
        return scale
    stated = [unit if unit in get_args(JointUnit) else None for unit in written]
    stated = [a or b for a, b in zip(stated, known or [None] * len(stated), strict=True)]
    if "rad" in stated and certain_unit(values) == "deg":
        problem = f"the table states rad, but most joints turn up to {np.abs(values).max():.4g}"
        raise table.error(problem, 0, column=table.index(angles[0]), hint="--angle-unit deg, or --angle-unit rad")
    certain = None if any(written) or of_motors else certain_unit(values)  # grad: degrees or gon
    units = [unit or certain for unit in stated]
    if None not in units:
        if None in stated:
            assumed.append(f"angles in {certain}, as some turn {np.abs(values).max():.4g}")
        if "counts" in units and scale.counts_per_turn is None:
            column = table.index(angles[units.index("counts")])
            problem = "encoder counts, by their name or unit, need the counts of a full turn"
            is_stated = split_unit(table.names[column], table.units[column])[1] is not None
            hint = "--counts-per-turn 65536" + "; or --angle-unit deg or rad, if they are angles" * (not is_stated)
            raise table.error(problem, 0, column=column, hint=hint)
        return replace(scale, unit=tuple(cast(JointUnit, unit) for unit in units))
    if of_motors:
        raise table.error(
            "LeRobot's values do not say their unit",
            hint="--angle-unit deg, or with --motors CALIBRATION.json percent or counts (ticks)",
        )
    joint = units.index(None)
    column, value = table.index(angles[joint]), float(values[0, joint])
    if written[joint]:
        problem, hint = f"the unit {table.units[column]!r} is none that is known of an angle", "--angle-unit gon"
    else:
        problem = (
            f"the unit of the joint angles is not stated: {value:g} may be {value:g} deg or {value:g} rad = "
            f"{np.degrees(value):.5g} deg"
        )
        hint = "--angle-unit counts with --counts-per-turn"
    raise table.error(problem, 0, column=column, hint=f"--angle-unit deg, --angle-unit rad, or {hint}")


def _is_wrong_angle_unit(unit: str | None, values: FloatArray) -> bool:
    """Whether a table's own unit of angles is doubtful by its numbers, so that another one may be stated."""
    if unit == "deg":
        return bool(np.nanmax(np.abs(values)) <= 2 * np.pi)
    return unit == "rad" and certain_unit(values) == "deg"


def _two_units(table: Table, column: str, written: str | None, option: str, stated: str) -> InputError:
    return table.error(
        f"the table states {written}, {option} states {stated}",
        column=table.index(column),
        hint=f"{option} {written} if the table is right; if not, correct its header, or --no-header with --skip-lines "
        "and columns by number",
    )


def mm_of(unit: str) -> float:
    """How many mm a unit of length is."""
    found = conversion(unit, "mm")
    assert found is not None
    return found[0]


def length_unit(table: Table, column: str) -> str | None:
    """Unit of a coordinate as the table writes it, X_m and X in too; None where it states none."""
    index = table.index(column)
    unit = canonical_unit(table.units[index] or unit_in_name(table.names[index])) or None
    if unit is None and (behind := split_unit(table.names[index])[1]) in get_args(PointUnit):
        return behind
    if unit is not None and unit not in get_args(PointUnit):
        hint = f"--point-unit with one of {', '.join(get_args(PointUnit))}; other columns: --point X,Y,Z"
        raise table.error(f"the points are in {unit}", column=index, hint=hint)
    return unit


def stated_point_units(
    table: Table, coordinates: Sequence[str], points: FloatArray, option: PointUnit | None
) -> list[str | None]:
    """Units of x, y, z: as the option has it, or else as the table writes each; None where neither does.

    Raises
    ------
    InputError
        If both do, and the numbers do not show that the table's is wrong.
    """
    written = [length_unit(table, column) for column in coordinates]
    other = [(column, unit) for column, unit in zip(coordinates, written, strict=True) if unit not in (None, option)]
    if option is None or not other:
        return [option or unit for unit in written]
    if _is_usual(points * [mm_of(unit or option) for unit in written]):
        raise _two_units(table, *other[0], "--point-unit", option)
    return [option] * len(written)


def settle_point_units(
    table: Table,
    coordinates: Sequence[str],
    known: str | None,
    points: FloatArray,
    assumed: list[str],
    option: PointUnit | None,
) -> list[PointUnit]:
    """Units of x, y, z, or one without points: as stated, or mm where an arm's points can be in nothing else."""
    if option is not None or not coordinates:
        return cast(list[PointUnit], stated_point_units(table, coordinates, points, option) or [option or "mm"])
    known = known if known in get_args(PointUnit) else None
    stated = [unit or known for unit in stated_point_units(table, coordinates, points, None)]
    if None in stated and (above := length_unit_above(getattr(table, "points", table))):
        assumed.append(f"points [{above}], as the lines above the table say")
        stated = [unit or above for unit in stated]
    in_mm = points if None in stated else points * [mm_of(str(unit)) for unit in stated]
    is_usual, span = _is_usual(in_mm), _span(in_mm)
    if is_usual and None not in stated:
        return cast(list[PointUnit], stated)
    if is_usual and not any(stated):
        assumed.append("points in mm")
        return ["mm"] * 3
    other = "m" if span < _SMALLEST_SPAN else "um"
    problem = (
        f"the unit of the points is not stated: half of them span {span:.4g}, which may be mm or {other}"
        if None in stated
        else f"half of the points span {span:.4g} mm by the unit that the table states, {stated[0]}"
    )
    raise table.error(
        problem,
        0,
        column=table.index(coordinates[0]),
        hint=f"--point-unit mm, or --point-unit {other} (one of {', '.join(get_args(PointUnit))})",
    )


def _is_usual(points: FloatArray) -> bool:
    """Whether (n, 3) points span what those of an arm do, if they are in mm; or are too few to tell."""
    return len(_seen(points)) < _FEWEST_POINTS or _SMALLEST_SPAN <= _span(points) <= _LARGEST_SPAN


def _span(points: FloatArray) -> float:
    """How far half of (n, 3) points lie apart: the others may be mistakes."""
    seen = _seen(points)
    return 2 * float(np.median(np.abs(seen - np.median(seen, axis=0)).max(axis=1))) if len(seen) else 0.0


def _seen(points: FloatArray) -> FloatArray:
    return points[~(np.isnan(points).any(axis=1) | lost_targets(points))]


def unit_of_name(name: str) -> str:
    """Unit of a column of a session file, by its name; empty if it has none."""
    return canonical_unit(name.rpartition("_")[2]) or ""


def numbers_in_unit(table: Table, column: str, unit: str, default: str | None = None) -> FloatArray:
    """Numbers of a column in a unit, from that which the table states, or else the default."""
    index = table.index(column)
    values = table.numbers(index)
    written = canonical_unit(table.units[index] or unit_in_name(table.names[index]))
    found = conversion(written or split_unit(table.names[index])[1] or default or unit, unit)
    if not unit or (found is None and not written):  # T_m may be "measured"
        found = conversion(default or unit, unit)
    if found is None:
        hint = f"another column, or one in {unit}"
        raise table.error(f"expected numbers in {unit}, got {written}", column=index, hint=hint)
    return values * found[0] + found[1]


def length_unit_above(table: Table) -> str | None:
    """Return the one unit of length that titles and comments above a table of text name; None of none or several."""
    first = table.header_line or (int(table.lines[0]) if len(table) else 1)
    if table.file is None or table.place != "line" or first < 2:
        return None
    with table.file.open("rb") as file:
        text = file.read(_MAX_HEAD_BYTES).replace(b"\0", b"").decode("utf-8", "replace")
    above = "\n".join(text.splitlines()[: first - 1])
    words = {(match[1] or match[2]).casefold().replace("zoll", "inch") for match in _WORD.finditer(above)}
    units = {canonical_unit(word) or canonical_unit(word.rstrip("s")) for word in words} & {*get_args(PointUnit)}
    return units.pop() if len(units) == 1 else None
