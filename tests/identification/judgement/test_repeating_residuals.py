"""The share of the residuals that repeats at the same pose, of planted errors of known kinds."""

import numpy as np
import pytest

from truearm.arm.catalogue import load_arm
from truearm.errors import ProgramFault
from truearm.identification.judgement.repeating_residuals import UNKNOWN_SHARE, JointProcess
from truearm.identification.terms import directions
from truearm.models import KinematicModel, load_model
from truearm.readings.session import Session
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual.presets import ARCSEC

ARM = load_arm("gao2017")
STD_MM = 0.01


def shares(share, n_arms, n_readings=80):
    """What is stated of arms whose points have noise and, at this share, the process."""
    found = []
    for seed in range(n_arms):
        rng = np.random.default_rng([9, seed])
        angles = measuring_poses(ARM, n_readings, seed=seed).angles
        n = 3 * n_readings
        covariance = share * JointProcess(ARM.chain).covariance(angles).reshape(n, n) + (1 - share) * np.eye(n)
        off = STD_MM * np.linalg.cholesky(covariance + 1e-9 * np.eye(n)) @ rng.standard_normal(n)
        points = ARM.chain.tip_in_base(angles) + off.reshape(-1, 3)
        found.append(KinematicModel(ARM).fit_readings(Session(angles, points=points)).repeating_share_)
    return np.array(found)


@pytest.mark.parametrize(
    ("share", "low", "high"),
    [(0.0, 0.0, 0.2), (0.5, 0.25, 0.65), pytest.param(1.0, 0.6, 1.0, marks=pytest.mark.weekly)],
)
def test_a_planted_share_is_found_within_what_80_readings_tell(share, low, high):
    """A standard deviation of 0.12 of each arm, and half of the terms' own variance; the mean of three."""
    assert low <= shares(share, 3).mean() <= high


def test_too_few_readings_tell_nothing():
    assert shares(0.0, 1, n_readings=15) == pytest.approx(UNKNOWN_SHARE)


@pytest.mark.parametrize("lag_arcsec", [4.0, pytest.param(0.0, marks=pytest.mark.weekly)])
def test_the_order_of_the_readings_shows_hysteresis_that_has_no_term(lag_arcsec, rng):
    """Within 1 arcsec: noise of 0.01 mm at 0.6 m turns a joint by 0.3 in 180 coordinates; wrists move the tip less."""
    angles = measuring_poses(ARM, 60, seed=1).angles
    own = np.where(np.arange(ARM.n_joints) < 3, lag_arcsec * ARCSEC, 0.0)
    points = ARM.chain.tip_in_base(angles + own * directions(angles)) + STD_MM * rng.standard_normal((60, 3))
    readings = Session(angles, points=points)
    mean, std = KinematicModel(ARM).fit_readings(readings).hysteresis_ / ARCSEC
    assert mean[:3] == pytest.approx(own[:3] / ARCSEC, abs=1.0)
    assert std[:3].max() < 1.0
    shuffled = KinematicModel(ARM).fit_readings(readings.rows(rng.permutation(60))).hysteresis_ / ARCSEC
    assert np.abs(shuffled[:, :3]).max() < 1.5


def test_the_share_is_kept_in_the_model_file(tmp_path):
    angles = measuring_poses(ARM, 30, seed=1).angles
    points = ARM.chain.tip_in_base(angles) + STD_MM * np.random.default_rng(1).standard_normal((30, 3))
    model = KinematicModel(ARM).fit_readings(Session(angles, points=points))
    model.save(tmp_path / "m.truearm")
    assert load_model(tmp_path / "m.truearm").repeating_share_ == model.repeating_share_
    assert np.array_equal(load_model(tmp_path / "m.truearm").hysteresis_, model.hysteresis_)
    model.repeating_share_ = 1.5
    with pytest.raises(ProgramFault, match="share of 0 to 1"):
        model.save(tmp_path / "wrong.truearm")
