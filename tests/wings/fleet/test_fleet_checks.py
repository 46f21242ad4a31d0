"""The history of an arm's interim checks in the registry: the rows of a file, and what they say is the arm's state."""

import datetime
import json
import re
import sqlite3
from contextlib import closing
from dataclasses import replace

import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.fleet.check_history import RegisteredHistory
from truearm.wings.fleet.fleet import Fleet
from truearm.wings.laboratory.monitor.history import History
from truearm.wings.laboratory.monitor.interim_check import CheckValue, InterimCheck, Withdrawal

pytestmark = pytest.mark.usefixtures("undrawn")

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")

ARM, MODEL, OTHER = "virtual-research-0", "a" * 64, "b" * 64


def check(day, size=0.01, model=MODEL, **changed):
    """Bit-safe numbers around a hundredth of a millimetre."""
    values = (CheckValue("SPAT.2s", "cone", size + 0.0001 * (day % 3), 0.001, 0.0, 10),)
    return replace(InterimCheck(datetime.datetime(2026, 1, day), model, f"{day:064x}", 20.5, values), **changed)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    ta.simulate("ur10", poses=12, seed=0, arm_seed=0).save(folder / "a.csv")
    ta.simulate("ur10", poses=8, strategy="seat", seats=2, seed=1, arm_seed=0).save(folder / "seats.csv")
    ta.simulate("ur10", poses=8, strategy="seat", seats=2, seed=1, arm_seed=1).save(folder / "other.csv")
    return folder


@pytest.fixture
def fleet(tmp_path, files):
    found = Fleet.create(tmp_path / "fleet")
    found.add(ARM, "ur10", session=files / "a.csv", model="nominal")
    found.run()
    yield found
    found.close()


def rows_of(history):
    contents = history.store.read()
    return contents.rows, contents.checksum


def test_a_registry_and_a_file_keep_the_same_rows(tmp_path, fleet):
    """The same checks, completed, repeated and withdrawn: the same rows, checksums and refusals."""
    both = History(tmp_path / "arm.sqlite"), fleet.history(ARM)
    more = replace(check(2), values=(*check(2).values, CheckValue("form", "ball", 0.02, 0.001, 0.0, 10)))
    for history in both:
        assert history.append(check(1), name="a.truearm", arm="ur10", serial_number=ARM)
        assert history.append(check(2))
        assert history.append(more)
        assert not history.append(check(1))
        history.withdraw(check(1), Withdrawal(datetime.datetime(2026, 2, 1), "the ball was dirty"))
        refuses("before the last one of 2026-01-02", history.append, check(1, session="c" * 64))
        refuses("are of arm 'ur10', the model is of arm 'ur5'", history.append, check(3), arm="ur5")
    assert rows_of(both[0]) == rows_of(both[1])
    assert both[0].head == both[1].head
    assert both[0].checks(MODEL) == both[1].checks(MODEL)
    assert both[1].models() == (MODEL,)


def test_a_check_of_the_model_in_force_is_the_state_of_the_arm(fleet, files, tmp_path):
    result = fleet.check(ARM, files / "seats.csv", date="2026-01-02")
    (row,) = fleet.registry.fits().values()
    assert result.record.check.model == row.model_sha256
    by_hand = ta.check(fleet.model_file(row.key), files / "seats.csv", tmp_path / "arm.sqlite", date="2026-01-02")
    assert by_hand.record.checks == result.record.checks
    assert (fleet.status().arms[0].checked, fleet.status().arms[0].recalibrate) == (
        "2026-01-02",
        "not enough checks yet",
    )
    again = fleet.check(ARM, files / "seats.csv")  # which the history has already
    assert (again.record.added, again.head) == (False, result.head)


@pytest.mark.parametrize(
    ("last", "what", "verdict"),
    [
        ((0.01, 0.01), "in force", "no"),
        ((0.01, 0.08), "check again", "undecided"),
        ((0.08, 0.08), "recalibrate", "yes"),
    ],
)
def test_the_verdict_of_checks_is_what_is_to_be_done(fleet, last, what, verdict):
    (row,) = fleet.registry.fits().values()
    history = fleet.history(ARM)
    for day, size in enumerate((*[0.01] * 14, *last), start=1):
        history.append(check(day, size, row.model_sha256))
    # Nobody kept a verdict, as if the program had ended before it could.
    (arm,) = fleet.status().arms
    assert (arm.what, arm.recalibrate, arm.checked) == (what, verdict, "2026-01-16")
    assert bool(arm.message) == (what != "in force")


def test_checks_of_a_model_before_say_nothing_of_the_one_in_force(fleet):
    history = fleet.history(ARM)
    for day, size in enumerate((*[0.01] * 14, 0.08, 0.08), start=1):
        history.append(check(day, size, OTHER))
    (arm,) = fleet.status().arms
    assert (arm.what, arm.recalibrate) == ("in force", "")


def test_an_arm_has_its_own_history(fleet, files):
    with pytest.raises(InputError, match=f"are of serial number '{ARM}', the model is of 'virtual-research-1'"):
        fleet.history(ARM).append(check(1), arm="ur10", serial_number="virtual-research-1")
    refuses("virtual-research-1", fleet.check, ARM, files / "other.csv")
    refuses("no arm 'x' is in the registry", fleet.history, "x")
    assert fleet.history(ARM).models() == ()


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("UPDATE checks SET record = replace(record, '20.5', '21.5') WHERE number = 1", "checksum of row 1"),
        ("DELETE FROM checks WHERE number = 2", "last rows are missing"),
        ("DELETE FROM checks", "last rows are missing"),
        ("DELETE FROM check_heads", "last rows are missing"),
    ],
)
def test_a_changed_row_is_refused(fleet, statement, message):
    history = fleet.history(ARM)
    history.append(check(1))
    history.append(check(2))
    with closing(sqlite3.connect(fleet.folder / "registry.sqlite")) as database:
        database.execute(statement)
        database.commit()
    refuses(f"checks of {ARM} in .*damaged .*{message}.*restore the database", history.checks, MODEL)


def test_of_two_writers_none_loses_a_check(fleet):
    """The second one began with the rows before the first one's."""
    first, second = fleet.history(ARM), Fleet(fleet.folder).history(ARM)
    store = second.store
    assert isinstance(store, RegisteredHistory)
    begun = second.checks(MODEL)
    assert first.append(check(1))
    assert begun == ()
    assert second.append(check(2))
    assert [one.date.day for one in first.checks(MODEL)] == [1, 2]


def test_the_command_checks_and_withdraws(truearm, fleet, files, tmp_path):
    asked = ["fleet", "check", str(fleet.folder), ARM]
    page = tmp_path / "page.html"
    for more, code, said in (
        ([str(files / "seats.csv"), "--date", "2026-01-02", "--page", str(page)], 3, "Not enough checks yet: 1 with"),
        (["--withdraw", "1", "--reason", "loose"], 0, "Check 1 of 2026-01-02 is withdrawn: loose"),
        ([], 2, "the session is missing. Try: truearm fleet check FOLDER SERIAL SESSION"),
        (["--withdraw", "1"], 2, "--withdraw needs --reason as well"),
        ([str(files / "seats.csv"), "--reason", "x"], 2, "--reason applies to --withdraw only"),
    ):
        ran = truearm(*asked, *more)
        assert (ran.code, said in ran.out + ran.err) == (code, True), ran
    assert re.search(rf"checks of {ARM} in sqlite:.*: 1 rows, last checksum [0-9a-f]{{64}}", page.read_text())
    assert json.loads(truearm("fleet", "status", fleet.folder, "--json").done().out)["arms"][0]["recalibrate"] == ""
