"""Laws of a fit to rounded angles: what rounding does to the tip is no error of the arm, and it is said."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.identification.references.prepared_readings import tip_motion_mm, tip_motions

STEP = np.radians(0.1)
POSES, TESTED = 80, 100


@pytest.fixture(scope="module")
def simulation():
    return ta.simulate("ur5", poses=POSES + TESTED, seed=7, strategy="uniform", preset="shop")


@pytest.fixture(scope="module")
def exact(simulation):
    return simulation.session.rows(slice(0, POSES))


@pytest.fixture(scope="module")
def test_readings(simulation):
    return simulation.session.rows(slice(POSES, None)), simulation.measurement.true_tips[POSES:]


def rounded(session):
    return replace(session, angles=STEP * np.round(session.angles / STEP))


def fitted(session):
    return ta.fit("ur5", session, model="kinematic")


def error(model, test_readings):
    readings, tips = test_readings
    return float(np.linalg.norm(model.predict_readings(readings) - tips, axis=1).mean())


@pytest.fixture(scope="module")
def of_rounded(exact):
    return fitted(rounded(exact))


def test_tips_move_by_the_derivatives():
    chain = ta.load_arm("ur5").chain
    angles = np.random.default_rng(1).uniform(-1, 1, (5, 6))
    std = np.array([1e-4, 2e-4, 0, 0, 1e-4, 3e-4])
    jacobian = np.stack([(chain.tip_in_base(angles + 1e-6 * e) - chain.tip_in_base(angles)) / 1e-6 for e in np.eye(6)])
    np.testing.assert_allclose(tip_motions(chain, angles, std), std[:, None, None] * jacobian, atol=1e-4)
    variance = (std[:, None, None] * jacobian) ** 2
    assert tip_motion_mm(chain, angles, std) == pytest.approx(np.sqrt(variance.sum(axis=(0, 2)).mean()), rel=1e-3)


def test_it_is_as_good_as_with_the_uncertainty_stated(exact, of_rounded, test_readings):
    chain = ta.load_arm("ur5").chain
    std = np.sqrt((tip_motions(chain, exact.angles, np.full(6, STEP / np.sqrt(12))) ** 2).sum(axis=0))
    stated = fitted(replace(rounded(exact), point_std=np.hypot(std, 0.001)))
    assert error(of_rounded.model, test_readings) < 1.2 * error(stated.model, test_readings)
    assert of_rounded.model.residual_std_ < 0.02  # not the 0.25 mm a coordinate by rounding
    assert "rounded to 0.1 deg: that alone moves the tip by 0.4" in " ".join(of_rounded.remarks)


def test_the_tips_of_exact_and_of_rounded_angles_are_in_their_ellipsoids(of_rounded, test_readings, tmp_path):
    readings, tips = test_readings
    of_rounded.save(tmp_path / "arm.truearm")
    for model in (of_rounded.model, ta.load_model(tmp_path / "arm.truearm")):
        u = []
        for used in (readings, rounded(readings)):
            points, covariance = model.predict_readings(used, return_cov=True)
            off = points - tips
            squares = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0])
            assert (squares < 7.815).mean() > 0.85  # chi-square of three, 95 %; errors of one arm are correlated
            u.append(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3))
        assert u[1] > u[0] + 0.1
    assert "rounding of the angles" in of_rounded.model.unstated_input_covariances(rounded(readings))


def test_angles_of_a_plan_that_the_arm_took_exactly_are_exact(simulation, exact, test_readings):
    """Few digits alone are no rounding."""
    angles = STEP * np.round(exact.angles / STEP)
    planned = replace(simulation.virtual.measure(angles, seed=7).readings, angles=angles)
    result = fitted(planned)
    assert error(result.model, test_readings) < 1.2 * error(fitted(exact).model, test_readings)
    assert "treats them as exact" in " ".join(result.remarks)
    assert result.model.training_.angle_std is None


def test_digits_of_a_good_encoder_change_nothing(exact):
    """0.0001 degrees move the tip by less than any instrument sees."""
    fine = replace(exact, angles=np.radians(np.round(np.degrees(exact.angles), 4)))
    result = fitted(fine)
    assert not any("deg" in remark for remark in result.remarks)
    assert result.model.training_.angle_std is None


def test_where_noise_hides_it_angles_count_as_rounded_and_it_is_said(exact):
    rough = rounded(exact)
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0, 2.0, rough.points.shape)
        result = ta.fit("ur5", ta.Session(rough.angles, points=rough.points + noise), model="nominal")
        assert result.model.training_.angle_std is not None
        assert "they do not show whether it did" in " ".join(result.remarks)


def test_rounding_is_no_stated_uncertainty(exact):
    noisy = rounded(exact).points + np.random.default_rng(1).normal(0, 2.0, (POSES, 3))
    result = fitted(ta.Session(rounded(exact).angles, points=noisy))
    said = " ".join(result.remarks)
    assert "These readings scatter by" in said
    assert "stated uncertainty" not in said


def test_a_weighted_fit_knows_of_the_rounding(exact):
    session, weight = rounded(exact), np.where(np.arange(POSES) % 2, 1.0, 0.5)
    model = ta.NominalModel(ta.load_arm("ur5")).fit(session.angles, session.points, sample_weight=weight)
    assert model.training_.angle_std is not None
