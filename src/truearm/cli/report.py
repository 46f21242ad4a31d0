"""``truearm report``: models of an arm compared on a session, as a page to show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import check_page_path, print_line, progress

if TYPE_CHECKING:
    from truearm.compensation.models import Compensator
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.seat_page import SeatComparison
    from truearm.identification.estimation.diagnostics import JointError
    from truearm.identification.estimation.outliers import Outlier
    from truearm.pages.page import Page, Section
    from truearm.readings import Lengths, Session

# Points of a joint's curve for each wave of the highest order.
POINTS_A_WAVE = 10


def report(
    files: Annotated[list[Path], typer.Argument(metavar="MODEL... SESSION", help="Model files, then a session file.")],
    out: Annotated[Path, typer.Option("--out", help="Page to write, .html.")],
    title: Annotated[str, typer.Option("--title", help="Title of the page.")] = "",
    lengths: Annotated[
        Path | None,
        typer.Option("--lengths", help="File of known lengths between the seats of a session without points, .csv."),
    ] = None,
) -> None:
    """Compare models on readings, as a page to show.

    Errors before and after; of identified arms their uncertainty, their terms, the error of each joint, what the
    readings left open. The page is one HTML file that needs nothing beside it. The readings must have reference points,
    or seats.
    """
    from zipfile import is_zipfile

    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError
    from truearm.pages.html import write_page
    from truearm.workflows.inputs import (
        check_angles_fit,
        expanded_lengths,
        session_lengths,
        to_model_and_session,
        with_reference,
        without_refit_readings,
    )

    *paths, session = files
    if paths and all(path.is_file() and is_zipfile(path) for path in files):
        raise InputError(
            "expected a session file after the model files, got a model file",
            file=session,
            hint=f"truearm report {' '.join(str(path) for path in files)} SESSION --out {out}",
        )
    if not paths:
        raise InputError(
            "expected one or more model files, then a session file", hint="truearm report MODEL SESSION --out FILE"
        )
    check_page_path(out, *files, *([] if lengths is None else [lengths]))
    with progress("drawing the report"):
        first, readings = to_model_and_session(paths[0], session)
        notes = check_angles_fit(readings, first.arm)
        readings, _, remarks_ = with_reference(readings, first.arm, purpose="compare with")
        # The others are of the same arm, or `compared` refuses them: the readings are checked once for all.
        models = dict(zip(_names(paths), [first, *map(load_model, paths[1:])], strict=True))
        whole = readings
        readings, _, refit_notes = without_refit_readings(whole, *models.values())
        if lengths is not None and readings.points is not None:
            raise InputError(
                "expected lengths with a session without reference points, and this one has them",
                file=lengths,
                hint="truearm evaluate MODEL SESSION --lengths LENGTHS",
            )
        known, length_notes = session_lengths(lengths, whole, readings)
        known = expanded_lengths(known, readings)
        write_page(_page(models, readings, known, session, title), out)
    for note in (*notes, *remarks_, *refit_notes, *length_notes):
        print_line(note)
    print_line(f"{out}: {len(models)} model{'s' * (len(models) > 1)} compared on {len(readings)} readings")


def _page(models: dict[str, Compensator], readings: Session, known: Lengths | None, session: Path, title: str) -> Page:
    from truearm.compensation.models.comparison_page import comparison_page
    from truearm.compensation.models.seat_page import seats_page
    from truearm.workflows.comparison import compare_models, one_arm, page_facts

    arm = one_arm(models).arm
    told: dict[str, Any] = {
        "title": title or f"{arm.name}: error before and after compensation",
        "subtitle": f"{len(readings)} readings of {session.name}",
        "facts": page_facts(models, readings),
        "remarks": [f"{name}: {remark}" for name, model in models.items() for remark in remarks(model, readings)],
    }
    if readings.points is None:
        return seats_page(seated(models, readings, known), **told, more=found_by(models, readings))
    return comparison_page(compare_models(models, readings), **told, more=found_by(models, readings))


def seated(models: dict[str, Compensator], readings: Session, known: Lengths | None) -> SeatComparison:
    """What the models make of readings in seats; those alone in their seat are left out."""
    import numpy as np

    from truearm.compensation.models import NominalModel
    from truearm.compensation.models.seat_page import SeatComparison
    from truearm.readings import check_sessions, length_errors
    from truearm.workflows.comparison import joint_facts, one_arm

    assert readings.seat is not None  # checked by the caller
    check_sessions(readings, known)
    first = one_arm(models)
    predicted = {"nominal": first.predict_nominal_readings(readings)}
    predicted |= {
        name: model.predict_readings(readings) for name, model in models.items() if not isinstance(model, NominalModel)
    }
    _, index, counts = np.unique(readings.seat, return_inverse=True, return_counts=True)
    several = (counts > 1)[index] & (readings.seat != "")
    if not several.any():
        raise readings.error("expected a seat with two or more readings, there is none", column="seat")
    of_lengths = {}
    rows: list[tuple[str, str, float, float]] = []
    if known is not None:
        of_lengths = {name: length_errors(points, readings.seat, known) for name, points in predicted.items()}
        columns = (getattr(known, name).tolist() for name in ("seat_a", "seat_b", "length_mm", "u_mm"))
        rows = list(zip(*columns, strict=True))
    return SeatComparison(
        angles=readings.angles[several],
        seat=readings.seat[several],
        predicted={name: points[several] for name, points in predicted.items()},
        lengths=rows,
        length_errors=of_lengths,
        **joint_facts(first),
    )


def found_by(models: dict[str, Compensator], readings: Session) -> list[Section]:
    """Sections on what the identified models, if there are any, found of their arm."""
    from truearm.compensation.models import NominalModel, identification_sections
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.uncertainty import uncertainty_budget
    from truearm.identification.estimation.diagnostics import effects, identifiability
    from truearm.pages.plotting import styles_of

    found = {
        name: model
        for name, model in models.items()
        if isinstance(model, IdentifiedModel) and not isinstance(model, NominalModel)
    }
    titles = {name: name if len(found) > 1 else "" for name in found}
    budgets = {name: uncertainty_budget(model, readings) for name, model in found.items()}
    states = {name: model.state(readings) for name, model in found.items()}
    sections = [
        *(
            identification_sections.uncertainty_section(budgets[name][0], model.held_out_errors_, name=titles[name])
            for name, model in found.items()
        ),
        *(
            identification_sections.terms_section(effects(model.fit_, states[name]), name=titles[name])
            for name, model in found.items()
        ),
        identification_sections.joint_errors_section(
            {name: _joint_errors(model, readings) for name, model in found.items()},
            readings.angles,
            next(iter(models.values())).arm.joint_names,
            styles=styles_of(["nominal", *(n for n, model in models.items() if not isinstance(model, NominalModel))]),
        ),
        *(
            identification_sections.unidentifiable_section(
                model.excluded_terms_,
                [(one.constants, one.status) for one in identifiability(model.fit_).unidentifiable],
                name=titles[name],
            )
            for name, model in found.items()
        ),
        *(
            identification_sections.outlier_section(_outliers(model, readings, budgets[name][1]), name=titles[name])
            for name, model in found.items()
        ),
    ]
    return [section for section in sections if section is not None]


def _joint_errors(model: IdentifiedModel, readings: Session) -> list[JointError]:
    """The own errors of the joints that turn, over the angles the model learned from."""
    import numpy as np

    from truearm.identification.estimation.diagnostics import joint_error

    found = []
    for joint in (np.flatnonzero(~model.arm.chain.is_prismatic) + 1).tolist():
        read = readings.angles[:, joint - 1]
        highest = joint_error(model.fit_, joint, read[:1], mean_at=read).orders.max(initial=1)
        low, high = model.angle_ranges_[joint - 1]
        n_points = max(int(POINTS_A_WAVE * highest * (high - low) / (2 * np.pi)), 100)
        found.append(joint_error(model.fit_, joint, np.linspace(low, high, n_points), mean_at=read))
    return found


def _outliers(model: IdentifiedModel, readings: Session, found: tuple[Outlier, ...]) -> dict[str, list[Outlier]]:
    """Outliers among the training readings and, where these are others, among the readings of the page."""
    from truearm.identification.estimation.outliers import outliers

    training = outliers(model.fit_)
    if model.is_trained_on(readings):
        return {"the training readings": [outlier.located(readings) for outlier in training]}
    return {"the training readings": training, "the readings of this page": [one.located(readings) for one in found]}


def remarks(model: Compensator, readings: Session) -> list[str]:
    """What must be known of a model before its errors on these readings are believed."""
    from truearm.compensation.models.compensator import MAX_NOMINAL_ERROR
    from truearm.readings import point_errors

    said = []
    if readings.points is not None:
        missed = point_errors(model.predict_nominal_readings(readings), readings.points)["mean_mm"]
        if missed > MAX_NOMINAL_ERROR * model.arm.chain.reach:
            said.append(
                f"The nominal arm misses these points by {missed:.0f} mm: probably they are of another arm or set-up, "
                "or a unit, sign or zero is wrong. Check the session."
            )
    outside = int(model.outside_training(readings.angles).sum())
    if outside:
        said.append(f"{outside} of {len(readings)} readings have a joint away from the training angles.")
    if model.is_trained_on(readings):
        said.append("These are the readings it learned from: an honest test needs others (truearm split).")
    return said


def _names(paths: list[Path]) -> list[str]:
    """A short, different name for each model: its file's stem, or its path where that is taken."""
    stems = [path.stem for path in paths]
    return [str(path) if stems.count(path.stem) > 1 or path.stem == "nominal" else path.stem for path in paths]
