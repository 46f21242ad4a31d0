"""Shapes of the standards' tests, and a whole test taken by 100 virtual arms. One thread.

python benchmarks/verification.py [--json] [--runs N]
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")  # before NumPy is loaded

from functools import partial
from statistics import median
from time import process_time

import numpy as np

from machine import Target, options_of, print_json, print_table, say_machine, say_targets, times_of_each
from truearm.arm.catalogue import load_arm
from truearm.identification.virtual import load_preset
from truearm.verification.shapes.circumscribed_sphere import circumscribed_sphere
from truearm.verification.shapes.cylinder import fit_cylinder
from truearm.verification.shapes.sphere import fit_sphere
from truearm.verification.standards.artefacts import example_artefacts
from truearm.verification.standards.layout import lay_out_tests
from truearm.verification.standards.specification import example_specification
from truearm.verification.standards.verification_plan import load_verification_plan
from truearm.verification.tasks.posed_test import pose
from truearm.verification.tasks.sampled_arms import PresetDistribution
from truearm.verification.tasks.simulated_verification import simulate_verification

NOISE = 0.01  # mm
RANGE, ARMS, PRESETS = 2500.0, 100, ("shop", "research")


def main() -> None:
    """Measure and print."""
    options = options_of(__doc__, runs=200)
    rng = np.random.default_rng(20170101)
    away = rng.normal(size=(25, 3))
    away[:, 2] = np.abs(away[:, 2])
    ball = [800.0, 300.0, 100.0] + 12.5 * away / np.linalg.norm(away, axis=1)[:, None]
    ball += NOISE * rng.normal(size=ball.shape)
    angle, along = rng.uniform(0, 2 * np.pi, 100), rng.uniform(-40, 40, 100)
    tube = np.column_stack([20 * np.cos(angle), 20 * np.sin(angle), along]) + NOISE * rng.normal(size=(100, 3))
    centres = rng.normal(size=(5, 3))
    times = times_of_each(
        {
            "sphere from 25 points": lambda: fit_sphere(ball),
            "smallest sphere about 5 points": lambda: circumscribed_sphere(centres),
            "cylinder from 100 points": lambda: fit_cylinder(tube),
        },
        runs=options.runs,
    )
    processor: dict[str, list[float]] = {f"ISO 10360-12, 100 virtual arms, {name}": [] for name in PRESETS}
    whole = times_of_each(
        {what: partial(test_of_virtual_arms, what.split()[-1], spent) for what, spent in processor.items()}, runs=3
    )
    times |= whole
    targets = [
        Target("sphere from 25 points [ms]", 1e3 * times["sphere from 25 points"].median, 1.0),
        *(Target(f"{what} [s]", of.median, 60.0) for what, of in whole.items()),
    ]
    spent = {what: median(seconds) for what, seconds in processor.items()}
    if options.json:
        print_json({"ms": {what: 1e3 * t.median for what, t in times.items()}, "processor_s": spent}, targets)
        return
    say_machine()
    print_table(
        ["", "shortest [ms]", "median [ms]"],
        [[what, f"{1e3 * t.shortest:.3f}", f"{1e3 * t.median:.3f}"] for what, t in times.items()],
    )
    print_table(["", "processor time [s]"], [[what, f"{seconds:.1f}"] for what, seconds in spent.items()])
    say_targets(targets)


def test_of_virtual_arms(preset: str, spent: list[float]) -> None:
    """Lay out, pose and take the whole test; what the processor spent on it [s] is added to the list."""
    start = process_time()
    arm, plan = load_arm("measuring7"), load_verification_plan("iso10360-12")
    artefacts = example_artefacts(RANGE)
    simulate_verification(
        PresetDistribution(arm, load_preset(preset)),
        pose(lay_out_tests(plan, artefacts, RANGE, shoulder_mm=320.0), arm, seed=0),
        plan=plan,
        artefacts=artefacts,
        specification=example_specification(RANGE),
        n_arms=ARMS,
        seed=0,
    )
    spent.append(process_time() - start)


if __name__ == "__main__":
    main()
