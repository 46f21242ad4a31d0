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

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.verification.tasks.feature_postures import feature_postures
from truearm.verification.tasks.features import Feature, FeatureQuantity
from truearm.verification.tasks.sampled_arms import ArmDistribution, ArmSample, PosteriorDistribution

COVERAGE_PROBABILITY = 0.95
LEAST_ARMS, MAX_ARMS = 100, 100_000
N_POSTURES = 40  # of holding the feature, shared out among the arms
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
    quantity : FeatureQuantity
    errors : (n,) array
        Measured less true value of every drawn arm [mm].
    of_arm, of_points : (n,) array
        The same with the systematic errors alone, and with the random ones alone [mm].
    n_postures : int
        Of holding the feature; draw i was taken in way ``i % n_postures``.
    """

    quantity: FeatureQuantity
    errors: FloatArray
    of_arm: FloatArray
    of_points: FloatArray
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
        """Its systematic part, that no repetition of the same points makes smaller."""
        return float(self.of_arm.std(ddof=1))

    @property
    def u_random_mm(self) -> float:
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
        number of draws of JCGM 101:2008, 7.9. The ways of holding the feature are drawn as well, and fewer: draws of
        one way are resampled together. Where that tells less than resampling each draw, as with a single way, the
        larger standard error is taken.
        """
        rng, n = np.random.default_rng(0), len(self.errors)
        each = rng.choice(self.errors, (_RESAMPLES, n))
        by_way = self.errors[: n - n % self.n_postures].reshape(-1, self.n_postures)
        together = by_way[:, rng.integers(self.n_postures, size=(_RESAMPLES, self.n_postures))]
        spreads = (_spreads(each), _spreads(together.transpose(1, 0, 2).reshape(_RESAMPLES, -1)))
        return StandardErrors(*np.maximum(*spreads).tolist())


@dataclass(frozen=True)
class StandardErrors:
    """Standard errors of the Monte Carlo itself [mm]."""

    bias_mm: float
    u_mm: float
    low_mm: float
    high_mm: float
    expanded_mm: float


@dataclass(frozen=True, eq=False)
class TaskResult:
    """A feature measured by many arms.

    Attributes
    ----------
    feature : Feature
    estimates : tuple of Estimate
        One a quantity of the feature; the first is the one that a tolerance is about.
    angles : (m, k, n_joints) array
        The ways in which it was held [rad].
    at_limit : Estimate or None
        Of the first quantity, if each arm erred by as much as what is promised of it allows; if that was asked.
    repeatability_known : bool
        Whether it is known what of the errors changes from point to point, all of it.
    """

    feature: Feature
    estimates: tuple[Estimate, ...]
    angles: FloatArray
    at_limit: Estimate | None = None
    repeatability_known: bool = True

    @property
    def n_arms(self) -> int:
        """Number of drawn arms."""
        return len(self.estimates[0].errors)


class FitnessDecision(Enum):
    """Whether an arm is good enough for a tolerance."""

    YES = "yes"
    NO = "no"
    GUARDED = "only with guard bands"


@dataclass(frozen=True)
class Fitness:
    """An arm against a tolerance.

    Attributes
    ----------
    answer : FitnessDecision
    tolerance_mm : float
        Width of the tolerance zone: 0.1 for +-0.05 mm; the permitted deviation where it has one side, as of form.
    ratio : float
        Tolerance over what the uncertainty takes of it: T / 2U, of one side T / U.
    acceptance_zone_mm : float
        Width of the zone in which a measured value shows conformity: T - 2U; zero or more. Where the zone has one side
        T - U: parts that deviate by up to that are found to conform, and values up to that show it of any part.
    """

    answer: FitnessDecision
    tolerance_mm: float
    ratio: float
    acceptance_zone_mm: float


def simulate_measurements(
    errors: ArmDistribution,
    feature: Feature,
    *,
    n_arms: int = 1000,
    seed: int = 0,
    share_of_limit: Callable[[ArmSample], float] | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> TaskResult:
    """Let many arms measure a feature of a perfect part.

    Parameters
    ----------
    errors : ArmDistribution
        What is known of the arm.
    feature : Feature
    n_arms : int
        Draws.
    seed : int
        Of arms, points and postures.
    share_of_limit : callable, optional
        How large a drawn arm's errors are, 1 for one at the limit of what is promised.
    progress : callable, optional
        Told the arms that are done.

    Raises
    ------
    InputError
        If the arm does not reach the feature, or the number of draws is out of bounds.
    """
    if not LEAST_ARMS <= n_arms <= MAX_ARMS:
        raise InputError(f"expected {LEAST_ARMS} to {MAX_ARMS} arms to draw, got {n_arms}")
    if seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed}")
    ways = feature_postures(errors.arm, feature, N_POSTURES, seed=seed)
    seeds = np.random.SeedSequence(seed).generate_state(n_arms, np.uint64)
    found = np.empty((3, n_arms, len(feature.quantities)))
    shares = np.ones(n_arms)
    for i, seed_of_arm in enumerate(seeds.tolist()):
        drawn, angles = errors.draw(seed_of_arm), ways[i % len(ways)]
        of_arm = drawn.systematic(angles)
        of_points = drawn.random(angles, np.random.default_rng([6, seed_of_arm]))
        for row, off in zip(found, (of_arm + of_points, of_arm, of_points), strict=True):
            row[i] = feature.errors(feature.points + off)
        if share_of_limit is not None:
            shares[i] = share_of_limit(drawn)
        if progress is not None:
            progress(i + 1, "")
    estimates = tuple(
        Estimate(quantity, found[0, :, j], found[1, :, j], found[2, :, j], len(ways))
        for j, quantity in enumerate(feature.quantities)
    )
    at_limit = None
    if share_of_limit is not None:  # errors are small: those of a feature grow in proportion to the arm's
        scaled = found[:, :, 0] / shares
        at_limit = Estimate(feature.quantities[0], scaled[0], scaled[1], scaled[2], len(ways))
    known = not (isinstance(errors, PosteriorDistribution) and errors.repeatability_mm is None)
    return TaskResult(feature, estimates, ways, at_limit, known)


def fitness(estimate: Estimate, tolerance_mm: float) -> Fitness:
    """Whether an arm is good enough to prove that parts keep a tolerance.

    By ISO 14253-1 a part is shown to conform where the measured value lies inside the tolerance zone by the expanded
    uncertainty U (as recalled, see `truearm.verification.standards.decision`): T - 2U is left of a zone of width T. Where at least four
    times as wide a zone as the uncertainty takes is given, the usual rule of laboratories is kept and the answer is
    yes; where nothing is left, no.

    Deviations of form and direction are sizes of vectors, as ranges of residuals are, so by the triangle inequality a
    measured one differs from the part's by no more than the errors' own, which U tells. The errors of a nearly perfect
    part only add to it: then a value within T shows that the part conforms, and what U takes is from the part. With
    nothing left, a perfect part too may be found outside.

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
    answer = (
        FitnessDecision.YES if ratio >= GOOD_RATIO else FitnessDecision.NO if ratio <= 1 else FitnessDecision.GUARDED
    )
    return Fitness(answer, tolerance_mm, float(ratio), max(tolerance_mm - taken, 0.0))


def describe_fitness(estimate: Estimate, fit: Fitness) -> str:
    """Whether the arm is good enough, in words."""
    one_sided, wide = estimate.quantity.is_form, fit.tolerance_mm
    zone = f"{wide:g} mm" if one_sided else f"+-{wide / 2:g} mm"
    taken = f"{'T / U' if one_sided else 'T / 2U'} = {fit.ratio:.1f}, U = {estimate.expanded_mm:.4f} mm"
    said = {FitnessDecision.YES: "Yes", FitnessDecision.NO: "No", FitnessDecision.GUARDED: "Only with guard bands"}[
        fit.answer
    ]
    usual = "" if fit.answer is FitnessDecision.NO else "; 4 is usual"
    if not one_sided:
        shows = (
            f"Values within +-{fit.acceptance_zone_mm / 2:.4f} mm show"
            if fit.acceptance_zone_mm > 0
            else "No measured value would show"
        )
        meant = f"{shows} conformity (ISO 14253-1)."
    elif fit.acceptance_zone_mm > 0:
        meant = (
            f"Parts of up to {fit.acceptance_zone_mm:.4f} mm are found to conform. Values up to {fit.acceptance_zone_mm:.4f} mm show it of "
            f"any part, up to {wide:g} mm of a nearly perfect one: to its {estimate.quantity.name} errors only add."
        )
    else:
        meant = (
            f"A perfect part may be found outside. Values up to {wide:g} mm show conformity of a nearly perfect part "
            f"only: to its {estimate.quantity.name} errors only add."
        )
    return f"Good enough for {estimate.quantity.name} {zone}? {said}: {taken}{usual}. {meant}"


def advice(found: TaskResult) -> str:
    """Whether more points would help, in a sentence."""
    estimate = found.estimates[0]
    arm, point = estimate.u_systematic_mm**2, estimate.u_random_mm**2
    if arm + point == 0:
        return "This arm has no errors."
    if not found.repeatability_known:
        return (
            "Whether more points would help is not known: no repeatability tells what of the errors changes from point "
            "to point. Take one point some ten times, the arm held the same way, and give the standard deviation of a "
            "coordinate as repeatability."
        )
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


def _spreads(drawn: FloatArray) -> FloatArray:
    """Standard deviations (5,) of what `StandardErrors` holds, over resampled errors (m, n)."""
    ordered = np.sort(drawn, axis=1)
    ends = shortest_interval(ordered)
    found = np.stack([ordered.mean(axis=1), ordered.std(axis=1, ddof=1), *ends, np.maximum(*np.abs(ends))])
    spread: FloatArray = found.std(axis=1, ddof=1)
    return spread


def shortest_interval(ordered: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends (m,) of the shortest intervals that hold 95 % of draws (m, n), which are in rising order.

    JCGM 101:2008, 7.7.4: of all intervals from the r-th to the (r + q)-th of n ordered values, the shortest; q is the
    whole number next to 0.95 n there. As the shortest of many is too short by chance (it holds 94.5 % of a normal
    distribution with n = 1000; that document speaks of a million, 7.2.2), q is raised by `SHORTEST` ``n^(1/3)``.
    """
    n = ordered.shape[1]
    q = min(int(COVERAGE_PROBABILITY * n + SHORTEST * n ** (1 / 3) + 0.5), n - 1)
    width = ordered[:, q:] - ordered[:, : n - q]
    first = width.argmin(axis=1)
    rows = np.arange(len(ordered))
    return ordered[rows, first], ordered[rows, first + q]
