"""Denavit-Hartenberg tables: in as the books have them, out without loss, refused where they make no sense."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.arm import Chain, chain_from_dh, chain_from_mdh, dh_table, load_arm, mdh_table
from truearm.arm.rigid_motions import frame_from_xyz_rpy, rotation_from_z_to, xyz_rpy_from_frame

TABLES = [dh_table, mdh_table]
GAO = {
    "a": [0, 62, 0, 62, 0, 0],
    "d": [376, 0, 751, 0, 500, 15],
    "alpha": np.deg2rad([-90, -90, -90, -90, -90, 90]),
    "tip_in_flange": [0, 0, 98],
}


def assert_same_chain(one: Chain, other: Chain) -> None:
    """Tip poses to 1e-9 mm and 1e-12 rad: thousands of times rounding, a millionth of what an encoder resolves."""
    np.testing.assert_array_equal(one.is_prismatic, other.is_prismatic)
    q = np.random.default_rng(0).uniform(-4, 4, (30, one.n_joints)) * np.where(one.is_prismatic, 100, 1)
    first, second = one.pose(q), other.pose(q)
    np.testing.assert_allclose(first.tip_in_base, second.tip_in_base, atol=1e-9, rtol=0)
    np.testing.assert_allclose(first.R_base_tip, second.R_base_tip, atol=1e-12, rtol=0)


def chain_of_any_axes(seed: int) -> Chain:
    """Axes askew, parallel, opposite, crossing and coinciding, joints of both kinds."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    fixed = np.tile(np.eye(4), (n + 1, 1, 1))
    for frame in fixed:
        parallel = Rotation.from_euler("z", rng.uniform(-3, 3))
        turns = [Rotation.random(rng=rng), Rotation.from_euler("x", 90, degrees=True), parallel, Rotation.identity()]
        frame[:3, :3] = turns[rng.integers(4)].as_matrix() @ np.diag([[1, 1, 1], [1, -1, -1]][rng.integers(2)])
        frame[:3, 3] = rng.uniform(-500, 500, 3) * rng.integers(0, 2, 3)
    return Chain(fixed, rng.uniform(-100, 100, 3), rng.random(n) < 0.25)


# In


def test_one_row_is_the_product_of_its_four_motions():
    a, d, alpha, theta, q = 120.0, -30.0, 0.7, 0.2, 0.5
    Rz = Rotation.from_euler("z", q + theta).as_matrix()
    Rx = Rotation.from_euler("x", alpha).as_matrix()
    standard = chain_from_dh(a=[a], d=[d], alpha=[alpha], theta=[theta]).pose([[q]])
    np.testing.assert_allclose(standard.R_base_tip[0], Rz @ Rx, atol=1e-15)
    np.testing.assert_allclose(standard.tip_in_base[0], Rz @ [a, 0, d], atol=1e-12)
    modified = chain_from_mdh(a=[a], d=[d], alpha=[alpha], theta=[theta]).pose([[q]])
    np.testing.assert_allclose(modified.R_base_tip[0], Rx @ Rz, atol=1e-15)
    np.testing.assert_allclose(modified.tip_in_base[0], Rx @ [0, 0, d] + [a, 0, 0], atol=1e-12)


@pytest.mark.parametrize("build", [chain_from_dh, chain_from_mdh])
def test_a_sliding_joint_adds_to_d(build):
    table = {"a": [10, 20], "alpha": [0.3, -0.4], "theta": [0.1, 0.2]}
    slid = build(**table, d=[5, 7], kinds=["revolute", "prismatic"]).tip_in_base([[0.6, 30.0]])
    longer = build(**table, d=[5, 37]).tip_in_base([[0.6, 0.0]])
    np.testing.assert_allclose(slid, longer, atol=1e-12)


@pytest.mark.parametrize("build", [chain_from_dh, chain_from_mdh])
@pytest.mark.parametrize("locked", [0, 2, 5])
def test_a_locked_joint_is_an_arm_with_one_joint_fewer(build, locked):
    whole = build(**GAO)
    theta = np.zeros(6)
    theta[locked] = 0.4
    kinds = ["fixed" if i == locked else "revolute" for i in range(6)]
    fewer = build(**GAO, theta=theta, kinds=kinds)
    assert fewer.n_joints == 5
    q = np.random.default_rng(0).uniform(-3, 3, (10, 5))
    np.testing.assert_allclose(
        fewer.tip_in_base(q), whole.tip_in_base(np.insert(q, locked, 0.4, axis=1)), atol=1e-9, rtol=0
    )


def test_base_and_flange_stand_before_and_after_the_table():
    base, flange = frame_from_xyz_rpy([1, 2, 3], [0.1, 0.2, 0.3]), frame_from_xyz_rpy([4, 5, 6], [0.3, 0.2, 0.1])
    for build in (chain_from_dh, chain_from_mdh):
        plain = build(a=[100], d=[20], alpha=[0.5])
        framed = build(a=[100], d=[20], alpha=[0.5], base=base, flange=flange, tip_in_flange=[0, 0, 7])
        pose = plain.pose([[0.3]])
        inner = pose.R_base_tip[0] @ (flange[:3, :3] @ [0, 0, 7] + flange[:3, 3]) + pose.tip_in_base[0]
        np.testing.assert_allclose(framed.tip_in_base([[0.3]])[0], base[:3, :3] @ inner + base[:3, 3], atol=1e-11)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"d": [1, 2]}, r"columns of one length, got 6 of a and shape \(2,\) of d"),
        ({"alpha": [np.nan] * 6}, "alpha must be finite"),
        ({"kinds": ["revolute"] * 5}, "expected 6 kinds"),
        ({"kinds": ["revolute"] * 5 + ["hinge"]}, "revolute, prismatic, fixed"),
        ({"kinds": ["fixed"] * 6}, "at least one joint that moves"),
        ({"base": np.eye(3)}, r"base must be a \(4, 4\) rigid motion"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(change, message):
    refuses(message, chain_from_dh, **(GAO | change))


# Out


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
@pytest.mark.parametrize("table_of", TABLES)
def test_a_table_of_any_chain_rebuilds_it(table_of, seed):
    chain = chain_of_any_axes(seed)
    assert_same_chain(chain, table_of(chain, max_offset_mm=1e5).chain())


@pytest.mark.parametrize("table_of", TABLES)
def test_a_table_without_joints_in_line_comes_back_as_it_went_in(table_of):
    build = chain_from_dh if table_of is dh_table else chain_from_mdh
    table = table_of(build(**GAO))
    np.testing.assert_allclose(table.a, GAO["a"], atol=1e-12)
    np.testing.assert_allclose(table.d, GAO["d"], atol=1e-12)
    np.testing.assert_allclose(table.theta, 0, atol=1e-15)
    for frame in (table.base, table.flange):
        np.testing.assert_allclose(frame, np.eye(4), atol=1e-12)


def test_parallel_axes_put_the_whole_offset_into_the_row_where_they_end():
    # UR10 with its three parallel axes pushed 10, -4 and 7 mm along themselves: only the sum can be seen.
    alpha = np.deg2rad([90, 0, 0, 90, -90, 0])
    pushed = chain_from_dh(a=[0, -612, -572.3, 0, 0, 0], d=[127.3, 10, -4, 170.941, 115.7, 92.2], alpha=alpha)
    table = dh_table(pushed)
    np.testing.assert_allclose(table.d, [127.3, 0, 0, 176.941, 115.7, 92.2], atol=1e-11)
    np.testing.assert_allclose(table.a, [0, -612, -572.3, 0, 0, 0], atol=1e-11)
    assert_same_chain(pushed, table.chain())


@pytest.mark.parametrize("table_of", TABLES)
def test_nearly_parallel_axes_are_refused_with_the_joints_and_a_way_out(table_of):
    almost = load_arm("gen3lite").chain  # its file says 3.1416, so axes 2 and 3 miss being parallel by 7e-6 rad
    refuses(r"joints 2 and 3 are nearly but not quite parallel.* 3.81e\+04 m.*URDF", table_of, almost)


@pytest.mark.parametrize("table_of", TABLES)
def test_a_base_and_a_flange_nearly_along_the_axes_are_no_obstacle(table_of):
    # A tracker levelled to 10 urad; a flange out of square by as much: no row has to describe them.
    tilt = frame_from_xyz_rpy([400, 300, 200], [1e-5, 0, 0.3])
    chain = chain_from_dh(a=[300, 200], d=[0, 0], alpha=[1.0, 0], base=tilt, flange=tilt, tip_in_flange=[1, 2, 3])
    table = table_of(chain)
    assert np.abs(table.d).max() < 1000
    assert_same_chain(chain, table.chain())


# Frames


@settings(max_examples=60)
@given(st.lists(st.floats(-3.2, 3.2), min_size=3, max_size=3), st.sampled_from([None, np.pi / 2, -np.pi / 2]))
def test_roll_pitch_yaw_go_there_and_back(rpy, pitch):
    if pitch is not None:
        rpy[1] = pitch  # roll and yaw about the same line
    frame = frame_from_xyz_rpy([1, 2, 3], rpy)
    np.testing.assert_allclose(frame[:3, :3], Rotation.from_euler("xyz", rpy).as_matrix(), atol=1e-15)
    xyz, back = xyz_rpy_from_frame(frame)
    np.testing.assert_allclose(frame_from_xyz_rpy(xyz, back), frame, atol=1e-15)


@settings(max_examples=50)
@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_z_is_turned_to_any_axis(axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    turn = rotation_from_z_to(axis)
    np.testing.assert_allclose(turn[:, 2], axis, atol=1e-15)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) > 0
