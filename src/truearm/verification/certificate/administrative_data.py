"""What a certificate says beside the results: number, days, place, the arm, laboratory, customer, persons, conditions.

The file (TOML, docs/certificate.md) is written by hand; `template` is one to fill in.
"""

from __future__ import annotations

import datetime
import re
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from truearm.errors import InputError
from truearm.files.toml_documents import Document, Real, read_document
from truearm.verification.standards.dates import check_past

# An artefact that has lain in a room for some hours is no further from the temperature of its air [K].
MOST_K_FROM_ROOM = 3.0
# What XML 1.0 cannot hold (its production 2), lone surrogates included.
_NOT_XML = re.compile("[^\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")


def xml_text(text: str) -> str:
    """Give a text on one line that XML can hold: single spaces, and a sign for every character that it cannot hold."""
    return _NOT_XML.sub("\ufffd", " ".join(text.split()))


def _filled_in(text: str) -> str:
    if not text.strip():
        raise InputError("it is empty", hint="fill it in")
    return xml_text(text)


def _country(text: str) -> str:
    text = _filled_in(text)
    if not re.fullmatch("[A-Z]{2}", text):
        raise InputError(f"expected two capital letters, got {text!r:.80}", hint="DE, FR, JP: a code of ISO 3166-1")
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
    """Who measured; `code` is that of its accreditation."""

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

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for key, pair, least, most in (
            ("temperature_degC", self.temperature_degC, -50, 100),
            ("relative_humidity_percent", self.relative_humidity_percent, 0, 100),
        ):
            if pair is not None and not least <= pair[0] <= pair[1] <= most:
                got = f"{pair[0]:g} and {pair[1]:g}"
                raise InputError(f"{key}: expected the lowest and the highest, from {least} to {most}, got {got}")
        return self


class AdministrativeData(Document):
    """What a certificate says beside the results.

    Attributes
    ----------
    number : str
        Of the certificate; unique.
    issued, received : date
        Of signing it; of the arm's coming, None if not known.
    place : str
        Where it was measured.
    item : Item
    laboratory, customer : Contact
    persons : tuple of Person
    conditions : Conditions
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

    @field_validator("issued")
    @classmethod
    def _signed_by_now(cls, day: datetime.date) -> datetime.date:
        check_past(day)
        return day

    @model_validator(mode="after")
    def _signed_after_it_came(self) -> Self:
        if not any(person.main_signer for person in self.persons):
            raise InputError("nobody signs it", hint="main_signer = true for one of the persons")
        if self.received is not None and self.issued < self.received:
            raise InputError(f"issued on {self.issued}, before the arm came on {self.received}")
        return self

    def check_days(self, begin: datetime.date, end: datetime.date) -> None:
        """Check that the arm came before it was measured, and the certificate was issued after.

        Raises
        ------
        InputError
            If not.
        """
        if self.issued < end:
            raise InputError(f"issued on {self.issued}, before the last points were taken on {end}")
        if self.received is not None and self.received > begin:
            raise InputError(f"the arm came on {self.received}, after points were taken on {begin}")

    def check_room(self, coldest_degC: float, warmest_degC: float) -> None:
        """Check that artefacts were about as warm as the room, in which they are left until they are.

        Raises
        ------
        InputError
            If not.
        """
        low, high = self.conditions.temperature_degC
        if coldest_degC < low - MOST_K_FROM_ROOM or warmest_degC > high + MOST_K_FROM_ROOM:
            raise InputError(
                f"the room was at {low:g} to {high:g} degC, artefacts at {coldest_degC:g} to {warmest_degC:g} degC",
                hint="temperature_degC under [conditions], or artefact_degC of the points",
            )


def read_administrative_data(path: str | Path) -> AdministrativeData:
    """Read the file of what a certificate says beside the results.

    Raises
    ------
    InputError
        If the file is missing or breaks a rule of its format; what is not filled in is named.
    """
    return read_document(path, AdministrativeData)


def template() -> str:
    """The text of such a file to fill in."""
    return files("truearm.verification.certificate").joinpath("about.toml").read_text(encoding="utf-8")
