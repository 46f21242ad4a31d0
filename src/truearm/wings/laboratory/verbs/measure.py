"""`measure`: a length or a shape from measured joint angles, with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, get_args

import numpy as np

from truearm.acceptance import acceptance_remarks, accepts
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.readings import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import IntArray
from truearm.verbs.inputs import (
    MAX_NAMED,
    ModelLike,
    SessionLike,
    check_angles_fit,
    describe_outside,
    fit_findings,
    model_of_tip_of,
    payload_findings,
    to_model_and_session,
)
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed, number_of
from truearm.wings.laboratory import MeasuredKind
from truearm.wings.laboratory.tasks.measured_features import MeasuredFeature, MeasuredQuantity, measure_features
from truearm.wings.laboratory.tasks.sampled_arms import PosteriorDistribution
from truearm.wings.laboratory.tasks.task import check_draws

# Components of a normal are no lengths: one of 0.0001 is 0.1 mm over a metre.
_NORMAL_DECIMALS = 6


@one_blas_thread()
@accepts
def measure(
    model: ModelLike,
    session: SessionLike,
    feature: MeasuredKind = "sphere",
    *,
    tip_diameter_mm: float = 0.0,
    repeatability_mm: float | None = None,
    n_arms: int = 1000,
    seed: int = 0,
    accept: str | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> MeasuredFeatures:
    """Measure a feature of a part: fit it to the compensated points of readings.

    The uncertainty is that of the arm, by the Monte Carlo simulation of `task` at the measured poses and in their
    conditions, together with the scatter of the points about the fitted shape. A single point of an end scatters by the
    repeatability or, if none is stated, by what the model does not explain.

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted nominal, kinematic or physical model or its file.
    session : Session, DataFrame, str or Path
        Joint angles with the tip on the part. The column ``seat`` names what was touched: each name is a feature of its
        own, of lengths each is an end, the mean of its points. Without it all readings are of one feature.
    feature : {"length", "sphere", "plane", "circle", "cylinder", "cone"}
        What the points lie on. Of each two spheres or circles the distance of their centres is measured too, of each
        two planes, cylinders or cones distance and angle.
    tip_diameter_mm : float
        Diameter of the stylus tip, which enlarges a sphere and narrows a circle or cylinder (bore) [mm]; 0 for
        coordinates of what is touched.
    repeatability_mm : float, optional
        Measured standard deviation of a coordinate when a point is measured again in the same pose [mm]. Without it the
        uncertainty of means is overestimated.
    n_arms : int
        Number of arms to draw.
    seed : int
        Seed of all random numbers.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept (docs/imperfect-readings.md).
    progress : callable, optional
        Called with the number of arms done and a remark.

    Returns
    -------
    MeasuredFeatures

    Raises
    ------
    InputError
        If the readings are of another arm, of several sessions or tips, a feature has too few points or they do not
        determine it, the model is a network, or a number is out of bounds.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60, seed=1).session
    >>> model = ta.fit("ur10", session, model="kinematic").model
    >>> ends = ta.Session(session.angles[:2], seat=["A", "B"])
    >>> length = ta.measure(model, ends, "length", n_arms=100).features[0]
    >>> length.name, length.quantities[0].name
    ('A to B', 'length_mm')
    """
    if feature not in get_args(MeasuredKind):
        raise InputError(f"expected a feature out of {', '.join(get_args(MeasuredKind))}, got {feature!r}")
    if not (isfinite(tip_diameter_mm) and tip_diameter_mm >= 0):
        raise InputError(f"expected the diameter of the stylus tip, 0 mm or more, got {tip_diameter_mm}")
    check_draws(n_arms, seed)
    given, readings = to_model_and_session(model, session)
    fitted = model_of_tip_of(given, readings)
    of_angles, of_payload = check_angles_fit(readings, fitted.arm), payload_findings(fitted.training_, readings)
    remarks = [str(one) for one in (*of_angles, *of_payload, *fit_findings(fitted))]
    if inputs := fitted.inputs_outside_training(readings):
        remarks.append(f"{describe_outside(inputs, fitted.training_, readings)}; errors may be larger there.")
    groups, unnamed = _by_seat(readings)
    readings = _with_known_directions(_in_one_frame(readings))
    directed = readings.directions is not None
    errors = PosteriorDistribution(fitted, repeatability_mm, directions_given=directed, readings=readings)
    with InputError.of_file(readings.file):
        found = measure_features(
            errors,
            feature,
            fitted.predict_readings(readings),
            readings.angles,
            groups,
            errors.identified.condition_displacements(readings),
            tip_diameter_mm=tip_diameter_mm,
            n_arms=n_arms,
            seed=seed,
            progress=progress,
        )
    remarks = [*acceptance_remarks(accept), *remarks]
    if fitted.session_frames_:
        remarks.append(f"Coordinates are in the frame of session {next(iter(fitted.session_frames_))}.")
    return MeasuredFeatures(
        fitted, readings, tuple(found), tip_diameter_mm, repeatability_mm, n_arms, seed, (*unnamed, *remarks)
    )


def _with_known_directions(readings: Session) -> Session:
    """The readings without directions where one is 0, not known: no direction of that session is relied on."""
    known = readings.directions is not None and bool((readings.directions != 0).all())
    return readings if known else replace(readings, directions=None)


def _in_one_frame(readings: Session) -> Session:
    """The readings of one set-up, in the frame of the model: points of two set-ups have none in common."""
    if readings.session is None:
        return readings
    names = np.unique(readings.session)
    if len(names) > 1:
        raise readings.error(
            f"expected the readings of one session, got those of {len(names)}: {', '.join(names[:MAX_NAMED].tolist())}",
            column="session",
            hint="measure the readings of each alone: base and reference may have moved between them",
        )
    return replace(readings, session=None)


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredFeatures(TableRecord):
    """Features of a part with their uncertainties.

    Attributes
    ----------
    model : Compensator
    session : Session
    features : tuple of MeasuredFeature
        In the frame of the model's reference; in the order of the readings, then distances of centres.
    tip_diameter_mm : float
        Of the stylus tip [mm].
    repeatability_mm : float or None
        As it was stated [mm].
    n_arms, seed : int
        Arms that were drawn, and the seed.
    remarks : tuple of str
    """

    model: Compensator
    session: Session
    features: tuple[MeasuredFeature, ...]
    tip_diameter_mm: float
    repeatability_mm: float | None
    n_arms: int
    seed: int
    remarks: tuple[str, ...]

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        first = self.features[0]
        found = [] if first.kind == "plane" else [_sentence(first.quantities[0])]
        found += [] if first.form_mm is None else [f"form {format_fixed(first.form_mm)} mm"]
        called = _called(first)
        yield f"{called[0].upper()}{called[1:]}: {', '.join(found)}; {number_of(first.n_points)}."
        yield TextTable(
            ("feature", "quantity", "value", "u", "U (95 %)"),
            [row for feature in self.features for row in _rows(feature)],
            left_aligned=(0, 1),
        )
        yield f"errors of {self.n_arms} drawn arms at these poses, and the scatter of the points about the shape"
        if first.form_mm is not None:
            yield "Errors of the arm add to the form; form between the points is not seen."
        yield "Coordinates are those of the tip's centre. The temperature of the part is not taken into account."
        yield from self.remarks

    def columns(self) -> dict[str, list[Any]]:
        """A row for each quantity of each feature, in its ``unit``; u and U (95 %) are in the same."""
        return columns_of(
            {"kind": of.kind, "name": of.name, "n_points": of.n_points, "quantity": name, "unit": unit} | numbers
            for of in self.features
            for name, unit, numbers in _quantities(of)
        )

    def _json(self) -> object:
        named = self._named("features", "tip_diameter_mm", "repeatability_mm", "n_arms", "seed")
        return {**named, "model_trained_on": self.model.data_fingerprint_, "remarks": self.remarks}


def _quantities(feature: MeasuredFeature) -> Iterator[tuple[str, str, dict[str, float | None]]]:
    """Name, unit and numbers of the quantities of a feature, its form among them; a direction has no unit."""
    for of in feature.quantities:
        name, _, unit = of.name.rpartition("_")
        known = unit in ("mm", "deg")
        numbers: dict[str, float | None] = {"value": of.value, "u": of.u, "expanded_uncertainty": of.expanded}
        yield name if known else of.name, unit if known else "", numbers
    if feature.form_mm is not None:
        yield "form", "mm", {"value": feature.form_mm, "u": None, "expanded_uncertainty": None}


def _called(feature: MeasuredFeature) -> str:
    return f"{feature.kind} {feature.name}".strip()


def _sentence(of: MeasuredQuantity) -> str:
    name, unit = of.name.rsplit("_", 1)
    return f"{name} {format_fixed(of.value)} {unit}, U = {format_fixed(of.expanded)} {unit} (95 %)"


def _rows(feature: MeasuredFeature) -> Iterator[tuple[str, ...]]:
    for of in feature.quantities:
        yield _called(feature), of.name, *(_number(of.name, number) for number in (of.value, of.u, of.expanded))
    if feature.form_mm is not None:
        yield _called(feature), "form_mm", _number("form_mm", feature.form_mm), "", ""


def _number(quantity: str, number: float) -> str:
    return format_fixed(number, 4 if quantity.endswith(("_mm", "_deg")) else _NORMAL_DECIMALS)


def _by_seat(readings: Session) -> tuple[dict[str, IntArray], tuple[str, ...]]:
    """Rows of each feature by its name; readings without a name, where others have one, belong to none."""
    if readings.seat is None or not (readings.seat != "").any():
        return {"": np.arange(len(readings))}, ()
    names = dict.fromkeys(readings.seat.tolist())
    groups = {name: np.flatnonzero(readings.seat == name) for name in names if name}
    n = int((readings.seat == "").sum())
    return groups, (f"{number_of(n)} without a name in the column seat are not used.",) if n else ()
