"""Constants identified from points: planted truth, its uncertainty, the rank known from theory, poor and odd data."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.arm import load_arm
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.alignment import align
from truearm.identification.references.reading_references import place_base_coarsely
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, Constant, Term, constants
from truearm.readings import Session

NOISE = 0.02  # mm


def poses(arm, n, rng, *, half_width=0.8):
    return arm.working + half_width * rng.uniform(-1, 1, (n, arm.n_joints))


def drawn(chain, rng, *, angle=1e-3, length=0.5):
    """The chain with constants of these standard deviations [rad, mm] at every place."""
    std = np.tile([angle] * 3 + [length] * 3, (chain.n_places, 1))
    return chain.with_motions(std * rng.normal(size=std.shape))


def found(arm, angles, points, terms=None, *, std=None, chain=None, robust=True):
    terms = constants(arm.chain, free=()) if terms is None else terms
    references = [Points(np.arange(len(angles)), points, std)]
    return identify(chain or arm.chain, ArmState(arm.chain, angles), terms, references, robust=robust)


def tips(fit, arm, angles):
    return fit.tips(ArmState(arm.chain, angles))


def mean_error(fit, arm, truth, angles):
    """Mean absolute coordinate error against the true chain [mm]."""
    return np.abs(tips(fit, arm, angles) - truth.tip_in_base(angles)).mean()


def test_planted_constants_are_recovered_to_the_noise(rng):
    arm = load_arm("gao2017")
    truth = drawn(arm.chain, rng)
    angles, others = poses(arm, 400, rng), poses(arm, 400, rng)
    fit = found(arm, angles, truth.tip_in_base(angles) + rng.normal(0, NOISE, (400, 3)))
    assert fit.converged
    assert fit.references[0].noise_std == pytest.approx(NOISE, rel=0.1)  # 1200 coordinates: 2 % at one sigma
    assert np.abs(arm.chain.tip_in_base(others) - truth.tip_in_base(others)).mean() > 0.5
    # 27 combinations of constants share 1200 noisy numbers.
    assert mean_error(fit, arm, truth, others) < NOISE * np.sqrt(27 / 1200) * 1.5


@pytest.mark.parametrize("start", [(3e-3, 3.0), (3e-4, 0.3), (3e-2, 30.0), (3e-2, 0.3)])
def test_the_scales_where_evidence_starts_hardly_matter(start, rng):
    arm = load_arm("gao2017")
    truth = drawn(arm.chain, rng)
    angles, others = poses(arm, 60, rng), poses(arm, 200, rng)
    points = truth.tip_in_base(angles) + rng.normal(0, NOISE, (60, 3))
    angle_std, length_std = start
    fit = found(arm, angles, points, constants(arm.chain, free=(), angle_std=angle_std, length_std=length_std))
    usual = found(arm, angles, points)
    error, known = (mean_error(one, arm, truth, others) for one in (fit, usual))
    assert error == pytest.approx(known, rel=0.05)
    assert usual.references[0].noise_std == pytest.approx(fit.references[0].noise_std, rel=0.02)


def test_planted_prior_scales_of_constants_are_recovered(rng):
    """Ten arms: rotations and lengths of each group come out of the size they were drawn with, within a factor of 2."""
    arm = load_arm("gao2017")
    sizes = []
    for _ in range(10):
        truth = drawn(arm.chain, rng, angle=2e-3, length=0.2)
        angles = poses(arm, 100, rng, half_width=1.5)
        fit = found(arm, angles, truth.tip_in_base(angles) + rng.normal(0, NOISE, (100, 3)))
        scales = {group.name: group.scale for group in fit.groups}
        sizes.append([3e-3 * scales["axis directions"], 3.0 * scales["lengths and offsets"]])
    np.testing.assert_array_less(np.abs(np.log2(np.median(sizes, axis=0) / [2e-3, 0.2])), 1)


@pytest.mark.parametrize(
    ("n", "arms"),
    [
        (12, 40),
        pytest.param(20, 40, marks=pytest.mark.weekly),
        pytest.param(60, 30, marks=pytest.mark.weekly),
        (300, 15),
    ],
)
def test_noise_and_stated_uncertainty_are_right_for_few_and_many_readings(n, arms, rng):
    """Over drawn arms: the noise found, and the squared error of a predicted tip in its covariance (chi-square, 3)."""
    arm = load_arm("gao2017")
    squares, noises = [], []
    for _ in range(arms):
        truth = drawn(arm.chain, rng)
        angles, others = poses(arm, n, rng), poses(arm, 1, rng)
        fit = found(arm, angles, truth.tip_in_base(angles) + rng.normal(0, NOISE, (n, 3)))
        assert fit.converged
        error = (tips(fit, arm, others) - truth.tip_in_base(others))[0]
        squares.append(error @ np.linalg.solve(fit.tip_covariance(ArmState(arm.chain, others))[0], error))
        noises.append(fit.references[0].noise_std)
    assert np.median(noises) == pytest.approx(NOISE, rel=0.5 if n < 20 else 0.15)  # 36 numbers, 27 of them used up
    # The mean of 40 chi-square(3) has standard deviation sqrt(6 / 40) = 0.39. Twelve readings leave nine numbers to
    # learn the noise from: its own uncertainty widens the tails, and the median (2.37) is the fairer witness.
    assert np.median(squares) == pytest.approx(2.37, abs=1.6)
    if n >= 60:
        assert np.mean(squares) == pytest.approx(3, abs=1.6)


def test_a_far_base_and_a_tip_on_a_bracket_are_identified(rng):
    """As on the UR10: a tracker metres off in any orientation, and a tip 0.3 m from where the drawing has it."""
    arm = load_arm("ur10")
    angles = poses(arm, 200, rng, half_width=1.5)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.4, -2.0, 1.1]).as_matrix()
    T[:3, 3] = [2500, -3100, 400]
    truth = arm.chain.with_tip(np.array([40.0, -90, 250])).with_reference_frame(T)
    points = truth.tip_in_base(angles)
    rough = place_base_coarsely(arm.chain, Session(angles, points), ("base", "tip"))
    terms = constants(arm.chain, angle_std=0.0, length_std=0.0)
    fit = found(arm, angles, points, terms, chain=rough)
    np.testing.assert_allclose(tips(fit, arm, angles), points, atol=1e-6)
    np.testing.assert_allclose(fit.chain.tip_in_flange, truth.tip_in_flange, atol=1e-5)


def test_a_sliding_joint_is_identified_as_well(rng):
    """Three joints that turn, two that slide: as good on new poses as the noise and 25 constants allow."""
    fixed = np.tile(np.eye(4), (6, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [20, 0, 150]
    arm = Arm("mixed", Chain(fixed, np.array([30.0, 0, 80]), np.array([False, True, False, True, False])))
    truth = drawn(arm.chain, rng)
    span = np.where(arm.chain.is_prismatic, 200.0, 1.2)  # mm, rad
    angles, others = span * rng.uniform(-1, 1, (200, 5)), span * rng.uniform(-1, 1, (200, 5))
    fit = found(arm, angles, truth.tip_in_base(angles) + rng.normal(0, NOISE, (200, 3)))
    assert fit.converged
    assert fit.references[0].noise_std == pytest.approx(NOISE, rel=0.15)
    assert np.abs(arm.chain.tip_in_base(others) - truth.tip_in_base(others)).mean() > 0.3
    assert mean_error(fit, arm, truth, others) < NOISE * np.sqrt(25 / 600) * 1.5


def test_gross_errors_weigh_little(rng):
    arm = load_arm("gao2017")
    truth = drawn(arm.chain, rng)
    angles, others = poses(arm, 300, rng), poses(arm, 300, rng)
    points = truth.tip_in_base(angles) + rng.normal(0, NOISE, (300, 3))
    points[::20] += rng.normal(0, 20, (15, 3))
    robust, careless = (found(arm, angles, points, robust=robust) for robust in (True, False))
    assert mean_error(robust, arm, truth, others) < NOISE / 2 < mean_error(careless, arm, truth, others)
    trust = robust.references[0].robust_weight
    assert (trust[::20] < 0.5).all()
    assert np.median(np.delete(trust, np.s_[::20])) == 1
    assert (careless.references[0].robust_weight == 1).all()


def test_poor_readings_do_not_harm_good_ones(rng):
    """Half of 200 readings at 1 mm, half at 0.01 mm: as good as the good half alone, within a tenth."""
    arm = load_arm("gao2017")
    std = np.where(np.arange(200)[:, None] % 2, 1.0, 0.01) * np.ones(3)
    good = std[:, 0] < 0.1
    ratios = []
    for _ in range(8):
        truth = drawn(arm.chain, rng)
        angles, others = poses(arm, 200, rng), poses(arm, 300, rng)
        points = truth.tip_in_base(angles) + std * rng.normal(size=(200, 3))
        every, few = (found(arm, angles[rows], points[rows], std=std[rows]) for rows in (np.full(200, True), good))
        ratios.append(mean_error(every, arm, truth, others) / mean_error(few, arm, truth, others))
    assert np.median(ratios) < 1.1


@pytest.mark.parametrize(("name", "joints"), [("gao2017", 6), ("measuring7", 7)])
def test_points_in_a_fitted_frame_determine_the_theoretical_number_of_combinations(name, joints, rng):
    """Rank 4 n - 3 from distances and 6 more from the frame: 27 for six revolute joints, 31 for seven.

    Everett, Driels, Mooring (1987): 4 R + 6 with a measured full pose; three of them, the orientation of the last
    frame, do not move a point. So a frame, the joints and a tip leave 4 n + 3.
    """
    arm = load_arm(name)
    angles = poses(arm, 200, rng, half_width=1.5)
    # An arm not quite as drawn: the tip of a drawn one may lie on its last axis, and axes may meet.
    chain = drawn(arm.chain, rng, angle=0.05, length=20)
    perturbed_chain = PerturbedChain(chain, tuple(constants(chain)))
    problem = SmallMotionProblem(
        perturbed_chain, ArmState(chain, angles), (Points(np.arange(200), chain.tip_in_base(angles)),)
    )
    (equations,) = problem.normal_equations(np.zeros(perturbed_chain.n_coefficients), [np.ones((3, 200))])
    scale = 1 / np.sqrt(equations.head.diagonal())
    values = np.linalg.eigvalsh(equations.head * np.outer(scale, scale))[::-1]
    rank = int((values > 1e-12 * values[0]).sum())
    assert rank == 4 * joints + 3
    assert values[rank] < 1e-3 * values[rank - 1]  # a clear gap


@pytest.mark.parametrize(("name", "joints"), [("gao2017", 6), ("measuring7", 7)])
def test_the_effective_number_of_parameters_is_that_rank(name, joints, rng):
    """With noise far below what was planted, the readings determine all that theory says they can."""
    arm = load_arm(name)
    truth = drawn(arm.chain, rng)
    angles = poses(arm, 300, rng, half_width=1.5)
    fit = found(arm, angles, truth.tip_in_base(angles) + rng.normal(0, 1e-4, (300, 3)), constants(arm.chain))
    assert sum(group.effective for group in fit.groups) == pytest.approx(4 * joints + 3, abs=0.5)


def test_without_free_parts_the_chain_is_unchanged_and_the_noise_estimated(rng):
    arm = load_arm("gao2017")
    angles = poses(arm, 300, rng)
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 0.05, (300, 3))
    fit = found(arm, angles, points, [])
    np.testing.assert_array_equal(tips(fit, arm, angles), arm.chain.tip_in_base(angles))
    assert fit.references[0].noise_std == pytest.approx(0.05, rel=0.1)
    assert fit.covariance.shape == (0, 0)
    assert not fit.tip_covariance(ArmState(arm.chain, angles)).any()


def test_exact_points_are_fitted_exactly(rng):
    arm = load_arm("gao2017")
    angles = poses(arm, 50, rng)
    points = arm.chain.tip_in_base(angles)
    fit = found(arm, angles, points)
    np.testing.assert_allclose(tips(fit, arm, angles), points, atol=1e-6)
    truth = drawn(arm.chain, rng)
    fit = found(arm, angles, truth.tip_in_base(angles))
    np.testing.assert_allclose(tips(fit, arm, angles), truth.tip_in_base(angles), atol=1e-4)  # mm: a tenth of a micron


def test_the_order_of_readings_does_not_matter(rng):
    arm = load_arm("gao2017")
    truth = drawn(arm.chain, rng)
    angles, others = poses(arm, 80, rng), poses(arm, 20, rng)
    points = truth.tip_in_base(angles) + rng.normal(0, NOISE, (80, 3))
    shuffled = rng.permutation(80)
    one, other = found(arm, angles, points), found(arm, angles[shuffled], points[shuffled])
    np.testing.assert_allclose(tips(one, arm, others), tips(other, arm, others), atol=1e-6)
    np.testing.assert_allclose(one.references[0].robust_weight[shuffled], other.references[0].robust_weight, atol=1e-6)


def test_the_position_of_the_reference_does_not_matter(rng):
    """The same readings in another frame: the same predictions, carried along, to a thousandth of the noise."""
    arm = load_arm("gao2017")
    truth = drawn(arm.chain, rng)
    angles, others = poses(arm, 60, rng), poses(arm, 20, rng)
    points = truth.tip_in_base(angles) + rng.normal(0, NOISE, (60, 3))
    R, shift = Rotation.from_rotvec([2.0, -0.3, 0.5]).as_matrix(), [-4000.0, 900, 1700]
    here, there = [
        found(arm, angles, p, constants(arm.chain), chain=place_base_coarsely(arm.chain, Session(angles, p), ("base",)))
        for p in (points, points @ R.T + shift)
    ]
    np.testing.assert_allclose(tips(here, arm, others) @ R.T + shift, tips(there, arm, others), atol=1e-3 * NOISE)


@pytest.mark.parametrize(
    "case", ["one pose", "one joint moved", "four readings", "all points alike", "two poses", "a unit mistaken"]
)
def test_undetermined_parameters_keep_their_prior(case, rng):
    """No warnings, finite numbers, and a covariance that is one; far away the uncertainty is larger than there."""
    arm = load_arm("gao2017")
    angles = poses(arm, 40, rng)
    if case == "one pose":
        angles = np.repeat(angles[:1], 40, axis=0)
    elif case == "two poses":
        angles = np.repeat(angles[:2], 20, axis=0)
    elif case == "one joint moved":
        angles[:, :5] = angles[0, :5]
    elif case == "four readings":
        angles = angles[:4]
    points = drawn(arm.chain, rng).tip_in_base(angles) + rng.normal(0, NOISE, (len(angles), 3))
    if case == "all points alike":
        points[:] = points[0]
    elif case == "a unit mistaken":
        points *= 1e3
    rough = place_base_coarsely(arm.chain, Session(angles, points), ("base", "tip"))
    fit = found(arm, angles, points, constants(arm.chain), chain=rough)
    state = ArmState(arm.chain, np.concatenate([angles, angles + 1.5]))
    assert np.isfinite(fit.tips(state)).all()
    covariance = fit.tip_covariance(state)
    values = np.linalg.eigvalsh(covariance)
    assert (values > -1e-9 * values.max()).all()
    n = len(angles)
    if case in ("one pose", "two poses", "one joint moved", "four readings"):
        assert np.trace(covariance[n:].mean(axis=0)) > 3 * np.trace(covariance[:n].mean(axis=0))


def test_a_tip_is_at_least_as_certain_as_by_one_reading(rng):
    """On an arm of few joints, base and tip can move by decimetres unseen: tips are known all the same.

    The covariance of a point that was read is below that of its noise, in every direction.
    """
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [20, 0, 100]
    arm = Arm("few", Chain(fixed, np.array([0, 0, 50.0]), np.array([False, True, False])))
    truth = drawn(arm.chain, rng, angle=1e-3, length=0.2)
    angles = rng.uniform(-1, 1, (80, 3)) * [1, 40, 1]
    points = truth.tip_in_base(angles) + rng.normal(0, 0.01, (80, 3))
    fit = found(arm, angles, points, constants(arm.chain))
    assert np.sqrt(fit.covariance.diagonal().max()) > 100  # mm
    noise = fit.references[0].noise_std ** 2 / fit.references[0].robust_weight
    largest = np.linalg.eigvalsh(fit.tip_covariance(ArmState(arm.chain, angles)))[:, -1]
    assert (largest < 1.001 * noise).all()
    effective = sum(group.effective for group in fit.groups)
    traces = np.trace(fit.tip_covariance(ArmState(arm.chain, angles)), axis1=1, axis2=2)
    assert (traces / noise).sum() == pytest.approx(effective, rel=0.05)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(4, 12))
def test_any_arm_and_any_readings_give_finite_numbers(seed, n_joints, n):
    """Chains of any shape, axes that meet or run parallel, sliding joints; points that no such arm can have made."""
    rng = np.random.default_rng(seed)
    fixed = np.tile(np.eye(4), (n_joints + 1, 1, 1))
    for frame in fixed[1:]:
        frame[:3, :3] = Rotation.from_rotvec(rng.choice([0, np.pi / 2, np.pi], 3)).as_matrix()
        frame[:3, 3] = rng.choice([0, 0, 100, 1000], 3)
    chain = Chain(fixed, rng.choice([0.0, 50], 3), rng.random(n_joints) < 0.3)
    angles = np.where(chain.is_prismatic, 100, 1) * rng.uniform(-3, 3, (n, n_joints))
    angles *= rng.choice([0, 1], n_joints)  # some joints stand still
    points = chain.tip_in_base(angles) + rng.choice([0, 1e-3, 1, 100]) * rng.normal(size=(n, 3))
    fit = found(Arm("any", chain), angles, points, constants(chain, free=("base", "tip")[: int(rng.integers(3))]))
    assert np.isfinite(fit.coefficients).all()
    assert fit.references[0].noise_std > 0
    assert fit.references[0].residuals.shape == (3, n)
    state = ArmState(chain, angles)
    assert np.isfinite(fit.tips(state)).all()
    variances = np.linalg.eigvalsh(fit.tip_covariance(state))
    assert (variances > -1e-9 * max(1.0, variances.max())).all()
    # Without weights it is no worse than the drawing on the readings it learned from.
    fit = found(Arm("any", chain), angles, points, constants(chain), robust=False)
    before = np.sqrt(((chain.tip_in_base(angles) - points) ** 2).mean())
    assert np.sqrt(((fit.tips(state) - points) ** 2).mean()) <= before + 1e-6


def test_invalid_references_are_refused(rng):
    arm = load_arm("gao2017")
    angles = poses(arm, 10, rng)
    points = Points(np.arange(10), arm.chain.tip_in_base(angles))
    state, terms = ArmState(arm.chain, angles), constants(arm.chain)
    refuses("expected references, one of a kind, got none", identify, arm.chain, state, terms, [])
    refuses(r"one of a kind, got \['point', 'point'\]", identify, arm.chain, state, terms, [points, points])
    turns = (0.0, 0, 1, 0, 0, 0)
    both = [Term(f"J{i}", i, turns, Constant(), "zeros", 1e-3, learn=i == 1) for i in (1, 2)]
    refuses("group 'zeros' must have the same value of learn", identify, arm.chain, state, both, [points])


@settings(max_examples=50)
@given(st.integers(0, 10**6))
def test_alignment_finds_any_rigid_motion(seed):
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = rng.uniform(-5000, 5000, 3)
    points_in_b = rng.uniform(-500, 500, (int(rng.integers(3, 30)), 3))
    points_in_a = points_in_b @ T[:3, :3].T + T[:3, 3]
    aligned = align(points_in_b, points_in_a)
    np.testing.assert_allclose(points_in_b @ aligned[:3, :3].T + aligned[:3, 3], points_in_a, atol=1e-8)
    assert np.linalg.det(aligned[:3, :3]) == pytest.approx(1)


def test_alignment_of_mirrored_points_is_still_a_rotation(rng):
    points = rng.normal(size=(20, 3))
    assert np.linalg.det(align(points, points * [1, 1, -1])[:3, :3]) == pytest.approx(1)


def test_a_chain_is_placed_by_the_readings_that_have_points(rng):
    arm = load_arm("gao2017")
    angles = poses(arm, 20, rng)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.0, 0, 1.0]).as_matrix()
    T[:3, 3] = [100.0, 200, 300]
    points = arm.chain.with_reference_frame(T).tip_in_base(angles)
    points[5:] = np.nan
    placed = place_base_coarsely(arm.chain, Session(angles, points), ("base",))
    np.testing.assert_allclose(placed.tip_in_base(angles[:5]), points[:5], atol=1e-8)
    assert place_base_coarsely(arm.chain, Session(angles, points), ("tip",)) is arm.chain
    assert place_base_coarsely(arm.chain, Session(angles), ("base",)) is arm.chain
