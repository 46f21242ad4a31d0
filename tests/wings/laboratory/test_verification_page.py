"""The page of a verification: every value with its uncertainty, limit and budget, and the decision in words."""

import datetime
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from confirmed_plan import confirmed
from html_outline import Outline
from refusals import refuses
from truearm.number_format import RoundedNumber
from truearm.pages.html import render
from truearm.pages.page import Column, Table, format_cell
from truearm.pages.palette import BAD
from truearm.wings.laboratory.pages.limits_figure import limits_figure
from truearm.wings.laboratory.pages.verification_page import (
    measured_places,
    share_of_limit,
    verification_page,
    where_figure,
    where_scene,
)
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.coordinate_origin import CoordinateOrigin
from truearm.wings.laboratory.standards.decision import (
    DECISION_RULES,
    Budget,
    ConformityResult,
    Contribution,
    assess_conformity,
    overall_verdict,
    worst_result,
)
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints, PointGroup
from truearm.wings.laboratory.standards.specification import Specification
from truearm.wings.laboratory.standards.verification import Verification, describe_decision, describe_rule
from truearm.wings.laboratory.standards.verification_plan import CHECK_STANDARD, load_verification_plan

DAY = datetime.date(2026, 11, 3)
RECALLED = load_verification_plan("iso10360-12")
SPECIFICATION = Specification(
    name="arm <7>", source="its data sheet", measuring_range_mm=2500.0, limits={"E_Uni": {"B_um": 50.0}}
)
DATED = {"certificate": "K-1", "date": DAY, "expires": DAY.replace(year=2028), "form_mm": 0.001, "u_fixture_mm": 0.002}
GROWING = {"expansion_per_K": 1e-6, "u_expansion_per_K": 1e-7, "u_temperature_K": 0.5}
ARTEFACTS = Artefacts(
    spheres=[{"name": "ball", "diameter_mm": 25.0004, "u_diameter_mm": 0.0002, **DATED, **GROWING}],
    bars=[{"name": "bar", "lengths": [{"name": "900", "length_mm": 900.003, "u_mm": 0.0005}], **DATED, **GROWING}],
    seats=[{"name": "unused cone", **DATED}],
)
BUDGET = Budget((Contribution("calibration", 0.003, 4.0), Contribution("fixture", 0.004)))  # u = 0.005


def outcome(rows, *, rule="iso14253-1:2013", remarks=(), plan=None):
    plan = plan or confirmed(RECALLED, rule=rule)

    def group(artefact, degC, **keys):
        return PointGroup(artefact, keys, np.zeros((5, 3)), degC, 0.0, DAY, (2,))

    measured = MeasuredPoints(
        {
            "probing": (group("ball", 20.5, position="1"),),
            "uni": (group("bar", 19.0, length="900", position="1", repeat="1", end="A"),),
        },
        Path("points.csv"),
    )
    return Verification(
        tuple(rows), overall_verdict(rows), tuple(remarks), measured, plan, ARTEFACTS, SPECIFICATION, rule
    )


def row(value, limit=0.05, *, label="E_Uni, 900", budget=BUDGET, rule="iso14253-1:2013", where="position 1"):
    return assess_conformity(label, value, budget, limit, rule=rule, where=where)


def table(page, title, number=0):
    section = next(one for one in page.sections if one.title == title)
    return [[cell.text for cell in line] for line in section.tables[number].cells]


# Numbers -------------------------------------------------------------------------------------------------------------


def test_a_value_is_printed_to_the_last_digit_of_its_uncertainty():
    for value, u, text in [
        (0.01084, 0.00104, "0.0108"),
        (0.00104, 0.00104, "0.0010"),
        (-0.00056, 0.0011, "\u22120.0006"),
        (900.003, 0.0005, "900.00300"),
        (0.0996, 0.0996, "0.10"),
        (12.34567, 0.0, "12.3"),
    ]:
        assert format_cell(RoundedNumber(value, u)).text == text, (value, u)


def test_a_rounded_cell_must_be_finite():
    for cell in (RoundedNumber(float("nan"), 1.0), RoundedNumber(1.0, inf)):
        refuses("finite", Table, (Column("a"),), ((cell,),), "caption")


def test_every_row_has_value_uncertainty_limit_and_verdict():
    rows = [
        row(0.0102),
        row(-0.03, None, label="L_Dia.5x5"),
        ConformityResult("E_Uni, sets", 2, "", Budget(), None, None, "of 35"),
    ]
    page = verification_page(outcome(rows))
    # k is Student's t for 95.45 % and 30 effective degrees of freedom, 2.087 [tables of t: 2.09]: U = 0.0104.
    assert BUDGET.dof == pytest.approx(30.86, abs=0.01)
    lines = table(page, "Values against limits")
    assert lines[0] == [
        "E_Uni, 900",
        "0.010",
        "0.010",
        "0.05",
        "conform",
        "position 1",
    ]  # the limit as its maker states it
    assert lines[1] == ["L_Dia.5x5", "\u22120.030", "0.010", "\u2013", "\u2013", "position 1"]
    assert lines[2] == ["E_Uni, sets", "2", "\u2013", "\u2013", "\u2013", "of 35"]


def test_a_budget_stands_once_with_its_degrees_of_freedom_and_k():
    page = verification_page(outcome([row(0.01), row(0.02, label="E_Bi, 900")]))
    section = next(one for one in page.sections if one.title == "Uncertainty budgets")
    (budget,) = section.tables  # one for both
    assert "E_Uni, 900" in budget.caption
    assert "E_Bi, 900" in budget.caption
    assert table(page, "Uncertainty budgets") == [
        ["calibration", "0.0030", "4.00", "36.0"],
        ["fixture", "0.0040", "\u221e", "64.0"],
        ["combined standard uncertainty u", "0.0050", "30.9", "\u2013"],
        ["expanded uncertainty U, k = 2.09", "0.010", "\u2013", "\u2013"],
    ]


def test_only_the_artefacts_that_were_touched_are_listed():
    lines = table(verification_page(outcome([row(0.01)])), "Artefacts")
    assert lines == [
        ["ball, serial number not stated, sphere", "25.00040", "0.00020", "K-1", "2026-11-03", "2028-11-03"],
        ["bar, serial number not stated, length 900", "900.00300", "0.00050", "K-1", "2026-11-03", "2028-11-03"],
    ]


def test_every_entry_of_what_was_tested_is_listed_with_where_it_stands():
    page = verification_page(
        outcome([row(0.01)], remarks=["not tested: bi", f"plan, uni: recalled, {CHECK_STANDARD}: 5"], plan=RECALLED)
    )
    section = page.sections[-1]
    assert f"Not confirmed, {CHECK_STANDARD}: 21 of 21." in section.text
    lines = table(page, section.title)
    assert {line[0] for line in lines} == {"probing", "uni", "uncertainty", "decision"}
    assert ["uni", "error: measured - calibrated length", "recalled", "not confirmed"] in lines
    looked_up = table(verification_page(outcome([row(0.01)])), section.title)
    assert ["uni", "error: measured - calibrated length", "clause 6.2", "confirmed"] in looked_up
    assert {line[3] for line in looked_up} == {"confirmed"}
    decision = page.sections[0].text
    assert "Not tested: bi." in decision
    assert CHECK_STANDARD not in decision


# Words ---------------------------------------------------------------------------------------------------------------


def test_the_decision_names_what_decides():
    good, between, bad = row(0.01), row(0.045, label="E_Uni, 300"), row(0.07, label="E_Uni, 150")
    assert "All tested values conform: 1 value with a limit." in describe_decision(outcome([good]))
    assert "1 value does not conform: E_Uni, 150, position 1, (0.070 ± 0.010)" in describe_decision(
        outcome([good, between, bad])
    )
    text = describe_decision(outcome([good, between]))
    assert "1 value lies in the guard band" in text
    assert ": E_Uni, 300" in text
    assert "smaller uncertainty" in text


def test_the_rule_names_its_edition_and_that_values_are_compared_before_rounding():
    assert "ISO 14253-1:2013" in describe_rule("iso14253-1:2013")
    for edition in ("iso14253-1:2013", "iso14253-1:2017"):
        assert "as recalled, not confirmed" in describe_rule(edition, confirmed=False)
        assert "recalled" not in describe_rule(edition)
        assert (
            describe_rule(edition, confirmed=False)
            in verification_page(outcome([row(0.01)], rule=edition, plan=RECALLED)).sections[0].text
        )
    assert "simple acceptance" in describe_rule("simple")
    for rule in DECISION_RULES:
        assert "compared before rounding" in describe_rule(rule)
        page = verification_page(outcome([row(0.01, rule=rule)], rule=rule))
        assert describe_rule(rule) in page.sections[0].text


@pytest.mark.parametrize(
    ("limit", "text"),
    [(0.05, "0.05"), (0.016875, "0.016875"), ((15 + 150.001 / 80) / 1000, "0.016875"), (0.3, "0.3"), (2.0, "2")],
)
def test_limits_are_printed_in_full_to_the_nanometre(limit, text):
    page = verification_page(outcome([row(0.0, limit), row(10.0, limit)]))
    assert [line[3] for line in table(page, "Values against limits")] == [text, text]
    assert f"limit {text}\u202fmm" in page.sections[0].text


def test_dates_and_temperatures_are_stated():
    text = verification_page(outcome([row(0.01)])).sections[0].text
    assert (
        "10 points of points.csv, measured on 2026-11-03; artefacts at 19 to 20.5\u202f°C (means of the groups of "
        "points)." in text
    )


def test_the_verdict_comes_first_and_values_that_do_not_conform_lead():
    good, between, bad = row(0.01), row(0.045, label="E_Uni, 300"), row(0.07, label="E_Uni, 150")
    for rows, state, sentence in (
        ([good, row(0.02, label="E_Bi, 900")], "good", "Conform: all 2 tested values within the limits."),
        ([good], "good", "Conform: 1 tested value within the limits."),
        ([good, between], "doubtful", "Undecided: 1 of 2 tested values too near to the limit"),
        ([good, between, bad], "bad", "Not conform: 1 of 3 tested values does not conform, 1 is undecided."),
    ):
        page = verification_page(outcome(rows))
        assert page.verdict.state == state
        assert page.verdict.sentence.startswith(sentence)
        assert ("limit 0.05" in page.verdict.detail) == (state != "good")
    assert [line[0] for line in table(page, "Values against limits")] == ["E_Uni, 150", "E_Uni, 300", "E_Uni, 900"]
    assert page.sections[1].tables[0].states == ("bad", "doubtful", "good")
    html = render(page)
    # In words and with a sign, not by colour alone, and before the title.
    assert html.index("Not conform: 1 of 3") < html.index("<h1>")
    assert html.index('aria-label="bad"') < html.index("<h1>")


def test_by_a_plan_that_nobody_confirmed_nothing_conforms_and_nothing_is_green():
    rows = [row(0.01), row(0.07, label="E_Uni, 150")]
    page = verification_page(outcome(rows, plan=RECALLED))
    assert page.title == "arm <7>: not for conformity decisions"
    assert page.verdict.state == "doubtful"
    assert page.verdict.sentence.startswith("Not for conformity decisions: 21 entries are not confirmed against ISO")
    assert page.verdict.sentence.endswith(" 1 of 2 tested values is within the limits.")
    assert [line[4] for line in table(page, "Values against limits")] == ["outside limit", "within limit"]
    assert page.sections[1].tables[0].states == ("bad", "none")
    assert "outside: E_Uni, 150, position 1" in page.sections[0].text
    assert "(listed under 'Where each number stands')" in page.sections[0].text
    assert "uni.positions" not in page.sections[0].text
    figure = limits_figure(rows, rule="iso14253-1:2013", decides=False)
    assert figure.alt.endswith("20\u202f%, within limit; E_Uni, 150, position 1 140\u202f%, outside limit.")


@pytest.mark.parametrize("plan", [None, RECALLED])
def test_simulated_points_are_said_to_be_no_measurement(plan):
    found = outcome([row(0.01)], plan=plan)
    simulated = replace(found, measured=replace(found.measured, origin=CoordinateOrigin("virtual arm")))
    text = verification_page(simulated).sections[0].text
    assert "The points are simulated: no arm was measured." in text
    assert "(listed under" not in text


# Figure --------------------------------------------------------------------------------------------------------------


def ends(position, y, *, length="900", repeat="1"):
    keys = {"length": length, "position": position, "repeat": repeat}
    return [
        PointGroup("bar", {**keys, "end": end}, np.full((1, 3), [x, y, 300.0]), 20.0, 0.0, DAY)
        for end, x in (("A", 0.0), ("B", float(length)))
    ]


def test_each_place_has_the_colour_of_its_value_nearest_to_the_limit():
    tests = {"uni": [*ends("1", -400.0), *ends("1", -402.0, repeat="2"), *ends("2", 400.0)]}
    single = [
        row(value, where=f"position {position}, repeat {repeat}")
        for value, position, repeat in ((0.01, 1, 1), (-0.03, 1, 2), (0.02, 2, 1))
    ]
    cloud = where_scene(tests, [worst_result(single)]).cloud
    assert cloud.points.tolist() == [[450.0, -401.0, 300.0], [450.0, 400.0, 300.0]]  # repeats are at one place
    # Magnitude and expanded uncertainty in the limit of 0.05 mm.
    U = BUDGET.expanded
    np.testing.assert_allclose(cloud.values[0].values, [100 * (0.03 + U) / 0.05, 100 * (0.02 + U) / 0.05], rtol=1e-12)
    assert cloud.values[0].top == 100.0
    notes = {note.name: list(note.values) for note in cloud.notes}
    assert notes == {"value": [-0.03, 0.02], "U": [U, U], "limit": [0.05, 0.05]}
    assert {i: np.ptp(span, axis=0).tolist() for i, span in cloud.spans.items()} == {0: [900, 0, 0], 1: [900, 0, 0]}
    assert cloud.marked == {0: "E_Uni, 900"}  # the worst of all


def test_the_same_position_of_two_lengths_is_two_places():
    tests = {"volumetric": [*ends("1", 0.0), *ends("1", 0.0, length="300")]}
    rows = [row(0.07, label="Volumetric.Max", where="900, position 1"), row(0.01, label="E_Uni, 900")]
    places = measured_places(tests, rows)
    assert [place.decisive is rows[0] for place in places] == [True, False]
    assert [share_of_limit(one) for one in places[0].values] == [pytest.approx((0.07 + BUDGET.expanded) / 0.05)]
    assert where_scene(tests, [rows[1]]).cloud is None  # nothing was tested there, but the lengths are drawn
    assert len(where_scene(tests, [rows[1]]).lines) == 3 + 2


def test_the_places_of_values_that_do_not_conform_are_marked():
    ball = PointGroup("ball", {"position": "1"}, np.full((5, 3), [500.0, 0.0, 100.0]), 20.0, 0.0, DAY)
    tests = {"uni": [*ends("1", -400.0), *ends("2", 400.0)], "probing": [ball]}
    calm = where_figure(measured_places(tests, [row(0.01, where="position 1, repeat 1")]))
    assert not [line for panel in calm.panels for line in panel.axes[0].lines if line.get_color() == BAD]
    figure = where_figure(measured_places(tests, [row(0.01), row(0.07, where="position 2, repeat 1")]))
    above, front = (panel.axes[0] for panel in figure.panels)
    for axes, at in ((above, (450.0, 400.0)), (front, (450.0, 300.0))):
        red = [line for line in axes.lines if line.get_color() == BAD]
        assert [line.get_xydata().mean(axis=0).tolist() for line in red] == [list(at)] * 2  # the length and its cross
        assert [text.get_text() for text in axes.texts] == ["E_Uni, 900"]
        low, high = axes.get_xlim()
        assert low < 0 < 900 < high
        box, (bottom, top) = axes.get_position(), axes.get_ylim()
        width_in, height_in = axes.figure.get_size_inches()
        # Lengths are not distorted: a millimetre is as long across as up.
        assert (high - low) / (box.width * width_in) == pytest.approx((top - bottom) / (box.height * height_in))
    assert "E_Uni, 900, position 2, repeat 1" in figure.caption
    # The same position of another test, or another length, is another place.
    for label in ("E_Bi, 900", "E_Uni, 300"):
        assert all(place.decisive is None for place in measured_places(tests, [row(0.07, label=label)]))


def test_names_of_places_do_not_overlap():
    """Five lengths about one middle, as a bar has them; measured by the extents of the drawn names."""
    tests = {"uni": [group for name in "12345" for group in ends(name, 3.0 * float(name))]}
    decisive = [row(0.07, label="E_Uni, 900", where=f"position {name}, repeat 1") for name in "12345"]
    for panel in where_figure(measured_places(tests, decisive)).panels:
        (axes,) = panel.axes
        assert len(axes.texts) == 5
        panel.draw_without_rendering()
        boxes = [Text.get_window_extent(text) for text in axes.texts]  # without the line to the place
        assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_guard_bands_are_those_of_the_rule():
    rows = [row(0.01), row(0.045), row(-0.09)]
    (drawing,) = limits_figure(rows, rule="iso14253-1:2013").panels
    (axes,) = drawing.axes
    bands = [patch for patch in axes.patches if patch.get_hatch() and patch.get_width()]
    assert len(bands) == 6
    half = BUDGET.expanded / 0.05
    assert sorted({round(patch.get_x(), 9) for patch in bands}) == pytest.approx([-1 - half, 1 - half])
    assert bands[0].get_width() == pytest.approx(2 * half)
    low, high = axes.get_xlim()
    assert low < -0.09 / 0.05 - half  # also what is far outside is on the paper
    assert high > 1
    # The edition of 2017: t of 30 degrees of freedom for 95 % is 1.697 (tables).
    narrow = limits_figure(rows, rule="iso14253-1:2017").panels[0].axes[0].patches
    widths = [patch.get_width() * 0.05 / BUDGET.u for patch in narrow if patch.get_hatch() and patch.get_width()]
    assert widths == pytest.approx(6 * [2 * 1.697], abs=0.001)
    simple = limits_figure([row(0.01, rule="simple")], rule="simple")
    assert not [patch for patch in simple.panels[0].axes[0].patches if patch.get_hatch()]
    assert "guard" not in simple.caption.lower()
    # Where the uncertainty is too large for simple acceptance it counts whole.
    large = limits_figure([row(0.01, 0.04, rule="simple")], rule="simple")
    assert len([patch for patch in large.panels[0].axes[0].patches if patch.get_hatch() and patch.get_width()]) == 2
    assert "guard" in large.caption


@pytest.mark.parametrize("n", [1, 200])
def test_the_figure_takes_any_number_of_values(n):
    figure = limits_figure([row(0.01, label=f"E_Uni, {i}") for i in range(n)], rule="iso14253-1:2013")
    assert len(figure.panels[0].axes[0].get_yticks()) == min(n, 60)
    assert ("shows the first 60" in figure.caption) == (n > 60)


def test_the_page_is_whole_html_and_names_are_text():
    rows = [row(0.01, label="E_Uni, <script>", where="position & co"), row(0.2, budget=Budget())]
    html = render(verification_page(outcome(rows), facts=[("versions", "1")]))
    outline = Outline(html.removeprefix("<!DOCTYPE html>"))
    assert outline.tags.count("figure") == 2
    assert outline.tags.count("script") == 2  # the view's numbers and its script; a name becomes none
    assert "arm &lt;7&gt;: not conform" in html
    assert html == render(verification_page(outcome(rows), facts=[("versions", "1")]))
