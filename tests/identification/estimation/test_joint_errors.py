"""A joint's own error: what its harmonics do to the joint, with the uncertainty of their coefficients."""

from dataclasses import replace

import numpy as np
from test_problem import random_chain, random_state

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import constants
from truearm.identification.terms.catalogue import own_axis, wobble
from truearm.wings.reports.term_effects import joint_error

CIRCLE = np.linspace(-np.pi, np.pi, 720, endpoint=False)  # all harmonics below order 720 have mean zero on it


def identified(terms, rng, *, n=4, std=1e-4) -> IdentificationResult:
    """Drawn coefficients [rad, mm] with a covariance of correlated ones."""
    perturbed_chain = PerturbedChain(random_chain(rng, n), tuple(terms))
    m = perturbed_chain.n_coefficients
    root = rng.normal(0, std / np.sqrt(m), (m, m))
    return IdentificationResult(perturbed_chain, rng.normal(0, std, m), root @ root.T, np.full(m, std), (), (), True, 1)


def test_joint_error_is_true_angle_less_encoder_angle(rng):
    """The tips with the terms are those of the chain without, its joint turned by the error: exactly."""
    chain = random_chain(rng)
    fit = identified(own_axis(chain, 2, highest=12), rng)
    state = random_state(fit.perturbed_chain.chain, 30, rng)
    found = joint_error(fit, 2, state.angles[:, 1], mean_at=CIRCLE)
    turned = state.angles + found.error[:, None] * (np.arange(4) == 1)
    np.testing.assert_allclose(
        fit.tips(state), fit.perturbed_chain.chain.tip_in_base(turned), atol=1e-9
    )  # rounding, mm


def test_its_mean_is_zero_where_it_was_asked_to_be_and_nothing_else_changes(rng):
    fit = identified(own_axis(random_chain(rng), 1, highest=5), rng)
    at, readings = np.linspace(-1, 1, 50), rng.uniform(-1, 0.5, 200)
    found, on_circle = (joint_error(fit, 1, at, mean_at=mean_at) for mean_at in (readings, CIRCLE))
    assert abs(joint_error(fit, 1, readings, mean_at=readings).error.mean()) < 1e-18
    np.testing.assert_allclose(np.diff(found.error), np.diff(on_circle.error), atol=1e-17)


def test_joint_error_uncertainty_is_that_of_sampled_coefficients(rng):
    """Standard deviations of 2000 draws scatter by 1.6 %; those of amplitudes hold to first order besides."""
    chain = random_chain(rng)
    terms = [*constants(chain), *own_axis(chain, 3, highest=6), *wobble(chain, 3)]
    fit = identified(terms, rng)
    covariance = fit.covariance * 1e-4  # small beside the amplitudes
    fit = replace(fit, covariance=covariance)
    at, readings = np.linspace(-2, 1, 40), rng.uniform(-2, 1, 60)
    found = joint_error(fit, 3, at, mean_at=readings)
    draws = [
        joint_error(replace(fit, coefficients=x), 3, at, mean_at=readings)
        for x in rng.multivariate_normal(fit.coefficients, covariance, 2000, method="svd")
    ]
    np.testing.assert_allclose(np.std([draw.error for draw in draws], axis=0), found.std, rtol=0.06)
    np.testing.assert_allclose(np.std([draw.amplitudes for draw in draws], axis=0), found.amplitudes_std, rtol=0.06)


def test_amplitudes_are_those_of_the_curve_by_order(rng):
    fit = identified(own_axis(random_chain(rng), 4, highest=9), rng)
    found = joint_error(fit, 4, CIRCLE, mean_at=CIRCLE)
    spectrum = 2 * np.abs(np.fft.rfft(found.error)) / len(CIRCLE)
    assert found.orders.tolist() == list(range(1, 10))
    np.testing.assert_allclose(spectrum[1:10], found.amplitudes, atol=1e-15)
    np.testing.assert_allclose(spectrum[10:], 0, atol=1e-15)


def test_only_harmonics_of_its_own_angle_about_its_own_axis_count(rng):
    chain = random_chain(rng)
    fit = identified([*constants(chain), *own_axis(chain, 1), *wobble(chain, 2)], rng)
    found = joint_error(fit, 2, np.linspace(0, 1, 5), mean_at=CIRCLE)
    assert len(found.orders) == len(found.amplitudes) == len(found.amplitudes_std) == 0
    assert not found.error.any()
    assert not found.std.any()


def test_an_amplitude_of_zero_has_an_uncertainty(rng):
    fit = identified(own_axis(random_chain(rng), 1, highest=2), rng)
    fit = replace(fit, coefficients=np.zeros(4), covariance=4e-10 * np.eye(4))
    found = joint_error(fit, 1, CIRCLE, mean_at=CIRCLE)
    np.testing.assert_allclose(found.amplitudes_std, 2e-5)
