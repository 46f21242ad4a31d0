"""Laws of what verbs say of an input: the unit of a joint, a base that is nominal, a payload that is not stated."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm.chain import Chain
from truearm.models.selection import CANDIDATES
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
    refuses(says, getattr(ta, verb), subject, wrong)


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


def test_auto_names_the_one_reason_for_which_it_did_not_compare_a_hybrid_model(ur10_session, monkeypatch):
    monkeypatch.delitem(CANDIDATES, "physical")  # quicker
    for readings, reason in (
        (ur10_session, "60 readings are too few for its 243 weights"),
        (replace(ur10_session, tip=np.repeat(["A", "B"], 30)), "its networks learn one tip"),
    ):
        said = [remark for remark in ta.fit("ur10", readings).remarks if "hybrid" in remark]
        assert said == [f"The hybrid model was not compared: {reason}."]
    assert not [remark for remark in ta.fit("ur10", ur10_session, model="kinematic").remarks if "hybrid" in remark]


def test_a_plan_that_is_half_filled_in_is_fitted_without_its_empty_rows(tmp_path):
    """Two bars, the second not measured yet: its rows and its length are ignored, and it is said."""
    taken = ta.simulate("gao2017", poses=40, strategy="seat", seats=4, seed=1).session
    frame = taken.to_frame()[[*(f"q{i}_deg" for i in range(1, 7)), "seat"]]
    late = frame["seat"] == frame["seat"].iloc[-1]
    frame.loc[late, [f"q{i}_deg" for i in range(1, 7)]] = np.nan
    frame.to_csv(tmp_path / "plan.csv", index=False)
    read = ta.read_session(tmp_path / "plan.csv")
    assert read.unfilled == tuple(frame["seat"][late])
    assert read.numbers.tolist() == (np.flatnonzero(~late) + 2).tolist()
    first, second, last = frame["seat"].iloc[0], frame["seat"][~late].iloc[-1], frame["seat"].iloc[-1]
    apart = {name: taken.seat == name for name in (first, second, last)}
    means = {name: taken.points[rows].mean(axis=0) for name, rows in apart.items()}
    stated = [float(np.linalg.norm(means[first] - means[other])) for other in (second, last)]
    lengths = ta.Lengths([first, first], [second, last], stated, [0.01, 0.01])
    found = ta.fit("gao2017", tmp_path / "plan.csv", model="nominal", lengths=lengths)
    assert f"{late.sum()} of 40 rows are not filled in yet (no number); ignored." in found.remarks
    assert any(remark.startswith("1 of 2 lengths refer to a seat without a reading") for remark in found.remarks)
    frame.iloc[0, 2] = np.nan  # in part: contradicted
    frame.to_csv(tmp_path / "hole.csv", index=False)
    refuses("column 'q3_deg': expected a number, got an empty cell", ta.read_session, tmp_path / "hole.csv")
    frame.iloc[:, :6] = np.nan
    frame.to_csv(tmp_path / "none.csv", index=False)
    refuses("none of 40 rows has a number.*fill in what was measured", ta.read_session, tmp_path / "none.csv")


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


def test_a_joint_that_never_moves_is_said_and_its_points_are_uncertain():
    """Read with J4 locked: with J4 elsewhere the uncertainty is far larger and contains the errors."""
    virtual = ta.simulate("ur10", poses=2, preset="shop", seed=1).virtual
    free = ta.simulate("ur10", poses=60, seed=2).session.angles
    locked = np.where(np.arange(6) == 3, 0.3, free)
    fit = ta.fit("ur10", virtual.measure(locked, seed=3).readings, model="kinematic")
    assert any(
        remark.startswith("J4 moves by less than 1 degree (if it did move, its column is wrong): its own errors")
        for remark in fit.remarks
    )
    stated = []
    for angles in (locked, free):
        truth = virtual.measure(angles, seed=4, reference=False)
        points, covariance = fit.model.predict_readings(truth.readings, return_cov=True)
        off = points - truth.true_tips
        inside = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off) < 7.81
        assert inside.mean() > 0.9
        stated.append(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean()))
    assert stated[1] > 2 * stated[0]


def test_angles_that_are_in_the_trained_range_as_radians_are_said(sliding):
    angles = np.random.default_rng(2).uniform([0, 0.5, 0.5], [900, 1.5, 1.5], (40, 3))
    session = Session(angles, sliding.chain.tip_in_base(angles) + [100.0, 20.0, 30.0])
    fitted = ta.fit(sliding, session, model="nominal").model
    in_rad = Session(np.column_stack([angles[:, 0], np.radians(angles[:, 1:])]))
    assert "if the angles were in rad: check the unit" in str(ta.predict(fitted, in_rad))
    assert "would be inside" not in str(ta.predict(fitted, session))
    elsewhere = Session(np.column_stack([angles[:, 0], -angles[:, 1:]]))
    assert "if J2 and J3 turned the other way" in str(ta.predict(fitted, elsewhere))
