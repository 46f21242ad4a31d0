"""``mapminmax``: every row onto [-1, 1], and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class MinMaxScaler:
    """The affine map that takes `lower` to -1 and `upper` to 1, row by row.

    Attributes
    ----------
    lower, upper : (k,) array
        In the units of the data.
    """

    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, data: FloatArray, *, what: str) -> Self:
        """The map of the range of `data` (k, n), samples in columns.

        Raises
        ------
        InputError
            If a row is constant: it has no range. MATLAB's ``mapminmax`` lets such a row through unscaled.
        """
        lower, upper = data.min(axis=1), data.max(axis=1)
        if not (lower < upper).all():
            row = int(np.argmin(lower < upper))
            raise InputError(
                f"{what} {row + 1} is {lower[row]:.6g} in all {data.shape[1]} samples: a network cannot learn from it",
                hint="leave it out, or collect readings in which it varies",
            )
        return cls(lower, upper)

    @property
    def half_range(self) -> FloatArray:
        """(k,) data units per scaled unit."""
        return (self.upper - self.lower) / 2

    def scale(self, data: FloatArray) -> FloatArray:
        """Data (k, n) onto [-1, 1] (beyond it for data beyond the range)."""
        return (data - (self.lower + self.half_range)[:, None]) / self.half_range[:, None]

    def unscale(self, scaled: FloatArray) -> FloatArray:
        """Scaled values (k, n) back in data units."""
        return scaled * self.half_range[:, None] + (self.lower + self.half_range)[:, None]
