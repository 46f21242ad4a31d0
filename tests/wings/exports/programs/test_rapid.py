"""RAPID modules in odd layouts: every literal target is found, nothing else, and what is not changed has a reason."""

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.wings.exports.programs.correct_program import language_of
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.program import Surroundings
from truearm.wings.exports.programs.rapid import Rapid
from truearm.wings.exports.targets.edits import with_edits

NONE = "[9E9,9E+09,9E+9,9E9,9E9,9E9]"
POSE = f"[[600,0.50,-7.25],[0,0.707107,0.707107,0],[0,-1,0,1],{NONE}]"
JOINTS = f"[[1,-2,3.5,4,5,6],{NONE}]"
FRAMES = """
[tools.tGrip]
xyz_mm = [0, 0, 120]
[works.wTable]
xyz_mm = [500, 0, 0]
"""
USE = "PROC main()\nMoveL {name},v100,fine,tGrip\\WObj:=wTable;\nENDPROC\n"


def read(text, frames=FRAMES, encoding="latin-1"):
    data = text if isinstance(text, bytes) else text.encode(encoding)
    assert isinstance(language_of(data), Rapid)
    return Rapid().read(data, Surroundings(None, parse_toml(frames.encode(), FramesFile)))


def module(body, end="\n"):
    return f"MODULE Made{end}{body}{end}ENDMODULE{end}"


def found(program):
    return [target.name for target in program.targets]


def reasons(program):
    return {one.name: one.reason for one in program.left}


LAYOUTS = {
    "a pose": (f"CONST robtarget p1:={POSE};\n" + USE.format(name="p1"), ["p1"]),
    "joints": (f"CONST jointtarget j1:={JOINTS};", ["j1"]),
    "lower case, blanks and line breaks": (
        "local pers ROBTARGET p1 :=\n  " + POSE.replace(",", " ,\n\t") + " ;\n" + USE.format(name="P1"),
        ["p1"],
    ),
    "Windows lines": (f"CONST robtarget p1:={POSE};\r\n" + USE.format(name="p1").replace("\n", "\r\n"), ["p1"]),
    "mixed lines and tabs": (f"\tCONST\tjointtarget\tj1\t:=\t{JOINTS};\r\n\n\rVAR num n:=1;", ["j1"]),
    "commented out": (f"! CONST jointtarget j0:={JOINTS};\nCONST jointtarget j1:={JOINTS}; ! {JOINTS}", ["j1"]),
    "in a text": (f'TPWrite "CONST jointtarget j0:={JOINTS}; ""! ";\nCONST jointtarget j1:={JOINTS};', ["j1"]),
    "a comment inside": (f"CONST jointtarget j1:=[[1,-2, ! two\n3.5,4,5,6],{NONE}];", ["j1"]),
    "in a move": (
        f"PROC a()\nMoveL {POSE},v1,fine,tGrip\\WObj:=wTable;\nMoveAbsJ {JOINTS}\\NoEOffs,v1,fine,tool0;\nENDPROC",
        ["MoveL in line 3", "MoveAbsJ in line 4"],
    ),
    "a circle": (
        f"PROC main()\nMoveC {POSE},{POSE},v100,z10,tGrip\\WObj:=wTable;\nENDPROC",
        ["MoveC in line 3", "MoveC in line 3"],
    ),
    "concurrent, with an identifier": (
        f"PROC main()\nMoveL\\Conc,{POSE}\\ID:=10,v100,fine,tGrip\\WObj:=wTable;\nENDPROC",
        ["MoveL in line 3"],
    ),
    "a search": (
        f"PROC main()\nSearchL\\Stop,di1,pFound,{POSE},v10,tGrip\\WObj:=wTable;\nENDPROC",
        ["SearchL in line 3"],
    ),
    "a weld": (f"PROC main()\nArcLStart {POSE},v10,s1,w1,fine,tGrip\\WObj:=wTable;\nENDPROC", ["ArcLStart in line 3"]),
    "an array": (f"CONST jointtarget j{{2}}:=[{JOINTS},{JOINTS}];", ["j{1}", "j{2}"]),
    "an array of two dimensions": (f"CONST jointtarget j{{2,1}}:=[[{JOINTS}],[{JOINTS}]];", ["j{1}{1}", "j{2}{1}"]),
    "a record": (
        (
            "RECORD station\nnum n;\njointtarget at;\nstring text;\nENDRECORD\n"
            f'CONST station s1:=[1,{JOINTS},"here"];\nCONST station s2{{2}}:=[[1,{JOINTS},""],[2,{JOINTS},""]];'
        ),
        ["s1.2", "s2{1}.2", "s2{2}.2"],
    ),
    "an assignment": (f"VAR jointtarget j1;\nPROC main()\nj1:={JOINTS};\nENDPROC", ["j1"]),
    "signs and powers of ten": (f"CONST jointtarget j1:=[[+1,- 2,3.09E-08,-4.e0,.5,0006],{NONE}];", ["j1"]),
    "no last line end": (f"CONST jointtarget j1:={JOINTS};", ["j1"]),
    "German comments": (f"! Störung löschen\nCONST jointtarget jÜber:={JOINTS};", ["jÜber"]),
    "tools and frames are no targets": (
        (
            "PERS tooldata t1:=[TRUE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
            "CONST pose q1:=[[1,2,3],[1,0,0,0]];\nPERS loaddata l1:=[1,[0,0,1],[1,0,0,0],0,0,0];"
        ),
        [],
    ),
}


@pytest.mark.parametrize("what", LAYOUTS)
def test_every_literal_target_is_found_and_nothing_else(what):
    body, names = LAYOUTS[what]
    text = module(body)
    program = read(text.removesuffix("\n") if "no last" in what else text)
    assert found(program) == names
    # Every number's bytes are those of the program.
    for target in program.targets:
        for number in target.numbers.values():
            assert program.data[number.start : number.end] == number.text
        assert list(target.numbers) == (
            ["j1", "j2", "j3", "j4", "j5", "j6"]
            if target.joints is not None
            else ["x", "y", "z", "q1", "q2", "q3", "q4", "cf1", "cf4", "cf6", "cfx"]
        )
    assert with_edits(program.data, []) == program.data


LEFT = {
    "computed": ("VAR robtarget p1;\nPROC main()\np1:=Offs(p0,1,2,3);\nENDPROC", "p1 :=", "computes it"),
    "a component": ("VAR robtarget p1;\nPROC main()\np1.trans.x:=5;\nENDPROC", "p1.trans.x :=", "computes it"),
    "not literal": (f"CONST jointtarget j1:=[[a,2,3,4,5,6],{NONE}];", "j1", "not literal"),
    "a sum": (f"CONST jointtarget j1:=[[1+1,2,3,4,5,6],{NONE}];", "j1", "not literal"),
    "a placeholder": ("CONST jointtarget j1:=[[9E9,9E9,9E9,9E9,9E9,9E9],[0,0,0,0,0,0]];", "j1", "placeholder"),
    "not taught": (f"CONST robtarget p1:=[[1,2,3],[0,0,0,0],[0,0,0,0],{NONE}];", "p1", "quaternion is zero"),
    "not a unit": (f"CONST robtarget p1:=[[1,2,3],[1,1,0,0],[0,0,0,0],{NONE}];", "p1", "length 1.41"),
    "seven axes": (
        f"CONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,11],{NONE}];\n" + USE.format(name="p1"),
        "p1",
        "none of a six-axis arm",
    ),
    "from another": (
        f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL Offs(p1,0,0,9),v1,fine,tGrip;\nENDPROC",
        "MoveL Offs(p1,0,0,9)",
        "from p1",
    ),
    "another module": ("PROC main()\nMoveL pFar,v1,fine,tGrip;\nENDPROC", "MoveL pFar", "another module"),
    "unknown tool": (
        f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL p1,v1,fine,tNew\\WObj:=wTable;\nENDPROC",
        "p1",
        "the tool tNew is not in this module: state it in --frames",
    ),
    "unknown work object": (
        f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL p1,v1,fine,tGrip\\WObj:=wNew;\nENDPROC",
        "p1",
        "the work object wNew is not in this module: state it in --frames",
    ),
    "never used": (f"CONST robtarget p1:={POSE};", "p1", "no move of this module uses it"),
    "two tools": (
        f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL p1,v1,fine,tGrip;\nMoveL p1,v1,fine,tool0;\nENDPROC",
        "p1",
        "two corrections",
    ),
    "a stationary tool": (
        (
            "PERS tooldata tFix:=[FALSE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
            f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL p1,v1,fine,tFix\\WObj:=wTable;\nENDPROC"
        ),
        "p1",
        "stationary",
    ),
    "a positioner": (
        (
            'PERS wobjdata wTurn:=[FALSE,FALSE,"STN1",[[0,0,1],[1,0,0,0]],[[0,0,1],[1,0,0,0]]];\n'
            f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL p1,v1,fine,tGrip\\WObj:=wTurn;\nENDPROC"
        ),
        "p1",
        "moves with the unit STN1, and has a user frame of its own",
    ),
    "a part that the robot holds": (
        (
            'PERS wobjdata wHeld:=[TRUE,TRUE,"",[[0,0,1],[1,0,0,0]],[[0,0,1],[1,0,0,0]]];\n'
            f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL p1,v1,fine,tGrip\\WObj:=wHeld;\nENDPROC"
        ),
        "p1",
        "held by the robot",
    ),
    "a hidden target": ("PROC main()\nMoveL *,v1,fine,tGrip;\nENDPROC", "MoveL *", "hidden"),
    "an unfinished move": ("PROC main()\nMoveL;\nENDPROC", "MoveL", "no target yet"),
    "an unknown type": (f"CONST station s1:=[1,{JOINTS}];\nCONST jointtarget j1:={JOINTS};", "s1", "station is not"),
}


@pytest.mark.parametrize("what", LEFT)
def test_what_is_not_changed_has_a_reason(what):
    body, name, reason = LEFT[what]
    program = read(module(body))
    assert name.removesuffix(" :=") in [one.removesuffix(" :=").removesuffix(":=") for one in reasons(program)]
    assert any(reason in one for one in reasons(program).values())


def test_tool_and_work_object_are_those_of_the_module():
    text = (
        "PERS tooldata t1:=[TRUE,[[1,2,3],[0,1,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        'PERS wobjdata w1:=[FALSE,TRUE,"",[[10,0,0],[0.707106781,0,0,0.707106781]],[[5,0,0],[1,0,0,0]]];\n'
        f"CONST robtarget p1:={POSE};\nPROC main()\nMoveJ p1,v1,fine,t1\\WObj:=w1;\nENDPROC"
    )
    (target,) = read(module(text), "[base]\nxyz_mm = [0, 0, 100]\n").targets
    np.testing.assert_allclose(target.T_flange_tool[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(target.T_flange_tool[:3, :3], np.diag([1, -1, -1]))
    # The object frame is turned with the user frame: 5 mm along its x axis are along y of the world.
    np.testing.assert_allclose(target.T_base_work[:3, 3], [10, 5, -100], atol=1e-6)


def test_moves_name_their_targets_in_the_order_of_the_text():
    body = f"CONST robtarget p1:={POSE};\nPROC main()\nMoveJ p1,v1,fine,tGrip\\WObj:=wTable;\n"
    program = read(module(body + "MoveL P1,v1,fine,tGrip\\WObj:=wTable;\nMoveL Offs(p1,1,2,3),v1,fine,tGrip;\nENDPROC"))
    assert [(move.kind, move.target) for move in program.moves] == [("joint", 0), ("linear", 0), ("linear", None)]


def test_shifts_at_run_time_are_noted():
    program = read(module("PROC main()\nPDispOn\\Rot,p1,tGrip;\nENDPROC"))
    assert "PDispOn in line 3 shifts targets" in program.notes[0]


def test_where_an_external_axis_moves_poses_are_left_until_it_is_stated():
    rows = [POSE.replace(NONE, f"[{one},9E9,9E9,9E9,9E9,9E9]") for one in (0, 250)]
    still, moving = (
        module("".join(f"CONST robtarget p{k}:={row};\n{USE.format(name=f'p{k}')}\n" for k, row in enumerate(some)))
        for some in ([rows[0], rows[0]], rows)
    )
    assert len(read(still).targets) == 2
    assert not read(moving).targets
    assert all("not_carrying = [1]" in reason for reason in reasons(read(moving)).values())
    assert len(read(moving, "not_carrying = [1]\n" + FRAMES).targets) == 2


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (f"MODULE Made\nCONST jointtarget j1:={JOINTS};\n", "no ENDMODULE"),
        (f"MODULE Made\nCONST jointtarget j1:={JOINTS[:20]}\nENDMODULE\n", "not closed|no end"),
        (f"MODULE Made\nCONST jointtarget j1:={JOINTS}\nENDMODULE\n", "has no end"),
        ("MODULE Made\nPROC main()\nMoveL p1,v1\nENDPROC\nENDMODULE\n", "a move has no end"),
        ('MODULE Made\nTPWrite "open;\nENDMODULE\n', "in quotes is not closed"),
        (b"\xfc\x01\x00\x00MODULE\x00", "encoded"),
    ],
)
def test_a_damaged_module_is_refused(text, problem):
    with pytest.raises(InputError, match=problem):
        read(text)


def test_truncated_anywhere_it_is_refused_or_read_in_part():
    text = module(f"CONST robtarget p1:={POSE};\n" + USE.format(name="p1")).encode()
    for end in range(len(b"MODULE Made"), len(text) - len(b"\nENDMODULE\n")):
        with pytest.raises(InputError, match=r"cut off|not closed|no end"):
            Rapid().read(text[:end], Surroundings())


TOOL_120 = "PERS tooldata t1:=[TRUE,[[0,0,120],[1,0,0,0]],[1,[0,0,60],[1,0,0,0],0,0,0]];\n"
MOVE = f"MoveL {POSE},v1,fine,t1\\WObj:=wobj0;\n"


@pytest.mark.parametrize(
    ("other", "is_left"),
    [
        (TOOL_120.replace("PERS", "VAR").replace("120", "220"), True),
        (TOOL_120.replace("PERS", "VAR").replace("120", "120.0"), False),
        ("", False),
    ],
)
def test_a_tool_that_is_declared_twice_is_not_taken_for_the_last(other, is_left):
    body = f"{TOOL_120}PROC a()\n{MOVE}ENDPROC\nPROC b()\n{other}{MOVE}ENDPROC"
    program = read(module(body), "")
    assert len(found(program)) == (0 if is_left else 2)
    assert all("declared in several places" in why for why in reasons(program).values())


def test_the_first_move_of_a_procedure_with_parameters_is_read():
    body = f"{TOOL_120}PROC a(robtarget q, VAR num n{{*}}, PERS num k)\n{MOVE}ENDPROC\nPROC b(VAR num n)\n{MOVE}ENDPROC"
    assert found(read(module(body), "")) == ["MoveL in line 4", "MoveL in line 7"]


def test_dimensions_of_an_array_may_be_names():
    body = f"{TOOL_120}CONST robtarget p{{n,m}}:=[[{POSE},{POSE}]];\nPROC b()\nMoveL p{{1,2}},v1,fine,t1;\nENDPROC"
    assert found(read(module(body), "")) == ["p{1}{1}", "p{1}{2}"]


@pytest.mark.parametrize(
    ("statement", "name"),
    [("t1.tframe.trans.z:=10;", "t1"), ("w1.uframe:=DefFrame(a,b,c);", "w1"), ("SoftAct 1,50;", "SoftAct")],
)
def test_what_changes_frames_while_the_program_runs_is_said(statement, name):
    work = 'PERS wobjdata w1:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];'
    body = f"{TOOL_120}{work}\nPROC b()\n{statement}\nENDPROC"
    assert any(note.startswith(f"{name} ") for note in read(module(body), "").notes)


def test_an_external_axis_away_from_zero_is_said():
    body = TOOL_120 + "PROC a()\n" + MOVE.replace(NONE, NONE.replace("9E9", "1500", 1)) + "ENDPROC"
    assert any("External axis 1 at 1500" in note for note in read(module(body), "").notes)


def test_a_mark_of_utf8_stays_first():
    text = f"\xef\xbb\xbfMODULE Made\r\nCONST jointtarget j1:={JOINTS};\r\nENDMODULE\r\n"
    program = read(text)
    assert found(program) == ["j1"]
    new = with_edits(program.data, [Rapid().mark(program, "truearm")])
    assert new.startswith(b"\xef\xbb\xbfMODULE Made\r\n! truearm\r\n")


def test_a_tool_that_is_too_far_away_is_to_be_stated():
    body = f"{TOOL_120.replace('120', '1E400')}PROC a()\n{MOVE}ENDPROC"
    assert "state it in --frames" in reasons(read(module(body), ""))["MoveL in line 4"]


@pytest.mark.parametrize(
    "word", ["MoveLDO {},v1,fine,t1,do1,1", 'MoveLSync {},v1,fine,t1,"go"', "DispL {},v1,bead,fine,t1"]
)
def test_the_tool_stands_before_signals_and_procedures(word):
    circle = f"MoveCGO {POSE},{POSE},v1,fine,t1\\WObj:=wobj0,go1\\Value:=5;"
    body = f"{TOOL_120}PROC a()\n{word.format(POSE)};\n{circle}\nENDPROC"
    assert [target.T_flange_tool[2, 3] for target in read(module(body), "").targets] == [120, 120, 120]


def test_limits_of_world_zones_are_no_targets():
    home, limit = (f"CONST jointtarget {name}:={JOINTS};\n" for name in ("jHome", "jDelta"))
    body = (
        f"{home}{limit}PROC a()\nWZHomeJointDef \\Inside, zone, jHome, jDelta;\nMoveAbsJ jHome,v1,fine,tool0;\nENDPROC"
    )
    program = read(module(body))
    assert found(program) == ["jHome"]
    assert "world zone (line 5)" in reasons(program)["jDelta"]
    assert not program.notes


def test_joints_that_no_move_goes_to_are_named():
    (note,) = read(module(f"CONST jointtarget j1:={JOINTS};")).notes
    assert note.startswith("No move of this file goes to j1:")


@pytest.mark.parametrize(
    ("declared", "change", "left"),
    [
        (f"VAR robtarget p1:={POSE};", "p1.trans.z:=p1.trans.z+50;", {"p1": "its trans.z is overwritten in line 4"}),
        (f"VAR robtarget p1:={POSE};", "P1.robconf.cf1 := 1;", {"p1": "its robconf.cf1 is overwritten in line 4"}),
        (f"VAR robtarget p1:={POSE};", "p1.extax.eax_a:=1;", {}),
        (
            f"VAR robtarget p1{{2}}:=[{POSE},{POSE}];",
            "p1{2}.rot.q1:=1;",
            {"p1{2}": "its rot.q1 is overwritten in line 4"},
        ),
        (f"VAR robtarget p1{{1}}:=[{POSE}];", "p1{n}.rot.q1:=1;", {"p1{1}": "its rot.q1 is overwritten in line 4"}),
    ],
)
def test_a_point_of_which_a_component_is_overwritten_is_left(declared, change, left):
    program = read(module(f"{declared}\nPROC main()\n{change}\nMoveL p1,v100,fine,tGrip\\WObj:=wTable;\nENDPROC"))
    literal = {one.name: one.reason for one in program.left if one.is_literal}
    assert literal == left
    assert len(program.targets) + len(left) == declared.count("600")


@pytest.mark.parametrize(
    ("value", "reason", "counts"),
    [
        (f"[[0,0,50],[0,0,1],[-1,0,-1,0],{NONE}]", "expected 3 + 4 + 4 + 6 numbers, got 3 + 3 + 4 + 6", True),
        (f"[[0,0,50],[180,0,180],[-1,0,-1,0],{NONE}]", "got 3 + 3 + 4 + 6", True),
        (f"[[100,O,0],[0,0,1,0],[-1,0,-1,0],{NONE}]", "O is no number of this module", True),
        (f"[[100,nX,0],[0,0,1,0],[-1,0,-1,0],{NONE}]", "some of its numbers are not literal", False),
        (f"[[100,Depth(1),0],[0,0,1,0],[-1,0,-1,0],{NONE}]", "some of its numbers are not literal", False),
    ],
)
def test_a_target_in_which_something_is_wrong_counts_as_one(value, reason, counts):
    program = read(module(f"VAR num nX:=5;\nCONST robtarget p1:={value};\n"))
    (left,) = (one for one in program.left if one.name == "p1")
    assert reason in left.reason
    assert left.is_literal == counts


@pytest.mark.parametrize("call", ["Pick p1;", "IF TRUE THEN\nPick 5,P1;\nENDIF"])
def test_a_corrected_target_that_is_passed_on_is_said(call):
    body = f"CONST robtarget p1:={POSE};\nPROC main()\nMoveL p1,v1,fine,tGrip\\WObj:=wTable;\n{call}\nENDPROC"
    said = "p1 is passed to Pick in line "
    assert any(note.startswith(said) for note in read(module(body)).notes)
    assert not any(said in note for note in read(module(body.replace("wTable", "wNew"))).notes)  # not corrected
    asked = body.replace(call, "n1 := Distance(p2,p1);")  # a function that has it as an argument moves nothing
    assert not any("is passed to" in note for note in read(module(asked)).notes)
