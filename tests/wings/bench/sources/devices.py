"""Devices that exist in a thread: what a test writes to a socket or a pseudo terminal, and what it answers."""

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from itertools import islice

from truearm.wings.bench.sources import Notice, Sample, Source

Serve = Callable[[socket.socket], None]


@contextlib.contextmanager
def tcp_device(*serve: Serve, host: str = "127.0.0.1", port: int = 0) -> Iterator[int]:
    """A server on a port of this computer; its first client meets the first function, the last one all others."""
    server = socket.create_server((host, port))
    server.settimeout(0.05)
    ends = threading.Event()

    def run() -> None:
        number = 0
        while not ends.is_set():
            try:
                client, _ = server.accept()
            except TimeoutError:
                continue
            with client, contextlib.suppress(OSError):
                client.settimeout(60)
                serve[min(number, len(serve) - 1)](client)
            number += 1

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield server.getsockname()[1]
    finally:
        ends.set()
        thread.join(90)
        server.close()
        assert not thread.is_alive()


def samples_of(source: Source, n: int, most_notices: int = 20) -> tuple[list[Sample], list[str]]:
    """The first `n` samples of a source, and the notices before them."""
    samples, notices = [], []
    for one in islice(source.samples(), n + most_notices):
        if isinstance(one, Notice):
            notices.append(one.text)
        else:
            samples.append(one)
        if len(samples) == n:
            return samples, notices
    raise AssertionError(f"{len(samples)} samples of {n}; {notices}")
