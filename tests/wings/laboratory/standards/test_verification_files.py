"""Plans, artefacts and specifications: what they must hold, and that a wrong one is refused with its key."""

import datetime
import math
import re
import statistics

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.files.toml_documents import parse_toml
from truearm.wings.laboratory.standards.artefacts import Artefacts, Seat, read_artefacts
from truearm.wings.laboratory.standards.asme_b89_4_22 import SeatPoints, single_point, volumetric
from truearm.wings.laboratory.standards.measurands import LengthMeasurement
from truearm.wings.laboratory.standards.specification import (
    SYMBOLS,
    Specification,
    example_specification,
    read_specification,
)
from truearm.wings.laboratory.standards.verification_plan import (
    PLANS,
    TESTS,
    VerificationPlan,
    is_confirmed,
    load_verification_plan,
    plan_text,
)

# Plans ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANS)
def test_every_entry_of_a_plan_of_truearm_is_recalled_and_says_so(name):
    plan, text = load_verification_plan(name), plan_text(name)
    assert "check against your copy of the standard" in text
    assert set(plan.tests) <= set(TESTS)
    entries = list(plan.entries())
    assert len(entries) == text.count("confirmed = false,") == text.count("source = ") - 1  # one in the comment
    assert not any(is_confirmed(one) for one in entries)
    assert all(one.fault == "its source still says recalled" for one in entries)
    assert {one.key for one in entries if "." not in one.key} == {"decision_rule", "guard_band"}
    assert {one.name for one in entries if one.test == "uncertainty"} == {"contributions", "form", "coverage"}


def looked_up(text, clause="clause 6.2.3"):
    """A plan's text as after a person has looked every entry up."""
    return re.sub(r'confirmed = false, source = "[^"]*"', f'confirmed = true, source = "{clause}"', text)


def test_a_plan_of_ones_own(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        plan_text("asme-b89.4.22").replace(
            'value = 10, confirmed = false, source = "recalled" }\npositions',
            'value = 12, confirmed = true, source = "clause 5.4" }\npositions',
        )
    )
    plan = load_verification_plan(str(path))
    assert plan.single_point is not None
    assert plan.single_point.points.value == 12
    assert "single_point.points" not in [one.key for one in plan.unconfirmed()]


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("recalled", "its source still says recalled"),
        ("as Recalled by a colleague, clause 5", "its source still says recalled"),
        ("", "its source is empty"),
        (" ", "its source is empty"),
        ("the standard", "its source names no clause"),
        ("ISO 10360-12:2016", "its source names no clause"),
        ("ASME B89.4.22-2004", "its source names no clause"),
        ("DIN EN ISO 10360-12", "its source names no clause"),
        ("our copy of ISO/TS 23165, edition 2006", "its source names no clause"),
        ("agreed with the customer", "its source names no clause"),
        ("10 years of experience", "its source names no clause"),
        ("my colleague (room 3)", "its source names no clause"),
        ("from memory, clause 5", "its source still says memory"),
        ("TODO", "its source still says todo"),
        ("clause 6.2, TBC", "its source still says tbc"),
        ("clause 5.3?", "its source still says ?"),
        ("clause 5, not yet checked", "its source still says not yet checked"),
        ("clause 0", "its source names no clause"),
        ("ISO 10360-12:2016, 0.0", "its source names no clause"),
        ("clause 5.0.1, page 10", None),
        ("0.3", None),
        ("§ 5", None),
        ("agreement no. 2026/3", None),
        ("clause 6.2.3", None),
        ("ISO 10360-12:2016, 6.2.3", None),
        ("ISO 14253-1:2017, Annex B", None),
        ("ASME B89.4.22-2004, table 2", None),
        ("agreed with the customer, order 4711", None),
    ],
)
def test_a_confirmed_entry_says_where_it_was_read(tmp_path, source, fault):
    """Nobody opens the gate by writing true: the clause stands in the plan, and is printed with the results."""
    path = tmp_path / "mine.toml"
    path.write_text(
        plan_text("asme-b89.4.22").replace(
            'divisor n - 1", confirmed = false, source = "recalled"',
            f'divisor n - 1", confirmed = true, source = "{source}"',
            1,
        )
    )
    if fault is None:
        assert "single_point.twice_s" not in [one.key for one in load_verification_plan(path).unconfirmed()]
        return
    refused = refuses(None, load_verification_plan, path)
    assert refused.problem == f"single_point.twice_s: confirmed = true, but {fault}"
    assert 'type where it stands in ASME B89.4.22-2004, such as source = "clause 6.2.3"' in refused.hint


def test_a_plan_of_an_earlier_version_is_read_with_what_it_lacks_not_confirmed(tmp_path):
    lines = looked_up(plan_text("iso10360-12")).splitlines()
    new = (
        "decision_rule =",
        "guard_band =",
        "[uncertainty]",
        "contributions",
        "form =",
        "coverage",
        "size =",
        "error =",
        "pattern =",
        "directions =",
        "shortest_most_share =",
        "gap_ratio =",
    )
    old = [one for one in lines if not one.startswith((*new, "location ="))]
    title = next(i for i, one in enumerate(old) if one.startswith("standard ="))
    old.insert(title + 1, 'decision_rule = "iso14253-1:2013"')
    points = next(i for i, one in enumerate(old) if one.startswith("points = { value = 25"))
    old[points] = 'points = { value = 25, confirmed = true, source = "Kreon\'s page on ISO 10360-12" }'
    (tmp_path / "old.toml").write_text("\n".join(old))
    plan = load_verification_plan(tmp_path / "old.toml")
    assert (plan.decision_rule.value, plan.guard_band.value) == ("iso14253-1:2013", "U on both sides of the limit")
    formulas = {one.key for one in plan.entries() if isinstance(one.value, str)}
    added = ("directions", "shortest_most_share", "gap_ratio")
    numbers = {"probing.points", *(f"{test}.{key}" for test in ("uni", "bi") for key in added)}
    assert {one.key for one in plan.unconfirmed()} == {*formulas, *numbers}
    assert not plan.is_own
    assert "probing.points" in plan.confirmation_gap({"probing"})


def test_every_formula_is_one_that_truearm_calculates():
    """The names of a plan are no free text: what a row contains is what its name says, calculated another way."""
    rng = np.random.default_rng(3)
    seat = Seat(name="cone", certificate="K", date="2026-01-15", expires="2027-01-15", form_mm=0.001, u_fixture_mm=0)
    points = rng.normal(size=(7, 3))
    distance = [math.dist(one, points.mean(axis=0)) for one in points]
    lengths = [1000 + d for d in rng.normal(scale=0.05, size=6)]
    bar = parse_toml(BAR.encode(), Artefacts).bars[0]
    measured = [
        LengthMeasurement(bar, bar.lengths[0], np.zeros((1, 3)), np.array([[one, 0.0, 0.0]]), position=str(i))
        for i, one in enumerate(lengths)
    ]
    d = [one - 1000.001 for one in lengths]
    limits = example_specification(2500)
    rows = {
        row.label: row.value for row in single_point([SeatPoints(seat, points)], limits) + volumetric(measured, limits)
    }
    by_name = {
        "largest distance from the mean": (rows["SPAT.Max"], max(distance)),
        "2 s, divisor n - 1": (rows["SPAT.2s"], 2 * math.sqrt(sum(x * x for x in distance) / 6)),
        "largest |measured - calibrated length|": (abs(rows["Volumetric.Max"]), max(map(abs, d))),
        "2 s about the mean, divisor n - 1": (rows["Volumetric.2s"], 2 * statistics.stdev(d)),
        "2 RMS, divisor n": (rows["Volumetric.2RMS"], 2 * math.sqrt(sum(x * x for x in d) / 6)),
    }
    for name, (value, expected) in by_name.items():
        assert value == pytest.approx(expected, rel=1e-9), name
    plan = load_verification_plan("asme-b89.4.22")
    named = {one.value for one in plan.entries(["single_point", "volumetric"]) if isinstance(one.value, str)}
    assert (
        set(by_name)
        == {
            one.value
            for name in ("single_point", "volumetric")
            for one in plan.entries([name])
            if one.test == name and isinstance(one.value, str)
        }
        <= named
    )


@pytest.mark.parametrize(
    ("before", "after", "phrase"),
    [
        ("value = 25,", "value = 0,", "probing.points.value: expected 1 or more, got 0"),
        ("value = 25,", "value = 4,", "5 points or more on a sphere"),
        ("value = 25,", 'value = "25",', "probing.points.value: expected a whole number, got '25'. Try: remove"),
        ("value = 25, confirmed = false, ", "value = 25, ", "the key probing.points.confirmed is missing"),
        ("\npoints =", "\npoint =", "unknown key probing.point. Try: use one of required, clause, points"),
        ("[uni]", "[unidirectional]", "unknown key unidirectional. Try: use one of name"),
        ("value = 0.66,", "value = 66,", "uni.longest_share.value: expected a share of 1 or less, got 66. Try:"),
        ("points = {", "points = 25 #", "probing.points: expected a table of value, confirmed, source, got 25"),
        ("value = 51,", "value = 5,", "smallest_sphere_mm is larger than largest_sphere_mm"),
        ("[probing]", "[probing", "not valid TOML"),
        ('name = "iso10360-12"', "", "the key name is missing"),
        (
            '"diameter of the smallest sphere around the centres"',
            '"largest distance of two centres"',
            "articulation.location.value: expected 'diameter of the smallest sphere around the centres', got 'largest",
        ),
        (
            'decision_rule = { value = "iso14253-1:2017"',
            'decision_rule = { value = "iso14253-1:1998"',
            "decision_rule.value: expected 'iso14253-1:2017', 'iso14253-1:2013' or 'simple', got",
        ),
        (
            'decision_rule = { value = "iso14253-1:2017"',
            'decision_rule = { value = "simple"',
            "the rule 'simple' has another guard band than '1.645 u",
        ),
    ],
)
def test_a_wrong_plan_is_refused(tmp_path, before, after, phrase):
    path = tmp_path / "plan.toml"
    text = plan_text("iso10360-12")
    assert before in text
    path.write_text(text.replace(before, after, 1))
    refused = refuses(None, load_verification_plan, path)
    assert phrase in str(refused)
    assert str(refused).startswith(str(path))


def test_a_plan_other_than_the_standards_is_ones_own(tmp_path):
    """Whoever confirms it: results by a plan that asks for less are not named after the standard."""
    gate = "[confirmation]\nconfirmed_by = 'First Example'\ndate = 2026-11-02\n\n[uncertainty]"
    text = looked_up(plan_text("iso10360-12")).replace("[uncertainty]", gate)
    less = text.replace("longest_share = { value = 0.66", "longest_share = { value = 0.36", 1)
    for name, changed, heading, differences in (
        ("same", text, ", after ISO 10360-12:2016", []),
        ("less", less, ", own plan", [("uni", "longest_share = 0.36 (0.66)")]),
        ("other", text.replace('standard = "ISO 10360-12:2016"', 'standard = "our own"'), ", own plan", []),
        ("none", text.partition("[uni]")[0], ", own plan", [("uni", "not in this plan")]),
        (
            "optional",
            text.replace("required = true", "required = false", 1),
            ", own plan",
            [("probing", "not required here")],
        ),
        ("without bi", text.partition("[bi]")[0], ", after ISO 10360-12:2016", []),
    ):
        (tmp_path / "plan.toml").write_text(changed)
        plan = load_verification_plan(tmp_path / "plan.toml")
        assert plan.heading == f"Articulated arm with tactile probe{heading}", name
        assert list(plan.differences()) == differences, name
        assert plan.confirmation_gap({"probing"}) is None
    assert "not that of the test plan" in plan.confirmation_gap({"probing"}, "simple")
    (tmp_path / "plan.toml").write_text(plan_text("iso10360-12").replace("value = 0.66", "value = 0.36", 1))
    unconfirmed = load_verification_plan(tmp_path / "plan.toml").heading
    assert unconfirmed == "Articulated arm with tactile probe (own plan, not confirmed against ISO 10360-12:2016)"


def test_a_plan_that_is_not_there():
    refuses(r"no plan 'iso10360-2'.*iso10360-12, asme-b89.4.22, or a file", load_verification_plan, "iso10360-2")
    refuses("does not exist", load_verification_plan, "mine.toml")
    refuses("expected a test, got none", parse_toml, b'name = "a"\ntitle = "b"\nstandard = "c"\n', VerificationPlan)


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
    assert phrase in str(refuses(None, read_artefacts, path))


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
        refuses(phrase, look_up)


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
    refuses(r"limits.E_Bi: this test has no length, and its limit depends on one", spec.limit, "E_Bi")


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
        ("E_Uni = { B_um = 25000 }", "limits.E_Uni: expected B_um in micrometres, got 25000, too large for any arm"),
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
    assert phrase in str(refuses(None, read_specification, path))


def test_a_measuring_range_in_metres_is_refused(tmp_path):
    path = tmp_path / "mpe.toml"
    path.write_text(MPE.replace("2500", "2.5") + "E_Uni = { B_um = 30 }\n")
    refuses(r"measuring_range_mm: expected the measuring range in mm, got 2\.5", read_specification, path)


def test_hostile_files_are_refused(tmp_path):
    for name, content, phrase in (
        ("deep.toml", b"a = " + b"[" * 3000 + b"]" * 3000, "nested too deeply"),
        ("long.toml", b"#" * 2_000_000, "larger than 1 MB"),
        ("latin.toml", "name = 'Prüfkörper'".encode("latin-1"), "expected UTF-8"),
        ("number.toml", b"a = " + b"9" * 5000, "not valid TOML"),
    ):
        (tmp_path / name).write_bytes(content)
        refuses(phrase, read_specification, tmp_path / name)
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
        ("humidity_percent = { max = 0.6 }", "humidity_percent is 0.6 % or less: no measurement is, from 2 to 100 %"),
        ("air_degC = { min = 291 }", "air_degC is 291 degC or more: no measurement is"),
    ],
)
def test_wrong_rated_conditions_are_refused(tmp_path, rated, phrase):
    path = tmp_path / "mpe.toml"
    about = 'name = "arm"\nsource = "sheet"\nmeasuring_range_mm = 2500\n'
    path.write_text(f"{about}[rated_conditions]\n{rated}\n[limits]\nE_Uni = {{ B_um = 30 }}\n")
    assert refuses(phrase, read_specification, path).file == path
