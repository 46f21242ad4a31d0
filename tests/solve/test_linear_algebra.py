"""What the array API lacks, on NumPy and, where it is installed, on PyTorch.

Square roots of covariances: of whole rank, and singular.
"""

import ctypes

import numpy as np
import pytest
from scipy.linalg import cython_blas

from truearm.solve import linear_algebra
from truearm.solve.linear_algebra import (
    add_product,
    add_to_diagonal,
    cholesky_solve,
    covariance_factor,
    inverse_root,
    to_numpy,
    whiten,
)


@pytest.fixture(params=["numpy", "torch"])
def made(request):
    """Makes a copy, in rows, of a NumPy array in the library tried."""
    if request.param == "numpy":
        return np.array
    return pytest.importorskip("torch", reason="PyTorch is an extra: pip install 'truearm[torch]'").tensor


def test_products_are_added_in_place(made, rng):
    total, left, right = rng.normal(size=(5, 7)), rng.normal(size=(5, 11)), rng.normal(size=(7, 11))
    sums = made(total)
    add_product(sums, made(left), made(right))
    np.testing.assert_allclose(to_numpy(sums), total + left @ right.T, atol=1e-13)


def test_every_layout_in_memory_adds_up_alike(rng):
    """Rows apart, columns side by side, every other element: by the BLAS or without it."""
    total, left, right = rng.normal(size=(5, 7)), rng.normal(size=(5, 11)), rng.normal(size=(7, 11))
    for laid in (
        np.asfortranarray,
        lambda a: np.repeat(a, 2, axis=1)[:, ::2],
        lambda a: np.tile(a, 2)[:, : a.shape[1]],
    ):
        sums = laid(total)
        add_product(sums, laid(left), laid(right))
        np.testing.assert_allclose(sums, total + left @ right.T, atol=1e-13)


def test_read_only_arrays_are_not_overwritten(rng):
    total = np.zeros((2, 2))
    total.flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        add_product(total, rng.normal(size=(2, 3)), rng.normal(size=(2, 3)))
    assert not total.any()


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_number_is_added_to_the_diagonal(made, order, rng):
    matrix = rng.normal(size=(5, 5))
    shifted = made(matrix) if order == "C" else made(np.ascontiguousarray(matrix.T)).T
    add_to_diagonal(shifted, 2.0)
    np.testing.assert_array_equal(to_numpy(shifted), matrix + 2 * np.eye(5))


def test_a_cholesky_factor_solves(made, rng):
    root, right = rng.normal(size=(6, 6)), rng.normal(size=(6, 2))
    matrix = root @ root.T + np.eye(6)
    for column in (right, right[:, 0]):
        solution = to_numpy(cholesky_solve(made(matrix), made(column)))
        np.testing.assert_allclose(matrix @ solution, column, atol=1e-12)
    half = to_numpy(whiten(made(matrix), made(right)))
    np.testing.assert_allclose(half.T @ half, right.T @ np.linalg.solve(matrix, right), atol=1e-12)
    assert cholesky_solve(made(-matrix), made(right)) is None
    assert whiten(made(-matrix), made(right)) is None


@pytest.mark.parametrize("other", [b"long int *", b"npy_int64 *"])
def test_a_blas_with_other_integers_is_not_called(other, monkeypatch):
    """Calling it with C's would read and write beyond them."""
    named = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", ctypes.pythonapi))
    made = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)(
        ("PyCapsule_New", ctypes.pythonapi)
    )
    name = named(cython_blas.__pyx_capi__["dgemm"]).replace(b"int *", other)  # a capsule does not keep its own copy
    monkeypatch.setitem(cython_blas.__pyx_capi__, "dgemm", made(1, name, None))
    assert linear_algebra._dgemm() is None


@pytest.mark.parametrize("rank", [0, 1, 2, 4])
def test_the_square_of_a_factor_is_the_covariance(rng, rank):
    """In units that differ by 10^6; to the rounding of doubles, and its root where the matrix is singular."""
    units = np.array([1e-3, 1.0, 1e3, 1.0])
    half = rng.normal(size=(rank, 4)) * units
    found = covariance_factor(half.T @ half)
    np.testing.assert_allclose(
        found.T @ found / units / units[:, None], half.T @ half / units / units[:, None], atol=1e-7
    )


def test_the_root_of_a_pseudoinverse_inverts_what_is_determined(rng):
    """Of columns of any unit, one the sum of two others and one zero."""
    columns = rng.normal(size=(40, 5)) * [1.0, 1e6, 1e-6, 1.0, 0.0]
    columns[:, 3] = columns[:, 0] + 1e-6 * columns[:, 1]
    target = rng.normal(size=40)
    root = inverse_root(columns.T @ columns, 1e-9)
    fitted = columns @ (root @ (root.T @ (columns.T @ target)))
    plain = columns[:, :3] * [1.0, 1e-6, 1e6]
    assert root.shape == (5, 3)
    np.testing.assert_allclose(fitted, plain @ np.linalg.lstsq(plain, target, rcond=None)[0], rtol=1e-9)
