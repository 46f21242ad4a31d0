"""``truearm certificate``: from a technician's files to a certificate, or nothing and what to do."""

import json
import re
import tomllib
import xml.etree.ElementTree as ET
from hashlib import sha256
from pathlib import Path

import pytest
from made_up_certificate import ABOUT, CONFIRMED_PLAN, confirm
from made_up_verification import ARTEFACTS, MPE, Made

import truearm as ta
from page_transcripts import block, blocks
from truearm.errors import InputError
from truearm.wings.laboratory.certificate.dcc_reader import read_dcc
from truearm.wings.laboratory.signatures.xml_signatures import sign_xml
from truearm.wings.laboratory.standards.verification_plan import plan_text

pytestmark = pytest.mark.usefixtures("undrawn")

OPTIONS = "--test-plan my-plan.toml --measured points.csv --artefacts artefacts.toml --mpe mpe.toml".split()  # noqa: SIM905
ALL = ["certificate", *OPTIONS, "--about", "about.toml", "--out", "certificate.xml", "--page", "certificate.html"]
ARM_SOFTWARE = "Coordinates: from the software of the arm, without a model of truearm."


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A folder with all files of a good arm's certificate."""
    monkeypatch.chdir(tmp_path)
    Path("points.csv").write_text(Made().iso().text("10017"), encoding="utf-8")
    Path("artefacts.toml").write_text(ARTEFACTS, encoding="utf-8")
    Path("mpe.toml").write_text(MPE, encoding="utf-8")
    Path("about.toml").write_text(ABOUT, encoding="utf-8")
    Path("my-plan.toml").write_text(CONFIRMED_PLAN, encoding="utf-8")
    return tmp_path


def test_a_certificate_for_machines_and_for_people(truearm, bench):
    ran = truearm(*ALL).done()
    assert (
        ran.out == f"certificate V-2026-042, conform\n{ARM_SOFTWARE}\n"
        "certificate written to certificate.xml\npage written to certificate.html\n"
    )
    made = read_dcc("certificate.xml")
    assert made.about.number == "V-2026-042"
    assert (str(made.begin), str(made.end), made.conformity) == ("2026-11-03", "2026-11-03", "pass")
    by_name = {result.quantity.name: result for result in made.results}
    form = by_name["P_Form.Sph.1x25, position 2"]
    assert (str(form.limit.value), form.conformity) == ("0.03", "pass")
    assert by_name["L_Dia.5x5, largest distance, position 1"].conformity is None
    assert {one.certificate for one in made.equipment} == {"K-101", "K-102"}
    assert made.methods[1].norm == "ISO 10360-12:2016"
    html = Path("certificate.html").read_text(encoding="utf-8")
    for part in (
        "Calibration certificate V-2026-042",
        "Example Laboratory",
        "Exampleville",
        "10017",
        "K-102",
        "fixture",
    ):
        assert part in html
    # The same values, to the same digits.
    for result in made.results:
        assert f"{result.quantity.value:f}".replace("-", "\u2212").partition(".")[2] in html
    before = Path("certificate.xml").read_bytes()
    assert truearm(*ALL, "--force").code == 0
    assert Path("certificate.xml").read_bytes() == before


@pytest.mark.parametrize("there", ["certificate.xml", "certificate.html"])
def test_an_issued_certificate_and_its_page_are_kept_without_force(truearm, refused, bench, there):
    Path(there).write_text("issued", encoding="utf-8")
    refused(ALL, f"{there}: the file exists already. Try: another name, or --force to replace it")
    truearm(*ALL, "--force").done()
    assert "V-2026-042" in Path(there).read_text(encoding="utf-8")


def test_also_what_does_not_conform_gets_its_certificate(truearm, bench):
    Path("points.csv").write_text(Made(too_large=60e-6).iso().text("10017"), encoding="utf-8")
    ran = truearm(*ALL)
    assert (ran.code, ran.out) == (
        0,
        (
            f"certificate V-2026-042, not conform\n{ARM_SOFTWARE}\n"
            "certificate written to certificate.xml\npage written to certificate.html\n"
        ),
    )
    assert read_dcc("certificate.xml").conformity == "fail"
    assert "the decision rule 'simple' is not that of the test plan" in truearm(*ALL, "--force", "--rule", "simple").err
    Path("my-plan.toml").write_text(confirm(plan_text("iso10360-12"), "simple"), encoding="utf-8")
    assert truearm(*ALL, "--force").code == 0
    assert "simple acceptance" in read_dcc("certificate.xml").texts("decision rule")[0]


def test_the_points_of_another_arm_are_refused_with_both_numbers(refused, bench):
    Path("points.csv").write_text(Made().iso().text("10018"), encoding="utf-8")
    refused(
        ALL,
        "about.toml: item.serial_number: the certificate is of the arm with serial number '10017', the points are of "
        "'10018'. Try: give the points of this arm, or correct the number that is wrong",
    )


def test_a_certificate_states_the_reason_for_which_the_points_of_another_number_were_accepted(truearm, bench):
    Path("points.csv").write_text(Made().iso().text("10018"), encoding="utf-8")
    ran = truearm(*ALL, "--accept", "the plate was renewed: 10018 is now 10017", "--json").done()
    (said,) = json.loads(ran.out)["accepted"]
    assert said.startswith("Accepted (the plate was renewed: 10018 is now 10017): item.serial_number: the certificate")
    assert said in read_dcc("certificate.xml").texts("remark")
    assert "the plate was renewed" in Path("certificate.html").read_text(encoding="utf-8")


OF_MODEL = {"coordinates_from": "truearm 0.1.0", "model": "arm.truearm (physical)", "model_sha256": "ab" * 32}


def test_every_form_of_the_certificate_says_with_which_model_the_results_hold(truearm, bench):
    Path("points.csv").write_text(Made().iso().text("10017", **OF_MODEL, outside_training="1"), encoding="utf-8")
    ran = truearm(*ALL, "--json").done()
    stated = json.loads(ran.out)["coordinates"]
    n = stated["n_points"]
    assert stated == {
        "from": "truearm 0.1.0",
        "model": "arm.truearm (physical)",
        "model_sha256": "ab" * 32,
        "n_outside_training": n,
        "n_points": n,
    }
    said = (
        f"Coordinates: computed from joint angles by truearm 0.1.0 with the model arm.truearm (physical), SHA-256 "
        f"{'ab' * 32}; {n} of {n} readings are outside the range that the model was trained on."
    )
    made = read_dcc("certificate.xml")
    assert made.texts("coordinates") == (said,)
    (limits,) = made.texts("limits of use")
    assert f"coordinates computed by truearm 0.1.0 with the model arm.truearm (physical), SHA-256 {'ab' * 32}" in limits
    assert "do not hold for coordinates of the software of the arm (Example Measure 4.2, firmware 1.17)" in limits
    assert f"{n} of {n} readings were outside" in limits
    html = Path("certificate.html").read_text(encoding="utf-8")
    assert html.count(said) == 1
    assert limits in html
    verify = ("verify", *OPTIONS, "--page", "verification.html")
    assert said in truearm(*verify).out.splitlines()
    assert said.removeprefix("Coordinates: ") in Path("verification.html").read_text(
        encoding="utf-8"
    )  # among data and settings
    assert said in truearm("certificate", "--read", "certificate.xml").out.splitlines()


def test_an_arm_is_certified_as_found_and_as_left(truearm, refused, bench):
    Path("before.csv").write_text(
        Made(too_large=60e-6).iso().text("10017").replace("2026-11-03", "2026-11-02"), encoding="utf-8"
    )
    refused([*ALL, "--as-found", "before.csv"], "no adjustment or repair is stated. Try: add the table [adjustment]")
    Path("about.toml").write_text(
        f'{ABOUT}\n[adjustment]\nkind = "adjustment"\nwork = "a model of truearm"\n', encoding="utf-8"
    )
    Path("copies.csv").write_text(
        Path("points.csv").read_text(encoding="utf-8").replace("2026-11-03", "2026-11-02"), encoding="utf-8"
    )
    ran = truearm(*ALL, "--as-found", "copies.csv")
    assert (ran.code, ran.err.startswith("truearm: copies.csv, line 2: points as found: test 'probing'")) == (2, True)
    ran = truearm(*ALL, "--as-found", "before.csv").done()
    made = read_dcc("certificate.xml")
    (said,) = made.texts("adjustment")
    assert said in ran.out.splitlines()
    assert "after this adjustment: a model of truearm. As found, measured on 2026-11-02: Not conform" in said
    assert (str(made.begin), str(made.end), made.conformity) == ("2026-11-02", "2026-11-03", "pass")
    assert {one.conformity for one in made.as_found} >= {"fail", "pass"}
    html = Path("certificate.html").read_text(encoding="utf-8")
    assert said in html
    assert "before.csv" in html


def test_a_certificate_without_traceability_says_so_first(truearm, bench):
    text = ARTEFACTS.replace('issuer_accreditation = "X-K-00001-01-00"\n', "").replace("K-102", "none")
    Path("artefacts.toml").write_text(text, encoding="utf-8")
    ran = truearm(*ALL).done()
    said = (
        "No metrological traceability to the SI units is shown. It is not shown of ball (not stated: accreditation of "
        "that laboratory); bar (not stated: number of the certificate, accreditation of that laboratory)."
    )
    assert said in ran.out.splitlines()
    assert said in Path("certificate.html").read_text(encoding="utf-8")
    assert read_dcc("certificate.xml").texts("traceability") == (said,)
    assert json.loads(truearm(*ALL, "--force", "--json").out)["traceable"] is False


def test_points_of_two_origins_are_refused_with_their_lines(refused, bench):
    lines = Made().iso().text("10017").splitlines()
    Path("points.csv").write_text(
        "\n".join([*lines[:30], *(one.removesuffix("arm software") for one in lines[30:])]), encoding="utf-8"
    )
    refused(ALL, f"arm software in lines 2 to 30; not stated in lines 31 to {len(lines)}")


@pytest.mark.parametrize("number", [None, pytest.param("", marks=pytest.mark.weekly)])
def test_points_without_a_serial_number_are_certified_and_that_is_said(truearm, bench, number):
    Path("points.csv").write_text(Made().iso().text(number), encoding="utf-8")
    ran = truearm(*ALL).done()
    assert ran.out.splitlines()[2].startswith(
        "The points do not state the serial number of the arm: truearm could not compare it with '10017'."
    )
    assert "not stated" in Path("certificate.html").read_text(encoding="utf-8")
    stated = json.loads(truearm(*ALL, "--force", "--json").out)
    assert (stated["serial_number"], stated["serial_number_in_points"]) == ("10017", None)


def test_a_plan_of_the_user_is_stated_as_such(truearm, bench):
    truearm(*ALL).done()
    digest = sha256(CONFIRMED_PLAN.encode()).hexdigest()
    stated = read_dcc("certificate.xml").methods[1].description
    assert f"the user, named iso10360-12, SHA-256 {digest}. Its entries were confirmed against ISO 10360-12" in stated
    assert "by First Example, head of the laboratory on 2026-11-02. Numbers and formulas, and where they" in stated
    assert "stand: probing: points = 25 (clause 6.2), " in stated
    assert "Where each number stands" in Path("certificate.html").read_text(encoding="utf-8")
    assert digest in Path("certificate.html").read_text(encoding="utf-8")


def test_without_confirmed_numbers_a_certificate_is_refused_or_marked(truearm, refused, bench, snapshot):
    Path("my-plan.toml").write_text(plan_text("iso10360-12"), encoding="utf-8")
    there = snapshot(bench)
    for plan in ("my-plan.toml", "iso10360-12"):
        refused(
            [(plan if part == "my-plan.toml" else part) for part in ALL],
            "no certificate: 28 entries are not confirmed against ISO 10360-12:2016 in the test plan",
            "verify plan iso10360-12 > my-plan.toml",
        )
        assert snapshot(bench) == there
    ran = truearm(*ALL, "--unconfirmed").done()
    assert ran.out.startswith(
        "certificate V-2026-042, not for conformity decisions\nNot for conformity decisions: 28 entries are"
    )
    for form in ("certificate.html", "certificate.xml"):  # each entry once, with the plan
        written = Path(form).read_text(encoding="utf-8")
        assert written.count("listed with the test plan") == 1
        assert "probing.points" not in written  # the key of an entry
        assert written.count("(not confirmed)") == (28 if form.endswith("xml") else 0)
    assert (
        read_dcc("certificate.xml").conformity,
        "conformity>" in Path("certificate.xml").read_text(encoding="utf-8"),
    ) == (None, False)


def test_a_certificate_for_paper_has_the_one_for_machines_inside(truearm, bench, key):
    pikepdf = pytest.importorskip("pikepdf", reason="pip install pikepdf reads PDF files")
    pytest.importorskip("typst", reason="pip install truearm[pdf] writes PDF files")
    Path("my-plan.toml").write_text(plan_text("iso10360-12"), encoding="utf-8")
    ran = truearm(*ALL, "--unconfirmed", "--pdf", "certificate.pdf", "--key", "key.pem", "--signer", "signer.pem")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.endswith("PDF written to certificate.pdf\n")
    with pikepdf.open("certificate.pdf") as pdf:
        assert pdf.Root.AF[0].EF.F.read_bytes() == Path("certificate.xml").read_bytes()
        meta = pdf.open_metadata()
        assert meta["dc:title"] == "Calibration certificate V-2026-042"
        assert "not for conformity decisions" in meta["dc:description"]
    pytest.importorskip("pypdf", reason="pip install truearm[pdf] reads PDF files")
    of_xml, of_pdf = (
        truearm("certificate", "--read", f"certificate.{form}", "--trusted", "signer.pem").out.splitlines()
        for form in ("xml", "pdf")
    )
    assert of_pdf.pop(2) == "This is the XML file attached to the PDF file; truearm does not read the sheets."
    assert of_pdf == of_xml
    assert ta.read_certificate("certificate.pdf").from_pdf


def test_without_the_package_for_pdf_files_nothing_is_written(refused, bench, without_extras):
    refused([*ALL, "--pdf", "certificate.pdf"], "pip install 'truearm[pdf]'")


@pytest.fixture
def key(bench):
    """The key of a laboratory and its certificate, made for this test."""
    pytest.importorskip("signxml", reason="pip install truearm[sign] signs and verifies")
    from made_up_signers import certified, curve_key, write

    made = curve_key()
    write(bench, "signer", made, certified(made, begin=2026, end=2028))
    Path("signer.key").rename("key.pem")


def test_a_signed_certificate_is_verified_when_it_is_read(truearm, bench, key):
    truearm(*ALL, "--key", "key.pem", "--signer", "signer.pem").done()
    assert read_dcc("certificate.xml").conformity == "pass"
    assert "signed by" in Path("certificate.html").read_text(encoding="utf-8")
    for name in ("certificate.xml", "certificate.html"):
        assert "PRIVATE" not in Path(name).read_text(encoding="utf-8")
    read = truearm("certificate", "--read", "certificate.xml").done()
    first, second, *_ = read.out.splitlines()
    assert first == "certificate V-2026-042, conform"
    good = "The signature is good; signed by CN=Example Laboratory, time not stated; verified by its own certificate:"
    assert second.startswith(good)
    read = truearm("certificate", "--read", "certificate.xml", "--trusted", "signer.pem", "--json")
    assert json.loads(read.out)["signature"]["trusted"] is True
    text = Path("certificate.xml").read_text(encoding="utf-8")
    assert ">0.03<" in text
    Path("changed.xml").write_text(text.replace(">0.03<", ">0.04<"), encoding="utf-8")
    read = truearm("certificate", "--read", "changed.xml")
    assert (read.code, read.out) == (1, "")
    assert read.err.startswith("truearm: changed.xml: the signature is broken: the content was changed after it was")
    read = truearm("certificate", "--read", "changed.xml", "--json")
    assert (read.code, json.loads(read.out)["signature"]["answer"]) == (1, "broken")


def test_a_signature_that_is_not_verifiable_here_is_neither_good_nor_broken(truearm, bench, key):
    """Without its certificate it can be of anybody; by another than the trusted one it is not known here."""
    assert truearm(*ALL, "--key", "key.pem", "--signer", "signer.pem").code == 0
    text = Path("certificate.xml").read_text(encoding="utf-8")
    Path("bare.xml").write_text(re.sub("<ds:KeyInfo>.*</ds:KeyInfo>", "", text, flags=re.S), encoding="utf-8")
    read = truearm("certificate", "--read", "bare.xml")
    assert (read.code, read.err) == (3, "")
    assert read.out.splitlines()[1] == (
        "The signature is not verifiable here: the file contains no certificate of its signer. "
        "Read the file as one that is not signed."
    )
    read = truearm("certificate", "--read", "bare.xml", "--json")
    assert (read.code, json.loads(read.out)["signature"]["answer"]) == (3, "not verifiable here")
    assert truearm("certificate", "--read", "bare.xml", "--trusted", "signer.pem").code == 0
    from made_up_signers import certified, curve_key, write

    write(bench, "other", other := curve_key(), certified(other))
    read = truearm("certificate", "--read", "certificate.xml", "--trusted", "other.pem")
    assert (read.code, read.out) == (3, "")
    assert "the signature is not verifiable here: it is by CN=Example Laboratory, whose certificate" in read.err
    read = truearm("certificate", "--read", "certificate.xml", "--trusted", "other.pem", "--json")
    answer = json.loads(read.out)["signature"]
    assert (read.code, answer["answer"]) == (3, "not verifiable here")
    assert answer["reason"].startswith("it is by CN=Example Laboratory")


def test_the_certificate_of_others_says_whether_its_signature_is_good(refused, bench, key):
    """What the reader does not know of its content is no fault of its signature."""
    foreign = b'<other xmlns="urn:other"/>'
    Path("foreign.xml").write_bytes(sign_xml(foreign, ta.read_signer("key.pem", "signer.pem")))
    refused(
        ["certificate", "--read", "foreign.xml", "--trusted", "signer.pem"],
        "expected a digital calibration certificate, got <{urn:other}other>. The signature is good; signed",
    )


def test_a_certificate_is_signed_and_read_in_python_alike(truearm, bench, key):
    result = ta.certificate(
        ta.verify("points.csv", plan="my-plan.toml", artefacts="artefacts.toml", specification="mpe.toml"), "about.toml"
    )
    result.save("certificate.xml", signer=ta.read_signer("key.pem", "signer.pem"))
    names: dict = {}
    exec(block("certificate.md", "python"), names)
    assert names["read"].signature.signer == "CN=Example Laboratory"
    assert names["read"].certificate.conformity == "pass"
    assert ta.read_certificate("certificate.xml", trusted="signer.pem").signature.trusted
    assert str(names["read"]) == truearm("certificate", "--read", "certificate.xml").out.rstrip("\n")


def test_an_unsigned_certificate_says_so_and_is_not_a_trusted_one(truearm, refused, bench, key):
    assert truearm(*ALL).code == 0
    read = truearm("certificate", "--read", "certificate.xml")
    assert (read.code, read.out.splitlines()[1]) == (0, "The file is not signed: anybody can have changed it.")
    refused(["certificate", "--read", "certificate.xml", "--trusted", "signer.pem"], "the file is not signed")


def test_the_certificate_of_the_signer_was_valid_on_the_day_of_issue(refused, bench, key):
    Path("about.toml").write_text(ABOUT.replace("2026-11-", "2025-11-"), encoding="utf-8")
    Path("points.csv").write_text(Made().iso().text("10017").replace("2026-11-03", "2025-11-03"), encoding="utf-8")
    Path("artefacts.toml").write_text(ARTEFACTS.replace("date = 2026-01-15", "date = 2025-01-15"), encoding="utf-8")
    Path("my-plan.toml").write_text(CONFIRMED_PLAN.replace("date = 2026-11-02", "date = 2025-11-02"), encoding="utf-8")
    refused(
        [*ALL, "--key", "key.pem", "--signer", "signer.pem"],
        "issued on 2025-11-05; its signer's certificate is valid from 2026-01-01 to 2028-01-01",
    )


def test_a_certificate_that_is_not_for_signatures_signs_nothing(refused, bench, key):
    from made_up_signers import certified, curve_key, usage, write

    wrong = curve_key()
    write(bench, "wrong", wrong, certified(wrong, extensions=(usage(key_agreement=True),)))
    refused(
        [*ALL, "--key", "wrong.key", "--signer", "wrong.pem"], "is not for signatures", "key usage digitalSignature"
    )


def test_every_form_states_the_measuring_range_and_the_serial_numbers_of_the_artefacts(truearm, bench):
    points = (
        Path("points.csv")
        .read_text(encoding="utf-8")
        .replace("\n", ",\n")
        .replace(",\n", ",artefact_serial_number\n", 1)
    )
    Path("points.csv").write_text(points.replace(",\nprobing,ball", ",Q-4\nprobing,ball"), encoding="utf-8")
    assert truearm(*ALL).code == 0
    made = read_dcc("certificate.xml")
    assert {one.name: one.serial_number for one in made.equipment} == {"sphere ball": "Q-4", "bar bar": None}
    said = "The limits are those of measuring arm 2.5 m (its data sheet), with a measuring range of 2500 mm."
    assert made.texts("rated conditions")[0].startswith(said)
    page = Path("certificate.html").read_text(encoding="utf-8")
    for part in (said, "sphere ball, serial number Q-4, diameter", "bar bar, serial number not stated, length 1700"):
        assert part in page


def test_limits_that_nothing_was_tested_for_are_named(truearm, bench):
    Path("my-plan.toml").write_text(confirm(plan_text("iso10360-12").partition("[articulation")[0]), encoding="utf-8")
    made = Made().iso()
    made.rows = [row for row in made.rows if row["test"] == "probing"]
    Path("points.csv").write_text(made.text("10017"), encoding="utf-8")
    truearm(*ALL).done()
    made = read_dcc("certificate.xml")
    assert "All tested values conform: 2 values with a limit." in made.texts("decision")[0]
    (untested,) = (said for said in made.texts("remark") if "specification that were not tested: " in said)
    assert untested.split(": ")[1].split(", ")[:3] == ["L_Dia.5x5", "E_Uni", "E_Bi"]


def test_no_certificate_of_a_value_without_uncertainty(refused, bench):
    text = re.sub(r"(u_fixture_mm|form_mm) = [0-9.e-]+", r"\1 = 0.0", ARTEFACTS)
    Path("artefacts.toml").write_text(text, encoding="utf-8")
    refused(ALL, "truearm: artefacts.toml: P_Form", "its expanded uncertainty is 0")


def test_a_file_that_changes_meanwhile_is_noticed(truearm, bench, monkeypatch):
    from truearm.wings.laboratory.verbs import verify

    def meanwhile(*given, **named):
        Path("mpe.toml").write_text(MPE + "\n", encoding="utf-8")
        return verification_of(*given, **named)

    verification_of = verify.verify_points
    monkeypatch.setattr(verify, "verify_points", meanwhile)
    assert "mpe.toml: the file changed while it was read. Try: repeat the command" in truearm(*ALL).refused().err
    assert not Path("certificate.xml").exists()


def test_no_page_of_a_certificate_that_cannot_be_written(refused, bench, monkeypatch):
    whole = Path.replace

    def refuse(self, target):
        if Path(target).suffix == ".xml":
            raise PermissionError(13, "no permission")
        return whole(self, target)

    monkeypatch.setattr(Path, "replace", refuse)
    refused(ALL)


def test_the_template_names_what_is_to_be_filled_in(truearm, refused, bench):
    ran = truearm("verify", "template", "about").done()
    assert set(tomllib.loads(ABOUT)) - {"received"} == set(tomllib.loads(ran.out))
    Path("about.toml").write_text(ran.out, encoding="utf-8")
    refused(ALL, "about.toml: ", "Try: fill it in")


@pytest.mark.parametrize(
    ("file", "before", "after", "told"),
    [
        ("about.toml", 'name = "Example Laboratory"', 'name = ""', "laboratory.name: the text is empty. Try: fill"),
        ("about.toml", 'city = "Exampletown"\n', "", "the key laboratory.city is missing"),
        ("about.toml", 'country = "FR"', 'country = "France"', "customer.country: expected two capital letters"),
        ("about.toml", "main_signer = true", "main_signer = false", "no person signs the certificate. Try: write"),
        ("about.toml", "issued = 2026-11-05", "issued = 2026-11-02", "issued on 2026-11-02, before the last points"),
        ("about.toml", "received = 2026-11-02", "received = 2026-11-04", "was received on 2026-11-04, after points"),
        ("about.toml", "issued = 2026-11-05", 'issued = "soon"', "issued: expected a date as 2026-01-15"),
        ("about.toml", "issued = 2026-11-05", "issued = 2027-11-05", "issued: the date 2027-11-05 is in the future"),
        ("about.toml", 'serial_number = "10017"', "serial_number = 10017", "item.serial_number: "),
        ("about.toml", 'place = "laboratory"', 'place = "moon"', "place: "),
        (
            "about.toml",
            "[40.0, 55.0]",
            "[0.40, 0.55]",
            "relative_humidity_percent: 0.4 to 0.55 % is drier than any room",
        ),
        ("about.toml", "[item]", "[arm]", "unknown key arm. Try: use one of number"),
        ("about.toml", "[19.6, 20.4]", "[20.4, 19.6]", "temperature_degC: expected the lowest and the highest"),
        ("artefacts.toml", "expires = 2028-01-15", "expires = 2026-11-01", "expired on 2026-11-01"),
        ("artefacts.toml", "expires = 2028-01-15", "expires = 2025-01-15", "not after its calibration"),
        ("mpe.toml", "[limits]", "[limits]\nE_Tri = { B_um = 1 }", "unknown symbol 'E_Tri'"),
        ("points.csv", "2026-11-03", "2026-11-33", "expected a date, got '2026-11-33'"),
        ("points.csv", "2026-11-03", "2027-11-03", "line 2, column 'date': the date 2027-11-03 is in the future"),
    ],
)
def test_wrong_files_are_refused_and_nothing_is_written(refused, bench, file, before, after, told):
    text = Path(file).read_text(encoding="utf-8")
    assert before in text
    Path(file).write_text(
        text.replace(before, after) if file == "points.csv" else text.replace(before, after, 1), encoding="utf-8"
    )
    refused(ALL, file if "expired" not in told else "points.csv", told)  # on the day of those points


def test_faults_of_several_files_are_said_in_one_run(refused, bench):
    Path("my-plan.toml").write_text(plan_text("iso10360-12"), encoding="utf-8")
    Path("about.toml").write_text(ABOUT.replace("issued = 2026-11-05", "issued = 2026-11-02"), encoding="utf-8")
    Path("artefacts.toml").write_text(ARTEFACTS.replace('issued_by = "Example Calibration"\n', ""), encoding="utf-8")
    lines = refused(ALL).splitlines()
    for line, told in zip(lines, ("truearm: 3 faults", "issued on 2026", "28 entries", "'ball', 'bar'"), strict=True):
        assert told in line
    assert [line.split(":")[0] for line in lines[1:]] == [
        "  1. about.toml",
        "  2. no certificate",
        "  3. artefacts.toml",
    ]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"--about": None}, "--about is missing. Try: truearm verify template about > about.toml"),
        ({"--measured": None}, "--measured is missing"),
        ({"--out": None}, "--out is missing"),
        ({"--out": "certificate.txt"}, "ends in .xml"),
        ({"--out": "away/certificate.xml"}, "the folder away does not exist"),
        ({"--page": "points.csv"}, "ends in .html"),
        ({"--pdf": "points.csv"}, "ends in .pdf"),
        ({"--logo": "logo.png"}, "--logo applies to --pdf only"),
        ({"--key": "key.pem"}, "--key applies to --signer only"),
        ({"--read": "certificate.xml"}, "has no effect with --read"),
        ({"--trusted": "signer.pem"}, "--trusted applies to --read only"),
        ({"--page": "away/page.html"}, "the folder away does not exist"),
        ({"--about": "nothing.toml"}, "the file does not exist"),
    ],
)
def test_wrong_options_are_refused_before_any_work(refused, bench, changes, told):
    pairs = dict(zip(ALL[1::2], ALL[2::2], strict=True)) | changes
    refused(["certificate", *(part for pair in pairs.items() if pair[1] is not None for part in pair)], told)


# The docs page -------------------------------------------------------------------------------------------------------


def test_the_files_of_the_docs_page_make_its_transcript(truearm, bench):
    command, *told = block("certificate.md", "console").splitlines()
    command = command.replace("\\", "")
    ran = truearm(*command.removeprefix("$ truearm ").split())
    assert (ran.code, ran.out.splitlines()) == (0, told)
    excerpt = "".join(re.sub(r"\s+", "", part) for part in blocks("certificate.md", "xml"))
    root = re.sub(r"\s+", "", Path("certificate.xml").read_text(encoding="utf-8"))
    assert excerpt
    assert excerpt in root
    assert ET.parse("certificate.xml").getroot().get("schemaVersion") == "3.3.0"


def test_a_certificate_whose_value_was_changed_contradicts_itself(truearm, refused, bench):
    """An unsigned file: 0.9 mm beside a limit of 0.03 mm and "pass"."""
    assert truearm(*ALL).code == 0
    root = ET.fromstring(Path("certificate.xml").read_text(encoding="utf-8"))
    space = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
    result = next(
        one
        for one in root.iterfind(".//dcc:results/dcc:result", space)
        if one.findtext("dcc:name/dcc:content", "", space) == "P_Form.Sph.1x25, position 2"
    )
    result.find("dcc:data/dcc:quantity/si:real/si:value", space).text = "0.9098"
    Path("changed.xml").write_bytes(ET.tostring(root))
    refused(
        ["certificate", "--read", "changed.xml"],
        "changed.xml: 2 faults",
        "the certificate contradicts itself: P_Form.Sph.1x25, position 2 is 0.9098 mm with U = 0.00",
        "by the decision rule fail; it states pass",
        "P_Form.Sph.1x25, position 2 is 0.9098, which is none of its individual results",
    )


def test_a_room_and_artefacts_of_other_temperatures_are_said(truearm, bench):
    """Between agreement and the 3 K that are refused."""
    Path("points.csv").write_text(Made(degC=22.1).iso().text("10017"), encoding="utf-8")
    ran = truearm(*ALL).done()
    said = "he air was stated at 19.6 to 20.4 degC, the artefacts at 22.1 degC, up to 1.7 K outside: artefacts that"
    assert f"T{said}" in ran.out
    assert any(text.startswith(f"T{said}") for text in read_dcc("certificate.xml").texts("remark"))
    assert said in Path("certificate.html").read_text(encoding="utf-8")


def test_an_encrypted_key_without_a_terminal_is_refused_with_what_to_do(tmp_path):
    from made_up_signers import certified, curve_key, write
    from truearm.wings.laboratory.verbs import commands as command

    made = curve_key()
    write(tmp_path, "locked", made, certified(made), password=b"secret")
    with pytest.raises(InputError, match="no terminal to ask for its password") as caught:
        command._signer(tmp_path / "locked.key", tmp_path / "locked.pem")
    assert "read_signer(KEY, CERTIFICATE, password=...)" in caught.value.hint
