"""What every benchmark shares: the machine it ran on, times of repeated runs, and targets beside what was reached."""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal


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
        return self.reached <= self.limit if self.good == "below" else self.reached >= self.limit


@dataclass(frozen=True)
class Times:
    """Seconds of some runs: the shortest is what the machine can do undisturbed, the median what one meets."""

    shortest: float
    median: float
    runs: int


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
    return {name: Times(min(s), statistics.median(s), runs) for name, s in seconds.items()}


def machine() -> dict[str, str]:
    """Say what the times were taken on, and how busy it was before."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        cpu = next((line.split(":")[1].strip() for line in info.read_text().splitlines() if "model name" in line), cpu)
    about = {"cpu": cpu, "cores": str(os.cpu_count()), "python": platform.python_version()}
    about |= {package: version(package) for package in ("numpy", "scipy")}
    if hasattr(os, "getloadavg"):
        about["busy cores before"] = f"{os.getloadavg()[0]:.1f}"
    return about


def options_of(doc: str | None, **numbers: int) -> argparse.Namespace:
    """Read the command line: ``--json``, and numbers with their defaults."""
    parser = arguments_of(doc)
    for name, default in numbers.items():
        parser.add_argument(f"--{name}", type=int, default=default, help=f"{default} by default")
    return parser.parse_args()


def arguments_of(doc: str | None) -> argparse.ArgumentParser:
    """Begin a command line: the module's text as help, and ``--json``."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def print_json(found: dict[str, Any], targets: list[Target]) -> None:
    """Print what was found as one JSON object, with the machine and the targets."""
    judged = [asdict(target) | {"met": target.met} for target in targets]
    print(json.dumps({"machine": machine(), **found, "targets": judged}, indent=2, allow_nan=False))


def say_machine() -> None:
    """Print the machine in one line."""
    print(", ".join(f"{name} {value}" for name, value in machine().items()))


def print_table(columns: list[str], rows: list[list[str]]) -> None:
    """Print a table: the first column to the left, numbers to the right."""
    widths = [max(len(row[i]) for row in [columns, *rows]) for i in range(len(columns))]
    for row in [columns, *rows]:
        first, *others = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        print("  ".join([row[0].ljust(len(first)), *others]).rstrip())


def print_rows(found: list[dict[str, Any]], *, as_json: bool) -> None:
    """Print rows of named texts and numbers, as JSON or as a table of three decimals."""
    if as_json:
        print_json({"rows": found}, [])
        return
    say_machine()
    cells = [[cell if isinstance(cell, str) else f"{cell:.3f}" for cell in row.values()] for row in found]
    print_table(list(found[0]), cells)


def say_targets(targets: list[Target]) -> None:
    """Print targets and whether they are met."""
    sign = {"below": "<=", "above": ">="}
    print()
    print_table(
        ["target", "", "reached", ""],
        [
            [
                t.what,
                f"{sign[t.good]} {t.limit:g}",
                "-" if t.reached is None else f"{t.reached:.3g}",
                "met" if t.met else "missed",
            ]
            for t in targets
        ],
    )
