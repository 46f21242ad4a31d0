"""Data frames: what goes in comes out, and a fault names its column and reading."""

import numpy as np
import pandas as pd
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.readings import Lengths, Session, read_session, write_session

FRAME = pd.DataFrame(
    {
        "q1_deg": [0.0, 90.0, 180.0],
        "q2_mm": [1, 2, 3],
        "x_m": [1.0, np.nan, 3.0],
        "y_m": [1.0, np.nan, 3.0],
        "z_m": [1.0, np.nan, 3.0],
        "seat": ["A", None, "B"],
        "temperature_degC": [20.0, 20.5, 21.0],
        "load_1_Nm": [1.0, 2.0, 3.0],
        "note": [1, "two", None],
    },
    index=[7, 8, 9],
)


def test_units_stand_in_the_names_of_columns():
    session = Session.from_frame(FRAME)
    np.testing.assert_allclose(session.angles, [[0, 1], [np.pi / 2, 2], [np.pi, 3]], rtol=1e-15)
    np.testing.assert_array_equal(session.points, [[1000.0] * 3, [np.nan] * 3, [3000.0] * 3])
    assert session.seat.tolist() == ["A", "", "B"]
    assert session.columns["load_1_Nm"].tolist() == [1, 2, 3]


def test_a_frame_comes_back_in_its_units():
    again = Session.from_frame(FRAME).to_frame()
    assert list(again.columns[:5]) == ["q1_deg", "q2_mm", "x_mm", "y_mm", "z_mm"]
    pd.testing.assert_frame_equal(Session.from_frame(again).to_frame(), again)


def test_a_frame_of_a_file_is_that_of_pandas(tmp_path):
    """The same columns by either way, so that a person may read the file as they like."""
    write_session(Session.from_frame(FRAME), tmp_path / "s.csv")
    whole = read_session(tmp_path / "s.csv")
    again = Session.from_frame(pd.read_csv(tmp_path / "s.csv"))
    pd.testing.assert_frame_equal(again.to_frame(), whole.to_frame(), rtol=1e-14)


@pytest.mark.parametrize(
    ("change", "row", "column", "said"),
    [
        ({"q1_deg": ["0", "90", "180"]}, None, "q1_deg", "expected numbers, got a column of type string"),
        ({"q1_deg": [True, False, True]}, None, "q1_deg", "expected numbers, got a column of type boolean"),
        ({"q1_deg": [1.0, np.nan, 2.0]}, "reading 2", "q1_deg", "got an empty cell"),
        ({"q1_deg": [1.0, np.inf, 2.0]}, "reading 2", "q1_deg", "expected a finite number, got inf"),
        ({"y_m": [1.0, 2.0, np.nan]}, "reading 2", "x_m", "a number as in the columns that go with it"),
        ({"seat": [1, 2, 3]}, None, "seat", "expected names (text), got a column of type integer"),
        ({"seat": ["A", "x" * 300, "B"]}, "reading 2", "seat", "at most 200 characters"),
        (
            {"temperature_degC": [20.0, 293.15, 20.0]},
            "reading 2",
            "temperature_degC",
            "-50 to 100 degC, got 293.15 degC",
        ),
        ({"q3": [1.0, 2.0, 3.0]}, None, "q3", "unknown column 'q3'"),
        ({"q1_rad": [1.0, 2.0, 3.0]}, None, "q1_rad", "q1_deg and q1_rad are the same quantity"),
        ({5: [1.0, 2.0, 3.0]}, None, None, "expected names of columns such as q1_deg, got 5"),
    ],
)
def test_a_fault_names_its_column_and_reading(change, row, column, said):
    with pytest.raises(InputError) as caught:
        Session.from_frame(FRAME.drop(columns=list(change), errors="ignore").join(pd.DataFrame(change, FRAME.index)))
    error = caught.value
    assert (error.file, error.line, error.row, error.column) == (None, None, row, column)
    assert said in error.problem


def test_an_empty_frame_is_refused():
    refuses("at least one reading", Session.from_frame, FRAME.iloc[:0])


def test_a_part_of_a_session_keeps_its_numbers():
    """A message about a held-out reading names the row of the frame that the person has."""
    train, test = Session.from_frame(FRAME).split(by="row", hold_out=0.3, seed=1)
    names = sorted([*(train.called(i) for i in range(2)), test.called(0)])
    assert names == ["reading 1", "reading 2", "reading 3"]


def test_lengths_come_back_from_their_frame():
    lengths = Lengths(
        ["A", "C"], ["B", "D"], [500.0, 200.0], [0.001, 0.002], artefact=["bar", ""], u_place_mm=[0.002, np.nan],
        expansion_per_K=[1.15e-5, np.nan], u_expansion_per_K=[1e-6, np.nan],
    )  # fmt: skip
    frame = lengths.to_frame()
    again = Lengths.from_frame(frame)
    pd.testing.assert_frame_equal(again.to_frame(), frame)
    np.testing.assert_array_equal(again.u_place_mm, [0.002, 0.0])


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        ({"seat_a": ["A"], "seat_b": ["B"], "length_mm": [1.0]}, "the column u_mm is missing"),
        ({"seat_a": ["A"], "seat_b": ["B"], "length_mm": [1.0], "u_mm": [1.0], "u": [1]}, "unknown column 'u'"),
        ({"seat_a": ["A"], "seat_b": ["B"], "length_mm": [-1.0], "u_mm": [1.0]}, "length 1, .*expected a positive"),
    ],
)
def test_a_frame_that_is_no_table_of_lengths_is_refused(frame, said):
    refuses(said, Lengths.from_frame, pd.DataFrame(frame))
