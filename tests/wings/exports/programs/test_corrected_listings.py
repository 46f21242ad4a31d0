"""Corrected programs of Fanuc, Universal Robots and Yaskawa bring the tip to the pose that the program means."""

import gzip
import re
from dataclasses import replace

import numpy as np
import pytest
from made_up_listings import (
    FRAMES,
    PULSES,
    TOOL,
    WORK,
    calibrated,
    calibration_yaml,
    fanuc_block,
    fanuc_joint_block,
    fanuc_program,
    fitted,
    flange_poses,
    in_work,
    joints_of,
    kinematics_node,
    listed,
    old_waypoint,
    polyscope_program,
    polyscope_script,
    pose_numbers,
    waypoint,
    yaskawa_job,
    yaskawa_pose,
    yaskawa_pulses,
)
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.arm import Chain
from truearm.arm.couplings import parse_coupling
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.errors import InputError
from truearm.wings.exports.programs.controllers import with_controller
from truearm.wings.exports.programs.correct_program import correct_program
from truearm.wings.exports.programs.urscript import pose_matrix
from truearm.wings.exports.targets.pose_models import nominal_poses, poses_of, with_tool
from truearm.wings.exports.targets.targets import Targets

N = 40
RPY_TOOL = (35.0, -20.0, 140.0, 0.0, np.pi / 2, 0.0)


def corrected(tmp_path, model, content, name, frames=FRAMES, **options):
    """The new bytes of a program, and the record of its correction."""
    (tmp_path / name).write_bytes(content)
    (tmp_path / "frames.toml").write_text(frames)
    found = correct_program(model, tmp_path / name, frames=tmp_path / "frames.toml", untrained="accept", **options)
    return found.content, found


def tip_errors(model, planned, sent, controller=None):
    """Distance [mm] and turn [deg] from the pose meant to that of the arm when it is sent joints of the controller."""
    equipped = with_tool(model if controller is None else with_controller(model, controller), np.array(RPY_TOOL))
    rows = np.arange(len(sent))
    meant = nominal_poses(equipped).pose(planned, rows)
    there = poses_of(equipped, Targets.of_joints(sent).session(sent)).pose(sent, rows)
    turn = Rotation.from_matrix(np.swapaxes(meant.R_base_tip, 1, 2) @ there.R_base_tip).magnitude()
    return np.linalg.norm(meant.tip_in_base - there.tip_in_base, axis=1), np.degrees(turn)


def joints_at(chain, flange, start):
    """Joints of a controller at poses of its flange, by the general inverse kinematics."""
    plain = Chain(chain.fixed, np.zeros(3))
    found = solve_inverse_kinematics(plain, flange[:, :3, 3], R_base_tip=flange[:, :3, :3], start=start)
    assert found.reached.all()
    return found.angles


def numbers(pattern, text):
    """Six numbers of every place of a pattern."""
    return np.array(
        [[float(one) for one in re.findall(r"-?\d*\.?\d+(?:[eE]-?\d+)?", found)] for found in re.findall(pattern, text)]
    )


def pose_of_wpr(values):
    T = np.tile(np.eye(4), (len(values), 1, 1))
    T[:, :3, :3] = Rotation.from_euler("xyz", values[:, 3:], degrees=True).as_matrix()
    T[:, :3, 3] = values[:, :3]
    return T


def fanuc_text(arm, joints):
    chain = fitted(arm).arm_.chain
    blocks = [
        fanuc_block(i, T, np.degrees(q)) for i, (T, q) in enumerate(zip(in_work(chain, joints), joints, strict=True), 1)
    ]
    return fanuc_program(blocks, [f"L P[{i}] 100mm/sec FINE   " for i in range(1, len(joints) + 1)])


def yaskawa_text(arm, joints):
    chain = fitted(arm).arm_.chain
    lines = ["///USER 1", "///TOOL 3", "///POSTYPE USER", "///RECTAN"]
    for i, (T, q) in enumerate(zip(in_work(chain, joints), joints, strict=True)):
        no_flip = int(abs(np.degrees(q[3])) > 90)
        lines += [f"///RCONF {no_flip},0,0,0,0,0,0,0", yaskawa_pose(f"C{i:05d}", T)]
    return yaskawa_job(lines, [f"MOVL C{i:05d} V=10.0" for i in range(len(joints))])


class TestFanuc:
    def test_cartesian_points_bring_the_tip_to_the_pose_meant(self, tmp_path):
        model, planned = fitted("lrmate200id"), joints_of("lrmate200id", N)
        text, found = corrected(tmp_path, model, fanuc_text("lrmate200id", planned).encode(), "a.ls")
        assert len(found.changes) == N
        values = numbers(r"X =[^}]*deg", text.decode())
        sent = joints_at(model.arm_.chain, WORK @ pose_of_wpr(values) @ np.linalg.inv(TOOL), planned)
        mm, deg = tip_errors(model, planned, sent)
        # Twice half of the last digit of the file, once read and once written: 1e-3 mm, and 1e-3 deg over 1 m.
        assert mm.max() < 0.03
        assert deg.max() < 0.005

    def test_joints_count_j3_from_the_horizontal(self, tmp_path):
        model, planned = fitted("lrmate200id"), joints_of("lrmate200id", N)
        pendant = planned.copy()
        pendant[:, 2] -= planned[:, 1]
        blocks = [fanuc_joint_block(i, q) for i, q in enumerate(np.degrees(pendant), 1)]
        moves = [f"J P[{i}:rest] 100% CNT50   " for i in range(1, N + 1)]
        text, found = corrected(tmp_path, model, fanuc_program(blocks, moves).encode(), "a.ls")
        assert len(found.changes) == N
        sent = np.radians(numbers(r"J1=[^}]*deg", text.decode())[:, 1::2])
        sent[:, 2] += sent[:, 1]
        mm, deg = tip_errors(model, planned, sent)
        assert mm.max() < 0.03
        assert deg.max() < 0.005

    def test_a_model_of_the_pendants_j3_writes_the_same_program(self, tmp_path):
        arm, session = ta.load_arm("lrmate200id"), ta.simulate("lrmate200id", poses=60, seed=1).session
        coupled = replace(arm, chain=replace(arm.chain, coupling=parse_coupling("J3+=J2", 6)))
        pendant = session.angles.copy()
        pendant[:, 2] -= session.angles[:, 1]
        of_pendant = ta.fit(coupled, replace(session, angles=pendant), model="kinematic").model
        text = fanuc_text("lrmate200id", joints_of("lrmate200id", N)).encode()
        programs = [corrected(tmp_path, one, text, "a.ls")[0] for one in (fitted("lrmate200id"), of_pendant)]
        old, new = (re.sub(rb"truearm command \w+", b"", program) for program in programs)
        assert old == new

    def test_a_joint_that_crosses_half_a_turn_has_its_new_turn_in_the_configuration(self, tmp_path):
        model, planned = fitted("lrmate200id"), joints_of("lrmate200id", 12)
        planned[:, 5] = np.radians(180.0) * np.where(np.arange(12) % 2, -1, 1) * (1 - 1e-6)
        text, found = corrected(tmp_path, model, fanuc_text("lrmate200id", planned).encode(), "a.ls")
        turned = {round(change.joints[5] / (2 * np.pi)) for change in found.changes}
        written = {int(one) for one in re.findall(r"CONFIG : 'N U T, 0, 0, (-?\d)'", text.decode())}
        assert written == turned
        assert len(written) > 1


class TestYaskawa:
    def test_poses_bring_the_tip_to_the_pose_meant(self, tmp_path):
        model, planned = fitted("gp7"), joints_of("gp7", N)
        text, found = corrected(tmp_path, model, yaskawa_text("gp7", planned).encode(), "a.jbi")
        assert len(found.changes) == N
        values = numbers(r"(?m)^C\d{5}=([^\r]*)", text.decode())
        sent = joints_at(model.arm_.chain, WORK @ pose_of_wpr(values) @ np.linalg.inv(TOOL), planned)
        mm, deg = tip_errors(model, planned, sent)
        assert mm.max() < 0.003  # the digits of the file, of which the angles have four
        assert deg.max() < 0.001

    def test_pulses_stay_whole(self, tmp_path):
        model, planned = fitted("gp7"), joints_of("gp7", N)
        lines = ["///TOOL 3", "///POSTYPE PULSE", "///PULSE"]
        lines += [yaskawa_pulses(f"C{i:05d}", q) for i, q in enumerate(planned)]
        job = yaskawa_job(lines, [f"MOVJ C{i:05d} VJ=10.00" for i in range(N)])
        text, found = corrected(tmp_path, model, job.encode(), "a.jbi")
        assert len(found.changes) == N
        points = re.findall(r"(?m)^C\d{5}=([^\r]*)", text.decode())
        assert all(re.fullmatch(r"-?\d+(,-?\d+){5}", one) for one in points)
        sent = np.radians(numbers(r"(?m)^C\d{5}=([^\r]*)", text.decode()) / PULSES)
        mm, _ = tip_errors(model, planned, sent)
        # A pulse of 1/700 deg is 0.025 mm at 1 m; half of it twice, for six joints.
        assert mm.max() < 0.05


class TestUniversalRobots:
    def test_a_pair_of_pose_and_joints_is_corrected_together(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", N)
        script = polyscope_script(model.arm_.chain, planned)
        text, found = corrected(tmp_path, model, script.encode(), "a.script")
        assert len(found.changes) == N
        assert not found.left
        sent = numbers(r"P_\d+_q=\[(.*)\]", text.decode())
        mm, deg = tip_errors(model, planned, sent)
        assert mm.max() < 1e-5  # a nanometre of rounding in twelve decimals, and the tolerance of the correction
        assert deg.max() < 1e-6
        poses = numbers(r"P_\d+_p=p\[(.*)\]", text.decode())
        there = [pose_numbers(T) for T in flange_poses(model.arm_.chain, sent) @ TOOL]
        same = Rotation.from_rotvec(poses[:, 3:]).inv() * Rotation.from_rotvec(np.array(there)[:, 3:])
        np.testing.assert_allclose(poses[:, :3], np.array(there)[:, :3], rtol=0, atol=2e-12)
        assert same.magnitude().max() < 1e-11

    def test_the_yaml_of_the_robot_states_what_its_controller_computes_with(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", N)
        (tmp_path / "mine.yaml").write_text(calibration_yaml())
        frames = FRAMES.replace('"nominal"', '"mine.yaml"')
        script = polyscope_script(calibrated(), planned)
        text, found = corrected(tmp_path, model, script.encode(), "a.script", frames)
        assert len(found.changes) == N
        mm, _ = tip_errors(model, planned, numbers(r"P_\d+_q=\[(.*)\]", text.decode()), calibrated())
        assert mm.max() < 1e-5
        of_drawing = tip_errors(model, planned, numbers(r"P_\d+_q=\[(.*)\]", text.decode()))[0]
        assert of_drawing.min() > 0.1  # the other meaning differs by the calibration

    def test_joints_and_pose_of_other_kinematics_disagree(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", 3)
        (tmp_path / "mine.yaml").write_text(calibration_yaml())
        script = polyscope_script(model.arm_.chain, planned)
        frames = FRAMES.replace('"nominal"', '"mine.yaml"')
        said = "3 of 3 points contradict themselves, the first P_1_p: its joints and its pose disagree by"
        refuses(said, corrected, tmp_path, model, script.encode(), "a.script", frames)

    def test_a_pair_that_disagrees_with_the_drawing_is_not_that_of_a_nominal_controller(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", 3)
        script = polyscope_script(calibrated(), planned)
        error = refuses("another tool, or other kinematics", corrected, tmp_path, model, script.encode(), "a.script")
        assert "they agree for 'ur10'" in error.hint

    @pytest.mark.parametrize("again", [False, True])
    def test_poses_in_a_frame_with_one_value_are_those_of_the_base(self, tmp_path, again):
        model, planned = fitted("ur10"), joints_of("ur10", 3)
        chain, frame = model.arm_.chain, listed(pose_numbers(WORK), 15)
        script = polyscope_script(chain, planned).replace("P_", "Q_")
        for i, T in enumerate(in_work(chain, planned), 1):
            script = re.sub(rf"(Q_{i}_p=p\[)[^\]]*", rf"\g<1>{listed(pose_numbers(T))}", script)
        framed = re.sub(r"get_inverse_kin\((Q_\d_p)", r"get_inverse_kin(pose_trans(F, \1)", script)
        before = "  F=p[0,0,0,0,0,0]\n" * again + f"  F=p[{frame}]\n"
        framed = framed.replace("  while (True):\n", before).replace("  end\nend", "end")
        text, found = corrected(tmp_path, model, framed.encode(), "a.script")
        assert len(found.changes) == 3, found
        mm, _ = tip_errors(model, planned, numbers(r"Q_\d_q=\[(.*)\]", text.decode()))
        assert mm.max() < 1e-5
        poses = numbers(r"Q_\d_p=p\[(.*)\]", text.decode())
        there = np.array([WORK @ pose_matrix(one) for one in poses.tolist()]) @ np.linalg.inv(TOOL)
        sent = joints_at(chain, there, planned)
        assert tip_errors(model, planned, sent)[0].max() < 1e-5
        assert f"F=p[{frame}]" in text.decode()

    @pytest.mark.parametrize(
        "move", ["pose_trans(P_1_p, p[0,0,0.1,0,0,0])", "pose_trans(p[0,0,0.1,0,0,0], P_1_p)", "pose_trans(F, P_2_p)"]
    )
    def test_offsets_of_targets_are_computed(self, tmp_path, move):
        model, planned = fitted("ur10"), joints_of("ur10", 2)
        script = polyscope_script(model.arm_.chain, planned).replace("  end\nend", f"    movel({move})\n  end\nend")
        _, found = corrected(tmp_path, model, script.encode(), "a.script")
        assert len(found.changes) == 2
        assert len(found.left) == 1

    def test_one_pair_that_disagrees_stays_and_the_others_are_corrected(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", 3)
        other = re.sub(r"(P_3_q=\[)[^,]*", r"\g<1>0.5", polyscope_script(model.arm_.chain, planned))
        _, found = corrected(tmp_path, model, other.encode(), "a.script")
        assert "its joints and its pose disagree by" in next(one.reason for one in found.left if one.name == "P_3_p")

    def test_a_program_whose_points_are_those_of_another_robot_is_refused_with_its_name(self, tmp_path):
        script = polyscope_script(ta.load_arm("ur10e").chain, joints_of("ur10", 3))
        error = refuses("contradict themselves", corrected, tmp_path, fitted("ur10"), script.encode(), "a.script")
        assert "they agree for 'ur10e' to 0.0" in error.hint

    def test_joints_of_a_point_are_corrected_with_its_pose_where_moves_name_the_pose_alone(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", 3)
        script = polyscope_script(model.arm_.chain, planned)
        both, _ = corrected(tmp_path, model, script.encode(), "a.script")
        alone = re.sub(r"movej\(get_inverse_kin\((P_\d_p), qnear=P_\d_q\)", r"movel(\1", script)
        text, found = corrected(tmp_path, model, alone.encode(), "a.script")
        assert len(found.changes) == 3
        for pattern in (r"P_\d_p=p\[(.*)\]", r"P_\d_q=\[(.*)\]"):
            assert (numbers(pattern, text.decode()) == numbers(pattern, both.decode())).all()

    def test_start_joints_that_are_not_those_of_the_pose_stay(self, tmp_path):
        new, found = corrected(tmp_path, fitted("ur10"), BENT_SCRIPT.encode(), "a.script")
        assert len(found.changes) == 1
        assert b"[0.0, -1.57, -1.57, -1.57, 1.57, 0.0]" in new
        assert b"p[.688, " not in new

    @pytest.mark.parametrize("stated", ["", 'controller = "a.urp"', 'controller = "b.urp"'])
    def test_a_script_has_the_kinematics_of_the_program_that_it_was_exported_with(self, tmp_path, stated):
        model, planned = fitted("ur10"), joints_of("ur10", 8)
        content = gzip.compress(polyscope_program([waypoint("W_1", planned[0])]).encode())
        (tmp_path / f"{'b' if 'b.urp' in stated else 'a'}.urp").write_bytes(content)
        script = polyscope_script(calibrated(), planned)
        text, found = corrected(tmp_path, model, script.encode(), "a.script", stated)
        assert len(found.changes) == 8
        assert any("those of a.urp" in note for note in found.notes) is (not stated)
        mm, _ = tip_errors(model, planned, numbers(r"P_\d+_q=\[(.*)\]", text.decode()), calibrated())
        assert mm.max() < 1e-5

    @pytest.mark.parametrize("packed", [True, False])
    def test_waypoints_are_corrected_against_the_kinematics_in_the_program(self, tmp_path, packed):
        model, planned = fitted("ur10"), joints_of("ur10", N)
        text = polyscope_program([waypoint(f"W_{i}", q) for i, q in enumerate(planned)]).encode()
        new, found = corrected(tmp_path, model, gzip.compress(text, mtime=7) if packed else text, "a.urp", "")
        assert len(found.changes) == N
        new = gzip.decompress(new) if packed else new
        sent = numbers(r'angles="(.*?)"', new.decode())
        mm, deg = tip_errors(model, planned, sent, calibrated())
        assert mm.max() < 1e-5
        assert deg.max() < 1e-6
        assert re.sub(rb'angles=".*?"', b"", text) == re.sub(rb'angles=".*?"|<!-- truearm .* -->', b"", new)

    def test_the_reverse_gives_the_waypoints_back(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", 8)
        text = polyscope_program([waypoint(f"W_{i}", q) for i, q in enumerate(planned)]).encode()
        new, _ = corrected(tmp_path, model, text, "a.urp", "")
        back, _ = corrected(tmp_path, model, new, "b.urp", "", direction="feedback")
        np.testing.assert_allclose(numbers(r'angles="(.*?)"', back.decode()), planned, rtol=0, atol=1e-9)
        assert b"truearm" not in back

    def test_a_program_that_polyscope_saved_without_the_comment_is_corrected_once(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", 8)
        text = polyscope_program([waypoint(f"W_{i}", q) for i, q in enumerate(planned)]).encode()
        new, _ = corrected(tmp_path, model, text, "a.urp", "")
        saved = re.sub(rb"<!-- .*? -->", b"", new)  # numbers of full precision are saved as they were read
        assert b"truearm" not in saved
        with pytest.raises(InputError, match="corrected already"):
            corrected(tmp_path, model, saved, "b.urp", "")
        script = polyscope_script(calibrated(), numbers(r'angles="(.*?)"', saved.decode()))
        with pytest.raises(InputError, match="corrected already"):
            corrected(tmp_path, model, script.encode(), "b.script", "")
        back, _ = corrected(tmp_path, model, saved, "b.urp", "", direction="feedback")
        np.testing.assert_allclose(numbers(r'angles="(.*?)"', back.decode()), planned, rtol=0, atol=1e-9)
        _, found = corrected(tmp_path, model, back, "c.urp", "")
        assert len(found.changes) == 8

    def test_the_poses_of_polyscope_3_follow_their_joints(self, tmp_path):
        model, planned = fitted("ur10"), joints_of("ur10", 10)
        feature = WORK
        text = polyscope_program(
            [old_waypoint(f"W_{i}", q, feature) for i, q in enumerate(planned)],
            kinematics=kinematics_node(tag="kinematics"),
        )
        new, found = corrected(tmp_path, model, gzip.compress(text.encode()), "a.urp", "")
        assert len(found.changes) == 10
        new = gzip.decompress(new).decode()
        sent = numbers(r'joints="(.*?)"', new)
        assert tip_errors(model, planned, sent, calibrated())[0].max() < 1e-5
        T = flange_poses(calibrated(), sent)
        for pattern, expected in {
            r'<outputFlangePose pose="(.*?)"': T,
            r'joints=".*?" pose="(.*?)"': T @ TOOL,
            r'<poseInFeatureCoordinates pose="(.*?)"': np.linalg.inv(feature) @ T @ TOOL,
        }.items():
            poses, there = numbers(pattern, new), np.array([pose_numbers(one) for one in expected])
            turn = Rotation.from_rotvec(poses[:, 3:]).inv() * Rotation.from_rotvec(there[:, 3:])
            np.testing.assert_allclose(poses[:, :3], there[:, :3], rtol=0, atol=1e-9)
            assert turn.magnitude().max() < 1e-8


def programs_of_all():
    """A program of every kind, its arm and the ending of its name."""
    chain = fitted("ur10").arm_.chain
    joints = joints_of("ur10", 8)
    return {
        "fanuc": ("lrmate200id", fanuc_text("lrmate200id", joints_of("lrmate200id", 8)), "a.ls"),
        "yaskawa": ("gp7", yaskawa_text("gp7", joints_of("gp7", 8)), "a.jbi"),
        "script": ("ur10", polyscope_script(chain, joints), "a.script"),
    }


@pytest.mark.parametrize("kind", ["fanuc", "yaskawa", "script"])
class TestEveryLanguage:
    def test_a_model_that_equals_the_nominal_arm_changes_no_byte(self, tmp_path, kind):
        arm, text, name = programs_of_all()[kind]
        new, found = corrected(tmp_path, fitted(arm, "nominal"), text.encode(), name)
        assert len(found.changes) == 8
        assert new == text.encode()

    def test_the_reverse_gives_the_program_back(self, tmp_path, kind):
        arm, text, name = programs_of_all()[kind]
        new, _ = corrected(tmp_path, fitted(arm), text.encode(), name)
        back, _ = corrected(tmp_path, fitted(arm), new, f"b{name[1:]}", direction="feedback")
        assert len(back.splitlines()) == len(text.encode().splitlines())
        pattern = rb"-?\d*\.\d+"
        assert re.sub(pattern, b"#", back) == re.sub(pattern, b"#", text.encode())
        old, again = (np.array([float(one) for one in re.findall(pattern, one)]) for one in (text.encode(), back))
        assert np.abs(old - again).max() < 5e-3  # digits lost twice; orientations near a lock lose more

    def test_only_bytes_of_numbers_and_the_mark_change(self, tmp_path, kind):
        arm, text, name = programs_of_all()[kind]
        new, found = corrected(tmp_path, fitted(arm), text.encode(), name)
        lines = [line for line in new.splitlines(keepends=True) if b"truearm command" not in line]
        pattern = rb"-?\d*\.\d+"
        old, rest = (re.sub(rb" +", b" ", re.sub(pattern, b"#", one)) for one in (text.encode(), b"".join(lines)))
        assert rest == old
        assert found.summary().startswith("8 of 8 targets corrected")


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("errall.ls", b"ERRALL.LS      Robot Name ROBOT\r\n1 28-NOV-26 RESET\r\n", "begins with /PROG: this is a log"),
        ("main.tp", b"\x00\x01MAIN\x00\xff\xfe", "is binary: save it on the controller as text"),
        ("a.txt", b"nothing\n", "a program of ABB RAPID, "),
    ],
)
def test_a_file_that_is_no_program_is_refused_with_what_is_one(tmp_path, name, content, what):
    with pytest.raises(InputError, match="a program of no known language") as caught:
        corrected(tmp_path, fitted("lrmate200id"), content, name)
    assert what in caught.value.hint


def test_targets_that_truearm_corrected_into_a_language_are_not_corrected_again(tmp_path):
    model = fitted("ur10")
    ta.correct(model, joints_of("ur10", 3), untrained="accept").save(tmp_path / "a.script", language="urscript")
    with pytest.raises(InputError, match="they are corrected already"):
        corrected(tmp_path, model, (tmp_path / "a.script").read_bytes(), "b.script")


@pytest.mark.parametrize("kind", ["fanuc", "yaskawa", "script"])
def test_a_program_is_not_corrected_twice(tmp_path, kind):
    arm, text, name = programs_of_all()[kind]
    new, _ = corrected(tmp_path, fitted(arm), text.encode(), name)
    with pytest.raises(InputError, match="twice would double the correction"):
        corrected(tmp_path, fitted(arm), new, name)


def test_the_kinematics_of_another_robot_are_refused(tmp_path):
    text = polyscope_program([waypoint("W_1", joints_of("ur10", 1)[0])]).replace("-0.6063", "-0.4063")
    with pytest.raises(InputError, match="mm from those of 'ur10'"):
        corrected(tmp_path, fitted("ur10"), text.encode(), "a.urp", "")


BENT = """P[1]{\r
   GP1:\r
\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, 0',\r
\tX =   385.000  mm,\tY =     0.000  mm,\tZ =   285.000  mm,\r
\tW =  -180.000 deg,\tP =     0.000 deg,\tR =     0.000 deg\r
};"""
BENT_SCRIPT = (
    "set_tcp(p[0,0,0,0,0,0])\nmovej(get_inverse_kin("
    f"p[.688, -.163941, .6471, {-np.pi / 2**0.5}, {np.pi / 2**0.5}, 0.0], "
    "[0.0, -1.57, -1.57, -1.57, 1.57, 0.0]))\n"
)
# Poses of the flange with the wrist bent by a right angle, by hand from the drawings: lengths of the links add up.
BY_HAND = {
    "fanuc": (
        "lrmate200id",
        fanuc_program([BENT], ["L P[1] 100mm/sec FINE   "]),  # 50 + 335 and 330 + 35 - 80 mm
        "a.ls",
        (0, 0, 0, 0, -90, 0),
    ),
    "yaskawa": (
        "gp7",
        yaskawa_job(
            ["///TOOL 0", "///POSTYPE ROBOT", "///RECTAN", "///RCONF 0,0,0,0,0,0"]
            + ["C00000=480.000,0.000,405.000,180.0000,0.0000,0.0000"],  # 40 + 440 and 445 + 40 - 80 mm
            ["MOVL C00000 V=10.0"],
        ),
        "a.jbi",
        (0, 0, 0, 0, -90, 0),
    ),
    "script": (
        "ur10",
        BENT_SCRIPT,  # 572.3 + 115.7, 163.941 and 127.3 + 612 - 92.2 mm
        "a.script",
        (0, -90, -90, -90, 90, 0),
    ),
}


@pytest.mark.parametrize("kind", BY_HAND)
def test_poses_that_are_solved_by_hand_have_their_joints(tmp_path, kind):
    arm, text, name, expected = BY_HAND[kind]
    frames = FRAMES + "[tools.0]\nxyz_mm = [0.0, 0.0, 0.0]\n"
    _, found = corrected(tmp_path, fitted(arm), text.encode(), name, frames)
    reasons = [one.reason for one in (*found.refused, *found.left)]
    assert not reasons
    np.testing.assert_allclose(np.degrees(found.changes[0].nominal), expected, rtol=0, atol=1e-6)


def test_turns_of_fanuc_at_half_a_turn_are_those_of_the_corrected_joints(tmp_path):
    arm, model = ta.load_arm("lrmate200id"), fitted("lrmate200id")
    planned = np.radians([[0.0, 13.0, -20.0, q4, -50.0, q6] for q4 in (-180.0, 0.0, 180.0) for q6 in (-180.0, 180.0)])
    poses = in_work(arm.chain, planned)
    for below in (0.0, 1e-9):  # each of the two turns at the border
        rows = zip(poses, np.degrees(planned) - below, strict=True)
        blocks = [fanuc_block(i, T, q) for i, (T, q) in enumerate(rows, 1)]
        text = fanuc_program(blocks, [f"L P[{i}] 100mm/sec FINE " for i in range(1, len(planned) + 1)])
        content, found = corrected(tmp_path, model, text.encode(), "a.ls")
        assert found.is_complete
        turns = re.findall(r"[NF] U T, (-?\d), (-?\d), (-?\d)'", content.decode())
        for change, turn in zip(found.changes, turns, strict=True):
            off = np.abs(np.degrees(change.joints)[[0, 3, 5]] - 360 * np.array([*map(int, turn)]))
            assert off.max() < 180.002  # deg: positions have three decimals
        _, back = corrected(tmp_path, model, content, "b.ls", direction="feedback")
        assert back.is_complete
        # Turn 0 is that of -180 and of 180 deg.
        away = np.array([one.joints - other.nominal for one, other in zip(back.changes, found.changes, strict=True)])
        np.testing.assert_allclose(np.remainder(away + np.pi, 2 * np.pi), np.pi, atol=1e-4)
