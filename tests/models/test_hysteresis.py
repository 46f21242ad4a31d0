"""Hysteresis from end to end: planted in a virtual arm, through a session file, found, saved and predicted."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.terms.basis import Direction
from truearm.models import PhysicalModel
from truearm.models.model_file import load_model
from truearm.readings import read_session, write_session
from truearm.wings.planning.virtual import PRESETS, VirtualArm

NOISE = 0.01  # mm


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """An arm with constants and hysteresis (some 20 arc seconds, 0.05 mm at half a metre), and its session file."""
    preset = replace(
        PRESETS["perfect"], length_std_mm=0.3, angle_std_deg=0.03, hysteresis_std_arcsec=20.0, reference_std_mm=NOISE
    )
    arm = load_arm("gao2017")
    virtual = VirtualArm.draw(arm, preset, seed=5)
    angles = arm.working + 0.9 * np.random.default_rng(6).uniform(-1, 1, (160, 6))
    path = tmp_path_factory.mktemp("hysteresis") / "session.csv"
    write_session(virtual.measure(angles, seed=7).readings, path)
    return virtual, path


@pytest.fixture(scope="module")
def model(measured):
    return PhysicalModel(load_arm("gao2017"), free=(), highest=2).fit_readings(read_session(measured[1]))


def test_planted_hysteresis_is_found_within_its_stated_uncertainty(measured, model):
    virtual, path = measured
    readings = read_session(path)
    assert set(np.unique(readings.directions)) == {-1.0, 0.0, 1.0}  # 0 before the first movement
    fit, found, std, start = model.fit_, [], [], 0
    for term in fit.perturbed_chain.terms:
        if isinstance(term.basis, Direction):
            assert term.basis.joint == len(found) + 1
            found.append(fit.coefficients[start])
            std.append(np.sqrt(fit.covariance[start, start]))
        start += term.n_coefficients
    planted = virtual.systematic.of_group("hysteresis")
    assert len(found) == 6
    # Joint 5 has a lever of some 50 mm, joint 6 none: the tip lies on its axis.
    assert max(std[:4]) < 3e-6 < max(std[:5]) < 3e-5
    assert (np.abs(found - planted) / std).max() < 3.5


def test_a_prediction_uses_the_directions_of_its_readings(measured, model, tmp_path):
    virtual, _ = measured
    angles = load_arm("gao2017").working + 0.8 * np.random.default_rng(8).uniform(-1, 1, (50, 6))
    met = virtual.measure(angles, seed=9)
    knowing = np.linalg.norm(model.predict_readings(met.readings) - met.true_tips, axis=1)
    # Half way between the directions some 1e-4 rad of five joints are missing, a root of five of 0.05 mm and less.
    unknowing = np.linalg.norm(model.predict(met.readings.angles) - met.true_tips, axis=1)
    assert knowing.mean() < 0.01 < 4 * knowing.mean() < unknowing.mean()
    model.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    np.testing.assert_array_equal(again.predict_readings(met.readings), model.predict_readings(met.readings))
    np.testing.assert_array_equal(again.predict(angles), model.predict(angles))


def test_without_directions_no_hysteresis_is_offered_and_it_is_said(measured):
    readings = replace(read_session(measured[1]), directions=None)
    model = PhysicalModel(load_arm("gao2017"), free=(), highest=1).fit_readings(readings)
    assert ("hysteresis", "the directions of movement are not known") in model.excluded_terms_
