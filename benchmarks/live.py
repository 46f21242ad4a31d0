"""Connected arms: acknowledged readings survive the end of the program; the time of a corrected tip."""

from __future__ import annotations

import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target
from truearm.readings import read_session
from truearm.sources import Sample, Source, StandstillRule
from truearm.workflows.corrected_tip import corrected_tip
from truearm.workflows.record_readings import record

ROWS = Rows()


def _restless() -> Iterator[Sample]:
    """An arm that stops at another pose a hundred times faster than a person could."""
    for k in range(10**9):
        yield Sample(k / 20, np.full(6, 0.5 * (k // 12 % 7)), np.arange(3.0) + k)


def _take_and_acknowledge(out: Path, writing: int) -> None:
    """What the child does until it is killed."""
    for event in record(Source("restless", _restless, has_points=True), out, rule=StandstillRule()):
        if event.kind == "reading":
            os.write(writing, b"+")


def _killed_once(out: Path, after: int, later_s: float) -> int:
    """Number of readings that a child acknowledged before it was killed, some time after a number of them."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            _take_and_acknowledge(out, writing)
        finally:
            os._exit(1)
    os.close(writing)
    acknowledged = 0
    while acknowledged < after:
        if not os.read(reading, 1):
            raise RuntimeError("the child ended by itself")
        acknowledged += 1
    time.sleep(later_s)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while said := os.read(reading, 65536):
        acknowledged += len(said)
    os.close(reading)
    return acknowledged


@ROWS.row("kills", "kill -9 at random moments while readings are taken: acknowledged readings that are not in the file")
def kills(n: int = 50) -> RowResult:
    """Each kill continues the file of the one before."""
    moments, lost, more, acknowledged = random.Random(1), 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "session.csv"
        before = 0
        for _ in range(n):
            said = _killed_once(out, moments.randint(0, 40), moments.uniform(0, 0.01))
            now = len(read_session(out)) if out.exists() and out.read_bytes().count(b"\n") > 1 else 0
            lost += max(0, before + said - now)
            more += max(0, now - before - said)
            before, acknowledged = now, acknowledged + said
    row: dict[str, Any] = {"kills": n, "acknowledged": acknowledged, "lost": lost, "written, not acknowledged": more}
    return RowResult([row], [Target("acknowledged readings lost", lost, 0), Target("kills", n, n, "above")])


@ROWS.row("tip", "corrected tip of a sample with its covariance, physical model of 200 readings, 99 % of samples")
def tip(n: int = 500, readings: int = 200) -> RowResult:
    """CPU time of one thread, with the directions of movement known as a connected arm shows them, and unknown."""
    session = ta.simulate("ur10", poses=readings, seed=1).session
    model = ta.fit("ur10", session, model="physical").model
    rows: list[dict[str, Any]] = []
    for known, directions in (("known", np.ones(6)), ("unknown", np.zeros(6))):
        times = []
        for k in range(n):
            sample, start = Sample(0.0, session.angles[k % readings], temperature_degC=20.5), time.thread_time()
            corrected_tip(model, sample, directions)
            times.append(1e3 * (time.thread_time() - start))
        median, slow = np.percentile(times, [50, 99])
        rows.append({"directions": known, "median [ms]": float(median), "99 % below [ms]": float(slow)})
    return RowResult(rows, [Target("directions known, 99 % below [ms]", rows[0]["99 % below [ms]"], 5.0)])


if sys.platform == "win32":
    del ROWS["kills"]  # there is no fork
