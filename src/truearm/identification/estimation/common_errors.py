"""Errors that measured poses share, as an arm that was identified from them shows them; and how large its own are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.arm.arm import Arm
from truearm.identification.estimation.identification import identify, initial_problem
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import eliminate_unknowns
from truearm.identification.estimation.propagation import with_shared_error
from truearm.identification.estimation.residual_variance import paule_mandel_variance
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.references.reading_references import Referenced
from truearm.identification.references.session_frames import in_one_frame, session_frame_terms
from truearm.identification.references.tips import further_tip_terms, tip_names
from truearm.identification.terms import constants
from truearm.identification.terms.catalogue import relative_size
from truearm.identification.terms.links import link_vectors
from truearm.readings.session import Session
from truearm.typing import FloatArray

# Position errors of arms over rotation errors of their flanges [mm/rad].
LEVERS_MM = (100.0, 2000.0)
# Standard deviation of the lengths of nominal arms of usual reach about the true ones [mm].
LENGTH_STD_MM = 0.3


def settled_pose_errors(
    readings: Session, arm: Arm, free: tuple[str, ...], lever_mm: float
) -> tuple[FloatArray, float, float]:
    """What an arm with other constants shows of the poses of readings.

    Which terms the arm has is decided later; this settles where derivatives are taken, and how much of an error of the
    orientation belongs to that of the position.

    Returns
    -------
    common : (a,) array
        The common errors.
    lever_mm, arm_std_mm : float
        Position error of the arm over the rotation error of its flange [mm/rad], and a coordinate of the former [mm].
    """
    in_frame, frames = in_one_frame(arm, readings, free)
    session, references, state, chain, tool, _ = Referenced.of(arm, in_frame, None, free)
    mounts = [*session_frame_terms(chain, frames), *further_tip_terms(chain, tip_names(session))]
    found = identify(chain, state, [*constants(chain, free=free), *tool, *mounts], references, robust=True)
    part = next(part for part in found.references if part.kind == "pose")
    effective = sum(group.effective for group in found.groups) / 2
    of_position, of_rotation = (
        paule_mandel_variance(part.residuals[some].T, part.std[some].T ** 2, n_effective=effective, robust=True)
        for some in (slice(0, 3), slice(3, 6))
    )
    lever = float(np.clip(lever_mm * np.sqrt(of_position / of_rotation), *LEVERS_MM))
    return np.array(list(part.unknowns.values())), lever, float(np.sqrt(of_position))


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """The common errors by an identified arm.

    Attributes
    ----------
    values : (a,) array
    covariance : (a, a) array
    with_arm : (a, n) array
        Their covariance with the arm's coefficients.
    """

    values: FloatArray
    covariance: FloatArray
    with_arm: FloatArray

    @classmethod
    def of(cls, fit: IdentificationResult, readings: PreparedReadings) -> Self:
        """Those of the poses of an identification, at its minimum."""
        problem, _ = initial_problem(fit.perturbed_chain, readings.state, readings.references)
        own = problem.unknowns_of([one.kind for one in problem.references].index("pose"))
        x, n = fit.parameters, len(fit.coefficients)
        reduced = eliminate_unknowns(*problem.equations(x, [part.weights for part in fit.references]), x)
        place = np.searchsorted(reduced.eliminated, np.arange(own.start, own.stop))
        slope = reduced.slope[place, :n]
        with_arm = -slope @ fit.covariance
        of_data = (reduced.root.T @ reduced.root).toarray()[np.ix_(place, place)]
        return cls(x[own], of_data - with_arm @ slope.T, with_arm)

    def with_usual_size(
        self, fit: IdentificationResult, *, unit: float, precision: FloatArray
    ) -> tuple[Self, IdentificationResult]:
        """These and the arm where the sizes of the references, the last errors, are no more certain than they can be.

        That is by what is stated of each, the `precision` in their `unit`, and by the lengths of usual arms, which
        differ from nominal ones independently. A larger arm makes all of them larger. What depends on it is as much
        less certain.
        """
        chain = fit.perturbed_chain.chain
        size = np.zeros(len(self.values))
        size[-len(precision) :] = precision / precision.sum()
        with_size = self.covariance @ size
        own = size @ with_size
        lengths_mm = float(np.linalg.norm(link_vectors(chain)[1:-1]))  # between the joints
        of_lengths = LENGTH_STD_MM * relative_size(chain) / lengths_mm / unit
        missing = 1 / (of_lengths**-2 + precision.sum()) - own
        if missing <= 0:
            return self, fit
        along, of_arm = (part / own * np.sqrt(missing) for part in (with_size, size @ self.with_arm))
        more = np.outer(along, along), np.outer(along, of_arm)
        found = type(self)(self.values, self.covariance + more[0], self.with_arm + more[1])
        return found, with_shared_error(fit, of_arm)
