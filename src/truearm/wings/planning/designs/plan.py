"""A calibration plan from an arm or a model: the poses to measure next, their numbers, and their limitations."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from math import degrees
from typing import Any, Protocol

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms import ArmState
from truearm.identification.terms.term import LEAST_PHASE
from truearm.readings import Session, check_angles, skip_beyond_limits
from truearm.typing import FloatArray
from truearm.wings.planning.designs import Strategy
from truearm.wings.planning.designs.candidates import ON_A_TABLE, Candidates
from truearm.wings.planning.designs.exchange import moment_matrix
from truearm.wings.planning.designs.information import tip_jacobian
from truearm.wings.planning.designs.prior import Prior, Terms, identified_prior, nominal_prior
from truearm.wings.planning.designs.proposal import (
    Artefact,
    CalibrationPlan,
    Progress,
    Proposal,
    information_rows,
    propose,
)
from truearm.wings.planning.designs.template import continue_seat_numbers
from truearm.wings.planning.designs.workspace import Sector, Surroundings

NOISE_MM = 0.02
"""Standard deviation of a coordinate if no model states it [mm]."""

# Poses per seat that are usual, and the largest number of seats chosen by default.
POSES_PER_SEAT, MAX_SEATS = 10, 10
# Smallest share of the remaining mean square uncertainty that is mentioned.
_MENTIONED = 0.1


class IdentifiedArm(Protocol):
    """What planning needs of a model: a kinematic or physical model of `truearm.models`."""

    arm_: Arm
    fit_: IdentificationResult
    residual_std_: float

    def state(self, readings: Session) -> ArmState:
        """State of the arm at readings."""

    def is_trained_on(self, readings: Session) -> bool:
        """Whether the model was identified from most of these readings."""


@dataclass(frozen=True, eq=False)
class SessionPlan:
    """The poses of a calibration session, by one strategy of a plan.

    Attributes
    ----------
    plan : CalibrationPlan
        The proposals of all strategies.
    strategy : str
        The strategy of the poses.
    poses : Candidates
        In the order of measurement; seats are numbered on from those already used.
    known_before : str
        Source of the prior knowledge, in a phrase.
    """

    plan: CalibrationPlan
    strategy: Strategy
    poses: Candidates
    known_before: str

    @property
    def proposal(self) -> Proposal:
        """The proposal of the strategy."""
        return self.plan.proposals[self.strategy]

    @property
    def before_mm(self) -> float:
        """Uncertainty of a point in the volume before the session, three-dimensional root mean square."""
        return float(self.proposal.rms_mm[0])

    @property
    def after_mm(self) -> float:
        """The same after the session."""
        return float(self.proposal.rms_mm[-1])

    @property
    def n_places(self) -> int:
        """Number of seats, or of places of the bar; 0 with a tracker."""
        return 0 if self.poses.place is None else len(set(self.poses.place.tolist()))

    @cached_property
    def limitations(self) -> tuple[str, ...]:
        """What these poses cannot determine, a sentence each."""
        return tuple(limitations(self.plan, self.proposal))

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of the plan as plain data, ready for JSON."""
        return {
            "arm": self.plan.arm.name,
            "artefact": self.plan.artefact.kind,
            "strategy": self.strategy,
            "n": len(self.poses),
            "places": self.n_places,
            "noise_mm": self.plan.prior.noise_mm,
            "before_mm": self.before_mm,
            "after_mm": self.after_mm,
            "mean_joint_move_deg": degrees(self.proposal.mean_move),
            "strategies": {name: proposal.to_dict() for name, proposal in self.plan.proposals.items()},
            "limitations": list(self.limitations),
        }


def plan_session(
    arm: Arm | IdentifiedArm,
    artefact: Artefact,
    n: int = 50,
    *,
    strategy: Strategy = "i-optimal",
    terms: Terms | None = None,
    noise_mm: float | None = None,
    measured: Session | None = None,
    volume: Sector | None = None,
    surroundings: Surroundings = ON_A_TABLE,
    seed: int = 0,
    progress: Progress | None = None,
) -> SessionPlan:
    """Plan the poses of a calibration session.

    Parameters
    ----------
    arm : Arm or kinematic or physical model
        A nominal arm, or a model: then the plan continues after the readings of the model.
    artefact : Artefact
        What the readings are taken with.
    n : int
        Number of poses; two and more for each seat.
    strategy : {"i-optimal", "d-optimal", "technician", "random"}
        Of the poses returned; all strategies are compared.
    terms : {"physical", "constants"}, optional
        Terms to identify of a nominal arm, by default physical. A model has its own.
    noise_mm : float, optional
        Standard deviation of a coordinate of a reading; by default the model's, else 0.02 mm.
    measured : Session, optional
        Readings already taken that the model was not identified from.
    volume : Sector, optional
        Where the arm is to be used.
    surroundings : Surroundings
        The table that carries the artefacts, and boxes to avoid.
    seed : int
    progress : callable, optional
        Called with the number of strategies done and a note.

    Raises
    ------
    InputError
        If terms are given with a model, the model was identified from `measured`, the arm cannot take a technician's
        poses, or as `propose`.
    """
    nominal, prior, seats = _known_before(arm, terms, noise_mm, measured)
    plan = propose(
        nominal,
        prior,
        artefact,
        n,
        volume=volume,
        surroundings=surroundings,
        to_measure=strategy,
        seed=seed,
        progress=progress,
    )
    poses = continue_seat_numbers(_proposed(plan, strategy).poses, seats)
    known_before = "the nominal arm, with the priors of its terms" if isinstance(arm, Arm) else "the model"
    return SessionPlan(plan, strategy, poses, known_before)


def _proposed(plan: CalibrationPlan, strategy: Strategy) -> Proposal:
    if strategy not in plan.proposals:
        raise InputError(
            f"a technician's poses need at least five rotary joints; arm {plan.arm.name!r} has fewer",
            hint="--strategy i-optimal",
        )
    return plan.proposals[strategy]


def usual_places(kind: str, n: int) -> int:
    """Number of seats, or of places of a bar with its two seats, for about ten poses per seat; 0 with a tracker."""
    if kind == "tracker":
        return 0
    each = POSES_PER_SEAT * (2 if kind == "bar" else 1)
    return max(1, min(round(n / each), MAX_SEATS))


def _known_before(
    arm: Arm | IdentifiedArm, terms: Terms | None, noise_mm: float | None, measured: Session | None
) -> tuple[Arm, Prior, list[str]]:
    """The arm, the knowledge of it before the session, and the seats that were used; see `plan_session`."""
    if isinstance(arm, Arm):
        noise_mm = NOISE_MM if noise_mm is None else noise_mm
        nominal, prior, seats = arm, nominal_prior(arm, terms=terms or "physical", noise_mm=noise_mm), []
    else:
        if terms is not None:
            raise InputError("terms are chosen for a nominal arm only; a model has its own terms", hint="omit --terms")
        noise_mm = arm.residual_std_ if noise_mm is None else noise_mm
        nominal, prior = identified_prior(
            arm.arm_, arm.fit_, noise_mm=noise_mm, state=lambda angles: arm.state(Session(angles))
        )
        seats = _seats_of(arm.fit_)
    if measured is not None:
        check_angles(measured, n_joints=nominal.n_joints, prismatic=nominal.chain.is_prismatic)
        measured, _ = skip_beyond_limits(measured, nominal.limits, prismatic=nominal.chain.prismatic)
        if not isinstance(arm, Arm) and arm.is_trained_on(measured):
            raise measured.error("the model was identified from these readings; they are already taken into account")
        prior = prior.after(measured)
        seats += [] if measured.seat is None else measured.seat.tolist()
    return nominal, prior, seats


def _seats_of(fit: IdentificationResult) -> list[str]:
    """Names of the seats of the readings that an arm was identified from."""
    names = [name for reference in fit.references for name in reference.unknowns]
    matches = (re.fullmatch(r"x of seat (.+) \[mm\]", name) for name in names)
    return [match[1] for match in matches if match]


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
