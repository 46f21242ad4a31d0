"""A sample: what a connected arm or instrument says at one moment; a notice: what happened to the connection."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Sample:
    """What a device says at one moment.

    Attributes
    ----------
    time_s : float
        When the bytes arrived, on this computer's monotonic clock [s]; of a source with a clock of its own, by that.
    joint_angles_rad : (n_joints,) array
        Joint angles [rad], displacements of sliding joints [mm]; empty from an instrument that measures points only.
    tip_in_reference_mm : (3,) array, optional
        The tip as a reference instrument measures it, in its frame [mm].
    temperature_degC : float, optional
        Temperature of the arm [degC].
    is_button_pressed : bool
        The arm's own button.
    directions : (n_joints,) array, optional
        Sign of each joint's last movement, where the source knows it better than its samples show: -1, 1, or 0.
    columns : mapping of str to float
        Further columns of the session file: ``payload_kg``, or names that start with ``load_``. A source gives the
        same ones in all its samples.

    Examples
    --------
    >>> import truearm as ta
    >>> import numpy as np
    >>> ta.Sample(0.0, np.radians([10.0, 20.0]), temperature_degC=21.5).is_button_pressed
    False
    """

    time_s: float
    joint_angles_rad: FloatArray
    tip_in_reference_mm: FloatArray | None = None
    temperature_degC: float | None = None
    is_button_pressed: bool = False
    directions: FloatArray | None = None
    columns: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Notice:
    """What happened to a connection, in one sentence.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.Notice("nothing was received for a second").text
    'nothing was received for a second'
    """

    text: str


Stream = Iterator[Sample | Notice]


@dataclass(frozen=True)
class Source:
    """Where samples come from.

    Attributes
    ----------
    name : str
        As it was written on the command line.
    samples : callable
        Connects and returns an iterator of samples and notices. It waits for the device, says what it waits for at
        least once a second, connects again by itself, and ends only where its input does.
    prismatic : tuple of int
        Numbers of the joints that slide, counted from 1.
    has_points : bool
        Whether it measures reference points.
    has_own_clock : bool
        Whether its times are those of the device (or of a replay, or a virtual arm), not of arrival.
    steer : callable, optional
        Of a virtual arm only: moves it to joint angles (n_joints,) [rad, or mm].

    Examples
    --------
    >>> import truearm as ta
    >>> import numpy as np
    >>> def samples():  # of a device of one's own
    ...     yield ta.Sample(0.0, np.zeros(6))
    >>> [event.kind for event in ta.record(ta.Source("mine", samples), "session.csv")]
    ['ready', 'end']
    """

    name: str
    samples: Callable[[], Stream]
    prismatic: tuple[int, ...] = ()
    has_points: bool = False
    has_own_clock: bool = False
    steer: Callable[[FloatArray], None] | None = None


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
