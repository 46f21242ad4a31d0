"""``truearm verify artefacts``: an artefact's certificate as a file to complete, or nothing and what to do."""

import json
import re
from pathlib import Path

import pytest

import truearm as ta
from made_up_dcc import BALL_BAR, SPHERE
from refusals import refuses

COMMAND = ["verify", "artefacts", "sphere.xml"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("sphere.xml").write_text(SPHERE, encoding="utf-8")
    Path("bar.xml").write_text(BALL_BAR, encoding="utf-8")
    return tmp_path


def test_a_file_of_artefacts_is_filled_in_and_what_is_missing_is_named(truearm, folder):
    ran = truearm(*COMMAND, "--out", "artefacts.toml").done()
    of, signed, filled_in, missing, written = ran.out.splitlines()
    assert of == "sphere, from certificate 1234 EX 26 of Example Institute"
    assert signed == "The file is not signed: anybody can have changed it."
    assert filled_in == (
        "filled in: name, serial_number, certificate, issued_by, issuer_accreditation, date, expires, diameter_mm, "
        "u_diameter_mm, form_mm, u_form_mm"
    )
    assert missing == (
        "not in the certificate, to fill in: expansion_per_K, u_expansion_per_K, u_temperature_K, u_fixture_mm"
    )
    assert written == "artefacts written to artefacts.toml"
    refuses(r"spheres\[1\]\.u_fixture_mm", ta.read_artefacts, "artefacts.toml")
    printed = truearm(*COMMAND)
    assert printed.out == Path("artefacts.toml").read_text(encoding="utf-8")
    assert printed.out == ta.artefacts_from_certificate("sphere.xml").text
    assert "The file is not signed" in printed.out
    stated = json.loads(truearm(*COMMAND, "--json").out)
    assert stated["draft"]["missing"] == ["expansion_per_K", "u_expansion_per_K", "u_temperature_K", "u_fixture_mm"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out", "there.toml"], "there.toml: the file exists already"),
        (["--out", "artefacts.txt"], "ends in .toml"),
        (["--out", "new.toml", "--result", "Diameter"], "expected ROLE=NAME, got 'Diameter'"),
        (["--out", "new.toml", "--result", "diameter=Radius"], "sphere.xml: the certificate has no result"),
        (["--out", "new.toml", "--mpe", "mpe.toml"], "No such option"),
        (["--out", "new.toml", "--trusted", "ca.pem"], "ca.pem|not signed"),
    ],
)
def test_nothing_is_overwritten_or_half_written(truearm, folder, snapshot, options, said):
    Path("there.toml").write_text("# mine\n", encoding="utf-8")
    there = snapshot(folder)
    ran = truearm(*COMMAND, *options).refused()
    assert any(part in ran.err for part in said.split("|")), ran.err
    assert snapshot(folder) == there


def test_certificates_of_other_laboratories_are_read(truearm, folder):
    ran = truearm("certificate", "--read", "bar.xml").done()
    assert ran.out.splitlines()[:2] == [
        "certificate 1234 EX 26 of Example Institute, DCC 3.2.1",
        "The file is not signed: anybody can have changed it.",
    ]
    stated = json.loads(truearm("certificate", "--read", "bar.xml", "--json").out)
    assert stated["results"][1]["values"][1]["value"] == -2.5
    assert stated["items"][0]["numbers"] == [["customer", "M-7"], ["manufacturer", "4711"]]


def test_a_certificate_that_an_institute_signed_is_read_with_its_signer_and_time(truearm, refused, folder):
    """The form of the national institutes: XAdES, and a certificate that an authority issued."""
    pytest.importorskip("signxml", reason="pip install truearm[sign] verifies")
    from made_up_signers import advanced, authority, certified, curve_key, write

    above, key = authority(begin=2025, end=2030), curve_key()
    write(folder, "ca", *above)
    certificate = certified(key, "Example Institute", by=above, begin=2025, end=2028)
    Path("signed.xml").write_bytes(advanced(certificate, key, content=SPHERE.encode()))
    read = truearm("certificate", "--read", "signed.xml", "--trusted", "ca.pem").done()
    good = (
        "The signature is good; signed by CN=Example Institute, certificate issued by CN=Example CA, on 2026-03-01 "
        "12:30 UTC as the signer states; verified by a chain to CN=Example CA, which you trust; nobody was asked "
        "whether a certificate was revoked."
    )
    assert read.out.splitlines()[1] == good
    drafted = truearm("verify", "artefacts", "signed.xml", "--trusted", "ca.pem", "--out", "artefacts.toml")
    assert (drafted.code, drafted.out.splitlines()[1]) == (0, good)
    late = certified(key, "Example Institute", by=above, begin=2027, end=2028)
    Path("signed.xml").write_bytes(advanced(late, key, content=SPHERE.encode()))
    read = truearm("certificate", "--read", "signed.xml")
    assert read.code == 3
    assert "signed it on 2026-03-01; its signer's certificate is valid from 2027-01-01" in read.out
    refused(["verify", "artefacts", "signed.xml", "--trusted", "ca.pem"], "not verifiable here")


def test_a_certificate_without_any_day_was_signed_on_an_unknown_one(truearm, folder):
    pytest.importorskip("signxml", reason="pip install truearm[sign] verifies")
    from made_up_signers import certified, curve_key
    from truearm.wings.laboratory.signatures.x509_certificates import Signer
    from truearm.wings.laboratory.signatures.xml_signatures import sign_xml

    key = curve_key()
    by = Signer(certified(key), key)
    Path("dated.xml").write_bytes(sign_xml(SPHERE.encode(), by))
    assert truearm("certificate", "--read", "dated.xml").code == 0
    bare = re.sub(r"<dcc:(issueDate|(begin|end)PerformanceDate)>.*?</dcc:\1>", "", SPHERE)
    Path("bare.xml").write_bytes(sign_xml(bare.encode(), by))
    read = truearm("certificate", "--read", "bare.xml")
    assert read.code == 3
    assert "states neither a day of issue nor of measurement; its signer's certificate is valid from" in read.out
