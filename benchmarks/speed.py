"""Speed of every kind of work: what, target, now. CPU seconds with one BLAS thread unless a row says otherwise.

    python benchmarks/speed.py [--rows NAME ...] [--json] [--list]

Rows that take many minutes run only if they are named. Every row runs in a process of its own, so that no row finds
what another one loaded or left in a cache. Fitted models that several rows need are fitted once and shared as files.
Seconds of imports count only where a row says so.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from machine import Target, arguments_of, print_json, print_table, say_machine
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import Compensator, KinematicModel, NominalModel, PhysicalModel
from truearm.compensation.models.model_file import load_model
from truearm.readings import Session

MODELS: dict[str, type[Compensator]] = {"nominal": NominalModel, "kinematic": KinematicModel, "physical": PhysicalModel}
# Environment variables that a user may have set for the threads of a BLAS.
BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
REPEATS = 200  # of work of milliseconds


@dataclass(frozen=True)
class SpeedRow:
    """A line of the table.

    Attributes
    ----------
    what : str
    unit : str
    target : float
        In that unit, not to exceed.
    before : str
        What it was before this work was begun on, as the note of a machine with other work.
    measure : callable
        Takes the folder of shared files and returns the number.
    sets_threads : bool
        Whether the process starts with one BLAS thread; otherwise with the BLAS' own default, and only the program
        itself may change it.
    is_long : bool
        Whether it takes many minutes.
    """

    what: str
    unit: str
    target: float
    before: str
    measure: Callable[[Path], float]
    sets_threads: bool = True
    is_long: bool = False


def cpu_seconds_of(work: Callable[[], object]) -> float:
    """CPU seconds of one run in this process, all threads together."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def cpu_ms_of_each(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """CPU milliseconds of one of many runs, after some that warm up; the smallest of five series."""
    for _ in range(max(repeats // 10, 1)):
        work()
    return min(cpu_seconds_of(lambda: [work() for _ in range(repeats // 5)]) for _ in range(5)) / (repeats // 5) * 1e3


def ur10_readings(n: int | None = None) -> Session:
    """Readings of series A; `n` of them, evenly spaced in their order."""
    readings = datasets.load_readings("ur10-a")
    return readings if n is None else readings.rows(np.linspace(0, len(readings) - 1, n).round().astype(int))


def fit_seconds(kind: str, readings: Session) -> float:
    """CPU seconds of a fit to readings of a UR10, in a process in which a model was fitted before.

    What a first fit imports (0.2 s of it `scipy.optimize`) is no part of a fit.
    """
    NominalModel(load_arm("ur10")).fit_readings(ur10_readings(50))
    return cpu_seconds_of(lambda: MODELS[kind](load_arm("ur10")).fit_readings(readings))


def model_file(folder: Path, kind: str) -> Path:
    """A model of all readings of series A, fitted by the first row that needs it."""
    path = folder / f"{kind}.truearm"
    if not path.exists():
        MODELS[kind](load_arm("ur10")).fit_readings(ur10_readings()).save(path)
    return path


def many_readings(n: int) -> Session:
    """Readings of a virtual UR10 with errors and noise of the preset research."""
    import truearm as ta

    return ta.simulate("ur10", poses=n, seed=1).session


def elapsed_physical_seconds(n: int) -> float:
    """Elapsed seconds of a physical fit to readings with points of a virtual gao2017, on all cores."""
    import truearm as ta

    readings = ta.simulate("gao2017", poses=n, seed=1).session
    begun = time.perf_counter()
    PhysicalModel(load_arm("gao2017")).fit_readings(readings)
    return time.perf_counter() - begun


def plan_seconds(folder: Path) -> float:
    """CPU seconds of a plan; those of threads that wait for work count."""
    del folder
    import truearm as ta

    return cpu_seconds_of(lambda: ta.plan("measuring7", "tracker", poses=50))


def load_seconds(folder: Path) -> float:
    """CPU seconds of reading a model file."""
    path = model_file(folder, "physical")
    return cpu_seconds_of(lambda: load_model(path))


def whole_process_seconds(folder: Path) -> float:
    """CPU seconds of the command `truearm predict` of ten readings, imports included."""
    session = folder / "ten.csv"
    Session(ur10_readings(10).angles).save(session)
    command = [sys.executable, "-m", "truearm", "predict", str(model_file(folder, "physical")), str(session)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*command, "--out", str(folder / "points.csv")], stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def one_reading_ms(kind: str, *, covariance: bool = False) -> Callable[[Path], float]:
    """CPU milliseconds of one reading in a running process, of a model that was read from its file."""

    def measured(folder: Path) -> float:
        model = load_model(model_file(folder, kind))
        angles = ur10_readings(REPEATS).angles
        rows = iter(np.tile(angles, (3, 1))[:, None])
        return cpu_ms_of_each(lambda: model.predict(next(rows), return_cov=covariance))

    return measured


def report_seconds(folder: Path) -> float:
    """CPU seconds of a page on 3,500 readings, written to a file."""
    import truearm as ta

    model, readings = load_model(model_file(folder, "physical")), ur10_readings(3500)
    return cpu_seconds_of(lambda: ta.report(model, readings, folder / "page.html"))


def normal_equations_ratio(folder: Path) -> float:
    """Elapsed time of a Gauss-Newton matrix over that of its products alone, in turn with each other."""
    del folder
    from machine import times_of_each
    from network_epoch import bare_products
    from truearm.compensation.nets.nguyen_widrow import nguyen_widrow
    from truearm.compensation.nets.normal_equations import FitProblem
    from truearm.compensation.nets.perceptron import Perceptron

    network = Perceptron.with_layers(6, (50, 50), 3)
    rng = np.random.default_rng(0)
    problem = FitProblem(network, rng.uniform(-1, 1, (6, 9000)), rng.uniform(-1, 1, (3, 9000)))
    weights = nguyen_widrow(network, seed=0)
    times = times_of_each(
        {"ours": lambda: problem.normal_equations(weights), "bare": bare_products(network, 9000, problem.chunk)},
        runs=7,
    )
    return times["ours"].shortest / times["bare"].shortest


ROWS: dict[str, SpeedRow] = {
    "fit-physical": SpeedRow(
        "physical fit of UR10-A, 11,911 readings",
        "s",
        6.0,
        "19.3",
        lambda _: fit_seconds("physical", ur10_readings()),
    ),
    "fit-physical-1000": SpeedRow(
        "the same, 1,000 readings", "s", 1.5, "6.9", lambda _: fit_seconds("physical", ur10_readings(1000))
    ),
    "fit-nominal": SpeedRow(
        "nominal fit of UR10-A", "s", 0.15, "1.3", lambda _: fit_seconds("nominal", ur10_readings())
    ),
    "fit-kinematic": SpeedRow(
        "kinematic fit of UR10-A", "s", 0.4, "2.0", lambda _: fit_seconds("kinematic", ur10_readings())
    ),
    "fit-kinematic-100000": SpeedRow(
        "kinematic fit, 100,000 readings of a virtual UR10",
        "s",
        3.0,
        "16.5",
        lambda _: fit_seconds("kinematic", many_readings(100_000)),
    ),
    "fit-physical-100000": SpeedRow(
        "physical fit, 100,000 readings of a virtual gao2017",
        "s, elapsed",
        300.0,
        "-",
        lambda _: elapsed_physical_seconds(100_000),
        is_long=True,
    ),
    "fit-physical-1000000": SpeedRow(
        "the same, 1,000,000 readings",
        "s, elapsed",
        900.0,
        "-",
        lambda _: elapsed_physical_seconds(1_000_000),
        is_long=True,
    ),
    "plan": SpeedRow("plan, 50 poses of measuring7", "s", 4.0, "4", plan_seconds),
    "plan-threads": SpeedRow(
        "the same with the BLAS' own number of threads", "s", 4.0, "67", plan_seconds, sets_threads=False
    ),
    "load": SpeedRow("load_model of a physical model", "s", 0.5, "0.5", load_seconds),
    "load-threads": SpeedRow(
        "the same with the BLAS' own number of threads", "s", 0.5, "12", load_seconds, sets_threads=False
    ),
    "predict-process": SpeedRow("truearm predict, 10 readings, whole process", "s", 0.7, "1.9", whole_process_seconds),
    "reading-kinematic": SpeedRow("one reading, kinematic", "ms", 0.1, "1.1", one_reading_ms("kinematic")),
    "reading-physical": SpeedRow("one reading, physical", "ms", 0.3, "4.9", one_reading_ms("physical")),
    "reading-covariance": SpeedRow(
        "one reading, physical with covariance", "ms", 2.0, "23.8", one_reading_ms("physical", covariance=True)
    ),
    "report": SpeedRow("report of 3,500 readings", "s", 3.0, "6 to 8", report_seconds),
    "normal-equations": SpeedRow(
        "J^T J of 6-50-50-3, 9,000 samples, over its bare products", "", 1.25, "1.4 to 1.74", normal_equations_ratio
    ),
}


def measured(name: str, folder: Path) -> tuple[float, float]:
    """The number of a row, from a process of its own, and the most memory of that process [MB]."""
    environment = {key: value for key, value in os.environ.items() if key not in BLAS_THREADS}
    if ROWS[name].sets_threads:
        environment |= dict.fromkeys(BLAS_THREADS, "1")
    command = [sys.executable, __file__, "--one", name, "--folder", str(folder)]
    ran = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    value, memory_mb = json.loads(ran.stdout.splitlines()[-1])
    return float(value), float(memory_mb)


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    short = [name for name, row in ROWS.items() if not row.is_long]
    parser.add_argument("--rows", nargs="+", choices=list(ROWS), default=short, metavar="NAME")
    parser.add_argument("--list", action="store_true", help="print the names of the rows")
    parser.add_argument("--folder", type=Path, help="where fitted models are kept; a temporary folder by default")
    parser.add_argument("--one", choices=list(ROWS), help="print the number of one row alone, measured in this process")
    options = parser.parse_args()
    if options.list:
        print_table(["row", "what"], [[name, row.what] for name, row in ROWS.items()])
        return
    if options.one is not None:
        value = ROWS[options.one].measure(options.folder)
        print(json.dumps([value, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]))
        return
    with tempfile.TemporaryDirectory() as temporary:
        found = {name: measured(name, options.folder or Path(temporary)) for name in options.rows}
    now, memory_mb = ({name: one[k] for name, one in found.items()} for k in (0, 1))
    targets = [
        Target(f"{ROWS[name].what} [{ROWS[name].unit}]", value, ROWS[name].target) for name, value in now.items()
    ]
    if options.json:
        print_json({"rows": now, "memory_MB": memory_mb, "before": {name: ROWS[name].before for name in now}}, targets)
        return
    say_machine()
    print()
    cells = [
        [
            row.what,
            row.unit,
            row.before,
            f"{row.target:g}",
            f"{now[name]:.3g}",
            f"{memory_mb[name]:.0f}",
            "" if now[name] <= row.target else "missed",
        ]
        for name, row in ((name, ROWS[name]) for name in now)
    ]
    print_table(["what", "", "before", "target", "now", "memory [MB]", ""], cells)


if __name__ == "__main__":
    main()
