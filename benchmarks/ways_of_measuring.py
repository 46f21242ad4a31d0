"""Distances to anchors and several tips on virtual arms: error and coverage of points of another day.

    python benchmarks/ways_of_measuring.py [ARMS] [MODEL]

Each arm is identified from 40 poses with three wires of 0.05 mm, placed by 20 points and tested on others; and from 40
poses with three tips of which two have unknown offsets, tested on all three.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

import truearm as ta
from truearm.identification.virtual import Measurement, VirtualArm
from truearm.readings import Session

NOMINAL, POSES, TEST_POSES = "ur10", 40, 60
OFFSETS = np.array([[0.0, 0.0, 0.0], [80.0, 10.0, -30.0], [-20.0, 95.0, 15.0]])


def with_tips(virtual: VirtualArm, measured: Measurement, seed: int) -> Session:
    """Each pose with a point of every tip, with the noise of the instrument."""
    state = replace(measured.state, angles=measured.true_angles)
    R, tips = virtual.perturbed_chain.poses(state, virtual.systematic.coefficients)
    points = tips[:, None] + np.einsum("nab,kb->nka", R, OFFSETS)
    noise = virtual.preset.reference_std_mm * np.random.default_rng(seed).standard_normal(points.shape)
    k = len(OFFSETS)
    readings = measured.readings.rows(np.repeat(np.arange(len(tips)), k))
    names = np.tile([f"N{i + 1}" for i in range(k)], len(tips))
    return replace(readings, points=(points + noise).reshape(-1, 3), point_std=None, tip=names, numbers=None)


def by_distances(arm_seed: int, model: str) -> ta.Evaluation:
    """The arm identified by wires and placed by points, tested on other points."""
    wires = ta.simulate(NOMINAL, poses=POSES, strategy="uniform", arm_seed=arm_seed, anchors=3, reference=False)
    seen = ta.simulate(NOMINAL, poses=TEST_POSES + 20, strategy="uniform", arm_seed=arm_seed, seed=1).session
    fitted = ta.fit(NOMINAL, wires.session, model=model).model
    placed = ta.refit(fitted, seen, free=["base"], n_readings=20).model
    return ta.evaluate(placed, seen)


def by_tips(arm_seed: int, model: str) -> ta.Evaluation:
    """The arm identified with three tips, tested on other poses with the same tips."""
    taken = [
        ta.simulate(NOMINAL, poses=n, strategy="uniform", arm_seed=arm_seed, seed=seed)
        for seed, n in enumerate((POSES, TEST_POSES))
    ]
    train, test = (with_tips(one.virtual, one.measurement, 100 + seed) for seed, one in enumerate(taken))
    return ta.evaluate(ta.fit(NOMINAL, train, model=model).model, test)


def main() -> None:
    """Print a line for each way of measuring."""
    n_arms = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    model = sys.argv[2] if len(sys.argv) > 2 else "kinematic"
    for name, run in (("three wires", by_distances), ("three tips", by_tips)):
        begun = time.process_time()
        found = [run(seed, model) for seed in range(n_arms)]
        error, nominal = (np.array([one.errors[of]["mean_mm"] for one in found]) for of in ("model", "nominal"))
        coverage = 100 * np.array([one.coverage for one in found])
        print(
            f"{name}, {n_arms} arms, {model}: mean error {error.mean():.4f} mm (nominal {nominal.mean():.4f}), "
            f"coverage of 95 % {coverage.mean():.1f} % ({coverage.min():.1f} to {coverage.max():.1f}), "
            f"{(time.process_time() - begun) / n_arms:.1f} s CPU an arm",
            flush=True,
        )


if __name__ == "__main__":
    main()
