"""The inverse kinematics of every branch, and the configuration that a program states."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_programs import TOOL, WORK, in_work

import truearm as ta
from truearm.wings.exports.programs.branches import (
    N_BRANCHES,
    QUANTITIES,
    Screws,
    inverse_branches,
    polished,
    quantities_of,
)
from truearm.wings.exports.programs.numbers import angles_of, quaternion_of, rotation_of, rotation_of_quaternion
from truearm.wings.exports.programs.program import Condition, Target
from truearm.wings.exports.programs.rapid import Rapid
from truearm.wings.exports.programs.solving import Machine, nominal_joints

ARMS = ("ur10", "irb2600-12-165", "kr16", "lrmate200id", "gp8", "tx2-60", "cr5")
TURN = 2 * np.pi
angle = st.floats(-180.0, 180.0)


def off(a, b):
    """Distance of angles, whole turns aside."""
    return np.abs(np.remainder(a - b + np.pi, TURN) - np.pi)


def random_joints(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(np.maximum(arm.lower, -3.1), np.minimum(arm.upper, 3.1), (n, 6))


@pytest.mark.parametrize("name", ARMS)
def test_there_and_back_in_every_branch(name):
    arm = ta.load_arm(name)
    joints = random_joints(arm, 200)
    flange = in_work(arm.chain, joints, np.eye(4), np.eye(4))
    branches = inverse_branches(arm.chain, Screws.of(arm.chain), flange).reshape(-1, 6)
    found = polished(arm.chain, np.repeat(flange, N_BRANCHES, axis=0), branches)
    good = np.isfinite(found).all(axis=1)
    # Every branch that exists reaches the pose [mm], and one of them has the joints [rad]: rounding is far below both.
    again = in_work(arm.chain, found[good], np.eye(4), np.eye(4))
    np.testing.assert_allclose(again, np.repeat(flange, N_BRANCHES, axis=0)[good], atol=1e-8)
    nearest = np.nanmin(off(found.reshape(-1, N_BRANCHES, 6), joints[:, None]).max(axis=2), axis=1)
    assert nearest.max() < 1e-9
    assert good.sum() >= 6 * len(joints)


@pytest.mark.parametrize("name", ["ur10", "kr16"])
def test_branches_are_different_joints(name):
    arm = ta.load_arm(name)
    flange = in_work(arm.chain, random_joints(arm, 20), np.eye(4), np.eye(4))
    for branches in inverse_branches(arm.chain, Screws.of(arm.chain), flange):
        some = branches[np.isfinite(branches).all(axis=1)]
        apart = off(some[:, None], some[None]).max(axis=2) + 9 * np.eye(len(some))
        assert apart.min() > 1e-3


def test_out_of_reach_there_is_no_branch():
    arm = ta.load_arm("irb2600-12-165")
    flange = np.eye(4)[None].copy()
    flange[0, :3, 3] = 5000.0
    assert np.isnan(inverse_branches(arm.chain, Screws.of(arm.chain), flange)).any(axis=2).all()


def test_an_arm_of_another_kind_has_no_closed_form():
    assert Screws.of(ta.load_arm("panda").chain) is None
    assert Screws.of(ta.load_arm("xarm6").chain) is None


@pytest.mark.parametrize(
    ("name", "degrees", "front", "in_front_of_link"),
    [
        # A forearm held level: the wrist is in front of axis 1 and of the upright lower arm.
        ("irb2600-12-165", [30, 0, 0, 0, 0, 0], True, True),
        ("kr16", [0, -90, 90, 0, 0, 0], True, True),
        ("kr16", [-120, -90, 90, 0, 0, 0], True, True),
        ("gp8", [0, 0, 0, 0, 0, 0], True, True),
        ("lrmate200id", [0, 0, 0, 0, 0, 0], True, True),
        # The forearm folded back over the upright lower arm.
        ("irb2600-12-165", [0, 0, -170, 0, 0, 0], False, False),
        # Bent backwards over the base, the forearm still in front of the lower arm, which leans back.
        ("irb2600-12-165", [0, -80, -60, 0, 0, 0], False, True),
    ],
)
def test_the_sides_of_the_wrist_centre(name, degrees, front, in_front_of_link):
    arm = ta.load_arm(name)
    joints = np.radians([degrees])
    found = dict(zip(QUANTITIES, quantities_of(Screws.of(arm.chain), joints, joints)[0], strict=True))
    assert (found["shoulder"] > 0) == front
    assert (found["elbow"] > 0) == in_front_of_link


@pytest.mark.parametrize("name", ["irb2600-12-165", "kr16", "gp8"])
def test_the_signs_of_all_quantities_choose_one_branch(name):
    arm, language = ta.load_arm(name), Rapid()
    joints = random_joints(arm, 100, seed=5)
    stated = quantities_of(Screws.of(arm.chain), joints, joints)
    targets = [
        Target(
            "p",
            1,
            {},
            pose=pose,
            T_flange_tool=TOOL,
            T_base_work=WORK,
            conditions=tuple(
                Condition(name, *((0.0, np.inf) if value > 0 else (-np.inf, 0.0)))
                for name, value in zip(QUANTITIES[:8], row[:8], strict=True)
            ),
        )
        for pose, row in zip(in_work(arm.chain, joints), stated, strict=True)
    ]
    found, reasons = nominal_joints(Machine.of(arm, arm.chain, language), targets, np.zeros(100))
    assert not any(reasons)
    np.testing.assert_allclose(found, joints, atol=1e-7)


@given(st.lists(angle, min_size=3, max_size=3), st.sampled_from([None, 90.0, -90.0]))
@settings(deadline=None)
def test_angles_of_a_rotation_are_those_it_was_made_of(angles, locked):
    wpr = angles if locked is None else [angles[0], locked, angles[2]]
    found = angles_of(rotation_of(wpr), wpr)
    # Next to P = 90 deg W and R are known to the square root of rounding only, their rotation is.
    np.testing.assert_allclose(rotation_of(found), rotation_of(wpr), atol=1e-7)
    if abs(abs(wpr[1]) - 90.0) > 1.0:
        np.testing.assert_allclose(found, wpr, atol=1e-9)


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
@settings(deadline=None)
def test_a_quaternion_keeps_its_sign(q):
    q = np.array(q) / np.linalg.norm(q)
    np.testing.assert_allclose(quaternion_of(rotation_of_quaternion(q), q), q, atol=1e-12)
