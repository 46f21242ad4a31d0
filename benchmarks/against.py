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
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from scipy.linalg.blas import dtrmm

from benchmarks.rows import BLAS_THREADS, ROOT, RowResult, Rows, Target, scratch
from truearm import fit
from truearm.solve import trigonometric_sums
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
    """What products of matrices take of a physical fit, and what they would at the rate of the largest of them.

    CPU seconds of the same fit, and operations counted by the sizes. Of p coefficients: at each linearisation sums of
    products of the sites' functions and Fourier transforms, for each outer region too; an inverse at each weighing of
    the evidence; for each outer region a triangle and its solutions; the root of the covariance times the functions
    for held-out readings.
    """
    from truearm.identification.estimation.covariance_root import CovarianceRoot, WithoutData
    from truearm.identification.estimation.problem import GaussNewtonSums
    from truearm.solve import group_evidence

    of: dict[str, tuple[Any, str, Callable[..., float]]] = {
        "sums of products": (GaussNewtonSums, "add", _of_sums),
        "transforms": (GaussNewtonSums, "transform", _of_transforms),
        "inverses for the evidence": (group_evidence, "_solved", lambda gram, *_: 2 / 3 * len(gram) ** 3),
        "triangles without a region": (CovarianceRoot, "without", lambda _, gram: len(gram) ** 3 / 3),
        "covariances in a region": (WithoutData, "covariances", lambda own, columns: columns.size * len(own.lower)),
        "root times functions": (CovarianceRoot, "times", _of_root),
    }
    spent = {what: np.zeros(3) for what in of}

    def timed(what: str, work: Callable[..., Any], count: Callable[..., float]) -> Callable[..., Any]:
        def run(*args: Any, **options: Any) -> Any:
            counted, begun = count(*args) / 1e9, time.thread_time()
            try:
                return work(*args, **options)
            finally:
                spent[what] += 1, time.thread_time() - begun, counted

        return run

    session = datasets.load_readings("ur10-a")
    session = session.rows(range(0, len(session), len(session) // readings)) if readings else session
    fit("ur10", session.rows(range(0, len(session), max(1, len(session) // 200))))
    with ExitStack() as patched:
        for what, (owner, name, count) in of.items():
            patched.enter_context(patch.object(owner, name, timed(what, getattr(owner, name), count)))
        begun = time.process_time()
        p = len(fit("ur10", session, model="physical").model.fit_.coefficients)
        whole = time.process_time() - begun
    rate = 2e-9 * p**3 / _shortest(partial(np.matmul, np.ones((p, p)), np.ones((p, p))))
    dense = 3 * len(session) / 4096 * _shortest(partial(np.matmul, (tall := np.ones((4096, p))).T, tall))
    table = [
        {"": what, "calls": int(n), "CPU s": s, "share": s / whole, "GFLOP": done, "GFLOP/s": done / max(s, 1e-9)}
        for what, (n, s, done) in spent.items()
    ]
    _, seconds, done = sum(spent.values())
    table.append({"": "all of these", "CPU s": seconds, "share": seconds / whole, "GFLOP": done})
    table.append({"": "the whole fit", "calls": 1, "CPU s": whole, "share": 1.0})
    note = f"{len(session)} readings, {p} coefficients. Two matrices of {p} x {p} are multiplied at {rate:.3g} "
    note += f"GFLOP/s: at that rate the operations counted take {done / rate:.3g} s."
    return RowResult(
        table,
        [
            Target("the whole fit over its products", whole / seconds, 1.5),
            Target("the whole fit over one dense product of its matrix", whole / dense, 5),
        ],
        [note],
    )


@ROWS.row("products-of-1000", quick={"readings": 400}, threads="one")
def products_of_1000(readings: int = 1000) -> RowResult:
    """What products of matrices take of a physical fit of a thousand readings."""
    return replace(products(readings), targets=[])


@ROWS.row("points", quick={"n": 200}, threads="one")
def points(n: int = 5000) -> Iterator[dict[str, Any]]:
    """CPU time of points with covariance of a kinematic model, and of the product by the triangle of its causes alone.

    Each point has the displacements of three coordinates by every cause: half a multiplication and addition by each
    pair of causes and coordinate.
    """
    session = datasets.load_readings("ur10-a")
    some = session.rows(range(0, len(session), len(session) // 200))
    model, at = fit("ur10", some, model="kinematic").model, session.rows(range(n))
    causes = len(model.shared_displacements(at.rows(range(1))))
    triangle, columns = np.asfortranarray(np.tri(causes)), np.ones((causes, 3 * n), order="F")
    done = 3e-9 * n * causes**2
    for what, call in {
        "points with covariance": partial(model.predict, at.angles, return_cov=True),
        "the product alone": partial(dtrmm, 1.0, triangle, columns, lower=1),
    }.items():
        seconds = _shortest(call)
        yield {
            "": what,
            "points": n,
            "causes": causes,
            "CPU ms": 1e3 * seconds,
            "GFLOP": done,
            "GFLOP/s": done / seconds,
        }


def _of_sums(sums: Any, residuals: Any, *_: object) -> float:
    (k, m), n, wide = residuals.shape, sums.n_narrow, [span.stop - span.start for span in sums.spans]
    transformed = {(one, other) for one, other, *_ in sums.transformed}
    pairs = [(i, j) for i in range(len(wide)) for j in range(i, len(wide)) if (i, j) not in transformed]
    of_pairs = sum((1 if i == j else 2) * wide[i] * wide[j] for i, j in pairs)
    return float(m * (k * n**2 + 2 * (n + 1) * sum(wide) + of_pairs))


def _of_transforms(sums: Any) -> float:
    m = sum(map(len, sums.angles))
    orders = [(one.orders, None if n == o else other.orders) for n, o, one, other in sums.transformed]
    return float(sum(trigonometric_sums.operations(m, *both) for both in orders)) if m else 0.0


def _of_root(root: Any, along_sites: Any, *_: object) -> float:
    (_, k, m), (narrow, *wide) = along_sites.shape, root._columns
    return float(m * (k * len(narrow) ** 2 + 2 * sum(of.size for of in wide)))


def _shortest(call: Callable[[], object]) -> float:
    """CPU seconds of a call, the least of five."""
    seconds = []
    for _ in range(5):
        begun = time.process_time()
        call()
        seconds.append(time.process_time() - begun)
    return min(seconds)


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
