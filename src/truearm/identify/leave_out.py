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

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cholesky

from truearm.identify.calibration import HeldOut
from truearm.identify.identification import Explained, Identified
from truearm.terms.state import ArmState

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

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
    for reference in fit.references:
        if reference.kind == "point":
            keys = group[reference.rows]
            parts = [np.flatnonzero(keys == key) for key in np.unique(keys)]
            found += [_without(fit, state, reference, [part], group, root) for part in parts]
        elif reference.kind == "seat":
            seats = reference.artefact
            keys = group[reference.rows]
            for key in np.unique(keys):
                held = [np.flatnonzero((seats == seat) & (keys == key)) for seat in np.unique(seats[keys == key])]
                held = [rows for rows in held if len(rows) > 1]
                if held:
                    found.append(_without(fit, state, reference, held, group, root))
    if not found:
        empty = np.zeros(0, dtype=np.intp)
        return HeldOut(empty, empty, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    names = ("rows", "group", "deviations", "covariance", "freedom")
    return HeldOut(*(np.concatenate([getattr(part, name) for part in found]) for name in names))


def _without(
    fit: Identified,
    state: ArmState,
    reference: Explained,
    seats: list[IntArray],
    group: IntArray,
    root: FloatArray,
) -> HeldOut:
    """A group, given as rows of the reference seat by seat (points: all in one), without itself."""
    rows = np.concatenate(seats)
    readings = reference.rows[rows]
    m = len(rows)
    weights = np.sqrt(reference.trust[rows] / (reference.std[:, rows] ** 2 + reference.noise_std**2))  # (3, m)
    columns = np.concatenate([by for _, _, by in fit.moved.derivatives(state.rows(readings), fit.coefficients)], axis=2)
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
    shares, vectors = np.linalg.eigh(spread @ spread.T)
    left = np.maximum(1 - shares, LEAST_FREEDOM)
    scale = 1 / weights.ravel()
    deviations = scale * (vectors @ ((vectors.T @ residuals.ravel()) / left))
    half = (scale[:, None] * vectors * np.sqrt(np.maximum(shares, 0) / left)).reshape(3, m, 3 * m)
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
