"""The residual process: held-out errors, coverage and fit time with and without it, and what a transfer makes of it.

    python benchmarks/residual_process.py [--work SET ...] [--seeds N] [--transfer] [--json]

SET: wam, ur5, ur10-b, ur10-a; wam by default, as the others take minutes a split. `--transfer` learns from series B of
the UR10 and refits to 20 readings of series A.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.stats import chi2

from identification_points import HELD_OUT, SPLITS, squared_lengths
from identification_row import three_figures
from machine import arguments_of, print_json, print_table, say_machine
from truearm import datasets
from truearm.arm import load_arm
from truearm.compensation.models import PhysicalModel
from truearm.compensation.models.refit import refit
from truearm.readings import Session, hold_out

LEVEL = float(chi2.ppf(0.95, 3))
# Readings of the new set-up.
ROWS = 20
VARIANTS = {"without": False, "with": True}


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__ or "")
    parser.add_argument("--work", nargs="*", choices=SPLITS, metavar="SET", default=["wam"])
    parser.add_argument("--seeds", type=int, default=10, help="splits; 10 by default")
    parser.add_argument("--transfer", action="store_true", help="from series B of the UR10 to series A")
    options = parser.parse_args()
    found: dict[str, Any] = {name: on_set(name, options.seeds) for name in options.work}
    if options.transfer:
        found["transfer"] = transfer()
    if options.json:
        print_json({"seeds": options.seeds, "rows": found}, [])
        return
    say_machine()
    cells = [
        [
            name,
            variant,
            " / ".join(f"{figures[key]:.3g}" for key in ("mean_mm", "p95_mm", "max_mm")),
            f"{figures['largest_mm']:.3g}",
            f"{100 * figures['coverage']:.1f}",
            f"{figures['cpu_seconds']:.1f}",
            str(figures["kept"]),
        ]
        for name, by_variant in found.items()
        if name != "transfer"
        for variant, figures in by_variant.items()
    ]
    columns = ["set", "residual process", "mean / 95 % / max [mm]", "largest [mm]", "coverage [%]", "CPU [s]", "kept"]
    print_table(columns, cells)
    print("Means over the splits; largest: of all splits; kept: splits in which the model has the process.")
    for line in found.get("transfer", {}).get("lines", []):
        print(line)


def on_set(name: str, seeds: int) -> dict[str, dict[str, float]]:
    """Figures of both variants on what the splits of a set hold out."""
    readings, arm = datasets.load_readings(name), load_arm(datasets.DATASETS[name].arm)
    found: dict[str, list[dict[str, float]]] = {variant: [] for variant in VARIANTS}
    for seed in range(seeds):
        train, test = hold_out(readings, by=SPLITS[name], fraction=HELD_OUT, seed=seed)  # type: ignore[arg-type]
        assert test.points is not None
        for variant, residual in VARIANTS.items():
            begun = time.process_time()
            model = PhysicalModel(arm, residual=residual).fit_readings(train)
            seconds = time.process_time() - begun
            points, covariance = model.predict_readings(test, return_cov=True)
            inside = squared_lengths(points, covariance, test) <= LEVEL
            kept = float(model.residual_process_ is not None)
            more = {"coverage": float(inside.mean()), "cpu_seconds": seconds, "kept": kept}
            found[variant].append(three_figures(points, test.points) | more)
    return {
        variant: {key: float(np.mean([one[key] for one in each])) for key in each[0]}
        | {"largest_mm": max(one["max_mm"] for one in each), "kept": sum(one["kept"] for one in each)}
        for variant, each in found.items()
    }


def transfer() -> dict[str, Any]:
    """Learn from series B of the UR10, refit to some readings of series A, and test on others of them."""
    arm, old = load_arm("ur10"), datasets.load_readings("ur10-b")
    new = datasets.load_readings("ur10-a")
    chosen = np.random.default_rng(0).permutation(len(new))
    few, rest = new.rows(np.sort(chosen[:ROWS])), new.rows(np.sort(chosen[ROWS : ROWS + 3000]))
    lines = []
    for variant, residual in VARIANTS.items():
        model = PhysicalModel(arm, residual=residual).fit_readings(old)
        moved = refit(model, few)
        figures = three_figures(moved.predict(rest.angles), points_of(rest))
        lines.append(f"B to A, {variant}: mean {figures['mean_mm']:.4f} mm. {moved.residual_process_ or ''}")
    return {"lines": lines}


def points_of(readings: Session) -> np.ndarray:
    """Reference points of readings that all have one [mm]."""
    assert readings.points is not None
    return readings.points


if __name__ == "__main__":
    main()
