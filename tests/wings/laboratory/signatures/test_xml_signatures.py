"""Signatures of XML files: verified or refused, and only what was signed is read."""

import datetime
import re
from base64 import b64encode

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from lxml import etree

from made_up_signers import CONTENT, advanced, authority, certified, curve_key, named, sealed, usage, write
from refusals import refuses
from truearm.errors import MissingTool
from truearm.wings.laboratory.signatures import xml_references
from truearm.wings.laboratory.signatures.x509_certificates import Signer, is_encrypted, read_signer
from truearm.wings.laboratory.signatures.xml_references import (
    BrokenSignature,
    UnverifiedSignature,
    canonical,
    parse_signed,
)
from truearm.wings.laboratory.signatures.xml_signatures import (
    GOOD,
    NOT_VERIFIABLE,
    Signature,
    sign_xml,
    verified_content,
)


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Keys of a laboratory (two kinds) and of somebody who takes its name."""
    folder = tmp_path_factory.mktemp("keys")
    elliptic = curve_key()
    for name, key in (("ec", elliptic), ("rsa", rsa.generate_private_key(65537, 2048)), ("other", curve_key())):
        write(folder, name, key, certified(key))
    write(folder, "locked", elliptic, certified(elliptic), b"secret")
    return folder


def signer(keys, name):
    return read_signer(keys / f"{name}.key", keys / f"{name}.pem")


def fingerprint(keys, name):
    return signer(keys, name).certificate.fingerprint(hashes.SHA256()).hex()


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
        assert (signature.valid_from.year, signature.valid_until.year) == (2020, 2090)
        assert (signature.answer, signature.reason, signature.authority) == (GOOD, "", "")
        assert (signature.trusted, signature.signed_at) == (trusted is not None, None)
        assert signature.fingerprint == fingerprint(keys, name)
        assert len(signature.fingerprint) == 64
    assert b"PRIVATE" not in content
    assert "PRIVATE" not in repr(signer(keys, name))
    assert "key" not in repr(signer(keys, name))


def test_a_file_without_a_signature_is_as_it_is_unless_one_is_asked_for(keys):
    assert verified_content(CONTENT) == (CONTENT, None)
    refuses("the file is not signed", verified_content, CONTENT, trusted=keys / "ec.pem")


def test_a_signature_of_somebody_with_the_same_name_is_not_the_trusted_one(keys):
    content = sign_xml(CONTENT, signer(keys, "other"))
    _, signature = verified_content(content)
    assert signature is not None
    assert signature.signer == "CN=Example Laboratory"
    assert signature.fingerprint != fingerprint(keys, "ec")
    with pytest.raises(UnverifiedSignature, match="not verifiable here: .* is not one that you trust"):
        verified_content(content, trusted=keys / "ec.pem")


def wrapped(text):
    """The signed document inside another one, which a careless reader would take for it."""
    inner = re.sub(r"^<\?xml[^>]*>", "", text).strip()
    mark = re.search(r"<ds:Signature.*</ds:Signature>", inner, flags=re.S)[0]
    return f"<a xmlns:b='urn:b'><c>999</c><e>{inner.replace(mark, '')}</e>{mark}</a>"


def many(name, count=1001):
    """Attributes of an element."""
    return " ".join(f'{name.format(i)}="{i}"' for i in range(count))


CHANGES = [
    (lambda text: text.replace("5 µm", "9 µm"), "the content was changed after it was signed"),
    (lambda text: text.replace("<d/>", ""), "the content was changed"),
    (lambda text: text.replace("<d/>", "<d/><e/>"), "the content was changed"),
    (
        lambda text: text + "<?xml-stylesheet href='other.xsl'?>",
        r"<\?xml-stylesheet\?> outside of the root is not signed",
    ),
    (lambda text: re.sub(r"(SignatureValue>\s*)[^<]{20}", r"\1AAAAAAAAAAAAAAAAAAAA", text), "its value is not that of"),
    (lambda text: re.sub(r"(SignatureValue>\s*)[^<]{4}", r"\1", text), "its value is not that of"),
    (lambda text: re.sub(r"(SignatureValue>\s*)[^<]{4}", r"\1~~~~", text), "expected base64"),
    (lambda text: re.sub(r"(DigestValue>\s*)[^<]{4}", r"\1AAAA", text), "its value is not that of"),
    (lambda text: text.replace("ecdsa-sha256", "ecdsa-sha384"), "its value is not that of"),
    (lambda text: text.replace("ecdsa-sha256", "rsa-sha256"), "its value is not that of"),
    (lambda text: text.replace('URI=""', 'URI="#x"'), "its value is not that of"),
    (lambda text: text.replace('URI=""', 'URI="file:///etc/hosts"'), "its value is not that of"),
    (lambda text: text.replace("2000/09/xmldsig#enveloped-signature", "TR/1999/REC-xslt-19991116"), "its value is not"),
    (
        lambda text: re.sub("<ds:SignatureValue.*</ds:SignatureValue>", "", text, flags=re.S),
        "expected one <SignatureValue>",
    ),
    (
        lambda text: re.sub("(<ds:Signature.*</ds:Signature>)", r"<f>\1</f>", text, flags=re.S),
        "not a child of the root",
    ),
    (wrapped, "the content was changed"),
]


@pytest.mark.parametrize(("change", "said"), CHANGES)
def test_a_changed_file_is_broken(signed, keys, change, said):
    changed = change(signed.decode())
    assert changed != signed.decode()
    for trusted in (None, keys / "ec.pem"):
        with pytest.raises(BrokenSignature, match=f"the signature is broken: .*{said}"):
            verified_content(changed.encode(), trusted=trusted)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: "<!DOCTYPE a [<!ENTITY b 'c'>]>" + text.partition("?>")[2], "DOCTYPE"),
        (lambda text: text[:200], "not valid XML"),
        (lambda text: text.replace("<d/>", "<d>" * 400 + "</d>" * 400), "XML of another size"),
        (lambda text: text.replace("<d/>", f"<d {many('a{}')}/>"), "an element has 1001 attributes"),
        (lambda text: text.replace("<d/>", f"<d {many('xmlns:n{}')}/>"), "1002 namespaces are declared at one place"),
        (
            lambda text: text.replace("<d/>", f"<d {many('xmlns:n{}', 900)}>{'<e/>' * 12_000}</d>"),
            "901 namespaces are declared at one place, too many for a file of its size",
        ),
    ],
)
def test_files_that_are_no_certificates_are_refused(signed, keys, change, said):
    for trusted in (None, keys / "ec.pem"):
        caught = refuses(said, verified_content, change(signed.decode()).encode(), trusted=trusted)
        assert not isinstance(caught, BrokenSignature | UnverifiedSignature)


UNSUPPORTED = [
    (lambda text: text.replace("ecdsa-sha256", "hmac-sha256"), "its method is not supported"),
    (lambda text: text.replace("ecdsa-sha256", "ecdsa-sha1"), "its method is not supported"),
    (lambda text: text.replace("xmlenc#sha256", "xmldsig#sha1"), "its digest is not supported"),
    (lambda text: text.replace('URI=""', 'URI="file:///etc/hosts"'), "outside of the file or by an XPointer"),
    (lambda text: text.replace('URI=""', 'URI="#xpointer(/)"'), "outside of the file or by an XPointer"),
    (
        lambda text: text.replace(
            "<ds:Reference ", '<ds:Reference URI="https://example.org/x" Id="x"/>' * 11 + "<ds:Reference "
        ),
        "12 references",
    ),
    (
        lambda text: text.replace("2000/09/xmldsig#enveloped-signature", "TR/1999/REC-xslt-19991116"),
        "chain of transforms",
    ),
    (
        lambda text: text.replace("2000/09/xmldsig#enveloped-signature", "TR/1999/REC-xpath-19991116"),
        "XPath expression",
    ),
    (lambda text: text.replace("2006/12/xml-c14n11", "2010/xml-c14n2"), "its canonicalization is not supported"),
    (
        lambda text: text.replace(
            '<ds:Transform Algorithm="http://www.w3.org/2000/09/xmldsig#enveloped-signature"/>', ""
        ),
        "without removing it",
    ),
]


@pytest.mark.parametrize(("change", "said"), UNSUPPORTED)
def test_a_form_that_is_not_supported_is_not_verifiable_here(signed, keys, change, said):
    changed = change(signed.decode())
    assert changed != signed.decode()
    with pytest.MonkeyPatch.context() as patch:
        if "canonicalization" in said:  # signed by a program that has it
            patch.setitem(canonical.__globals__["_CANONICAL"], "http://www.w3.org/2010/xml-c14n2", {})
        changed = sealed(changed, signer(keys, "ec").key)
    content, signature = verified_content(changed.encode())
    assert content == changed.encode()  # as one without a signature
    assert signature is not None
    assert (signature.answer, signature.signer, signature.trusted) == (NOT_VERIFIABLE, "", False)
    assert said in signature.reason
    with pytest.raises(UnverifiedSignature, match=f"the signature is not verifiable here: .*{said}"):
        verified_content(changed.encode(), trusted=keys / "ec.pem")


def test_a_file_of_very_many_elements_is_refused(signed, monkeypatch):
    monkeypatch.setattr(xml_references, "MAX_ELEMENTS", 5)
    refuses("expected at most 5 elements", verified_content, signed)


def test_a_signature_of_a_part_is_broken(signed, keys):
    """What stands beside the part can be by anybody."""
    text = signed.decode().replace("<d/>", '<d Id="part"/>').replace('URI=""', 'URI="#part"')
    text = re.sub("<ds:Transforms>.*</ds:Transforms>", "", text, flags=re.S)
    digest = hashes.Hash(hashes.SHA256())
    digest.update(b'<d xmlns:b="urn:b" Id="part"></d>')
    text = re.sub("(<ds:DigestValue>)[^<]*", rf"\g<1>{b64encode(digest.finalize()).decode()}", text)
    with pytest.raises(BrokenSignature, match="covers only a part of the file"):
        verified_content(sealed(text, signer(keys, "ec").key).encode())
    twice = text.replace('<d Id="part"/>', '<d Id="part"/><d Id="part"/>')
    with pytest.raises(BrokenSignature, match="'#part', which is in the file 2 times"):
        verified_content(sealed(twice, signer(keys, "ec").key).encode())


def test_two_signatures_are_not_verifiable_here(signed, keys):
    text = re.sub("(<ds:Signature.*</ds:Signature>)", r"\1\1", signed.decode(), flags=re.S)
    assert "has 2 signatures" in verified_content(text.encode())[1].reason
    with pytest.raises(UnverifiedSignature, match="has 2 signatures"):
        verified_content(text.encode(), trusted=keys / "ec.pem")


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
    assert "contains no certificate of its signer" in verified_content(changed)[1].reason
    assert verified_content(changed, trusted=keys / "ec.pem")[0] == verified_content(signed)[0]
    with pytest.raises(UnverifiedSignature, match="contains no certificate of its signer"):
        verified_content(changed, trusted=keys / "other.pem")


def test_comments_are_not_part_of_what_is_read(signed):
    """Canonical XML has none: a comment can be added, but it cannot cut a text in two or be read."""
    changed = signed.replace("5 µm".encode(), "5 <!-- 9 -->µm".encode())
    assert verified_content(changed)[0] == verified_content(signed)[0]


def test_keys_and_certificates_are_checked(keys, tmp_path):
    refuses("the certificate does not belong to the key", read_signer, keys / "ec.key", keys / "other.pem")
    refuses("expected a private key", read_signer, keys / "ec.pem", keys / "ec.pem")
    refuses(r"expected an X.509 certificate", read_signer, keys / "ec.key", keys / "ec.key")
    refuses("the key is encrypted", read_signer, keys / "locked.key", keys / "locked.pem")
    refuses("the password is wrong", read_signer, keys / "locked.key", keys / "locked.pem", password="guess")
    assert (is_encrypted(keys / "locked.key"), is_encrypted(keys / "ec.key")) == (True, False)
    unlocked = read_signer(keys / "locked.key", keys / "locked.pem", password="secret")
    assert unlocked.certificate.subject == named("Example Laboratory")
    small = rsa.generate_private_key(65537, 1024)
    write(tmp_path, "small", small, certified(small))
    refuses("the key has 1024 bits, fewer than 2048.*an elliptic curve of 256 bits or more", signer, tmp_path, "small")
    edwards = ed25519.Ed25519PrivateKey.generate()
    write(tmp_path, "edwards", edwards, certified(edwards, digest=None))
    refuses("expected a key for RSA or an elliptic curve", signer, tmp_path, "edwards")


def test_without_the_package_the_message_says_how_to_get_it(signed, keys, without_extras):
    with pytest.raises(MissingTool, match=r"pip install 'truearm\[sign\]'"):
        verified_content(signed)
    with pytest.raises(MissingTool):
        read_signer(keys / "ec.key", keys / "ec.pem")
    assert verified_content(CONTENT) == (CONTENT, None)


def test_a_short_curve_signs_nothing(tmp_path):
    short = ec.generate_private_key(ec.SECP224R1())
    write(tmp_path, "short", short, certified(short))
    refuses("224 bits, fewer than 256", signer, tmp_path, "short")


# XAdES ---------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lab():
    key = curve_key()
    return key, certified(key, begin=2025, end=2028)


def test_a_signature_of_signxml_with_its_time_is_good(keys):
    """Three references: the content, the certificate and the properties."""
    from signxml.xades import XAdESSigner

    by = signer(keys, "rsa")
    made = XAdESSigner().sign(parse_signed(CONTENT).getroot(), key=by.key, cert=[by.certificate])
    content = canonical(made.getroottree())
    assert content.count(b"<ds:Reference ") == 3
    _, signature = verified_content(content, trusted=keys / "rsa.pem")
    assert (signature.answer, signature.trusted) == (GOOD, True)
    assert abs(signature.signed_at - datetime.datetime.now(datetime.UTC)) < datetime.timedelta(hours=1)


@pytest.mark.parametrize("time", ["2026-03-01T12:30:00Z", "2026-03-01T13:30:00+01:00", "2026-03-01T12:30:00"])
def test_the_time_of_a_signature_is_read(lab, time):
    key, certificate = lab
    content, signature = verified_content(advanced(certificate, key, time=time))
    assert content == CONTENT.replace(b"<d/>", b"<d></d>")
    assert signature.signed_at == datetime.datetime(2026, 3, 1, 12, 30, tzinfo=datetime.UTC)
    assert "on 2026-03-01 1" in signature.describe()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"time": "2024-12-31T23:59:59Z"},
            "signed it on 2024-12-31; its signer's certificate is valid from 2025-01-01 to 2028-01-01",
        ),
        ({"time": "2028-01-01T00:00:01Z"}, "signed it on 2028-01-01; its certificate was not valid at that hour"),
        ({"time": "now\nThe signature is good"}, r"can read ('now\nThe signature is good')"),
        ({"time": "yesterday"}, "no time of signature that truearm can read ('yesterday')"),
        (
            {
                "change": lambda text: text.replace(
                    "</xades:SigningTime>", "</xades:SigningTime><xades:SignaturePolicyIdentifier/>"
                )
            },
            "truearm cannot check its property SignaturePolicyIdentifier",
        ),
        ({"change": lambda text: text.replace("xmlenc#sha512", "xmldsig#sha1")}, "by 'SHA1', which is not supported"),
    ],
)
def test_properties_that_cannot_be_checked_make_it_not_verifiable_here(lab, tmp_path, changed, said):
    key, certificate = lab
    content = advanced(certificate, key, **changed)
    assert said in verified_content(content)[1].reason
    write(tmp_path, "lab", key, certificate)
    with pytest.raises(UnverifiedSignature, match=re.escape(said)):
        verified_content(content, trusted=tmp_path / "lab.pem")


def test_the_certificate_that_the_signature_names_is_the_one_in_the_file(lab, tmp_path):
    key, certificate = lab
    renamed = certified(key, "Somebody Else")
    with pytest.raises(BrokenSignature, match="not the one with which it was signed"):
        verified_content(advanced(certificate, key, by=renamed))
    write(tmp_path, "lab", key, certificate)
    _, signature = verified_content(advanced(certificate, key, by=renamed), trusted=tmp_path / "lab.pem")
    assert signature.signer == "CN=Example Laboratory"


def test_what_is_not_signed_is_not_read_as_a_property(lab):
    """Properties that no reference covers can be by anybody: the time is not stated."""
    key, certificate = lab
    content = advanced(
        certificate, key, change=lambda text: re.sub("<ds:Reference Type.*?</ds:Reference>", "", text, flags=re.S)
    )
    _, signature = verified_content(content)
    assert (signature.answer, signature.signed_at) == (GOOD, None)
    assert "time not stated" in signature.describe()


def test_a_signer_whose_certificate_is_not_for_signatures_is_not_verifiable_here():
    key = curve_key()
    wrong = certified(key, extensions=(usage(key_agreement=True),))
    assert "is not for signatures" in verified_content(advanced(wrong, key))[1].reason
    right = certified(key, extensions=(usage(content_commitment=True),))
    assert verified_content(advanced(right, key))[1].answer == GOOD


@pytest.mark.parametrize("number", ["2.5.29.15", "2.5.29.17"])
def test_a_signer_whose_certificate_has_a_malformed_extension_is_not_verifiable_here(number):
    key = curve_key()
    malformed = x509.UnrecognizedExtension(x509.ObjectIdentifier(number), b"\xff\xff")
    _, signature = verified_content(sign_xml(CONTENT, Signer(certified(key, extensions=(malformed,)), key)))
    assert (signature.answer, "or cannot be read" in signature.reason) == (NOT_VERIFIABLE, True)


def test_the_chain_is_valid_when_it_was_signed(tmp_path):
    """The authority was valid for 2025 only: what its laboratory signed then is good, what it signed later is not."""
    above = authority(begin=2025, end=2026)
    key = curve_key()
    certificate = certified(key, by=above, begin=2024, end=2030)
    write(tmp_path, "ca", *above)
    _, signature = verified_content(
        advanced(certificate, key, time="2025-06-01T00:00:00Z"), trusted=tmp_path / "ca.pem"
    )
    assert (signature.trusted, signature.authority, signature.issuer) == (True, "CN=Example CA", "CN=Example CA")
    assert (signature.valid_from.year, signature.valid_until.year) == (2025, 2026)
    assert "by a chain to CN=Example CA, which you trust" in signature.describe()
    with pytest.raises(
        UnverifiedSignature,
        match="signed it on 2026-06-01; the certificate of the authority CN=Example CA is valid from 2025-.* to 2026-",
    ):
        verified_content(advanced(certificate, key, time="2026-06-01T00:00:00Z"), trusted=tmp_path / "ca.pem")
    undated = sign_xml(CONTENT, Signer(certificate, key))
    _, signature = verified_content(undated, trusted=tmp_path / "ca.pem")
    assert signature.covers(datetime.date(2025, 6, 1))
    assert not signature.covers(datetime.date(2026, 6, 1))
    said = "the certificate of the authority CN=Example CA is valid from 2025-01-01 to 2026-01-01"
    assert signature.describe_periods(datetime.date(2026, 6, 1)) == said
    before = "its signer's certificate is valid from 2024-01-01 to 2030-01-01; "
    assert signature.describe_periods(datetime.date(2031, 1, 1)) == signature.describe_periods(None) == before + said


def test_the_chain_of_the_signer_stands_in_the_file(tmp_path):
    above = authority()
    between = authority("Between", by=above)
    key = curve_key()
    write(tmp_path, "ca", *above)
    write(tmp_path, "between", *between)
    write(tmp_path, "lab", key, certified(key, by=between))
    alone = read_signer(tmp_path / "lab.key", tmp_path / "lab.pem")
    with pytest.raises(UnverifiedSignature, match="has no chain to one"):
        verified_content(sign_xml(CONTENT, alone), trusted=tmp_path / "ca.pem")
    with (tmp_path / "lab.pem").open("ab") as pem:
        pem.write((tmp_path / "between.pem").read_bytes())
    whole = read_signer(tmp_path / "lab.key", tmp_path / "lab.pem")
    _, signature = verified_content(sign_xml(CONTENT, whole), trusted=tmp_path / "ca.pem")
    assert (signature.answer, signature.authority, len(signature.periods)) == (GOOD, "CN=Example CA", 3)


def test_the_first_and_the_last_day_of_a_certificate_are_covered():
    day = datetime.date(2026, 5, 1)
    one = Signature("good", valid_from=day, valid_until=day + datetime.timedelta(days=1))
    covered = [one.covers(day + datetime.timedelta(days=n)) for n in (-1, 0, 1, 2)]
    assert covered == [False, True, True, False]


@pytest.mark.parametrize(
    ("algorithm", "expression", "is_known"),
    [
        (xml_references._XPATH, "<ds:XPath>not(ancestor-or-self::ds:Signature)</ds:XPath>", True),
        (xml_references._XPATH, '<f:XPath Filter="subtract">/descendant::ds:Signature</f:XPath>', False),
        (xml_references._FILTER, '<f:XPath Filter="subtract">/descendant::ds:Signature</f:XPath>', True),
        (xml_references._FILTER, '<f:XPath Filter="intersect">/descendant::ds:Signature</f:XPath>', False),
        (xml_references._FILTER, "<ds:XPath>not(ancestor-or-self::ds:Signature)</ds:XPath>", False),
    ],
)
def test_of_expressions_those_that_remove_the_signature_are_known(algorithm, expression, is_known):
    """Each in its own language: that of XPath filters says what to subtract, the other which nodes remain."""
    spaces = f'xmlns:ds="{xml_references.DSIG[1:-1]}" xmlns:f="{xml_references._FILTER}"'
    transform = f'<ds:Transform Algorithm="{algorithm}">{expression}</ds:Transform>'
    tree = etree.fromstring(f"<file {spaces}><ds:Signature>{transform}</ds:Signature></file>")
    assert xml_references._removes_signatures(tree, tree[0], tree[0][0]) == is_known
