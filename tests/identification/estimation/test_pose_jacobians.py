"""Derivatives of poses by the joints, with the slopes of the small motions; what is neglected stays small."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truearm.arm import load_arm
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import ArmState, Constant, GravityTorque, Harmonics, Term

# Central differences over 1e-6 rad of harmonics of order 80: truncation 1e-9 of a slope, rounding 1e-6 mm/rad.
STEP = 1e-6
QUOTIENT_MM = 1e-4
QUOTIENT = 1e-7


def case(*, gravity: bool):
    """A UR10 with constants, harmonics of its own and of another joint and, if asked for, bending by weight."""
    rng, arm = np.random.default_rng(3), load_arm("ur10")
    axes = np.eye(6)
    terms = [Term("constant", 2, tuple(rng.normal(size=6)), Constant(), "a", 1.0)]
    for joint in range(1, 7):
        terms.append(Term(f"own {joint}", joint, tuple(axes[2]), Harmonics(joint, (1, 2, 80)), "b", 1.0))
        terms.append(Term(f"wobble {joint}", joint, tuple(axes[joint % 6]), Harmonics(joint, (1, 2)), "c", 1.0))
    terms.append(Term("another joint's", 3, tuple(axes[1]), Harmonics(5, (3,)), "d", 1.0))
    if gravity:
        terms.append(Term("bending", 2, tuple(axes[0]), GravityTorque(2, 2), "e", 1.0))
    chain = PerturbedChain(arm.chain, tuple(terms))
    x = rng.normal(0, 1e-3, chain.n_coefficients)
    if gravity:
        x[-1] = 2e-5  # 2e-4 rad under 10 N m
    return chain, x, ArmState.of(arm, rng.uniform(-2, 2, (4, 6)))


def difference(chain, x, state, joint):
    shift = STEP * np.eye(6)[joint]
    after, before = (chain.poses(replace(state, angles=state.angles + d), x) for d in (shift, -shift))
    turn = Rotation.from_matrix(after.R_base_tip @ before.R_base_tip.transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([after.tip_in_base - before.tip_in_base, turn], axis=1) / (2 * STEP)


@pytest.mark.parametrize("joint", range(6))
def test_derivatives_by_joints_include_the_slopes_of_harmonics(joint):
    chain, x, state = case(gravity=False)
    pose, jacobian = chain.pose_jacobians(state, x)
    quotient = difference(chain, x, state, joint)
    np.testing.assert_allclose(jacobian[:, :3, joint], quotient[:, :3], atol=QUOTIENT_MM)
    np.testing.assert_allclose(jacobian[:, 3:, joint], quotient[:, 3:], atol=QUOTIENT)
    # mm; of few poses derivatives come from products of matrices, with a rounding of their own.
    np.testing.assert_allclose(pose.tip_in_base, chain.tips(state, x), rtol=0, atol=1e-11)
    np.testing.assert_allclose(pose.R_base_tip, chain.poses(state, x).R_base_tip, atol=1e-14)


def test_the_neglected_slope_of_gravity_is_a_thousandth():
    """It only slows the convergence of Newton's method: by as much a step."""
    chain, x, state = case(gravity=True)
    _, jacobian = chain.pose_jacobians(state, x)
    quotient = np.stack([difference(chain, x, state, joint) for joint in range(6)], axis=2)
    assert 1e-6 < np.abs(jacobian - quotient)[:, :3].max() / np.abs(quotient[:, :3]).max() < 1e-3


def test_slopes_of_harmonics_are_their_difference_quotients():
    basis, weights = Harmonics(2, (1, 3, 40)), np.random.default_rng(1).normal(size=(6, 2))
    _, _, state = case(gravity=False)
    joint, slopes = basis.joint_slope(weights)
    after, before = (
        weights.T @ basis.values(replace(state, angles=state.angles + s * STEP * np.eye(6)[1])) for s in (1, -1)
    )
    assert joint == 2
    np.testing.assert_allclose(slopes.T @ basis.values(state), (after - before) / (2 * STEP), atol=1e-5)
    assert GravityTorque(1, 0).joint_slope(weights[:1]) is None


def test_an_arm_in_another_frame_is_one_that_is_made_there():
    """What was prepared of its terms is of use in every frame."""
    chain, x, state = case(gravity=True)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix(), [100.0, -2e3, 5.0]
    made = PerturbedChain(chain.chain.with_reference_frame(frame), chain.terms)
    for found, expected in zip(chain.in_frame(frame).derivatives(state, x), made.derivatives(state, x), strict=True):
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other)
