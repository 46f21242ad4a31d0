"""Fill points: predicted coordinates entered into a form of points to measure."""

from __future__ import annotations

from pathlib import Path

from truearm import __version__
from truearm.files.dates import now, parse_moment
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import model_file_fingerprint
from truearm.verbs.predict import Prediction
from truearm.wings.laboratory.standards.coordinate_origin import PROGRAM, CoordinateOrigin
from truearm.wings.laboratory.standards.points_form import fill_points_form


@one_blas_thread()
def fill_points(
    prediction: Prediction, path: str | Path, *, date: str | None = None, artefact_degC: float | None = None
) -> int:
    """Enter points into a file of points to measure, in the order of the readings (see `operator_sheet`).

    Entered too are the serial number of the arm, if the model or the session states it, what was accepted, and
    where the coordinates come from: version of truearm, model, SHA-256 of its file, readings outside its range.

    Parameters
    ----------
    prediction : Prediction
        What `predict` returned.
    path : path
        Its rows without coordinates are filled in, all or none.
    date : str, optional
        Day of the measurement, such as ``2026-11-03``, where none is stated; today by default.
    artefact_degC : float, optional
        Temperature of the artefacts [degC], where a test needs one and none is stated.

    Returns
    -------
    int
        Number of rows filled in.

    Raises
    ------
    InputError
        If there are more or fewer readings than rows without coordinates, a tip diameter is missing, the rows state
        the serial number of another arm, points have another origin, or the date or the temperature is implausible.

    Examples
    --------
    >>> import truearm as ta
    >>> sheet = ta.operator_sheet("iso10360-12")
    >>> sheet.save_points("points.csv", tip_diameter_mm=6)
    >>> artefacts = sheet.sheet.artefacts
    >>> poses = ta.rehearse("measuring7", "points.csv", artefacts=artefacts, preset="perfect").session
    >>> made = ta.simulate("measuring7", poses=30, preset="perfect", seed=1)
    >>> model = ta.fit("measuring7", made.session, model="nominal").model
    >>> ta.fill_points(ta.predict(model, poses), "points.csv", artefact_degC=20) == len(poses)
    True
    """
    moment = now() if date is None else parse_moment(date)
    model = prediction.model_name or prediction.model.kind
    digest = prediction.model_sha256 or model_file_fingerprint(prediction.model)
    return fill_points_form(
        path,
        prediction.points,
        day=moment.date(),
        artefact_degC=artefact_degC,
        serial_number=prediction.serial_number,
        accepted=" ".join(map(str, prediction.accepted)),
        origin=CoordinateOrigin(f"{PROGRAM} {__version__}", model, digest),
        outside=prediction.outside_training,
    )
