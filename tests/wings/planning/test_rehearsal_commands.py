"""The rehearsal on the command line: `simulate --plan`, `verify sheet --out`, `verify fill`."""

import csv

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.readings import read_lengths, read_session
from truearm.wings.planning.designs.candidates import bar_places
from truearm.wings.planning.designs.template import write_bar_lengths, write_template

pytestmark = pytest.mark.usefixtures("undrawn", "quick_plans")


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    """A plan with a bar, as `truearm plan` writes it."""
    path = tmp_path_factory.mktemp("plan") / "plan.csv"
    arm = load_arm("gao2017")
    poses = bar_places(arm, 2, length_mm=300, poses=3, seed=0)
    write_template(arm, poses, path)
    write_bar_lengths(poses, path.with_name("plan-lengths.csv"))
    return path


def test_a_plan_is_carried_out_with_its_names_and_the_length_of_the_bar(truearm, refused, plan, tmp_path):
    out = tmp_path / "measured.csv"
    ran = truearm("simulate", "gao2017", "--plan", plan, "--preset", "shop", "--out", out).done()
    lines = ran.out.splitlines()
    assert lines[0] == "12 readings of virtual arm gao2017, preset shop, arm seed 0."
    assert lines[-2:] == [f"session written to {out}", f"lengths written to {tmp_path / 'measured-lengths.csv'}"]
    session, lengths = read_session(out), read_lengths(tmp_path / "measured-lengths.csv")
    assert session.seat.tolist() == [name for name in ("B1a", "B1b", "B2a", "B2b") for _ in range(3)]
    assert session.position.tolist() == ["B1"] * 6 + ["B2"] * 6
    assert session.points is None
    assert lengths.length_mm.tolist() == [300.0, 300.0]
    # Its template is refused before it is filled in; the rehearsal is a session.
    assert truearm("fit", plan, "--arm", "gao2017", "--out", tmp_path / "m.truearm").code == 2
    again = ("simulate", "gao2017", "--plan", plan, "--preset", "shop", "--seed", 1, "--out", out)
    refused(again, "measured.csv: the file exists already. Try: another name, or --force")
    assert truearm(*again, "--force").code == 0
    assert np.abs(read_session(out).angles - session.angles).max() > 0  # another day, other noise


def test_a_bar_without_its_length_and_a_file_that_nobody_named_are_refused(refused, plan, tmp_path):
    alone = tmp_path / "plan.csv"
    alone.write_bytes(plan.read_bytes())
    refused(
        ["simulate", "gao2017", "--plan", alone, "--out", tmp_path / "session.csv"],
        "plan-lengths.csv is missing beside the plan",
    )
    kept = tmp_path / "session-lengths.csv"
    kept.write_text("mine", encoding="utf-8")
    refused(
        ["simulate", "gao2017", "--plan", plan, "--out", tmp_path / "session.csv"],
        "session-lengths.csv: the file exists already",
    )
    assert kept.read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "session.csv").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--poses", 20], "--poses does not apply to --plan"),
        (["--strategy", "box"], "--strategy does not apply to --plan"),
        (
            ["--poses", 20, "--strategy", "box"],
            "--poses and --strategy do not apply to --plan: the plan states them. Try: omit them\n",
        ),
        (["--moved"], "this plan is measured in seats"),
        (["--artefacts", "none.toml"], "unknown column 'q1_deg'"),
    ],
)
def test_options_that_a_plan_states_itself_are_refused(refused, plan, tmp_path, options, says):
    refused(["simulate", "gao2017", "--plan", plan, *options, "--out", tmp_path / "s.csv"], says)
    assert not list(tmp_path.iterdir())


def test_options_of_a_plan_need_a_plan(truearm, tmp_path):
    ran = truearm("simulate", "gao2017", "--moved", "--out", tmp_path / "s.csv")
    assert (ran.code, ran.err.split(".")[0]) == (2, "truearm: --moved applies to --plan only")


def test_no_file_of_the_plan_is_overwritten(truearm, plan):
    before = plan.read_bytes()
    for out in (plan, plan.with_name("plan-lengths.csv")):
        assert truearm("simulate", "gao2017", "--plan", plan, "--out", out).code == 2
    assert plan.read_bytes() == before


def test_the_points_of_a_sheet_are_filled_in_by_a_model(truearm, refused, made, tmp_path):
    """The coordinates are those of `predict --out`."""
    sheet, points, angles = (tmp_path / name for name in ("sheet.html", "points.csv", "angles.csv"))
    ran = truearm("verify", "sheet", "asme-b89.4.22", "--page", sheet, "--out", points, "--tip-diameter", 3).done()
    assert ran.out.splitlines()[-1] == f"points to measure written to {points}"
    with points.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 97
    # The readings below are anywhere: no planned points to compare them with.
    with points.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row, "note_x_mm": ""} for row in rows)
    model = made / "kinematic.truearm"
    arguments = ["simulate", "gao2017", "--poses", 97, "--seed", 9, "--no-reference", "--out", angles]
    assert truearm(*arguments).code == 0
    into = ["--into", points, "--date", "2026-10-20", "--artefact-temperature", 20.5]
    assert truearm("verify", "fill", model, angles, *into).done().out.splitlines()[-1] == f"points written to {points}"
    assert truearm("predict", model, angles, "--out", tmp_path / "table.csv").code == 0
    with points.open(encoding="utf-8", newline="") as file:
        filled = list(csv.DictReader(file))
    with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert [[row[f"{axis}_mm"] for axis in "xyz"] for row in filled] == [
        [row[f"{axis}_mm"] for axis in "xyz"] for row in table
    ]
    assert {row["date"] for row in filled} == {"2026-10-20"}
    assert {row["model"] for row in filled} == {"kinematic.truearm (kinematic)"}
    assert [row["outside_training"] for row in filled] == [row["outside_training"] for row in table]
    refused(["verify", "fill", model, angles, *into], "have coordinates already")
    # By the way of a table the points would pass for those of the arm's software.
    refused(
        ["import", tmp_path / "table.csv", "--point", "x_mm,y_mm,z_mm", "--into", points],
        "computed by a model of truearm. Try: truearm verify fill",
    )
    refused(["verify", "sheet", "asme-b89.4.22", "--page", sheet, "--out", points], "the file exists already")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "Missing option '--out'. Try"),
        (["--out", "a.csv", "--into", "b.csv"], "--into is a command now. Try: truearm verify fill"),
        (["--out", "a.csv", "--date", "2026-10-20"], "No such option"),
    ],
)
def test_predict_writes_a_table_and_says_what_fills_in_points(refused, made, options, says):
    refused(["predict", made / "kinematic.truearm", made / "session.csv", *options], says)


@pytest.fixture(scope="module")
def points_to_measure(truearm, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sheet")
    sheet = ("sheet", "asme-b89.4.22", "--page", folder / "sheet.html")
    assert truearm("verify", *sheet, "--out", folder / "points.csv", "--tip-diameter", 0).code == 0
    return (folder / "points.csv").read_bytes()


@pytest.fixture
def form(points_to_measure, tmp_path):
    """Points to measure, and the export of a metrology program that took them 0.1 mm beside their planned places."""
    points, export = tmp_path / "points.csv", tmp_path / "export.txt"
    points.write_bytes(points_to_measure)
    with points.open(encoding="utf-8", newline="") as file:
        planned = np.array([[float(row[f"note_{axis}_mm"]) for axis in "xyz"] for row in csv.DictReader(file)])
    taken = planned + 0.1 * np.random.default_rng(0).standard_normal(planned.shape)
    lines = [f"  P{i}  " + "   ".join(f"{v:.6f}".replace(".", ",") for v in row) for i, row in enumerate(taken / 25.4)]
    export.write_text("\n".join(["Messprotokoll", "Gr\u00f6\u00dfe in Zoll", *lines]), encoding="cp1252")
    return points, export, taken


FORMAT = ("--point", "2,3,4", "--point-unit", "in", "--separator", "SPACE", "--decimal", ",", "--no-header")
EXPORT = (*FORMAT, "--skip-lines", 2, "--encoding", "cp1252")


def test_the_points_of_a_metrology_program_are_filled_in(truearm, refused, form):
    points, export, taken = form
    into = ("--into", points, "--date", "2026-10-20", "--artefact-temperature", 20.5, "--serial-number", "A-17")
    ran = truearm("import", export, *EXPORT, *into).done()
    assert ran.out.splitlines()[0] == f"{points}: 97 points from export.txt"
    with points.open(encoding="utf-8", newline="") as file:
        filled = list(csv.DictReader(file))
    # Six decimals of an inch.
    np.testing.assert_allclose([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in filled], taken, atol=2e-5)
    assert {(row["date"], row["serial_number"]) for row in filled} == {("2026-10-20", "A-17")}
    assert {row["coordinates_from"] for row in filled} == {"arm software"}
    refused(["import", export, *EXPORT, *into], "have coordinates already")


@pytest.mark.parametrize(
    ("change", "options", "says"),
    [
        (lambda lines: lines[:-1], (), "points.csv"),  # one is missing
        (lambda lines: [*lines[:2], *lines[:1:-1]], (), "points.csv"),  # in another order
        (lambda lines: [*lines[:5], "  P9  left  1,0  1,0", *lines[6:]], (), "line 6"),
        (lambda lines: lines, ("--out", "s.csv"), "--out does not apply to --into"),
        (lambda lines: lines, ("--angles", "1"), "--angles does not apply to --into"),
        (lambda lines: lines, ("--point", "2,3"), "expected three columns of points, got 2"),
        (lambda lines: lines, ("--point-unit", "ft"), "'ft' is not one of 'mm'"),
    ],
)
def test_an_export_that_does_not_fit_fills_in_nothing(refused, form, change, options, says):
    points, export, _ = form
    lines = export.read_text(encoding="cp1252").splitlines()
    export.write_text("\n".join(change(lines)), encoding="cp1252")
    before = points.read_bytes()
    refused(["import", export, *EXPORT, "--into", points, "--artefact-temperature", 20, *options], says)
    assert points.read_bytes() == before


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "expected --out, --preview or --into"),
        (["--out", "s.csv", "--by", "name"], "--by joins two tables. Try: name the second one: --with TABLE"),
        (
            ["--out", "s.csv", "--date", "2026-10-20"],
            "truearm: --date applies to --into only. Try: omit it, or use --into\n",
        ),
        (
            ["--out", "s.csv", "--date", "2026-10-20", "--artefact-temperature", 20],
            "--date and --artefact-temperature apply to --into only. Try: omit them, or use --into\n",
        ),
    ],
)
def test_import_writes_a_session_file_or_fills_in_points(refused, form, options, says):
    refused(["import", form[1], *options], says)
