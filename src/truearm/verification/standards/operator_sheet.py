"""The operator's sheet: where the artefacts go, whence they are touched, in which order, and what to write down."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Circle

from truearm import __version__
from truearm.pages.number_format import capitalize, format_count, format_number
from truearm.pages.page import Cell, Column, Page, Section, Table
from truearm.pages.plotting import FAINT, INK, LIMIT, Figure, figure_style, shorten
from truearm.typing import FloatArray
from truearm.verification.standards.artefacts import Artefacts
from truearm.verification.standards.layout import Placement
from truearm.verification.standards.verification_plan import CHECK_STANDARD, VerificationPlan

_ORANGE, _NAVY, _PURPLE = "#d9730d", "#12407a", "#a8488f"
_BLANK = "\u00a0"  # a cell to fill in by hand
_STEP_MM = 10  # places are told to a centimetre

# Tests by what stands where, and what that is called in the pictures.
_ON_BALLS = ("probing", "articulation", "effective_diameter")
_ON_BARS = ("uni", "bi", "volumetric")

_ENDS_TOUCHED = (
    "In a seat one point is taken; on a ball five all over its half, the pole and four on the equator, never a single "
    "one; on a face one."
)

# Where a direction comes from, as seen from the arm, in steps of 45 deg from beyond the artefact on to the left.
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
    """What the sheet is about.

    Parameters
    ----------
    plan : VerificationPlan
    layout : sequence of Placement
        In the order of measuring, of one plan.
    artefacts : Artefacts
    measuring_range_mm : float
        Diameter of the reach [mm].
    shoulder_mm : float
        Height of its middle above the base [mm].
    arm : str
        The arm's name, or an empty text for a line to fill in.
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
        """The placements of some tests."""
        return [one for one in self.layout if one.test in tests]

    def stands(self, tests: Sequence[str]) -> dict[tuple[float, ...], str]:
        """Numbers of the places where something stands, by the place, in the order of measuring."""
        found: dict[tuple[float, ...], str] = {}
        for one in self.of(tests):
            found.setdefault(_place(one), str(len(found) + 1))
        return found


def operator_sheet_page(sheet: OperatorSheet) -> Page:
    """Lay out the operator's sheet."""
    points, steps = sum(len(one.points) for one in sheet.layout), len(list(_rows_of_steps(sheet)))
    sections = [_heads(sheet), _places(sheet)]
    if sheet.of(_ON_BARS):
        sections.append(_bars(sheet))
    if sheet.of(_ON_BALLS):
        sections.append(_probing(sheet))
    sections += [_written(sheet), _steps(sheet)]
    return Page(
        title=f"{sheet.plan.standard}: operator's sheet",
        subtitle=f"{sheet.plan.title}: {format_count(points, 'point')} in {format_count(steps, 'step')}. Laid out for a "
        f"measuring range of {format_number(round(sheet.measuring_range_mm))}\u00a0mm by truearm {__version__}.",
        sections=tuple(sections),
    )


# Text and tables ------------------------------------------------------------------------------------------------------


def _heads(sheet: OperatorSheet) -> Section:
    heads = ("arm", sheet.arm or _BLANK, "operator", _BLANK)
    entries = (
        ("its serial number", _BLANK, "date", _BLANK),
        ("probe, its tip", _BLANK, "air at the beginning [degC]", _BLANK),
        ("place", _BLANK, "air at the end [degC]", _BLANK),
    )
    known = {
        one.name: one for kind in (sheet.artefacts.spheres, sheet.artefacts.bars, sheet.artefacts.seats) for one in kind
    }
    used = [known[name] for name in dict.fromkeys(one.artefact for one in sheet.layout)]
    artefacts = tuple((one.name, one.certificate, str(one.expires), _BLANK, _BLANK) for one in used)
    columns = ("artefact", "certificate", "serves until", "serial number", "thermometer")
    return Section(
        "Before you start",
        "Let arm and artefacts stand in the room until they have its temperature, and warm the arm up as its maker "
        "says. Qualify the stylus, but not on the sphere of this test. Fix arm and artefacts so that they do not move.",
        tables=(
            Table(tuple(Column(head) for head in heads), entries, "", fillable=True),
            Table(
                tuple(Column(head) for head in columns),
                artefacts,
                "Artefacts. Their certificates must serve on the day.",
                fillable=True,
            ),
        ),
    )


def _places(sheet: OperatorSheet) -> Section:
    balls, seats = sheet.stands(_ON_BALLS), sheet.stands(("single_point",))
    rows: list[tuple[Cell, ...]] = []
    for what, stands, tests in (("ball", balls, _ON_BALLS), ("seat", seats, ("single_point",))):
        for place, number in stands.items():
            names = dict.fromkeys(one.artefact for one in sheet.of(tests) if _place(one) == place)
            rows.append((f"{what}\u00a0{number}", ", ".join(names), *_rounded(np.array(place))))
    below = min(0.0, min(float(one.at[2]) for one in sheet.layout))
    floor = (
        f" The lowest is {format_number(round(-below, -1))}\u00a0mm below the base: the arm must stand higher than "
        "that above the floor."
        if below < -_STEP_MM
        else ""
    )
    tables: tuple[Table, ...] = ()
    if rows:
        columns = (Column("place"), Column("artefact"), Column("ahead", "mm"), Column("left", "mm"), Column("up", "mm"))
        tables = (Table(columns, tuple(rows), "Middles of balls and seats, from the middle of the arm's base."),)
    return Section(
        "Where",
        "Ahead, left and up are counted from the middle of the arm's base. The places are proposals made here, not the "
        f"standard's; a few centimetres do not matter.{floor}",
        figures=(places_figure(sheet),) if rows else (),
        tables=tables,
    )


def _bars(sheet: OperatorSheet) -> Section:
    rows: list[tuple[Cell, ...]] = []
    for test, position, lengths, start, end in _lines(sheet):
        lean = np.degrees(np.arcsin(abs(float((end - start)[2])) / np.linalg.norm(end - start)))
        rows.append(
            (_name_of_line(sheet, test, position), *_rounded(start), *_rounded(end), round(float(lean)), lengths)
        )
    columns = [Column("place")]
    for group in ("end A", "end B of the longest"):
        columns += [Column(heading, "mm", group=group) for heading in ("ahead", "left", "up")]
    columns += [Column("rise", "deg"), Column("lengths", "mm")]
    return Section(
        "Where the bar lies",
        "All lengths at a place begin at the same end A. The seats or balls look up, those of an upright bar towards "
        f"the arm. {_ENDS_TOUCHED} The points of the steps are counted for seats.",
        figures=(bars_figure(sheet),),
        tables=(Table(tuple(columns), tuple(rows), "Ends of the bar from the middle of the arm's base."),),
    )


def _probing(sheet: OperatorSheet) -> Section:
    text, figures, tables = [], [], []
    patterns = {len(one.points): one for one in sheet.of(("probing", "effective_diameter"))}
    if patterns:
        text.append(
            "Over the ball: touch it at the points of the picture, the first at the pole, the others row by row. The "
            "stylus leans half way between the surface's normal and the vertical."
        )
        figures.append(pattern_figure(patterns))
    groups = _groups(sheet)
    if groups:
        text.append(
            "In groups: all points of a group are touched with the stylus pointing one way, the first where it points, "
            "the others on the equator as seen along it. Between groups the elbow goes to another side."
        )
        figures.append(groups_figure(groups))
        rows = tuple((name, capitalize(describe_direction(direction, 0.0))) for name, direction in groups.items())
        tables.append(
            Table(
                (Column("group"), Column("where the stylus comes from")),
                rows,
                "Beyond is the side of the ball away from the arm; left and right are as seen from the arm.",
            )
        )
    return Section("Which way the stylus points", "\n\n".join(text), figures=tuple(figures), tables=tuple(tables))


def _steps(sheet: OperatorSheet) -> Section:
    rows = tuple(
        (number, what, points, _BLANK, _BLANK) for number, (what, points) in enumerate(_rows_of_steps(sheet), start=1)
    )
    columns = (
        Column("step"),
        Column("what to do"),
        Column("points"),
        Column("artefact", "degC"),
        Column("time, remarks"),
    )
    return Section(
        "Step by step",
        tables=(Table(columns, rows, "In the order to measure.", fillable=True),),
    )


def _written(sheet: OperatorSheet) -> Section:
    unsure = [f"{key} = {value:g}" for key, value, _ in sheet.plan.unconfirmed() if key.split(".")[0] in _tests(sheet)]
    said = (
        "Of each step the temperature of the artefact; if something moves, take the whole step again. The points go "
        "into a file, one row a point, with the columns test, artefact, date, position, length, repeat, "
        "end, group, x_mm, y_mm, z_mm and artefact_degC, and tip_diameter_mm if points on balls or faces are not "
        "compensated but the centre of the stylus tip: truearm verify reads it, and docs/verification.md describes "
        "it. What stands in quotation marks on this sheet is what to write there."
    )
    if _tests(sheet) & {"single_point", "uni", "volumetric"}:
        said += (
            "\n\nPoints in seats must be the centre of the stylus tip. Many programs compensate single points along "
            "the direction of approach: switch that off for seats, else up to a tip's radius is in the result."
        )
    if unsure:
        said += f"\n\nNumbers of the plan that were recalled and not read, {CHECK_STANDARD}: {', '.join(unsure)}."
    return Section("What to write down", said)


def _rows_of_steps(sheet: OperatorSheet) -> Iterator[tuple[str, int]]:
    """What to do, and how many points that is, step by step."""
    balls, seats = sheet.stands(_ON_BALLS), sheet.stands(("single_point",))
    done: set[tuple[str, str]] = set()
    for one in sheet.layout:
        k = len(one.points)
        if one.test == "probing":
            yield f"Ball {balls[_place(one)]}, all over its upper half: test 'probing', {_keys(one)}", k
        elif one.test == "effective_diameter":
            yield f"Ball {balls[_place(one)]}, all over its upper half: test 'effective_diameter', {_keys(one)}", k
        elif one.test == "articulation":
            direction = describe_direction(one.approach[0], float(np.arctan2(one.at[1], one.at[0])))
            yield f"Ball {balls[_place(one)]}, the stylus {direction}: test 'articulation', {_keys(one)}", k
        elif one.test == "single_point":
            postures = "the elbow from side to side, another posture at each point"
            yield f"Seat {seats[_place(one)]}, the tip's centre, {postures}: test 'single_point', {_keys(one)}", k
        else:
            position = one.keys["position"]
            if (one.test, position) in done:
                continue
            done.add((one.test, position))
            here = [other for other in sheet.of((one.test,)) if other.keys["position"] == position]
            lengths = dict.fromkeys(other.keys["length"] for other in here)
            runs = len({other.keys.get("repeat") for other in here})
            again = f", {runs} times" if runs > 1 else ""
            named = ", ".join(f"'{length}'" for length in lengths)
            bar = capitalize(_name_of_line(sheet, one.test, position))
            how = "" if one.test == "bi" else ", in a seat one point, on a ball five all over it"
            what = f"length{'s' * (len(lengths) > 1)} {named}, end 'A' then 'B'{how}{again}"
            points = sum(len(other.points) for other in here)
            yield f"{bar}, {what}: test '{one.test}', position '{position}'", points


def _keys(one: Placement) -> str:
    return ", ".join(f"{key} '{value}'" for key, value in one.keys.items())


def _tests(sheet: OperatorSheet) -> set[str]:
    return {one.test for one in sheet.layout}


def _place(one: Placement) -> tuple[float, ...]:
    return tuple(one.at.round(3).tolist())


def _rounded(point: FloatArray) -> tuple[int, ...]:
    return tuple(int(value) for value in _STEP_MM * (point / _STEP_MM).round())


def _lines(sheet: OperatorSheet) -> Iterator[tuple[str, str, str, FloatArray, FloatArray]]:
    """Each place of a bar: test, position, the lengths there, end A and the farthest end B [mm]."""
    places: dict[tuple[str, str], list[Placement]] = {}
    for one in sheet.of(_ON_BARS):
        places.setdefault((one.test, one.keys["position"]), []).append(one)
    for (test, position), here in places.items():
        start = next(one.at for one in here if one.keys["end"] == "A")
        end = max((one.at for one in here), key=lambda at: float(np.linalg.norm(at - start)))
        yield test, position, ", ".join(dict.fromkeys(one.keys["length"] for one in here)), start, end


def _name_of_line(sheet: OperatorSheet, test: str, position: str) -> str:
    """``bar 3``, or with its test where a plan has several on bars."""
    several = len(_tests(sheet) & set(_ON_BARS)) > 1
    return f"bar\u00a0{position}" + (f" of {test}" if several else "")


def _groups(sheet: OperatorSheet) -> dict[str, FloatArray]:
    """Directions of the groups by their names, turned so that x is away from the arm."""
    found: dict[str, FloatArray] = {}
    for one in sheet.of(("articulation",)):
        x, y, z = one.approach[0]
        azimuth = np.arctan2(one.at[1], one.at[0])
        turned = np.array([x * np.cos(azimuth) + y * np.sin(azimuth), y * np.cos(azimuth) - x * np.sin(azimuth), z])
        found.setdefault(one.keys["group"], turned)
    return found


def describe_direction(direction: FloatArray, azimuth: float) -> str:
    """Say where a stylus comes from: ``from above``, or ``from the left, 60 deg off the vertical``.

    Parameters
    ----------
    direction : (3,) array
        Unit vector to where it comes from.
    azimuth : float
        Of the artefact about the arm [rad].
    """
    off = float(np.degrees(np.arccos(np.clip(direction[2], -1, 1))))
    if off < 5:
        return "from above"
    turn = np.arctan2(direction[1], direction[0]) - azimuth
    side = _SIDES[round(float(turn) / (np.pi / 4)) % 8]
    return f"{side}, {off:.0f}\u00a0deg off the vertical"


# Pictures -------------------------------------------------------------------------------------------------------------


def places_figure(sheet: OperatorSheet) -> Figure:
    """Draw where balls and seats stand, from above, from the side and from the front."""
    kinds: tuple[tuple[str, Mapping[tuple[float, ...], str], str, str], ...] = (
        ("ball", sheet.stands(_ON_BALLS), _NAVY, "o"),
        ("seat", sheet.stands(("single_point",)), _ORANGE, "s"),
    )
    with figure_style():
        panels = []
        for view in _VIEWS:
            drawing, axes = _space(sheet, 3.3, 3.1, view=view)
            for _, stands, colour, marker in kinds:
                labels: dict[tuple[int, int], list[str]] = {}  # places that lie one behind the other share theirs
                for place, number in stands.items():
                    x, y = _flat(np.array(place), view=view)
                    axes.plot(x, y, marker, color=colour, markersize=7, markeredgecolor="white", zorder=4)
                    cell = (round(x / sheet.reach_mm * 20), round(y / sheet.reach_mm * 20))
                    labels.setdefault(cell, []).append(number)
                for (column, row), numbers in labels.items():
                    at = (column * sheet.reach_mm / 20, row * sheet.reach_mm / 20)
                    axes.annotate(
                        ", ".join(numbers), at, xytext=(5, 5), textcoords="offset points", color=colour, weight="bold"
                    )
            panels.append(drawing)
    number = " and ".join(format_count(len(stands), what) for what, stands, *_ in kinds if stands)
    return Figure(
        tuple(panels),
        caption="Blue: balls. Orange: seats. The pale disc is what the arm reaches, the cross its base.",
        alt=f"Places of {number} in the measuring volume, from above, from the side and from the front.",
        columns=3,
    )


def bars_figure(sheet: OperatorSheet) -> Figure:
    """Draw each place of the bar, from above and from the side."""
    with figure_style():
        panels = []
        for test, position, _, start, end in _lines(sheet):
            drawing = Drawing(figsize=(2.9, 1.75))
            FigureCanvasAgg(drawing)
            for i, view in enumerate((_ABOVE, _SIDE)):
                axes = drawing.add_axes((0.01 + 0.5 * i, 0.01, 0.48, 0.85))
                _disc(axes, sheet, view=view)
                axes.set_axis_off()
                (x0, y0), (x1, y1) = _flat(start, view=view), _flat(end, view=view)
                axes.plot([x0, x1], [y0, y1], color=_ORANGE, linewidth=2.6, solid_capstyle="round", zorder=3)
                for name, x, y in (("A", x0, y0), ("B", x1, y1)):
                    axes.plot(x, y, "o", color=_ORANGE, markersize=4.5, markeredgecolor="white", zorder=4)
                    if np.hypot(x1 - x0, y1 - y0) > 0.25 * sheet.reach_mm or name == "B":
                        axes.annotate(name, (x, y), xytext=(4, 3), textcoords="offset points", color=INK, zorder=6)
                axes.set_title(_VIEWS[view], fontsize=7, loc="center", pad=1, weight="normal")
            drawing.text(
                0.02,
                0.99,
                shorten(_name_of_line(sheet, test, position).replace(_BLANK, " ")),
                va="top",
                weight="bold",
                fontsize=9,
            )
            panels.append(drawing)
    return Figure(
        tuple(panels),
        caption="Each place from above and from the side, ahead to the right; the cross is the arm's base.",
        alt=f"The bar at {format_count(len(panels), 'place')}, each from above and from the side.",
        columns=3,
    )


def pattern_figure(patterns: Mapping[int, Placement]) -> Figure:
    """Draw the points on a ball's upper half, from above."""
    with figure_style():
        panels = []
        for number, one in patterns.items():
            drawing, axes = _ball(3.2, across=(-1.25, 1.25), up=(-1.25, 1.25))
            for i, (x, y, _) in enumerate(one.normals, start=1):
                axes.plot(x, y, "o", color=_NAVY, markersize=4, zorder=3)
                axes.annotate(str(i), (x, y), xytext=(3, 3), textcoords="offset points", fontsize=7.5, zorder=4)
            axes.set_title(f"{number} points, from above", loc="center")
            panels.append(drawing)
    told_by = " and ".join(format_number(number) for number in patterns)
    return Figure(
        tuple(panels),
        caption="Where to touch the ball, from above; points on the rim lie on the equator. Ahead is to the right.",
        alt=f"Pattern of {told_by} points on the upper half of a ball, seen from above.",
        columns=2,
    )


def groups_figure(groups: Mapping[str, FloatArray]) -> Figure:
    """Draw whence the stylus comes in each group, from above and from the side."""
    with figure_style():
        panels = []
        for view in (_ABOVE, _SIDE):
            low, high = (-1.9, 4.6) if view == _SIDE else (-4.0, 4.0)
            drawing, axes = _ball(3.0, across=(-4.3, 4.1), up=(low, high))
            if view == _SIDE:
                axes.plot([0, 0], [-1.0, -1.9], color=LIMIT, linewidth=2.5, zorder=1)
            marks: dict[tuple[float, float], list[str]] = {}
            for name, direction in groups.items():
                ends = np.array([_flat(direction * away, view=view) for away in (1.05, 3.2)])
                behind = direction[1] > 0.1 and view == _SIDE
                axes.plot(*ends.T, color=_NAVY, linewidth=1.6, zorder=2 if behind else 4)
                axes.plot(*ends[0], "o", color=_ORANGE, markersize=4.5, zorder=2 if behind else 5)
                x, y = _flat(direction * 3.6, view=view)
                marks.setdefault((round(x, 2) + 0.0, round(y, 2) + 0.0), []).append(name)
            longest = max(np.hypot(*place) for place in marks)
            for (x, y), names in marks.items():
                # What is seen along or behind another one stands beside it.
                aside = 0.45 if abs(x) < 0.1 and np.hypot(x, y) < 0.9 * longest else 0.0
                place = (x + aside + 0.12 * (len(names) - 1) * bool(aside), y + (0.45 if np.hypot(x, y) < 0.1 else 0))
                axes.annotate(", ".join(names), place, ha="left" if aside else "center", va="center", weight="bold")
            axes.annotate("\u2190 the arm", (-4.2, low), ha="left", va="bottom", color=LIMIT, fontsize=8)
            axes.set_title(_VIEWS[view], loc="center")
            panels.append(drawing)
    directions = "; ".join(f"{name}: {describe_direction(direction, 0.0)}" for name, direction in groups.items())
    return Figure(
        tuple(panels),
        caption="The stylus in each group; orange is its tip. The arm stands to the left of both pictures.",
        alt=f"Directions of the stylus. {directions}.",
        columns=2,
    )


# Which coordinates a view shows, across and up, and what it is called.
_VIEWS = {(0, 1): "from above", (0, 2): "from the side", (1, 2): "from the front"}
_AXES = ("ahead", "left", "up")
_View = tuple[int, int]
_ABOVE, _SIDE = (0, 1), (0, 2)


def _flat(point: FloatArray, *, view: _View) -> tuple[float, float]:
    """A point as a view shows it."""
    return (float(point[view[0]]), float(point[view[1]]))


def _space(sheet: OperatorSheet, width_in: float, height_in: float, *, view: _View) -> tuple[Drawing, Axes]:
    """Axes with the measuring volume."""
    drawing = Drawing(figsize=(width_in, height_in))
    FigureCanvasAgg(drawing)
    axes = drawing.add_axes((0.78 / width_in, 0.46 / height_in, 1 - 0.94 / width_in, 1 - 0.74 / height_in))
    _disc(axes, sheet, view=view)
    across, up = (f"{_AXES[i]} [mm]" for i in view)
    axes.set(xlabel=across, ylabel=up, title=_VIEWS[view])
    return drawing, axes


def _ball(height_in: float, *, across: tuple[float, float], up: tuple[float, float]) -> tuple[Drawing, Axes]:
    """Axes with a ball of radius 1 about the origin, and nothing else."""
    drawing = Drawing(figsize=(3.2, height_in))
    FigureCanvasAgg(drawing)
    axes = drawing.add_axes((0.02, 0.02, 0.96, 0.88))
    axes.set(aspect="equal", xlim=across, ylim=up)
    axes.set_axis_off()
    axes.add_patch(Circle((0, 0), 1, facecolor="#eef2f7", edgecolor=LIMIT, linewidth=0.8, zorder=3))
    return drawing, axes


def _disc(axes: Axes, sheet: OperatorSheet, *, view: _View) -> None:
    """What the arm reaches, its base, and from the side the stand up to its shoulder."""
    middle = (0.0, sheet.shoulder_mm if view[1] == 2 else 0.0)
    axes.add_patch(Circle(middle, sheet.reach_mm, facecolor="#f1f4f8", edgecolor=FAINT, linewidth=0.8, zorder=0))
    if view[1] == 2:
        axes.plot([0, 0], [0, sheet.shoulder_mm], color=LIMIT, linewidth=2.2, zorder=2)
    axes.plot(0, 0, marker="+", markersize=8, markeredgewidth=1.2, color=INK, zorder=5)
    axes.set_aspect("equal")
    room = 1.06 * sheet.reach_mm
    axes.set_xlim(middle[0] - room, middle[0] + room)
    axes.set_ylim(middle[1] - room, middle[1] + room)
