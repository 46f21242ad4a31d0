"""What happens to a device is said on the stream of the live page: garbage, silence, a restart, a clock that jumps."""

import json
import queue
import threading
import time
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from devices import tcp_device

import truearm as ta
from truearm.wings.bench.sources import connections

client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")

FILE = """connection = "tcp:127.0.0.1:{port}"
pattern = "{{time_s}} {{J1}} {{J2}} {{J3}} {{J4}} {{J5}} {{J6}}"
"""


class Device:
    """A device that a test steers: it sends a line every 10 ms, by its own clock, unless it is silent.

    Parameters
    ----------
    start_s : float
        Of its clock.
    """

    def __init__(self, start_s: float) -> None:
        self.clock_s, self.is_silent, self.said = start_s, threading.Event(), queue.Queue()
        self.pulled = threading.Event()

    def __call__(self, connection) -> None:
        while not self.pulled.wait(0.01):
            self.clock_s += 0.01
            if not self.said.empty():
                connection.sendall(self.said.get())
            if not self.is_silent.is_set():
                connection.sendall(f"{self.clock_s:.2f} 0 -90 90 0 90 0\n".encode())


def notice_with(page, text):
    """Wait until the stream of the page says this."""
    until_s = time.monotonic() + 10
    while time.monotonic() < until_s:
        said = json.loads(page.recv(timeout=10))
        if text in said.get("event", {}).get("text", ""):
            return said
    raise AssertionError(f"{text!r} was not said")


@contextmanager
def page_of(tmp_path, *devices):
    """The stream of the page of devices, one after the other; the events end with the test."""
    with tcp_device(*devices) as port, ExitStack() as ends:
        (tmp_path / "arm.toml").write_text(FILE.format(port=port))
        events = ta.live(f"lines:{tmp_path / 'arm.toml'}", tmp_path / "out.csv", arm="ur10", port=0, on="key")
        url, ended = next(events).values["url"], threading.Event()
        reader = threading.Thread(target=lambda: [*iter_until(events, ended)])
        reader.start()
        ends.callback(reader.join)
        for device in devices:
            ends.callback(device.pulled.set)  # whose loss is an event, the last one
        ends.callback(ended.set)
        yield ends.enter_context(client.connect(f"ws{url.removeprefix('http')}live", proxy=None))


def test_what_is_lost_is_on_the_stream_and_comes_back(tmp_path, monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.05)
    first, second = Device(1000.0), Device(5.0)
    with page_of(tmp_path, first, second) as page:
        for _ in range(3):  # a step is late by the step before it: of one sample there is none
            while json.loads(page.recv(timeout=10))["message"] != "pose":
                pass
        first.said.put(b"\xff\xfegarbage\n" * 3)
        notice_with(page, "lines do not fit the pattern")
        first.is_silent.set()
        notice_with(page, "nothing was received for a second")
        first.clock_s += 360_000  # the seconds of silence, which its clock counts too, are none of the digits
        first.is_silent.clear()
        notice_with(page, "jumps by +3.6e+05 s")
        first.pulled.set()
        notice_with(page, "no connection to tcp:")
        notice_with(page, "connected to tcp:")
        notice_with(page, "; the standstill begins again")  # the clock of the restarted device
        page.send(json.dumps({"command": "take"}))
        notice_with(page, "reading 1")
    assert ta.read_session(tmp_path / "out.csv").angles == pytest.approx(np.radians([[0, -90, 90, 0, 90, 0]]))


def iter_until(events, ended):
    """The events until a test has seen what it wants."""
    for event in events:
        yield event
        if ended.is_set():
            events.close()
            return
