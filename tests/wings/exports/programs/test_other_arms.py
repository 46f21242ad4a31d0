"""Programs of robots on a rail, of work frames that a positioner carries, and of SCARA arms."""

import re
from functools import cache

import numpy as np
import pytest
from made_up_listings import fanuc_program, field, wpr
from made_up_programs import TOOL, WORK, cfx, in_work, krl_frame, krl_turn, rapid_pose, rapid_target
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.arm import Arm, Chain
from truearm.errors import InputError
from truearm.wings.exports.programs.branches import ParallelAxes, polished
from truearm.wings.exports.programs.correct_program import correct_program
from truearm.wings.exports.programs.rapid import Rapid
from truearm.wings.exports.programs.solving import Machine
from truearm.wings.exports.targets.pose_models import nominal_poses, poses_of, with_tool
from truearm.wings.exports.targets.targets import Targets

RPY_TOOL = (35.0, -20.0, 140.0, 0.0, np.pi / 2, 0.0)
IRB = "irb2600-12-165"
LOW, HIGH = [-1.0, -0.4, -0.6, -1.0, 0.4, -1.5], [1.0, 0.8, 0.6, 1.0, 1.6, 1.5]
NONE = "9E9,9E9,9E9,9E9,9E9"


def turned(axis, degrees, position=(0.0, 0.0, 0.0)):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(np.radians(degrees) * np.eye(3)[axis]).as_matrix(), position
    return T


@cache
def railed():
    """A robot on a rail along x of the cell."""
    robot = ta.load_arm(IRB)
    # z of the rail is x of the cell; the carriage has the axes of the cell again.
    fixed = [turned(1, 90.0), turned(1, -90.0) @ robot.chain.fixed[0], *robot.chain.fixed[1:]]
    chain = Chain(np.array(fixed), robot.chain.tip_in_flange, np.arange(7) == 0)
    lower, upper = np.array([0.0, *robot.lower]), np.array([3000.0, *robot.upper])
    return Arm(
        "railed",
        chain,
        title="ABB IRB 2600 on a rail",
        lower=lower,
        upper=upper,
        working_pose=np.array([1500.0, *robot.working]),
    )


@cache
def scara():
    """A SCARA of 325 and 275 mm: two axes, a quill that slides downwards and a turn about it."""
    links = [
        (0.0, 0.0, 350.0, 0.0),
        (325.0, 0.0, 0.0, 0.0),
        (275.0, 180.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 0.0),
        (0.0, 0.0, 40.0, 0.0),
    ]
    fixed = []
    for a, alpha, d, _ in links:
        T = turned(0, alpha)
        T[:3, 3] = a, 0.0, d
        fixed.append(T)
    chain = Chain(np.array(fixed), np.array([20.0, 0.0, 30.0]), np.arange(4) == 2)
    lower, upper = np.array([-2.4, -2.5, 0.0, -6.2]), np.array([2.4, 2.5, 210.0, 6.2])
    return Arm(
        "scara",
        chain,
        title="Fanuc SR of a test",
        lower=lower,
        upper=upper,
        working_pose=np.array([0.2, 0.8, 100.0, 0.3]),
    )


@cache
def model_of(arm):
    session = ta.simulate(arm, poses=80, seed=1).session
    return ta.fit(arm, session, model="kinematic").model


def railed_joints(n=12, seed=3):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(200.0, 2800.0, n), rng.uniform(LOW, HIGH, (n, 6))])


def errors(model, planned, sent, tool=RPY_TOOL):
    """Distance [mm] and turn [deg] from the pose meant to that of the arm when it is sent joints."""
    equipped, rows = with_tool(model, np.array(tool)), np.arange(len(sent))
    meant = nominal_poses(equipped).pose(planned, rows)
    there = poses_of(equipped, Targets.of_joints(sent).session(sent)).pose(sent, rows)
    turn = np.swapaxes(meant.R_base_tip, 1, 2) @ there.R_base_tip
    return np.linalg.norm(meant.tip_in_base - there.tip_in_base, axis=1), turn


def corrected(folder, arm, text, name, frames="", **options):
    (folder / name).write_text(text, newline="")
    (folder / "frames.toml").write_text(frames)
    return correct_program(model_of(arm), folder / name, frames=folder / "frames.toml", untrained="accept", **options)


def rapid_text(planned, *, axis=1, wobj='TRUE,""', work=WORK, moving=None):
    """A module of one MoveL for every row of joints; the rail is an external axis."""
    poses = in_work(railed().chain, planned, TOOL, work) if moving is None else moving
    lines = ["MODULE Made", f"  PERS tooldata tGrip:=[TRUE,{rapid_pose(TOOL)},[1,[0,0,1],[1,0,0,0],0,0,0]];"]
    uframe = rapid_pose(work) if moving is None else "[[0,0,0],[1,0,0,0]]"
    inner = "[[0,0,0],[1,0,0,0]]" if moving is None else rapid_pose(work)
    lines.append(f"  PERS wobjdata wTable:=[FALSE,{wobj},{uframe},{inner}];")
    for i, (T, q) in enumerate(zip(poses, planned, strict=True)):
        robtarget = rapid_target(T, np.degrees(q[1:]), cfx(np.degrees(q[1:])), mm=6, quaternion_digits=10)
        external = ["9E9"] * 6
        external[axis - 1] = f"{q[0]:.6f}"
        if moving is not None:
            external[1] = f"{10.0 * i:.6f}"
        lines.append(f"  CONST robtarget p{i}:={re.sub(r'9E9(,9E9)*', ','.join(external), robtarget)};")
    lines += ["  PROC main()", *(f"    MoveL p{i},v100,fine,tGrip\\WObj:=wTable;" for i in range(len(planned)))]
    return "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def model_joints(changes, planned):
    return np.column_stack([planned[:, 0], [change.joints for change in changes]])


class TestRail:
    @pytest.mark.parametrize("axis", [1, 3])
    def test_the_tip_is_at_the_pose_meant_and_the_rail_stays(self, tmp_path, axis):
        planned = railed_joints()
        text = rapid_text(planned, axis=axis)
        found = corrected(tmp_path, railed(), text, "made.mod", f"rail = {axis}")
        assert found.is_complete
        np.testing.assert_allclose([one.nominal for one in found.changes], planned[:, 1:], atol=1e-7)
        mm, turn = errors(model_of(railed()), planned, model_joints(found.changes, planned))
        assert mm.max() < 1e-6
        assert Rotation.from_matrix(turn).magnitude().max() < 1e-9
        assert not any("External axis" in note for note in found.notes)
        external = re.compile(rb"-?[\d.]+,9E9|9E9,-?[\d.]+")
        assert external.findall(found.content) == external.findall(text.encode())

    def test_a_pose_of_krl_has_it_in_e1(self, tmp_path):
        planned = railed_joints(4)
        poses = in_work(railed().chain, planned)
        arm = Arm("railed", railed().chain, title="KUKA on a rail", lower=railed().lower, upper=railed().upper)
        machine = Machine.of(arm, arm.chain.with_tip(np.zeros(3)), Rapid())
        signs = machine.quantities(planned)
        assert (signs[:, 6] > 0).all()
        lines = [
            f"LIN {{{krl_frame(T)},S {2 * (s[7] > 0) + 4 * (s[4] < 0)},T {krl_turn(np.degrees(q[1:]))},E1 {q[0]:.6f}}}"
            for T, q, s in zip(poses, planned, signs, strict=True)
        ]
        head = f"$TOOL={{{krl_frame(TOOL)}}}\n$BASE={{{krl_frame(WORK)}}}\n"
        (tmp_path / "made.src").write_text("DEF made( )\n" + head + "\n".join([*lines, "END", ""]))
        model = ta.fit(arm, ta.simulate(arm, poses=80, seed=1).session, model="kinematic").model
        found = correct_program(model, tmp_path / "made.src", untrained="accept")
        assert found.is_complete
        assert errors(model, planned, model_joints(found.changes, planned))[0].max() < 1e-6

    def test_a_target_that_does_not_state_it_is_refused(self, tmp_path):
        planned = railed_joints(4)
        text = re.sub(r"(p2:=.*)\[[-\d.]+,9E9", r"\1[9E9,9E9", rapid_text(planned))
        found = corrected(tmp_path, railed(), text, "made.mod")
        assert [(one.name, one.reason) for one in found.refused] == [
            ("p2", "its external axis 1, the rail under the robot, is not stated")
        ]

    def test_the_reverse_gives_the_program_back(self, tmp_path):
        planned = railed_joints(5)
        found = corrected(tmp_path, railed(), rapid_text(planned), "made.mod")
        back = corrected(tmp_path, railed(), found.content.decode(), "back.mod", direction="feedback")
        np.testing.assert_allclose([one.joints for one in back.changes], planned[:, 1:], atol=1e-7)


class TestPositioner:
    FRAMES = "[positioners.STN1]\nxyz_mm = [1200, 300, 0]\nwpr_deg = [0, 90, 0]\naxis = 2\nslides = {}\n"

    def text(self, planned, slides, work=WORK):
        axis = turned(1, 90.0, (1200.0, 300.0, 0.0))
        flange = in_work(railed().chain, planned, TOOL, np.eye(4))
        moving = []
        for i, T in enumerate(flange):
            unit = axis @ (turned(2, 0.0, (0.0, 0.0, 10.0 * i)) if slides else turned(2, 10.0 * i))
            moving.append(np.linalg.inv(unit @ work) @ T)
        return rapid_text(planned, wobj='FALSE,"STN1"', work=work, moving=moving)

    @pytest.mark.parametrize("slides", [True, False])
    def test_a_work_frame_that_it_carries_is_that_of_its_axis(self, tmp_path, slides):
        planned = railed_joints(6)
        frames = self.FRAMES.format(str(slides).lower())
        found = corrected(tmp_path, railed(), self.text(planned, slides), "made.mod", frames)
        assert found.is_complete
        np.testing.assert_allclose([one.nominal for one in found.changes], planned[:, 1:], atol=1e-7)
        assert errors(model_of(railed()), planned, model_joints(found.changes, planned))[0].max() < 1e-6
        assert not any("External axis" in note for note in found.notes)

    def test_one_that_is_not_stated_is_named(self, tmp_path):
        found = corrected(tmp_path, railed(), self.text(railed_joints(3), slides=False), "made.mod")
        assert {one.reason for one in found.left} == {
            "the work object wTable moves with the unit STN1: state [positioners.STN1] in --frames"
        }


def scara_joints(n=20, seed=5):
    return np.random.default_rng(seed).uniform([-1.2, 0.4, 20.0, -2.0], [1.2, 1.8, 180.0, 2.0], (n, 4))


SCARA_FRAMES = "[tools.3]\nxyz_mm = [15.0, -10.0, 60.0]\nwpr_deg = [0.0, 0.0, 30.0]\n"
SCARA_TOOL = (15.0, -10.0, 60.0, 0.0, 0.0, np.radians(30.0))


def scara_program(planned, *, joints=False):
    blocks, tool = [], turned(2, 30.0, (15.0, -10.0, 60.0))
    for i, (q, T) in enumerate(zip(planned, in_work(scara().chain, planned, tool, np.eye(4)), strict=True), 1):
        if joints:
            values = [q[2] if k == 2 else np.degrees(q[k]) for k in range(4)]
            row = ",\t".join(f"J{k}={field(one)} {' mm' if k == 3 else 'deg'}" for k, one in enumerate(values, 1))
            blocks.append("\r\n".join([f"P[{i}]{{", "   GP1:", "\tUF : 0, UT : 3,\t", f"\t{row}", "};"]))
        else:
            xyz = ",\t".join(f"{name} ={field(one)}  mm" for name, one in zip("XYZ", T[:3, 3], strict=True))
            angles = ",\t".join(f"{name} ={field(one)} deg" for name, one in zip("WPR", wpr(T[:3, :3]), strict=True))
            head = "\tUF : 0, UT : 3,\t\tCONFIG : 'L, 0, 0, 0',"
            blocks.append("\r\n".join([f"P[{i}]{{", "   GP1:", head, f"\t{xyz},", f"\t{angles}", "};"]))
    return fanuc_program(blocks, [f"J P[{i}] 100% FINE   " for i in range(1, len(planned) + 1)])


def yaw_and_tilt(turn):
    """Turn about the axes of the arm, and that across them [rad]."""
    vectors = Rotation.from_matrix(turn).as_rotvec()
    return np.abs(vectors[:, 2]), np.linalg.norm(vectors[:, :2], axis=1)


class TestScara:
    def test_both_branches_bring_the_flange_there(self):
        planned = scara_joints(200)
        chain = scara().chain.with_tip(np.zeros(3))
        flange = in_work(chain, planned, np.eye(4), np.eye(4))
        found = ParallelAxes.of(chain).branches(flange)
        assert np.abs(found - planned[:, None]).max(axis=2).min(axis=1).max() < 1e-9
        for branch in range(2):
            again = in_work(chain, found[:, branch], np.eye(4), np.eye(4))
            np.testing.assert_allclose(again, flange, atol=1e-9)
        exact = polished(chain, flange, found[:, 0], turns=np.eye(3)[2:])
        np.testing.assert_allclose(exact, found[:, 0], atol=1e-9)

    @pytest.mark.parametrize("joints", [True, False])
    def test_tip_and_yaw_are_at_the_pose_meant(self, tmp_path, joints):
        planned = scara_joints()
        options = {} if joints else {"start": [0.2, 0.8, 100.0, 0.3]}
        found = corrected(tmp_path, scara(), scara_program(planned, joints=joints), "a.ls", SCARA_FRAMES, **options)
        assert found.is_complete
        model = model_of(scara())
        # As they are read from three decimals, and what is written, not rounded.
        nominal = np.array([one.nominal for one in found.changes])
        np.testing.assert_allclose(nominal, planned, atol=2e-3)
        mm, turn = errors(model, nominal, np.array([one.joints for one in found.changes]), SCARA_TOOL)
        yaw, tilt = yaw_and_tilt(turn)
        assert mm.max() < 1e-6
        assert yaw.max() < 1e-9
        before, was = errors(model, nominal, nominal, SCARA_TOOL)
        assert before.min() > 0.05
        assert yaw_and_tilt(was)[0].max() > 1e-4
        assert tilt.max() < 0.01
        text = found.content.decode()
        assert len(re.findall(r"J3=.{10}  mm" if joints else r"W =   180\.000 deg|W =  -180\.000 deg", text)) == len(
            planned
        )

    def test_without_joints_nearby_the_side_of_the_elbow_is_open(self, tmp_path):
        found = corrected(tmp_path, scara(), scara_program(scara_joints(4)), "a.ls", SCARA_FRAMES)
        assert {one.reason for one in found.refused} == {
            "its configuration is not stated: --start states joints nearby"
        }

    def test_both_sides_of_the_elbow_in_one_program_are_left(self, tmp_path):
        text = scara_program(scara_joints(3)).replace("'L, 0", "'R, 0", 1)
        found = corrected(tmp_path, scara(), text, "a.ls", SCARA_FRAMES, start=[0.2, 0.8, 100.0, 0.3])
        assert not found.changes
        assert len([one for one in found.left if one.is_literal and "L and R" in one.reason]) == 3

    def test_the_quill_of_the_start_does_not_choose_the_side_of_the_elbow(self, tmp_path):
        planned = scara_joints()
        start = [0.2, 0.8, 5000.0, 0.3]
        found = corrected(tmp_path, scara(), scara_program(planned), "a.ls", SCARA_FRAMES, start=start)
        np.testing.assert_allclose([one.nominal for one in found.changes], planned, atol=2e-3)

    def test_a_tilted_target_is_out_of_its_reach(self, tmp_path):
        text = re.sub(r"P = {4,}-?\.000", "P =     5.000", scara_program(scara_joints(3)))
        with pytest.raises(InputError, match="none of 'scara'.*out of reach"):
            corrected(tmp_path, scara(), text, "a.ls", SCARA_FRAMES, start=[0.2, 0.8, 100.0, 0.3])

    def test_programs_of_other_languages_are_refused(self, tmp_path):
        arm = Arm("scara", scara().chain, title="ABB IRB 910SC", lower=scara().lower, upper=scara().upper)
        model = ta.fit(arm, ta.simulate(arm, poses=80, seed=1).session, model="kinematic").model
        (tmp_path / "a.mod").write_text(rapid_text(railed_joints(2)))
        with pytest.raises(InputError, match=r"those of Fanuc for SCARA arms"):
            correct_program(model, tmp_path / "a.mod")

    def test_a_table_of_joints_is_corrected_with_its_yaw(self):
        model, planned = model_of(scara()), scara_joints()
        found = ta.correct(model, planned, untrained="accept")
        equipped, rows = model, np.arange(len(planned))
        meant = nominal_poses(equipped).pose(planned, rows)
        there = poses_of(equipped, Targets.of_joints(planned).session(planned)).pose(found.joints, rows)
        assert np.linalg.norm(meant.tip_in_base - there.tip_in_base, axis=1).max() < 1e-6
        yaw, _ = yaw_and_tilt(np.swapaxes(meant.R_base_tip, 1, 2) @ there.R_base_tip)
        assert yaw.max() < 1e-6  # of small tilts the product turns about the axis too
        assert "turn about its axes" in str(found)
