"""A model's arm in a new set-up: what changes, what stays, what is refused, and what the model file remembers."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from refusals import refuses
from truearm.errors import InputError
from truearm.identification.judgement.outliers import outliers
from truearm.identification.terms import Constant
from truearm.models import KinematicModel, NetworkModel, NominalModel, PhysicalModel
from truearm.models.model_file import load_model
from truearm.models.refit import refit
from truearm.readings import Session, read_session, write_session

TURN = Rotation.from_rotvec([0.4, -2.0, 1.0]).as_matrix()
SHIFT = np.array([1500.0, -700.0, 300.0])  # mm
NOISE = 0.02  # mm, that of `real`


def elsewhere(real, n, rng, *, tip=(0.0, 0.0, 0.0), **more):
    """Readings of the same arm from another place, with another tip."""
    angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (n, 6))
    tips = real.chain.with_tip(real.chain.tip_in_flange + np.array(tip)).tip_in_base(angles)
    return Session(angles, tips @ TURN.T + SHIFT + rng.normal(0, NOISE, (n, 3)), **more)


@pytest.fixture(scope="module")
def fitted(real):
    """A kinematic model from 80 readings, its tip and base free."""
    return KinematicModel(real.arm).fit_readings(real.points(80, np.random.default_rng(1)))


def coverage(model, test):
    points, covariance = model.predict_readings(test, return_cov=True)
    off = points - test.points
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    return (squares < chi2.ppf(0.95, 3)).mean()


def test_ten_readings_take_the_arm_to_another_tracker_and_probe(real, fitted):
    rng = np.random.default_rng(2)
    taken, test = (elsewhere(real, n, rng, tip=(30, -20, 120)) for n in (10, 300))
    points = fitted.predict(test.angles)
    new = refit(fitted, taken)
    assert type(new) is KinematicModel
    np.testing.assert_array_equal(fitted.predict(test.angles), points)  # it stays as it was
    off = new.predict(test.angles) - test.points
    # The noise of 0.02 mm in the test points, and some of it in the frame; the same poses were 0.5 mm off as drawn.
    assert np.sqrt((off**2).mean()) < 1.6 * NOISE
    assert coverage(new, test) > 0.9
    # The arm is the old one.
    assert new.n_train_ == 80
    assert 1 <= new.residual_std_ / fitted.residual_std_ < 1.4  # 21 degrees of freedom: 15 %
    np.testing.assert_array_equal(new.angle_ranges_, fitted.angle_ranges_)
    chains = [one.fit_.perturbed_chain for one in (fitted, new)]
    old, found = (
        {
            term.name: tuple(one.fit_.coefficients[columns])
            for term, columns in zip(chain.terms, chain.columns, strict=True)
            if isinstance(term.basis, Constant)
        }
        for one, chain in zip((fitted, new), chains, strict=True)
    )
    # It moved towards the readings, by less than its uncertainty.
    assert set(found) == set(old)
    chain, known = chains[0], fitted.fit_
    off = np.array([found[name][0] - old[name][0] for name in old if not name.startswith(("base", "tip"))])
    at = [c[0] for t, c in zip(chain.terms, chain.columns, strict=True) if t.name in old and t.place not in (0, 7)]
    assert off.any()
    assert (np.abs(off) < 2 * np.sqrt(known.covariance.diagonal()[at]) + 0.2 * known.prior_std[at]).all()
    assert len(new.held_out_.rows) == 0
    assert new.free_ == ("base", "tip")
    # The nominal arm is the drawing in the new place.
    nominal = np.linalg.norm(new.predict_nominal(test.angles) - test.points, axis=1).mean()
    assert 0.2 < nominal < 3


def test_uncertainty_grows_as_readings_get_fewer(real, fitted):
    rng = np.random.default_rng(3)
    test, taken = elsewhere(real, 100, rng), elsewhere(real, 40, rng)
    sizes = [np.trace(refit(fitted, taken.rows(slice(n))).covariance_parts(test)[0], axis1=1, axis2=2).mean()
             for n in (4, 8, 40)]  # fmt: skip
    assert sizes[0] > sizes[1] > sizes[2]


def test_only_the_base_or_only_the_tip(real, fitted):
    rng = np.random.default_rng(4)
    moved = refit(fitted, elsewhere(real, 10, rng), free=("base",))
    tip, at = (
        [c[0] for t, c in zip(fit.perturbed_chain.terms, fit.perturbed_chain.columns, strict=True) if t.place == 7]
        for fit in (fitted.fit_, moved.fit_)
    )
    off = moved.fit_.coefficients[at] - fitted.fit_.coefficients[tip]
    # It stays where it is known to be.
    assert (np.abs(off) < 2 * np.sqrt(fitted.fit_.covariance.diagonal()[tip])).all()
    longer = real.chain.with_tip(real.chain.tip_in_flange + [0, 0, 5.0])
    angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (10, 6))
    probe = refit(fitted, Session(angles, longer.tip_in_base(angles)), free=("tip",))
    np.testing.assert_allclose(probe.predict(angles), longer.tip_in_base(angles), rtol=0, atol=5 * NOISE)
    assert probe.free_ == ("tip",)


def test_without_points_the_base_stays(real):
    """Seats and a new probe: here the arm was fitted in its own frame."""
    rng = np.random.default_rng(5)
    fitted = KinematicModel(real.arm, free=("tip",)).fit_readings(real.points(80, rng))
    held = real.held(rng)
    new = refit(fitted, held, lengths=real.lengths())
    assert new.free_ == ("tip",)
    centres = [new.predict_readings(held)[held.seat == name].mean(axis=0) for name in ("S1", "S2", "S3")]
    np.testing.assert_allclose(centres, real.seats, rtol=0, atol=5 * NOISE)
    refuses("the position of the base needs reference points", refit, fitted, held, free=("base",))


def test_an_arm_known_from_seats_comes_before_a_tracker(real):
    """Identified without an instrument, in a frame of its own, the arm then finds its place from a few points."""
    rng = np.random.default_rng(14)
    fitted = KinematicModel(real.arm).fit_readings(real.held(rng), lengths=real.lengths())
    new = refit(fitted, elsewhere(real, 10, rng))
    assert new.free_ == ("base", "tip")
    # Other readings in the seats: 60 of 0.01 mm know the arm there to hundredths of a millimetre.
    test = real.held(rng)
    truth = real.chain.tip_in_base(test.angles) @ TURN.T + SHIFT
    assert np.linalg.norm(new.predict_readings(test) - truth, axis=1).mean() < 0.3


@pytest.mark.parametrize(
    ("kind", "free"),
    [
        (kind, free) if (i - j) % 3 == 0 else pytest.param(kind, free, marks=pytest.mark.weekly)
        for i, kind in enumerate((NominalModel, KinematicModel, PhysicalModel))
        for j, free in enumerate(((), ("base",), ("base", "tip")))
    ],
)
def test_every_model_whatever_was_free_in_it(real, kind, free):
    rng = np.random.default_rng(6)
    model = kind(real.arm, free=free, **({"highest": 2} if kind is PhysicalModel else {}))
    model.fit_readings(real.points(60, rng))
    taken, test = elsewhere(real, 12, rng, tip=(0, 0, 3)), elsewhere(real, 60, rng, tip=(0, 0, 3))
    new = refit(model, taken)
    error = np.linalg.norm(new.predict(test.angles) - test.points, axis=1).mean()
    assert error < (3 if kind is NominalModel else 5 * NOISE)
    again = refit(new, taken)  # from itself: the same place
    np.testing.assert_allclose(again.predict(test.angles), new.predict(test.angles), rtol=0, atol=NOISE)


def test_noise_that_the_new_readings_do_not_bear_out_grows(real, fitted):
    rng = np.random.default_rng(7)
    taken = elsewhere(real, 20, rng)
    rough = Session(taken.angles, taken.points + rng.normal(0, 0.3, taken.points.shape))
    calm = Session(taken.angles, fitted.predict(taken.angles))
    assert refit(fitted, calm).residual_std_ == fitted.residual_std_
    # 51 degrees of freedom tell it to 10 %.
    assert refit(fitted, rough).residual_std_ == pytest.approx(0.3, rel=0.35)


def test_a_reading_far_off_is_named_and_counts_little(real, fitted):
    rng = np.random.default_rng(8)
    taken, test = elsewhere(real, 20, rng), elsewhere(real, 50, rng)
    clean = refit(fitted, taken).predict(test.angles)
    points = taken.points.copy()
    points[13] += [4.0, 4.0, -4.0]
    spoilt = refit(fitted, Session(taken.angles, points))
    assert [outlier.row for outlier in outliers(spoilt.fit_)] == [13]
    assert np.abs(spoilt.predict(test.angles) - clean).max() < 5 * NOISE


def test_stated_uncertainties_of_the_points_count(real, fitted):
    """Half the readings are stated as 1 mm uncertain, and off by as much: they hardly matter."""
    rng = np.random.default_rng(9)
    taken, test = elsewhere(real, 40, rng), elsewhere(real, 50, rng)
    poor = np.arange(40) % 2 == 1
    points = taken.points + poor[:, None] * rng.normal(0, 1.0, (40, 3))
    std = np.repeat(np.where(poor, 1.0, 1e-3)[:, None], 3, axis=1)
    stated = refit(fitted, Session(taken.angles, points, std))
    off = np.linalg.norm(stated.predict(test.angles) - test.points, axis=1).mean()
    assert off < 3 * NOISE
    assert stated.residual_std_ < 1.5 * fitted.residual_std_


def test_the_file_remembers_which_readings_served(real, fitted, tmp_path):
    rng = np.random.default_rng(10)
    session = elsewhere(real, 30, rng, position=np.array([f"P{i // 3}" for i in range(30)]))
    rows = np.array([2, 3, 11, 17, 28])
    new = refit(fitted, session.rows(rows))
    new.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    for model in (new, again):
        np.testing.assert_array_equal(np.flatnonzero(model.trained_on(session)), rows)
    np.testing.assert_array_equal(again.predict(session.angles), new.predict(session.angles))
    np.testing.assert_array_equal(again.covariance_parts(session)[0], new.covariance_parts(session)[0])
    # Written in degrees, angles come back with other last digits.
    write_session(session, tmp_path / "s.csv")
    back = read_session(tmp_path / "s.csv")
    assert (back.angles != session.angles).any()
    np.testing.assert_array_equal(np.flatnonzero(again.trained_on(back)), rows)
    assert not fitted.trained_on(session).any()
    assert not again.trained_on(elsewhere(real, 30, rng)).any()
    # Refitted once more, it still knows both.
    both = refit(again, session.rows(slice(20, 26)))
    assert both.trained_on(session).sum() == 5 + 6


def test_more_new_readings_than_there_were_of_old(real, tmp_path):
    """Rows of the new session are numbered beyond those that the arm was learned from."""
    rng = np.random.default_rng(11)
    fitted = KinematicModel(real.arm).fit_readings(real.points(30, rng))
    refit(fitted, elsewhere(real, 70, rng)).save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    assert again.training_.known.n_refit == 70
    assert again.trained_on(elsewhere(real, 70, np.random.default_rng(11))).sum() in (0, 70)


def test_temperature_and_loads_of_the_new_session(real):
    """Where readings to predict have none, those of the new session stand in."""
    rng = np.random.default_rng(12)
    cold = real.points(60, rng, temperature_degC=rng.uniform(18, 22, 60), columns={"load_2": rng.normal(size=60)})
    model = PhysicalModel(real.arm, highest=2).fit_readings(cold)
    new = refit(model, elsewhere(real, 10, rng, temperature_degC=np.full(10, 30.0)))
    assert new.training_.temperature_degC.mean == 30
    assert new.training_.columns == model.training_.columns
    new.predict(real.arm.working[None])


def test_what_cannot_be_refitted_is_refused(real, fitted):
    rng = np.random.default_rng(13)
    taken = elsewhere(real, 10, rng)
    network = NetworkModel(real.arm, hidden=(3,), epochs=3).fit_readings(real.points(60, rng))
    refuses("expected a nominal, kinematic or physical model, got a NetworkModel", refit, network, taken)
    refuses("expected 4 or more readings with a reference, got 3", refit, fitted, taken.rows(slice(3)))
    refuses("what to re-identify among", refit, fitted, taken, free=())
    refuses("what to re-identify among", refit, fitted, taken, free=("elbow",))
    refuses("readings of 6 joints .*, got 5", refit, fitted, Session(taken.angles[:, :5], taken.points))
    refuses("none", refit, fitted, Session(taken.angles))
    refuses("lengths are between seats", refit, fitted, taken, lengths=real.lengths())
    held = real.held(rng)
    points = np.full((60, 3), np.nan)  # in two seats only, so that all lie on a line
    points[held.seat == "S1"], points[held.seat == "S2"] = real.seats[:2]
    with pytest.raises(InputError, match="the 40 reference points lie within .* mm of a line"):
        refit(fitted, Session(held.angles, points, seat=held.seat))


def test_repeats_are_no_new_poses_and_none_of_them_is_a_test(real, fitted):
    rng = np.random.default_rng(12)
    once = elsewhere(real, 8, rng)
    five = once.rows(np.repeat(np.arange(8), 5))
    new, of_once = refit(fitted, five), refit(fitted, once)
    test = elsewhere(real, 20, rng)
    points, u = new.predict_readings(test, return_cov=True)
    points_once, u_once = of_once.predict_readings(test, return_cov=True)
    np.testing.assert_array_equal(points, points_once)
    np.testing.assert_array_equal(u, u_once)
    assert new.trained_on(five).all()
