"""Cards: every line is in its frame and to scale, titles are text, and no card is broken between sheets."""

import re

import numpy as np
import pytest

from browser import printed
from html_outline import HOSTILE, Outline
from refusals import refuses
from truearm.pages.cards import Card, CardSet
from truearm.pages.html import render
from truearm.pages.page import Page, Section

VIEWS = ("from the side", "from above")


def made_up_cards(n=20, title="Step", seed=3):
    random = np.random.default_rng(seed)
    lines = random.uniform(-900, 900, (n, 2, 6, 2))
    values = [(f"V{k}", "-123 mm") for k in range(7)]
    return CardSet(
        "Cards",
        "A caption.",
        VIEWS,
        [Card(f"{title} {i}", "here", f"end of {i}", values, two) for i, two in enumerate(lines)],
    )


def numbers(drawing, element):
    return [
        np.array(re.findall(r"-?\d+", points), dtype=int).reshape(-1, 2)
        for points in re.findall(rf'<{element} points="([^"]*)"', drawing)
    ]


def test_a_drawing_is_small_in_its_frame_and_to_one_scale():
    cards = made_up_cards()
    for card, drawing in zip(cards.cards, cards.drawings(), strict=True):
        assert len(drawing) < 700
        drawn = numbers(drawing, "polyline")
        together = np.vstack(drawn)
        assert (together >= 0).all()
        assert (together <= (320, 150)).all()
        # The last two are this card's own: their spans, up to the rounding to whole pixels, have one scale.
        spans = np.array([np.ptp(line, axis=0) for line in drawn[-2:]])
        true = np.array([np.ptp(line, axis=0) for line in card.lines])
        scale = spans.sum() / true.sum()
        assert spans == pytest.approx(true * scale, abs=2.0)


def test_a_card_shows_the_line_before_and_the_first_has_none():
    first, second, *_ = made_up_cards().drawings()
    assert '<g class="before"></g>' in first
    assert [len(numbers(one, "polyline")) for one in (first, second)] == [2, 4]


def test_names_on_cards_are_text():
    html = render(Page("a page", sections=(Section("x", cards=made_up_cards(2, title=HOSTILE)),)))
    assert Outline(html.removeprefix("<!DOCTYPE html>")).tags.count("li") == 2
    assert HOSTILE not in html


def test_no_card_is_broken_between_sheets(chromium, tmp_path):
    sheets = printed(chromium, Page("cards", sections=(Section("One by one", cards=made_up_cards()),)), tmp_path)
    cards = [set(re.findall(r"Step (\d+)\b", sheet)) for sheet in sheets]
    assert [len(one) for one in cards] == [0, 8, 8, 4]
    assert cards == [set(re.findall(r"end of (\d+)\b", sheet)) for sheet in sheets]


@pytest.mark.parametrize(
    ("lines", "problem"), [(np.full((2, 4, 2), np.nan), "line of the card"), (np.zeros((2, 4, 3)), "line of the card")]
)
def test_lines_that_cannot_be_drawn_are_refused(lines, problem):
    refuses(problem, CardSet("Cards", "", VIEWS, [Card("Step 1", "", "", [], lines)]).drawings)


def test_a_line_of_one_point_is_drawn():
    assert "<circle" in CardSet("Cards", "", VIEWS, [Card("Step 1", "", "", [], np.zeros((2, 1, 2)))]).drawings()[0]
