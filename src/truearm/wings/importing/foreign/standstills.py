"""Standstills in a log: when every coordinate stays within a span for a stated time, and the mean over such a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.typing import BoolArray, FloatArray, IntArray

# Samples of the running median, which removes a stray sample, and the width of noise that it leaves: the range of a
# window of it, in standard deviations of single samples.
MEDIAN_SAMPLES, NOISE_RANGE = 5, 4.0
# A stray sample lies so many standard deviations from the median of its standstill.
STRAY_STDS = 5.0
# Standard deviation of normal numbers over their median magnitude.
OVER_MEDIAN = 1.4826


@dataclass(frozen=True, eq=False)
class Log:
    """Samples in the order of time, without those that were lost.

    Attributes
    ----------
    times : (n,) array
        Rising [s].
    values : (n, k) array
        Joint angles, or coordinates of the tip.
    rows : (n,) int array
        Where each sample stands in its table.
    """

    times: FloatArray
    values: FloatArray
    rows: IntArray

    @property
    def step(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else np.inf

    def noise(self) -> FloatArray:
        """(k,) standard deviations of single samples while nothing moves, with the steps in which they are written."""
        if len(self.times) < 10:
            return np.zeros(self.values.shape[1])
        second = np.diff(self.values, n=2, axis=0) / np.sqrt(6.0)
        length = max(5, len(second) // 200)
        blocks = second[: len(second) // length * length].reshape(-1, length, second.shape[1])
        return np.asarray(np.quantile(np.sqrt((blocks**2).mean(axis=1)), 0.2, axis=0))

    def smoothed(self) -> FloatArray:
        """Values by a running median."""
        from scipy.ndimage import median_filter

        return np.asarray(median_filter(self.values, size=(MEDIAN_SAMPLES, 1), mode="nearest"))


def standstills(log: Log, span: float | FloatArray, seconds: float) -> FloatArray:
    """Find the times in which all values stay within a span.

    Parameters
    ----------
    log : Log
    span : float or (k,) array
        In the unit of the values; what the noise of samples spans is added.
    seconds : float
        Least duration.

    Returns
    -------
    (m, 2) array
        First and last time of each [s]. A gap between samples of half of `seconds` ends a standstill.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    n = len(log.times)
    width = max(2, round(seconds / log.step) + 1) if n > 1 else 2
    if n < width:
        return np.empty((0, 2))
    values = log.smoothed()
    origin = -((width - 1) // 2)  # of filters that look at the window from a sample on
    first = slice(0, n - width + 1)
    top = maximum_filter1d(values, width, axis=0, origin=origin)
    ranges = (top - minimum_filter1d(values, width, axis=0, origin=origin))[first]
    lasts = log.times[width - 1 :] - log.times[first]
    still = (ranges <= span + NOISE_RANGE * log.noise()).all(axis=1) & (lasts <= 1.5 * seconds)
    covered = np.zeros(n + 1, dtype=np.intp)
    np.add.at(covered, np.flatnonzero(still), 1)
    np.add.at(covered, np.flatnonzero(still) + width, -1)
    inside: BoolArray = np.cumsum(covered[:n]) > 0
    gap = np.diff(log.times, prepend=log.times[0]) > max(0.5 * seconds, 1.5 * log.step)
    starts = np.flatnonzero(inside & (~np.r_[False, inside[:-1]] | gap))
    ends = np.flatnonzero(inside & (~np.r_[inside[1:], False] | np.r_[gap[1:], False]))
    return np.stack([log.times[starts], log.times[ends]], axis=1)


def common_times(first: FloatArray, second: FloatArray, seconds: float) -> FloatArray:
    """The longest time of each standstill in `first` that is also one in `second`, of some seconds at least."""
    found = []
    for start, end in first.tolist():
        near = second[(second[:, 1] > start) & (second[:, 0] < end)]
        both = np.clip(near, start, end)
        if len(both) and (longest := both[np.argmax(both[:, 1] - both[:, 0])])[1] - longest[0] >= seconds:
            found.append(longest)
    return np.array(found).reshape(-1, 2)


def robust_mean(values: FloatArray) -> tuple[FloatArray, float, int]:
    """Mean of samples (n, k) without stray ones; its standard uncertainty by their scatter, and how many it is of.

    The uncertainty is the root sum of squares over the k values. Neighbouring samples are alike, so n samples count as
    ``n (1 - r) / (1 + r)``, with the correlation r of samples next to each other (G. V. Bayley, J. M. Hammersley,
    J. R. Stat. Soc. Suppl. 8 (1946) 184, for errors of the first autoregressive kind).
    """
    off = np.abs(values - np.median(values, axis=0))
    limit = STRAY_STDS * OVER_MEDIAN * np.median(off, axis=0)
    kept = values[(off <= np.maximum(limit, np.finfo(float).eps * np.abs(values).max())).all(axis=1)]
    kept = kept if 2 * len(kept) > len(values) else values
    mean = kept.mean(axis=0)
    away = kept - mean
    total = float((away**2).sum())
    n = len(kept)
    if n < 2 or total == 0:
        return mean, 0.0, n
    r = min(max(float((away[1:] * away[:-1]).sum()) / total, 0.0), 1 - 2 / n) if n > 2 else 0.0
    return mean, float(np.sqrt(total / (n - 1) / (n * (1 - r) / (1 + r)))), n
