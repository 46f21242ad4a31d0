"""G-code that moves joints: words ``J1=..``, or A, B, C, U, V, W for as many joints as the arm has; in degrees."""

from __future__ import annotations

import re

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.targets import TargetDirection
from truearm.wings.exports.targets.joint_files.joint_file import (
    JointFile,
    Span,
    check_not_corrected,
    edited,
    marked,
    turning_scale,
)

SUFFIXES = (".gcode", ".gco", ".nc", ".ngc", ".tap", ".cnc")
TITLE = "G-code"
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

    return JointFile(TITLE, values, scale, written, lines)
