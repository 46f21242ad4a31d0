"""An interim check of a model: the test values of the points that it predicts, and what later checks compare with."""

from __future__ import annotations

import datetime

import numpy as np

from truearm.acceptance import accepted
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.training_conditions import fingerprint
from truearm.readings import Lengths, Session
from truearm.typing import FloatArray
from truearm.wings.laboratory.monitor.expected_values import PointErrors
from truearm.wings.laboratory.monitor.interim_check import (
    CheckReading,
    CheckValue,
    InterimCheck,
    artefacts_of,
    interim_deviations,
    interim_values,
)


def check_of_model(
    model: Compensator, readings: Session, lengths: Lengths | None, *, date: datetime.datetime, model_sha256: str
) -> InterimCheck:
    """The check of a model by readings in seats, in both seats of a bar or on a sphere.

    Parameters
    ----------
    model : Compensator
    readings : Session
    lengths : Lengths or None
        Known lengths between seats of the readings.
    date : datetime
    model_sha256 : str
        Of the model file.

    Raises
    ------
    InputError
        If there is nothing to check in the readings, or they do not fit together.
    """
    temperature = None if readings.temperature_degC is None else float(readings.temperature_degC.mean())
    points = model.predict_readings(readings)
    values = _values(model, points, readings, lengths, temperature)
    compared = readings_to_compare(model, points, readings)
    said = tuple(map(str, accepted()))
    return InterimCheck(date, model_sha256, fingerprint(readings), temperature, values, compared, accepted=said)


def readings_to_compare(model: Compensator, points: FloatArray, session: Session) -> tuple[CheckReading, ...]:
    """What a later check compares its readings with; a nanometre and a second of arc are enough."""
    poses = np.where(model.arm.chain.is_prismatic, session.angles / 1000, session.angles).round(5)
    deviation = interim_deviations(points, seat=session.seat, sphere=session.sphere).round(6)
    artefacts = artefacts_of(session.seat, session.sphere, len(session))
    return tuple(
        CheckReading(artefact, tuple(pose), tuple(away))
        for artefact, pose, away in zip(artefacts, poses.tolist(), deviation.tolist(), strict=True)
        if not np.isnan(away).any()
    )


def _values(
    model: Compensator, points: FloatArray, session: Session, lengths: Lengths | None, temperature_degC: float | None
) -> tuple[CheckValue, ...]:
    """The test values of the points that the model predicts."""
    # Unexplained by the model: the other part of its uncertainty is the same in every check.
    of_parameters, unexplained = model.covariance_parts(session)
    shared = model.shared_displacements(session)
    own = of_parameters - np.einsum("kni,knj->nij", shared, shared) + unexplained
    with InputError.of_file(session.file):
        return interim_values(
            points,
            std_mm=np.sqrt(np.trace(unexplained, axis1=1, axis2=2) / 3),
            # A difference of nothing may be below zero by rounding.
            errors=PointErrors(np.sqrt(np.maximum(np.trace(own, axis1=1, axis2=2) / 3, 0.0)), shared),
            seat=session.seat,
            sphere=session.sphere,
            lengths=lengths,
            temperature_degC=temperature_degC,
        )
