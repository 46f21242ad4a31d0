"""Laws of the sampling strategies: limits hold, a seed repeats, targets are met, rejections are told."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arms_of_each_build import ARMS
from refusals import refuses
from truearm.arm.arm import Arm
from truearm.arm.catalogue import load_arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.sampling import farthest_points
from truearm.wings.planning.designs.sampling import (
    END_STOP_MARGIN_RAD,
    FROM_ABOVE,
    STRATEGIES,
    Sector,
    box,
    measuring_poses,
    seat,
    surface_normals,
    uniform,
)
from truearm.wings.planning.designs.workspace import azimuth_of, draw_points, joint_origins, stance, within_cone


def limited(low_deg: float = -30.0, high_deg: float = 10.0, working_deg: float = 0.0) -> Arm:
    """Two upright joints, the first with limits."""
    fixed = np.tile(np.eye(4), (3, 1, 1))
    fixed[1:, 0, 3] = 300.0
    return Arm(
        "limited",
        Chain(fixed, [0, 0, 0]),
        lower=np.radians([low_deg, -np.inf]),
        upper=np.radians([high_deg, np.inf]),
        working_pose=np.radians([working_deg, 50.0]),
    )


def slider() -> Arm:
    return Arm("gantry", Chain(np.tile(np.eye(4), (3, 1, 1)), [0, 0, 0], np.array([True, False])))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("strategy", list(STRATEGIES))
def test_every_strategy_keeps_every_arm_inside_its_limits(name, strategy):
    arm = load_arm(name)
    poses = STRATEGIES[strategy](arm, 12, seed=5).angles
    assert poses.shape == (12, arm.n_joints)
    assert ((poses >= arm.limits[:, 0]) & (poses <= arm.limits[:, 1])).all()


@pytest.mark.parametrize("strategy", list(STRATEGIES))
def test_a_seed_repeats(strategy):
    poses, again, other = (STRATEGIES[strategy](load_arm(ARMS[0]), 12, seed=seed).angles for seed in (5, 5, 6))
    assert (again == poses).all()
    assert not (other == poses).all()


# --- box and uniform ---


@settings(max_examples=25)
@given(st.integers(1, 200), st.integers(0, 2**32), st.floats(0.01, 3.0), st.booleans())
def test_a_box_lies_about_the_working_pose(n, seed, half, sobol):
    arm = limited()
    angles = box(arm, n, seed=seed, half_width=half, sobol=sobol).angles
    assert angles.shape == (n, 2)
    # 1e-12 rad: rounding of centre plus half-width.
    assert (np.abs(angles - arm.working) <= half + 1e-12).all()
    assert ((angles >= arm.limits[:, 0]) & (angles <= arm.limits[:, 1])).all()


def test_a_box_is_20_degrees_to_each_side_unless_told():
    angles = np.degrees(box(load_arm("gao2017"), 4000, seed=0).angles - load_arm("gao2017").working)
    assert angles.min(axis=0) == pytest.approx(np.full(6, -20), abs=0.1)
    assert angles.max(axis=0) == pytest.approx(np.full(6, 20), abs=0.1)


def test_a_box_may_have_a_width_for_each_joint():
    angles = box(limited(), 1000, seed=0, half_width=[0.1, 1.0]).angles - limited().working
    assert np.abs(angles).max(axis=0) == pytest.approx([0.1, 1.0], rel=0.01)


def test_uniform_fills_the_limits_and_one_turn_without_them():
    angles = np.degrees(uniform(limited(), 4000, seed=0).angles)
    assert angles.min(axis=0) == pytest.approx([-30, 50 - 180], abs=0.5)
    assert angles.max(axis=0) == pytest.approx([10, 50 + 180], abs=0.5)


def test_a_joint_with_one_limit_gets_a_full_turn_from_it():
    arm = Arm("half", limited().chain, lower=np.array([-1.0, -np.inf]), upper=np.array([np.inf, 2.0]))
    angles = uniform(arm, 4000, seed=0).angles
    assert angles.min(axis=0) == pytest.approx([-1, 2 - 2 * np.pi], abs=0.01)
    assert angles.max(axis=0) == pytest.approx([2 * np.pi - 1, 2], abs=0.01)


def test_sobol_points_cover_more_evenly_than_independent_ones():
    """Of 16 equal slices along each joint each holds as many of 64 Sobol points."""
    arm = load_arm("gao2017")
    slices = np.floor((box(arm, 64, seed=0, sobol=True).angles - arm.working) / np.radians(40) * 16 + 8).astype(int)
    assert all((np.bincount(column, minlength=16) == 4).all() for column in slices.T)


# --- measuring ---


@pytest.fixture(scope="module", params=["gao2017", "measuring7"])
def technician(request):
    arm = load_arm(request.param)
    return arm, measuring_poses(arm, 300, seed=1)


def test_measured_points_lie_in_the_front_sector(technician):
    arm, poses = technician
    where = stance(arm)
    tips = arm.chain.tip_in_base(poses.angles)
    ahead = (tips - where.shoulder_in_base) / where.reach_mm
    radius = np.hypot(ahead[:, 0], ahead[:, 1])
    # The inverse kinematics reaches its targets to 1e-6 mm.
    assert radius.min() >= 0.30 - 1e-8
    assert radius.max() <= 0.85 + 1e-8
    assert ahead[:, 2].min() >= -0.30 - 1e-8
    assert ahead[:, 2].max() <= 0.40 + 1e-8
    assert np.abs(azimuth_of(tips, where)).max() <= np.radians(60) + 1e-8


def test_the_stylus_points_down_or_sideways_and_seldom_up(technician):
    arm, poses = technician
    height = arm.chain.pose(poses.angles).R_base_tip[:, 2, 2]
    # Off a horizontal normal it may rise by the cone's 40 deg, and no more.
    assert height.max() <= np.sin(np.radians(40)) + 1e-7
    assert (height < -np.cos(np.radians(40)) + 1e-7).mean() > 0.4


def test_the_elbow_swings_to_both_sides(technician):
    """Of the elbow's angle about the line from shoulder to tip, from straight up: N(0, 35 deg) was asked for."""
    arm, poses = technician
    shoulder = stance(arm).shoulder_in_base
    tip, elbow = arm.chain.tip_in_base(poses.angles) - shoulder, joint_origins(arm.chain, poses.angles)[:, 3] - shoulder
    along = tip / np.linalg.norm(tip, axis=1, keepdims=True)
    up = np.array([0, 0, 1.0]) - along[:, 2:] * along
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    across = np.cross(along, up)
    swing = np.degrees(np.arctan2((elbow * across).sum(axis=1), (elbow * up).sum(axis=1)))
    assert abs(np.median(swing)) < 8
    assert 20 < swing.std() < 50


def test_no_joint_leans_on_an_end_stop_or_lies_under_the_table(technician):
    arm, poses = technician
    lower, upper = arm.limits.T
    # No joint but one that the working pose itself holds nearer to its stop; none does here.
    assert (poses.angles >= lower + END_STOP_MARGIN_RAD - 1e-12).all()
    assert (poses.angles <= upper - END_STOP_MARGIN_RAD + 1e-12).all()
    lowest = joint_origins(arm.chain, poses.angles)[:, :, 2].min(axis=1)
    assert (lowest >= np.minimum(arm.chain.tip_in_base(poses.angles)[:, 2], 0.0) - 1e-5).all()


def test_a_freely_turning_handle_rolls(technician):
    arm, poses = technician
    if arm.n_joints == 7:
        assert np.degrees(poses.angles[:, 6].std()) > 50


def test_what_was_rejected_is_counted_by_reason(technician):
    _, poses = technician
    assert sum(poses.rejected.values()) > 0
    assert all(isinstance(reason, str) and count > 0 for reason, count in poses.rejected.items())


def test_a_sector_out_of_reach_is_told_with_its_reason():
    with pytest.raises(InputError, match=r"arm 'gao2017' takes only 0 of 3 poses in 90 targets: \d+ x target"):
        measuring_poses(load_arm("gao2017"), 3, seed=0, sector=Sector(near=1.2, far=1.4))


def test_surfaces_look_up_or_sideways_and_not_away_from_the_arm():
    where = stance(load_arm("gao2017"))
    rng = np.random.default_rng(0)
    tips = draw_points(where, 2000, sector=Sector(), rng=rng)
    normals = surface_normals(tips, where, rng)
    up = normals[:, 2] == 1
    assert up.mean() == pytest.approx(FROM_ABOVE, abs=0.045)  # 2000 draws: 1 % scatter, four of them
    back = (where.shoulder_in_base - tips)[~up]
    cosine = (back[:, :2] * normals[~up, :2]).sum(axis=1) / np.linalg.norm(back[:, :2], axis=1)
    assert cosine.min() >= np.cos(np.radians(110)) - 1e-9
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(2000))


def test_directions_fill_the_cone_evenly():
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(20_000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    out = within_cone(axes, half_angle_rad=0.7, rng=rng)
    cosine = (out * axes).sum(axis=1)
    assert np.linalg.norm(out, axis=1) == pytest.approx(np.ones(20_000))
    assert cosine.min() >= np.cos(0.7) - 1e-12
    # Evenly over a cap: the cosine is even between cos 0.7 and 1; 20 000 draws know its mean to 0.0005.
    assert cosine.mean() == pytest.approx((1 + np.cos(0.7)) / 2, abs=0.002)


def test_the_shoulder_is_joint_2_and_the_reach_goes_on_from_there():
    where = stance(load_arm("gao2017"))
    assert where.shoulder_in_base == pytest.approx([0, 0, 376])
    # Links: 62 across and 751 along make two segments; 62, 500 and 15 + 98 along the last axis' normal.
    assert where.reach_mm == pytest.approx(62 + 751 + 62 + 500 + np.hypot(15, 98))
    assert where.front_rad == pytest.approx(np.arctan2(15, 758), abs=1e-3)


# --- seats ---


def test_the_tip_stays_in_its_seat_while_the_joints_move():
    arm = load_arm("measuring7")
    poses = seat(arm, 31, seed=2, seats=3)
    assert poses.seat.tolist() == ["S1"] * 11 + ["S2"] * 10 + ["S3"] * 10
    assert np.abs(arm.chain.tip_in_base(poses.angles) - poses.seat_points).max() < 1e-6
    assert len(np.unique(poses.seat_points, axis=0)) == 3
    for name in ("S1", "S2", "S3"):
        spread = np.degrees(np.ptp(poses.angles[poses.seat == name], axis=0))
        assert np.sort(spread)[2] > 60  # five of seven joints move by more than 60 deg


def test_given_seats_are_taken_in_their_order():
    arm = load_arm("gao2017")
    points = [[700.0, 0, 100], [500.0, 300, 200]]
    poses = seat(arm, 8, seed=0, seats=points)
    assert (poses.seat_points == np.repeat(points, 4, axis=0)).all()


def test_the_most_different_rows_are_the_corners():
    angles = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0.5], [0.4, 0.6]])
    assert set(farthest_points(angles, 4)) == {0, 1, 2, 3}


# --- what is refused ---


def with_a_slider():
    arm = load_arm("gao2017")
    slides = np.array([False] * 5 + [True])
    return replace(arm, name="with_a_slider", chain=Chain(arm.chain.fixed, arm.chain.tip_in_flange, slides))


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: box(limited(), 0, seed=0), "at least one of poses, got 0"),
        (lambda: box(limited(), 5, seed=-1), "seed"),
        (lambda: box(limited(), 5, seed=0, half_width=0.0), "positive half-width"),
        (lambda: box(limited(), 5, seed=0, half_width=[1.0, 1.0, 1.0]), "positive half-width or 2"),
        (lambda: box(limited(), 5, seed=0, half_width=float("nan")), "positive half-width"),
        (lambda: box(slider(), 5, seed=0), "prismatic joint J1 of arm 'gantry' has no limits"),
        (lambda: uniform(slider(), 5, seed=0), "prismatic joint J1 of arm 'gantry' has no limits"),
        (lambda: measuring_poses(limited(), 5, seed=0), "need five joints; arm 'limited' has 2"),
        (lambda: measuring_poses(load_arm("gao2017"), 0, seed=0), "at least one"),
        (lambda: measuring_poses(with_a_slider(), 5, seed=0), "J6 of arm 'with_a_slider' is prismatic"),
        (lambda: seat(limited(), 5, seed=0), "need five joints"),
        (lambda: seat(load_arm("gao2017"), 2, seed=0, seats=3), "2 poses for 3 seats"),
        (lambda: seat(load_arm("gao2017"), 2, seed=0, seats=0), "at least one of seats"),
        (lambda: seat(load_arm("gao2017"), 2, seed=0, seats=[[1, 2]]), r"\(n_seats, 3\)"),
        (lambda: seat(load_arm("gao2017"), 2, seed=0, seats=[[9000.0, 0, 0]]), "fewer than 2 postures reach the seat"),
    ],
)
def test_what_does_not_fit_is_refused(call, says):
    refuses(says, call)
