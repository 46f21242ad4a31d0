"""Sums over readings: parts add up, correlated readings are worth less, and the uncertainty says so."""

import numpy as np
import pytest

import truearm as ta
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.reading_sums import ReadingSums
from truearm.identification.estimation.residual_variance import paule_mandel_variance
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, constants
from truearm.solve.sums import BLOCK, SHORT_BLOCKS

NOISE = 0.05
NONE_GROSS = np.inf


def ar1(n: int, p: int, rho: float, rng: np.random.Generator) -> np.ndarray:
    from scipy.signal import lfilter

    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], rng.normal(size=(n, p)), axis=0)


@pytest.fixture(scope="module")
def arm():
    return ta.load_arm("ur10")


@pytest.fixture(scope="module")
def chain(arm):
    return PerturbedChain(arm.chain, tuple(constants(arm.chain, free=("base", "tip"))))


def prior_std(chain):
    return np.concatenate([term.prior_stds for term in chain.terms])


def readings(arm, chain, n, *, rho, seed):
    """A smooth path of a planted arm, its coefficients, and points with autocorrelated noise."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=chain.n_coefficients) * np.minimum(prior_std(chain), 1e-3)
    state = ArmState.of(arm, ar1(n, 6, 0.998, rng))
    return state, Points(np.arange(n), chain.tips(state, x) + NOISE * ar1(n, 3, rho, rng)), x


def estimated(chain, state, points):
    every, x = np.arange(chain.n_coefficients), np.zeros(chain.n_coefficients)
    for _ in range(4):
        sums, _ = ReadingSums.of(chain, state, points, x, NOISE**2, NONE_GROSS)
        found = sums.posterior(x, prior_std(chain), every)
        x = found.x
    return found, sums


def coverage(chain, state, covariance, x, truth):
    """Share of the tips inside the 95 % ellipsoids of a covariance of the coefficients."""
    off = chain.tips(state, x) - chain.tips(state, truth)
    of_tips = of_the_tips(chain, state, covariance, x)
    return (np.einsum("ni,nij,nj->n", off, np.linalg.inv(of_tips), off) < 7.815).mean()


def of_the_tips(chain, state, covariance, x):
    """(n, 3, 3) covariances of the tips by one of the coefficients."""
    each = chain.derivatives(state, x)
    return np.concatenate([np.einsum("pin,pq,qjn->nij", by, covariance, by) for _, _, by in each])


def test_sums_of_parts_add_up_to_those_of_all(arm, chain):
    n = 3000
    state, points, x = readings(arm, chain, n, rho=0.0, seed=1)
    whole, _ = ReadingSums.of(chain, state, points, x, NOISE**2, 3.0)
    parts = ReadingSums.zero(len(x))
    for rows in np.split(np.arange(n), [10 * (n // SHORT_BLOCKS)]):
        part = Points(np.arange(len(rows)), points.points[rows])
        parts = parts + ReadingSums.of(chain, state.rows(rows), part, x, NOISE**2, 3.0, n)[0]
    assert whole.n == parts.n < n
    assert whole.n_gross == parts.n_gross == n - whole.n
    for name in ("gram", "gradient", "clipped", "scores"):
        a, b = getattr(whole, name), getattr(parts, name)
        assert np.abs(a - b).max() <= 1e-9 * np.abs(a).max()
    assert np.abs(whole.without(parts).gram).max() <= 1e-9 * np.abs(whole.gram).max()


def test_the_noise_between_trials_is_that_of_the_residuals(arm, chain):
    state, points, x = readings(arm, chain, 4 * BLOCK, rho=0.0, seed=2)
    residuals = chain.tips(state, x) - points.points
    exact = paule_mandel_variance(residuals, np.zeros_like(residuals), n_effective=25.0, robust=True)
    for assumed in (0.2 * NOISE**2, NOISE**2, 3 * NOISE**2):
        sums, _ = ReadingSums.of(chain, state, points, x, assumed, NONE_GROSS)
        assert sums.noise_mm2(assumed, 25.0) == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize(("n", "seeds"), [(3000, 10), pytest.param(32 * BLOCK, 10, marks=pytest.mark.weekly)])
def test_points_lie_in_their_ellipsoids_as_often_as_stated_though_neighbours_have_like_errors(arm, chain, n, seeds):
    rho, stated, independent, factors = 0.9, [], [], []
    for seed in range(seeds):
        state, points, truth = readings(arm, chain, n, rho=rho, seed=seed)
        found, sums = estimated(chain, state, points)
        covariance, effect = sums.correlated(found, prior_std(chain), np.arange(len(truth)))
        test = ArmState.of(arm, np.random.default_rng(seed + 100).normal(size=(200, 6)))
        stated.append(coverage(chain, test, covariance, found.x, truth))
        independent.append(coverage(chain, test, found.covariance, found.x, truth))
        factors.append(effect.factor)
    assert 0.90 < np.mean(stated) < 0.995
    assert np.mean(independent) < 0.3
    # Of few blocks the fit takes up a part of the scatter.
    assert np.mean(factors) == pytest.approx((1 + rho) / (1 - rho), rel=0.3 if n > 3000 else 0.45)


def test_independent_readings_keep_their_uncertainty(arm, chain):
    state, points, truth = readings(arm, chain, 24 * BLOCK, rho=0.0, seed=3)
    found, sums = estimated(chain, state, points)
    covariance, effect = sums.correlated(found, prior_std(chain), np.arange(len(truth)))
    assert effect.factor < 1.3
    ratio = np.diag(covariance) / np.diag(found.covariance)
    assert 0.99 < ratio.min() < ratio.max() < 2.0


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_no_tip_is_more_certain_in_any_direction_as_more_errors_come_back(arm, chain, rho):
    """Also beside blocks that scatter more in some directions; 1e-6 is rounding, of conditions of 1e9."""
    state, points, truth = readings(arm, chain, 3000, rho=rho, seed=3)
    found, sums = estimated(chain, state, points)
    one, _ = ReadingSums.of(chain, state.rows(np.arange(40)), points.select(np.arange(40)), found.x, NOISE**2, np.inf)
    for repeated in (sums.gram, one.gram):
        tips, factor = None, 0.0
        for times in (0.0, 0.1, 1.0, 10.0, 1e3, 1e5):
            before, least = tips, factor
            every = np.arange(len(truth))
            covariance, effect = sums.correlated(found, prior_std(chain), every, times * repeated)
            tips, factor = of_the_tips(chain, state.rows(np.arange(0, 3000, 15)), covariance, found.x), effect.factor
            assert factor >= least
            assert before is None or np.linalg.eigvals(np.linalg.solve(before, tips)).real.min() > 1 - 1e-6
        assert effect.is_by_poses


def test_readings_of_equal_poses_are_worth_less_by_how_many_there_are_of_one(arm, chain):
    state, points, truth = readings(arm, chain, 24 * BLOCK, rho=0.0, seed=3)
    found, sums = estimated(chain, state, points)
    covariance, effect = sums.correlated(found, prior_std(chain), np.arange(len(truth)), 49 * sums.gram)
    assert effect.factor == pytest.approx(50, rel=1e-6)
    independent = found.covariance
    expected = independent @ (50 * sums.gram + np.diag(prior_std(chain) ** -2.0)) @ independent
    # What blocks show beside it adds up to that of the independent ones (see above).
    assert np.trace(sums.gram @ covariance) == pytest.approx(np.trace(sums.gram @ expected), rel=0.05)
