"""Uncertainty of tips against each other: what is left when a frame is fitted to them."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from test_joint_errors import identified
from test_problem import random_chain, random_state

from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.propagation import relative_covariance
from truearm.identification.terms import constants
from truearm.identification.terms.catalogue import own_axis


def fitted(points, to):
    """Points, moved rigidly so that they lie nearest to others (W. Kabsch, Acta Cryst. A 32 (1976) 922)."""
    centre = points.mean(axis=0)
    turn, _ = Rotation.align_vectors(to - to.mean(axis=0), points - centre)
    return turn.apply(points - centre) + to.mean(axis=0)


def test_relative_covariance_is_the_scatter_of_sampled_arms_in_a_fitted_frame(rng):
    """Motions of 1e-5 rad and mm, so that second orders are below a part in a thousand; 1000 draws scatter by 4.5 %."""
    chain = random_chain(rng)
    fit = identified([*constants(chain), *own_axis(chain, 2, highest=3)], rng, std=1e-5)
    state = random_state(fit.perturbed_chain.chain, 12, rng)
    tips = fit.tips(state)
    draws = rng.multivariate_normal(fit.coefficients, fit.covariance, 1000, method="svd")
    scatter = np.stack([fitted(fit.perturbed_chain.tips(state, x), tips) - tips for x in draws])
    expected = np.einsum("dni,dnj->nij", scatter, scatter) / len(draws)
    found = relative_covariance(fit, state)
    np.testing.assert_allclose(found, expected, atol=0.1 * np.trace(found, axis1=1, axis2=2).max())
    assert np.trace(found, axis1=1, axis2=2).sum() < 0.999 * np.trace(fit.tip_covariance(state), axis1=1, axis2=2).sum()


def test_the_position_of_the_base_does_not_matter(rng):
    """However uncertain the base is, the same is left; without it, all of the base's own uncertainty is gone."""
    chain = random_chain(rng)
    only_base = [term for term in constants(chain, angle_std=0, length_std=0) if term.place == 0]
    fit = identified(only_base, rng, std=1e-3)
    state = random_state(fit.perturbed_chain.chain, 1500, rng)  # more than a piece
    assert np.abs(fit.tip_covariance(state)).max() > 1e-8
    assert np.abs(relative_covariance(fit, state)).max() < 1e-20

    nothing = replace(
        fit,
        perturbed_chain=PerturbedChain(fit.perturbed_chain.chain, ()),
        coefficients=np.zeros(0),
        covariance=np.zeros((0, 0)),
    )
    assert not relative_covariance(nothing, random_state(nothing.perturbed_chain.chain, 5, rng)).any()

    fit = identified([*only_base, *own_axis(chain, 1, highest=2)], rng, std=1e-3)
    wide = fit.covariance.copy()
    wide[:6, :6] += 1e-2 * np.eye(6)
    larger = relative_covariance(replace(fit, covariance=wide), state)
    np.testing.assert_allclose(larger, relative_covariance(fit, state), atol=1e-9)
