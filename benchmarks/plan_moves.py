"""How far the joints move from pose to pose of a plan, and what shorter ways cost: uncertainty and time.

    python benchmarks/plan_moves.py [--json]

Each plan is made twice: of the poses that were chosen for their uncertainty alone, in a short order, and with poses
exchanged for others a short way apart. The move is that of the joint that turns most, the mean over the steps.
"""

from __future__ import annotations

import time
from math import degrees
from typing import Any

from machine import arguments_of, print_json, print_table, say_machine
from truearm.arm import load_arm
from truearm.identification.planning.prior import nominal_prior
from truearm.identification.planning.proposal import Artefact, propose

NOISE_MM, SEEDS = 0.02, (0, 1, 2)
CASES = (
    ("measuring7", Artefact("bar", 3, 400.0), 60),
    ("measuring7", Artefact("bar", 2, 500.0), 40),
    ("measuring7", Artefact("seat", 5), 50),
    ("measuring7", Artefact("tracker"), 50),
    ("gao2017", Artefact("bar", 3, 400.0), 60),
    ("gao2017", Artefact("tracker"), 50),
    ("ur10", Artefact("tracker"), 50),
    ("ur10", Artefact("bar", 2, 400.0), 40),
)


def main() -> None:
    """Measure and print."""
    options = arguments_of(__doc__).parse_args()
    rows = [row_of(name, artefact, n, seed) for name, artefact, n in CASES for seed in SEEDS]
    if options.json:
        print_json({"rows": rows}, [])
        return
    say_machine()
    print_table(
        ["arm", "artefact", "poses", "seed", "move [deg]", "shortened [deg]", "uncertainty", "CPU [s]"],
        [
            [
                *(str(row[name]) for name in ("arm", "artefact", "poses", "seed")),
                f"{row['move_deg']:.0f}",
                f"{row['shortened_deg']:.1f}",
                f"{row['uncertainty']:.3f}",
                f"{row['cpu_s']:.1f}",
            ]
            for row in rows
        ],
    )


def row_of(name: str, artefact: Artefact, n: int, seed: int) -> dict[str, Any]:
    """Moves without and with exchange, the ratio of the uncertainties, and the time that the exchange takes."""
    arm = load_arm(name)
    prior = nominal_prior(arm, noise_mm=NOISE_MM)
    begun = time.process_time()
    chosen = propose(arm, prior, artefact, n, seed=seed).proposals["i-optimal"]
    between = time.process_time()
    short = propose(arm, prior, artefact, n, to_measure="i-optimal", seed=seed).proposals["i-optimal"]
    return {
        "arm": name,
        "artefact": artefact.kind,
        "poses": n,
        "seed": seed,
        "move_deg": degrees(chosen.mean_move),
        "shortened_deg": degrees(short.mean_move),
        "uncertainty": float(short.rms_mm[-1] / chosen.rms_mm[-1]),
        "cpu_s": time.process_time() - between - (between - begun),
    }


if __name__ == "__main__":
    main()
