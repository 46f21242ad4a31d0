"""What a model predicts depends neither on where the joints have their zeros nor on the unit of lengths."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.chain import Chain
from truearm.identification.terms import ArmState, candidate_terms, constants
from truearm.identification.terms.catalogue import LENGTH_STD, TYPICAL_REACH_MM, gravity, relative_size
from truearm.models import KinematicModel, PhysicalModel
from truearm.readings import Session
from truearm.wings.planning.virtual import VirtualArm, load_preset

ARM = load_arm("gao2017")
KINDS = {"kinematic": lambda arm: KinematicModel(arm), "physical": lambda arm: PhysicalModel(arm, highest=4)}


def box(n, seed):
    return ARM.working + 0.8 * np.random.default_rng(seed).uniform(-1, 1, (n, 6))


@pytest.fixture(scope="module")
def measured():
    """40 readings with points of a virtual arm, without a temperature."""
    readings = VirtualArm.draw(ARM, load_preset("research"), seed=3).measure(box(40, 1), seed=1).readings
    return Session(readings.angles, readings.points)


@pytest.fixture(scope="module")
def predicted(measured):
    """Points and standard uncertainties at 50 other poses, by kind of model."""
    found = {
        name: kind(ARM).fit_readings(measured).predict(box(50, 2), return_cov=True) for name, kind in KINDS.items()
    }
    return {name: (points, np.sqrt(np.trace(cov, axis1=1, axis2=2))) for name, (points, cov) in found.items()}


def turned_about_z(angle):
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return out


def with_zeros(arm, shift, *, behind):
    """The same physical arm whose joints read `shift` more [rad]; frames of the places turn if it is taken `behind`."""
    fixed = arm.chain.fixed.copy()
    for i, angle in enumerate(shift):
        if behind:
            fixed[i + 1] = turned_about_z(-angle) @ fixed[i + 1]
        else:
            fixed[i] = fixed[i] @ turned_about_z(-angle)
    chain = Chain(fixed, arm.chain.tip_in_flange)
    return replace(arm, chain=chain, lower=arm.lower + shift, upper=arm.upper + shift, working_pose=arm.working + shift)


def in_unit(arm, factor):
    """The arm with lengths in a unit of 1/factor mm, taken as mm."""
    fixed = arm.chain.fixed.copy()
    fixed[:, :3, 3] *= factor
    return replace(arm, chain=Chain(fixed, arm.chain.tip_in_flange * factor))


@pytest.mark.parametrize("behind", [False, True])
@pytest.mark.parametrize("name", KINDS)
def test_zeros_of_the_joints_do_not_matter(measured, predicted, name, behind):
    """To 1e-6 mm, a thousandth of any uncertainty here; rounding is 1e-10 mm."""
    shift = np.random.default_rng(0).uniform(-2, 2, 6)
    arm = with_zeros(ARM, shift, behind=behind)
    np.testing.assert_allclose(
        arm.chain.tip_in_base(measured.angles + shift), ARM.chain.tip_in_base(measured.angles), atol=1e-9
    )
    model = KINDS[name](arm).fit_readings(replace(measured, angles=measured.angles + shift))
    np.testing.assert_allclose(model.predict(box(50, 2) + shift), predicted[name][0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("factor", [1 / 25.4, pytest.param(1000.0, marks=pytest.mark.weekly)])
@pytest.mark.parametrize("name", KINDS)
def test_the_unit_of_lengths_does_not_matter(measured, predicted, name, factor):
    """To a thousandth of the uncertainty: weights of the noise end at a nanometre, whatever the unit."""
    model = KINDS[name](in_unit(ARM, factor)).fit_readings(replace(measured, points=measured.points * factor))
    points, uncertainty = predicted[name]
    off = np.linalg.norm(model.predict(box(50, 2)) / factor - points, axis=1)
    assert (off < 1e-3 * uncertainty).all()


def test_priors_of_lengths_grow_with_the_arm_and_those_of_rotations_do_not():
    small, large = (constants(in_unit(ARM, k).chain) for k in (1.0, 2.0))
    for one, two in zip(small, large, strict=True):
        assert two.prior_std == pytest.approx(one.prior_std * (2 if any(one.direction[3:]) else 1), rel=1e-12)
    assert relative_size(ARM.chain) == ARM.chain.reach / TYPICAL_REACH_MM
    assert {t.prior_std for t in small if t.group == "lengths and offsets"} == {LENGTH_STD * relative_size(ARM.chain)}


def test_rotations_by_the_torques_of_assumed_masses_are_those_of_any_size():
    for k in (0.5, 3.0):
        chain = in_unit(ARM, k).chain
        one, other = (ArmState(c, box(5, 0)) for c in (ARM.chain, chain))
        for a, b in zip(gravity(ARM.chain, 2), gravity(chain, 2), strict=True):
            mine, theirs = a.prior_std * a.basis.values(one), b.prior_std * b.basis.values(other)
            np.testing.assert_allclose(theirs, mine, rtol=1e-9, atol=1e-15)


def test_a_chain_without_length_has_the_priors_of_a_typical_arm():
    assert relative_size(Chain(np.stack([np.eye(4)] * 3), [0, 0, 0])) == 1.0


@pytest.mark.parametrize("turn", [0.0, 1.0, -2.5])
def test_harmonics_offered_depend_neither_on_zeros_nor_on_turns(turn):
    """40 readings all around: neither where the count begins nor a full turn more changes the orders."""
    rng = np.random.default_rng(5)
    angles = rng.uniform(-np.pi, np.pi, (40, 6))
    wound = angles + turn + 2 * np.pi * rng.integers(-1, 2, angles.shape)
    offered = [
        {(t.name, t.prior_stds.size) for t in candidate_terms(ArmState(ARM.chain, q))[0]} for q in (angles, wound)
    ]
    assert offered[0] == offered[1]


def test_a_translation_along_the_last_axis_is_found_in_turned_frames():
    shift = np.random.default_rng(0).uniform(-2, 2, 6)
    plain, turned = (constants(with_zeros(ARM, s, behind=True).chain) for s in (0 * shift, shift))
    for terms, chain in ((plain, ARM.chain), (turned, with_zeros(ARM, shift, behind=True).chain)):
        five = [t for t in terms if t.place == 5 and any(t.direction[3:])]
        directions = np.array([t.direction[3:] for t in five])
        np.testing.assert_allclose(directions @ directions.T, np.eye(3), atol=1e-12)
        along = [t.group == "equivalent to a free tip" for t in five]
        np.testing.assert_allclose(np.abs(directions @ chain.fixed[5, :3, 2]), along, atol=1e-12)
