"""The history of checks: what went in comes out, whole or not at all, and no other file is taken for one."""

from __future__ import annotations

import datetime
import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearm.verification.monitor.history
from truearm.errors import InputError, TruearmError
from truearm.verification.monitor.history import APPLICATION_ID, VERSION, History
from truearm.verification.monitor.interim import CheckValue, InterimCheck, RecalibrationAdvice
from truearm.verification.standards.specification import Specification

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


def test_what_went_in_comes_out(path):
    history = History(path)
    assert history.checks(MODEL) == ()
    assert not path.exists()  # nothing is made before there is something to keep
    assert history.append(check(temperature_degC=None))
    assert History(path).checks(MODEL) == (check(temperature_degC=None),)


def test_the_file_says_what_it_is(filled):
    with closing(sqlite3.connect(filled)) as database:
        assert database.execute("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
        assert database.execute("PRAGMA user_version").fetchone() == (VERSION,)
    assert filled.read_bytes()[68:72] == b"tArm"  # the SQLite file format, 1.3
    assert [p.name for p in filled.parent.iterdir()] == [filled.name]


def test_a_session_counts_once_and_a_model_has_its_own_checks(filled):
    history, before = History(filled), filled.read_bytes()
    assert not history.append(check(2))
    assert filled.read_bytes() == before
    assert history.append(check(1, model=OTHER))  # the same session, judged by another model
    assert [one.date.day for one in history.checks(MODEL)] == [1, 2, 3]
    assert [one.date.day for one in history.checks(OTHER)] == [1]


def test_checks_are_added_in_their_order(filled):
    with pytest.raises(InputError, match="before the last one of 2026-01-03 08:30"):
        History(filled).append(check(2, session="c" * 64))
    assert History(filled).append(check(3, session="c" * 64))  # the same minute is no earlier
    assert [one.session[-1] for one in History(filled).checks(MODEL)] == ["1", "2", "3", "c"]


def test_a_check_is_added_whole_or_not_at_all(filled):
    twice = check(4, values=(*VALUES, VALUES[0]))
    with pytest.raises(TruearmError):
        History(filled).append(twice)
    assert len(History(filled).checks(MODEL)) == 3
    assert History(filled).append(check(4))


def test_a_program_that_is_killed_while_it_adds_leaves_what_was_there(filled):
    """Its journal is left beside; the next one that opens the history takes the half check back."""
    script = """
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("PRAGMA cache_size = 1")
database.execute("BEGIN IMMEDIATE")
for i in range(2000):
    database.execute("INSERT INTO checks (date, model, session) VALUES ('x', 'y', ?)", (str(i) * 50,))
os._exit(9)
"""
    before = History(filled).checks(MODEL)
    ran = subprocess.run([sys.executable, "-c", script, str(filled)])
    assert ran.returncode == 9
    assert Path(f"{filled}-journal").exists()
    assert History(filled).checks(MODEL) == before
    assert History(filled).append(check(4))


def test_the_first_checks_of_two_programs_are_both_kept(path, monkeypatch):
    """The other one makes the file while this one does."""
    made = truearm.verification.monitor.history._create

    def meanwhile(beside):
        made(beside)
        monkeypatch.setattr(truearm.verification.monitor.history, "_create", made)
        assert History(path).append(check(1))

    monkeypatch.setattr(truearm.verification.monitor.history, "_create", meanwhile)
    assert History(path).append(check(2))
    assert [one.date.day for one in History(path).checks(MODEL)] == [1, 2]
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_file_system_without_links_has_histories_too(path, monkeypatch):
    def refused(*_):
        raise OSError("no links here")

    monkeypatch.setattr(os, "link", refused)
    assert History(path).append(check(1))
    assert History(path).checks(MODEL) == (check(1),)


def test_the_last_check_is_completed_by_what_was_left_out(filled):
    history, day = History(filled), datetime.datetime(2026, 2, 1)
    part = check(4, values=VALUES[:1])
    assert history.append(part)
    assert history.with_check(check(4, date=day)) == (*history.checks(MODEL)[:3], check(4))
    assert history.append(check(4, date=day))
    assert history.checks(MODEL)[-1] == check(4)  # with the date that it had
    assert not history.append(part)  # nothing is taken out
    assert not history.append(check(3, values=(*VALUES, replace(VALUES[0], artefact="more"))))  # nor an earlier changed
    assert [one.date.day for one in history.checks(MODEL)] == [1, 2, 3, 4]
    with closing(sqlite3.connect(filled)) as database:
        assert database.execute("SELECT count(*) FROM test_values").fetchone() == (8,)


@pytest.mark.parametrize(
    "changed",
    [
        {"values": ()},
        {"values": (replace(VALUES[0], artefact="x" * 1001),)},
        {"values": (replace(VALUES[0], value_mm=float("inf")),)},
        {"values": (replace(VALUES[0], value_mm=-1.0),)},
        {"values": (replace(VALUES[0], n=0),)},
        {"values": (replace(VALUES[1], length_mm=float("nan")),)},
        {"values": (replace(VALUES[0], quantity="weight"),)},
        {"temperature_degC": float("nan")},
    ],
)
def test_what_could_not_be_read_again_is_not_written(filled, changed):
    before = filled.read_bytes()
    with pytest.raises(InputError, match="cannot be kept"):
        History(filled).append(check(4, **changed))
    assert filled.read_bytes() == before


def test_other_models_are_named_and_what_their_charts_said(filled):
    history = History(filled)
    assert history.other_models(MODEL, arm="gao2017") == ()
    assert history.append(check(4, model=OTHER), name="new.truearm", arm="gao2017")
    assert history.append(check(5, model=OTHER), name="renamed.truearm", arm="gao2017")
    (other,) = history.other_models(MODEL, arm="gao2017")
    assert (other.name, other.arm, [one.date.day for one in other.checks]) == ("new.truearm", "gao2017", [4, 5])
    words = other.describe(other.assess())
    assert words.startswith("2 checks of new.truearm in this history, not compared; the charts of the last one")
    assert words.endswith(
        '2026-01-05 08:30, say "recalibrate: not enough checks yet, 1 before this one, 10 are needed"'
    )
    (unnamed,) = history.other_models(OTHER, arm="gao2017")  # its checks were added without names
    assert unnamed.describe(unnamed.assess()).startswith("3 checks of another model (SHA-256 aaaaaaaaaaaa..)")
    assert history.append(check(6, model="c" * 64), name="un\nprintable", arm="gao2017")
    assert [one.name for one in history.other_models(MODEL, arm="gao2017")] == ["", "new.truearm"]  # the last one first


def test_another_models_charts_are_told_without_what_was_retired_and_with_the_specification(path):
    """A cone whose scatter rose tenfold at check 12 and was replaced; ten checks with the cone that was not."""
    history, steady = History(path), 0.01 + 0.0005 * np.resize([1.0, -1.0, 0.5, -0.5], 16)
    for day in range(1, 16):
        good = CheckValue("SPAT.2s", "second cone", steady[day], 0.0005, 0.0, 10)
        worn = replace(good, artefact="cone", value_mm=steady[day] if day < 12 else 0.1)
        history.append(check(day, model=OTHER, values=(good, worn)[: 2 if day < 14 else 1]))
    (other,) = history.other_models(MODEL, arm="gao2017")
    assert other.describe(other.assess()).endswith('say "recalibrate: yes, since check 12 of 2026-01-12 08:30"')
    known = ["cone", "nowhere", "second cone"]  # the last one is in its last check
    assert other.describe(other.assess(retired=known)).endswith('say "recalibrate: no"')
    strict = Specification(name="arm", source="sheet", measuring_range_mm=2000, limits={"SPAT.2s": {"B_um": 1}})
    assert other.assess(strict, retired=["cone"]).recalibrate is RecalibrationAdvice.YES


def test_a_model_of_another_arm_is_refused(path):
    history = History(path)
    assert history.append(check(4, model=OTHER), name="new.truearm", arm="gao2017")
    with pytest.raises(InputError, match="are of arm 'gao2017', the model is of arm 'measuring7'"):
        history.other_models(MODEL, arm="measuring7")


def test_of_two_arms_that_begin_a_history_at_once_one_has_it(path, monkeypatch):
    """The other one makes the file while this one does; what it added stays, and can be read."""
    made = truearm.verification.monitor.history._create

    def meanwhile(beside):
        made(beside)
        monkeypatch.setattr(truearm.verification.monitor.history, "_create", made)
        assert History(path).append(check(1, model=OTHER), arm="gao2017")

    monkeypatch.setattr(truearm.verification.monitor.history, "_create", meanwhile)
    history = History(path)
    assert history.other_models(MODEL, arm="measuring7") == ()
    with pytest.raises(InputError, match="are of arm 'gao2017', the model is of arm 'measuring7'"):
        history.append(check(2), arm="measuring7")
    assert history.checks(MODEL) == ()
    assert history.other_models(OTHER, arm="gao2017") == ()
    assert history.append(check(2, model=OTHER), arm="gao2017")


def test_a_history_of_version_1_with_two_arms_is_of_both(path):
    """Such a file permitted it: both go on, and each with a new model; a third arm is refused once all are named."""
    history = History(path)
    assert history.append(check(1))
    assert history.append(check(2, model=OTHER))
    execute(path, "DROP TABLE models", "PRAGMA user_version = 1")
    for day, model, arm in ((3, MODEL, "gao2017"), (4, OTHER, "measuring7"), (5, "c" * 64, "gao2017")):
        history.other_models(model, arm=arm)
        assert history.append(check(day, model=model), arm=arm)
    for refused in (lambda: history.other_models("d" * 64, arm="ur5"), lambda: history.append(check(6), arm="ur5")):
        with pytest.raises(InputError, match="are of arm 'gao2017', 'measuring7', the model is of arm 'ur5'"):
            refused()


def test_a_history_of_version_1_is_read_and_becomes_one_of_version_2_with_its_next_check(filled):
    execute(filled, "DROP TABLE models", "PRAGMA user_version = 1")
    history = History(filled)
    assert len(history.checks(MODEL)) == 3
    assert history.other_models(OTHER, arm="gao2017")[0].name == ""
    assert not history.append(check(3))
    assert history.append(check(4), name="arm.truearm", arm="gao2017")
    with closing(sqlite3.connect(filled)) as database:
        assert database.execute("PRAGMA user_version").fetchone() == (VERSION,)
    (other,) = History(filled).other_models(OTHER, arm="gao2017")
    assert (other.name, len(other.checks)) == ("arm.truearm", 4)


def test_a_history_of_version_1_with_two_models_goes_on(filled):
    """Of the model that has no check since, no name is known, and of the other one its next check tells."""
    assert History(filled).append(check(4, model=OTHER))
    execute(filled, "DROP TABLE models", "PRAGMA user_version = 1")
    assert History(filled).append(check(5, model=OTHER), name="new.truearm", arm="gao2017")
    (old,) = History(filled).other_models(OTHER, arm="gao2017")
    assert (old.name, old.arm, len(old.checks)) == ("", "", 3)
    assert History(filled).append(check(6, model=OTHER), name="new.truearm", arm="gao2017")
    assert History(filled).append(check(7), name="old.truearm", arm="gao2017")
    (old,) = History(filled).other_models(OTHER, arm="gao2017")
    assert (old.name, old.arm, len(old.checks)) == ("old.truearm", "gao2017", 4)


@pytest.mark.parametrize(
    "statement",
    ["UPDATE models SET name = zeroblob(9)", "UPDATE models SET arm = char(27) || '[2J'"],
)
def test_names_that_no_model_has_are_refused(filled, statement):
    execute(filled, statement)
    with pytest.raises(InputError, match="damaged"):
        History(filled).other_models(OTHER, arm="gao2017")


def test_a_folder_in_which_nothing_can_be_made_is_named(path, monkeypatch):
    """The superuser may write everywhere, the system refuses all the same; no name of a file in between."""

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied", str(path.with_name(".history-x8r")))

    history = History(path)
    monkeypatch.setattr(truearm.verification.monitor.history.tempfile, "mkdtemp", refused)
    with pytest.raises(TruearmError) as raised:
        history.append(check())
    where = f"no file can be written in the folder {path.parent.resolve()} (Permission denied)"
    assert str(raised.value) == f"{path}: the history cannot be made: {where}"
    assert not path.exists()


def test_a_folder_that_may_not_be_written_is_refused_before_any_work(path, filled, monkeypatch):
    monkeypatch.setattr(os, "access", lambda where, mode: mode != os.W_OK)
    with pytest.raises(InputError, match="no permission to write in the folder"):
        History(path.with_name("new.sqlite"))
    history = History(filled)
    assert len(history.checks(MODEL)) == 3
    with pytest.raises(InputError, match="protected"):
        history.append(check(4))


def test_statistics_of_a_databases_tools_do_no_harm(filled):
    execute(filled, "ANALYZE")
    assert len(History(filled).checks(MODEL)) == 3
    assert History(filled).append(check(4))


# Files that are no history -------------------------------------------------------------------------------------------


def test_other_files_are_refused_and_left_alone(path, filled):
    with closing(sqlite3.connect(path.with_name("other.sqlite"))) as other:
        other.execute("CREATE TABLE checks (id INTEGER)")
    for name, content, phrase in (
        ("text.csv", b"q1_deg,q2_deg\n1,2\n", "got something else"),
        ("empty.sqlite", b"", "got an empty file"),
        ("other.sqlite", path.with_name("other.sqlite").read_bytes(), "another program's"),
        ("short.sqlite", filled.read_bytes()[:3000], "damaged"),
        ("mixed.sqlite", filled.read_bytes()[:4096] + b"\xff" * (len(filled.read_bytes()) - 4096), "damaged"),
    ):
        file = path.with_name(name)
        file.write_bytes(content)
        with pytest.raises(InputError, match=phrase) as raised:
            History(file)
        assert raised.value.file == file
        assert file.read_bytes() == content
    with pytest.raises(InputError, match="folder"):
        History(path.parent)
    with pytest.raises(InputError, match="does not exist"):
        History(path.parent / "nowhere" / "arm.sqlite")


@pytest.mark.parametrize(
    ("statement", "phrase"),
    [
        ("PRAGMA user_version = 99", "version 2 or older, got version 99"),
        ("PRAGMA user_version = 1", "tables are not those"),
        ("PRAGMA user_version = 0", "tables are not those"),
        ("PRAGMA application_id = 0", "another program's"),
        ("DROP TABLE test_values", "tables are not those"),
        ("CREATE TRIGGER t AFTER INSERT ON checks BEGIN DELETE FROM checks; END", "tables are not those"),
        ("CREATE VIEW v AS SELECT 1", "tables are not those"),
    ],
)
def test_a_newer_or_changed_file_is_refused(filled, statement, phrase):
    execute(filled, statement)
    with pytest.raises(InputError, match=phrase):
        History(filled)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE checks SET date = 'yesterday' WHERE id = 2",
        "UPDATE checks SET date = '2026-01-02 08:30:00+01:00' WHERE id = 2",
        "UPDATE checks SET session = 'short' WHERE id = 2",
        "UPDATE checks SET temperature_degC = 9e999 WHERE id = 2",
        "UPDATE checks SET temperature_degC = 'warm' WHERE id = 2",
        "DELETE FROM test_values WHERE check_id = 2",
        "UPDATE test_values SET quantity = 'colour' WHERE check_id = 2 AND number = 0",
        "UPDATE test_values SET artefact = zeroblob(9) WHERE check_id = 2 AND number = 0",
        "UPDATE test_values SET value_mm = 9e999 WHERE check_id = 2",
        "UPDATE test_values SET value_mm = -1.0 WHERE check_id = 2",
        "UPDATE test_values SET u_mm = 'little' WHERE check_id = 2",
        "UPDATE test_values SET u_mm = -0.001 WHERE check_id = 2",
        "UPDATE test_values SET n = 0 WHERE check_id = 2",
        "UPDATE test_values SET n = 1.5 WHERE check_id = 2",
    ],
)
def test_values_that_no_check_can_have_are_refused(filled, statement):
    execute(filled, statement)
    with pytest.raises(InputError, match="damaged"):
        History(filled).checks(MODEL)


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        (b"CREATE TABLE checks", b"CREATE TABLE\xff\xfehecks"),
        (b"UNIQUE (model", b"UNIQUE \xff\xfeodel"),
        (b"tablechecks", b"table\xffhecks"),
        (b"2026-01-02", b"2026-01-\xff2"),
        (b"DROP TABLE", b"DROP\xffTABLE"),
        (b"new.truearm", b"new\xfftruearm"),
    ],
)
def test_text_that_is_no_utf_8_is_damage(path, text, changed):
    """Of the tables' statements, which SQLite's messages quote, and of values."""
    history = History(path)
    for day in (1, 2):
        assert history.append(check(day), name="new.truearm", arm="gao2017")
    whole = path.read_bytes()
    assert text in whole
    path.write_bytes(whole.replace(text, changed))

    def read():
        found = History(path)
        return found.checks(MODEL), found.other_models(OTHER, arm="gao2017")

    with pytest.raises(InputError, match="the history is damaged") as raised:
        read()
    assert raised.value.file == path


def test_a_history_that_may_not_be_written_is_still_read(filled):
    filled.chmod(0o444)
    history = History(filled)
    assert len(history.checks(MODEL)) == 3
    if not os.access(filled, os.W_OK):  # the superuser may
        with pytest.raises(InputError, match="protected"):
            history.append(check(4))
