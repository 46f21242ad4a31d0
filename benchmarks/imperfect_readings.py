"""What can go wrong with readings, and how well truearm copes: every number of docs/imperfect-readings.md.

    python benchmarks/imperfect_readings.py [--quick] [--only outliers,coverage] [--json]

Runs the benchmarks imperfect_*.py one after the other and prints their rows together: hours with all arms, some 40
minutes with --quick. Each can be run by itself.
"""

from __future__ import annotations

import time
from dataclasses import asdict

import imperfect_coverage
import imperfect_diagnosis
import imperfect_invariance
import imperfect_outliers
import imperfect_seats
import imperfect_states
from machine import arguments_of, print_json, print_table, say_machine

PARTS = {
    "outliers": imperfect_outliers.rows,
    "diagnosis": imperfect_diagnosis.rows,
    "states": imperfect_states.rows,
    "coverage": imperfect_coverage.rows,
    "seats": imperfect_seats.rows,
    "invariance": imperfect_invariance.rows,
}


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer arms")
    parser.add_argument("--only", default=",".join(PARTS), help="parts, separated by commas; all by default")
    options = parser.parse_args()
    if unknown := set(options.only.split(",")) - set(PARTS):
        parser.error(f"expected parts among {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    found = []
    for part in options.only.split(","):
        begun = time.perf_counter()
        rows = PARTS[part](quick=options.quick)
        found += [(part, row) for row in rows]
        if not options.json:
            print(f"{part}: {len(rows)} rows, {time.perf_counter() - begun:.0f} s", flush=True)
    if options.json:
        print_json({"rows": [{"part": part, **asdict(row)} for part, row in found]}, [])
        return
    say_machine()
    marks = {True: "met", False: "missed", None: ""}
    print_table(
        ["part", "seen", "wanted", "measured", ""],
        [[part, row.what, row.wanted, row.now, marks[row.is_met]] for part, row in found],
    )
    judged = [row for _, row in found if row.is_met is not None]
    print(f"{sum(bool(row.is_met) for row in judged)} of {len(judged)} met")


if __name__ == "__main__":
    main()
