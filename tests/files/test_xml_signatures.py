"""Signatures of XML files: verified or refused, and only what was signed is read."""

from __future__ import annotations

import datetime
import re

import pytest

from truearm.errors import InputError, MissingTool
from truearm.files import xml_signatures as module
from truearm.files.xml_signatures import is_encrypted, read_signer, sign_xml, verified_content

pytest.importorskip("signxml", reason="pip install truearm[sign] signs and verifies")
x509 = pytest.importorskip("cryptography.x509")
from cryptography.hazmat.primitives import hashes, serialization  # noqa: E402
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa  # noqa: E402

CONTENT = b'<a xmlns:b="urn:b"><b:c>5 \xc2\xb5m</b:c><d/></a>'


def certified(key, name="Example Laboratory", signs=hashes.SHA256):
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    day = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    made = x509.CertificateBuilder(subject, subject, key.public_key(), 7, day, day.replace(year=2028))
    return made.sign(key, signs() if signs else None)


def write(folder, name, key, certificate, password=None):
    pem, private = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    lock = serialization.BestAvailableEncryption(password) if password else serialization.NoEncryption()
    (folder / f"{name}.key").write_bytes(key.private_bytes(pem, private, lock))
    (folder / f"{name}.pem").write_bytes(certificate.public_bytes(pem))


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Keys of a laboratory (two kinds) and of somebody who takes its name."""
    folder = tmp_path_factory.mktemp("keys")
    elliptic = ec.generate_private_key(ec.SECP256R1())
    for name, key in (
        ("ec", elliptic),
        ("rsa", rsa.generate_private_key(65537, 2048)),
        ("other", ec.generate_private_key(ec.SECP256R1())),
    ):
        write(folder, name, key, certified(key))
    write(folder, "locked", elliptic, certified(elliptic), b"secret")
    return folder


def signer(keys, name):
    return read_signer(keys / f"{name}.key", keys / f"{name}.pem")


@pytest.fixture(scope="module")
def signed(keys):
    return sign_xml(CONTENT, signer(keys, "ec"))


@pytest.mark.parametrize("name", ["ec", "rsa"])
def test_what_was_signed_is_read_and_who_signed(keys, name):
    content = sign_xml(CONTENT, signer(keys, name))
    for trusted in (None, keys / f"{name}.pem"):
        read, signature = verified_content(content, trusted=trusted)
        assert read == CONTENT.replace(b"<d/>", b"<d></d>")  # canonical: without the signature
        assert signature is not None
        assert (signature.signer, signature.issuer) == ("CN=Example Laboratory",) * 2
        assert (signature.valid_from.year, signature.valid_until.year) == (2026, 2028)
        assert signature.trusted is (trusted is not None)
        assert signature.fingerprint == signer(keys, name).signature.fingerprint
        assert len(signature.fingerprint) == 64
    assert b"PRIVATE" not in content
    assert "PRIVATE" not in repr(signer(keys, name))
    assert "key" not in repr(signer(keys, name))


def test_a_file_without_a_signature_is_as_it_is_unless_one_is_asked_for(keys):
    assert verified_content(CONTENT) == (CONTENT, None)
    with pytest.raises(InputError, match="the file is not signed"):
        verified_content(CONTENT, trusted=keys / "ec.pem")


def test_a_signature_of_somebody_with_the_same_name_is_not_the_trusted_one(keys):
    content = sign_xml(CONTENT, signer(keys, "other"))
    _, signature = verified_content(content)
    assert signature is not None
    assert signature.signer == "CN=Example Laboratory"
    assert signature.fingerprint != signer(keys, "ec").signature.fingerprint
    with pytest.raises(InputError, match="signature is broken.*not by the signer whose certificate you trust"):
        verified_content(content, trusted=keys / "ec.pem")


def wrapped(text):
    """The signed document inside another one, which a careless reader would take for it."""
    inner = re.sub(r"^<\?xml[^>]*>", "", text).strip()
    mark = re.search(r"<ds:Signature.*</ds:Signature>", inner, flags=re.S)[0]
    return f"<a><c>999</c><e>{inner.replace(mark, '')}</e>{mark}</a>"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("5 µm", "9 µm"), "the signature is broken"),
        (lambda text: text.replace("<d/>", ""), "the signature is broken"),
        (lambda text: text.replace("<d/>", "<d/><e/>"), "the signature is broken"),
        (
            lambda text: re.sub(r"(SignatureValue>\s*)[^<]{20}", r"\1AAAAAAAAAAAAAAAAAAAA", text),
            "the signature is broken",
        ),
        (lambda text: text.replace("ecdsa-sha256", "hmac-sha256"), "the signature is broken"),
        (lambda text: text.replace('URI=""', 'URI="#x"'), "not one of the whole document"),
        (lambda text: text.replace('URI=""', 'URI="file:///etc/hosts"'), "not one of the whole document"),
        (
            lambda text: text.replace("2000/09/xmldsig#enveloped-signature", "TR/1999/REC-xslt-19991116"),
            "not one of the whole document",
        ),
        (
            lambda text: re.sub("(<ds:Signature.*</ds:Signature>)", r"<f>\1</f>", text, flags=re.S),
            "expected one signature",
        ),
        (lambda text: re.sub("(<ds:Signature.*</ds:Signature>)", r"\1\1", text, flags=re.S), "expected one signature"),
        (wrapped, "the signature is broken"),
        (lambda text: "<!DOCTYPE a [<!ENTITY b 'c'>]>" + text.partition("?>")[2], "DOCTYPE"),
        (lambda text: text[:200], "not valid XML"),
    ],
)
def test_changed_files_and_other_tricks_are_refused(signed, keys, change, said):
    text = signed.decode()
    changed = change(text)
    assert changed != text
    for trusted in (None, keys / "ec.pem"):
        with pytest.raises(InputError, match=said):
            verified_content(changed.encode(), trusted=trusted)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: re.sub(r"(X509Certificate>\s*)[^<]{40}", r"\1AAAA", text),
        lambda text: re.sub("<ds:KeyInfo>.*</ds:KeyInfo>", "", text, flags=re.S),
    ],
)
def test_without_the_certificate_in_the_file_only_the_trusted_one_verifies_it(signed, keys, change):
    changed = change(signed.decode()).encode()
    assert changed != signed
    with pytest.raises(InputError, match="the signature is broken"):
        verified_content(changed)
    assert verified_content(changed, trusted=keys / "ec.pem")[0] == verified_content(signed)[0]


def test_comments_are_not_part_of_what_is_read(signed):
    """Canonical XML has none: a comment can be added, but it cannot cut a text in two or be read."""
    changed = signed.replace("5 µm".encode(), "5 <!-- 9 -->µm".encode())
    assert verified_content(changed)[0] == verified_content(signed)[0]


def test_keys_and_certificates_are_checked(keys, tmp_path):
    with pytest.raises(InputError, match="the certificate does not belong to the key"):
        read_signer(keys / "ec.key", keys / "other.pem")
    with pytest.raises(InputError, match="expected a private key"):
        read_signer(keys / "ec.pem", keys / "ec.pem")
    with pytest.raises(InputError, match=r"expected an X.509 certificate"):
        read_signer(keys / "ec.key", keys / "ec.key")
    with pytest.raises(InputError, match="the key is encrypted"):
        read_signer(keys / "locked.key", keys / "locked.pem")
    with pytest.raises(InputError, match="the password is wrong"):
        read_signer(keys / "locked.key", keys / "locked.pem", password="guess")
    assert (is_encrypted(keys / "locked.key"), is_encrypted(keys / "ec.key")) == (True, False)
    unlocked = read_signer(keys / "locked.key", keys / "locked.pem", password="secret")
    assert unlocked.signature.signer == "CN=Example Laboratory"
    small = rsa.generate_private_key(65537, 1024)
    write(tmp_path, "small", small, certified(small))
    with pytest.raises(
        InputError, match="the key has 1024 bits, fewer than 2048.*an elliptic curve of 256 bits or more"
    ):
        signer(tmp_path, "small")
    edwards = ed25519.Ed25519PrivateKey.generate()
    write(tmp_path, "edwards", edwards, certified(edwards, signs=None))
    with pytest.raises(InputError, match="expected a key for RSA or an elliptic curve"):
        signer(tmp_path, "edwards")


def test_without_the_package_the_message_says_how_to_get_it(signed, keys, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(module, "import_module", missing)
    with pytest.raises(MissingTool, match=r"pip install 'truearm\[sign\]'"):
        verified_content(signed)
    with pytest.raises(MissingTool):
        read_signer(keys / "ec.key", keys / "ec.pem")
    assert verified_content(CONTENT) == (CONTENT, None)


def test_a_short_curve_signs_nothing(tmp_path):
    short = ec.generate_private_key(ec.SECP224R1())
    write(tmp_path, "short", short, certified(short))
    with pytest.raises(InputError, match="224 bits, fewer than 256"):
        signer(tmp_path, "short")
