"""``truearm predict``: corrected coordinates with uncertainties, from angles alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.signature import of_verb


@of_verb("truearm.verbs.predict:predict")
def predict(
    verb: Any,
    context: typer.Context,
    model: options.ModelFile,
    session: Annotated[
        Path,
        Argument(
            metavar="SESSION",
            help="Session file, or folder of files; its angles, and temperature, payload_kg, loads, directions and tip "
            "if there, are used.",
        ),
    ],
    out: Annotated[Path, Option(help="Table of points to write, .csv or .parquet.")],
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Compensate: turn joint angles into corrected coordinates.

    Columns of the table: x_mm, y_mm, z_mm in the frame of the reference, after a fit to several sessions in that of the
    reading's session; sx_mm, sy_mm, sz_mm their standard uncertainties (twice that is the expanded uncertainty, k = 2);
    outside_training 1 where a reading is outside the range that the model was trained on; names (seat, position, ..) as
    given.

    A folder of session files, or a file beyond 512 MB, is read part by part, and --workers or --scheduler shares the
    parts out (docs/large-sessions.md).
    """
    executor = options.executor_of(context, session, workers, scheduler)
    with progress(f"predicting {session.name}") as update:
        prediction = verb(model, session, out, **given, executor=executor, progress=update)
    print_record(prediction, as_json=as_json, files={"points": out})
