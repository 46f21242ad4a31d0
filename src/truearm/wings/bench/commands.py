"""The commands of connected arms: sources, record and live."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer
from typer import Context, Option

from truearm.errors import InputError
from truearm.printable_text import printable
from truearm.verbs import options
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_new_output
from truearm.wings.bench.recording import TakeOn

if TYPE_CHECKING:
    from truearm.wings.bench.recording.recording import Recording


def sources(
    context: typer.Context,
    source: Annotated[
        str | None, Option("--try", metavar="SOURCE", help="Read this source and show ten samples.")
    ] = None,
    arm: options.ArmOption = None,
    seconds: Annotated[float, Option(min=0.1, max=600, help="With --try: for how long.")] = 5.0,
    out: Annotated[
        Path | None, Option(help="With --try: arm file to write, .toml, with the constants that a MicroScribe states.")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """List what can be connected, or say what is wrong with it.

    --try prints ten samples and what is probably wrong. Move every joint while it runs. It finds joints that never
    move, units by the size of the angles, and with --arm signs and zeros by the limits of the joints. Without a sample
    the exit code is 1.
    """
    from truearm.arm import write_arm
    from truearm.wings.bench.recording.sources import list_sources, try_source
    from truearm.wings.bench.sources.source_names import read_source_arm

    if source is None:
        options.refuse_typed(context, ["arm", "seconds", "out", "force"], "applies to --try only")
        print_record(list_sources(), as_json=as_json)
        return
    if out is not None:
        check_new_output(out, force=force)
        write_arm(read_source_arm(source), out, convention="mdh")
    with progress(f"reading {source}: move every joint"):
        trial = try_source(source, arm=arm, seconds=seconds)
    print_record(trial, as_json=as_json, files={"arm": out})
    if not trial.samples:
        raise typer.Exit(1)


SOURCE_HELP = "Where the angles come from: KIND:ADDRESS, as truearm sources lists them."
OUT_HELP = "Session file, .csv; one with the same columns is continued."


@dataclass(frozen=True)
class SharedOptions:
    """The options that these commands share: each attribute is one, with its help."""

    source: Annotated[str, Option(help=SOURCE_HELP)]
    out: Annotated[Path, Option(help=OUT_HELP)]
    plan: options.PlanFile = None
    rank: Annotated[
        bool, Option("--rank", help="Next is the pose that adds most: of the plan, or without one of all in reach.")
    ] = False
    arm: options.ArmOption = None
    model: Annotated[
        Path | None, Option("--model-file", help="Model file: shows the corrected tip with its uncertainty.")
    ] = None
    out_model: options.FittedModelOut = None
    reference: Annotated[
        str | None, Option(help="What measures the tip, if not the source: another source, paired by time, or typed.")
    ] = None
    on: Annotated[TakeOn, Option(help="Take a reading at every standstill, or by key or the arm's button.")] = "still"
    seat: Annotated[str, Option(help="Name of the seat of the first readings; by default the plan's.")] = ""
    still: options.Still = 0.5
    spread: Annotated[float, Option(help="By how much a joint moves at most in that time [deg].")] = 0.05
    spread_mm: Annotated[float, Option(help="By how much a sliding joint moves at most [mm].")] = 0.05

    def recording(self, samples_hz: float) -> Recording:
        """The recording of these options; its samples are events `samples_hz` times a second."""
        from truearm.wings.bench.recording.recording import Recording
        from truearm.wings.bench.sources import StandstillRule

        stated = {one.name: getattr(self, one.name) for one in fields(self)}
        still, spread, spread_mm = (stated.pop(name) for name in ("still", "spread", "spread_mm"))
        rule = StandstillRule(still, radians(spread), spread_mm)
        return Recording(**stated, rule=rule, samples_hz=samples_hz)


@options.with_shared
def record(
    given: SharedOptions,
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

    recording = given.recording(samples if headless else 0.0)
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


@dataclass(frozen=True)
class LiveOptions(SharedOptions):
    """The options of a recording, of which the demonstration takes none."""

    source: Annotated[str, Option(help=SOURCE_HELP, show_default=False)] = ""
    out: Annotated[Path, Option(help=OUT_HELP, show_default=False)] = Path()


@options.with_shared
def live(
    given: LiveOptions,
    context: Context,
    demo: Annotated[
        bool,
        Option("--demo", help="A virtual arm with errors, steered on the page, with a plan, in a temporary folder."),
    ] = False,
    host: Annotated[
        str, Option(help="Address to listen on; another than this computer's own needs a token.")
    ] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="Port to listen on; 0: a free one.")] = 8640,
    token: Annotated[
        str, Option(help="Whoever opens the page must know it; at least 16 characters.", envvar="TRUEARM_TOKEN")
    ] = "",
) -> None:
    """Take readings of a connected arm, and see it on a page.

    Readings are taken as by truearm record. The page in the browser shows the arm as it moves, the corrected tip,
    the readings, how well the arm is known with them, the angles covered and the next pose. The first page that is
    opened takes, undoes, names seats, skips poses, fits and saves a model; others show, and may ask for that. Ctrl-C
    ends.
    """
    from truearm.wings.bench.live_server.live import FRAMES_HZ, serve
    from truearm.wings.bench.live_server.request_checks import RequestChecks

    checks = RequestChecks(host, token)
    if demo:
        recording = _demo(context, FRAMES_HZ)
    elif not given.source or given.out == Path():
        raise InputError("expected --source and --out", hint="truearm live --demo, without hardware")
    else:
        recording = given.recording(FRAMES_HZ)
    try:
        for event in serve(recording, checks, port):
            print_line(event.text)
    except KeyboardInterrupt:
        print_line(recording.end().text)
        raise


def _demo(context: Context, samples_hz: float) -> Recording:
    from truearm.wings.bench.recording.record_readings import demo_recording
    from truearm.wings.planning.designs import Strategy

    options.refuse_typed(context, [option.name for option in fields(LiveOptions)], "does not apply to --demo")
    with progress("planning the demonstration", total=len(get_args(Strategy))) as tell:
        folder = Path(tempfile.mkdtemp(prefix="truearm-"))  # it stays: a session and a model are worth keeping
        recording = demo_recording(folder, samples_hz=samples_hz, progress=tell)
    print_line(
        "On the page, g brings the arm to the next pose, where it takes a reading; after a dozen, r fits a model."
    )
    return recording
