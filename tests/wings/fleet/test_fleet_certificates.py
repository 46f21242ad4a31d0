"""Certificates of a fleet's arms: number, day, verdict and next due day are in the registry, and in every state."""

import datetime
from dataclasses import replace
from hashlib import sha256

import pytest

import truearm as ta
from made_up_dcc import RECALIBRATION, dcc, quantity, real, result, text
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.fleet.certificates import RegisteredCertificate
from truearm.wings.fleet.fleet import Fleet

pytestmark = pytest.mark.usefixtures("undrawn")

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")

DAY = datetime.datetime(2026, 6, 1, tzinfo=datetime.UTC)


def foreign(**changes):
    """A certificate of another laboratory, of an item 4711 or M-7."""
    return dcc("3.3.0", result(text(en="form"), quantity(text(en="form"), real("1", r"\micro\metre"))), **changes)


@pytest.fixture
def fleet(tmp_path):
    found = Fleet.create(tmp_path / "fleet")
    found.add("4711", "ur10")
    found.add("10017", "ur10")
    yield found
    found.close()


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "4711.xml"
    path.write_text(foreign(statements=RECALIBRATION))
    return path


def test_a_certificate_of_another_laboratory_says_when_the_next_one_is_due(fleet, file):
    assert fleet.add_certificates([file]) == 1
    assert fleet.add_certificates([file]) == 0
    ((one,),) = fleet.registry.certificates().values()
    assert one == RegisteredCertificate(
        *("4711", "1234 EX 26", "2026-01-20", "not stated", "2028-01-15"),
        sha256(file.read_bytes()).hexdigest(),
        str(file),
    )
    of = {arm.serial_number: arm for arm in fleet.status(today=DAY).arms}
    assert (of["4711"].certificate, of["4711"].due, of["4711"].what) == ("1234 EX 26", "2028-01-15", "without readings")
    assert (of["10017"].certificate, of["10017"].due) == ("", "")
    late = fleet.status(today=datetime.datetime(2028, 1, 15, tzinfo=datetime.UTC)).arms[0]
    assert (late.what, late.message) == ("due", "calibration due since 2028-01-15")


def test_a_day_that_is_given_replaces_the_one_that_is_stated(fleet, file):
    fleet.add_certificates([file])
    assert fleet.add_certificates([file], due=datetime.date(2027, 1, 20)) == 1
    ((one,),) = fleet.registry.certificates().values()
    assert one.due == "2027-01-20"
    with pytest.raises(InputError, match="is due before the certificate of 2026-01-20"):
        fleet.add_certificates([file], due=datetime.date(2025, 1, 1))


def test_a_pdf_file_with_the_same_certificate_inside_is_the_same_certificate(fleet, file, tmp_path):
    pypdf = pytest.importorskip("pypdf", reason="pip install truearm[pdf] reads PDF files")
    writer = pypdf.PdfWriter()
    writer.add_blank_page(100, 100)
    writer.add_attachment("4711.xml", file.read_bytes())
    writer.write(tmp_path / "4711.pdf")
    for path in (file, tmp_path / "4711.pdf"):
        fleet.add_certificates([path])
        ((one,),) = fleet.registry.certificates().values()
        assert (one.sha256, one.file) == (sha256(file.read_bytes()).hexdigest(), str(path))


def test_a_certificate_of_this_program(fleet, tmp_path):
    simulated = ta.simulate_verification("perfect", n_arms=1)
    verified = ta.verify(simulated.points(0), artefacts=simulated.artefacts, specification=simulated.specification)
    address = {"city": "Exampletown", "country": "DE", "post_code": "00000"}
    about = ta.AdministrativeData(
        number="V-1",
        issued=datetime.date(2026, 12, 1),
        place="laboratory",
        item={"name": "measuring arm", "maker": "Example Arms", "model": "A 2500", "serial_number": "10017"},
        set_up={"stylus": "ball of ruby", "mounting": "granite table", "software": "Example Measure 4.2"},
        laboratory={"name": "Example Laboratory", **address},
        customer={"name": "Example Customer", **address},
        persons=[{"name": "First Example", "main_signer": True}],
        conditions={"temperature_degC": (19.5, 20.5)},
    )
    ta.certificate(verified, about, unconfirmed=True).save(tmp_path / "v1.xml")
    assert fleet.add_certificates([tmp_path / "v1.xml"]) == 1
    ((one,),) = fleet.registry.certificates().values()
    assert (one.serial_number, one.number, one.verdict) == ("10017", "V-1", "not for conformity decisions")
    assert one.conforms


def test_an_arm_that_does_not_conform_is_first_and_the_last_certificate_counts(fleet):
    failed = RegisteredCertificate("10017", "V-1", "2026-01-01", "not conform", "", "0" * 64, "v1.xml")
    fleet.registry.keep_certificates([failed])
    first = fleet.status().arms[0]
    assert (first.serial_number, first.what, first.message) == (
        "10017",
        "not conforming",
        "certificate V-1: not conform",
    )
    fleet.registry.keep_certificates(
        [replace(failed, number="V-2", issued="2026-02-01", verdict="conform", sha256="1" * 64)]
    )
    of = {arm.serial_number: arm for arm in fleet.status().arms}
    assert (of["10017"].what, of["10017"].certificate, of["10017"].certified) == ("without readings", "V-2", "conform")


def test_what_is_no_certificate_of_the_fleet_is_refused_and_nothing_kept(fleet, file, tmp_path):
    other, bad, same, both = (tmp_path / f"{name}.xml" for name in ("other", "bad", "same", "both"))
    other.write_text(foreign().replace("4711", "4712"))
    bad.write_text("<a>")
    same.write_text(foreign())  # the number of another content
    both.write_text(foreign().replace("M-7", "10017"))
    for wrong, message in (
        (other, "certificate of one arm of the fleet, got one of 4712, M-7"),
        (both, "certificate of one arm of the fleet, got one of 10017, 4711"),
        (bad, "bad.xml"),
        (same, "4711 has a certificate 1234 EX 26 with another content"),
    ):
        refuses(message, fleet.add_certificates, [file, wrong])
        assert fleet.registry.certificates() == {}


def test_the_command_and_the_pages_show_them(truearm, fleet, file, tmp_path):
    asked = ["fleet", "add-certificate", str(fleet.folder), str(file)]
    for more, code, said in (
        (["--due", "soon"], 2, "expected a day after --due, got 'soon'"),
        ([], 0, "1 new in the registry. Next: truearm fleet status"),
        ([], 0, "Nothing is new."),
    ):
        ran = truearm(*asked, *more)
        assert (ran.code, said in ran.out + ran.err) == (code, True), ran
    assert "1234 EX 26, not stated" in str(fleet.status())
    assert "recalibrate" not in str(fleet.status())  # a column without an entry
    fleet.write_pages(tmp_path / "overview.html")
    pages = [path.read_text(encoding="utf-8") for path in (tmp_path / "overview-arms").iterdir()]
    assert sum("1234 EX 26" in page and sha256(file.read_bytes()).hexdigest() in page for page in pages) == 1
    assert "not stated" in (tmp_path / "overview.html").read_text(encoding="utf-8")
