"""Errors of a measured point: what belongs to the arm, what to the point, and how large each is."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm.catalogue import load
from truearm.errors import InputError
from truearm.models import KinematicModel, NetworkModel
from truearm.poses.measuring import measuring
from truearm.readings.readings import Readings
from truearm.tasks import errors
from truearm.tasks.errors import ORDER, ModelErrors, PoseField, PresetErrors
from truearm.virtual import VirtualArm, load_preset
from truearm.virtual.presets import PERFECT, SHOP, Preset
from truearm.virtual.systematic import ARCSEC

ARM = load("gao2017")
POSES = measuring(ARM, 30, seed=5).angles


@pytest.fixture(scope="module")
def model():
    """A kinematic model of a shop arm, of 60 readings."""
    virtual = VirtualArm.draw(ARM, load_preset("shop"), seed=3)
    return KinematicModel(ARM).fit_readings(virtual.measure(measuring(ARM, 60, seed=3).angles, seed=3).readings)


# A preset -------------------------------------------------------------------------------------------------------------


def test_a_perfect_arm_has_no_errors(rng):
    drawn = PresetErrors(ARM, PERFECT).draw(1)
    assert np.abs(drawn.systematic(POSES)).max() < 1e-9  # mm, rounding
    assert np.abs(drawn.random(POSES, rng)).max() == 0


def test_systematic_errors_are_the_arm_s_and_random_ones_the_point_s():
    one, again, other = (PresetErrors(ARM, SHOP).draw(seed) for seed in (1, 1, 2))
    assert np.array_equal(one.systematic(POSES), again.systematic(POSES))
    assert not np.allclose(one.systematic(POSES), other.systematic(POSES), atol=1e-4)
    first, second = (one.random(POSES, np.random.default_rng(seed)) for seed in (1, 2))
    assert not np.allclose(first, second, atol=1e-4)


def test_errors_of_geometry_are_what_is_shown_less_what_is_true():
    drawn = PresetErrors(ARM, Preset(length_std_mm=0.1, angle_std_deg=0.01)).draw(4)
    expected = ARM.chain.tip_in_base(POSES) - drawn.virtual.true_tip(POSES)
    assert np.abs(drawn.systematic(POSES) - expected).max() < 1e-12
    assert np.abs(expected).max() > 0.05


def test_the_mean_force_is_in_the_qualified_stylus(rng):
    """The same force every time along the stylus: it is part of the tip's offset, and no error is left."""
    pressed = Preset(tip_compliance_um_per_N=10.0, force_mean_N=3.0)
    drawn = PresetErrors(ARM, pressed).draw(1)
    assert np.abs(drawn.systematic(POSES)).max() < 1e-9  # mm, rounding
    assert np.abs(drawn.random(POSES, rng)).max() < 1e-9
    unsteady = PresetErrors(ARM, replace(pressed, force_std_N=0.5)).draw(1).random(POSES, rng)
    along = 0.5 * 10.0 * 1e-3  # mm, a standard deviation along the stylus
    assert np.linalg.norm(unsteady, axis=1).std() < 2 * along
    assert np.sqrt((unsteady**2).sum(axis=1).mean()) == pytest.approx(along, rel=0.5)


def test_white_encoder_noise_and_contact_have_the_size_that_derivatives_give(rng):
    pose = np.repeat(POSES[:1], 4000, axis=0)
    noisy = PresetErrors(ARM, Preset(encoder_noise_arcsec=2.0)).draw(1).random(pose, rng)
    J = ARM.chain.small_motions(POSES[:1]).by_motion[0, 1:-1, 2]
    expected = 2.0 * ARCSEC * np.sqrt((J**2).sum(axis=0))
    assert noisy.std(axis=0) == pytest.approx(expected, rel=0.05)  # 4000 draws: 1.1 % a standard deviation
    touched = PresetErrors(ARM, Preset(seat_std_mm=0.004)).draw(1).random(pose, rng)
    assert touched.std(axis=0) == pytest.approx(np.full(3, 0.004), rel=0.05)


def test_encoder_steps_are_even_over_a_step(rng):
    counts = 2.0**16
    pose = np.repeat(POSES[:1], 4000, axis=0)
    found = PresetErrors(ARM, Preset(encoder_counts=counts)).draw(1).random(pose, rng)
    J = ARM.chain.small_motions(POSES[:1]).by_motion[0, 1:-1, 2]
    expected = 2 * np.pi / counts / np.sqrt(12) * np.sqrt((J**2).sum(axis=0))
    assert found.std(axis=0) == pytest.approx(expected, rel=0.05)


# A model --------------------------------------------------------------------------------------------------------------


def test_draws_from_a_model_have_its_covariance(model):
    known = ModelErrors(model)
    drawn = np.array([known.draw(seed).systematic(POSES) for seed in range(600)])
    of_parameters, unexplained = model.covariance_parts(Readings(POSES))
    share = known.share(POSES)[:, 0] ** 2
    of_terms = known.widening**2 * np.trace(of_parameters, axis1=1, axis2=2) / 3
    expected = of_terms + share * known.field_std_mm**2
    found = (drawn**2).mean(axis=(0, 2))
    assert found == pytest.approx(expected, rel=0.25)  # 600 draws of three coordinates: 4 % a standard deviation
    assert found.mean() == pytest.approx(expected.mean(), rel=0.1)
    total = known.field_std_mm**2 + known.random_std_mm**2
    assert share * total == pytest.approx(unexplained[:, 0, 0], rel=1e-9)


def test_the_posterior_is_widened_to_what_readings_held_out_show(model):
    points = model.fit_.references[0]
    stated = points.std**2
    shown = stated + model.unexplained_std_**2
    expected = np.sqrt((shown / (stated + points.noise_std**2)).mean())
    # FLOOR_MM2, a nanometre squared, is added to both.
    assert ModelErrors(model).widening == pytest.approx(max(1.0, expected), rel=1e-6)
    assert ModelErrors(model).widening < 2


def test_a_drawn_model_is_the_same_at_the_same_pose(model):
    known = ModelErrors(model)
    drawn = known.draw(7)
    assert np.array_equal(drawn.systematic(POSES), drawn.systematic(POSES))
    assert np.array_equal(drawn.systematic(POSES)[:5], known.draw(7).systematic(POSES)[:5].copy())


def test_small_shifts_to_first_order_are_the_exact_ones(model, monkeypatch):
    known = ModelErrors(model)
    shift = known.draw(2).shift
    first = known.shifted(POSES, shift)
    assert np.abs(first).max() < errors.LINEAR_MM
    monkeypatch.setattr(errors, "LINEAR_MM", 0.0)
    exact = ModelErrors(model).shifted(POSES, shift)
    # Terms that cancel to first order are off by up to 1 mrad each: to second order that is 1e-6 of a metre.
    assert np.abs(first - exact).max() < 1e-3
    assert np.abs(first - exact).max() < 0.1 * np.abs(first).max()


def test_large_shifts_are_composed_exactly(model):
    """A base turned by two degrees takes all points along: no length changes, as it would to first order."""
    known = ModelErrors(model)
    shift = np.zeros(len(model.fit_.coefficients))
    start = 0
    for term in model.fit_.moved.terms:
        if term.place == 0 and term.direction == (0.0, 0.0, 1.0, 0.0, 0.0, 0.0):
            shift[start] = 0.035
        start += term.n_coefficients
    assert shift.any()
    moved = known.shifted(POSES, shift)
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
    readings = virtual.measure(measuring(ARM, 60, seed=3).angles, seed=3).readings
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = KinematicModel(ARM).fit_readings(replace(readings, points=readings.points @ R.T + [5.0, -200.0, 30.0]))
    assert ModelErrors(turned).R_base_reference == pytest.approx(R.T, abs=1e-3)


def test_a_measured_repeatability_replaces_the_scatter(model):
    known = ModelErrors(model, 0.001)
    assert known.random_std_mm == 0.001
    assert known.field_std_mm == pytest.approx(np.sqrt(model.unexplained_std_**2 - 1e-6))


@pytest.mark.parametrize("repeatability", [-0.001, np.nan, np.inf, 1.0])
def test_an_impossible_repeatability_is_refused(model, repeatability):
    with pytest.raises(InputError, match="repeatability"):
        ModelErrors(model, repeatability)


def test_a_network_is_refused_with_what_to_do():
    with pytest.raises(InputError, match="network") as caught:
        ModelErrors(NetworkModel(ARM))
    assert "kinematic or physical" in caught.value.hint


# The field ------------------------------------------------------------------------------------------------------------


def test_a_field_has_its_size_and_its_correlation():
    """exp(-16 (1 - cos d)) between two poses that differ by d in one joint; over a full turn it is the same again."""
    d = 0.2
    pose = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])
    poses = np.concatenate([pose, pose + [d, 0, 0, 0, 0, 0], pose + [0, 0, 2 * np.pi, 0, 0, 0]])
    rng = np.random.default_rng(1)
    drawn = np.array([PoseField.draw(ARM.chain, 0.01, ORDER, rng).at(poses) for _ in range(1500)])
    near, beyond, turned = drawn[:, 0].ravel(), drawn[:, 1].ravel(), drawn[:, 2].ravel()
    assert near.std() == pytest.approx(0.01, rel=0.05)  # 4500 numbers: 1.1 % a standard deviation
    assert np.corrcoef(near, beyond)[0, 1] == pytest.approx(np.exp(-16 * (1 - np.cos(d))), abs=0.04)
    assert np.abs(near - turned).max() < 1e-12
