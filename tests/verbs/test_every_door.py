"""What goes out comes in: every kind of file is read back before it replaces anything, models of every door."""

import datetime
from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.arm import write_arm
from truearm.errors import InputError, ProgramFault
from truearm.files import atomic_write
from truearm.readings import write_lengths
from truearm.wings.bench.recording.model_in_force import ModelInForce
from truearm.wings.laboratory.monitor.history_rows import CheckRow, HistoryRows, checksum_of_new, encode_check
from truearm.wings.laboratory.monitor.interim_check import CheckValue, InterimCheck


@pytest.fixture(scope="module")
def line(ur10_session, tmp_path_factory):
    """A large session: a folder of two files."""
    folder = tmp_path_factory.mktemp("line")
    for name, rows in (("a", np.arange(30)), ("b", np.arange(30, 60))):
        ur10_session.rows(rows).save(folder / f"{name}.csv")
    return folder


@pytest.mark.parametrize("kind", [pytest.param("nominal", marks=pytest.mark.weekly), "kinematic"])
def test_a_model_of_every_door_is_one_that_every_command_reads(ur10_session, line, tmp_path, kind):
    out = tmp_path / "m.truearm"
    small = ta.fit("ur10", ur10_session, model=kind)
    doors = {
        "small": small.save,
        "large": ta.fit("ur10", line, model=kind).save,
        "refit": ta.refit(small.model, ur10_session, n_readings=20).save,
        "model": small.model.save,
    }
    for door, save in doors.items():
        save(out)
        assert ta.load_model(out).kind == kind, door
    out.unlink()
    live = ModelInForce(ta.load_arm("ur10"), small.model, tmp_path / "none.csv", out)
    assert live.save().kind == "notice"
    assert ta.load_model(out).kind == kind


def test_a_model_of_a_fleet_is_one_that_every_command_reads(ur10_session, tmp_path):
    pytest.importorskip("sqlalchemy")
    ur10_session.rows(np.arange(20)).save(tmp_path / "a.csv")
    fleet = ta.Fleet.create(tmp_path / "fleet")
    fleet.add("virtual-research-0", "ur10", session=tmp_path / "a.csv", model="nominal")
    assert fleet.run().n_fitted == 1
    assert fleet.model("virtual-research-0").kind == "nominal"
    fleet.close()


@pytest.fixture
def unreadable(monkeypatch):
    """All readers refuse what they read back."""
    read = atomic_write.read_back

    def refuse(_):
        raise InputError("nothing is right")

    monkeypatch.setattr(atomic_write, "read_back", lambda reader, written: read(reader and refuse, written))


def writers(session):
    model = ta.fit("ur10", session, model="nominal").model
    arm = ta.load_arm("ur10")
    lengths = ta.Lengths(["A"], ["B"], [500.0], [0.01])
    return {
        "m.truearm": model.save,
        "s.csv": session.save,
        "l.csv": lambda path: write_lengths(lengths, path),
        "a.toml": lambda path: write_arm(arm, path),
        "a.urdf": lambda path: write_arm(arm, path),
        "p.csv": ta.predict(model, session).save,
        "e.json": lambda path: ta.export(model, path),
        "u.urdf": lambda path: ta.export(model, path),
        "f.csv": lambda path: ta.operator_sheet("iso10360-12").save_points(path, force=True),
    }


def test_no_writer_replaces_a_file_by_one_that_its_reader_refuses(ur10_session, tmp_path, unreadable):
    for name, write in writers(ur10_session).items():
        path = tmp_path / name
        with pytest.raises(ProgramFault, match="cannot read back what it wrote"):
            write(path)
        assert not any(tmp_path.iterdir()), name


def test_a_model_that_cannot_be_read_is_a_fault_of_the_program_and_the_old_one_stays(
    ur10_session, tmp_path, monkeypatch
):
    out = tmp_path / "m.truearm"
    model = ta.fit("ur10", ur10_session, model="kinematic").model
    model.save(out)
    before = out.read_bytes()
    groups = tuple(replace(one, effective=-1.1e-4) for one in model.fit_.groups)
    monkeypatch.setattr(model, "fit_", replace(model.fit_, groups=groups))
    with pytest.raises(ProgramFault, match="expected numbers of 0 or more of the groups"):
        model.save(out)
    assert out.read_bytes() == before


def test_a_row_of_a_history_that_cannot_be_read_is_not_added():
    day = datetime.datetime(2026, 11, 28)
    value = CheckValue("form", "cone", value_mm=0.01, u_mm=0.002, u_artefact_mm=0.0, n=10)
    check = InterimCheck(date=day, model="f" * 64, session="0" * 64, values=(value,), temperature_degC=20.0)
    with pytest.raises(ProgramFault, match="expected printable names"):
        checksum_of_new(encode_check(CheckRow(check, "two\nlines", "ur10")), HistoryRows(()))
    assert len(checksum_of_new(encode_check(CheckRow(check, "one line", "ur10")), HistoryRows(()))) == 64
