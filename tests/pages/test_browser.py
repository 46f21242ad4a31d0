"""The page in a real browser, without a network: it shows its figures and complains of nothing."""

import numpy as np
import pytest

from browser import Tab
from html_outline import Outline
from truearm.pages.html import write_page
from truearm.pages.page import LabelledValue, Page, PageVerdict


@pytest.fixture(scope="module")
def path(html, tmp_path_factory):
    path = tmp_path_factory.mktemp("browser") / "page.html"
    path.write_text(html, encoding="utf-8")
    return path


@pytest.mark.parametrize("width", [pytest.param(500, marks=pytest.mark.weekly), 1400])
def test_a_browser_shows_the_page_without_a_complaint(chromium, path, width):
    with Tab(chromium, path, width=width) as tab:
        tab.page.set_viewport_size({"width": width, "height": 6000})
        outline, shot = Outline(tab.page.content().removeprefix("<!DOCTYPE html>")), tab.pixels()
        # What a page may not load, cannot load or cannot parse is told on the console.
        assert tab.complaints == []
    assert outline.tags.count("figure") == len(outline.labels) == 8
    assert shot.shape[1] == width
    drawn = shot.min(axis=-1) < 0.9
    # Something on every stretch of 500 pixels of the first 4000, and white prevails.
    assert drawn[:4000].reshape(8, -1).mean(axis=1).min() > 0.005
    assert 0.01 < drawn.mean() < 0.3
    coloured = np.ptp(shot, axis=-1) > 0.3
    assert coloured.mean() > 0.001


def test_a_dark_screen_shows_the_page_dark_with_light_marks_and_a_light_one_light(chromium, tmp_path):
    page = Page(
        "A title", verdict=PageVerdict("Not conform.", "bad"), summary=(LabelledValue("mean error", 0.01234, "mm"),)
    )
    write_page(page, tmp_path / "page.html")
    for dark in (False, True):
        with Tab(chromium, tmp_path / "page.html", width=900, scheme="dark" if dark else "light") as tab:
            shown = tab.pixels()
        paper = float(shown[-1, 0].mean())
        assert (paper < 0.15) if dark else (paper > 0.95)
        ink = shown.max() if dark else shown.min()
        assert abs(ink - paper) > 0.7
        red, green, blue = shown[..., 0], shown[..., 1], shown[..., 2]
        assert np.mean((red - green > 0.2) & (red - blue > 0.2)) > 0.001  # the sign and the edge of the verdict
