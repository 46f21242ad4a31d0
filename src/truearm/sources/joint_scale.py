"""From what a device counts to joint angles: units, counts per turn, zero, sign, coupling; keys of a source's file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import pi, radians
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field

from truearm.arm.couplings import parse_coupling
from truearm.errors import InputError
from truearm.files.toml_documents import Document, Positive, Real
from truearm.typing import FloatArray

MOST_JOINTS = 32

T = TypeVar("T")

Unit = Literal["deg", "rad", "counts", "mm"]
_FACTOR = {"deg": radians(1), "rad": 1.0, "mm": 1.0}


class JointScale(Document):
    """The keys of a source's file that say what the numbers of a device mean; each has an entry for every joint.

    Attributes
    ----------
    unit : str, or list of str
        Of each joint: deg, rad, counts of an encoder that turns with the joint, or mm of a sliding joint.
    counts_per_turn : list of float
        Of each joint in counts. The angle from counts is within half a turn of its zero.
    zero : list of float
        What the device says where the arm's angle is zero, in its unit; 0 by default.
    sign : list of 1 or -1
        -1 where the device counts against the arm's positive direction; 1 by default.
    coupling : str
        Joints whose angle is a sum of several encoders': ``"J3 += J2"`` (`truearm.arm.couplings`).
    """

    unit: Unit | Annotated[tuple[Unit, ...], Field(max_length=MOST_JOINTS)] = "deg"
    counts_per_turn: Positive | tuple[Positive, ...] | None = None
    zero: tuple[Real, ...] | None = None
    sign: tuple[Literal[1, -1], ...] | None = None
    coupling: Annotated[str, Field(max_length=1000)] | None = None

    def units(self, n_joints: int) -> tuple[Unit, ...]:
        """The unit of each joint."""
        return tuple(_each("unit", [self.unit] * n_joints if isinstance(self.unit, str) else self.unit, n_joints))

    def prismatic(self, n_joints: int) -> tuple[int, ...]:
        """Numbers of the joints that slide."""
        return tuple(number for number, unit in enumerate(self.units(n_joints), start=1) if unit == "mm")

    def decoder(self, n_joints: int) -> Callable[[Sequence[float]], FloatArray]:
        """What turns the numbers of a device, one a joint, into joint angles [rad, or mm].

        Raises
        ------
        InputError
            If a key has not as many entries as there are joints, or counts per turn are missing.
        """
        units = self.units(n_joints)
        turn = self.counts_per_turn
        turns = [turn] * n_joints if turn is None or isinstance(turn, float) else list(turn)
        per_turn = np.array([one or 0.0 for one in _each("counts_per_turn", turns, n_joints)])
        counted = np.array([unit == "counts" for unit in units], dtype=bool)
        if (counted & (per_turn == 0)).any():
            raise InputError("the key counts_per_turn is missing", hint='it goes with unit = "counts"')
        zero = np.array(_each("zero", self.zero or [0.0] * n_joints, n_joints))
        sign = np.array(_each("sign", self.sign or [1] * n_joints, n_joints), dtype=float)
        factor = sign * [
            2 * pi / n if unit == "counts" else _FACTOR[unit] for unit, n in zip(units, per_turn, strict=True)
        ]
        matrix = np.eye(n_joints) if self.coupling is None else parse_coupling(self.coupling, n_joints)
        half = per_turn[counted] / 2

        def decode(numbers: Sequence[float]) -> FloatArray:
            moved = np.asarray(numbers, dtype=float) - zero
            moved[counted] = (moved[counted] + half) % (2 * half) - half
            return np.asarray(matrix @ (factor * moved))

        return decode


def _each(key: str, values: Sequence[T], n_joints: int) -> Sequence[T]:
    if len(values) != n_joints:
        raise InputError(f"expected {n_joints} entries of {key}, one a joint, got {len(values)}")
    return values
