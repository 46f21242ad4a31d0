"""The content of a calibration certificate of a verification, independent of the file format."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from decimal import Decimal

from truearm import __version__
from truearm.errors import InputError
from truearm.verification.certificate.administrative_data import AdministrativeData, xml_text
from truearm.verification.standards.artefacts import Artefact, CalibratedBar, CalibratedSphere
from truearm.verification.standards.decision import COVERAGE_PROBABILITY, ConformityResult, Verdict
from truearm.verification.standards.verification import Verification
from truearm.verification.standards.verification_plan import PLANS, load_verification_plan
from truearm.verification.standards.verification_text import RULE_STANDARDS, describe_decision, describe_rule

SOFTWARE = "truearm"
# The non-binary rule with guard bands of ILAC-G8:09/2019 [recalled, not confirmed]: undecided values within their limit
# are a conditional pass, those beyond it a conditional fail.
CONFORMITIES = ("pass", "conditionalPass", "conditionalFail", "fail")


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
    """A test value with the limit of its magnitude, and one of `CONFORMITIES`; None where it has no limit."""

    quantity: StatedQuantity
    limit: StatedQuantity | None
    conformity: str | None


@dataclass(frozen=True)
class Method:
    """A procedure, and the standard that describes it."""

    name: str
    description: str
    norm: str | None = None


@dataclass(frozen=True)
class Equipment:
    """An artefact: its certificate and calibrated sizes."""

    name: str
    description: str
    certificate: str
    quantities: tuple[StatedQuantity, ...]


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
    declarations : tuple of str
        The decision, the decision rule, and remarks.
    conformity : str
        One of `CONFORMITIES`.
    methods : tuple of Method
    equipment : tuple of Equipment
    artefact_degC : (Decimal, Decimal) or None
        Lowest and highest temperature of an artefact, each the mean of a group of points.
    results : tuple of StatedResult
    """

    about: AdministrativeData
    begin: datetime.date
    end: datetime.date
    software: str
    release: str
    title: str
    declarations: tuple[str, ...]
    conformity: str
    methods: tuple[Method, ...]
    equipment: tuple[Equipment, ...]
    artefact_degC: tuple[Decimal, Decimal] | None
    results: tuple[StatedResult, ...]


def make_certificate(about: AdministrativeData, verification: Verification) -> Certificate:
    """State a verification as a calibration certificate.

    Raises
    ------
    InputError
        If dates or temperatures of `about` contradict those of the points, or as `check_uncertainties`.
    """
    check_uncertainties(verification)
    days = [group.date for group in verification.groups]
    about.check_days(min(days), max(days))
    degC = verification.temperatures
    if degC is not None:
        about.check_room(*degC)
    rule = describe_rule(verification.rule)
    methods = [
        Method(
            "Expanded uncertainty",
            "Of the test value, from artefact and set-up; it does not contain the errors of the arm, which are tested. "
            "Standard uncertainty times the coverage factor k of Student's t for the effective degrees of freedom.",
            "JCGM 100:2008",
        ),
        Method(
            xml_text(verification.plan.title),
            xml_text(_describe_plan(verification)),
            xml_text(verification.plan.standard),
        ),
        Method("Decision rule", xml_text(rule), RULE_STANDARDS[verification.rule]),
    ]
    return Certificate(
        about=about,
        begin=min(days),
        end=max(days),
        software=SOFTWARE,
        release=__version__,
        title=xml_text(f"Verification: {verification.specification.name}"),
        declarations=tuple(xml_text(text) for text in (describe_decision(verification), rule, *verification.remarks)),
        conformity=_overall(verification),
        methods=tuple(methods),
        equipment=tuple(_equipment(one, verification) for one in verification.used_artefacts),
        artefact_degC=None if degC is None else (_to(degC[0], 2), _to(degC[1], 2)),
        results=tuple(_result(row) for row in verification.rows),
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
    numbers = []
    for name, test in plan.tests.items():
        entries = [(key, one) for key, one in test.model_dump().items() if isinstance(one, dict)]
        numbers.append(f"{name}: " + ", ".join(f"{key} = {one['value']:g}" for key, one in entries))
    return f"{source} Numbers: {'; '.join(numbers)}."


def conformity_of(row: ConformityResult) -> str | None:
    """The verdict of a row as one of `CONFORMITIES`; None where it has no limit."""
    if row.verdict is None or row.limit is None:
        return None
    if row.verdict is Verdict.UNDECIDED:
        return "conditionalPass" if abs(row.value) <= row.limit else "conditionalFail"
    return "pass" if row.verdict is Verdict.CONFORM else "fail"


def _overall(verification: Verification) -> str:
    stated = [one for row in verification.rows_with_limit if (one := conformity_of(row)) is not None]
    return max(stated, key=CONFORMITIES.index)


def _result(row: ConformityResult) -> StatedResult:
    name = xml_text(row.name)
    if row.unit != "mm":  # a count
        return StatedResult(StatedQuantity(name, Decimal(int(row.value)), "1"), None, None)
    u = row.uncertainty
    limit = None if row.limit is None else StatedQuantity("limit of the magnitude", _exact(row.limit), "mm")
    value = _rounded(row.value, u)
    if u == 0:
        return StatedResult(StatedQuantity(name, value, "mm"), limit, conformity_of(row))
    factor, level = _to(row.budget.coverage_factor, 2), _to(COVERAGE_PROBABILITY, 4)
    quantity = StatedQuantity(name, value, "mm", _rounded(u, u), factor, level)
    return StatedResult(quantity, limit, conformity_of(row))


def _equipment(one: Artefact, verification: Verification) -> Equipment:
    kind, sizes = "seat", []
    if isinstance(one, CalibratedSphere):
        kind, sizes = "sphere", [("diameter at 20 degC", one.diameter_mm, one.u_diameter_mm)]
    elif isinstance(one, CalibratedBar):
        measured = verification.measured_lengths(one.name)
        kind = "bar"
        lengths = [length for length in one.lengths if length.name in measured]
        sizes = [(f"length {length.name} at 20 degC", length.length_mm, length.u_mm) for length in lengths]
    return Equipment(
        xml_text(f"{kind} {one.name}"),
        f"Calibrated on {one.date}, certificate valid until {one.expires}.",
        xml_text(one.certificate),
        tuple(StatedQuantity(xml_text(name), _rounded(v, u), "mm", standard=_rounded(u, u)) for name, v, u in sizes),
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
