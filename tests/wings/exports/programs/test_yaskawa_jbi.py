"""Yaskawa jobs: what is a target and what is not, in every layout."""

import re

import numpy as np
import pytest
from made_up_listings import PULSES, yaskawa_job, yaskawa_pose, yaskawa_pulses

from truearm.errors import InputError
from truearm.wings.exports.programs.frames_file import Frame, FramesFile
from truearm.wings.exports.programs.program import Surroundings
from truearm.wings.exports.programs.yaskawa_jbi import YaskawaJob

FRAMES = FramesFile(
    tools={"0": Frame(xyz_mm=(0, 0, 0)), "3": Frame(xyz_mm=(0, 0, 100))},
    works={"1": Frame(xyz_mm=(10, 20, 30))},
    pulses_per_deg=tuple(PULSES),
)
T = np.eye(4)
T[:3, 3] = 300.5, 0.0, -9.794
Q = np.radians([10.0, -20.0, 30.0, 40.0, -50.0, 60.0])
IN_USER = ["///USER 1", "///TOOL 3", "///POSTYPE USER", "///RECTAN", "///RCONF 0,0,0,0,0,0,0,0"]
IN_PULSES = ["///TOOL 3", "///POSTYPE PULSE", "///PULSE"]
LANGUAGE = YaskawaJob()


def read(text, frames=FRAMES):
    data = text.encode("latin-1")
    assert LANGUAGE.recognises(data)
    return LANGUAGE.read(data, Surroundings(frames=frames))


def reasons(program):
    return {one.name: one.reason for one in program.left}


LAYOUTS = {
    "as a controller writes it": lambda text: text,
    "line ends of Unix": lambda text: text.replace("\r\n", "\n"),
    "mixed line ends": lambda text: text.replace("\r\n", "\n", 7),
    "no end of the last line": lambda text: text.rstrip("\r\n"),
    "a remark before the job": lambda text: "'PP version: 1\r\n" + text,
    "eight-bit comments": lambda text: text.replace("NOP\r\n", "NOP\r\n'\x83\x86\x83b MOVL C00001\r\n"),
    "blanks after commas": lambda text: re.sub(r",(?=[-\d.]+[,\r])", ", ", text),
    "blanks at line ends": lambda text: re.sub(r"(?m)^(C\d.*?)\r", r"\1  \r", text),
    "two decimals": lambda text: re.sub(r"(\.\d\d)\d+", r"\1", text),
    "further sections": lambda text: text.replace("///DATE", "//ALIGN 1\r\n//INST\r\n///DATE"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_all_points_of_moves_are_found_in_every_layout(layout):
    points = [*IN_PULSES, yaskawa_pulses("C00000", Q), *IN_USER, yaskawa_pose("C00001", T), yaskawa_pose("C00002", T)]
    points += [yaskawa_pose("P00012", T), yaskawa_pose("P00013", T)]
    moves = ["MOVJ C00000 VJ=10.00", "MOVL C00001 V=10.0", "MOVC C00002 V=10.0", "  MOVL P012 V=5.0"]
    program = read(LAYOUTS[layout](yaskawa_job(points, moves)))
    assert [target.name for target in program.targets] == ["C00000", "C00001", "C00002", "P00012"]
    assert reasons(program) == {"P00013": "no move of the job goes to it"}
    assert [(move.kind, move.target) for move in program.moves] == [
        ("joint", 0),
        ("linear", 1),
        ("circular", 2),
        ("linear", 3),
    ]
    for target in program.targets:
        assert len(target.numbers) == 6
        for number in target.numbers.values():
            assert program.data[number.start : number.end] == number.text


def test_lines_of_state_hold_for_the_points_after_them():
    points = [*IN_USER, yaskawa_pose("C00000", T), "///TOOL 0", "///POSTYPE ROBOT", yaskawa_pose("C00001", T)]
    program = read(yaskawa_job(points, ["MOVL C00000 V=1.0", "MOVL C00001 V=1.0"]))
    first, second = program.targets
    np.testing.assert_allclose(first.T_base_work[:3, 3], [10, 20, 30])
    np.testing.assert_allclose(first.T_flange_tool[:3, 3], [0, 0, 100])
    np.testing.assert_array_equal(second.T_base_work, np.eye(4))
    np.testing.assert_array_equal(second.T_flange_tool, np.eye(4))
    np.testing.assert_allclose(first.pose[:3, 3], T[:3, 3])


def test_pulses_are_degrees_times_those_of_a_degree():
    points = [*IN_PULSES, yaskawa_pulses("C00000", Q)]
    (target,) = read(yaskawa_job(points, ["MOVJ C00000 VJ=1.00"])).targets
    np.testing.assert_allclose(target.joints, Q, atol=np.radians(0.5 / 700))


STAY = {
    "without pulses per degree": (
        [*IN_PULSES, yaskawa_pulses("C00000", Q)],
        ["MOVJ C00000 VJ=1.00"],
        "state pulses_per_deg",
    ),
    "a shift": ([*IN_USER, "///POSTYPE TOOL", yaskawa_pose("C00000", T)], ["MOVL C00000 V=1.0"], "of the type TOOL"),
    "another master tool": (
        [*IN_USER, "///POSTYPE MTOOL", yaskawa_pose("C00000", T)],
        ["MOVL C00000 V=1.0"],
        "of the type MTOOL",
    ),
    "a tool that is not stated": (
        [*IN_USER, "///TOOL 7", yaskawa_pose("C00000", T)],
        ["MOVL C00000 V=1.0"],
        "state [tools.7]",
    ),
    "a frame that is not stated": (
        [*IN_USER, "///USER 9", yaskawa_pose("C00000", T)],
        ["MOVL C00000 V=1.0"],
        "state [works.9]",
    ),
    "no configuration": ([*IN_USER[:4], yaskawa_pose("C00000", T)], ["MOVL C00000 V=1.0"], "no RCONF"),
    "rear": ([*IN_USER, "///RCONF 0,0,1,0,0,0", yaskawa_pose("C00000", T)], ["MOVL C00000 V=1.0"], "behind axis S"),
    "beyond half a turn": (
        [*IN_USER, "///RCONF 0,0,0,0,1,0", yaskawa_pose("C00000", T)],
        ["MOVL C00000 V=1.0"],
        "beyond 180 deg",
    ),
    "seven axes": ([*IN_USER, yaskawa_pose("C00000", T) + ",0.0"], ["MOVL C00000 V=1.0"], "7 values"),
    "increment": ([*IN_USER, yaskawa_pose("C00000", T)], ["IMOV C00000 V=1.0"], "an increment"),
    "searched shift": ([*IN_USER, yaskawa_pose("C00000", T)], ["SFTON P001", "MOVL C00000 V=1.0", "SFTOF"], "SFTON"),
}


@pytest.mark.parametrize("case", STAY)
def test_points_that_cannot_be_known_stay_with_a_reason(case):
    points, moves, reason = STAY[case]
    frames = FRAMES if case != "without pulses per degree" else FramesFile()
    program = read(yaskawa_job(points, moves), frames)
    assert not program.targets
    assert reason in reasons(program)["C00000"]


@pytest.mark.parametrize(
    "instruction", ["SET P012 P013", "ADD P012 P001", "GETS PX012 $PX000", "SETE P012 (3) D004", "MFRAME P012 P001"]
)
def test_variables_that_the_job_rewrites_stay(instruction):
    points = [*IN_USER, yaskawa_pose("P00012", T)]
    program = read(yaskawa_job(points, [instruction, "MOVL P012 V=1.0"]))
    assert not program.targets
    assert reasons(program)["P00012"] == "rewritten or used in a computation in line 16"


def test_other_axes_stay():
    points = [*IN_PULSES, yaskawa_pulses("C00000", Q), "EC00000=12", "BC00000=3"]
    program = read(yaskawa_job(points, ["MOVJ C00000 VJ=1.00 +MOVJ EC00000"]))
    assert [target.name for target in program.targets] == ["C00000"]
    assert "2 positions of other axes are not changed" in program.notes


def test_a_track_may_carry_the_base():
    points = [*IN_USER, "///POSTYPE BASE", "BC00000=3", yaskawa_pose("C00000", T)]
    assert "a track may be under the arm" in reasons(read(yaskawa_job(points, ["MOVL C00000 V=1.0"])))["C00000"]


def test_a_computed_number_and_a_missing_point_are_listed():
    program = read(yaskawa_job([*IN_USER], ["MOVL P[I001] V=1.0", "MOVL P005 V=1.0"]))
    assert [one.reason for one in program.left] == [
        "the number of the point is computed at run time",
        "its position is not in the job",
    ]


def test_a_job_without_its_end_is_refused():
    text = yaskawa_job([*IN_USER, yaskawa_pose("C00000", T)], ["MOVL C00000 V=1.0"])
    with pytest.raises(InputError, match="truncated"):
        read(text[: text.index("NOP")])


def test_a_job_with_fewer_points_than_it_states_is_refused():
    with pytest.raises(InputError, match="states 5 taught points and has 1"):
        read(yaskawa_job([*IN_USER, yaskawa_pose("C00000", T)], [], counts=5))


@pytest.mark.parametrize(
    ("postype", "other", "is_left"),
    [
        ("BASE", "BC00000=100", True),
        ("BASE", "EC00000=100", True),
        ("USER", "BC00000=100", True),
        ("USER", "EC00000=100", False),
        ("ROBOT", "BC00000=100", False),
    ],
)
def test_axes_that_may_carry_the_arm_count_wherever_they_stand(postype, other, is_left):
    after = ["///POSTYPE PULSE", "///PULSE", other]
    before = [*IN_USER, f"///POSTYPE {postype}", yaskawa_pose("C00000", T)]
    for points in ([*before, *after], [*after, *before]):
        program = read(yaskawa_job(points, ["MOVL C00000 V=1.0"]))
        assert len(program.targets) == (not is_left)
        assert ("track" in reasons(program).get("C00000", "")) == is_left


def test_called_jobs_are_said():
    moves = ["MOVJ C00000 VJ=10.00", "CALL JOB:SUB-1 IF B000=1", "'CALL JOB:REMARK", "CALL JOB:SUB-1"]
    program = read(yaskawa_job([*IN_PULSES, yaskawa_pulses("C00000", Q)], moves))
    assert "The programs that it calls are not corrected with it: SUB-1." in program.notes


def test_frames_that_the_job_sets_are_said():
    moves = ["SETTOOL TL#(3) P010", "MFRAME UF#(1) PX001 PX002 PX003", "MOVJ C00000 VJ=10.00"]
    program = read(yaskawa_job([*IN_PULSES, yaskawa_pulses("C00000", Q)], moves))
    assert any(note.startswith("The program sets TL#(3), UF#(1) while it runs") for note in program.notes)
