"""Evaluate: errors of a model on readings it was not fitted to.

Beside truearm's models it evaluates regressors of the user's own: any object with `predict`, of scikit-learn or not.
In Python only: a file of such an object would be a pickle, which can run any code, and truearm opens none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeGuard

import numpy as np

from truearm.acceptance import acceptance_remarks, accepts
from truearm.choices import Conditions
from truearm.errors import InputError
from truearm.findings import Finding, findings_of, format_mm
from truearm.identification.judgement.outliers import Outlier
from truearm.models import Compensator
from truearm.models.uncertainty import (
    UncertaintyBudget,
    orientation_errors,
    uncertainty_budget,
    what_limits,
    why_most_are_outliers,
)
from truearm.readings import (
    Lengths,
    LengthSummary,
    Session,
    check_sessions,
    compare_errors,
    expanded_lengths,
    has_repeated_seat,
    length_errors,
    point_errors,
    seat_errors,
)
from truearm.readings.anchors import LEAST_COMPARED, distance_errors, has_located_anchor
from truearm.readings.files import is_large
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.inputs import (
    LengthsLike,
    Limits,
    ModelLike,
    SessionLike,
    evaluation_findings,
    to_model,
    to_model_and_session,
    to_session,
    used_readings,
)
from truearm.verbs.record import (
    SAME_DAY,
    TableRecord,
    TextTable,
    columns_of,
    compare_with_nominal,
    format_fixed,
    listed,
    number_of,
    with_lengths,
)

if TYPE_CHECKING:
    from truearm.solve.executors import Executor
    from truearm.verbs.evaluation_sums import CoverageSums, EvaluationSums


# The mean error of fewer readings depends on which they are: of one it is that of its pose.
FEW = 10
FEW_SAID = "So few readings show nothing of the arm's other poses: evaluate on 10 or more, all over its reach."


class RegressorLike(Protocol):
    """A fitted object that predicts points [mm] of shape (n, 3) from joint angles [rad; mm] of shape (n, n_joints)."""

    def predict(self, X: Any, /) -> Any:
        """Points of the tip in the frame of the reference points it was fitted to."""


AnyModelLike: TypeAlias = "ModelLike | RegressorLike"
Regressors: TypeAlias = Mapping[str, RegressorLike]  # by their names


def is_regressor(model: object) -> TypeGuard[RegressorLike]:
    """Whether it is an object with `predict` and no model of truearm."""
    return callable(getattr(model, "predict", None)) and not isinstance(model, Compensator | type)


def predict_points(regressor: RegressorLike, readings: Session, *, name: str | None = None) -> FloatArray:
    """(n, 3) points of a regressor at the readings of a session [mm].

    It predicts from the joint angles. One that was fitted to a DataFrame predicts from the columns of
    `Session.to_frame` with the same names, which state their units.

    Raises
    ------
    InputError
        If it is not fitted, was fitted to other columns, or does not return a finite point for every reading.
    """
    name = name or type(regressor).__name__
    hint = f"fit {name} to the angles and points of a session: fit(train.angles, train.points)"
    X: Any = readings.angles.copy()  # its own, which it may change
    if (columns := getattr(regressor, "feature_names_in_", None)) is not None:
        X = readings.to_frame()
        if lacking := [str(column) for column in columns if column not in X]:
            raise readings.error(f"the session lacks a column {name} was fitted to", column=lacking[0], hint=hint)
        X = X[list(columns)]
    try:
        points = np.array(regressor.predict(X), dtype=float)
    except InputError:  # of a model of truearm inside it
        raise
    except (TypeError, ValueError) as error:  # such as scikit-learn's NotFittedError, or another number of joints
        reason = str(error).partition("\n")[0].rstrip(".")
        raise readings.error(f"{name} cannot predict these readings: {reason}", hint=hint) from error
    if points.shape != (len(readings), 3):
        n = len(readings)
        raise readings.error(f"expected x y z in mm from {name}, shape ({n}, 3), got {points.shape}", hint=hint)
    if not (finite := np.isfinite(points).all(axis=1)).all():
        raise readings.error(f"expected a finite point from {name}, got {points[~finite][0]}", int(finite.argmin()))
    return points


def regressor_remark(regressor: RegressorLike) -> str:
    """What a reader must know before the errors of a regressor are believed."""
    kind = type(regressor)
    return (
        f"This regressor of the user's own ({kind.__module__}.{kind.__qualname__}) states no uncertainty. truearm does "
        "not know its training readings: these readings may be among them, or outside their range."
    )


@one_blas_thread()
@accepts
def evaluate(
    model: AnyModelLike,
    session: SessionLike,
    *,
    lengths: LengthsLike | None = None,
    limits: Limits = "skip",
    conditions: Conditions | None = None,
    accept: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> Evaluation:
    """Test a model on readings it was not fitted to, beside the nominal arm.

    The nominal arm has its base and tip (where they were free) fitted to the model's training readings. Readings with a
    reference point are compared with it, readings in a seat with the mean of the points predicted there, and the
    distance between two such means with the known length. Distances to an anchor are compared with those of the
    predicted points from the place that fits them best. Readings that the model was fitted or refitted to are
    skipped, unless there are no others. Readings that repeat a pose count as one, their mean
    (`truearm.readings.repeats`), as in `fit`. Seats, lengths, distances and repeats compare readings of different parts
    with each other: of a session in parts (docs/large-sessions.md) only reference points are evaluated.

    A regressor of the user's own, of scikit-learn or any object with `predict`, fitted by ``regressor.fit(train.angles,
    train.points)``, is compared with the same references. It has no nominal arm, joint limits or stated uncertainty;
    `report` compares it with truearm's models.

    Parameters
    ----------
    model : Compensator, str, Path or regressor
        A fitted model or its file, or a fitted object whose ``predict(angles)`` returns (n, 3) points [mm].
    session : Session, DataFrame, str or Path
        Readings with reference points, seats or distances to anchors. A folder of files, or a file beyond 512 MiB, is
        read part by part.
    lengths : Lengths, str or Path, optional
        Known lengths between seats of the session.
    limits : {"skip", "ignore"}
        Skip the readings beyond a joint limit, or use them.
    conditions : {"reproducibility", "repeatability"}, optional
        Of these readings: the day and the set-up of the training readings (repeatability), or any other. By default
        repeatability where they name sessions of the training, and reproducibility where they name others.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept (docs/imperfect-readings.md).
    executor : Executor, optional
        Who computes the parts; this process by default. The figures do not depend on it.
    progress : callable, optional
        Called with the number of readings of the parts that are done, and a note.

    Returns
    -------
    Evaluation

    Raises
    ------
    InputError
        If the session is of another arm, in another unit, or has neither reference points nor seats nor distances; if
        a regressor is not fitted or does not return a finite point for every reading.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60, seed=1).session
    >>> train, test = session.split(by="row", hold_out=0.3, seed=1)
    >>> evaluation = ta.evaluate(ta.fit("ur10", train, model="kinematic").model, test)
    >>> evaluation.errors["model"]["mean_mm"] < evaluation.errors["nominal"]["mean_mm"]
    True
    """
    if is_regressor(model):
        if is_large(session):
            got = "a folder" if Path(session).is_dir() else "a file that is read in parts"
            hint = "join the readings, or fewer of them, in one file"
            raise InputError(f"a regressor is evaluated on one file, got {got}", file=session, hint=hint)
        return _evaluate_regressor(model, to_session(session), lengths, accept)
    if not is_large(session):
        return _evaluate_session(*to_model_and_session(model, session), lengths, limits, conditions, accept)
    from truearm.readings.large_sessions import LargeSession  # no small session waits for these
    from truearm.verbs.evaluation_sums import sums_over_parts

    if lengths is not None:
        hint = "omit them; a file of the readings in seats alone is evaluated as a small session"
        raise InputError("lengths are not compared in a session in parts", file=session, hint=hint)
    known = to_model(model)
    n_joints = known.arm.n_joints
    large = LargeSession.open(session, n_joints=n_joints, executor=executor, progress=progress)
    sums = sums_over_parts(known, large, limits, conditions, accept)
    return Evaluation(
        model=known,
        session=None,
        predicted={},
        errors=sums.errors(),
        lengths=None,
        conditions=sums.conditions,
        outliers=sums.applies.outliers,
        n_training=sums.n_training,
        findings=sums.findings,
        n_parts=len(large.parts),
        sums=sums,
    )


def _evaluate_session(
    fitted: Compensator,
    given: Session,
    lengths: LengthsLike | None,
    limits: Limits,
    conditions: Conditions | None,
    accept: str | None,
) -> Evaluation:
    tested = used_readings(given, fitted.arm, fitted, limits=limits, lengths=lengths)
    used, known = tested.session, expanded_lengths(tested.lengths, tested.session)
    check_sessions(used, known, own_frame="base" not in fitted.free)
    at = fitted.at(used)
    predicted = {"model": fitted.predict_readings(at)}
    if fitted.kind != "nominal" and fitted.arm_.has_kinematics:
        predicted = {"nominal": fitted.predict_nominal_readings(at)} | predicted
    nominal = predicted.get("nominal", predicted["model"]) if fitted.arm_.has_kinematics else None
    errors = {name: _errors(one, nominal, used, known) for name, one in predicted.items()}
    turned = orientation_errors(at)
    if turned is not None:
        errors = {name: of | turned.statistics()[name] for name, of in errors.items()}
    conditions = conditions or fitted.training_.conditions_of(used)
    budget: UncertaintyBudget | None = None
    same_day: UncertaintyBudget | None = None
    outliers: tuple[Outlier, ...] = ()
    if used.points is not None:
        budget, far = uncertainty_budget(fitted, at)
        if (on_the_day := fitted.under("repeatability")) is not fitted:
            same_day, far_that_day = uncertainty_budget(on_the_day, at._replace(model=on_the_day))
            far = far_that_day if conditions == "repeatability" else far
        outliers = tuple(outlier.located(given, tested.rows) for outlier in far)
    found = (*tested.findings, *evaluation_findings(at, nominal))
    if budget is not None and not any(one.what == "nominal error" for one in found):  # of another unit or set-up
        found += tuple(why_most_are_outliers(budget, used, predicted["model"], len(outliers)))
    return Evaluation(
        model=fitted,
        session=used,
        predicted=predicted,
        errors=errors,
        lengths=known,
        budget=budget,
        repeatability_budget=same_day,
        conditions=conditions,
        outliers=outliers,
        orientation_coverage=None if turned is None else turned.coverage,
        n_training=tested.n_training,
        findings=(
            *findings_of("acceptance", acceptance_remarks(accept)),
            *([] if budget is None else what_limits(budget, used, errors["model"]["mean_mm"], fitted)),
            *found,
        ),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(TableRecord):
    """Errors of a model and of the nominal arm on the readings of a session.

    Attributes
    ----------
    model : Compensator or regressor
    session : Session or None
        The readings that were used, those that repeat each other merged into their mean; None of a session in parts.
    predicted : dict of str to (n, 3) array
        Points of ``"nominal"`` and ``"model"`` [mm]; of a regressor those of ``"model"`` alone; of a session in parts
        none.
    errors : dict of str to dict
        For each: ``mean_mm``, ``rms_mm``, ``p95_mm``, ``max_mm``, ``mean_abs_coordinate_mm`` and
        ``max_abs_coordinate_mm`` against reference points; ``seat_mean_mm`` and others in seats; ``lengths``;
        ``orientation_mean_deg`` and others of orientations; ``distance_mean_mm`` and others of distances, with
        ``anchors`` and ``distances`` one by one. The 95 % quantile of a session in parts is known to 0.1 %.
    lengths : Lengths or None
        Known lengths at the temperature of the readings.
    budget : UncertaintyBudget or None
        Uncertainty under reproducibility conditions, and its coverage; None without points, of a regressor, and of a
        session in parts.
    repeatability_budget : UncertaintyBudget or None
        The same under repeatability conditions; None where that makes no difference.
    conditions : {"reproducibility", "repeatability"} or None
        Those of these readings; None where neither a person nor the names of their sessions say it.
    outliers : tuple of Outlier
        Readings farther from their reference point than eight stated standard uncertainties; of a session in parts
        the largest 20.
    orientation_coverage : float or None
        Share of the orientations in their stated 95 % regions; None without any.
    n_training : int
        Readings that were skipped because the model was fitted or refitted to them.
    findings : tuple of Finding
    n_parts : int
        In which the session was read.
    sums : EvaluationSums or None
        Figures of a session in parts.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> model = ta.fit("ur10", session, model="nominal").model
    >>> ta.evaluate(model, session).to_dict()["n"]
    40
    """

    model: Compensator | RegressorLike
    session: Session | None
    predicted: Mapping[str, FloatArray]
    errors: Mapping[str, Mapping[str, Any]]
    lengths: Lengths | None
    budget: UncertaintyBudget | None = None
    repeatability_budget: UncertaintyBudget | None = None
    conditions: Conditions | None = None
    outliers: tuple[Outlier, ...] = ()
    orientation_coverage: float | None = None
    n_training: int = 0
    findings: tuple[Finding, ...] = ()
    n_parts: int = 1
    sums: EvaluationSums | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """The findings in words."""
        return tuple(map(str, self.findings))

    @property
    def coverage(self) -> float | None:
        """Share of the reference points inside the 95 % ellipsoid that the model states for any day."""
        of = self._any_day
        return None if of is None or not of.n_points else of.coverage

    @property
    def coverage_99(self) -> float | None:
        """Share of them inside that of 99 %."""
        of = self._any_day
        return None if of is None or not of.n_points else of.n_covered_99 / of.n_points

    @property
    def repeatability_coverage(self) -> float | None:
        """The `coverage` under repeatability conditions; None where these make no difference."""
        return None if self._same_day is None else self._same_day.coverage

    @property
    def _any_day(self) -> UncertaintyBudget | CoverageSums | None:
        return self.budget if self.sums is None else self.sums.stated["reproducibility"]

    @property
    def _same_day(self) -> UncertaintyBudget | CoverageSums | None:
        return self.repeatability_budget if self.sums is None else self.sums.stated.get("repeatability")

    def summary(self) -> str:
        """The answer in one sentence: the mean error, and how it compares with the nominal arm."""
        own, nominal, lengths = self.errors["model"], self.errors.get("nominal"), self.length_summary
        for key, of, n in (
            ("mean_mm", "Mean error", "n"),
            ("seat_mean_mm", "Mean distance from the mean of the seat", "n_in_seats"),
            ("distance_mean_mm", "Mean error of a distance", "n_distances"),
        ):
            if key in own:
                compared = "" if nominal is None else compare_with_nominal(own[key], nominal[key])
                said = with_lengths(f"{of} {format_mm(own[key])} on {number_of(own[n])}", compared, lengths) + "."
                return f"{said} {FEW_SAID}" if own[n] < FEW else said
        assert lengths is not None  # nothing else is known of these readings
        compared = compare_with_nominal(lengths.largest_mm, lengths.nominal_mm)
        return f"Largest error of {number_of(lengths.n, 'length')} {format_mm(lengths.largest_mm)}{compared}."

    @property
    def length_summary(self) -> LengthSummary | None:
        """How well the model measures known lengths, beside the nominal arm; None without any."""
        if self.lengths is None or "lengths" not in self.errors["model"]:
            return None  # without seats they say nothing
        errors = {name: [one["length_error_mm"] for one in of["lengths"]] for name, of in self.errors.items()}
        return LengthSummary.of(errors["model"], errors.get("nominal"), self.lengths.u_mm)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        own = self.errors["model"]
        if self.sums is not None:
            yield self.sums.effective_number()
        if "mean_mm" in own:
            names = [name for name in own if name.endswith("_mm") and not name.startswith(("seat_", "distance_"))]
            yield self._table(number_of(own["n"]), names)
            if "nominal" in self.errors:
                yield _removed(own["removed_percent"])
            if self.coverage is not None:
                yield f"{100 * self.coverage:.1f} % of the points are inside their stated 95 % ellipsoid"
            if self.coverage_99 is not None:
                yield f"{100 * self.coverage_99:.1f} % of the points are inside their stated 99 % ellipsoid"
            if self._any_day is not None and self._same_day is not None:
                yield self._on_the_day(self._any_day, self._same_day)
        if self.orientation_coverage is not None:
            names = [name for name in own if name.startswith("orientation_")]
            yield self._table(f"{own['n_orientations']} orientations", names)
            yield f"{100 * self.orientation_coverage:.1f} % of the orientations are inside their stated 95 % regions"
        if "seats" in own:
            heading = f"{own['n_in_seats']} readings in {len(own['seats'])} seats"
            yield self._table(heading, [name for name in own if name.startswith("seat_")])
        if "distance_mean_mm" in own:
            heading = f"{own['n_distances']} distances to {len(own['anchors'])} anchors"
            yield self._table(heading, [name for name in own if name.startswith("distance_")])
        if "lengths" in own:
            yield self._lengths_table()
        n_outliers = len(self.outliers) if self.sums is None else self.sums.applies.n_outliers
        yield from listed("outlier", self.outliers, "readings", n_outliers)
        if self.sums is not None:
            yield from self.sums.skipped_and_outliers()
        yield from self.remarks

    def columns(self) -> dict[str, list[Any]]:
        """A row for the nominal arm, where it is compared, and one for the model: their errors."""
        return columns_of({"arm": name} | dict(one) for name, one in self.errors.items())

    def _json(self) -> object:
        """The model's errors by their names, and those of the nominal arm under ``nominal``."""
        errors = {**self.errors["model"], "nominal": self.errors.get("nominal")}
        names = ["coverage", "coverage_99", "repeatability_coverage", "conditions", "n_training", "outliers", "remarks"]
        names += [] if self.orientation_coverage is None else ["orientation_coverage"]
        others = self._named(*names)
        of_parts = {} if self.sums is None else {"n_parts": self.n_parts, **self.sums.to_json()}
        return {"summary": self.summary(), **errors, **others, **of_parts}

    def _errors_mm(self) -> Mapping[str, FloatArray]:
        if self.session is None or (points := self.session.points) is None:
            return {}
        there = self.session.has_point
        return {name: np.linalg.norm((at - points)[there], axis=1) for name, at in self.predicted.items()}

    def _on_the_day(self, any_day: UncertaintyBudget | CoverageSums, same_day: UncertaintyBudget | CoverageSums) -> str:
        """The coverage under repeatability conditions, and which conditions apply."""
        applies = {
            "repeatability": "These conditions apply to the readings.",
            "reproducibility": "The readings are of another day or set-up: that of any day applies.",
            None: "Which applies is not known: name the sessions, or give --conditions.",
        }
        u, wider = (format_mm(one.combined_mm) for one in (same_day, any_day))
        return (
            f"{100 * same_day.coverage:.1f} % are inside the 95 % ellipsoid of repeatability conditions, {SAME_DAY}: "
            f"u {u}, of any day {wider}. {applies[self.conditions]}"
        )

    def _table(self, heading: str, keys: list[str]) -> TextTable:
        rows = [(key, *(format_fixed(errors[key]) for errors in self.errors.values())) for key in keys]
        names = ["nominal"] if getattr(self.model, "kind", "") == "nominal" else list(self.errors)
        return TextTable((heading, *names), rows)

    def _lengths_table(self) -> TextTable:
        own = self.errors["model"]["lengths"]
        rows = [
            (
                f"{one['seat_a']} to {one['seat_b']}",
                format_fixed(one["length_mm"]),
                format_fixed(one["u_mm"]),
                *(format_fixed(of["lengths"][i]["length_error_mm"], sign=True) for of in self.errors.values()),
            )
            for i, one in enumerate(own)
        ]
        return TextTable((f"length_error_mm of {len(own)} lengths", "length_mm", "u_mm", *self.errors), rows)


def _evaluate_regressor(
    regressor: RegressorLike, session: Session, lengths: LengthsLike | None, accept: str | None
) -> Evaluation:
    """Errors of a regressor of the user's own: without an arm there are no limits, nominal points or uncertainty."""
    tested = used_readings(session, None, lengths=lengths)
    used, known = tested.session, expanded_lengths(tested.lengths, tested.session)
    check_sessions(used, known)
    points = predict_points(regressor, used)
    found = (
        *findings_of("acceptance", acceptance_remarks(accept)),
        *tested.findings,
        Finding("regressor", regressor_remark(regressor)),
    )
    errors = {"model": _errors(points, None, used, known)}
    return Evaluation(regressor, used, {"model": points}, errors, known, findings=found)


def _errors(points: FloatArray, nominal: FloatArray | None, used: Session, known: Lengths | None) -> dict[str, Any]:
    """Errors of predicted points against every reference there is."""
    found: dict[str, Any] = {}
    if used.points is not None:
        found |= point_errors(points, used.points) if nominal is None else compare_errors(points, nominal, used.points)
    found |= _seat_and_length_errors(points, used, known)
    is_of_distances = used.points is None and used.seat is None
    if is_of_distances or has_located_anchor(used, LEAST_COMPARED):
        found |= distance_errors(points, used)
    return found


def _seat_and_length_errors(points: FloatArray, session: Session, lengths: Lengths | None) -> dict[str, Any]:
    """Errors in the session's seats, where one has two readings, and errors of lengths."""
    found: dict[str, Any] = {}
    if session.seat is None or not (session.seat != "").any():
        return found
    if has_repeated_seat(session) or (session.points is None and lengths is None):
        found |= seat_errors(points, session.seat)
    if lengths is not None:
        columns = {name: getattr(lengths, name).tolist() for name in ("seat_a", "seat_b", "length_mm", "u_mm")}
        columns["length_error_mm"] = length_errors(points, session.seat, lengths).tolist()
        found["lengths"] = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return found


def _removed(percent: float) -> str:
    if -5 < percent < 0:
        return "no better than the nominal arm"
    if percent < 0:
        return f"worse than the nominal arm: {1 - percent / 100:.1f} times its mean absolute coordinate error"
    return f"{percent:.1f} % of the mean absolute coordinate error removed"
