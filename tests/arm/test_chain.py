"""The chain: laws of rigid motions, derivatives against difference quotients, chunks, hand-solved arms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.arm import Chain, chain_from_dh, exponential_derivative, load_arm
from truearm.arm.chain import CHUNK

# Rounding of a dozen products of numbers up to some thousand mm: 1e-12 mm; three orders above it.
ROUNDING_MM = 1e-9


def random_chain(seed: int, n: int = 5, *, sliding: float = 0.3) -> Chain:
    rng = np.random.default_rng(seed)
    fixed = np.tile(np.eye(4), (n + 1, 1, 1))
    fixed[:, :3, :3] = Rotation.random(n + 1, rng=rng).as_matrix()
    fixed[:, :3, 3] = rng.normal(0, 300, (n + 1, 3))
    return Chain(fixed, rng.normal(0, 100, 3), rng.random(n) < sliding)


def random_joints(chain: Chain, count: int, seed: int) -> np.ndarray:
    scale = np.where(chain.is_prismatic, 200.0, np.pi)
    return np.random.default_rng(seed).uniform(-1, 1, (count, chain.n_joints)) * scale


def plain_pose(chain: Chain, q: np.ndarray) -> np.ndarray:
    """One pose by multiplying 4 x 4 matrices: the definition."""
    T = chain.fixed[0].copy()
    for i, angle in enumerate(q):
        joint = np.eye(4)
        if chain.is_prismatic[i]:
            joint[2, 3] = angle
        else:
            joint[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
        T = T @ joint @ chain.fixed[i + 1]
    T[:3, 3] += T[:3, :3] @ chain.tip_in_flange
    return T


# What it computes


def test_two_links_in_a_plane_as_school_has_it():
    chain = chain_from_dh(a=[300, 200], d=[0, 0], alpha=[0, 0], tip_in_flange=[50, 0, 0])
    q = np.array([[0.0, 0.0], [np.pi / 2, 0.0], [0.3, 0.5]])
    x = 300 * np.cos(q[:, 0]) + 250 * np.cos(q.sum(axis=1))
    y = 300 * np.sin(q[:, 0]) + 250 * np.sin(q.sum(axis=1))
    np.testing.assert_allclose(chain.tip_in_base(q), np.stack([x, y, 0 * x], axis=1), atol=ROUNDING_MM)


def test_the_arm_of_gao_2017_by_hand():
    # All joints at zero: x stays the base's x, and every alpha of -90 deg turns z on: z1 = y, z2 = -z, z3 = -y, z4 = z,
    # z5 = y; alpha6 = +90 deg turns it back to z6 = z. So 376 up, 62 along x, 751 along z2 (down), 62 along x,
    # 500 along z4 (up), 15 along z5 (y) and the tip 98 along z6 (up).
    chain = load_arm("gao2017").chain
    np.testing.assert_allclose(
        chain.tip_in_base(np.zeros((1, 6)))[0], [62 + 62, 15, 376 - 751 + 500 + 98], atol=ROUNDING_MM
    )
    # Joint 2 at -90 deg lays the upper arm along x: 62 turns up with it, 751 along x, 62 up, 500 back, 98 back.
    q = np.array([[0, -np.pi / 2, 0, 0, 0, 0]])
    np.testing.assert_allclose(chain.tip_in_base(q)[0], [751 - 500 - 98, 15, 376 + 62 + 62], atol=ROUNDING_MM)


@pytest.mark.parametrize("seed", range(10))
def test_poses_are_the_product_of_the_motions(seed):
    chain = random_chain(seed, n=1 + seed % 7)
    q = random_joints(chain, 20, seed)
    expected = np.array([plain_pose(chain, row) for row in q])
    pose = chain.pose(q)
    np.testing.assert_allclose(pose.tip_in_base, expected[:, :3, 3], atol=ROUNDING_MM)
    np.testing.assert_allclose(pose.R_base_tip, expected[:, :3, :3], atol=1e-13)
    np.testing.assert_allclose(chain.tip_in_base(q), pose.tip_in_base, atol=0)
    np.testing.assert_allclose(chain.tip_derivatives(q).tip_in_base, pose.tip_in_base, atol=0)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(-3, 3))
def test_a_full_turn_of_a_joint_changes_nothing(seed, turns):
    chain = random_chain(seed, sliding=0.0)
    q = random_joints(chain, 3, seed)
    # Angles up to 25 rad carry 4e-15 rad of rounding; levers up to 3 m make 1e-11 mm of it.
    np.testing.assert_allclose(chain.tip_in_base(q + 2 * np.pi * turns), chain.tip_in_base(q), atol=1e-9)


@settings(max_examples=50)
@given(st.floats(-1e6, 1e6))
def test_cosine_and_sine_of_any_angle_are_right(angle):
    # A crank of 1 mm reads them off; 4 units in the last place of one.
    crank = chain_from_dh(a=[1.0], d=[0], alpha=[0])
    np.testing.assert_allclose(crank.tip_in_base([[angle]])[0, :2], [np.cos(angle), np.sin(angle)], atol=1e-15)


# Derivatives


@pytest.mark.parametrize("seed", range(6))
def test_derivative_by_every_motion_at_every_place_is_the_difference_quotient(seed):
    chain = random_chain(seed)
    q = random_joints(chain, 4, seed)
    analytic = chain.tip_derivatives(q).motion_jacobian
    assert analytic.shape == (4, chain.n_places, 6, 3)
    # Central differences err by step^2/6 times the third derivative (the lever, up to 3000 mm): 5e-6 mm/rad for 1e-4;
    # rounding of 3000 mm adds 1e-12/1e-4 = 1e-8. Translations are exactly linear.
    for step, which, atol in ((1e-4, range(3), 1e-5), (1.0, range(3, 6), 1e-9)):
        for place in range(chain.n_places):
            for axis in which:
                motions = np.zeros((4, chain.n_places, 6))
                motions[:, place, axis] = step
                quotient = (chain.tip_in_base(q, motions) - chain.tip_in_base(q, -motions)) / (2 * step)
                np.testing.assert_allclose(analytic[:, place, axis], quotient, atol=atol, rtol=0)


@pytest.mark.parametrize("seed", range(3))
def test_the_joint_itself_is_a_motion_about_its_own_axis(seed):
    chain = random_chain(seed, sliding=0.5)
    q = random_joints(chain, 5, seed)
    motion_jacobian = chain.tip_derivatives(q).motion_jacobian
    for i, slides in enumerate(chain.is_prismatic):
        step = np.zeros(chain.n_joints)
        step[i] = 1.0 if slides else 1e-4
        quotient = (chain.tip_in_base(q + step) - chain.tip_in_base(q - step)) / (2 * step[i])
        np.testing.assert_allclose(motion_jacobian[:, i + 1, 5 if slides else 2], quotient, atol=1e-5)


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-5, 1e-3, 0.3, 2.0])
def test_exponential_derivative_is_the_difference_quotient_of_a_finite_motion(size):
    rng = np.random.default_rng(1)
    chain = random_chain(2)
    q = random_joints(chain, 1, 3)
    place = 2
    direction = rng.normal(size=3)
    motion = np.concatenate([size * direction / np.linalg.norm(direction), rng.normal(0, 5, 3)])

    def tip(change: np.ndarray) -> np.ndarray:
        motions = np.zeros((1, chain.n_places, 6))
        motions[0, place] = motion + change
        return chain.tip_in_base(q, motions)[0]

    constant = np.zeros((chain.n_places, 6))
    constant[place] = motion
    moved = chain.with_motions(constant)
    # In the moved chain the place stands behind the motion; the small motion composes before it, in the frame of the
    # place of the unmoved chain. So the place's columns are taken with the tip of the moved chain.
    R_base_place, origin = place_frame(chain, place, q[0])
    p = moved.tip_in_base(q)[0]
    columns = np.concatenate([np.cross(R_base_place.T, p - origin), R_base_place.T])
    analytic = columns.T @ exponential_derivative(motion)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        # error: step^2/6 x 3 m = 5e-8 mm/rad by truncation, 1e-12/1e-5 = 1e-7 by rounding
        np.testing.assert_allclose(analytic[:, k], (tip(step) - tip(-step)) / 2e-5, atol=2e-6)


def place_frame(chain: Chain, place: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    stub = Chain([*chain.fixed[:place], np.eye(4)], np.zeros(3), chain.prismatic[:place])
    T = plain_pose(stub, q[:place])
    return T[:3, :3], T[:3, 3]


# Composition


@pytest.mark.parametrize("seed", range(5))
def test_a_constant_motion_is_the_same_in_the_chain_and_in_every_pose(seed):
    chain = random_chain(seed)
    q = random_joints(chain, 7, seed)
    motions = np.random.default_rng(seed).normal(0, [0.3] * 3 + [20.0] * 3, (chain.n_places, 6))
    in_chain = chain.with_motions(motions).tip_in_base(q)
    np.testing.assert_allclose(in_chain, chain.tip_in_base(q, np.tile(motions, (7, 1, 1))), atol=ROUNDING_MM)


def test_no_motion_is_no_change():
    chain = random_chain(0)
    q = random_joints(chain, 3, 0)
    nothing = np.zeros((chain.n_places, 6))
    np.testing.assert_allclose(chain.with_motions(nothing).tip_in_base(q), chain.tip_in_base(q), atol=0)
    np.testing.assert_allclose(chain.tip_in_base(q, np.tile(nothing, (3, 1, 1))), chain.tip_in_base(q), atol=0)


def test_a_rotation_at_the_tip_turns_the_flange_and_leaves_the_tip():
    chain = random_chain(0)
    q = random_joints(chain, 2, 0)
    motions = np.zeros((2, chain.n_places, 6))
    motions[:, -1, :3] = 1.0
    np.testing.assert_allclose(chain.tip_in_base(q, motions), chain.tip_in_base(q), atol=0)
    turned, plain = chain.with_motions(motions[0]).pose(q), chain.pose(q)
    np.testing.assert_allclose(turned.tip_in_base, plain.tip_in_base, atol=ROUNDING_MM)
    expected = plain.R_base_tip @ Rotation.from_rotvec([1.0, 1.0, 1.0]).as_matrix()
    np.testing.assert_allclose(turned.R_base_tip, expected, atol=1e-13)


def test_a_placed_chain_is_seen_from_the_reference():
    chain = random_chain(1)
    q = random_joints(chain, 4, 1)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.1, 2.0, -0.4]).as_matrix(), [1000.0, -2.0, 30.0]
    expected = chain.tip_in_base(q) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(chain.with_reference_frame(T).tip_in_base(q), expected, atol=ROUNDING_MM)


def test_another_tip_goes_along_the_flanges_axes():
    chain = random_chain(1)
    q = random_joints(chain, 4, 1)
    pose = chain.pose(q)
    longer = chain.with_tip(chain.tip_in_flange + np.array([0, 0, 10.0]))
    np.testing.assert_allclose(
        longer.tip_in_base(q), pose.tip_in_base + 10.0 * pose.R_base_tip[:, :, 2], atol=ROUNDING_MM
    )


# Batches


@pytest.mark.parametrize("n", [0, 1, 2, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 17])
def test_a_batch_is_its_rows(n):
    # Matrix products may round another way in another width: 1e-12 relative to 3 m.
    chain = random_chain(4)
    q = random_joints(chain, n, 4)
    some = np.unique(np.linspace(0, max(n - 1, 0), min(n, 9)).astype(int))
    tips, pose, small = chain.tip_in_base(q), chain.pose(q), chain.tip_derivatives(q)
    assert tips.shape == (n, 3)
    assert pose.R_base_tip.shape == (n, 3, 3)
    assert small.motion_jacobian.shape == (n, chain.n_places, 6, 3)
    for row in some:
        one = q[row : row + 1]
        np.testing.assert_allclose(tips[row], chain.tip_in_base(one)[0], atol=1e-11)
        np.testing.assert_allclose(pose.R_base_tip[row], chain.pose(one).R_base_tip[0], atol=1e-14)
        np.testing.assert_allclose(
            small.motion_jacobian[row], chain.tip_derivatives(one).motion_jacobian[0], atol=1e-11
        )


@pytest.mark.parametrize("n", [0, 1, CHUNK, CHUNK + 5])
def test_pieces_make_the_whole(n):
    chain = random_chain(5)
    q = random_joints(chain, n, 5)
    whole = chain.tip_derivatives(q)
    seen = 0
    for rows, tips, motion_jacobian in chain.tip_derivatives_by_chunk(q):
        np.testing.assert_array_equal(tips.T, whole.tip_in_base[rows])
        np.testing.assert_array_equal(motion_jacobian.transpose(3, 0, 1, 2), whole.motion_jacobian[rows])
        assert motion_jacobian.flags.c_contiguous
        seen += motion_jacobian.shape[-1]
    assert seen == n


def test_motions_may_come_in_many_chunks():
    chain = random_chain(6)
    n = CHUNK + 3
    q = random_joints(chain, n, 6)
    motions = np.random.default_rng(6).normal(0, 0.01, (n, chain.n_places, 6))
    all_at_once = chain.tip_in_base(q, motions)
    np.testing.assert_allclose(all_at_once[-5:], chain.tip_in_base(q[-5:], motions[-5:]), atol=1e-11)


# What it refuses


def test_printed_rotations_are_made_exact():
    rounded = random_chain(0).fixed.round(7)
    chain = Chain(rounded, [0, 0, 0])
    R = chain.fixed[:, :3, :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-14)
    np.testing.assert_allclose(chain.fixed, rounded, atol=2e-7)
    np.testing.assert_array_equal(Chain(chain.fixed, [0, 0, 0]).fixed, chain.fixed)


def mirror() -> np.ndarray:
    fixed = np.tile(np.eye(4), (3, 1, 1))
    fixed[1, 0, 0] = -1
    return fixed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.eye(4), [0, 0, 0]), "(n_joints + 1, 4, 4)"),
        ((np.eye(4)[None], [0, 0, 0]), "at least one joint"),
        ((np.tile(np.eye(4), (2, 1, 1)), [0, 0]), "three coordinates"),
        ((np.tile(np.eye(4), (2, 1, 1)), [0, 0, np.nan]), "finite"),
        ((np.tile(2 * np.eye(4), (2, 1, 1)), [0, 0, 0]), "F0 of the chain is not a rigid motion"),
        ((mirror(), [0, 0, 0]), "F1 of the chain is not a rigid motion"),
        ((np.tile(np.eye(4), (2, 1, 1)), [0, 0, 0], [True, False]), "expected 1 joint types"),
    ],
)
def test_what_is_no_chain_is_refused(arguments, message):
    refuses(message.replace("(", r"\(").replace(")", r"\)").replace("+", r"\+"), Chain, *arguments)


def test_wrong_shapes_are_named():
    chain = random_chain(0)
    refuses(r"angles of shape \(n, 5\), one column a joint, got \(3, 4\)", chain.tip_in_base, np.zeros((3, 4)))
    refuses(r"motions of shape \(3, 7, 6\), got \(3, 6\)", chain.tip_in_base, np.zeros((3, 5)), np.zeros((3, 6)))
    refuses(r"motions of shape \(7, 6\), got \(6,\)", chain.with_motions, np.zeros(6))


def test_a_chain_cannot_be_changed_behind_its_back():
    fixed = np.tile(np.eye(4), (2, 1, 1))
    chain = Chain(fixed, [0, 0, 0])
    fixed[0, 0, 3] = 7.0
    assert chain.fixed[0, 0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        chain.fixed[0, 0, 3] = 1.0
