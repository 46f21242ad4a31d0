"""MJCF read as an arm: poses as MuJoCo has them, and everything else refused."""

import numpy as np
import pytest

import truearm as ta
from made_up_mjcf import JOINTS, MODEL, POSES
from refusals import refuses


@pytest.fixture
def written(tmp_path):
    def write(text: str):
        (tmp_path / "robot.xml").write_text(text)
        return tmp_path / "robot.xml"

    return write


def test_poses_are_those_of_mujoco(written):
    arm = ta.load_arm(written(MODEL))
    assert arm.joint_names == JOINTS
    assert arm.chain.is_prismatic.tolist() == [False, False, False, True, False]
    for joints, tip in POSES:
        q = np.array([joints]) * np.where(arm.chain.is_prismatic, 1000.0, 1.0)
        np.testing.assert_allclose(arm.chain.tip_in_base(q)[0], 1000 * np.array(tip), rtol=0, atol=1e-9)  # mm
    np.testing.assert_allclose(np.degrees(arm.limits[[0, 1, 2]]), [[-170, 170], [-100, 120], [-170, 170]])
    np.testing.assert_allclose(arm.limits[3], [-200, 300])
    np.testing.assert_allclose(arm.gravity_direction, [0, 0, -1])


def test_ends_are_named_after_the_file(written):
    path = written(MODEL)
    base, hand = ta.load_arm(f"{path}:base:hand"), ta.load_arm(f"{path}::hand")
    q = np.zeros((1, 5))
    assert np.linalg.norm(base.chain.tip_in_base(q) - hand.chain.tip_in_base(q)) > 100
    there = ta.load_arm(path).chain.tip_in_base(q) - hand.chain.tip_in_base(q)
    assert np.linalg.norm(there) == pytest.approx(np.hypot(10, 50))
    refuses("there is no link 'nowhere'", ta.load_arm, f"{path}::nowhere")


def test_a_robot_that_floats_stands_and_fingers_are_no_part_of_the_arm(written):
    finger = '<body name="{0}_finger"><joint name="{0}_finger_joint" type="slide"/></body>'
    hand = f'<body name="hand" pos="0 0 1">{finger.format("left")}{finger.format("right")}</body>'
    arm = f'<body name="a" pos="0 0 1"><joint name="q1"/><body pos="1 0 0"><joint/>{hand}</body></body>'
    path = written(f'<mujoco><worldbody><body name="cart"><freejoint/>{arm}</body></worldbody></mujoco>')
    found = ta.load_arm(path)
    assert found.joint_names == ("q1", "joint")
    np.testing.assert_allclose(found.chain.tip_in_base(np.zeros((1, 2))), [[1000, 0, 2000]], atol=1e-9)
    assert "hand" in found.remarks[0]


def test_files_of_what_is_seen_change_no_pose(written):
    included = '<asset><include file="meshes.xml"/></asset><visual><include file="v.xml"/></visual>'
    joints = '<body pos="1 0 0"><joint class="main"/></body>'
    arm = ta.load_arm(written(f"<mujoco>{included}<worldbody>{joints}</worldbody></mujoco>"))
    np.testing.assert_allclose(arm.chain.tip_in_base(np.zeros((1, 1))), [[1000, 0, 0]], rtol=0, atol=1e-9)  # mm


def test_several_joints_of_one_body_turn_one_after_the_other(written):
    joints = '<joint name="a" axis="0 0 1"/><joint name="b" axis="1 0 0" pos="0 0 0.1"/>'
    path = written(f'<mujoco><worldbody><body>{joints}<site name="tip" pos="0 0.5 0"/></body></worldbody></mujoco>')
    tip = ta.load_arm(path).chain.tip_in_base(np.array([[np.pi / 2, np.pi / 2]]))
    # About x through (0, 0, 100): (0, 500, 0) goes to (0, 100, 600); then a quarter turn about z.
    np.testing.assert_allclose(tip, [[-100, 0, 600]], rtol=0, atol=1e-9)


WITH = "<mujoco>{}<worldbody><body {}><joint/></body></worldbody></mujoco>"
BODY = "<mujoco><worldbody><body>{}</body></worldbody></mujoco>"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot name='a'/>", "a model of MuJoCo starts with <mujoco>"),
        ("<mujoco/>", "no <worldbody>"),
        ('<mujoco><include file="/etc/passwd"/></mujoco>', "<include> has bodies .*the file that has the bodies"),
        # It can have the unit of angles, or the axis of all joints.
        (WITH.format('<include file="a.xml"/>', ""), "line 1: <include> has bodies or settings that are not in the fi"),
        (WITH.format('<default><include file="a.xml"/></default>', ""), "<include> has bodies or settings"),
        (BODY.format('<include file="arm.xml"/>'), "<include> has bodies or settings"),
        (BODY.format('<joint class="no"/>'), "line 1: <joint> has the class 'no', which no <default> of the file def"),
        (WITH.format("", 'childclass="no"'), "<body> has the class 'no', which no <default>"),
        (WITH.format('<default class="arm"/>', ""), "expected this <default> with no class but 'main'"),
        (WITH.format("<default><default/></default>", ""), "expected this <default> with a class of its own"),
        (BODY.format('<replicate count="9"/>'), "makes bodies that are not in the file"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "no XML with a DOCTYPE"),
        ("<mujoco><worldbody>", "not valid XML"),
        (BODY.format('<joint axis="0 0 0"/>'), "is no direction"),
        (BODY.format('<joint axis="0 0 nan"/>'), "finite numbers"),
        (BODY.format('<joint type="wheel"/>'), "unknown type"),
        (BODY.format('<joint type="ball"/>'), "no moving joint"),
        (BODY.format('<joint/><body quat="0 0 0 0"/>'), "quat is no orientation"),
        (BODY.format('<joint/><body quat="1 0 0 0" euler="0 0 0"/>'), "has the orientations quat and euler"),
        (BODY.format('<joint/><body pos="1 2"/>'), "3 finite numbers"),
        (BODY.format('<joint name="a"/><body><joint name="a"/></body>'), "2 joints have the name 'a'"),
        ('<mujoco><compiler coordinate="global"/><worldbody/></mujoco>', "no global coordinates"),
        ('<mujoco><compiler eulerseq="abc"/><worldbody/></mujoco>', "expected eulerseq"),
        (BODY.format("<frame/>" * 20_000), "at most 10000 bodies"),
    ],
)
def test_another_file_is_refused(written, text, said):
    path = written(text)
    assert refuses(said, ta.load_arm, path).file == path
