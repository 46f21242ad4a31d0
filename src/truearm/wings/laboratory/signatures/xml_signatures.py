"""Signatures of XML files (XMLDSig, XAdES): made by signxml, verified here; an answer of three.

*Good*: the value of the signature and all digests are right, and they cover the whole document. *Broken*: one is wrong,
or content is not covered. *Not verifiable here*: neither can be said, with the reason.

A file from others may pretend to be signed. So the signature is a child of the root and covers the document with what
stands outside of its root, and whoever reads the file gets the content that was verified, never the file (W3C, XML
Signature Best Practices, 2013, practices 4, 7, 14). Why not signxml verifies: it digests the root alone, so that a
processing instruction before it goes unnoticed, and passes over transforms that it does not know.
"""

from __future__ import annotations

import datetime
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from truearm.errors import InputError
from truearm.wings.laboratory.signatures.x509_certificates import (
    MAX_CERTIFICATES,
    Signer,
    chain_to_trusted,
    is_elliptic,
    may_sign,
    package,
    read_certificates,
    weak_key,
)
from truearm.wings.laboratory.signatures.xml_references import (
    DSIG,
    BrokenSignature,
    UnverifiedSignature,
    algorithm,
    canonical,
    check_size,
    covered,
    decoded,
    parse_signed,
    unknown,
)

GOOD, NOT_VERIFIABLE, BROKEN = "good", "not verifiable here", "broken"
_XADES = "{http://uri.etsi.org/01903/v1.3.2#}"
# Signed properties that say nothing against the signature; the first three are checked (ETSI EN 319 132-1, 5.2).
_PROPERTIES = (
    "SigningTime",
    "SigningCertificate",
    "SigningCertificateV2",
    "SignatureProductionPlace",
    "SignatureProductionPlaceV2",
    "SignerRole",
    "SignerRoleV2",
    "DataObjectFormat",
    "CommitmentTypeIndication",
)
_METHODS = {
    f"http://www.w3.org/2001/04/xmldsig-more#{kind}-sha{bits}": (kind, f"SHA{bits}")
    for kind in ("rsa", "ecdsa")
    for bits in (256, 384, 512)
}


@dataclass(frozen=True)
class Signature:
    """A signature of a file, good or not verifiable here; a broken one is an error.

    Attributes
    ----------
    answer : str
        ``"good"`` or ``"not verifiable here"``.
    reason : str
        Why it is not verifiable; empty if it is good. The other attributes are then empty.
    signer, issuer : str
        Subject of the signer's certificate, and who issued it; the same if the signer did.
    fingerprint : str
        SHA-256 of the certificate, in hexadecimal digits.
    valid_from, valid_until : date
        Days from and until which the certificate, and all of its chain, are valid.
    trusted : bool
        Whether the certificate is one that the reader has given, or there is a chain to one. Otherwise it is only the
        one in the file: anybody can make a certificate with any name.
    authority : str
        Subject of the trusted certificate at the end of the chain; empty if the signer's own is trusted or none is.
    signed_at : datetime or None
        When it was made, as the signer states it (XAdES); None if the signature states no time.
    periods : tuple of (str, date, date)
        Subject, first and last day of each certificate of the chain, the signer's first.
    """

    answer: str
    reason: str = ""
    signer: str = ""
    issuer: str = ""
    fingerprint: str = ""
    valid_from: datetime.date | None = None
    valid_until: datetime.date | None = None
    trusted: bool = False
    authority: str = ""
    signed_at: datetime.datetime | None = None
    periods: tuple[tuple[str, datetime.date, datetime.date], ...] = ()

    def covers(self, day: datetime.date | None) -> bool:
        """Whether the signer's certificate was valid: when it signed, as was checked, else on the day of issue."""
        if self.signed_at is not None:
            return True
        if day is None or self.valid_from is None or self.valid_until is None:
            return False
        return self.valid_from <= day <= self.valid_until

    def describe_periods(self, day: datetime.date | None) -> str:
        """Describe when the certificates were valid that were not on a day; all of them if the day is not known."""
        whose = (
            "its signer's certificate",
            *(f"the certificate of the authority {one}" for one, *_ in self.periods[1:]),
        )
        return "; ".join(
            f"{certificate} is valid from {first} to {last}"
            for certificate, (_, first, last) in zip(whose, self.periods, strict=False)
            if day is None or not first <= day <= last
        )

    def describe(self) -> str:
        """Describe in a sentence whether it is good, who made it, and when."""
        if self.answer != GOOD:
            return f"The signature is {self.answer}: {self.reason}. Read the file as one that is not signed."
        known = f"by its own certificate: compare the fingerprint with the signer's, SHA-256 {self.fingerprint}"
        if self.trusted:
            known = "with the certificate that you trust"
        if self.authority:
            known = (
                f"by a chain to {self.authority}, which you trust; nobody was asked whether a certificate was revoked"
            )
        issued = "" if self.issuer == self.signer else f", certificate issued by {self.issuer}"
        when = (
            "time not stated"
            if self.signed_at is None
            else f"on {self.signed_at:%Y-%m-%d %H:%M %Z} as the signer states"
        )
        return f"The signature is good; signed by {self.signer}{issued}, {when}; verified {known}."


class _Properties(NamedTuple):
    """Signed properties of XAdES: when it was signed, and digests of the signer's certificate by their algorithm."""

    signed_at: datetime.datetime | None = None
    digests: Sequence[tuple[str, bytes]] = ()


def sign_xml(content: bytes, signer: Signer) -> bytes:
    """Return an XML document with a signature of all of it as the last child of its root."""
    signxml, etree = package("signxml"), package("lxml.etree")
    methods = signxml.SignatureMethod
    method = methods.ECDSA_SHA256 if is_elliptic(signer.key) else methods.RSA_SHA256
    root = parse_signed(_plain_xml(content).encode()).getroot()
    signed = signxml.XMLSigner(signature_algorithm=method).sign(
        root, key=signer.key, cert=[signer.certificate, *signer.chain]
    )
    written: bytes = etree.tostring(signed, encoding="utf-8", xml_declaration=True)
    return written + b"\n"


def verified_content(content: bytes, *, trusted: str | Path | None = None) -> tuple[bytes, Signature | None]:
    """Return what a document's signature signs, and the signature; or the document and None if there is none.

    Parameters
    ----------
    content : bytes
    trusted : path, optional
        Certificates (PEM): of the signer, or of the certification authority at the end of a chain from the signer's.
        Without it that in the file is taken, which proves that nothing was changed since, but not who signed.

    Returns
    -------
    bytes, Signature or None
        The whole document if the signature is not verifiable here: as little is known of it as of one without.

    Raises
    ------
    BrokenSignature
        If the signature is broken.
    UnverifiedSignature
        If it is not verifiable here, and there is a `trusted`.
    InputError
        If the document is no XML, or is not signed although there is a `trusted`.
    MissingTool
        If the document is signed and signxml is not installed.
    """
    text = _plain_xml(content)
    try:
        root = ET.fromstring(text)  # noqa: S314, it has no document type
    except (ET.ParseError, ValueError) as error:
        line = error.position[0] if isinstance(error, ET.ParseError) else None
        raise InputError(f"not valid XML: {error}", line=line) from None
    if next(root.iter(f"{DSIG}Signature"), None) is None:
        if trusted is not None:
            raise InputError("the file is not signed", hint="ask its issuer for the signed one")
        return content, None
    known = () if trusted is None else read_certificates(trusted)
    check_size(text)
    try:
        return _verified(parse_signed(text.encode()), known)
    except BrokenSignature as error:
        hint = "do not use this file, ask its issuer for the original"
        raise BrokenSignature(f"the signature is {BROKEN}: {error.problem}", hint=hint) from None
    except UnverifiedSignature as error:
        if not known:
            return content, Signature(NOT_VERIFIABLE, error.problem)
        hint = "give the certificate of the signer, or of the authority that issued it, with --trusted"
        raise UnverifiedSignature(
            f"the signature is {NOT_VERIFIABLE}: {error.problem}", hint=error.hint or hint
        ) from None


def _verified(tree: Any, trusted: Sequence[Any]) -> tuple[bytes, Signature]:
    """What the signature of a document covers, and the signature, if it is good."""
    root = tree.getroot()
    signatures = root.findall(f"{DSIG}Signature")
    if not signatures:
        raise BrokenSignature("it is not a child of the root, so it is one of another document")
    if len(signatures) > 1:
        raise UnverifiedSignature(f"the file has {len(signatures)} signatures, and truearm verifies files with one")
    signature = signatures[0]
    signed_info = _only(signature, "SignedInfo")
    included = _certificates(signature)
    holders = _holders_of_the_key(signature, signed_info, trusted, included)
    content = covered(tree, signature, signed_info.findall(f"{DSIG}Reference"))
    properties = _properties(content.elements.get(f"{_XADES}SignedProperties"))
    named = _named_certificates(properties, holders)
    renewed = [one for one in holders if one in trusted and one not in named]
    return content.document, _judged([*named, *renewed], trusted, included, properties.signed_at)


def _holders_of_the_key(signature: Any, signed_info: Any, trusted: Sequence[Any], included: Sequence[Any]) -> list[Any]:
    """The certificates of the key with which the value of a signature was made."""
    method = algorithm(_only(signed_info, "SignatureMethod"))
    if method not in _METHODS:
        raise unknown("method", method)
    data = canonical(signed_info, _only(signed_info, "CanonicalizationMethod"), comments=True)
    value = decoded(_only(signature, "SignatureValue").text or "")
    holders = [one for one in (*trusted, *included) if _verifies(one, *_METHODS[method], value, data)]
    if not holders and not included:
        raise UnverifiedSignature("the file contains no certificate of its signer")
    if not holders:
        raise BrokenSignature("its value is not that of a key whose certificate is in the file")
    return holders


def _verifies(certificate: Any, kind: str, digest: str, value: bytes, data: bytes) -> bool:
    """Whether the key of a certificate made the value of a signature."""
    primitives = "cryptography.hazmat.primitives"
    hashes, elliptic = package(f"{primitives}.hashes"), package(f"{primitives}.asymmetric.ec")
    padding, utils = package(f"{primitives}.asymmetric.padding"), package(f"{primitives}.asymmetric.utils")
    digest = getattr(hashes, digest)()
    try:
        key = certificate.public_key()
        if is_elliptic(key) != (kind == "ecdsa"):
            return False
        if kind == "rsa":
            key.verify(value, data, padding.PKCS1v15(), digest)
            return True
        size = (key.key_size + 7) // 8
        if len(value) != 2 * size:
            return False
        both = utils.encode_dss_signature(int.from_bytes(value[:size]), int.from_bytes(value[size:]))
        key.verify(both, data, elliptic.ECDSA(digest))
    except Exception:  # certificates of others fail in many ways, none of which makes the value right
        return False
    return True


def _certificates(signature: Any) -> list[Any]:
    """Certificates that a signature brings along: the signer's, and those that may stand in its chain."""
    load = package("cryptography.x509").load_der_x509_certificate
    texts = [one.text or "" for one in signature.iter(f"{DSIG}X509Certificate", f"{_XADES}EncapsulatedX509Certificate")]
    found = []
    for text in texts[:MAX_CERTIFICATES]:
        with suppress(ValueError, TypeError):  # one that nobody can read names no signer
            found.append(load(decoded(text)))
    return found


def _properties(content: bytes | None) -> _Properties:
    """Read the signed properties of XAdES, in canonical form as they were verified."""
    if content is None:
        return _Properties()
    root = parse_signed(content).getroot()
    for group in root:
        for one in group:
            if one.tag not in (f"{_XADES}{name}" for name in _PROPERTIES):
                name = str(one.tag).rpartition("}")[2]
                raise UnverifiedSignature(f"truearm cannot check its property {name:.80}")
    digests = []
    for one in root.iter(f"{_XADES}CertDigest"):
        method, value = one.find(f"{DSIG}DigestMethod"), one.findtext(f"{DSIG}DigestValue")
        if method is not None and value is not None:
            digests.append((algorithm(method).rpartition("#")[2].upper(), decoded(value)))
    return _Properties(_time(root.findtext(f".//{_XADES}SigningTime")), digests)


def _time(text: str | None) -> datetime.datetime | None:
    """A time of XML Schema; in UTC if it has no zone."""
    if text is None:
        return None
    try:
        time = datetime.datetime.fromisoformat(text.strip())
    except ValueError:
        raise UnverifiedSignature(f"it states no time of signature that truearm can read ({text!r:.40})") from None
    return time if time.tzinfo is not None else time.replace(tzinfo=datetime.UTC)


def _named_certificates(properties: _Properties, holders: Sequence[Any]) -> Sequence[Any]:
    """The certificates of a key that the signature names as the signer's; all of them if it names none."""
    if not properties.digests:
        return holders
    name, value = properties.digests[0]
    if name not in ("SHA256", "SHA384", "SHA512"):
        raise UnverifiedSignature(f"it names the signer's certificate by {name!r:.40}, which is not supported")
    digest = getattr(package("cryptography.hazmat.primitives.hashes"), name)()
    named = [one for one in holders if one.fingerprint(digest) == value]
    if not named:
        raise BrokenSignature("the certificate in the file is not the one with which it was signed")
    return named


def _judged(
    holders: Sequence[Any], trusted: Sequence[Any], included: Sequence[Any], signed_at: datetime.datetime | None
) -> Signature:
    """The good signature of one of some certificates with the same key: who made it, and for whom that is known."""
    chains = [chain for one in holders if (chain := chain_to_trusted(one, trusted, included))]
    chain = min(chains, key=len) if chains else tuple(holders[:1])
    signer, last = chain[0], chain[-1]
    name, issuer = _one_line(signer.subject), _one_line(signer.issuer)
    if trusted and not chains:
        raise UnverifiedSignature(
            f"it is by {name}, whose certificate, issued by {issuer}, is not one that you trust and has no chain to one"
        )
    if weakness := weak_key(signer.public_key()):
        raise UnverifiedSignature(weakness)
    if not may_sign(signer):
        raise UnverifiedSignature(f"the certificate of {name} is not for signatures, or cannot be read")
    begin = max(one.not_valid_before_utc for one in chain)
    end = min(one.not_valid_after_utc for one in chain)
    made = Signature(
        answer=GOOD,
        signer=name,
        issuer=issuer,
        fingerprint=signer.fingerprint(package("cryptography.hazmat.primitives.hashes").SHA256()).hex(),
        valid_from=begin.date(),
        valid_until=end.date(),
        trusted=bool(chains),
        authority=_one_line(last.subject) if len(chain) > 1 else "",
        signed_at=signed_at,
        periods=tuple(
            (_one_line(one.subject), one.not_valid_before_utc.date(), one.not_valid_after_utc.date()) for one in chain
        ),
    )
    if signed_at is not None and not begin <= signed_at <= end:
        day = signed_at.astimezone(datetime.UTC).date()
        raise UnverifiedSignature(
            f"{name} signed it on {day}; {made.describe_periods(day) or 'its certificate was not valid at that hour'}",
            hint="ask the signer for a signature with a certificate that is valid on its day",
        )
    return made


def _only(element: Any, tag: str) -> Any:
    """The only child of an element of a signature."""
    found = element.findall(f"{DSIG}{tag}")
    if len(found) != 1:
        raise BrokenSignature(f"expected one <{tag}> in it, got {len(found)}")
    return found[0]


def _one_line(name: Any) -> str:
    """A name of a certificate as text that a terminal can show."""
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in name.rfc4514_string())


def _plain_xml(content: bytes) -> str:
    """The text of an XML file in UTF-8 without a document type."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("expected UTF-8 text") from None
    # Decoded first, so that no other encoding can hide it; a text that only mentions it is refused too.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("a certificate contains no DOCTYPE or ENTITY; truearm refuses such files")
    return text
