"""Torques at the joints, by the arm's own weight and by a payload: their basis functions, and the payload's terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.arm.chain import Chain
from truearm.identification.terms.basis import AXES, AxisNumber, Basis, JointOrBase, Number, register_basis
from truearm.identification.terms.expression import Expression, of_joint, torque_about
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.typing import FloatArray

PAYLOAD_COMPLIANCE = "compliance under the payload"
"""The group of the terms."""
# Joints and links of robots and measuring arms, as of the gravity terms with known masses [rad/(N m)].
COMPLIANCE_STD = 2e-5


def payload_terms(chain: Chain, *, from_kg: float = 0.0) -> list[Term]:
    """Rotations of the base and of every joint by the torque of a payload, each about the axis of the torque.

    The payload is a mass at the nominal tip. With known masses of the links the gravity terms have its torque too, and
    these terms are the difference between the compliance under the arm's own weight and under the payload (balancers
    carry the one and not the other).

    Parameters
    ----------
    chain : Chain
    from_kg : float
        Payload at which the terms are zero [kg].
    """
    return [
        Term(
            f"{f'J{joint}' if joint else 'base'} rotation about {AXES[axis]} by the payload",
            joint,
            tuple(float(component == axis) for component in range(6)),
            PayloadTorque(joint, axis, from_kg),
            PAYLOAD_COMPLIANCE,
            COMPLIANCE_STD,
        )
        for joint in range(chain.n_joints + 1)
        for axis in range(3)
    ]


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
