"""``truearm evaluate``: how far a model's points are from the reference, or from each other in their seats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from truearm.choices import Conditions
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.signature import of_verb


@of_verb("truearm.verbs.evaluate:evaluate")
def evaluate(
    verb: Any,
    context: typer.Context,
    model: options.ModelFile,
    session: Annotated[
        Path,
        Argument(
            metavar="SESSION",
            help="Session file with reference points or seats, or folder of files; not the training session.",
        ),
    ],
    conditions: Annotated[
        Conditions | None,
        Option(
            help="Conditions of these readings: the day and set-up of the training (repeatability), or others "
            "(reproducibility). By default what the column session says."
        ),
    ] = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Test a model on readings it was not fitted to.

    The nominal arm is evaluated beside it, with base and tip (where they were free) fitted to the model's own training
    readings. Readings with a reference point are compared with it; readings in a seat with the mean of the points
    predicted there; the distance between two such means with the known length. Readings from which truearm refit
    identified base and tip are skipped. The coverage is stated for both conditions of the uncertainty, with the one
    that applies.

    A folder of session files, or a file beyond 512 MB, is read part by part, and --workers or --scheduler shares the
    parts out; only its reference points are compared (docs/large-sessions.md).
    """
    executor = options.executor_of(context, session, workers, scheduler)
    with progress(f"evaluating {session.name}") as update:
        evaluation = verb(model, session, conditions=conditions, **given, executor=executor, progress=update)
    print_record(evaluation, as_json=as_json)
