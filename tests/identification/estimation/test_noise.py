"""Laws of noise and weights, for readings of any number of residuals: a plane's one, a point's three, a pose's six."""

import numpy as np
import pytest
from scipy.stats import chi2

from truearm.identification.estimation.residual_variance import (
    HUBER_STDS,
    SHARE_BEYOND,
    expected_clipped_square,
    huber_threshold_squared,
    huber_weights,
    paule_mandel_variance,
)

RESIDUALS = [1, 2, 3, 6]


def test_huber_weights_by_hand():
    residuals = np.zeros((4, 3))
    residuals[:, 0] = [1, 4, 8, 8]
    variance = np.ones((4, 3))
    variance[3] = 4  # the same residual at twice the standard deviation is ordinary
    np.testing.assert_allclose(huber_weights(residuals, variance), [1, 1, HUBER_STDS / 8, 1])


@pytest.mark.parametrize("k", RESIDUALS)
def test_the_same_share_of_gaussian_readings_weighs_less_whatever_their_residuals(k, rng):
    assert chi2.sf(huber_threshold_squared(k), k) == pytest.approx(SHARE_BEYOND)
    n = 200_000
    weights = huber_weights(rng.normal(size=(n, k)), np.ones((n, k)))
    # counted: 227 of 200,000 are expected, +-15 at one standard deviation
    assert (weights < 1).sum() == pytest.approx(n * SHARE_BEYOND, abs=60)


@pytest.mark.parametrize("k", RESIDUALS)
def test_mean_of_clipped_squares_is_that_of_a_sample(k, rng):
    """200,000 squared lengths of standard deviation sqrt(2 k): their mean is known to 0.8 % of k or better."""
    squares = np.minimum((rng.normal(size=(200_000, k)) ** 2).sum(axis=1), huber_threshold_squared(k))
    assert expected_clipped_square(k) == pytest.approx(squares.mean(), abs=4 * np.sqrt(2 * k / 200_000))
    assert 0.99 * k < expected_clipped_square(k) < k


@pytest.mark.parametrize("k", RESIDUALS)
@pytest.mark.parametrize("robust", [False, True])
def test_unexplained_variance_of_gaussian_residuals(robust, k, rng):
    """Half the references poor (1 mm), half good (0.01 mm), 0.05 mm unexplained: the good half tells it."""
    n = 12000 // k
    reference_variance = np.where(np.arange(n)[:, None] % 2, 1.0, 1e-4) * np.ones(k)
    residuals = np.sqrt(reference_variance + 0.05**2) * rng.normal(size=(n, k))
    found = paule_mandel_variance(residuals, reference_variance, n_effective=0, robust=robust)
    # 6000 good residuals: the variance to 2 sqrt(2/6000) = 4 % at two sigma, and the poor ones add some
    assert found == pytest.approx(0.05**2, rel=0.15)
    nothing = paule_mandel_variance(
        np.sqrt(reference_variance) * rng.normal(size=(n, k)) * 0.9, reference_variance, n_effective=0, robust=robust
    )
    assert np.sqrt(nothing) == pytest.approx(1e-6)  # mm: the floor


@pytest.mark.parametrize("k", RESIDUALS)
def test_gross_errors_hardly_raise_the_unexplained_variance(k, rng):
    residuals = 0.05 * rng.normal(size=(1000, k))
    residuals[::20] = 1000
    found = paule_mandel_variance(residuals, np.zeros((1000, k)), n_effective=0, robust=True)
    # One in twenty counts as the cut, the others are left with the rest: 0.95 k (0.05 mm)^2 / v + 0.05 cut = k, nearly.
    expected = 0.05**2 * 0.95 * k / (k - 0.05 * huber_threshold_squared(k))
    assert found == pytest.approx(expected, rel=0.15)  # 950 readings: 4 % at one sigma; the cut on ordinary ones 2 %
    assert np.sqrt(paule_mandel_variance(residuals, np.zeros((1000, k)), n_effective=0, robust=False)) > 100


@pytest.mark.parametrize("k", RESIDUALS)
def test_parameters_take_their_share_of_the_freedom(k, rng):
    """A third as many free parameters as residuals: what is left over is a third smaller than the noise says."""
    n = 6000 // k
    left_over = 0.05 * rng.normal(size=(n, k)) * np.sqrt(2 / 3)
    found = paule_mandel_variance(left_over, np.zeros((n, k)), n_effective=n * k / 3, robust=False)
    assert np.sqrt(found) == pytest.approx(0.05, rel=0.04)  # 6000 residuals: 1 % at one sigma


@pytest.mark.parametrize("k", RESIDUALS)
def test_no_freedom_left_is_no_crash(k):
    for residuals in (np.zeros((5, k)), np.full((5, k), 1e-3)):
        found = paule_mandel_variance(residuals, np.zeros((5, k)), n_effective=10 * k, robust=True)
        assert np.isfinite(found)
        assert found > 0
