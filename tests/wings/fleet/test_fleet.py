"""A fleet: what is fitted once is not fitted again, one arm stops no other, no failure replaces a model."""

import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest

import truearm as ta
from frame_laws import check_frame
from refusals import refuses
from truearm.errors import InputError
from truearm.solve.executors import WorkerLost
from truearm.wings.fleet import fit_task
from truearm.wings.fleet import fleet as module
from truearm.wings.fleet.arm_list import RegisteredArm, read_arm_list
from truearm.wings.fleet.fit_task import FitRow
from truearm.wings.fleet.fleet import Fleet, FleetRun, write_results
from truearm.wings.fleet.registry import Registry

pytestmark = pytest.mark.usefixtures("undrawn")

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")


@pytest.fixture(scope="module")
def sessions(tmp_path_factory):
    """Files of readings of three virtual arms, and of a file that is none."""
    folder = tmp_path_factory.mktemp("sessions")
    for i in range(3):
        ta.simulate("ur10", poses=12, seed=i, arm_seed=i).save(folder / f"{i}.csv")
    (folder / "bad.csv").write_text("q1_deg,q2_deg\n1,2\n")
    return folder


def arms_of(sessions, *numbers):
    return [
        RegisteredArm(f"virtual-research-{i}", "ur10", model="nominal", session=str(sessions / f"{i}.csv"))
        for i in numbers
    ]


@pytest.fixture
def fleet(tmp_path):
    with_registry = Fleet.create(tmp_path / "fleet")
    yield with_registry
    with_registry.close()


def test_a_run_fits_what_changed_and_nothing_twice(fleet, sessions):
    assert fleet.add_all(arms_of(sessions, 0, 1)) == 2
    first = fleet.run()
    assert (first.n_fitted, first.failures, first.unchanged) == (2, (), ())
    assert check_frame(first, 2)["held_out_mm"].tolist() == [row.held_out_mm for row in first.rows]
    check_frame(fleet.status(), 2)
    again = fleet.run()
    assert (again.rows, len(again.unchanged)) == ((), 2)
    assert again.summary() == "Nothing to fit: 2 arms are unchanged."
    assert fleet.add_all(arms_of(sessions, 0, 1, 2)) == 1
    assert [row.serial_number for row in fleet.run().rows] == ["virtual-research-2"]


def test_the_model_in_force_is_that_of_a_fit(fleet, sessions):
    fleet.add_all(arms_of(sessions, 0))
    (row,) = fleet.run().rows
    by_hand = ta.fit("ur10", sessions / "0.csv", model="nominal")
    angles = ta.read_session(sessions / "0.csv").angles
    np.testing.assert_array_equal(fleet.model("virtual-research-0").predict(angles), by_hand.model.predict(angles))
    (state,) = fleet.status().to_dict()["arms"]
    assert ta.load_model(state["model_file"]).kind == "nominal"
    assert row.n_readings == 12
    assert row.held_out_mm == by_hand.held_out_mm[0]
    shifts = np.array([one["value"] for one in row.constants if one["name"] in ("base x", "base y", "base z")])
    np.testing.assert_array_less(np.abs(shifts), 5)  # mm; a virtual arm stands within some mm of its nominal base
    assert {one["unit"] for one in row.constants} == {"mm", "rad"}
    refuses("no model of an arm 'x'", fleet.model, "x")


def test_readings_of_another_arm_are_refused_when_they_are_added(fleet, sessions):
    with pytest.raises(InputError, match="of serial number 'virtual-research-0', the registry has them for 'C'"):
        fleet.add_all([replace(arms_of(sessions, 0)[0], serial_number="C"), *arms_of(sessions, 1)])
    assert fleet.status().arms == ()


def test_one_arm_stops_no_other(fleet, sessions, tmp_path):
    replaced = tmp_path / "c.csv"
    replaced.write_text("not yet readings\n")
    bad = RegisteredArm("B", "ur10", model="nominal", session=str(sessions / "bad.csv"))
    other = replace(arms_of(sessions, 0)[0], serial_number="C", session=str(replaced))
    fleet.add_all([bad, other, *arms_of(sessions, 1)])
    replaced.write_bytes((sessions / "0.csv").read_bytes())
    found = fleet.run()
    assert found.n_fitted == 1
    messages = {row.serial_number: row.message for row in found.failures}
    assert "bad.csv, line 1: expected 6 joints, got 2" in messages["B"]
    assert "of serial number 'virtual-research-0', the registry has them for 'C'" in messages["C"]
    assert [row.serial_number for row in fleet.run().failures] == ["B", "C"]  # said again, not tried again
    assert [one.what for one in fleet.status().arms] == ["failed", "failed", "in force"]


def test_an_arm_that_is_removed_leaves_its_results_and_comes_back(truearm, fleet, sessions):
    fleet.add_all(arms_of(sessions, 0, 1))
    (row, _) = fleet.run().rows
    assert (
        truearm("fleet", "remove", fleet.folder, row.serial_number)
        .done()
        .out.startswith(
            "virtual-research-0 is no longer in the registry, nor are its 1 session, 1 fit, 0 checks, 0 certificates."
        )
    )
    refuses("no arm 'virtual-research-0' is in the registry", fleet.remove, row.serial_number)
    fleet.registry.record(row, in_force=True)  # of a run that was under way
    assert [one.serial_number for one in fleet.status().arms] == ["virtual-research-1"]
    fleet.run()
    assert pd.read_parquet(fleet.folder / "results").serial_number.nunique() == 2
    assert fleet.add_all(arms_of(sessions, 0)) == 1
    assert fleet.run().n_fitted == 1
    assert len(pd.read_parquet(fleet.folder / "results")) == 2
    (fleet.folder / "results" / "fits.parquet").write_bytes(b"PAR1")
    refuses("the data set of results is damaged", fleet.run)


def test_new_readings_of_a_known_arm_need_no_type(truearm, fleet, sessions):
    with pytest.raises(InputError, match="no arm 'virtual-research-0' is in the registry"):
        fleet.add("virtual-research-0", session=sessions / "0.csv")
    fleet.add("virtual-research-0", "ur10")
    truearm("fleet", "add", fleet.folder, "virtual-research-0", "--session", sessions / "0.csv").done()
    (arm,) = fleet.registry.arms()
    assert (arm.arm, arm.session) == ("ur10", str(sessions / "0.csv"))


def test_a_failed_fit_replaces_no_model(fleet, sessions, tmp_path):
    fleet.add_all(arms_of(sessions, 0))
    fleet.run()
    before = fleet.registry.models_in_force()
    fleet.add("virtual-research-0", "ur10", session=sessions / "bad.csv")
    assert fleet.run().n_fitted == 0
    assert fleet.registry.models_in_force() == before
    (arm,) = fleet.status().arms
    assert arm.what == "failed"
    assert arm.held_out_mm is not None  # of the model that is still in force


def test_a_fit_worse_than_the_nominal_arm_is_not_put_in_force():
    row = FitRow("k", "A", "ur10", "s.csv", "fitted", model="kinematic", held_out_mm=0.2, nominal_mm=0.1)
    assert not row.is_usable
    assert "worse than the nominal arm; not in force. Try: add more readings, or --model nominal" in row.outcome
    good = replace(row, held_out_mm=0.05)
    assert good.is_usable
    assert str(FleetRun((row,), (good,))) == f"0 arms fitted, 1 failed; 1 arm is unchanged.\nA: {row.outcome}"
    again = FleetRun((), (good, row))
    assert again.summary() == "Nothing to fit: 2 arms are unchanged, 1 of them failed."
    assert again.failures == (row,)  # the exit code


def test_readings_of_before_bring_back_their_model(fleet, sessions, tmp_path):
    later = tmp_path / "later.csv"
    ta.simulate("ur10", poses=12, seed=7, arm_seed=0).save(later)
    fleet.add_all(arms_of(sessions, 0))
    (first,) = fleet.run().rows
    fleet.add("virtual-research-0", "ur10", session=later)
    (second,) = fleet.run().rows
    assert second.moved_mm is not None  # compared with the model that was in force
    assert fleet.registry.models_in_force() == {"virtual-research-0": second.key}
    later.write_bytes((sessions / "0.csv").read_bytes())
    fleet.run()
    assert fleet.registry.models_in_force() == {"virtual-research-0": first.key}
    assert [key for _, key in fleet.registry.histories()["virtual-research-0"]] == [first.key, second.key, first.key]


class Interrupted:
    """Stops after one task, as Ctrl-C does."""

    def results(self, function, tasks):
        yield 0, function(tasks[0])
        raise KeyboardInterrupt


class AlwaysLost:
    """Loses every task."""

    def results(self, function, tasks):
        yield from ((i, WorkerLost("killed")) for i in range(len(tasks)))


def test_an_interrupted_run_goes_on_where_it_was(fleet, sessions):
    fleet.add_all(arms_of(sessions, 0, 1, 2))
    with pytest.raises(KeyboardInterrupt):
        fleet.run(Interrupted())
    assert len(pd.read_parquet(fleet.folder / "results")) == 1
    assert fleet.run().n_fitted == 2
    assert sorted(pd.read_parquet(fleet.folder / "results").serial_number) == [
        f"virtual-research-{i}" for i in range(3)
    ]


def test_what_a_worker_lost_is_tried_again(fleet, sessions):
    fleet.add_all(arms_of(sessions, 0))
    assert [row.message for row in fleet.run(AlwaysLost()).failures] == ["killed"]
    assert fleet.status().arms[0].what == "failed"
    assert fleet.run().n_fitted == 1
    assert fleet.status().arms[0].what == "in force"


def test_a_failure_that_is_not_of_the_readings_is_tried_again(fleet, sessions, monkeypatch):
    """A full disk, or no memory: the same inputs give a model once it is mended."""

    def no_memory(*_, **__):
        raise MemoryError

    fleet.add_all(arms_of(sessions, 0))
    (fleet.folder / "models").touch()  # a file where the folder must be
    assert fleet.run().n_fitted == 0
    (fleet.folder / "models").unlink()
    with monkeypatch.context() as patched:
        patched.setattr(fit_task, "fit", no_memory)
        assert [row.message for row in fleet.run().failures] == ["MemoryError"]
    assert fleet.run().n_fitted == 1


def test_readings_that_change_during_their_fit_have_no_result(fleet, sessions, tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_bytes((sessions / "0.csv").read_bytes())
    fleet.add("virtual-research-0", "ur10", session=path, model="nominal")

    class Late:
        def results(self, function, tasks):
            ta.simulate("ur10", poses=12, seed=9, arm_seed=0).save(path)
            yield 0, function(tasks[0])

    (row,) = fleet.run(Late()).failures
    assert "its files changed during the fit" in row.message
    assert fleet.registry.models_in_force() == {}
    (row,) = fleet.run().rows
    assert fleet.registry.models_in_force() == {"virtual-research-0": row.key}


def test_a_model_file_that_is_gone_is_made_again(fleet, sessions):
    fleet.add_all(arms_of(sessions, 0))
    (row,) = fleet.run().rows
    before = fleet.model_file(row.key).read_bytes()
    fleet.model_file(row.key).unlink()
    refuses("does not exist. Try: truearm fleet run fits it again", fleet.model, "virtual-research-0")
    assert fleet.status().arms[0].what == "to be fitted"
    fleet.run()
    assert fleet.model_file(row.key).read_bytes() == before


def test_a_mistake_that_is_taken_back_leaves_no_failure(fleet, sessions, tmp_path):
    path = tmp_path / "a.csv"
    good, bad = (sessions / "0.csv").read_bytes(), (sessions / "bad.csv").read_bytes()
    path.write_bytes(good)
    fleet.add("virtual-research-0", "ur10", session=path, model="nominal")
    found = []
    for content in (good, bad, good):
        path.write_bytes(content)
        found.append(fleet.status().arms[0].what)
        fleet.run()
        found.append(fleet.status().arms[0].what)
    assert found == ["to be fitted", "in force", "to be fitted", "failed", "in force", "in force"]


def test_readings_grow_no_younger_by_another_fit(fleet, sessions):
    fleet.add_all([replace(one, every_days=30) for one in arms_of(sessions, 0)])
    (row,) = fleet.run().rows
    later = replace(row, key="another version", fitted_at="2099-01-01T00:00:00+00:00")
    due = fleet.status().arms[0].due
    fleet.registry.record(later, in_force=True)
    assert fleet.status().arms[0].due == due
    assert fleet.status(today=datetime.now() + timedelta(days=31)).arms[0].due == due


def test_two_runs_at_once_leave_every_result_once(fleet, sessions):
    """The other one records its result, and writes the data set, before this one ends."""
    fleet.add_all(arms_of(sessions, 0, 1))

    class Beside:
        def results(self, function, tasks):
            yield 0, function(tasks[0])
            other = Fleet(fleet.folder)
            other.run()
            other.close()
            yield 1, function(tasks[1])

    fleet.run(Beside())
    keys = list(pd.read_parquet(fleet.folder / "results").key)
    assert sorted(keys) == sorted(fleet.registry.fits())
    assert len(keys) == 2
    assert all(len(fleet.registry.histories()[one.serial_number]) == 1 for one in fleet.registry.arms())


def test_a_result_that_comes_while_the_data_set_is_written_is_in_it(fleet, sessions, monkeypatch):
    fleet.add_all(arms_of(sessions, 0))
    other = FitRow("other", "virtual-research-0", "ur10", "s.csv", "fitted")

    def write_late(rows, folder):
        write_results(rows, folder)
        fleet.registry.record(other, in_force=False)

    monkeypatch.setattr(module, "write_results", write_late)
    fleet.run()
    assert sorted(pd.read_parquet(fleet.folder / "results").key) == sorted(fleet.registry.fits())


def test_processes_give_the_models_of_a_serial_run(tmp_path, sessions, two_processes):
    """To the last bit: the hash of a model is that of its file."""
    hashes = []
    for name, executor in (("serial", None), ("processes", two_processes)):
        fleet = Fleet.create(tmp_path / name)
        fleet.add_all(arms_of(sessions, 0, 1))
        rows = fleet.run(executor).rows
        hashes.append([(row.key, row.model_sha256, row.held_out_mm) for row in rows])
        fleet.close()
    assert hashes[0] == hashes[1]


def test_results_are_a_data_set(fleet, sessions):
    fleet.add_all(arms_of(sessions, 0))
    fleet.run()
    fleet.run()  # adds nothing
    frame = pd.read_parquet(fleet.folder / "results")
    assert list(frame.state) == ["fitted"]
    constants = pd.DataFrame(list(frame.constants[0]))
    assert list(constants.columns) == ["name", "unit", "nominal", "value", "u"]
    assert set(constants.unit) == {"mm", "rad"}


def test_the_state_of_every_arm_worst_first(fleet, sessions):
    first, second, third = arms_of(sessions, 0, 1, 2)
    bad = RegisteredArm("B", "ur10", model="nominal", session=str(sessions / "bad.csv"))
    fleet.add_all([replace(first, every_days=30), second, bad, RegisteredArm("N", "ur10")])
    fleet.run()
    fleet.add_all([third])
    later = datetime.now(UTC) + timedelta(days=31)
    status = fleet.status(today=later)
    assert [(one.serial_number, one.what) for one in status.arms] == [
        ("B", "failed"),
        ("virtual-research-0", "due"),
        ("virtual-research-2", "to be fitted"),
        ("N", "without readings"),
        ("virtual-research-1", "in force"),
    ]
    errors = {one.serial_number: one.of_type for one in status.arms if one.of_type is not None}
    assert sum(errors.values()) == pytest.approx(2)  # of two arms about their median, which is their mean
    assert status.summary() == ("5 arms: 1 failed, 1 due, 1 to be fitted, 1 without readings, 1 in force.")


def test_the_overview_links_to_a_page_of_each_arm(fleet, sessions, tmp_path):
    bad = RegisteredArm("<b>&", "ur10", model="nominal", session=str(sessions / "bad.csv"))
    fleet.add_all([*arms_of(sessions, 0), bad])
    fleet.run()
    assert fleet.write_pages(tmp_path / "overview #1.html") == 2
    html = (tmp_path / "overview #1.html").read_text(encoding="utf-8")
    assert "<b>&" not in html
    for name in ("virtual-research-0", "&lt;b&gt;&amp;"):
        page = html.split(f'">{name}</a>')[0].rpartition('href="')[2]
        assert "#" not in page  # which would be a place in a page
        page = unquote(page)
        history = (tmp_path / page).read_text(encoding="utf-8")
        assert name in history
        assert '<a href="../overview%20%231.html">All arms of the fleet</a>' in history
    histories = "".join(path.read_text(encoding="utf-8") for path in (tmp_path / "overview #1-arms").iterdir())
    assert str(fleet.model_file(*fleet.registry.models_in_force().values())) in histories
    assert html.index("&lt;b&gt;&amp;</a> <small>") < html.index("expected 6 joints, got 2") < html.index("</small>")


BAD = [
    ({"serial_number": " "}, "expected a serial number"),
    ({"serial_number": "a\nb"}, "control character"),
    ({"serial_number": "a" * 201}, "at most 200 characters"),
    ({"arm": "ur11"}, "ur11"),
    ({"model": "best"}, "expected a model among"),
    ({"every_days": 0}, "of 1 to 36500, got 0"),
    ({"every_days": 10**9}, "of 1 to 36500"),  # a day after the last one of the calendar
    ({"serial_number": "a\udcff"}, "serial_number of Unicode characters"),  # a file name that is not UTF-8
    ({"session": "nowhere.csv"}, "does not exist"),
]


@pytest.mark.parametrize(("changed", "message"), BAD, ids=lambda one: str(one)[:30])
def test_an_arm_that_cannot_be_is_refused(fleet, sessions, changed, message):
    """And with it all others of the list."""
    refuses(message, fleet.add_all, [*arms_of(sessions, 0), replace(arms_of(sessions, 1)[0], **changed)])
    assert fleet.registry.arms() == []


def test_an_arm_of_another_type_is_refused(fleet, sessions):
    fleet.add_all(arms_of(sessions, 0))
    assert fleet.add("virtual-research-0", "UR-10") == 0  # another way to write it
    refuses("is in the registry as an arm 'ur10', got 'ur5'", fleet.add, "virtual-research-0", "ur5")


def test_a_list_as_a_spreadsheet_saves_it(tmp_path):
    path = tmp_path / "arms.csv"
    path.write_bytes("serial_number;arm;site;every_days;note\n007;ur10;Malmö;365;x\nA-2;ur5;;;\n".encode("cp1252"))
    assert read_arm_list(path) == [RegisteredArm("007", "ur10", "Malmö", every_days=365), RegisteredArm("A-2", "ur5")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("serial_number\nA\n", "the column arm is missing"),
        ("serial_number,arm,colour\nA,ur10,red\n", "unknown column 'colour'"),
        ("serial_number,arm\nA,\n", "line 2, column 'arm'"),
        ("serial_number,arm,every_days\nA,ur10,soon\n", "line 2, column 'every_days'"),
        ("serial_number,arm,model\nA,ur10,best\n", "line 2, column 'model'"),
    ],
)
def test_a_list_with_a_mistake_names_its_place(tmp_path, text, message):
    (tmp_path / "arms.csv").write_text(text)
    refuses(message, read_arm_list, tmp_path / "arms.csv")


def test_a_folder_that_is_none_of_a_fleet(tmp_path):
    refuses("expected the folder of a fleet", Fleet, tmp_path)
    (tmp_path / "fleet.toml").write_text("[fleet]\n")
    refuses("database", Fleet, tmp_path)
    (tmp_path / "fleet.toml").write_text('[fleet]\ndatabase = "sqlite:///other.sqlite"\n')
    (tmp_path / "other.sqlite").touch()
    refuses("another database", Fleet, tmp_path)


def test_a_fleet_is_not_made_twice(fleet):
    refuses("already", Fleet.create, fleet.folder)


@pytest.mark.parametrize("url", ["registry.sqlite", "nosql://host/fleet", "postgresql+psycopg://host:port/fleet"])
def test_a_url_that_is_none(url):
    refuses("the database cannot be opened", Registry, url)


@pytest.mark.parametrize(
    "url",
    [
        "postgresql+psycopg://user:secret@host/fleet",
        "postgresql://host/f?password=secret",
        "postgresql://host/f?sslpassword=secret",
    ],
)
def test_no_password_is_written_or_shown(tmp_path, url):
    assert "secret" not in str(refuses("without a password", Fleet.create, tmp_path / "fleet", database=url))
    assert not (tmp_path / "fleet" / "fleet.toml").exists()


@pytest.mark.parametrize("url", ["sqlite://", "sqlite:///:memory:"])
def test_a_registry_in_memory_is_refused(tmp_path, url):
    refuses("gone with the program", Fleet.create, tmp_path, database=url)


@pytest.mark.parametrize("url", ["sqlite:///r.sqlite", "sqlite+pysqlite:///r.sqlite"])
def test_a_file_of_sqlite_is_in_the_folder_whatever_its_name(tmp_path, url):
    folder = tmp_path / ("100 % #1" + "?" * (sys.platform != "win32"))
    Fleet.create(folder, database=url).close()
    assert (folder / "r.sqlite").is_file()


def test_a_registry_that_is_gone_is_not_made_anew(fleet):
    (fleet.folder / "registry.sqlite").unlink()
    refuses("does not exist. Try: restore it from a backup", Fleet, fleet.folder)
    assert not (fleet.folder / "registry.sqlite").exists()


def test_what_is_given_again_replaces_what_was_before(fleet, tmp_path):
    first, second = (tmp_path / name for name in ("0.csv", "1.csv"))
    for file in (first, second):
        file.write_text("of no stated arm\n")
    fleet.add_all([RegisteredArm("A", "ur10", "Turin", "kinematic", 30, str(first))])
    assert fleet.add(" A ", "ur10", session=second) == 1
    assert fleet.registry.arms() == [RegisteredArm("A", "ur10", "Turin", "kinematic", 30, str(second))]
    assert fleet.add("A", "ur10", site="Oslo", model="nominal", every_days=60) == 1
    assert fleet.add("A", "ur10", site="Oslo") == 0
    assert fleet.registry.arms() == [RegisteredArm("A", "ur10", "Oslo", "nominal", 60, str(second))]
    assert fleet.add("A", "ur10", session=first) == 1  # readings of before are the last ones again
    assert fleet.registry.arms()[0].session == str(first)
