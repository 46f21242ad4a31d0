"""LeRobot's calibration: its values as its own formulas have them, its zeros corrected, and everything else refused."""

import json

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm.arm import with_zeros
from truearm.identification.references.alignment import align
from truearm.wings.exports.targets.lerobot_motors import (
    MOTORS,
    homing_changes,
    joint_values,
    motors_and_arm,
    parse_motors,
)

RANGES = {"shoulder_pan": (758, 3292), "shoulder_lift": (801, 3208), "elbow_flex": (864, 3078)}
RANGES |= {"wrist_flex": (862, 3207), "wrist_roll": (0, 4095), "gripper": (2034, 3486)}
HOMING = (-1470, 157, 979, -1071, 1203, -1404)


def calibration(**changes) -> str:
    """A file as LeRobot writes it, with other numbers of a motor."""
    motors = {
        name: {"id": i, "drive_mode": 0, "homing_offset": homing, "range_min": low, "range_max": high}
        for i, ((name, (low, high)), homing) in enumerate(zip(RANGES.items(), HOMING, strict=True), 1)
    }
    for name, numbers in changes.items():
        motors[name] |= numbers
    return json.dumps(motors, indent=4)


@pytest.fixture(scope="module")
def so101() -> ta.KinematicModel:
    """A model of an SO-101 with planted zeros of the three parallel joints."""
    nominal = ta.load_arm("so101")
    off = with_zeros(nominal, np.radians([0.0, 4.0, -3.0, 2.0, 0.0]))
    q = np.random.default_rng(0).uniform(nominal.limits[:, 0], nominal.limits[:, 1], (60, 5)) * 0.8
    noise = np.random.default_rng(1).normal(0, 0.01, (60, 3))
    return ta.KinematicModel(nominal).fit(q, off.chain.tip_in_base(q) + noise)


def test_values_become_angles_by_the_formulas_of_lerobot():
    """`_normalize` of its motors bus, written out: ticks, degrees and shares of a range of one position."""
    motors = parse_motors(calibration(wrist_flex={"drive_mode": 1}).encode())
    ticks = np.array([[1000.0, 1500.0, 2000.0, 2500.0, 3000.0]])
    low, high = (np.array([RANGES[name][i] for name in MOTORS], dtype=float) for i in (0, 1))
    degrees = (ticks - (low + high) / 2) * 360 / 4095
    shares = (ticks - low) / (high - low) * 200 - 100
    shares[:, MOTORS.index("wrist_flex")] *= -1
    for unit, values in (("counts", ticks), ("deg", degrees), ("percent", shares)):
        scale = joint_values(unit, motors, "so101")
        np.testing.assert_allclose(np.degrees(scale.to_angles(values)), degrees, rtol=0, atol=1e-10)
        np.testing.assert_allclose(scale.to_values(scale.to_angles(values)), values, rtol=0, atol=1e-9)


def test_an_so100_at_the_angles_of_lerobot_has_the_shape_of_an_so101():
    """Both have the same links: shoulder, elbow and wrist as seen from the shoulder, and the direction of the roll."""
    values = np.random.default_rng(0).uniform(-60, 60, (20, 5))

    def shape(name: str) -> np.ndarray:
        q = joint_values("deg", None, name).to_angles(values)
        axes = ta.load_arm(name).chain
        points = []
        for row in q:
            T, seen = np.eye(4), []
            for i, angle in enumerate(row):
                T = T @ axes.fixed[i]
                seen.append(T.copy())
                c, s = np.cos(angle), np.sin(angle)
                T = T @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
            across = seen[1][:3, 2]  # out of the plane of the links
            flat = [one[:3, 3] - across * (across @ (one[:3, 3] - seen[1][:3, 3])) for one in seen[1:4]]
            points.append([*flat, flat[-1] + 100 * seen[4][:3, 2]])
        return np.array(points)

    one, other = shape("so100"), shape("so101")
    for row, (mine, theirs) in enumerate(zip(one, other, strict=True)):
        T = align(mine, theirs)
        # Catalogue files round angles to 1e-9 deg and lengths to 1e-9 mm.
        np.testing.assert_allclose(mine @ T[:3, :3].T + T[:3, 3], theirs, rtol=0, atol=1e-4, err_msg=str(row))
    # All of them turned about the base's axis by the same angle, the other way round.
    bases = [np.unwrap(np.arctan2(*(points[:, -1] - points[:, 0])[:, [1, 0]].T)) for points in (one, other)]
    assert np.ptp((bases[0] - bases[1] + np.pi) % (2 * np.pi) - np.pi) < 1e-6


def test_the_zeros_of_a_model_become_homing_offsets(so101, tmp_path):
    source, out = tmp_path / "cal.json", tmp_path / "out.json"
    source.write_text(calibration())
    result = ta.export(so101, out, format="lerobot", source=source)
    before, after = json.loads(source.read_text()), json.loads(out.read_text())
    found = [after[name]["homing_offset"] - before[name]["homing_offset"] for name in MOTORS]
    # Ticks of 4, -3 and 2 deg; a tick is 0.088 deg, the noise 0.01 mm at 300 mm.
    np.testing.assert_allclose(found, [0, -4 * 4095 / 360, 3 * 4095 / 360, -2 * 4095 / 360, 0], rtol=0, atol=1)
    for name in MOTORS:
        after[name]["homing_offset"] = before[name]["homing_offset"]
    assert after == before
    changed = [a != b for a, b in zip(source.read_text().splitlines(), out.read_text().splitlines(), strict=True)]
    assert sum(changed) == 3
    assert any("shoulder_lift 157 to 11" in line for line in result.remarks)
    assert any("calibration of the readings" in line for line in result.remarks)
    assert result.manifest.loss.exported_mm < 0.1 * result.manifest.loss.nominal_mm
    # Read by LeRobot with the new offset, the same encoder shows the true angle: present = encoder - homing.
    true_deg = np.array([0.0, 4.0, -3.0, 2.0, 0.0])
    np.testing.assert_allclose(-np.array(found) * 360 / 4095, true_deg, rtol=0, atol=0.09)


def test_what_is_there_is_never_replaced(so101, tmp_path, refused):
    (tmp_path / "cal.json").write_text(calibration())
    so101.save(tmp_path / "m.truearm")
    command = ["export", tmp_path / "m.truearm", "--as", "lerobot", "--original", tmp_path / "cal.json", "--out"]
    for out in ("cal.json", "other.json"):
        (tmp_path / "other.json").write_text(calibration())
        refused([*command, tmp_path / out], "another name")


def test_signs_of_an_so100():
    assert homing_changes(np.radians([1.0, 1.0, 0.0, 0.0, 0.0]), "so100").tolist()[:2] == [11, -11]
    assert motors_and_arm("so100:")[1] == "so100"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "no JSON"),
        ("[1]", "got list"),
        ("{}", "expected the calibration of an SO-100 or SO-101"),
        ('{"a": {"b": 1, "b": 2}}', "stated twice"),
        ("[" * 100_000, "no JSON"),
        (calibration(gripper={"id": 1}), "an id of its own"),
        (calibration(gripper={"range_min": 4000}), "range_min of gripper below range_max"),
        (calibration(gripper={"range_max": 5000}), "from 0 to 4095, got 5000"),
        (calibration(gripper={"homing_offset": 1.5}), "whole number"),
        (calibration(gripper={"homing_offset": True}), "whole number"),
        (calibration(gripper={"speed": 1}), "expected gripper with the keys"),
        (calibration(wrist_roll={"drive_mode": 2}), "from 0 to 1"),
    ],
)
def test_another_file_is_refused(text, said):
    refuses(said, parse_motors, text.encode())


def test_what_cannot_be_exported_is_refused(so101, tmp_path):
    def export(model, **options):
        return ta.export(model, tmp_path / "out.json", format="lerobot", **options)

    refuses("calibration that LeRobot uses is not stated", export, so101)
    (tmp_path / "cal.json").write_text(calibration(shoulder_lift={"homing_offset": -2040}))
    refuses("homing offset of shoulder_lift would be -20", export, so101, source=tmp_path / "cal.json")
    ur10 = ta.load_arm("ur10")
    q = np.random.default_rng(0).uniform(-1, 1, (30, 6))
    other = ta.KinematicModel(ur10).fit(q, ur10.chain.tip_in_base(q))
    refuses("expected the model of an SO-100 or SO-101", export, other, source=tmp_path / "cal.json")
    assert not (tmp_path / "out.json").exists()


@pytest.mark.parametrize(
    ("unit", "said"), [(None, "do not say their unit"), ("gon", "no unit"), ("percent", "need LeRobot's calibration")]
)
def test_a_unit_is_asked_for(unit, said):
    refuses(said, joint_values, unit, None, "so101")
