"""Interactive scenes in a real browser: turned, pointed at, selected, typed into, printed, read by a screen reader."""

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from test_scene import made_up_cloud, scene_page, two_pivots

from browser import Tab, printed
from truearm.pages.html import write_page
from truearm.pages.scene import PointCloud, PointColumn


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    pages = {
        "cloud": scene_page(cloud=made_up_cloud(400)),
        "mechanism": scene_page(mechanism=two_pivots()),
        "both": scene_page(cloud=made_up_cloud(40), mechanism=two_pivots(controls=False, follows=[0, 1])),
    }
    for name, page in pages.items():
        write_page(page, folder / f"{name}.html")
    return {name: folder / f"{name}.html" for name in pages}


@pytest.fixture
def cloud(chromium, paths):
    with Tab(chromium, paths["cloud"]) as tab:
        yield tab
        assert tab.complaints == []


@pytest.fixture
def mechanism(chromium, paths):
    with Tab(chromium, paths["mechanism"]) as tab:
        yield tab
        assert tab.complaints == []


def test_dragging_turns_and_the_keys_turn_zoom_and_reset(cloud):
    first = cloud.picture()
    box = cloud.page.locator(".space").bounding_box()
    cloud.page.mouse.move(box["x"] + 300, box["y"] + 200)
    cloud.page.mouse.down()
    cloud.page.mouse.move(box["x"] + 380, box["y"] + 220)
    cloud.page.mouse.up()
    cloud.page.keyboard.press("Escape")
    seen = [first, cloud.picture()]
    for key in ("ArrowLeft", "ArrowUp", "Shift+ArrowRight", "+"):
        cloud.page.locator(".space").press(key)
        seen.append(cloud.picture())
    assert len(set(seen)) == len(seen)
    cloud.page.locator(".space").press("0")
    assert cloud.picture() == first
    for view in ("front", "side", "top"):
        cloud.page.get_by_role("button", name=view).click()
        seen.append(cloud.picture())
    assert len(set(seen)) == len(seen)


def test_the_wheel_scrolls_the_page_until_the_view_has_the_focus(cloud):
    first = cloud.picture()
    cloud.page.locator(".space").hover()
    cloud.page.mouse.wheel(0, 20)
    cloud.page.mouse.move(1, 1)
    assert cloud.picture() == first
    cloud.page.locator(".space").focus()
    cloud.page.locator(".space").hover()
    cloud.page.mouse.wheel(0, 200)
    cloud.page.mouse.move(1, 1)
    assert cloud.picture() != first


def test_a_point_says_what_is_known_of_it(cloud):
    largest = int(np.argmax(made_up_cloud(400).values[0].values))
    cloud.page.locator(".space").press("n")
    told = cloud.page.locator(".readout").inner_text().splitlines()
    assert told[0] == f"line {largest + 2}"
    assert re.fullmatch(r"error 0\.1\d\d mm", told[1])
    assert told[2] == "u 0.0200 mm"
    cloud.page.locator(".space").press("n")
    assert cloud.page.locator(".readout").inner_text().splitlines()[0] != told[0]
    cloud.page.locator(".space").press("p")
    assert cloud.page.locator(".readout").inner_text().splitlines()[0] == told[0]
    # The mouse finds the same point where the keys have marked it.
    place = cloud.page.locator(".space").bounding_box()
    found = set()
    for x in range(0, int(place["width"]), 25):
        cloud.page.mouse.move(place["x"] + x, place["y"] + place["height"] / 2)
        if cloud.page.locator(".readout").is_visible():
            found.add(cloud.page.locator(".readout").inner_text().splitlines()[0])
    assert len(found) > 3


def test_a_button_goes_near_points_that_are_close_together_and_another_back(chromium, paths, tmp_path):
    cloud = made_up_cloud(40)
    write_page(
        scene_page(cloud=replace(cloud, points=0.02 * cloud.points), mechanism=two_pivots()), tmp_path / "p.html"
    )
    with Tab(chromium, paths["both"]) as tab:
        assert tab.page.get_by_role("button", name="points").count() == 0  # they fill the view
    with Tab(chromium, tmp_path / "p.html") as tab:
        first = tab.picture()
        tab.page.get_by_role("button", name="points").click()
        assert tab.picture() != first
        tab.page.get_by_role("button", name="reset").click()
        assert tab.picture() == first
        assert tab.complaints == []


def test_a_point_with_two_ends_is_found_along_its_line_and_a_mark_is_written(chromium, tmp_path):
    def cloud(**more):
        column = PointColumn("error", "mm", [0.01, 0.02])
        return scene_page(cloud=PointCloud([[0, 0, 0], [0, 400, 0]], ["bar", "ball"], [column], **more))

    pictures = []
    for name, more in {
        "plain": {},
        "span": {"spans": {0: [[-300, 0, 0], [300, 0, 0]]}, "marked": {1: "worst"}},
    }.items():
        write_page(cloud(**more), tmp_path / f"{name}.html")
        with Tab(chromium, tmp_path / f"{name}.html") as tab:
            tab.page.get_by_role("button", name="top").click()
            pictures.append(tab.picture())
            place, found = tab.page.locator(".space").bounding_box(), []
            for x in (0.3, 0.7):  # of the width, beside the middle of the bar
                for y in range(0, int(place["height"]), 12):
                    tab.page.mouse.move(place["x"] + x * place["width"], place["y"] + y)
                    if tab.page.locator(".readout").is_visible():
                        found.append(tab.page.locator(".readout").inner_text().splitlines()[0])
            assert (found.count("bar") >= 2) == bool(more)
            assert tab.complaints == []
    assert pictures[0] != pictures[1]


def test_a_range_in_a_plot_selects_points_in_space(cloud):
    first = cloud.picture()
    assert cloud.page.locator(".selected").inner_text().startswith("All 400 readings: error, mean 0.0")
    plot = cloud.page.locator(".range-plot canvas").nth(1)
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    cloud.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
    cloud.page.mouse.down()
    cloud.page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 20)
    cloud.page.mouse.up()
    assert cloud.picture() != first
    told = cloud.page.locator(".selected").inner_text()
    count, low, high = re.match(r"(\d+) of 400 readings selected.*A1 (\S+) to (\S+) deg", told).groups()
    angle = made_up_cloud(400).axes[0].values
    low, high = (float(text.replace("\u2212", "-")) for text in (low, high))
    assert abs(int(count) - np.count_nonzero((angle >= low) & (angle <= high))) <= 3  # the ends are told to 3 digits
    cloud.page.get_by_role("button", name="select all").click()
    assert cloud.picture() == first
    plot.press("ArrowRight")
    assert cloud.picture() != first
    assert "selected" in cloud.page.locator(".selected").inner_text()
    plot.press("Escape")
    assert cloud.picture() == first
    ends = cloud.page.locator(".range-plot canvas").first
    for _ in range(9):
        ends.press("Shift+ArrowRight")
    cloud.picture()
    assert re.search(r"error 0\.\d+ mm or more\.", cloud.page.locator(".selected").inner_text())


def test_a_reader_chooses_the_value_that_colours(cloud):
    first = cloud.picture(".range-plot canvas")
    cloud.page.get_by_label("colour:").select_option("before")
    assert cloud.picture(".range-plot canvas") != first
    assert "All 400 readings: before, mean 0." in cloud.page.locator(".selected").inner_text()


def test_sliders_and_fields_move_the_end(mechanism):
    end = mechanism.page.locator(".end tr").first
    assert [text.split("\n")[-1] for text in end.locator("td").all_inner_texts()] == ["150.000", "0.000", "0.000"]
    first = mechanism.picture()
    mechanism.page.get_by_label("A1 [deg]").fill("90")
    assert [text.split("\n")[-1] for text in end.locator("td").all_inner_texts()] == ["0.000", "150.000", "0.000"]
    assert mechanism.picture() != first
    mechanism.page.get_by_label("A2, slider [mm]").press("ArrowRight")
    assert end.locator("td").nth(2).inner_text().split("\n")[-1] != "0.000"
    line = mechanism.page.get_by_label("all 2, as one line")
    line.fill("-90; 5,5")
    assert [text.split("\n")[-1] for text in end.locator("td").all_inner_texts()] == ["0.000", "\u2212150.000", "5.500"]
    assert mechanism.page.get_by_label("A1 [deg]").input_value() == "-90"
    line.fill("1 2 3")
    assert "expected 2 numbers" in mechanism.page.locator(".note").inner_text()
    mechanism.page.get_by_label("A1 [deg]").fill("100")
    assert mechanism.page.get_by_label("A1 [deg]").get_attribute("aria-invalid") == "true"


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        ("10 2O", '"2O" is none'),
        ("1,234.5 0", '"1,234.5" is none'),
        ("10 0x10", '"0x10" is none'),
        ("10", "got 1"),
        ("1 2 3", "got 3"),
    ],
)
def test_an_entry_that_is_no_number_is_said_and_moves_nothing(mechanism, typed, says):
    first, line = mechanism.picture(), mechanism.page.get_by_label("all 2, as one line")
    line.fill(typed)
    assert mechanism.page.locator(".note").inner_text().startswith("expected 2 numbers, separated by spaces")
    assert says in mechanism.page.locator(".note").inner_text()
    assert line.get_attribute("aria-invalid") == "true"
    assert mechanism.picture() == first
    line.fill("\u22121,5e1, +5.")
    assert mechanism.page.locator(".note").inner_text() == ""
    assert line.get_attribute("aria-invalid") == "false"
    assert mechanism.page.get_by_label("A1 [deg]").input_value() == "-15"
    mechanism.page.get_by_label("A1 [deg]").fill("")
    assert mechanism.page.locator(".note").inner_text() == "A1: expected a number"


@pytest.mark.parametrize("width", [420, 900, 980, 1400])
def test_long_coordinates_stand_apart(chromium, paths, width):
    with Tab(chromium, paths["mechanism"], width=width) as tab:
        tab.page.get_by_label("all 2, as one line").fill("-135 -1234.5")
        sizes = "(cells) => cells.map((one) => [one.scrollWidth, one.clientWidth])"
        assert all(needed <= has for needed, has in tab.page.locator(".end td").evaluate_all(sizes))
        lines = "(heads) => heads.map((one) => one.clientHeight / parseFloat(getComputedStyle(one).lineHeight))"
        assert max(tab.page.locator(".end th").evaluate_all(lines)) < 2


def test_the_mechanism_goes_to_the_point_that_is_pointed_at(chromium, paths):
    with Tab(chromium, paths["both"]) as tab:
        first = tab.picture()
        tab.page.locator(".space").press("n")
        assert tab.picture() != first
        assert tab.complaints == []


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [("both", 420, "light"), ("mechanism", 420, "dark"), ("mechanism", 1400, "light"), ("both", 1400, "dark")],
)
def test_the_page_fits_its_width_and_has_no_serious_fault(chromium, paths, name, width, scheme):
    with Tab(chromium, paths[name], width=width, scheme=scheme) as tab:
        tab.picture()
        assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
        assert tab.faults() == []
        assert tab.complaints == []


def test_dark_screens_have_another_picture(chromium, paths, tmp_path):
    lightness = {}
    for scheme in ("light", "dark"):
        with Tab(chromium, paths["cloud"], scheme=scheme) as tab:
            tab.picture()
            tab.page.locator(".space").screenshot(path=tmp_path / "shot.png")
            lightness[scheme] = imread(tmp_path / "shot.png")[..., :3].mean()
    assert lightness["light"] > 0.8 > 0.25 > lightness["dark"]


def test_without_scripts_the_still_figure_stands(chromium, paths):
    with Tab(chromium, paths["cloud"], scripts=False) as tab:
        assert tab.page.locator(".still").is_visible()
        assert tab.page.locator("canvas").count() == 0


def test_on_paper_the_still_figure_stands(chromium, paths, tmp_path):
    with Tab(chromium, paths["cloud"]) as tab:
        assert not tab.page.locator(".still").is_visible()
        tab.page.emulate_media(media="print")
        assert tab.page.locator(".still").is_visible()
        assert not tab.page.locator(".stage").is_visible()
    sheets = printed(chromium, scene_page(cloud=made_up_cloud()), tmp_path)
    assert len(sheets) <= 2
    assert "Drag to turn" not in "".join(sheets)
    assert "x [mm]" in "".join(sheets)
