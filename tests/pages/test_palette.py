"""The palette: contrast in both schemes, bitmaps in the colours of lines, and no other colour in a figure."""

import re

import numpy as np
import pytest

from truearm.pages.drawings.workspace_figures import error_in_workspace, workspace
from truearm.pages.html import render
from truearm.pages.page import Page
from truearm.pages.palette import PALETTE, channels, filtered, style_rules, with_variables
from truearm.pages.plotting import svg_element

COLOURS = {colour.name: colour for colour in PALETTE}
SCHEMES = ("light", "dark")
TEXT = ("ink", "soft", "good", "doubtful", "bad", "navy")  # navy is the colour of links
LINES = ("limit", "orange", "navy", "purple", "teal", "grey", "olive", "good", "doubtful", "bad")


def of(name, scheme):
    return getattr(COLOURS[name], scheme)


def contrast(one, other):
    """Contrast ratio of two colours, 1 to 21 (WCAG 2.2, relative luminance)."""
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


def luminance(colour):
    shares = np.array(channels(colour)) / 255
    return np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722)


def test_contrast_is_that_of_wcag():
    # Published pairs: black on white is 21; #767676 is the lightest grey that passes 4.5 on white, #949494 3.
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#ffffff", "#767676") == pytest.approx(4.54, abs=0.005)
    assert contrast("#777777", "#ffffff") < 4.5
    assert contrast("#949494", "#ffffff") == pytest.approx(3.03, abs=0.005)
    assert contrast("#123456", "#123456") == 1


@pytest.mark.parametrize("scheme", SCHEMES)
def test_text_can_be_read_on_every_ground(scheme):
    # WCAG 2.2, 1.4.3: 4.5 to 1.
    for ground in ("paper", "wash", "good-wash", "doubtful-wash", "bad-wash"):
        for name in TEXT:
            own = f"{name}-wash"
            if name not in ("good", "doubtful", "bad") or ground in ("paper", "wash", own):
                assert contrast(of(name, scheme), of(ground, scheme)) >= 4.5, (scheme, name, ground)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_lines_and_marks_can_be_seen(scheme):
    # WCAG 2.2, 1.4.11: 3 to 1 for what a reader must see. Grids and areas behind data are decoration.
    for name in LINES:
        assert contrast(of(name, scheme), of("paper", scheme)) >= 3, (scheme, name)
    assert contrast(of("paper", scheme), of("good", scheme)) >= 3  # the tick in its circle


def test_bitmaps_have_the_colours_of_the_lines_beside_them_on_dark_screens():
    # White and black change places, a grey becomes its negative [definition of the filters].
    assert filtered("#ffffff") == "#000000"
    assert filtered("#000000") == "#ffffff"
    assert filtered("#404040") == "#bfbfbf"
    for name in ("orange", "navy", "purple", "teal", "grey", "olive"):
        assert COLOURS[name].dark == filtered(COLOURS[name].light)
    assert ".panel image { filter: invert(1) hue-rotate(180deg); }" in render(Page("a page"))


def test_dark_is_for_screens_only_and_every_colour_has_a_name_of_its_own():
    rules = style_rules()
    light, dark = rules.split("@media screen and (prefers-color-scheme:dark)")
    assert "screen" not in light
    for colour in PALETTE:
        assert f"--{colour.name}:{colour.light};" in light
        assert f"--{colour.name}:{colour.dark};" in dark
    assert len({colour.light for colour in PALETTE}) == len({colour.name for colour in PALETTE}) == len(PALETTE)
    assert '<meta name="color-scheme" content="light dark">' in render(Page("a page"))


def test_a_colour_of_the_palette_is_a_variable_and_another_stays():
    assert with_variables("fill: #12407a; stroke: #ffffff") == "fill: var(--navy,#12407a); stroke: var(--paper,#ffffff)"
    assert with_variables("fill: #010203") == "fill: #010203"


def colours_left(html):
    """Colours in the figures of a page that no variable replaces."""
    figures = re.findall(r'<div class="panels[^"]*"|<svg viewBox.*?</svg>', html, flags=re.DOTALL)
    found, light = set(), False
    for part in figures:
        if part.startswith("<div"):
            light = "light-paper" in part
        elif not light:
            styles = " ".join(re.findall(r'(?:style|fill|stroke)="([^"]*)"', part))
            found |= set(re.findall(r"(?<!,)#[0-9a-f]{6}\b(?!\))", styles))
    return found


def test_figures_have_no_colour_that_dark_screens_cannot_change(html):
    assert colours_left(html) == set()


def test_colours_that_mean_numbers_stay_on_light_paper():
    points = np.random.default_rng(1).normal(0, 100, (30, 3))
    assert error_in_workspace(points, np.linspace(0, 1, 30)).light_paper
    assert not workspace(points).light_paper
    assert re.search(r"#[0-9a-f]{6}", svg_element(error_in_workspace(points, np.linspace(0, 1, 30)).panels[1], "a-"))
