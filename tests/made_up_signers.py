"""Keys and certificates of laboratories and authorities that do not exist, and templates of signatures for xmlsec1."""

import datetime
import re
from base64 import b64encode

import pytest

pytest.importorskip("signxml", reason="pip install truearm[sign] signs and verifies")
x509 = pytest.importorskip("cryptography.x509")
from cryptography.hazmat.primitives import hashes, serialization  # noqa: E402
from cryptography.hazmat.primitives.asymmetric import ec, utils  # noqa: E402

from truearm.wings.laboratory.signatures.xml_references import canonical, parse_signed  # noqa: E402

PEM = serialization.Encoding.PEM
CONTENT = b'<a xmlns:b="urn:b"><b:c>5 \xc2\xb5m</b:c><d/></a>'
XADES = "http://uri.etsi.org/01903/v1.3.2#"
C14N, EXCLUSIVE = "http://www.w3.org/2006/12/xml-c14n11", "http://www.w3.org/2001/10/xml-exc-c14n#"
ENVELOPED = '<ds:Transform Algorithm="http://www.w3.org/2000/09/xmldsig#enveloped-signature"/>'
XPATH = (
    '<ds:Transform Algorithm="http://www.w3.org/TR/1999/REC-xpath-19991116">'
    "<ds:XPath>not(ancestor-or-self::ds:Signature)</ds:XPath></ds:Transform>"
)
FILTER = (
    '<ds:Transform Algorithm="http://www.w3.org/2002/06/xmldsig-filter2"><f:XPath '
    'xmlns:f="http://www.w3.org/2002/06/xmldsig-filter2" Filter="subtract">/descendant::ds:Signature</f:XPath>'
    "</ds:Transform>"
)


def day(year):
    return datetime.datetime(year, 1, 1, tzinfo=datetime.UTC)


def curve_key():
    return ec.generate_private_key(ec.SECP256R1())


def named(name):
    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])


def certified(key, name="Example Laboratory", *, by=None, begin=2020, end=2090, extensions=(), digest=hashes.SHA256):
    """A certificate of a key: by itself, or `by` the key and the certificate of an issuer; its first three years."""
    signing, issuer = (key, named(name)) if by is None else (by[0], by[1].subject)
    serial = x509.random_serial_number()
    made = x509.CertificateBuilder(issuer, named(name), key.public_key(), serial, day(begin), day(end))
    for extension in extensions:
        made = made.add_extension(extension, critical=True)
    return made.sign(signing, digest() if digest else None)


def usage(**used):
    names = "digital_signature content_commitment key_encipherment data_encipherment key_agreement key_cert_sign"
    every = [*names.split(), "crl_sign", "encipher_only", "decipher_only"]
    return x509.KeyUsage(**{name: used.get(name, False) for name in every})


def authority(name="Example CA", *, by=None, length=None, **others):
    """The key of a certification authority and its certificate."""
    key = curve_key()
    extensions = others.pop("extensions", (x509.BasicConstraints(True, length), usage(key_cert_sign=True)))
    return key, certified(key, name, by=by, extensions=extensions, **others)


def write(folder, name, key, certificate, password=None):
    lock = serialization.BestAvailableEncryption(password) if password else serialization.NoEncryption()
    (folder / f"{name}.key").write_bytes(key.private_bytes(PEM, serialization.PrivateFormat.PKCS8, lock))
    (folder / f"{name}.pem").write_bytes(certificate.public_bytes(PEM))


def template(
    certificate=None, *, canonical=C14N, info=EXCLUSIVE, removal=ENVELOPED, kind="ecdsa", time="2026-03-01T12:30:00Z"
):
    """A signature without values for the end of `CONTENT`; XAdES-BES if there is the `certificate` that it names."""
    reference = (
        '<ds:DigestMethod Algorithm="http://www.w3.org/2001/04/xmlenc#sha256"/><ds:DigestValue></ds:DigestValue>'
        "</ds:Reference>"
    )
    one = f'<ds:Transform Algorithm="{canonical}"/>' if canonical else ""
    references = f'<ds:Reference URI="" Id="doc"><ds:Transforms>{removal}{one}</ds:Transforms>{reference}'
    properties = ""
    if certificate is not None:
        references += (
            '<ds:Reference Type="http://uri.etsi.org/01903#SignedProperties" URI="#props"><ds:Transforms>'
            f'<ds:Transform Algorithm="{EXCLUSIVE}"/></ds:Transforms>{reference}'
        )
        value = b64encode(certificate.fingerprint(hashes.SHA512())).decode()
        properties = (
            f'<ds:Object><xades:QualifyingProperties xmlns:xades="{XADES}" Target="#sig"><xades:SignedProperties '
            f'Id="props"><xades:SignedSignatureProperties><xades:SigningTime>{time}</xades:SigningTime>'
            "<xades:SigningCertificateV2><xades:Cert><xades:CertDigest>"
            '<ds:DigestMethod Algorithm="http://www.w3.org/2001/04/xmlenc#sha512"/>'
            f"<ds:DigestValue>{value}</ds:DigestValue></xades:CertDigest></xades:Cert></xades:SigningCertificateV2>"
            "</xades:SignedSignatureProperties><xades:SignedDataObjectProperties><xades:DataObjectFormat "
            'ObjectReference="#doc"><xades:MimeType>text/xml</xades:MimeType></xades:DataObjectFormat>'
            "</xades:SignedDataObjectProperties></xades:SignedProperties></xades:QualifyingProperties></ds:Object>"
        )
    return (
        '<ds:Signature xmlns:ds="http://www.w3.org/2000/09/xmldsig#" Id="sig"><ds:SignedInfo>'
        f'<ds:CanonicalizationMethod Algorithm="{info}"/>'
        f'<ds:SignatureMethod Algorithm="http://www.w3.org/2001/04/xmldsig-more#{kind}-sha256"/>{references}'
        "</ds:SignedInfo><ds:SignatureValue/><ds:KeyInfo><ds:X509Data/></ds:KeyInfo>"
        f"{properties}</ds:Signature>"
    )


def sealed(text, key):
    """A file with the value of its signature and its empty digests filled in: an honest one, of whatever form."""
    tree = parse_signed(text.encode())
    root = tree.getroot()
    for reference in tree.iter("{*}Reference"):
        value = reference.find("{*}DigestValue")
        if value is None or value.text:
            continue
        if uri := reference.get("URI"):
            data = canonical(root.find(f".//*[@Id='{uri[1:]}']"), reference.find(".//{*}Transform"))
        else:
            plain = parse_signed(re.sub("<ds:Signature.*</ds:Signature>", "", text, flags=re.S).encode())
            data = canonical(plain, reference.find(".//{*}Transform[last()]"))
        digest = hashes.Hash(hashes.SHA256())
        digest.update(data)
        value.text = b64encode(digest.finalize()).decode()
    (info,) = tree.iter("{*}SignedInfo")
    data = canonical(info, info.find("{*}CanonicalizationMethod"), comments=True)
    numbers = utils.decode_dss_signature(key.sign(data, ec.ECDSA(hashes.SHA256())))
    next(tree.iter("{*}SignatureValue")).text = b64encode(b"".join(one.to_bytes(32) for one in numbers)).decode()
    return canonical(tree, comments=True).decode()


def advanced(certificate, key, *, content=CONTENT, change=lambda text: text, by=None, **form):
    """A file with a XAdES signature that names `certificate`; `change` is made before it is signed."""
    made = change(template(certificate, **form))
    shown = b64encode((by or certificate).public_bytes(serialization.Encoding.DER)).decode()
    made = made.replace(
        "<ds:X509Data/>", f"<ds:X509Data><ds:X509Certificate>{shown}</ds:X509Certificate></ds:X509Data>"
    )
    text = content.decode()
    end = text.rindex("</")
    return sealed(f"{text[:end]}{made}{text[end:]}", key).encode()
