"""A network without an arm: every verb works from readings alone, or says in one sentence that it needs an arm."""

import json

import numpy as np
import pandas as pd
import pytest

import truearm as ta
from refusals import refuses
from truearm.models.arm_check import arm_of_readings

pytestmark = pytest.mark.usefixtures("undrawn")

SMALL = {"model": "network", "hidden": (8,), "epochs": 20}


@pytest.fixture(scope="module")
def readings():
    return ta.simulate("gao2017", poses=120, seed=1).session.split(by="row", hold_out=0.3, seed=1)


@pytest.fixture(scope="module")
def fitted(readings):
    return ta.fit(None, readings[0], **SMALL)


@pytest.fixture(scope="module")
def loaded(fitted, tmp_path_factory):
    path = tmp_path_factory.mktemp("network") / "net.truearm"
    fitted.save(path)
    return ta.load_model(path)


def test_it_predicts_what_the_same_network_with_an_arm_predicts(readings, loaded):
    with_arm = ta.fit("gao2017", readings[0], **SMALL).model
    np.testing.assert_array_equal(loaded.predict(readings[1].angles), with_arm.predict(readings[1].angles))


def test_fit_states_errors_and_compares_with_no_arm(readings, fitted):
    assert "nominal" not in fitted.summary()
    assert fitted.nominal is None
    assert fitted.training["mean_mm"] > 0
    assert "removed_percent" not in fitted.training
    assert any("Without an arm" in str(block) for block in fitted.blocks())
    json.dumps(fitted.to_dict())


def test_predict_and_evaluate(readings, loaded):
    test = readings[1]
    assert ta.predict(loaded, test).points.shape == (len(test), 3)
    found = ta.evaluate(loaded, test)
    off = np.linalg.norm(loaded.predict(test.angles) - test.points, axis=1).mean()
    assert found.errors["model"]["mean_mm"] == pytest.approx(off)
    assert list(found.errors) == ["model"]
    assert found.to_dict()["nominal"] is None


def test_report_has_no_nominal_column(readings, loaded, tmp_path):
    result = ta.report({"first": loaded, "second": loaded}, readings[1], tmp_path / "page.html")
    assert list(result.errors) == ["first", "second"]
    text = (tmp_path / "page.html").read_text()
    assert "Do not use" not in text
    assert "before compensation" not in text
    assert "nominal arm's" not in text


@pytest.mark.parametrize("name", ["net.json", "net.onnx"])
def test_export_that_holds_the_network(loaded, name, tmp_path):
    pytest.importorskip("onnxruntime")
    ta.export(loaded, tmp_path / name)
    assert ta.check_export(loaded, tmp_path / name).agrees


@pytest.mark.parametrize(
    "what",
    [
        lambda model, test: ta.correct(model, test.angles[:2]),
        lambda model, test: ta.export(model, "arm.urdf"),
        lambda model, test: model.predict_nominal(test.angles),
        lambda model, test: ta.KinematicModel(model.arm).fit_readings(test),
    ],
)
def test_what_needs_kinematics_is_refused_with_the_ways_to_an_arm(readings, loaded, what):
    assert "--from-circles" in str(refuses("the kinematics of an arm", what, loaded, readings[1]))


@pytest.mark.parametrize("model", ["auto", "nominal", "kinematic", "physical", "hybrid"])
def test_other_models_name_the_ways_to_an_arm(readings, model):
    caught = refuses(f"'{model}' needs the nominal arm", ta.fit, None, readings[0], model=model)
    assert "`truearm arms`" in str(caught)
    assert "URDF" in str(caught)
    assert "--from-circles" in str(caught)


def test_readings_of_several_sessions_are_refused(readings):
    frame = readings[0].to_frame()
    frame["session"] = ["a", "b"] * (len(frame) // 2)
    refuses("network learns one frame", ta.fit, None, frame, **SMALL)


def test_the_command_takes_sliding_joints_from_the_units_of_the_columns(truearm, tmp_path):
    rng = np.random.default_rng(1)
    slide, turn = rng.uniform(0, 500, 60), rng.uniform(-90, 90, 60)
    points = {"x_mm": 300 * np.cos(np.radians(turn)), "y_mm": 300 * np.sin(np.radians(turn)), "z_mm": slide}
    frame = pd.DataFrame({"q1_mm": slide, "q2_deg": turn, **points})
    frame.to_csv(tmp_path / "gantry.csv", index=False)
    truearm(
        "fit", tmp_path / "gantry.csv", "--model", "network", "--hidden", "8", "--out", tmp_path / "g.truearm"
    ).done()
    model = ta.load_model(tmp_path / "g.truearm")
    np.testing.assert_array_equal(model.arm.chain.is_prismatic, [True, False])
    assert json.loads(truearm("evaluate", tmp_path / "g.truearm", tmp_path / "gantry.csv", "--json").out)["mean_mm"] < 5
    turned = frame.rename(columns={"q1_mm": "q1_deg"})
    turned.to_csv(tmp_path / "turned.csv", index=False)
    refused = truearm("predict", tmp_path / "g.truearm", tmp_path / "turned.csv", "--out", tmp_path / "p.csv")
    assert refused.code != 0
    assert "slides" in refused.err


def test_the_command_without_an_arm_names_the_option(truearm, tmp_path):
    (tmp_path / "s.csv").write_text("q1_deg,x_mm,y_mm,z_mm\n0,1,2,3\n")
    refused = truearm("fit", tmp_path / "s.csv", "--out", tmp_path / "m.truearm")
    assert "--arm" in refused.err
    assert "--from-circles" in refused.err


def test_joints_of_arrays_turn():
    session = ta.Session(np.zeros((4, 3)), np.zeros((4, 3)))
    arm = arm_of_readings(session)
    assert not arm.has_kinematics
    assert not arm.chain.is_prismatic.any()
    assert ta.load_arm("ur10").has_kinematics
