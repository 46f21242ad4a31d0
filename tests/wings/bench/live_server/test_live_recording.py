"""What the page is sent of a recording, without a page."""

from types import SimpleNamespace

import numpy as np
import pytest

import truearm as ta
from truearm.wings.bench.live_server.live import FRAMES_HZ, LiveRecording, drawn_arm
from truearm.wings.bench.recording.recording import Recording


def test_the_residual_of_a_reading_is_the_distance_of_its_point_from_the_model(tmp_path):
    session = ta.simulate("ur10", poses=40, seed=1).session
    model = ta.fit("ur10", session, model="kinematic").model
    session.rows(np.arange(4)).save(tmp_path / "simulated.csv")
    states = []
    for _ in range(2):  # a file that is continued is drawn at once
        source = f"replay:{tmp_path / 'simulated.csv'}@max"
        recording = Recording(source, tmp_path / "out.csv", model=model, samples_hz=FRAMES_HZ)
        server = SimpleNamespace(
            commands=lambda: iter(()), send=lambda _, state: states.append(state), send_newest=lambda _: None
        )
        [*LiveRecording(recording, drawn_arm(recording.arm, model)).follow(server)]
    readings = ta.read_session(tmp_path / "out.csv")
    expected = np.linalg.norm(model.predict(readings.angles) - readings.points, axis=1)
    assert [one.residual_mm for one in states[-1].readings] == pytest.approx(expected, abs=1e-9)
    assert len(expected) == 8
    assert [one.tip_mm for one in states[-1].readings] == pytest.approx(model.fit_.chain.tip_in_base(readings.angles))
