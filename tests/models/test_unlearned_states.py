"""Temperatures, loads and directions that the training did not show: their prior is in the covariance."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.identification.references.reading_references import state_of
from truearm.identification.terms import candidate_terms, link_vectors
from truearm.identification.terms.basis import Temperature
from truearm.identification.terms.catalogue import COLUMN_STD, HYSTERESIS_STD, unlearned_terms
from truearm.identification.terms.links import UNKNOWN_MATERIAL
from truearm.models import KinematicModel, PhysicalModel, load_model
from truearm.readings import Session
from truearm.verbs.predict import predict

N = 40


@pytest.fixture(scope="module")
def readings(real):
    rng = np.random.default_rng(13)
    return real.points(
        N, rng, temperature_degC=np.full(N, 23.0), directions=np.ones((N, 6)), columns={"load_2_Nm": np.full(N, 10.0)}
    )


@pytest.fixture(scope="module")
def model(real, readings):
    return PhysicalModel(real.arm, highest=1).fit_readings(readings)


def growth_of(model):
    """(n_links,) coefficients of the growth [1/K]."""
    found, start = [], 0
    for term in model.fit_.perturbed_chain.terms:
        if isinstance(term.basis, Temperature):
            found.append(model.fit_.coefficients[start])
        start += term.n_coefficients
    return np.array(found)


def test_at_the_constant_states_of_the_training_nothing_is_added(model, readings, real):
    bare = replace(readings, temperature_degC=None, directions=None, columns={})
    without = PhysicalModel(real.arm, highest=1).fit_readings(bare)
    points, covariance = model.predict_readings(readings, return_cov=True)
    expected_points, expected = without.predict_readings(bare, return_cov=True)
    np.testing.assert_allclose(points, expected_points, atol=1e-9)  # mm
    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-12)
    assert model.inputs_outside_training(readings) == {}


def test_growth_that_was_not_shown_is_in_the_covariance(model, readings):
    """``dT^2 (m^2 r r^T + d^2 sum v v^T)`` of all links in the identified arm, 8 K from the training at 23 degC."""
    warm = replace(readings, temperature_degC=np.full(N, 31.0))
    points, covariance = model.predict_readings(warm, return_cov=True)
    own_points, own = model.predict_readings(readings, return_cov=True)
    np.testing.assert_allclose(points, own_points, atol=1e-9)
    jacobian = model.fit_.chain.tip_derivatives(readings.angles).motion_jacobian
    links = np.einsum("li,nlix->nlx", link_vectors(model.arm_.chain), jacobian[:, :-1, 3:])
    prior = UNKNOWN_MATERIAL.covariance(links.shape[1])
    expected = 8.0**2 * np.einsum("nlx,lm,nmy->nxy", links, prior, links)
    # Motions by the angles, 1e-3 of the links, are not in the chain of constants.
    np.testing.assert_allclose(covariance - own, expected, atol=0.02 * np.abs(expected).max())
    assert model.inputs_outside_training(warm).keys() == {"temperature"}


def test_models_with_and_without_terms_agree_on_growth_that_was_not_shown(model, real, readings):
    kinematic = KinematicModel(real.arm).fit_readings(readings)
    warm = replace(readings, temperature_degC=np.full(N, 31.0))
    added = model.covariance_parts(warm)[0] - model.covariance_parts(readings)[0]
    expected = kinematic.expansion_covariance(warm)
    np.testing.assert_allclose(added, expected, atol=0.02 * np.abs(expected).max())


def test_a_direction_and_a_load_that_were_constant_are_in_the_covariance_and_named(model, readings):
    levers = model.fit_.chain.tip_derivatives(readings.angles).motion_jacobian[:, 1:-1, 2]
    own = model.predict_readings(readings, return_cov=True)[1]
    back = readings.directions.copy()
    back[:, 3] = -1.0
    asked = {
        "direction_4": (replace(readings, directions=back), 2 * HYSTERESIS_STD["revolute"] * levers[:, 3]),
        "load_2_Nm": (
            replace(readings, columns={"load_2_Nm": np.full(N, 25.0)}),
            1.5 * COLUMN_STD["revolute"] * levers[:, 1],  # one by the size of the constant load, 10 N m
        ),
    }
    for name, (session, effect) in asked.items():
        added = model.predict_readings(session, return_cov=True)[1] - own
        expected = np.einsum("nx,ny->nxy", effect, effect)
        np.testing.assert_allclose(added, expected, atol=0.02 * np.abs(expected).max())
        assert model.inputs_outside_training(session).keys() == {name}
        found = predict(model, session)
        size = np.sqrt(np.trace(expected, axis1=1, axis2=2).mean() / 3)
        assert found.outside_u_mm == {name: pytest.approx(size, rel=0.02)}
        assert f"uncertainty (root mean square): {name} " in "\n".join(found.blocks())


@pytest.mark.parametrize("load", [0.1, 1.7, -2.3, 1e-3])
def test_the_prior_of_a_constant_load_is_by_its_size_and_not_by_rounding(real, readings, load):
    state = state_of(real.arm, replace(readings, columns={"load_2_Nm": np.full(N, load)}))
    ((term, value),) = [one for one in unlearned_terms(state) if one[0].group == "load_2_Nm"]
    assert value == pytest.approx(load, rel=1e-12)
    assert float(term.prior_stds[0]) == pytest.approx(COLUMN_STD["revolute"] / abs(load), rel=1e-12)


def test_a_load_of_zero_throughout_is_no_term_and_is_named(real, readings):
    """Else the uncertainty with a load would depend on the load's unit."""
    bare = replace(readings, temperature_degC=None, directions=None, columns={"load_2_Nm": np.zeros(N)})
    state = state_of(real.arm, bare)
    terms, skipped = candidate_terms(state, highest=1)
    assert "load_2_Nm" not in {term.group for term in [*terms, *(term for term, _ in unlearned_terms(state))]}
    assert "load_2_Nm" in [one.name for one in skipped]
    model = PhysicalModel(real.arm, highest=1).fit_readings(bare)
    found = predict(model, loaded := replace(bare, columns={"load_2_Nm": np.full(N, 5.0)}))
    assert model.inputs_outside_training(loaded).keys() == {"load_2_Nm"}
    assert "load_2_Nm" in "\n".join(found.blocks())


def test_a_temperature_that_only_the_prediction_states_is_far_from_20_degC(real, readings):
    bare = replace(readings, temperature_degC=None)
    model = PhysicalModel(real.arm, highest=1).fit_readings(bare)
    near, far = (replace(readings, temperature_degC=np.full(N, degC)) for degC in (21.5, 28.0))
    assert model.inputs_outside_training(near) == {}
    assert model.inputs_outside_training(far)["temperature"].all()
    std = [np.sqrt(np.trace(model.predict_readings(one, return_cov=True)[1], axis1=1, axis2=2)) for one in (near, far)]
    assert (std[1] > std[0]).all()


def test_readings_within_a_tenth_of_a_kelvin_teach_no_growth(real):
    rng = np.random.default_rng(14)
    session = real.points(N, rng, temperature_degC=rng.uniform(20.0, 20.1, N))
    model = PhysicalModel(real.arm, highest=1).fit_readings(session)
    assert np.abs(growth_of(model)).max() < 2e-6
    growth = [group for group in model.fit_.groups if group.name == "thermal expansion"]
    assert growth[0].effective < 0.5


def test_growth_of_a_wide_range_is_learned_and_lengths_are_those_at_20_degC(real):
    """A whole arm of aluminium, 23e-6 per kelvin, from 25 to 45 degC; the constants of the chain are those at 20."""
    rng = np.random.default_rng(15)
    angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (120, 6))
    degC = rng.uniform(25, 45, 120)
    at_20 = real.chain.tip_in_base(angles)
    session = Session(angles, at_20 * (1 + 23e-6 * (degC - 20))[:, None], temperature_degC=degC)
    model = PhysicalModel(real.arm, highest=1).fit_readings(session)
    # Links up to a kelvin behind a scatter of 5.8 K: at most 17 % more.
    assert np.median(growth_of(model)) == pytest.approx(23e-6 * 1.08, rel=0.12)
    cold = Session(angles, temperature_degC=np.full(120, 20.0))
    points, covariance = model.predict_readings(cold, return_cov=True)
    u = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 3)
    assert (np.linalg.norm(points - at_20, axis=1) < 3 * u + 1e-3).all()
    chain = model.fit_.chain
    np.testing.assert_allclose(chain.tip_in_base(angles), points, atol=0.02)


def test_what_was_not_shown_is_kept_in_the_file(model, readings, tmp_path):
    model.save(tmp_path / "arm")
    again = load_model(tmp_path / "arm")
    np.testing.assert_array_equal(again.training_.direction_ranges, np.ones((6, 2)))
    warm = replace(readings, temperature_degC=np.full(N, 31.0), directions=-readings.directions)
    for one, other in zip(
        model.predict_readings(warm, return_cov=True), again.predict_readings(warm, return_cov=True), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    assert again.inputs_outside_training(warm).keys() == model.inputs_outside_training(warm).keys()
