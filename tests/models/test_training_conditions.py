"""Training conditions: ranges and gaps of joint angles, temperatures and loads, and what lies outside them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.models import MODELS, KinematicModel, NetworkModel, NominalModel, PhysicalModel, load_model
from truearm.models.refit import refit
from truearm.models.training_conditions import TOGETHER, InputRange, TrainingConditions, find_angle_gaps
from truearm.readings import Session

TURNS = np.zeros(1, bool)


def outside(asked, angles, prismatic=TURNS):
    rows = TrainingConditions.of(Session(angles), prismatic).outside(Session(asked), prismatic).values()
    return np.logical_or.reduce([np.zeros(len(asked), bool), *rows])


def test_two_clusters_leave_a_gap_between_them():
    angles = np.radians(np.concatenate([np.linspace(-90, -30, 500), np.linspace(40, 80, 500)]))[:, None]
    gaps = find_angle_gaps(angles, TURNS)
    # 170 degrees over 1000 angles: near is 1.5 * 170 * ln(1000) / 1000 = 1.76 degrees.
    np.testing.assert_allclose(np.degrees(gaps), [[0, -30 + 1.7616, 40 - 1.7616]], atol=1e-3)
    asked = np.radians([[-91.0], [-90], [-31], [-29], [-28], [0], [38], [39], [81]])
    assert outside(asked, angles).tolist() == [True, False, False, False, True, True, True, False, True]


@settings(max_examples=40)
@given(st.integers(2, 400), st.integers(0, 10**6))
def test_training_angles_are_never_outside(n, seed):
    rng = np.random.default_rng(seed)
    angles = rng.choice([0.01, 1.0], size=3) * rng.normal(size=(n, 3)) ** 3
    gaps = find_angle_gaps(angles, np.array([False, True, False]))
    assert not outside(angles, angles, np.array([False, True, False])).any()
    assert (gaps[:, 1] < gaps[:, 2]).all()


@settings(max_examples=20)
@given(st.integers(-3, 3), st.integers(0, 10**6))
def test_a_joint_counted_on_by_full_turns_is_where_it_was(turns, seed):
    rng = np.random.default_rng(seed)
    angles, asked = rng.normal(size=(50, 2)), 1.5 * rng.normal(size=(30, 2))
    turned = asked + [2 * np.pi * turns, 0.0]
    slides = np.zeros(2, bool)
    np.testing.assert_array_equal(outside(turned, angles, slides), outside(asked, angles, slides))
    if turns:  # a sliding joint does not come round
        assert outside(turned + [100.0 * turns, 0.0], angles, np.array([True, False])).all()


@settings(max_examples=20)
@given(st.integers(-2, 2), st.integers(0, 10**6))
def test_a_training_angle_with_its_rounding_is_inside(turns, seed):
    """A pose at an end of the range, corrected there and back, comes back to a rounding of 1e-15 beyond it."""
    rng = np.random.default_rng(seed)
    angles = rng.normal(size=(50, 2))
    rounding = rng.choice([-1e-12, 1e-12], size=angles.shape)
    assert not outside(angles + 2 * np.pi * turns + rounding, angles, np.zeros(2, bool)).any()


def test_joints_that_are_inside_one_by_one_may_be_outside_together():
    """Training along a diagonal: its other corners are in both ranges, and far from every reading."""
    along = np.linspace(-1, 1, 100)
    angles = np.column_stack([along, along + 0.02 * np.sin(40 * along)])
    conditions = TrainingConditions.of(Session(angles), np.zeros(2, bool))
    found = conditions.outside(Session(np.array([[-0.9, 0.9], [0.9, 0.9], [0.5, 0.51]])), np.zeros(2, bool))
    assert {name: rows.tolist() for name, rows in found.items()} == {TOGETHER: [True, False, False]}


@pytest.mark.parametrize("step", [0.003, 0.03, 1.0])
def test_readings_along_a_path_are_as_far_as_each_of_them_alone(step, rng):
    trained, slides = rng.uniform(-1, 1, (300, 3)), np.zeros(3, bool)
    conditions = TrainingConditions.of(Session(trained[(trained[:, :2] < 0.2).any(axis=1)]), slides)
    path = np.clip(np.cumsum(rng.normal(0, step, (400, 3)), axis=0) % 2 - 1, *conditions.angle_ranges.T)
    found = conditions.outside(Session(path), slides)[TOGETHER]
    alone = [TOGETHER in conditions.outside(Session(one[None]), slides) for one in path]
    assert found.tolist() == alone
    assert found.any()
    assert not found.all()


@pytest.mark.parametrize("n", [15, 60])
def test_poses_that_are_read_several_times_count_once(n, rng):
    """The nearest other pose is no repeat: a pose a hundredth of a degree from its training pose is inside."""
    poses, slides = rng.uniform(-1, 1, (n, 3)), np.zeros(3, bool)
    repeated = np.repeat(poses, 5, axis=0) + rng.normal(0, 1e-6, (5 * n, 3))
    asked = Session(np.vstack([0.99 * poses, poses + np.radians([0.01, 0, 0]), rng.uniform(-1, 1, (200, 3))]))
    ours, other = (
        TrainingConditions.of(Session(angles), slides).outside(asked, slides) for angles in (repeated, poses)
    )
    never = np.zeros(len(asked), bool)
    np.testing.assert_array_equal(ours.get(TOGETHER, never), other.get(TOGETHER, never))
    assert not ours.get(TOGETHER, never)[: 2 * n].any()


def test_a_degree_from_a_training_pose_is_inside_however_near_these_are():
    along = np.linspace(0, 0.01, 100)
    conditions = TrainingConditions.of(Session(np.column_stack([along, along])), np.zeros(2, bool))
    assert not conditions.outside(Session(np.array([[0.0, 0.01]])), np.zeros(2, bool))


@pytest.mark.parametrize("n", [10, 100, 2000])
def test_angles_spread_at_random_have_no_gaps(n):
    """The law's chance of a gap is 1/n^2 a joint: among 30 joints one in a thousand or less, but for n = 10."""
    angles = np.random.default_rng(n).uniform(-2, 2, (n, 30))
    assert len(find_angle_gaps(angles, np.zeros(30, bool))) <= (3 if n == 10 else 0)


def test_sliding_joints_go_by_their_range():
    angles = np.r_[np.linspace(0, 100, 800), np.linspace(400, 500, 800)][:, None]  # mm
    np.testing.assert_allclose(find_angle_gaps(angles, ~TURNS), [[0, 106.9, 393.1]], atol=2)


def test_a_joint_that_stood_still_or_one_reading():
    assert len(find_angle_gaps(np.full((5, 2), 0.3), np.zeros(2, bool))) == 0
    assert len(find_angle_gaps(np.zeros((1, 2)), np.array([True, False]))) == 0


# Temperature and loads -----------------------------------------------------------------------------------------------


def warm(real, rng, n=60, mean=20.0, **more):
    return real.points(n, rng, temperature_degC=rng.uniform(mean - 2, mean + 2, n), **more)


def at(session, degC):
    return Session(session.angles, temperature_degC=np.full(len(session), float(degC)))


def test_inputs_outside_the_trained_range_are_named(real, rng):
    train = warm(real, rng, columns={"load_1_Nm": rng.uniform(0, 5, 60)})
    model = KinematicModel(real.arm).fit_readings(train)
    angles = np.tile(train.angles[:1], (4, 1))
    angles[1, 2] = train.angles[:, 2].max() + 0.1
    asked = Session(
        angles, temperature_degC=np.array([20, 20, 30, 22.5]), columns={"load_1_Nm": np.array([1.0, 1, 9, 1])}
    )
    named = {name: rows.tolist() for name, rows in model.inputs_outside_training(asked).items()}
    assert named == {
        "J3": [False, True, False, False],
        "temperature": [False, False, True, False],  # thermometers agree to a kelvin
        "load_1_Nm": [False, False, True, False],
    }
    assert model.outside_training(asked).tolist() == [False, True, True, False]
    assert model.inputs_outside_training(train) == {}
    assert model.outside_training(angles).tolist() == [False, True, False, False]


@pytest.mark.parametrize("name", MODELS)
def test_the_uncertainty_grows_outside_the_trained_temperatures_and_only_there(name, real, rng):
    """At a distance of about 1 m steel grows by 0.0115 mm a kelvin."""
    train = warm(real, rng)
    options = {"network": {"hidden": (4,), "epochs": 5}, "physical": {"highest": 1}}.get(name, {})
    model = MODELS[name](real.arm, **options).fit_readings(train)
    unstated, inside = model.predict(train.angles, return_cov=True), model.predict_readings(train, return_cov=True)
    if name != "physical":
        np.testing.assert_array_equal(unstated[1], inside[1])
        np.testing.assert_array_equal(unstated[0], model.predict_readings(at(train, 60)))
    if name == "physical":
        assert model.fit_.perturbed_chain  # growth is a term here or not, as evidence decides
    std = [
        np.sqrt(np.trace(model.predict_readings(at(train, T), return_cov=True)[1], axis1=1, axis2=2))
        for T in (train.temperature_degC.max(), 30, 40, 60)
    ]
    assert all((low < high).all() for low, high in pairwise(std))
    lengths = np.linalg.norm(real.arm.chain.tip_in_base(train.angles), axis=1)
    assert (std[-1] > 0.9 * 38 * 1.15e-5 * lengths).all() or model._has_thermal_terms()


def test_growth_that_was_learned_is_not_added_again(real, rng):
    n = 200
    angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (n, 6))
    degC = rng.uniform(15, 35, n)
    points = real.chain.tip_in_base(angles) * (1 + 2e-5 * (degC - 20))[:, None] + rng.normal(0, 0.005, (n, 3))
    model = PhysicalModel(real.arm, free=("tip",), highest=1).fit_readings(
        Session(angles, points, temperature_degC=degC)
    )
    assert model._has_thermal_terms()
    assert not model.expansion_covariance(at(Session(angles), 60)).any()
    assert model.outside_training(at(Session(angles), 60)).all()


def test_impossible_temperatures_are_refused(real, rng):
    model = PhysicalModel(real.arm, highest=1).fit_readings(warm(real, rng))
    asked, warmed = real.points(3, rng), warm(real, rng)
    for degC in (1e308, -1e308, 1e9, -300.0):
        refuses("degC", lambda degC=degC: model.predict_readings(at(asked, degC), return_cov=True))
        there = np.full(60, degC)
        refuses(
            "degC", lambda there=there: NominalModel(real.arm).fit_readings(replace(warmed, temperature_degC=there))
        )


@pytest.mark.parametrize("name", ["nominal", "kinematic", pytest.param("physical", marks=pytest.mark.weekly)])
def test_a_model_fitted_without_a_temperature_is_transferred_with_one_saved_and_read(name, real, rng, tmp_path):
    model = MODELS[name](real.arm, **({"highest": 1} if name == "physical" else {})).fit_readings(real.points(60, rng))
    assert model.training_.temperature_degC is None
    load = {"load_1_Nm": np.ones(20)}
    new = refit(model, warm(real, rng, 20, mean=25.0, columns=load))
    new.save(tmp_path / "m")
    again = load_model(tmp_path / "m")
    assert again.training_.temperature_degC == new.training_.temperature_degC
    assert 23 < again.training_.temperature_degC.mean < 27
    asked = at(real.points(10, rng, half_width=0.5), 60)
    for one, other in zip(
        new.predict_readings(asked, return_cov=True), again.predict_readings(asked, return_cov=True), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    assert again.inputs_outside_training(asked).keys() == {"temperature"}


def test_a_transfer_keeps_the_temperatures_that_the_arm_was_identified_at(real, rng):
    new = refit(KinematicModel(real.arm).fit_readings(warm(real, rng)), warm(real, rng, 20, mean=30.0))
    known = new.training_.temperature_degC
    assert 18 <= known.lower < known.upper <= 22
    assert 28 < known.mean < 32


def test_a_network_has_training_conditions_too(real, rng):
    model = NetworkModel(real.arm, hidden=(4,), epochs=5).fit_readings(warm(real, rng))
    assert model.training_.temperature_degC.lower >= 18


@pytest.mark.parametrize("name", ["load */\nint x;", "load_1\n", "load_", "J1", "__proto__", "load_*/", 'load_"'])
def test_a_model_has_columns_as_a_session_has_them_and_no_others(name):
    training = TrainingConditions.of(Session(np.zeros((3, 1))), TURNS)
    known = InputRange(1.0, 1.0, 0.0, 2.0)
    error = refuses("names of further columns such as load_1_Nm", replace, training, columns={name: known})
    assert "\n" not in error.problem
    assert replace(training, columns={"load_größe": known}).columns


def test_whether_angles_are_rounded_is_judged_of_the_session(rng):
    step = 1e-3
    trained = Session(step * np.round(rng.uniform(-1, 1, (50, 1)) / step))
    conditions = replace(TrainingConditions.of(trained, np.zeros(1, bool)), angle_std=np.array([step / np.sqrt(12)]))
    exact = rng.uniform(-1, 1, (200, 1))
    assert not conditions.is_rounded(exact).any()
    assert conditions.is_rounded(step * np.round(exact / step)).all()
    assert np.concatenate([conditions.is_rounded(row[None]) for row in exact]).mean() < 0.05
    assert all(conditions.is_rounded(step * np.round(row[None] / step)).all() for row in exact)
