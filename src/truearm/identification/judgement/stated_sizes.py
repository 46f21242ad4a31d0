"""Whether known lengths and distances can be of the nominal arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.judgement.outliers import constraint_residuals
from truearm.identification.references.distances import is_offset
from truearm.identification.references.reading_references import without_sizes
from truearm.identification.references.references import Reference
from truearm.identification.terms import ArmState
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session

# Share by which a stated length or distance may differ from that of the nominal arm. Real arms are within a hundredth
# of their nominal lengths; radii in place of distances, other units and other seats are not.
MAX_SIZE_ERROR = 0.05


def check_sizes(
    readings: Session,
    lengths: Lengths | None,
    references: Sequence[Reference],
    fit_nominal: Callable[[Sequence[Reference]], IdentificationResult],
    state: ArmState,
) -> None:
    """Check that known lengths and distances are about those of the nominal arm.

    Points show when an arm is described wrongly. Seats and surfaces agree with an arm of any size: a length in another
    unit would scale the arm, and nothing else would show it.

    Parameters
    ----------
    readings : Session
    lengths : Lengths, optional
    references : sequence of Reference
        Of both.
    fit_nominal : callable
        Returns the nominal arm with base and tip identified from references.
    state : ArmState
        Of the readings.

    Raises
    ------
    InputError
        If a length differs from that of the nominal arm, identified without lengths, by more than a share of
        `MAX_SIZE_ERROR` and three standard deviations.
    """
    bare = [without_sizes(reference) for reference in references]
    if all(one is reference for one, reference in zip(bare, references, strict=True)):
        return
    residuals = constraint_residuals(fit_nominal(bare), state, bare, references)
    assert residuals is not None  # some references state a length
    drawn, stated = residuals.values.T
    most = MAX_SIZE_ERROR * stated + 3 * np.sqrt(residuals.covariance.diagonal() + residuals.std**2)
    most[[is_offset(name) for name in residuals.names]] = np.inf  # no size of the arm
    excess = np.abs(residuals.residuals) / most
    worst = int(np.argmax(excess))
    if excess[worst] > 1:
        of_sphere = residuals.names[worst].startswith("distance")
        raise InputError(
            f"expected a {residuals.names[worst]} of about {drawn[worst]:.4g} mm, as the nominal arm has, "
            f"got {stated[worst]:.6g} mm",
            file=readings.file if of_sphere or lengths is None else lengths.file,
            column="sphere_distance_mm" if of_sphere else "length_mm",
            hint="check that it is (D + d) / 2 of sphere and ball, not a radius; its unit; the arm"
            if of_sphere
            else "check the unit of the length, the names of its two seats, the arm",
        )
