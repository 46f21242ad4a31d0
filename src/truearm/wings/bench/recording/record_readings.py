"""`record`: readings of a connected arm go into a session file, with samples and commands read in threads.

The demonstration of a connected arm: a virtual one with planted errors, a tracker, and a plan, in a folder.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np

from truearm.arm import load_arm
from truearm.typing import FloatArray
from truearm.wings.bench.recording.recording import Recording, RecordingOptions
from truearm.wings.bench.recording.session_log import Event
from truearm.wings.bench.sources import Notice, Sample, Source
from truearm.wings.bench.sources.virtual_arm import virtual_arm
from truearm.wings.planning.plan import plan
from truearm.wings.planning.virtual import VirtualArm

MOST_WAITING = 10_000  # samples and commands
_Origin = Literal["arm", "reference", "command"]


def record(
    source: str | Source,
    out: str | Path,
    *,
    samples_hz: float = 0.0,
    commands: Iterator[str] | None = None,
    **options: Unpack[RecordingOptions],
) -> Iterator[Event]:
    """Take readings of a connected arm into a session file, which every verb reads while it grows.

    A reading is the mean of the samples of a standstill, taken once until the arm moves again. It is in the file before
    its event comes, and on the disk within a tenth of a second. The columns ``note_..`` hold the number of samples,
    their standard deviation and the time.

    Parameters
    ----------
    source : str or Source
        ``KIND:ADDRESS`` as `truearm sources` lists them, or one of your own.
    out : path
        Session file, ``.csv``. One with the same columns is continued.
    samples_hz : float
        How often the angles come as an event of the kind ``sample``, by the clock of the source; 0: never.
    commands : iterator of str, optional
        ``take``, ``take moving``, ``undo``, ``seat NAME``, ``point X Y Z``, ``skip``, ``refit``, ``save``,
        ``end``.
    arm : Arm, str or path, optional
        The arm: its number of joints and limits are checked. That of the model by default.
    plan : path, optional
        The file of `plan`, for seats, instructions and what remains; needs `arm`.
    reference : str or Source, optional
        What measures the tip, if not `source`: another source, paired by time, or ``typed``.
    rule : StandstillRule, optional
        0.5 s within 0.05 deg by default.
    on : {"still", "key"}
        Take a reading at every standstill, or when a person, or the arm's button, asks.
    seat : str
        Name of the seat of the readings; the plan's by default.
    model : Compensator, str or path, optional
        Corrects the tip at the samples.
    rank : bool
        The next pose is the one that adds most to what is known of the arm: of the plan's, or without a plan of poses
        that the arm reaches. By default the plan is followed in its order.
    out_model : path, optional
        Where the command ``save`` writes the model in force, which replaces one of the same arm only.

    Yields
    ------
    Event

    Raises
    ------
    InputError
        If the source, the plan or the file cannot be used, or they are of different arms.
    TruearmError
        If a reading cannot be written.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.simulate("ur10", poses=3, seed=1).session.save("simulated.csv")
    >>> [event.kind for event in ta.record("replay:simulated.csv@max", "session.csv")]
    ['ready', 'reading', 'reading', 'reading', 'notice', 'end']
    >>> len(ta.read_session("session.csv"))
    3
    """
    return follow(Recording(source, out, samples_hz=samples_hz, **options), commands)


def follow(recording: Recording, commands: Iterator[str] | None = None) -> Iterator[Event]:
    """Read the sources of a recording, and commands, in threads; until its source ends or a command is ``end``."""
    waiting: queue.Queue[tuple[_Origin, Any]] = queue.Queue(MOST_WAITING)
    over = threading.Event()

    def put(origin: _Origin, what: object) -> None:
        while not over.is_set():
            with suppress(queue.Full):
                waiting.put((origin, what), timeout=1.0)
                return

    def read(origin: _Origin, values: Callable[[], Iterator[object]]) -> None:
        try:
            for value in values():
                if recording.is_timed_by_arrival and isinstance(value, Sample):
                    value = replace(value, time_s=time.monotonic())
                put(origin, value)
                if over.is_set():
                    return
            put(origin, None)
        except Exception as error:
            put(origin, error)

    readers: list[tuple[_Origin, Callable[[], Iterator[object]]]] = [("arm", recording.source.samples)]
    if isinstance(recording.reference, Source):
        readers.append(("reference", recording.reference.samples))
    if commands is not None:
        readers.append(("command", lambda: commands))
    for origin, values in readers:
        threading.Thread(target=read, args=(origin, values), name=f"truearm {origin}", daemon=True).start()
    try:
        while True:
            try:
                origin, what = waiting.get(timeout=recording.settle())
            except queue.Empty:
                continue
            if isinstance(what, Exception):
                raise what
            if (origin == "arm" and what is None) or (isinstance(what, str) and what.strip() == "end"):
                break
            yield from _dealt_with(recording, origin, what)
            yield from recording.news_of_fit()
    finally:
        over.set()
        recording.close()
    yield recording.end()


def _dealt_with(recording: Recording, origin: _Origin, what: Sample | Notice | str | None) -> Iterator[Event]:
    if isinstance(what, Notice):
        yield Event("notice", what.text)
    elif isinstance(what, str):
        yield from recording.on_command(what)
    elif isinstance(what, Sample) and origin == "arm":
        yield from recording.on_sample(what)
    elif isinstance(what, Sample):
        recording.on_reference(what)


DEMO_ARM, PRESET, SEED = "ur10", "research", 1
POSES = 30
TRACKER_STD_MM = 0.02
# Where the tracker has the arm's base: turned by a quarter, and somewhere else.
T_TRACKER_BASE = np.array([[0.0, -1.0, 0.0, 1500.0], [1.0, 0.0, 0.0, 300.0], [0.0, 0.0, 1.0, -400.0], [0, 0, 0, 1.0]])


def demo_recording(
    folder: Path, *, samples_hz: float = 0.0, progress: Callable[[int, str], None] | None = None
) -> Recording:
    """A recording of a virtual arm that is steered.

    Parameters
    ----------
    folder : Path
        Where the plan, the session and the model are written.
    samples_hz : float
        As of `record`.
    progress : callable, optional
        As of `plan`.
    """
    plan_file = folder / "plan.csv"
    plan(DEMO_ARM, "tracker", poses=POSES, noise_mm=TRACKER_STD_MM, seed=SEED, progress=progress).save(plan_file)
    return Recording(
        demo_source(),
        folder / "session.csv",
        arm=DEMO_ARM,
        plan=plan_file,
        rank=True,
        out_model=folder / "arm.truearm",
        samples_hz=samples_hz,
    )


def demo_source(seed: int = SEED) -> Source:
    """A virtual arm with errors, which a tracker measures in a frame of its own."""
    arm = load_arm(DEMO_ARM)
    virtual, noise = VirtualArm.draw(arm, PRESET, seed=seed), np.random.default_rng(seed)

    def measured_tip(angles: FloatArray) -> FloatArray:
        tip = virtual.true_tip(angles[None])[0] + TRACKER_STD_MM * noise.standard_normal(3)
        return np.asarray(T_TRACKER_BASE[:3, :3] @ tip + T_TRACKER_BASE[:3, 3])

    return virtual_arm(arm, measured_tip=measured_tip, is_at_rest=True)
