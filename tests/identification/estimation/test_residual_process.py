"""The proposal of a residual process: its evidence against the dense formula, and when there is none."""

import numpy as np
import pytest

from truearm.arm.chain import Chain
from truearm.identification.estimation import identification, residual_process
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.residual_process import (
    GROUP,
    MOST_POINTS,
    _equations,
    evidence_gain,
    propose_process,
)
from truearm.identification.references.references import Points, seats_of
from truearm.identification.terms import ArmState, constants

NOISE = 0.05  # mm


@pytest.fixture(scope="module")
def arm():
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [200, 0, 150]
    return Chain(fixed, np.array([0, 0, 120.0]))


def readings(arm, n, rng, *, bend=0.0):
    """Angles, and points with a smooth error that no constant explains: at most `bend` mm along each axis."""
    angles = rng.uniform(-1.2, 1.2, (n, 3))
    waves = np.stack([np.sin(2 * angles[:, 0]) * np.cos(angles[:, 1]), np.sin(angles.sum(axis=1)), angles[:, 2] ** 2])
    points = arm.tip_in_base(angles) + bend * waves.T + rng.normal(0, NOISE, (n, 3))
    return ArmState(arm, angles), [Points(np.arange(n), points)]


def identified(arm, state, references):
    return identify(arm, state, constants(arm, free=()), references)


def test_the_gain_of_evidence_is_that_of_the_dense_covariances(arm, rng):
    state, references = readings(arm, 40, rng, bend=0.3)
    fit = identified(arm, state, references)
    basis = propose_process(fit, state).terms[0].basis
    points = fit.references[0]
    columns = np.concatenate([c for _, _, c in fit.perturbed_chain.derivatives(state, fit.coefficients)], axis=2)
    J = columns.reshape(len(columns), -1).T
    axes = fit.perturbed_chain.chain.fixed[0, :3, :3].T
    Phi = (axes[:, None, :, None] * basis.values(state)[:, None]).reshape(-1, len(J)).T
    weights = points.weights.ravel()
    observed = J @ fit.coefficients - points.residuals.ravel()
    # The rounds end within a twentieth of a standard deviation of the minimum: a gradient is left.
    (equations,) = _equations(fit, state, [basis], points.weights, points.residuals, 40, 1.0)
    size, gain, explained = evidence_gain(*equations, np.array([0.2]))
    without = J @ np.diag(fit.prior_std**2) @ J.T + np.diag(weights**-2.0)

    def log_evidence(covariance):
        return -0.5 * (np.linalg.slogdet(covariance)[1] + observed @ np.linalg.solve(covariance, observed))

    expected = log_evidence(without + 0.2**2 * Phi @ Phi.T) - log_evidence(without)
    assert size == 0.2
    # The covariances have condition numbers of up to 1e10: six digits remain.
    assert gain == pytest.approx(expected, rel=1e-4)
    (A, b), prior = equations, 0.2**-2
    coefficients = np.linalg.solve(A + prior * np.eye(len(b)), b)
    assert explained == pytest.approx(coefficients @ b, rel=1e-6)  # A is symmetric to single precision


def test_a_smooth_error_is_proposed_and_noise_is_not(arm, rng):
    state, references = readings(arm, 150, rng, bend=0.3)
    proposed = propose_process(identified(arm, state, references), state)
    assert proposed.gain > 20
    assert {term.group for term in proposed.terms} == {GROUP}
    assert {term.place for term in proposed.terms} == {0}
    assert proposed.terms[0].n_coefficients <= MOST_POINTS
    assert 0.05 < proposed.terms[0].prior_stds[0] < 1.0  # mm, of an error of some 0.2 mm
    state, references = readings(arm, 150, rng)
    assert propose_process(identified(arm, state, references), state) is None


def test_a_sample_finds_the_same_evidence_as_all_readings(arm, monkeypatch):
    # Of a third of the noise: with residuals and covariance of unlike readings it would be dropped.
    monkeypatch.setattr(residual_process, "LEAST_SHARE", 0.0)
    state, references = readings(arm, 1200, np.random.default_rng(1), bend=0.02)
    fit = identified(arm, state, references)
    whole = propose_process(fit, state)
    monkeypatch.setattr(identification, "LEAST_SAMPLE", 300)
    sampled = propose_process(fit, state)
    assert whole.gain > 5
    # A of 300 poses instead of 1200: its entries are some per cent off.
    assert sampled.gain == pytest.approx(whole.gain, rel=0.3)
    assert sampled.terms[0].prior_std == pytest.approx(whole.terms[0].prior_std, rel=0.3)


def test_away_from_the_readings_the_process_fades_and_its_uncertainty_is_that_of_its_prior(arm, rng):
    state, references = readings(arm, 150, rng, bend=0.3)
    fit = identified(arm, state, references)
    proposed = propose_process(fit, state)
    more = identify(arm, state, [*fit.perturbed_chain.terms, *proposed.terms], references, start=fit)
    names = [term.name for term in more.perturbed_chain.terms]
    std = more.prior_std[-1]
    assert names[-1].startswith("residual process")
    far = ArmState(arm, np.array([[np.pi, np.pi, np.pi], [-2.9, 2.9, 3.0]]))
    near = ArmState(arm, state.angles[:2])
    basis = proposed.terms[0].basis
    assert np.abs(basis.values(far)).max() < 0.3
    np.testing.assert_allclose(
        more.unspanned_covariance(far), (std**2 * basis.remainder(far))[:, None, None] * np.eye(3), rtol=1e-3
    )
    assert np.trace(more.unspanned_covariance(near), axis1=1, axis2=2).max() < 0.2 * std**2
    before, after = (np.abs(one.references[0].residuals).mean() for one in (fit, more))
    assert after < 0.6 * before


def test_a_start_without_terms_is_one(arm, rng):
    state, references = readings(arm, 20, rng)
    cold = identified(arm, state, references)
    terms = cold.perturbed_chain.terms
    warm = identify(arm, state, list(terms), references, start=identify(arm, state, [], references))
    np.testing.assert_allclose(warm.tips(state), cold.tips(state), atol=1e-3)  # mm, a tenth of the noise


def test_a_start_leads_to_the_same_result(arm, rng):
    state, references = readings(arm, 100, rng)
    cold = identified(arm, state, references)
    warm = identify(arm, state, list(cold.perturbed_chain.terms), references, start=cold)
    assert warm.rounds <= cold.rounds
    # Both end within a twentieth of the uncertainty of a tip.
    off = np.abs(warm.tips(state) - cold.tips(state)).max()
    assert off < 0.1 * np.sqrt(np.trace(cold.tip_covariance(state), axis1=1, axis2=2)).max()


def test_without_points_none_is_proposed(arm, rng):
    angles = rng.uniform(-1.2, 1.2, (20, 3))
    state = ArmState(arm, angles)
    fit = identify(arm, state, constants(arm, free=()), [seats_of(np.arange(20), np.repeat(["A", "B"], 10))])
    assert propose_process(fit, state) is None
