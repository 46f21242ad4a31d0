"""Signatures of XML files: one enveloped XMLDSig signature of the whole document, made and verified by signxml.

A file from others may pretend to be signed. So the signature must be the only one and a child of the root, it must sign
the document itself (reference ""), by no transformation but its own removal and canonicalization, and whoever reads the
file gets the signed content that was verified, never the file (W3C, XML Signature Best Practices, 2013, practices 4, 7,
14).
"""

from __future__ import annotations

import datetime
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from truearm.errors import InputError, MissingTool
from truearm.files.file_reading import read_limited

MAX_PEM_BYTES = 100_000
LEAST_RSA_BITS = 2048
LEAST_CURVE_BITS = 256
_GOOD_KEYS = (
    f"a key for RSA of {LEAST_RSA_BITS} bits or more, or for an elliptic curve of {LEAST_CURVE_BITS} bits or more"
)
_DSIG = "{http://www.w3.org/2000/09/xmldsig#}"
_ENVELOPED = "http://www.w3.org/2000/09/xmldsig#enveloped-signature"
_METHODS = ("RSA_SHA256", "RSA_SHA384", "RSA_SHA512", "ECDSA_SHA256", "ECDSA_SHA384", "ECDSA_SHA512")
_BROKEN = "the signature is broken: do not use this file"


@dataclass(frozen=True)
class Signature:
    """A verified signature.

    Attributes
    ----------
    signer, issuer : str
        Subject of the signer's certificate, and who issued it; the same if the signer did.
    fingerprint : str
        SHA-256 of the certificate, in hexadecimal digits.
    valid_from, valid_until : date
        Days from and until which the certificate is valid.
    trusted : bool
        Whether it was verified with a certificate that the reader has given. Otherwise with the one in the file:
        anybody can make a certificate with any name.
    """

    signer: str
    issuer: str
    fingerprint: str
    valid_from: datetime.date
    valid_until: datetime.date
    trusted: bool


@dataclass(frozen=True)
class Signer:
    """A private key with its certificate, in memory only; `read_signer` reads both.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.Signer(certificate="a certificate", key="a secret")  # the key is not shown
    Signer(certificate='a certificate')
    """

    certificate: Any
    key: Any = field(repr=False)

    @property
    def signature(self) -> Signature:
        """What a reader sees of it."""
        return _signature(self.certificate, trusted=True)


def read_signer(key: str | Path, certificate: str | Path, *, password: str | None = None) -> Signer:
    """Read a private key and its certificate, to sign certificates with: ``certificate(..).save(.., signer=)``.

    Parameters
    ----------
    key, certificate : path
        PEM files: a key for RSA (2048 bits or more) or an elliptic curve (256 bits or more), and the X.509 certificate
        of that key.
    password : str, optional
        Of an encrypted key.

    Raises
    ------
    MissingTool
        If signxml is not installed.
    InputError
        If a file is missing or not such a file, the password is missing or wrong, or the two do not belong together.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.read_signer("key.pem", "signer.pem")
    Traceback (most recent call last):
    truearm.errors.InputError: key.pem: the file does not exist
    """
    _package("signxml")
    serialization = _package("cryptography.hazmat.primitives.serialization")
    content = read_limited(key, limit_bytes=MAX_PEM_BYTES)
    try:
        private = serialization.load_pem_private_key(content, None if password is None else password.encode())
    except TypeError:
        problem = "the key is encrypted" if password is None else "the key is not encrypted, and a password was given"
        raise InputError(problem, file=key, hint="give the password of the key, if it has one") from None
    except Exception:  # what OpenSSL finds wrong with a key has many types; none of them shows the key
        wrong = "the password is wrong, or the file is no private key (PEM)"
        raise InputError(wrong if password else "expected a private key (PEM)", file=key) from None
    _check_key(private, key)
    known = _read_certificate(certificate)
    if known.public_key() != private.public_key():
        raise InputError(
            "the certificate does not belong to the key", file=certificate, hint=f"give the certificate of {key}"
        )
    return Signer(known, private)


def is_encrypted(key: str | Path) -> bool:
    """Whether a key file needs a password."""
    return b"ENCRYPTED" in read_limited(key, limit_bytes=MAX_PEM_BYTES)


def sign_xml(content: bytes, signer: Signer) -> bytes:
    """Return an XML document with a signature of all of it as the last child of its root."""
    signxml, etree = _package("signxml"), _package("lxml.etree")
    methods = signxml.SignatureMethod
    method = methods.ECDSA_SHA256 if _is_elliptic(signer.key) else methods.RSA_SHA256
    root = etree.fromstring(_plain_xml(content).encode(), _parser(etree))
    signed = signxml.XMLSigner(signature_algorithm=method).sign(root, key=signer.key, cert=[signer.certificate])
    written: bytes = etree.tostring(signed, encoding="utf-8", xml_declaration=True)
    return written + b"\n"


def verified_content(content: bytes, *, trusted: str | Path | None = None) -> tuple[bytes, Signature | None]:
    """Return what a document's signature signs, and the signature; or the document and None if there is none.

    Parameters
    ----------
    content : bytes
    trusted : path, optional
        Certificate (PEM) of the signer; without it that in the file is taken, which proves that nothing was changed
        since, but not who signed.

    Raises
    ------
    InputError
        If the signature is broken, is not one of the whole document, or is missing although there is a `trusted` one.
    MissingTool
        If the document is signed and signxml is not installed.
    """
    try:
        root = ET.fromstring(_plain_xml(content))  # noqa: S314, it has no document type
    except (ET.ParseError, ValueError) as error:
        line = error.position[0] if isinstance(error, ET.ParseError) else None
        raise InputError(f"not valid XML: {error}", line=line) from None
    signatures = list(root.iter(f"{_DSIG}Signature"))
    if not signatures:
        if trusted is not None:
            raise InputError("the file is not signed", hint="ask its issuer for the signed one")
        return content, None
    _check_whole(root, signatures)
    pinned = None if trusted is None else _read_certificate(trusted)
    return _verified(content, signatures[0], pinned)


def _check_whole(root: ET.Element, signatures: list[ET.Element]) -> None:
    """Check that there is one signature, and that it signs the whole document."""
    if len(signatures) > 1 or signatures[0] not in list(root):
        raise InputError("expected one signature, of the whole document", hint="do not use this file")
    references = list(signatures[0].iter(f"{_DSIG}Reference"))
    if len(references) != 1 or references[0].get("URI") != "":
        raise InputError("the signature is not one of the whole document", hint="do not use this file")
    transforms = [one.get("Algorithm", "") for one in references[0].iter(f"{_DSIG}Transform")]
    others = [one for one in transforms if one != _ENVELOPED and "c14n" not in one]
    if _ENVELOPED not in transforms or others or "WithComments" in "".join(transforms):
        raise InputError("the signature is not one of the whole document", hint="do not use this file")


def _verified(content: bytes, signature: ET.Element, pinned: Any | None) -> tuple[bytes, Signature]:
    signxml, x509 = _package("signxml"), _package("cryptography.x509")
    try:
        certificate = pinned
        if certificate is None:
            text = "".join((signature.findtext(f".//{_DSIG}X509Certificate") or "").split())
            pem = f"-----BEGIN CERTIFICATE-----\n{text}\n-----END CERTIFICATE-----\n"
            certificate = x509.load_pem_x509_certificate(pem.encode())
        _check_key(certificate.public_key(), None)
        expected = signxml.SignatureConfiguration(
            location="./",
            expect_references=1,
            signature_methods=frozenset(signxml.SignatureMethod[name] for name in _METHODS),
            # Archives outlive certificates: who reads the content compares its day with the certificate's.
            verification_time=certificate.not_valid_before_utc,
        )
        found = signxml.XMLVerifier().verify(
            _plain_xml(content).encode(),
            x509_cert=certificate,
            expect_config=expected,
            parser=_parser(_package("lxml.etree")),
        )
    except MissingTool:
        raise
    except Exception as error:  # hostile files fail in many ways, none of which makes the signature a good one
        reason = (
            "it is not by the signer whose certificate you trust, or the file was changed" if pinned else str(error)
        )
        raise InputError(f"{_BROKEN} ({reason:.200})", hint="ask its issuer for the original") from None
    return bytes(found.signed_data), _signature(certificate, trusted=pinned is not None)


def _check_key(key: Any, file: str | Path | None) -> None:
    """Check that a key is of a kind and a size that is good for signatures."""
    rsa = _package("cryptography.hazmat.primitives.asymmetric.rsa")
    if _is_elliptic(key):
        least = LEAST_CURVE_BITS
    elif isinstance(key, rsa.RSAPrivateKey | rsa.RSAPublicKey):
        least = LEAST_RSA_BITS
    else:
        raise InputError("expected a key for RSA or an elliptic curve", file=file, hint=f"make {_GOOD_KEYS}")
    if (bits := key.key_size) < least:
        raise InputError(f"the key has {bits} bits, fewer than {least}", file=file, hint=f"make {_GOOD_KEYS}")


def _is_elliptic(key: Any) -> bool:
    elliptic = _package("cryptography.hazmat.primitives.asymmetric.ec")
    return isinstance(key, elliptic.EllipticCurvePrivateKey | elliptic.EllipticCurvePublicKey)


def _read_certificate(path: str | Path) -> Any:
    content = read_limited(path, limit_bytes=MAX_PEM_BYTES)
    try:
        return _package("cryptography.x509").load_pem_x509_certificate(content)
    except ValueError:
        raise InputError("expected an X.509 certificate (PEM)", file=path) from None


def _signature(certificate: Any, *, trusted: bool) -> Signature:
    digest = certificate.fingerprint(_package("cryptography.hazmat.primitives.hashes").SHA256())
    return Signature(
        _one_line(certificate.subject.rfc4514_string()),
        _one_line(certificate.issuer.rfc4514_string()),
        digest.hex(),
        certificate.not_valid_before_utc.date(),
        certificate.not_valid_after_utc.date(),
        trusted,
    )


def _one_line(name: str) -> str:
    """A name of a certificate as text that a terminal can show."""
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in name)


def _plain_xml(content: bytes) -> str:
    """The text of an XML file in UTF-8 without a document type, without its declaration."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("expected UTF-8 text") from None
    # Decoded first, so that no other encoding can hide it; a text that only mentions it is refused too.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("a certificate contains no DOCTYPE or ENTITY; truearm refuses such files")
    return text


def _parser(etree: Any) -> Any:
    """A parser that expands no entity and loads nothing."""
    return etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, encoding="utf-8")


def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise MissingTool(
            "signatures need the package signxml, which is not installed", hint="pip install 'truearm[sign]'"
        ) from None
