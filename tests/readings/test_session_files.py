"""The session file: what comes back is what was written, and a fault names its file, line, column and remedy."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from refusals import refuses
from truearm.errors import InputError, TruearmError
from truearm.files import delimited
from truearm.readings import Session, files, read_session, write_session

HEADER = "q1_deg,q2_deg,x_mm,y_mm,z_mm\n"
GOOD = HEADER + "10,20,1,2,3\n-30,40.5,4,5,6\n"


def text_file(folder: Path, text: str | bytes, name: str = "session.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(folder: Path, text: str | bytes, **options: int) -> InputError:
    path = text_file(folder, text)
    caught = refuses(None, read_session, path, **options)
    assert caught.file == path
    return caught


finite = st.floats(-1e6, 1e6, allow_subnormal=False)
words = st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=8)


NAMES = ("seat", "sphere", "plane", "line", "position", "session")


@st.composite
def any_readings(draw: st.DrawFn) -> Session:
    n, joints = draw(st.integers(1, 5)), draw(st.integers(1, 7))
    name = st.lists(words, min_size=n, max_size=n).map(np.array)
    gone = draw(arrays(bool, (n,)))
    points = draw(st.none() | arrays(float, (n, 3), elements=finite))
    std = None if points is None else draw(st.none() | arrays(float, (n, 3), elements=st.floats(1e-6, 10)))
    for values in (points, std):
        if values is not None:
            values[gone] = np.nan
    turn = draw(st.none() | arrays(float, (n, 4), elements=st.floats(0.1, 1)))
    if turn is not None:
        turn /= np.linalg.norm(turn, axis=1)[:, None]
        turn[draw(arrays(bool, (n,)))] = np.nan
    loads = st.dictionaries(
        st.from_regex(r"load_[a-zA-Z0-9_.-]{1,5}", fullmatch=True), arrays(float, (n,), elements=finite), max_size=3
    )
    return Session(
        draw(arrays(float, (n, joints), elements=finite)),
        points,
        point_std=std,
        temperature_degC=draw(st.none() | arrays(float, (n,), elements=st.floats(-40, 90))),
        quaternion=turn,
        directions=draw(st.none() | arrays(float, (n, joints), elements=st.sampled_from([-1.0, 0.0, 1.0]))),
        columns=draw(loads),
        **{field: draw(st.none() | name) for field in NAMES},
    )


def assert_same(found: Session, given: Session, *, angle_rtol: float) -> None:
    np.testing.assert_allclose(found.angles, given.angles, rtol=angle_rtol, atol=0)
    for name in ("points", "point_std", "temperature_degC", "quaternion", "directions", *NAMES):
        here, there = getattr(found, name), getattr(given, name)
        assert (here is None) == (there is None), name
        if there is not None:
            np.testing.assert_array_equal(here, there)  # written with all digits: the same bits
    assert list(found.columns) == list(given.columns)
    for name, values in given.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
# Radians come back as the same bits; degrees go through two products, each right to 2.2e-16 relative.
@pytest.mark.parametrize(("unit", "rtol"), [("rad", 0.0), ("deg", 1e-15)])
@settings(max_examples=12)
@given(readings=any_readings())
def test_what_is_written_comes_back(tmp_path_factory, readings, suffix, unit, rtol):
    path = tmp_path_factory.mktemp("round") / f"session{suffix}"
    write_session(readings, path, angle_unit=unit)
    found = read_session(path, n_joints=readings.n_joints)
    assert_same(found, readings, angle_rtol=rtol)
    assert found.file == path
    assert found.called(0) == ("line 2" if suffix == ".csv" else "reading 1")


def test_degrees_are_written_unless_asked_otherwise(tmp_path):
    path = tmp_path / "s.csv"
    write_session(Session(np.radians([[90.0, -45.0]])), path)
    assert path.read_text() == "q1_deg,q2_deg\n90.0,-45.0\n"


def test_units_are_read_from_the_names_column_by_column(tmp_path):
    path = text_file(tmp_path, "q1_deg,q2_rad,q3_mm,x_m,y_mm,z_m,sx_m,sy_mm,sz_mm\n180,0.5,12,1,2,3,0.001,1,1\n")
    readings = read_session(path)
    np.testing.assert_array_equal(readings.angles, [[np.pi, 0.5, 12.0]])
    np.testing.assert_array_equal(readings.points, [[1000.0, 2.0, 3000.0]])
    np.testing.assert_array_equal(readings.point_std, [[1.0, 1.0, 1.0]])
    assert readings.angle_columns == ("q1_deg", "q2_rad", "q3_mm")


def test_a_part_of_a_file_is_written_in_the_units_of_the_file(tmp_path):
    whole = read_session(text_file(tmp_path, "q1_rad,q2_mm\n0.1,5\n0.2,6\n"))
    write_session(whole.rows([1]), tmp_path / "part.csv")
    assert (tmp_path / "part.csv").read_text() == "q1_rad,q2_mm\n0.2,6.0\n"


def test_sliding_joints_are_written_in_mm(tmp_path):
    path = tmp_path / "s.csv"
    write_session(Session([[np.pi, 7.0]]), path, prismatic=[False, True])
    assert path.read_text() == "q1_deg,q2_mm\n180.0,7.0\n"


def test_angles_may_pass_a_full_turn(tmp_path):
    readings = read_session(text_file(tmp_path, "q1_deg\n725\n"))
    np.testing.assert_allclose(np.degrees(readings.angles), [[725.0]], rtol=1e-15)


def test_columns_may_stand_in_any_order(tmp_path):
    path = text_file(tmp_path, "z_mm,seat,q2_deg,x_mm,q1_deg,y_mm\n3,A,20,1,10,2\n")
    readings = read_session(path)
    np.testing.assert_allclose(np.degrees(readings.angles), [[10, 20]], rtol=1e-15)
    np.testing.assert_array_equal(readings.points, [[1, 2, 3]])
    assert readings.seat.tolist() == ["A"]


def test_what_spreadsheets_add_is_read(tmp_path):
    """A byte order mark, Windows line ends, spaces in the header, empty lines at the end, quotes."""
    text = b'\xef\xbb\xbfq1_deg, q2_deg,seat,note\r\n1,2,"bore, left",\xc3\xbc\r\n3,4,B,\r\n\r\n\r\n'
    readings = read_session(text_file(tmp_path, text))
    assert len(readings) == 2
    assert readings.seat.tolist() == ["bore, left", "B"]


def test_names_are_names_even_if_they_look_like_numbers_or_nothing(tmp_path):
    readings = read_session(text_file(tmp_path, "q1_deg,seat\n1,007\n2,NA\n3,\n"))
    assert readings.seat.tolist() == ["007", "NA", ""]


@pytest.mark.parametrize(
    ("header", "column", "said"),
    [
        ("q1,q2_deg", "q1", "q1_deg or q1_rad"),
        ("J1,q2_deg", "J1", "q1_deg or q1_rad"),
        ("joint_2,q1_deg", "joint_2", "q2_deg or q2_rad"),
        ("q1_grad,q2_deg", "q1_grad", "q1_deg or q1_rad"),
        ("q01_deg,q2_deg", "q01_deg", "q1_deg or q1_rad"),
        ("Q1_deg,q2_deg", "Q1_deg", "q1_deg or q1_rad"),
        ("q1_deg,x", "x", "x_mm or x_m"),
        ("q1_deg,X_cm", "X_cm", "x_mm or x_m"),
        ("q1_deg,std_y", "std_y", "sy_mm or sy_m"),
        ("q1_deg,temp", "temp", "temperature_degC"),
        ("q1_deg,temperature", "temperature", "temperature_degC"),
        ("q1_deg,temperature_F", "temperature_F", "temperature_degC"),
        ("q1_deg,seats", "seats", "seat"),
        ("q1_deg,spheres", "spheres", "sphere"),
        ("q1_deg,qw", "qw", "quat_w"),
        ("q1_deg,quat_X", "quat_X", "quat_x"),
        ("q1_deg,torque_1_Nm", "torque_1_Nm", "load_1_Nm"),
        ("q1_deg,tau1", "tau1", "load_1_Nm"),
        ("q1_deg,load_", "load_", "start with load_"),
        ("q1_deg,load 1", "load 1", "start with load_"),
        ("q1_deg,direction_of_J1", "direction_of_J1", "direction_1: the sign"),
        ("q1_deg,operator", "operator", "'note'"),
    ],
)
def test_an_unknown_column_is_refused_with_the_name_that_was_meant(tmp_path, header, column, said):
    error = refusal(tmp_path, f"{header}\n1,2\n")
    assert (error.line, error.column) == (1, column)
    assert "unknown column" in error.problem
    assert said in error.hint


@pytest.mark.parametrize("name", ["q9{}_deg", "q9{}", "direction_9{}", "dir_9{}", "q1{}_deg"])
def test_a_joint_number_of_any_length_is_an_unknown_column(tmp_path, name):
    """`int` takes 4300 digits, and no arm has a thousand joints."""
    for digits in ("000", "0" * 5000):
        column = name.format(digits)
        error = refusal(tmp_path, f"q1_deg,{column}\n1,2\n")
        assert error.problem.startswith("unknown column")
        assert column not in error.hint


def test_remarks_are_left_alone(tmp_path):
    assert read_session(text_file(tmp_path, "q1_deg,note,note_operator\n1,hot day,Ada\n")).n_joints == 1


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("q1_deg,q3_deg", "column of joint 2 is missing: expected q2_deg"),
        ("q2_deg,q3_deg", "column of joint 1 is missing"),
        ("x_mm,y_mm,z_mm", "expected joint angles in columns q1_deg"),
        ("q1_deg,x_mm,z_mm", "column y_mm is missing beside x_mm, z_mm"),
        ("q1_deg,x_mm,y_mm,z_mm,sx_mm", "column sy_mm is missing"),
        ("q1_deg,sx_mm,sy_mm,sz_mm", "x_mm, y_mm and z_mm are missing"),
        ("q1_deg,quat_w,quat_x,quat_z", "column quat_y is missing beside quat_w, quat_x, quat_z"),
        ("q1_deg,q1_deg", "two columns have this name"),
        ("q1_deg,load_1,load_1", "two columns have this name"),
        ("q1_deg,q1_rad", "q1_deg and q1_rad are the same quantity"),
        ("q1_deg,x_mm,x_m,y_mm,z_mm", "x_mm and x_m are the same quantity"),
        ("q1_deg,q2_deg,direction_2", "for each of 2 joints, direction_1 .. direction_2, got direction_2"),
        ("q1_deg,direction_1,direction_2", "for each of 1 joints, direction_1 .. direction_1, got direction_1, dir"),
        ("q1_deg,", "the column has no name"),
    ],
)
def test_a_header_that_does_not_fit_is_refused(tmp_path, header, said):
    error = refusal(tmp_path, f"{header}\n{','.join('1' * len(header.split(',')))}\n")
    assert error.line == 1
    assert said in error.problem


def test_a_wrong_number_of_joints_is_refused(tmp_path):
    error = refusal(tmp_path, GOOD, n_joints=6)
    assert "expected 6 joints, got 2" in error.problem
    assert "this arm" in error.hint


@pytest.mark.parametrize(
    ("cell", "said", "hint"),
    [
        ("abc", "got 'abc'", ""),
        ("1.2.3", "got '1.2.3'", ""),
        ("1_000", "got '1_000'", ""),
        ("0x10", "got '0x10'", ""),
        ("True", "got 'True'", ""),
        ("٣", "got '٣'", ""),
        ("1 234 567", "got '1 234 567'", "thousands"),
        ("", "got an empty cell", "x_mm, y_mm, z_mm empty together"),
        ("nan", "finite number, got 'nan'", "delete the reading"),
        ("NaN", "finite number, got 'NaN'", "delete the reading"),
        ("-inf", "finite number, got '-inf'", "delete the reading"),
        ("1e999", "got '1e999'", ""),
        ("9" * 500, "9...'", ""),
        ('"1,5"', "decimal '.', got '1,5'", "decimal points"),
    ],
)
@pytest.mark.parametrize("line", [2, 4])
def test_a_cell_that_is_no_number_is_found(tmp_path, cell, said, hint, line):
    rows = ["1,2,3,4,5"] * 3
    rows[line - 2] = f"1,2,3,{cell},5"
    error = refusal(tmp_path, HEADER + "\n".join(rows) + "\n")
    assert (error.line, error.column) == (line, "y_mm")
    assert said in error.problem
    assert hint in (error.hint or "")
    assert len(str(error)) < 400 + len(str(tmp_path))


@pytest.mark.parametrize(
    ("row", "column", "said"),
    [
        (",4,5,6,,,,,1", "q1_deg", "got an empty cell"),
        ("3,4,5,6,,,,,", "load_1", "got an empty cell"),
        ("3,4,5,6,,,,, ", "load_1", "got ' '"),
        ("3, ,5,6,,,,,1", "x_mm", "got ' '"),
        ("3,nan,nan,nan,,,,,1", "x_mm", "got 'nan'"),
        ("3,4,5,6,True,True,True,True,1", "quat_w", "got 'True'"),
        ("3,4,,6,,,,,1", "y_mm", "a number as in the columns that go with it, got an empty cell"),
        ("3,4,5,6,1,0,,0,1", "quat_y", "a number as in the columns that go with it, got an empty cell"),
        ("3,4,5,6,1,0,1,0,1", None, "expected a quaternion of length 1, got length 1.41421"),
    ],
)
def test_cells_may_be_empty_only_where_that_says_something(tmp_path, row, column, said):
    good = ["1,4,5,6,,,,,1", "2,,,,1,0,0,0,1"]
    header = "q1_deg,x_mm,y_mm,z_mm,quat_w,quat_x,quat_y,quat_z,load_1"
    error = refusal(tmp_path, "\n".join([header, *good, row, good[0]]))
    assert (error.line, error.column) == (4, column)
    assert said in error.problem


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_reading_may_have_no_point(tmp_path, suffix):
    text = "q1_rad,x_m,y_m,z_m,sx_mm,sy_mm,sz_mm,seat\n1,1,2,3,1,1,1,\n2,,,,,,,nan\n"
    first = read_session(text_file(tmp_path, text))
    write_session(first, tmp_path / f"again{suffix}")
    for readings in (first, read_session(tmp_path / f"again{suffix}")):
        assert readings.has_point.tolist() == [True, False]
        np.testing.assert_array_equal(readings.points, [[1000, 2000, 3000], [np.nan] * 3])
        np.testing.assert_array_equal(readings.point_std, [[1, 1, 1], [np.nan] * 3])
        assert readings.seat.tolist() == ["", "nan"]


def test_columns_that_are_empty_throughout_say_nothing(tmp_path):
    readings = read_session(text_file(tmp_path, "q1_rad,x_mm,y_mm,z_mm,seat\n1,,,,A\n2,,,,A\n"))
    assert readings.points is None
    write_session(readings, tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_text() == "q1_rad,seat\n1.0,A\n2.0,A\n"


@pytest.mark.parametrize(
    ("cell", "said"), [("0.5", "as -1, 0 or 1, got 0.5 for J2"), ("2", "got 2 for J2"), ("", "an empty cell")]
)
def test_a_direction_of_movement_is_a_sign(tmp_path, cell, said):
    error = refusal(tmp_path, f"q1_deg,q2_deg,direction_1,direction_2\n1,2,-1,1\n1,2,0,{cell}\n")
    assert (error.line, error.column) == (3, "direction_2")
    assert said in error.problem


def test_loads_are_read_as_they_stand_whatever_their_names_end_in(tmp_path):
    readings = read_session(text_file(tmp_path, "load_b_deg,q1_deg,load_a_m\n180,180,7\n"))
    assert {name: values.tolist() for name, values in readings.columns.items()} == {
        "load_b_deg": [180],
        "load_a_m": [7],
    }
    np.testing.assert_array_equal(readings.angles, [[np.pi]])


@pytest.mark.parametrize("fault", [2, 500, 999, 1001])
def test_a_fault_is_found_in_every_block_of_a_large_file(tmp_path, monkeypatch, fault):
    monkeypatch.setattr(delimited, "_CHUNK", 100)
    rows = ["1,2"] * 1000
    rows[fault - 2] = "1,two"
    error = refusal(tmp_path, "q1_deg,q2_deg\n" + "\n".join(rows))
    assert (error.line, error.column) == (fault, "q2_deg")


def test_a_column_of_nothing_but_true_is_no_column_of_ones(tmp_path):
    error = refusal(tmp_path, "q1_deg\nTrue\nFalse\n")
    assert (error.line, error.column) == (2, "q1_deg")


def test_a_column_of_noughts_and_ones_is_read(tmp_path):
    np.testing.assert_array_equal(read_session(text_file(tmp_path, "q1_rad\n0\n1\n")).angles, [[0.0], [1.0]])


@pytest.mark.parametrize(
    ("rows", "line", "said"),
    [
        ("1,2,3,4\n1,2,3,4,5", 2, "expected 5 values as in the line above, got 4"),
        ("1,2,3,4,5\n1,2,3,4,5,6", 3, "got 6"),
        ("1,2,3,4\n1,2,3,4,5,6", 2, "got 4"),
        ("1,2,3,4,5\n\n1,2,3,4,5", 3, "expected numbers, got an empty row"),
        ("1,2,3,4,5\n,,,,\n1,2,3,4,5", 3, "expected numbers, got an empty row"),
        ("1,2,3,4,5\n ,,\n1,2,3,4,5", 3, "expected numbers, got an empty row"),
        (",,,,\n1,2,3,4,5", 2, "expected numbers, got an empty row"),
        ('1,2,3,4,5\n1,2,3,4,"5\n1,2,3,4,6"', 3, "line break inside quotes"),
        ("1,5,2,5,3,5,4,5,5,5", 2, "got 10"),
    ],
)
def test_ragged_rows_are_found(tmp_path, rows, line, said):
    error = refusal(tmp_path, HEADER + rows + "\n")
    assert error.line == line
    assert said in error.problem
    if "got 10" in said:
        assert "decimal points" in error.hint
    if "empty row" in said:
        assert error.column is None
        assert error.hint == "delete the row"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"", "empty file"),
        (b"\n\n", "empty file"),
        (HEADER.encode(), "at least one row"),
        (HEADER.encode() + b",,,,\n,,,,\n", "at least one row"),
        (b"\n" + GOOD.encode(), "expected a header line"),
        (b"PK\x03\x04\x14\x00rest", "spreadsheet"),
        (b"\x1f\x8b\x08rest", "gzip"),
        (b"q1_deg\n1\n\x00\x01\x02\n", "binary"),
        (b"\xff\xfeq\x001\x00", "UTF-16"),
    ],
)
def test_files_that_are_no_table_are_refused(tmp_path, text, said):
    assert said in refusal(tmp_path, text).problem


def test_text_that_is_not_utf8_is_found(tmp_path):
    error = refusal(tmp_path, b"q1_deg,seat\n1,A\n2,b\xfcchse\n")
    assert error.line == 3
    assert "utf-8" in error.problem
    assert "CSV UTF-8" in error.hint


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_session_that_a_local_spreadsheet_saved_reads_the_same(tmp_path, separator, decimal):
    expected = read_session(text_file(tmp_path, GOOD))
    local = read_session(text_file(tmp_path, GOOD.replace(",", separator).replace(".", decimal), "local.csv"))
    np.testing.assert_array_equal(local.angles, expected.angles)
    np.testing.assert_array_equal(local.points, expected.points)


@pytest.mark.parametrize("end", [",,,,\n", ",,,,\r\n,,,,\r\n\r\n", " ,,\t,,\n\n,,,,", "\n\n"])
def test_empty_rows_at_the_end_are_none(tmp_path, end):
    readings = read_session(text_file(tmp_path, HEADER + "1,2,3,4,5\n1,3,,,\n" + end))
    np.testing.assert_array_equal(readings.has_point, [True, False])


def test_a_missing_file_a_folder_and_a_huge_file_are_refused(tmp_path, monkeypatch):
    refuses("does not exist", read_session, tmp_path / "none.csv")
    refuses("does not exist", read_session, tmp_path / "none.parquet")
    refuses("got a folder", read_session, tmp_path)
    monkeypatch.setattr(files, "MAX_BYTES", 2**20)
    refuses("larger than 1.05 MB", read_session, text_file(tmp_path, b"1" * 2**21))


def test_an_uncertainty_of_nought_is_refused_with_its_line(tmp_path):
    error = refusal(tmp_path, "q1_deg,x_mm,y_mm,z_mm,sx_mm,sy_mm,sz_mm\n1,1,1,1,1,1,1\n1,1,1,1,1,0,1\n")
    assert error.line == 3
    assert "must be positive" in error.problem


# Parquet -------------------------------------------------------------------------------------------------------------


def parquet_file(folder: Path, **columns: object) -> Path:
    arrow, parquet = pytest.importorskip("pyarrow"), importlib.import_module("pyarrow.parquet")
    path = folder / "session.parquet"
    parquet.write_table(arrow.table(columns), path)
    return path


@pytest.mark.parametrize(
    ("columns", "column", "said"),
    [
        ({"q1_deg": [1.0, None]}, "q1_deg", "empty cell"),
        ({"q1_deg": [1.0, float("nan")]}, "q1_deg", "got an empty cell"),
        ({"q1_deg": ["1", "2"]}, "q1_deg", "expected numbers, got a column of type string"),
        ({"q1_deg": [True, False]}, "q1_deg", "expected numbers, got a column of type boolean"),
        ({"q1_deg": [[1.0], [2.0]]}, "q1_deg", "expected numbers, got a column of type mixed"),
        ({"q1_deg": [1.0], "seat": [7]}, "seat", "expected names (text), got a column of type integer"),
        ({"q1_deg": [1.0], "load_1": [None]}, "load_1", "expected numbers, got a column of type empty"),
        ({"q1_deg": [1.0, 2.0], "load_1": [3.0, None]}, "load_1", "empty cell"),
        (
            {"q1_deg": [1.0], "x_mm": [1.0], "y_mm": [2.0], "z_mm": [None]},
            "z_mm",
            "expected a number as in the columns that go with it, got an empty cell",
        ),
        ({"q1_deg": [1.0], "x_mm": [np.inf], "y_mm": [0.0], "z_mm": [0.0]}, "x_mm", "got inf"),
        ({"q1": [1.0]}, "q1", "unknown column"),
    ],
)
def test_faults_of_a_parquet_file_are_found(tmp_path, columns, column, said):
    path = parquet_file(tmp_path, **columns)
    caught = refuses(None, read_session, path)
    assert (caught.file, caught.column) == (path, column)
    assert said in caught.problem


def test_whole_numbers_and_single_precision_are_read_from_parquet(tmp_path):
    path = parquet_file(tmp_path, q1_deg=np.array([90], np.int32), q2_rad=np.array([0.5], np.float32))
    np.testing.assert_array_equal(read_session(path).angles, [[np.pi / 2, 0.5]])


def test_an_empty_cell_and_nan_mean_the_same_in_parquet(tmp_path):
    path = parquet_file(
        tmp_path, q1_rad=[1.0, 2.0, 3.0], x_mm=[4.0, None, np.nan], y_mm=[5, None, None], z_mm=[6.0, np.nan, None],
        seat=["", "A", None], sphere=[None] * 3,
    )  # fmt: skip
    readings = read_session(path)
    np.testing.assert_array_equal(readings.points, [[4, 5, 6], [np.nan] * 3, [np.nan] * 3])
    assert readings.seat.tolist() == ["", "A", ""]
    assert readings.sphere.tolist() == ["", "", ""]
    none = parquet_file(tmp_path, q1_rad=[1.0], x_mm=[None], y_mm=[None], z_mm=[None])
    assert read_session(none).points is None


def test_a_parquet_file_is_known_by_its_content(tmp_path):
    path = parquet_file(tmp_path, q1_deg=[90.0]).rename(tmp_path / "session.csv")
    assert len(read_session(path)) == 1


def test_empty_damaged_foreign_and_swollen_parquet_files_are_refused(tmp_path, monkeypatch):
    refuses("at least one reading", read_session, parquet_file(tmp_path, q1_deg=np.zeros(0)))
    whole = parquet_file(tmp_path, q1_deg=np.arange(100.0)).read_bytes()
    refuses("expected a Parquet file", read_session, text_file(tmp_path, whole[: len(whole) // 2], "half.parquet"))
    refuses("expected a Parquet file", read_session, text_file(tmp_path, GOOD, "text.parquet"))
    monkeypatch.setattr(files, "MAX_CELLS", 50)
    refuses("expected at most 50 cells, got 100 rows", read_session, text_file(tmp_path, whole, "many.parquet"))


def test_without_pyarrow_the_message_says_what_to_install(tmp_path, without_extras):
    refuses(r"pip install 'truearm\[parquet\]'", write_session, Session([[1.0]]), tmp_path / "s.parquet")
    assert not list(tmp_path.iterdir())


# Nothing half written ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_failure_while_writing_leaves_what_was_there(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"s{suffix}"
    path.write_text("before")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    if suffix == ".csv":
        monkeypatch.setattr(files, "append_rows", full)
    else:
        monkeypatch.setattr(importlib.import_module("pyarrow.parquet").ParquetWriter, "write_table", full)
    with pytest.raises(TruearmError, match=f"{path.name}: the file cannot be written .No space left on device."):
        write_session(Session([[1.0]]), path)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_text() == "before"


def test_names_with_line_breaks_and_unknown_file_types_are_not_written(tmp_path):
    with pytest.raises(InputError, match="a seat must be one line of text") as caught:
        write_session(Session([[1.0]], seat=np.array(["a\nb"])), tmp_path / "s.csv")
    assert caught.value.column == "seat"
    refuses(r"ends in \.csv or \.parquet, got 's.xlsx'", write_session, Session([[1.0]]), tmp_path / "s.xlsx")
    refuses("expected 1 joint types", write_session, Session([[1.0]]), tmp_path / "s.csv", prismatic=[True, False])
    refuses("deg or rad", write_session, Session([[1.0]]), tmp_path / "s.csv", angle_unit="gon")
    assert not list(tmp_path.iterdir())


def test_csv_needs_no_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert len(read_session(text_file(tmp_path, GOOD))) == 2


def test_the_example_in_the_manual_is_a_session_file(tmp_path):
    manual = Path(__file__).parents[2] / "docs" / "session-file.md"
    example = manual.read_text().split("```csv\n")[1].split("```")[0]
    readings = read_session(text_file(tmp_path, example), n_joints=3)
    assert len(readings) == 3
    assert readings.seat.tolist() == ["", "", "cone A"]
    assert readings.point_std is not None
    mixed = manual.read_text().split("```csv\n")[2].split("```")[0]
    assert read_session(text_file(tmp_path, mixed)).has_point.tolist() == [True, False, False, False, False]
    assert f"At most {delimited.MAX_BYTES // 2**20} MiB" in manual.read_text()


def read_or_refused(path: Path) -> bool:
    try:
        return bool(np.isfinite(read_session(path).angles).all())
    except InputError as error:
        return error.file == path


@settings(max_examples=100)
@given(at=st.integers(0, 80), cut=st.integers(0, 8), junk=st.binary(max_size=8) | st.sampled_from([b'"', b",", b"\n"]))
def test_a_damaged_file_is_read_or_refused_but_nothing_else(tmp_path_factory, at, cut, junk):
    whole = b'q1_deg,load_2,seat,x_mm,y_mm,z_mm\n1,2,A,,,\n-3.5,4e1,"B, left",1,2,3\n5,6,,,,\n'
    path = text_file(tmp_path_factory.mktemp("damaged"), whole[:at] + junk + whole[at + cut :])
    assert read_or_refused(path)


@settings(max_examples=50)
@given(at=st.integers(0, 2000), junk=st.binary(min_size=1, max_size=8))
def test_a_damaged_parquet_file_is_read_or_refused_but_nothing_else(tmp_path_factory, at, junk):
    folder = tmp_path_factory.mktemp("damaged")
    path = parquet_file(folder, q1_deg=np.arange(50.0), seat=[f"s{i}" for i in range(50)])
    whole = path.read_bytes()
    at %= len(whole)
    path.write_bytes(whole[:at] + junk + whole[at + len(junk) :])
    assert read_or_refused(path)
