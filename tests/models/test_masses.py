"""Masses and the direction of weight: from the arm file into the fit, the model file and what is predicted."""

import hashlib
import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import LinkMasses, load_arm, read_arm, write_arm
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.reading_references import state_of
from truearm.identification.terms import GravityTorque, Term, gravity_torques
from truearm.models import PhysicalModel
from truearm.models.model_file import load_model
from truearm.readings import Session
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.reports.arms import identified_arm

GIVE = 3e-5  # rad/(N m)


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """A `gao2017` on a wall, of uneven masses, by way of its file."""
    masses = LinkMasses([9, 1, 6, 0.5, 2, 0.3], np.random.default_rng(1).uniform(-150, 150, (6, 3)))
    arm = replace(load_arm("gao2017"), masses=masses, gravity_in_base=[-1, 0, 0])
    path = tmp_path_factory.mktemp("wall") / "arm.toml"
    write_arm(arm, path)
    return read_arm(path)


@pytest.fixture(scope="module")
def readings(wall):
    """Readings of it whose drive at joint 2 gives way under the weight, seen to 5 um."""
    rng = np.random.default_rng(2)
    angles = wall.working + 1.2 * rng.uniform(-1, 1, (120, 6))
    give = Term("J2", 2, (0, 0, 1, 0, 0, 0), GravityTorque(2, 2), "give", 1.0)
    points = PerturbedChain(wall.chain, (give,)).tips(state_of(wall, Session(angles)), np.array([GIVE]))
    return Session(angles, points + rng.normal(0, 0.005, points.shape))


@pytest.fixture(scope="module")
def model(wall, readings):
    return PhysicalModel(wall, free=(), highest=1).fit_readings(readings)


def test_the_state_pulls_as_the_arm_hangs(wall, readings):
    torques = state_of(wall, readings).gravity_torques
    expected = gravity_torques(wall.chain, readings.angles, wall.masses, gravity_in_base=[-9.80665, 0, 0])
    np.testing.assert_allclose(torques, expected, rtol=0, atol=1e-12)
    drawn = nominal_prior(wall, noise_mm=0.01)
    np.testing.assert_array_equal(drawn.state(readings.angles).gravity_torques, torques)


def test_give_under_known_weight_is_found_within_its_uncertainty(model, readings, wall):
    names = [label for term in model.fit_.perturbed_chain.terms for label in term.labels]
    assert not any("uniform" in name for name in names)
    at = names.index("J2 rotation about z by the gravity torque about z")
    assert abs(model.fit_.coefficients[at] - GIVE) < 4 * np.sqrt(model.fit_.covariance[at, at])
    upright = replace(wall, masses=None, gravity_in_base=None)
    guess = PhysicalModel(upright, free=(), highest=1).fit_readings(readings)
    assert model.residual_std_ < 0.006 < 0.01 < guess.residual_std_


def test_masses_and_gravity_stay_with_the_model(model, readings, wall, tmp_path):
    model.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    np.testing.assert_array_equal(again.arm.masses.mass_kg, wall.masses.mass_kg)
    np.testing.assert_array_equal(again.arm.masses.centre_in_joint_mm, wall.masses.centre_in_joint_mm)
    np.testing.assert_array_equal(again.arm.gravity_direction, wall.gravity_direction)
    for one, other in zip(*(m.predict(readings.angles, return_cov=True) for m in (model, again)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_masses_that_fit_no_arm_are_refused_from_a_file(model, tmp_path):
    model.save(tmp_path / "m.truearm")
    with zipfile.ZipFile(tmp_path / "m.truearm") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    header = json.loads(files["model.json"])
    changes = {
        "arm_.masses.mass_kg": (np.full(6, -1.0), "not negative"),
        "arm_.masses.centre_in_joint_mm": (np.zeros((5, 3)), "centres of mass"),
    }
    for name, (array, said) in changes.items():
        stream = io.BytesIO()
        np.lib.format.write_array(stream, array, version=(1, 0))
        entry = {"shape": list(array.shape), "sha256": hashlib.sha256(stream.getvalue()).hexdigest()}
        changed = header | {"arrays": header["arrays"] | {name: entry}}
        with zipfile.ZipFile(tmp_path / "bad.truearm", "w") as archive:
            for file, data in (files | {f"{name}.npy": stream.getvalue()}).items():
                archive.writestr(file, json.dumps(changed) if file == "model.json" else data)
        refuses(said, load_model, tmp_path / "bad.truearm")


def test_an_identified_arm_is_pulled_the_same_way_in_the_frame_of_the_reference(wall, tmp_path):
    """In a frame with z to the arm's right, weight pulls along another axis; the joints bear the same."""
    turned = np.array([[0.0, 1, 0, 500], [0, 0, 1, -300], [1, 0, 0, 20], [0, 0, 0, 1]])
    rng = np.random.default_rng(3)
    angles = wall.working + 0.8 * rng.uniform(-1, 1, (30, 6))
    points = wall.chain.with_reference_frame(turned).tip_in_base(angles) + rng.normal(0, 0.005, (30, 3))
    PhysicalModel(wall, highest=1).fit_readings(Session(angles, points)).save(tmp_path / "m.truearm")
    arm = identified_arm(tmp_path / "m.truearm")
    np.testing.assert_allclose(arm.gravity_direction, [0, 0, -1], atol=1e-3)  # some 0.1 mrad of the base's tilt
    here, there = (state_of(one, Session(angles)).gravity_torques for one in (wall, arm))
    np.testing.assert_allclose(there, here, atol=0.05)  # of up to 50 N m
