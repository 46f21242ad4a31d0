"""What a terminal shows while readings are taken: live angles, the next pose, the last events; and its keys."""

from __future__ import annotations

import codecs
import os
import select
import sys
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Group
from rich.table import Table
from rich.text import Text

from truearm.number_format import format_count
from truearm.printable_text import printable
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.recording.session_log import Event

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


KEYS = {" ": "take", "m": "take moving", "u": "undo", "n": "skip", "r": "refit", "w": "save", "q": "end"}
PROMPTS = {"s": "seat", "p": "point"}
HELP = "space take  m take moving  u undo  s seat  p point  n skip pose  r refit  w save  q end"


@dataclass
class RecordingView:
    """The view of a recording.

    Attributes
    ----------
    recording : Recording
    prompt : str
        What is being typed (seat or point), or nothing.
    typed : str
    """

    recording: Recording
    prompt: str = ""
    typed: str = ""
    _learned: str = ""
    _next: str = ""
    _said: deque[str] = field(default_factory=lambda: deque(maxlen=3))

    def commands(self, keys: Iterator[str]) -> Iterator[str]:
        """The commands that keys give; names and points are typed and ended by Enter, or left by Escape."""
        for key in keys:
            if self.prompt and key in ("\r", "\n"):
                command = f"{self.prompt} {self.typed}"
                self.prompt = self.typed = ""
                yield command
            elif self.prompt and key == "\x1b":
                self.prompt = self.typed = ""
            elif self.prompt and key in ("\x7f", "\b"):
                self.typed = self.typed[:-1]
            elif self.prompt:
                self.typed += key if key.isprintable() else ""
            elif key in PROMPTS:
                self.prompt = PROMPTS[key]
            elif key in KEYS:
                yield KEYS[key]

    def add(self, event: Event) -> None:
        """Show an event."""
        text = printable(event.text)
        if event.kind == "next":
            self._next = text
        elif event.kind == "learned":
            self._learned = text
        else:
            self._said.append(text)

    def __rich__(self) -> Group:
        recording = self.recording
        state = "waiting for the arm" if recording.sample is None else "still" if recording.is_still else "moving"
        seat = f", seat {recording.seat}" if recording.seat else ""
        parts: list[Table | Text] = [
            Text(f"{format_count(recording.n_readings, 'reading')}{seat}: {state}", style="bold")
        ]
        if (tip := recording.corrected()) is not None:
            parts.append(Text(str(tip), style="bold green"))
        if recording.sample is not None:
            parts.append(self._angles())
        parts += [Text(text) for text in (self._learned, self._next) if text]
        parts += [Text(text, style="dim") for text in self._said]
        typing = f"{self.prompt}: {self.typed}_  (Enter: done, Escape: cancel)"
        parts.append(Text(typing if self.prompt else HELP, style="cyan"))
        return Group(*parts)

    def _angles(self) -> Table:
        recording = self.recording
        assert recording.sample is not None
        table = Table(box=None, pad_edge=False)
        to_go = recording.to_go()
        for heading in ("joint", "angle", "to go") if to_go else ("joint", "angle"):
            table.add_column(heading, justify="right")
        shown = recording.displayed(recording.sample.joint_angles_rad)
        for joint, (unit, angle) in enumerate(zip(recording.units, shown, strict=True), start=1):
            row = [f"J{joint}", f"{angle:.3f} {unit}"]
            table.add_row(*row, *([f"{to_go[joint - 1]:+.0f} {unit}"] if to_go else []))
        return table
