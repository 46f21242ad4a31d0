"""How readings look to an arm identified without them, group by group, in closed form.

On the linearisation at the minimum, with prior scales, noise and robust weights kept, the residuals r of a group and
its Jacobian J, both whitened, and the posterior covariance Sigma of all parameters give, with ``S = J Sigma J^T``,

    residuals without the group:                (I - S)^-1 r
    covariance of its tips without the group:   S (I - S)^-1.

A whole leave-one-group-out cross-validation then costs about as much as one more Gauss-Newton matrix. Source:
R. D. Cook, S. Weisberg, "Residuals and Influence in Regression", 1982, eqs. 2.2.7 and 3.6.4, for several cases at once.

Tips in a seat are judged by how they scatter about their own mean: leaving out the seat takes its place along.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cholesky

from truearm.identify.calibration import HeldOut
from truearm.identify.identification import Explained, Identified
from truearm.identify.problem import CHUNK
from truearm.terms.state import ArmState

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
# A group: its reference, and rows of that, seat by seat; points all in one.
Part = tuple[Explained, list[IntArray]]

# Eigenvalues of I - S: 1 where the others tell all of a group. Below this a group alone tells something, and how
# it would look without itself is unknown; its errors then come out a thousand times its residuals.
LEAST_FREEDOM = 1e-3


def leave_groups_out(fit: Identified, state: ArmState, group: IntArray) -> HeldOut:
    """Readings as an arm identified without their group sees them.

    Parameters
    ----------
    fit : Identified
    state : ArmState
        Of the readings it was identified from.
    group : (n,) int array
        The group of every reading.

    Returns
    -------
    HeldOut
        Of readings with points, and of those in seats of two or more.
    """
    root = root_of(fit.covariance)
    found = []
    for parts in _pieces(fit.references, group):
        readings = np.concatenate([reference.rows[rows] for reference, seats in parts for rows in seats])
        tips = fit.moved.derivatives(state.rows(readings), fit.coefficients)
        columns = np.concatenate([by for _, _, by in tips], axis=2)
        start = 0
        for reference, seats in parts:
            stop = start + sum(map(len, seats))
            found.append(_without(reference, seats, group, columns[..., start:stop], root))
            start = stop
    if not found:
        empty = np.zeros(0, dtype=np.intp)
        return HeldOut(empty, empty, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    names = ("rows", "group", "deviations", "covariance", "freedom")
    return HeldOut(*(np.concatenate([getattr(part, name) for part in found]) for name in names))


def _pieces(references: Sequence[Explained], group: IntArray) -> Iterator[list[Part]]:
    """Groups, several at once, so that the chain goes through many readings in one pass."""
    piece: list[Part] = []
    n = 0
    for reference in references:
        if reference.kind not in ("point", "seat"):
            continue
        keys = group[reference.rows]
        order = np.argsort(keys, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(keys[order])) + 1):
            seats = [rows]
            if reference.kind == "seat":
                held = reference.artefact[rows]
                seats = [one for seat in np.unique(held) if len(one := rows[held == seat]) > 1]
            if seats:
                piece.append((reference, seats))
                n += sum(map(len, seats))
            if n >= CHUNK:
                yield piece
                piece, n = [], 0
    if piece:
        yield piece


def _without(
    reference: Explained, seats: list[IntArray], group: IntArray, columns: FloatArray, root: FloatArray
) -> HeldOut:
    """A group, given as rows of the reference seat by seat (points: all in one), without itself.

    `columns` (p, 3, m) are derivatives of its tips, in that order.
    """
    rows = np.concatenate(seats)
    readings = reference.rows[rows]
    m = len(rows)
    weights = np.sqrt(reference.trust[rows] / (reference.std[:, rows] ** 2 + reference.noise_std**2))  # (3, m)
    jacobian = columns * weights
    residuals = weights * reference.residuals[:, rows]
    freedom = np.ones(m)
    if reference.kind == "seat":
        start = 0
        for seat in seats:
            here = slice(start, start + len(seat))
            unit = weights[:, here] / np.linalg.norm(weights[:, here], axis=1, keepdims=True)
            jacobian[..., here] -= unit * (jacobian[..., here] * unit).sum(axis=-1, keepdims=True)
            residuals[:, here] -= unit * (residuals[:, here] * unit).sum(axis=-1, keepdims=True)
            freedom[here] = 1 - (unit**2).mean(axis=0)
            start = here.stop
    spread = jacobian.reshape(len(jacobian), 3 * m).T @ root.T
    # With S = A A^T: (I - S)^-1 = I + A (I - A^T A)^-1 A^T, of which one matrix is small.
    if 3 * m <= len(jacobian):
        shares, vectors = np.linalg.eigh(spread @ spread.T)
        told = vectors * np.sqrt(np.maximum(shares, 0))
    else:
        shares, vectors = np.linalg.eigh(spread.T @ spread)
        told = spread @ vectors
    left = np.maximum(1 - shares, LEAST_FREEDOM)
    scale = 1 / weights.ravel()
    deviations = scale * (residuals.ravel() + told @ ((told.T @ residuals.ravel()) / left))
    half = (scale[:, None] * told / np.sqrt(left)).reshape(3, m, len(left))
    covariance = np.einsum("imk,jmk->mij", half, half)
    covariance += (reference.std[:, rows].T ** 2)[:, :, None] * np.eye(3)
    return HeldOut(readings, group[readings], deviations.reshape(3, m).T, covariance, freedom)


def root_of(covariance: FloatArray) -> FloatArray:
    """F with ``F^T F`` the covariance."""
    if not len(covariance):
        return covariance
    scale = np.sqrt(covariance.diagonal())
    scale[scale == 0] = 1.0
    matrix = covariance / np.outer(scale, scale)
    try:
        return np.asarray(cholesky(matrix, lower=False, check_finite=False) * scale)
    except LinAlgError:  # singular to rounding
        values, vectors = np.linalg.eigh(matrix)
        return np.asarray((vectors * np.sqrt(np.maximum(values, 0))).T * scale)
