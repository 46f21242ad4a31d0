"""Ranges of the inputs of a large session, as sums that are added over its parts, for the conditions of a training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from truearm.models.training_conditions import InputRange, TrainingConditions
from truearm.readings.session import Session
from truearm.solve.sums import Sums, joined
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Spread(Sums):
    """Sum, sum of squares, least and largest value of k inputs, (k,) arrays."""

    total: FloatArray
    squares: FloatArray
    least: FloatArray = field(metadata=joined(np.minimum))
    largest: FloatArray = field(metadata=joined(np.maximum))


@dataclass(frozen=True, eq=False)
class InputRanges(Sums):
    """The inputs of n readings.

    Attributes
    ----------
    n : int
    by_name : mapping of str to Spread
        Of ``"angles"`` and ``"directions"`` (k joints), ``"temperature"`` and further columns (k = 1).
    """

    n: int = 0
    by_name: Mapping[str, Spread] = field(default_factory=dict)

    @classmethod
    def of(cls, session: Session) -> InputRanges:
        """Of the readings of a session."""
        inputs = {"angles": session.angles, "directions": session.directions, "temperature": session.temperature_degC}
        columns = {
            name: value.reshape(len(session), -1)
            for name, value in (inputs | dict(session.columns)).items()
            if value is not None
        }
        found = {
            name: Spread(value.sum(axis=0), (value**2).sum(axis=0), value.min(axis=0), value.max(axis=0))
            for name, value in columns.items()
        }
        return cls(len(session), found)

    def conditions(self, of_sample: TrainingConditions) -> TrainingConditions:
        """The conditions of all readings, where those of an evenly spaced sample are known.

        Gaps between the angles, temperatures of slow links, rounding and the fingerprint stay those of the sample.
        """
        angles, directions = self.by_name["angles"], self.by_name.get("directions")
        return replace(
            of_sample,
            n_readings=self.n,
            angle_ranges=np.stack([angles.least, angles.largest], axis=1),
            temperature_degC=None if of_sample.temperature_degC is None else self._range("temperature"),
            columns={name: self._range(name) for name in of_sample.columns},
            direction_ranges=None if directions is None else np.stack([directions.least, directions.largest], axis=1),
        )

    def _range(self, name: str) -> InputRange:
        of = self.by_name[name]
        mean = float(of.total[0]) / self.n
        return InputRange(
            mean, max(float(of.squares[0]) / self.n - mean**2, 0.0), float(of.least[0]), float(of.largest[0])
        )
