"""Orientations in foreign tables: every form gives the same quaternion; no rotations are named by line."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.readings import read_session, write_session
from truearm.wings.importing.foreign import JointScale, TableColumns, import_table

# Of printed matrices: rounding of doubles that are written in full.
ROUNDING = 1e-12
UNIT_QUATERNIONS = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)


def read(folder, values, *, unit=None, point_unit="mm", points=None):
    """A table of two joints and an orientation, one row for each row of `values`."""
    values = np.atleast_2d(values)
    names = [f"r{i}" for i in range(values.shape[1])]
    lines = ["J1;J2;" + ";".join(names)]
    lines += [";".join(map(repr, [0.1 * row, 0.2, *numbers])) for row, numbers in enumerate(values.tolist())]
    (folder / "table.txt").write_text("\n".join(lines) + "\n")
    columns = TableColumns(["J1", "J2"], points=points or [], orientation=names)
    return import_table(
        folder / "table.txt", columns, JointScale("rad"), separator=";", point_unit=point_unit, orientation_unit=unit
    )


def refusal(folder, values, **options):
    return refuses(None, read, folder, values, **options)


def pose(R, t) -> list[float]:
    return np.vstack([np.column_stack([R, t]), [0, 0, 0, 1]]).ravel().tolist()


@settings(max_examples=15)
@given(st.lists(UNIT_QUATERNIONS, min_size=1, max_size=4))
def test_every_form_is_the_same_orientation(tmp_path_factory, quaternions):
    folder = tmp_path_factory.mktemp("forms")
    true = Rotation.from_quat(quaternions)
    R, t = true.as_matrix(), np.arange(3.0)
    forms = {
        "rad": (true.as_rotvec(), "rad"),
        "deg": (np.degrees(true.as_rotvec()), "deg"),
        "quaternion": (true.as_quat(scalar_first=True), None),
        "3 x 3": (R.reshape(-1, 9), None),
        "3 x 4": ([pose(one, t)[:12] for one in R], None),
        "4 x 4": ([pose(one, t) for one in R], None),
    }
    for values, unit in forms.values():
        session = read(folder, values, unit=unit)
        off = (Rotation.from_quat(session.quaternion, scalar_first=True) * true.inv()).magnitude()
        assert off.max() < 1e-7  # rad; of the angle between equal quaternions, whose cosine is rounded at 1
    np.testing.assert_allclose(session.points, [t] * len(R), atol=0)
    write_session(session, folder / "s.csv")
    np.testing.assert_array_equal(read_session(folder / "s.csv").quaternion, session.quaternion)


def test_a_robot_controller_s_rotation_vector_is_read(tmp_path):
    """A quarter turn about z: the flange's x axis is the y axis of the frame of the points."""
    session = read(tmp_path, [0.0, 0.0, np.pi / 2], unit="rad")
    R = Rotation.from_quat(session.quaternion[0], scalar_first=True).as_matrix()
    np.testing.assert_allclose(R[:, 0], [0, 1, 0], atol=ROUNDING)


def test_the_point_of_a_pose_matrix_has_the_unit_of_points(tmp_path):
    session = read(tmp_path, pose(np.eye(3), [0.5, 0.25, -1.0]), point_unit="m")
    np.testing.assert_array_equal(session.points, [[500.0, 250.0, -1000.0]])


def test_a_matrix_printed_with_four_decimals_becomes_the_nearest_rotation(tmp_path):
    R = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    session = read(tmp_path, np.round(R, 4).ravel())
    found = Rotation.from_quat(session.quaternion[0], scalar_first=True).as_matrix()
    np.testing.assert_allclose(found, R, atol=1e-4)  # a decimal of the print
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=ROUNDING)


def test_no_rotation_is_named_by_its_line(tmp_path):
    good = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    mirrored, skew = good * [1, 1, -1], good.copy()
    skew[:, 0] = (good[:, 0] + 0.2 * good[:, 1]) / np.hypot(1, 0.2)
    wrong = {
        "left-handed one (determinant -1)": mirrored,
        "scaled by 2": 2 * good,
        "scaled by 1000": 1000 * mirrored,
        "not perpendicular to each other": skew,
        "columns of lengths 0, 0, 0": np.zeros((3, 3)),
        "columns of lengths": np.diag([1.0, 1e300, 1.0]),
    }
    for said, matrix in wrong.items():
        error = refusal(tmp_path, [good.ravel(), matrix.ravel()])
        assert said in error.problem
        assert error.line == 3
        assert error.column == "r0"


def test_a_matrix_column_by_column_is_recognised_by_its_last_row(tmp_path):
    error = refusal(tmp_path, np.reshape(pose(np.eye(3), [10.0, 20.0, 30.0]), (4, 4)).T.ravel())
    assert "expected 0, 0, 0, 1 as the last row of a 4 x 4 matrix, got 10, 20, 30, 1" in error.problem
    assert (error.line, error.column) == (2, "r12")


def test_degrees_read_as_radians_are_refused(tmp_path):
    error = refusal(tmp_path, [[0.1, 0.0, 0.0], [90.0, 0.0, 0.0]], unit="rad")
    assert "expected a rotation vector of a full turn at most, got one of 90 rad" in error.problem
    assert error.line == 3
    assert "check its unit" in error.hint


@pytest.mark.parametrize(
    ("n_columns", "options", "said"),
    [
        (5, {}, "expected the columns of an orientation, 3 (rotation vector rx, ry, rz, or Euler angles); 4"),
        (3, {}, "expected the unit of the rotation vector, deg or rad, got none"),
        (3, {"unit": "gon"}, "expected the unit of the rotation vector, deg or rad, got 'gon'"),
        (9, {"unit": "rad"}, "a unit belongs to a rotation vector or Euler angles (three columns) only"),
        (16, {"points": ["r3", "r7", "r11"]}, "the points are given twice"),
    ],
)
def test_columns_that_are_no_orientation_are_refused(tmp_path, n_columns, options, said):
    assert said in refusal(tmp_path, np.eye(16)[:1, :n_columns], **options).problem


def test_the_command_takes_them(truearm_import, tmp_path):
    text = "J1,J2,x,y,z,rx,ry,rz\n" + "".join(f"{0.1 * i},0.2,1,2,3,0,0,{0.5 * i}\n" for i in range(3))
    (tmp_path / "ur.csv").write_text(text)
    ran = truearm_import(
        tmp_path / "ur.csv", "--angles", "J1,J2", "--angle-unit", "rad", "--point", "x,y,z", "--point-unit", "m",
        "--orientation", "rx,ry,rz", "--orientation-unit", "rad", "--out", tmp_path / "s.csv",
    )  # fmt: skip
    assert "turned" in ran
    assert f"{np.degrees(1.0):.3f}" in ran
    np.testing.assert_allclose(read_session(tmp_path / "s.csv").quaternion[2], [np.cos(0.5), 0, 0, np.sin(0.5)])


@pytest.fixture
def truearm_import(capsys):
    """Run ``truearm import`` in this process and return what it prints."""
    from truearm.command_line import make_app

    def run(*arguments):
        make_app("import")(["import", *map(str, arguments)], standalone_mode=False)
        return capsys.readouterr().out

    return run
