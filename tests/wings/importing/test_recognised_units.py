"""Units of what is recognised beside angles and points, what is not read, and columns of a second table."""

import numpy as np
import pandas as pd
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.importing.foreign import JointScale, TableColumns
from truearm.wings.importing.foreign.tables import as_table, read_foreign_tables
from truearm.wings.importing.tables.table import TableForm

N = 8
RNG = np.random.default_rng(0)
JOINTS = {f"J{i + 1} [deg]": RNG.uniform(-150, 150, N) for i in range(2)}
POINTS = {f"{axis} [mm]": RNG.uniform(-500, 500, N) for axis in "XYZ"}


def read(*tables, columns=None, **options):
    whole = [as_table(pd.DataFrame(one), TableForm()) for one in tables]
    return read_foreign_tables(whole, columns or TableColumns(), JointScale(), **options)


@pytest.mark.parametrize(
    ("name", "value"),
    [("Temperature [K]", 294.65), ("temp_F", 70.7), ("Temperature [°C]", 21.5), ("temperature", 21.5)],
)
def test_temperatures_become_degrees_celsius(name, value):
    found = read(JOINTS | POINTS | {name: value})
    assert found.session.temperature_degC == pytest.approx(21.5, abs=1e-9)
    stated = read(JOINTS | POINTS | {name: value}, columns=TableColumns(temperature=name))
    assert stated.session.temperature_degC == pytest.approx(21.5, abs=1e-9)


@pytest.mark.parametrize("name", ["payload [g]", "payload_g"])
def test_masses_become_kilograms(name):
    found = read(JOINTS | POINTS | {name: 1500.0}, columns=TableColumns(others={"payload_kg": name}))
    for one in (found, read(JOINTS | POINTS | {name: 1500.0})):
        assert one.session.columns["payload_kg"].tolist() == [1.5] * N


def test_torques_keep_or_become_the_unit_that_is_named():
    torques = {f"torque_{i} [mNm]": 2.0 for i in (1, 2)}
    assert read(JOINTS | POINTS | torques).session.columns["load_1_mNm"][0] == 2.0
    stated = read(JOINTS | POINTS | torques, columns=TableColumns(others={"load_1_Nm": "torque_1"}))
    assert stated.session.columns["load_1_Nm"][0] == 0.002


def test_uncertainties_have_a_unit_of_their_own():
    found = read(JOINTS | POINTS | {f"u{axis} [um]": 10.0 for axis in "xyz"})
    assert found.session.point_std == pytest.approx(0.01)


@pytest.mark.parametrize("unit", ["ft", "km", "kg"])
def test_points_in_no_unit_of_points_are_refused(unit):
    with pytest.raises(InputError, match=f"the points are in {unit}.*--point-unit"):
        read(JOINTS | {f"{axis} [{unit}]": values for axis, values in zip("XYZ", POINTS.values(), strict=True)})


def test_another_quantity_is_refused():
    with pytest.raises(InputError, match=r"column 'T \[kg\]': expected numbers in degC, got kg"):
        read(JOINTS | POINTS | {"T [kg]": 20.0}, columns=TableColumns(temperature="T"))
    assert (
        read(JOINTS | POINTS | {"T_m": 20.0}, columns=TableColumns(temperature="T_m")).session.temperature_degC[0] == 20
    )


def test_gon_are_angles():
    found = read({f"J{i} [gon]": [100.0, 200.0] for i in (1, 2)} | {axis: [1.0, 2.0] for axis in "XYZ"})
    np.testing.assert_allclose(found.session.angles, np.radians([[90, 90], [180, 180]]), rtol=1e-15)


@pytest.mark.parametrize("values", [[np.nan] * N, ["n.a."] * N])
def test_a_temperature_without_numbers_is_not_read_and_said(values):
    found = read(JOINTS | POINTS | {"Temperature": values})
    assert found.session.temperature_degC is None
    assert any(sentence.startswith("Temperature: ") for sentence in found.remarks)
    assert not any("temperature" in phrase for phrase in found.assumed)


def test_goals_with_gaps_are_no_positions():
    found = read(JOINTS | POINTS | {f"goal_{axis}": [np.nan, *range(N - 1)] for axis in "xyz"})
    assert found.session.position is None
    assert "goal_x, goal_y, goal_z are empty in some rows: not read." in found.remarks


def test_columns_that_are_not_read_are_named():
    more = {f"quat[{i}]": 0.5 for i in range(4)} | {f"joint_temperatures_{i}": 30.0 for i in range(2)}
    found = read(JOINTS | POINTS | more | {"timestamp": np.arange(N)})
    assert found.remarks == (f"Not read: {', '.join(more)}.",)
    assert read(JOINTS | POINTS).remarks == ()


def test_what_is_stated_is_not_said_to_be_recognised():
    other = {f"P{axis}": values for axis, values in zip("xyz", POINTS.values(), strict=True)}
    found = read(JOINTS | POINTS | other, columns=TableColumns(points=("Px", "Py", "Pz")))
    assert not any("X [mm]" in phrase for phrase in found.assumed)


def test_a_stated_name_wins_over_a_recognised_column():
    options = {"session_name": "May", "serial_number": "7"}
    found = read(JOINTS | POINTS | {"session": "a", "serial_number": "b"}, **options)
    assert (set(found.session.session), set(found.session.serial_number)) == ({"May"}, {"7"})
    with pytest.raises(InputError, match="the session is given twice"):
        read(JOINTS | POINTS | {"run": "a"}, columns=TableColumns(session="run"), **options)


def test_two_sets_of_points_are_settled_by_the_option_that_is_named():
    both = POINTS | {f"P{axis}": values for axis, values in zip("xyz", POINTS.values(), strict=True)}
    for tables in ((JOINTS | both,), (JOINTS, both), (JOINTS | both, both)):
        refuses(r"--point 'X \[mm\],Y \[mm\],Z \[mm\]'", read, *tables)
        found = read(*tables, columns=TableColumns(points=("Px", "Py", "Pz")))
        np.testing.assert_array_equal(found.session.points, np.stack([*POINTS.values()], axis=1))


def test_two_runs_of_angles_are_settled_by_the_option_that_is_named():
    both = JOINTS | {f"A{i + 1} [deg]": values for i, values in enumerate(JOINTS.values())}
    for tables in ((both | POINTS,), (both, POINTS)):
        refuses(r"--angles '", read, *tables)
        stated = TableColumns(angles=("J1", "J2"), points=("X", "Y", "Z"))
        assert read(*tables, columns=stated).session.n_joints == 2


# A second table ------------------------------------------------------------------------------------------------------


def test_what_the_table_of_points_has_beside_them_is_read():
    names = [f"P{i}" for i in range(N)]
    found = read(JOINTS | {"pose": names}, POINTS | {"Name": names[::-1], "Temperature": np.arange(N)}, by="name")
    assert found.session.temperature_degC.tolist() == list(range(N))[::-1]
    assert found.session.position.tolist() == names


def test_points_and_orientations_of_both_tables_are_those_of_the_second():
    turned = {"rz": 90.0, "ry": 0.0, "rx": 0.0}
    displayed = dict.fromkeys((*POINTS, *turned), 0.0)
    found = read(
        JOINTS | displayed,
        POINTS | turned,
        columns=TableColumns(points=("X", "Y", "Z"), orientation=("rx", "ry", "rz")),
        orientation_unit="deg",
    )
    np.testing.assert_array_equal(found.session.points, np.stack([*POINTS.values()], axis=1))
    np.testing.assert_allclose(found.session.quaternion[0], np.sqrt([0.5, 0, 0, 0.5]), atol=1e-15)


def test_an_orientation_of_the_first_table_is_read():
    columns = TableColumns(orientation=("rx", "ry", "rz"))
    found = read(JOINTS | {"rx": 0.0, "ry": 0.0, "rz": 0.0}, POINTS, columns=columns, orientation_unit="deg")
    assert found.session.quaternion[0].tolist() == [1, 0, 0, 0]


def test_data_frames_are_joined():
    columns = {"points_from": pd.DataFrame(POINTS), "by": "row"}
    assert len(ta.import_table(pd.DataFrame(JOINTS), **columns)) == N
    refuses("got dict", ta.import_table, JOINTS)


def test_angles_that_are_called_those_of_encoders_are_asked_about_in_the_table():
    joints = {f"Encoder {i}": values for i, values in enumerate(JOINTS.values(), 1)}
    error = refuses("encoder counts", read, joints | POINTS)
    assert error.column == "Encoder 1"
    assert error.hint == "--counts-per-turn 65536; or --angle-unit deg or rad, if they are angles"
    of_table = {f"{name} [counts]": values for name, values in joints.items()}
    assert refuses("encoder counts", read, of_table | POINTS).hint == "--counts-per-turn 65536"
