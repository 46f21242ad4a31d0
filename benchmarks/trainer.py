"""Our trainer against others: time to the same error, growth, memory. One run.

    python benchmarks/trainer.py --peers PYTHON [--work NAME ...] [--limit SECONDS] [--plot FILE] [--json] [--quick]

The peers run in a Python of their own that has the packages of `peers.txt`; without it only our own trainers run.
One training runs at a time, on all cores. All start from the same weights, in float64, on the same samples; the clock
stands still while an error is evaluated, and begins after imports and compilation. `--limit` ends every training;
others get twenty times ours at most, and 30 s at
least.

    poses       6-50-50-3, 9000 exact poses of a box of +-38 deg: mean error of a coordinate on 2000 further poses
    experiment  6-30-30-3, 3000 readings of a virtual arm in a box of +-20 deg: the same on 2000 further readings
    sinc        1-20-1, 20000 points of sinc(10 x): their mean squared error, from several starts
    growth      time of an epoch over the number of samples and of weights
    memory      peak of a process that trains an epoch
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import growth
from machine import Target, arguments_of, print_json, print_table, say_machine, say_targets
from network_epoch import dense_jacobian
from time_to_error import Curve, Task, Watch
from truearm.compensation.nets.nguyen_widrow import nguyen_widrow
from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.perceptron import Perceptron
from truearm.compensation.nets.scaling import MinMaxScaler
from truearm.compensation.nets.train_varpro import train_varpro
from truearm.compensation.nets.trainlm import trainlm
from truearm.papers.gao2017.training import EVALUATION_STREAM, TRAINING_STREAM, Source
from truearm.solve import DampingLimit, MarquardtDamping, NormalEquations, levenberg_marquardt

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


OWN: dict[str, Callable[[Task, Watch], str]] = {
    OURS: ours,
    "truearm trainlm": ours_classical,
    "dense LM, NumPy": dense,
}


@dataclass(frozen=True)
class Race:
    """Trainings of one network on one task.

    Attributes
    ----------
    title, unit : str
    task : callable
        Gives the task of a seed.
    levels : tuple of float
        Errors to reach, the hardest last: there a training ends.
    others : tuple of str
        Who runs beside ours.
    seeds : tuple of int
    """

    title: str
    unit: str
    task: Callable[[int], Task]
    levels: tuple[float, ...]
    others: tuple[str, ...]
    seeds: tuple[int, ...] = (0,)

    def run(self, peers: Path | None, limit: float) -> dict[str, list[dict[str, Any]]]:
        """Curves of everyone, one for each seed; ours once before the others and once after."""
        found: dict[str, list[dict[str, Any]]] = {}

        def note(name: str, contender: str, task: Task, limit: float) -> dict[str, Any]:
            curve = run_one(contender, task, self.levels[-1], limit, peers)
            found.setdefault(name, []).append(curve)
            ran = curve["failed"] if "failed" in curve else f"{seconds_run(curve):.1f} s, {curve['end']}"
            print(f"{self.title.split(',')[0]}: {name}, {ran}", file=sys.stderr, flush=True)
            return curve

        for seed in self.seeds:
            task = self.task(seed)
            own = note(OURS, OURS, task, limit)
            for other in self.others:
                if other in OWN or peers:
                    note(other, other, task, min(limit, max(20 * seconds_run(own), 30.0)))
            note(f"{OURS}, again", OURS, task, limit)
        return found


def run_one(contender: str, task: Task, goal: float, limit: float, peers: Path | None) -> dict[str, Any]:
    """The curve of one training, here or in the peers' Python."""
    if contender in OWN:
        curve = Watch(task, goal, limit).run(lambda watch: OWN[contender](task, watch))
        return {"limit": limit, **curve.as_dict()}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "task.npz"
        task.write(file)
        command = [peers, Path(__file__).with_name("trainer_peers.py"), contender, file, str(goal), str(limit)]
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        return {"failed": ran.stderr.strip().rpartition("\n")[2]}
    return {"limit": limit, **json.loads(ran.stdout.strip().rpartition("\n")[2])}


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


def races(quick: bool, seed: int) -> dict[str, Race]:
    """The three races; quick ones only show that everything runs."""
    poses = Race(
        "poses, 6-50-50-3, 9000",
        "mm",
        lambda seed: from_readings(SIMULATION, 9000, 2000, (50, 50), seed),
        (1.0, 0.2, 0.0315, 0.0215),
        ("dense LM, NumPy", "torch-lm"),
        (seed,),
    )
    experiment = Race(
        "experiment, 6-30-30-3, 3000",
        "mm",
        lambda seed: from_readings(EXPERIMENT, 3000, 2000, (30, 30), seed),
        (1.0, 0.2, 0.1, 0.05, 0.0136),
        ("truearm trainlm", "dense LM, NumPy", "torch-lm", "optimistix", "pyrenn", "scikit-learn L-BFGS"),
        (seed,),
    )
    curve = Race(
        "sinc, 1-20-1, 20000",
        "squared",
        lambda seed: sinc(20_000, seed),
        (1e-4, 1e-5, 3.3e-7),
        ("torch-lm", "torch-lm, as published"),
        tuple(range(seed, seed + 5)),
    )
    if quick:
        small = {"task": lambda seed: from_readings(SIMULATION, 400, 200, (8, 8), seed), "levels": (50.0, 20.0, 8.0)}
        poses = replace(poses, title="poses, small", **small)
        noisy = {"task": lambda seed: from_readings(EXPERIMENT, 300, 200, (6, 6), seed), "levels": (50.0, 10.0, 4.0)}
        experiment = replace(experiment, title="experiment, small", **noisy)
        curve = replace(curve, title="sinc, small", task=lambda seed: sinc(2000, seed), seeds=(seed,))
    return {"poses": poses, "experiment": experiment, "sinc": curve}


# What was reached ----------------------------------------------------------------------------------------------------


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


def targets_of(name: str, found: dict[str, Any]) -> list[Target]:
    """The numbers to reach."""
    if name == "poses":
        first, second = (own_seconds(found, level) for level in (0.0315, 0.0215))
        ratios = [ratio_of(found, peer, 0.0315) for peer in found if not peer.startswith("truearm")]
        peers = [ratio for ratio in ratios if ratio is not None and not ratio.gave_up]
        arrived = [ratio for ratio in peers if ratio.reached]
        said = "the best peer that gets there" if arrived else "no peer gets there: at least"
        return [
            Target("poses, to 0.0315 mm [s]", first, 75),
            Target("poses, to 0.0215 mm [s]", second, 110),
            Target(f"poses, times as fast to 0.0315 mm, {said}", least(arrived or peers), 10, "above"),
        ]
    if name == "experiment":
        level, ratios = 0.0136, {}
        for peer in found:
            if not peer.startswith("truearm") and (ratio := ratio_of(found, peer, level)) is not None:
                said = (
                    peer if ratio.reached else f"{peer}, which stops before" if ratio.gave_up else f"{peer}, at least"
                )
                ratios[said] = None if ratio.gave_up else ratio.times
        return [
            Target(f"experiment, times as fast to {level} mm as {said}", times, 10, "above")
            for said, times in ratios.items()
        ]
    if name == "sinc":
        return [Target("sinc, to 3.3e-7, median of the starts [s]", own_seconds(found, 3.3e-7), 2)]
    if name == "growth":
        steepest = max(found["exponent_in_samples"], found["exponent_in_samples_last_decade"])
        return [Target("growth, exponent in samples, of all and of the last decade", steepest, 1.05)]
    return [
        Target(f"memory, peak with {case['samples']} samples [MB]", case["with_an_epoch"] / 1e6, 400) for case in found
    ]


def least(ratios: list[Ratio]) -> float | None:
    """The smallest, None of none."""
    return min((ratio.times for ratio in ratios), default=None)


def say_race(race: Race, found: dict[str, list[dict[str, Any]]]) -> None:
    """Print everyone's times to every level, and the errors at our time and at the end."""
    own = own_seconds(found, race.levels[-1])
    starts = f", median of {len(race.seeds)} starts" if len(race.seeds) > 1 else ""
    print(f"\n{race.title}: seconds to an error [{race.unit}]{starts}\n")
    rows = []
    for name, runs in found.items():
        curves = [curve_of(run) for run in runs]
        row = [name + "".join(f" {version}" for version in {run.get("version") for run in runs} - {None})]
        epochs, seconds = sum(c.epochs for c in curves), sum(c.seconds[-1] for c in curves if c.seconds)
        row += [f"{epochs / len(curves):.0f}", f"{1e3 * seconds / max(epochs, 1):.0f}"]
        for level in race.levels:
            times = [curve.seconds_to(level) for curve in curves]
            reached = [seconds for seconds in times if seconds is not None]
            of = "" if len(reached) in (0, len(times)) else f" ({len(reached)} of {len(times)})"
            row.append(f"{statistics.median(reached):.3g}{of}" if reached else "-")
        at_ours = [curve.best_by(own) for curve in curves] if own is not None else []
        row.append(median_of([error for error in at_ours if error is not None]))
        row.append(median_of([min(curve.errors) for curve in curves if curve.errors]))
        row.append(
            f"{seconds / len(curves):.0f} s, " + ", ".join(sorted({run.get("end") or run["failed"] for run in runs}))
        )
        rows.append(row)
    columns = ["", "epochs", "ms each", *(f"{level:g}" for level in race.levels), "at our time", "best", "ended after"]
    print_table(columns, rows)
    for name in found:
        if not name.startswith(OURS):
            ratios = {level: ratio_of(found, name, level) for level in race.levels}
            said = [f"{ratio} to {level:g}" for level, ratio in ratios.items() if ratio is not None]
            print(f"{name}: times as long as ours, {', '.join(said)}" if said else f"{name}: no times")


def median_of(errors: list[float]) -> str:
    """A median for a cell, or a dash."""
    return f"{statistics.median(errors):.3g}" if errors else "-"


def say_growth(found: dict[str, Any]) -> None:
    """Print times of epochs beside their flops."""
    for key in ("by_samples", "by_weights"):
        print("\nAn epoch of varpro, 6-units-units-3: normal equations, output layer eliminated, one step\n")
        rows = [
            [
                str(p["samples"]),
                str(p["weights"]),
                f"{p['seconds']:.3g}",
                f"{p['flops']:.2g}",
                f"{p['flops'] / p['seconds'] / 1e9:.0f}",
            ]
            for p in found[key]
        ]
        print_table(["samples", "weights", "s", "predicted flops", "Gflop/s"], rows)
    print(
        f"\nexponent in samples {found['exponent_in_samples']:.3f}, last decade "
        f"{found['exponent_in_samples_last_decade']:.3f}; in weights {found['exponent_in_weights']:.2f}"
    )


def say_memory(found: list[dict[str, Any]]) -> None:
    """Print peaks of memory."""
    print("\nPeak memory of a process of its own, 6-units-units-3 [MB]\n")
    stages = ("imports", "with_data", "with_equations", "with_an_epoch")
    rows = [[str(c["samples"]), str(c["weights"]), *(f"{c[stage] / 1e6:.0f}" for stage in stages)] for c in found]
    print_table(["samples", "weights", *(stage.replace("_", " ") for stage in stages)], rows)


def measured(name: str, options: Any) -> Any:
    """Run one of the works."""
    quick = options.quick
    if name == "growth":
        if quick:
            return growth.growth([300, 1000, 3000], [4, 8], units_fixed=8, samples_fixed=300)
        return growth.growth(
            [1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000],
            [6, 12, 18, 25, 30, 40, 50, 60, 72],
            units_fixed=30,
            samples_fixed=9000,
        )
    if name == "memory":
        return [growth.memory(n, 8 if quick else 50) for n in ((2000, 20_000) if quick else (9000, 1_000_000))]
    return races(quick, options.seed)[name].run(options.peers, min(options.limit, 3.0) if quick else options.limit)


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    names = ["poses", "experiment", "sinc", "growth", "memory"]
    parser.add_argument("--peers", type=Path, help="a Python that has the packages of peers.txt")
    parser.add_argument("--work", nargs="+", choices=names, default=names, help="all by default")
    parser.add_argument("--limit", type=float, default=750.0, help="of a training [s], 750 by default: ten times 75")
    parser.add_argument("--seed", type=int, default=0, help="of poses and start weights, 0 by default")
    parser.add_argument("--plot", type=Path, help="draw the growth into this file (.svg, .png)")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: only shows that everything runs")
    options = parser.parse_args()
    if not options.json:
        say_machine()
    found, targets = {}, []
    for name in options.work:
        found[name] = measured(name, options)
        targets += [] if options.quick else targets_of(name, found[name])
        if options.plot and name == "growth":
            growth.plot(found[name], options.plot)
        if options.json:
            continue
        if name == "growth":
            say_growth(found[name])
        elif name == "memory":
            say_memory(found[name])
        else:
            say_race(races(options.quick, options.seed)[name], found[name])
    if options.json:
        print_json({"quick": options.quick, "seed": options.seed, "limit_s": options.limit, **found}, targets)
    elif targets:
        say_targets(targets)


if __name__ == "__main__":
    main()
