"""Poses with finite motions at every place, and their derivatives by joints and motions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_chain_motions import random_chain

# Rounding of a dozen products of numbers up to some thousand mm is 1e-12 mm; three orders above it.
ROUNDING_MM = 1e-9
ROUNDING = 1e-12
# Central differences over 1e-5 rad (or 1e-3 mm) of poses of some 1000 mm: truncation 1e-7, rounding 1e-7 of them.
STEP = 1e-5
QUOTIENT_MM = 1e-4
QUOTIENT = 1e-6


def random_case(seed: int, size: float, count: int = 3):
    """A chain, joints (count, n_joints) and motions (count, n_places, 6)."""
    rng = np.random.default_rng(seed)
    chain = random_chain(seed)
    joints = rng.uniform(-1, 1, (count, chain.n_joints)) * np.where(chain.is_prismatic, 200.0, np.pi)
    motions = rng.normal(size=(count, chain.n_places, 6)) * np.repeat([size, 10 * size], 3)
    return chain, joints, motions


def difference(chain, joints, motions, changed_joints=0.0, changed_motions=0.0):
    """Central difference quotient of poses, (n, 6)."""
    after = chain.pose(joints + STEP * changed_joints, motions + STEP * changed_motions)
    before = chain.pose(joints - STEP * changed_joints, motions - STEP * changed_motions)
    turn = Rotation.from_matrix(after.R_base_tip @ before.R_base_tip.transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([after.tip_in_base - before.tip_in_base, turn], axis=1) / (2 * STEP)


def assert_quotient(analytic, quotient):
    np.testing.assert_allclose(analytic[:, :3], quotient[:, :3], atol=QUOTIENT_MM)
    np.testing.assert_allclose(analytic[:, 3:], quotient[:, 3:], atol=QUOTIENT)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-3, 0.5]))
def test_a_pose_with_motions_is_that_of_the_chain_with_them_composed(seed, size):
    chain, joints, motions = random_case(seed, size)
    for q, motion, R, tip in zip(joints, motions, *chain.pose(joints, motions), strict=True):
        composed = chain.with_motions(motion).pose(q[None])
        np.testing.assert_allclose(R, composed.R_base_tip[0], atol=ROUNDING)
        np.testing.assert_allclose(tip, composed.tip_in_base[0], atol=ROUNDING_MM)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-3, 0.5]))
def test_derivatives_of_poses_are_the_difference_quotients(seed, size):
    chain, joints, motions = random_case(seed, size)
    R, tip, by_joint, by_motion = chain.pose_derivatives(joints, np.ascontiguousarray(motions.transpose(1, 2, 0)))
    pose = chain.pose(joints, motions)
    np.testing.assert_allclose(R.transpose(2, 0, 1), pose.R_base_tip, atol=ROUNDING)
    np.testing.assert_allclose(tip.T, pose.tip_in_base, atol=ROUNDING_MM)
    for joint, change in enumerate(np.eye(chain.n_joints)):
        assert_quotient(by_joint[joint].T, difference(chain, joints, motions, changed_joints=change))
    for place in range(chain.n_places):
        for component in range(6):
            change = np.zeros((chain.n_places, 6))
            change[place, component] = 1.0
            quotient = difference(chain, joints, motions, changed_motions=change)
            assert_quotient(by_motion[place, component].T, quotient)


@pytest.mark.parametrize("seed", range(3))
def test_without_motions_they_are_those_of_zero_motions(seed):
    chain, joints, _ = random_case(seed, 0.0)
    zero = np.zeros((chain.n_places, 6, 1))
    for plain, moved in zip(chain.pose_derivatives(joints), chain.pose_derivatives(joints, zero), strict=True):
        np.testing.assert_allclose(plain, moved, atol=ROUNDING_MM)
    for plain, moved in zip(chain.pose(joints), chain.pose(joints, np.zeros((3, chain.n_places, 6))), strict=True):
        np.testing.assert_allclose(plain, moved, atol=ROUNDING_MM)
