"""Growth of the residual variance outside the trained range."""

import numpy as np
import pytest

from refusals import refuses
from truearm.identification.estimation.extrapolation import STEEPEST_GROWTH, Extrapolation
from truearm.identification.estimation.residual_variance import VarianceFunction

RANGES = np.array([[-1.0, 1.0], [0.0, 0.5], [100.0, 300.0]])
SLIDES = np.array([False, False, True])
FUNCTION = Extrapolation(RANGES, SLIDES, 2.0)


@pytest.mark.parametrize(
    ("angles", "distance"),
    [
        ([0.0, 0.25, 200.0], 0.0),
        ([1.0, 0.5, 300.0], 0.0),
        ([1.3, 0.25, 200.0], 0.3),
        ([-1.3, 0.9, 200.0], 0.5),
        ([0.0, 0.25 + 2 * np.pi, 200.0], 0.0),
        ([np.pi, 0.25, 200.0], np.pi - 1),
        ([2 * np.pi - 1.2, 0.25, 200.0], 0.2),
        ([0.0, 0.25, 350.0], 0.25),
        ([0.0, 0.25, 50.0], 0.25),
    ],
)
def test_distances_are_those_on_the_circle_and_along_the_rail(angles, distance):
    assert FUNCTION.distance(np.array([angles]))[0] == pytest.approx(distance, abs=1e-12)
    assert FUNCTION.factor(np.array([angles]))[0] == pytest.approx(1 + 2 * distance, abs=1e-12)


def test_inside_a_variance_function_is_what_it_was_and_outside_never_smaller():
    """To the last bit; at an end of the range both are the same."""
    rng = np.random.default_rng(0)
    given = [np.array([0.0, 0.25, 200.0]), np.array([0.5, 0.1, 50.0]), rng.normal(size=3) / 5, rng.normal(size=3) / 5]
    before, after = VarianceFunction(*given), VarianceFunction(*given, beyond=FUNCTION)
    inside = rng.uniform(*RANGES.T, (200, 3))
    np.testing.assert_array_equal(after.share(inside), before.share(inside))
    outside = inside + [1.0, 0.0, 0.0]
    assert (after.share(outside) >= before.share(outside)).all()
    np.testing.assert_allclose(after.share(RANGES.T + [1e-9, 0, 0]), before.share(RANGES.T), rtol=1e-7)


@pytest.mark.parametrize("growth", [-0.1, np.nan, np.inf, 1e6])
def test_an_impossible_growth_is_refused(growth):
    refuses("growth", Extrapolation, RANGES, SLIDES, growth)


@pytest.mark.parametrize("ranges", [RANGES[:, ::-1], RANGES[:2], np.full((3, 2), np.nan)])
def test_ranges_that_are_none_are_refused(ranges):
    refuses("range of every joint", Extrapolation, ranges, SLIDES, 1.0)


def test_a_joint_that_never_moved_has_a_range_of_one_angle():
    still = Extrapolation(np.array([[0.2, 0.2]]), SLIDES[:1], 2.0)
    np.testing.assert_allclose(still.distance(np.array([[0.2], [0.5]])), [0.0, 0.3], atol=1e-12)


@pytest.mark.parametrize("growth", [0.0, STEEPEST_GROWTH])
def test_the_bounds_of_a_growth_are_growths(growth):
    assert Extrapolation(RANGES, SLIDES, growth).growth == growth


def test_a_slide_counts_in_its_travel():
    slide = Extrapolation(np.array([[0.0, 200.0], [5.0, 5.0]]), np.array([True, True]), 1.0)
    np.testing.assert_array_equal(slide.unit, [200.0, 1.0])
    np.testing.assert_allclose(slide.distance(np.array([[300.0, 5.0], [100.0, 7.0]])), [0.5, 2.0])
