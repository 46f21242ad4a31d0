"""URScript: what is a target and what is not, in every layout; numbers in the style of their neighbours."""

import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from truearm.errors import InputError
from truearm.wings.exports.programs.frames_file import Frame, FramesFile
from truearm.wings.exports.programs.numbers import Number
from truearm.wings.exports.programs.program import Surroundings
from truearm.wings.exports.programs.urscript import URScript, pose_matrix, pose_numbers
from truearm.wings.exports.targets.edits import with_edits

STATED = FramesFile(controller="nominal")
LANGUAGE = URScript()
PROGRAM = """def made():
  set_tcp(p[0.0,0.0,0.1,0.0,0.0,0.0])
  # movej([1,2,3,4,5,6]) and p[9,9,9,9,9,9]
  global Table=p[1,2,3,0,0,0]
  global Point_1_p=p[.433025361705, -.467959205379, .522310714714, 1.500318891221, .521427297251, .530987104689]
  global Point_1_q=[1.99424982, -1.66846146, 1.93305045, -0.27184231, 1.3209004402160645, 0.0036344528198242188]
  force_mode(Table, [0,0,1,0,0,0], [0.0,0.0,10.0,0.0,0.0,0.0], 2, [0.1,0.1,0.15,0.35,0.35,0.35])
  speedl([0.1,0,0,0,0,0], 0.5, 0.1)
  while (True):
    $ 3 "movel(p[1,2,3,4,5,6])"
    movej(get_inverse_kin(Point_1_p, qnear=Point_1_q), a=1.3962634015954636, v=1.0471975511965976)
    movel(p[0.1, 0.2,0.3,0,3.14,0],1.2,.2)
    movec(p[0.1,0.2,0.31,0,3.14,0], pose_to=p[0.1,0.21,0.3,0,3.14,0])
    movep( p[ .1, -2.5e-1, 3E-1, 0, 3.14, +0.5 ] , a = 1.2 )
    movej([0, -1.57, 1.57, 1e-3, 0, 0])
  end
end
"""


def read(text, frames=STATED):
    data = text.encode("latin-1")
    assert LANGUAGE.recognises(data)
    return LANGUAGE.read(data, Surroundings(frames=frames))


def reasons(program):
    return {one.line: one.reason for one in program.left}


LAYOUTS = {
    "as PolyScope writes it": lambda text: text,
    "line ends of Windows": lambda text: text.replace("\n", "\r\n"),
    "mixed line ends": lambda text: text.replace("\n", "\r\n", 6),
    "no end of the last line": lambda text: text.rstrip("\n"),
    "tabs": lambda text: text.replace("  ", "\t"),
    "eight-bit comments": lambda text: text.replace("# movej", "# Gr\xfc\xdfe \xff p[1,1,1,1,1,1] movej"),
    "blanks everywhere": lambda text: re.sub(r",\s*", " ,  ", text).replace("p[", "p[ "),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_literal_that_a_move_goes_to_is_found_and_nothing_else(layout):
    program = read(LAYOUTS[layout](PROGRAM))
    assert [len(target.numbers) for target in program.targets] == [12, 6, 6, 6, 6, 6]
    assert program.targets[0].name == "Point_1_p"
    assert not program.left
    assert [move.kind for move in program.moves] == ["joint", "linear", "circular", "circular", "linear", "joint"]
    for target in program.targets:
        for number in target.numbers.values():
            assert program.data[number.start : number.end] == number.text
    assert program.notes == (
        "4 poses have no joints of their own: those before them in the text state their configuration",
    )


def test_a_pair_has_its_pose_its_tool_and_its_joints():
    target = read(PROGRAM).targets[0]
    np.testing.assert_allclose(target.pose[:3, 3], [433.025361705, -467.959205379, 522.310714714])
    np.testing.assert_allclose(target.T_flange_tool[:3, 3], [0, 0, 100])
    np.testing.assert_allclose(target.near[:2], [1.99424982, -1.66846146])


def test_without_a_statement_of_the_kinematics_nothing_is_changed():
    program = read(PROGRAM, FramesFile())
    assert not program.targets
    assert len(program.left) == 6
    assert all("state in --frames controller" in one.reason for one in program.left)


LEFT = {
    "pose_trans": ("movel(pose_trans(Q, p[0,0,0.1,0,0,0]))", "computed at run time"),
    "offset": ("movel(pose_add(P, p[0,0,0.1,0,0,0]), a=1)", "computed at run time"),
    "part of it computed": ("movej([0, -1.57, d2r(90), 0, 0, 0])", "computed at run time"),
    "a variable in a list": ("movel(p[x, 0.2, 0.3, 0, 3.1, 0])", "computed at run time"),
    "a parameter": ("movel(where)", "where has no value in the program"),
    "asked of the arm": ("movel(get_actual_tcp_pose())", "computed at run time"),
    "computed variable": ("here = get_actual_tcp_pose()\nmovel(here)", "here is computed in line 3"),
    "changed element": ("P[2] = P[2] + 0.1\nmovel(P)", "P is computed in line 3"),
    "place-holder": ("movel(p[0,0,0,0,0,0])", "a place-holder: all its numbers are zero"),
}


@pytest.mark.parametrize("case", LEFT)
def test_places_that_are_not_literal_are_listed(case):
    move, reason = LEFT[case]
    program = read(f"set_tcp(p[0,0,0.1,0,0,0])\nP = p[0.4,0.2,0.3,0,3.1,0]\n{move}\n")
    assert not program.targets
    assert list(reasons(program).values()) == [reason]


def test_a_point_that_others_are_computed_from_is_said_to_be_one():
    text = "set_tcp(p[0,0,0.1,0,0,0])\nmovej([0,1,1,0,1,0])\nP = p[0.4,0.2,0.3,0,3.1,0]\nmovel(P)\n"
    text += "movel(pose_add(P, p[0,0,1,0,0,0]))\n"
    program = read(text)
    assert len(program.targets) == 2
    assert "P is used in a computation in line 5: the result has the correction of P" in program.notes


def test_moves_to_other_places_stand_between_those_to_targets():
    program = read("movej([0,1,1,0,1,0])\nmovel(get_actual_tcp_pose())\nmovej([0,1,1,0,1,1])\n")
    assert [move.target for move in program.moves] == [0, None, 1]


def test_literals_that_are_assigned_one_after_the_other_are_all_targets():
    text = "set_tcp(p[0,0,0.1,0,0,0])\nq=[0,1,1,0,1,0]\nmovej(q)\nq=[0,1,1,0,1,1]\nmovej(q)\n"
    assert len(read(text).targets) == 2


def test_poses_without_a_tool_or_with_several_stay():
    pose = "movej([0,1,1,0,1,0])\nmovel(p[0.4,0.2,0.3,0,3.1,0])\n"
    assert reasons(read(pose)) == {2: "state its tool in --frames: the program has no set_tcp"}
    stated = FramesFile(controller="nominal", tool="gripper", tools={"gripper": Frame(xyz_mm=(0, 0, 50))})
    assert len(read(pose, stated).targets) == 2
    two = "set_tcp(p[0,0,0.1,0,0,0])\n" + pose + "set_tcp(p[0,0,0.2,0,0,0])\n"
    assert reasons(read(two)) == {3: "set_tcp changes between 2 tools"}


def test_a_pose_before_any_joints_states_no_configuration():
    (target,) = read("set_tcp(p[0,0,0.1,0,0,0])\nmovel(p[0.4,0.2,0.3,0,3.1,0])\n").targets
    assert target.near is None


def test_joints_that_two_poses_start_from_are_no_pair():
    text = "set_tcp(p[0,0,0.1,0,0,0])\nq = [0,-1,1,0,1,0]\n"
    text += (
        "movej(get_inverse_kin(p[0.4,0.2,0.3,0,3.1,0], q))\nmovej(get_inverse_kin(p[0.4,0.3,0.3,0,3.1,0], qnear=q))\n"
    )
    program = read(text)
    assert [len(target.numbers) for target in program.targets] == [6, 6]
    assert all(target.near is not None for target in program.targets)


def test_joints_that_are_a_target_themselves_are_no_pair():
    text = "set_tcp(p[0,0,0.1,0,0,0])\nq = [0,-1,1,0,1,0]\nmovej(q)\n"
    program = read(text + "movej(get_inverse_kin(p[0.4,0.2,0.3,0,3.1,0], q))\n")
    assert [len(target.numbers) for target in program.targets] == [6, 6]


def test_a_pose_with_two_start_joints_stays():
    text = "set_tcp(p[0,0,0.1,0,0,0])\nP = p[0.4,0.2,0.3,0,3.1,0]\n"
    text += "movej(get_inverse_kin(P, [0,-1,1,0,1,0]))\nmovej(get_inverse_kin(P, [0,-1,1,0,1,1]))\n"
    assert reasons(read(text)) == {2: "it is used with several start joints"}


@pytest.mark.parametrize("end", ["movel(p[0.1, 0.2", "movej(get_inverse_kin(Point_1_p, qnear", "  while (True):"])
def test_a_truncated_program_is_refused(end):
    with pytest.raises(InputError, match="truncated"):
        read(PROGRAM[: PROGRAM.index(end) + len(end)])


def test_a_program_that_sends_scripts_is_none():
    assert not LANGUAGE.recognises(b"import socket\ns.send(b'movej([0,0,0,0,0,0])')\n")
    assert not LANGUAGE.recognises(b"<p>\nmovej([0,0,0,0,0,0])\n</p>\n")


def test_a_program_that_compares_numbers_is_one():
    assert LANGUAGE.recognises(b"def a():\n  while i<n:\n    movej([0,0,0,0,0,0])\n  end\nend\n")


numbers = st.lists(st.floats(-3, 3), min_size=6, max_size=6)


@given(numbers, numbers)
@example([0, 0, 0, np.pi, 0, 0], [0, 0, 0, -np.pi, 0, 0])
def test_of_all_rotation_vectors_of_a_turn_the_one_near_the_old_is_taken(new, old):
    found = np.array(pose_numbers(pose_matrix(new), old))
    np.testing.assert_allclose(pose_matrix(found), pose_matrix(new), atol=1e-9)
    turn = np.array(new[3:])
    if 0.1 < np.linalg.norm(turn) < np.pi - 0.1:
        again = np.array(pose_numbers(pose_matrix(new), new))
        np.testing.assert_allclose(again, new, atol=1e-9)


@given(st.sampled_from([b".5", b"-.25", b"0.5", b"12", b"-0.1", b"+.5", b"1e-3"]), st.floats(-3, 3), st.integers(3, 12))
def test_numbers_have_the_zero_before_the_point_that_they_had(old, new, decimals):
    text = LANGUAGE.number_text(Number(0, len(old), old), new, decimals)
    assert abs(float(text) - new) <= 0.51 * 10.0**-decimals
    if abs(float(text)) < 1:
        assert text.lstrip(b"-").startswith(b".") == old.lstrip(b"+-").startswith(b".")


def test_a_variable_of_another_function_is_no_target():
    move = "  set_tcp(p[0,0,0.1,0,0,0])\n  if (True):\n    movel(a)\n  end\n"
    other = "def b():\n  a = p[0,0,0.1,0,0,0]\n  x = pose_trans(get_actual_tcp_pose(), a)\n  movel(x)\nend\n"
    text = f"def c():\n  a = p[0.4,0.2,0.3,0,3.14,0]\n{move}end\n{other}"
    assert [target.line for target in read(text).targets] == [2]
    within = f"def c():\n  a = p[0.4,0.2,0.3,0,3.14,0]\n  def d():\n    a = p[0.4,0.2,0.4,0,3.14,0]\n  end\n{move}end\n"
    assert [target.line for target in read(within).targets] == [2, 4]
    everywhere = (
        f"def c():\n  global a = p[0.4,0.2,0.3,0,3.14,0]\n{move}end\ndef d():\n  a = p[0.4,0.2,0.4,0,3.14,0]\nend\n"
    )
    assert [target.line for target in read(everywhere).targets] == [2, 9]


def test_moves_that_keep_to_the_limits_are_moves():
    text = (
        "def c():\n  set_tcp(p[0,0,0.1,0,0,0])\n  optimovel(p[0.4,0.2,0.3,0,3.14,0])\n  optimovej([0,0,0,0,1,0])\nend\n"
    )
    assert [target.name for target in read(text).targets] == ["optimovel in line 3", "optimovej in line 4"]


def test_a_mark_of_utf8_stays_first():
    program = read("def c():\n  movej([0,0,0,0,1,0])\nend\n")
    marked = b"\xef\xbb\xbf" + program.data
    edit = LANGUAGE.mark(LANGUAGE.read(marked, Surroundings(frames=STATED)), "truearm")
    assert with_edits(marked, [edit]).startswith(b"\xef\xbb\xbf# truearm\ndef")


def test_an_inverse_of_another_tool_is_computed():
    text = "def c():\n  set_tcp(p[0,0,0.1,0,0,0])\n  a = p[0.4,0.2,0.3,0,3.14,0]\n  q = [0,0,0,0,1,0]\n"
    for more, n in (("", 1), (", tcp=p[0,0,0,0,0,0]", 0), (", 1e-3, 1e-3, p[0,0,0,0,0,0]", 0)):
        program = read(f"{text}  movej(get_inverse_kin(a, q{more}))\nend\n")
        assert len(program.targets) == n
        assert len(program.left) == 1 - n


def test_points_that_variables_are_computed_from_are_named():
    text = (
        "def c():\n  set_tcp(p[0,0,0.1,0,0,0])\n  a = p[0.4,0.2,0.3,0,3.14,0]\n  b = pose_trans(a, p[0,0,0.1,0,0,0])\n"
    )
    program = read(f"{text}  movej([0,0,0,0,1,0])\n  movel(a)\n  movel(b)\nend\n")
    assert any("a is used in a computation in line 4" in note for note in program.notes)
