"""Fanuc listings: what is a target and what is not, in every layout; numbers in the style of their file."""

import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from made_up_listings import fanuc_block, fanuc_joint_block, fanuc_program

from truearm.errors import InputError
from truearm.wings.exports.programs.fanuc_ls import FanucListing
from truearm.wings.exports.programs.frames_file import Frame, FramesFile
from truearm.wings.exports.programs.number_texts import new_numbers
from truearm.wings.exports.programs.numbers import Number
from truearm.wings.exports.programs.program import Surroundings

FRAMES = FramesFile(tools={"3": Frame(xyz_mm=(0, 0, 100))}, works={"1": Frame(xyz_mm=(10, 20, 30))})
T = np.eye(4)
T[:3, 3] = 325.754, -0.041, 106.84
Q = np.array([10.0, -20.0, 30.0, 40.0, -50.0, 200.0])
LANGUAGE = FanucListing()


def block(number, **options):
    return fanuc_block(number, T, Q, **options)


def read(text, frames=FRAMES):
    data = text if isinstance(text, bytes) else text.encode("latin-1")
    assert LANGUAGE.recognises(data)
    return LANGUAGE.read(data, Surroundings(frames=frames))


def reasons(program):
    return {one.name: one.reason for one in program.left}


LAYOUTS = {
    "as a controller writes it": lambda text: text,
    "line ends of Unix": lambda text: text.replace("\r\n", "\n"),
    "mixed line ends": lambda text: text.replace("\r\n", "\n", 9),
    "no end of the last line": lambda text: text.rstrip("\r\n"),
    "a byte order mark": lambda text: "\xef\xbb\xbf" + text,
    "keywords of a German controller": lambda text: text.replace("CONFIG", "KONFIG").replace(
        "/ATTR", "/ATTR\r\nEIGN. = X;"
    ),
    "eight-bit texts": lambda text: text.replace('"made"', '"Gr\xf6\xdfe \x81"'),
    "no blanks in the fields": lambda text: re.sub(r"= +", "=", text),
    "blanks in place of tabs": lambda text: text.replace("\t", "    "),
    "more decimals": lambda text: re.sub(r"(\.\d{3})( +(?:mm|deg))", r"\g<1>000\2", text),
    "names of points": lambda text: re.sub(r"P\[(\d)\]\{", lambda found: f'P[{found[1]}:"Abl\xe4ge {{1}}"]{{', text),
    "one field a line": lambda text: re.sub(r",\t(?=[XYZWPRJ])", ",\r\n\t", text),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_all_points_of_motions_are_found_in_every_layout_and_come_back_unchanged(layout):
    blocks = [block(1), fanuc_joint_block(2, Q), block(3), block(4), block(5)]
    moves = ["J P[1] 100% FINE   ", "L P[2:rest] 100mm/sec CNT50   ", "C P[3]    \r\n    :  P[4] 100mm/sec FINE   "]
    text = LAYOUTS[layout](fanuc_program(blocks, moves))
    program = read(text)
    assert len(program.targets) == 4
    assert len(program.left) == 1  # P[5], to which nothing goes
    assert [move.kind for move in program.moves] == ["joint", "linear", "circular", "circular"]
    assert [move.target for move in program.moves] == [0, 1, 2, 3]
    for target in program.targets:
        assert len(target.numbers) == 6
        for number in target.numbers.values():
            assert program.data[number.start : number.end] == number.text
            decimals = len(number.text.partition(b".")[2])
            assert float(LANGUAGE.number_text(number, number.value, decimals)) == number.value


def test_a_pose_is_read_in_its_frames_with_its_configuration():
    program = read(fanuc_program([block(1)], ["L P[1] 100mm/sec FINE   "]))
    (target,) = program.targets
    np.testing.assert_allclose(target.pose[:3, 3], T[:3, 3], atol=1e-12)
    np.testing.assert_allclose(target.T_flange_tool[:3, 3], [0, 0, 100])
    np.testing.assert_allclose(target.T_base_work[:3, 3], [10, 20, 30])
    stated = {one.quantity: (one.low, one.high) for one in target.conditions}
    assert stated["J6"] == (180.0, 540.0)
    assert stated["J4"] == (-180.0, 180.0)
    assert stated["J5"] == (-np.inf, 0.0)
    assert stated["elbow"] == stated["shoulder"] == (0.0, np.inf)


def test_uf_0_and_ut_0_are_the_world_and_the_flange():
    text = fanuc_program([block(1, head="\tUF : 0, UT : 0,\t\t")], ["L P[1] 100mm/sec FINE   "])
    (target,) = read(text, FramesFile()).targets
    np.testing.assert_array_equal(target.T_base_work, np.eye(4))
    np.testing.assert_array_equal(target.T_flange_tool, np.eye(4))


LEFT = {
    "INC": ("L P[1] 100mm/sec FINE INC   ", "an increment"),
    "COORD": ("L P[1] 100mm/sec FINE COORD   ", "coordinated with another group"),
    "offset": ("L P[1] 100mm/sec FINE Offset,PR[5]   ", "only with a shift at run time"),
    "tool offset": ("L P[1] 100mm/sec FINE Tool_Offset,PR[5]   ", "only with a shift at run time"),
    "vision": ("L P[1] 100mm/sec FINE VOFFSET,VR[5]   ", "only with a shift at run time"),
    "no motion": ("  CALL OTHER   ", "no motion of the program goes to it"),
    "remark": ("  !L P[1] 100mm/sec FINE   ", "no motion of the program goes to it"),
    "other remark": ("  --L P[1] 100mm/sec FINE   ", "no motion of the program goes to it"),
}


@pytest.mark.parametrize("case", LEFT)
def test_points_that_no_motion_goes_to_as_they_are_stay(case):
    move, reason = LEFT[case]
    program = read(fanuc_program([block(1)], [move]))
    assert not program.targets
    assert reason in reasons(program)["P[1]"]


def test_a_point_that_is_assigned_stays():
    program = read(fanuc_program([block(1)], ["  P[1]=PR[4]    ", "L P[1] 100mm/sec FINE   "]))
    assert reasons(program)["P[1]"] == "assigned at run time in line 6"


def test_registers_and_computed_numbers_are_listed_and_the_points_they_may_mean_are_corrected():
    moves = ["J PR[3:home] 10% FINE   ", "L P[R[7]] 100mm/sec FINE   "]
    program = read(fanuc_program([block(1), block(2)], moves))
    assert len(program.targets) == 2
    assert reasons(program) == {
        "J PR[3:home] 10% FINE": "a position register: its value is not in the program",
        "L P[R[7]] 100mm/sec FINE": "the number of the point is computed at run time",
    }


def test_points_that_others_are_computed_from_are_said_to_be():
    moves = ["L P[1] 100mm/sec FINE   ", "  PR[9]=P[1]    ", "L P[1] 100mm/sec FINE Offset,PR[2]   "]
    program = read(fanuc_program([block(1)], moves))
    assert len(program.targets) == 1
    assert any("P[1] is used in a computation in line 7" in note for note in program.notes)
    assert any("P[1] is shifted in line 8" in note for note in program.notes)


BLOCKS = {
    "never taught": (
        re.sub(r"=[ \d.-]{10}", "= ********", block(1)).replace("UF : 1, UT : 3", "UF : F, UT : F"),
        "never taught",
    ),
    "behind axis 1": (block(1).replace("'N U T", "'N U B"), "is not certain"),
    "four axes": (block(1).replace("'N U T, 0, 0, 1'", "'L, 0, 0, 0'"), "is not certain"),
    "an extended axis": (block(1).replace(" deg\r\n}", " deg,\r\n\tE1=   100.000  mm\r\n}"), "extended axis"),
    "a standing tool": (re.sub(r"\b([XYZWPR]) =", r"R\1 =", block(1)), "stands in the cell"),
    "another tool": (block(1).replace("UT : 3", "UT : 7"), "state [tools.7]"),
    "another frame": (block(1).replace("UF : 1", "UF : 9"), "state [works.9]"),
    "another group": (block(1).replace("GP1:", "GP2:"), "no position of group 1"),
    "sliding": (
        "P[1]{\r\n   GP1:\r\n\tUF : 0, UT : 3,\r\n\tJ1=   100.000  mm\r\n};",
        "of this arm as plain numbers, got J1 [mm]",
    ),
}


@pytest.mark.parametrize("case", BLOCKS)
def test_positions_of_other_kinds_stay_with_a_reason(case):
    text, reason = BLOCKS[case]
    program = read(fanuc_program([text], ["L P[1] 100mm/sec FINE   "]))
    assert not program.targets
    assert reason in reasons(program)["P[1]"]


def test_words_in_names_are_no_options_and_what_a_search_stores_is_no_shift():
    move = "L P[1:Offset INC] 100mm/sec FINE Skip,LBL[1:VOFFSET],PR[5:x]=LPOS   "
    assert len(read(fanuc_program([block(1)], [move])).targets) == 1


def test_moves_to_other_places_stand_between_those_to_targets():
    moves = ["L P[1] 1mm/sec FINE   ", "L PR[3] 1mm/sec FINE   ", "L P[1] 1mm/sec FINE Offset,PR[1]   "]
    program = read(fanuc_program([block(1)], [*moves, "L P[1] 1mm/sec FINE   "]))
    assert [move.target for move in program.moves] == [0, None, None, 0]


def test_further_groups_keep_their_bytes():
    two = block(1).replace("\r\n}", "\r\n   GP2:\r\n\tUF : 0, UT : 1,\r\n\tJ1=  -100.000  mm\r\n}")
    (target,) = read(fanuc_program([two], ["L P[1] 100mm/sec FINE   "])).targets
    assert max(number.end for number in target.numbers.values()) < two.index("GP2") + 200


def test_a_program_on_a_conveyor_is_not_changed():
    text = fanuc_program([block(1)], ["L P[1] 100mm/sec FINE   "])
    text = text.replace("/APPL", "/APPL\r\nLINE_TRACK;\r\n  LINE_TRACK_SCHEDULE_NUMBER      : 2;")
    assert reasons(read(text)) == {"P[1]": "of a program that tracks a conveyor"}


@pytest.mark.parametrize("cut", ["/END", "/POS", "/MN"])
def test_a_truncated_program_is_refused(cut):
    text = fanuc_program([block(1)], ["L P[1] 100mm/sec FINE   "])
    with pytest.raises(InputError, match="truncated"):
        read(text[: text.index(cut)])


def test_a_point_that_does_not_end_is_refused_with_its_line():
    text = fanuc_program([block(1)], ["L P[1] 100mm/sec FINE   "]).replace("};", "")
    with pytest.raises(InputError, match=r"line 8: P\[1\] does not end"):
        read(text)


@given(st.floats(-3000, 3000), st.floats(-3000, 3000))
@example(0.0, -0.0001)
@example(0.041, 12.5)
def test_fields_keep_their_width_and_their_zeros(old, new):
    text = f"{old:.3f}"
    text = (text.replace("0.", ".", 1) if 0 < abs(float(text)) < 1 else text).rjust(10).encode()
    written = LANGUAGE.number_text(Number(0, 10, text), new, 3)
    assert len(written) == 10
    assert abs(float(written) - new) <= 0.0005 + 1e-9
    assert not re.match(rb"\s*-?0\.", written)
    assert not re.fullmatch(rb"\s*-\.?0*", written)


def test_whole_numbers_take_the_decimals_of_the_controller():
    text = "/PROG A\n/MN\n   1:J P[1] 10% FINE;\n/POS\nP[1]{\n GP1:\n UF : 0, UT : 0,\n"
    text += "J1= 0 deg,J2= 0 deg,J3= 0 deg,J4= 0 deg,J5= -60 deg,J6= 10 deg\n};\n/END\n"
    (target,) = read(text).targets
    values = {f"j{i}": number.value + 0.0123 for i, number in enumerate(target.numbers.values(), 1)}
    new = {name: float(value) for name, value in new_numbers(LANGUAGE, target, values).items()}
    assert new == pytest.approx(values, abs=0.5e-3)  # rounding of three decimals


def test_frames_that_the_program_sets_are_said():
    moves = ["UFRAME[1]=PR[9]", "!UTOOL[2]=PR[1]", "UTOOL[GP1:3]=PR[1]", "PR[9]=UFRAME[4]", "J P[1] 100% FINE"]
    (note,) = (one for one in read(fanuc_program([block(1)], moves)).notes if "while it runs" in one)
    assert note.startswith("The program sets UFRAME[1], UTOOL[GP1:3] while it runs")


def test_called_programs_are_said_and_remarks_are_none():
    text = fanuc_program(
        [block(1)], ["J P[1] 100% FINE", "CALL SUB1('CALL TEXT')", "!CALL REMARK", "IF R[1]=2,CALL GRIP"]
    )
    assert "The programs that it calls are not corrected with it: SUB1, GRIP." in read(text).notes
