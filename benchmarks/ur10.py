"""Real arms: errors on goal positions held out, and the time of a kinematic fit. One run.

    python benchmarks/ur10.py [--json] [--seeds N] [--runs N]

The UR10 series hold 30 % of the goal positions out, with all their readings; the UR5 and the WAM, whose readings are
each their own position, 30 % of the readings. Data sets not at hand are downloaded (`truearm.datasets`).
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import asdict

from machine import Target, options_of, print_json, print_table, say_machine, say_targets, times_of
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import KinematicModel, NominalModel
from truearm.readings import Session, hold_out, point_errors

SPLITS = {"ur10-a": "position", "ur10-b": "position", "ur5": "row", "wam": "row"}
MODELS = {"nominal": NominalModel, "kinematic": KinematicModel}
FIGURES = ("mean_mm", "p95_mm", "max_mm")

Errors = dict[str, dict[str, float]]  # of each model, each figure [mm]


def held_out_errors(name: str, readings: Session, seed: int) -> Errors:
    """Errors of both models on what one split holds out [mm]."""
    train, test = hold_out(readings, by=SPLITS[name], fraction=0.3, seed=seed)
    arm = load_arm(datasets.DATASETS[name].arm)
    found = {}
    for label, model in MODELS.items():
        errors = point_errors(model(arm).fit_readings(train).predict(test.angles), test.points)
        found[label] = {figure: errors[figure] for figure in FIGURES}
    return found


def mean_over(seeds: list[Errors]) -> Errors:
    """Mean of every figure over the splits."""
    return {m: {f: statistics.fmean(seed[m][f] for seed in seeds) for f in FIGURES} for m in MODELS}


def main() -> None:
    """Measure and print."""
    options = options_of(__doc__, seeds=5, runs=9)
    sets = {name: datasets.load_readings(name) for name in SPLITS}
    whole = sets["ur10-a"]
    fit = times_of(lambda: KinematicModel(load_arm("ur10")).fit_readings(whole), runs=options.runs)
    errors = {name: [held_out_errors(name, r, seed) for seed in range(options.seeds)] for name, r in sets.items()}
    means = {name: mean_over(seeds) for name, seeds in errors.items()}
    targets = [
        Target("UR10 series A, nominal, mean [mm]", means["ur10-a"]["nominal"]["mean_mm"], 0.76),
        Target("UR10 series A, kinematic, mean [mm]", means["ur10-a"]["kinematic"]["mean_mm"], 0.41),
        Target("kinematic fit of all rows of series A, median [s]", fit.median, 1.0),
    ]
    if options.json:
        print_json({"fit_seconds": asdict(fit), "rows": len(whole), "seeds": errors, "mean": means}, targets)
        return
    say_machine()
    print(f"\nErrors on held-out readings, mean / p95 / max [mm]; splits of seeds 0 to {options.seeds - 1}\n")
    print_table(["set", "split by", "seed", *MODELS], list(rows_of(errors, means)))
    print(f"\nkinematic fit of {len(whole)} rows: {fit.shortest:.2f} s, median of {fit.runs} runs {fit.median:.2f} s")
    say_targets(targets)


def rows_of(errors: dict[str, list[Errors]], means: dict[str, Errors]) -> Iterator[list[str]]:
    """Rows of the table: every split, then their mean."""
    for name, seeds in errors.items():
        for seed, found in [*enumerate(seeds), ("mean", means[name])]:
            cells = [" / ".join(f"{found[model][figure]:.3f}" for figure in FIGURES) for model in MODELS]
            yield [name, SPLITS[name], str(seed), *cells]


if __name__ == "__main__":
    main()
