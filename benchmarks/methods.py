"""Methods by data sets: held-out error, fit time and coverage of truearm's models and of those of the literature.

    python benchmarks/methods.py [--sets SET ...] [--methods METHOD ...] [--splits N] [--quick] [--json FILE] [--table]

Needs scikit-learn. With `--json` every cell is added to the file when it is done, and what is in the file is not done
again. `--table` only prints what is in the file. Sets: SETS. Methods: METHODS.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from identification_points import LEVEL, squared_lengths
from identification_seats import tool_positions
from machine import machine, print_table, say_machine
from methods_residual import CHOICES, GaussianProcess, tuned
from truearm import datasets
from truearm.arm import Arm, load_arm
from truearm.compensation.models import HybridModel, KinematicModel, NetworkModel, NominalModel, PhysicalModel
from truearm.compensation.models.compensator import Compensator
from truearm.identification.judgement.cross_validation_groups import cross_validation_groups
from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.readings import Lengths, Session, hold_out
from truearm.typing import FloatArray

MODELS: dict[str, type[Compensator]] = {
    "nominal": NominalModel,
    "kinematic": KinematicModel,
    "physical": PhysicalModel,
    "hybrid": HybridModel,
}
METHODS = [*MODELS, "network", "nominal + network", *(f"kinematic + {name}" for name in CHOICES)]
TRACKER = {"wam": "row", "ur5": "row", "ur10-b": "position", "ur10-a": "position"}
SEATS = [f"mukca-{robot}" for robot in ("dinova_1", "panda_1", "panda_2", "panda_3")]
VIRTUAL = {
    "virtual box 200": (200, "box"),
    "virtual box 3000": (3000, "box"),
    "virtual 10 deg outside": (3000, "outside"),
    "virtual everyday": (3000, "everyday"),
}
SETS = ["wam", "ur5", *SEATS, *VIRTUAL, "ur10-b", "ur10-a"]
HELD_OUT, N_TEST, OUTSIDE_DEG, FEW = 0.3, 1000, 10.0, 1000
# A network from angles to coordinates: (layers, trainer) to choose from, for few and for many readings.
NETWORKS_OF_FEW = [((5,), "trainbr"), ((15,), "trainbr")]
NETWORKS_OF_MANY = [((30, 30), "varpro")]
COLUMNS = ["method", "mean [mm]", "95 % [mm]", "largest [mm]"]
COLUMNS += ["of kinematic [%]", "fit, CPU [s]", "coverage [%]", "splits"]
Split = tuple[Arm, Session, Session, Lengths | None]


@cache
def split_of(name: str, seed: int) -> Split:
    """Arm, training and test readings of a split."""
    if name in VIRTUAL:
        return virtual_split(name, seed)
    arm, readings = load_arm(datasets.DATASETS[name].arm), datasets.load_readings(name)
    if name in TRACKER:
        return arm, *hold_out(readings, by=TRACKER[name], fraction=HELD_OUT, seed=seed), None  # type: ignore[arg-type]
    robot = name.removeprefix("mukca-")
    left_out = readings.position == f"{robot}/{tool_positions(robot)[seed]}"
    return arm, readings.rows(~left_out), readings.rows(left_out), datasets.load_lengths(name)


def virtual_split(name: str, seed: int) -> Split:
    """A virtual arm of the preset `research`, measured in the paper's box or in everyday poses."""
    arm, (n, where) = load_arm("gao2017"), VIRTUAL[name]
    real = VirtualArm.draw(arm, load_preset("research"), seed=seed)
    strategy = "measuring" if where == "everyday" else "box"
    train, test = (STRATEGIES[strategy](arm, k, seed=start + seed).angles for k, start in ((n, 1000), (N_TEST, 2000)))
    if where == "outside":
        middle, half = (train.max(axis=0) + train.min(axis=0)) / 2, np.ptp(train, axis=0) / 2
        # On the faces of the box that is larger by 10 degrees: every pose is outside in one joint or more.
        unit = (test - middle) / half
        test = middle + unit / np.abs(unit).max(axis=1, keepdims=True) * (half + np.radians(OUTSIDE_DEG))
    return arm, real.measure(train, seed=1000 + seed).readings, real.measure(test, seed=2000 + seed).readings, None


def n_splits(name: str, most: int) -> int:
    """Splits of a set: for seats one for each place, otherwise as many as asked for."""
    return min(most, len(tool_positions(name.removeprefix("mukca-")))) if name in SEATS else most


def cell(name: str, method: str, seed: int) -> dict[str, float]:
    """Errors of a method on one split [mm], CPU time of the fit [s], and coverage where the method states one."""
    arm, train, test, lengths = split_of(name, seed)
    begun = time.process_time()
    with threadpool_limits(1):  # BLAS, and OpenMP of boosted trees
        predict, covers = fitted(method, arm, train, lengths)
        seconds = time.process_time() - begun
        points = predict(test)
        if name in SEATS:
            assert test.seat is not None
            means = {seat: points[test.seat == seat].mean(axis=0) for seat in np.unique(test.seat)}
            errors = np.linalg.norm(points - np.stack([means[seat] for seat in test.seat]), axis=1)
        else:
            errors = np.linalg.norm(points - test.points, axis=1)
    found = {"mean": errors.mean(), "p95": np.quantile(errors, 0.95), "max": errors.max(), "cpu_s": seconds}
    if covers is not None and name not in SEATS:
        found["coverage"] = covers(test)
    return {key: float(value) for key, value in found.items()}


Predict = Callable[[Session], FloatArray]
Covers = Callable[[Session], float]


def fitted(method: str, arm: Arm, train: Session, lengths: Lengths | None) -> tuple[Predict, Covers | None]:
    """Fit a method; how it predicts, and the share of readings in its 95 % regions."""
    if method in MODELS:
        return of_model(MODELS[method](arm).fit_readings(train, lengths=lengths))
    if method == "network":
        return of_model(direct_network(arm, train))
    first, _, second = method.partition(" + ")
    below = MODELS[first](arm).fit_readings(train)
    assert train.points is not None
    # Gross errors of the arm teach no method anything.
    rows = np.sort(below.held_out_.rows)
    used = train.rows(rows)
    make, choices = CHOICES[second]
    group = cross_validation_groups(used)
    residual = tuned(make, choices, inputs_of(used, second), train.points[rows] - below.predict_readings(used), group)

    def predict(session: Session) -> FloatArray:
        return np.asarray(below.predict_readings(session) + residual.predict(inputs_of(session, second)))

    def covers(session: Session) -> float:
        variance = residual.std(inputs_of(session, second)) ** 2
        lengths = squared_lengths(predict(session), variance[:, :, None] * np.eye(3), replace(session, point_std=None))
        return float((lengths < LEVEL).mean())

    return predict, covers if isinstance(residual, GaussianProcess) else None


def of_model(model: Compensator) -> tuple[Predict, Covers]:
    """Predictions and coverage of a model of truearm."""

    def covers(session: Session) -> float:
        points, covariance = model.predict_readings(session, return_cov=True)
        return float((squared_lengths(points, covariance, session) < LEVEL).mean())

    return model.predict_readings, covers


def inputs_of(session: Session, method: str) -> FloatArray:
    """Inputs of a method: cosines and sines of the angles; a small network has the angles, as the literature does."""
    if method.endswith("network") and method != "RBF network":
        return session.angles
    return np.hstack([np.cos(session.angles), np.sin(session.angles)])


def direct_network(arm: Arm, train: Session) -> NetworkModel:
    """The network from angles to coordinates, chosen by one held-out quarter of the training readings."""
    choices = NETWORKS_OF_FEW if len(train) < FEW else NETWORKS_OF_MANY

    def network(choice: tuple[tuple[int, ...], str]) -> NetworkModel:
        hidden, trainer = choice
        validation = 0.0 if trainer == "trainbr" else 0.15
        return NetworkModel(arm, hidden=hidden, trainer=trainer, validation=validation, epochs=100)

    if len(choices) > 1:
        group = cross_validation_groups(train)
        aside = np.isin(group, np.random.default_rng(0).permutation(group.max() + 1)[: (group.max() + 1) // 4])
        part, judge = train.rows(~aside), train.rows(aside)

        def error(choice: tuple[tuple[int, ...], str]) -> float:
            points = network(choice).fit_readings(part).predict_readings(judge)
            return float(np.linalg.norm(points - judge.points, axis=1).mean())

        choices = [min(choices, key=error)]
    return network(choices[0]).fit_readings(train)


def table(cells: dict[str, dict[str, float]], name: str) -> Iterator[list[str]]:
    """Rows of a set: mean of the splits' means and 95 % quantiles, largest of all, median CPU time, coverage.

    Methods that have not been run on all splits are compared by their mean as a share of the kinematic model's on the
    same splits.
    """
    for method in METHODS:
        seeds = [key.rpartition("/")[2] for key in cells if key.startswith(f"{name}/{method}/")]
        found = [cells[f"{name}/{method}/{seed}"] for seed in seeds]
        kinematic = [cells[key]["mean"] for seed in seeds if (key := f"{name}/kinematic/{seed}") in cells]
        if found:
            mean, p95 = (np.mean([one[figure] for one in found]) for figure in ("mean", "p95"))
            coverage = [one["coverage"] for one in found if "coverage" in one]
            yield [
                method,
                *(f"{value:#.3g}".rstrip(".") for value in (mean, p95, max(one["max"] for one in found))),
                f"{100 * mean / np.mean(kinematic):.0f}" if len(kinematic) == len(found) else "-",
                f"{np.median([one['cpu_s'] for one in found]):.1f}",
                f"{100 * np.mean(coverage):.0f}" if coverage else "-",
                str(len(found)),
            ]


def main() -> None:
    """Measure what is missing, and print."""
    doc = (__doc__ or "").replace("SETS", ", ".join(SETS)).replace("METHODS", ", ".join(METHODS))
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", nargs="+", choices=SETS, metavar="SET", default=SETS)
    parser.add_argument("--methods", nargs="+", choices=METHODS, metavar="METHOD", default=METHODS)
    parser.add_argument("--splits", type=int, default=10, help="splits of a set, 10 by default")
    parser.add_argument("--quick", action="store_true", help="one split of wam and the virtual box of 200 poses")
    parser.add_argument("--json", type=Path, help="file of results: what it has is not done again")
    parser.add_argument("--table", action="store_true", help="only print what the file has")
    options = parser.parse_args()
    sets, splits = (["wam", "virtual box 200"], 1) if options.quick else (options.sets, options.splits)
    kept: dict[str, Any] = {"machine": machine(), "cells": {}}
    if options.json and options.json.exists():
        kept = json.loads(options.json.read_text(encoding="utf-8"))
    for name in sets if not options.table else ():
        for seed in range(n_splits(name, splits)):
            for method in options.methods:
                key = f"{name}/{method}/{seed}"
                if key not in kept["cells"] and (name not in SEATS or method in ("nominal", "kinematic", "physical")):
                    kept["cells"][key] = cell(name, method, seed)
                    if options.json:
                        options.json.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    say_machine()
    for name in sets:
        print(f"\n{name}\n", flush=True)
        print_table(COLUMNS, list(table(kept["cells"], name)))


if __name__ == "__main__":
    main()
