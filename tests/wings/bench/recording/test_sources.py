"""`list_sources`, `try_source`: what looks wrong with a source, and what does not."""

import importlib.util
import json
from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.wings.bench.sources import Notice, Sample, Source, connections

RANDOM = np.random.default_rng(1)
MOVEMENT = np.cumsum(np.concatenate([np.zeros((1, 6)), RANDOM.uniform(-0.05, 0.06, (100, 6))]), axis=0)


def findings(angles, arm=None, **keys):
    samples = [Notice("connected"), *(Sample(k / 20, one) for k, one in enumerate(angles))]
    return ta.try_source(Source("test", lambda: iter(samples), **keys), arm=arm).findings


def change(joint, values):
    changed = MOVEMENT.copy()
    changed[:, joint - 1] = values
    return changed


def test_a_right_source_has_no_findings():
    assert findings(MOVEMENT, "ur10") == ()


def test_a_joint_that_never_moves():
    (said,) = findings(change(4, 0.3), "ur10")
    assert said.startswith("J4 never moved")


def test_nothing_moves():
    (said,) = findings(np.full((50, 6), 0.3), "ur10")
    assert said.startswith("no joint moved")


@pytest.mark.parametrize(
    ("factor", "said"), [(180 / pi, "probably degrees or counts"), (pi / 180 / 8, "probably radians, not degrees")]
)
def test_a_wrong_unit(factor, said):
    assert any(said in one for one in findings(factor * (MOVEMENT + 1.0), "ur10"))


def test_a_wrong_sign_and_a_wrong_zero_by_the_limits_of_the_arm():
    limits = np.radians([[-5, 120], [-30, 30], *[[-360, 360]] * 4])
    arm = replace(ta.load_arm("ur10"), lower=limits[:, 0], upper=limits[:, 1], working_pose=np.zeros(6))
    swing = np.linspace(0, 1, 101) ** 1.5
    turning = change(1, radians(-100) * swing)
    turning[:, 1] = radians(90) + radians(20) * swing
    assert findings(turning, arm) == (
        "J1 is at -100.0 deg, its limits are -5 and 120; with the opposite sign it is within them",
        "J2 is at 110.0 deg, its limits are -30 and 30; with -90 deg it is within them: check zero",
    )


def test_another_arm_a_jump_coarse_steps_and_a_slow_device():
    assert findings(MOVEMENT[:, :3], "ur10") == ("the source gives 3 joints, arm 'ur10' has 6",)
    jumping = change(1, (np.linspace(3, 4, 101) + pi) % (2 * pi) - pi)
    assert any(one.startswith("J1 jumps by 359 deg") for one in findings(jumping))
    step = 2 * pi / 1024
    coarse = change(2, step * np.round(np.linspace(0, 0.2, 101) / step))
    assert any("J2 is read in steps of 0.352 deg: record with --spread 0.7" in one for one in findings(coarse))
    slow = [Sample(float(k), one) for k, one in enumerate(MOVEMENT[:5])]
    trial = ta.try_source(Source("slow", lambda: iter(slow)))
    assert "1.0 samples a second: record with --still 4.0" in trial.findings
    frozen = [Sample(7.0, one) for one in MOVEMENT[:5]]
    trial = ta.try_source(Source("frozen", lambda: iter(frozen)))
    assert any(one.startswith("the clock of the device stands still") for one in trial.findings)


def test_a_source_that_says_nothing_or_points_only():
    trial = ta.try_source(Source("silent", lambda: iter([Notice("no connection")])))
    (said,) = trial.findings
    assert said.startswith("no sample arrived: where nothing answers")
    assert trial.notices == ("no connection",)
    json.dumps(trial.to_dict(), allow_nan=False)
    points = [Sample(k / 10, np.empty(0), np.full(3, float(k))) for k in range(10)]
    assert ta.try_source(Source("tracker", lambda: iter(points), has_points=True)).findings == ()
    still = [Sample(k / 10, np.empty(0), np.zeros(3)) for k in range(10)]
    assert ta.try_source(Source("tracker", lambda: iter(still), has_points=True)).findings != ()


def test_the_trial_ends_in_the_time_of_the_source():
    def endless():
        k = 0
        while True:
            yield Sample(k / 20, MOVEMENT[k % 100])
            k += 1

    assert len(ta.try_source(Source("endless", endless), seconds=2.0).samples) == 41


def test_what_it_prints():
    samples = [Sample(k / 20, np.array([0.01 * k**1.5, 5.0 * k])) for k in range(30)]
    text = str(ta.try_source(Source("test", lambda: iter(samples), prismatic=(2,))))
    lines = text.splitlines()
    assert lines[0] == "test: 30 samples, 20 a second. Nothing looks wrong."
    assert lines[1].split("  ")[0] == "time [s]"
    assert "J2 [mm]" in lines[1]
    assert len(lines) == 12


@pytest.mark.parametrize(
    ("name", "text", "package", "extra"),
    [
        ("ros2:arm.toml", 'joints = ["pan"]', "cyclonedds", "ros2"),
        ("mqtt:arm.toml", 'broker = "host"\ntopic = "arm"\njoints = ["q"]', "paho-mqtt", "mqtt"),
        ("opcua:host", "", "asyncua", "opcua"),
        ("lines:arm.toml", 'connection = "serial:COM3"\npattern = "{J1}"', "pyserial", "live"),
    ],
)
def test_without_its_package_a_source_says_what_to_install(tmp_path, monkeypatch, name, text, package, extra):
    def missing(name):
        raise ImportError(name)

    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(text)
    monkeypatch.setattr(connections.importlib, "import_module", missing)
    refuses(rf"needs the package {package}, .*Try: pip install 'truearm\[{extra}\]'", ta.open_source, name)


def test_kinds_say_what_is_missing(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    listed = {one["kind"]: one["missing"] for one in ta.list_sources().to_dict()["sources"]}
    assert listed["feetech"] == "serial ports: pip install 'truearm[live]'"
    assert listed["ros2"] == "pip install 'truearm[ros2]'"
    assert listed["replay"] == listed["rtde"] == listed["egm"] == ""
