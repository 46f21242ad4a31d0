"""``truearm record``: readings of a connected arm, taken when it stands still."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from math import radians
from pathlib import Path
from typing import Annotated

from typer import Option

from truearm.choices import TakeOn
from truearm.cli.console import print_line
from truearm.cli.options import ARM_HELP


def record(
    source: Annotated[str, Option(help="Where the angles come from: KIND:ADDRESS, as truearm sources lists them.")],
    out: Annotated[Path, Option(help="Session file, .csv; one with the same columns is continued.")],
    plan: Annotated[Path | None, Option(help="Plan of truearm plan: seats, instructions, what remains.")] = None,
    arm: Annotated[str | None, Option("--arm", help=ARM_HELP)] = None,
    reference: Annotated[
        str | None, Option(help="What measures the tip, if not the source: another source, paired by time, or typed.")
    ] = None,
    on: Annotated[TakeOn, Option(help="Take a reading at every standstill, or by key or the arm's button.")] = "still",
    seat: Annotated[str, Option(help="Name of the seat of the first readings; by default the plan's.")] = "",
    still: Annotated[float, Option(help="For how long the arm stands still before a reading is taken [s].")] = 0.5,
    spread: Annotated[float, Option(help="By how much a joint moves at most in that time [deg].")] = 0.05,
    spread_mm: Annotated[float, Option(help="By how much a sliding joint moves at most [mm].")] = 0.05,
    headless: Annotated[
        bool, Option("--headless", help="Print events as JSON lines, and read commands from standard input.")
    ] = False,
) -> None:
    """Take readings of a connected arm into a session file, which every command reads while it grows.

    A reading is the mean of the samples of a standstill, taken once until the arm moves again. It is on the disk before
    it is said. Keys: space takes a reading, m one of a moving arm, u undoes the last, s names the seat, p types the
    reference point, n skips a pose of the plan, q ends.

    With --headless these are lines on standard input: take, take moving, undo, seat NAME, point X Y Z, skip, end.
    """
    from truearm.sources import StandstillRule
    from truearm.workflows.recording import record as recorded

    commands = _lines() if headless else None
    events = recorded(
        source,
        out,
        arm=arm,
        plan=plan,
        reference=reference,
        rule=StandstillRule(still, radians(spread), spread_mm),
        on=on,
        seat=seat,
        commands=commands,
    )
    for event in events:
        print_line(json.dumps(event.to_dict(), allow_nan=False) if headless else event.text)
        sys.stdout.flush()


def _lines() -> Iterator[str]:
    """Commands on standard input."""
    for line in sys.stdin:
        if line.strip():
            yield line
