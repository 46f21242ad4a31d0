"""Laws of the candidates: the tip is where the artefact is, limits hold, a seed repeats; and plans made of them."""

import numpy as np
import pytest

from arms_of_each_build import ARMS
from refusals import refuses
from truearm.arm.arm import Arm
from truearm.arm.catalogue import load_arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.wings.planning.designs.candidates import Candidates, bar_places, seat_poses, tracker_poses, volume_poses
from truearm.wings.planning.designs.exchange import (
    DesignProblem,
    moment_matrix,
    project_out,
    select_candidates,
    stack_factors,
)
from truearm.wings.planning.designs.sampling import END_STOP_MARGIN_RAD, Sector
from truearm.wings.planning.designs.workspace import azimuth_of, joint_origins, stance


def gantry() -> Arm:
    """One joint that slides and two that turn."""
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[2:, 0, 3] = 300.0
    return Arm(
        "gantry",
        Chain(fixed, [0, 0, 0], np.array([True, False, False])),
        lower=np.array([0.0, -np.inf, -np.inf]),
        upper=np.array([500.0, np.inf, np.inf]),
    )


def feasible(arm, candidates):
    """Within the limits, 2 deg off them, and above the table."""
    lower, upper = arm.limits.T
    turns = ~arm.chain.is_prismatic
    margin = np.minimum(END_STOP_MARGIN_RAD, np.minimum(arm.working - lower, upper - arm.working))[turns]
    angles = candidates.angles
    # 1e-12 rad: rounding of limit and margin.
    assert (angles >= lower).all()
    assert (angles <= upper).all()
    assert (angles[:, turns] >= lower[turns] + margin - 1e-12).all()
    assert (angles[:, turns] <= upper[turns] - margin + 1e-12).all()
    low = np.minimum(arm.chain.tip_in_base(angles)[:, 2], 0)
    assert (joint_origins(arm.chain, angles)[:, :, 2].min(axis=1) >= low).all()


def in_sector(arm, points, sector):
    where = stance(arm)
    ahead = (points - where.shoulder_in_base) / where.reach_mm
    radius = np.hypot(ahead[:, 0], ahead[:, 1])
    # 1e-8: the inverse kinematics reaches its targets to 1e-6 mm.
    assert radius.min() >= sector.near - 1e-8
    assert radius.max() <= sector.far + 1e-8
    assert ahead[:, 2].min() >= sector.low - 1e-8
    assert ahead[:, 2].max() <= sector.high + 1e-8
    assert np.degrees(np.abs(azimuth_of(points, where))).max() <= sector.half_angle_deg + 1e-6


def same(one, other):
    assert (one.angles == other.angles).all()
    assert (one.candidate == other.candidate).all()


# --- seats ---


@pytest.mark.parametrize("name", ["measuring7", "gao2017", "panda"])
def test_the_tip_is_in_the_seat(name):
    arm = load_arm(name)
    found = seat_poses(arm, seats=3, poses=8, seed=1)
    assert len(found) == 24
    assert found.seat.tolist() == ["S1"] * 8 + ["S2"] * 8 + ["S3"] * 8
    # 2e-6 mm: twice the tolerance of the inverse kinematics.
    assert np.abs(arm.chain.tip_in_base(found.angles) - found.seat_points).max() < 2e-6
    assert len(np.unique(found.seat_points.round(3), axis=0)) == 3
    feasible(arm, found)
    same(found, seat_poses(arm, seats=3, poses=8, seed=1))


def test_seats_may_be_given():
    arm = load_arm("measuring7")
    where = stance(arm)
    points = where.shoulder_in_base + 0.5 * where.reach_mm * np.array([[1.0, 0.2, 0.0], [0.9, -0.3, 0.1]])
    found = seat_poses(arm, seats=points, poses=5, seed=0)
    assert found.seat_points[::5] == pytest.approx(points)
    with pytest.raises(InputError, match=r"fewer than 5 postures reach the seat.*in front of the shoulder"):
        seat_poses(arm, seats=[*points, [9e3, 0, 0]], poses=5, seed=0)


def test_a_seat_with_all_its_poses_may_be_one_candidate():
    found = seat_poses(load_arm("gao2017"), seats=11, poses=2, seed=0).group_by_place()
    assert len(found) == 11
    assert found.candidate.tolist() == np.repeat(np.arange(11), 2).tolist()
    assert found.seat[found.readings([10, 1])].tolist() == ["S11", "S11", "S2", "S2"]


# --- bars ---


@pytest.mark.parametrize("name", ["measuring7", "ur10"])
def test_a_bar_has_its_length_at_every_place(name):
    arm = load_arm(name)
    sector = Sector(0.3, 0.8, -0.2, 0.3, 50)
    found = bar_places(arm, 6, length_mm=300, poses=3, seed=2, sector=sector)
    assert len(found) == 6
    assert found.length_mm == 300
    assert found.seat[found.readings([1])].tolist() == ["B2a"] * 3 + ["B2b"] * 3
    tips = arm.chain.tip_in_base(found.angles)
    assert np.abs(tips - found.seat_points).max() < 2e-6  # mm, as above
    ends = found.seat_points.reshape(6, 2, 3, 3)[:, :, 0]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == pytest.approx(np.full(6, 300.0))
    in_sector(arm, tips, sector)
    feasible(arm, found)
    same(found, bar_places(arm, 6, length_mm=300, poses=3, seed=2, sector=sector))


def test_bars_lie_in_all_directions():
    found = bar_places(load_arm("measuring7"), 25, length_mm=200, poses=2, seed=0)
    ends = found.seat_points.reshape(25, 2, 2, 3)[:, :, 0]
    spread = np.linalg.svd((ends[:, 1] - ends[:, 0]) / 200, compute_uv=False)
    assert spread[2] > 0.3 * spread[0]  # upright ones more often reach out of the sector, which is flat


# --- tracker ---


@pytest.mark.parametrize("name", [*ARMS[:3], *(pytest.param(name, marks=pytest.mark.weekly) for name in ARMS[3:])])
def test_half_of_the_poses_under_a_tracker_are_a_technicians(name):
    arm = load_arm(name)
    found = tracker_poses(arm, 41, seed=3)
    assert len(found) == 41
    assert found.technician.sum() == 20
    in_sector(arm, arm.chain.tip_in_base(found.angles), Sector())
    feasible(arm, found)
    same(found, tracker_poses(arm, 41, seed=3))
    assert not (tracker_poses(arm, 41, seed=4).angles == found.angles).any()


def test_joints_go_through_their_range():
    arm = load_arm("measuring7")
    found = tracker_poses(arm, 600, seed=0)
    spread = np.ptp(found.angles[~found.technician], axis=0)
    assert (spread[[2, 4, 6]] > 0.9 * 2 * np.pi).all()  # those without limits


def test_an_arm_that_cannot_point_its_stylus_has_poses_and_a_volume_too():
    arm, sector = gantry(), Sector(0.1, 1.0, -1.0, 1.0, 90)
    found = tracker_poses(arm, 10, seed=0, sector=sector)
    assert not found.technician.any()
    feasible(arm, found)
    assert volume_poses(arm, 7, seed=0, sector=sector).shape == (7, 3)


# --- plans ---


def jacobian(arm, angles):
    """By constants of all places behind the base, in units of their priors (1 mrad, 1 mm) [mm]."""
    motion_jacobian = arm.chain.tip_derivatives(angles).motion_jacobian[:, 1:] * np.repeat([1e-3, 1.0], 3)[:, None]
    return motion_jacobian.transpose(0, 3, 1, 2).reshape(len(angles), 3, -1)


@pytest.fixture(scope="module")
def volume():
    arm = load_arm("measuring7")
    angles = volume_poses(arm, 60, seed=9)
    return arm, moment_matrix(jacobian(arm, angles), arm.chain.tip_in_base(angles))


def test_poses_chosen_leave_less_uncertainty_than_poses_drawn(volume):
    arm, target = volume
    found = tracker_poses(arm, 200, seed=0)
    J = jacobian(arm, found.angles) / 0.02
    problem = DesignProblem(J, np.eye(J.shape[2]), target)
    best = problem.variance(select_candidates(problem, 15))
    rngs = [np.random.default_rng(seed) for seed in range(5)]
    drawn = [problem.variance(rng.permutation(200)[:15]) for rng in rngs]
    technician = [problem.variance(rng.permutation(np.flatnonzero(found.technician))[:15]) for rng in rngs]
    assert best < min(drawn)
    assert best < min(technician)
    assert best <= problem.variance(select_candidates(problem, 15, strategy="d-optimal"))


def test_places_of_a_bar_chosen_leave_less_uncertainty_than_places_drawn(volume):
    """Each place is a candidate with 4 poses at both ends; its seats' points are eliminated."""
    arm, target = volume
    found = bar_places(arm, 30, length_mm=400, poses=4, seed=5)
    J = jacobian(arm, found.angles) / 0.02
    seats = np.zeros((25, 6))
    seats[:12, :3] = seats[12:24, 3:] = np.tile(np.eye(3), (4, 1)) / 0.02
    factors = []
    for place in range(30):
        rows = found.readings([place])
        along = (found.seat_points[rows[-1]] - found.seat_points[rows[0]]) / 400
        nuisance = seats.copy()
        nuisance[24] = np.concatenate([-along, along]) / 0.005
        by_constants = np.concatenate([J[rows].reshape(24, -1), np.zeros((1, J.shape[2]))])
        factors.append(project_out(by_constants, nuisance))
    problem = DesignProblem(stack_factors(factors), np.eye(J.shape[2]), target)
    best = select_candidates(problem, 3)
    drawn = [problem.variance(np.random.default_rng(seed).permutation(30)[:3]) for seed in range(5)]
    assert problem.variance(best) < min(drawn)
    # One place brings the scale: the error of a bar a hundredth of a millimetre wrong is small beside what was before.
    assert problem.course(best)[1] < 0.1 * problem.course(best)[0]


# --- bad input ---


def test_candidates_are_checked():
    arm = load_arm("measuring7")
    for call, why in (
        (lambda: seat_poses(arm, seats=0, poses=3, seed=0), "at least one of seats"),
        (lambda: seat_poses(arm, seats=2, poses=0, seed=0), "at least one of poses"),
        (lambda: seat_poses(arm, seats=[[1.0, 2.0]], poses=2, seed=0), "finite points"),
        (lambda: seat_poses(arm, seats=2, poses=2, seed=-1), "seed"),
        (lambda: seat_poses(gantry(), seats=2, poses=2, seed=0), "five joints"),
        (lambda: bar_places(arm, 2, length_mm=0, poses=2, seed=0), "positive length"),
        (lambda: bar_places(arm, 2, length_mm=np.nan, poses=2, seed=0), "positive length"),
        (lambda: bar_places(arm, 2, length_mm=1e5, poses=2, seed=0), "hardly fits"),
        (lambda: bar_places(arm, 0, length_mm=100, poses=2, seed=0), "places"),
        (lambda: tracker_poses(arm, 0, seed=0), "poses"),
        (lambda: tracker_poses(gantry(), 5, seed=0, sector=Sector(0.9, 1.0, 3.0, 4.0)), "larger sector"),
        (lambda: tracker_poses(arm, 4, seed=0).group_by_place(), "no seats"),
    ):
        refuses(why, call)


def test_candidates_are_numbered_from_zero():
    found = Candidates(np.zeros((3, 2)), np.array([0, 0, 1]))
    assert len(found) == 2
    assert found.readings([1, 0]).tolist() == [2, 0, 1]
    assert found.readings([]).tolist() == []
