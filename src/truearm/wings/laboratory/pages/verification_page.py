"""The page of a verification: the decision, the values against their limits, artefacts and uncertainty budgets.

The places stand in space, coloured by how much of its limit each value and its uncertainty take.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isinf

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.number_format import RoundedNumber, capitalize, format_count, format_in_text, format_number, format_percent
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.palette import BAD, DOUBTFUL, INK, LIMIT, PAPER
from truearm.pages.plotting import Figure, figure_style, join_phrases, make_view, shorten
from truearm.pages.scene import PointCloud, PointColumn, Scene
from truearm.typing import FloatArray
from truearm.wings.laboratory.pages.limits_figure import limits_figure
from truearm.wings.laboratory.standards.decision import Budget, ConformityResult, Verdict
from truearm.wings.laboratory.standards.measured_points import PointGroup
from truearm.wings.laboratory.standards.specification import SYMBOLS
from truearm.wings.laboratory.standards.verification import (
    LEVEL_TEXT,
    UNROUNDED_TEXT,
    Verification,
    describe_decision,
    describe_rule,
    limit_uncertainty,
    verdict_sentence,
    worst_values,
)
from truearm.wings.laboratory.standards.verification_plan import CHECK_STANDARD, VerificationPlan, is_confirmed

SOURCES = "Where each number stands"
_SHA256 = r", SHA-256 [0-9a-f]{64}"  # of the model, which is a row of data and settings
_CROSS_OF_EXTENT = 0.04  # arms of the cross at the origin


def where_scene(tests: Mapping[str, Sequence[PointGroup]], rows: Sequence[ConformityResult]) -> Scene:
    """The measured balls, seats and lengths in the frame of the points.

    Each has the colour of its value that is nearest to the limit. The nearest of all, and those that decide against
    conformity, are named.

    Parameters
    ----------
    tests : mapping of str to sequence of PointGroup
        The measured groups of every test.
    rows : sequence of ConformityResult
        With limits.
    """
    places = measured_places(tests, rows)
    judged = [place for place in places if place.values]
    others = [place.ends for place in places if not place.values and len(place.ends) > 1]
    what = f"{format_count(len(places), 'measured place')} in space"
    return Scene(
        f"{what}, coloured by share of the limit" if judged else what,
        "mm",
        where_figure(places),
        cloud=_cloud(judged) if judged else None,
        lines=[*_origin(places), *others],
    )


def _cloud(places: Sequence[MeasuredPlace]) -> PointCloud:
    nearest = [place.values[0] for place in places]
    shares = [100 * share_of_limit(one) for one in nearest]
    named = {int(np.argmax(shares)), *(i for i, place in enumerate(places) if place.decisive is not None)}
    return PointCloud(
        np.array([place.middle for place in places]),
        [f"{place.name}: {one.label}" for place, one in zip(places, nearest, strict=True)],
        [
            # A value at its limit has the darkest colour, so that a good arm looks good.
            PointColumn("share of the limit", "%", shares, top=100.0),
            PointColumn("value without its sign", "mm", [abs(one.value) for one in nearest]),
        ],
        axes=[
            PointColumn("from the origin", "mm", [float(np.linalg.norm(place.middle)) for place in places]),
            PointColumn("height", "mm", [float(place.middle[2]) for place in places]),
        ],
        notes=[
            PointColumn("value", "mm", [one.value for one in nearest]),
            PointColumn("U", "mm", [one.uncertainty for one in nearest]),
            PointColumn("limit", "mm", [one.limit or 0.0 for one in nearest]),
        ],
        noun="place",
        spans={i: place.ends for i, place in enumerate(places) if len(place.ends) == 2},
        marked={i: shorten((places[i].decisive or nearest[i]).label, longest=20) for i in sorted(named)},
    )


def _origin(places: Sequence[MeasuredPlace]) -> list[FloatArray]:
    """A cross at the origin of the frame: the arm stands there, if the points are in its frame."""
    seen = np.concatenate([*(place.ends for place in places), np.zeros((1, 3))])
    arm = _CROSS_OF_EXTENT * max(float(np.ptp(seen, axis=0).max()), 1.0)
    return [np.stack([-arm * axis, arm * axis]) for axis in np.eye(3)]


# The figure on paper -------------------------------------------------------------------------------------------------

_VIEWS = (("from above", 0, 1), ("from the front", 0, 2))
# Names of marked places [points]: width of a bold letter, height of a line, and distances above the place to try.
_LETTER_PT, _LINE_PT = 6.2, 11.0
_LABEL_UPS = [6 + sign * step * 11 for step in range(8) for sign in ((1,) if step == 0 else (1, -1))]
_PENS = {Verdict.NOT_CONFORM: (BAD, "X"), Verdict.UNDECIDED: (DOUBTFUL, "D")}


def where_figure(places: Sequence[MeasuredPlace]) -> Figure:
    """Draw where artefacts were measured, and at which places a value is beyond its limit or undecided.

    Parameters
    ----------
    places : sequence of MeasuredPlace
        At least one.
    """
    marked = [place for place in places if place.decisive is not None]
    with figure_style():
        panels = tuple(_panel(places, view) for view in _VIEWS)
    names = join_phrases(dict.fromkeys(place.decisive.name for place in marked if place.decisive is not None))
    verdicts = (
        f"On paper red with a cross: beyond the limit; amber with a diamond: undecided; grey: the others. {names}."
    )
    return Figure(
        panels,
        caption="Where the arm was tested, in the frame of the points: dots are balls and seats, lines are lengths. "
        "On a screen the colour shows how much of its limit a value takes with its uncertainty, of several values the "
        f"nearest to its limit; a ring marks the nearest of all and what is named here. "
        f"{verdicts if marked else 'Every value of a single place is within its limit.'}",
        alt=f"{format_count(len(places), 'measured place')} from above and from the front"
        f"{f'; marked: {names}' if marked else ''}.",
        columns=2,
    )


def _panel(places: Sequence[MeasuredPlace], view: tuple[str, int, int]) -> Drawing:
    title, *both = view
    seen = np.concatenate([*(place.ends[:, both] for place in places), np.zeros((1, 2))])
    labels = (f"{'xyz'[axis]} [mm]" for axis in both)
    drawing, axes = make_view((4.6, 3.2), seen.min(axis=0), seen.max(axis=0), labels=labels, title=title)
    axes.locator_params(nbins=6)
    for place in sorted(places, key=lambda one: one.verdict is not None):
        _draw(axes, place.ends[:, both], place)
    mm_per_pt = np.ptp(axes.get_xlim()) / (72 * 4.6 * axes.get_position().width)
    _label(axes, [place for place in places if place.decisive is not None], both, mm_per_pt=float(mm_per_pt))
    return drawing


def _draw(axes: Axes, ends: FloatArray, place: MeasuredPlace) -> None:
    """Draw a place."""
    marked = place.verdict is not None
    colour, marker = (LIMIT, "o") if place.verdict is None else _PENS[place.verdict]
    if len(ends) > 1:
        axes.plot(*ends.T, color=colour, linewidth=2.6 if marked else 1.0, zorder=4 if marked else 2)
    at = ends.mean(axis=0)
    if marked or len(ends) == 1:
        axes.plot(*at, marker, color=colour, markersize=9 if marked else 6, markeredgecolor=PAPER, zorder=5)


def _label(axes: Axes, places: Sequence[MeasuredPlace], view: list[int], *, mm_per_pt: float) -> None:
    """Name places, each on the side that has more room, above or below the names that are there already."""
    left_half, taken = sum(axes.get_xlim()) / 2, list[FloatArray]()
    for place in places:
        assert place.decisive is not None
        at = place.ends[:, view].mean(axis=0)
        name = shorten(place.decisive.name.partition(", position")[0], longest=20)
        side = 1 if at[0] < left_half else -1
        for up in _LABEL_UPS:
            start = at / mm_per_pt + [7 * side, up]
            box = np.array([min(start[0], start[0] + side * _LETTER_PT * len(name)), start[1]])
            box = np.concatenate([box, box + [_LETTER_PT * len(name), _LINE_PT]])
            if not any((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all() for other in taken):
                break
        taken.append(box)
        axes.annotate(
            name, at, xytext=(7 * side, up), color=INK, textcoords="offset points",
            ha="left" if side > 0 else "right", weight="bold", zorder=6,
            arrowprops=None if up == _LABEL_UPS[0] else {"arrowstyle": "-", "color": LIMIT, "linewidth": 0.7},
        )  # fmt: skip


def verification_page(verification: Verification, *, facts: Sequence[tuple[str, str]] = ()) -> Page:
    """Lay out the page of a verification.

    Parameters
    ----------
    verification : Verification
    facts : sequence of (str, str)
        Plan, files with their SHA-256, versions.
    """
    nearest = max(verification.rows_with_limit, key=share_of_limit)
    nearest_label = f"of its limit, value and uncertainty together: {nearest.name}"
    return Page(
        title=f"{verification.specification.name}: {verification.conclusion.value}",
        subtitle=f"{verification.plan.heading}. Limits: {verification.specification.source}, for a measuring range of "
        f"{verification.specification.measuring_range_mm:g} mm.",
        summary=(
            LabelledValue(nearest_label, format_percent(share_of_limit(nearest)), state=_state(nearest, verification)),
            LabelledValue("values with a limit", len(verification.rows_with_limit)),
            LabelledValue("measured points", sum(len(group.points) for group in verification.groups)),
        ),
        sections=verification_sections(verification),
        facts=tuple(facts),
        verdict=PageVerdict(
            verdict_sentence(verification), _STATES[verification.conclusion], worst_values(verification)
        ),
    )


def verification_sections(verification: Verification) -> tuple[Section, ...]:
    """The sections of a verification, for a page of its own or as part of another."""
    return (
        _decision(verification),
        _values(verification),
        _artefacts(verification),
        _budgets(verification),
        sources_section(verification.plan, verification.measured.tests),
    )


def shares_figure(verification: Verification) -> Figure:
    """Draw the values that have a limit as shares of it, the most urgent ones first."""
    rows = sorted(verification.rows_with_limit, key=_urgency)
    return limits_figure(rows, rule=verification.rule, decides=verification.gap is None)


def _decision(verification: Verification) -> Section:
    days = sorted({group.date for group in verification.groups})
    points = sum(len(group.points) for group in verification.groups)
    on = f"on {days[0]}" if len(days) == 1 else f"from {days[0]} to {days[-1]}"
    source = "" if verification.measured.file is None else f" of {verification.measured.file.name}"
    sources = f"{format_count(points, 'point')}{source}, measured {on}"
    if verification.temperatures is not None:
        low, high = verification.temperatures
        degC = format_in_text(high, unit="°C")
        if low < high:
            degC = f"{format_in_text(low)} to {degC}"
        sources += f"; artefacts at {degC} (means of the groups of points)"
    remarks = [remark for remark in verification.remarks if CHECK_STANDARD not in remark]
    origin = verification.measured.origin.describe()
    decision = describe_decision(verification)
    # The entries that are not confirmed stand in a table.
    if missing := ", ".join(one.key for one in verification.plan.unconfirmed(verification.measured.tests)):
        decision = decision.replace(f": {missing}.", f" (listed under {SOURCES!r}).")
    paragraphs = [decision, re.sub(_SHA256, "", origin), *(f"{capitalize(remark)}." for remark in remarks)]
    rule = describe_rule(verification.rule, confirmed=verification.gap is None)
    text = "\n\n".join([*paragraphs, f"{sources}.", rule])
    return Section("Decision", text, scenes=(where_scene(verification.measured.tests, verification.rows_with_limit),))


def _values(verification: Verification) -> Section:
    cells: list[tuple[Cell, ...]] = []
    rows = sorted(verification.rows, key=_urgency)
    for row in rows:
        u, limit = row.uncertainty, None
        if row.limit is not None:
            limit = RoundedNumber(row.limit, limit_uncertainty(row.limit))
        numbers: tuple[Cell, ...] = (RoundedNumber(row.value, u), RoundedNumber(u, u), limit)
        if row.unit != "mm":  # a count
            numbers = (format_number(row.value), None, None)
        cells.append((row.label, *numbers, verification.describe_row(row), row.where))
    columns = Column.of("test", "value [mm]", "U [mm]", "limit [mm]", "verdict", "where")
    return Section(
        "Values against limits",
        f"U is the expanded uncertainty of the test value from artefact and set-up, for a level of {LEVEL_TEXT}; it "
        "does not contain the errors of the arm, which are tested. Limits apply to magnitudes. Values are printed to "
        f"the last digit of U, limits to the nanometre. {UNROUNDED_TEXT}",
        figures=(shares_figure(verification),),
        tables=(
            Table(
                columns,
                tuple(cells),
                "Test values, their uncertainties and limits; those that do not conform come first.",
                states=tuple(_state(row, verification) for row in rows),
            ),
        ),
    )


def _artefacts(verification: Verification) -> Section:
    cells: list[tuple[Cell, ...]] = []
    for one in verification.used_artefacts:
        dates = (one.certificate, str(one.date), str(one.expires))
        if not (sizes := verification.sizes(one)):
            cells.append((f"{verification.describe_artefact(one)}, {one.kind}", None, None, *dates))
        for name, size, u in sizes:
            what = one.kind if one.kind == "sphere" else name
            cells.append(
                (f"{verification.describe_artefact(one)}, {what}", RoundedNumber(size, u), RoundedNumber(u, u), *dates)
            )
    columns = Column.of(
        "artefact", "calibrated at 20 °C [mm]", "u (k = 1) [mm]", "certificate", "calibrated on", "valid until"
    )
    return Section(
        "Artefacts",
        "All certificates were valid on the days of the measurements.",
        tables=(Table(columns, tuple(cells), "Measured artefacts."),),
    )


def _budgets(verification: Verification) -> Section:
    by_budget: dict[Budget, list[ConformityResult]] = {}
    for row in verification.rows:
        if row.budget.contributions:
            by_budget.setdefault(row.budget, []).append(row)
    return Section(
        "Uncertainty budgets",
        "The contributions to the standard uncertainty of a test value are independent: their squares add. Effective "
        "degrees of freedom by Welch and Satterthwaite (GUM G.4.1); U = k u.",
        tables=tuple(_budget(budget, rows) for budget, rows in by_budget.items()),
        folded=True,
    )


def _budget(budget: Budget, rows: Sequence[ConformityResult]) -> Table:
    total = budget.u
    cells: list[tuple[Cell, ...]] = []
    for one in budget.contributions:
        share = RoundedNumber(100 * one.u**2 / total**2, 1.0) if total else None  # to a tenth
        cells.append((one.label, RoundedNumber(one.u, one.u), _dof(one.dof), share))
    cells.append(("combined standard uncertainty u", RoundedNumber(total, total), _dof(budget.dof), None))
    expanded = f"expanded uncertainty U, k = {budget.coverage_factor:.2f}"
    cells.append((expanded, RoundedNumber(budget.expanded, budget.expanded), None, None))
    columns = Column.of("contribution", "u [mm]", "degrees of freedom", "share of u² [%]")
    return Table(columns, tuple(cells), f"{'; '.join(dict.fromkeys(row.name for row in rows))}.")


def sources_section(plan: VerificationPlan, tests: Collection[str]) -> Section:
    """Where each number and formula of a plan's tests stands, and whether somebody looked it up there."""
    entries = list(plan.entries(tests))
    open_ = sum(not is_confirmed(one) for one in entries)
    rows: list[tuple[Cell, ...]] = [
        (one.test, one.describe(), one.source, "confirmed" if is_confirmed(one) else "not confirmed") for one in entries
    ]
    text = f"Every number and formula that enters a verdict. {capitalize(plan.heading)}."
    if open_:
        text += (
            " The text of the standard was not available when the plan was written. Not confirmed, "
            f"{CHECK_STANDARD}: {open_} of {len(entries)}."
        )
    return Section(
        SOURCES,
        text,
        tables=(
            Table(
                Column.of("test", "number or formula", "where it stands", "looked up"),
                tuple(rows),
                f"Entries of the plan {plan.name}.",
                states=tuple("none" if is_confirmed(one) else "doubtful" for one in entries),
            ),
        ),
        folded=True,
    )


_STATES: dict[Verdict | None, State] = {
    Verdict.CONFORM: "good",
    Verdict.UNDECIDED: "doubtful",
    Verdict.NOT_FOR_DECISIONS: "doubtful",
    Verdict.NOT_CONFORM: "bad",
    None: "none",
}


def _urgency(row: ConformityResult) -> int:
    """Values that do not conform come first, then those that are undecided."""
    return 0 if row.verdict is Verdict.NOT_CONFORM else 1 if row.verdict is Verdict.UNDECIDED else 2


def _state(row: ConformityResult, verification: Verification) -> State:
    """Its colour; nothing is good by numbers that nobody confirmed."""
    return "none" if row.verdict is Verdict.CONFORM and verification.gap is not None else _STATES[row.verdict]


def _dof(dof: float) -> Cell:
    return "∞" if isinf(dof) else format_number(dof)


# Values of all lengths together, which are measured at no single place.
_OF_ALL = ("Volumetric.2s", "Volumetric.2RMS")


@dataclass(frozen=True, eq=False)
class MeasuredPlace:
    """An artefact where it was measured: a point, or the two ends of a length.

    Attributes
    ----------
    ends : (1, 3) or (2, 3) array
        Means of the measured points [mm].
    name : str
        Artefact and position.
    values : tuple of ConformityResult
        Every value with a limit that was measured here, nearest to its limit first.
    decisive : ConformityResult or None
        The value for which this place decides that the arm does not conform, or that nothing is decided.
    """

    ends: FloatArray
    name: str
    values: tuple[ConformityResult, ...]
    decisive: ConformityResult | None

    @property
    def middle(self) -> FloatArray:
        """Mean of the ends, (3,) [mm]."""
        return np.asarray(self.ends.mean(axis=0))

    @property
    def verdict(self) -> Verdict | None:
        """Not conform or undecided where the place decides that, else None."""
        return None if self.decisive is None else self.decisive.verdict


def share_of_limit(row: ConformityResult) -> float:
    """Magnitude of a value with its expanded uncertainty, in its limit; 1 is the limit, 0 stands for none."""
    return 0.0 if row.limit is None else (abs(row.value) + row.uncertainty) / row.limit


def measured_places(
    tests: Mapping[str, Sequence[PointGroup]], rows: Sequence[ConformityResult]
) -> tuple[MeasuredPlace, ...]:
    """Each artefact at each of its positions.

    Parameters
    ----------
    tests : mapping of str to sequence of PointGroup
        The measured groups of every test.
    rows : sequence of ConformityResult
        With limits; the place of a row is the one that decides it, those of its individual results are all others.
    """
    return tuple(place for test, groups in tests.items() for place in _places(test, groups, rows))


def _places(test: str, groups: Sequence[PointGroup], rows: Sequence[ConformityResult]) -> list[MeasuredPlace]:
    ends: dict[tuple[str, str, str], dict[str, list[FloatArray]]] = {}
    first: dict[tuple[str, str, str], PointGroup] = {}
    for group in groups:
        # Repeats are at one place; the lengths of a bar at one position are several.
        key = (group.artefact, group.keys.get("length", ""), group.keys.get("position", ""))
        ends.setdefault(key, {}).setdefault(group.keys.get("end", "A"), []).append(group.points)
        first.setdefault(key, group)
    places = []
    for key, points in ends.items():
        deciding = [row for row in rows if _was_measured(row, test, first[key]) and row.verdict in _UNMET]
        values = [one for row in rows for one in row.individual or (row,) if _was_measured(one, test, first[key])]
        artefact, length, position = key
        name = f"{artefact}{length and f', {length}'}{position and f', position {position}'}"
        places.append(
            MeasuredPlace(
                np.stack([np.concatenate(one).mean(axis=0) for one in points.values()]),
                name,
                tuple(sorted(values, key=share_of_limit, reverse=True)),
                min(deciding, key=lambda row: _UNMET.index(row.verdict), default=None),
            )
        )
    return places


_UNMET: list[Verdict | None] = [Verdict.NOT_CONFORM, Verdict.UNDECIDED]


def _was_measured(row: ConformityResult, test: str, group: PointGroup) -> bool:
    """Whether the value of a row comes from the place of a group."""
    symbol, _, length = row.label.partition(", ")
    if row.limit is None or symbol in _OF_ALL or SYMBOLS.get(symbol, (None,))[0] != test:
        return False
    if "length" in group.keys and group.keys["length"] != (length or row.where.partition(", position ")[0]):
        return False
    position = group.keys.get("position")
    return position is None or f"position {position}" in row.where.split(", ")
