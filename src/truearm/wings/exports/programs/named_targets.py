"""What readers of languages with named points do alike: targets, moves and notes of a program from what was found."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from truearm.wings.exports.programs.numbers import NOT_THERE
from truearm.wings.exports.programs.program import LeftAlone, Move, Program, Surroundings, Target

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


def _unreached_note(names: Iterable[str]) -> Iterator[str]:
    """A note on corrected targets that no move of the file goes to."""
    all_names = list(dict.fromkeys(names))
    if all_names:
        shown = ", ".join(all_names[:_NAMED]) + (" and others" if len(all_names) > _NAMED else "")
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
