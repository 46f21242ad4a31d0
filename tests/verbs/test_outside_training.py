"""Outside the trained range u contains what a drawing is wrong by, and the likely mistake is said first."""

import numpy as np
import pytest

import truearm as ta


@pytest.fixture(scope="module", params=["kinematic", "physical"])
def model(request, ur10_session, ur10_model):
    if request.param == "kinematic":
        return ur10_model
    return ta.fit("ur10", ur10_session, model="physical", highest=4).model


def with_sign(angles, joint):
    return np.where(np.arange(6) == joint - 1, -1, 1) * angles


MISTAKES = {
    "if the angles were in rad": np.radians,
    "if J2 turned the other way": lambda q: with_sign(q, 2),
    "if J2 and J3 were exchanged": lambda q: q[:, [0, 2, 1, 3, 4, 5]],
    "if the joints were in reverse order": lambda q: q[:, ::-1],
    "if the last joint came first": lambda q: np.roll(q, -1, axis=1),
}


@pytest.mark.parametrize("said", MISTAKES)
def test_the_likely_mistake_is_the_first_sentence(model, ur10_session, said):
    first = next(iter(ta.predict(model, ta.Session(MISTAKES[said](ur10_session.angles))).blocks()))
    assert "of 60 poses are outside the trained range" in first
    assert said in first


@pytest.mark.parametrize("said", sorted(MISTAKES.keys() - {"if J2 and J3 were exchanged"}))
def test_the_uncertainty_far_outside_is_at_least_the_error_of_the_nominal_arm(model, ur10_session, said):
    """Of a coordinate in the median: the mean distance over sqrt(3). Exchanged, each joint is near its range."""
    prediction = ta.predict(model, ta.Session(MISTAKES[said](ur10_session.angles)))
    assert np.median(prediction.u_mm) > model.nominal_error() / np.sqrt(3)


def test_poses_as_in_the_training_are_not_doubted(model, ur10_session):
    again = ta.simulate("ur10", poses=60, seed=5).session
    prediction = ta.predict(model, ta.Session(again.angles))
    assert "would be inside" not in str(prediction)
    # As sure as a model is that leaves 0.01 mm.
    assert np.median(prediction.u_mm) < 0.2 * model.nominal_error()


def test_a_step_outside_is_not_a_stride(model, ur10_session):
    """A tenth of a radian outside the readings show how the variance grows; the error of a drawing is not added."""
    beyond = ur10_session.angles.copy()
    beyond[:, 1] = ur10_session.angles[:, 1].max() + 0.1
    prediction = ta.predict(model, ta.Session(beyond))
    assert prediction.outside_training.all()
    assert np.median(prediction.u_mm) < 0.5 * model.nominal_error()


def test_nothing_else_puts_them_inside(model, ur10_session):
    angles = ur10_session.angles.copy()
    angles[:, 4] += np.pi / 2
    angles[:, 1] += 0.7
    assert "poses are outside the trained range: the model was not fitted to such poses" in str(
        ta.predict(model, ta.Session(angles))
    )
