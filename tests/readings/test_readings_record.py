"""The record of readings: lengths fit each other, numbers are finite, and a part keeps what it is part of."""

from pathlib import Path

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.readings import Session

GAP = [[1.0, 2.0, 3.0], [np.nan] * 3, [4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"angles": np.zeros(3)}, r"shape \(n, n_joints\), got \(3,\)"),
        ({"angles": np.zeros((3, 0))}, "shape"),
        ({"points": np.zeros((2, 3))}, r"points of shape \(3, 3\)"),
        ({"points": np.zeros((3, 3)), "point_std": np.ones((3, 2))}, "point_std of shape"),
        ({"temperature_degC": np.zeros(2)}, "temperature_degC of shape"),
        ({"quaternion": np.zeros((3, 3))}, r"quaternion of shape \(3, 4\)"),
        ({"quaternion": np.zeros((3, 4))}, "reading 1: .*quaternion of length 1, got length 0"),
        ({"quaternion": [[1, 0, 0, 0], [1, 0.2, 0, 0], [2, 0, 0, 0]]}, "reading 2: .*got length 1.0198"),
        ({"quaternion": [[1, 0, 0, 0], [np.nan, 0, 0, 0], [1, 0, 0, 0]]}, "reading 2: .*none of them in quaternion"),
        ({"points": [[1, 2, 3], [1, np.nan, 3], [1, 2, 3]]}, "reading 2: .*x, y and z or none of them in points"),
        ({"points": [[1, 2, 3], [np.nan] * 3, [np.inf] * 3]}, "reading 3: .*finite numbers in points"),
        ({"point_std": np.ones((3, 3))}, "point_std needs points"),
        ({"points": GAP, "point_std": np.ones((3, 3))}, "reading 2: .*only there, got one without a point"),
        ({"points": np.ones((3, 3)), "point_std": GAP}, "reading 2: .*only there, got a point without one"),
        ({"columns": {"torque": np.ones(3)}}, "names of further columns such as load_1_Nm, got 'torque'"),
        ({"columns": {"load_\n": np.ones(3)}}, "names of further columns"),
        ({"columns": {"load_1": np.ones(2)}}, r"load_1 of shape \(3,\)"),
        ({"columns": {"load_1": [1, np.nan, 2]}}, "reading 2: .*finite numbers in load_1, got nan"),
        ({"directions": np.zeros((3, 2))}, r"directions of shape \(3, 1\)"),
        ({"directions": [[0], [1], [0.5]]}, "reading 3, column 'direction_1': .*as -1, 0 or 1, got 0.5 for J1"),
        ({"directions": [[0], [np.nan], [1]]}, "reading 2, column 'direction_1': .*as -1, 0 or 1, got nan for J1"),
        ({"sphere": np.array(["a"])}, r"sphere of shape \(3,\)"),
        ({"seat": np.array(["a"])}, r"seat of shape \(3,\)"),
        ({"angles": [[1.0], [np.nan], [2.0]]}, "reading 2: .*finite numbers in angles, got "),
        ({"temperature_degC": [1, 2, np.inf]}, "reading 3: .*"),
        ({"points": np.ones((3, 3)), "point_std": np.diag([1, 1, -2]) + 1.5}, "reading 3: .*must be positive, got "),
    ],
)
def test_fields_that_do_not_fit_are_refused(fields, said):
    refuses(said, Session, **({"angles": np.zeros((3, 1))} | fields))


def test_rows_select_every_field_and_keep_file_and_lines():
    names = np.array(["a", "b", "c"])
    whole = Session(
        np.arange(6.0).reshape(3, 2),
        np.ones((3, 3)),
        seat=names,
        plane=names,
        quaternion=np.eye(4)[:3],
        columns={"load_1": np.array([7.0, 8.0, 9.0])},
        temperature_degC=np.array([20.0, 21.0, 22.0]),
        file=Path("s.csv"),
        angle_columns=("q1_rad", "q2_mm"),
        numbers=np.arange(2, 5),
        by_line=True,
    )
    part = whole.rows([2, 0])
    np.testing.assert_array_equal(part.angles, [[4, 5], [0, 1]])
    assert part.seat.tolist() == ["c", "a"]
    assert part.temperature_degC.tolist() == [22, 20]
    assert part.plane.tolist() == ["c", "a"]
    np.testing.assert_array_equal(part.quaternion, np.eye(4)[[2, 0]])
    assert part.columns["load_1"].tolist() == [9, 7]
    assert whole.rows([True, False, True]).columns["load_1"].tolist() == [7, 9]
    assert part.position is None
    assert (part.file, [part.called(row) for row in (0, 1)]) == (Path("s.csv"), ["line 4", "line 2"])
    assert part.angle_columns == ("q1_rad", "q2_mm")


def test_a_reading_without_a_point_is_known_as_such():
    readings = Session(np.zeros((3, 1)), GAP, point_std=GAP)
    assert readings.has_point.tolist() == [True, False, True]
    assert Session(np.zeros((2, 1))).has_point.tolist() == [False, False]
    none = readings.rows([1])
    assert none.points is None
    assert none.point_std is None
    assert not none.has_point.any()
    assert readings.rows(np.zeros(3, bool)).points.shape == (0, 3)


def test_a_rounded_quaternion_is_made_one_and_an_exact_one_stays_as_it_is():
    rounded = [0.71, 0.0, 0.71, 0.0]
    exact = [0.6, 0.0, 0.8, 0.0]
    readings = Session(np.zeros((3, 1)), quaternion=[rounded, exact, [np.nan] * 4])
    # 0.71 / sqrt(2 0.71^2) is sqrt(1/2), right to a few units in the last place of a double.
    np.testing.assert_allclose(readings.quaternion[0], np.sqrt([0.5, 0, 0.5, 0]), rtol=1e-15)
    np.testing.assert_array_equal(readings.quaternion[1:], [exact, [np.nan] * 4])
    assert Session(np.zeros((1, 1)), quaternion=[[np.nan] * 4]).quaternion is None


def test_a_message_names_the_line_where_there_is_one():
    in_file = Session([[1.0], [2.0]], file=Path("s.csv"), numbers=[2, 3], by_line=True)
    assert in_file.called(1) == "line 3"
    assert in_file.error("odd", 1).line == 3
    assert Session([[1.0]]).called(0) == "reading 1"


@pytest.mark.parametrize(
    ("degC", "said", "hint"),
    [
        (-273.2, "-273.2 degC is below absolute zero", "check the temperature"),
        (293.15, "expected a temperature of -50 to 100 degC, got 293.15 degC", "kelvin less 273.15"),
        (-50.1, "got -50.1 degC", "Fahrenheit"),
        (1e308, r"got 1e\+308 degC", "kelvin"),
    ],
)
def test_a_temperature_that_is_none_of_an_arm_is_refused(degC, said, hint):
    with pytest.raises(InputError, match=said) as caught:
        Session(np.zeros((3, 1)), temperature_degC=[20.0, degC, 20.0])
    assert caught.value.row == "reading 2"
    assert hint in caught.value.hint
    with pytest.raises(InputError) as caught:
        Session(
            np.zeros((3, 1)), temperature_degC=[20.0, degC, 20.0], file=Path("s.csv"), numbers=[2, 3, 4], by_line=True
        )
    assert (caught.value.line, caught.value.column) == (3, "temperature_degC")


@pytest.mark.parametrize("degC", [-50.0, 0.0, 100.0])
def test_the_coldest_and_the_warmest_arm_are_read(degC):
    assert Session([[0.0]], temperature_degC=[degC]).temperature_degC.tolist() == [degC]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"points": [[1, 2, 1e300]]}, r"up to 1e\+09 mm in points, got 1e\+300 mm"),
        ({"points": [[1, 2, 3]], "point_std": [[1, 1e300, 1]]}, r"up to 1e\+09 mm in point_std, got 1e\+300 mm"),
        ({"sphere": ["A"], "sphere_distance": [[1e300, 1]]}, r"in sphere_distance, got 1e\+300 mm"),
        ({"columns": {"load_1": [1e300]}}, r"up to 1e\+100 in load_1, got 1e\+300"),
    ],
)
def test_numbers_too_large_to_be_squared_are_refused(fields, said):
    assert "check the unit" in refuses(said, Session, [[0.0]], **fields).hint
