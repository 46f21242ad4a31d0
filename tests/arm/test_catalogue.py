"""The arms in the box: their published numbers, their data sets, their working poses."""

import json
import os
import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from refusals import refuses
from truearm.arm import list_arms, load_arm, write_arm
from truearm.arm.catalogue import known_name, maker_of
from truearm.arm.urdf import read_urdf

DOCUMENTED = Path(__file__).parents[2] / "docs" / "arms.md"
POSES = tomllib.loads((Path(__file__).parent / "catalogue_poses.toml").read_text("utf-8"))
DATA = Path(os.environ.get("TRUEARM_DATA", Path(__file__).parents[3] / "shared" / "datasets"))


def data_file(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the data set is not here: {path}")
    return path


def test_the_catalogue_is_what_is_documented():
    rows = re.findall(r"^\| ([^|]+) \| (`[^|]+) \|$", DOCUMENTED.read_text("utf-8"), re.MULTILINE)
    makers = {name: maker for maker, names in rows for name in re.findall(r"`([^`]+)`", names)}
    assert sorted(makers) == list(list_arms())
    for name, maker in makers.items():
        arm = load_arm(name)
        assert maker == (maker_of(arm.title) or "measuring arms")
        assert arm.source


def test_there_are_at_least_fifty_arms():
    assert len(list_arms()) >= 50


@pytest.mark.parametrize("name", POSES)
def test_poses_are_those_of_the_public_description(name):
    arm = load_arm(name)
    angles, tips, x_axes, z_axes = (np.array(column) for column in zip(*POSES[name]["poses"], strict=True))
    pose = arm.chain.pose(np.radians(angles))
    np.testing.assert_allclose(pose.tip_in_base, tips, rtol=0, atol=1e-4)  # mm, printed to 1e-4
    np.testing.assert_allclose(pose.R_base_tip[:, :, 0], x_axes, rtol=0, atol=1e-6)  # printed to 1e-6
    np.testing.assert_allclose(pose.R_base_tip[:, :, 2], z_axes, rtol=0, atol=1e-6)
    assert (np.radians(angles) >= arm.limits[:, 0] - 1e-9).all()
    assert (np.radians(angles) <= arm.limits[:, 1] + 1e-9).all()


def test_every_arm_has_poses_or_readings_of_its_own():
    assert {*list_arms()} - {*POSES} == {"gao2017", "gen3lite", "measuring7", "panda", "ur10", "ur5", "wam"}


# Reach to the centre of the wrist, as data sheets state it [mm].
STATED_REACH = {
    "irb120": 580,
    "irb1200-5-09": 901,
    "irb1200-7-07": 703,
    "irb140": 810,
    "irb2600-12-165": 1653,
    "irb4600-60-205": 2050,
    "kr6r900": 901.5,
    "kr10r1100": 1101,
    "kr16": 1611,
    "lrmate200id": 717,
    "m10ia": 1420,
    "m20ia": 1811,
    "m710ic50": 2050,
    "gp7": 927,
    "gp8": 727,
    "gp12": 1440,
    "tx2-60": 600,
    "tx2-90": 900,
    "rx160": 1600,
    "rs007n": 730,
    "vs060": 605,
}


@pytest.mark.parametrize("name", STATED_REACH)
def test_the_reach_is_that_of_the_data_sheet(name):
    chain = load_arm(name).chain
    out, upper = chain.fixed[1, 0, 3], np.linalg.norm(chain.fixed[2, :2, 3])  # axis 1 to the shoulder, to the elbow
    fore = chain.fixed[3, :3, 3] + chain.fixed[3, :3, :3] @ chain.fixed[4, :3, 3]
    assert out + upper + np.linalg.norm(fore) == pytest.approx(STATED_REACH[name], abs=1)  # mm


@pytest.mark.parametrize("name", list_arms())
def test_every_arm_says_what_it_is_and_where_its_numbers_come_from(name):
    arm = load_arm(name)
    assert arm.name == name
    assert len(arm.title) > 10
    assert len(arm.source) > 20


@pytest.mark.parametrize("name", list_arms())
def test_a_working_pose_is_no_singularity(name):
    # Smallest singular value of the tip's derivative by the joints: at least a twentieth of the reach per radian.
    arm = load_arm(name)
    own = arm.chain.tip_derivatives([arm.working]).motion_jacobian[0, 1:-1, 2]
    assert np.linalg.svd(own, compute_uv=False)[2] > arm.chain.reach / 20


def test_gao_2017_works_in_front_with_room_around():
    arm = load_arm("gao2017")
    tip = arm.chain.tip_in_base([arm.working])[0]
    assert 500 < np.hypot(tip[0], tip[1]) < 800
    assert abs(np.arctan2(tip[1], tip[0])) < np.deg2rad(3)
    elbow = arm.chain.tip_derivatives([arm.working]).motion_jacobian[0, 4]
    assert np.isfinite(elbow).all()
    box = arm.working + np.deg2rad(np.random.default_rng(0).uniform(-45, 45, (20_000, 6)))
    own = arm.chain.tip_derivatives(box).motion_jacobian[:, 1:-1, 2]
    # What the file says: a search finds no less than 126 mm/rad anywhere in the box.
    assert np.linalg.svd(own, compute_uv=False)[:, 2].min() > 125
    at_pose = arm.chain.tip_derivatives([arm.working]).motion_jacobian[0, 1:-1, 2]
    assert np.linalg.svd(at_pose, compute_uv=False)[2] == pytest.approx(496, abs=0.5)  # mm/rad, to the printed digit


def test_measuring7_reaches_half_its_measuring_range_from_the_shoulder():
    arm = load_arm("measuring7")
    straight = np.zeros((1, 7))
    np.testing.assert_allclose(arm.chain.tip_in_base(straight), [[0, 0, 320 + 1250]], atol=1e-9)
    q = np.random.default_rng(0).uniform(*np.clip(arm.limits.T, -np.pi, np.pi), (20_000, 7))
    distance = np.linalg.norm(arm.chain.tip_in_base(q) - [0, 0, 320], axis=1)
    # The elbow's 40 mm offset lets the arm stretch 3 mm further: hypot(600, 40) + hypot(470, 40) + 180.
    assert 1200 < distance.max() < 1253.1
    twists = [0, 2, 4, 6]
    assert np.isinf(arm.limits[twists]).all()
    assert np.isfinite(np.delete(arm.limits, twists, axis=0)).all()


def test_ur5_reproduces_its_data_sets_targets():
    table = pd.read_csv(data_file("tsinghua_ur5_wam/UR5/3D_UR5_uncalibrated_grid_cleaned.csv"))
    off = load_arm("ur5").chain.tip_in_base(np.deg2rad(table.filter(like="joint_"))) - table[["x_t", "y_t", "z_t"]]
    # The targets stand 0.089 mm above the nominal arm's tip, all alike (a thousandth of d1 = 89.159 mm: metres added
    # to millimetres?). Beside that they agree to 0.011 mm rms a coordinate.
    shift = off.to_numpy().mean(axis=0)
    np.testing.assert_allclose(shift, [0, 0, -0.089], atol=0.006)
    assert (off.to_numpy() - shift).std() < 0.011


def test_wam_reproduces_its_data_sets_targets():
    table = pd.read_csv(data_file("tsinghua_ur5_wam/WAM/3D_WAM_uncalibrated_grid_cleaned.csv"))
    off = load_arm("wam").chain.tip_in_base(np.deg2rad(table.filter(like="joint_"))) - table[["x_t", "y_t", "z_t"]]
    distance = np.linalg.norm(off, axis=1)
    assert distance.mean() < 0.0002
    assert distance.max() < 0.004


@pytest.mark.parametrize("name", ["ur5", "wam"])
def test_the_data_sets_angles_lie_within_the_limits(name):
    table = pd.read_csv(data_file(f"tsinghua_ur5_wam/{name.upper()}/3D_{name.upper()}_uncalibrated_grid_cleaned.csv"))
    angles = np.deg2rad(table.filter(like="joint_").to_numpy())
    lower, upper = load_arm(name).limits.T
    outside = (angles < lower) | (angles > upper)
    assert outside.any(axis=1).mean() < 0.01


@pytest.mark.parametrize("name", ["panda", "gen3lite"])
def test_nominal_chains_of_the_ball_data_set_are_ours(tmp_path, name):
    joints = json.loads(data_file("mukca_ball_socket/kinematics.json").read_text())["nominal"][name]
    (tmp_path / "nominal.urdf").write_text(urdf_of(joints))
    nominal, ours = read_urdf(tmp_path / "nominal.urdf").chain, load_arm(name).chain
    q = np.random.default_rng(0).uniform(-3, 3, (100, nominal.n_joints))
    theirs, mine = nominal.pose(q), ours.pose(q)
    np.testing.assert_allclose(mine.tip_in_base, theirs.tip_in_base, atol=1e-9, rtol=0)
    np.testing.assert_allclose(mine.R_base_tip, theirs.R_base_tip, atol=1e-12, rtol=0)


def urdf_of(joints: list[dict]) -> str:
    links = "".join(f'<link name="l{i}"/>' for i in range(len(joints) + 1))
    parts = []
    for i, joint in enumerate(joints):
        xyz, rpy, axis = (" ".join(map(repr, map(float, joint[key]))) for key in ("xyz_m", "rpy_rad", "axis"))
        parts.append(
            f'<joint name="{joint["name"]}" type="{joint["type"]}"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>'
        )
    return f'<robot name="nominal">{links}{"".join(parts)}</robot>'


# What a user types


def test_an_arm_that_all_share_cannot_be_changed_in_place():
    """A wrong length that a program wrote into its arm would be that of every later one."""
    table = load_arm("ur10").table
    for name in ("a", "d", "alpha", "theta", "beta", "b", "prismatic", "base", "flange", "tip_in_flange"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(table, name)[0] = 1.0
    for array in (load_arm("ur10").chain.fixed, load_arm("ur10").limits):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_an_arm_is_found_by_name_or_by_path(tmp_path):
    assert load_arm("ur5").name == "ur5"
    for suffix in (".toml", ".urdf", ".TOML"):
        path = tmp_path / f"mine{suffix}"
        write_arm(load_arm("wam"), path)
        assert load_arm(path).name == "wam"
        assert load_arm(str(path)).name == "wam"


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("UR 5e", "ur5e"),
        ("UR10", "ur10"),
        ("Universal Robots UR3", "ur3"),
        ("KUKA KR 6 R900", "kr6r900"),
        ("KR 6 R900 sixx", "kr6r900"),
        ("LBR iiwa 7 R800", "iiwa7"),
        ("fanuc lrmate 200id", "lrmate200id"),
        ("M-20iA", "m20ia"),
        ("ABB IRB 1200-5/0.9", "irb1200-5-09"),
        ("IRB 6700-200/2.60", "irb6700-200-260"),
        ("stäubli TX2-60", "tx2-60"),
        ("Staubli tx2 60", "tx2-60"),
        ("Motoman GP7", "gp7"),
        ("Franka Emika Panda", "panda"),
        ("SO-101", "so101"),
        ("xArm 6", "xarm6"),
    ],
)
def test_an_arm_is_found_as_its_maker_writes_it(written, name):
    assert load_arm(written).name == name


@pytest.mark.parametrize("name", list_arms())
def test_a_title_begins_with_the_maker_and_leads_to_the_arm(name):
    title = load_arm(name).title
    assert maker_of(title) or "measuring arm" in title
    assert known_name(re.split(r"[,(;]| with ", title)[0]) == name
    assert name in list_arms(f"{maker_of(title)} {name}")


def test_a_search_needs_all_its_words():
    assert list_arms("fanuc") == ("lrmate200id", "m10ia", "m20ia", "m710ic50", "r2000ic165f")
    assert list_arms("KUKA iiwa 14") == ("iiwa14",)
    assert list_arms("measuring arm") == ("aacmm2018", "gao2017", "measuring7")
    assert list_arms("abb kuka") == ()
    assert list_arms(" ") == list_arms()


def test_an_unknown_arm_is_refused_with_the_nearest_names():
    refuses(r"no arm 'ur15' in the catalogue of \d+ arms.*Try: ur\d+e? or ur", load_arm, "ur15")
    refuses(r"no arm 'IRB 2600'.*Try: irb2600-12-165", load_arm, "IRB 2600")
    refuses(r"no arm 'xyzzy'.*Try: truearm arms lists all; or give the path of an arm file", load_arm, "xyzzy")


@pytest.mark.parametrize("text", ["mine.toml", "folder/mine", "../ur5", "mine.urdf"])
def test_what_looks_like_a_path_is_a_path(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refuses(r"does not exist|ends in .toml, .urdf, .xml or .yaml", load_arm, text)
