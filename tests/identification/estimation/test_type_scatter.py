"""Laws of the constants of a type: planted means and scatters are recovered, what no readings determine stays."""

import numpy as np
import pytest

import truearm as ta
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.estimation.type_scatter import ReadingEquations, type_scatter
from truearm.identification.identify import Start, estimate_without_gross_errors
from truearm.identification.terms import Constant, Term, constants
from truearm.models import KinematicModel

UP = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def term(name, std=1.0, group="lengths and offsets", *, learn=True):
    return Term(name, 1, UP, Constant(), group, std, learn=learn)


def fleet(n, mean, scatter, rows, *, noise=0.01, seed=0):
    """Normal equations of n arms whose constants were drawn, from `rows` (m, p) of what is seen of them."""
    rng = np.random.default_rng(seed)
    arms = []
    for x in mean + scatter * rng.standard_normal((n, len(mean))):
        seen = rows(rng)
        values = seen @ x + noise * rng.standard_normal(len(seen))
        arms.append((seen.T @ seen / noise**2, seen.T @ values / noise**2))
    return arms


@pytest.fixture(scope="module")
def linearised():
    """Readings of an arm, their equations in two parts, and what they came from."""
    session = ta.simulate("ur10", poses=30, seed=1, strategy="uniform").session
    arm = ta.load_arm("ur10")
    readings = KinematicModel(arm).prepare(session)
    offered = constants(arm.chain)
    fit = estimate_without_gross_errors(readings, offered, Start(np.ones(30))).fit
    first = np.arange(30) < 12
    parts = [ReadingEquations.of(fit, offered, readings.state, readings.references, used) for used in (first, ~first)]
    return fit, readings, parts


def test_the_mean_and_scatter_of_a_type_are_those_planted():
    mean, scatter = np.array([0.9, -0.4, 0.0, 0.2]), np.array([0.1, 0.1, 0.2, 0.05])
    arms = fleet(200, mean, scatter, lambda rng: rng.standard_normal((12, 4)))
    found = type_scatter(arms, [term(name, std) for name, std in zip("abcd", (1.0, 2.0, 1.0, 0.5), strict=True)])
    assert (np.abs(found.mean - mean) < 4 * found.mean_std).all()
    np.testing.assert_allclose(found.mean_std, scatter / np.sqrt(200), rtol=0.15)  # seen well, they rest on the arms
    np.testing.assert_allclose(found.std, scatter, rtol=4 / np.sqrt(400))  # of 200 draws


def test_what_is_seen_exactly_has_the_mean_and_variance_of_the_sample():
    arms = fleet(50, np.array([1.0]), np.array([0.3]), lambda rng: np.eye(1), noise=1e-6)
    found, values = type_scatter(arms, [term("a")]), np.array([right[0] / gram[0, 0] for gram, right in arms])
    assert found.mean[0] == pytest.approx(values.mean(), abs=0.05 * found.mean_std[0])  # shrunk a little
    # The uncertainty of the mean belongs to each expected square: the variance has n - 1 in its denominator.
    assert found.std[0] == pytest.approx(values.std(ddof=1), rel=1e-2)


def test_a_sum_that_alone_is_seen_leaves_the_difference_open():
    """Of two constants only the sum is seen: its mean is known, that of their difference is not."""
    arms = fleet(100, np.array([0.6, 0.2]), np.full(2, 0.1), lambda rng: np.ones((6, 2)))
    found = type_scatter(arms, [term("a"), term("b")])
    assert found.mean.sum() == pytest.approx(0.8, abs=0.05)
    assert found.mean[0] == pytest.approx(found.mean[1])
    assert (found.mean_std > 0.2).all()
    assert np.hypot(*found.std) == pytest.approx(np.hypot(0.1, 0.1), rel=0.3)


def test_what_no_arm_shows_keeps_a_mean_of_zero_and_the_scatter_of_its_group():
    arms = fleet(100, np.array([0.5, 0.5, 9.0]), np.full(3, 0.1), lambda rng: np.eye(3)[[0, 0, 1, 1]])
    found = type_scatter(arms, [term("a"), term("b"), term("unseen")])
    assert found.mean[2] == pytest.approx(0, abs=1e-9)
    assert found.std[2] == pytest.approx(np.sqrt(found.std[0] * found.std[1]), rel=0.5)


def test_few_arms_shrink_the_scatter_towards_that_of_the_group():
    truth = np.full(12, 0.1)
    found = type_scatter(
        fleet(4, np.zeros(12), truth, lambda rng: np.eye(12)), [term(f"{i}", std=1.0) for i in range(12)]
    )
    values = np.log(found.std / 0.1)
    # Sample standard deviations of four alone scatter by 1 / sqrt(2 * 3).
    assert values.std() < 0.8 / np.sqrt(6)


def test_the_equations_are_the_squares_of_the_weighted_residuals(linearised):
    fit, readings, parts = linearised
    whole = parts[0] + parts[1]
    assert whole.n_residuals == 90
    problem = SmallMotionProblem(fit.perturbed_chain, readings.state, tuple(readings.references))
    step = 1e-3 * np.sqrt(fit.covariance.diagonal()) * np.random.default_rng(0).standard_normal(len(fit.coefficients))
    for x in (fit.coefficients, fit.coefficients + step):
        (residual,) = problem.residuals(x)
        plain = float(((fit.references[0].weights * residual) ** 2).sum())
        # A difference of numbers as large as b x: nine digits of it remain.
        assert whole.square(x) == pytest.approx(plain, abs=1e-9 * abs(whole.right @ x) + 1e-6)


def test_other_terms_are_integrated_out(linearised):
    _, _, parts = linearised
    whole = parts[0] + parts[1]
    own = np.array([one.learn for one in whole.terms])
    gram, right = whole.of_terms(own)
    # Plainly: the posterior of all under the priors of the others, in units of these.
    std = np.array([one.prior_stds[0] for one in whole.terms])
    plain = whole.gram * std * std[:, None] + np.eye(len(own))
    covariance = np.linalg.inv(plain)[np.ix_(own, own)]
    reduced = gram * std[own] * std[own][:, None] + np.eye(own.sum())
    np.testing.assert_allclose(np.linalg.inv(reduced), covariance, rtol=1e-5, atol=1e-8)
    mean = np.linalg.solve(plain, whole.right * std)[own]
    np.testing.assert_allclose(np.linalg.solve(reduced, right * std[own]), mean, rtol=1e-4, atol=1e-5)
