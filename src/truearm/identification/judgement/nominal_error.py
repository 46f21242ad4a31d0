"""The usual error of a nominal arm: how far it misses readings if its constants err as the prior expects.

Before the constants are identified, their prior predicts the residuals of the nominal arm with base, tip and all else
that is free fitted. With the normal equations G of all parameters, those of the constants without what the free ones
(f) absorb are ``S = G - G_f G_ff^-1 G_f^T``, and the expected sum of squared residuals is ``sum_i S_ii s_i^2`` by the
constants' standard deviations s. Residuals far above that are not of this arm: a prior predictive check (G. E. P. Box,
"Sampling and Bayes' inference in scientific modelling and robustness", J. R. Stat. Soc. A 143 (1980) 383).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.identification.estimation.identification import initial_problem
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import eliminate_unknowns, linearised
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.references import Reference
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.solve.threads import one_blas_thread

# Smaller eigenvalues of the free parameters, relative to the largest, are rounding: no readings determine them.
LEAST_EIGENVALUE = 1e-9


def usual_error(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], constants: Sequence[Term]
) -> float:
    """Root mean square distance of a nominal arm from its references that errors of its constants usually cause.

    Parameters
    ----------
    fit : IdentificationResult
        Of the free terms: base, tip, and others that every fit has.
    state : ArmState
        Of the readings.
    references : sequence of Reference
        Without known lengths.
    constants : sequence of Term
        The constants of the nominal arm, with their prior standard deviations.

    Returns
    -------
    float
        [mm]; zero if the free terms absorb all that errors of the constants cause, as those of an arm with one joint.
    """
    free = fit.perturbed_chain.terms
    chain = PerturbedChain(fit.chain, (*free, *constants))
    problem, unknowns = initial_problem(chain, state, references)
    x = np.concatenate([np.zeros(chain.n_coefficients), unknowns])
    with one_blas_thread():
        parts, whole = linearised(problem, x, [np.ones((one.n_residuals, len(one.rows))) for one in references])
        G = eliminate_unknowns(parts, whole, x).gram
        n_free = sum(term.n_coefficients for term in free)
        is_constant = np.zeros(len(G), dtype=bool)
        is_constant[n_free : chain.n_coefficients] = True
        G_ff, G_cf = G[np.ix_(~is_constant, ~is_constant)], G[np.ix_(is_constant, ~is_constant)]
        # Lengths and angles in one matrix: scaled to a unit diagonal.
        scale = 1 / np.sqrt(np.maximum(G_ff.diagonal(), np.finfo(float).tiny))
        inverse = np.linalg.pinv(scale[:, None] * G_ff * scale, rcond=LEAST_EIGENVALUE, hermitian=True)
        absorbed = np.einsum("if,fg,ig->i", G_cf * scale, inverse, G_cf * scale)
    std = np.concatenate([np.zeros(0), *(term.prior_stds for term in constants)])
    whole_squares = G.diagonal()[is_constant]
    remains = whole_squares - absorbed
    squares = np.where(remains > LEAST_EIGENVALUE * whole_squares, remains, 0.0) * std**2
    return float(np.sqrt(squares.sum() / sum(len(one.rows) for one in references)))
