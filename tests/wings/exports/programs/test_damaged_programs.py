"""Programs that are cut off or damaged are refused with a message, or read with the places of their numbers."""

import random
from contextlib import suppress

import numpy as np
import pytest
from made_up_listings import (
    FRAMES,
    WORK,
    fanuc_block,
    fanuc_joint_block,
    fanuc_program,
    fitted,
    joints_of,
    kinematics_node,
    old_waypoint,
    polyscope_program,
    polyscope_script,
    waypoint,
    yaskawa_job,
    yaskawa_pose,
    yaskawa_pulses,
)

from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.wings.exports.programs.correct_program import correct_program, language_of
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.program import Surroundings

Q = np.array([10.0, -20.0, 30.0, 40.0, -50.0, 60.0])
T = np.eye(4)
T[:3, 3] = 325.754, 136.247, 106.84
MOVES = [
    "J P[1] 100% FINE   ",
    "L P[2:rest] 100mm/sec FINE Offset,PR[2]   ",
    "C P[3]    \r\n    :  P[1] 1mm/sec FINE   ",
]
POINTS = ["///TOOL 3", "///POSTYPE PULSE", "///PULSE", yaskawa_pulses("C00000", np.radians(Q)), "///USER 1"]
POINTS += ["///POSTYPE USER", "///RECTAN", "///RCONF 0,0,0,0,0,0", yaskawa_pose("C00001", T)]
JOINTS = joints_of("ur10", 3)
PROGRAMS = {
    "ls": ("lrmate200id", fanuc_program([fanuc_block(1, T, Q), fanuc_joint_block(2, Q), fanuc_block(3, T, Q)], MOVES)),
    "jbi": ("gp7", yaskawa_job(POINTS, ["MOVJ C00000 VJ=1.00", "MOVL C00001 V=1.0"])),
    "script": ("ur10", polyscope_script(fitted("ur10").arm_.chain, JOINTS) + "movel(p[.4,.2,.3,0,3.1,0])\n"),
    "urp": (
        "ur10",
        polyscope_program(
            [waypoint("a", JOINTS[0]), old_waypoint("b", JOINTS[1], WORK)], kinematics=kinematics_node(tag="kinematics")
        ),
    ),
}
SIGNS = b"0123456789.,-+[](){}<>\"'/ \t\r\n=:;*pPCJX\xff\x00e"


def damaged(data, rng):
    """A program with some bytes changed, lost or doubled."""
    new = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at, kind = rng.randrange(len(new)), rng.random()
        if kind < 0.4:
            new[at] = rng.choice(SIGNS)
        elif kind < 0.7:
            del new[at : at + rng.randint(1, 30)]
        else:
            new[at:at] = new[rng.randrange(len(new)) :][: rng.randint(1, 40)]
    return bytes(new)


@pytest.mark.parametrize("ending", PROGRAMS)
def test_a_damaged_program_is_refused_or_its_numbers_have_their_places(ending):
    arm, text = PROGRAMS[ending]
    data, rng = text.encode(), random.Random(1)
    beside = Surroundings(None, parse_toml(FRAMES.encode(), FramesFile), fitted(arm).arm_.chain)
    cut = [data[:at] for at in range(1, len(data), max(1, len(data) // 100))]
    n_read = 0
    for content in [*cut, *(damaged(data, rng) for _ in range(200))]:
        language = language_of(content)
        if language is None:
            continue
        try:
            program = language.read(content, beside)
        except InputError:
            continue
        n_read += 1
        for target in program.targets:
            assert all(content[one.start : one.end] == one.text for one in target.numbers.values())
            assert np.isfinite([one.value for one in target.numbers.values()]).all()
    assert n_read > 20


@pytest.mark.parametrize("n", [20, pytest.param(100, marks=pytest.mark.weekly)])
@pytest.mark.parametrize("ending", PROGRAMS)
def test_a_damaged_program_is_corrected_or_refused_as_a_whole(tmp_path, ending, n):
    arm, text = PROGRAMS[ending]
    rng, path = random.Random(2), tmp_path / f"a.{ending}"
    (tmp_path / "frames.toml").write_text(FRAMES)
    for _ in range(n):
        path.write_bytes(damaged(text.encode(), rng))
        with suppress(InputError):
            correct_program(fitted(arm), path, frames=tmp_path / "frames.toml", untrained="accept")
