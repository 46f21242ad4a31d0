"""Basis functions of torques at the joints: by the arm's own weight, and by a payload."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.identification.terms.basis import AxisNumber, Basis, JointOrBase, Number, register_basis
from truearm.identification.terms.expression import Expression, of_joint, torque_about
from truearm.identification.terms.state import ArmState
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

    joint: JointOrBase
    axis: AxisNumber

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.gravity_torque(self.joint, self.axis),)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) torques, without the way through their expression."""
        return torque_about(state, state.gravity_torques, self.joint, self.axis)[None]

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

    joint: JointOrBase
    axis: AxisNumber
    from_kg: Number = 0.0

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.payload_torque(self.joint, self.axis, self.from_kg),)
