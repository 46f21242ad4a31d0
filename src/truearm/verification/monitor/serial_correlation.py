"""What an unchanged process lets expect of its next value, and the evidence that it has changed.

The temperature of the room, a fixture or an operator make checks of consecutive days resemble each other. Limits for
independent values are then too narrow: of unchanged series with a correlation of 0.5, half have an alarm within 30
checks. The process is autoregressive of order one about an unknown mean, with an unknown scatter and an unknown
correlation rho of consecutive values, up to 0.75. With ten values rho has a standard uncertainty of 0.3, so that
none is estimated and then taken for true:

- *limits*: those of the prediction (residual chart: L. C. Alwan, H. V. Roberts, J. Business & Economic Statistics 6
  (1988) 87 [recalled]) for every rho that the values leave plausible, the widest of them;
- *a change*: the likelihood of the values with a step or a straight drift, over that of the values without one **for
  the rho that explains them best**, so that a wave of correlated values is no change. For each time of its beginning
  the ratio is that of location-scale invariants, whose mean is 1 at most without a change, whatever rho is; their sum
  over all times exceeds a number c once in c values on average, at most (Shiryaev and Roberts; J. Shin, A. Ramdas,
  A. Rinaldo, "E-detectors", 2022 [recalled]).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, logsumexp, stdtr, stdtrit

from truearm.typing import FloatArray

CORRELATIONS = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75])
"""Possible correlations of consecutive values.

None is negative: nothing makes checks alternate. So few values do not distinguish larger ones from a drift.
"""

LEAST_MM = 1e-6
"""A nanometre: values do not repeat better, or a smaller scatter is irrelevant."""

PLAUSIBLE = 2.0
"""Logarithm of the likelihood by which a plausible correlation explains the values less well than the best one."""

STEP = 2.0
"""Standard deviation of the change that is looked for, in standard deviations of the process."""

DRIFT = 10.0
"""Checks in which a drift that is looked for becomes as large as such a step."""

LEAST_BEFORE = LEAST_AFTER = 2
"""Values before a change that is looked for, and from it on."""


class Prediction(NamedTuple):
    """What to expect of the next value: the mean of the process, and limits."""

    mean: float
    lower: float
    upper: float


class AutoregressiveSeries:
    """Values of a process whose consecutive values may correlate.

    For each correlation rho the values are made independent: ``e = (x - r x') / sqrt(1 - r^2)`` with the value x'
    before and ``r = rho^distance``. Mean and scatter of the e are those of generalised least squares.

    Parameters
    ----------
    values : (n,) array
        Two or more [mm].
    at : (n,) array
        Their times; 1 is the distance of consecutive values.
    least : float
        The least standard deviation of the process [mm].
    correlations : (k,) array, optional
        Possible correlations; with 0 alone values are independent.
    """

    def __init__(
        self, values: FloatArray, at: FloatArray, *, least: float = LEAST_MM, correlations: FloatArray = CORRELATIONS
    ) -> None:
        self.n, self._rho, self._times = len(values), correlations, np.asarray(at, dtype=float)
        self._first, self._last = float(values[0]), float(values[-1] - values[0])
        x = values - values[0]
        r = np.zeros((len(correlations), self.n))
        r[:, 1:] = correlations[:, None] ** np.diff(at)
        self._r, self._free = r, 1 - r * r
        root = np.sqrt(self._free)
        self._e, self._w = (x - r * np.r_[0.0, x[:-1]]) / root, (1 - r) / root
        self._ww, self._we = (self._w**2).sum(axis=1), (self._w * self._e).sum(axis=1)
        self._floor = (self.n - 1) * least**2
        self._squares = np.maximum((self._e**2).sum(axis=1) - self._we**2 / self._ww, self._floor)
        degrees = (self.n - 1) * np.log(self._squares)
        self._log = -(np.log(self._free).sum(axis=1) + np.log(self._ww) + degrees) / 2  # of the likelihood of rho

    def predict(self, at: float, score: float) -> Prediction:
        """Predict the value at a time, with limits of a standard normal score on either side."""
        r = self._rho ** (at - self._times[-1])
        mean = self._we / self._ww
        location = self._first + r * self._last + (1 - r) * mean
        scale = np.sqrt(self._squares / (self.n - 1) * (1 - r * r + (1 - r) ** 2 / self._ww))
        half = -stdtrit(self.n - 1, np.exp(log_ndtr(-score))) * scale
        of = self._log >= self._log.max() - PLAUSIBLE
        weight = np.exp(self._log - self._log.max())
        middle = self._first + float(weight @ mean / weight.sum())
        return Prediction(middle, float((location - half)[of].min()), float((location + half)[of].max()))

    def correlation(self) -> tuple[float, float, float]:
        """The mean of the correlation of consecutive values, and bounds with a probability of 95 % each."""
        weight = np.exp(self._log - self._log.max()) if self.n > 2 else np.ones(len(self._rho))
        total = np.cumsum(weight) / weight.sum()
        low, high = (float(self._rho[np.searchsorted(total, share)]) for share in (0.05, 0.95))
        return float(self._rho @ weight / weight.sum()), low, high

    def evidence(self, *, upper_only: bool) -> float:
        """Return the decimal logarithm of the evidence for a change, both directions together; -inf of too few values.

        A change is a step or a straight drift; one is as likely as the other.
        """
        first = np.arange(LEAST_BEFORE, self.n - LEAST_AFTER + 1)[:, None]
        if not len(first):
            return -np.inf
        steps = (np.arange(self.n) >= first).astype(float)
        drifts = np.maximum(self._times - self._times[first - 1], 0.0) / DRIFT
        shapes = np.concatenate([steps, drifts])[:, None]
        before = np.concatenate([np.zeros_like(shapes[..., :1]), shapes[..., :-1]], axis=-1)
        whitened = (shapes - self._r * before) / np.sqrt(self._free)
        with_mean = (whitened * self._w).sum(axis=-1)
        precision = (whitened**2).sum(axis=-1) - with_mean**2 / self._ww + STEP**-2
        size = ((whitened * self._e).sum(axis=-1) - with_mean * self._we / self._ww) / precision
        left = np.maximum(self._squares - size**2 * precision, self._floor)
        degrees = self.n - 1
        log_ratio = -np.log(STEP**2 * precision) / 2 - degrees / 2 * np.log(left / self._squares)
        share = stdtr(degrees, size * np.sqrt(precision * degrees / left)) if upper_only else 1.0
        with np.errstate(divide="ignore"):
            log = self._log + log_ratio + np.log(share / len(self._rho))  # of two shapes, twice a side of each
        return float((logsumexp(log) - self._log.max()) / np.log(10))
