"""The administrative data of a certificate: number, dates, place, arm, laboratory, customer, persons, conditions.

The file (TOML, docs/certificate.md) is written by hand; `template` returns one to fill in.
"""

from __future__ import annotations

import datetime
import re
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Real, read_document
from truearm.verification.standards.dates import check_past

# The greatest difference between an artefact, after some hours in a room, and its air [K].
MOST_K_FROM_ROOM = 3.0
# Characters that XML 1.0 does not allow (its production 2), with lone surrogates.
_NOT_XML = re.compile("[^\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")


def xml_text(text: str) -> str:
    """Return a text in one line for XML: single spaces, and a replacement for every character that is not allowed."""
    return _NOT_XML.sub("\ufffd", " ".join(text.split()))


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
    """The arm."""

    name: Text
    maker: Text
    model: Text
    serial_number: Text
    inventory_number: Text | None = None


class SetUp(Document):
    """What the results depend on: the stylus, the mounting of the arm, and its software or firmware with version."""

    stylus: Text
    mounting: Text
    software: Text


class Contact(Document):
    """A company or laboratory and its address."""

    name: Text
    email: Text | None = None
    phone: Text | None = None
    street: Text | None = None
    street_no: Text | None = None
    post_code: Text
    city: Text
    country: Country


class Laboratory(Contact):
    """The laboratory that measured; `code` is that of its accreditation."""

    code: Text | None = None


class Person(Document):
    """A responsible person."""

    name: Text
    role: Text | None = None
    main_signer: Annotated[bool, Field(strict=True)] = False


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
    item : Item
    laboratory, customer : Contact
    persons : tuple of Person
    conditions : Conditions
    set_up : SetUp
        Stylus, mounting and software of the arm; None in certificates of earlier versions.

    Examples
    --------
    >>> import truearm as ta
    >>> sorted(ta.AdministrativeData.model_fields)[:2]
    ['conditions', 'customer']
    """

    number: Text
    issued: datetime.date
    received: datetime.date | None = None
    place: Place
    item: Item
    laboratory: Laboratory
    customer: Contact
    persons: Annotated[tuple[Person, ...], Field(min_length=1, max_length=100)]
    conditions: Conditions
    set_up: SetUp | None = None

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

    @field_validator("persons")
    @classmethod
    def _somebody_signs(cls, persons: tuple[Person, ...]) -> tuple[Person, ...]:
        if not any(person.main_signer for person in persons):
            raise InputError("no person signs the certificate", hint="write main_signer = true for one of the persons")
        return persons

    def check_complete(self) -> None:
        """Check that what results depend on is stated; certificates of earlier versions, which are read, lack it.

        Raises
        ------
        InputError
            If the set-up is missing.
        """
        if self.set_up is None:
            raise InputError(
                "a certificate states the stylus, the mounting and the software of the arm",
                hint="add [set_up] with stylus, mounting and software; truearm certificate --template shows it",
            )

    def check_serial_number(self, measured: str) -> None:
        """Check that the certificate is of the arm that was measured.

        Parameters
        ----------
        measured : str
            Serial number that the points state; empty if they state none.

        Raises
        ------
        InputError
            If it is another one.
        """
        if measured and xml_text(measured) != self.item.serial_number:
            raise InputError(
                "item.serial_number: the certificate is of the arm with serial number "
                f"{self.item.serial_number!r:.80}, the points are of {measured!r:.80}",
                hint="give the points of this arm, or correct the number that is wrong",
            )

    def check_issued(self, end: datetime.date) -> None:
        """Check that the certificate is issued after the measurement.

        Raises
        ------
        InputError
            If not.
        """
        if self.issued < end:
            raise InputError(
                f"issued on {self.issued}, before the last points were measured on {end}",
                hint="correct the date issued",
            )

    def check_received(self, begin: datetime.date) -> None:
        """Check that the arm was received before the measurement.

        Raises
        ------
        InputError
            If not.
        """
        if self.received is not None and self.received > begin:
            raise InputError(
                f"the arm was received on {self.received}, after points were measured on {begin}",
                hint="correct the date received",
            )

    def check_confirmation(self, day: datetime.date) -> None:
        """Check that the numbers of the test plan were confirmed by the day of issue.

        Raises
        ------
        InputError
            If not.
        """
        if self.issued < day:
            raise InputError(
                f"issued on {self.issued}, before the numbers of the test plan were confirmed on {day}",
                hint="correct the date issued, or date under [confirmation] of the plan",
            )

    @property
    def room(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of the conditions that may be rated, by their names there."""
        stated = {
            "air_degC": self.conditions.temperature_degC,
            "humidity_percent": self.conditions.relative_humidity_percent,
        }
        return {key: pair for key, pair in stated.items() if pair is not None}

    def check_room(self, coldest_degC: float, warmest_degC: float) -> None:
        """Check that the artefacts had about the temperature of the room.

        Raises
        ------
        InputError
            If not.
        """
        low, high = self.conditions.temperature_degC
        if coldest_degC < low - MOST_K_FROM_ROOM or warmest_degC > high + MOST_K_FROM_ROOM:
            raise InputError(
                f"the room was at {low:g} to {high:g} degC, artefacts at {coldest_degC:g} to {warmest_degC:g} degC",
                hint="correct temperature_degC under [conditions], or artefact_degC of the points",
            )


def read_administrative_data(path: str | Path) -> AdministrativeData:
    """Read the administrative data of a new certificate.

    Raises
    ------
    InputError
        If the file is missing or breaks a rule of its format; the message names all faults.
    """
    read = read_document(path, _NewFile)
    return AdministrativeData.model_validate({key: getattr(read, key) for key in AdministrativeData.model_fields})


class _NewFile(AdministrativeData):
    """The file of a new certificate, in which nothing may be missing."""

    set_up: SetUp


def template() -> str:
    """Return the text of such a file, to fill in."""
    return files("truearm.verification.certificate").joinpath("about.toml").read_text(encoding="utf-8")
