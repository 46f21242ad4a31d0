"""Spheres of known size: the columns come back as they were, and what does not fit is told with its line."""

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import InputError
from truearm.readings import Session, read_session, write_session

HEADER = "q1_deg,q2_deg,sphere,sphere_distance_mm,u_sphere_distance_mm\n"
ROWS = ["1,2,ball,28.001,0.0005", "3,4,ball,28.001,0.0005", "5,6,other,,", "7,8,,,"]


def written(folder, rows, header=HEADER):
    path = folder / "s.csv"
    path.write_text(header + "\n".join(rows) + "\n")
    return path


def test_known_and_unknown_spheres_come_back(tmp_path):
    found = read_session(written(tmp_path, ROWS))
    assert found.sphere_distance[:2].tolist() == [[28.001, 0.0005]] * 2
    assert np.isnan(found.sphere_distance[2:]).all()
    write_session(found, tmp_path / "again.csv", angle_unit="rad")
    again = read_session(tmp_path / "again.csv")
    np.testing.assert_array_equal(again.sphere_distance, found.sphere_distance)
    assert found.rows([2, 3]).sphere_distance is None
    assert found.rows([1]).sphere_distance.tolist() == [[28.001, 0.0005]]


@pytest.mark.parametrize(
    ("row", "column", "said"),
    [
        ("5,6,ball,28.002,0.0005", "sphere_distance_mm", "the same distance from sphere 'ball'"),
        ("5,6,ball,28.001,0.0004", "sphere_distance_mm", "but line 2 has another"),
        ("5,6,ball,,", "sphere_distance_mm", "the same distance from sphere 'ball'"),
        ("5,6,ball,28.001,", "u_sphere_distance_mm", "got an empty cell"),
        ("5,6,,28.001,0.0005", "sphere_distance_mm", "expected the name of the sphere"),
        ("5,6,c,0,0.0005", "sphere_distance_mm", "expected a positive distance"),
        ("5,6,c,28,-1", "sphere_distance_mm", "expected a positive distance"),
        ("5,6,c,28,nan", "u_sphere_distance_mm", "got 'nan'"),
    ],
)
def test_a_row_that_does_not_fit_is_found(tmp_path, row, column, said):
    caught = refuses(said, read_session, written(tmp_path, [*ROWS[:2], row]))
    assert (caught.line, caught.column) == (4, column)


def test_columns_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(InputError, match="the column u_sphere_distance_mm is missing beside sphere_distance_mm"):
        read_session(written(tmp_path, ["1,2,b,28"], "q1_deg,q2_deg,sphere,sphere_distance_mm\n"))
    with pytest.raises(InputError, match="the name of the sphere"):
        read_session(written(tmp_path, ["1,2,28,1"], "q1_deg,q2_deg,sphere_distance_mm,u_sphere_distance_mm\n"))
    with pytest.raises(InputError, match="sphere_distance_mm") as caught:
        read_session(written(tmp_path, ["1,2,b,28"], "q1_deg,q2_deg,sphere,sphere_distance\n"))
    assert caught.value.hint == "sphere_distance_mm"
    refuses(r"sphere_distance of shape \(1, 2\)", Session, np.zeros((1, 2)), sphere=["b"], sphere_distance=[[1.0]])
    with pytest.raises(InputError, match="distance and uncertainty or none"):
        Session(np.zeros((1, 2)), sphere=["b"], sphere_distance=[[1.0, np.nan]])
