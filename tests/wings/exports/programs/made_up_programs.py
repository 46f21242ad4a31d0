"""Programs of the makers' languages for known joints, made without the readers."""

import warnings
from math import floor

import numpy as np
from scipy.spatial.transform import Rotation

NONE = "9E9,9E9,9E9,9E9,9E9,9E9"
TOOL = np.array([[0.0, 0.0, 1.0, 35.0], [0.0, 1.0, 0.0, -20.0], [-1.0, 0.0, 0.0, 140.0], [0.0, 0.0, 0.0, 1.0]])
WORK = np.array([[0.0, -1.0, 0.0, 300.0], [1.0, 0.0, 0.0, -150.0], [0.0, 0.0, 1.0, 50.0], [0.0, 0.0, 0.0, 1.0]])


def in_work(chain, joints, tool=TOOL, work=WORK):
    """(n, 4, 4) poses of the tool in the work frame."""
    pose = chain.with_tip(np.zeros(3)).pose(joints)
    T = np.tile(np.eye(4), (len(joints), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = pose
    return np.linalg.inv(work) @ T @ tool


def quaternion(R):
    return Rotation.from_matrix(R).as_quat(scalar_first=True)


def rapid_pose(T):
    x, q = T[:3, 3], quaternion(T[:3, :3])
    return f"[[{','.join(f'{one:.6f}' for one in x)}],[{','.join(f'{one:.9f}' for one in q)}]]"


def rapid_target(T, q, bits, *, mm=2, quaternion_digits=6):
    """A robtarget at a pose with joints [deg]; `bits` is cfx."""
    x = ",".join(f"{value:.{mm}f}" for value in T[:3, 3])
    orientation = ",".join(f"{value:.{quaternion_digits}g}" for value in quaternion(T[:3, :3]))
    cf = ",".join(str(floor(q[i] / 90)) for i in (0, 3, 5))
    return f"[[{x}],[{orientation}],[{cf},{bits}],[{NONE}]]"


def cfx(q, wrist_behind=False, elbow_behind=False):
    return 4 * wrist_behind + 2 * elbow_behind + (q[4] < 0)


def rapid_module(chain, joints, *, tool=TOOL, work=WORK, digits=(6, 10), behind=None, name="Made"):
    """A module with one MoveL and one MoveAbsJ for every row of joints [rad]."""
    poses = in_work(chain, joints, tool, work)
    lines = [f"MODULE {name}"]
    lines.append(f"  PERS tooldata tGrip:=[TRUE,{rapid_pose(tool)},[1,[0,0,1],[1,0,0,0],0,0,0]];")
    lines.append(f'  PERS wobjdata wTable:=[FALSE,TRUE,"",{rapid_pose(work)},[[0,0,0],[1,0,0,0]]];')
    for i, (T, q) in enumerate(zip(poses, np.degrees(joints), strict=True)):
        bits = cfx(q, *([False, False] if behind is None else behind[i]))
        lines.append(f"  CONST robtarget p{i}:={rapid_target(T, q, bits, mm=digits[0], quaternion_digits=digits[1])};")
    lines.append("  PROC main()")
    lines += [f"    MoveL p{i},v100,fine,tGrip\\WObj:=wTable;" for i in range(len(joints))]
    return "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def krl_frame(T, names=("X", "Y", "Z", "A", "B", "C"), decimals=6):
    """X, Y, Z [mm], A, B, C [deg]: turned about z, then about the new y, then about the new x."""
    with warnings.catch_warnings():  # at B = 90 deg one of several sets
        warnings.simplefilter("ignore")
        a, b, c = Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)
    values = (*T[:3, 3], a, b, c)
    return ",".join(f"{name} {value:.{decimals}f}" for name, value in zip(names, values, strict=True))


def krl_turn(q):
    return sum(1 << i for i in range(6) if q[i] < 0)


def krl_files(chain, joints, *, tool=TOOL, work=WORK, decimals=6, status=None, name="Made"):
    """A .src with a LIN to every row of joints [rad], its .dat with the points, and the $config.dat of both frames."""
    poses = in_work(chain, joints, tool, work)
    points, moves = [], []
    for i, (T, q) in enumerate(zip(poses, np.degrees(joints), strict=True)):
        s = (2 if status is None else status[i]) | (4 if q[4] < 0 else 0)
        points.append(f"DECL E6POS XP{i}={{{krl_frame(T, decimals=decimals)},S {s},T {krl_turn(q)},E1 0.0,E2 0.0}}")
        points.append(f'DECL FDAT FP{i}={{TOOL_NO 3,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}}')
        moves += [f"FDAT_ACT=FP{i}", f"LIN XP{i} C_DIS"]
    src = "\n".join(["&ACCESS RVP", "&REL 1", f"DEF {name}( )", *moves, "END", ""])
    dat = "\n".join(["&ACCESS RVP", "&REL 1", f"DEFDAT {name} PUBLIC", *points, "ENDDAT", ""])
    config = f"DEFDAT $CONFIG\nTOOL_DATA[3]={{{krl_frame(tool)}}}\nBASE_DATA[2]={{{krl_frame(work)}}}\nENDDAT\n"
    return {f"{name}.src": src, f"{name}.dat": dat, "$config.dat": config}
