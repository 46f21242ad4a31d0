"""The model in force: a fit in a process of its own replaces it, a failed or worse one does not; `save` writes it."""

import time

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.bench.recording import model_in_force
from truearm.wings.bench.recording.model_in_force import Fitted, ModelInForce, corrected_tip, why_worse
from truearm.wings.bench.recording.record_readings import demo_recording
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import Sample, Source


@pytest.fixture(scope="module")
def session():
    return ta.simulate("ur10", poses=40, seed=1).session


@pytest.fixture(scope="module")
def good(session):
    return ta.fit("ur10", session, model="kinematic").model


@pytest.fixture(scope="module")
def bad(session):
    noisy = session.points + np.random.default_rng(1).normal(0.0, 2.0, session.points.shape)
    return ta.fit("ur10", ta.Session(session.angles, points=noisy), model="kinematic").model


def news_until_the_end(of_fit):
    events, until_s = [], time.monotonic() + 60
    while time.monotonic() < until_s and not any(event.kind in ("model", "refused") for event in events):
        events += of_fit()
        time.sleep(0.05)
    return events


@pytest.mark.parametrize("loads", [{}, {"payload_kg": 5.0}, {"load_1_Nm": 2.0}])
def test_a_sample_is_corrected_and_flagged_as_its_reading_is_predicted(good, session, loads):
    q, directions = session.angles[:1], np.ones((1, 6))
    tip = corrected_tip(good, Sample(0.0, q[0], columns=loads), directions[0])
    readings = ta.Session(q, directions=directions, columns={name: np.array([one]) for name, one in loads.items()})
    prediction = ta.predict(good, readings)
    np.testing.assert_array_equal(tip.tip_in_reference_mm, prediction.points[0])
    np.testing.assert_array_equal(tip.U_mm, 2 * prediction.u_mm[0])
    assert tip.is_trained == (not prediction.outside_training[0])


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


def test_a_failed_fit_leaves_the_model_in_force(tmp_path, session, good):
    few = tmp_path / "few.csv"
    session.rows(np.arange(2)).save(few)
    in_force = ModelInForce(ta.load_arm("ur10"), good, few, None)
    assert in_force.save().kind == "refused"
    in_force.refit(2)
    (refused,) = (event for event in news_until_the_end(in_force.news) if event.kind == "refused")
    assert refused.text.startswith("the fit has failed, and the model in force stays: ")
    assert in_force.model is good


def test_a_worse_fit_leaves_the_model_in_force(tmp_path, session, good, bad, monkeypatch):
    file = tmp_path / "session.csv"
    ta.simulate("ur10", poses=40, seed=2).session.save(file)
    assert "of the model in force" in why_worse(bad, good, session)
    assert why_worse(good, bad, session) == ""
    assert why_worse(bad, good, session.rows(np.arange(5))) == ""  # of five readings, nothing follows
    fits(monkeypatch, bad)
    in_force = ModelInForce(ta.load_arm("ur10"), good, file, None)
    in_force.refit(40)
    (event,) = in_force.news()
    assert event.text.startswith("the fit is worse, and the model in force stays: mean error ")
    assert in_force.model is good


def fits(monkeypatch, model):
    """Let a fit end at once, with a model."""

    class Done:
        def __init__(self, *_):
            pass

        def news(self):
            yield Fitted(model, "")

        def stop(self):
            pass

    monkeypatch.setattr(model_in_force, "FitProcess", Done)


def test_a_fit_to_a_few_readings_replaces_no_model_of_other_ones(tmp_path, session, good, monkeypatch):
    file = tmp_path / "session.csv"
    fits(monkeypatch, good)
    session.rows(np.arange(7)).save(file)
    in_force = ModelInForce(ta.load_arm("ur10"), good, file, None)
    in_force.refit(7)
    assert [event.text for event in in_force.news()] == [
        "the fit cannot be compared, and the model in force stays: a comparison needs 8 readings, there are 7"
    ]
    session.save(file)
    known = ta.fit("ur10", ta.read_session(file).rows(np.arange(30)), model="kinematic").model
    in_force = ModelInForce(ta.load_arm("ur10"), known, file, None)
    assert in_force.trained_on == 30  # those of the file
    in_force.refit(35)  # five further ones
    assert [event.kind for event in in_force.news()] == ["model"]
    assert in_force.trained_on == 35


def test_a_fit_of_readings_that_were_undone_knows_those_that_are_left(tmp_path, session, good, bad, monkeypatch):
    fits(monkeypatch, good)
    session.rows(np.arange(15)).save(tmp_path / "simulated.csv")
    source = ta.open_source(f"replay:{tmp_path / 'simulated.csv'}@max")
    recording = Recording(source, tmp_path / "out.csv", arm=ta.load_arm("ur10"), model=bad)
    for sample in source.samples():
        if isinstance(sample, Sample):
            [*recording.on_sample(sample)]
    [*recording.on_command("refit")]
    for _ in range(4):
        [*recording.on_command("undo")]
    (new,) = (event for event in recording.news_of_fit() if event.kind == "model")
    assert new.values["n"] == 11
    recording.close()


def test_a_file_that_a_person_breaks_ends_no_recording(tmp_path, session, good, monkeypatch):
    session.rows(np.arange(10)).save(tmp_path / "simulated.csv")
    source = ta.open_source(f"replay:{tmp_path / 'simulated.csv'}@max")
    recording = Recording(source, out := tmp_path / "out.csv", arm=ta.load_arm("ur10"))
    for sample in source.samples():
        if isinstance(sample, Sample):
            [*recording.on_sample(sample)]
    with out.open("a") as file:
        file.write("what is this,\n")
    (refused,) = recording.on_command("refit")
    assert refused.text.startswith(f"no fit begins: {out}, line 12: ")
    whole = out.read_text()
    out.write_text("".join(whole.splitlines(keepends=True)[:-1]))
    fits(monkeypatch, good)
    [*recording.on_command("refit")]
    out.write_text(whole)
    events = [*recording.news_of_fit()]
    assert [event.kind for event in events] == ["model", "notice", "learned"]
    assert events[1].text.startswith("what the readings say of the arm is not known: ")
    out.write_text("".join(whole.splitlines(keepends=True)[:-1]))
    [*recording.on_command("refit")]
    out.write_text(whole)
    (refused,) = recording.news_of_fit()
    assert refused.text.startswith("the fit cannot be compared, and the model in force stays: ")
    recording.close()


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
    refuses("the file exists already, and is not one", ModelInForce, None, None, tmp_path / "session.csv", file)
    ta.fit("ur5", ta.simulate("ur5", poses=20, seed=1).session, model="nominal").model.save(
        file := tmp_path / "ur5.truearm"
    )
    ModelInForce(ta.load_arm("ur5"), None, tmp_path / "session.csv", file)  # the next day
    with pytest.raises(InputError, match=r"another arm.*Try: another name for the model$"):
        ModelInForce(ta.load_arm("ur10"), None, tmp_path / "session.csv", file)
    in_force = ModelInForce(None, None, tmp_path / "session.csv", None)
    assert in_force.refit(3).text == "a fit needs the arm: start with --arm ARM"
    assert ModelInForce(ta.load_arm("ur10"), None, tmp_path / "s.csv", None).refit(0).kind == "refused"


def test_the_demonstration_is_learned_from(tmp_path, quick_plans):
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
