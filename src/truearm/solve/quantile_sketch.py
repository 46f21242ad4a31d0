"""Quantiles of many positive numbers to a relative accuracy, from counts that are added over parts.

Numbers are counted in bins whose limits grow by a constant factor: C. Masson, J. E. Rim, H. K. Lee, "DDSketch: a fast
and fully-mergeable quantile sketch with relative-error guarantees", Proc. VLDB Endow. 12 (2019) 2195.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from truearm.solve.sums import Sums
from truearm.typing import FloatArray, IntArray

# Relative accuracy of a quantile.
ACCURACY = 1e-3
# Smaller and larger numbers are counted as these.
SMALLEST, LARGEST = 1e-9, 1e9

_LOG_GROWTH = np.log((1 + ACCURACY) / (1 - ACCURACY))
_N_BINS = 2 + int(np.log(LARGEST / SMALLEST) / _LOG_GROWTH)


@dataclass(frozen=True, eq=False)
class QuantileSketch(Sums):
    """Counts of numbers in bins.

    Parameters
    ----------
    counts : (n_bins,) int array
    """

    counts: IntArray = field(default_factory=lambda: np.zeros(_N_BINS, np.int64))

    @classmethod
    def of(cls, values: FloatArray) -> QuantileSketch:
        """Count values (n,) of 0 or more."""
        logs = np.log(np.clip(values, SMALLEST, LARGEST) / SMALLEST)
        bins = (logs / _LOG_GROWTH).astype(np.intp)
        return cls(np.bincount(bins, minlength=_N_BINS).astype(np.int64))

    def quantile(self, share: float) -> float:
        """The value below which a share of the numbers lies, as `numpy.quantile`, to `ACCURACY`; NaN without numbers.

        Between two numbers it is interpolated: the median of two is their mean.
        """
        total = np.cumsum(self.counts)
        if not total[-1]:
            return float("nan")
        place = share * (total[-1] - 1)
        both = np.searchsorted(total, [np.floor(place), np.ceil(place)], side="right")
        lower, upper = SMALLEST * np.exp((both + 0.5) * _LOG_GROWTH)
        return float(lower + (place - np.floor(place)) * (upper - lower))
