"""Laws of what candidates tell: Jacobians against differences, seats shared or eliminated, a bar brings the scale."""

import numpy as np
import pytest

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms.catalogue import constants, own_axis
from truearm.identification.terms.state import ArmState
from truearm.readings import Lengths
from truearm.wings.planning.designs.candidates import bar_places, seat_poses, tracker_poses, volume_poses
from truearm.wings.planning.designs.information import SEAT_STD_MM, design_problem, tip_jacobian
from truearm.wings.planning.designs.observability import observability
from truearm.wings.planning.designs.prior import Prior, nominal_prior
from truearm.wings.planning.designs.proposal import LENGTH_U_MM, information_rows

ARM = load_arm("gao2017")
NOISE_MM = 0.02


@pytest.fixture(scope="module")
def perturbed_chain():
    terms = [term for term in constants(ARM.chain, free=("tip",)) if term.place > 0]
    return PerturbedChain(ARM.chain, (*terms, *own_axis(ARM.chain, 3, highest=2)))


@pytest.fixture(scope="module")
def volume():
    return state(volume_poses(ARM, 40, seed=8))


def state(angles):
    return ArmState(ARM.chain, angles)


def prior(perturbed_chain):
    return np.diag(np.concatenate([term.prior_stds for term in perturbed_chain.terms]) ** -2.0)


def problem(perturbed_chain, candidates, volume, **options):
    options = {"noise_mm": NOISE_MM, "length_u_mm": LENGTH_U_MM, "prior_precision": prior(perturbed_chain), **options}
    return design_problem(perturbed_chain, candidates, state(candidates.angles), volume, **options)


def test_the_jacobian_is_the_derivative_of_the_tip(perturbed_chain):
    at = state(tracker_poses(ARM, 4, seed=0).angles)
    x = 1e-3 * np.random.default_rng(0).standard_normal(perturbed_chain.n_coefficients)
    tips, jacobian = tip_jacobian(perturbed_chain, at, x)
    assert tips == pytest.approx(perturbed_chain.tips(at, x))
    for k in range(perturbed_chain.n_coefficients):
        step = np.zeros(len(x))
        step[k] = 1e-5
        quotient = (perturbed_chain.tips(at, x + step) - perturbed_chain.tips(at, x - step)) / 2e-5
        # mm per radian, of some thousand: 1e-6 of them.
        assert np.abs(jacobian[:, :, k] - quotient).max() < 2e-3


def test_under_a_tracker_a_pose_tells_its_tip(perturbed_chain, volume):
    found = tracker_poses(ARM, 12, seed=1)
    _, J = tip_jacobian(perturbed_chain, state(found.angles))
    told = problem(perturbed_chain, found, volume)
    assert told.factors == pytest.approx(J / NOISE_MM)
    assert told.variance([]) > told.variance([3]) > told.variance(range(12))


def test_a_seats_point_is_a_parameter_or_eliminated_all_the_same(perturbed_chain, volume):
    found = seat_poses(ARM, seats=2, poses=6, seed=2)
    shared = problem(perturbed_chain, found, volume)
    whole = problem(perturbed_chain, found.group_by_place(), volume)
    assert shared.factors.shape == (12, 3, perturbed_chain.n_coefficients + 6)
    assert whole.factors.shape == (2, 15, perturbed_chain.n_coefficients)
    # Of a tip known to some millimetres, a seat known to ten metres tells less than a millionth.
    assert shared.variance(range(6)) == pytest.approx(whole.variance([0]), rel=1e-6)
    assert shared.variance(range(12)) == pytest.approx(whole.variance([0, 1]), rel=1e-6)
    # One pose in a seat tells nothing; before it the tip is known to 1.2 m, a share of 0.015 of the seat in square.
    assert shared.variance([0]) == pytest.approx(shared.variance([]), rel=0.02)


def test_a_bar_is_two_seats_and_a_length(perturbed_chain, volume):
    found = bar_places(ARM, 2, length_mm=300, poses=3, seed=3)
    told = problem(perturbed_chain, found, volume)
    assert told.factors.shape == (2, 13, perturbed_chain.n_coefficients + 1)
    tips, J = tip_jacobian(perturbed_chain, state(found.angles[:6]))
    p = perturbed_chain.n_coefficients
    # The same as a plain problem with six more unknowns; the bar's length is a parameter beside the terms'.
    along = tips[3:].mean(axis=0) - tips[:3].mean(axis=0)
    assert along == pytest.approx(found.seat_points[5] - found.seat_points[0])
    along /= np.linalg.norm(along)
    A = np.zeros((19, p + 7))
    A[:18, :p] = J.reshape(18, p) / NOISE_MM
    A[:9, p + 1 : p + 4] = A[9:18, p + 4 :] = -np.tile(np.eye(3), (3, 1)) / NOISE_MM
    A[18, p:] = np.concatenate([[-1], -along, along]) / Lengths.default_u_place_mm
    information = A.T @ A
    p += 1
    schur = information[:p, :p] - information[:p, p:] @ np.linalg.solve(information[p:, p:], information[p:, :p])
    assert np.abs(told.factors[0].T @ told.factors[0] - schur).max() < 1e-12 * information.max()


def test_seats_leave_the_scale_to_the_prior_and_a_bar_brings_it(perturbed_chain, volume):
    seats = seat_poses(ARM, seats=3, poses=20, seed=4).group_by_place()
    bars = bar_places(ARM, 3, length_mm=400, poses=10, seed=4)
    by_seats, by_bars = problem(perturbed_chain, seats, volume), problem(perturbed_chain, bars, volume)
    # The same number of readings: a millimetre, and some hundredths of one.
    assert np.sqrt(by_seats.variance(range(3))) > 1.0
    assert np.sqrt(by_bars.variance(range(3))) < 0.1
    wrong = problem(perturbed_chain, bars, volume, length_u_mm=1.0)
    assert wrong.variance(range(3)) > 10 * by_bars.variance(range(3))


@pytest.mark.parametrize("n_places", [1, 4, 8])
def test_many_places_of_a_bar_do_not_tell_the_scale_better_than_its_certificate(perturbed_chain, volume, n_places):
    """Pose by pose, place by place, or as rows of the terms alone, all the same."""
    found = bar_places(ARM, n_places, length_mm=400, poses=6, seed=5)
    tips, J = tip_jacobian(perturbed_chain, volume)
    apart = tips - tips.mean(axis=0)
    by = np.einsum("nc,ncp->p", apart, J) / (apart**2).sum()
    known = Prior(perturbed_chain, prior(perturbed_chain), 1e-4, state)
    variances = [by @ known.updated(information_rows(known, found)).covariance @ by]
    for candidates in (found, found.split_into_poses()):
        told = problem(perturbed_chain, candidates, volume, noise_mm=known.noise_mm)
        p, C = perturbed_chain.n_coefficients, np.linalg.inv(told.information(range(len(candidates))))
        variances.append(by @ C[:p, :p] @ by)
    # Rounding: a seat's prior, 1e-8 / mm^2, beside 1e8 / mm^2 of a reading.
    assert variances == pytest.approx([variances[0]] * 3, rel=1e-4)
    assert np.sqrt(variances[0]) >= LENGTH_U_MM / 400
    if n_places == 8:
        assert np.sqrt(variances[0]) < 1.02 * LENGTH_U_MM / 400  # eight places of 1 um and readings of 0.1 um


def test_a_seats_point_has_a_wide_prior(perturbed_chain, volume):
    told = problem(perturbed_chain, seat_poses(ARM, seats=1, poses=3, seed=0), volume)
    p = perturbed_chain.n_coefficients
    assert told.prior_precision[p:, p:] == pytest.approx(np.eye(3) * SEAT_STD_MM**-2)
    assert not told.target[p:].any()


def test_a_problem_is_checked(perturbed_chain, volume):
    found = bar_places(ARM, 1, length_mm=200, poses=2, seed=0)
    for options, why in (
        ({"noise_mm": -0.02}, "positive noise"),
        ({"noise_mm": np.nan}, "positive noise"),
        ({"length_u_mm": 0.0}, "positive uncertainty"),
    ):
        refuses(why, problem, perturbed_chain, found, volume, **options)
    options = {"prior_precision": prior(perturbed_chain), "noise_mm": 1.0, "length_u_mm": 1.0}
    refuses("4 readings", design_problem, perturbed_chain, found, state(found.angles[:2]), volume, **options)


def test_a_trackers_candidates_need_no_length(perturbed_chain, volume):
    assert problem(perturbed_chain, tracker_poses(ARM, 2, seed=0), volume, length_u_mm=0.0).n_candidates == 2


def test_terms_that_no_pose_shows_do_not_count_as_told():
    """Some of this arm's terms move no tip; what rounding makes of them is not told, and the rank has a clear gap."""
    arm = load_arm("measuring7")
    known = nominal_prior(arm, noise_mm=NOISE_MM)
    rows = information_rows(known, bar_places(arm, 4, length_mm=500, poses=10, seed=0))
    told = observability(rows * np.sqrt(known.covariance.diagonal()), n_poses=80)
    assert not rows.any(axis=0).all()
    assert told.o2 > 1e-9
