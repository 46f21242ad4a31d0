"""A movement from pose to pose with a stop at each, in the source's own time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from truearm.typing import FloatArray

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
