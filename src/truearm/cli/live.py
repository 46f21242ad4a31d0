"""``truearm live``: readings of a connected arm, with a page that shows it."""

from __future__ import annotations

import tempfile
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

from typer import Context, Option

from truearm.choices import Strategy
from truearm.cli.console import print_line, progress
from truearm.cli.options import (
    RECORDED_HELP,
    SOURCE_HELP,
    FirstSeat,
    LiveModel,
    OutModelOption,
    RankOption,
    RecordedArm,
    RecordedPlan,
    ReferenceOption,
    StillSpread,
    StillSpreadMm,
    StillTime,
    TakeOption,
    refuse_typed,
)
from truearm.errors import InputError

if TYPE_CHECKING:
    from truearm.live.request_checks import RequestChecks
    from truearm.workflows.recording import Recording

NOT_IN_A_DEMO = (
    *("source", "out", "plan", "rank", "arm", "model", "out_model"),
    *("reference", "on", "seat", "still", "spread", "spread_mm"),
)


def live(
    context: Context,
    source: Annotated[str | None, Option(help=SOURCE_HELP)] = None,
    out: Annotated[Path | None, Option(help=RECORDED_HELP)] = None,
    demo: Annotated[
        bool,
        Option("--demo", help="A virtual arm with errors, steered on the page, with a plan, in a temporary folder."),
    ] = False,
    plan: RecordedPlan = None,
    rank: RankOption = False,
    arm: RecordedArm = None,
    model: LiveModel = None,
    out_model: OutModelOption = None,
    reference: ReferenceOption = None,
    on: TakeOption = "still",
    seat: FirstSeat = "",
    still: StillTime = 0.5,
    spread: StillSpread = 0.05,
    spread_mm: StillSpreadMm = 0.05,
    host: Annotated[
        str, Option(help="Address to listen on; another than this computer's own needs a token.")
    ] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="Port to listen on; 0: a free one.")] = 8640,
    token: Annotated[
        str, Option(envvar="TRUEARM_TOKEN", show_envvar=True, help="Whoever opens the page must know it.")
    ] = "",
) -> None:
    """Take readings of a connected arm, and see it on a page.

    Readings are taken as by truearm record. The page in the browser shows the arm as it moves, the corrected tip,
    the readings, how well the arm is known with them, the angles covered and the next pose. The first page that is
    opened takes, undoes, names seats, skips poses, fits and saves a model; others only show. Ctrl-C ends.
    """
    from truearm.live.live_recording import FRAMES_HZ
    from truearm.live.request_checks import RequestChecks
    from truearm.sources import StandstillRule
    from truearm.workflows.record_readings import recording_of

    checks = RequestChecks(host, token)
    with tempfile.TemporaryDirectory(prefix="truearm-") as folder:
        if demo:
            recording = _demo(context, Path(folder))
        elif source is None or out is None:
            raise InputError("expected --source and --out", hint="truearm live --demo, without hardware")
        else:
            recording = recording_of(
                source,
                out,
                arm=arm,
                plan=plan,
                rank=rank,
                model=model,
                out_model=out_model,
                reference=reference,
                rule=StandstillRule(still, radians(spread), spread_mm),
                on=on,
                seat=seat,
                samples_hz=FRAMES_HZ,
            )
        _serve(recording, checks, port)


def _demo(context: Context, folder: Path) -> Recording:
    from truearm.live.live_recording import FRAMES_HZ
    from truearm.workflows.live_demo import demo_recording

    refuse_typed(context, NOT_IN_A_DEMO, "does not apply to --demo")
    with progress("planning the demonstration", total=len(get_args(Strategy))) as tell:
        return demo_recording(folder, samples_hz=FRAMES_HZ, progress=tell)


def _serve(recording: Recording, checks: RequestChecks, port: int) -> None:
    from truearm.live.drawn_arm import drawn_arm
    from truearm.live.live_page import live_page
    from truearm.live.live_recording import LiveRecording
    from truearm.live.server import LiveServer
    from truearm.number_format import format_count

    drawn = drawn_arm(recording.arm, recording.model)
    with LiveServer(live_page(recording, drawn), checks, port) as server:
        print_line(f"Open {server.url} in a browser; Ctrl-C ends.")
        try:
            for event in LiveRecording(recording, drawn).follow(server):
                print_line(event.text)
        except KeyboardInterrupt:
            print_line(f"{format_count(recording.n_readings, 'reading')} in {recording.out}")
            raise
