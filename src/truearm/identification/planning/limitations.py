"""What a plan cannot determine, in sentences: the remaining uncertainty and its sources."""

from __future__ import annotations

import numpy as np

from truearm.identification.planning.factors import moment_matrix
from truearm.identification.planning.information import tip_jacobian
from truearm.identification.planning.prior import Prior
from truearm.identification.planning.proposal import CalibrationPlan, Proposal, information_rows
from truearm.identification.terms.harmonic_orders import LEAST_PHASE
from truearm.typing import FloatArray

# Smallest share of the remaining mean square uncertainty that is mentioned.
_MENTIONED = 0.1


def limitations(plan: CalibrationPlan, proposal: Proposal) -> list[str]:
    """Return what the poses of a proposal cannot determine, a sentence each.

    Parameters
    ----------
    plan : CalibrationPlan
    proposal : Proposal
        One of the plan's.
    """
    prior = plan.prior
    after = prior.updated(information_rows(prior, proposal.poses))
    tips, jacobian = tip_jacobian(prior.perturbed_chain, prior.state(plan.volume))
    remaining = moment_matrix(jacobian, tips) @ after.covariance
    sentences = []
    if plan.artefact.kind != "tracker":
        scale = _scale_std(tips, jacobian, after.covariance)
        if scale**2 * ((tips - tips.mean(axis=0)) ** 2).sum(axis=1).mean() > _MENTIONED * remaining.trace():
            remedy = {"bar": "A longer bar reduces it.", "seat": "One known length between two seats determines it."}
            sentences.append(
                f"The scale is uncertain: {1000 * scale:.2g} mm per metre, common to all lengths. "
                f"{remedy[plan.artefact.kind]}"
            )
        sentences.append("Not identifiable from this plan: the base position. Seats relate points to each other only.")
    sentences += _joints(plan, proposal.poses.angles)
    # With seats, the scale has a sentence of its own.
    without_scale = moment_matrix(jacobian, tips, scale=plan.artefact.kind == "seat") @ after.covariance
    by_group = list(_shares(prior, without_scale))
    all_shares = [share for _, share in by_group]
    shares = [f"{name} ({100 * share:.0f} %)" for name, share in by_group if share >= _MENTIONED]
    correlated = " (alone; correlated sources add up to more than 100 %)" if sum(all_shares) > 1.05 else ""
    sentences.append(f"Main sources of the remaining uncertainty{correlated}: {', '.join(shares)}.")
    sentences.append(
        "Not identifiable from this plan: effects without a term, and thermal growth unless the session has a column "
        "temperature_degC."
    )
    return sentences


def _joints(plan: CalibrationPlan, angles: FloatArray) -> list[str]:
    """Joints that hardly turn, and the share of the volume's poses outside the joint angles of the plan."""
    rotary = ~plan.arm.chain.is_prismatic
    sentences = []
    for joint in np.flatnonzero(rotary & (np.ptp(angles, axis=0) < LEAST_PHASE)):
        moved = np.degrees(np.ptp(angles[:, joint]))
        sentences.append(
            f"Not identifiable from this plan: errors that repeat with each turn of J{joint + 1}. It moves by "
            f"{moved:.0f} deg only."
        )
    outside = (plan.volume < angles.min(axis=0)) | (plan.volume > angles.max(axis=0))
    share = outside.any(axis=1).mean()
    if share >= _MENTIONED:
        often = np.argsort(-outside.sum(axis=0), kind="stable")[:3]
        joints = ", ".join(f"J{joint + 1}" for joint in often if outside[:, joint].any())
        sentences.append(
            f"{100 * share:.0f} % of the poses in the volume are outside the joint angles of this plan, mostly in "
            f"{joints}. Errors there are extrapolated."
        )
    return sentences


def _scale_std(tips: FloatArray, jacobian: FloatArray, covariance: FloatArray) -> float:
    """Relative standard uncertainty of the scale of the points in the volume."""
    centred = tips - tips.mean(axis=0)
    by_terms = np.einsum("nc,ncp->p", centred, jacobian) / (centred**2).sum()
    return float(np.sqrt(by_terms @ covariance @ by_terms))


def _shares(prior: Prior, remaining: FloatArray) -> list[tuple[str, float]]:
    """Share of every group of terms in the remaining mean square, ``trace(M C)``, the largest first."""
    groups = [term.group for term in prior.perturbed_chain.terms for _ in range(term.n_coefficients)]
    share = dict.fromkeys(groups, 0.0)
    for name, part in zip(groups, remaining.diagonal() / remaining.trace(), strict=True):
        share[name] += float(part)
    return sorted(share.items(), key=lambda item: -item[1])
