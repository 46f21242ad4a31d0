"""Basis functions of torques at the joints: by the arm's own weight, and by a payload."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.errors import InputError
from truearm.identification.terms.basis import AXES, Basis, of_joint, plain, register_basis, settle_whole
from truearm.identification.terms.state import ArmState
from truearm.readings.readings import PAYLOAD
from truearm.typing import FloatArray


@register_basis
@dataclass(frozen=True)
class GravityTorque(Basis):
    """A component of the gravity torque at a joint by the masses outward of it, at the nominal pose [N m].

    Parameters
    ----------
    joint : int
        Counted from 1, along the axes of that joint's place; 0 is the torque of joint 1 on the base, along the axes of
        place 0, which do not rotate with joint 1.
    axis : int
        0, 1, 2 for x, y, z.
    """

    joint: int
    axis: int

    def __post_init__(self) -> None:
        settle_whole(self, "joint", 0)
        settle_whole(self, "axis", 0, 2)

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"gravity torque about {AXES[self.axis]} of {f'J{self.joint}' if self.joint else 'the base'}",)

    @classmethod
    def together(cls, bases: Sequence[Self]) -> Callable[[ArmState], FloatArray]:
        """Torques of all joints from the loads at once."""
        places = np.array([3 * (basis.joint - 1) + basis.axis for basis in bases], dtype=np.intp)
        on_base = [(row, basis) for row, basis in enumerate(bases) if basis.joint == 0]
        last = max(basis.joint for basis in bases)

        def values(state: ArmState) -> FloatArray:
            if last > state.angles.shape[1]:
                of_joint(state.angles, last)  # which refuses it
            found: FloatArray = state.gravity_torques.reshape(len(state), -1).T[places]
            for row, basis in on_base:
                found[row] = basis.values(state)[0]
            return found

        return values

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) torques [N m]."""
        if self.joint > 0:
            of_joint(state.angles, self.joint)
        return _torque_at(state, state.gravity_torques, self.joint, self.axis)


@register_basis
@dataclass(frozen=True)
class PayloadTorque(Basis):
    """A component of the torque at a joint by the weight of a payload at the tip, at the nominal pose [N m].

    Parameters
    ----------
    joint : int
        As in `GravityTorque`.
    axis : int
        0, 1, 2 for x, y, z.
    from_kg : float
        The torque is that of the payload less this mass [kg].
    """

    joint: int
    axis: int
    from_kg: float = 0.0

    def __post_init__(self) -> None:
        settle_whole(self, "joint", 0)
        settle_whole(self, "axis", 0, 2)
        from_kg = plain(self.from_kg)
        if not isinstance(from_kg, int | float) or isinstance(from_kg, bool) or not np.isfinite(from_kg):
            raise InputError(f"expected a mass in kg, got {from_kg!r:.60}")
        object.__setattr__(self, "from_kg", float(from_kg))

    def labels(self) -> tuple[str, ...]:
        """One function."""
        above = f" above {self.from_kg:g} kg" if self.from_kg else ""
        of = f"J{self.joint}" if self.joint else "the base"
        return (f"torque of the payload{above} about {AXES[self.axis]} of {of}",)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) torques [N m]."""
        if PAYLOAD not in state.columns:
            raise InputError("expected readings with a payload, got none", column=PAYLOAD)
        if self.joint > 0:
            of_joint(state.angles, self.joint)
        per_kg = _torque_at(state, state.loads_per_kg.torque_in_joint, self.joint, self.axis)
        return np.asarray((state.columns[PAYLOAD] - self.from_kg) * per_kg)


def _torque_at(state: ArmState, torques: FloatArray, joint: int, axis: int) -> FloatArray:
    """(1, n) torque about an axis of a joint's place; joint 0: of joint 1 on the base, about the axes of place 0."""
    if joint > 0:
        return np.ascontiguousarray(torques[None, :, joint - 1, axis])
    torque = torques[:, 0]
    if axis == 2 or state.chain.is_prismatic[0]:
        return np.ascontiguousarray(torque[None, :, axis])
    cos, sin = np.cos(state.angles[:, 0]), np.sin(state.angles[:, 0])
    x, y = torque[:, 0], torque[:, 1]
    return np.asarray(cos * x - sin * y if axis == 0 else sin * x + cos * y)[None]
