"""Certificates of other laboratories as files of artefacts: what they state is read in any form, the rest is named."""

import datetime
import re
import tomllib
import xml.etree.ElementTree as ET
from decimal import Decimal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import made_up_dcc as made_up
from made_up_dcc import (
    BALL_BAR,
    GAUGE_BLOCK,
    SPHERE,
    condition,
    dcc,
    expanded_mu,
    expanded_unc,
    listed,
    quantity,
    real,
    result,
    text,
)
from refusals import refuses
from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.wings.laboratory.certificate.artefact_draft import draft_artefact
from truearm.wings.laboratory.certificate.calibration_certificate import calibration_certificate, describe
from truearm.wings.laboratory.certificate.dcc_reader import parse_dcc_file
from truearm.wings.laboratory.certificate.dsi_quantities import MOST_VALUES, parse_unit, read_values
from truearm.wings.laboratory.standards.artefacts import Artefacts

MM, M, UM, DEGC = r"\milli\metre", r"\metre", r"\micro\metre", r"\degreecelsius"
FAR = r"\mega\metre\tothe{999}\per\metre\tothe{999}" * 300 + r"\metre"  # of metres, by 1e1798206
TO_FILL_IN = {"expires": "2028-01-15", "form_mm": "0.0003", "expansion_per_K": "5.5e-6", "u_expansion_per_K": "0.5e-6"}


def read(xml):
    return parse_dcc_file(xml.encode()).certificate


def draft(xml, **chosen):
    return draft_artefact(read(xml), chosen=chosen)


def entries(made, kind):
    (one,) = tomllib.loads(made.text)[kind]
    return one


def completed(made):
    """The artefacts of a draft whose commented keys a person has filled in."""
    filled_in = made.text
    for key in made.missing:
        filled_in = re.sub(
            rf"^# {key} = \S+", f"{key} = {TO_FILL_IN.get(key, '0.0005')}", filled_in, flags=re.MULTILINE
        )
    return parse_toml(filled_in.encode(), Artefacts)


def sphere_with(*quantities, **options):
    return dcc("3.3.0", result(text(en="Results"), *quantities), **options)


def diameter(mm="25.0004", u="0.0002", name="Diameter", unit=MM):
    return quantity(text(en=name), real(mm, unit, expanded_mu(u) if u else ""))


@pytest.mark.parametrize("name", ["SPHERE", "BALL_BAR", "GAUGE_BLOCK"])
def test_the_made_up_certificates_are_valid_by_the_schema_of_their_version(name, tmp_path):
    validation = pytest.importorskip("dcclib.validation", reason="pip install truearm[dcc] checks against the schemas")
    versions = pytest.importorskip("dcclib.validation.xsd").SchemaVersion
    xml = getattr(made_up, name)
    version = ET.fromstring(xml).get("schemaVersion").replace(".", "_")
    (tmp_path / "certificate.xml").write_text(xml)
    checked = validation.XsdValidator.from_version(versions[f"v{version}"]).validate_file(
        str(tmp_path / "certificate.xml")
    )
    assert [error.message for error in checked.errors] == []


def test_a_sphere_in_the_form_of_dcc_3_1():
    """Hand-solved: 0.0250004 m are 25.0004 mm; U = 0.2 um with k = 2 is u = 0.0001 mm."""
    made = draft(SPHERE)
    assert entries(made, "spheres") == {
        "name": "Reference sphere",
        "serial_number": "4711",
        "certificate": "1234 EX 26",
        "issued_by": "Example Institute",
        "issuer_accreditation": "EX-K-00001",
        "date": datetime.date(2026, 1, 15),
        "expires": datetime.date(2028, 1, 15),
        "diameter_mm": 25.0004,
        "u_diameter_mm": 0.0001,
        "form_mm": 0.0003,
        "u_form_mm": 0.00005,
    }
    assert made.missing == ("expansion_per_K", "u_expansion_per_K", "u_temperature_K", "u_fixture_mm")
    assert made.remarks == ()
    assert "diameter_mm = 25.0004  # Measurement results / Diameter\n" in made.text
    assert "divided by k = 2\n" in made.text
    assert completed(made).spheres[0].diameter_mm == 25.0004


def test_a_ball_bar_in_the_form_of_dcc_3_2():
    """Nominal values and deviations: 450 mm - 2.5 um are 449.9975 mm; U = 1.0 um, k = 2."""
    made = draft(BALL_BAR)
    bar = entries(made, "bars")
    assert [(one["name"], one["nominal_mm"], one["length_mm"], one["u_mm"]) for one in bar["lengths"]] == [
        ("150", 150.0, 150.001, 0.0004),
        ("450", 450.0, 449.9975, 0.0005),
        ("900", 900.0, 900.003, 0.0006),
    ]
    assert bar["serial_number"] == "4711"
    assert (bar["form_mm"], bar["u_form_mm"], bar["expansion_per_K"]) == (0.00035, 0.00005, 1.1e-6)
    assert [one.partition(":")[0] for one in made.remarks] == [
        "form_mm is the largest of 2 form deviations",
        "The certificate states no reference temperature",
    ]
    assert "expires" in made.missing
    assert completed(made).bars[0].length("450").length_mm == 449.9975


def test_a_gauge_block_in_the_form_of_dcc_3_3():
    made = draft(GAUGE_BLOCK)
    bar = entries(made, "bars")
    assert (bar["name"], bar["lengths"]) == (
        "Parallelendmaß",
        [{"name": "100", "length_mm": 100.00012, "u_mm": 0.00003}],
    )
    assert read(GAUGE_BLOCK).missing == ("accreditation of the laboratory", "day of the next calibration")
    assert completed(made).bars[0].lengths[0].u_mm == 0.00003


@settings(max_examples=40)
@given(
    st.integers(1, 10**9),
    st.integers(1, 10**4),
    st.sampled_from(["2", "2.00", "1.96", "3"]),
    st.sampled_from([(-9, r"\nano\metre"), (-6, UM), (-3, MM), (0, M)]),
    st.sampled_from([expanded_unc, expanded_mu]),
)
def test_a_diameter_is_read_to_its_last_digit_in_any_unit_and_form(nm, u_nm, k, unit, form):
    exponent, written = unit
    stated = f"{Decimal(nm).scaleb(-9 - exponent):f}"
    made = read(
        sphere_with(
            quantity(text(en="Diameter"), real(stated, written, form(f"{Decimal(u_nm).scaleb(-9 - exponent):f}", k)))
        )
    )
    ball = tomllib.loads(draft_artefact(made).text)["spheres"][0]
    assert ball["diameter_mm"] == float(Decimal(nm).scaleb(-6))
    assert ball["u_diameter_mm"] == pytest.approx(u_nm * 1e-6 / float(k), rel=0.005)  # three digits


def test_what_is_read_is_described():
    lines = list(describe(read(BALL_BAR)))
    assert (
        lines[0] == "item: Ball bar Example Spheres S 25, number of the customer M-7, number of the manufacturer 4711"
    )
    assert lines[1] == "calibrated on 2026-01-12 to 2026-01-15, issued on 2026-01-20"
    assert rf"Balls / Roundness: 0.35 {UM}, U = 0.1 (k = 2)" in lines
    assert lines[-1] == "The certificate does not state: day of the next calibration."


def test_a_table_of_a_temperature_sensor_is_read_and_has_no_artefact():
    """The form of PTB's examples: a hybrid of two lists, metadata with limits inside the quantity."""
    limits = quantity("", listed("0.2 0.3", r"\kelvin"), "basic_acceptanceLimitUpper")
    values = f"<si:hybrid>{listed('293.15 373.15', chr(92) + 'kelvin')}{listed('20 100', DEGC, '0.06')}</si:hybrid>"
    column = quantity(text(de="Bezugswert"), values).replace(
        "</dcc:quantity>",
        "<dcc:measurementMetaData><dcc:metaData><dcc:conformityXMLList>pass</dcc:conformityXMLList>"
        f"<dcc:data>{limits}</dcc:data></dcc:metaData></dcc:measurementMetaData></dcc:quantity>",
    )
    made = read(dcc("3.1.1", result(text(de="Ergebnisse"), column, kind="dcc:list"), item=text(de="Fühler")))
    ((only,),) = ([column.values for column in table.columns] for table in made.results)
    assert [(str(one.value), one.unit) for one in only] == [("293.15", r"\kelvin"), ("373.15", r"\kelvin")]
    refuses("its results are none in units of length", draft_artefact, made)


def test_a_radius_is_not_taken_for_the_diameter():
    form = diameter("0.0002", name="Form deviation")
    for more in ((), (form,)):
        radius = sphere_with(diameter("12.5002", name="Radius"), *more)
        for chosen in ({}, {"diameter": "radius"}):
            told = refuses(r"'Results / Radius' in .*, a radius: the diameter and its unc", draft, radius, **chosen)
            assert "enter diameter or lengths in mm in the empty file" in told.hint
    both = draft(sphere_with(diameter("12.5002", name="Radius"), diameter()))
    assert entries(both, "spheres")["diameter_mm"] == 25.0004
    assert any(one.startswith("Not used: 'Results / Radius' in ") for one in both.remarks)
    named = result(text(en="Radius"), diameter("12.5002", name="Measured value"))
    refuses("a radius", draft, dcc("3.3.0", named))


@pytest.mark.parametrize(
    ("name", "unit", "said"),
    [
        (
            "Deviation of length from nominal",
            UM,
            r"'Results / Deviation .* in \\micro\\metre, a deviation, whose nominal",
        ),
        ("Diameter", r"\inch", r"none in units of length: 'Results / Diameter' in \\inch, which is no unit of length"),
        (
            "Temperature deviation",
            DEGC,
            r"none in .*: 'Results / Temp.* in \\degreecelsius, which is no unit of length",
        ),
        ("Nominal diameter", MM, r"no diameter and no length: 'Results / Nominal diameter' in .*, a nominal value"),
    ],
)
def test_a_certificate_without_a_size_names_its_results_with_units_and_reasons(name, unit, said):
    assert "choose" not in refuses(said, draft, sphere_with(diameter("0.03", name=name, unit=unit))).hint


# What is open is asked -----------------------------------------------------------------------------------------------

TWO = sphere_with(diameter(name="Diameter, equator"), diameter("25.0007", name="Diameter, mean"))


def test_of_two_diameters_the_person_chooses_one():
    asked = refuses(r"states 2 diameters.*equator', 25\.0004 mm; .*mean', 25\.0007 mm", draft, TWO)
    assert asked.hint == "choose one: --result 'diameter=Results / Diameter, equator'"
    made = draft(TWO, diameter="diameter, Mean")
    assert entries(made, "spheres")["diameter_mm"] == 25.0007
    assert "Not used: Results / Diameter, equator, 25.0004 mm." in made.remarks
    several = sphere_with(quantity(text(en="Diameter"), listed("25.1 25.2", MM, "0.001")))
    refuses(r"2 diameters; its results are 'Results / Diameter \[1\]', 25\.1 mm", draft, several)
    assert entries(draft(several, diameter="Results / Diameter [2]"), "spheres")["diameter_mm"] == 25.2


@pytest.mark.parametrize(
    ("xml", "chosen", "said"),
    [
        (TWO, {"diameter": "radius"}, "no result in units of length that is called 'radius'"),
        (TWO, {"size": "x"}, "expected diameter, length, form, got 'size'"),
        (TWO, {"diameter": "a", "length": "b"}, "a sphere or a bar"),
        (sphere_with(diameter(name="Value"), item=text(en="Normal")), {}, "does not say which result is the diameter"),
        (sphere_with(diameter(), diameter("50.0", name="Length"), item=text(en="Normal")), {}, "diameters and lengths"),
        (sphere_with(diameter("-25.0")), {}, "expected a positive length, got -25.0 mm"),
        (sphere_with(diameter(u="-0.1")), {}, "is not positive"),
        (
            sphere_with(diameter("100.0", name="Length as found"), diameter("100.001", name="Length as left")),
            {},
            "the length 100 more than once",
        ),
        (
            sphere_with(
                quantity(text(en="Nominal length"), listed("1 2", MM)),
                quantity(text(en="Deviation of the length"), listed("1 2 3", UM)),
            ),
            {},
            "3 deviations, 2 nominal values",
        ),
    ],
)
def test_what_cannot_be_decided_is_said_with_what_there_is(xml, chosen, said):
    refuses(said, draft, xml, **chosen)


def test_a_sphere_whose_only_length_has_no_name_is_taken_for_the_diameter_and_that_is_said():
    made = draft(sphere_with(diameter(name="Measured value")))
    assert entries(made, "spheres")["diameter_mm"] == 25.0004
    assert made.remarks[0] == "Results / Measured value is taken for the diameter: the item is 'Reference sphere'."


def test_without_an_uncertainty_its_key_stays_open():
    made = draft(sphere_with(diameter(u="")))
    assert "u_diameter_mm" not in entries(made, "spheres")
    assert "u_diameter_mm" in made.missing
    length = draft(sphere_with(diameter("150.001", u="", name="Length"), item=text(en="Ball bar")))
    assert entries(length, "bars")["lengths"] == []
    assert '  # { name = "150", length_mm = 150.001, u_mm = nan },  # not in the certificate: U' in length.text


def test_lengths_at_another_temperature_than_20_degrees_are_left_to_the_person():
    warm = condition(text(de="Bezugstemperatur"), "23.0", DEGC)
    made = draft(sphere_with(diameter(), conditions=warm))
    assert "diameter_mm" not in entries(made, "spheres")
    assert "diameter_mm" in made.missing
    assert made.remarks[0].startswith("The lengths hold at 23.0 degC, not at 20 degC; enter L / (1 + expansion_per_K")
    assert "Diameter: 25.0004 mm" in made.remarks[0]


def test_lengths_at_several_reference_temperatures_are_left_to_the_person():
    """Which of them holds for a length is not said, so none is taken to be at 20 degC."""
    both = condition(text(de="Referenztemperatur"), "20.0", DEGC) + condition(
        text(en="Reference temperature"), "296.15", r"\kelvin"
    )
    made = draft(sphere_with(diameter(), conditions=both))
    assert "diameter_mm" in made.missing
    assert made.remarks[0].startswith(
        "The lengths hold at 20.0 or 23.00 degC, not at 20 degC; enter L / (1 + expansion_per_K * (T - 20)) for"
    )


def test_lengths_have_the_names_of_the_laboratory_where_no_nominal_value_is_stated():
    names = quantity(text(en="Gauge"), "<dcc:charsXMLList>G1 G2</dcc:charsXMLList>")
    made = draft(sphere_with(names, quantity(text(en="Length"), listed("10.0001 20.0002", MM, "0.0001"))))
    assert [one["name"] for one in entries(made, "bars")["lengths"]] == ["G1", "G2"]


# Hostile files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda xml: xml.replace('schemaVersion="3.1.1"', 'schemaVersion="2.4.0"'),
            "schema 3.x, got schema version '2.4.0'",
        ),
        (
            lambda xml: xml.replace("digitalCalibrationCertificate", "other"),
            "expected a digital calibration certificate",
        ),
        (lambda xml: xml.replace("<dcc:administrativeData>", "<!DOCTYPE a>"), "XML|DOCTYPE"),
        (lambda xml: xml.replace("0.0250004", "25,0004"), "quantity 'Diameter': expected a number, got '25,0004'"),
        (lambda xml: xml.replace("0.0250004", "NaN"), "expected a number, got 'NaN'"),
        (lambda xml: xml.replace("0.0250004", "1e999999999"), "expected a number"),
        (lambda xml: xml.replace("0.0250004", "1" * 200), "expected a number"),
        (lambda xml: xml.replace(f"<si:unit>{M}</si:unit>", ""), "<si:real> has no unit"),
        (
            lambda xml: xml.replace("0.0250004</si:value>", "1</si:value><si:value>2</si:value>"),
            "states <si:value> twice",
        ),
        (
            lambda xml: xml.replace("2026-01-15", "15.01.2026"),
            "<endPerformanceDate>: expected a date, got '15.01.2026'",
        ),
        (
            lambda xml: xml.replace(f"<si:unit>{M}", r"<si:unit>\furlong"),
            "does not say which result|none in units|Form",
        ),
        (lambda xml: xml.replace("<dcc:list>", "<dcc:list>" * 30).replace("</dcc:list>", "</dcc:list>" * 30), "nested"),
    ],
)
def test_a_broken_certificate_is_refused_with_the_reason(change, said):
    refuses(said, draft, change(SPHERE))


def test_lists_that_do_not_belong_together_and_long_ones_are_refused():
    def values(form):
        return read_values(ET.fromstring(f'<q xmlns:si="https://ptb.de/si">{form}</q>'))

    refuses("3 values, 2 entries of uncertainty", values, listed("1 2 3", MM, "0.1 0.2"))
    refuses("reads 10000 at most", values, listed("1 " * (MOST_VALUES + 1), MM))
    assert values("<si:complex/>") == ()
    refuses("expected one value or list, got 2", values, real(1, MM) + real(2, MM))
    assert values(f"<si:list>{real(1, MM)}{real(2, MM)}</si:list>")[1].value == 2
    interval = "<si:standardUnc>0.1</si:standardUnc><si:intervalMin>1</si:intervalMin>"
    assert values(real(1, MM, f"<si:coverageInterval>{interval}</si:coverageInterval>"))[0].u == Decimal("0.1")


def test_names_of_others_cannot_break_the_file_or_the_terminal():
    evil = 'a "b"\\ \x7f\u2028 = 1 # ' + "x" * 1000
    made = draft(sphere_with(diameter(name=f"Diameter {evil}"), item=text(en=f"Ball {evil}")))
    ball = entries(made, "spheres")
    assert ball["name"].startswith('Ball a "b"\\')
    assert len(ball["name"]) <= 200
    assert ball["diameter_mm"] == 25.0004
    assert completed(made).spheres[0].diameter_mm == 25.0004


def test_labels_of_others_cannot_add_lines_to_the_file():
    gauge = f"<si:real><si:label>a&#10;[[seats]]&#x9b;</si:label>{real('10.5', MM).removeprefix('<si:real>')}"
    made = draft(sphere_with(quantity(text(en="Length"), gauge)))
    assert '  # { name = "a [[seats]]", length_mm = 10.5, u_mm = nan },  # not in the certificate: U' in made.text
    assert tomllib.loads(made.text).keys() == {"bars"}


def test_whatever_element_is_missing_or_empty_the_reader_refuses_or_reads():
    """Never any other exception."""
    root, refused = ET.fromstring(BALL_BAR), 0
    for parent in list(root.iter())[::2]:
        for child in list(parent):
            at, words = list(parent).index(child), child.text
            parent.remove(child)
            for _ in range(2):
                try:
                    draft_artefact(calibration_certificate(root))
                except InputError:
                    refused += 1
                if child not in parent:
                    parent.insert(at, child)
                    child.text = None
            child.text = words
    assert refused > 10
    assert calibration_certificate(root) == read(BALL_BAR)


@pytest.mark.parametrize(
    ("unit", "read_as"),
    [
        (UM, (-6, {"metre": 1})),
        (r"\metre", (0, {"metre": 1})),
        (r"\per\kelvin", (0, {"kelvin": -1})),
        (r"\micro\metre\metre\tothe{-1}\kelvin\tothe{-1}", (-6, {"kelvin": -1})),
        (r"\milli\metre\tothe{2}", (-6, {"metre": 2})),
        (r"\percent", (-2, {})),
    ],
)
def test_units_of_the_d_si(unit, read_as):
    found = parse_unit(unit)
    assert (found.exponent, dict(found.dimensions)) == read_as


@pytest.mark.parametrize("unit", ["mm", "", r"\inch", r"\metre x", r"\tothe{2}", r"\metre\tothe{999999}", FAR])
def test_other_units_are_not_read_for_one(unit):
    assert parse_unit(unit) is None
