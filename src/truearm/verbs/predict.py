"""Predict: corrected coordinates of the tip with their uncertainty, from joint angles alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from truearm.acceptance import Acceptance, accept_also, acceptance_remarks, accepted, accepting, accepts, overridden
from truearm.choices import Conditions
from truearm.errors import InputError
from truearm.findings import Finding, findings_of, shortened
from truearm.models import Compensator
from truearm.models.arm_check import doubt_about_angles, with_read_angles
from truearm.models.identified_model import ROUNDED
from truearm.models.training_conditions import TOGETHER
from truearm.readings import NAMED, PAYLOAD, Session, serial_number_of, serial_number_of_all
from truearm.readings.files import Columns, is_large, open_parquet, table_writer
from truearm.solve.sums import MAX_KEPT, QuantileSketch, Sums, different, joined
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray
from truearm.verbs.inputs import (
    ModelLike,
    SessionLike,
    check_angles_fit,
    count_outside,
    describe_outside,
    fit_findings,
    model_file_fingerprint,
    of_file,
    payload_findings,
    to_model,
    to_model_and_session,
)
from truearm.verbs.outputs import check_output
from truearm.verbs.record import SAME_DAY, TableRecord, agree, format_fixed, number_of

if TYPE_CHECKING:  # no small session waits for these
    from truearm.readings.large_sessions import Part
    from truearm.solve.executors import Executor

ENDINGS = (".csv", ".parquet")
POINT_COLUMNS = ["x_mm", "y_mm", "z_mm", "sx_mm", "sy_mm", "sz_mm"]
# Names of joint angles among the inputs of a model.
JOINT = re.compile(r"J\d+")
# Of millimetres in the table of points: nanometres.
DECIMALS = 6


@one_blas_thread()
@accepts
def predict(
    model: ModelLike,
    session: SessionLike,
    out: str | Path | None = None,
    *,
    conditions: Conditions = "reproducibility",
    accept: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> Prediction:
    """Compensate: corrected coordinates of the tip from joint angles.

    Temperatures, loads and directions of movement are used where the session states them.

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted model or its file.
    session : Session, DataFrame, str or Path
        Readings; reference points are not needed. A folder of files, or a file beyond 512 MiB, is read part by part
        (docs/large-sessions.md).
    out : str or Path, optional
        Table to write, that of `Prediction.save`; of a session in parts it is needed, and has the points alone.
    conditions : {"reproducibility", "repeatability"}
        What the uncertainty is for (`Compensator.under`): any day, or the day and set-up of the training readings.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept (docs/imperfect-readings.md).
    executor : Executor, optional
        Who computes the parts; this process by default. The table does not depend on it.
    progress : callable, optional
        Called with the number of readings of the parts that are done, and a note.

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        If the session is of another arm, or more than half of its readings, or of those of a part, are beyond a joint
        limit.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> prediction = ta.predict(ta.fit("ur10", session, model="kinematic").model, session)
    >>> list(prediction.to_frame())[:6]
    ['x_mm', 'y_mm', 'z_mm', 'sx_mm', 'sy_mm', 'sz_mm']
    """
    if out is not None:
        read = (one for one in (model, session) if isinstance(one, str | Path))
        check_output(out, *read, endings=ENDINGS, read=check_is_points_table)
    if is_large(session):
        from truearm.readings.large_sessions import LargeSession  # no small session waits for it

        known = to_model(model)
        large = LargeSession.open(session, n_joints=known.arm.n_joints, executor=executor, progress=progress)
        if out is None:
            hint = 'out="points.csv"'
            raise InputError("expected out: the points of a session in parts go to a file", file=session, hint=hint)
        sums, work = PredictionSums(), partial(_predict_part, known, conditions=conditions, accept=accept)
        with table_writer(out, decimals=DECIMALS, read=check_is_points_table) as append:
            for of_part in large.sums([work] * len(large.parts)):
                for table in of_part.tables:
                    append(table)
                sums = sums + replace(of_part, tables=())
            stated = serial_number_of_all(sums.serial_numbers, large.path)
        accept_also(sums.overridden)
        sums = replace(sums, findings=shortened(sums.findings, MAX_KEPT))
        of_arm = accepted(known.accepted_), known.arm_.serial_number or stated
        found = Prediction(known, None, sums, len(large.parts), *of_arm, conditions, known.kind)
    else:
        found = _predicted(*to_model_and_session(model, session), conditions)
        if out is not None:
            found.save(out)
    of_all = *findings_of("acceptance", acceptance_remarks(accept)), *found.findings
    found = replace(found, sums=replace(found.sums, findings=of_all))
    if not isinstance(model, str | Path):
        return found
    name = f"{Path(model).name} ({found.model_name})"
    return replace(found, model_name=name, model_sha256=model_file_fingerprint(model))


def _predict_part(
    model: Compensator, readings: Session, part: Part, *, conditions: Conditions, accept: str | None
) -> PredictionSums:
    """Columns of the table, and figures, of some readings of a part."""
    with accepting(accept):
        one = _predicted(model, readings, conditions)
    note_line = cast(IntArray, readings.numbers)
    table = {**one.columns(), "note_file": np.full(len(readings), part.file.name), "note_line": note_line}
    return replace(one.sums, tables=(table,), findings=of_file(one.findings, readings.file))


def _predicted(known: Compensator, readings: Session, conditions: Conditions) -> Prediction:
    model = known.under(conditions)
    found = _reading_findings(model, readings)
    at = model.at(readings)
    points, covariances = model.predict_readings(at, return_cov=True)
    readings_at = PredictedReadings(readings, points, covariances, model.inputs_outside_training(at))
    serial_number = model.arm_.serial_number or serial_number_of(readings)  # they agree, or it was accepted
    of_model = accepted(model.accepted_), serial_number, conditions, model.kind
    one = Prediction(known, readings_at, PredictionSums(len(readings)), 1, *of_model)
    sums = replace(
        one.sums,
        n_outside=int(one.outside_training.sum()),
        outside={name: int(rows.sum()) for name, rows in one.inputs_outside.items()},
        outside_mm2=dict(_variances_outside(model, readings_at)),
        unstated_mm2={name: _total_mm2(part) for name, part in model.unstated_input_covariances(at).items()},
        n_in_unknown_session=_n_in_unknown_session(model, readings),
        findings=(*found, *fit_findings(model)),
        overridden=overridden(),
        serial_numbers=frozenset(filter(None, [serial_number])),
        u=QuantileSketch.of(one.u_mm.ravel()),
        u_outside=QuantileSketch.of(one.u_mm[one.outside_training].ravel()),
    )
    return replace(one, sums=sums)


def _reading_findings(model: Compensator, readings: Session) -> tuple[Finding, ...]:
    read = with_read_angles(model.arm_, readings)
    return (
        *check_angles_fit(readings, model.arm),
        *findings_of("angles", doubt_about_angles(model.training_, read.angles, model.arm_.chain.is_prismatic)),
        *payload_findings(model.training_, readings),
        *_name_findings(model, readings),
    )


def _name_findings(model: Compensator, readings: Session) -> Iterator[Finding]:
    """That readings name a tip or sessions, where the model has one without a name and cannot compare them."""
    if readings.tip is not None and not model.tips_:
        yield Finding(
            "tips",
            f"The readings are of the tip {readings.tip[0]}, and the tip of the model has no name: the points are of "
            "the tip in its training. If it is another one: truearm refit MODEL SESSION --free tip.",
        )
    if readings.session is not None and not model.session_frames_ and "base" in model.free_:
        names = list(dict.fromkeys(filter(None, readings.session.tolist())))
        if names:
            which = f"session {names[0]}" if len(names) == 1 else f"{len(names)} sessions"
            yield Finding(
                "session frames",
                f"The readings are of {which}, and the model knows no sessions: the points are in the frame of its "
                "training. If base or reference were moved: truearm refit MODEL SESSION --free base.",
            )


def _total_mm2(covariances: FloatArray) -> float:
    """Sum of the variances of all coordinates [mm^2]."""
    return float(np.trace(covariances, axis1=1, axis2=2).sum())


def _rms_u(total_mm2: float, n: int) -> float:
    """Standard uncertainty of a coordinate, root mean square [mm]."""
    return float(np.sqrt(max(total_mm2 / n / 3, 0.0)))


def _variances_outside(model: Compensator, one: PredictedReadings) -> Iterator[tuple[str, float]]:
    """By input other than an angle, the sum of the variances that its distance from the training adds [mm^2]."""
    readings = one.session
    ignored = {PAYLOAD} if model.training_.ignores_payload(readings) else set()  # it adds nothing: see the remark
    for name, rows in one.inputs_outside.items():
        if name in ignored or JOINT.fullmatch(name) or name == TOGETHER:
            continue
        nearest = model.at(model.training_.with_nearest(readings, name))
        added = one.covariances - model.predict_readings(nearest, return_cov=True)[1]
        yield name, _total_mm2(added[rows])


def _n_in_unknown_session(model: Compensator, readings: Session) -> int:
    """Readings in a session without a frame, where the model has frames of several."""
    if not model.session_frames_:
        return 0
    named = np.full(len(readings), "") if readings.session is None else readings.session
    return int((~np.isin(named, list(model.session_frames_))).sum())


class PredictedReadings(NamedTuple):
    """Predicted points of some readings; the attributes are those of `Prediction`."""

    session: Session
    points: FloatArray
    covariances: FloatArray
    inputs_outside: Mapping[str, BoolArray]


@dataclass(frozen=True, eq=False)
class PredictionSums(Sums):
    """Figures of predictions that are added over parts.

    Attributes
    ----------
    n, n_outside, n_in_unknown_session : int
        Points; those outside the trained range; those in a session without a frame, where the model has frames of
        several.
    outside : dict of str to int
        Those outside the range by input.
    outside_mm2, unstated_mm2 : dict of str to float
        Sums of the variances that inputs outside the range add, by input, and of those that are not stated [mm^2].
    findings : tuple of Finding
        Of many parts the first six different ones of each thing, and the number of the others.
    overridden : tuple of str
        Contradictions that were accepted.
    serial_numbers : frozenset of str
        Of the arms, as the model or else the readings state them.
    u, u_outside : QuantileSketch
        Standard uncertainties of the coordinates, and of those outside the trained range [mm].
    tables : tuple of dict
        Of a part: what is to be written.
    """

    n: int = 0
    n_outside: int = 0
    outside: Mapping[str, int] = field(default_factory=dict)
    outside_mm2: Mapping[str, float] = field(default_factory=dict)
    unstated_mm2: Mapping[str, float] = field(default_factory=dict)
    n_in_unknown_session: int = 0
    findings: tuple[Finding, ...] = field(default=(), metadata=joined(different))
    overridden: tuple[str, ...] = field(default=(), metadata=joined(different))
    serial_numbers: frozenset[str] = field(default=frozenset(), metadata=joined(or_))
    u: QuantileSketch = field(default_factory=QuantileSketch)
    u_outside: QuantileSketch = field(default_factory=QuantileSketch)
    tables: tuple[Columns, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(TableRecord):
    """Predicted points of the readings of a session.

    Those of a session in parts are in the table that was written: what is of single readings is refused then.

    Attributes
    ----------
    model : Compensator
    readings : PredictedReadings or None
        What is of single readings; None of a session in parts.
    sums : PredictionSums
        Counts and sums over them.
    n_parts : int
        In which the session was read.
    accepted : tuple of Acceptance
        Contradictions that were accepted in the fit of the model, or in these readings.
    serial_number : str
        Of the arm, as the model or else the session states it; empty if neither does.
    conditions : {"reproducibility", "repeatability"}
        What the covariances are for.
    model_name, model_sha256 : str
        File and kind of the model, and the SHA-256 of its file; of a model without a file its kind, and nothing.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> prediction = ta.predict(ta.fit("ur10", session, model="nominal").model, session)
    >>> prediction.points.shape, prediction.covariances.shape
    ((40, 3), (40, 3, 3))
    """

    model: Compensator
    readings: PredictedReadings | None
    sums: PredictionSums
    n_parts: int
    accepted: tuple[Acceptance, ...]
    serial_number: str
    conditions: Conditions
    model_name: str
    model_sha256: str = ""

    def _one(self) -> PredictedReadings:
        if self.readings is None:
            raise InputError(f"the {self.sums.n} points of a session in parts are in the table that was written alone")
        return self.readings

    @property
    def session(self) -> Session:
        """The readings."""
        return self._one().session

    @property
    def points(self) -> FloatArray:
        """(n, 3) tip [mm]; after a fit to several sessions in the frame of the reading's session."""
        return self._one().points

    @property
    def covariances(self) -> FloatArray:
        """(n, 3, 3) covariances of the points [mm^2]."""
        return self._one().covariances

    @property
    def inputs_outside(self) -> Mapping[str, BoolArray]:
        """By input (J1 to Jn, temperature, a load, a direction) which readings are outside the trained range."""
        return self._one().inputs_outside

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a person must know of it."""
        return self.sums.findings

    @property
    def remarks(self) -> tuple[str, ...]:
        """The findings in words."""
        return tuple(map(str, self.findings))

    @property
    def u_mm(self) -> FloatArray:
        """(n, 3) standard uncertainties of the coordinates [mm]."""
        std: FloatArray = np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))
        return std

    @property
    def outside_training(self) -> BoolArray:
        """(n,) Whether an input of a reading is outside the trained range."""
        none = np.zeros(len(self.points), bool)
        return np.asarray(np.logical_or.reduce([none, *self.inputs_outside.values()]))

    @property
    def median_u_mm(self) -> float:
        """Median standard uncertainty of a coordinate [mm]; of a session in parts to 0.1 %."""
        return self.sums.u.quantile(0.5) if self.readings is None else float(np.median(self.u_mm))

    @property
    def median_u_outside_mm(self) -> float | None:
        """The same of the readings outside the trained range; None if all are inside."""
        if not self.sums.n_outside:
            return None
        if self.readings is None:
            return self.sums.u_outside.quantile(0.5)
        return float(np.median(self.u_mm[self.outside_training]))

    @property
    def unstated_u_mm(self) -> dict[str, float]:
        """Standard uncertainty due to each input that the session does not state at all readings [mm]."""
        return {name: _rms_u(total, self.sums.n) for name, total in self.sums.unstated_mm2.items()}

    @property
    def outside_u_mm(self) -> dict[str, float]:
        """By input outside the range, other than an angle, what its distance adds there, root mean square [mm]."""
        return {name: _rms_u(total, self.sums.outside[name]) for name, total in self.sums.outside_mm2.items()}

    def save(self, path: str | Path) -> None:
        """Write the table of `to_frame`, in CSV to the nanometre.

        Raises
        ------
        InputError
            If the name ends in neither ``.csv`` nor ``.parquet``, or cannot be written.
        """
        check_output(path, endings=ENDINGS)
        with table_writer(path, decimals=DECIMALS, read=check_is_points_table) as append:
            append(self.columns())

    def columns(self) -> dict[str, FloatArray | IntArray | NameArray]:
        """The columns of `to_frame`: x_mm .. z_mm, standard uncertainties sx_mm .. sz_mm, outside_training, names."""
        columns: dict[str, FloatArray | IntArray | NameArray]
        columns = dict(zip(POINT_COLUMNS, (*self.points.T, *self.u_mm.T), strict=True))
        columns["outside_training"] = self.outside_training.astype(np.int64)
        return columns | {name: names for name in NAMED if (names := getattr(self.session, name)) is not None}

    def summary(self) -> str:
        """The answer in one sentence: the number of points and their uncertainty."""
        of = "" if self.conditions == "reproducibility" else f", {SAME_DAY}"
        parts = f" in {self.n_parts} parts" if self.n_parts > 1 else ""
        return (
            f"{self.sums.n} points{parts}, standard uncertainty of a coordinate {format_fixed(self.median_u_mm)} mm "
            f"(median{of})."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        sums = self.sums
        most_outside = 2 * sums.n_outside > sums.n
        if most_outside:
            yield from self.remarks
        yield self.summary()
        missing = self.unstated_u_mm
        if (rounded := missing.pop(ROUNDED, None)) is not None:
            yield f"The angles are rounded, as those of the training were: {format_fixed(rounded)} mm of uncertainty."
        if missing:
            sizes = ", ".join(f"{name} ({format_fixed(size)} mm)" for name, size in missing.items())
            yield (f"Missing in some readings: {sizes}; truearm uses the training mean and includes its uncertainty.")
        if n := sums.n_in_unknown_session:
            first = next(iter(self.model.session_frames_))
            where = f"in no session that the model knows: their points are in the frame of {first}."
            yield f"{number_of(n)} {agree(n, 'are')} {where}"
        if sums.n_outside:
            note = self.model.outside_note.format(u=format_fixed(cast(float, self.median_u_outside_mm)))
            yield f"{self._outside()}{note}."
            if self.conditions == "repeatability" and (n := sums.outside.get("temperature", 0)):
                yield (
                    f"{n} of {sums.n} readings at temperatures outside the trained range are not under "
                    "repeatability conditions: use the uncertainty of any day there."
                )
        if self.outside_u_mm:
            sizes = ", ".join(f"{name} {format_fixed(size)} mm" for name, size in self.outside_u_mm.items())
            yield f"There these inputs add to the standard uncertainty (root mean square): {sizes}."
        if not most_outside:
            yield from self.remarks

    def _outside(self) -> str:
        if self.readings is None:
            return count_outside(self.sums.outside, self.sums.n_outside, self.sums.n)
        return describe_outside(self.inputs_outside, self.model.training_, self.session)

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "n_readings": self.sums.n,
            **({"n_parts": self.n_parts} if self.readings is None else {}),
            "conditions": self.conditions,
            "median_u_mm": self.median_u_mm,
            "unstated_u_mm": self.unstated_u_mm,
            "n_outside_training": self.sums.n_outside,
            "inputs_outside_training": self.sums.outside,
            "outside_u_mm": self.outside_u_mm,
            "median_u_outside_training_mm": self.median_u_outside_mm,
            "n_in_unknown_session": self.sums.n_in_unknown_session,
            "remarks": self.remarks,
        }


def check_is_points_table(path: Path) -> None:
    """Check that a file is a table of predicted points: no session has their uncertainties without joints.

    Raises
    ------
    InputError
        If its first columns are others.
    """
    if path.suffix == ".parquet":
        with open_parquet(path) as table:
            names = list(table.schema_arrow.names)
    else:
        with path.open("rb") as file:
            names = file.readline(1000).decode("utf-8", "replace").strip().split(",")
    if names[:6] != POINT_COLUMNS:
        raise InputError(f"expected the columns {', '.join(POINT_COLUMNS)}, got {', '.join(names)[:80]!a}", file=path)


def check_table_path(path: str | Path) -> None:
    """Check that a table has a name that ends in ``.csv``."""
    if Path(path).suffix != ".csv":
        raise InputError(f"expected a file name that ends in .csv, got {Path(path).name!r}", file=path)
