"""The estimated error of a measured quantity, from the errors of many drawn arms.

JCGM 101:2008, "Propagation of distributions using a Monte Carlo method": the mean and the standard deviation of the
errors are the bias and the standard uncertainty (7.6), the coverage interval is the shortest one that contains 95 % of
them (5.3.4, 7.7.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.tasks.features import FeatureQuantity

COVERAGE_PROBABILITY = 0.95
_RESAMPLES = 200
# By simulation: the intervals then contain 95.0 to 95.1 % of a normal, a gamma and Student's distribution, n >= 1000.
SHORTEST = 0.47


@dataclass(frozen=True, eq=False)
class Estimate:
    """The distribution of a quantity's error of measurement.

    Attributes
    ----------
    quantity : FeatureQuantity
    errors : (n,) array
        Measured minus true value of every drawn arm [mm].
    systematic, random : (n,) array
        The same from the systematic errors alone, and from the random errors alone [mm].
    n_postures : int
        Sets of postures; draw i uses set ``i % n_postures``.
    """

    quantity: FeatureQuantity
    errors: FloatArray
    systematic: FloatArray
    random: FloatArray
    n_postures: int = 1

    @property
    def bias_mm(self) -> float:
        """Mean error."""
        return float(self.errors.mean())

    @property
    def u_mm(self) -> float:
        """Standard uncertainty: standard deviation of the errors about their mean (JCGM 101:2008, 7.6)."""
        return float(self.errors.std(ddof=1))

    @property
    def u_systematic_mm(self) -> float:
        """Systematic part: repetition of the same points does not reduce it."""
        return float(self.systematic.std(ddof=1))

    @property
    def u_random_mm(self) -> float:
        """Random part: more points reduce it."""
        return float(self.random.std(ddof=1))

    @cached_property
    def interval_mm(self) -> tuple[float, float]:
        """Shortest interval that contains 95 % of the errors."""
        low, high = shortest_interval(np.sort(self.errors)[None])
        return float(low[0]), float(high[0])

    @property
    def expanded_mm(self) -> float:
        """Expanded uncertainty U, which 95 % of the errors do not exceed in size."""
        return float(expanded_uncertainty(self.errors[None])[0])

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as plain data [mm]."""
        return {
            "name": self.quantity.name,
            "nominal_mm": self.quantity.nominal_mm,
            **{key: getattr(self, key) for key in ("bias_mm", "u_mm", "u_systematic_mm", "u_random_mm")},
            "interval_mm": list(self.interval_mm),
            "expanded_mm": self.expanded_mm,
            "standard_errors_mm": {key.removesuffix("_mm"): u for key, u in vars(self.standard_errors).items()},
        }

    @cached_property
    def standard_errors(self) -> StandardErrors:
        """Standard errors of bias, standard uncertainty and interval due to the finite number of draws, by bootstrap.

        B. Efron, "Bootstrap methods: another look at the jackknife", Ann. Stat. 7 (1979) 1; instead of the adaptive
        number of draws of JCGM 101:2008, 7.9. The sets of postures are random too, and fewer: draws of one set are
        resampled together. The larger of this and of the standard error by single draws is returned.
        """
        rng, n = np.random.default_rng(0), len(self.errors)
        each = rng.choice(self.errors, (_RESAMPLES, n))
        by_posture = self.errors[: n - n % self.n_postures].reshape(-1, self.n_postures)
        together = by_posture[:, rng.integers(self.n_postures, size=(_RESAMPLES, self.n_postures))]
        spreads = (_spreads(each), _spreads(together.transpose(1, 0, 2).reshape(_RESAMPLES, -1)))
        return StandardErrors(*np.maximum(*spreads).tolist())


@dataclass(frozen=True)
class StandardErrors:
    """Standard errors due to the finite number of draws [mm]."""

    bias_mm: float
    u_mm: float
    low_mm: float
    high_mm: float
    expanded_mm: float


def _spreads(drawn: FloatArray) -> FloatArray:
    """Standard deviations (5,) of the fields of `StandardErrors` over resampled errors (m, n)."""
    ordered = np.sort(drawn, axis=1)
    ends = shortest_interval(ordered)
    statistics = np.stack([ordered.mean(axis=1), ordered.std(axis=1, ddof=1), *ends, expanded_uncertainty(drawn)])
    spread: FloatArray = statistics.std(axis=1, ddof=1)
    return spread


def expanded_uncertainty(errors: FloatArray) -> FloatArray:
    """Half widths (m,) of the intervals about zero that contain 95 % of the errors (m, n).

    What a statement "value +- U" means, whatever bias the errors have. The farther end of the shortest interval
    is larger: by chance by 5 to 10 % of 1000 draws, and of a deviation of form, which is never negative, because 5 %
    of the errors are then outside on one side alone.
    """
    n = errors.shape[1]
    sizes: FloatArray = np.sort(np.abs(errors), axis=1)[:, min(int(np.ceil(COVERAGE_PROBABILITY * (n + 1))), n) - 1]
    return sizes


def shortest_interval(ordered: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends (m,) of the shortest intervals that contain 95 % of the draws (m, n), each row in ascending order.

    JCGM 101:2008, 7.7.4: of all intervals from the r-th to the (r + q)-th of n ordered values, the shortest; q is the
    integer nearest to 0.95 n. The shortest of many intervals is too short by chance (it contains 94.5 % of a normal
    distribution with n = 1000; that document assumes a million draws, 7.2.2), so q is increased by
    `SHORTEST` ``n^(1/3)``.
    """
    n = ordered.shape[1]
    q = min(int(COVERAGE_PROBABILITY * n + SHORTEST * n ** (1 / 3) + 0.5), n - 1)
    width = ordered[:, q:] - ordered[:, : n - q]
    first = width.argmin(axis=1)
    rows = np.arange(len(ordered))
    return ordered[rows, first], ordered[rows, first + q]


# Tolerance over the expanded uncertainty to both sides: the "4:1 rule" of laboratories.
GOOD_RATIO = 4.0


class FitnessDecision(Enum):
    """Whether an arm is fit for a tolerance."""

    YES = "yes"
    NO = "no"
    GUARDED = "only with guard bands"


@dataclass(frozen=True)
class Fitness:
    """Fitness of an arm for a tolerance.

    Attributes
    ----------
    tolerance_mm : float
        Width T of the tolerance zone: 0.1 for +-0.05 mm; the permitted deviation if the zone is one-sided, as of form.
    answer : FitnessDecision
    ratio : float
        T / 2U, or T / U of a one-sided zone.
    acceptance_zone_mm : float
        Width of the zone in which a measured value proves conformity: T - 2U, or T - U if one-sided; zero or more.
    """

    tolerance_mm: float
    answer: FitnessDecision
    ratio: float
    acceptance_zone_mm: float


def fitness(estimate: Estimate, tolerance_mm: float) -> Fitness:
    """Decide whether an arm is fit to prove that parts conform to a tolerance.

    By ISO 14253-1 a part is proven to conform if the measured value lies inside the tolerance zone by the expanded
    uncertainty U: of a zone of width T the acceptance zone T - 2U remains. The answer is yes if T is at least four
    times 2U, the usual rule of laboratories, and no if no acceptance zone remains.

    Deviations of form and direction are norms of vectors, as ranges of residuals are. By the triangle inequality the
    measured value differs from the part's own by no more than the value of the errors alone, which U bounds. The errors
    add to the form of a nearly perfect part: a value within T then proves conformity, and parts lose U of T. Without an
    acceptance zone, even a perfect part may be found not to conform.

    Parameters
    ----------
    estimate : Estimate
    tolerance_mm : float
        Width of the zone.

    Raises
    ------
    InputError
        If the tolerance is not a positive number.
    """
    if not 0 < tolerance_mm < np.inf:
        raise InputError(f"expected a tolerance above zero in mm, got {tolerance_mm}", hint="0.1 for +-0.05 mm")
    used = estimate.expanded_mm * (1 if estimate.quantity.is_form else 2)
    ratio = tolerance_mm / used if used > 0 else np.inf
    answer = (
        FitnessDecision.YES if ratio >= GOOD_RATIO else FitnessDecision.NO if ratio <= 1 else FitnessDecision.GUARDED
    )
    return Fitness(tolerance_mm, answer, float(ratio), max(tolerance_mm - used, 0.0))


def describe_fitness(estimate: Estimate, fit: Fitness) -> str:
    """Describe whether the arm is fit for the tolerance, in sentences."""
    one_sided, tolerance, accepted = estimate.quantity.is_form, fit.tolerance_mm, fit.acceptance_zone_mm
    name = estimate.quantity.name
    zone = f"{tolerance:g} mm" if one_sided else f"+-{tolerance / 2:g} mm"
    answer = {
        FitnessDecision.YES: f"Yes, this arm is fit for {name} {zone}",
        FitnessDecision.NO: f"No, this arm is not fit for {name} {zone}",
        FitnessDecision.GUARDED: f"This arm is fit for {name} {zone} only with guard bands",
    }[fit.answer]
    usual = "" if fit.answer is FitnessDecision.NO else " (usual: 4 or more)"
    evidence = f"{'T / U' if one_sided else 'T / 2U'} = {fit.ratio:.1f}{usual}, U = {estimate.expanded_mm:.4f} mm"
    if not one_sided and accepted > 0:
        meaning = f"Measured values within +-{accepted / 2:.4f} mm prove conformity (ISO 14253-1)."
    elif not one_sided:
        meaning = "No measured value would prove conformity (ISO 14253-1)."
    elif accepted > 0:
        meaning = (
            f"Parts that deviate by up to {accepted:.4f} mm are found to conform. Measured values up to "
            f"{accepted:.4f} mm prove conformity of any part, values up to {tolerance:g} mm that of a nearly perfect "
            f"part: errors only add to its {name}."
        )
    else:
        meaning = (
            f"Even a perfect part may be found not to conform. Measured values up to {tolerance:g} mm prove conformity "
            f"of a nearly perfect part only: errors only add to its {name}."
        )
    return f"{answer}: {evidence}. {meaning}"
