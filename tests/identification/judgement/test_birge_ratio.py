"""By how much a posterior is too sure: residuals as shown over residuals as supposed."""

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.estimation.identification_result import ReferenceFit
from truearm.identification.judgement.cross_validation import birge_ratio
from truearm.models import KinematicModel
from truearm.readings import Session


def of(kind, rows, std, noise_std):
    rows = np.arange(rows[0], rows[1])
    zeros = np.zeros((3, len(rows)))
    return ReferenceFit(
        kind, rows, zeros, zeros + std, noise_std, np.ones(len(rows)), np.zeros(len(rows), dtype=int), {}
    )


def test_without_a_stated_uncertainty_the_ratio_is_that_of_the_noise():
    assert birge_ratio([of("point", (0, 10), 0.0, 0.01)], np.arange(10), 0.02) == pytest.approx(2.0)
    assert birge_ratio([of("point", (0, 10), 0.0, 0.01)], np.arange(10), 0.005) == 1.0


def test_the_stated_uncertainty_is_in_numerator_and_denominator():
    """sqrt((0.3^2 + 0.4^2) / 0.3^2) = 5/3, by hand."""
    assert birge_ratio([of("point", (0, 10), 0.3, 0.0)], np.arange(10), 0.4) == pytest.approx(5 / 3)
    assert birge_ratio([of("point", (0, 10), 0.3, 1e-6)], np.arange(10), 0.03) == pytest.approx(1.005, abs=1e-4)


def test_only_held_out_readings_count():
    """Points judge a reading that has both; surfaces judge nothing; readings that were not held out neither."""
    points, seats, spheres = of("point", (0, 10), 0.2, 0.0), of("seat", (0, 20), 0.0, 0.005), of("sphere", (0, 9), 0, 1)
    assert birge_ratio([points, seats, spheres], np.arange(10), 0.01) == pytest.approx(np.sqrt(1.0025))
    assert birge_ratio([points, seats], np.arange(10, 20), 0.01) == pytest.approx(2.0)
    assert birge_ratio([points, seats], np.arange(20), 0.01) == pytest.approx(np.sqrt((1.0025 + 4) / 2))
    assert birge_ratio([spheres], np.arange(0), 0.01) == 1.0


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.weekly) for i in range(1, 4))])
def test_a_reference_that_states_its_uncertainty_does_not_widen(seed):
    """A perfect arm seen to 0.05 mm, stated: the posterior is as sure as it should be."""
    rng = np.random.default_rng(seed)
    arm = load_arm("gao2017")
    angles = arm.working + 0.8 * rng.uniform(-1, 1, (80, 6))
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 0.05, (80, 3))
    model = KinematicModel(arm).fit_readings(Session(angles, points, np.full((80, 3), 0.05)))
    # The unexplained is found to be anything up to a half of what is stated: a root of 1.25.
    assert 1 <= model.birge_ratio_ < 1.15
