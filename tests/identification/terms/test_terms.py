"""Basis functions of the arm's state against cases solved by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.arm.chain import Chain
from truearm.identification.terms import (
    LinkMasses,
    directions,
    gravity_loads,
    gravity_torques,
    growth_motions,
    harmonics,
    link_vectors,
    uniform_links,
)

G = 9.80665  # m/s^2


def horizontal_arm(n: int = 1, *, length_mm: float = 1000.0) -> Chain:
    """Hinges about the base's y axis, links along x at angles zero."""
    hinge = np.eye(4)
    hinge[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # the joint's z axis is the base's y axis
    along = np.eye(4)
    along[0, 3] = length_mm
    return Chain(np.stack([hinge, *[along] * (n - 1), np.eye(4)]), [length_mm, 0, 0])


def test_harmonics_are_cosines_and_sines_of_multiples():
    got = harmonics(np.array([[0.3, -1.2]]), [1, 2, 0.4])
    assert got.shape == (1, 2, 3, 2)
    assert got[0, 1, 2] == pytest.approx([np.cos(0.4 * 1.2), -np.sin(0.4 * 1.2)], abs=1e-15)


@given(st.floats(-20, 20), st.integers(1, 8))
def test_whole_harmonics_repeat_after_a_turn(angle, order):
    # Rounding of the argument k q, about 200 here, leaves 1e-13.
    assert harmonics(angle + 2 * np.pi, [order]) == pytest.approx(harmonics(angle, [order]), abs=1e-12)


def test_direction_is_the_sign_of_the_last_movement():
    angles = np.array([[0, 0], [1, 0], [1, 0], [0.5, -1], [0.5, 3]])
    assert directions(angles).tolist() == [[0, 0], [1, 0], [1, 0], [-1, -1], [-1, 1]]
    assert directions(np.zeros((0, 2))).shape == (0, 2)


def test_horizontal_link_of_even_mass_pulls_half_its_length():
    # 1 m, 2 kg: m g L / 2 about the hinge; gravity along -z turns +x towards -z, which is +y, the hinge's z axis.
    chain = horizontal_arm()
    torque = gravity_torques(chain, [[0.0]], uniform_links(chain, kg_per_m=2.0))
    assert torque == pytest.approx(np.array([[[0, 0, 2.0 * G * 0.5]]]), abs=1e-12)


def test_hanging_link_pulls_nothing_and_inclined_link_its_cosine():
    chain = horizontal_arm()
    torque = gravity_torques(chain, [[np.pi / 2], [np.pi / 3]], uniform_links(chain, kg_per_m=2.0))
    assert torque[:, 0, 2] == pytest.approx([0.0, 2.0 * G * 0.5 * 0.5], abs=1e-12)


def test_two_links_and_a_mass_at_the_end_add_by_their_levers():
    # 1 m links of 2 kg and 1 kg, each mass at its link's end.
    links = LinkMasses([2.0, 1.0], [[1000, 0, 0], [1000, 0, 0]])
    loads = gravity_loads(horizontal_arm(2), [[0.0, 0.0]], links)
    assert loads.torque_in_joint[0, :, 2] == pytest.approx([G * (2 * 1 + 1 * 2), G], abs=1e-12)
    # The places' axes: x along the links, y is the base's -z.
    assert loads.force_in_joint[0] == pytest.approx(np.array([[0, 3 * G, 0], [0, G, 0]]), abs=1e-12)


@settings(max_examples=20)
@given(st.integers(0, 1000), st.booleans())
def test_torque_is_the_work_of_the_weights_in_a_small_turn(make_chain, seed, sliding):
    """Virtual work: torque about an axis = change of height of the masses by a small turn about it, times weight."""
    chain = make_chain(seed, sliding=sliding)
    rng = np.random.default_rng(seed + 1)
    links = LinkMasses(rng.uniform(0, 5, 5), rng.normal(0, 200, (5, 3)))
    angles = rng.uniform(-3, 3, (7, 5))
    loads = gravity_loads(chain, angles, links)
    work = np.zeros((7, 5, 6))
    for k in range(1, 6):
        upto = Chain(
            np.concatenate([chain.fixed[:k], np.eye(4)[None]]), links.centre_in_joint_mm[k - 1], chain.prismatic[:k]
        )
        height_by_motion = upto.tip_derivatives(angles[:, :k]).motion_jacobian[:, 1 : k + 1, :, 2]
        work[:, :k] += -links.mass_kg[k - 1] * G * height_by_motion
    # Torques reach 1e2 N m, forces 1e2 N: rounding is 1e-13.
    assert loads.torque_in_joint == pytest.approx(work[..., :3] * 1e-3, abs=1e-10)
    assert loads.force_in_joint == pytest.approx(work[..., 3:], abs=1e-10)


def test_gravity_follows_its_direction_in_the_base():
    chain = horizontal_arm()
    links = uniform_links(chain, kg_per_m=2.0)
    assert gravity_torques(chain, [[0.0]], links, gravity_in_base=[-G, 0, 0]) == pytest.approx(
        np.zeros((1, 1, 3)), abs=1e-12
    )


def test_links_run_from_joint_to_joint_and_the_last_to_the_tip(make_chain):
    chain = make_chain(3)
    vectors = link_vectors(chain)
    # Cutting the chain after joint i and putting the tip at the link's end reaches the next joint's origin.
    cut = Chain(np.concatenate([chain.fixed[:5], np.eye(4)[None]]), vectors[5])
    angles = np.random.default_rng(0).uniform(-3, 3, (4, 5))
    assert cut.tip_in_base(angles) == pytest.approx(chain.tip_in_base(angles), abs=1e-9)
    assert chain.fixed[0, :3, :3] @ vectors[0] == pytest.approx(chain.fixed[0, :3, 3], abs=1e-12)


def test_a_straight_arm_grows_by_length_times_excess_temperature():
    chain = horizontal_arm(2)
    motions = np.zeros((1, chain.n_places, 6))
    motions[0, :-1, 3:] = 23e-6 * growth_motions(chain, [25.0])[0]
    # Aluminium: 2 m, 5 K, 23e-6/K: 0.23 mm.
    assert chain.tip_in_base([[0, 0]], motions) - chain.tip_in_base([[0, 0]]) == pytest.approx(
        np.array([[0.23, 0, 0]]), abs=1e-12
    )


def test_links_may_have_their_own_temperatures():
    chain = horizontal_arm(2)
    growth = growth_motions(chain, [[20.0, 21.0, 22.0]])
    assert growth[0] == pytest.approx(np.array([[0, 0, 0], [1000, 0, 0], [2000, 0, 0]]), abs=1e-12)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda c: gravity_loads(c, [[0, 0]], LinkMasses([1.0], [[0, 0, 0]])), "2 link masses"),
        (
            lambda c: gravity_loads(c, [[0, 0]], uniform_links(c, kg_per_m=1), gravity_in_base=[0, 9.8]),
            "three finite numbers",
        ),
        (lambda c: LinkMasses([1.0, -1.0], np.zeros((2, 3))), "not negative"),
        (lambda c: LinkMasses([1.0, 1.0], np.zeros((3, 3))), "centres of mass"),
        (lambda c: growth_motions(c, np.zeros((4, 2))), r"\(n, 3\)"),
    ],
)
def test_mismatched_shapes_are_refused(call, says):
    refuses(says, call, horizontal_arm(2))
