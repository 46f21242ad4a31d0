"""Replay: the readings of a session file, with a stop at each and a movement between them, at any speed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from math import isfinite
from pathlib import Path

import numpy as np

from truearm.errors import InputError
from truearm.readings import Session, read_session
from truearm.readings.columns import unit_of
from truearm.typing import FloatArray
from truearm.wings.bench.sources.sample import Notice, Sample, Source, Stream

RATE_HZ = 20.0
STOP_S = 1.0
MOVE_S = 1.0


def poses_in_turn(poses: Iterator[FloatArray], speed: float) -> Iterator[tuple[float, FloatArray, int, bool]]:
    """Time [s], angles, number of the pose (counted from 0) and whether the arm stops at it; `RATE_HZ` times a second.

    Parameters
    ----------
    poses : iterator of (n_joints,) arrays
    speed : float
        How many seconds of the movement pass in one; infinite: as fast as they are taken.
    """
    pause, tick, steps = clock(speed), 0, int(MOVE_S * RATE_HZ)
    before: FloatArray | None = None
    for number, pose in enumerate(poses):
        for step in range(1, steps):
            if before is None:
                break
            share = 0.5 - 0.5 * np.cos(np.pi * step / steps)
            yield pause(tick / RATE_HZ), before + share * (pose - before), number, False
            tick += 1
        for _ in range(int(STOP_S * RATE_HZ) + 1):
            yield pause(tick / RATE_HZ), pose, number, True
            tick += 1
        before = pose


def clock(speed: float) -> Callable[[float], float]:
    """What waits until a time of the source, and returns it."""
    start_s = time.monotonic()

    def pause(time_s: float) -> float:
        if np.isfinite(speed):
            time.sleep(max(0.0, start_s + time_s / speed - time.monotonic()))
        return time_s

    return pause


def replay(file: Path, speed: float = 1.0) -> Source:
    """The readings of a session, one after the other.

    Parameters
    ----------
    file : Path
        Of a session.
    speed : float
        How many seconds of the replay pass in one; infinite: as fast as they are taken.

    Raises
    ------
    InputError
        If the file is no session, or the speed is not positive.
    """
    if not speed > 0:
        raise InputError(f"expected a positive speed, got {speed}", hint=f"replay:{file}@10, or @max")
    session = read_session(file)
    slides = [number for number, name in enumerate(session.angle_columns or (), start=1) if unit_of(name) == "mm"]
    name = f"replay:{file}@{speed:g}" if isfinite(speed) else f"replay:{file}@max"
    return Source(name, lambda: _samples(session, speed), tuple(slides), session.points is not None, has_own_clock=True)


def _samples(session: Session, speed: float) -> Stream:
    there = np.zeros(len(session), bool) if session.points is None else session.has_point
    for time_s, angles, row, is_stop in poses_in_turn(iter(session.angles), speed):
        yield Sample(
            time_s,
            angles,
            session.points[row] if is_stop and session.points is not None and there[row] else None,
            None if session.temperature_degC is None else float(session.temperature_degC[row]),
            # What moved between the readings of a session is known to the session alone.
            directions=np.zeros(len(angles)) if session.directions is None else session.directions[row],
            columns={name: float(values[row]) for name, values in session.columns.items()},
        )
    yield Notice("the session has ended")
