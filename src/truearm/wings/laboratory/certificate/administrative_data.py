"""The administrative data of a certificate: number, dates, place, arm, laboratory, customer, persons, conditions.

The file (TOML, docs/certificate.md) is written by hand; `template` returns one to fill in.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from truearm.acceptance import contradict
from truearm.errors import FaultCollector, InputError
from truearm.files.dates import check_past
from truearm.files.toml_documents import Document, Real, read_document
from truearm.printable_text import printable
from truearm.wings.laboratory.standards.measured_points import LEAST_HUMIDITY_PERCENT

# The greatest difference between an artefact, after some hours in a room, and its air [K].
MOST_K_FROM_ROOM = 3.0


def xml_text(text: str) -> str:
    """Return a text in one line for XML: single spaces, and escapes for characters that are not allowed, or act."""
    return printable(" ".join(text.split()))


def _filled_in(text: str) -> str:
    if not text.strip():
        raise InputError("the text is empty", hint="fill it in")
    return xml_text(text)


def _country(text: str) -> str:
    text = _filled_in(text)
    if not re.fullmatch("[A-Z]{2}", text):
        raise InputError(
            f"expected two capital letters, got {text!r:.80}", hint="write a code of ISO 3166-1, such as DE, FR, JP"
        )
    return text


Text = Annotated[str, Field(strict=True, max_length=500), AfterValidator(_filled_in)]
Country = Annotated[str, Field(strict=True, max_length=500), AfterValidator(_country)]
Place = Literal["laboratory", "laboratoryBranch", "customer", "customerBranch", "other"]
ToThousandths = Annotated[Real, AfterValidator(lambda value: round(value, 3) + 0.0)]  # no -0.0
Between = tuple[ToThousandths, ToThousandths]


class Item(Document):
    """The arm; `condition` is that on receipt, where it matters."""

    name: Text
    maker: Text
    model: Text
    serial_number: Text
    inventory_number: Text | None = None
    condition: Text | None = None


class SetUp(Document):
    """What the results depend on: the stylus, the mounting of the arm, and its software or firmware with version."""

    stylus: Text
    mounting: Text
    software: Text


class Site(Document):
    """A name and an address."""

    name: Text
    street: Text | None = None
    street_no: Text | None = None
    post_code: Text
    city: Text
    country: Country


class Contact(Site):
    """A company or laboratory and its address."""

    email: Text | None = None
    phone: Text | None = None


class Laboratory(Contact):
    """The laboratory that measured; `code` is that of its accreditation."""

    code: Text | None = None


class Person(Document):
    """A responsible person."""

    name: Text
    role: Text | None = None
    main_signer: Annotated[bool, Field(strict=True)] = False


class Adjustment(Document):
    """Work on the arm before the results of the certificate were measured."""

    kind: Literal["adjustment", "repair"]
    work: Text


class Replaced(Document):
    """The certificate that this one amends or substitutes, and the reason of the change."""

    number: Text
    change: Literal["amended", "substituted"]
    reason: Text


class Notes(Document):
    """Statements of the laboratory in its own words, where they apply; `NOTES` has their headings."""

    deviations: Text | None = None
    external_results: Text | None = None
    from_customer: Text | None = None
    agreed_interval: Text | None = None
    opinions: Text | None = None


# Headings of the notes. What ISO/IEC 17025:2017 asks of each is in docs/assessor.md.
NOTES = {
    "deviations": "Additions to, deviations and exclusions from the method",
    "external_results": "Results of an external provider",
    "from_customer": "Information provided by the customer, for which the laboratory is not responsible",
    "agreed_interval": "Recommended calibration interval, as agreed with the customer",
    "opinions": "Opinions and interpretations, no results",
}


class Conditions(Document):
    """The room: lowest and highest temperature [degC] and relative humidity [%]."""

    temperature_degC: Between
    relative_humidity_percent: Between | None = None

    @field_validator("temperature_degC", "relative_humidity_percent")
    @classmethod
    def _in_order(cls, pair: Between | None, info: ValidationInfo) -> Between | None:
        least, most = (-50, 100) if info.field_name == "temperature_degC" else (0, 100)
        if pair is not None and not least <= pair[0] <= pair[1] <= most:
            raise InputError(
                f"expected the lowest and the highest, from {least} to {most}, got {pair[0]:g} and {pair[1]:g}",
                hint="write [lowest, highest]",
            )
        return pair


class AdministrativeData(Document):
    """The administrative data of a certificate.

    Attributes
    ----------
    number : str
        Unique number of the certificate.
    issued, received : date
        Dates of the signature and of the arm's arrival; the latter may be None.
    place : str
        Place of the measurement.
    site : Site or None
        Its address; that of the laboratory, or of the customer where `place` is ``customer``, if None.
    replaces : Replaced or None
    item : Item
    laboratory, customer : Contact
    persons : tuple of Person
    conditions : Conditions
    set_up : SetUp
        Stylus, mounting and software of the arm.
    adjustment : Adjustment or None
        What was done before the results were measured.
    notes : Notes

    Examples
    --------
    >>> import truearm as ta
    >>> list(ta.AdministrativeData.model_fields)[:2]
    ['number', 'issued']
    """

    number: Text
    issued: datetime.date
    received: datetime.date | None = None
    place: Place
    site: Annotated[Site | None, Field(validate_default=True)] = None
    replaces: Replaced | None = None
    item: Item
    laboratory: Laboratory
    customer: Contact
    persons: Annotated[tuple[Person, ...], Field(min_length=1, max_length=100)]
    conditions: Conditions
    set_up: SetUp
    adjustment: Adjustment | None = None
    notes: Notes = Notes()

    @field_validator("issued")
    @classmethod
    def _signed_by_now(cls, day: datetime.date) -> datetime.date:
        check_past(day)
        return day

    # Validators of fields rather than of the whole: pydantic calls the latter only if all fields are valid, and a
    # person would hear of their faults in a second run.
    @field_validator("received")
    @classmethod
    def _received_before_it_is_signed(cls, day: datetime.date | None, info: ValidationInfo) -> datetime.date | None:
        issued = info.data.get("issued")
        if day is not None and issued is not None and issued < day:
            raise InputError(
                f"issued on {issued}, before the arm was received on {day}", hint="correct one of the dates"
            )
        return day

    @field_validator("site")
    @classmethod
    def _address_of_the_place(cls, site: Site | None, info: ValidationInfo) -> Site | None:
        place = info.data.get("place")
        if site is None and place in ("laboratoryBranch", "customerBranch", "other"):
            raise InputError(f"the address of the place {place!r} is missing", hint="add the table [site]")
        if site is not None and place == "laboratory":
            raise InputError(
                "an address of the place beside place = 'laboratory'", hint="remove [site], or correct the place"
            )
        return site

    @field_validator("replaces")
    @classmethod
    def _another_number(cls, replaces: Replaced | None, info: ValidationInfo) -> Replaced | None:
        if replaces is not None and replaces.number == info.data.get("number"):
            raise InputError(
                f"the certificate {replaces.number!r:.80} replaces itself", hint="give the new one a number of its own"
            )
        return replaces

    @field_validator("persons")
    @classmethod
    def _somebody_signs(cls, persons: tuple[Person, ...]) -> tuple[Person, ...]:
        if not any(person.main_signer for person in persons):
            raise InputError("no person signs the certificate", hint="write main_signer = true for one of the persons")
        return persons

    @property
    def measured_at(self) -> Site:
        """Name and address of the place of the measurement."""
        return self.site or (self.customer if self.place == "customer" else self.laboratory)

    @property
    def room(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of the conditions that may be rated, by their names there."""
        stated = {
            "air_degC": self.conditions.temperature_degC,
            "humidity_percent": self.conditions.relative_humidity_percent,
        }
        return {key: pair for key, pair in stated.items() if pair is not None}

    def check_fits(
        self,
        *,
        serial_number: str,
        measured: tuple[datetime.date, datetime.date],
        confirmed: datetime.date | None,
        artefact_degC: tuple[float, float] | None,
    ) -> None:
        """Check that the data fit the measurement; all contradictions are raised at once.

        Another serial number, other temperatures and a room too dry may be accepted (`truearm.accepting`); an order of
        dates may not.

        Parameters
        ----------
        serial_number : str
            That the points state; empty if they state none.
        measured : (date, date)
            First and last day of the measurement.
        confirmed : date or None
            Day on which the numbers of the test plan were confirmed.
        artefact_degC : (float, float) or None
            Lowest and highest temperature of the artefacts, which after some hours is about that of the room.

        Raises
        ------
        InputError
            If they do not.
        """
        found = FaultCollector()
        for problem, hint in self._disorder(*measured, confirmed):
            with found.collect():
                raise InputError(problem, hint=hint)
        for problem, hint in self._contradictions(serial_number, artefact_degC):
            with found.collect():
                contradict(InputError(problem, hint=hint))
        found.raise_any()

    def _disorder(
        self, begin: datetime.date, end: datetime.date, confirmed: datetime.date | None
    ) -> Iterator[tuple[str, str]]:
        """Dates in a wrong order, each with what to try."""
        if self.issued < end:
            yield f"issued on {self.issued}, before the last points were measured on {end}", "correct the date issued"
        if self.received is not None and self.received > begin:
            problem = f"the arm was received on {self.received}, after points were measured on {begin}"
            yield problem, "correct the date received"
        if confirmed is not None and self.issued < confirmed:
            problem = f"issued on {self.issued}, before the numbers of the test plan were confirmed on {confirmed}"
            yield problem, "correct the date issued, or date under [confirmation] of the plan"

    def _contradictions(
        self, serial_number: str, artefact_degC: tuple[float, float] | None
    ) -> Iterator[tuple[str, str]]:
        """What the points contradict and a person may accept, each with what to try."""
        if serial_number and xml_text(serial_number) != self.item.serial_number:
            problem = (
                "item.serial_number: the certificate is of the arm with serial number "
                f"{self.item.serial_number!r:.80}, the points are of {serial_number!r:.80}"
            )
            yield problem, "give the points of this arm, or correct the number that is wrong"
        humidity = self.conditions.relative_humidity_percent
        if humidity is not None and humidity[1] < LEAST_HUMIDITY_PERCENT:
            problem = f"relative_humidity_percent: {humidity[0]:g} to {humidity[1]:g} % is drier than any room"
            yield problem, "write it in per cent: [40.0, 55.0] for shares of 0.40 to 0.55"
        low, high = self.conditions.temperature_degC
        coldest, warmest = artefact_degC or (low, high)
        if coldest < low - MOST_K_FROM_ROOM or warmest > high + MOST_K_FROM_ROOM:
            problem = f"the room was at {low:g} to {high:g} degC, artefacts at {coldest:g} to {warmest:g} degC"
            yield problem, "correct temperature_degC under [conditions], or artefact_degC of the points"


def read_administrative_data(path: str | Path) -> AdministrativeData:
    """Read the administrative data of a new certificate.

    Raises
    ------
    InputError
        If the file is missing or breaks a rule of its format; the message names all faults.
    """
    return read_document(path, AdministrativeData)


def template() -> str:
    """Return the text of such a file, to fill in."""
    return files("truearm.wings.laboratory.certificate").joinpath("about.toml").read_text(encoding="utf-8")
