"""What the columns of a foreign table mean: units, lost targets, rows that are no readings, every kind of reading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.importing.foreign import JointScale, TableColumns
from truearm.wings.importing.foreign.no_readings import far_turned, lost_targets, not_seen, statistics_at_ends
from truearm.wings.importing.foreign.tables import import_points, interpret_table
from truearm.wings.importing.tables.table import Table

NAMES = ("J1", "J2", "X", "Y", "Z")


def table(values, names=NAMES, units=None, words=None):
    """A table of numbers, with columns of text after them."""
    values = np.atleast_2d(np.asarray(values, dtype=float))
    columns = [*values.T, *(np.array(texts, dtype=np.str_) for texts in (words or {}).values())]
    names = (*names, *(words or {}))
    return Table(tuple(names), tuple(units or [""] * len(names)), tuple(columns), np.arange(2, 2 + len(values)))


def session_like(n=8, seed=0):
    """Two joints in degrees that turn far, and points that span a metre."""
    rng = np.random.default_rng(seed)
    return np.hstack([rng.uniform(-170, 170, (n, 2)), rng.uniform(-500, 500, (n, 3))])


COLUMNS = TableColumns(NAMES[:2], NAMES[2:])


def read(values, columns=COLUMNS, scale=None, **options):
    given_table = values if isinstance(values, Table) else table(values)
    return interpret_table(given_table, columns, scale or JointScale(), **options)


def refusal(*arguments, **options):
    return refuses(None, read, *arguments, **options)


# Units --------------------------------------------------------------------------------------------------------------


def test_units_that_numbers_leave_no_doubt_of_are_said():
    found = read(session_like())
    assert found.units == ("deg", "deg")
    assert found.session.angles[0] == pytest.approx(np.radians(session_like()[0, :2]), abs=1e-15)
    assert any(said.startswith("angles in deg") for said in found.assumed)
    assert "points in mm" in found.assumed


def test_units_that_the_table_states_are_used_and_not_assumed():
    values = session_like() * [0.01, 0.01, 0.001, 0.001, 0.001]
    found = read(table(values, units=("rad", "Rad", "m", "m", "m")))
    assert found.units == ("rad", "rad")
    assert found.session.points[0] == pytest.approx(1000 * values[0, 2:], rel=1e-15)
    assert found.assumed == ()


@pytest.mark.parametrize("largest", [0.5, 6.28, 18.0])
def test_angles_that_may_be_degrees_or_radians_are_asked_with_both_values(largest):
    values = session_like()
    values[:, :2] *= largest / 170
    error = refusal(values)
    assert f"{values[0, 0]:g} deg or {values[0, 0]:g} rad" in error.problem
    assert (error.line, error.column) == (2, "J1")
    assert "--angle-unit deg" in error.hint
    assert "--angle-unit rad" in error.hint


def test_a_unit_of_two_meanings_is_asked_whatever_the_numbers():
    assert "--angle-unit deg" in refusal(table(session_like(), units=("Grad", "Grad", "mm", "mm", "mm"))).hint
    found = read(table(session_like(), units=("gon", "gon", "mm", "mm", "mm")))
    assert found.session.angles[0] == pytest.approx(session_like()[0, :2] * np.pi / 200, rel=1e-15)


def test_counts_are_never_taken_for_degrees():
    values = session_like()
    values[:, :2] = np.round(values[:, :2] * 100)
    assert "--angle-unit counts" in refusal(values).hint


@pytest.mark.parametrize(("factor", "unit"), [(0.001, "m"), (1000.0, "um")])
def test_points_that_no_arm_has_in_mm_are_asked(factor, unit):
    values = session_like() * [1, 1, factor, factor, factor]
    error = refusal(values)
    assert f"may be mm or {unit}" in error.problem
    assert f"--point-unit {unit}" in error.hint
    points = read(values, point_unit=unit).session.points
    assert points == pytest.approx(session_like()[:, 2:], rel=1e-12)


def test_coordinates_and_uncertainties_have_their_own_units():
    values = np.hstack([session_like() * [1, 1, 1, 0.001, 1], np.full((8, 3), 40.0)])
    names = (*NAMES, "ux", "uy", "uz")
    columns = TableColumns(NAMES[:2], NAMES[2:], ("ux", "uy", "uz"))
    session = read(table(values, names, ("", "", "mm", "m", "mm", "um", "um", "um")), columns).session
    assert session.points == pytest.approx(session_like()[:, 2:], rel=1e-12)
    assert session.point_std[0] == pytest.approx([0.04] * 3, rel=1e-12)


def test_units_that_the_numbers_contradict_are_refused():
    assert "--angle-unit deg" in refusal(table(session_like(), units=("rad", "rad", "mm", "mm", "mm"))).hint
    small = session_like() * [1, 1, 0.001, 0.001, 0.001]
    assert "--point-unit m " in refusal(table(small, units=("deg", "deg", "mm", "mm", "mm"))).hint


@pytest.mark.parametrize(
    ("pattern", "mm"),
    [("{} cm", 10.0), ("{} in", 25.4), ("{}_LT_m", 1000.0), ("{}_in", 25.4), ("{}.um", 0.001), ("{} inch", 25.4)],
)
def test_a_unit_behind_a_name_is_that_of_stated_columns_too(pattern, mm):
    names = [pattern.format(axis) for axis in "XYZ"]
    values = session_like() / [1, 1, mm, mm, mm]
    stated = TableColumns(NAMES[:2], names)
    found = read(table(values, (*NAMES[:2], *names)), stated)
    np.testing.assert_allclose(found.session.points, session_like()[:, 2:], rtol=1e-12)
    np.testing.assert_allclose(import_points(table(values, (*NAMES[:2], *names)), names), found.session.points)


def test_a_unit_that_option_and_table_contradict_is_asked():
    """The table's own unit may be wrong only where its numbers say so."""
    of_inches = table(session_like() / [1, 1, 25.4, 25.4, 25.4], units=("deg", "deg", "in", "in", "in"))
    error = refusal(of_inches, point_unit="mm")
    assert (error.problem, error.column) == ("the table states in, --point-unit states mm", "X")
    assert "--point-unit in if" in error.hint
    refuses("the table states in, --point-unit states mm", import_points, of_inches, NAMES[2:], point_unit="mm")
    in_mm = session_like()[:, 2:]
    np.testing.assert_allclose(read(of_inches, point_unit="in").session.points, in_mm, rtol=1e-12)
    of_metres = table(session_like() / [1, 1, 1000, 1000, 1000], units=("deg", "deg", "mm", "mm", "mm"))
    np.testing.assert_allclose(read(of_metres, point_unit="m").session.points, in_mm, rtol=1e-12)

    of_degrees, in_rad = table(session_like(), units=("deg", "deg", "mm", "mm", "mm")), JointScale("rad")
    error = refusal(of_degrees, scale=in_rad)
    assert (error.problem, error.column) == ("the table states deg, --angle-unit states rad", "J1")
    called_rad = table(session_like(), units=("rad", "rad", "mm", "mm", "mm"))
    called_deg = table(session_like() * [0.01, 0.01, 1, 1, 1], units=("deg", "deg", "mm", "mm", "mm"))
    for wrong, right in ((called_rad, "deg"), (called_deg, "rad")):
        assert read(wrong, scale=JointScale(right)).units == (right, right)


def test_points_in_a_matrix_have_a_unit_as_others_have():
    """Without one in the table, numbers that may be metres are asked; lost targets and limits are found there too."""
    columns = TableColumns(NAMES[:2], orientation=[f"a{i}{j}" for i in range(3) for j in range(4)])
    in_metres = session_like()[:, 2:] / 1000
    in_metres[3] = 0.0
    pose = np.concatenate([np.tile(np.eye(3), (8, 1, 1)), in_metres[:, :, None]], axis=2).reshape(8, 12)
    given_table = table(np.hstack([session_like()[:, :2], pose]), (*NAMES[:2], *columns.orientation))
    error = refusal(given_table, columns)
    assert ("may be mm or m" in error.problem, error.column) == (True, "a03")
    session = read(given_table, columns, point_unit="m").session
    assert session.has_point.tolist() == [True] * 3 + [False] + [True] * 4
    np.testing.assert_allclose(session.points[0], session_like()[0, 2:], rtol=1e-12)


def test_a_number_has_one_role():
    columns = TableColumns(NAMES[:2], NAMES[2:], others={"payload_kg": "X"})
    assert "used for two things" in refusal(session_like(), columns).problem
    named = TableColumns(NAMES[:2], NAMES[2:], session="day", others={"tip": "day"})  # a name may have two
    assert set(read(table(session_like(), words={"day": ["1"] * 8}), named).session.tip) == {"1"}


# Rows that are no readings --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [0.0, -9999.0, 1e30, 9.9e37, np.nan])
def test_a_lost_target_is_a_reading_without_a_point(sign):
    values = session_like()
    values[3, 2:] = sign
    found = read(values)
    assert len(found.session) == 8
    assert found.session.has_point.tolist() == [True] * 3 + [False] + [True] * 4
    assert np.isnan(sign) != any("Line 5" in sentence and "target lost" in sentence for sentence in found.remarks)


def test_a_point_at_the_origin_is_one_where_others_are_near_it():
    points = np.array([[0.0, 0, 0], [0.1, 0.2, 0], [500, 0, 0]])
    assert not lost_targets(points).any()
    assert lost_targets(points[[0, 2]]).tolist() == [True, False]
    assert not lost_targets(np.zeros((3, 3))).any()


def test_half_a_point_is_none():
    values = session_like()
    values[2, 4] = np.nan
    found = read(values)
    assert not found.session.has_point[2]
    assert "Line 4" in found.remarks[0]


def test_a_row_without_all_its_angles_is_no_reading():
    values = session_like()
    values[[1, 4], 0] = np.nan
    found = read(values)
    assert found.session.numbers.tolist() == [2, 4, 5, 7, 8, 9]
    assert "Lines 3, 6" in found.remarks[0]
    values[:, 0] = np.nan
    assert "at least one row" in refusal(values).problem


@pytest.mark.parametrize("at_the_head", [False, True])
def test_rows_of_statistics_are_no_readings(at_the_head):
    values = session_like()
    of_all = [values.mean(axis=0), values.std(axis=0, ddof=1), values.min(axis=0), values.max(axis=0)]
    for n in range(1, 5):
        rows = [np.round(of_all[:n], 4), values]
        found = read(np.vstack(rows if at_the_head else rows[::-1]))
        assert len(found.session) == 8
        assert "means, limits or the like" in found.remarks[0]


def test_statistics_below_many_rows_are_found_too():
    values = session_like(6000)
    foot = [values.mean(axis=0), values.std(axis=0), values.min(axis=0), values.max(axis=0)]
    assert statistics_at_ends(np.vstack([values, np.round(foot, 4)])).nonzero()[0].tolist() == [6000, 6001, 6002, 6003]


@given(st.integers(0, 2**32 - 1), st.integers(5, 40))
def test_no_reading_is_taken_for_a_row_of_statistics(seed, n):
    assert not statistics_at_ends(session_like(n, seed)).any()


def test_joints_that_stand_still_make_no_statistics():
    assert not statistics_at_ends(np.ones((8, 5))).any()


def test_a_joint_beyond_all_others_is_no_reading():
    values = session_like()
    values[2, 1] = 9999.0
    found = read(values)
    assert len(found.session) == 7
    assert any("Line 4" in said and "further than any joint" in said for said in found.remarks)
    values[2, 1] = 179.0
    values[:, 1] *= [0.03, 0.03, 1, *[0.03] * 5]
    assert not far_turned(values[:, :2]).any()


@pytest.mark.parametrize(
    ("name", "bad"), [("Status", "BEAM LOST"), ("valid", "0"), ("visible", "False"), ("Remark", "Zielverlust")]
)
def test_a_column_that_says_that_the_target_was_lost_is_heard(name, bad):
    cells = ["OK" if name == "Status" else "1"] * 8
    cells[3] = bad
    found = read(table(session_like(), words={name: cells}))
    assert found.session.has_point.tolist() == [True] * 3 + [False] + [True] * 4
    assert not not_seen("remark", np.array(["0", "no", "1", "yes"])).any()
    assert not not_seen(name, np.array([bad] * 8)).any()


def test_a_point_that_repeats_to_the_last_digit_is_named():
    values = session_like()
    values[5, 2:] = values[4, 2:]
    assert any("Line 7: the same point" in said for said in read(values).remarks)


def test_columns_that_are_not_read_and_a_missing_reference_are_named():
    found = read(session_like(), TableColumns(NAMES[:2]))
    assert any("No reference is read" in said for said in found.remarks)
    assert "Not read: X, Y, Z." in found.remarks


# Kinds of readings ----------------------------------------------------------------------------------------------------


def test_one_uncertainty_stands_for_all_points():
    values = session_like()
    values[1, 2:] = np.nan
    std = read(values, u_mm=0.05).session.point_std
    assert std[0].tolist() == [0.05] * 3
    assert np.isnan(std[1]).all()
    assert "omit --u-mm" in refusal(table(session_like()), TableColumns(("J1", "J2")), u_mm=0.05).hint
    assert "above zero" in refusal(session_like(), u_mm=-1.0).problem


def test_distances_to_anchors_come_in_mm():
    values = np.hstack([session_like()[:, :2], np.linspace(0.4, 0.6, 8)[:, None]])
    columns = TableColumns(("J1", "J2"), others={"anchor": "wire", "distance_mm": "D"})
    wires = {"wire": ["A", "B"] * 4}
    session = read(table(values, ("J1", "J2", "D"), ("", "", "m", ""), wires), columns, u_mm=0.2).session
    # Without a unit of their own they have that of the points.
    as_points = read(table(values, ("J1", "J2", "D"), words=wires), columns, point_unit="m").session
    for one in (session, as_points):
        assert one.distance_mm == pytest.approx(np.linspace(400, 600, 8), rel=1e-15)
    assert session.u_distance_mm.tolist() == [0.2] * 8
    assert session.anchor.tolist() == ["A", "B"] * 4


def test_tips_serial_numbers_payload_loads_and_directions_have_their_columns():
    values = np.hstack([session_like(), np.tile([2.5, 30.0, -1.0, 1.0], (8, 1))])
    names = (*NAMES, "mass", "torque", "d1", "d2")
    columns = TableColumns(
        NAMES[:2],
        NAMES[2:],
        others={"tip": "ball", "payload_kg": "mass", "load_1_Nm": "torque", "direction_1": "d1", "direction_2": "d2"},
    )
    given_table = table(values, names, words={"ball": ["long"] * 8})
    session = read(given_table, columns, serial_number="A-17").session
    assert session.tip.tolist() == ["long"] * 8
    assert session.serial_number.tolist() == ["A-17"] * 8
    assert session.columns["payload_kg"].tolist() == [2.5] * 8
    assert session.columns["load_1_Nm"].tolist() == [30.0] * 8
    assert session.directions[0].tolist() == [-1.0, 1.0]


def test_a_column_that_no_session_file_has_is_refused():
    refuses("no column 'colour'", TableColumns, ("J1",), others={"colour": "c"})
    columns = TableColumns(NAMES[:2], NAMES[2:], others={"direction_1": "D"})
    with_direction = table(np.hstack([session_like(), np.ones((8, 1))]), (*NAMES, "D"))
    assert "direction of each of 2 joints" in refusal(with_direction, columns).problem


@pytest.mark.parametrize("order", ["ZYX", "xyz", "ZYZ"])
def test_euler_angles_have_an_order(order):
    turns = Rotation.random(8, random_state=0)
    values = np.hstack([session_like(), turns.as_euler(order, degrees=True)])
    values[5, 5:] = np.nan
    columns = TableColumns(NAMES[:2], NAMES[2:], orientation=("A", "B", "C"))
    given_table = table(values, (*NAMES, "A", "B", "C"))
    session = read(given_table, columns, orientation_unit="deg", orientation_order=order).session
    known = np.arange(8) != 5
    off = Rotation.from_quat(session.quaternion[known], scalar_first=True).inv() * turns[known]
    assert off.magnitude().max() < 1e-7  # rad; of the angle between equal quaternions, whose cosine is rounded at 1
    assert np.isnan(session.quaternion[5]).all()


def test_a_quaternion_may_have_its_scalar_last():
    values = np.hstack([session_like(), np.tile([0.0, 0.6, 0.0, 0.8], (8, 1))])
    columns = TableColumns(NAMES[:2], NAMES[2:], orientation=("a", "b", "c", "d"))
    session = read(table(values, (*NAMES, *"abcd")), columns, orientation_order="xyzw").session
    assert session.quaternion[0].tolist() == [0.8, 0.0, 0.6, 0.0]
    assert "expected the order" in refusal(table(values, (*NAMES, *"abcd")), columns, orientation_order="ZYX").problem


def test_a_temperature_logged_now_and_then_is_carried_on():
    values = np.hstack([session_like(), np.array([[np.nan, 20, np.nan, np.nan, 21, np.nan, np.nan, np.nan]]).T])
    columns = TableColumns(NAMES[:2], NAMES[2:], temperature="T")
    session = read(table(values, (*NAMES, "T")), columns).session
    assert session.temperature_degC.tolist() == [20, 20, 20, 20, 21, 21, 21, 21]


def test_stated_columns_win_over_recognised_ones():
    known = TableColumns(("q1",), ("x", "y", "z"), ("sx", "sy", "sz"), others={"tip": "ball", "anchor": "w"})
    stated = TableColumns(points=("a", "b", "c"), others={"tip": "probe"})
    both = stated.or_else(known)
    assert (both.angles, both.points, both.point_std) == (("q1",), ("a", "b", "c"), ())
    assert both.others == {"tip": "probe", "anchor": "w"}


def test_all_that_is_missing_is_said_at_once(tmp_path):
    """Two runs of joints and two sets of points; then their units."""
    names = [
        "left_j1",
        "left_j2",
        "right_j1",
        "right_j2",
        *(f"{who}_{axis}" for who in ("ref", "tip") for axis in "xyz"),
    ]
    rows = np.random.default_rng(1).uniform(-1, 1, (12, len(names)))
    table = tmp_path / "log.csv"
    table.write_text("\n".join([",".join(names), *(",".join(f"{v:.4f}" for v in row) for row in rows)]), "utf-8")
    caught = refuses(None, ta.import_table, table)
    said = str(caught)
    assert "2 faults" in said
    assert "may be the joint angles" in said
    assert "may be the points" in said
    caught = refuses(None, ta.import_table, table, TableColumns(angles=names[:2], points=names[-3:]))
    said = str(caught)
    assert "the unit of the joint angles is not stated" in said
    assert "the unit of the points is not stated" in said
    with pytest.raises(InputError, match="there are no columns 'J1', 'J2'; the columns are left_j1"):
        ta.import_table(table, TableColumns(angles=["J1", "J2"], points=names[-3:]))
    caught = refuses(None, ta.import_table, table, TableColumns(points=names[-3:]), JointScale("counts"))
    assert "may be the joint angles" in str(caught)


def test_points_that_are_none_are_said_with_what_they_hold():
    values = session_like()
    values[1, 2:], values[3, 2:], values[5, 3], values[6, 2:] = 0.0, -1.0, np.nan, -1.0
    found = read(values)
    assert [one for one in found.remarks if "no point" in one] == [
        "Line 3: 0, 0, 0 is no point (target lost); the reading has no point.",
        "Lines 5, 8: -1, -1, -1 is no point (target lost); the reading has no point.",
        "Line 7: a coordinate is missing; the reading has no point.",
    ]
