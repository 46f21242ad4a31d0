"""Interim checks and their control charts: another arm of the type, false alarms, changes that are found."""

from __future__ import annotations

import datetime
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import truearm as ta
from benchmarks.rows import RowResult, Rows
from truearm.typing import FloatArray
from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice
from truearm.wings.laboratory.monitor.control_chart import FALSE_ALARMS, ControlChart, control_chart, control_rules
from truearm.wings.laboratory.monitor.interim_check import CheckReading, CheckValue, InterimCheck
from truearm.wings.laboratory.monitor.whole_check import WholeCheck, whole_check

ROWS = Rows()

# The whole check ------------------------------------------------------------------------------------------------------

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


@ROWS.row("arms", quick={"arms": 1})
def arms(arms: int = 8) -> RowResult:
    """The thirteenth check of the same arm, or of another one of the type without a serial number.

    Virtual arms of `gao2017` (preset `shop`, kinematic models of 150 readings) take twelve checks of 27 readings.
    """
    with tempfile.TemporaryDirectory() as folder:
        pairs = [answers(number, Path(folder)) for number in range(arms)]
    same, other = ([one.recalibrate is RecalibrationAdvice.NO for one in each] for each in zip(*pairs, strict=True))
    return RowResult([
        {"arm": "the same: no", "found": f"{sum(same)} of {arms}"},
        {"arm": "another one of the type: not no", "found": f"{arms - sum(other)} of {arms}"},
    ])  # fmt: skip


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
    return whole_check(checks, [control_rules(SIDES)] * len(checks), list(range(len(checks))))


@ROWS.row("alarms", quick={"series": 10})
def alarms(series: int = 400) -> RowResult:
    """Series of 30 unchanged checks with an alarm of the whole check, by the correlation of consecutive checks [%]."""
    table = []
    for correlation in (0.0, 0.3, 0.5):
        rng, found = np.random.default_rng(1), 0
        for _ in range(series):
            chart = compared(simulated(rng, LATER, correlation)).chart
            found += bool(chart.out_of_limits.any() or chart.signal_index is not None)
        stated = 100 * (1 - (1 - 2 * 0.0027 / SIDES) ** (LATER - 3))
        table.append({"correlation": correlation, "alarms": 100 * found / series, "stated": stated})
    return RowResult(table)


@ROWS.row("seen", quick={"series": 10})
def seen(series: int = 400) -> RowResult:
    """Changes of the stated size that the thirteenth check shows; the scatter is 0.01 mm."""
    rng, found, sizes = np.random.default_rng(2), 0, []
    for _ in range(series):
        deviations = simulated(rng, CHECKS + 1, 0.0)
        size = compared(deviations).seen_mm
        if size is None:
            continue
        change = rng.normal(size=deviations.shape[1:])
        deviations[-1] += size * change / np.sqrt((change**2).sum() / len(change))
        found, sizes = found + bool(compared(deviations).chart.out_of_limits[-1]), [*sizes, size]
    return RowResult([{"seen [%]": 100 * found / len(sizes), "stated [%]": 90, "median size [mm]": np.median(sizes)}])


# Six charts -----------------------------------------------------------------------------------------------------------

CHARTS, FROM, UNTIL = 6, 20, 60
RULES = control_rules(2 * CHARTS)
CORRELATED = (0.0, 0.3, 0.5, 0.7)


def autoregressive(rng: np.random.Generator, n: int, correlation: float) -> FloatArray:
    """(n,) values of unit variance whose consecutive ones correlate."""
    values = rng.normal(size=n)
    for i in range(1, n):
        values[i] = correlation * values[i - 1] + np.sqrt(1 - correlation**2) * values[i]
    return values


def chart_of(values: FloatArray) -> ControlChart:
    """The chart of values, one of six with two sides."""
    return control_chart(values, u=np.zeros(len(values)), rules=RULES)


def first_yes(chart: ControlChart) -> float:
    """The first value with the answer "recalibrate": evidence, or two in a row beyond the same limit; inf: none."""
    beyond = chart.beyond
    twice = np.flatnonzero((beyond[1:] == beyond[:-1]) & (beyond[1:] != 0)) + 1
    return min([*twice, *([] if chart.signal_index is None else [chart.signal_index])], default=np.inf)


@ROWS.row("routine-alarms", quick={"histories": 2})
def routine_alarms(histories: int = 200) -> RowResult:
    """Unchanged arms with six charts: answers in checks 21 to 60 [%], by the correlation of consecutive checks.

    "Recalibrate", of histories without it before; and checks with the answer "undecided".
    """
    table = []
    for correlation in CORRELATED:
        rng, yes, undecided = np.random.default_rng(1), 0, 0
        for _ in range(histories):
            charts = [chart_of(autoregressive(rng, UNTIL, correlation)) for _ in range(CHARTS)]
            yes += FROM <= min(map(first_yes, charts)) < np.inf
            undecided += int(np.any([one.out_of_limits[FROM:] for one in charts], axis=0).sum())
        checks = histories * (UNTIL - FROM)
        table.append({
            "correlation": correlation, "recalibrate": 100 * yes / histories,
            "stated": 100 * (1 - (1 - FALSE_ALARMS) ** (UNTIL - FROM)),
            "undecided, of checks": 100 * undecided / checks, "stated, of checks": 100 * FALSE_ALARMS,
        })  # fmt: skip
    return RowResult(table)


@ROWS.row("routine-steps", quick={"series": 5})
def routine_steps(series: int = 100) -> RowResult:
    """Steps of one of six charts with the answer "recalibrate" within 10, 20, 40 checks [%], by correlation."""
    table = []
    for before in (20, 40):
        for step in (1.0, 2.0, 3.0):
            row: dict[str, Any] = {"checks before": before, "step [sd]": step}
            for correlation in CORRELATED:
                rng, needed = np.random.default_rng(2), []
                for _ in range(series):
                    values = autoregressive(rng, before + 40, correlation)
                    values[before:] += step
                    found = first_yes(chart_of(values))
                    if found >= before:
                        needed.append(found - before + 1)
                shares = [100 * np.mean(np.array(needed) <= within) for within in (10, 20, 40)]
                row[f"{correlation:g}"] = ", ".join(f"{one:.0f}" for one in shares)
            table.append(row)
    return RowResult(table)
