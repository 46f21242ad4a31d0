"""Keys as they are pressed, without Enter."""

from __future__ import annotations

import codecs
import os
import select
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

WAIT_S = 0.2


@contextmanager
def pressed_keys() -> Iterator[Iterator[str]]:
    """Characters of the keys that are pressed while the block runs; empty ones while none is."""
    if sys.platform == "win32":
        yield _windows_keys()
        return
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        yield _posix_keys(terminal)
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _posix_keys(terminal: int) -> Iterator[str]:
    decoder = codecs.getincrementaldecoder("utf-8")("replace")
    while True:
        if not select.select([terminal], [], [], WAIT_S)[0]:
            yield ""
            continue
        data = os.read(terminal, 64)
        if not data:
            return
        if data[:1] == b"\x1b" and len(data) > 1:  # an arrow or a function key
            continue
        yield from decoder.decode(data)


def _windows_keys() -> Iterator[str]:
    import msvcrt

    while True:
        if msvcrt.kbhit():  # type: ignore[attr-defined,unused-ignore]
            yield msvcrt.getwch()  # type: ignore[attr-defined,unused-ignore]
        else:
            time.sleep(WAIT_S)
            yield ""
