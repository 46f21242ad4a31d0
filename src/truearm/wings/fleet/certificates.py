"""Calibration certificates of a fleet's arms: number, day, verdict and when the next one is due."""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.wings.laboratory.certificate.calibration_certificate import CalibrationCertificate
from truearm.wings.laboratory.certificate.dcc_reader import MAX_BYTES
from truearm.wings.laboratory.certificate.statements import NOT_FOR_CONFORMITY
from truearm.wings.laboratory.pages.certificate_page import CONFORMITY_WORDS, NOT_DECIDED
from truearm.wings.laboratory.signatures.pdf_attachments import attached_xml, is_pdf
from truearm.wings.laboratory.verbs.certificate import read_certificate

NOT_STATED = "not stated"


@dataclass(frozen=True)
class RegisteredCertificate:
    """A calibration certificate of an arm.

    Attributes
    ----------
    serial_number : str
        Of the arm.
    number : str
        Of the certificate.
    issued : str
        Day of issue, or the last one of the calibration (ISO 8601).
    verdict : str
        ``conform``, ``not conform`` and so on; or that it states none.
    due : str
        Day by which the arm is to be calibrated again; empty if nobody states one.
    sha256 : str
        Of the XML file; of a PDF file, that of the XML file inside, which is the certificate.
    file : str
    """

    serial_number: str
    number: str
    issued: str
    verdict: str
    due: str
    sha256: str
    file: str

    @property
    def conforms(self) -> bool:
        """Whether it does not say the opposite."""
        return self.verdict != CONFORMITY_WORDS["fail"][0]


def read_registered(
    path: str | Path, arms: Iterable[str], *, due: datetime.date | None = None, trusted: str | Path | None = None
) -> RegisteredCertificate:
    """Read a digital calibration certificate (DCC, .xml or the .pdf that has it inside) of one of these arms.

    Parameters
    ----------
    path : path
    arms : iterable of str
        Serial numbers.
    due : date, optional
        Day of the next calibration; by default that which the certificate states.
    trusted : path, optional
        As `truearm.read_certificate` takes it.

    Raises
    ------
    InputError
        If it is no such certificate, its signature is broken, it is of none of the arms or of several, or lacks its
        number or day.
    """
    file = Path(path)
    made = read_certificate(file, trusted=trusted).certificate
    if isinstance(made, CalibrationCertificate):
        numbers = {number for item in made.items for _, number in item.numbers}
        number, issued, stated = made.number, made.issued or made.end, made.next_calibration
        verdict = NOT_STATED
    else:
        numbers = {made.about.item.serial_number}
        number, issued, stated = made.about.number, made.about.issued, None
        decided = NOT_DECIDED if made.conformity is None else CONFORMITY_WORDS[made.conformity]
        verdict = decided[0] if made.reservation is None else NOT_FOR_CONFORMITY
    found = sorted(numbers.intersection(arms))
    if len(found) != 1:
        raise InputError(
            f"expected the certificate of one arm of the fleet, got one of {', '.join(sorted(numbers)) or 'no number'}",
            file=file,
            hint="truearm fleet add adds an arm; its serial number is that of the certificate",
        )
    if not number or issued is None:
        raise InputError("the certificate states no number, or no day", file=file)
    day = due or stated
    if day is not None and day < issued:
        raise InputError(f"the next calibration, {day}, is due before the certificate of {issued}", file=file)
    content = read_limited(file, limit_bytes=MAX_BYTES)
    digest = sha256(attached_xml(content, limit_bytes=MAX_BYTES) if is_pdf(content) else content).hexdigest()
    return RegisteredCertificate(
        found[0], number, f"{issued}", verdict, "" if day is None else f"{day}", digest, f"{file.absolute()}"
    )
