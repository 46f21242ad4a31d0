"""Gross errors are distinguished from honest ones by what is held out, whatever their size, and take no part."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import ReferenceFit
from truearm.identification.estimation.residual_variance import HeldOutReadings
from truearm.identification.judgement import gross_errors
from truearm.identification.judgement.cross_validation import cross_validate_by_group
from truearm.identification.judgement.gross_errors import (
    LEAST_FREEDOM,
    MAX_FITS,
    ErrorDistribution,
    excluded_readings,
    fit_error_distribution,
    identify_without_gross_errors,
)
from truearm.identification.judgement.outliers import outliers
from truearm.identification.references.references import Points, seats_of
from truearm.identification.terms import ArmState, constants
from truearm.models import PhysicalModel
from truearm.wings.planning.designs.sampling import STRATEGIES, seat
from truearm.wings.planning.virtual import VirtualArm, load_preset

NOISE = 0.02  # mm


def held_out(deviations, *, known=0.0):
    n = len(deviations)
    rows = np.arange(n)
    return HeldOutReadings(rows, rows, deviations, np.tile(known * np.eye(3), (n, 1, 1)), np.ones(n))


def gross(readings):
    return np.flatnonzero(fit_error_distribution(readings).gross_probability(readings) > 0.5).tolist()


def with_gross_errors(rng, n, share, least):
    """Gaussian deviations, the first of them with an error of any size from `least` standard deviations on."""
    deviations = NOISE * rng.normal(size=(n, 3))
    k = int(share * n)
    directions = rng.normal(size=(k, 3))
    sizes = NOISE * least * 10 ** rng.uniform(0, 4, k)
    deviations[:k] += sizes[:, None] * directions / np.linalg.norm(directions, axis=1)[:, None]
    return deviations, list(range(k))


@given(seed=st.integers(0, 1000), n=st.sampled_from([40, 150, 400]))
@settings(max_examples=20)
def test_gaussian_deviations_have_no_gross_errors(seed, n):
    """Beyond 5.5 standard deviations lies one Gaussian reading in a million."""
    assert gross(held_out(NOISE * np.random.default_rng(seed).normal(size=(n, 3)))) == []


@given(seed=st.integers(0, 1000), n=st.sampled_from([40, 150]), share=st.sampled_from([0.03, 0.1, 0.2]))
@settings(max_examples=20)
def test_gross_errors_of_any_size_are_named_and_no_others(seed, n, share):
    deviations, bad = with_gross_errors(np.random.default_rng(seed), n, share, least=20)
    readings = held_out(deviations)
    assert gross(readings) == bad
    distribution = fit_error_distribution(readings)
    assert distribution.variance == pytest.approx(NOISE**2, rel=0.6)  # of 32 readings or more, with tails
    weights = distribution.student_weights(readings)
    assert (weights[bad] < 0.1).all()
    assert ((weights >= 0) & (weights <= 1)).all()


@pytest.mark.parametrize("k", [1, 3])
def test_both_densities_have_their_share_of_all_deviations(k):
    """Integrals over the whitened length of k coordinates, to the largest gross error; to 0.1 % in 20,000 steps."""
    of = ErrorDistribution(variance=1.0, freedom=5.0, gross_share=0.2)
    t = np.geomspace(1e-4, gross_errors.LEAST_GROSS_STDS * 10**gross_errors.DECADES, 20_000)
    squares = np.repeat(t[None] ** 2 / k, k, axis=0)
    densities = gross_errors._densities(np.zeros_like(squares), squares, np.ones(len(t)), of).logs
    honest, gross = (np.trapezoid(np.exp(one) * gross_errors.UNIT_SPHERE[k] * t ** (k - 1), t) for one in densities)
    assert (honest, gross) == (pytest.approx(0.8, rel=1e-3), pytest.approx(0.2, rel=1e-3))


def test_a_reading_has_the_weight_of_its_probability_to_be_honest():
    """At 8 scales Student's weight is 6 / (3 + 64): a reading that is gross in all likelihood has none of it left."""
    wide = ErrorDistribution(variance=NOISE**2, freedom=3.0, gross_share=0.3)
    readings = held_out(NOISE * np.array([[0.5, 0, 0], [8.0, 0, 0], [0, 800.0, 0]]))
    weights, probability = wide.student_weights(readings), wide.gross_probability(readings)
    assert probability[2] > 0.999 > 0.9 > probability[1] > 0.1
    student = [1.0, 6 / (3 + 64), 6 / (3 + 800**2)]
    assert weights == pytest.approx(student * (1 - probability), rel=1e-9)


@given(seed=st.integers(0, 99), k=st.sampled_from([1, 3]), freedom=st.floats(3.2, 500), share=st.floats(2e-3, 0.39))
@settings(max_examples=20)
def test_derivatives_of_the_deviance_are_its_differences(seed, k, freedom, share):
    rng = np.random.default_rng(seed)
    known, squares = rng.uniform(0, 2e-3, (k, 40)), 0.002 * rng.standard_t(4, (k, 40)) ** 2
    squares[:, 0] = 0.0
    own = rng.uniform(0.5, 1, 40)
    x = np.array([np.log(1.5e-3), 1 / freedom, np.log(share)])

    def deviance(x):
        of = ErrorDistribution(float(np.exp(x[0])), float(1 / x[1]), float(np.exp(x[2])))
        return gross_errors._deviance(known, squares, own, of)

    steps = 1e-5 * np.diag([1, x[1], 1])
    differences = [(deviance(x + step)[0] - deviance(x - step)[0]) / (2 * step.max()) for step in steps]
    np.testing.assert_allclose(deviance(x)[1], differences, rtol=1e-5, atol=1e-4)  # rounding of sums of 40 logarithms


def test_tails_as_of_a_geared_robot_are_honest(rng):
    """Of Student's distribution with four degrees of freedom, some of 4000 readings lie 20 scales away."""
    deviations = NOISE * rng.normal(size=(4000, 3)) / np.sqrt(rng.chisquare(4, 4000) / 4)[:, None]
    readings = held_out(deviations)
    distribution = fit_error_distribution(readings)
    assert distribution.freedom == pytest.approx(4, rel=0.15)
    assert len(gross(readings)) <= 2
    assert (np.linalg.norm(deviations, axis=1) > 15 * NOISE).sum() >= 2


@given(scale=st.floats(1e-3, 1e3), seed=st.integers(0, 100))
@settings(max_examples=10)
def test_the_unit_of_the_deviations_decides_nothing(scale, seed):
    deviations, _ = with_gross_errors(np.random.default_rng(seed), 60, 0.1, least=5)
    ours = fit_error_distribution(held_out(deviations, known=NOISE**2)).gross_probability(
        held_out(deviations, known=NOISE**2)
    )
    other = held_out(scale * deviations, known=(scale * NOISE) ** 2)
    np.testing.assert_allclose(fit_error_distribution(other).gross_probability(other), ours, atol=0.02)


def test_many_readings_have_the_distribution_from_every_start(rng, monkeypatch):
    """A sample only shows where to start: the same to a hundredth of what 4000 readings leave open, 3 % of a scale."""
    deviations = NOISE * rng.normal(size=(4000, 3)) / np.sqrt(rng.chisquare(6, 4000) / 6)[:, None]
    deviations[::50] *= 200
    plain = fit_error_distribution(held_out(deviations))
    monkeypatch.setattr(gross_errors, "MOST_STARTED", 500)
    found = fit_error_distribution(held_out(deviations))
    assert (found.variance, found.freedom) == pytest.approx((plain.variance, plain.freedom), rel=3e-4)
    assert found.gross_share == pytest.approx(plain.gross_share, rel=3e-4)


def test_what_the_covariance_explains_is_no_gross_error(rng):
    """A deviation of 50 noises where the others leave 50 open is honest; the same elsewhere is not."""
    deviations = NOISE * rng.normal(size=(60, 3))
    deviations[[3, 4], 0] = 50 * NOISE
    readings = held_out(deviations)
    readings.covariance[3] = (50 * NOISE) ** 2 * np.eye(3)
    assert gross(readings) == [4]


@pytest.mark.parametrize("size", [0.0, 1e-9])
def test_exact_readings_have_a_distribution(size):
    distribution = fit_error_distribution(held_out(np.full((20, 3), size)))
    assert isinstance(distribution, ErrorDistribution)
    assert np.isfinite([distribution.variance, distribution.freedom]).all()
    assert distribution.freedom >= LEAST_FREEDOM


@pytest.fixture(scope="module")
def drawn():
    """A `gao2017` a little off, 60 readings with points and 40 in four seats, and its constants."""
    rng = np.random.default_rng(5)
    arm = load_arm("gao2017")
    chain = arm.chain.with_motions(np.array([1e-3] * 3 + [0.5] * 3) * rng.normal(size=(arm.chain.n_places, 6)))
    poses = seat(replace(arm, chain=chain), 40, seed=3, seats=4)
    angles = np.concatenate([arm.working + 0.8 * rng.uniform(-1, 1, (60, 6)), poses.angles])
    angles[60:] += rng.normal(0, 1e-5, (40, 6))  # 0.01 mm
    points = chain.tip_in_base(angles[:60]) + rng.normal(0, NOISE, (60, 3))
    return ArmState(arm.chain, angles), points, poses.seat, constants(arm.chain, free=("tip",))


def without(drawn, points, rows=None, *, angles=None, anew=False):
    """The identification of points and seats without gross errors."""
    state, _, names, terms = drawn
    state = state if angles is None else replace(state, angles=angles)
    references = [Points(np.arange(60), points), seats_of(np.arange(60, 100), names)]
    weights = np.ones(100)
    if rows is not None:
        weights[rows] = 0.0

    def identified(weights, before):
        start = None if anew else before
        return identify(state.chain, state, terms, references, reading_weights=weights, start=start)

    def cross_validated(fit):
        return cross_validate_by_group(fit, state, references, np.arange(100))

    return identify_without_gross_errors(identified, cross_validated, weights)


def test_rounds_that_start_from_the_one_before_find_the_same_arm(drawn):
    """To a hundredth of its uncertainty, with the same readings excluded."""
    points = drawn[1].copy()
    points[[4, 31]] += [[0.4, 0, 0], [0, 3.0, 0]]
    (one, _), (other, _) = (without(drawn, points, anew=anew) for anew in (False, True))
    assert excluded_readings(one).tolist() == excluded_readings(other).tolist() == [4, 31]
    std = np.sqrt(other.covariance.diagonal())
    np.testing.assert_allclose(one.coefficients / std, other.coefficients / std, rtol=0, atol=0.01)
    np.testing.assert_allclose(one.covariance.diagonal(), std**2, rtol=0.01)


def test_a_reading_of_weight_zero_is_as_if_it_were_not_there(drawn):
    state, points, _, terms = drawn
    state = state.rows(np.arange(60))
    weights = np.ones(60)
    weights[[7, 20]] = 0.0
    wrong = points + np.where(weights[:, None] == 0, 1e3, 0.0)
    rest = np.flatnonzero(weights)
    ours = identify(state.chain, state, terms, [Points(np.arange(60), wrong)], reading_weights=weights)
    other = identify(state.chain, state, terms, [Points(rest, points[rest])])
    np.testing.assert_allclose(ours.tips(state), other.tips(state), atol=1e-9)
    assert ours.references[0].noise_std == pytest.approx(other.references[0].noise_std, rel=1e-9)
    assert ours.references[0].robust_weight[[7, 20]].tolist() == [0, 0]
    assert excluded_readings(ours).tolist() == [7, 20]
    # Held out, it is predicted by the same arm, with the covariance of its tip.
    held = cross_validate_by_group(ours, state, [Points(np.arange(60), wrong)], np.arange(60))
    np.testing.assert_allclose(held.deviations[[7, 20]], (ours.tips(state) - wrong)[[7, 20]], rtol=1e-6)
    np.testing.assert_allclose(held.covariance[[7, 20]], ours.tip_covariance(state)[[7, 20]], rtol=1e-4)


def test_gross_errors_are_excluded_and_honest_readings_come_back(drawn):
    _, points, _, _ = drawn
    wrong = points.copy()
    wrong[11] += [100.0, 0, 0]
    wrong[30] += [0, 0.6, 0]
    clean, _ = without(drawn, points)
    assert len(excluded_readings(clean)) == 0
    fit, held = without(drawn, wrong, rows=[0, 1, 2])
    assert excluded_readings(fit).tolist() == [11, 30]
    assert len(held.rows) == 100
    assert [(one.row, one.is_excluded) for one in outliers(fit)] == [(11, True), (30, True)]
    assert outliers(fit)[0].error_mm == pytest.approx(100, abs=0.1)
    assert "excluded" in str(outliers(fit)[0])
    assert fit.references[0].noise_std == pytest.approx(clean.references[0].noise_std, rel=0.1)


@pytest.mark.parametrize("late", [False, True])
def test_student_weights_only_show_what_to_exclude(late):
    """However the rounds end, a reading takes part or does not."""
    rng, n = np.random.default_rng(0), 150
    heavy = 0.05 * rng.standard_normal((n, 3)) / np.sqrt(rng.chisquare(2.6, n) / 2.6)[:, None]
    heavy *= np.minimum(1, 1.2 / np.linalg.norm(heavy, axis=1))[:, None]
    heavy[:3] = [[9, 0, 0], [0, 6, 0], [0, 0, 7]]
    start = np.where(np.arange(n) < 3, 0.0, 1.0)  # a simpler model has found them
    light, seen = NOISE * rng.standard_normal((n, 3)), []

    def identified(weights, before):
        assert (before is None) == (len(seen) == 0 or np.unique(weights).size > 2)  # Student's start anew
        seen.append(weights)
        return SimpleNamespace(
            references=(
                ReferenceFit(
                    "point", np.arange(n), heavy.T, np.full((3, n), 0.01), NOISE, weights, np.zeros(n, int), {}
                ),
            )
        )

    def cross_validated(fit):
        # Readings that come and go delay the heavy tails to the last round.
        one = light.copy()
        one[len(seen)] = 5.0
        return held_out(one if late and len(seen) < MAX_FITS - 1 else heavy, known=1e-6)

    fit, _ = identify_without_gross_errors(identified, cross_validated, start)
    assert np.flatnonzero(fit.references[0].robust_weight == 0).tolist() == [0, 1, 2]
    assert (fit.references[0].robust_weight[3:] == 1).all()
    assert len(seen) <= MAX_FITS + 1


def test_a_wrong_reading_in_a_seat_is_named(drawn):
    state, points, _, _ = drawn
    angles = state.angles.copy()
    angles[70, 1] += 5e-3  # some millimetres
    fit, _ = without(drawn, points, angles=angles)
    assert excluded_readings(fit).tolist() == [70]
    assert outliers(fit)[0].kind == "seat"


def test_a_wrong_reading_at_a_far_pose_is_not_swallowed():
    """Before it was judged by what is held out, the 120 coefficients explained it and missed the others."""
    arm = load_arm("gao2017")
    virtual = VirtualArm.draw(arm, load_preset("shop"), seed=0)
    session = virtual.measure(STRATEGIES["measuring"](arm, 50, seed=0).angles, seed=0).readings
    angles = session.angles
    far = int(np.argmax(np.linalg.norm((angles - angles.mean(axis=0)) / angles.std(axis=0), axis=1)))
    points = session.points.copy()
    points[far] += [3.0, 0.0, 4.0]
    model = PhysicalModel(arm, highest=8).fit_readings(replace(session, points=points))
    assert excluded_readings(model.fit_).tolist() == [far]
    assert far not in model.held_out_.rows
    assert (model.held_out_errors_.n, model.held_out_errors_.n_excluded) == (49, 1)
    others = np.delete(np.arange(50), far)
    rest = PhysicalModel(arm, highest=8).fit_readings(session.rows(others))
    assert model.residual_std_ == pytest.approx(
        rest.residual_std_, rel=0.2
    )  # the far pose also decides which terms are offered
    plain = PhysicalModel(arm, highest=8, robust=False).fit_readings(session)
    assert len(excluded_readings(plain.fit_)) == 0


@pytest.mark.parametrize("weights", [np.ones(99), np.full(100, 2.0), np.full(100, -1.0), np.full(100, np.nan)])
def test_weights_are_one_a_reading_from_0_to_1(drawn, weights):
    state, points, _, terms = drawn
    with pytest.raises(InputError, match="expected weights of 100 readings, from 0 to 1"):
        identify(state.chain, state, terms, [Points(np.arange(60), points)], reading_weights=weights)


def test_a_reading_with_point_and_seat_is_excluded_as_a_whole_and_named_once(drawn):
    state, points, names, terms = drawn
    tips = identify(state.chain, state, terms, [Points(np.arange(60), points)]).tips(state)
    both = np.concatenate([points, tips[60:]])
    both[64] += 3.0
    references = [Points(np.arange(100), both), seats_of(np.arange(60, 100), names)]
    weights = np.ones(100)
    weights[64] = 0.0
    fit = identify(state.chain, state, terms, references, reading_weights=weights)
    assert [(one.row, one.kind) for one in outliers(fit) if one.is_excluded] == [(64, "point")]
