"""Evidence: scales of parameters and of noise, estimated from the data instead of tuned.

With residuals r of precision beta and parameters x of prior precision alpha about zero, the type-II likelihood is
greatest where

    gamma = sum over i of 1 - alpha [(beta J^T J + alpha I)^-1]_ii,
    alpha = gamma / |x|^2,   beta = (n - gamma) / |r|^2.

MacKay's fixed point repeats this; gamma counts the parameters that the data, rather than the prior, determine. Source:
D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415, eqs. 4.8 to 4.10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from array_api_compat import array_namespace, is_numpy_array
from scipy.linalg import LinAlgError, cholesky
from scipy.linalg.lapack import dtrtri

from truearm.solve.arrays import Array, add_to_diagonal, to_numpy


@dataclass(frozen=True)
class Evidence:
    """Precisions and the effective number of parameters.

    Attributes
    ----------
    alpha : float
        Prior precision of a parameter, one over its unit squared.
    beta : float
        Precision of a residual, one over its unit squared.
    gamma : float
        Effective number of parameters.
    """

    alpha: float
    beta: float
    gamma: float


def update_evidence(
    evidence: Evidence, *, gram: Array, parameter_squares: float, residual_squares: float, n_residuals: int
) -> Evidence:
    """One round of MacKay's fixed point.

    Parameters
    ----------
    evidence : Evidence
        Precisions so far.
    gram : (p, p) array
        ``J^T J`` of the unweighted residuals, of NumPy or PyTorch.
    parameter_squares, residual_squares : float
        ``|x|^2`` and ``|r|^2`` at or near the most probable parameters under `evidence`.
    n_residuals : int
        Number of residuals.

    Returns
    -------
    Evidence
        The precision is unchanged if all parameters, or all residuals, are zero.
    """
    p = gram.shape[0]
    gamma = float(np.clip(p - evidence.alpha * _trace_of_variances(evidence, gram), 0, p))
    # With as many parameters as data no freedom remains to estimate the noise: use a thousandth instead.
    freedom = max(n_residuals - gamma, 1e-3 * n_residuals)
    return Evidence(
        alpha=gamma / parameter_squares if parameter_squares > 0 and gamma > 0 else evidence.alpha,
        beta=freedom / residual_squares if residual_squares > 0 else evidence.beta,
        gamma=gamma,
    )


def _trace_of_variances(evidence: Evidence, gram: Array) -> float:
    """Trace of ``(beta J^T J + alpha I)^-1``."""
    if is_numpy_array(gram):
        precision = evidence.beta * gram
        add_to_diagonal(precision, evidence.alpha)
        try:
            # With A = L L^T the trace is the sum of squares of L^-1, which costs a sixth of the whole inverse.
            inverse, _ = dtrtri(cholesky(precision, lower=True, overwrite_a=True, check_finite=False), lower=1)
            return float(np.vdot(inverse, inverse))
        except LinAlgError:  # rounding made eigenvalues of undetermined directions negative
            pass
    values = to_numpy(array_namespace(gram).linalg.eigvalsh(gram))
    return float((1 / (evidence.beta * np.maximum(values, 0) + evidence.alpha)).sum())
