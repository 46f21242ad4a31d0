"""Does the stated uncertainty hold? The same day, another day, far from the training, few readings of real arms.

    python benchmarks/imperfect_coverage.py [--quick] [--json]

Virtual arms gao2017 of every preset are measured at the poses of a person and identified. Some of the readings are kept
for the test: the same day. On another day the ball cages start elsewhere and the air is at another temperature. Uniform
poses lie outside the training, most of them. Real arms: 40 readings at random of UR10 series B and UR5, tested at
positions that are not among them. Counted are points in their 95 % ellipsoids; of virtual arms the true tips.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from imperfect_finding import Finding, print_findings
from task_uncertainty import TWO_POINTS, Trial
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, PhysicalModel
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.identification.planning.sampling.measuring import measuring_poses
from truearm.identification.virtual import VirtualArm, load_preset
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray

ARM = "gao2017"
PRESETS = ("research", "shop", "worn")
MODELS: dict[str, type[IdentifiedModel]] = {"kinematic": KinematicModel, "physical": PhysicalModel}
RADIUS = float(chi2.ppf(0.95, 3))
# Readings of the training, and how many arms each is tried on.
SIZES = {50: 32, 300: 32, 2000: 6}
TESTED = 300
SUBSET = 40
# Seeds of poses and days that differ from those of the arms.
TRAIN, OTHER, DAY = 1000, 5000, 77_777


class Share(NamedTuple):
    """Points inside their ellipsoids, and which of them are flagged as outside the training."""

    inside: BoolArray
    flagged: BoolArray


def share_of(model: IdentifiedModel, readings: Session, truth: FloatArray, variance: float = 0.0) -> Share:
    """`variance` is that of a coordinate of `truth` [mm^2]."""
    points, covariance = model.predict_readings(readings, return_cov=True)
    off = points - truth
    covariance = covariance + variance * np.eye(3)
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    return Share(squares < RADIUS, model.outside_training(readings))


@cache
def virtual_shares(preset: str, model: str, n: int, arms: int) -> dict[str, list[Share]]:
    """The tests of some arms."""
    arm = load_arm(ARM)
    found: dict[str, list[Share]] = {"same day": [], "another day": [], "uniform poses": []}
    for seed in range(arms):
        rng = np.random.default_rng(seed)
        virtual = VirtualArm.draw(arm, load_preset(preset), seed=seed)
        day = virtual.measure(measuring_poses(arm, n + TESTED, seed=TRAIN + seed).angles, seed=seed)
        order = rng.permutation(n + TESTED)
        learned, tested = np.sort(order[:n]), np.sort(order[n:])
        fitted = MODELS[model](arm).fit_readings(day.readings.rows(learned))
        later = virtual.measure(measuring_poses(arm, TESTED, seed=OTHER + seed).angles, seed=seed + DAY)
        lower, upper = np.clip(arm.limits.T, -np.pi, np.pi)
        uniform = virtual.measure(rng.uniform(lower, upper, (TESTED, arm.n_joints)), seed=seed)
        found["same day"].append(share_of(fitted, day.readings.rows(tested), day.true_tips[tested]))
        found["another day"].append(share_of(fitted, later.readings, later.true_tips))
        found["uniform poses"].append(share_of(fitted, uniform.readings, uniform.true_tips))
    return found


def of_subsets(name: str, repeats: int) -> tuple[FloatArray, float]:
    """Coverage of each subset of real readings, and the median size of the ellipsoids [mm]."""
    readings, arm = datasets.load_readings(name), load_arm(datasets.DATASETS[name].arm)
    rng, shares, sizes = np.random.default_rng(0), [], []
    for _ in range(repeats):
        learned = rng.permutation(len(readings))[:SUBSET]
        others = np.setdiff1d(np.arange(len(readings)), learned)
        if readings.position is not None:
            others = np.flatnonzero(~np.isin(readings.position, readings.position[learned]))
        test = readings.rows(rng.choice(others, TESTED, replace=False))
        model = PhysicalModel(arm).fit_readings(readings.rows(np.sort(learned)))
        assert test.points is not None
        variance = 0.0 if test.point_std is None else float((test.point_std**2).mean())
        shares.append(share_of(model, test, test.points, variance).inside.mean())
        covariance = model.predict_readings(test, return_cov=True)[1]
        sizes.append(float(np.median(np.linalg.det(covariance) ** (1 / 6))))
    return np.array(shares), float(np.median(sizes))


def told(each: Sequence[Share]) -> str:
    """Mean coverage, and that of the worst arm."""
    shares = np.array([one.inside.mean() for one in each])
    return f"{shares.mean():.1%}, worst arm {shares.min():.0%}"


def judged(label: str, each: Sequence[Share], low: float, high: float, worst: float) -> Finding:
    """One row."""
    shares = np.array([one.inside.mean() for one in each])
    wanted = f"{low:.0%} to {high:.0%}" + (f", worst arm {worst:.0%}" if worst else "")
    return Finding(label, wanted, told(each), bool(low <= shares.mean() <= high and shares.min() >= worst))


def virtual_rows(*, quick: bool) -> Iterator[Finding]:
    """Rows of virtual arms."""
    for n, all_arms in SIZES.items():
        arms = min(all_arms, 3 if quick else all_arms)
        for preset in PRESETS:
            found = virtual_shares(preset, "physical", n, arms)
            label = f"physical, {preset}, {n} readings, {arms} arms"
            yield judged(f"{label}: same day", found["same day"], 0.93, 0.97, 0.85)
            yield judged(f"{label}: another day", found["another day"], 0.92, 0.97, 0.0)
            yield judged(f"{label}: uniform poses", found["uniform poses"], 0.92, 0.98, 0.0)
    for model in MODELS:
        for preset in PRESETS:
            found = virtual_shares(preset, model, 300, 3 if quick else 32)
            each = found["another day"] + found["uniform poses"]
            inside = np.concatenate([one.inside[~one.flagged] for one in each])
            uniform = np.concatenate([one.inside[~one.flagged] for one in found["uniform poses"]])
            now = f"{inside.mean():.1%} of all, {uniform.mean():.1%} of uniform ones"
            label = f"{model}, {preset}, 300 readings: poses not flagged"
            yield Finding(label, "93 % to 97 %", now, bool(0.93 <= inside.mean() <= 0.97 and uniform.mean() >= 0.93))


def real_rows(*, quick: bool) -> Iterator[Finding]:
    """Rows of real arms."""
    for name in ("ur10-b", "ur5"):
        shares, size = of_subsets(name, 5 if quick else 50)
        now = f"{shares.mean():.1%}, worst {shares.min():.0%}; median half axis {2.795 * size:.3f} mm"
        met = bool(0.93 <= shares.mean() <= 0.97)
        yield Finding(f"{name}: {len(shares)} subsets of {SUBSET} readings", "93 % to 97 %", now, met)


def task_rows(*, quick: bool) -> Iterator[Finding]:
    """Lengths of a part from a physical model."""
    trial = Trial(ARM, "shop", 300, 1, "physical")
    found = [trial.on_one_arm(seed) for seed in range(3 if quick else 16)]
    for name in TWO_POINTS:
        each = np.array([one[name] for one in found])
        rms, stated = np.sqrt((each[:, 4:6] ** 2).mean(axis=0)) * 1e3
        now = f"{each[:, 0].mean():.1%}; u {stated:.1f} um for a true {rms:.1f} um"
        met = bool(0.93 <= each[:, 0].mean() <= 0.97)
        yield Finding(f"task uncertainty, shop, 300 readings: length of {name}", "93 % to 97 %", now, met)


def rows(*, quick: bool) -> list[Finding]:
    """All rows."""
    return [*virtual_rows(quick=quick), *real_rows(quick=quick), *task_rows(quick=quick)]


if __name__ == "__main__":
    print_findings(__doc__, rows)
