"""Methods by data sets: held-out error, fit time and coverage of truearm's models and of those of the literature.

Needs scikit-learn. With ``--keep FILE`` every cell is added to the file when it is done, and what is in the file is not
done again; ``--splits 0`` only prints what is in it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.held_out import LEVEL, split, squared_lengths
from benchmarks.held_out import MODELS as IDENTIFYING
from benchmarks.identification import tool_positions
from benchmarks.methods_residual import CHOICES, GaussianProcess, tuned
from benchmarks.rows import RowResult, Rows, machine, scratch
from truearm.arm import Arm, load_arm
from truearm.identification.references.cross_validation_groups import cross_validation_groups
from truearm.models import HybridModel, NetworkModel
from truearm.models.compensator import Compensator
from truearm.readings import Lengths, Session
from truearm.typing import FloatArray
from truearm.wings.importing import datasets
from truearm.wings.planning.designs.sampling import STRATEGIES
from truearm.wings.planning.virtual import VirtualArm, load_preset

ROWS = Rows()
MODELS: dict[str, type[Compensator]] = {**IDENTIFYING, "hybrid": HybridModel}
METHODS = [*MODELS, "network", "nominal + network", *(f"kinematic + {name}" for name in CHOICES)]
SEATS = [f"mukca-{robot}" for robot in ("dinova_1", "panda_1", "panda_2", "panda_3")]
VIRTUAL = {
    "virtual box 200": (200, "box"),
    "virtual box 3000": (3000, "box"),
    "virtual 10 deg outside": (3000, "outside"),
    "virtual everyday": (3000, "everyday"),
}
SETS = ["wam", "ur5", *SEATS, *VIRTUAL, "ur10-b", "ur10-a"]
N_TEST, OUTSIDE_DEG, FEW = 1000, 10.0, 1000
# A network from angles to coordinates: (layers, trainer) to choose from, for few and for many readings.
NETWORKS_OF_FEW = [((5,), "trainbr"), ((15,), "trainbr")]
NETWORKS_OF_MANY = [((30, 30), "varpro")]
Split = tuple[Arm, Session, Session, Lengths | None]


@cache
def split_of(name: str, seed: int) -> Split:
    """Arm, training and test readings of a split."""
    if name in VIRTUAL:
        return virtual_split(name, seed)
    if name not in SEATS:
        return (*split(name, seed), None)
    robot, readings = name.removeprefix("mukca-"), datasets.load_readings(name)
    left_out = readings.position == f"{robot}/{tool_positions(robot)[seed]}"
    arm = load_arm(datasets.DATASETS[name].arm)
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


def cell(name: str, method: str, seed: int) -> dict[str, float]:
    """Errors of a method on one split [mm], CPU time of the fit [s], and coverage where the method states one."""
    arm, train, test, lengths = split_of(name, seed)
    begun = time.process_time()
    with threadpool_limits(1):  # BLAS, and OpenMP of boosted trees
        predict, covers = fitted(method, arm, train, lengths)
        seconds = time.process_time() - begun
        points = predict(test)
        if name in SEATS:
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


def rows_of(cells: dict[str, dict[str, float]], name: str) -> Iterator[dict[str, Any]]:
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
            yield {
                "method": method,
                "mean [mm]": float(mean),
                "95 % [mm]": float(p95),
                "largest [mm]": max(one["max"] for one in found),
                "of kinematic [%]": 100 * float(mean / np.mean(kinematic)) if len(kinematic) == len(found) else None,
                "fit, CPU [s]": float(np.median([one["cpu_s"] for one in found])),
                "coverage [%]": 100 * float(np.mean(coverage)) if coverage else None,
                "splits": len(found),
            }


def rows_for(name: str) -> Callable[..., RowResult]:
    """The row of a set."""

    def measured(splits: int = 10, methods: tuple[str, ...] = tuple(METHODS), keep: str | None = None) -> RowResult:
        file = Path(keep or scratch() / "methods.json")
        kept: dict[str, Any] = {"machine": machine(), "cells": {}}
        if file.exists():
            kept = json.loads(file.read_text(encoding="utf-8"))
        known = [one for one in methods if name not in SEATS or one in IDENTIFYING]
        # Of seats one split for each place.
        most = min(splits, len(tool_positions(name.removeprefix("mukca-")))) if name in SEATS else splits
        for key, method, seed in ((f"{name}/{one}/{seed}", one, seed) for seed in range(most) for one in known):
            if key not in kept["cells"]:
                kept["cells"][key] = cell(name, method, seed)
                file.write_text(json.dumps(kept, indent=1), encoding="utf-8")
        return RowResult(list(rows_of(kept["cells"], name)))

    return measured


for _name in SETS:
    ROWS.row(_name.replace(" ", "-"), _name, quick={"splits": 1})(rows_for(_name))
