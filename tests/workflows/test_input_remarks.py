"""Laws of what verbs say of an input: the unit of a joint, a base that is nominal, a payload that is not stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.arm.chain import Chain
from truearm.compensation.models.selection import ModelScore, hybrid_remarks
from truearm.errors import InputError
from truearm.readings import Session

OWN_FRAME = "Coordinates are in the arm's own frame"
REACH_MM = 400.0


@pytest.fixture(scope="module")
def sliding():
    """An arm that slides and then turns twice."""
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[2, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[2:, 0, 3] = REACH_MM
    chain = Chain(fixed, np.array([0.0, 0.0, 50.0]), np.array([True, False, False]))
    return ta.Arm("rail", chain)


@pytest.fixture(scope="module")
def readings(sliding):
    """Readings of it from a file, with a payload of 2 kg everywhere."""
    angles = np.random.default_rng(1).uniform([0, -2, -2], [900, 2, 2], (12, 3))
    points = sliding.chain.tip_in_base(angles) + [100.0, 20.0, 30.0]
    columns, payload = ("q1_mm", "q2_deg", "q3_rad"), {"payload_kg": np.full(12, 2.0)}
    return Session(angles, points, angle_columns=columns, columns=payload)


@pytest.fixture(scope="module")
def model(sliding, readings):
    return ta.fit(sliding, readings, model="nominal").model


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (("q1_deg", "q2_deg", "q3_rad"), "this joint slides: expected mm, got deg"),
        (("q1_mm", "q2_mm", "q3_rad"), "this joint turns: expected deg or rad, got mm"),
    ],
)
@pytest.mark.parametrize("verb", ["fit", "predict", "evaluate", "refit"])
def test_a_joint_s_unit_must_fit_its_kind(sliding, readings, model, verb, columns, says):
    wrong = replace(readings, angle_columns=columns)
    subject = sliding if verb == "fit" else model
    with pytest.raises(InputError, match=says):
        getattr(ta, verb)(subject, wrong)


def test_a_payload_that_is_not_stated_is_assumed_and_named(readings, model):
    bare = replace(readings, columns={})
    for verb in (ta.predict, ta.evaluate):
        assert not any("payload_kg" in remark for remark in verb(model, readings).remarks)
        assert any("payload_kg is not stated: 2 kg assumed" in remark for remark in verb(model, bare).remarks)


def test_a_model_learned_without_points_names_its_frame_until_refit_places_it():
    arm = ta.load_arm("ur10")
    with_wires = ta.simulate(arm, poses=10, anchors=3, reference=False, seed=1).session
    with_points = ta.simulate(arm, poses=10, seed=2).session
    learned = ta.fit(arm, with_wires, model="nominal").model
    placed = ta.refit(learned, with_points, free=("base",)).model
    again = ta.refit(placed, with_points.rows(slice(6)), free=("tip",)).model
    for fitted, is_said in ((learned, True), (placed, False), (again, False)):
        for verb in (ta.predict, ta.evaluate):
            said = any(remark.startswith(OWN_FRAME) for remark in verb(fitted, with_points).remarks)
            assert said is is_said


def test_auto_names_a_hybrid_model_that_it_did_not_compare():
    score = ModelScore("kinematic", 0.1, 0.01, 0.2, 0.3, 0.0, 0.0, 0, 20.0, True)
    assert hybrid_remarks((score,))[0].startswith("The hybrid model was not compared")
    assert hybrid_remarks((score, replace(score, name="hybrid"))) == hybrid_remarks(()) == ()


def test_an_export_of_constants_names_the_payload_and_the_travel_that_it_lacks(sliding, readings, tmp_path):
    rng = np.random.default_rng(4)
    angles = np.column_stack([rng.uniform(0, 900, 80), rng.uniform(-2, 2, (80, 2))])
    points = sliding.chain.tip_in_base(angles) + rng.normal(0, 0.05, (80, 3))
    points[:, 1] += 0.4 * np.sin(angles[:, 0] / 150)
    payload = {"payload_kg": np.tile([0.0, 2.0], 40)}
    model = ta.PhysicalModel(sliding, highest=1).fit_readings(Session(angles, points, columns=payload))
    said = str(ta.export(model, tmp_path / "arm.urdf"))
    assert "without the effect of the payload, without the errors along the travel" in said
    assert "the formats c, js, onnx and json" not in said
