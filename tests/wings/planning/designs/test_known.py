"""Laws of what is known before: priors of a drawing, the posterior of a model, and what readings taken add."""

import numpy as np
import pytest

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.identification.references.reading_references import state_of
from truearm.identification.terms.basis import Constant
from truearm.models import KinematicModel, NominalModel
from truearm.readings import Session
from truearm.wings.planning.designs.candidates import seat_poses, tracker_poses, volume_poses
from truearm.wings.planning.designs.exchange import moment_matrix
from truearm.wings.planning.designs.information import design_problem, tip_jacobian
from truearm.wings.planning.designs.prior import identified_prior, nominal_prior
from truearm.wings.planning.virtual import VirtualArm, load_preset

ARM = load_arm("gao2017")
VOLUME = volume_poses(ARM, 30, seed=5)


@pytest.fixture(scope="module")
def drawn():
    return nominal_prior(ARM, terms="constants", noise_mm=0.02)


def uncertainty(known, *, scale=False):
    """Root mean square in the volume [mm]."""
    tips, J = tip_jacobian(known.perturbed_chain, known.state(VOLUME))
    return float(np.sqrt(np.vdot(moment_matrix(J, tips, scale=scale), known.covariance)))


def by_problem(known, candidates):
    """The same with all candidates measured, by the design problem."""
    problem = design_problem(
        known.perturbed_chain,
        candidates,
        known.state(candidates.angles),
        known.state(VOLUME),
        prior_precision=known.precision,
        noise_mm=known.noise_mm,
    )
    return float(np.sqrt(problem.variance(range(len(candidates)))))


def test_a_drawing_is_known_as_well_as_the_priors_of_its_terms_say(drawn):
    stds = np.concatenate([term.prior_stds for term in drawn.perturbed_chain.terms])
    assert np.sqrt(drawn.covariance.diagonal()) == pytest.approx(stds)
    assert all(term.place > 0 for term in drawn.perturbed_chain.terms)
    physical = nominal_prior(ARM, noise_mm=0.02)
    groups = {term.group for term in physical.perturbed_chain.terms}
    assert {"joint offsets", "angle error, orders 3 to 4"} <= {name.removeprefix("J1 ") for name in groups} | groups
    assert physical.perturbed_chain.n_coefficients > 5 * drawn.perturbed_chain.n_coefficients
    # More may be wrong with the arm.
    assert uncertainty(physical) > uncertainty(drawn)


def test_points_taken_tell_what_the_design_problem_says_with_the_frame_unknown(drawn):
    poses = tracker_poses(ARM, 12, seed=1)
    taken = Session(poses.angles, np.zeros((12, 3)) + np.arange(3.0))
    # The frame is known to some ten metres beforehand rather than not at all: a millionth.
    assert uncertainty(drawn.after(taken)) == pytest.approx(by_problem(drawn.with_frame(), poses), rel=1e-6)


def test_seats_taken_tell_what_the_design_problem_says(drawn):
    poses = seat_poses(ARM, seats=2, poses=8, seed=2)
    taken = Session(poses.angles, seat=poses.seat)
    # The tips are in their seats to 1e-6 mm; where the seats are is known to ten metres beforehand.
    assert uncertainty(drawn.after(taken)) == pytest.approx(by_problem(drawn, poses), rel=1e-5)


def test_tips_that_scatter_in_a_seat_tell_no_scale(drawn):
    """An arm that is wrongly drawn: by its drawing the tips are a millimetre apart, where they were in one seat."""
    poses = seat_poses(ARM, seats=2, poses=15, seed=2)
    off = poses.angles + 1e-3 * np.random.default_rng(0).standard_normal(poses.angles.shape)
    in_place, scattered = (drawn.after(Session(angles, seat=poses.seat)) for angles in (poses.angles, off))
    # The postures differ by a milliradian, so the uncertainty by some of its thousandths.
    assert uncertainty(scattered) == pytest.approx(uncertainty(in_place), rel=1e-2)
    assert uncertainty(scattered, scale=True) == pytest.approx(uncertainty(in_place, scale=True), rel=2e-2)


def test_readings_in_two_set_ups_tell_less_than_in_one(drawn):
    angles = tracker_poses(ARM, 14, seed=3).angles
    one = Session(angles, np.ones((14, 3)))
    two = Session(angles, np.ones((14, 3)), session=np.repeat(["May", "June"], 7))
    assert uncertainty(drawn.after(two)) > uncertainty(drawn.after(one))
    assert uncertainty(drawn.after(two)) < uncertainty(drawn)


def test_a_reading_with_a_point_and_a_seat_counts_once(drawn):
    angles = tracker_poses(ARM, 8, seed=3).angles
    both = Session(angles, np.ones((8, 3)), seat=np.array(["A"] * 8))
    assert uncertainty(drawn.after(both)) == uncertainty(drawn.after(Session(angles, np.ones((8, 3)))))


def test_readings_without_points_and_seats_are_refused(drawn):
    angles = tracker_poses(ARM, 3, seed=0).angles
    for readings in (Session(angles), Session(angles, plane=np.array(["table"] * 3))):
        refuses("points or seats", drawn.after, readings)


def test_a_seat_in_two_sessions_is_refused(drawn):
    angles = tracker_poses(ARM, 4, seed=0).angles
    taken = Session(angles, seat=np.array(["A"] * 4), session=np.array(["May", "May", "June", "June"]))
    refuses("seat 'A' is in session 'May' and in session 'June'", drawn.after, taken)


def test_noise_must_be_positive():
    for noise in (0.0, -1.0, np.nan, np.inf):
        refuses("positive noise", nominal_prior, ARM, noise_mm=noise)
    refuses("constants or physical", nominal_prior, ARM, terms="everything", noise_mm=0.1)


# --- of a model ---


@pytest.fixture(scope="module")
def model():
    """Identified in a tracker's frame that is turned and shifted, with a tip that the drawing has not."""
    virtual = VirtualArm.draw(ARM, load_preset("research"), seed=1)
    readings = virtual.measure(tracker_poses(ARM, 40, seed=7).angles, seed=2).readings
    turned = readings.points @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + [2e3, 1e3, -500.0]
    return KinematicModel(ARM).fit_readings(Session(readings.angles, turned))


def identified(model):
    state = state_of
    return identified_prior(model.arm_, model.fit_, noise_mm=0.02, state=lambda q: state(model.arm_, Session(q)))


def test_what_a_model_knows_is_its_posterior_without_the_base(model):
    arm, known = identified(model)
    terms = model.fit_.perturbed_chain.terms
    of_arm = [term.place > 0 or not isinstance(term.basis, Constant) for term in terms]
    kept = np.repeat(of_arm, [term.n_coefficients for term in terms])
    assert not kept.all()
    covariance = model.fit_.covariance[np.ix_(kept, kept)]
    std = np.sqrt(covariance.diagonal())
    # Correlations: inverted twice, with eigenvalues from 1e-8 of the largest up.
    assert known.covariance / np.outer(std, std) == pytest.approx(covariance / np.outer(std, std), abs=1e-6)
    assert (arm.chain.fixed[0] == ARM.chain.fixed[0]).all()


def test_an_identified_arm_makes_the_models_points_but_for_the_frame(model):
    arm, known = identified(model)
    tips, points = arm.chain.tip_in_base(VOLUME), model.predict(VOLUME)
    between = np.linalg.norm(tips[:, None] - tips, axis=2)
    assert between == pytest.approx(np.linalg.norm(points[:, None] - points, axis=2), abs=1e-9)
    assert known.perturbed_chain.tips(
        known.state(VOLUME), np.zeros(known.perturbed_chain.n_coefficients)
    ) == pytest.approx(tips)


def test_more_readings_leave_less_and_those_taken_count(model):
    _, known = identified(model)
    before = uncertainty(known)
    poses = tracker_poses(ARM, 10, seed=11)
    after = uncertainty(known.after(Session(poses.angles, np.ones((10, 3)))))
    assert after < before < uncertainty(nominal_prior(ARM, terms="constants", noise_mm=0.02))
    assert by_problem(known.with_frame(), poses) == pytest.approx(after, rel=1e-6)


def test_a_model_of_the_base_alone_has_nothing_to_plan_for():
    angles = tracker_poses(ARM, 10, seed=0).angles
    model = NominalModel(ARM, free=("base",)).fit(angles, ARM.chain.tip_in_base(angles))
    refuses("nothing to plan for", identified, model)
