"""Yaskawa jobs (.jbi): taught points C and variables P of the first robot, in pulses or as poses.

Lines that begin with ``///`` hold for the points after them: TOOL, USER, POSTYPE, PULSE or RECTAN, RCONF. Pulses are
integers S, L, U, R, B, T; how many a degree has is not in the job. A pose is X, Y, Z [mm] and Rx, Ry, Rz [deg],
R = Rz Ry Rx. RCONF states flip, lower arm, rear, and whether R, T, S are 180 deg or more (NX100 manual, 3.9): one line
holds for many points, so that a point whose configuration changes is not corrected.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.arm.rigid_motions import motion
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.programs.numbers import Number, angles_of, rotation_of
from truearm.wings.exports.programs.program import (
    Condition,
    Language,
    LeftAlone,
    Lines,
    Move,
    MoveKind,
    Program,
    Surroundings,
    Target,
    line_end_of,
    run_time_notes,
)
from truearm.wings.exports.targets.edits import Edit

_CALLED = r"^[ \t]*(?:CALL|PSTART)\b.*\bJOB:([\w-]+)"
_SETS = r"^[ \t]*(?:SETTOOL|MFRAME|SETUFRM)[ \t]+((?:TL|UF)#\(\w+\))"
_LINE = re.compile(r"[^\r\n]+")
_STATE = re.compile(r"///\s*([A-Z]+)\s*(.*)")
_POINT = re.compile(r"\s*(BC|EC|BP|EX|LBP|LEX|LP|C|P)(\d+)\s*=\s*")
_NUMBER = re.compile(r"([+-]?(?:\d{1,9}\.?\d*|\.\d+))")
_MOVE = re.compile(r"\s*(IMOV|S?MOV[JLCS])\s+(.*)")
_USED = re.compile(r"\b(LP|P|C)X?(\d+)\b|\bL?PX?\[")
_JOINTS = tuple(f"j{i}" for i in range(1, 7))  # S, L, U, R, B, T
_POSE = ("x", "y", "z", "rx", "ry", "rz")
_KINDS: dict[str, MoveKind] = {"MOVL": "linear", "MOVC": "circular"}
_UNITS = {"PULSE", "RECTAN", "ANGLE"}
_BASE_AXES = {"BC", "BP", "LBP"}  # of a track
_OTHER_AXES = {*_BASE_AXES, "EC", "EX", "LEX"}


class _Pulse(Number):
    """A number of encoder pulses: whole."""


@dataclass(frozen=True, eq=False)
class _Point(Target):
    """A point; `unit` is pulses per degree of joints in pulses."""

    unit: tuple[float, ...] = ()


class _Reader:
    """One pass over the lines of a job: positions, then instructions."""

    def __init__(self, data: bytes, beside: Surroundings) -> None:
        self.data, self.beside, self.line_of = data, beside, Lines(data)
        self.state: dict[str, str] = {}
        self.points: dict[str, tuple[int, str, Target | str]] = {}
        self.other_axes = 0
        self.base_axes = 0
        self.in_base: dict[str, str] = {}
        self.moves: list[tuple[int, MoveKind, str]] = []
        self.problems: dict[str, str] = {}
        self.left: list[LeftAlone] = []
        self.shifted = False
        part = ""
        for found in _LINE.finditer(data.decode("latin-1")):
            text = found[0].strip()
            if re.match(r"//\w", text) or text == "END":
                part = text.split()[0].lstrip("/")
            elif part == "POS":
                self._position(found.start(), found[0])
            elif part == "INST" and text[:1] not in ("'", "/"):
                self._instruction(self.line_of(found.start()), text)
        if part != "END":
            raise InputError(
                "the job has no END: it is truncated", line=self.line_of(len(data)), hint="save the job again"
            )
        taught, stated = sum(key.startswith("C") for key in self.points), _integers(self.state.get("NPOS", ""))
        if stated and taught < stated[0]:
            raise InputError(f"the job states {stated[0]} taught points and has {taught}: it is truncated")

    def _position(self, at: int, text: str) -> None:
        """Take a line of //POS."""
        state = _STATE.match(text)
        if state is not None:
            self.state[state[1]] = state[2].strip()
            if state[1] in _UNITS:
                self.state["unit"] = state[1]
            return
        point = _POINT.match(text)
        if point is None:
            return
        if point[1] in _OTHER_AXES:
            self.other_axes += 1
            self.base_axes += point[1] in _BASE_AXES
            return
        line = self.line_of(at)
        parts, start = [], at + point.end()
        for part in text[point.end() :].split(","):
            digits = part.strip()
            first = start + len(part) - len(part.lstrip())
            parts.append((first, digits))
            start += len(part) + 1
        name = point[1] + point[2]
        if self.state.get("unit") == "RECTAN":
            self.in_base[_key(point[1], point[2])] = self.state.get("POSTYPE", "")
        self.points[_key(point[1], point[2])] = (line, name, self._target(name, line, parts))

    def _target(self, name: str, line: int, parts: list[tuple[int, str]]) -> Target | str:
        """The target of a point, or why it is not changed."""
        state, frames = self.state, self.beside.frames
        unit, postype = state.get("unit", ""), state.get("POSTYPE", "")
        if len(parts) != len(_JOINTS) or not all(_NUMBER.fullmatch(digits) for _, digits in parts):
            return f"it has {len(parts)} values, not the six numbers of an arm of six axes"
        made = _Pulse if unit == "PULSE" else Number
        numbers = [made(first, first + len(digits), digits.encode("ascii")) for first, digits in parts]
        values = np.array([number.value for number in numbers])
        tool = frames.tool_of(state.get("TOOL"))
        if unit in ("PULSE", "ANGLE"):
            if unit == "PULSE" and frames.pulses_per_deg is None:
                return "its joints are in pulses: state pulses_per_deg in --frames"
            scale = np.array(frames.pulses_per_deg if unit == "PULSE" else np.ones(6))
            named = dict(zip(_JOINTS, numbers, strict=True))
            return _Point(name, line, named, joints=np.radians(values / scale), T_flange_tool=tool, unit=tuple(scale))
        if unit != "RECTAN" or postype not in ("BASE", "ROBOT", "USER"):
            return f"a position of the type {postype or 'that is not stated'}: a shift, or of another device"
        conditions = _conditions(_integers(state.get("RCONF", "")))
        if isinstance(conditions, str):
            return conditions
        work = frames.work_of(state.get("USER")) if postype == "USER" else np.eye(4)
        if tool is None or work is None:
            missing = f"tools.{state.get('TOOL')}" if tool is None else f"works.{state.get('USER')}"
            return f"state [{missing}] in --frames"
        R = rotation_of(values[3:].tolist())
        named = dict(zip(_POSE, numbers, strict=True))
        return _Point(
            name,
            line,
            named,
            pose=motion(R, values[:3].tolist()),
            T_flange_tool=tool,
            T_base_work=work,
            conditions=conditions,
        )

    def _instruction(self, line: int, text: str) -> None:
        """Take an instruction."""
        words = " ".join(text.split())
        if text.startswith(("SFTON", "SFTOF")):
            self.shifted = text.startswith("SFTON")
        move = _MOVE.match(text)
        first = re.split(r"[ \t]\+", text)[0] if move else text
        for used in _USED.finditer(first):
            key = _key(used[1], used[2]) if used[2] else ""
            if move is None:
                if used[1] != "C" and key:
                    self.problems.setdefault(key, f"rewritten or used in a computation in line {line}")
            elif not key:
                self.left.append(LeftAlone(line, words, "the number of the point is computed at run time"))
            elif move[1].startswith("I") or self.shifted:
                reason = "an increment" if move[1].startswith("I") else "shifted at run time (SFTON)"
                self.problems.setdefault(key, f"{reason} (line {line})")
            if move is not None:
                self.moves.append((line, _KINDS.get(move[1][-4:], "joint"), key))

    def _on_track(self, key: str) -> str | None:
        """Why a pose is not changed in a job whose other axes, which stand after it, may carry the arm."""
        of_type = self.in_base.get(key)
        if (of_type == "BASE" and self.other_axes) or (of_type == "USER" and self.base_axes):
            return "a pose in the base of a job with further axes: a track may be under the arm"
        return None

    def program(self) -> Program:
        """What was found."""
        reached = {key for _, _, key in self.moves}
        targets: dict[str, Target] = {}
        for key, (line, name, made) in self.points.items():
            reason = self.problems.get(key) or (None if key in reached else "no move of the job goes to it")
            made = self._on_track(key) or made
            if reason is None and isinstance(made, Target):
                targets[key] = made
            else:
                self.left.append(LeftAlone(line, name, reason or str(made), is_literal=reason is None))
        for line, _, key in self.moves:
            if key and key not in self.points:
                self.left.append(LeftAlone(line, key.replace(" ", ""), "its position is not in the job"))
        notes = []
        if self.other_axes:
            notes.append(f"{self.other_axes} positions of other axes are not changed")
        if any(isinstance(next(iter(one.numbers.values())), _Pulse) for one in targets.values()):
            notes.append("pulses stay whole, each those of one axis: coupled wrist axes are not converted")
        if any(not key.startswith("C ") for key in targets):
            notes.append("variables P are common to all jobs: another job may rewrite them")
        notes += run_time_notes(self.data.decode("latin-1"), _CALLED, _SETS)
        moves = ((Move(line, kind, None), key) for line, kind, key in self.moves)
        return Program.of(self.data, targets, sorted(self.left), moves, notes)


class YaskawaJob(Language):
    """Job of a Yaskawa controller."""

    title = "Yaskawa job"
    endings = (".jbi",)
    takes_no_targets = "a job states the number of its points"
    decimals = 0

    def recognises(self, data: bytes) -> bool:
        """See `Language`."""
        return re.match(rb"(?:\xef\xbb\xbf)?\s*(?:'[^\r\n]*\s+)*/JOB\b", data) is not None

    def read(self, data: bytes, beside: Surroundings) -> Program:
        """See `Language`."""
        return _Reader(data, beside).program()

    def values(self, target: Target, joints: FloatArray, pose: FloatArray | None) -> Mapping[str, float]:
        """See `Language`."""
        assert isinstance(target, _Point)
        if target.joints is not None:
            return dict(zip(_JOINTS, (np.degrees(joints) * target.unit).tolist(), strict=True))
        assert pose is not None  # of a Cartesian target
        old = [target.numbers[name].value for name in _POSE[3:]]
        return dict(zip(_POSE, [*pose[:3, 3].tolist(), *angles_of(pose[:3, :3], old)], strict=True))

    def mark(self, program: Program, words: str) -> Edit:
        """See `Language`."""
        start = re.search(rb"(?m)^[ \t]*NOP[^\r\n]*(?:\r\n|\n|\r)|^[ \t]*END", program.data)
        assert start is not None  # every job has an END
        at = start.end() if start[0].lstrip().startswith(b"NOP") else start.start()
        return Edit(at, at, b"'" + words.encode("ascii") + line_end_of(program.data))

    def number_text(self, number: Number, value: float, decimals: int) -> bytes:
        """See `Language`."""
        return super().number_text(number, value, 0 if isinstance(number, _Pulse) else decimals)


def _integers(text: str) -> list[int]:
    return [int(one) for one in re.findall(r"-?\d{1,9}", text)]


def _key(kind: str, number: str) -> str:
    return f"{kind} {int(number)}"


def _conditions(rconf: Sequence[int]) -> tuple[Condition, ...] | str:
    """What RCONF states of a configuration, or why it is not taken."""
    if len(rconf) < len(_JOINTS):
        return "no RCONF states its configuration"
    no_flip, lower, rear, *turned = rconf[:6]
    if rear or any(turned):
        return "its RCONF has the wrist behind axis S, or R, T or S beyond 180 deg"
    return (
        Condition.sign("elbow", negative=lower),
        Condition.sign("shoulder", negative=False),
        Condition("|J4|", *((90.0, 180.0) if no_flip else (0.0, 90.0))),
        *(Condition(joint, -180.0, 180.0) for joint in ("J1", "J4", "J6")),
    )
