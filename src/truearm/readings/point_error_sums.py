"""Errors of points against reference points, as sums that are added over parts of a session."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from truearm.errors import InputError
from truearm.readings.point_errors import PointErrors
from truearm.solve.sums import QuantileSketch, Sums, block_starts, design_effect, joined, one_below_the_other
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class PointErrorSums(Sums):
    """Sums over readings with reference points.

    Attributes
    ----------
    n : int
    distance, squared : float
        Sums of the distances [mm] and of their squares [mm^2].
    largest : float
        The largest distance [mm].
    coordinate, largest_coordinate : float
        Sum of the absolute errors of coordinates, and the largest [mm].
    sketch : QuantileSketch
        Of the distances.
    of_blocks : (k, 2) array
        Number of readings and sum of the distances of blocks of consecutive readings.
    """

    n: int = 0
    distance: float = 0.0
    squared: float = 0.0
    largest: float = field(default=0.0, metadata=joined(max))
    coordinate: float = 0.0
    largest_coordinate: float = field(default=0.0, metadata=joined(max))
    sketch: QuantileSketch = field(default_factory=QuantileSketch)
    of_blocks: FloatArray = field(default_factory=partial(np.zeros, (0, 2)), metadata=joined(one_below_the_other))

    @classmethod
    def of(cls, predicted: FloatArray, points: FloatArray, n_session: int | None = None) -> PointErrorSums:
        """Sums over points (n, 3), a part of a session; rows of `points` that are NaN (no point) are ignored [mm]."""
        errors = (predicted - points)[~np.isnan(points).all(axis=1)]
        if not len(errors):
            return cls()
        distances, sizes = np.linalg.norm(errors, axis=1), np.abs(errors)
        starts = block_starts(len(errors), n_session)
        counts = np.diff(np.append(starts, len(errors)))
        return cls(
            len(errors),
            float(distances.sum()),
            float(distances @ distances),
            float(distances.max()),
            float(sizes.sum()),
            float(sizes.max()),
            QuantileSketch.of(distances),
            np.stack([counts, np.add.reduceat(distances, starts)], axis=1),
        )

    def errors(self) -> PointErrors:
        """The errors as `point_errors` gives them; the 95 % quantile to 0.1 %.

        Raises
        ------
        InputError
            If no reading has a reference point.
        """
        if not self.n:
            raise InputError("expected one or more readings to evaluate, got none")
        return PointErrors(
            mean_mm=self.distance / self.n,
            rms_mm=float(np.sqrt(self.squared / self.n)),
            p95_mm=self.sketch.quantile(0.95),
            max_mm=self.largest,
            mean_abs_coordinate_mm=self.coordinate / (3 * self.n),
            max_abs_coordinate_mm=self.largest_coordinate,
            n=self.n,
        )

    def effective_number(self) -> tuple[float, bool]:
        """Independent readings of whose distances the mean would be known as well, and whether that is settled."""
        mean = self.distance / self.n
        variance = max(self.squared / self.n - mean**2, 1e-30)
        scores = self.of_blocks[:, 1] - mean * self.of_blocks[:, 0]
        effect = design_effect(scores[:, None], np.array([[1 / (self.n * variance)]]), self.n)
        return self.n / effect.factor, effect.is_settled

    def standard_error_mm(self) -> float:
        """Standard error of the mean distance, by the effective number of readings [mm]."""
        mean = self.distance / self.n
        return float(np.sqrt(max(self.squared / self.n - mean**2, 0.0) / self.effective_number()[0]))
