"""Laws of corrected targets: they reach, both directions are inverse, what cannot be corrected is refused alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.arm import Pose, load_arm
from truearm.arm.rigid_motions import motion
from truearm.identification.terms import Temperature
from truearm.models import KinematicModel, PhysicalModel
from truearm.readings import Session
from truearm.wings.exports.correct import correct
from truearm.wings.exports.targets.correction import correct_targets, task_of
from truearm.wings.exports.targets.inverse import follow, keeps_configuration, solve_poses
from truearm.wings.exports.targets.pose_models import nominal_poses, poses_of, reference_from_base, with_tool
from truearm.wings.exports.targets.targets import Targets
from truearm.wings.importing import datasets

# A nanometre and a nanometre at a metre: what counts as reached.
REACHED_MM = 1e-6
SAME_RAD = 1e-9
ARMS = ["ur10", "seven", "rail", "five", "network"]


def corrected(case, targets, **options):
    if not isinstance(targets, Targets):
        targets = Targets.of_joints(targets)
    return correct_targets(case.model, targets, **{"untrained": "accept", "uncertainty": False, **options})


def pose_of(model, joints):
    joints = np.atleast_2d(joints)
    return poses_of(model, Targets.of_joints(joints).session(joints)).pose(joints, np.arange(len(joints)))


def nominal_of(model, joints):
    return nominal_poses(model).pose(joints, np.arange(len(joints)))


@pytest.fixture(params=ARMS)
def case(request):
    return request.getfixturevalue(request.param)


def test_commanded_joints_bring_the_model_to_the_nominal_pose(case):
    found = corrected(case, case.joints)
    assert not found.refused.any(), found.reasons
    there, wanted = pose_of(case.model, found.joints), nominal_of(case.model, case.joints)
    np.testing.assert_allclose(there.tip_in_base, wanted.tip_in_base, atol=REACHED_MM)
    np.testing.assert_allclose(case.model.predict(found.joints), wanted.tip_in_base, atol=REACHED_MM)
    if case.joints.shape[1] >= 6:
        np.testing.assert_allclose(there.R_base_tip, wanted.R_base_tip, atol=SAME_RAD)
    assert np.abs(found.change).max() > 0


def test_command_and_feedback_are_inverse(case):
    """Redundant arms and those of five joints included: 1e-9 rad, or a micrometre of a rail."""
    sent = corrected(case, case.joints).joints
    meant = corrected(case, sent, direction="feedback").joints
    scale = np.where(case.model.arm_.chain.is_prismatic, 1000.0, 1.0)
    np.testing.assert_allclose((meant - case.joints) / scale, 0, atol=SAME_RAD)
    back = corrected(case, corrected(case, case.joints, direction="feedback").joints).joints
    np.testing.assert_allclose((back - case.joints) / scale, 0, atol=SAME_RAD)


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_feedback_after_command_is_the_identity_anywhere_in_range(ur10, seed):
    joints = ur10.model.arm_.working + np.random.default_rng(seed).uniform(-0.9, 0.9, (3, 6))
    found = corrected(ur10, joints)
    good = ~found.refused
    if good.any():
        meant = corrected(ur10, found.joints[good], direction="feedback").joints
        np.testing.assert_allclose(meant, joints[good], atol=SAME_RAD)


@pytest.mark.parametrize("name", ["ur10", "seven", "rail"])
def test_the_arm_goes_where_it_should_as_well_as_the_model_knows_it(name, request):
    """Closed loop on the arm as it is: the error is the model's own, and far below that without correction."""
    case = request.getfixturevalue(name)
    wanted = nominal_of(case.model, case.joints).tip_in_base
    sent = corrected(case, case.joints).joints
    error = np.linalg.norm(case.true_tip(sent) - wanted, axis=1).mean()
    own = np.linalg.norm(case.model.predict(sent) - case.true_tip(sent), axis=1).mean()
    without = np.linalg.norm(case.true_tip(case.joints) - wanted, axis=1).mean()
    assert error <= 1.1 * own
    assert error < without / 3


def test_a_pose_gives_back_the_joints_that_were_there(ur10):
    pose = pose_of(ur10.model, ur10.joints)
    start = ur10.joints + np.random.default_rng(0).uniform(-0.2, 0.2, ur10.joints.shape)
    found = corrected(ur10, Targets(start, pose.tip_in_base, pose.R_base_tip))
    np.testing.assert_allclose(found.joints, ur10.joints, atol=SAME_RAD)


def test_a_position_alone_has_the_nominal_orientation_at_the_start(ur10):
    tips = nominal_of(ur10.model, ur10.joints).tip_in_base + [3.0, -2.0, 1.0]
    found = corrected(ur10, Targets(ur10.joints, tips))
    there = pose_of(ur10.model, found.joints)
    np.testing.assert_allclose(there.tip_in_base, tips, atol=REACHED_MM)
    np.testing.assert_allclose(there.R_base_tip, nominal_of(ur10.model, ur10.joints).R_base_tip, atol=SAME_RAD)


def test_poses_in_the_base_frame_are_those_in_the_reference_frame(ur10):
    pose, T = pose_of(ur10.model, ur10.joints), reference_from_base(ur10.model)
    back = np.linalg.inv(T)
    in_base = Targets(ur10.joints, pose.tip_in_base @ back[:3, :3].T + back[:3, 3], back[:3, :3] @ pose.R_base_tip)
    one = corrected(ur10, in_base, frame="base").joints
    np.testing.assert_allclose(one, ur10.joints, atol=SAME_RAD)


def test_whole_turns_of_the_start_are_kept(ur10):
    pose = nominal_of(ur10.model, ur10.joints)
    turn = 2 * np.pi * np.array([1, 0, 0, 0, 0, -1])
    wide = replace(ur10.model.arm_, lower=np.full(6, -10.0), upper=np.full(6, 10.0))
    model = type(ur10.model)(wide, highest=4)
    vars(model).update({**vars(ur10.model), "arm_": wide})
    case = replace(ur10, model=model)
    plain = corrected(case, Targets(ur10.joints, *pose[::-1]))
    turned = corrected(case, Targets(ur10.joints + turn, *pose[::-1]))
    np.testing.assert_allclose(turned.joints, plain.joints + turn, atol=SAME_RAD)


def test_a_redundant_arm_moves_least(seven):
    """No motion of the arm that leaves the pose as it is brings it nearer to the planned joints."""
    found = corrected(seven, seven.joints)
    chain, n = seven.model.arm_.chain, len(seven.joints)
    _, jacobian = poses_of(seven.model, Targets.of_joints(found.joints).session(found.joints)).linearise(
        found.joints, np.arange(n)
    )
    jacobian[:, 3:] *= chain.reach / 3
    free = np.linalg.svd(jacobian)[2][:, 6]  # what turns all joints and moves nothing
    along = np.einsum("nj,nj->n", free, found.joints - seven.joints)
    np.testing.assert_allclose(along, 0, atol=1e-11)


# Refusals


def test_a_target_out_of_reach_is_refused_and_no_other(ur10):
    tips = nominal_of(ur10.model, ur10.joints).tip_in_base
    tips[3] *= 5
    found = corrected(ur10, Targets(ur10.joints, tips))
    assert list(np.flatnonzero(found.refused)) == [3]
    assert found.reasons[3].startswith("out of reach")
    assert np.isnan(found.joints[3]).all()
    assert found.distance_mm[3] > 100
    others = np.delete(np.arange(len(tips)), 3)
    alone = corrected(ur10, Targets(ur10.joints[others], tips[others]))
    np.testing.assert_allclose(found.joints[others], alone.joints, atol=SAME_RAD)


def test_targets_in_another_unit_are_named_with_it(ur10):
    """Joints in rad taken for deg, points in m for mm and in mm for m; right targets bring no such word."""
    joints = ur10.joints[:6]
    assert "check the unit" not in str(correct(ur10.model, joints))
    assert "if the angles were in rad: check the unit" in str(correct(ur10.model, np.radians(joints)))
    for factor in (1e-3, 1e3):
        wrong = Targets(joints, tips=factor * nominal_of(ur10.model, joints).tip_in_base)
        assert f"times {1 / factor:g} only" in str(correct(ur10.model, wrong))
    start = nominal_of(ur10.model, joints).tip_in_base
    far = correct(ur10.model, Targets(joints, tips=start + [2500.0, 0.0, 0.0]), frame="base")
    assert far.refused.all()
    there = far._in_frame(far.equipped.predict(joints))
    assert np.abs(there - start).max() < 10.0  # the errors of the arm: both are in its base [mm]


def posed(model, joints, orientations, names, *, shift_mm=(0.0, 0.0, 0.0)):
    """A table of joints and of the nominal poses there, shifted along the axes of the tip."""
    R, tips = nominal_of(model, joints)
    values = np.hstack([np.degrees(joints), tips + R @ np.array(shift_mm), orientations(Rotation.from_matrix(R))])
    return pd.DataFrame(values, columns=[*(f"q{i}_deg" for i in range(1, 7)), "x_mm", "y_mm", "z_mm", *names])


VECTOR, ANGLES = ("rx_deg", "ry_deg", "rz_deg"), ("roll_deg", "pitch_deg", "yaw_deg")
MATRIX = [f"r{i}{j}" for i in "123" for j in "123"]


@pytest.mark.parametrize(
    ("names", "orientations", "meant"),
    [
        (["qw", "qx", "qy", "qz"], lambda R: R.as_quat(), "qx, qy, qz, qw in this order"),
        (ANGLES, lambda R: R.as_rotvec(degrees=True), "a rotation vector"),
        (VECTOR, lambda R: R.as_euler("xyz", degrees=True), "roll, pitch, yaw"),
        (ANGLES, lambda R: R.as_euler("ZYX", degrees=True), "about z, the new y and the new x"),
        (ANGLES, lambda R: R.as_euler("XYZ", degrees=True), "about x, the new y and the new z"),
        (VECTOR, lambda R: R.as_rotvec(), "in rad"),
        (MATRIX, lambda R: R.inv().as_matrix().reshape(-1, 9), "transposed"),
    ],
)
def test_orientations_that_fit_their_start_joints_in_another_convention_are_refused(ur10, names, orientations, meant):
    table = posed(ur10.model, ur10.joints, orientations, names)
    refuses(f"deg from those at their start joints.* if .*{meant}", correct, ur10.model, table, untrained="accept")
    one = table.drop(columns=[f"q{i}_deg" for i in range(1, 7)])
    assert correct(ur10.model, one, start=ur10.joints[0], untrained="accept") is not None


def test_start_joints_far_from_their_poses_are_said_with_the_tool_that_explains_it(ur10):
    def said(**options):
        table = posed(ur10.model, ur10.joints, lambda R: R.as_rotvec(degrees=True), VECTOR, **options)
        return str(correct(ur10.model, table, untrained="accept", uncertainty=False))

    assert "start joints" not in said()
    assert "at each by 0.0, -20.0, 80.0 mm along the axes of the tip: check the tool" in said(shift_mm=(0, -20, 80))
    table = posed(ur10.model, ur10.joints, lambda R: R.as_rotvec(degrees=True), VECTOR)
    table["x_mm"] += 200.0
    assert "if those only choose the configuration" in str(correct(ur10.model, table, untrained="accept"))


def test_poses_in_the_other_frame_are_said(ur10):
    angles, noise = np.random.default_rng(3).uniform(-1, 1, (60, 6)) + ur10.model.arm_.working, np.random.default_rng(4)
    T = motion(Rotation.from_rotvec([0.0, 0.1, 2.0]).as_matrix(), [900.0, -400.0, 300.0])
    points = ur10.model.arm_.chain.tip_in_base(angles) @ T[:3, :3].T + T[:3, 3]
    model = KinematicModel(ur10.model.arm_).fit_readings(Session(angles, points + noise.normal(0, 0.01, points.shape)))
    table = posed(model, angles[:9], lambda R: R.as_rotvec(degrees=True), VECTOR)
    assert "--frame" not in str(correct(model, table, untrained="accept"))
    assert "of the reference only 0.0" in str(correct(model, table, frame="base", untrained="accept"))
    back, xyz = np.linalg.inv(reference_from_base(model)), ["x_mm", "y_mm", "z_mm"]
    in_base = table.assign(**dict(zip(xyz, back[:3, :3] @ table[xyz].to_numpy().T + back[:3, 3:], strict=True)))
    assert "of the arm's base only 0.0" in str(correct(model, in_base, untrained="accept"))


def test_a_limit_is_named_with_the_joint_and_by_how_much(ur10):
    change = corrected(ur10, ur10.joints).change
    row = int(np.argmax(change[:, 1]))
    upper = ur10.model.arm_.upper.copy()
    upper[1] = ur10.joints[row, 1] + change[row, 1] / 2
    model = type(ur10.model)(ur10.model.arm, highest=4)
    vars(model).update(
        {**vars(ur10.model), "arm_": replace(ur10.model.arm_, upper=upper, working_pose=ur10.joints[row])}
    )
    found = correct_targets(model, Targets.of_joints(ur10.joints[[row]]), untrained="accept")
    assert found.reasons[0].startswith("at a limit: J2 would be at ")
    assert f"{np.degrees(change[row, 1] / 2):.3g} deg beyond its limit" in found.reasons[0]
    np.testing.assert_allclose(found.margins[0, 1], -change[row, 1] / 2, atol=SAME_RAD)


def test_a_redundant_joint_at_its_limit_stays_there(rail):
    """The end of the rail is where the program has the arm: the other joints take over what the rail cannot."""
    change = corrected(rail, rail.joints).change
    row = int(np.argmax(change[:, 0]))
    end = rail.joints[row, 0] + change[row, 0] / 2
    arm = replace(rail.model.arm_, upper=np.array([end] + [6.0] * 6))
    model = PhysicalModel(arm, highest=2)
    vars(model).update({**vars(rail.model), "arm_": arm})
    found = correct_targets(model, Targets.of_joints(rail.joints[[row]]), untrained="accept", uncertainty=False)
    assert found.reasons == ("",)
    np.testing.assert_allclose(found.joints[0, 0], end, atol=1e-9)
    wanted = nominal_of(model, rail.joints[[row]])
    there = pose_of(model, found.joints)
    np.testing.assert_allclose(there.tip_in_base, wanted.tip_in_base, atol=REACHED_MM)
    np.testing.assert_allclose(there.R_base_tip, wanted.R_base_tip, atol=SAME_RAD)


def test_a_singular_pose_is_refused(ur10):
    joints = ur10.joints[:2].copy()
    joints[1, 4] = 1e-5  # the axes of joints 4 and 6 are parallel
    found = corrected(ur10, joints)
    assert found.reasons[0] == ""
    assert found.reasons[1].startswith(("singular: condition", "out of reach or singular", "correction of J"))


def test_a_large_correction_is_not_called_singular(ur10):
    """At a wrist that is nearly straight a small error needs a large turn, though the pose is none of the singular."""
    joints = np.repeat(ur10.joints[2:3], 20, axis=0)
    joints[:, 4] = np.geomspace(1e-3, 0.3, 20)
    found = corrected(ur10, joints)
    large = [reason for reason in found.reasons if reason.startswith("correction of J")]
    assert large
    assert all("exceeds the usual by more than 5.7 deg: wrong zero, sign or arm" in reason for reason in large)
    assert not any("singular: condition" in reason for reason in found.reasons)


@pytest.mark.parametrize("offset", [pytest.param(0.12, marks=pytest.mark.weekly), 0.3])
def test_an_arm_with_a_large_joint_offset_is_corrected(offset):
    """The readings share it between base, tip and joints, so that the change is no constant."""
    arm, rng = replace(load_arm("ur10"), nominal_error_mm=500.0), np.random.default_rng(1)
    joints = np.array([0.3, -1.2, 1.4, -1.0, 1.2, 0.2]) + 0.8 * rng.uniform(-1, 1, (300, 6))
    points = arm.chain.tip_in_base(joints + offset * np.eye(6)[2]) + rng.normal(0, 0.02, (300, 3))
    model = KinematicModel(arm).fit(joints, points)
    targets = Targets.of_joints(joints[:100])
    found = correct_targets(model, targets, untrained="accept", uncertainty=False)
    assert np.abs(found.change).max() > 0.1
    assert found.refused.mean() <= 0.05, found.reasons
    # A target's answer does not depend on the others.
    one = correct_targets(model, Targets.of_joints(joints[:1]), untrained="accept", uncertainty=False)
    np.testing.assert_allclose(one.joints, found.joints[:1], atol=SAME_RAD)


# Configurations, and orientations of arms of fewer than six joints


def ur_signs(joints, poses):
    """Signs of shoulder, elbow and wrist of a UR: the determinant of its Jacobian is their product."""
    _, J = poses.linearise(joints, np.arange(len(joints)))
    elbow, wrist = np.sign(np.sin(joints[:, 2])), np.sign(np.sin(joints[:, 4]))
    return np.stack([np.linalg.slogdet(J)[0] * elbow * wrist, elbow, wrist], axis=1)


def test_the_configuration_is_that_of_the_start_or_the_target_is_refused(ur10):
    rng, model = np.random.default_rng(3), ur10.model
    joints = model.arm_.working + rng.uniform(-0.9, 0.9, (150, 6))
    start = joints + rng.uniform(-1.5, 1.5, joints.shape)
    pose = nominal_of(model, joints)
    found = corrected(ur10, Targets(start, pose.tip_in_base, pose.R_base_tip))
    other = np.array([reason == "another configuration than the start joints" for reason in found.reasons])
    same = (ur_signs(start, nominal_poses(model)) == ur_signs(joints, nominal_poses(model))).all(axis=1)
    good = ~found.refused
    nominal = found.joints[good] - found.change[good]
    kept = ur_signs(nominal, nominal_poses(model)) == ur_signs(start[good], nominal_poses(model))
    assert kept.all(axis=1).mean() > 0.98  # paths may lead around a flip of a joint that turns by more than half a turn
    assert other.any()
    assert good.sum() > 50
    there = pose_of(model, found.joints[good])
    np.testing.assert_allclose(there.tip_in_base, pose.tip_in_base[good], atol=REACHED_MM)
    assert (good & same).sum() > 0.8 * same.sum()


def test_continuation_finds_the_configuration_that_newton_leaves(ur10):
    rng, nominal = np.random.default_rng(3), nominal_poses(ur10.model)
    joints = ur10.model.arm_.working + rng.uniform(-0.9, 0.9, (150, 6))
    start = joints + rng.uniform(-1.0, 1.0, joints.shape)
    pose = nominal_of(ur10.model, joints)
    task = task_of(ur10.model, nominal, pose)
    rows = np.flatnonzero(~keeps_configuration(task, start, solve_poses(task, start).angles))
    found, kept = follow(task.rows(rows), start[rows], Pose(*(p[rows] for p in nominal_of(ur10.model, start))))
    assert kept.any()
    there = nominal_of(ur10.model, found.angles[kept])
    np.testing.assert_allclose(there.tip_in_base, pose.tip_in_base[rows][kept], atol=REACHED_MM)
    assert (ur_signs(found.angles[kept], nominal) == ur_signs(start[rows][kept], nominal)).all()


def test_a_singular_start_chooses_no_configuration(ur10):
    pose = nominal_of(ur10.model, ur10.joints)
    start = ur10.joints.copy()
    start[:, 4] = 0.0  # the nominal wrist is straight
    found = corrected(ur10, Targets(start, pose.tip_in_base, pose.R_base_tip))
    assert not any("another configuration" in reason for reason in found.reasons)


def test_an_arm_of_five_joints_takes_a_pose_that_it_can_reach(five):
    rng = np.random.default_rng(5)
    joints = five.joints[:6]
    pose = nominal_of(five.model, joints)
    start = joints + rng.uniform(-0.2, 0.2, joints.shape)
    found = corrected(five, Targets(start, pose.tip_in_base, pose.R_base_tip))
    assert not found.refused.any(), found.reasons
    there = pose_of(five.model, found.joints)
    np.testing.assert_allclose(there.tip_in_base, pose.tip_in_base, atol=REACHED_MM)
    assert np.degrees(found.angle_rad).max() < 0.5
    np.testing.assert_allclose(found.joints - found.change, joints, atol=1e-6)  # the nominal arm's joints, not others


def test_an_orientation_that_five_joints_cannot_have_is_refused(five):
    joints = five.joints[:3]
    pose = nominal_of(five.model, joints)
    turned = pose.R_base_tip.copy()
    axes = five.model.nominal_.chain.pose(joints).R_base_tip
    turned[1] = Rotation.from_rotvec(axes[1] @ [0.5, 0.5, 0.0]).as_matrix() @ turned[1]
    found = corrected(five, Targets(joints, pose.tip_in_base, turned))
    assert [bool(reason) for reason in found.reasons] == [False, True, False]
    assert found.reasons[1].startswith("orientation out of reach: ")
    assert found.reasons[1].endswith(f"{np.degrees(found.angle_rad[1]):.2g} deg remain")
    assert not corrected(five, Targets(joints, pose.tip_in_base)).refused.any()  # positions ask for no orientation


def test_untrained_targets_are_refused_or_flagged(ur10):
    joints = ur10.joints.copy()
    joints[2, 0] = ur10.model.angle_ranges_[0, 1] + 0.5
    refused = corrected(ur10, joints, untrained="refuse")
    assert refused.reasons[2] == "outside the trained range (J1)"
    accepted = corrected(ur10, joints)
    assert accepted.outside[2]
    assert not accepted.refused[2]
    assert np.isfinite(accepted.joints[2]).all()


# Tools, uncertainty, inputs


def test_a_tool_is_rigid_in_the_flange(ur10):
    """Its tip is where the flange's axes have it, and turning it turns the pose."""
    short, long = (np.array([5.0, -3.0, z, 0.1, -0.2, 0.3]) for z in (100.0, 250.0))
    one, other = (pose_of(with_tool(ur10.model, tool), ur10.joints) for tool in (short, long))
    R_flange = one.R_base_tip @ Rotation.from_euler("xyz", short[3:]).as_matrix().T
    shift = R_flange @ (long - short)[:3]
    np.testing.assert_allclose(other.tip_in_base - one.tip_in_base, shift, atol=1e-9)
    np.testing.assert_allclose(other.R_base_tip, one.R_base_tip, atol=1e-12)
    nominal = nominal_of(with_tool(ur10.model, short), ur10.joints)
    assert np.linalg.norm(nominal.tip_in_base - one.tip_in_base, axis=1).max() < 5  # mm, as without the tool


def test_a_tool_at_the_nominal_tip_corrects_as_the_trained_tip(ur10):
    """The flange is where the nominal arm has it, up to what the readings say of the last joints."""
    tip = ur10.model.nominal_.chain.tip_in_flange
    equipped = with_tool(ur10.model, np.concatenate([tip, np.zeros(3)]))
    plain = corrected(ur10, ur10.joints)
    tooled = corrected(replace(ur10, model=equipped), ur10.joints, uncertainty=True)
    assert np.abs(plain.joints - tooled.joints).max() < 2e-3  # rad: 1 mm at half a metre
    assert np.isfinite(tooled.covariances).all()
    direct = equipped.predict(tooled.joints)
    np.testing.assert_allclose(direct, nominal_of(equipped, ur10.joints).tip_in_base, atol=REACHED_MM)


def test_a_network_takes_no_tool(network):
    refuses("no other tool", with_tool, network.model, np.zeros(6))


def test_covariances_are_those_of_the_prediction_at_the_joints_sent(ur10):
    found = corrected(ur10, ur10.joints, uncertainty=True)
    _, covariances = ur10.model.predict(found.joints, return_cov=True)
    np.testing.assert_allclose(found.covariances, covariances, rtol=1e-12)


def test_a_stated_temperature_counts(ur10):
    """Ten kelvin of steel or aluminium are a tenth of a millimetre a metre, if the model has learned it at all."""
    degC = ur10.model.training_.temperature_degC
    assert degC is not None
    mean, warm = (
        corrected(ur10, replace(Targets.of_joints(ur10.joints), temperature_degC=np.full(12, t)))
        for t in (degC.mean, degC.upper)
    )
    np.testing.assert_allclose(mean.joints, corrected(ur10, ur10.joints).joints, atol=1e-12)
    grows, start = False, 0
    for term in ur10.model.fit_.perturbed_chain.terms:
        grows |= isinstance(term.basis, Temperature) and ur10.model.fit_.coefficients[start] != 0
        start += term.n_coefficients
    assert grows == (np.abs(warm.joints - mean.joints).max() > 1e-9)


@pytest.mark.parametrize(
    ("targets", "options", "message"),
    [
        (np.zeros((2, 5)), {}, "expected 6 joints"),
        (np.full((3, 6), 90.0), {}, "outside its limits"),
        (np.full((1, 6), 1e9), {}, "no joint reaches"),
        (np.full((2, 6), np.nan), {}, "expected a finite number, got nan for J1 of target 1"),
        (np.zeros(6), {}, "shape \\(n, n_joints\\)"),
        (np.zeros((0, 6)), {}, "shape \\(n, n_joints\\)"),
        ("text", {}, "expected joint targets as an array"),
        (np.zeros((1, 6)), {"direction": "forward"}, "expected direction command or feedback"),
        (np.zeros((1, 6)), {"frame": "world"}, "expected frame"),
        (np.zeros((1, 6)), {"untrained": "maybe"}, "expected untrained"),
        (Targets(np.zeros((1, 6)), np.zeros((1, 3))), {"direction": "feedback"}, "these targets are positions"),
        (Targets(np.zeros((1, 6)), np.full((1, 3), 1e9)), {}, "which no arm reaches"),
        (Targets(np.zeros((1, 6)), np.full((1, 3), np.inf)), {}, "which no arm reaches"),
        (Targets(np.zeros((1, 6)), joint_columns=("q1_mm", *["q_rad"] * 5)), {}, "expected deg or rad, got mm"),
    ],
)
def test_wrong_input_is_refused_with_a_reason(ur10, targets, options, message):
    refuses(message, corrected, ur10, targets, **options)


def test_measured_points_give_back_the_joints_that_were_there():
    """Real readings: at the tip the joints found are as far from those recorded as the model from the points."""
    if datasets.find_local("ur10-a") is None:
        pytest.skip("the published readings are not here (TRUEARM_DATA)")
    train, test = datasets.load_readings("ur10-a").split(by="position", hold_out=0.3, seed=1)
    train, test = train.rows(slice(None, None, 20)), test.rows(slice(None, None, 40))
    model = KinematicModel(load_arm("ur10")).fit_readings(train)
    R = pose_of(model, test.angles).R_base_tip
    start = test.angles + np.random.default_rng(0).uniform(-0.05, 0.05, test.angles.shape)
    targets = Targets(start, test.points, R, temperature_degC=test.temperature_degC)
    found = correct_targets(model, targets, untrained="accept", uncertainty=False)
    good = ~found.refused
    assert good.mean() > 0.98
    chain = model.nominal_.chain
    moved = np.linalg.norm(chain.tip_in_base(found.joints[good]) - chain.tip_in_base(test.angles[good]), axis=1)
    errors = np.linalg.norm(model.predict_readings(test)[good] - test.points[good], axis=1)
    np.testing.assert_allclose(moved, errors, rtol=0.02)  # slopes of harmonics: none; of small motions: some 1e-3
    nominal = np.linalg.norm(model.predict_nominal(test.angles)[good] - test.points[good], axis=1)
    assert moved.mean() < 0.7 * nominal.mean()
