"""The operator's sheet: every point of the plan is in its steps, every place in its pictures, every word escaped."""

import re

import numpy as np
import pytest

from browser import printed
from truearm.pages.html import render
from truearm.wings.laboratory.pages.operator_sheet import OperatorSheet, describe_direction, operator_sheet_page
from truearm.wings.laboratory.standards.artefacts import Artefacts, example_artefacts
from truearm.wings.laboratory.standards.layout import lay_out_tests
from truearm.wings.laboratory.standards.verification_plan import PLANS, VerificationPlan, load_verification_plan

RANGE = 2000.0


def sheet_of(plan, artefacts=None):
    artefacts = artefacts or example_artefacts(RANGE)
    layout = lay_out_tests(plan, artefacts, RANGE)
    return OperatorSheet(plan, layout, artefacts, measuring_range_mm=RANGE, shoulder_mm=250.0)


def section(page, title):
    return next(one for one in page.sections if one.title == title)


@pytest.mark.parametrize("name", PLANS)
def test_every_point_is_in_a_step_and_named_as_the_file_has_it(name):
    sheet = sheet_of(load_verification_plan(name))
    steps = section(operator_sheet_page(sheet), "Step by step").tables[0].rows
    assert [row[0] for row in steps] == list(range(1, len(steps) + 1))
    assert sum(row[4] for row in steps) == sum(len(one.points) for one in sheet.layout)
    in_file = " ".join(f"{row[3]};" for row in steps)
    for one in sheet.layout:
        assert f"test {one.test};" in in_file
        for key, value in one.keys.items():
            if key not in ("length", "end", "repeat"):
                assert f"{key} {value};" in in_file
            elif key != "repeat" or one.test == "effective_diameter":
                assert value in in_file
    said = " ".join(f"{row[1]}: {row[2]}" for row in steps)
    assert ("3 times" in said) == (name == "iso10360-12")
    words = {"iso10360-12": "unidirectional length measurement error", "asme-b89.4.22": "volumetric performance test"}
    assert words[name] in said


def test_the_page_has_positions_figures_and_unconfirmed_numbers():
    page = operator_sheet_page(sheet_of(load_verification_plan("iso10360-12")))
    html = render(page)
    assert html == render(page)
    for phrase in ("bar\u00a07", "sphere\u00a02", "check against your copy of the standard", "positions = 7"):
        assert phrase in html
    assert 'class="to-fill"' in html
    bars = section(page, "Positions of the bar")
    assert len(bars.figures[0].panels) == 7
    for row in bars.tables[0].rows:
        start, end = np.array(row[1:4]), np.array(row[4:7])
        assert np.linalg.norm(end - start) == pytest.approx(1360, abs=20)  # told to a centimetre
        assert np.degrees(np.arcsin(abs(end - start)[2] / 1360)) == pytest.approx(row[7], abs=1.5)
    assert "below the base" in section(page, "Positions").text
    seats = operator_sheet_page(sheet_of(load_verification_plan("asme-b89.4.22")))
    assert [row[0] for row in section(seats, "Positions").tables[0].rows][1:] == [
        "seat\u00a01",
        "seat\u00a02",
        "seat\u00a03",
    ]
    assert "In groups" not in section(seats, "Directions of the stylus").text


@pytest.mark.parametrize("keep", ["probing", "articulation", "uni", "single_point"])
def test_a_plan_of_one_test_has_no_empty_chapters(keep):
    whole = {**load_verification_plan("iso10360-12").tests, **load_verification_plan("asme-b89.4.22").tests}
    plan = VerificationPlan(name="mine", title="mine", standard="mine", **{keep: whole[keep]})
    page = operator_sheet_page(sheet_of(plan))
    assert ("Positions of the bar" in [one.title for one in page.sections]) == (keep == "uni")
    assert ("Directions of the stylus" in [one.title for one in page.sections]) == (keep in ("probing", "articulation"))
    assert "<svg" in render(page)


def test_the_sheet_describes_how_to_touch_seats_and_balls():
    page = operator_sheet_page(sheet_of(load_verification_plan("iso10360-12")))
    assert "five points all over the half of a sphere" in section(page, "Positions of the bar").text
    written = section(page, "Records").text
    assert "tip_diameter_mm" in written
    assert "switch that off for seats" in written
    seats = operator_sheet_page(sheet_of(load_verification_plan("asme-b89.4.22")))
    assert any(row[2] == "Seat 1, posture after posture" for row in section(seats, "Step by step").tables[0].rows)


def test_names_are_text():
    whole = example_artefacts(RANGE)
    ball = whole.spheres[0].model_copy(update={"name": "<b>ball</b>", "certificate": "K & Co <script>"})
    html = render(
        operator_sheet_page(
            sheet_of(load_verification_plan("iso10360-12"), Artefacts(spheres=(ball,), bars=whole.bars))
        )
    )
    assert "<script" not in html
    assert "<b>ball" not in html
    assert "&lt;b&gt;ball&lt;/b&gt;" in html


def test_directions_are_told_as_seen_from_the_arm():
    def leaning(azimuth_deg, off_deg):
        turn, off = np.radians([azimuth_deg, off_deg])
        return np.array([np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn), np.cos(off)])

    for ball in (-30.0, 0.0, 170.0):
        at = np.radians(ball)
        assert describe_direction(leaning(ball, 0), at) == "from above"
        assert describe_direction(leaning(ball, 40), at) == "from beyond, 40\u00a0deg off the vertical"
        assert describe_direction(leaning(ball + 90, 60), at) == "from the left, 60\u00a0deg off the vertical"
        assert describe_direction(leaning(ball + 180, 60), at) == "from the arm's side, 60\u00a0deg off the vertical"
        assert describe_direction(leaning(ball - 90, 60), at) == "from the right, 60\u00a0deg off the vertical"
        assert re.match("from beyond and the right", describe_direction(leaning(ball - 45, 30), at))


def test_it_prints_completely(chromium, tmp_path):
    """A4: heads of the step table on each of its sheets, no step lost, no caption parted from its picture."""
    sheet = sheet_of(load_verification_plan("iso10360-12"))
    sheets = printed(chromium, operator_sheet_page(sheet), tmp_path)
    assert 6 <= len(sheets) <= 9
    steps = [one for one in sheets if re.search(r"test (?:probing|articulation|uni)", one)]
    assert all("action" in one for one in steps)
    found = [
        int(number) for one in steps for number in re.findall(r"(?m)^ *(\d+) +(?:[a-z ]+ {2,})?(?:Sphere|Bar)", one)
    ]
    assert found == list(range(1, 20))
    (bars,) = [one for one in sheets if "Positions of the bar" in one]
    assert "the cross is the arm's base" in " ".join(bars.split())
