"""A standard's test taken by virtual arms: what would an arm pass?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.verify.layout import Placement
from truearm.verify.orthogonal import FloatArray


@dataclass(frozen=True, eq=False)
class PosedTest:
    """A layout with joint angles for each of its points, found once for the nominal arm.

    Attributes
    ----------
    arm : Arm
    placements : tuple of Placement
    angles : (n, n_joints) array
        Poses that put the nominal tip on the points, placement by placement [rad].
    placement : (n,) array of int
        Which placement each belongs to.
    """

    arm: Arm
    placements: tuple[Placement, ...]
    angles: FloatArray
    placement: npt.NDArray[np.intp]

    @property
    def points(self) -> FloatArray:
        """The nominal points, (n, 3) [mm]."""
        return np.concatenate([one.points for one in self.placements])


def pose(layout: tuple[Placement, ...], arm: Arm, *, seed: int) -> PosedTest:
    """Find joint angles for every point of a layout."""
    raise NotImplementedError
