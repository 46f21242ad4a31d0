"""Information as factors: rows F with ``F^T F`` the information, stacked, and freed from nuisance parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr

from truearm.errors import InputError
from truearm.identification.references.alignment import rigid_motions
from truearm.typing import FloatArray


def moment_matrix(jacobians: FloatArray, tips: FloatArray | None = None, *, scale: bool = False) -> FloatArray:
    """Target of the I-criterion: the mean over poses of ``J_t^T J_t``, (p, p).

    With `tips`, the frame is first fitted to the points: these are the errors of an arm whose coordinates are compared
    with each other only, as those of a hand-guided arm. No seat and no bar determines its base position.

    Parameters
    ----------
    jacobians : (n, 3, p) array
        Derivatives of the tip by the parameters at poses of the later use of the arm [mm per unit].
    tips : (n, 3) array, optional
        The tip at these poses [mm].
    scale : bool
        Whether a scale is fitted with the frame: seats without a known length do not determine it.
    """
    rows = jacobians.reshape(-1, jacobians.shape[2])
    if tips is not None:
        rows = project_out(rows, rigid_motions(tips, scale=scale))
    return np.asarray(rows.T @ rows / len(jacobians))


def stack_factors(factors: Sequence[FloatArray]) -> FloatArray:
    """Stack candidates of different numbers of rows into one array (n, k, p), padded with zeros.

    Parameters
    ----------
    factors : sequence of (k_i, p) arrays
        One with more rows than parameters is replaced by its triangular factor, which has the same information.
    """
    reduced = [
        np.asarray(np.linalg.qr(factor, mode="r")) if factor.shape[0] > factor.shape[1] else factor
        for factor in factors
    ]
    out = np.zeros((len(reduced), max(1, *map(len, reduced)), reduced[0].shape[1]))
    for place, factor in zip(out, reduced, strict=True):
        place[: len(factor)] = factor
    return out


def project_out(jacobian: FloatArray, nuisance: FloatArray) -> FloatArray:
    """Eliminate unknowns that are estimated from the same readings: rows of information about the parameters alone.

    The information of ``[J B]`` about the parameters alone is ``J^T (I - B B^+) J``, the Schur complement of ``B^T B``;
    the rows returned are J in the orthogonal complement of B. A seat with k poses leaves 3 k - 3 of 3 k rows.

    Parameters
    ----------
    jacobian : (m, p) array
        By the parameters, rows over the noise.
    nuisance : (m, q) array
        By the unknowns, rows over the noise; without a prior.

    Returns
    -------
    (m - rank of nuisance, p) array
    """
    if not nuisance.size:
        return jacobian
    Q, R, _ = qr(nuisance, pivoting=True)
    size = np.abs(R.diagonal())
    rank = int((size > max(nuisance.shape) * np.finfo(float).eps * size[0]).sum())
    return np.asarray(Q[:, rank:].T @ jacobian)


def factor_of(matrix: FloatArray) -> FloatArray:
    """Rows F (r, p) with ``F^T F`` equal to a symmetric matrix (p, p) of rank r, to rounding.

    Raises
    ------
    InputError
        If it has an eigenvalue below zero.
    """
    scale = np.sqrt(np.abs(matrix.diagonal()))  # rounding must not depend on the parameters' units
    divisor = np.where(scale > 0, scale, 1.0)
    unit = matrix / np.outer(divisor, divisor)
    values, vectors = np.linalg.eigh(unit)
    rounding = len(values) * np.finfo(float).eps * np.abs(values).max()
    if values[0] < -10 * rounding:
        raise InputError(
            f"expected an information matrix without an eigenvalue below zero, got {values[0]:.3g} of the largest"
        )
    kept = values > rounding
    return np.ascontiguousarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T * scale)


def symmetric_matrix(name: str, matrix: npt.ArrayLike, p: int) -> FloatArray:
    """The matrix (p, p), checked: finite and symmetric to rounding."""
    array = np.asarray(matrix, dtype=float)
    if array.shape != (p, p) or p < 1:
        raise InputError(f"expected {name} of shape {(p, p)}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite")
    scale = np.sqrt(np.abs(array.diagonal()))
    if not (np.abs(array - array.T) <= 1e-9 * np.outer(scale, scale)).all():
        raise InputError(f"{name} must be symmetric")
    return np.asarray(0.5 * (array + array.T))
