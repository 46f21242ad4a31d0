"""Standstill: when a reading is taken, what its mean is, and that it is taken once."""

from math import radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.wings.bench.sources import Sample, StandstillRule
from truearm.wings.bench.sources.standstill import MOVED, LastMovement, Standstill

RULE = StandstillRule(window_s=0.5, spread_rad=0.001)


def fed(samples, rule=RULE, **keys):
    """Readings that are taken wherever the arm stands still at a new pose."""
    standstill, taken = Standstill(rule, **keys), []
    for time_s, angles in samples:
        standstill.add(Sample(time_s, np.asarray(angles, dtype=float)))
        if standstill.is_still and standstill.is_new:
            taken.append(standstill.taken())
    return taken


def stop(start_s, angles, seconds=1.0, rate=20):
    return [(start_s + k / rate, angles) for k in range(int(seconds * rate))]


def test_a_stop_gives_one_reading_and_the_next_pose_another():
    taken = fed([*stop(0, [0, 1]), *stop(1, [0.5, 1]), *stop(2, [0.5, 1])])
    assert [one.joint_angles_rad.tolist() for one in taken] == [[0, 1], [0.5, 1]]
    assert all(one.end_s - one.start_s >= RULE.window_s for one in taken)


def test_mean_and_standard_deviation_are_those_of_the_samples():
    random = np.random.default_rng(1)
    angles = 0.3 + 1e-4 * random.standard_normal((40, 2))
    (reading, *_) = fed([(k / 20, one) for k, one in enumerate(angles)])
    n = reading.n
    assert n == 11
    assert reading.joint_angles_rad == pytest.approx(angles[:n].mean(axis=0), abs=1e-15)
    assert reading.joint_std_rad == pytest.approx(angles[:n].std(axis=0, ddof=1), rel=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0011, 3.0), st.integers(0, 1))
def test_an_arm_that_moves_by_more_than_the_spread_in_every_window_gives_none(speed, joint):
    """Speed in spreads per window."""
    rate = speed * 1.1 * RULE.spread_rad / RULE.window_s / 0.0011
    moving = [(k / 50, [rate * k / 50 if i == joint else 0.0 for i in range(2)]) for k in range(150)]
    assert fed(moving) == []


def test_a_small_step_is_no_new_pose_and_a_larger_one_is():
    small, large = (share * MOVED * RULE.spread_rad for share in (0.9, 1.1))
    assert len(fed([*stop(0, [0.0]), *stop(1, [small])])) == 1
    assert len(fed([*stop(0, [0.0]), *stop(1, [large])])) == 2


def test_a_gap_or_a_clock_that_jumps_starts_a_new_window():
    half = [(k / 20, [0.0]) for k in range(9)]
    assert fed([*half, *((time_s + 5, angles) for time_s, angles in half)]) == []
    assert fed([*half, *((time_s - 5, angles) for time_s, angles in half)]) == []
    assert fed([*half, *((time_s, [0.0, 0.0]) for time_s, _ in half)]) == []


@settings(max_examples=5)
@given(st.integers(0, 9999), st.sampled_from([5.0, 50.0, 500.0]))
def test_the_arm_is_still_where_all_angles_of_the_window_are_within_the_spread(seed, rate_hz):
    """Also where the window begins again, and for far more samples than it has."""
    random, standstill, window = np.random.default_rng(seed), Standstill(RULE), []
    angles, time_s = np.zeros(2), 0.0
    for _ in range(1000):
        time_s += 2.0 if random.random() < 0.002 else 1 / rate_hz
        angles = angles + (random.random() < 0.005) * 0.4 * RULE.spread_rad * random.standard_normal(2)
        window = [one for one in window if time_s - window[-1][0] <= RULE.window_s] + [(time_s, angles)]
        while len(window) > 1 and time_s - window[1][0] >= RULE.window_s:
            window.pop(0)
        standstill.add(Sample(time_s, angles))
        spread = np.ptp([one for _, one in window], axis=0)
        fills = len(window) > 2 and time_s - window[0][0] >= RULE.window_s
        assert standstill.is_still == (fills and bool((spread <= RULE.spread_rad).all()))


def test_two_samples_are_no_mean():
    assert fed([(0.0, [0.0]), (0.5, [0.0])]) == []


def test_a_sliding_joint_has_its_own_spread():
    moves = [(k / 20, [0.0, 0.002 * k]) for k in range(20)]
    assert fed(moves) == []
    assert len(fed(moves, prismatic=(2,))) == 1


def test_memory_is_bounded_by_the_window():
    standstill = Standstill(StandstillRule(window_s=900))
    for k in range(12_000):
        standstill.add(Sample(k / 1000, np.zeros(1)))
    assert len(standstill._window) == 10_000


@pytest.mark.parametrize("keys", [{"window_s": 0}, {"spread_rad": -1}, {"spread_mm": float("nan")}])
def test_a_rule_without_sense_is_refused(keys):
    refuses("expected a positive", StandstillRule, **keys)


def test_the_default_spread_is_a_twentieth_of_a_degree():
    assert StandstillRule().spread_rad == radians(0.05)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-3, 3), min_size=1, max_size=8), st.integers(0, 99))
def test_the_last_movement_is_the_sign_of_the_last_large_step_whatever_the_noise(turns, seed):
    noise = np.random.default_rng(seed)
    movement = LastMovement(np.zeros(1))
    at, want = 0.0, 0.0
    for turn in turns:
        step = turn if abs(turn) > 0.01 else 0.0
        for share in np.linspace(0, 1, 20):
            movement.add(np.array([at + share * step + noise.uniform(-4e-4, 4e-4)]), np.array([1e-3]))
        at, want = at + step, np.sign(step) or want
    assert movement.signs.tolist() == [want]
