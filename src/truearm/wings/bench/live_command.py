"""`truearm live`: take readings of a connected arm, with a page that shows it."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

from typer import Context, Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.console import print_line, progress
from truearm.wings.bench.recording_options import OUT_HELP, SOURCE_HELP, SharedOptions, takes_readings
from truearm.wings.planning.designs import Strategy

if TYPE_CHECKING:
    from truearm.wings.bench.recording.recording import Recording


@dataclass(frozen=True)
class LiveOptions(SharedOptions):
    """The options of a recording, of which the demonstration takes none."""

    source: Annotated[str, Option(help=SOURCE_HELP, show_default=False)] = ""
    out: Annotated[Path, Option(help=OUT_HELP, show_default=False)] = Path()


@takes_readings
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
    from truearm.wings.bench.recording.live_demo import demo_recording

    options.refuse_typed(context, [option.name for option in fields(LiveOptions)], "does not apply to --demo")
    with progress("planning the demonstration", total=len(get_args(Strategy))) as tell:
        folder = Path(tempfile.mkdtemp(prefix="truearm-"))  # it stays: a session and a model are worth keeping
        recording = demo_recording(folder, samples_hz=samples_hz, progress=tell)
    print_line(
        "On the page, g brings the arm to the next pose, where it takes a reading; after a dozen, r fits a model."
    )
    return recording
