"""Evidence: by hand, at its fixed point, and against planted precisions."""

import numpy as np
import pytest
from sklearn.linear_model import BayesianRidge

from truearm.nets.levenberg_marquardt import Evidence, update_evidence


def test_one_parameter_by_hand():
    """J^T J = 8, beta = 0.5, alpha = 1: gamma = 1 - 1/(4 + 1) = 0.8, alpha = 0.8 / 4, beta = (10 - 0.8) / 23."""
    found = update_evidence(
        Evidence(1.0, 0.5, 0.0), gram=np.array([[8.0]]), parameter_squares=4.0, residual_squares=23.0, n_residuals=10
    )
    assert found.gamma == pytest.approx(0.8)
    assert found.alpha == pytest.approx(0.2)
    assert found.beta == pytest.approx(0.4)


def test_gamma_counts_what_the_data_determine():
    """Three directions known a million times better than the prior, two a million times worse."""
    gram = np.diag([1e6, 1e6, 1e6, 1e-6, 1e-6])
    found = update_evidence(
        Evidence(1.0, 1.0, 0.0), gram=gram, parameter_squares=5.0, residual_squares=7.0, n_residuals=10
    )
    assert found.gamma == pytest.approx(3, abs=1e-4)


def test_planted_precisions_are_recovered(rng):
    """Linear model, 40 parameters of standard deviation 0.5 and 2000 residuals of 0.1, well determined."""
    J = rng.normal(size=(2000, 40))
    y = J @ (0.5 * rng.normal(size=40)) + 0.1 * rng.normal(size=2000)
    evidence, gram = Evidence(1.0, 1.0, 0.0), J.T @ J
    for _ in range(30):
        x = np.linalg.solve(evidence.beta * gram + evidence.alpha * np.eye(40), evidence.beta * (J.T @ y))
        before = evidence
        evidence = update_evidence(
            evidence, gram=gram, parameter_squares=x @ x, residual_squares=np.sum((J @ x - y) ** 2), n_residuals=2000
        )
    assert evidence.alpha == pytest.approx(before.alpha, rel=1e-9)  # the fixed point
    assert evidence.beta**-0.5 == pytest.approx(0.1, rel=3 / np.sqrt(2 * 1960))
    assert evidence.alpha**-0.5 == pytest.approx(0.5, rel=3 / np.sqrt(2 * 40))
    assert evidence.gamma == pytest.approx(40, abs=0.1)


def test_at_the_fixed_point_the_evidence_is_greatest(rng):
    """The log evidence itself (MacKay 1992, eq. 4.6) falls to both sides in alpha and in beta."""
    J = rng.normal(size=(60, 15)) * np.logspace(0, -2, 15)
    y = J @ rng.normal(size=15) + 0.05 * rng.normal(size=60)

    def fitted(alpha, beta):
        A = beta * J.T @ J + alpha * np.eye(15)
        x = np.linalg.solve(A, beta * (J.T @ y))
        return A, x, np.sum((J @ x - y) ** 2)

    def log_evidence(alpha, beta):
        A, x, squares = fitted(alpha, beta)
        return 0.5 * (15 * np.log(alpha) + 60 * np.log(beta) - beta * squares - alpha * x @ x - np.linalg.slogdet(A)[1])

    evidence = Evidence(1.0, 1.0, 0.0)
    for _ in range(500):
        _, x, squares = fitted(evidence.alpha, evidence.beta)
        evidence = update_evidence(
            evidence, gram=J.T @ J, parameter_squares=x @ x, residual_squares=squares, n_residuals=60
        )
    best = log_evidence(evidence.alpha, evidence.beta)
    for factor in (0.9, 1.1):
        assert log_evidence(factor * evidence.alpha, evidence.beta) < best
        assert log_evidence(evidence.alpha, factor * evidence.beta) < best


def test_the_fixed_point_is_scikit_learns(rng):
    """BayesianRidge with flat priors on its precisions iterates the same equations by singular values."""
    J = rng.normal(size=(40, 12)) * np.logspace(0, -1.5, 12)
    y = J @ rng.normal(size=12) + 0.1 * rng.normal(size=40)
    peer = BayesianRidge(
        fit_intercept=False, max_iter=2000, tol=1e-13, alpha_1=0, alpha_2=0, lambda_1=0, lambda_2=0
    ).fit(J, y)
    evidence = Evidence(1.0, 1.0, 0.0)
    for _ in range(500):
        x = np.linalg.solve(evidence.beta * J.T @ J + evidence.alpha * np.eye(12), evidence.beta * (J.T @ y))
        evidence = update_evidence(
            evidence, gram=J.T @ J, parameter_squares=x @ x, residual_squares=np.sum((J @ x - y) ** 2), n_residuals=40
        )
    assert evidence.beta == pytest.approx(peer.alpha_, rel=1e-6)  # scikit-learn's names are the other way round
    assert evidence.alpha == pytest.approx(peer.lambda_, rel=1e-6)
    np.testing.assert_allclose(x, peer.coef_, rtol=1e-6)


def test_directions_that_rounding_leaves_below_zero_count_for_nothing():
    """Eigenvalues 1 and -1e-9, as the sums over readings of a singular matrix may come out."""
    gram = np.array([[0.5, 0.5], [0.5, 0.5]]) + 1e-9 * np.array([[-0.5, 0.5], [0.5, -0.5]])
    found = update_evidence(
        Evidence(1e-12, 1.0, 0.0), gram=gram, parameter_squares=1.0, residual_squares=1.0, n_residuals=10
    )
    assert found.gamma == pytest.approx(1, abs=1e-6)


def test_nothing_to_learn_from_keeps_the_precisions():
    found = update_evidence(
        Evidence(3.0, 4.0, 0.0), gram=np.zeros((2, 2)), parameter_squares=0.0, residual_squares=0.0, n_residuals=5
    )
    assert (found.alpha, found.beta) == (3.0, 4.0)
