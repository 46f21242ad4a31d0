"""From what a device counts to joint angles: units, counts per turn, zero, sign, coupling; keys of a source's file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import radians, tau
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field

from truearm.arm.couplings import parse_coupling
from truearm.errors import InputError
from truearm.files.toml_documents import Document, Positive, Real
from truearm.typing import FloatArray

MOST_JOINTS = 32

T = TypeVar("T")
# One for all joints, or a list with one for each.
Each = Annotated[
    tuple[T, ...],
    BeforeValidator(lambda value: value if isinstance(value, list | tuple) else (value,)),
    Field(max_length=MOST_JOINTS),
]

Unit = Literal["deg", "rad", "counts", "mm"]
_FACTOR = {"deg": radians(1), "rad": 1.0, "mm": 1.0}


class JointScale(Document):
    """The keys of a source's file that say what the numbers of a device mean.

    Each is one value for all joints, or a list with one for each.

    Attributes
    ----------
    unit : str or list of str
        Of each joint: deg, rad, counts of an encoder that turns with the joint, or mm of a sliding joint.
    counts_per_turn : float or list of float
        Of each joint in counts. The angle from counts is within half a turn of its zero.
    zero : float or list of float
        What the device says where the arm's angle is zero, in its unit; 0 by default.
    sign : 1 or -1, or list
        -1 where the device counts against the arm's positive direction; 1 by default.
    coupling : str
        Joints whose angle is a sum of several encoders': ``"J3 += J2"`` (`truearm.arm.couplings`).
    """

    unit: Each[Unit] = ("deg",)
    counts_per_turn: Each[Positive] = ()
    zero: Each[Real] = (0.0,)
    sign: Each[Literal[1, -1]] = (1,)
    coupling: Annotated[str, Field(max_length=1000)] | None = None

    def units(self, n_joints: int) -> tuple[Unit, ...]:
        """The unit of each joint."""
        return _each("unit", self.unit, n_joints)

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
        counted = np.array([unit == "counts" for unit in units], dtype=bool)
        if counted.any() and not self.counts_per_turn:
            raise InputError("the key counts_per_turn is missing", hint='it goes with unit = "counts"')
        per_turn = np.array(_each("counts_per_turn", self.counts_per_turn or (1.0,), n_joints))
        zero = np.array(_each("zero", self.zero, n_joints))
        sign = np.array(_each("sign", self.sign, n_joints), dtype=float)
        factor = sign * [
            tau / n if unit == "counts" else _FACTOR[unit] for unit, n in zip(units, per_turn, strict=True)
        ]
        matrix = np.eye(n_joints) if self.coupling is None else parse_coupling(self.coupling, n_joints)
        half = per_turn[counted] / 2

        def decode(numbers: Sequence[float]) -> FloatArray:
            moved = np.asarray(numbers, dtype=float) - zero
            moved[counted] = (moved[counted] + half) % (2 * half) - half
            return np.asarray(matrix @ (factor * moved))

        return decode


def _each(key: str, values: tuple[T, ...], n_joints: int) -> tuple[T, ...]:
    if len(values) == 1:
        return values * n_joints
    if len(values) != n_joints:
        raise InputError(f"expected {n_joints} entries of {key}, one a joint, got {len(values)}")
    return values
