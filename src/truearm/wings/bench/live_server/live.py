"""`live`: readings of a connected arm, with a page that shows it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Unpack

from truearm.wings.bench.live_server.drawn_arm import drawn_arm
from truearm.wings.bench.live_server.http_operations import HttpOperations
from truearm.wings.bench.live_server.live_page import live_page
from truearm.wings.bench.live_server.live_recording import FRAMES_HZ, LiveRecording
from truearm.wings.bench.live_server.request_checks import RequestChecks
from truearm.wings.bench.live_server.server import LiveServer
from truearm.wings.bench.recording.recording import Recording, RecordingOptions
from truearm.wings.bench.recording.recording_event import Event
from truearm.wings.bench.sources import Source


def live(
    source: str | Source,
    out: str | Path,
    *,
    host: str = "127.0.0.1",
    port: int = 8640,
    token: str = "",
    **options: Unpack[RecordingOptions],
) -> Iterator[Event]:
    """Take readings of a connected arm as `record` does, and show it on a page that a browser opens.

    Other programs read the WebSocket and the HTTP operations of the same address (docs/live.md). Readings are taken,
    and the page is served, while the events are iterated over.

    Parameters
    ----------
    source, out
        As of `record`.
    host : str
        Address to listen on; one that other computers reach needs a token.
    port : int
        Port to listen on; 0: a free one.
    token : str
        Whoever opens the page must know it; at least 16 characters.
    arm, plan, reference, rule, on, seat, model, rank, out_model : optional
        As of `record`; the page needs `arm` or `model`.

    Yields
    ------
    Event
        Those of `record`. The first has the address of the page, ``event.values["url"]``.

    Raises
    ------
    InputError
        If the source, the plan or the file cannot be used, there is no arm, an address that other computers reach has
        no token, or the package websockets is missing.
    TruearmError
        If the port cannot be opened, or a reading cannot be written.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.simulate("ur10", poses=3, seed=1).session.save("simulated.csv")
    >>> events = ta.live("replay:simulated.csv@max", "session.csv", arm="ur10", port=0)
    >>> next(events).values["url"]
    'http://127.0.0.1:.../'
    >>> [event.kind for event in events]
    ['ready', 'reading', 'reading', 'learned', 'reading', 'learned', 'notice', 'end']
    """
    return serve(Recording(source, out, samples_hz=FRAMES_HZ, **options), RequestChecks(host, token), port)


def serve(recording: Recording, checks: RequestChecks, port: int) -> Iterator[Event]:
    """The events of a recording with `FRAMES_HZ` samples a second, while its page is served; see `live`."""
    drawn = drawn_arm(recording.arm, recording.model)
    shown = LiveRecording(recording, drawn)
    operations = HttpOperations(recording, shown.newest_pose)
    with LiveServer(live_page(recording, drawn), checks, port, operations) as server:
        yield Event("notice", f"Open {server.url} in a browser; Ctrl-C ends.", {"url": server.url})
        yield from shown.follow(server)
