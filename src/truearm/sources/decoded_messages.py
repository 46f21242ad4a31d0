"""Messages of a device, each of which is a sample or is ignored: lines, datagrams, messages of a broker."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from truearm.sources.sample import Notice, Sample, Stream

SILENT_S = 1.0
MOST_SHOWN = 60  # characters of a message that is ignored

T = TypeVar("T")


def samples_in(messages: Iterator[T | None], decode: Callable[[T, float], Sample | None], misfit: str) -> Stream:
    """The samples in messages; what is none is counted, and said once a second.

    Parameters
    ----------
    messages : iterator
        As they arrive; None once a second while nothing does.
    decode : callable
        Makes a sample of a message and the time of its arrival [s], or None.
    misfit : str
        What is wrong with a message without a sample, in the plural.
    """
    ignored, last, said_s = 0, "", -SILENT_S
    for message in messages:
        now_s = time.monotonic()
        sample = None if message is None else decode(message, now_s)
        if sample is not None:
            yield sample
        elif message is None:
            yield Notice("nothing was received for a second")
        else:
            ignored, last = ignored + 1, f"{message!a:.{MOST_SHOWN + 2}}"
        if ignored and now_s - said_s >= SILENT_S:
            yield Notice(f"{ignored} {misfit}, the last {last}; ignored")
            ignored, said_s = 0, now_s
