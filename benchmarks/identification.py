"""Identification of real and virtual arms: the numbers to reach, each beside its target. One run.

    python benchmarks/identification.py [--work ROW ...] [--json] [--seeds N]

Rows: ROWS. All by default. Real data sets not at hand are downloaded (`truearm.datasets`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict

import identification_cost as cost
import identification_points as points
import identification_pruning as pruning
import identification_seats as seats
import identification_transfer as transfer
import identification_virtual as virtual
from identification_row import Row
from machine import arguments_of, print_json, print_table, say_machine, say_targets

ROWS: dict[str, Callable[[int], Row]] = {
    "ur10-b": points.ur10_b,
    "ur10-a": points.ur10_a,
    "transfer": transfer.transfer,
    "ur5": points.ur5,
    "wam": points.wam,
    "panda-1": seats.panda_1,
    "panda-2": seats.panda_2,
    "panda-3": seats.panda_3,
    "dinova-1": seats.dinova_1,
    "virtual": virtual.virtual,
    "virtual-seats": virtual.virtual_seats,
    "b4": virtual.b4,
    "coverage": points.coverage,
    "pruning": pruning.pruning,
    "cost": cost.cost,
}


def main() -> None:
    """Measure and print."""
    parser = arguments_of((__doc__ or "").replace("ROWS", ", ".join(ROWS)))
    parser.add_argument("--work", nargs="+", choices=ROWS, metavar="ROW", default=list(ROWS), help="all by default")
    parser.add_argument("--seeds", type=int, default=5, help="splits, or virtual arms; 5 by default")
    options = parser.parse_args()
    if not options.json:
        say_machine()
    done: dict[str, Row] = {}
    seconds: dict[str, float] = {}
    for name in options.work:
        begun = time.perf_counter()
        done[name] = ROWS[name](options.seeds)
        seconds[name] = time.perf_counter() - begun
        if not options.json:
            say(name, done[name], seconds[name])
    targets = [target for row in done.values() for target in row.targets]
    if options.json:
        rows = {name: {"seconds": seconds[name], **asdict(row)} for name, row in done.items()}
        print_json({"seeds": options.seeds, "rows": rows}, targets)
    else:
        say_targets(targets)


def say(name: str, row: Row, seconds: float) -> None:
    """Print a row."""
    print(f"\n{name}: {row.title}\n", flush=True)
    print_table(row.columns, row.cells)
    for note in row.notes:
        print(note)
    print(f"({seconds:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
