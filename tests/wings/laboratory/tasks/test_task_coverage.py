"""The law of task uncertainty: 95 % intervals hold the errors that virtual arms make, of two points as of many.

A small version of ``python -m benchmarks uncertainty tasks``. No repeatability is given: nothing is known to be random.
"""

import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2, norm

from benchmarks.uncertainty import brute_force_errors
from truearm.arm.catalogue import load_arm
from truearm.models import KinematicModel
from truearm.wings.laboratory.tasks.estimate import expanded_uncertainty
from truearm.wings.laboratory.tasks.feature_postures import feature_postures, middle_of, place_feature
from truearm.wings.laboratory.tasks.features import UP, length_at, plane, sphere
from truearm.wings.laboratory.tasks.sampled_arms import PosteriorDistribution, PresetDistribution
from truearm.wings.laboratory.tasks.task import simulate_measurements
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset

ARM = load_arm("gao2017")
MIDDLE, ACROSS = middle_of(ARM)
N_ARMS, N_POSTURES = 8, 25
FACING = plane(MIDDLE, np.cross(ACROSS, UP), 200.0)


@pytest.fixture(scope="module")
def identified():
    """Virtual arms of a workshop and what 80 readings of each told."""
    found = []
    for seed in range(N_ARMS):
        virtual = VirtualArm.draw(ARM, load_preset("shop"), seed=seed)
        readings = virtual.measure(measuring_poses(ARM, 80, seed=seed).angles, seed=seed).readings
        found.append((virtual, KinematicModel(ARM).fit_readings(readings)))
    return found


@pytest.fixture(scope="module")
def models(identified):
    return [model for _, model in identified]


@pytest.fixture(scope="module")
def true_errors(identified):
    """The errors of a feature that each arm makes in `N_POSTURES` postures, measured once."""

    @cache
    def made(feature):
        ways = feature_postures(ARM, feature, N_POSTURES, seed=77)
        poses, of_arms = ways.reshape(-1, ARM.n_joints), []
        for seed, (virtual, model) in enumerate(identified):
            degC = model.training_.temperature_degC.mean
            taken = virtual.measure(poses, seed=500 + seed, temperature_degC=degC, reference=False)
            shown = model.predict_readings(replace(taken.readings, directions=None))
            off = (shown - taken.true_tips).reshape(len(ways), -1, 3)
            of_arms.append(np.array([feature.errors(feature.points + one)[0] for one in off]))
        return of_arms

    return made


def shares(models, true_errors, feature, n_arms):
    """Of true errors in the interval, of those no larger than U, and true over stated size, root mean square."""
    inside, within, times = [], [], []
    for seed, (model, errors) in enumerate(zip(models, true_errors(feature), strict=True)):
        stated = simulate_measurements(PosteriorDistribution(model), feature, n_arms=n_arms, seed=seed).estimates[0]
        low, high = stated.interval_mm
        inside.append(((errors >= low) & (errors <= high)).mean())
        within.append((np.abs(errors) <= stated.expanded_mm).mean())
        times.append((errors**2).mean() / (stated.u_mm**2 + stated.bias_mm**2))
    return np.mean(inside), np.mean(within), np.sqrt(np.mean(times))


@pytest.mark.parametrize("length", [1000.0, pytest.param(50.0, marks=pytest.mark.weekly)])
def test_intervals_of_two_points_hold_what_they_say(models, true_errors, length):
    """200 measured lengths of eight arms: 95 % and three standard deviations, of binomial counts as of arms.

    A binomial share of 200 has 1.5 %; the coverages of single arms scatter by about 5 %, the mean of eight by 1.8 %.
    """
    inside, _, times = shares(models, true_errors, length_at(MIDDLE, ACROSS, length), 100)
    assert inside > 0.95 - 3 * np.hypot(0.015, 0.018)
    # Nor are they too wide: errors are as large as the standard uncertainty.
    assert 0.75 < times < 1.25


@pytest.mark.parametrize(
    ("feature", "least"),
    [
        # Means of many points are stated too uncertain, which is the safe side: more than 95 %, to a half more.
        pytest.param(length_at(MIDDLE, ACROSS, 500.0, points=40), 0.6, marks=pytest.mark.weekly),
        pytest.param(sphere(MIDDLE, 25.0), 0.75, marks=pytest.mark.weekly),
        pytest.param(plane(MIDDLE, UP, 200.0), 0.75, marks=pytest.mark.weekly),
        # Up to 37 % of these postures are 0.6 rad or more outside the trained range of an arm, where the drawing's
        # error is stated and hardly made.
        (FACING, 0.75),
    ],
    ids=["length of 40 points", "ball", "plate lying", "plate facing"],
)
def test_errors_of_many_points_are_no_larger_than_stated(models, true_errors, feature, least):
    """95 % less two standard deviations of 200 measurements, as above: with all noise averaged it was 68 to 85 %.

    U is what 95 % of the errors do not exceed, and no longer the farther end of an interval, which held more.
    """
    _, within, times = shares(models, true_errors, feature, 100)
    assert within > 0.95 - 2 * np.hypot(0.015, 0.018)
    assert least < times < 1.25


@pytest.mark.weekly
def test_without_the_drawings_error_outside_the_trained_range_a_plate_facing_is_stated_closer(models, true_errors):
    """Towards the arm joints hardly move a tip: drawn alike in all directions, this was stated a third too large."""
    seen = []
    for model in models:
        other, function = copy.copy(model), model.variance_function_
        assert function.beyond.nominal > 0
        other.variance_function_ = replace(function, beyond=replace(function.beyond, nominal=0.0))
        seen.append(other)
    _, within, times = shares(seen, true_errors, FACING, 100)
    assert within > 0.95 - 2 * np.hypot(0.015, 0.018)
    assert 0.8 < times < 1.25


@pytest.mark.parametrize("kind", ["length", pytest.param("cylinder", marks=pytest.mark.weekly)])
def test_u_is_that_of_brute_force(kind):
    """A small version of ``python -m benchmarks uncertainty brute``: 15 %, and a standard error of 200 arms."""
    arm, shop = load_arm("measuring7"), load_preset("shop")
    feature = place_feature(kind, 100.0, arm)
    stated = simulate_measurements(PresetDistribution(arm, shop), feature, n_arms=200)
    errors = brute_force_errors([feature], [stated.angles], arm, shop, 200)
    assert stated.estimates[0].expanded_mm == pytest.approx(expanded_uncertainty(errors)[0], rel=0.22)


def test_u_holds_95_percent_of_errors_of_any_distribution():
    """On average over 400 draws of 1000: 95.0 % within the standard error of 0.04 %; the farther end held more."""
    rng = np.random.default_rng(1)
    for draw, inside in (
        (lambda: rng.standard_normal(1000), lambda U: 2 * norm.cdf(U) - 1),
        (lambda: rng.chisquare(3, 1000), lambda U: chi2.cdf(U, 3)),
    ):
        held = [inside(expanded_uncertainty(draw()[None])[0]) for _ in range(400)]
        assert np.mean(held) == pytest.approx(0.95, abs=0.0015)
