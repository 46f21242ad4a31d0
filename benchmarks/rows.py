"""What all benchmarks share: rows with their targets, the machine, times, processes of their own.

A benchmark is a file with ``ROWS = Rows()``. A row is a function; its parameters are the options of the command, with
their defaults. It returns one number, which is judged by the row's target, or a `RowResult`, or yields rows of a
table::

    @ROWS.row("plan", "plan, 50 poses of measuring7", unit="s", target=4.0)
    def plan(poses: int = 50) -> float: ...
"""

from __future__ import annotations

import inspect
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, NamedTuple

ROOT = Path(__file__).parents[1]
# Environment variables that a user may have set for the threads of a BLAS.
BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
SCRATCH = "TRUEARM_BENCHMARKS_SCRATCH"
Threads = Literal["as here", "one", "default"]


@dataclass(frozen=True)
class Target:
    """A number to reach.

    Attributes
    ----------
    what : str
    reached, limit : float
        In the unit that `what` names; `reached` is None where there is nothing to judge.
    good : {"below", "above"}
        On which side of the limit it shall lie.
    """

    what: str
    reached: float | None
    limit: float
    good: Literal["below", "above"] = "below"

    @property
    def met(self) -> bool:
        """Whether it is reached."""
        if self.reached is None:
            return False
        return bool(self.reached <= self.limit if self.good == "below" else self.reached >= self.limit)


@dataclass(frozen=True)
class RowResult:
    """What a row gives: a table by the names of its columns, targets, and what the table does not say."""

    table: Sequence[dict[str, Any]] = ()
    targets: Sequence[Target] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Row:
    """A row of a benchmark.

    Attributes
    ----------
    what : str
        In a line.
    measure : callable
        Returns a number or a `RowResult`, or yields dicts.
    unit : str
    target : float
        Of a number, in that unit, not to exceed.
    quick : dict
        Options that ``--quick`` changes: the smallest sizes that show that it runs.
    is_long : bool
        Whether it takes many minutes, and runs only if it is named.
    threads : {"as here", "one", "default"}
        Of the BLAS. "one" and "default" run in a process of their own, which finds nothing loaded or cached.
    """

    what: str
    measure: Callable[..., float | RowResult | Iterator[dict[str, Any]]]
    unit: str
    target: float | None
    quick: dict[str, Any]
    is_long: bool
    threads: Threads

    @property
    def options(self) -> dict[str, Any]:
        """Names and defaults."""
        return {name: one.default for name, one in inspect.signature(self.measure).parameters.items()}

    def found(self, **options: Any) -> RowResult:
        """Measure in this process."""
        found = self.measure(**options)
        if isinstance(found, RowResult):
            return found
        if isinstance(found, Iterator):
            return RowResult(list(found))
        what = f"{self.what} [{self.unit}]".removesuffix(" []")
        if self.target is None:
            return RowResult([{what: found}])
        return RowResult(targets=[Target(what, float(found), self.target)])


class Rows(dict[str, Row]):
    """The rows of a benchmark, by name."""

    def row(
        self,
        name: str,
        what: str = "",
        *,
        unit: str = "",
        target: float | None = None,
        quick: dict[str, Any] | None = None,
        is_long: bool = False,
        threads: Threads = "as here",
    ) -> Callable[..., Any]:
        """Declare a function as a row; `what` is the first line of its docstring by default."""

        def declare(measure: Callable[..., Any]) -> Callable[..., Any]:
            said = what or inspect.cleandoc(measure.__doc__ or "").partition("\n")[0].rstrip(".")
            self[name] = Row(said, measure, unit, target, quick or {}, is_long, threads)
            return measure

        return declare


def finding(seen: str, wanted: str, measured: str, is_met: bool | None) -> dict[str, str]:
    """Row of a table: what goes wrong, what is wanted, what was measured; `is_met` is None where nothing is judged."""
    judged = "" if is_met is None else "met" if is_met else "missed"
    return {"seen": seen, "wanted": wanted, "measured": measured, "": judged}


def run_row(benchmark: str, name: str, options: dict[str, Any]) -> RowResult:
    """Measure a row, in a process of its own if it asks for one."""
    row = import_module(f"benchmarks.{benchmark}").ROWS[name]
    if row.threads == "as here":
        return row.found(**options)
    found = own_process(_found_and_memory, benchmark, name, options, threads=row.threads)
    return RowResult(found["table"], [Target(**target) for target in found["targets"]], found["notes"])


def _found_and_memory(benchmark: str, name: str, options: dict[str, Any]) -> dict[str, Any]:
    found = asdict(import_module(f"benchmarks.{benchmark}").ROWS[name].found(**options))
    return found | {"notes": [*found["notes"], f"peak memory {peak_bytes() / 1e6:.0f} MB"]}


def own_process(function: Callable[..., Any], *arguments: Any, threads: Threads = "as here") -> Any:
    """What a function returns in a process of its own; arguments and result go as JSON."""
    environment = dict(os.environ)
    if threads != "as here":
        environment = {key: value for key, value in environment.items() if key not in BLAS_THREADS}
    if threads == "one":
        environment |= dict.fromkeys(BLAS_THREADS, "1")
    code = (
        "import importlib, json, sys; module, name, arguments = json.loads(sys.argv[1]);"
        "found = getattr(importlib.import_module(module), name)(*arguments); print(json.dumps(found, default=float))"
    )
    call = json.dumps([function.__module__, function.__name__, arguments], default=str)
    command = [sys.executable, "-c", code, call]
    ran = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment, cwd=ROOT)
    return json.loads(ran.stdout.splitlines()[-1])


def scratch() -> Path:
    """A folder that all processes of a run share; it is removed afterwards."""
    return Path(os.environ[SCRATCH])


class Times(NamedTuple):
    """Seconds of some runs: the shortest is what the machine can do undisturbed, the median what one meets."""

    shortest: float
    median: float


def times_of(work: Callable[[], object], *, runs: int = 7) -> Times:
    """Time some runs, after one that warms up."""
    return times_of_each({"": work}, runs=runs)[""]


def times_of_each(works: dict[str, Callable[[], object]], *, runs: int = 7) -> dict[str, Times]:
    """Time several works by turns, so that whatever else the machine does meets all of them alike."""
    seconds: dict[str, list[float]] = {name: [] for name in works}
    for run in range(runs + 1):
        for name, work in works.items():
            start = time.perf_counter()
            work()
            if run > 0:  # the first one warms up
                seconds[name].append(time.perf_counter() - start)
    return {name: Times(min(s), statistics.median(s)) for name, s in seconds.items()}


def cpu_seconds_of(work: Callable[[], object]) -> float:
    """CPU seconds of one run in this process, all threads together."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def peak_bytes() -> int:
    """Largest memory that this process has had resident."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage on Linux also counts what the parent had when it started us
        line = next(line for line in status.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM"))
        return 1024 * int(line.split()[1])
    import resource  # of POSIX alone

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def machine() -> dict[str, str]:
    """Say what the times were taken on, and how busy it was before."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8").splitlines()
        cpu = next((line.split(":")[1].strip() for line in lines if "model name" in line), cpu)
    about = {"cpu": cpu, "cores": str(os.cpu_count()), "python": platform.python_version()}
    about |= {package: version(package) for package in ("numpy", "scipy")}
    if hasattr(os, "getloadavg"):
        about["busy cores before"] = f"{os.getloadavg()[0]:.1f}"
    return about
