"""The uncertainty of a test value, and the decision by ISO 14253-1.

Sources: JCGM 100:2008 (GUM), sections 5.1.2, 6.2 and G.4; JCGM 106:2012, section 7, for the probability of conformity.
ISO 14253-1 is recalled, not confirmed against its text: the default of the edition of 2017 is a probability of 95 % of
conformity, or of nonconformity; the edition of 2013, withdrawn, has the whole expanded uncertainty on both sides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from math import erf, hypot, inf, isfinite, isinf, sqrt
from typing import get_args

from scipy.special import stdtr, stdtrit

from truearm.errors import InputError
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
