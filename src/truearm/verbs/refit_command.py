"""``truearm refit``: transfer a model to a new set-up of its arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from truearm.verbs.console import print_record, progress
from truearm.verbs.options import (
    AcceptOption,
    Json,
    LengthsFile,
    LimitsOption,
    ModelFile,
    ModelForce,
    ModelOut,
    free_parts,
)
from truearm.verbs.outputs import check_model_output


def refit(
    model: ModelFile,
    session: Annotated[
        Path, Argument(metavar="SESSION", help="Session file of the new set-up, with reference points or seats.")
    ],
    out: ModelOut,
    free: Annotated[str, Option(help="What is new: base, tip or base,tip.")] = "base,tip",
    rows: Annotated[int | None, Option(min=1, help="Number of readings to use; all by default.")] = None,
    lengths: LengthsFile = None,
    limits: LimitsOption = "skip",
    accept: AcceptOption = None,
    seed: Annotated[int, Option(min=0, help="Seed of the choice of readings.")] = 0,
    force: ModelForce = False,
    as_json: Json = False,
) -> None:
    """Transfer a model to a new set-up of its arm.

    The tracker was moved, or the probe was changed: the arm stays as it was identified, with its uncertainty; only
    where its base and its tip are is fitted to the new readings. Four readings or more are needed.

    --rows 20 uses 20 readings, of as many positions as possible. The model file records which they were, and truearm
    evaluate skips them in the same session and tests on the others. --free tip: only the probe is new, as with a
    session that has seats and no reference points.
    """
    from truearm.verbs.refit import refit as refit_model

    parts = free_parts(free)
    check_model_output(out, None, model, session, lengths, force=force)
    with progress(f"refitting {model.name}") as report:
        result = refit_model(
            model,
            session,
            free=parts,
            n_readings=rows,
            seed=seed,
            lengths=lengths,
            limits=limits,
            accept=accept,
            progress=report,
        )
        check_model_output(out, result.model.arm_, force=force)
        result.save(out)
    print_record(result, as_json=as_json, files={"model": out})
