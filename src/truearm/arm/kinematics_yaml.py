"""Kinematics yaml of makers' ROS descriptions, which stand beside a xacro: a pose for each joint in the one before.

UFACTORY's (``xarm6_kinematics_*.yaml``) has ``kinematics:`` and ``joint1`` .. ``jointN``. Franka's has the joints at
its root, each under ``kinematic:``, and after the seven that turn ``joint8``, the flange. All joints turn about z;
lengths in m, roll, pitch and yaw as a URDF reads them. Universal Robots' is of its own kind
(`truearm.arm.ur_kinematics`).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.ur_kinematics import LINKS, MAX_BYTES, parse_ur_kinematics, pose_of
from truearm.errors import InputError
from truearm.files.file_reading import parse_file
from truearm.files.foreign_documents import YamlNode, parse_yaml
from truearm.typing import FloatArray

FRANKA_JOINTS = 7
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
MAX_JOINTS = 20


class JointPoses(NamedTuple):
    """The poses of a maker's file.

    Attributes
    ----------
    names : tuple of str
        Of the joints that turn.
    nodes : list of list
        x, y, z, roll, pitch, yaw of every joint, of the flange too, where the file has one.
    fixed : (n_joints + 1, 4, 4) array
        As a chain has them [mm].
    """

    names: tuple[str, ...]
    nodes: list[list[YamlNode]]
    fixed: FloatArray


def read_kinematics_yaml(path: str | Path) -> Arm:
    """Read the kinematics yaml of Universal Robots, UFACTORY or Franka as an arm, which ends at its flange.

    Raises
    ------
    InputError
        If the file is missing, too large or no YAML, has other keys, or values that cannot be metres and radians.
    """
    path = Path(path)
    return parse_file(path, partial(_arm_of, name=path.stem), limit_bytes=MAX_BYTES)


def _arm_of(content: bytes, name: str) -> Arm:
    root = parse_yaml(content)
    entries = (root.entries or {}).get("kinematics", root).entries or {}
    if "joint1" not in entries:
        return parse_ur_kinematics(content, name=name)
    poses = joint_poses(root)
    maker = "Franka" if len(poses.nodes) > len(poses.names) else "UFACTORY"
    return Arm(
        name=name,
        chain=Chain(poses.fixed, np.zeros(3)),
        title=f"{maker} arm {name}, kinematics yaml",
        joint_names=poses.names,
        source=f"{maker} kinematics yaml",
    )


def joint_poses(root: YamlNode) -> JointPoses:
    """The poses of all joints of UFACTORY's or Franka's file.

    Raises
    ------
    InputError
        If its keys are not ``joint1``, ``joint2``, .., or a pose is none.
    """
    entries = (root.entries or {}).get("kinematics", root).entries or {}
    names = [f"joint{i + 1}" for i in range(len(entries))]
    if not entries or set(entries) != set(names) or len(names) > MAX_JOINTS:
        raise InputError(
            f"expected the joints joint1, joint2, .. of UFACTORY or Franka, or the links {', '.join(LINKS)} of "
            f"Universal Robots, got {', '.join(entries)[:200] or 'none'}",
            line=root.line,
        )
    poses = [(entries[name].entries or {}).get("kinematic", entries[name]) for name in names]
    frames = [pose_of(name, pose, "urdf") for name, pose in zip(names, poses, strict=True)]
    has_flange = len(names) == FRANKA_JOINTS + 1 and "kinematic" in (entries[names[0]].entries or {})
    nodes = [[pose.mapping("a pose", required=POSE)[key] for key in POSE] for pose in poses]
    fixed = np.array(frames if has_flange else [*frames, np.eye(4)])
    return JointPoses(tuple(names[: len(fixed) - 1]), nodes, fixed)
