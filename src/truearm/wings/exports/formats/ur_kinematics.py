"""Kinematics yaml of a UR from a model: the best rigid stand-in in the file that the ROS driver's description reads.

The file has six link poses in the robot's own base and nothing after the last joint: its flange, `tool0`, stays the
nominal one, and the tip that was measured is a tool in it, which a comment states.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.acceptance import contradict
from truearm.arm import Arm, load_arm
from truearm.arm.kinematics_yaml import JOINTS, LINKS, parse_ur_kinematics, read_ur_kinematics, ur_hash
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.formats.constants_table import ConstantsFile, ConstantsRequest, writer
from truearm.wings.exports.formats.joint_offsets import pose_lines, yaml_number
from truearm.wings.exports.formats.rigid_arm import RigidArm
from truearm.wings.exports.targets.manifest import Manifest

# The angles between neighbouring axes of every UR [deg], and how far a calibrated one may be off.
UR_AXES_DEG = (90.0, 0.0, 0.0, 90.0, 90.0)
MAX_OFF_DEG = 3.0
# A robot's own factory calibration is nearer to it than its type's nominal arm; another type's is many times as far.
MAX_FARTHER, MIN_FARTHER_MM = 3.0, 1.0
TOOL_MARK = "tip in tool0 [m]:"
_TOOL = re.compile(rf"^# {re.escape(TOOL_MARK)} (\S+) (\S+) (\S+)$", re.MULTILINE)


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    """The source is the file that the driver wrote for this robot: its hash is kept, and its frames are nominal."""
    model, source = request.model, request.source
    if request.frame != "base":
        raise InputError("a UR's kinematics yaml is in the robot's own base frame", hint="leave out --frame")
    nominal = model.arm_ if source is None else read_ur_kinematics(source)
    _check_ur(nominal)
    found = ur_hash(nominal)
    if found is None:
        raise InputError(
            "the hash by which the driver recognises the robot is not known: it belongs to the controller",
            file=source,
            hint="give the file that the driver wrote for this robot: --original my_robot_calibration.yaml",
        )
    if not np.allclose(nominal.chain.fixed[-1], np.eye(4), rtol=0, atol=1e-9):
        raise InputError(
            f"the arm {nominal.name!r} has a flange after joint 6, for which the file has no place",
            hint="let the arm end at tool0, and set what is mounted there as a tool",
        )
    rigid = request.rigid_arm(None if source is None else nominal)
    check_same_robot(model, rigid, source)
    tool = rigid.arm.chain.tip_in_flange  # after the last link the file has no motion
    text = ur_kinematics_text(list(rigid.arm.chain.fixed[: len(LINKS)]), found)
    written = parse_ur_kinematics(text.encode(), name=rigid.arm.name).chain.with_tip(tool)

    return ConstantsFile(rigid, written, lambda manifest: f"{comments(manifest, tool)}{text}")


def comments(manifest: Manifest, tool: FloatArray) -> str:
    """Lines for the head of a kinematics yaml: its origin, and the tip in the flange [mm]."""
    lines = [
        f"# {manifest.line()}",
        "# Angles as a URDF reads them: R = Rz(yaw) Ry(pitch) Rx(roll).",
        "# The tip that was measured is no part of the robot: set it as a tool.",
        f"# {TOOL_MARK} {' '.join(yaml_number(value) for value in tool / MM_PER_M)}",
    ]
    return "\n".join([*lines, ""])


def ur_kinematics_text(links: Sequence[FloatArray], calibration_hash: str) -> str:
    """The content of the file with the poses of its links, each (4, 4) in the one before [mm]."""
    if not re.fullmatch(r"calib_[0-9]{1,20}", calibration_hash):
        raise InputError(f"expected a hash as calib_3437785250745286433, got {calibration_hash[:60]!r}")
    lines = ["kinematics:"]
    for name, frame in zip(LINKS, links, strict=True):
        lines += [f"  {name}:", *pose_lines(frame)]
    return "\n".join([*lines, f"  hash: {calibration_hash}", ""])


def check_same_robot(model: Compensator, rigid: RigidArm, source: str | Path | None) -> None:
    """Refuse a file whose robot is farther from the model than the nominal arm: its hash would name another robot."""
    off = model.nominal_.chain.tip_in_base(rigid.poses) - model.predict(rigid.poses)
    nominal_mm = float(np.linalg.norm(off, axis=1).mean())
    if source is not None and rigid.loss.nominal_mm > max(MAX_FARTHER * nominal_mm, MIN_FARTHER_MM):
        contradict(
            InputError(
                f"the robot in it misses the model's points by {rigid.loss.nominal_mm:.3g} mm on average, the nominal "
                f"arm by {nominal_mm:.3g} mm: it is the file of another robot",
                file=source,
                hint="give the file that the driver wrote for this robot",
            )
        )


def tips(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
    """(n, 3) tips [mm] in the base at joints (n, n_joints) [rad]: of the tool in the comment, else the flange."""
    arm = load_arm(Path(path))
    if np.shape(joints)[-1:] != (arm.n_joints,):
        raise InputError(f"expected {arm.n_joints} joints, got {np.shape(joints)[-1:]}", file=path)
    stated = _TOOL.search(Path(path).read_text("utf-8"))  # its size is checked
    tool = np.zeros(3)
    if stated is not None:
        try:
            tool = MM_PER_M * np.array([float(number) for number in stated.groups()])
        except ValueError:
            tool = np.full(3, np.nan)
        if not np.isfinite(tool).all():
            raise InputError(f"expected three finite numbers after {TOOL_MARK!r}", file=path)
    return arm.chain.with_tip(tool).tip_in_base(joints)


def _check_ur(arm: Arm) -> None:
    """Refuse an arm that has other axes than a UR."""
    chain = arm.chain
    hint = f"a UR has six turning joints: {', '.join(JOINTS)}"
    if chain.n_joints != len(LINKS) or chain.is_prismatic.any():
        raise InputError(f"expected a UR, got the arm {arm.name!r} of {chain.n_joints} joints", hint=hint)
    for i, expected in enumerate(UR_AXES_DEG, 1):
        cos = float(np.clip(abs(chain.fixed[i, 2, 2]), 0.0, 1.0))
        angle = float(np.degrees(np.arccos(cos)))
        if abs(angle - expected) > MAX_OFF_DEG:
            raise InputError(
                f"expected a UR, got the arm {arm.name!r}: its axes {i} and {i + 1} are at {angle:.0f} deg, "
                f"those of a UR at {expected:.0f} deg",
                hint=hint,
            )


write = writer("ur-kinematics", _file_of)
