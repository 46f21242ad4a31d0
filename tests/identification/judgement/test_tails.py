"""Ellipsoids hold what they say beyond 95 %, also where errors have tails."""

import json
import zipfile

import numpy as np
import pytest
from scipy.stats import chi2

from refusals import refuses
from truearm.arm import load_arm
from truearm.identification.estimation.residual_variance import HeldOutReadings, conformal_residual_variance
from truearm.identification.judgement.tails import ellipsoid_factor, tail_freedom
from truearm.models import KinematicModel, load_model
from truearm.wings.planning.virtual import VirtualArm, load_preset


def held_out(rng, n, freedom):
    """Deviations of Student's distribution about covariances that explain a tenth of them."""
    deviations = rng.normal(size=(n, 3)) / np.sqrt(rng.chisquare(freedom, n) / freedom)[:, None]
    rows = np.arange(n)
    return HeldOutReadings(rows, rows, deviations, np.tile(0.1 * np.eye(3), (n, 1, 1)), np.ones(n))


@pytest.mark.parametrize("freedom", [2.0, 4.0, 30.0, 1000.0, np.inf])
def test_at_95_percent_the_factor_is_that_of_gaussian_errors(freedom):
    assert ellipsoid_factor(0.95, freedom=freedom) == pytest.approx(np.sqrt(chi2.ppf(0.95, 3)), rel=1e-12)


def test_the_factor_grows_with_level_and_tails():
    """By the tables: chi-square 11.345 at 99 %; F(3, 4) 16.694 at 99 % and 6.591 at 95 %, chi-square 7.815 at 95 %."""
    assert ellipsoid_factor(0.99, freedom=np.inf) == pytest.approx(np.sqrt(11.345), abs=1e-4)
    assert ellipsoid_factor(0.99, freedom=4) == pytest.approx(np.sqrt(7.815 * 16.694 / 6.591), abs=1e-3)
    assert ellipsoid_factor(0.99, freedom=1e3) == pytest.approx(ellipsoid_factor(0.99, freedom=np.inf), rel=2e-3)
    factors = [ellipsoid_factor(0.99, freedom=nu) for nu in (2.0, 3.0, 5.0, 10.0, 100.0)]
    assert factors == sorted(factors, reverse=True)
    inside = [ellipsoid_factor(0.9, freedom=nu) for nu in (2.0, 3.0, 5.0, 10.0, 100.0)]
    assert inside == sorted(inside)


@pytest.mark.parametrize("level", [95, 1.0, 0.0, -0.5, float("nan")])
@pytest.mark.parametrize("freedom", [4.0, np.inf])
def test_a_level_is_a_share(level, freedom):
    assert "0.95" in refuses("level between 0 and 1", ellipsoid_factor, level, freedom=freedom).hint


@pytest.mark.parametrize("freedom", [4.0, 8.0, 1e6])
def test_ellipsoids_of_99_percent_contain_as_much(freedom):
    """Of 20000 new readings with a standard error of 0.07 %; 1000 held-out ones determine the tails to some 0.4 %."""
    rng = np.random.default_rng(11)
    training = held_out(rng, 2000, freedom)
    variance = conformal_residual_variance(training)
    factor = ellipsoid_factor(0.99, freedom=tail_freedom(training, variance))
    new = held_out(rng, 20000, freedom).deviations
    squares = (new**2).sum(axis=1) / (variance + 0.1)
    assert 0.985 < (squares < factor**2).mean() < 0.995


def test_without_deviations_beyond_95_percent_the_prior_decides():
    readings = held_out(np.random.default_rng(1), 15, 1e6)
    assert tail_freedom(readings, 1e6) == pytest.approx(20, rel=1e-3)


def test_tails_are_kept_in_the_file_and_files_without_them_are_gaussian(tmp_path):
    arm = load_arm("gao2017")
    rng = np.random.default_rng(3)
    session = VirtualArm.draw(arm, load_preset("shop"), seed=1)
    readings = session.measure(arm.working + rng.uniform(-0.5, 0.5, (40, 6)), seed=1).readings
    model = KinematicModel(arm).fit_readings(readings)
    assert 2 <= model.tail_freedom_ < np.inf
    model.save(tmp_path / "arm.truearm")
    read = load_model(tmp_path / "arm.truearm")
    assert read.ellipsoid_factor(0.99) == model.ellipsoid_factor(0.99) > np.sqrt(chi2.ppf(0.99, 3))
    for name, change in (("bad", {"tail_freedom_": 1.0}), ("before", {})):
        with zipfile.ZipFile(tmp_path / "arm.truearm") as archive:
            files = {entry: archive.read(entry) for entry in archive.namelist()}
        header = json.loads(files["model.json"])
        del header["learned"]["tail_freedom_"]
        header["learned"] |= change
        files["model.json"] = json.dumps(header).encode()
        with zipfile.ZipFile(tmp_path / f"{name}.truearm", "w") as archive:
            for entry, data in files.items():
                archive.writestr(entry, data)
    refuses("degrees of freedom of the tails", load_model, tmp_path / "bad.truearm")
    assert load_model(tmp_path / "before.truearm").ellipsoid_factor(0.99) == pytest.approx(np.sqrt(chi2.ppf(0.99, 3)))
