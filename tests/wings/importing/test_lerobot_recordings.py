"""Recordings of LeRobot become joint angles of the catalogue's arms by the calibration of the motors."""

import json

import numpy as np
import pytest

import truearm as ta
from truearm.readings import read_session
from truearm.wings.importing.foreign import JointScale

NAMES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
MOTOR = {"drive_mode": 0, "homing_offset": 0, "range_min": 1000, "range_max": 3000}


@pytest.fixture
def folder(tmp_path):
    motors = {name: {"id": i, **MOTOR} for i, name in enumerate(NAMES)}
    (tmp_path / "cal.json").write_text(json.dumps(motors))
    header = ",".join(f"{name}.pos" for name in NAMES)
    (tmp_path / "percent.csv").write_text(f"{header},gripper.pos,x_mm,y_mm,z_mm\n10,-20,0,50,5,80,1,2,3\n")
    state = ",".join(f"observation.state[{i}]" for i in range(6))
    (tmp_path / "list.csv").write_text(f"{state},x_mm,y_mm,z_mm\n2100,1800,2000,2500,2050,9,1,2,3\n")
    return tmp_path


def angles(truearm, folder, table, motors, unit):
    out = folder / "out.csv"
    truearm("import", folder / table, "--motors", motors, "--angle-unit", unit, "--out", out, "--force").done()
    return np.degrees(read_session(out).angles[0])


def test_shares_and_ticks_are_the_same_angles(truearm, folder):
    """A share of 10 is 100 of the 1000 ticks on either side of the middle."""
    expected = np.array([100, -200, 0, 500, 50]) * 360 / 4095
    for table, unit in (("percent.csv", "percent"), ("list.csv", "counts")):
        np.testing.assert_allclose(angles(truearm, folder, table, folder / "cal.json", unit), expected, atol=1e-6)


def test_an_so100_has_its_own_zeros(truearm, folder):
    found = angles(truearm, folder, "percent.csv", "so100:", "deg")
    np.testing.assert_allclose(found, [-10, 83.1324, -90, 17.2958, 5], atol=1e-4)


def test_in_python_too(folder):
    session = ta.import_table(folder / "percent.csv", scale=JointScale("percent"), motors=str(folder / "cal.json"))
    np.testing.assert_allclose(session.angles, np.radians([[100, -200, 0, 500, 50]]) * 360 / 4095, atol=1e-12)
    assert session.points.tolist() == [[1, 2, 3]]


def test_what_is_not_stated_is_asked_for(refused, folder):
    command = ["import", folder / "percent.csv", "--motors", folder / "cal.json", "--out", folder / "out.csv"]
    refused(command, "do not say their unit")
    refused([*command, "--angle-unit", "deg", "--zero", "1"], "states counts, signs and zeros")
    (folder / "other.csv").write_text("a,b\n1,2\n")
    command[1] = folder / "other.csv"
    refused([*command, "--angle-unit", "deg"], "expected columns of shoulder_pan")


@pytest.mark.parametrize(
    ("row", "options", "said"),
    [
        ("95,1,1,1,1", [], "LeRobot's values do not say their unit"),
        ("95,1,1,1,1", ["--angle-unit", "percent"], "percent need LeRobot's calibration"),
        ("1500,1500,1500,1500,1500", ["--angle-unit", "deg"], "from -180 to 180 deg, got 1500"),
        ("1,2,3,4,120", ["--angle-unit", "percent", "--motors", "cal.json"], "wrist_roll from -100 to 100 percent"),
        ("1,2,3,4,5", ["--angle-unit", "counts", "--motors", "cal.json"], "from 1000 to 3000 counts"),
        ("1500,1500,1500,1500,1500", ["--angle-unit", "deg", "--motors", "cal.json"], "Try: --angle-unit counts"),
    ],
)
def test_a_unit_that_the_ranges_contradict_is_refused(refused, folder, row, options, said):
    (folder / "t.csv").write_text(",".join(f"{name}.pos" for name in NAMES) + f"\n{row}\n")
    options = [folder / one if one == "cal.json" else one for one in options]
    refused(["import", folder / "t.csv", *options, "--out", folder / "out.csv"], "t.csv" * (len(row) > 20), said)


def test_lists_as_text_are_read(truearm, refused, folder):
    (folder / "lists.csv").write_text('observation.state,timestamp\n"[10, -20, 0, 50, 5, 9]",0.1\n')
    found = angles(truearm, folder, "lists.csv", folder / "cal.json", "percent")
    np.testing.assert_allclose(found, np.array([100, -200, 0, 500, 50]) * 360 / 4095, atol=1e-6)
    (folder / "bad.csv").write_text((folder / "lists.csv").read_text() + '"[1, 2]",0.2\n')
    command = ["import", folder / "bad.csv", "--motors", "so101", "--angle-unit", "deg", "--out", folder / "o.csv"]
    refused(command, "line 3, column 'observation.state': expected a list of 6 numbers, got 2")
    (folder / "two.csv").write_text(f'observation.state,timestamp\n"{[1] * 12}",0.1\n')
    refused([*command[:1], folder / "two.csv", *command[2:]], "expected 5 or 6 numbers of one arm", "got 12")


def test_the_folder_of_a_data_set_is_answered_with_its_file(refused, folder):
    (folder / "ds" / "meta").mkdir(parents=True)
    (folder / "ds" / "meta" / "info.json").write_text("{}")
    refused(["import", folder / "ds", "--preview"], "episode_000000.parquet")


def test_a_recording_is_no_session(refused, folder):
    refused(["fit", folder / "percent.csv", "--arm", "so101", "--out", folder / "m.truearm"], "Try: truearm import")
