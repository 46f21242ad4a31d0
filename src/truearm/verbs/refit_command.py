"""``truearm refit``: transfer a model to a new set-up of its arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_model_output
from truearm.verbs.signature import of_verb


@of_verb("truearm.verbs.refit:refit")
def refit(
    verb: Any,
    model: options.ModelFile,
    session: Annotated[
        Path, Argument(metavar="SESSION", help="Session file of the new set-up, with reference points or seats.")
    ],
    out: options.ModelOut,
    n_readings: Annotated[
        int | None, Option("--rows", min=1, help="Number of readings to use; all by default.")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Transfer a model to a new set-up of its arm.

    The tracker was moved, or the probe was changed: the arm stays as it was identified, with its uncertainty; only
    where its base and its tip are is fitted to the new readings. Four readings or more are needed.

    --rows 20 uses 20 readings, of as many positions as possible. The model file records which they were, and truearm
    evaluate skips them in the same session and tests on the others. --free tip: only the probe is new, as with a
    session that has seats and no reference points.
    """
    check_model_output(out, None, model, session, given["lengths"], force=force)
    with progress(f"refitting {model.name}") as report:
        result = verb(model, session, n_readings=n_readings, **given, progress=report)
        check_model_output(out, result.model.arm_, force=force)
        result.save(out)
    print_record(result, as_json=as_json, files={"model": out})
