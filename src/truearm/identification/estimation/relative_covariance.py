"""The uncertainty of tips against each other: what is left of it when a frame is fitted to them.

An arm that was identified from seats and lengths has a frame of its own, which joint 1 sets and which is known no
better than that joint's axis. That is no error of measurement, as coordinates are compared with each other. With the
errors of all tips ``J e``, e of covariance ``F^T F``, and the rigid motions of them all as columns of R,

    covariance of a tip = its block of (I - R R^+) J F^T F J^T (I - R R^+)^T,

which is what a fit of the frame leaves (K. S. Arun and others, IEEE PAMI 9 (1987) 698, to first order).
"""

from __future__ import annotations

import numpy as np

from truearm.identification.estimation.alignment import rigid_motions
from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.terms.state import ArmState
from truearm.solve.square_roots import covariance_factor
from truearm.typing import FloatArray


def relative_covariance(fit: IdentificationResult, state: ArmState) -> FloatArray:
    """Covariance of tips by that of the coefficients, a frame fitted to the tips of the state.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of tips that are not all on a line.

    Returns
    -------
    (n, 3, 3) array
        [mm^2].
    """
    tips = fit.tips(state)
    root = covariance_factor(fit.covariance)
    basis = np.linalg.qr(rigid_motions(tips))[0].reshape(len(tips), 3, 6)
    shared = np.zeros((6, len(root)))
    for rows, _, columns in fit.perturbed_chain.derivatives(state, fit.coefficients):
        shared += np.einsum("nia,pin->ap", basis[rows], columns, optimize=True) @ root.T
    out = np.empty((len(state), 3, 3))
    for rows, _, columns in fit.perturbed_chain.derivatives(state, fit.coefficients):
        p, _, n = columns.shape
        spread = (root @ columns.reshape(p, 3 * n)).reshape(len(root), 3, n) - np.einsum(
            "nia,ap->pin", basis[rows], shared, optimize=True
        )
        out[rows] = np.einsum("pin,pjn->nij", spread, spread, optimize=True)
    return out
