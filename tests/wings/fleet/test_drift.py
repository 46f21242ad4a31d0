"""Drift of an arm's constants: from earlier models and from the type, in combined standard uncertainties."""

from datetime import UTC, datetime

import numpy as np
import pytest

from truearm.wings.fleet.arm_list import RegisteredArm
from truearm.wings.fleet.fit_task import FitRow
from truearm.wings.fleet.fleet_status import (
    LEAST_OF_TYPE,
    ArmRecords,
    FleetFigures,
    arm_state,
    constant_drifts,
    drift_remark,
    type_constants,
)

NAMES = "base x", *(f"joint {i} {name}" for i in range(1, 7) for name in ("theta", "d", "a", "alpha")), "tip z"


def model(values, u=0.02, **changed):
    constants = [
        {"name": name, "unit": "mm", "nominal": 0.0, "value": float(value), "u": u}
        for name, value in zip(NAMES, values, strict=True)
    ]
    return FitRow("k", "A", "ur10", "s.csv", "fitted", constants=tuple(constants), **changed)


def largest(drifts, what):
    return max((abs(getattr(one, what)), one.name) for one in drifts if getattr(one, what) is not None)


def test_a_planted_drift_is_stated_in_combined_uncertainties_and_its_constant_first(rng):
    still = rng.normal(0, 0.02, (3, len(NAMES)))
    still[-1, 6] += 0.3
    size, name = largest(constant_drifts([model(row) for row in still], {}), "own")
    assert name == NAMES[6]
    expected = max(abs(still[-1, 6] - still[:-1, 6])) / (0.02 * 2**0.5)
    assert size == pytest.approx(expected)


def test_constants_that_did_not_change_drift_as_stated(rng):
    """Differences of two models over their combined uncertainty are normal, with a standard deviation of one."""
    found = []
    for _ in range(100):
        drifts = constant_drifts([model(rng.normal(0, 0.02, len(NAMES))) for _ in range(2)], {})
        found.append([one.own for one in drifts if one.own is not None])
    assert np.std(found) == pytest.approx(1, abs=0.06)  # 2400 values: standard error 0.015
    assert np.median(np.abs(found).max(axis=1)) == pytest.approx(2.2, abs=0.3)  # what the page says of an unchanged arm


def test_a_remark_names_what_changed_worst_first_until_the_next_readings(rng):
    before, after, later = (model(np.zeros(len(NAMES)), session_sha256=sha) for sha in "abc")
    assert drift_remark([before]) == drift_remark([before, after]) == ""
    values = np.zeros(len(NAMES))
    values[[3, 6, 9, 12, 15]] = 0.02 * 2**0.5 * np.array([5, -20.6, 4.0, 7, 6])
    changed = model(values, session_sha256="b")
    said = (
        f"changed since the model before: {NAMES[6]} by 20.6 u, {NAMES[12]} by 7.0 u, {NAMES[15]} by 6.0 u and 1 more "
        "(limit 4.1 u)"
    )
    assert drift_remark([before, changed]) == said
    records = ArmRecords(RegisteredArm("A", "ur10", session="s.csv"), known=changed, models=(before, changed))
    state = arm_state(records, FleetFigures([changed]), datetime.now(UTC))
    assert (state.what, state.message) == ("in force", said)
    assert drift_remark([before, changed, model(values, session_sha256="b")]) == said  # fitted again, no new readings
    assert drift_remark([before, changed, model(values, session_sha256="c")]) == ""
    assert drift_remark([before, changed, later]) == said  # and back


def test_unchanged_arms_get_no_remark(rng):
    """One of a thousand may."""
    arms = [[model(rng.normal(0, 0.02, len(NAMES)), session_sha256=sha) for sha in "ab"] for _ in range(1000)]
    assert sum(map(bool, map(drift_remark, arms))) <= 5


def test_a_base_that_was_moved_and_another_tip_are_no_drift():
    before, after = np.zeros((2, len(NAMES)))
    after[[0, -1]] = 100.0
    assert largest(constant_drifts([model(before), model(after)], {}), "own")[0] == 0
    assert [one.name for one in constant_drifts([model(after)], {}) if one.value == 100.0] == ["base x", "tip z"]


def test_an_arm_unlike_its_type_is_named_and_moves_no_figure_of_it(rng):
    values = rng.normal(0.9, 0.1, (20, len(NAMES)))
    values[3, 5] = 3.0
    of_type = type_constants(map(model, values))["ur10"]
    assert of_type[NAMES[5]].median == pytest.approx(0.9, abs=0.1)
    assert of_type[NAMES[5]].std == pytest.approx(0.1, abs=0.06)
    drifts = [largest(constant_drifts([model(row)], of_type), "of_type") for row in values]
    assert max(drifts) == drifts[3]
    assert drifts[3][1] == NAMES[5]
    assert drifts[3][0] > 8


def test_few_arms_of_a_type_are_no_type():
    rows = [model(np.zeros(len(NAMES)))] * (LEAST_OF_TYPE - 1)
    assert type_constants(rows) == {}
    (one,) = {one.of_type for one in constant_drifts(rows[:1], {})}
    assert one is None


def test_a_constant_that_a_model_does_not_state_is_not_compared():
    missing = FitRow("k", "A", "ur10", "s.csv", "fitted", constants=())
    unknown = model(np.zeros(len(NAMES)), u=None)
    for before in (missing, unknown):
        drifts = constant_drifts([before, model(np.ones(len(NAMES)))], {})
        assert {one.own for one in drifts} == {None}
    assert constant_drifts([missing], {}) == []
    assert FleetFigures([missing]).drifts(()) == []
