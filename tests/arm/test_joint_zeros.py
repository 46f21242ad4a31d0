"""Zeros that are added to an arm are those that its table shows, of arms from tables and from URDF."""

import numpy as np
import pytest

from truearm.arm import load_arm, read_arm, write_arm
from truearm.arm.arm import joint_zeros, table_changes, with_zeros

ARMS = ("gao2017", "ur5", "panda", "gen3lite")


@pytest.mark.parametrize("name", ARMS)
def test_added_zeros_are_found_and_turn_the_joints(name, rng):
    arm = load_arm(name)
    zeros = np.radians(rng.uniform(-20, 20, arm.n_joints))
    other = with_zeros(arm, zeros)
    angles = rng.uniform(-2, 2, (20, arm.n_joints))
    assert np.abs(other.chain.tip_in_base(angles) - arm.chain.tip_in_base(angles + zeros)).max() < 1e-9
    assert np.abs(joint_zeros(other.chain, arm, free=()) - zeros).max() < 1e-9
    changes = table_changes(other.chain, arm, free=())
    assert max(np.abs(changes[column]).max() for column in ("alpha", "beta", "a", "d", "b")) < 1e-6  # mm, rad


def test_zeros_that_a_free_base_and_tip_take_stay(rng):
    arm = load_arm("gao2017")
    found = joint_zeros(with_zeros(arm, rng.uniform(-0.2, 0.2, 6)).chain, arm)
    assert found[[0, 5]] == pytest.approx(0, abs=1e-12)
    assert np.abs(found[1:5]).min() > 0


@pytest.mark.parametrize(("name", "suffix"), [("ur5", ".toml"), ("gen3lite", ".urdf")])
def test_the_new_arm_file_holds_them(name, suffix, tmp_path):
    arm = load_arm(name)
    zeros = np.linspace(-0.1, 0.2, 6)
    write_arm(with_zeros(arm, zeros), tmp_path / f"my-arm{suffix}")
    again = load_arm(str(tmp_path / f"my-arm{suffix}"))
    angles = np.linspace(-1, 1, 30).reshape(5, 6)
    assert np.abs(again.chain.tip_in_base(angles) - arm.chain.tip_in_base(angles + zeros)).max() < 1e-6
    if suffix == ".toml":
        assert read_arm(tmp_path / "my-arm.toml").joint_names == arm.joint_names
