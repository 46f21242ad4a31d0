"""Errors of measured poses: how position and orientation of a reading err together, and what all readings share.

A camera sees a board: where it is along the line of sight, and how it is tilted, is known less well than where it is
across, and the errors of both belong together. An error of the focal length or of the size of the board moves the poses
of all readings at once. Points and quaternions of a session with such errors are poses, each one measurement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray

# An arm whose position errs by a millimetre usually turns its flange by a millimetre at this distance.
LEVER_MM = 400.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseErrors:
    """Errors of the poses of n readings, along the axes of the reference's frame; zeros where a reading has no pose.

    Attributes
    ----------
    covariance : (n, 6, 6) array
        Of the position [mm] and the rotation of the orientation on the left [rad], independent of other readings.
    by_common : (n, 6, a) array
        Change of the measured pose by one unit of each common error.
    common : tuple of str
        Names of these, with units.
    root, offset : (b, a), (b,) array
        What is known of the common errors e: ``root @ e + offset`` has mean zero and the covariance of the identity.
    lever_mm : float
        Position error of the arm over the rotation error of its flange [mm/rad].
    arm_std_mm : float
        Standard deviation of a coordinate of the arm's own position error; 0 if it is not known.

    Raises
    ------
    InputError
        If shapes do not match, or a number is not finite.
    """

    covariance: FloatArray
    by_common: FloatArray
    common: tuple[str, ...] = ()
    root: FloatArray
    offset: FloatArray
    lever_mm: float = LEVER_MM
    arm_std_mm: float = 0.0

    def __post_init__(self) -> None:
        n, a, b = len(self.covariance), len(self.common), len(self.offset)
        for name, shape in (("covariance", (n, 6, 6)), ("by_common", (n, 6, a)), ("root", (b, a)), ("offset", (b,))):
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise InputError(f"expected finite {name} of pose errors of shape {shape}, got {value.shape}")

    def __len__(self) -> int:
        return len(self.covariance)

    def turned(self, which: BoolArray, R: FloatArray) -> Self:
        """The same in another frame for some readings, with the rotation (3, 3) into it."""
        both = np.kron(np.eye(2), R)
        covariance, by_common = self.covariance.copy(), self.by_common.copy()
        covariance[which] = both @ covariance[which] @ both.T
        by_common[which] = both @ by_common[which]
        return replace(self, covariance=covariance, by_common=by_common)

    def rows(self, which: Any) -> Self:
        """Those of some readings."""
        return replace(self, covariance=self.covariance[which], by_common=self.by_common[which])
