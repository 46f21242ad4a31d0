"""Points that were calculated from the angles, not measured: they agree with an arm to their own rounding."""

from __future__ import annotations

import numpy as np

from truearm.findings import Finding
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.references.prepared_readings import PreparedReadings

# Root mean square of a coordinate that rounding to 0.01 mm leaves, as most pendants show it, with a quarter to spare
# [mm]. No arm is as near to its drawing: one that its maker compensated has 0.015.
OF_DRAWING = 1.25 * 0.01 / np.sqrt(12)
# No instrument repeats to that [mm], and so no measured point agrees with any arm.
OF_ANY_ARM = 1e-3


def calculated_points(
    readings: PreparedReadings, nominal: IdentificationResult, identified: IdentificationResult
) -> tuple[Finding, ...]:
    """That points agree with an arm as no measured ones do; nothing where they do not.

    Parameters
    ----------
    readings : PreparedReadings
    nominal, identified : IdentificationResult
        The nominal arm, and the one with its constants: controllers know those of their own arm.
    """
    if readings.points is None or nominal.references[0].kind != "point":
        return ()
    for name, fit, most in (("nominal", nominal, OF_DRAWING), ("identified", identified, OF_ANY_ARM)):
        residuals, freedom = fit.references[0].residuals, fit.residual_freedom(readings.references)
        if freedom >= residuals.size / 2 and (rms := float(np.sqrt((residuals**2).sum() / freedom))) <= most:
            said = (
                f"The points agree with the {name} arm to {rms:.1g} mm, their own rounding: they are calculated from "
                "the angles, as controllers do, not measured. What is fitted to them says nothing of the arm: name the "
                "columns of the instrument."
            )
            return (Finding("calculated points", said, {"rms_mm": rms}),)
    return ()
