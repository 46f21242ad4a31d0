"""Quantiles from counts are those of the numbers, few or many, in parts or whole."""

import numpy as np
import pytest

from truearm.solve.quantile_sketch import ACCURACY, QuantileSketch


@pytest.mark.parametrize("n", [1, 2, 3, 4, 12, 1001])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.95, 1.0])
def test_quantiles_are_those_of_the_numbers(n, share):
    values = np.random.default_rng(n).lognormal(-4, 2, n)
    found = QuantileSketch.of(values).quantile(share)
    assert found == pytest.approx(np.quantile(values, share), rel=1.01 * ACCURACY)  # half a bin, of the growth of one
    parts = QuantileSketch.of(values[: n // 2]) + QuantileSketch.of(values[n // 2 :])
    assert parts.quantile(share) == found


def test_without_numbers_there_is_none():
    assert np.isnan(QuantileSketch().quantile(0.5))
