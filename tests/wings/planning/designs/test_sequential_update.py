"""The estimate after each reading: that of all readings at once, the planted arm, and what each pose would add."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import truearm as ta
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.readings import Session
from truearm.wings.planning.designs import sequential_update
from truearm.wings.planning.designs.candidates import seat_poses, tracker_poses, volume_poses
from truearm.wings.planning.designs.exchange import decreases, moment_matrix
from truearm.wings.planning.designs.information import tip_jacobian
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.planning.designs.sequential_update import Estimate, updated_estimate, with_reading

NOISE_MM = 0.02


@pytest.fixture(scope="module")
def arm():
    return ta.load_arm("ur10")


@pytest.fixture(scope="module")
def prior(arm):
    return nominal_prior(arm, terms="constants", noise_mm=NOISE_MM)


@pytest.fixture(scope="module")
def target(arm, prior):
    tips, jacobian = tip_jacobian(prior.perturbed_chain, prior.state(volume_poses(arm, 50, seed=1)))
    return moment_matrix(jacobian, tips)


def planted(prior, angles, seed, seat=None, noise_mm=NOISE_MM):
    """Readings of an arm with errors drawn from the prior, by an instrument in another frame, or in seats."""
    random = np.random.default_rng(seed)
    truth = random.standard_normal(len(prior.precision)) / np.sqrt(np.diag(prior.precision))
    turned = np.array([[0.0, -1.0, 0.0, 500.0], [1.0, 0.0, 0.0, -200.0], [0.0, 0.0, 1.0, 30.0], [0.0, 0.0, 0.0, 1.0]])
    chain = PerturbedChain(prior.perturbed_chain.chain.with_reference_frame(turned), prior.perturbed_chain.terms)
    if seat is not None:
        return truth, Session(angles, seat=seat)
    tips = chain.tips(prior.state(angles), truth) + noise_mm * random.standard_normal((len(angles), 3))
    return truth, Session(angles, points=tips)


def one_by_one(prior, readings):
    estimate = Estimate.before_readings(prior)
    for n in range(1, len(readings) + 1):
        some = readings.rows(np.arange(n))
        estimate = updated_estimate(prior, some, prior.state(some.angles), estimate)
    return estimate


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.weekly)])
def test_reading_by_reading_it_is_the_least_squares_of_all(arm, prior, target, seed):
    _, readings = planted(prior, tracker_poses(arm, 40, seed=seed).angles, seed)
    estimate = one_by_one(prior, readings)
    chain, p = estimate.perturbed_chain, len(prior.precision)
    stds = 1 / np.sqrt(np.diag(prior.precision))
    state, noise_mm = prior.state(readings.angles), estimate.noise_mm

    def left(x):
        return np.concatenate([((chain.tips(state, x) - readings.points) / noise_mm).ravel(), x[:p] / stds])

    x_scale = np.concatenate([stds, [1e-3] * 3, [1.0] * 3])
    best = least_squares(left, np.zeros(p + 6), x_scale=x_scale, xtol=1e-12, ftol=1e-12).x
    u = np.sqrt(np.diag(estimate.covariance))
    # Its last step may move the parameters by a hundredth of their uncertainty, and the noise by as little.
    assert (np.abs(estimate.parameters - best) / u).max() < 0.05
    assert 0.7 * NOISE_MM < noise_mm < 1.3 * NOISE_MM


@pytest.mark.parametrize(("in_seats", "n_in_prior"), [(False, 0), (False, 5), (True, 0), (True, 5)])
def test_a_reading_added_to_the_sums_gives_the_estimate_of_all_anew(arm, prior, target, in_seats, n_in_prior):
    angles, seat, n_before = ta.simulate("ur10", poses=138, seed=1).session.angles, None, 120
    if in_seats:
        poses = seat_poses(arm, seats=6, poses=60, seed=1)
        angles, seat, n_before = poses.angles, poses.seat, 42
    _, readings = planted(prior, angles, 1, seat)
    state, n_by_sums, p = prior.state(angles), 0, len(prior.precision)
    estimate = Estimate.before_readings(prior)
    for n in range(n_before, len(angles) + 1):
        rows = np.arange(n)
        anew = updated_estimate(prior, readings.rows(rows), state.rows(rows), estimate, n_in_prior=n_in_prior)
        by_sums = with_reading(prior, readings.rows([n - 1]), state.rows(rows[-1:]), estimate)
        if by_sums is not None:
            n_by_sums += 1
            # As far as a step settles; parameters of base and seats are in frames of their own.
            u = np.sqrt(np.diag(anew.covariance))[:p]
            assert (np.abs(by_sums.parameters - anew.parameters)[:p] / u).max() < 0.02
            assert by_sums.variance(target) == pytest.approx(anew.variance(target), rel=0.02)
            assert by_sums.noise_mm == pytest.approx(anew.noise_mm, rel=2e-3)
            assert by_sums.seats == anew.seats
        estimate = by_sums or anew
    assert n_by_sums > 10
    assert with_reading(prior, Session(arm.working[None]), prior.state(arm.working[None]), estimate) is estimate


def test_all_at_once_find_the_noise_and_the_uncertainty_of_one_by_one(arm, target):
    prior = nominal_prior(arm, terms="constants", noise_mm=10 * NOISE_MM)
    _, readings = planted(prior, tracker_poses(arm, 40, seed=1).angles, 1)
    at_once = updated_estimate(prior, readings, prior.state(readings.angles), Estimate.before_readings(prior))
    estimate = one_by_one(prior, readings)
    assert at_once.noise_mm == pytest.approx(estimate.noise_mm, rel=0.02)
    assert at_once.variance(target) == pytest.approx(estimate.variance(target), rel=0.05)


def test_from_a_model_of_the_first_readings_it_is_the_estimate_of_all(arm, prior, target, monkeypatch):
    monkeypatch.setattr(sequential_update, "NOISE_WORTH", 1e9)  # the noise is the prior's, of the model too
    # A thirtieth of the usual errors and noise: what the model knows is linear in them.
    small = replace(prior, precision=30**2 * prior.precision, noise_mm=NOISE_MM / 30)
    _, readings = planted(small, tracker_poses(arm, 40, seed=3).angles, 3, noise_mm=small.noise_mm)
    p, few = len(small.precision), readings.rows(np.arange(15))
    known, expected = one_by_one(small, few), one_by_one(small, readings)
    model = replace(small, precision=np.linalg.inv(known.covariance[:p, :p]), mean=known.parameters[:p])
    estimate = Estimate.before_readings(model.with_frame())
    for some, same in ((few, known), (readings, expected)):
        estimate = updated_estimate(model, some, prior.state(some.angles), estimate, n_in_prior=15)
        different = (estimate.parameters - same.parameters)[:p]
        assert different @ target @ different < 0.01**2 * same.variance(target)
        assert estimate.variance(target) == pytest.approx(same.variance(target), rel=1e-3)


def test_where_tips_are_linear_it_is_exact_after_each_reading(arm, target):
    only = nominal_prior(arm, terms="constants", noise_mm=NOISE_MM)
    keep = [k for k, term in enumerate(only.perturbed_chain.terms) if "translation" in term.name]
    slides = PerturbedChain(only.perturbed_chain.chain, tuple(only.perturbed_chain.terms[k] for k in keep))
    prior = type(only)(slides, only.precision[np.ix_(keep, keep)], NOISE_MM, only.state)
    angles = seat_poses(arm, seats=2, poses=6, seed=1)
    readings = Session(angles.angles, seat=angles.seat)
    estimate = one_by_one(prior, readings)
    tips, jacobian = tip_jacobian(slides, prior.state(angles.angles))
    J, names = jacobian.reshape(-1, len(keep)), list(dict.fromkeys(angles.seat))
    B = np.kron(np.array([[seat == name for name in names] for seat in angles.seat], float), np.eye(3))
    rest = np.eye(len(B)) - B @ np.linalg.pinv(B)
    A = prior.precision + J.T @ rest @ J / estimate.noise_mm**2
    exact = np.linalg.solve(A, -J.T @ rest @ tips.ravel() / estimate.noise_mm**2)
    assert len(keep) > 10
    assert estimate.parameters[: len(keep)] == pytest.approx(exact, abs=1e-3)


def test_a_planted_arm_is_found_within_the_uncertainty_of_its_tips(prior, arm):
    _, readings = planted(prior, tracker_poses(arm, 60, seed=4).angles, 4)
    estimate = one_by_one(prior, readings)
    further = tracker_poses(arm, 100, seed=5).angles
    _, others = planted(prior, further, 4)
    residuals, covariances = estimate.residuals(others, prior.state(further))
    squares = np.einsum("nc,nc->n", residuals, np.linalg.solve(covariances, residuals[..., None])[..., 0])
    assert 2.0 < squares.mean() < 4.5


@pytest.mark.parametrize("in_seats", [False, True])
def test_what_a_pose_would_give_is_what_it_gives(arm, prior, target, in_seats):
    poses = seat_poses(arm, seats=2, poses=12, seed=1) if in_seats else tracker_poses(arm, 24, seed=1)
    _, readings = planted(prior, poses.angles, 1, poses.seat)
    some = readings.rows(np.arange(0, 24, 2))
    estimate = updated_estimate(prior, some, prior.state(some.angles), Estimate.before_readings(prior))
    left = np.arange(1, 24, 2)
    seat = None if poses.seat is None else poses.seat[left]
    problem = estimate.design(prior.state(poses.angles[left]), seat, target)
    gains = decreases(problem)
    assert estimate.variance(target) == pytest.approx(problem.variance([]), rel=1e-6)
    again = [problem.variance([]) - problem.variance([k]) for k in range(len(left))]
    assert gains == pytest.approx(again, rel=1e-6, abs=1e-9 * problem.variance([]))
    # Without residuals that move the estimate, measuring it has the covariance that was foretold.
    J = problem.factors[int(np.argmax(gains))]
    C = np.linalg.inv(estimate.precision + J.T @ J)
    assert np.sum(target * C[: len(target), : len(target)]) == pytest.approx(
        problem.variance([]) - gains.max(), rel=1e-6
    )


def test_a_first_reading_in_a_seat_says_nothing_and_a_base_is_free(arm, prior, target):
    at = arm.working[None]
    before = Estimate.before_readings(prior)
    for readings in (Session(at, seat=["A"]), Session(at, points=[[1.0, 2.0, 3.0]])):
        estimate = updated_estimate(prior, readings, prior.state(at), before)
        assert estimate.variance(target) == pytest.approx(before.variance(target), rel=1e-5)
    tips = prior.perturbed_chain.tips(prior.state(at), np.zeros(len(prior.precision)))
    assert updated_estimate(prior, Session(at, seat=["A"]), prior.state(at), before).seat_points["A"] == pytest.approx(
        tips[0], abs=1e-3
    )
    assert len(before.residuals(Session(at, seat=["B"]), prior.state(at))[0]) == 0
