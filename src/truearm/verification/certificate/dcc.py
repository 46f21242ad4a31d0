r"""Digital calibration certificates: PTB's DCC, schema 3.3.0, with quantities of the D-SI, schema 2.2.1.

Elements, their order and the values of enumerations are those of the two schemas (dcc.xsd and SI_Format.xsd,
Physikalisch-Technische Bundesanstalt); the tests hold certificates against them and against PTB's Schematron rules.
Units are written in the D-SI's form, ``\milli\metre``. Reference types of PTB (``basic_..``) are those of its examples;
``truearm_..`` are our own.

The reader is for certificates of this writer. It takes XML from others without harm: a document type is refused before
anything is parsed, so that no entity can expand or reach another file or the network, and the size is bounded.
"""

from __future__ import annotations

import datetime
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.verification.certificate.administrative_data import AdministrativeData, Contact
from truearm.verification.certificate.certificate import (
    CONFORMITIES,
    Certificate,
    Equipment,
    Method,
    StatedQuantity,
    StatedResult,
)

SCHEMA_VERSION = "3.3.0"
LANGUAGE = "en"  # of every word of this program
MAX_BYTES = 10_000_000

_SPACES = {
    "dcc": "https://ptb.de/dcc",
    "si": "https://ptb.de/si",
    "xsi": "http://www.w3.org/2001/XMLSchema-instance",
}
_UNITS = {"mm": r"\milli\metre", "degC": r"\degreecelsius", "1": r"\one"}
# Name and reference type of each condition that may be stated.
_AMBIENT, _HUMIDITY, _ARTEFACT = "basic_temperature", "basic_humidityRelative", "truearm_artefactTemperature"
_CONDITIONS = {
    _AMBIENT: "ambient temperature",
    _HUMIDITY: "relative humidity",
    _ARTEFACT: "artefact temperature, means of groups of points",
}
_LIMIT = "truearm_limit"

Element = ET.Element


def write_dcc(certificate: Certificate, path: str | Path) -> None:
    """Write a certificate, whole or not at all; it is read back and compared before it stands.

    Raises
    ------
    InputError
        If the folder does not exist or is not writable.
    """
    content = dcc(certificate)
    if parse_dcc(content) != certificate:
        raise TruearmError(f"{path}: the certificate that was written is not the one that is read: please report it")
    with atomic_file(path) as beside:
        beside.write_bytes(content)


def read_dcc(path: str | Path) -> Certificate:
    """Read a certificate of this program.

    Raises
    ------
    InputError
        If the file is missing, too long, not such a certificate, or breaks a rule of its content.
    """
    try:
        return parse_dcc(read_limited(path, limit_bytes=MAX_BYTES))
    except InputError as error:
        raise error.in_file(path) from None


# Writing -------------------------------------------------------------------------------------------------------------


def dcc(certificate: Certificate) -> bytes:
    """Give a certificate as XML; the same certificate gives the same bytes."""
    root = Element("dcc:digitalCalibrationCertificate")
    for prefix, space in _SPACES.items():
        root.set(f"xmlns:{prefix}", space)
    root.set("xsi:schemaLocation", f"{_SPACES['dcc']} {_SPACES['dcc']}/v{SCHEMA_VERSION}/dcc.xsd")
    root.set("schemaVersion", SCHEMA_VERSION)
    _administrative(_in(root, "administrativeData"), certificate)
    _measured(_in(_in(root, "measurementResults"), "measurementResult"), certificate)
    ET.indent(root)
    content: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


def _administrative(parent: Element, certificate: Certificate) -> None:
    about = certificate.about
    _software(_in(parent, "dccSoftware"), certificate)
    core = _in(parent, "coreData")
    _in(core, "countryCodeISO3166_1", about.laboratory.country)
    _in(core, "usedLangCodeISO639_1", LANGUAGE)
    _in(core, "mandatoryLangCodeISO639_1", LANGUAGE)
    _in(core, "uniqueIdentifier", about.number)
    if about.received is not None:
        _in(core, "receiptDate", about.received.isoformat())
    _in(core, "beginPerformanceDate", certificate.begin.isoformat())
    _in(core, "endPerformanceDate", certificate.end.isoformat())
    _in(core, "performanceLocation", about.place)
    _in(core, "issueDate", about.issued.isoformat())
    item = _in(_in(parent, "items"), "item")
    _text(item, "name", about.item.name)
    _text(_in(item, "manufacturer"), "name", about.item.maker)
    _in(item, "model", about.item.model)
    known = _in(item, "identifications")
    _identification(known, "manufacturer", about.item.serial_number, "serial number")
    if about.item.inventory_number is not None:
        _identification(known, "customer", about.item.inventory_number, "inventory number")
    laboratory = _in(parent, "calibrationLaboratory")
    if about.laboratory.code is not None:
        _in(laboratory, "calibrationLaboratoryCode", about.laboratory.code)
    _contact(_in(laboratory, "contact"), about.laboratory)
    persons = _in(parent, "respPersons")
    for person in about.persons:
        one = _in(persons, "respPerson")
        _text(_in(one, "person"), "name", person.name)
        if person.role is not None:
            _in(one, "role", person.role)
        _in(one, "mainSigner", "true" if person.main_signer else "false")
    _contact(_in(parent, "customer"), about.customer)
    statements = _in(parent, "statements")
    for number, declaration in enumerate(certificate.declarations):
        statement = _in(statements, "statement", **({} if number else {"refType": "basic_conformity"}))
        _text(statement, "declaration", declaration)
        if number == 0:
            _in(statement, "conformity", certificate.conformity)


def _measured(parent: Element, certificate: Certificate) -> None:
    _text(parent, "name", certificate.title)
    methods = _in(parent, "usedMethods")
    for number, method in enumerate(certificate.methods):
        one = _in(methods, "usedMethod", **({} if number else {"refType": "basic_uncertainty"}))
        _text(one, "name", method.name)
        _text(one, "description", method.description)
        if method.norm is not None:
            _in(one, "norm", method.norm)
    _software(_in(parent, "usedSoftware"), certificate)
    equipments = _in(parent, "measuringEquipments")
    for equipment in certificate.equipment:
        one = _in(equipments, "measuringEquipment", refType="basic_normalUsed")
        _text(one, "name", equipment.name)
        _text(one, "description", equipment.description)
        _identification(_in(one, "identifications"), "other", equipment.certificate, "certificate")
        if equipment.quantities:
            sizes = _in(one, "measuringEquipmentQuantities")
            for quantity in equipment.quantities:
                _quantity(_in(sizes, "measuringEquipmentQuantity"), quantity)
    conditions, about = _in(parent, "influenceConditions"), certificate.about.conditions
    low, high = about.temperature_degC
    _condition(conditions, _AMBIENT, _decimal(low), _decimal(high), "degC")
    if about.relative_humidity_percent is not None:
        low, high = about.relative_humidity_percent
        _condition(conditions, _HUMIDITY, _decimal(low) / 100, _decimal(high) / 100, "1")
    if certificate.artefact_degC is not None:
        _condition(conditions, _ARTEFACT, *certificate.artefact_degC, "degC")
    results = _in(parent, "results")
    for result in certificate.results:
        one = _in(results, "result")
        _text(one, "name", result.quantity.name)
        value = _in(_in(one, "data"), "quantity", refType="basic_measuredValue")
        _quantity(value, result.quantity)
        if result.limit is not None and result.conformity is not None:
            said = _in(_in(value, "measurementMetaData"), "metaData", refType="basic_conformity")
            _in(said, "conformity", result.conformity)
            _quantity(_in(_in(said, "data"), "quantity", refType=_LIMIT), result.limit)


def _in(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    made = ET.SubElement(parent, tag if ":" in tag else f"dcc:{tag}", attributes)
    made.text = text
    return made


def _text(parent: Element, tag: str, text: str) -> None:
    """A text in the certificate's language."""
    _in(_in(parent, tag), "content", text, lang=LANGUAGE)


def _software(parent: Element, certificate: Certificate) -> None:
    one = _in(parent, "software")
    _text(one, "name", certificate.software)
    _in(one, "release", f"v{certificate.release}")
    _in(one, "type", "application")


def _identification(parent: Element, issuer: str, value: str, name: str) -> None:
    one = _in(parent, "identification")
    _in(one, "issuer", issuer)
    _in(one, "value", value)
    _text(one, "name", name)


_ADDRESS = (("street", "street"), ("street_no", "streetNo"), ("post_code", "postCode"), ("city", "city"))


def _contact(parent: Element, contact: Contact) -> None:
    _text(parent, "name", contact.name)
    if contact.email is not None:
        _in(parent, "eMail", contact.email)
    if contact.phone is not None:
        _in(parent, "phone", contact.phone)
    location = _in(parent, "location")
    for key, tag in (*_ADDRESS, ("country", "countryCode")):
        value = getattr(contact, key)
        if value is not None:
            _in(location, tag, value)


def _condition(parent: Element, kind: str, low: Decimal, high: Decimal, unit: str) -> None:
    one = _in(parent, "influenceCondition", refType=kind)
    _text(one, "name", _CONDITIONS[kind])
    data = _in(one, "data")
    for end, value in (("Min", low), ("Max", high)):
        name = "lowest" if end == "Min" else "highest"
        _quantity(_in(data, "quantity", refType=f"{kind}{end}"), StatedQuantity(name, value, unit))


def _quantity(parent: Element, quantity: StatedQuantity) -> None:
    _text(parent, "name", quantity.name)
    real = _in(parent, "si:real")
    _in(real, "si:value", f"{quantity.value:f}")
    _in(real, "si:unit", _UNITS[quantity.unit])
    if quantity.expanded is not None and quantity.factor is not None and quantity.level is not None:
        expanded = _in(_in(real, "si:measurementUncertaintyUnivariate"), "si:expandedMU")
        _in(expanded, "si:valueExpandedMU", f"{quantity.expanded:f}")
        _in(expanded, "si:coverageFactor", f"{quantity.factor:f}")
        _in(expanded, "si:coverageProbability", f"{quantity.level:f}")
    elif quantity.standard is not None:
        standard = _in(_in(real, "si:measurementUncertaintyUnivariate"), "si:standardMU")
        _in(standard, "si:valueStandardMU", f"{quantity.standard:f}")


def _decimal(value: float) -> Decimal:
    return Decimal(repr(value))


# Reading -------------------------------------------------------------------------------------------------------------


def parse_dcc(content: bytes) -> Certificate:
    """Read the content of a certificate, see `read_dcc`."""
    root = _parsed(content)
    if root.tag != f"{{{_SPACES['dcc']}}}digitalCalibrationCertificate":
        raise InputError(f"expected a digital calibration certificate, got <{root.tag:.80}>")
    if (version := root.get("schemaVersion")) != SCHEMA_VERSION:
        raise InputError(f"expected schema version {SCHEMA_VERSION}, got {version!r:.80}")
    administrative = _one(root, "administrativeData")
    measured = _one(root, "measurementResults/measurementResult")
    core = _one(administrative, "coreData")
    software = _one(administrative, "dccSoftware/software")
    statements = _all(administrative, "statements/statement")
    return Certificate(
        about=_about(administrative, core, measured),
        begin=_date(_one(core, "beginPerformanceDate")),
        end=_date(_one(core, "endPerformanceDate")),
        software=_content(software, "name"),
        release=_words(_one(software, "release")).removeprefix("v"),
        title=_content(measured, "name"),
        declarations=tuple(_content(statement, "declaration") for statement in statements),
        conformity=_conformity(_one(administrative, "statements/statement[@refType='basic_conformity']")),
        methods=tuple(
            Method(_content(one, "name"), _content(one, "description"), _maybe(one, "norm"))
            for one in _all(measured, "usedMethods/usedMethod")
        ),
        equipment=tuple(
            Equipment(
                _content(one, "name"),
                _content(one, "description"),
                _words(_one(one, "identifications/identification/value")),
                tuple(
                    _quantity_of(size)
                    for size in one.findall("dcc:measuringEquipmentQuantities/dcc:measuringEquipmentQuantity", _SPACES)
                ),
            )
            for one in _all(measured, "measuringEquipments/measuringEquipment")
        ),
        artefact_degC=_condition_of(measured, _ARTEFACT),
        results=tuple(_result_of(one) for one in _all(measured, "results/result")),
    )


def _parsed(content: bytes) -> Element:
    """Parse UTF-8 XML without a document type."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("expected UTF-8 text") from None
    # Decoded first, so that no other encoding can hide it; a text that only mentions it is refused too.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("a certificate needs no DOCTYPE or ENTITY, and none is read here")
    try:
        return ET.fromstring(text)  # noqa: S314, it has no document type
    except ET.ParseError as error:
        raise InputError(f"not valid XML: {error}", line=error.position[0]) from None
    except ValueError as error:  # a NUL, half a surrogate pair
        raise InputError(f"not valid XML: {error}") from None


def _about(administrative: Element, core: Element, measured: Element) -> AdministrativeData:
    item = _one(administrative, "items/item")
    numbers = {
        _words(_one(one, "issuer")): _words(_one(one, "value")) for one in _all(item, "identifications/identification")
    }
    laboratory = _one(administrative, "calibrationLaboratory")
    received = core.find("dcc:receiptDate", _SPACES)
    degC, humidity = _condition_of(measured, _AMBIENT), _condition_of(measured, _HUMIDITY)
    told: dict[str, Any] = {
        "number": _words(_one(core, "uniqueIdentifier")),
        "issued": _date(_one(core, "issueDate")),
        "received": None if received is None else _date(received),
        "place": _words(_one(core, "performanceLocation")),
        "item": {
            "name": _content(item, "name"),
            "maker": _content(_one(item, "manufacturer"), "name"),
            "model": _words(_one(item, "model")),
            "serial_number": numbers.get("manufacturer", ""),
            "inventory_number": numbers.get("customer"),
        },
        "laboratory": _contact_of(_one(laboratory, "contact"))
        | {"code": _maybe(laboratory, "calibrationLaboratoryCode")},
        "customer": _contact_of(_one(administrative, "customer")),
        "persons": [
            {
                "name": _content(_one(one, "person"), "name"),
                "role": _maybe(one, "role"),
                "main_signer": _words(_one(one, "mainSigner")) == "true",
            }
            for one in _all(administrative, "respPersons/respPerson")
        ],
        "conditions": {
            "temperature_degC": () if degC is None else tuple(map(float, degC)),
            "relative_humidity_percent": None if humidity is None else tuple(float(100 * share) for share in humidity),
        },
    }
    try:
        return AdministrativeData.model_validate(told)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"{where}: {first['msg'].removeprefix('Value error, ')}") from None


def _contact_of(element: Element) -> dict[str, str | None]:
    location = _one(element, "location")
    address = {key: _maybe(location, tag) for key, tag in _ADDRESS}
    needed = {key: address[key] or "" for key in ("post_code", "city")}
    known = {"name": _content(element, "name"), "email": _maybe(element, "eMail"), "phone": _maybe(element, "phone")}
    return known | address | needed | {"country": _words(_one(location, "countryCode"))}


def _condition_of(measured: Element, kind: str) -> tuple[Decimal, Decimal] | None:
    found = _all(measured, f"influenceConditions/influenceCondition[@refType='{kind}']", some=False)
    if not found:
        return None
    unit = "1" if kind == _HUMIDITY else "degC"
    ends = [_quantity_of(_one(found[0], f"data/quantity[@refType='{kind}{end}']")) for end in ("Min", "Max")]
    if any(end.unit != unit for end in ends):
        raise InputError(f"{_CONDITIONS[kind]}: expected the unit {_UNITS[unit]}")
    return ends[0].value, ends[1].value


def _result_of(element: Element) -> StatedResult:
    quantity = _one(element, "data/quantity")
    said = _all(quantity, "measurementMetaData/metaData", some=False)
    if not said:
        return StatedResult(_quantity_of(quantity), None, None)
    return StatedResult(_quantity_of(quantity), _quantity_of(_one(said[0], "data/quantity")), _conformity(said[0]))


def _quantity_of(element: Element) -> StatedQuantity:
    real = _one(element, "si:real")
    written, units = _words(_one(real, "si:unit")), {unit: name for name, unit in _UNITS.items()}
    if written not in units:
        raise InputError(f"expected a unit of {', '.join(units)}, got {written!r:.80}")
    uncertainty = "si:measurementUncertaintyUnivariate"
    expanded = real.find(f"{uncertainty}/si:expandedMU", _SPACES)
    standard = real.find(f"{uncertainty}/si:standardMU", _SPACES)
    stated: dict[str, Decimal] = {}
    if expanded is not None:
        keys = (("expanded", "valueExpandedMU"), ("factor", "coverageFactor"), ("level", "coverageProbability"))
        stated = {key: _number(_one(expanded, f"si:{tag}")) for key, tag in keys}
    elif standard is not None:
        stated = {"standard": _number(_one(standard, "si:valueStandardMU"))}
    return StatedQuantity(_content(element, "name"), _number(_one(real, "si:value")), units[written], **stated)


def _conformity(element: Element) -> str:
    said = _words(_one(element, "conformity"))
    if said not in CONFORMITIES:
        raise InputError(f"expected a conformity of {', '.join(CONFORMITIES)}, got {said!r:.80}")
    return said


def _number(element: Element) -> Decimal:
    text = _words(element)
    try:
        value = Decimal(text) if len(text) < 100 else Decimal("NaN")
    except InvalidOperation:
        value = Decimal("NaN")
    if not value.is_finite() or "e" in text.lower():
        raise InputError(f"<{_name(element)}>: expected a number without an exponent, got {text[:80]!r}")
    return value


def _date(element: Element) -> datetime.date:
    try:
        return datetime.date.fromisoformat(_words(element))
    except ValueError:
        raise InputError(f"<{_name(element)}>: expected a date, got {_words(element)[:80]!r}") from None


def _all(element: Element, path: str, *, some: bool = True) -> Sequence[Element]:
    tags = [part if ":" in part.partition("[")[0] else f"dcc:{part}" for part in path.split("/")]
    found = element.findall("/".join(tags), _SPACES)
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
    return _words(found[0]) if found else None


def _content(element: Element, path: str) -> str:
    return _words(_one(element, f"{path}/content"))


def _words(element: Element) -> str:
    return element.text or ""


def _name(element: Element) -> str:
    return element.tag.rpartition("}")[2]
