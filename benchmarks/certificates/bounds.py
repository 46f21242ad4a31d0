"""Numbers that no arm, artefact or room has: another unit, a sign, a share for per cent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.certificates import mistake, right
from benchmarks.certificates.campaign import ASME, ISO, Edits, PointsChange, campaign, file, in_all
from truearm.wings.laboratory.standards.measured_points import read_points

# Of the ball, the bar and the seat: what is typed, in place of what, and what is said.
ARTEFACTS = {
    "a ball in inches": (ISO, "diameter_mm = 25.0", "diameter_mm = 0.984", "more than a hundredth|asks for a sphere"),
    "a ball in micrometres": (ISO, "diameter_mm = 25.0", "diameter_mm = 25000", "asks for a sphere"),
    "the radius of a ball for its diameter": (ISO, "diameter_mm = 25.0", "diameter_mm = 12.5", "measured 24"),
    "another ball, a millimetre larger, than the nominal one": (
        ISO,
        "diameter_mm = 25.0\n",
        "diameter_mm = 25.0\nnominal_mm = 30\n",
        "too different for one artefact",
    ),
    "a ball of no size": (ISO, "diameter_mm = 25.0", "diameter_mm = 0", "expected more than 0"),
    "the uncertainty of a ball in micrometres": (ISO, "u_diameter_mm = 0.0002", "u_diameter_mm = 0.3", "hundredth"),
    "no uncertainty of a ball": (ISO, "u_diameter_mm = 0.0002", "u_diameter_mm = 0", "expected more than 0"),
    "the expanded uncertainty of a ball for the standard one": (
        ISO,
        "u_diameter_mm = 0.0002",
        "U_diameter_mm = 0.0004",
        "write u_diameter_mm",
    ),
    "the form of a ball in micrometres": (ISO, "form_mm = 0.0003", "form_mm = 0.3", "at most|hundredth"),
    "a form below zero": (ISO, "form_mm = 0.0003", "form_mm = -0.0003", "0 or more|greater than or equal|negative"),
    "the fixture in micrometres": (ISO, "u_fixture_mm = 0.0005", "u_fixture_mm = 0.5", "at most"),
    "an expansion in micrometres per metre and kelvin": (
        ISO,
        "expansion_per_K = 5.5e-6",
        "expansion_per_K = 5.5",
        "0.001|less than",
    ),
    "the uncertainty of an expansion in the same": (
        ISO,
        "u_expansion_per_K = 0.5e-6",
        "u_expansion_per_K = 0.5",
        "larger than any expansion",
    ),
    "a length in metres": (ISO, "length_mm = 900,", "length_mm = 0.9,", "hundredth|measured"),
    "the uncertainty of a length in micrometres": (
        ISO,
        "length_mm = 900, u_mm = 0.001",
        "length_mm = 900, u_mm = 1",
        "hundredth",
    ),
    "no uncertainty of a length": (
        ISO,
        "length_mm = 900, u_mm = 0.001",
        "length_mm = 900, u_mm = 0",
        "expected more than 0",
    ),
    "a calibrated length that is another nominal one": (
        ISO,
        "length_mm = 900,",
        "length_mm = 900, nominal_mm = 1000,",
        "too different for one artefact",
    ),
    "a length below zero": (ISO, "length_mm = 900,", "length_mm = -900,", "expected more than 0"),
    "the alignment of faces in micrometres": (ISO, "u_alignment_mm = 0.5", "u_alignment_mm = 500", "20"),
    "the form of a seat in micrometres": (
        ASME,
        "form_mm = 0.001\nu_fixture_mm = 0.001",
        "form_mm = 1\nu_fixture_mm = 0.001",
        "at most",
    ),
    "a fixture of a seat without uncertainty, and no form": (
        ASME,
        "form_mm = 0.001\nu_fixture_mm = 0.001",
        "form_mm = 0\nu_fixture_mm = 0",
        "its expanded uncertainty is 0",
    ),
    "degrees of freedom of zero": (
        ISO,
        "u_diameter_mm = 0.0002",
        "u_diameter_mm = 0.0002\ncalibration_dof = 0",
        "expected more than 0",
    ),
    "a form that is not a number": (ISO, "form_mm = 0.0003", "form_mm = nan", "finite|number"),
    "two balls of one name": (
        ISO,
        r"\[\[bars\]\]",
        (
            '[[seats]]\nname = "ball"\ncertificate = "K-9"\ndate = 2026-01-01\n'
            "expires = 2028-01-01\nform_mm = 0.001\nu_fixture_mm = 0.001\n[[bars]]"
        ),
        "is given twice",
    ),
    "a length of one name twice": (ISO, '"450", length_mm = 450', '"900", length_mm = 450', "is given twice"),
}
for _what, (_standard, _before, _after, _said) in ARTEFACTS.items():
    mistake(f"of an artefact, {_what}", said=_said)(
        lambda standard=_standard, edit=(_before, _after): campaign(standard, artefacts=[edit]).stated()
    )
LIMITS = {
    "a limit in nanometres": ("E_Uni = { B_um = 60 }", "E_Uni = { B_um = 25000 }", "too large for any arm"),
    "a limit in millimetres": ("E_Uni = { B_um = 60 }", "E_Uni = { B_um = 0.06 }", "too small for any arm"),
    "a limit that grows by the reciprocal of what is meant": (
        "E_Uni = { B_um = 60 }",
        "E_Uni = { A_um = 20, K_mm_per_um = 0.025 }",
        "millimetres of length for a micrometre",
    ),
    "a constant part in nanometres": (
        "E_Uni = { B_um = 60 }",
        "E_Uni = { A_um = 20000, K_mm_per_um = 50 }",
        "too large",
    ),
    "half of a limit": ("E_Uni = { B_um = 60 }", "E_Uni = { A_um = 20 }", "belong together"),
    "a limit below zero": ("E_Uni = { B_um = 60 }", "E_Uni = { B_um = -60 }", "expected more than 0"),
    "one limit twice, the wider one last": (
        r"E_Uni = { B_um = 60 }",
        'E_Uni = { B_um = 60 }\n"E_Uni:0:Tact.AArm" = { B_um = 600 }',
        "given twice",
    ),
    "the limit of a test of another standard": (
        r"E_Uni = { B_um = 60 }",
        'E_Uni = { B_um = 60 }\n"E0,MPE" = { B_um = 600 }',
        "unknown symbol",
    ),
    "no limit of what was tested": (
        r"\[limits\].*",
        "[limits]\nEffectiveDiameter = { B_um = 25 }\n",
        "states no limit for",
    ),
    "no limit of the lengths": (r"E_Uni = { B_um = 60 }\nE_Bi = { B_um = 70 }\n", "", "no limit for: E_Uni, E_Bi"),
    "a measuring range in metres": ("measuring_range_mm = 2500", "measuring_range_mm = 2.5", "in mm, got 2.5"),
    "a measuring range below zero": ("measuring_range_mm = 2500", "measuring_range_mm = -2500", "expected more than 0"),
    "rated conditions in kelvin": ("min = 15, max = 25", "min = 288, max = 298", "no measurement is"),
    "rated conditions with their ends exchanged": ("min = 15, max = 25", "min = 25, max = 15", "is larger than"),
    "rated conditions that were not met": ("min = 15, max = 25", "min = 21, max = 25", "not met.*conformity none"),
    "rated conditions that nobody stated": (
        r"air_degC = {[^}]*}",
        "warm_up_min = { min = 30 }",
        "not stated for all points.*conformity none",
    ),
    "a rated condition of another name": (r"air_degC = {", "temperature = {", "unknown condition"),
    "lengths that the limits do not want corrected": (
        r"measuring_range_mm = 2500\n",
        "measuring_range_mm = 2500\ncorrected_to_20_degC = false\n",
        "not corrected to 20",
    ),
}
for _what, (_before, _after, _said) in LIMITS.items():
    mistake(f"of the limits, {_what}", said=_said)(lambda edit=(_before, _after): campaign(limits=[edit]).stated())
ROOM = {
    "a room in degrees Fahrenheit": (
        r"temperature_degC = \[19.5, 20.5\]",
        "temperature_degC = [67.1, 68.9]",
        "the room was at",
    ),
    "a room in kelvin": (r"temperature_degC = \[19.5, 20.5\]", "temperature_degC = [292.6, 293.7]", "from -50 to 100"),
    "a room that was coldest where it was warmest": (r"\[19.5, 20.5\]", "[20.5, 19.5]", "the lowest and the highest"),
    "a humidity as a share": (r"\[40.0, 55.0\]", "[0.40, 0.55]", "drier than any room"),
    "a humidity above all": (r"\[40.0, 55.0\]", "[40.0, 550.0]", "from 0 to 100"),
    "a cold hall stated for artefacts that were warm": (r"\[19.5, 20.5\]", "[10.0, 16.0]", "the room was at"),
}
for _what, (_before, _after, _said) in ROOM.items():
    mistake(f"of the room, {_what}", said=_said)(lambda edit=(_before, _after): campaign(about=[edit]).stated())


def points_file(column: str, value: str, test: str = "single_point", key: str = "position") -> str:
    rows = [f"{test},cone,2026-01-20,1,0,0,{i / 1000},{value}" for i in range(10)]
    return str(read_points(file("\n".join([f"test,artefact,date,{key},x_mm,y_mm,z_mm,{column}", *rows]) + "\n", "csv")))


COLUMNS = {
    "a stylus tip of 0.01 mm": ("tip_diameter_mm", "0.01", "got 0.01"),
    "a stylus tip in micrometres": ("tip_diameter_mm", "6000", "got 6000"),
    "a stylus tip below zero": ("tip_diameter_mm", "-6", "got -6"),
    "a humidity of points as a share": ("humidity_percent", "0.40", "from 2 to 100, got 0.4"),
    "air in degrees Fahrenheit": ("air_degC", "68", "expected air_degC"),
    "a change of the air in kelvin per second, below zero": ("air_K_per_h", "-1", "expected air_K_per_h"),
    "a warm-up before the arm was switched on": ("warm_up_min", "-30", "expected warm_up_min"),
    "an artefact in kelvin": ("artefact_degC", "293.15", "in degC, got 293.15"),
    "a model without the digest of its file": ("coordinates_from", "truearm 0.1.0", "not named|model"),
}
for _what, (_column, _value, _said) in COLUMNS.items():
    mistake(f"of the points, {_what}", said=_said)(lambda column=_column, value=_value: points_file(column, value))


def scaled(factor: float) -> PointsChange:
    return in_all(lambda one: replace(one, points=one.points * factor))


for _unit, _factor in {"metres": 1e-3, "inches": 1 / 25.4, "centimetres": 0.1}.items():
    mistake(f"points in {_unit}", said=f"they seem to be in {_unit}|more uncertain")(
        lambda factor=_factor: campaign(points=scaled(factor)).stated()
    )


@mistake("points with the radius of the tip, and no tip stated", said="tip_diameter_mm")
def tip_not_stated() -> str:
    def change(given):  # type: ignore[no-untyped-def]
        larger = [
            replace(one, points=one.points.mean(axis=0) + (one.points - one.points.mean(axis=0)) * 15.5 / 12.5)
            for one in given.tests["probing"]
        ]
        return replace(given, tests={**given.tests, "probing": tuple(larger)})

    return campaign(points=change).stated()


def warmed(degC: float) -> PointsChange:
    return in_all(lambda one: replace(one, degC=degC))


WARM_ROOM: Edits = [(r"\[19.5, 20.5\]", "[27.5, 28.5]")]
NOT_RATED: Edits = [(r"\[rated_conditions\]\nair_degC = {[^}]*}", "")]
for _key, _value in {"u_temperature_K": "0.5", "u_expansion_per_K": r"0\.\de-6"}.items():
    mistake(f"{_key} = 0 at 28 degC", said=f"{_key} = 0")(
        lambda key=_key, value=_value: campaign(
            artefacts=[(rf"{key} = {value}", f"{key} = 0")], points=warmed(28.0), about=WARM_ROOM, limits=NOT_RATED
        ).stated()
    )


@mistake("a bar of which one end was warmer by 3 K", said="the length has no definite temperature")
def one_end_warm() -> str:
    def change(given):  # type: ignore[no-untyped-def]
        groups = [replace(one, degC=20.0 + 3.0 * (one.keys["end"] == "B")) for one in given.tests["uni"]]
        return replace(given, tests={**given.tests, "uni": tuple(groups)})

    return campaign(points=change).stated()


@mistake("a warm day of points in a room that is stated as 20 degC", said="the room was at")
def warm_points() -> str:
    return campaign(points=warmed(24.5)).stated()


# What is right -------------------------------------------------------------------------------------------------------


@right("a room at 28 degC with a real thermometer, limits rated for none", unsaid="u_temperature_K|the room was")
def warm_room() -> str:
    expanded = in_all(lambda one: one)
    return campaign(points=lambda given: warmed(28.0)(expanded(given)), about=WARM_ROOM, limits=NOT_RATED).stated()


@right("a cold workshop of 17 degC within the rated conditions", unsaid="not met|the room was|refused")
def cold_workshop() -> str:
    return campaign(points=warmed(17.0), about=[(r"\[19.5, 20.5\]", "[16.2, 17.8]")]).stated()


@right("a thermometer of no uncertainty at 20.5 degC", unsaid="u_temperature_K = 0")
def near_twenty() -> str:
    return campaign(artefacts=[("u_temperature_K = 0.5", "u_temperature_K = 0")], points=warmed(20.5)).stated()


@right("artefacts a kelvin warmer than the room, which the laboratory states", unsaid="the room was")
def slightly_warm() -> str:
    return campaign(points=warmed(20.9)).stated()


@right("a limit of a printed arm, 5 mm", unsaid="too large")
def printed_arm() -> str:
    return campaign(limits=[("E_Uni = { B_um = 60 }", "E_Uni = { B_um = 5000 }")]).stated()


@right("a limit that grows with the length, and is bounded", unsaid="expected")
def growing_limit() -> str:
    return campaign(limits=[("E_Uni = { B_um = 60 }", "E_Uni = { A_um = 30, K_mm_per_um = 50, B_um = 60 }")]).stated()


@right("a limit by its whole symbol, with the index of the standard", unsaid="unknown")
def whole_symbol() -> str:
    return campaign(limits=[("E_Uni =", '"E_Uni:0:Tact.AArm" =')]).stated()


@right("a bar of steel, with its expansion", unsaid="expected|refused")
def steel_bar() -> str:
    return campaign(artefacts=[("expansion_per_K = 1e-6", "expansion_per_K = 11.5e-6")]).stated()


@right("a stylus tip of 38.1 mm, and one of 0.5 mm", unsaid="expected")
def large_and_small_tips() -> str:
    return points_file("tip_diameter_mm", "38.1") + points_file("tip_diameter_mm", "0.5")


@right("a dry winter day of 5 % relative humidity", unsaid="expected|drier")
def dry_day() -> str:
    return points_file("humidity_percent", "5") + campaign(about=[(r"\[40.0, 55.0\]", "[5.0, 9.0]")]).stated()


@right("balls of 10 and of 50.8 mm", unsaid="asks for")
def other_balls() -> bool:
    made = [
        campaign(artefacts=[("diameter_mm = 25.0", f"diameter_mm = {mm}")], laid_out=True).certified().certificate
        for mm in (10.0, 50.8)
    ]
    return bool(np.all([one.conformity == "pass" for one in made]))


@right("a room of which nobody measured the humidity", unsaid="humidity")
def no_humidity() -> str:
    return campaign(about=[(r", relative_humidity_percent = \[40.0, 55.0\]", "")]).stated()
