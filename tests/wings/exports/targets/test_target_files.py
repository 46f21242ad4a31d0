"""Tables of targets: every way to state a pose is the same pose; what is ambiguous, missing or corrected is refused."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.wings.exports.targets.targets import read_targets, targets_from_frame

# Degrees to radians and back: some roundings of numbers up to pi.
ROUNDING = 1e-12
XYZ = {"x_mm": [100.0, 200.0], "y_mm": [-50.0, 0.0], "z_mm": [300.0, 10.0]}
JOINTS = {f"q{i}_deg": [10.0 * i, -5.0 * i] for i in range(1, 7)}


def orientation_columns(R: Rotation) -> dict[str, dict[str, np.ndarray]]:
    """The same orientations in every way that a table may state them."""
    columns = {
        "quaternion": dict(zip(["qw", "qx", "qy", "qz"], R.as_quat(scalar_first=True).T, strict=True)),
        "matrix": {f"r{i + 1}{j + 1}": R.as_matrix()[:, i, j] for i in range(3) for j in range(3)},
    }
    for unit, factor in (("deg", 180 / np.pi), ("rad", 1.0)):
        columns[f"vector {unit}"] = {f"r{a}_{unit}": factor * R.as_rotvec()[:, i] for i, a in enumerate("xyz")}
        rpy = R.as_euler("xyz")
        columns[f"rpy {unit}"] = {f"{a}_{unit}": factor * rpy[:, i] for i, a in enumerate(["roll", "pitch", "yaw"])}
    return columns


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_all_ways_to_state_an_orientation_are_the_same(seed):
    R = Rotation.random(2, rng=np.random.default_rng(seed))
    for columns in orientation_columns(R).values():
        found = targets_from_frame(pd.DataFrame({**JOINTS, **XYZ, **columns}))
        assert found.kind == "poses"
        np.testing.assert_allclose(found.rotations, R.as_matrix(), atol=1e-9)


def test_units_are_those_of_the_names(tmp_path):
    in_deg = targets_from_frame(pd.DataFrame({**JOINTS, **XYZ}))
    in_rad = targets_from_frame(
        pd.DataFrame(
            {name.replace("deg", "rad"): np.radians(q) for name, q in JOINTS.items()}
            | {name.replace("mm", "m"): np.array(x) / 1000 for name, x in XYZ.items()}
        )
    )
    np.testing.assert_allclose(in_rad.joints, in_deg.joints, atol=ROUNDING)
    np.testing.assert_allclose(in_rad.tips, in_deg.tips, atol=1e-9)
    assert in_deg.kind == "positions"
    path = tmp_path / "targets.csv"
    pd.DataFrame({"name": ["a", "b"], **JOINTS, **XYZ, "temperature_degC": [20, 21]}).to_csv(path, index=False)
    read = read_targets(path)
    np.testing.assert_array_equal(read.joints, in_deg.joints)
    np.testing.assert_array_equal(read.temperature_degC, [20.0, 21.0])
    assert [read.label(row) for row in range(2)] == ["a", "b"]
    assert read.joint_columns == tuple(JOINTS)


def test_one_start_serves_all_poses():
    found = targets_from_frame(pd.DataFrame(XYZ), start=[0.1, 0.2])
    np.testing.assert_array_equal(found.joints, [[0.1, 0.2]] * 2)
    assert found.joint_columns is None


def test_directions_and_loads_are_taken():
    columns = {f"direction_{i}": [1, -1] for i in range(1, 7)} | {"load_1_Nm": [3.0, 4.0], "note": ["x", "y"]}
    found = targets_from_frame(pd.DataFrame({**JOINTS, **columns}))
    np.testing.assert_array_equal(found.directions, [[1] * 6, [-1] * 6])
    np.testing.assert_array_equal(found.session(found.joints).columns["load_1_Nm"], [3.0, 4.0])


QUATERNION = {"qw": [1.0, 1.0], "qx": [0.0, 0.0], "qy": [0.0, 0.0], "qz": [0.0, 0.0]}
BAD = [
    ({"q1": [1.0], "q2": [1.0]}, "unknown column 'q1'.*q1_deg, q1_rad or q1_mm"),
    ({**JOINTS, "x": [1, 2], "y": [1, 2], "z": [1, 2]}, "unknown column 'x'.*x_mm or x_m"),
    ({**JOINTS, **XYZ, "roll": [0, 0]}, "unknown column 'roll'.*roll_deg or roll_rad"),
    ({**JOINTS, "speed": [1, 2]}, "unknown column 'speed'"),
    ({"q1_deg": [1, 2], "q3_deg": [1, 2]}, "column of joint 2 is missing"),
    ({**JOINTS, "q1_rad": [1, 2]}, "q1_deg and q1_rad are the same joint"),
    ({**JOINTS, "x_mm": [1, 2], "y_mm": [1, 2]}, "the column z is missing beside x_mm, y_mm"),
    ({**JOINTS, **XYZ, "x_m": [1, 2]}, "the same quantity in two units"),
    ({**JOINTS, **XYZ, "qw": [1, 1]}, "the column qx is missing"),
    ({**JOINTS, **XYZ, **QUATERNION, "rx_deg": [0, 0]}, "stated twice: as a quaternion and as a rotation vector"),
    ({**JOINTS, **QUATERNION}, "a quaternion without a position"),
    ({**JOINTS, **XYZ, **QUATERNION, "qw": [2.0, 1.0]}, "expected a unit quaternion"),
    ({**JOINTS, **XYZ, **{f"r{i}{j}": [1, 1] for i in "123" for j in "123"}}, "expected a rotation matrix"),
    ({**XYZ}, "poses need start joints"),
    (
        {**JOINTS, **XYZ, "rx_rad": [90.0, 0], "ry_rad": [0.0, 0], "rz_rad": [0.0, 0]},
        "at most two turns, got 5156.62 deg",
    ),
    ({**JOINTS, **XYZ, **QUATERNION, "qx": [1e308, 0.0]}, "expected a unit quaternion"),
    ({"name": ["a", "b"]}, "expected targets, got no joints"),
    ({**JOINTS, "direction_1": [1, 1]}, "a direction of movement for each of 6 joints"),
    ({**JOINTS, "direction": ["command"] * 2, "status": ["ok"] * 2}, "corrected already"),
]


@pytest.mark.parametrize(("columns", "message"), BAD)
def test_a_table_that_is_ambiguous_or_incomplete_is_refused(columns, message, tmp_path):
    refuses(message, targets_from_frame, pd.DataFrame(columns))
    path = tmp_path / "targets.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    assert refuses(message, read_targets, path).file == path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty file"),
        ("q1_deg,q2_deg\n1,nan\n", "expected a finite number, got 'nan'"),
        ("q1_deg,q2_deg\n1,2\n3\n", "expected 2 values"),
        ("q1_deg;q2_deg\n1;1,234\n", "may be 1.234 or 1234"),
        ("# truearm-export: {}\nq1_deg\n1\n", "corrected already"),
        ("q1_deg,q1_deg\n1,2\n", "two columns have this name"),
        ("q1_deg,q2_deg\n", "at least one row"),
        ("\0\1", "binary"),
    ],
)
def test_a_broken_file_is_refused_with_its_place(text, message, tmp_path):
    path = tmp_path / "targets.csv"
    path.write_text(text, encoding="utf-8")
    refuses(message, read_targets, path)


def test_names_that_are_no_text_a_reflection_and_a_second_start_are_refused():
    refuses("names of columns", targets_from_frame, pd.DataFrame(np.zeros((1, 6))))
    refuses("start joints are given twice", targets_from_frame, pd.DataFrame({**JOINTS, **XYZ}), start=np.zeros(6))
    mirror = {f"r{i}{j}": [float(i == j)] * 2 for i in range(1, 4) for j in range(1, 4)} | {"r33": [-1.0, -1.0]}
    refuses("expected a rotation matrix", targets_from_frame, pd.DataFrame({**JOINTS, **XYZ, **mirror}))


@pytest.mark.parametrize("start", ["a", [np.nan] * 6, np.zeros((2, 6)), [[1.0], [1.0, 2.0]]])
def test_start_joints_are_finite_numbers(start):
    refuses("expected start joints as finite numbers", targets_from_frame, pd.DataFrame(XYZ), start=start)
