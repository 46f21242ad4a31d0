"""Ranges of the inputs of a large session, as sums that are added over its parts, for the conditions of a training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from truearm.compensation.models.training_conditions import InputRange, TrainingConditions
from truearm.readings.session import Session
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class InputRanges:
    """Number, sum, sum of squares, least and largest value of inputs.

    Attributes
    ----------
    n : int
    by_name : mapping of str to (4, k) array
        Of ``"angles"`` and ``"directions"`` (k joints), ``"temperature"`` and further columns (k = 1): the sum and that
        of the squares, the least, the largest.
    """

    n: int
    by_name: Mapping[str, FloatArray]

    @classmethod
    def of(cls, session: Session) -> InputRanges:
        """Of the readings of a session."""
        inputs = {"angles": session.angles, "directions": session.directions, "temperature": session.temperature_degC}
        values = {
            name: value.reshape(len(session), -1)
            for name, value in (inputs | dict(session.columns)).items()
            if value is not None
        }
        found = {
            name: np.stack([value.sum(axis=0), (value**2).sum(axis=0), value.min(axis=0), value.max(axis=0)])
            for name, value in values.items()
        }
        return cls(len(session), found)

    def __add__(self, other: InputRanges) -> InputRanges:
        """Of both; of no reading there are none yet."""
        if not self.n or not other.n:
            return other if other.n else self
        pairs = {name: (values, other.by_name[name]) for name, values in self.by_name.items()}
        return InputRanges(
            self.n + other.n,
            {
                name: np.stack([a[0] + b[0], a[1] + b[1], np.minimum(a[2], b[2]), np.maximum(a[3], b[3])])
                for name, (a, b) in pairs.items()
            },
        )

    def conditions(self, of_sample: TrainingConditions) -> TrainingConditions:
        """The conditions of all readings, where those of an evenly spaced sample are known.

        Gaps between the angles, temperatures of slow links, rounding and the fingerprint stay those of the sample.
        """
        directions = self.by_name.get("directions")
        return replace(
            of_sample,
            n_readings=self.n,
            angle_ranges=self.by_name["angles"][2:].T,
            temperature_degC=None if of_sample.temperature_degC is None else self._range("temperature"),
            columns={name: self._range(name) for name in of_sample.columns},
            direction_ranges=None if directions is None else directions[2:].T,
        )

    def _range(self, name: str) -> InputRange:
        total, squares, least, largest = self.by_name[name][:, 0].tolist()
        mean = total / self.n
        return InputRange(mean, max(squares / self.n - mean**2, 0.0), least, largest)
