"""``truearm predict``: corrected coordinates with uncertainties, from angles alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truearm.cli.console import Json, check_output_is_not_input, print_json, print_line, print_status, progress

if TYPE_CHECKING:
    from truearm.compensation.models import Compensator
    from truearm.readings import Session
    from truearm.typing import BoolArray, FloatArray


def predict(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    session: Annotated[
        Path,
        typer.Argument(
            metavar="SESSION",
            help="Session file; its angles, and temperature, loads, directions if there, are used.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Table of points to write, .csv.")],
    as_json: Json = False,
) -> None:
    """Compensate: turn joint angles into corrected coordinates.

    Columns of the table: x_mm, y_mm, z_mm in the frame of the reference, after a fit to several sessions in that of the
    reading's session; sx_mm, sy_mm, sz_mm their standard uncertainties (twice that is the expanded uncertainty, k = 2);
    outside_training 1 where a joint is away from the angles the model learned from; names (seat, position, ..) as
    given.
    """
    import numpy as np

    from truearm.compensation.models import NetworkModel, PhysicalModel
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.errors import InputError
    from truearm.files.atomic_write import check_writable

    if out.suffix != ".csv":
        raise InputError(f"expected a file name that ends in .csv, got {out.name!r}", file=out)
    check_output_is_not_input(out, model, session)
    check_writable(out)
    with progress(f"predicting {session.name}"):
        fitted, readings = load_for(model, session)
        points, covariance = fitted.predict_readings(readings, return_cov=True)
        std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        outside = fitted.outside_training(readings.angles)
        unstated_input_covariances = (
            fitted.unstated_input_covariances(readings) if isinstance(fitted, IdentifiedModel) else {}
        )
        _write(out, readings, points, std, outside)
    not_given_mm = {
        name: float(np.sqrt(np.trace(part, axis1=1, axis2=2).mean() / 3))
        for name, part in unstated_input_covariances.items()
    }
    elsewhere, n_elsewhere = _in_no_session(fitted, readings)
    if as_json:
        print_json(
            {
                "file": str(out),
                "n_readings": len(points),
                "median_u_mm": float(np.median(std)),
                "not_given_u_mm": not_given_mm,
                "n_outside_training": int(outside.sum()),
                "median_u_outside_training_mm": float(np.median(std[outside])) if outside.any() else None,
                "n_in_no_known_session": n_elsewhere,
            }
        )
        return
    print_line(f"{out}: {len(points)} points, standard uncertainty of a coordinate {np.median(std):.4f} mm (median)")
    if not_given_mm:
        sizes = [f"{name} ({size:.4f} mm)" for name, size in not_given_mm.items()]
        print_line(f"Not given at all readings, taken at the mean, which is in the uncertainty: {', '.join(sizes)}.")
    if n_elsewhere:
        unknown = f"{n_elsewhere} readings are in no session that the model knows"
        print_line(f"{unknown}: their points are in the frame of {elsewhere}")
    if outside.any():
        if isinstance(fitted, NetworkModel):
            advice = ": do not rely on them"
        elif isinstance(fitted, PhysicalModel):
            advice = f"; there it is {np.median(std[outside]):.4f} mm"
        else:
            advice = ": errors may be larger there than it says"
        print_line(
            f"{int(outside.sum())} of {len(points)} readings have a joint away from the training angles{advice}."
        )


def _in_no_session(fitted: Compensator, readings: Session) -> tuple[str, int]:
    """The session in whose frame readings of sessions that the model does not know are, and their number."""
    import numpy as np

    if not fitted.session_frames_:
        return "", 0
    first, *_ = fitted.session_frames_
    named = np.full(len(readings), "") if readings.session is None else readings.session
    return first, int((~np.isin(named, list(fitted.session_frames_))).sum())


def _write(out: Path, readings: Session, points: FloatArray, std: FloatArray, outside: BoolArray) -> None:
    import pandas as pd

    from truearm.files.atomic_write import atomic_file
    from truearm.readings.session import NAMED

    columns: dict[str, object] = {f"{axis}_mm": points[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"s{axis}_mm": std[:, i] for i, axis in enumerate("xyz")}
    columns["outside_training"] = outside.astype(int)
    for name in NAMED:
        if getattr(readings, name) is not None:
            columns[name] = getattr(readings, name)
    with atomic_file(out) as beside:
        # To the nanometre: below it lies nothing but the look of exactness.
        pd.DataFrame(columns).to_csv(beside, index=False, float_format="%.6f", lineterminator="\n")


def load_for(model: Path, session: Path) -> tuple[Compensator, Session]:
    """A model and the readings it is asked about, checked against each other."""
    from zipfile import is_zipfile

    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError
    from truearm.readings import check_angles, read_session

    if is_zipfile(session) and model.is_file() and not is_zipfile(model):
        raise InputError("expected a session file, got a model file", file=session, hint="the model first")
    fitted = load_model(model)
    readings = read_session(session, n_joints=fitted.arm.n_joints)
    lower, upper = fitted.arm.limits.T
    check_angles(
        readings,
        joint_names=fitted.arm.joint_names,
        lower=lower,
        upper=upper,
        prismatic=fitted.arm.chain.prismatic,
    )
    return fitted, readings


def load_with_reference(model: Path, session: Path, *, purpose: str) -> tuple[Compensator, Session]:
    """The same, for the readings with reference points, which the arm can reach; if there are none, those in seats."""
    fitted, readings = load_for(model, session)
    check_reference(readings, fitted, purpose=purpose, seats=True)
    useful, lacking = readings.has_point, "have no reference point"
    if not useful.any():
        assert readings.seat is not None  # checked above
        useful, lacking = readings.seat != "", "are in no seat"
    if useful.all():
        return fitted, readings
    print_status(f"{int((~useful).sum())} of {len(readings)} readings {lacking} and are left out")
    return fitted, readings.rows(useful)


def without_served(models: Sequence[Compensator], readings: Session) -> tuple[Session, int]:
    """The readings without those that served to refit a model, and how many these were; all, if no other is left."""
    import numpy as np

    from truearm.compensation.models.refit import used_in_refit

    used = np.any([used_in_refit(model, readings) for model in models], axis=0)
    if not used.any() or used.all():
        return readings, 0
    return readings.rows(~used), int(used.sum())


def check_reference(readings: Session, fitted: Compensator, *, purpose: str, seats: bool = False) -> None:
    """Check that there is something to hold a model's points against: reference points, or `seats` instead.

    Raises
    ------
    InputError
        If there is nothing of the kind, or the arm cannot reach a point.
    """
    from truearm.readings import check_reach

    if readings.points is None and not (seats and readings.seat is not None and (readings.seat != "").any()):
        what = "reference points or seats" if seats else "reference points"
        raise readings.error(f"expected {what} to {purpose}, the session has none", hint="truearm predict needs none")
    check_reach(readings, reach=fitted.arm.chain.reach)
