"""`list_sources`, `try_source`: what can be connected, and a first look at it."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from truearm.arm import Arm
from truearm.number_format import format_count
from truearm.verbs.inputs import to_arm
from truearm.verbs.record import Record, TableRecord, TextTable, columns_of
from truearm.wings.bench.sources import Notice, Sample, Source, open_source
from truearm.wings.bench.sources.connections import FORMS
from truearm.wings.bench.sources.first_look import first_look
from truearm.wings.bench.sources.source_names import KINDS

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
