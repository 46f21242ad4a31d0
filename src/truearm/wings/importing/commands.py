"""The commands that bring readings of others: import and fetch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.console import print_json, print_line, print_record, progress
from truearm.verbs.outputs import check_new_output, check_output_is_not_input

if TYPE_CHECKING:
    from truearm.typing import FloatArray
    from truearm.wings.importing.foreign import ImportedTable, TableColumns
    from truearm.wings.importing.tables.table import TableForm

# Options of points to measure that a session does not take, those that both take, and those that join two tables.
FOR_FORMS = ("date", "artefact_temperature")
OF_FORM = ("separator", "decimal", "thousands", "header", "skip_lines", "encoding")
FOR_BOTH = {"table", "into", "points", "point_unit", "serial_number", "part", *OF_FORM}
FOR_TWO = ("by", "time_offset_s", "standstill_s", "standstill_mm")
NAMES = {"time_offset_s": "--time-offset", "standstill_mm": "--standstill-mm", "u_mm": "--u-mm"}
_ONE_EACH = "one, or one a joint, separated by commas"
PREVIEW_ROWS = 5
Names = tuple[str, ...]
MOST_IN_A_RANGE = 100  # columns of 1-6


@options.of_verb(
    "truearm.wings.importing.foreign.tables:import_table",
    omit=("columns", "scale", "points_from", "part"),
    called=NAMES,
    within={"skip_lines": (0, None)},
)
def import_table(
    verb: Any,  # noqa: ARG001 - a session alone: what was assumed is printed too
    context: typer.Context,
    table: Annotated[Path, Argument(metavar="TABLE", help="Text, workbook, array or log: see docs/import.md.")],
    out: Annotated[Path | None, Option(help="Session file to write, .csv or .parquet.")] = None,
    into: Annotated[
        Path | None, Option(help="Points to measure (truearm verify sheet), .csv: fill in their coordinates.")
    ] = None,
    points_from: Annotated[
        Path | None, Option("--with", metavar="TABLE", help="A second table, which holds the points.")
    ] = None,
    preview: Annotated[bool, Option("--preview", help="Show the first rows as understood; write nothing.")] = False,
    angles: Annotated[
        str, Option(help="Columns of the joints, base to tip: names or numbers (1-6). Without it, all are recognised.")
    ] = "",
    angle_unit: options.AngleUnit = None,
    counts_per_turn: Annotated[str, Option(help=f"Counts of an encoder in a full turn: {_ONE_EACH}.")] = "",
    sign: Annotated[str, Option(help="+ or - for each joint, as +,-,+; all + by default.")] = "",
    zero: Annotated[str, Option(help="Each joint's value where its angle is zero, in the table's unit; 0.")] = "",
    couple: Annotated[
        str, Option(metavar="SUMS", help="Joints that are sums of the table's: 'J3+=J2', 'J3=J3-0.5*J2; J5=J5+J4'.")
    ] = "",
    points: Annotated[
        str, Option("--point", help="Columns x,y,z of the reference point; with --into of the point.")
    ] = "",
    point_std: Annotated[str, Option(help="Columns of its three standard uncertainties.")] = "",
    orientation: Annotated[
        str,
        Option(
            help="Columns of the flange's orientation in the frame of the points: 3 of a rotation vector or of Euler "
            "angles, 4 of a quaternion, 9, 12 or 16 of a matrix row by row; 12 and 16 have the point too."
        ),
    ] = "",
    column: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=COLUMN",
            help="What else a session file holds: seat, session, position, tip, temperature_degC, anchor, distance_mm, "
            "payload_kg, load_1_Nm, ..; as seat=Nest, position=GX,GY,GZ (repeat).",
        ),
    ] = None,
    part: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Sheet of a workbook, variable of an archive, topic of a log; one for each table."),
    ] = None,
    date: options.Date = None,
    artefact_temperature: options.ArtefactTemperature = None,
    force: options.Force = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Turn a table of another program into a session file.

    How the table is written and the columns of programs that truearm knows are recognised, and one line says what was
    assumed; options override it. Where the table may mean two things that differ in a number, it is refused with both.
    A column is given by its name, or by its number from 1. The ranges of the result are printed: they show a wrong
    unit or sign.

    --into fills in a file of points to measure from the export of a metrology program (--point X,Y,Z), a point for
    each row without coordinates, in their order.
    """
    from truearm.wings.importing.foreign.tables import BLANKS
    from truearm.wings.importing.tables.table import TableForm

    written = {name: given.pop(name) for name in OF_FORM}
    form = TableForm(**{**written, "separator": BLANKS.get(written["separator"], written["separator"])})
    if into is not None:
        others = [str(option.name) for option in context.command.params if option.name not in (*FOR_FORMS, *FOR_BOTH)]
        options.refuse_typed(context, others, "does not apply to --into")
        named = given["point_unit"], form, part or (), date, artefact_temperature, given["serial_number"] or ""
        _fill(table, into, _listed(points), *named)
        return
    options.refuse_typed(context, FOR_FORMS, "applies to --into only", hint="omit it, or use --into")
    if out is None and not preview:
        raise InputError("expected --out, --preview or --into", hint="--out session.csv")
    if points_from is None:
        options.refuse_typed(context, FOR_TWO, "joins two tables", hint="name the second one: --with TABLE")

    from truearm.readings import check_session_path
    from truearm.wings.importing.foreign import JointScale
    from truearm.wings.importing.foreign.tables import as_tables, read_foreign_tables

    sources = [table] if points_from is None else [table, points_from]
    if out is not None and not preview:
        check_session_path(out)
        check_new_output(out, *sources, force=force)
    scale = JointScale(
        unit=cast(Any, _listed(angle_unit or "") or None),
        counts_per_turn=_numbers(counts_per_turn, "--counts-per-turn"),
        sign=_signs(sign),
        zero=_numbers(zero, "--zero"),
    )
    columns = _columns(column or [], *map(_listed, (angles, points, point_std, orientation)))
    with progress(f"importing {table.name}"):
        found = read_foreign_tables(as_tables(sources, form, part or ()), columns, scale, **given)
        if couple:
            found = _coupled(found, couple)
        if out is not None and not preview:
            _write(found, out)
    file = None if preview else out
    if as_json:
        print_json(_record(found, file))
        return
    _print_result(found, " and ".join(source.name for source in sources), file)


def _write(found: ImportedTable, out: Path) -> None:
    """Write the session, with angles in rad where the table has such."""
    from truearm.readings import write_session

    unit = "rad" if "rad" in found.units else "deg"
    slides = [u in ("mm", "m") for u in found.units]
    write_session(found.session, out, prismatic=slides, angle_unit=cast(Any, unit))


def _coupled(found: ImportedTable, sums: str) -> ImportedTable:
    """The same readings with the angles of joints in place of those of their encoders."""
    from truearm.arm.couplings import parse_coupling

    matrix = parse_coupling(sums, found.session.n_joints)
    return replace(found, session=replace(found.session, angles=found.session.angles @ matrix.T))


def _print_result(found: ImportedTable, tables: str, out: Path | None) -> None:
    from truearm.verbs.record import number_of

    said = f"{number_of(len(found.session))} of {found.session.n_joints} joints from {tables}"
    print_line(f"{out}: {said}" if out else said)
    if found.assumed:
        print_line(f"Assumed: {'; '.join(found.assumed)}.")
    for sentence in found.remarks:
        print_line(sentence)
    if out is None:
        _print_first_rows(found)
    _print_ranges(found)


def _record(found: ImportedTable, out: Path | None) -> dict[str, Any]:
    """The import as JSON: what was read and assumed, with remarks."""
    from dataclasses import asdict

    return {
        "file": None if out is None else str(out),
        "n_readings": len(found.session),
        "n_joints": found.session.n_joints,
        "units": list(found.units),
        "columns": asdict(found.columns),
        "assumed": list(found.assumed),
        "remarks": list(found.remarks),
    }


def _print_first_rows(found: ImportedTable) -> None:
    """Print the first readings in the columns of a session file."""
    import numpy as np

    from truearm.readings.columns import session_columns
    from truearm.verbs.record import TextTable

    head = found.session.rows(np.arange(min(len(found.session), PREVIEW_ROWS)))
    columns = session_columns(head, [u in ("mm", "m") for u in found.units], "deg")
    cells = [[f"{v:.6g}" if isinstance(v, float) else str(v) for v in column.tolist()] for column in columns.values()]
    called = [head.called(i) for i in range(len(head))]
    print_line(str(TextTable(["", *columns], [list(row) for row in zip(called, *cells, strict=True)])))


def _fill(
    table: Path,
    into: Path,
    columns: tuple[str, ...],
    point_unit: Any,
    form: TableForm,
    parts: Sequence[str],
    date: str | None,
    artefact_degC: float | None,
    serial_number: str,
) -> None:
    """Fill in points to measure, and print the ranges of the coordinates."""
    from truearm.files.dates import now, parse_moment
    from truearm.verbs.record import TextTable
    from truearm.wings.importing.foreign.tables import as_tables, import_points
    from truearm.wings.laboratory.standards.coordinate_origin import ARM_SOFTWARE, CoordinateOrigin
    from truearm.wings.laboratory.standards.points_form import fill_points_form

    check_output_is_not_input(into, table)
    moment = now() if date is None else parse_moment(date)
    _check_not_predicted(table)
    with progress(f"importing {table.name}"):
        (source,) = as_tables([table], form, parts)
        found = import_points(source, columns, point_unit=point_unit)
        n = fill_points_form(
            into,
            found,
            day=moment.date(),
            artefact_degC=artefact_degC,
            serial_number=serial_number,
            origin=CoordinateOrigin(ARM_SOFTWARE),
        )
    print_line(f"{into}: {n} points from {table.name}")
    rows = [[axis, *_range(values, "mm")] for axis, values in zip("xyz", found.T, strict=True)]
    print_line(str(TextTable(["", "min", "max", "unit"], rows)))


def _check_not_predicted(table: Path) -> None:
    """Check that a table is no table of `truearm predict`: its points would pass for those of the arm's software."""
    from truearm.wings.laboratory.standards.coordinate_origin import OUTSIDE

    if table.is_file():
        with table.open("rb") as stream:
            if OUTSIDE.encode() in stream.readline(10_000):
                raise InputError(
                    "these points were computed by a model of truearm",
                    file=table,
                    hint="truearm verify fill MODEL SESSION --into points.csv also states the model",
                )


def _print_ranges(found: ImportedTable) -> None:
    """Print the ranges of the result, which show a wrong unit or sign."""
    import numpy as np

    from truearm.verbs.record import TextTable

    rows, readings = [], found.session
    for i, unit in enumerate(found.units):
        slides = unit in ("mm", "m")
        values = readings.angles[:, i] if slides else np.degrees(readings.angles[:, i])
        name = readings.angle_columns[i] if readings.angle_columns else ""
        rows.append([f"J{i + 1}", name, *_range(values, "mm" if slides else "deg")])
    if readings.points is not None:
        rows += [[axis, "reference", *_range(at, "mm")] for axis, at in zip("xyz", readings.points.T, strict=True)]
    if readings.quaternion is not None:
        # The angle between each flange and the first one: a wrong unit or order of columns shows.
        known = readings.quaternion[~np.isnan(readings.quaternion[:, 0])]
        half = np.arccos(np.clip(np.abs(known @ known[0]), 0.0, 1.0))
        rows.append(["turned", "from the first flange", *_range(np.degrees(2 * half), "deg")])
    if readings.temperature_degC is not None:
        rows.append(["temperature", "", *_range(readings.temperature_degC, "degC", decimals=2)])
    print_line(str(TextTable(["", "column", "min", "max", "unit"], rows, left_aligned=(0, 1))))
    for name in ("position", "seat", "session"):
        if (names := getattr(readings, name)) is not None:
            print_line(f"{name}s: {len(set(names.tolist()))}")


def _range(values: FloatArray, unit: str, *, decimals: int = 3) -> list[str]:
    import numpy as np

    return [f"{np.nanmin(values):.{decimals}f}", f"{np.nanmax(values):.{decimals}f}", unit]


def _listed(text: str) -> tuple[str, ...]:
    """Parts between commas; 1-6 stands for 1,2,3,4,5,6."""
    parts: list[str] = []
    for part in text.split(",") if text.strip() else ():
        first, _, last = part.strip().partition("-")
        if first.isdecimal() and last.isdecimal() and int(first) <= int(last) < int(first) + MOST_IN_A_RANGE:
            parts += map(str, range(int(first), int(last) + 1))
        else:
            parts.append(part.strip())
    return tuple(parts)


def _columns(stated: list[str], angles: Names, points: Names, point_std: Names, orientation: Names) -> TableColumns:
    """The columns of the table, with those that --column states by their names in a session file."""
    from truearm.wings.importing.foreign import TableColumns

    others = {}
    for text in stated:
        name, sign, column = (part.strip() for part in text.partition("="))
        if not (sign and name and column):
            raise InputError(f"--column expects NAME=COLUMN, got {text!r}", hint="--column payload_kg=Mass")
        others[name] = column
    seat, session, temperature = (others.pop(name, None) for name in ("seat", "session", "temperature_degC"))
    position = _listed(others.pop("position", ""))
    return TableColumns(angles, points, point_std, seat, session, temperature, position, orientation, others)


def _numbers(text: str, option: str) -> tuple[float, ...] | None:
    return tuple(options.numbers_of(text, option, "1.5,-2,0")) if text.strip() else None


def _signs(text: str) -> tuple[float, ...] | None:

    known = {"+": 1.0, "-": -1.0, "+1": 1.0, "-1": -1.0, "1": 1.0}
    if bad := [part for part in _listed(text) if part not in known]:
        raise InputError(f"--sign expects + or - for each joint, got {bad[0]!r}", hint="--sign +,-,+")
    return tuple(known[part] for part in _listed(text)) or None


def fetch(
    name: Annotated[str, Argument(metavar="[NAME]", help="A name from the list.", show_default=False)] = "",
    out: Annotated[Path | None, Option(help="Session file to write; NAME.csv by default.")] = None,
    force: options.Force = False,
) -> None:
    """Get the published readings of a real arm.

    The readings are downloaded once, checked against the published files, and written as a session file. Where lengths
    between its seats are known, they are written beside it, to OUT-lengths.csv. Without a name, the sets are listed.
    """
    from truearm.readings import check_session_path
    from truearm.verbs.record import TextTable
    from truearm.wings.importing.datasets import DATASETS, load_lengths
    from truearm.wings.importing.fetch import fetch as fetch_readings

    if not name:
        rows = [[name, entry.title, entry.arm] for name, entry in DATASETS.items()]
        print_line(str(TextTable(["name", "set", "arm"], rows, left_aligned=(0, 1, 2))))
        return
    path = out or Path(f"{name}.csv")
    beside = path.with_name(f"{path.stem}-lengths.csv")
    files = {"session": path} | ({"lengths": beside} if load_lengths(name) else {})
    check_session_path(path)
    for written in files.values():
        check_new_output(written, force=force)
    with progress(f"fetching {name}"):
        published = fetch_readings(name)
        published.save(path, lengths=files.get("lengths"))
    print_record(published, files=files)
