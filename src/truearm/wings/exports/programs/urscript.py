"""URScript (.script): poses p[x, y, z, rx, ry, rz] in m and rad, and joints [..] in rad, that a move goes to.

PolyScope writes a point twice, ``Name_p`` and ``Name_q``, and moves to ``get_inverse_kin(Name_p, qnear=Name_q)``: both
are corrected together. Installation features, tools and tables of numbers look the same: a list of six numbers is a
target only where a move names it.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import atan2, cos, dist, hypot, nan, pi, sin
from typing import NamedTuple

import numpy as np

from truearm.arm.rigid_motions import inverse, motion
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.programs.controllers import NOT_STATED, StatedKinematics, disagreements, other_robot
from truearm.wings.exports.programs.number_texts import NUMBER, six_numbers
from truearm.wings.exports.programs.numbers import Number, quaternion_of, rotation_of_quaternion
from truearm.wings.exports.programs.program import (
    COMES_FROM,
    WRITTEN_OTHERWISE,
    Language,
    LeftAlone,
    Lines,
    Move,
    MoveKind,
    Passing,
    Program,
    Surroundings,
    Target,
    line_end_of,
)

_LIST = re.compile(rf"(p?)\[\s*({NUMBER}(?:\s*,\s*{NUMBER}){{5}})\s*\]")
_AFTER = re.compile(r"[ \t]*(?:[\r\n,)]|\Z)")
_HIDDEN = re.compile(r"#[^\r\n]*|\"[^\"\r\n]*\"|'[^'\r\n]*'")
# Not the name of an argument: after a bracket or a comma.
_ASSIGNED = re.compile(r"(?<![\w.,(])(?<![,(] )([A-Za-z_]\w*)\s*(\[[^\]\n]*\])?\s*=(?!=)\s*")
_GLOBAL = re.compile(r"\bglobal\s+([A-Za-z_]\w*)")
_CALL = re.compile(r"(?<![\w.])((?:optimove|move)[jl]|move[pc]|servo[jc]|set_tcp)\s*\(")
_BLEND_MM = 5.0
# What may stand in a line between two moves: calls that move no arm, and values without a call.
_STILL = re.compile(
    r"[ \t]*(?:\$[^\r\n]*|(?:set_(?:standard_|configurable_|tool_)?(?:digital|analog)_out|sleep|textmsg)"
    r"\s*\([^()\r\n]*\)|(?:global\s+)?[A-Za-z_]\w*\s*=\s*[^()\r\n]*)?[ \t]*"
)
# Moves after which the arm stands at their target; a servo does not wait for it.
_PLAIN = ("movej", "movel", "movec")
_BLEND_ARGUMENT = 4  # of movej and movel, from 0
_KINDS: dict[str, MoveKind] = {
    "movel": "linear",
    "optimovel": "linear",
    "movep": "linear",
    "movec": "circular",
    "servoc": "circular",
}
_OPENS = re.compile(r"^[ \t]*(?:def|thread|while|if|for)\b", re.MULTILINE)
_ENDS = re.compile(r"(?<![\w.])end\b")
_BLOCKS = re.compile(rf"{_OPENS.pattern}|{_ENDS.pattern}", re.MULTILINE)
_LINE_END = re.compile(r"[\r\n]")
_SIGN = re.compile(r"[()\[\],]")
_NAME = re.compile(r"[A-Za-z_]\w*")
_DEFINED = re.compile(r"^[ \t]*def\s+([A-Za-z_]\w*)", re.MULTILINE)
_PARAMETERS = re.compile(r"^[ \t]*def\s+[A-Za-z_]\w*\s*\(([^)]*)\)", re.MULTILINE)
_TURNS_OFF = r"\b(?:def|thread|while|if|elif|else|for|end|return|break|continue|halt)\b"
_NAMED = re.compile(r"([a-z]\w*)\s*=")
_SPEED_ARGUMENTS = 2  # acceleration and speed; then time and radius of the blend
_INVERSE = re.compile(r"get_inverse_kin\s*\((.*)\)", re.DOTALL)
_TRANS = re.compile(r"pose_trans\s*\(")
_WITH_TOOL = 4  # arguments of get_inverse_kin before its tool
POSE = ("x", "y", "z", "rx", "ry", "rz")
JOINTS = tuple(f"j{i}" for i in range(1, 7))


def hidden(text: str) -> str:
    """A program of the same length with blanks for its comments and strings."""
    return _HIDDEN.sub(lambda found: " " * len(found[0]), text)


class _Literal(NamedTuple):
    """A list of six numbers: where it stands, and whether it is a pose."""

    start: int
    end: int
    is_pose: bool
    numbers: tuple[Number, ...]

    @property
    def values(self) -> list[float]:
        return [number.value for number in self.numbers]


def _literal(text: str, start: int, end: int | None = None) -> _Literal | None:
    """The list that begins at a place, and fills the text to its end, if that is stated."""
    found = _LIST.match(text, start)
    if found is None or (end is not None and text[found.end() : end].strip()):
        return None
    numbers = six_numbers(found[2], found.start(2))
    return None if numbers is None else _Literal(found.start(), found.end(), bool(found[1]), tuple(numbers))


def _arguments(text: str, start: int) -> list[tuple[int, int]] | None:
    """Places of the arguments of a call whose bracket opens before `start`; None if it does not close."""
    depth, places, first = 0, [], start
    for found in _SIGN.finditer(text, start):
        sign, at = found[0], found.start()
        if sign in "([":
            depth += 1
        elif sign in ")]" and depth:
            depth -= 1
        elif sign == ")" or (sign == "," and not depth):
            places.append((first + len(text[first:at]) - len(text[first:at].lstrip()), at))
            first = at + 1
            if sign == ")":
                return places
    return None


def _functions(code: str) -> Iterator[tuple[int, int]]:
    """Places of the functions and threads of a program."""
    opened: list[tuple[int, bool]] = []
    for found in _BLOCKS.finditer(code):
        word = found[0].strip()
        if word != "end":
            opened.append((found.start(), word in ("def", "thread")))
        elif opened:
            start, is_function = opened.pop()
            if is_function:
                yield start, found.end()


@dataclass
class _Use:
    """A list that moves go to, by the name of the first, the joints that were beside it, and the frame it is in."""

    name: str
    literal: _Literal
    near: dict[int, _Literal] = field(default_factory=dict)
    work: _Literal | None = None

    @property
    def T_base_work(self) -> FloatArray:
        return np.eye(4) if self.work is None else pose_matrix(self.work.values)


class _Framed(NamedTuple):
    """A move to a pose in a frame, by its number among the moves: its words, places of its names, and what it uses."""

    move: int
    words: str
    place: tuple[int, int]
    use: _Use


class _Reader:
    """One pass over the moves of a program."""

    def __init__(self, data: bytes) -> None:
        self.line = Lines(data)
        self.text = data.decode("latin-1")
        self.code = hidden(self.text)
        self.functions = list(_functions(self.code))
        self.bases: dict[str, int] = {}
        self.globals = set(_GLOBAL.findall(self.code))
        self.variables, self.problems = self._assignments()
        self.tools: list[_Literal | None] = []
        self.left: list[LeftAlone] = []
        self.uses: dict[int, _Use] = {}
        self.moves: list[tuple[Move, int]] = []
        self.parameters = {name for found in _PARAMETERS.findall(self.code) for name in _NAME.findall(found)}
        self.n_uses: Counter[int] = Counter()
        self.framed: list[_Framed] = []
        self.turns = re.compile(_TURNS_OFF + "".join(rf"|{name}\s*\(" for name in _DEFINED.findall(self.code)))

    def _assignments(self) -> tuple[dict[str, list[_Literal]], dict[str, str]]:
        """Literal lists by the names of their variables, and why a variable is none."""
        variables: dict[str, list[_Literal]] = defaultdict(list)
        problems: dict[str, str] = {}
        for found in _ASSIGNED.finditer(self.code):
            begins_list = self.code.startswith(("[", "p"), found.end()) and not found[2]
            literal = _literal(self.code, found.end()) if begins_list else None
            if literal is None or not _AFTER.match(self.code, literal.end):
                line = self.line(found.start())
                problems.setdefault(found[1], f"computed in line {line}")
                for name in _NAME.findall(self.code, found.end(), self._line_end(found.end())):
                    self.bases.setdefault(name, line)
            else:
                variables[found[1]].append(literal)
        return variables, problems

    def _line_end(self, at: int) -> int:
        found = _LINE_END.search(self.code, at)
        return len(self.code) if found is None else found.start()

    def _function(self, at: int) -> tuple[int, int]:
        """The outermost function or thread around a place: those within it share its variables."""
        return min((one for one in self.functions if one[0] <= at < one[1]), default=(0, len(self.code)))

    def read(self) -> None:
        """Find the places of all moves."""
        n_open = len(_OPENS.findall(self.code)) - len(_ENDS.findall(self.code))
        if n_open > 0:
            raise InputError(f"{n_open} blocks have no end: the program is truncated", line=self.line(len(self.text)))
        last = 0
        for call in _CALL.finditer(self.code):
            arguments = _arguments(self.code, call.end())
            if arguments is None:
                raise InputError(
                    f"the call of {call[1]} does not end: the program is truncated", line=self.line(call.start())
                )
            words = " ".join(self.text[call.start() : arguments[-1][1] + 1].split())
            follows = not self.turns.search(self.code, last, call.start())
            between = self.code[last + bool(last) : call.start()]
            is_still = bool(last) and all(map(_STILL.fullmatch, re.split(r"\r\n|\n|\r", between)))
            last = arguments[-1][1] if call[1] != "set_tcp" else last
            for start, end in arguments[: 2 if call[1] == "movec" else 1]:
                named = re.compile(r"(?:pose|q)\w*\s*=\s*").match(self.code, start, end)
                move = Move(self.line(call.start()), _KINDS.get(call[1], "joint"), None, follows)
                passing = self._passing(call, arguments) if is_still else COMES_FROM
                move = move._replace(passing=passing, blend_mm=self._blend_mm(call[1], arguments))
                self._take(call[1], move, words, named.end() if named else start, end)
                follows = True

    def _passing(self, call: re.Match[str], arguments: list[tuple[int, int]]) -> Passing | str:
        """How a movel goes through further points: with its speed and acceleration, but without a stop."""
        named = {found[1] for at, stop in arguments[1:] if (found := _NAMED.match(self.code, at, stop))}
        if call[1] != "movel" or named - {"a", "v", "r"} or len(arguments) - 1 - len(named) > _SPEED_ARGUMENTS:
            return WRITTEN_OTHERWISE
        if any("(" in self.code[at:stop] for at, stop in arguments[1:]) or _TRANS.match(self.code, *arguments[0]):
            return WRITTEN_OTHERWISE
        blanks = self.text[self.line.start(call.start()) : call.start()]
        if blanks.strip():
            return WRITTEN_OTHERWISE
        kept = [self.text[at:stop].rstrip() for at, stop in arguments[1:] if not re.match(r"r\s*=", self.code[at:stop])]
        after = "".join(f", {one}" for one in kept)
        ending = ")" + line_end_of(self.text.encode("latin-1")).decode() + blanks
        first = self.text[call.start() : arguments[0][0]]
        return Passing(call.start(), first.encode("latin-1"), (after + ending).encode("latin-1"), len(after))

    def _blend_mm(self, call: str, arguments: list[tuple[int, int]]) -> float:
        """The radius of the blend at the end of a move; NaN where it is not known."""
        texts = [self.code[at:stop].strip() for at, stop in arguments]
        stated = [text.partition("=")[2].strip() for text in texts[1:] if re.match(r"r\s*=", text)]
        plain = [text for text in texts if not _NAMED.match(text)]
        if call in _PLAIN[:2]:
            stated += plain[_BLEND_ARGUMENT:]
        elif len(plain) > 2:  # of a circle: they may be its radius
            return nan
        radius = stated[0] if stated else "0"
        return MM_PER_M * float(radius) if len(stated) < 2 and re.fullmatch(NUMBER, radius) else nan

    def _is_certain(self, call: str, text: str, lists: list[_Literal]) -> bool:
        """Whether a move certainly goes to the only list that it can name."""
        name = text.strip()
        if call not in _PLAIN or len(lists) != 1:
            return False
        if not _NAME.fullmatch(name):
            return True
        return len(self.variables.get(name, ())) == 1 and name not in self.problems and name not in self.parameters

    def _take(self, call: str, move: Move, words: str, start: int, end: int) -> None:
        """Take one place of a move, or a tool."""
        line = move.line
        inverse = _INVERSE.fullmatch(self.code[start:end].rstrip())
        near: list[_Literal] = []
        if inverse is not None:
            places = _arguments(self.code, start + inverse.start(1)) or [(start, start)]
            start, end = places[0]
            if len(places) > _WITH_TOOL or any(re.match(r"tcp\w*\s*=", self.code[at:stop]) for at, stop in places):
                start = end  # another tool: no list stands there
            elif len(places) > 1:
                at, stop = places[1]
                named = re.compile(r"qnear\s*=\s*").match(self.code, at, stop)
                found = self._lists(named.end() if named else at, stop)
                near = [] if isinstance(found, str) else [one for one in found if not one.is_pose]
        if call != "set_tcp" and (use := self._in_frame(call, line, start, end)) is not None:
            use.near = {one.start: one for one in near}
            self.framed.append(_Framed(len(self.moves), words, (start, end), use))
            self.moves.append((move, -1))
            return
        lists = self._lists(start, end)
        if call == "set_tcp":
            self.tools += [None] if isinstance(lists, str) else lists
            return
        if isinstance(lists, str):
            self.moves.append((move, -1))
            self.left.append(LeftAlone(line, words, lists))
            for name in _NAME.findall(self.code[start:end]):
                self.bases.setdefault(name, line)
            return
        name = self.code[start:end].strip()
        for literal in lists:
            use = self.uses.setdefault(
                literal.start, _Use(name if _NAME.fullmatch(name) else f"{call} in line {line}", literal)
            )
            use.near |= {one.start: one for one in near}
            is_certain = self._is_certain(call, self.code[start:end], lists)
            self.moves.append((move._replace(is_certain=is_certain), literal.start))

    def _in_frame(self, call: str, line: int, start: int, end: int) -> _Use | None:
        """What pose_trans(frame, pose) uses, where both are certain."""
        opens = _TRANS.match(self.code, start, end)
        places = _arguments(self.code, opens.end()) if opens else None
        if places is None or len(places) != 2 or self.code[places[1][1] + 1 : end].strip():
            return None
        frames, poses = (self._lists(*place) for place in places)
        if isinstance(frames, str) or isinstance(poses, str) or len(poses) > 1:
            return None
        before = [one for one in frames if one.end <= places[1][0]]
        frame = max(before or frames, key=lambda one: one.start)
        is_certain = len(frames) == 1 or (
            self._function(frame.start) == self._function(start) and not self.turns.search(self.code, frame.end, start)
        )
        if not is_certain or not frame.is_pose or not poses[0].is_pose:
            return None
        name = self.code[slice(*places[1])].strip()
        return _Use(name if _NAME.fullmatch(name) else f"{call} in line {line}", poses[0], work=frame)

    def _settle_frames(self) -> None:
        """Take poses in frames, unless frame or pose is a target by itself: one of the two is then an offset."""
        direct = set(self.uses)
        frames: defaultdict[int, set[int]] = defaultdict(set)
        for one in self.framed:
            assert one.use.work is not None  # of a pose in a frame
            frames[one.use.literal.start].add(one.use.work.start)
        for number, words, place, use in self.framed:
            at, (work, *others) = use.literal.start, frames[use.literal.start]
            move, _ = self.moves[number]
            if others or direct & {at, work} or work in frames:
                self.left.append(LeftAlone(move.line, words, "computed at run time"))
                for name in _NAME.findall(self.code[slice(*place)]):
                    self.bases.setdefault(name, move.line)
            else:
                self.uses.setdefault(at, use).near |= use.near
                self.moves[number] = (move, at)

    def _lists(self, start: int, end: int) -> list[_Literal] | str:
        """The literal lists that an expression can be, or why it is none."""
        literal = _literal(self.code, start, end)
        if literal is not None:
            return [literal]
        name = self.code[start:end].strip()
        if not _NAME.fullmatch(name):
            return "computed at run time"
        if name in self.problems:
            return f"{name} is {self.problems[name]}"
        values = self.variables.get(name, [])
        if name not in self.globals:  # otherwise functions have their own variables of the same name
            values = [one for one in values if self._function(one.start) == self._function(start)] or values
        return values or f"{name} has no value in the program"

    def targets(self, beside: Surroundings, stated: StatedKinematics) -> Iterator[tuple[int, Target | LeftAlone]]:
        """The targets in the order of the moves, by the places of their lists, and what is not changed."""
        tool, no_tool = self._tool(beside)
        self._settle_frames()
        for use in self.uses.values():
            twins = self._twins(use.name) if use.literal.is_pose and not use.near else ()
            if len(twins) == 1 and not twins[0].is_pose:
                use.near = {twins[0].start: twins[0]}
        self.n_uses.update([*self.uses, *(start for use in self.uses.values() for start in use.near)])
        before: _Literal | None = None
        away = self._disagreements(tool, stated)
        for start in dict.fromkeys(start for _, start in self.moves if start >= 0):
            use = self.uses[start]
            if not use.literal.is_pose:
                before = use.literal
            elif use.near:
                before = next(iter(use.near.values()))
            made = self._target(use, before, no_tool if tool is None else tool, stated, away.get(start))
            yield start, LeftAlone(self.line(start), use.name, made, is_literal=True) if isinstance(made, str) else made

    def _disagreements(self, tool: FloatArray | None, stated: StatedKinematics) -> dict[int, str]:
        """Of poses with joints of their own, by the places of their lists; see `disagreements`.

        Raises
        ------
        InputError
            If most points with joints and pose contradict themselves: of another robot, or with another tool.
        """
        if tool is None:
            return {}
        uses = [use for use in self.uses.values() if use.literal.is_pose and use.near]
        joints = np.array([next(iter(use.near.values())).values for use in uses]).reshape(-1, 6)
        poses = np.array([use.T_base_work @ pose_matrix(use.literal.values) for use in uses]).reshape(-1, 4, 4)
        flange = poses @ inverse(tool)
        found = disagreements(stated.checked, joints, flange)
        own = [i for i, use in enumerate(uses) if next(iter(use.near.values())) in self._twins(use.name)]
        bad = [i for i in own if found[i]]
        if 2 * len(bad) > len(own):
            first = uses[bad[0]]
            raise InputError(
                f"{len(bad)} of {len(own)} points contradict themselves, the first {first.name}: {found[bad[0]]}",
                line=self.line(first.literal.start),
                hint=other_robot(joints[own], flange[own]),
            )
        return {use.literal.start: one for use, one in zip(uses, found, strict=True)}

    def _twins(self, name: str) -> Sequence[_Literal]:
        """The joints of a point (`Name_q`) whose pose is in the variable `Name_p`."""
        return self.variables.get(f"{name[:-2]}_q", ()) if name.endswith("_p") else ()

    def _target(
        self, use: _Use, near: _Literal | None, tool: FloatArray | str, stated: StatedKinematics, away: str | None
    ) -> Target | str:
        """The target of a list, or why it is not changed; `tool` may be why there is none.

        `away` is how far a pose is from joints of its own, None without them.
        """
        line, numbers, values = self.line(use.literal.start), use.literal.numbers, use.literal.values
        span = (use.literal.start, use.literal.end)
        if not stated.is_stated:
            return NOT_STATED
        if not use.literal.is_pose:
            T_tool = None if isinstance(tool, str) else tool
            named = dict(zip(JOINTS, numbers, strict=True))
            return Target(use.name, line, named, joints=np.array(values), T_flange_tool=T_tool, span=span)
        if not any(values) and use.work is None:
            return "a place-holder: all its numbers are zero"
        if isinstance(tool, str):
            return tool
        if len(use.near) > 1:
            return "it is used with several start joints"
        T = pose_matrix(values)
        q = None if near is None else np.array(near.values)
        named = dict(zip(POSE, numbers, strict=True))
        if near is not None and away is not None:
            if away and near in self._twins(use.name):
                return away
            if not away and self.n_uses[near.start] == 1:
                named |= zip(JOINTS, near.numbers, strict=True)
        return Target(use.name, line, named, pose=T, T_flange_tool=tool, T_base_work=use.T_base_work, near=q, span=span)

    def _tool(self, beside: Surroundings) -> tuple[FloatArray | None, str]:
        """The only tool of the program, or that of the frames, and why there is none."""
        if None in self.tools:
            return None, "set_tcp has a tool that is computed at run time"
        stated = {tuple(one.values): one for one in self.tools if one is not None}
        if len(stated) > 1:
            return None, f"set_tcp changes between {len(stated)} tools"
        if stated:
            return pose_matrix(next(iter(stated))), ""
        return beside.frames.tool_of(None), "state its tool in --frames: the program has no set_tcp"

    def notes(self) -> Iterator[str]:
        """Points that others are computed from, and poses without joints."""
        names = {use.name: use for use in self.uses.values()}
        for name, line in self.bases.items():
            if name in names:
                yield f"{name} is used in a computation in line {line}: the result has the correction of {name}"
        alone = sum(use.literal.is_pose and not use.near for use in self.uses.values())
        if alone:
            yield f"{alone} poses have no joints of their own: those before them in the text state their configuration"


def pose_matrix(numbers: Sequence[float]) -> FloatArray:
    """(4, 4) rigid motion [mm] of x, y, z [m] and a rotation vector [rad]."""
    angle = hypot(*numbers[3:])
    share = sin(angle / 2) / angle if angle else 0.5
    R = rotation_of_quaternion([cos(angle / 2), *(share * one for one in numbers[3:])])
    return motion(R, [MM_PER_M * one for one in numbers[:3]])


def pose_numbers(T: FloatArray, old: Sequence[float]) -> list[float]:
    """x, y, z [m] and rotation vector [rad] of a rigid motion [mm]: of all vectors the one nearest to the old one."""
    w, *v = quaternion_of(T[:3, :3], (1.0, 0.0, 0.0, 0.0))
    sine = hypot(*v)
    angle = 2 * atan2(sine, w)
    vectors = [[one * (angle + 2 * pi * k) / sine for one in v] if sine else v for k in (0, -1, 1)]
    nearest = min(vectors, key=lambda one: dist(one, old[3:]))
    return [*(T[:3, 3] / MM_PER_M).tolist(), *nearest]


class URScript(Language):
    """URScript of Universal Robots."""

    title = "URScript of Universal Robots"
    endings = (".script", ".urp")
    comment = b"# "

    def recognises(self, data: bytes) -> bool:
        """See `Language`."""
        text = hidden(data.decode("latin-1"))
        return not re.search(r"^\s*(?:import\s|from\s|<)", text, re.MULTILINE) and bool(
            _CALL.search(text) or re.search(r"=\s*p\[", text)
        )

    def read(self, data: bytes, beside: Surroundings) -> Program:
        """See `Language`."""
        reader = _Reader(data)
        reader.read()
        stated = StatedKinematics.of(beside)
        found = dict(reader.targets(beside, stated))
        targets = {start: one for start, one in found.items() if isinstance(one, Target)}
        left = [*reader.left, *(one for one in found.values() if isinstance(one, LeftAlone))]
        notes = (*reader.notes(), *filter(None, [stated.note if stated.is_stated else ""]))
        return Program.of(data, targets, sorted(left), reader.moves, notes, stated.controller)

    def values(self, target: Target, joints: FloatArray, pose: FloatArray | None) -> Mapping[str, float]:
        """See `Language`."""
        new: dict[str, float] = {}
        if POSE[0] in target.numbers:
            assert pose is not None  # of a Cartesian target
            old = [target.numbers[name].value for name in POSE]
            new |= zip(POSE, pose_numbers(pose, old), strict=True)
        if JOINTS[0] in target.numbers:
            new |= zip(JOINTS, joints.tolist(), strict=True)
        return new

    def zone(self, spacing_mm: float) -> bytes:
        """See `Language`."""
        return b", r=%g" % (self.blend_mm(spacing_mm) / MM_PER_M)

    def blend_mm(self, spacing_mm: float) -> float:
        """See `Language`: a move whose blend overlaps another is skipped; targets are at least half a spacing apart."""
        return min(_BLEND_MM, spacing_mm / 5)

    def number_text(self, number: Number, value: float, decimals: int) -> bytes:
        """See `Language`: a zero before the point as the number has it."""
        text = super().number_text(number, value, decimals)
        dropped = number.text.lstrip(b"+-").startswith(b".")
        return text.replace(b"0.", b".", 1) if dropped and abs(float(text)) < 1 else text
