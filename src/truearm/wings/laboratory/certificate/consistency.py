"""Whether a certificate agrees with itself: what it states is recomputed from the other numbers that it states.

Written values are rounded. A statement contradicts the numbers only if no values that round to the written ones agree.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from decimal import Decimal
from functools import cache
from itertools import product
from math import inf, isinf

import numpy as np
from scipy.special import stdtrit

from truearm.errors import FaultCollector, InputError
from truearm.wings.laboratory.certificate.certificate import (
    COMBINED,
    CONFORMITIES,
    CONFORMITY_VERDICTS,
    DECISION_RULE,
    DEGREES_OF_FREEDOM,
    LISTED_ENTRIES,
    TITLE,
    Certificate,
    StatedList,
    StatedQuantity,
    StatedResult,
    conformity,
    days_in,
    overall_conformity,
)
from truearm.wings.laboratory.certificate.statements import ESTABLISHED
from truearm.wings.laboratory.certificate.word_consistency import word_contradictions
from truearm.wings.laboratory.standards.asme_b89_4_22 import DEVIATION_STATISTICS
from truearm.wings.laboratory.standards.decision import COVERAGE_PROBABILITY, DecisionRule, Verdict, decide
from truearm.wings.laboratory.standards.verification import RULE_STANDARDS

_REMEDY = "do not use this certificate; ask the laboratory that issued it"
# What a decision calls its verdict, and traceability that is not shown, in the words of any version.
_VERDICT = re.compile(r"\b(?:not conform|undecided|not decided|(?<!not )conform)")
_VERDICT_WORDS = {
    Verdict.CONFORM: {"conform"},
    Verdict.UNDECIDED: {"undecided", "not decided"},
    Verdict.NOT_CONFORM: {"not conform"},
}
_NOT_SHOWN = re.compile(r"\bnot (?:be |been )?shown\b")
_DOF = np.arange(1.0, 2000.0)
_LARGEST = "Volumetric.Max"
# By how many times its size the rounding of each deviation moves what ASME B89.4.22 computes from all of them.
_OF_DEVIATIONS = {"Volumetric.2s": 3.0, "Volumetric.2RMS": 2.0, "Volumetric, range": 2.0, "Volumetric, mean": 1.0}


def check_consistency(certificate: Certificate) -> None:
    """Check that a certificate does not contradict itself.

    Recomputed are the conformity of each value from value, U, limit and decision rule; the decision from those of all
    values, with what its sentence says; test values from the individual results, of which they are the worst; U and k
    from the budget, and its sum; whether traceability is shown of all artefacts; the order of the days, also of the
    artefacts' calibrations; and what its sentences say of the same things. Wording is that of the version which wrote
    the certificate, and contradicts nothing.

    Raises
    ------
    InputError
        With all contradictions.
    """
    found = FaultCollector()
    for problem in (
        *_days(certificate),
        *_verdicts(certificate),
        *_decision(certificate),
        *_individual(certificate),
        *_uncertainties(certificate),
        *_budgets(certificate),
        *_traceability(certificate),
        *word_contradictions(certificate),
    ):
        with found.collect():
            raise InputError(f"the certificate contradicts itself: {problem}", hint=_REMEDY)
    found.raise_any()


def _days(certificate: Certificate) -> Iterator[str]:
    if certificate.end < certificate.begin:
        yield f"measured from {certificate.begin} to {certificate.end}"
    if certificate.issued < certificate.end:
        yield f"issued on {certificate.issued}, before the last points were measured on {certificate.end}"
    received = certificate.about.received
    if received is not None and received > certificate.begin:
        yield f"the arm was received on {received}, after points were measured on {certificate.begin}"
    for method in certificate.methods:
        about_plan = method.description.partition(LISTED_ENTRIES)[0].partition(" confirmed against ")[2]
        if not (confirmed := days_in(about_plan)):
            continue
        if certificate.issued < confirmed[-1]:
            yield f"issued on {certificate.issued}, before the test plan was confirmed on {confirmed[-1]}"
        year = re.search(r"\b(?:19|20)\d\d$", about_plan.partition(" by ")[0])
        if year is not None and confirmed[-1].year < int(year[0]):
            yield f"the test plan was confirmed on {confirmed[-1]}, before its standard was published"
    for one in certificate.equipment:
        days = days_in(one.description)
        if days and days[0] > certificate.end:
            yield f"{one.name} was calibrated on {days[0]}, after the last points were measured on {certificate.end}"
        if len(days) > 1 and days[-1] < days[0]:
            yield f"the certificate of {one.name} expired on {days[-1]}, before its calibration on {days[0]}"
        elif len(days) > 1 and days[-1] < certificate.begin:
            yield f"the certificate of {one.name} expired on {days[-1]}, before points were measured"


def _verdicts(certificate: Certificate) -> Iterator[str]:
    stated = [one for one in (*certificate.results, *certificate.as_found) if one.conformity is not None]
    if not stated:
        return
    norms = [method.norm for method in certificate.methods if method.name == DECISION_RULE]
    rules = {norm: rule for rule, norm in RULE_STANDARDS.items()}
    if len(norms) != 1 or norms[0] not in rules:
        yield "it states conformities, but not one decision rule that this version of truearm knows"
        return
    for one in stated:
        possible = _possible_conformities(one, rules[norms[0]])
        if one.conformity not in possible:
            assert one.limit is not None
            yield (
                f"{one.quantity.name} is {one.quantity.value} mm with U = {one.quantity.expanded or 0} mm, its limit "
                f"{one.limit.value} mm: by the decision rule {' or '.join(possible)}; it states {one.conformity}"
            )


def _possible_conformities(result: StatedResult, rule: DecisionRule) -> tuple[str, ...]:
    """The conformities by a rule of all values and uncertainties that round to those of a result."""
    quantity = result.quantity
    assert result.limit is not None
    limit, size, near = float(result.limit.value), abs(float(quantity.value)), _half_digit(quantity.value)
    expanded = quantity.expanded or Decimal(0)
    beside = _half_digit(expanded) if expanded else 0.0
    found = set()
    for value, uncertainty, dof in product(
        (max(size - near, 0.0), size, size + near),
        (max(float(expanded) - beside, 0.0), max(float(expanded) + beside, 0.0)),
        _dof_of(quantity.factor) or (inf,),
    ):
        verdict = decide(value, uncertainty, limit, rule=rule, dof=dof)
        found.add(CONFORMITIES.index(conformity(verdict, within=value <= limit)))
    return CONFORMITIES[min(found) : max(found) + 1]


@cache  # certificates have a few factors, each in many results
def _dof_of(factor: Decimal | None) -> tuple[float, ...]:
    """The fewest and the most degrees of freedom whose coverage factor rounds to a stated one; empty if none does."""
    known = _DOF[np.abs(stdtrit(_DOF, (1 + COVERAGE_PROBABILITY) / 2) - float(factor or 2)) <= 0.0051]
    return () if not known.size else (known[0], inf if known[-1] == _DOF[-1] else known[-1])


def _decision(certificate: Certificate) -> Iterator[str]:
    if certificate.reservation is not None:
        return
    overall = overall_conformity([one.conformity for one in certificate.results if one.limit is not None])
    if overall != certificate.conformity:
        yield f"by its values the decision is {overall or 'none'}; it states {certificate.conformity or 'none'}"
    verdict = CONFORMITY_VERDICTS[overall] if overall else Verdict.UNDECIDED
    for text in certificate.texts("decision"):
        # The wording is that of the version that wrote it: the first sentence that names a verdict names this one.
        sentences = text.removeprefix(certificate.title.removeprefix(TITLE)).lstrip(": ").split(". ")
        said, named = next(
            ((one, words) for one in sentences if (words := set(_VERDICT.findall(one.casefold())))), ("", set())
        )
        if named and not named & _VERDICT_WORDS[verdict]:
            yield f"by its values the arm is {verdict.value!r}; the decision says {said.removesuffix('.')[:80]!r}"


def _individual(certificate: Certificate) -> Iterator[str]:
    """Test values that are none or not the worst of their individual results, or not computed from them."""
    lists: dict[str, list[StatedList]] = {}
    for one in certificate.individual:
        lists.setdefault(one.name, []).append(one)
    # Of a test with sets that were measured again, not all individual results count.
    quantities = [one.quantity for one in certificate.results]
    again = {one.name.partition(", ")[0] for one in quantities if one.unit == "1" and one.value}
    for quantity, limit in zip(quantities, (one.limit for one in certificate.results), strict=True):
        parts = quantity.name.split(", ")
        own = next((lists[name] for n in range(len(parts), 0, -1) if (name := ", ".join(parts[:n])) in lists), [])
        if own and not any(quantity.value == one.value for listed in own for one in listed.quantities):
            yield f"{quantity.name} is {quantity.value}, which is none of its individual results"
        elif limit is not None and parts[0] not in again and (worse := _worse(quantity, own)) is not None:
            yield f"{quantity.name} is {quantity.value}, but the individual result {worse.name!r} is {worse.value}"
        if quantity.name in _OF_DEVIATIONS and len(lists.get(_LARGEST, [])) == 1:
            compute, times = DEVIATION_STATISTICS.get(quantity.name, np.mean), _OF_DEVIATIONS[quantity.name]
            deviations = lists[_LARGEST][0].quantities
            value = float(compute(np.array([float(one.value) for one in deviations])))
            rounding = times * max(_half_digit(one.value) for one in deviations) + _half_digit(quantity.value)
            if abs(value - float(quantity.value)) > rounding:
                yield f"{quantity.name} is {value:.5f} mm by the individual results; it states {quantity.value} mm"


def _worse(quantity: StatedQuantity, lists: list[StatedList]) -> StatedQuantity | None:
    """An individual result that is worse than the test value: as uncertain, with the same limit, and larger."""
    if quantity.expanded is None:
        return None
    test = _before_place(quantity.name)
    alike = [
        one
        for listed in lists
        for one in listed.quantities
        if _before_place(f"{listed.name}, {one.name}") == test
        and (one.expanded, one.factor) == (quantity.expanded, quantity.factor)
    ]
    worst = max(alike, key=lambda one: abs(one.value), default=quantity)
    rounding = _half_digit(worst.value) + _half_digit(quantity.value) + 2 * _half_digit(quantity.expanded)
    return worst if float(abs(worst.value) - abs(quantity.value)) > rounding else None


def _before_place(name: str) -> str:
    """The test of a value, and its length, on which a limit may depend: what stands before position and run."""
    place = re.search(r", (?:position|repeat) ", name)
    return name.rpartition(", ")[0] if place is None else name[: place.start()]


def _uncertainties(certificate: Certificate) -> Iterator[str]:
    """Values with a limit without U, and expanded uncertainties that are none for the coverage probability."""
    level = Decimal(f"{COVERAGE_PROBABILITY:.4f}")
    for one in (*certificate.results, *certificate.as_found):
        quantity, limit = one.quantity, one.limit
        if limit is not None and (quantity.expanded is None or {quantity.unit, limit.unit} != {"mm"}):
            yield f"{quantity.name} has a limit, but not both in mm with an expanded uncertainty"
        elif quantity.expanded is not None and not (
            quantity.expanded > 0 and quantity.level == level and _dof_of(quantity.factor)
        ):
            stated = f"U = {quantity.expanded} with k = {quantity.factor} for {quantity.level}"
            yield f"{quantity.name} has {stated}; truearm states U for {level}, with k of Student's t"


def _traceability(certificate: Certificate) -> Iterator[str]:
    for text in certificate.texts("traceability"):
        denied = _NOT_SHOWN.search(text) is not None
        claimed = ESTABLISHED in text and not denied  # versions before the accreditation of issuers say "rests on"
        if denied if certificate.is_traceable else claimed:
            shown = "" if certificate.is_traceable else "not "
            yield f"by its artefacts traceability is {shown}shown of all; it says {text[:200]!r}"


def _budgets(certificate: Certificate) -> Iterator[str]:
    """Budgets whose sum is another, and expanded uncertainties that are not k times that of their budget."""
    known: list[tuple[str, Decimal, float]] = []
    for listed in certificate.budgets:
        lines = [one for one in listed.quantities if not one.name.endswith(f": {DEGREES_OF_FREEDOM}")]
        combined = [one for one in lines if one.name == COMBINED]
        if len(combined) != 1:
            yield f"the budget of {listed.name[:200]} has {len(combined)} lines {COMBINED!r}, not one"
            continue
        dofs = [float(one.value) for one in listed.quantities if one.name == f"{COMBINED}: {DEGREES_OF_FREEDOM}"]
        known.append((f"; {listed.name}; ", combined[0].value, dofs[0] if dofs else inf))
        sizes = np.array([float(one.value) for one in lines if one.name != COMBINED])
        roundings = np.array([_half_digit(one.value) for one in lines])
        value = float(np.hypot.reduce(sizes)) if sizes.size else 0.0
        if abs(value - float(combined[0].value)) > np.sqrt((roundings**2).sum()) + roundings.max():
            yield f"the budget of {listed.name[:200]} sums up to {value:.2g} mm; it states {combined[0].value} mm"
    for quantity in (one.quantity for one in certificate.results):
        budgets = [(u, dof) for names, u, dof in known if f"; {quantity.name}; " in names]
        stated = f"U = {quantity.expanded} mm with k = {quantity.factor}"
        if not budgets and quantity.expanded is not None:
            yield f"{quantity.name} has {stated}, and no budget"
        elif budgets and not any(_is_expanded(quantity, *one) for one in budgets):
            u, dof = budgets[0]
            yield f"{quantity.name} has {stated}; its budget has u = {u} mm with {dof:g} degrees of freedom"


def _is_expanded(quantity: StatedQuantity, u: Decimal, dof: float) -> bool:
    """Whether ``U = k u`` for some values that round to the three, and k is that of the degrees of freedom."""
    expanded, factor = quantity.expanded, quantity.factor
    if expanded is None or factor is None:
        return u == 0
    known = _dof_of(factor)
    truncated = [dof if isinf(dof) else max(1, int(dof + rounding)) for rounding in (-0.0501, 0.0501)]
    if not any(known and known[0] <= one <= known[-1] for one in truncated):
        return False
    rounding = _half_digit(expanded) + float(factor) * _half_digit(u) + float(u) * _half_digit(factor)
    return abs(float(expanded) - float(factor) * float(u)) <= rounding * (1 + 1e-9)


def _half_digit(value: Decimal) -> float:
    """Half a unit of the last written digit, and a billionth more for the arithmetic."""
    exponent = value.as_tuple().exponent
    assert isinstance(exponent, int)  # the reader takes finite numbers only
    return 0.5000000005 * 10.0**exponent
