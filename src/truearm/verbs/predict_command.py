"""``truearm predict``: corrected coordinates with uncertainties, from angles alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.verbs.console import print_record, progress
from truearm.verbs.options import (
    AcceptOption,
    ConditionsOption,
    Json,
    ModelFile,
    SchedulerOption,
    WorkersOption,
    executor_of,
)


def predict(
    context: typer.Context,
    model: ModelFile,
    session: Annotated[
        Path,
        Argument(
            metavar="SESSION",
            help="Session file, or folder of files; its angles, and temperature, payload_kg, loads, directions and tip "
            "if there, are used.",
        ),
    ],
    out: Annotated[Path | None, Option(help="Table of points to write, .csv or .parquet.")] = None,
    into: Annotated[str | None, Option(hidden=True)] = None,
    conditions: ConditionsOption = "reproducibility",
    accept: AcceptOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    as_json: Json = False,
) -> None:
    """Compensate: turn joint angles into corrected coordinates.

    Columns of the table: x_mm, y_mm, z_mm in the frame of the reference, after a fit to several sessions in that of the
    reading's session; sx_mm, sy_mm, sz_mm their standard uncertainties (twice that is the expanded uncertainty, k = 2);
    outside_training 1 where a reading is outside the range that the model was trained on; names (seat, position, ..) as
    given.

    A folder of session files, or a file beyond 512 MB, is read part by part, and --workers or --scheduler shares the
    parts out (docs/large-sessions.md).
    """
    from truearm.verbs.predict import predict as predict_points

    if into is not None:
        raise InputError("--into is a command now", hint="truearm verify fill MODEL SESSION --into points.csv")
    if out is None:
        raise InputError("expected --out", hint="--out points.csv")
    executor = executor_of(context, session, workers, scheduler)
    with progress(f"predicting {session.name}") as update:
        prediction = predict_points(
            model, session, out, conditions=conditions, accept=accept, executor=executor, progress=update
        )
    print_record(prediction, as_json=as_json, files={"points": out})
