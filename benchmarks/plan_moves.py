"""How far the joints move from pose to pose of a plan, and what shorter ways cost: uncertainty, error and time.

    python benchmarks/plan_moves.py [--json]

Each plan is made twice: of the poses that were chosen for their uncertainty alone, in a short order, and with poses
exchanged for others a short way apart. The move is that of the joint that turns most, the mean over the steps. A
virtual arm with the errors of the preset research is measured at both and identified (`planning.errors_of`): its error
in the volume is stated, root mean square.
"""

from __future__ import annotations

import time
from math import degrees
from typing import Any

from machine import arguments_of, print_json, print_table, say_machine
from planning import BAR_MM, errors_of
from truearm.arm import load_arm
from truearm.identification.planning.prior import nominal_prior
from truearm.identification.planning.proposal import Artefact, propose
from truearm.identification.virtual import VirtualArm, load_preset

NOISE_MM, SEEDS = 0.02, (0, 1, 2)
CASES = (
    ("measuring7", Artefact("bar", 3, BAR_MM), 60),
    ("measuring7", Artefact("bar", 2, BAR_MM), 40),
    ("measuring7", Artefact("seat", 5), 50),
    ("measuring7", Artefact("tracker"), 50),
    ("gao2017", Artefact("bar", 3, BAR_MM), 60),
    ("gao2017", Artefact("tracker"), 50),
    ("ur10", Artefact("tracker"), 50),
    ("ur10", Artefact("bar", 2, BAR_MM), 40),
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
        ["arm", "artefact", "poses", "seed", "move [deg]", "shortened [deg]", "uncertainty", "error [mm]", "CPU [s]"],
        [
            [
                *(str(row[name]) for name in ("arm", "artefact", "poses", "seed")),
                f"{row['move_deg']:.0f}",
                f"{row['shortened_deg']:.1f}",
                f"{row['uncertainty']:.3f}",
                f"{row['error_mm']:.4f} -> {row['error_shortened_mm']:.4f}",
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
    plan = propose(arm, prior, artefact, n, seed=seed)
    between = time.process_time()
    shortened = propose(arm, prior, artefact, n, to_measure="i-optimal", seed=seed)
    cpu_s = time.process_time() - between - (between - begun)
    chosen, short = (one.proposals["i-optimal"] for one in (plan, shortened))
    virtual = VirtualArm.draw(arm, load_preset("research"), seed=seed)
    error, error_shortened = (errors_of(virtual, one, "i-optimal", seed=1 + seed) for one in (plan, shortened))
    return {
        "arm": name,
        "artefact": artefact.kind,
        "poses": n,
        "seed": seed,
        "move_deg": degrees(chosen.mean_move),
        "shortened_deg": degrees(short.mean_move),
        "uncertainty": float(short.rms_mm[-1] / chosen.rms_mm[-1]),
        "error_mm": error["physical_rms_mm"],
        "error_shortened_mm": error_shortened["physical_rms_mm"],
        "cpu_s": cpu_s,
    }


if __name__ == "__main__":
    main()
