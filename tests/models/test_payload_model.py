"""Planted compliance: a payload is learned where it varies, and in the uncertainty where it does not."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm.arm import Arm, LinkMasses
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.propagation import half_tip_difference
from truearm.identification.terms import ArmState, GravityTorque, Term
from truearm.identification.terms.basis import PayloadTorque
from truearm.identification.terms.links import gravity_torques
from truearm.models import PhysicalModel, load_model
from truearm.readings import Session, read_session, write_session
from truearm.verbs.inputs import payload_findings
from truearm.verbs.predict import predict
from truearm.wings.exports.export import export
from truearm.wings.exports.formats import json_model
from truearm.wings.exports.formats.plain_model import plain_model

NOISE_MM = 0.01
# Compliances of the three joints [rad/(N m)]: at 5 kg and half a metre the tip sinks by some tenths of a millimetre.
COMPLIANCE = (1e-5, 2e-5, 1.5e-5)


def known_arm() -> Arm:
    """An elbow arm of three joints with known masses; its tip is 800 mm from the shoulder."""
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[0, 2, 3] = 300.0
    fixed[1, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[2, 0, 3] = fixed[3, 0, 3] = 400.0
    masses = LinkMasses(np.array([5.0, 4.0, 3.0]), np.array([[0, 0, 50.0], [200, 0, 0], [180, 20, 0]]))
    return Arm("elbow", Chain(fixed, np.array([0.0, 30.0, 20.0])), masses=masses)


def measured(kg, *, seed: int) -> Session:
    """100 readings of an arm with flexible joints."""
    arm, rng = known_arm(), np.random.default_rng(seed)
    angles = rng.uniform([-2.5, -1.2, -2.0], [2.5, 1.2, 2.0], (100, 3))
    state = ArmState.of(arm, angles, columns={"payload_kg": np.resize(np.asarray(kg, dtype=float), 100)})
    own_axis = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    terms = [Term(f"J{j}", j, own_axis, GravityTorque(j, 2), "planted", 1e-5) for j in (1, 2, 3)]
    tips = PerturbedChain(arm.chain, tuple(terms)).tips(state, np.array(COMPLIANCE))
    return Session(angles, tips + rng.normal(0, NOISE_MM, tips.shape), columns=dict(state.columns))


@pytest.fixture(scope="module")
def models():
    """By name: of an arm without stated masses, and of the same with masses."""
    unknown = replace(known_arm(), masses=None)
    varied, constant = measured([0.0, 3.0], seed=1), measured([0.0], seed=2)
    fitted = {"varied": (unknown, varied), "constant": (unknown, constant), "masses": (known_arm(), constant)}
    return {name: PhysicalModel(arm, highest=1).fit_readings(session) for name, (arm, session) in fitted.items()}


@pytest.fixture(scope="module")
def loaded():
    return measured([5.0], seed=3)


def rms(model, session) -> float:
    return float(np.sqrt(((model.predict_readings(session) - session.points) ** 2).mean()))


def covered(model, session) -> float:
    points, covariance = model.predict_readings(session, return_cov=True)
    off = points - session.points
    spread = covariance + NOISE_MM**2 * np.eye(3)
    return float((np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off) < 7.815).mean())  # 95 % of chi2(3)


def test_a_payload_that_varied_in_training_is_predicted_to_the_noise(models, loaded):
    assert rms(models["varied"], loaded) < 1.5 * NOISE_MM  # points scatter by the noise, the model by half of it
    assert rms(models["varied"], measured([1.5], seed=4)) < 1.3 * NOISE_MM


def test_a_payload_that_did_not_vary_is_flagged_and_its_effect_is_in_the_uncertainty(models, loaded):
    model = models["constant"]
    assert model.inputs_outside_training(loaded)["payload_kg"].all()
    assert rms(model, loaded) > 10 * NOISE_MM  # nothing is known of it
    assert covered(model, loaded) > 0.9
    at_training = model.predict_readings(measured([0.0], seed=3), return_cov=True)[1]
    loaded_cov = model.predict_readings(loaded, return_cov=True)[1]
    assert np.trace(loaded_cov.mean(axis=0)) > 100 * np.trace(at_training.mean(axis=0))


def test_with_known_masses_the_arm_s_own_weight_shows_what_a_payload_does(models, loaded):
    assert rms(models["masses"], loaded) < 0.2 * rms(models["constant"], loaded)
    assert models["masses"].inputs_outside_training(loaded)["payload_kg"].all()
    assert covered(models["masses"], loaded) > 0.9


def test_a_payload_that_is_not_stated_has_the_variance_of_the_training(models, loaded):
    unstated = replace(loaded, columns={})
    assert models["varied"].unstated_input_covariances(unstated).keys() == {"payload_kg"}
    assert not models["constant"].unstated_input_covariances(unstated)  # it was the same everywhere


def test_readings_of_another_payload_do_not_change_a_model_that_was_trained_without_it(loaded):
    trained = replace(measured([0.0], seed=2), columns={})
    model = PhysicalModel(known_arm(), highest=1).fit_readings(trained)
    np.testing.assert_array_equal(model.predict_readings(loaded), model.predict_readings(replace(loaded, columns={})))
    # Nor does its uncertainty, so that it is flagged and said.
    assert model.inputs_outside_training(loaded)["payload_kg"].all()
    prediction = predict(model, loaded)
    assert "payload_kg" not in prediction.outside_u_mm
    assert any("trained without payload_kg" in remark for remark in prediction.remarks)
    assert any("trained without payload_kg" in str(one) for one in payload_findings(model.training_, loaded))
    empty = replace(loaded, columns={"payload_kg": np.zeros(len(loaded))})
    assert "payload_kg" not in model.inputs_outside_training(empty)
    assert not any("payload" in remark for remark in predict(model, empty).remarks)
    assert "payload_kg" not in model.training_.with_nearest(loaded, "payload_kg").columns


def test_a_payload_moves_gravity_torques_of_known_masses(models):
    fit, state = models["masses"].fit_, models["masses"].state(measured([0.0], seed=3))
    terms = fit.perturbed_chain.terms
    kept = np.array([not isinstance(term.basis, PayloadTorque) for term in terms])
    rows = np.repeat(kept, [term.n_coefficients for term in terms])
    chain = PerturbedChain(fit.perturbed_chain.chain, tuple(t for t, keep in zip(terms, kept, strict=True) if keep))
    fit = replace(fit, perturbed_chain=chain, coefficients=fit.coefficients[rows])
    heavy = replace(state, columns={"payload_kg": np.full(100, 3.0)})
    half = half_tip_difference(fit, state, heavy)
    np.testing.assert_array_equal(half, (fit.tips(heavy) - fit.tips(state)) / 2)
    assert np.abs(half).max() > 0.05  # mm, some 10 N m on 1e-5 rad/(N m) at half a metre
    of_guess = replace(state, links=None)
    assert not half_tip_difference(fit, of_guess, replace(heavy, links=None)).any()


def test_model_and_session_files_keep_the_payload(models, loaded, tmp_path):
    models["masses"].save(tmp_path / "m.truearm")
    write_session(loaded, tmp_path / "s.csv")
    np.testing.assert_array_equal(
        load_model(tmp_path / "m.truearm").predict_readings(loaded), models["masses"].predict_readings(loaded)
    )
    np.testing.assert_array_equal(read_session(tmp_path / "s.csv").columns["payload_kg"], np.full(100, 5.0))


def test_formats_without_a_payload_are_refused(models, tmp_path):
    with pytest.raises(InputError, match="the model depends on the payload, which no export format contains"):
        export(models["varied"], tmp_path / "m.c")
    with pytest.raises(InputError, match="the model depends on the payload, which no export format contains"):
        export(models["varied"], tmp_path / "m.json")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def carrying():
    """Of an arm with masses that carried 3 kg at all readings."""
    return PhysicalModel(known_arm(), highest=1).fit_readings(measured([3.0], seed=2))


def test_a_model_of_one_payload_is_exported_for_it(models, carrying, tmp_path):
    angles = measured([0.0], seed=3).angles[:20]
    for name, model in (("none", models["constant"]), ("empty", models["masses"]), ("3 kg", carrying)):
        result = export(model, tmp_path / f"{name}.json")
        assert any("payload of the training" in block for block in result.blocks())
        tips = json_model.tips(tmp_path / f"{name}.json", angles)
        np.testing.assert_allclose(tips, model.predict(angles), rtol=0, atol=1e-9)  # mm, rounding at 0.8 m
    export(carrying, tmp_path / "m.c")
    plain = plain_model(carrying)
    links, state = LinkMasses(plain.mass_kg, plain.centre_in_joint_mm), carrying.state(Session(angles))
    torques = gravity_torques(plain.nominal_chain, angles, links, gravity_in_base=plain.gravity_in_base)
    np.testing.assert_allclose(torques, state.gravity_torques, rtol=0, atol=1e-12)  # N m, rounding at 50 N m
