"""Inverse kinematics: what is called reached is reached, within the limits; what cannot be is told."""

import numpy as np
import pytest

from arms_of_each_build import ARMS
from refusals import refuses
from truearm.arm import Arm, Chain, chain_from_dh, load_arm, solve_inverse_kinematics

SPREAD = np.deg2rad(30)


def reachable(name: str, n: int, spread: float = SPREAD):
    """An arm and the poses of random joint angles near its working pose, within its limits."""
    arm = load_arm(name)
    lower, upper = arm.limits.T
    q = np.random.default_rng(7).uniform(-spread, spread, (n, arm.n_joints)) + arm.working
    return arm, np.clip(q, lower, upper)


@pytest.mark.parametrize("with_axis", [False, True])
@pytest.mark.parametrize("with_posture", [False, True])
@pytest.mark.parametrize("name", ARMS)
def test_reachable_targets_are_reached_within_the_limits(name, with_axis, with_posture):
    arm, q = reachable(name, 300)
    pose = arm.chain.pose(q)
    axis = pose.R_base_tip[:, :, 2] if with_axis else None
    lower, upper = arm.limits.T
    found = solve_inverse_kinematics(
        arm.chain,
        pose.tip_in_base,
        start=arm.working,
        probe_axis_in_base=axis,
        posture=arm.working if with_posture else None,
        lower=lower,
        upper=upper,
    )
    assert found.reached.mean() > 0.99
    assert (found.angles >= lower).all()
    assert (found.angles <= upper).all()
    there = arm.chain.pose(found.angles[found.reached])
    np.testing.assert_allclose(there.tip_in_base, pose.tip_in_base[found.reached], atol=1e-6 + 1e-11)
    if axis is not None:
        cross = np.cross(there.R_base_tip[:, :, 2], axis[found.reached])
        assert np.linalg.norm(cross, axis=1).max() < 1e-8 + 1e-13


def test_errors_are_those_of_the_forward_kinematics():
    arm, q = reachable("measuring7", 50)
    pose = arm.chain.pose(q)
    targets = pose.tip_in_base * [[1.0, 1.0, 1.4]]  # some of them out of reach
    found = solve_inverse_kinematics(
        arm.chain, targets, start=arm.working, probe_axis_in_base=[0, 0, -1], upper=arm.limits[:, 1], max_steps=30
    )
    there = arm.chain.pose(found.angles)
    np.testing.assert_allclose(found.distance_mm, np.linalg.norm(there.tip_in_base - targets, axis=1), atol=1e-9)
    np.testing.assert_allclose(np.cos(found.angle_rad), -there.R_base_tip[:, 2, 2], atol=1e-9)


def test_targets_out_of_reach_are_told_and_the_arm_stretches_toward_them():
    arm = load_arm("measuring7")
    shoulder = np.array([0, 0, 320.0])
    directions = np.array([[1.0, 0.2, 0.1], [0.8, -0.5, 0.3], [0.5, 0.5, -0.1]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = solve_inverse_kinematics(arm.chain, shoulder + 2000 * directions, start=arm.working)
    assert not found.reached.any()
    # The links add up to 1250 mm (3 mm more with the elbow's offset), so 750 mm are missing; it stops where the slope
    # becomes flat, some mm before.
    np.testing.assert_allclose(found.distance_mm, 750, atol=10)


def test_a_target_behind_the_limits_is_told_and_the_limits_hold():
    crank = chain_from_dh(a=[100, 100], d=[0, 0], alpha=[0, 0])
    target = crank.tip_in_base([[2.0, 0.5]])
    free = solve_inverse_kinematics(crank, target, start=[0.1, 0.1])
    assert free.reached.all()
    limited = solve_inverse_kinematics(crank, target, start=[0.1, 0.1], lower=[-1, -1], upper=[1, 1])
    assert not limited.reached.any()
    assert (np.abs(limited.angles) <= 1).all()
    # The nearest point within the limits, from a fine grid.
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 401)] * 2), axis=-1).reshape(-1, 2)
    nearest = np.linalg.norm(crank.tip_in_base(grid) - target, axis=1).min()
    assert limited.distance_mm[0] < nearest + 0.01


def test_two_links_find_one_of_their_two_solutions():
    crank = chain_from_dh(a=[300, 200], d=[0, 0], alpha=[0, 0])
    x, y = 250.0, 120.0
    elbow = np.arccos((x**2 + y**2 - 300**2 - 200**2) / (2 * 300 * 200))  # law of cosines
    found = solve_inverse_kinematics(crank, [[x, y, 0], [x, y, 0]], start=[[0.1, 0.5], [0.1, -0.5]])
    np.testing.assert_allclose(found.angles[:, 1], [elbow, -elbow], atol=1e-7)


def test_a_slide_takes_part_in_mm():
    arm = chain_from_dh(a=[0, 0], d=[0, 0], alpha=[np.pi / 2, 0], kinds=["revolute", "prismatic"])
    target = arm.tip_in_base([[0.7, 240.0]])
    found = solve_inverse_kinematics(arm, target, start=[0.0, 100.0], lower=[-2, 0], upper=[2, 500])
    assert found.reached.all()
    np.testing.assert_allclose(found.angles, [[0.7, 240.0]], atol=1e-6)


def test_a_posture_is_kept_as_far_as_the_target_leaves_freedom():
    arm, q = reachable("measuring7", 200)
    tips = arm.chain.tip_in_base(q)
    posture = arm.working + np.deg2rad([0, 0, 40, 0, 0, 0, 0])
    plain = solve_inverse_kinematics(arm.chain, tips, start=arm.working)
    drawn = solve_inverse_kinematics(arm.chain, tips, start=arm.working, posture=posture)
    assert drawn.reached.all()

    def away(angles: np.ndarray) -> float:
        return float(np.linalg.norm(angles - posture, axis=1).mean())

    assert away(drawn.angles) < 0.8 * away(plain.angles)
    # Nearly nothing of the pull is left in the null space: the angles could not come nearer without leaving the target.
    J = arm.chain.tip_derivatives(drawn.angles).motion_jacobian[:, 1:-1, 2].transpose(0, 2, 1)
    rest = posture - drawn.angles
    free = rest - (np.linalg.pinv(J) @ J @ rest[:, :, None])[:, :, 0]
    assert np.median(np.linalg.norm(free, axis=1) / np.linalg.norm(rest, axis=1)) < 0.1


def test_rows_do_not_know_each_other():
    arm, q = reachable("gao2017", 40)
    pose = arm.chain.pose(q)
    options = {"start": arm.working, "posture": arm.working + 0.1}
    whole = solve_inverse_kinematics(
        arm.chain, pose.tip_in_base, probe_axis_in_base=pose.R_base_tip[:, :, 2], **options
    )
    for row in (0, 13, 39):
        single = solve_inverse_kinematics(
            arm.chain, pose.tip_in_base[[row]], probe_axis_in_base=pose.R_base_tip[row, :, 2], **options
        )
        # Rounding differs with the width of a matrix product; forty steps may carry it to the tolerance.
        np.testing.assert_allclose(single.angles[0], whole.angles[row], atol=1e-6)


def test_an_axis_is_turned_even_from_the_opposite_direction():
    arm = load_arm("measuring7")
    pose = arm.chain.pose([arm.working])
    axis = -pose.R_base_tip[0, :, 2]
    start = arm.working
    found = solve_inverse_kinematics(arm.chain, [[600.0, 0.0, 500.0]], start=start, probe_axis_in_base=axis)
    assert found.reached.all()


def test_a_target_at_the_start_needs_no_step():
    arm = load_arm("ur10")
    found = solve_inverse_kinematics(arm.chain, arm.chain.tip_in_base([arm.working]), start=arm.working, max_steps=0)
    np.testing.assert_array_equal(found.angles, [arm.working])
    assert found.reached.all()


def test_no_targets_no_rows():
    found = solve_inverse_kinematics(load_arm("ur10").chain, np.empty((0, 3)), start=np.zeros(6), posture=np.zeros(6))
    assert found.angles.shape == (0, 6)
    assert found.reached.shape == (0,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tips_in_base": [1, 2, 3]}, r"targets of shape \(n, 3\), got \(3,\)"),
        ({"tips_in_base": [[1, 2, np.nan]]}, "targets must be finite"),
        ({"start": np.zeros(5)}, r"expected start of shape \(6,\) or \(1, 6\), got \(5,\)"),
        ({"start": np.full(6, np.nan)}, "start must be numbers"),
        ({"start": np.full(6, np.inf)}, "start must be numbers, got inf"),
        ({"posture": np.zeros((2, 6))}, "expected posture of shape"),
        ({"lower": np.zeros(5)}, "expected lower of shape"),
        ({"lower": np.full(6, np.nan)}, "lower must be numbers"),
        ({"lower": np.ones(6), "upper": np.zeros(6)}, "must not be above"),
        ({"probe_axis_in_base": [0, 0, 0]}, "must not be zero"),
        ({"probe_axis_in_base": [0, 1]}, "expected probe_axis_in_base of shape"),
        ({"R_base_tip": np.eye(4)}, r"expected R_base_tip of shape \(3, 3\) or \(1, 3, 3\), got \(4, 4\)"),
        ({"R_base_tip": [np.diag([1.0, 1.0, -1.0])]}, "expected rotation matrices as R_base_tip, number 0 is none"),
        ({"R_base_tip": np.full((3, 3), np.nan)}, "R_base_tip must be numbers"),
        ({"R_base_tip": np.eye(3), "probe_axis_in_base": [0, 0, 1]}, "got both"),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    options = {"tips_in_base": [[500.0, 0, 500]], "start": np.zeros(6)} | change
    targets = options.pop("tips_in_base")
    refuses(message, solve_inverse_kinematics, load_arm("ur10").chain, targets, **options)


def test_the_chain_is_left_as_it_was():
    chain = load_arm("ur5").chain
    before = chain.fixed.copy()
    start = np.zeros(6)
    solve_inverse_kinematics(chain, [[300.0, 100, 300]], start=start)
    np.testing.assert_array_equal(chain.fixed, before)
    np.testing.assert_array_equal(start, 0)
    assert isinstance(chain, Chain)


@pytest.mark.parametrize("name", ARMS)
def test_whole_poses_are_reached_within_the_limits(name):
    arm, q = reachable(name, 200)
    pose = arm.forward(q)
    found = arm.inverse(pose.tip_in_base, pose.R_base_tip)
    assert found.reached.all()
    assert (found.angles >= arm.limits[:, 0]).all()
    assert (found.angles <= arm.limits[:, 1]).all()
    there = arm.forward(found.angles)
    # The tolerances of the solver, and rounding of some turns of a metre.
    np.testing.assert_allclose(there.tip_in_base, pose.tip_in_base, rtol=0, atol=1e-6 + 1e-11)
    np.testing.assert_allclose(there.R_base_tip, pose.R_base_tip, rtol=0, atol=1e-8 + 1e-13)


def test_a_solution_states_its_steps_its_jacobian_and_its_condition():
    arm, q = reachable("ur10", 20)
    tips = arm.forward(q).tip_in_base
    found = arm.inverse(tips, start=arm.working)
    assert (found.steps > 0).all()
    lever = np.maximum(arm.chain.reach, np.linalg.norm(tips - arm.chain.fixed[0, :3, 3], axis=1)) / 3
    by_joint = arm.jacobian(found.angles)[:, :3]
    np.testing.assert_allclose(found.jacobian * lever[:, None, None], by_joint, rtol=0, atol=1e-12 * arm.chain.reach)
    np.testing.assert_allclose(found.condition, np.linalg.cond(by_joint), rtol=1e-9)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_poses_all_over_the_joint_ranges_are_reached_from_other_starts(name):
    arm = load_arm(name)
    q = np.random.default_rng(3).uniform(*arm.limits.T, (50, arm.n_joints))
    pose = arm.forward(q)
    from_working_pose = arm.inverse(pose.tip_in_base, pose.R_base_tip, start=arm.working)
    found = arm.inverse(pose.tip_in_base, pose.R_base_tip)
    assert not from_working_pose.reached.all()
    assert found.reached.all()
    kept = from_working_pose.reached
    # The first call is the same; its last bit may hang on where numbers lie in memory.
    np.testing.assert_allclose(found.angles[kept], from_working_pose.angles[kept], rtol=0, atol=1e-9)


def test_targets_beyond_the_reach_are_told_from_every_start():
    arm = load_arm("ur5")
    found = arm.inverse([[400.0, 0.0, 300.0], [5000.0, 0.0, 0.0]])
    assert found.reached.tolist() == [True, False]
    assert found.distance_mm[1] > 4000


def test_jacobian_of_an_arm_with_a_rail_is_that_of_difference_quotients():
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, 3] = [[100.0, 20.0, 5.0], [300.0, 0.0, 50.0], [0.0, 40.0, 10.0]]
    fixed[1, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    arm = Arm("rail", Chain(fixed, [10.0, 5.0, 60.0], [True, False, False]))
    q = np.random.default_rng(5).uniform(-1, 1, (7, 3)) * [200.0, 2.0, 2.0]
    J = arm.jacobian(q)
    assert J.shape == (7, 6, 3)
    R = arm.forward(q).R_base_tip
    for joint, step in enumerate([1e-3, 1e-6, 1e-6]):
        away = np.zeros(3)
        away[joint] = step
        ahead, behind = arm.forward(q + away), arm.forward(q - away)
        shift = (ahead.tip_in_base - behind.tip_in_base) / (2 * step)
        skew = (ahead.R_base_tip - behind.R_base_tip) @ R.transpose(0, 2, 1) / (2 * step)
        turn = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        # Rounding of 500 mm and of 1, divided by the step.
        np.testing.assert_allclose(J[:, :3, joint], shift, rtol=0, atol=1e-6)
        np.testing.assert_allclose(J[:, 3:, joint], turn, rtol=0, atol=1e-8)


def test_an_arm_without_limits_finds_starts_too():
    arm = Arm("crank", chain_from_dh(a=[100, 80], d=[0, 0], alpha=[0, 0]))
    found = arm.inverse([[-60.0, -90.0, 0.0], [30.0, 0.0, 0.0]])
    assert found.reached.all()
