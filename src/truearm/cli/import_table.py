"""``truearm import``: a table of another program becomes a session file, or fills in points to measure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer
from typer import Argument, Option

from truearm.cli.console import check_output_is_not_input, print_line, progress
from truearm.cli.options import FormDate, FormTemperature, IntoForm, numbers_of, refuse_typed

if TYPE_CHECKING:
    from truearm.readings import JointScale, Session
    from truearm.typing import FloatArray

# Options of points to measure, and of sessions, that the other does not take.
FOR_FORMS = ("date", "artefact_temperature", "serial_number")
NOT_FOR_FORMS = (
    *("out", "angles", "angle_unit", "counts_per_turn", "sign", "zero", "point_std", "orientation", "orientation_unit"),
    *("temperature", "seat", "position", "session", "session_name"),
)
_ONE_EACH = "one, or one a joint, separated by commas"


def import_table(
    context: typer.Context,
    table: Annotated[Path, Argument(metavar="TABLE", help="Delimited text: CSV, TSV, ..")],
    out: Annotated[Path | None, Option(help="Session file to write, .csv or .parquet.")] = None,
    into: IntoForm = None,
    angles: Annotated[str, Option(help="Columns of the joints, base to tip: names or numbers.")] = "",
    angle_unit: Annotated[str, Option(help=f"deg, rad, counts, or mm (sliding): {_ONE_EACH}.")] = "",
    counts_per_turn: Annotated[str, Option(help=f"Counts of an encoder in a full turn: {_ONE_EACH}.")] = "",
    sign: Annotated[str, Option(help="+ or - for each joint, as +,-,+; all + by default.")] = "",
    zero: Annotated[
        str, Option(help="Each joint's value where its angle is zero, in the table's unit; 0 by default.")
    ] = "",
    points: Annotated[str, Option(help="Columns x,y,z of the reference point; with --into of the point.")] = "",
    point_std: Annotated[str, Option(help="Columns of its three standard uncertainties.")] = "",
    point_unit: Annotated[str, Option(help="Unit of the point and its uncertainties: mm, m, um or in.")] = "mm",
    orientation: Annotated[
        str,
        Option(
            help="Columns of the flange's orientation in the frame of the points: 3 of a rotation vector, 4 of a "
            "quaternion (w first), 9, 12 or 16 of a matrix row by row; 12 and 16 have the point too."
        ),
    ] = "",
    orientation_unit: Annotated[str, Option(help="Unit of a rotation vector: deg or rad.")] = "",
    temperature: Annotated[str, Option(help="Column of the temperature [degC].")] = "",
    seat: Annotated[str, Option(help="Column that names the seat.")] = "",
    position: Annotated[str, Option(help="Columns that name the position aimed at.")] = "",
    session: Annotated[str, Option(help="Column that names the session.")] = "",
    session_name: Annotated[str, Option(help="Name of the session of all readings.")] = "",
    separator: Annotated[str, Option(help="One character, TAB, or SPACE: one or more.")] = ",",
    decimal: Annotated[str, Option(help="Decimal sign, . or ,")] = ".",
    no_header: Annotated[bool, Option("--no-header", help="The first line is a reading.")] = False,
    skip_lines: Annotated[int, Option(min=0, help="Lines above the header to skip.")] = 0,
    encoding: Annotated[str, Option(help="utf-8, cp1252, utf-16, ..")] = "utf-8",
    date: FormDate = None,
    artefact_temperature: FormTemperature = None,
    serial_number: Annotated[str, Option(help="With --into: serial number of the arm.")] = "",
) -> None:
    """Turn a table of another program into a session file.

    State its columns, units, signs, zeros and separators here, once. A column is given by its name, or by its number
    from 1. The ranges of the result are printed: they show a wrong unit or sign.

    --into fills in a file of points to measure from the export of a metrology program (--points X,Y,Z), a point for
    each row without coordinates, in their order.
    """
    from truearm.errors import InputError

    layout: dict[str, Any] = {
        "separator": {"TAB": "\t", "\\t": "\t", "SPACE": " "}.get(separator, separator),
        "decimal": decimal,
        "header": not no_header,
        "skip_lines": skip_lines,
        "encoding": encoding,
    }
    if into is not None:
        refuse_typed(context, NOT_FOR_FORMS, "does not apply to --into")
        _fill(table, into, _listed(points), point_unit, layout, date, artefact_temperature, serial_number)
        return
    refuse_typed(context, FOR_FORMS, "applies to --into only", hint="omit it, or use --into")
    if out is None:
        raise InputError("expected --out or --into", hint="--out session.csv")
    for name, value in (("--angles", angles), ("--angle-unit", angle_unit)):
        if not value:
            raise InputError(f"a session file needs {name}", hint=f"{name} {'deg' if 'unit' in name else 'J1,J2,..'}")

    from truearm.readings import JointScale, TableColumns, check_session_path, write_session
    from truearm.readings import import_table as read_table
    from truearm.workflows.sentences import number_of

    check_output_is_not_input(out, table)
    check_session_path(out)

    scale = JointScale(
        unit=cast(Any, _listed(angle_unit)),
        counts_per_turn=_numbers(counts_per_turn, "--counts-per-turn"),
        sign=_signs(sign),
        zero=_numbers(zero, "--zero"),
    )
    columns = TableColumns(
        _listed(angles), _listed(points), _listed(point_std), seat or None, session or None, temperature or None,
        _listed(position), _listed(orientation),
    )  # fmt: skip
    with progress(f"importing {table.name}"):
        readings = read_table(
            table,
            columns,
            scale,
            point_unit=cast(Any, point_unit),
            orientation_unit=cast(Any, orientation_unit or None),
            **layout,
            session_name=session_name or None,
        )
        units = scale.units(readings.n_joints)
        unit = "rad" if "rad" in units else "deg"
        write_session(readings, out, prismatic=[u == "mm" for u in units], angle_unit=cast(Any, unit))
    print_line(f"{out}: {number_of(len(readings))} of {readings.n_joints} joints from {table.name}")
    _print_ranges(readings, scale)


def _fill(
    table: Path,
    into: Path,
    columns: tuple[str, ...],
    point_unit: str,
    layout: dict[str, Any],
    date: str | None,
    artefact_degC: float | None,
    serial_number: str,
) -> None:
    """Fill in points to measure, and print the ranges of the coordinates."""
    from truearm.readings import import_points
    from truearm.verification.standards.dates import now, parse_moment
    from truearm.verification.standards.points_form import fill_points_form
    from truearm.workflows.record import TextTable

    check_output_is_not_input(into, table)
    moment = now() if date is None else parse_moment(date)
    with progress(f"importing {table.name}"):
        found = import_points(table, columns, point_unit=cast(Any, point_unit), **layout)
        n = fill_points_form(into, found, day=moment.date(), artefact_degC=artefact_degC, serial_number=serial_number)
    print_line(f"{into}: {n} points from {table.name}")
    rows = [[axis, *_range(values, "mm")] for axis, values in zip("xyz", found.T, strict=True)]
    print_line(str(TextTable(["", "min", "max", "unit"], rows)))


def _print_ranges(readings: Session, scale: JointScale) -> None:
    """Print the ranges of the result, which show a wrong unit or sign."""
    import numpy as np

    from truearm.workflows.record import TextTable

    rows = []
    for i, unit in enumerate(scale.units(readings.n_joints)):
        values = readings.angles[:, i] if unit == "mm" else np.degrees(readings.angles[:, i])
        name = readings.angle_columns[i] if readings.angle_columns else ""
        rows.append([f"J{i + 1}", name, *_range(values, "mm" if unit == "mm" else "deg")])
    if readings.points is not None:
        rows += [[axis, "reference", *_range(at, "mm")] for axis, at in zip("xyz", readings.points.T, strict=True)]
    if readings.quaternion is not None:
        # The angle between each flange and the first one: a wrong unit or order of columns shows.
        half = np.arccos(np.clip(np.abs(readings.quaternion @ readings.quaternion[0]), 0.0, 1.0))
        rows.append(["turned", "from the first flange", *_range(np.degrees(2 * half), "deg")])
    if readings.temperature_degC is not None:
        rows.append(["temperature", "", *_range(readings.temperature_degC, "degC", decimals=2)])
    print_line(str(TextTable(["", "column", "min", "max", "unit"], rows, left_aligned=(0, 1))))
    for name in ("position", "seat", "session"):
        if (names := getattr(readings, name)) is not None:
            print_line(f"{name}s: {len(set(names.tolist()))}")


def _range(values: FloatArray, unit: str, *, decimals: int = 3) -> list[str]:
    return [f"{values.min():.{decimals}f}", f"{values.max():.{decimals}f}", unit]


def _listed(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",")) if text.strip() else ()


def _numbers(text: str, option: str) -> tuple[float, ...] | None:
    return tuple(numbers_of(text, option, "1.5,-2,0")) if text.strip() else None


def _signs(text: str) -> tuple[float, ...] | None:
    from truearm.errors import InputError

    known = {"+": 1.0, "-": -1.0, "+1": 1.0, "-1": -1.0, "1": 1.0}
    if bad := [part for part in _listed(text) if part not in known]:
        raise InputError(f"--sign expects + or - for each joint, got {bad[0]!r}", hint="--sign +,-,+")
    return tuple(known[part] for part in _listed(text)) or None
