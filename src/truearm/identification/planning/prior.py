"""What is known of an arm before the next readings: its terms, and how surely."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.errors import InputError
from truearm.identification.estimation.alignment import rigid_motions
from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.planning.exchange import project_out
from truearm.identification.planning.information import tip_jacobian
from truearm.identification.terms.basis import Constant, InSession
from truearm.identification.terms.catalogue import base_terms, constants, gravity, own_axis, wobble
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.readings.checks import check_sessions
from truearm.readings.session import Session
from truearm.typing import FloatArray

Terms = Literal["physical", "constants"]

HIGHEST_ORDER = 4
"""Of the harmonics about a joint's own axis that a plan for an arm as drawn reckons with.

A disc's eccentricity and tilt and a grating's two heads make orders 1, 2 and 4; some ten poses cannot tell higher ones.
"""
# Share of the largest below which an eigenvalue of a correlation matrix is rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Prior:
    """Terms of an arm and what is known of their coefficients.

    Where the base stands is not among them: nothing that is compared within a set-up depends on it.

    Attributes
    ----------
    perturbed_chain : PerturbedChain
        Chain, as well as it is known, and terms by which it may still differ, with p coefficients that are expected to
        be zero.
    precision : (p, p) array
        Inverse of their covariance.
    noise_mm : float
        Standard deviation of a coordinate of a reading.
    state : callable
        From angles (n, n_joints) to the arm's state there.
    """

    perturbed_chain: PerturbedChain
    precision: FloatArray
    noise_mm: float
    state: Callable[[FloatArray], ArmState]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.noise_mm) and self.noise_mm > 0):
            raise InputError(f"expected the positive noise of a reading in mm, got {self.noise_mm}")

    @property
    def covariance(self) -> FloatArray:
        """(p, p) covariance of the coefficients."""
        return _inverse(self.precision)

    def with_frame(self) -> Prior:
        """The same in a reference's frame of which nothing is known: the base is free, its terms come last."""
        chain = self.perturbed_chain.chain
        base = base_terms(chain)
        p, q = self.perturbed_chain.n_coefficients, len(base)
        precision = np.zeros((p + q, p + q))
        precision[:p, :p] = self.precision
        precision[p:, p:] = np.diag(np.concatenate([term.prior_stds for term in base]) ** -2.0)
        return replace(
            self,
            perturbed_chain=PerturbedChain(chain, (*self.perturbed_chain.terms, *base)),
            precision=precision,
        )

    def updated(self, rows: FloatArray) -> Prior:
        """The same after readings that told `rows` (m, p), over their noise."""
        return replace(self, precision=self.precision + rows.T @ rows)

    def after(self, readings: Session) -> Prior:
        """What is known once readings have been taken too: points seen by a reference, and tips in seats.

        The frame of each session is unknown, and so is the place of a seat. Readings on surfaces are not counted.

        Raises
        ------
        InputError
            If the readings have neither points nor seats, or a seat or a surface is in two sessions.
        """
        check_sessions(readings)
        seat = np.full(len(readings), "") if readings.seat is None else readings.seat
        session = np.full(len(readings), "") if readings.session is None else readings.session
        seen = readings.has_point
        held = (seat != "") & ~seen
        if not (seen | held).any():
            raise readings.error("expected readings with points or seats, to know what they told; there are none")
        prior = self
        for names, which in ((session, seen), (seat, held)):
            for name in np.unique(names[which]):
                rows = np.flatnonzero(which & (names == name))
                angles = readings.angles[rows]
                if which is held:
                    # Tips that scatter would look as if the seat told the scale, and where the base is.
                    tips = self.perturbed_chain.chain.tip_in_base(angles)
                    middle = np.broadcast_to(tips.mean(axis=0), tips.shape)
                    angles = solve_inverse_kinematics(self.perturbed_chain.chain, middle, start=angles).angles
                tips, jacobian = tip_jacobian(self.perturbed_chain, self.state(angles))
                shifts = rigid_motions(tips)
                unknown = shifts if which is seen else shifts[:, :3]
                told = project_out(jacobian.reshape(3 * len(rows), -1) / self.noise_mm, unknown)
                prior = prior.updated(told)
        return prior


def nominal_prior(arm: Arm, *, terms: Terms = "physical", noise_mm: float) -> Prior:
    """What is known of an arm of which no reading has been taken: its drawing, and the priors of the terms.

    Parameters
    ----------
    arm : Arm
    terms : {"physical", "constants"}
        The constants of joints and tip (see `truearm.identification.terms.catalogue.constants`), harmonics about the joints' own axes
        up to order `HIGHEST_ORDER`, wobble, and gravity; or the constants alone.
    noise_mm : float
        Standard deviation of a coordinate of a reading, by the reference, by the touch, and by what no term explains.
    """
    chain, joints = arm.chain, range(1, arm.n_joints + 1)
    chosen: list[Term] = [term for term in constants(chain, free=()) if term.place > 0]
    if terms == "physical":
        for joint in (joint for joint in joints if not chain.is_prismatic[joint - 1]):
            chosen += [*own_axis(chain, joint, highest=HIGHEST_ORDER), *wobble(chain, joint)]
        chosen += [term for joint in (0, *joints) for term in gravity(chain, joint, links=arm.masses)]
    elif terms != "constants":
        raise InputError(f"expected the terms constants or physical, got {terms!r}")
    stds = np.concatenate([term.prior_stds for term in chosen])
    return Prior(
        PerturbedChain(chain, tuple(chosen)),
        np.diag(stds**-2.0),
        noise_mm,
        lambda angles: ArmState.of(arm, angles),
    )


def identified_prior(
    arm: Arm, found: IdentificationResult, *, noise_mm: float, state: Callable[[FloatArray], ArmState]
) -> tuple[Arm, Prior]:
    """What is known of an arm that has been identified.

    Parameters
    ----------
    arm : Arm
        As drawn.
    found : IdentificationResult
        Of it.
    noise_mm : float
        Standard deviation of a coordinate that its terms do not explain.
    state : callable
        From angles to the arm's state, as its terms need it.

    Returns
    -------
    arm : Arm
        With the constants identified, on the base as drawn.
    prior : Prior

    Raises
    ------
    InputError
        If nothing but the base has been identified.
    """
    sizes = [term.n_coefficients for term in found.perturbed_chain.terms]
    kept = [term.place > 0 or not isinstance(term.basis, Constant | InSession) for term in found.perturbed_chain.terms]
    columns = np.flatnonzero(np.repeat(kept, sizes))
    if not len(columns):
        raise InputError(
            "nothing but the base has been identified: there is nothing to plan for",
            hint="a kinematic or physical model, or the name of the arm",
        )
    fixed = found.chain.fixed.copy()
    fixed[0] = arm.chain.fixed[0]
    chain = replace(found.chain, fixed=fixed)
    prior = Prior(
        PerturbedChain(
            chain, tuple(term for term, wanted in zip(found.perturbed_chain.terms, kept, strict=True) if wanted)
        ),
        _inverse(found.covariance[np.ix_(columns, columns)]),
        noise_mm,
        state,
    )
    return replace(arm, chain=chain), prior


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a covariance or precision, whatever the units; what rounding left below zero counts as zero."""
    scale = np.sqrt(matrix.diagonal())
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    unit = (vectors / np.maximum(values, _ROUNDING * values[-1])) @ vectors.T
    return np.asarray((unit + unit.T) / 2 / np.outer(scale, scale))
