"""The virtual arm: an arm that exists in memory only and moves by itself from pose to pose."""

from __future__ import annotations

from collections.abc import Iterator
from math import radians

import numpy as np

from truearm.arm.arm import Arm
from truearm.sources.poses_in_turn import poses_in_turn
from truearm.sources.sample import Sample, Source, Stream
from truearm.typing import FloatArray

ENCODER_NOISE_RAD = radians(0.002)


def virtual_arm(arm: Arm, *, speed: float = 1.0, seed: int = 0) -> Source:
    """An arm that moves by itself to random poses within its limits and stops at each.

    Parameters
    ----------
    arm : Arm
        Its geometry is that of its description: to plan errors into an arm, replay a session of `truearm simulate`.
    speed : float
        How many of its seconds pass in one; infinite: as fast as its samples are taken.
    seed : int
        Of the poses and of the encoders' noise.
    """

    def samples() -> Stream:
        random = np.random.default_rng(seed)
        for time_s, angles, _, _ in poses_in_turn(_poses(arm, random), speed):
            yield _sample(time_s, angles, arm, random)

    return Source(f"virtual:{arm.name}", samples, _prismatic(arm), arm.has_kinematics, has_own_clock=True)


def _sample(time_s: float, angles: FloatArray, arm: Arm, random: np.random.Generator) -> Sample:
    tip = arm.forward([angles]).tip_in_base[0] if arm.has_kinematics else None
    return Sample(time_s, angles + ENCODER_NOISE_RAD * random.standard_normal(len(angles)), tip)


def _poses(arm: Arm, random: np.random.Generator) -> Iterator[FloatArray]:
    lower, upper = (np.clip(limit, arm.working - np.pi, arm.working + np.pi) for limit in arm.limits.T)
    slides = arm.chain.is_prismatic
    lower, upper = np.where(slides, arm.limits[:, 0], lower), np.where(slides, arm.limits[:, 1], upper)
    while True:
        yield random.uniform(lower, upper)


def _prismatic(arm: Arm) -> tuple[int, ...]:
    return tuple(int(i) + 1 for i in np.flatnonzero(arm.chain.is_prismatic))
