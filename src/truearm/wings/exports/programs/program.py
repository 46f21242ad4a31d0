"""A robot program as bytes: its targets, what is not changed and why, and what a language of a maker must state.

A program is never decoded and written again. A reader finds the bytes of each literal number of a target; a correction
replaces those bytes, and every other byte stays.
`NamedTargets` is what readers of languages with named points do alike.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

from truearm.arm import Chain
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.numbers import NOT_THERE, Number
from truearm.wings.exports.targets.edits import Edit

_UTF8 = b"\xef\xbb\xbf"
N_AXES = 6  # of a robot that is no SCARA

MoveKind = Literal["joint", "linear", "circular"]


class Condition(NamedTuple):
    """One statement of a configuration: a quantity of the nominal joints lies between two values.

    Attributes
    ----------
    quantity : str
        ``"J1"`` .. ``"J6"``, ``"|J4|"``: the joint as the controller prints it [deg]. ``"shoulder"``: how far the wrist
        centre is in front of axis 1 [mm]. ``"elbow"``: how far it is in front of the line from axis 2 to axis 3 [mm].
        See `truearm.wings.exports.programs.branches`.
    low, high : float
    """

    quantity: str
    low: float
    high: float

    @classmethod
    def sign(cls, quantity: str, *, negative: object) -> Condition:
        """The quantity is below zero, or above."""
        return cls(quantity, -inf, 0.0) if negative else cls(quantity, 0.0, inf)


@dataclass(frozen=True, eq=False)
class Target:
    """A target whose numbers are all literal.

    Attributes
    ----------
    name : str
        For messages: the name in the program, or ``"MoveL in line 12"``.
    line : int
        From 1.
    numbers : mapping of str to Number
        The numbers that may change, by the names that the language's `Language.values` uses. No external axes.
    joints : (6,) array, optional
        Of a joint target: as the controller counts them [rad].
    pose : (4, 4) array, optional
        Of a Cartesian target: the tool in the work frame, translation in mm.
    T_flange_tool, T_base_work : (4, 4) array, optional
        Frames of the target, translations in mm; `T_base_work` is in the arm's base. A Cartesian target has both; what
        is not known belongs into `Program.left`. A joint target without a tool is corrected at the model's tip.
    conditions : tuple of Condition
        The configuration as far as it is stated.
    near : (6,) array, optional
        Joints whose configuration and turns the target has, as the controller counts them [rad].
    span : (int, int), optional
        Place of all that states it, for further targets of its form.
    external : tuple of Number
        Its external axes in their order [mm, deg, or 9E9].
    """

    name: str
    line: int
    numbers: Mapping[str, Number]
    joints: FloatArray | None = None
    pose: FloatArray | None = None
    T_flange_tool: FloatArray | None = None
    T_base_work: FloatArray | None = None
    conditions: tuple[Condition, ...] = ()
    near: FloatArray | None = None
    span: tuple[int, int] | None = None
    external: tuple[Number, ...] = ()


class LeftAlone(NamedTuple):
    """A target or motion that is not changed, and why.

    Attributes
    ----------
    line : int
    name : str
        That of a target, or the text of the motion.
    reason : str
    is_literal : bool
        Whether it is a target with all its numbers, which could be corrected if what is missing were stated.
    """

    line: int
    name: str
    reason: str
    is_literal: bool = False


class Passing(NamedTuple):
    """How a straight move goes through a point without a stop: what stands around the point, and where to write it.

    Attributes
    ----------
    at : int
        Where the move itself begins.
    before, after : bytes
        Of the point.
    zone : int
        Place of the zone in `after`, which is that of the language.
    """

    at: int
    before: bytes
    after: bytes
    zone: int

    def text(self, point: bytes, zone: bytes) -> bytes:
        """A move to a point."""
        return self.before + point + self.after[: self.zone] + zone + self.after[self.zone :]


WRITTEN_OTHERWISE = "written in another way"
COMES_FROM = "not certain where the arm comes from"


class Move(NamedTuple):
    """A motion.

    Attributes
    ----------
    line : int
    kind : {"joint", "linear", "circular"}
    target : int or None
        Number in `Program.targets`; None: another place.
    follows : bool
        Whether the arm certainly comes from the move before it in the text.
    passing : Passing or str
        How further targets before this one are written, or why none can be.
    is_certain : bool
        Whether the arm certainly goes to the target: its numbers stand in the move, or its name has one value.
    blend_mm : float
        Within which distance of the target the arm leaves the path, where blends must not overlap; NaN: not known.
    """

    line: int
    kind: MoveKind
    target: int | None
    follows: bool = True
    passing: Passing | str = WRITTEN_OTHERWISE
    is_certain: bool = False
    blend_mm: float = 0.0


@dataclass(frozen=True, eq=False)
class Program:
    """What was found in a program.

    Attributes
    ----------
    data : bytes
        What the numbers' places count in; of a packed program the text within (`Language.unpacked`).
    targets : tuple of Target
    left : tuple of LeftAlone
        Everything else that moves the arm or looks like a target.
    moves : tuple of Move
        Motions in the order of the text, as far as their order is that of the motion.
    notes : tuple of str
        What a person must know: assumptions, frames taught with the robot, points that others are computed from.
    controller : Chain, optional
        Kinematics that the program says its controller uses; the drawing of the model's arm by default.
    unwatched : frozenset of int
        Targets whose configuration the controller does not check, by their numbers.
    """

    data: bytes
    targets: tuple[Target, ...]
    left: tuple[LeftAlone, ...] = ()
    moves: tuple[Move, ...] = ()
    notes: tuple[str, ...] = ()
    controller: Chain | None = None
    unwatched: frozenset[int] = frozenset()

    @classmethod
    def of(
        cls,
        data: bytes,
        targets: Mapping[Any, Target],
        left: Iterable[LeftAlone],
        moves: Iterable[tuple[Move, object]],
        notes: Iterable[str],
        controller: Chain | None = None,
    ) -> Program:
        """A program from its targets by any key, and its moves, each with the key of its target or another one."""
        order = {key: k for k, key in enumerate(targets)}
        placed = tuple(move._replace(target=order.get(key)) for move, key in moves)
        return cls(data, tuple(targets.values()), tuple(left), placed, tuple(notes), controller)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is beside a program.

    Attributes
    ----------
    file : Path, optional
        Of the program, for files of the same backup.
    frames : FramesFile
        What a person states.
    chain : Chain, optional
        The drawing of the model's arm, to its flange.
    """

    file: Path | None = None
    frames: FramesFile = field(default_factory=FramesFile)
    chain: Chain | None = None

    @property
    def rail(self) -> int | None:
        """External axis that is the rail under the robot, from 1; None without one."""
        has_rail = self.chain is not None and self.chain.n_joints > N_AXES and bool(self.chain.is_prismatic[0])
        return self.frames.rail if has_rail else None

    @property
    def known_axes(self) -> set[int | None]:
        """External axes of which it is known what they carry."""
        return {self.rail, *self.frames.not_carrying, *(one.axis for one in self.frames.positioners.values())}


class Language(ABC):
    """A language of robot programs.

    Attributes
    ----------
    title : str
        With its maker, for messages.
    endings : tuple of str
        Of its files, in lower case.
    decimals : int
        To how many decimals a number may be extended where its change would be lost in the last digit; 0: to none.
    keeps_comments : bool
        Whether a controller that saves a program keeps the comment which says that it is corrected; where not, the
        last digits of joints say it too.
    n_axes : tuple of int
        Of the arms whose targets are understood.
    takes_no_targets : str
        Why no further target can be written into a program; empty where it can.
    comment : bytes
        What a comment begins with.
    heading : bytes
        Pattern of the line after which a comment on the whole program stands; before the first line by default.
    """

    title: ClassVar[str]
    endings: ClassVar[tuple[str, ...]]
    decimals: ClassVar[int] = 9
    keeps_comments: ClassVar[bool] = True
    n_axes: ClassVar[tuple[int, ...]] = (6,)
    takes_no_targets: ClassVar[str] = ""
    comment: ClassVar[bytes]
    heading: ClassVar[bytes] = rb"\A(?:\xef\xbb\xbf)?"

    @abstractmethod
    def recognises(self, data: bytes) -> bool:
        """Whether a file is of this language, by its content."""

    @abstractmethod
    def read(self, data: bytes, beside: Surroundings) -> Program:
        """Find all targets; `data` is unpacked.

        Raises
        ------
        InputError
            With the line, if the program is truncated, encoded, or of a kind that must not be changed.
        """

    @abstractmethod
    def values(self, target: Target, joints: FloatArray, pose: FloatArray | None) -> Mapping[str, float]:
        """New values of the target's numbers by their names, in the unit of the language.

        Parameters
        ----------
        target : Target
        joints : (6,) array
            Corrected, as the controller counts them [rad].
        pose : (4, 4) array or None
            The corrected tool in the work frame, translation in mm; None where the target does not state both frames.
        """

    def mark(self, program: Program, words: str) -> Edit:
        """A comment of at most 28 characters, which says that the program is corrected, as the language writes it."""
        head = re.search(self.heading, program.data)
        at = head.end() if head else text_start(program.data)
        return Edit(at, at, self.comment + words.encode("ascii") + line_end_of(program.data))

    def configuration(self, target: Target, quantities: Mapping[str, float]) -> Iterable[Edit]:
        """Edits of a configuration that the corrected joints have left; `quantities` are those of `Condition`.

        Raises
        ------
        InputError
            If the language cannot state the new one at this place: the target is then not changed.
        """
        del quantities
        raise InputError(f"the corrected joints of {target.name} have another configuration")

    def model_joints(self, chain: Chain, joints: FloatArray) -> FloatArray:
        """Joints (n, 6) of the model from those of the controller [rad]."""
        del chain
        return joints

    def controller_joints(self, chain: Chain, joints: FloatArray) -> FloatArray:
        """Joints (n, 6) of the controller from those of the model [rad]."""
        del chain
        return joints

    def zone(self, spacing_mm: float) -> bytes:
        """How a move passes its target without a stop, as `Passing.text` writes it; of targets some mm apart."""
        del spacing_mm
        raise InputError(self.takes_no_targets)

    def blend_mm(self, spacing_mm: float) -> float:
        """How far from a further target the arm leaves the path; 0 where the controller keeps blends apart."""
        del spacing_mm
        return 0.0

    def number_text(self, number: Number, value: float, decimals: int) -> bytes:
        """The bytes of a new value; by default those of a plain decimal number."""
        del number
        text = f"{value:.{decimals}f}"
        return (text[1:] if text.startswith("-") and not text.strip("-0.") else text).encode("ascii")

    def unpacked(self, data: bytes) -> bytes:
        """The text of a program from the bytes of its file."""
        return data

    def packed(self, text: bytes, file: bytes) -> bytes:
        """The bytes of a new file from a program's text, packed as another file is."""
        del file
        return text


def text_start(data: bytes) -> int:
    """Where the text of a program begins: after the mark of UTF-8, which editors of PCs write."""
    return len(_UTF8) if data.startswith(_UTF8) else 0


class Lines:
    """The lines of a program, from 1; a line ends with LF, CR LF, or CR alone."""

    def __init__(self, data: bytes) -> None:
        self._begins = [match.end() for match in re.finditer(rb"\r\n|\n|\r", data)]

    def __call__(self, at: int) -> int:
        """The line of a byte."""
        return 1 + bisect_right(self._begins, at)

    def start(self, at: int) -> int:
        """Where the line of a byte begins."""
        line = bisect_right(self._begins, at)
        return self._begins[line - 1] if line else 0


def line_end_of(data: bytes) -> bytes:
    """The line end that a program uses first."""
    found = re.search(rb"\r\n|\n|\r", data)
    return b"\n" if found is None else found[0]


_NAMED = 5
_MAY_CARRY = (
    "external axis {axis} moves between targets, and may carry the robot (a rail): state in --frames "
    "not_carrying = [{axis}] if it does not"
)


class NamedTarget(NamedTuple):
    """A literal target of a program.

    Attributes
    ----------
    key : bytes or None
        What moves call it, None without a name.
    name : str
    line : int
    made : Target or str
        The target, or why it is not changed.
    is_reached : bool
        Whether a move goes to it.
    """

    key: bytes | None
    name: str
    line: int
    made: Target | str
    is_reached: bool


class NamedTargets:
    """What is found while a file is read."""

    def __init__(self, data: bytes, beside: Surroundings) -> None:
        self.data, self.beside = data, beside
        self.left: list[LeftAlone] = []
        self.notes: list[str] = []
        self.moves: list[tuple[Move, bytes | int | None]] = []

    def settled(self, move: Move, goal: bytes | int | None) -> Move:
        """A move to a goal with what is known of it at the end of the file."""
        del goal
        return move

    def of(self, found: Iterable[NamedTarget], external: Iterable[Sequence[float]]) -> Program:
        """The program; `external` are the external axes of all targets, and goals of moves are names, or numbers."""
        targets: list[Target] = []
        numbers: dict[bytes | int | None, int] = {}
        unreached: list[str] = []
        values = [
            set() if number in self.beside.known_axes else {value for value in axis if abs(value) < NOT_THERE}
            for number, axis in enumerate(zip(*external, strict=True), 1)
        ]
        moves_with = next((_MAY_CARRY.format(axis=i) for i, some in enumerate(values, 1) if len(some) > 1), None)
        for at, one in enumerate(found):
            made = one.made
            if isinstance(made, Target) and made.pose is not None and moves_with is not None:
                made = moves_with
            if isinstance(made, str):
                self.left.append(LeftAlone(one.line, one.name, made, is_literal=True))
                continue
            unreached += [] if one.is_reached else [one.name]
            numbers[at] = numbers[one.key or at] = len(targets)
            targets.append(made)
        moves = tuple(self.settled(move, goal)._replace(target=numbers.get(goal)) for move, goal in self.moves)
        self.notes += [*_unreached_note(unreached), *_external_axes_note(values)]
        return Program(self.data, tuple(targets), tuple(self.left), moves, tuple(self.notes))


CALLED = "The programs that it calls are not corrected with it: {}."


def run_time_notes(text: str, called: str, frames: str) -> Iterator[str]:
    """Notes on the programs that a program calls, and on tools and work frames that it sets.

    Both patterns have the names in their group.
    """
    for pattern, said in (
        (called, CALLED),
        (frames, "The program sets {} while it runs: the corrections are those with the frames of --frames."),
    ):
        names = list(dict.fromkeys(re.findall(pattern, text, re.MULTILINE)))
        if names:
            yield said.format(some(names))


def some(names: Sequence[str]) -> str:
    """The first names, and whether there are others."""
    return ", ".join(names[:_NAMED]) + (" and others" if len(names) > _NAMED else "")


def _unreached_note(names: Iterable[str]) -> Iterator[str]:
    """A note on corrected targets that no move of the file goes to."""
    all_names = list(dict.fromkeys(names))
    if all_names:
        shown = some(all_names)
        yield f"No move of this file goes to {shown}: make sure that none is a limit, a tolerance or a difference."


def _external_axes_note(there: Iterable[set[float]]) -> Iterator[str]:
    """A note on external axes that stand away from zero at all targets, by the values of each."""
    standing = [
        f"{number} at {min(values):g}" for number, values in enumerate(there, 1) if len(values) == 1 and any(values)
    ]
    if standing:
        yield (
            f"External axis {', '.join(standing)} at all targets: if it carries the robot (a rail), state in --frames "
            "where the base then is."
        )
