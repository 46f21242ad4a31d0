"""ABB RAPID: targets of modules (``.mod``, ``.prg``, ``.sys`` and their RobotWare 7 forms).

A pose is ``[[x, y, z], [q1, q2, q3, q4], [cf1, cf4, cf6, cfx], [six external axes]]`` in mm in the object frame of its
work object, q1 the scalar part; joints are in deg. cf1, cf4 and cf6 are the quadrants of the joints, cfx has one bit
each for the wrist centre behind axis 1 (4), behind the lower arm (2), and a negative joint 5 (1).
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise, takewhile
from math import floor, hypot
from typing import NamedTuple, TypeAlias

import numpy as np

from truearm.arm.rigid_motions import motion
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.programs.numbers import NOT_THERE, Number, quaternion_of, rotation_of_quaternion
from truearm.wings.exports.programs.program import (
    WRITTEN_OTHERWISE,
    Condition,
    Language,
    LeftAlone,
    Lines,
    Move,
    MoveKind,
    NamedTarget,
    NamedTargets,
    Passing,
    Program,
    Surroundings,
    Target,
    line_end_of,
    text_start,
)
from truearm.wings.exports.targets.edits import Edit

_TOKEN = re.compile(
    rb'(?P<comment>![^\r\n]*)|(?P<string>"(?:[^"\r\n]|"")*")|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)'
    rb"|(?P<name>[A-Za-z_\x80-\xff][\w\x80-\xff]*)|(?P<literal>\[[\s\d.,eE+\-\[\]]*\])|(?P<sign>:=|[^\s])"
)
_IN_LITERAL = re.compile(rb"[\[\]]|[+-]?[ \t]*(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_SUM = re.compile(rb"[\d.]\s*[+-]")
# Instructions with targets: their places among the arguments that have no backslash, and how the arm moves.
_MOVES: dict[bytes, tuple[tuple[int, ...], MoveKind]] = {
    **dict.fromkeys(
        b"movej moveabsj movejdo movejao movejgo movejsync triggj spotj triggjios arcmovej".split(), ((0,), "joint")
    ),
    **dict.fromkeys(
        b"movel moveldo movelao movelgo movelsync triggl trigglios spotl arcl arclstart arclend arcmovel displ capl "
        b"paintl".split(),
        ((0,), "linear"),
    ),
    **dict.fromkeys(
        b"movec movecdo movecao movecgo movecsync triggc arcc arccstart arccend arcmovec dispc capc paintc".split(),
        ((0, 1), "circular"),
    ),
    b"searchl": ((2,), "linear"),
    b"searchc": ((2, 3), "circular"),
}
_SHIFTS = (
    *(b"pdispon", b"pdispset", b"eoffson", b"eoffsset", b"corrcon", b"egmrunpose", b"egmrunjoint", b"waitwobj"),
    *(b"softact", b"egmmovel", b"egmmovec"),
)
# Of these, a signal or a procedure stands behind the tool, which is the third after the last target.
_FOLLOWED = (b"do", b"ao", b"go", b"sync")
# Instructions that do not move the arm: what stands between two moves besides them may bring it from elsewhere.
_STILL = frozenset(
    b"setdo set reset setgo setao pulsedo waittime waitdi waitdo waituntil confl confj singarea accset velset gripload "
    b"tpwrite tperase incr decr add clear const pers var local".split()
)
# Instructions that switch the check of configurations off, and the moves for which it is.
_MONITORS: dict[bytes, tuple[MoveKind, ...]] = {b"confl": ("linear", "circular"), b"confj": ("joint",)}
# Words after which a statement begins, and those that begin none that is a call.
_BEGINS = frozenset(b") then do else endif endfor endwhile endtest".split())
_NO_CALL = _STILL | _BEGINS | frozenset(b"module proc func trap endproc if elseif for while test case return".split())
# Moves after which the arm stands at their target; a search, for one, ends elsewhere.
_PLAIN = (b"movej", b"moveabsj", b"movel", b"movec")
_ZONES = (b"wzhomejointdef", b"wzlimjointdef")
_SHAPES = {b"robtarget": (3, 4, 4, 6), b"jointtarget": (6, 6)}
_FRAMES = (b"tooldata", b"wobjdata")
_PARTS = {
    b"robtarget": ("x", "y", "z", "q1", "q2", "q3", "q4", "cf1", "cf4", "cf6", "cfx"),
    b"jointtarget": tuple(f"j{i}" for i in range(1, 7)),
}
_UNIT = 1e-2  # quaternions that controllers write have a length of 1 within 1e-3
_QUADRANT = 90.0
_WIDE_MM = 10.0  # a zone of 5 mm ends before the middle


class _Token(NamedTuple):
    kind: str
    start: int
    end: int
    text: bytes
    word: bytes  # of a keyword or name: the case does not count


@dataclass(frozen=True)
class _List:
    """An aggregate; an item is a number, another aggregate, or the words of an expression."""

    items: tuple[_Value, ...]
    start: int
    end: int


_Value: TypeAlias = Number | _List | bytes


# Tool and work object of the moves that use a target, with the line of the first.
_Uses: TypeAlias = "dict[tuple[bytes, bytes], int]"

# A frame, or None and what is to be stated.
_Frame: TypeAlias = "tuple[FloatArray | None, str]"


class _Found(NamedTuple):
    """A literal target; its uses are complete when the whole module is read."""

    kind: bytes
    name: str
    line: int
    numbers: dict[str, Number]
    uses: _Uses
    span: tuple[int, int]
    external: tuple[Number, ...]


class Rapid(Language):
    """See the module."""

    title = "ABB RAPID"
    endings = (".mod", ".prg", ".sys", ".modx", ".sysx")
    comment = b"! "
    heading = rb"(?im)^(?:\xef\xbb\xbf)?[ \t]*MODULE[ \t]+[^\r\n]*(?:\r\n|\n|\r)"

    def recognises(self, data: bytes) -> bool:
        """See `Language`."""
        return _is_encoded(data) or bool(
            re.search(rb"(?im)^[ \t]*MODULE[ \t]+\w+|^[^!\r\n]*\b(?:CONST|PERS|VAR)[ \t]+(?:rob|joint)target\b", data)
        )

    def read(self, data: bytes, beside: Surroundings) -> Program:
        """See `Language`."""
        if _is_encoded(data):
            raise InputError("the module is encoded", hint="save it as text: the original, not encoded module")
        return _Module(data, beside).program()

    def values(self, target: Target, joints: FloatArray, pose: FloatArray | None) -> Mapping[str, float]:
        """See `Language`."""
        if target.joints is not None:
            return {f"j{i}": float(q) for i, q in enumerate(np.degrees(joints), 1)}
        assert pose is not None  # of a Cartesian target
        q = quaternion_of(pose[:3, :3], [target.numbers[f"q{i}"].value for i in range(1, 5)])
        return dict(zip(_PARTS[b"robtarget"], (*pose[:3, 3].tolist(), *q), strict=False))

    def configuration(self, target: Target, quantities: Mapping[str, float]) -> Iterable[Edit]:
        """See `Language`."""
        stated = {f"cf{i}": floor(quantities[f"J{i}"] / _QUADRANT) for i in (1, 4, 6)}
        bits = (quantities["shoulder"] < 0, quantities["elbow"] < 0, quantities["J5"] < 0)
        stated["cfx"] = 4 * bits[0] + 2 * bits[1] + bits[2]
        for name, value in stated.items():
            number = target.numbers[name]
            if value != number.value:
                yield Edit(number.start, number.end, b"%d" % value)

    def zone(self, spacing_mm: float) -> bytes:
        """See `Language`; the controller shortens zones that overlap."""
        return b"z5" if spacing_mm >= _WIDE_MM else b"z1"


def _is_encoded(data: bytes) -> bool:
    return data[:1] in (b"\xfc", b"\xfe") and data[:2] != b"\xfe\xff" and b"\x00" in data


class _Module(NamedTargets):
    """A module while it is read."""

    def __init__(self, data: bytes, beside: Surroundings) -> None:
        super().__init__(data, beside)
        self.line_of = Lines(data)
        self.tokens = list(_tokens(data))
        self.found: list[_Found] = []
        self.declared: dict[bytes, bytes] = {}
        self.frames: dict[bytes, tuple[bytes, _List | None, int]] = {}
        self.several: set[bytes] = set()
        self.zones: dict[bytes, int] = {}
        self.parts: dict[str, tuple[str, int]] = {}
        self.records: dict[bytes, list[bytes]] = {}
        self.uses: defaultdict[bytes, _Uses] = defaultdict(dict)
        self.follows = False
        self.shifted = ""
        self.passed: dict[bytes, int] = {}
        self.external: list[list[float]] = []
        self.units: dict[bytes, tuple[str, FloatArray]] = {}
        self.resolved: dict[tuple[str, bytes], _Frame] = {}

    def program(self) -> Program:
        """Read it all."""
        self._check_ends()
        at = 0
        while at < len(self.tokens):
            at = self._statement(at)
        named = [
            NamedTarget(one.name.encode("latin-1").lower(), one.name, one.line, self._target(one), bool(one.uses))
            for one in self.found
        ]
        corrected = {one.key: one.name for one in named if isinstance(one.made, Target) and one.is_reached}
        self.notes += (
            f"{corrected[name]} is passed to {_text(self.tokens[at].text)} in line {self._line(at)}: it has the "
            "correction of its own moves."
            for name, at in self.passed.items()
            if name in corrected
        )
        program = self.of(named, self.external)
        off = {kind for word, kinds in _MONITORS.items() if self._is_off(word) for kind in kinds}
        watched = {move.target for move in program.moves if move.kind not in off}
        return replace(program, unwatched=frozenset(range(len(program.targets))) - watched if off else frozenset())

    def _is_off(self, word: bytes) -> bool:
        """Whether the module switches the check of configurations off, and never on."""
        following = zip(self.tokens, self.tokens[1:], self.tokens[2:], strict=False)
        return {last.word for first, _, last in following if first.word == word} == {b"off"}

    def settled(self, move: Move, goal: bytes | int | None) -> Move:
        """See `NamedTargets`: what is known when the whole module is read."""
        is_certain = move.is_certain and (isinstance(goal, int) or goal in self.constants)
        passing = self.shifted or move.passing
        return move._replace(is_certain=is_certain, passing=passing)

    @cached_property
    def constants(self) -> set[bytes]:
        """Names that the module declares once, as constants, and never as a parameter or another thing."""
        declared: Counter[bytes] = Counter()
        fixed = set()
        for before, kind, name in zip(self.tokens, self.tokens[1:], self.tokens[2:], strict=False):
            if name.kind == kind.kind == "name" and kind.word not in _MOVES:
                declared[name.word] += 1
                if before.word == b"const":
                    fixed.add(name.word)
        given = Counter(token.word for token, follows in pairwise(self.tokens) if follows.text == b":=")
        return {name for name in fixed if declared[name] == given[name] == 1}

    def _check_ends(self) -> None:
        words = [token.word for token in self.tokens if token.kind == "name"]
        if words.count(b"module") != words.count(b"endmodule"):
            raise InputError("the module has no ENDMODULE: it is cut off", line=self.line_of(len(self.data)))

    def _line(self, at: int) -> int:
        return self.line_of(self.tokens[at].start)

    def _end(self, at: int, word: bytes = b";") -> int:
        """The next token that is a word, from one on; behind the last one where there is none."""
        return next((i for i in range(at, len(self.tokens)) if self.tokens[i].word == word), len(self.tokens))

    def _statement(self, at: int) -> int:
        """Read what begins at a token; returns where the next begins."""
        token = self.tokens[at]
        is_first = at == 0 or self.tokens[at - 1].text == b";"
        if token.kind != "name":
            self.follows &= not is_first  # a procedure whose name is computed
            return at + 1
        follows = self.tokens[at + 1] if at + 1 < len(self.tokens) else token
        if token.word == b"record":
            return self._record(at)
        if token.word in (b"const", b"pers", b"var"):
            return self._declaration(at)
        if token.word in _MOVES and follows.text not in (b":=", b"("):
            return self._move(at)
        if is_first and not self._is_still(at):
            self.follows = False
        if token.word in self.names_of_frames and self._assigned(at):
            self.shifted = "its tool or work object changes while the program runs"
            self.notes.append(
                f"{_text(token.text)} is changed in line {self._line(at)} while the program runs: the corrections are "
                "those with its value in the declaration."
            )
        if token.word in _ZONES:
            arguments, _ = self._arguments(at + 1)
            self.zones |= {self.tokens[part[0][1] - 1].word: self._line(at) for part in arguments if part[0][1]}
        if token.word in _SHIFTS:
            self.shifted = "targets are shifted while the program runs"
            self.notes.append(
                f"{token.text.decode('latin-1')} in line {self._line(at)} shifts targets while the program runs: the "
                "corrections are those of the places without it."
            )
        is_call = (is_first or self.tokens[at - 1].word in _BEGINS) and token.word not in {*_NO_CALL, *_ZONES}
        if is_call and not self._assigned(at):
            for before, one in pairwise(self.tokens[at : self._end(at)]):
                if one.kind == "name" and (before is token or before.text == b","):
                    self.passed.setdefault(one.word, at)
        if self.declared.get(token.word) in _SHAPES and (begins := self._assigned(at)):
            return self._assignment(at, begins)
        return at + 1

    def _is_still(self, at: int) -> bool:
        """Whether a statement certainly moves no arm: a value may be that of a function which does."""
        begins = self._assigned(at)
        return self.tokens[at].word in _STILL or (
            begins is not None and all(one.text != b"(" for one in self.tokens[begins : self._end(begins)])
        )

    def _is_conditional(self, at: int) -> bool:
        """Whether a statement is that of an IF without a THEN."""
        before = takewhile(lambda one: one.text != b";", map(self.tokens.__getitem__, range(at - 1, -1, -1)))
        return next((token.word for token in before if token.word in (b"if", b"then")), b"") == b"if"

    def _assigned(self, at: int) -> int | None:
        """Where the value begins that a statement gives to a name, or to a part of it."""
        i, depth = at + 1, 0
        while i < len(self.tokens) and self.tokens[i].text != b";":
            depth += {b"{": 1, b"}": -1}.get(self.tokens[i].text, 0)
            if depth == 0 and self.tokens[i].text == b":=":
                return i + 1
            if depth == 0 and self.tokens[i].text not in (b".", b"}") and self.tokens[i].kind != "name":
                return None
            i += 1
        return None

    def _assignment(self, at: int, begins: int) -> int:
        name, kind = self.tokens[at], self.declared[self.tokens[at].word]
        whole = self.tokens[at + 1].text == b":="
        value, end = self._value(begins)
        text, line = _text(self.data[name.start : self.tokens[begins - 1].start]), self._line(at)
        part = re.fullmatch(r"([^.]*?)(\{[^}]*\})?\.(?!extax)(\w.*)", text.replace(" ", "").lower())
        if part:
            element = part[2] if re.fullmatch(r"\{[\d,]+\}", part[2] or "") else ""
            self.parts.setdefault(part[1] + element, (part[3], line))
        if not whole or isinstance(value, bytes):
            self.left.append(LeftAlone(line, text, "the program computes it"))
        else:
            self._found(kind, text, line, value, self.uses[name.word])
        return end

    def _record(self, at: int) -> int:
        """The types of the components of a record."""
        end = self._end(at, b"endrecord")
        words = [token.word for token in self.tokens[at + 2 : end] if token.kind == "name"]
        self.records[self.tokens[at + 1].word] = words[::2]
        return end + 1

    def _declaration(self, at: int) -> int:
        kind, name = self.tokens[at + 1 : at + 3] if at + 2 < len(self.tokens) else (self.tokens[at],) * 2
        if kind.kind != "name" or name.kind != "name":
            return at + 1
        i, depth = at + 3, 0
        while i < len(self.tokens) and self.tokens[i].text not in (b":=", b";", b")", b"|", b"\\"):
            depth += {b"{": 1, b"}": -1}.get(self.tokens[i].text, 0)
            if self.tokens[i].text == b"," and not depth:
                break  # a parameter: the next one follows
            i += 1
        value: _List | bytes = b""
        if i < len(self.tokens) and self.tokens[i].text == b":=":
            value, i = self._value(i + 1)
        line = self._line(at)
        if kind.word in _FRAMES:
            frame = value if isinstance(value, _List) else None
            if name.word in self.frames and not _are_same(self.frames[name.word][1], frame):
                self.several.add(name.word)
            self.frames[name.word] = (kind.word, frame, line)
        elif kind.word in _SHAPES or kind.word in self.records:
            self.declared[name.word] = kind.word
            if value:
                self._typed(kind.word, name, value, line)
        elif isinstance(value, _List) and any(self._lookalikes(value)):
            reason = f"the type {kind.text.decode('latin-1')} is not declared in this module"
            self.left.append(LeftAlone(line, _text(name.text), reason))
        return i

    def _typed(self, kind: bytes, name: _Token, value: _List | bytes, line: int) -> None:
        """Targets in a value of a known type: one, an array, or components of a record."""
        text = _text(name.text)
        if not isinstance(value, _List):
            self.left.append(LeftAlone(line, text, "its value is an expression"))
            return
        for path, of_kind, part in self._parts(kind, value):
            self._found(of_kind, text + path, line, part, self.uses[name.word])

    def _parts(self, kind: bytes, value: _Value) -> Iterator[tuple[str, bytes, _Value]]:
        """Targets within a value of a type, each with its place and its own type."""
        components = self.records.get(kind)
        if isinstance(value, _List) and _depth(value) > self._depth_of(kind):  # an array
            within = [(f"{{{i}}}", kind, item) for i, item in enumerate(value.items, 1)]
        elif isinstance(value, _List) and components is not None:
            all_parts = zip(components, value.items, strict=False)
            kinds = _SHAPES.keys() | self.records.keys()
            within = [(f".{i}", one, item) for i, (one, item) in enumerate(all_parts, 1) if one in kinds]
        else:
            yield "", kind, value
            return
        for place, of_kind, item in within:
            for path, of_part, part in self._parts(of_kind, item):
                yield place + path, of_part, part

    def _depth_of(self, kind: bytes) -> int:
        if kind in _SHAPES:
            return 2
        return 1 + max((self._depth_of(one) for one in self.records.get(kind, []) if one != kind), default=0)

    def _lookalikes(self, value: _List) -> Iterator[_List]:
        for item in (value, *value.items):
            if isinstance(item, _List):
                if any(self._is_literal(item, shape) for shape in _SHAPES.values()):
                    yield item
                elif item is not value:
                    yield from self._lookalikes(item)

    @staticmethod
    def _is_literal(value: _List, shape: tuple[int, ...]) -> bool:
        return len(value.items) == len(shape) and all(
            isinstance(item, _List) and len(item.items) == n and all(isinstance(one, Number) for one in item.items)
            for item, n in zip(value.items, shape, strict=True)
        )

    def _found(self, kind: bytes, name: str, line: int, value: _Value, uses: _Uses) -> int | None:
        """Add a target if all its numbers are literal; returns its number."""
        if not isinstance(value, _List) or kind not in _SHAPES or not self._is_literal(value, _SHAPES[kind]):
            self.left.append(self._no_target(kind, name, line, value))
            return None
        flat = [one for item in value.items if isinstance(item, _List) for one in item.items]
        numbers = {part: one for part, one in zip(_PARTS[kind], flat, strict=False) if isinstance(one, Number)}
        self.external.append([one.value for one in flat[-6:] if isinstance(one, Number)])
        external = tuple(one for one in flat[-6:] if isinstance(one, Number))
        self.found.append(
            _Found(kind, name, self.line_of(value.start), numbers, uses, (value.start, value.end), external)
        )
        return len(self.found) - 1

    def _no_target(self, kind: bytes, name: str, line: int, value: _Value) -> LeftAlone:
        """What is listed instead of a target: one that is computed, or one in which something is wrong."""
        if not isinstance(value, _List) or kind not in _SHAPES:
            return LeftAlone(line, name, "some of its numbers are not literal")
        parts = [item.items if isinstance(item, _List) else (item,) for item in value.items]
        for text in (one for part in parts for one in part if isinstance(one, bytes)):
            word = text.partition(b".")[0].strip().lower()
            if not word.isalnum() or word in self.names or word in self.number_names:
                return LeftAlone(line, name, "some of its numbers are not literal")
            return LeftAlone(line, name, f"not literal: {_text(text)} is no number of this module", is_literal=True)
        if _SUM.search(self.data[value.start : value.end]):
            return LeftAlone(line, name, "some of its numbers are not literal")
        expected, got = (" + ".join(map(str, one)) for one in (_SHAPES[kind], map(len, parts)))
        reason = f"expected {expected} numbers, got {got}"
        return LeftAlone(line, name, reason, is_literal=True)

    @cached_property
    def number_names(self) -> set[bytes]:
        """Names of numbers, parameters included."""
        return {name.word for kind, name in pairwise(self.tokens) if kind.word in (b"num", b"dnum")}

    def _value(self, at: int) -> tuple[_List | bytes, int]:
        """A value up to its semicolon, and the token after it."""
        if at < len(self.tokens) and self.tokens[at].text[:1] == b"[":
            value, end = self._list(at)
            if end < len(self.tokens) and self.tokens[end].text == b";":
                return value, end + 1
        end = self._end(at)
        if end == len(self.tokens):
            raise InputError("a statement has no end: the program is cut off", line=self._line(min(at, end - 1)))
        return self.data[self.tokens[at].start : self.tokens[end].start], end + 1

    def _list(self, at: int) -> tuple[_List, int]:
        """The aggregate that begins at a token, and the token after it."""
        if self.tokens[at].kind == "literal":
            return _literal(self.tokens[at]), at + 1
        items: list[_Value] = []
        i = at + 1
        while i < len(self.tokens):
            token = self.tokens[i]
            if token.text[:1] == b"[":
                item, i = self._list(i)
                items.append(item)
            elif token.text == b"]":
                return _List(tuple(items), self.tokens[at].start, token.end), i + 1
            elif token.text == b",":
                i += 1
            else:
                first, depth = i, 0
                while i < len(self.tokens) and (depth or self.tokens[i].text not in (b",", b"]")):
                    if self.tokens[i].text == b";":
                        break
                    depth += {b"(": 1, b")": -1, b"[": 1, b"]": -1, b"{": 1, b"}": -1}.get(self.tokens[i].text, 0)
                    i += 1
                items.append(self._item(first, i))
                if i < len(self.tokens) and self.tokens[i].text == b";":
                    break
        raise InputError("a bracket [ is not closed", line=self._line(at))

    def _item(self, first: int, end: int) -> Number | bytes:
        """A number with its sign, or the words of an expression."""
        start, stop = self.tokens[first].start, self.tokens[end - 1].end
        signed = end - first == 2 and self.tokens[first].text in (b"-", b"+")
        text = self.data[start:stop]
        if self.tokens[end - 1].kind == "number" and (end - first == 1 or signed) and not set(text) & set(b"\r\n!"):
            return Number(start, stop, text)
        return text

    def _move(self, at: int) -> int:
        places, kind = _MOVES[self.tokens[at].word]
        arguments, end = self._arguments(at + 1)
        plain = [parts[0] for parts in arguments if parts[0][1] > parts[0][0]]
        line = self._line(at)
        instruction = self.tokens[at].text.decode("latin-1")
        if len(plain) <= max(places):
            self.left.append(LeftAlone(line, instruction, "it has no target yet"))
            return end
        followed = self.tokens[at].word.endswith(_FOLLOWED) and len(plain) > max(places) + 3
        begins_tool, ends_tool = plain[max(places) + 3 if followed else -1]
        tool = self.tokens[begins_tool].word if ends_tool - begins_tool == 1 else b"?"
        work = b"wobj0"
        for _, *switches in arguments:
            for first, last in switches:
                if self.tokens[first].word == b"wobj" and last - first > 2:
                    work = self.tokens[first + 2].word if last - first == 3 else b"?"
        frames = (tool, work)
        for place in places:
            first, last = plain[place]
            begins = self.tokens[first]
            goal: bytes | int | None = None
            text = _text(self.data[begins.start : self.tokens[last - 1].end])
            if begins.text[:1] == b"[":
                value, _ = self._list(first)
                shape = b"jointtarget" if self.tokens[at].word == b"moveabsj" else b"robtarget"
                goal = self._found(shape, f"{instruction} in line {line}", line, value, {frames: line})
            elif begins.kind == "name" and (last - first == 1 or self.tokens[first + 1].text in (b"{", b".")):
                self.uses[begins.word].setdefault(frames, line)
                goal = begins.word if last - first == 1 else None
                if begins.word not in self.names:
                    self.left.append(LeftAlone(line, f"{instruction} {text}", "it is declared in another module"))
            elif begins.text == b"*":
                self.left.append(LeftAlone(line, f"{instruction} *", "the target is hidden"))
            else:
                self.left.append(LeftAlone(line, f"{instruction} {text}", self._computed(first, last)))
            is_certain = self.tokens[at].word in _PLAIN
            self.moves.append(
                (Move(line, kind, None, self.follows, self._passing(at, arguments, end), is_certain), goal)
            )
            self.follows = True
        self.follows &= not self._is_conditional(at)
        return end

    def _passing(self, at: int, arguments: list[list[tuple[int, int]]], end: int) -> Passing | str:
        """How a MoveL goes through further points: with its own speed, tool and work object, but without a stop."""
        switches = {self.tokens[first].word for _, *parts in arguments for first, _ in parts}
        if self.tokens[at].word != b"movel" or len(arguments) != 4 or switches - {b"wobj", b"tload"}:
            return WRITTEN_OTHERWISE
        if b"(" in [token.text for token in self.tokens[at:end]] or self._is_conditional(at):
            return WRITTEN_OTHERWISE
        places = [(self.tokens[first].start, self.tokens[last - 1].end) for (first, last), *_ in arguments]
        start, point, zone, stop = self.tokens[at].start, places[0], places[2], self.tokens[end - 1].end
        blanks = self.data[self.line_of.start(start) : start]
        after = self.data[point[1] : zone[0]] + self.data[zone[1] : stop]
        ending = b" " if blanks.strip() else line_end_of(self.data) + blanks
        return Passing(start, self.data[start : point[0]], after + ending, zone[0] - point[1])

    @cached_property
    def names(self) -> set[bytes]:
        """Names that a declaration anywhere in the module gives to data."""
        words = [(token.word, token.kind) for token in self.tokens if token.kind in ("name", "sign")]
        after = {b"const": 2, b"pers": 2, b"var": 2, b"inout": 2, **dict.fromkeys(_SHAPES, 1)}
        return {
            words[i + after[word]][0]
            for i, (word, _) in enumerate(words)
            if word in after and i + after[word] < len(words)
        }

    @cached_property
    def names_of_frames(self) -> set[bytes]:
        """Names of tools and work objects."""
        return {follows.word for token, follows in pairwise(self.tokens) if token.word in _FRAMES}

    def _computed(self, first: int, last: int) -> str:
        within = [token for token in self.tokens[first:last] if token.kind == "name"]
        bases = [_text(token.text) for token in within if token.word in self.names]
        if not bases:
            return "the program computes it"
        return f"the program computes it from {bases[0]}: it moves as that is corrected"

    def _arguments(self, at: int) -> tuple[list[list[tuple[int, int]]], int]:
        """Arguments up to the semicolon: of each the tokens (first, last) before and after every backslash."""
        arguments, parts, depth, first, i = [], [], 0, at, at
        while i < len(self.tokens):
            text = self.tokens[i].text
            if depth == 0 and text in (b",", b";", b"\\"):
                parts.append((first, i))
                first = i + 1
                if text != b"\\":
                    arguments.append(parts)
                    parts = []
                if text == b";":
                    return arguments, i + 1
            depth += {b"(": 1, b")": -1, b"[": 1, b"]": -1, b"{": 1, b"}": -1}.get(text, 0)
            i += 1
        raise InputError("a move has no end: the program is cut off", line=self._line(at - 1))

    def _target(self, found: _Found) -> Target | str:
        kind, name, line, numbers, used, span, external = found
        values = {part: number.value for part, number in numbers.items()}
        made = partial(Target, name, line, numbers, span=span, external=external)
        if max(map(abs, values.values())) > NOT_THERE:
            return "a placeholder (9E9)"
        part = self.parts.get(name.lower()) or self.parts.get(name.lower().partition("{")[0])
        if part is not None:
            return f"its {part[0]} is overwritten in line {part[1]}"
        if kind == b"jointtarget":
            if not used and (zone := self.zones.get(name.lower().encode("latin-1"))) is not None:
                return f"of a world zone (line {zone}), and no move goes to it"
            tools = {tool for tool, _ in used}
            tool = self._resolved(self._tool, tools.pop())[0] if len(tools) == 1 else None
            joints = np.radians([values[f"j{i}"] for i in range(1, 7)])
            return made(joints=joints, T_flange_tool=tool)
        q = [values[f"q{i}"] for i in range(1, 5)]
        if not any(q):
            return "a placeholder: its quaternion is zero"
        if abs(hypot(*q) - 1) > _UNIT:
            return f"its quaternion has the length {hypot(*q):.3g}"
        if len(used) > 1:
            both = " and ".join(f"{self._spelled(tool)} in {self._spelled(work)}" for tool, work in list(used)[:2])
            return f"it is used with {both}: one target cannot have two corrections"
        stated = next(iter(used), (b"", b""))
        tool_frame, lacks = self._resolved(self._tool, stated[0])
        work_frame, lacks_work = self._resolved(self._work, stated[1])
        if stated[1] in self.units:
            unit, inner = self.units[stated[1]]
            carried = self.beside.frames.carried(unit, external, inner)
            work_frame, lacks_work = (None, f"{lacks_work}: {carried}") if isinstance(carried, str) else (carried, "")
        if tool_frame is None or work_frame is None:
            return lacks if tool_frame is None else lacks_work
        conditions = _conditions(values)
        if conditions is None:
            return "its configuration is none of a six-axis arm"
        pose = motion(rotation_of_quaternion(q), [values[axis] for axis in "xyz"])
        return made(pose=pose, T_flange_tool=tool_frame, T_base_work=work_frame, conditions=conditions)

    def _spelled(self, name: bytes) -> str:
        """A name as the module has it first."""
        return _text(next((token.text for token in self.tokens if token.word == name), name))

    def _resolved(self, find: Callable[[bytes], _Frame], name: bytes) -> _Frame:
        """A frame that is looked for once."""
        key = (find.__name__, name)
        if key not in self.resolved:
            self.resolved[key] = find(name)
        return self.resolved[key]

    def _tool(self, name: bytes) -> _Frame:
        """A tool in the flange, or what is to be stated."""
        frames, text = self.beside.frames, self._spelled(name)
        if name == b"tool0":
            return np.eye(4), ""
        if name in self.several:
            return None, f"the tool {text} is declared in several places, not with the same value"
        kind, value, _ = self.frames.get(name, (b"", None, 0))
        if kind == b"tooldata" and value is not None and len(value.items) == 3:
            held, pose = value.items[:2]
            if not isinstance(held, bytes) or held.lower() != b"true":
                return None, f"the tool {text} is stationary"
            motion = _frame(pose)
            if motion is not None:
                frames.check_tool(text, motion)
                return motion, ""
        stated = frames.tool_of(text if name else None)
        lacks = f"the tool {text} is not in this module" if name else "no move of this module uses it with a tool"
        return stated, f"{lacks}: state it in --frames"

    def _work(self, name: bytes) -> _Frame:
        """A work object in the base of the arm, or what is to be stated."""
        frames, text = self.beside.frames, self._spelled(name)
        if name == b"wobj0":
            return frames.in_base(np.eye(4)), ""
        if name in self.several:
            return None, f"the work object {text} is declared in several places, not with the same value"
        kind, value, _ = self.frames.get(name, (b"", None, 0))
        if kind == b"wobjdata" and value is not None and len(value.items) == 5:
            held, fixed, unit, user, target = value.items
            if held == b"FALSE" or (isinstance(held, bytes) and held.lower() == b"false"):
                T, inner = _frame(user), _frame(target)
                if not isinstance(fixed, bytes) or fixed.lower() != b"true":
                    name_of_unit = _text(unit).strip('"')
                    lacks = f"the work object {text} moves with the unit {name_of_unit}"
                    if T is None or inner is None or np.abs(T - np.eye(4)).max():
                        return None, f"{lacks}, and has a user frame of its own"
                    self.units[name] = (name_of_unit, inner)
                    return None, lacks
                if T is not None and inner is not None:
                    in_base = frames.in_base(T @ inner)
                    frames.check_work(text, in_base)
                    return in_base, ""
            else:
                return None, f"the work object {text} is held by the robot"
        lacks = f"the work object {text} is not in this module" if name else "no move of this module uses it"
        return frames.work_of(text if name else None), f"{lacks}: state it in --frames"


def _tokens(data: bytes) -> Iterator[_Token]:
    at = text_start(data)
    while match := _TOKEN.search(data, at):
        kind, start, at = match.lastgroup or "", match.start(), match.end()
        if kind == "sign" and match[0] == b'"':
            raise InputError("a text in quotes is not closed", line=Lines(data)(start))
        if kind == "literal":
            at = _closed(data, start, at)
            kind = kind if at > start + 1 else "sign"
        if kind != "comment":
            text = data[start:at]
            yield _Token(kind, start, at, text, text.lower() if kind == "name" else text)


def _closed(data: bytes, start: int, end: int) -> int:
    """Where the bracket at `start` is closed; one that never is, is a sign of its own."""
    opened = 0
    for match in re.finditer(rb"[\[\]]", data[start:end]):
        opened += 1 if match[0] == b"[" else -1
        if not opened:
            return start + match.end()
    return start + 1


def _literal(token: _Token) -> _List:
    """An aggregate of numbers alone."""
    stack: list[list[_Value]] = [[]]
    begins = []
    for match in _IN_LITERAL.finditer(token.text):
        text = match[0]
        if text == b"[":
            begins.append(token.start + match.start())
            stack.append([])
        elif text == b"]":
            items = tuple(stack.pop())
            stack[-1].append(_List(items, begins.pop(), token.start + match.end()))
        else:
            stack[-1].append(Number(token.start + match.start(), token.start + match.end(), text))
    value = stack[0][0]
    assert isinstance(value, _List)
    return value


def _conditions(values: Mapping[str, float]) -> tuple[Condition, ...] | None:
    """The configuration as ranges."""
    cfx = values["cfx"]
    if any(values[name] % 1 for name in ("cf1", "cf4", "cf6", "cfx")) or not 0 <= cfx <= 7:
        return None
    quadrants = ((f"J{i}", values[f"cf{i}"]) for i in (1, 4, 6))
    signs = (("shoulder", 4), ("elbow", 2), ("J5", 1))
    return (
        *(Condition(joint, _QUADRANT * k, _QUADRANT * (k + 1)) for joint, k in quadrants),
        *(Condition.sign(quantity, negative=int(cfx) & bit) for quantity, bit in signs),
    )


def _frame(value: _Value) -> FloatArray | None:
    """(4, 4) pose ``[[x, y, z], [q1, q2, q3, q4]]``, if its numbers are literal."""
    if not isinstance(value, _List) or not _Module._is_literal(value, (3, 4)):
        return None
    xyz, q = (
        [one.value for one in item.items if isinstance(one, Number)] for item in value.items if isinstance(item, _List)
    )
    if abs(hypot(*q) - 1) > _UNIT or max(map(abs, xyz)) > NOT_THERE:
        return None
    return motion(rotation_of_quaternion(q), xyz)


def _are_same(value: _Value | None, other: _Value | None) -> bool:
    """Whether two values have the same numbers and words."""
    if isinstance(value, _List) and isinstance(other, _List):
        return len(value.items) == len(other.items) and all(map(_are_same, value.items, other.items))
    if isinstance(value, Number) and isinstance(other, Number):
        return value.value == other.value
    return value == other


def _depth(value: _Value) -> int:
    return 1 + max(map(_depth, value.items), default=0) if isinstance(value, _List) else 0


def _text(data: _Value) -> str:
    """Bytes as a message shows them."""
    return " ".join(data.decode("latin-1").split())[:60] if isinstance(data, bytes) else ""
