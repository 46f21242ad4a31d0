"""Two tables joined row by row, by numbers of rows and by names; columns of times."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.wings.importing.foreign.joined_logs import join_tables
from truearm.wings.importing.foreign.joined_tables import row_numbers
from truearm.wings.importing.foreign.time_columns import time_columns, time_of
from truearm.wings.importing.tables.table import Table


def table(file="joints.csv", **columns):
    arrays = tuple(
        np.array(c, dtype=np.str_) if isinstance(c[0], str) else np.array(c, dtype=float) for c in columns.values()
    )
    n = len(arrays[0])
    return Table(tuple(columns), ("",) * len(columns), arrays, np.arange(2, n + 2), "line", Path(file), 1)


# Row by row ----------------------------------------------------------------------------------------------------------


def test_rows_stand_side_by_side():
    joined = join_tables(table(J1=[1, 2], X=[5, 6]), table("points.csv", X=[10, 20], Y=[3, 4]), "row")
    assert joined.names == ("J1", "X", "points X", "Y")
    assert [c.tolist() for c in joined.columns] == [[1, 2], [5, 6], [10, 20], [3, 4]]
    assert joined.assumed == ("row by row",)
    assert joined.rows(slice(1, 2)).numbers(2).tolist() == [20]


def test_columns_without_names_go_on_counting():
    joints = Table(("1", "2"), ("", ""), (np.ones(2), np.ones(2)), np.arange(2))
    assert join_tables(joints, joints, "row").names == ("1", "2", "3", "4")


def test_a_fault_names_the_file_that_has_it():
    joined = join_tables(table(J1=[1, 2, 3]), table("points.csv", X=["1", "2", "lost"]), "row")
    refuses(r"points.csv, line 4, column 'X': expected a number", joined.numbers, 1)
    with pytest.raises(InputError, match=r"points.csv, line 3, column 'X': expected a number"):
        join_tables(table(J1=[1, 2, 3]), table("points.csv", X=["1", "lost", "2"]), "row").rows(slice(1, 3)).numbers(1)


def test_a_column_with_two_meanings_is_asked_when_it_is_used():
    points = table("points.csv", Y=[3, 4], X=[1.235, 2])
    asked = replace(points, questions={1: InputError("1.235 or 1235")})
    joined = join_tables(table(J1=[1, 2]), asked, "row").rows(slice(1))
    assert joined.numbers(1).tolist() == [3]
    refuses("1.235 or 1235", joined.numbers, 2)


def test_a_count_that_differs_is_refused():
    with pytest.raises(InputError, match=r"joints.csv has 3 rows and points.csv 2: points.csv lacks 1, .*--by name"):
        join_tables(table(J1=[1, 2, 5]), table("points.csv", X=[1, 4]), "row")


def test_numbers_of_rows_that_only_count_say_nothing():
    joints, points = table(no=[1, 2, 3], J1=[4, 7, 9]), table("points.csv", i=[0, 1, 2], X=[1, 4, 2])
    assert join_tables(joints, points, "row").numbers(3).tolist() == [1, 4, 2]
    refuses("has 3 rows and points.csv 2", join_tables, joints, points.rows(slice(2)), "row")


def test_rows_are_found_by_their_numbers_where_some_lack():
    joints = table(no=[1, 2, 3, 4, 5], J1=[10, 20, 30, 40, 50])
    joined = join_tables(joints, table("points.csv", Nr=[5, 2, 4, 9], X=[500, 200, 400, 900]), "row")
    assert joined.numbers(1).tolist() == [20, 40, 50]
    assert joined.numbers(3).tolist() == [200, 400, 500]
    assert joined.assumed == (
        "rows by their numbers",
        "2 rows only in joints.csv skipped",
        "1 row only in points.csv skipped",
    )


def test_one_file_may_count_from_0():
    points = table("points.csv", Nr=[1, 2, 4], X=[1, 2, 4])
    with pytest.raises(InputError, match="one may count from 0 and the other from 1"):
        join_tables(table(no=[0, 1, 2, 3, 4], J1=[0, 1, 2, 3, 4]), points, "row")
    assert len(join_tables(table(no=[1, 2, 3, 4], J1=[0, 1, 2, 3]), points, "row")) == 3


def test_angles_in_whole_numbers_are_no_numbers_of_rows():
    assert row_numbers(table(J1=[3, 1, 2], J2=[0, 1, 2])).tolist() == [0, 1, 2]
    assert row_numbers(table(J1=[3, 1, 2], J2=[0, 2, 1])) is None


@pytest.mark.parametrize(("pattern", "said"), [("rows", "one after the other"), ("rounds", "in rounds")])
def test_repeats_are_recognised_if_they_are_visible(pattern, said):
    x = np.array([0.0, 100.0, 30.0, 70.0])
    noise = 0.01 * np.arange(12)
    repeated = (np.repeat(x, 3) if pattern == "rows" else np.tile(x, 3)) + noise
    joined = join_tables(table(J1=[1, 2, 3, 4.5]), table("points.csv", X=repeated.tolist()), "row")
    assert joined.numbers(0).tolist() == (np.repeat if pattern == "rows" else np.tile)([1, 2, 3, 4.5], 3).tolist()
    assert any(said in phrase for phrase in joined.assumed)
    with pytest.raises(InputError, match="has 4 rows and points.csv 12"):
        join_tables(table(J1=[1, 2, 3, 4.5]), table("points.csv", X=(50 * np.arange(12) % 70).tolist()), "row")


# By name -------------------------------------------------------------------------------------------------------------


def test_names_find_their_rows():
    joints = table(pose=["P1", "P2", "P3"], J1=[1, 2, 3])
    points = table("points.csv", Name=[" p3", "P1 ", "P9"], X=[30, 10, 90])
    joined = join_tables(joints, points, "name")
    assert joined.numbers(1).tolist() == [1, 3]
    assert joined.numbers(3).tolist() == [10, 30]
    assert joined.assumed == (
        "rows by the names in columns 'pose' and 'Name'",
        "names that differ in case or blanks only are one name",
        "1 row only in joints.csv skipped",
        "1 row only in points.csv skipped",
    )


def test_several_points_of_a_name_pair_with_its_angles():
    joints = table(pose=["A", "B"], J1=[1, 2])
    points = table("points.csv", pose=["A", "A", "B"], X=[10, 11, 20])
    assert join_tables(joints, points, "name").numbers(1).tolist() == [1, 1, 2]
    twice = table(pose=["A", "B", "A"], J1=[1, 2, 1.1])
    joined = join_tables(twice, points, "pose")
    assert list(zip(joined.numbers(1), joined.numbers(3), strict=True)) == [(1, 10), (2, 20), (1.1, 11)]
    thrice = table("points.csv", pose=["A", "A", "A", "B"], X=[1, 2, 3, 4])
    refuses(r"line 2, column 'pose': 'A' is on 2 rows here and on 3 in points.csv", join_tables, twice, thrice, "name")


def test_columns_of_names_may_be_stated():
    joints, points = table(a=[7, 8], J1=[1, 2]), table("points.csv", b=[8, 7], X=[20, 10])
    assert join_tables(joints, points, "a=b").numbers(3).tolist() == [10, 20]
    refuses("no column holds names that are in both", join_tables, joints, points, "name")
    refuses("have no name in common", join_tables, joints, points, "J1=X")
    refuses(r"there is no column 'pose'; the columns are a, J1", join_tables, joints, points, "pose")


def test_two_columns_of_names_are_asked():
    joints = table(pose=["A", "B"], target=["A", "B"], J1=[1, 2])
    with pytest.raises(InputError, match=r"names may be those of the columns .*=pose or .*Try: --by"):
        join_tables(joints, table("points.csv", pose=["A", "B"], X=[1, 2]), "name")


@given(st.permutations(range(6)), st.permutations(range(6)))
def test_the_order_of_rows_does_not_matter(first, second):
    names = np.array([f"P{i}" for i in range(6)])
    joints = table(pose=names[first].tolist(), J1=np.array(first, dtype=float).tolist())
    points = table("points.csv", point=names[second].tolist(), X=(10.0 * np.array(second)).tolist())
    joined = join_tables(joints, points, "name")
    assert (10 * joined.numbers(1) == joined.numbers(3)).all()
    assert len(joined) == 6


# Times ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("columns", "units", "seconds"),
    [
        ({"time": [0.0, 0.5, 2.0]}, "", [0.0, 0.5, 2.0]),
        ({"timestamp": [1000.0, 1500.0, 3000.0]}, "ms", [1.0, 1.5, 3.0]),
        ({"t [ms]": [1000.0, 1500.0, 3000.0]}, "", [1.0, 1.5, 3.0]),
        ({"t_us": [1e6, 2e6, 3e6]}, "", [1.0, 2.0, 3.0]),
        ({"stamp": [1.7e18, 1.7e18 + 5e9]}, "", [1.7e9, 1.7e9 + 5]),
        ({"time": (8.0 * np.arange(60)).tolist()}, "", 0.008 * np.arange(60)),
        ({"time": (8000.0 * np.arange(60)).tolist()}, "", 0.008 * np.arange(60)),
        ({"header.stamp.sec": [5.0, 6.0], "header.stamp.nanosec": [5e8, 0.0]}, "", [5.5, 6.0]),
        ({"secs": [5.0, 6.0], "nsecs": [5e8, 0.0]}, "", [5.5, 6.0]),
        ({"when": ["1970-01-02T00:00:01.5Z", "1970-01-02T00:00:02Z"]}, "", [86401.5, 86402.0]),
        ({"Zeit": ["02.01.1970 00:00:01,250", "02.01.1970 00:00:02,500"]}, "", [86401.25, 86402.5]),
        ({"Date": ["1/2/1970", "1/2/1970"], "Time": ["1:00:00 AM", "1:00:01 AM"]}, "", [90000.0, 90001.0]),
    ],
)
def test_times_are_recognised(columns, units, seconds):
    one = table(**columns)
    one = Table(one.names, (units,) * len(one.names), one.columns, one.lines)
    times = time_of(one)
    np.testing.assert_allclose(times.seconds, seconds, rtol=0, atol=3e-7 * max(1, np.max(seconds) / 1e9))
    assert times.columns == time_columns(one)


def test_a_clock_goes_on_over_midnight():
    times = time_of(table(time=["23:59:59.5", "00:00:00.5", "00:00:01"]))
    np.testing.assert_allclose(np.diff(times.seconds), [1.0, 0.5])


def test_no_times_and_times_that_go_back():
    assert time_of(table(J1=[1, 2], temperature=[3, 4], theta=[1, 2])) is None
    refuses(r"line 4, column 'time': the time goes back", time_of, table(time=[1.0, 2.0, 1.5]))
