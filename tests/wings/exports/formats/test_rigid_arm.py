"""Laws of the best rigid stand-in: a rigid arm comes back, any arm comes nearer, what no pose shows stays nominal."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import screw_z
from truearm.errors import InputError
from truearm.identification.terms import constants
from truearm.wings.exports.formats import rigid_arm
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm


@pytest.fixture(scope="module")
def session() -> ta.Session:
    return ta.simulate("ur10", poses=120, seed=1).session


@pytest.fixture(scope="module")
def kinematic(session) -> ta.KinematicModel:
    return ta.KinematicModel(ta.load_arm("ur10")).fit_readings(session)


@pytest.fixture(scope="module")
def physical(session) -> ta.PhysicalModel:
    return ta.PhysicalModel(ta.load_arm("ur10"), highest=4).fit_readings(session)


def mean_distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(one - other, axis=1).mean())


def some_poses(arm: Arm, n: int = 50, seed: int = 3) -> np.ndarray:
    low, high = np.clip(arm.limits.T, -2.0, 2.0)
    return np.random.default_rng(seed).uniform(low, high, (n, arm.n_joints))


def test_a_model_of_constants_comes_back(kinematic):
    """Away from the poses too: what the poses do not show does not move the tip. 1e-6 mm is rounding of the fit."""
    rigid = best_rigid_arm(kinematic)
    poses = some_poses(kinematic.arm_)
    np.testing.assert_allclose(
        rigid.in_reference_frame().chain.tip_in_base(poses), kinematic.predict(poses), rtol=0, atol=1e-6
    )
    assert rigid.loss.exported_max_mm < 1e-6
    assert rigid.loss.nominal_mm > 0.05


def test_a_physical_models_stand_in_is_better_than_its_own_constants(physical, session):
    rigid = best_rigid_arm(physical)
    points = physical.predict(session.angles)
    alone = mean_distance(physical.fit_.chain.tip_in_base(session.angles), points)
    assert rigid.loss.exported_mm < alone
    assert rigid.loss.exported_mm < 0.5 * rigid.loss.nominal_mm
    sample = physical.training_.angle_sample
    assert rigid.loss.nominal_mm == pytest.approx(
        mean_distance(physical.predict_nominal(sample), physical.predict(sample)), rel=1e-6
    )
    assert (rigid.loss.region, rigid.loss.n_poses) == ("training readings", 120)


def test_the_loss_is_that_of_poses_held_out(physical, monkeypatch):
    """Of a region of few poses above all: what fresh poses show, and not the smaller distances of the fit itself.

    The mean over 20 poses of one part in ten may differ by a third from that over a hundred.
    """
    monkeypatch.setattr(rigid_arm, "N_PARTS", 10)
    sample = np.random.default_rng(2).permutation(physical.training_.angle_sample)
    near, fresh = sample[:20], sample[20:]
    rigid = best_rigid_arm(physical, near)
    found = rigid.in_reference_frame().chain
    within = mean_distance(found.tip_in_base(near), physical.predict(near))
    without = mean_distance(found.tip_in_base(fresh), physical.predict(fresh))
    assert rigid.loss.exported_mm > 1.3 * within
    assert rigid.loss.exported_mm > 0.67 * without
    assert rigid.loss.exported_max_mm > rigid.loss.exported_mm
    # A pose that stands in the region many times is no fresh pose.
    repeated = best_rigid_arm(physical, np.repeat(near, 10, axis=0)).loss
    assert repeated.exported_mm > 1.3 * within


def test_what_no_reading_shows_stays_nominal(physical):
    """The motion before joint 1 and the flange are the nominal ones to the bit; constants of the arm change by little.

    Errors of virtual arms are some 1 mrad and 0.3 mm; a combination that the poses hardly show would grow to more.
    """
    rigid, nominal = best_rigid_arm(physical), physical.arm_.chain
    np.testing.assert_array_equal(rigid.arm.chain.fixed[0], nominal.fixed[0])
    np.testing.assert_array_equal(rigid.arm.chain.fixed[-1], nominal.fixed[-1])
    off = np.linalg.inv(nominal.fixed) @ rigid.arm.chain.fixed
    assert np.abs(off[:, :3, :3] - np.eye(3)).max() < 5e-3  # rad
    assert np.abs(off[:, :3, 3]).max() < 5.0  # mm


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_the_priors_size_does_not_matter(physical, monkeypatch, factor):
    """Points change by less than a hundredth of what the arm differs from the nominal one."""
    before = best_rigid_arm(physical)
    scaled = partial(constants, angle_std=factor * 3e-3, length_std=factor * 3.0)
    monkeypatch.setattr(rigid_arm, "constants", scaled)
    after = best_rigid_arm(physical)
    poses = physical.training_.angle_sample
    moved = mean_distance(after.in_reference_frame().chain.tip_in_base(poses), physical.predict(poses))
    assert moved == pytest.approx(before.loss.exported_mm, abs=0.01 * before.loss.nominal_mm)
    # Which of equivalent constants changes may differ by the scales; none grows with the prior.
    off = np.linalg.inv(physical.arm_.chain.fixed) @ after.arm.chain.fixed
    assert np.abs(off[:, :3, :3] - np.eye(3)).max() < 5e-3


def test_without_free_parts_base_frame_and_reference_frame_are_one():
    arm = ta.load_arm("ur5")
    motions = np.random.default_rng(0).normal(0, 1, (8, 6)) * [1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3]
    true = arm.chain.with_motions(motions)
    angles = some_poses(arm, 60)
    model = ta.KinematicModel(arm, free=()).fit(angles, true.tip_in_base(angles))
    rigid = best_rigid_arm(model)
    np.testing.assert_array_equal(rigid.T_reference_base, np.eye(4))
    np.testing.assert_allclose(rigid.arm.chain.tip_in_base(angles), true.tip_in_base(angles), rtol=0, atol=1e-3)
    np.testing.assert_array_equal(rigid.arm.chain.fixed[-1], arm.chain.fixed[-1])


def test_a_sliding_joint_and_a_network():
    """An arm on a rail, described by a network: any fitted model has a stand-in."""
    ur5 = ta.load_arm("ur5").chain
    rail = Chain(np.concatenate([np.eye(4)[None], ur5.fixed]), ur5.tip_in_flange, np.array([True] + 6 * [False]))
    arm = Arm("ur5-rail", rail, lower=[0] + 6 * [-3], upper=[2000] + 6 * [3])
    rng = np.random.default_rng(4)
    angles = np.column_stack([rng.uniform(0, 2000, 100), rng.uniform(-2, 2, (100, 6))])
    true = rail.with_motions(rng.normal(0, 1, (9, 6)) * [1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3])
    model = ta.KinematicModel(arm).fit(angles, true.tip_in_base(angles))
    rigid = best_rigid_arm(model)
    np.testing.assert_allclose(
        rigid.in_reference_frame().chain.tip_in_base(angles), model.predict(angles), rtol=0, atol=1e-6
    )
    network = ta.NetworkModel(arm, hidden=(3,), epochs=3).fit(angles, true.tip_in_base(angles))
    loss = best_rigid_arm(network).loss
    assert loss.exported_mm < loss.nominal_mm


def test_gravity_turns_with_the_frame(kinematic):
    turned = best_rigid_arm(kinematic).in_reference_frame()
    rigid = best_rigid_arm(kinematic)
    np.testing.assert_allclose(
        turned.gravity_direction, rigid.T_reference_base[:3, :3] @ rigid.arm.gravity_direction, rtol=0, atol=1e-12
    )


# Regions


def test_a_region_is_where_the_stand_in_is_good(physical):
    """Refitted to part of the joint space, it is better there than the stand-in of all of it."""
    sample = physical.training_.angle_sample
    near = sample[sample[:, 0] < np.median(sample[:, 0])]
    there = best_rigid_arm(physical, near, region="left half")
    everywhere = best_rigid_arm(physical)
    assert there.loss.region == "left half"
    assert mean_distance(there.in_reference_frame().chain.tip_in_base(near), physical.predict(near)) < mean_distance(
        everywhere.in_reference_frame().chain.tip_in_base(near), physical.predict(near)
    )


def test_of_many_poses_some_are_used(kinematic, monkeypatch):
    monkeypatch.setattr(rigid_arm, "MAX_POSES", 60)
    loss = best_rigid_arm(kinematic, some_poses(kinematic.arm_, 61)).loss
    assert (loss.n_poses, loss.region) == (60, "stated poses")


@pytest.mark.parametrize(
    "angles",
    [np.zeros((50, 5)), np.zeros((3, 6)), np.zeros(6), np.full((50, 6), np.nan), np.full((50, 6), np.inf)],
    ids=["another arm", "too few", "one pose", "NaN", "infinite"],
)
def test_poses_that_are_no_region_are_refused(kinematic, angles):
    refuses(r"region of 4 or more poses of 6 joints", best_rigid_arm, kinematic, angles)


def test_degrees_are_refused(kinematic):
    refuses("limit", best_rigid_arm, kinematic, np.degrees(some_poses(kinematic.arm_)))


def test_a_model_without_a_sample_asks_for_a_region(kinematic):
    old = ta.KinematicModel(kinematic.arm_)
    old.__dict__.update(kinematic.__dict__)
    old.training_ = replace(kinematic.training_, angle_sample=None)
    refuses("keeps no poses of its training.*--region", best_rigid_arm, old)
    assert best_rigid_arm(old, some_poses(old.arm_)).loss.exported_max_mm < 1e-6


# Another description of the same arm


def test_another_description_of_the_arm_gives_the_same_points(physical):
    """Frames turned about and shifted along the joints' axes, another base frame, another flange."""
    arm = physical.arm_
    rng = np.random.default_rng(5)
    fixed = arm.chain.fixed.copy()
    for i in range(1, 6):  # shifts along a joint's axis, in both neighbours: the same arm
        shift = screw_z(0.0, rng.normal(0, 50.0))
        fixed[i] = shift @ fixed[i]
        fixed[i - 1] = fixed[i - 1] @ np.linalg.inv(shift)
    fixed[0] = screw_z(np.pi, 12.0) @ fixed[0]
    fixed[-1] = fixed[-1] @ screw_z(0.3, 5.0)
    other = replace(arm, name="other", chain=Chain(fixed, np.zeros(3)))
    rigid = best_rigid_arm(physical, nominal=other)
    poses = physical.training_.angle_sample
    expected = best_rigid_arm(physical)
    found = rigid.in_reference_frame().chain.tip_in_base(poses)
    assert rigid.arm.name == "other"
    np.testing.assert_array_equal(rigid.arm.chain.fixed[-1], fixed[-1])
    assert mean_distance(found, physical.predict(poses)) == pytest.approx(
        expected.loss.exported_mm, abs=0.02 * expected.loss.nominal_mm
    )


def test_another_arm_is_refused(kinematic):
    with pytest.raises(InputError, match="'panda' has 7 joints, the model's arm 'ur10' 6 joints"):
        best_rigid_arm(kinematic, nominal=ta.load_arm("panda"))
    with pytest.raises(InputError, match="'gao2017' misses the model's points by .* other zeros or directions"):
        best_rigid_arm(kinematic, nominal=ta.load_arm("gao2017"))
