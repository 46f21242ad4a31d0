"""The experiment of the founding paper against its box of joint angles: error and stop of row 4 of Table 4.

    python benchmarks/paper_box.py [--json] [--widths 10,13,20] [--seeds N] [--runs DIR] [--write]

Every box is trained by trainlm as the paper's (its goal, at most 1000 epochs, no time limit) and by varpro. Finished
trainings are kept in DIR (truearm-gao2017/runs, as of `truearm reproduce gao2017`) and not repeated. With --write the
numbers replace those of the same trainings that the page of the reproduction shows, and the figure of the guide is
drawn.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path

from machine import Target, arguments_of, machine, print_json, print_table, say_machine
from truearm.pages.plotting import save_figure, styles_of
from truearm.papers.gao2017.experiment_box import FILE, BoxRun, ExperimentBoxStudy, load_experiment_box, widths_at
from truearm.papers.gao2017.experiment_box_figure import experiment_box_figure
from truearm.papers.gao2017.results import METHODS, Method
from truearm.papers.gao2017.tables import TABLES
from truearm.papers.gao2017.training import EVALUATION_STREAM, N_EVALUATION_POSES, Source, Training, run_training
from truearm.papers.gao2017.training_plan import EXPERIMENT, FULL_EFFORT, training_of

ROW = TABLES[4][-1]
PICTURE = Path(__file__).parents[1] / "docs" / "experiment_box.png"


def training_in(half_width_deg: float, method: Method, *, seed: int) -> Training:
    """Row 4 of Table 4 in a box."""
    complete = replace(FULL_EFFORT, time_limit_s=None)
    return replace(training_of(4, ROW, method, complete, seed=seed), source=Source(half_width_deg, virtual=True))


def run_in(half_width_deg: float, method: Method, *, seed: int, folder: Path) -> BoxRun:
    """Train, or read what was trained."""
    result = run_training(training_in(half_width_deg, method, seed=seed), folder, lambda *_: None)
    errors = result.errors(N_EVALUATION_POSES, EVALUATION_STREAM)
    return BoxRun(
        half_width_deg,
        method,
        seed,
        result.epochs,
        result.stop,
        round(float(errors.mean()), 6),
        round(float(errors.max()), 5),
        round(result.seconds, 1),
    )


def write(runs: list[BoxRun]) -> None:
    """Keep the numbers with the program beside those of other boxes and seeds, and draw the figure of the guide."""
    kept = {key(run): run for run in load_experiment_box().runs} if FILE.exists() else {}
    runs = [run for _, run in sorted((kept | {key(run): run for run in runs}).items())]
    about = machine()
    how = (
        f"python benchmarks/paper_box.py --write, {datetime.now(UTC):%Y-%m-%d}, {about['cpu']}, {about['cores']} "
        f"cores, Python {about['python']}, NumPy {about['numpy']}; CPU seconds"
    )
    lines = ",\n".join(f"  {json.dumps(asdict(run))}" for run in runs)
    FILE.write_text(f'{{\n "how": {json.dumps(how)},\n "runs": [\n{lines}\n ]\n}}\n', encoding="utf-8")
    study = ExperimentBoxStudy(how, tuple(runs))
    save_figure(experiment_box_figure(study, chosen=EXPERIMENT.half_width_deg, styles=styles_of(METHODS)), PICTURE)


def key(run: BoxRun) -> tuple[float, str, int]:
    """What distinguishes a training."""
    return run.half_width_deg, run.method, run.seed


def main() -> None:
    """Train and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--widths", default="10,13,15,20,25", help="half-widths [deg], 10,13,15,20,25 by default")
    parser.add_argument("--seeds", type=int, default=1, help="starts of each, 1 by default")
    parser.add_argument("--runs", type=Path, default=Path("truearm-gao2017/runs"), help="folder of the trainings")
    parser.add_argument("--write", action="store_true", help="replace the numbers and the figure of the guide")
    options = parser.parse_args()
    options.runs.mkdir(parents=True, exist_ok=True)
    widths = [float(width) for width in options.widths.split(",")]
    runs = [
        run_in(width, method, seed=seed, folder=options.runs)
        for width in widths
        for method in METHODS
        for seed in range(options.seeds)
    ]
    places = widths_at(ExperimentBoxStudy("", tuple(runs)), ROW.mean_mm)
    targets = [Target("half-width where trainlm has the paper's error [deg]", place, place) for place in places]
    if options.json:
        print_json({"runs": [asdict(run) for run in runs]}, targets)
    else:
        say_machine()
        print_table(
            ["half-width", "by", "seed", "epochs", "stop", "mean mm", "max mm", "CPU s"],
            [[str(value) for value in asdict(run).values()] for run in runs],
        )
        print(f"trainlm has the paper's {ROW.mean_mm} mm at", ", ".join(f"{p:.1f} deg" for p in places) or "no width")
    if options.write:
        write(runs)


if __name__ == "__main__":
    main()
