"""``truearm check``: five minutes a day on a made-up arm whose elbow begins to creep."""

import datetime
import hashlib
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_check import ARM, LENGTHS, session, virtual, write_days, write_model

from page_transcripts import block, blocks
from truearm.models import KinematicModel
from truearm.models.model_file import load_model
from truearm.models.training_conditions import fingerprint
from truearm.readings import Session, read_lengths, read_session, write_session
from truearm.wings.laboratory.monitor import history
from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice, assess
from truearm.wings.laboratory.monitor.history import History
from truearm.wings.laboratory.monitor.interim_check import InterimCheck, interim_values
from truearm.wings.laboratory.tasks.model_check import readings_to_compare

pytestmark = pytest.mark.usefixtures("undrawn")

TYPED = (1, 10, 11, 18, 26)
STEADY = 14  # days before it creeps by half a second of arc a day
CREEP = [0.0] * STEADY + [0.5 * day for day in range(1, 13)]

MPE = """\
name = "measuring arm 2.5 m"
source = "its data sheet"
measuring_range_mm = 2500

[limits]
"SPAT.2s" = { B_um = 80 }
"SPAT.Max" = { B_um = 50 }
"E_Uni" = { A_um = 20, K_mm_per_um = 50 }
"""


def arguments(day, *more):
    return [
        *("check", "arm.truearm", f"day{day:02}.csv", "--lengths", "bar.csv", "--history", "arm.sqlite"),
        *("--date", f"2026-01-{day:02}", *more),
    ]


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with the model, the bar's length and a session of every day."""
    folder = tmp_path_factory.mktemp("checks")
    write_model(folder)
    write_days(folder, CREEP)
    (folder / "bar.csv").write_text(LENGTHS)
    (folder / "mpe.toml").write_text(MPE)
    return folder


@pytest.fixture(scope="module")
def course(bench, truearm):
    """What is printed on the days of `TYPED`, and the history of all of them; on other days it grows from Python."""
    runs, model = {}, load_model(bench / "arm.truearm")
    whose = hashlib.sha256((bench / "arm.truearm").read_bytes()).hexdigest()
    history, lengths = History(bench / "arm.sqlite"), read_lengths(bench / "bar.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(bench)
        for day in range(1, len(CREEP) + 1):
            if day in TYPED:
                runs[day] = truearm(*arguments(day, *(("--page", "arm.html") if day == len(CREEP) else ())))
                continue
            readings = read_session(f"day{day:02}.csv")
            unexplained = model.covariance_parts(readings)[1]
            points = model.predict_readings(readings)
            values = interim_values(
                points,
                std_mm=np.sqrt(np.trace(unexplained, axis1=1, axis2=2) / 3),
                seat=readings.seat,
                sphere=readings.sphere,
                lengths=lengths,
                temperature_degC=float(readings.temperature_degC.mean()),
            )
            when = datetime.datetime(2026, 1, day)
            compared = readings_to_compare(model, points, readings)
            assert history.append(
                InterimCheck(when, whose, fingerprint(readings), readings.temperature_degC.mean(), values, compared)
            )
    return runs


@pytest.fixture
def folder(bench, course, tmp_path, monkeypatch):
    """A copy of all files, with the whole history, to do with as one likes."""
    for file in bench.iterdir():
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


# From the first day to the answer ------------------------------------------------------------------------------------


def test_an_unchanged_arm_needs_no_recalibration_after_ten_checks(course):
    assert [course[day].code for day in TYPED] == [3, 3, 0, 0, 1]
    assert course[10].out.startswith("Not enough checks yet: 10 with this one, 11 are needed")
    for day in (11, 18):
        assert course[day].out.startswith("No need to recalibrate: ")
    assert all(not ran.err for ran in course.values())


def test_a_drift_is_detected_and_dated(course, bench):
    """Five seconds of arc at the elbow move the tip by 12 um: a check a day sees them, and tells since when."""
    whose = hashlib.sha256((bench / "arm.truearm").read_bytes()).hexdigest()
    checks = History(bench / "arm.sqlite").checks(whose)
    assert len(checks) == len(CREEP)
    answers = [assess(checks[:n]).recalibrate for n in range(11, len(checks) + 1)]
    seen = 11 + answers.index(RecalibrationAdvice.YES)
    assert STEADY < seen <= STEADY + 11  # limits that hold for correlated checks too see a creep later
    assert set(answers[seen - 11 :]) == {RecalibrationAdvice.YES}
    since = re.search(r"Recalibrate: a value has changed since check (\d+) of 2026-01-(\d+)", course[len(CREEP)].out)
    assert since[1] == since[2]
    assert abs(int(since[1]) - (STEADY + 1)) <= 2
    assert "length bar A to bar B, length error: drift since about check" in course[len(CREEP)].out


def test_every_value_of_the_check_is_printed(course):
    for label in (
        *(f"seat {seat}, SPAT.{which}" for seat in ("cone", "bar A", "bar B") for which in ("2s", "Max")),
        "length bar A to bar B, length error",
        "sphere ball, form",
        "sphere ball, diameter",
    ):
        assert label in course[1].out


def test_a_session_of_the_history_is_recognised(truearm, folder):
    before = Path("arm.sqlite").read_bytes()
    ran = truearm(*arguments(26, "--json"))
    found = json.loads(ran.out)
    assert (ran.code, found["added"], found["n_checks"]) == (1, False, 26)
    assert found["recalibrate"] == "yes"
    assert found["since"]["date"] == f"2026-01-{found['since']['check']:02}"
    length = next(row for row in found["values"] if row["quantity"] == "length error")
    assert length["evidence"] > length["evidence_of_a_change"]
    assert length["changed_since_check"] is not None
    assert Path("arm.sqlite").read_bytes() == before
    said = "this session is check {0} of 2026-01-{0:02} in the history already, and is not added again"
    assert said.format(26) in truearm(*arguments(26)).out
    old = truearm(*arguments(11)).out  # a file of another day, by mistake
    assert said.format(11) in old
    assert "the results are those of the last check" in old


def test_an_earlier_session_in_another_order_is_no_new_check(truearm, folder):
    """The set of readings counts, not their order."""
    day = session(11)
    write_session(day.rows(np.random.default_rng(2).permutation(len(day))), "day27.csv")
    before = Path("arm.sqlite").read_bytes()
    assert "this session is check 11 of 2026-01-11 in the history already" in truearm(*arguments(27)).out
    assert Path("arm.sqlite").read_bytes() == before


def test_readings_that_a_bouncing_button_stored_again_are_named(truearm, folder):
    day = session(27)
    angles = day.angles.copy()
    angles[2:8] = angles[1]
    write_session(replace(day, angles=angles), "day27.csv")
    said = (
        "6 of 10 readings of seat cone have the joint angles of another of them to the last digit: they show no scatter"
    )
    out = truearm(*arguments(27)).out
    assert said in out
    # Servo counts of 0.088 deg, and robots, come back to the same angles without a copy.
    assert "digit: copies" not in out
    assert "Unless the encoders are as coarse, or a robot returned to its pose, they were stored twice" in out


def test_a_new_model_starts_a_new_baseline_and_names_the_checks_that_are_not_compared(truearm, folder):
    poses = virtual().measure(session(1).angles, seed=3).readings
    KinematicModel(virtual().nominal, free=()).fit_readings(poses).save("new.truearm")
    asked = ("check", "new.truearm", *arguments(26)[2:])
    ran = truearm(*asked, "--page", "new.html")
    said = re.search(
        r"\na new model: 26 checks of arm.truearm in this history, not compared; result of the last one, "
        r'2026-01-26: "Recalibrate: a value has changed since check (\d+) of 2026-01-\d\d\."\n',
        ran.out,
    )
    assert said
    assert ran.out.startswith("Not enough checks yet")
    assert ran.code == 3
    assert "A new model: 26 checks of arm.truearm in this history" in Path("new.html").read_text(encoding="utf-8")
    found = json.loads(truearm(*asked, "--json").out)
    assert (found["n_checks"], found["recalibrate"]) == (1, "not enough checks yet")
    (other,) = found["other_models"]
    assert {**other, "model": ""} == {
        "model": "",
        "name": "arm.truearm",
        "n_checks": 26,
        "last": "2026-01-26",
        "recalibrate": "yes",
    }
    # Back to the first one by mistake: its 27th check is not the one after its 26th.
    write_session(session(27), "day27.csv")
    assert "\n1 check of new.truearm in this history" in truearm(*arguments(27)).out
    write_session(session(28), "day28.csv")
    assert "new.truearm" not in truearm(*arguments(28)).out


def test_artefacts_retired_before_a_new_model_stay_retired(truearm, refused, folder):
    """Cone, bar and sphere were put away, two of them after a change; no check of the new model has them."""
    poses = virtual().measure(session(1).angles, seed=3).readings
    KinematicModel(virtual().nominal, free=()).fit_readings(poses).save("new.truearm")
    for day, model in ((27, "arm.truearm"), (28, "new.truearm")):
        write_session(session(day).rows(session(day).seat == "bar B"), f"part{day}.csv")
        asked = ("check", model, f"part{day}.csv", "--history", "arm.sqlite", "--date", f"2026-01-{day}")
        ran = truearm(*asked)
    assert '2026-01-27: "Recalibrate: a value has changed since check' in ran.out
    gone = ("--retired", "cone", "--retired", "bar A", "--retired", "ball", "--mpe", "mpe.toml")
    assert '2026-01-27: "No need to recalibrate' in truearm(*asked, *gone, "--page", "page.html").out
    assert re.search("2026-01-27: .{1,6}No need to recalibrate", Path("page.html").read_text(encoding="utf-8"))
    assert json.loads(truearm(*asked, *gone, "--json").out)["other_models"][0]["recalibrate"] == "no"
    Path("mpe.toml").write_text(MPE.replace("B_um = 80", "B_um = 1"), encoding="utf-8")
    assert '2026-01-27: "Recalibrate: a value exceeds' in truearm(*asked, *gone).out
    refused([*asked, "--retired", "nowhere"], "no check contains the retired artefact 'nowhere'")


def test_a_history_refuses_a_model_of_another_arm(refused, folder):
    arm = replace(virtual().nominal, name="another")
    poses = virtual().measure(session(1).angles, seed=3).readings
    KinematicModel(arm, free=()).fit_readings(poses).save("other.truearm")
    refused(
        ["check", "other.truearm", *arguments(26)[2:]],
        f"arm.sqlite: the checks in this history are of arm '{ARM}', the model is of arm 'another'",
    )


def test_one_check_beyond_the_limits_is_undecided(truearm, folder):
    """A blow that moves the elbow's zero by a minute of arc, after ten quiet checks."""
    Path("arm.sqlite").unlink()
    model, history = load_model("arm.truearm"), History("arm.sqlite")
    whose = hashlib.sha256(Path("arm.truearm").read_bytes()).hexdigest()
    for day in range(1, 11):
        readings = read_session(f"day{day:02}.csv")
        values = interim_values(
            model.predict_readings(readings), std_mm=np.full(len(readings), 0.01), seat=readings.seat
        )
        history.append(InterimCheck(datetime.datetime(2026, 1, day), whose, fingerprint(readings), 20.0, values))
    for day, code, end in (
        (
            11,
            3,
            (
                "Undecided: repeat the check before you recalibrate. "
                "Clean the artefacts first, and check that they are fixed."
            ),
        ),
        (12, 1, "Recalibrate: a value has changed since check 11 of 2026-01-11."),
    ):
        write_session(session(day, creep_arcsec=60.0), f"day{day}.csv")
        ran = truearm("check", "arm.truearm", f"day{day}.csv", "--history", "arm.sqlite", "--date", f"2026-01-{day}")
        assert (ran.code, ran.out.splitlines()[0]) == (code, end)
        assert ("in check 11 only" in ran.out) == (day == 11)
    page = ["--page", "page.html", "--json"]
    found = json.loads(truearm(*arguments(12)[:3], "--history", "arm.sqlite", *page).out)
    assert (found["recalibrate"], found["since"]["check"]) == ("yes", 11)


def test_limits_of_the_specification_apply_from_the_first_check_on(truearm, folder):
    Path("arm.sqlite").unlink()
    ran = truearm(*arguments(1, "--mpe", "mpe.toml"))
    assert ran.code == 3
    assert "0.0320" in ran.out  # 20 um + 600 mm / 50
    Path("mpe.toml").write_text(MPE.replace("B_um = 80", "B_um = 10"), encoding="utf-8")
    ran = truearm(*arguments(1, "--mpe", "mpe.toml"))
    assert ran.code == 3
    assert re.search(r"seat cone, SPAT.2s: 0.0\d+ mm exceeds the limit of 0.0100 mm in check 1 only\n", ran.out)
    assert "Undecided: repeat the check" in ran.out
    ran = truearm(*arguments(2, "--mpe", "mpe.toml"))
    assert ran.code == 1
    assert ran.out.startswith("Recalibrate: a value exceeds its limit in the specification")


def test_a_warm_bar_causes_no_recalibration(truearm, folder):
    """600 mm of steel, 5 K warmer than at its calibration, are 0.0345 mm longer; the limit is 0.032 mm."""
    today = session(1)
    warm = replace(today, temperature_degC=np.full(len(today), 25.0))
    write_session(warm, "warm.csv")
    known = read_lengths("bar.csv").length_mm[0]
    points = load_model("arm.truearm").predict_readings(read_session("warm.csv"))
    ends = [points[today.seat == end].mean(axis=0) for end in ("bar A", "bar B")]
    cold = np.linalg.norm(ends[0] - ends[1]) / (1 + 5 * 11.5e-6)  # what the arm without error would be shown
    for name, columns, row in (
        ("steel.csv", ",expansion_per_K,u_expansion_per_K", ",0.0000115,0.000001"),
        ("unknown.csv", "", ""),
    ):
        text = f"seat_a,seat_b,length_mm,u_mm{columns}\nbar A,bar B,{cold:.7f},0.0005{row}\n"
        Path(name).write_text(text, encoding="utf-8")
    assert abs(cold - known) < 0.1
    asked = ("check", "arm.truearm", "warm.csv", "--mpe", "mpe.toml", "--json")
    steel = json.loads(truearm(*asked, "--lengths", "steel.csv", "--history", "steel.sqlite").out)
    length = next(row for row in steel["values"] if row["quantity"] == "length error")
    assert length["value_mm"] == pytest.approx(0, abs=1e-6)
    assert (length["at_20_degC"], length["over_mpe"], steel["recalibrate"]) == (True, False, "not enough checks yet")
    ran = truearm(*asked, "--lengths", "unknown.csv", "--history", "unknown.sqlite")
    unknown = json.loads(ran.out)
    length = next(row for row in unknown["values"] if row["quantity"] == "length error")
    assert length["value_mm"] == pytest.approx(0.0345, abs=1e-4)
    assert (length["at_20_degC"], length["mpe_mm"], ran.code) == (False, None, 3)
    assert "length error as measured: not compared with the specification" in " ".join(unknown["remarks"])


def test_a_change_of_a_missing_artefact_remains_until_it_is_retired(truearm, folder):
    """After 26 checks of which the last tell of a drift, the cone alone gives no clean answer."""
    only = session(27).rows(session(27).seat == "bar A")
    write_session(only, "part.csv")
    asked = ("check", "arm.truearm", "part.csv", "--history", "arm.sqlite", "--date", "2026-01-27")
    ran = truearm(*asked)
    assert ran.code == 1
    assert re.search(r"length bar A to bar B, length error: drift since .*, last measured in check 26\n", ran.out)
    assert "seat bar B, SPAT.2s: not in this check; unchanged in check 26" in ran.out
    mended = truearm(*asked, "--retired", "cone", "--retired", "bar B")
    assert "length bar A to bar B" not in mended.out
    assert "seat cone" not in mended.out
    assert truearm(*asked, "--retired", "bar A").code == 2


def test_a_refused_check_is_not_added_and_a_forgotten_file_completes_it(truearm, refused, folder):
    Path("wrong.toml").write_text(MPE.replace("{ B_um = 80 }", "{ A_um = 10, K_mm_per_um = 80 }"), encoding="utf-8")
    Path("arm.sqlite").unlink()
    refused(arguments(1, "--mpe", "wrong.toml"), "limits.SPAT.2s")
    without = [*arguments(1)[:3], *arguments(1)[5:], "--json"]
    assert json.loads(truearm(*without).out)["added"] is True
    found = json.loads(truearm(*arguments(1, "--json")).out)
    assert (found["added"], found["completed"], found["n_checks"]) == (False, True, 1)
    assert any(row["quantity"] == "length error" for row in found["values"])
    again = json.loads(truearm(*without).out)  # and nothing is taken out
    assert (again["completed"], len(again["values"])) == (False, len(found["values"]))


def test_a_single_seat_makes_a_check(truearm, folder):
    only = session(1).rows(session(1).seat == "cone")
    write_session(only, "cone.csv")
    ran = truearm("check", "arm.truearm", "cone.csv", "--history", "cone.sqlite")
    assert (ran.code, ran.err) == (3, "")
    assert "sphere" not in ran.out


def test_a_seat_misspelt_in_one_reading_is_named(truearm, folder):
    only = session(1).rows(session(1).seat == "cone")
    names = only.seat.copy()
    names[1] = "cono"
    write_session(replace(only, seat=names), "cone.csv")
    ran = truearm("check", "arm.truearm", "cone.csv", "--history", "cone.sqlite")
    assert ran.code == 3
    assert "Seat 'cono' has a single reading; ignored; is it 'cone', misspelled?\n" in ran.out


def test_the_page_has_the_charts_and_the_answer(folder):
    html = Path("arm.html").read_text(encoding="utf-8")
    assert f"{ARM}: interim checks" in html
    said = ("seat cone, SPAT.2s", "drift since about check", "evidence of a change", "Temperature of the checks")
    for phrase in said:
        assert phrase in html
    # Seven charts, the temperature, and four views of the points of this check.
    assert html.count('<div class="panel"') == 12
    view = json.loads(re.search(r'<script type="application/json">(.*?)</script>', html, flags=re.DOTALL)[1])
    cloud = view["points"]
    assert cloud["total"] == 27
    assert {"seat cone", "sphere ball"} <= {name.partition(", ")[2] for name in cloud["names"]["last"]}
    assert [column["name"] for column in cloud["values"] + cloud["notes"]] == ["deviation", "u of a coordinate"]
    # The ring is at the largest deviation, and the arm goes to the point that is pointed at.
    assert [i for i, _ in cloud["marked"]] == [int(np.argmax(cloud["values"][0]["data"]))]
    assert view["mechanism"]["follows"] == [*range(len(cloud["axes"]))]
    assert len(view["lines"]) == 1  # the bar


def test_an_interrupted_check_is_not_added(truearm, folder, snapshot, monkeypatch):
    before = snapshot(folder)

    def interrupted(*record):
        insert(*record)
        raise KeyboardInterrupt

    insert = history._insert
    monkeypatch.setattr(history, "_insert", interrupted)
    write_session(session(27), "day27.csv")
    ran = truearm(*arguments(27, "--page", "page.html"))
    assert (ran.code, ran.out, ran.err) == (130, "", "truearm: interrupted\n")
    Path("day27.csv").unlink()
    assert snapshot(folder) == before


def test_a_wrong_check_is_withdrawn_and_stays_on_the_page(truearm, folder):
    """Check 26 called for recalibration; without it check 25 is the last, and check 27 has the number 27."""
    asked = ("check", "arm.truearm", "--history", "arm.sqlite", "--withdraw")
    ran = truearm(*asked, "26", "--reason", "the bar was <loose>", "--page", "withdrawn.html").done()
    assert ran.out.splitlines()[0] == "Check 26 of 2026-01-26 is withdrawn: the bar was <loose>"
    assert "\nWithout it: " in ran.out
    assert Path("withdrawn.html").read_text(encoding="utf-8").count('<tr class="withdrawn">') == 1
    write_session(session(27), "day27.csv")
    found = json.loads(truearm(*arguments(27, "--page", "page.html", "--json")).out)
    assert (found["n_checks"], found["values"][0]["check"]) == (26, 27)
    assert [(one["check"], one["reason"]) for one in found["withdrawn"]] == [(26, "the bar was <loose>")]
    assert found["history"]["rows"] == 28
    html = Path("page.html").read_text(encoding="utf-8")
    assert html.count('<tr class="withdrawn">') == 1
    assert "the bar was &lt;loose&gt;" in html
    assert found["history"]["sha256"] in html
    stated = json.loads(truearm(*asked, "2026-01-27", "--reason", "again", "--json").out)
    assert (stated["check"], stated["n_checks"]) == (27, 25)


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        (("--withdraw", "99", "--reason", "x"), "no check that counts has the number or date '99'"),
        (("--withdraw", "yesterday", "--reason", "x"), "has the number or date 'yesterday'"),
        (("--withdraw", "3"), "--withdraw needs --reason"),
        (("--withdraw", "3", "--reason", " "), "expected the reason"),
        (("--withdraw", "3", "--reason", "x", "--mpe", "mpe.toml"), "--mpe does not apply to --withdraw"),
        (("--reason", "x"), "--reason applies to --withdraw only"),
        ((), "the session is missing"),
        (("--withdraw", "3", "--reason", "x", "--history", "new.sqlite"), "the file does not exist"),
    ],
)
def test_what_cannot_be_withdrawn_is_refused(truearm, folder, snapshot, options, phrase):
    before = snapshot(folder)
    assert phrase in truearm("check", "arm.truearm", "--history", "arm.sqlite", *options).refused().err
    assert snapshot(folder) == before


# Refusals ------------------------------------------------------------------------------------------------------------


def misnamed(folder):
    today = session(27)
    write_session(Session(today.angles, seat=np.where(today.seat == "", "cone", today.seat)), "day26.csv")


REFUSED = {
    "the file of another program": (lambda folder: Path("arm.sqlite").write_bytes(b"x" * 5000), (), "arm.sqlite"),
    "a session as history": (None, ("--history", "day25.csv"), "day25.csv: expected a history"),
    "the page on the history": (None, ("--page", "arm.sqlite"), "arm.sqlite"),
    "a day before the last": (
        lambda folder: write_session(session(27), "day26.csv"),
        ("--date", "2026-01-25"),
        "order",
    ),
    "a day to come": (None, ("--date", "2962-01-01"), "to rehearse the coming months, state days in the past"),
    "a day before all days": (None, ("--date", "0001-01-01T00:00+14:00"), "expected a date, got '0001-01-01T00:00+14"),
    "a day after all days": (None, ("--date", "9999-12-31T23:59:59-12:00"), "expected a date, got '9999-12-31T23:59"),
    "a bar that is not there": (None, ("--lengths", "nowhere.csv"), "nowhere.csv"),
    "readings of two seats under one name": (misnamed, (), "too far for one seat"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_files_are_refused_and_the_history_stays(truearm, folder, case, snapshot):
    change, more, phrase = REFUSED[case]
    if change is not None:
        change(folder)
    before = snapshot(folder)
    ran = truearm(*arguments(26), *more)
    assert ran.code == 2, ran
    assert ran.out == ""
    assert phrase in ran.err.splitlines()[-1]
    assert snapshot(folder) == before


def test_training_readings_are_no_check(refused, folder):
    write_session(virtual().measure(session(1).angles, seed=3, seat=session(1).seat).readings, "learned.csv")
    learned = read_session("learned.csv")
    KinematicModel(virtual().nominal, free=()).fit_readings(learned).save("own.truearm")
    refused(["check", "own.truearm", "learned.csv", "--history", "own.sqlite"], "the training readings of the model")
    assert not Path("own.sqlite").exists()


# The page of the documentation ---------------------------------------------------------------------------------------


def test_the_documentation_shows_what_is_printed(course):
    """Line for line but for numbers and what follows from them, which are of the day when the page was written."""
    shown = [text.partition("\n") for text in blocks("interim-check.md", "console")]
    assert len(shown) == 3

    def without_numbers(text):
        told = [line for line in text.splitlines() if not re.search("a jump at|drift since|beyond the limits", line)]
        return [re.sub(r"[-+]?\d+\.\d+|check \d+ of [-0-9]+|(beyond|drift|, )+$", "", line).split() for line in told]

    for command, _, printed in shown:
        day = int(re.search(r"day(\d\d)", command)[1])
        report = ["--page", "arm.html"] if day == len(CREEP) else []
        assert command == "$ truearm " + " ".join(arguments(day, *report))
        beginning, _, gap = printed.partition("...\n")
        words, said = without_numbers(beginning), without_numbers(course[day].out)
        assert words == (said[: len(words)] if "...\n" in printed else said)
        assert not gap


def test_the_documentation_shows_the_file_of_lengths():
    assert block("interim-check.md", "csv lengths") == LENGTHS
