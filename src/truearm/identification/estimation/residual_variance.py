"""What a model cannot explain, sized so that its stated uncertainty holds what it should on readings it did not see."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.stats import chi2

from truearm.typing import FloatArray

LEVEL = 0.95
FLOOR_MM2 = 1e-12  # a nanometre squared
# Where what others know of a reading has, in some direction, so many times its own variance, it says nothing of that.
MOST_OPEN = 100.0


@dataclass(frozen=True, eq=False)
class HeldOutReadings:
    """Readings as models saw them that did not learn from them.

    Attributes
    ----------
    rows : (m,) int array
        The readings.
    group : (m,) int array
        Which were held out together: a position, a seat.
    deviations : (m, 3) array
        Predicted less known point; in a seat, less its place by the other groups' readings of it, or, where there are
        none, less the mean of the points predicted in it [mm].
    covariance : (m, 3, 3) array
        Of the deviations by what the training left open, and by the reference [mm^2].
    freedom : (m,) array
        Share of a deviation's own variance that is left in it: 1, of n readings about their own mean 1 - 1/n.
    """

    rows: npt.NDArray[np.intp]
    group: npt.NDArray[np.intp]
    deviations: FloatArray
    covariance: FloatArray
    freedom: FloatArray

    def select_informative(self, own_mm2: FloatArray) -> HeldOutReadings:
        """Select the readings that say something of their own variance: the other groups know where they are.

        Where those leave a direction open, as they do with most of a session's readings its frame, the covariance has
        all that a prior allows, and a reading is held by it whatever its own variance; it may not count as held.

        Parameters
        ----------
        own_mm2 : (m,) array
            Variance of a coordinate of each, about [mm^2].
        """
        judging = np.linalg.eigvalsh(self.covariance)[:, -1] <= MOST_OPEN * own_mm2
        return HeldOutReadings(*(getattr(self, part.name)[judging] for part in fields(self)))

    @property
    def errors_mm(self) -> FloatArray:
        """(m,) lengths of the deviations, those about a seat's own mean for a seat of many readings [mm]."""
        return np.asarray(np.linalg.norm(self.deviations, axis=1) / np.sqrt(self.freedom))

    @property
    def mean_mm(self) -> float:
        """Mean error [mm]."""
        return float(self.errors_mm.mean())

    @property
    def standard_error_mm(self) -> float:
        """Of the mean, from its scatter between groups [mm]."""
        errors = self.errors_mm
        group = np.unique(self.group, return_inverse=True)[1]
        counts = np.bincount(group)
        sums = np.bincount(group, errors)
        if len(counts) < 2:  # no scatter between groups to go by: that of the readings
            return float(errors.std(ddof=1) / np.sqrt(len(errors))) if len(errors) > 1 else float("inf")
        scatter = sums - counts * self.mean_mm
        return float(np.sqrt((scatter**2).sum() * len(counts) / (len(counts) - 1)) / counts.sum())


def conformal_residual_variance(held_out: HeldOutReadings, *, level: float = LEVEL) -> float:
    """The variance v of a coordinate for which ellipsoids hold a share `level` of the readings held out.

    With it added to their covariances, the squared Mahalanobis length that the share stays below is that of three
    Gaussian coordinates. The order statistic is that of conformal prediction, number ``ceil((m + 1) level)`` of m, so
    that a new reading is held with at least that probability where readings are exchangeable (V. Vovk, A. Gammerman,
    G. Shafer, "Algorithmic Learning in a Random World", 2005, section 2.2).

    Returns
    -------
    float
        [mm^2].
    """
    m = len(held_out.rows)
    values, vectors = np.linalg.eigh(held_out.covariance)
    squares = np.einsum("nij,ni->nj", vectors, held_out.deviations) ** 2
    rank = min(int(np.ceil((m + 1) * level)), m) - 1
    radius = float(chi2.ppf(level, 3))

    def excess(log_v: float) -> float:
        variance = np.maximum(values, 0.0) + np.exp(log_v) * held_out.freedom[:, None]
        return float(np.partition((squares / variance).sum(axis=1), rank)[rank]) - radius

    lowest = float(np.log(FLOOR_MM2))
    highest = float(np.log(squares.sum(axis=1).max() / held_out.freedom.min() + 2 * FLOOR_MM2))
    if excess(lowest) <= 0:
        return FLOOR_MM2
    return float(np.exp(brentq(excess, lowest, highest, xtol=1e-6)))
