"""Rows of `identification.py` on virtual arms, whose truth is known: points, seats and one bar, B4 of the peers."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from identification_points import LEVEL, quarters, shares_of, squared_lengths
from identification_row import Row
from machine import Target
from truearm.arm import Arm, chain_from_dh, load_arm
from truearm.compensation.models import KinematicModel, NominalModel, PhysicalModel
from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.references.alignment import align
from truearm.identification.virtual import Measurement, VirtualArm, load_preset
from truearm.readings import Session, point_errors
from truearm.readings.lengths import Lengths
from truearm.typing import FloatArray

ARM = "gao2017"
MODELS = {"nominal": NominalModel, "kinematic": KinematicModel, "physical": PhysicalModel}
LIMITS = {50: 1.30, 200: 1.10, 3000: 1.03}
STRATEGY = "box"  # uniform, as in the founding paper's simulations
OTHER = "measuring"  # as a person measures parts
N_TEST = 2000
# Seeds of poses and noise; the arms' own are 0, 1, ...
TRAIN, TEST = 1000, 2000
SEATS, POSES_IN_SEAT = 10, 20
BAR_U_MM = 0.002  # standard uncertainty of the bar's length


@cache
def virtual_arm(seed: int) -> VirtualArm:
    """Draw an arm of the preset `research`."""
    return VirtualArm.draw(load_arm(ARM), load_preset("research"), seed=seed)


def measured(seed: int, strategy: str, n: int, session: int) -> Measurement:
    """Measure with a virtual arm; poses and noise follow from both seeds."""
    both = session + seed
    return virtual_arm(seed).measure(STRATEGIES[strategy](load_arm(ARM), n, seed=both).angles, seed=both)


@cache
def test_of(seed: int, strategy: str) -> tuple[Measurement, float]:
    """Poses to test on, and the noise floor there: mean absolute error of a coordinate [mm]."""
    test = measured(seed, strategy, N_TEST, TEST)
    return test, virtual_arm(seed).noise_floor(test)["mean_abs_coordinate_mm"]


@cache
def over_floor(seed: int, strategy: str, n: int) -> dict[str, Any]:
    """Mean absolute error of a coordinate over the noise floor, of every model, and which points were inside."""
    train = measured(seed, strategy, n, TRAIN).readings
    test, floor = test_of(seed, strategy)
    found: dict[str, Any] = {"floor": floor}
    for label, kind in MODELS.items():
        model = kind(load_arm(ARM)).fit_readings(train)
        points, covariance = model.predict_readings(test.readings, return_cov=True)
        assert test.readings.points is not None
        found[label] = point_errors(points, test.readings.points)["mean_abs_coordinate_mm"] / floor
    found["inside"] = squared_lengths(points, covariance, test.readings) <= LEVEL
    found["quarters"] = quarters(train.angles, test.readings.angles)
    return found


def virtual(seeds: int) -> Row:
    """Points of a tracker, few to many."""
    cells, targets, found = [], [], {}
    for strategy in (STRATEGY, OTHER):
        for n, limit in LIMITS.items():
            each = [over_floor(seed, strategy, n) for seed in range(seeds)]
            ratios = {label: [float(one[label]) for one in each] for label in MODELS}
            floor = float(np.median([one["floor"] for one in each]))
            found[f"{strategy} {n}"] = ratios | {"floor_mm": floor}
            medians = {label: float(np.median(ratios[label])) for label in MODELS}
            cells.append(
                [
                    strategy,
                    str(n),
                    f"{floor:.5f}",
                    *(f"{medians[label]:.3f}" for label in MODELS),
                    f"{min(ratios['physical']):.3f} to {max(ratios['physical']):.3f}",
                ]
            )
            if strategy == STRATEGY:
                targets.append(
                    Target(f"virtual, {n} poses: coordinate error over the floor", medians["physical"], limit)
                )
    note = (
        f"Median of {seeds} arms, {N_TEST} test poses each; floor: mean absolute coordinate error of the true function"
        " [mm]; the models: theirs over it. Judged: the box."
    )
    columns = ["poses", "n", "floor", *MODELS, "physical, all arms"]
    return Row(f"Virtual arm `research` of {ARM}, points of a tracker", columns, cells, targets, found, [note])


def virtual_coverage(seeds: int) -> dict[str, dict[str, Any]]:
    """Shares of test points in the 95 % ellipsoids, for every number of training poses."""
    shares = {}
    for n in LIMITS:
        each = [over_floor(seed, STRATEGY, n) for seed in range(seeds)]
        inside = np.concatenate([one["inside"] for one in each])
        ring, quadrant = (np.concatenate([one["quarters"][i] for one in each]) for i in (0, 1))
        shares[f"virtual {n}"] = shares_of(inside, ring, quadrant) | {"points": len(inside)}
    return shares


def seats_and_bar(seed: int) -> tuple[Session, Lengths]:
    """Readings in seats, and a bar between the two that are farthest apart."""
    arm = load_arm(ARM)
    poses = STRATEGIES["seat"](arm, SEATS * POSES_IN_SEAT, seed=TRAIN + seed, seats=SEATS)
    assert poses.seat is not None
    assert poses.seat_points is not None
    readings = (
        virtual_arm(seed)
        .measure(poses.angles, seed=TRAIN + seed, seat=poses.seat, seat_points=poses.seat_points, reference=False)
        .readings
    )
    names, first = np.unique(poses.seat, return_index=True)
    at = poses.seat_points[first]
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    a, b = np.unravel_index(int(apart.argmax()), apart.shape)
    length = apart[a, b] + BAR_U_MM * np.random.default_rng(TRAIN + seed).standard_normal()
    return readings, Lengths(names[[a]], names[[b]], np.array([length]), np.array([BAR_U_MM]))


def from_seats(seed: int, strategy: str) -> dict[str, float]:
    """Errors of an arm identified from seats and a bar, over those of the true function.

    Seats say nothing of where the base stands: the frame is fitted to the test points. Lengths are between the tips of
    one test pose and the next, against the true ones.
    """
    readings, bar = seats_and_bar(seed)
    model = PhysicalModel(load_arm(ARM)).fit_readings(readings, lengths=bar)
    test, floor = test_of(seed, strategy)
    assert test.readings.points is not None
    found = model.predict(test.readings.angles)
    T = align(found, test.readings.points)
    placed = found @ T[:3, :3].T + T[:3, 3]
    best = virtual_arm(seed).true_tip(test.readings.angles)
    truth = test.true_tips
    return {
        "coordinate": point_errors(placed, test.readings.points)["mean_abs_coordinate_mm"] / floor,
        "length": length_error(found, truth) / length_error(best, truth),
        "length_mm": length_error(found, truth),
        "length_floor_mm": length_error(best, truth),
    }


def length_error(tips: FloatArray, truth: FloatArray) -> float:
    """Mean absolute error of the lengths between tips of one pose and the next [mm]."""
    lengths, true = (np.linalg.norm(np.diff(points, axis=0)[::2], axis=1) for points in (tips, truth))
    return float(np.abs(lengths - true).mean())


def virtual_seats(seeds: int) -> Row:
    """Seats and one bar alone."""
    cells, found, targets = [], {}, []
    for strategy in (OTHER, STRATEGY):
        each = [from_seats(seed, strategy) for seed in range(seeds)]
        median = {name: float(np.median([one[name] for one in each])) for name in each[0]}
        found[strategy] = each
        cells.append(
            [
                strategy,
                *(
                    f"{median[name]:.3f} ({min(one[name] for one in each):.3f} to {max(one[name] for one in each):.3f})"
                    for name in ("coordinate", "length")
                ),
                f"{median['length_mm']:.4f}",
                f"{median['length_floor_mm']:.4f}",
            ]
        )
        if strategy == OTHER:
            targets = [
                Target("virtual, seats and a bar: coordinate error over the floor", median["coordinate"], 1.5),
                Target("virtual, seats and a bar: length error over the floor", median["length"], 2.0),
            ]
    title = f"Virtual arm `research` from {SEATS} seats x {POSES_IN_SEAT} poses and one bar (u {BAR_U_MM} mm)"
    columns = ["test poses", "coordinate / floor", "length / floor", "length [mm]", "its floor [mm]"]
    note = (
        f"Median of {seeds} arms (least to most); the bar spans the two seats farthest apart. Judged: poses in which a"
        " person measures parts."
    )
    return Row(title, columns, cells, targets, found, [note])


def b4(seeds: int) -> Row:
    """B4 of the peers: a simulated measuring arm by its published specification."""
    each = [b4_errors(seed) for seed in range(seeds)]
    cells = [
        [
            str(seed),
            *(f"{one[label]['mean_mm']:.4f} {one[label]['max_mm']:.4f}" for label in MODELS),
            f"{one['fit']:.1f}",
        ]
        for seed, one in enumerate(each)
    ]
    worst = max(one["physical"]["mean_mm"] for one in each)
    note = "Best of the peers: a Gaussian process on the residuals, mean 0.0136, max 0.0761 mm."
    return Row(
        "B4, simulated measuring arm: 1000 points with 10 um noise, 2000 noise-free test points; mean max [mm]",
        ["arm", *MODELS, "fit [s]"],
        cells,
        [Target("B4: test mean, the worst arm [mm]", worst, 0.003)],
        {"arms": each},
        [note],
    )


def b4_errors(seed: int) -> dict[str, Any]:
    """Errors of the models on one arm of B4."""
    rng = np.random.default_rng(seed)
    n, alpha, d = 6, np.pi / 2 * np.array([-1, 1, -1, 1, -1, 1]), np.array([300.0, 0, 600, 0, 500, 0])
    ranges = np.radians([60, 40, 60, 60, 40, 60])
    probe = (0.0, 0.0, 150.0)
    arm = Arm("b4", chain_from_dh(a=np.zeros(n), d=d, alpha=alpha, tip_in_flange=probe), lower=-ranges, upper=ranges)
    true = chain_from_dh(
        a=0.2 * rng.standard_normal(n),
        d=d + 0.2 * rng.standard_normal(n),
        alpha=alpha + 0.3e-3 * rng.standard_normal(n),
        theta=0.5e-3 * rng.standard_normal(n),
        tip_in_flange=probe,
    )
    phase = rng.uniform(0, 2 * np.pi, n)

    def tips(angles: FloatArray) -> FloatArray:
        return true.tip_in_base(angles + 0.2e-3 * np.cos(angles + phase))

    train, test = (rng.uniform(-ranges, ranges, (m, n)) for m in (1000, 2000))
    readings = Session(train, tips(train) + 0.01 * rng.standard_normal((1000, 3)))
    found: dict[str, Any] = {}
    for label, kind in MODELS.items():
        model = kind(arm).fit_readings(readings)
        found[label] = point_errors(model.predict(test), tips(test))
    return found | {"fit": model.fit_seconds_}
