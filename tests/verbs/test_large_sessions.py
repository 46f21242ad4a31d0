"""Large sessions: parts together are the whole, whoever computes them; a fault is in its line and leaves nothing."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.readings import files, large_sessions, read_session
from truearm.readings.files import is_large
from truearm.readings.large_sessions import LargeSession
from truearm.solve.executors import Serial

N = 3000


@pytest.fixture(scope="module")
def session():
    return ta.simulate("ur10", poses=N, seed=1, strategy="box").session


@pytest.fixture(scope="module")
def model(session):
    return ta.fit("ur10", session.rows(np.arange(200)), model="kinematic").model


@pytest.fixture(scope="module")
def folder(session, tmp_path_factory):
    """A data set of CSV and Parquet in folders, in the order of the names."""
    pyarrow = pytest.importorskip("pyarrow.parquet")
    path = tmp_path_factory.mktemp("set") / "readings"
    (path / "b").mkdir(parents=True)
    session.rows(np.arange(1000)).save(path / "a.csv")
    session.rows(np.arange(1000, N)).save(path / "b" / "rest.parquet")
    table = pyarrow.read_table(path / "b" / "rest.parquet")
    pyarrow.write_table(table, path / "b" / "rest.parquet", row_group_size=700)
    (path / ".hidden.csv").write_text("no session")
    return path


@pytest.mark.parametrize("part_bytes", [2000, 2**23])
def test_parts_together_are_the_session(folder, session, part_bytes, monkeypatch):
    monkeypatch.setattr(large_sessions, "MAX_READINGS", 300)
    large = LargeSession.open(folder, n_joints=6, part_bytes=part_bytes)
    assert len(large) == N
    found = large_sessions.joined_sessions([one for part in large.parts for one in part.sessions()])
    assert np.allclose(found.angles, session.angles, rtol=1e-12, atol=0)
    assert np.array_equal(found.points, session.points)
    assert np.array_equal(found.serial_number, session.serial_number)
    assert np.array_equal(found.numbers[:1000], np.arange(2, 1002))  # lines of the file
    assert np.array_equal(found.numbers[1000:], np.arange(1, N - 999))
    rows = np.unique(np.linspace(0, N - 1, 77).astype(int))
    sample = large.sample(77)
    assert np.array_equal(sample.points, session.points[rows])
    assert np.array_equal(sample.numbers, rows + 1)  # of all files
    assert sample.stride == N / 77


def test_a_large_session_is_a_folder_or_a_file_beyond_the_limit(folder, monkeypatch, tmp_path):
    assert is_large(folder)
    assert not is_large(folder / "a.csv")
    assert not is_large(tmp_path / "missing.csv")
    monkeypatch.setattr(files, "MAX_BYTES", 1000)
    monkeypatch.setattr(files, "MAX_CELLS", 100)
    assert is_large(folder / "a.csv")
    assert is_large(folder / "b" / "rest.parquet")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_points_are_those_of_the_whole_session_whoever_computes_them(
    folder, session, model, two_processes, tmp_path, ending
):
    found = ta.predict(model, folder, tmp_path / f"a.{ending}")
    ta.predict(model, folder, tmp_path / f"b.{ending}", executor=two_processes if ending == "csv" else Serial())
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()
    whole = ta.predict(model, session)
    pandas = pytest.importorskip("pandas")
    read = pandas.read_csv if ending == "csv" else pandas.read_parquet
    table = read(tmp_path / f"a.{ending}")
    assert np.allclose(table[["x_mm", "y_mm", "z_mm"]], whole.points, atol=2e-6)
    assert np.allclose(table[["sx_mm", "sy_mm", "sz_mm"]], whole.u_mm, atol=2e-6)
    assert (table.note_file[0], table.note_line[0]) == ("a.csv", 2)
    assert len(table[["note_file", "note_line"]].drop_duplicates()) == len(table)
    assert np.array_equal(table["outside_training"], whole.outside_training)
    assert found.to_dict()["median_u_mm"] == pytest.approx(np.median(whole.u_mm), rel=2e-3)
    assert found.sums.n_outside == whole.sums.n_outside == whole.outside_training.sum()
    for lacking in (lambda: found.points, found.to_frame, lambda: ta.predict(model, folder)):
        refuses("points of a session in parts", lacking)


def test_errors_and_coverage_are_those_of_the_whole_session(folder, session, model, two_processes):
    parts, whole = ta.evaluate(model, folder), ta.evaluate(model, session)
    for name, errors in parts.errors.items():
        for figure, value in errors.items():
            assert value == pytest.approx(whole.errors[name][figure], rel=2e-3 if "p95" in figure else 1e-9)
    assert parts.coverage == whole.coverage
    assert parts.sums.stated["reproducibility"].n_covered_99 == whole.budget.n_covered_99
    assert parts.to_dict()["combined_u_mm"] == pytest.approx(whole.budget.combined_mm)
    again = ta.evaluate(model, folder, executor=two_processes)
    assert again.to_dict() == parts.to_dict()
    assert set(whole.to_dict()) <= set(parts.to_dict())
    assert parts.figure() is None
    refuses("lengths are not compared", ta.evaluate, model, folder, lengths="lengths.csv")


@pytest.mark.parametrize("without", [0, pytest.param(1, marks=pytest.mark.weekly), 2])
def test_a_part_without_points_takes_no_other_away(truearm, session, model, tmp_path, without):
    pytest.importorskip("pyarrow")
    pandas, folder = pytest.importorskip("pandas"), tmp_path / "set"
    folder.mkdir()
    points = session.points[:60].copy()
    points[20 * without : 20 * without + 20] = np.nan
    some = replace(session.rows(np.arange(60)), points=points, point_std=None)
    some.save(folder / "a.parquet")
    pandas.read_parquet(folder / "a.parquet").to_parquet(folder / "a.parquet", row_group_size=20)
    whole, parts = ta.evaluate(model, some), ta.evaluate(model, folder)
    assert parts.errors["model"]["n"] == whole.errors["model"]["n"] == 40
    assert parts.coverage == whole.coverage
    assert np.array_equal(LargeSession.open(folder).sample(60).points, points, equal_nan=True)
    assert ta.fit("ur10", folder, model="nominal").all_readings.total.sums.n == 40
    command = ["split", folder, "--train", tmp_path / "a.csv", "--test", tmp_path / "b.csv", "--by", "session"]
    frame = pandas.read_parquet(folder / "a.parquet")
    frame.assign(session=np.repeat(["1", "2"], [59, 1])).to_parquet(folder / "a.parquet", row_group_size=20)
    truearm(*command).done()
    split = [ta.read_session(tmp_path / name) for name in ("a.csv", "b.csv")]
    assert sum(int(one.has_point.sum()) for one in split) == 40


def test_a_part_beyond_the_limits_is_skipped_as_in_a_small_session(session, model, tmp_path):
    few, folder = session.rows(np.arange(60)), tmp_path / "set"
    folder.mkdir()
    angles = few.angles.copy()
    angles[57:, 0] = 7.0
    beyond = replace(few, angles=angles)
    for name, rows in (("a", np.arange(57)), ("b", np.arange(57, 60))):
        beyond.rows(rows).save(folder / f"{name}.csv")
    whole, parts = ta.evaluate(model, beyond), ta.evaluate(model, folder)
    assert parts.errors["model"]["n"] == 57
    assert parts.errors["model"]["mean_mm"] == pytest.approx(whole.errors["model"]["mean_mm"], rel=1e-9)
    assert ta.fit("ur10", folder, model="nominal").all_readings.total.sums.n == 57
    (folder / "a.csv").unlink()
    refuses("3 of 3 readings are outside the limits of a joint", ta.evaluate, model, folder)


def test_readings_beyond_a_joint_limit_are_named_with_their_file(session, model, tmp_path):
    """In a fit by lines of the files, though a sample counts its readings through all of them."""
    path = tmp_path / "readings"
    path.mkdir()
    for name, row in (("a.csv", 3), ("b.csv", 7)):
        angles = session.angles[:40].copy()
        angles[row, 2] += 4 * np.pi
        replace(session.rows(np.arange(40)), angles=angles).save(path / name)
    said = "2 of 80 readings are beyond a joint limit and were skipped: line 5 of a.csv, line 9 of b.csv."
    assert said in ta.fit("ur10", path, model="nominal").remarks
    for remarks in (ta.evaluate(model, path).remarks, ta.predict(model, path, tmp_path / "p.csv").remarks):
        for name in ("a.csv", "b.csv"):
            assert any(one.startswith(f"{name}: 1 of 40 readings is beyond a joint limit") for one in remarks)


def test_readings_of_the_training_are_recognised(session, folder, tmp_path, monkeypatch):
    own = tmp_path / "own"
    own.mkdir()
    for name, rows in (("a", np.arange(120)), ("b", np.arange(120, 200))):
        session.rows(rows).save(own / f"{name}.csv")
    monkeypatch.setattr(large_sessions, "SAMPLE", 70)
    model = ta.fit("ur10", own, model="nominal").model
    said = "about 200 of 200 are training readings of the model (its file knows 70 of 200)"
    assert any(said in remark for remark in ta.evaluate(model, own).remarks)
    assert not any(said in remark for remark in ta.evaluate(model, folder).remarks)


def test_a_page_shows_a_sample_and_the_errors_of_all(folder, model, undrawn, tmp_path, monkeypatch):
    monkeypatch.setattr(large_sessions, "SAMPLE", 300)
    found = ta.report({"ours": model}, folder, tmp_path / "page.html")
    errors = ta.evaluate(model, folder).errors["model"]
    sample, of_all = found.of_large
    assert sample.startswith("Figures and tables are of 300 of 3000 readings")
    assert of_all.startswith(f"ours, all {N - 200} readings: mean error {errors['mean_mm']:.4f} mm")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert sample in page
    assert of_all in page
    assert not ta.report(model, folder / "a.csv").of_large


def test_a_file_has_one_encoding(tmp_path):
    """Windows' encoding of a later part shows what the bytes of an earlier one are, which UTF-8 would have too."""
    rows = [f"{i},5;{'Ã¼' if i < 20 else 'ü'}" for i in range(40)]
    (tmp_path / "s.csv").write_bytes("\n".join(["q1_deg;seat", *rows, ""]).encode("cp1252"))
    large = LargeSession.open(tmp_path / "s.csv", part_bytes=100)
    assert len(large.parts) > 2
    found = large_sessions.joined_sessions([one for part in large.parts for one in part.sessions()])
    assert found.seat.tolist() == read_session(tmp_path / "s.csv").seat.tolist() == ["Ã¼"] * 20 + ["ü"] * 20


def test_a_fault_is_in_its_line_and_no_table_is_written(session, model, tmp_path):
    file = tmp_path / "s.csv"
    session.save(file)
    lines = file.read_text().splitlines(keepends=True)
    lines[2500] = lines[2500].replace(",", ",x", 1)
    file.write_text("".join(lines))
    large = LargeSession.open(file, part_bytes=10_000)
    with pytest.raises(InputError) as caught:
        [one for part in large.parts for one in part.sessions()]
    assert caught.value.line == 2501
    with pytest.raises(InputError) as caught:
        large.sample(N)
    assert caught.value.line == 2501
    refuses("line 2501", ta.predict, model, file, tmp_path / "p.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["s.csv"]


def test_an_empty_row_between_parts_is_refused(session, tmp_path):
    file = tmp_path / "s.csv"
    session.rows(np.arange(9)).save(file)
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join([*lines[:5], b"\n", *lines[5:], b"\n\n"]))
    size = sum(map(len, lines[1:5])) + 1
    with pytest.raises(InputError, match="line 6: expected numbers, got an empty row"):
        [one for part in LargeSession.open(file, part_bytes=size - 1).parts for one in part.sessions()]
    file.write_bytes(b"".join([*lines, b"\n\n"]))  # at the end it is none
    assert len(LargeSession.open(file)) == len(read_session(file)) == 9


def test_rows_without_a_cell_at_the_end_are_none_as_in_a_small_session(session, tmp_path):
    file = tmp_path / "s.csv"
    session.rows(np.arange(9)).save(file)
    lines = file.read_bytes().splitlines(keepends=True)
    nothing = b"," * lines[0].count(b",") + b"\r\n"
    file.write_bytes(b"".join([*lines, nothing, nothing]))
    large = LargeSession.open(file)
    assert sum(len(one) for part in large.parts for one in part.sessions()) == len(read_session(file)) == 9


def test_rows_that_are_not_filled_in_are_no_readings_of_a_sample(session, tmp_path):
    for name in ("a.csv", "b.csv"):
        session.rows(np.arange(5)).save(tmp_path / name)
    lines = (tmp_path / "a.csv").read_text().splitlines()
    lines[3] = "," * lines[0].count(",")
    small = [line + (",A" if i else ",seat") for i, line in enumerate(lines)]
    (tmp_path / "a.csv").write_text("\n".join(small) + "\n")
    (tmp_path / "b.csv").write_text("\n".join([small[0], *small[1:3]]) + "\n")
    assert len(read_session(tmp_path / "a.csv")) == 4
    sample = LargeSession.open(tmp_path).sample(100)
    assert sample.numbers.tolist() == [1, 2, 4, 5, 6, 7]


def test_no_file_of_a_folder_is_left_out_unsaid(session, tmp_path):
    few = session.rows(np.arange(9))
    few.save(tmp_path / "b.csv")
    content = (tmp_path / "b.csv").read_bytes()
    (tmp_path / "A.CSV").write_bytes(content)
    (tmp_path / "folder.csv").mkdir()
    assert len(LargeSession.open(tmp_path)) == 18
    (tmp_path / "A.CSV").write_bytes(content.replace(b"\n", b"\r"))
    refuses("old Macintosh", LargeSession.open, tmp_path)


def test_columns_that_pandas_had_as_its_index_are_columns(session, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    file = tmp_path / "s.parquet"
    session.rows(np.arange(9)).save(file)
    pandas.read_parquet(file).set_index("q1_deg").to_parquet(file)
    large = LargeSession.open(file)
    found = large_sessions.joined_sessions([one for part in large.parts for one in part.sessions()])
    assert np.array_equal(found.angles, read_session(file).angles)


def test_readings_in_the_folder_are_not_overwritten(session, model, tmp_path):
    folder = tmp_path / "set"
    folder.mkdir()
    session.rows(np.arange(9)).save(folder / "a.csv")
    session.rows(np.arange(9)).save(tmp_path / "other.csv")
    (folder / "b.csv").symlink_to(tmp_path / "other.csv")
    for out in (folder / "a.csv", folder / "new.csv", tmp_path / "other.csv"):
        refuses("one of the readings in the folder", ta.predict, model, folder, out)
    assert ta.predict(model, folder, tmp_path / "points.csv").sums.n == 18


def test_what_is_no_data_set_is_refused(session, tmp_path):
    refuses("expected session files", LargeSession.open, tmp_path)
    session.save(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n1,2,3,4,5,6\n")
    refuses(r"b\.csv.*expected the columns of a\.csv", LargeSession.open, tmp_path)
    (tmp_path / "a.csv").unlink()
    refuses("expected 7 joints, got 6", LargeSession.open, tmp_path, n_joints=7)
    (tmp_path / "b.csv").write_text("q1_deg\n")
    refuses("at least one reading", LargeSession.open, tmp_path)
    (tmp_path / "b.parquet").write_bytes(b"PAR1 and no more")
    refuses("expected a Parquet file", LargeSession.open, tmp_path)
