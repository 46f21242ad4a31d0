"""``truearm refit``: a model's arm in a new set-up."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from truearm.cli.console import Json, check_output_is_not_input, print_json, print_line, progress


def refit(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    session: Annotated[
        Path, typer.Argument(metavar="SESSION", help="Session file of the new set-up, with reference points or seats.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Model file to write; .truearm by custom.")],
    free: Annotated[str, typer.Option("--free", help="What is new: base, tip or base,tip.")] = "base,tip",
    rows: Annotated[
        int | None, typer.Option("--rows", min=1, help="Learn from so many of the readings; by default all.")
    ] = None,
    lengths: Annotated[
        Path | None, typer.Option("--lengths", help="File of known lengths between the session's seats, .csv.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the choice of readings.")] = 0,
    as_json: Json = False,
) -> None:
    """Take a model's arm to a new set-up.

    A tracker stands elsewhere, a probe is another one: the arm stays as it was identified, with its uncertainty; only
    where its base stands and its tip sits is fitted to the new readings. Four or more serve.

    --rows 20 takes 20 readings, of as many positions as there are. The model file notes which they were, and truearm
    evaluate on the same session leaves them out: it tests on the others. --free tip: only the probe is new, as with a
    session that has seats and no reference points.
    """
    from dataclasses import asdict, replace

    import numpy as np

    from truearm.cli.fit import free_parts, lengths_of, nominal_miss, note_expansion
    from truearm.cli.predict import check_reference, load_for
    from truearm.compensation.models.compensator import MAX_NOMINAL_ERROR
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.model_file import save_model
    from truearm.compensation.models.refit import refit as refitted
    from truearm.errors import InputError
    from truearm.files.atomic_write import check_writable
    from truearm.identification.estimation.outliers import outliers
    from truearm.readings import stratified_rows

    parts = free_parts(free)
    if not parts:
        raise InputError("with --free none nothing is new", hint="--free base,tip")
    check_output_is_not_input(out, session, *([] if lengths is None else [lengths]))
    check_writable(out)
    with progress(f"reading {session.name}"):
        known, readings = load_for(model, session)
        check_reference(readings, known, purpose="refit to", seats=True)
        which = np.arange(len(readings)) if rows is None else stratified_rows(readings, rows, seed=seed)
        taken = readings.rows(which)
        between = None if lengths is None else lengths_of(lengths, readings, taken)
        note_expansion(between, taken)
    with progress(f"refitting {model.name}") as tell:
        new = refitted(known, taken, free=parts, lengths=between, progress=tell)
        assert isinstance(known, IdentifiedModel)  # a network was refused
        assert isinstance(new, IdentifiedModel)
        missed = nominal_miss(new)
        if not missed < MAX_NOMINAL_ERROR * new.arm.chain.reach:
            raise readings.error(
                f"the arm {new.arm.name!r} as drawn misses its references by {missed:.4g} mm on average: the readings "
                "are not of this arm",
                hint="check the model, and units, signs and zeros in the session",
            )
        save_model(new, out)
    _, covariance = new.predict_readings(readings, return_cov=True)
    std = float(np.median(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))))
    far = [replace(outlier, row=int(which[outlier.row])) for outlier in outliers(new.fit_)]
    if as_json:
        told: dict[str, Any] = {"file": str(out), "free": list(new.free_), "n": len(taken)}
        told |= {"fit_seconds": new.fit_seconds_, "unexplained_std_mm": new.residual_std_}
        told |= {"unexplained_std_before_mm": known.residual_std_, "median_std_mm": std}
        print_json(told | {"outliers": [asdict(outlier) for outlier in far]})
        return
    of = f"{len(taken)} of {len(readings)}" if len(taken) < len(readings) else f"{len(taken)}"
    print_line(f"{out}: {' and '.join(new.free_)} of {new.arm.name} from {of} readings in {new.fit_seconds_:.1f} s")
    if "base" in parts and "base" not in new.free_:
        print_line("The base stays where it was: only reference points say where it stands.")
    unexplained = f"unexplained: {new.residual_std_:.4f} mm, standard deviation of a coordinate"
    if new.residual_std_ > known.residual_std_:
        print_line(f"{unexplained}; {known.residual_std_:.4f} mm before: the new readings scatter more")
    else:
        print_line(f"{unexplained}, as it was")
    print_line(f"standard uncertainty of a coordinate over the session: {std:.4f} mm (median)")
    for outlier in far:
        print_line(
            f"far off: {readings.label(outlier.row)}, {outlier.error_mm:.3f} mm, {outlier.normalized_residual:.0f} times the usual"
        )
    if len(taken) < len(readings):
        print_line("truearm evaluate on this session leaves these readings out and tests on the others.")
