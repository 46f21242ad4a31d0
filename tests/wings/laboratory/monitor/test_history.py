"""The history of checks: it returns what was stored, whole or not at all, and refuses damaged and foreign files."""

import datetime
import hashlib
import json
import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import TruearmError
from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice
from truearm.wings.laboratory.monitor.history import _TABLE as TABLE
from truearm.wings.laboratory.monitor.history import APPLICATION_ID, VERSION, History
from truearm.wings.laboratory.monitor.interim_check import CheckValue, InterimCheck, Withdrawal, counted
from truearm.wings.laboratory.monitor.recorded_check import record_check
from truearm.wings.laboratory.standards.specification import Specification

MODEL, OTHER = "a" * 64, "b" * 64
VALUES = (
    CheckValue("SPAT.2s", "cône; DROP TABLE checks", 0.0123456789012345, 0.001, 0.0, 10),
    CheckValue("length error", "A to B", -0.004, 0.002, 0.0005, 8, 600.0021),
)


def check(day=1, model=MODEL, session=None, **changed):
    one = InterimCheck(datetime.datetime(2026, 1, day, 8, 30), model, session or f"{day:064x}", 20.5, VALUES)
    return replace(one, **changed)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "arm.sqlite"


@pytest.fixture
def filled(path):
    history = History(path)
    for day in (1, 2, 3):
        assert history.append(check(day))
    return path


def execute(path, *statements):
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()


def test_a_stored_check_is_read_back_unchanged(path):
    history = History(path)
    assert history.checks(MODEL) == ()
    assert not path.exists()  # nothing is made before there is something to keep
    assert history.append(check(temperature_degC=None))
    assert History(path).checks(MODEL) == (check(temperature_degC=None),)


def test_what_was_accepted_stays_with_the_check(path):
    said = check(accepted=("Accepted (the seat was moved): seat A is too wide.",))
    assert History(path).append(said)
    assert History(path).checks(MODEL) == (said,)
    for bad in ("", "two\nlines", 7):
        refuses("what was accepted", check, accepted=(bad,))


def test_the_file_identifies_itself(filled):
    with closing(sqlite3.connect(filled)) as database:
        assert database.execute("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
        assert database.execute("PRAGMA user_version").fetchone() == (VERSION,)
    assert filled.read_bytes()[68:72] == b"tArm"  # the SQLite file format, 1.3
    assert [p.name for p in filled.parent.iterdir()] == [filled.name]


def test_a_session_counts_once_for_each_model(filled):
    history, before = History(filled), filled.read_bytes()
    assert not history.append(check(2))
    assert filled.read_bytes() == before
    assert history.append(check(1, model=OTHER))  # the same session, judged by another model
    assert [one.date.day for one in history.checks(MODEL)] == [1, 2, 3]
    assert [one.date.day for one in history.checks(OTHER)] == [1]


def test_checks_are_added_in_the_order_of_their_dates(filled):
    refuses("before the last one of 2026-01-03 08:30", History(filled).append, check(2, session="c" * 64))
    assert History(filled).append(check(3, session="c" * 64))  # the same minute is no earlier
    assert [one.session[-1] for one in History(filled).checks(MODEL)] == ["1", "2", "3", "c"]


KILLED = """
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("PRAGMA cache_size = 1")
database.execute("BEGIN IMMEDIATE")
{}
for i in range(2000):
    database.execute("INSERT INTO checks (record, sha256) VALUES ('x', ?)", (str(i) * 50,))
os._exit(9)
"""


def test_a_killed_program_leaves_the_history_unchanged(filled):
    """Its journal stays beside; the next program that opens the history removes both it and the half check."""
    before = History(filled).checks(MODEL)
    ran = subprocess.run([sys.executable, "-c", KILLED.format(""), str(filled)])
    assert ran.returncode == 9
    assert Path(f"{filled}-journal").exists()
    assert History(filled).checks(MODEL) == before
    assert History(filled).append(check(4))
    assert [file.name for file in filled.parent.iterdir()] == [filled.name]


@pytest.mark.parametrize("created", ["", f"database.execute({TABLE!r})"])
def test_a_program_killed_during_the_first_check_leaves_nothing_behind(path, created):
    """Before it has created the table, or after: the next check takes the file and removes the journal."""
    script = KILLED.format(created) if created else KILLED.partition("{}")[0] + "os._exit(9)"
    ran = subprocess.run([sys.executable, "-c", script, str(path)])
    assert ran.returncode == 9
    assert History(path).checks(MODEL) == ()
    assert History(path).append(check(1))
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_the_first_checks_of_two_programs_are_both_stored(path):
    first, second = History(path), History(path)
    assert first.append(check(1))
    assert second.append(check(2))
    assert [one.date.day for one in History(path).checks(MODEL)] == [1, 2]
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_missing_values_complete_the_last_check(filled):
    history, day = History(filled), datetime.datetime(2026, 2, 1)
    part = check(4, values=VALUES[:1])
    assert history.append(part)
    assert history.with_check(check(4, date=day)) == (*history.checks(MODEL)[:3], check(4))
    assert history.append(check(4, date=day))
    assert history.checks(MODEL)[-1] == check(4)  # with the date that it had
    assert not history.append(part)  # nothing is taken out
    assert not history.append(check(3, values=(*VALUES, replace(VALUES[0], artefact="more"))))  # nor an earlier changed
    assert [one.date.day for one in history.checks(MODEL)] == [1, 2, 3, 4]


# Withdrawal ----------------------------------------------------------------------------------------------------------

LATER = Withdrawal(datetime.datetime(2026, 2, 1), "the ball was dirty")


def test_a_withdrawn_check_stays_with_its_reason_and_its_number(filled):
    history = History(filled)
    second = history.checks(MODEL)[1]
    rows, checksum = history.head
    history.withdraw(second, LATER)
    assert history.checks(MODEL) == (check(1), check(2, withdrawn=LATER), check(3))
    assert counted(history.checks(MODEL)) == (check(1), check(3))
    assert history.head[0] == rows + 1
    assert history.head[1] != checksum
    refuses("withdrawn already, or not in this history", history.withdraw, second, LATER)
    refuses("withdrawn already, or not in this history", history.withdraw, check(9), LATER)
    assert history.head[0] == rows + 1


def test_a_session_may_be_checked_again_after_its_withdrawal(filled):
    """A check with a wrong date, which would refuse all checks before it, and a later one that completes nothing."""
    history = History(filled)
    future = check(28, session="d" * 64)
    assert history.append(future)
    refuses("--withdraw withdraws one with a wrong date", history.append, check(4))
    history.withdraw(future, LATER)
    right = check(4, session="d" * 64)
    assert history.append(right)
    assert history.checks(MODEL)[3:] == (replace(future, withdrawn=LATER), right)
    assert not history.append(right)
    assert history.append(check(5))


def test_a_withdrawn_check_changes_no_chart(path):
    """Sixteen checks, one of them far off and withdrawn: the others are assessed, with the numbers that they had."""
    history, steady = History(path), 0.01 + 0.0005 * np.resize([1.0, -1.0, 0.5, -0.5], 17)
    for day in range(1, 17):
        value = CheckValue("SPAT.2s", "cone", 0.1 if day == 12 else steady[day], 0.0005, 0.0, 10)
        recorded = record_check(history, check(day, values=(value,)))
        if day == 12:
            assert recorded.assessment.recalibrate is RecalibrationAdvice.UNDECIDED
            history.withdraw(recorded.last, LATER)
            assert record_check(history, check(11, values=(value,))).last.date.day == 11
    (trend,) = recorded.assessment.trends
    assert recorded.assessment.recalibrate is RecalibrationAdvice.NO
    assert (recorded.number, recorded.assessment.n_before) == (16, 14)
    assert 11 not in trend.checks
    assert trend.chart.n_before[-1] == 14


def test_a_model_of_which_all_checks_are_withdrawn_is_no_other_model(filled):
    history = History(filled)
    for one in history.checks(MODEL):
        history.withdraw(one, LATER)
    assert history.other_models(OTHER, arm="gao2017") == ()
    assert counted(history.checks(MODEL)) == ()


@pytest.mark.parametrize("reason", ["", " ", "x" * 1001, "two\nlines", 5])
def test_a_withdrawal_needs_a_reason(reason):
    refuses("the reason of a withdrawal", Withdrawal, LATER.date, reason)


@pytest.mark.parametrize(
    "row",
    [
        {"withdraws": 4},
        {"withdraws": 0},
        {"withdraws": True},
        {"withdraws": 1, "reason": ""},
        {"withdraws": 1, "date": "yesterday"},
        {"withdraws": 1, "more": 1},
    ],
)
def test_a_record_that_is_no_withdrawal_is_refused_though_its_checksum_matches(filled, row):
    texts = [json.dumps(one) for one in records_of(filled)]
    stated = {"date": "2026-02-01 00:00:00", "reason": "dirt"}
    write_records(filled, [*texts, json.dumps({"withdraws": 1, **stated})])
    assert len(counted(History(filled).checks(MODEL))) == 2
    write_records(filled, [*texts, json.dumps({**stated, **row})])
    refuses("damaged", History, filled)


@pytest.mark.parametrize(
    ("number", "changed"),
    [
        (0, {"artefact": "x" * 1001}),
        (0, {"value_mm": float("inf")}),
        (0, {"value_mm": -1.0}),
        (0, {"value_mm": "1"}),
        (0, {"u_mm": -0.001}),
        (0, {"n": 0}),
        (0, {"n": 1.5}),
        (1, {"length_mm": float("nan")}),
        (0, {"quantity": "weight"}),
        (0, {"quantity": ["form"]}),
    ],
)
def test_a_value_that_could_not_be_read_again_cannot_be_made(number, changed):
    refuses(None, replace, VALUES[number], **changed)


@pytest.mark.parametrize("changed", [{"values": ()}, {"values": 2 * VALUES}, {"temperature_degC": float("nan")}])
def test_a_check_that_could_not_be_read_again_cannot_be_made(changed):
    refuses(None, check, 4, **changed)


def test_other_models_are_named_with_their_last_result(filled):
    history = History(filled)
    assert history.other_models(MODEL, arm="gao2017") == ()
    assert history.append(check(4, model=OTHER), name="new.truearm", arm="gao2017")
    assert history.append(check(5, model=OTHER), name="renamed.truearm", arm="gao2017")
    (other,) = history.other_models(MODEL, arm="gao2017")
    assert (other.name, other.arm, [one.date.day for one in other.checks]) == ("new.truearm", "gao2017", [4, 5])
    words = other.describe(other.assess())
    assert words.startswith("2 checks of new.truearm in this history, not compared; result of the last one, ")
    assert words.endswith(
        '2026-01-05 08:30: "Not enough checks yet: 2 with this one, 11 are needed to say that the arm has not changed."'
    )
    (unnamed,) = history.other_models(OTHER, arm="gao2017")  # its checks were added without names
    assert unnamed.describe(unnamed.assess()).startswith("3 checks of another model (SHA-256 aaaaaaaaaaaa..)")
    assert history.append(check(6, model="c" * 64), name="un\nprintable", arm="gao2017")
    assert [one.name for one in history.other_models(MODEL, arm="gao2017")] == ["", "new.truearm"]  # the last one first


def test_a_recorded_check_says_what_other_models_found_while_it_is_new(filled):
    history = History(filled)
    assert record_check(history, check(4)).remarks == ()
    first, second = (record_check(history, check(day, model=OTHER)) for day in (5, 6))
    (said,) = first.remarks
    assert said.startswith("a new model: 4 checks of another model (SHA-256 aaaaaaaaaaaa..) in this history")
    assert (first.number, second.number, first.added, first.completed) == (1, 2, True, False)
    assert second.remarks == (said.removeprefix("a new model: "),)
    for day in range(7, 15):
        tenth = record_check(history, check(day, model=OTHER))
    assert tenth.remarks == second.remarks
    assert record_check(history, check(15, model=OTHER)).remarks == ()


def test_a_check_that_brings_missing_values_completes_and_one_that_brings_none_adds_nothing(path):
    history = History(path)
    record_check(history, check(1, values=VALUES[:1]))
    for is_completed in (True, False):
        again = record_check(history, check(1))
        assert (again.added, again.completed, again.check) == (False, is_completed, check(1))


def test_another_model_is_assessed_without_retired_artefacts_and_with_the_specification(path):
    """A cone whose scatter rose tenfold at check 12 and was replaced; ten checks with the cone that was not."""
    history, steady = History(path), 0.01 + 0.0005 * np.resize([1.0, -1.0, 0.5, -0.5], 16)
    for day in range(1, 16):
        good = CheckValue("SPAT.2s", "second cone", steady[day], 0.0005, 0.0, 10)
        worn = replace(good, artefact="cone", value_mm=steady[day] if day < 12 else 0.1)
        history.append(check(day, model=OTHER, values=(good, worn)[: 2 if day < 14 else 1]))
    (other,) = history.other_models(MODEL, arm="gao2017")
    assert other.describe(other.assess()).endswith(
        '"Recalibrate: a value has changed since check 12 of 2026-01-12 08:30."'
    )
    known = ["cone", "nowhere", "second cone"]  # the last one is in its last check
    assert other.describe(other.assess(retired=known)).endswith(
        '"No need to recalibrate: no value has changed by more than the scatter of the earlier checks."'
    )
    strict = Specification(name="arm", source="sheet", measuring_range_mm=2000, limits={"SPAT.2s": {"B_um": 1}})
    assert other.assess(strict, retired=["cone"]).recalibrate is RecalibrationAdvice.YES


def test_a_model_of_another_arm_is_refused(path):
    history = History(path)
    assert history.append(check(4, model=OTHER), name="new.truearm", arm="gao2017")
    refuses("are of arm 'gao2017', the model is of arm 'measuring7'", history.other_models, MODEL, arm="measuring7")


def test_of_two_arms_that_begin_a_history_at_once_one_keeps_it(path):
    history, other = History(path), History(path)
    assert history.other_models(MODEL, arm="measuring7") == ()
    assert other.append(check(1, model=OTHER), arm="gao2017")
    refuses("are of arm 'gao2017', the model is of arm 'measuring7'", history.append, check(2), arm="measuring7")
    assert history.checks(MODEL) == ()
    assert history.append(check(2, model=OTHER), arm="gao2017")


def test_a_folder_without_write_permission_is_refused_first(path, filled, monkeypatch):
    monkeypatch.setattr(os, "access", lambda where, mode: mode != os.W_OK)
    refuses("no permission to write in the folder", History, path.with_name("new.sqlite"))
    history = History(filled)
    assert len(history.checks(MODEL)) == 3
    refuses("protected", history.append, check(4))


def test_statistics_of_database_tools_do_no_harm(filled):
    execute(filled, "ANALYZE")
    assert len(History(filled).checks(MODEL)) == 3
    assert History(filled).append(check(4))


# Files that are no history -------------------------------------------------------------------------------------------


def test_other_files_are_refused_and_not_changed(path, filled):
    with closing(sqlite3.connect(path.with_name("other.sqlite"))) as other:
        other.execute("CREATE TABLE checks (id INTEGER)")
    for name, content, phrase in (
        ("text.csv", b"q1_deg,q2_deg\n1,2\n", "got something else"),
        ("other.sqlite", path.with_name("other.sqlite").read_bytes(), "SQLite file of another program"),
        ("short.sqlite", filled.read_bytes()[:3000], "damaged"),
        ("mixed.sqlite", filled.read_bytes()[:4096] + b"\xff" * (len(filled.read_bytes()) - 4096), "damaged"),
    ):
        file = path.with_name(name)
        file.write_bytes(content)
        assert refuses(phrase, History, file).file == file
        assert file.read_bytes() == content
    refuses("folder", History, path.parent)
    refuses("does not exist", History, path.parent / "nowhere" / "arm.sqlite")


@pytest.mark.skipif(sys.platform == "win32", reason="special files of POSIX")
def test_a_history_is_an_ordinary_file(path):
    for name, target, phrase in (
        ("loop.sqlite", "loop.sqlite", "leads back to itself"),
        ("device.sqlite", "/dev/zero", "a device, a pipe or a socket"),
    ):
        file = path.with_name(name)
        file.symlink_to(target)
        assert refuses(phrase, History, file).file == file
        assert file.is_symlink()


@pytest.mark.parametrize(
    ("statement", "phrase"),
    [
        ("PRAGMA user_version = 99", "version 2, got version 99"),
        ("PRAGMA user_version = 0", "tables are not those"),
        ("PRAGMA user_version = 1", "version 2, got version 1, .* no longer read.*name a new file"),
        ("PRAGMA user_version = -1", "tables are not those"),
        ("DROP TABLE head", "tables are not those"),
        ("DELETE FROM head", "last rows are missing"),
        ("UPDATE head SET rows = 4", "last rows are missing"),
        ("DELETE FROM checks WHERE id = 3", "last rows are missing"),
        ("DELETE FROM checks", "last rows are missing"),
        ("PRAGMA application_id = 0", "SQLite file of another program"),
        ("DROP TABLE checks", "tables are not those"),
        ("CREATE TRIGGER t AFTER INSERT ON checks BEGIN DELETE FROM checks; END", "tables are not those"),
        ("CREATE VIEW v AS SELECT 1", "tables are not those"),
    ],
)
def test_a_file_of_another_version_or_a_changed_one_is_refused(filled, statement, phrase):
    execute(filled, statement)
    refuses(phrase, History, filled)


def flip(content, bit):
    return content[: bit // 8] + bytes([content[bit // 8] ^ (1 << bit % 8)]) + content[bit // 8 + 1 :]


@pytest.mark.parametrize("each", [5, pytest.param(1, marks=pytest.mark.weekly)])
def test_a_flipped_bit_in_a_stored_value_is_refused(path, each):
    """Every bit of the values, the date and the temperature, and every seventh of the fingerprints and the checksum.

    Every fifth of those a day.
    """
    history = History(path)
    assert history.append(check(1, values=VALUES[1:]), name="new.truearm", arm="gao2017")
    content = path.read_bytes()
    with closing(sqlite3.connect(path)) as database:
        ((record, checksum),) = database.execute("SELECT record, sha256 FROM checks")
    prints, values = record.partition('"model"')[2].partition('"temperature_degC"')[::2]
    date = record.partition('"model"')[0]
    for part, step in ((date, each), (values, each), (prints, 7 * each), (checksum, 7 * each)):
        first = 8 * content.index(part.encode())
        for bit in range(first, first + 8 * len(part), step):
            path.write_bytes(flip(content, bit))
            assert "restore the file from a backup" in refuses("the history is damaged", history.checks, MODEL).hint


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    path = tmp_path_factory.mktemp("history") / "arm.sqlite"
    for day in (1, 2, 3):
        assert History(path).append(check(day))
    return path.read_bytes()


@settings(max_examples=100)
@given(bit=st.integers(0, 8 * 3 * 4096 - 1))
def test_a_flipped_bit_anywhere_is_refused_or_changes_no_number(content, tmp_path_factory, bit):
    path = tmp_path_factory.getbasetemp() / "flipped.sqlite"
    path.write_bytes(flip(content, bit))
    try:
        read = History(path).checks(MODEL)
    except TruearmError:
        return
    assert read == tuple(check(day) for day in (1, 2, 3))


def records_of(path):
    with closing(sqlite3.connect(path)) as database:
        return [json.loads(text) for (text,) in database.execute("SELECT record FROM checks ORDER BY id")]


def write_records(path, records):
    """Store texts with a chain of checksums that matches them, as a forger would."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("DELETE FROM checks")
        checksum = ""
        for number, text in enumerate(records, start=1):
            checksum = hashlib.sha256(f"{checksum}\n{text}".encode()).hexdigest()
            database.execute("INSERT INTO checks VALUES (?, ?, ?)", (number, text, checksum))
        database.execute("UPDATE head SET rows = ?, sha256 = ?", (len(records), checksum))
        database.commit()


@pytest.mark.parametrize(
    "changed",
    [
        {"date": "yesterday"},
        {"date": 5},
        {"date": "2026-01-02 08:30:00+01:00"},
        {"session": "short"},
        {"model": None},
        {"temperature_degC": 9e999},
        {"temperature_degC": "warm"},
        {"values": []},
        {"values": 7},
        {"values": [{"quantity": "SPAT.2s"}]},
        {"values": [{}]},
        {"name": 9},
        {"arm": "\x1b[2J"},
        {"more": 1},
    ],
)
def test_a_record_that_is_no_check_is_refused_though_its_checksum_matches(filled, changed):
    records = records_of(filled)
    write_records(filled, [json.dumps(one) for one in records])
    assert len(History(filled).checks(MODEL)) == 3
    records[1] |= changed
    write_records(filled, [json.dumps(one) for one in records])
    refuses("damaged", lambda: History(filled).checks(MODEL))


@pytest.mark.parametrize("text", ["", "[]", "{", "9" * 10_000, "[" * 100_000])
def test_a_record_that_is_no_json_object_is_refused(filled, text):
    write_records(filled, [text])
    refuses("damaged", History, filled)


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM checks WHERE id = 1",
        "DELETE FROM checks WHERE id = 2",
        "UPDATE checks SET id = 4 WHERE id = 2",
        "UPDATE checks SET (record, sha256) = (SELECT record, sha256 FROM checks WHERE id = 1) WHERE id = 2",
        "UPDATE checks SET record = CAST(record AS BLOB) WHERE id = 2",
    ],
)
def test_a_row_that_is_missing_or_moved_breaks_the_chain(filled, statement):
    execute(filled, statement)
    refuses("damaged", History, filled)


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        (b"CREATE TABLE checks", b"CREATE TABLE\xff\xfehecks"),
        (b"record TEXT", b"\xff\xfecord TEXT"),
        (b"tablechecks", b"table\xffhecks"),
        (b"2026-01-02", b"2026-01-\xff2"),
    ],
)
def test_text_that_is_not_utf_8_is_damage(filled, text, changed):
    """In the tables' statements, which SQLite's messages quote, and in records."""
    whole = filled.read_bytes()
    assert text in whole
    filled.write_bytes(whole.replace(text, changed))
    assert refuses("the history is damaged", History, filled).file == filled


def test_a_history_without_write_permission_can_be_read(filled):
    filled.chmod(0o444)
    history = History(filled)
    assert len(history.checks(MODEL)) == 3
    if not os.access(filled, os.W_OK):  # the superuser may
        refuses("protected", history.append, check(4))
