"""What a certificate says beside the results: nothing may be missing, empty or out of order."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_outcome import DAY, RECALLED, TOLD, about, certificate, outcome

from refusals import refuses
from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.wings.laboratory.certificate.administrative_data import (
    AdministrativeData,
    read_administrative_data,
    template,
    xml_text,
)
from truearm.wings.laboratory.pages.certificate_page import certificate_page


def test_the_template_has_every_key_and_is_refused_until_it_is_filled_in(tmp_path):
    text = template()
    for model in (
        AdministrativeData,
        *(AdministrativeData.model_fields[key].annotation for key in ("item", "laboratory", "customer")),
    ):
        for key in model.model_fields:
            assert re.search(rf"^(# )?({key} = |\[+{key}\])", text, flags=re.M) or model is not AdministrativeData
    (tmp_path / "about.toml").write_text(text)
    refused = refuses("is missing|is empty", read_administrative_data, tmp_path / "about.toml")
    assert refused.file == tmp_path / "about.toml"
    empty = re.findall(r'^(\w+) = ""', text, flags=re.M)
    missing, texts, country = refused.faults[0], refused.faults[1], refused.faults[2:]
    assert missing.problem == "the key conditions.temperature_degC is missing"
    assert texts.problem.endswith(": the text is empty")
    assert len(texts.problem.partition(":")[0].split(", ")) == len(empty) == 17
    assert country == ()
    filled = re.sub(r'^country = ""', 'country = "DE"', text.replace("# temp", "temp"), flags=re.M)
    filled = re.sub(r'^(\w+) = ""', r'\1 = "x"', filled, flags=re.M)
    assert parse_toml(filled.encode(), AdministrativeData).place == "laboratory"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"number": None}, "(?s)number.*Field required"),
        ({"number": " \t"}, "(?s)number.*is empty"),
        ({"place": "moon"}, "place"),
        ({"site": None}, "address of the place 'customerBranch' is missing"),
        ({"place": "laboratory"}, "an address of the place beside place = 'laboratory'"),
        ({"replaces": TOLD["replaces"] | {"number": "V-1"}}, "'V-1' replaces itself"),
        ({"replaces": {"number": "V-0", "change": "amended"}}, "(?s)reason.*Field required"),
        ({"adjustment": {"kind": "cleaning", "work": "w"}}, "adjustment"),
        ({"notes": {"deviations": " "}}, "(?s)deviations.*is empty"),
        ({"notes": {"other": "o"}}, "other"),
        ({"persons": []}, "persons"),
        ({"persons": [{"name": "p"}]}, "no person signs"),
        ({"issued": DAY.replace(day=1)}, "before the arm was received"),
        ({"laboratory": TOLD["laboratory"] | {"country": "Germany"}}, "two capital letters, got 'Germany'"),
        ({"conditions": {"temperature_degC": (21.0, 20.0)}}, "lowest and the highest"),
        ({"conditions": {"temperature_degC": (293.0, 294.0)}}, "from -50 to 100"),
        (
            {"conditions": {"temperature_degC": (20.0, 20.0), "relative_humidity_percent": (40.0, 400.0)}},
            "from 0 to 100",
        ),
    ],
)
def test_what_is_wrong_is_said(changes, told):
    with pytest.raises(ValueError, match=told):
        about(**changes)


def test_all_faults_of_the_file_are_said_at_once(tmp_path):
    text = re.sub(r"(?s)\[set_up\].*?(?=\[laboratory\])", "", template())
    for before, after in (
        ("issued = 1900-01-01", "issued = 2026-01-01"),
        ("# received = 1900-01-01", "received = 2026-01-02"),
        ('place = "laboratory"', 'place = "moon"'),
        ("# temperature_degC = [0.0, 0.0]", "temperature_degC = [21.0, 20.0]"),
        ("model =", "modell ="),
        ('[[persons]]  # responsible persons; main_signer for the one who signs\nname = ""', '[[persons]]\nname = "x"'),
        ('role = ""\nmain_signer = true', ""),
    ):
        assert before in text
        text = text.replace(before, after)
    (tmp_path / "about.toml").write_text(text)
    refused = refuses(None, read_administrative_data, tmp_path / "about.toml")
    lines = str(refused).splitlines()
    assert lines[0] == f"{tmp_path / 'about.toml'}: 7 faults"
    for told in (
        "unknown key item.modell",
        "the key set_up is missing",
        "received: issued on 2026-01-01, before the arm was received on 2026-01-02",
        "number, item.maker, item.serial_number, laboratory.name",
        "place: expected 'laboratory'",
        "persons: no person signs",
        "conditions.temperature_degC: expected the lowest and the highest",
    ):
        assert sum(told in line for line in lines) == 1, told


def test_all_contradictions_to_the_points_are_said_at_once():
    told = about(issued=DAY.replace(day=2), received=DAY.replace(day=1))
    told = told.model_copy(update={"conditions": told.conditions.model_copy(update={"temperature_degC": (30.0, 32.0)})})
    refused = refuses(None, certificate, told)
    said = [fault.problem.split(" ")[0] for fault in refused.faults]
    assert said == ["issued", "issued", "the"]  # end of the measurement, confirmation, room


def test_days_must_fit_those_of_the_points():
    with pytest.raises(InputError, match="issued on 2026-11-02, before the last points were measured on 2026-11-03"):
        certificate(about(issued=DAY.replace(day=2), received=DAY.replace(day=1)))
    with pytest.raises(
        InputError, match="the arm was received on 2026-11-04, after points were measured on 2026-11-03"
    ):
        certificate(about(received=DAY.replace(day=4)))
    assert certificate(about(received=DAY, issued=DAY)).begin == DAY


@given(st.text(max_size=50))
def test_texts_are_such_that_xml_holds_them(text):
    made = xml_text(text)
    assert made == made.strip()
    assert xml_text(made) == made
    made.encode("utf-8")
    assert not re.search("[\x00-\x1f\ud800-\udfff\ufffe\uffff]", made)


def entries(made):
    """The tables without heads, by section."""
    page = certificate_page(made, outcome())
    return {section.title: [row for table in section.tables for row in table.rows] for section in page.sections}


def test_people_read_all_of_it():
    read = entries(certificate(made=outcome()))
    assert ("serial number", "7") in read["Arm"]
    assert ("software", "Example Measure 4.2") in read["Arm"]
    assert ("place", "00000 Exampletown, DE") in read["Laboratory and customer"]
    assert ("street", "Gauge Street 1") in read["Laboratory and customer"]
    assert ("First Example", "head, signs the certificate") in read["Laboratory and customer"]
    assert ("relative humidity", "40.1 to 55 %") in read["Conditions"]
    assert ("condition", "scratched base") in read["Arm"]
    address = "Example Works, Caliper Road 2, 00000 Exampletown, DE"
    assert ("place", f"at a branch of the customer: {address}") in read["Conditions"]
    lean = entries(certificate(about(received=None, conditions={"temperature_degC": (20.0, 20.0)})))
    assert {"arm received", "relative humidity"}.isdisjoint(name for name, _ in lean["Conditions"])


def test_people_read_what_the_laboratory_states_in_its_own_words():
    page = certificate_page(certificate(), outcome())
    texts = {section.title: section.text.split("\n\n") for section in page.sections}
    assert "This certificate replaces certificate No. V-0; reason: wrong serial number. Coordinates" in page.subtitle
    assert texts["Use of this certificate"][:5] == [
        "Additions to, deviations and exclusions from the method: bar in five positions only",
        "Results of an external provider: form of the ball by Example Partner",
        "Information provided by the customer, for which the laboratory is not responsible: limits of the arm",
        "Recommended calibration interval, as agreed with the customer: 12 months",
        "Opinions and interpretations, no results: joint 4 wears",
    ]
    assert texts["As found and as left"] == list(certificate().texts("adjustment"))
    both = certificate_page(certificate(as_found=outcome()), outcome()).sections[1]
    assert next(row[-1] for row in both.tables[0].rows) == "not conform"
    lean = certificate_page(
        certificate(about(**dict.fromkeys(("site", "replaces", "adjustment", "notes")), place="customer")), outcome()
    )
    assert "As found and as left" not in [section.title for section in lean.sections]
    assert ("place", "at the customer: Example Customer, Gauge Street 1, 00000 Exampletown, DE") in [
        row for section in lean.sections for table in section.tables for row in table.rows
    ]


def test_the_page_begins_with_the_verdict_or_with_the_mark():
    page = certificate_page(certificate(), outcome())
    assert page.verdict is not None
    assert (page.verdict.state, page.verdict.sentence[:12]) == ("bad", "Not conform:")
    # Values that do not conform come first, those without a limit have no verdict.
    (results,) = page.sections[0].tables
    assert [row[-1] for row in results.rows][:3] == [
        "not conform",
        "undecided, within the limit",
        "undecided, beyond the limit",
    ]
    assert results.rows[-1][-1] is None
    marked = certificate(made=outcome(plan=RECALLED), unconfirmed=True)
    page = certificate_page(marked, outcome(plan=RECALLED))
    assert page.verdict is not None
    assert (page.verdict.state, page.verdict.sentence) == ("doubtful", "Not for conformity decisions.")
    (results,) = page.sections[0].tables
    assert "verdict" not in [column.heading for column in results.columns]
    assert page.sections[0].figures == ()


@pytest.mark.parametrize("room", [(30.0, 32.0), (10.0, 12.0)])
def test_a_room_in_which_the_artefacts_did_not_stand_is_refused(room):
    found = outcome()
    assert found.temperatures is not None
    told = about()
    told = told.model_copy(update={"conditions": told.conditions.model_copy(update={"temperature_degC": room})})
    refuses(r"the room was at .* degC, artefacts at", certificate, told)
