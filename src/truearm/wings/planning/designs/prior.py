"""Prior knowledge of an arm before the next readings: its terms and the covariance of their coefficients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from truearm.arm import Arm, solve_inverse_kinematics
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.alignment import rigid_motions
from truearm.identification.terms import ArmState, Constant, InSession, Term, base_terms, constants
from truearm.identification.terms.catalogue import gravity, own_axis, wobble
from truearm.identification.terms.linear_axis import linear_axis
from truearm.readings import Session, check_sessions
from truearm.typing import BoolArray, FloatArray, NameArray
from truearm.wings.planning.designs import Terms as Terms
from truearm.wings.planning.designs.exchange import project_out
from truearm.wings.planning.designs.information import tip_jacobian

HIGHEST_ORDER = 4
"""Highest order of the harmonics about a joint's own axis in a plan for a nominal arm.

Eccentricity and tilt of a disc and the two heads of a grating give orders 1, 2 and 4; some ten poses cannot identify
higher ones.
"""
# Of a linear axis as many orders as its positions can tell apart.
RAIL_POSITIONS = 7
# Share of the largest below which an eigenvalue of a correlation matrix is rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Prior:
    """Terms of an arm and the prior knowledge of their coefficients.

    The base position is not among them: comparisons within a set-up do not depend on it.

    Attributes
    ----------
    perturbed_chain : PerturbedChain
        Best known chain with its constants, and terms by which it may still differ, with p coefficients.
    precision : (p, p) array
        Inverse of their covariance.
    noise_mm : float
        Standard deviation of a coordinate of a reading.
    state : callable
        From angles (n, n_joints) to the state of the arm.
    mean : (p,) array, optional
        Of the coefficients: zeros by default. Plans are linearised at zero.
    """

    perturbed_chain: PerturbedChain
    precision: FloatArray
    noise_mm: float
    state: Callable[[FloatArray], ArmState]
    mean: FloatArray | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.noise_mm) and self.noise_mm > 0):
            raise InputError(f"expected a positive noise of a reading in mm, got {self.noise_mm}")

    @property
    def covariance(self) -> FloatArray:
        """(p, p) covariance of the coefficients."""
        return _inverse(self.precision)

    def with_frame(self) -> Prior:
        """Add a free base, for a reference frame in an unknown position; its terms come last."""
        return self._with_frame

    @cached_property
    def _with_frame(self) -> Prior:
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
            mean=None if self.mean is None else np.pad(self.mean, (0, q)),
        )

    def updated(self, rows: FloatArray) -> Prior:
        """Add the information of readings: `rows` (m, p) of their Jacobian over the noise."""
        return replace(self, precision=self.precision + rows.T @ rows)

    def after(self, readings: Session) -> Prior:
        """Add the information of readings: points measured by a reference, and tips in seats.

        The frame of each session is unknown, and so is the position of a seat. Readings on surfaces are ignored.

        Raises
        ------
        InputError
            If the readings have neither points nor seats, or a seat or a surface is in two sessions.
        """
        check_sessions(readings)
        seat, held = held_readings(readings)
        session = np.full(len(readings), "") if readings.session is None else readings.session
        seen = readings.has_point
        if not (seen | held).any():
            raise readings.error("expected readings with points or seats; there are none")
        prior = self
        for names, which in ((session, seen), (seat, held)):
            for name in np.unique(names[which]):
                rows = np.flatnonzero(which & (names == name))
                angles = readings.angles[rows]
                if which is held:
                    # Scattered tips would pretend that the seat determines the scale and the base position.
                    tips = self.perturbed_chain.chain.tip_in_base(angles)
                    middle = np.broadcast_to(tips.mean(axis=0), tips.shape)
                    angles = solve_inverse_kinematics(self.perturbed_chain.chain, middle, start=angles).angles
                tips, jacobian = tip_jacobian(self.perturbed_chain, self.state(angles))
                shifts = rigid_motions(tips)
                unknown = shifts if which is seen else shifts[:, :3]
                information = project_out(jacobian.reshape(3 * len(rows), -1) / self.noise_mm, unknown)
                prior = prior.updated(information)
        return prior


def held_readings(readings: Session) -> tuple[NameArray, BoolArray]:
    """The seat of each reading, empty where there is none, and whether that says where the tip is: no point does."""
    seat = np.full(len(readings), "") if readings.seat is None else readings.seat
    return seat, np.asarray((seat != "") & ~readings.has_point)


def nominal_prior(arm: Arm, *, terms: Terms = "physical", noise_mm: float) -> Prior:
    """Prior knowledge of a nominal arm: the priors of its terms.

    Parameters
    ----------
    arm : Arm
    terms : {"physical", "constants"}
        The constants of joints and tip (see `terms.catalogue.constants`), harmonics about the joints' own axes up
        to order `HIGHEST_ORDER`, wobble, gravity, and the errors of a linear axis before them; or the constants alone.
    noise_mm : float
        Standard deviation of a coordinate of a reading: reference, contact, and effects without a term.
    """
    chain, joints = arm.chain, range(1, arm.n_joints + 1)
    chosen: list[Term] = [term for term in constants(chain, free=()) if term.place > 0]
    if terms == "physical":
        for joint in (joint for joint in joints if not chain.is_prismatic[joint - 1]):
            chosen += [*own_axis(chain, joint, highest=HIGHEST_ORDER), *wobble(chain, joint)]
        if chain.is_prismatic[0] and np.isfinite(arm.limits[0]).all():
            chosen += linear_axis(1, np.linspace(arm.limits[0, 0], arm.limits[0, 1], RAIL_POSITIONS))
        chosen += [term for joint in (0, *joints) for term in gravity(chain, joint, links=arm.masses)]
    elif terms != "constants":
        raise InputError(f"expected the terms constants or physical, got {terms!r}")
    stds = np.concatenate([term.prior_stds for term in chosen])
    return Prior(
        PerturbedChain(chain, tuple(chosen)), np.diag(stds**-2.0), noise_mm, lambda angles: ArmState.of(arm, angles)
    )


def identified_prior(
    arm: Arm, fit: IdentificationResult, *, noise_mm: float, state: Callable[[FloatArray], ArmState]
) -> tuple[Arm, Prior]:
    """Prior knowledge of an identified arm.

    Parameters
    ----------
    arm : Arm
        Nominal.
    fit : IdentificationResult
    noise_mm : float
        Residual standard deviation of a coordinate.
    state : callable
        From angles to the state of the arm that its terms need.

    Returns
    -------
    arm : Arm
        With the identified constants, on the nominal base.
    prior : Prior

    Raises
    ------
    InputError
        If nothing but the base has been identified.
    """
    kept = fit.select(
        lambda term: not isinstance(term.basis, InSession) and (term.place > 0 or not isinstance(term.basis, Constant))
    )
    if not len(kept.coefficients):
        raise InputError(
            "the model has no identified terms except the base; there is nothing to plan for",
            hint="use a kinematic or physical model, or the name of the arm",
        )
    fixed = fit.chain.fixed.copy()
    fixed[0] = arm.chain.fixed[0]
    chain = replace(fit.chain, fixed=fixed)
    terms = kept.perturbed_chain.terms
    in_chain = np.concatenate([np.full(term.n_coefficients, isinstance(term.basis, Constant)) for term in terms])
    mean = np.where(in_chain, 0.0, kept.coefficients)
    prior = Prior(PerturbedChain(chain, terms), _inverse(kept.covariance), noise_mm, state, mean)
    return replace(arm, chain=chain), prior


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a covariance or precision, in any units; eigenvalues that rounding made negative count as zero."""
    scale = np.sqrt(matrix.diagonal())
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    unit = (vectors / np.maximum(values, _ROUNDING * values[-1])) @ vectors.T
    return np.asarray((unit + unit.T) / 2 / np.outer(scale, scale))
