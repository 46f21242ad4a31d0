"""Tables beside the drawing: nominal in, nominal out; identified arms exactly, with every constant near the drawing."""

import tomllib
from importlib import resources

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arms_of_each_build import ARMS
from truearm.arm import chain_from_dh, drawn_table, list_arms, load_arm, nearest_table
from truearm.arm.denavit_hartenberg import DHTable
from truearm.arm.nearest_table import drawn_convention
from truearm.errors import InputError

CONSTANTS = ("a", "d", "alpha", "theta", "beta", "b")
# A SCARA: two parallel axes, then a quill that slides and turns on one line.
SCARA = {"a": [250, 200, 0, 0], "d": [300, 0, 0, -40], "alpha": [0, np.pi, 0, 0], "tip_in_flange": [3, 0, 80]}
SCARA_KINDS = ["revolute", "revolute", "prismatic", "revolute"]
# A rail, then an arm whose rows are drawn with half turns.
RAIL = {
    "a": [100, -50, 400, 50],
    "d": [0, 350, 0, 400],
    "alpha": np.deg2rad([90, -90, 180, -90]),
    "theta": np.deg2rad([90, -90, 180, 45]),
}
GAUGE = {
    "a": [0, 50, 0, 50, 0, 0],
    "d": [300, 0, 900, 0, 700, 0],
    "alpha": np.deg2rad([-90, -90, -90, -90, -90, 0]),
    "theta": np.deg2rad([0, 90, 90, 90, 90, 90]),
    "tip_in_flange": [0, 0, 150],
}


def chains():
    found = {name: load_arm(name).chain for name in ARMS}
    found["scara"] = chain_from_dh(**SCARA, kinds=SCARA_KINDS)
    found["rail"] = chain_from_dh(**RAIL, kinds=["prismatic", "revolute", "revolute", "revolute"])
    found["gauge"] = chain_from_dh(**GAUGE)
    found["one joint"] = chain_from_dh(a=[100], d=[20], alpha=[0.5], tip_in_flange=[1, 2, 3])
    return found


CHAINS = chains()


def perturbed(chain, seed, angle=1e-3, length=1.0):
    rng = np.random.default_rng(seed)
    return chain.with_motions(rng.normal(size=(chain.n_places, 6)) * ([angle] * 3 + [length] * 3))


def assert_same_poses(one, other):
    """Tips to 1e-9 mm, orientations to 1e-12: thousands of times rounding at a reach of metres."""
    q = np.random.default_rng(0).uniform(-4, 4, (30, one.n_joints)) * np.where(one.is_prismatic, 100, 1)
    first, second = one.pose(q), other.pose(q)
    np.testing.assert_allclose(first.tip_in_base, second.tip_in_base, atol=1e-9, rtol=0)
    np.testing.assert_allclose(first.R_base_tip, second.R_base_tip, atol=1e-12, rtol=0)


@pytest.mark.parametrize("name", [name for name in list_arms() if name != "gen3lite"])
def test_the_drawing_of_a_catalogue_arm_is_its_arm_file(name):
    drawn = tomllib.loads((resources.files("truearm.arm") / "arms" / f"{name}.toml").read_text())
    table = drawn_table(load_arm(name).chain, drawn["convention"])
    assert drawn_convention(load_arm(name).chain) == drawn["convention"]
    for constant, key in (("a", "a_mm"), ("d", "d_mm"), ("alpha", "alpha_deg"), ("theta", "theta_deg")):
        stated = [joint.get(key, 0.0) for joint in drawn["joints"]]
        found = getattr(table, constant)
        np.testing.assert_allclose(np.rad2deg(found) if "deg" in key else found, stated, atol=1e-12, rtol=0)
    np.testing.assert_allclose(table.tip_in_flange, drawn["tip_mm"], atol=1e-12, rtol=0)


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("convention", ["dh", "mdh"])
@pytest.mark.parametrize("free", [("base", "tip"), ("tip",), ()])
def test_nominal_in_is_nominal_out(name, convention, free):
    chain = CHAINS[name]
    table = drawn_table(chain, convention)
    assert_same_poses(chain, table.chain())
    again = nearest_table(chain, chain, convention=convention, free=free)
    for constant in (*CONSTANTS, "base", "flange", "tip_in_flange"):
        np.testing.assert_allclose(getattr(again, constant), getattr(table, constant), atol=1e-12, rtol=0)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(sorted(CHAINS)), convention=st.sampled_from(["dh", "mdh"]))
def test_the_table_of_an_identified_chain_has_its_poses(seed, name, convention):
    chain = perturbed(CHAINS[name], seed, angle=3e-3, length=3.0)
    for free in (("base", "tip"), ("base",), ()):
        table = nearest_table(chain, CHAINS[name], convention=convention, free=free)
        assert_same_poses(chain, table.chain())


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(sorted(CHAINS)), convention=st.sampled_from(["dh", "mdh"]))
def test_every_constant_stays_near_the_drawing_and_changes_with_the_arm(seed, name, convention):
    # Motions of 1 mrad and 1 mm: an angle changes by their sum over a few places, a length by that times levers, of
    # at most a metre here. In proportion: half the motions, half the change, to the second order of 1e-3.
    drawing = drawn_table(CHAINS[name], convention)
    rng = np.random.default_rng(seed)
    motions = rng.normal(size=(CHAINS[name].n_places, 6)) * ([1e-3] * 3 + [1.0] * 3)
    whole, half = (
        nearest_table(CHAINS[name].with_motions(f * motions), CHAINS[name], convention=convention) for f in (1.0, 0.5)
    )
    for constant in CONSTANTS:
        change = getattr(whole, constant) - getattr(drawing, constant)
        limit = 30.0 if constant in ("a", "b", "d") else 0.06
        assert np.abs(change).max() < limit
        halved = getattr(half, constant) - getattr(drawing, constant)
        np.testing.assert_allclose(2 * halved, change, atol=limit / 50)


@pytest.mark.parametrize("name", ["ur10", "gauge", "panda"])
def test_what_only_base_and_tip_can_tell_stays_as_drawn(name):
    convention = drawn_convention(CHAINS[name])
    drawing = drawn_table(CHAINS[name], convention)
    table = nearest_table(perturbed(CHAINS[name], 1), CHAINS[name], convention=convention)
    kept = ("theta", "d")
    assert all(getattr(table, constant)[0] == getattr(drawing, constant)[0] for constant in kept)
    assert all(getattr(table, constant)[-1] == getattr(drawing, constant)[-1] for constant in kept)
    end = -1 if convention == "dh" else 0
    assert table.a[end] == drawing.a[end]
    assert table.alpha[end] == drawing.alpha[end]


def test_the_split_of_a_sum_does_not_change_the_table():
    # The last joint's frame along the flange against the tip, the first joint's offset against the base.
    chain = CHAINS["ur10"]
    motions = np.zeros((chain.n_places, 6))
    motions[6, 3:], motions[7, 3:] = [0, -14.05, 0], [0, 14.05, 0]
    motions[0, 2], motions[1, 2] = 0.01, -0.01
    table = nearest_table(chain.with_motions(motions), chain)
    for constant in CONSTANTS:
        np.testing.assert_allclose(getattr(table, constant), getattr(drawn_table(chain), constant), atol=1e-12)
    np.testing.assert_allclose(table.tip_in_flange, 0, atol=1e-12)


def test_a_known_base_and_tip_leave_the_first_and_last_constants_to_the_joints():
    chain = CHAINS["ur10"]
    motions = np.zeros((chain.n_places, 6))
    motions[1, 2], motions[1, 5], motions[6, 5] = 2e-3, 0.7, 0.4
    table = nearest_table(chain.with_motions(motions), chain, free=())
    assert table.theta[0] == pytest.approx(2e-3, abs=1e-12)
    assert table.d[0] == pytest.approx(127.3 + 0.7, abs=1e-11)
    assert table.d[-1] == pytest.approx(92.2 + 0.4, abs=1e-11)
    np.testing.assert_allclose(table.base, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(table.tip_in_flange, 0, atol=1e-11)


def test_a_tilt_of_a_parallel_axis_is_hayatis_beta_and_alpha():
    # Axis 3 of the UR10 tilts about its own x, the direction of a, and y: alpha and beta of row 2.
    chain = CHAINS["ur10"]
    motions = np.zeros((chain.n_places, 6))
    motions[2, 0], motions[2, 1] = 1e-3, 0.0
    table = nearest_table(chain.with_motions(motions), chain)
    assert table.alpha[1] == pytest.approx(1e-3, abs=1e-12)
    # About y the far axis also moves by a sin: along the axes, where d of the row in which they end takes it.
    motions[2, 0], motions[2, 1] = 0.0, 1e-3
    table = nearest_table(chain.with_motions(motions), chain)
    assert table.beta[1] == pytest.approx(1e-3, abs=1e-9)
    assert table.d[3] - 163.941 == pytest.approx(612 * 1e-3 + 0.0, abs=2e-3)


def test_half_turns_of_the_drawing_stay():
    table = nearest_table(perturbed(CHAINS["gauge"], 5), CHAINS["gauge"])
    np.testing.assert_allclose(table.a, GAUGE["a"], atol=5)
    np.testing.assert_allclose(table.alpha, GAUGE["alpha"], atol=0.01)
    rail = nearest_table(perturbed(CHAINS["rail"], 5), CHAINS["rail"])
    np.testing.assert_allclose(rail.a, RAIL["a"], atol=5)
    np.testing.assert_allclose(rail.theta, RAIL["theta"], atol=0.05)


def test_another_arm_is_refused():
    with pytest.raises(InputError, match="expected a chain with the 6 joints of the nominal arm, got one of 7"):
        nearest_table(CHAINS["wam"], CHAINS["ur10"])
    with pytest.raises(InputError, match=r"the axes of joints 2 and 3 are at 90.0 deg, in the drawing at 0.0 deg"):
        nearest_table(CHAINS["gao2017"], CHAINS["ur10"])
    with pytest.raises(InputError, match=r"the axes of joints 2 and 3 are at 0.0 deg, in the drawing at 90.0 deg"):
        nearest_table(CHAINS["ur10"], CHAINS["gao2017"])


def test_a_table_without_beta_has_zeros():
    table = DHTable("dh", *np.ones((4, 1)), np.zeros(1, bool), np.eye(4), np.eye(4), np.zeros(3))
    assert table.beta.tolist() == table.b.tolist() == [0.0]
