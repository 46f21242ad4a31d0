"""Kinematics yaml of makers' ROS descriptions, which stand beside a xacro: a pose for each joint in the one before.

UFACTORY's (``xarm6_kinematics_*.yaml``) has ``kinematics:`` and ``joint1`` .. ``jointN``. Franka's has the joints at
its root, each under ``kinematic:``, and after the seven that turn ``joint8``, the flange. All joints turn about z;
lengths in m, roll, pitch and yaw as a URDF reads them.

Universal Robots' is the factory calibration of one robot. It has for each of six links its pose in the link before,
``x y z`` [m] and ``roll pitch yaw`` [rad], and a hash of the controller's constants, by which the driver recognises the
robot. The first pose is in the controller's base frame, the frame of the last link is the flange (``tool0``).

Two readings of its angles exist. ``ur_description`` hands them to a URDF: R = Rz(yaw) Ry(pitch) Rx(roll). The tool that
writes the files, ``ur_calibration``, splits its rotations as R = Rx(roll) Ry(pitch) Rz(yaw). `docs/export.md` has the
proof, and what the difference is worth in millimetres. Older versions of that tool also turn the forearm by half a turn
if the controller's theta of joint 2 is beyond 90 deg; such an arm is read as it is, and its title says so.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import frame_from_xyz_rpy
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.files.file_reading import parse_file
from truearm.files.foreign_documents import YamlNode, parse_yaml
from truearm.typing import FloatArray

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
# A file of a robot has 1 kB; comments may follow.
MAX_BYTES = 200_000
# No link of a UR is longer; in millimetres every one of them would be.
MAX_LENGTH_M = 5.0
MAX_ANGLE = 2 * np.pi
# Of a UR at work: elbow up, tool down.
WORKING_DEG = (0.0, -110.0, -90.0, -70.0, 90.0, 0.0)
_HASH = re.compile(r"calib_[0-9]{1,20}")
SOURCE = "UR kinematics yaml"
FRANKA_JOINTS = 7
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
MAX_JOINTS = 20

Angles = Literal["urdf", "controller"]


def read_ur_kinematics(path: str | Path, *, angles: Angles = "urdf") -> Arm:
    """Read a kinematics yaml of a UR as an arm.

    Parameters
    ----------
    path : path
    angles : {"urdf", "controller"}
        Reading of roll, pitch and yaw: that of a URDF, which ROS makes of the file; or that of the tool which wrote the
        file, which gives the controller's own kinematics.

    Returns
    -------
    Arm
        Joints by the names of the driver, limits of two turns, the flange as its tip. Its source has the hash.

    Raises
    ------
    InputError
        If the file is missing, too large or no YAML, has other links or keys, or values that are no finite numbers or
        cannot be metres and radians.
    """
    path = Path(path)
    return parse_file(path, partial(parse_ur_kinematics, name=path.stem, angles=angles), limit_bytes=MAX_BYTES)


def parse_ur_kinematics(content: bytes, *, name: str, angles: Angles = "urdf") -> Arm:
    """The arm of a kinematics yaml's content; parameters and errors as of `read_ur_kinematics`."""
    links, found = _links_of(parse_yaml(content), angles)
    fixed = np.array([*links, np.eye(4)])
    turns = np.full(6, 2 * np.pi)
    return Arm(
        name=name or "ur",
        chain=Chain(fixed, np.zeros(3)),
        title=_title(name, links),
        joint_names=JOINTS,
        lower=-turns,
        upper=turns,
        working_pose=np.deg2rad(WORKING_DEG),
        source=f"{SOURCE}, {found}" if found else SOURCE,
    )


def ur_hash(arm: Arm) -> str | None:
    """The hash of the kinematics yaml that an arm was read from; None of any other."""
    prefix, _, found = arm.source.partition(", ")
    return found if prefix == SOURCE and _HASH.fullmatch(found) else None


def _title(name: str, links: Sequence[FloatArray]) -> str:
    title = f"Universal Robots arm {name}, factory calibration"
    # At zero a UR is stretched: the wrist lies beyond the elbow, where the elbow lies beyond the shoulder.
    elbow_in_upper_arm = links[2][:3, 3]
    wrist_in_upper_arm = links[2][:3, :3] @ links[3][:3, 3]
    folded = float(elbow_in_upper_arm[:2] @ wrist_in_upper_arm[:2]) < 0
    return f"{title}; folded at the elbow where a UR's zero is stretched" if folded else title


def _links_of(root: YamlNode, angles: Angles) -> tuple[list[FloatArray], str]:
    """Poses of the links [mm] and the hash, empty without."""
    kinematics = root.mapping("a UR's kinematics yaml", required=("kinematics",))["kinematics"]
    entries = kinematics.mapping("kinematics", required=LINKS, optional=("hash",))
    found = ""
    if "hash" in entries:
        found = entries["hash"].text or ""
        if not _HASH.fullmatch(found):
            raise InputError(
                f"expected the hash as calib_ and digits, got {found[:60]!r}",
                line=entries["hash"].line,
                hint="copy it from the file that the driver wrote for this robot",
            )
    return [pose_of(name, entries[name], angles) for name in LINKS], found


def pose_of(name: str, link: YamlNode, angles: Angles) -> FloatArray:
    """The pose (4, 4) [mm] of six numbers in m and rad.

    Raises
    ------
    InputError
        If they are others, or cannot be metres and radians.
    """
    entries = link.mapping(f"the link {name}", required=("x", "y", "z", "roll", "pitch", "yaw"))
    xyz = [entries[key].number(f"{key} of {name}") for key in ("x", "y", "z")]
    rpy = [entries[key].number(f"{key} of {name}") for key in ("roll", "pitch", "yaw")]
    for what, values, limit, unit in (("length", xyz, MAX_LENGTH_M, "m"), ("angle", rpy, MAX_ANGLE, "rad")):
        if max(map(abs, values)) > limit:
            raise InputError(
                f"expected every {what} of {name} within {limit:.3g} {unit}, got {max(values, key=abs):.6g}",
                line=link.line,
                hint="the file has metres and radians",
            )
    frame = frame_from_xyz_rpy(MM_PER_M * np.array(xyz), rpy)
    if angles == "controller":
        frame[:3, :3] = Rotation.from_euler("XYZ", rpy).as_matrix()
    return frame


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
