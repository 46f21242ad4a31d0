"""ROS's trajectories: JointTrajectory messages as YAML, wherever in the document they stand; rad, and m."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.foreign_documents import YamlNode, parse_yaml
from truearm.typing import FloatArray
from truearm.wings.exports.targets import TargetDirection
from truearm.wings.exports.targets.joint_files.joint_file import (
    JointFile,
    Span,
    check_not_corrected,
    edited,
    marked,
    places_of,
    turning_scale,
    wrong_names,
)

SUFFIXES = (".yaml", ".yml")
TITLE = "ROS trajectory"
# What follows the message as `ros2 topic echo` prints it.
_END = re.compile(r"^---\s*\Z", re.MULTILINE)


def read_trajectory(content: bytes, arm: Arm, direction: TargetDirection) -> JointFile:
    """The positions of all points of all trajectories in a document.

    Raises
    ------
    InputError
        If it is no YAML, has no trajectory, joints of other names, or points of other lengths; with the line.
    """
    mark = codecs.BOM_UTF8 if content.startswith(codecs.BOM_UTF8) else b""
    whole = content.decode("utf-8-sig", "strict") if _is_utf8(content) else ""
    text = _END.sub("", whole)
    check_not_corrected(text, direction)
    root = parse_yaml(text.encode())
    rows: list[list[float]] = []
    lines: list[str] = []
    spans: list[list[Span]] = []
    for trajectory in _trajectories(root):
        names = [one.text or "" for one in trajectory["joint_names"].items or ()]
        places = places_of(names, arm)
        if places is None:
            shown = ", ".join(names)[:200] or "none"
            error = wrong_names(names, arm) or InputError(f"expected joints {', '.join(arm.joint_names)}, got {shown}")
            raise InputError(
                error.problem,
                line=trajectory["joint_names"].line,
                hint="give the model's arm the names of the driver: name = .. of each joint in its arm file",
            )
        for point in trajectory["points"].items or ():
            positions = (point.entries or {}).get("positions", point)
            found = positions.items or []
            if len(found) != len(names):
                raise InputError(f"expected {len(names)} positions, got {len(found)}", line=positions.line)
            rows.append([found[i].number(f"the position of {names[i]}") for i in places])
            spans.append([Span(*found[i].span) for i in places])
            lines.append(f"line {positions.line}")
    if not rows:
        raise InputError("expected a trajectory with joint_names and points, got none")
    values, scale = np.array(rows), turning_scale(arm, "rad")

    def written(after: FloatArray, words: str) -> bytes:
        made = edited(text, spans, values, after, scale.gain) + whole[len(text) :]
        return mark + marked(made, words, "# {}").encode()

    return JointFile(TITLE, values, scale, written, lines)


def _is_utf8(content: bytes) -> bool:
    try:
        content.decode()
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError("expected UTF-8 text", line=line, hint="save the file as UTF-8") from None
    return True


def _trajectories(node: YamlNode) -> Iterator[dict[str, YamlNode]]:
    """Mappings with joint names and points, in the order of the document."""
    entries = node.entries or {}
    if entries.get("joint_names") is not None and "points" in entries:
        yield entries
        return
    for one in (*entries.values(), *(node.items or ())):
        yield from _trajectories(one)
