"""Replay and the virtual arm: stops at every pose, smooth between, at any speed."""

import time
from itertools import islice

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.wings.bench.sources import Sample, open_source
from truearm.wings.bench.sources.replay import RATE_HZ, STOP_S


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "session.csv"
    path.write_text("q1_deg,q2_mm,x_mm,y_mm,z_mm,temperature_degC,load_1_Nm\n0,10,1,2,3,20,5\n90,20,,,,21,6\n")
    return path


def samples_in(source):
    return [one for one in source.samples() if isinstance(one, Sample)]


def test_a_replay_stops_at_every_reading_with_all_that_is_known_of_it(file):
    source = open_source(f"replay:{file}@max")
    assert (source.prismatic, source.has_points) == ((2,), True)
    samples = samples_in(source)
    assert np.diff([one.time_s for one in samples]) == pytest.approx(1 / RATE_HZ)
    stop = int(STOP_S * RATE_HZ) + 1
    for one in samples[:stop]:
        assert one.joint_angles_rad.tolist() == [0, 10]
        assert one.tip_in_reference_mm.tolist() == [1, 2, 3]
        assert (one.temperature_degC, one.columns["load_1_Nm"]) == (20, 5)
    for one in samples[-stop:]:
        assert one.joint_angles_rad.tolist() == [pytest.approx(np.pi / 2), 20]
        assert one.tip_in_reference_mm is None
    between = np.array([one.joint_angles_rad for one in samples[stop:-stop]])
    assert (np.diff(between, axis=0) > 0).all()


def test_a_replay_takes_its_time(file):
    start = time.monotonic()
    samples = samples_in(open_source(f"replay:{file}@20"))
    assert time.monotonic() - start >= samples[-1].time_s / 20 > 0.1


def test_a_virtual_arm_stays_within_its_limits_and_says_where_its_tip_is():
    arm = ta.load_arm("ur10")
    samples = list(islice(open_source("virtual:ur10@max").samples(), 200))
    angles = np.array([one.joint_angles_rad for one in samples])
    assert (angles > arm.limits[:, 0] - 1e-3).all()
    assert (angles < arm.limits[:, 1] + 1e-3).all()
    tips = np.array([one.tip_in_reference_mm for one in samples])
    assert arm.forward(angles).tip_in_base == pytest.approx(tips, abs=0.5)  # mm: the noise of the encoders


@pytest.mark.parametrize("name", ["replay:{}@fast", "replay:{}@0", "replay:{}@-1", "replay:{}@nan", "replay:none.csv"])
def test_what_cannot_be_replayed_is_refused(file, name):
    refuses(None, open_source, name.format(file))
