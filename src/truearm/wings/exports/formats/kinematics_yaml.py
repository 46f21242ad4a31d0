"""Kinematics yaml of UFACTORY or Franka from a model: the maker's own file with new poses of the joints.

Its xacro then has the arm that was built. The flange stays the nominal one: the tip that was measured is a tool in it.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from truearm.arm import load_arm
from truearm.arm.kinematics_yaml import joint_poses
from truearm.errors import InputError
from truearm.files.file_reading import read_limited, utf8_text
from truearm.files.foreign_documents import parse_yaml
from truearm.wings.exports.formats import ur_kinematics
from truearm.wings.exports.formats.constants_table import MAX_BYTES, ConstantsFile, ConstantsRequest, writer
from truearm.wings.exports.formats.joint_offsets import yaml_pose
from truearm.wings.exports.formats.urdf import is_same_frame
from truearm.wings.exports.targets.edits import with_edits
from truearm.wings.exports.targets.manifest import MARKER, Manifest

# What an earlier export wrote at the head of the file.
_OURS = re.compile(
    rf"^# (?:{re.escape(MARKER)}|{re.escape(ur_kinematics.TOOL_MARK)}|Angles as a URDF|The tip that).*\n", re.M
)


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    source = request.source
    if source is None:
        raise InputError("the maker's file is not stated", hint="--original kinematics.yaml, that of the description")
    if request.frame != "base":
        raise InputError("a maker's kinematics yaml is in the robot's own base frame", hint="leave out --frame")
    nominal = load_arm(Path(source))
    text = _OURS.sub("", utf8_text(read_limited(source, limit_bytes=MAX_BYTES)))
    with InputError.of_file(source):  # that of a UR
        poses = joint_poses(parse_yaml(text.encode()))
    rigid = request.rigid_arm(nominal)
    ur_kinematics.check_same_robot(request.model, rigid, source)
    edits: list[tuple[int, int, str]] = []
    for new, old, node in zip(rigid.arm.chain.fixed, nominal.chain.fixed, poses.nodes, strict=False):
        if not is_same_frame(new, old):
            edits += [(*number.span, text) for number, text in zip(node, yaml_pose(new), strict=True)]
    made = with_edits(text, edits)
    tool = rigid.arm.chain.tip_in_flange
    fixed = joint_poses(parse_yaml(made.encode())).fixed

    def content(manifest: Manifest) -> str:
        return f"{ur_kinematics.comments(manifest.of_joints(rigid.arm.joint_names), tool)}{made}"

    return ConstantsFile(rigid, replace(rigid.arm.chain, fixed=np.array(fixed)), content)


write = writer("kinematics-yaml", _file_of)
tips = ur_kinematics.tips
