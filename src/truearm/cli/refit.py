"""``truearm refit``: transfer a model to a new set-up of its arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import (
    Json,
    LengthsFile,
    LimitsOption,
    ModelFile,
    check_output_is_not_input,
    free_parts,
    print_record,
    progress,
)


def refit(
    model: ModelFile,
    session: Annotated[
        Path, typer.Argument(metavar="SESSION", help="Session file of the new set-up, with reference points or seats.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Model file to write; the usual ending is .truearm.")],
    free: Annotated[str, typer.Option("--free", help="What is new: base, tip or base,tip.")] = "base,tip",
    rows: Annotated[
        int | None, typer.Option("--rows", min=1, help="Number of readings to use; all by default.")
    ] = None,
    lengths: LengthsFile = None,
    limits: LimitsOption = "skip",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the choice of readings.")] = 0,
    as_json: Json = False,
) -> None:
    """Transfer a model to a new set-up of its arm.

    The tracker was moved, or the probe was changed: the arm stays as it was identified, with its uncertainty; only
    where its base and its tip are is fitted to the new readings. Four readings or more are needed.

    --rows 20 uses 20 readings, of as many positions as possible. The model file records which they were, and truearm
    evaluate skips them in the same session and tests on the others. --free tip: only the probe is new, as with a
    session that has seats and no reference points.
    """
    from truearm.files.atomic_write import check_writable
    from truearm.workflows.refit import refit as refit_model

    parts = free_parts(free)
    check_output_is_not_input(out, session, *([] if lengths is None else [lengths]))
    check_writable(out)
    with progress(f"refitting {model.name}") as report:
        result = refit_model(
            model, session, free=parts, n_readings=rows, seed=seed, lengths=lengths, limits=limits, progress=report
        )
        result.save(out)
    print_record(result, as_json=as_json, files={"model": out})
