"""False alarms of control charts where consecutive checks correlate, and how soon a step is found.

    python benchmarks/control_chart.py [--series N] [--json]

Simulated series of 30 unchanged checks of one chart, by the correlation of consecutive values: the share with an alarm,
and with the answer "yes" (a cumulative sum, or two values in a row beyond the same limit). "Independent" takes all
values for independent. Then the checks until "yes" after a step of three standard deviations, one of six charts.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from machine import options_of, print_rows
from truearm.typing import FloatArray
from truearm.verification.monitor.control_chart import ControlChart, ControlRules, control_chart, control_rules
from truearm.verification.monitor.serial_correlation import CORRELATIONS

CHECKS, LATER, STEP = 30, 40, 3.0
TRIED = (0.0, 0.3, 0.5, 0.7, 0.85)
KINDS = {"truearm": CORRELATIONS, "independent": np.zeros(1)}


def autoregressive(rng: np.random.Generator, n: int, correlation: float) -> FloatArray:
    """(n,) values of unit variance whose consecutive ones correlate."""
    values = rng.normal(size=n)
    for i in range(1, n):
        values[i] = correlation * values[i - 1] + np.sqrt(1 - correlation**2) * values[i]
    return values


def first_yes(chart: ControlChart) -> int | None:
    """The first value with the answer "yes"."""
    beyond, above = chart.out_of_limits, chart.scores > 0
    twice = np.flatnonzero(beyond[1:] & beyond[:-1] & (above[1:] == above[:-1])) + 1
    found = [int(twice[0])] if len(twice) else []
    return min(found + ([] if chart.signal_index is None else [chart.signal_index]), default=None)


def chart_of(values: FloatArray, kind: str, rules: ControlRules) -> ControlChart:
    """The chart of values, without a least scatter."""
    return control_chart(values, u=np.zeros(len(values)), rules=rules, correlations=KINDS[kind])


def false_alarms(kind: str, n_series: int) -> dict[str, Any]:
    """Shares of unchanged series with an alarm, and with the answer "yes"."""
    row: dict[str, Any] = {"checks taken for": kind, "": "alarms of unchanged checks, %"}
    for correlation in TRIED:
        rng, alarms, yes = np.random.default_rng(1), 0, 0
        for _ in range(n_series):
            chart = chart_of(autoregressive(rng, CHECKS, correlation), kind, control_rules(2))
            answer = first_yes(chart) is not None
            alarms, yes = alarms + (answer or bool(chart.out_of_limits.any())), yes + answer
        row[f"{correlation:g}"] = f"{100 * alarms / n_series:.1f} ({100 * yes / n_series:.1f})"
    return row


def detection(kind: str, n_series: int, before: int) -> dict[str, Any]:
    """Checks after a step until the answer "yes": in half, and in 95 % of the series without an earlier one."""
    row: dict[str, Any] = {"checks taken for": kind, "": f"a step after {before}: half, 95 %"}
    for correlation in TRIED:
        rng, needed = np.random.default_rng(2), []
        for _ in range(n_series):
            values = autoregressive(rng, before + LATER, correlation)
            values[before:] += STEP
            found = first_yes(chart_of(values, kind, control_rules(12)))
            if found is None or found >= before:
                needed.append(np.inf if found is None else found - before + 1)
        half, most = np.quantile(needed, [0.5, 0.95], method="higher")
        row[f"{correlation:g}"] = ", ".join(f"{n:.0f}" if np.isfinite(n) else f"> {LATER}" for n in (half, most))
    return row


def main() -> None:
    """Print both tables."""
    options = options_of(__doc__, series=1000)
    begun = time.process_time()
    rows = [false_alarms(kind, options.series) for kind in KINDS]
    rows += [detection(kind, max(options.series // 4, 10), before) for before in (10, 20, 40) for kind in KINDS]
    print_rows(rows, as_json=options.json)
    if not options.json:
        print(f'in brackets: the answer "yes"; {options.series} series, CPU {time.process_time() - begun:.0f} s')


if __name__ == "__main__":
    main()
