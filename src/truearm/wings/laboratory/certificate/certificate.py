"""The content of a calibration certificate of a verification, independent of the file format."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from math import isfinite

from truearm import __version__
from truearm.acceptance import contradict
from truearm.errors import InputError
from truearm.wings.laboratory.certificate.administrative_data import AdministrativeData, xml_text
from truearm.wings.laboratory.certificate.statements import Statement, make_statements, traceability_gap, used_artefacts
from truearm.wings.laboratory.standards.artefacts import Artefact
from truearm.wings.laboratory.standards.coordinate_origin import NO_ARM
from truearm.wings.laboratory.standards.copied_points import find_copy
from truearm.wings.laboratory.standards.decision import COVERAGE_PROBABILITY, Budget, ConformityResult, Verdict
from truearm.wings.laboratory.standards.verification import MOST_DAYS, RULE_STANDARDS, Verification, describe_rule
from truearm.wings.laboratory.standards.verification_plan import PLANS, is_confirmed, load_verification_plan

SOFTWARE = "truearm"
DEGREES_OF_FREEDOM = "degrees of freedom"
COMBINED = "combined standard uncertainty"
DECISION_RULE = "Decision rule"
TITLE = "Verification: "
LISTED_ENTRIES = " Numbers and formulas, and where they stand: "
# The non-binary rule with guard bands of ILAC-G8:09/2019 [recalled, not confirmed]: undecided values within their limit
# are a conditional pass, those beyond it a conditional fail. Of a value that was measured outside the rated conditions
# of its limit no conformity is stated, not even "noPass", which a machine can take for a rejection.
CONFORMITY_VERDICTS = {
    "pass": Verdict.CONFORM,
    "conditionalPass": Verdict.UNDECIDED,
    "conditionalFail": Verdict.UNDECIDED,
    "fail": Verdict.NOT_CONFORM,
}
CONFORMITIES = tuple(CONFORMITY_VERDICTS)


@dataclass(frozen=True)
class StatedQuantity:
    """A number with unit and uncertainty, to the digits that are stated.

    Parameters
    ----------
    name : str
    value : Decimal
    unit : {"mm", "degC", "1"}
    expanded, factor, level : Decimal, optional
        Expanded uncertainty, its coverage factor k and coverage probability; all or none.
    standard : Decimal, optional
        Standard uncertainty, where no expanded one is stated.
    """

    name: str
    value: Decimal
    unit: str
    expanded: Decimal | None = None
    factor: Decimal | None = None
    level: Decimal | None = None
    standard: Decimal | None = None


@dataclass(frozen=True)
class StatedResult:
    """A test value with the limit of its magnitude, and one of `CONFORMITIES`.

    Without a limit, or in a certificate that makes no statement of conformity, the conformity is None.
    """

    quantity: StatedQuantity
    limit: StatedQuantity | None
    conformity: str | None


@dataclass(frozen=True)
class StatedList:
    """Quantities that belong together: the individual results of a test value, or an uncertainty budget."""

    name: str
    quantities: tuple[StatedQuantity, ...]


@dataclass(frozen=True)
class Method:
    """A procedure, and the standard that describes it."""

    name: str
    description: str
    norm: str | None = None


@dataclass(frozen=True)
class Equipment:
    """An artefact: its certificate, who issued it with which accreditation, the calibrated sizes, the serial number."""

    name: str
    description: str
    certificate: str
    quantities: tuple[StatedQuantity, ...]
    issued_by: str
    accreditation: str | None = None
    serial_number: str | None = None


@dataclass(frozen=True)
class Certificate:
    """The content of a calibration certificate.

    Parameters
    ----------
    about : AdministrativeData
    begin, end : date
        First and last day of the measurement.
    software, release : str
        Name and version of the program.
    title : str
        Title of the measurement.
    statements : tuple of Statement
        The decision, the decision rule, uncertainty, traceability, limits of use, and remarks.
    conformity : str or None
        One of `CONFORMITIES`; None in a certificate that makes no statement of conformity: with a reservation, or where
        rated conditions of the limits were not met or are not stated.
    methods : tuple of Method
    equipment : tuple of Equipment
    artefact_degC : (Decimal, Decimal) or None
        Lowest and highest temperature of an artefact, each the mean of a group of points.
    results, as_found : tuple of StatedResult
        The test values; those before an adjustment or a repair.
    individual, budgets : tuple of StatedList
        The individual results behind a test value, and the uncertainty budgets of the test values.
    """

    about: AdministrativeData
    begin: datetime.date
    end: datetime.date
    software: str
    release: str
    title: str
    statements: tuple[Statement, ...]
    conformity: str | None
    methods: tuple[Method, ...]
    equipment: tuple[Equipment, ...]
    artefact_degC: tuple[Decimal, Decimal] | None
    results: tuple[StatedResult, ...]
    as_found: tuple[StatedResult, ...] = ()
    individual: tuple[StatedList, ...] = ()
    budgets: tuple[StatedList, ...] = ()

    def texts(self, kind: str) -> tuple[str, ...]:
        """Return the statements of a kind."""
        return tuple(one.text for one in self.statements if one.kind == kind)

    @property
    def is_traceable(self) -> bool:
        """Whether traceability is shown of every artefact."""
        return are_traceable(self.equipment)

    @property
    def issued(self) -> datetime.date:
        """Date of issue."""
        return self.about.issued

    @property
    def reservation(self) -> str | None:
        """Why the certificate is not for conformity decisions; None if it is."""
        return next(iter(self.texts("reservation")), None)


def days_in(text: str) -> tuple[datetime.date, ...]:
    """The days that a text of a certificate states, in their order."""
    found = []
    for day in re.findall(r"\b\d{4}-\d\d-\d\d\b", text, re.ASCII):
        with suppress(ValueError):  # such as 2026-02-30
            found.append(datetime.date.fromisoformat(day))
    return tuple(found)


def are_traceable(equipment: Sequence[Equipment]) -> bool:
    """Whether traceability is shown of every artefact."""
    return all(traceability_gap(one.certificate, one.issued_by, one.accreditation) is None for one in equipment)


def make_certificate(
    about: AdministrativeData,
    verification: Verification,
    *,
    as_found: Verification | None = None,
    unconfirmed: bool = False,
) -> Certificate:
    """State a verification as a calibration certificate.

    Parameters
    ----------
    about : AdministrativeData
    verification : Verification
    as_found : Verification, optional
        The one before the adjustment or repair that `about` states.
    unconfirmed : bool
        Make a certificate even if numbers of the test plan are not confirmed. It is then marked "not for conformity
        decisions" and states values and limits, but no conformity.

    Raises
    ------
    InputError
        If serial number, dates or temperatures of `about` contradict those of the points, or as
        `check_plan`, `check_artefacts` and `check_uncertainties`.
    """
    verification = verification.in_room(about.room)
    as_found = None if as_found is None else as_found.in_room(about.room)
    gap = verification.gap
    for one in (verification,) if as_found is None else (verification, as_found):
        if not unconfirmed:
            check_plan(one)
        check_artefacts(one)
        check_uncertainties(one)
        check_about(about, one)
    check_as_found(about, verification, as_found)
    check_no_copies(verification, as_found)
    days = [group.date for group in verification.groups]
    degC = verification.temperatures
    stated = gap is None
    return Certificate(
        about=about,
        begin=min([*days, *(group.date for group in as_found.groups)] if as_found else days),
        end=max(days),
        software=SOFTWARE,
        release=__version__,
        title=xml_text(f"{TITLE}{verification.specification.name}"),
        statements=make_statements(about, verification, gap, as_found=as_found),
        conformity=overall_conformity([conformity_of(row) for row in verification.rows_with_limit]) if stated else None,
        methods=_methods(verification, stated=stated),
        equipment=tuple(_equipment(one, of) for one, of in used_artefacts(verification, as_found)),
        artefact_degC=None if degC is None else (_to(degC[0], 2), _to(degC[1], 2)),
        results=tuple(_result(row, stated) for row in verification.rows),
        as_found=() if as_found is None else tuple(_result(row, as_found.gap is None) for row in as_found.rows),
        individual=tuple(_individual(row) for row in verification.rows if len(row.individual) > 1),
        budgets=_budgets(verification),
    )


def _methods(verification: Verification, *, stated: bool) -> tuple[Method, ...]:
    """How uncertainty, test values and, where conformity is stated, the decision were made."""
    uncertainty = Method(
        "Expanded uncertainty",
        "Of the test value, from artefact and set-up; it does not contain the errors of the arm, which are tested. "
        "Standard uncertainty times the coverage factor k of Student's t for the effective degrees of freedom.",
        "JCGM 100:2008",
    )
    plan = Method(
        xml_text(verification.plan.heading),
        xml_text(_describe_plan(verification)),
        xml_text(verification.plan.standard) if stated and not verification.plan.is_own else None,
    )
    if not stated:
        return uncertainty, plan
    rule = describe_rule(verification.rule)
    return uncertainty, plan, Method(DECISION_RULE, xml_text(rule), RULE_STANDARDS[verification.rule])


def check_about(about: AdministrativeData, verification: Verification) -> None:
    """Check that the administrative data fit the verification; all faults are raised at once.

    Raises
    ------
    InputError
        If serial number, dates or temperatures contradict those of the points.
    """
    days, confirmation = [group.date for group in verification.groups], verification.plan.confirmation
    about.check_fits(
        serial_number=verification.measured.serial_number,
        measured=(min(days), max(days)),
        confirmed=None if confirmation is None else confirmation.date,
        artefact_degC=verification.temperatures,
    )


def check_as_found(about: AdministrativeData, verification: Verification, as_found: Verification | None) -> None:
    """Check that results as found are those before an adjustment or a repair.

    Raises
    ------
    InputError
        If `about` states none, they were measured after the others, or were tested by another plan, rule or limits than
        those that the certificate states.
    Contradiction
        If they were measured more than `MOST_DAYS` before.
    """
    if as_found is None:
        return
    if about.adjustment is None:
        raise InputError(
            "results as found, but no adjustment or repair is stated",
            hint="add the table [adjustment], with kind, work",
        )
    last, first = max(one.date for one in as_found.groups), min(one.date for one in verification.groups)
    if last > first:
        raise InputError(
            f"points as found were measured on {last}, after the first points as left on {first}",
            hint="exchange the two files of points, or correct their dates",
        )
    for what in ("plan", "rule", "specification"):
        if getattr(as_found, what) != getattr(verification, what):
            raise InputError(
                f"the results as found were tested by another {what} than those as left, and a certificate states one",
                hint="verify both by the same files",
            )
    if (days := (first - min(one.date for one in as_found.groups)).days) > MOST_DAYS:
        problem = f"points as found were measured {days} days before those as left: the arm was used between"
        contradict(as_found.measured.error(problem, hint="give the points that were measured before the work"))


def check_no_copies(verification: Verification, as_found: Verification | None) -> None:
    """Check that no measurement as found is a copy of one as left, moved or not: noise does not repeat.

    Raises
    ------
    Contradiction
        If one is.
    """
    if as_found is None or as_found.measured.file is None:  # points that a program calculated are not checked
        return
    for test, groups in as_found.measured.tests.items():
        left = verification.measured.tests.get(test, ())
        if left and (found := find_copy(groups, left)) is not None:
            contradict(
                as_found.measured.error(
                    f"points as found: test {test!r}, {found[1]} as left: a copy",
                    found[0],
                    hint="give the points that were measured before the work",
                )
            )


def check_plan(verification: Verification) -> None:
    """Check that the laboratory has confirmed the numbers of the test plan.

    Raises
    ------
    InputError
        If not.
    """
    gap = verification.gap
    if gap is None:
        return
    if gap.endswith(NO_ARM):
        raise InputError(f"no certificate: {gap}", hint="measure the arm")
    name = verification.plan.name
    file = f"truearm verify plan {name} > my-plan.toml" if name in PLANS else "your plan file"
    raise InputError(
        f"no certificate: {gap}",
        hint=f"{file}: compare each entry with your copy of the standard, type the clause into source, set confirmed "
        "= true, and add [confirmation] with confirmed_by and date; or --unconfirmed for a certificate marked 'not for "
        "conformity decisions'",
    )


def check_artefacts(verification: Verification) -> None:
    """Check that the issuing laboratory of every artefact's certificate is known: traceability needs it.

    Raises
    ------
    InputError
        If not.
    """
    unknown = [one.name for one in verification.used_artefacts if one.issued_by is None]
    if unknown:
        raise InputError(
            f"{', '.join(map(repr, unknown))}: a certificate names the laboratory that calibrated each artefact",
            hint='add issued_by = "NAME OF THE LABORATORY" to the artefact, from its certificate',
        )


def check_uncertainties(verification: Verification) -> None:
    """Check that every value with a limit has an uncertainty: a calibration states one.

    Raises
    ------
    InputError
        If the form and the fixture of an artefact have no uncertainty.
    """
    for row in verification.rows_with_limit:
        if row.uncertainty == 0:
            raise InputError(
                f"{xml_text(row.name):.200}: its expanded uncertainty is 0; a certificate states no value without an "
                "uncertainty",
                hint="enter form_mm and u_fixture_mm of the artefact from its certificate and for your set-up",
            )


def _describe_plan(verification: Verification) -> str:
    """The source of the test plan and its numbers."""
    plan = verification.plan
    if plan.name in PLANS and plan == load_verification_plan(plan.name):
        source = f"Test plan {plan.name} of {SOFTWARE} {__version__}, unchanged."
    else:
        known = "" if verification.plan_sha256 is None else f", SHA-256 {verification.plan_sha256}"
        source = f"Test plan of the user, named {plan.name}{known}."
    if plan.confirmation is not None and verification.gap is None:
        by, day = plan.confirmation.confirmed_by, plan.confirmation.date
        source += f" Its entries were confirmed against {plan.standard} by {by} on {day}."
    entries: dict[str, list[str]] = {}
    for one in plan.entries(verification.measured.tests):
        place = one.source if is_confirmed(one) else "not confirmed"
        entries.setdefault(one.test, []).append(f"{one.describe()} ({place})")
    listed = "; ".join(f"{test}: {', '.join(stated)}" for test, stated in entries.items())
    return f"{source}{LISTED_ENTRIES}{listed}."


def conformity_of(row: ConformityResult) -> str | None:
    """The verdict of a row as one of `CONFORMITIES`; None without a limit or outside its rated conditions."""
    if row.verdict is None or row.limit is None or not row.in_rated_conditions:
        return None
    return conformity(row.verdict, within=abs(row.value) <= row.limit)


def conformity(verdict: Verdict, *, within: bool) -> str:
    """A verdict as one of `CONFORMITIES`; `within` says on which side of its limit the value is."""
    possible = [one for one in CONFORMITIES if CONFORMITY_VERDICTS[one] is verdict]
    return possible[0 if within else -1]


def overall_conformity(stated: Sequence[str | None]) -> str | None:
    """The worst conformity of all values; None if nothing is stated of some value, unless another one fails."""
    if "fail" in stated:
        return "fail"
    known = [one for one in stated if one is not None]
    return max(known, key=CONFORMITIES.index) if known and len(known) == len(stated) else None


def _result(row: ConformityResult, stated: bool) -> StatedResult:
    limit = None if row.limit is None else StatedQuantity("limit of the magnitude", _exact(row.limit), "mm")
    return StatedResult(_value(row, row.name), limit, conformity_of(row) if stated else None)


def _value(row: ConformityResult, name: str) -> StatedQuantity:
    """A test value to the digits of its expanded uncertainty, and that uncertainty."""
    name, u = xml_text(name), row.uncertainty
    if row.unit != "mm":  # a count
        return StatedQuantity(name, Decimal(int(row.value)), "1")
    value = _rounded(row.value, u)
    if u == 0:
        return StatedQuantity(name, value, "mm")
    factor, level = _to(row.budget.coverage_factor, 2), _to(COVERAGE_PROBABILITY, 4)
    return StatedQuantity(name, value, "mm", _rounded(u, u), factor, level)


def _individual(row: ConformityResult) -> StatedList:
    return StatedList(
        xml_text(row.label),
        tuple(_value(one, one.where or str(number)) for number, one in enumerate(row.individual, start=1)),
    )


def _budgets(verification: Verification) -> tuple[StatedList, ...]:
    """The uncertainty budgets, each with the test values that it belongs to."""
    names: dict[Budget, list[str]] = {}
    for row in verification.rows:
        if row.budget.contributions:
            names.setdefault(row.budget, []).append(row.name)
    return tuple(
        StatedList("; ".join(dict.fromkeys(map(xml_text, of))), _budget(budget)) for budget, of in names.items()
    )


def _budget(budget: Budget) -> tuple[StatedQuantity, ...]:
    """Standard uncertainties, each followed by its degrees of freedom where they are finite."""
    lines = []
    for label, u, dof in (
        *((one.label, one.u, one.dof) for one in budget.contributions),
        (COMBINED, budget.u, budget.dof),
    ):
        lines.append(StatedQuantity(xml_text(label), _rounded(u, u), "mm"))
        if isfinite(dof):
            lines.append(StatedQuantity(xml_text(f"{label}: {DEGREES_OF_FREEDOM}"), _to(dof, 1), "1"))
    return tuple(lines)


def _equipment(one: Artefact, verification: Verification) -> Equipment:
    sizes = verification.sizes(one)
    return Equipment(
        xml_text(f"{one.kind} {one.name}"),
        f"Calibrated on {one.date}, certificate valid until {one.expires}.",
        xml_text(one.certificate),
        tuple(
            StatedQuantity(xml_text(f"{name} at 20 degC"), _rounded(value, u), "mm", standard=_rounded(u, u))
            for name, value, u in sizes
        ),
        xml_text(one.issued_by or ""),  # `check_artefacts` asks for it
        None if one.issuer_accreditation is None else xml_text(one.issuer_accreditation),
        None if (number := verification.serial_number(one)) is None else xml_text(number),
    )


def _exact(limit: float) -> Decimal:
    """A limit is exact; twelve digits remove the rounding of its arithmetic."""
    return Decimal(f"{limit:.12g}")


def _rounded(value: float, u: float) -> Decimal:
    """To the decimal of the second significant digit of an uncertainty (GUM 7.2.6); to 0.1 um where that is 0."""
    return _to(value, 4) if u == 0 else _to(value, 1 - int(f"{u:.1e}".partition("e")[2]))


def _to(value: float, decimals: int) -> Decimal:
    rounded = Decimal(f"{round(value, decimals):.{max(decimals, 0)}f}")
    if not rounded.is_finite():
        raise InputError(f"expected a finite number to state, got {value}")
    return abs(rounded) if rounded == 0 else rounded  # no -0.0000
