"""The overview of a fleet: worst first, and a table that shows what a reader asks for."""

import pytest

from browser import LOOKS, Tab, check_page
from truearm.pages.html import render, write_page
from truearm.wings.fleet.fleet_page import ArmState, fleet_page

ARMS = [
    ArmState("A-0", "ur10", "Turin", "failed", message="the file <b> does not exist"),
    *(
        ArmState(f"B-{i}", "ur5", "Oslo" if i % 2 else "Turin", "in force", held_out_mm=0.05, of_type=1.0)
        for i in range(310)
    ),
]


def test_the_worst_state_is_the_verdict():
    assert fleet_page(ARMS, summary="311 arms.").verdict.state == "bad"
    assert fleet_page(ARMS[1:], summary="310 arms.").verdict.state == "good"
    ranked = sorted([*ARMS[1:], ARMS[0]], key=lambda one: one.rank)
    assert [one.serial_number for one in ranked[:3]] == ["A-0", "B-0", "B-1"]


def test_a_page_without_such_a_table_has_no_script():
    assert "<script" in render(fleet_page(ARMS, summary="311 arms."))
    assert "<script" not in render(fleet_page([], summary="0 arms.").__class__("Empty"))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    found = tmp_path_factory.mktemp("fleet") / "overview.html"
    write_page(fleet_page(ARMS, summary="311 arms."), found)
    return found


@pytest.mark.parametrize("looks", LOOKS)
def test_it_keeps_what_all_pages_promise(chromium, path, looks):
    check_page(chromium, path, looks)


def test_rows_with_the_words_are_shown_the_first_of_them(chromium, path):
    with Tab(chromium, path) as tab:
        shown = tab.page.locator("tbody tr:visible")
        assert tab.page.locator("output").inner_text() == "311 of 311 rows, the first 300 are shown"
        assert shown.count() == 300
        tab.page.locator("input[type=search]").fill("OSLO ur5")
        assert tab.page.locator("output").inner_text() == "155 of 311 rows"
        assert shown.count() == 155
        tab.page.locator("input[type=search]").fill("exist")
        assert shown.locator("th").all_inner_texts()[0].split("\n") == ["A-0", "the file <b> does not exist"]
        assert shown.count() == 1
        assert tab.complaints == []


def test_the_reason_of_a_failure_is_on_a_narrow_screen(chromium, path):
    with Tab(chromium, path, width=420) as tab:
        box = tab.page.locator("small", has_text="does not exist").bounding_box()
        assert box["x"] + box["width"] <= 420


def test_without_scripts_every_row_is_shown(chromium, path):
    with Tab(chromium, path, scripts=False) as tab:
        assert tab.page.locator("tbody tr:visible").count() == 311
        assert not tab.page.locator(".filter").is_visible()
