"""An uncertain scale of the reference is one error of all points: covariances and distances have it as such."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.models import KinematicModel, NominalModel, load_model

N, PPM = 60, 1e-6


@pytest.fixture(scope="module")
def readings(real):
    return real.points(N, np.random.default_rng(21))


@pytest.fixture(scope="module")
def plain(real, readings):
    return KinematicModel(real.arm).fit_readings(readings)


@pytest.fixture(scope="module")
def scaled(real, readings):
    return KinematicModel(real.arm).fit_readings(replace(readings, u_scale_ppm=np.full(N, 50.0)))


def test_points_have_the_error_of_the_scale_about_their_mean(plain, scaled, readings):
    """``u^2 (p - c)(p - c)^T``, and the points themselves are the same."""
    points, covariance = scaled.predict_readings(readings, return_cov=True)
    np.testing.assert_allclose(points, plain.predict_readings(readings), atol=1e-12)
    added = covariance - plain.predict_readings(readings, return_cov=True)[1]
    off = 50 * PPM * (readings.points - readings.points.mean(axis=0))
    expected = np.einsum("ni,nj->nij", off, off)
    np.testing.assert_allclose(added, expected, atol=0.02 * np.abs(expected).max())


def test_it_is_the_change_of_an_arm_identified_from_scaled_points(real, plain, scaled, readings):
    centre = readings.points.mean(axis=0)
    larger = replace(readings, points=centre + (1 + 50 * PPM) * (readings.points - centre))
    moved = KinematicModel(real.arm).fit_readings(larger).predict_readings(readings) - plain.predict_readings(readings)
    added = scaled.covariance_parts(readings)[0] - plain.covariance_parts(readings)[0]
    # To first order; scales of the priors and weights hardly change.
    np.testing.assert_allclose(np.einsum("ni,nj->nij", moved, moved), added, atol=0.03 * np.abs(added).max())


def test_distances_have_it_once(plain, scaled, readings):
    """It is the same error at both ends: 50e-6 of the distance, not of the coordinates."""
    ends = [np.argmin(readings.points[:, 0]), np.argmax(readings.points[:, 0])]
    state = scaled.state(readings.rows(ends))
    ((_, tips, columns),) = scaled.fit_.perturbed_chain.derivatives(state, scaled.fit_.coefficients)
    apart = tips[:, 1] - tips[:, 0]
    direction = (columns[:, :, 1] - columns[:, :, 0]) @ apart / np.linalg.norm(apart)
    added = direction @ (scaled.fit_.covariance - plain.fit_.covariance) @ direction
    assert np.sqrt(added) == pytest.approx(50 * PPM * np.linalg.norm(apart), rel=0.02)


def test_held_out_readings_share_it_and_do_not_count_it(plain, scaled):
    assert scaled.residual_std_ == pytest.approx(plain.residual_std_, rel=1e-9)
    assert scaled.birge_ratio_ == pytest.approx(plain.birge_ratio_, rel=1e-9)


def test_a_nominal_arm_keeps_its_size(real, readings):
    """Base and tip can follow only a part of a scale."""
    stated = replace(readings, u_scale_ppm=np.full(N, 50.0))
    added = np.subtract(
        *(NominalModel(real.arm).fit_readings(one).covariance_parts(readings)[0] for one in (stated, readings))
    )
    off = 50 * PPM * (readings.points - readings.points.mean(axis=0))
    assert 0 < np.trace(added, axis1=1, axis2=2).mean() < (off**2).sum(axis=1).mean()


def test_it_is_kept_in_the_file(scaled, readings, tmp_path):
    scaled.save(tmp_path / "arm")
    again = load_model(tmp_path / "arm").predict_readings(readings, return_cov=True)[1]
    np.testing.assert_array_equal(again, scaled.predict_readings(readings, return_cov=True)[1])


def test_repeats_of_a_position_do_not_average_a_common_error(real):
    """30 positions, six times each: as uncertain as one reading of each, not a sixth of its variance."""
    rng = np.random.default_rng(22)
    once = real.points(30, rng)
    common = rng.normal(0, 0.05, (30, 3))
    once = replace(once, points=once.points + common)
    rows = np.repeat(np.arange(30), 6)
    points = once.points[rows] + rng.normal(0, 0.002, (180, 3))
    many = replace(once.rows(rows), points=points, position=np.array([f"P{i}" for i in rows]))
    models = [
        KinematicModel(real.arm).fit_readings(one)
        for one in (once, many, replace(many, u_common_mm=np.full(180, 0.05)))
    ]
    single, untold, told = (np.sqrt(np.trace(m.covariance_parts(once)[0], axis1=1, axis2=2).mean()) for m in models)
    # Repeats of one pose are known as such; readings of one position in other poses need to be told.
    assert untold == pytest.approx(single, rel=0.25)
    assert told == pytest.approx(single, rel=0.25)
