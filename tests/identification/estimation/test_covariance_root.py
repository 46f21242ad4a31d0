"""Laws of the root of a covariance: ``F^T F`` is the covariance, and site by site ``F J^T`` is the product."""

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.estimation import covariance_root
from truearm.identification.estimation.covariance_root import SAME, CovarianceRoot
from truearm.identification.estimation.perturbed_chain import FEW, MOST_NARROW, PerturbedChain
from truearm.identification.terms import ArmState, Constant, Harmonics, Term, candidate_terms
from truearm.typing import FloatArray

N = FEW + 5
CHAIN = load_arm("ur10").chain
STATE = ArmState(
    CHAIN,
    np.random.default_rng(1).uniform(-3, 3, (N, CHAIN.n_joints)),
    directions=np.random.default_rng(2).choice([-1.0, 1.0], (N, CHAIN.n_joints)),
)


def perturbed_chain_of(which: str) -> PerturbedChain:
    """An arm of sites with few functions, with many, and with both."""
    if which == "none":
        return PerturbedChain(CHAIN, ())
    if which == "every kind":
        return PerturbedChain(CHAIN, tuple(candidate_terms(STATE, highest=9)[0]))
    terms = []
    for place in range(1, 4):
        if which != "narrow":
            orders = range(1, MOST_NARROW + place)
            terms += [Term("w", place, (0, 0, 0, 0, 0, 1), Harmonics(place, tuple(orders)), "harmonics", 1e-4)]
        if which != "wide":
            terms += [Term("n", place, (1, 0, 0, 0, 0, 0), Constant(), "constants", 1e-2)]
    return PerturbedChain(CHAIN, tuple(terms))


def covariance_of(n: int, kind: str) -> FloatArray:
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((n // 2 if kind == "singular" else n + 3, n)) * rng.uniform(1e-4, 1, n)
    if kind == "partly known":
        rows[:, ::3] = 0
    if kind == "known":
        rows[:] = 0
    return rows.T @ rows


@pytest.mark.parametrize("kind", ["regular", "singular", "partly known", "known"])
@pytest.mark.parametrize("which", ["none", "narrow", "wide", "both", "every kind"])
def test_site_by_site_is_the_product_with_the_derivatives(which, kind):
    perturbed_chain = perturbed_chain_of(which)
    p = perturbed_chain.n_coefficients
    covariance = covariance_of(p, kind)
    root = CovarianceRoot.of(covariance, perturbed_chain)
    assert root.n_rows == np.count_nonzero(covariance.diagonal())
    x = np.zeros(p)

    F = root.times_matrix(np.eye(p))
    # Eigenvalues below rounding count as zero, and enter as their square root.
    scale = np.sqrt(np.maximum(np.outer(covariance.diagonal(), covariance.diagonal()), 1e-300))
    np.testing.assert_allclose(F.T @ F / scale, covariance / scale, rtol=0, atol=1e-11)

    for state in (STATE, STATE.rows(slice(0, 1))):
        ((_, _, columns),) = perturbed_chain.derivatives(state, x)
        ((_, _, along_sites, values),) = perturbed_chain.site_derivatives(state, x)
        expected = np.einsum("rp,pkm->krm", F, columns)
        size = max(1.0, float(np.abs(expected).max(initial=0)))
        found = root.times(along_sites, values).swapaxes(0, 1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * size)


@pytest.mark.parametrize("which", ["narrow", "wide", "both", "every kind"])
def test_in_single_precision_displacements_round_as_what_each_coefficient_moves_alone(which):
    perturbed_chain = perturbed_chain_of(which)
    root = CovarianceRoot.of(covariance_of(perturbed_chain.n_coefficients, "regular"), perturbed_chain)
    x = np.zeros(perturbed_chain.n_coefficients)
    ((_, _, columns),) = perturbed_chain.derivatives(STATE, x)
    ((_, _, *factors),) = perturbed_chain.site_derivatives(STATE, x)
    alone = root.alone(*factors)
    variance = np.zeros(len(x))
    variance[root.order] = root.covariance.diagonal()
    expected = np.einsum("p,pkm->m", variance, columns**2)
    # Of many harmonics as if the squares of a cosine and a sine of an angle summed to two.
    assert ((alone >= (1 - 1e-9) * expected) & (alone <= (3 if root.wide else 1 + 1e-9) * expected)).all()
    found = root.times(*(of.astype(np.float32) for of in factors))
    assert found.dtype == np.float32
    off = np.linalg.norm(found - root.times(*factors), axis=(0, 1))
    assert (off <= 6e-7 * np.sqrt(alone)).all()  # ten of the last of 24 bits


def test_the_root_of_a_regular_covariance_is_a_triangle():
    """Sites with many functions pass through a triangle, of which every part has the rows that are not zero."""
    perturbed_chain = perturbed_chain_of("wide")
    p = perturbed_chain.n_coefficients
    root = CovarianceRoot.of(covariance_of(p, "regular"), perturbed_chain)
    assert root.is_triangle
    assert [part.stop - part.start for part in root.wide] == [2 * (MOST_NARROW + place - 1) for place in range(1, 4)]
    assert [len(columns) for columns in root._columns[1:]] == [part.stop for part in root.wide]
    singular = CovarianceRoot.of(covariance_of(p, "singular"), perturbed_chain)
    assert not singular.is_triangle
    assert {len(columns) for columns in singular._columns[1:]} == {p}


def test_data_are_taken_back_as_in_dense_algebra(rng):
    """Shares from 1 to 1e-6 of the variance remain; those below a bound count as the bound in the coefficients."""
    perturbed_chain, least = perturbed_chain_of("both"), 1e-3
    p = perturbed_chain.n_coefficients
    unit = rng.uniform(1e-4, 1, p)
    turned = np.linalg.qr(rng.normal(size=(p, p)))[0]
    shares = np.concatenate([[1e-6, 2e-5, 1e-4, 0.9e-3, 1.1e-3], np.geomspace(5e-3, 1, p - 5)])
    # Information 1 with the data and `shares` without them, along orthogonal directions.
    covariance = np.outer(unit, unit) * (turned @ np.diag(np.geomspace(1, 1e3, p)) @ turned.T)
    half = np.linalg.cholesky(np.linalg.inv(covariance / np.outer(unit, unit))) / unit[:, None]
    gram = half @ (turned * (1 - shares)) @ turned.T @ half.T
    gradient = half @ rng.normal(size=p)
    whole = CovarianceRoot.of(covariance, perturbed_chain)
    factor = whole.factor.copy()
    without = whole.without(gram[np.ix_(whole.order, whole.order)])
    assert np.array_equal(whole.factor, factor)  # LAPACK may work in memory that is given
    assert without is not None
    half = np.linalg.inv(half).T

    def expected(of_shares):
        return half @ (turned / of_shares) @ turned.T @ half.T

    size = np.sqrt(np.outer(expected(shares).diagonal(), expected(shares).diagonal()))
    spread = without.spread(np.eye(p))
    found = spread.T @ spread
    np.testing.assert_allclose(found / size, expected(shares) / size, rtol=0, atol=1e-6)
    moved = expected(np.maximum(shares, least)) @ gradient
    scale = np.sqrt(expected(np.maximum(shares, least)).diagonal())
    found, moved = without.shift(gradient[whole.order], least) / scale, moved / scale
    np.testing.assert_allclose(found, moved, rtol=0, atol=1e-3 * np.abs(moved).max())  # as the iteration leaves


@pytest.mark.parametrize("hardly_known", [1e2, 1e4])
def test_single_precision_does_not_hide_what_is_known_well(hardly_known, rng):
    """Of displacements that are hardly known along one direction, and as well as a residual across it."""
    perturbed_chain = perturbed_chain_of("narrow")
    p = perturbed_chain.n_coefficients
    turned = np.linalg.qr(rng.normal(size=(p, p)))[0]
    information = (turned * np.array([hardly_known**-2, *np.ones(p - 1)])) @ turned.T
    whole = CovarianceRoot.of(np.linalg.inv(information + 1e3 * np.eye(p)), perturbed_chain)
    without = whole.without((1e3 * np.eye(p))[np.ix_(whole.order, whole.order)])
    assert without is not None
    across, along = rng.normal(size=(p, 3, 20)) / np.sqrt(p), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    known = np.tensordot(turned[:, 0], across, 1)
    columns = across - turned[:, 0, None, None] * (known - along[:, :1] * (along[:, 0] @ known))
    spread = without.spread(columns)
    expected = np.einsum("pkm,plm->mkl", spread, spread)
    unit = np.linalg.inv(np.linalg.cholesky(np.eye(3) + expected))
    off = unit @ (without.covariances(columns) - expected) @ unit.transpose(0, 2, 1)
    np.testing.assert_allclose(off, 0.0, atol=3 * SAME)  # of all, some of which were compared


def test_data_of_all_information_cannot_be_taken_back():
    perturbed_chain = perturbed_chain_of("narrow")
    p = perturbed_chain.n_coefficients
    covariance = covariance_of(p, "regular")
    assert CovarianceRoot.of(covariance, perturbed_chain).without(1.1 * np.linalg.inv(covariance)) is None
    assert CovarianceRoot.of(covariance_of(p, "singular"), perturbed_chain).without(np.zeros((p, p))) is None


@pytest.mark.parametrize("kind", ["regular", "singular", "partly known", "known"])
@pytest.mark.parametrize("which", ["narrow", "wide", "both", "every kind"])
@pytest.mark.parametrize("transformed", [True, False])
def test_covariances_are_those_of_the_derivatives(which, kind, transformed, monkeypatch):
    """By transforms, by products, and site by site."""
    monkeypatch.setattr(covariance_root, "is_cheaper", lambda *_: transformed)
    perturbed_chain = perturbed_chain_of(which)
    p = perturbed_chain.n_coefficients
    covariance = covariance_of(p, kind)
    root = CovarianceRoot.of(covariance, perturbed_chain)
    for state in (STATE, STATE.rows(slice(0, 1))):
        ((_, _, columns),) = perturbed_chain.derivatives(state, np.zeros(p))
        ((_, _, along_sites, values),) = perturbed_chain.site_derivatives(state, np.zeros(p))
        expected = np.einsum("pkm,pq,qlm->mkl", columns, covariance, columns, optimize=True)
        found = root.covariances(along_sites, values, state.joint_angles)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("transformed", [True, False])
def test_covariances_of_an_arm_known_to_rounding_are_sums_of_squares(transformed, monkeypatch):
    """Series that cancel: 1e-12 of the variance of each alone remains, with its digits; nothing of a weight of zero."""
    monkeypatch.setattr(covariance_root, "is_cheaper", lambda *_: transformed)
    harmonics = Harmonics(1, tuple(range(1, MOST_NARROW + 1)))
    chain = PerturbedChain(CHAIN, tuple(Term(name, 1, (0, 0, 0, 1, 0, 0), harmonics, name, 1.0) for name in "ab"))
    one = np.eye(harmonics.n_functions)
    root = CovarianceRoot.of(np.kron([[1.0, -1.0], [-1.0, 1.0]], one) + 1e-12 * np.kron(np.eye(2), one), chain)
    ((_, _, along_sites, values),) = chain.site_derivatives(STATE, np.zeros(chain.n_coefficients))
    along_sites[:, :, 0] = 0.0
    found = root.covariances(along_sites, values, STATE.joint_angles)
    np.testing.assert_allclose(np.trace(found, axis1=1, axis2=2)[1:], 2e-12 * MOST_NARROW, rtol=1e-3)
    assert not found[0].any()
    assert np.linalg.eigvalsh(found).min() >= -1e-20
