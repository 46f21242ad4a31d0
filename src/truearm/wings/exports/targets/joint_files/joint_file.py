"""A file of joint targets as another program writes it, and the same file with other numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearm.arm import Arm
from truearm.arm.kinematics_yaml import JOINTS
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.targets import TargetDirection
from truearm.wings.exports.targets.edits import with_edits
from truearm.wings.exports.targets.lerobot_motors import MOTORS, JointValues

# A model that equals the nominal arm changes joints by rounding: such a number keeps its bytes [rad, or mm].
UNCHANGED = 1e-9
# The unit of the last digit that is written is at most this share of a degree: 2 um at 1 m.
_DIGIT = 1e-4
_MARK = re.compile(r"truearm (command|feedback) ([0-9a-f]{8})")
# Joints that have names instead of numbers, base to tip, and the arms that have them: axes 2, 3 and 4 are parallel.
_NAMED = (JOINTS, MOTORS)
_PARALLEL = 0.99


@dataclass(frozen=True, eq=False)
class JointFile:
    """Joint targets in a file of another program.

    Attributes
    ----------
    title : str
        The kind of file.
    values : (n, n_joints) array
        In the unit of the file, base to tip.
    scale : JointValues
        How they become joints [rad, or mm].
    content : callable
        The content with other values, and a mark of what was done.
    rows : sequence of str
        What each row of the values is called, such as ``line 7``.
    remarks : tuple of str
        What was taken for the joints, where the file leaves it open, and whether it has a place for the mark.
    sent : tuple of (n_joints,) arrays, optional
        Lowest and highest values that the program of the file sends; it cuts off the rest.
    """

    title: str
    values: FloatArray
    scale: JointValues
    content: Callable[[FloatArray, str], bytes]
    rows: Sequence[str]
    remarks: tuple[str, ...] = ()
    sent: tuple[FloatArray, FloatArray] | None = None

    @property
    def joints(self) -> FloatArray:
        """(n, n_joints) joints [rad, or mm]."""
        return self.scale.to_angles(self.values)

    def findings(self, joints: FloatArray) -> Iterator[str]:
        """What a person must know of the file with corrected joints [rad, or mm]."""
        yield from self.remarks
        if self.sent is not None:
            values = self.scale.to_values(joints)
            beyond = (values < self.sent[0]) | (values > self.sent[1])
            if beyond.any():
                row, joint = np.argwhere(beyond)[0].tolist()
                yield (
                    f"{int(beyond.any(axis=1).sum())} of {len(values)} targets are beyond the range of a motor after "
                    f"the correction, first {self.rows[row]} with {values[row, joint]:.6g} of joint {joint + 1}: "
                    "LeRobot sends the end of the range, and their correction is lost. Plan them further inside."
                )

    def corrected(self, joints: FloatArray, mark: str) -> bytes:
        """The content with corrected joints [rad, or mm]; joints that did not change keep their bytes."""
        changed = np.abs(joints - self.joints) > UNCHANGED
        return self.content(np.where(changed, self.scale.to_values(joints), self.values), mark)


class Span(NamedTuple):
    """Where a number stands in a text."""

    start: int
    stop: int


def edited(text: str, spans: Sequence[Sequence[Span]], before: FloatArray, after: FloatArray, gain: FloatArray) -> str:
    """The text with numbers (n, n_joints) in their places, as many digits as theirs or as the correction needs."""
    rows, columns = np.nonzero(before != after)
    needed = np.maximum(np.ceil(-np.log10(_DIGIT * np.pi / 180 / np.abs(gain))), 0).astype(int)
    return with_edits(
        text,
        [
            (*spans[i][j], _number(text[slice(*spans[i][j])], float(after[i, j]), int(needed[j])))
            for i, j in zip(rows.tolist(), columns.tolist(), strict=True)
        ],
    )


def _number(written: str, value: float, needed: int) -> str:
    plain = written if "e" not in written.lower() else ""
    decimals = max(needed, len(plain.partition(".")[2]))
    return f"{value + 0.0:{'+' * written.startswith('+')}.{decimals}f}"


def turning_scale(arm: Arm, unit: str) -> JointValues:
    """The scale of joints in deg or rad, sliding joints in mm or m."""
    turning, sliding = {"deg": (np.pi / 180, 1.0), "rad": (1.0, 1000.0)}[unit]
    return JointValues(np.where(arm.chain.is_prismatic, sliding, turning), np.zeros(arm.n_joints))


def places_of(names: Sequence[str], arm: Arm) -> list[int] | None:
    """Where the joints of an arm, base to tip, stand among named ones; None where the names do not tell.

    The names are those of the arm, those that a program gives its joints, or have the joints' numbers in them.
    """
    n = arm.n_joints
    for known in known_names(arm):
        if set(known) <= set(names) and len(set(names)) == len(names):
            return [list(names).index(name) for name in known]
    numbers = [re.findall(r"\d+", name)[-1:] for name in names]
    if len(names) == n and sorted(int(one[0]) if one else 0 for one in numbers) == list(range(1, n + 1)):
        return [numbers.index([str(i)]) if [str(i)] in numbers else -1 for i in range(1, n + 1)]
    return None


def known_names(arm: Arm) -> list[tuple[str, ...]]:
    """The names that an arm's joints can have in a file, base to tip: its own, and those of programs for such arms."""
    are_parallel = arm.n_joints > 3 and bool(np.abs(arm.chain.fixed[2:4, 2, 2]).min() > _PARALLEL)
    return [arm.joint_names, *(names for names in _NAMED if are_parallel and len(names) == arm.n_joints)]


def wrong_names(names: Sequence[str], arm: Arm) -> InputError | None:
    """Which joints of an arm named ones lack, and which are others; None where none of them has a name of its own."""
    known = max(known_names(arm), key=lambda one: len(set(one) & set(names)))
    lacking, others = ([a for a in one if a not in other] for one, other in ((known, names), (names, known)))
    if len(lacking) == len(known):
        return None
    return InputError(
        f"expected the joints {', '.join(known)}: {', '.join(lacking) or 'none'} missing"
        + f", {', '.join(others)[:200]} unknown" * bool(others)
    )


def marked(text: str, words: str, comment: str, *, after: str = "") -> str:
    """A text with a line of comment that says what was done; in the other direction than before, without one."""
    if found := _MARK.search(text):
        lines = text.splitlines(keepends=True)
        return "".join(line for line in lines if found[0] not in line)
    end = "\r\n" if "\r\n" in text else "\n"
    first, newline, rest = text.partition("\n")
    if after and first.strip() == after:
        return f"{first}{newline}{comment.format(words)}{end}{rest}"
    return f"{comment.format(words)}{end}{text}"


def check_not_corrected(text: str, direction: TargetDirection) -> None:
    """Refuse a text that was corrected in this direction.

    Raises
    ------
    InputError
    """
    if any(found[1] == direction for found in _MARK.finditer(text)):
        raise InputError(
            f"the file is corrected already ({direction}): twice would double the correction",
            hint="correct the file as planned; --direction of the other sense is the reverse",
        )


def is_marked(text: str) -> bool:
    """Whether truearm has written a text."""
    return _MARK.search(text) is not None
