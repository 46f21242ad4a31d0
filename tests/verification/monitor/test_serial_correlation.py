"""Predictions of a process whose consecutive values correlate, against the covariance matrix written out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from truearm.verification.monitor.serial_correlation import (
    CORRELATIONS,
    AutoregressiveBaseline,
    Prediction,
    prediction_limits,
)


def baseline_of(values, gaps, correlations=CORRELATIONS):
    baseline = AutoregressiveBaseline(correlations)
    for value, gap in zip(values, gaps, strict=True):
        baseline.elapse(gap)
        baseline.add(value)
    return baseline


def covariance(gaps, rho):
    """rho to the power of the distance between any two values."""
    at = np.cumsum(gaps)
    return rho ** np.abs(at[:, None] - at)


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(1, 4)), min_size=2, max_size=8),
    st.floats(1, 4),
    st.floats(-100, 100),
)
def test_one_value_at_a_time_is_generalised_least_squares(steps, ahead, shift):
    """Mean, squares and the prediction of the whole covariance matrix; the values' own mean does not matter."""
    values, gaps = (np.array(column) for column in zip(*steps, strict=True))
    values = values + np.arange(len(values)) ** 2 % 3  # not all the same
    baseline = baseline_of(values + shift, gaps)
    baseline.elapse(ahead)
    prediction = baseline.predict(baseline.log_weights, least=0.0)
    n, logs = len(values), []
    for k, rho in enumerate(CORRELATIONS):
        whole = covariance(np.r_[gaps, ahead], rho)
        inverse, to_next = np.linalg.inv(whole[:n, :n]), whole[n, :n]
        ones = np.ones(n)
        information = ones @ inverse @ ones
        mean = ones @ inverse @ values / information
        squares = (values - mean) @ inverse @ (values - mean)
        free = 1 - to_next @ inverse @ to_next + (1 - to_next @ inverse @ ones) ** 2 / information
        location = mean + to_next @ inverse @ (values - mean)
        assert prediction.location[k] - shift == pytest.approx(location, abs=1e-7)
        assert prediction.scale[k] == pytest.approx(np.sqrt(squares / (n - 1) * free), rel=1e-5, abs=1e-6)
        logs.append(-(np.linalg.slogdet(whole[:n, :n])[1] + np.log(information) + (n - 1) * np.log(squares)) / 2)
    weights = np.exp(np.array(logs) - max(logs))
    np.testing.assert_allclose(prediction.weight, weights / weights.sum(), atol=1e-5)


def test_three_values_by_hand():
    """0 and 2 with rho = 0.5: e = 0 and 4 / sqrt(3), w = 1 and 1 / sqrt(3), so the mean is (4/3) / (4/3) = 1."""
    baseline = baseline_of([0.0, 2.0], [1.0, 1.0], np.array([0.5]))
    baseline.elapse(1.0)
    prediction = baseline.predict(baseline.log_weights, least=0.0)
    assert prediction.mean == pytest.approx(1.0, rel=1e-12)
    assert prediction.location[0] == pytest.approx(1.5, rel=1e-12)  # half way between the mean and 2
    # Squares 16/3 - (4/3)^2 / (4/3) = 4, one degree of freedom; free variance 3/4 + (1/2)^2 / (4/3) = 15/16.
    assert prediction.scale[0] == pytest.approx(2 * np.sqrt(15 / 16), rel=1e-12)
    assert ndtr(prediction.score(prediction.location[0] + prediction.scale[0])) == pytest.approx(0.75, rel=1e-12)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(0.1, 3), st.floats(0.1, 1)), min_size=1, max_size=4))
def test_the_limits_are_where_the_scores_are(components):
    location, scale, weight = (np.array(column) for column in zip(*components, strict=True))
    prediction = Prediction(location, scale, weight / weight.sum(), 9, 0.0)
    low, high = prediction_limits([prediction] * 2, np.array([3.0, 1.0]))
    for side, edges in ((-1.0, low), (1.0, high)):
        scores = [prediction.score(edge) for edge in edges]
        assert scores == pytest.approx([3.0 * side, 1.0 * side], abs=1e-6)
