"""Linear algebra on arrays of NumPy, or of PyTorch where the samples are PyTorch arrays, for example on a GPU.

Parameters and steps are NumPy vectors, which are small; samples, and the matrices summed over them, stay on the device
of the samples. Nearly all arithmetic uses the Python array API, which both support; the functions here add what it
lacks: sums in place and solutions with a Cholesky factor. Square roots of covariances, in NumPy alone, are of matrices
that are scaled to a unit diagonal first, as their parameters have different units.

Source: Python array API standard 2024.12, https://data-apis.org/array-api/2024.12.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from array_api_compat import array_namespace, device, is_torch_array
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky, cython_blas, solve_triangular

from truearm.typing import FloatArray

# For a matrix of unit diagonal: eigenvalues below this share of the largest are rounding, and smaller squared pivots of
# the Cholesky factor have lost their digits.
ROUNDING = 1e-14
MIN_PIVOT = 1e-12
# An array of doubles of either library; static types know NumPy's only.
Array = Any

# The allocator of glibc gives memory that is freed back to the system at once, unless a block of that size was freed
# before (mallopt(3), M_MMAP_THRESHOLD; the largest that counts has 32 MiB): pages taken anew are a twentieth of a
# physical fit. Of this block nothing is written.
np.empty(31 * 2**20, dtype=np.uint8)


def unit_diagonal(matrix: FloatArray, size: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Scale rows and columns of a symmetric matrix so that radians and millimetres compare.

    Source: A. van der Sluis, "Condition numbers and equilibration of matrices", Numer. Math. 14 (1969) 14: no diagonal
    scaling has a much lower condition number.

    Parameters
    ----------
    matrix : (p, p) array
    size : (p,) array
        The diagonal to scale by; that of the matrix by default. Rows where it is not positive are not scaled.

    Returns
    -------
    scaled : (p, p) array
        ``D^-1 A D^-1``, a copy.
    scale : (p,) array
        The diagonal of D: the square roots of `size`.
    """
    size = matrix.diagonal() if size is None else size
    scale = np.sqrt(np.where(size > 0, size, 1.0))
    scaled = matrix / scale
    scaled /= scale[:, None]
    return scaled, scale


def covariance_factor(covariance: FloatArray) -> FloatArray:
    """F with ``F^T F`` the covariance (p, p), which may be singular."""
    try:
        # The lower triangle of the transpose is the upper one in the order of rows, which is read most.
        return cholesky(np.array(covariance, order="C").T, lower=True, overwrite_a=True, check_finite=False).T
    except LinAlgError:  # singular to rounding
        matrix, scale = unit_diagonal(covariance)
        values, vectors = np.linalg.eigh(matrix)
        return np.asarray((vectors * np.sqrt(np.maximum(values, 0))).T * scale)


def inverse_root(matrix: FloatArray, least: float, size: FloatArray | None = None) -> FloatArray:
    """R (p, r) with ``R R^T`` the pseudoinverse of a matrix (p, p).

    Scaled by `unit_diagonal`, eigenvalues below a share `least` of the largest, or of `size`, are omitted.
    """
    scaled, scale = unit_diagonal(matrix, size)
    values, vectors = np.linalg.eigh(scaled)
    counts = values > least * values.max(initial=1.0)
    return np.asarray(vectors[:, counts] / np.sqrt(values[counts]) / scale[:, None])


def as_array_like(values: npt.ArrayLike, like: Array) -> Array:
    """`values` as doubles of the library, and on the device, of `like`; no copy where they are there already."""
    xp = array_namespace(like)
    return xp.asarray(values, dtype=xp.float64, device=device(like))


def to_numpy(values: Array) -> FloatArray:
    """`values` as a NumPy array in main memory."""
    return np.asarray(values.detach().cpu().numpy() if is_torch_array(values) else values)


def add_to_diagonal(matrix: Array, value: float) -> None:
    """Add a number to the diagonal of `matrix` (p, p), in place."""
    if is_torch_array(matrix):
        matrix.diagonal().add_(value)
    else:
        matrix.flat[:: matrix.shape[0] + 1] += value


def add_product(total: Array, left: Array, right: Array) -> None:
    """Add ``left @ right^T`` to `total`, in place and without a second array of its size.

    Parameters
    ----------
    total : (k, l) array
    left, right : (k, m) and (l, m) array
    """
    if is_torch_array(total):
        total.addmm_(left, right.T)
    elif _DGEMM is not None and all(map(_in_rows, (total, left, right))) and total.flags.writeable:
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
    else:
        total += left @ right.T


def _in_rows(array: Array) -> bool:
    """Whether the elements of each row of a matrix are contiguous doubles."""
    rows_apart = array.strides[0] >= 8 * array.shape[1] and array.strides[0] % 8 == 0
    return bool(array.dtype == np.float64 and array.strides[1] == 8 and rows_apart)


def _dgemm() -> Callable[..., None] | None:
    """SciPy's ``dgemm`` by its address, or None if its integers are not C's.

    NumPy cannot add a product to a matrix in place, and SciPy's wrapper does not release the interpreter lock, so that
    other threads wait.
    """
    capsule = cython_blas.__pyx_capi__["dgemm"]
    name_of = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", ctypes.pythonapi))
    address_of = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", ctypes.pythonapi)
    )
    name = name_of(capsule)
    kinds = name.decode().removeprefix("void (").removesuffix(")").split(", ")
    kinds = ["double *" if kind.endswith("_d *") else kind for kind in kinds]
    text, whole, real = "char *", "int *", "double *"
    if kinds != [text, text, whole, whole, whole, real, real, whole, real, whole, real, real, whole]:
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


def cholesky_solver(matrix: Array) -> Callable[[Array], Array] | None:
    """``matrix^-1`` as a function of the right side, (p,) or (p, k); None where `matrix` is not positive definite.

    Parameters
    ----------
    matrix : (p, p) array
        Symmetric; spoilt where the library can do without a copy.
    """
    lower = _cholesky(matrix)
    if lower is None:
        return None

    def solved(right: Array) -> Array:
        if is_torch_array(lower):
            column = right if right.ndim == 2 else right[:, None]
            return column.cholesky_solve(lower).reshape(right.shape)
        return cho_solve((lower, True), right, check_finite=False)

    return solved


def cholesky_solve(matrix: Array, right: Array) -> Array | None:
    """Solution of ``matrix x = right``, or None where `matrix` is not positive definite; see `cholesky_solver`."""
    solver = cholesky_solver(matrix)
    return None if solver is None else solver(right)


def whiten(matrix: Array, right: Array) -> Array | None:
    """``L^-1 right`` with ``matrix = L L^T``, or None where `matrix` is not positive definite.

    Parameters
    ----------
    matrix : (p, p) array
        Symmetric; spoilt where the library can do without a copy.
    right : (p, k) array
    """
    lower = _cholesky(matrix)
    if lower is None:
        return None
    if is_torch_array(lower):
        import torch

        return torch.linalg.solve_triangular(lower, right, upper=False)
    return solve_triangular(lower, right, lower=True, check_finite=False)


def _cholesky(matrix: Array) -> Array | None:
    """Lower factor (in its lower triangle; the other one is not used), or None."""
    if is_torch_array(matrix):
        import torch

        lower, failed = torch.linalg.cholesky_ex(matrix)
        return None if bool(failed) else lower
    try:
        # Transposed, its rows are the columns that LAPACK wants: the factor takes the matrix's own place.
        return cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)[0]
    except (LinAlgError, ValueError, ArithmeticError):
        return None
