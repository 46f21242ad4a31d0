"""What to expect of the next value of an unchanged process whose consecutive values may correlate.

The temperature of the room, a fixture or an operator make checks of consecutive days resemble each other. Limits for
independent values are then too narrow: of unchanged series with a correlation of 0.5, half have an alarm within 30
checks. The process is autoregressive of order one about an unknown mean, with an unknown scatter and an unknown
correlation rho of consecutive values; each value is compared with its prediction from those before (residual chart:
L. C. Alwan, H. V. Roberts, J. Business & Economic Statistics 6 (1988) 87 [recalled]). No value of rho is estimated and
then taken for true: with ten values its standard uncertainty is 0.3. The predictions for all rho are weighted with
their probability after the values so far (A. P. Dawid, J. Royal Statistical Society A 147 (1984) 278 [recalled]).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from truearm.typing import FloatArray

CORRELATIONS = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.85])
"""Possible correlations of consecutive values, equally probable before the first value.

None is negative: nothing makes checks alternate. So few values do not distinguish larger ones from a drift.
"""

LEAST_MM = 1e-6
"""A nanometre: values do not repeat better, or a smaller scatter is irrelevant."""


_BISECTIONS = 40  # to 1e-12 of the distance between the components' limits


@dataclass(frozen=True, eq=False)
class Prediction:
    """The distribution of the next value: a mixture of Student's t, one component for each correlation.

    Attributes
    ----------
    location, scale, weight : (k,) array
        Of the components; the weights sum to 1.
    dof : int
        Degrees of freedom of all components.
    mean : float
        The estimate of the process mean.
    """

    location: FloatArray
    scale: FloatArray
    weight: FloatArray
    dof: int
    mean: float

    def score(self, value: float) -> float:
        """The standard normal score of a value; of the smaller tail, which keeps its digits far out."""
        t = (value - self.location) / self.scale
        low, high = (float(self.weight @ stdtr(self.dof, tail)) for tail in (t, -t))
        return float(ndtri(max(low, 1e-300)) if low < high else -ndtri(max(high, 1e-300)))


def prediction_limits(predictions: Sequence[Prediction], scores: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The values whose scores are ``-score`` and ``score`` in each prediction, by bisection between the components'.

    Parameters
    ----------
    predictions : sequence of Prediction
        n of them, with k components each.
    scores : (n,) array
    """
    location, scale, weight = (
        np.stack([getattr(one, name) for one in predictions]) for name in ("location", "scale", "weight")
    )
    dof, tail = np.array([[one.dof] for one in predictions]), ndtr(-scores)[:, None]
    half = -stdtrit(dof, tail) * scale
    found = []
    for side in (-1.0, 1.0):
        low, high = (edge(side * location + half, axis=1) for edge in (np.min, np.max))
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            t = (side * location - middle[:, None]) / scale
            is_beyond = (weight * stdtr(dof, t)).sum(axis=1) < tail[:, 0]
            low, high = np.where(is_beyond, low, middle), np.where(is_beyond, middle, high)
        found.append(side * (low + high) / 2)
    return found[0], found[1]


class AutoregressiveBaseline:
    """The values of an unchanged process, added one at a time, and what follows for the next.

    For each correlation rho the values are made independent: ``e = (x - r x') / sqrt(1 - r^2)`` with the value x'
    before and ``r = rho^gap``. Mean and scatter of the e are those of generalised least squares.

    Parameters
    ----------
    correlations : (k,) array, optional
        Possible correlations; with 0 alone the predictions are those of independent values.
    """

    def __init__(self, correlations: FloatArray = CORRELATIONS) -> None:
        self.n = 0
        self._rho = correlations
        self._first = self._last = 0.0
        self._gap = 0.0
        # Sums over the values e, their weights w of the mean, and the logarithms of their variances.
        self._ww, self._we, self._ee, self._log = np.zeros((4, len(correlations)))

    def elapse(self, gap: float) -> None:
        """Let a distance pass; 1 is that of consecutive values. Values that are not added leave a larger one."""
        self._gap += gap

    def add(self, value: float) -> None:
        """Add the value that is here."""
        if self.n == 0:
            self._first = value
        x = value - self._first
        r, free = self._memory()
        e, w = (x - r * self._last) / np.sqrt(free), (1 - r) / np.sqrt(free)
        self._ww += w * w
        self._we += w * e
        self._ee += e * e
        self._log += np.log(free)
        self.n, self._last, self._gap = self.n + 1, x, 0.0

    @property
    def mean(self) -> float:
        """The mean of the values, for the most probable correlation."""
        best = int(self.log_weights.argmax())
        return self._first + float(self._we[best] / self._ww[best])

    @property
    def log_weights(self) -> FloatArray:
        """Logarithms of the probabilities of the correlations after the values so far, up to a constant, (k,)."""
        weights: FloatArray = -(self._log + np.log(self._ww) + (self.n - 1) * np.log(self._squares())) / 2
        return weights

    def predict(self, log_weights: FloatArray, *, least: float) -> Prediction:
        """Predict the value that is here, from two or more.

        Parameters
        ----------
        log_weights : (k,) array
            `log_weights`, of these values or of earlier ones.
        least : float
            The least standard deviation of the process.
        """
        weight = np.exp(log_weights - log_weights.max())
        weight /= weight.sum()
        r, free = self._memory()
        mean = self._we / self._ww
        spread = np.maximum(np.sqrt(self._squares() / (self.n - 1)), least)
        scale = spread * np.sqrt(free + (1 - r) ** 2 / self._ww)
        location = self._first + r * self._last + (1 - r) * mean
        return Prediction(location, scale, weight, self.n - 1, self._first + float(weight @ mean))

    def correlation(self) -> tuple[float, float, float]:
        """The mean of the correlation of consecutive values, and bounds with a probability of 95 % each."""
        weight = np.exp(self.log_weights - self.log_weights.max()) if self.n > 2 else np.ones(len(self._rho))
        total = np.cumsum(weight) / weight.sum()
        low, high = (float(self._rho[np.searchsorted(total, share)]) for share in (0.05, 0.95))
        return float(self._rho @ weight / weight.sum()), low, high

    def _squares(self) -> FloatArray:
        squares: FloatArray = np.maximum(self._ee - self._we**2 / self._ww, (self.n - 1) * LEAST_MM**2)
        return squares

    def _memory(self) -> tuple[FloatArray, FloatArray]:
        """What is left of the last value here, and the variance that is free, as shares."""
        r = np.zeros(len(self._rho)) if self.n == 0 else self._rho**self._gap
        return r, 1 - r * r
