"""What a fit says of its readings and of a model that identifies nothing."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.identification.estimation.residual_variance import NONE_HELD_OUT
from truearm.models.selection import CANDIDATES, held_out_findings, select_model
from truearm.models.training_conditions import TrainingConditions
from truearm.readings import Session


def with_noise(arm: str, noise_mm: float, n: int, *, seed: int) -> Session:
    readings = ta.simulate(arm, poses=n, seed=seed).session
    return Session(readings.angles, readings.points + noise_mm * np.random.default_rng(seed).standard_normal((n, 3)))


@pytest.mark.parametrize(
    "options",
    [pytest.param({"model": "hybrid", "hidden": (2,), "epochs": 2, "n_members": 2}, marks=pytest.mark.weekly), {}],
)
def test_scatter_is_the_first_remark_of_every_model(options, monkeypatch):
    """Also where the nominal arm is kept, as noise hides all errors of its constants; without the physical, quicker."""
    monkeypatch.delitem(CANDIDATES, "physical")
    result = ta.fit("ur10", with_noise("ur10", 10.0, 50, seed=2), **options)
    assert result.model_name == options.get("model", "nominal")
    scatter, unit = result.remarks[0].split("These readings scatter by ")[1].split()[:2]
    assert float(scatter) == pytest.approx(10 * np.sqrt(3), rel=0.2)
    assert unit == "mm"


@pytest.mark.parametrize("options", [{"model": "nominal"}, {"model": "hybrid", "arm_model": "nominal"}])
def test_a_nominal_arm_has_no_zeros_to_write(options):
    if options["model"] == "hybrid":
        options |= {"hidden": (2,), "epochs": 2, "n_members": 2}
    result = ta.fit("ur10", ta.simulate("ur10", poses=40, seed=1).session, **options)
    refuses("identifies no joint zeros", result.arm_with_zeros)


@pytest.mark.parametrize(
    ("arm", "said"),
    [
        ("ur5e", "By the training readings the arm is ur5, not ur5e: fit again with its name (--arm)."),
        ("ur5", "times as much as nominal arms usually do; fit says why."),
    ],
    ids=["another drawing", "a zero that is off"],
)
def test_a_doubtful_arm_is_said_wherever_its_model_is_used(arm, said, tmp_path):
    train, test = ta.simulate("ur5", poses=80, seed=1).session.split(by="row", hold_out=0.3, seed=1)
    if arm == "ur5":
        train, test = (replace(one, angles=one.angles + np.radians([0, 0, 5, 0, 0, 0])) for one in (train, test))
    ta.fit(arm, train, model="kinematic").save(tmp_path / "m.truearm")
    model = ta.load_model(tmp_path / "m.truearm")
    for used in (ta.evaluate(model, test), ta.predict(model, test), ta.report(model, test)):
        assert [one for one in used.remarks if said in one], used.remarks
    changed = ta.compare(model, model)
    for used in (ta.export(model, tmp_path / "m.json"), ta.correct(model, test.angles[:2]), changed):
        assert said in str(used)
    assert f"Of the old model: {model.arm_doubt_}" in changed.remarks
    model.arm_doubt_ = ""
    assert not [one for one in ta.predict(model, test).remarks if "nominal arm" in one or "is ur5" in one]


def test_zeros_of_an_accepted_fit_say_so():
    session = ta.simulate("ur10", poses=40, seed=1).session
    result = ta.fit("ur10", replace(session, points=25.4 * session.points), model="kinematic", accept="a try")
    assert "identified from 40 readings; Accepted (a try): " in result.arm_with_zeros().source


def test_joints_that_hardly_move_are_said_as_such():
    session = ta.simulate("ur10", poses=2, seed=1).session
    travel = np.radians([30.0, 0.9, 0.0, 1.1, 90, 40])
    still = Session(np.array([session.angles[0], session.angles[0] + travel]), session.points)
    chain = ta.load_arm("ur10").chain
    found = list(TrainingConditions.of(still, chain.is_prismatic).still_joints(chain))
    said = [str(one).split(":")[0] for one in found]
    assert said == [f"J{n} moves by less than 1 degree (if it did move, its column is wrong)" for n in (2, 3)]
    assert [one.numbers["joint"] for one in found] == [2, 3]


def test_without_readings_held_out_the_nominal_arm_is_kept_and_changes_are_looked_for():
    """The base steps in the middle of the session."""
    readings = ta.simulate("ur10", poses=40, seed=1).session
    moved = readings.points + np.where(np.arange(40) < 20, 0.0, 20.0)[:, None] * [1.0, 0, 0]
    nominal = ta.NominalModel(ta.load_arm("ur10"))
    prepared = nominal.prepare(Session(readings.angles, moved))
    nominal.learn(prepared)
    nominal.held_out_ = NONE_HELD_OUT
    kept = select_model(nominal, prepared)
    assert kept.model is kept.arm_model is nominal
    assert len(kept.changes) == 1
    (said,) = held_out_findings(nominal, nominal)
    assert "the nominal arm is kept, --model kinematic fits the others: measure more poses" in str(said)
    assert said in kept.findings


@pytest.mark.parametrize("decimals", [2, pytest.param(12, marks=pytest.mark.weekly)])
@pytest.mark.parametrize("model", ["nominal", "kinematic"])
def test_points_that_a_controller_calculated_are_said_not_to_be_measured(model, decimals):
    """To 0.01 mm, as a pendant shows them, and with all digits; measured ones are not, rounded alike."""
    arm, measured = ta.load_arm("ur10"), ta.simulate("ur10", poses=20, seed=1, preset="shop").session
    for points, is_said in ((arm.chain.tip_in_base(measured.angles), True), (measured.points, False)):
        result = ta.fit(arm, Session(measured.angles, np.round(points, decimals)), model=model)
        assert any("they are calculated from the angles" in one for one in result.remarks) == is_said


def test_points_calculated_with_the_constants_of_the_controllers_own_arm_are_said_too():
    """Links off by a millimetre: the nominal arm is not that near, the identified one is."""
    arm, angles = ta.load_arm("ur10"), ta.simulate("ur10", poses=40, seed=1).session.angles
    motions = np.zeros((arm.chain.n_places, 6))
    motions[1:4, 3:] = np.random.default_rng(1).normal(0, 1.0, (3, 3))
    points = np.round(arm.chain.with_motions(motions).tip_in_base(angles), 3)
    said = [one for one in ta.fit(arm, Session(angles, points), model="kinematic").remarks if "calculated" in one]
    assert [one.split(" arm to ")[0] for one in said] == ["The points agree with the identified"]
