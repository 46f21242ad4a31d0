"""Laws of sums of products of cosines and sines: transforms equal the products of matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.solve import trigonometric_sums
from truearm.solve.trigonometric_sums import Multiples, bilinear_form, is_cheaper, weighted_products

orders = st.sets(st.integers(1, 90), min_size=1, max_size=40).map(lambda found: np.array(sorted(found)))
# Of the size of the result: that of a transform and the rounding of wrapped angles.
TOLERANCE = 1e-12


def functions(of: Multiples) -> np.ndarray:
    """(2K, m) cosines and sines, in plain form."""
    turns = of.orders[:, None] * of.angles
    return np.stack([np.cos(turns), np.sin(turns)], axis=1).reshape(-1, len(of.angles))


@given(orders, orders, st.integers(1, 300), st.integers(0, 2**32), st.booleans())
@settings(deadline=None, max_examples=30)
def test_transforms_equal_products_of_matrices_and_are_adjoint(one, other, m, seed, is_same):
    rng = np.random.default_rng(seed)
    rng.shuffle(one)
    first = Multiples(rng.uniform(-9, 9, m), one)
    second = None if is_same else Multiples(rng.uniform(-1, 0.3, m), other)
    phi = functions(first)
    psi = phi if second is None else functions(second)
    weights, matrix = rng.normal(size=m), rng.normal(size=(len(phi), len(psi)))
    sums, values = weighted_products(weights, first, second), bilinear_form(matrix, first, second)
    plain = (weights * phi) @ psi.T
    np.testing.assert_allclose(sums, plain, rtol=0, atol=TOLERANCE * np.linalg.norm(weights) * np.sqrt(m))
    assert second is not None or (sums == sums.T).all()  # to the last bit, on which the normal equations rely
    of_matrix = (phi * (matrix @ psi)).sum(axis=0)
    np.testing.assert_allclose(values, of_matrix, rtol=0, atol=TOLERANCE * np.abs(matrix).sum())
    assert np.vdot(matrix, sums) == pytest.approx(
        weights @ values, abs=1e-12 * np.abs(matrix).sum() * np.abs(weights).sum()
    )


def test_the_same_values_give_the_same_bits():
    rng = np.random.default_rng(0)
    one, other = (Multiples(rng.uniform(-3, 3, 500), np.arange(3, 60)) for _ in range(2))
    weights = rng.normal(size=500)
    found = [weighted_products(np.array(weights), one, other) for _ in range(3)]
    assert (found[0] == found[1]).all()
    assert (found[0] == found[2]).all()


def test_few_values_and_few_orders_are_products_of_matrices():
    many, few = np.arange(1, 111), np.arange(1, 13)
    assert not is_cheaper(300, many, many)
    assert is_cheaper(12_000, many, many)
    assert is_cheaper(12_000, many)
    assert not is_cheaper(12_000, few, few)
    # A gap in the orders costs a grid, and saves no product.
    assert not is_cheaper(12_000, np.array([1, 1000]), np.array([2, 999]))


def test_without_finufft_all_sums_are_products_of_matrices(monkeypatch: pytest.MonkeyPatch):
    """As on Linux on ARM, for which it has no wheels; fits are the same (`test_transformed_fit`)."""
    monkeypatch.setattr(trigonometric_sums, "has_transforms", lambda: False)
    assert not is_cheaper(12_000, np.arange(1, 111), np.arange(1, 111))
