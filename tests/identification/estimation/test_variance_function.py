"""Where in the joint space readings scatter more: the function is found where there is one, and flat where not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import check_grad

from refusals import refuses
from truearm.identification.estimation.residual_variance import (
    HeldOutReadings,
    VarianceFunction,
    _posterior,
    fit_variance_function,
)

N_JOINTS = 3


def held_out(angles, share, *, seed=0, group=None, known=1e-4, freedom=1.0):
    """Deviations of standard deviation 0.1 mm times the root of the share."""
    rng = np.random.default_rng(seed)
    n = len(angles)
    covariance = np.tile(known * np.diag([1.0, 2.0, 3.0]), (n, 1, 1))
    std = np.sqrt(0.01 * freedom * share[:, None] + covariance.diagonal(axis1=1, axis2=2))
    group = np.arange(n) if group is None else group
    return HeldOutReadings(np.arange(n), group, std * rng.normal(size=(n, 3)), covariance, np.full(n, freedom))


def angles_of(n, seed=1):
    return np.random.default_rng(seed).uniform([-2, 0, 1], [2, 1, 4], (n, N_JOINTS))


@pytest.mark.parametrize("freedom", [1.0, 0.75])
def test_a_planted_variance_function_is_recovered(freedom):
    angles = angles_of(3000)
    planted = VarianceFunction(
        angles.mean(axis=0), angles.std(axis=0), np.array([0.4, 0.0, -0.2]), np.array([0.0, 0.3, 0.0])
    )
    share = planted.share(angles)
    found = fit_variance_function(held_out(angles, share, freedom=freedom), angles)
    # 9000 deviations tell a logarithm of variance, of Student's tails, to some 0.02 a coefficient.
    np.testing.assert_allclose(found.slope, planted.slope, atol=0.08)
    np.testing.assert_allclose(found.curvature, planted.curvature, atol=0.08)
    np.testing.assert_allclose(found.share(angles), share / share.mean(), rtol=0.25)


def test_equal_scatter_gives_a_flat_function():
    angles = angles_of(3000)
    share = fit_variance_function(held_out(angles, np.ones(3000)), angles).share(angles)
    assert share.mean() == pytest.approx(1, rel=1e-12)
    assert np.abs(np.log(share)).max() < 0.1


def test_few_readings_leave_it_flat():
    angles = angles_of(5 * 2 * N_JOINTS - 1)
    far = np.where(angles[:, 0] > 0, 3.0, 0.3)
    assert (fit_variance_function(held_out(angles, far), angles).share(angles) == 1).all()


def test_readings_of_a_group_count_as_one():
    """Each reading ten times in a group tells no more than once."""
    angles = angles_of(200)
    once = held_out(angles, np.exp(angles[:, 0]))
    ten = HeldOutReadings(
        np.tile(once.rows, 10),
        np.tile(once.group, 10),
        np.tile(once.deviations, (10, 1)),
        np.tile(once.covariance, (10, 1, 1)),
        np.tile(once.freedom, 10),
    )
    one, many = fit_variance_function(once, angles), fit_variance_function(ten, angles)
    np.testing.assert_allclose(many.slope, one.slope, atol=1e-4)  # where L-BFGS-B stops


def test_a_few_wrong_readings_do_not_bend_it():
    angles = angles_of(1000)
    readings = held_out(angles, np.ones(1000))
    wrong = np.argsort(angles[:, 0])[-3:]
    readings.deviations[wrong] = 5.0  # fifty standard deviations
    share = fit_variance_function(readings, angles).share(angles)
    assert np.abs(np.log(share)).max() < 0.4


def test_a_joint_that_stood_still_has_no_part():
    angles = angles_of(100)
    angles[:, 1] = 0.7
    found = fit_variance_function(held_out(angles, np.ones(100)), angles)
    assert found.slope[1] == found.curvature[1] == 0
    assert (found.share(angles + [0, 1.0, 0]) == found.share(angles)).all()


def test_far_from_the_readings_no_less_is_unexplained_than_on_average():
    function = VarianceFunction(np.zeros(2), np.ones(2), np.array([-0.5, 0.0]), np.zeros(2))
    angles = np.array([[1.0, 0.0], [2.0, 0.0], [2.9, 0.0], [3.1, 0.0], [100.0, 0.0], [-100.0, 0.0]])
    np.testing.assert_allclose(function.share(angles), np.exp([-0.5, -1.0, -1.0, 0.0, 0.0, 1.0]))


def test_without_held_out_readings_the_function_is_flat():
    nothing = HeldOutReadings(
        np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
    )
    assert (fit_variance_function(nothing, angles_of(5)).share(angles_of(7)) == 1).all()


@settings(max_examples=25)
@given(
    parameters=st.lists(st.floats(-1, 1), min_size=7, max_size=7),
    n=st.integers(2, 30),
    known=st.sampled_from([0.0, 1e-4, 1.0]),
)
def test_gradient_is_that_of_difference_quotients(parameters, n, known):
    angles = angles_of(n)
    readings = held_out(angles, np.ones(n), known=known, group=np.arange(n) // 2)
    features = np.hstack([angles - 1, angles**2])
    deviance = _posterior(readings, features)
    at = np.array(parameters) / 3
    error = check_grad(lambda p: deviance(p, 25.0)[0], lambda p: deviance(p, 25.0)[1], at)
    assert error < 1e-5 * max(1.0, np.linalg.norm(deviance(at, 25.0)[1]), abs(deviance(at, 25.0)[0]))


@settings(max_examples=25)
@given(n=st.integers(1, 40), seed=st.integers(0, 10), factor=st.floats(1e-3, 1e3))
def test_share_is_one_on_average_and_free_of_units(n, seed, factor):
    angles = angles_of(n, seed)
    readings = held_out(angles, np.ones(n), seed=seed)
    found = fit_variance_function(readings, angles)
    assert found.share(angles).mean() == pytest.approx(1, rel=1e-9)
    larger = HeldOutReadings(
        readings.rows, readings.group, factor * readings.deviations, factor**2 * readings.covariance, readings.freedom
    )
    np.testing.assert_allclose(fit_variance_function(larger, angles).share(angles), found.share(angles), rtol=1e-2)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"spread": np.array([1.0, 0.0])}, "positive spread"),
        ({"mean": 0.0}, "positive mean"),
        ({"mean": float("nan")}, "positive mean"),
        ({"curvature": np.array([0.0, 11.0])}, "within 10"),
        ({"slope": np.zeros(3)}, "four finite numbers"),
        ({"slope": np.array([np.nan, 0.0])}, "four finite numbers"),
    ],
)
def test_invalid_variance_functions_are_refused(change, told):
    parts = {"centre": np.zeros(2), "spread": np.ones(2), "slope": np.zeros(2), "curvature": np.zeros(2), "mean": 1.0}
    refuses(told, VarianceFunction, **(parts | change))
