"""Files of constants for controllers and ROS: exact, with one direction, refused where damaged or of another robot."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from planted_models import empty_models

import truearm as ta
from refusals import refuses
from truearm.arm import chain_from_dh
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.kinematics_yaml import JOINTS, read_ur_kinematics, ur_hash
from truearm.errors import InputError
from truearm.identification.references.alignment import align
from truearm.wings.exports.export import check_export, export
from truearm.wings.exports.formats import constants, joint_offsets, ur_kinematics
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm
from truearm.wings.exports.formats.ur_kinematics import ur_kinematics_text
from truearm.wings.exports.targets.manifest import read_manifest

HASH = "calib_3437785250745286433"


def with_errors(arm: Arm, seed: int = 4) -> Arm:
    rng = np.random.default_rng(seed)
    motions = rng.normal(size=(arm.chain.n_places, 6)) * ([1e-3] * 3 + [0.5] * 3)
    return replace(arm, chain=arm.chain.with_motions(motions))


def poses(arm: Arm, n: int, seed: int = 0) -> np.ndarray:
    low, high = np.clip(arm.limits.T, [[-2.5], [-2.5]], [[2.5], [2.5]])
    q = np.random.default_rng(seed).uniform(low, high, (n, arm.n_joints))
    return q * np.where(arm.chain.is_prismatic, 100.0, 1.0)


def fitted(nominal: Arm, arm: Arm, n: int = 80) -> ta.KinematicModel:
    q = poses(arm, n)
    noise = np.random.default_rng(1).normal(0, 0.01, (n, 3))
    return ta.KinematicModel(nominal).fit(q, arm.chain.tip_in_base(q) + noise)


@pytest.fixture(scope="module")
def rail() -> ta.KinematicModel:
    chain = chain_from_dh(
        a=[0, 0, 400, 50],
        d=[0, 350, 0, 400],
        alpha=np.deg2rad([90, -90, 0, -90]),
        theta=np.deg2rad([90, -90, 0, 0]),
        kinds=["prismatic", "revolute", "revolute", "revolute"],
        tip_in_flange=[20, 0, 80],
    )
    arm = Arm("rail arm", chain, joint_names=("rail", "J 1", "yes", "wrist"))
    return fitted(arm, with_errors(arm))


@pytest.fixture(scope="module")
def panda() -> ta.KinematicModel:
    arm = ta.load_arm("panda")
    return fitted(arm, with_errors(arm))


@pytest.fixture(scope="module")
def ur10() -> ta.KinematicModel:
    arm = ta.load_arm("ur10")
    return fitted(arm, with_errors(arm))


@pytest.fixture(scope="module")
def whole(ur10, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("whole") / "whole.yaml"
    joint_offsets.write(ur10, path)
    return path.read_text()


@pytest.fixture
def model(request) -> ta.KinematicModel:
    return request.getfixturevalue(request.param)


def robot_file(folder, seed=2):
    """Kinematics yaml of a UR10 with factory errors, as its driver would write it."""
    links = []
    for x, z, roll, y in ((0, 127.3, 0, 0), (0, 0, 90, 0), (-612, 0, 0, 0), (-572.3, 163.941, 0, 0)):
        links.append((x, y, z, roll))
    links += [(0, -115.7, 0, 90), (0, 92.2, 0, -90)]
    frames = []
    rng = np.random.default_rng(seed)
    for x, y, z, roll in links:
        frame = np.eye(4)
        cos, sin = np.cos(np.deg2rad(roll)), np.sin(np.deg2rad(roll))
        frame[1:3, 1:3] = [[cos, -sin], [sin, cos]]
        frame[:3, 3] = np.array([x, y, z]) + rng.normal(0, 0.1, 3)
        frames.append(frame)
    path = folder / "my_robot_calibration.yaml"
    path.write_text(ur_kinematics_text(frames, HASH))
    return path


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return robot_file(tmp_path_factory.mktemp("robot"))


# Joint offsets


@pytest.mark.parametrize("model", [pytest.param("ur10", marks=pytest.mark.weekly), "panda", "rail"], indirect=True)
def test_offsets_and_origins_are_the_rigid_arm(model, tmp_path):
    path = tmp_path / "offsets.yaml"
    rigid = joint_offsets.write(model, path, frame="reference").rigid
    q = poses(model.arm_, 30, 5)
    expected = rigid.in_reference_frame().chain.tip_in_base(q)
    np.testing.assert_allclose(joint_offsets.tips(path, q), expected, atol=1e-8, rtol=0)
    manifest = read_manifest(path)
    assert manifest.direction == "feedback"
    np.testing.assert_allclose(joint_offsets.tips(path, manifest.joints), manifest.tips, atol=1e-8, rtol=0)
    document = yaml.safe_load(path.read_text())
    assert document["joint_offsets"]["direction"] == "feedback"
    assert list(document["joint_offsets"]["joints"]) == list(model.arm_.joint_names)


def test_a_planted_offset_is_added_to_the_encoders_position(tmp_path):
    # The encoder of joint 3 shows 4 mrad too little: the true position is the encoder's plus 4 mrad.
    nominal = ta.load_arm("ur10")
    motions = np.zeros((8, 6))
    motions[3, 2] = 4e-3
    path = tmp_path / "offsets.yaml"
    joint_offsets.write(fitted(nominal, replace(nominal, chain=nominal.chain.with_motions(motions)), 200), path)
    joints = yaml.safe_load(path.read_text())["joint_offsets"]["joints"]
    assert joints["J3"]["unit"] == "rad"
    assert joints["J3"]["offset"] == pytest.approx(4e-3, abs=2e-4)
    assert abs(joints["J2"]["offset"]) < 2e-4


def test_offsets_of_a_sliding_joint_are_in_metres(tmp_path):
    """A slide between two turning joints shows 4 mm too little. (That of a first joint is the base's.)"""
    chain = chain_from_dh(
        a=[100, 50, 300, 50],
        d=[350, 400, 0, 100],
        alpha=np.deg2rad([90, 90, -90, 0]),
        kinds=["revolute", "prismatic", "revolute", "revolute"],
        tip_in_flange=[60, 0, 80],
    )
    nominal = Arm("slide arm", chain, joint_names=("turn", "slide", "elbow", "wrist"))
    motions = np.zeros((chain.n_places, 6))
    motions[2, 5] = 4.0
    path = tmp_path / "offsets.yaml"
    joint_offsets.write(fitted(nominal, replace(nominal, chain=chain.with_motions(motions))), path)
    joints = yaml.safe_load(path.read_text())["joint_offsets"]["joints"]
    assert joints["slide"]["unit"] == "m"
    assert joints["slide"]["offset"] == pytest.approx(0.004, abs=0.0004)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda text: text.replace("direction: feedback", "direction: command"),
            "expected the direction feedback, got",
        ),
        (lambda text: text.replace("unit: rad", "unit: deg", 1), "expected rad or m, got 'deg'"),
        (lambda text: text.replace("    J2:\n      offset", "    J7:\n      offset"), "J2 missing, J7 unknown"),
        (lambda text: text.replace("offset: 0", "offset: O", 1), "the offset of J1 as a finite number"),
        (lambda text: text.replace("  tip:\n", "  tool:\n"), "tip missing, tool unknown"),
        (lambda text: text.replace("    yaw:", "    jaw:", 1), "yaw missing, jaw unknown"),
    ],
)
def test_a_damaged_file_of_offsets_is_refused(whole, change, message, tmp_path):
    path = tmp_path / "offsets.yaml"
    changed = change(whole)
    assert changed != whole
    path.write_text(changed)
    refuses(message, joint_offsets.tips, path, np.zeros((1, 6)))


# UR kinematics


def test_an_identified_ur_is_the_robots_file_with_its_own_hash(source, tmp_path):
    nominal = ta.load_arm(source)
    rng = np.random.default_rng(3)
    true = with_errors(nominal)
    turned = replace(true, chain=true.chain.with_tip([10.0, -5.0, 90.0]))
    model = fitted(nominal, turned, 120)
    path = tmp_path / "identified.yaml"
    rigid = ur_kinematics.write(model, path).rigid
    assert path.read_text().rstrip().endswith(f"hash: {HASH}")
    assert set(yaml.safe_load(path.read_text())["kinematics"]) == {
        "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "hash"
    }  # fmt: skip
    again = read_ur_kinematics(path)
    q = rng.uniform(-3, 3, (50, 6))
    # The file has the stand-in's tips with the tool of its comment, and its own frames near the source's.
    np.testing.assert_allclose(ur_kinematics.tips(path, q), rigid.arm.chain.tip_in_base(q), atol=1e-6, rtol=0)
    assert np.abs(again.chain.fixed - nominal.chain.fixed).max() < 6  # mm: 1 mrad and 0.5 mm a place
    points = turned.chain.tip_in_base(q)
    T = align(ur_kinematics.tips(path, q), points)
    off = np.linalg.norm(ur_kinematics.tips(path, q) @ T[:3, :3].T + T[:3, 3] - points, axis=1)
    assert off.mean() < 0.05  # mm: noise of 0.01 mm, some of these poses away from the training
    before = nominal.chain.with_tip([10.0, -5.0, 90.0]).tip_in_base(q)
    T = align(before, points)
    assert np.linalg.norm(before @ T[:3, :3].T + T[:3, 3] - points, axis=1).mean() > 0.5


def test_a_model_of_the_catalogue_arm_goes_into_the_robots_file(ur10, source, tmp_path):
    path = tmp_path / "identified.yaml"
    rigid = ur_kinematics.write(ur10, path, source=source).rigid
    assert rigid.nominal.joint_names == JOINTS
    assert rigid.loss.exported_max_mm < 1e-3
    q = poses(ur10.arm_, 50, 5)
    found, expected = ur_kinematics.tips(path, q), ur10.predict(q)
    T = align(found, expected)
    np.testing.assert_allclose(found @ T[:3, :3].T + T[:3, 3], expected, atol=1e-3)


def test_the_tool_is_no_part_of_the_robot(ur10, source, tmp_path):
    path = tmp_path / "identified.yaml"
    ur_kinematics.write(ur10, path, source=source)
    text = path.read_text()
    q = np.zeros((1, 6))
    path.write_text("".join(line + "\n" for line in text.splitlines() if "tool0" not in line))
    np.testing.assert_array_equal(ur_kinematics.tips(path, q), read_ur_kinematics(path).chain.tip_in_base(q))
    path.write_text(text.replace("tip in tool0 [m]: ", "tip in tool0 [m]: x"))
    refuses("expected three finite numbers after", ur_kinematics.tips, path, q)


def test_what_has_no_place_in_the_file_is_refused(ur10, panda, source, tmp_path):
    path = tmp_path / "out.yaml"
    with pytest.raises(InputError, match=r"the hash by which the driver recognises the robot is not known.*--original"):
        ur_kinematics.write(ur10, path)
    refuses("expected a UR, got the arm 'panda' of 7 joints", ur_kinematics.write, panda, path)
    refuses(r"the arm 'panda' 7 joints|has 6 joints", ur_kinematics.write, panda, path, source=source)
    refuses("in the robot's own base frame", ur_kinematics.write, ur10, path, source=source, frame="reference")
    gao = ta.load_arm("gao2017")
    with pytest.raises(InputError, match=r"expected a UR, got the arm 'gao2017': its axes 2 and 3 are at 90 deg"):
        ur_kinematics.write(fitted(gao, with_errors(gao)), path)
    nameless = tmp_path / "nameless.yaml"
    nameless.write_text(source.read_text().replace(f"  hash: {HASH}\n", ""))
    refuses("the hash by which the driver recognises", ur_kinematics.write, ur10, path, source=nameless)
    assert not path.exists()


# All of them, through the door


@pytest.mark.parametrize(
    ("format", "name"), [("constants", "a.csv"), ("joint-offsets", "a.yaml"), ("ur-kinematics", "a.yaml")]
)
def test_the_check_of_a_file_finds_what_was_changed(ur10, source, format, name, tmp_path):
    path = tmp_path / name
    export(ur10, path, format=format, source=source if format == "ur-kinematics" else None)
    assert check_export(ur10, path).agrees
    text = path.read_text()
    # A length of the upper arm changes by some millimetres.
    old = {"constants": r"(J2,a,mm,-612.0,-6)(.)"}.get(format, r"(-0\.61)(\d)")
    changed = re.sub(old, lambda found: f"{found[1]}9{found[2][1:]}", text)
    assert changed != text
    path.write_text(changed)
    assert not check_export(ur10, path).agrees


def test_an_arm_without_coefficients_is_written(source, tmp_path):
    for model in empty_models():
        for format, name in (
            ("constants", "a.csv"),
            ("joint-offsets", "a.yaml"),
            ("ur-kinematics", "b.yaml"),
            ("urdf", "a.urdf"),
            ("json", "a.json"),
        ):
            export(model, tmp_path / name, format=format, source=source if format == "ur-kinematics" else None)
            assert check_export(model, tmp_path / name).agrees


# Columns that say the same


@pytest.mark.parametrize(("column", "value"), [(5, "9.0"), (3, "9.0"), (2, "deg"), (5, "x")])
def test_constants_whose_columns_contradict_each_other_are_refused(ur10, tmp_path, column, value):
    path = tmp_path / "constants.csv"
    constants.write(ur10, path)
    lines = path.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("J2,a"))
    cells = lines[at].split(",")
    cells[column] = value
    lines[at] = ",".join(cells)
    path.write_text("\n".join(lines))
    refuses(r"identified constant|in mm|finite", constants.tips, path, poses(ur10.arm_, 3))
    assert not check_export(ur10, path).agrees


# Names


@pytest.fixture(
    scope="module",
    params=[
        ("\U0001f600", "=cmd|calc", 'a"\\,:b', "a\u2028b", "a\r\nb", "base"),
        pytest.param(("tip", "#1", "a\nb", "J4", "no", "base"), marks=pytest.mark.weekly),
    ],
    ids=["hostile", "odd"],
)
def oddly_named(request):
    arm = replace(ta.load_arm("ur10"), joint_names=request.param)
    return fitted(arm, with_errors(arm), 30)


@pytest.mark.parametrize(
    ("format", "name"), [("constants", "a.csv"), *(("joint-offsets", "a.yaml"), ("urdf", "a.urdf"), ("json", "b.json"))]
)
def test_any_name_of_a_joint_comes_back(oddly_named, format, name, tmp_path):
    export(oddly_named, tmp_path / name, format=format)
    assert check_export(oddly_named, tmp_path / name).agrees
    assert "\n=cmd" not in (tmp_path / name).read_text("utf-8")  # a spreadsheet would run it


@pytest.mark.parametrize(
    "odd",
    [
        {"name": "x" * 400, "title": "t" * 2000, "serial_number": "s" * 400, "source": "s" * 2000},
        {"name": 'truearm-export: {} --> */ ?? /* <!-- "'},
    ],
)
def test_long_and_odd_texts_are_no_obstacle(odd, tmp_path):
    arm = replace(ta.load_arm("ur10"), **odd)
    model = fitted(arm, with_errors(arm), 30)
    for name in ("a.json", "a.urdf"):
        export(model, tmp_path / name)
        assert check_export(model, tmp_path / name).agrees


@pytest.mark.parametrize("name", ["x" * 400, "a\udcff"])
def test_names_that_no_file_can_state_are_refused(name, tmp_path):
    arm = replace(ta.load_arm("ur10"), joint_names=(name, "J2", "J3", "J4", "J5", "J6"))
    with pytest.raises(InputError, match="expected names of joints with at most 300 characters"):
        export(fitted(arm, with_errors(arm), 30), tmp_path / "a.csv", format="constants")


def test_a_region_with_a_name_of_other_bytes_is_stated():
    arm = ta.load_arm("ur10")
    model = fitted(arm, with_errors(arm), 30)
    assert best_rigid_arm(model, poses(arm, 20), region="reg\udcff.csv" + 400 * "x").loss.region.startswith("reg?.csv")


def test_a_model_that_is_not_fitted_is_refused(tmp_path):
    with pytest.raises(InputError, match="KinematicModel is not fitted.*fit it first"):
        export(ta.KinematicModel(ta.load_arm("ur10")), tmp_path / "a.urdf")


# UR


def test_a_ur_with_a_flange_is_refused(source, tmp_path):
    """The file has no place for it; without it every tip would be off by its length."""
    arm = read_ur_kinematics(source)
    fixed = arm.chain.fixed.copy()
    fixed[-1][:3, 3] = [0, 0, 50.0]
    with_flange = replace(arm, chain=Chain(fixed, arm.chain.tip_in_flange))
    with pytest.raises(InputError, match="has a flange after joint 6"):
        export(fitted(with_flange, with_flange, 30), tmp_path / "a.yaml", format="ur-kinematics")
    assert not (tmp_path / "a.yaml").exists()


@pytest.mark.parametrize("words", ["my notes calib_1 of 3", "calib_1", "UR kinematics yaml, calib_1 of 3"])
def test_a_hash_comes_from_the_robots_file_only(words):
    assert ur_hash(replace(ta.load_arm("ur10"), source=words)) is None
