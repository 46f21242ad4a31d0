"""Finite motions in the chain: derivatives by their components, constant or from pose to pose, in pieces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from truearm.arm import Chain
from truearm.arm.rigid_motions import (
    FEW,
    cross_matrix,
    exponential_derivative,
    inverse,
    motion,
    rotations,
    rotations_and_jacobians,
)

# Rounding of a dozen products of numbers up to some thousand mm: 1e-12 mm; three orders above it.
ROUNDING_MM = 1e-9
SIZES = [0.0, 1e-300, 1e-9, 9.9e-5, 1.01e-4, 1e-2, 0.5, 2.0, 3.1]


def random_chain(seed: int, n: int = 4, *, sliding: float = 0.3) -> Chain:
    rng = np.random.default_rng(seed)
    fixed = np.tile(np.eye(4), (n + 1, 1, 1))
    fixed[:, :3, :3] = Rotation.random(n + 1, rng=rng).as_matrix()
    fixed[:, :3, 3] = rng.normal(0, 300, (n + 1, 3))
    return Chain(fixed, rng.normal(0, 100, 3), rng.random(n) < sliding)


def random_joints(chain: Chain, count: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, (count, chain.n_joints)) * np.where(chain.is_prismatic, 200.0, np.pi)


def random_motions(chain: Chain, count: int, size: float, rng: np.random.Generator) -> np.ndarray:
    """(n_places, 6, count): rotation vectors of length `size` [rad], shifts of some mm."""
    motions = rng.normal(size=(chain.n_places, 6, count))
    motions[:, :3] *= size / np.linalg.norm(motions[:, :3], axis=1, keepdims=True)
    motions[:, 3:] *= 10
    return motions


def by_chunk(chain: Chain, angles: np.ndarray, motions: np.ndarray, chunk: int = 4096):
    """Tips (n, 3) and derivatives (n_places, 6, 3, n) of all pieces."""
    pieces = [
        (tips.copy(), motion_jacobian.copy())
        for _, tips, motion_jacobian in chain.tip_derivatives_by_chunk(
            angles, lambda rows: motions[..., rows] if motions.shape[2] > 1 else motions, chunk=chunk
        )
    ]
    return np.concatenate([tips for tips, _ in pieces], axis=1).T, np.concatenate([by for _, by in pieces], axis=3)


def tips_of(chain: Chain, angles: np.ndarray, motions: np.ndarray) -> np.ndarray:
    wide = np.broadcast_to(motions, (*motions.shape[:2], len(angles)))
    return chain.tip_in_base(angles, wide.transpose(2, 0, 1))


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from(SIZES), st.sampled_from([0.0, 0.5, 1.0]), st.booleans())
def test_derivatives_by_the_components_of_finite_motions_are_the_difference_quotients(seed, size, sliding, constant):
    rng = np.random.default_rng(seed)
    chain = random_chain(seed, sliding=sliding)
    angles = random_joints(chain, 3, rng)
    motions = random_motions(chain, 1 if constant else 3, size, rng)
    tips, motion_jacobian = by_chunk(chain, angles, motions)
    np.testing.assert_allclose(tips, tips_of(chain, angles, motions), atol=ROUNDING_MM, rtol=0)
    # Central differences err by step^2/6 times the third derivative (levers up to some 5000 mm): 8e-6 mm/rad for 1e-4;
    # rounding adds 1e-12/1e-4. Shifts are exactly linear.
    for component in range(6):
        step, atol = (1e-4, 3e-5) if component < 3 else (1.0, ROUNDING_MM)
        for place in range(chain.n_places):
            there, back = motions.copy(), motions.copy()
            there[place, component] += step
            back[place, component] -= step
            quotient = (tips_of(chain, angles, there) - tips_of(chain, angles, back)) / (2 * step)
            np.testing.assert_allclose(motion_jacobian[place, component].T, quotient, atol=atol, rtol=0)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from(SIZES))
def test_a_motion_for_all_poses_is_the_same_motion_in_each(seed, size):
    rng = np.random.default_rng(seed)
    chain = random_chain(seed)
    angles = random_joints(chain, 5, rng)
    motions = random_motions(chain, 1, size, rng)
    tips, motion_jacobian = by_chunk(chain, angles, motions)
    tips_each, by_each = by_chunk(chain, angles, np.repeat(motions, 5, axis=2))
    np.testing.assert_allclose(tips, tips_each, atol=ROUNDING_MM, rtol=0)
    np.testing.assert_allclose(motion_jacobian, by_each, atol=ROUNDING_MM, rtol=0)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from(SIZES), st.sampled_from([0.0, 0.5, 1.0]), st.booleans())
def test_many_poses_are_a_few_at_a_time(seed, size, sliding, constant):
    """Frame by frame, and by matrices of all places."""
    rng = np.random.default_rng(seed)
    chain, n = random_chain(seed, sliding=sliding), 100
    angles, motions = random_joints(chain, n, rng), random_motions(chain, 1 if constant else n, size, rng)
    few = [slice(start, start + 20) for start in range(0, n, 20)]
    for one, other in zip(by_chunk(chain, angles, motions), by_chunk(chain, angles, motions, 20), strict=True):
        np.testing.assert_allclose(one, other, atol=ROUNDING_MM, rtol=0)
    parts = [tips_of(chain, angles[rows], motions if constant else motions[..., rows]) for rows in few]
    np.testing.assert_allclose(tips_of(chain, angles, motions), np.concatenate(parts), atol=ROUNDING_MM, rtol=0)
    whole = chain.pose_derivatives(angles, motions)
    parts = [chain.pose_derivatives(angles[rows], motions if constant else motions[..., rows]) for rows in few]
    for one, pieces in zip(whole, zip(*parts, strict=True), strict=True):
        np.testing.assert_allclose(one, np.concatenate(pieces, axis=-1), atol=ROUNDING_MM, rtol=0)


@pytest.mark.parametrize("n", [20, 100])
def test_a_tip_on_an_axis_is_not_moved_by_turns_about_it(n):
    """Ranks of readings tell a column that is zero from one that is small: of many poses the zero is exact."""
    chain = random_chain(3, sliding=0.0)
    fixed = chain.fixed.copy()
    fixed[-1] = np.eye(4)
    chain, rng = Chain(fixed, np.array([0.0, 0.0, 150.0]), chain.prismatic), np.random.default_rng(3)
    moved = chain.tip_derivatives(random_joints(chain, n, rng)).motion_jacobian[:, chain.n_joints, 2]
    np.testing.assert_allclose(moved, 0.0, atol=1e-9 if n == 20 else 0.0, rtol=0)


def test_no_motion_gives_the_small_motions_of_the_chain():
    chain = random_chain(1)
    angles = random_joints(chain, 7, np.random.default_rng(1))
    small = chain.tip_derivatives(angles)
    for m in (1, 7):
        tips, motion_jacobian = by_chunk(chain, angles, np.zeros((chain.n_places, 6, m)))
        np.testing.assert_allclose(tips, small.tip_in_base, atol=ROUNDING_MM, rtol=0)
        np.testing.assert_allclose(
            motion_jacobian.transpose(3, 0, 1, 2), small.motion_jacobian, atol=ROUNDING_MM, rtol=0
        )


def test_the_moved_chain_has_the_same_tips():
    chain = random_chain(2)
    rng = np.random.default_rng(2)
    angles = random_joints(chain, 6, rng)
    motions = random_motions(chain, 1, 0.4, rng)
    tips, _ = by_chunk(chain, angles, motions)
    np.testing.assert_allclose(tips, chain.with_motions(motions[..., 0]).tip_in_base(angles), atol=ROUNDING_MM, rtol=0)


@pytest.mark.parametrize("chunk", [1, 2, 4, 5, 9, 10, 100])
@pytest.mark.parametrize("m", [1, 9])
def test_pieces_of_any_size_make_the_whole(chunk, m):
    # Matrix products may round another way in another width: 1e-12 relative to 3 m.
    chain = random_chain(3)
    rng = np.random.default_rng(3)
    angles = random_joints(chain, 9, rng)
    motions = random_motions(chain, m, 0.1, rng)
    tips, motion_jacobian = by_chunk(chain, angles, motions, chunk)
    whole_tips, whole = by_chunk(chain, angles, motions)
    assert tips.shape == (9, 3)
    np.testing.assert_allclose(tips, whole_tips, atol=1e-11, rtol=0)
    np.testing.assert_allclose(motion_jacobian, whole, atol=1e-11, rtol=0)


def test_no_poses_make_no_pieces():
    chain = random_chain(4)
    assert not list(chain.tip_derivatives_by_chunk(np.zeros((0, 4)), lambda _: np.zeros((6, 6, 1))))


def test_the_flanges_axes_are_the_derivatives_by_shifts_of_the_tip():
    chain = random_chain(5)
    rng = np.random.default_rng(5)
    angles = random_joints(chain, 4, rng)
    motions = random_motions(chain, 1, 0.3, rng)
    _, motion_jacobian = by_chunk(chain, angles, motions)
    axes = motion_jacobian[-1, 3:].transpose(2, 1, 0) @ Rotation.from_rotvec(motions[-1, :3, 0]).as_matrix()
    pose = chain.with_motions(motions[..., 0]).pose(angles)
    np.testing.assert_allclose(axes, pose.R_base_tip, atol=1e-13)
    assert not motion_jacobian[-1, :3].any()  # turning about the tip moves nothing


# Rotations and their Jacobians


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from(SIZES))
def test_rotations_are_scipys_and_jacobians_the_difference_quotients(seed, size):
    rng = np.random.default_rng(seed)
    r = rng.normal(size=(3, 4))
    r *= size / np.linalg.norm(r, axis=0)
    R, J = rotations_and_jacobians(r)
    np.testing.assert_allclose(R.transpose(2, 0, 1), Rotation.from_rotvec(r.T).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(
        J.transpose(2, 0, 1), exponential_derivative(np.pad(r.T, ((0, 0), (0, 3))))[:, :3, :3], atol=1e-11
    )
    step = 1e-5
    for k in range(3):
        change = np.zeros((3, 1))
        change[k] = step
        there, back = (Rotation.from_rotvec((r + sign * change).T) for sign in (1, -1))
        quotient = (there * back.inv()).as_rotvec() / (2 * step)
        # truncation step^2, rounding 1e-16 / step
        np.testing.assert_allclose(J[:, k].T, quotient, atol=3e-10)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.99e-6, 1.01e-6, 1e-5, 1e-3, 0.1, 1.0, 3.1])
def test_rotations_and_jacobians_are_exponentials_at_every_angle(angle):
    """Angles below 1e-6 rad have the functions of 1e-6 rad. J is the integral of exp(s K) over s from 0 to 1."""
    r = angle * np.array([0.6, 0.0, 0.8])
    K = cross_matrix(r)
    R, J = rotations_and_jacobians(r[:, None])
    np.testing.assert_allclose(R[..., 0], expm(K), atol=2e-15, rtol=0)
    integral = expm(np.block([[K, np.eye(3)], [np.zeros((3, 6))]]))[:3, 3:]
    np.testing.assert_allclose(J[..., 0], integral, atol=2e-15, rtol=0)
    np.testing.assert_array_equal(rotations(r[:, None]), R)
    many = np.repeat(r[:, None], FEW + 1, axis=1)  # of small angles by series
    for of_many, one in zip((rotations(many), *rotations_and_jacobians(many)), (R, R, J), strict=True):
        np.testing.assert_allclose(of_many, np.broadcast_to(one, of_many.shape), atol=2e-15, rtol=0)


@pytest.mark.parametrize(
    "lay_out", [np.ascontiguousarray, np.asfortranarray, lambda r: np.repeat(r, 2, axis=1)[:, ::2]]
)
def test_rotations_of_vectors_in_any_order_of_memory(lay_out):
    r = lay_out(np.random.default_rng(5).standard_normal((3, 7)))
    expected = Rotation.from_rotvec(r.T).as_matrix().transpose(1, 2, 0)
    np.testing.assert_allclose(rotations(r), expected, atol=2e-15, rtol=0)


def test_a_rigid_motion_and_its_inverse_are_those_of_dense_algebra(rng):
    R, t = Rotation.random(5, rng=1).as_matrix(), rng.normal(size=(5, 3))
    for T in (motion(R, t), motion(R[0], t), motion(R, t[0]), motion(R[0], t[0].tolist())):
        np.testing.assert_allclose(inverse(T), np.linalg.inv(T), atol=1e-14)
    np.testing.assert_array_equal(motion(R[0], t)[3], motion(R[0], t[3]))
