"""Models of one arm compared on a session: what pages that show several models have in common."""

from __future__ import annotations

from typing import Any

import numpy as np

from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.training_conditions import fingerprint
from truearm.pages.drawings.arm_scene import arm_at_readings
from truearm.pages.drawings.page_record import version_row
from truearm.readings import Lengths, Session, check_sessions, compare_errors, length_errors, point_errors
from truearm.typing import FloatArray
from truearm.verbs.evaluate import Regressors, predict_points, regressor_remark
from truearm.wings.reports.comparison_page import ModelComparison
from truearm.wings.reports.seat_page import SeatComparison


def compare_models(models: dict[str, Compensator], readings: Session, regressors: Regressors) -> ModelComparison:
    """Predictions and errors of models and regressors on the readings, and of the nominal arm of the first model."""
    points = readings.points
    assert points is not None  # checked by the caller
    first = one_arm(models)
    predicted = _predicted(models, readings, regressors)
    errors: dict[str, Any] = {name: point_errors(one, points) for name, one in predicted.items()}
    if first.arm.has_kinematics:
        # A regressor has no nominal arm of its own: its reduction is that of the first model's.
        nominal = {name: models.get(name, first).predict_nominal_readings(readings) for name in predicted}
        errors = {name: compare_errors(one, nominal[name], points) for name, one in predicted.items()}
    return ModelComparison(
        angles=readings.angles,
        points=points,
        predicted=predicted,
        errors={name: dict(e) for name, e in errors.items()},
        reading_names=[readings.called(row) for row in range(len(readings))],
        mechanism=arm_at_readings(models, readings),
        **joint_facts(first),
    )


def _predicted(models: dict[str, Compensator], readings: Session, regressors: Regressors) -> dict[str, FloatArray]:
    """Points [mm] of the nominal arm of the first model if it has one, of the models and of the regressors, by name."""
    first, predicted = one_arm(models), {}
    if first.arm.has_kinematics:
        predicted["nominal"] = first.predict_nominal_readings(readings)
    others = {name: model for name, model in models.items() if model.kind != "nominal"}
    if "nominal" in {*others, *regressors}:
        raise InputError("'nominal' is the name of the nominal arm on the page", hint="another name for the model")
    predicted |= {name: model.predict_readings(readings) for name, model in others.items()}
    return predicted | {name: predict_points(one, readings, name=name) for name, one in regressors.items()}


def compare_in_seats(
    models: dict[str, Compensator], readings: Session, regressors: Regressors, lengths: Lengths | None
) -> SeatComparison:
    """Predictions of models and regressors in seats with two readings or more, and errors of lengths between seats.

    Raises
    ------
    InputError
        If there is no such seat, or a seat is in two sessions.
    """
    assert readings.seat is not None  # checked by the caller
    check_sessions(readings, lengths)
    first = one_arm(models)
    predicted = _predicted(models, readings, regressors)
    _, index, counts = np.unique(readings.seat, return_inverse=True, return_counts=True)
    several = (counts > 1)[index] & (readings.seat != "")
    if not several.any():
        raise readings.error("expected a seat with two or more readings, there is none", column="seat")
    errors = {}
    rows: list[tuple[str, str, float, float]] = []
    if lengths is not None:
        errors = {name: length_errors(points, readings.seat, lengths) for name, points in predicted.items()}
        columns = (getattr(lengths, name).tolist() for name in ("seat_a", "seat_b", "length_mm", "u_mm"))
        rows = list(zip(*columns, strict=True))
    return SeatComparison(
        angles=readings.angles[several],
        seat=readings.seat[several],
        predicted={name: points[several] for name, points in predicted.items()},
        lengths=rows,
        length_errors=errors,
        reading_names=[
            f"{readings.called(row)}, seat {readings.seat[row]}" for row in np.flatnonzero(several).tolist()
        ],
        mechanism=arm_at_readings(models, readings),
        **joint_facts(first),
    )


def joint_facts(model: Compensator) -> dict[str, Any]:
    """Names, limits and kinds of the joints, as records of comparisons have them."""
    lower, upper = model.arm.limits.T
    return {
        "joint_names": model.arm.joint_names,
        "lower": lower,
        "upper": upper,
        "sliding": model.arm.chain.is_prismatic.tolist(),
    }


def one_arm(models: dict[str, Compensator]) -> Compensator:
    """The first of the models, which must all be of one arm with the same free parts."""
    first = next(iter(models.values()))
    arm = first.arm
    for name, model in models.items():
        if model.arm.name != arm.name or not np.array_equal(model.arm.chain.fixed, arm.chain.fixed):
            raise InputError(
                f"expected models of one arm, but {name!r} is of {model.arm.name!r}, not the first one's arm"
            )
        if tuple(model.free) != tuple(first.free):
            raise InputError(
                f"expected models with the same --free, but {name!r} has {list(model.free)}, "
                f"the first {list(first.free)}",
                hint="a report for each",
            )
    return first


def page_facts(models: dict[str, Compensator], readings: Session, regressors: Regressors) -> list[tuple[str, str]]:
    """Facts at the end of a page: training data of the models, the readings of the page, arm and versions."""
    rows = [
        (f"model {name}", f"{model.n_train_} training readings, fingerprint {model.data_fingerprint_}")
        for name, model in models.items()
    ]
    rows += [(f"regressor {name}", regressor_remark(one)) for name, one in regressors.items()]
    rows.append(("readings of this page", f"fingerprint {fingerprint(readings)}"))
    rows += [
        (f"lengths of model {name}", f"fingerprint {model.lengths_fingerprint_}")
        for name, model in models.items()
        if model.lengths_fingerprint_
    ]
    rows.append(("fingerprint", "SHA-256 of all columns but notes, numbers in rad and mm as little-endian doubles"))
    arm = next(iter(models.values())).arm
    rows.append(("arm", f"{arm.name}: {arm.title}. {arm.source}"))
    rows.append(version_row())
    return rows
