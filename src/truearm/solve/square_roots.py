"""Square roots of covariances whose parameters have different units, scaled to a unit diagonal first."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cholesky

from truearm.typing import FloatArray

# For a matrix of unit diagonal: eigenvalues below this share of the largest are rounding, and smaller squared pivots of
# the Cholesky factor have lost their digits.
ROUNDING = 1e-14
MIN_PIVOT = 1e-12


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
    if not len(covariance):
        return covariance
    matrix, scale = unit_diagonal(covariance)
    try:
        factor = cholesky(matrix, lower=False, check_finite=False)
    except LinAlgError:  # singular to rounding
        values, vectors = np.linalg.eigh(matrix)
        factor = (vectors * np.sqrt(np.maximum(values, 0))).T
    factor *= scale
    return np.asarray(factor)
