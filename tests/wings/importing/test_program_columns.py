"""Columns of known programs: recognised by name in any order, a controller's own pose never taken as a reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.readings import Session
from truearm.readings.columns import session_columns
from truearm.wings.importing.foreign.program_columns import recognise_program_columns, split_unit
from truearm.wings.importing.foreign.table_columns import TableColumns


def numbered(pattern: str, first: int = 1, n: int = 6) -> list[str]:
    return [pattern.format(i) for i in range(first, first + n)]


UR_NAMES = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
]
POINT = ["tracker_x", "tracker_y", "tracker_z"]

# Columns of the angles base to tip, their unit, the program in the phrase, and other columns of its files.
PROGRAMS = {
    "rtde": (
        numbered("actual_q_{}", 0), "rad", "UR RTDE",
        ["timestamp", *numbered("target_q_{}", 0), *numbered("actual_qd_{}", 0), *numbered("actual_TCP_pose_{}", 0)],
    ),
    "rostopic": (
        numbered("field.position{}", 0), "rad", "ROS JointState",
        ["%time", "field.header.stamp", *numbered("field.velocity{}", 0), *numbered("field.name{}", 0)],
    ),
    "plotjuggler": (
        numbered("/joint_states/position[{}]", 0), "rad", "ROS JointState", numbered("/joint_states/velocity[{}]", 0),
    ),
    "joint names": ([f"{name}/position" for name in UR_NAMES], "rad", "ROS JointState", ["elbow_joint/velocity"]),
    "ros2_control": ([f"/joint_states/{name}/position" for name in UR_NAMES], "rad", "ROS JointState", []),
    "panda": (
        numbered("panda_joint{}/position", n=7), "rad", "ROS JointState", ["panda_finger_joint1/position"],
    ),
    "lbr": (numbered("lbr_joint_a{}/position"), "rad", "ROS JointState", []),
    "libfranka": (
        numbered("state.q[{}]", 0, 7), "rad", "libfranka",
        ["time", *numbered("state.q_d[{}]", 0, 7), *numbered("state.O_T_EE[{}]", 0, 16)],
    ),
    "krl": (
        numbered("$AXIS_ACT.A{}"), "deg", "KUKA", [*(f"$POS_ACT.{c}" for c in "XYZABC"), *numbered("$AXIS_ACT.E{}")],
    ),
    "rsi": (
        numbered("AIPos.A{}"), "deg", "KUKA", [*numbered("ASPos.A{}"), *(f"RIst.{c}" for c in "XYZABC")],
    ),
    "kuka": (numbered("A{}"), "deg", "KUKA", list("XYZABC")),
    "fanuc": (numbered("J{}"), "deg", "Fanuc", list("XYZWPR")),
    "rapid": (numbered("rax_{}"), "deg", "ABB", []),
    "kortex": (numbered("actuators[{}].position", 0, 7), "deg", "Kinova Kortex", ["actuators[0].torque"]),
    "yaskawa": (list("SLURBT"), None, "Yaskawa", []),
    "lerobot": (
        ["shoulder_pan.pos", "shoulder_lift.pos", "elbow_flex.pos", "wrist_flex.pos", "wrist_roll.pos"],
        None, "LeRobot", ["gripper.pos"],
    ),
    "interbotix": (
        ["waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate"], None, "Interbotix", ["gripper"],
    ),
    "robodk": (numbered("Joint {} (deg)"), "deg", "", []),
    "motoman ros": (["joint_1_s", "joint_2_l", "joint_3_u", "joint_4_r", "joint_5_b", "joint_6_t"], None, "", []),
    "xarm": (numbered("joint{}"), None, "", numbered("current{}")),
    "encoders": (numbered("Enc{}"), "counts", "", []),
    "measuring arm": (numbered("Theta{}"), None, "", []),
    "session": (numbered("q{}_deg"), "deg", "", ["seat", "session"]),
    "german": (numbered("Achse {} [°]"), "deg", "", []),
    "gelenk": (numbered("Gelenk{}"), None, "", []),
    "chinese": (numbered("关节{}"), None, "", []),
    "chinese angles": (numbered("关节{}角度"), None, "", []),
    "axis": (numbered("axis{}_rad"), "rad", "", []),
    "matlab": (numbered("robot.q[{}]", 0), None, "", ["robot.dq[0]"]),
}  # fmt: skip


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_programs_angles_are_recognised(name):
    angles, unit, program, others = PROGRAMS[name]
    found = recognise_program_columns([*others, *angles, *POINT])
    assert list(found.columns.angles) == angles
    assert set(found.angle_units) == {unit}
    assert list(found.columns.points) == POINT
    assert found.phrases["angles"].startswith(f"columns of {program}: " if program else angles[0])


@given(st.sampled_from(sorted(PROGRAMS)), st.randoms(use_true_random=False))
def test_the_order_of_the_columns_does_not_matter(name, random):
    angles, _, _, others = PROGRAMS[name]
    names = [*others, *angles, *POINT, "ux", "uy", "uz"]
    random.shuffle(names)
    found = recognise_program_columns(names)
    assert list(found.columns.angles) == angles
    assert list(found.columns.points) == POINT
    assert found.columns.point_std == ("ux", "uy", "uz")


@pytest.mark.parametrize("name", ["rtde", "libfranka", "krl", "rsi", "kuka", "fanuc"])
def test_the_controllers_own_pose_is_no_reference(name):
    angles, _, _, others = PROGRAMS[name]
    found = recognise_program_columns([*angles, *others])
    assert not found.columns.points
    assert not found.columns.orientation
    assert any("controller's own pose" in remark for remark in found.remarks)


@pytest.mark.parametrize(
    "points",
    [["X", "Y", "Z"], ["px", "py", "pz"], ["x_mm", "y_mm", "z_mm"], ["tip_x", "tip_y", "tip_z"], ["TX", "TY", "TZ"],
     ["ref_x", "ref_y", "ref_z"], ["meas_x [mm]", "meas_y [mm]", "meas_z [mm]"], ["Leica X", "Leica Y", "Leica Z"],
     ["pose.position.x", "pose.position.y", "pose.position.z"],
     ["run.p[0]", "run.p[1]", "run.p[2]"], ["tip[0]", "tip[1]", "tip[2]"],
     ["坐标X", "坐标Y", "坐标Z"], ["Tool tip X", "Tool tip Y", "Tool tip Z"]],
)  # fmt: skip
def test_points_by_their_names(points):
    found = recognise_program_columns([*numbered("J{}"), *points])
    assert list(found.columns.points) == points
    assert found.point_unit == ("mm" if "mm" in points[0] else None)


@pytest.mark.parametrize(
    "quantity", ["v", "vel_", "f", "force_", "a", "m", "e", "err_", "target_", "nominal_", "tcp_", "tool_", "gyro_"]
)
def test_what_is_no_measured_point(quantity):
    found = recognise_program_columns([*numbered("J{}"), *(f"{quantity}{axis}" for axis in "xyz")])
    assert not found.columns.points


def test_an_instruments_point_goes_before_another():
    found = recognise_program_columns([*numbered("J{}"), "x", "y", "z", *POINT])
    assert list(found.columns.points) == POINT


def test_ros_quaternions_have_names_and_come_w_first():
    names = ["orientation.x", "orientation.y", "orientation.z", "orientation.w"]
    found = recognise_program_columns([*numbered("J{}"), *names])
    assert found.columns.orientation == ("orientation.w", "orientation.x", "orientation.y", "orientation.z")


@pytest.mark.parametrize("pattern", ["field.point.{}", "/tracker/pose/position/{}"])
def test_points_of_ros_are_in_metres(pattern):
    found = recognise_program_columns([*numbered("field.position{}", 0), *map(pattern.format, "xyz")])
    assert found.point_unit == "m"


def test_motive_has_the_rotation_first():
    found = recognise_program_columns(
        ["Frame", "Time (Seconds)", "X", "Y", "Z", "W", "X", "Y", "Z", "Mean Marker Error"]
    )
    assert found.columns.orientation == ("W", "3", "4", "5")
    assert found.columns.points == ("7", "8", "9")


def test_vicon_states_units_in_a_row_and_its_rotation_is_asked():
    names = ["Frame", "Sub Frame", "RX", "RY", "RZ", "TX", "TY", "TZ"]
    found = recognise_program_columns(names, ["", "", "deg", "deg", "deg", "mm", "mm", "mm"])
    assert found.columns.points == ("TX", "TY", "TZ")
    assert found.point_unit == "mm"
    assert "--orientation rx,ry,rz" in found.remarks[0]


def test_roll_pitch_yaw_are_about_fixed_axes():
    found = recognise_program_columns(["q1", "q2", "yaw_deg", "pitch_deg", "roll_deg"])
    assert found.columns.orientation == ("roll_deg", "pitch_deg", "yaw_deg")
    assert (found.orientation_order, found.orientation_unit) == ("xyz", "deg")


@pytest.mark.parametrize("first", [0, 1])
def test_a_matrix_row_by_row(first):
    cells = [f"r{i}{j}" for i in range(first, first + 3) for j in range(first, first + 3)]
    assert recognise_program_columns(["q1", "q2", *reversed(cells)]).columns.orientation == tuple(cells)


def test_tracker_tables_name_points_and_uncertainties():
    found = recognise_program_columns(["PointName", "X", "Y", "Z", "ux", "uy", "uz", "Temperature"])
    assert found.columns.point_std == ("ux", "uy", "uz")
    assert found.columns.temperature == "Temperature"


def test_payload_and_torques_follow_the_joints():
    names = [f"{name}/effort" for name in sorted(UR_NAMES)] + [f"{name}/position" for name in sorted(UR_NAMES)]
    found = recognise_program_columns([*names, "payload"])
    expected = {f"load_{i + 1}_Nm": f"{name}/effort" for i, name in enumerate(UR_NAMES)}
    assert dict(found.columns.others) == {"payload_kg": "payload", **expected}


def test_a_session_file_means_itself():
    names = np.array(["A", "B"])
    session = Session(
        np.zeros((2, 6)), np.zeros((2, 3)), point_std=np.ones((2, 3)), quaternion=np.array([[1.0, 0, 0, 0]] * 2),
        seat=names, position=names, session=names, serial_number=names, temperature_degC=np.array([20.0, 21.0]),
        directions=np.ones((2, 6)), columns={"payload_kg": np.ones(2), "load_1_Nm": np.ones(2)},
    )  # fmt: skip
    table = session_columns(session)
    found = recognise_program_columns(list(table))
    columns = found.columns
    assert columns.angles == tuple(name for name in table if name.startswith("q") and name.endswith("_deg"))
    assert columns.points == ("x_mm", "y_mm", "z_mm")
    given_names = {*columns.angles, *columns.points, *columns.point_std, *columns.position, *columns.orientation}
    given_names |= {columns.seat, columns.session, columns.temperature, *columns.others.values()}
    assert set(table) <= given_names


@pytest.mark.parametrize(
    ("names", "what"),
    [
        (["left_j1", "left_j2", "right_j1", "right_j2"], "joint angles: left_j1 .. left_j2 and right_j1 .. right_j2"),
        (["J1", "J2", "theta1", "theta2"], "joint angles"),
        (["J1", "J2", *(f"{what} {c}" for what in ("Tool tip", "Base ball") for c in "XYZ")], "points: Tool tip X"),
        (["J1", "J2", "ref_x", "ref_y", "ref_z", "tip_x", "tip_y", "tip_z"], "points: ref_x, ref_y, ref_z; tip_x"),
        # What a controller calls measured may be its own forward kinematics.
        *(
            (["measured_q1", "measured_q2", *(f"{who}_{c}" for who in (other, "measured") for c in "xyz")], "points: ")
            for other in ("marker", "tracker", "laser", "mocap", "camera", "probe", "ball")
        ),
        (["J1", "J2", *(f"{who}_{c}" for who in ("marker", "measured") for c in "xyz")], "points: marker_x"),
        (["measured_q1", "measured_q2", *"xyz", "measured_x", "measured_y", "measured_z"], "points: x, y, z; meas"),
    ],
)
def test_two_readings_are_asked(names, what):
    found = recognise_program_columns(names)
    (doubt,) = (one for one in (found.no_angles, found.no_points) if one is not None)
    assert what in doubt.problem
    assert doubt.hint.startswith("--")


@pytest.mark.parametrize(
    "names",
    [
        ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"],  # a UR's pendant
        ["Base [deg]", "Shoulder [deg]", "Elbow [deg]", "Wrist1 [deg]", "Wrist2 [deg]", "Wrist3 [deg]"],
        ["Base Joint", "Shoulder Joint", "Elbow Joint", "Wrist 1 Joint", "Wrist 2 Joint", "Wrist 3 Joint"],
        ["shoulder_joint", "upperArm_joint", "foreArm_joint", "wrist1_joint", "wrist2_joint", "wrist3_joint"],  # AUBO
        [f"right_{joint}" for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")],  # Baxter
        [*(f"joint{i + 1}_to_joint{i}" for i in range(1, 6)), "joint6output_to_joint6"],  # myCobot
        [f"{letter}-Axis" for letter in "SLURBT"],  # Yaskawa
        [*"SLEURBT"],
        [f"E6AXIS.A{i}" for i in range(1, 7)],  # KUKA
        [f"robax.rax_{i}" for i in range(1, 7)],  # ABB
        [f"GP1 J{i}" for i in range(1, 7)],  # Fanuc
        [f"fr3_joint{i}" for i in range(1, 8)],  # Franka
        [f"jnt.j{i}" for i in range(1, 7)],  # Staubli
        [f"QActual{i}" for i in range(1, 7)],  # Dobot
        [f"posj_{i}" for i in range(1, 7)],  # Doosan
        [f"AX{i}" for i in range(1, 7)],  # Comau
    ],
)
def test_joints_as_their_makers_call_them(names):
    """Base to tip, whatever stands beside them and in whatever order the columns are."""
    found = recognise_program_columns([*reversed(names), "X", "Y", "Z", "Time"])
    assert found.columns.angles == tuple(names)
    assert found.columns.points == ("X", "Y", "Z")


def test_a_missing_joint_is_named():
    """Three joints, or a column that was lost: a person knows."""
    doubt = recognise_program_columns(["J1 [deg]", "J2 [deg]", "J4 [deg]"]).no_angles
    assert "J3 [deg] is missing" in str(doubt)
    assert "--angles 'J1 [deg],J2 [deg],J4 [deg]'" in doubt.hint
    beside = recognise_program_columns(["A1", "A2", "A4", *numbered("J{}")])  # others are known
    assert beside.no_angles is None
    assert beside.remarks == ("A1, A2, A4 may be joint angles, but A3 is missing.",)


@pytest.mark.parametrize(
    ("names", "lacks", "typed"),
    [
        (["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 3"], "Wrist 2", "'Base,Shoulder,Elbow,Wrist 1,Wrist 3'"),
        (["s", "l", "u", "r", "t"], "b", "s,l,u,r,t"),
        (
            [f"shoulder_{one}_joint" for one in ("pan", "lift")] + [f"wrist_{i}_joint" for i in (1, 2, 3)],
            "elbow",
            "shoulder_pan_joint,shoulder_lift_joint,wrist_1_joint,wrist_2_joint,wrist_3_joint",
        ),
    ],
)
def test_a_missing_joint_of_an_arm_that_names_its_joints_is_named(names, lacks, typed):
    found = recognise_program_columns([*names, "X", "Y", "Z"])
    assert found.columns.angles == ()
    assert found.no_angles.problem == f"{', '.join(names)} may be joint angles, but {lacks} is missing"
    assert f"--angles {typed} if" in found.no_angles.hint


def test_a_program_whose_joints_are_all_of_a_longer_list_lacks_none():
    """Yaskawa's six axes are the seven of its other arms but one; the base of UR's pendant is not the other UR's."""
    for names in ("slurbt", ["base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3"]):
        found = recognise_program_columns(list(names))
        assert (found.columns.angles, found.no_angles, found.remarks) == (tuple(names), None, ())


def test_columns_to_type_are_quoted_where_their_names_have_blanks():
    angles = ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"]
    (said,) = recognise_program_columns([*angles, "TCP X", "TCP Y", "TCP Z"]).remarks
    assert "--point 'TCP X,TCP Y,TCP Z' if an instrument" in said


def test_a_quaternion_in_numbers_is_no_joint_beside_joints():
    assert list(recognise_program_columns(["q0", "q1", "q2", "q3", *numbered("J{}")]).columns.angles) == numbered("J{}")


def test_rows_of_length_one_are_a_quaternion_and_no_joints():
    rng = np.random.default_rng(4)
    turned = rng.normal(size=(9, 4))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    names = [f"q[{i}]" for i in range(4)]
    doubt = recognise_program_columns(names, cells=list(turned.T)).no_angles
    assert "q[0] .. q[3] are no joint angles but a quaternion" in str(doubt)
    assert "--orientation 'q[0],q[1],q[2],q[3]'" in doubt.hint
    for others in (turned * [1, 1, 1, 1.01], np.round(turned, 1), turned[:2]):  # an arm of four joints; too few to tell
        assert recognise_program_columns(names, cells=list(others.T)).columns.angles == tuple(names)


def test_a_stated_column_is_nothing_else():
    """Whether it is stated by its name, in other case, without its unit, or by its number."""
    names = ["pose", "Nest", "J1", "J2", "X [mm]", "Y [mm]", "Z [mm]", "temperature"]
    assert recognise_program_columns(names).columns.seat == "Nest"
    for nest in ("Nest", "nest", "2"):
        found = recognise_program_columns(names, stated=TableColumns(others={"tip": nest}, position=("1",))).columns
        assert (found.seat, found.position, found.temperature) == (None, (), "temperature")
    assert recognise_program_columns(names, stated=TableColumns(position=("X", "Y", "Z"))).columns.points == ()


@settings(max_examples=25)
@given(st.lists(st.text(max_size=12), max_size=12))
def test_no_name_is_too_strange(names):
    found = recognise_program_columns(names)
    assert len(found.angle_units) == len(found.columns.angles)


def test_units_behind_names():
    assert split_unit("J1 / °") == ("j1", "deg")
    assert split_unit("X in mm") == ("x", "mm")
    assert split_unit("tip_x [µm]") == ("tip_x", "um")
    assert split_unit("q[3]") == ("q_3", None)
    assert np.all([split_unit(f"X{end}")[1] == "mm" for end in ("(mm)", "_mm", " [mm]", "/mm", ",mm")])


@pytest.mark.parametrize(
    ("sets", "hint"),
    [
        (("{}_t", "{}_dif", "measured_{}"), "--point measured_x,measured_y,measured_z"),
        (("ref_{}", "actual_{}"), "--point actual_x,actual_y,actual_z"),
        (("{}_t", "{}_dif"), "--point x_t,y_t,z_t, or --point x_dif,y_dif,z_dif: those that an instrument measured"),
    ],
)
def test_of_several_sets_of_points_that_named_measured_is_proposed(sets, hint):
    """Targets that are taken for points look like a perfect arm."""
    names = [name.format(axis) for name in sets for axis in "xyz"]
    refused = recognise_program_columns([*numbered("joint_{}"), *names]).no_points
    assert refused is not None
    assert refused.hint == hint
    assert refused.problem.startswith(f"{len(sets)} sets of columns may be the points: {', '.join(names[:3])}; ")


@pytest.mark.parametrize("name", ["U_{}", "U{}", "{}_U", "U({})"])
def test_a_capital_u_is_said_to_be_read_as_a_standard_uncertainty(name):
    stds = [name.format(axis) for axis in "xyz"]
    found = recognise_program_columns([*numbered("J{}"), *"XYZ", *stds])
    assert found.phrases["point_std"] == f"standard uncertainties {', '.join(stds)}"
    assert "often is an expanded one (k = 2)" in found.remarks[0]
    for small in ([one.lower() for one in stds], [f"Uncertainty {axis}" for axis in "XYZ"]):
        found = recognise_program_columns([*numbered("J{}"), *"XYZ", *small])
        assert "point_std" in found.phrases
        assert not found.remarks


@pytest.mark.parametrize("turned", ["measurement_std_r{}", "std_r{}", "std_rot_{}", "sigma_q{}"])
def test_deviations_of_orientations_are_no_uncertainties_of_points(turned):
    of_points, of_turns = ([name.format(axis) for axis in "xyz"] for name in ("measurement_std_{}", turned))
    points = [f"measurement_{axis}" for axis in "xyz"]
    for columns in ([*of_points, *of_turns], [*of_turns, *of_points]):
        found = recognise_program_columns([*numbered("J{}"), *points, *columns])
        assert found.columns.point_std == tuple(of_points)
        assert not found.remarks
    alone = recognise_program_columns([*numbered("J{}"), *points, *of_turns])
    assert not alone.columns.point_std
    names = ", ".join(of_turns)
    (remark,) = alone.remarks
    assert remark.startswith(f"{names} are taken for standard deviations of orientations: not read. Use --point-std ")


@pytest.mark.parametrize("name", ["std_w_{}", "std_a_{}", "sigma_c_{}", "std_r_{}", "c_std_{}", "std_{}_b"])
def test_a_letter_beside_the_axis_is_one_of_a_frame_unless_other_deviations_stand_beside(name):
    of_points, lettered = ([name.format(axis) for axis in "xyz"] for name in ("std_{}", name))
    alone = recognise_program_columns([*numbered("J{}"), *"xyz", *lettered])
    assert alone.columns.point_std == tuple(lettered)
    for columns in ([*of_points, *lettered], [*lettered, *of_points]):
        assert recognise_program_columns([*numbered("J{}"), *"xyz", *columns]).columns.point_std == tuple(of_points)


@pytest.mark.parametrize(
    ("angle", "point"),
    [
        ("Winkel {} in Grad", "{}"),
        ("Achse {} [Grad]", "{}"),
        ("\u95a2\u7bc0{}\u89d2\u5ea6[\u5ea6]", "{}\u5ea7\u6a19[mm]"),
        ("\u8ef8{} (\u5ea6)", "{}\u5ea7\u6a19"),
    ],
)
def test_german_and_japanese_headings_are_recognised(angle, point):
    found = recognise_program_columns([*numbered(angle), *map(point.format, "XYZ")])
    assert found.angle_units == ("deg",) * 6
    assert found.columns.points == tuple(map(point.format, "XYZ"))
    assert split_unit("J1 [grad]") == ("j1", "grad")  # a gon in English: asked
