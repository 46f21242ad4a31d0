"""Sources without a device: the readings of a session file at any speed, and a virtual arm that can be steered."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from math import isfinite, radians
from pathlib import Path

import numpy as np

from truearm.arm import Arm
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


ENCODER_NOISE_RAD = radians(0.002)
FASTEST_RAD_S, FASTEST_MM_S = radians(90.0), 500.0  # of a joint that is steered


def virtual_arm(
    arm: Arm,
    *,
    speed: float = 1.0,
    seed: int = 0,
    measured_tip: Callable[[FloatArray], FloatArray] | None = None,
    is_at_rest: bool = False,
) -> Source:
    """An arm that moves by itself to random poses within its limits and stops at each, until it is steered.

    Parameters
    ----------
    arm : Arm
    speed : float
        How many of its seconds pass in one; infinite: as fast as its samples are taken.
    seed : int
        Of the poses and of the encoders' noise.
    measured_tip : callable, optional
        From joint angles (n_joints,) to the point (3,) that its reference measures [mm]: by default the tip of the arm
        without errors.
    is_at_rest : bool
        It stands in its working pose until it is steered.
    """
    asked: deque[FloatArray] = deque(maxlen=1)
    tip_of = _nominal_tip(arm) if measured_tip is None and arm.has_kinematics else measured_tip

    def samples() -> Stream:
        random = np.random.default_rng(seed)
        for time_s, angles in _motion(arm, random, asked, speed, is_at_rest=is_at_rest):
            noise = ENCODER_NOISE_RAD * random.standard_normal(len(angles))
            yield Sample(time_s, angles + noise, None if tip_of is None else tip_of(angles))

    return Source(
        f"virtual:{arm.name}", samples, _prismatic(arm), tip_of is not None, has_own_clock=True, steer=asked.append
    )


def _nominal_tip(arm: Arm) -> Callable[[FloatArray], FloatArray]:
    return lambda angles: arm.forward([angles]).tip_in_base[0]


def _motion(
    arm: Arm, random: np.random.Generator, asked: deque[FloatArray], speed: float, *, is_at_rest: bool
) -> Iterator[tuple[float, FloatArray]]:
    """Time [s] and angles: by itself, and once it was `asked`, on the way there, each joint as fast as it can."""
    time_s, angles = 0.0, arm.working
    if not is_at_rest:
        for time_s, angles, _, _ in poses_in_turn(_poses(arm, random), speed):
            yield time_s, angles
            if asked:
                break
    pause, start_s, tick = clock(speed), time_s, 0
    most = np.where(arm.chain.is_prismatic, FASTEST_MM_S, FASTEST_RAD_S) / RATE_HZ
    while True:
        aim = asked[-1] if asked else angles
        angles = angles + np.clip(aim - angles, -most, most)
        tick += 1
        yield start_s + pause(tick / RATE_HZ), angles


def _poses(arm: Arm, random: np.random.Generator) -> Iterator[FloatArray]:
    lower, upper = (np.clip(limit, arm.working - np.pi, arm.working + np.pi) for limit in arm.limits.T)
    slides = arm.chain.is_prismatic
    lower, upper = np.where(slides, arm.limits[:, 0], lower), np.where(slides, arm.limits[:, 1], upper)
    while True:
        yield random.uniform(lower, upper)


def _prismatic(arm: Arm) -> tuple[int, ...]:
    return tuple(int(i) + 1 for i in np.flatnonzero(arm.chain.is_prismatic))
