"""``truearm compare``: which constants changed between two models of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from truearm.verbs.console import print_record, progress
from truearm.verbs.options import Json


def compare(
    old: Annotated[Path, Argument(metavar="OLD", help="Model file of the arm before.")],
    new: Annotated[Path, Argument(metavar="NEW", help="Model file of the same arm, fitted again.")],
    tip: Annotated[str | None, Option(help="Name of the tip, of models with several.")] = None,
    as_json: Json = False,
) -> None:
    """Compare two models of one arm: which constants changed.

    After a year, a crash or a repair the arm was fitted again, to new readings. A constant changed if its values differ
    by more than the uncertainties of both models explain. The tip's displacement is that inside the arm: a base or a
    tip that was free in the fit is aligned first and reported apart.

    Nominal, kinematic and physical models of the same arm file can be compared.
    """
    from truearm.wings.reports.compare import compare as compare_models

    with progress(f"comparing {old.name} and {new.name}"):
        change = compare_models(old, new, tip=tip)
    print_record(change, as_json=as_json)
