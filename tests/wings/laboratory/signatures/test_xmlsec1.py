"""Signatures both ways against another program: xmlsec1, as Debian has it."""

import datetime
import re
import shutil
import subprocess

import pytest
from cryptography.hazmat.primitives.asymmetric import rsa

from made_up_signers import (
    C14N,
    CONTENT,
    ENVELOPED,
    EXCLUSIVE,
    FILTER,
    XADES,
    XPATH,
    authority,
    certified,
    curve_key,
    template,
    write,
)
from refusals import refuses
from truearm.wings.laboratory.signatures.x509_certificates import read_signer
from truearm.wings.laboratory.signatures.xml_signatures import GOOD, sign_xml, verified_content

XMLSEC1 = shutil.which("xmlsec1")
pytestmark = pytest.mark.skipif(XMLSEC1 is None, reason="no xmlsec1 here (on Debian: apt-get install xmlsec1)")
INCLUSIVE = "http://www.w3.org/TR/2001/REC-xml-c14n-20010315"


def xmlsec1(*arguments):
    ids = ["--id-attr:Id", f"{XADES}:SignedProperties"]
    command, *others = map(str, arguments)
    return subprocess.run([XMLSEC1, command, *ids, *others], capture_output=True, timeout=60, check=False)


@pytest.fixture(scope="module")
def signers(tmp_path_factory):
    """A laboratory with keys of two kinds, and one whose certificate is by an authority below another one."""
    folder = tmp_path_factory.mktemp("signers")
    for name, key in (("ec", curve_key()), ("rsa", rsa.generate_private_key(65537, 2048))):
        write(folder, name, key, certified(key))
    root = authority("Root CA")
    middle = authority("Middle CA", by=root)
    key = curve_key()
    write(folder, "lab", key, certified(key, by=middle))
    write(folder, "root", *root)
    write(folder, "middle", *middle)
    return folder


def signed_by_xmlsec1(folder, signers, name, made, content=CONTENT, others=()):
    file = folder / "template.xml"
    file.write_bytes(content.replace(b"</a>", made.encode() + b"</a>"))
    keys = ",".join(str(signers / one) for one in (f"{name}.key", f"{name}.pem", *others))
    ran = xmlsec1("--sign", "--privkey-pem", keys, "--output", folder / "signed.xml", file)
    assert ran.returncode == 0, ran.stderr
    return (folder / "signed.xml").read_bytes()


@pytest.mark.parametrize("name", ["ec", "rsa"])
def test_our_signatures_are_good_for_xmlsec1(signers, tmp_path, name):
    file = tmp_path / "signed.xml"
    file.write_bytes(sign_xml(CONTENT, read_signer(signers / f"{name}.key", signers / f"{name}.pem")))
    assert xmlsec1("--verify", "--trusted-pem", signers / f"{name}.pem", file).returncode == 0
    file.write_bytes(file.read_bytes().replace("5 µm".encode(), "9 µm".encode()))
    assert xmlsec1("--verify", "--trusted-pem", signers / f"{name}.pem", file).returncode != 0


@pytest.mark.parametrize(
    "form",
    [
        {},
        {"canonical": EXCLUSIVE, "info": C14N},
        {"canonical": INCLUSIVE, "info": INCLUSIVE, "kind": "rsa"},
        {"canonical": EXCLUSIVE + "WithComments", "info": EXCLUSIVE + "WithComments"},
        {"canonical": ""},
        {"removal": XPATH, "canonical": EXCLUSIVE},
        {"removal": FILTER, "canonical": EXCLUSIVE},
        {"removal": ENVELOPED + XPATH},
    ],
)
@pytest.mark.parametrize("xades", [False, True])
def test_signatures_of_xmlsec1_are_good_and_changed_ones_are_not(signers, tmp_path, form, xades):
    name = "rsa" if form.get("kind") == "rsa" else "ec"
    signer = read_signer(signers / f"{name}.key", signers / f"{name}.pem")
    comment = b'<?keep this?><!-- 1 --><a xmlns:b="urn:b"><!-- 2 --><b:c>5 \xc2\xb5m</b:c> <d/> </a><!-- 3 -->\n<?too?>'
    made = template(signer.certificate if xades else None, **form)
    content = signed_by_xmlsec1(tmp_path, signers, name, made, comment)
    read, signature = verified_content(content, trusted=signers / f"{name}.pem")
    assert b"<d></d>" in read
    assert b"2" not in read
    assert read.startswith(b"<?keep this?>\n<a")
    assert read.endswith(b"</a>\n<?too?>")
    assert signature is not None
    assert (signature.answer, signature.trusted) == (GOOD, True)
    time = datetime.datetime(2026, 3, 1, 12, 30, tzinfo=datetime.UTC)
    assert signature.signed_at == (time if xades else None)
    for old, new in ((b"<d/>", b"<d>9</d>"), (b"<?keep this?>", b""), (b"<?keep", b"<?lose"), (b"<?too?>", b"<?two?>")):
        changed = content.replace(old, new)
        assert changed != content
        refuses("the signature is broken", verified_content, changed, trusted=signers / f"{name}.pem")
    if xades:
        refuses("the part '#props' was changed", verified_content, content.replace(b"12:30:00Z", b"12:31:00Z"))


@pytest.mark.parametrize("added", ['<?xml-stylesheet type="text/xsl" href="other.xsl"?>', "<?b?><?c?>"])
def test_what_is_added_outside_of_the_root_is_found_as_xmlsec1_finds_it(signers, tmp_path, added):
    content = sign_xml(CONTENT, read_signer(signers / "ec.key", signers / "ec.pem")).decode()
    head, root = content.split("?>", 1)
    for changed in (f"{head}?>{added}{root}", content + added):
        refuses(r"the signature is broken: .*\?> outside of the root is not signed", verified_content, changed.encode())
        (tmp_path / "changed.xml").write_text(changed)
        assert xmlsec1("--verify", "--trusted-pem", signers / "ec.pem", tmp_path / "changed.xml").returncode != 0


def test_a_chain_to_an_authority_is_good_for_both(signers, tmp_path):
    content = signed_by_xmlsec1(tmp_path, signers, "lab", template(), others=("middle.pem",))
    assert len(re.findall(b"<(?:ds:)?X509Certificate>", content)) == 2
    assert xmlsec1("--verify", "--trusted-pem", signers / "root.pem", tmp_path / "signed.xml").returncode == 0
    assert xmlsec1("--verify", "--trusted-pem", signers / "ec.pem", tmp_path / "signed.xml").returncode != 0
    _, signature = verified_content(content, trusted=signers / "root.pem")
    assert signature is not None
    assert (signature.trusted, signature.authority, signature.issuer) == (True, "CN=Root CA", "CN=Middle CA")
    refuses("is not one that you trust and has no chain to one", verified_content, content, trusted=signers / "ec.pem")
