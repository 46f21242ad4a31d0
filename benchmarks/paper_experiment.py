"""The founding paper's experiment on virtual arms, beside the paper's own figures. One run.

    python benchmarks/paper_experiment.py [--json] [--seeds N] [--first N] [--epochs N] [--half-width DEG] [--trainlm]

3000 poses of a box train a 6-30-30-3 network, 200 further poses test it; each seed is another arm, with other poses,
noise and start weights. The paper does not state its box, and every error of the network depends on it: the box is
that of `truearm demo`, or of `--half-width`. `--trainlm` also trains the first seed's network as MATLAB's routine of
that name does, for as many epochs as fit into the time that ours took.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import replace
from typing import Any

from machine import Target, arguments_of, print_json, print_table, say_machine, say_targets
from truearm.compensation.models import NetworkModel
from truearm.readings import point_errors
from truearm.workflows.demo import PAPER_NETWORK_MM, PAPER_NOMINAL_MM, PAPER_SETTINGS, Experiment, experiment

PAPER_REMOVED_PERCENT, PAPER_SECONDS = 97, 404
MEAN, MAX = "mean_abs_coordinate_mm", "max_abs_coordinate_mm"


def trained_classically(done: Experiment) -> dict[str, float]:
    """The same network trained by `trainlm` for about as long, and its errors on the test poses."""
    ours = done.models["network"]
    trial = 20

    def fitted(epochs: int) -> NetworkModel:
        model = NetworkModel(**ours.get_params(deep=False))
        return model.set_params(trainer="trainlm", epochs=epochs, max_fail=epochs).fit_readings(done.training.readings)

    start = time.perf_counter()
    fitted(trial)
    epochs = int(trial * ours.fit_seconds_ / (time.perf_counter() - start))
    model = fitted(epochs)
    test = done.tests["box"].readings
    errors = point_errors(model.predict(test.angles), test.points)
    return {
        "epochs": len(model.record_.perf) - 1,
        "fit_seconds": model.fit_seconds_,
        MEAN: errors[MEAN],
        MAX: errors[MAX],
    }


def targets_of(summaries: list[dict[str, Any]]) -> list[Target]:
    """The paper's figures as limits: every seed has to meet them, so that the worst one is judged."""
    nets = [summary["models"]["network"] for summary in summaries]
    seeds = "worst seed" if len(nets) > 1 else "one seed"
    return [
        Target(
            f"network, mean absolute coordinate error, {seeds} [mm]", max(n[MEAN] for n in nets), PAPER_NETWORK_MM[0]
        ),
        Target(
            f"network, largest absolute coordinate error, {seeds} [mm]", max(n[MAX] for n in nets), PAPER_NETWORK_MM[1]
        ),
        Target(
            f"share of the nominal error removed, {seeds} [%]",
            min(n["removed_percent"] for n in nets),
            PAPER_REMOVED_PERCENT,
            good="above",
        ),
        Target(f"training time, {seeds} [s]", max(n["fit_seconds"] for n in nets), 60),
    ]


def rows_of(summaries: list[dict[str, Any]]) -> list[list[str]]:
    """Rows of the table: every seed, their mean, the paper."""

    def pair(errors: dict[str, float], digits: int = 4) -> str:
        return f"{errors[MEAN]:.{digits}f} / {errors[MAX]:.{digits}f}"

    rows = []
    for summary in summaries:
        nominal, network, kinematic, hybrid, physical = (
            summary["models"][name] for name in ("nominal", "network", "kinematic", "hybrid", "physical")
        )
        rows.append(
            [
                str(summary["seed"]),
                pair(nominal),
                pair(network),
                f"{network['removed_percent']:.1f}",
                f"{network['fit_seconds']:.1f}",
                pair(kinematic),
                pair(hybrid),
                pair(physical),
                pair(summary["noise_floor"]),
                pair(network["outside"], 1),
                pair(kinematic["outside"], 3),
                pair(hybrid["outside"], 3),
                pair(physical["outside"], 3),
            ]
        )
    paper_nominal, paper_network = (" / ".join(f"{x:.4f}" for x in xs) for xs in (PAPER_NOMINAL_MM, PAPER_NETWORK_MM))
    rows.append(["paper", paper_nominal, paper_network, str(PAPER_REMOVED_PERCENT), str(PAPER_SECONDS), *[""] * 8])
    return rows


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="5 by default")
    parser.add_argument("--first", type=int, default=0, help="the first seed, 0 by default")
    parser.add_argument("--epochs", type=int, default=PAPER_SETTINGS.epochs, help=f"{PAPER_SETTINGS.epochs} by default")
    parser.add_argument("--half-width", type=float, default=PAPER_SETTINGS.half_width_deg, help="of the box [deg]")
    parser.add_argument("--trainlm", action="store_true", help="train the first seed's network classically too")
    options = parser.parse_args()
    settings = replace(PAPER_SETTINGS, epochs=options.epochs, half_width_deg=options.half_width)
    if not options.json:
        say_machine()
    done = [experiment(seed=seed, settings=settings) for seed in range(options.first, options.first + options.seeds)]
    summaries = [one.summary() for one in done]
    classical = trained_classically(done[0]) if options.trainlm else None
    if options.json:
        print_json(
            {"epochs": options.epochs, "half_width_deg": options.half_width, "seeds": summaries, "trainlm": classical},
            targets_of(summaries),
        )
        return
    box = f"box of +-{options.half_width:g} deg"
    print(f"\nAbsolute error of a coordinate, mean / max [mm]; {box}, {options.epochs} epochs at most\n")
    columns = ["seed", "nominal", "network", "removed %", "s", "kinematic", "hybrid", "physical", "noise floor"]
    outside = [f"{name} outside" for name in ("network", "kinematic", "hybrid", "physical")]
    print_table([*columns, *outside], rows_of(summaries))
    nets = [summary["models"]["network"] for summary in summaries]
    mean, largest = (statistics.fmean(n[figure] for n in nets) for figure in (MEAN, MAX))
    seconds = statistics.median(n["fit_seconds"] for n in nets)
    print(f"\nnetwork, mean over the seeds: {mean:.4f} / {largest:.4f} mm, median time {seconds:.1f} s")
    if classical:
        print(
            f"trainlm, seed {options.first}, {classical['epochs']} epochs, {classical['fit_seconds']:.1f} s: ", end=""
        )
        print(f"{classical[MEAN]:.4f} / {classical[MAX]:.4f} mm")
    say_targets(targets_of(summaries))


if __name__ == "__main__":
    main()
