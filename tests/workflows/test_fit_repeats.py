"""Laws of a fit to poses that are read several times: as one reading each, and it says so."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta

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
