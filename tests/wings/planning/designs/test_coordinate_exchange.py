"""Laws of plans that move little: no more uncertainty than allowed, no longer way, and every pose one that may be."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.chain import Chain
from truearm.wings.planning.designs import coordinate_exchange
from truearm.wings.planning.designs.candidates import ON_A_TABLE, NearbyPoses, seat_poses, tracker_poses
from truearm.wings.planning.designs.coordinate_exchange import (
    ENOUGH_RAD,
    MOST_UNCERTAINTY,
    shorten_path,
    squared_uncertainty,
    wanted_angles,
)
from truearm.wings.planning.designs.exchange import DesignProblem
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.planning.designs.proposal import Artefact, propose
from truearm.wings.planning.designs.sampling import CONE_RAD, inner_limits
from truearm.wings.planning.designs.tour import joint_moves, mean_joint_move, order_of_few_moves
from truearm.wings.planning.designs.workspace import Box, Sector, Surroundings, joint_origins

CASES = {
    "tracker": ("ur10", Artefact("tracker"), 20),
    "seats": ("gao2017", Artefact("seat", 2), 16),
    "bar": ("measuring7", Artefact("bar", 1, 400.0), 16),
}


@pytest.fixture(
    scope="module", params=["seats", *(pytest.param(name, marks=pytest.mark.weekly) for name in ("tracker", "bar"))]
)
def both(request):
    """The same plan as it was chosen for its uncertainty alone, and to be measured."""
    name, artefact, n = CASES[request.param]
    arm = load_arm(name)
    prior = nominal_prior(arm, noise_mm=0.02)
    chosen, measured = (propose(arm, prior, artefact, n, to_measure=which) for which in (None, "i-optimal"))
    return arm, chosen, measured


def test_a_plan_moves_less_at_hardly_more_uncertainty(both):
    _, chosen, measured = both
    before, after = chosen.proposals["i-optimal"], measured.proposals["i-optimal"]
    # Calculated anew from the poses: to rounding of the updates.
    assert after.rms_mm[-1] <= (MOST_UNCERTAINTY + 1e-6) * before.rms_mm[-1]
    assert after.mean_move < before.mean_move
    assert len(after.poses) == len(before.poses)


def test_other_strategies_are_as_they_were(both):
    _, chosen, measured = both
    for name, proposal in chosen.proposals.items():
        if name != "i-optimal":
            np.testing.assert_array_equal(proposal.poses.angles, measured.proposals[name].poses.angles)


def test_every_pose_is_in_its_seat_and_within_the_limits(both):
    arm, chosen, measured = both
    poses, before = (plan.proposals["i-optimal"].poses for plan in (measured, chosen))
    lower, upper = inner_limits(arm)
    assert ((poses.angles >= lower) & (poses.angles <= upper)).all()
    tips = arm.chain.tip_in_base(poses.angles)
    assert (joint_origins(arm.chain, poses.angles)[:, :, 2].min(axis=1) >= np.minimum(tips[:, 2], 0) - 1e-9).all()
    assert ON_A_TABLE.leaves_free(arm.chain, poses.angles).all()
    if poses.seat is None:
        return
    np.testing.assert_allclose(tips, poses.seat_points, atol=1e-5)  # mm, of inverse kinematics
    stylus = arm.chain.pose(poses.angles).R_base_tip[:, :, 2]
    assert (stylus[:, 2] <= -np.cos(CONE_RAD) + 1e-9).all()
    # The same seats in the same order, each in a row.
    assert list(dict.fromkeys(poses.seat)) == list(dict.fromkeys(before.seat))
    assert sum(a != b for a, b in pairwise(poses.seat)) == len(set(poses.seat)) - 1


def test_a_technicians_poses_stay(both):
    arm, chosen, _ = both
    prior, artefact, n = chosen.prior, chosen.artefact, len(chosen.proposals["random"].poses)
    again = propose(arm, prior, artefact, n, to_measure="technician")
    for name, proposal in chosen.proposals.items():
        np.testing.assert_array_equal(proposal.poses.angles, again.proposals[name].poses.angles)


# The search itself, on a problem of its own ---------------------------------------------------------------------------


def a_problem(rng, n=10, p=6):
    """Angles of a tracker plan, and factors that are smooth functions of the angles."""
    arm = load_arm("ur10")
    poses = tracker_poses(arm, n, seed=1)
    mixed, phase = rng.normal(size=(3, p, 6)), rng.normal(size=(3, p))

    def factors(angles):
        return np.sin(np.einsum("kpj,mj->mkp", mixed, angles) + phase)

    return arm, poses, DesignProblem(factors(poses.angles), np.eye(p), np.eye(p)), factors


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.weekly) for i in range(1, 4))])
def test_updates_and_exact_calculation_agree(rng, seed, monkeypatch):
    """A path of updates keeps within the uncertainty that is calculated without them."""
    monkeypatch.setattr(coordinate_exchange, "ENOUGH_RAD", 0.0)
    arm, poses, problem, factors = a_problem(rng)
    nearby = NearbyPoses(arm, ON_A_TABLE, Sector())
    found = shorten_path(arm, poses, problem, factors, nearby, seed=seed)
    inverse = np.linalg.inv(np.eye(6) + np.einsum("nkp,nkq->pq", *[factors(found.angles)] * 2))
    assert squared_uncertainty(problem, factors(found.angles)) == pytest.approx(np.trace(inverse), rel=1e-10)
    assert np.trace(inverse) <= MOST_UNCERTAINTY**2 * problem.variance(range(len(poses))) * (1 + 1e-9)
    order = order_of_few_moves(arm, poses.angles)
    assert mean_joint_move(arm, found.angles) < mean_joint_move(arm, poses.angles[order])


def test_a_path_that_is_short_enough_is_left_alone(rng):
    arm, poses, problem, factors = a_problem(rng, n=5)
    near = replace(poses, angles=poses.angles[:1] + 0.1 * ENOUGH_RAD * np.arange(5)[:, None])
    found = shorten_path(arm, near, problem, factors, NearbyPoses(arm, ON_A_TABLE, Sector()), seed=0)
    assert {tuple(row) for row in found.angles} == {tuple(row) for row in near.angles}


def test_where_no_other_pose_is_allowed_the_plan_stays(rng):
    arm, poses, problem, factors = a_problem(rng)
    everywhere = Surroundings(avoid=(Box((-1e5, -1e5, -1e5), (1e5, 1e5, 1e5)),))
    found = shorten_path(arm, poses, problem, factors, NearbyPoses(arm, everywhere, Sector()), seed=0)
    np.testing.assert_array_equal(found.angles, poses.angles[order_of_few_moves(arm, poses.angles)])


def test_progress_is_told(rng, monkeypatch):
    monkeypatch.setattr(coordinate_exchange, "ENOUGH_RAD", 0.0)
    arm, poses, problem, factors = a_problem(rng)
    told = []
    nearby = NearbyPoses(arm, ON_A_TABLE, Sector())
    shorten_path(arm, poses, problem, factors, nearby, seed=0, progress=lambda done, total: told.append((done, total)))
    assert told == [(done, told[0][1]) for done in range(told[0][1])]


# Offers --------------------------------------------------------------------------------------------------------------


def test_offers_go_the_shorter_way_round(rng):
    """From 175 deg to -175 deg a joint without limits turns by 10 deg: no offer is about 0."""
    arm = load_arm("gao2017")
    angles = np.tile(arm.working, (2, 1))
    angles[:, 0] = np.radians([175.0, -175.0])
    off = joint_moves(arm, np.tile(angles[:1], (400, 1)), wanted_angles(arm, angles, 400, rng)[0])
    assert np.median(off) < 1.0  # rad: the scatter


def test_sliding_joints_are_between_their_neighbours(rng):
    arm = load_arm("gao2017")
    slides = np.array([False] * 5 + [True])
    arm = replace(arm, chain=Chain(arm.chain.fixed, arm.chain.tip_in_flange, slides))
    angles = np.zeros((3, 6))
    angles[:, 5] = 100.0, 300.0, 250.0  # mm
    wanted = wanted_angles(arm, angles, 50, rng)[..., 5]
    low, high = np.array([[100, 300], [100, 300], [250, 300]]).T[..., None]
    assert ((wanted >= low - 1e-9) & (wanted <= high + 1e-9)).all()
    assert np.ptp(wanted, axis=1).min() > 10.0


def test_poses_near_wanted_angles_stay_in_the_seat():
    arm = load_arm("gao2017")
    poses = seat_poses(arm, seats=1, poses=12, seed=3)
    wanted = poses.angles + 0.2 * np.random.default_rng(0).standard_normal(poses.angles.shape)  # rad
    angles, allowed = NearbyPoses(arm, ON_A_TABLE, Sector()).find(wanted, poses.seat_points)
    assert allowed.any()
    tips = arm.chain.tip_in_base(angles[allowed])
    np.testing.assert_allclose(tips, poses.seat_points[allowed], atol=1e-5)  # mm
    # Nearer than the poses that the angles were scattered from are on average.
    moved, scattered = (np.linalg.norm(other - wanted, axis=1) for other in (angles, poses.angles))
    assert moved[allowed].mean() < scattered.mean()


def test_poses_in_the_table_or_outside_the_volume_are_not_allowed():
    arm = load_arm("ur10")
    inside = tracker_poses(arm, 30, seed=0).angles
    nearby = NearbyPoses(arm, ON_A_TABLE, Sector())
    free = ON_A_TABLE.leaves_free(arm.chain, inside)
    np.testing.assert_array_equal(nearby.find(inside)[1], free)
    behind = inside + np.array([np.pi, 0, 0, 0, 0, 0])
    assert not nearby.find(behind)[1].any()
