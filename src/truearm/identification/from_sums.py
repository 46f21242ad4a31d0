"""Identify an arm from sums over all readings of a large session, where a sample of them has shown what to identify.

The sample has settled what needs every reading at once: that the readings are of the arm, which terms there are and the
scales of their priors, what is left unexplained and where, and from which size on a reading is a gross error. The
coefficients and their covariance then follow from all readings, in passes over sums (`ReadingSums`), as in the
kinematic model of a small session: the arm, and beside it the one with missing terms, which shows what the constants
alone are off by far from the readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truearm.identification.estimation.consider_parameters import response_to_point_errors, with_shared_error
from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.reading_sums import ReadingSums
from truearm.identification.estimation.rounds import SETTLED_STEP
from truearm.identification.judgement.day_to_day import on_another_day
from truearm.identification.judgement.missing_terms import SUFFIX, with_missing_terms
from truearm.identification.terms import ArmState
from truearm.solve.effective_number import DesignEffect
from truearm.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Estimate:
    """Coefficients of an arm between two passes.

    Attributes
    ----------
    x : (p,) array
        All coefficients; those of missing terms are zero.
    noise_mm2 : float
        Variance of a residual beyond the stated uncertainty.
    is_settled : bool
        Whether the last pass moved them by next to nothing.
    """

    x: FloatArray
    noise_mm2: float
    is_settled: bool = False


def own_coefficients_of(arm: IdentificationResult) -> IntArray:
    """Coefficients of the model itself, without those of missing terms."""
    return np.flatnonzero(~arm.columns_of(lambda term: term.group.endswith(SUFFIX)))


def improved(arm: IdentificationResult, before: Estimate, sums: ReadingSums) -> Estimate:
    """The next estimate, from sums over all readings at the one before."""
    own, x = own_coefficients_of(arm), before.x.copy()
    found = sums.posterior(x, arm.prior_std, own)
    step = found.x - x[own]
    x[own] = found.x
    size = float(step @ sums.gram[np.ix_(own, own)] @ step)
    factor = sums.correlated(found, arm.prior_std, own)[1].factor
    moved = float(np.sqrt(max(size, 0.0) / (factor * len(own))))
    noise = sums.noise_mm2(before.noise_mm2, float(len(own)))
    return Estimate(x, noise, moved < SETTLED_STEP and abs(np.log(noise / before.noise_mm2)) < SETTLED_STEP)


def without_part(arm: IdentificationResult, at: Estimate, sums: ReadingSums, part: ReadingSums) -> FloatArray:
    """(p,) coefficients by the readings that are not in a part, from sums at the same estimate."""
    own, x = own_coefficients_of(arm), at.x.copy()
    x[own] = sums.without(part).posterior(x, arm.prior_std, own).x
    return x


def identified(
    arm: IdentificationResult,
    at: Estimate,
    sums: ReadingSums,
    *,
    sample: ArmState,
    scale_errors: FloatArray,
    same_every_day: bool,
) -> tuple[IdentificationResult, DesignEffect]:
    """The arm by all readings, with its uncertainty, and by how much correlated readings are worth less.

    Parameters
    ----------
    arm : IdentificationResult
        By the sample.
    at : Estimate
    sums : ReadingSums
        Of all readings, at it.
    sample : ArmState
        Of the sample.
    scale_errors : (n_sample, 3) array
        Errors of its points by the scale of the reference [mm].
    same_every_day : bool
        Whether nothing changes from day to day, as of the nominal arm.
    """
    own, every = own_coefficients_of(arm), np.arange(len(at.x))
    found = sums.posterior(at.x, arm.prior_std, own)
    covariance, effect = sums.correlated(found, arm.prior_std, own)
    references = tuple(replace(part, noise_std=float(np.sqrt(at.noise_mm2))) for part in arm.references)
    fit = replace(
        arm.select(lambda term: not term.group.endswith(SUFFIX)),
        coefficients=found.x,
        covariance=covariance,
        groups=tuple(_groups(arm, found.variance, own)),
        references=references,
        repeatability_covariance=None,
    )
    result = fit
    if len(own) < len(every):
        wider = sums.posterior(at.x, arm.prior_std, every)
        of_wider, _ = sums.correlated(wider, arm.prior_std, every)
        result = with_missing_terms(fit, replace(arm, coefficients=wider.x, covariance=of_wider))
    # The response of the coefficients to an error that all points share is that of the sample: more readings of the
    # same kind do not lessen it.
    share = len(arm.references[0].rows) / max(sums.n, 1)
    of_sample = replace(sums, gram=sums.gram * share, gradient=sums.gradient * share)
    alike = replace(fit, covariance=of_sample.posterior(at.x, arm.prior_std, own).covariance)
    response = response_to_point_errors(alike, sample, scale_errors)
    if not same_every_day:
        result = on_another_day(result)
    return with_shared_error(result, response), effect


def _groups(arm: IdentificationResult, variance: FloatArray, own: IntArray) -> list[TermGroupResult]:
    """Groups of the model's own terms, with the coefficients that all readings determine."""
    chain = PerturbedChain(
        arm.perturbed_chain.chain,
        tuple(term for term in arm.perturbed_chain.terms if not term.group.endswith(SUFFIX)),
    )
    determined = 1 - variance / arm.prior_std[own] ** 2
    effective = dict.fromkeys((term.group for term in chain.terms), 0.0)
    for term, columns in zip(chain.terms, chain.columns, strict=True):
        effective[term.group] += float(determined[columns].sum())
    kept = [group for group in arm.groups if not group.name.endswith(SUFFIX)]
    return [replace(group, effective=effective.get(group.name, 0.0)) for group in kept]
