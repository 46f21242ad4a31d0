"""A sphere of known size tells how large the arm is; one of unknown size leaves that to the drawing."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.acceptance import accepting
from truearm.arm import load_arm
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.models import KinematicModel
from truearm.readings import Session

# Diameters 50 mm of the sphere and 6 mm of the ball on the stylus, whose centre is the tip.
DISTANCE_MM, U_MM, NOISE_MM, GROWN = (50.0 + 6.0) / 2, 0.0005, 0.002, 1.002


@pytest.fixture(scope="module")
def touched():
    """An arm two thousandths larger than drawn, with its tip all over three spheres; its chain and the readings."""
    rng = np.random.default_rng(0)
    arm = load_arm("gao2017")
    fixed = arm.chain.fixed.copy()
    fixed[:, :3, 3] *= GROWN
    chain = replace(arm.chain, fixed=fixed, tip_in_flange=arm.chain.tip_in_flange * GROWN)
    centres = chain.tip_in_base(arm.working + 0.3 * rng.uniform(-1, 1, (3, 6)))
    angles, sphere = [], []
    for name, centre in zip("ABC", centres, strict=True):
        away = rng.normal(size=(120, 3))
        away *= (DISTANCE_MM + rng.normal(0, NOISE_MM, (120, 1))) / np.linalg.norm(away, axis=1, keepdims=True)
        found = solve_inverse_kinematics(chain, centre + away, start=arm.working + 0.8 * rng.uniform(-1, 1, (120, 6)))
        angles.append(found.angles[found.reached][:60])
        sphere += [name] * 60
    return chain, np.concatenate(angles), np.array(sphere)


@pytest.mark.parametrize("known", [True, False])
def test_the_arms_size_is_that_of_a_known_sphere(touched, known):
    chain, angles, sphere = touched
    distance = np.tile([DISTANCE_MM, U_MM], (len(angles), 1)) if known else None
    readings = Session(angles, sphere=sphere, sphere_distance=distance)
    with accepting("all lengths were made 0.2 % longer"):
        model = KinematicModel(load_arm("gao2017")).fit_readings(readings)
    elsewhere = model.arm.working + 0.4 * np.random.default_rng(1).uniform(-1, 1, (200, 6))
    predicted, truth = model.predict(elsewhere), chain.tip_in_base(elsewhere)
    scale = np.sqrt(np.square(predicted - predicted.mean(axis=0)).sum() / np.square(truth - truth.mean(axis=0)).sum())
    # Sixty touches of 2 um on each of three spheres, 28 mm from their centres: 1e-5, and the certificate's 2e-5.
    assert scale == pytest.approx(1.0 if known else 1 / GROWN, abs=1e-4 if known else 5e-4)
    (reference,) = model.fit_.references
    radius = reference.unknowns["effective radius of sphere A [mm]"]
    assert radius == pytest.approx(DISTANCE_MM if known else DISTANCE_MM / GROWN, abs=3e-3 if known else 2e-2)
    assert reference.noise_std == pytest.approx(NOISE_MM, rel=0.3)
