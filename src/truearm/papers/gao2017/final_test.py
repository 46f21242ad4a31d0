"""The founding paper's final test on virtual arms, and the network outside its box."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel
from truearm.papers.gao2017.tables import FINAL_TEST, TABLES
from truearm.papers.gao2017.training import (
    ARM,
    FINAL_TEST_STREAM,
    OUTSIDE_STREAM,
    TRAINING_STREAM,
    Training,
    TrainingResult,
    virtual_arm,
)
from truearm.papers.gao2017.training_plan import EXPERIMENT, METHODS, Effort, Method, trainings
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class FinalTestRun:
    """The final test on one virtual arm: deviations (n, 3) [mm] of every model on its poses."""

    seed: int
    floor_mm: float
    deviations: dict[str, FloatArray]
    seconds: dict[str, float]

    def mean_mm(self, model: str) -> float:
        """Mean absolute error of a coordinate."""
        return float(np.abs(self.deviations[model]).mean())


def networks_by_seed(
    effort: Effort, done: Mapping[Training, TrainingResult], side: Method
) -> dict[int, TrainingResult]:
    """The networks of Table 4, row 4, by seed."""
    return {one.seed: done[one] for one in trainings(4, TABLES[4][-1], side, effort) if one in done}


@lru_cache(maxsize=16)
def _kinematic(n: int, seed: int) -> KinematicModel:
    readings = EXPERIMENT.measurement(n, seed=seed, stream=TRAINING_STREAM).readings
    return KinematicModel(load_arm(ARM), free=()).fit_readings(readings)


def run_final_tests(effort: Effort, done: Mapping[Training, TrainingResult]) -> list[FinalTestRun]:
    """The final test on every arm that a network of Table 4, row 4, was trained for."""
    trained = {side: networks_by_seed(effort, done, side) for side in METHODS}
    found = []
    for seed in sorted(set().union(*trained.values())):
        measurement = EXPERIMENT.measurement(FINAL_TEST.poses, seed=seed, stream=FINAL_TEST_STREAM)
        angles, points = measurement.readings.angles, measurement.readings.points
        assert points is not None  # a virtual reference sees every pose
        kinematic = _kinematic(TABLES[4][-1].n_train, seed)
        deviations = {
            "nominal": load_arm(ARM).chain.tip_in_base(angles) - points,
            "kinematic": kinematic.predict(angles) - points,
        }
        seconds = {"kinematic": kinematic.fit_seconds_}
        for side, by_seed in trained.items():
            if seed in by_seed:
                deviations[side] = by_seed[seed].predict(angles) - points
                seconds[side] = by_seed[seed].seconds
        floor = virtual_arm(seed).noise_floor(measurement)["mean_abs_coordinate_mm"]
        found.append(FinalTestRun(seed, floor, deviations, seconds))
    return found


def final_test(experiments: Sequence[FinalTestRun]) -> dict[str, Any] | None:
    """The paper's final test and ours."""
    if not experiments:
        return None
    return {
        "poses": FINAL_TEST.poses,
        "paper": {
            "nominal": {"mean_mm": FINAL_TEST.nominal_mean_mm, "max_mm": FINAL_TEST.nominal_max_mm},
            "network": {
                "mean_mm": FINAL_TEST.network_mean_mm,
                "max_mm": FINAL_TEST.network_max_mm,
                **{f"over_{level:g}": count for level, count in FINAL_TEST.over_mm.items()},
                "removed_percent": FINAL_TEST.removed_percent,
            },
        },
        "runs": [
            {
                "seed": one.seed,
                "nominal": {
                    "mean_mm": one.mean_mm("nominal"),
                    "max_mm": float(np.abs(one.deviations["nominal"]).max()),
                },
                **{model: _compensated(one, model) for model in (*METHODS, "kinematic")},
                "noise_floor_mm": one.floor_mm,
            }
            for one in experiments
        ],
    }


def _compensated(experiment: FinalTestRun, model: str) -> dict[str, Any] | None:
    if model not in experiment.deviations:
        return None
    errors = np.abs(experiment.deviations[model])
    return {
        "mean_mm": float(errors.mean()),
        "max_mm": float(errors.max()),
        **{f"over_{level:g}": int((errors > level).sum()) for level in FINAL_TEST.over_mm},
        "removed_percent": 100 * (1 - float(errors.mean()) / experiment.mean_mm("nominal")),
        "seconds": experiment.seconds[model],
    }


DISTANCES_DEG = (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0)
N_OUTSIDE = 500


def poses_outside(n: int, *, half_width_deg: float, distance_deg: float, seed: int) -> FloatArray:
    """Angles (n, 6) [rad] whose farthest joint lies `distance_deg` outside a box about the working pose.

    That joint is drawn evenly among the six and its end among the two; the others lie evenly within the larger box.
    At distance 0 the poses lie evenly inside.
    """
    rng = np.random.default_rng([*b"outside", seed, round(1000 * distance_deg)])
    arm, half = load_arm(ARM), np.radians(half_width_deg + distance_deg)
    offsets = rng.uniform(-half, half, (n, arm.n_joints))
    if distance_deg > 0:
        offsets[np.arange(n), rng.integers(arm.n_joints, size=n)] = half * rng.choice([-1.0, 1.0], n)
    return np.asarray(arm.working + offsets)


def errors_outside_box(effort: Effort, done: Mapping[Training, TrainingResult]) -> dict[str, Any] | None:
    """Absolute coordinate errors of setting 4 (lm), by how far outside its box a pose lies, over all its seeds."""
    trained = networks_by_seed(effort, done, "ours")
    if not trained:
        return None
    errors: dict[str, list[FloatArray]] = {"lm": [], "nominal": [], "kinematic": []}
    for seed, network in trained.items():
        kinematic, arm = _kinematic(TABLES[4][-1].n_train, seed), virtual_arm(seed)
        for distance in DISTANCES_DEG:
            poses = poses_outside(N_OUTSIDE, half_width_deg=EXPERIMENT.half_width_deg, distance_deg=distance, seed=seed)
            readings = arm.measure(poses, seed=10 * seed + OUTSIDE_STREAM).readings
            assert readings.points is not None  # a virtual reference sees every pose
            predicted = {
                "lm": network.predict(readings.angles),
                "nominal": arm.nominal.chain.tip_in_base(readings.angles),
                "kinematic": kinematic.predict(readings.angles),
            }
            for name, points in predicted.items():
                errors[name].append(np.abs(points - readings.points))
    # Seeds one after the other, the distances of each together: errors of a distance in a row.
    rows = len(DISTANCES_DEG)
    by_distance = {
        name: np.array(found).reshape(-1, rows, 3 * N_OUTSIDE).swapaxes(0, 1).reshape(rows, -1)
        for name, found in errors.items()
    }
    return {
        "distance_deg": list(DISTANCES_DEG),
        **{f"{name}_median_mm": np.median(found, axis=1).tolist() for name, found in by_distance.items()},
        "lm_p95_mm": np.percentile(by_distance["lm"], 95, axis=1).tolist(),
    }
