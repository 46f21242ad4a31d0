"""Base and tip of a URDF: found where the file shows them, said where others were possible, asked for of two arms."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import Chain, load_arm
from truearm.arm.urdf import read_urdf
from truearm.errors import InputError


def robot(*joints: str) -> str:
    """A robot of joints "KIND NAME PARENT CHILD" and what they hold; links in the order of their names there."""
    links, parts = {}, []
    for joint in joints:
        kind, name, parent, child, *more = joint.split(maxsplit=4)
        links |= {parent: 1, child: 1}
        ends = f"<parent link='{parent}'/><child link='{child}'/>"
        parts.append(f"<joint name='{name}' type='{kind}'>{ends}{''.join(more)}</joint>")
    return f"<robot name='r'>{''.join(f'<link name={link!r}/>' for link in links)}{''.join(parts)}</robot>"


def chain(n: int, prefix: str = "", root: str = "base_link") -> list[str]:
    links = [root, *(f"{prefix}link_{i}" for i in range(1, n + 1))]
    return [f"continuous {prefix}j{i + 1} {links[i]} {links[i + 1]}" for i in range(n)]


def read(folder, *joints):
    path = folder / "robot.urdf"
    path.write_text(robot(*joints))
    return load_arm(path)


def tip_of(arm):
    return arm.remarks[0].partition("tip: ")[2].partition(",")[0].partition(";")[0]


# As ROS-Industrial lays its files out: base beside base_link, flange and tool0 in a row.
INDUSTRIAL = [*chain(6), "fixed b base_link base", "fixed f link_6 flange", "fixed t flange tool0"]


def test_a_file_of_ros_industrial_needs_no_names_and_no_word(tmp_path):
    arm = read(tmp_path, *INDUSTRIAL)
    assert arm.n_joints == 6
    assert arm.remarks == ()


@pytest.mark.parametrize(
    ("more", "tip"),
    [
        (["fixed e link_6 ee_link", "fixed s link_6 ft_frame"], "tool0"),
        (["fixed c flange camera"], "tool0"),
        (
            [
                "fixed g flange gripper_base_link",
                "prismatic l gripper_base_link left",
                "prismatic r gripper_base_link right",
            ],
            "tool0",
        ),
    ],
)
def test_the_usual_names_win(tmp_path, more, tip):
    arm = read(tmp_path, *INDUSTRIAL, *more)
    assert arm.n_joints == 6
    assert tip_of(arm) == tip
    assert arm.remarks[0].endswith("; robot.urdf::LINK takes another.")


def test_a_plan_and_a_virtual_arm_say_which_tip_was_taken(tmp_path):
    arm = read(tmp_path, *chain(3), "fixed e link_3 ee_link", "fixed s link_3 lamp")
    moved = np.tile(np.eye(4), (4, 1, 1))
    moved[1:, :3, 3] = [[0, 0, 300], [400, 0, 0], [300, 0, 0]]
    moved[1, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    long = replace(arm, chain=Chain(moved, np.zeros(3)), lower=np.full(3, -2.0), upper=np.full(3, 2.0))
    (said,) = arm.remarks
    assert said in str(ta.simulate(long, poses=4, strategy="uniform", seed=1))
    assert said in str(ta.plan(long, "tracker", poses=4, terms="constants"))


def test_the_order_of_the_names_is_that_of_the_page(tmp_path):
    names = ["tool0", "my_flange", "arm_ee_link", "left_tcp", "j2s7s300_end_effector", "gripper_base_link", "laser"]
    for first in range(len(names) - 1):
        arm = read(
            tmp_path, *chain(3), *(f"fixed f{i} link_3 {name}" for i, name in reversed(list(enumerate(names[first:]))))
        )
        assert tip_of(arm) == names[first]


def test_without_a_usual_name_the_last_link_that_moves_is_the_tip(tmp_path):
    arm = read(tmp_path, *chain(3), "fixed a link_3 lamp", "fixed b link_3 camera")
    assert arm.remarks == ("tip: link_3, of link_3, lamp, camera; robot.urdf::LINK takes another.",)


MIMIC = "<mimic joint='{}'/>"
GRIPPERS = {
    "two sliding fingers": ["prismatic a hand left", "prismatic b hand right"],
    "one follows the other": ["revolute a hand left", f"revolute b hand right {MIMIC.format('a')}"],
    "one jaw": ["revolute gripper hand moving_part"],
    "fingers of two joints": [
        *("revolute finger_1 hand f1", "revolute finger_tip_1 f1 t1"),
        *("revolute finger_2 hand f2", "revolute finger_tip_2 f2 t2"),
    ],
    "a hand": [link.replace("base_link", "hand") for side in "abcd" for link in chain(3, side)],
}  # fmt: skip


@pytest.mark.parametrize("kind", GRIPPERS)
def test_fingers_are_no_part_of_the_arm(tmp_path, kind):
    arm = read(tmp_path, *chain(5), "fixed h link_5 hand", *GRIPPERS[kind])
    assert arm.joint_names == ("j1", "j2", "j3", "j4", "j5")
    assert tip_of(arm) == "hand"
    assert "fingers" in arm.remarks[0]
    with pytest.raises(InputError, match="no moving joint but the fingers|arms could be meant"):
        read(tmp_path, "fixed h base_link hand", *GRIPPERS[kind])


def test_wheels_a_head_and_a_lift_do_not_hide_the_arm(tmp_path):
    arm = read(
        tmp_path,
        "floating world_joint world base_link",
        "continuous wheel_l base_link wheel_l",
        "continuous wheel_r base_link wheel_r",
        "prismatic lift base_link torso",
        "revolute pan torso neck",
        "revolute tilt neck head",
        *chain(7, root="torso"),
        "fixed g link_7 gripper_link",
    )
    assert arm.joint_names == ("lift", *(f"j{i}" for i in range(1, 8)))
    assert arm.remarks == ("tip: gripper_link, of the longest chain; robot.urdf::LINK takes another.",)


def test_of_two_arms_one_must_be_named(tmp_path):
    parts = ["revolute waist base_link torso", *chain(7, "left_", "torso"), *chain(7, "right_", "torso")]
    refuses(r"2 arms .* tips left_link_7, right_link_7.* FILE\.urdf::left_link_7", read, tmp_path, *parts)
    assert read_urdf(tmp_path / "robot.urdf", tip="right_link_7").joint_names[1] == "right_j1"
    assert read_urdf(tmp_path / "robot.urdf", base="left_link_1").n_joints == 6


def test_limits_of_zero_are_none(tmp_path):
    none = "<limit lower='0' upper='0' effort='0' velocity='0'/>"
    arm = read(tmp_path, f"revolute a base_link l1 {none}", f"prismatic b l1 l2 {none}")
    assert np.isinf(arm.limits).all()


def test_a_file_named_xacro_has_the_way_to_a_urdf(tmp_path):
    path = tmp_path / "robot.urdf.xacro"
    path.write_text("<robot name='r' xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:macro name='m'/></robot>")
    refuses("xacrodoc FILE.xacro -o robot.urdf", load_arm, path)
    path.write_text(robot(*INDUSTRIAL))
    assert load_arm(path).n_joints == 6
