"""``truearm live``: readings of a connected arm, with a page that shows it."""

from __future__ import annotations

from math import radians
from typing import Annotated

from typer import Option

from truearm.cli.console import print_line
from truearm.cli.options import (
    FirstSeat,
    LiveModel,
    RankOption,
    RecordedArm,
    RecordedFile,
    RecordedPlan,
    ReferenceOption,
    SourceOption,
    StillSpread,
    StillSpreadMm,
    StillTime,
    TakeOption,
)


def live(
    source: SourceOption,
    out: RecordedFile,
    plan: RecordedPlan = None,
    rank: RankOption = False,
    arm: RecordedArm = None,
    model: LiveModel = None,
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
    the readings, the angles covered and the next pose of the plan. The first page that is opened takes, undoes,
    names seats and skips poses; others only show. Ctrl-C ends.
    """
    from truearm.live.drawn_arm import drawn_arm
    from truearm.live.live_page import live_page
    from truearm.live.live_recording import FRAMES_HZ, LiveRecording
    from truearm.live.request_checks import RequestChecks
    from truearm.live.server import LiveServer
    from truearm.number_format import format_count
    from truearm.sources import StandstillRule
    from truearm.workflows.record_readings import recording_of

    checks = RequestChecks(host, token)
    recording = recording_of(
        source,
        out,
        arm=arm,
        plan=plan,
        rank=rank,
        model=model,
        reference=reference,
        rule=StandstillRule(still, radians(spread), spread_mm),
        on=on,
        seat=seat,
        samples_hz=FRAMES_HZ,
    )
    drawn = drawn_arm(recording.arm, recording.model)
    with LiveServer(live_page(recording, drawn), checks, port) as server:
        print_line(f"Open {server.url} in a browser; Ctrl-C ends.")
        try:
            for event in LiveRecording(recording, drawn).follow(server):
                print_line(event.text)
        except KeyboardInterrupt:
            print_line(f"{format_count(recording.n_readings, 'reading')} in {out}")
            raise
