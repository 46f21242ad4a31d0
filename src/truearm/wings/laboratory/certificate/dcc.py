r"""The writer of digital calibration certificates: PTB's DCC, schema 3.3.0, with quantities of the D-SI, schema 2.2.1.

Elements, their order and the values of enumerations are those of the two schemas (dcc.xsd and SI_Format.xsd,
Physikalisch-Technische Bundesanstalt); the tests check certificates against them and against PTB's Schematron rules.
Units are written in the form of the D-SI, ``\milli\metre``. Reference types of PTB (``basic_..``) are those of its
examples; ``truearm_..`` are our own.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from decimal import Decimal

from truearm.errors import InputError, TruearmError
from truearm.wings.laboratory.certificate.administrative_data import NOTES, Contact, Site
from truearm.wings.laboratory.certificate.calibration_certificate import SPACES
from truearm.wings.laboratory.certificate.certificate import Certificate, StatedQuantity
from truearm.wings.laboratory.certificate.dcc_reader import (
    ACCREDITATION,
    ADDRESS,
    ADJUSTMENT,
    AMBIENT,
    ARM_SOFTWARE,
    ARTEFACT,
    AS_FOUND,
    BUDGET,
    CERTIFICATE,
    CONDITIONS,
    CONFORMITY,
    HUMIDITY,
    INDIVIDUAL,
    ISSUER,
    LANGUAGE,
    LIMIT,
    MOUNTING,
    NOT_DECIDED,
    NOTE,
    REPLACES,
    SCHEMA_VERSION,
    SERIAL_NUMBER,
    SITE,
    STATEMENTS,
    STYLUS,
    UNITS,
    Element,
    parse_dcc_file,
)
from truearm.wings.laboratory.signatures.x509_certificates import Signer
from truearm.wings.laboratory.signatures.xml_signatures import GOOD, sign_xml


def checked_dcc(certificate: Certificate, signer: Signer | None = None) -> bytes:
    """Return a certificate as XML, signed if there is a signer, that was read back and compared with it."""
    content = dcc(certificate) if signer is None else sign_xml(dcc(certificate), signer)
    read = parse_dcc_file(content)
    if read.signature is not None and read.signature.answer != GOOD:
        hint = "sign with a certificate for signatures (key usage digitalSignature) that is valid on the day of issue"
        raise InputError(read.signature.reason, hint=hint)
    if read.certificate != certificate:
        raise TruearmError("the certificate read back differs from the one written; please report this as a bug")
    return content


def dcc(certificate: Certificate) -> bytes:
    """Return a certificate as XML; the same certificate gives the same bytes."""
    root = Element("dcc:digitalCalibrationCertificate")
    for prefix, space in SPACES.items():
        root.set(f"xmlns:{prefix}", space)
    root.set("xsi:schemaLocation", f"{SPACES['dcc']} {SPACES['dcc']}/v{SCHEMA_VERSION}/dcc.xsd")
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
    _if_known(core, "receiptDate", None if about.received is None else about.received.isoformat())
    _in(core, "beginPerformanceDate", certificate.begin.isoformat())
    _in(core, "endPerformanceDate", certificate.end.isoformat())
    _in(core, "performanceLocation", about.place)
    _in(core, "issueDate", about.issued.isoformat())
    if about.replaces is not None:
        replaced = _in(core, "reportAmendedSubstituted")
        _in(replaced, "typeOfChange", about.replaces.change)
        _in(replaced, "replacedUniqueIdentifier", about.replaces.number)
    item = _in(_in(parent, "items"), "item")
    _text(item, "name", about.item.name)
    if about.item.condition is not None:
        _text(item, "description", about.item.condition)
    _text(_in(item, "manufacturer"), "name", about.item.maker)
    _in(item, "model", about.item.model)
    known = _in(item, "identifications")
    _identification(known, "manufacturer", about.item.serial_number, "serial number")
    if about.item.inventory_number is not None:
        _identification(known, "customer", about.item.inventory_number, "inventory number")
    laboratory = _in(parent, "calibrationLaboratory")
    _if_known(laboratory, "calibrationLaboratoryCode", about.laboratory.code)
    _contact(_in(laboratory, "contact"), about.laboratory)
    persons = _in(parent, "respPersons")
    for person in about.persons:
        one = _in(persons, "respPerson")
        _text(_in(one, "person"), "name", person.name)
        _if_known(one, "role", person.role)
        _in(one, "mainSigner", "true" if person.main_signer else "false")
    _contact(_in(parent, "customer"), about.customer)
    statements = _in(parent, "statements")
    for stated in certificate.statements:
        undecided = stated.kind == "decision" and certificate.conformity is None
        statement = _in(statements, "statement", refType=NOT_DECIDED if undecided else STATEMENTS[stated.kind])
        if stated.kind == "traceability":
            _in(statement, "traceable", "true" if certificate.is_traceable else "false")
        _text(statement, "declaration", stated.text)
        if stated.kind == "decision" and certificate.conformity is not None:
            _in(statement, "conformity", certificate.conformity)
    _own_statements(statements, certificate)


def _own_statements(parent: Element, certificate: Certificate) -> None:
    """What the laboratory states in its own words: place, reason of a change, notes."""
    about = certificate.about
    notes = {NOTE.format(key): (name, getattr(about.notes, key)) for key, name in NOTES.items()}
    notes[REPLACES] = ("Reason of the change", None if about.replaces is None else about.replaces.reason)
    notes[SITE] = ("Place of the measurement", None if about.site is None else about.site.name)
    for kind, (name, words) in notes.items():
        if words is not None:
            statement = _in(parent, "statement", refType=kind)
            _text(statement, "name", name)
            _text(statement, "declaration", words)
            if kind == SITE and about.site is not None:
                _location(statement, about.site)


def _measured(parent: Element, certificate: Certificate) -> None:
    _text(parent, "name", certificate.title)
    methods = _in(parent, "usedMethods")
    for number, method in enumerate(certificate.methods):
        one = _in(methods, "usedMethod", **({} if number else {"refType": "basic_uncertainty"}))
        _text(one, "name", method.name)
        _text(one, "description", method.description)
        _if_known(one, "norm", method.norm)
    _software(_in(parent, "usedSoftware"), certificate)
    equipments = _in(parent, "measuringEquipments")
    for equipment in certificate.equipment:
        one = _in(equipments, "measuringEquipment", refType="basic_normalUsed")
        _text(one, "name", equipment.name)
        _text(one, "description", equipment.description)
        known = _in(one, "identifications")
        if equipment.serial_number is not None:
            _identification(known, "manufacturer", equipment.serial_number, "serial number", SERIAL_NUMBER)
        _identification(known, "other", equipment.certificate, "certificate", CERTIFICATE)
        _identification(known, "other", equipment.issued_by, "laboratory that issued the certificate", ISSUER)
        if equipment.accreditation is not None:
            _identification(known, "other", equipment.accreditation, "accreditation of that laboratory", ACCREDITATION)
        if equipment.quantities:
            sizes = _in(one, "measuringEquipmentQuantities")
            for quantity in equipment.quantities:
                _quantity(_in(sizes, "measuringEquipmentQuantity"), quantity)
    conditions, about = _in(parent, "influenceConditions"), certificate.about.conditions
    low, high = about.temperature_degC
    _condition(conditions, AMBIENT, _decimal(low), _decimal(high), "degC")
    if about.relative_humidity_percent is not None:
        low, high = about.relative_humidity_percent
        _condition(conditions, HUMIDITY, _decimal(low) / 100, _decimal(high) / 100, "1")
    if certificate.artefact_degC is not None:
        _condition(conditions, ARTEFACT, *certificate.artefact_degC, "degC")
    set_up = certificate.about.set_up
    for kind, words in ((STYLUS, set_up.stylus), (MOUNTING, set_up.mounting), (ARM_SOFTWARE, set_up.software)):
        one = _in(conditions, "influenceCondition", refType=kind)
        _text(one, "name", CONDITIONS[kind])
        _text(_in(one, "data"), "text", words)
    if (done := certificate.about.adjustment) is not None:
        one = _in(conditions, "influenceCondition", refType=ADJUSTMENT)
        _text(one, "name", done.kind)
        _in(one, "status", f"after{done.kind.capitalize()}")
        _text(_in(one, "data"), "text", done.work)
    _results(parent, certificate)


def _results(parent: Element, certificate: Certificate) -> None:
    results = _in(parent, "results")
    for at, result in enumerate((*certificate.results, *certificate.as_found)):
        one = _in(results, "result", **({} if at < len(certificate.results) else {"refType": AS_FOUND}))
        _text(one, "name", result.quantity.name)
        value = _in(_in(one, "data"), "quantity", refType="basic_measuredValue")
        _quantity(value, result.quantity)
        if result.limit is not None:
            kind = LIMIT if result.conformity is None else CONFORMITY
            statement = _in(_in(value, "measurementMetaData"), "metaData", refType=kind)
            _if_known(statement, "conformity", result.conformity)
            _quantity(_in(_in(statement, "data"), "quantity", refType=LIMIT), result.limit)
    for kind, lists in ((INDIVIDUAL, certificate.individual), (BUDGET, certificate.budgets)):
        for listed in lists:
            one = _in(results, "result", refType=kind)
            _text(one, "name", listed.name)
            quantities = _in(_in(one, "data"), "list")
            for quantity in listed.quantities:
                _quantity(_in(quantities, "quantity"), quantity)


def _if_known(parent: Element, tag: str, text: str | None) -> None:
    if text is not None:
        _in(parent, tag, text)


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


def _identification(parent: Element, issuer: str, value: str, name: str, kind: str | None = None) -> None:
    one = _in(parent, "identification", **({} if kind is None else {"refType": kind}))
    _in(one, "issuer", issuer)
    _in(one, "value", value)
    _text(one, "name", name)


def _contact(parent: Element, contact: Contact) -> None:
    _text(parent, "name", contact.name)
    _if_known(parent, "eMail", contact.email)
    _if_known(parent, "phone", contact.phone)
    _location(parent, contact)


def _location(parent: Element, site: Site) -> None:
    location = _in(parent, "location")
    for key, tag in (*ADDRESS, ("country", "countryCode")):
        _if_known(location, tag, getattr(site, key))


def _condition(parent: Element, kind: str, low: Decimal, high: Decimal, unit: str) -> None:
    one = _in(parent, "influenceCondition", refType=kind)
    _text(one, "name", CONDITIONS[kind])
    data = _in(one, "data")
    for end, value in (("Min", low), ("Max", high)):
        name = "lowest" if end == "Min" else "highest"
        _quantity(_in(data, "quantity", refType=f"{kind}{end}"), StatedQuantity(name, value, unit))


def _quantity(parent: Element, quantity: StatedQuantity) -> None:
    _text(parent, "name", quantity.name)
    real = _in(parent, "si:real")
    _in(real, "si:value", f"{quantity.value:f}")
    _in(real, "si:unit", UNITS[quantity.unit])
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
