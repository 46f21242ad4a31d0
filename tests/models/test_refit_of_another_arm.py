"""Readings of another arm of the type contradict a refit; those of a worn arm, or of a poor instrument, do not."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses


def readings(*, arm_seed, poses=15, seed=7, **options):
    """Without a serial number, which would tell the arms apart."""
    simulated = ta.simulate("ur10", poses=poses, seed=seed, arm_seed=arm_seed, **options).session
    return replace(simulated, serial_number=None)


@pytest.fixture(scope="module")
def model():
    return ta.fit("ur10", readings(arm_seed=3, poses=60, seed=1), model="kinematic").model


@pytest.mark.parametrize("arm_seed", [4, *(pytest.param(i, marks=pytest.mark.weekly) for i in (5, 6))])
def test_another_arm_is_refused_and_may_be_accepted(model, arm_seed):
    other = readings(arm_seed=arm_seed)
    caught = refuses("constants of the model would have to move by . standard unc", ta.refit, model, other)
    assert "--accept" in caught.hint
    assert "Accepted (rebuilt)" in str(ta.refit(model, other, accept="rebuilt"))


def moved_zero(session):
    """J3 by 20 arcsec, a third of the typical error of the arm's constants."""
    return replace(session, angles=session.angles + np.array([0, 0, 1e-4, 0, 0, 0]))


def poor_camera(session):
    noise = np.random.default_rng(1).normal(0, 0.3, session.points.shape)
    return replace(session, points=session.points + noise)


def warmer(session):
    """Aluminium by 10 K, which nobody states."""
    middle = session.points.mean(axis=0)
    return replace(session, points=middle + (session.points - middle) * (1 + 23e-5))


def elsewhere(session):
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return replace(session, points=session.points @ turned.T + [900.0, -400, 120])


@pytest.mark.parametrize(
    "change", [moved_zero, poor_camera, warmer, elsewhere, lambda session: session.rows([0, 4, 8, 12, 14])]
)
def test_the_same_arm_is_not_questioned(model, change):
    ta.refit(model, change(readings(arm_seed=3)))


def test_another_region_of_the_joints_is_no_other_arm(model):
    ta.refit(model, readings(arm_seed=3, half_width_deg=40))
