"""A verification: measured points, tested by a plan against the artefacts' certificates and a specification.

A verification in words: the decision, the decision rule, the uncertainty.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property
from math import isnan

from truearm.acceptance import contradict
from truearm.errors import InputError
from truearm.number_format import capitalize, format_count, format_in_text, format_number
from truearm.wings.laboratory.standards.artefacts import Artefact, Artefacts, CalibratedBar, CalibratedSphere
from truearm.wings.laboratory.standards.coordinate_origin import NO_ARM, VIRTUAL_SERIAL
from truearm.wings.laboratory.standards.decision import (
    CONFORMANCE_PROBABILITY,
    COVERAGE_PROBABILITY,
    SIMPLE_RATIO,
    ConformityResult,
    DecisionRule,
    Verdict,
    outside_rated_conditions,
    overall_verdict,
    simple_applies,
)
from truearm.wings.laboratory.standards.evaluation import Evaluation
from truearm.wings.laboratory.standards.measured_points import MeasuredPoints, PointGroup
from truearm.wings.laboratory.standards.point_checks import PointChecks
from truearm.wings.laboratory.standards.specification import (
    SYMBOLS,
    ConditionResult,
    RatedRange,
    Specification,
    compare_conditions,
    describe_disagreement,
)
from truearm.wings.laboratory.standards.verification_plan import CHECK_STANDARD, VerificationPlan, is_confirmed

# Chosen here: an arm that is tested over a longer time may have been used, moved or adjusted between [d].
MOST_DAYS = 92


@dataclass(frozen=True, eq=False)
class Verification:
    """The result of a verification and its inputs.

    Attributes
    ----------
    rows : tuple of ConformityResult
    verdict : Verdict
        Of the values: conform only if every row with a limit conforms, within the rated conditions of the
        specification. `conclusion` is what may be said of the arm.
    remarks : tuple of str
        Suspected blunders, tests and limits that were not tested, and numbers of the plan to check.
    measured : MeasuredPoints
    plan : VerificationPlan
    artefacts : Artefacts
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}
    plan_sha256 : str or None
        SHA-256 of the plan's file, where it is one of the user's own.
    room : mapping of str to (float, float)
        What is stated of the room beside the points, see `in_room`.
    """

    rows: tuple[ConformityResult, ...]
    verdict: Verdict
    remarks: tuple[str, ...]
    measured: MeasuredPoints
    plan: VerificationPlan
    artefacts: Artefacts
    specification: Specification
    rule: DecisionRule = "iso14253-1:2017"
    plan_sha256: str | None = None
    room: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def in_room(self, room: Mapping[str, tuple[float, float]]) -> Verification:
        """Return the verification with what is stated of the room, as a certificate needs it.

        A limit applies within its rated conditions. So nothing is decided if the room contradicts one of them, or if
        one is not stated for all points. (Where points contradict one, their test is already undecided.)

        Parameters
        ----------
        room : mapping of str to (float, float)
            Lowest and highest value of rated conditions, by their keys.
        """
        rated = self.specification.rated_conditions
        results = compare_conditions(rated, self.groups, room)
        contradicted = any(not rated[key].contains(*pair) for key, pair in room.items() if key in rated)
        before = _condition_remarks(rated, self.conditions)
        apart = describe_disagreement(room.get("air_degC"), self.temperatures)
        remarks = [*_condition_remarks(rated, results), *(one for one in self.remarks if one not in before)]
        remarks = [apart, *(one for one in remarks if one != apart)] if apart else remarks
        rows = self.rows
        if contradicted or any(one.met is None for one in results):
            rows = tuple(map(outside_rated_conditions, rows))
        verdict = overall_verdict(rows)
        assert verdict is not None  # some row has a limit
        return replace(self, rows=rows, verdict=verdict, remarks=tuple(remarks), room=room)

    @cached_property
    def gap(self) -> str | None:
        """What is missing before the results count as results after the standard; None if nothing."""
        if self.measured.origin.is_virtual:
            return f"the points are simulated: {NO_ARM}"
        gap = self.plan.confirmation_gap(self.measured.tests, self.rule)
        if gap is None and (number := self.measured.serial_number).startswith(VIRTUAL_SERIAL):
            return f"the serial number {number!r} of the points is that of a virtual arm: {NO_ARM}"
        return gap

    @property
    def conclusion(self) -> Verdict:
        """The verdict, if the numbers of the plan are confirmed; else the results are not for conformity decisions."""
        return self.verdict if self.gap is None else Verdict.NOT_FOR_DECISIONS

    def describe_row(self, row: ConformityResult) -> str | None:
        """The verdict of a value in a word, which decides nothing by a plan that is not confirmed; None: no limit."""
        return None if row.verdict is None else row.verdict.describe(decides=self.gap is None)

    @property
    def groups(self) -> tuple[PointGroup, ...]:
        """The groups of points of all tests."""
        return _groups(self.measured)

    @property
    def rows_with_limit(self) -> tuple[ConformityResult, ...]:
        """The rows that have a limit."""
        return tuple(row for row in self.rows if row.verdict is not None)

    @property
    def used_artefacts(self) -> tuple[Artefact, ...]:
        """The artefacts that were measured, in the order of the file of artefacts."""
        names = {group.artefact for group in self.groups}
        return tuple(one for one in self.artefacts.all if one.name in names)

    def describe_artefact(self, artefact: Artefact) -> str:
        """An artefact with its serial number, by its file or by the points."""
        return f"{artefact.name}, serial number {self.serial_number(artefact) or 'not stated'}"

    def serial_number(self, artefact: Artefact) -> str | None:
        """The serial number of an artefact, by its file or by the points; None if neither states it."""
        measured = (group.serial_number for group in self.groups if group.artefact == artefact.name)
        return artefact.serial_number or next(filter(None, measured), None)

    def sizes(self, artefact: Artefact) -> list[tuple[str, float, float]]:
        """Return the measured ones of an artefact's calibrated sizes: what it is, value and u at 20 degC [mm]."""
        if isinstance(artefact, CalibratedSphere):
            return [("diameter", artefact.diameter_mm, artefact.u_diameter_mm)]
        if not isinstance(artefact, CalibratedBar):
            return []
        measured = {group.keys["length"] for group in self.groups if group.artefact == artefact.name}
        return [(f"length {one.name}", one.length_mm, one.u_mm) for one in artefact.lengths if one.name in measured]

    @property
    def conditions(self) -> tuple[ConditionResult, ...]:
        """The rated conditions of the specification, each with what was measured."""
        return compare_conditions(self.specification.rated_conditions, self.groups, self.room)

    @property
    def unmet_conditions(self) -> tuple[ConditionResult, ...]:
        """The rated conditions that were not met: limits do not apply outside them."""
        return tuple(one for one in self.conditions if one.met is False)

    @property
    def unstated_conditions(self) -> tuple[ConditionResult, ...]:
        """The rated conditions that are not stated for all points, and not contradicted."""
        return tuple(one for one in self.conditions if one.met is None)

    @property
    def temperatures(self) -> tuple[float, float] | None:
        """The lowest and the highest of the groups' mean artefact temperatures [degC]; None if none is known."""
        return _range([(group.degC, group.degC) for group in self.groups if not isnan(group.degC)])


def verify(
    measured: MeasuredPoints,
    *,
    plan: VerificationPlan,
    artefacts: Artefacts,
    specification: Specification,
    rule: DecisionRule | None = None,
    plan_sha256: str | None = None,
) -> Verification:
    """Verify an arm: evaluate the tests of a plan and compare the test values with the limits of a specification.

    Parameters
    ----------
    measured : MeasuredPoints
    plan : VerificationPlan
    artefacts : Artefacts
        Those of the points, with certificates that were valid on the day.
    specification : Specification
    rule : {"iso14253-1:2017", "iso14253-1:2013", "simple"}, optional
        Decision rule, see `decide`; by default that of the plan.
    plan_sha256 : str, optional
        SHA-256 of the plan's file, for the certificate.

    Raises
    ------
    InputError
        If points of a test are missing, too many or not in the plan; an artefact is unknown, its certificate is not
        valid on the day, or the points cannot belong to it; or no test value has a limit.
    """
    for name, groups in measured.tests.items():
        if name not in plan.tests:
            raise measured.error(
                f"the plan {plan.name!r} has no test {name!r}", groups[0], hint=f"use one of {', '.join(plan.tests)}"
            )
    _check_one_campaign(measured)
    rule = rule or plan.decision_rule.value
    rows: list[ConformityResult] = []
    found: list[str] = []
    remarks = [one.removesuffix(".") for one in measured.accepted]
    for name, test in plan.tests.items():
        if name in measured.tests:
            checks = PointChecks(name, measured, artefacts, specification.measuring_range_mm, found)
            rows += _rated(Evaluation(checks, specification, rule).rows(test), checks.groups, specification)
        elif test.required:
            raise measured.error(
                f"the points of test {name!r} are missing",
                hint=f"measure them, or delete the test from the plan {plan.name!r} if your contract allows it",
            )
        else:
            remarks.append(f"the test {name} of the plan was not carried out: the points have none of it")
    verdict = _verdict(rows, specification)
    remarks += _remarks(rows, plan, specification, rule, measured.tests)
    rated = specification.rated_conditions
    remarks = [
        *_temperature_remarks(measured),
        *found,
        *_condition_remarks(rated, compare_conditions(rated, _groups(measured))),
        *remarks,
    ]
    return Verification(
        tuple(rows), verdict, tuple(remarks), measured, plan, artefacts, specification, rule, plan_sha256
    )


def _check_one_campaign(measured: MeasuredPoints) -> None:
    """Check that the points were measured within some weeks: a test is of the arm in one state."""
    groups = sorted(_groups(measured), key=lambda group: group.date)
    first, last = groups[0], groups[-1]
    if (days := (last.date - first.date).days) > MOST_DAYS:
        problem = f"points of one test were measured on {first.date} and on {last.date}, {days} days apart"
        hint = "correct the date that is mistyped, or measure the arm again as it is now"
        contradict(measured.error(problem, last, hint=hint))


def _verdict(rows: Sequence[ConformityResult], specification: Specification) -> Verdict:
    """The overall verdict; refuses a specification without a limit for what was tested."""
    verdict = overall_verdict(rows)
    if verdict is None:
        raise InputError(
            f"the specification {specification.name!r} states no limit for what was tested",
            hint=f"add a limit under [limits]: one of {', '.join(SYMBOLS)}",
        )
    return verdict


def _temperature_remarks(measured: MeasuredPoints) -> list[str]:
    """That the temperatures of air and artefacts disagree, where they do."""
    air = [one.conditions["air_degC"] for one in _groups(measured) if "air_degC" in one.conditions]
    known = [(one.degC, one.degC) for one in _groups(measured) if not isnan(one.degC)]
    apart = describe_disagreement(_range(air), _range(known))
    return [apart] if apart else []


def _range(pairs: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    return (min(low for low, _ in pairs), max(high for _, high in pairs)) if pairs else None


def _groups(measured: MeasuredPoints) -> tuple[PointGroup, ...]:
    return tuple(group for groups in measured.tests.values() for group in groups)


def _rated(
    rows: Sequence[ConformityResult], groups: Sequence[PointGroup], specification: Specification
) -> list[ConformityResult]:
    """The rows of a test; undecided, those with a limit, if its groups were not measured within rated conditions."""
    if all(one.met is not False for one in compare_conditions(specification.rated_conditions, groups)):
        return list(rows)
    return [outside_rated_conditions(row) for row in rows]


def _condition_remarks(rated: Mapping[str, RatedRange], results: Sequence[ConditionResult]) -> list[str]:
    if not rated:
        return ["the specification states no rated conditions: its limits are taken to apply as measured"]
    remarks = []
    if unmet := [str(one) for one in results if one.met is False]:
        remarks.append(f"not decided where rated conditions were not met: {'; '.join(unmet)}")
    if unstated := [f"{one}, {one.missing}" for one in results if one.met is None]:
        remarks.append(f"it is not stated whether rated conditions were met: {'; '.join(unstated)}")
    return remarks


def _remarks(
    rows: Sequence[ConformityResult],
    plan: VerificationPlan,
    specification: Specification,
    rule: DecisionRule,
    tested: Collection[str],
) -> list[str]:
    remarks = []
    if rule == "simple":
        remarks.append(
            f"simple acceptance: the uncertainty is ignored where it is at most 1/{SIMPLE_RATIO:g} of the limit"
        )
        large = [one.label for one in rows if one.limit is not None and not simple_applies(one.uncertainty, one.limit)]
        if large:
            remarks.append(
                f"U is more than 1/{SIMPLE_RATIO:g} of the limit, so that ISO 14253-1:2013 applies in place of "
                f"simple acceptance: {', '.join(dict.fromkeys(large))}"
            )
    if not specification.corrected_to_20_degC:
        remarks.append("lengths are not corrected to 20 degC: the specification asks for that")
    symbols = dict.fromkeys(row.label.partition(", ")[0] for row in rows)
    limited = {row.label.partition(", ")[0] for row in rows if row.limit is not None}
    if without := [symbol for symbol in symbols if symbol in SYMBOLS and symbol not in limited]:
        remarks.append(f"the specification states no limit for: {', '.join(without)}")
    if untested := [symbol for symbol in SYMBOLS if symbol in specification.limits and symbol not in symbols]:
        remarks.append(f"limits of the specification that were not tested: {', '.join(untested)}")
    unconfirmed = [(one.test, one.describe()) for one in plan.unconfirmed(tested)]
    remarks += _by_test(f"not confirmed, {CHECK_STANDARD}", unconfirmed)
    remarks += _by_test(f"own plan, different from truearm's plan after {plan.standard}", plan.differences())
    return remarks


def _by_test(what: str, entries: Iterable[tuple[str, str]]) -> list[str]:
    """One remark for each test, on entries of the plan."""
    tests: dict[str, list[str]] = {}
    for test, entry in entries:
        tests.setdefault(test, []).append(entry)
    return [f"plan, {test}: {what}: {', '.join(values)}" for test, values in tests.items()]


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
