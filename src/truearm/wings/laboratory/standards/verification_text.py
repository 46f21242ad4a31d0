"""A verification in words: the decision, the decision rule, the uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal

from truearm.number_format import capitalize, format_count, format_in_text, format_number
from truearm.wings.laboratory.standards.decision import (
    CONFORMANCE_PROBABILITY,
    COVERAGE_PROBABILITY,
    SIMPLE_RATIO,
    ConformityResult,
    DecisionRule,
    Verdict,
)
from truearm.wings.laboratory.standards.verification import Verification
from truearm.wings.laboratory.standards.verification_plan import is_confirmed

RULE_STANDARDS: Mapping[DecisionRule, str | None] = {
    "iso14253-1:2017": "ISO 14253-1:2017",
    "iso14253-1:2013": "ISO 14253-1:2013",
    "simple": None,
}
UNROUNDED_TEXT = "Values are compared before rounding."
LEVEL_TEXT = format_in_text(round(100 * COVERAGE_PROBABILITY, 2), unit="%", digits=4)


def describe_decision(verification: Verification) -> str:
    """Describe the decision: whether the arm conforms, and which values decide."""
    rows, specification = verification.rows_with_limit, verification.specification
    by = {one: [row for row in rows if row.verdict is one] for one in Verdict}
    limits = f"Limits: {specification.source}, for a measuring range of {specification.measuring_range_mm:g} mm"
    parts = [f"{specification.name}: {verification.conclusion.value}. {limits}."]
    if verification.gap is not None:
        beyond = f"; outside: {_list_rows(by[Verdict.NOT_CONFORM])}" if by[Verdict.NOT_CONFORM] else ""
        return " ".join([*parts, f"{capitalize(verification.gap)}.", f"{_count_within(verification)}{beyond}."])
    if verification.verdict is Verdict.CONFORM:
        parts.append(f"All tested values conform: {format_count(len(rows), 'value')} with a limit.")
    if outside := by[Verdict.NOT_CONFORM]:
        verb = "does" if len(outside) == 1 else "do"
        parts.append(f"{format_count(len(outside), 'value')} {verb} not conform: {_list_rows(outside)}.")
    if unrated := [row for row in by[Verdict.UNDECIDED] if not row.in_rated_conditions]:
        verb = "is" if len(unrated) == 1 else "are"
        parts.append(f"{format_count(len(unrated), 'value')} {verb} not decided: {describe_unmet(verification)}.")
    if between := [row for row in by[Verdict.UNDECIDED] if row.in_rated_conditions]:
        verb = "lies" if len(between) == 1 else "lie"
        parts.append(
            f"{format_count(len(between), 'value')} {verb} in the guard band about the limit, and can neither "
            f"be shown to conform nor not to conform: {_list_rows(between)}. Use an artefact or a set-up with a "
            "smaller uncertainty."
        )
    return " ".join(parts)


def describe_unmet(verification: Verification) -> str:
    """The rated conditions that were not met, and those that are not stated, in one phrase."""
    parts = []
    if unmet := verification.unmet_conditions:
        parts.append(f"rated conditions not met: {'; '.join(map(str, unmet))}")
    elif unstated := verification.unstated_conditions:
        listed = "; ".join(f"{one}, {one.missing}" for one in unstated)
        parts.append(f"rated conditions not stated for all points: {listed}")
    return "; ".join(parts)


def verdict_sentence(verification: Verification) -> str:
    """The verdict in one sentence: how many of the tested values do not conform, and how many are undecided."""
    rows = verification.rows_with_limit
    count = sum(row.verdict is verification.verdict for row in rows)
    if verification.gap is not None:
        reason = verification.gap.partition(": ")[0]
        return f"Not for conformity decisions: {reason}. {_count_within(verification)}."
    if verification.verdict is Verdict.CONFORM:
        return f"Conform: {'all ' if count > 1 else ''}{format_count(count, 'tested value')} within the limits."
    of = f"{count} of {format_count(len(rows), 'tested value')}"
    if verification.verdict is Verdict.UNDECIDED and not all(row.in_rated_conditions for row in rows):
        return f"Undecided: {describe_unmet(verification)}."
    if verification.verdict is Verdict.NOT_CONFORM:
        undecided = sum(row.verdict is Verdict.UNDECIDED for row in rows)
        more = f", {undecided} {'is' if undecided == 1 else 'are'} undecided" if undecided else ""
        return f"Not conform: {of} {'does' if count == 1 else 'do'} not conform{more}."
    return f"Undecided: {of} too near to the limit for the uncertainty of the test."


def _count_within(verification: Verification) -> str:
    rows = verification.rows_with_limit
    within = sum(row.verdict is Verdict.CONFORM for row in rows)
    return f"{within} of {format_count(len(rows), 'tested value')} {'is' if within == 1 else 'are'} within the limits"


def worst_values(verification: Verification) -> str:
    """The values that decide against conformity, with their uncertainties and limits; empty if all conform.

    A value that was measured outside the rated conditions decides nothing, whatever it is.
    """
    conform = verification.verdict is Verdict.CONFORM
    rows = [row for row in verification.rows_with_limit if row.in_rated_conditions]
    deciding = [] if conform else [row for row in rows if row.verdict is verification.verdict]
    return f"{_list_rows(deciding)}." if deciding else ""


def describe_sources(verification: Verification) -> list[str]:
    """Where each number and formula of the plan stands: a line for each test, for those that are confirmed."""
    by_test: dict[str, dict[str, list[str]]] = {}
    for one in verification.plan.entries(verification.measured.tests):
        if is_confirmed(one):
            by_test.setdefault(one.test, {}).setdefault(one.source, []).append(one.describe())
    return [
        f"where it stands, {test}: " + "; ".join(f"{', '.join(entries)} ({place})" for place, entries in places.items())
        for test, places in by_test.items()
    ]


def describe_rule(rule: DecisionRule, *, confirmed: bool = True) -> str:
    """Describe the decision rule, with the edition of the standard, and whether somebody has confirmed it."""
    recalled = "" if confirmed else ", as recalled, not confirmed against its text"
    whole = (
        "a value conforms if it lies within its limit by the expanded uncertainty U or more, it does not conform if it "
        "lies beyond by more than U, and is undecided in the guard band between"
    )
    if rule == "iso14253-1:2017":
        level = format_in_text(100 * CONFORMANCE_PROBABILITY, unit="%")
        return (
            f"Decision rule: a value conforms if the quantity lies within its limits with a probability of {level} or "
            f"more, it does not conform if the quantity lies beyond the nearer limit with a probability of {level} or "
            "more, and is undecided between. The quantity has a normal distribution about the value with the standard "
            "uncertainty u, or Student's t where u has few degrees of freedom; where u is small, the guard band is "
            f"1.645 u. This is the default rule of ISO 14253-1:2017{recalled}. {UNROUNDED_TEXT}"
        )
    if rule == "simple":
        return (
            "Decision rule: simple acceptance where the expanded uncertainty U is at most "
            f"1/{SIMPLE_RATIO:g} of the limit: a value conforms if it does not exceed its limit. Where U is larger, "
            f"{whole}. {UNROUNDED_TEXT}"
        )
    return (
        f"Decision rule: {whole}. This is the rule of ISO 14253-1:2013, which is withdrawn{recalled}; the edition of "
        f"2017 has smaller guard bands. {UNROUNDED_TEXT}"
    )


def limit_uncertainty(limit: float) -> float:
    """The uncertainty at which a limit is printed with all its digits, to the nanometre; A + L/K has more."""
    exponent = Decimal(f"{limit:.6f}").normalize().as_tuple().exponent
    assert isinstance(exponent, int)
    return float(10.0 ** (1 + min(exponent, 0)))


def _list_rows(rows: Sequence[ConformityResult]) -> str:
    """Rows with value, uncertainty and limit, for a sentence."""
    return "; ".join(
        f"{row.name}, {_with_uncertainty(row)}, limit "
        f"{format_number(row.limit, uncertainty=limit_uncertainty(row.limit))}\u202fmm"
        for row in rows
        if row.limit is not None
    )


def _with_uncertainty(row: ConformityResult) -> str:
    u = row.uncertainty
    value = format_number(row.value, uncertainty=u)
    return f"({value} ± {format_number(u, uncertainty=u)})\u202fmm" if u else f"{value}\u202fmm"
