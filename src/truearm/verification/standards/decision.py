"""The uncertainty of a test value, and the decision by ISO 14253-1.

Sources: JCGM 100:2008 (GUM), sections 5.1.2, 6.2 and G.4; ISO 14253-1:2013 with the whole expanded uncertainty on both
sides of a limit, as recalled, not confirmed against its text (the default of its 2017 edition, as recalled, is a
probability of conformity of 95 %, for a small u a guard band of some 1.65 u; it is not used here).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from math import erf, hypot, inf, isfinite, isinf, sqrt
from typing import Literal

from truearm.errors import InputError

DecisionRule = Literal["iso14253-1", "simple"]
DECISION_RULES: tuple[DecisionRule, ...] = ("iso14253-1", "simple")

# Two-sided, of a normal distribution within two standard deviations: k = 2 for infinite degrees of freedom.
COVERAGE_PROBABILITY = erf(2 / sqrt(2))
# Simple acceptance needs limits of this many times the expanded uncertainty: the "4:1 rule" of laboratories.
SIMPLE_RATIO = 4.0


class Verdict(Enum):
    """The conformity of a test value with a specification."""

    CONFORM = "conform"
    NOT_CONFORM = "not conform"
    UNDECIDED = "undecided"


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
        if isinf(self.dof):
            return 2.0
        from scipy.stats import t

        # Neither the rounding of a sum nor a single contribution may reduce the integer.
        return float(t.ppf((1 + COVERAGE_PROBABILITY) / 2, max(1, int(self.dof * (1 + 1e-12)))))

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
    """

    label: str
    value: float
    unit: str
    budget: Budget
    limit: float | None
    verdict: Verdict | None
    where: str = ""

    @property
    def name(self) -> str:
        """The test, with position and run where one test has several rows."""
        return f"{self.label}, {self.where}" if self.where else self.label

    @property
    def uncertainty(self) -> float:
        """Expanded uncertainty of the value."""
        return self.budget.expanded


def decide(value: float, uncertainty: float, limit: float, *, rule: DecisionRule = "iso14253-1") -> Verdict:
    """Decide on the conformity of a test value.

    Parameters
    ----------
    value : float
        Test value; its magnitude is compared.
    uncertainty : float
        Expanded uncertainty of it.
    limit : float
        Maximum permissible error, positive.
    rule : {"iso14253-1", "simple"}
        ISO 14253-1 for a supplier who proves conformity and a customer who proves the contrary: conform if
        ``|value| + U <= limit``, not conform if ``|value| - U > limit``, else undecided. Simple acceptance ignores
        an uncertainty of at most the limit over `SIMPLE_RATIO`; where it is larger, ISO 14253-1 applies.

    Raises
    ------
    InputError
        If the value is not finite, the uncertainty is negative or not finite, or the limit is not positive.
    """
    if not isfinite(value):
        raise InputError(f"expected a finite test value, got {value}")
    if not (isfinite(uncertainty) and uncertainty >= 0):
        raise InputError(f"expected an expanded uncertainty of 0 or more, got {uncertainty}")
    if not (isfinite(limit) and limit > 0):
        raise InputError(f"expected a positive limit, got {limit}")
    if rule == "simple" and simple_applies(uncertainty, limit):
        return Verdict.CONFORM if abs(value) <= limit else Verdict.NOT_CONFORM
    if abs(value) + uncertainty <= limit:
        return Verdict.CONFORM
    return Verdict.NOT_CONFORM if abs(value) - uncertainty > limit else Verdict.UNDECIDED


def simple_applies(uncertainty: float, limit: float) -> bool:
    """Whether an expanded uncertainty is small enough against a limit for simple acceptance."""
    return uncertainty * SIMPLE_RATIO <= limit


def assess_conformity(
    label: str,
    value: float,
    budget: Budget,
    limit: float | None,
    *,
    rule: DecisionRule,
    where: str = "",
) -> ConformityResult:
    """Return the row of a test value in mm, with the verdict where there is a limit."""
    verdict = None if limit is None else decide(value, budget.expanded, limit, rule=rule)
    return ConformityResult(label, value, "mm", budget, limit, verdict, where)


def worst_result(rows: Sequence[ConformityResult]) -> ConformityResult:
    """Return the decisive row of a test: the one with the worst verdict and, among those, nearest to its limit."""
    return max(
        rows,
        key=lambda row: (
            -1 if row.verdict is None else _ORDER.index(row.verdict),
            abs(row.value) + row.uncertainty - (row.limit or 0.0),
        ),
    )


def overall_verdict(rows: Iterable[ConformityResult]) -> Verdict | None:
    """Return the verdict of a verification: conform if every row with a limit conforms; None without limits."""
    verdicts = [row.verdict for row in rows if row.verdict is not None]
    return max(verdicts, key=_ORDER.index) if verdicts else None
