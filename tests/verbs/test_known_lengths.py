"""A known length counts: a model that measures lengths worse than the drawing is not called better than it."""

import pytest

import truearm as ta
from truearm.readings import LengthSummary, Session


@pytest.fixture(scope="module")
def seated():
    """Readings in the seats of a bar of 500 mm and beside it, and its certified length."""
    made = ta.simulate(
        "measuring7", poses=30, seed=1, preset="shop", strategy="seat", reference=False, seats=3, bars=1, bar_mm=500
    )
    return made.session, made.lengths


def test_a_fit_says_how_well_it_measures_them(seated):
    held, lengths = seated
    result = ta.fit("measuring7", held, lengths=lengths, model="kinematic")
    assert "smaller than the nominal arm; largest error of 1 length 0.00" in result.summary()
    assert not result.to_dict()["training"]["lengths"]["is_worse"]


def test_an_arm_of_a_wrong_size_is_not_praised(seated):
    """Learned from points times 1.01, which somebody accepted; seats agree in an arm of any size.

    The nominal arm has the tip of these points, which is 1 % too long too.
    """
    held, lengths = seated
    seen = ta.simulate("measuring7", poses=60, seed=2, preset="shop").session
    larger = ta.fit(
        "measuring7", Session(seen.angles, 1.01 * seen.points), model="kinematic", accept="the tracker is right"
    )
    said = ta.evaluate(larger.model, held, lengths=lengths).summary()
    assert said.startswith("Largest error of 1 length 5.0 mm, worse than the nominal arm (1.0 mm)")
    assert "smaller than" not in said
    report = ta.report(larger.model, held, lengths=lengths)
    assert next(iter(report.blocks())).startswith("1 model compared on 30 readings: lengths are off by up to ")
    assert report.page().verdict.state == "bad"


def test_lengths_are_worse_beyond_their_expanded_uncertainty():
    """Root mean squares of 3 and 1 um, by hand: worse by 2 um, which is the expanded uncertainty of 1 um."""
    for u_mm, is_worse in ((0.0011, False), (0.0009, True)):
        found = LengthSummary.of([0.003, -0.003], [0.001, 0.001], [u_mm, u_mm])
        assert (found.n, found.largest_mm, found.nominal_mm, found.is_worse) == (2, 0.003, 0.001, is_worse)
    assert not LengthSummary.of([1.0], None, [0.0]).is_worse
    assert LengthSummary.of([0.001], [0.0], [0.0]).is_worse
