"""The growth of the residual variance outside the trained range, by outer regions held out."""

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.estimation.residual_variance import LEVEL, HeldOutReadings
from truearm.identification.judgement.outer_regions import (
    PRIOR_GROWTH,
    _ranges,
    _weighted_quantile,
    least_growth,
    outer_regions,
)
from truearm.models import KinematicModel, NominalModel
from truearm.readings import Session
from truearm.solve.distributions import chi2_quantile


def test_regions_are_the_ends_of_the_joints_and_a_joint_of_few_angles_has_none():
    angles = np.column_stack([np.linspace(-1, 1, 100), np.resize([0.0, 1.0], 100)])
    found = outer_regions(angles, np.ones(100, bool))
    assert [joint for joint, _ in found] == [0, 0]
    np.testing.assert_array_equal(np.flatnonzero(found[0][1]), np.arange(15))
    np.testing.assert_array_equal(np.flatnonzero(found[1][1]), np.arange(85, 100))
    assert not outer_regions(angles[:20], np.ones(20, bool))


def test_a_reading_that_stands_alone_does_not_stand_for_all_angles_on_the_way():
    """The range of angles evenly spaced is theirs; one at 3 rad ends it where the shares of 2 % and 15 % suggest."""
    even = np.linspace(-1.0, 1.0, 100)[:, None]
    np.testing.assert_array_equal(_ranges(even), [[-1.0, 1.0]])
    (low, high) = _ranges(np.append(even[:, 0], 3.0)[:, None])[0]
    assert low == -1.0
    step = 2 / 99
    assert high == pytest.approx(2 * (1.0 - step) - (1.0 - 14 * step), abs=1e-9)  # ranks 98 and 85 of 0 to 100


def test_the_least_growth_puts_a_reading_on_its_ellipsoid():
    """Deviations (m, 3) with their own covariance; solved by hand along one axis."""
    rng, m = np.random.default_rng(0), 40
    deviations, distance = rng.normal(size=(m, 3)) * 3, rng.uniform(0.1, 1.0, m)
    known = np.broadcast_to(0.5 * np.eye(3), (m, 3, 3))
    held_out = HeldOutReadings(np.arange(m), np.zeros(m, np.intp), deviations, known, np.ones(m))
    growth = least_growth(held_out, np.ones(m), distance)
    square = (deviations**2).sum(axis=1) / chi2_quantile(LEVEL, 3)  # = 0.5 + 1 + growth d
    np.testing.assert_allclose(growth, np.maximum((square - 1.5) / distance, 0.0), rtol=1e-4)


def test_the_quantile_counts_regions_alike():
    values, weight = np.array([0.0, 0.0, 3.0, 1.0]), np.array([0.1, 0.1, 0.1, 0.7])
    assert _weighted_quantile(values, weight, 0.89) == 1.0
    assert _weighted_quantile(values, weight, 0.91) == 3.0


def test_gross_errors_neither_bound_a_region_nor_are_inside():
    """A reading at the end of a joint that is not used leaves the regions as they are without it."""
    angles = np.column_stack([np.linspace(-1, 1, 101), np.resize([0.0, 1.0], 101)])
    angles[50, 0] = 3.0
    used = np.arange(101) != 50
    for (_, rows), (_, without) in zip(
        outer_regions(angles, used), outer_regions(angles[used], np.ones(100, bool)), strict=True
    ):
        np.testing.assert_array_equal(rows[used], without)
        assert not rows[50]


def test_gross_errors_leave_the_growth_as_without_them():
    arm, inside, _ = sessions(3e-4)
    bad = np.argsort(inside.angles[:, 0])[[0, 1, -2, -1]]
    points, good = inside.points.copy(), np.setdiff1d(np.arange(160), bad)
    points[bad] += 40.0
    whole, without = (
        KinematicModel(arm).fit(inside.angles[rows], of[rows]).variance_function_.beyond
        for rows, of in ((np.arange(160), points), (good, inside.points))
    )
    np.testing.assert_array_equal(whole.ranges, without.ranges)
    assert whole.growth == pytest.approx(without.growth, rel=0.1)


def test_where_no_region_is_judged_the_growth_is_a_prior():
    arm, inside, _ = sessions(3e-4)
    model = KinematicModel(arm).fit(inside.angles[:24], inside.points[:24])
    assert model.variance_function_.beyond.growth == PRIOR_GROWTH


def sessions(size, seed=0):
    """Readings inside, and farther out at either end of joint 4, of an arm with a wave that no constant describes."""
    arm, rng = load_arm("ur5"), np.random.default_rng(seed)
    angles = rng.uniform(-1.0, 1.0, (240, 6)) + arm.working
    angles[160:, 3] = arm.working[3] + np.sign(rng.normal(size=80)) * rng.uniform(1.05, 1.4, 80)
    bent = angles + size * np.sin(3 * angles + np.arange(6))
    points = arm.chain.tip_in_base(bent) + rng.normal(0, 0.02, (240, 3))
    return arm, Session(angles[:160], points[:160]), Session(angles[160:], points[160:])


@pytest.mark.parametrize("size", [3e-4, 0.0])
def test_points_outside_are_in_their_ellipsoids(size):
    """Waves of every joint, which constants imitate inside only; and none at all, where little is added."""
    arm, inside, outside = sessions(size)
    model = KinematicModel(arm).fit_readings(inside)
    points, covariance = model.predict_readings(outside, return_cov=True)
    off, growing = points - outside.points, model.variance_function_.beyond
    squares = (np.linalg.solve(covariance, off[:, :, None])[:, :, 0] * off).sum(axis=1)
    assert (squares < chi2_quantile(0.95, 3)).mean() > 0.9
    assert model.outside_training(outside).all()
    np.testing.assert_array_equal(growing.factor(inside.angles), 1.0)
    assert (growing.growth > 1) if size else growing.factor(outside.angles).max() < 1.5


def test_an_arm_with_nothing_free_has_regions_too():
    """The nominal arm in its own frame has no coefficient, and its errors are the same inside and outside."""
    arm, inside, _ = sessions(3e-4)
    model = NominalModel(arm, free=()).fit_readings(inside)
    np.testing.assert_allclose(
        model.held_out_.deviations, arm.chain.tip_in_base(inside.angles) - inside.points, atol=1e-9
    )
