"""Predictions and evidence of a process whose consecutive values correlate, against its whole covariance matrix."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp, ndtr, ndtri, stdtrit

from truearm.wings.laboratory.monitor.control_chart import CORRELATIONS, DRIFT, STEP, AutoregressiveSeries

STEPS = st.lists(st.tuples(st.floats(-5, 5), st.floats(1, 4)), min_size=2, max_size=8)


def given_series(steps, shift=0.0):
    values, gaps = (np.array(column) for column in zip(*steps, strict=True))
    return values + np.arange(len(values)) ** 2 % 3 + shift, np.cumsum(gaps)  # not all the same


def log_likelihood(values, covariance):
    """Of values with unknown mean and scatter; and mean and squares of generalised least squares."""
    inverse, ones = np.linalg.inv(covariance), np.ones(len(values))
    information = ones @ inverse @ ones
    mean = ones @ inverse @ values / information
    squares = (values - mean) @ inverse @ (values - mean)
    logs = np.linalg.slogdet(covariance)[1] + np.log(information) + (len(values) - 1) * np.log(squares)
    return -logs / 2, mean, squares, information


@settings(max_examples=50)
@given(STEPS, st.floats(1, 4), st.floats(-100, 100))
def test_the_prediction_is_generalised_least_squares(steps, ahead, shift):
    """Of the whole covariance matrix, for each correlation; the values' own mean does not matter."""
    values, at = given_series(steps)
    n, later = len(values), at[-1] + ahead
    for rho in CORRELATIONS:
        found = AutoregressiveSeries(values + shift, at, correlations=np.array([rho])).predict(later, 1.5)
        times = np.r_[at, later]
        whole = rho ** np.abs(times[:, None] - times)
        _, mean, squares, information = log_likelihood(values, whole[:n, :n])
        weights = np.linalg.solve(whole[:n, :n], whole[n, :n])
        location = mean + weights @ (values - mean)
        free = 1 - weights @ whole[n, :n] + (1 - weights.sum()) ** 2 / information
        half = stdtrit(n - 1, ndtr(1.5)) * np.sqrt(squares / (n - 1) * free)
        assert found.mean - shift == pytest.approx(mean, abs=1e-7)
        assert found.lower - shift == pytest.approx(location - half, rel=1e-6, abs=1e-6)
        assert found.upper - shift == pytest.approx(location + half, rel=1e-6, abs=1e-6)


def test_three_values_by_hand():
    """0 and 2 with rho = 0.5: e = 0 and 4 / sqrt(3), w = 1 and 1 / sqrt(3), so the mean is (4/3) / (4/3) = 1.

    Squares 16/3 - (4/3)^2 / (4/3) = 4, one degree of freedom; free variance 3/4 + (1/2)^2 / (4/3) = 15/16; the third
    value is expected half way between the mean and 2. The upper quartile of Student's t is 1.
    """
    series = AutoregressiveSeries(np.array([0.0, 2.0]), np.array([1.0, 2.0]), correlations=np.array([0.5]))
    mean, lower, upper = series.predict(3.0, float(ndtri(0.75)))
    assert mean == pytest.approx(1.0, rel=1e-12)
    assert (lower, upper) == pytest.approx((1.5 - 2 * np.sqrt(15 / 16), 1.5 + 2 * np.sqrt(15 / 16)), rel=1e-9)


def test_limits_are_the_widest_of_the_plausible_correlations():
    values, at = np.array([0.0, 1, 0, 2, 1, 3, 2, 3]), np.arange(8.0)
    each = [AutoregressiveSeries(values, at, correlations=np.array([rho])).predict(8.0, 3.0) for rho in CORRELATIONS]
    whole = AutoregressiveSeries(values, at).predict(8.0, 3.0)
    assert (whole.lower, whole.upper) == (min(one.lower for one in each), max(one.upper for one in each))


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(1, 4)), min_size=4, max_size=8))
def test_the_evidence_is_the_ratio_of_likelihoods(steps):
    """A change of unknown size adds its square to the covariance: over all beginnings, averaged over correlations."""
    values, at = given_series(steps)
    n, without, with_change = len(values), [], []
    for rho in CORRELATIONS:
        covariance = rho ** np.abs(at[:, None] - at)
        without.append(log_likelihood(values, covariance)[0])
        for first in range(2, n - 1):
            step = (np.arange(n) >= first).astype(float)
            drift = np.maximum(at - at[first - 1], 0.0) / DRIFT
            for shape in (step, drift):
                with_change.append(log_likelihood(values, covariance + STEP**2 * np.outer(shape, shape))[0])
    both = logsumexp(with_change) - np.log(len(CORRELATIONS)) - max(without)
    series = AutoregressiveSeries(values, at)
    assert series.evidence(upper_only=False) == pytest.approx(both / np.log(10), abs=1e-6)
    sides = [AutoregressiveSeries(sign * values, at).evidence(upper_only=True) for sign in (1, -1)]
    assert np.log10(np.power(10.0, sides).sum()) == pytest.approx(both / np.log(10), abs=1e-6)


def test_too_few_values_are_no_evidence():
    series = AutoregressiveSeries(np.array([0.0, 0.1, 9.0]), np.arange(3.0))
    assert series.evidence(upper_only=False) == -np.inf


def test_a_step_is_evidence_and_a_wave_is_none(rng):
    """Twenty values, then ten that are three standard deviations higher; and a wave that goes as far up and down."""
    values = rng.standard_normal(30)
    stepped = values + 3.0 * (np.arange(30) >= 20)
    wave = values + 3.0 * np.sin(np.arange(30) / 3)
    found = [AutoregressiveSeries(one, np.arange(30.0)).evidence(upper_only=True) for one in (stepped, wave)]
    assert found[0] > 1.5 > 1 > found[1]
