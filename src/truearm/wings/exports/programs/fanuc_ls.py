"""Fanuc TP listings (.ls): the positions P[n] of group 1 in /POS, and the motions of /MN that go to them.

A field has ten characters, right-aligned, with three decimals and no zero before the point (``      .041``); files of
other programs differ, and each keeps its own style. Keywords follow the language of the controller (CONFIG or KONFIG):
positions and motions are recognised by their structure.

Turns of CONFIG are those of J1, J4 and J6: 0 within half a turn, 1 beyond +180 deg. N and F are the sign of J5, T and B
the side of axis 1 on which the wrist is, U and D the side of the lower arm; with B the last is not certain.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from truearm.arm import Chain
from truearm.arm.rigid_motions import motion
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.programs.numbers import Number, angles_of, rotation_of
from truearm.wings.exports.programs.program import (
    N_AXES,
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
from truearm.wings.exports.targets.program_literals import fanuc_joints

_PART = re.compile(r"^/([A-Z]+)", re.MULTILINE)
_POINT = re.compile(r"^[ \t]*P\[\s*(\d+)\s*(?::\s*\"([^\"\r\n]*)\"\s*)?\]\s*\{", re.MULTILINE)
_GROUP = re.compile(r"\bGP(\d+)\s*:")
_HEAD = re.compile(r"\s*\S+\s*:\s*(\w+|\*+)\s*,\s*\S+\s*:\s*(\w+|\*+)\s*,?(?:\s*\S+\s*:\s*'([^'\r\n]*)'\s*,?)?")
_VALUE = re.compile(r"\b([A-Z]+\d*)[ \t]*=([ \t]*(?:[+-]?(?:\d{1,9}\.?\d*|\.\d+)|\*+))[ \t]*(mm|deg)?")
_CONFIG = re.compile(r"\s*([NF])\s+([UD])\s+([TB])\s*,\s*([+-]?\d+)\s*,\s*([+-]?\d+)\s*,\s*([+-]?\d+)\s*")
_CONFIG_OF_SCARA = re.compile(r"\s*(?:[LR]\s*)?,\s*0\s*,\s*0\s*,\s*0\s*")
_LETTER_OF_SCARA = re.compile(r":\s*'\s*([LR])\s*,")
_SCARA = 4
_STATEMENT = re.compile(r"^[ \t]*(\d+):(?:.*\n?(?![ \t]*\d+:))*", re.MULTILINE)
_MOTION = re.compile(r"[ \t]*\d+:[ \t]*([JLCAS])[ \t]+(?:P|PR)\[")
_REMARK = re.compile(r"[ \t]*\d+:[ \t]*(?:!|--|//)")
_USE = re.compile(r"(?<![\w$])P\[\s*(?:GP\d+\s*:\s*)?(?:(\d+)[^\]\n]*|[A-Za-z]+\[[^\n]*?)\]([ \t]*=(?!=))?")
_NAME = re.compile(r":[^\]\n]*\]")  # of a register or a point, within its brackets
_SHIFT = re.compile(r"(?<!\w)(?:PR|VR)\[[^\]\n]*\](?![ \t]*=)|\b(?:VOFFSET|Offset|Tool_Offset)\b")
_AT_RUN_TIME = {"INC": "an increment", "INK": "an increment", "COORD": "of a motion coordinated with another group"}
_CALLED = r"^[ \t]*\d+:(?!\s*(?:!|--|//)).*?\b(?:CALL|RUN)[ \t]+(\w+)"
_SETS = r"^[ \t]*\d+:\s*(U(?:TOOL|FRAME)\[[^\]\n]*\])\s*="
_POSE = ("x", "y", "z", "w", "p", "r")
_TURNS = (1, 4, 6)
_FIELD = 10
_ROUNDED = "numbers keep their decimals: of three, 0.0005 mm or deg of each remain uncorrected"
_UNTAUGHT = "it was never taught"
_KINDS: dict[str, MoveKind] = {"J": "joint", "L": "linear"}


@dataclass(frozen=True, eq=False)
class _Point(Target):
    """A position of group 1; `letters` are the places of its configuration's letters and turns.

    `slides` says which joints of a joint position are in mm.
    """

    letters: tuple[tuple[int, int], ...] = ()
    slides: tuple[bool, ...] = ()


@dataclass
class _Uses:
    """What /MN does with the points: motions to them, those that cannot be known, and what is computed from them."""

    motions: list[tuple[int, str, int]] = field(default_factory=list)
    reached: set[int] = field(default_factory=set)
    problems: dict[int, str] = field(default_factory=dict)
    shifted: dict[int, int] = field(default_factory=dict)
    bases: dict[int, int] = field(default_factory=dict)
    left: list[LeftAlone] = field(default_factory=list)
    any_point: bool = False

    def take(self, line: int, statement: str) -> None:
        """Add one statement."""
        words = " ".join(statement.partition(":")[2].split()).rstrip(" ;")
        motion, plain = _MOTION.match(statement), _NAME.sub("]", statement)
        reason = next((why for word, why in _AT_RUN_TIME.items() if re.search(rf"\b{word}\b", plain)), None)
        uses = list(_USE.finditer(statement))
        for use in uses:
            number, place = int(use[1] or 0), 0
            if motion and not number:
                self.any_point = True
                self.left.append(LeftAlone(line, words, "the number of the point is computed at run time"))
            elif motion and reason:
                self.problems.setdefault(number, f"{reason} (line {line})")
            elif motion and _SHIFT.search(plain):
                self.shifted.setdefault(number, line)
                self.left.append(LeftAlone(line, words, f"P[{number}] is shifted at run time"))
            elif motion:
                self.reached.add(number)
                place = number
            elif use[2] and not statement[: use.start()].partition(":")[2].strip():
                self.problems[number] = f"assigned at run time in line {line}"
            else:
                self.bases.setdefault(number, line)
            if motion:
                self.motions.append((line, motion[1], place))
        if motion and not uses:
            self.motions.append((line, motion[1], 0))
            self.left.append(LeftAlone(line, words, "a position register: its value is not in the program"))

    def reason_against(self, number: int) -> str | None:
        """Why a point is not changed."""
        if number in self.problems:
            return self.problems[number]
        if self.any_point or number in self.reached:
            return None
        if number in self.shifted:
            return f"only with a shift at run time (line {self.shifted[number]})"
        return "no motion of the program goes to it"

    def notes(self, changed: set[int]) -> Iterator[str]:
        """Points that others are computed from."""
        for numbers, what in ((self.shifted, "shifted"), (self.bases, "used in a computation")):
            for number, line in sorted(numbers.items()):
                if number in changed:
                    yield f"P[{number}] is {what} in line {line}: the result has the correction of P[{number}]"


class FanucListing(Language):
    """Fanuc TP listing."""

    title = "Fanuc TP listing"
    endings = (".ls",)
    takes_no_targets = "the lines of /MN and the points are numbered"
    decimals = 3  # as the controller writes them
    n_axes = (6, 4)

    def recognises(self, data: bytes) -> bool:
        """See `Language`."""
        return data.lstrip(b"\xef\xbb\xbf \t\r\n").upper().startswith(b"/PROG")

    def read(self, data: bytes, beside: Surroundings) -> Program:
        """See `Language`."""
        text, line_of = data.decode("latin-1"), Lines(data)
        parts = {found[1]: found for found in reversed(list(_PART.finditer(text)))}
        for name in ("MN", "POS", "END"):
            if name not in parts:
                raise InputError(
                    f"expected /{name} in a Fanuc program: it is truncated",
                    line=line_of(len(data)),
                    hint="export the program again",
                )
        uses = _Uses()
        for found in _STATEMENT.finditer(text, parts["MN"].end(), parts["POS"].start()):
            if not _REMARK.match(found[0]):
                uses.take(line_of(found.start()), found[0])
        tracked = re.search(r"LINE_TRACK_SCHEDULE_NUMBER\s*:\s*[1-9]", text)
        letters = set(_LETTER_OF_SCARA.findall(text, parts["POS"].end(), parts["END"].start()))
        targets: dict[int, Target] = {}
        left = uses.left
        for number, point in _points(line_of, text, parts["POS"].end(), parts["END"].start()).items():
            line = line_of(point.start)
            reason = "of a program that tracks a conveyor" if tracked else uses.reason_against(number)
            made = _target(text, line, point, beside) if reason is None else reason
            if len(letters) > 1 and isinstance(made, _Point) and made.pose is not None and not made.conditions:
                made = "L and R stand in one program: which side of the elbow each is, is not certain"
            if isinstance(made, str):
                left.append(LeftAlone(line, point.name, made, is_literal=reason is None and made != _UNTAUGHT))
            else:
                targets[number] = made
        moves = ((Move(line, _KINDS.get(kind, "circular"), None), n) for line, kind, n in uses.motions)
        run_time = run_time_notes(text[: parts["POS"].start()], _CALLED, _SETS)
        notes = (*uses.notes(set(targets)), *run_time, *([_ROUNDED] if targets else ()))
        return Program.of(data, targets, sorted(left), moves, notes)

    def values(self, target: Target, joints: FloatArray, pose: FloatArray | None) -> Mapping[str, float]:
        """See `Language`."""
        if target.joints is not None:
            assert isinstance(target, _Point)
            values = zip(joints.tolist(), np.degrees(joints).tolist(), target.slides, strict=True)
            return {f"j{i}": mm if slides else deg for i, (mm, deg, slides) in enumerate(values, 1)}
        assert pose is not None  # of a Cartesian target
        old = [target.numbers[name].value for name in _POSE[3:]]
        return dict(zip(_POSE, [*pose[:3, 3].tolist(), *angles_of(pose[:3, :3], old)], strict=True))

    def mark(self, program: Program, words: str) -> Edit:
        """See `Language`. A remark at the end of /MN: no number of a line changes."""
        text = program.data.decode("latin-1")
        start = next(found.start() for found in _PART.finditer(text) if found[1] == "POS")
        found = [one for one in _STATEMENT.finditer(text, 0, start) if "!truearm" not in one[0]]
        numbers = [(one.end(1) - one.start(), int(one[1])) for one in found]
        last = max((number for width, number in numbers if width == numbers[0][0]), default=0)
        return Edit(start, start, f"{last + 1:4d}:  !{words} ;".encode("latin-1") + line_end_of(program.data))

    def configuration(self, target: Target, quantities: Mapping[str, float]) -> Iterable[Edit]:
        """See `Language`."""
        assert isinstance(target, _Point)
        signs = [quantities["J5"] > 0, quantities["elbow"] > 0, quantities["shoulder"] > 0]
        if not signs[2]:
            raise InputError(f"the wrist of {target.name} is behind axis 1 after the correction")
        letters = [pair[not sign] for pair, sign in zip(("FN", "UD", "TB"), signs, strict=True)]
        turns = [str(int(np.floor((quantities[f"J{i}"] + 180.0) / 360.0))) for i in _TURNS]
        return [Edit(*span, new.encode()) for span, new in zip(target.letters, [*letters, *turns], strict=True)]

    def model_joints(self, chain: Chain, joints: FloatArray) -> FloatArray:
        """See `Language`. The pendant counts J3 from the horizontal."""
        return joints if _is_plain(chain) else 2 * joints - fanuc_joints(joints, chain.fixed)

    def controller_joints(self, chain: Chain, joints: FloatArray) -> FloatArray:
        """See `Language`."""
        return joints if _is_plain(chain) else fanuc_joints(joints, chain.fixed)

    def number_text(self, number: Number, value: float, decimals: int) -> bytes:
        """See `Language`: right-aligned in the field, the zero before the point as the file has it."""
        old, width = number.text.strip(), len(number.text)
        text = super().number_text(number, value, decimals)
        dropped = old.lstrip(b"+-").startswith(b".")
        if width == _FIELD and not 0 < abs(number.value) < 1:
            dropped = True  # the controller's style, which the number itself does not show
        if dropped and abs(float(text)) < 1:
            text = text.replace(b"0.", b".", 1)
        return text.rjust(width)


def _is_plain(chain: Chain) -> bool:
    """Whether J3 is counted as in the model: by its own coupling, or as that of a SCARA."""
    return chain.coupling is not None or chain.n_joints != N_AXES


@dataclass(frozen=True)
class _Block:
    """One P[n]{..} of /POS: the place of its name, and of its group 1, if it has one."""

    name: str
    start: int
    group: tuple[int, int] | None


def _points(line_of: Lines, text: str, first: int, last: int) -> dict[int, _Block]:
    """The points of /POS by their numbers."""
    found = list(_POINT.finditer(text, first, last))
    blocks: dict[int, _Block] = {}
    for one, following in zip(found, [*(each.start() for each in found), last][1:], strict=True):
        end, number = text.find("}", one.end(), following), int(one[1])
        line = line_of(one.start())
        if end < 0:
            raise InputError(f"P[{number}] does not end: the program is truncated", line=line)
        if number in blocks:
            raise InputError(f"P[{number}] is stated twice", line=line)
        groups = [*_GROUP.finditer(text, one.end(), end)]
        ends = [*(each.start() for each in groups), end][1:]
        spans = {int(each[1]): (each.end(), stop) for each, stop in zip(groups, ends, strict=True)}
        blocks[number] = _Block(f"P[{number}:{one[2]}]" if one[2] else f"P[{number}]", one.start(), spans.get(1))
    return blocks


def _target(text: str, line: int, block: _Block, beside: Surroundings) -> Target | str:
    """The target of a point, or why it is not changed."""
    if block.group is None:
        return "it has no position of group 1"
    head = _HEAD.match(text, *block.group)
    values = list(_VALUE.finditer(text, head.end() if head else block.group[0], block.group[1]))
    names, units = [one[1].lower() for one in values], [one[3] for one in values]
    if any("*" in one[2] for one in values) or (head and "*" in head[1] + head[2]):
        return _UNTAUGHT
    if head is None or not names or len(set(names)) < len(names):
        return "its position has a layout that is not known"
    if names[0][:1] == "r" and len(names[0]) == 2:
        return "a point of a tool that stands in the cell (RTCP)"
    numbers = {one[1].lower(): Number(*one.span(2), one[2].encode("ascii")) for one in values}
    external = tuple(numbers.pop(name) for name in names if name.startswith("e"))
    if external and (beside.rail is None or beside.rail > len(external)):
        return "it has an extended axis in group 1, which may carry the arm"
    names = list(numbers)
    units = units[: len(names)]
    chain = beside.chain
    slides = (False,) * N_AXES if chain is None or chain.n_joints > _SCARA else tuple(chain.is_prismatic.tolist())
    tool = np.eye(4) if head[2] == "0" else beside.frames.tool_of(head[2])
    if names == [f"j{i}" for i in range(1, len(slides) + 1)] and units == ["mm" if one else "deg" for one in slides]:
        stated = np.array([numbers[name].value for name in names])
        joints = np.where(slides, stated, np.radians(stated))
        return _Point(block.name, line, numbers, joints=joints, T_flange_tool=tool, external=external, slides=slides)
    if tuple(names) != _POSE or units != ["mm"] * 3 + ["deg"] * 3:
        shown = ", ".join(f"{name.upper()} [{unit or '?'}]" for name, unit in zip(names, units, strict=True))
        return f"expected joints or X [mm] .. R [deg] of this arm as plain numbers, got {shown}"
    config = _CONFIG.fullmatch(head[3] or "")
    is_scara = len(slides) == _SCARA and _CONFIG_OF_SCARA.fullmatch(head[3] or "") is not None
    if not is_scara and (config is None or config[3] == "B" or len(slides) == _SCARA):
        return f"the sense of its configuration '{head[3] or ''}' is not certain"
    work = beside.frames.in_base(np.eye(4)) if head[1] == "0" else beside.frames.work_of(head[1])
    if tool is None or work is None:
        return f"state [{f'tools.{head[2]}' if tool is None else f'works.{head[1]}'}] in --frames"
    x, y, z, *wpr = (numbers[name].value for name in _POSE)
    pose = motion(rotation_of(wpr), (x, y, z))
    if config is None:  # of a SCARA: in which sense L and R are the sides of its elbow is not certain
        return _Point(block.name, line, numbers, pose=pose, T_flange_tool=tool, T_base_work=work)
    turns = map(int, config.groups()[3:])
    conditions = [
        Condition.sign("J5", negative=config[1] == "N"),
        Condition.sign("elbow", negative=config[2] != "U"),
        Condition.sign("shoulder", negative=False),
        *(Condition(f"J{i}", 360.0 * t - 180.0, 360.0 * t + 180.0) for i, t in zip(_TURNS, turns, strict=True)),
    ]
    first = head.start(3)
    return _Point(
        block.name,
        line,
        numbers,
        pose=pose,
        T_flange_tool=tool,
        T_base_work=work,
        conditions=tuple(conditions),
        external=external,
        letters=tuple((first + config.start(i), first + config.end(i)) for i in range(1, 7)),
    )
