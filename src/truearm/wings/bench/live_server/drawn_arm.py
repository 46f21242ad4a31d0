"""The arm that the page draws: the identified one in the frame of its reference, else the nominal one in its base."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.identified_model import to_identified
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """The arm that the page draws.

    Attributes
    ----------
    arm : Arm
    is_identified : bool
        Whether it stands in the frame of the reference, not in its base.
    """

    arm: Arm
    is_identified: bool

    def pivots(self, angles_rad: FloatArray) -> list[float]:
        """The values of its pivots at joint angles (n_joints,) [deg, or mm of sliding joints]."""
        scale = np.where(self.arm.chain.is_prismatic, 1.0, np.degrees(1.0))
        values: list[float] = (self.arm.chain.joint_angles(angles_rad) * scale).tolist()
        return values

    def tips_mm(self, angles_rad: FloatArray) -> list[list[float]]:
        """Its tips at joint angles (n, n_joints) [mm]."""
        tips: list[list[float]] = self.arm.chain.tip_in_base(angles_rad).tolist()
        return tips


def drawn_arm(arm: Arm | None, model: Compensator | None) -> DrawnArm:
    """The arm that the page draws.

    Raises
    ------
    InputError
        If there is none, or nothing is known of its kinematics.
    """
    found = None if model is None else to_identified(model)
    if found is not None:
        return DrawnArm(replace(found.arm, chain=found.fit_.chain), is_identified=True)
    if arm is None:
        raise InputError("the page needs the arm", hint="--arm ARM, or --model MODEL")
    if not arm.has_kinematics:
        raise InputError(f"of arm {arm.name!r} only the joints are known", hint="truearm record takes its readings")
    return DrawnArm(arm, is_identified=False)
