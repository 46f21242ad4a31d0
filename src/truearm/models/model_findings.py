"""What a person must know of a fitted model, and how well it explains the readings that it was fitted to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from truearm.findings import Finding, format_mm
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.judgement.gross_errors import excluded_readings
from truearm.identification.judgement.stated_uncertainty import rounded_angles
from truearm.identification.references.orientations import LEVER_MM
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.references.session_frames import points_to_session_frames
from truearm.models.compensator import Compensator
from truearm.models.identified_model import to_identified
from truearm.models.training_conditions import TrainingReadings
from truearm.readings.anchors import LEAST_COMPARED, distance_errors, has_located_anchor
from truearm.readings.point_errors import (
    LengthSummary,
    compare_errors,
    has_repeated_seat,
    length_errors,
    point_errors,
    seat_errors,
)
from truearm.readings.thermal_expansion import expanded_lengths

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


# With fewer readings the training error of a kinematic model says little: it determines some 27 constants.
FEW_READINGS = 50
# Scatter about the identified arm that is said: real arms under a tracker leave 0.05 to 0.3 mm of a coordinate.
SAID_SCATTER_MM, TRACKER_MM = 0.5, 0.05
# Scatter of orientations about an axis that is said: a marker of a laser tracker has 0.01.
SAID_SCATTER_DEG = 0.5


def model_findings(model: Compensator, arm_model: Compensator, readings: PreparedReadings) -> Iterator[Finding]:
    """What a person must know of a model that was fitted to readings, apart from what readings held out say.

    Parameters
    ----------
    model : Compensator
    arm_model : Compensator
        The model whose constants show how the readings scatter.
    readings : PreparedReadings
    """
    identified, arm = to_identified(model), model.identified_arm or model.nominal_
    yield from model.findings_
    yield from model.training_.still_joints(model.arm_.chain)
    yield from model.nominal_check_.findings()
    if (axis := model.nominal_check_.axis_scale) is not None:
        yield from axis.findings()
    # Without terms for them no model ignores them.
    yield from (one for one in readings.findings if identified is not None or one.what != "few readings on")
    if arm_model.arm.has_kinematics:
        yield from calculated_points(readings, arm_model.nominal_, arm_model.identified_arm or arm_model.nominal_)
    yield from _scatter(arm_model, readings)
    if model.identified_arm is not None:
        yield from rounded_angles(readings, model.identified_arm)
    if not arm.converged and model.arm.has_kinematics:
        said = "The fit has not converged: more readings, or poses that differ more from each other, may help."
        yield Finding("convergence", said)
    if model.kind not in ("nominal", "network") and (n := len(readings)) < FEW_READINGS:
        said = f"Only {n} readings: the training error says little. Use some {FEW_READINGS} or more."
        yield Finding("few readings", said, {"n": n})


def _scatter(model: Compensator, readings: PreparedReadings) -> Iterator[Finding]:
    """By how much readings scatter about the identified arm, where that is much and their uncertainty is not stated."""
    if (identified := model.identified_arm) is None:
        return
    of = identified.references[0]
    scatter = of.noise_std * float(np.sqrt(len(of.residuals)))
    if not model.identifies_constants:  # whose residuals are not noise; the check knows it where they are unusual
        scatter = model.nominal_check_.left.noise_mm
    if of.kind in ("point", "distance") and scatter >= SAID_SCATTER_MM and not readings.references[0].std.any():
        said = (
            f"These readings scatter by {format_mm(scatter)} about the identified arm; with a laser tracker it is "
            f"{TRACKER_MM:g} mm. The uncertainties contain it, and more readings average it."
        )
        yield Finding("scatter", said, {"scatter_mm": scatter})
    for part in identified.references:
        if part.kind == "orientation" and (turn := np.degrees(part.noise_std / LEVER_MM)) >= SAID_SCATTER_DEG:
            said = f"The orientations scatter by {turn:.2g} deg about each axis; they count by that beside the points."
            yield Finding("orientation scatter", said, {"scatter_deg": float(turn)})


def training_errors(model: Compensator, readings: TrainingReadings) -> Mapping[str, Any] | None:
    """Errors of the readings that took part, and of known lengths between their seats."""
    state, measured = model.state_in_training(readings), readings.measured
    if model.identified_arm is not None and len(excluded := excluded_readings(model.identified_arm)):
        kept = np.setdiff1d(np.arange(len(measured)), excluded)
        state, measured = state.rows(kept), measured.rows(kept)
    predicted = points_to_session_frames(model._tips(state), measured.session, model.session_frames_)
    if not model.arm.has_kinematics:
        assert measured.points is not None  # of a network
        return point_errors(predicted, measured.points)
    nominal = points_to_session_frames(model.nominal_.tips(state), measured.session, model.session_frames_)
    of_lengths: dict[str, LengthSummary] = {}
    known = None if readings.lengths is None or measured.seat is None else readings.lengths.within(measured.seat)
    if (there := expanded_lengths(known, measured)) is not None:
        assert measured.seat is not None
        own, drawn = (length_errors(points, measured.seat, there) for points in (predicted, nominal))
        of_lengths["lengths"] = LengthSummary.of(own, drawn, there.u_mm)
    if measured.points is not None:
        return {**compare_errors(predicted, nominal, measured.points), **of_lengths}
    if has_repeated_seat(measured):
        assert measured.seat is not None
        of_seats = seat_errors(predicted, measured.seat).items()
        return {name: value for name, value in of_seats if name != "seats"} | of_lengths
    if has_located_anchor(measured, LEAST_COMPARED):
        return dict(list(distance_errors(predicted, measured).items())[:4])
    return None
