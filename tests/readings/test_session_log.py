"""A session file that grows: what is acknowledged is in it, whatever happens next."""

import os
from dataclasses import fields

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError, TruearmError
from truearm.readings import read_session
from truearm.wings.bench.recording import session_log
from truearm.wings.bench.recording.session_log import SessionLog

COLUMNS = ("q1_deg", "q2_deg", "seat", "note_time")
ROW = {"q1_deg": 0.1, "q2_deg": -2.5, "seat": "A", "note_time": "now"}


def test_the_file_is_a_session_after_every_reading(tmp_path):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        for n in range(1, 4):
            log.append({**ROW, "seat": "cone, left" if n == 2 else "=A1"})
            assert len(read_session(path)) == n
    assert read_session(path).seat.tolist() == ["=A1", "cone, left", "=A1"]


def outcome(session):
    """All fields of a session, or why it is none."""
    try:
        found = session()
    except InputError as error:
        return str(error)
    return {field.name: getattr(found, field.name) for field in fields(found)}


def test_what_is_read_reading_by_reading_is_the_session_of_the_file(tmp_path):
    """Also without a point or a temperature at first or later, and after an undone reading and a seat that is named."""
    path = tmp_path / "session.csv"
    columns = ("q1_deg", "q2_mm", "x_mm", "y_mm", "z_mm", "seat", "temperature_degC", "payload_kg", "note_time")
    point = {"x_mm": 1.5, "y_mm": 0.1 + 0.2, "z_mm": -1e-7}
    own = [{}, {}, point, {"seat": "B, left"}, {**point, "seat": "=A1"}, {}, {"temperature_degC": 21.5}, {}]
    warm = {"temperature_degC": 20.25, "payload_kg": 2.5}
    with SessionLog(path, columns) as log:
        for n, more in enumerate(own):
            log.append({"q1_deg": n / 7, "q2_mm": -n * 1e3, **({} if n == 5 else warm), **more})
            found, expected = outcome(log.session), outcome(lambda: read_session(path))
            if n == 5:
                assert found == expected  # why it is no session
                log.undo()
            elif n == 2:
                log.name_seat("late")
            found, expected = outcome(log.session), outcome(lambda: read_session(path))
            np.testing.assert_equal(found, expected)


def test_a_reading_is_read_once(tmp_path, monkeypatch):
    lines = []

    def form_of(data, path, plain=session_log.form_of):
        lines.append(data.count(b"\n"))
        return plain(data, path)

    monkeypatch.setattr(session_log, "form_of", form_of)
    monkeypatch.setattr(
        session_log, "read_session", lambda path, plain=read_session: lines.append("all") or plain(path)
    )
    with SessionLog(tmp_path / "session.csv", COLUMNS) as log:
        for _ in range(4):
            log.append(ROW)
            log.session()
    assert lines == ["all", 2, 2, 2]  # the header, and one reading


def test_a_file_that_a_person_changed_is_read_whole(tmp_path):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
        log.session()
        whole = path.read_text()
        path.write_text(whole + "what is this\n")
        refuses("line 3", log.session)
        path.write_text(whole)
        assert len(log.session()) == 1


def test_a_file_is_continued(tmp_path):
    path = tmp_path / "session.csv"
    for _ in range(3):
        with SessionLog(path, COLUMNS) as log:
            log.append(ROW)
    assert len(log.rows) == 3
    assert path.read_text().splitlines() == [",".join(COLUMNS), *["0.1,-2.5,A,now"] * 3]


def test_undo_removes_the_last_reading_only(tmp_path):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
        before = path.read_bytes()
        log.append({**ROW, "seat": "B"})
        assert log.undo()["seat"] == "B"
        assert path.read_bytes() == before
        log.undo()
        assert log.undo() is None
        assert path.read_text() == ",".join(COLUMNS) + "\n"
        log.append(ROW)
    assert path.read_bytes() == before


def test_a_seat_is_named_afterwards_in_one_write_or_not_at_all(tmp_path, monkeypatch):
    path, written, write = tmp_path / "session.csv", [], os.write

    def full_at_first(handle, line):
        written.append(line)
        return write(handle, line[:12] if len(written) == 1 else line)

    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
        log.append({**ROW, "seat": ""})
        before = path.read_bytes()
        monkeypatch.setattr(os, "write", full_at_first)
        with pytest.raises(TruearmError, match="the disk is full"):
            log.name_seat("B")
        assert path.read_bytes() == before
        log.name_seat("B")
        assert written[2:] == [b"0.1,-2.5,B,now\n"]
        log.append(ROW)
    assert read_session(path).seat.tolist() == ["A", "B", "A"]


@pytest.mark.parametrize("cut", range(1, 15))
def test_a_line_cut_short_is_removed_or_was_whole(tmp_path, cut):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
        before = path.read_bytes()
        log.append({**ROW, "seat": "B"})
    path.write_bytes(path.read_bytes()[:-cut])
    with SessionLog(path, COLUMNS) as log:
        is_whole = cut <= 4  # the line's end and the note alone
        assert len(log.rows) == (2 if is_whole else 1)
        assert bool(log.repaired) != is_whole
        assert path.read_bytes() == before or is_whole
    read_session(path)


def test_a_name_that_a_spreadsheet_would_run_is_mended_as_it_was(tmp_path):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        log.append({**ROW, "seat": "=A"})
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    SessionLog(path, COLUMNS).close()
    assert path.read_bytes() == whole


def test_a_row_of_another_number_of_cells_is_refused_in_its_line(tmp_path):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
    for broken in (b"\n", b"1,2\n"):
        before = path.read_bytes() + broken
        path.write_bytes(before)
        refuses(r"session\.csv, line 3: expected 4 values", SessionLog, path, COLUMNS)
        assert path.read_bytes() == before
        path.write_bytes(before.removesuffix(broken))


def test_a_file_that_another_recording_has_open_is_refused_and_free_after_it(tmp_path):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        refuses("another program records to the file", SessionLog, path, COLUMNS)
        log.append(ROW)
    refuses("with other columns", SessionLog, path, (*COLUMNS, "note_pose"))
    with SessionLog(path, COLUMNS) as log:
        assert len(log.rows) == 1


@pytest.mark.parametrize("length", [0, 3])
def test_a_file_that_was_only_begun_is_begun_again(tmp_path, length):
    path = tmp_path / "session.csv"
    path.write_text(",".join(COLUMNS)[:length])
    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
    assert path.read_text().splitlines() == [",".join(COLUMNS), "0.1,-2.5,A,now"]


def test_other_columns_are_refused_and_nothing_is_changed(tmp_path):
    path = tmp_path / "session.csv"
    path.write_text("q1_deg,seat\n1,A\n")
    refuses("with other columns", SessionLog, path, COLUMNS)
    assert path.read_text() == "q1_deg,seat\n1,A\n"
    refuses(r"ends in \.csv", SessionLog, tmp_path / "session.parquet", COLUMNS)


@pytest.mark.parametrize("change", ["replaced", "removed", "longer"])
def test_a_file_that_another_program_changed_is_not_written(tmp_path, change):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
        if change == "replaced":
            (tmp_path / "new").write_bytes(path.read_bytes())
            os.replace(tmp_path / "new", path)
        elif change == "removed":
            path.unlink()
        else:
            path.write_bytes(path.read_bytes() + b"1,2,C,\n")
        for act in (lambda: log.append(ROW), log.undo):
            with pytest.raises(TruearmError, match="another program changed the file"):
                act()


def test_a_full_disk_leaves_the_file_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        log.append(ROW)
        before, write = path.read_bytes(), os.write
        monkeypatch.setattr(os, "write", lambda handle, line: write(handle, line[:5]))
        with pytest.raises(TruearmError, match="the disk is full"):
            log.append(ROW)
        assert path.read_bytes() == before
        monkeypatch.undo()
        log.append(ROW)
    assert len(read_session(path)) == 2


class Disk:
    """A clock that a test sets, and the sizes of the file when it was written to the disk."""

    def __init__(self, monkeypatch):
        self.s, self.sizes, fsync = 0.0, [], os.fsync
        monkeypatch.setattr("truearm.wings.bench.recording.session_log.time.monotonic", lambda: self.s)

        def synced(handle):
            self.sizes.append(os.fstat(handle).st_size)
            fsync(handle)

        monkeypatch.setattr(os, "fsync", synced)


def test_every_reading_and_every_undo_is_on_the_disk_when_it_is_acknowledged(tmp_path, monkeypatch):
    disk, path = Disk(monkeypatch), tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        assert disk.sizes[-1] == path.stat().st_size
        for act in (lambda: log.append(ROW), lambda: log.append(ROW), log.undo):
            disk.s += 0.1
            act()
            assert disk.sizes[-1] == path.stat().st_size
            assert log.settle() is None


def test_of_many_readings_the_disk_is_written_ten_times_a_second_and_the_last_is_on_it(tmp_path, monkeypatch):
    disk, path = Disk(monkeypatch), tmp_path / "session.csv"
    with SessionLog(path, COLUMNS) as log:
        disk.sizes.clear()
        for n in range(100):
            disk.s = n / 64  # exact in binary
            log.append(ROW)
        assert 10 <= len(disk.sizes) <= 16  # of 1.55 s
        disk.s += (due_s := log.settle())
        assert 0 < due_s <= 0.1
        assert log.settle() is None
        assert disk.sizes[-1] == path.stat().st_size
        log.append(ROW)
        assert disk.sizes[-1] < path.stat().st_size
    assert disk.sizes[-1] == path.stat().st_size
