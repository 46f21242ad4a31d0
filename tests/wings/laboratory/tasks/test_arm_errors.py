"""Errors of a measured point: what belongs to the arm, what to the point, and how large each is."""

from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.arm.chain import Chain
from truearm.identification.estimation.residual_variance import few_readings_factor
from truearm.identification.judgement.repeating_residuals import JOINT_VARIANCE_SHARE, ORDER, JointProcess
from truearm.identification.references.references import Points
from truearm.identification.terms import Constant
from truearm.models import KinematicModel, NetworkModel
from truearm.readings.session import Session
from truearm.wings.laboratory.tasks import sampled_arms
from truearm.wings.laboratory.tasks.sampled_arms import PoseField, PosteriorDistribution, PresetDistribution
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset
from truearm.wings.planning.virtual.presets import ARCSEC, PERFECT, SHOP, Preset

ARM = load_arm("gao2017")
POSES = measuring_poses(ARM, 30, seed=5).angles


@pytest.fixture(scope="module")
def model():
    """A kinematic model of a shop arm, of 60 readings."""
    virtual = VirtualArm.draw(ARM, load_preset("shop"), seed=3)
    return KinematicModel(ARM).fit_readings(virtual.measure(measuring_poses(ARM, 60, seed=3).angles, seed=3).readings)


# A preset -------------------------------------------------------------------------------------------------------------


def test_a_perfect_arm_has_no_errors(rng):
    drawn = PresetDistribution(ARM, PERFECT).draw(1)
    assert np.abs(drawn.systematic(POSES)).max() < 1e-9  # mm, rounding
    assert np.abs(drawn.random(POSES, rng)).max() == 0


def test_systematic_errors_are_the_arm_s_and_random_ones_the_point_s():
    one, again, other = (PresetDistribution(ARM, SHOP).draw(seed) for seed in (1, 1, 2))
    assert np.array_equal(one.systematic(POSES), again.systematic(POSES))
    assert not np.allclose(one.systematic(POSES), other.systematic(POSES), atol=1e-4)
    first, second = (one.random(POSES, np.random.default_rng(seed)) for seed in (1, 2))
    assert not np.allclose(first, second, atol=1e-4)


def test_errors_of_geometry_are_what_is_shown_less_what_is_true():
    drawn = PresetDistribution(ARM, Preset(length_std_mm=0.1, angle_std_deg=0.01)).draw(4)
    expected = ARM.chain.tip_in_base(POSES) - drawn.virtual.true_tip(POSES)
    assert np.abs(drawn.systematic(POSES) - expected).max() < 1e-12
    assert np.abs(expected).max() > 0.05


def test_the_mean_force_is_in_the_qualified_stylus(rng):
    """The same force every time along the stylus: it is part of the tip's offset, and no error is left."""
    pressed = Preset(tip_compliance_um_per_N=10.0, force_mean_N=3.0)
    drawn = PresetDistribution(ARM, pressed).draw(1)
    assert np.abs(drawn.systematic(POSES)).max() < 1e-9  # mm, rounding
    assert np.abs(drawn.random(POSES, rng)).max() < 1e-9
    unsteady = PresetDistribution(ARM, replace(pressed, force_std_N=0.5)).draw(1).random(POSES, rng)
    along = 0.5 * 10.0 * 1e-3  # mm, a standard deviation along the stylus
    assert np.linalg.norm(unsteady, axis=1).std() < 2 * along
    assert np.sqrt((unsteady**2).sum(axis=1).mean()) == pytest.approx(along, rel=0.5)


def test_white_encoder_noise_and_contact_have_the_size_that_derivatives_give(rng):
    pose = np.repeat(POSES[:1], 4000, axis=0)
    noisy = PresetDistribution(ARM, Preset(encoder_noise_arcsec=2.0)).draw(1).random(pose, rng)
    J = ARM.chain.tip_derivatives(POSES[:1]).motion_jacobian[0, 1:-1, 2]
    expected = 2.0 * ARCSEC * np.sqrt((J**2).sum(axis=0))
    assert noisy.std(axis=0) == pytest.approx(expected, rel=0.05)  # 4000 draws: 1.1 % a standard deviation
    touched = PresetDistribution(ARM, Preset(seat_std_mm=0.004)).draw(1).random(pose, rng)
    assert touched.std(axis=0) == pytest.approx(np.full(3, 0.004), rel=0.05)


def test_encoder_steps_are_even_over_a_step(rng):
    counts = 2.0**16
    pose = np.repeat(POSES[:1], 4000, axis=0)
    found = PresetDistribution(ARM, Preset(encoder_counts=counts)).draw(1).random(pose, rng)
    J = ARM.chain.tip_derivatives(POSES[:1]).motion_jacobian[0, 1:-1, 2]
    expected = 2 * np.pi / counts / np.sqrt(12) * np.sqrt((J**2).sum(axis=0))
    assert found.std(axis=0) == pytest.approx(expected, rel=0.05)


# A model --------------------------------------------------------------------------------------------------------------


def test_draws_from_a_model_have_its_covariance(model):
    known = PosteriorDistribution(model)
    drawn = np.array([known.draw(seed).systematic(POSES) for seed in range(600)])
    of_parameters, unexplained = model.covariance_parts(Session(POSES))
    share = known.relative_std(POSES)[:, 0] ** 2
    assert (known.displacements(POSES) ** 2).sum(axis=(1, 2)) / 3 == pytest.approx(
        share * known.field_std_mm**2, rel=1e-9
    )
    of_terms = known.birge_ratio**2 * np.trace(of_parameters, axis1=1, axis2=2) / 3
    expected = of_terms + share * known.field_std_mm**2
    found = (drawn**2).mean(axis=(0, 2))
    assert found == pytest.approx(expected, rel=0.25)  # 600 draws of three coordinates: 4 % a standard deviation
    assert found.mean() == pytest.approx(expected.mean(), rel=0.1)
    total = known.field_std_mm**2 + known.random_std_mm**2
    assert share * total == pytest.approx(unexplained[:, 0, 0], rel=1e-9)
    # Where joints move the tip most and least, the mean over the poses.
    M = known.displacements(POSES)
    own, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", M, M))
    of_parameters = known.R_base_reference @ of_parameters @ known.R_base_reference.T
    along = known.birge_ratio**2 * np.einsum("nia,nij,nja->na", axes, of_parameters, axes) + own
    found = (np.einsum("nia,mni->mna", axes, drawn) ** 2).mean(axis=(0, 1))
    assert found == pytest.approx(along.mean(axis=0), rel=0.1)
    assert own[:, 2].mean() > 1.5 * own[:, 0].mean()


def test_the_posterior_is_widened_to_what_readings_held_out_show(model):
    points = model.fit_.references[0]
    stated = points.std**2
    # Few readings widen the covariance and what is unexplained alike: that is not shown by held-out readings.
    freedom = model.fit_.residual_freedom([Points(points.rows, np.zeros((len(points.rows), 3)))])
    shown = stated + model.residual_std_**2 / few_readings_factor(freedom)
    expected = np.sqrt((shown / (stated + points.noise_std**2)).mean())
    # FLOOR_MM2, a nanometre squared, is added to both.
    assert PosteriorDistribution(model).birge_ratio == pytest.approx(max(1.0, expected), rel=1e-6)
    assert PosteriorDistribution(model).birge_ratio < 2


def test_a_drawn_model_is_the_same_at_the_same_pose(model):
    known = PosteriorDistribution(model)
    drawn = known.draw(7)
    assert np.array_equal(drawn.systematic(POSES), drawn.systematic(POSES))
    assert np.array_equal(drawn.systematic(POSES)[:5], known.draw(7).systematic(POSES)[:5].copy())


def test_small_shifts_to_first_order_are_the_exact_ones(model, monkeypatch):
    known = PosteriorDistribution(model)
    shift = known.draw(2).shift
    first = known.tip_shift(POSES, shift)
    assert np.abs(first).max() < sampled_arms.LINEAR_MM
    monkeypatch.setattr(sampled_arms, "LINEAR_MM", 0.0)
    exact = PosteriorDistribution(model).tip_shift(POSES, shift)
    # Terms that cancel to first order are off by up to 1 mrad each: to second order that is 1e-6 of a metre.
    assert np.abs(first - exact).max() < 1e-3
    assert np.abs(first - exact).max() < 0.1 * np.abs(first).max()


def test_large_shifts_are_composed_exactly(model):
    """A base turned by two degrees takes all points along: no length changes, as it would to first order."""
    known = PosteriorDistribution(model)
    shift = np.zeros(len(model.fit_.coefficients))
    start = 0
    for term in model.fit_.perturbed_chain.terms:
        is_constant = isinstance(term.basis, Constant)
        if is_constant and term.place == 0 and term.direction == (0.0, 0.0, 1.0, 0.0, 0.0, 0.0):
            shift[start] = 0.035
        start += term.n_coefficients
    assert shift.any()
    moved = known.tip_shift(POSES, shift)
    assert np.abs(moved).max() > 10
    tips = ARM.chain.tip_in_base(POSES)
    shown = model.fit_.tips(known.state(POSES))
    assert np.linalg.norm(tips, axis=1).shape == (len(POSES),)
    before = np.linalg.norm(shown[1:] - shown[:-1], axis=1)
    after = np.linalg.norm(np.diff(shown - moved, axis=0), axis=1)
    assert np.abs(after - before).max() < 1e-6


def test_errors_are_given_in_the_arm_s_frame():
    """The reference sees the arm turned: what is systematic comes out along the arm's own axes."""
    virtual = VirtualArm.draw(ARM, load_preset("shop"), seed=3)
    readings = virtual.measure(measuring_poses(ARM, 60, seed=3).angles, seed=3).readings
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = KinematicModel(ARM).fit_readings(replace(readings, points=readings.points @ R.T + [5.0, -200.0, 30.0]))
    assert PosteriorDistribution(turned).R_base_reference == pytest.approx(R.T, abs=1e-3)


def test_a_measured_repeatability_replaces_the_scatter(model):
    known = PosteriorDistribution(model, 0.001)
    assert known.random_std_mm == 0.001
    assert known.field_std_mm == pytest.approx(np.sqrt(model.residual_std_**2 - 1e-6))


@pytest.mark.parametrize("repeatability", [-0.001, np.nan, np.inf, 1.0])
def test_an_impossible_repeatability_is_refused(model, repeatability):
    refuses("repeatability", PosteriorDistribution, model, repeatability)


def test_a_network_is_refused_with_what_to_do():
    assert "kinematic or physical" in refuses("network", PosteriorDistribution, NetworkModel(ARM)).hint


# The field ------------------------------------------------------------------------------------------------------------


def test_a_field_has_its_size_and_its_correlation():
    """exp(-16 (1 - cos d)) between two poses that differ by d in one joint; over a full turn it is the same again."""
    d = 0.2
    pose = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])
    poses = np.concatenate([pose, pose + [d, 0, 0, 0, 0, 0], pose + [0, 0, 2 * np.pi, 0, 0, 0], pose])
    rng = np.random.default_rng(1)
    drawn = np.array([PoseField.draw(ARM.chain, ORDER, rng).at(poses) for _ in range(4500)])
    near, beyond, turned, again = (drawn[:, i].ravel() for i in range(4))
    assert near.std() == pytest.approx(1.0, rel=0.05)  # 4500 numbers: 1.1 % a standard deviation
    assert np.corrcoef(near, beyond)[0, 1] == pytest.approx(np.exp(-16 * (1 - np.cos(d))), abs=0.04)
    assert np.abs(near - turned).max() < 1e-10
    assert np.abs(near - again).max() < 1e-12  # of waves of order 1: rounding


def test_a_joint_that_turns_moves_the_tip_across_its_lever():
    """By hand: tip 100 mm from the axis z, at right angles to it the joint's part, three times a coordinate's own."""
    chain = Chain(np.stack([np.eye(4), np.eye(4)]), [100.0, 0.0, 20.0])
    by_joint, *even = JointProcess(chain).unit_displacements(np.array([[0.0]]))[0]
    assert by_joint == pytest.approx([0.0, np.sqrt(3 * JOINT_VARIANCE_SHARE), 0.0], abs=1e-12)
    assert np.array(even) == pytest.approx(np.sqrt(1 - JOINT_VARIANCE_SHARE) * np.eye(3), abs=1e-12)
    quarter = JointProcess(chain).unit_displacements(np.array([[np.pi / 2]]))[0, 0]
    assert quarter == pytest.approx([-np.sqrt(3 * JOINT_VARIANCE_SHARE), 0.0, 0.0], abs=1e-12)


def test_joints_share_by_their_levers_and_sliding_ones_by_the_reach():
    """Turning about z, tip 300 mm away along x, then sliding along z: a third of the reach counts as a radian."""
    outward = np.eye(4)
    outward[0, 3] = 300.0
    chain = Chain(np.stack([np.eye(4), outward, np.eye(4)]), np.zeros(3), np.array([False, True]))
    assert chain.reach == 300.0
    turning, sliding, *_ = JointProcess(chain).unit_displacements(np.zeros((1, 2)))[0] / np.sqrt(
        3 * JOINT_VARIANCE_SHARE
    )
    assert turning == pytest.approx([0.0, 3 / np.sqrt(10), 0.0])
    assert sliding == pytest.approx([0.0, 0.0, 1 / np.sqrt(10)])


def test_a_tip_that_no_joint_moves_has_finite_errors():
    chain = Chain(np.stack([np.eye(4), np.eye(4)]), [0.0, 0.0, 20.0])
    assert JointProcess(chain).unit_displacements(np.zeros((1, 1)))[0, 0] == pytest.approx(np.zeros(3))


def test_joints_parts_of_an_arm_are_as_its_chain_s_derivatives():
    joints = JointProcess(ARM.chain).unit_displacements(POSES)[:, :-3]
    J = ARM.chain.tip_derivatives(POSES).motion_jacobian[:, 1:-1, 2]
    times = np.linalg.norm(joints, axis=(1, 2)) / np.linalg.norm(J, axis=(1, 2))
    assert joints == pytest.approx(times[:, None, None] * J, abs=1e-12)
    assert (joints**2).sum(axis=(1, 2)) == pytest.approx(np.full(len(POSES), 3 * JOINT_VARIANCE_SHARE))


def test_the_drawn_field_has_the_covariance_by_which_readings_are_judged(rng):
    """Pairs of poses that differ in one joint, in all joints, and not at all."""
    poses = np.concatenate([POSES[:2], POSES[:1] + [0.2, 0, 0, 0, 0, 0], POSES[:1] + 0.1])
    moved = JointProcess(ARM.chain).unit_displacements(poses)
    fields = [PoseField.of_joints(ARM.chain, rng).at(poses) for _ in range(1500)]
    drawn = np.array([np.einsum("nki,nk->ni", moved, one).ravel() for one in fields])
    expected = JointProcess(ARM.chain).covariance(poses).reshape(12, 12)
    assert drawn.T @ drawn / len(drawn) == pytest.approx(expected, abs=0.12)  # 1 / sqrt(1500) is 0.026 times 3


def test_near_poses_err_alike_and_far_ones_do_not(model):
    known = PosteriorDistribution(model)
    pose = POSES[:1]
    poses = np.concatenate([pose, pose, pose + 0.003, POSES[1:2]])
    drawn = [known.draw(seed) for seed in range(200)]
    errs = np.array([np.einsum("nki,nk->ni", known.displacements(poses), one.field.at(poses)) for one in drawn])
    assert np.abs(errs[:, 0] - errs[:, 1]).max() < 1e-12  # mm, rounding
    # 1 - exp(-16 * 0.003^2 / 2) is 0.007 %: the difference is 1.2 % of a standard deviation.
    off = np.sqrt(((errs[:, 0] - errs[:, 2]) ** 2).mean() / (errs[:, 0] ** 2).mean())
    assert off == pytest.approx(0.012, abs=0.004)
    assert np.sqrt(((errs[:, 0] - errs[:, 3]) ** 2).mean() / (errs[:, 0] ** 2).mean()) > 1
