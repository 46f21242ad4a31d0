"""Interim checks as a whole: another arm of the type, false alarms, and the size of change that is stated as seen.

    python benchmarks/interim_check.py [--arms N] [--series N] [--json]

Virtual arms of `gao2017` (preset `shop`, kinematic models of 150 readings) take twelve checks of 27 readings; the
thirteenth is of the same arm, or of another one without a serial number. Then simulated checks, whose readings
scatter as normal ones do, with a correlation of consecutive checks: the share of series with an alarm
of the whole check within 30 unchanged ones, and the share of changes of the stated size that the thirteenth shows.
"""

from __future__ import annotations

import datetime
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import truearm as ta
from machine import options_of, print_rows
from truearm.typing import FloatArray
from truearm.verification.monitor.assessment import RecalibrationAdvice
from truearm.verification.monitor.control_chart import control_rules
from truearm.verification.monitor.interim_check import CheckReading, CheckValue, InterimCheck
from truearm.verification.monitor.whole_check import WholeCheck, whole_check

ARM, PRESET, CHECKS, LATER, SIDES = "gao2017", "shop", 12, 30, 9
START = datetime.datetime(2026, 1, 1)
ARTEFACTS = ["seat cone"] * 10 + ["seat bar A"] * 4 + ["seat bar B"] * 4 + ["sphere ball"] * 9


def answers(number: int, folder: Path) -> tuple[ta.CheckResult, ta.CheckResult]:
    """The thirteenth check of a virtual arm, and one taken with another arm in its place."""
    trained = ta.simulate(ARM, poses=150, preset=PRESET, arm_seed=number, seed=1000 + number).session
    model = ta.fit(ARM, trained, model="kinematic").model
    plan = folder / f"plan{number}.csv"
    ta.plan_check(model, length_mm=500, sphere_mm=25).save(plan)

    def check(i: int, arm_seed: int, history: Path) -> ta.CheckResult:
        taken = ta.rehearse(ARM, plan, preset=PRESET, arm_seed=arm_seed, seed=1000 * number + i)
        readings = replace(taken.session, serial_number=None)
        when = START + datetime.timedelta(days=30 * i)
        return ta.check(model, readings, history, lengths=taken.lengths, date=when)

    kept = folder / f"history{number}.sqlite"
    for i in range(CHECKS):
        check(i, number, kept)
    copy = Path(shutil.copy(kept, folder / f"other{number}.sqlite"))
    return check(CHECKS, number, kept), check(CHECKS, number + 100, copy)


def check_of(deviations: FloatArray, number: int) -> InterimCheck:
    """A check with these deviations (27, 3), in the same poses as all others."""
    readings = tuple(
        CheckReading(artefact, (i / 10, i / 7), tuple(one))
        for i, (artefact, one) in enumerate(zip(ARTEFACTS, deviations.tolist(), strict=True))
    )
    value = CheckValue("SPAT.2s", "cone", 0.02, 0.002, 0.0, 10)
    return InterimCheck(START + datetime.timedelta(days=number), "m" * 64, "s" * 64, None, (value,), readings)


def simulated(rng: np.random.Generator, n: int, correlation: float) -> FloatArray:
    """(n, 27, 3) deviations [mm] of checks, of which consecutive ones correlate."""
    found = rng.normal(0, 0.01, (n, len(ARTEFACTS), 3))
    for i in range(1, n):
        found[i] = correlation * found[i - 1] + np.sqrt(1 - correlation**2) * found[i]
    return found


def compared(deviations: FloatArray) -> WholeCheck:
    """The chart of the whole checks, one of seven charts."""
    checks = [check_of(one, i) for i, one in enumerate(deviations)]
    found = whole_check(checks, [control_rules(SIDES)] * len(checks), list(range(len(checks))))
    assert found is not None
    return found


def false_alarms(n_series: int, correlation: float) -> dict[str, Any]:
    """Series of unchanged checks with an alarm of the whole check."""
    rng, alarms = np.random.default_rng(1), 0
    for _ in range(n_series):
        chart = compared(simulated(rng, LATER, correlation)).chart
        alarms += bool(chart.out_of_limits.any() or chart.signal_index is not None)
    expected = 100 * (1 - (1 - 2 * 0.0027 / SIDES) ** (LATER - 3))
    what = f"alarms of {LATER} unchanged checks, correlation {correlation:g}"
    return {"row": what, "found": f"{100 * alarms / n_series:.1f} %", "stated": f"{expected:.1f} %"}


def seen(n_series: int) -> dict[str, Any]:
    """Changes of the stated size that the thirteenth check shows."""
    rng, found, sizes = np.random.default_rng(2), 0, []
    for _ in range(n_series):
        deviations = simulated(rng, CHECKS + 1, 0.0)
        size = compared(deviations).seen_mm
        if size is None:
            continue
        change = rng.normal(size=deviations.shape[1:])
        deviations[-1] += size * change / np.sqrt((change**2).sum() / len(change))
        found, sizes = found + bool(compared(deviations).chart.out_of_limits[-1]), [*sizes, size]
    what = f"changes of the stated size that are seen (median {np.median(sizes):.4f} mm, scatter 0.01 mm)"
    return {"row": what, "found": f"{100 * found / len(sizes):.0f} %", "stated": "90 %"}


def main() -> None:
    """Print the rows."""
    options = options_of(__doc__, arms=8, series=400)
    with tempfile.TemporaryDirectory() as folder:
        pairs = [answers(number, Path(folder)) for number in range(options.arms)]
    rows: list[dict[str, Any]] = []
    for what, which in (("the same arm: no", 0), ("another arm of the type: not no", 1)):
        given = [pair[which].recalibrate is RecalibrationAdvice.NO for pair in pairs]
        right = sum(given) if which == 0 else len(given) - sum(given)
        rows.append({"row": what, "found": f"{right} of {len(given)}", "stated": ""})
    rows += [false_alarms(options.series, correlation) for correlation in (0.0, 0.3, 0.5)]
    rows.append(seen(options.series))
    print_rows(rows, as_json=options.json)


if __name__ == "__main__":
    main()
