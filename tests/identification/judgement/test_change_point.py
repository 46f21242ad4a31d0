"""A frame that moves during a session is found, with its row and size; one that does not is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from truearm.identification.judgement.change_point import HALF_WIDTH, SIGNIFICANCE, frame_change

STD = 0.01  # mm


def session(n: int, seed: int, *, regions: bool = False):
    """Angles, points and pure noise of a session; with `regions` the poses are measured region by region."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-1, 1, (n, 6))
    if regions:
        angles = angles[np.argsort(angles[:, 0])]
    points = 500 * np.stack([np.cos(angles[:, 0]), np.sin(angles[:, 1]), angles[:, 2]], axis=1)
    return angles, points, STD * rng.standard_normal((n, 3))


def examined(angles, points, residuals):
    """Of residuals about the mean, as a free base leaves them."""
    n = len(points)
    return frame_change(angles, points, residuals - residuals.mean(axis=0), np.full((n, 3), STD**-2), np.arange(n))


@pytest.mark.parametrize("n", [40, 150])
def test_good_sessions_are_left_alone(n):
    alarms = sum(examined(*session(n, seed)) is not None for seed in range(150))
    # 150 sessions at 0.2 % each: three alarms or more have a probability of 0.4 %.
    assert SIGNIFICANCE == 0.002
    assert alarms <= 2


def test_heavy_tails_and_gross_errors_are_no_change():
    alarms = 0
    for seed in range(40):
        angles, points, _ = session(60, seed)
        residuals = STD * np.random.default_rng(seed).standard_t(2, (60, 3))
        alarms += examined(angles, points, residuals) is not None
    assert alarms <= 1


@pytest.mark.parametrize(("n", "row"), [(60, 20), (60, 33), (300, 290 - 150)])
def test_a_step_is_found_with_its_row_and_size(n, row):
    angles, points, residuals = session(n, 1)
    moved = np.array([0.03, -0.02, 0.01])
    residuals[row:] -= moved  # predicted less measured
    found = examined(angles, points, residuals)
    assert found.kind == "step"
    assert found.first_row <= row <= found.last_row
    assert abs(found.row - row) <= 1
    # 20 readings on the smaller side: six components of a hundredth each over the root of 20.
    assert found.shift_mm == pytest.approx(np.linalg.norm(moved), abs=3 * STD * np.sqrt(6 / 20))
    assert found.p_value <= SIGNIFICANCE


def test_a_rotation_of_the_tracker_is_a_step_too():
    angles, points, residuals = session(100, 2)
    turn = np.array([0.0, 1e-4, 0.0])
    away = points - points.mean(axis=0)
    residuals[50:] -= np.cross(turn, away)[50:]
    found = examined(angles, points, residuals)
    assert abs(found.row - 50) <= 1
    assert found.shift_mm == pytest.approx(np.sqrt((np.cross(turn, away) ** 2).sum(axis=1).mean()), rel=0.3)


def test_a_motion_in_proportion_to_the_row_is_a_drift():
    angles, points, residuals = session(200, 3)
    residuals -= np.linspace(0, 1, 200)[:, None] * [0.05, 0.0, 0.0]
    found = examined(angles, points, residuals)
    assert found.kind == "drift"
    assert found.shift_mm == pytest.approx(0.05, abs=0.02)
    assert (found.first_row, found.last_row) == (0, 199)


def test_a_step_among_gross_errors_is_found():
    """Their weights are small, as a robust fit gives them."""
    angles, points, residuals = session(100, 4)
    weights = np.full((100, 3), STD**-2)
    residuals[::9] += 5.0
    weights[::9] = 0.0
    residuals[40:] -= [0.04, 0.0, 0.0]
    found = frame_change(angles, points, residuals, weights, np.arange(100))
    assert abs(found.row - 40) <= 1


def test_errors_of_the_pose_are_no_change_though_poses_are_ordered():
    """A model misses five deviations, smoothly with J1, and J1 was moved from one end to the other."""
    for seed in range(5):
        angles, points, residuals = session(300, seed, regions=True)
        residuals[:, 0] += 5 * STD * np.sin(2 * angles[:, 0])
        assert examined(angles, points, residuals) is None
    # The same order does not hide a step at poses that are alike on both sides.
    angles, points, residuals = session(300, 0)
    residuals[:, 0] += 5 * STD * np.sin(2 * angles[:, 0])
    residuals[100:] -= [0.05, 0.0, 0.0]
    assert abs(examined(angles, points, residuals).row - 100) <= 3


@pytest.mark.parametrize("repeats", [3, 12])
def test_poses_that_are_read_several_times_count_once(repeats):
    """Compared with its own repeats no reading shows a step, and what the model misses at a pose is no step."""
    angles, points, noise = session(60 * repeats, 0)
    poses = np.repeat(np.arange(60), repeats)
    angles, points = angles[poses] + 1e-4 * np.hstack([noise, noise]), points[poses]
    missed = STD * np.random.default_rng(1).standard_normal((60, 3))[poses]
    assert examined(angles, points, noise + missed) is None
    step = 30 * repeats
    noise[step:] -= [0.05, 0.0, 0.0]
    found = examined(angles, points, noise + missed)
    assert found.kind == "step"
    assert found.first_row <= step <= found.last_row
    assert abs(found.row - step) <= repeats
    ramp = noise - np.linspace(0, 1, len(noise))[:, None] * [0.3, 0.0, 0.0]
    assert examined(angles, points, ramp).last_row == 60 * repeats - 1


def test_too_few_readings_say_nothing():
    angles, points, residuals = session(16, 0)
    residuals[8:] += 1.0
    assert examined(angles, points, residuals) is None


def test_points_that_never_vary_say_nothing():
    angles, points, _ = session(40, 0)
    assert examined(angles, points, np.zeros((40, 3))) is None


def test_the_interval_of_the_row_is_bais():
    """The distribution of the estimated row about the true one, Bai 1997, eq. 14: 97.5 % at the half width."""
    x = HALF_WIDTH
    G = (
        1
        + np.sqrt(x / (2 * np.pi)) * np.exp(-x / 8)
        - 0.5 * (x + 5) * norm.cdf(-np.sqrt(x) / 2)
        + 1.5 * np.exp(x) * norm.cdf(-1.5 * np.sqrt(x))
    )
    assert pytest.approx(0.975, abs=0.001) == G
