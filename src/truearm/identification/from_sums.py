"""Identify an arm from sums over all readings of a large session, where a sample of them has shown what to identify.

The sample has settled what needs every reading at once: that the readings are of the arm, which terms there are and the
scales of their priors, what is left unexplained and where, and from which size on a reading is a gross error. The
coefficients and their covariance then follow from all readings, in passes over sums (`ReadingSums`), as of a small
session: the arm, and beside that of constants alone the one with missing terms, which shows what the constants are off
by far from the readings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.reading_sums import ReadingSums
from truearm.identification.estimation.rounds import SETTLED_STEP
from truearm.identification.judgement.missing_terms import SUFFIX, with_missing_terms
from truearm.identification.terms.basis import Temperature
from truearm.solve.group_evidence import determined_shares
from truearm.solve.sums import DesignEffect
from truearm.typing import BoolArray, FloatArray

# Information of all readings on a motion, by that of its prior, below which it stays as by the sample, if a step along
# it is more than this share of the prior.
LEAST_SHOWN, MOST_OF_PRIOR = 10.0, 0.5


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


def shown_motions(arm: IdentificationResult, at: Iterate, sums: ReadingSums) -> FloatArray:
    """(p, p) projection of a change of the coefficients onto motions that all readings show.

    Along others (the place of a joint and a tip that move together) derivatives change with what is left of the
    residuals, and steps of the normal equations lead far beyond the prior, to and fro. These stay as by the sample.
    """
    own = np.arange(len(at.x))
    std = arm.prior_std[own]
    step = sums.posterior(at.x, arm.prior_std, own).x - at.x
    sizes, directions = np.linalg.eigh(sums.gram[np.ix_(own, own)] * np.outer(std, std))
    shown = directions[:, (sizes > LEAST_SHOWN) | (np.abs(directions.T @ (step / std)) < MOST_OF_PRIOR)]
    return std[:, None] * (shown @ (shown.T / std))


def improved(arm: IdentificationResult, before: Iterate, sums: ReadingSums, shown: FloatArray) -> Iterate:
    """The next iterate, from sums over all readings at the one before, along the motions that they show.

    Steps shrink by about the same factor, so that of two of them follows what a third one would be.
    """
    own = np.arange(len(before.x))
    found, gram = sums.posterior(before.x, arm.prior_std, own), sums.gram[np.ix_(own, own)]
    step = shown @ (found.x - before.x)
    factor = sums.effect(found, arm.prior_std, own).factor
    moved = float(np.sqrt(max(float(step @ gram @ step), 0.0) / (factor * len(own))))
    following = moved if before.moved is None else moved * min(moved / max(before.moved, 1e-300), 1.0)
    determined = float(determined_shares(found.variance, arm.prior_std[own] ** -2.0).sum())
    noise = sums.noise_mm2(before.noise_mm2, determined)
    is_settled = following < SETTLED_STEP and abs(np.log(noise / before.noise_mm2)) < SETTLED_STEP
    return Iterate(before.x + step, noise, moved, is_settled)


def without_part(
    arm: IdentificationResult, at: Iterate, sums: ReadingSums, part: ReadingSums, shown: FloatArray
) -> FloatArray:
    """(p,) coefficients by the readings that are not in a part, from sums at the same iterate."""
    found = sums.without(part).posterior(at.x, arm.prior_std, np.arange(len(at.x)))
    return at.x + shown @ (found.x - at.x)


def identified(
    of_sample: IdentificationResult,
    arm: IdentificationResult,
    at: Iterate,
    sums: ReadingSums,
    x: FloatArray,
    repeated: FloatArray | None = None,
) -> tuple[IdentificationResult, DesignEffect]:
    """The arm of a sample by all readings, and by how much correlated readings are worth less.

    What the readings do not show (another day, states that no reading had, the reference's scale) is in the uncertainty
    as by the sample: more readings of the same kind do not lessen it. So is how the links grow. What all readings
    change is the rest, were growth known.

    Parameters
    ----------
    of_sample : IdentificationResult
        The arm with all of its uncertainty.
    arm : IdentificationResult
        The same by readings and priors alone.
    at : Iterate
    sums : ReadingSums
        Of all readings, at it.
    x : (p,) array
        Coefficients of the model itself by them.
    repeated : (p, p) array, optional
        Covariance of the gradient by errors that come back with their poses (`ReadingSums.correlated`).
    """
    own, every = np.arange(len(at.x)), np.arange(len(arm.prior_std))
    found = sums.posterior(at.x, arm.prior_std, own)
    covariance, effect = sums.correlated(found, arm.prior_std, own, repeated)
    by_all = replace(of_the_model_itself(arm), coefficients=found.x, covariance=covariance)
    if len(own) < len(every):
        wider = sums.posterior(np.pad(at.x, (0, len(every) - len(own))), arm.prior_std, every)
        of_wider, _ = sums.correlated(wider, arm.prior_std, every, repeated)
        by_all = with_missing_terms(by_all, replace(arm, coefficients=wider.x, covariance=of_wider))
    by_all = replace(by_all, coefficients=np.pad(x, (0, len(every) - len(own))))
    grows = arm.columns_of(lambda term: isinstance(term.basis, Temperature))
    known = of_sample.coefficients[: len(grows)][grows]
    (by_sums, more), (by_sample, less) = (_were_growth_known(one, grows, known) for one in (by_all, arm))
    others = np.flatnonzero(~grows)
    coefficients, covariance = of_sample.coefficients.copy(), of_sample.covariance.copy()
    coefficients[others] += by_sums - by_sample
    same, block = of_sample.repeatability_covariance, np.ix_(others, others)
    covariance[block] += more - less
    if same is not None:
        same = same.copy()
        same[block] += more - less
    references = tuple(replace(part, noise_std=float(np.sqrt(at.noise_mm2))) for part in arm.references)
    return replace(
        of_sample,
        coefficients=coefficients,
        covariance=covariance,
        repeatability_covariance=same,
        groups=tuple(_groups(of_sample, by_all, found.variance)),
        references=references,
    ), effect


def _were_growth_known(
    fit: IdentificationResult, grows: BoolArray, growth: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The other coefficients, and their covariance, were the growth of the links known."""
    covariance, others = fit.covariance, ~grows
    gain = np.linalg.solve(covariance[np.ix_(grows, grows)], covariance[np.ix_(grows, others)])
    x = fit.coefficients[others] + (growth - fit.coefficients[grows]) @ gain
    return x, covariance[np.ix_(others, others)] - covariance[np.ix_(others, grows)] @ gain


def _groups(
    of_sample: IdentificationResult, by_all: IdentificationResult, variance: FloatArray
) -> Iterator[TermGroupResult]:
    """Groups with the coefficients that all readings determine; how links grow is that of the sample."""
    determined = determined_shares(variance, by_all.prior_std[: len(variance)] ** -2.0)
    effective: dict[str, float] = {}
    for term, columns in zip(by_all.perturbed_chain.terms, by_all.perturbed_chain.columns, strict=True):
        if columns[-1] < len(variance) and not isinstance(term.basis, Temperature):
            effective[term.group] = effective.get(term.group, 0.0) + float(determined[columns].sum())
    return (replace(group, effective=effective.get(group.name, group.effective)) for group in of_sample.groups)
