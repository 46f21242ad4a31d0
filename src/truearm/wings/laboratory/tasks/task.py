"""The uncertainty of a measured feature, by Monte Carlo: arms are drawn, and each measures the feature.

Each draw is a whole arm: the systematic errors of all points are from one draw, the random errors are drawn for each
point (JCGM 101:2008).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.tasks.estimate import COVERAGE_PROBABILITY, Estimate, Fitness, fitness
from truearm.wings.laboratory.tasks.feature_postures import feature_postures
from truearm.wings.laboratory.tasks.features import Feature
from truearm.wings.laboratory.tasks.sampled_arms import ArmDistribution, ArmSample, PosteriorDistribution
from truearm.wings.laboratory.tasks.specification_sheet import (
    BEST_SHARE,
    LEAST_SHARE,
    TRIES,
    SpecificationDistribution,
    share_of_limit,
)

MIN_ARMS, MAX_ARMS = 100, 100_000
N_POSTURES = 40  # sets of postures, shared by the arms
# Share of the variance below which a part of it hardly matters.
SMALL_SHARE = 0.25
# Share of poses outside the training range that is mentioned.
_MENTIONED_OUTSIDE = 0.005


@dataclass(frozen=True, eq=False)
class TaskEstimates:
    """A feature measured by many arms.

    Attributes
    ----------
    feature : Feature
    estimates : tuple of Estimate
        One per quantity of the feature; the tolerance refers to the first.
    angles : (m, k, n_joints) array
        The sets of postures [rad].
    point_u_mm : (k, 3) array
        Standard deviation of the error of each coordinate of each point, over the arms.
    at_limit : Estimate or None
        Of the first quantity, for arms whose worst test result equals its limit; only for a specification.
    """

    feature: Feature
    estimates: tuple[Estimate, ...]
    angles: FloatArray
    point_u_mm: FloatArray
    at_limit: Estimate | None = None

    @property
    def n_arms(self) -> int:
        """Number of drawn arms."""
        return len(self.estimates[0].errors)


@dataclass(frozen=True, eq=False)
class TaskAssessment:
    """A measuring task: the uncertainty of a feature and, with a tolerance, whether the arm is fit for it.

    Attributes
    ----------
    result : TaskEstimates
    fitness : Fitness or None
        For the tolerance of the first quantity.
    remarks : tuple of str
        Results for arms at their limit, and assumptions, in sentences.
    arm : str
        Name of the nominal arm.
    """

    result: TaskEstimates
    fitness: Fitness | None
    remarks: tuple[str, ...]
    arm: str

    @property
    def advice(self) -> str:
        """Whether more points would help, in a sentence."""
        return advice(self.result)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as plain data, ready for JSON."""
        result = self.result
        return {
            "feature": result.feature.name,
            "arm": self.arm,
            "points_mm": result.feature.points.tolist(),
            "points_u_mm": result.point_u_mm.tolist(),
            "n_arms": result.n_arms,
            "level": COVERAGE_PROBABILITY,
            "quantities": [one.to_dict() for one in result.estimates],
            "expanded_at_limit_mm": None if result.at_limit is None else result.at_limit.expanded_mm,
            "tolerance": self.fitness,
            "remarks": list(self.remarks),
        }


def assess_task(
    errors: ArmDistribution,
    feature: Feature,
    *,
    tolerance_mm: float | None = None,
    n_arms: int = 1000,
    seed: int = 0,
    progress: Callable[[int, str], None] | None = None,
) -> TaskAssessment:
    """Estimate the uncertainty of a measured feature and, with a tolerance, whether the arm is fit for it.

    Parameters
    ----------
    errors : ArmDistribution
        `PosteriorDistribution` of a model, `PresetDistribution`, or `SpecificationDistribution`.
    feature : Feature
    tolerance_mm : float, optional
        Width of the tolerance zone of the first quantity: 0.1 for +-0.05 mm.
    n_arms : int
        Number of arms to draw.
    seed : int
    progress : callable, optional
        Called with the number of arms done.

    Raises
    ------
    InputError
        As `simulate_measurements` and `fitness`; if the tolerance is as large as the feature.
    """
    nominal = feature.quantities[0].nominal_mm
    if tolerance_mm is not None and 0 < nominal <= tolerance_mm:
        raise InputError(
            f"expected a tolerance in mm smaller than the measured {nominal:g} mm, got {tolerance_mm:g}",
            hint="0.05 for 50 micrometres",
        )
    share = share_of_limit if isinstance(errors, SpecificationDistribution) else None
    result = simulate_measurements(errors, feature, n_arms=n_arms, seed=seed, share_of_limit=share, progress=progress)
    decision = None if tolerance_mm is None else fitness(result.estimates[0], tolerance_mm)
    remarks = [*_outside_training(errors, result), *assumptions(errors)]
    if result.at_limit is not None:
        remarks.append(
            f"For arms whose worst test result equals its limit, U = {result.at_limit.expanded_mm:.4f} mm. Use this "
            "value for purchasing decisions."
        )
    return TaskAssessment(result, decision, tuple(remarks), errors.arm.name)


def simulate_measurements(
    errors: ArmDistribution,
    feature: Feature,
    *,
    n_arms: int = 1000,
    seed: int = 0,
    share_of_limit: Callable[[ArmSample], float] | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> TaskEstimates:
    """Let many arms measure a feature of a perfect part.

    Parameters
    ----------
    errors : ArmDistribution
        Errors that the arm may have.
    feature : Feature
    n_arms : int
        Number of arms to draw.
    seed : int
        Seed of arms, points and postures.
    share_of_limit : callable, optional
        Errors of a drawn arm relative to those of an arm at the limit of its specification.
    progress : callable, optional
        Called with the number of arms done.

    Raises
    ------
    InputError
        If the arm does not reach the feature, or the number of draws is out of bounds.
    """
    check_draws(n_arms, seed)
    postures = feature_postures(errors.arm, feature, N_POSTURES, seed=seed)
    seeds = np.random.SeedSequence(seed).generate_state(n_arms, np.uint64)
    values = np.empty((3, n_arms, len(feature.quantities)))
    sums = np.zeros((2, *feature.points.shape))  # of the errors of each point, and of their squares
    shares = np.ones(n_arms)
    for i, arm_seed in enumerate(seeds.tolist()):
        drawn, angles = errors.draw(arm_seed), postures[i % len(postures)]
        systematic = drawn.systematic(angles)
        random = drawn.random(angles, np.random.default_rng([6, arm_seed]))
        for row, off in zip(values, (systematic + random, systematic, random), strict=True):
            row[i] = feature.errors(feature.points + off)
        sums += systematic + random, (systematic + random) ** 2
        if share_of_limit is not None:
            shares[i] = share_of_limit(drawn)
        if progress is not None:
            progress(i + 1, "")
    estimates = tuple(
        Estimate(quantity, values[0, :, j], values[1, :, j], values[2, :, j], len(postures))
        for j, quantity in enumerate(feature.quantities)
    )
    at_limit = None
    if share_of_limit is not None:  # small errors of a feature are proportional to the arm's
        scaled = values[:, :, 0] / shares
        at_limit = Estimate(feature.quantities[0], scaled[0], scaled[1], scaled[2], len(postures))
    point_u = np.sqrt(np.maximum(sums[1] - sums[0] ** 2 / n_arms, 0.0) / (n_arms - 1))  # not below 0 by rounding
    return TaskEstimates(feature, estimates, postures, point_u, at_limit)


def check_draws(n_arms: int, seed: int) -> None:
    """Check how many arms are drawn, and the seed.

    Raises
    ------
    InputError
        If one is out of bounds.
    """
    if not MIN_ARMS <= n_arms <= MAX_ARMS:
        raise InputError(f"expected {MIN_ARMS} to {MAX_ARMS} arms to draw, got {n_arms}")
    if seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed}")


def assumptions(errors: ArmDistribution) -> list[str]:
    """Assumptions of a simulated measurement, in sentences."""
    perfect = "The part is perfect and at 20 degC; add the uncertainty of its temperature and form."
    if isinstance(errors, PosteriorDistribution):
        source = "as the readings of the model show it" if errors.repeatability_mm is None else "as stated"
        return [
            *errors.identified.doubts(),
            f"Random error of a coordinate: {errors.random_std_mm:.4f} mm, {source}.",
            f"Residual standard deviation that repeats at the same pose: {errors.field_std_mm:.4f} mm.",
            "The arm is at the mean temperature of the model's readings.",
            perfect,
        ]
    if isinstance(errors, SpecificationDistribution):
        drawn = (
            f"The worst test result of a drawn arm is {BEST_SHARE:.0%} to 100% of its limit. An arm with another "
            f"result below {LEAST_SHARE:.0%} of its limit is drawn again, up to {TRIES} times."
        )
        return [f"The drawn arms conform to {', '.join(errors.specification.limits)}.", drawn, perfect]
    return [perfect]


def advice(result: TaskEstimates) -> str:
    """Advise whether more points would reduce the uncertainty, in a sentence."""
    estimate = result.estimates[0]
    systematic, random = estimate.u_systematic_mm**2, estimate.u_random_mm**2
    if systematic + random == 0:
        return "This arm has no errors."
    share = random / (systematic + random)
    if estimate.quantity.is_form:
        return (
            "The measured deviation of form is too large: errors add to it, and more so with more points. Random "
            f"errors alone would make it {estimate.random.mean():.4f} mm."
        )
    if share < SMALL_SHARE:
        return f"The systematic errors dominate: with more points, u stays at least {systematic**0.5:.4f} mm."
    better = (systematic + random / 4) ** 0.5
    which = "Random errors dominate" if share > 1 - SMALL_SHARE else "Systematic and random errors are similar"
    return f"{which}: four times the points would give about u = {better:.4f} mm."


def _outside_training(errors: ArmDistribution, result: TaskEstimates) -> list[str]:
    if not isinstance(errors, PosteriorDistribution):
        return []
    outside = errors.model.outside_training(result.angles.reshape(-1, errors.arm.n_joints)).mean()
    if outside < _MENTIONED_OUTSIDE:
        return []
    return [f"{outside:.0%} of the poses are outside the trained range of the model; errors may be larger there."]
