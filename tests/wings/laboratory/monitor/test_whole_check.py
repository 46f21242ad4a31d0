"""A check as a whole: its readings against those in the same poses before."""

import datetime
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, norm

from refusals import refuses
from truearm.errors import InputError
from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice, assess, describe_assessment, describe_power
from truearm.wings.laboratory.monitor.control_chart import control_rules
from truearm.wings.laboratory.monitor.history_rows import CheckRow, decode_row, encode_check
from truearm.wings.laboratory.monitor.interim_check import CheckReading, CheckValue, InterimCheck
from truearm.wings.laboratory.monitor.whole_check import SAME_POSE, whole_check

ARTEFACTS = ["seat cone"] * 6 + ["sphere ball"] * 5
POSES = np.random.default_rng(5).uniform(-3, 3, (len(ARTEFACTS), 4))


def check_of(deviations, number, poses=POSES, spat=0.02):
    readings = tuple(
        CheckReading(artefact, tuple(pose), tuple(one))
        for artefact, pose, one in zip(ARTEFACTS, np.asarray(poses).tolist(), deviations.tolist(), strict=True)
    )
    value = CheckValue("SPAT.2s", "cone", spat, 0.002, 0.0, 6)
    date = datetime.datetime(2026, 1, 1) + datetime.timedelta(days=number)
    return InterimCheck(date, "0" * 64, f"{number:064x}", None, (value,), readings)


def checks_of(deviations, rng=None):
    scatter = np.full(len(deviations), 0.02) if rng is None else 0.02 + rng.normal(0, 0.001, len(deviations))
    return [check_of(one, i, spat=float(scatter[i])) for i, one in enumerate(deviations)]


def compared(checks):
    return whole_check(checks, [control_rules(2)] * len(checks), [float(i) for i in range(len(checks))])


def centred(rng, n):
    """(n, 11, 3) deviations [mm] whose means in the seat and on the sphere are zero, as those of deviations are."""
    found = rng.normal(0, 0.01, (n, len(ARTEFACTS), 3))
    for rows in (slice(6), slice(6, None)):
        found[:, rows] -= found[:, rows].mean(axis=1, keepdims=True)
    return found


def test_each_value_is_the_difference_from_the_mean_before_with_the_uncertainty_of_that_mean(rng):
    """Plain formula; the first check has none before it."""
    deviations = centred(rng, 6)
    found = compared(checks_of(deviations))
    assert found.checks == (1, 2, 3, 4, 5)
    for n, value in enumerate(found.values, start=1):
        away = deviations[n] - deviations[:n].mean(axis=0)
        expected = np.sqrt((away**2).sum() / len(ARTEFACTS) / (1 + 1 / n))
        assert value.value_mm == pytest.approx(expected, rel=1e-12)
        assert value.n == len(ARTEFACTS)
    assert compared(checks_of(deviations[:1])) is None


def test_the_order_of_readings_and_whole_turns_of_a_joint_do_not_matter(rng):
    deviations, order = centred(rng, 3), rng.permutation(len(ARTEFACTS))
    checks = checks_of(deviations)
    turned = [replace(one, pose=(one.pose[0] + 2 * np.pi, *one.pose[1:])) for one in checks[2].readings]
    mixed = replace(checks[2], readings=tuple(turned[i] for i in order))
    assert compared([*checks[:2], mixed]).values[-1].value_mm == pytest.approx(
        compared(checks).values[-1].value_mm, rel=1e-12
    )


def test_a_missing_reading_moves_the_mean_of_its_seat_and_does_not_count(rng):
    """The same errors with a reading less: its seat's mean is another, its deviations differ from before alike."""
    pattern = centred(rng, 1)[0]
    fewer = pattern.copy()
    fewer[1:6] -= fewer[1:6].mean(axis=0)
    checks = checks_of([pattern, pattern, fewer])
    less = replace(checks[2], readings=checks[2].readings[1:])
    assert compared([*checks[:2], less]).values[-1].value_mm == pytest.approx(0, abs=1e-12)
    assert compared([*checks[:2], less]).values[-1].n == len(ARTEFACTS) - 1


def test_other_poses_are_not_compared_and_it_is_said(rng):
    deviations = centred(rng, 3)
    checks = checks_of(deviations)
    elsewhere = check_of(deviations[2], 2, poses=POSES + [2 * SAME_POSE, 0, 0, 0])
    assert compared([*checks[:2], elsewhere]).checks == (1,)
    remarks = assess([*checks[:2], elsewhere]).remarks
    assert "not compared as a whole: fewer than 6 readings are in poses of earlier ones" in remarks[0]
    assert assess(checks).remarks == assess(checks[:1]).remarks == ()
    near = check_of(deviations[2], 2, poses=POSES + [0.9 * SAME_POSE, 0, 0, 0])
    assert compared([*checks[:2], near]).checks == (1, 2)


def test_another_arm_is_undecided_once_and_recalibrate_twice_while_every_other_chart_is_calm(rng):
    """Twice the scatter in a pattern of its own, which the scatter in the seat does not show."""
    own, other = centred(rng, 2)
    deviations = 2 * own + centred(rng, 14)
    deviations[12:] += 2 * (other - own)
    checks = checks_of(deviations, rng)
    assert assess(checks[:12]).recalibrate is RecalibrationAdvice.NO
    once, twice = assess(checks[:13]), assess(checks)
    assert once.recalibrate is RecalibrationAdvice.UNDECIDED
    assert describe_assessment(once, checks).startswith(
        "Undecided: this check as a whole differs from the earlier ones"
    )
    assert once.reasons == ("whole check, difference: beyond the limits of its chart in check 13 only",)
    assert twice.recalibrate is RecalibrationAdvice.YES
    assert twice.since == 12
    # The check that was not confirmed does not enter the mean of the later ones.
    again = [*checks[:13], check_of(2 * own + centred(rng, 1)[0], 13)]
    assert assess(again).recalibrate is RecalibrationAdvice.NO


def test_what_a_check_would_have_shown_is_said_with_the_answer_no(rng):
    checks = checks_of(centred(rng, 12), rng)
    found = assess(checks)
    assert found.recalibrate is RecalibrationAdvice.NO
    assert f"by {found.seen_mm:.3f} mm (root mean square) would have been seen in 9 of 10" in describe_power(found)[0]
    assert assess([replace(check, readings=()) for check in checks]).seen_mm is None


def test_what_would_have_been_seen_adds_its_square_to_that_of_the_checks(rng):
    """With delta^2 = d: d - spread (s^2 + 2 d)^(1/2) is what the limit leaves over the mean square of the checks."""
    checks = checks_of(centred(rng, 12), rng)
    found = compared(checks)
    squares = found.chart.values[:-1] ** 2
    added = found.seen_mm**2 / (1 + 1 / (len(squares) + 1))
    spread = norm.ppf(0.9) ** 2 * squares.var(ddof=1) / squares.mean()
    beyond = found.chart.upper[-1] ** 2 - squares.mean()
    assert added - np.sqrt(spread * (squares.mean() + 2 * added)) == pytest.approx(beyond, rel=1e-9)


def test_nine_in_ten_changes_of_the_stated_size_are_seen_and_unchanged_checks_are_as_rare_as_stated():
    """Within the scatter of the trials (binomial, 1 in 1000); of one chart's limits, one side is exceeded 1 in 740."""
    rng, shown, beyond, trials = np.random.default_rng(3), 0, 0, 0
    for _ in range(50):
        deviations = centred(rng, 14)
        unchanged = compared(checks_of(deviations))
        beyond += unchanged.chart.out_of_limits[-1]
        if unchanged.seen_mm is None:  # a false alarm before
            continue
        trials += 1
        (change,) = centred(rng, 1)
        deviations[-1] += unchanged.seen_mm * change / np.sqrt((change**2).sum() / len(change))
        shown += compared(checks_of(deviations)).chart.out_of_limits[-1]
    # What is stated follows from the scatter of twelve checks, itself known to a fifth.
    assert 0.8 * trials <= shown <= binom.ppf(0.999, trials, 0.95)
    assert beyond <= binom.ppf(0.999, 50, 0.00135)


def test_readings_come_back_from_the_history_and_hostile_ones_do_not(rng):
    check = checks_of(centred(rng, 1))[0]
    text = encode_check(CheckRow(check, "m", "a"))
    assert decode_row(text, []).check == check
    for broken in (text.replace('"seat cone"', "7", 1), text.replace('"pose": [', '"pose": [1e999, ', 1)):
        with pytest.raises((InputError, ValueError, TypeError)):
            decode_row(broken, [])
    refuses("deviation of 3 coordinates", CheckReading, "seat cone", (1.0,), (0.0, 0.0))
    fewer_joints = replace(check.readings[0], pose=(1.0,))
    refuses("poses of different numbers of joints", replace, check, readings=(fewer_joints, *check.readings[1:]))
    other_joints = replace(check, readings=tuple(replace(one, pose=(1.0,)) for one in check.readings))
    assert compared([check, other_joints]) is None


def test_retired_artefacts_do_not_count(rng):
    deviations = centred(rng, 3)
    checks = checks_of(deviations)
    last = replace(checks[2], readings=checks[2].readings[:6])
    assert [trend.latest.quantity for trend in assess([*checks[:2], last]).trends] == ["SPAT.2s", "difference"]
    gone = [replace(check, values=(*check.values, CheckValue("form", "ball", 0.02, 0.002, 0.0, 5))) for check in checks]
    found = assess([*gone[:2], last], retired=["ball"])
    whole = next(trend for trend in found.trends if trend.is_whole_check)
    np.testing.assert_allclose(
        whole.chart.values, compared([replace(c, readings=c.readings[:6]) for c in checks]).chart.values, rtol=1e-12
    )


def test_scatters_share_the_false_alarms_as_charts_of_one_side(rng):
    """A seat and the whole check can only grow worse upwards: two sides in all, where a length has two of its own."""
    checks = checks_of(centred(rng, 12), rng)
    length = CheckValue("length error", "A to B", 0.001, 0.002, 0.0, 6, 600.0)
    longer = [replace(one, values=(*one.values, length)) for one in checks]
    for some, n_sides in ((checks, 2), (longer, 4)):
        rules = {one.chart.rules for one in assess(some).trends if one.chart is not None}
        assert rules == {control_rules(n_sides)}
