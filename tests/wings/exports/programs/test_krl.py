"""KRL files in odd layouts: every literal target is found, nothing else, and what is not changed has a reason."""

import numpy as np
import pytest
from made_up_programs import TOOL, WORK, krl_files, krl_frame

import truearm as ta
from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.wings.exports.programs.correct_program import language_of
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.krl import Krl
from truearm.wings.exports.programs.number_texts import new_numbers
from truearm.wings.exports.programs.program import Surroundings
from truearm.wings.exports.targets.edits import with_edits

POSE = "{X 600,Y 0.5,Z -7.25,A 90,B 10.0,C -3.5e1,S 2,T 35,E1 0.0,E2 0}"
JOINTS = "{A1 1,A2 -90,A3 90.5,A4 4,A5 5,A6 -6,E1 0}"
FRAMES = "[tools.1]\nxyz_mm = [0, 0, 120]\n[works.2]\nxyz_mm = [500, 0, 0]\n"
BOTH = "BAS(#TOOL,1)\nBAS(#BASE,2)\n"


def read(text, frames=FRAMES, file=None):
    data = text.encode("latin-1")
    assert isinstance(language_of(data), Krl)
    return Krl().read(data, Surroundings(file, parse_toml(frames.encode(), FramesFile)))


def source(body, end="\n"):
    return end.join(["&ACCESS RVP", "&REL 1", "DEF Made( )", *body.split("\n"), "END", ""])


def reasons(program):
    return {one.name: one.reason for one in program.left}


LAYOUTS = {
    "a pose in a move": (BOTH + f"PTP {POSE} C_PTP", ["PTP in line 6"]),
    "joints in a move": (f"PTP {JOINTS}", ["PTP in line 4"]),
    "no type in front, lower case": (BOTH + f"lin {POSE.lower()}", ["LIN in line 6"]),
    "a type in front": (BOTH + f"LIN {{E6POS: {POSE[1:]} C_DIS", ["LIN in line 6"]),
    "blanks": (BOTH + f"SLIN {POSE.replace(',', ' ,  ').replace(' ', '  ')}", ["SLIN in line 6"]),
    "a circle": (BOTH + f"CIRC {POSE},{POSE},CA 90", ["CIRC in line 6", "CIRC in line 6"]),
    "commented out": (f"; PTP {JOINTS}\nPTP {JOINTS} ;PTP {JOINTS}", ["PTP in line 5"]),
    "a fold": (f";FOLD PTP P1 Vel=100 % ;%{{PE}} {JOINTS}\nPTP {JOINTS}\n;ENDFOLD", ["PTP in line 5"]),
    "a text": (f'MSG("; {{A1 1}}")\nPTP {JOINTS}', ["PTP in line 5"]),
    "declared and given": (f"DECL E6AXIS AX\nAX={JOINTS}\nPTP AX", ["AX"]),
    "declared with its value": (f"DECL GLOBAL E6AXIS AX = {JOINTS}\nPTP AX", ["AX"]),
    "elements of an array": (f"DECL E6AXIS P[2]\nP[1]={JOINTS}\nP[ 2 ]={JOINTS}\nPTP P[2]", ["P[1]", "P[ 2 ]"]),
    "several names": (f"DECL E6AXIS AX, AY\nAY={JOINTS}\nPTP AY", ["AY"]),
    "a frame that a move reaches": (BOTH + f"DECL FRAME F1\nF1={POSE}\nLIN F1", ["F1"]),
    "a frame that no move reaches": (f"DECL FRAME F1\nF1={POSE}", []),
    "bits": (BOTH + "PTP " + POSE.replace("S 2", "S 'B00010'").replace("T 35", "T 'H23'"), ["PTP in line 6"]),
    "tools and bases are no targets": (f"$TOOL={POSE}\n$BASE={POSE}\nTOOL_DATA[1]={POSE}\nBASE_DATA[2]={POSE}", []),
    "loads are no targets": ("LOAD_DATA[1]={M 1,CM {X 0,Y 0,Z 1,A 0,B 0,C 0},J {X 0,Y 0,Z 0}}", []),
    "external axes alone": ("EX={E1 1,E2 2}", []),
    "tiny numbers": (f"PTP {JOINTS.replace('A1 1,', 'A1 -9.99999999E-99,')}", ["PTP in line 4"]),
}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("what", LAYOUTS)
def test_every_literal_target_is_found_and_nothing_else(what, end):
    body, names = LAYOUTS[what]
    program = read(source(body, end))
    assert sorted(target.name for target in program.targets) == sorted(names)
    for target in program.targets:
        for number in target.numbers.values():
            assert program.data[number.start : number.end] == number.text
        assert not any(name.startswith("E") for name in target.numbers)
    assert with_edits(program.data, []) == program.data


LEFT = {
    "computed": ("DECL E6POS P1\nP1=XP2", "P1", "computes it"),
    "a component": (f"DECL E6AXIS AX\nAX={JOINTS}\nAX.A1=5\nPTP AX", "AX.A1", "computes it"),
    "not literal": ("PTP {A1 a,A2 0,A3 0,A4 0,A5 0,A6 0}", "PTP in line 4", "not literal"),
    "part of a pose": (BOTH + "LIN {X 1,Z 2}", "LIN in line 6", "keep the last value"),
    "part of the joints": ("PTP {A1 1}", "PTP in line 4", "keep the last value"),
    "increments": ("LIN_REL {Z 5}", "LIN_REL {Z 5}", "increments"),
    "a product of frames": ("LIN XP1:OFFS", "LIN XP1:OFFS", "computes it"),
    "where the robot is": ("PTP $AXIS_ACT", "$AXIS_ACT", "computes it"),
    "another file": ("PTP XHOME", "XHOME", "another file"),
    "no tool": (f"LIN {POSE}", "LIN in line 4", "its tool is not stated: state it in --frames"),
    "a tool that is not stated": (
        f"BAS(#TOOL,7)\nBAS(#BASE,2)\nLIN {POSE}",
        "LIN in line 6",
        "TOOL_DATA[7] is not in this program: state it in --frames",
    ),
    "a base that moves": (
        f"BAS(#TOOL,1)\n$BASE=EK(MACHINE_DEF[2].ROOT,2,BASE_DATA[2])\nLIN {POSE}",
        "LIN in line 6",
        "external kinematic",
    ),
    "absolutely accurate": (BOTH + f"PTP {POSE.replace('S 2', 'S 18')}", "PTP in line 6", "absolutely accurate"),
    "no such status": (BOTH + f"PTP {POSE.replace('S 2', 'S 10')}", "PTP in line 6", "none of a six-axis arm"),
    "a tool in the cell": (
        f'DECL FDAT FP1={{TOOL_NO 1,BASE_NO 2,IPO_FRAME #TCP,POINT2[] " "}}\nDECL E6POS XP1={POSE}',
        "XP1",
        "fixed in the cell",
    ),
    "two tools": (f"DECL E6POS P1\nP1={POSE}\n" + BOTH + "LIN P1\nBAS(#TOOL,0)\nLIN P1", "P1", "two corrections"),
    "an unknown type": (f"STATION={POSE}", "STATION", "type is not declared"),
}


def test_called_subprograms_are_said_but_those_of_the_file_and_of_the_system():
    template = "BAS(#INITMOV,0)\nUSERSPOT(#INIT)\nUSER_GRP(0,DUMMY,DUMMY,GDEFAULT)"
    body = f"{template}\nUnder()\nHere()\nIF (TRUE) THEN\nUnder()\nENDIF\n{BOTH}LIN {POSE}\nEND\nDEF Here()"
    assert "The programs that it calls are not corrected with it: Under." in read(source(body)).notes


@pytest.mark.parametrize("what", LEFT)
def test_what_is_not_changed_has_a_reason(what):
    body, name, reason = LEFT[what]
    program = read(source(body))
    assert reason in reasons(program)[name]


def test_taught_points_have_the_tool_and_base_of_their_fdat(tmp_path):
    arm = ta.load_arm("kr16")
    joints = np.radians([[10.0, -80, 100, 20, 40, -30], [-10.0, -70, 95, -20, -40, 30]])
    for name, text in krl_files(arm.chain, joints).items():
        (tmp_path / name).write_text(text)
    program = Krl().read((tmp_path / "Made.dat").read_bytes(), Surroundings(tmp_path / "Made.dat"))
    assert [target.name for target in program.targets] == ["XP0", "XP1"]
    for target in program.targets:
        np.testing.assert_allclose(target.T_flange_tool, TOOL, atol=1e-6)
        np.testing.assert_allclose(target.T_base_work, WORK, atol=1e-6)
    assert "$config.dat" in program.notes[0]
    source_file = Krl().read((tmp_path / "Made.src").read_bytes(), Surroundings(tmp_path / "Made.src"))
    assert not source_file.targets
    assert reasons(source_file) == {"XP0": "its numbers are in another file", "XP1": "its numbers are in another file"}


def test_a_tool_in_the_text_counts_from_its_line_on():
    text = source(f"$TOOL={{{krl_frame(TOOL)}}}\n$BASE=$NULLFRAME\nLIN {POSE}\n$TOOL=TOOL_DATA[1]\nLIN {POSE}")
    first, second = read(text).targets
    np.testing.assert_allclose(first.T_flange_tool, TOOL, atol=1e-6)
    np.testing.assert_allclose(second.T_flange_tool[:3, 3], [0, 0, 120])


def test_where_an_external_axis_moves_poses_are_left_until_it_is_stated():
    moving = POSE.replace("E1 0.0", "E1 250")
    assert len(read(source(BOTH + f"LIN {POSE}\nLIN {POSE}")).targets) == 2
    program = read(source(BOTH + f"PTP {JOINTS}\nLIN {POSE}\nLIN {moving}"))
    assert [one.pose is None for one in program.targets] == [True]
    assert all("not_carrying = [1]" in reason for reason in reasons(program).values())
    stated = "not_carrying = [1]\n" + FRAMES
    assert len(read(source(BOTH + f"LIN {POSE}\nLIN {moving}"), stated).targets) == 2


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("DEF Made( )\nPTP HOME\n", "DEF has no END: the file is cut off"),
        ("DEFDAT Made\nDECL E6POS XP1={X 1}\n", "DEFDAT has no ENDDAT: the file is cut off"),
        ("DEF Made( )\nPTP {A1 1,\nEND\n", "a bracket { is not closed"),
    ],
)
def test_a_damaged_file_is_refused(text, problem):
    with pytest.raises(InputError, match=problem):
        read(text)


def test_whole_numbers_take_the_decimals_of_their_own_change():
    """Near B = 90 deg the angles are another set by 89 deg: they, and the position, keep what is corrected."""
    (target,) = read(source(BOTH + "LIN {X 900,Y 100,Z 800,A 0,B 90,C 0}")).targets
    values = {"X": 900.21, "Y": 100.0, "Z": 799.897, "A": -89.1234, "B": 89.9966, "C": -89.1261}
    found = {name: float(text) for name, text in new_numbers(Krl(), target, values).items()}
    written = [found.get(name, target.numbers[name].value) for name in values]
    np.testing.assert_allclose(written[:3], list(values.values())[:3], atol=0.005)  # mm
    np.testing.assert_allclose(written[3:], list(values.values())[3:], atol=0.0005)  # deg


BITS = "'H10'"
CARTESIAN = "{X 600,Y 0,Z 700,A 0,B 90,C 0,S 2,T 35}"
SETS = {
    "increments": (f"DECL E6AXIS D1={JOINTS}\nPTP_REL D1", "D1", "increments"),
    "increments that a move reaches too": (f"DECL E6AXIS D1={JOINTS}\nPTP D1\nPTP_REL D1", "D1", "increments"),
    "a point as the base": (f"{BOTH}DECL POS B1={CARTESIAN}\n$BASE=B1\nPTP B1", "B1", "tool or base is set from it"),
    "a point as an offset": (f"{BOTH}DECL POS O1={CARTESIAN}\nLIN XP1:O1", "O1", "a frame or an offset"),
    "an offset of a literal": (f"{BOTH}DECL POS O1={CARTESIAN}\nLIN {CARTESIAN}:O1", "O1", "a frame or an offset"),
    "a tool too far away": (
        f"{BOTH}$TOOL={CARTESIAN.replace('600', '1E999')}\nLIN {CARTESIAN}",
        "LIN in line 7",
        "state",
    ),
    "a tool that a subprogram sets": (
        f"{BOTH}CHANGE(1)\nLIN {CARTESIAN}\nEND\nDEF CHANGE(N:IN)\nDEEPER()\nEND\nDEF DEEPER()\n$TOOL=TOOL_DATA[2]",
        "LIN in line 7",
        "subprograms",
    ),
    "a tool of the loop before": (
        f"{BOTH}LOOP\nLIN {CARTESIAN}\n$TOOL=TOOL_DATA[3]\nENDLOOP",
        "LIN in line 7",
        "loops",
    ),
    "a literal times an offset": (f"{BOTH}LIN {CARTESIAN} : O1", f"LIN {CARTESIAN}", "computes it"),
    "a spline's own tool": (f"{BOTH}SLIN {CARTESIAN} WITH $TOOL=TOOL_DATA[9]", "SLIN in line 6", "TOOL_DATA[9]"),
    "a spline block's own base": (
        f"{BOTH}SPLINE WITH $VEL.CP=1, $BASE=EK(MACHINE_DEF[2].ROOT, #EASYS, B) C_SPL\nSPL {CARTESIAN}\nENDSPLINE",
        "SPL in line 7",
        "external kinematic",
    ),
    "an FDAT of a spline": (
        (
            f"{BOTH}DECL FDAT FP7={{TOOL_NO 7,BASE_NO 2,IPO_FRAME #BASE}}\nSLIN {CARTESIAN} WITH "
            "$VEL=SVEL_CP(0.1, ,L), $TOOL=STOOL2( FP7), $BASE=SBASE(FP7.BASE_NO), $ACC=S(L) C_SPL"
        ),
        "SLIN in line 7",
        "TOOL_DATA[7]",
    ),
    "a fixed tool": (f"{BOTH}$IPO_MODE=#TCP\nLIN {CARTESIAN}", "LIN in line 7", "fixed in the cell"),
    "an external base": (f"{BOTH}BAS(#EX_BASE,1)\nLIN {CARTESIAN}", "LIN in line 7", "external kinematic"),
    "a computed tool": (f"{BOTH}$TOOL=MINE\nLIN {CARTESIAN}", "LIN in line 7", "MINE"),
    "a changed component of the tool": (f"{BOTH}$TOOL.Z=1\nLIN {CARTESIAN}", "LIN in line 7", "$TOOL.Z"),
    "tools of two branches": (
        f"{BOTH}IF $IN[1] THEN\n$TOOL=TOOL_DATA[1]\nELSE\n$TOOL=TOOL_DATA[2]\nENDIF\nLIN {CARTESIAN}",
        "LIN in line 11",
        "branches",
    ),
    "a base of one case": (
        f"{BOTH}SWITCH N\nCASE 1\nCASE 2\n$BASE=$NULLFRAME\nDEFAULT\nENDSWITCH\nLIN {CARTESIAN}",
        "LIN in line 12",
        "branches",
    ),
    "a base that is computed": (
        f"BASE_DATA[2]={{X 1,Y 2,Z 3,A 0,B 0,C 0}}\nBASE_DATA[2]=SEEN\n{BOTH}LIN {CARTESIAN}",
        "LIN in line 8",
        "changes while the program runs",
    ),
    "another point of an absolutely accurate robot": (
        f"{BOTH}LIN {CARTESIAN}\nLIN {CARTESIAN.replace('S 2', 'S 18')}",
        "LIN in line 6",
        "absolutely accurate",
    ),
    "bits as a length": (f"{BOTH}LIN {CARTESIAN.replace('600', BITS)}", "LIN in line 6", "literal"),
    "a number too large": (f"{BOTH}LIN {CARTESIAN.replace('600', '1E999')}", "LIN in line 6", "literal"),
    "a status too large": (f"{BOTH}LIN {CARTESIAN.replace('S 2', 'S 1E999')}", "LIN in line 6", "literal"),
    "a field twice": (f"{BOTH}LIN {CARTESIAN.replace('Z 7', 'Y 7')}", "LIN in line 6", "literal"),
}


CARRIED = 'MACHINE_FRAME_DAT[2]={MACH_DEF_INDEX 2,PARENT[] "DKP_400"}\nBASE_DATA[2]={X 10,Y 0,Z 5,A 0,B 0,C 0}\n'
SETS |= {
    "a component that is overwritten": (
        f"{BOTH}DECL POS P1={CARTESIAN}\nLIN P1\nP1.Z=P1.Z+50\nLIN P1",
        "P1",
        "its Z is overwritten in line 8",
    ),
    "a component of an element": (
        f"{BOTH}DECL E6AXIS P[2]\nP[1]={JOINTS}\nPTP P[1]\nP[ 1 ] . A1=5",
        "P[1]",
        "its A1 is overwritten in line 9",
    ),
    "a component of any element": (
        f"{BOTH}DECL E6AXIS P[2]\nP[1]={JOINTS}\nPTP P[1]\nP[I].A1=5",
        "P[1]",
        "its A1 is overwritten in line 9",
    ),
    "a tool that a jump leaves open": (
        f"{BOTH}AGAIN:\nLIN {CARTESIAN}\nBAS(#TOOL,3)\nGOTO AGAIN",
        "LIN in line 7",
        "subprograms",
    ),
    "a base of a machine": (
        f"{CARRIED}{BOTH}LIN {CARTESIAN}",
        "LIN in line 8",
        "BASE_DATA[2] moves with machine 2 (MACHINE_FRAME_DAT): state [positioners.2] in --frames",
    ),
}


@pytest.mark.parametrize("what", SETS)
def test_what_is_no_target_and_what_has_other_frames_is_left(what):
    body, name, reason = SETS[what]
    program = read(source(body), "tool='1'\nwork='2'\n" + FRAMES)
    assert name not in {target.name for target in program.targets}
    assert reason in reasons(program)[name]


@pytest.mark.parametrize(
    "body",
    [
        f"IF A THEN\n{BOTH}ELSE\n{BOTH}ENDIF\nLIN {CARTESIAN}",
        f"{BOTH}IF A THEN\nB=1\nENDIF\nLIN {CARTESIAN}",
        f"{BOTH}SPLINE WITH $TOOL=TOOL_DATA[1],$BASE=BASE_DATA[2]\nSPL {CARTESIAN} WITH $VEL.CP=1 C_SPL\nENDSPLINE",
        f"SLIN {CARTESIAN} WITH $BASE={{X 1,Y 2,Z 3,A 0,B 0,C 0}}, $TOOL=TOOL_DATA[1] C_DIS",
        f"{BOTH}OPEN(1)\nLIN {CARTESIAN}\nEND\nDEF OPEN(N:IN)\n$OUT[1]=TRUE",
        f"{BOTH}FOR I=1 TO 2\nLIN {CARTESIAN}\n$TOOL=TOOL_DATA[3]\nWHILE A\n$TOOL=TOOL_DATA[1]\nENDWHILE\nENDFOR",
        f"LOOP\n{BOTH}LIN {CARTESIAN}\nENDLOOP",
        f"$IPO_MODE=#TCP\n$IPO_MODE=#BASE\n{BOTH}LIN {CARTESIAN}",
        f"AGAIN:\nPTP {JOINTS}\nGOTO AGAIN\n{BOTH}LIN {CARTESIAN}",
        f'MACHINE_FRAME_DAT[2]={{MACH_DEF_INDEX 0,PARENT[] " "}}\n{BOTH}LIN {CARTESIAN}',
        f"{BOTH}MSGNOTIFY(1)\nPULSE($OUT[1],TRUE,0.1)\nLIN {CARTESIAN}",
    ],
)
def test_frames_of_branches_that_agree_and_of_splines_are_taken(body):
    target = read(source(body)).targets[-1]
    assert target.T_flange_tool is not None
    assert target.T_flange_tool[2, 3] == 120


def test_points_that_others_are_computed_from_are_named():
    program = read(source(f"{BOTH}DECL POS P1={CARTESIAN}\nLIN P1\nLIN P1:O1"))
    assert [target.name for target in program.targets] == ["P1"]
    assert any("P1 is used in a computation in line 8" in note for note in program.notes)


def test_a_mark_of_utf8_stays_first():
    text = f"\xef\xbb\xbfDEF made()\r\nPTP {JOINTS}\r\nEND"
    program = read(text)
    assert [target.name for target in program.targets] == ["PTP in line 2"]
    edit = Krl().mark(program, "truearm")
    assert with_edits(program.data, [edit]).startswith(b"\xef\xbb\xbfDEF made()\r\n; truearm\r\n")


def test_joints_that_no_move_goes_to_are_named():
    body = (
        f"DECL E6AXIS P[2]\nDECL E6AXIS D1={JOINTS}\nP[1]={JOINTS}\nLIN P[I]\nPTP P[2]\nDECL E6AXIS D2={JOINTS}\nPTP D2"
    )
    (note,) = read(source(body)).notes
    assert note.startswith("No move of this file goes to D1:")


class TestFilesBesideIt:
    """A subprogram of another file may set the tool; a point of the other half says that the robot is accurate."""

    BODY = f"{BOTH}GRIP(1)\nLIN {CARTESIAN}"

    def read(self, folder, body=BODY, frames=FRAMES, **others):
        for name, text in {"made.src": source(body), **others}.items():
            (folder / name.replace("_", ".")).write_bytes(text.encode())
        return read(source(body), frames, folder / "made.src")

    def test_a_subprogram_that_is_not_there_leaves_the_frames_open(self, tmp_path):
        (reason,) = reasons(self.read(tmp_path)).values()
        assert reason == "GRIP() may set its tool, and its file is not beside this one: state tool in --frames"
        (target,) = self.read(tmp_path, frames='tool = "1"\nwork = "2"\n' + FRAMES).targets
        np.testing.assert_allclose(target.T_flange_tool[:3, 3], [0, 0, 120])

    def test_one_branch_that_calls_it_leaves_them_open_too(self, tmp_path):
        body = f"{BOTH}IF A THEN\nGRIP(1)\nENDIF\nLIN {CARTESIAN}"
        assert "GRIP() may set its tool" in next(iter(reasons(self.read(tmp_path, body)).values()))

    def test_a_subprogram_beside_it_that_sets_none_changes_nothing(self, tmp_path):
        grip = "DEF GRIP(N:IN)\n$OUT[1]=TRUE\nEND\n"
        assert len(self.read(tmp_path, GRIP_SRC=grip).targets) == 1

    @pytest.mark.parametrize("inner", ["$TOOL=TOOL_DATA[2]", "DEEPER()"])
    def test_a_subprogram_beside_it_that_sets_or_may_set_a_tool_does(self, tmp_path, inner):
        program = self.read(tmp_path, GRIP_SRC=f"DEF GRIP(N:IN)\n{inner}\nEND\n")
        assert not program.targets
        assert "subprograms" in next(iter(reasons(program).values()))

    def test_a_component_overwritten_in_the_other_half(self, tmp_path):
        dat = f"DEFDAT made\nDECL E6AXIS XP1={JOINTS}\nENDDAT\n"
        self.read(tmp_path, "XP1.A1=5\nPTP XP1", made_dat=dat)
        program = Krl().read(dat.encode(), Surroundings(tmp_path / "made.dat"))
        assert reasons(program) == {"XP1": "its A1 is overwritten in line 4"}

    @pytest.mark.parametrize("status", ["18", "'B10010'"])
    def test_an_accurate_robot_is_known_by_points_of_the_other_half(self, tmp_path, status):
        dat = f"DEFDAT made\nDECL POS XP1={CARTESIAN.replace('S 2', f'S {status}')}\nENDDAT\n"
        program = self.read(tmp_path, f"{BOTH}LIN {CARTESIAN}", made_dat=dat)
        assert "absolutely accurate" in reasons(program)["LIN in line 6"]


@pytest.mark.parametrize(("slides", "position"), [("false", [1000.0, 10.0, 5.0]), ("true", [1010.0, 0.0, 95.0])])
def test_a_base_that_a_stated_machine_carries_is_that_of_its_axis(slides, position):
    frames = f"{FRAMES}[positioners.2]\nxyz_mm=[1000,0,0]\naxis=1\nslides={slides}\n"
    (target,) = read(source(f"{CARRIED}{BOTH}LIN {CARTESIAN.replace('T 35', 'T 35,E1 90.0')}"), frames).targets
    np.testing.assert_allclose(target.T_base_work[:3, 3], position, atol=1e-9)
    program = read(source(f"{CARRIED}{BOTH}LIN {CARTESIAN}"), frames)
    assert "external axis 1 is not stated" in reasons(program)["LIN in line 8"]
