"""Control charts of single values with unknown mean and standard deviation.

Each value is compared with its prediction from those before it. Of an unchanged process of independent values with
mean ``m`` and standard deviation ``s`` of the n values before, the next one makes ``T = (x - m) / (s sqrt(1 + 1/n))`` a
Student t of n - 1 degrees of freedom, and ``z = Phi^-1(F(T))`` standard normal, independent of the scores before: D. M.
Hawkins, "Self-starting CUSUM charts for location and scale", The Statistician 36 (1987) 299; C. P. Quesenberry, "SPC Q
charts for start-up processes and short or long runs", J. Quality Technology 23 (1991) 213. So the rate of false alarms
is as specified from the third value on. With limits of 2.66 mean moving ranges (M, 6.33) from a baseline of ten values
it is not: of unchanged series 24 % have a value beyond them within the next twenty, in place of 5.3 %. Consecutive
values may correlate: the prediction is the mixture of `serial_correlation`, of which that of Hawkins is one component.

Two rules watch the scores. Limits (Shewhart's chart of individuals, ISO 7870-2) see a large change at once; two
one-sided cumulative sums (ISO 7870-4; E. S. Page, Biometrika 41 (1954) 100) see a small or slow one. Formulae marked M
are those of D. C. Montgomery, "Introduction to Statistical Quality Control", chapters 6 and 9. Standards and books were
not available: they are cited from memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import exp, expm1, isfinite

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.verification.monitor.serial_correlation import (
    CORRELATIONS,
    LEAST_MM,
    AutoregressiveBaseline,
    Prediction,
    prediction_limits,
)

MIN_BASELINE_CHECKS = 10
"""Values of an unchanged process that a chart needs.

With fewer, a step often becomes part of the baseline before it is detected. Where six charts share the false alarms, a
step of three standard deviations is detected, in half of the cases, within five values after twenty, and within four
after forty; after ten, half of the steps become part of the baseline (simulated, 2000 series).
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

DETECTED_WITHIN = 5
"""Values after a step of three standard deviations in which half are detected, after twenty unchanged ones."""

FALSE_ALARMS = 0.0027
"""Of limits of three standard deviations (M, 6.1): one value in 370 of an unchanged process is beyond them.

The limits together have this rate, and the cumulative sums together have it once more, however many charts there are.
"""

_LONG_PAUSE = 1000.0  # in typical distances: nothing is left of any correlation

REFERENCE_VALUE = 0.5
"""k of the cumulative sums, in standard deviations: quickest for a change of one of them (M, 9.1.3)."""


@dataclass(frozen=True)
class ControlRules:
    """The rules that detect a change, for charts that are assessed together.

    Attributes
    ----------
    limit : float
        The limit of the scores.
    decision_interval : float
        h: a cumulative sum above it signals a drift.
    """

    limit: float
    decision_interval: float


@cache
def control_rules(n_sides: int) -> ControlRules:
    """Return the rules of charts with `n_sides` sides in all: two for a value that may rise or fall, else one.

    The sides share the false alarms evenly. One chart with two sides has the limits of the textbooks: 3 standard
    deviations, k = 0.5, h = 4.77 (M, table 9.4).

    Parameters
    ----------
    n_sides : int
        One or more.
    """
    rate = FALSE_ALARMS / n_sides  # of each side; Bonferroni: the sum is the rate of all, or more than it
    return ControlRules(-float(ndtri(rate)), _decision_interval(1 / rate))


def _decision_interval(run_length: float) -> float:
    """The h that gives a one-sided sum of an unchanged process this average run length.

    Siegmund's approximation (M, 9.6): ``ARL = (exp(2 k b) - 2 k b - 1) / (2 k^2)`` with ``b = h + 1.166``, solved by
    Newton's steps from above, where the function is convex.
    """
    target = 2 * REFERENCE_VALUE**2 * run_length
    y = float(np.log1p(target)) + 2.0  # of exp(y) - y - 1 = target
    for _ in range(50):
        y -= (expm1(y) - y - target) / expm1(y)
    assert isfinite(exp(y))
    return y / (2 * REFERENCE_VALUE) - 1.166


@dataclass(frozen=True, eq=False)
class ControlChart:
    """A series of values and the result of the rules for each.

    Attributes
    ----------
    values : (n,) array
        [mm]
    n_before : (n,) int array
        Number of values of the unchanged process with which each was compared.
    scores : (n,) array
        Standard normal if nothing has changed; NaN with fewer than two values before.
    centre, lower, upper : (n,) array
        Mean of the values before, and the limits for the next [mm]; NaN where there are none. The limits lie about the
        prediction, which is nearer to the last value than the mean where consecutive values correlate.
    cusum : (2, n) array
        The cumulative sums upwards and downwards, in standard deviations.
    out_of_limits : (n,) bool array
        Whether the value is beyond its limits.
    signal_index : int or None
        The first value at which a cumulative sum was above the decision interval.
    change_index : int or None
        The first value of the change that this sum signals.
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
    scores: FloatArray
    centre: FloatArray
    lower: FloatArray
    upper: FloatArray
    cusum: FloatArray
    out_of_limits: BoolArray
    signal_index: int | None
    change_index: int | None
    gradual: bool
    n_baseline: int
    correlation: tuple[float, float, float]
    rules: ControlRules

    @property
    def since(self) -> int | None:
        """The first value of the present change; None where nothing has changed.

        The signal of a cumulative sum is permanent. A value beyond the limits counts while it is the last one, or while
        all later ones are beyond the same limit: dirt in a seat may cause a single one, and one on either side.
        """
        if self.change_index is not None:
            return self.change_index
        with_last = self.out_of_limits & (np.sign(self.scores) == np.sign(self.scores[-1]))
        others = np.flatnonzero(~with_last)
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
    upper_only: bool = False,
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
        Whether values are scatters, never negative. Their power 2/3 is charted, which is nearly normal: E. B. Wilson,
        M. M. Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684.
    upper_only : bool
        Whether only larger values are a change for the worse.
    correlations : (k,) array
        Possible correlations of consecutive values, see `serial_correlation`.

    Notes
    -----
    A value beyond its limits does not enter the baseline, nor does any after the signal of a cumulative sum: the
    baseline is then that of the values before the change. In the sums a score counts at most as much as the limit, so
    that a single value cannot raise one above the decision interval. A value beyond its limits without a neighbour
    beyond the same limit is removed from the sums with the next value: "two in a row" of J. M. Lucas, R. B.
    Crosier, Commun. Statist. Theory Meth. 11 (1982) 2669 [recalled].

    The probabilities of the correlations are those at the last zero of the larger cumulative sum: later values may
    belong to a change, and a step looks like a large correlation, which would hide it.
    """
    given, floor = np.array(values, dtype=float), np.array(u, dtype=float)
    each = (rules,) * len(given) if isinstance(rules, ControlRules) else tuple(rules)
    sides = (1.0,) if upper_only else (1.0, -1.0)
    n, gradual = len(given), False
    gaps = np.ones(n) if days is None else _gaps(np.array(days, dtype=float))
    n_before = np.zeros(n, np.intp)
    scores = np.full(n, np.nan)
    drift = np.zeros((2, n))
    beyond = np.zeros(n, bool)
    signal_index: int | None = None
    changed: int | None = None
    charted = given ** (2 / 3) if scale else given
    baseline, predictions = AutoregressiveBaseline(correlations), dict[int, Prediction]()
    unsuspected = [np.zeros(len(correlations))] * 2
    for i, rule in enumerate(each):
        n_before[i] = baseline.n
        baseline.elapse(gaps[i])
        if baseline.n >= 2:
            unsuspected = [
                baseline.log_weights if signal_index is not None or drift[side, i - 1] == 0 else unsuspected[side]
                for side in (0, 1)
            ]
            weights = unsuspected[int(drift[:, i - 1].argmax())]
            least = _least(baseline.mean, float(floor[i]), baseline.n, scale)
            predictions[i] = baseline.predict(weights, least=least)
            scores[i] = score = predictions[i].score(charted[i])
            beyond[i] = score > rule.limit if upper_only else abs(score) > rule.limit
            last = i - 2 if _alone(i - 1, scores, beyond) else i - 1
            counted = min(max(score, -rule.limit), rule.limit)
            for side, sign in enumerate(sides):
                # C = max(0, C + z - k), M 9.2 and 9.3
                drift[side, i] = max(0.0, drift[side, last] + sign * counted - REFERENCE_VALUE)
            if signal_index is None and max(drift[0, i], drift[1, i]) > rule.decision_interval:
                zero = int(np.flatnonzero(drift[int(drift[:, i].argmax()), :i] == 0)[-1])
                rows = np.array([j for j in range(i + 1) if j > zero or not beyond[j]])
                signal_index, (changed, gradual) = i, _change(rows, charted[rows])
                baseline = _before(changed, charted, gaps, beyond, correlations)
                baseline.elapse(float(gaps[changed : i + 1].sum()))
        if signal_index is None and not beyond[i]:
            baseline.add(float(charted[i]))
    centre, lower, upper = _lines(predictions, each, scale)
    if upper_only:
        lower = np.full(n, np.nan)
    return ControlChart(
        given,
        n_before,
        scores,
        centre,
        lower,
        upper,
        drift,
        beyond,
        signal_index,
        changed,
        gradual,
        baseline.n,
        baseline.correlation(),
        each[-1],
    )


def _lines(
    predictions: Mapping[int, Prediction], rules: Sequence[ControlRules], scale: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Centre, lower and upper limit of each value; NaN where there is no prediction."""
    lines = np.full((3, len(rules)), np.nan)
    if predictions:
        at = list(predictions)
        low, high = prediction_limits(list(predictions.values()), np.array([rules[i].limit for i in at]))
        lines[:, at] = [one.mean for one in predictions.values()], low, high
    if scale:
        lines = np.where(np.isnan(lines), np.nan, np.maximum(lines, 0.0) ** 1.5)
    return lines[0], lines[1], lines[2]


def _before(
    changed: int, charted: FloatArray, gaps: FloatArray, beyond: BoolArray, correlations: FloatArray
) -> AutoregressiveBaseline:
    """The baseline of the values before a change."""
    baseline = AutoregressiveBaseline(correlations)
    for j in range(changed):
        baseline.elapse(gaps[j])
        if not beyond[j]:
            baseline.add(float(charted[j]))
    return baseline


def _alone(i: int, scores: FloatArray, beyond: BoolArray) -> bool:
    """Whether value i, which has a next one, is beyond its limits without a neighbour beyond the same limit."""
    sides = [beyond[j] and np.sign(scores[j]) == np.sign(scores[i]) for j in (i - 1, i + 1)]
    return bool(beyond[i] and not any(sides))


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
    the row after the last zero of the cumulative sum, which is often above zero by chance before the change.

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
