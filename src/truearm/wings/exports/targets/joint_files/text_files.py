"""Text files that move joints: G-code, and trajectories of ROS.

G-code has words ``J1=..``, or A, B, C, U, V, W for as many joints as the arm has, in degrees. JointTrajectory messages
are YAML, wherever in the document they stand, in rad and m.
"""

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
    known_names,
    marked,
    places_of,
    turning_scale,
    wrong_names,
)

GCODE = (".gcode", ".gco", ".nc", ".ngc", ".tap", ".cnc")
GCODE_TITLE = "G-code"
LETTERS = "ABCUVW"
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_COMMENT = re.compile(r"\([^)\n]*\)|;[^\n]*")
# No exponent, and no expression: what follows is the next word.
_ENDS = r"(?=[A-DF-Z]|[ \t]+[A-Z]|[ \t]*(?:[,\r\n]|\Z))"
_NUMBERED = re.compile(rf"(?<![A-Z])J([1-9])(?:\s*=\s*|\s+)({_NUMBER}){_ENDS}", re.IGNORECASE)
_LETTERED = re.compile(rf"(?<![A-Z#])([{LETTERS}])\s*({_NUMBER}){_ENDS}", re.IGNORECASE)
_AXIS = re.compile(rf"(?<![A-Z#_<])[J{LETTERS}XYZ][ \t]*[-+.\d=#\[][^\s,]*", re.IGNORECASE)
# Increments, and a shift of what all numbers mean.
_OTHER_MEANING = re.compile(r"(?<![A-Z])G0*(91|92(?:\.\d)?)(?![\d.])", re.IGNORECASE)


def read_gcode(content: bytes, arm: Arm, direction: TargetDirection) -> JointFile:
    """The lines of a program that state all joints.

    Raises
    ------
    InputError
        If no line states joints, one states some of them only, other axes or joints in another form, or numbers are
        increments; with the line.
    """
    text = content.decode("latin-1")
    check_not_corrected(text, direction)
    code = _COMMENT.sub(lambda found: " " * len(found[0]), text)
    numbered = _NUMBERED.search(code) is not None
    words = _NUMBERED if numbered else _LETTERED
    wanted = [str(i + 1) for i in range(arm.n_joints)] if numbered else list(LETTERS[: arm.n_joints])
    if not numbered and arm.n_joints > len(LETTERS):
        raise InputError(f"expected J1=10 J2=-20 .., the {arm.n_joints} joints of the arm, got none")
    rows: list[list[float]] = []
    lines: list[str] = []
    spans: list[list[Span]] = []
    start = 0
    for number, line in enumerate(code.splitlines(keepends=True), start=1):
        if other := _OTHER_MEANING.search(line):
            raise InputError(f"{other[0]} changes what joints mean: corrected are absolute joints only", line=number)
        stated = [one[1].upper() for one in words.finditer(line)]
        found = {one[1].upper(): one for one in words.finditer(line)}
        other_axes = _AXIS.findall(words.sub(" ", line))
        if found or other_axes:
            if sorted(stated) != sorted(wanted) or other_axes:
                said = ", ".join(other_axes[:9] or [f"J{name}" if numbered else name for name in stated])
                raise InputError(
                    f"expected all {arm.n_joints} joints of the arm as plain numbers, and no other axes, got {said}",
                    line=number,
                    hint=f"write {'J1=10 ..' if numbered else ', '.join(wanted)} on every line that moves a joint",
                )
            rows.append([float(found[name][2]) for name in wanted])
            lines.append(f"line {number}")
            spans.append([Span(start + found[name].start(2), start + found[name].end(2)) for name in wanted])
        start += len(line)
    if not rows:
        raise InputError("expected lines with joints, got none", hint=f"J1=10 J2=-20 .., or {' '.join(wanted)}")
    values, scale = np.array(rows), turning_scale(arm, "deg")

    def written(after: FloatArray, words: str) -> bytes:
        made = edited(text, spans, values, after, scale.gain)
        return marked(made, words, "({})", after="%").encode("latin-1")

    return JointFile(GCODE_TITLE, values, scale, written, lines)


TRAJECTORIES = (".yaml", ".yml")
TRAJECTORIES_TITLE = "ROS trajectory"
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
    remarks: list[str] = []
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
        taken = [names[i] for i in places]
        if not any(set(known) <= set(names) for known in known_names(arm)):
            remarks.append(f"Joints, by the numbers in their names: {', '.join(taken)}.")
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

    return JointFile(TRAJECTORIES_TITLE, values, scale, written, lines, tuple(dict.fromkeys(remarks)))


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
