"""Gaps between the angles that a model learned from."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.compensation.models.training_range import find_angle_gaps, outside_ranges

TURNS = np.zeros(1, bool)


def ranges_of(angles):
    return np.stack([angles.min(axis=0), angles.max(axis=0)], axis=1)


def test_two_clusters_leave_a_gap_between_them():
    angles = np.radians(np.concatenate([np.linspace(-90, -30, 500), np.linspace(40, 80, 500)]))[:, None]
    gaps = find_angle_gaps(angles, TURNS)
    # 170 degrees over 1000 angles: near is 1.5 * 170 * ln(1000) / 1000 = 1.76 degrees.
    np.testing.assert_allclose(np.degrees(gaps), [[0, -30 + 1.7616, 40 - 1.7616]], atol=1e-3)
    asked = np.radians([[-91.0], [-90], [-31], [-29], [-28], [0], [38], [39], [81]])
    away = outside_ranges(asked, ranges_of(angles), gaps)
    assert away.tolist() == [True, False, False, False, True, True, True, False, True]


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 400), st.integers(0, 10**6))
def test_angles_learned_from_are_never_away(n, seed):
    rng = np.random.default_rng(seed)
    angles = rng.choice([0.01, 1.0], size=3) * rng.normal(size=(n, 3)) ** 3
    gaps = find_angle_gaps(angles, np.array([False, True, False]))
    assert not outside_ranges(angles, ranges_of(angles), gaps).any()
    assert (gaps[:, 1] < gaps[:, 2]).all()


@pytest.mark.parametrize("n", [10, 100, 2000])
def test_angles_spread_at_random_have_no_gaps(n):
    """The law's chance of a gap is 1/n^2 a joint: among 30 joints one in a thousand or less, but for n = 10."""
    angles = np.random.default_rng(n).uniform(-2, 2, (n, 30))
    assert len(find_angle_gaps(angles, np.zeros(30, bool))) <= (3 if n == 10 else 0)


def test_sliding_joints_go_by_their_range():
    angles = np.r_[np.linspace(0, 100, 800), np.linspace(400, 500, 800)][:, None]  # mm
    np.testing.assert_allclose(find_angle_gaps(angles, ~TURNS), [[0, 106.9, 393.1]], atol=2)


def test_a_joint_that_stood_still_or_one_reading():
    assert len(find_angle_gaps(np.full((5, 2), 0.3), np.zeros(2, bool))) == 0
    assert len(find_angle_gaps(np.zeros((1, 2)), np.array([True, False]))) == 0
