"""Errors of a rail before an arm: their functions, what is offered, and planted truth."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from page_transcripts import blocks
from refusals import refuses
from truearm.arm.arm_files import read_arm
from truearm.arm.chain import Chain
from truearm.identification.terms import ArmState, basis_from_data
from truearm.identification.terms.catalogue import candidate_terms
from truearm.identification.terms.linear_axis import Travel, TravelHarmonics, linear_axis
from truearm.models import KinematicModel, PhysicalModel, load_model
from truearm.readings import Session, read_session, write_session
from truearm.verbs.evaluate import evaluate
from truearm.verbs.fit import fit
from truearm.wings.exports.correct import correct
from truearm.wings.exports.export import check_export, export
from truearm.wings.planning.plan import plan
from truearm.wings.planning.simulate import simulate

NOISE_MM = 0.01
ON_THE_RAIL = """
[[joints]]
name = "turn"
type = "revolute"
a_mm = 100.0
d_mm = 400.0
alpha_deg = 90.0
theta_deg = 0.0
min_deg = -150.0
max_deg = 150.0
working_deg = 0.0

[[joints]]
name = "lift"
type = "revolute"
a_mm = 600.0
d_mm = 0.0
alpha_deg = 0.0
theta_deg = 0.0
min_deg = -140.0
max_deg = 140.0
working_deg = 0.0
"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The rail of the documentation, with an arm that turns and lifts."""
    (text,) = (text for text in blocks("arm-file.md", "toml") if text.startswith('name = "rail-arm"'))
    file = tmp_path_factory.mktemp("rail") / "rail.toml"
    file.write_text(text + ON_THE_RAIL)
    return read_arm(file)


def measured(arm, n: int, *, seed: int, positions=None, largest=4000.0) -> Session:
    """Readings with planted errors of the rail and of the arm's constants."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform([0, -2.0, -2.0], [largest, 2.0, 2.0], (n, 3))
    if positions is not None:
        angles[:, 0] = np.resize(positions, n)
    u, motions = angles[:, 0] / 4000, np.zeros((n, arm.chain.n_places, 6))
    motions[:, 1, 0], motions[:, 1, 1], motions[:, 1, 2] = 2e-4 * np.sin(4 * u), 5e-4 * (u - 0.5) ** 2, 1e-4 * u**2
    motions[:, 1, 3], motions[:, 1, 4] = 0.3 * np.sin(4 * u), 0.2 * u**3
    motions[:, 1, 5] = 5e-5 * (angles[:, 0] - 2000)  # scale
    motions[:, 2, :3], motions[:, 3, 3:] = [1e-3, -5e-4, 0.0], [0.3, 0.2, 0.0]
    return Session(angles, arm.chain.tip_in_base(angles, motions) + rng.normal(0, NOISE_MM, (n, 3)))


@pytest.fixture(scope="module")
def trained(arm):
    return measured(arm, 150, seed=1)


@pytest.fixture(scope="module")
def test_session(arm):
    return measured(arm, 100, seed=2)


@pytest.fixture(scope="module")
def physical(arm, trained):
    return PhysicalModel(arm, highest=1).fit_readings(trained)


def rms(model, session) -> float:
    return float(np.sqrt(((model.predict_readings(session) - session.points) ** 2).mean()))


def test_the_documented_arm_rides_along_y(arm):
    tips = arm.chain.tip_in_base([[0.0, 0.3, 0.2], [1500.0, 0.3, 0.2]])
    np.testing.assert_allclose(tips[1] - tips[0], [0, 1500, 0], atol=1e-9)  # mm
    assert arm.joint_names == ("rail", "turn", "lift")
    assert arm.chain.is_prismatic.tolist() == [True, False, False]


def test_planted_errors_of_a_rail_are_recovered(arm, trained, test_session, physical):
    kinematic = KinematicModel(arm).fit_readings(trained)
    assert rms(kinematic, test_session) > 5 * NOISE_MM
    assert rms(physical, test_session) < 1.5 * NOISE_MM
    points, covariance = physical.predict_readings(test_session, return_cov=True)
    off = points - test_session.points
    spread = covariance + NOISE_MM**2 * np.eye(3)
    inside = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off) < 7.815  # 95 % of chi2(3)
    assert inside.mean() > 0.9


def test_five_positions_are_enough_for_slow_errors(arm, test_session):
    session = measured(arm, 150, seed=3, positions=np.linspace(0, 4000, 5))
    assert rms(PhysicalModel(arm, highest=1).fit_readings(session), test_session) < 3 * NOISE_MM


def test_travel_beyond_the_training_is_flagged(arm, physical):
    outside = physical.training_.outside(Session([[3000.0, 0.1, 0.2], [5000.0, 0.1, 0.2]]), arm.chain.is_prismatic)
    assert outside["J1"].tolist() == [False, True]


def test_files_keep_model_and_session(physical, trained, test_session, tmp_path):
    physical.save(tmp_path / "m.truearm")
    loaded = load_model(tmp_path / "m.truearm")
    np.testing.assert_array_equal(loaded.predict_readings(test_session), physical.predict_readings(test_session))
    write_session(trained, tmp_path / "s.csv", prismatic=[True, False, False])
    assert (tmp_path / "s.csv").read_text().startswith("q1_mm,q2_deg,q3_deg,")
    np.testing.assert_array_equal(read_session(tmp_path / "s.csv").angles[:, 0], trained.angles[:, 0])


def test_the_verbs_take_an_arm_on_a_rail_or_say_why_not(arm, trained, test_session, physical, quick_plans, tmp_path):
    assert fit(arm, trained, model="kinematic").model.n_train_ == 150
    assert evaluate(physical, test_session).errors["model"]["mean_mm"] < 3 * NOISE_MM
    assert "tracker" in str(plan(arm, "tracker", poses=6))
    assert len(simulate(arm, poses=4).session) == 4
    export(physical, tmp_path / "m.c")
    assert check_export(physical, tmp_path / "m.c").agrees


def test_a_target_is_corrected_for_the_rail(arm, physical):
    planned = np.array([[1000.0, 0.4, 0.8], [3000.0, -0.3, 1.0]])
    corrected = correct(physical, pd.DataFrame(planned, columns=["q1_mm", "q2_rad", "q3_rad"]))
    assert not corrected.refused.any()
    assert np.abs(corrected.joints[:, 0] - planned[:, 0]).min() > NOISE_MM
    again = correct(physical, corrected.joints, direction="feedback").joints
    np.testing.assert_allclose(again, planned, atol=1e-5)  # mm and rad: the inverse stops at a nanometre


def test_functions_and_their_slopes(make_chain):
    chain = Chain(make_chain().fixed, [0, 0, 0], np.arange(5) == 0)
    angles = np.random.default_rng(1).uniform(-1, 1, (30, 5)) * [1500, 1, 1, 1, 1]
    basis, step = TravelHarmonics(1, 4000.0, (1, 3)), 1e-3  # mm
    values = basis.values(ArmState(chain, angles))
    np.testing.assert_allclose(values[2], np.cos(3 * 2 * np.pi * angles[:, 0] / 4000), atol=1e-14)
    shifted = [basis.values(ArmState(chain, angles + sign * step * np.eye(5)[0])) for sign in (-1, 1)]
    weights = np.random.default_rng(2).normal(size=(4, 2))
    joint, slope = basis.joint_slope(weights)
    assert joint == 1
    # The quotient's error is (step * 2 pi 3 / 4000)^2 / 6, some 1e-12 of a slope; rounding 1e-13 per step.
    np.testing.assert_allclose(
        slope.T @ values, weights.T @ (shifted[1] - shifted[0]) / (2 * step), atol=1e-12 + 1e-12 / step
    )
    np.testing.assert_allclose(Travel(1, 500.0).values(ArmState(chain, angles))[0], angles[:, 0] - 500.0, atol=0)


@pytest.mark.parametrize(
    ("positions", "orders"), [((0, 1000), None), ((0, 500, 1000), (1, 2)), (range(0, 2000, 100), tuple(range(1, 13)))]
)
def test_orders_go_as_far_as_positions_tell_them_apart(positions, orders):
    terms = linear_axis(1, np.repeat(np.array(positions, dtype=float), 3))
    assert terms[0].group == "linear axis, scale"
    assert {term.basis.orders for term in terms[1:]} == (set() if orders is None else {orders})


@pytest.mark.parametrize("n", [100, 12_000])
def test_dense_readings_offer_all_orders(n):
    offered = linear_axis(1, np.random.default_rng(0).uniform(0, 4000, n))
    assert {term.basis.orders for term in offered[1:]} == {tuple(range(1, 13))}


@pytest.mark.parametrize("noise_mm", [0.0, 1e-4, 0.1])
def test_a_parked_rail_has_no_terms(make_chain, noise_mm):
    chain, rng = Chain(make_chain().fixed, [0, 0, 0], np.arange(5) == 0), np.random.default_rng(0)
    angles = rng.uniform(-3, 3, (40, 5))
    angles[:, 0] = 1500 + rng.uniform(-noise_mm, noise_mm, 40)
    offered, skipped = candidate_terms(ArmState(chain, angles))
    assert not any(term.group.startswith("linear axis") for term in offered)
    (reason,) = [left.reason for left in skipped if left.name == "J1 linear axis"]
    assert re.fullmatch(r"J1 moved by only \S+ mm", reason)


def test_only_a_first_joint_is_a_rail(make_chain):
    for first in (True, False):
        slides = np.arange(5) == (0 if first else 2)
        angles = np.random.default_rng(0).uniform(-3, 3, (40, 5)) * np.where(slides, 100, 1)
        state = ArmState(Chain(make_chain().fixed, [0, 0, 0], slides), angles)
        offered, _ = candidate_terms(state)
        assert any(term.group.startswith("linear axis") for term in offered) == first


def test_plain_data_and_wrong_fields(make_state):
    for basis in (Travel(1, 2.5), TravelHarmonics(1, 4000, (1, 2))):
        assert basis_from_data(json.loads(json.dumps(basis.as_data()))) == basis
        refuses("expected a sliding joint, got J1", basis.values, make_state())
    for wrong in (
        {"kind": "Travel", "joint": 1, "from_mm": "a"},
        {"kind": "TravelHarmonics", "joint": 1, "period_mm": 0.0, "orders": [1]},
        {"kind": "TravelHarmonics", "joint": 1, "period_mm": 10.0, "orders": [2, 1]},
    ):
        refuses("expected", basis_from_data, wrong)
