"""The operator's sheet: where the artefacts stand, from where they are touched, in which order, and what to record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from truearm import __version__
from truearm.number_format import capitalize, format_count, format_number
from truearm.pages.page import Cell, Column, Page, PageVerdict, Section, Table
from truearm.typing import FloatArray
from truearm.wings.laboratory.pages.operator_sheet_figures import (
    ON_BALLS,
    ON_BARS,
    OperatorSheet,
    bar_positions,
    bars_figure,
    describe_direction,
    groups_figure,
    name_bar_position,
    pattern_figure,
    place_of,
    places_figure,
    stylus_directions,
)
from truearm.wings.laboratory.pages.verification_page import sources_section

_BLANK = "\u00a0"  # a cell to fill in by hand
_STEP_MM = 10  # positions are printed to a centimetre

_ENDS_TOUCHED = (
    "Measure one point in a seat, and five points all over the half of a sphere (the pole and four on the equator, "
    "never a single one). On faces: three points or more a face, spread over it; or, if the file of artefacts states "
    "the alignment, one point on each, exactly opposite."
)


def operator_sheet_page(sheet: OperatorSheet) -> Page:
    """Lay out the operator's sheet."""
    points, steps = sum(len(one.points) for one in sheet.layout), len(list(_rows_of_steps(sheet)))
    sections = [_preparation(sheet), _positions(sheet)]
    if sheet.of(ON_BARS):
        sections.append(_bars(sheet))
    if sheet.of(ON_BALLS):
        sections.append(_probing(sheet))
    sections += [_records(sheet), _steps(sheet), sources_section(sheet.plan, _tests(sheet))]
    return Page(
        title=f"Operator's sheet: {sheet.plan.heading}",
        subtitle=f"Laid out for a measuring range of {format_number(round(sheet.measuring_range_mm))}\u00a0mm by "
        f"truearm {__version__}.",
        sections=tuple(sections),
        verdict=PageVerdict(f"Measure {format_count(points, 'point')} in {format_count(steps, 'step')}."),
    )


def _preparation(sheet: OperatorSheet) -> Section:
    entries = (
        ("arm", sheet.arm or _BLANK, "operator", _BLANK),
        ("its serial number", _BLANK, "date", _BLANK),
        ("probe, its tip", _BLANK, "air at the start [degC]", _BLANK),
        ("place", _BLANK, "air at the end [degC]", _BLANK),
    )
    known = {one.name: one for one in sheet.artefacts.all}
    used = [known[name] for name in dict.fromkeys(one.artefact for one in sheet.layout)]
    artefacts = tuple((one.name, one.certificate, str(one.expires), _BLANK, _BLANK) for one in used)
    columns = ("artefact", "certificate", "valid until", "serial number", "thermometer")
    return Section(
        "Before you start",
        "Leave arm and artefacts in the room until they have its temperature, and warm the arm up as its maker "
        "specifies. Qualify the stylus, but not on the sphere of this test. Fix arm and artefacts so that they do not "
        "move.",
        tables=(
            Table((Column(""),) * 4, entries, "", fillable=True),
            Table(
                tuple(Column(head) for head in columns),
                artefacts,
                "Artefacts. The artefact's certificate must be valid on the day of the test.",
                fillable=True,
            ),
        ),
    )


def _positions(sheet: OperatorSheet) -> Section:
    balls, seats = sheet.positions(ON_BALLS), sheet.positions(("single_point",))
    rows: list[tuple[Cell, ...]] = []
    for what, stands, tests in (("sphere", balls, ON_BALLS), ("seat", seats, ("single_point",))):
        for place, number in stands.items():
            names = dict.fromkeys(one.artefact for one in sheet.of(tests) if place_of(one) == place)
            rows.append((f"{what}\u00a0{number}", ", ".join(names), *_rounded(np.array(place))))
    below = min(0.0, min(float(one.at[2]) for one in sheet.layout))
    floor = (
        f" The lowest is {format_number(round(-below, -1))}\u00a0mm below the base: mount the base higher than that "
        "above the floor."
        if below < -_STEP_MM
        else ""
    )
    tables: tuple[Table, ...] = ()
    if rows:
        columns = Column.of("position", "artefact", "ahead [mm]", "left [mm]", "up [mm]")
        tables = (Table(columns, tuple(rows), "Centres of test spheres and seats, from the centre of the arm's base."),)
    return Section(
        "Positions",
        "Coordinates ahead, left and up start at the centre of the arm's base. The positions are proposals of truearm, "
        f"not of the standard; a few centimetres do not matter.{floor}",
        figures=(places_figure(sheet),) if rows else (),
        tables=tables,
    )


def _bars(sheet: OperatorSheet) -> Section:
    rows: list[tuple[Cell, ...]] = []
    for test, position, lengths, start, end in bar_positions(sheet):
        lean = np.degrees(np.arcsin(abs(float((end - start)[2])) / np.linalg.norm(end - start)))
        rows.append(
            (name_bar_position(sheet, test, position), *_rounded(start), *_rounded(end), round(float(lean)), lengths)
        )
    columns = [Column("position")]
    for group in ("end A", "end B of the longest"):
        columns += [Column(heading, "mm", group=group) for heading in ("ahead", "left", "up")]
    columns += [Column("rise", "deg"), Column("lengths", "mm")]
    return Section(
        "Positions of the bar",
        "All lengths at a position begin at the same end A. The seats or spheres point up, those of an upright bar "
        f"towards the arm. {_ENDS_TOUCHED} The numbers of points in the steps are those for seats. Each position is "
        "drawn from above and from the side, ahead to the right; the cross is the arm's base.",
        figures=(bars_figure(sheet),),
        tables=(Table(tuple(columns), tuple(rows), "Ends of the bar, from the centre of the arm's base."),),
    )


def _probing(sheet: OperatorSheet) -> Section:
    text, figures, tables = [], [], []
    patterns = {len(one.points): one for one in sheet.of(("probing", "effective_diameter"))}
    if patterns:
        text.append(
            "All over the sphere: touch the points of the figure, the first at the pole, the others row by row. The "
            "stylus points half way between the surface's normal and the vertical."
        )
        figures.append(pattern_figure(patterns))
    groups = stylus_directions(sheet)
    if groups:
        text.append(
            "In groups: touch all points of a group with one direction of the stylus, the first where it points, the "
            "others on the equator as seen along it. Move the elbow to another side between groups."
        )
        figures.append(groups_figure(groups))
        rows = tuple((name, capitalize(describe_direction(direction, 0.0))) for name, direction in groups.items())
        tables.append(
            Table(
                Column.of("group", "direction of the stylus"),
                rows,
                "Beyond is the side of the sphere away from the arm; left and right are as seen from the arm.",
            )
        )
    return Section("Directions of the stylus", "\n\n".join(text), figures=tuple(figures), tables=tuple(tables))


# What the standards call their tests (ISO 10360-12, ASME B89.4.22).
TEST_NAMES = {
    "probing": "probing size and form error",
    "articulation": "articulated location error",
    "uni": "unidirectional length measurement error",
    "bi": "bidirectional length measurement error",
    "effective_diameter": "effective diameter performance test",
    "single_point": "single-point articulation performance test (SPAT)",
    "volumetric": "volumetric performance test",
}


def _steps(sheet: OperatorSheet) -> Section:
    rows: list[tuple[Cell, ...]] = []
    before = ""
    for number, (test, action, in_file, points) in enumerate(_rows_of_steps(sheet), start=1):
        rows.append((number, "" if test == before else test, action, in_file, points, _BLANK, _BLANK))
        before = test
    columns = Column.of("step", "test", "action", "in the file", "points", "artefact [degC]", "time, remarks")
    return Section(
        "Step by step",
        tables=(Table(columns, tuple(rows), "In the order to measure.", fillable=True),),
    )


def _records(sheet: OperatorSheet) -> Section:
    text = (
        "Record the temperature of the artefact in each step; if something moves, repeat the whole step. Store the "
        "points in a file, one row a point, with the columns test, artefact, date, position, length, repeat, end, "
        "group, x_mm, y_mm, z_mm and artefact_degC, and tip_diameter_mm if points on spheres or faces are not "
        "compensated but are the centre of the stylus tip, and serial_number, that of the arm, in one row or all; "
        "docs/verification.md describes this file, which truearm verify reads. Enter the words of the column 'in the "
        "file' as they are."
    )
    if _tests(sheet) & {"single_point", "uni", "volumetric"}:
        text += (
            "\n\nPoints in seats must be the centre of the stylus tip. Many programs compensate single points along "
            "the direction of approach: switch that off for seats, or the result is wrong by up to the tip's radius. "
            "Move the elbow from side to side: another posture at each point."
        )
    return Section("Records", text)


def _rows_of_steps(sheet: OperatorSheet) -> Iterator[tuple[str, str, str, int]]:
    """The steps: test, action, what the file has, and the number of points."""
    balls, seats = sheet.positions(ON_BALLS), sheet.positions(("single_point",))
    done: set[tuple[str, str]] = set()
    for one in sheet.layout:
        k, name = len(one.points), TEST_NAMES[one.test]
        if one.test in ("probing", "effective_diameter"):
            yield name, f"Sphere {balls[place_of(one)]}, all over the upper half", _in_file(one.test, one.keys), k
        elif one.test == "articulation":
            direction = describe_direction(one.approach[0], float(np.arctan2(one.at[1], one.at[0])))
            yield name, f"Sphere {balls[place_of(one)]}, the stylus {direction}", _in_file(one.test, one.keys), k
        elif one.test == "single_point":
            yield name, f"Seat {seats[place_of(one)]}, posture after posture", _in_file(one.test, one.keys), k
        else:
            position = one.keys["position"]
            if (one.test, position) in done:
                continue
            done.add((one.test, position))
            here = [other for other in sheet.of((one.test,)) if other.keys["position"] == position]
            lengths = list(dict.fromkeys(other.keys["length"] for other in here))
            runs = len({other.keys.get("repeat") for other in here})
            again = f", {runs} times" if runs > 1 else ""
            bar = capitalize(name_bar_position(sheet, one.test, position))
            action = f"{bar}, end A, then B{again}"
            keys = {"position": position, "length": ", ".join(lengths), "end": "A, B"}
            yield name, action, _in_file(one.test, keys), sum(len(other.points) for other in here)


def _in_file(test: str, keys: Mapping[str, str]) -> str:
    """What the columns of the file have in this step."""
    return "; ".join(f"{column} {value}" for column, value in {"test": test, **keys}.items())


def _tests(sheet: OperatorSheet) -> set[str]:
    return {one.test for one in sheet.layout}


def _rounded(point: FloatArray) -> tuple[int, ...]:
    return tuple(int(value) for value in _STEP_MM * (point / _STEP_MM).round())
