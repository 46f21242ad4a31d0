"""Posterior from few data: the same as from the equations of the parameters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.solve.group_evidence import GroupedEquations, GroupedPrior, LowRankEquations, posterior


def drawn(seed, n, p, *, decades):
    """A problem of n data, and priors over some decades."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(n, p)) * 10.0 ** rng.uniform(-2, 2, p)
    ratio = 10.0 ** rng.uniform(-decades / 2, decades / 2, p)
    prior = GroupedPrior(ratio, np.arange(p) % 3, np.array([0.5, 1.0, 2.0]), np.ones(3, bool))
    return J, rng.normal(size=n), prior


@given(seed=st.integers(0, 999), n=st.integers(1, 12), decades=st.floats(0, 6))
@settings(max_examples=30)
def test_it_is_the_posterior_of_the_parameters(seed, n, decades):
    J, y, prior = drawn(seed, n, 40, decades=decades)
    gram, right = J.T @ J, J.T @ y
    equations = GroupedEquations(gram, right, gram.diagonal(), n)
    assert equations._few is not None
    plain, found = posterior(gram, right, prior), equations.posterior(prior)
    std = prior.ratio * prior.scale[prior.group]
    # In units of the priors; the equations of the parameters lose the digits of their condition.
    np.testing.assert_allclose(found.x / std, plain.x / std, atol=1e-6)
    np.testing.assert_allclose(found.covariance / np.outer(std, std), plain.covariance / np.outer(std, std), atol=1e-6)
    np.testing.assert_allclose(found.variance, found.covariance.diagonal(), atol=1e-12 * (std**2).max())
    pull = np.random.default_rng(seed).normal(size=40) / std
    np.testing.assert_allclose(found.times(pull) / std, found.covariance @ pull / std, atol=1e-9)
    np.testing.assert_array_equal(found.block(np.array([3, 5])), found.covariance[np.ix_([3, 5], [3, 5])])


def test_a_prior_without_limit_is_least_squares_of_the_rest():
    """One free constant, whose prior is 1e8 times wider than its data: the digits of the others remain."""
    rng = np.random.default_rng(0)
    J = np.column_stack([np.ones(6), 0.1 * rng.normal(size=(6, 30))])
    y = 5.0 + rng.normal(size=6)
    prior = GroupedPrior(np.r_[1e8, np.ones(30)], np.zeros(31, int), np.ones(1), np.ones(1, bool))
    found = GroupedEquations(J.T @ J, J.T @ y, (J**2).sum(axis=0), 6).posterior(prior)
    M = np.eye(6) + J[:, 1:] @ J[:, 1:].T
    precision = np.ones(6) @ np.linalg.solve(M, np.ones(6))
    np.testing.assert_allclose(found.x[0], np.ones(6) @ np.linalg.solve(M, y) / precision, rtol=1e-9)
    np.testing.assert_allclose(found.covariance[0, 0], 1 / precision, rtol=1e-9)


def test_pruned_parameters_are_zero():
    J, y, prior = drawn(0, 4, 20, decades=1)
    prior = GroupedPrior(prior.ratio, prior.group, np.array([1.0, 0.0, 1.0]), prior.learned)
    equations = GroupedEquations(J.T @ J, J.T @ y, (J**2).sum(axis=0), 4)
    found, plain = equations.posterior(prior), posterior(J.T @ J, J.T @ y, prior)
    np.testing.assert_allclose(found.x, plain.x, atol=1e-9)
    assert not found.covariance[1::3].any()
    assert not found.x[1::3].any()
    assert not equations.posterior(prior).variance[1::3].any()


@pytest.mark.parametrize("why", ["rank", "right"])
def test_other_equations_are_left_to_the_parameters(why):
    J, y, prior = drawn(1, 9 if why == "rank" else 3, 20, decades=1)
    right = J.T @ y + (1.0 if why == "right" else 0.0)
    gram = J.T @ J
    assert LowRankEquations.of(gram, right, gram.diagonal()) is None
    found = GroupedEquations(gram, right, gram.diagonal(), 3).posterior(prior)
    np.testing.assert_allclose(found.x, posterior(gram, right, prior).x)
