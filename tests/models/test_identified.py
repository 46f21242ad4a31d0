"""Models of identified terms: what they recover, what they hold out, how sure they are, what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from refusals import refuses
from truearm.acceptance import accepting
from truearm.arm import load_arm
from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.references.alignment import align
from truearm.identification.references.cross_validation_groups import cross_validation_groups
from truearm.identification.terms import Constant
from truearm.identification.terms.catalogue import thermal
from truearm.models import KinematicModel, NetworkModel, NominalModel, PhysicalModel
from truearm.readings import Lengths, Session

NOISE = 0.02  # mm, as the readings of `real` have it


def mean_error(model, real, angles):
    """Mean distance between predicted and true tip [mm]."""
    return np.linalg.norm(model.predict(angles) - real.chain.tip_in_base(angles), axis=1).mean()


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({}, [0, 1, 2, 3, 4, 5]),
        ({"position": ["p", "q", "p", "q", "p", "r"]}, [0, 1, 0, 1, 0, 2]),
        ({"seat": ["a", "a", "b", "b", "b", "a"]}, [0, 0, 1, 1, 1, 0]),
        ({"seat": ["a", "a", "b", "", "", "b"]}, [2, 2, 3, 0, 1, 3]),
        ({"position": ["p"] * 6}, [0, 1, 2, 3, 4, 5]),
        ({"seat": ["a"] * 6}, [0, 1, 2, 3, 4, 5]),
        ({"position": ["p"] * 6, "seat": ["a", "a", "b", "b", "c", "c"]}, [0, 0, 1, 1, 2, 2]),
        ({"position": ["p", "p", "", "", "", ""], "seat": ["a", "b", "a", "a", "", "c"]}, [3, 3, 1, 1, 0, 2]),
        ({"session": ["s", "s", "t", "t", "t", "t"]}, [0, 1, 2, 3, 4, 5]),
    ],
)
def test_groups_are_positions_else_seats_else_single_readings(columns, expected):
    readings = Session(
        np.arange(12.0).reshape(6, 2), np.zeros((6, 3)), **{name: np.array(names) for name, names in columns.items()}
    )
    assert cross_validation_groups(readings).tolist() == expected


def test_a_position_that_is_all_of_a_session_with_a_frame_of_its_own_counts_for_nothing():
    """Without it nobody knows that frame. A position in part of one counts, as does that of readings without points."""
    points = np.zeros((8, 3))
    points[7] = np.nan
    names = {"session": ["s"] * 3 + ["t"] * 5, "position": ["p", "p", "p", "q", "q", "r", "r", "r"]}
    readings = Session(
        np.arange(16.0).reshape(8, 2), points, **{name: np.array(values) for name, values in names.items()}
    )
    assert cross_validation_groups(readings).tolist() == [0, 0, 0, 1, 1, 2, 2, 2]
    assert cross_validation_groups(readings, ["s", "t"]).tolist() == [0, 1, 2, 3, 3, 4, 4, 4]
    pointed = replace(readings, position=np.array(["p", "p", "p", "q", "q", "q", "q", "r"]))
    assert cross_validation_groups(pointed, ["s", "t"]).tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    over_two = replace(readings, position=np.array(["p", "p", "p", "p", "p", "r", "r", "r"]))
    assert cross_validation_groups(over_two, ["s", "t"]).tolist() == [0, 1, 2, 3, 3, 4, 4, 4]
    in_seats = replace(readings, seat=np.array(["a", "a", "b", "c", "c", "", "", ""]))
    assert cross_validation_groups(in_seats, ["s", "t"]).tolist() == [0, 0, 1, 2, 2, 3, 3, 3]


def test_positions_are_left_out_together(real, rng):
    readings = real.points(60, rng, position=np.array([f"p{i // 6}" for i in range(60)]))
    held_out = KinematicModel(real.arm).fit_readings(readings).held_out_
    assert sorted(held_out.rows.tolist()) == list(range(60))
    positions = readings.position[held_out.rows]
    assert len({(p, g) for p, g in zip(positions.tolist(), held_out.group.tolist(), strict=True)}) == 10


@pytest.mark.parametrize("n", [40, 200])
def test_the_kinematic_model_finds_the_arm_and_what_it_cannot_explain(n, real, rng):
    readings = real.points(n, rng)
    model = KinematicModel(real.arm).fit_readings(readings)
    others = real.points(300, rng)
    assert mean_error(NominalModel(real.arm).fit_readings(readings), real, others.angles) > 0.3
    assert mean_error(model, real, others.angles) < 2 * NOISE * np.sqrt(3 * 27 / (3 * n))  # 27 determined constants
    assert model.fit_.references[0].noise_std == pytest.approx(NOISE, rel=0.25)
    assert model.residual_std_ == pytest.approx(NOISE, rel=0.35)
    assert model.held_out_.mean_mm > np.linalg.norm(model.fit_.references[0].residuals, axis=0).mean()
    assert model.free_ == ("base", "tip")


@pytest.mark.weekly
def test_ellipsoids_hold_what_they_say_on_new_readings(real):
    """Over twelve sessions of 60 readings, 100 new readings each: 95 % of them."""
    rng = np.random.default_rng(3)
    held = []
    for _ in range(12):
        model = KinematicModel(real.arm).fit_readings(real.points(60, rng))
        new = real.points(100, rng)
        points, covariance = model.predict(new.angles, return_cov=True)
        off = points - new.points
        held.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off) < chi2.ppf(0.95, 3))
    assert 0.93 < np.mean(held) < 0.98  # 1200 readings of 12 models: 0.01 at two sigma


def test_the_two_parts_of_the_covariance_make_the_whole(real, rng):
    model = KinematicModel(real.arm).fit_readings(real.points(60, rng))
    angles = real.arm.working + np.linspace(-2, 2, 9)[:, None]
    of_parameters, unexplained = model.covariance_parts(Session(angles))
    np.testing.assert_array_equal(model.predict(angles, return_cov=True)[1], of_parameters + unexplained)
    share = model.variance_function_.share(angles)
    np.testing.assert_allclose(unexplained, model.residual_std_**2 * share[:, None, None] * np.eye(3))
    size = np.trace(of_parameters, axis1=1, axis2=2)
    assert size[[0, -1]].min() > 10 * size[4]  # far from the training poses the constants are less known
    assert (np.linalg.eigvalsh(of_parameters) > 0).all()


def test_readings_share_the_errors_of_the_parameters(real, rng):
    """Products of the displacements are the covariance of each tip, and between tips that of drawn coefficients.

    20,000 arms drawn from the posterior: their covariances have a standard deviation of 0.7 % of the variances.
    """
    model = KinematicModel(real.arm).fit_readings(real.points(60, rng))
    session = Session(real.arm.working + np.linspace(-1, 1, 4)[:, None])
    shared = model.shared_displacements(session)
    products = np.einsum("kni,kmj->nimj", shared, shared)
    of_parameters, _ = model.covariance_parts(session)
    np.testing.assert_allclose(products[range(4), :, range(4)], of_parameters, rtol=1e-9, atol=1e-15)
    fit, state = model.fit_, model.state(session)
    root = np.linalg.cholesky(fit.covariance + 1e-12 * np.diag(fit.covariance.diagonal()))
    small = 1e-3  # of the uncertainty: to first order
    away = small * rng.standard_normal((20_000, len(root))) @ root.T
    jacobian = np.concatenate(
        [columns.transpose(2, 1, 0) for _, _, columns in fit.perturbed_chain.derivatives(state, fit.coefficients)]
    )
    tips = np.einsum("nip,kp->kni", jacobian, away) / small
    drawn = np.einsum("kni,kmj->nimj", tips, tips) / len(tips)
    np.testing.assert_allclose(drawn, products, atol=0.04 * of_parameters.max())
    moved = fit.perturbed_chain.tips(state, fit.coefficients + away[0]) - fit.tips(state)
    np.testing.assert_allclose(moved, small * tips[0], atol=1e-3 * small * np.abs(tips[0]).max())


def test_weights_follow_the_option(real, rng):
    readings = real.points(100, rng)
    points = readings.points.copy()
    points[::10] += 5.0
    spoilt = replace(readings, points=points)
    others = real.points(100, rng).angles
    robust, careless = (KinematicModel(real.arm, robust=robust).fit_readings(spoilt) for robust in (True, False))
    assert mean_error(robust, real, others) < 0.1 * mean_error(careless, real, others)
    assert (robust.fit_.references[0].robust_weight[::10] < 0.5).all()
    assert (careless.fit_.references[0].robust_weight == 1).all()


def test_uncertain_points_are_told_from_good_ones(real, rng):
    """Stated uncertainties: what is left to explain is the noise besides them."""
    readings = real.points(200, rng)
    std = np.where(np.arange(200) % 2, 0.2, 1e-3)[:, None] * np.ones(3)
    model = KinematicModel(real.arm).fit_readings(
        replace(readings, points=readings.points + std * rng.normal(size=(200, 3)), point_std=std)
    )
    assert model.residual_std_ == pytest.approx(NOISE, rel=0.4)
    assert mean_error(model, real, real.points(200, rng).angles) < 1.2 * NOISE


def test_seats_alone_with_lengths_find_the_arms_shape(real, rng):
    """No instrument: the base stays as drawn, lengths set the scale; shapes are compared, not places."""
    seats = real.held(rng)
    new = real.points(200, rng).angles
    true = real.chain.tip_in_base(new)

    def shape_error(model):
        T = align(model.predict(new), true)
        return np.linalg.norm(model.predict(new) @ T[:3, :3].T + T[:3, 3] - true, axis=1).mean()

    def apart(model):
        """Distances of the seats S2 and S3 from S1 [mm]."""
        centres = [model.predict(seats.angles[seats.seat == name]).mean(axis=0) for name in ("S1", "S2", "S3")]
        return np.linalg.norm(np.array(centres[1:]) - centres[0], axis=1)

    known = real.lengths()
    nominal = NominalModel(real.arm).fit_readings(seats, lengths=known)
    model = KinematicModel(real.arm).fit_readings(seats, lengths=known)
    assert model.free_ == nominal.free_ == ("tip",)
    assert shape_error(model) < 0.3 * shape_error(nominal)
    np.testing.assert_allclose(apart(model), known.length_mm, atol=0.01)
    assert np.abs(apart(nominal) - known.length_mm).max() > 0.5
    # Lengths one per cent larger make an arm one per cent larger, as far as its priors allow.
    larger = replace(known, length_mm=1.01 * known.length_mm)
    with accepting("no drawing is as large"):
        grown = KinematicModel(real.arm).fit_readings(seats, lengths=larger)
    np.testing.assert_allclose(apart(grown), larger.length_mm, rtol=2e-3)
    assert model.fit_.references[0].kind == "seat"
    assert len(model.held_out_.rows) == 60


def test_seats_help_few_points(real, rng):
    """Eight points, and sixty readings in seats: much better than the eight alone."""
    seen, held = real.points(8, rng), real.held(rng)
    both = Session(
        np.concatenate([seen.angles, held.angles]),
        np.concatenate([seen.points, np.full((60, 3), np.nan)]),
        seat=np.concatenate([np.full(8, ""), held.seat]),
    )
    others = real.points(200, rng).angles
    alone = KinematicModel(real.arm).fit_readings(seen)
    helped = KinematicModel(real.arm).fit_readings(both)
    assert helped.free_ == ("base", "tip")
    assert mean_error(helped, real, others) < 0.5 * mean_error(alone, real, others)


def test_readings_with_a_load_are_predicted_at_their_own(real, rng):
    def drawn(n):
        angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (n, 6))
        load_3 = 2 + rng.normal(size=n)
        turned = angles.copy()
        turned[:, 2] += 5e-4 * load_3
        points = real.chain.tip_in_base(turned) + rng.normal(0, NOISE, (n, 3))
        return Session(angles, points, columns={"load_3_Nm": load_3})

    train, test = drawn(150), drawn(100)
    model = PhysicalModel(real.arm, highest=2).fit_readings(train)
    assert model.training_.columns["load_3_Nm"].mean == pytest.approx(train.columns["load_3_Nm"].mean())
    own = np.linalg.norm(model.predict_readings(test) - test.points, axis=1).mean()
    usual = np.linalg.norm(model.predict(test.angles) - test.points, axis=1).mean()
    assert own < 2 * NOISE * np.sqrt(3)
    assert usual > 3 * own
    # Without the column a prediction is that at its mean.
    at_mean = replace(test, columns={"load_3_Nm": np.full(100, model.training_.columns["load_3_Nm"].mean)})
    np.testing.assert_array_equal(model.predict(test.angles), model.predict_readings(at_mean))
    points, covariance = model.predict_readings(test, return_cov=True)
    np.testing.assert_array_equal(points, model.predict_readings(test))
    assert covariance.shape == (100, 3, 3)


def test_readings_with_a_temperature_are_predicted_at_their_own(real, rng):
    """Links of 2.3e-5 per kelvin, from 10 to 40 degC: 0.5 mm; growth beyond the training temperatures too."""
    growth = [np.array(term.direction) for term in thermal(real.arm.chain)]
    places = [term.place for term in thermal(real.arm.chain)]

    def tips(angles, temperature):
        out = np.empty((len(angles), 3))
        for i, (q, t) in enumerate(zip(angles, temperature, strict=True)):
            motions = np.zeros((real.arm.chain.n_places, 6))
            motions[places] = 2.3e-5 * (t - 20) * np.array(growth)
            out[i] = real.chain.with_motions(motions).tip_in_base(q[None])[0]
        return out

    def drawn(n, low, high):
        angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (n, 6))
        temperature = rng.uniform(low, high, n)
        return Session(angles, tips(angles, temperature) + rng.normal(0, NOISE, (n, 3)), temperature_degC=temperature)

    train, test = drawn(150, 15, 30), drawn(60, 30, 40)
    model = PhysicalModel(real.arm, highest=2).fit_readings(train)
    assert model.training_.temperature_degC.mean == pytest.approx(train.temperature_degC.mean())
    own = np.linalg.norm(model.predict_readings(test) - test.points, axis=1).mean()
    usual = np.linalg.norm(model.predict(test.angles) - test.points, axis=1).mean()
    assert own < 2 * NOISE * np.sqrt(3)
    assert usual > 3 * own
    at_mean = replace(test, temperature_degC=np.full(60, model.training_.temperature_degC.mean))
    np.testing.assert_array_equal(model.predict(test.angles), model.predict_readings(at_mean))


def test_the_physical_model_finds_a_gears_error(real, rng):
    """J3 is off by 1e-3 sin(5 q + 0.3) rad: as good as the noise allows, and the band of orders 5 to 8 is kept."""

    def drawn(n):
        angles = real.arm.working + rng.uniform(-1.5, 1.5, (n, 6))
        turned = angles.copy()
        turned[:, 2] += 1e-3 * np.sin(5 * angles[:, 2] + 0.3)
        return Session(angles, real.chain.tip_in_base(turned) + rng.normal(0, NOISE, (n, 3)))

    train, test = drawn(300), drawn(200)
    kinematic, physical = (
        m.fit_readings(train) for m in (KinematicModel(real.arm), PhysicalModel(real.arm, highest=16))
    )
    errors = [np.linalg.norm(m.predict(test.angles) - test.points, axis=1).mean() for m in (kinematic, physical)]
    assert errors[1] < 1.35 * NOISE * np.sqrt(8 / np.pi) < 0.5 * errors[0]  # mean length of three Gaussian coordinates
    (term,) = [t for t in physical.fit_.perturbed_chain.terms if t.name.startswith("J3 angle error, orders 5")]
    start = sum(
        t.n_coefficients for t in physical.fit_.perturbed_chain.terms[: physical.fit_.perturbed_chain.terms.index(term)]
    )
    cos_5, sin_5 = physical.fit_.coefficients[start : start + 2]
    np.testing.assert_allclose([cos_5, sin_5], [1e-3 * np.sin(0.3), 1e-3 * np.cos(0.3)], atol=5e-5)


def test_all_terms_offered_do_no_harm_where_there_is_nothing(real, rng):
    """An arm of constants only: the physical model is as good as the kinematic one, within a tenth."""
    train, others = real.points(200, rng), real.points(300, rng).angles
    kinematic, physical = (
        m.fit_readings(train) for m in (KinematicModel(real.arm), PhysicalModel(real.arm, highest=16))
    )
    assert mean_error(physical, real, others) < 1.1 * mean_error(kinematic, real, others) + 0.1 * NOISE


def test_terms_that_readings_cannot_show_are_named(real, rng):
    readings = real.points(60, rng)
    angles = readings.angles.copy()
    angles[:, 4] = angles[0, 4] + 0.01 * rng.uniform(-1, 1, 60)
    model = PhysicalModel(real.arm, highest=4).fit_readings(
        Session(angles, real.chain.tip_in_base(angles) + rng.normal(0, NOISE, (60, 3)))
    )
    reasons = dict(model.excluded_terms_)
    assert reasons["thermal expansion"] == "the readings have no temperature"
    assert "moved by" in reasons["J5 orders 1 to 4"]
    assert KinematicModel(real.arm).fit_readings(readings).excluded_terms_ == ()


@pytest.mark.parametrize("highest", [1, pytest.param(3, marks=pytest.mark.weekly), 16])
def test_the_highest_order_is_an_option(highest, real, rng):
    """Of the harmonics about a joint's own axis, counted before evidence prunes."""
    model = PhysicalModel(real.arm, highest=highest).fit_readings(real.points(80, rng, half_width=2.0))
    offered = sum(group.n_coefficients for group in model.fit_.groups if "angle error" in group.name)
    assert offered == 6 * 2 * highest


def test_a_progress_is_told(real, rng):
    told = []
    KinematicModel(real.arm).fit_readings(real.points(40, rng), progress=lambda done, note: told.append((done, note)))
    assert told[0] == (0, "choosing terms")
    assert all(isinstance(done, int) and note for done, note in told)
    assert "point" in told[-1][1]


@pytest.mark.parametrize("kind", [NominalModel, KinematicModel, PhysicalModel])
def test_one_seat_is_held_out_by_regions_of_the_joint_space(kind, real, rng):
    """Of two readings on average, each against the position of the seat by the others."""
    held = real.held(rng)
    model = kind(real.arm, **({"highest": 2} if kind is PhysicalModel else {})).fit_readings(held.rows(np.arange(20)))
    assert sorted(model.held_out_.rows.tolist()) == list(range(20))
    assert 5 <= len(np.unique(model.held_out_.group)) <= 10
    assert np.isfinite(model.predict(held.angles, return_cov=True)[1]).all()


def test_without_a_point_the_frame_is_the_arms_own(real, rng):
    """No constant that only moves or turns the whole arm is sought, and none is in the stated uncertainty."""
    model = KinematicModel(real.arm).fit_readings(real.held(rng), lengths=real.lengths())
    constants = [term for term in model.fit_.perturbed_chain.terms if isinstance(term.basis, Constant)]
    places = {(term.place, term.direction) for term in constants}
    assert not any(place == 0 for place, _ in places)
    assert not {(1, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)), (1, (0.0, 0.0, 0.0, 0.0, 0.0, 1.0))} & places
    of_parameters, _ = model.covariance_parts(real.held(rng))
    assert np.sqrt(np.trace(of_parameters, axis1=1, axis2=2)).max() < 1.0  # mm; with the frame's prior it was several


def test_what_cannot_be_learned_from_is_refused_with_the_reason(real, rng):
    held, seen = real.held(rng), real.points(20, rng)
    model = KinematicModel(real.arm)
    refuses("expected reference points .*, the readings have none", model.fit_readings, Session(seen.angles))
    with pytest.raises(InputError, match="seats of two readings or more"):
        model.fit_readings(Session(seen.angles, seat=np.array([f"s{i}" for i in range(20)])))
    few = np.full((20, 3), np.nan)
    few[:3] = seen.points[:3]
    refuses("expected 4 or more readings with a reference, got 3", model.fit_readings, Session(seen.angles, few))
    with pytest.raises(InputError, match="lengths are between seats, and the readings name no seats"):
        model.fit_readings(seen, lengths=real.lengths())
    foreign = Lengths(np.array(["S1"]), np.array(["elsewhere"]), np.array([100.0]), np.array([0.01]))
    refuses("no seat 'elsewhere'", model.fit_readings, held, lengths=foreign)
    refuses("readings of 6 joints", model.fit_readings, Session(seen.angles[:, :5], seen.points))


def test_a_network_needs_a_point_at_every_reading(real, rng):
    readings = real.points(40, rng)
    points = readings.points.copy()
    points[7] = np.nan
    network = NetworkModel(real.arm, hidden=(3,), epochs=2)
    with pytest.raises(InputError, match="reference point at every reading, 1 of 40 have none.*Try: readings.rows"):
        network.fit_readings(Session(readings.angles, points))
    refuses("expected reference points", network.fit_readings, real.held(rng))
    refuses("expected reference points", network.fit_readings, Session(readings.angles))


def test_nothing_free_and_no_terms_measure_the_arm_as_drawn(real, rng):
    readings = real.points(50, rng)
    model = NominalModel(real.arm, free=()).fit_readings(readings)
    np.testing.assert_array_equal(model.predict(readings.angles), real.arm.chain.tip_in_base(readings.angles))
    assert model.fit_.perturbed_chain.terms == ()
    of_parameters, _ = model.covariance_parts(readings)
    assert not of_parameters.any()
    off = np.linalg.norm(model.predict(readings.angles) - readings.points, axis=1)
    assert model.held_out_.mean_mm == pytest.approx(off.mean())


def test_a_sliding_arm_is_identified_by_the_physical_model_too(rng):
    drawn = load_arm("gao2017").chain
    chain = type(drawn)(drawn.fixed, drawn.tip_in_flange, np.array([False, False, True, False, False, False]))
    truth = chain.with_motions(np.array([1e-3] * 3 + [0.5] * 3) * rng.normal(size=(chain.n_places, 6)))
    arm = Arm("slides", chain)

    def drawn_readings(n):
        angles = np.where(chain.is_prismatic, 100.0, 0.8) * rng.uniform(-1, 1, (n, 6))
        return Session(angles, truth.tip_in_base(angles) + rng.normal(0, NOISE, (n, 3)))

    train, test = drawn_readings(150), drawn_readings(100)
    model = PhysicalModel(arm, highest=4).fit_readings(train)
    assert np.linalg.norm(model.predict(test.angles) - test.points, axis=1).mean() < 1.5 * NOISE * np.sqrt(8 / np.pi)
    assert ("J3 harmonics", "J3 is prismatic") in model.excluded_terms_
