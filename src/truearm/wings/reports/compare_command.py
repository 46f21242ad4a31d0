"""``truearm compare``: which constants changed between two models of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument

from truearm.verbs import options
from truearm.verbs.console import print_record, progress


@options.of_verb("truearm.wings.reports.compare:compare")
def compare(
    verb: Any,
    old: Annotated[Path, Argument(metavar="OLD", help="Model file of the arm before.")],
    new: Annotated[Path, Argument(metavar="NEW", help="Model file of the same arm, fitted again.")],
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Compare two models of one arm: which constants changed.

    After a year, a crash or a repair the arm was fitted again, to new readings. A constant changed if its values differ
    by more than the uncertainties of both models explain. The tip's displacement is that inside the arm: a base or a
    tip that was free in the fit is aligned first and reported apart.

    Nominal, kinematic and physical models of the same arm file can be compared.
    """
    with progress(f"comparing {old.name} and {new.name}"):
        change = verb(old, new, **given)
    print_record(change, as_json=as_json)
