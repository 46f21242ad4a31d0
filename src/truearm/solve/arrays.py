"""Arrays of any library of the Python array API: NumPy by default, PyTorch or CuPy where the samples lie there.

Parameters and steps travel as NumPy vectors, which are small; samples, and the matrices summed over them, stay where
the samples are. What the standard lacks, solving with a Cholesky factor, is here once.

Source: Python array API standard 2024.12, https://data-apis.org/array-api/2024.12.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from array_api_compat import array_namespace, device, is_cupy_array, is_numpy_array, is_torch_array
from scipy.linalg import LinAlgError, cho_factor, cho_solve

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


def cholesky_solved(matrix: Array, right: Array) -> Array | None:
    """Solution of ``matrix x = right``, or None where `matrix` is not positive definite.

    Parameters
    ----------
    matrix : (p, p) array
        Symmetric; spoilt where the library can do without a copy.
    right : (p,) or (p, k) array
    """
    if is_numpy_array(matrix):
        try:
            # The transpose is laid out as LAPACK likes it: the upper triangle of one is the lower one of the other.
            factor = cho_factor(matrix.T, lower=False, overwrite_a=True, check_finite=False)
        except LinAlgError:
            return None
        return cho_solve(factor, right, check_finite=False)
    xp = array_namespace(matrix)
    column = right if right.ndim == 2 else right[:, None]
    if is_torch_array(matrix):
        import torch

        lower, failed = torch.linalg.cholesky_ex(matrix)
        if bool(failed):
            return None
        solution = torch.cholesky_solve(column, lower)
    else:
        # The standard has no triangular solve: a general one costs twice the factorisation again.
        try:
            lower = xp.linalg.cholesky(matrix)
        except (LinAlgError, ValueError, ArithmeticError):
            return None
        solution = xp.linalg.solve(xp.matrix_transpose(lower), xp.linalg.solve(lower, column))
    return solution if right.ndim == 2 else solution[:, 0]
