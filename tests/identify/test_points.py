"""Identification from points: derivatives, planted truth, its uncertainty, weights, and the rank known from theory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from truearm.arm import load
from truearm.identify.alignment import align
from truearm.identify.noise import HUBER_STDS, huber_weights, unexplained_variance
from truearm.identify.points import PointProblem, fit_points

FREE_BASE = (1.0, 1, 1, 1e4, 1e4, 1e4)


def constants(chain, *, angle=3e-3, length=3.0):
    prior_std = np.tile([angle] * 3 + [length] * 3, (chain.n_places, 1))
    prior_std[-1, :3] = 0
    return prior_std


def poses(arm, n, rng, *, half_width=0.8):
    return arm.working + half_width * rng.uniform(-1, 1, (n, arm.n_joints))


@pytest.mark.parametrize("name", ["gao2017", "measuring7", "ur10"])
def test_gradient_and_matrix_against_difference_quotients(name, rng):
    """At motions far from zero (0.1 rad, 50 mm), where a first-order formula would show."""
    arm = load(name)
    angles = poses(arm, 12, rng)
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 5, (12, 3))
    problem = PointProblem(arm.chain, angles, points, rng.uniform(0.5, 2, (12, 3)), constants(arm.chain))
    x = rng.normal(size=int(problem.free.sum())) * np.where(np.nonzero(problem.free)[1] < 3, 0.1, 50)
    equations = problem.normal_equations(x)
    assert equations.cost == pytest.approx(problem.cost(x), rel=1e-12)
    h = np.where(np.nonzero(problem.free)[1] < 3, 1e-6, 1e-3)  # rad, mm: truncation and rounding both below 1e-7
    for p, step in enumerate(np.diag(h)):
        quotient = (problem.cost(x + step) - problem.cost(x - step)) / (2 * h[p])
        assert equations.gradient[p] == pytest.approx(quotient, rel=1e-5, abs=1e-6 * np.abs(equations.gradient).max())

    def whitened(x):
        residuals = problem.chain.with_motions(problem.motions(x)).tip_in_base(angles) - points
        return np.concatenate([(problem.weights * residuals).ravel(), x / problem.prior_std[problem.free]])

    J = np.stack([(whitened(x + s) - whitened(x - s)) / (2 * h[p]) for p, s in enumerate(np.diag(h))], axis=1)
    scale = np.linalg.norm(J, axis=0)
    np.testing.assert_allclose(equations.gram / np.outer(scale, scale), (J.T @ J) / np.outer(scale, scale), atol=1e-6)


def test_planted_constants_are_recovered_to_the_noise(rng):
    arm = load("gao2017")
    prior_std = constants(arm.chain, angle=1e-3, length=0.5)
    truth = arm.chain.with_motions(prior_std * rng.normal(size=prior_std.shape))
    angles, others = poses(arm, 400, rng), poses(arm, 400, rng)
    points = truth.tip_in_base(angles) + rng.normal(0, 0.02, (400, 3))
    fit = fit_points(arm.chain, angles, points, prior_std=prior_std)
    assert fit.converged
    assert fit.noise_std == pytest.approx(0.02, rel=0.1)  # 1200 coordinates: 2 % at one sigma
    before = np.abs(arm.chain.tip_in_base(others) - truth.tip_in_base(others)).mean()
    after = np.abs(fit.chain.tip_in_base(others) - truth.tip_in_base(others)).mean()
    assert before > 0.5
    assert after < 0.02 * np.sqrt(45 / 1200) * 1.5  # 45 parameters share 1200 noisy numbers


@pytest.mark.parametrize(("n", "arms"), [(12, 40), (20, 40), (60, 40), (300, 20)])
def test_noise_and_stated_uncertainty_are_right_for_few_and_many_readings(n, arms, rng):
    """Over drawn arms: the noise found, and the squared error of a predicted tip in its covariance (chi-square, 3)."""
    arm = load("gao2017")
    prior_std = constants(arm.chain, angle=1e-3, length=0.5)
    squares, noises = [], []
    for _ in range(arms):
        truth = arm.chain.with_motions(prior_std * rng.normal(size=prior_std.shape))
        angles, others = poses(arm, n, rng), poses(arm, 1, rng)
        points = truth.tip_in_base(angles) + rng.normal(0, 0.02, (n, 3))
        fit = fit_points(arm.chain, angles, points, prior_std=prior_std)
        assert fit.converged
        columns = fit.chain.small_motions(others).by_motion.reshape(1, -1, 3)[0]
        error = (fit.chain.tip_in_base(others) - truth.tip_in_base(others))[0]
        squares.append(error @ np.linalg.solve(columns.T @ fit.covariance @ columns, error))
        noises.append(fit.noise_std)
    assert np.median(noises) == pytest.approx(0.02, rel=0.5 if n < 20 else 0.15)  # 36 numbers, 27 of them used up
    # The mean of 40 chi-square(3) has standard deviation sqrt(6 / 40) = 0.39. Twelve readings leave nine numbers to
    # learn the noise from: its own uncertainty widens the tails, and the median (2.37) is the fairer witness.
    assert np.median(squares) == pytest.approx(2.37, abs=1.6)
    if n >= 60:
        assert np.mean(squares) == pytest.approx(3, abs=1.6)


def test_base_far_away_and_tip_on_a_bracket_are_found(rng):
    """As on the UR10: a tracker metres off in any orientation, and a tip 0.3 m from where the drawing has it."""
    arm = load("ur10")
    angles = poses(arm, 200, rng, half_width=1.5)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.4, -2.0, 1.1]).as_matrix()
    T[:3, 3] = [2500, -3100, 400]
    truth = arm.chain.with_tip(np.array([40.0, -90, 250])).placed(T)
    points = truth.tip_in_base(angles)
    prior_std = np.zeros((arm.chain.n_places, 6))
    prior_std[0], prior_std[-1, 3:] = FREE_BASE, 1e3
    rough = arm.chain.placed(align(arm.chain.tip_in_base(angles), points))
    fit = fit_points(rough, angles, points, prior_std=prior_std)
    np.testing.assert_allclose(fit.chain.tip_in_base(angles), points, atol=1e-6)
    np.testing.assert_allclose(fit.chain.tip_in_flange, truth.tip_in_flange, atol=1e-5)


def test_gross_errors_weigh_little(rng):
    arm = load("gao2017")
    prior_std = constants(arm.chain, angle=1e-3, length=0.5)
    truth = arm.chain.with_motions(prior_std * rng.normal(size=prior_std.shape))
    angles, others = poses(arm, 300, rng), poses(arm, 300, rng)
    points = truth.tip_in_base(angles) + rng.normal(0, 0.02, (300, 3))
    points[::20] += rng.normal(0, 20, (15, 3))

    def error(**options):
        fit = fit_points(arm.chain, angles, points, prior_std=prior_std, **options)
        return fit, np.abs(fit.chain.tip_in_base(others) - truth.tip_in_base(others)).mean()

    robust, with_weights = error()
    _, without = error(robust=False)
    assert with_weights < 0.02 < without
    assert (robust.weights[::20] < 0.5).mean() > 0.8
    assert np.median(np.delete(robust.weights, np.s_[::20])) == 1


def test_poor_readings_do_no_harm_beside_good_ones(rng):
    """Half of 200 readings at 1 mm, half at 0.01 mm: as good as the good half alone, within a tenth."""
    arm = load("gao2017")
    prior_std = constants(arm.chain, angle=1e-3, length=0.5)
    point_std = np.where(np.arange(200)[:, None] % 2, 1.0, 0.01) * np.ones(3)
    good = point_std[:, 0] < 0.1
    ratios = []
    for _ in range(8):
        truth = arm.chain.with_motions(prior_std * rng.normal(size=prior_std.shape))
        angles, others = poses(arm, 200, rng), poses(arm, 300, rng)
        points = truth.tip_in_base(angles) + point_std * rng.normal(size=(200, 3))

        def error(rows, angles=angles, points=points, others=others, truth=truth):
            fit = fit_points(
                arm.chain, angles[rows], points[rows], prior_std=prior_std, point_std=point_std[rows], robust=True
            )
            return np.abs(fit.chain.tip_in_base(others) - truth.tip_in_base(others)).mean()

        ratios.append(error(np.full(200, True)) / error(good))
    assert np.median(ratios) < 1.1


@pytest.mark.parametrize(("name", "joints"), [("gao2017", 6), ("measuring7", 7)])
def test_points_in_a_fitted_frame_determine_as_many_combinations_as_theory_says(name, joints, rng):
    """Rank 4 n - 3 from distances and 6 more from the frame: 27 for six revolute joints, 31 for seven.

    Everett, Driels, Mooring (1987): 4 R + 6 with a measured full pose; three of them, the orientation of the last
    frame, do not move a point. So a frame, the joints and a tip leave 4 n + 3.
    """
    arm = load(name)
    angles = poses(arm, 200, rng, half_width=1.5)
    problem = PointProblem(
        arm.chain, angles, arm.chain.tip_in_base(angles), np.ones((200, 3)), constants(arm.chain, angle=1e9, length=1e9)
    )
    gram = problem.normal_equations(np.zeros(int(problem.free.sum()))).gram
    scale = 1 / np.sqrt(gram.diagonal())
    values = np.linalg.eigvalsh(gram * np.outer(scale, scale))[::-1]
    rank = int((values > 1e-12 * values[0]).sum())
    assert rank == 4 * joints + 3
    assert values[rank] < 1e-3 * values[rank - 1]  # a clear gap


def test_nothing_free_leaves_the_chain_and_measures_the_noise(rng):
    arm = load("gao2017")
    angles = poses(arm, 300, rng)
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 0.05, (300, 3))
    fit = fit_points(arm.chain, angles, points, prior_std=np.zeros((arm.chain.n_places, 6)))
    assert fit.chain is arm.chain
    assert fit.noise_std == pytest.approx(0.05, rel=0.1)
    assert not fit.covariance.any()


def test_exact_points_are_fitted_exactly(rng):
    arm = load("gao2017")
    angles = poses(arm, 50, rng)
    fit = fit_points(arm.chain, angles, arm.chain.tip_in_base(angles), prior_std=constants(arm.chain))
    np.testing.assert_allclose(fit.motions, 0, atol=1e-9)


def test_huber_weights_by_hand():
    residuals = np.zeros((4, 3))
    residuals[:, 0] = [1, 4, 8, 8]
    variance = np.ones((4, 3))
    variance[3] = 4  # the same residual at twice the standard deviation is ordinary
    np.testing.assert_allclose(huber_weights(residuals, variance), [1, 1, HUBER_STDS / 8, 1])


@pytest.mark.parametrize("robust", [False, True])
def test_unexplained_variance_of_gaussian_residuals(robust, rng):
    """Half the references poor (1 mm), half good (0.01 mm), 0.05 mm unexplained: the good half tells it."""
    reference_variance = np.where(np.arange(4000)[:, None] % 2, 1.0, 1e-4) * np.ones(3)
    residuals = np.sqrt(reference_variance + 0.05**2) * rng.normal(size=(4000, 3))
    found = unexplained_variance(residuals, reference_variance, n_effective=0, robust=robust)
    # 6000 good coordinates: the variance to 2 sqrt(2/6000) = 4 % at two sigma, and the poor ones add some
    assert found == pytest.approx(0.05**2, rel=0.15)
    nothing = unexplained_variance(
        np.sqrt(reference_variance) * rng.normal(size=(4000, 3)) * 0.9, reference_variance, n_effective=0, robust=robust
    )
    assert np.sqrt(nothing) == pytest.approx(1e-6)  # mm: the floor


def test_gross_errors_hardly_raise_the_unexplained_variance(rng):
    residuals = 0.05 * rng.normal(size=(1000, 3))
    residuals[::20] = 1000
    found = unexplained_variance(residuals, np.zeros((1000, 3)), n_effective=0, robust=True)
    assert np.sqrt(found) < 0.05 * 1.25  # five in a hundred, each counting 16 instead of 3: 12 % of spread
    assert np.sqrt(unexplained_variance(residuals, np.zeros((1000, 3)), n_effective=0, robust=False)) > 100


def test_parameters_take_their_share_of_the_freedom(rng):
    """Ten free parameters of thirty numbers: what is left over is a third smaller than the noise says."""
    left_over = 0.05 * rng.normal(size=(2000, 3)) * np.sqrt(2 / 3)
    found = unexplained_variance(left_over, np.zeros((2000, 3)), n_effective=2000, robust=False)
    assert np.sqrt(found) == pytest.approx(0.05, rel=0.04)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6))
def test_alignment_finds_any_rigid_motion(seed):
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = rng.uniform(-5000, 5000, 3)
    points_in_b = rng.uniform(-500, 500, (int(rng.integers(3, 30)), 3))
    points_in_a = points_in_b @ T[:3, :3].T + T[:3, 3]
    found = align(points_in_b, points_in_a)
    np.testing.assert_allclose(points_in_b @ found[:3, :3].T + found[:3, 3], points_in_a, atol=1e-8)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)


def test_alignment_of_mirrored_points_is_still_a_rotation(rng):
    points = rng.normal(size=(20, 3))
    assert np.linalg.det(align(points, points * [1, 1, -1])[:3, :3]) == pytest.approx(1)


def test_weights_of_a_problem_scale_its_matrix(rng):
    arm = load("gao2017")
    angles = poses(arm, 20, rng)
    points = arm.chain.tip_in_base(angles) + 1.0
    problem = PointProblem(arm.chain, angles, points, np.ones((20, 3)), constants(arm.chain, angle=1e6, length=1e6))
    x = np.zeros(int(problem.free.sum()))
    once = problem.normal_equations(x)
    twice = replace(problem, weights=2 * problem.weights).normal_equations(x)
    np.testing.assert_allclose(twice.gram, 4 * once.gram, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(twice.gradient, 4 * once.gradient, rtol=1e-9)
