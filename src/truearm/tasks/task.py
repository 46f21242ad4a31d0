"""The uncertainty of a measured feature, by Monte Carlo: arms are drawn, and each measures the feature.

JCGM 101:2008, "Propagation of distributions using a Monte Carlo method": the mean and standard deviation of the drawn
errors are the estimate of the bias and the standard uncertainty (7.6), the coverage interval is the shortest one that
holds 95 % of them (5.3.4, 7.7.4). Each draw is a whole arm, with the systematic errors of all points from one draw;
only what changes from point to point is drawn for each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.tasks.errors import ArmErrors
from truearm.tasks.features import Feature, Quantity
from truearm.tasks.postures import held

FloatArray = npt.NDArray[np.float64]

LEVEL = 0.95
LEAST_ARMS, MOST_ARMS = 100, 100_000
WAYS = 40  # of holding the feature, shared out among the arms
_RESAMPLES = 200
# Simulated: with it the intervals hold 95.0 to 95.1 % of a normal, a gamma and Student's distribution, n from 1000 on.
SHORTEST = 0.47
# Share of the variance below which a part of it hardly matters.
SMALL_SHARE = 0.25
# Tolerance over the expanded uncertainty to both sides: the "4:1 rule" of laboratories.
GOOD_RATIO = 4.0


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known of a quantity's error of measurement.

    Attributes
    ----------
    quantity : Quantity
    errors : (n,) array
        Measured less true value of every drawn arm [mm].
    of_arm, of_points : (n,) array
        The same with the systematic errors alone, and with the random ones alone [mm].
    """

    quantity: Quantity
    errors: FloatArray
    of_arm: FloatArray
    of_points: FloatArray

    @property
    def bias_mm(self) -> float:
        """Mean error."""
        return float(self.errors.mean())

    @property
    def u_mm(self) -> float:
        """Standard uncertainty: standard deviation of the errors about their mean (JCGM 101:2008, 7.6)."""
        return float(self.errors.std(ddof=1))

    @property
    def u_of_arm_mm(self) -> float:
        """Its systematic part, that no repetition of the same points makes smaller."""
        return float(self.of_arm.std(ddof=1))

    @property
    def u_of_points_mm(self) -> float:
        """Its random part, which more points make smaller."""
        return float(self.of_points.std(ddof=1))

    @cached_property
    def interval_mm(self) -> tuple[float, float]:
        """Shortest interval that holds 95 % of the errors."""
        low, high = shortest_interval(np.sort(self.errors)[None])
        return float(low[0]), float(high[0])

    @property
    def expanded_mm(self) -> float:
        """How far a measured value may be from the true one, 95 %: the farther end of the interval from zero."""
        return max(map(abs, self.interval_mm))

    @cached_property
    def standard_errors(self) -> StandardErrors:
        """Of bias, standard uncertainty and the interval's ends, for the number of draws: by resampling.

        B. Efron, "Bootstrap methods: another look at the jackknife", Ann. Stat. 7 (1979) 1; in place of the adaptive
        number of draws of JCGM 101:2008, 7.9.
        """
        rng = np.random.default_rng(0)
        drawn = np.sort(rng.choice(self.errors, (_RESAMPLES, len(self.errors))), axis=1)
        ends = shortest_interval(drawn)
        found = (drawn.mean(axis=1), drawn.std(axis=1, ddof=1), *ends, np.maximum(*np.abs(ends)))
        return StandardErrors(*(float(values.std(ddof=1)) for values in found))


@dataclass(frozen=True)
class StandardErrors:
    """Standard errors of the Monte Carlo itself [mm]."""

    bias_mm: float
    u_mm: float
    low_mm: float
    high_mm: float
    expanded_mm: float


@dataclass(frozen=True, eq=False)
class Task:
    """A feature measured by many arms.

    Attributes
    ----------
    feature : Feature
    estimates : tuple of Estimate
        One a quantity of the feature; the first is the one that a tolerance is about.
    angles : (m, k, n_joints) array
        The ways in which it was held [rad].
    """

    feature: Feature
    estimates: tuple[Estimate, ...]
    angles: FloatArray

    @property
    def n_arms(self) -> int:
        """Number of drawn arms."""
        return len(self.estimates[0].errors)


class Answer(Enum):
    """Whether an arm is good enough for a tolerance."""

    YES = "yes"
    NO = "no"
    GUARDED = "only with guard bands"


@dataclass(frozen=True)
class Fitness:
    """An arm against a tolerance.

    Attributes
    ----------
    answer : Answer
    tolerance_mm : float
        Width of the tolerance zone: 0.1 for +-0.05 mm; the permitted deviation where it has one side, as of form.
    ratio : float
        Tolerance over what the uncertainty takes of it: T / 2U, of one side T / U.
    left_mm : float
        Width of the zone in which a measured value shows conformity: T - 2U, of one side T - U; zero or more.
    """

    answer: Answer
    tolerance_mm: float
    ratio: float
    left_mm: float


def measured_by(
    errors: ArmErrors,
    feature: Feature,
    *,
    n_arms: int = 1000,
    seed: int = 0,
    progress: Callable[[int, str], None] | None = None,
) -> Task:
    """Let many arms measure a feature of a perfect part.

    Parameters
    ----------
    errors : ArmErrors
        What is known of the arm.
    feature : Feature
    n_arms : int
        Draws.
    seed : int
        Of arms, points and postures.
    progress : callable, optional
        Told the arms that are done.

    Raises
    ------
    InputError
        If the arm does not reach the feature, or the number of draws is out of bounds.
    """
    if not LEAST_ARMS <= n_arms <= MOST_ARMS:
        raise InputError(f"expected {LEAST_ARMS} to {MOST_ARMS} arms to draw, got {n_arms}")
    if seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed}")
    ways = held(errors.arm, feature, WAYS, seed=seed)
    seeds = np.random.SeedSequence(seed).generate_state(n_arms, np.uint64)
    found = np.empty((3, n_arms, len(feature.quantities)))
    for i, seed_of_arm in enumerate(seeds.tolist()):
        drawn, angles = errors.draw(seed_of_arm), ways[i % len(ways)]
        of_arm = drawn.systematic(angles)
        of_points = drawn.random(angles, np.random.default_rng([6, seed_of_arm]))
        for row, off in zip(found, (of_arm + of_points, of_arm, of_points), strict=True):
            row[i] = feature.errors(feature.points + off)
        if progress is not None:
            progress(i + 1, "")
    estimates = (Estimate(quantity, *found[:, :, j]) for j, quantity in enumerate(feature.quantities))
    return Task(feature, tuple(estimates), ways)


def fitness(estimate: Estimate, tolerance_mm: float) -> Fitness:
    """Whether an arm is good enough to prove that parts keep a tolerance.

    By ISO 14253-1 a part is shown to conform where the measured value lies inside the tolerance zone by the expanded
    uncertainty U (as recalled, see `truearm.verify.decision`): T - 2U is left of a zone of width T, T - U where the
    zone has one side. Where at least four times as wide a zone as the uncertainty takes is given, the usual rule of
    laboratories is kept and the answer is yes; where nothing is left, no.

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
    taken = estimate.expanded_mm * (1 if estimate.quantity.is_form else 2)
    ratio = tolerance_mm / taken if taken > 0 else np.inf
    answer = Answer.YES if ratio >= GOOD_RATIO else Answer.NO if ratio <= 1 else Answer.GUARDED
    return Fitness(answer, tolerance_mm, float(ratio), max(tolerance_mm - taken, 0.0))


def in_words(estimate: Estimate, fit: Fitness) -> str:
    """Whether the arm is good enough, in words."""
    one_sided = estimate.quantity.is_form
    zone = f"{fit.tolerance_mm:g} mm" if one_sided else f"+-{fit.tolerance_mm / 2:g} mm"
    taken = f"{'T / U' if one_sided else 'T / 2U'} = {fit.ratio:.1f}, U = {estimate.expanded_mm:.4f} mm"
    left = f"{fit.left_mm:.4f} mm" if one_sided else f"+-{fit.left_mm / 2:.4f} mm"
    opening = f"Good enough for {estimate.quantity.name} {zone}? "
    if fit.answer.value == "yes":
        return opening + f"Yes: {taken}; 4 is usual. Values within {left} show conformity (ISO 14253-1)."
    if fit.answer.value == "no":
        return opening + f"No: {taken}. No measured value would show conformity (ISO 14253-1)."
    return opening + f"Only with guard bands: {taken}; 4 is usual. Values within {left} show conformity (ISO 14253-1)."


def advice(found: Task) -> str:
    """Whether more points would help, in a sentence."""
    estimate = found.estimates[0]
    arm, point = estimate.u_of_arm_mm**2, estimate.u_of_points_mm**2
    if arm + point == 0:
        return "This arm has no errors."
    share = point / (arm + point)
    if estimate.quantity.is_form:
        return (
            "A deviation of form is found too large: errors add to it, and the more points there are, the more so. "
            f"Random errors alone would make it {estimate.of_points.mean():.4f} mm."
        )
    if share < SMALL_SHARE:
        return f"The arm's own errors dominate: more points or repeats leave at least u = {arm**0.5:.4f} mm."
    better = (arm + point / 4) ** 0.5
    which = "Random errors dominate" if share > 1 - SMALL_SHARE else "The arm's own and random errors are alike"
    return f"{which}: four times the points would give about u = {better:.4f} mm."


def shortest_interval(ordered: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends (m,) of the shortest intervals that hold 95 % of draws (m, n), which are in rising order.

    JCGM 101:2008, 7.7.4: of all intervals from the r-th to the (r + q)-th of n ordered values, the shortest; q is the
    whole number next to 0.95 n there. As the shortest of many is too short by chance (it holds 94.5 % of a normal
    distribution with n = 1000; that document speaks of a million, 7.2.2), q is raised by `SHORTEST` ``n^(1/3)``.
    """
    n = ordered.shape[1]
    q = min(int(LEVEL * n + SHORTEST * n ** (1 / 3) + 0.5), n - 1)
    width = ordered[:, q:] - ordered[:, : n - q]
    first = width.argmin(axis=1)
    rows = np.arange(len(ordered))
    return ordered[rows, first], ordered[rows, first + q]
