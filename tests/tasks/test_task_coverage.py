"""The law of task uncertainty: 95 % intervals hold the errors that virtual arms make, at short and long lengths alike.

A small version of benchmarks/task_uncertainty.py, where 500 arms are measured.
"""

import numpy as np
import pytest

from truearm.arm.catalogue import load
from truearm.models import KinematicModel
from truearm.poses.measuring import measuring
from truearm.tasks.errors import ModelErrors
from truearm.tasks.features import length_at
from truearm.tasks.postures import held, middle_of
from truearm.tasks.task import measured_by
from truearm.virtual import VirtualArm, load_preset

ARM = load("gao2017")
N_ARMS, WAYS = 8, 25


@pytest.fixture(scope="module")
def identified():
    """Virtual arms of a workshop and what 80 readings of each told."""
    found = []
    for seed in range(N_ARMS):
        virtual = VirtualArm.draw(ARM, load_preset("shop"), seed=seed)
        readings = virtual.measure(measuring(ARM, 80, seed=seed).angles, seed=seed).readings
        found.append((virtual, KinematicModel(ARM).fit_readings(readings)))
    return found


@pytest.mark.parametrize("length", [50.0, 1000.0])
def test_intervals_hold_what_they_say(identified, length):
    """200 measured lengths of eight arms: 95 % and three standard deviations, of binomial counts as of arms.

    A binomial share of 200 has 1.5 %; the coverages of single arms scatter by about 5 %, the mean of eight by 1.8 %.
    """
    middle, across = middle_of(ARM)
    feature = length_at(middle, across, length)
    ways = held(ARM, feature, WAYS, seed=77)
    inside, times = [], []
    for seed, (virtual, model) in enumerate(identified):
        stated = measured_by(ModelErrors(model), feature, n_arms=400, seed=seed).estimates[0]
        poses = ways.reshape(-1, ARM.n_joints)
        taken = virtual.measure(poses, seed=500 + seed, temperature_degC=model.temperature_degC_, reference=False)
        shown = model.predict_readings(taken.readings).reshape(len(ways), 2, 3)
        true = taken.true_tips.reshape(shown.shape)
        errors = np.linalg.norm(shown[:, 1] - shown[:, 0], axis=1) - np.linalg.norm(true[:, 1] - true[:, 0], axis=1)
        low, high = stated.interval_mm
        inside.append(((errors >= low) & (errors <= high)).mean())
        times.append((errors**2).mean() / stated.u_mm**2)
    assert np.mean(inside) > 0.95 - 3 * np.hypot(0.015, 0.018)
    # Nor are they too wide: errors are as large as the standard uncertainty.
    assert 0.75 < np.sqrt(np.mean(times)) < 1.25
