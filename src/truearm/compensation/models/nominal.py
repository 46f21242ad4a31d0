"""The nominal arm: its drawing, put where the readings say it stands."""

from __future__ import annotations

from typing import ClassVar

from truearm.arm.arm import Arm
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.identification.terms import ArmState, SkippedTerm, Term, constants


class NominalModel(IdentifiedModel):
    """The nominal kinematics, with only base and tip fitted, as far as they are free.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` (where the arm stands in the reference's frame) and ``"tip"`` (where the tip sits on the
        flange) are unknown. With none, points are in the arm's own base frame and the tip is as drawn.
    """

    _is_nominal: ClassVar[bool] = True

    def __init__(self, arm: Arm, *, free: tuple[str, ...] = ("base", "tip")) -> None:
        self.arm = arm
        self.free = free

    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        return constants(state.chain, free=self.free_, angle_std=0.0, length_std=0.0), []
