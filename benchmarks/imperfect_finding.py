"""A row of the page on imperfect readings: what goes wrong, what is wanted, and what was measured now."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from machine import arguments_of, print_json, print_table, say_machine


@dataclass(frozen=True)
class Finding:
    """One row.

    Attributes
    ----------
    what, wanted, now : str
        The imperfection, the target, and the number measured.
    is_met : bool or None
        None where nothing is judged.
    """

    what: str
    wanted: str
    now: str
    is_met: bool | None


def print_findings(about: str | None, rows: Callable[..., Sequence[Finding]]) -> None:
    """Measure the rows of one benchmark and print them; `--quick` measures fewer arms."""
    parser: argparse.ArgumentParser = arguments_of(about)
    parser.add_argument("--quick", action="store_true", help="fewer arms")
    options = parser.parse_args()
    found = list(rows(quick=options.quick))
    if options.json:
        print_json({"rows": [asdict(row) for row in found]}, [])
        return
    say_machine()
    print()
    marks = {True: "met", False: "missed", None: ""}
    print_table(["seen", "wanted", "measured", ""], [[r.what, r.wanted, r.now, marks[r.is_met]] for r in found])
