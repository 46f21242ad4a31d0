"""X.509 certificates: a signer's key with its certificate, and the chain to a certificate that the reader trusts.

`cryptography.x509.verification` is for servers of the web: it demands host names. Here are the checks of RFC 5280,
section 6, that a chain without name constraints and policies needs; a chain with others is not verifiable here.
Nobody asks whether a certificate was revoked: truearm uses no network.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from truearm.errors import InputError, extra_module
from truearm.files.file_reading import read_limited

MAX_PEM_BYTES = 100_000
MAX_CERTIFICATES = 20  # of one file
LEAST_RSA_BITS = 2048
LEAST_CURVE_BITS = 256
_GOOD_KEYS = (
    f"a key for RSA of {LEAST_RSA_BITS} bits or more, or for an elliptic curve of {LEAST_CURVE_BITS} bits or more"
)
_GOOD_HASHES = ("sha256", "sha384", "sha512")
# Critical extensions that are checked here, or say nothing about who may sign.
_KNOWN_EXTENSIONS = (
    "2.5.29.15",
    "2.5.29.17",
    "2.5.29.19",
    "2.5.29.37",
)  # key usage, names, constraints, extended usage


@dataclass(frozen=True)
class Signer:
    """A private key with its certificate, in memory only; `read_signer` reads both.

    Attributes
    ----------
    certificate, key : objects of cryptography
    chain : sequence of objects of cryptography
        Certificates of the authorities between the signer and one that readers trust, which a signed file brings along.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.Signer(certificate="a certificate", key="a secret")  # the key is not shown
    Signer(certificate='a certificate')
    """

    certificate: Any
    key: Any = field(repr=False)
    chain: Sequence[Any] = field(default=(), repr=False)


def read_signer(key: str | Path, certificate: str | Path, *, password: str | None = None) -> Signer:
    """Read a private key and its certificate, to sign certificates with: ``certificate(..).save(.., signer=)``.

    Parameters
    ----------
    key, certificate : path
        PEM files: a key for RSA (2048 bits or more) or an elliptic curve (256 bits or more), and the X.509 certificate
        of that key, first or alone; others of the file are those of the chain above it.
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
    package("signxml")
    serialization = package("cryptography.hazmat.primitives.serialization")
    content = read_limited(key, limit_bytes=MAX_PEM_BYTES)
    try:
        private = serialization.load_pem_private_key(content, None if password is None else password.encode())
    except TypeError:
        problem = "the key is encrypted" if password is None else "the key is not encrypted, and a password was given"
        raise InputError(problem, file=key, hint="give the password of the key, if it has one") from None
    except Exception:  # what OpenSSL finds wrong with a key has many types; none of them shows the key
        wrong = "the password is wrong, or the file is no private key (PEM)"
        raise InputError(wrong if password else "expected a private key (PEM)", file=key) from None
    if weakness := weak_key(private):
        raise InputError(weakness, file=key, hint=f"make {_GOOD_KEYS}")
    known, *chain = read_certificates(certificate)
    if known.public_key() != private.public_key():
        raise InputError(
            "the certificate does not belong to the key", file=certificate, hint=f"give the certificate of {key}"
        )
    return Signer(known, private, tuple(chain))


def is_encrypted(key: str | Path) -> bool:
    """Whether a key file needs a password."""
    return b"ENCRYPTED" in read_limited(key, limit_bytes=MAX_PEM_BYTES)


def read_certificates(path: str | Path) -> tuple[Any, ...]:
    """The X.509 certificates of a PEM file, one or more."""
    content = read_limited(path, limit_bytes=MAX_PEM_BYTES)
    try:
        return tuple(package("cryptography.x509").load_pem_x509_certificates(content)[:MAX_CERTIFICATES])
    except ValueError:
        raise InputError("expected an X.509 certificate (PEM)", file=path) from None


def weak_key(key: Any) -> str:
    """What makes a key too weak for signatures; empty if nothing does."""
    rsa = package("cryptography.hazmat.primitives.asymmetric.rsa")
    if is_elliptic(key):
        least = LEAST_CURVE_BITS
    elif isinstance(key, rsa.RSAPrivateKey | rsa.RSAPublicKey):
        least = LEAST_RSA_BITS
    else:
        return "expected a key for RSA or an elliptic curve"
    return f"the key has {key.key_size} bits, fewer than {least}" if key.key_size < least else ""


def is_elliptic(key: Any) -> bool:
    """Whether a key, private or public, is one of an elliptic curve."""
    elliptic = package("cryptography.hazmat.primitives.asymmetric.ec")
    return isinstance(key, elliptic.EllipticCurvePrivateKey | elliptic.EllipticCurvePublicKey)


def may_sign(certificate: Any) -> bool:
    """Whether the key usage of a certificate, if it states one, permits to sign documents."""
    try:
        usage = _extension(certificate, "KeyUsage")
    except Exception:  # malformed extensions have many types
        return False
    return usage is None or bool(usage.digital_signature or usage.content_commitment)


def chain_to_trusted(signer: Any, trusted: Sequence[Any], others: Sequence[Any]) -> tuple[Any, ...]:
    """The shortest chain of certificates from a signer's to a trusted one, each issued by the next.

    Parameters
    ----------
    signer : Certificate
    trusted, others : sequences of Certificate
        Those that the reader trusts, and those that may stand between. A trusted one that issued others must be that of
        a certification authority.

    Returns
    -------
    tuple of Certificate
        The signer's alone if it is trusted itself; empty if there is no chain.
    """
    chains: dict[Any, tuple[Any, ...]] = {signer: (signer,)}
    waiting = [signer]
    for lower in waiting:  # each certificate is looked at once, however many chains a file pretends to have
        if lower in trusted:
            return chains[lower]
        for upper in (*trusted, *others):
            if upper not in chains and _has_issued(upper, lower, n_between=len(chains[lower]) - 1):
                chains[upper] = (*chains[lower], upper)
                waiting.append(upper)
    return ()


def _has_issued(upper: Any, lower: Any, *, n_between: int) -> bool:
    """Whether a certification authority issued a certificate, with `n_between` authorities between it and the signer.

    RFC 5280, 6.1.3 (a) (1), (4) and 6.1.4 (f), (k), (m), (n).
    """
    try:
        constraints, usage = _extension(upper, "BasicConstraints"), _extension(upper, "KeyUsage")
        if constraints is None or not constraints.ca or (usage is not None and not usage.key_cert_sign):
            return False
        if constraints.path_length is not None and constraints.path_length < n_between:
            return False
        if any(
            one.critical and one.oid.dotted_string not in _KNOWN_EXTENSIONS
            for one in (*upper.extensions, *lower.extensions)
        ):
            return False
        if lower.signature_hash_algorithm.name not in _GOOD_HASHES or weak_key(upper.public_key()):
            return False
        lower.verify_directly_issued_by(upper)
    except Exception:  # certificates of others are malformed in many ways, none of which makes an issuer
        return False
    return True


def _extension(certificate: Any, kind: str) -> Any | None:
    x509 = package("cryptography.x509")
    try:
        return certificate.extensions.get_extension_for_class(getattr(x509, kind)).value
    except x509.ExtensionNotFound:
        return None


def package(name: str) -> Any:
    """A package that signatures need, imported when it is needed."""
    return extra_module(name, "signatures need the package signxml", "pip install 'truearm[sign]'")
