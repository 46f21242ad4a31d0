"""Speed of every kind of work: CPU seconds with one BLAS thread unless a row says otherwise.

Every row runs in a process of its own, so that no row finds what another one loaded or left in a cache. Fitted models
that several rows need are fitted once and shared as files. Seconds of imports count only where a row says so.
"""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target, cpu_seconds_of, scratch, times_of, times_of_each
from truearm.arm import Chain, load_arm
from truearm.arm.urdf import write_urdf
from truearm.identification.estimation.covariance_root import CovarianceRoot
from truearm.identification.estimation.identification_result import ComposedArm
from truearm.models import Compensator, KinematicModel, NominalModel, PhysicalModel
from truearm.models.model_file import load_model
from truearm.readings import Session
from truearm.wings.importing import datasets
from truearm.wings.planning.virtual import load_preset

ROWS = Rows()
MODELS: dict[str, type[Compensator]] = {"nominal": NominalModel, "kinematic": KinematicModel, "physical": PhysicalModel}
REPEATS = 200  # of work of milliseconds


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


def elapsed_physical_seconds(n: int) -> float:
    """Elapsed seconds of a physical fit to readings with points of a virtual gao2017, on all cores."""
    readings = ta.simulate("gao2017", poses=n, seed=1).session
    begun = time.perf_counter()
    PhysicalModel(load_arm("gao2017")).fit_readings(readings)
    return time.perf_counter() - begun


def plan_seconds() -> float:
    """CPU seconds of a plan; those of threads that wait for work count."""
    return cpu_seconds_of(lambda: ta.plan("measuring7", "tracker", poses=50))


def load_seconds() -> float:
    """CPU seconds of reading a model file."""
    path = model_file("physical")
    return cpu_seconds_of(lambda: load_model(path))


def whole_process_seconds(*command: str | Path) -> float:
    """CPU seconds of a command of truearm, imports included."""
    return python_seconds("-m", "truearm", *command)


def python_seconds(*arguments: str | Path) -> float:
    """CPU seconds of Python with some arguments; a first run compiles the files, as an installer does."""

    def run() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run_compiled(*arguments)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    run()
    return run()


def run_compiled(*arguments: str | Path) -> str:
    """What Python with some arguments writes to its standard error; it keeps what it compiles."""
    environment = os.environ | {"PYTHONPYCACHEPREFIX": str(scratch() / "compiled")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command, pipe = [sys.executable, *arguments], subprocess.PIPE
    ran = subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, stderr=pipe, text=True, check=True)
    return ran.stderr


def fit_of_fifty() -> tuple[str | Path, ...]:
    """The arguments of `truearm fit` of a kinematic model of 50 readings, which are written."""
    session = scratch() / "fifty.csv"
    ur10_readings(50).save(session)
    return "fit", session, "--arm", "ur10", "--model", "kinematic", "--out", scratch() / "fifty.truearm"


def fit_process_seconds() -> float:
    """CPU seconds of `truearm fit` of a kinematic model."""
    return whole_process_seconds(*fit_of_fifty())


@ROWS.row("start-up", "truearm fit, 50 readings, kinematic, whole process: what takes longest to import")
def start_up(packages: int = 12) -> RowResult:
    """Shares of the time of all imports by package, each without what it imports; those of SciPy and ours in parts."""
    command = fit_of_fifty()
    seconds = whole_process_seconds(*command)
    times, counts = Counter[str](), Counter[str]()
    for line in run_compiled("-X", "importtime", "-m", "truearm", *command).splitlines():
        if found := re.match(r"import time: +(\d+) \| +\d+ \| +(\S+)", line):
            parts = found[2].split(".")
            name = ".".join(parts[: 2 if parts[0] in ("scipy", "truearm") else 1])
            times[name] += int(found[1])
            counts[name] += 1
    total = sum(times.values())
    table = [
        {"package": name, "modules": counts[name], "share [%]": 100 * time_us / total}
        for name, time_us in times.most_common(packages)
    ]
    return RowResult(table, [Target("CPU time of the whole process [s]", seconds, 0.6)])


def predict_process_seconds() -> float:
    """CPU seconds of `truearm predict`."""
    session = scratch() / "ten.csv"
    Session(ur10_readings(10).angles).save(session)
    return whole_process_seconds("predict", model_file("physical"), session, "--out", scratch() / "points.csv")


def one_reading_ms(kind: str, *, covariance: bool = False) -> float:
    """CPU milliseconds of one reading in a running process, of a model that was read from its file."""
    model = load_model(model_file(kind))
    rows = iter(np.tile(ur10_readings(REPEATS).angles, (3, 1))[:, None])
    return cpu_ms_of_each(lambda: model.predict(next(rows), return_cov=covariance))


def report_seconds() -> float:
    """CPU seconds of a page, written to a file."""
    model, readings = load_model(model_file("physical")), ur10_readings(3500)
    return cpu_seconds_of(lambda: ta.report(model, readings, scratch() / "page.html"))


def model_file(kind: str) -> Path:
    """A model of all readings of series A, fitted by the first row that needs it."""
    path = scratch() / f"{kind}.truearm"
    if not path.exists():
        MODELS[kind](load_arm("ur10")).fit_readings(ur10_readings()).save(path)
    return path


def many_readings(n: int) -> Session:
    """Readings of a virtual UR10 with errors and noise of the preset research."""
    return ta.simulate("ur10", poses=n, seed=1).session


OWN = "the same with the BLAS' own number of threads"
# What a small fit minimises with, looks for neighbours with, and reads options and arm files with.
ALONE = "import scipy.optimize, scipy.spatial, typer, pydantic"
for _name, _what, _unit, _target, _measure in (
    ("fit-physical", "physical fit of UR10-A", "s", 6.0, lambda: fit_seconds("physical", ur10_readings())),
    ("fit-physical-1000", "the same, 1,000 readings", "s", 1.5, lambda: fit_seconds("physical", ur10_readings(1000))),
    ("fit-nominal", "nominal fit of UR10-A", "s", 0.15, lambda: fit_seconds("nominal", ur10_readings())),
    ("fit-kinematic", "kinematic fit of UR10-A", "s", 0.4, lambda: fit_seconds("kinematic", ur10_readings())),
    (
        "fit-kinematic-100000",
        "kinematic fit, 100,000 readings of a virtual UR10",
        "s",
        3.0,
        lambda: fit_seconds("kinematic", many_readings(100_000)),
    ),
    (
        "fit-physical-100000",
        "physical fit, 100,000 readings of a virtual gao2017",
        "s, elapsed",
        300.0,
        lambda: elapsed_physical_seconds(100_000),
    ),
    (
        "fit-physical-1000000",
        "the same, 1,000,000 readings",
        "s, elapsed",
        900.0,
        lambda: elapsed_physical_seconds(1_000_000),
    ),
    ("plan", "plan, 50 poses of measuring7", "s", 4.0, plan_seconds),
    ("plan-threads", OWN, "s", 4.0, plan_seconds),
    ("load", "load_model of a physical model", "s", 0.5, load_seconds),
    ("load-threads", OWN, "s", 0.5, load_seconds),
    ("fit-process", "truearm fit, 50 readings, kinematic, whole process", "s", 0.6, fit_process_seconds),
    (
        "imports",
        "of it imports of SciPy's optimize and spatial, typer and pydantic",
        "s",
        0.6,
        lambda: min(python_seconds("-c", ALONE) for _ in range(4)),
    ),
    ("predict-process", "truearm predict, 10 readings, whole process", "s", 0.5, predict_process_seconds),
    ("reading-kinematic", "one reading, kinematic", "ms", 0.1, lambda: one_reading_ms("kinematic")),
    ("reading-physical", "one reading, physical", "ms", 0.3, lambda: one_reading_ms("physical")),
    (
        "reading-covariance",
        "one reading, physical with covariance",
        "ms",
        2.0,
        lambda: one_reading_ms("physical", covariance=True),
    ),
    ("report", "report of 3,500 readings", "s", 3.0, report_seconds),
):
    ROWS.row(
        _name,
        _what,
        unit=_unit,
        target=_target,
        threads="default" if _what == OWN else "one",
        is_long="elapsed" in _unit,
    )(_measure)


@ROWS.row("points-limit", threads="one", quick={"readings": 500})
def points_limit(readings: int = 5000) -> RowResult:
    """Points with covariance of a kinematic model: what one product with the root of its covariance takes of the time.

    A triangle of p columns times the derivatives of three coordinates at n readings is 3 n p^2 flops, at the speed of
    the product of two large matrices in the same process.
    """
    model, angles = load_model(model_file("kinematic")), ur10_readings(readings).angles
    composed = ComposedArm.of(model.fit_.perturbed_chain, model.fit_.coefficients)
    fewer, covariance = composed.without_repeated(model.fit_.covariance)
    p = CovarianceRoot.of(covariance, fewer.perturbed_chain).n_rows
    large, flops = np.random.default_rng(0).normal(size=(1000, 1000)), 3 * readings * p**2
    rate = 2 * len(large) ** 3 / min(cpu_seconds_of(lambda: large @ large) for _ in range(9))
    whole = min(cpu_seconds_of(lambda: model.predict(angles, return_cov=True)) for _ in range(19))
    row = {
        "columns": p,
        "flops [1e9]": 1e-9 * flops,
        "speed [1e9/s]": 1e-9 * rate,
        "derivatives [MB]": 24e-6 * readings * p,
        "product [ms]": 1e3 * flops / rate,
        "points [ms]": 1e3 * whole,
    }
    return RowResult(
        [row], [Target(f"{readings} points with covariance, kinematic, over one product", whole * rate / flops, 2.0)]
    )


# Kinematics -----------------------------------------------------------------------------------------------------------

ARM = "ur10"


def best_us(work: Callable[[], object], n: int, *, repeats: int = 7) -> float:
    """Shortest of some runs [us a pose]: what the machine can do when nothing else disturbs it."""
    return times_of(work, runs=repeats).shortest / n * 1e6


def ours(chain: Chain, angles: np.ndarray) -> dict[str, float]:
    """Time each of our four ways through the chain [us a pose]."""
    n = len(angles)

    def all_chunks() -> None:
        for _ in chain.tip_derivatives_by_chunk(angles):
            pass

    return {
        "tip_in_base": best_us(lambda: chain.tip_in_base(angles), n),
        "pose": best_us(lambda: chain.pose(angles), n),
        "tip_derivatives_by_chunk": best_us(all_chunks, n),
        "tip_derivatives": best_us(lambda: chain.tip_derivatives(angles), n),
    }


def pinocchios(angles: np.ndarray) -> dict[str, float]:
    """Time Pinocchio on the same arm [us a pose]; nothing where it is not installed."""
    try:
        import pinocchio
    except ImportError:
        return {}
    with tempfile.TemporaryDirectory() as folder:
        write_urdf(load_arm(ARM), Path(folder) / "arm.urdf")
        model = pinocchio.buildModelFromUrdf(str(Path(folder) / "arm.urdf"))
    data = model.createData()
    tip = model.getFrameId("tip")
    n = len(angles)
    rows = list(angles)

    def empty() -> None:
        for _ in rows:
            pass

    def forward() -> None:
        step = pinocchio.forwardKinematics
        for q in rows:
            step(model, data, q)

    def placed() -> None:
        step = pinocchio.framesForwardKinematics
        for q in rows:
            step(model, data, q)

    def regressor() -> None:
        step, then = pinocchio.forwardKinematics, pinocchio.computeFrameKinematicRegressor
        frame = pinocchio.LOCAL_WORLD_ALIGNED
        for q in rows:
            step(model, data, q)
            then(model, data, tip, frame)

    loop = best_us(empty, n, repeats=3)
    timed = {
        "pinocchio forwardKinematics": forward,
        "pinocchio framesForwardKinematics": placed,
        "pinocchio with computeFrameKinematicRegressor": regressor,
    }
    return {name: best_us(work, n, repeats=3) - loop for name, work in timed.items()}


def targets_of(us: dict[str, float]) -> list[Target]:
    """What to reach: two times, and to be ahead of Pinocchio where it is installed."""
    targets = [
        Target("pose [us]", us["pose"], 0.7),
        Target("derivatives by all six motions at all places [us]", us["tip_derivatives"], 3.0),
    ]
    if "pinocchio forwardKinematics" in us:
        forward = us["pinocchio forwardKinematics"] / us["pose"]
        derivative = us["pinocchio with computeFrameKinematicRegressor"] / us["tip_derivatives"]
        targets.append(
            Target("pinocchio's forward kinematics, called from Python, over ours", forward, 1.0, good="above")
        )
        targets.append(Target("pinocchio's kinematic regressor of the tip over ours", derivative, 1.0, good="above"))
    return targets


@ROWS.row("kinematics", threads="one", quick={"poses": 1000})
def kinematics(poses: int = 100_000) -> RowResult:
    """Forward kinematics and derivatives, us a pose, beside Pinocchio's own loop if it is installed.

    Pinocchio works pose by pose, so its loop runs in Python; the time of an empty loop over the same rows is taken off.
    """
    arm = load_arm(ARM)
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (poses, arm.n_joints))
    us = ours(arm.chain, angles) | pinocchios(angles)
    return RowResult([{"": name, "us a pose": value} for name, value in us.items()], targets_of(us))


# Shapes of the standards' tests, and a whole test ---------------------------------------------------------------------

NOISE = 0.01  # mm
RANGE, ARMS, PRESETS = 2500.0, 100, ("shop", "research")


@ROWS.row("shapes", threads="one", quick={"runs": 5})
def shapes(runs: int = 200) -> RowResult:
    """Sphere, smallest sphere."""
    from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
    from truearm.wings.laboratory.shapes.minimum_zone import circumscribed_sphere

    rng = np.random.default_rng(20170101)
    away = rng.normal(size=(25, 3))
    away[:, 2] = np.abs(away[:, 2])
    ball = [800.0, 300.0, 100.0] + 12.5 * away / np.linalg.norm(away, axis=1)[:, None]
    ball += NOISE * rng.normal(size=ball.shape)
    centres = rng.normal(size=(5, 3))
    times = times_of_each(
        {
            "sphere from 25 points": lambda: fit_sphere(ball),
            "smallest sphere about 5 points": lambda: circumscribed_sphere(centres),
        },
        runs=runs,
    )
    table = [{"": what, "shortest [ms]": 1e3 * t.shortest, "median [ms]": 1e3 * t.median} for what, t in times.items()]
    return RowResult(table, [Target("sphere from 25 points [ms]", table[0]["median [ms]"], 1.0)])


@ROWS.row("whole-test", threads="one", quick={"arms": 2, "presets": ("shop",)})
def whole_test(arms: int = 100, presets: tuple[str, ...] = PRESETS) -> RowResult:
    """A whole test of ISO 10360-12 by virtual arms: layout, poses and measurements, median of four."""
    table, targets = [], []
    for preset in presets:
        cpu: list[float] = []
        times = times_of(
            lambda preset=preset, cpu=cpu: cpu.append(cpu_seconds_of(partial(taken, preset, arms))), runs=3
        )
        row = {"preset": preset, "median [s]": times.median, "processor time [s]": float(np.median(cpu))}
        table.append(row)
        targets.append(Target(f"ISO 10360-12, {arms} virtual arms, {preset} [s]", times.median, 60.0))
    return RowResult(table, targets)


def taken(preset: str, arms: int) -> None:
    """Lay out, pose and take the whole test."""
    from truearm.wings.laboratory.standards.artefacts import example_artefacts
    from truearm.wings.laboratory.standards.layout import lay_out_tests
    from truearm.wings.laboratory.standards.specification import example_specification
    from truearm.wings.laboratory.standards.verification_plan import load_verification_plan
    from truearm.wings.laboratory.tasks.posed_test import pose
    from truearm.wings.laboratory.tasks.sampled_arms import PresetDistribution
    from truearm.wings.laboratory.tasks.simulated_verification import simulate_verification

    arm, plan = load_arm("measuring7"), load_verification_plan("iso10360-12")
    artefacts = example_artefacts(RANGE)
    simulate_verification(
        PresetDistribution(arm, load_preset(preset)),
        pose(lay_out_tests(plan, artefacts, RANGE, shoulder_mm=320.0), arm, seed=0),
        plan=plan,
        artefacts=artefacts,
        specification=example_specification(RANGE),
        n_arms=arms,
        seed=0,
    )
