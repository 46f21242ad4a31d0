"""Speed against an earlier commit: the same calls of both, in turns, as ratios of CPU time.

Each change compared with the one before hides what they add up to, so the reference stays where it is. The source of
the commit is unpacked beside this one and run by the same Python with the packages that are installed. Only names of
`truearm` that both have are called.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from benchmarks.rows import BLAS_THREADS, ROOT, RowResult, Rows, Target, scratch
from truearm import fit
from truearm.wings.importing import datasets

ROWS = Rows()
REFERENCE = "6f465a7"  # of 25 November 2026


class Work(NamedTuple):
    """Statements that prepare, a call that is timed, and the ratio to reach."""

    prepare: str
    call: str
    target: float


READ = "s = ta.read_session('{all}'); some = ta.read_session('{some}'); ta.fit('ur10', some, model='kinematic')"
SOME, MODEL = "ta.read_session('{thousand}')", "m = ta.fit('ur10', some, model='{model}').model; q = s.angles[:5000]"
WORKS = {
    "physical fit of UR10-A": Work(READ, "ta.fit('ur10', s, model='physical')", 0.5),
    "physical fit of 1,000 of its readings": Work(f"{READ}; s = {SOME}", "ta.fit('ur10', s, model='physical')", 0.5),
    "auto of 200": Work(READ, "ta.fit('ur10', some)", 0.7),
    "nominal fit of UR10-A": Work(READ, "ta.fit('ur10', s, model='nominal')", 0.7),
    "kinematic fit of UR10-A": Work(READ, "ta.fit('ur10', s, model='kinematic')", 0.8),
    "one point with covariance, kinematic, 200 times": Work(
        f"{READ}; {MODEL}".replace("{model}", "kinematic"),
        "[m.predict(q[i : i + 1], return_cov=True) for i in range(200)]",
        0.6,
    ),
    "5,000 points with covariance, kinematic": Work(
        f"{READ}; {MODEL}".replace("{model}", "kinematic"), "m.predict(q, return_cov=True)", 1.0
    ),
    "5,000 points with covariance, physical": Work(
        f"{READ}; {MODEL}".replace("{model}", "physical"), "m.predict(q, return_cov=True)", 0.6
    ),
}
TIMED = "import time, truearm as ta; {prepare}; begun = time.process_time(); {call}; print(time.process_time() - begun)"


@ROWS.row("turns", quick={"only": "nominal", "turns": 1})
def turns(commit: str = REFERENCE, turns: int = 3, only: str = "") -> Iterator[dict[str, Any]]:
    """CPU seconds of the same calls now and at a commit: the shortest of some turns of each, and their ratio."""
    sources = {"then": unpacked(commit), "now": ROOT / "src"}
    files = sessions()
    for what, work in WORKS.items():
        if only not in what:
            continue
        prepare = work.prepare.format(**files)
        seconds: dict[str, list[float]] = {name: [] for name in sources}
        for _ in range(turns):
            for name, source in sources.items():
                seconds[name].append(cpu_seconds(TIMED.format(prepare=prepare, call=work.call), source))
        then, now = min(seconds["then"]), min(seconds["now"])
        is_met = "met" if now / then <= work.target else "missed"
        yield {"": what, "then [s]": then, "now [s]": now, "ratio": now / then, "target": work.target, " ": is_met}


@ROWS.row("products", quick={"readings": 400}, threads="one")
def products(readings: int = 0) -> RowResult:
    """What the products of matrices take of a physical fit, which no other work can make shorter.

    In CPU seconds of the same fit, and the operations by the sizes: of n readings and p coefficients a matrix of the
    normal equations at each linearisation, an inverse at each weighing of the evidence, a triangle for each outer
    region, the root of the covariance times the derivatives once for held-out readings.
    """
    from truearm.identification.estimation import problem
    from truearm.identification.estimation.covariance_root import CovarianceRoot, WithoutData
    from truearm.solve import group_evidence

    of = {
        "matrices of the normal equations": (problem.SmallMotionProblem, "normal_equations"),
        "matrices of regions": (problem.SmallMotionProblem, "sums_of"),
        "inverses for the evidence": (group_evidence, "_solved"),
        "triangles without a region": (CovarianceRoot, "without"),
        "root times derivatives": (CovarianceRoot, "times"),
        "roots of a region": (WithoutData, "spread"),
    }
    spent = {what: [0.0, 0] for what in of}

    def timed(what: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any, **options: Any) -> Any:
            begun = time.process_time()
            try:
                return work(*args, **options)
            finally:
                spent[what][0] += time.process_time() - begun
                spent[what][1] += 1

        return run

    session = datasets.load_readings("ur10-a")
    session = session.rows(range(0, len(session), len(session) // readings)) if readings else session
    fit("ur10", session.rows(range(0, len(session), max(1, len(session) // 200))))
    with ExitStack() as patched:
        for what, (owner, name) in of.items():
            patched.enter_context(patch.object(owner, name, timed(what, getattr(owner, name))))
        begun = time.process_time()
        p = len(fit("ur10", session, model="physical").model.fit_.coefficients)
        whole = time.process_time() - begun
    table = [{"": what, "calls": n, "CPU s": seconds, "share": seconds / whole} for what, (seconds, n) in spent.items()]
    seconds = sum(row["CPU s"] for row in table)
    table.append({"": "the whole fit", "calls": 1, "CPU s": whole, "share": 1.0})
    note = f"{len(session)} readings, {p} coefficients; products together {seconds:.3g} s"
    return RowResult(table, [Target("the whole fit over its products", whole / seconds, 1.5)], [note])


def sessions() -> dict[str, Path]:
    """Session files of UR10-A: all of it, a thousand and two hundred of its readings."""
    whole = datasets.load_readings("ur10-a")
    found = {}
    for name, n in {"all": len(whole), "thousand": 1000, "some": 200}.items():
        found[name] = scratch() / f"{name}.csv"
        whole.rows(range(0, len(whole), len(whole) // n)).save(found[name])
    return found


def unpacked(commit: str) -> Path:
    """The folder with the package as it was at a commit."""
    packed = subprocess.run(["git", "archive", commit, "src"], cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout
    with tarfile.open(fileobj=BytesIO(packed)) as files:
        files.extractall(scratch() / commit, filter="data")
    return scratch() / commit / "src"


def cpu_seconds(code: str, source: Path) -> float:
    """What a program prints last, run with one BLAS thread and the package of that folder."""
    environment = os.environ | dict.fromkeys(BLAS_THREADS, "1") | {"PYTHONPATH": str(source)}
    ran = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return float(ran.stdout.split()[-1])
