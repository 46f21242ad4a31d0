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

from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.propagation import response_to_point_errors, with_shared_error
from truearm.identification.estimation.reading_sums import ReadingSums
from truearm.identification.estimation.rounds import SETTLED_STEP
from truearm.identification.judgement.day_to_day import on_another_day
from truearm.identification.judgement.missing_terms import SUFFIX, with_missing_terms
from truearm.identification.terms import ArmState
from truearm.solve.group_evidence import determined_shares
from truearm.solve.sums import DesignEffect
from truearm.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Iterate:
    """Coefficients of an arm between two passes.

    Attributes
    ----------
    x : (p,) array
        Those of the model itself; those of missing terms, which come after them, are zero.
    noise_mm2 : float
        Variance of a residual beyond the stated uncertainty.
    moved : float or None
        How far the last pass moved them, in standard uncertainties.
    is_settled : bool
        Whether the next one would move them by next to nothing.
    """

    x: FloatArray
    noise_mm2: float
    moved: float | None = None
    is_settled: bool = False


def of_the_model_itself(arm: IdentificationResult) -> IdentificationResult:
    """The arm without missing terms, whose coefficients come last."""
    return arm.select(lambda term: not term.group.endswith(SUFFIX))


def improved(arm: IdentificationResult, before: Iterate, sums: ReadingSums) -> Iterate:
    """The next iterate, from sums over all readings at the one before.

    Steps shrink by about the same factor, so that of two steps follows what a third one would be.
    """
    own = np.arange(len(before.x))
    found = sums.posterior(before.x, arm.prior_std, own)
    step = found.x - before.x
    size = float(step @ sums.gram[np.ix_(own, own)] @ step)
    factor = sums.correlated(found, arm.prior_std, own)[1].factor
    moved = float(np.sqrt(max(size, 0.0) / (factor * len(own))))
    following = moved if before.moved is None else moved * min(moved / max(before.moved, 1e-300), 1.0)
    noise = sums.noise_mm2(before.noise_mm2, float(len(own)))
    is_settled = following < SETTLED_STEP and abs(np.log(noise / before.noise_mm2)) < SETTLED_STEP
    return Iterate(found.x, noise, moved, is_settled)


def without_part(arm: IdentificationResult, at: Iterate, sums: ReadingSums, part: ReadingSums) -> FloatArray:
    """(p,) coefficients by the readings that are not in a part, from sums at the same iterate."""
    return sums.without(part).posterior(at.x, arm.prior_std, np.arange(len(at.x))).x


def identified(
    arm: IdentificationResult,
    at: Iterate,
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
    at : Iterate
    sums : ReadingSums
        Of all readings, at it.
    sample : ArmState
        Of the sample.
    scale_errors : (n_sample, 3) array
        Errors of its points by the scale of the reference [mm].
    same_every_day : bool
        Whether nothing changes from day to day, as of the nominal arm.
    """
    own, every = np.arange(len(at.x)), np.arange(len(arm.prior_std))
    found = sums.posterior(at.x, arm.prior_std, own)
    covariance, effect = sums.correlated(found, arm.prior_std, own)
    references = tuple(replace(part, noise_std=float(np.sqrt(at.noise_mm2))) for part in arm.references)
    fit = replace(
        of_the_model_itself(arm),
        coefficients=found.x,
        covariance=covariance,
        groups=tuple(_groups(arm, found.variance, own)),
        references=references,
        repeatability_covariance=None,
    )
    result = fit
    if len(own) < len(every):
        wider = sums.posterior(np.pad(at.x, (0, len(every) - len(own))), arm.prior_std, every)
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
    determined = determined_shares(variance, arm.prior_std[own] ** -2.0)
    effective = dict.fromkeys((term.group for term in chain.terms), 0.0)
    for term, columns in zip(chain.terms, chain.columns, strict=True):
        effective[term.group] += float(determined[columns].sum())
    kept = [group for group in arm.groups if not group.name.endswith(SUFFIX)]
    return [replace(group, effective=effective.get(group.name, 0.0)) for group in kept]
