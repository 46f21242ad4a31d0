"""The model in force: a fit in a process of its own replaces it, a failed or worse one does not; `save` writes it."""

from __future__ import annotations

import time

import numpy as np
import pytest

import truearm as ta
from truearm.errors import InputError
from truearm.sources import Sample, Source
from truearm.workflows import model_in_force
from truearm.workflows.fit_process import Fitted, why_worse
from truearm.workflows.live_demo import demo_recording
from truearm.workflows.model_in_force import ModelInForce
from truearm.workflows.recording import Recording


@pytest.fixture(scope="module")
def session():
    return ta.simulate("ur10", poses=40, seed=1).session


def news_until_the_end(of_fit):
    events, until_s = [], time.monotonic() + 60
    while time.monotonic() < until_s and not any(event.kind in ("model", "refused") for event in events):
        events += of_fit()
        time.sleep(0.05)
    return events


def test_readings_become_the_model_in_force_and_its_file(tmp_path, session):
    session.rows(np.arange(30)).save(tmp_path / "simulated.csv")
    out, model_file = tmp_path / "out.csv", tmp_path / "arm.truearm"
    source = ta.open_source(f"replay:{tmp_path / 'simulated.csv'}@max")
    recording = Recording(source, out, arm=ta.load_arm("ur10"), out_model=model_file)
    for sample in source.samples():
        if isinstance(sample, Sample):
            [*recording.on_sample(sample)]
    assert [event.text for event in recording.on_command("save")] == ["no model is in force yet: refit first"]
    (begun,) = recording.on_command("refit")
    assert begun.text == "fitting 30 readings; further ones are taken meanwhile"
    assert [event.text for event in recording.on_command("refit")] == ["a fit is under way"]
    events = news_until_the_end(recording.news_of_fit)
    assert events[-1].kind == "learned"
    assert any(event.text.startswith("fit: ") for event in events)
    (new,) = (event for event in events if event.kind == "model")
    assert new.text.startswith("new model in force. Mean error ")
    assert recording.corrected().U_mm.shape == (3,)
    (saved,) = recording.on_command("save")
    assert saved.text == f"model in {model_file}"
    assert ta.load_model(model_file).predict(session.angles[:1]) == pytest.approx(
        recording.model.predict(session.angles[:1])
    )
    recording.close()


def test_a_failed_fit_leaves_the_model_in_force(tmp_path, session):
    few = tmp_path / "few.csv"
    session.rows(np.arange(2)).save(few)
    known = ta.fit("ur10", session, model="kinematic").model
    in_force = ModelInForce(ta.load_arm("ur10"), known, few, None)
    assert in_force.save().kind == "refused"
    in_force.refit(2)
    (refused,) = (event for event in news_until_the_end(in_force.news) if event.kind == "refused")
    assert refused.text.startswith("the fit has failed, and the model in force stays: ")
    assert in_force.model is known


def test_a_worse_fit_leaves_the_model_in_force(tmp_path, session, monkeypatch):
    good = ta.fit("ur10", session, model="kinematic").model
    noisy = session.points + np.random.default_rng(1).normal(0.0, 2.0, session.points.shape)
    bad = ta.fit("ur10", ta.Session(session.angles, points=noisy), model="kinematic").model
    file = tmp_path / "session.csv"
    session.save(file)
    assert "of the model in force" in why_worse(Fitted(bad, "", 40), good, session, 0)
    assert why_worse(Fitted(good, "", 40), bad, session, 0) == ""
    assert why_worse(Fitted(bad, "", 40), good, session, 35) == ""  # of five further readings, nothing follows

    class Done:
        def __init__(self, *_):
            pass

        def news(self):
            yield Fitted(bad, "", 40)

    monkeypatch.setattr(model_in_force, "FitProcess", Done)
    in_force = ModelInForce(ta.load_arm("ur10"), good, file, None)
    in_force.refit(40)
    (event,) = in_force.news()
    assert event.text.startswith("the fit is worse, and the model in force stays: mean error ")
    assert in_force.model is good


def test_a_fit_ends_with_the_recording(tmp_path, session):
    file = tmp_path / "session.csv"
    session.save(file)
    in_force = ModelInForce(ta.load_arm("ur10"), None, file, None)
    in_force.refit(40)
    process = in_force._fit._process
    in_force.close()
    assert not process.is_alive()


def test_what_cannot_be_fitted_or_saved_is_refused(tmp_path, session):
    file = tmp_path / "there.truearm"
    file.write_text("")
    with pytest.raises(InputError, match="the file exists"):
        ModelInForce(None, None, tmp_path / "session.csv", file)
    in_force = ModelInForce(None, None, tmp_path / "session.csv", None)
    assert in_force.refit(3).text == "a fit needs the arm: start with --arm ARM"
    assert ModelInForce(ta.load_arm("ur10"), None, tmp_path / "s.csv", None).refit(0).kind == "refused"


def test_the_demonstration_is_learned_from(tmp_path):
    recording = demo_recording(tmp_path)
    samples, events = recording.source.samples(), []
    while not recording.n_readings:
        events += recording.on_sample(next(samples))
        recording.source.steer(recording.aim_rad)
    assert recording.next_pose not in (None, 1)
    assert next(event for event in reversed(events) if event.kind == "next").values["would_give_mm"] > 0
    recording.close()


def test_only_a_virtual_arm_is_steered(tmp_path):
    arm = ta.load_arm("ur10")
    recording = Recording(Source("test", lambda: iter(())), tmp_path / "a.csv", arm=arm)
    [*recording.on_sample(Sample(0.0, arm.working))]
    assert [event.text for event in recording.on_command("steer 1 2 3 4 5 6")] == [
        "test cannot be steered: only a virtual arm can"
    ]
    recording.close()
    source = ta.open_source("virtual:ur10@max")
    recording = Recording(source, tmp_path / "b.csv", arm=arm)
    samples = source.samples()
    [*recording.on_sample(next(samples))]
    for wrong in ("1 2", "a b c d e f", "nan 0 0 0 0 0"):
        assert [event.kind for event in recording.on_command(f"steer {wrong}")] == ["refused"]
    assert [*recording.on_command("steer 10 -90 90 0 90 1000")] == []
    for _ in range(300):
        last = next(samples)
    assert np.degrees(last.joint_angles_rad) == pytest.approx([10, -90, 90, 0, 90, 360], abs=0.05)
    recording.close()
