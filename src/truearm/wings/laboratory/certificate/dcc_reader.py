"""The reader of digital calibration certificates of this program; and the names of the format.

It takes XML of others without harm: a document type is refused before anything is parsed, so that no entity can expand
or reach another file or the network, and the size is limited.
"""

from __future__ import annotations

import datetime
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.wings.laboratory.certificate.administrative_data import NOTES, AdministrativeData, xml_text
from truearm.wings.laboratory.certificate.calibration_certificate import (
    SPACES,
    CalibrationCertificate,
    calibration_certificate,
)
from truearm.wings.laboratory.certificate.certificate import (
    CONFORMITIES,
    SOFTWARE,
    Certificate,
    Equipment,
    Method,
    StatedList,
    StatedQuantity,
    StatedResult,
    are_traceable,
)
from truearm.wings.laboratory.certificate.consistency import check_consistency
from truearm.wings.laboratory.certificate.dsi_quantities import read_values
from truearm.wings.laboratory.certificate.statements import Statement
from truearm.wings.laboratory.signatures.pdf_attachments import attached_xml, is_pdf
from truearm.wings.laboratory.signatures.xml_references import BrokenSignature, UnverifiedSignature
from truearm.wings.laboratory.signatures.xml_signatures import BROKEN, GOOD, NOT_VERIFIABLE, Signature, verified_content

SCHEMA_VERSION = "3.3.0"
LANGUAGE = "en"  # of all texts
MAX_BYTES = 10_000_000
FARTHEST_EAST = datetime.timedelta(hours=14)  # of UTC: the latest day that it is anywhere

UNITS = {"mm": r"\milli\metre", "degC": r"\degreecelsius", "1": r"\one"}
# Reference types and names of the conditions.
# Free text: PTB's rules accept no version of installed software but a letter and numbers.
STYLUS, MOUNTING, ARM_SOFTWARE = "truearm_stylus", "truearm_mounting", "truearm_armSoftware"
AMBIENT, HUMIDITY, ARTEFACT = "basic_temperature", "basic_humidityRelative", "truearm_artefactTemperature"
CONDITIONS = {
    AMBIENT: "ambient temperature",
    HUMIDITY: "relative humidity",
    ARTEFACT: "artefact temperature, means of groups of points",
    STYLUS: "stylus",
    MOUNTING: "mounting of the arm",
    ARM_SOFTWARE: "software of the arm",
}
LIMIT = "truearm_limit"
CERTIFICATE, ISSUER, ACCREDITATION = "truearm_certificate", "truearm_issuingLaboratory", "truearm_issuerAccreditation"
SERIAL_NUMBER = "truearm_serialNumber"  # of an artefact
# What the laboratory states in its own words.
SITE, REPLACES, NOTE = "truearm_placeOfMeasurement", "truearm_reasonOfChange", "truearm_note_{}"
ADJUSTMENT, AS_FOUND = "truearm_adjustment", "truearm_asFound"
CONFORMITY = "basic_conformity"
NOT_DECIDED = "truearm_notDecided"  # a decision without a conformity: rated conditions not met or not stated
INDIVIDUAL, BUDGET = "truearm_individualResults", "truearm_uncertaintyBudget"
# Reference types of the statements, by kind.
STATEMENTS = {
    "reservation": "truearm_notForConformityDecisions",
    "decision": CONFORMITY,
    "decision rule": "truearm_decisionRule",
    "coordinates": "truearm_coordinates",
    "adjustment": "truearm_resultsAsLeft",
    "uncertainty": "truearm_uncertainty",
    "traceability": "truearm_traceability",
    "rated conditions": "truearm_ratedConditions",
    "limits of use": "truearm_limitsOfUse",
    "item": "truearm_onlyThisItem",
    "reproduction": "truearm_onlyInFull",
    "remark": "truearm_remark",
}

ADDRESS = (("street", "street"), ("street_no", "streetNo"), ("post_code", "postCode"), ("city", "city"))

Element = ET.Element


@dataclass(frozen=True)
class CertificateFile:
    """A certificate as it was read, of this program or of others; `signature` is None if the file is not signed."""

    certificate: Certificate | CalibrationCertificate
    signature: Signature | None
    from_pdf: bool = False


def read_dcc(path: str | Path) -> Certificate:
    """Read a certificate of this program, see `read_dcc_file`."""
    return _own(read_dcc_file(path).certificate)


def read_dcc_file(path: str | Path, *, trusted: str | Path | None = None) -> CertificateFile:
    """Read a certificate of this program, or of another laboratory, with its signature.

    Parameters
    ----------
    path : path
        The XML file, or a PDF file that it is attached to.
    trusted : path, optional
        Certificates (PEM) of the signer, or of the authority that issued the signer's; a file that is not signed by
        them is refused.

    Raises
    ------
    InputError
        If the file is missing, too long, not such a certificate, breaks a rule of its content, contradicts itself (see
        `check_consistency`), its signature is broken (`BrokenSignature`), or not verifiable here although there is a
        `trusted` (`UnverifiedSignature`).
    """
    with InputError.of_file(path):
        content = read_limited(path, limit_bytes=MAX_BYTES)
        from_pdf = is_pdf(content)
        if from_pdf:
            content = attached_xml(content, limit_bytes=MAX_BYTES)
        return replace(parse_dcc_file(content, trusted=trusted), from_pdf=from_pdf)


def parse_dcc(content: bytes) -> Certificate:
    """Read the content of a certificate as it stands, whatever its numbers say; see `read_dcc_file`."""
    return _own(_certificate_of(verified_content(content)[0]))


def parse_dcc_file(content: bytes, *, trusted: str | Path | None = None) -> CertificateFile:
    """Read the content of a certificate and its signature, see `read_dcc_file`."""
    signed, signature = verified_content(content, trusted=trusted)
    try:
        certificate = _certificate_of(signed)  # only what the signature signs
        if isinstance(certificate, Certificate):
            check_consistency(certificate)
    except InputError as error:
        if signature is None:
            raise
        raise InputError(f"{error.problem}. {signature.describe()}".removesuffix("."), hint=error.hint) from None
    _check_signed_after(signature, certificate)
    day = certificate.issued or certificate.end  # the day of issue is optional in a DCC
    if signature is not None and signature.answer == GOOD and not signature.covers(day):
        stated = f"was issued on {day}" if day is not None else "states neither a day of issue nor of measurement"
        problem = f"the certificate {stated}; {signature.describe_periods(day)}"
        if trusted is not None:
            hint = "ask the laboratory for a certificate with a valid signature"
            raise UnverifiedSignature(f"the signature is {NOT_VERIFIABLE}: {problem}", hint=hint)
        signature = Signature(NOT_VERIFIABLE, problem)
    return CertificateFile(certificate, signature)


def _check_signed_after(signature: Signature | None, certificate: Certificate | CalibrationCertificate) -> None:
    """Nobody signs what is not yet measured, nor tomorrow: such a time was set, to when the key is valid."""
    if signature is None or signature.signed_at is None:
        return
    if signature.signed_at > datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=1):  # clocks differ by less
        raise BrokenSignature(
            f"the signature is {BROKEN}: by its own time it was made on {signature.signed_at:%Y-%m-%d}, in the future",
            hint="do not use this file, ask its issuer for the original; or set the clock of this computer",
        )
    signed = (signature.signed_at + FARTHEST_EAST).astimezone(datetime.UTC).date()
    for what, day in (("measured", certificate.end), ("issued", certificate.issued)):
        if day is not None and signed < day:
            raise BrokenSignature(
                f"the signature is {BROKEN}: by its own time it was made on {signature.signed_at:%Y-%m-%d}, before "
                f"what it signs was {what} on {day}",
                hint="do not use this file, ask its issuer for the original",
            )


def _own(certificate: Certificate | CalibrationCertificate) -> Certificate:
    if isinstance(certificate, CalibrationCertificate):
        raise InputError(f"expected a certificate of {SOFTWARE}, got one of {certificate.laboratory}")
    return certificate


def _certificate_of(content: bytes) -> Certificate | CalibrationCertificate:
    root = ET.fromstring(content.decode("utf-8-sig"))  # noqa: S314, it was parsed before: it has no document type
    names = _all(root, "administrativeData/dccSoftware/software/name/content", some=False)
    if SOFTWARE not in map(_text, names):
        return calibration_certificate(root)
    if root.tag != f"{{{SPACES['dcc']}}}digitalCalibrationCertificate":
        raise InputError(f"expected a digital calibration certificate, got <{root.tag:.80}>")
    if (version := root.get("schemaVersion")) != SCHEMA_VERSION:
        raise InputError(f"expected schema version {SCHEMA_VERSION}, got {version!r:.80}")
    administrative = _one(root, "administrativeData")
    measured = _one(root, "measurementResults/measurementResult")
    core = _one(administrative, "coreData")
    software = _one(administrative, "dccSoftware/software")
    results = _all(measured, "results/result")
    return Certificate(
        about=_about(administrative, core, measured),
        begin=_date(_one(core, "beginPerformanceDate")),
        end=_date(_one(core, "endPerformanceDate")),
        software=_content(software, "name"),
        release=_text(_one(software, "release")).removeprefix("v"),
        title=_content(measured, "name"),
        statements=_statements_of(administrative),
        conformity=_overall_of(root, administrative),
        methods=tuple(
            Method(_content(one, "name"), _content(one, "description"), _maybe(one, "norm"))
            for one in _all(measured, "usedMethods/usedMethod")
        ),
        equipment=_equipment_of(administrative, measured),
        artefact_degC=_condition_of(measured, ARTEFACT),
        results=tuple(_result_of(one) for one in results if one.get("refType") not in (INDIVIDUAL, BUDGET, AS_FOUND)),
        as_found=tuple(_result_of(one) for one in results if one.get("refType") == AS_FOUND),
        individual=tuple(_list_of(one) for one in results if one.get("refType") == INDIVIDUAL),
        budgets=tuple(_list_of(one) for one in results if one.get("refType") == BUDGET),
    )


def _equipment_of(administrative: Element, measured: Element) -> tuple[Equipment, ...]:
    """The artefacts, of which the certificate states traceability only if they show it."""
    number = "identifications/identification[@refType='{}']/value"
    found = tuple(
        Equipment(
            _content(one, "name"),
            _content(one, "description"),
            _text(_one(one, number.format(CERTIFICATE))),
            tuple(map(_quantity_of, _all(one, "measuringEquipmentQuantities/measuringEquipmentQuantity", some=False))),
            _text(_one(one, number.format(ISSUER))),
            _maybe(one, number.format(ACCREDITATION)),
            _maybe(one, number.format(SERIAL_NUMBER)),
        )
        for one in _all(measured, "measuringEquipments/measuringEquipment")
    )
    shown = "true" if are_traceable(found) else "false"
    for one in _all(administrative, "statements/statement/traceable", some=False):
        if _text(one) != shown:
            raise InputError(f"by its artefacts <traceable> is {shown}; the certificate states {_text(one)!r:.80}")
    return found


def _about(administrative: Element, core: Element, measured: Element) -> AdministrativeData:
    item = _one(administrative, "items/item")
    numbers = {
        _text(_one(one, "issuer")): _text(_one(one, "value")) for one in _all(item, "identifications/identification")
    }
    laboratory = _one(administrative, "calibrationLaboratory")
    received = core.find("dcc:receiptDate", SPACES)
    degC, humidity = _condition_of(measured, AMBIENT), _condition_of(measured, HUMIDITY)
    fields: dict[str, Any] = {
        "number": _text(_one(core, "uniqueIdentifier")),
        "issued": _date(_one(core, "issueDate")),
        "received": None if received is None else _date(received),
        "place": _text(_one(core, "performanceLocation")),
        "site": _site_of(administrative),
        "replaces": _replaced_of(core, administrative),
        "item": {
            "name": _content(item, "name"),
            "maker": _content(_one(item, "manufacturer"), "name"),
            "model": _text(_one(item, "model")),
            "serial_number": numbers.get("manufacturer", ""),
            "inventory_number": numbers.get("customer"),
            "condition": _maybe(item, "description/content"),
        },
        "laboratory": _contact_of(_one(laboratory, "contact"))
        | {"code": _maybe(laboratory, "calibrationLaboratoryCode")},
        "customer": _contact_of(_one(administrative, "customer")),
        "persons": [
            {
                "name": _content(_one(one, "person"), "name"),
                "role": _maybe(one, "role"),
                "main_signer": _text(_one(one, "mainSigner")) == "true",
            }
            for one in _all(administrative, "respPersons/respPerson")
        ],
        "conditions": {
            "temperature_degC": () if degC is None else tuple(map(float, degC)),
            "relative_humidity_percent": None if humidity is None else tuple(float(100 * share) for share in humidity),
        },
        "set_up": _set_up_of(measured),
        "adjustment": _adjustment_of(measured),
        "notes": {key: _own_words(administrative, NOTE.format(key)) for key in NOTES},
    }
    if (country := _text(_one(core, "countryCodeISO3166_1"))) != fields["laboratory"]["country"]:
        raise InputError(
            f"issued in the country {country!r:.80}, by a laboratory of {fields['laboratory']['country']!r:.80}"
        )
    try:
        return AdministrativeData.model_validate(fields)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"{where}: {first['msg'].removeprefix('Value error, ')}") from None


def _contact_of(element: Element) -> dict[str, str | None]:
    known = {"name": _content(element, "name"), "email": _maybe(element, "eMail"), "phone": _maybe(element, "phone")}
    return known | _address_of(element)


def _address_of(element: Element) -> dict[str, str | None]:
    location = _one(element, "location")
    address = {key: _maybe(location, tag) for key, tag in ADDRESS}
    needed = {key: address[key] or "" for key in ("post_code", "city")}
    return address | needed | {"country": _text(_one(location, "countryCode"))}


def _own_words(administrative: Element, kind: str) -> str | None:
    return _maybe(administrative, f"statements/statement[@refType='{kind}']/declaration/content")


def _site_of(administrative: Element) -> dict[str, str | None] | None:
    name = _own_words(administrative, SITE)
    if name is None:
        return None
    return {"name": name} | _address_of(_one(administrative, f"statements/statement[@refType='{SITE}']"))


def _replaced_of(core: Element, administrative: Element) -> dict[str, str] | None:
    number = _maybe(core, "reportAmendedSubstituted/replacedUniqueIdentifier")
    if number is None:
        return None
    change = _text(_one(core, "reportAmendedSubstituted/typeOfChange"))
    return {"number": number, "change": change, "reason": _own_words(administrative, REPLACES) or ""}


def _adjustment_of(measured: Element) -> dict[str, str] | None:
    found = _all(measured, f"influenceConditions/influenceCondition[@refType='{ADJUSTMENT}']", some=False)
    return {"kind": _content(found[0], "name"), "work": _content(found[0], "data/text")} if found else None


def _condition_of(measured: Element, kind: str) -> tuple[Decimal, Decimal] | None:
    found = _all(measured, f"influenceConditions/influenceCondition[@refType='{kind}']", some=False)
    if not found:
        return None
    unit = "1" if kind == HUMIDITY else "degC"
    ends = [_quantity_of(_one(found[0], f"data/quantity[@refType='{kind}{end}']")) for end in ("Min", "Max")]
    if any(end.unit != unit for end in ends):
        raise InputError(f"{CONDITIONS[kind]}: expected the unit {UNITS[unit]}")
    return ends[0].value, ends[1].value


def _set_up_of(measured: Element) -> dict[str, str]:
    """Stylus, mounting and software of the arm."""
    path = "influenceConditions/influenceCondition[@refType='{}']/data/text/content"
    kinds = {"stylus": STYLUS, "mounting": MOUNTING, "software": ARM_SOFTWARE}
    return {key: _text(_one(measured, path.format(kind))) for key, kind in kinds.items()}


def _statements_of(administrative: Element) -> tuple[Statement, ...]:
    """The statements but those of `AdministrativeData`; those of unknown kind are remarks."""
    own = {SITE, REPLACES, *(NOTE.format(key) for key in NOTES)}
    kinds = {kind: name for name, kind in STATEMENTS.items()} | {NOT_DECIDED: "decision"}
    return tuple(
        Statement(kinds.get(one.get("refType", ""), "remark"), _content(one, "declaration"))
        for one in _all(administrative, "statements/statement")
        if one.get("refType") not in own
    )


def _overall_of(root: Element, administrative: Element) -> str | None:
    """The conformity of the decision; None where that states none, or the certificate is not for such decisions."""
    path = "statements/statement[@refType='{}']"
    if _all(administrative, path.format(STATEMENTS["reservation"]), some=False):
        if any(True for _ in root.iter(f"{{{SPACES['dcc']}}}conformity")):
            raise InputError("the certificate is not for conformity decisions, but states a conformity")
        return None
    if not _all(administrative, path.format(NOT_DECIDED), some=False):
        return _conformity(_one(administrative, path.format(CONFORMITY)))
    if _all(administrative, path.format(CONFORMITY), some=False):
        raise InputError("the certificate states a decision, and that there is none")
    return None


def _result_of(element: Element) -> StatedResult:
    quantity = _one(element, "data/quantity")
    if (name := _content(element, "name")) != (own := _content(quantity, "name")):
        raise InputError(f"a result is named {name!r:.80}, and its value {own!r:.80}")
    if not _all(quantity, "measurementMetaData", some=False):
        return StatedResult(_quantity_of(quantity), None, None)
    statement = _one(quantity, "measurementMetaData/metaData")
    limit = _quantity_of(_one(statement, "data/quantity"))
    stated = _all(statement, "conformity", some=False)
    return StatedResult(_quantity_of(quantity), limit, _conformity(statement) if stated else None)


def _list_of(element: Element) -> StatedList:
    return StatedList(_content(element, "name"), tuple(map(_quantity_of, _all(element, "data/list/quantity"))))


def _quantity_of(element: Element) -> StatedQuantity:
    values = read_values(element)
    if len(values) != 1:
        raise InputError(f"<{_name(element)}>: expected one value, an si:real, got {len(values)}")
    (one,) = values
    units = {unit: name for name, unit in UNITS.items()}
    if one.unit not in units:
        raise InputError(f"expected a unit of {', '.join(units)}, got {one.unit!r:.80}")
    uncertainty = (one.expanded, one.factor, one.probability)
    if None in uncertainty and any(part is not None for part in uncertainty):
        raise InputError(f"<{_name(element)}>: expected an expanded uncertainty with its factor and probability")
    return StatedQuantity(_content(element, "name"), one.value, units[one.unit], *uncertainty, one.standard)


def _conformity(element: Element) -> str:
    stated = _text(_one(element, "conformity"))
    if stated not in CONFORMITIES:
        raise InputError(f"expected a conformity of {', '.join(CONFORMITIES)}, got {stated!r:.80}")
    return stated


def _date(element: Element) -> datetime.date:
    try:
        return datetime.date.fromisoformat(_text(element))
    except ValueError:
        raise InputError(f"<{_name(element)}>: expected a date, got {_text(element)[:80]!r}") from None


def _all(element: Element, path: str, *, some: bool = True) -> Sequence[Element]:
    tags = [part if ":" in part.partition("[")[0] else f"dcc:{part}" for part in path.split("/")]
    found = element.findall("/".join(tags), SPACES)
    if some and not found:
        raise InputError(f"<{_name(element)}> has no {path}")
    return found


def _one(element: Element, path: str) -> Element:
    found = _all(element, path)
    if len(found) > 1:
        raise InputError(f"<{_name(element)}>: expected one {path}, got {len(found)}")
    return found[0]


def _maybe(element: Element, path: str) -> str | None:
    found = _all(element, path, some=False)
    return _text(found[0]) if found else None


def _content(element: Element, path: str) -> str:
    return _text(_one(element, f"{path}/content"))


def _text(element: Element) -> str:
    return xml_text(element.text or "")  # in one line, as the writer has it


def _name(element: Element) -> str:
    return element.tag.rpartition("}")[2]
