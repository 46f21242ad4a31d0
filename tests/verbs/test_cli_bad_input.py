"""Bad input through the command line: exit code 2, one message on standard error, and not a file more than before."""

import os
import re
import zipfile

import pytest

from truearm.readings import read_session, write_session

pytestmark = pytest.mark.usefixtures("undrawn")

N_ROWS = 40


@pytest.fixture(autouse=True)
def bench(made, tmp_path, monkeypatch):
    """A folder of one's own, where the test works, with a good session of 40 readings and good models."""
    monkeypatch.chdir(tmp_path)
    write_session(read_session(made / "session.csv").rows(slice(0, N_ROWS)), tmp_path / "s.csv")
    for name in ("kinematic.truearm", "network.truearm", "angles.csv", "wam.csv"):
        (tmp_path / name).write_bytes((made / name).read_bytes())
    return tmp_path


FIT = ("fit", "s.csv", "--arm", "gao2017", "--model", "kinematic", "--out", "m.truearm")
EVALUATE = ("evaluate", "kinematic.truearm", "s.csv")
PREDICT = ("predict", "kinematic.truearm", "s.csv", "--out", "p.csv")
REPORT = ("report", "kinematic.truearm", "s.csv", "--page", "r.html")


def changed(row, column, value):
    """A session with one cell changed; `row` 0 is the header, line 1 of the file."""

    def change(rows):
        rows[row][rows[0].index(column)] = value

    return change


def without(column):
    def change(rows):
        i = rows[0].index(column)
        for row in rows:
            del row[i]

    return change


def all_rows_as_first(*columns):
    def change(rows):
        for column in columns or rows[0]:
            i = rows[0].index(column)
            for row in rows[2:]:
                row[i] = rows[1][i]

    return change


def first_three(rows):
    del rows[4:]


JOINTS = [f"q{i}_deg" for i in range(1, 7)]

# What is wrong with the file -> (change, what every message about it must hold, whether a prediction minds it)
FILES = {
    "missing angle": (without("q3_deg"), ["s.csv, line 1", "q3"], True),
    "missing coordinate": (without("z_mm"), ["s.csv, line 1", "z_mm"], True),
    "unknown unit": (changed(0, "q2_deg", "q2_grad"), ["s.csv, line 1, column 'q2_grad'", "Try: "], True),
    "unknown unit of points": (changed(0, "x_mm", "x_inch"), ["s.csv, line 1, column 'x_inch'", "Try: "], True),
    "no unit": (changed(0, "q2_deg", "q2"), ["s.csv, line 1, column 'q2'", "q2_deg"], True),
    "text": (changed(4, "q2_deg", "twelve"), ["s.csv, line 5, column 'q2_deg'", "a number, got 'twelve'"], True),
    "NaN": (changed(7, "y_mm", "nan"), ["s.csv, line 8, column 'y_mm'", "finite number, got 'nan'", "Try: "], True),
    "infinite": (changed(7, "q1_deg", "inf"), ["s.csv, line 8, column 'q1_deg'", "got 'inf'"], True),
    "empty cell": (changed(9, "x_mm", ""), ["s.csv, line 10, column 'x_mm'", "empty cell", "Try: "], True),
    "decimal comma": (changed(3, "x_mm", '"1,5"'), ["s.csv, line 4, column 'x_mm'", "decimal '.'", "points"], True),
    "row too long": (lambda rows: rows[5].append("1"), ["s.csv, line 6", "20 values", "got 21"], True),
    "constant rows": (all_rows_as_first(), ["s.csv", "at least 4 poses, got 1 pose", "Try: "], False),
    "constant joint": (all_rows_as_first("q4_deg"), ["s.csv", "J4 did not move by the readings", "--accept"], False),
    "constant reference": (all_rows_as_first("x_mm", "y_mm", "z_mm"), ["s.csv", "same reference point"], False),
    "point far off": (changed(11, "x_mm", "1e200"), ["s.csv, line 12", "1e+200 mm", "Try: "], False),
    "angle far off": (
        changed(11, "q6_deg", "1e300"),
        ["s.csv, line 12, column 'q6_deg'", "which no joint reaches"],
        True,
    ),
    "too few poses": (first_three, ["s.csv", "at least 4 readings, got 3", "Try: "], False),
    "no readings": (lambda rows: rows.__delitem__(slice(1, None)), ["s.csv, line 1", "got none"], True),
}


def spoil(path, change):
    rows = [line.split(",") for line in path.read_text().splitlines()]
    change(rows)
    path.write_text("".join(",".join(row) + "\n" for row in rows))


@pytest.mark.parametrize("fault", FILES)
def test_a_faulty_session_is_refused_with_file_line_and_column(refused, bench, fault):
    change, phrases, always = FILES[fault]
    spoil(bench / "s.csv", change)
    for verb in (FIT, EVALUATE, PREDICT, REPORT) if always else (FIT,):
        refused(verb, *phrases)


def test_text_that_is_not_utf_8(refused, bench):
    text = (bench / "s.csv").read_text().splitlines()
    lines = [line + (",note" if i == 0 else ",k\u00fchl" if i == 6 else ",") for i, line in enumerate(text)]
    (bench / "s.csv").write_text("\n".join(lines), encoding="latin-1")
    for verb in (FIT, PREDICT):
        refused(verb, "s.csv, line 7", "utf-8", "Try: save it as 'CSV UTF-8'")


@pytest.mark.parametrize(
    ("content", "phrase"),
    [(b"", "an empty file"), (b"\x00\x01\x02" * 99, "binary file"), (b"PK\x03\x04" + bytes(99), "spreadsheet or zip")],
)
def test_a_file_that_is_no_table(refused, bench, content, phrase):
    (bench / "s.csv").write_bytes(content)
    refused(FIT, "s.csv", phrase)


def test_a_workbook_is_no_model_and_a_table_no_damaged_one(refused, bench):
    with zipfile.ZipFile(bench / "s.csv", "w") as workbook:
        workbook.writestr("[Content_Types].xml", "<Types/>")
    refused(PREDICT, "s.csv", "expected text (CSV), got a spreadsheet or zip", "truearm import TABLE --out session.csv")
    refused([*PREDICT[:1], "s.csv", *PREDICT[2:]], "s.csv", "got a zip archive without model.json", "Try: give a file")
    refused(("compare", "kinematic.truearm", "angles.csv"), "angles.csv: expected a model file, got another kind of")
    whole = (bench / "kinematic.truearm").read_bytes()
    (bench / "cut.truearm").write_bytes(whole[:1000])
    refused(("compare", "kinematic.truearm", "cut.truearm"), "cut.truearm", "got a damaged one", "Try: write it again")


def test_a_missing_file_and_a_folder(refused, bench):
    (bench / "folder.csv").mkdir()
    for name, phrase in (("none.csv", "does not exist"), ("folder.csv", "got a folder")):
        for verb in (FIT, EVALUATE, PREDICT, REPORT, ("split", "s.csv", "--train", "a.csv", "--test", "b.csv")):
            refused([name if a == "s.csv" else a for a in verb], name, phrase)


def test_a_session_mostly_outside_the_limits(refused, bench):
    """gao2017 turns without end, a UR5 does not."""
    for line in range(1, 30):
        spoil(bench / "s.csv", changed(line, "q3_deg", f"{400 + line}"))
    said = refused([*FIT[:3], "ur5", *FIT[4:]], "s.csv, line 2, column 'q3_deg'", "at 401 deg, outside its limits")
    assert "29 of 40 readings" in said
    assert "Try: check the unit, sign and zero" in said


def test_a_few_readings_beyond_a_joint_limit_are_named_and_skipped_or_used(truearm, bench):
    assert truearm("simulate", "ur5", "--poses", 40, "--out", "u.csv").code == 0
    spoil(bench / "u.csv", changed(6, "q3_deg", "400"))
    told = "1 of 40 readings is beyond a joint limit and was skipped: line 7."
    fitted = ["fit", "u.csv", "--arm", "ur5", "--model", "nominal", "--out", "m.truearm"]
    ran = truearm(*fitted)
    assert (ran.code, told in ran.out, "39 readings" in ran.out) == (0, True, True)
    for verb in (("evaluate", "m.truearm", "u.csv"), ("report", "m.truearm", "u.csv", "--page", "u.html")):
        ran = truearm(*verb)
        assert (told in ran.out, "39 readings" in ran.out) == (True, True)
    ran = truearm(*fitted, "--limits", "ignore")
    assert (ran.code, "beyond" in ran.out, "40 readings" in ran.out) == (0, False, True)
    ran = truearm("predict", "m.truearm", "u.csv", "--out", "p.csv")
    assert "1 of 40 readings is beyond a joint limit: line 7." in ran.out
    assert len((bench / "p.csv").read_text().splitlines()) == 41


def test_a_wrong_number_of_joints(refused):
    refused([*FIT[:3], "wam", *FIT[4:]], "s.csv, line 1", "expected 7 joints, got 6", "Try: ")
    refused(["fit", "wam.csv", *FIT[2:]], "wam.csv, line 1", "expected 6 joints, got 7", "Try: ")
    for verb in (EVALUATE, PREDICT, REPORT):
        refused(["wam.csv" if a == "s.csv" else a for a in verb], "wam.csv", "expected 6 joints, got 7")


def test_readings_of_another_arm_or_with_a_wrong_unit(refused, bench):
    refused([*FIT[:3], "ur5", *FIT[4:]], "s.csv", "nominal arm 'ur5' misses", "of another arm", "check the arm")
    spoil(
        bench / "s.csv",
        lambda rows: rows.__setitem__(0, [n.replace("_deg", "_rad") if n in JOINTS else n for n in rows[0]]),
    )
    refused(FIT, "s.csv", "misses its references", "units")


def test_readings_in_a_frame_of_their_own_with_free_none(refused, bench):
    rows = [line.split(",") for line in (bench / "s.csv").read_text().splitlines()]
    i = rows[0].index("x_mm")
    for row in rows[1:]:
        row[i] = str(float(row[i]) + 5000)
    (bench / "s.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    refused([*FIT, "--free", "none"], "s.csv", "misses its references by 500", "--free")


@pytest.mark.parametrize("verb", [("fit", *FIT[1:]), EVALUATE, REPORT])
def test_a_session_without_reference_points(refused, verb):
    refused(
        ["angles.csv" if a == "s.csv" else a for a in verb],
        "angles.csv",
        "no reference" if verb[0] == "fit" else "reference points",
    )


# Arms and models -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "close"), [("ur11", "ur10"), ("Gao2016", "gao2017"), ("pandas", "panda")])
def test_an_unknown_arm_with_a_close_name(refused, name, close):
    for verb in ([*FIT[:3], name, *FIT[4:]], ["simulate", name, "--out", "x.csv"], ["arms", name]):
        refused(verb, f"no arm {name!r}", f"Try: {close}", "truearm arms lists all")


def test_an_arm_file_that_is_missing_or_none(refused, bench):
    refused([*FIT[:3], "mine.toml", *FIT[4:]], "mine.toml", "does not exist")
    (bench / "mine.toml").write_text("name = 3\nthis is not TOML\n")
    refused([*FIT[:3], "mine.toml", *FIT[4:]], "mine.toml, line 2")
    (bench / "mine.urdf").write_text("<robot")
    refused([*FIT[:3], "mine.urdf", *FIT[4:]], "mine.urdf")


def test_a_model_file_that_is_none(refused, bench):
    (bench / "folder").mkdir()
    (bench / "cut.truearm").write_bytes((bench / "kinematic.truearm").read_bytes()[:5000])
    with zipfile.ZipFile(bench / "other.zip", "w") as archive:
        archive.writestr("a.txt", "a")
    for name in ("s.csv", "cut.truearm", "other.zip", "folder", "none.truearm"):
        for verb in (EVALUATE, PREDICT, REPORT):
            refused([name if a == "kinematic.truearm" else a for a in verb], name)
    hint = "Try: write it again: truearm fit"
    refused(["evaluate", "cut.truearm", "s.csv"], "cut.truearm", "expected a model file", hint)
    refused(["evaluate", "none.truearm", "s.csv"], "none.truearm", "does not exist", hint)


def test_model_and_session_the_other_way_round(refused):
    for verb in (("evaluate",), ("predict", "--out", "p.csv"), ("report", "--page", "r.html")):
        refused([*verb, "s.csv", "kinematic.truearm"], "kinematic.truearm: expected a session file", "the model first")


def test_models_of_different_arms_in_one_report(refused, truearm, bench):
    arguments = ["fit", "wam.csv", "--arm", "wam", "--model", "nominal", "--out", "wam.truearm"]
    assert truearm(*arguments).code == 0
    refused(["report", "kinematic.truearm", "wam.truearm", "s.csv", "--page", "r.html"], "models of one arm, but 'wam'")
    refused(["report", "kinematic.truearm", "kinematic.truearm", "--page", "r.html"], "a session file after the model")
    refused(["report", "s.csv", "--page", "r.html"], "one or more model files, then a session file", "Try: ")


# Where results go ----------------------------------------------------------------------------------------------------

WRITERS = {
    "fit": (FIT, "m.truearm"),
    "predict": (PREDICT, "p.csv"),
    "report": (REPORT, "r.html"),
    "simulate": (("simulate", "gao2017", "--poses", "10", "--out", "x.csv"), "x.csv"),
    "import": (("import", "s.csv", "--angles", "1,2", "--angle-unit", "deg", "--out", "x.csv"), "x.csv"),
    "split": (("split", "s.csv", "--by", "row", "--train", "a.csv", "--test", "x.csv"), "x.csv"),
    "split, first": (("split", "s.csv", "--by", "row", "--train", "x.csv", "--test", "b.csv"), "x.csv"),
    "arms": (("arms", "gao2017", "--out", "x.toml"), "x.toml"),
    "fetch": (("fetch", "ur10-a", "--out", "x.csv"), "x.csv"),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_place_where_nothing_can_be_written(refused, bench, writer):
    verb, out = WRITERS[writer]
    suffix = out.rpartition(".")[2]
    (bench / f"folder.{suffix}").mkdir()
    os.mkfifo(bench / f"pipe.{suffix}")
    (bench / "file").write_text("")
    for name, phrase in {
        f"nowhere/x.{suffix}": "Try: mkdir -p nowhere",
        f"folder.{suffix}": "got a folder",
        f"pipe.{suffix}": "got a device or a pipe",
        f"file/x.{suffix}": "file is a file, not a folder",
    }.items():
        refused([name if a == out else a for a in verb], name, phrase)


@pytest.mark.parametrize("writer", ["predict", "report", "simulate", "import", "split", "arms"])
def test_a_name_that_promises_another_kind_of_file(refused, writer):
    verb, out = WRITERS[writer]
    refused(["x.pdf" if a == out else a for a in verb], "x.pdf", "ends in .")


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="a superuser may write anywhere")
def test_no_permission(refused, bench):
    (bench / "locked").mkdir(mode=0o500)
    (bench / "x.csv").write_text("precious")
    (bench / "x.csv").chmod(0o400)
    refused(["simulate", "gao2017", "--out", "locked/x.csv"], "no permission to write")
    refused(["simulate", "gao2017", "--out", "x.csv"], "protected against writing")


def test_the_demo_looks_before_it_works(refused, bench):
    refused(["demo", "--out", "s.csv"], "expected a folder to write to, got a file")
    refused(["demo", "--out", "s.csv/deep/er"], "s.csv is a file, not a folder")
    (bench / "demo" / "report.html").mkdir(parents=True)
    refused(["demo", "--out", "demo"], "report.html", "got a folder")


@pytest.mark.parametrize("writer", ["fit", "predict", "simulate", "report", "split"])
@pytest.mark.usefixtures("undrawn")
def test_a_full_disk_leaves_what_was_there(refused, bench, truearm, writer):
    """A limit on the size of files stands for a full disk: a write fails in the middle."""
    resource = pytest.importorskip("resource", reason="limits of a process are those of POSIX")
    import matplotlib.font_manager  # noqa: F401  its cache of fonts is written before

    verb, _ = WRITERS[writer]
    assert truearm(*verb).code == 0
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        said = refused((*verb, "--force") if writer in ("simulate", "split") else verb)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert re.fullmatch(r"truearm: \S+: the file cannot be written \(.+\)\n", said)


def test_too_little_memory(refused, monkeypatch):
    from truearm.readings import files

    def none_left(*arguments, **options):
        raise MemoryError

    monkeypatch.setattr(files, "read_form", none_left)
    refused(FIT, "not enough memory", "Try: ")


# Options -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "phrases"),
    [
        (["fits"], ["No such command 'fits'", "'fit'", "Try: truearm --help"]),
        (["fit"], ["Missing", "Try: truearm fit --help"]),
        (FIT[:-2], ["--out", "Try: truearm fit --help"]),
        ([*FIT, "--model", "cubic"], ["--model", "'cubic'", "kinematic"]),
        ([*FIT, "--modell", "nominal"], ["--modell", "--model"]),
        ([*FIT, "more"], ["unexpected", "more"]),
        ([*FIT, "--free", "elbow"], ["--free expects base, tip", "'elbow'", "Try: --free base,tip"]),
        ([*FIT, "--free", ""], ["--free expects base, tip"]),
        ([*FIT, "--model", "network", "--hidden", "30;30"], ["--hidden expects", "'30;30'", "Try: --hidden 30,30"]),
        ([*FIT, "--model", "network", "--hidden", "0"], ["--hidden expects", "'0'"]),
        ([*FIT, "--model", "network", "--hidden", "-3"], ["--hidden expects", "'-3'"]),
        (
            [*FIT, "--model", "network", "--validation", "0"],
            ["s.csv", "40 readings give 120 coordinates for 1233 weights", "kinematic"],
        ),
        (
            [*FIT, "--model", "kinematic", "--hidden", "20"],
            ["--hidden applies to network and hybrid models only, got --model kinematic. Try: omit it, or use --model"],
        ),
        (
            [*FIT, "--model", "hybrid", "--goal", "1", "--restarts", "2"],
            ["--goal and --restarts apply to network models only, got --model hybrid. Try: omit them, or use --model"],
        ),
        ([*FIT, "--seed", "4"], ["--seed", "network and hybrid", "--model kinematic"]),
        ([*FIT, "--model", "hybrid", "--trainer", "trainlm"], ["--trainer", "network", "--model hybrid"]),
        (
            [*FIT, "--model", "network", "--no-residual-process"],
            ["--no-residual-process applies to auto and physical models only"],
        ),
        (
            [*FIT, "--model", "hybrid", "--members", "1"],
            ["expected --members of 2 or more", "got 1", "Try: --members 5"],
        ),
        ([*FIT, "--epochs", "0"], ["--epochs"]),
        ([*FIT, "--members", "0"], ["--members"]),
        ([*FIT, "--restarts", "-2"], ["--restarts"]),
        ([*FIT, "--goal", "-1"], ["--goal"]),
        ([*FIT, "--trainer", "adam"], ["--trainer", "'adam'", "traingdx"]),
        ([*FIT, "--validation", "15"], ["--validation"]),
        ([*FIT, "--model", "network", "--hidden", "3", "--validation", "1"], ["validation", "below 1, got 1.0"]),
        ([*FIT, "--model", "network", "--hidden", "3", "--goal", "nan"], ["goal"]),
        ([*FIT, "--seed", "-1"], ["--seed"]),
        ([*FIT, "--seed", "one"], ["--seed", "integer"]),
        (["simulate", "gao2017", "--out", "x.csv", "--strategy", "boxes"], ["'boxes'", "Try: strategy box"]),
        (["simulate", "gao2017", "--out", "x.csv", "--preset", "shed"], ["preset", "'shed'", "research"]),
        (["simulate", "gao2017", "--out", "x.csv", "--poses", "0"], ["got 0"]),
        (["simulate", "gao2017", "--out", "x.csv", "--poses", "99999999999999999999"], ["--poses", "10000000"]),
        (["simulate", "gao2017", "--out", "x.csv", "--half-width-deg", "nan"], ["half-width", "nan"]),
        (["simulate", "gao2017", "--out", "x.csv", "--seats", "2"], ["seats are for the strategy seat"]),
        (["split", "s.csv", "--train", "a.csv", "--test", "b.csv"], ["no column 'position'", "Try: by row"]),
        (["split", "s.csv", "--train", "a.csv", "--test", "b.csv", "--by", "mood"], ["'mood'", "position, seat"]),
        (["split", "s.csv", "--train", "a.csv", "--test", "./a.csv"], ["the same file"]),
        (["split", "s.csv", "--train", "a.csv", "--test", "b.csv", "--by", "row", "--hold-out", "30"], ["0 and 1"]),
        (
            ["import", "s.csv", "--angles", "nine", "--angle-unit", "deg", "--out", "x.csv"],
            ["no column 'nine'", "line 1"],
        ),
        (["import", "s.csv", "--angles", "1,2", "--angle-unit", "grad", "--out", "x.csv"], ["unknown unit", "'grad'"]),
        (["import", "s.csv", "--angles", "1,2", "--angle-unit", "deg", "--zero", "0,nan", "--out", "x.csv"], ["nan"]),
        (["import", "s.csv", "--angles", "1,1", "--angle-unit", "deg", "--out", "x.csv"], ["used for two things"]),
        (["fetch", "ur10"], ["no data set 'ur10'", "ur10-a"]),
        (["arms", "--out", "x.toml"], ["--out needs the name of an arm", "Try: truearm arms gao2017"]),
        (["arms", "--search", "xyzzy"], ["no arm of the catalogue matches 'xyzzy'", "KUKA"]),
        (["arms", "ur5", "--search", "ur"], ["--search needs no name of an arm"]),
        (["demo", "--seed", "x"], ["--seed", "integer", "Try: truearm demo --help"]),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, list | tuple) else None,
)
def test_wrong_options(refused, arguments, phrases):
    refused(arguments, *phrases)


def test_an_option_that_is_missing_names_itself(refused):
    for option, phrase in (("--arm", "needs the nominal arm. Try: --arm ARM"), ("--out", "Missing option '--out'")):
        i = FIT.index(option)
        refused([*FIT[:i], *FIT[i + 2 :]], phrase)


@pytest.mark.parametrize("kind", [RuntimeError, ValueError, KeyError, AssertionError, RecursionError])
def test_a_fault_of_the_program_is_no_verdict_and_no_wrong_input(truearm, monkeypatch, kind):
    def breaks():
        raise kind("boom")

    monkeypatch.setattr("truearm.wings.reports.commands.arms", breaks)
    ran = truearm("arms")
    assert (ran.code, ran.out) == (70, "")
    assert "Traceback" in ran.err
    assert "boom" in ran.err
    assert ran.err.splitlines()[-1].startswith("truearm: this is a fault of the program")
