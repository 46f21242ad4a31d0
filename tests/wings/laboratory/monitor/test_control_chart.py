"""Control charts: what is a change, how often one is seen where there is none, and how soon one that is there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr
from scipy.stats import binom

from truearm.wings.laboratory.monitor.control_chart import (
    CORRELATIONS,
    DETECTED_WITHIN,
    FALSE_ALARMS,
    MIN_BASELINE_CHECKS,
    ODDS,
    ControlRules,
    _change,
    control_chart,
    control_rules,
)

TWO = control_rules(2)
INDEPENDENT = np.zeros(1)  # no correlation is possible


def chart(values, u=0.0, rules=TWO, **options):
    return control_chart(values, u=np.full(len(values), u), rules=rules, **options)


def alarmed(one):
    return one.signal_index is not None or one.out_of_limits.any()


# The rules -----------------------------------------------------------------------------------------------------------


def test_one_chart_has_the_limits_of_the_textbooks():
    assert pytest.approx(3.0, abs=1e-4) == TWO.limit
    assert pytest.approx(np.log10(2 * ODDS)) == TWO.evidence


def test_several_charts_share_one_rate_of_false_alarms():
    rules = control_rules(8)
    assert TWO.limit < rules.limit
    assert TWO.evidence < rules.evidence


def test_each_value_has_its_own_rules_and_the_chart_those_of_the_last():
    wide, narrow = ControlRules(9.0, np.inf), ControlRules(1.0, np.inf)
    one = chart([0.0, 1.0, 0.0, 1.0], rules=[wide, wide, wide, narrow], correlations=INDEPENDENT)
    same = [chart([0.0, 1.0, 0.0, 1.0], rules=rules, correlations=INDEPENDENT).upper for rules in (wide, narrow)]
    assert (one.rules, one.upper[2], one.upper[3]) == (narrow, same[0][2], same[1][3])


# No change -----------------------------------------------------------------------------------------------------------


def test_the_first_limits_are_those_of_student():
    """Of two values 0 and 2: mean 1, s = sqrt 2; t of one degree of freedom is Cauchy's distribution."""
    one = chart([0.0, 2.0, 3.0], rules=ControlRules(1.0, np.inf), correlations=INDEPENDENT)
    half = np.tan(np.pi * (float(ndtr(1.0)) - 0.5)) * np.sqrt(2) * np.sqrt(1.5)
    assert (one.lower[2], one.upper[2]) == pytest.approx((1 - half, 1 + half), rel=1e-9)
    assert np.isnan(one.upper[:2]).all()


def autoregressive(rng, shape, correlation):
    """Series of standard normal values with a correlation of consecutive ones."""
    series = rng.standard_normal(shape)
    for i in range(1, shape[1]):
        series[:, i] = correlation * series[:, i - 1] + np.sqrt(1 - correlation**2) * series[:, i]
    return series


@pytest.mark.parametrize(
    "correlation", [pytest.param(0.0, marks=pytest.mark.weekly), 0.5, pytest.param(0.7, marks=pytest.mark.weekly)]
)
def test_an_unchanged_process_alarms_no_more_often_than_is_said(rng, correlation):
    """Of 38 values after the second, each rule has a share of 0.27 % of false alarms; 99.9 % of the binomial."""
    stated = 1 - (1 - FALSE_ALARMS) ** 38
    charts = [chart(row) for row in autoregressive(rng, (30, 40), correlation)]
    most = binom.ppf(0.9995, 30, stated)
    assert sum(one.signal_index is not None for one in charts) <= most
    assert sum(bool(one.out_of_limits.any()) for one in charts) <= most


@pytest.mark.parametrize("correlation", [0.0, 0.75])
def test_a_long_history_shows_how_consecutive_values_correlate(rng, correlation):
    (series,) = autoregressive(rng, (1, 150), correlation)
    mean, low, high = chart(series, rules=ControlRules(np.inf, np.inf)).correlation
    assert low <= correlation <= high
    assert mean == pytest.approx(correlation, abs=0.2)
    assert chart(series[:2]).correlation == (pytest.approx(CORRELATIONS.mean()), 0.0, 0.75)


def test_what_pauses_break_is_independent():
    """Days 0 to 9, then half a year later: the limits are those about the mean, not about the last value."""
    days = np.r_[np.arange(10.0), 190.0]
    values = np.r_[np.linspace(0.0, 1.0, 10), 0.5]
    known = {"correlations": np.array([0.75]), "rules": ControlRules(3.0, np.inf)}
    paused, at_once = chart(values, days=days, **known), chart(values, **known)
    assert at_once.upper[10] - at_once.lower[10] < paused.upper[10] - paused.lower[10]
    assert (paused.upper[10] + paused.lower[10]) / 2 == pytest.approx(paused.centre[10], abs=1e-9)
    assert (at_once.upper[10] + at_once.lower[10]) / 2 > at_once.centre[10] + 0.3
    np.testing.assert_array_equal(chart(values, days=2.0 * np.arange(11), **known).upper, at_once.upper)
    np.testing.assert_array_equal(chart(values, days=np.zeros(11), **known).upper, at_once.upper)


def test_scatters_from_few_readings_alarm_as_often_too(rng):
    """s of three readings in a seat, six degrees of freedom: skew. One chart with one side, limits alone."""
    rules = ControlRules(control_rules(1).limit, np.inf)
    s = np.sqrt(rng.chisquare(6, (100, 25)) / 6)
    options = {"rules": rules, "scale": True, "correlations": INDEPENDENT}
    beyond = sum(int(chart(row, **options).out_of_limits.sum()) for row in s)
    assert binom.ppf(0.0005, 100 * 23, FALSE_ALARMS) <= beyond <= binom.ppf(0.9995, 100 * 23, FALSE_ALARMS)


def test_the_limits_of_a_scatter_within_a_small_uncertainty_are_those_of_any_value():
    """The power 2/3 that is charted stretches the expected deviation as it does the values: to 1 % at u = 0.1 %."""
    values, u = np.full(6, 0.02), 2e-5
    assert chart(values, u, scale=True).upper[5] - 0.02 == pytest.approx(chart(values, u).upper[5] - 0.02, rel=0.01)


@settings(max_examples=30)
@given(
    st.lists(st.integers(-50, 50), min_size=3, max_size=20),
    st.integers(-1000, 1000),
    st.sampled_from([0.125, 4.0, 1024.0]),
)
def test_neither_zero_nor_unit_matters(values, shift, factor):
    given_values = np.array(values, dtype=float) + np.linspace(0, 1, len(values))
    one, other = chart(given_values, u=0.1), chart(factor * (given_values + shift), u=0.1 * factor)
    np.testing.assert_allclose(other.evidence, one.evidence, atol=1e-6)
    np.testing.assert_allclose(other.upper, factor * (one.upper + shift), rtol=1e-6, atol=1e-6)
    assert other.since == one.since


def test_equal_values_are_no_change():
    one = chart(np.full(30, 0.02), scale=True)
    assert one.since is None
    assert one.evidence.max() < 1
    assert not alarmed(chart(np.zeros(12), scale=True))


# A change ------------------------------------------------------------------------------------------------------------


def planted(rng, shape, n_histories, before=20, n_sides=8):
    """Checks until a change after `before` checks was seen, and how far off it was dated; `shape` of 1, 2, .. ."""
    seen, off = [], []
    for _ in range(n_histories):
        values = rng.standard_normal(before + 40)
        values[before:] += shape(np.arange(1, 41))
        one = chart(values, rules=control_rules(n_sides))
        if one.signal_index is not None and one.signal_index < before:
            continue  # a false alarm
        first = int(np.argmax(one.out_of_limits[before:])) if one.out_of_limits[before:].any() else 40
        seen.append(1 + min(first, 40 if one.signal_index is None else one.signal_index - before))
        off.append(40 if one.change_index is None else one.change_index - before)
    return np.array(seen), np.array(off)


def test_a_jump_of_three_standard_deviations_is_seen_and_dated_within_two(rng):
    """Six charts with eight sides, twenty checks before."""
    seen, off = planted(rng, lambda i: np.full(len(i), 3.0), 12)
    assert (seen <= 25).mean() > 0.9
    assert np.median(seen) <= DETECTED_WITHIN
    assert (np.abs(off) <= 2).mean() > 0.8


def test_a_slow_drift_is_seen_when_it_comes_to_three_standard_deviations(rng):
    """A fifth of a standard deviation a check: fifteen make three. When it began is known roughly only."""
    seen, off = planted(rng, lambda i: 0.2 * i, 12)
    assert (seen <= 36).mean() > 0.8
    assert np.median(off) <= 5


def test_a_change_downwards_is_one_but_not_of_a_scatter(rng):
    values = np.r_[rng.standard_normal(20), rng.standard_normal(10) - 5.0]
    one = chart(values)
    assert abs(one.change_index - 20) <= 1
    scatter = np.abs(10 + values)
    assert chart(scatter, scale=True).since is None
    up = chart(np.r_[scatter[:20], scatter[:10] + 6.0], scale=True)
    assert abs(up.change_index - 20) <= 1
    assert np.isnan(up.lower).all()


def test_a_change_stays_one_though_the_values_stay_where_they_went(rng):
    values = rng.standard_normal(120)
    values[20:] += 6.0
    one = chart(values)
    assert abs(one.since - 20) <= 1
    assert (one.n_before[30:] == one.n_before[-1]).all()
    assert one.n_before[-1] <= 20
    assert one.out_of_limits[30:].mean() > 0.5


def test_a_single_value_far_off_tells_only_while_it_is_the_last(rng):
    values = np.r_[rng.standard_normal(20), 40.0, rng.standard_normal(6)]
    assert chart(values[:21]).since == 20
    after = chart(values)
    assert after.since is None
    assert after.n_before[-1] == 25  # it is not in the baseline
    assert chart(np.r_[values[:21], 41.0]).since == 20


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_values_far_off_to_either_side_are_single_ones(side):
    """Dirt in one seat of a bar, then in the other: the last one stands alone, until the next is on its side.

    Two so far off on one side are evidence of a change.
    """
    steady, far = np.resize([1.0, -1.0, 0.5, -0.5], 20), 40.0 * side
    for tail, since in (([far, -far], 21), ([far, far, -far], 20), ([far, -far, -far], 21), ([far, far], 20)):
        one = chart(np.r_[steady, tail], rules=control_rules(8))
        assert one.out_of_limits[20:].all()
        assert (one.since, one.change_index) == (since, since if len(tail) > 2 or tail[0] == tail[1] else None)
    assert chart(np.r_[steady, far, -far, 0.0], rules=control_rules(8)).since is None


@pytest.mark.parametrize("begins", [3, 7, 10])
def test_what_fits_exactly_is_dated_exactly(begins):
    rows = np.arange(14)
    assert _change(rows, np.where(rows >= begins, 5.0, 2.0)) == (begins, False)
    assert _change(rows, 1.0 - 0.3 * np.maximum(rows - begins + 1, 0)) == (begins, True)
    left_out = np.delete(rows, 5)
    assert _change(left_out, np.where(left_out >= begins, 5.0, 2.0)) == (begins, False)


def test_the_expected_scatter_is_a_floor_while_values_are_few():
    """Values that differ by chance very little: limits as wide as expected up to the tenth value before, not after."""
    values = 1e-3 * np.tile([1.0, -1.0], 8)
    one = chart(values, u=1.0)
    wide = one.upper - one.lower > 2.0
    assert wide[2:MIN_BASELINE_CHECKS].all()
    assert not wide[MIN_BASELINE_CHECKS:].any()
    assert not chart(values[:10], u=1.0).enough
    assert chart(values[:11], u=1.0).enough


def test_rules_may_be_of_each_value(rng):
    values = 0.01 * rng.standard_normal(20)
    one = chart(values)
    each = chart(values, rules=[TWO] * 20)
    np.testing.assert_array_equal(one.upper, each.upper)
    wide = chart(values, rules=[TWO] * 10 + [control_rules(8)] * 10)
    np.testing.assert_array_equal(wide.upper[:10], one.upper[:10])
    assert (wide.upper[10:] > one.upper[10:]).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_dirt_in_one_check_leaves_no_trace_in_the_evidence(side):
    """Twelve values, one 9 standard deviations off, then others: the evidence is that of the series without it."""
    values, known = np.random.default_rng(1).standard_normal(24), {"correlations": INDEPENDENT}
    days = np.arange(25.0)
    dirty = chart(np.insert(values, 12, side * 9.0), days=days, **known)
    clean = chart(values, days=np.delete(days, 12), **known)
    assert not alarmed(clean)
    assert dirty.beyond.tolist() == [*clean.beyond[:12], int(side), *clean.beyond[12:]]
    np.testing.assert_allclose(np.delete(dirty.evidence, 12), clean.evidence, atol=1e-12)
    assert chart(np.insert(values, 12, [side * 9.0, side * 9.0]), **known).evidence[13] > dirty.evidence[13] + 1
