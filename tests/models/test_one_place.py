"""Readings of one place, without an instrument: what is held out, and which terms are kept."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import adjusted_rand_score

from truearm.arm import load_arm
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.identify import MAX_SHARE_LEFT, _typical_error
from truearm.identification.references.cross_validation_groups import REGIONS, is_in_one_place, joint_space_regions
from truearm.identification.references.reading_references import state_of
from truearm.identification.terms.basis import Constant
from truearm.models import PhysicalModel
from truearm.readings import Session
from truearm.wings.planning.designs.sampling import seat

ARM = load_arm("gao2017")
PLACE = np.array([[350.0, 0.0, 100.0], [400.0, 0.0, 100.0]])  # mm
SLIDING = Chain(np.stack([np.eye(4)] * 3), tip_in_flange=(10.0, 0, 0), prismatic=np.array([True, False]))


def poses_in(arm, places):
    poses = seat(arm, 40, seed=1, seats=places)
    return Session(poses.angles, seat=poses.seat)


@pytest.fixture(scope="module")
def drawn():
    """40 exact poses of the nominal arm in two seats of one place."""
    return poses_in(ARM, PLACE)


def test_seats_next_to_each_other_are_one_place_and_seats_far_apart_are_not(drawn):
    assert is_in_one_place(drawn.has_point, state_of(ARM, drawn))
    apart = poses_in(ARM, PLACE + [[0, -300, 0], [0, 300, 0]])
    assert not is_in_one_place(apart.has_point, state_of(ARM, apart))


def test_a_point_shows_more_than_a_place(drawn):
    points = np.full((len(drawn), 3), np.nan)
    points[0] = 0.0
    pointed = replace(drawn, points=points)
    assert not is_in_one_place(pointed.has_point, state_of(ARM, pointed))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(4, 60))
def test_regions_depend_neither_on_zeros_nor_on_turns_of_the_joints(seed, n):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-3, 3, (n, 6))
    found = joint_space_regions(angles, ARM.chain)
    other = joint_space_regions(angles + rng.uniform(-3, 3, 6) + 2 * np.pi * rng.integers(-1, 2, (n, 6)), ARM.chain)
    assert adjusted_rand_score(found, other) == 1.0
    assert 1 <= len(np.unique(found)) <= REGIONS


def test_regions_of_equal_poses_and_of_few_readings():
    assert joint_space_regions(np.zeros((3, 6)), ARM.chain).tolist() == [0, 1, 2]
    assert joint_space_regions(np.zeros((30, 6)), ARM.chain).tolist() == list(range(30))


def test_displacements_count_in_units_of_their_range():
    q = np.array([[0.0, 0.0], [0.1, 0.0], [500.0, 0.0], [500.1, 0.0]])
    assert joint_space_regions(q, SLIDING).tolist() in ([0, 0, 1, 1], [1, 1, 0, 0])


def measured(drawn, errors_of, rng):
    """Readings of an arm whose encoders are wrong by errors of the angles [rad]."""
    angles = drawn.angles + rng.normal(0, 1e-5, drawn.angles.shape)
    return replace(drawn, angles=angles + errors_of(angles))


@pytest.fixture(scope="module")
def rough(drawn):
    """A model from one place of an arm whose errors no term has: every encoder errs by the angles of all joints."""
    rng = np.random.default_rng(7)
    wave = rng.normal(size=(6, 6))
    return PhysicalModel(ARM, highest=2).fit_readings(
        measured(drawn, lambda angles: 2e-4 * np.sin(3 * angles @ wave), rng)
    )


@pytest.fixture(scope="module")
def eccentric(drawn):
    """A model from one place of an arm with eccentric encoders, which the catalogue has."""
    rng = np.random.default_rng(7)
    phase = rng.uniform(0, 2 * np.pi, 6)
    return PhysicalModel(ARM, highest=2).fit_readings(
        measured(drawn, lambda angles: 1e-3 * np.sin(angles + phase), rng)
    )


def groups_of(model):
    return {term.group for term in model.fit_.perturbed_chain.terms if not isinstance(term.basis, Constant)}


def test_what_no_term_describes_is_not_learned_in_one_place_as_something_else(rough):
    assert groups_of(rough) <= {"joint compliance"}
    assert any("one place" in term.reason for term in rough.excluded_terms_)


def test_terms_that_explain_most_of_the_error_are_kept(eccentric):
    assert "angle error, orders 1 to 2" in groups_of(eccentric)
    assert not any("one place" in term.reason for term in eccentric.excluded_terms_)


def test_the_expected_square_error_is_that_of_the_tip_covariance_and_the_noise(rough):
    state = state_of(ARM, Session(ARM.working[None]))
    noise = rough.fit_.references[0].noise_std
    expected = np.trace(rough.fit_.tip_covariance(state)[0]) + 3 * noise**2
    assert rough.fit_.expected_square_error(state) == pytest.approx(expected, rel=1e-12)


def test_terms_are_chosen_over_the_trained_travel_of_an_open_slide_at_the_mean_temperature(monkeypatch):
    """A SCARA with upright axes, read in two seats 30 mm above each other at 26 degC."""
    fixed = np.tile(np.eye(4), (5, 1, 1))
    fixed[1, :3, 3], fixed[2, :3, 3] = (300, 0, 100), (250, 0, 0)
    chain = Chain(fixed, np.array([60.0, 0, 10]), np.array([False, False, True, False]))
    arm = Arm("scara", chain, title="Open slide", source="made for a test")
    rng = np.random.default_rng(5)
    n = 24
    heading, is_upper = rng.uniform(-3, 3, n), np.arange(n) % 2
    wrist = np.array([400.0, 50.0]) - 60 * np.column_stack([np.cos(heading), np.sin(heading)])
    far = np.hypot(*wrist.T)
    elbow = rng.choice([-1, 1], n) * np.arccos((far**2 - 300**2 - 250**2) / (2 * 300 * 250))
    shoulder = np.arctan2(*wrist.T[::-1]) - np.arctan2(250 * np.sin(elbow), 300 + 250 * np.cos(elbow))
    angles = np.column_stack([shoulder, elbow, 20.0 + 30 * is_upper, heading - shoulder - elbow])
    angles += rng.normal(0, 3e-4, (n, 4)) * [1, 1, 300, 1]
    seen = []
    monkeypatch.setattr(IdentificationResult, "expected_square_error", lambda fit, state: seen.append(state) or 1.0)
    session = Session(angles, seat=np.array(["a", "b"])[is_upper], temperature_degC=rng.normal(26, 0.2, n))
    PhysicalModel(arm, highest=1).fit_readings(session)
    assert len(seen) == 2
    for state in seen:
        np.testing.assert_allclose(state.temperature_degC, 20.0, atol=1e-12)
        assert angles[:, 2].min() <= state.angles[:, 2].min()
        assert state.angles[:, 2].max() <= angles[:, 2].max()


def test_without_readings_held_out_nothing_is_explained():
    empty = np.zeros(0, dtype=np.intp)
    none = HeldOutReadings(empty, empty, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    assert not _typical_error(none) <= MAX_SHARE_LEFT * 1e300
