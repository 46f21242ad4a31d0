"""The Monte Carlo of a task: laws of what averaging does, intervals by hand, and answers to a tolerance."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import norm

from refusals import refuses
from truearm.arm.arm import Arm
from truearm.arm.catalogue import load_arm
from truearm.wings.laboratory.pages.task_page import task_scene
from truearm.wings.laboratory.tasks import features
from truearm.wings.laboratory.tasks.estimate import (
    SHORTEST,
    Estimate,
    FitnessDecision,
    describe_fitness,
    fitness,
    shortest_interval,
)
from truearm.wings.laboratory.tasks.feature_postures import middle_of
from truearm.wings.laboratory.tasks.features import FeatureQuantity
from truearm.wings.laboratory.tasks.task import advice, simulate_measurements

ARM = load_arm("gao2017")
MIDDLE, ACROSS = middle_of(ARM)


@dataclass(frozen=True)
class Scaled:
    """Arms whose scale is wrong, each by its own amount, and whose points scatter."""

    arm: Arm
    scale_std: float
    point_std_mm: float

    def draw(self, seed):
        """Draw the scale."""
        return ScaledArm(self, self.scale_std * np.random.default_rng(seed).standard_normal())


@dataclass(frozen=True)
class ScaledArm:
    """One of them."""

    of: Scaled
    scale: float

    def systematic(self, angles):
        """Proportional to the coordinates."""
        return self.scale * self.of.arm.chain.tip_in_base(angles)

    def random(self, angles, rng):
        """Scatter."""
        return self.of.point_std_mm * rng.standard_normal((len(angles), 3))


KNOWN = Scaled(ARM, 2e-5, 0.01)


@pytest.mark.parametrize(("length", "points"), [(50.0, 2), (1000.0, 2), (1000.0, 18)])
def test_systematic_errors_are_proportional_to_the_length_and_random_ones_average_out(length, points):
    """By hand: u of the arm is the scale's times the length; of n points at each end sqrt(2 / n) of one point's."""
    found = simulate_measurements(
        KNOWN, features.length_at(MIDDLE, ACROSS, length, points=points), n_arms=800
    ).estimates[0]
    systematic, random = 2e-5 * length, 0.01 * np.sqrt(2 / (points / 2))
    # 800 draws: a standard deviation is known to 2.5 %; five of them.
    assert found.u_systematic_mm == pytest.approx(systematic, rel=0.13)
    assert found.u_random_mm == pytest.approx(random, rel=0.13)
    assert found.u_mm == pytest.approx(np.hypot(systematic, random), rel=0.13)
    assert abs(found.bias_mm) < 5 * found.standard_errors.bias_mm + 1e-4
    low, high = found.interval_mm
    assert (high - low) / 2 == pytest.approx(1.96 * found.u_mm, rel=0.15)


def test_the_uncertainty_of_a_point_is_that_of_its_coordinates_and_the_scene_shows_it():
    feature = features.length_at(MIDDLE, ACROSS, 500.0)
    found = simulate_measurements(KNOWN, feature, n_arms=800)
    # By hand: the scale's times the coordinate, and the scatter of the point. 800 draws: 2.5 %; five of them.
    expected = np.hypot(2e-5 * feature.points, 0.01)
    np.testing.assert_allclose(found.point_u_mm, expected, rtol=0.13)
    scene = task_scene(found, ARM)
    np.testing.assert_allclose(scene.cloud.values[0].values, np.linalg.norm(found.point_u_mm, axis=1), rtol=1e-12)
    assert [(note.name, *note.values) for note in scene.cloud.notes] == [
        (f"u of {axis}", *column) for axis, column in zip("xyz", found.point_u_mm.T, strict=True)
    ]
    # The arm of the scene has its tip at the point that is pointed at.
    for point, column in zip(feature.points, np.transpose([axis.values for axis in scene.cloud.axes]), strict=True):
        np.testing.assert_allclose(ARM.chain.tip_in_base(np.radians(column)[None])[0], point, atol=1e-6)


def test_the_same_seed_gives_the_same_numbers():
    feature = features.length_at(MIDDLE, ACROSS, 200.0)
    one, again, other = (simulate_measurements(KNOWN, feature, n_arms=100, seed=s).estimates[0] for s in (3, 3, 4))
    assert np.array_equal(one.errors, again.errors)
    assert not np.array_equal(one.errors, other.errors)


def test_progress_counts_every_arm():
    counted = []
    simulate_measurements(
        KNOWN, features.length_at(MIDDLE, ACROSS, 200.0), n_arms=100, progress=lambda n, _: counted.append(n)
    )
    assert counted == list(range(1, 101))


def test_the_standard_errors_are_those_of_repeated_draws():
    """Of 40 Monte Carlos of 200 draws each: their u and bias scatter as each one says."""
    rng = np.random.default_rng(2)
    runs = [estimate(0.01 * rng.standard_normal(200)) for _ in range(40)]
    for name in ("bias_mm", "u_mm"):
        scatter = np.std([getattr(run, name) for run in runs], ddof=1)
        stated = np.mean([getattr(run.standard_errors, name) for run in runs])
        assert stated == pytest.approx(scatter, rel=0.45)  # 40 runs know a standard deviation to 11 %


def test_the_standard_errors_include_the_choice_of_postures():
    """Ten ways of holding, each with an offset of its own, of 20 draws each: their offsets are the larger chance."""
    rng = np.random.default_rng(3)
    runs = []
    for _ in range(40):
        errors = (rng.standard_normal(10) + 0.3 * rng.standard_normal((20, 10))).ravel()
        runs.append(estimate(errors, n_postures=10))
    scatter = np.std([run.bias_mm for run in runs], ddof=1)
    stated = np.mean([run.standard_errors.bias_mm for run in runs])
    assert scatter > 0.2  # 0.07 if all draws were independent
    assert stated == pytest.approx(scatter, rel=0.45)  # 40 runs know a standard deviation to 11 %


# Intervals ------------------------------------------------------------------------------------------------------------


def test_the_shortest_interval_by_hand():
    """Of 20 numbers all are held; of 100, of which two are far off, the 98 others: q = 95 + 0.47 * 4.64, 97."""
    numbers = np.array([[-50.0, *range(19)]])
    assert [float(end[0]) for end in shortest_interval(numbers)] == [-50.0, 18.0]
    many = np.sort(np.concatenate([[-50.0] * 2, np.linspace(0, 1, 98)]))[None]
    assert [float(end[0]) for end in shortest_interval(many)] == [0.0, 1.0]


@pytest.mark.parametrize("n", [300, 1000])
def test_the_shortest_interval_contains_95_per_cent(rng, n):
    """Of a normal distribution, on average over 600 Monte Carlos: to 0.45 %, of which 0.05 % is chance."""
    low, high = shortest_interval(np.sort(rng.standard_normal((600, n)), axis=1))
    assert (norm.cdf(high) - norm.cdf(low)).mean() == pytest.approx(0.95, abs=0.0045)


def test_the_shortest_interval_of_a_skew_distribution_begins_at_its_peak():
    draws = np.sort(np.random.default_rng(1).exponential(1.0, 20000))[None]
    low, high = shortest_interval(draws)
    assert low[0] == pytest.approx(0.0, abs=0.01)
    assert high[0] == pytest.approx(-np.log(0.05), rel=0.03)


def test_the_shortest_interval_is_no_longer_than_the_one_in_the_middle(rng):
    draws = np.sort(rng.gamma(2.0, size=(20, 500)), axis=1)
    low, high = shortest_interval(draws)
    cut = (500 - 1 - int(0.95 * 500 + SHORTEST * 500 ** (1 / 3) + 0.5)) // 2
    assert (high - low <= draws[:, 499 - cut] - draws[:, cut] + 1e-12).all()


# Tolerances -----------------------------------------------------------------------------------------------------------


def estimate(errors, *, is_form=False, n_postures=1):
    """An estimate of these errors."""
    errors = np.asarray(errors, dtype=float)
    quantity = FeatureQuantity("flatness", 0.0, True) if is_form else FeatureQuantity("length", 100.0)
    return Estimate(quantity, errors, errors, np.zeros_like(errors), n_postures)


@pytest.mark.parametrize(
    ("tolerance", "answer", "ratio", "left"),
    [
        (0.2, FitnessDecision.YES, 5.0, 0.16),
        (0.08, FitnessDecision.GUARDED, 2.0, 0.04),
        (0.04, FitnessDecision.NO, 1.0, 0.0),
        (0.01, FitnessDecision.NO, 0.25, 0.0),
    ],
)
def test_answers_to_a_tolerance_by_hand(tolerance, answer, ratio, left):
    """U = 0.02 mm: 2U of the zone is taken, and four times as much is wanted."""
    found = estimate(np.repeat([-0.02, 0.02], 50))
    assert found.expanded_mm == pytest.approx(0.02)
    fit = fitness(found, tolerance)
    assert fit.answer is answer
    assert fit.ratio == pytest.approx(ratio)
    assert fit.acceptance_zone_mm == pytest.approx(left)
    said = describe_fitness(found, fit)
    assert {FitnessDecision.YES: "Yes", FitnessDecision.NO: "No, ", FitnessDecision.GUARDED: "guard bands"}[
        answer
    ] in said
    assert "U = 0.0200 mm" in said


def test_a_tolerance_of_form_has_one_side():
    found = estimate(np.repeat([0.01, 0.02], 50), is_form=True)
    fit = fitness(found, 0.08)
    assert fit.answer is FitnessDecision.YES
    assert fit.acceptance_zone_mm == pytest.approx(0.06)
    said = describe_fitness(found, fit)
    assert "Parts that deviate by up to 0.0600 mm are found to conform" in said
    assert "values up to 0.08 mm that of a nearly perfect part" in said


def test_a_form_below_the_uncertainty_can_still_be_shown_of_a_nearly_perfect_part():
    """Errors add to form: 0.01 mm measured with U = 0.02 mm is not from a part of 0.015 mm whose errors took it off."""
    found = estimate(np.repeat([0.01, 0.02], 50), is_form=True)
    fit = fitness(found, 0.015)
    assert fit.answer is FitnessDecision.NO
    assert fit.acceptance_zone_mm == 0
    said = describe_fitness(found, fit)
    assert "Even a perfect part may be found not to conform" in said
    assert "No measured value" not in said


@pytest.mark.parametrize("form", [0.0, 0.005, 0.05])
def test_a_measured_flatness_differs_from_the_part_s_by_no_more_than_that_of_the_errors(rng, form):
    """The triangle inequality, on which the words about any part rest; of a perfect part errors only add."""
    plate = features.plane(MIDDLE, [0.0, 0.0, 1.0], 200.0)
    for _ in range(20):
        part = form * rng.uniform(-0.5, 0.5, plate.points.shape)
        errors = 0.005 * rng.standard_normal(plate.points.shape)
        true, alone, measured = (plate.errors(plate.points + off)[0] for off in (part, errors, part + errors))
        assert abs(measured - true) <= alone + 1e-6  # planes turn by 1e-4 rad: 1e-8 of 50 um, and rounding
        if form == 0:
            assert measured >= true


def test_an_arm_without_errors_is_fit_for_every_tolerance():
    fit = fitness(estimate(np.zeros(100)), 1e-6)
    assert fit.answer is FitnessDecision.YES


@pytest.mark.parametrize("tolerance", [0.0, -0.1, np.nan, np.inf])
def test_a_tolerance_that_is_not_positive_is_refused(tolerance):
    refuses("tolerance above zero", fitness, estimate([0.0, 1.0]), tolerance)


@pytest.mark.parametrize(
    ("known", "said"),
    [
        (Scaled(ARM, 1e-4, 0.001), "systematic errors dominate"),
        (Scaled(ARM, 1e-6, 0.01), "Random errors dominate"),
        (Scaled(ARM, 0.0, 0.0), "no errors"),
    ],
)
def test_the_advice_names_the_part_that_dominates(known, said):
    found = simulate_measurements(known, features.length_at(MIDDLE, ACROSS, 500.0), n_arms=100)
    assert said in advice(found)


@pytest.mark.parametrize(("n_arms", "seed"), [(99, 0), (100_001, 0), (100, -1)])
def test_numbers_out_of_bounds_are_refused(n_arms, seed):
    refuses(None, simulate_measurements, KNOWN, features.length_at(MIDDLE, ACROSS, 500.0), n_arms=n_arms, seed=seed)
