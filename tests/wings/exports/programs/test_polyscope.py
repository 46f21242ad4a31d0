"""Programs of PolyScope: waypoints and the kinematics that their controller uses."""

import gzip
import re

import numpy as np
import pytest
from made_up_listings import (
    TOOL,
    WORK,
    calibrated,
    joints_of,
    kinematics_node,
    old_waypoint,
    polyscope_program,
    pose_numbers,
    waypoint,
)

from truearm.errors import InputError
from truearm.wings.exports.programs.controllers import MAX_DEPTH, parse_nodes
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.polyscope import PolyScope
from truearm.wings.exports.programs.program import Surroundings
from truearm.wings.exports.programs.urscript import URScript

LANGUAGE = PolyScope()
Q = joints_of("ur10", 3)


def read(text, frames=None):
    data = text.encode("utf-8")
    assert LANGUAGE.recognises(data)
    return LANGUAGE.read(data, Surroundings(frames=frames or FramesFile()))


def reasons(program):
    return {one.name: one.reason for one in program.left}


def test_the_controller_has_the_kinematics_of_the_waypoints():
    program = read(polyscope_program([waypoint("W_1", Q[0])]))
    expected, found = calibrated().pose(Q), program.controller.pose(Q)
    # The table has lengths of 700 m, of which 17 digits leave 1e-10 mm.
    np.testing.assert_allclose(found.tip_in_base, expected.tip_in_base, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.R_base_tip, expected.R_base_tip, rtol=0, atol=1e-12)
    assert program.controller.reach < 3000.0


LAYOUTS = {
    "as PolyScope writes it": lambda text: text,
    "line ends of Unix": lambda text: text.replace("\r\n", "\n"),
    "apostrophes": lambda text: text.replace('"', "'"),
    "no head": lambda text: text.partition("\r\n")[2],
    "names of the East": lambda text: text.replace("W_1", "\u8def\u70b9_1 &lt;a&gt;"),
    "comments": lambda text: text.replace("<position>", "<!-- <Waypoint type='Fixed'> --><position>"),
    "text in between": lambda text: text.replace("<position>", "<![CDATA[<Waypoint>]]>text<position>"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("motion", ["MoveJ", "MoveL"])
def test_fixed_waypoints_are_found_in_every_layout(layout, motion):
    text = polyscope_program([waypoint("W_1", Q[0]), waypoint("W_2", Q[1])], motion)
    program = read(LAYOUTS[layout](text))
    assert len(program.targets) == 2
    assert not program.left
    assert {move.kind for move in program.moves} == {"joint" if motion == "MoveJ" else "linear"}
    for target, q in zip(program.targets, Q, strict=False):
        np.testing.assert_array_equal(target.joints, q)
        np.testing.assert_allclose(target.T_flange_tool, TOOL, atol=1e-12)
        for number in target.numbers.values():
            assert program.data[number.start : number.end] == number.text


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        ('<Waypoint type="Variable" name="W_1"><variable name="v"/></Waypoint>', "its place is a variable"),
        (waypoint("W_1", Q[0], kind="Relative"), "it is relative to where the arm is"),
        (f"<SuppressedNode>{waypoint('W_1', Q[0])}</SuppressedNode>", "it is suppressed"),
        ('<Waypoint type="Fixed" name="W_1"/>', "it has no position"),
        (waypoint("W_1", [1.0, 2.0]), "its joints or its tool are not six numbers each"),
    ],
)
def test_other_waypoints_stay_with_a_reason(made, reason):
    program = read(polyscope_program([made, waypoint("W_2", Q[1])]))
    assert [target.name for target in program.targets] == ["W_2"]
    assert reasons(program) == {"W_1": reason}


def test_a_waypoint_of_another_robot_stays():
    other = kinematics_node().replace("LINEARIZED", "CALIBRATED").replace('<a value="-0', '<a value="0')
    program = read(polyscope_program([waypoint(f"W_{i}", q) for i, q in enumerate(Q)] + [waypoint("X", Q[0], other)]))
    assert len(program.targets) == 3
    assert "other kinematics than most waypoints" in reasons(program)["X"]


@pytest.mark.parametrize("status", ["NOT_INITIALIZED", "NOT_LINEARIZED"])
def test_without_a_factory_calibration_the_kinematics_must_be_stated(status):
    text = polyscope_program([waypoint("W_1", Q[0], kinematics_node(status))])
    assert "state in --frames controller" in reasons(read(text))["W_1"]
    program = read(text, FramesFile(controller="nominal"))
    assert len(program.targets) == 1
    assert program.controller is None


def test_nodes_that_refer_to_earlier_ones_are_followed():
    second = waypoint("W_2", Q[1]).replace(
        kinematics_node(), '<Kinematics reference="../../../Waypoint/position/Kinematics"/>'
    )
    third = (
        '<Waypoint type="Fixed" name="W_3"><position>'
        '<JointAngles reference="../../../Waypoint[2]/position/JointAngles"/>'
        '<TCPOffset reference="../../../Waypoint[2]/position/TCPOffset"/>'
        '<Kinematics reference="../../../Waypoint[1]/position/Kinematics"/></position></Waypoint>'
    )
    program = read(polyscope_program([waypoint("W_1", Q[0]), second, third]))
    assert [target.name for target in program.targets] == ["W_1", "W_2"]
    assert [move.target for move in program.moves] == [0, 1, 1]
    assert not program.left


SHARED = '<JointAngles reference="../../../Waypoint/position/JointAngles"/>'


@pytest.mark.parametrize(
    ("second", "others"),
    [
        (waypoint("W_2", Q[1]).replace('<TCPOffset pose="0.', '<TCPOffset pose="0.1'), {}),
        (waypoint("W_2", Q[1], kinematics_node().replace('<a value="-0', '<a value="0')), {"W_2": "other kinematics"}),
        (waypoint("W_2", Q[1], kind="Relative"), {"W_2": "relative"}),
    ],
)
def test_joints_that_waypoints_of_two_corrections_share_stay(second, others):
    second = re.sub("<JointAngles[^>]*>", SHARED, second)
    program = read(polyscope_program([waypoint("W_1", Q[0]), second, waypoint("W_3", Q[2])]))
    assert [target.name for target in program.targets] == ["W_3"]
    found = reasons(program)
    assert found["W_1"] == "it shares joints with W_2, which has another tool or is not changed"
    for name, reason in ({"W_2": "shares joints with W_1"} | others).items():
        assert reason in found[name]


def test_a_pose_that_waypoints_of_polyscope_3_share_with_other_joints_stays():
    kinematics, first = kinematics_node(tag="kinematics"), old_waypoint("W_1", Q[0], WORK)
    second = old_waypoint("W_2", Q[0], np.eye(4)).replace("/></Waypoint>", " /></Waypoint>")
    second = re.sub(
        "<outputFlangePose[^>]*>", '<outputFlangePose reference="../../Waypoint/outputFlangePose"/>', second
    )
    program = read(polyscope_program([first, second], kinematics=kinematics))
    assert not program.targets
    assert len(program.left) == 2


def test_a_node_that_refers_to_itself_or_onwards_is_no_place():
    text = polyscope_program(
        [
            '<Waypoint type="Fixed" name="W_1"><position reference="../../Waypoint[2]/position"/></Waypoint>',
            waypoint("W_2", Q[1]),
        ]
    )
    assert reasons(read(text)) == {"W_1": "it has no position"}


def test_waypoints_in_a_feature_are_said_to_move_with_it():
    program = read(polyscope_program([waypoint("W_1", Q[0], feature=[float(one) for one in pose_numbers(WORK)])]))
    assert program.notes == ("1 waypoints move with a feature if that is taught again",)


def test_joints_and_poses_of_polyscope_3_that_disagree_stay():
    kinematics = kinematics_node(tag="kinematics")
    good, bad = old_waypoint("W_1", Q[0], WORK), old_waypoint("W_2", Q[1], WORK)
    bad = bad.replace(repr(float(Q[1][0])), repr(float(Q[1][0]) + 1e-3))
    program = read(polyscope_program([good, bad], kinematics=kinematics))
    assert [target.name for target in program.targets] == ["W_1"]
    assert len(program.targets[0].numbers) == 24
    assert "its joints and its pose disagree by" in reasons(program)["W_2"]


def test_a_gzip_is_recognised_and_one_that_is_cut_off_is_refused():
    text = polyscope_program([waypoint("W_1", Q[0])]).encode()
    packed = gzip.compress(text)
    assert LANGUAGE.recognises(packed)
    assert LANGUAGE.unpacked(packed) == text
    with pytest.raises(InputError, match="truncated"):
        LANGUAGE.unpacked(packed[: len(packed) // 2])
    with pytest.raises(InputError, match="damaged"):
        LANGUAGE.unpacked(packed[:40] + bytes(20) + packed[60:])
    assert LANGUAGE.packed(text, packed) == LANGUAGE.packed(text, packed)  # no date in it
    assert LANGUAGE.packed(text, text) == text


def test_a_text_that_is_cut_off_is_refused():
    text = polyscope_program([waypoint("W_1", Q[0])])
    with pytest.raises(InputError, match="truncated"):
        read(text[: text.index("</Move>")])
    with pytest.raises(InputError, match="ends no open element"):
        parse_nodes(b"<a></b>")


def test_a_script_under_the_name_of_a_program_is_a_script():
    data = b"def a():\n  movej([0,0,0,0,0,0])\nend\n"
    assert not LANGUAGE.recognises(data)
    assert URScript().recognises(data)


def test_references_that_refer_to_references_find_the_first():
    n = 5000  # more than Python's stack has room for
    chained = "".join(f'<a reference="../a[{i}]"/>' for i in range(1, n))
    root = parse_nodes(
        f'<r><a x="1"/>{chained}<b reference="../a[{n}]"/><c reference="../d"/><d/></r>'.encode()
    ).children[0]
    assert {node.resolved() for node in reversed(root.children[:-2])} == {root.children[0]}
    assert root.child("b") is root.children[0]
    assert root.child("c") is None  # a later one
    assert root.child("e") is None


def test_elements_are_nested_as_deep_as_programs_are():
    deep = "<a>" * (MAX_DEPTH - 1) + "<b/>" + "</a>" * (MAX_DEPTH - 1)
    innermost = list(parse_nodes(f"<r>{deep}</r>".encode()).walk())[-1]
    assert innermost.tag == "b"
    assert innermost.inside("r")
    assert not innermost.inside("b")
    with pytest.raises(InputError, match=f"line 2: expected at most {MAX_DEPTH} levels"):
        parse_nodes(f"<r>\n<a>{deep}</a></r>".encode())


@pytest.mark.parametrize("opening", ["<!--", "<![CDATA[", "<?x"])
def test_what_does_not_end_is_looked_at_once(opening):
    with pytest.raises(InputError, match="does not end"):
        parse_nodes(b"<r>" + opening.encode() * 100_000)
