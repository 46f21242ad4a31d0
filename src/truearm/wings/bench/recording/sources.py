"""`list_sources`, `try_source`: what can be connected, and a first look at it."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np

from truearm.arm import Arm
from truearm.number_format import format_count
from truearm.typing import BoolArray, FloatArray
from truearm.verbs.inputs import to_arm
from truearm.verbs.record import Record, TableRecord, TextTable, columns_of
from truearm.wings.bench.sources import Notice, Sample, Source, open_source
from truearm.wings.bench.sources.connections import FORMS
from truearm.wings.bench.sources.source_names import KINDS
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


SHOWN = 10
MOST_SAMPLES = 100_000


@dataclass(frozen=True, eq=False, repr=False)
class SourceList(TableRecord):
    """The kinds of sources.

    Attributes
    ----------
    missing : dict of str to str
        By the name of the kind: what is to be installed for all of it; empty where nothing is.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.list_sources().missing["replay"]
    ''
    """

    missing: dict[str, str]

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        yield TextTable(
            ["source", "what it is", "missing"],
            [(kind.form, kind.title, self.missing[kind.name] or "-") for kind in KINDS],
            left_aligned=(0, 1, 2),
        )
        yield f"CONNECTION: {FORMS}."
        yield "Next: truearm sources --try SOURCE"

    def columns(self) -> dict[str, list[Any]]:
        """A row for each kind of source."""
        return columns_of(self._kinds())

    def _kinds(self) -> list[dict[str, str]]:
        return [
            {"kind": kind.name, "form": kind.form, "title": kind.title, "missing": self.missing[kind.name]}
            for kind in KINDS
        ]

    def _json(self) -> object:
        return {"sources": self._kinds()}


def list_sources() -> SourceList:
    """The kinds of sources, and what is missing for them.

    Examples
    --------
    >>> import truearm as ta
    >>> [one["kind"] for one in ta.list_sources().to_dict()["sources"]][:2]
    ['lines', 'rtde']
    """
    serial = "" if importlib.util.find_spec("serial") else "serial ports: pip install 'truearm[live]'"
    missing = {kind.name: serial if kind.has_serial_port else "" for kind in KINDS}
    for kind in KINDS:
        if kind.needs is not None and not importlib.util.find_spec(kind.needs[0]):
            missing[kind.name] = f"pip install 'truearm[{kind.needs[1]}]'"
    return SourceList(missing)


@dataclass(frozen=True, eq=False, repr=False)
class SourceTrial(Record):
    """A first look at a source.

    Attributes
    ----------
    name : str
    samples : tuple of Sample
    notices : tuple of str
        What the source said of its connection.
    findings : tuple of str
        What looks wrong.
    prismatic : tuple of int
        Numbers of the joints that slide.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.try_source("virtual:ur10@max").rate_hz
    20.0
    """

    name: str
    samples: tuple[Sample, ...]
    notices: tuple[str, ...]
    findings: tuple[str, ...]
    prismatic: tuple[int, ...] = ()

    @property
    def rate_hz(self) -> float:
        """Samples a second; NaN of fewer than two."""
        seconds = self.samples[-1].time_s - self.samples[0].time_s if len(self.samples) > 1 else 0.0
        return (len(self.samples) - 1) / seconds if seconds > 0 else np.nan

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        rate = f", {self.rate_hz:.0f} a second" if np.isfinite(self.rate_hz) else ""
        yield f"{self.name}: {format_count(len(self.samples), 'sample')}{rate}. {self._verdict()}"
        yield from (f"- {one}" for one in self.findings)
        shown = self._shown()
        if shown:
            n = len(shown[0].joint_angles_rad)
            names = [f"J{joint} [{'mm' if joint in self.prismatic else 'deg'}]" for joint in range(1, n + 1)]
            if self._has_points:
                names += ["x [mm]", "y [mm]", "z [mm]"]
            yield TextTable(["time [s]", *names], map(self._row, shown), left_aligned=())
        yield from self.notices

    def _verdict(self) -> str:
        n = len(self.findings)
        return "Nothing looks wrong." if n == 0 else f"{format_count(n, 'thing')} to look at:"

    def _shown(self) -> list[Sample]:
        """Ten samples, evenly spaced."""
        rows = np.unique(np.linspace(0, len(self.samples) - 1, min(SHOWN, len(self.samples))).round().astype(int))
        return [self.samples[row] for row in rows]

    @property
    def _has_points(self) -> bool:
        return any(one.tip_in_reference_mm is not None for one in self.samples)

    def _row(self, sample: Sample) -> list[str]:
        point = ["-"] * 3 if self._has_points else []
        if sample.tip_in_reference_mm is not None:
            point = [f"{one:.3f}" for one in sample.tip_in_reference_mm]
        angles = (f"{one:.3f}" for one in self._displayed(sample))
        return [f"{sample.time_s - self.samples[0].time_s:.2f}", *angles, *point]

    def _displayed(self, sample: Sample) -> list[float]:
        """Joint angles in degrees, of sliding joints in mm."""
        angles = enumerate(sample.joint_angles_rad.tolist(), start=1)
        return [angle if joint in self.prismatic else degrees(angle) for joint, angle in angles]

    def _json(self) -> object:
        return {
            "source": self.name,
            "samples": len(self.samples),
            "rate_hz": self.rate_hz if np.isfinite(self.rate_hz) else None,
            "findings": self.findings,
            "notices": self.notices,
            "shown": [
                {
                    "time_s": one.time_s - self.samples[0].time_s,
                    "joint_angles": self._displayed(one),
                    "tip_in_reference_mm": one.tip_in_reference_mm,
                    "temperature_degC": one.temperature_degC,
                }
                for one in self._shown()
            ],
        }


def try_source(source: str | Source, *, arm: Arm | str | Path | None = None, seconds: float = 5.0) -> SourceTrial:
    """Read a source for some seconds, in which every joint should move, and say what looks wrong.

    Parameters
    ----------
    source : str or Source
    arm : Arm, str or path, optional
        Its limits show wrong signs, zeros and units.
    seconds : float
        For how long.

    Returns
    -------
    SourceTrial

    Raises
    ------
    InputError
        If there is no such source, or its file breaks a rule of its format.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.try_source("virtual:ur10@max", arm="ur10").findings
    ()
    """
    opened = open_source(source) if isinstance(source, str) else source
    nominal = None if arm is None else to_arm(arm)
    samples: list[Sample] = []
    notices: dict[str, None] = {}
    until_s = time.monotonic() + seconds
    for one in opened.samples():
        if isinstance(one, Notice):
            notices[one.text] = None
        else:
            samples.append(one)
        over = len(samples) > 1 and not 0 <= samples[-1].time_s - samples[0].time_s < seconds
        if over or len(samples) >= MOST_SAMPLES or time.monotonic() > until_s:
            break
    findings = tuple(first_look(samples, nominal, opened.prismatic))
    return SourceTrial(opened.name, tuple(samples), tuple(notices)[:SHOWN], findings, opened.prismatic)
