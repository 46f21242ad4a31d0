"""Certificates that contradict themselves are named; those of a verification never do, however they are rounded."""

from dataclasses import replace
from decimal import Decimal
from math import sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_outcome import BUDGET, certificate, outcome, row

from refusals import refuses
from truearm.wings.laboratory.certificate.certificate import StatedList, StatedQuantity
from truearm.wings.laboratory.certificate.consistency import check_consistency
from truearm.wings.laboratory.certificate.dcc import dcc
from truearm.wings.laboratory.certificate.dcc_reader import parse_dcc, parse_dcc_file
from truearm.wings.laboratory.standards.decision import (
    DECISION_RULES,
    Budget,
    Contribution,
    outside_rated_conditions,
    worst_result,
)

WHOLE = certificate()


def contradictions(made):
    refused = refuses(None, check_consistency, made)
    return [one.problem.removeprefix("the certificate contradicts itself: ") for one in refused.faults]


def test_days_that_do_not_follow_each_other_are_named():
    day = WHOLE.about.issued
    later = WHOLE.end.replace(year=day.year + 1)
    said, *_ = contradictions(replace(WHOLE, end=later))
    assert said == f"issued on {day}, before the last points were measured on {later}"
    said, *_ = contradictions(replace(WHOLE, begin=day.replace(year=day.year + 1)))
    assert said == f"measured from {day.year + 1}-{day:%m-%d} to {WHOLE.end}"


def with_result(made, number, **changes):
    """The certificate with changes to a test value's quantity or to its conformity."""
    results = list(made.results)
    old = results[number]
    conformity = changes.pop("conformity", old.conformity)
    limit = changes.pop("limit", old.limit)
    results[number] = replace(old, quantity=replace(old.quantity, **changes), limit=limit, conformity=conformity)
    return replace(made, results=tuple(results))


def with_statement(made, kind, change):
    statements = [replace(one, text=change(one.text)) if one.kind == kind else one for one in made.statements]
    return replace(made, statements=tuple(statements))


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.floats(-0.2, 0.2),
            st.floats(0.001, 0.1),
            st.floats(1e-5, 0.05),
            st.floats(1e-5, 0.05),
            st.sampled_from([1.0, 2.5, 4.0, 30.0, float("inf")]),
        ),
        min_size=1,
        max_size=4,
    ),
    st.sampled_from(DECISION_RULES),
    st.booleans(),
)
def test_a_certificate_of_a_verification_never_contradicts_itself(cases, rule, unrated):
    rows = [
        replace(
            row(value, limit, label="E", rule=rule, budget=Budget((Contribution("a", a, dof), Contribution("b", b)))),
            where=f"{number}, position 1",  # a length, as each has a limit of its own
        )
        for number, (value, limit, a, b, dof) in enumerate(cases)
    ]
    rows = [worst_result(rows), *rows]
    if unrated:
        rows[-1] = outside_rated_conditions(rows[-1])
    check_consistency(certificate(made=outcome(rows, rule=rule)))


@pytest.mark.parametrize("rule", DECISION_RULES)
@pytest.mark.parametrize("near", [-1e-7, 0.0, 1e-7])
def test_a_value_that_is_rounded_over_the_edge_of_a_zone_is_no_contradiction(rule, near):
    """Values are compared before rounding: the written ones may stand on the other side."""
    for edge in (0.05 - BUDGET.expanded, 0.05, 0.05 + BUDGET.expanded, 0.05 - 1.645 * BUDGET.u):
        check_consistency(certificate(made=outcome([row(edge + near, rule=rule)], rule=rule)))


def test_a_value_far_outside_its_limit_does_not_pass():
    """Hand-solved: 0.9098 > 0.05 + 0.0104, so 0.9098 fails, whatever rounding does."""
    made = certificate(made=outcome([row(0.0102)]))
    assert contradictions(with_result(made, 0, value=Decimal("0.9098"))) == [
        (
            "E_Uni, 900, position 1 is 0.9098 mm with U = 0.010 mm, its limit 0.05 mm: "
            "by the decision rule fail; it states pass"
        )
    ]
    written = dcc(made).replace(b"<si:value>0.010</si:value>", b"<si:value>0.910</si:value>", 1)
    assert parse_dcc(written).results[0].quantity.value == Decimal("0.910")  # for inspection
    refuses(r"contradicts itself: E_Uni, 900, position 1 is 0\.910 mm", parse_dcc_file, written)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda made: with_result(made, 0, conformity="conditionalPass"), "rule pass; it states conditionalPass"),
        (lambda made: with_result(made, 1, conformity="pass"), "rule conditionalPass; it states pass"),
        (lambda made: with_result(made, 3, conformity="conditionalFail"), "rule fail; it states conditionalFail"),
        (lambda made: with_result(made, 0, expanded=Decimal("0.090")), "U = 0.090 mm, its limit 0.05 mm"),
        (
            lambda made: with_result(made, 0, expanded=Decimal("0.012")),
            "has U = 0.012 mm with k = 2.09; its budget has",
        ),
        (
            lambda made: with_result(made, 0, factor=Decimal("2.40")),
            "U = 0.010 mm with k = 2.40; its budget has u = 0.005",
        ),
        # Ways to a smaller U: another coverage probability, none at all, no budget.
        (
            lambda made: with_result(made, 0, expanded=Decimal("0.005"), factor=Decimal("1.00")),
            "U = 0.005 with k = 1.00 for 0.9545; truearm states U for 0.9545, with k of Student's t",
        ),
        (lambda made: with_result(made, 0, level=Decimal("0.99")), "with k = 2.09 for 0.99; truearm states"),
        (
            lambda made: with_result(made, 0, expanded=Decimal("-0.010"), factor=Decimal("-2.09")),
            "U = -0.010 with k = -2.09",
        ),
        (lambda made: with_result(made, 0, factor=Decimal("2.00")), "its budget has u = 0.0050 mm with 30.9 degrees"),
        (lambda made: with_result(made, 0, expanded=None, factor=None, level=None), "with an expanded uncertainty"),
        (lambda made: with_result(made, 0, unit="degC"), "has a limit, but not both in mm"),
        (lambda made: replace(made, budgets=()), "has U = 0.010 mm with k = 2.09, and no budget"),
        (
            lambda made: with_statement(made, "decision", lambda text: "The arm is conform."),
            "the decision says 'The arm is conform'",
        ),
        (
            lambda made: with_statement(made, "traceability", lambda text: f"{text} It is not shown of cone."),
            "traceability is shown of all; it says",
        ),
        (
            lambda made: replace(made, equipment=(replace(made.equipment[0], accreditation=None), *made.equipment[1:])),
            "traceability is not shown of all; it says",
        ),
        (lambda made: replace(made, conformity="pass"), "the decision is fail; it states pass"),
        (lambda made: replace(made, conformity=None), "the decision is fail; it states none"),
        (lambda made: replace(made, methods=made.methods[:-1]), "not one decision rule that"),
        (
            lambda made: replace(
                made, methods=(*made.methods[:-1], replace(made.methods[-1], norm="ISO 14253-1:1998"))
            ),
            "not one decision rule that",
        ),
        (
            lambda made: with_statement(made, "decision", lambda text: text.replace("not conform.", "conform.")),
            "the arm is 'not conform'; the decision says 'conform'",
        ),
        (
            lambda made: replace(
                made, budgets=(StatedList(made.budgets[0].name, made.budgets[0].quantities[2:]), *made.budgets[1:])
            ),
            "sums up to 0.004 mm; it states 0.0050 mm",
        ),
        (lambda made: replace(made, budgets=(StatedList("a", made.budgets[0].quantities[:1]),)), "0 lines 'combined"),
    ],
)
def test_each_contradiction_is_named(change, said):
    assert any(said in one for one in contradictions(change(WHOLE))), contradictions(change(WHOLE))


def test_all_contradictions_are_named_at_once():
    changed = with_result(with_result(WHOLE, 0, value=Decimal("0.910")), 3, value=Decimal("0.010"))
    assert len(contradictions(changed)) == 2


def test_a_test_value_is_one_of_its_individual_results():
    made = certificate(made=outcome([worst_result([row(0.01), row(0.02), row(-0.03)])]))
    assert [one.name for one in made.individual] == ["E_Uni, 900"]
    check_consistency(made)
    assert contradictions(with_result(made, 0, value=Decimal("-0.031"))) == [
        "E_Uni, 900, position 1 is -0.031, which is none of its individual results"
    ]


def test_a_test_value_is_the_worst_of_its_individual_results():
    """A cheat states the best of three, -0.030 mm being the worst; sets that were measured again do not count."""
    rows = [replace(row(one), where=f"repeat {one}") for one in (0.01, 0.02, -0.03)]
    made = certificate(made=outcome([worst_result(rows)]))
    better = with_result(made, 0, value=Decimal("0.010"))
    said = "E_Uni, 900, repeat -0.03 is 0.010, but the individual result 'repeat -0.03' is -0.030"
    assert contradictions(better) == [said]
    again = replace(made.results[0], quantity=StatedQuantity("E_Uni, sets measured again, of 3", Decimal(1), "1"))
    check_consistency(replace(better, results=(*better.results, replace(again, limit=None, conformity=None))))
    at_lengths = [replace(row(one, 3 * one), where=f"{one}, position 1") for one in (0.01, 0.03)]
    check_consistency(certificate(made=outcome([worst_result(at_lengths)])))


def test_names_of_places_may_have_semicolons_and_spaces():
    rows = [replace(row(0.01), where=where) for where in ("a; b", "c  ", "d")]
    check_consistency(certificate(made=outcome(rows)))


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_statistics_of_lengths_are_computed_from_the_deviations_again(number):
    """Deviations 10, 20, -30 um: 2s = 2 sqrt(1400 / 2), 2RMS = 2 sqrt(1400 / 3), range 50, mean 0."""
    of_all = {"2s": 2 * sqrt(700), "2RMS": 2 * sqrt(1400 / 3), ", range": 50.0, ", mean": 0.0}
    deviations = [row(1e-3 * one, label="Volumetric.Max") for one in (10, 20, -30)]
    others = [
        replace(row(1e-3 * one, None, label=f"Volumetric{'' if label[0] == ',' else '.'}{label}"), where="")
        for label, one in of_all.items()
    ]
    made = certificate(made=outcome([worst_result(deviations), *others]))
    check_consistency(made)
    (said,) = contradictions(with_result(made, number, value=made.results[number].quantity.value + Decimal("0.002")))
    assert said.startswith(f"{others[number - 1].label} is ")
    assert "by the individual results; it states" in said


def test_a_result_as_found_that_is_changed_is_named():
    made = certificate(as_found=outcome())
    check_consistency(made)
    (first, *others) = made.as_found
    changed = replace(first, quantity=replace(first.quantity, value=Decimal("0.9098")))
    (said,) = contradictions(replace(made, as_found=(changed, *others)))
    assert "is 0.9098 mm" in said
    assert said.endswith("by the decision rule fail; it states pass")


def test_days_of_artefacts_plan_and_receipt_are_recomputed():
    """The made-up arm was received on 2 November, measured on the 3rd, its certificate issued on the 5th."""
    first, *others = WHOLE.equipment

    def dated(days):
        return replace(WHOLE, equipment=(replace(first, description=days), *others))

    day = WHOLE.end
    check_consistency(dated(f"Calibrated on {day}, certificate valid until {day}."))
    check_consistency(dated("Calibrated, as its certificate says."))
    said, *_ = contradictions(
        dated(f"Calibrated on {day.replace(day=4)}, certificate valid until {day.replace(2030)}.")
    )
    assert said == "sphere ball was calibrated on 2026-11-04, after the last points were measured on 2026-11-03"
    said, *_ = contradictions(dated("Valid from 2024-01-01 to 2026-11-02"))
    assert said == "the certificate of sphere ball expired on 2026-11-02, before points were measured"
    about = WHOLE.about.model_copy(update={"received": day.replace(day=4)})
    (said,) = contradictions(replace(WHOLE, about=about))
    assert said == "the arm was received on 2026-11-04, after points were measured on 2026-11-03"
    _, plan, *_ = WHOLE.methods
    late = replace(plan, description=plan.description.replace(f"on {day}.", "on 2026-11-06."))
    (said,) = contradictions(replace(WHOLE, methods=(WHOLE.methods[0], late, *WHOLE.methods[2:])))
    assert said == "issued on 2026-11-05, before the test plan was confirmed on 2026-11-06"


@pytest.mark.parametrize(
    "wording",
    [
        "Of the arm we say that it is not conform. Two values lie outside.",
        "Decision on conformity: not conform.",
        "The arm does not conform to its specification. Other arms conform.",
        "Two values exceed their limits.",
        "Whether it is conform: not conform",
    ],
)
def test_other_words_of_another_version_are_no_contradiction(wording):
    name = WHOLE.title.removeprefix("Verification: ")
    for text in (wording, f"{name}: {wording}"):
        check_consistency(with_statement(WHOLE, "decision", lambda _, text=text: text))
    open_ = replace(WHOLE, equipment=(replace(WHOLE.equipment[0], accreditation=None), *WHOLE.equipment[1:]))
    for said in (
        "Traceability of the ball could not be shown.",
        "Traceability rests on the calibration of: ball, bar.",
    ):
        check_consistency(with_statement(open_, "traceability", lambda _, said=said: said))
