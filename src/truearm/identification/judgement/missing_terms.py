"""What terms that a model does not have move the tip by: the spread of a kinematic model far from its readings.

A model of constants treats what bearings, encoders and gravity do as noise about a mean. Near the readings that is
right: constants take up the trend, and the rest scatters. Far from them the trend is another one. With the missing
terms beside the constants, of the size that evidence gives them from the same readings, the arm has a posterior of mean
m and covariance C. The constants alone, x, are then off by a mean square of ``C + (m - x) (m - x)^T``: the second
moment about them (JCGM 100:2008, F.2.4.5, of an error that is known and not corrected).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.terms import ArmState, Constant, Term, candidate_terms
from truearm.identification.terms.basis import Column, Direction, Temperature
from truearm.identification.terms.catalogue import WOBBLE_ORDERS
from truearm.typing import FloatArray, IntArray

# Of a term by these the spread is stated elsewhere, or its input says nothing of a pose.
NOT_OF_THE_POSE = (Constant, Temperature, Direction, Column)
SUFFIX = ", not in this model"


def missing_terms(state: ArmState, free: tuple[str, ...]) -> list[Term]:
    """Terms of the catalogue that depend on the pose: eccentricities, wobble, gravity.

    Slow ones: what repeats within some degrees scatters alike everywhere.
    """
    terms, _ = candidate_terms(state, free=free, highest=WOBBLE_ORDERS[-1])
    return [
        replace(term, group=term.group + SUFFIX)
        for term in terms
        if not isinstance(term.basis, NOT_OF_THE_POSE) and "interpolation" not in term.group
    ]


def with_missing_terms(fit: IdentificationResult, complete: IdentificationResult) -> IdentificationResult:
    """The same points, with the mean square error that the missing terms give them.

    Parameters
    ----------
    fit : IdentificationResult
        Identified without these terms.
    complete : IdentificationResult
        With them, on the same nominal chain, from the same readings, linearised about `fit`.
    """
    own, known = fit.perturbed_chain, set(fit.perturbed_chain.terms)
    added = [term for term in complete.perturbed_chain.terms if term not in known]
    chain = PerturbedChain(own.chain, (*own.terms, *added))
    at, of = _places(chain, complete.perturbed_chain)
    n = chain.n_coefficients
    x, mean, covariance, prior_std = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.ones(n)
    prior_std[at] = complete.prior_std[of]
    prior_std[: len(fit.prior_std)] = fit.prior_std
    x[: len(fit.coefficients)] = fit.coefficients
    mean[at] = complete.coefficients[of]
    covariance[np.ix_(at, at)] = complete.covariance[np.ix_(of, of)]
    off = mean - x
    own_groups = {term.group for term in added}
    groups = (replace(group, effective=0.0) for group in complete.groups if group.name in own_groups)
    return replace(
        fit,
        perturbed_chain=chain,
        coefficients=x,
        covariance=covariance + np.outer(off, off),
        prior_std=prior_std,
        groups=(*fit.groups, *groups),
    )


def with_covariance(held_out: HeldOutReadings, added: FloatArray) -> HeldOutReadings:
    """Held-out points with a further covariance (n, 3, 3) at all readings; other references as they are."""
    if held_out.n_coordinates < 3:
        return held_out
    return replace(held_out, covariance=held_out.covariance + added[held_out.rows])


def added_covariance(fit: IdentificationResult, wider: IdentificationResult, state: ArmState) -> FloatArray:
    """(n, 3, 3) what missing terms add to the covariance of the tips of `fit`, without negative eigenvalues [mm^2]."""
    values, vectors = np.linalg.eigh(wider.tip_covariance(state) - fit.tip_covariance(state))
    return np.asarray(np.einsum("nij,nj,nkj->nik", vectors, np.maximum(values, 0.0), vectors))


def _places(chain: PerturbedChain, other: PerturbedChain) -> tuple[IntArray, IntArray]:
    """Coefficients of a chain that are also those of another, and the same there."""
    where = dict(zip(chain.terms, chain.columns, strict=True))
    pairs = [(where[term], columns) for term, columns in zip(other.terms, other.columns, strict=True)]
    none = np.zeros(0, np.intp)
    return np.concatenate([none, *(a for a, _ in pairs)]), np.concatenate([none, *(b for _, b in pairs)])
