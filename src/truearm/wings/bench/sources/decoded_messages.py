"""Messages of a device, each of which is a sample or is ignored: lines, datagrams, messages of a broker."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import TypeVar

from truearm.wings.bench.sources.sample import Notice, Sample, Stream

SILENT_S = 1.0
MOST_SHOWN = 60  # characters of a message that is ignored
CLOCK_MOVES = 3  # a stamp that has moved so often counts or dates messages

T = TypeVar("T")


REPEATED = Notice("the device repeats a message: its number or clock stands still; start its sending again")


class Repeats:
    """Whether a message repeats the one before, by the numbers with which its sender counts and dates messages."""

    def __init__(self) -> None:
        self._content: object = None
        self._last: tuple[object, ...] = ()
        self._moves = Counter[int]()

    def __call__(self, content: object, *stamps: object) -> bool:
        """Whether the content is the same, and all stamps or one that counts are; one not stated is false."""
        moved = {i for i, (now, before) in enumerate(zip(stamps, self._last, strict=False)) if now != before}
        is_same, stands = content == self._content, any(stamps) and not moved and stamps == self._last
        self._content, self._last = content, stamps
        self._moves.update(moved)
        return is_same and (stands or any(n >= CLOCK_MOVES for i, n in self._moves.items() if i not in moved))


def samples_in(
    messages: Iterator[T | None], decode: Callable[[T, float], Sample | Notice | None], misfit: str
) -> Stream:
    """The samples in messages; what is none is counted, and said once a second.

    Parameters
    ----------
    messages : iterator
        As they arrive; None once a second while nothing does.
    decode : callable
        Makes a sample of a message and the time of its arrival [s], or None. A notice, of a message that says nothing
        new, is said if no sample came for a second.
    misfit : str
        What is wrong with a message without a sample, in the plural.
    """
    ignored, last, said_s, heard_s = 0, "", -SILENT_S, -SILENT_S
    for message in messages:
        now_s = time.monotonic()
        found = Notice("nothing was received for a second") if message is None else decode(message, now_s)
        if found is None:
            ignored, last = ignored + 1, f"{message!a:.{MOST_SHOWN + 2}}"
        elif message is None or isinstance(found, Sample) or now_s - heard_s >= SILENT_S:
            heard_s = now_s
            yield found
        if ignored and now_s - said_s >= SILENT_S:
            yield Notice(f"{ignored} {misfit}, the last {last}; ignored")
            ignored, said_s = 0, now_s
