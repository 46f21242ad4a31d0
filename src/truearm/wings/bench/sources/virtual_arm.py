"""The virtual arm: an arm that exists in memory only, moves by itself from pose to pose, and can be steered."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from math import radians

import numpy as np

from truearm.arm import Arm
from truearm.typing import FloatArray
from truearm.wings.bench.sources.replay import RATE_HZ, clock, poses_in_turn
from truearm.wings.bench.sources.sample import Sample, Source, Stream

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
