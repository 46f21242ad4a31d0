"""What poses will not tell, in words: what is left of the uncertainty, and what no pose among them can show."""

from __future__ import annotations

import numpy as np

from truearm.identification.planning.exchange import moment_matrix
from truearm.identification.planning.information import tip_jacobian
from truearm.identification.planning.prior import Prior
from truearm.identification.planning.proposal import CalibrationPlan, Proposal, information_rows
from truearm.identification.terms.catalogue import LEAST_PHASE
from truearm.typing import FloatArray

# A share of the mean square that is left from which on a cause is worth a word.
_WORTH_A_WORD = 0.1


def limitations(plan: CalibrationPlan, proposal: Proposal) -> list[str]:
    """What the poses of a proposal will not tell, a phrase each.

    Parameters
    ----------
    plan : CalibrationPlan
    proposal : Proposal
        One of its.
    """
    prior = plan.prior
    after = prior.updated(information_rows(prior, proposal.poses))
    tips, jacobian = tip_jacobian(prior.perturbed_chain, prior.state(plan.volume))
    left = moment_matrix(jacobian, tips) @ after.covariance
    # With seats, what is left apart from the scale, which is said by itself.
    cared = moment_matrix(jacobian, tips, scale=plan.artefact.kind == "seat") @ after.covariance
    said = []
    if plan.artefact.kind != "tracker":
        scale = _scale_std(tips, jacobian, after.covariance)
        if scale**2 * ((tips - tips.mean(axis=0)) ** 2).sum(axis=1).mean() > _WORTH_A_WORD * left.trace():
            more = {"bar": "a longer bar tells more", "seat": "one known length between two seats tells it"}
            said.append(
                f"the scale: all lengths together stay uncertain by {1000 * scale:.2g} mm in a metre; "
                f"{more[plan.artefact.kind]}"
            )
        said.append("where the base stands: seats tell how points lie to one another")
    said += _joints(plan, proposal.poses.angles)
    named = [f"{name} ({100 * share:.0f} %)" for name, share in _shares(prior, cared) if share >= _WORTH_A_WORD]
    said.append(f"enough about {', '.join(named)}: most of what is left comes from there")
    said.append("what no term describes, and growth with temperature unless the session has a column temperature_degC")
    return said


def _joints(plan: CalibrationPlan, angles: FloatArray) -> list[str]:
    """Which joints hardly turn, and which of the volume's poses are beyond the angles of the plan."""
    names, turns = plan.arm.joint_names, ~plan.arm.chain.is_prismatic
    said = []
    for joint in np.flatnonzero(turns & (np.ptp(angles, axis=0) < LEAST_PHASE)):
        moved = np.degrees(np.ptp(angles[:, joint]))
        said.append(f"what repeats with each turn of {names[joint]}: it moves by {moved:.0f} deg only")
    beyond = (plan.volume < angles.min(axis=0)) | (plan.volume > angles.max(axis=0))
    share = 100 * beyond.any(axis=1).mean()
    if share >= 100 * _WORTH_A_WORD:
        often = np.argsort(-beyond.sum(axis=0), kind="stable")[:3]
        most = ", ".join(names[joint] for joint in often if beyond[:, joint].any())
        said.append(f"how the arm errs beyond these angles: {share:.0f} % of the volume's poses are, mostly by {most}")
    return said


def _scale_std(tips: FloatArray, jacobian: FloatArray, covariance: FloatArray) -> float:
    """Standard uncertainty of the scale of the points in the volume, as a share."""
    apart = tips - tips.mean(axis=0)
    by_terms = np.einsum("nc,ncp->p", apart, jacobian) / (apart**2).sum()
    return float(np.sqrt(by_terms @ covariance @ by_terms))


def _shares(prior: Prior, left: FloatArray) -> list[tuple[str, float]]:
    """Share of every group of terms in the mean square that is left, ``trace(M C)``, the largest first."""
    groups = [term.group for term in prior.perturbed_chain.terms for _ in range(term.n_coefficients)]
    share = dict.fromkeys(groups, 0.0)
    for name, part in zip(groups, left.diagonal() / left.trace(), strict=True):
        share[name] += float(part)
    return sorted(share.items(), key=lambda item: -item[1])
