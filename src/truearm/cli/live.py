"""``truearm live``: readings of a connected arm, with a page that shows it."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from truearm.cli.console import print_line
from truearm.cli.recording_options import SharedOptions, takes_readings


@takes_readings
def live(
    options: SharedOptions,
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
    from truearm.live_server.live import serve
    from truearm.live_server.live_recording import FRAMES_HZ
    from truearm.live_server.request_checks import RequestChecks
    from truearm.number_format import format_count

    checks = RequestChecks(host, token)
    recording = options.recording(FRAMES_HZ)
    try:
        for event in serve(recording, checks, port):
            print_line(event.text)
    except KeyboardInterrupt:
        print_line(f"{format_count(recording.n_readings, 'reading')} in {recording.out}")
        raise
