"""Readings of several sessions: each has a frame of its own, metres and radians from the others."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.errors import InputError
from truearm.identification.references.session_frames import (
    checked_frames,
    covariances_to_session_frames,
    points_to_session_frames,
    rough_session_frames,
    to_first_session_frame,
)
from truearm.models import KinematicModel, NetworkModel, NominalModel, PhysicalModel
from truearm.models.model_file import load_model
from truearm.models.refit import refit
from truearm.readings import Session

NOISE = 0.02  # mm, as of `real`


def motion(turn, shift):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), shift
    return T


# May's tracker stands anywhere; in June it was moved a little, in July it stands behind the arm.
PLACES = {
    "May": motion([0.2, -0.1, 1.0], [900, -2000, 300]),
    "June": motion([0.2, -0.1, 1.03], [917, -2000, 300]),
    "July": motion([-1.5, 2.0, 0.4], [-3000, 1500, -800]),
}


def seen(real, angles, session, rng, noise=NOISE):
    points = np.empty((len(angles), 3))
    for name in np.unique(session):
        rows = session == name
        points[rows] = real.chain.with_reference_frame(PLACES[name]).tip_in_base(angles[rows])
    return Session(angles, points + rng.normal(0, noise, points.shape), session=session)


@pytest.fixture(scope="module")
def readings(real):
    rng = np.random.default_rng(11)
    session = np.repeat(["May", "June", "July"], [40, 30, 20])
    return seen(real, real.arm.working + 0.8 * rng.uniform(-1, 1, (90, 6)), session, rng)


@pytest.fixture(scope="module")
def model(real, readings):
    return KinematicModel(real.arm).fit_readings(readings)


@pytest.fixture(scope="module")
def asked(real):
    """Poses met in every session, without noise."""
    rng = np.random.default_rng(12)
    angles = np.tile(real.arm.working + 0.7 * rng.uniform(-1, 1, (60, 6)), (3, 1))
    return seen(real, angles, np.repeat(list(PLACES), 60), rng, noise=0.0)


def test_sessions_serve_one_arm_as_well_as_one_session_does(model):
    assert model.fit_.converged
    assert list(model.session_frames_) == ["May", "June", "July"]
    assert 0.8 * NOISE < model.residual_std_ < 1.3 * NOISE
    # Of 9 of the nominal arm, and six more for each further session.
    by_name = {group.name: group for group in model.fit_.groups}
    assert by_name["frames of further sessions"].n_coefficients == 12
    assert by_name["frames of further sessions"].effective == pytest.approx(12, abs=0.01)


@pytest.fixture(scope="module")
def rough(real):
    """Five sessions of ten readings, in poses where the encoders err by what no constant explains."""
    rng = np.random.default_rng(5)
    session = np.repeat([f"s{i}" for i in range(5)], 10)
    angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (50, 6))
    points = np.empty((50, 3))
    for name in np.unique(session):
        there = real.chain.with_reference_frame(motion(rng.normal(0, 0.3, 3), rng.normal(0, 500, 3)))
        rows = session == name
        points[rows] = there.tip_in_base(angles[rows] + 1e-4 * np.sin(3 * angles[rows]))
    return Session(angles, points + rng.normal(0, NOISE, (50, 3)), session=session)


def test_positions_that_are_all_or_most_of_a_session_leave_what_is_unexplained_as_it_is(real, rough):
    """Without its frame nothing tells where a session's readings are: they are held by any covariance."""
    alone = KinematicModel(real.arm).fit_readings(rough)
    whole = KinematicModel(real.arm).fit_readings(replace(rough, position=rough.session))
    assert whole.residual_std_ == pytest.approx(alone.residual_std_, rel=0.2)
    most = np.char.add(rough.session, np.where(np.arange(50) % 10 < 8, "x", "y"))
    found = KinematicModel(real.arm).fit_readings(replace(rough, position=most))
    assert found.residual_std_ == pytest.approx(alone.residual_std_, rel=0.2)
    # Eight of ten in one position: the other two do not tell a frame. These eight are held out, and that is known.
    known = np.sqrt(np.linalg.eigvalsh(found.held_out_.covariance)[:, -1])
    eight = np.char.endswith(most[found.held_out_.rows], "x")
    assert eight.any()
    assert 10 * known[~eight].max() < 100 * NOISE < known[eight].min()


def test_points_come_out_in_the_frame_of_their_session_with_a_right_uncertainty(model, asked):
    points, covariance = model.predict_readings(asked, return_cov=True)
    of_parameters, _ = model.covariance_parts(asked)
    off = points - asked.points
    for name in PLACES:
        rows = asked.session == name
        assert np.linalg.norm(off[rows], axis=1).mean() < 2 * NOISE
        # Squared lengths in units of the parameters' uncertainty have mean 3; errors of one fit go together.
        squares = np.einsum("ni,nij,nj->n", off[rows], np.linalg.inv(of_parameters[rows]), off[rows])
        assert 0.5 < squares.mean() < 9
    np.testing.assert_allclose(covariance, covariance.transpose(0, 2, 1), atol=1e-15)


def test_without_a_known_session_points_are_in_the_frame_of_the_first(model, asked):
    may = asked.session == "May"
    plain = model.predict(asked.angles[may])
    np.testing.assert_array_equal(plain, model.predict_readings(asked.rows(may)))
    unknown = replace(asked.rows(may), session=np.full(60, "August"))
    np.testing.assert_array_equal(plain, model.predict_readings(unknown))
    nominal = model.predict_nominal(asked.angles[may])
    np.testing.assert_array_equal(nominal, model.predict_nominal_readings(unknown))
    off = np.linalg.norm(model.predict_nominal_readings(asked) - asked.points, axis=1)
    assert all(off[asked.session == name].mean() < 2 for name in PLACES)  # mm; its constants are off by half of one


def test_the_uncertainty_turns_with_the_frame(model, asked):
    """The same pose in two sessions: July's covariance has what the frame of July adds, and turned axes."""
    _, covariance = model.predict_readings(asked, return_cov=True)
    frames = model.session_frames_
    july = asked.session == "July"
    turned = covariances_to_session_frames(covariance, np.full(180, "July"), frames)
    R = frames["July"][:3, :3]
    np.testing.assert_allclose(turned[0], R.T @ covariance[0] @ R, rtol=1e-12)
    np.testing.assert_allclose(np.trace(turned, axis1=1, axis2=2), np.trace(covariance, axis1=1, axis2=2), rtol=1e-12)
    assert np.trace(covariance[july], axis1=1, axis2=2).mean() > np.trace(covariance[:60], axis1=1, axis2=2).mean()


def test_a_model_file_keeps_the_frames(model, asked, tmp_path):
    model.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    assert list(again.session_frames_) == list(model.session_frames_)
    for one, other in zip(*(m.predict_readings(asked, return_cov=True) for m in (model, again)), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(model.predict_nominal_readings(asked), again.predict_nominal_readings(asked))


@pytest.mark.parametrize(
    ("names", "motions"),
    [
        (["May", "June"], np.stack([np.eye(4), 2 * np.eye(4)])),
        (["May", "June"], np.stack([PLACES["May"], np.eye(4)])),
        (["May", "May"], np.stack([np.eye(4), np.eye(4)])),
        (["May"], np.stack([np.eye(4), np.eye(4)])),
        (["May", "June"], np.eye(4)),
        (["May", "June"], np.full((2, 4, 4), np.nan)),
        (["May", "June"], np.stack([np.eye(4), motion([0, 0, 1], [1e30, 0, 0])])),
    ],
)
def test_frames_that_are_none_are_refused(names, motions):
    refuses(None, checked_frames, names, motions)


def test_what_is_carried_comes_back(readings, real):
    frames = rough_session_frames(real.arm, readings, ("base",))
    turned = Rotation.random(90, random_state=1).as_quat(scalar_first=True)
    whole = replace(readings, point_std=np.full((90, 3), [0.01, 0.02, 0.05]), quaternion=turned)
    there = to_first_session_frame(whole, frames)
    np.testing.assert_array_equal(there.points[:40], readings.points[:40])
    np.testing.assert_allclose(
        points_to_session_frames(there.points, readings.session, frames), readings.points, atol=1e-9
    )
    np.testing.assert_array_equal(there.point_std[:40], whole.point_std[:40])
    np.testing.assert_allclose((there.point_std**2).sum(axis=1), 0.01**2 + 0.02**2 + 0.05**2, rtol=1e-12)
    # An axis of the flange turns as a difference of points does.
    x = Rotation.from_quat(turned, scalar_first=True).apply([1.0, 0, 0])
    tips = to_first_session_frame(replace(whole, points=readings.points + x), frames).points - there.points
    np.testing.assert_allclose(
        Rotation.from_quat(there.quaternion, scalar_first=True).apply([1, 0, 0]), tips, atol=1e-9
    )
    # Rough frames: the nominal arm's constants are off by half a millimetre and a milliradian.
    exact = PLACES["May"] @ np.linalg.inv(PLACES["July"])
    np.testing.assert_allclose(frames["July"][:3, :3], exact[:3, :3], atol=0.01)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.weekly)])
def test_a_gross_error_in_a_session_of_few_points_leaves_its_frame_alone(real, seed):
    """One of six points off by a metre: a frame by all of them stands so far off that the fit goes astray."""
    rng = np.random.default_rng(seed)
    readings = seen(
        real, real.arm.working + 0.8 * rng.uniform(-1, 1, (46, 6)), np.repeat(["May", "July"], [40, 6]), rng
    )
    points = readings.points.copy()
    points[42] += [700.0, -700, 700]
    exact = PLACES["May"] @ np.linalg.inv(PLACES["July"])
    frames = rough_session_frames(real.arm, replace(readings, points=points), ("base", "tip"))
    np.testing.assert_allclose(frames["July"][:3, :3], exact[:3, :3], atol=0.02)
    found = KinematicModel(real.arm).fit_readings(replace(readings, points=points))
    asked = seen(real, real.arm.working + 0.7 * rng.uniform(-1, 1, (60, 6)), np.repeat("July", 60), rng, noise=0.0)
    assert np.linalg.norm(found.predict_readings(asked) - asked.points, axis=1).mean() < 10 * NOISE


def test_one_session_or_a_known_base_is_one_frame(readings, real):
    one = replace(readings, session=np.full(90, "May"))
    assert rough_session_frames(real.arm, one, ("base", "tip")) == {}
    assert rough_session_frames(real.arm, readings, ("tip",)) == {}
    assert rough_session_frames(real.arm, replace(readings, session=None), ("base",)) == {}
    held = Session(readings.angles, seat=np.repeat(["A", "B"], 45), session=readings.session)
    assert rough_session_frames(real.arm, held, ("base",)) == {}


def test_sessions_that_leave_a_frame_open_are_refused(readings, real):
    def refused(said, **changes):
        refuses(said, NominalModel(real.arm).fit_readings, replace(readings, **changes))

    refused(
        "reading 41, .*expected the session of every reading", session=np.where(readings.session == "June", "", "May")
    )
    few = readings.points.copy()
    few[72:] = np.nan
    refused("session 'July' has 2 reference points", points=few)
    line = readings.points.copy()
    line[70:] = np.arange(20)[:, None] * [1.0, 2.0, 3.0]
    refused("session 'July' has 20 reference points, too few or on a line", points=line)
    refused("seat 'A' is in session 'May' and in session 'June'", seat=np.full(90, "A"))
    refuses("of 3 sessions.*a network learns one", NetworkModel(real.arm, hidden=(3,), epochs=1).fit_readings, readings)


def test_a_refit_forgets_the_frames_with_the_base_and_keeps_them_with_the_tip(model, readings, real, rng):
    refuses("refit identifies one frame", refit, model, readings)
    july = readings.rows(readings.session == "July")
    new = refit(model, replace(july, session=np.full(20, "August")))
    assert new.session_frames_ == {}
    off = np.linalg.norm(new.predict_readings(july) - july.points, axis=1)
    assert off.mean() < 3 * NOISE
    probe = refit(model, readings.rows(np.r_[0:10, 70:90]), free=("tip",))
    assert probe.session_frames_ is model.session_frames_
    for session, said in (("August", "point of session 'August'"), ("", "without a session")):
        with pytest.raises(InputError, match=f"sessions of the model .May, June, July., got.*{said}") as caught:
            refit(model, replace(july, session=np.full(20, session)), free=("tip",))
        assert "--free base,tip" in caught.value.hint
    refuses("without a session", refit, model, replace(july, session=None), free=("tip",))
    assert np.linalg.norm(probe.predict_readings(readings) - readings.points, axis=1).mean() < 3 * NOISE


def test_a_place_in_two_sessions_is_learned_from_nowhere(real):
    """The base moved between them, which nothing shows where no reference saw both."""
    held = real.held(np.random.default_rng(3))
    session = np.where(np.arange(len(held)) % 2, "May", "June")
    apart = np.where(held.seat == "S1", "May", "June")
    points = np.where((session == "May")[:, None], real.chain.tip_in_base(held.angles), np.nan)
    arm = KinematicModel(real.arm).fit_readings(real.held(np.random.default_rng(4)), lengths=real.lengths())
    for more in ({}, {"points": points}):
        readings = replace(held, session=session, **more)
        lone = replace(held, session=apart, **more)
        for learn in (KinematicModel(real.arm).fit_readings, partial(refit, arm)):
            refuses("seat 'S.' is in session .*, but the base", learn, readings)
            with pytest.raises(
                InputError, match="length 1, .*seat 'S1' is in session 'May', seat 'S2' is in session 'J"
            ):
                learn(lone, lengths=real.lengths())
    # In the arm's own frame the base stood where the points say.
    found = KinematicModel(real.arm, free=("tip",)).fit_readings(
        replace(held, session=session, points=real.chain.tip_in_base(held.angles))
    )
    assert found.session_frames_ == {}
    # Without points nothing says that it did.
    with pytest.raises(InputError, match="seat 'S.' is in session"):
        KinematicModel(real.arm, free=("tip",)).fit_readings(replace(held, session=session))


def test_physical_terms_do_not_mind_sessions(readings, real):
    found = PhysicalModel(real.arm, highest=1).fit_readings(readings)
    assert found.residual_std_ < 1.5 * NOISE
