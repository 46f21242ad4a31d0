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
