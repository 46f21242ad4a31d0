"""``truearm verify``: from a technician's files to the verdict; wrong files are refused with what to do."""

import contextlib
import html
import json
import math
import re
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from made_up_certificate import CONFIRMED_PLAN, confirm
from made_up_verification import ARTEFACTS, MPE, Made

from page_transcripts import blocks
from truearm.wings.laboratory.standards.measured_points import (
    KEY_COLUMNS,
    OPTIONAL_COLUMNS,
    REQUIRED_COLUMNS,
    SIZE_TESTS,
)
from truearm.wings.laboratory.standards.positions import about_z, hemisphere
from truearm.wings.laboratory.standards.verification_plan import plan_text

pytestmark = pytest.mark.usefixtures("undrawn")

PAGE = Path(__file__).parents[3] / "docs" / "verification.md"


def write_bench():
    """All files of a good arm's verification."""
    Path("points.csv").write_text(Made().iso().text(), encoding="utf-8")
    Path("artefacts.toml").write_text(ARTEFACTS, encoding="utf-8")
    Path("mpe.toml").write_text(MPE, encoding="utf-8")
    Path("plan.toml").write_text(CONFIRMED_PLAN, encoding="utf-8")
    Path("asme.toml").write_text(confirm(plan_text("asme-b89.4.22")), encoding="utf-8")


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A folder with these files."""
    monkeypatch.chdir(tmp_path)
    write_bench()
    return tmp_path


def options(plan="plan.toml"):
    files = "--measured points.csv --artefacts artefacts.toml --mpe mpe.toml".split()  # noqa: SIM905
    return ["verify", "--test-plan", plan, *files]


# Verdicts ------------------------------------------------------------------------------------------------------------


def test_a_good_arm_conforms(truearm, bench):
    ran = truearm(*options()).done()
    rows = {line.split("  ")[0]: line for line in ran.out.splitlines()}
    for label, limit in (("P_Size.Sph.1x25", "0.0150"), ("P_Form.Sph.1x25", "0.0300"), ("L_Dia.5x5", "0.0400")):
        assert limit in rows[label]
        assert " conform " in rows[label]
    for length, limit in (("150", "0.0169"), ("900", "0.0263"), ("1700", "0.0363")):
        assert limit in rows[f"E_Uni, {length}"]
    assert "the test bi of the plan was not carried out: the points have none of it" in ran.out
    assert ran.out.splitlines()[0].startswith("conform:")
    assert "after ISO 10360-12:2016: measuring arm 2.5 m" in ran.out.splitlines()[1]
    # Where each number and formula stands, by the word of who looked it up.
    assert (
        "where it stands, uni: lengths = 5, positions = 7, directions = 4, repeats = 3, "
        "longest_share = 0.66, shortest_most_share = 0.2, gap_ratio = 2, tolerated_sets = 0, " in ran.out
    )
    assert "where it stands, decision: decision_rule: iso14253-1:2017, guard_band: 1.645 u, " in ran.out
    entries = json.loads(truearm(*options(), "--json").out)["plan_entries"]
    assert {"key": "uni.lengths", "value": 5, "source": "clause 6.2", "confirmed": True} in entries
    assert ran.out.splitlines()[-1].startswith("Next: truearm certificate")


@pytest.mark.parametrize("too_large", [0.0, 60e-6])
def test_without_confirmed_numbers_there_is_one_word_everywhere(truearm, bench, too_large):
    """Terminal, JSON, page and exit code: nothing green, no conform, and what a certificate would say."""
    Path("points.csv").write_text(Made(too_large=too_large).iso().text(), encoding="utf-8")
    ran = truearm(*options("iso10360-12"), "--page", "page.html")
    assert (ran.code, ran.err) == (3, "")
    first = "Not for conformity decisions: 28 entries are not confirmed against ISO 10360-12:2016 in the test plan"
    assert ran.out.startswith(first)
    probing = "plan, probing: not confirmed, check against your copy of the standard: points = 25, pattern: evenly over"
    assert probing in ran.out
    assert "plan, decision: not confirmed, check against your copy of the standard: decision_rule: iso1" in ran.out
    assert ran.out.splitlines()[-2].startswith("Next: compare the plan with your copy")
    found = json.loads(truearm(*options("iso10360-12"), "--json").out)
    assert found["verdict"] == "not for conformity decisions"
    sides = {"within limit", "outside limit"} if too_large else {"within limit"}
    assert {row["verdict"] for row in found["rows"]} - {None} == sides
    page = Path("page.html").read_text(encoding="utf-8")
    assert first in html.unescape(page)
    assert not re.search(r'class="[^"]*\bgood\b', page)
    for text in (ran.out, page):
        assert not re.search(r">conform<| conform  |Conform:|: conform|All tested values conform", text)


def test_an_arm_that_measures_too_large_does_not_conform(truearm, bench):
    """60 um per metre: 102 um in the longest length; the sphere and the places are fine."""
    Path("points.csv").write_text(Made(too_large=60e-6).iso().text(), encoding="utf-8")
    ran = truearm(*options(), "--json")
    found = json.loads(ran.out)
    assert (ran.code, found["verdict"]) == (1, "not conform")
    by_label = {row["label"]: row for row in found["rows"]}
    assert by_label["E_Uni, 1700"]["value"] == pytest.approx(60e-6 * 1700, abs=0.01)
    assert by_label["E_Uni, 1700"]["verdict"] == "not conform"
    assert by_label["P_Size.Sph.1x25"]["verdict"] == "conform"


def test_an_arm_near_its_limit_is_undecided_and_simple_acceptance_decides(truearm, bench):
    """Half a micrometre below the limit of a form of some 15, with U of one: 4:1 is kept."""
    Path("points.csv").write_text(Made(noise_mm=0.004).iso().text(), encoding="utf-8")
    value = json.loads(truearm(*options(), "--json").out)["rows"][1]["value"]
    Path("mpe.toml").write_text(
        MPE.replace('"P_Form.Sph.1x25" = { B_um = 30 }', f'"P_Form.Sph.1x25" = {{ B_um = {1e3 * value + 0.5:.3f} }}'),
        encoding="utf-8",
    )
    ran = truearm(*options())
    assert ran.code == 3
    assert "undecided: a value is within its uncertainty of a limit" in ran.out
    ran = truearm(*options(), "--rule", "simple")
    assert ran.code == 3  # agreed with nobody
    assert "decisions: the decision rule 'simple' is not that of the test plan 'iso10360-12', 'iso14253-1" in ran.out
    Path("simple.toml").write_text(confirm(plan_text("iso10360-12"), "simple"), encoding="utf-8")
    assert "simple acceptance" in truearm(*options("simple.toml")).done().out


def test_the_plan_names_the_decision_rule_and_an_option_another_one(truearm, bench):
    """A form 0.95 U below its limit: 2013 asks for U, 2017 for 1.645 u = 0.82 U."""
    before = json.loads(truearm(*options(), "--json").out)
    value, expanded = (before["rows"][1][key] for key in ("value", "uncertainty"))
    limit = 1e3 * (value + 0.95 * expanded)
    Path("mpe.toml").write_text(
        MPE.replace('"P_Form.Sph.1x25" = { B_um = 30', f'"P_Form.Sph.1x25" = {{ B_um = {limit}'), encoding="utf-8"
    )
    assert "default rule of ISO 14253-1:2017. Values" in truearm(*options()).done().out
    found = json.loads(truearm(*options(), "--rule", "iso14253-1:2013", "--json").out)
    assert (found["rule"], found["verdict"]) == ("iso14253-1:2013", "not for conformity decisions")
    assert found["rows"][1]["verdict"] == "undecided"
    Path("old.toml").write_text(confirm(plan_text("iso10360-12"), "iso14253-1:2013"), encoding="utf-8")
    found = json.loads(truearm(*options("old.toml"), "--json").out)
    assert (found["rule"], found["verdict"]) == ("iso14253-1:2013", "undecided")
    assert found["rows"][1]["conformance_probability"] == pytest.approx(0.971, abs=0.001)  # Phi(1.9), tables


def test_outside_the_rated_conditions_nothing_is_decided(truearm, bench):
    """Points at 26.1 degC, rated 15 to 25: neither the good arm conforms nor the one that measures too large fails."""
    for too_large in (0.0, 1e-3):
        Path("points.csv").write_text(Made(degC=26.1, too_large=too_large).iso().text(), encoding="utf-8")
        ran = truearm(*options())
        assert ran.code == 3
        unmet = "rated conditions not met: temperature of the artefacts 26.1 degC, rated 15 to 25 degC"
        assert ran.out.splitlines()[0] == f"undecided: {unmet}"
    page = truearm(*options(), "--page", "page.html", "--json")
    found = json.loads(page.out)
    assert {row["verdict"] for row in found["rows"]} <= {"undecided", None}
    (condition,) = found["rated_conditions"]
    assert condition["measured"] == pytest.approx([26.1, 26.1])
    assert (condition["rated"], condition["met"]) == ([15, 25], False)
    assert unmet in Path("page.html").read_text(encoding="utf-8")


def test_conditions_are_stated_with_the_points(truearm, refused, bench):
    """Warmed up 10 minutes in the probing test: its values are undecided, the others not; humidity is not stated."""
    rated = "air_degC = { min = 15, max = 25 }\nwarm_up_min = { min = 30 }\nhumidity_percent = { max = 70 }"
    Path("mpe.toml").write_text(MPE.replace("air_degC = { min = 15, max = 25 }", rated), encoding="utf-8")
    head, *rows = Path("points.csv").read_text(encoding="utf-8").splitlines()
    warmed = [row + (",10" if row.startswith("probing") else ",45") for row in rows]
    Path("points.csv").write_text("\n".join([f"{head},warm_up_min", *warmed]) + "\n", encoding="utf-8")
    ran = truearm(*options())
    assert (ran.code, ran.err) == (3, "")
    assert ran.out.startswith("undecided: rated conditions not met: warm-up time 10 to 45 min, rated 30 min or more\n")
    assert (
        "it is not stated whether rated conditions were met: relative humidity (rated 70 % or less), fill in the column"
        in ran.out
    )
    by_test = {row["label"]: row["verdict"] for row in json.loads(truearm(*options(), "--json").out)["rows"]}
    assert (by_test["P_Size.Sph.1x25"], by_test["E_Uni, 900"]) == ("undecided", "conform")
    Path("mpe.toml").write_text(
        MPE.replace("[rated_conditions]\nair_degC = { min = 15, max = 25 }", ""), encoding="utf-8"
    )
    assert "the specification states no rated conditions" in truearm(*options()).out
    Path("points.csv").write_text(
        "\n".join([f"{head},humidity_percent", *(row + ",170" for row in rows)]) + "\n", encoding="utf-8"
    )
    refused(options(), "expected humidity_percent from 2 to 100, got 170")


def test_simple_acceptance_hides_no_value_far_beyond_its_limit(truearm, bench):
    """A fixture of 6 um: U of 12 um is more than a quarter of 30 um; a form of 100 um is beyond that by far."""
    Path("points.csv").write_text(Made(noise_mm=0.03).iso().text(), encoding="utf-8")
    Path("artefacts.toml").write_text(
        ARTEFACTS.replace("u_fixture_mm = 0.0005", "u_fixture_mm = 0.006"), encoding="utf-8"
    )
    Path("simple.toml").write_text(confirm(plan_text("iso10360-12"), "simple"), encoding="utf-8")
    ran = truearm(*options("simple.toml"), "--json")
    found = json.loads(ran.out)
    form = found["rows"][1]
    assert abs(form["value"]) - form["uncertainty"] > form["limit"]
    assert (ran.code, found["verdict"], form["verdict"]) == (1, "not conform", "not conform")
    (said,) = [one for one in found["remarks"] if "simple acceptance: " in one and one.startswith("U ")]
    assert said.startswith(
        "U is more than 1/4 of the limit, so that ISO 14253-1:2013 applies in place of simple acceptance: "
    )
    assert "P_Form.Sph.1x25" in said


def test_a_specification_is_not_kept_by_what_was_not_tested(truearm, bench):
    """Probing alone, as a plan of one's own may ask: the verdict speaks of what was tested, the rest is named."""
    whole = CONFIRMED_PLAN
    Path("own.toml").write_text(whole[: whole.index("[articulation]")], encoding="utf-8")
    points = Path("points.csv").read_text(encoding="utf-8")
    Path("points.csv").write_text("".join(without("uni,")(without("articulation,")(points))), encoding="utf-8")
    ran = truearm(*options("own.toml")).done()
    assert (
        "limits of the specification that were not tested: L_Dia.5x5, E_Uni, E_Bi, EffectiveDiameter, SPAT.Max"
        in ran.out
    )
    assert ran.out.splitlines()[0] == "conform: the values tested are within their limits"


def test_both_standards_and_opposite_faces(truearm, bench):
    Path("points.csv").write_text(Made(degC=23.5).asme().text(), encoding="utf-8")
    ran = truearm(*options("asme.toml")).done()
    for label in ("EffectiveDiameter", "SPAT.Max", "SPAT.2s", "Volumetric.Max", "Volumetric.2RMS"):
        assert label in ran.out
    assert "the specification states no limit for: Volumetric.2s, Volumetric.2RMS" in ran.out
    Path("points.csv").write_text(Made(degC=18.0).iso(bi=True).text(), encoding="utf-8")
    ran = truearm(*options()).done()
    assert "E_Bi, 1700" in ran.out
    assert "was not carried out" not in ran.out
    assert (
        "limits of the specification that were not tested: EffectiveDiameter, SPAT.Max, SPAT.2s, Volumetric.Max\n"
        in ran.out
    )


def test_machines_get_the_whole_budget(truearm, bench):
    found = json.loads(truearm(*options(), "--json").out)
    assert found["standard"] == "ISO 10360-12:2016"
    row = next(row for row in found["rows"] if row["label"] == "E_Uni, 1700")
    lines = {one["label"]: one["u"] for one in row["budget"]}
    assert lines["calibration of the length"] == 0.0005
    assert lines["temperature of the artefact"] == pytest.approx(1700.005 * 1e-6 * 0.5)
    assert row["coverage_factor"] == 2
    assert row["degrees_of_freedom"] is None
    assert row["uncertainty"] == pytest.approx(2 * sum(u**2 for u in lines.values()) ** 0.5)


# Refusals ------------------------------------------------------------------------------------------------------------


def without(phrase):
    return lambda text: "".join(line for line in text.splitlines(keepends=True) if phrase not in line)


def first(phrase, before, after):
    """Change the first line that holds a phrase."""

    def change(text):
        lines = text.splitlines(keepends=True)
        at = next(i for i, line in enumerate(lines) if phrase in line)
        lines[at] = lines[at].replace(before, after, 1)
        return "".join(lines)

    return change


def first_two(phrase, before, after):
    """Both ends of the first length that holds a phrase."""
    once = first(phrase, before, after)
    return lambda text: once(once(text))


def scaled(factor):
    def change(text):
        rows = [line.split(",") for line in text.splitlines()]
        for row in rows[1:]:
            row[8:11] = [repr(float(cell) * factor) for cell in row[8:11]]
        return "\n".join(",".join(row) for row in rows) + "\n"

    return change


def one_less(phrase):
    def change(text):
        lines = text.splitlines(keepends=True)
        del lines[next(i for i, line in enumerate(lines) if phrase in line)]
        return "".join(lines)

    return change


def again(text, phrase, instead):
    """The lines that hold a phrase, once more and each a little off, with another instead."""
    for i, line in enumerate(text.splitlines(keepends=True)):
        if phrase in line:
            cells = line.replace(phrase, instead).split(",")
            cells[8] = repr(float(cells[8]) + 0.001 * (1 + i % 3))
            yield ",".join(cells)


def copied(test, columns, source, targets):
    """The coordinates of the lines of a test that have `source` in some columns written into those of `targets`."""

    def change(text):
        rows = [line.split(",") for line in text.splitlines()]
        told = lambda row: tuple(row[i] for i in columns)  # noqa: E731
        of = [row[8:11] for row in rows if row[0] == test and told(row) == source]
        for target in targets:
            for row, point in zip([row for row in rows if row[0] == test and told(row) == target], of, strict=True):
                row[8:11] = point
        return "\n".join(",".join(row) for row in rows) + "\n"

    return change


def moved(test, columns, told, *, by_mm, ends="AB"):
    """The points of a test that have `told` in some columns, moved along x."""

    def change(text):
        rows = [line.split(",") for line in text.splitlines()]
        for row in rows:
            if row[0] == test and tuple(row[i] for i in columns) == told and row[6] in ends:
                row[8] = repr(float(row[8]) + by_mm)
        return "\n".join(",".join(row) for row in rows) + "\n"

    return change


def on_a_cap(text):
    """The points of the first position of the probing test within 20 deg of the pole."""
    rows = [line.split(",") for line in text.splitlines()]
    for i, row in enumerate(row for row in rows if row[0] == "probing" and row[3] == "1"):
        z, turn = 1 - 0.06 * i / 24, 2.4 * i
        level = (1 - z * z) ** 0.5
        point = (500 + 12.5 * level * math.cos(turn), 12.5 * level * math.sin(turn), 200 + 12.5 * z)
        row[8:11] = map(repr, point)
    return "\n".join(",".join(row) for row in rows) + "\n"


def placed(test, *, seats=None, along=None, apart_mm=11.0):
    """The seats at other places along x; or the positions of the bars all along one direction, so far apart."""

    def change(text):
        rng = np.random.default_rng(5)
        rows = [line.split(",") for line in text.splitlines()]
        inside = [row for row in rows if row[0] == test]
        names = list(dict.fromkeys(row[3] for row in inside))
        for row in inside:
            at, noise = names.index(row[3]), 0.001 * rng.normal(size=3)
            if seats is None:
                point = [apart_mm * at - 400, 0, 0] + (row[6] == "B") * float(row[4]) * np.array(along)
            else:
                point = np.array([seats[at], 0.0, 0.0])
            row[8:11] = (f"{value:.5f}" for value in point + noise)
        return "\n".join(",".join(row) for row in rows) + "\n"

    return change


def in_patches(points):
    """The points of the first position of the probing test at these places on its ball."""

    def change(text):
        rng = np.random.default_rng(6)
        rows = [line.split(",") for line in text.splitlines()]
        inside = [row for row in rows if row[0] == "probing" and row[3] == "1"]
        for row, normal in zip(inside, points, strict=True):
            row[8:11] = (f"{x:.5f}" for x in [500, 0, 200] + 12.5 * normal + 0.001 * rng.normal(size=3))
        return "\n".join(",".join(row) for row in rows) + "\n"

    return change


def cap(n, half_deg, lean_deg=0.0):
    """Unit vectors spread over a cap about a pole that leans towards x."""
    z, turn = np.linspace(1, np.cos(np.radians(half_deg)), n), 2.4 * np.arange(n)
    level, lean = np.sqrt(1 - z * z), np.radians(lean_deg)
    x, y = level * np.cos(turn), level * np.sin(turn)
    return np.column_stack([x * np.cos(lean) + z * np.sin(lean), y, z * np.cos(lean) - x * np.sin(lean)])


def nudged(change):
    """As changed, and all points some um off on their own."""

    def both(text):
        rng = np.random.default_rng(3)
        rows = [line.split(",") for line in change(text).splitlines()]
        for row in rows[1:]:
            row[8:11] = [repr(float(cell) + 0.003 * rng.normal()) for cell in row[8:11]]
        return "\n".join(",".join(row) for row in rows) + "\n"

    return both


def carried(text, test, column, *, turned_deg=0.0, scatter_mm=0.0, each=()):
    """The points of the first position or repeat in place of those of all others, moved and turned.

    Each measurement (those that differ in the columns `each`) is moved on its own, by 60 mm and more.
    """
    rng = np.random.default_rng(7)
    rows = [line.split(",") for line in text.splitlines()]
    inside = [row for row in rows if row[0] == test]
    first = inside[0][column]
    told = lambda row: (row[1], *(row[i] for i in range(3, 8) if i != column))  # noqa: E731
    of: dict[tuple[str, ...], list[np.ndarray]] = {}
    for row in inside:
        if row[column] == first:
            of.setdefault(told(row), []).append(np.array(row[8:11], float))
    moves: dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]] = {}
    for row in inside:
        if row[column] == first:
            continue
        key = (row[column], *(row[i] for i in each))
        if key not in moves:
            turn = about_z(turned_deg * len(moves) + turned_deg)
            moves[key] = turn, (np.array([60.0, 7, 3]) * (1 + len(moves)) if column == 3 else np.array([5.0, 0, 0]))
        turn, by = moves[key]
        used = of[told(row)].pop(0)
        of[told(row)].append(used)
        row[8:11] = (f"{value:.6f}" for value in turn @ used + by + scatter_mm * rng.normal(size=3))
    return "\n".join(",".join(row) for row in rows) + "\n"


# The second sphere's place where the first is, and the second place of a length.
SECOND_SPHERE = copied("probing", (3,), ("1",), [("2",)])
SECOND_BAR = copied("uni", (3, 4), ("1", "150"), [("2", "150")])


def first_column(name, after):
    return lambda text: text.replace(name, after, 1)


POINTS = {
    "no probing": (without("probing"), ["points of test 'probing' are missing", "Try: measure them"]),
    "no position 2": (without("probing,ball,2026-11-03,2"), ["line 2", "asks for 2 positions, got 1: '1'. Try:"]),
    "a point less": (one_less("probing"), ["the plan asks for 25 points at position 1, got 24"]),
    "a group less": (without(",,,,D,"), ["the plan asks for 5 groups at position 1, got 4: 'A', 'B', 'C', 'E'."]),
    "group of four": (one_less(",,,,B,"), ["the plan asks for 5 points at position 1, group B, got 4"]),
    "a repeat less": (without(",3,450,2,"), ["length 450, position 3: expected repeats 1 to 3, got 1, 3"]),
    "an end less": (one_less(",1,B,"), ["length 150, position 1, repeat 1: end B is missing"]),
    "a length less": (without(",900,"), ["the plan asks for 5 lengths, got 4: 'bar 150', 'bar 450', 'bar 1300'"]),
    "a position more": (
        first_two(",7,150,", ",7,150,", ",8,150,"),
        ["asks for 7 positions of length 150, got 8: '1', '2', '3'", "or change the plan"],
    ),
    "metres": (scaled(1e-3), ["measured 0.02499", "convert the points to mm: they seem to be in metres"]),
    "centimetres": (scaled(0.1), ["measured 2.49", "convert the points to mm: they seem to be in centimetres"]),
    "inches": (scaled(1 / 25.4), ["measured 0.98", "convert the points to mm: they seem to be in inches"]),
    "unit in the head": (first_column("x_mm", "x_inch"), ["line 1, column 'x_inch'", "Try: x_mm, with coordinates"]),
    "no x": (first_column("x_mm", "note_x"), ["the column x_mm is missing"]),
    "empty column": (
        lambda text: text.replace("\n", ",1\n").replace("1\n", "\n", 1),
        ["column 13: the column has no name"],
    ),
    "unknown column": (first_column("group", "gruppe"), ["unknown column 'gruppe'", "Try: test, artefact"]),
    "column twice": (first_column("repeat", "length"), ["column 'length'", "two columns have this name"]),
    "unknown test": (first("uni", "uni", "unit"), ["column 'test'", "unknown test 'unit'", "Try: use uni"]),
    "another standard's": (first("uni", "uni", "volumetric"), ["has no 'repeat'", "leave the cell empty"]),
    "unknown artefact": (
        lambda text: text.replace("ing,ball", "ing,bal"),
        ["has no sphere 'bal'", "use one of 'ball'"],
    ),
    "unknown length": (lambda text: text.replace(",150,", ",160,"), ["has no length '160'", "Try: use one of '150'"]),
    "days to come": (
        lambda text: text.replace("2026", "2027"),
        ["line 2, column 'date': the date 2027-11-03 is in the future. Try: write year, month, day"],
    ),
    "too early": (lambda text: text.replace("2026", "2025"), ["calibrated on 2026-01-15, after points were measured"]),
    "eight months": (
        lambda text: text.replace("uni,bar,2026-11-03", "uni,bar,2026-03-03"),
        ["points of one test were measured on 2026-03-03 and on 2026-11-03, 245 days apart", "--accept REASON"],
    ),
    "humidity as a share": (
        lambda text: text.replace("\n", ",0.40\n").replace("0.40", "humidity_percent", 1),
        ["line 2, column 'humidity_percent': expected humidity_percent from 2 to 100, got 0.4"],
    ),
    "tip in m": (
        lambda text: text.replace("\n", ",0.01\n").replace("0.01", "tip_diameter_mm", 1),
        ["0, or the diameter of a stylus tip from 0.1 to 50 mm, got 0.01. Try: write it in mm: 6 for a ball"],
    ),
    "no date": (first("uni", "2026-11-03", ""), ["column 'date'", "needs 'date', got an empty cell"]),
    "odd date": (lambda text: text.replace("2026-11-03", "3/11/2026"), ["a date, got '3/11/2026'", "Try: write"]),
    "no temperature": (first("probing", ",20.0", ","), ["column 'artefact_degC'", "needs the temperature"]),
    "end B warmer": (
        first(",1,150,1,B,", ",20.0", ",25.0"),
        ["test 'uni', length 150, position 1, repeat 1: end A was at 20", "no definite temperature"],
    ),
    "a point warmer": (first("probing", ",20.0", ",25.0"), ["points of one group were measured at 20 and at 25 degC"]),
    "fahrenheit": (lambda text: text.replace(",20.0", ",68.7"), ["in degC, got 68.7", "convert from Fahrenheit"]),
    "kelvin": (lambda text: text.replace(",20.0", ",293.15"), ["column 'artefact_degC'", "in degC, got 293.15"]),
    "no group": (first("articulation", ",A,", ",,"), ["column 'group'", "needs 'group', got an empty cell"]),
    "odd repeat": (first("uni", ",1,A", ",one,A"), ["column 'repeat'", "expected a whole number", "got 'one'"]),
    "repeat with a zero": (first_two("uni", ",1,A", ",01,A"), ["end B is missing"]),
    "repeat four as 01": (
        lambda text: text + "".join(again(text, ",1,150,1,", ",1,150,01,")),
        ["length 150, position 1: expected repeats 1 to 3, got 1, 1, 2, 3"],
    ),
    "control characters": (
        first("probing", ",1,,,", ",1\x1b]0;title\x07,,,"),
        ["line 2, column 'position'", "expected plain text in one line, got the control character '\\x1b'"],
    ),
    "raised repeat": (first("uni", ",1,A", ",²,A"), ["column 'repeat'", "expected a whole number", "got '²'"]),
    "far away": (scaled(1e280), ["line 2, column 'x_mm'", "expected a coordinate within 1e+06 mm"]),
    "odd end": (first("uni", ",A,", ",left,"), ["column 'end'", "expected A or B, got 'left'"]),
    "text": (first("probing", ",20.0", ",warm"), ["line 2, column 'artefact_degC'", "a number, got 'warm'"]),
    "an empty row": (first("uni", "uni", ",,,,,,,,,,,\nuni"), ["expected numbers, got an empty row. Try: delete"]),
    "empty": (lambda text: "", ["empty file"]),
    "a sphere's place copied": (SECOND_SPHERE, ["position 2 has the same coordinates as position 1: a copy"]),
    "one place twice": (nudged(SECOND_SPHERE), ["position 1 and position 2 are", "mm apart: one position, not two"]),
    "a repeat copied": (
        copied("uni", (3, 4, 5), ("4", "450", "1"), [("4", "450", "3")]),
        ["position 4, repeat 3 has the same coordinates as length 450, position 4, repeat 1: a copy"],
    ),
    "a bar's place copied": (SECOND_BAR, ["position 2, repeat 1 has the same coordinates as length 150, position 1"]),
    "a bar not moved": (nudged(SECOND_BAR), ["length 150, position 2, repeat 1 are", "apart: one position, not two"]),
    "a second sphere moved and turned": (
        lambda text: carried(text, "probing", 3, turned_deg=20),
        ["position 2 has its points to each other to 20 nm as position 1: a copy", "--accept REASON"],
    ),
    "groups moved with 1 nm of noise": (
        lambda text: carried(text, "articulation", 3, scatter_mm=1e-6),
        ["position 2, group A has its points to each other to 20 nm as position 1, group A: a copy"],
    ),
    "repeats moved by 5 mm": (
        lambda text: carried(text, "uni", 5),
        ["length 150, position 1, repeat 2 has its points to each other to 20 nm as length 150, position 1, repeat 1"],
    ),
    "repeats turned": (
        lambda text: carried(text, "uni", 5, turned_deg=0.5, scatter_mm=1e-6),
        ["has 5 lengths to 20 nm as position", "a copy"],
    ),
    "positions turned": (
        lambda text: carried(text, "uni", 3, turned_deg=25.3, each=(4, 5)),
        ["position 2, repeat 1 has 5 lengths to 20 nm as position 1, repeat 1: a copy"],
    ),
    "a group copied": (
        copied("articulation", (3, 7), ("1", "A"), [("1", "D")]),
        ["position 1, group D has the same coordinates as position 1, group A: a copy"],
    ),
    "a run elsewhere": (
        moved("uni", (3, 4, 5), ("4", "450", "2"), by_mm=80.0),
        ["length 450, position 4, repeat 2: an end is 80 mm away from its place in the first run", "Try: keep the bar"],
    ),
    "points on a cap": (on_a_cap, ["test 'probing', position 1: the points lie so close together on the ball"]),
    "most points about the pole": (
        in_patches(np.concatenate([cap(21, 2), hemisphere(5)[1:]])),
        ["position 1: the points leave most of the ball untouched", "13 deg in the pattern of the plan"],
    ),
    "all bars along y": (
        placed("uni", along=(0, 1, 0), apart_mm=15),
        ["length 150: the plan asks for 4 directions of the bar, 30 deg apart or more; its 7 positions had 1"],
    ),
    "flat": (lambda text: re.sub(r"(?m)^(probing.*,)[^,]*(,20.0)$", r"\g<1>0.0\2", text), ["in one plane"]),
}


@pytest.mark.parametrize("what", POINTS)
def test_wrong_points_are_refused(refused, bench, what):
    change, phrases = POINTS[what]
    path = Path("points.csv")
    before = path.read_text(encoding="utf-8")
    path.write_text(change(before), encoding="utf-8")
    assert path.read_text(encoding="utf-8") != before
    assert "truearm import" not in refused(options(), "truearm: points.csv", *phrases)


def test_empty_rows_at_the_end_are_no_points(truearm, bench):
    path = Path("points.csv")
    before = truearm(*options())
    path.write_text(path.read_text(encoding="utf-8") + ",,,,,,,,,,,\n\n,,,,,,,,,,,\n", encoding="utf-8")
    assert truearm(*options()) == before


SLIPS = {
    "a length": (
        "artefacts.toml",
        lambda text: text.replace("length_mm = 450.002", "length_mm = 470.002"),
        (
            r"E_Uni, 450: -20\.00\d\d mm is 95\d times the limit: probably a blunder, and so are all "
            r"measurements of this length; check length_mm = 470\.002 of 'bar', "
            r"and the names of its lengths in the points"
        ),
    ),
    "an end": (
        "points.csv",
        moved("uni", (3, 4, 5), ("4", "900", "2"), by_mm=20.0, ends="B"),
        r"E_Uni, 900: .*: probably a blunder; check length 900, position 4, repeat 2 \(line \d+\), and that .*",
    ),
    "the diameter": (
        "artefacts.toml",
        lambda text: text.replace("diameter_mm = 25.0004", "diameter_mm = 25.4004"),
        r"P_Size\.Sph\.1x25: -0\.40\d\d mm is 27 times the limit: probably a blunder; check diameter_mm of 'ball', .*",
    ),
    "a point of a ball": (
        "points.csv",
        lambda text: text.replace(*off(text, 10, 3.0)),
        (
            r"test 'probing', position 1: only the point of line 10 deviates, by 1\.7 mm from the sphere of the "
            r"others, whose form is 0\.00\d\d mm; measure the position again"
        ),
    ),
    "a group": (
        "points.csv",
        moved("articulation", (3, 7), ("2", "C"), by_mm=3.0, ends=("",)),
        (
            r"test 'articulation', position 2, group C \(line \d+\): only its sphere deviates, by 2\.4 mm from the "
            r"mean of all groups; measure the group again"
        ),
    ),
}


def off(text, line, by_mm):
    """A line of the file, and the same with x so far off."""
    whole = text.splitlines()[line - 1]
    cells = whole.split(",")
    return whole, ",".join([*cells[:8], repr(float(cells[8]) + by_mm), *cells[9:]])


@pytest.fixture(scope="module")
def good(truearm, tmp_path_factory):
    """What is found of the good arm."""
    with contextlib.chdir(tmp_path_factory.mktemp("good")):
        write_bench()
        return json.loads(truearm(*options(), "--json").out)


@pytest.mark.parametrize("what", SLIPS)
def test_a_blunder_is_reported_beside_the_verdict(truearm, bench, good, what):
    file, change, told = SLIPS[what]
    path = Path(file)
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    ran = truearm(*options(), "--json", "--page", "page.html")
    found = json.loads(ran.out)
    assert (ran.code, found["verdict"]) == (1, "not conform"), ran
    (slip,) = [remark for remark in found["remarks"] if remark not in good["remarks"]]
    assert re.fullmatch(told, slip), slip
    assert slip in truearm(*options()).out
    assert html.escape(slip[1:]).replace("&#x27;", "&#39;") in Path("page.html").read_text(encoding="utf-8")


def test_single_points_in_a_seat_and_lengths_of_the_other_standard(truearm, bench):
    """A seat's point 2 mm off; and a length of the bar that was calibrated otherwise."""
    made = Made().asme().text()
    line = next(i for i, row in enumerate(made.splitlines(), 1) if row.startswith("single_point")) + 4
    Path("points.csv").write_text(made.replace(*off(made, line, 2.0)), encoding="utf-8")
    Path("artefacts.toml").write_text(ARTEFACTS.replace("length_mm = 900.003", "length_mm = 909.003"), encoding="utf-8")
    found = json.loads(truearm(*options("asme.toml"), "--json").out)
    seat, length = found["remarks"][:2]
    assert seat == (
        f"test 'single_point', position near: only the point of line {line} deviates, by 1.8 mm from the mean of "
        f"all points; measure the position again"
    )
    assert re.match(r"Volumetric\.Max, 900: -9\.00\d\d mm is 180 times .*; check length_mm = 909\.003 of 'bar'", length)


def test_an_arm_out_of_adjustment_is_no_blunder(truearm, bench):
    """Ten times its noise, 0.5 mm in a metre: not conform, and nothing is suspected."""
    good = json.loads(truearm(*options(), "--json").out)["remarks"]
    Path("points.csv").write_text(Made(noise_mm=0.05, too_large=1e-4, away_mm=0.2).iso().text(), encoding="utf-8")
    found = json.loads(truearm(*options(), "--json").out)
    assert {row["verdict"] for row in found["rows"]} >= {"not conform"}
    assert found["remarks"] == good


def test_equal_points_have_no_outlier(truearm, bench):
    """Seats of an arm with noise of 0.1 um: the one whose point is 2 mm off is told, the others scatter by nothing."""
    plan = confirm(plan_text("asme-b89.4.22"))
    head, _, rest = plan.partition("[effective_diameter]")
    Path("own.toml").write_text(
        head + "[single_point]" + rest.partition("[single_point]")[2].partition("[volum")[0], encoding="utf-8"
    )
    rows = Made(noise_mm=0.0001).asme().text().splitlines(keepends=True)
    text = "".join(row for row in rows if row.startswith(("test", "single_point")))
    Path("points.csv").write_text(text.replace(*off(text, 15, 2.0), 1), encoding="utf-8")
    found = json.loads(truearm(*options("own.toml"), "--json").out)
    (told,) = [remark for remark in found["remarks"] if "only the point" in remark]
    assert told.startswith("test 'single_point', position middle: only the point of line")


@pytest.mark.parametrize(("test", "of"), [("single_point", 0), ("single_point", 12), ("effective_diameter", 9)])
def test_a_point_stored_twice_is_refused_wherever_it_was_pasted(truearm, refused, bench, test, of):
    """A button that bounces in a seat; a row of another seat. Distances `of` rows.

    Of another run on the ball it is remarked: of three points at one place a coarse grid cannot be excluded.
    """
    lines = Made(noise_mm=0.005).asme().text().splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith(test))
    cells, source = lines[at + max(of, 1)].split(","), lines[at].split(",")
    cells[8:11] = source[8:11]
    lines[at + max(of, 1)] = ",".join(cells)
    Path("points.csv").write_text("".join(lines), encoding="utf-8")
    said = f"the point of line {at + 1 + max(of, 1)} has the same coordinates as line {at + 1}, "
    if test == "effective_diameter":
        assert said in " ".join(json.loads(truearm(*options("asme.toml"), "--json").out)["remarks"])
        return
    refused(options("asme.toml"), f"test '{test}': ", said, "a copy", "--accept REASON")


@pytest.mark.parametrize("n", [4, 6, 10])
def test_most_points_of_a_seat_the_same_are_refused(truearm, bench, n):
    """A program that sends the first one again and again: SPAT would be too good, or 0.

    Some may be chance where coordinates are written to 0.01 mm.
    """
    lines = Made(noise_mm=0.01).asme().text().splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith("single_point"))
    lines[at : at + n] = [lines[at]] * n
    coarse = re.sub(r"(\.\d\d)\d{3}(?=,)", r"\1", "".join(lines))
    Path("points.csv").write_text(coarse, encoding="utf-8")
    ran = truearm(*options("asme.toml"))
    if n == 4:
        assert ran.code != 2, ran
        return
    assert (ran.code, ran.out) == (2, ""), ran
    said = (
        f"test 'single_point', position near: the point of line {at + 1} is repeated in line {at + 2}, line {at + 3}, "
    )
    assert said in ran.err
    assert "Try: measure the position again; if the coordinates are rounded, write them with more digits" in ran.err


@pytest.mark.parametrize("range_mm", [250, 1600])
def test_an_arm_reaches_no_farther_than_its_measuring_range(truearm, refused, bench, range_mm):
    """It measured a bar of 1700 mm; makers who round 1.7 m to 1.65 are believed."""
    Path("mpe.toml").write_text(MPE.replace("2500", str(range_mm)), encoding="utf-8")
    refused(options(), f"mm apart, more than the measuring range of {range_mm} mm. Try: correct measuring_range_mm")
    if range_mm == 250:  # of which 150 mm is no short length
        return
    said = truearm(*options(), "--accept", "leapfrog, in one frame", "--json")
    assert any("Accepted (leapfrog, in one frame): test '" in one for one in json.loads(said.out)["remarks"])


def test_thermometers_are_uncertain(truearm, bench):
    for degC, code in ((20.0, 0), (24.0, 2)):
        Path("points.csv").write_text(Made(degC=degC).iso().text(), encoding="utf-8")
        Path("artefacts.toml").write_text(
            ARTEFACTS.replace("u_temperature_K = 0.5", "u_temperature_K = 0.0"), encoding="utf-8"
        )
        ran = truearm(*options())
        assert ran.code == code, ran
    assert "u_temperature_K = 0 of 'bar', measured more than 1 K from 20 degC" in ran.err


def test_every_form_states_the_measuring_range_and_the_serial_numbers_of_the_artefacts(truearm, bench):
    Path("artefacts.toml").write_text(
        ARTEFACTS.replace('name = "bar"', 'name = "bar"\nserial_number = "B-77"'), encoding="utf-8"
    )
    ran = truearm(*options(), "--page", "page.html")
    assert "measuring arm 2.5 m, measuring range 2500 mm" in ran.out.splitlines()[1]
    assert "Artefacts: ball, serial number not stated; bar, serial number B-77." in ran.out
    found = json.loads(truearm(*options(), "--json").out)
    assert found["measuring_range_mm"] == 2500
    assert [(one["name"], one["serial_number"]) for one in found["artefacts"]] == [("ball", None), ("bar", "B-77")]
    page = html.unescape(Path("page.html").read_text(encoding="utf-8"))
    assert "its data sheet, for a measuring range of 2500 mm." in page
    assert "bar, serial number B-77, length 1700" in page


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (placed("volumetric", along=(1, 0, 0)), "length 900: the plan asks for 4 directions of the bar, 30 deg apart"),
        (placed("single_point", seats=(600, 611, 622)), "two positions are 22 mm apart, the plan asks for 750 mm or"),
        (placed("single_point", seats=(200, 600, 951)), None),
    ],
)
def test_a_layout_that_the_plan_does_not_ask_for_is_refused(truearm, bench, change, said):
    """Another one is a plan of one's own, which its results say."""
    Path("points.csv").write_text(change(Made().asme().text()), encoding="utf-8")
    ran = truearm(*options("asme.toml"))
    assert (ran.code, said is None or said in ran.err) == (0 if said is None else 2, True), ran
    own = Path("asme.toml").read_text(encoding="utf-8").replace("directions = { value = 4", "directions = { value = 1")
    Path("asme.toml").write_text(
        own.replace("spread_share = { value = 0.3", "spread_share = { value = 0"), encoding="utf-8"
    )
    ran = truearm(*options("asme.toml"))
    assert ", own plan: measuring arm 2.5 m" in ran.out.splitlines()[1]
    assert "own plan, different from truearm's plan after ASME B89.4.22-2004: directions = 1 (4)" in ran.out


def test_bars_too_short_for_the_arm_are_refused_in_the_volumetric_test(truearm, bench):
    """1700 mm are 68 % of 2500 mm, 60 % of 2833 mm: enough up to there."""
    Path("points.csv").write_text(Made().asme().text(), encoding="utf-8")
    for range_mm, code in ((2800, 0), (2850, 2)):
        Path("mpe.toml").write_text(
            MPE.replace("measuring_range_mm = 2500", f"measuring_range_mm = {range_mm}"), encoding="utf-8"
        )
        ran = truearm(*options("asme.toml"))
        assert ran.code == code, ran
    assert "test 'volumetric': the longest length is 1700 mm, the plan asks for 1710 mm or more, 60%" in ran.err
    assert "Try: use a longer bar, or correct longest_share in the plan by your copy of the standard" in ran.err


def test_ends_the_other_way_round_in_a_run_are_told_and_change_nothing(truearm, bench):
    good = truearm(*options())
    swap = {"A": "B", "B": "A"}
    rows = [line.split(",") for line in Path("points.csv").read_text(encoding="utf-8").splitlines()]
    for row in rows:
        if (row[3], row[4], row[5]) == ("4", "450", "2"):
            row[6] = swap[row[6]]
    Path("points.csv").write_text("\n".join(",".join(row) for row in rows) + "\n", encoding="utf-8")
    ran = truearm(*options())
    (told,) = set(ran.out.splitlines()) - set(good.out.splitlines())
    assert ran.code == 0
    assert told == (
        "test 'uni': ends A and B are exchanged compared with the first run, without effect on the length: "
        "length 450, position 4, repeat 2"
    )


def test_points_of_one_group_are_of_one_day(refused, bench):
    path = Path("points.csv")
    path.write_text(
        first("probing,ball,2026-11-03,1", "2026-11-03", "2026-11-04")(path.read_text(encoding="utf-8")),
        encoding="utf-8",
    )
    refused(options(), "points of one group were measured on 2026-11-04 and on 2026-11-03")


def test_groups_of_two_places_are_not_taken_for_one(refused, bench):
    path = Path("points.csv")
    text = path.read_text(encoding="utf-8")
    lines = [line.split(",") for line in text.splitlines()]
    for cells in lines:
        if cells[0] == "articulation" and cells[3] == "1" and cells[7] == "C":
            cells[8] = repr(float(cells[8]) + 40)
    path.write_text("\n".join(",".join(cells) for cells in lines) + "\n", encoding="utf-8")
    refused(options(), "position 1, group C: the sphere is", "stays in place")


@pytest.mark.parametrize(
    ("file", "before", "after", "phrases"),
    [
        ("artefacts.toml", "expires = 2028-01-15", "expires = 2026-06-30", ["csv, line 2", "expired on 2026-06-30"]),
        ("artefacts.toml", "expires = 2028-01-15", "expires = 2025-01-15", ["cts.toml", "not after its calibration"]),
        ("artefacts.toml", "diameter_mm = 25.0004", "diameter_mm = 0.98427", ["calibrated 0.98427 mm, nominal 25 mm"]),
        ("artefacts.toml", '"ball"', '"bar"', ["the artefact 'bar' is given twice"]),
        ("artefacts.toml", "[[seats]]", "[[seat]]", ["unknown key seat", "Try: use one of spheres, bars, seats"]),
        ("mpe.toml", "measuring_range_mm = 2500", "measuring_range_mm = 4000", ["the longest length is 1700", "66%"]),
        ("mpe.toml", "arm 2.5 m", "arm \\u001b]0;title\\u0007", ["name: expected plain text in one line", r"'\x1b'"]),
        ("artefacts.toml", '"K-101"', '"K\\n101"', ["certificate: expected plain text in one line", r"'\n'"]),
        ("mpe.toml", "measuring_range_mm", "measuring_range_m", ["mpe.toml: unknown key measuring_range_m"]),
        ("mpe.toml", "E_Uni = {", "E_uni = {", ["unknown symbol 'E_uni'", "Try: use E_Uni"]),
        ("mpe.toml", "{ B_um = 15 }", "{ A_um = 1, K_mm_per_um = 5 }", ["P_Size.Sph.1x25: this test has no length"]),
    ],
)
def test_wrong_certificates_and_limits_are_refused(refused, bench, file, before, after, phrases):
    path = Path(file)
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")
    refused(options(), *phrases)


def test_limits_of_another_standard_decide_nothing(refused, bench):
    Path("mpe.toml").write_text(
        MPE.partition("[limits]")[0] + '[limits]\n"SPAT.Max" = { B_um = 30 }\n', encoding="utf-8"
    )
    refused(options(), "states no limit for what was tested")


@pytest.mark.parametrize("missing", ["points.csv", "artefacts.toml", "mpe.toml"])
def test_a_missing_file_is_named(refused, bench, missing):
    Path(missing).unlink()
    refused(options(), missing)


# The page ------------------------------------------------------------------------------------------------------------


def test_the_page_shows_what_the_program_prints(truearm, bench):
    shown = blocks("verification.md", "console")[0]
    command, _, printed = shown.partition("\n")
    assert command == "$ truearm " + " ".join(options("iso10360-12"))
    gaps = re.escape(printed).replace(re.escape("..."), "(?s:.*?)")
    assert re.match(gaps, truearm(*options("iso10360-12")).out)
    assert "plan, probing: not confirmed" in printed


def test_the_files_of_the_page_are_those_of_the_run():
    assert blocks("verification.md", "toml mpe") == [MPE]
    (plan,) = blocks("verification.md", "toml")
    for line in plan.splitlines():
        assert line in plan_text("iso10360-12")
    for line in blocks("verification.md", "csv")[0].splitlines():
        cells = line.split(",")
        assert len(cells) == 12
        assert cells[0] in ("test", *KEY_COLUMNS)


def test_the_page_tells_what_to_do_with_one_ball_bar(truearm, refused, bench):
    """The two lines of the page in the plan, a bar of one length: refused before, laid out and judged after."""
    (after,) = (shown.partition("\n") for shown in blocks("verification.md", "console one bar"))
    lines = ARTEFACTS.splitlines(keepends=True)
    lengths = [line for line in lines if line.startswith('  { name = "')]
    Path("mine.toml").write_text(
        "".join(line for line in lines if line not in lengths or '"900"' in line), encoding="utf-8"
    )
    refused(
        ["verify", "sheet", "iso10360-12", "--page", "sheet.html", "--artefacts", "mine.toml"],
        "needs 5 calibrated lengths, the file of artefacts has 1",
        "a plan with uni.lengths = 1 and uni.longest_share = 0.36",
    )
    plan = plan_text("iso10360-12").replace("Articulated arm with tactile probe", "Articulated arm, one ball bar")
    head, _, uni = plan.partition("[uni]")
    for line in blocks("verification.md", "toml one bar")[0].splitlines():
        uni = re.sub(rf"(?m)^{line.split(' = ')[0]} = .*$", line, uni, count=1)
    Path("my-plan.toml").write_text(f"{head}[uni]{uni}", encoding="utf-8")
    ran = truearm(*after[0].removeprefix("$ truearm ").split())
    assert (ran.code, ran.out) == (0, after[2]), ran
    points = Path("points.csv").read_text(encoding="utf-8")
    Path("points.csv").write_text(
        "".join(row for row in points.splitlines(keepends=True) if "uni," not in row or ",900," in row),
        encoding="utf-8",
    )
    assert (
        "the plan asks for 5 lengths, got 1: 'bar 900'. Try: measure those that are missing, or change"
        in truearm(*options()).err
    )
    ran = truearm(*(option.replace("artefacts.toml", "mine.toml") for option in options("my-plan.toml")))
    assert ran.code == 3, ran
    assert "E_Uni, 900" in ran.out
    assert "lengths = 1, positions = 7, directions = 4, repeats = 3, longest_share = 0.36" in ran.out
    Path("my-plan.toml").write_text(confirm(Path("my-plan.toml").read_text(encoding="utf-8")), encoding="utf-8")
    ran = truearm(*(option.replace("artefacts.toml", "mine.toml") for option in options("my-plan.toml"))).done()
    assert (
        "plan, uni: own plan, different from truearm's plan after ISO 10360-12:2016: lengths = 1 (5), longest_share = "
        "0.36 (0.66)" in ran.out
    )
    ran = truearm("verify", "sheet", "asme-b89.4.22", "--page", "sheet.html", "--artefacts", "mine.toml")
    assert "'volumetric' needs 2 calibrated lengths, the file of artefacts has 1" in ran.err
    assert "a plan with volumetric.lengths = 1" in ran.err
    plan = confirm(plan_text("asme-b89.4.22"))
    head, _, volumetric = plan.partition("[volumetric]")
    for line in blocks("verification.md", "toml one bar")[0].splitlines():
        volumetric = re.sub(rf"(?m)^{line.split(' = ')[0]} = .*$", line, volumetric, count=1)
    Path("my-plan.toml").write_text(f"{head}[volumetric]{volumetric}", encoding="utf-8")
    rows = [row for row in Made().asme().text().splitlines(keepends=True) if ",1700," not in row]
    more = [row.split(",") for row in Made(seed=2).asme().text().splitlines(keepends=True) if ",900," in row]
    more = [[*cells[:3], f"{int(cells[3]) + 10}", *cells[4:]] for cells in more]
    Path("points.csv").write_text("".join([*rows, *map(",".join, more)]), encoding="utf-8")
    ran = truearm(*(option.replace("artefacts.toml", "mine.toml") for option in options("my-plan.toml")))
    assert ran.code == 3, ran  # the two are agreed, and not confirmed
    assert "[volumetric]" not in ran.out
    assert "lengths = 1, longest_share = 0.36" in ran.out


@pytest.mark.parametrize(("kind", "key"), [("artefacts", "[[bars]]"), ("mpe", "measuring_range_mm = ")])
def test_an_empty_file_is_printed_to_fill_in(truearm, bench, kind, key):
    ran = truearm("verify", "template", kind).done()
    assert key in ran.out
    Path(f"{kind}.toml").write_text(ran.out, encoding="utf-8")
    assert truearm(*options()).refused().err.startswith(f"truearm: {kind}.toml: 2 faults\n  1. ")


def test_the_points_state_the_arm_that_measured_them(truearm, refused, bench):
    Path("points.csv").write_text(Made().iso().text("10017"), encoding="utf-8")
    ran = truearm(*options(), "--page", "page.html")
    assert ran.out.splitlines()[1].endswith("measuring range 2500 mm, serial number 10017")
    assert "10017" in Path("page.html").read_text(encoding="utf-8")
    assert json.loads(truearm(*options(), "--json").out)["serial_number"] == "10017"
    first, _, last = Made().iso().text("10017").rpartition("10017")
    Path("points.csv").write_text(f"{first}10018{last}", encoding="utf-8")
    refused(options(), "column 'serial_number': expected points of one arm, got serial numbers '10017' and '10018'")
    Path("points.csv").write_text(f"{first}B{last}".replace("10017", "{cell}"), encoding="utf-8")
    assert "expected points of one arm, got serial numbers '{cell}' and 'B'" in truearm(*options()).err


def test_the_page_names_every_column_and_what_tells_groups_apart():
    text = PAGE.read_text(encoding="utf-8")
    for name in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS):
        assert f"`{name}`" in text
    for test, keys in KEY_COLUMNS.items():
        row = next(line for line in text.splitlines() if line.startswith(f"| `{test}` | `"))
        assert row.split("|")[2].strip() == ", ".join(f"`{key}`" for key in keys)
        assert ("needed" in row) == (test in SIZE_TESTS)


def test_the_page_stands_beside_the_verdict_or_not_at_all(truearm, refused, bench, snapshot):
    Path("points.csv").write_text(Made(too_large=60e-6).iso().text(), encoding="utf-8")
    ran = truearm(*options(), "--page", "page.html")
    assert (ran.code, ran.err) == (1, "")
    html = Path("page.html").read_text(encoding="utf-8")
    assert "measuring arm 2.5 m: not conform" in html
    for label in ("P_Size.Sph.1x25", "E_Uni, 1700", "fixture", "K-102"):
        assert label in html
    assert "SHA-256" in html
    Path("my-plan.toml").write_text(plan_text("iso10360-12"), encoding="utf-8")
    assert truearm(*options("my-plan.toml"), "--page", "page.html").code == 3
    assert "check against your copy of the standard" in Path("page.html").read_text(encoding="utf-8")
    for file in ("my-plan.toml", "points.csv", "artefacts.toml", "mpe.toml"):
        assert f"SHA-256 {sha256(Path(file).read_bytes()).hexdigest()}" in Path("page.html").read_text(encoding="utf-8")
    before = snapshot(bench)
    for page in ("points.csv", "page.pdf", "away/page.html"):
        refused([*options(), "--page", page], page)
    Path("mpe.toml").write_text("", encoding="utf-8")
    assert truearm(*options(), "--page", "other.html").code == 2
    assert snapshot(bench) == before | {"mpe.toml": b""}


# Serial numbers and exchanged artefacts ------------------------------------------------------------------------------


def with_serials(number):
    """The rows of the points with the serial number of each artefact."""
    head, *rows = Path("points.csv").read_text(encoding="utf-8").splitlines()
    Path("points.csv").write_text(
        "\n".join([f"{head},artefact_serial_number", *(f"{row},{number(row)}" for row in rows)]), encoding="utf-8"
    )


def test_the_serial_number_of_an_artefact_is_compared_with_the_points(truearm, bench):
    artefacts = ARTEFACTS.replace('name = "bar"\n', 'name = "bar"\nserial_number = "B-7"\n')
    Path("artefacts.toml").write_text(
        artefacts.replace('name = "ball"\n', 'name = "ball"\nserial_number = "S-1"\n'), encoding="utf-8"
    )
    assert truearm(*options()).code == 0  # points without the column
    plain = Path("points.csv").read_text(encoding="utf-8")
    with_serials(lambda row: "B-7" if ",bar," in row else "S-1")
    ran = truearm(*options())
    assert (ran.code, "was not compared" in ran.out) == (0, False)
    Path("artefacts.toml").write_text(artefacts, encoding="utf-8")  # none of the ball
    said = "he serial number 'S-1' that the points state of 'ball' was not compared: the file of artefacts states none"
    assert truearm(*options()).out.count(said) == 1
    Path("artefacts.toml").write_text(
        artefacts.replace('name = "ball"\n', 'name = "ball"\nserial_number = "S-1"\n'), encoding="utf-8"
    )
    for number, named in (("B-8", ""), ("S-1", ", that of 'ball'")):
        Path("points.csv").write_text(plain, encoding="utf-8")
        with_serials(lambda row, number=number: number if ",bar," in row else "S-1")
        ran = truearm(*options())
        line = next(i for i, row in enumerate(plain.splitlines(), 1) if ",bar," in row)
        assert ran.code == 2
        assert ran.err.startswith(
            f"truearm: points.csv, line {line}: points on 'bar', which has the serial number 'B-7' by the file of "
            f"artefacts; here it is '{number}'{named}. Try: check the columns artefact"
        )
    Path("points.csv").write_text(plain, encoding="utf-8")
    with_serials(lambda row: row[-8:-6])
    assert "expected a group on one artefact, got serial numbers" in truearm(*options()).err


def test_exchanged_bars_are_refused_with_odds_and_accepted_with_a_reason(truearm, refused, bench):
    """A second bar whose lengths are longer by 0.4 per mille, which was measured under the name of the first."""
    ball, bar = ARTEFACTS.split("[[bars]]")
    bar, seat = bar.split("[[seats]]")
    other = re.sub(r"length_mm = ([\d.]+)", lambda found: f"length_mm = {float(found[1]) * (1 - 4e-4):.3f}", bar)

    def file(*bars):
        named = [text.replace('"bar"', f'"{name}"') for text, name in zip(bars, ("bar", "bar 2"), strict=True)]
        Path("artefacts.toml").write_text(
            "[[bars]]".join([ball, *named[:1], f"{named[1]}[[seats]]{seat}"]), encoding="utf-8"
        )

    file(bar, other)
    assert truearm(*options()).code == 0
    file(other, bar)
    refused(
        options(),
        "E_Uni: the lengths measured on 'bar' are those of 'bar 2' by the certificates: exchanged bars",
        " to 1. Try: compare the serial numbers on the bars",
    )
    ran = truearm(*options(), "--accept", "both bars were checked")
    assert ran.code == 1, ran
    assert "Accepted (both bars were checked): E_Uni: the lengths measured on 'bar'" in ran.out


def test_air_and_artefacts_that_disagree_are_said(truearm, bench):
    head, *rows = Path("points.csv").read_text(encoding="utf-8").splitlines()
    for air, apart in ((19.4, "up to 0.6 K outside"), (19.8, None)):
        Path("points.csv").write_text(
            "\n".join([f"{head},air_degC", *(f"{row},{air}" for row in rows)]), encoding="utf-8"
        )
        ran = truearm(*options()).done()
        assert (f"the air was stated at {air} degC, the artefacts at 20 degC" in ran.out) == (apart is not None)
        assert apart is None or apart in ran.out
