"""What a calibration certificate of a verification states, apart from the form in which it is written."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from truearm import __version__
from truearm.errors import InputError
from truearm.verification.certificate.administrative_data import AdministrativeData, Contact, Person, xml_text
from truearm.verification.standards.artefacts import Artefact, CalibratedBar, CalibratedSphere
from truearm.verification.standards.decision import COVERAGE_PROBABILITY, ConformityResult, Verdict
from truearm.verification.standards.verification_plan import PLANS, load_verification_plan
from truearm.verification.standards.verification_record import VerificationRecord

SOFTWARE = "truearm"
# By the non-binary rule with guard bands of ILAC-G8:09/2019 [recalled, not confirmed]: undecided values within their
# limit pass on a condition, those beyond it fail on one.
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
    """All that is stated.

    Parameters
    ----------
    about : AdministrativeData
    begin, end : date
        First and last day of the measurement.
    software, release : str
        What evaluated it.
    title : str
        Of the measurement.
    declarations : tuple of str
        The decision in words, the rule, and remarks.
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


def make_certificate(
    about: AdministrativeData, outcome: VerificationRecord, *, decision: Sequence[str], rule: str
) -> Certificate:
    """State a verification.

    Parameters
    ----------
    about : AdministrativeData
    outcome : VerificationRecord
    decision : sequence of str
        The decision in words, a paragraph each.
    rule : str
        The decision rule in words.

    Raises
    ------
    InputError
        If days or temperatures of `about` do not fit those of the points, or as `check_uncertainties`.
    """
    check_uncertainties(outcome)
    days = [group.date for group in outcome.groups]
    about.check_days(min(days), max(days))
    degC = outcome.temperatures
    if degC is not None:
        about.check_room(*degC)
    methods = [
        Method(
            "Expanded uncertainty",
            "Of the test value: from artefact and set-up, not of the arm, whose errors are what is tested. Standard "
            "uncertainty times the coverage factor k of Student's t for the effective degrees of freedom.",
            "JCGM 100:2008",
        ),
        Method(xml_text(outcome.plan.title), xml_text(_plan_in_words(outcome)), xml_text(outcome.plan.standard)),
        Method("Decision rule", xml_text(rule), "ISO 14253-1:2013" if outcome.rule == "iso14253-1" else None),
    ]
    return Certificate(
        about=about,
        begin=min(days),
        end=max(days),
        software=SOFTWARE,
        release=__version__,
        title=xml_text(f"Verification: {outcome.specification.name}"),
        declarations=tuple(xml_text(text) for text in (*decision, *outcome.verification.remarks)),
        conformity=_overall(outcome),
        methods=tuple(methods),
        equipment=tuple(_equipment(one, outcome) for one in outcome.used_artefacts),
        artefact_degC=None if degC is None else (_to(degC[0], 2), _to(degC[1], 2)),
        results=tuple(_result(row) for row in outcome.verification.rows),
    )


def check_uncertainties(outcome: VerificationRecord) -> None:
    """Check that every value that is compared with a limit has an uncertainty: a calibration states one.

    Raises
    ------
    InputError
        If form and set-up of an artefact are said to be without any.
    """
    for row in outcome.rows_with_limit:
        if row.uncertainty == 0:
            raise InputError(
                f"{_name(row):.200}: its expanded uncertainty is 0, and a certificate states no value without one",
                hint="form_mm and u_fixture_mm of the artefact as its certificate and your set-up have them",
            )


def _plan_in_words(outcome: VerificationRecord) -> str:
    """Whose test plan it is and what it asks for."""
    plan = outcome.plan
    if plan.name in PLANS and plan == load_verification_plan(plan.name):
        whose = f"Test plan {plan.name} as it comes with {SOFTWARE} {__version__}."
    else:
        known = "" if outcome.plan_sha256 is None else f", SHA-256 {outcome.plan_sha256}"
        whose = f"Test plan of the user's own, named {plan.name}{known}."
    asked = []
    for name, test in plan.tests.items():
        told = test.model_dump().items()
        asked.append(f"{name}: " + ", ".join(f"{key} = {one['value']:g}" for key, one in told if isinstance(one, dict)))
    return f"{whose} It asks for {'; '.join(asked)}."


def administrative_sections(certificate: Certificate) -> tuple[tuple[str, tuple[tuple[str, str], ...]], ...]:
    """Give what is stated beside the results as titled lists of (what, text), for people."""
    about, conditions = certificate.about, certificate.about.conditions
    days = [str(day) for day in dict.fromkeys((certificate.begin, certificate.end))]
    degC, humidity = conditions.temperature_degC, conditions.relative_humidity_percent
    item, laboratory = about.item, about.laboratory
    listed: tuple[tuple[str, list[tuple[str, str | None]]], ...] = (
        (
            "certificate",
            [
                ("number", about.number),
                ("arm received", None if about.received is None else str(about.received)),
                ("measured", " to ".join(days)),
                ("issued", str(about.issued)),
                ("place", _PLACES[about.place]),
            ],
        ),
        (
            "arm",
            [
                ("name", item.name),
                ("maker", item.maker),
                ("model", item.model),
                ("serial number", item.serial_number),
                ("inventory number", item.inventory_number),
            ],
        ),
        ("laboratory", [*_address(laboratory), ("accreditation", laboratory.code)]),
        ("customer", _address(about.customer)),
        ("responsible", [(one.name, _role(one)) for one in about.persons]),
        (
            "room",
            [
                ("temperature", f"{degC[0]:g} to {degC[1]:g} °C"),
                ("relative humidity", None if humidity is None else f"{humidity[0]:g} to {humidity[1]:g} %"),
            ],
        ),
    )
    return tuple((title, tuple((what, text) for what, text in rows if text is not None)) for title, rows in listed)


_PLACES = {
    "laboratory": "at the laboratory",
    "laboratoryBranch": "at a branch of the laboratory",
    "customer": "at the customer",
    "customerBranch": "at a branch of the customer",
    "other": "elsewhere",
}


def _address(contact: Contact) -> list[tuple[str, str | None]]:
    street = " ".join(part for part in (contact.street, contact.street_no) if part) or None
    place = f"{contact.post_code} {contact.city}, {contact.country}"
    return [
        ("name", contact.name),
        ("street", street),
        ("place", place),
        ("email", contact.email),
        ("phone", contact.phone),
    ]


def _role(person: Person) -> str:
    return ", ".join(part for part in (person.role, "signs the certificate" if person.main_signer else None) if part)


def conformity_of(row: ConformityResult) -> str | None:
    """The verdict of a row as one of `CONFORMITIES`; None where it has no limit."""
    if row.verdict is None or row.limit is None:
        return None
    if row.verdict is Verdict.UNDECIDED:
        return "conditionalPass" if abs(row.value) <= row.limit else "conditionalFail"
    return "pass" if row.verdict is Verdict.CONFORM else "fail"


def _overall(outcome: VerificationRecord) -> str:
    found = [said for row in outcome.rows_with_limit if (said := conformity_of(row)) is not None]
    return max(found, key=CONFORMITIES.index)


def _result(row: ConformityResult) -> StatedResult:
    name = _name(row)
    if row.unit != "mm":  # a count
        return StatedResult(StatedQuantity(name, Decimal(int(row.value)), "1"), None, None)
    u = row.uncertainty
    limit = None if row.limit is None else StatedQuantity("limit of the magnitude", _in_full(row.limit), "mm")
    value = _rounded(row.value, u)
    if u == 0:
        return StatedResult(StatedQuantity(name, value, "mm"), limit, conformity_of(row))
    factor, level = _to(row.budget.coverage_factor, 2), _to(COVERAGE_PROBABILITY, 4)
    quantity = StatedQuantity(name, value, "mm", _rounded(u, u), factor, level)
    return StatedResult(quantity, limit, conformity_of(row))


def _name(row: ConformityResult) -> str:
    return xml_text(f"{row.label}, {row.where}" if row.where else row.label)


def _equipment(one: Artefact, outcome: VerificationRecord) -> Equipment:
    kind, sizes = "seat", []
    if isinstance(one, CalibratedSphere):
        kind, sizes = "sphere", [("diameter at 20 degC", one.diameter_mm, one.u_diameter_mm)]
    elif isinstance(one, CalibratedBar):
        taken = outcome.lengths_of(one.name)
        kind = "bar"
        lengths = [length for length in one.lengths if length.name in taken]
        sizes = [(f"length {length.name} at 20 degC", length.length_mm, length.u_mm) for length in lengths]
    return Equipment(
        xml_text(f"{kind} {one.name}"),
        f"Calibrated on {one.date}, certificate serves until {one.expires}.",
        xml_text(one.certificate),
        tuple(StatedQuantity(xml_text(name), _rounded(v, u), "mm", standard=_rounded(u, u)) for name, v, u in sizes),
    )


def _in_full(limit: float) -> Decimal:
    """A limit is exact; twelve digits leave out what its arithmetic rounded."""
    return Decimal(f"{limit:.12g}")


def _rounded(value: float, u: float) -> Decimal:
    """To the decimal of the second significant digit of an uncertainty (GUM 7.2.6); to 0.1 um where that is 0."""
    return _to(value, 4) if u == 0 else _to(value, 1 - int(f"{u:.1e}".partition("e")[2]))


def _to(value: float, decimals: int) -> Decimal:
    rounded = Decimal(f"{round(value, decimals):.{max(decimals, 0)}f}")
    if not rounded.is_finite():
        raise InputError(f"expected a finite number to state, got {value}")
    return abs(rounded) if rounded == 0 else rounded  # no -0.0000
