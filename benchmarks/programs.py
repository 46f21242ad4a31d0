"""Corrected robot programs: the tip at the pose meant, the inverse kinematics of every configuration, and the speed.

Programs are made of virtual arms' poses in a tool and a work frame, in the language of each maker's controller. What a
controller does with a corrected program is computed by the arm as drawn.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.rows import RowResult, Rows, Target, cpu_seconds_of
from truearm.arm import Chain, load_arm
from truearm.arm.rigid_motions import inverse
from truearm.files.toml_documents import parse_toml
from truearm.models import Compensator, PhysicalModel
from truearm.typing import FloatArray
from truearm.wings.exports.programs.branches import QUANTITIES, Screws, inverse_branches, polished, quantities_of
from truearm.wings.exports.programs.correct_program import correct_program, language_of
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.program import Program, Surroundings
from truearm.wings.exports.programs.solving import Solver
from truearm.wings.exports.targets.edits import Edit, with_edits
from truearm.wings.exports.targets.pose_models import nominal_poses, with_tool
from truearm.wings.planning.virtual import VirtualArm

ROWS = Rows()
NONE = "9E9,9E9,9E9,9E9,9E9,9E9"
TOOL = "xyz_mm = [35.0, -20.0, 140.0]\nwpr_deg = [0.0, 30.0, 0.0]"
WORK = "xyz_mm = [300.0, -150.0, 50.0]\nwpr_deg = [0.0, 0.0, 90.0]"
# The nest of the reference instrument, in the flange [mm]: away from the last axis, or the flange's turn is unknown.
NEST = (70.0, 0.0, 110.0)
FRAMES = f"""controller = "nominal"
[tools.3]
{TOOL}
[tools.t3]
{TOOL}
[works.1]
{WORK}
[works.w1]
{WORK}
"""
FRAMES_FILE = parse_toml(FRAMES.encode("ascii"), FramesFile)


def rapid(n: int) -> str:
    """A module of n points."""
    point = f"[[1.00,1.00,1.00],[1.000000,0.000000,0.000000,0.000000],[0,0,0,0],[{NONE}]]"
    points = [f"  CONST robtarget p{i}:={point};" for i in range(n)]
    moves = [f"    MoveL p{i},v100,fine,t3\\WObj:=w1;" for i in range(n)]
    return "\n".join(["MODULE Made", *points, "  PROC main()", *moves, "  ENDPROC", "ENDMODULE", ""])


def krl(n: int) -> str:
    """A file of n points."""
    lines = [f"LIN {{X 1.000,Y 1.000,Z 1.000,A 0.0000,B 0.0000,C 0.0000,S 2,T 0}} ;{i}" for i in range(n)]
    return "\n".join(["&ACCESS RVP", "DEF Made( )", "BAS(#TOOL,3)", "BAS(#BASE,1)", *lines, "END", ""])


def fanuc(n: int) -> str:
    """A listing of n points."""
    xyz = ",\t".join(f"{name} =     1.000  mm" for name in "XYZ")
    wpr = ",\t".join(f"{name} =     0.000 deg" for name in "WPR")
    points = [
        f"P[{i}]{{\n   GP1:\n\tUF : 1, UT : 3,\t\tCONFIG : 'N U T, 0, 0, 0',\n\t{xyz},\n\t{wpr}\n}};"
        for i in range(1, n + 1)
    ]
    moves = [f"{i:4d}:L P[{i}] 100mm/sec FINE    ;" for i in range(1, n + 1)]
    return "\n".join(["/PROG  MADE", "/ATTR", "/APPL", "/MN", *moves, "/POS", *points, "/END", ""])


def urscript(n: int) -> str:
    """A script of n points, each as a pose and as joints, which fills in `made`."""
    tool = ", ".join(["0.035", "-0.020", "0.140", "0", repr(float(np.radians(30.0))), "0"])
    lines = ["def made():", f"  set_tcp(p[{tool}])"]
    for i in range(n):
        lines += [f"  global P{i}_p=p[POSE{i}]", f"  global P{i}_q=[JOINTS{i}]"]
    lines += [f"  movej(get_inverse_kin(P{i}_p, qnear=P{i}_q), a=1.4, v=1.0)" for i in range(n)]
    return "\n".join([*lines, "end", ""])


def filled(script: str, poses: FloatArray, joints: FloatArray) -> bytes:
    """A script with the points of poses (n, 4, 4) and joints (n, 6), which must agree."""
    numbers = {}
    for i, (T, q) in enumerate(zip(poses, joints, strict=True)):
        rotation = Rotation.from_matrix(T[:3, :3]).as_rotvec()
        numbers[f"POSE{i}"] = [*(T[:3, 3] / 1000), *rotation]
        numbers[f"JOINTS{i}"] = list(q)
    return re.sub(
        r"(?:POSE|JOINTS)\d+", lambda match: ", ".join(f"{one:.12f}" for one in numbers[match[0]]), script
    ).encode("ascii")


# An arm of each maker: its language, the ending, the joints in use [rad], and the name of the tool and work frame.
ARMS: Mapping[str, tuple[Callable[[int], str], str, tuple[Sequence[float], Sequence[float]]]] = {
    "ur10": (urscript, ".script", ([-2.0, -2.2, -2.2, -2.0, 0.6, -2.5], [2.0, -0.9, -0.9, -0.5, 2.4, 2.5])),
    "irb2600-12-165": (rapid, ".mod", ([-1.0, -0.4, -0.6, -1.0, 0.4, -1.5], [1.0, 0.8, 0.6, 1.0, 1.6, 1.5])),
    "kr16": (krl, ".src", ([-1.0, -1.7, 1.2, -1.0, 0.4, -1.5], [1.0, -0.7, 2.2, 1.0, 1.6, 1.5])),
    "lrmate200id": (fanuc, ".ls", ([-1.0, -0.3, -0.6, -1.5, -1.6, -2.0], [1.0, 0.6, 0.2, 1.5, -0.4, 2.0])),
}


@cache
def fitted(name: str, readings: int) -> tuple[VirtualArm, Compensator]:
    """A virtual arm and its model."""
    arm = load_arm(name)
    arm = replace(arm, chain=arm.chain.with_tip(NEST))
    virtual = VirtualArm.draw(arm, "research", seed=1)
    joints = np.random.default_rng(2).uniform(*ARMS[name][2], (readings, 6))
    measured = virtual.measure(joints, seed=3).readings
    return virtual, PhysicalModel(arm).fit_readings(replace(measured, directions=None))


def made(name: str, joints: FloatArray) -> bytes:
    """A program of an arm that goes to joints (n, 6)."""
    arm = load_arm(name)
    empty, chain = ARMS[name][0](len(joints)), arm.chain.with_tip(np.zeros(3))
    if name == "ur10":
        return filled(empty, poses_of(chain, joints) @ FRAMES_FILE.tools["3"].T, joints)
    text = empty.encode("ascii")
    language = language_of(text)
    assert language is not None
    program = read(text)
    counted = language.controller_joints(arm.chain, joints)
    screws = Screws.of(arm.chain)
    assert screws is not None
    stated = quantities_of(screws, joints, counted).tolist()
    edits: list[Edit] = []
    for target, q, row, flange in zip(program.targets, counted, stated, poses_of(chain, joints), strict=True):
        assert target.T_flange_tool is not None
        assert target.T_base_work is not None
        pose = inverse(target.T_base_work) @ flange @ target.T_flange_tool
        for part, value in language.values(target, q, pose).items():
            number = target.numbers[part]
            decimals = len(number.text.partition(b".")[2])
            edits.append(Edit(number.start, number.end, language.number_text(number, value, decimals)))
        if target.conditions:
            edits += language.configuration(target, dict(zip(QUANTITIES, row, strict=True)))
    return with_edits(text, edits)


def poses_of(chain: Chain, joints: FloatArray) -> FloatArray:
    """(n, 4, 4) flanges of a chain without a tip."""
    T = np.tile(np.eye(4), (len(joints), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = chain.pose(joints)
    return T


def read(text: bytes) -> Program:
    """A program with the frames of this file."""
    language = language_of(text)
    assert language is not None
    return language.read(text, Surroundings(None, FRAMES_FILE))


def correct(model: Compensator, name: str, text: bytes) -> tuple[bytes, int]:
    """The corrected program, and how many of its targets were not corrected."""
    with tempfile.TemporaryDirectory() as folder:
        file, frames = Path(folder, "made" + ARMS[name][1]), Path(folder, "frames.toml")
        file.write_bytes(text)
        frames.write_text(FRAMES, encoding="ascii")
        found = correct_program(model, file, frames=frames, untrained="accept")
        return found.content, len(found.refused) + sum(one.is_literal for one in found.left)


def joints_of(model: Compensator, text: bytes) -> FloatArray:
    """Joints (n, 6) to which the controller of the arm as drawn goes."""
    program, language = read(text), language_of(text)
    assert language is not None
    joints, reasons = Solver(model, language, None, "command", "accept").nominal(program.targets, None)
    assert not any(reasons), reasons
    return joints


@ROWS.row("tip", quick={"targets": 50, "readings": 100})
def tip(targets: int = 500, readings: int = 1000) -> RowResult:
    """Cartesian programs corrected: distance of the tool of virtual arms from the pose meant, mean [mm]."""
    table, judged = [], []
    for name in ARMS:
        virtual, model = fitted(name, readings)
        joints = np.random.default_rng(4).uniform(*ARMS[name][2], (targets, 6))
        text = made(name, joints)
        new, refused = correct(model, name, text)
        planned, sent = joints_of(model, text), joints_of(model, new)
        tool = FRAMES_FILE.tools["3"].T
        equipped = with_tool(model, np.concatenate([tool[:3, 3], np.radians([0.0, 30.0, 0.0])]))
        meant = nominal_poses(equipped).pose(planned, np.arange(targets)).tip_in_base

        def true(q: FloatArray, virtual: VirtualArm = virtual, tool: FloatArray = tool) -> FloatArray:
            motions = virtual.motions(q)
            motions[:, -1] = 0.0  # the errors of the tip are those of the nest of the reference
            return virtual.nominal.chain.with_tip(tool[:3, 3]).tip_in_base(q, motions)

        error = float(np.linalg.norm(true(sent) - meant, axis=1).mean())
        own = float(np.linalg.norm(equipped.predict(sent) - true(sent), axis=1).mean())
        without = float(np.linalg.norm(true(planned) - meant, axis=1).mean())
        language = language_of(text)
        table.append({
            "arm": name,
            "language": "" if language is None else language.title,
            "targets": targets,
            "not corrected": refused,
            "without [mm]": without,
            "corrected [mm]": error,
            "model's own [mm]": own,
        })  # fmt: skip
        judged.append(Target(f"Cartesian program of {name}: tip error / model's own", error / own, 1.05))
    return RowResult(table, judged)


@ROWS.row("inverse", quick={"poses": 100})
def inverse_kinematics(poses: int = 1000) -> RowResult:
    """Inverse kinematics in closed form: joints of every branch, there and back [rad]."""
    table, judged = [], []
    for name in (*ARMS, "gp8"):
        arm = load_arm(name)
        low, high = np.maximum(arm.lower, -3.1), np.minimum(arm.upper, 3.1)
        joints = np.random.default_rng(0).uniform(low, high, (poses, 6))
        chain, screws = arm.chain.with_tip(np.zeros(3)), Screws.of(arm.chain)
        assert screws is not None
        flange = poses_of(chain, joints)
        branches = inverse_branches(arm.chain, screws, flange).reshape(-1, 6)
        found = polished(arm.chain, np.repeat(flange, 8, axis=0), branches)
        good = np.isfinite(found).all(axis=1)
        off = np.abs(np.remainder(found.reshape(poses, 8, 6) - joints[:, None] + np.pi, 2 * np.pi) - np.pi)
        again = poses_of(chain, found[good]) - np.repeat(flange, 8, axis=0)[good]
        worst = float(np.nanmin(off.max(axis=2), axis=1).max())
        table.append({
            "arm": name,
            "poses": poses,
            "branches of a pose": good.sum() / poses,
            "joints [rad]": worst,
            "flange of every branch [mm]": float(np.abs(again[:, :3, 3]).max()),
        })  # fmt: skip
        judged.append(Target(f"inverse kinematics of {name}, there and back [rad]", worst, 1e-9))
    return RowResult(table, judged)


@ROWS.row("speed", quick={"targets": 300, "readings": 100})
def speed(targets: int = 10_000, readings: int = 1000) -> RowResult:
    """Cartesian targets of one program, physical model: reading, correcting and writing, CPU [s]."""
    table, judged = [], []
    for name in ARMS:
        _, model = fitted(name, readings)
        joints = np.random.default_rng(4).uniform(*ARMS[name][2], (targets, 6))
        text = made(name, joints)
        seconds = cpu_seconds_of(lambda model=model, name=name, text=text: correct(model, name, text))
        table.append({"arm": name, "targets": targets, "CPU [s]": seconds})
        judged.append(Target(f"{targets} targets of {name}, physical model, CPU [s]", seconds, 3.0))
    return RowResult(table, judged)
