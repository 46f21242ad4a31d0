"""The uncertainty of a test value, and the decision by ISO 14253-1.

Sources: JCGM 100:2008 (GUM), sections 5.1.2, 6.2 and G.4; JCGM 106:2012, section 7, for the probability of conformity.
ISO 14253-1 is recalled, not confirmed against its text: the default of the edition of 2017 is a probability of 95 % of
conformity, or of nonconformity; the edition of 2013, withdrawn, has the whole expanded uncertainty on both sides.

The uncertainty of a test value from the statistic that it is: artefact and set-up, propagated through it.

A test value is a number made of many readings: a mean, a range, 2s, the diameter of a sphere. What is wanted is its
difference from the value that *the same readings* would have given with a perfect artefact and a perfect set-up. The
errors of the arm are in both: they are what the test is about (ISO 14253-5, ISO 23165 [recalled]). Some errors of
artefact and set-up are common to many readings, such as the calibration of a length, and leave a range or 2s of
readings of that length as they are; others, such as the fixture, are new in each reading and average out of a mean.

A linear statistic has a closed form (JCGM 100:2008, 5.1.2). The others are carried out on drawn readings (JCGM
101:2008, 7), from a fixed seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from math import erf, hypot, inf, isfinite, isinf, sqrt
from typing import get_args

import numpy as np
from scipy.special import stdtr, stdtrit

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory import DecisionRule as DecisionRule

DECISION_RULES: tuple[DecisionRule, ...] = get_args(DecisionRule)

# Two-sided, of a normal distribution within two standard deviations: k = 2 for infinite degrees of freedom.
COVERAGE_PROBABILITY = erf(2 / sqrt(2))
# Of the edition of 2017, one-sided for a small uncertainty: a guard band of 1.645 u [recalled, not confirmed].
CONFORMANCE_PROBABILITY = 0.95
# Simple acceptance needs limits of this many times the expanded uncertainty: the "4:1 rule" of laboratories.
SIMPLE_RATIO = 4.0


class Verdict(Enum):
    """The conformity of a test value, or of an arm, with a specification.

    Of an arm alone: not for conformity decisions, where nobody has confirmed the numbers of the test plan.
    """

    CONFORM = "conform"
    NOT_CONFORM = "not conform"
    UNDECIDED = "undecided"
    NOT_FOR_DECISIONS = "not for conformity decisions"

    def describe(self, *, decides: bool) -> str:
        """The verdict of a value in a word; where it decides nothing, on which side of its limit the value is."""
        return self.value if decides else _SIDES.get(self, self.value)


_SIDES = {Verdict.CONFORM: "within limit", Verdict.NOT_CONFORM: "outside limit"}


# From good to bad.
_ORDER = (Verdict.CONFORM, Verdict.UNDECIDED, Verdict.NOT_CONFORM)


@dataclass(frozen=True)
class Contribution:
    """One line of an uncertainty budget.

    Parameters
    ----------
    label : str
        Its source.
    u : float
        Standard uncertainty of the test value due to it, in the unit of the test value, with its sensitivity.
    dof : float, optional
        Its degrees of freedom; infinite by default.

    Raises
    ------
    InputError
        If `u` is negative or not finite, or `dof` not positive.
    """

    label: str
    u: float
    dof: float = inf

    def __post_init__(self) -> None:
        if not (isfinite(self.u) and self.u >= 0):
            raise InputError(f"{self.label}: expected a standard uncertainty of 0 or more, got {self.u}")
        if not self.dof > 0:
            raise InputError(f"{self.label}: expected positive degrees of freedom, got {self.dof}")


@dataclass(frozen=True)
class Budget:
    """The uncertainty of a test value as a list of contributions, independent of each other."""

    contributions: tuple[Contribution, ...] = ()

    @property
    def u(self) -> float:
        """Combined standard uncertainty: the root of the sum of squares (GUM 5.1.2)."""
        return hypot(*(one.u for one in self.contributions))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom by Welch and Satterthwaite (GUM G.4.1, equation G.2b)."""
        largest = max((one.u for one in self.contributions), default=0.0)
        if largest == 0:
            return inf
        shares = [(one.u / largest, one.dof) for one in self.contributions]
        spent = sum(share**4 / dof for share, dof in shares)
        return inf if spent == 0 else sum(share**2 for share, _ in shares) ** 2 / spent

    @cached_property
    def coverage_factor(self) -> float:
        """Student's t for `COVERAGE_PROBABILITY` and the truncated degrees of freedom (GUM G.4.1, note 1)."""
        return 2.0 if isinf(self.dof) else _quantile((1 + COVERAGE_PROBABILITY) / 2, self.dof)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k u."""
        return self.coverage_factor * self.u


@dataclass(frozen=True)
class ConformityResult:
    """One line of a verification's table.

    Attributes
    ----------
    label : str
        The test.
    value : float
        The test value.
    unit : str
    budget : Budget
        Contributions of artefact and set-up, not of the arm (ISO 23165, recalled).
    limit : float or None
        Maximum permissible error or limit; None where the specification states none.
    verdict : Verdict or None
        None where there is no limit.
    where : str
        Position, length and run of the value.
    individual : tuple of ConformityResult
        The individual results of which this is the decisive one; empty where there is no other.
    in_rated_conditions : bool
        Whether the value was measured within the rated conditions of its limit; otherwise it is undecided.
    """

    label: str
    value: float
    unit: str
    budget: Budget
    limit: float | None
    verdict: Verdict | None
    where: str = ""
    individual: tuple[ConformityResult, ...] = field(default=(), repr=False, compare=False)
    in_rated_conditions: bool = True

    @property
    def name(self) -> str:
        """The test, with position and run where one test has several rows."""
        return f"{self.label}, {self.where}" if self.where else self.label

    @property
    def uncertainty(self) -> float:
        """Expanded uncertainty of the value."""
        return self.budget.expanded

    @property
    def conformance_probability(self) -> float | None:
        """Probability that the quantity lies within its limit; None where there is none."""
        if self.limit is None:
            return None
        return conformance_probability(self.value, self.budget.u, self.limit, dof=self.budget.dof)

    def undecided_zone(self, rule: DecisionRule) -> tuple[float, float] | None:
        """Magnitudes of the value between which a rule decides nothing; None where there is no limit."""
        if self.limit is None:
            return None
        return undecided_zone(self.budget, self.limit, rule=rule)


def conformance_probability(value: float, u: float, limit: float, *, dof: float = inf) -> float:
    """Return the probability that a quantity lies within ``-limit`` and ``limit``.

    For a normal distribution about the value, or Student's t for finite degrees of freedom (JCGM 106:2012, 7.2 and
    7.4): ``p = F((limit - value) / u) - F((-limit - value) / u)``. For a quantity that is never negative the lower
    limit makes p smaller, noticeably only if u is more than a third of the limit.

    Parameters
    ----------
    value : float
        Test value, with its sign.
    u : float
        Standard uncertainty of it; 0 gives the probability 0 or 1.
    limit : float
        Positive, in the same unit.
    dof : float
        Degrees of freedom of `u`.

    Raises
    ------
    InputError
        As `decide`.
    """
    _check(value, u, limit)
    value = abs(value)
    if u == 0:
        return float(value <= limit)
    return _cumulative((limit - value) / u, dof) - _cumulative((-limit - value) / u, dof)


def undecided_zone(budget: Budget, limit: float, *, rule: DecisionRule) -> tuple[float, float]:
    """Return the magnitudes of a value between which a rule decides nothing: up to the first it conforms.

    The zone is empty with simple acceptance, and begins at 0 where the uncertainty is too large for any value to
    conform.
    """
    expanded = budget.expanded
    if rule == "simple" and simple_applies(expanded, limit):
        return limit, limit
    if rule != "iso14253-1:2017":
        return max(limit - expanded, 0.0), limit + expanded
    u, dof = budget.u, budget.dof

    def excess(value: float) -> float:
        return conformance_probability(value, u, limit, dof=dof) - CONFORMANCE_PROBABILITY

    beyond = limit + _quantile(CONFORMANCE_PROBABILITY, dof) * u
    if excess(0.0) <= 0:
        return 0.0, beyond
    from scipy.optimize import brentq

    return (limit if u == 0 else float(brentq(excess, 0.0, limit))), beyond


def decide(
    value: float, uncertainty: float, limit: float, *, rule: DecisionRule = "iso14253-1:2017", dof: float = inf
) -> Verdict:
    """Decide on the conformity of a test value.

    Parameters
    ----------
    value : float
        Test value; its magnitude is compared.
    uncertainty : float
        Expanded uncertainty of it, ``U = k u``.
    limit : float
        Maximum permissible error, positive.
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}
        Two editions of ISO 14253-1, for a supplier who proves conformity and a customer who proves the contrary. 2013:
        conform if ``|value| + U <= limit``, not conform if ``|value| - U > limit``, else undecided. 2017: conform if
        `conformance_probability` is `CONFORMANCE_PROBABILITY` or more, not conform if the quantity is beyond the limit
        on the value's side with that probability. (Mass beyond the other limit proves no nonconformity: it grows
        without bound with the uncertainty.) Simple acceptance ignores an uncertainty of at most the limit over
        `SIMPLE_RATIO`; where it is larger, the edition of 2013 applies.
    dof : float
        Effective degrees of freedom of the uncertainty.

    Raises
    ------
    InputError
        If the value is not finite, the uncertainty is negative or not finite, or the limit is not positive.
    """
    _check(value, uncertainty, limit)
    size = abs(value)
    if rule == "iso14253-1:2017":
        u = uncertainty / (2.0 if isinf(dof) else _quantile((1 + COVERAGE_PROBABILITY) / 2, dof))
        if conformance_probability(value, u, limit, dof=dof) >= CONFORMANCE_PROBABILITY:
            return Verdict.CONFORM
        beyond = size > limit and size - limit >= _quantile(CONFORMANCE_PROBABILITY, dof) * u
        return Verdict.NOT_CONFORM if beyond else Verdict.UNDECIDED
    if rule == "simple" and simple_applies(uncertainty, limit):
        return Verdict.CONFORM if size <= limit else Verdict.NOT_CONFORM
    if size + uncertainty <= limit:
        return Verdict.CONFORM
    return Verdict.NOT_CONFORM if size - uncertainty > limit else Verdict.UNDECIDED


def _check(value: float, uncertainty: float, limit: float) -> None:
    if not isfinite(value):
        raise InputError(f"expected a finite test value, got {value}")
    if not (isfinite(uncertainty) and uncertainty >= 0):
        raise InputError(f"expected an uncertainty of 0 or more, got {uncertainty}")
    if not (isfinite(limit) and limit > 0):
        raise InputError(f"expected a positive limit, got {limit}")


def _whole(dof: float) -> float:
    """Degrees of freedom truncated to an integer (GUM G.4.1, note 1): neither rounding of a sum may reduce it."""
    return dof if isinf(dof) else max(1, int(dof * (1 + 1e-12)))


def _quantile(probability: float, dof: float) -> float:
    return float(stdtrit(_whole(dof), probability))


def _cumulative(t: float, dof: float) -> float:
    return float(stdtr(_whole(dof), t))


def simple_applies(uncertainty: float, limit: float) -> bool:
    """Whether an expanded uncertainty is small enough against a limit for simple acceptance."""
    return uncertainty * SIMPLE_RATIO <= limit


def assess_conformity(
    label: str, value: float, budget: Budget, limit: float | None, *, rule: DecisionRule, where: str = ""
) -> ConformityResult:
    """Return the row of a test value in mm, with the verdict where there is a limit."""
    verdict = None if limit is None else decide(value, budget.expanded, limit, rule=rule, dof=budget.dof)
    return ConformityResult(label, value, "mm", budget, limit, verdict, where)


def outside_rated_conditions(row: ConformityResult) -> ConformityResult:
    """Return a row and its individual ones without a decision: a limit applies within the rated conditions only."""
    individual = tuple(map(outside_rated_conditions, row.individual))
    verdict = None if row.verdict is None else Verdict.UNDECIDED
    return replace(row, verdict=verdict, individual=individual, in_rated_conditions=False)


def worst_result(rows: Sequence[ConformityResult]) -> ConformityResult:
    """Return the decisive row of a test, with all rows as its individual results.

    It is the one with the worst verdict and, among those, nearest to its limit.
    """
    worst = max(
        rows,
        key=lambda row: (
            -1 if row.verdict is None else _ORDER.index(row.verdict),
            abs(row.value) + row.uncertainty - (row.limit or 0.0),
        ),
    )
    return replace(worst, individual=tuple(rows))


def overall_verdict(rows: Iterable[ConformityResult]) -> Verdict | None:
    """Return the verdict of a verification: conform if every row with a limit conforms; None without limits."""
    verdicts = [row.verdict for row in rows if row.verdict is not None]
    return max(verdicts, key=_ORDER.index) if verdicts else None


Statistic = Callable[[FloatArray], FloatArray]
"""A test value of readings: (m, n) or (m, n, 3) in, (m,) out [mm]."""

DRAWS = 1000
"""Draws of all errors: their root mean square is known to 2.2 %."""

_SEED = 20


@dataclass(frozen=True, eq=False)
class ErrorSource:
    """A cause of errors in artefact or set-up, and what it does to each reading of a test.

    Attributes
    ----------
    label : str
        Its line in the budget.
    effects : (k, n) or (k, n, 3) array
        The errors of n readings by each of k independent standard deviations [mm]: one row for an error that all
        readings have in common, a diagonal for one that is new in each.
    dof : float
        Degrees of freedom of its standard uncertainty.
    """

    label: str
    effects: FloatArray
    dof: float = inf


def in_each(label: str, u: float | FloatArray, shape: tuple[int, ...]) -> ErrorSource:
    """A source that is new in each of readings of a shape, (n,) or (n, 3), with standard uncertainty u [mm]."""
    size = int(np.prod(shape))
    return ErrorSource(label, np.diag(np.broadcast_to(u, shape).ravel()).reshape(size, *shape))


def linear_budget(weights: FloatArray, sources: Sequence[ErrorSource]) -> Budget:
    """Return the budget of a weighted sum of readings, exactly.

    Parameters
    ----------
    weights : (n,) array
        Of the readings: (1,) for a single reading, 1/n each for their mean.
    sources : sequence of ErrorSource
    """
    return Budget(tuple(Contribution(one.label, hypot(*(one.effects @ weights)), one.dof) for one in sources))


def drawn_budget(readings: FloatArray, statistic: Statistic, sources: Sequence[ErrorSource]) -> Budget:
    """Return the budget of any statistic of readings, by drawing the errors.

    Parameters
    ----------
    readings : (n,) or (n, 3) array
        As measured [mm].
    statistic : callable
        The test value of (m, n) or (m, n, 3) readings, (m,) [mm].
    sources : sequence of ErrorSource

    Notes
    -----
    The standard uncertainty is the root mean square of the change of the value, and so contains its bias: errors of
    artefact and set-up make a range, a scatter or a maximum larger on average. The value itself is not corrected, as
    the standards define it by the readings (JCGM 100:2008, F.2.4.5 [recalled], for a correction that is not applied).

    The readings scatter by the arm *and* by artefact and set-up. Before the errors are drawn the readings are drawn
    towards their mean, until their variance is what it would be without: an arm that is hardly worse than its set-up
    would otherwise have too small an uncertainty.

    The lines of the budget are the root mean squares of each source alone, times one factor, so that their squares add
    to that of all together.

    Examples
    --------
    >>> import numpy as np
    >>> common = ErrorSource("calibration", np.full((1, 3), 0.010))
    >>> deviations = np.array([0.01, 0.02, -0.03])
    >>> f"{drawn_budget(deviations, value_range, [common]).u:.4f}"  # it moves both ends of the range
    '0.0000'
    """
    rng = np.random.default_rng(_SEED)
    errors = [np.tensordot(rng.standard_normal((DRAWS, len(one.effects))), one.effects, 1) for one in sources]
    if not errors:
        return Budget()
    together: FloatArray = np.sum(errors, axis=0)
    middle = readings.mean(axis=0)
    own, added = float(((readings - middle) ** 2).sum()), float(together.var(axis=1).sum() / DRAWS * len(readings))
    without = middle + np.sqrt(max(0.0, 1 - added / own) if own > 0 else 0.0) * (readings - middle)
    reference = statistic(without[None])

    def rms(error: FloatArray) -> float:
        if not error.any():
            return 0.0
        return float(np.sqrt(((statistic(without + error) - reference) ** 2).mean()))

    alone = [rms(one) for one in errors]
    factor = rms(together) / hypot(*alone) if any(alone) else 0.0
    return Budget(tuple(Contribution(one.label, factor * u, one.dof) for one, u in zip(sources, alone, strict=True)))


# Statistics that test plans name; the last axis is that of the readings.


def value_range(deviations: FloatArray) -> FloatArray:
    """The range: the largest less the smallest."""
    return np.asarray(np.ptp(deviations, axis=-1))


def two_s(deviations: FloatArray) -> FloatArray:
    """``2 s`` about their mean, divisor n - 1."""
    return np.asarray(2 * deviations.std(axis=-1, ddof=1))


def two_rms(deviations: FloatArray) -> FloatArray:
    """``2 RMS`` about zero, divisor n: it contains the scale error."""
    return np.asarray(2 * np.sqrt((deviations**2).mean(axis=-1)))


def _distances(points: FloatArray) -> FloatArray:
    """Distances of points (.., n, 3) from their mean, (.., n)."""
    away = points - points.mean(axis=-2, keepdims=True)
    return np.asarray(np.sqrt(np.einsum("...c,...c", away, away)))


def largest_distance(points: FloatArray) -> FloatArray:
    """The largest distance of points (.., n, 3) from their mean."""
    return np.asarray(_distances(points).max(axis=-1))


def two_s_of_points(points: FloatArray) -> FloatArray:
    """``2 s`` with ``s^2 = sum d^2 / (n - 1)`` of the distances d of points (.., n, 3) from their mean."""
    return np.asarray(2 * np.sqrt((_distances(points) ** 2).sum(axis=-1) / (points.shape[-2] - 1)))


def half_range(points: FloatArray) -> FloatArray:
    """Half the range of the worst coordinate of points (.., n, 3)."""
    return np.asarray(np.ptp(points, axis=-2).max(axis=-1) / 2)


def farthest_pair(points: FloatArray) -> FloatArray:
    """The largest distance between two of points (.., n, 3)."""
    away = points[..., :, None, :] - points[..., None, :, :]
    return np.asarray(np.sqrt(np.einsum("...c,...c", away, away).max(axis=(-2, -1))))
