"""The hybrid model: what its networks learn, its held-out errors and uncertainty, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.models import HybridModel, KinematicModel, NominalModel, load_model
from truearm.models.hybrid import ResidualInputs, _scatter, _share_of_mean
from truearm.models.selection import CANDIDATES, select_model
from truearm.readings import Session
from truearm.verbs.fit import fit

NOISE = 0.01  # mm
CHI2 = 7.815  # of three coordinates, 95 %


def wave(angles, temperature_degC=20.0):
    """A part of the error that no constant of the arm can be: up to half a millimetre, 0.05 mm a kelvin."""
    turn, lift, bend = angles.T
    grow = 0.05 * (temperature_degC - 20.0) * np.sin(2 * bend)
    return np.stack([0.5 * np.sin(2 * turn + lift), 0.3 * np.cos(3 * lift), grow], axis=1)


@pytest.fixture(scope="module")
def arm() -> Arm:
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [20, 0, 100]
    return Arm("zigzag", Chain(fixed, np.array([0, 0, 50.0])))


def measured(arm, rng, n=150, temperature=None) -> Session:
    angles = rng.uniform(-1, 1, (n, 3))
    degC = 20.0 if temperature is None else temperature
    points = arm.chain.tip_in_base(angles) + wave(angles, degC) + rng.normal(0, NOISE, (n, 3))
    return Session(angles, points, temperature_degC=temperature)


@pytest.fixture(scope="module")
def train(arm) -> Session:
    rng = np.random.default_rng(1)
    return measured(arm, rng, temperature=rng.uniform(15, 25, 150))


@pytest.fixture(scope="module")
def test(arm) -> Session:
    rng = np.random.default_rng(2)
    return measured(arm, rng, 300, temperature=rng.uniform(15, 25, 300))


@pytest.fixture(scope="module")
def kinematic(arm, train) -> KinematicModel:
    return KinematicModel(arm).fit_readings(train)


@pytest.fixture(scope="module")
def model(arm, train, kinematic) -> HybridModel:
    return HybridModel(arm).fit_readings(train, nominal=kinematic)


def mean_error(model, session) -> float:
    return float(np.linalg.norm(model.predict_readings(session) - session.points, axis=1).mean())


def coverage(model, session) -> float:
    points, covariance = model.predict_readings(session, return_cov=True)
    off = points - session.points
    return float((np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0]) < CHI2).mean())


def test_the_networks_learn_what_the_constants_leave(model, kinematic, test):
    """150 readings: a fifth of the kinematic arm's error at most; the mean length of the noise alone is 0.016 mm."""
    assert mean_error(model, test) < 0.2 * mean_error(kinematic, test)
    assert mean_error(model, test) < 0.05


def test_held_out_errors_are_those_of_new_readings(model, train, test):
    assert model.held_out_.rows.tolist() == list(range(len(train)))
    # A member has seen four fifths of the readings, and the prediction is the mean of five.
    assert 0.9 < model.held_out_errors_.mean_mm / mean_error(model, test) < 1.6


def test_ellipsoids_contain_new_readings(model, test):
    assert 0.93 <= coverage(model, test) <= 0.995


def test_uncertainty_grows_outside_and_the_rows_are_flagged(model, test):
    away = replace(test, angles=test.angles + [1.5, 0, 0])
    inside, outside = (np.trace(model.covariance_parts(part)[0], axis1=1, axis2=2) for part in (test, away))
    assert np.median(outside) > 4 * np.median(inside)
    assert model.outside_training(away)[away.angles[:, 0] > 1.01].all()


def test_what_readings_share_is_part_of_their_uncertainty(model, test):
    """The rest, the scatter of the networks, is a covariance too; outside the trained temperature growth is shared."""
    warm = replace(test, temperature_degC=test.temperature_degC + 40.0)
    for readings in (test, warm):
        shared, (of_parameters, _) = model.shared_displacements(readings), model.covariance_parts(readings)
        rest = of_parameters - np.einsum("kni,knj->nij", shared, shared)
        assert (np.linalg.eigvalsh(rest) > -1e-9 * np.trace(of_parameters, axis1=1, axis2=2).max()).all()
    assert np.linalg.norm(shared) > np.linalg.norm(model.shared_displacements(test))


def test_far_outside_the_correction_stays_of_the_size_of_the_residuals(model, kinematic, rng):
    """Hidden units saturate: no reading in a full turn of all joints is moved by more than 10 mm for waves of 0.6."""
    angles = rng.uniform(-np.pi, np.pi, (500, 3))
    moved = model.predict(angles) - kinematic.predict(angles)
    assert np.linalg.norm(moved, axis=1).max() < 10


def test_a_full_turn_changes_nothing(model, test):
    turned = replace(test, angles=test.angles + [2 * np.pi, -2 * np.pi, 0])
    np.testing.assert_allclose(model.predict_readings(turned), model.predict_readings(test), rtol=0, atol=1e-9)


def test_a_temperature_that_is_not_stated_is_the_mean_and_its_effect_uncertain(model, test):
    unstated = replace(test, temperature_degC=None)
    at_mean = replace(test, temperature_degC=np.full(len(test), model.training_.temperature_degC.mean))
    np.testing.assert_array_equal(model.predict_readings(unstated), model.predict_readings(at_mean))
    more = model.covariance_parts(unstated)[1] - model.covariance_parts(at_mean)[1]
    effect = 0.05 * model.training_.temperature_degC.std * np.sin(2 * test.angles[:, 2])
    assert np.sqrt(more[:, 2, 2]).mean() == pytest.approx(np.abs(effect).mean(), rel=0.2)


def test_on_the_nominal_arm_more_is_left_to_learn(arm, train, kinematic, test):
    model = HybridModel(arm, arm_model="nominal", n_members=3).fit_readings(train, nominal=kinematic)
    nominal = NominalModel(arm).fit_readings(train)
    np.testing.assert_array_equal(model.fit_.tips(nominal.state(test)), nominal.predict_readings(test))
    assert mean_error(model, test) < 0.3 * mean_error(nominal, test)


def test_the_model_comes_back_from_its_file(model, test, tmp_path):
    model.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    for got, expected in zip(
        again.predict_readings(test, return_cov=True), model.predict_readings(test, return_cov=True), strict=True
    ):
        np.testing.assert_array_equal(got, expected)
    assert again.held_out_errors_ == model.held_out_errors_
    assert again.ellipsoid_factor(0.99) == model.ellipsoid_factor(0.99)
    assert not len(again.held_out_.rows)


def select(arm, readings):
    nominal = NominalModel(arm)
    prepared = nominal.prepare(readings)
    return select_model(nominal.learn(prepared), prepared)[:3]


def test_auto_keeps_it_where_no_term_describes_the_error(arm, train, monkeypatch):
    """The waves are not of a joint's own axis; physical terms are left out to be quick."""
    monkeypatch.delitem(CANDIDATES, "physical")
    kept, table, _ = select(arm, train)
    assert isinstance(kept, HybridModel)
    assert [row.name for row in table] == ["nominal", "kinematic", "hybrid"]
    assert table[-1].kept
    assert table[-1].n_effective == kept.n_effective_


def test_auto_does_not_fit_it_where_the_first_network_is_worse(arm, rng, monkeypatch):
    """Constants only: a network can but add noise."""
    monkeypatch.delitem(CANDIDATES, "physical")
    angles = rng.uniform(-1, 1, (150, 3))
    points = arm.chain.tip_in_base(angles) + [1.0, -2.0, 3.0] + rng.normal(0, NOISE, (150, 3))
    _, table, _ = select(arm, Session(angles, points))
    assert [row.name for row in table] == ["nominal", "kinematic"]


def test_gross_errors_of_the_arm_teach_the_networks_nothing(arm, train, test):
    points = train.points.copy()
    points[[7, 70]] += [[0, 30, 0], [-40, 0, 0]]
    model = HybridModel(arm, n_members=4).fit_readings(replace(train, points=points))
    assert not {7, 70} & set(model.held_out_.rows.tolist())
    assert mean_error(model, test) < 0.08
    # They count in comparisons, as networks leave them that did not learn them.
    gross = model.held_out_gross_
    assert set(gross.rows.tolist()) == {7, 70}
    np.testing.assert_allclose(gross.errors_mm, [40.0, 30.0] if gross.rows[0] == 70 else [30.0, 40.0], atol=1.0)


def test_positions_that_are_visited_in_rounds_are_held_out_by_time(arm, rng):
    """Every position is among the readings measured last: these rows themselves are held out."""
    at = np.tile(rng.uniform(-1, 1, (10, 3)), (5, 1)) + rng.normal(0, 0.2, (50, 3))
    position = np.array([f"p{row % 10}" for row in range(50)])
    readings = Session(at, arm.chain.tip_in_base(at) + wave(at) + rng.normal(0, NOISE, (50, 3)), position=position)
    kinematic = KinematicModel(arm).fit_readings(readings)
    hybrid = HybridModel(arm, hidden=(2,), epochs=2)
    held_out = hybrid.held_out_by_one_member(hybrid.prepare(readings), kinematic, latest=True)
    rows = np.sort(kinematic.held_out_.rows)
    assert held_out.rows.tolist() == rows[-len(held_out.rows) :].tolist()
    assert 5 <= len(held_out.rows) <= 15


def test_auto_does_not_try_it_where_no_joint_moves_far(arm, rng, monkeypatch):
    """Nothing could vary as its input, and readings that it refuses are good enough for the others."""
    monkeypatch.delitem(CANDIDATES, "physical")  # quicker
    angles = np.radians(rng.uniform(-0.45, 0.45, (100, 3)))
    readings = Session(angles, arm.chain.tip_in_base(angles) + rng.normal(0, NOISE, (100, 3)))
    _, table, _ = select(replace(arm, nominal_error_mm=0.05), readings)
    assert [row.name for row in table] == ["nominal", "kinematic"]


def test_gross_errors_are_named(arm, train):
    """Those of its arm: they teach the networks nothing, so a person must know of them."""
    points = train.points.copy()
    points[7] += 20.0
    result = fit(arm, replace(train, points=points), model="hybrid", hidden=(2,), epochs=1, n_members=2)
    assert [one.row for one in result.outliers if one.is_excluded] == [7]
    assert "reading 8" in "".join(map(str, result.blocks()))


def test_the_result_of_fit_names_networks_and_errors(arm, train):
    result = fit(arm, train, model="hybrid", epochs=3, n_members=2, hidden=(3,))
    assert result.model_name == "hybrid"
    assert result.summary().startswith("Mean error ")
    facts = result.to_dict()
    assert facts["network"]["sizes"] == [7, 3, 3]
    assert facts["residual_std_mm"] == result.model.residual_std_
    printed = "\n".join(map(str, result.blocks()))
    assert "2 networks 7-3-3 on the residuals of the kinematic model" in printed
    assert "unexplained by the model; the scatter of its networks comes on top" in printed


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"arm_model": "physical"}, "arm_model among"),
        ({"hidden": 15}, "hidden layers"),
        ({"n_members": 1}, "n_members as a whole number of 2"),
        ({"epochs": 0}, "epochs as a whole number of 1"),
    ],
)
def test_options_that_no_fit_could_follow_are_refused(options, problem, arm, train):
    refuses(problem, HybridModel(arm, **options).fit_readings, train)


def test_readings_without_points_are_refused(arm, train):
    points = train.points.copy()
    points[3] = np.nan
    refuses("reference point at every reading", HybridModel(arm).fit_readings, replace(train, points=points))


def test_inputs_are_those_that_vary(rng):
    """J1 turns, J2 stands, J3 slides; thermometers agree to a kelvin."""
    angles = np.stack([rng.uniform(-1, 1, 20), np.full(20, 0.3), rng.uniform(0, 40, 20)], axis=1)
    slides = np.array([False, False, True])
    inputs = ResidualInputs.of(angles, rng.uniform(20, 20.5, 20), slides)
    assert inputs.n_inputs == 3
    assert not inputs.has_temperature
    scaled = inputs.scaled(angles, None)
    np.testing.assert_allclose([scaled.min(axis=1), scaled.max(axis=1)], [[-1] * 3, [1] * 3], atol=1e-12)
    assert ResidualInputs.of(angles, rng.uniform(15, 25, 20), slides).has_temperature


@pytest.mark.parametrize("course", ["warming", "a day", "two settled days"])
def test_a_temperature_that_follows_the_order_of_the_readings_is_no_input(course, rng):
    """It would be a clock: what changed with the time would be learned as an effect of the temperature."""
    n = 60
    rows = np.arange(n)
    degC = {"warming": rows / 10, "a day": 3 * np.sin(rows / 8), "two settled days": 5.0 * (rows >= 25)}[course]
    degC = 20 + degC + rng.normal(0, 0.1, n)
    angles, slides = rng.uniform(-1, 1, (n, 3)), np.zeros(3, bool)
    assert not ResidualInputs.of(angles, degC, slides).has_temperature
    assert ResidualInputs.of(angles, rng.permutation(degC), slides).has_temperature
    refuses("no joint moves", ResidualInputs.of, np.zeros((20, 3)), None, slides)


def test_scatter_and_the_share_of_the_mean_by_hand():
    """Two members 2 mm apart in x: variance 2 in one of three coordinates. One member off by 2, one by 0, mean by 1."""
    corrections = np.zeros((2, 1, 3))
    corrections[1, 0, 0] = 2.0
    np.testing.assert_allclose(_scatter(corrections), np.eye(3)[None] * 2 / 3)
    deviations = np.array([[2.0, 0.0, 0.0]])
    # 1 - (1/2)^2 * 2^2 / 2^2 = 3/4, of which the bound of one over two members is exceeded.
    assert _share_of_mean(deviations, corrections, np.array([1])) == pytest.approx(0.75)
    assert _share_of_mean(np.zeros((1, 3)), corrections, np.array([1])) == 1.0
