"""Foreign tables: columns by name or number, separators, decimal signs, units, encoder counts with sign and zero."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.wings.importing.foreign import JointScale, TableColumns, import_table

# As a tracker's software writes it where commas are decimal signs.
TRACKER = (
    "Time;Goal x;Goal y;J1;J2;T;mx;my;mz;ux;uy;uz\r\n"
    "10:01;0,8;-0,6;1,7453299999999998;-0,5;20,5;1,5;2;3E2;0,01;0,02;0,03\r\n"
    "10:02;0,80000001;-0,6;1,7;-0,25;20,5;1,5;2;3;0,01;0,02;0,03\r\n"
)
COLUMNS = TableColumns(
    ["J1", "J2"], ["mx", "my", "mz"], ["ux", "uy", "uz"], temperature="T", position=["Goal x", "Goal y"]
)


def table(folder, text, name="table.txt"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(folder, text, columns=COLUMNS, scale=None, **options):
    options = {"separator": ";", "decimal": ",", "point_unit": "mm"} | options
    return import_table(table(folder, text), columns, scale or JointScale("rad"), **options)


def refusal(folder, text, *rest, **options):
    return refuses(None, read, folder, text, *rest, **options)


def test_a_table_with_decimal_commas_is_read_to_the_last_digit(tmp_path):
    readings = read(tmp_path, TRACKER, session_name="May")
    np.testing.assert_array_equal(readings.angles, [[1.7453299999999998, -0.5], [1.7, -0.25]])
    np.testing.assert_array_equal(readings.points, [[1.5, 2, 300], [1.5, 2, 3]])
    np.testing.assert_array_equal(readings.point_std, [[0.01, 0.02, 0.03]] * 2)
    np.testing.assert_array_equal(readings.temperature_degC, [20.5, 20.5])
    assert readings.session.tolist() == ["May", "May"]
    assert readings.file.name == "table.txt"
    assert readings.angle_columns == ("J1", "J2")
    assert readings.called(0) == "line 2"


def test_goals_that_differ_by_rounding_are_one_position(tmp_path):
    assert read(tmp_path, TRACKER).position.tolist() == ["0.8 -0.6"] * 2


def test_a_position_may_have_a_name(tmp_path):
    columns = TableColumns(["J1", "J2"], position=["Time", "Goal y"])
    assert read(tmp_path, TRACKER, columns).position.tolist() == ["10:01 -0.6", "10:02 -0.6"]


@pytest.mark.parametrize("header", [True, False])
def test_columns_go_by_number_too(tmp_path, header):
    text = TRACKER if header else TRACKER.split("\n", 1)[1]
    columns = TableColumns(["4", "5"], ["7", "8", "9"], seat="1")
    readings = read(tmp_path, text, columns, header=header)
    np.testing.assert_array_equal(readings.angles[1], [1.7, -0.25])
    assert readings.seat.tolist() == ["10:01", "10:02"]
    assert readings.called(0) == ("line 2" if header else "line 1")


def test_lines_above_the_header_can_be_skipped_and_lines_keep_their_numbers(tmp_path):
    text = "Tracker 3000\r\n\r\n" + TRACKER
    assert len(read(tmp_path, text, skip_lines=2)) == 2
    error = refusal(tmp_path, text.replace("1,7;", "x;"), skip_lines=2)
    assert (error.line, error.column) == (5, "J1")


def test_other_encodings_are_read(tmp_path):
    text = "Würfel;J1\nlinks;1,5\n"
    columns = TableColumns(["J1"], seat="Würfel")
    for encoding in ("cp1252", "utf-16", "utf-8-sig"):
        readings = read(tmp_path, text.encode(encoding), columns, encoding=encoding)
        assert readings.seat.tolist() == ["links"]
        assert read(tmp_path, text.encode(encoding), columns).seat.tolist() == ["links"]
    assert refusal(tmp_path, text.encode("cp1252"), columns, encoding="utf-8").line == 1
    assert "unknown encoding 'klingon'" in refusal(tmp_path, text, columns, encoding="klingon").problem
    assert "not" in refusal(tmp_path, b"a;b\n\xff\xff\xff", columns, encoding="utf-16").problem


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("m", 1000.0), ("um", 0.001), ("in", 25.4)])
def test_points_and_their_uncertainties_come_in_mm(tmp_path, unit, mm):
    readings = read(tmp_path, TRACKER, point_unit=unit)
    np.testing.assert_allclose(readings.points[1], np.array([1.5, 2, 3]) * mm, rtol=1e-15)
    np.testing.assert_allclose(readings.point_std[1], np.array([0.01, 0.02, 0.03]) * mm, rtol=1e-15)


# What joint values mean ----------------------------------------------------------------------------------------------


def test_counts_become_angles_by_sign_zero_and_resolution():
    scale = JointScale("counts", counts_per_turn=[4000, 1024], sign=[1, -1], zero=[1000, 24])
    # A quarter turn past the zero of joint 1; 512 counts, half a turn, past that of joint 2, which counts backwards.
    np.testing.assert_allclose(scale.to_angles(np.array([[2000.0, 536.0]])), [[np.pi / 2, -np.pi]], rtol=1e-15)


def test_gon_are_the_four_hundredth_part_of_a_turn():
    np.testing.assert_allclose(JointScale("gon").to_angles(np.array([[100.0]])), [[np.pi / 2]], rtol=1e-15)


def test_degrees_have_zeros_and_signs_too():
    scale = JointScale(["deg", "rad", "mm"], sign=[-1, 1, -1], zero=[90, 1, 10])
    np.testing.assert_allclose(scale.to_angles(np.array([[45.0, 1.5, 30.0]])), [[np.pi / 4, 0.5, -20.0]], rtol=1e-15)


@given(
    angle=st.floats(-50, 50),
    zero=st.integers(-(2**20), 2**20),
    turn=st.integers(1000, 2**24),
    sign=st.sampled_from([1, -1]),
)
def test_counts_come_back_within_half_a_count(angle, zero, turn, sign):
    counts = np.round(zero + sign * angle / (2 * np.pi) * turn)
    scale = JointScale("counts", counts_per_turn=turn, sign=[sign], zero=[zero])
    # Half a count of rounding, and the rounding of doubles of this size.
    assert abs(scale.to_angles(np.array([[counts]]))[0, 0] - angle) <= np.pi / turn + 1e-12


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"unit": "counts"}, "counts of a full turn"),
        ({"unit": "counts", "counts_per_turn": 0}, "counts per turn must be positive"),
        ({"unit": "counts", "counts_per_turn": [100, 100, 100]}, "counts per turn for each of the 2 joints, got 3"),
        ({"unit": "mil"}, "unknown unit of angles 'mil'"),
        ({"unit": ["deg", "deg", "deg"]}, "angle unit for each of the 2 joints, got 3"),
        ({"unit": "deg", "sign": [1]}, "sign for each of the 2 joints, got 1"),
        ({"unit": "deg", "sign": [1, 2]}, "signs must be + or -"),
        ({"unit": "deg", "zero": [0, 0, 0]}, "zero for each of the 2 joints, got 3"),
        ({"unit": "deg", "zero": [0, np.nan]}, "zeros must be finite"),
    ],
)
def test_scales_that_do_not_fit_are_refused(tmp_path, options, said):
    assert said in refusal(tmp_path, TRACKER, COLUMNS, JointScale(**options)).problem


# Refusals ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ["x", "1.5.6.7", "-inf", "12;5"])
def test_a_cell_that_is_no_number_is_found(tmp_path, cell):
    error = refusal(tmp_path, TRACKER.replace("-0,25", f'"{cell}"'))
    assert (error.line, error.column) == (3, "J2")
    assert error.file == tmp_path / "table.txt"
    assert f"expected a number, got '{cell}'" in error.problem


@pytest.mark.parametrize("cell", ["", "n/a", "-", "#DIV/0!"])
def test_a_reading_without_one_of_its_angles_is_none(tmp_path, cell):
    assert len(read(tmp_path, TRACKER.replace("-0,25", cell))) == 1


def test_a_number_without_known_decimal_sign_is_asked_with_both_values(tmp_path):
    text = "J1;X;Y;Z\n30;1.235;-988;12\n200;1.500;-200;13\n"
    columns = TableColumns(["J1"], ["X", "Y", "Z"])
    error = refusal(tmp_path, text, columns, JointScale("deg"), decimal=None)
    assert (error.line, error.column) == (2, "X")
    assert "1.235 or 1235" in error.problem
    read_as = {
        sign: read(tmp_path, text, columns, JointScale("deg"), **({"decimal": None} | {sign: "."})).points[0, 0]
        for sign in ("decimal", "thousands")
    }
    assert read_as == {"decimal": 1.235, "thousands": 1235.0}


def test_what_is_not_asked_for_may_hold_anything(tmp_path):
    assert len(read(tmp_path, "J1;remark\n1;\n2;nan\n", TableColumns(["J1"]))) == 2


@pytest.mark.parametrize(
    ("text", "columns", "said", "hint"),
    [
        ("a;b\n1;2\n", ["c"], "no column 'c'; the columns are a, b", "number"),
        ("a;b\n1;2\n", ["3"], "no column '3'", "number"),
        ("a;b\n1;2\n", ["0"], "no column '0'", "number"),
        ("a;a\n1;2\n", ["a"], "'a' names columns 1 and 2", "give its number"),
        ("a;b\n1;2\n", ["a", "a"], "used for two things", ""),
        ("a;b\n1;2\n1;2;3\n", ["a"], "got 3", ""),
        ("a;b\n", ["a"], "expected rows of numbers, got none", ""),
        ("", ["a"], "empty file", ""),
    ],
)
def test_columns_that_are_not_there_are_refused(tmp_path, text, columns, said, hint):
    error = refusal(tmp_path, text, TableColumns(columns))
    assert error.file == tmp_path / "table.txt"
    assert said in error.problem
    assert hint in (error.hint or "")


def test_the_separator_and_the_decimal_sign_are_recognised(tmp_path):
    stated = read(tmp_path, TRACKER)
    recognised = read(tmp_path, TRACKER, separator=None, decimal=None)
    np.testing.assert_array_equal(recognised.angles, stated.angles)
    np.testing.assert_array_equal(recognised.points, stated.points)


def test_empty_rows_at_the_end_are_none(tmp_path):
    assert len(read(tmp_path, "J1;J2\n1;2\n;\n;\n", TableColumns(["J1"]))) == 1


def test_without_a_header_a_name_is_no_column(tmp_path):
    error = refusal(tmp_path, "1;2\n", TableColumns(["J1"]), header=False)
    assert "the columns are 1 .. 2" in error.problem


def test_options_that_contradict_each_other_are_refused(tmp_path):
    assert "both ','" in refusal(tmp_path, TRACKER, separator=",").problem
    assert "one character" in refusal(tmp_path, TRACKER, separator="; ").problem
    assert "decimal sign must be" in refusal(tmp_path, TRACKER, decimal="'").problem
    assert "unknown unit of points 'ft'" in refusal(tmp_path, TRACKER, point_unit="ft").problem
    twice = TableColumns(["J1"], session="Time")
    assert "session is given twice" in refusal(tmp_path, TRACKER, twice, session_name="May").problem


def test_columns_that_cannot_be_meant_are_refused():
    refuses(r"three columns \(x, y, z\) for points, got 2", TableColumns, ["a"], ["x", "y"])
    refuses("point_std needs points", TableColumns, ["a"], point_std=["x", "y", "z"])


@pytest.mark.parametrize(
    ("above", "mm"), [("// Units: Inches", 25.4), ("# all points in centimetres", 10.0), ("", 1.0)]
)
def test_a_unit_in_the_lines_above_is_that_of_points_without_one(tmp_path, above, mm):
    text = f"{above}\nJ1,X,Y,Z\n" + "".join(f"{40 * i},{10 * i},{7 * i},5\n" for i in range(1, 8))
    readings = read(tmp_path, text, TableColumns(["J1"], ["X", "Y", "Z"]), JointScale("deg"), separator=",",
                    decimal=None, point_unit=None)  # fmt: skip
    np.testing.assert_allclose(readings.points[0], np.array([10, 7, 5]) * mm, rtol=1e-15)
