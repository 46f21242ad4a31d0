"""Trainers of networks: time to the same error, ours against others.

The peers run in a Python of their own (``--peers PYTHON``) that has the packages of `peers.txt`; without it only our
own trainers run. One training runs at a time, on all cores. All start from the same weights, in float64, on the same
samples; the clock stands still while an error is evaluated, and begins after imports and compilation. ``--limit`` ends
every training (750 s: ten times 75); others get twenty times ours at most, and 30 s at least. Growth with samples and
weights, and memory, are rows of ``cost``.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cost import dense_jacobian
from benchmarks.peers import Curve, Task, Watch, answer_of
from benchmarks.rows import RowResult, Rows, Target
from truearm.nets.levenberg_marquardt import train_varpro, trainlm
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import MinMaxScaler, Perceptron, nguyen_widrow
from truearm.solve.least_squares import levenberg_marquardt
from truearm.solve.least_squares_problem import MarquardtDamping, NormalEquations
from truearm.solve.stop_criteria import DampingLimit
from truearm.wings.gao2017.training import EVALUATION_STREAM, TRAINING_STREAM, Source

ROWS = Rows()
OURS = "truearm varpro"
# The boxes that the targets are stated for, whatever the reproduction of the paper finds to be its boxes.
SIMULATION, EXPERIMENT = Source(38.0, virtual=False), Source(20.0, virtual=True)
FOREVER = 10**6  # epochs: the goal or the limit ends a training


@dataclass(frozen=True)
class DenseProblem:
    """The same fit from the dense Jacobian, as MATLAB's routine has it: backpropagation, then J^T J by the BLAS."""

    full: FitProblem

    def cost(self, x: np.ndarray) -> float:
        """Half the sum of squared errors."""
        errors = self.full.network.outputs(x, self.full.inputs) - self.full.targets
        return 0.5 * float(np.vdot(errors, errors))

    def normal_equations(self, x: np.ndarray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton matrix."""
        errors = (self.full.network.outputs(x, self.full.inputs) - self.full.targets).ravel()
        J = dense_jacobian(self.full.network, x, self.full.inputs)
        return NormalEquations(0.5 * float(errors @ errors), J.T @ errors, J.T @ J)


def ours(task: Task, watch: Watch) -> str:
    """Variable projection, Nielsen's damping, factored normal equations."""
    _, record = train_varpro(
        problem_of(task), task.start, epochs=FOREVER, callback=lambda epoch: watch.epoch(epoch.weights)
    )
    return record.stop


def ours_classical(task: Task, watch: Watch) -> str:
    """Factored normal equations with MATLAB's damping and no projection."""
    _, record = trainlm(
        problem_of(task), task.start, epochs=FOREVER, min_grad=0.0, callback=lambda epoch: watch.epoch(epoch.weights)
    )
    return record.stop


def dense(task: Task, watch: Watch) -> str:
    """The stand-in for MATLAB's routine: dense Jacobian, its damping, no projection, all cores for the BLAS."""
    result = levenberg_marquardt(
        DenseProblem(problem_of(task)),
        task.start,
        damping=MarquardtDamping(),
        stops=[DampingLimit()],
        callback=lambda state: watch.epoch(lambda: state.x),
    )
    return result.reason.text


def problem_of(task: Task) -> FitProblem:
    """The task as our trainers have it."""
    sizes = tuple(int(size) for size in task.sizes)
    network = Perceptron.with_layers(sizes[0], sizes[1:-1], sizes[-1])
    return FitProblem(network, task.inputs, task.targets)


OWN: dict[str, Callable[[Task, Watch], str]] = {OURS: ours, "truearm trainlm": ours_classical, "dense LM, NumPy": dense}


@dataclass(frozen=True)
class Race:
    """Trainings of one network on one task.

    Attributes
    ----------
    task : callable
        Gives the task of a seed.
    levels : tuple of float
        Errors to reach, the hardest last: there a training ends.
    others : tuple of str
        Who runs beside ours.
    seeds : tuple of int
    """

    task: Callable[[int], Task]
    levels: tuple[float, ...]
    others: tuple[str, ...]
    seeds: tuple[int, ...]

    def run(self, peers: str | None, limit: float) -> dict[str, list[dict[str, Any]]]:
        """Curves of everyone, one for each seed; ours once before the others and once after."""
        found: dict[str, list[dict[str, Any]]] = {}

        def note(name: str, contender: str, task: Task, limit: float) -> dict[str, Any]:
            curve = run_one(contender, task, self.levels[-1], limit, peers)
            found.setdefault(name, []).append(curve)
            ran = curve["failed"] if "failed" in curve else f"{seconds_run(curve):.1f} s, {curve['end']}"
            print(f"{name}, {ran}", file=sys.stderr, flush=True)
            return curve

        for seed in self.seeds:
            task = self.task(seed)
            own = note(OURS, OURS, task, limit)
            for other in self.others:
                if other in OWN or peers:
                    note(other, other, task, min(limit, max(20 * seconds_run(own), 30.0)))
            note(f"{OURS}, again", OURS, task, limit)
        return found

    def table(self, found: dict[str, list[dict[str, Any]]]) -> list[dict[str, Any]]:
        """Everyone's times to every level, medians over the starts, and the errors at our time and at the end."""
        own, table = own_seconds(found, self.levels[-1]), []
        for name, runs in found.items():
            curves = [curve_of(run) for run in runs]
            epochs, seconds = sum(c.epochs for c in curves), sum(c.seconds[-1] for c in curves if c.seconds)
            row: dict[str, Any] = {
                "": name + "".join(f" {version}" for version in {run.get("version") for run in runs} - {None}),
                "epochs": epochs / len(curves),
                "ms each": 1e3 * seconds / max(epochs, 1),
            }
            for level in self.levels:
                reached = [s for s in (curve.seconds_to(level) for curve in curves) if s is not None]
                of = "" if len(reached) in (0, len(curves)) else f" ({len(reached)} of {len(curves)})"
                row[f"{level:g}"] = f"{statistics.median(reached):.3g}{of}" if reached else "-"
            at_ours = [curve.best_by(own) for curve in curves] if own is not None else []
            row["at our time"] = median_of([error for error in at_ours if error is not None])
            row["best"] = median_of([min(curve.errors) for curve in curves if curve.errors])
            ends = ", ".join(sorted({run.get("end") or run["failed"] for run in runs}))
            table.append(row | {"ended after": f"{seconds / len(curves):.0f} s, {ends}"})
        return table

    def found(self, runs: dict[str, list[dict[str, Any]]], targets: list[Target]) -> RowResult:
        """The table, its targets, and everyone's times as multiples of ours."""
        notes = []
        for name in runs:
            ratios = {level: ratio_of(runs, name, level) for level in self.levels}
            said = [f"{ratio} to {level:g}" for level, ratio in ratios.items() if ratio is not None]
            if said and not name.startswith(OURS):
                notes.append(f"{name}: times as long as ours, {', '.join(said)}")
        return RowResult(self.table(runs), targets, notes)


def run_one(contender: str, task: Task, goal: float, limit: float, peers: str | None) -> dict[str, Any]:
    """The curve of one training, here or in the peers' Python."""
    if contender in OWN:
        found = Watch(task, goal, limit).run(lambda watch: OWN[contender](task, watch)).as_dict()
    else:
        found = answer_of(peers, contender, vars(task), goal, limit)
    return found if "failed" in found else {"limit": limit, **found}


def seconds_run(curve: dict[str, Any]) -> float:
    """Time of training up to the last epoch seen."""
    return curve["seconds"][-1] if curve["seconds"] else 0.0


def curve_of(found: dict[str, Any]) -> Curve:
    """The curve in what a training gave; an empty one if it failed."""
    return Curve(found.get("seconds", []), found.get("errors", []), found.get("end", ""))


def from_readings(source: Source, n: int, n_test: int, hidden: tuple[int, ...], seed: int) -> Task:
    """A network from joint angles to coordinates, judged in mm."""
    angles, points = source.data(n, seed=seed, stream=TRAINING_STREAM)
    test_angles, test_points = source.data(n_test, seed=seed, stream=EVALUATION_STREAM)
    angle_scale, point_scale = MinMaxScaler.of(angles.T, what="joint"), MinMaxScaler.of(points.T, what="coordinate")
    network = Perceptron.with_layers(6, hidden, 3)
    return Task(
        sizes=np.array(network.sizes),
        inputs=angle_scale.scale(angles.T),
        targets=point_scale.scale(points.T),
        test_inputs=angle_scale.scale(test_angles.T),
        test_targets=point_scale.scale(test_points.T),
        unit=point_scale.half_range,
        squared=np.array(False),
        start=nguyen_widrow(network, seed=seed),
    )


def sinc(n: int, seed: int) -> Task:
    """The example of torch-levenberg-marquardt: sin(10 pi x) / (10 pi x) on [-1, 1], judged on its own points."""
    x = np.linspace(-1, 1, n)[None]
    y, network = np.sinc(10 * x), Perceptron.with_layers(1, (20,), 1)
    return Task(np.array(network.sizes), x, y, x, y, np.ones(1), np.array(True), nguyen_widrow(network, seed=seed))


def own_seconds(found: dict[str, list[dict[str, Any]]], level: float) -> float | None:
    """Our time to a level: median over the starts of the slower of both runs, None if one did not get there."""
    both = zip(found[OURS], found[f"{OURS}, again"], strict=True)
    times = [[curve_of(run).seconds_to(level) for run in runs] for runs in both]
    if any(seconds is None for runs in times for seconds in runs):
        return None
    return statistics.median(max(runs) for runs in times)


@dataclass(frozen=True)
class Ratio:
    """How many times as long as ours someone took to a level.

    Attributes
    ----------
    times : float
        Where it did not get there: how many times as long as ours it was given.
    reached : bool
    gave_up : bool
        Whether it stopped by itself before.
    """

    times: float
    reached: bool
    gave_up: bool

    def __str__(self) -> str:
        if self.gave_up:
            return f"never (given {self.times:.1f})"
        return f"{'' if self.reached else 'at least '}{self.times:.1f}"


def ratio_of(found: dict[str, list[dict[str, Any]]], name: str, level: float) -> Ratio | None:
    """Someone's time over ours, medians over the starts; None if ours did not get there or the other failed."""
    own, runs = own_seconds(found, level), found[name]
    if own is None or any("failed" in run for run in runs):
        return None
    times = [curve_of(run).seconds_to(level) for run in runs]
    given = [run["limit"] if seconds is None else seconds for run, seconds in zip(runs, times, strict=True)]
    gave_up = any(s is None and run["end"] != "limit" for run, s in zip(runs, times, strict=True))
    return Ratio(statistics.median(given) / own, None not in times, gave_up)


def median_of(errors: list[float]) -> str:
    """A median for a cell, or a dash."""
    return f"{statistics.median(errors):.3g}" if errors else "-"


TINY = {"poses": 400, "units": 8, "levels": (50.0, 20.0, 8.0), "limit": 3.0}


@ROWS.row("poses", quick=TINY)
def of_poses(
    seed: int = 0,
    poses: int = 9000,
    units: int = 50,
    levels: tuple[float, ...] = (1.0, 0.2, 0.0315, 0.0215),
    limit: float = 750.0,
    peers: str | None = None,
) -> RowResult:
    """6-50-50-3, 9000 exact poses of a box of +-38 deg: mean error of a coordinate on 2000 further poses [mm]."""
    race = Race(
        lambda seed: from_readings(SIMULATION, poses, 2000, (units, units), seed),
        levels,
        ("dense LM, NumPy", "torch-lm"),
        (seed,),
    )
    runs = race.run(peers, limit)
    level = levels[-2]
    ratios = [ratio_of(runs, peer, level) for peer in runs if not peer.startswith("truearm")]
    others = [ratio for ratio in ratios if ratio is not None and not ratio.gave_up]
    arrived = [ratio for ratio in others if ratio.reached]
    said = "the best peer that gets there" if arrived else "no peer gets there: at least"
    times = min((ratio.times for ratio in arrived or others), default=None)
    targets = [
        Target(f"poses, to {level:g} mm [s]", own_seconds(runs, level), 75),
        Target(f"poses, to {levels[-1]:g} mm [s]", own_seconds(runs, levels[-1]), 110),
        Target(f"poses, times as fast to {level:g} mm, {said}", times, 10, "above"),
    ]
    return race.found(runs, targets)


@ROWS.row("experiment", quick=TINY | {"poses": 300, "units": 6, "levels": (50.0, 10.0, 4.0)})
def of_experiment(
    seed: int = 0,
    poses: int = 3000,
    units: int = 30,
    levels: tuple[float, ...] = (1.0, 0.2, 0.1, 0.05, 0.0136),
    limit: float = 750.0,
    peers: str | None = None,
) -> RowResult:
    """6-30-30-3, 3000 readings of a virtual arm in a box of +-20 deg: the same on 2000 further readings [mm]."""
    race = Race(
        lambda seed: from_readings(EXPERIMENT, poses, 2000, (units, units), seed),
        levels,
        ("truearm trainlm", "dense LM, NumPy", "torch-lm", "optimistix", "pyrenn", "scikit-learn L-BFGS"),
        (seed,),
    )
    runs, targets = race.run(peers, limit), []
    for peer in runs:
        if not peer.startswith("truearm") and (ratio := ratio_of(runs, peer, levels[-1])) is not None:
            said = peer if ratio.reached else f"{peer}, which stops before" if ratio.gave_up else f"{peer}, at least"
            times = None if ratio.gave_up else ratio.times
            targets.append(Target(f"experiment, times as fast to {levels[-1]:g} mm as {said}", times, 10, "above"))
    return race.found(runs, targets)


@ROWS.row("sinc", quick={"points": 2000, "starts": 1, "limit": 3.0})
def of_sinc(
    seed: int = 0, points: int = 20_000, starts: int = 5, limit: float = 750.0, peers: str | None = None
) -> RowResult:
    """1-20-1, 20000 points of sinc(10 x): their mean squared error, from several starts."""
    seeds = tuple(range(seed, seed + starts))
    levels = (1e-4, 1e-5, 3.3e-7)
    race = Race(lambda seed: sinc(points, seed), levels, ("torch-lm", "torch-lm, as published"), seeds)
    runs = race.run(peers, limit)
    target = Target("sinc, to 3.3e-7, median of the starts [s]", own_seconds(runs, levels[-1]), 2)
    return race.found(runs, [target])
