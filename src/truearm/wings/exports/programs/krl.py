"""KUKA KRL: targets of ``.src``, ``.dat`` and ``.sub`` files.

A pose is ``{X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 3,E1 0}`` in mm and deg in its base, with R = Rz(A) Ry(B) Rx(C); joints are
``{A1 .., A6 ..}`` in deg. Bit k - 1 of T is set where axis k is negative. Of S, bit 0 is a wrist centre behind axis 1,
bit 1 one in front of the line from axis 2 to axis 3, bit 2 a negative axis 5, bit 4 a point that an absolutely accurate
robot was taught. Tool and base of a taught point are numbers in its FDAT, those of other points what the lines before
them state.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import takewhile
from math import inf, isinf
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearm.arm.rigid_motions import motion
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.typing import FloatArray
from truearm.wings.exports.programs.numbers import Number, angles_of, rotation_of
from truearm.wings.exports.programs.program import (
    CALLED,
    COMES_FROM,
    WRITTEN_OTHERWISE,
    Condition,
    Language,
    LeftAlone,
    Move,
    MoveKind,
    NamedTarget,
    NamedTargets,
    Passing,
    Program,
    Surroundings,
    Target,
    line_end_of,
    some,
    text_start,
)
from truearm.wings.exports.targets.edits import Edit

MAX_BYTES = 16 * 2**20
_MOVES: dict[bytes, MoveKind] = {
    **dict.fromkeys((b"PTP", b"SPTP", b"SPL"), "joint"),  # a spline is no straight move either
    **dict.fromkeys((b"LIN", b"SLIN"), "linear"),
    **dict.fromkeys((b"CIRC", b"SCIRC"), "circular"),
}
_POSE, _JOINTS = ("X", "Y", "Z", "A", "B", "C"), tuple(f"A{i}" for i in range(1, 7))
_EXTERNAL = tuple(f"E{i}" for i in range(1, 7))
_TARGETS = (b"E6POS", b"POS", b"E6AXIS", b"AXIS")
_LINE = re.compile(rb"[^\r\n]*(?:\r\n|\n|\r|$)")
_CODE = re.compile(rb'(?:[^";]|"[^"\r\n]*")*')
_NUMBER = rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_FIELD = re.compile(rb"\s*([A-Za-z_]\w*)\s+(" + _NUMBER + rb"|'[BbHh][0-9A-Fa-f]+')\s*")
_NAME = rb"\$?[A-Za-z_][\w$]*(?:\s*\[\s*\d+\s*\])?"
_DECLARED = re.compile(
    rb"(?i)\s*(?:GLOBAL\s+)?(?:DECL\s+)?(?:GLOBAL\s+)?(?:CONST\s+)?(E6POS|POS|E6AXIS|AXIS|FRAME|FDAT)\s+(.*)"
)
_GIVEN = re.compile(rb"(?i)\s*(?:DECL\s+)?(" + _NAME + rb")\s*(\.\s*\w+\s*)?=\s*(.*)", re.DOTALL)
_MOVED = re.compile(rb"(?i)\s*((?:S?PTP|S?LIN|S?CIRC|SPL)(?:_REL)?)\s+(?=[{\w$])(.*)", re.DOTALL)
_AGGREGATE = re.compile(rb"\{\s*(?:[A-Za-z_]\w*\s*:)?([^{}]*)\}")
_GOAL = re.compile(rb"\s*(\{[^{}]*\}|[^,{}\s]*(?:\s*:\s*[^,{}\s]+)*)")
_BAS = re.compile(rb"(?i)\s*BAS\s*\(\s*#(TOOL|BASE)\s*,\s*(\w+)\s*\)")
_EXTERNAL_BASE = re.compile(rb"(?i)\s*BAS\s*\(\s*#EX_BASE\b")
_DATA = re.compile(rb"(?i)(TOOL|BASE)_DATA\s*\[\s*(\d+)\s*\]")
# What a spline move or block states for itself, after WITH.
_WITH = re.compile(
    rb"(?i)\$(TOOL|BASE|IPO_MODE)\s*=\s*((?:[^,{}()]|\{[^{}]*\}|\((?:[^()]|\([^()]*\))*\))*?)\s*(?:C_\w+\s*)?(?:,|$)"
)
_OF_FDAT = re.compile(rb"(?i)S(?:TOOL2?|BASE)\s*\(\s*(" + _NAME + rb")\s*(?:\.\s*\w+\s*)?\)")
_WORDS = re.compile(rb"\$?[A-Za-z_][\w$]*")
_BRANCH = re.compile(rb"(?i)\s*(IF|SWITCH|ELSE|CASE|DEFAULT|ENDIF|ENDSWITCH)(?![\w$])")
_NULL = b"0"
_LOOP = re.compile(rb"(?i)\s*(LOOP|FOR|WHILE|REPEAT|ENDLOOP|ENDFOR|ENDWHILE|UNTIL)(?![\w$])")
_DEEPEST = 16  # loops in loops of which each is followed twice
_SEVERAL = b"?"  # tools or bases of branches, loops and subprograms
_CALL = re.compile(rb"\s*([A-Za-z_]\w*)\s*\(")
_BEGINS = re.compile(rb"(?i)\s*(?:GLOBAL\s+)?DEF(?:FCT\s+\w+)?\s+([A-Za-z_]\w*)\s*\(")
# What may bring the arm to a line from elsewhere.
_TURNS_OFF = re.compile(
    rb"(?i)\s*(?:(?:GLOBAL\s+)?DEF(?:FCT)?|IF|ELSE|ENDIF|SWITCH|CASE|DEFAULT|ENDSWITCH|LOOP|ENDLOOP|FOR|ENDFOR|WHILE"
    rb"|ENDWHILE|REPEAT|UNTIL|EXIT|GOTO|RETURN|INTERRUPT|RESUME|END)(?![\w$])|\s*[A-Za-z_][\w$]*\s*:\s*$"
)
# Lines between two moves that move no arm and start nothing.
_STILL = re.compile(
    rb"(?i)\s*(?:WAIT\s+SEC\s+[\d.]+|BAS\s*\(\s*#[^()]*\)|\$(?:OUT|VEL|ACC|APO)\b[^=]*=[^(=][^(]*"
    rb"|[A-Za-z_][\w$]*\s*(?:\[[\s\d]*\]\s*)?=(?!=)[^(]*)?\s*"
)
_FOLD = re.compile(rb"(?i)\s*;\s*(END)?FOLD\b")
_LABEL = re.compile(rb"\s*([A-Za-z_][\w$]*)\s*:\s*")
_GOTO = re.compile(rb"(?i)\s*GOTO\s+([\w$]+)\s*")
_COMPONENT = re.compile(rb"(?i)\s*([A-Za-z_][\w$]*)\s*(\[[^\]]*\])?\s*\.\s*(?!E\d)(\w+)\s*=(?!=)")
_STATUS = re.compile(rb"(?i)[{:,]\s*X\s[^{}]*,\s*S\s+([^\s,{}]+)")
_OF_MACHINE = re.compile(rb"(?i)\s*MACHINE_FRAME_DAT\s*\[\s*(\d+)\s*\]\s*=\s*\{\s*MACH_DEF_INDEX\s+0*([1-9]\d*)\b")
# Calls that set no tool and no base: words of the language, and routines of the controller.
_HARMLESS = re.compile(
    rb"IF|ELSE|WHILE|UNTIL|SWITCH|CASE|FOR|WAIT|RETURN|BAS|PULSE|C(?:OPEN|CLOSE|READ|WRITE|IOCTL)|S(?:READ|WRITE)"
    rb"|MBX_REC|ERR_\w+|\w*MSG\w*|STR\w+|RSI_\w+|EKI_\w+|CAST_\w+|PTP|LIN|CIRC|LOOP|REPEAT|DEF|DEFFCT"
)
# Calls of technology packages that templates and inline forms write: their subprograms have no points of the program.
_OF_PACKAGES = frozenset(b"USERSPOT USER_GRP GRP H50 H70".split())
_IN_FOLD = "in a fold, whose lines the pendant writes again"
_BETWEEN = "not certain what the line before it does"
_SETS = re.compile(rb"(?i)\s*(?:\$(?:TOOL|BASE|IPO_MODE)\b[^=]*=|FDAT_ACT\s*=|BAS\s*\(\s*#(?:TOOL|BASE|EX_BASE)\b)")
_REASONS = {
    b"TCP": "its tool is fixed in the cell (IPO_FRAME #TCP)",
    b"EK": "its base moves with an external kinematic",
    _SEVERAL: "branches, loops or subprograms set its {what}, not all to the same",
}


class _Value(NamedTuple):
    """A literal aggregate: its numbers, its words such as #BASE, and its place."""

    numbers: dict[str, Number]
    has_more: bool  # something in it is not a number
    span: tuple[int, int]

    @property
    def external(self) -> tuple[Number, ...]:
        """E1 and those after it, up to the first that is missing."""
        return tuple(takewhile(bool, map(self.numbers.get, _EXTERNAL)))  # type: ignore[arg-type]

    @property
    def is_pose(self) -> bool:
        """Whether it has all numbers of a pose."""
        return not self.has_more and set(_POSE) <= set(self.numbers)


@dataclass(frozen=True)
class _Line:
    number: int
    start: int
    code: bytes


# Numbers of tool and base, or None where they are not stated.
_Frames = tuple[bytes | None, bytes | None]


class _State(NamedTuple):
    """Tool and base at a line, and whether the tool is fixed in the cell."""

    tool: bytes | None = None
    base: bytes | None = None
    is_fixed: bool = False

    @property
    def frames(self) -> _Frames:
        """As they are used by a move."""
        return (b"TCP", b"TCP") if self.is_fixed else (self.tool, self.base)

    def with_frame(self, which: bytes, number: bytes | None) -> _State:
        """With another tool or base."""
        return self._replace(tool=number) if which == b"TOOL" else self._replace(base=number)

    def either(self, other: _State) -> _State:
        """What holds after two branches."""
        tool, base = map(_either, self[:2], other[:2])
        return _State(tool, base, self.is_fixed or other.is_fixed)


class _Branches(NamedTuple):
    """An IF or SWITCH that is read: what holds before it, and after each of its branches."""

    before: _State
    after: list[_State] | None  # None: before the first branch
    has_all: bool = False  # one of its branches is taken


class Krl(Language):
    """See the module."""

    title = "KUKA KRL"
    endings = (".src", ".dat", ".sub")
    comment = b"; "
    heading = rb"(?im)^(?:\xef\xbb\xbf)?[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT|DAT)?[ \t][^\r\n]*(?:\r\n|\n|\r)"

    def recognises(self, data: bytes) -> bool:
        """See `Language`."""
        return bool(
            re.search(
                rb"(?im)^[ \t]*(?:&ACCESS\b|(?:GLOBAL[ \t]+)?(?:DEF|DEFFCT|DEFDAT)[ \t]+[\w$]+(?![^\r\n]*:[ \t]*\r?$)"
                rb"|(?:GLOBAL[ \t]+)?DECL[ \t]+(?:GLOBAL[ \t]+)?(?:E6POS|E6AXIS|POS|AXIS|FRAME)[ \t]+\w)",
                data,
            )
        )

    def read(self, data: bytes, beside: Surroundings) -> Program:
        """See `Language`."""
        return _File(data, beside).program()

    def values(self, target: Target, joints: FloatArray, pose: FloatArray | None) -> Mapping[str, float]:
        """See `Language`."""
        if target.joints is not None:
            return dict(zip(_JOINTS, np.degrees(joints).tolist(), strict=True))
        assert pose is not None  # of a Cartesian target
        before = [target.numbers[name].value for name in "CBA"]
        c, b, a = angles_of(pose[:3, :3], before)
        return dict(zip(_POSE, (*pose[:3, 3].tolist(), a, b, c), strict=True))

    def configuration(self, target: Target, quantities: Mapping[str, float]) -> Iterable[Edit]:
        """See `Language`."""
        turn = sum(1 << (i - 1) for i in range(1, 7) if quantities[f"J{i}"] < 0)
        bits = (quantities["shoulder"] < 0, quantities["elbow"] > 0, quantities["J5"] < 0)
        status = bits[0] + 2 * bits[1] + 4 * bits[2]
        for name, value in (("S", status), ("T", turn)):
            number = target.numbers[name]
            if _whole(number.text) != value:
                yield Edit(number.start, number.end, _as_before(number.text, value))

    def zone(self, spacing_mm: float) -> bytes:
        """See `Language`: how near it passes is $APO.CDIS of the program."""
        del spacing_mm
        return b" C_DIS"


class _File(NamedTargets):
    """A file while it is read."""

    def __init__(self, data: bytes, beside: Surroundings) -> None:
        super().__init__(data, beside)
        self.lines = list(_lines(data))
        self.types: dict[bytes, bytes] = {}
        self.fdat: dict[bytes, _Frames] = {}
        self.uses: defaultdict[bytes, dict[_Frames, int]] = defaultdict(dict)
        self.frames: dict[tuple[bytes, bytes], FloatArray] = {}
        self.setters: set[bytes] = set()
        self.unknown: set[bytes] = set()
        self.labels: set[_Line] = set()
        self.parts: dict[bytes, tuple[str, int]] = {}
        self.changed: set[tuple[bytes, bytes]] = set()
        self.machines: dict[bytes, bytes] = {}
        self.bases: dict[bytes, int] = {}
        self.factors: dict[bytes, int] = {}
        self.increments: dict[bytes, int] = {}
        self.indexed: set[bytes] = set()
        self.is_accurate = False
        self.found: list[tuple[bytes | None, str, int, _Value, _Frames]] = []
        self.given: list[tuple[_Line, re.Match[bytes]]] = []

    def program(self) -> Program:
        """Read it all."""
        self._check_ends()
        others = [list(_lines(data)) for data in self._companions()]
        for lines in (*others, self.lines):
            of_file: dict[tuple[bytes, bytes], bytes] = {}
            for line in lines:
                self._declare(line.code, of_file)
        called = self._called([*others, self.lines])
        calls = {call[1].upper(): _text(call[1]) for line in self.lines if (call := _CALL.match(line.code))}
        own = _names_of([self.lines]) | _OF_PACKAGES
        names = [text for name, text in calls.items() if name not in own and not _HARMLESS.fullmatch(name)]
        self.notes += [CALLED.format(some(names))] if names else []
        self.setters = _setters([*others, *called, self.lines], self.unknown)
        self.labels = {label for lines in (*others, self.lines) for label in self._reached_labels(lines)}
        for lines in others:
            self._walk(lines, is_own=False)
        self._walk(self.lines, is_own=True)
        for line, given in self.given:
            self._value(line, given)
        valued = {found[0] for found in self.found} | {_word(given[1]) for _, given in self.given}
        for move, goal in self.moves:
            if isinstance(goal, bytes) and goal not in valued:
                reason = "the program computes it" if goal[:1] == b"$" else "its numbers are in another file"
                self.left.append(LeftAlone(move.line, _text(goal), reason))
        texts = (text for lines in (*others, self.lines) for line in lines for text in _STATUS.findall(line.code))
        self.is_accurate = any(_is_accurate(text) for text in texts)
        external = [
            [value.numbers[name].value if name in value.numbers else 0.0 for name in _EXTERNAL]
            for *_, value, _ in self.found
        ]
        return self.of(self._named(), external)

    def _named(self) -> Iterator[NamedTarget]:
        for found in self.found:
            word, name, line, *_ = found
            made = self._target(*found)
            at = self.factors.get((word or b"").partition(b"[")[0])
            if at is not None and not isinstance(made, str):
                self.notes.append(f"{name} is used in a computation in line {at}: the result has its correction.")
            yield NamedTarget(word, name, line, made, self._is_reached(word))

    def settled(self, move: Move, goal: bytes | int | None) -> Move:
        """See `NamedTargets`: what is known when the whole file is read."""
        is_certain = isinstance(goal, int) or (goal is not None and self.n_mentions[goal.partition(b"[")[0]] == 1)
        passing = "$ORI_TYPE states how it turns" if self.n_mentions[b"$ORI_TYPE"] else move.passing
        return move._replace(is_certain=is_certain and move.is_certain, passing=passing)

    @cached_property
    def n_mentions(self) -> Counter[bytes]:
        """In how many lines of the file that are no moves a name stands: that of its value, and others."""
        lines = [line.code for line in self.lines if not _MOVED.fullmatch(line.code)]
        return Counter(name for code in lines for name in {one.upper() for one in _WORDS.findall(code)})

    def _is_reached(self, word: bytes | None) -> bool:
        """Whether a move goes to a target, or an FDAT says that it was taught for one."""
        if word is None or self.uses.get(word) or (word.startswith(b"X") and b"F" + word[1:] in self.fdat):
            return True
        return word.partition(b"[")[0] in self.indexed

    def _check_ends(self) -> None:
        for begin, end in ((rb"DEFDAT", rb"ENDDAT"), (rb"DEF", rb"END"), (rb"DEFFCT", rb"ENDFCT")):
            of_both = [
                sum(bool(re.match(rb"(?i)\s*(?:GLOBAL\s+)?" + word + rb"(?![\w$])", line.code)) for line in self.lines)
                for word in (begin, end)
            ]
            if of_both[0] > of_both[1]:
                problem = f"{begin.decode()} has no {end.decode()}: the file is cut off"
                raise InputError(problem, line=self.lines[-1].number if self.lines else 1)

    def _companions(self) -> Iterator[bytes]:
        """The other half of a program, and the list of tools and bases, if they are beside it."""
        file = self.beside.file
        if file is None:
            return
        other = {".src": ".dat", ".dat": ".src"}.get(file.suffix.lower())
        if other is not None:
            yield from _read_any(file.parent, file.stem + other)
        for folder in (file.parent, file.parent.parent / "System", file.parent.parent.parent / "R1" / "System"):
            for data in _read_any(folder, "$config.dat"):
                self.notes.append(f"Tools and bases are those of {folder.name}/$config.dat.")
                yield data
                return

    def _called(self, files: list[list[_Line]]) -> list[list[_Line]]:
        """Files beside the program of the subprograms that it calls, and of those that they call."""
        folder, found, waiting = self.beside.file and self.beside.file.parent, [], files
        known = _names_of(files)
        while waiting:
            calls = {call[1].upper() for lines in waiting for line in lines if (call := _CALL.match(line.code))}
            waiting = []
            for name in sorted(one for one in calls - known if not _HARMLESS.fullmatch(one)):
                text = next(_read_any(folder, name.decode() + ".src"), None) if folder else None
                if text is None:
                    self.unknown.add(name)
                else:
                    waiting.append(list(_lines(text)))
            found += waiting
            known |= calls
        return found

    def _reached_labels(self, lines: list[_Line]) -> Iterator[_Line]:
        """Labels that a GOTO of a file names: what holds there is not known where the file sets a tool or base."""
        names = {goto[1].upper() for line in lines if (goto := _GOTO.match(line.code))}
        setters = self.setters | self.unknown | {b"BAS"}
        if names and any(
            _SETS.match(line.code) or ((call := _CALL.match(line.code)) and call[1].upper() in setters)
            for line in lines
        ):
            for line in lines:
                if (label := _LABEL.fullmatch(line.code)) and label[1].upper() in names:
                    yield line

    def _declare(self, code: bytes, of_file: dict[tuple[bytes, bytes], bytes]) -> None:
        """Types of names, FDAT, and the values of tools and bases; `of_file` are those that the file has so far."""
        if b"=" in code and (given := _GIVEN.fullmatch(code)) and (at := _DATA.fullmatch(given[1])):
            value, key = _aggregate(given[3], 0), (at[1].upper(), at[2])
            is_whole = not given[2] and value is not None and value.is_pose
            if not is_whole or of_file.setdefault(key, given[3].strip()) != given[3].strip():
                self.changed.add(key)
            elif value is not None:
                self.frames[key] = _frame(value.numbers)
        if machine := _OF_MACHINE.match(code):
            self.machines[machine[1]] = machine[2]
        declared = _DECLARED.fullmatch(code)
        if declared is None:
            return
        kind, rest = declared[1].upper(), re.sub(rb"\{[^{}]*\}", b"", declared[2])
        for name in re.findall(rb"(\$?[A-Za-z_][\w$]*)\s*(?:\[[^\]]*\])?\s*(?:,|=|$)", rest):
            self.types[name.upper()] = kind
        if kind == b"FDAT" and (given := _GIVEN.fullmatch(declared[2])):
            tool, base = (re.search(rb"(?i)\b" + word + rb"\s+(\d+)", given[3]) for word in (b"TOOL_NO", b"BASE_NO"))
            if re.search(rb"(?i)IPO_FRAME\s+#TCP", given[3]):
                self.fdat[_word(given[1])] = (b"TCP", b"TCP")
            elif tool and base:
                self.fdat[_word(given[1])] = (tool[1], base[1])

    def _walk(self, lines: list[_Line], *, is_own: bool) -> None:
        """Follow the lines of a file in their order: tool and base, moves and values."""
        state, block, follows = _State(), b"", False
        obstacle, depth = COMES_FROM, 0  # of further targets before the next move; folds around a line
        branches: list[_Branches] = []
        ends = _loops(lines)
        for at, line in enumerate(lines):
            code = line.code
            if part := _COMPONENT.match(code):
                element = part[2] if re.fullmatch(rb"\[\s*\d+\s*\]", part[2] or b"") else b""
                self.parts.setdefault(_word(part[1] + element), (_text(part[3]), line.number))
            call = _CALL.match(code)
            if fold := _FOLD.match(self.data if is_own else b"", line.start):
                depth = max(depth + (-1 if fold[1] else 1), 0)
            follows &= not (_TURNS_OFF.match(code) or (call and not _HARMLESS.fullmatch(call[1].upper())))
            moves = _MOVED.fullmatch(code) is not None
            obstacle = obstacle if moves or _STILL.fullmatch(code) else _BETWEEN
            if at in ends:  # again with what holds at its end
                state = state.either(self._at_end(lines[at + 1 : ends[at]], state))
            elif (after := self._follow(line, state, branches)) is not None:
                state = after
            elif spline := re.match(rb"(?i)\s*(PTP_)?(END)?SPLINE(?![\w$])", code):
                block, follows = b"" if spline[2] else code, False
            elif moved := _MOVED.fullmatch(code):
                within = self._with(block, line, state)
                frames = self._with(code, line, within).frames
                why = WRITTEN_OTHERWISE if block else _IN_FOLD if depth else obstacle
                self._move(line, moved, frames, is_own=is_own, follows=follows, obstacle=why)
                follows, obstacle = True, ""
            elif b"=" in code and (given := _given(code)) is not None:
                if b":" in re.sub(rb"\{[^{}]*\}", b"", given[3]):
                    self.factors |= {name.upper(): line.number for name in _WORDS.findall(given[3])}
                if is_own:
                    self.given.append((line, given))

    def _at_end(self, body: list[_Line], state: _State) -> _State:
        """What holds after lines."""
        branches: list[_Branches] = []
        for line in body:
            after = self._follow(line, state, branches)
            state = state if after is None else after
        return state

    def _follow(self, line: _Line, state: _State, branches: list[_Branches]) -> _State | None:
        """What holds after a line that sets or may set a tool or base; None after another."""
        code = line.code
        if re.match(rb"(?i)\s*(?:GLOBAL\s+)?DEF(?:FCT)?\s", code):
            branches.clear()
            return _State()
        if branch := _BRANCH.match(code):
            return _branched(branch[1].upper(), state, branches)
        if bas := _BAS.match(code):
            return state.with_frame(bas[1].upper(), bas[2])
        if (call := _CALL.match(code)) and call[1].upper() in self.setters:
            return _State(_SEVERAL, _SEVERAL)
        if call and call[1].upper() in self.unknown:
            return _State(*(_SEVERAL + call[1],) * 2)
        if line in self.labels:
            return _State(_SEVERAL, _SEVERAL)
        if _EXTERNAL_BASE.match(code):
            return state._replace(base=b"EK")
        given = _GIVEN.fullmatch(code) if _SETS.match(code) else None
        if given is None:
            return None
        if _word(given[1]) == b"FDAT_ACT":
            return _State(*self.fdat.get(_word(given[3]), (None, None)))
        return self._set(state, _word(given[1])[1:], line, given[1] + given[2] if given[2] else given[3])

    def _set(self, state: _State, which: bytes, line: _Line, text: bytes) -> _State:
        """What holds after a line has set $TOOL, $BASE or $IPO_MODE."""
        if which != b"IPO_MODE":
            return state.with_frame(which, self._stated(which, line, text))
        # That of an FDAT is known with its tool.
        return state if text.strip()[:1] != b"#" else state._replace(is_fixed=_word(text) == b"#TCP")

    def _with(self, code: bytes, line: _Line, state: _State) -> _State:
        """What holds for a move or block that states its own tool and base."""
        for after in re.split(rb"(?i)\bWITH\b", code, maxsplit=1)[1:]:
            for one in _WITH.finditer(after):
                state = self._set(state, one[1].upper(), line, one[2])
        return state

    def _stated(self, which: bytes, line: _Line, text: bytes) -> bytes | None:
        """The number of the frame that a line sets; a literal one gets a number of its own."""
        if at := _DATA.fullmatch(text.strip()):
            return at[2]
        if text.strip().upper() == b"$NULLFRAME":
            return _NULL
        if (of_fdat := _OF_FDAT.fullmatch(text.strip())) and _word(of_fdat[1]) in self.fdat:
            return self.fdat[_word(of_fdat[1])][which == b"BASE"]
        value = _aggregate(text, 0)
        if value is not None and value.is_pose:
            own = b"line %d" % line.number
            self.frames[which, own] = _frame(value.numbers)
            return own
        self.bases |= {name.upper(): line.number for name in _WORDS.findall(re.sub(rb"\{[^{}]*\}", b"", text))}
        return b"EK" if re.match(rb"(?i)\s*EK\s*\(", text) else _word(text)

    def _move(
        self, line: _Line, moved: re.Match[bytes], frames: _Frames, *, is_own: bool, follows: bool, obstacle: str
    ) -> None:
        word, at = moved[1].upper(), 0
        for _ in range(2 if b"CIRC" in word else 1):
            goal = _GOAL.match(moved[2], at)
            assert goal is not None  # it may be empty
            at = goal.end() + (moved[2][goal.end() : goal.end() + 1] == b",")
            text = goal[1]
            name = _word(text)
            is_factor = text[:1] == b"{" and moved[2][goal.end() :].lstrip()[:1] == b":"
            if is_factor:
                self.factors |= {one.upper(): line.number for one in _WORDS.findall(moved[2][goal.end() :])}
            elif b":" in text and text[:1] != b"{":
                self.factors |= {one.upper(): line.number for one in _WORDS.findall(text)}
            elif name and re.fullmatch(_NAME, text.strip()):
                if word.endswith(b"_REL"):
                    self.increments[name.partition(b"[")[0]] = line.number
                else:
                    self.uses[name].setdefault(frames, line.number)
            if b"[" in name:
                self.indexed.add(name.partition(b"[")[0])
            if not is_own:
                continue
            key: bytes | int | None = None
            shown = f"{word.decode()} {_text(text)}"
            if word.endswith(b"_REL"):
                self.left.append(LeftAlone(line.number, shown, "its numbers are increments"))
            elif text[:1] == b"{" and is_factor:
                self.left.append(LeftAlone(line.number, shown, "the program computes it"))
            elif text[:1] == b"{":
                value = _aggregate(text, line.start + moved.start(2) + goal.start(1))
                key = self._add(None, f"{word.decode()} in line {line.number}", line.number, value, frames)
            elif not re.fullmatch(_NAME, text.strip()):
                self.left.append(LeftAlone(line.number, shown, "the program computes it"))
            else:
                key = name
            passing: Passing | str = obstacle or WRITTEN_OTHERWISE
            after = re.sub(rb"(?i)\s*C_\w+(?=\s|$)", b"", moved[2][goal.end() :]).strip()
            if not obstacle and word == b"LIN" and not after:
                indent = line.code[: moved.start(1)]
                passing = Passing(line.start, indent + moved[1] + b" ", line_end_of(self.data), 0)
            kind, is_certain = _MOVES.get(word.removesuffix(b"_REL"), "joint"), word in (b"PTP", b"LIN", b"CIRC")
            self.moves.append((Move(line.number, kind, None, follows, passing, is_certain), key))
            follows = True

    def _value(self, line: _Line, given: re.Match[bytes]) -> None:
        """A value that is given to a name: a target, if the name is one."""
        word = _word(given[1])
        base = word.partition(b"[")[0]
        kind = self.types.get(base)
        is_target = kind in _TARGETS or word in self.uses or (kind is None and base in self.uses)
        name = _text(given[1])
        text = given[3]
        value = _aggregate(text, line.start + given.start(3))
        if not is_target:
            looks = value is not None and (set(_POSE[:3]) <= set(value.numbers) or set(_JOINTS) <= set(value.numbers))
            if looks and kind is None and not base.startswith(b"$") and not _DATA.fullmatch(given[1]):
                self.left.append(LeftAlone(line.number, name, "its type is not declared in this file"))
            return
        if base in self.increments:
            self.left.append(LeftAlone(line.number, name, f"increments of the move in line {self.increments[base]}"))
        elif base in self.bases:
            self.left.append(LeftAlone(line.number, name, f"a tool or base is set from it in line {self.bases[base]}"))
        elif base in self.factors and word not in self.uses:
            reason = f"a frame or an offset: poses are computed with it in line {self.factors[base]}"
            self.left.append(LeftAlone(line.number, name, reason))
        elif given[2]:
            self.left.append(LeftAlone(line.number, _text(given[1] + given[2]), "the program computes it"))
        elif text.lstrip()[:1] != b"{":
            self.left.append(LeftAlone(line.number, name, "the program computes it"))
        else:
            self._add(word, name, line.number, value, (None, None))

    def _add(self, word: bytes | None, name: str, line: int, value: _Value | None, frames: _Frames) -> int | None:
        if value is None or value.has_more:
            self.left.append(LeftAlone(line, name, "some of its numbers are not literal"))
            return None
        self.found.append((word, name, line, value, frames))
        return len(self.found) - 1

    def _target(self, word: bytes | None, name: str, line: int, value: _Value, frames: _Frames) -> Target | str:
        numbers, stated = value.numbers, {frames} if word is None else set(self.uses[word])
        made = partial(Target, name, line, span=value.span, external=value.external)
        part = self.parts.get(word or b"") or self.parts.get((word or b"").partition(b"[")[0])
        if part is not None:
            return f"its {part[0]} is overwritten in line {part[1]}"
        taught = None if word is None or not word.startswith(b"X") else self.fdat.get(b"F" + word[1:])
        if taught is not None and not stated - {(None, None)}:
            stated = {taught}
        stated = stated or {(None, None)}
        if any(name in numbers for name in _JOINTS):
            if not set(_JOINTS) <= set(numbers):
                return "some of A1 to A6 are missing: those keep the last value"
            joints = np.radians([numbers[axis].value for axis in _JOINTS])
            frame = self._frame(b"TOOL", stated.pop()[0])[0] if len(stated) == 1 else None
            return made(_only(numbers, _JOINTS), joints=joints, T_flange_tool=frame)
        if len(stated) > 1:
            return "it is used with several tools or bases: one target cannot have two corrections"
        tool, base = stated.pop()
        if not set(_POSE) <= set(numbers):
            return "some of X, Y, Z, A, B, C are missing: those keep the last value"
        conditions: tuple[Condition, ...] = ()
        if self.is_accurate and not ("S" in numbers and (_whole(numbers["S"].text) or 0) & 16):
            return "of an absolutely accurate robot by other points (bit 4 of S), whose controller corrects already"
        if {"S", "T"} <= set(numbers):
            status, turn = (_whole(numbers[one].text) for one in "ST")
            if status is None or turn is None or status & 8 or not 0 <= turn < 64 or status > 31:
                return "its S and T are none of a six-axis arm"
            if status & 16:
                return "it was taught with an absolutely accurate robot (bit 4 of S), whose controller corrects already"
            conditions = _conditions(status, turn)
        frames_found = [self._frame(b"TOOL", tool), self._frame(b"BASE", base)]
        if base in self.machines and (b"BASE", base) in self.frames and (b"BASE", base) not in self.changed:
            machine, moving = _text(self.machines[base]), self.frames[b"BASE", base]
            carried = self.beside.frames.carried(machine, value.external, moving)
            lacking = (None, f"{frames_found[1][1]}: {carried}")
            frames_found[1] = lacking if isinstance(carried, str) else (carried, "")
        lacks = next((why for frame, why in frames_found if frame is None), None)
        if lacks is not None:
            return lacks
        pose, (T_tool, T_work) = _frame(numbers), (frame for frame, _ in frames_found)
        kept = _only(numbers, (*_POSE, "S", "T"))
        return made(kept, pose=pose, T_flange_tool=T_tool, T_base_work=T_work, conditions=conditions)

    def _frame(self, which: bytes, number: bytes | None) -> tuple[FloatArray | None, str]:
        """A tool in the flange, or a base in the base of the arm; or what is to be stated."""
        frames, what = self.beside.frames, which.decode().lower()
        find = frames.tool_of if which == b"TOOL" else frames.work_of
        if number in _REASONS:
            return None, _REASONS[number].format(what=what)
        if number and number.startswith(_SEVERAL):
            caller = f"{_text(number[1:])}() may set its {what}, and its file is not beside this one"
            return find(None), f"{caller}: state {what if which == b'TOOL' else 'work'} in --frames"
        if which == b"BASE" and number in self.machines:
            return (
                None,
                f"BASE_DATA[{_text(number)}] moves with machine {_text(self.machines[number])} (MACHINE_FRAME_DAT)",
            )
        if (which, number) in self.changed:
            return None, f"{_text(which + b'_DATA[' + (number or b''))}] changes while the program runs"
        motion = np.eye(4) if number == _NULL else self.frames.get((which, number or b""))
        if motion is not None:
            motion = motion if which == b"TOOL" else frames.in_base(motion)
            check = frames.check_tool if which == b"TOOL" else frames.check_work
            if number and number.isdigit() and number != _NULL:
                check(number.decode(), motion)
            return motion, ""
        name = None if number is None else number.decode("latin-1")
        stated = find(name)
        numbered = name if name is None or not name.isdigit() else f"{which.decode()}_DATA[{name}]"
        lacks = f"its {what} is not stated" if name is None else f"{numbered} is not in this program"
        return stated, f"{lacks}: state it in --frames"


def _lines(data: bytes) -> Iterator[_Line]:
    for number, match in enumerate(_LINE.finditer(data, text_start(data)), 1):
        text = match[0].rstrip(b"\r\n")
        code = _CODE.match(text)
        assert code is not None  # it may be empty
        if code[0].count(b"{") > code[0].count(b"}"):
            raise InputError("a bracket { is not closed", line=number)
        if match[0]:
            yield _Line(number, match.start(), b"" if text.lstrip()[:1] == b"&" else code[0])


def _names_of(files: Iterable[Iterable[_Line]]) -> set[bytes]:
    """Subprograms that files define."""
    return {begins[1].upper() for lines in files for line in lines if (begins := _BEGINS.match(line.code))}


def _setters(files: Iterable[list[_Line]], unknown: set[bytes]) -> set[bytes]:
    """Subprograms that set a tool or base, themselves or by what they call, or call what may set one."""
    setters: set[bytes] = set()
    calls: defaultdict[bytes, set[bytes]] = defaultdict(set)
    for lines in files:
        name = b""
        for line in lines:
            if begins := _BEGINS.match(line.code):
                name = begins[1].upper()
            elif _SETS.match(line.code):
                setters.add(name)
            elif call := _CALL.match(line.code):
                calls[name].add(call[1].upper())
    while more := {name for name, called in calls.items() if name not in setters and called & (setters | unknown)}:
        setters |= more
    return setters - {b"BAS"}


def _loops(lines: list[_Line]) -> dict[int, int]:
    """The loops of a file: the numbers of their first and last lines in the list."""
    opened, found = [], {}
    for at, line in enumerate(lines):
        if loop := _LOOP.match(line.code):
            if loop[1].upper() in (b"LOOP", b"FOR", b"WHILE", b"REPEAT"):
                opened.append(at)
            elif opened and len(opened) <= _DEEPEST:
                found[opened.pop()] = at
            elif opened:
                opened.pop()
    return found


def _either(number: bytes | None, other: bytes | None) -> bytes | None:
    """A tool or base after two branches; a subprogram that may set it leaves open whether it does."""
    if number == other:
        return number
    opened = [one for one in (number, other) if one is not None and one.startswith(_SEVERAL)]
    return opened[0] if opened and _SEVERAL not in opened else _SEVERAL


def _is_accurate(status: bytes) -> bool:
    """Whether S of a point says that an absolutely accurate robot was taught it."""
    number = _whole(status) if re.fullmatch(rb"\d{1,6}|'[BbHh][0-9A-Fa-f]{1,16}'", status) else None
    return number is not None and number < 32 and bool(number & 16)


def _branched(word: bytes, state: _State, branches: list[_Branches]) -> _State:
    """What holds after a line that begins, changes or ends a branch."""
    if word in (b"IF", b"SWITCH"):
        branches.append(_Branches(state, [] if word == b"IF" else None))
        return state
    if not branches:
        return state
    now = branches.pop()
    after = [] if now.after is None else [*now.after, state]
    if word in (b"ENDIF", b"ENDSWITCH"):
        for one in after if now.has_all else [*after, now.before]:
            state = state.either(one)
        return state
    branches.append(_Branches(now.before, after, now.has_all or word in (b"ELSE", b"DEFAULT")))
    return now.before


def _read_any(folder: Path, name: str) -> Iterator[bytes]:
    """A file of a folder, whatever the case of its name."""
    if folder.is_dir():
        for file in sorted(folder.iterdir()):
            if file.name.lower() == name.lower() and file.is_file():
                yield read_limited(file, limit_bytes=MAX_BYTES)
                return


def _given(code: bytes) -> re.Match[bytes] | None:
    """A name, its component and the value that a line gives it; a declaration's type is skipped."""
    declared = _DECLARED.fullmatch(code)
    return _GIVEN.fullmatch(code, declared.start(2)) if declared else _GIVEN.fullmatch(code)


def _aggregate(text: bytes, start: int) -> _Value | None:
    """The numbers of ``{X 1, Y 2}`` with their places; None where it is none."""
    match = _AGGREGATE.match(text.lstrip())
    if match is None:
        return None
    first = start + len(text) - len(text.lstrip())
    at = first + match.start(1)
    numbers, has_more = {}, False
    for part in match[1].split(b","):
        field = _FIELD.fullmatch(part)
        if field is None:
            has_more = True
        else:
            name = field[1].decode().upper()
            # Twice, too large, or bits where a length or an angle is expected.
            has_more |= name in numbers or (name not in ("S", "T") if field[2][:1] == b"'" else isinf(float(field[2])))
            numbers[name] = Number(at + field.start(2), at + field.end(2), field[2])
        at += len(part) + 1
    return _Value(numbers, has_more, (first + match.start(), first + match.end()))


def _frame(numbers: Mapping[str, Number]) -> FloatArray:
    x, y, z, a, b, c = (numbers[name].value for name in _POSE)
    return motion(rotation_of((c, b, a)), [x, y, z])


def _only(numbers: Mapping[str, Number], names: Iterable[str]) -> dict[str, Number]:
    return {name: numbers[name] for name in names if name in numbers}


def _conditions(status: int, turn: int) -> tuple[Condition, ...]:
    signs = [Condition.sign(f"J{i}", negative=turn >> (i - 1) & 1) for i in range(1, 7)]
    if bool(status & 4) != bool(turn & 16):  # no joint is both
        signs[4] = Condition("J5", inf, -inf)
    return (*signs, Condition.sign("shoulder", negative=status & 1), Condition.sign("elbow", negative=not status & 2))


def _whole(text: bytes) -> int | None:
    """A whole number: 22, or as bits 'B10110' or 'H16'."""
    if text[:1] == b"'":
        return int(text[2:-1], 2 if text[1:2].upper() == b"B" else 16) if _is_of_base(text) else None
    value = float(text)
    return int(value) if value == int(value) else None


def _is_of_base(text: bytes) -> bool:
    return text[1:2].upper() == b"H" or not set(text[2:-1]) - set(b"01")


def _as_before(text: bytes, value: int) -> bytes:
    """A whole number in the notation of another."""
    if text[:1] != b"'":
        return b"%d" % value
    form = f"{value:0{len(text) - 3}b}" if text[1:2].upper() == b"B" else f"{value:0{len(text) - 3}X}"
    return text[:2] + form.encode("ascii") + b"'"


def _word(text: bytes) -> bytes:
    """A name as it is compared: without blanks, the case does not count."""
    return re.sub(rb"\s", b"", text).upper()


def _text(text: bytes) -> str:
    """Bytes as a message shows them."""
    return " ".join(text.decode("latin-1").split())[:60]
