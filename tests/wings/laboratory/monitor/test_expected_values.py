"""The deviations that the uncertainty of a model explains: each against errors drawn with that uncertainty."""

import numpy as np
import pytest
from scipy.special import fdtri, stdtrit

from truearm.wings.laboratory.monitor.expected_values import (
    FREEDOM,
    PointErrors,
    largest_form_and_diameter,
    largest_length_error,
    largest_scatter,
)
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere

N_DRAWN = 20_000
RATE = 0.01
# Standard deviation of a rate of 1 % in so many draws.
RATE_STD = np.sqrt(RATE / N_DRAWN)


def errors_of(rng, n, k=3):
    """Points of unequal scatter that share the errors of k causes."""
    return PointErrors(rng.uniform(0.002, 0.01, n), 0.005 * rng.standard_normal((k, n, 3)))


def drawn(rng, errors, n_drawn=N_DRAWN):
    """(m, n, 3) errors with the stated uncertainty, of a scale that is itself uncertain."""
    own = errors.std_mm[:, None] * rng.standard_normal((n_drawn, len(errors.std_mm), 3))
    shared = np.tensordot(rng.standard_normal((n_drawn, len(errors.shared_mm))), errors.shared_mm, axes=1)
    scale = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, n_drawn))
    return scale[:, None, None] * (own + shared)


def test_scatter_of_equal_points_is_an_f_variable():
    """``(n - 1) s^2 / (3 (n - 1) sigma^2)`` is F of 3 (n - 1) and `FREEDOM` degrees; the quantile is 1 % too large."""
    found = largest_scatter(PointErrors(np.full(10, 0.005), np.zeros((0, 10, 3))), RATE)
    assert found == pytest.approx(2 * 0.005 * np.sqrt(3 * fdtri(27, FREEDOM, 1 - RATE)), rel=0.01)


def test_a_displacement_that_all_points_share_is_no_scatter(rng):
    """The whole seat is elsewhere: neither its scatter nor a length between seats that move alike changes."""
    std, same = np.full(6, 0.005), np.broadcast_to(rng.standard_normal(3), (1, 6, 3))
    apart, alike = PointErrors(std, np.zeros((0, 6, 3))), PointErrors(std, same)
    assert largest_scatter(alike, RATE) == pytest.approx(largest_scatter(apart, RATE), rel=1e-9)
    lengths = [
        largest_length_error(one, one, np.array([1.0, 0, 0]), u_artefact_mm=0.0, probability=RATE)
        for one in (apart, alike)
    ]
    assert lengths[1] == pytest.approx(lengths[0], rel=1e-9)
    # Means of six points each.
    assert lengths[0] == pytest.approx(0.005 * np.sqrt(2 / 6) * -stdtrit(FREEDOM, RATE / 2))


def test_scatter_is_exceeded_as_often_as_stated(rng):
    errors = errors_of(rng, 7)
    away = drawn(rng, errors)
    away -= away.mean(axis=1, keepdims=True)
    scatter = 2 * np.sqrt((away**2).sum(axis=(1, 2)) / 6)
    assert (scatter > largest_scatter(errors, RATE)).mean() == pytest.approx(RATE, abs=4 * RATE_STD + 0.1 * RATE)


def test_length_errors_are_exceeded_as_often_as_stated(rng):
    errors, direction = errors_of(rng, 8), np.array([0.6, 0.0, 0.8])
    points = drawn(rng, errors) @ direction
    measured = points[:, :4].mean(axis=1) - points[:, 4:].mean(axis=1)
    a, b = errors.of(np.arange(4)), errors.of(np.arange(4, 8))
    largest = largest_length_error(a, b, direction, u_artefact_mm=0.0, probability=RATE)
    assert (np.abs(measured) > largest).mean() == pytest.approx(RATE, abs=4 * RATE_STD)
    with_artefact = largest_length_error(a, b, direction, u_artefact_mm=0.02, probability=RATE)
    unit = -stdtrit(FREEDOM, RATE / 2)
    assert with_artefact == pytest.approx(np.hypot(largest, 0.02 * unit))


def test_form_is_exceeded_no_more_often_than_stated_and_the_diameter_as_often(rng):
    """By fits of the sphere. The sum over the pairs makes the rate of the form smaller, not below a third."""
    outward = rng.standard_normal((9, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    errors = errors_of(rng, 9)
    form, diameter = largest_form_and_diameter(errors, outward, 0.05)
    fits = [fit_sphere(15.0 * outward + away) for away in drawn(rng, errors, 500)]
    std = np.sqrt(0.05 / 500)
    assert 0.05 / 3 < np.mean([fit.form_mm > form for fit in fits]) < 0.05 + 3 * std
    off = np.mean([abs(2 * fit.radius_mm - 30.0) > diameter for fit in fits])
    assert off == pytest.approx(0.05, abs=4 * std)
