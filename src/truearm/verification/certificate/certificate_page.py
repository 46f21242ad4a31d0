"""The page of a calibration certificate: the administrative data and the verification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from truearm.pages.page import Column, Page, Section, Table
from truearm.verification.certificate.administrative_data import Contact, Person
from truearm.verification.certificate.certificate import Certificate
from truearm.verification.standards.verification import Verification
from truearm.verification.standards.verification_page import verification_page


def certificate_page(
    certificate: Certificate, verification: Verification, *, facts: Sequence[tuple[str, str]] = ()
) -> Page:
    """Lay out the page of a calibration certificate.

    Parameters
    ----------
    certificate : Certificate
    verification : Verification
        The one that it states.
    facts : sequence of (str, str)
        Certificate, plan, files with their SHA-256, versions.
    """
    page = verification_page(verification, facts=facts)
    lists = administrative_sections(certificate)
    lines = [("" if at else title, *row) for title, rows in lists for at, row in enumerate(rows)]
    table = Table((Column("subject"), Column("entry"), Column("stated")), tuple(lines), "")
    return replace(
        page,
        title=f"Calibration certificate {certificate.about.number}",
        subtitle=f"{verification.specification.name}. {page.subtitle}",
        sections=(Section("Certificate", tables=(table,)), *page.sections),
    )


def administrative_sections(certificate: Certificate) -> tuple[tuple[str, tuple[tuple[str, str], ...]], ...]:
    """Return the administrative data as titled lists of (entry, text)."""
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
