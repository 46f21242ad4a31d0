"""Arrays of any library of the Python array API: NumPy by default, PyTorch or CuPy where the samples lie there.

Parameters and steps travel as NumPy vectors, which are small; samples, and the matrices summed over them, stay where
the samples are. What the standard lacks, solving with a Cholesky factor, is here once.

Source: Python array API standard 2024.12, https://data-apis.org/array-api/2024.12.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from array_api_compat import array_namespace, device, is_cupy_array, is_numpy_array, is_torch_array
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cython_blas, solve_triangular

FloatArray = npt.NDArray[np.float64]
# An array of doubles of any such library; static types know NumPy's only.
Array = Any


def placed_like(values: npt.ArrayLike, like: Array) -> Array:
    """`values` as doubles of the library, and on the device, of `like`; no copy where they are there already."""
    xp = array_namespace(like)
    return xp.asarray(values, dtype=xp.float64, device=device(like))


def to_numpy(values: Array) -> FloatArray:
    """`values` as a NumPy array in main memory."""
    if is_numpy_array(values):
        return np.asarray(values)
    if is_torch_array(values):
        return np.asarray(values.detach().cpu().numpy())
    if is_cupy_array(values):
        return np.asarray(values.get())
    return np.asarray(values)


def add_to_diagonal(matrix: Array, value: float) -> None:
    """Add a number to the diagonal of `matrix` (p, p), in place."""
    # The diagonal of a matrix is every (p + 1)-th of its elements: one strided view in every library.
    flat = array_namespace(matrix).reshape(matrix, (-1,), copy=False)
    flat[:: matrix.shape[0] + 1] += value


def add_product(total: Array, left: Array, right: Array) -> None:
    """Add ``left @ right^T`` to `total`, in place and without a second array of its size.

    Parameters
    ----------
    total : (k, l) array
    left, right : (k, m) and (l, m) array
    """
    if is_numpy_array(total) and _DGEMM is not None and all(map(_in_rows, (total, left, right))):
        (k, m), rows = left.shape, right.shape[0]
        if total.shape != (k, rows) or right.shape[1] != m:
            raise ValueError(f"shapes do not fit: {total.shape} += {left.shape} @ {right.shape}^T")
        # The BLAS counts by columns, for which all three are transposed: total^T += right left^T.
        sizes = [ctypes.c_int(size) for size in (rows, k, m)]
        (R, ld_r), (L, ld_l), (S, ld_s) = (
            (array.ctypes.data, ctypes.c_int(max(array.strides[0] // 8, 1))) for array in (right, left, total)
        )
        one = ctypes.c_double(1.0)
        _DGEMM(b"T", b"N", *sizes, one, R, ld_r, L, ld_l, one, S, ld_s)
    elif is_torch_array(total):
        total.addmm_(left, right.T)
    else:
        total += left @ right.T


def _in_rows(array: Array) -> bool:
    """Whether the elements of a matrix's row stand side by side, as doubles."""
    rows_apart = array.strides[0] >= 8 * array.shape[1] and array.strides[0] % 8 == 0
    return bool(is_numpy_array(array) and array.dtype == np.float64 and array.strides[1] == 8 and rows_apart)


def _dgemm() -> Callable[..., None] | None:
    """SciPy's ``dgemm`` by its address, or None if its integers are not C's.

    Neither NumPy nor SciPy's own wrapper adds to a matrix while other threads go on: the one has no beta, the other
    holds the interpreter.
    """
    capsule = cython_blas.__pyx_capi__["dgemm"]
    name_of = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", ctypes.pythonapi))
    address_of = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", ctypes.pythonapi)
    )
    name = name_of(capsule)
    kinds = ["int" if "int *" in part else "char" if "char" in part else "d" for part in name.decode().split(",")]
    if kinds != ["char"] * 2 + ["int"] * 3 + ["d"] * 2 + ["int", "d", "int"] + ["d"] * 2 + ["int"]:
        return None
    char, integer, number, data = (
        ctypes.c_char_p,
        ctypes.POINTER(ctypes.c_int),
        ctypes.POINTER(ctypes.c_double),
        ctypes.c_void_p,
    )
    signature = (char, char, integer, integer, integer, number, data, integer, data, integer, number, data, integer)
    function: Callable[..., None] = ctypes.CFUNCTYPE(None, *signature)(address_of(capsule, name))
    return function


_DGEMM = _dgemm()


def cholesky_solved(matrix: Array, right: Array) -> Array | None:
    """Solution of ``matrix x = right``, or None where `matrix` is not positive definite.

    Parameters
    ----------
    matrix : (p, p) array
        Symmetric; spoilt where the library can do without a copy.
    right : (p,) or (p, k) array
    """
    lower = _cholesky(matrix)
    if lower is None:
        return None
    if is_numpy_array(lower):
        return cho_solve((lower, True), right, check_finite=False)
    column = right if right.ndim == 2 else right[:, None]
    solution = _triangular(lower.T, _triangular(lower, column), upper=True)
    return solution if right.ndim == 2 else solution[:, 0]


def whitened(matrix: Array, right: Array) -> Array | None:
    """``L^-1 right`` with ``matrix = L L^T``, or None where `matrix` is not positive definite.

    Parameters
    ----------
    matrix : (p, p) array
        Symmetric; spoilt where the library can do without a copy.
    right : (p, k) array
    """
    lower = _cholesky(matrix)
    return None if lower is None else _triangular(lower, right)


def _cholesky(matrix: Array) -> Array | None:
    """Lower factor (in its lower triangle; the other one is not used), or None."""
    if is_torch_array(matrix):
        import torch

        lower, failed = torch.linalg.cholesky_ex(matrix)
        return None if bool(failed) else lower
    try:
        if is_numpy_array(matrix):
            # Transposed, its rows are the columns that LAPACK wants: the factor takes the matrix's own place.
            return cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)[0]
        return array_namespace(matrix).linalg.cholesky(matrix)
    except (LinAlgError, ValueError, ArithmeticError):
        return None


def _triangular(factor: Array, right: Array, *, upper: bool = False) -> Array:
    """Solution (p, k) of ``factor x = right`` for a triangular factor."""
    if is_numpy_array(factor):
        return solve_triangular(factor, right, lower=not upper, check_finite=False)
    if is_torch_array(factor):
        import torch

        return torch.linalg.solve_triangular(factor, right, upper=upper)
    # The standard has no triangular solve; a general one costs a factorisation more.
    return array_namespace(factor).linalg.solve(factor, right)
