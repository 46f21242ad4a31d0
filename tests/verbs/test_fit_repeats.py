"""Laws of a fit to poses that are read several times: as one reading each, and it says so."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.readings.repeats import merge_repeats

POSES, TIMES = 60, 3


@pytest.fixture(scope="module")
def poses():
    """Readings of a UR5, each once, that scatter by 0.05 mm."""
    session = ta.simulate("ur5", poses=POSES, seed=4).session
    noise = np.random.default_rng(4).normal(0, 0.05, (POSES, 3))
    return ta.Session(session.angles, points=session.points + noise)


def repeated(poses, within):
    """Each of them three times, agreeing within so many mm."""
    several = poses.rows(np.repeat(np.arange(POSES), TIMES))
    noise = within * np.random.default_rng(5).normal(size=(POSES * TIMES, 3))
    return ta.Session(several.angles, points=several.points + noise)


def fitted(session, **options):
    return ta.fit("ur5", session, model="kinematic", **options)


@pytest.mark.parametrize("names_position", [False, True])
def test_repeats_are_as_their_means(poses, names_position):
    session = repeated(poses, 0.001)
    if names_position:
        session = replace(session, position=np.repeat([f"P{i}" for i in range(POSES)], TIMES))
    mean = ta.Session(poses.angles, points=session.points.reshape(POSES, TIMES, 3).mean(axis=1))
    result, of_means = fitted(session), fitted(mean)
    np.testing.assert_allclose(result.model.predict(poses.angles), of_means.model.predict(poses.angles), atol=1e-7)
    assert result.held_out_mm == pytest.approx(of_means.held_out_mm, rel=1e-6)
    assert not result.outliers
    facts = result.to_dict()
    assert (facts["n_readings"], facts["n_poses"]) == (POSES * TIMES, POSES)
    assert "180 readings, repeats merged into 60" in result.summary()
    assert "180 readings are 60 poses read 3 times; each counts as one" in " ".join(result.remarks)
    assert "repeats scatter by 0.00095 mm, the poses by 0.05" in " ".join(result.remarks)


@pytest.fixture(scope="module", params=[1, 4])
def noisy_model(request):
    """Of poses read so many times, each reading with 1 mm of noise in a coordinate."""
    return ta.fit("ur5", noisy(300, request.param, seed=1), model="nominal").model


def noisy(n_poses, times, *, seed):
    rng, chain = np.random.default_rng(seed), ta.load_arm("ur5").chain
    angles = np.repeat(rng.uniform(-1.5, 1.5, (n_poses, 6)), times, axis=0)
    return ta.Session(angles, points=chain.tip_in_base(angles) + rng.normal(size=(len(angles), 3)))


@pytest.mark.parametrize("times", [1, 4, 10])
def test_single_readings_and_means_lie_in_their_own_ellipsoids(noisy_model, times):
    """The noise of one reading is stated as what it is, however often the poses of training and test were read."""
    evaluation = ta.evaluate(noisy_model, noisy(400, times, seed=2))
    assert evaluation.errors["model"]["n"] == 400
    assert 0.93 < evaluation.coverage < 0.97  # of 400 a binomial standard deviation is 0.011
    assert evaluation.budget.unexplained_mm == pytest.approx(1 / np.sqrt(times), rel=0.1)  # of 300 poses 4 %


def test_the_model_states_the_noise_of_one_reading(noisy_model):
    """Also the uncertainty that `predict` states, whoever read the poses of the training several times."""
    noise = noisy_model.residual_std_ * np.sqrt(1 - noisy_model.repeating_share_)
    assert (noisy_model.residual_std_, noise) == (pytest.approx(1.0, rel=0.1), pytest.approx(1.0, rel=0.1))


def test_a_refit_to_means_keeps_the_noise_of_one_reading(noisy_model):
    new = ta.refit(noisy_model, noisy(30, 10, seed=3)).model
    assert new.residual_std_ == pytest.approx(noisy_model.residual_std_, rel=0.1)
    assert 0.9 < ta.evaluate(new, noisy(100, 10, seed=4)).coverage <= 1.0  # of 100: 0.95 less two of 0.022


def test_a_stated_uncertainty_of_a_reading_is_no_noise_of_the_arm():
    several = noisy(60, 4, seed=5)
    stated = replace(several, point_std=np.ones((240, 3)))
    model = ta.fit("ur5", stated, model="nominal").model
    assert model.residual_std_ < 0.4  # mm of 1 mm, which is the instrument's
    assert ta.evaluate(model, replace(noisy(200, 1, seed=6), point_std=np.ones((200, 3)))).coverage > 0.93


def test_copies_average_no_noise(noisy_model):
    once = noisy(50, 1, seed=7)
    twice, single = ta.evaluate(noisy_model, once.rows(np.repeat(np.arange(50), 2))), ta.evaluate(noisy_model, once)
    assert twice.coverage == single.coverage


def test_networks_state_the_noise_of_one_reading():
    several = noisy(100, 4, seed=8)
    for model in (
        ta.NetworkModel(ta.load_arm("ur5"), hidden=(3,), epochs=5),
        ta.HybridModel(ta.load_arm("ur5"), hidden=(2,), epochs=2),
    ):
        model.fit_readings(several)
        single, mean = (
            np.trace(model.covariance_parts(one)[1], axis1=1, axis2=2).mean() / 3
            for one in (several, merge_repeats(several).readings)
        )
        assert single - mean == pytest.approx(0.75, rel=0.1)  # mm^2, of 300 degrees of freedom in each coordinate


def test_copies_are_merged_with_a_word(poses):
    result, once = fitted(repeated(poses, 0.0)), fitted(poses)
    np.testing.assert_array_equal(result.model.predict(poses.angles), once.model.predict(poses.angles))
    assert "agree to the last digit, as copies do" in " ".join(result.remarks)
    assert not any("times" in remark for remark in once.remarks)


def test_one_slip_among_repeats_is_named_by_its_line(poses):
    session = repeated(poses, 0.001)
    points = session.points.copy()
    points[100] += 3.0
    result = fitted(ta.Session(session.angles, points=points))
    assert [(one.name, one.is_excluded) for one in result.outliers] == [("reading 101", True)]


def test_a_model_learns_from_the_same_whether_fitted_by_verb_or_by_method(poses):
    session = repeated(poses, 0.001)
    model = ta.KinematicModel(ta.load_arm("ur5")).fit_readings(session)
    np.testing.assert_array_equal(model.predict(poses.angles), fitted(session).model.predict(poses.angles))
    assert len(model.held_out_.rows) == POSES


def test_thirty_readings_of_three_poses_are_three_poses(poses):
    with pytest.raises(ta.InputError, match=r"at least 4 poses, got 3 poses \(30 readings repeat them\)"):
        fitted(poses.rows(np.repeat(np.arange(3), 10)))


def test_rounds_between_which_something_moved_are_said_to_be_kept_apart(poses):
    two = poses.rows(np.tile(np.arange(POSES), 2))
    points = two.points + np.array([0.5, 0, 0]) * (np.arange(2 * POSES) >= POSES)[:, None]
    result = ta.fit("ur5", ta.Session(two.angles, points=points), model="nominal")
    assert "60 poses were read again in a later round and not merged" in " ".join(result.remarks)
    assert len(result.frame_changes) == 1
