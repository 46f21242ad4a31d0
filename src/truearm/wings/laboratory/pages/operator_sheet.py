"""The operator's sheet: where the artefacts stand, from where they are touched, in which order, and what to record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Circle

from truearm import __version__
from truearm.number_format import capitalize, format_count, format_number
from truearm.pages.page import Cell, Column, Page, PageVerdict, Section, Table
from truearm.pages.palette import FAINT, INK, LIMIT, NAVY, ORANGE, PALE, PAPER
from truearm.pages.plotting import Figure, figure_style, shorten
from truearm.typing import FloatArray
from truearm.wings.laboratory.pages.verification_page import sources_section
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.layout import Placement
from truearm.wings.laboratory.standards.verification_plan import VerificationPlan

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
    return Section("Step by step", tables=(Table(columns, tuple(rows), "In the order to measure.", fillable=True),))


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


# Tests by the artefact.
ON_BALLS = ("probing", "articulation", "effective_diameter")
ON_BARS = ("uni", "bi", "volumetric")

# The directions, seen from the arm, in steps of 45 deg, counter-clockwise from beyond the artefact.
_SIDES = (
    "from beyond",
    "from beyond and the left",
    "from the left",
    "from the arm's side and the left",
    "from the arm's side",
    "from the arm's side and the right",
    "from the right",
    "from beyond and the right",
)


@dataclass(frozen=True, eq=False)
class OperatorSheet:
    """A test plan laid out for an arm and its artefacts.

    Parameters
    ----------
    plan : VerificationPlan
    layout : sequence of Placement
        In the order of measuring, of one plan.
    artefacts : Artefacts
    measuring_range_mm : float
        Diameter of the spherical reach [mm].
    shoulder_mm : float
        Height of the centre of the reach above the base [mm].
    arm : str
        The arm's name; an empty text leaves a line to fill in.
    """

    plan: VerificationPlan
    layout: Sequence[Placement]
    artefacts: Artefacts
    measuring_range_mm: float
    shoulder_mm: float
    arm: str = ""

    @property
    def reach_mm(self) -> float:
        """Half of the measuring range [mm]."""
        return self.measuring_range_mm / 2

    def of(self, tests: Sequence[str]) -> list[Placement]:
        """Return the placements of some tests."""
        return [one for one in self.layout if one.test in tests]

    def positions(self, tests: Sequence[str]) -> dict[tuple[float, ...], str]:
        """The numbers of the positions of artefacts, in the order of measuring."""
        numbers: dict[tuple[float, ...], str] = {}
        for one in self.of(tests):
            numbers.setdefault(place_of(one), str(len(numbers) + 1))
        return numbers


def place_of(placement: Placement) -> tuple[float, ...]:
    """The position of a placement, to compare it with others [mm]."""
    return tuple(placement.at.round(3).tolist())


def bar_positions(sheet: OperatorSheet) -> Iterator[tuple[str, str, str, FloatArray, FloatArray]]:
    """Each position of a bar: test, name, the lengths there, end A and the farthest end B [mm]."""
    places: dict[tuple[str, str], list[Placement]] = {}
    for one in sheet.of(ON_BARS):
        places.setdefault((one.test, one.keys["position"]), []).append(one)
    for (test, position), here in places.items():
        start = next(one.at for one in here if one.keys["end"] == "A")
        end = max((one.at for one in here), key=lambda at: float(np.linalg.norm(at - start)))
        yield test, position, ", ".join(dict.fromkeys(one.keys["length"] for one in here)), start, end


def name_bar_position(sheet: OperatorSheet, test: str, position: str) -> str:
    """``bar 3``; with its test where a plan has several tests on bars."""
    several = len({one.test for one in sheet.of(ON_BARS)}) > 1
    return f"bar\u00a0{position}" + (f" of {test}" if several else "")


def stylus_directions(sheet: OperatorSheet) -> dict[str, FloatArray]:
    """Directions of the groups by their names, in a frame with x away from the arm."""
    directions: dict[str, FloatArray] = {}
    for one in sheet.of(("articulation",)):
        x, y, z = one.approach[0]
        azimuth = np.arctan2(one.at[1], one.at[0])
        turned = np.array([x * np.cos(azimuth) + y * np.sin(azimuth), y * np.cos(azimuth) - x * np.sin(azimuth), z])
        directions.setdefault(one.keys["group"], turned)
    return directions


def describe_direction(direction: FloatArray, azimuth: float) -> str:
    """Describe a direction: ``from above``, or ``from the left, 60 deg off the vertical``.

    Parameters
    ----------
    direction : (3,) array
        Unit vector from the artefact to the stylus.
    azimuth : float
        Azimuth of the artefact about the arm [rad].
    """
    off = float(np.degrees(np.arccos(np.clip(direction[2], -1, 1))))
    if off < 5:
        return "from above"
    turn = np.arctan2(direction[1], direction[0]) - azimuth
    side = _SIDES[round(float(turn) / (np.pi / 4)) % 8]
    return f"{side}, {off:.0f}\u00a0deg off the vertical"


def places_figure(sheet: OperatorSheet) -> Figure:
    """Draw the positions of test spheres and seats from above and from the side."""
    kinds: tuple[tuple[str, Mapping[tuple[float, ...], str], str, str], ...] = (
        ("test sphere", sheet.positions(ON_BALLS), NAVY, "o"),
        ("seat", sheet.positions(("single_point",)), ORANGE, "s"),
    )
    with figure_style():
        panels = []
        for view in _VIEWS:
            drawing, axes = _space(sheet, 3.5, 3.3, view=view)
            # Names of spheres stand below their marks and those of seats above: in some view one hides the other.
            for (_, stands, colour, marker), (side, up) in zip(kinds, ((-5, -13), (5, 5)), strict=True):
                labels: dict[tuple[int, int], list[str]] = {}  # positions one behind the other share a label
                for place, number in stands.items():
                    x, y = _flat(np.array(place), view=view)
                    axes.plot(x, y, marker, color=colour, markersize=7, markeredgecolor=PAPER, zorder=4)
                    cell = (round(x / sheet.reach_mm * 20), round(y / sheet.reach_mm * 20))
                    labels.setdefault(cell, []).append(number)
                for (column, row), numbers in labels.items():
                    at = (column * sheet.reach_mm / 20, row * sheet.reach_mm / 20)
                    axes.annotate(
                        ", ".join(numbers), at, xytext=(side, up), textcoords="offset points", color=colour,
                        ha="left" if side > 0 else "right", weight="bold",
                    )  # fmt: skip
            panels.append(drawing)
    number = " and ".join(format_count(len(stands), what) for what, stands, *_ in kinds if stands)
    return Figure(
        tuple(panels),
        caption="Blue: test spheres. Orange: seats. The pale disc is the reach of the arm, the cross its base.",
        alt=f"Positions of {number} in the measuring volume, from above and from the side.",
        columns=2,
    )


def bars_figure(sheet: OperatorSheet) -> Figure:
    """Draw each position of the bar from above and from the side."""
    with figure_style():
        panels = []
        for test, position, _, start, end in bar_positions(sheet):
            drawing = Drawing(figsize=(2.9, 1.75))
            for i, view in enumerate((_ABOVE, _SIDE)):
                axes = drawing.add_axes((0.01 + 0.5 * i, 0.01, 0.48, 0.85))
                _disc(axes, sheet, view=view)
                axes.set_axis_off()
                (x0, y0), (x1, y1) = _flat(start, view=view), _flat(end, view=view)
                axes.plot([x0, x1], [y0, y1], color=ORANGE, linewidth=2.6, solid_capstyle="round", zorder=3)
                length = float(np.hypot(x1 - x0, y1 - y0))
                seen = length > 0.25 * sheet.reach_mm  # else end-on: one name beside the dot
                for name, x, y, sign in (("A", x0, y0, -1), ("B", x1, y1, 1)):
                    axes.plot(x, y, "o", color=ORANGE, markersize=4.5, markeredgecolor=PAPER, zorder=4)
                    if seen or name == "B":
                        # Beyond the end, so that no name lies on the bar.
                        away = sign * np.array([x1 - x0, y1 - y0]) / length if seen else np.array([0.8, 0.6])
                        axes.annotate(
                            name, (x, y), xytext=tuple(8 * away), textcoords="offset points", color=INK, ha="center",
                            va="center", zorder=6,
                        )  # fmt: skip
                axes.set_title(_VIEWS[view], fontsize=7, loc="center", pad=1, weight="normal")
            drawing.text(
                0.02,
                0.99,
                shorten(name_bar_position(sheet, test, position).replace("\u00a0", " ")),
                va="top",
                weight="bold",
                fontsize=9,
            )
            panels.append(drawing)
    return Figure(
        tuple(panels),
        caption="The positions of the bar, in the order of measuring.",
        alt=f"The bar at {format_count(len(panels), 'position')}, each from above and from the side.",
        columns=2,
    )


def pattern_figure(patterns: Mapping[int, Placement]) -> Figure:
    """Draw the points on a ball's upper half, from above."""
    with figure_style():
        panels = []
        for number, one in patterns.items():
            drawing, axes = _ball(3.2, across=(-1.25, 1.25), up=(-1.25, 1.25))
            for i, (x, y, _) in enumerate(one.normals, start=1):
                axes.plot(x, y, "o", color=NAVY, markersize=4, zorder=3)
                axes.annotate(str(i), (x, y), xytext=(3, 3), textcoords="offset points", fontsize=7.5, zorder=4)
            axes.set_title(f"{number} points, from above", loc="center")
            panels.append(drawing)
    numbers = " and ".join(format_number(number) for number in patterns)
    return Figure(
        tuple(panels),
        caption="Points on the test sphere, from above; those on the rim lie on the equator. Ahead is to the right.",
        alt=f"Pattern of {numbers} points on the upper half of a test sphere, seen from above.",
        columns=min(len(panels), 2),
    )


def groups_figure(groups: Mapping[str, FloatArray]) -> Figure:
    """Draw the direction of the stylus in each group, from above and in space."""
    with figure_style():
        panels = []
        for title, across_up in _BALL_VIEWS.items():
            in_space = bool(across_up[1, 2])
            low, high = (-1.9, 4.6) if in_space else (-4.0, 4.0)
            drawing, axes = _ball(3.0, across=(-4.3, 4.1), up=(low, high))
            if in_space:
                axes.plot([0, 0], [-1.0, -1.9], color=LIMIT, linewidth=2.5, zorder=1)
            for name, direction in groups.items():
                _stylus(axes, name, direction, across_up)
            axes.annotate("\u2190 the arm", (-4.2, low), ha="left", va="bottom", color=INK, fontsize=8)
            axes.set_title(title, loc="center")
            panels.append(drawing)
    directions = "; ".join(f"{name}: {describe_direction(direction, 0.0)}" for name, direction in groups.items())
    return Figure(
        tuple(panels),
        caption="The stylus in each group; orange is its tip. The arm stands to the left of both pictures; in space, "
        "the test sphere is seen from the arm's side and the right.",
        alt=f"Directions of the stylus. {directions}.",
        columns=2,
    )


# Across and up of each view of a ball, of coordinates ahead, left and up. In space: azimuth -120 deg, 20 deg above the
# horizon, from where no two of the standard's directions coincide.
_BALL_VIEWS = {"from above": np.eye(3)[:2], "in space": np.array([[0.866, -0.5, 0.0], [0.171, 0.296, 0.940]])}


def _stylus(axes: Axes, name: str, direction: FloatArray, across_up: FloatArray) -> None:
    """Draw one direction of the stylus, with its name at the end."""
    near, far = across_up @ (1.05 * direction), across_up @ (3.2 * direction)
    behind = float(np.cross(*across_up) @ direction) < 0
    axes.plot(*np.stack([near, far]).T, color=NAVY, linewidth=1.6, zorder=2 if behind else 4)
    axes.plot(*near, "o", color=ORANGE, markersize=4.5, zorder=2 if behind else 5)
    # One that is seen end-on has its name beside it.
    place = across_up @ (3.6 * direction) if np.hypot(*far) > 0.5 else far + 0.5
    axes.annotate(name, (float(place[0]), float(place[1])), ha="center", va="center", weight="bold", zorder=6)


# The coordinates across and up of each view, and its name.
_VIEWS = {(0, 1): "from above", (0, 2): "from the side"}
_AXES = ("ahead", "left", "up")
_View = tuple[int, int]
_ABOVE, _SIDE = (0, 1), (0, 2)


def _flat(point: FloatArray, *, view: _View) -> tuple[float, float]:
    """A point as a view shows it."""
    return (float(point[view[0]]), float(point[view[1]]))


def _space(sheet: OperatorSheet, width_in: float, height_in: float, *, view: _View) -> tuple[Drawing, Axes]:
    """Axes with the measuring volume."""
    drawing = Drawing(figsize=(width_in, height_in))
    axes = drawing.add_axes((0.78 / width_in, 0.46 / height_in, 1 - 0.94 / width_in, 1 - 0.74 / height_in))
    _disc(axes, sheet, view=view)
    across, up = (f"{_AXES[i]} [mm]" for i in view)
    axes.set(xlabel=across, ylabel=up, title=_VIEWS[view])
    return drawing, axes


def _ball(height_in: float, *, across: tuple[float, float], up: tuple[float, float]) -> tuple[Drawing, Axes]:
    """Axes with a ball of radius 1 about the origin, and nothing else."""
    drawing = Drawing(figsize=(3.2, height_in))
    axes = drawing.add_axes((0.02, 0.02, 0.96, 0.88))
    axes.set(aspect="equal", xlim=across, ylim=up)
    axes.set_axis_off()
    axes.add_patch(Circle((0, 0), 1, facecolor=PALE, edgecolor=LIMIT, linewidth=0.8, zorder=3))
    return drawing, axes


def _disc(axes: Axes, sheet: OperatorSheet, *, view: _View) -> None:
    """The reach of the arm, its base, and from the side the stand up to its shoulder."""
    middle = (0.0, sheet.shoulder_mm if view[1] == 2 else 0.0)
    axes.add_patch(Circle(middle, sheet.reach_mm, facecolor=PALE, edgecolor=FAINT, linewidth=0.8, zorder=0))
    if view[1] == 2:
        axes.plot([0, 0], [0, sheet.shoulder_mm], color=LIMIT, linewidth=2.2, zorder=2)
    axes.plot(0, 0, marker="+", markersize=8, markeredgewidth=1.2, color=INK, zorder=5)
    axes.set_aspect("equal")
    room = 1.06 * sheet.reach_mm
    axes.set_xlim(middle[0] - room, middle[0] + room)
    axes.set_ylim(middle[1] - room, middle[1] + room)
