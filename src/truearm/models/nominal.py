"""The nominal arm: its drawing, put where the readings say it stands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.models.compensator import Compensator, chain_covariance
from truearm.readings.readings import Readings

FloatArray = npt.NDArray[np.float64]


class NominalModel(Compensator):
    """The nominal kinematics, with only base and tip fitted, as far as they are free.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` (where the arm stands in the reference's frame) and ``"tip"`` (where the tip sits on the
        flange) are unknown. With none, points are in the arm's own base frame and the tip is as drawn.
    """

    def __init__(self, arm: Arm, *, free: tuple[str, ...] = ("base", "tip")) -> None:
        self.arm = arm
        self.free = free

    def _identify(
        self, readings: Readings, points: FloatArray, progress: Callable[[int, str], None], checkpoint: Path | None
    ) -> None:
        """Nothing beyond what every model knows of the nominal arm."""

    def _tips(self, angles: FloatArray) -> FloatArray:
        return self.nominal_.chain.tip_in_base(angles)

    def _covariance(self, angles: FloatArray) -> FloatArray:
        return chain_covariance(self.nominal_, angles)
