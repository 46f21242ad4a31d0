"""Terms of a payload: what joints and links turn under its weight."""

from __future__ import annotations

from truearm.arm.chain import Chain
from truearm.identification.terms.basis import AXES
from truearm.identification.terms.term import Term
from truearm.identification.terms.torque import PayloadTorque

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
