"""Consider parameters: an error of the reference that all readings share, the scale of a tracker.

No reading shows it, and none of the coefficients stands for it. With the normal matrix ``Sigma^-1``, an error e of the
points moves the coefficients by ``g = Sigma J^T W e``; with its standard uncertainty in e their covariance is
``Sigma + g g^T`` (JCGM 100:2008, 5.2.2, for correlation 1; S. F. Schmidt, "Application of state-space methods to
navigation problems", Advances in Control Systems 3 (1966) 293). So the error of a predicted point is about that of the
points around it, and distances have the error of the scale.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms.state import ArmState
from truearm.typing import FloatArray


def response_to_point_errors(fit: IdentificationResult, state: ArmState, errors: FloatArray) -> FloatArray:
    """Change of the coefficients by errors of the points, to first order.

    Parameters
    ----------
    fit : IdentificationResult
        At the minimum, with the covariance of the readings.
    state : ArmState
        Of all n readings.
    errors : (n, 3) array
        Of the points, in the frame of the chain [mm].

    Returns
    -------
    (n_coefficients,) array
        Zeros if no reading has a point.
    """
    gradient = np.zeros(len(fit.coefficients))
    if not errors.any():
        return gradient
    for reference in fit.references:
        if reference.kind == "point":
            pulls = np.zeros((3, len(state)))
            pulls[:, reference.rows] = reference.weights**2 * errors[reference.rows].T
            gradient += fit.perturbed_chain.gradient(state, fit.coefficients, pulls)
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
        fit,
        covariance=fit.covariance + shared,
        repeatability_covariance=None if same is None else same + shared,
    )
