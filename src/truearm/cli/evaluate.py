"""``truearm evaluate``: how far a model's points are from the reference."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import Json, progress, say, say_json, say_table


def evaluate(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    session: Annotated[
        Path, typer.Argument(metavar="SESSION", help="Session file with reference points the model has not seen.")
    ],
    as_json: Json = False,
) -> None:
    """Test a model on readings it has not seen.

    Its errors are printed beside those of the nominal arm: the drawing, its base and tip (where they were free) fitted
    to the model's own training readings.
    """
    from truearm.cli.predict import load_with_reference
    from truearm.cli.report import remarks
    from truearm.models import NominalModel
    from truearm.readings import compared_errors, errors_of

    with progress(f"reading {session.name}"):
        fitted, readings = load_with_reference(model, session, purpose="evaluate against")
    assert readings.points is not None  # checked
    nominal = fitted.predict_nominal(readings.angles)
    errors = compared_errors(fitted.predict(readings.angles), nominal, readings.points)
    if as_json:
        say_json(dict(errors))
        return
    columns = {"nominal": errors_of(nominal, readings.points)}
    if not isinstance(fitted, NominalModel):
        columns["model"] = errors
    rows = [[name, *(f"{c[name]:.4f}" for c in columns.values())] for name in errors if name.endswith("_mm")]  # type: ignore[literal-required]
    say_table([f"{errors['n']} readings", *columns], rows)
    if "model" in columns:
        say(_compared(errors["removed_percent"]))
    for remark in remarks(fitted, readings):
        say(remark)


def _compared(removed_percent: float) -> str:
    if -5 < removed_percent < 0:
        return "no better than the nominal arm"
    if removed_percent < 0:
        return f"worse than the nominal arm: {1 - removed_percent / 100:.1f} times its mean absolute coordinate error"
    return f"{removed_percent:.1f} % of the mean absolute coordinate error removed"
