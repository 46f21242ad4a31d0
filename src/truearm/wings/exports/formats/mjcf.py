"""MJCF of the best rigid stand-in: the robot's own model of MuJoCo with new poses of its bodies.

Only `pos` and the orientation of the bodies that joints move change, the latter written as a quaternion. Added are a
site at the identified tip and a text with the chain's ends; meshes, masses, actuators and all else stay, byte for byte.
"""

from __future__ import annotations

import re

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.catalogue import split_links
from truearm.arm.mjcf import MjcfRobot, mjcf_robot
from truearm.arm.urdf import MAX_BYTES, UrdfChain, free_name, spaced
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.typing import FloatArray
from truearm.wings.exports.formats import urdf
from truearm.wings.exports.formats.constants_table import ConstantsFile, ConstantsRequest, writer
from truearm.wings.exports.formats.rigid_arm import RigidArm
from truearm.wings.exports.formats.urdf import (
    TIP_LINK,
    new_origins,
    set_attributes,
    start_tag,
    tag_text,
    without_manifest,
)
from truearm.wings.exports.targets.edits import Edit, with_edits
from truearm.wings.exports.targets.manifest import Manifest

_ORIENTATION = re.compile(
    rb"""\s+(?:%b)\s*=\s*(?:"[^"]*"|'[^']*')"""
    % "|".join(name for name in MjcfRobot.orientations if name != "quat").encode()
)


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    if request.source is None:
        raise InputError("the robot's own model is not stated", hint="--original robot.xml; MuJoCo reads a URDF too")
    file, base, tip = split_links(request.source)
    content = read_limited(file, limit_bytes=MAX_BYTES)
    with InputError.of_file(file):
        robot = mjcf_robot(content)
        rigid = request.rigid_arm(robot.chain(base, tip).arm())
        _check_bodies(robot, robot.chain(base, tip), content)

    def edited(manifest: Manifest) -> bytes:
        kept = without_manifest(content)
        again = mjcf_robot(kept)
        return _edited(kept, again, again.chain(base, tip), rigid, manifest.of_joints(rigid.arm.joint_names))

    return ConstantsFile(rigid, rigid.arm.chain, edited)


def _check_bodies(robot: MjcfRobot, chain: UrdfChain, content: bytes) -> None:
    """Refuse a model whose bodies cannot place its joints, and one that is not in an encoding that has ASCII."""
    if not content.startswith(b"<mujoco", robot.root.start):
        raise InputError("expected a model in UTF-8 or another encoding that has ASCII", hint="save it as UTF-8")
    for joint in chain.joints:
        if joint.is_moving and not robot.joints[joint.name].is_alone:
            raise InputError(
                f"the body of joint {joint.name!r} has several joints, which its pose cannot place one by one",
                line=joint.element.line,
                hint="give each joint a body of its own",
            )


def _edited(content: bytes, robot: MjcfRobot, chain: UrdfChain, rigid: RigidArm, manifest: Manifest) -> bytes:
    root = robot.root
    after_start = root.start + len(start_tag(content, root.start))
    edits = [Edit(after_start, after_start, f"\n  <!-- {manifest.line()} -->".encode())]
    for joint, T_parent_joint in new_origins(chain.joints, rigid):
        moved = robot.joints[joint.name]
        edits.append(_pose_edit(content, moved.body.start, T_parent_joint @ np.linalg.inv(moved.at_zero)))
    base, tip = chain.joints[0].parent, chain.joints[-1].child
    if rigid.arm.chain.tip_in_flange.any():
        names = [one.get("name", "") for one in (*root.iter(), *robot.robot.iter())]
        tip = free_name(TIP_LINK, names)
        edits.append(_site_edit(content, robot, chain, rigid.arm.chain.tip_in_flange, tip))
    ends = {"name": robot.ends_name, "data": f"{base}:{tip}"}
    if robot.ends is not None:
        edits.append(set_attributes(content, robot.ends.start, ends))
    else:
        edits.append(Edit(root.end, root.end, f"  <custom>{tag_text('text', ends)}</custom>\n".encode()))
    return with_edits(content, edits)


def _site_edit(content: bytes, robot: MjcfRobot, chain: UrdfChain, tip_in_flange: FloatArray, name: str) -> Edit:
    """Add a site at the tip to the last body that moves."""
    last = max(i for i, joint in enumerate(chain.joints) if joint.is_moving)
    moved = robot.joints[chain.joints[last].name]
    T_body_flange = moved.in_body
    for joint in chain.joints[last + 1 :]:
        T_body_flange = T_body_flange @ joint.origin
    position = T_body_flange[:3, :3] @ tip_in_flange + T_body_flange[:3, 3]
    site = tag_text("site", {"name": name, "pos": spaced(position / MM_PER_M)})
    line = content.rfind(b"\n", 0, moved.body.end) + 1
    indent = content[line : moved.body.end]
    if indent.strip():  # the end tag is not alone in its line
        return Edit(moved.body.end, moved.body.end, site.encode())
    return Edit(line, line, b"%b  %b\n" % (indent, site.encode()))


def _pose_edit(content: bytes, start: int, frame: FloatArray) -> Edit:
    """Give the body whose tag begins at a byte another pose; an orientation in another form becomes a quaternion."""
    tag = _ORIENTATION.sub(b"", start_tag(content, start))
    quat = Rotation.from_matrix(frame[:3, :3]).as_quat(scalar_first=True)
    pose = {"pos": spaced(frame[:3, 3] / MM_PER_M), "quat": spaced(quat)}
    edit = set_attributes(tag, 0, pose)
    return Edit(start, start + len(start_tag(content, start)), edit.text)


write = writer("mjcf", _file_of)
tips = urdf.tips
