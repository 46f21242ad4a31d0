"""Programs of Fanuc, Universal Robots and Yaskawa for known joints, made without the readers."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.arm import Chain
from truearm.arm.denavit_hartenberg import dh_table

TOOL = np.array([[0.0, 0.0, 1.0, 35.0], [0.0, 1.0, 0.0, -20.0], [-1.0, 0.0, 0.0, 140.0], [0.0, 0.0, 0.0, 1.0]])
WORK = np.array([[0.0, -1.0, 0.0, 300.0], [1.0, 0.0, 0.0, -150.0], [0.0, 0.0, 1.0, 50.0], [0.0, 0.0, 0.0, 1.0]])
FRAMES = """controller = "nominal"
pulses_per_deg = [1435.0, 1300.0, -1280.0, 1100.0, 1000.5, 700.0]
[tools.3]
xyz_mm = [35.0, -20.0, 140.0]
wpr_deg = [0.0, 90.0, 0.0]
[works.1]
xyz_mm = [300.0, -150.0, 50.0]
wpr_deg = [0.0, 0.0, 90.0]
"""
PULSES = np.array([1435.0, 1300.0, -1280.0, 1100.0, 1000.5, 700.0])


@cache
def fitted(arm, kind="kinematic"):
    """A model of a virtual arm; of the kind "nominal" it equals the nominal arm."""
    session = ta.simulate(arm, poses=60, seed=1).session
    return ta.fit(arm, session, model=kind).model


def joints_of(arm, n, seed=2):
    """Joints near those of the readings."""
    lower, upper = {
        "ur10": ([-2.0, -2.2, -2.2, -2.0, 0.6, -2.5], [2.0, -0.9, -0.9, -0.5, 2.4, 2.5]),
        "lrmate200id": ([-1.0, -0.3, -0.6, -2.0, -1.6, -3.0], [1.0, 0.6, 0.2, 2.0, -0.4, 3.0]),
        "gp7": ([-1.0, -0.3, -0.6, -1.5, -1.6, -3.0], [1.0, 0.6, 0.2, 1.5, -0.4, 3.0]),
    }[arm]
    return np.random.default_rng(seed).uniform(lower, upper, (n, 6))


def flange_poses(chain, joints):
    """(n, 4, 4) poses of the flange."""
    pose = chain.with_tip(np.zeros(3)).pose(joints)
    T = np.tile(np.eye(4), (len(joints), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = pose
    return T


def in_work(chain, joints, tool=TOOL, work=WORK):
    """(n, 4, 4) poses of the tool in the work frame."""
    return np.linalg.inv(work) @ flange_poses(chain, joints) @ tool


def wpr(R):
    return Rotation.from_matrix(R).as_euler("xyz", degrees=True)


def field(value):
    """A number as a Fanuc controller prints it."""
    text = f"{value:.3f}"
    return (text.replace("0.", ".", 1) if abs(value) < 1 else text).rjust(10)


def fanuc_block(number, T, joints_deg, head="\tUF : 1, UT : 3,\t\t"):
    turns = ", ".join(str(int(np.floor((joints_deg[i] + 180) / 360))) for i in (0, 3, 5))
    lines = [f"P[{number}]{{", "   GP1:", f"{head}CONFIG : '{'N' if joints_deg[4] < 0 else 'F'} U T, {turns}',"]
    xyz = [f"{name} ={field(value)}  mm" for name, value in zip("XYZ", T[:3, 3], strict=True)]
    angles = [f"{name} ={field(value)} deg" for name, value in zip("WPR", wpr(T[:3, :3]), strict=True)]
    return "\r\n".join([*lines, "\t" + ",\t".join(xyz) + ",", "\t" + ",\t".join(angles), "};"])


def fanuc_joint_block(number, joints_deg):
    """Joints as the pendant counts them."""
    values = [f"J{i}={field(value)} deg" for i, value in enumerate(joints_deg, 1)]
    head = [f'P[{number}:"rest"]{{', "   GP1:", "\tUF : 0, UT : 3,\t"]
    return "\r\n".join([*head, "\t" + ",\t".join(values[:3]) + ",", "\t" + ",\t".join(values[3:]), "};"])


def fanuc_program(blocks, moves):
    lines = ["/PROG  MADE", "/ATTR", 'COMMENT\t\t= "made";', "/APPL", "/MN"]
    lines += [f"{i:4d}:{move} ;" for i, move in enumerate(moves, 1)]
    return "\r\n".join([*lines, "/POS", *blocks, "/END", ""])


def pose_numbers(T):
    """x, y, z [m] and rotation vector [rad]."""
    return [*(T[:3, 3] / 1000), *Rotation.from_matrix(T[:3, :3]).as_rotvec()]


def listed(values, digits=12):
    return ", ".join(
        f"{value:.{digits}f}".replace("0.", ".", 1) if abs(value) < 1 else f"{value:.{digits}f}" for value in values
    )


def polyscope_script(chain, joints, tool=TOOL):
    """As PolyScope exports it: every point as a pose and as joints."""
    lines = ["def made():", f"  set_tcp(p[{listed(pose_numbers(tool), 15)}])"]
    for i, (T, q) in enumerate(zip(in_work(chain, joints, tool, np.eye(4)), joints, strict=True), 1):
        lines += [
            f"  global P_{i}_p=p[{listed(pose_numbers(T))}]",
            f"  global P_{i}_q=[{', '.join(map(repr, q.tolist()))}]",
        ]
    lines += ["  while (True):"]
    for i in range(1, len(joints) + 1):
        lines += [f'    $ {i} "P_{i}"', f"    movej(get_inverse_kin(P_{i}_p, qnear=P_{i}_q), a=1.39, v=1.04)"]
    return "\n".join([*lines, "  end", "end", ""])


@cache
def calibrated():
    """The kinematics of one UR10: a millimetre and a milliradian from the drawing in each link."""
    rng, fixed = np.random.default_rng(3), ta.load_arm("ur10").chain.fixed.copy()
    for i in range(1, 6):
        change = np.eye(4)
        change[:3, :3] = Rotation.from_rotvec(rng.normal(0.0, 1e-3, 3)).as_matrix()
        change[:3, 3] = rng.normal(0.0, 0.5, 3)
        fixed[i] = fixed[i] @ change
    return Chain(fixed, np.zeros(3))


def kinematics_rows():
    """Its table as a controller writes it: lengths along nearly parallel axes are hundreds of metres."""
    table = dh_table(calibrated(), max_offset_mm=1e8)
    return {"deltaTheta": table.theta, "a": table.a / 1000, "d": table.d / 1000, "alpha": table.alpha}


def kinematics_node(status="LINEARIZED", tag="Kinematics"):
    rows = "".join(f'<{key} value="{", ".join(map(repr, row.tolist()))}"/>' for key, row in kinematics_rows().items())
    return f'<{tag} status="{status}" validChecksum="true">{rows}<jointChecksum value="1, 2, 3, 4, 5, 6"/></{tag}>'


def calibration_yaml():
    """The same as the ROS driver writes it: R = Rx(roll) Ry(pitch) Rz(yaw)."""
    names = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    fixed = calibrated().fixed.copy()
    fixed[5] = fixed[5] @ fixed[6]
    lines = ["kinematics:"]
    # The last link carries the flange: its pose moves with joint 6, about whose axis it is turned and shifted only.
    for name, T in zip(names, fixed[:6], strict=True):
        angles = Rotation.from_matrix(T[:3, :3]).as_euler("XYZ")
        lines.append(f"  {name}:")
        lines += [f"    {key}: {float(value)!r}" for key, value in zip("xyz", T[:3, 3] / 1000, strict=True)]
        lines += [f"    {key}: {float(value)!r}" for key, value in zip(("roll", "pitch", "yaw"), angles, strict=True)]
    return "\n".join([*lines, "  hash: calib_12345", ""])


def waypoint(name, joints, kinematics=None, kind="Fixed", feature=None):
    feature = feature or [0.0] * 6
    return (
        f'<Waypoint type="{kind}" name="{name}" kinematicsFlags="1"><motionParameters/>\n  <position>\n'
        f'    <JointAngles angles="{", ".join(map(repr, map(float, joints)))}"/>\n'
        f'    <TCPOffset pose="{", ".join(repr(float(value)) for value in pose_numbers(TOOL))}"/>\n'
        f"    {kinematics or kinematics_node()}\n  </position>\n"
        f'  <BaseToFeature pose="{", ".join(map(repr, feature))}"/>\n</Waypoint>'
    )


def old_waypoint(name, joints, feature):
    """PolyScope 3: joints, and three poses that belong to them."""
    T = flange_poses(calibrated(), joints[None])[0]
    poses = [T @ TOOL, np.linalg.inv(feature) @ T @ TOOL, T]
    texts = [", ".join(repr(float(value)) for value in pose_numbers(pose)) for pose in poses]
    return (
        f'<Waypoint type="Fixed" name="{name}"><position joints="{", ".join(map(repr, joints.tolist()))}" '
        f'pose="{texts[0]}"/><poseInFeatureCoordinates pose="{texts[1]}"/>'
        f'<outputFlangePose pose="{texts[2]}"/></Waypoint>'
    )


def polyscope_program(waypoints, motion="MoveJ", kinematics=""):
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\r\n<URProgram name="made" crcValue="1">\r\n'
        f'{kinematics}<children><MainProgram><children><Move motionType="{motion}"><children>\r\n'
        + "\r\n".join(waypoints)
        + "\r\n</children></Move></children></MainProgram></children></URProgram>"
    )


def yaskawa_job(points, moves, counts=None):
    """A job of lines of //POS and of instructions."""
    taught = sum(line.startswith("C") for line in points) if counts is None else counts
    lines = ["/JOB", "//NAME MADE", "//POS", f"///NPOS {taught},0,0,0,0,0", *points]
    lines += ["//INST", "///DATE 2026/11/28 10:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP", *moves, "END"]
    return "\r\n".join([*lines, ""])


def yaskawa_pose(name, T):
    values = [*(f"{value:.3f}" for value in T[:3, 3]), *(f"{value:.4f}" for value in wpr(T[:3, :3]))]
    return f"{name}={','.join(values)}"


def yaskawa_pulses(name, joints):
    return f"{name}={','.join(str(round(value)) for value in np.degrees(joints) * PULSES)}"
