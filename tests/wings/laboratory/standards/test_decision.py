"""The decision and the uncertainty of the test value: the guide's own example, limits, and another program."""

from math import inf, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.wings.laboratory.standards.decision import (
    COVERAGE_PROBABILITY,
    DECISION_RULES,
    Budget,
    ConformityResult,
    Contribution,
    Verdict,
    assess_conformity,
    conformance_probability,
    decide,
    overall_verdict,
    undecided_zone,
    worst_result,
)

# The end gauge of the GUM, JCGM 100:2008, H.1, table H.1 and H.1.6: nm and degrees of freedom.
END_GAUGE = Budget(
    (
        Contribution("calibration of the standard", 25.0, 18),
        Contribution("measured difference", 9.7, 25.6),
        Contribution("difference in expansion coefficients", 2.9, 50),
        Contribution("difference in temperatures", 16.6, 2),
    )
)


def test_the_end_gauge_of_the_guide():
    """u_c = 32 nm to its printed digits; effective degrees of freedom 16.7 (H.1.6; of rounded lines), cut to 16."""
    assert END_GAUGE.u == pytest.approx(32, abs=0.5)
    assert END_GAUGE.dof == pytest.approx(16.7, abs=0.1)
    # Table G.2 of the guide: t of 16 degrees of freedom for 95.45 % is 2.17.
    assert END_GAUGE.coverage_factor == pytest.approx(2.17, abs=0.005)
    assert END_GAUGE.expanded == END_GAUGE.coverage_factor * END_GAUGE.u


def test_against_another_program():
    """The GUM Tree Calculator finds the same combined uncertainty and degrees of freedom."""
    gtc = pytest.importorskip("GTC", reason="GTC is not installed")
    total = sum(gtc.ureal(0, one.u, one.dof) for one in END_GAUGE.contributions)
    assert total.u == pytest.approx(END_GAUGE.u, rel=1e-12)
    assert total.df == pytest.approx(END_GAUGE.dof, rel=1e-12)


@pytest.mark.parametrize(
    ("dof", "k"),
    # GUM table G.2, column 95.45 %.
    [(1, 13.97), (2, 4.53), (3, 3.31), (4, 2.87), (5, 2.65), (10, 2.28), (20, 2.13), (50, 2.05), (inf, 2.000)],
)
def test_coverage_factors_of_the_guide(dof, k):
    assert Budget((Contribution("only", 1.0, dof),)).coverage_factor == pytest.approx(k, abs=0.005)


def test_the_level_is_that_of_two_standard_deviations():
    assert pytest.approx(0.9545, abs=5e-5) == COVERAGE_PROBABILITY


@given(st.lists(st.tuples(st.floats(1e-6, 1e3), st.floats(1, 1e6)), min_size=1, max_size=6))
def test_effective_degrees_of_freedom_lie_between_the_least_and_the_sum(lines):
    budget = Budget(tuple(Contribution(str(i), u, dof) for i, (u, dof) in enumerate(lines)))
    used = [dof for _, dof in lines]
    assert min(used) * (1 - 1e-9) <= budget.dof <= sum(used) * (1 + 1e-9)
    assert budget.u == pytest.approx(np.linalg.norm([u for u, _ in lines]))


def test_nothing_is_certain_of_nothing():
    empty = Budget()
    assert (empty.u, empty.dof, empty.coverage_factor, empty.expanded) == (0, inf, 2, 0)
    assert Budget((Contribution("none", 0.0, 3),)).dof == inf


@pytest.mark.parametrize(
    ("value", "uncertainty", "verdict"),
    [
        (0.5, 0.25, Verdict.CONFORM),
        (-0.5, 0.25, Verdict.CONFORM),
        (0.75, 0.25, Verdict.CONFORM),  # on the edge of the acceptance zone
        (0.76, 0.25, Verdict.UNDECIDED),
        (-1.25, 0.25, Verdict.UNDECIDED),  # on the edge of the rejection zone
        (-1.26, 0.25, Verdict.NOT_CONFORM),
        (1.0, 0.0, Verdict.CONFORM),
        (1.01, 0.0, Verdict.NOT_CONFORM),
    ],
)
def test_iso_14253(value, uncertainty, verdict):
    assert decide(value, uncertainty, 1.0, rule="iso14253-1:2013") is verdict


@pytest.mark.parametrize(
    ("value", "uncertainty", "verdict"),
    [
        (0.030, 0.0075, Verdict.CONFORM),
        (0.0301, 0.0075, Verdict.NOT_CONFORM),
        # 4:1 is not kept: ISO 14253-1 decides.
        (0.010, 0.0076, Verdict.CONFORM),
        (0.0301, 0.0076, Verdict.UNDECIDED),
        (0.109, 0.012, Verdict.NOT_CONFORM),
    ],
)
def test_simple_acceptance(value, uncertainty, verdict):
    assert decide(value, uncertainty, 0.030, rule="simple") is verdict


# The edition of 2017 -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "u", "limit", "dof", "probability"),
    [
        # Tables of the normal distribution: Phi(1) = 0.8413, Phi(2) = 0.9772, Phi(3) = 0.99865.
        (0.0, 1.0, 1.0, inf, 2 * 0.841345 - 1),
        (0.9, 0.05, 1.0, inf, 0.977250),
        (-0.9, 0.05, 1.0, inf, 0.977250),
        (1.0, 0.01, 1.0, inf, 0.5),
        (1.0, 1.0, 1.0, inf, 0.977250 - 0.5),
        (2.0, 1.0, 1.0, inf, 0.998650 - 0.841345),  # Phi(-1) - Phi(-3)
        # Cauchy's distribution, one degree of freedom: arctan(1) / pi to either side.
        (0.0, 1.0, 1.0, 1.0, 0.5),
        (1.0, 1.0, 1.0, 1.9, np.arctan(2) / np.pi),
        (0.999, 0.0, 1.0, inf, 1.0),
        (1.001, 0.0, 1.0, inf, 0.0),
    ],
)
def test_the_probability_of_conformity_by_hand(value, u, limit, dof, probability):
    assert conformance_probability(value, u, limit, dof=dof) == pytest.approx(probability, abs=1e-6)


@pytest.mark.parametrize(
    ("value", "u", "verdict"),
    [
        (1 - 1.65 * 0.1, 0.1, Verdict.CONFORM),  # a guard band of 1.645 u; the edition of 2013 has 2 u
        (-1 + 1.65 * 0.1, 0.1, Verdict.CONFORM),
        (1 - 1.64 * 0.1, 0.1, Verdict.UNDECIDED),
        (1 + 1.64 * 0.1, 0.1, Verdict.UNDECIDED),
        (-1 - 1.65 * 0.1, 0.1, Verdict.NOT_CONFORM),
        (1.0, 0.0, Verdict.CONFORM),
        (1.001, 0.0, Verdict.NOT_CONFORM),
        # Both limits count: u = 1 / 1.96 leaves 2.5 % beyond either, if the value is 0.
        (0.0, 0.5102, Verdict.CONFORM),
        (0.0, 0.5103, Verdict.UNDECIDED),
        (0.9, 100.0, Verdict.UNDECIDED),  # nearly all mass is outside, which shows nothing
        (1.1, 100.0, Verdict.UNDECIDED),
    ],
)
def test_iso_14253_of_2017(value, u, verdict):
    assert decide(value, 2 * u, 1.0, rule="iso14253-1:2017") is verdict


def test_few_degrees_of_freedom_widen_the_guard_band():
    """Student's t of two degrees of freedom for 95 %: 2.920 (tables), for 95.45 %: 4.53."""
    budget = Budget((Contribution("repeats", 0.01, 2.0),))
    row = assess_conformity("test", 1 - 0.0291, budget, 1.0, rule="iso14253-1:2017")
    assert row.verdict is Verdict.UNDECIDED
    assert row.undecided_zone("iso14253-1:2017") == pytest.approx((1 - 0.0292, 1 + 0.0292), abs=5e-5)
    assert row.undecided_zone("iso14253-1:2013") == pytest.approx((1 - 0.0453, 1 + 0.0453), abs=5e-5)
    assert row.conformance_probability == pytest.approx(0.95, abs=1e-3)


@given(
    st.floats(-2, 2), st.floats(0, 1), st.floats(0.01, 1), st.sampled_from([1.0, 3.5, inf]),
    st.sampled_from(DECISION_RULES),
)  # fmt: skip
def test_the_zone_is_where_the_rule_decides_nothing(value, u, limit, dof, rule):
    budget = Budget((Contribution("only", u, dof),))
    low, high = undecided_zone(budget, limit, rule=rule)
    if min(abs(abs(value) - low), abs(abs(value) - high)) < 1e-9:
        return  # the rounding of an edge
    verdict = decide(value, budget.expanded, limit, rule=rule, dof=dof)
    expected = Verdict.CONFORM if abs(value) < low else Verdict.UNDECIDED if abs(value) < high else Verdict.NOT_CONFORM
    assert verdict is expected


@given(st.floats(-2, 2), st.floats(0, 1), st.floats(0.01, 1))
def test_the_edition_of_2017_decides_as_that_of_2013_wherever_that_decides(value, uncertainty, limit):
    if abs(abs(value) - limit) < 1e-9:
        return  # the rounding of an edge: an uncertainty below it is lost in value + U
    new, old = (decide(value, uncertainty, limit, rule=rule) for rule in DECISION_RULES[:2])
    assert new is old or old is Verdict.UNDECIDED


@given(st.floats(-1, 1), st.floats(0, 1), st.floats(0.01, 1), st.sampled_from(DECISION_RULES))
def test_more_uncertainty_decides_less(value, uncertainty, limit, rule):
    """A decision that is made stays the same or is made no more when the uncertainty grows; it never turns round."""
    if abs(abs(value) - limit) < 1e-9:
        return  # the rounding of an edge
    before, after = (decide(value, u, limit, rule=rule) for u in (uncertainty, uncertainty * 1.5))
    assert after in (before, Verdict.UNDECIDED)


@given(st.floats(-1, 1), st.floats(0, 1), st.floats(0.01, 1))
def test_simple_acceptance_decides_as_iso_14253_wherever_that_decides(value, uncertainty, limit):
    strict, simple = (decide(value, uncertainty, limit, rule=rule) for rule in ("iso14253-1:2013", "simple"))
    assert simple is strict or strict is Verdict.UNDECIDED


@pytest.mark.parametrize(
    ("value", "uncertainty", "limit", "phrase"),
    [
        (np.nan, 0.1, 1.0, "finite test value"),
        (0.0, -0.1, 1.0, "0 or more"),
        (0.0, inf, 1.0, "0 or more"),
        (0.0, 0.1, 0.0, "positive limit"),
        (0.0, 0.1, np.nan, "positive limit"),
    ],
)
def test_what_cannot_be_decided_is_refused(value, uncertainty, limit, phrase):
    refuses(phrase, decide, value, uncertainty, limit)


@pytest.mark.parametrize(("u", "dof", "phrase"), [(-1.0, 5, "0 or more"), (np.nan, 5, "0 or more"), (1, 0, "positive")])
def test_bad_contributions_are_refused(u, dof, phrase):
    refuses(phrase, Contribution, "thermal", u, dof)


def row(value, limit, u=0.001) -> ConformityResult:
    return assess_conformity(
        "test", value, Budget((Contribution("all", u),)), limit, rule="iso14253-1:2013", where=str(value)
    )


def test_the_worst_row_decides():
    good, near, bad, free = row(0.01, 0.03), row(0.0295, 0.03), row(0.05, 0.03), row(9.0, None)
    assert [one.verdict for one in (good, near, bad, free)] == [
        Verdict.CONFORM,
        Verdict.UNDECIDED,
        Verdict.NOT_CONFORM,
        None,
    ]
    assert worst_result([good, near, free]) == near
    assert worst_result([good, bad, near]) == bad
    # Of several that conform: the one nearest to its own limit, not the largest.
    assert worst_result([row(0.02, 0.05), row(0.015, 0.02)]).where == "0.015"
    assert worst_result([row(1.0, None), row(-2.0, None)]).where == "-2.0"
    # Their uncertainty counts with them: 0.02 and U = 0.002 mm end below 0.019 and U = 0.008 mm.
    assert worst_result([row(0.02, 0.05), row(0.019, 0.05, u=0.004)]).where == "0.019"
    assert overall_verdict([good, near, bad, free]) is Verdict.NOT_CONFORM
    assert overall_verdict([good, near, free]) is Verdict.UNDECIDED
    assert overall_verdict([good, free]) is Verdict.CONFORM
    assert overall_verdict([free]) is None


def test_a_row_says_its_uncertainty():
    two = Budget((Contribution("a", 0.003), Contribution("b", 0.004)))
    assert assess_conformity("test", 0.0, two, 1.0, rule="simple").uncertainty == pytest.approx(2 * sqrt(25e-6))
