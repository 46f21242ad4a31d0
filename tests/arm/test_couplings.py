"""Couplings: written as sums, kept in arm files, exact in kinematics and derivatives; mimic joints of a URDF."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import load_arm, read_arm, write_arm
from truearm.arm.couplings import coupling_text, parse_coupling
from truearm.arm.urdf import read_urdf
from truearm.errors import InputError
from truearm.readings import Session
from truearm.wings.exports.formats import c_source
from truearm.wings.exports.targets.manifest import Manifest
from truearm.wings.reports.arms import describe_arm

FANUC = "J3 += J2"


def coupled(name="ur5", text=FANUC):
    arm = load_arm(name)
    return replace(arm, chain=replace(arm.chain, coupling=parse_coupling(text, arm.n_joints)))


@pytest.mark.parametrize(
    ("text", "row"),
    [
        ("J3+=J2", [0, 1, 1]),
        ("j3 -= j2", [0, -1, 1]),
        ("J3 = J3 - 0.5*J2 + 2 J1", [2, -0.5, 1]),
        ("J3=J1-J2+J3;", [1, -1, 1]),
    ],
)
def test_sums_become_rows_and_are_written_again(text, row):
    matrix = parse_coupling(text, 3)
    np.testing.assert_array_equal(matrix, [[1, 0, 0], [0, 1, 0], row])
    np.testing.assert_array_equal(parse_coupling(coupling_text(matrix), 3), matrix)


@pytest.mark.parametrize(
    "text", ["", "J3", "J3=J2", "J4+=J1", "J3+=", "J3+=J0", "J3+=2", "J3+=J2, J3-=J1", "J3+=J2;J2+=x"]
)
def test_what_is_no_coupling_is_refused(text):
    refuses("coupl|the arm has the joints", parse_coupling, text, 3)


def test_the_identity_changes_nothing():
    arm = load_arm("ur5")
    assert replace(arm.chain, coupling=np.eye(6)).coupling is None
    for bad in (np.eye(5), np.full((6, 6), np.nan), np.diag([1, 1, 0, 1, 1, 1])):
        refuses("coupling", replace, arm.chain, coupling=bad)


@pytest.mark.parametrize("text", [FANUC, "J2=J2+J3; J3=J2-J3, J5-=0.5*J4"])
def test_a_coupled_arm_is_the_plain_one_at_the_angles_of_its_joints(text):
    plain, arm = load_arm("ur5"), coupled(text=text)
    q = np.random.default_rng(1).uniform(-2, 2, (30, 6))
    joints = q @ arm.chain.coupling.T
    motions = np.random.default_rng(2).normal(0, 0.01, (30, 8, 6))
    np.testing.assert_array_equal(arm.chain.tip_in_base(q), plain.chain.tip_in_base(joints))
    np.testing.assert_array_equal(arm.chain.tip_in_base(q, motions), plain.chain.tip_in_base(joints, motions))
    for mine, theirs in zip(arm.chain.pose(q), plain.chain.pose(joints), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    mine, theirs = arm.chain.tip_derivatives(q), plain.chain.tip_derivatives(joints)
    np.testing.assert_array_equal(mine.motion_jacobian, theirs.motion_jacobian)
    step = 1e-6
    differences = [
        (arm.chain.tip_in_base(q + step * one) - arm.chain.tip_in_base(q - step * one)) / (2 * step)
        for one in np.eye(6)
    ]
    # mm per rad; the third derivative times the square of the step
    np.testing.assert_allclose(arm.jacobian(q)[:, :3].transpose(2, 0, 1), differences, rtol=0, atol=1e-5)


def test_inverse_kinematics_gives_the_encoders():
    arm = coupled()
    q = arm.working + np.random.default_rng(3).uniform(-0.3, 0.3, (10, 6))
    there = arm.forward(q)
    found = arm.inverse(there.tip_in_base, there.R_base_tip)
    assert found.reached.all()
    again = arm.forward(found.angles)
    np.testing.assert_allclose(again.tip_in_base, there.tip_in_base, rtol=0, atol=1e-3)  # mm, the solver's tolerance


def test_an_arm_file_keeps_it(tmp_path):
    arm = coupled()
    write_arm(arm, tmp_path / "arm.toml")
    again = read_arm(tmp_path / "arm.toml")
    np.testing.assert_array_equal(again.chain.coupling, arm.chain.coupling)
    assert "joints by the encoders: J3 = J2 + J3" in str(describe_arm(again))
    assert "matrix = [[1.0, 0.0" in (tmp_path / "arm.toml").read_text()
    refuses(r"no URDF.*\.toml", write_arm, arm, tmp_path / "arm.urdf")
    text = (tmp_path / "arm.toml").read_text()
    for matrix, said in (("[[1, 2]]", "as many columns as rows"), ("[[1]]", "6 x 6 finite numbers"), ("3", "matrix")):
        (tmp_path / "bad.toml").write_text(f"{text.partition('[coupling]')[0]}\n[coupling]\nmatrix = {matrix}\n")
        refuses(said, read_arm, tmp_path / "bad.toml")


def test_a_fit_with_the_pendants_angles_is_that_with_the_joints(tmp_path):
    """Readings of an arm whose J3 is counted from the horizontal, as a pendant shows it."""
    session = ta.simulate("ur5", poses=40, preset="shop", seed=3, strategy="uniform").session
    free = replace(load_arm("ur5"), lower=None, upper=None)
    arm = replace(free, chain=coupled().chain)
    shown = replace(session, angles=session.angles @ np.linalg.inv(arm.chain.coupling).T)
    of_fit = {"model": "physical", "highest": 4, "limits": "ignore"}
    plain, fitted = (ta.fit(a, s, **of_fit).model for a, s in ((free, session), (arm, shown)))
    tips = plain.predict(session.angles)
    np.testing.assert_allclose(fitted.predict(shown.angles), tips, rtol=0, atol=1e-3)  # mm; the readings have 0.03
    fitted.save(tmp_path / "m.truearm")
    np.testing.assert_array_equal(
        ta.load_model(tmp_path / "m.truearm").predict(shown.angles), fitted.predict(shown.angles)
    )
    sent, there = ta.correct(fitted, shown.angles[:4]).joints, ta.correct(plain, session.angles[:4]).joints
    np.testing.assert_allclose(sent @ arm.chain.coupling.T, there, rtol=0, atol=1e-6)
    for name, format in (("m.json", "json"), ("m.c", "c"), ("m.urdf", "urdf"), ("m.csv", "constants")):
        refuses(r"coupled \(J3 = J2 \+ J3\)", ta.export, fitted, tmp_path / name, format=format)
        assert not (tmp_path / name).exists()
    with pytest.raises(InputError, match=r"coupled \(J3 = J2 \+ J3\)"):  # by the writer of the format, too
        c_source.write(fitted, Manifest.of(fitted, "c"), tmp_path / "m.c")


def mimic(more: str, kinds=("revolute", "revolute", "prismatic")) -> str:
    limit = "<limit lower='-3' upper='3' effort='1' velocity='1'/>"
    links = "".join(f"<link name='l{i}'/>" for i in range(4))
    joints = "".join(
        f"<joint name='j{i}' type='{kind}'><parent link='l{i}'/><child link='l{i + 1}'/><origin xyz='0.{i + 1} 0 0.2' "
        f"rpy='0.1 {i} 0'/><axis xyz='0 {i} 1'/>{limit}"
        f"{more if i else ''}</joint>"
        for i, kind in enumerate(kinds)
    )
    return f"<robot name='r'>{links}{joints}</robot>"


def test_a_mimic_joint_on_the_way_is_a_coupling_as_in_pinocchio(tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    path = tmp_path / "r.urdf"
    path.write_text(mimic("<mimic joint='j0' multiplier='-0.5' offset='0.2'/>"))
    arm, model = read_urdf(path), pinocchio.buildModelFromUrdf(str(path))
    np.testing.assert_allclose(arm.chain.coupling, [[1, 0, 0], [-0.5, 0, 0], [-500, 0, 0]])  # mm per rad
    (said,) = arm.remarks
    assert said.startswith("no angle is read of j1, j2, which mimics another joint")
    data = model.createData()
    for angle in np.linspace(-2, 2, 5):
        follows = -0.5 * angle + 0.2
        pinocchio.framesForwardKinematics(model, data, np.array([angle, follows, follows]))
        tip = 1000 * data.oMf[model.getFrameId("l3", pinocchio.FrameType.BODY)].translation
        # What stands in the columns of joints that follow does not matter.
        np.testing.assert_allclose(arm.chain.tip_in_base([[angle, 9.0, 7.0]])[0], tip, rtol=0, atol=1e-9)


def test_a_mimic_of_a_mimic_is_followed_to_its_leader(tmp_path):
    path = tmp_path / "r.urdf"
    text = mimic("<mimic joint='j0' multiplier='2' offset='0.1'/>", kinds=("revolute",) * 3)
    path.write_text(text.replace("joint='j0'", "joint='j1'").replace("joint='j1'", "joint='j0'", 1))
    arm = read_urdf(path)
    np.testing.assert_array_equal(arm.chain.coupling, [[1, 0, 0], [2, 0, 0], [4, 0, 0]])
    path.write_text(text.replace("joint='j0'", "joint='j2'", 1).replace("joint='j0'", "joint='j1'", 1))
    refuses("mimics itself", read_urdf, path, tip="l3")
    path.write_text(text.replace("joint='j0'", "joint='elsewhere'"))
    refuses("'elsewhere', which is not on the way to the tip", read_urdf, path)


def test_a_joint_that_mimics_is_no_input_of_a_network(tmp_path):
    """It has no encoder: its column may hold zeros, or anything."""
    path, rng = tmp_path / "r.urdf", np.random.default_rng(5)
    path.write_text(
        mimic("", kinds=("revolute",) * 3).replace("</joint></robot>", "<mimic joint='j0'/></joint></robot>")
    )
    arm = read_urdf(path)
    assert arm.chain.is_read.tolist() == [True, True, False]
    assert load_arm("ur5").chain.is_read.all()
    assert coupled().chain.is_read.all()
    q = np.c_[rng.uniform(-1, 1, (60, 2)), np.zeros(60)]
    session = Session(q, arm.chain.tip_in_base(q) + rng.normal(0, 0.02, (60, 3)))
    result = ta.fit(arm, session, model="network", hidden=(3,), epochs=5)
    assert not any("J3 moves by less" in sentence for sentence in result.remarks)
    tips = result.model.predict(q)
    other = np.c_[q[:, :2], q[:, 0]]
    np.testing.assert_array_equal(result.model.predict(other), tips)
    for seen in (other, replace(session, angles=other)):
        assert not result.model.outside_training(seen).any()
    result.model.save(tmp_path / "m.truearm")
    np.testing.assert_array_equal(ta.load_model(tmp_path / "m.truearm").predict(q), tips)
    pytest.importorskip("onnx")
    ta.export(result.model, tmp_path / "m.onnx")  # its check poses are met, or this is refused
    said = str(ta.predict(result.model, replace(session, angles=other)))
    assert "outside the trained range" not in said
