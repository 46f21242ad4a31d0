"""Blocks eliminated one by one: the same numbers as by the whole matrix."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from truearm.solve.arrowhead import Arrowhead
from truearm.solve.group_evidence import GroupedPrior, posterior

P = 5  # in the head


def from_jacobian(J, r, p=P):
    gram = J.T @ J
    return Arrowhead(0.5 * float(r @ r), J.T @ r, gram[:p, :p], gram[p:, :p], csr_array(gram[p:, p:]))


def drawn(rng, sizes, n_shared=0, per_block=6):
    """Two parts with unknowns in blocks of `sizes` each, and relations: each shared unknown with one of every block."""
    parts, jacobians = [], []
    for _ in range(2):
        u = sum(sizes)
        rows = []
        for size, start in zip(sizes, np.cumsum([0, *sizes]), strict=False):
            block = np.zeros((size + per_block, P + u))
            block[:, :P] = rng.normal(size=(len(block), P)) * [1, 1e3, 1, 1e-2, 10]
            block[:, P + start : P + start + size] = rng.normal(size=(len(block), size)) * 10 ** rng.uniform(-2, 2)
            rows.append(block)
        J = np.concatenate(rows)
        jacobians.append((J, rng.normal(size=len(J))))
    u = 2 * sum(sizes)
    starts = np.cumsum([0, *sizes, *sizes])[:-1]
    relations = np.zeros((len(starts) * n_shared + n_shared, u + n_shared))
    for k in range(n_shared):
        for i, start in enumerate(starts):
            relations[k * len(starts) + i, [start, u + k]] = rng.normal(size=2)
        relations[len(starts) * n_shared + k, u + k] = 3.0
    parts = [from_jacobian(J, r) for J, r in jacobians]
    if n_shared:
        nothing = np.zeros((0, P + n_shared))
        parts.append(from_jacobian(nothing, np.zeros(0)))
    joined = Arrowhead.combine(parts)
    r = rng.normal(size=len(relations))
    whole = Arrowhead(
        joined.cost + 0.5 * float(r @ r),
        joined.gradient + np.concatenate([np.zeros(P), relations.T @ r]),
        joined.head,
        joined.coupling,
        csr_array(joined.blocks + csr_array(relations.T @ relations)),
    )
    shared = np.arange(u + n_shared) >= u
    return parts, whole, shared


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(1, 4), min_size=1, max_size=6),
    st.integers(0, 2),
    st.sampled_from([1e-12, 1e-3, 1.0]),
)
def test_all_numbers_are_those_of_the_whole_matrix(seed, sizes, n_shared, precision):
    """Means, variances and the step of all parameters, of unit size by the matrix's own diagonal, to 1e-9."""
    rng = np.random.default_rng(seed)
    parts, whole, shared = drawn(rng, sizes, n_shared)
    u = len(shared)
    x = rng.normal(size=P + u)
    gram, n = whole.dense(), P + u
    prior = GroupedPrior(
        np.concatenate([10 ** rng.uniform(-2, 2, P), np.full(u, precision**-0.5)]),
        np.concatenate([np.arange(P) % 2, np.full(u, 2)]),
        np.array([1.0, 0.3, 1.0]),
        np.array([True, True, False]),
    )
    left = whole.eliminate(np.full(u, precision), x, shared=shared)
    assert sorted([*left.kept, *left.eliminated]) == list(range(n))
    right = left.gram @ x[left.kept] - left.gradient
    dense = posterior(gram, gram @ x - whole.gradient, prior)
    found = posterior(left.gram, right, prior.subset(left.kept), size=left.size)
    std = np.sqrt(dense.covariance.diagonal())
    kept = left.kept
    np.testing.assert_allclose(
        found.covariance / np.outer(std[kept], std[kept]),
        dense.covariance[np.ix_(kept, kept)] / np.outer(std[kept], std[kept]),
        atol=1e-9,
    )
    size = np.linalg.norm(dense.x / std)
    np.testing.assert_allclose((x + left.step(found.x - x[kept]) - dense.x) / std, 0, atol=1e-9 * size)
    alone = posterior(left.gram, right, prior.subset(kept), size=left.size)
    np.testing.assert_allclose(alone.variance, dense.covariance.diagonal()[kept], rtol=1e-9)
    # What every part determines, in all parameters: its matrix stands at its own unknowns.
    start, expected = P, []
    for part in parts:
        own = np.concatenate([np.arange(P), np.arange(start, start + part.blocks.shape[0])])
        expected.append(float(np.vdot(part.dense(), dense.covariance[np.ix_(own, own)])))
        start += part.blocks.shape[0]
    np.testing.assert_allclose(left.traces(parts, found.covariance), expected, rtol=1e-9, atol=1e-9)
    # The fall of the cost, those kept staying.
    gone = left.eliminated
    D, g = gram[np.ix_(gone, gone)] + precision * np.eye(len(gone)), whole.gradient[gone] + precision * x[gone]
    assert left.gain == pytest.approx(g @ np.linalg.solve(D, g), rel=1e-8)
    assert left.n_determined == pytest.approx(len(gone) - precision * np.trace(np.linalg.inv(D)), rel=1e-8)
    np.testing.assert_allclose(whole.times(x), gram @ x, rtol=1e-9, atol=1e-9 * np.abs(gram @ x).max())
    np.testing.assert_array_equal(whole.diagonal, gram.diagonal())


def test_without_unknowns_the_head_is_unchanged(rng):
    J, r = rng.normal(size=(9, P)), rng.normal(size=9)
    whole = from_jacobian(J, r)
    left = whole.eliminate(np.zeros(0), np.zeros(P), shared=np.zeros(0, dtype=bool))
    np.testing.assert_array_equal(left.gram, whole.head)
    np.testing.assert_array_equal(left.gradient, whole.gradient)
    assert (left.n_determined, left.gain) == (0, 0)
    np.testing.assert_array_equal(left.step(np.arange(5.0)), np.arange(5.0))
    np.testing.assert_allclose(left.traces([whole], np.eye(P)), np.trace(whole.head))


def test_a_direction_that_no_data_determine_stays_out(rng):
    """Two unknowns of which only the sum shows, exactly: the head is as if they were one; the step moves the sum."""
    J = rng.normal(size=(12, P + 1))
    r = rng.normal(size=12)
    one = from_jacobian(J, r).eliminate(np.zeros(1), np.zeros(P + 1), shared=np.zeros(1, dtype=bool))
    twice = from_jacobian(np.hstack([J, J[:, -1:]]), r)
    two = twice.eliminate(np.full(2, 1e-18), np.zeros(P + 2), shared=np.zeros(2, dtype=bool))
    np.testing.assert_allclose(two.gram, one.gram, rtol=1e-9)
    np.testing.assert_allclose(two.gradient, one.gradient, rtol=1e-9)
    np.testing.assert_allclose(two.step(np.ones(P))[P:].sum(), one.step(np.ones(P))[P], rtol=1e-9)
    assert two.n_determined == pytest.approx(1, abs=1e-9)


def test_a_block_that_absorbs_the_head_leaves_its_prior(rng):
    """The head moves all of a block's data as one of its unknowns does: nothing is told of it, not even by rounding."""
    J = np.zeros((40, P + 3))
    J[:, :P] = rng.normal(size=(40, P))
    J[:, P:] = rng.normal(size=(40, 3))
    J[:, 0] = 1e5 * J[:, P]
    r = rng.normal(size=40)
    whole = from_jacobian(J, r)
    left = whole.eliminate(np.full(3, 1e-12), np.zeros(P + 3), shared=np.zeros(3, dtype=bool))
    prior = GroupedPrior(np.ones(P), np.zeros(P, np.intp), np.ones(1), np.array([True]))
    found = posterior(left.gram, -left.gradient, prior, size=left.size)
    # Beside 40 x 1e10 the prior's 1 is 1e-12, of which rounding leaves four digits.
    assert found.covariance[0, 0] == pytest.approx(1, rel=1e-2)
