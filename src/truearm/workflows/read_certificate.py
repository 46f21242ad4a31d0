"""`certificate --read`: what a digital calibration certificate states, and whether its signature is good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from truearm.files.xml_signatures import Signature
from truearm.show.certificate_page import CONFORMITY_WORDS, NOT_DECIDED
from truearm.solve.threads import one_blas_thread
from truearm.verification.certificate.certificate import Certificate
from truearm.verification.certificate.dcc_reader import read_dcc_file
from truearm.verification.certificate.statements import NOT_FOR_CONFORMITY
from truearm.workflows.record import Record, to_plain


@dataclass(frozen=True, eq=False, repr=False)
class ReadCertificate(Record):
    """A certificate that was read.

    Attributes
    ----------
    certificate : Certificate
        All that it states: `results`, `conformity`, `about` and so on.
    signature : Signature or None
        Who signed it, and whether with the certificate that the reader trusts; None if it is not signed.
    """

    certificate: Certificate
    signature: Signature | None

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        made, about = self.certificate, self.certificate.about
        verdict = NOT_DECIDED[0] if made.conformity is None else CONFORMITY_WORDS[made.conformity][0]
        if made.reservation is not None:
            verdict = NOT_FOR_CONFORMITY
        yield f"certificate {about.number}, {verdict}"
        yield describe_signature(self.signature)
        item = about.item
        yield f"{item.name} {item.maker} {item.model}, serial number {item.serial_number}"
        yield f"issued on {about.issued} by {about.laboratory.name}; measured from {made.begin} to {made.end}"
        yield from (one.text for one in made.statements if one.kind in ("reservation", "decision"))

    def to_dict(self) -> dict[str, Any]:
        """See `Record`."""
        made = self.certificate
        return {
            "number": made.about.number,
            "issued": made.about.issued.isoformat(),
            "serial_number": made.about.item.serial_number,
            "conformity": made.conformity,
            "reservation": made.reservation,
            "signature": None if self.signature is None else to_plain(_with_text_dates(self.signature)),
        }


@one_blas_thread()
def read_certificate(path: str | Path, *, trusted: str | Path | None = None) -> ReadCertificate:
    """Read a digital calibration certificate of this program and verify its signature.

    Parameters
    ----------
    path : path
    trusted : path, optional
        Certificate (PEM) of the signer; a file that is not signed with its key is refused.

    Raises
    ------
    InputError
        If the file is no such certificate, or its signature is broken.
    MissingTool
        If the file is signed and signxml is not installed.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.read_certificate("certificate.xml", trusted="signer.pem")
    Traceback (most recent call last):
    truearm.errors.InputError: certificate.xml: the file does not exist
    """
    read = read_dcc_file(path, trusted=trusted)
    return ReadCertificate(read.certificate, read.signature)


def describe_signature(signature: Signature | None) -> str:
    """Describe in a sentence who signed a file."""
    if signature is None:
        return "The file is not signed: anybody can have changed it."
    known = (
        "with the certificate that you trust"
        if signature.trusted
        else f"by its own certificate: compare the fingerprint with the signer's, SHA-256 {signature.fingerprint}"
    )
    issued = "" if signature.issuer == signature.signer else f", certificate issued by {signature.issuer}"
    return f"The signature is good; signed by {signature.signer}{issued}; verified {known}."


def _with_text_dates(signature: Signature) -> dict[str, Any]:
    return {
        key: value if isinstance(value, str | bool) else value.isoformat() for key, value in vars(signature).items()
    }
