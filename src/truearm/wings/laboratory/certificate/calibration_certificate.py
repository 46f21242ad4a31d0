"""Certificates of other laboratories: what a digital calibration certificate (DCC 3.x) states of its item.

Institutes fill the same schema in different ways, so nothing is asked but that the file is such a certificate: what is
not stated is listed in `CalibrationCertificate.missing`.
"""

from __future__ import annotations

import datetime
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

from truearm.errors import InputError
from truearm.wings.laboratory.certificate.dsi_quantities import MeasuredValue, clean, read_values

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si", "xsi": "http://www.w3.org/2001/XMLSchema-instance"}
MOST_ROWS = 40  # of results, in words
DEEPEST = 20  # lists in lists


@dataclass(frozen=True)
class Heading:
    """A name, in English where there is one, with all its languages and reference types to recognise it by."""

    name: str
    words: str


@dataclass(frozen=True)
class Column:
    """A quantity: one value, or those of a list; texts where it has no numbers."""

    heading: Heading
    values: tuple[MeasuredValue, ...]
    texts: tuple[str, ...] = ()


@dataclass(frozen=True)
class ResultTable:
    """Quantities that stand beside each other, under the headings of their result and lists, outermost first."""

    headings: tuple[Heading, ...]
    columns: tuple[Column, ...]

    def path(self, column: Column) -> str:
        """The names of the headings and of a column."""
        names = [one.name for one in (*self.headings, column.heading) if one.name]
        return " / ".join(dict.fromkeys(names))


@dataclass(frozen=True)
class CalibratedItem:
    """An item: its name, maker, model, and its numbers by who gave them (manufacturer, customer, ...)."""

    heading: Heading
    maker: str | None
    model: str | None
    numbers: tuple[tuple[str, str], ...]

    def describe(self) -> str:
        """The item in a line."""
        known = " ".join(part for part in (self.heading.name, self.maker, self.model) if part)
        return ", ".join([known, *(f"number of the {issuer} {value}" for issuer, value in self.numbers)])


@dataclass(frozen=True)
class CalibrationCertificate:
    """A certificate of another laboratory.

    Attributes
    ----------
    number, schema_version : str
    issued, begin, end : date or None
        Date of issue, first and last day of the calibration.
    next_calibration : date or None
        The day by which the item shall be calibrated again, if the certificate states one.
    laboratory, laboratory_code, country : str or None
        `laboratory_code` is that of its accreditation.
    items : tuple of CalibratedItem
    conditions, results : tuple of ResultTable
    statements : tuple of str
    """

    number: str | None
    schema_version: str
    issued: datetime.date | None
    begin: datetime.date | None
    end: datetime.date | None
    next_calibration: datetime.date | None
    laboratory: str | None
    laboratory_code: str | None
    country: str | None
    items: tuple[CalibratedItem, ...]
    conditions: tuple[ResultTable, ...]
    results: tuple[ResultTable, ...]
    statements: tuple[str, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """What a certificate should state, or may, and this one does not."""
        return tuple(what for key, what in _SHOULD_STATE.items() if not getattr(self, key))

    def to_dict(self) -> dict[str, Any]:
        """All that it states, with the results by their names."""
        known = {field.name: getattr(self, field.name) for field in fields(self)}
        items = [
            {"name": one.heading.name, "maker": one.maker, "model": one.model, "numbers": one.numbers}
            for one in self.items
        ]
        tables = {
            key: [
                {"name": table.path(column), "values": column.values, "texts": column.texts}
                for table in known[key]
                for column in table.columns
            ]
            for key in ("conditions", "results")
        }
        return {**known, "items": items, **tables, "missing": self.missing}


_SHOULD_STATE = {
    "number": "number",
    "issued": "date of issue",
    "begin": "first day of the calibration",
    "end": "last day of the calibration",
    "laboratory": "laboratory",
    "laboratory_code": "accreditation of the laboratory",
    "items": "item",
    "results": "results",
    "next_calibration": "day of the next calibration",
}


def calibration_certificate(root: ET.Element) -> CalibrationCertificate:
    """Read the certificate of another laboratory from the root of its XML file.

    Raises
    ------
    InputError
        If it is no digital calibration certificate of schema 3.x, or its numbers cannot be read.
    """
    if root.tag != f"{{{SPACES['dcc']}}}digitalCalibrationCertificate":
        raise InputError(f"expected a digital calibration certificate, got <{root.tag:.80}>")
    version = root.get("schemaVersion", "")
    if not version.startswith("3."):
        hint = "ask the laboratory for a certificate by schema 3.x"
        raise InputError(f"truearm reads DCC schema 3.x, got schema version {version!r:.80}", hint=hint)
    core, laboratory = "administrativeData/coreData/", "administrativeData/calibrationLaboratory/"
    return CalibrationCertificate(
        number=_text(root, f"{core}uniqueIdentifier"),
        schema_version=clean(version),
        issued=_day(root, f"{core}issueDate"),
        begin=_day(root, f"{core}beginPerformanceDate"),
        end=_day(root, f"{core}endPerformanceDate"),
        next_calibration=_next_calibration(root),
        laboratory=_heading(_first(root, f"{laboratory}contact/name")).name or None,
        laboratory_code=_text(root, f"{laboratory}calibrationLaboratoryCode"),
        country=_text(root, f"{laboratory}contact/location/countryCode"),
        items=tuple(_items(root)),
        conditions=tuple(table for one in root.iter(_tag("influenceCondition")) for table in _tables(one, ())),
        results=tuple(
            table
            for result in _all(root, "measurementResults/measurementResult/results/result")
            for table in _tables(result, ())
        ),
        statements=tuple(
            text
            for one in _all(root, "administrativeData/statements/statement")
            if (text := _heading(_first(one, "declaration")).name)
        ),
    )


def describe(certificate: CalibrationCertificate) -> Iterator[str]:
    """Describe a certificate in lines: items, dates, results and what it does not state."""
    yield from (f"item: {item.describe()}" for item in certificate.items)
    performed = " to ".join(dict.fromkeys(str(day) for day in (certificate.begin, certificate.end) if day is not None))
    issued = "" if certificate.issued is None else f", issued on {certificate.issued}"
    following = "" if certificate.next_calibration is None else f", again by {certificate.next_calibration}"
    if performed:
        yield f"calibrated on {performed}{issued}{following}"
    rows = [
        f"{table.path(column)}: {value}"
        for table in certificate.results
        for column in table.columns
        for value in column.values
    ]
    yield from rows[:MOST_ROWS]
    if len(rows) > MOST_ROWS:
        yield f"and {len(rows) - MOST_ROWS} more values; --json has all"
    if certificate.missing:
        yield f"The certificate does not state: {', '.join(certificate.missing)}."


def _items(root: ET.Element) -> Iterator[CalibratedItem]:
    for one in root.iter(_tag("item")):
        numbers = tuple(
            (_text(each, "issuer") or "unknown", value)
            for each in _all(one, "identifications/identification")
            if (value := _text(each, "value"))
        )
        maker = _heading(_first(one, "manufacturer/name")).name or None
        classes = " ".join(clean(each.text or "") for each in one.iter(_tag("classID")))
        heading = _heading(_first(one, "name"), classes)
        yield CalibratedItem(heading, maker, _text(one, "model"), numbers)


def _next_calibration(root: ET.Element) -> datetime.date | None:
    """The date of a statement of PTB's reference type ``basic_recalibration``."""
    for one in _all(root, "administrativeData/statements/statement"):
        if "recalibration" in one.get("refType", "").lower() and (day := _day(one, "date")) is not None:
            return day
    return None


def _tables(element: ET.Element, above: tuple[Heading, ...]) -> Iterator[ResultTable]:
    """The quantities of a result, a condition or a list, and of the lists in it."""
    if len(above) > DEEPEST:
        raise InputError(f"lists are nested in each other more than {DEEPEST} times")
    headings = (*above, _heading(_first(element, "name"), element.get("refType", "")))
    holders = [element, *_all(element, "data")]
    if columns := tuple(_column(one) for holder in holders for one in _all(holder, "quantity")):
        yield ResultTable(headings, columns)
    for holder in holders:
        for listed in _all(holder, "list"):
            yield from _tables(listed, headings)


def _column(quantity: ET.Element) -> Column:
    heading = _heading(_first(quantity, "name"), quantity.get("refType", ""))
    texts = [clean(part) for one in _all(quantity, "charsXMLList") for part in (one.text or "").split()]
    try:
        return Column(heading, read_values(quantity), tuple(texts))
    except InputError as error:
        raise InputError(f"quantity {heading.name!r}: {error.problem}") from None


def _heading(element: ET.Element | None, kinds: str = "") -> Heading:
    """The texts of an element: the English one, else one without a language, else the first."""
    contents = [] if element is None else [one for one in _all(element, "content") if (one.text or "").strip()]
    contents.sort(key=lambda one: ("en", None).index(one.get("lang")) if one.get("lang") in ("en", None) else 2)
    texts = [clean(one.text or "") for one in contents]
    return Heading(texts[0] if texts else "", f"{' '.join(texts)} {clean(kinds)}".lower())


def _tag(name: str) -> str:
    return f"{{{SPACES['dcc']}}}{name}"


def _all(element: ET.Element, path: str) -> list[ET.Element]:
    return element.findall("/".join(f"dcc:{part}" for part in path.split("/")), SPACES)


def _first(element: ET.Element, path: str) -> ET.Element | None:
    return next(iter(_all(element, path)), None)


def _text(element: ET.Element, path: str) -> str | None:
    found = _first(element, path)
    return None if found is None else clean(found.text or "") or None


def _day(element: ET.Element, path: str) -> datetime.date | None:
    text = _text(element, path)
    try:
        return None if text is None else datetime.date.fromisoformat(text[:10])  # xs:date may have a time zone
    except ValueError:
        raise InputError(f"<{path.rpartition('/')[2]}>: expected a date, got {text!r:.80}") from None
