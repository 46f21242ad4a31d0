"""Sums of weighted squares: against chi-squared and F variables, and drawn sums."""

import numpy as np
import pytest
from scipy.special import chdtrc, fdtrc

from refusals import refuses
from truearm.wings.laboratory.monitor.expected_values import quadratic_form_quantile_beyond


@pytest.mark.parametrize("probability", [0.2, 0.01, 1e-4])
@pytest.mark.parametrize(("n", "rel"), [(1, 0.1), (3, 0.05), (27, 0.02)])
def test_equal_weights_give_chi_squared_and_f(n, rel, probability):
    """The probability beyond the value is the stated one, or smaller by what the docstring says."""
    x = quadratic_form_quantile_beyond(np.full(n, 0.7), probability) / 0.7
    assert (1 - rel) * probability < chdtrc(n, x) < 1.002 * probability
    ratio = quadratic_form_quantile_beyond(np.full(n, 0.7), probability, freedom=8.0) / 0.7 / n
    assert (1 - rel) * probability < fdtrc(n, 8.0, ratio) < 1.002 * probability


@pytest.mark.parametrize("freedom", [8.0, np.inf])
def test_unequal_weights_agree_with_drawn_sums(rng, freedom):
    """200,000 sums: standard deviation of a rate of 1 % is 2 % of it; the saddlepoint is up to 10 % too careful."""
    weights = np.array([1.0, 0.3, 0.1, 0.1, 0.1, 0.0])
    scale = 1.0 if np.isinf(freedom) else rng.chisquare(freedom, 200_000) / freedom
    sums = rng.standard_normal((200_000, 6)) ** 2 @ weights / scale
    beyond = (sums > quadratic_form_quantile_beyond(weights, 0.01, freedom=freedom)).mean()
    assert 0.01 * (0.9 - 0.08) < beyond < 0.01 * 1.08


def test_the_unit_does_not_matter_and_nothing_is_zero():
    weights = np.array([2.0, 1.0])
    one = quadratic_form_quantile_beyond(weights, 0.01)
    assert quadratic_form_quantile_beyond(1e-6 * weights, 0.01) == pytest.approx(1e-6 * one)
    assert quadratic_form_quantile_beyond(np.zeros(3), 0.01) == 0.0


@pytest.mark.parametrize(
    ("weights", "probability", "freedom", "phrase"),
    [
        ([1.0, -0.1], 0.01, np.inf, "weights of 0 or more"),
        ([np.nan], 0.01, np.inf, "finite weights"),
        ([1.0], 0.5, np.inf, "probability between 0 and 0.3"),
        ([1.0], 0.01, 0.5, "1 degree of freedom"),
    ],
)
def test_what_is_no_form_is_refused(weights, probability, freedom, phrase):
    refuses(phrase, quadratic_form_quantile_beyond, np.array(weights), probability, freedom=freedom)
