"""The record of readings: lengths fit each other, numbers are finite, and a part keeps what it is part of."""

from pathlib import Path

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.readings import Readings


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"angles": np.zeros(3)}, r"shape \(n, n_joints\), got \(3,\)"),
        ({"angles": np.zeros((3, 0))}, "shape"),
        ({"points": np.zeros((2, 3))}, r"points of shape \(3, 3\)"),
        ({"points": np.zeros((3, 3)), "point_std": np.ones((3, 2))}, "point_std of shape"),
        ({"temperature_degC": np.zeros(2)}, "temperature_degC of shape"),
        ({"seat": np.array(["a"])}, r"seat of shape \(3,\)"),
        ({"angles": [[1.0], [np.nan], [2.0]]}, "finite numbers in angles, got .* in reading 2"),
        ({"temperature_degC": [1, 2, np.inf]}, "in reading 3"),
        ({"points": np.ones((3, 3)), "point_std": np.diag([1, 1, -1]) + 1.5}, "must be positive, got .* in reading 3"),
    ],
)
def test_fields_that_do_not_fit_are_refused(fields, said):
    with pytest.raises(InputError, match=said):
        Readings(**({"angles": np.zeros((3, 1))} | fields))


def test_rows_select_every_field_and_forget_the_file():
    names = np.array(["a", "b", "c"])
    whole = Readings(
        np.arange(6.0).reshape(3, 2),
        np.ones((3, 3)),
        seat=names,
        temperature_degC=np.array([20.0, 21.0, 22.0]),
        file=Path("s.csv"),
        angle_columns=("q1_rad", "q2_mm"),
        first_line=2,
    )
    part = whole.rows([2, 0])
    np.testing.assert_array_equal(part.angles, [[4, 5], [0, 1]])
    assert part.seat.tolist() == ["c", "a"]
    assert part.temperature_degC.tolist() == [22, 20]
    assert part.position is None
    assert (part.file, part.first_line) == (None, None)
    assert part.angle_columns == ("q1_rad", "q2_mm")


def test_a_message_names_the_line_where_there_is_one():
    in_file = Readings([[1.0], [2.0]], file=Path("s.csv"), first_line=2)
    assert in_file.called(1) == "line 3"
    assert in_file.error("odd", 1).line == 3
    assert Readings([[1.0]]).called(0) == "reading 1"
