"""Predict: corrected coordinates of the tip with their uncertainty, from joint angles alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearm.acceptance import Acceptance, acceptance_remarks, accepted, accepts
from truearm.choices import Conditions
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import write_columns
from truearm.findings import Finding, findings_of
from truearm.models import Compensator
from truearm.models.angle_mistakes import doubt_about_angles
from truearm.models.arm_check import with_read_angles
from truearm.models.identified_model import ROUNDED
from truearm.models.training_conditions import TOGETHER
from truearm.readings import Session
from truearm.readings.checks import serial_number_of
from truearm.readings.files import open_parquet
from truearm.readings.readings import NAMED, PAYLOAD
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray
from truearm.verbs.inputs import (
    ModelLike,
    SessionLike,
    check_angles_fit,
    describe_outside,
    fit_findings,
    model_file_fingerprint,
    payload_findings,
    to_model_and_session,
)
from truearm.verbs.record import TableRecord, format_fixed
from truearm.verbs.sentences import SAME_DAY, agree, number_of

POINT_COLUMNS = ["x_mm", "y_mm", "z_mm", "sx_mm", "sy_mm", "sz_mm"]
# Names of joint angles among the inputs of a model.
JOINT = re.compile(r"J\d+")
# Of millimetres in the table of points: nanometres.
DECIMALS = 6
NONE = np.zeros(0, bool)


@one_blas_thread()
@accepts
def predict(
    model: ModelLike,
    session: SessionLike,
    *,
    conditions: Conditions = "reproducibility",
    accept: str | None = None,
) -> Prediction:
    """Compensate: corrected coordinates of the tip from joint angles.

    Temperatures, loads and directions of movement are used where the session states them.

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted model or its file.
    session : Session, DataFrame, str or Path
        Readings; reference points are not needed.
    conditions : {"reproducibility", "repeatability"}
        What the uncertainty is for (`Compensator.under`): any day, or the day and set-up of the training readings.
    accept : str, optional
        Why the readings are right where they would be refused as contradicted: the reason and what it overrode are
        kept (docs/imperfect-readings.md).

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        If the session is of another arm, or more than half of its readings are beyond a joint limit.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> prediction = ta.predict(ta.fit("ur10", session, model="kinematic").model, session)
    >>> list(prediction.to_frame())[:6]
    ['x_mm', 'y_mm', 'z_mm', 'sx_mm', 'sy_mm', 'sz_mm']
    """
    known, readings = to_model_and_session(model, session)
    fitted, file = known.under(conditions), Path(model) if isinstance(model, str | Path) else None
    found = _reading_findings(fitted, readings)
    at = fitted.at(readings)
    points, covariances = fitted.predict_readings(at, return_cov=True)
    inputs_outside = fitted.inputs_outside_training(at)
    return Prediction(
        model=known,
        session=readings,
        points=points,
        covariances=covariances,
        inputs_outside=inputs_outside,
        outside_u_mm=dict(_uncertainties_outside(fitted, readings, inputs_outside, covariances)),
        unstated_u_mm={name: _rms_u(part) for name, part in fitted.unstated_input_covariances(at).items()},
        conditions=conditions,
        findings=(*findings_of("acceptance", acceptance_remarks(accept)), *found, *fit_findings(fitted)),
        accepted=accepted(fitted.accepted_),
        serial_number=fitted.arm_.serial_number or serial_number_of(readings),  # they agree, or it was accepted
        model_name=fitted.kind if file is None else f"{file.name} ({fitted.kind})",
        model_sha256="" if file is None else model_file_fingerprint(file),
    )


def _reading_findings(model: Compensator, readings: Session) -> tuple[Finding, ...]:
    read = with_read_angles(model.arm_, readings)
    return (
        *check_angles_fit(readings, model.arm),
        *findings_of("angles", doubt_about_angles(model.training_, read.angles, model.arm_.chain.is_prismatic)),
        *payload_findings(model.training_, readings),
    )


def _rms_u(covariances: FloatArray) -> float:
    """Standard uncertainty of a coordinate, root mean square [mm]."""
    return float(np.sqrt(max(np.trace(covariances, axis1=1, axis2=2).mean() / 3, 0.0)))


def _uncertainties_outside(
    model: Compensator, readings: Session, inputs_outside: Mapping[str, BoolArray], covariances: FloatArray
) -> Iterator[tuple[str, float]]:
    """By input other than an angle, the standard uncertainty that its distance from the training adds [mm]."""
    ignored = {PAYLOAD} if model.training_.ignores_payload(readings) else set()  # it adds nothing: see the remark
    for name, rows in inputs_outside.items():
        if name in ignored or JOINT.fullmatch(name) or name == TOGETHER:
            continue
        nearest = model.at(model.training_.with_nearest(readings, name))
        added = covariances - model.predict_readings(nearest, return_cov=True)[1]
        yield name, _rms_u(added[rows])


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(TableRecord):
    """Predicted points of the readings of a session.

    Attributes
    ----------
    model : Compensator
    session : Session
    points : (n, 3) array
        Tip [mm], in the frame of the reference; after a fit to several sessions in that of the reading's session.
    covariances : (n, 3, 3) array
        Their covariances [mm^2].
    inputs_outside : dict of str to (n,) array of bool
        By input (J1 to Jn, temperature, a load, a direction) which readings are outside the trained range; only such
        inputs.
    outside_u_mm : dict of str to float
        By input of these other than an angle, the standard uncertainty that its distance from the training adds at
        these readings, root mean square [mm].
    unstated_u_mm : dict of str to float
        Standard uncertainty due to each input that the session does not state at all readings [mm].
    findings : tuple of Finding
    accepted : tuple of Acceptance
        Contradictions that were accepted in the fit of the model, or in these readings.
    serial_number : str
        Of the arm, as the model or else the session states it; empty if neither does.
    model_name, model_sha256 : str
        File and kind of the model, and the SHA-256 of its file; of a model without a file its kind, and nothing.
    conditions : {"reproducibility", "repeatability"}
        What the covariances are for.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> prediction = ta.predict(ta.fit("ur10", session, model="nominal").model, session)
    >>> prediction.points.shape, prediction.covariances.shape
    ((40, 3), (40, 3, 3))
    """

    model: Compensator
    session: Session
    points: FloatArray
    covariances: FloatArray
    inputs_outside: Mapping[str, BoolArray]
    outside_u_mm: Mapping[str, float]
    unstated_u_mm: Mapping[str, float]
    findings: tuple[Finding, ...]
    accepted: tuple[Acceptance, ...] = ()
    serial_number: str = ""
    model_name: str = ""
    model_sha256: str = ""
    conditions: Conditions = "reproducibility"

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

    def save(self, path: str | Path) -> None:
        """Write the table of `to_frame` as CSV, to the nanometre.

        Raises
        ------
        InputError
            If the name does not end in ``.csv`` or cannot be written.
        """
        check_table_path(path)
        with atomic_file(path, read=check_is_points_table) as beside:
            write_columns(beside, self.columns(), decimals=DECIMALS)

    def columns(self) -> dict[str, FloatArray | IntArray | NameArray]:
        """The columns of `to_frame`: x_mm .. z_mm, standard uncertainties sx_mm .. sz_mm, outside_training, names."""
        columns: dict[str, FloatArray | IntArray | NameArray]
        columns = dict(zip(POINT_COLUMNS, (*self.points.T, *self.u_mm.T), strict=True))
        columns["outside_training"] = self.outside_training.astype(np.int64)
        return columns | {name: names for name in NAMED if (names := getattr(self.session, name)) is not None}

    def summary(self) -> str:
        """The answer in one sentence: the number of points and their uncertainty."""
        of = "" if self.conditions == "reproducibility" else f", {SAME_DAY}"
        return (
            f"{len(self.points)} points, standard uncertainty of a coordinate {format_fixed(np.median(self.u_mm))} mm "
            f"(median{of})."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        most_outside = bool(2 * self.outside_training.sum() > len(self.points))
        if most_outside:
            yield from self.remarks
        yield self.summary()
        missing = dict(self.unstated_u_mm)
        if (rounded := missing.pop(ROUNDED, None)) is not None:
            yield f"The angles are rounded, as those of the training were: {format_fixed(rounded)} mm of uncertainty."
        if missing:
            sizes = ", ".join(f"{name} ({format_fixed(size)} mm)" for name, size in missing.items())
            yield (f"Missing in some readings: {sizes}; truearm uses the training mean and includes its uncertainty.")
        if n := int(self._in_unknown_session.sum()):
            first = next(iter(self.model.session_frames_))
            where = f"in no session that the model knows: their points are in the frame of {first}."
            yield f"{number_of(n)} {agree(n, 'are')} {where}"
        if self.inputs_outside:
            note = self.model.outside_note.format(u=format_fixed(np.median(self.u_mm[self.outside_training])))
            yield f"{describe_outside(self.inputs_outside, self.model.training_, self.session)}{note}."
            if self.conditions == "repeatability" and (n := int(self.inputs_outside.get("temperature", NONE).sum())):
                yield (
                    f"{n} of {len(self.points)} readings at temperatures outside the trained range are not under "
                    "repeatability conditions: use the uncertainty of any day there."
                )
        if self.outside_u_mm:
            sizes = ", ".join(f"{name} {format_fixed(size)} mm" for name, size in self.outside_u_mm.items())
            yield f"There these inputs add to the standard uncertainty (root mean square): {sizes}."
        if not most_outside:
            yield from self.remarks

    def _json(self) -> object:
        outside = self.outside_training
        return {
            "summary": self.summary(),
            "n_readings": len(self.points),
            "conditions": self.conditions,
            "median_u_mm": float(np.median(self.u_mm)),
            "unstated_u_mm": self.unstated_u_mm,
            "n_outside_training": int(outside.sum()),
            "inputs_outside_training": {name: int(rows.sum()) for name, rows in self.inputs_outside.items()},
            "outside_u_mm": self.outside_u_mm,
            "median_u_outside_training_mm": float(np.median(self.u_mm[outside])) if outside.any() else None,
            "n_in_unknown_session": int(self._in_unknown_session.sum()),
            "remarks": self.remarks,
        }

    @property
    def _in_unknown_session(self) -> BoolArray:
        """(n,) Whether a reading is in a session without a frame, where the model has frames of several."""
        if not self.model.session_frames_:
            return np.zeros(len(self.points), bool)
        named = np.full(len(self.points), "") if self.session.session is None else self.session.session
        return ~np.isin(named, list(self.model.session_frames_))


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
