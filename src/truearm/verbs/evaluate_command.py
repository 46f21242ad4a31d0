"""``truearm evaluate``: how far a model's points are from the reference, or from each other in their seats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from truearm.choices import Conditions
from truearm.verbs.console import print_record, progress
from truearm.verbs.options import (
    LARGE_ONLY,
    ONLY_LARGE,
    AcceptOption,
    Json,
    LengthsFile,
    LimitsOption,
    ModelFile,
    SchedulerOption,
    WorkersOption,
    refuse_typed,
)


def evaluate(
    context: typer.Context,
    model: ModelFile,
    session: Annotated[
        Path,
        Argument(
            metavar="SESSION",
            help="Session file with reference points or seats, or folder of files; not the training session.",
        ),
    ],
    lengths: LengthsFile = None,
    limits: LimitsOption = "skip",
    conditions: Annotated[
        Conditions | None,
        Option(
            help="Conditions of these readings: the day and set-up of the training (repeatability), or others. By "
            "default what the column session says."
        ),
    ] = None,
    accept: AcceptOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    as_json: Json = False,
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
    from truearm.readings.large_sessions import is_large
    from truearm.verbs.evaluate import evaluate as evaluate_model

    if is_large(session):
        from truearm.solve.executors import chosen_executor  # no small session waits for these
        from truearm.verbs.evaluate_large import evaluate_large

        refuse_typed(context, ("lengths",), "does not apply to large sessions")
        with progress(f"evaluating {session.name}") as update:
            large = evaluate_large(
                model,
                session,
                limits=limits,
                conditions=conditions,
                accept=accept,
                executor=chosen_executor(workers, scheduler),
                progress=update,
            )
        print_record(large, as_json=as_json)
        return
    refuse_typed(context, LARGE_ONLY, ONLY_LARGE)
    with progress(f"evaluating {session.name}"):
        evaluation = evaluate_model(
            model, session, lengths=lengths, limits=limits, conditions=conditions, accept=accept
        )
    print_record(evaluation, as_json=as_json)
