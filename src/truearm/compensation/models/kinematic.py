"""The kinematic model: the constant small motions of all places."""

from __future__ import annotations

from truearm.arm.arm import Arm
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.identification.terms import ArmState, SkippedTerm, Term, constants


class KinematicModel(IdentifiedModel):
    """The arm's true constants: six small motions after every joint, the base and the tip.

    More constants than any minimal parametrisation; what the readings cannot tell apart is held by a Gaussian prior
    about the nominal arm, whose scales evidence finds, so that no list of fixed parameters is needed and near-parallel
    axes need no special form.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown altogether; the others are known as well as any constant of the
        arm.
    robust : bool
        Whether readings far off weigh less, for the nominal arm to compare with too.
    """

    def __init__(self, arm: Arm, *, free: tuple[str, ...] = ("base", "tip"), robust: bool = True) -> None:
        self.arm = arm
        self.free = free
        self.robust = robust

    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        return constants(state.chain, free=self.free_), []
