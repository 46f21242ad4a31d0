"""Connected arms: readings that are acknowledged survive the end of the program, at any moment."""

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

from benchmarks.rows import RowResult, Rows, Target
from truearm.readings import read_session
from truearm.sources import Sample, Source, StandstillRule
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
        acknowledged += len(os.read(reading, 1))
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


if sys.platform == "win32":
    del ROWS["kills"]  # there is no fork
