"""The design effect of correlated readings, and quantiles from counts."""

import numpy as np
import pytest

from truearm.solve.effective_number import BLOCK, SHORT_BLOCKS, SHORTEST, block_starts, design_effect
from truearm.solve.quantile_sketch import ACCURACY, QuantileSketch
from truearm.verbs.sentences import describe_effective_number


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
