"""Readings that a model was fitted to, recognised in other files by what was measured: joint angles and reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from truearm.errors import InputError
from truearm.readings.repeats import merge_repeats
from truearm.readings.rounding import rounding_steps
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray

# Copies of a reading differ by the rounding of their files [rad, mm]: 3 decimals of a degree, micrometres. A pose that
# is measured again has another reference point by more.
SAME_ANGLE, SAME_MM = 1e-5, 1e-3
# Coarser rounding of a copy, which its numbers show, is followed up to these steps [rad, mm]: 2 decimals of each.
COARSEST_ANGLE, COARSEST_MM = 2e-4, 0.011
# Repeats of a pose are nearer than this to their mean [rad, mm]; without any so near there is nothing to merge.
REPEAT_ANGLE, REPEAT_MM = 5e-4, 50.0
# Readings that are kept, evenly spaced in their order: of a fit 40 kB of a model file, of each refit ten times as many.
MOST_OF_FIT, MOST_OF_REFIT = 500, 5000
# Numbers of the reference: a point, a distance; 0 where none was measured.
N_OF_REFERENCE = 4


@dataclass(frozen=True, eq=False)
class KnownReadings:
    """What was measured at the readings from which a model learned.

    Attributes
    ----------
    numbers : (k, n_joints + 4) array
        Joint angles [rad, or mm], point and distance [mm], of the fit first.
    n_refit : int
        How many of them, the last, are of transfers to a new set-up.
    """

    numbers: FloatArray
    n_refit: int = 0

    def __post_init__(self) -> None:
        if self.numbers.ndim != 2 or not 0 <= self.n_refit <= len(self.numbers):
            raise InputError("expected known readings as rows of numbers, those of a refit among them")

    @classmethod
    def of(cls, readings: Session) -> Self:
        """Those of a fit."""
        return cls(_spaced(_numbers(readings), MOST_OF_FIT))

    @classmethod
    def after_refit(cls, before: KnownReadings | None, readings: Session) -> Self:
        """Those of before, if they are known, and of a transfer."""
        numbers, n_refit = _spaced(_numbers(readings), MOST_OF_REFIT), 0
        n_new = len(numbers)
        if before is not None:
            numbers, n_refit = np.concatenate([before.numbers, numbers]), before.n_refit
        return cls(numbers, n_refit + n_new)

    @property
    def n_of_fit(self) -> int:
        """How many readings of the fit are kept."""
        return len(self.numbers) - self.n_refit

    @property
    def of_refits(self) -> KnownReadings:
        """Those of transfers alone."""
        return KnownReadings(self.numbers[self.n_of_fit :], self.n_refit)

    def among(self, readings: Session, prismatic: BoolArray) -> BoolArray:
        """(n,) which readings are known, as they are or as one of the repeats that the fit merged into their mean."""
        slides = np.concatenate([prismatic, np.ones(N_OF_REFERENCE, dtype=bool)])
        numbers = _numbers(readings)
        if not self._near(numbers, np.where(slides, REPEAT_MM, REPEAT_ANGLE)).any():
            return np.zeros(len(readings), dtype=bool)
        known = self._have(numbers, slides)
        if not known.all() and len((merged := merge_repeats(readings)).readings) < len(readings):
            known |= self._have(_numbers(merged.readings), slides)[merged.member]
        return known

    def _have(self, numbers: FloatArray, slides: BoolArray) -> BoolArray:
        same = np.where(slides, SAME_MM, SAME_ANGLE)
        coarsest = np.where(slides, COARSEST_MM, COARSEST_ANGLE)
        known, near = self._near(numbers, same), self._near(numbers, coarsest)
        if (known == near).all():
            return known
        steps = rounding_steps(numbers, slides)  # takes longer, and seldom matters
        return self._near(numbers, np.maximum(same, np.where(steps <= coarsest, 0.51 * steps, 0.0)))

    def _near(self, numbers: FloatArray, tolerance: FloatArray) -> BoolArray:
        tree = cKDTree(self.numbers / tolerance)
        distance = np.asarray(tree.query(numbers / tolerance, p=np.inf, distance_upper_bound=1.0)[0])
        return np.asarray(distance <= 1)


def _numbers(readings: Session) -> FloatArray:
    out = np.zeros((len(readings), readings.n_joints + N_OF_REFERENCE))
    out[:, : readings.n_joints] = readings.angles
    if readings.points is not None:
        out[:, -4:-1] = np.nan_to_num(readings.points)
    if readings.distance_mm is not None:
        out[:, -1] = np.nan_to_num(readings.distance_mm)
    return out


def _spaced(numbers: FloatArray, most: int) -> FloatArray:
    rows = np.linspace(0, len(numbers) - 1, min(len(numbers), most)).round().astype(int)
    return np.asarray(numbers[rows])
