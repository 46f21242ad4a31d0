"""Signed certificates: what was changed after the signature; keys, times and authorities that do not hold."""

from __future__ import annotations

import datetime
import re
from base64 import b64encode
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.certificates import mistake, right
from benchmarks.certificates.campaign import Edits, campaign, edited, file, read, written
from truearm.wings.laboratory.signatures.x509_certificates import package, read_signer
from truearm.wings.laboratory.signatures.xml_references import canonical, parse_signed

UTC = datetime.UTC
XADES = "http://uri.etsi.org/01903/v1.3.2#"
C14N, EXCLUSIVE = "http://www.w3.org/2006/12/xml-c14n11", "http://www.w3.org/2001/10/xml-exc-c14n#"
LATER = datetime.datetime.now(UTC) + datetime.timedelta(days=1000)


class Holder(NamedTuple):
    """A key and its certificate, of a laboratory or an authority that does not exist."""

    key: Any
    certificate: Any

    def pem(self) -> str:
        """A file of the certificate."""
        return file(
            self.certificate.public_bytes(package("cryptography.hazmat.primitives.serialization").Encoding.PEM), "pem"
        )


def _day(text: str) -> datetime.datetime:
    return datetime.datetime.fromisoformat(text).replace(tzinfo=UTC)


@cache
def holder(
    name: str = "Example Laboratory",
    begin: str = "2025-01-01",
    end: str = "2090-01-01",
    by: str = "",
    authority: bool = False,
) -> Holder:
    """A holder by itself, or `by` an authority of another name."""
    x509, ec = package("cryptography.x509"), package("cryptography.hazmat.primitives.asymmetric.ec")
    hashes = package("cryptography.hazmat.primitives.hashes")

    def named(text: str) -> Any:
        return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, text)])

    key = ec.generate_private_key(ec.SECP256R1())
    issuer = issuers()[by] if by else Holder(key, None)
    builder = x509.CertificateBuilder(
        named(by or name), named(name), key.public_key(), x509.random_serial_number(), _day(begin), _day(end)
    )
    if authority:
        builder = builder.add_extension(x509.BasicConstraints(True, None), critical=True)
    return Holder(key, builder.sign(issuer.key, hashes.SHA256()))


@cache
def issuers() -> dict[str, Holder]:
    return {
        "Example CA": holder("Example CA", authority=True),
        "Expired CA": holder("Expired CA", end="2026-01-05", authority=True),
        "No CA": holder("No CA"),
    }


@cache
def signed(signer: Holder | None = None) -> str:
    """The certificate of the right campaign, signed by truearm."""
    serialization = package("cryptography.hazmat.primitives.serialization")
    by = signer or holder()
    key = by.key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    path = file("", "xml")
    campaign().certified().save(path, signer=read_signer(file(key, "pem"), by.pem()), force=True)
    return Path(path).read_text(encoding="utf-8")


def with_time(signer: Holder, time: str, *, content: str = "", named: Holder | None = None) -> str:
    """The certificate with a XAdES signature that states its time: an honest one but for what is asked."""
    hashes = package("cryptography.hazmat.primitives.hashes")
    encoding = package("cryptography.hazmat.primitives.serialization").Encoding
    ec, utils = (package(f"cryptography.hazmat.primitives.asymmetric.{one}") for one in ("ec", "utils"))

    def sha256(data: bytes) -> str:
        digest = hashes.Hash(hashes.SHA256())
        digest.update(data)
        return b64encode(digest.finalize()).decode()

    empty = '<ds:DigestMethod Algorithm="http://www.w3.org/2001/04/xmlenc#sha256"/><ds:DigestValue>{}</ds:DigestValue>'
    enveloped = '<ds:Transform Algorithm="http://www.w3.org/2000/09/xmldsig#enveloped-signature"/>'
    fingerprint = b64encode((named or signer).certificate.fingerprint(hashes.SHA256())).decode()
    shown = b64encode(signer.certificate.public_bytes(encoding.DER)).decode()
    signature = (
        '<ds:Signature xmlns:ds="http://www.w3.org/2000/09/xmldsig#" Id="sig"><ds:SignedInfo>'
        f'<ds:CanonicalizationMethod Algorithm="{EXCLUSIVE}"/>'
        '<ds:SignatureMethod Algorithm="http://www.w3.org/2001/04/xmldsig-more#ecdsa-sha256"/>'
        f'<ds:Reference URI=""><ds:Transforms>{enveloped}<ds:Transform Algorithm="{C14N}"/></ds:Transforms>'
        f"{empty.format('DOCUMENT')}</ds:Reference>"
        '<ds:Reference Type="http://uri.etsi.org/01903#SignedProperties" URI="#props"><ds:Transforms>'
        f'<ds:Transform Algorithm="{EXCLUSIVE}"/></ds:Transforms>{empty.format("PROPERTIES")}</ds:Reference>'
        "</ds:SignedInfo><ds:SignatureValue>VALUE</ds:SignatureValue>"
        f"<ds:KeyInfo><ds:X509Data><ds:X509Certificate>{shown}</ds:X509Certificate></ds:X509Data></ds:KeyInfo>"
        f'<ds:Object><xades:QualifyingProperties xmlns:xades="{XADES}" Target="#sig">'
        '<xades:SignedProperties Id="props">'
        f"<xades:SignedSignatureProperties><xades:SigningTime>{time}</xades:SigningTime><xades:SigningCertificateV2>"
        f"<xades:Cert><xades:CertDigest>{empty.format(fingerprint)}</xades:CertDigest></xades:Cert>"
        "</xades:SigningCertificateV2></xades:SignedSignatureProperties></xades:SignedProperties>"
        "</xades:QualifyingProperties></ds:Object></ds:Signature>"
    )
    plain = content or written()
    end = plain.rindex("</")
    text = f"{plain[:end]}{signature}{plain[end:]}"
    tree = parse_signed(text.encode())
    (properties,) = tree.iter(f"{{{XADES}}}SignedProperties")
    document = canonical(parse_signed(plain.encode()), _transform(C14N))
    text = text.replace("DOCUMENT", sha256(document)).replace(
        "PROPERTIES", sha256(canonical(properties, _transform(EXCLUSIVE)))
    )
    (info,) = parse_signed(text.encode()).iter("{*}SignedInfo")
    data = canonical(info, info.find("{*}CanonicalizationMethod"), comments=True)
    numbers = utils.decode_dss_signature(signer.key.sign(data, ec.ECDSA(hashes.SHA256())))
    return text.replace("VALUE", b64encode(b"".join(one.to_bytes(32) for one in numbers)).decode())


def _transform(algorithm: str) -> Any:
    return package("lxml.etree").fromstring(
        f'<ds:Transform xmlns:ds="http://www.w3.org/2000/09/xmldsig#" Algorithm="{algorithm}"/>'
    )


# Changed after the signature -----------------------------------------------------------------------------------------

CHANGED: dict[str, Edits] = {
    "a test value": [(r"(E_Uni, 900.*?<si:value>)-?[\d.]+", r"\g<1>0.0010")],
    "an expanded uncertainty": [(r"(E_Uni, 900.*?<si:valueExpandedMU>)[\d.]+", r"\g<1>0.0011")],
    "a limit": [(r"(limit of the magnitude.*?<si:value>)[\d.]+", r"\g<1>0.2")],
    "a conformity": [("<dcc:conformity>pass", "<dcc:conformity>fail")],
    "the words of the decision": [("Example Arms A: conform", "Example Arms A: not conform")],
    "the serial number of the arm": [(">10017<", ">10018<")],
    "the number of the certificate": [(">V-1<", ">V-2<")],
    "the day of issue": [("issueDate>2026-02-10", "issueDate>2026-02-11")],
    "the day of the measurement": [("PerformanceDate>2026-01-20", "PerformanceDate>2026-01-21")],
    "the laboratory": [("Example Laboratory<", "Accredited Institute<")],
    "the customer": [("Example Customer", "Another Customer")],
    "an artefact's certificate": [("K-102", "K-777")],
    "the day of an artefact's calibration": [("Calibrated on 2026-01-01", "Calibrated on 2026-01-10")],
    "the temperature of the room": [(">19.5<", ">19.9<")],
    "a remark left out": [(r"<dcc:statement refType=.truearm_remark.>.*?</dcc:statement>", "")],
    "a statement that is added": [
        (
            "</dcc:statements>",
            (
                '<dcc:statement refType="truearm_remark"><dcc:declaration><dcc:content lang="en">Valid for '
                "ten years.</dcc:content></dcc:declaration></dcc:statement></dcc:statements>"
            ),
        )
    ],
    "all white space between two elements": [(r"</dcc:items>\s+<", "</dcc:items><")],
    "a style sheet before the root": [
        (r"(<dcc:digitalCalibrationCertificate)", r'<?xml-stylesheet type="text/xsl" href="other.xsl"?>\1')
    ],
    "a style sheet behind the root": [(r"\Z", '<?xml-stylesheet type="text/xsl" href="other.xsl"?>')],
    "the value of the signature": [(r"(SignatureValue>)\s*\w{4}", r"\1AAAA")],
    "the digest of the document": [(r"(DigestValue>)\w{4}", r"\1AAAA")],
    "the signature, moved below another element": [
        (r"(<ds:Signature.*</ds:Signature>)(.*)(</dcc:digitalCal)", r"<dcc:comment>\1</dcc:comment>\2\3")
    ],
}
for _what, _edits in CHANGED.items():
    mistake(f"a signed certificate, changed: {_what}", said="^truearm: .*signature is broken")(
        lambda edits=_edits: read(edited(signed(), edits))
    )


@mistake("a signature of another certificate under this one", said="^truearm: .*signature is broken")
def signature_of_another() -> str:
    found = re.search("<ds:Signature.*</ds:Signature>", signed(), re.DOTALL)
    assert found is not None
    other = campaign(seed=2).xml()
    return read(edited(other, [(r"</dcc:digitalCalibrationCertificate>\s*\Z", lambda end: found[0] + end[0])]))


@mistake("a signature taken off, read with the certificate of its signer", said="the file is not signed")
def taken_off() -> str:
    return read(edited(signed(), [("<ds:Signature.*</ds:Signature>", "")]), "--trusted", holder().pem())


@mistake("two signatures, the second of somebody else", said="has 2 signatures")
def two_signatures() -> str:
    found = re.search("<ds:Signature.*</ds:Signature>", signed(), re.DOTALL)
    assert found is not None
    return read(edited(signed(), [("</ds:Signature>", lambda end: end[0] + found[0])]), "--trusted", holder().pem())


@mistake("a transform of the signature that leaves out the results", said="transform|not verifiable|broken")
def transform_without_results() -> str:
    xpath = (
        '<ds:Transform Algorithm="http://www.w3.org/TR/1999/REC-xpath-19991116"><ds:XPath>not(ancestor-or-self::'
        "dcc:results)</ds:XPath></ds:Transform></ds:Transforms>"
    )
    return read(edited(signed(), [("</ds:Transforms>", xpath)]), "--trusted", holder().pem())


@mistake("a signature of one element of the certificate", said="broken|not verifiable")
def of_one_element() -> str:
    return read(edited(signed(), [('URI=""', 'URI="#results"'), ("<dcc:results>", '<dcc:results Id="results">')]))


@mistake("a signature by SHA-1", said="not verifiable|broken")
def by_sha1() -> str:
    return read(
        edited(signed(), [("xmldsig-more#ecdsa-sha256", "xmldsig-more#ecdsa-sha1")]), "--trusted", holder().pem()
    )


@mistake("a document type before a signed certificate", said="contains no DOCTYPE")
def document_type() -> str:
    return read(
        edited(
            signed(),
            [
                (
                    "<dcc:digitalCalibrationCertificate",
                    '<!DOCTYPE a [<!ENTITY b "c">]><dcc:digitalCalibrationCertificate',
                )
            ],
        )
    )


# By whom -------------------------------------------------------------------------------------------------------------


@mistake("a certificate signed by a stranger of the same name", said="not one that you trust")
def of_the_same_name() -> str:
    return read(signed(holder("Example Laboratory", "2025-01-02")), "--trusted", holder().pem())


@mistake("a certificate signed by a stranger whom nobody asked for", said="verified by its own certificate: compare")
def of_a_stranger() -> str:
    return read(signed(holder("Example Laboratory", "2025-01-02")))


@mistake("a signer whose authority is none", said="not one that you trust")
def by_no_authority() -> str:
    return read(signed(holder("Laboratory of no CA", by="No CA")), "--trusted", issuers()["No CA"].pem())


@mistake("a signer of one authority, another one trusted", said="not one that you trust")
def of_another_authority() -> str:
    other = holder("Other CA", authority=True)
    return read(signed(holder("Laboratory of a CA", by="Example CA")), "--trusted", other.pem())


@mistake("an authority that had expired on the day of issue", said="Expired CA is valid from")
def expired_authority() -> str:
    return read(
        with_time(holder("Laboratory of an expired CA", by="Expired CA"), "2026-02-10T12:00:00Z"),
        "--trusted",
        issuers()["Expired CA"].pem(),
    )


@mistake("a certificate of a key that is not yet valid on the day of issue", said="is valid from 2026-02-20")
def not_yet_valid() -> str:
    return str(signed(holder("Laboratory of March", "2026-02-20")))


@mistake("a certificate of a key that had expired on the day of issue", said="is valid from .* to 2026-01-31")
def key_expired() -> str:
    return str(signed(holder("Laboratory of January", end="2026-01-31")))


# When ----------------------------------------------------------------------------------------------------------------

FEBRUARY = ("Laboratory of February", "2025-01-01", "2026-02-28")
TIMES = {
    "before it was measured, with a key that expired since": (
        "2026-01-10T12:00:00Z",
        "before what it signs was measured",
    ),
    "before it was issued": ("2026-02-05T12:00:00Z", "before what it signs was issued"),
    "after its key had expired": ("2026-03-05T12:00:00Z", "valid from 2025-01-01 to 2026-02-28"),
    "before its key was valid": ("2024-12-01T12:00:00Z", "valid from 2025-01-01|before what it signs"),
    "at no time that anybody can read": ("February", "states no time of signature"),
    "in the future, when its key has expired": (f"{LATER:%Y-%m-%dT%H:%M:%SZ}", "valid from"),
}
for _what, (_time, _said) in TIMES.items():
    mistake(f"a certificate signed {_what}", said=_said)(
        lambda time=_time: read(with_time(holder(*FEBRUARY), time), "--trusted", holder(*FEBRUARY).pem())
    )


@mistake("signed in the future, with a key that is valid for long", said="future")
def signed_in_the_future() -> str:
    return read(with_time(holder(), f"{LATER:%Y-%m-%dT%H:%M:%SZ}"), "--trusted", holder().pem())


@mistake("a signature that names the certificate of another signer", said="is not the one with which it was signed")
def names_another() -> str:
    return read(with_time(holder(), "2026-02-10T12:00:00Z", named=holder("Other Laboratory")))


@mistake("a signing time changed after the signature", said="signature is broken")
def changed_time() -> str:
    made = with_time(holder(), "2026-02-10T12:00:00Z")
    return read(made.replace("2026-02-10T12:00:00Z", "2026-02-11T12:00:00Z"))


@mistake("a signed certificate that contradicts itself", said="contradicts itself")
def signed_contradiction() -> str:
    false = edited(written(), [(">10017<", ">10018<")])
    return read(with_time(holder(), "2026-02-10T12:00:00Z", content=false), "--trusted", holder().pem())


# What is right -------------------------------------------------------------------------------------------------------

BAD = "broken|not verifiable|refused|contradict"


@right("a certificate signed by truearm, read with its signer's certificate", unsaid=BAD)
def signed_by_truearm() -> str:
    return read(signed(), "--trusted", holder().pem())


@right("a certificate signed by a laboratory of an authority that is trusted", unsaid=BAD)
def of_an_authority() -> str:
    return read(signed(holder("Laboratory of a CA", by="Example CA")), "--trusted", issuers()["Example CA"].pem())


@right("a certificate signed on the day of issue, read after its key expired", unsaid=BAD)
def key_expired_since() -> str:
    return read(with_time(holder(*FEBRUARY), "2026-02-10T12:00:00Z"), "--trusted", holder(*FEBRUARY).pem())


@right("a certificate signed on the evening of the day of issue, far in the west", unsaid=BAD)
def far_in_the_west() -> str:
    return read(with_time(holder(), "2026-02-10T23:50:00-10:00"))


@right("a certificate signed on the morning of the day of issue, far in the east", unsaid=BAD)
def far_in_the_east() -> str:
    return read(with_time(holder(), "2026-02-10T00:10:00+13:00"))


@right("a certificate signed some days after its issue", unsaid=BAD)
def signed_later() -> str:
    return read(with_time(holder(), "2026-02-16T09:00:00Z"))
