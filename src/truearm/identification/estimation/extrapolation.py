"""Extrapolation: how the residual variance grows with the distance from the angles of the readings.

What no term describes is a smooth function of the joints. Inside the trained range the terms take up its trend, and
what remains scatters about zero; outside it drifts away from what they took up. As in kriging, the variance of the
difference grows with the distance to the data, here by a linear variogram (N. A. C. Cressie, "Statistics for Spatial
Data", 1993, section 2.3.1): outside by d it is the residual variance times ``1 + growth d``. No readings show that a
model holds farther out than held-out regions of them reach; there it becomes at least that of the nominal arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray

# A steeper one in a file is an error: the variance would double within a twentieth of a degree.
STEEPEST_GROWTH = 1e3


@dataclass(frozen=True, eq=False)
class Extrapolation:
    """Growth of the residual variance outside the trained range of the joints.

    Parameters
    ----------
    ranges : (n_joints, 2) array
        Ends of the trained angles [rad, or mm].
    is_prismatic : (n_joints,) bool array
        Which joints slide.
    growth : float
        Share of the residual variance per radian, or per range of a sliding joint.
    nominal : float
        What is added from a distance of `not_seen` on, in part from `seen` on: the residual variance of the nominal arm
        over that of the model, less one; 0 in files of models that were trained before it was kept.
    """

    # A sliding joint counts in units of its range, that of one which hardly moved in a millimetre.
    least_travel_mm: ClassVar[float] = 1.0
    # Distances up to which the growth is seen, or tested, and from which on a model may be as wrong as the drawing.
    seen: ClassVar[float] = 0.6
    not_seen: ClassVar[float] = 1.2
    ranges: FloatArray
    is_prismatic: BoolArray
    growth: float
    nominal: float = 0.0

    def __post_init__(self) -> None:
        if self.ranges.shape != (len(self.is_prismatic), 2) or not (self.ranges[:, 0] <= self.ranges[:, 1]).all():
            raise InputError("expected a range of every joint whose ends rise")
        if not 0 <= self.growth <= STEEPEST_GROWTH:
            raise InputError(f"expected a growth of the residual variance from 0 to {STEEPEST_GROWTH:g}")
        if not 0 <= self.nominal < np.inf:
            raise InputError("expected a growth to the residual variance of the nominal arm of 0 or more")

    @cached_property
    def unit(self) -> FloatArray:
        """(n_joints,) what a distance of 1 is [rad, or mm of a sliding joint]."""
        travel = np.maximum(self._span, self.least_travel_mm)
        return np.asarray(np.where(self.is_prismatic, travel, 1.0))

    @cached_property
    def _has_slides(self) -> bool:
        return bool(self.is_prismatic.any())

    @cached_property
    def _span(self) -> FloatArray:
        return np.asarray(np.ptp(self.ranges, axis=1))

    def distance(self, angles: FloatArray) -> FloatArray:
        """(n,) how far angles (n, n_joints) are outside: the root of the joints' squares [rad, or ranges].

        A revolute joint that is counted on by a full turn is where it was.
        """
        above, span = angles - self.ranges[:, 0], self._span
        turned = np.mod(above, 2 * np.pi)
        off = np.where(turned > span, np.minimum(turned - span, 2 * np.pi - turned), 0.0)
        if self._has_slides:
            sliding = np.maximum(np.maximum(above - span, -above), 0.0) / self.unit
            off = np.where(self.is_prismatic, sliding, off)
        return np.asarray(np.sqrt((off * off).sum(axis=1)))

    def counted_near(self, angles: FloatArray) -> FloatArray:
        """Angles (n, n_joints), of turning joints outside their range moved by full turns to be near its middle."""
        outside = ((angles < self.ranges[:, 0]) | (angles > self.ranges[:, 1])) & ~self.is_prismatic
        if not outside.any():
            return angles
        turns = np.floor((angles - self.ranges.mean(axis=1)) / (2 * np.pi) + 0.5)
        return np.asarray(np.where(outside, angles - 2 * np.pi * turns, angles))

    def factor(self, angles: FloatArray) -> FloatArray:
        """(n,) the residual variance over that inside; 1 inside."""
        distance = self.distance(angles)
        if not distance.any():
            return np.ones(len(angles))
        not_seen = np.clip((distance - self.seen) / (self.not_seen - self.seen), 0.0, 1.0)
        return np.asarray(1.0 + self.growth * distance + self.nominal * not_seen)
