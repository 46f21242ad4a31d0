"""The final test of the paper on virtual arms, and the errors of the network outside its box."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from time import process_time

import numpy as np

from truearm.arm import load_arm
from truearm.models import Compensator, HybridModel, KinematicModel, PhysicalModel
from truearm.typing import FloatArray
from truearm.wings.gao2017.results import (
    METHODS,
    MODELS,
    FinalTestResult,
    FinalTestRun,
    Method,
    OutsideErrors,
    Predictions,
)
from truearm.wings.gao2017.tables import FINAL_TEST, N_FINAL_TEST, TABLES, ModelErrors
from truearm.wings.gao2017.training import (
    ARM,
    FINAL_TEST_STREAM,
    OUTSIDE_STREAM,
    TRAINING_STREAM,
    Training,
    TrainingResult,
    stream_seed,
    virtual_arm,
)
from truearm.wings.gao2017.training_plan import EXPERIMENT, Effort, trainings

DISTANCES_DEG = (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0)
N_OUTSIDE = 500

Results = Mapping[Training, TrainingResult]


def networks_by_seed(effort: Effort, results: Results, method: Method) -> dict[int, TrainingResult]:
    """The networks of Table 4, row 4, by seed."""
    return {one.seed: results[one] for one in trainings(4, TABLES[4][-1], method, effort) if one in results}


@lru_cache(maxsize=16)
def _models(n: int, seed: int) -> dict[str, tuple[Compensator, float]]:
    """The models of the arm, identified from the readings of the networks, each with the CPU time of its fit [s]."""
    readings = EXPERIMENT.measurement(n, seed=seed, stream=TRAINING_STREAM).readings
    arm = load_arm(ARM)
    models: dict[str, Compensator] = {
        "kinematic": KinematicModel(arm, free=()),
        "hybrid": HybridModel(arm, free=()),
        "physical": PhysicalModel(arm, free=()),
    }
    fitted: dict[str, tuple[Compensator, float]] = {}
    for name in MODELS:
        begun = process_time()
        models[name].fit_readings(readings)
        fitted[name] = models[name], process_time() - begun
    return fitted


def final_test(effort: Effort, results: Results) -> FinalTestResult | None:
    """The final test on every arm that a network of Table 4, row 4, was trained for; None without any."""
    networks = {method: networks_by_seed(effort, results, method) for method in METHODS}
    seeds = sorted(set().union(*networks.values()))
    if not seeds:
        return None
    runs = tuple(
        _final_test_run(seed, {method: found[seed] for method, found in networks.items() if seed in found})
        for seed in seeds
    )
    return FinalTestResult(N_FINAL_TEST, FINAL_TEST, runs)


def _final_test_run(seed: int, networks: Mapping[Method, TrainingResult]) -> FinalTestRun:
    measurement = EXPERIMENT.measurement(N_FINAL_TEST, seed=seed, stream=FINAL_TEST_STREAM)
    angles, points = measurement.readings.angles, measurement.readings.points
    assert points is not None  # a virtual reference measures every pose
    models = _models(TABLES[4][-1].n_train, seed)
    nominal = float(np.abs(load_arm(ARM).chain.tip_in_base(angles) - points).mean())

    def errors(predicted: FloatArray, seconds: float | None = None, *, was_cut: bool = False) -> ModelErrors:
        errors = np.abs(predicted - points)
        return ModelErrors(
            float(errors.mean()),
            float(errors.max()),
            {level: int((errors > level).sum()) for level in FINAL_TEST["network"].over_mm},
            100 * (1 - float(errors.mean()) / nominal),
            seconds,
            was_cut,
        )

    return FinalTestRun(
        seed,
        {
            "nominal": errors(load_arm(ARM).chain.tip_in_base(angles)),
            **{
                method: errors(network.predict(angles), network.seconds, was_cut=network.was_cut)
                for method, network in networks.items()
            },
            **{
                name: errors(model.predict_readings(measurement.readings), seconds)
                for name, (model, seconds) in models.items()
            },
        },
        virtual_arm(seed).noise_floor(measurement)["mean_abs_coordinate_mm"],
    )


def final_test_predictions(effort: Effort, results: Results) -> dict[str, Predictions]:
    """Predictions of the nominal arm, and of varpro where it was run, on the poses of the final test of seed 0."""
    angles, points = EXPERIMENT.data(N_FINAL_TEST, seed=0, stream=FINAL_TEST_STREAM)
    predicted = {"nominal": load_arm(ARM).chain.tip_in_base(angles)}
    network = networks_by_seed(effort, results, "varpro").get(0)
    if network is not None:
        predicted["varpro"] = network.predict(angles)
    return {name: Predictions(np.degrees(angles), points, {name: values}) for name, values in predicted.items()}


def poses_outside(n: int, *, half_width_deg: float, distance_deg: float, seed: int) -> FloatArray:
    """Angles (n, 6) [rad] whose farthest joint is `distance_deg` outside a box about the working pose.

    That joint is drawn uniformly among the six, and its end among the two; the others are uniform in the larger box.
    At distance 0 the poses are uniform in the box.
    """
    rng = np.random.default_rng([*b"outside", seed, round(1000 * distance_deg)])
    arm, half = load_arm(ARM), np.radians(half_width_deg + distance_deg)
    offsets = rng.uniform(-half, half, (n, arm.n_joints))
    if distance_deg > 0:
        offsets[np.arange(n), rng.integers(arm.n_joints, size=n)] = half * rng.choice([-1.0, 1.0], n)
    return np.asarray(arm.working + offsets)


def errors_outside_box(effort: Effort, results: Results) -> OutsideErrors | None:
    """Absolute coordinate errors of row 4 of Table 4 (varpro) by the distance outside its box, over all its seeds."""
    networks = networks_by_seed(effort, results, "varpro")
    if not networks:
        return None
    errors: dict[str, list[FloatArray]] = {name: [] for name in ("varpro", "nominal", *MODELS)}
    for seed, network in networks.items():
        models, arm = _models(TABLES[4][-1].n_train, seed), virtual_arm(seed)
        for distance in DISTANCES_DEG:
            poses = poses_outside(N_OUTSIDE, half_width_deg=EXPERIMENT.half_width_deg, distance_deg=distance, seed=seed)
            readings = arm.measure(poses, seed=stream_seed(seed, OUTSIDE_STREAM)).readings
            assert readings.points is not None  # a virtual reference measures every pose
            predicted = {
                "varpro": network.predict(readings.angles),
                "nominal": arm.nominal.chain.tip_in_base(readings.angles),
                **{name: model.predict_readings(readings) for name, (model, _) in models.items()},
            }
            for name, points in predicted.items():
                errors[name].append(np.abs(points - readings.points))
    # (seeds, distances, coordinates) to a row of errors for each distance.
    rows = len(DISTANCES_DEG)
    by_distance = {
        name: np.array(values).reshape(-1, rows, 3 * N_OUTSIDE).swapaxes(0, 1).reshape(rows, -1)
        for name, values in errors.items()
    }
    return OutsideErrors(
        DISTANCES_DEG,
        {name: tuple(np.median(values, axis=1).tolist()) for name, values in by_distance.items()},
        tuple(np.percentile(by_distance["varpro"], 95, axis=1).tolist()),
        n_cut=sum(network.was_cut for network in networks.values()),
    )
