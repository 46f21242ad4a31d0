"""A first look at the samples of a source: what is probably wrong with units, zeros, signs or cables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import degrees, radians

import numpy as np

from truearm.arm import Arm
from truearm.typing import BoolArray, FloatArray
from truearm.wings.bench.sources.sample import Sample
from truearm.wings.bench.sources.standstill import LEAST_SAMPLES, StandstillRule

LARGEST_RAD = radians(1080)  # three turns; more is another unit
ALL_WITHIN_RAD = radians(3.2)  # of a device that gives radians, read as degrees
STILL_RAD = 1e-9
MOVED_RAD = radians(2)
JUMP_RAD = radians(180)
# Zeros that people and encoders differ by.
_ZEROS_RAD = tuple(radians(shift) for shift in (90, -90, 180, -180, 360, -360))


def first_look(samples: Sequence[Sample], arm: Arm | None = None, prismatic: tuple[int, ...] = ()) -> Iterator[str]:
    """What looks wrong, in sentences.

    Parameters
    ----------
    samples : sequence of Sample
        Of some seconds in which a person moved every joint.
    arm : Arm, optional
        Its limits show wrong signs and zeros.
    prismatic : tuple of int
        Numbers of the joints that slide.
    """
    if not samples:
        yield (
            "no sample arrived: where nothing answers, check power, cable, address and port; where no line fits the "
            "pattern, its separators and words against the line shown below"
        )
        return
    if len(samples) < LEAST_SAMPLES:
        yield f"only {len(samples)} samples arrived"
        return
    n = len(samples[-1].joint_angles_rad)
    angles = np.array([one.joint_angles_rad for one in samples if len(one.joint_angles_rad) == n])
    if n == 0:
        points = [one.tip_in_reference_mm for one in samples if one.tip_in_reference_mm is not None]
        if not np.ptp(points, axis=0).any():
            yield "the point never moved: move the target"
        return
    if arm is not None and arm.n_joints != n:
        yield f"the source gives {n} joints, arm {arm.name!r} has {arm.n_joints}"
        return
    slides = np.isin(np.arange(1, n + 1), prismatic)
    yield from _units(angles[:, ~slides])
    yield from _movements(angles, slides)
    if arm is not None and np.abs(angles[:, ~slides]).max(initial=0.0) <= LARGEST_RAD:
        yield from _limits(angles, arm)
    yield from _rate(samples)


def _units(angles: FloatArray) -> Iterator[str]:
    largest = float(np.abs(angles).max(initial=0.0))
    if largest > LARGEST_RAD:
        yield f"an angle is {degrees(largest):.0f} deg: the numbers are probably degrees or counts, not what unit says"
    elif largest <= ALL_WITHIN_RAD and np.ptp(angles, axis=0).max(initial=0.0) > STILL_RAD:
        yield f"all angles are within {degrees(largest):.2f} deg of zero: the numbers are probably radians, not degrees"


def _movements(angles: FloatArray, slides: BoolArray) -> Iterator[str]:
    moved = np.ptp(angles, axis=0)
    steps = np.abs(np.diff(angles, axis=0)).max(axis=0)
    if (moved <= MOVED_RAD).all():
        yield "no joint moved: move every joint while this runs"
    else:
        for joint in np.flatnonzero(moved <= STILL_RAD):
            yield f"J{joint + 1} never moved: a cable, or another column of the device"
    for joint in np.flatnonzero(~slides):
        if steps[joint] > JUMP_RAD:
            turned = f"{degrees(steps[joint]):.0f} deg"
            yield f"J{joint + 1} jumps by {turned}: it passes the end of its counts; choose another zero"
        step = degrees(_count(angles[:, joint]))
        if step > degrees(StandstillRule().spread_rad) / 1.5:
            yield f"J{joint + 1} is read in steps of {step:.3f} deg: record with --spread {2 * step:.2g}"


def _count(values: FloatArray) -> float:
    """The step of which all differences are multiples [rad]; 0 if there is none, or too few differ."""
    steps = np.diff(np.unique(values))
    if len(steps) < LEAST_SAMPLES:
        return 0.0
    multiples = steps / steps.min()
    return float(steps.min()) if np.abs(multiples - multiples.round()).max() < 0.01 else 0.0


def _limits(angles: FloatArray, arm: Arm) -> Iterator[str]:
    for joint, (lower, upper) in enumerate(arm.limits):
        values, slides = angles[:, joint], arm.chain.is_prismatic[joint]

        def inside(other: FloatArray, lower: float = lower, upper: float = upper) -> bool:
            return bool(((other >= lower) & (other <= upper)).all())

        if inside(values):
            continue
        unit, factor = ("mm", 1.0) if slides else ("deg", degrees(1))
        reached = factor * (values.min() if values.min() < lower else values.max())
        text = f"J{joint + 1} is at {reached:.1f} {unit}, its limits are {factor * lower:.0f} and {factor * upper:.0f}"
        if inside(-values):
            text += "; with the opposite sign it is within them"
        elif not slides and (shifts := [shift for shift in _ZEROS_RAD if inside(values + shift)]):
            text += f"; with {degrees(shifts[0]):+.0f} deg it is within them: check zero"
        yield text


def _rate(samples: Sequence[Sample]) -> Iterator[str]:
    seconds = samples[-1].time_s - samples[0].time_s
    if seconds <= 0:
        yield "the clock of the device stands still or goes back, or a file of lines has no time_s"
        return
    rate, window = (len(samples) - 1) / seconds, StandstillRule().window_s
    if rate * window < LEAST_SAMPLES:
        yield f"{rate:.1f} samples a second: record with --still {(LEAST_SAMPLES + 1) / rate:.1f}"
