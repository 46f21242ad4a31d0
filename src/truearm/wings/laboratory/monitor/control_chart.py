"""Control charts of single values with unknown mean and standard deviation.

Each value is compared with those before it, as in charts for start-up processes (D. M. Hawkins, The Statistician 36
(1987) 299; C. P. Quesenberry, J. Quality Technology 23 (1991) 213): limits from the few values that there are, which
grow narrower with each. Consecutive values may correlate. Two rules watch them: limits
(Shewhart's chart of individuals, ISO 7870-2) see a large change at once; the evidence for a change sees a small or slow
one. Formulae marked M are those of D. C. Montgomery, "Introduction to Statistical Quality Control", chapter 6.
Standards and books were not available: they are cited from memory.

What an unchanged process lets expect of its next value, and the evidence that it has changed.

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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr, logsumexp, ndtri, stdtr, stdtrit

from truearm.typing import BoolArray, FloatArray, IntArray

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


MIN_BASELINE_CHECKS = 10
"""Values of an unchanged process that a chart needs.

With fewer, a step often becomes part of the baseline before it is detected.
"""

CHECKS_NEEDED = MIN_BASELINE_CHECKS + 1
"""The first check that can say that nothing has changed: the one after the baseline. People count checks, this one
included."""

MIN_LIMIT_VALUES = 5
"""Values before a value from which its limits are shown.

Student's t makes the limits from n values ``t(n - 1) sqrt(1 + 1/n)`` standard deviations wide. Where six charts share
the false alarms, those from five values are 3 times as wide as those from many, from four 5 times, from three 13 times,
from two 340 times: millimetres for an arm that repeats to micrometres. They are right, and nobody can use them.
"""

MIN_CORRELATION_VALUES = 10
"""Values of an unchanged process from which the correlation of consecutive ones is stated.

The standard uncertainty of the correlation that n independent values show is about ``1 / sqrt(n)``: 0.3 with ten values
(M. S. Bartlett, J. Royal Statistical Society Suppl. 8 (1946) 27 [recalled]). With fewer, it would say nothing.
"""

DETECTED_WITHIN = 12
"""Values after a step of three standard deviations in which half are detected, after twenty unchanged ones."""

FALSE_ALARMS = 0.0027
"""Of limits of three standard deviations (M, 6.1): one value in 370 of an unchanged process is beyond them.

The limits together have this rate, and the evidence together once more, however many charts there are.
"""

ODDS = 75.0
"""The evidence for a change that the rate of false alarms permits a single one-sided chart.

1/370 would permit 370, as a bound for every correlation. By simulation 75 gives that rate
with correlations of 0.3 to 0.7, and a smaller one with less.
"""

_LONG_PAUSE = 1000.0  # in typical distances: nothing is left of any correlation


@dataclass(frozen=True)
class ControlRules:
    """The rules that detect a change, for charts that are assessed together.

    Attributes
    ----------
    limit : float
        The limit of the scores.
    evidence : float
        Decimal logarithm of the evidence that shows a change.
    """

    limit: float
    evidence: float


@cache
def control_rules(n_sides: int) -> ControlRules:
    """Return the rules of charts with `n_sides` sides in all: two for a value that may rise or fall, else one.

    The sides share the false alarms evenly. One chart with two sides has the limits of the textbooks, 3 standard
    deviations.

    Parameters
    ----------
    n_sides : int
        One or more.
    """
    # Bonferroni: the sum over the sides is the rate of all, or more than it; so is the mean of their evidence.
    return ControlRules(-float(ndtri(FALSE_ALARMS / n_sides)), float(np.log10(ODDS * n_sides)))


@dataclass(frozen=True, eq=False)
class ControlChart:
    """A series of values and the result of the rules for each.

    Attributes
    ----------
    values : (n,) array
        [mm]
    n_before : (n,) int array
        Number of values of the unchanged process with which each was compared.
    centre, lower, upper : (n,) array
        Mean of the values before, and the limits for the next [mm]; NaN where there are none. The limits lie about the
        prediction, which is nearer to the last value than the mean where consecutive values correlate.
    beyond : (n,) int array
        1 where the value is above its limits, -1 below, else 0.
    evidence : (n,) array
        Decimal logarithm of the evidence for a change up to each value; -inf with too few values.
    signal_index : int or None
        The first value at which the evidence showed a change.
    change_index : int or None
        The first value of that change.
    gradual : bool
        Whether a drift fits that change better than a step.
    n_baseline : int
        Number of values of the unchanged process after the last value.
    correlation : (float, float, float)
        Of consecutive values of the unchanged process: the mean, and bounds with a probability of 95 % each.
    rules : ControlRules
        Those of the last value.
    """

    values: FloatArray
    n_before: IntArray
    centre: FloatArray
    lower: FloatArray
    upper: FloatArray
    beyond: IntArray
    evidence: FloatArray
    signal_index: int | None
    change_index: int | None
    gradual: bool
    n_baseline: int
    correlation: tuple[float, float, float]
    rules: ControlRules

    @property
    def out_of_limits(self) -> BoolArray:
        """Whether each value is beyond its limits, (n,)."""
        return np.asarray(self.beyond != 0)

    @property
    def since(self) -> int | None:
        """The first value of the present change; None where nothing has changed.

        A change that the evidence shows is permanent. A value beyond the limits counts while it is the last, or while
        all later ones are beyond the same limit: dirt in a seat may cause a single one, and one on either side.
        """
        if self.change_index is not None:
            return self.change_index
        others = np.flatnonzero((self.beyond == 0) | (self.beyond != self.beyond[-1]))
        first = int(others[-1]) + 1 if len(others) else 0
        return first if first < len(self.values) else None

    @property
    def shows_limits(self) -> BoolArray:
        """Whether the limits of each value are worth showing (`MIN_LIMIT_VALUES`), (n,): always of one beyond them."""
        return (self.n_before >= MIN_LIMIT_VALUES) | self.out_of_limits

    @property
    def shows_correlation(self) -> bool:
        """Whether there are enough values to state the correlation of consecutive ones."""
        return self.n_baseline >= MIN_CORRELATION_VALUES

    @property
    def enough(self) -> bool:
        """Whether the last value was compared with enough values for the statement that nothing has changed."""
        return bool(self.n_before[-1] >= MIN_BASELINE_CHECKS)


def control_chart(
    values: npt.ArrayLike,
    *,
    u: npt.ArrayLike,
    rules: ControlRules | Sequence[ControlRules],
    days: npt.ArrayLike | None = None,
    scale: bool = False,
    correlations: FloatArray = CORRELATIONS,
) -> ControlChart:
    """Make the control chart of a series of values.

    Parameters
    ----------
    values : (n,) array
        In the order of measurement [mm].
    u : (n,) array
        Expected standard deviation of each [mm]: the least one of the process while there are fewer than
        `MIN_BASELINE_CHECKS` values; later the values alone determine it.
    rules : ControlRules or sequence of ControlRules
        For all values, or for each.
    days : (n,) array, optional
        Times of the measurements [d]; by default equal steps. Values correlate less over a pause.
    scale : bool
        Whether values are scatters, never negative, of which only larger ones are a change for the worse. Their power
        2/3 is charted, which is nearly normal: E. B. Wilson, M. M. Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684.
    correlations : (k,) array
        Possible correlations of consecutive values.

    Notes
    -----
    A value beyond its limits does not enter the baseline, nor does any from a change on. Without a neighbour beyond the
    same limit it does not count for the evidence either: dirt in a seat is no change ("two in a row" of J. M. Lucas,
    R. B. Crosier, Commun. Statist. Theory Meth. 11 (1982) 2669 [recalled]).
    """
    given, floor = np.array(values, dtype=float), np.array(u, dtype=float)
    each = (rules,) * len(given) if isinstance(rules, ControlRules) else tuple(rules)
    n, gradual = len(given), False
    at = np.cumsum(np.ones(n) if days is None else _gaps(np.array(days, dtype=float)))
    n_before, beyond = np.zeros((2, n), np.intp)
    lines, evidence = np.full((3, n), np.nan), np.full(n, -np.inf)
    signal_index: int | None = None
    changed: int | None = None
    charted = given ** (2 / 3) if scale else given

    def series(rows: IntArray, i: int) -> AutoregressiveSeries:
        least = _least(float(charted[rows].mean()), float(floor[i]), len(rows), scale)
        return AutoregressiveSeries(charted[rows], at[rows], least=least, correlations=correlations)

    for i, rule in enumerate(each):
        before = np.flatnonzero(beyond[: i if changed is None else changed] == 0)
        n_before[i] = len(before)
        if len(before) < 2:
            continue
        lines[:, i] = _, low, high = series(before, i).predict(at[i], rule.limit)
        beyond[i] = int(charted[i] > high) - int(charted[i] < low and not scale)
        if signal_index is None:
            judged = np.array([j for j in range(i + 1) if not _alone(j, beyond[: i + 1])])
            evidence[i] = series(judged, i).evidence(upper_only=scale)
            if evidence[i] > rule.evidence:
                signal_index, (changed, gradual) = i, _change(judged, charted[judged])
        else:
            evidence[i] = evidence[i - 1]
    if scale:
        lines = np.where(np.isnan(lines), np.nan, np.maximum(lines, 0.0) ** 1.5)
        lines[1] = np.nan
    baseline = np.flatnonzero(beyond[:changed] == 0)
    correlation = (
        series(baseline, n - 1).correlation()
        if len(baseline) > 1
        else (float(correlations.mean()), *correlations[[0, -1]])
    )
    centre, lower, upper = lines
    return ControlChart(
        given,
        n_before,
        centre,
        lower,
        upper,
        beyond,
        evidence,
        signal_index,
        changed,
        gradual,
        len(baseline),
        correlation,
        each[-1],
    )


def _alone(i: int, beyond: IntArray) -> bool:
    """Whether value i is beyond its limits without a neighbour beyond the same limit."""
    return bool(beyond[i] != 0 and (beyond[max(i - 1, 0) : i + 2] == beyond[i]).sum() == 1)


def _gaps(days: FloatArray) -> FloatArray:
    """Distances between consecutive values, in typical ones so far: a long pause makes values independent."""
    away, gaps = np.diff(days), np.ones(len(days))
    for i in range(1, len(away)):
        typical = float(np.median(away[:i]))
        if away[i] > typical:
            gaps[i + 1] = min(away[i] / typical, _LONG_PAUSE) if typical > 0 else _LONG_PAUSE
    return gaps


def _least(mean: float, u: float, n: int, scale: bool) -> float:
    """The least standard deviation of a charted value; `u` as `control_chart` has it."""
    least = LEAST_MM if n >= MIN_BASELINE_CHECKS else max(LEAST_MM, u)
    # To first order, of the power 2/3 of a value with that mean: d(x^(2/3)) = 2/3 x^(-1/3) dx.
    return least * 2 / 3 * mean**-0.5 if scale and mean > 0 else least


def _change(rows: IntArray, values: FloatArray) -> tuple[int, bool]:
    """Date a change: the first row of it, and whether it is gradual.

    By least squares, which is maximum likelihood for normal values: a constant, and from some row on either another one
    (J. J. Pignatiello, T. R. Samuel, J. Quality Technology 33 (2001) 82) or a straight line up or down (M. B. Perry,
    J. J. Pignatiello, Quality Technology & Quantitative Management 3 (2006) 325). For a step this is more accurate than
    the row after the last zero of a cumulative sum.

    Parameters
    ----------
    rows : (n,) int array
        Numbers of the values, three or more, increasing.
    values : (n,) array
    """
    at = rows[2:, None]  # at least two belong to the unchanged process
    jump = (rows >= at).astype(float)
    ramp = np.maximum(rows - at + 1.0, 0.0)[:-1]  # a ramp of one value is a step
    shapes = np.concatenate([jump, ramp])
    shapes -= shapes.mean(axis=1, keepdims=True)
    # The reduction of the sum of squares by each shape times its best factor.
    explained = (shapes @ (values - values.mean())) ** 2 / (shapes**2).sum(axis=1)
    best = int(explained.argmax())
    gradual = best >= len(jump)
    return int(rows[2 + best - len(jump) * gradual]), gradual
