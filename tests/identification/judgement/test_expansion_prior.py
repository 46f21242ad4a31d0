"""Growth of the links: a prior of materials, links behind the thermometer, and what readings did not show."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from truearm.arm import load_arm
from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.expansion_prior import _likelihood, _mixture, with_material_prior
from truearm.identification.judgement.thermal_lag import N_DRIFTS, LinkHistory
from truearm.identification.terms import ArmState, Constant, Term
from truearm.identification.terms.basis import Temperature
from truearm.identification.terms.links import MATERIALS, UNKNOWN_MATERIAL, Material


def mixture(information, right, shares):
    """Of what training shows, of the expansion, and of constants at links of 21 degC."""
    n = len(right)
    still = np.zeros((0, 1 + n)), np.zeros((n, N_DRIFTS))
    return _mixture([LinkHistory(information, right, np.eye(n), *still, 21.0, share) for share in shares])


def covariance_of(growth):
    """As `with_material_prior` makes it."""
    left, right = growth.products
    covariance, hidden = left @ right.T, growth.hidden
    covariance[-len(hidden) :, -len(hidden) :] += hidden
    return covariance


def test_without_information_growth_has_the_prior_of_an_unknown_material():
    growth = mixture(np.zeros((7, 7)), np.zeros(7), [0.0, 0.5, 1.0])
    np.testing.assert_allclose(covariance_of(growth)[7:14, 7:14], UNKNOWN_MATERIAL.covariance(7), rtol=1e-12)
    np.testing.assert_array_equal(growth.mean, np.zeros(21))
    assert growth.effective == pytest.approx(0.0, abs=1e-12)


def test_links_that_did_not_follow_the_thermometer_show_nothing():
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(3, 3)) * 1e7
    growth = mixture(matrix @ matrix.T, rng.normal(size=3) * 1e9, np.zeros(4))
    np.testing.assert_allclose(covariance_of(growth)[3:6, 3:6], UNKNOWN_MATERIAL.covariance(3), rtol=1e-12)
    np.testing.assert_array_equal(growth.mean[:3], np.zeros(3))


def test_the_mixture_is_the_integral_over_the_growth_of_one_link():
    """Against quadrature of the density of one coefficient, an observation of 8e-6 +- 5e-6 per kelvin."""
    shown, std, shares = 8e-6, 5e-6, np.array([0.3, 0.6, 1.0])
    found = mixture(np.array([[std**-2]]), np.array([shown / std**2]), shares)
    c = np.linspace(-1.5e-4, 1.5e-4, 200_001)
    stds = [np.sqrt(material.covariance(1)[0, 0]) for material in MATERIALS]
    density = sum(norm.pdf(c, scale=one) * norm.pdf(shown, a * c, std) for one in stds for a in shares)
    by_share = sum(norm.pdf(c, scale=one) * a * c * norm.pdf(shown, a * c, std) for one in stds for a in shares)
    mean, shows = (c * density).sum() / density.sum(), by_share.sum() / density.sum()
    variance = ((c - mean) ** 2 * density).sum() / density.sum()
    np.testing.assert_allclose(found.mean, [shows, mean, -mean], rtol=1e-6)
    np.testing.assert_allclose(covariance_of(found)[1:, 1:], variance * np.array([[1, -1], [-1, 1]]), rtol=1e-6)
    assert covariance_of(found)[0, 1] == pytest.approx((c * by_share).sum() / density.sum() - mean * shows, rel=1e-6)


def test_hypotheses_together_have_the_moments_of_one_after_the_other():
    """Of two gains, one of two histories, with drifts: sums over materials and histories, to rounding."""
    rng, n, n_others = np.random.default_rng(2), 3, 5
    gains, as_others = rng.normal(size=(2, n_others, n)), rng.normal(size=(n_others, N_DRIFTS))
    root, right = rng.normal(size=(n, n)) * 1e5, rng.normal(size=n) * 1e5
    drifts = rng.normal(size=(3, 2 * N_DRIFTS, 1 + n)) * 1e-6
    known = zip((gains[0], gains[0], gains[1]), (0.4, 1.0, 0.8), (0.0, 0.2, 0.1), drifts, strict=True)
    information = root @ root.T
    histories = [
        LinkHistory(information, right, gain, drift, as_others, 22.0 + share, share, slack, share)
        for gain, share, slack, drift in known
    ]
    logs, means, seconds = [], [], []
    for material, one in product(MATERIALS, histories):
        prior = material.covariance(n)
        half = np.linalg.cholesky(prior + one.slack**2 * np.diag(prior.diagonal()))
        shown, grown, warmer = one.share * half, np.linalg.solve(half, prior).T, one.mean_degC - 20.0
        matrix = shown.T @ information @ shown / 1.3 + np.eye(n)
        mean, covariance = np.linalg.solve(matrix, shown.T @ right / 1.3), np.linalg.inv(matrix)
        logs.append(one.log_evidence + 0.5 * (right @ shown @ mean / 1.3 - np.linalg.slogdet(matrix)[1]))
        causes = np.vstack([one.gain @ shown, grown, -warmer * grown])
        second = causes @ (covariance + np.outer(mean, mean)) @ causes.T
        second[n_others:, n_others:] += np.kron([[1, -warmer], [-warmer, warmer**2]], prior - grown @ grown.T)
        moved = as_others @ (one.drift @ [1.0, *(shown @ mean)]).reshape(-1, N_DRIFTS).T
        second[:n_others, :n_others] += moved @ moved.T
        means.append(causes @ mean)
        seconds.append(second)
    weights = np.exp(logs) / np.exp(logs).sum()
    mean = weights @ np.array(means)
    covariance = np.tensordot(weights, seconds, axes=1) - np.outer(mean, mean)
    found = _mixture(histories, 1.3)
    std = np.sqrt(covariance.diagonal())
    np.testing.assert_allclose(found.mean / std, mean / std, rtol=0, atol=1e-9)
    np.testing.assert_allclose(covariance_of(found) / np.outer(std, std), covariance / np.outer(std, std), atol=1e-9)


def test_links_of_other_time_constants_leave_the_expansion_as_open_as_their_shares():
    """Exact readings of a growth a c with a relative scatter of 0.2 of a: of c, not of what is shown, 0.2 remain."""
    information = np.eye(1) / 1e-9**2
    still = np.zeros((0, 2)), np.zeros((1, N_DRIFTS))
    history = LinkHistory(information, information @ [10e-6], np.eye(1), *still, 20.0, share=0.5, slack=0.2)
    growth = _mixture([history])
    np.testing.assert_allclose(growth.mean[:2], [10e-6, 20e-6 / 1.04], rtol=1e-3)
    metal = np.sqrt(MATERIALS[1].covariance(1)[0, 0])
    np.testing.assert_allclose(np.sqrt(covariance_of(growth)[1, 1]), metal * 0.2 / np.sqrt(1.04), rtol=1e-3)


def test_readings_weigh_the_materials_by_their_evidence():
    """Exact readings of 11.5e-6 leave metal only, and its posterior is the reading."""
    information = np.eye(3) / 1e-8**2
    growth = mixture(information, information @ np.full(3, 11.5e-6), [1.0])
    expansion = growth.mean[3:6]
    np.testing.assert_allclose(expansion, 11.5e-6, rtol=1e-4)
    metal = multivariate_normal(cov=MATERIALS[1].covariance(3)).logpdf(expansion)
    assert metal - multivariate_normal(cov=MATERIALS[0].covariance(3)).logpdf(expansion) > 15  # e^15: certain
    np.testing.assert_allclose(np.sqrt(covariance_of(growth).diagonal()[3:6]), 1e-8, rtol=1e-3)


def test_the_likelihood_is_the_posterior_without_its_prior():
    rng = np.random.default_rng(1)
    half, std = rng.normal(size=(9, 4)) * 1e5, np.full(4, 2e-5)
    information, right = half.T @ half, rng.normal(size=4) * 1e5
    covariance = np.linalg.inv(information + np.diag(std**-2.0))
    found, found_right = _likelihood(covariance, covariance @ right, std)
    np.testing.assert_allclose(found, information, rtol=1e-8, atol=1e-8 * np.abs(information).max())
    np.testing.assert_allclose(found_right, right, rtol=1e-8)


def test_a_widened_covariance_moves_no_estimate():
    """Growth of two links and a base beside it: the estimates are the same, and no variance is smaller or twofold."""
    thermal = [Term(f"link {i}", i, (0, 0, 0, 1.0, 0, 0), Temperature(i), "growth", 2e-5) for i in (1, 2)]
    base = Term("base", 0, (0, 0, 0, 1.0, 0, 0), Constant(), "base", 1.0)
    half = np.array([[2e5, 1e5, 1.0], [0.0, 1.5e5, -1.0], [5e4, 0.0, 2.0]])
    std = np.array([2e-5, 2e-5, 1.0])
    covariance = np.linalg.inv(half.T @ half + np.diag(std**-2.0))
    fit = IdentificationResult(
        PerturbedChain(load_arm("gao2017").chain, (*thermal, base)),
        np.array([8e-6, 1e-5, 0.1]),
        covariance,
        std,
        (TermGroupResult("growth", 2, 2.0, 1.0),),
        (),
        True,
        1,
    )
    drifting = ArmState(load_arm("gao2017").chain, np.zeros((11, 6)), temperature_degC=np.linspace(17, 27, 11))
    # Steps of two kelvin: links have settled.
    state = replace(drifting, temperature_degC=np.r_[17:28:2, 18:27:2].astype(float))
    found = with_material_prior(fit, state)
    behind = with_material_prior(fit, drifting)  # links may be 3 K behind
    assert (behind.covariance.diagonal()[:2] > 1.5 * found.covariance.diagonal()[:2]).all()
    wide = with_material_prior(replace(fit, covariance=1.4 * covariance), state, widened=1.4)
    np.testing.assert_allclose(wide.coefficients, found.coefficients, rtol=1e-12)
    assert wide.groups == found.groups
    share = wide.covariance.diagonal() / found.covariance.diagonal()
    assert (share > 1).all()
    assert (share < 1.4).all()
    assert np.linalg.eigvalsh(wide.covariance)[0] > -1e-12


def test_links_of_a_material_share_its_expansion():
    covariance = Material("steel", 3e-6, 4e-6).covariance(2)
    np.testing.assert_allclose(covariance, [[25e-12, 9e-12], [9e-12, 25e-12]], rtol=1e-12)
