"""``truearm record``: readings of a connected arm, taken when it stands still."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated

from typer import Option

from truearm.errors import InputError
from truearm.printable_text import printable
from truearm.verbs.console import print_line
from truearm.wings.bench.recording_options import SharedOptions, takes_readings

if TYPE_CHECKING:
    from truearm.wings.bench.recording.recording import Recording


@takes_readings
def record(
    options: SharedOptions,
    samples: Annotated[float, Option(min=0, max=1000, help="With --headless: angles so often a second, too.")] = 0.0,
    headless: Annotated[
        bool, Option("--headless", help="Print events as JSON lines, and read commands from standard input.")
    ] = False,
) -> None:
    """Take readings of a connected arm into a session file.

    Every command reads the file while it grows. A reading is the mean of the samples of a standstill, taken once
    until the arm moves again. It is in the file before it is said. Keys: space takes a reading, m one of a moving
    arm, u undoes the last, s names the seat, p types the reference point, n skips a pose of the plan,
    r fits a model to the readings, w writes it to --out-model, q ends.

    With --headless these are lines on standard input: take, take moving, undo, seat NAME, point X Y Z, skip,
    refit, save, end.
    """
    from truearm.wings.bench.recording.record_readings import follow

    recording = options.recording(samples if headless else 0.0)
    if headless:
        for event in follow(recording, _lines(recording)):
            print_line(json.dumps(event.to_dict(), allow_nan=False))
            sys.stdout.flush()
    elif sys.stdin is not None and sys.stdin.isatty() and sys.stdout is not None and sys.stdout.isatty():
        _record_in_terminal(recording)
    else:
        raise InputError("taking readings needs a terminal", hint="--headless prints JSON lines and reads commands")


def _record_in_terminal(recording: Recording) -> None:
    from rich.console import Console
    from rich.live import Live

    from truearm.wings.bench.recording.record_readings import follow
    from truearm.wings.bench.recording_view import RecordingView, pressed_keys

    view, console = RecordingView(recording), Console(highlight=False)
    with (
        pressed_keys() as keys,
        Live(view, console=console, refresh_per_second=10, transient=True, redirect_stdout=False) as live,
    ):
        for event in follow(recording, view.commands(keys)):
            view.add(event)
            if event.kind in ("reading", "undone"):
                live.console.print(printable(event.text), markup=False)
    print_line(event.text)


def _lines(recording: Recording) -> Iterator[str]:
    """Commands on standard input, unless the angles come from there."""
    from truearm.wings.bench.sources.connections import connector
    from truearm.wings.bench.sources.line_pattern import lines_of

    if sys.stdin is None or recording.source.name.endswith("@stdin"):
        return
    with suppress(EOFError):
        yield from filter(None, lines_of(connector("stdin")()))
