"""Sums over parts: field by field, and in whatever groups the parts are added.

Quantiles from counts are those of the numbers, few or many, in parts or whole.

The design effect of correlated readings, and quantiles from counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearm.solve.sums import (
    ACCURACY,
    BLOCK,
    SHORT_BLOCKS,
    SHORTEST,
    QuantileSketch,
    Sums,
    block_starts,
    design_effect,
    joined,
    one_below_the_other,
)
from truearm.typing import FloatArray
from truearm.verbs.record import describe_effective_number


@dataclass(frozen=True, eq=False)
class Figures(Sums):
    n: int
    largest: float = field(metadata=joined(max))
    rows: FloatArray = field(metadata=joined(one_below_the_other))
    by_name: Mapping[str, int]
    inner: Figures | Mapping[str, int]


def of(value: int) -> Figures:
    name = "odd" if value % 2 else "even"
    inner = Figures(value, float(value), np.full((1, 2), value), {}, {})
    return Figures(1, float(value), np.full((1, 2), value), {name: value}, inner)


@given(st.lists(st.integers(-99, 99), min_size=3, max_size=9), st.data())
def test_parts_in_any_groups_have_the_sum_of_all(values, data):
    cut = data.draw(st.integers(1, len(values) - 1))
    first, second = values[:cut], values[cut:]

    def total(numbers):
        found, *others = map(of, numbers)
        for other in others:
            found = found + other
        return found

    both = total(first) + total(second)
    assert (both.n, both.largest, both.inner.n) == (len(values), max(values), sum(values))
    assert both.rows[:, 1].tolist() == both.inner.rows[:, 0].tolist() == values
    odd = [value for value in values if value % 2]
    even = [value for value in values if not value % 2]
    assert both.by_name == {name: sum(own) for name, own in (("odd", odd), ("even", even)) if own}


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


def ar1(n: int, p: int, rho: float, seed: int) -> np.ndarray:
    from scipy.signal import lfilter

    steps = np.random.default_rng(seed).normal(size=(n, p))
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], steps, axis=0)


@pytest.mark.parametrize("rho", [0.0, 0.9, 0.999])
def test_the_design_effect_of_an_autoregression_is_that_of_its_correlations(rho):
    n, p = 200 * BLOCK, 10
    blocks = ar1(n, p, rho, 1).reshape(-1, BLOCK, p).sum(axis=1)
    effect = design_effect(blocks, np.eye(p) / n, n)
    assert effect.factor == pytest.approx((1 + rho) / (1 - rho), rel=0.15)
    assert effect.is_settled


def test_the_scatter_is_the_covariance_of_the_blocks_times_their_number():
    """Eight blocks, too few for longer ones: as NumPy has it; the factor is its mean over the determined directions."""
    scores = 5 * ar1(8, 2, 0.0, 4)
    effect = design_effect(scores, np.eye(2), 8 * BLOCK)
    np.testing.assert_allclose(effect.scatter, 8 * np.cov(scores, rowvar=False), rtol=1e-12)
    assert effect.factor == pytest.approx(np.trace(effect.scatter) / 2, rel=1e-12)


def test_few_blocks_or_a_correlation_longer_than_they_are_is_said():
    assert design_effect(np.ones((3, 2)), np.eye(2), 3 * BLOCK).factor == 1.0
    assert "count as independent (too few" in describe_effective_number(100.0, 100, is_settled=False)
    assert "have independent errors" in describe_effective_number(100.0, 100, is_settled=True)
    n = 64 * BLOCK
    drift = np.cumsum(np.random.default_rng(2).normal(size=(n, 20)), axis=0).reshape(-1, BLOCK, 20).sum(axis=1)
    assert not design_effect(drift, np.eye(20), n).is_settled


@pytest.mark.parametrize("n", [1, SHORTEST, 2 * SHORTEST - 1, 3000, 32 * BLOCK - 1, 50 * BLOCK + 3])
def test_blocks_cover_all_readings_and_few_have_shorter_ones(n):
    lengths = np.diff(np.append(block_starts(n), n))
    assert lengths.sum() == n
    assert min(n, SHORTEST) <= lengths.min() <= BLOCK
    assert lengths.max() < 2 * lengths.min()
    assert len(lengths) >= SHORT_BLOCKS or n < SHORT_BLOCKS * SHORTEST
    assert np.diff(block_starts(n, 10**6)).tolist() == [BLOCK] * (max(n // BLOCK, 1) - 1)


def test_a_quantile_is_as_accurate_as_stated_and_counts_add_up():
    values = np.random.default_rng(3).lognormal(sigma=3, size=40_000)
    sketch = QuantileSketch.of(values[:100]) + QuantileSketch.of(values[100:])
    for share in (0.0, 0.05, 0.5, 0.95, 1.0):
        assert sketch.quantile(share) == pytest.approx(np.quantile(values, share), rel=2 * ACCURACY)
    assert np.isnan(QuantileSketch().quantile(0.5))
