"""What a laboratory claims: entries that nobody read, standards, artefacts, arms, traceability."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np

import truearm as ta
from benchmarks.certificates import mistake, right
from benchmarks.certificates.campaign import (
    ASME,
    DAY,
    ISO,
    RANGE_MM,
    Edits,
    PointsChange,
    campaign,
    file,
    in_all,
    in_test,
)
from benchmarks.certificates.copies import both
from benchmarks.rows import scratch
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.artefacts import example_artefacts
from truearm.wings.laboratory.standards.coordinate_origin import VIRTUAL_ARM, CoordinateOrigin
from truearm.wings.laboratory.standards.layout import Placement, lay_out_tests
from truearm.wings.laboratory.standards.measured_points import read_points
from truearm.wings.laboratory.standards.points_form import fill_points_form, write_points_form

# Entries that nobody read --------------------------------------------------------------------------------------------

UNREAD = (
    "",
    "recalled",
    "from memory, clause 5",
    "TODO",
    "clause 0",
    "clause 5 (to do: check)",
    "probably clause 6.1",
    "??? 5.1",
    "ISO 10360-12:2016",
    "yes",
    "Kreon's page on the standard",
    "as usual",
    "clause xxx",
    "the standard, look up 6.2",
    "not yet checked, 6.2",
)
for _source in UNREAD:
    mistake(f"an entry confirmed by the source {_source!r}", said="confirmed = true, but its source")(
        lambda source=_source: campaign(plan=[(r'(repeats = {[^}]*source = )"[^"]*"', rf'\1"{source}"')]).stated()
    )
for _what, _edit in {
    "an entry of a test": (r"(probing\].*?points = {[^}]*confirmed = )true", r"\1false"),
    "the decision rule": (r"(decision_rule = {[^}]*confirmed = )true", r"\1false"),
    "the guard band": (r"(guard_band = {[^}]*confirmed = )true", r"\1false"),
    "a formula of the uncertainty": (r"(coverage = {[^}]*confirmed = )true", r"\1false"),
    "a formula of a test value": (r"(location = {[^}]*confirmed = )true", r"\1false"),
    "a share that older plans lack": (r"gap_ratio = {[^}]*}\n", ""),
}.items():
    mistake(f"a certificate by a plan of which nobody confirmed {_what}", said="not confirmed against")(
        lambda edit=_edit: campaign(plan=[edit]).stated()
    )
for _what, (_edit, _said) in {
    "by nobody": (('confirmed_by = "Second Example"', 'confirmed_by = ""'), "confirmed_by"),
    "by an initial": (('confirmed_by = "Second Example"', 'confirmed_by = "X"'), "who confirmed the numbers"),
    "without a word of who and when": (
        (r"\[confirmation\][^\[]*?date = 2026-01-15", ""),
        "does not state who confirmed",
    ),
    "with another formula": (("max - min distance from", "twice the spread about"), "probing.form"),
    "with the guard band of another rule": (
        ("1.645 u, probability of 95 %", "U on both sides of the limit"),
        "another guard band",
    ),
    "with two points in a ball": ((r"(probing\].*?points = { value = )25", r"\g<1>4"), "5 points or more"),
    "with a share of 66": (("value = 0.66", "value = 66"), "share of 1 or less"),
    "with half a repeat": ((r"repeats = { value = 3", "repeats = { value = 2.5"), "repeats"),
    "with an entry that truearm does not know": ((r"\[uni\]", "[uni]\nworst = 1"), "worst"),
}.items():
    mistake(f"a plan confirmed {_what}", said=_said)(lambda edit=_edit: campaign(plan=[edit]).stated())


@mistake("a decision by another rule than the plan's", said="is not that of the test plan")
def another_rule() -> str:
    return campaign().stated(rule="simple")


for _source in ("clause 6.2.3", "ISO 10360-12:2016, 6.2", "agreement no. 2026/10", "§ 10", "page 100", "Annex B"):
    right(f"an entry confirmed by the source {_source!r}", unsaid="confirmed = true, but|not confirmed")(
        lambda source=_source: campaign(plan=[(r'(repeats = {[^}]*source = )"[^"]*"', rf'\1"{source}"')]).stated()
    )

# Standards that were not followed ------------------------------------------------------------------------------------

TITLES = {
    "ISO 10360-2, in the title": ('title = "[^"]*"', 'title = "Coordinate measuring machine, ISO 10360-2:2009"'),
    "ISO 10360-8, in the title": ('title = "[^"]*"', 'title = "Laser line scanner after ISO 10360-8:2013"'),
    "VDI/VDE 2617-9, in the title": ('title = "[^"]*"', 'title = "Acceptance according to VDI/VDE 2617-9"'),
    "conformity, in the title": ('title = "[^"]*"', 'title = "Articulated arm, passed"'),
    "another standard as its own": ('standard = "[^"]*"', 'standard = "ISO 10360-2:2009"'),
    "a scanner's standard as its own": ('standard = "[^"]*"', 'standard = "ISO 10360-8:2013"'),
    "a standard with another year": ('standard = "[^"]*"', 'standard = "ISO 10360-12:2025"'),
}
for _what, _edit in TITLES.items():
    mistake(f"a plan that names {_what}", said="title: expected|own plan: .*no standard")(
        lambda edit=_edit: campaign(plan=[edit]).stated()
    )
for _what, _text in {
    "conform": "Example Arms A: conform",
    "passed": "Example Arms A, PASSED",
    "certified": "certified arm 7",
    "the standard as met": "arm that meets ISO 10360-12",
}.items():
    mistake(f"limits named {_what!r}, which stands in the decision", said="name: expected")(
        lambda text=_text: campaign(limits=[('name = "Example Arms A"', f'name = "{text}"')]).stated()
    )
right("limits named with the standard that the data sheet follows", unsaid="expected")(
    lambda: campaign(limits=[('name = "Example Arms A"', 'name = "Example Arms A, data to ISO 10360-12"')]).stated()
)
right("a plan with a title in the laboratory's words", unsaid="expected|own plan")(
    lambda: campaign(plan=[('title = "[^"]*"', 'title = "Measuring arm with ball of ruby, procedure PA-12"')]).stated()
)

# Traceability --------------------------------------------------------------------------------------------------------

UNTRACED = {
    "without the accreditation of its issuer": r"issuer_accreditation = [^\n]*\n",
    "of an issuer that is none": (r'issuer_accreditation = "[^"]*"', 'issuer_accreditation = "n/a"'),
    "with a certificate that has no number": (r'certificate = "K-10\d"', 'certificate = "in-house"'),
    "issued by nobody": (r'issued_by = "[^"]*"', 'issued_by = "nobody"'),
    "issued by a laboratory that is unknown": (r'issued_by = "[^"]*"', 'issued_by = "unknown"'),
}
for _name, _kind, _standard in (("ball", "spheres", ISO), ("bar", "bars", ISO), ("seat", "seats", ASME)):
    for _what, _edit in UNTRACED.items():
        _before, _after = (_edit, "") if isinstance(_edit, str) else _edit
        mistake(f"a {_name} {_what}, and traceability stated", said=f"It is not shown of {_name}")(
            lambda standard=_standard, kind=_kind, before=_before, after=_after: campaign(
                standard, artefacts=[(rf"(\[\[{kind}\]\]\n(?:(?!\[\[).)*?){before}", rf"\g<1>{after}")]
            ).stated()
        )
    mistake(f"a {_name} without the laboratory that calibrated it", said="names the laboratory that calibrated")(
        lambda standard=_standard, kind=_kind: campaign(
            standard, artefacts=[(rf'(\[\[{kind}\]\]\n(?:(?!\[\[).)*?)issued_by = "[^"]*"\n', r"\1")]
        ).stated()
    )


@mistake(
    "artefacts that nobody accredited, and traceability stated", said="No metrological traceability to the SI units"
)
def none_accredited() -> str:
    return campaign(artefacts=[(r"issuer_accreditation = [^\n]*\n", "")]).stated()


@right("artefacts of a national institute under the CIPM MRA", unsaid="not shown")
def national_institute() -> str:
    return campaign(artefacts=[(r'issuer_accreditation = "[^"]*"', 'issuer_accreditation = "CIPM MRA"')]).stated()


# Other arms and artefacts than stated --------------------------------------------------------------------------------


def arm(number: str, origin: CoordinateOrigin | None = None) -> PointsChange:
    return lambda given: replace(given, serial_number=number, origin=origin or given.origin)


@mistake("points of another arm than the certificate is of", said="the points are of '10018'")
def another_arm() -> str:
    return campaign(points=arm("10018")).stated()


@mistake("points of a virtual arm", said="simulated|no arm was measured")
def virtual_arm() -> str:
    return campaign(points=arm("10017", CoordinateOrigin(VIRTUAL_ARM))).stated()


@mistake("points under the serial number of a virtual arm", said="virtual arm: no arm was measured")
def virtual_number() -> str:
    return campaign(points=arm("virtual-7"), about=[("10017", "virtual-7")]).stated()


@mistake("points as found of another arm than as left", said="the points are of '10018'")
def found_of_another_arm() -> str:
    return both(campaign(ASME), campaign(ASME, seed=2, points=arm("10018")))


@mistake("results as found without any work on the arm", said="no adjustment or repair is stated")
def found_without_work() -> str:
    return campaign(ASME).stated(as_found=campaign(ASME, seed=2).verified())


for _what, _edits in {
    "limits": {"limits": [("B_um = 60", "B_um = 600")]},
    "plan": {"plan": [(r"(single_point\].*?spread_share = { value = )0.3", r"\g<1>0.2")]},
    "arm's limits, those of another model": {"limits": [('name = "Example Arms A"', 'name = "Example Arms B"')]},
}.items():
    mistake(f"results as found by another {_what} than as left", said="the results as found were tested by another")(
        lambda edits=_edits: both(campaign(ASME), campaign(ASME, seed=2, **edits))  # type: ignore[arg-type]
    )


@mistake("coordinates of a model in place of the arm's software", said="with the model calibrated.truearm, SHA-256")
def with_a_model() -> str:
    return campaign(
        points=arm("10017", CoordinateOrigin("truearm 0.1.0", "calibrated.truearm", "a" * 64, 3, 500))
    ).stated()


def serial(number: str, test: str) -> PointsChange:
    return in_test(test, lambda one, _: replace(one, serial_number=number))


for _test, _standard in {"probing": ISO, "uni": ISO, "single_point": ASME}.items():
    mistake(f"an artefact of {_test} with another serial number than in its file", said="has the serial number")(
        lambda test=_test, standard=_standard: campaign(standard, points=serial("Z-9", test)).stated()
    )


@mistake("the bar's serial number that is engraved on the ball", said="that of 'ball'")
def number_of_the_ball() -> str:
    return campaign(points=serial("S-1", "uni")).stated()


@mistake("artefacts whose serial numbers nobody stated", said="serial number not stated|was not compared")
def no_serial_numbers() -> str:
    return str(
        campaign(
            artefacts=[(r'serial_number = "[^"]*"\n', "")], points=in_all(lambda one: replace(one, serial_number=""))
        ).verified()
    )


@mistake("two artefacts at one position of a test", said="points on 'bar' and on|has no sphere|points on")
def two_artefacts() -> str:
    def change(one, _):  # type: ignore[no-untyped-def]
        return replace(one, artefact="ball 2") if one.keys["group"] == "C" else one

    second = [
        (
            r"\[\[bars\]\]",
            (
                '[[spheres]]\nname = "ball 2"\ncertificate = "K-9"\nissued_by = "E"\ndate = 2026-01-01\n'
                "expires = 2028-01-01\nform_mm = 0.001\nu_fixture_mm = 0.001\ndiameter_mm = 25.0\n"
                "u_diameter_mm = 0.0002\n"
                "expansion_per_K = 0\nu_expansion_per_K = 0\nu_temperature_K = 0\n[[bars]]"
            ),
        )
    ]
    return campaign(
        artefacts=second, points=in_test("articulation", lambda one, of: replace(change(one, of), serial_number=""))
    ).stated()


@mistake("an artefact that is in no file", said="has no sphere 'ball 9'")
def unknown_artefact() -> str:
    return campaign(points=in_test("probing", lambda one, _: replace(one, artefact="ball 9"))).stated()


@mistake("a length that the certificate of the bar does not have", said="has no length")
def unknown_length() -> str:
    return campaign(
        points=in_test("uni", lambda one, _: replace(one, keys={**one.keys, "length": one.keys["length"] + "a"}))
    ).stated()


TWO_BARS: Edits = [
    (
        r"lengths = \[.*?\n\]",
        (
            'lengths = [\n{ name = "900", length_mm = 900.0, u_mm = 0.001 },\n'
            '{ name = "1700", length_mm = 1700.0, u_mm = 0.001 },\n]'
        ),
    ),
    (
        r"\[\[seats\]\]",
        (
            '[[bars]]\nname = "bar 2"\nserial_number = "B-2"\ncertificate = "K-104"\n'
            'issued_by = "Example Calibration"\nissuer_accreditation = "X-K-00001-01-00"\ndate = 2026-01-01\n'
            "expires = 2028-01-01\nform_mm = 0.0005\nexpansion_per_K = 1e-6\nu_expansion_per_K = 0.3e-6\n"
            "u_temperature_K = 0.5\nu_fixture_mm = 0.0025\nlengths = [\n"
            '{ name = "900", length_mm = 900.4, u_mm = 0.001 },\n'
            '{ name = "1700", length_mm = 1700.4, u_mm = 0.001 },\n]\n'
            "[[seats]]"
        ),
    ),
]


@mistake("a bar of 0.4 mm more measured in place of the one that the points name", said="exchanged bars explain them")
def other_bar() -> str:
    def longer(one, of):  # type: ignore[no-untyped-def]
        length, position, end = one.keys.values()
        ends = [of[length, position, each].points[0] for each in "AB"]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        return replace(one, points=one.points + (end == "B") * 0.4 * along, serial_number="")

    return campaign(ASME, artefacts=TWO_BARS, points=in_test("volumetric", longer)).stated()


def csv(*rows: str, columns: str = "serial_number") -> str:
    head = f"test,artefact,date,position,x_mm,y_mm,z_mm,{columns}"
    return str(read_points(file("\n".join([head, *rows]) + "\n", "csv")))


ROW = "single_point,seat,2026-01-20,1,0,0,"
MIXED = {
    "points of two arms in one file": ("serial_number", ("10017", "10018"), "points of one arm"),
    "points of two seats in one group": ("artefact_serial_number", ("C-1", "C-2"), "a group on one artefact"),
    "points of the arm's software and of a virtual arm": (
        "coordinates_from",
        ("arm software", "virtual arm"),
        "origin|coordinates",
    ),
    "points of which some do not say where they come from": (
        "coordinates_from",
        ("arm software", ""),
        "origin|coordinates",
    ),
}
for _what, (_columns, _cells, _said) in MIXED.items():
    mistake(_what, said=_said)(
        lambda columns=_columns, cells=_cells: csv(
            *(f"{ROW}{i / 1000},{cell}" for i, cell in enumerate(cells)), columns=columns
        )
    )


# Forms that are filled in --------------------------------------------------------------------------------------------


def filled(standard: str, exchanged: tuple[tuple[str, str], tuple[str, str]] | None, by_mm: float) -> str:
    """A form filled in with artefacts so far from their places, two of them exchanged, in another frame."""
    layout = lay_out_tests(ta.load_verification_plan(standard), example_artefacts(RANGE_MM), RANGE_MM)
    rng = np.random.default_rng(4)
    by = {(one.test, one.keys.get("position")): by_mm * rng.normal(size=3) for one in layout}
    each: list[FloatArray] = [one.points + by[one.test, one.keys.get("position")] for one in layout]
    if exchanged is not None:
        first, second = ([i for i, one in enumerate(layout) if _is_at(one, *place)] for place in exchanged)
        for i, j in zip(first, second, strict=True):
            each[i], each[j] = each[j], each[i]
    path = Path(file("", "csv"))
    path.unlink()
    write_points_form(layout, path, tip_diameter_mm=0.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return str(fill_points_form(path, np.concatenate(each) @ turn, day=DAY, artefact_degC=20.0))


def _is_at(one: Placement, test: str, position: str) -> bool:
    return one.test == test and one.keys["position"] == position


for _what, _standard, _exchanged in (
    ("two seats", ASME, (("single_point", "1"), ("single_point", "3"))),
    ("two bars of one length", ASME, (("volumetric", "2"), ("volumetric", "6"))),
    ("the ball at its two positions", ISO, (("probing", "1"), ("probing", "2"))),
    ("two positions of the bar", ISO, (("uni", "1"), ("uni", "3"))),
):
    mistake(f"a form filled in with {_what} exchanged", said="exchanged with|in another order|do not fit|as planned")(
        lambda standard=_standard, exchanged=_exchanged: filled(standard, exchanged, 20.0)
    )


@mistake("a form filled in with one reading too few", said="reading")
def too_few() -> str:
    layout = lay_out_tests(ta.load_verification_plan(ASME), example_artefacts(RANGE_MM), RANGE_MM)
    path = scratch() / "too-few.csv"
    path.unlink(missing_ok=True)
    write_points_form(layout, path, tip_diameter_mm=0.0)
    points = np.concatenate([one.points for one in layout])[1:]
    return str(fill_points_form(path, points, day=DAY, artefact_degC=20.0))


@mistake("a form filled in on a day in the future", said="in the future")
def filled_tomorrow() -> str:
    layout = lay_out_tests(ta.load_verification_plan(ASME), example_artefacts(RANGE_MM), RANGE_MM)
    path = scratch() / "tomorrow.csv"
    path.unlink(missing_ok=True)
    write_points_form(layout, path, tip_diameter_mm=0.0)
    points = np.concatenate([one.points for one in layout])
    day = datetime.date.today() + datetime.timedelta(days=30)
    return str(fill_points_form(path, points, day=day, artefact_degC=20.0))


@right("a form filled in with artefacts a hand beside their places", unsaid="exchanged")
def hand_beside() -> str:
    return filled(ASME, None, 40.0) + filled(ISO, None, 40.0)


@right("a form filled in where artefacts stand half a metre elsewhere", unsaid="exchanged")
def elsewhere() -> str:
    return filled(ASME, None, 300.0)


# What only the laboratory knows --------------------------------------------------------------------------------------

ABOUT = {
    "that nobody signs": ("main_signer = true", "main_signer = false", "no person signs"),
    "that replaces itself": (
        r"\Z",
        'replaces = { number = "V-1", change = "amended", reason = "typing" }\n',
        "replaces itself",
    ),
    "at another place, without its address": (
        'place = "laboratory"',
        'place = "customerBranch"',
        "address of the place",
    ),
    "in the laboratory, at another address": (
        r"\Z",
        'site = { name = "Works", post_code = "1", city = "X", country = "DE" }\n',
        "an address of the place beside",
    ),
    "of an arm without a serial number": ('serial_number = "10017"', 'serial_number = " "', "empty"),
    "of a laboratory in no country": (
        r'(laboratory = .*?country = ")DE"(.*?customer)',
        r'\1Germany"\2',
        "two capital letters",
    ),
    "with a number of no characters": ('number = "V-1"', 'number = ""', "empty"),
    "without the software of the arm": (r', software = "Example Measure 4.2"', "", "software"),
    "with a key that claims more": (r"\Z", "accredited = true\n", "accredited"),
}
for _what, (_before, _after, _said) in ABOUT.items():
    mistake(f"a certificate {_what}", said=_said)(lambda edit=(_before, _after): campaign(about=[edit]).stated())
for _what, _edit in {
    "amends another one": (r"\Z", 'replaces = { number = "V-0", change = "amended", reason = "typing error" }\n'),
    "of a measurement at the customer's": ('place = "laboratory"', 'place = "customer"'),
    "at another address": (
        'place = "laboratory"',
        'place = "other"\nsite = { name = "Works", post_code = "1", city = "X", country = "DE" }',
    ),
    "with the laboratory's own notes": (r"\Z", 'notes = { deviations = "none", agreed_interval = "12 months" }\n'),
    "of an adjusted arm without results as found": (
        r"\Z",
        'adjustment = { kind = "repair", work = "cable renewed" }\n',
    ),
}.items():
    right(
        f"a certificate that {_what}" if _what.startswith("amends") else f"a certificate {_what}",
        unsaid="refused|expected",
    )(lambda edit=_edit: campaign(about=[edit]).xml())
right("a certificate of an arm that does not conform", unsaid="refused|expected")(
    lambda: campaign(limits=[("E_Uni = { B_um = 60 }", "E_Uni = { B_um = 5 }")]).xml()
)
right("a certificate of a value in the guard band", unsaid="refused|expected")(
    lambda: campaign(limits=[("E_Uni = { B_um = 60 }", "E_Uni = { B_um = 20 }")]).xml()
)
right("a certificate by simple acceptance, as the plan says", unsaid="refused|expected")(
    lambda: campaign(
        plan=[
            ('"iso14253-1:2017"', '"simple"'),
            ('"1.645 u, probability of 95 %"', '"none where U is at most limit / 4, else U"'),
        ]
    ).xml()
)
right("a certificate by the edition of 2013, as the plan says", unsaid="refused|expected")(
    lambda: campaign(
        plan=[
            ('"iso14253-1:2017"', '"iso14253-1:2013"'),
            ('"1.645 u, probability of 95 %"', '"U on both sides of the limit"'),
        ]
    ).xml()
)
