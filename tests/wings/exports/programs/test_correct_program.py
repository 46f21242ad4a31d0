"""Programs corrected as a whole: bytes that stay, the reverse, what is refused, and the command."""

import json
import re
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from made_up_listings import fitted, polyscope_script
from made_up_listings import joints_of as joints_of_ur
from made_up_programs import TOOL, WORK, in_work, krl_files, krl_frame, krl_turn, quaternion, rapid_module

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import ArmState, Term
from truearm.identification.terms.basis import PayloadTorque
from truearm.models import PhysicalModel
from truearm.readings import Session
from truearm.wings.exports.programs import subdivision
from truearm.wings.exports.programs.correct_program import correct_program, is_program
from truearm.wings.exports.programs.program import Move
from truearm.wings.exports.programs.solving import PathEnds
from truearm.wings.exports.programs.urscript import pose_numbers
from truearm.wings.exports.targets.pose_models import nominal_poses, poses_of, with_tool
from truearm.wings.exports.targets.targets import Targets

IRB, KR = "irb2600-12-165", "kr16"
RPY_TOOL = (35.0, -20.0, 140.0, 0.0, np.pi / 2, 0.0)
NUMBERS = re.compile(rb"[-+]?\d*\.?\d+(?:E[-+]?\d+)?")


def joints_of(arm, n=20, seed=1):
    lower, upper = {
        IRB: ([-1.0, -0.4, -0.6, -1.0, 0.4, -1.5], [1.0, 0.8, 0.6, 1.0, 1.6, 1.5]),
        KR: ([-1.0, -1.6, 1.3, -1.0, 0.4, -1.5], [1.0, -0.8, 2.1, 1.0, 1.6, 1.5]),
    }[arm]
    return np.random.default_rng(seed).uniform(lower, upper, (n, 6))


def written(folder, content, name="made.mod"):
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    return folder / name


def corrected(model, file, **options):
    return correct_program(model, file, **({"untrained": "accept"} | options))


def joints_module(joints, digits=4):
    rows = [",".join(f"{one:.{digits}f}" for one in row) for row in np.degrees(joints)]
    none = ",".join(["9E9"] * 6)
    lines = [f"CONST jointtarget j{i}:=[[{row}],[{none}]];" for i, row in enumerate(rows)]
    return "\n".join(["MODULE Made", *lines, "ENDMODULE", ""])


def numbers_of(content, name):
    """Numbers of the aggregates of a name, p0 .. or XP0 .., up to the seventh."""
    lines = [line for line in content.splitlines() if re.search(rb"\b" + name + rb"\d+\s*:?=\s*[\[{]", line)]
    return np.array([[float(one) for one in NUMBERS.findall(re.split(rb"=", line, maxsplit=1)[1])] for line in lines])


class TestTheTip:
    """A controller that knows the arm as drawn, sent to the new targets, has the arm at the pose meant."""

    def check(self, arm, planned, sent):
        model = fitted(arm)
        equipped, rows = with_tool(model, np.array(RPY_TOOL)), np.arange(len(sent))
        meant = nominal_poses(equipped).pose(planned, rows)
        there = poses_of(equipped, Targets.of_joints(sent).session(sent)).pose(sent, rows)
        away = np.linalg.norm(meant.tip_in_base - there.tip_in_base, axis=1)
        assert away.max() < 1e-3  # [mm]: targets have six decimals
        before = poses_of(equipped, Targets.of_joints(planned).session(planned)).pose(planned, rows)
        assert np.linalg.norm(meant.tip_in_base - before.tip_in_base, axis=1).max() > 0.05

    def solved(self, arm, poses, start):
        """Joints at poses of the tool, by the general inverse kinematics."""
        chain = ta.load_arm(arm).chain.with_tip(np.zeros(3))
        flange = WORK @ poses @ np.linalg.inv(TOOL)
        from truearm.arm.inverse_kinematics import solve_inverse_kinematics

        found = solve_inverse_kinematics(chain, flange[:, :3, 3], R_base_tip=flange[:, :3, :3], start=start)
        assert found.reached.all()
        return found.angles

    def test_rapid(self, tmp_path):
        planned = joints_of(IRB)
        text = rapid_module(ta.load_arm(IRB).chain, planned)
        found = corrected(fitted(IRB), written(tmp_path, text))
        assert found.is_complete
        from scipy.spatial.transform import Rotation

        values = numbers_of(found.content, b"p")
        poses = np.tile(np.eye(4), (len(values), 1, 1))
        poses[:, :3, 3] = values[:, :3]
        poses[:, :3, :3] = Rotation.from_quat(values[:, 3:7], scalar_first=True).as_matrix()
        self.check(IRB, planned, self.solved(IRB, poses, planned))

    def test_krl(self, tmp_path):
        planned = joints_of(KR)
        for name, text in krl_files(ta.load_arm(KR).chain, planned, name="made").items():
            written(tmp_path, text, name)
        found = corrected(fitted(KR), tmp_path / "made.dat")
        assert found.is_complete
        from scipy.spatial.transform import Rotation

        values = numbers_of(re.sub(rb"([XYZABCST]|E\d) ", b" ", found.content), b"XP")
        poses = np.tile(np.eye(4), (len(values), 1, 1))
        poses[:, :3, 3] = values[:, :3]
        poses[:, :3, :3] = Rotation.from_euler("ZYX", values[:, 3:6], degrees=True).as_matrix()
        self.check(KR, planned, self.solved(KR, poses, planned))

    @pytest.mark.parametrize("tools", [["tGrip", "tool0"], ["tElsewhere"], []])
    def test_joints_have_the_same_correction_whatever_tools_they_are_used_with(self, tmp_path, tools):
        module = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB, 1))
        home = "CONST jointtarget jHome:=[[10,20,15,0,60,0],[9E9,9E9,9E9,9E9,9E9,9E9]];"

        def joints(tools):
            moves = "".join(f"    MoveAbsJ jHome,v100,fine,{tool};\n" for tool in tools)
            text = module.replace("  PROC main()\n", f"  {home}\n  PROC main()\n{moves}")
            changes = corrected(fitted(IRB), written(tmp_path, text)).changes
            return next(one.joints for one in changes if one.target.name == "jHome")

        np.testing.assert_allclose(joints(tools), joints(["tGrip"]), rtol=0, atol=1e-9)  # rad: both are solved for

    def test_joints_of_krl_that_are_used_with_several_tools_are_corrected(self, tmp_path):
        axes = "{A1 10,A2 -80,A3 100,A4 20,A5 40,A6 -30}"
        lines = ["DECL E6AXIS HOME", f"HOME={axes}", "BAS(#TOOL,0)", "PTP HOME", "BAS(#TOOL,3)", "PTP HOME"]
        found = corrected(fitted(KR), written(tmp_path, "\n".join(["DEF made( )", *lines, "END", ""]), "made.src"))
        assert [one.target.name for one in found.changes] == ["HOME"]


class TestBytes:
    @pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
    def test_a_model_equal_to_the_nominal_arm_changes_no_byte(self, tmp_path, end):
        text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB), digits=(2, 6)).replace("\n", end)
        found = corrected(fitted(IRB, "nominal"), written(tmp_path, text))
        assert found.content == text.encode()
        assert len(found.changes) == 20

    def test_only_the_numbers_of_targets_change(self, tmp_path):
        text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB), digits=(2, 6)).replace("PROC", "! Größe\r\n\tPROC")
        found = corrected(fitted(IRB), written(tmp_path, text))
        mark, *rest = [line for line in found.content.splitlines(keepends=True) if b"truearm" in line]
        assert re.fullmatch(rb"! truearm command [0-9a-f]{8}\n", mark)
        assert not rest
        new = found.content.replace(mark, b"")
        assert NUMBERS.sub(b"#", new) == NUMBERS.sub(b"#", text.encode("latin-1"))
        assert [line for line in new.splitlines() if b"robtarget" not in line] == [
            line for line in text.encode("latin-1").splitlines() if b"robtarget" not in line
        ]

    def test_digits_are_those_of_the_neighbours_and_more_where_the_change_is_lost(self, tmp_path):
        joints = joints_of(IRB, 1)
        fine = corrected(fitted(IRB), written(tmp_path, joints_module(joints, 5))).changes[0]
        assert {len(text.partition(b".")[2]) for text in fine.numbers.values()} == {5}
        coarse = corrected(fitted(IRB), written(tmp_path, joints_module(np.radians([[5, 10, 15, 20, 30, 40]]), 0)))
        change = coarse.changes[0]
        largest = max(abs(float(text) - change.target.numbers[name].value) for name, text in change.numbers.items())
        # Rounding is at most a fortieth of the largest change.
        off = [
            abs(float(text) - q)
            for (_, text), q in zip(sorted(change.numbers.items()), np.degrees(change.joints), strict=True)
        ]
        assert max(off) <= largest / 40

    def test_the_reverse_takes_the_mark_and_the_correction_away(self, tmp_path):
        text = joints_module(joints_of(IRB))
        first = corrected(fitted(IRB), written(tmp_path, text))
        back = corrected(fitted(IRB), written(tmp_path, first.content), direction="feedback")
        assert b"truearm" not in back.content
        np.testing.assert_allclose(numbers_of(back.content, b"j"), numbers_of(text.encode(), b"j"), atol=2e-4)

    def test_the_reverse_of_another_model_is_said(self, tmp_path):
        first = corrected(fitted(IRB), written(tmp_path, joints_module(joints_of(IRB))))
        same = corrected(fitted(IRB), written(tmp_path, first.content), direction="feedback")
        assert not any("another model" in note for note in same.notes)
        other = re.sub(rb"(truearm command )\w{8}", rb"\g<1>01234567", first.content)
        back = corrected(fitted(IRB), written(tmp_path, other), direction="feedback")
        assert "another model (01234567" in back.notes[0]

    def test_a_mark_that_the_controller_wrote_anew_is_undone(self, tmp_path):
        first = corrected(fitted(IRB), written(tmp_path, joints_module(joints_of(IRB)))).content
        saved = first.replace(b"! truearm", b"  !truearm")
        back = corrected(fitted(IRB), written(tmp_path, saved), direction="feedback").content
        assert b"!truearm undone" in back

    def test_a_configuration_changes_where_a_joint_crosses_its_border(self, tmp_path):
        model, arm = fitted(IRB), ta.load_arm(IRB)
        joints = joints_of(IRB, 1)
        moved = corrected(model, written(tmp_path, rapid_module(arm.chain, joints))).changes[0]
        change = moved.joints - moved.nominal
        # Joint 4 is just on one side of zero, and the correction brings it to the other.
        joints[0, 3] = -0.3 * change[3]
        text = rapid_module(arm.chain, joints)
        found = corrected(model, written(tmp_path, text)).changes[0]
        before, after = (f"[0,{0 if q > 0 else -1}," for q in (joints[0, 3], joints[0, 3] + change[3]))
        assert before != after
        edited = {edit.text for edit in found.edits} - set(found.numbers.values())
        assert edited == {after.split(",")[1].encode()}


class TestBorders:
    """Joints at 0, 90 and 180 deg exactly: the new configuration is that of the corrected joints, and the reverse
    finds it again."""

    def check(self, arm, file, planned, of_text):
        found = corrected(fitted(arm), file)
        assert found.is_complete
        stated = of_text(found.content)
        for change, one in zip(found.changes, stated, strict=True):
            assert one(np.degrees(change.joints)), change.target.name
        back = corrected(fitted(arm), written(file.parent, found.content, "again" + file.suffix), direction="feedback")
        assert back.is_complete
        # The digits that a target has after the correction.
        np.testing.assert_allclose([one.joints for one in back.changes], planned, atol=2e-5)

    @staticmethod
    def within(value, low, high):
        return low - 1e-3 <= value <= high + 1e-3

    def test_rapid(self, tmp_path):
        at = (-180.0, -90.0, 0.0, 90.0, 180.0)
        planned = np.radians([[first, 20.0, 10.0, q4, 60.0, q6] for first in (0.0, 90.0) for q4 in at for q6 in at])
        for below in (0.0, 1e-12):  # each of the two quadrants at the border
            text = rapid_module(ta.load_arm(IRB).chain, planned - below)

            def of_text(content):
                for cf in re.findall(rb"robtarget.*\],\[(-?\d+),(-?\d+),(-?\d+),\d\],\[9E9", content):
                    yield lambda q, cf=cf: all(
                        self.within(q[i], 90 * int(one), 90 * int(one) + 90)
                        for i, one in zip((0, 3, 5), cf, strict=True)
                    )

            self.check(IRB, written(tmp_path, text), planned, of_text)

    def test_krl(self, tmp_path):
        planned = np.radians([[0.0, -80.0, 100.0, q4, 60.0, q6] for q4 in (0.0, 90.0, -180.0) for q6 in (0.0, -90.0)])
        poses = in_work(ta.load_arm(KR).chain, planned)
        for below in (0.0, 1e-12):
            turns = [krl_turn(q) for q in np.degrees(planned) - below]
            text = krl_text([f"LIN {{{krl_frame(T)},S 2,T {t}}}" for T, t in zip(poses, turns, strict=True)])

            def of_text(content):
                for turn in re.findall(rb"T (\d+)\}", content):
                    signs = np.array([-1 if int(turn) >> i & 1 else 1 for i in range(6)])
                    yield lambda joints, signs=signs: (joints * signs > -1e-3).all()

            self.check(KR, written(tmp_path, text, "made.src"), planned, of_text)

    def test_a_reversal_in_part_is_refused(self, tmp_path):
        text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB, 3))
        content = corrected(fitted(IRB), written(tmp_path, text)).content
        # Somebody states another configuration: no posture has it.
        first = re.search(rb"p0:=.*\],\[(-?\d+,-?\d+,-?\d+,\d)\],\[9E9", content)
        changed = content[: first.start(1)] + b"3,3,3,0" + content[first.end(1) :]
        with pytest.raises(InputError, match="1 targets would keep the correction, the first p0"):
            corrected(fitted(IRB), written(tmp_path, changed), direction="feedback")


class TestRefusals:
    def test_twice_is_refused(self, tmp_path):
        first = corrected(fitted(IRB), written(tmp_path, joints_module(joints_of(IRB))))
        with pytest.raises(InputError, match="corrected already"):
            corrected(fitted(IRB), written(tmp_path, first.content))

    def test_the_program_of_another_robot_is_refused(self, tmp_path):
        joints = joints_of(KR)
        with pytest.raises(InputError, match="targets are none of 'irb2600-12-165'.*line 2|line 2.*none of"):
            corrected(fitted(IRB), written(tmp_path, joints_module(np.pi - joints)))

    def test_poses_out_of_reach_are_those_of_another_robot(self, tmp_path):
        text = rapid_module(ta.load_arm("irb6700-200-260").chain, joints_of(IRB))
        with pytest.raises(InputError, match="none of 'irb2600-12-165'"):
            corrected(fitted(IRB), written(tmp_path, text))

    @pytest.mark.parametrize(("factor", "unit"), [(25.4, "inches"), (1000.0, "m")])
    def test_a_program_that_is_within_reach_in_another_unit_is_refused_with_it(self, tmp_path, factor, unit):
        for name, text in krl_files(ta.load_arm(KR).chain, joints_of(KR), name="made").items():
            if name == "made.dat":
                lengths = re.compile(r"(?<=[XYZ] )[-\d.]+")
                text = lengths.sub(lambda found: f"{float(found[0]) / factor:.6f}", text)
            written(tmp_path, text, name)
        error = refuses("targets are none of 'kr16'", corrected, fitted(KR), tmp_path / "made.dat")
        assert f"all are if their lengths are in {unit};" in error.hint

    def test_some_targets_out_of_reach_are_no_other_unit(self, tmp_path):
        chain, planned = ta.load_arm(IRB).chain, joints_of(IRB, 6)
        lines = rapid_module(chain, planned).splitlines()
        far = [re.sub(r"\[\[[^,]*", "[[4000", line) if re.search(r" p[12]:=", line) else line for line in lines]
        found = corrected(fitted(IRB), written(tmp_path, "\n".join(far)))
        assert [one.name for one in found.refused] == ["p1", "p2"]

    def test_a_single_target_out_of_reach_stays_as_it_is(self, tmp_path):
        text = re.sub(r"(p3:=\[\[)[^,]*", r"\g<1>9000.0", rapid_module(ta.load_arm(IRB).chain, joints_of(IRB)))
        found = corrected(fitted(IRB), written(tmp_path, text))
        assert [one.name for one in found.refused] == ["p3"]
        assert not found.is_complete
        old, new = (re.search(rb"p3:=.*", content)[0] for content in (text.encode(), found.content))
        assert old == new

    @pytest.mark.parametrize(
        ("frame", "is_same"),
        [("tools.tGrip", False), ("tools.tgrip", True), ("works.wTable", False), ("works.wTable", True)],
    )
    def test_a_frame_that_the_module_has_otherwise_is_refused(self, tmp_path, frame, is_same):
        T = TOOL if "tools" in frame else WORK
        x, y, z = T[:3, 3] + (0.0 if is_same else 10.0)
        q = ", ".join(f"{one:.9f}" for one in quaternion(T[:3, :3]))
        stated = written(tmp_path, f"[{frame}]\nxyz_mm = [{x}, {y}, {z}]\nquaternion = [{q}]\n", "frames.toml")
        file = written(tmp_path, rapid_module(ta.load_arm(IRB).chain, joints_of(IRB, 2)))
        if is_same:
            assert corrected(fitted(IRB), file, frames=stated).is_complete
        else:
            with pytest.raises(InputError, match=r"otherwise than the file of --frames"):
                corrected(fitted(IRB), file, frames=stated)

    def test_outside_the_trained_range_a_target_is_refused_or_corrected(self, tmp_path):
        joints = joints_of(IRB, 8)
        joints[0, 0] = 2.9
        file = written(tmp_path, joints_module(joints))
        assert "outside the trained range" in correct_program(fitted(IRB), file).refused[0].reason
        assert corrected(fitted(IRB), file).is_complete

    def test_without_a_configuration_start_joints_choose_it(self, tmp_path):
        joints = joints_of(KR, 3)
        files = krl_files(ta.load_arm(KR).chain, joints, name="made")
        for name, text in files.items():
            written(tmp_path, re.sub(r",S \d+,T \d+", "", text), name)
        found = corrected(fitted(KR), tmp_path / "made.dat")
        assert not found.changes
        assert "--start" in found.refused[0].reason
        assert corrected(fitted(KR), tmp_path / "made.dat", start=joints.mean(axis=0)).is_complete

    def test_configurations_that_are_not_checked_are_placeholders_where_no_posture_has_them(self, tmp_path):
        planned = joints_of(IRB, 6)
        text = rapid_module(ta.load_arm(IRB).chain, planned)
        meant = numbers_of(corrected(fitted(IRB), written(tmp_path, text)).content, b"p")
        zeros = re.sub(r"\[-?\d,-?\d,-?\d,\d\],\[9E9", "[0,0,0,0],[9E9", text)
        off = zeros.replace("PROC main()\n", "PROC main()\n    ConfL\\Off;\n")
        found = corrected(fitted(IRB), written(tmp_path, off), start=planned.mean(axis=0))
        there = numbers_of(found.content, b"p")
        np.testing.assert_allclose(there[:, :3], meant[:, :3], rtol=0, atol=2e-6)  # mm: the last of six decimals
        assert any("first that of p" in note for note in found.notes)
        one_wrong = re.sub(r"(p0:=.*)\[-?\d,-?\d,-?\d,\d\],\[9E9", r"\1[0,0,-1,1],[9E9", text)
        one_wrong = one_wrong.replace("PROC main()\n", "PROC main()\n    ConfL\\Off;\n")
        left = corrected(fitted(IRB), written(tmp_path, one_wrong)).refused  # the others keep theirs
        assert [(one.name, one.reason.split(":")[0]) for one in left] == [("p0", "its configuration is not stated")]
        for checked in (zeros, off.replace("Off;", "Off;\n ConfL\\On;"), off.replace("ConfL", "ConfJ")):
            refuses("has its configuration", corrected, fitted(IRB), written(tmp_path, checked))

    def test_another_number_of_joints_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="arms of 6 turning joints"):
            corrected(fitted("panda"), written(tmp_path, joints_module(joints_of(IRB))))

    def test_a_program_in_utf_16_is_one_and_is_refused_with_its_encoding(self, tmp_path):
        file = written(tmp_path, joints_module(joints_of(IRB, 2)).encode("utf-16"))
        assert is_program(file)
        assert "UTF-16" in refuses("no known language", corrected, fitted(IRB), file).hint

    def test_a_file_of_no_language_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="a program of no known language"):
            corrected(fitted(IRB), written(tmp_path, "G0 X1 Y2\n"))


class TestPayload:
    """An arm whose joints give way under a payload, 0 or 5 kg in training: up to some tenths of a millimetre."""

    @pytest.fixture
    def sagging(self):
        arm, angles = ta.load_arm(IRB), joints_of(IRB, 120, seed=4)
        state = ArmState.of(arm, angles, columns={"payload_kg": np.resize([0.0, 5.0], len(angles))})
        own_axis = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        terms = tuple(Term(f"J{j}", j, own_axis, PayloadTorque(j, 2), "planted", 1e-5) for j in (2, 3))
        tips = PerturbedChain(arm.chain, terms).tips(state, np.array([8e-6, 8e-6]))  # [rad/(N m)]
        noise = np.random.default_rng(5).normal(0, 0.01, tips.shape)
        return PhysicalModel(arm, highest=1).fit_readings(Session(angles, tips + noise, columns=dict(state.columns)))

    def test_it_is_assumed_and_said_or_stated_with_the_frames(self, tmp_path, sagging):
        file, planned = written(tmp_path, joints_module(joints_of(IRB, 4))), joints_of(IRB, 4)
        table = pd.DataFrame(np.degrees(planned), columns=[f"q{i}_deg" for i in range(1, 7)])
        said = "Taken at the training mean, as the targets do not state it: payload_kg (0."
        assert said in str(corrected(sagging, file))
        assert said in str(ta.correct(sagging, table, untrained="accept"))
        points = [{"positions": row.tolist()} for row in planned]
        trajectory = {"joint_names": [f"joint_{i}" for i in range(1, 7)], "points": points}
        of_file = ta.correct(sagging, written(tmp_path, json.dumps(trajectory), "made.yaml"), untrained="accept")
        assert "State it in a table of targets, as this file has no place for it." in str(of_file)
        of_table = ta.correct(sagging, table.assign(payload_kg=5.0), untrained="accept")
        of_program = corrected(sagging, file, frames=written(tmp_path, "payload_kg = 5.0\n", "frames.toml"))
        for one in (of_table, of_program):
            assert said not in str(one)
        there = np.array([change.joints for change in of_program.changes])
        np.testing.assert_allclose(
            there, of_table.joints, rtol=0, atol=2e-6
        )  # rad: the module has four decimals of deg


class TestMoves:
    def test_a_straight_move_between_corrected_ends_is_looked_at(self, tmp_path):
        planned = joints_of(IRB, 2)
        text = rapid_module(ta.load_arm(IRB).chain, planned)
        (note,) = corrected(fitted(IRB), written(tmp_path, text)).notes
        stated = float(re.search(r"at most (\S+) mm \(line 8\)", note)[1])
        # The same target corrected half way: how far it is from the middle of the corrected ends.
        poses = in_work(ta.load_arm(IRB).chain, planned)
        ends = corrected(fitted(IRB), tmp_path / "made.mod").content
        middle = self.between(*poses)
        near = planned.mean(axis=0)
        chain = ta.load_arm(IRB).chain.with_tip(np.zeros(3))
        from truearm.arm.inverse_kinematics import solve_inverse_kinematics

        flange = WORK @ middle @ np.linalg.inv(TOOL)
        solved = solve_inverse_kinematics(
            chain, flange[None, :3, 3], R_base_tip=flange[None, :3, :3], start=near
        ).angles
        half = corrected(fitted(IRB), written(tmp_path, rapid_module(ta.load_arm(IRB).chain, solved))).content
        new = numbers_of(half, b"p")[0, :3]
        away = np.linalg.norm(new - numbers_of(ends, b"p")[:, :3].mean(axis=0))
        assert 0 < away < 1.001 * stated + 0.001

    @staticmethod
    def between(T, T_end):
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_matrix(T_end[:3, :3] @ T[:3, :3].T).as_rotvec()
        middle = (T + T_end) / 2
        middle[:3, :3] = Rotation.from_rotvec(turn / 2).as_matrix() @ T[:3, :3]
        return middle


KRL_CELL = f"TOOL_DATA[3]={{{krl_frame(TOOL)}}}\nBASE_DATA[2]={{{krl_frame(WORK)}}}\nBAS(#TOOL,3)\nBAS(#BASE,2)\n"


def pose_text(T):
    return f"p[{','.join(f'{one:.9f}' for one in pose_numbers(T, [0.0] * 6))}]"


def krl_text(lines):
    return "\n".join(["DEF made( )", KRL_CELL + "\n".join(lines), "END", ""])


class TestConfigurationOfThePath:
    """A straight move of KRL keeps the configuration; a target without S and T has that of the one before it."""

    def lines(self, joints, first="", rest=""):
        poses = in_work(ta.load_arm(KR).chain, joints)
        lines = [f"LIN {{{krl_frame(T)}{rest}}}" for T in poses]
        return [first, *lines] if first else lines

    def path(self, flipped=False):
        """Joints along a straight path, each 60 mm from the last."""
        near = joints_of(KR, 1, seed=4)[0]
        if flipped:  # the other set of wrist angles
            near[3:] = [
                near[3] + np.pi * (-1 if near[3] > 0 else 1),
                -near[4],
                near[5] + np.pi * (-1 if near[5] > 0 else 1),
            ]
        return np.array([near + share * np.array([0.05, 0.02, 0.02, 0.0, 0.0, 0.0]) for share in range(12)])

    @pytest.mark.parametrize("flipped", [False, True])
    def test_it_is_that_of_joints_at_its_start(self, tmp_path, flipped):
        planned = self.path(flipped)
        axes = ",".join(f"A{i} {q:.6f}" for i, q in enumerate(np.degrees(planned[0]), 1))
        text = krl_text(self.lines(planned[1:], f"PTP {{{axes}}}"))
        found = corrected(fitted(KR), written(tmp_path, text, "made.src"))
        assert found.is_complete
        # Six decimals of mm and deg.
        np.testing.assert_allclose([one.nominal for one in found.changes], planned, atol=1e-6)

    @pytest.mark.parametrize("between", ["IF $IN[1] THEN\nENDIF", "MOVE_AWAY()", "MARK:", "LIN_REL {Z 5}"])
    def test_where_the_arm_may_come_from_elsewhere_it_is_to_be_stated(self, tmp_path, between):
        planned = self.path()
        axes = ",".join(f"A{i} {q:.6f}" for i, q in enumerate(np.degrees(planned[0]), 1))
        text = krl_text([f"PTP {{{axes}}}", between, "BAS(#TOOL,3)", "BAS(#BASE,2)", *self.lines(planned[1:])])
        file = written(tmp_path, text, "made.src")
        found = corrected(fitted(KR), file)
        assert len(found.changes) == 1
        assert "--start" in found.refused[0].reason
        assert corrected(fitted(KR), file, start=planned[1]).is_complete

    def test_a_start_at_a_singular_pose_chooses_none(self, tmp_path):
        planned = self.path()
        axes = "A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0"
        text = krl_text(self.lines(planned[1:], f"PTP {{{axes}}}"))
        found = corrected(fitted(KR), written(tmp_path, text, "made.src"))
        assert "--start" in found.refused[1].reason

    def test_a_move_in_a_circle_of_targets_has_no_start(self, tmp_path):
        lines = self.lines(self.path()[:2])
        points = [f"DECL POS P{i}={line[4:]}" for i, line in enumerate(lines)]
        text = krl_text([*points, "LIN P0", "LIN P1", "LIN P0", "LIN P1"])
        found = corrected(fitted(KR), written(tmp_path, text, "made.src"))
        assert not found.changes


# What is changed in a program, and why its second move is then not divided.
RAPID_CHANGES = {
    "a variable": ("CONST robtarget p1", "VAR robtarget p1", "its target may have several values"),
    "an assignment": ("    MoveL p2", "    p1:=p2;\n    MoveL p2", "several values"),
    "a parameter of its name": ("ENDMODULE", "  PROC b(robtarget p1)\n  ENDPROC\nENDMODULE", "several values"),
    "a local one": ("ENDMODULE", "  PROC b()\n    CONST robtarget p1:=p2;\n  ENDPROC\nENDMODULE", "several values"),
    "an IF without THEN": ("    MoveL p0", "    IF di1=1 MoveL p0", "comes from"),
    "a computed procedure": ("    MoveL p1", '    %"Away"%;\n    MoveL p1', "comes from"),
    "a function": ("    MoveL p1", "    x:=Away(1);\n    MoveL p1", "comes from"),
    "a search": ("    MoveL p0,", "    SearchL di1,ps,p0,", "comes from"),
    "a displacement": ("    MoveL p0", "    PDispSet pd;\n    MoveL p0", "shifted while"),
    "a tool that changes": ("    MoveL p0", "    tGrip:=tOther;\n    MoveL p0", "tool or work object changes"),
}
KRL_CHANGES = {
    "a trigger": ("TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[1]=TRUE\n", "", "what the line before it does"),
    "a continue": ("CONTINUE\n", "", "what the line before it does"),
    "a call": ("MSG_AWAY()\n", "", "what the line before it does"),
    "a fold": (";FOLD LIN P2 Vel=2 m/s CPDAT1\n", "\n;ENDFOLD", "in a fold"),
    "an orientation": ("$ORI_TYPE=#JOINT\n", "", "ORI_TYPE"),
}
UR_CHANGES = {
    "a call": ("  teach_mode()\n", "comes from"),
    "an unknown call": ("  rtde_move()\n", "comes from"),
    "a speed": ("  speedl([0,0,0.1,0,0,0],0.5,1)\n", "comes from"),
    "a value of a call": ("  x = away()\n", "comes from"),
    "another value": ("  P_2_p = P_1_p\n", ""),
}


class TestSubdivision:
    """Further targets between two, so that the tip keeps to the straight line."""

    def programs(self):
        arm = ta.load_arm(KR)
        planned = joints_of(KR, 3, seed=3)
        lines = [
            f"  LIN {{{krl_frame(T)},S 2,T {krl_turn(q)}}} C_VEL ; seam"
            for T, q in zip(in_work(arm.chain, planned), np.degrees(planned), strict=True)
        ]
        rapid = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB, 3))
        ur = joints_of_ur("ur10", 3)
        script = polyscope_script(ta.load_arm("ur10").chain, ur, tool=TOOL).replace("movej", "movel")
        return {
            "rapid": (IRB, rapid, "made.mod"),
            "krl": (KR, krl_text(lines), "made.src"),
            "urscript": ("ur10", script, "made.script"),
        }

    @pytest.mark.parametrize(
        ("kind", "end"),
        [
            *(("rapid", "\n"), ("krl", "\r\n"), ("urscript", "\n")),
            *(pytest.param(kind, "\r\n", marks=pytest.mark.weekly) for kind in ("rapid", "urscript")),
            pytest.param("krl", "\n", marks=pytest.mark.weekly),
        ],
    )
    def test_the_tip_keeps_to_the_line_and_every_other_byte_stays(self, tmp_path, kind, end):
        arm, text, name = self.programs()[kind]
        options = {}
        if kind == "urscript":
            options["frames"] = written(tmp_path, 'controller = "nominal"', "frames.toml")
        file = written(tmp_path, text.replace("\n", end), name)
        plain = corrected(fitted(arm), file, **options)
        found = corrected(fitted(arm), file, subdivide_mm=25.0, **options)
        before, after = (float(re.search(r"at most (\S+) mm \(line", note)[1]) for note in found.notes[-2:])
        # A parabola between two ends: a distance n times shorter is off by n^2 times less, but for the digits.
        assert after < before / 20 + 2e-3
        n = int(re.search(r"With (\d+) targets", found.notes[-1])[1])
        old, new = plain.content.splitlines(keepends=True), found.content.splitlines(keepends=True)
        assert len(new) == len(old) + n
        rest = iter(new)
        assert all(line in rest for line in old)  # in their order
        zone = {"rapid": b",z5,", "krl": b"} C_DIS", "urscript": b", r=0.005)"}[kind]
        assert sum(zone in line for line in new) == n
        again = corrected(
            fitted(arm), written(tmp_path, found.content, "again" + name[4:]), direction="feedback", **options
        )
        assert len(again.changes) == len(plain.changes) + n

    def test_the_added_targets_divide_the_lines_evenly(self, tmp_path):
        arm, text, _ = self.programs()["rapid"]
        found = corrected(fitted(arm), written(tmp_path, text), subdivide_mm=40.0)
        points = numbers_of(found.content, b"p")[:, :3]
        rows = re.findall(rb"MoveL \[\[([^\]]*)\]", found.content)
        added = np.array([[float(one) for one in row.split(b",")] for row in rows])
        lengths = [int(np.ceil(np.linalg.norm(b - a) / 40.0)) for a, b in pairwise(points)]
        shares = [np.arange(1, n) / n for n in lengths]
        even = np.concatenate([a + s[:, None] * (b - a) for s, (a, b) in zip(shares, pairwise(points), strict=True)])
        np.testing.assert_allclose(added, even, atol=0.2)  # [mm]: what the correction changes over the line

    def test_what_is_not_divided_is_said(self, tmp_path):
        arm, text, _ = self.programs()["rapid"]
        text = text.replace("    MoveL p1", "    IF TRUE Stop;\n    MoveL p1")
        found = corrected(fitted(arm), written(tmp_path, text), subdivide_mm=25.0)
        assert "Not divided: line 8, 10 (not certain where the arm comes from)" in found.notes[-1]

    @pytest.mark.parametrize("what", RAPID_CHANGES)
    def test_a_move_of_rapid_whose_ends_are_not_certain_is_not_divided(self, tmp_path, what):
        old, new, reason = RAPID_CHANGES[what]
        arm, text, _ = self.programs()["rapid"]
        assert old in text
        text = text.replace(old, new, 1)
        found = corrected(fitted(arm), written(tmp_path, text), subdivide_mm=100.0)
        assert reason in found.notes[-1].partition("Not divided")[2]
        assert not re.search(rb"MoveL \[\[[^\r\n]*\s*MoveL p1,", found.content)

    @pytest.fixture(scope="class")
    @classmethod
    def n_between(cls, tmp_path_factory):
        """Targets between those of the program of each language, where all its moves are divided."""
        folder, counted = tmp_path_factory.mktemp("plain"), {}
        frames = {"urscript": written(folder, 'controller = "nominal"', "frames.toml")}
        for kind, mark in (("krl", b"C_DIS"), ("urscript", b"r=0.005")):
            arm, text, name = cls().programs()[kind]
            file = written(folder, text, name)
            found = corrected(fitted(arm), file, subdivide_mm=100.0, frames=frames.get(kind))
            counted[kind] = found.content.count(mark)
        return counted

    @pytest.mark.parametrize("what", KRL_CHANGES)
    def test_a_move_of_krl_with_something_before_it_is_not_divided(self, tmp_path, n_between, what):
        before, after, reason = KRL_CHANGES[what]
        arm, text, _ = self.programs()["krl"]
        lines = text.split("\n")
        at = [i for i, line in enumerate(lines) if "LIN" in line][1]
        lines[at] = before + lines[at] + after
        found = corrected(fitted(arm), written(tmp_path, "\n".join(lines), "made.src"), subdivide_mm=100.0)
        assert reason in found.notes[-1].partition("Not divided")[2]
        assert found.content.count(b"C_DIS") < n_between["krl"]

    def test_a_point_of_krl_that_gets_two_values_is_no_end(self, tmp_path):
        arm, text, _ = self.programs()["krl"]
        poses = re.findall(r"LIN (\{.*\})", text)
        body = f"W={poses[1]}\nLIN {poses[0]}\nLIN W\nW={poses[2]}\nLIN W"
        text = krl_text(["DECL POS W", *body.split("\n")])
        found = corrected(fitted(arm), written(tmp_path, text, "made.src"), subdivide_mm=100.0)
        assert found.changes
        assert b"C_DIS" not in found.content

    @pytest.mark.parametrize("what", UR_CHANGES)
    def test_a_move_of_urscript_after_something_else_is_not_divided(self, tmp_path, n_between, what):
        before, reason = UR_CHANGES[what]
        arm, text, _ = self.programs()["urscript"]
        frames = written(tmp_path, 'controller = "nominal"', "frames.toml")
        moves = list(re.finditer(r"(?m)^ *movel", text))
        text = text[: moves[1].start()] + before + text[moves[1].start() :]
        found = corrected(fitted(arm), written(tmp_path, text, "made.script"), subdivide_mm=100.0, frames=frames)
        assert reason in found.notes[-1].partition("Not divided")[2]
        assert found.content.count(b"r=0.005") < n_between["urscript"]

    def test_blends_that_would_overlap_are_left_as_they_are(self, tmp_path):
        arm, text, _ = self.programs()["urscript"]
        frames = written(tmp_path, 'controller = "nominal"', "frames.toml")
        text = re.sub(r"(?m)^( *movel\(.*)\)", r"\1, r=0.9)", text)
        found = corrected(fitted(arm), written(tmp_path, text, "made.script"), subdivide_mm=100.0, frames=frames)
        assert "blends" in found.notes[-1]
        assert b"r=0.005" not in found.content

    def test_a_list_of_several_values_has_no_certain_goal(self, tmp_path):
        arm, text, _ = self.programs()["urscript"]
        frames = written(tmp_path, 'controller = "nominal"', "frames.toml")
        poses = re.findall(r"=\s*(p\[.*\])", text)[-3:]
        body = f"  movel({poses[0]})\n  w = {poses[1]}\n  movel(w)\n  w = {poses[2]}\n  movel(w)\n"
        start = ",".join(map(str, joints_of_ur("ur10", 3)[0]))
        text = f"def made():\n  movej([{start}])\n{body}end\n"
        tool = pose_text(TOOL)
        text = text.replace("():\n", f"():\n  set_tcp({tool})\n")
        found = corrected(fitted(arm), written(tmp_path, text, "made.script"), subdivide_mm=100.0, frames=frames)
        assert found.changes
        assert b"r=0.005" not in found.content

    def test_a_path_on_which_a_joint_jumps_is_not_divided(self):
        still = np.linspace(0.0, 0.5, 17)[:, None] * np.ones(6)
        nominal = still[[0, -1]]
        path = subdivision._Path(PathEnds(0, 1, 1), Move(1, "linear", 1), 4, 4)
        assert subdivision._jump(path, nominal, still[1:-1], still[1:-1]) == ""
        jumping = still.copy()
        jumping[9:, 0] -= 1.15  # J1 from +31 to -35 deg
        assert "jump" in subdivision._jump(path, jumping[[0, -1]], jumping[1:-1], jumping[1:-1])
        assert "jump" in subdivision._jump(path, nominal, still[1:-1], still[1:-1] + 0.2)

    @pytest.mark.parametrize(
        ("options", "problem"),
        [
            ({"subdivide_mm": 0.5}, "at least 1 mm"),
            ({"subdivide_mm": float("nan")}, "at least 1 mm"),
            ({"subdivide_mm": 50.0, "direction": "feedback"}, "direction command only"),
        ],
    )
    def test_a_subdivision_that_cannot_be_is_refused(self, tmp_path, options, problem):
        arm, text, _ = self.programs()["rapid"]
        with pytest.raises(InputError, match=problem):
            corrected(fitted(arm), written(tmp_path, text), **options)

    def test_a_language_that_takes_no_further_target_says_why(self, tmp_path):
        text = "/PROG  MADE\n/MN\n   1:J P[1] 100% FINE ;\n/POS\n/END\n"
        with pytest.raises(InputError, match=r"no target can be added to a Fanuc TP listing: the lines of /MN"):
            corrected(fitted("lrmate200id"), written(tmp_path, text, "made.ls"), subdivide_mm=50.0)


class TestCommand:
    @pytest.fixture
    def model(self, tmp_path):
        fitted(IRB).save(tmp_path / "irb.truearm")
        return tmp_path / "irb.truearm"

    def test_a_program_is_recognised_and_written(self, tmp_path, model, truearm):
        file = written(tmp_path, rapid_module(ta.load_arm(IRB).chain, joints_of(IRB)))
        out = tmp_path / "new.mod"
        printed = truearm("correct", model, file, "--out", out, "--untrained", "accept", "--diff").done().out
        assert printed.startswith("20 of 20 targets corrected (ABB RAPID)")
        assert "change [mm]" in printed
        assert out.read_bytes() == corrected(fitted(IRB), file).content

    def test_json_names_every_target(self, tmp_path, model, truearm):
        file, out = written(tmp_path, rapid_module(ta.load_arm(IRB).chain, joints_of(IRB))), tmp_path / "new.mod"
        printed = truearm("correct", model, file, "--out", out, "--untrained", "accept", "--json").done().out
        assert [one["target"] for one in json.loads(printed)["corrected"]] == [f"p{i}" for i in range(20)]

    def test_what_is_not_stated_is_listed_and_the_exit_code_says_so(self, tmp_path, model, truearm):
        text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB)).replace(",tGrip\\", ",tOther\\", 1)
        file, out = written(tmp_path, text), tmp_path / "new.mod"
        ran = truearm("correct", model, file, "--out", out, "--untrained", "accept")
        assert ran.code == 1
        assert "line 4, p0: the tool tOther is not in this module: state it in --frames" in ran.out

    def test_frames_are_stated_in_a_file(self, tmp_path, model, truearm):
        text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB)).replace("tGrip:=", "tElse:=")
        frames = written(tmp_path, "[tools.tGrip]\nxyz_mm = [35, -20, 140]\nwpr_deg = [0, 90, 0]\n", "frames.toml")
        file, out = written(tmp_path, text), tmp_path / "new.mod"
        truearm("correct", model, file, "--out", out, "--untrained", "accept", "--frames", frames).done()
        original = written(tmp_path, rapid_module(ta.load_arm(IRB).chain, joints_of(IRB)), "other.mod")
        assert out.read_bytes() == corrected(fitted(IRB), original).content.replace(b"tGrip:=", b"tElse:=")

    @pytest.mark.parametrize(
        ("options", "problem"),
        [
            (["--as", "rapid"], "--as does not apply to a robot program"),
            (["--tool", "0,0,1"], "--tool does not apply to a robot program"),
            (["--frame", "base"], "--frame does not apply to a robot program"),
            (["--no-uncertainty"], "does not apply to a robot program"),
            (["--conditions", "repeatability"], "--conditions does not apply to a robot program"),
            (["--out", "new.csv"], ".mod"),
        ],
    )
    def test_options_of_tables_are_refused(self, tmp_path, model, refused, options, problem):
        file = written(tmp_path, joints_module(joints_of(IRB)))
        refused(["correct", model, file, "--out", tmp_path / "new.mod", *options], problem)

    def test_a_program_of_another_maker_is_refused(self, tmp_path, model, refused):
        text = b"DEF made()\nPTP {A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0}\nEND\n"
        file = written(tmp_path, text, "made.src")
        refused(
            ["correct", model, file, "--out", tmp_path / "new.src"],
            "the program is one of KUKA KRL, the model that of ABB IRB 2600-12/1.65",
        )

    @pytest.mark.parametrize(("options", "name"), [(["--frames", "f.toml"], "--frames"), (["--diff"], "--diff")])
    def test_options_of_programs_are_refused_with_a_table(self, tmp_path, model, refused, options, name):
        table = written(tmp_path, "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,15,0,60,0\n", "t.csv")
        refused(
            ["correct", model, table, "--out", tmp_path / "c.csv", *options], f"{name} applies to robot programs only"
        )

    def test_a_corrected_program_is_replaced_and_no_other(self, tmp_path, model, truearm, refused):
        file, out = written(tmp_path, joints_module(joints_of(IRB))), tmp_path / "new.mod"
        for _ in range(2):
            truearm("correct", model, file, "--out", out, "--untrained", "accept").done()
        other = written(tmp_path, joints_module(joints_of(IRB)), "other.mod")
        refused(["correct", model, file, "--out", other], "no program that truearm has corrected")

    def test_a_target_without_a_name_is_named_with_its_line_once(self, tmp_path, truearm):
        model = tmp_path / "kr16.truearm"
        fitted("kr16").save(model)
        text = b"DEF made()\n\nLIN {X 900,Y 0,Z 900,A 0,B 90,C 0}\nEND\n"
        ran = truearm("correct", model, written(tmp_path, text, "made.src"), "--out", tmp_path / "new.src")
        assert "not corrected: line 3, LIN: " in ran.out

    def test_a_program_without_numbers_of_its_own_is_not_corrected(self, tmp_path, model, truearm):
        file = written(tmp_path, "MODULE Made\nPROC main()\nMoveL pFar,v1,fine,tGrip;\nENDPROC\nENDMODULE\n")
        ran = truearm("correct", model, file, "--out", tmp_path / "new.mod")
        assert ran.code == 3
        assert "None of 0 targets corrected" in ran.out
        assert not (tmp_path / "new.mod").exists()

    def test_nothing_is_written_where_nothing_is_corrected(self, tmp_path, model, truearm):
        text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB)).replace(",tGrip\\", ",tOther\\")
        ran = truearm("correct", model, written(tmp_path, text), "--out", tmp_path / "new.mod", "--diff")
        assert ran.code == 3
        assert "None of 20 targets corrected" in ran.out
        assert "the new program" not in ran.out
        assert "change [mm]" not in ran.out
        assert not (tmp_path / "new.mod").exists()

    def test_a_truncated_program_leaves_nothing(self, tmp_path, model, refused):
        text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB))[:900]
        refused(["correct", model, written(tmp_path, text), "--out", tmp_path / "new.mod"], "cut off")


@pytest.mark.parametrize(("z", "is_said"), [("0.1205", True), ("120.5", False), ("0", False)])
def test_a_tool_in_metres_is_remarked(tmp_path, z, is_said):
    """The controller takes it for 0.12 mm, and all targets for those of the flange."""
    module = f"""MODULE Made
PERS tooldata tGrip:=[TRUE,[[0,0,{z}],[1,0,0,0]],[1.2,[0,0,60],[1,0,0,0],0,0,0]];
CONST jointtarget jHome:=[[0,0,15,0,60,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PROC main()
MoveAbsJ jHome,v1000,z50,tGrip;
ENDPROC
ENDMODULE
"""
    notes = corrected(fitted(IRB), written(tmp_path, module)).notes
    said = "The tool of jHome is 0.1205 mm long: correct it if it was meant in metres."
    assert (said in notes) is is_said
    assert len(notes) == is_said


def test_a_work_frame_in_metres_is_remarked(tmp_path):
    text = rapid_module(ta.load_arm(IRB).chain, joints_of(IRB, 2), work=np.eye(4))
    moved = text.replace('TRUE,"",[[0.000000,0.000000,0.000000]', 'TRUE,"",[[0.9,-0.2,0.4]')
    assert moved != text
    said = "The work frame of p0 is 1.005 mm from the base: correct it if it was meant in metres."
    assert said in corrected(fitted(IRB), written(tmp_path, moved)).notes
    assert not any("metres" in note for note in corrected(fitted(IRB), written(tmp_path, text)).notes)
