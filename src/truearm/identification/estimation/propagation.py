"""Propagation of uncertainty to tips (JCGM 100:2008, 5.1.2): of unstated inputs, and of tips relative to each other.

A quantity that a reading does not state has its mean, and its variance is propagated through its derivative.

An arm that was identified from seats and lengths has a frame of its own. Joint 1 defines it, and it is known no better
than that joint's axis. This is no error of measurement where coordinates are compared with each other. With the errors
of all tips ``J e``, e of covariance ``F^T F``, and the rigid motions of all tips as columns of R,

    covariance of a tip = its block of (I - R R^+) J F^T F J^T (I - R R^+)^T,

which remains after a fit of the frame (K. S. Arun and others, IEEE PAMI 9 (1987) 698, to first order).

Consider parameters: an error of the reference that all readings share, the scale of a tracker.

No reading shows it, and none of the coefficients stands for it. With the normal matrix ``Sigma^-1``, an error e of the
points moves the coefficients by ``g = Sigma J^T W e``; with its standard uncertainty in e their covariance is
``Sigma + g g^T`` (JCGM 100:2008, 5.2.2, for correlation 1; S. F. Schmidt, "Application of state-space methods to
navigation problems", Advances in Control Systems 3 (1966) 293). So the error of a predicted point is about that of the
points around it, and distances have the error of the scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import eliminate_unknowns
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.references.alignment import rigid_motions
from truearm.identification.references.distances import Distances
from truearm.identification.references.references import Reference
from truearm.identification.terms.state import ArmState
from truearm.solve.linear_algebra import covariance_factor
from truearm.typing import FloatArray


def response_to_errors(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], errors: FloatArray
) -> FloatArray:
    """Change of the coefficients by errors of the points and distances, to first order.

    Parameters
    ----------
    fit : IdentificationResult
        At the minimum, with the covariance of the readings.
    state : ArmState
        Of all n readings.
    references : sequence of Reference
        Of the result.
    errors : (n, 4) array
        Of the points, in the frame of the chain, and of the distances [mm].

    Returns
    -------
    (n_coefficients,) array
        Zeros if no reading has a point or a distance.
    """
    gradient = np.zeros(len(fit.coefficients))
    if not errors.any():
        return gradient
    for reference, part in zip(references, fit.references, strict=True):
        if part.kind == "point":
            pulls = np.zeros((3, len(state)))
            pulls[:, part.rows] = part.weights**2 * errors[part.rows, :3].T
            gradient += fit.perturbed_chain.gradient(state, fit.coefficients, pulls)
        elif isinstance(reference, Distances):  # anchors and offsets take their part
            longer = replace(reference, distances=reference.distances + errors[part.rows, 3])
            x = np.concatenate([fit.coefficients, list(part.unknowns.values())])
            for sign, one in ((1, reference), (-1, longer)):
                problem = SmallMotionProblem(fit.perturbed_chain, state, (one,))
                reduced = eliminate_unknowns(*problem.equations(x, [part.weights]), x)
                gradient += sign * reduced.gradient[: len(gradient)]
    return np.asarray(fit.covariance @ gradient)


def with_shared_error(fit: IdentificationResult, response: FloatArray) -> IdentificationResult:
    """Add the covariance of an error to which the first coefficients respond by `response` for a standard uncertainty.

    Terms that were added since do not respond.
    """
    if not response.any():
        return fit
    shared, k = np.outer(response, response), len(fit.coefficients) - len(response)
    shared, same = np.pad(shared, (0, k)), fit.repeatability_covariance
    return replace(
        fit, covariance=fit.covariance + shared, repeatability_covariance=None if same is None else same + shared
    )


def half_tip_difference(fit: IdentificationResult, low: ArmState, high: ArmState) -> FloatArray:
    """(n, 3) half the difference of the tips between two states [mm]; zeros if no term depends on the change."""
    if all(np.array_equal(basis.values(low), basis.values(high)) for basis in fit.perturbed_chain.input_bases(low)):
        return np.zeros((len(low), 3))
    return np.asarray(fit.tips(high) - fit.tips(low)) / 2


def relative_covariance(fit: IdentificationResult, state: ArmState) -> FloatArray:
    """Covariance of tips by that of the coefficients, relative to a frame fitted to the tips of the state.

    What processes do between their inducing points is added whole: the frame takes next to nothing of it.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        The tips must not all be on a line.

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
    return out + fit.unspanned_covariance(state)
