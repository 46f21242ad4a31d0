"""Units of the columns of a foreign table: as stated, as the table writes them, or the only ones possible."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, cast, get_args

import numpy as np

from truearm.files.tables.table import Table
from truearm.files.tables.units import canonical_unit, conversion, unit_in_name
from truearm.readings.foreign.joint_scale import JointScale, JointUnit, certain_unit
from truearm.readings.foreign.no_readings import lost_targets
from truearm.readings.foreign.program_columns import split_unit
from truearm.readings.foreign.table_columns import TableColumns
from truearm.typing import FloatArray

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
    """Settle the unit of the joints: as stated, as the table or its program has it, or the only one possible."""
    if scale.unit is not None:
        return scale
    written = [canonical_unit(table.units[table.index(column)]) for column in angles]
    stated = [unit if unit in get_args(JointUnit) else None for unit in written]
    stated = [a or b for a, b in zip(stated, known or [None] * len(stated), strict=True)]
    if "rad" in stated and certain_unit(values) == "deg":
        problem = f"the table states rad, but most joints turn up to {np.abs(values).max():.4g}"
        raise table.error(problem, 0, column=table.index(angles[0]), hint="--angle-unit deg, or --angle-unit rad")
    certain = None if any(written) else certain_unit(values)  # grad: degrees or gon
    units = [unit or certain for unit in stated]
    if None not in units:
        if None in stated:
            assumed.append(f"angles in {certain}, as some turn {np.abs(values).max():.4g}")
        return replace(scale, unit=tuple(cast(JointUnit, unit) for unit in units))
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


def mm_of(unit: str) -> float:
    """How many mm a unit of length is."""
    found = conversion(unit, "mm")
    assert found is not None
    return found[0]


def length_unit(table: Table, column: str) -> str | None:
    """Unit of a coordinate as the table writes it; None where it states none."""
    index = table.index(column)
    unit = canonical_unit(table.units[index] or unit_in_name(table.names[index])) or None
    if unit is not None and unit not in get_args(PointUnit):
        hint = f"--point-unit with one of {', '.join(get_args(PointUnit))}; other columns: --points X,Y,Z"
        raise table.error(f"the points are in {unit}", column=index, hint=hint)
    return unit


def settle_point_unit(
    table: Table, columns: TableColumns, known: str | None, points: FloatArray, assumed: list[str]
) -> PointUnit:
    """Unit of the points: as the table states it, or mm where an arm's points can be in nothing else."""
    if not columns.points:
        return "mm"
    known = known if known in get_args(PointUnit) else None
    stated = [length_unit(table, column) or known for column in columns.points]
    if None in stated and (above := length_unit_above(getattr(table, "points", table))):
        assumed.append(f"points [{above}], as the lines above the table say")
        stated = [unit or above for unit in stated]
    seen = points[~(np.isnan(points).any(axis=1) | lost_targets(points))]
    if None not in stated:
        seen = seen * [mm_of(str(unit)) for unit in stated]
    # Half of the points decide: one may be a mistake.
    span = 2 * float(np.median(np.abs(seen - np.median(seen, axis=0)).max(axis=1))) if len(seen) else 0.0
    is_usual = len(seen) < _FEWEST_POINTS or _SMALLEST_SPAN <= span <= _LARGEST_SPAN
    if is_usual and None not in stated:
        return cast(PointUnit, stated[0])
    if is_usual and not any(stated):
        assumed.append("points in mm")
        return "mm"
    other = "m" if span < _SMALLEST_SPAN else "um"
    problem = (
        f"the unit of the points is not stated: half of them span {span:.4g}, which may be mm or {other}"
        if None in stated
        else f"half of the points span {span:.4g} mm by the unit that the table states, {stated[0]}"
    )
    raise table.error(
        problem,
        0,
        column=table.index(columns.points[0]),
        hint=f"--point-unit mm, or --point-unit {other} (one of {', '.join(get_args(PointUnit))})",
    )


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
