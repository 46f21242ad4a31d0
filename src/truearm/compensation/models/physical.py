"""The physical model: constants, and all small motions that angles, weight and temperature are known to cause."""

from __future__ import annotations

import numpy as np

from truearm.arm.arm import Arm
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.errors import InputError
from truearm.identification.terms import ArmState, SkippedTerm, Term, candidate_terms
from truearm.identification.terms.basis import HIGHEST_ORDER
from truearm.identification.terms.catalogue import HIGHEST_ORDER_OFFERED


class PhysicalModel(IdentifiedModel):
    """The arm with every term that its readings can show; evidence decides which it has, and how large.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown altogether; the others are known as well as any constant of the
        arm.
    highest : int
        Highest order of harmonics about a joint's own axis that is offered.
    robust : bool
        Whether readings far off weigh less, for the nominal arm to compare with too.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        free: tuple[str, ...] = ("base", "tip"),
        highest: int = HIGHEST_ORDER_OFFERED,
        robust: bool = True,
    ) -> None:
        self.arm = arm
        self.free = free
        self.highest = highest
        self.robust = robust

    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        return candidate_terms(state, free=self.free_, highest=int(self.highest))

    def _check_options(self) -> None:
        super()._check_options()
        if not (isinstance(self.highest, int | np.integer) and 1 <= self.highest <= HIGHEST_ORDER):
            raise InputError(f"expected a highest order from 1 to {HIGHEST_ORDER}, got {self.highest!r}")
