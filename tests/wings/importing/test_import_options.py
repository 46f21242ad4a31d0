"""Options of ``truearm import`` that join tables, name columns and show what was understood."""

import json

import numpy as np
import pytest

from truearm.readings import read_session

ANGLES = np.array([[10.0, 120.0, 40.0], [50.0, -80.0, 130.0], [-30.0, 150.0, 70.0]])
POINTS = np.array([[100.0, 0.0, 200.0], [150.0, -50.0, 250.0], [300.0, 20.0, 100.0]])


@pytest.fixture
def written(tmp_path):
    def write(name, columns):
        rows = zip(*columns.values(), strict=True)
        text = "\n".join([",".join(columns), *(",".join(str(cell) for cell in row) for row in rows)])
        (tmp_path / name).write_text(text + "\n")
        return tmp_path / name

    return write


@pytest.fixture
def imported(truearm, tmp_path):
    def run(*arguments):
        truearm("import", *arguments, "--out", tmp_path / "out.csv", "--force")
        return read_session(tmp_path / "out.csv")

    return run


JOINTS = {f"J{i + 1}_deg": column for i, column in enumerate(ANGLES.T.tolist())}
TIP = dict(zip(("X_mm", "Y_mm", "Z_mm"), POINTS.T.tolist(), strict=True))


def test_tables_are_joined_by_row_and_by_name(imported, written):
    points = written("points.csv", TIP | {"Hole": ["c", "b", "a"]})
    by_row = imported(written("joints.csv", JOINTS), "--with", points)
    np.testing.assert_allclose(by_row.points, POINTS)
    joints = written("named.csv", JOINTS | {"pose": ["a", "b", "c"]})
    for by in ("name", "pose=Hole"):
        np.testing.assert_allclose(imported(joints, "--with", points, "--by", by).points, POINTS[::-1])


def test_logs_are_joined_by_time(imported, written):
    t = np.arange(0, 60, 0.1)
    place = np.interp(t, np.arange(0, 60, 2) // 4 * 4 + [0, 3] * 15, np.repeat(RANDOM, 2))
    joints = {"time_s": t, "J1_deg": 100 * place, "J2_deg": 50 - 60 * place}
    tip = {"time_s": t - 5, "X_mm": 300 * place, "Y_mm": 100 - 200 * place, "Z_mm": 0 * t + 5}
    tables = (written("joints.csv", joints), "--with", written("points.csv", tip))
    options = ("--by", "time", "--time-offset", "5", "--still", "1", "--standstill-mm", "0.1")
    session = imported(*tables, *options)
    assert 10 <= len(session) <= 15
    np.testing.assert_allclose(session.points[:, 0], 3 * np.degrees(session.angles[:, 0]), atol=1e-6)


RANDOM = np.random.default_rng(3).permutation(np.linspace(-1, 1, 15))


def test_other_columns_are_named(imported, written):
    more = {"ua": [0.01] * 3, "ub": [0.02] * 3, "uc": [0.03] * 3, "nest": ["A", "B", "A"], "ball": ["p", "q", "p"]}
    table = written("table.csv", JOINTS | TIP | more | {"mass": [1.0, 2.0, 3.0]})
    named = ("--point-std", "ua,ub,uc", "--column", "seat=nest", "--column", "payload_kg=mass", "--serial-number", "7")
    session = imported(table, *named)
    np.testing.assert_allclose(session.point_std[0], [0.01, 0.02, 0.03])
    assert session.seat.tolist() == ["A", "B", "A"]
    assert session.columns["payload_kg"].tolist() == [1, 2, 3]
    assert set(session.serial_number) == {"7"}
    assert imported(table, "--column", "tip=ball").tip.tolist() == ["p", "q", "p"]
    assert (imported(table, "--u-mm", "0.05").point_std == 0.05).all()


def test_joints_are_coupled(imported, written):
    session = imported(written("table.csv", JOINTS | TIP), "--couple", "J3+=J2")
    np.testing.assert_allclose(np.degrees(session.angles[:, 2]), ANGLES[:, 2] + ANGLES[:, 1])


def test_the_order_of_euler_angles_is_stated(imported, written):
    table = written("table.csv", JOINTS | TIP | {"e1": [90] * 3, "e2": [0] * 3, "e3": [0] * 3})
    half = np.sqrt(0.5)
    turned = ("--orientation", "e1,e2,e3", "--orientation-unit", "deg", "--orientation-order")
    np.testing.assert_allclose(imported(table, *turned, "ZYX").quaternion[0], [half, 0, 0, half], atol=1e-9)
    np.testing.assert_allclose(imported(table, *turned, "xyz").quaternion[0], [half, half, 0, 0], atol=1e-9)


def test_a_part_of_an_archive_is_named(imported, tmp_path):
    whole = np.hstack([ANGLES, POINTS])
    np.savez(tmp_path / "both.npz", first=whole, second=whole[:2])
    options = ("--angles", "1-3", "--angle-unit", "deg", "--point", "4-6", "--point-unit", "mm")
    assert len(imported(tmp_path / "both.npz", "--part", "second", *options)) == 2


def test_each_of_two_tables_has_a_part_of_its_own(refused, imported, tmp_path):
    robot, tracker = tmp_path / "robot.npz", tmp_path / "tracker.npz"
    np.savez(robot, q=ANGLES, z=np.zeros((2, 2)), t=np.zeros((2, 3)))
    np.savez(tracker, q=POINTS, p=-POINTS)
    options = ("--angles", "1-3", "--angle-unit", "deg", "--point", "q[0],q[1],q[2]")
    one = imported(robot, "--part", "q", "--with", tracker, *options)
    np.testing.assert_allclose(one.points, POINTS)
    other = (*options[:-1], "p[0],p[1],p[2]")
    np.testing.assert_allclose(imported(robot, "--part", "q", "--with", tracker, "--part", "p", *other).points, -POINTS)
    refused(
        ["import", robot, "--part", "q", "--part", "p", "--preview"],
        "2 parts are stated, expected one for each of 1 tables",
    )


def test_a_preview_writes_nothing(truearm, written, tmp_path):
    table = written("table.csv", JOINTS | TIP)
    shown = truearm("import", table, "--preview").out
    assert "120" in shown
    assert "J1_deg .. J3_deg" in shown
    record = json.loads(truearm("import", table, "--preview", "--json").out)
    assert (record["file"], record["n_readings"], record["units"]) == (None, 3, ["deg"] * 3)
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]
