"""Plans, artefacts and specifications: what they must hold, and that a wrong one is refused with its key."""

from __future__ import annotations

import datetime

import pytest

from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.verification.standards.artefacts import Artefacts, read_artefacts
from truearm.verification.standards.specification import SYMBOLS, Specification, read_specification
from truearm.verification.standards.verification_plan import (
    PLANS,
    TESTS,
    VerificationPlan,
    load_verification_plan,
    plan_text,
)

# Plans ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANS)
def test_every_recalled_number_of_a_plan_is_marked(name):
    plan, text = load_verification_plan(name), plan_text(name)
    assert "check against your copy of the standard" in text
    assert set(plan.tests) <= set(TESTS)
    marked = list(plan.unconfirmed())
    assert len(marked) == text.count("confirmed = false,")
    assert all(source for _, _, source in marked)
    # What is taken for confirmed says by whom.
    for line in text.splitlines():
        if "confirmed = true," in line:
            assert "recalled" not in line
            assert "page" in line


def test_a_plan_of_ones_own(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(plan_text("asme-b89.4.22").replace("value = 10, confirmed = false", "value = 12, confirmed = true"))
    plan = load_verification_plan(str(path))
    assert plan.single_point is not None
    assert plan.single_point.points.value == 12
    assert "single_point.points" not in [key for key, _, _ in plan.unconfirmed()]


@pytest.mark.parametrize(
    ("before", "after", "phrase"),
    [
        ("value = 25,", "value = 0,", "probing.points.value: expected 1 or more, got 0"),
        ("value = 25,", "value = 4,", "5 points or more on a sphere"),
        ("value = 25,", 'value = "25",', "probing.points.value: expected a whole number, got '25'. Try: remove"),
        ("value = 25, confirmed = true, ", "value = 25, ", "the key probing.points.confirmed is missing"),
        ("\npoints =", "\npoint =", "unknown key probing.point. Try: use one of required, clause, points"),
        ("[uni]", "[unidirectional]", "unknown key unidirectional. Try: use one of name"),
        ("value = 0.66,", "value = 66,", "uni.longest_share.value: expected a share of 1 or less, got 66. Try:"),
        ("points = {", "points = 25 #", "probing.points: expected a table of confirmed, source, value, got 25"),
        ("value = 51,", "value = 5,", "smallest_sphere_mm is larger than largest_sphere_mm"),
        ("[probing]", "[probing", "not valid TOML"),
        ('name = "iso10360-12"', "", "the key name is missing"),
    ],
)
def test_a_wrong_plan_is_refused(tmp_path, before, after, phrase):
    path = tmp_path / "plan.toml"
    path.write_text(plan_text("iso10360-12").replace(before, after, 1))
    with pytest.raises(InputError) as refused:
        load_verification_plan(path)
    assert phrase in str(refused.value)
    assert str(refused.value).startswith(str(path))


def test_numbers_other_than_the_programs_own_are_told(tmp_path):
    """Whoever confirms them: a plan after a standard that asks for less is not told by its title."""
    text = plan_text("iso10360-12")
    assert not list(load_verification_plan("iso10360-12").changed_numbers())
    (tmp_path / "same.toml").write_text(text.replace("confirmed = false", "confirmed = true"))
    assert not list(load_verification_plan(tmp_path / "same.toml").changed_numbers())
    less = text.replace(
        "longest_share = { value = 0.66, confirmed = false", "longest_share = { value = 0.36, confirmed = true", 1
    )
    (tmp_path / "less.toml").write_text(less)
    assert list(load_verification_plan(tmp_path / "less.toml").changed_numbers()) == [("uni.longest_share", 0.36, 0.66)]
    (tmp_path / "other.toml").write_text(less.replace('standard = "ISO 10360-12:2016"', 'standard = "our own"'))
    assert not list(load_verification_plan(tmp_path / "other.toml").changed_numbers())


def test_a_plan_that_is_not_there():
    with pytest.raises(InputError, match=r"no plan 'iso10360-2'.*iso10360-12, asme-b89.4.22, or a file"):
        load_verification_plan("iso10360-2")
    with pytest.raises(InputError, match="does not exist"):
        load_verification_plan("mine.toml")
    with pytest.raises(InputError, match="expected a test, got none"):
        parse_toml(b'name = "a"\ntitle = "b"\nstandard = "c"\n', VerificationPlan)


# Artefacts -----------------------------------------------------------------------------------------------------------

BALL = """\
[[spheres]]
name = "ball"
certificate = "K-1"
date = 2026-01-15
expires = 2027-01-15
diameter_mm = 25.0004
u_diameter_mm = 0.0002
form_mm = 0.0003
expansion_per_K = 5.5e-6
u_expansion_per_K = 0.5e-6
u_temperature_K = 0.3
u_fixture_mm = 0.0005
"""
LENGTH = '[[bars.lengths]]\nname = "1000"\nlength_mm = 1000.001\nu_mm = 0.001\n'
BAR = BALL.replace("spheres", "bars").replace("diameter_mm = 25.0004\nu_diameter_mm = 0.0002\n", "") + LENGTH


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("", "got none"),
        (BALL + BALL, "the artefact 'ball' is given twice"),
        (BALL + BAR, "the artefact 'ball' is given twice"),
        (BAR + LENGTH, "the length of 'ball' '1000' is given twice"),
        (BALL.replace("2027", "2025"), "which is not after its calibration"),
        (BALL.replace("date = 2026-01-15\n", ""), "the key spheres[1].date is missing"),
        (
            BALL.replace("2026-01-15", '"spring"'),
            "spheres[1].date: expected a date as 2026-01-15, without a time and without quotes, got 'spring'",
        ),
        (BALL.replace("25.0004", "-25"), "spheres[1].diameter_mm: expected more than 0, got -25"),
        (BALL.replace("25.0004", "inf"), "spheres[1].diameter_mm: expected a finite number, got inf"),
        (BALL + "nominal_mm = 1\n", "calibrated 25.0004 mm, nominal 1 mm"),
        (BALL.replace("0.0002", "0.3"), "u_diameter_mm = 0.3 mm is more than a hundredth"),
        (BALL.replace("0.0003", "0.3"), "form_mm: expected millimetres, 0.2 at most"),
        (BAR.replace("u_mm = 0.001", "u_mm = 0.4"), "u_mm = 0.4 mm is more than a hundredth of the calibrated 1000"),
        (BALL.replace("5.5e-6", "5.5"), "spheres[1].expansion_per_K: expected 0.001 or less, got 5.5"),
        (BALL.replace("0.5e-6", "0.5"), "u_expansion_per_K = 0.5 is larger than any expansion"),
        (BALL.replace("u_fixture_mm", "fixture_mm"), "unknown key spheres[1].fixture_mm. Try: use one of name"),
        (
            BALL.replace("u_diameter_mm", "U_diameter_mm"),
            "unknown key U_diameter_mm. Try: write u_diameter_mm, the standard uncertainty (k = 1): half of",
        ),
        (BAR.replace("u_mm", "U_mm"), "bars[1].lengths[1]: unknown key U_mm. Try: write u_mm, the standard"),
        (BALL.replace("2026-01-15", "15.01.2026"), "line 4: not valid TOML: Expected newline"),
        (BAR.replace("u_mm = 0.001", "u_mm = 20"), "ball, 1000: u_mm = 20 mm"),
        (BAR.partition("[[bars.lengths]]")[0], "the key bars[1].lengths is missing"),
    ],
)
def test_wrong_or_inconsistent_certificates_are_refused(tmp_path, text, phrase):
    path = tmp_path / "artefacts.toml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_artefacts(path)
    assert phrase in str(refused.value)


def test_an_artefact_is_looked_up_by_kind_and_needs_a_valid_certificate():
    artefacts = parse_toml((BALL + BAR.replace('"ball"', '"bar"')).encode(), Artefacts)
    artefacts.sphere("ball").check_valid(datetime.date(2026, 1, 15))
    artefacts.sphere("ball").check_valid(datetime.date(2027, 1, 15))
    with pytest.raises(InputError, match=r"'K-1' of 'ball' expired on 2027-01-15; points were measured on 2027-01-16"):
        artefacts.sphere("ball").check_valid(datetime.date(2027, 1, 16))
    with pytest.raises(InputError, match="was calibrated on 2026-01-15, after points were measured"):
        artefacts.sphere("ball").check_valid(datetime.date(2026, 1, 14))
    assert artefacts.bar("bar").length("1000").length_mm == 1000.001
    for look_up, phrase in (
        (lambda: artefacts.sphere("bar"), "no sphere 'bar'. Try: use one of 'ball'"),
        (lambda: artefacts.seat("cone"), r"no seat 'cone'. Try: add it under \[\[seats\]\]"),
        (lambda: artefacts.bar("bar").length("500"), "no length '500'. Try: use one of '1000'"),
    ):
        with pytest.raises(InputError, match=phrase):
            look_up()


# Specifications ------------------------------------------------------------------------------------------------------

MPE = 'name = "arm"\nsource = "data sheet"\nmeasuring_range_mm = 2500\n[limits]\n'


def test_the_three_forms_of_a_limit():
    spec = parse_toml(
        (
            MPE
            + '"E_Uni:0:Tact.AArm" = { A_um = 8, K_mm_per_um = 40, B_um = 30 }\n'
            + "E_Bi = { A_um = 8, K_mm_per_um = 40 }\n"
            + '"L_Dia.5x5:Art:Tact.AArm" = { B_um = 40 }\n'
        ).encode(),
        Specification,
    )
    assert spec.limit("E_Uni", 400.0) == pytest.approx(0.018)
    assert spec.limit("E_Uni", 2000.0) == pytest.approx(0.030)
    assert spec.limit("E_Bi", 2000.0) == pytest.approx(0.058)
    assert spec.limit("L_Dia.5x5") == pytest.approx(0.040)
    assert spec.limit("P_Size.Sph.1x25") is None
    with pytest.raises(InputError, match=r"limits.E_Bi: this test has no length, and its limit depends on one"):
        spec.limit("E_Bi")


@pytest.mark.parametrize(
    ("limits", "phrase"),
    [
        ("E_Unidir = { B_um = 30 }", "unknown symbol 'E_Unidir'. Try: use E_Uni"),
        ("colour = { B_um = 30 }", f"unknown symbol 'colour'. Try: use {', '.join(SYMBOLS)}"),
        ('E_Uni = { B_um = 30 }\n"E_Uni:0" = { B_um = 30 }', "the limit of E_Uni is given twice"),
        ("E_Uni = { A_um = 30 }", "A_um and K_mm_per_um belong together"),
        ("E_Uni = {}", "got none"),
        ("SPAT.Max = { B_um = 30 }\nSPAT.2s = { B_um = 40 }", 'SPAT.Max has no quotes. Try: write "SPAT.Max" = { .. }'),
        ("P_Size.Sph.1x25 = { B_um = 30 }", "limits: P_Size.Sph.1x25 has no quotes"),
        ("E_Uni = { B_um = 0.03 }", "limits.E_Uni: expected B_um in micrometres, got 0.03"),
        ("E_Uni = { A_um = 5, K_mm_per_um = 0.0125 }", "for a micrometre, got 0.0125. Try: write 80 for L/80"),
        ("E_Uni = { B_um = 0 }", "limits.E_Uni.B_um: expected more than 0, got 0"),
        ("E_Uni = { B_mm = 0.03 }", "unknown key limits.E_Uni.B_mm. Try: use one of A_um, K_mm_per_um, B_um"),
        ("E_Uni = 0.03", "limits.E_Uni: expected a table of A_um, K_mm_per_um, B_um, got 0.03"),
    ],
)
def test_wrong_specifications_are_refused(tmp_path, limits, phrase):
    path = tmp_path / "mpe.toml"
    path.write_text(MPE + limits + "\n")
    with pytest.raises(InputError) as refused:
        read_specification(path)
    assert phrase in str(refused.value)


def test_a_measuring_range_in_metres_is_refused(tmp_path):
    path = tmp_path / "mpe.toml"
    path.write_text(MPE.replace("2500", "2.5") + "E_Uni = { B_um = 30 }\n")
    with pytest.raises(InputError, match=r"measuring_range_mm: expected the measuring range in mm, got 2\.5"):
        read_specification(path)


def test_hostile_files_are_refused(tmp_path):
    for name, content, phrase in (
        ("deep.toml", b"a = " + b"[" * 3000 + b"]" * 3000, "nested too deeply"),
        ("long.toml", b"#" * 2_000_000, "larger than 1 MB"),
        ("latin.toml", "name = 'Prüfkörper'".encode("latin-1"), "expected UTF-8"),
        ("number.toml", b"a = " + b"9" * 5000, "not valid TOML"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=phrase):
            read_specification(tmp_path / name)
    (tmp_path / "bom.toml").write_bytes(b"\xef\xbb\xbf" + (MPE + "E_Uni = { B_um = 30 }").encode())
    assert read_specification(tmp_path / "bom.toml").name == "arm"


@pytest.mark.parametrize(
    ("rated", "phrase"),
    [
        ("air = { min = 18 }", "unknown condition 'air'"),
        ("air_degC = { }", "expected min, max or both"),
        ("air_degC = { min = 22, max = 18 }", "min = 22 is larger than max = 18"),
        ('air_degC = { min = "18" }', "air_degC"),
        ("air_degC = 20", "air_degC"),
    ],
)
def test_wrong_rated_conditions_are_refused(tmp_path, rated, phrase):
    path = tmp_path / "mpe.toml"
    about = 'name = "arm"\nsource = "sheet"\nmeasuring_range_mm = 2500\n'
    path.write_text(f"{about}[rated_conditions]\n{rated}\n[limits]\nE_Uni = {{ B_um = 30 }}\n")
    with pytest.raises(InputError, match=phrase) as raised:
        read_specification(path)
    assert raised.value.file == path
