"""Identification of terms of all sorts: planted truth in its uncertainty, pruning, few and foul readings, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from refusals import refuses
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.identification.estimation import identification, rounds
from truearm.identification.estimation.group_scales import MOST_SCALE, scale_rounds
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import linearised, roughly_linearised
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import SmallMotionProblem
from truearm.identification.estimation.rounds import Rounds
from truearm.identification.judgement.outliers import outliers
from truearm.identification.references.alignment import align
from truearm.identification.references.references import Points, Seats, seats_of
from truearm.identification.terms import ArmState, Constant, Harmonics, Term, candidate_terms, constants
from truearm.identification.terms.catalogue import own_axis, wobble

NOISE = 0.02  # mm


@pytest.fixture(scope="module")
def arm():
    return load_arm("gao2017")


def poses(arm, n, rng, *, half_width=1.0):
    return arm.working + half_width * rng.uniform(-1, 1, (n, arm.n_joints))


def drawn(terms, rng, *, scales=None):
    """Coefficients of their prior standard deviations, times a scale for every group."""
    return np.concatenate(
        [(scales or {}).get(term.group, 1.0) * term.prior_stds * rng.normal(size=term.n_coefficients) for term in terms]
    )


def seen(arm, terms, x, angles, rng, *, noise=NOISE):
    """Points of an arm with these terms."""
    tips = PerturbedChain(arm.chain, tuple(terms)).tips(ArmState(arm.chain, angles), x)
    return tips + noise * rng.normal(size=tips.shape)


def found(arm, angles, points, terms, **options):
    state = ArmState(arm.chain, angles)
    return identify(arm.chain, state, terms, [Points(np.arange(len(angles)), points)], **options)


def squared_errors(fit, arm, angles, truth):
    """(n,) squared errors of tips in their stated covariance: chi-square of three."""
    state = ArmState(arm.chain, angles)
    off = fit.tips(state) - truth
    return np.einsum("ni,ni->n", off, np.linalg.solve(fit.tip_covariance(state), off[..., None])[..., 0])


# Planted truth


def test_constants_and_harmonics_lie_within_their_stated_uncertainty(arm, rng):
    """Thirty arms, three poses each of 40 degrees beside the readings: 95 % ellipsoids, by the binomial of arms.

    Poses of one arm err together: the bound is that of as many draws as there are arms.
    """
    terms = [*constants(arm.chain, free=(), angle_std=1e-3, length_std=0.5), *own_axis(arm.chain, 2, highest=4)]
    inside = []
    for _ in range(30):
        x = drawn(terms, rng)
        angles, others = poses(arm, 80, rng), poses(arm, 3, rng)
        fit = found(arm, angles, seen(arm, terms, x, angles, rng), terms)
        truth = seen(arm, terms, x, others, rng, noise=0.0)
        inside.append((squared_errors(fit, arm, others, truth) < 7.815).mean())
    # scales and noise are themselves estimated, which takes a little off
    assert 30 * np.mean(inside) >= binom.ppf(0.001, 30, 0.93)
    assert np.mean(inside) < 1


def test_scales_of_groups_are_recovered(arm, rng):
    """Orders 1 to 2 four times as large as usual, orders 3 to 4 a fourth: each from 24 coefficients, to 15 % or so."""
    terms = [t for joint in range(1, 6) for t in own_axis(arm.chain, joint, highest=4)]
    low, high = list(dict.fromkeys(term.group for term in terms))
    scales = {low: 4.0, high: 0.25}
    angles = poses(arm, 300, rng, half_width=np.pi)
    x = drawn(terms, rng, scales=scales)
    fit = found(arm, angles, seen(arm, terms, x, angles, rng, noise=2e-3), terms)
    for group in fit.groups:
        assert group.scale == pytest.approx(scales[group.name], rel=0.5)  # three standard deviations
        assert group.effective > 15
    assert fit.references[0].noise_std == pytest.approx(2e-3, rel=0.1)


def test_constants_ten_millimetres_and_two_degrees_off(arm, rng):
    """Every constant of the drawing: steps are long, kinematics exact, and other poses are right to the noise."""
    usual = constants(arm.chain, angle_std=np.radians(2.0), length_std=10.0, free=())
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.4, -2.0, 1.1]).as_matrix(), [2500, -3100, 400]
    for _ in range(4):
        angles, others = poses(arm, 150, rng), poses(arm, 100, rng)
        truth = PerturbedChain(arm.chain.with_reference_frame(T), tuple(usual)).with_constants(drawn(usual, rng))
        points = truth.tip_in_base(angles) + NOISE * rng.normal(size=(150, 3))
        rough = arm.chain.with_reference_frame(align(arm.chain.tip_in_base(angles), points))
        assert np.linalg.norm(rough.tip_in_base(angles) - points, axis=1).mean() > 5
        fit = identify(rough, ArmState(arm.chain, angles), constants(arm.chain), [Points(np.arange(150), points)])
        assert fit.converged
        assert fit.references[0].noise_std == pytest.approx(NOISE, rel=0.15)
        off = fit.tips(ArmState(arm.chain, others)) - truth.tip_in_base(others)
        assert np.sqrt((off**2).mean()) < NOISE  # 27 combinations from 450 numbers: a fourth of it, more at the rim


# What is not there


def test_absent_effects_hardly_matter(arm, rng):
    """All terms offered to an arm of constants alone: as good as if nothing else had been, to a few per cent."""
    geometry = constants(arm.chain, free=())
    ratios, extra = [], []
    for _ in range(4):
        x = drawn(geometry, rng, scales={term.group: 0.3 for term in geometry})
        angles, others = poses(arm, 150, rng), poses(arm, 300, rng)
        points = seen(arm, geometry, x, angles, rng)
        everything, _ = candidate_terms(ArmState(arm.chain, angles), free=(), highest=16)
        fits = [found(arm, angles, points, terms) for terms in (geometry, everything)]
        truth = seen(arm, geometry, x, others, rng, noise=0.0)
        errors = [np.sqrt(((fit.tips(ArmState(arm.chain, others)) - truth) ** 2).mean()) for fit in fits]
        # of a point seen once more, as held-out errors are
        ratios.append(np.hypot(errors[1], NOISE) / np.hypot(errors[0], NOISE))
        kept = {term.group for term in geometry}
        extra.append(sum(group.effective for group in fits[1].groups if group.name not in kept))
    assert np.mean(ratios) < 1.03
    assert np.median(extra) < 36  # of 450 numbers: slow groups remain, at sizes that the readings allow


def test_one_effect_among_many_offered_terms_is_identified(arm, rng):
    geometry = constants(arm.chain, free=())
    (planted,) = [t for t in own_axis(arm.chain, 3, highest=16) if "orders 5 to 8" in t.name]
    angles = poses(arm, 200, rng)
    x = np.concatenate([drawn(geometry, rng, scales={t.group: 0.3 for t in geometry}), drawn([planted], rng)])
    points = seen(arm, [*geometry, planted], x, angles, rng)
    offered = [*geometry, *(t for j in range(1, 7) for t in wobble(arm.chain, j)), planted]
    fit = found(arm, angles, points, offered)
    scale = {group.name: group.scale for group in fit.groups}
    assert scale[planted.group] == pytest.approx(1.0, rel=0.7)  # eight coefficients
    assert scale["wobble, rotations"] < 0.05
    assert scale["wobble, translations"] < 0.05
    assert fit.perturbed_chain.n_coefficients == len(fit.coefficients) == len(fit.prior_std) == len(fit.covariance)


def test_missing_terms_do_not_make_others_absurd(arm, rng):
    """Harmonics 9 to 12 are there, only 1 to 4 offered: those stay within ten times their usual size, and say noise."""
    real = [t for j in (2, 3) for t in own_axis(arm.chain, j, highest=16) if "9 to 16" in t.name]
    angles, others = poses(arm, 300, rng, half_width=0.5), poses(arm, 300, rng, half_width=0.5)
    x = drawn(real, rng, scales={t.group: 3.0 for t in real})
    offered = [*constants(arm.chain, free=()), *(t for j in (2, 3) for t in own_axis(arm.chain, j, highest=4))]
    fit = found(arm, angles, seen(arm, real, x, angles, rng), offered)
    assert max(group.scale for group in fit.groups) <= MOST_SCALE * (1 + 1e-12)
    off = fit.tips(ArmState(arm.chain, others)) - seen(arm, real, x, others, rng, noise=0.0)
    nothing = arm.chain.tip_in_base(others) - seen(arm, real, x, others, rng, noise=0.0)
    assert (off**2).mean() < (nothing**2).mean()


# Foul readings


def test_five_per_cent_of_gross_errors_do_little_and_are_listed(arm, rng):
    terms = [*constants(arm.chain, free=()), *own_axis(arm.chain, 2, highest=4)]
    x = drawn(terms, rng, scales={t.group: 0.3 for t in terms})
    angles, others = poses(arm, 200, rng), poses(arm, 200, rng)
    points = seen(arm, terms, x, angles, rng)
    truth = seen(arm, terms, x, others, rng, noise=0.0)
    clean = found(arm, angles, points, terms)
    foul = points.copy()
    bad = rng.choice(200, 10, replace=False)
    foul[bad] += rng.choice([-1, 1], (10, 3)) * rng.uniform(2, 50, (10, 3))
    robust, plain = found(arm, angles, foul, terms), found(arm, angles, foul, terms, robust=False)
    errors = [np.sqrt(((f.tips(ArmState(arm.chain, others)) - truth) ** 2).mean()) for f in (clean, robust, plain)]
    assert errors[1] < 2 * errors[0]
    assert errors[2] > 10 * errors[0]
    trust = robust.references[0].robust_weight
    assert (trust[bad] < 0.05).all()
    assert (np.delete(trust, bad) > 0.5).all()
    assert sorted(outlier.row for outlier in outliers(robust)) == sorted(bad)
    assert robust.references[0].noise_std == pytest.approx(NOISE, rel=0.35)


# Few readings


@pytest.mark.parametrize(
    ("n", "free"),
    [
        (n, free) if (n, free) in ((1, ()), (3, ("base", "tip"))) else pytest.param(n, free, marks=pytest.mark.weekly)
        for n in (1, 2, 3, 5)
        for free in ((), ("base", "tip"))
    ],
)
def test_few_readings_state_a_large_uncertainty(n, free, arm, rng):
    """Over eight arms: squared errors at other poses in the stated covariance, whose expectation is three.

    Three readings and a free base and tip: nine numbers for nine unknowns, no residuals, and no say on anything else.
    """
    squares = []
    for _ in range(8):
        terms = constants(arm.chain, free=(), angle_std=1e-3, length_std=1.0)
        x = drawn(terms, rng)
        angles, others = poses(arm, n, rng), poses(arm, 2, rng)
        fit = found(arm, angles, seen(arm, terms, x, angles, rng), constants(arm.chain, free=free))
        assert np.isfinite(fit.coefficients).all()
        assert np.linalg.eigvalsh(fit.covariance / np.outer(fit.prior_std, fit.prior_std))[0] > -1e-9
        assert (fit.covariance.diagonal() <= fit.prior_std**2 * (1 + 1e-6)).all()
        assert max(group.scale for group in fit.groups) < 3
        squares += list(squared_errors(fit, arm, others, seen(arm, terms, x, others, rng, noise=0.0)))
    # Half of a chi-square of three stays below 2.4; so few readings leave scales and noise open themselves.
    assert np.median(squares) < 12


def test_all_terms_from_a_dozen_readings(arm, rng):
    """Some two hundred coefficients from 36 numbers: no worse than the drawing, and it says how good."""
    terms = constants(arm.chain, free=(), angle_std=1e-3, length_std=1.0)
    x = drawn(terms, rng)
    angles, others = poses(arm, 12, rng), poses(arm, 100, rng)
    everything, _ = candidate_terms(ArmState(arm.chain, angles), free=(), highest=16)
    fit = found(arm, angles, seen(arm, terms, x, angles, rng), everything)
    truth = seen(arm, terms, x, others, rng, noise=0.0)
    off = np.linalg.norm(fit.tips(ArmState(arm.chain, others)) - truth, axis=1)
    assert off.mean() < 0.2 * np.linalg.norm(arm.chain.tip_in_base(others) - truth, axis=1).mean()
    assert np.median(squared_errors(fit, arm, others, truth)) < 12


# Bad input


def reading(arm):
    angles = poses(arm, 6, np.random.default_rng(0))
    return angles, arm.chain.tip_in_base(angles)


@pytest.mark.parametrize(
    ("rows", "shape", "message"),
    [
        (np.arange(6), (1, 3), r"expected points of shape \(6, 3\), got \(1, 3\)"),
        (np.arange(5), (6, 3), r"expected points of shape \(5, 3\), got \(6, 3\)"),
        (np.arange(6), (6, 2), r"expected points of shape \(6, 3\), got \(6, 2\)"),
    ],
)
def test_points_that_are_not_those_of_the_readings_are_refused(rows, shape, message, arm):
    angles, points = reading(arm)
    with pytest.raises(InputError, match=message):
        identify(arm.chain, ArmState(arm.chain, angles), constants(arm.chain), [Points(rows, np.resize(points, shape))])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e9, 1e300])
def test_points_beyond_any_reach_are_refused(value, arm):
    _, points = reading(arm)
    points[4, 1] = value
    refuses("at reading 15", Points, np.arange(10, 16), points)


def test_uncertainties_of_another_shape_are_refused(arm):
    _, points = reading(arm)
    refuses(r"uncertainties of shape \(6, 3\), got \(6, 1\)", Points, np.arange(6), points, np.ones((6, 1)))


@pytest.mark.parametrize("seat", [np.zeros(5, int), np.arange(6), np.full(6, -1)])
def test_readings_of_no_seat_are_refused(seat):
    refuses("expected one of 1 seats at each of 6 readings", Seats, np.arange(6), seat, ("a",))


def test_a_term_beyond_the_chain_is_refused(arm):
    angles, points = reading(arm)
    beyond = Term("far", 9, (0, 0, 1, 0, 0, 0), Constant(), "g", 1.0)
    with pytest.raises(InputError, match=r"term 'far': expected a place from 0 \(base\) to 7 \(tip\), got 9"):
        identify(arm.chain, ArmState(arm.chain, angles), [beyond], [Points(np.arange(6), points)])


# Anything


@settings(max_examples=6)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 12),
    st.sampled_from([0.0, 1e-6, 0.01, 10.0, 1e4]),
    st.sampled_from(["points", "seats", "both"]),
    st.booleans(),
)
def test_any_input_is_fitted_or_refused_and_never_worse_than_the_nominal_arm(seed, n, off, what, still):
    """Points and seats that the arm can or cannot have been at, joints that stood still, terms of every kind."""
    rng = np.random.default_rng(seed)
    arm = load_arm(str(rng.choice(["gao2017", "ur10", "measuring7"])))
    angles = poses(arm, n, rng, half_width=rng.choice([0.01, 1.0]))
    if still:
        angles[:, rng.integers(arm.n_joints)] = 0.3
    state = ArmState(arm.chain, angles, temperature_degC=rng.uniform(15, 30, n))
    terms, _ = candidate_terms(state, free=("tip",) if what == "seats" else ("base", "tip"), highest=2)
    points = arm.chain.tip_in_base(angles) + off * rng.normal(size=(n, 3))
    names = np.array([f"s{rng.integers(3)}" for _ in range(n)])
    references = [Points(np.arange(n), points)] if what != "seats" else []
    if what != "points":
        apart = [("s0", "s1", 300.0, 0.01)] if {"s0", "s1"} <= set(names) and rng.random() < 0.5 else []
        references.append(seats_of(np.arange(n), names, apart))
    fit = identify(arm.chain, state, terms, references, robust=False)
    assert np.isfinite(fit.coefficients).all()
    assert np.isfinite(fit.covariance).all()
    assert (fit.covariance.diagonal() <= fit.prior_std**2 * (1 + 1e-3)).all()
    assert np.isfinite(fit.tips(state)).all()
    for reference in fit.references:
        assert np.isfinite(reference.noise_std)
        assert reference.noise_std >= 0
    if what == "points":
        before, after = arm.chain.tip_in_base(angles) - points, fit.tips(state) - points
        assert np.sqrt((after**2).mean()) <= np.sqrt((before**2).mean()) + 1e-3


def test_progress_is_reported_and_the_same_readings_give_the_same_arm(arm, rng):
    angles = poses(arm, 30, rng)
    points = arm.chain.tip_in_base(angles) + NOISE * rng.normal(size=(30, 3))
    told = []
    first = found(arm, angles, points, constants(arm.chain), progress=lambda n, what: told.append((n, what)))
    assert [n for n, _ in told] == list(range(1, first.rounds + 1))
    assert all("point" in what for _, what in told)
    second = found(arm, angles, points, constants(arm.chain))
    np.testing.assert_array_equal(first.coefficients, second.coefficients)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_one_group_that_is_not_learned_keeps_its_prior(arm, rng):
    terms = [replace(term, learn=False) for term in constants(arm.chain, free=())]
    angles = poses(arm, 20, rng)
    fit = found(arm, angles, arm.chain.tip_in_base(angles) + NOISE * rng.normal(size=(20, 3)), terms)
    assert {group.scale for group in fit.groups} == {1.0}
    np.testing.assert_array_equal(fit.prior_std, np.concatenate([term.prior_stds for term in terms]))


def test_what_no_reading_showed_is_in_the_covariance_elsewhere(arm, rng):
    """Readings about one pose say little of bending and slow harmonics: far from it their sizes are still open."""
    geometry = constants(arm.chain, free=())
    x = drawn(geometry, rng, scales={term.group: 0.3 for term in geometry})
    angles = poses(arm, 60, rng) * 0.15
    points = seen(arm, geometry, x, angles, rng)
    everything, _ = candidate_terms(ArmState(arm.chain, angles), free=(), highest=4)
    fits = [found(arm, angles, points, terms) for terms in (geometry, everything)]
    far = ArmState(arm.chain, poses(arm, 200, rng))
    near = ArmState(arm.chain, angles)
    spread = [[np.trace(fit.tip_covariance(at), axis1=1, axis2=2).mean() for at in (near, far)] for fit in fits]
    assert spread[1][1] > 1.3 * spread[0][1]
    assert spread[1][1] > 10 * spread[1][0]


@pytest.mark.parametrize(("n", "is_kept"), [(300, False), (12000, True)])
def test_groups_that_many_readings_can_see_are_not_pruned(n, is_kept, arm, rng):
    """A shift by cosine and sine of 0.015 of the noise in a residual.

    At its usual size it moves all residuals of 300 readings together by 0.45 standard deviations, of 12,000 by 2.8.
    """
    small = 0.015 * np.sqrt(3) * NOISE  # in one of three coordinates; two functions of mean square 1/2
    terms = [replace(term, learn=False) for term in constants(arm.chain, free=(), angle_std=1e-4, length_std=0.1)] + [
        Term("small", 0, (0.0, 0, 0, 1, 0, 0), Harmonics(2, (5,)), "small", small)
    ]
    x = drawn(terms, rng)
    x[-2:] = 2 * small, -2 * small
    angles = poses(arm, n, rng)
    fit = found(arm, angles, seen(arm, terms, x, angles, rng), terms)
    scale = {group.name: group.scale for group in fit.groups}["small"]
    assert (scale > 0) == is_kept
    if is_kept:
        std = np.sqrt(fit.covariance.diagonal()[-2:])
        assert (np.abs(fit.coefficients[-2:] - x[-2:]) < 4 * std).all()
        assert (std < small).all()


@pytest.mark.parametrize(
    "what",
    [
        "some excluded",
        *(pytest.param(one, marks=pytest.mark.weekly) for one in ("in two steps", "all", "of several uncertainties")),
    ],
)
def test_many_readings_that_start_from_a_sample_give_the_same_arm(what, arm, rng, monkeypatch):
    terms = [*constants(arm.chain, free=()), *own_axis(arm.chain, 2, highest=2)]
    angles = poses(arm, 6000, rng)
    state, options = ArmState(arm.chain, angles), {}
    noise = np.full((6000, 3), NOISE)
    if what == "in two steps":
        monkeypatch.setattr(identification, "LEAST_SAMPLE", 60)
        monkeypatch.setattr(identification, "SAMPLE_PER_COEFFICIENT", 1)
    if what == "of several uncertainties":
        noise[::2] *= 3
    points = seen(arm, terms, drawn(terms, rng), angles, rng, noise=noise)
    if what == "some excluded":
        points[::7] += 50.0  # mm
        options["reading_weights"] = (np.arange(6000) % 7 > 0).astype(float)
    reference = Points(np.arange(6000), points, np.sqrt(noise**2 - (0.5 * NOISE) ** 2))
    rounds, fits, sizes, begun = [], [], [], Rounds.__init__
    monkeypatch.setattr(Rounds, "__init__", lambda *a, **k: sizes.append(len(a[1].state)) or begun(*a, **k))
    for share in (identification.MOST_SHARE, 0.0):
        monkeypatch.setattr(identification, "MOST_SHARE", share)
        fits.append(identify(arm.chain, state, terms, [reference], **options))
        rounds.append(fits[-1].rounds)
    assert rounds[0] < rounds[1]
    assert sizes[-3:] == [375 if what == "in two steps" else 1000, 6000, 6000]
    assert len(sizes) == (4 if what == "in two steps" else 3)
    by_sample, directly = fits
    std = [np.sqrt(np.trace(fit.tip_covariance(state), axis1=1, axis2=2)) for fit in fits]
    # Each ends within a twentieth of its uncertainty of the minimum.
    assert np.linalg.norm(by_sample.tips(state) - directly.tips(state), axis=1).max() < 0.1 * std[1].max()
    np.testing.assert_allclose(std[0], std[1], rtol=0.01)


def test_a_matrix_of_some_readings_prunes_the_groups_that_one_of_all_prunes(arm, rng, monkeypatch):
    """Of thirty groups of a joint's harmonics three are there: the same three are found, and the same arm."""
    geometry = constants(arm.chain, free=())
    turns = [Term(f"order {k}", 2, (0.0, 0, 0, 1, 0, 0), Harmonics(2, (k,)), f"order {k}", NOISE) for k in range(2, 32)]
    terms, angles = [*geometry, *turns], poses(arm, 6000, rng, half_width=np.pi)
    shown = {"order 3", "order 11", "order 30"}
    x = drawn(terms, rng, scales={term.group: float(term.group in shown) for term in turns})
    points, fits, rough = seen(arm, terms, x, angles, rng), [], []
    for share in (identification.MOST_SHARE, 0.0):
        monkeypatch.setattr(identification, "MOST_SHARE", share)
        given = Rounds.__init__
        monkeypatch.setattr(Rounds, "__init__", lambda *a, given=given, **k: rough.append(k["some"]) or given(*a, **k))
        fits.append(found(arm, angles, points, terms))
        monkeypatch.setattr(Rounds, "__init__", given)
    assert [some is not None for some in rough] == [False, True, False]  # the sample, all by it, all by themselves
    by_sample, directly = fits
    assert {group.name for group in by_sample.groups if group.scale > 0 and group.name.startswith("order")} >= shown
    assert [group.scale > 0 for group in by_sample.groups] == [group.scale > 0 for group in directly.groups]
    state = ArmState(arm.chain, angles)
    std = [np.sqrt(np.trace(fit.tip_covariance(state), axis1=1, axis2=2)) for fit in fits]
    # Each ends within a twentieth of its uncertainty of the minimum.
    assert np.linalg.norm(by_sample.tips(state) - directly.tips(state), axis=1).max() < 0.1 * std[1].max()
    np.testing.assert_allclose(std[0], std[1], rtol=0.01)


def test_scales_that_follow_from_one_linearisation_to_the_next_give_the_arm_of_converged_ones(arm, rng, monkeypatch):
    """Where a weighing costs more than two linearisations there is one each: tips within a fiftieth of u."""
    assert scale_rounds(1400, 3_000, is_first=False, is_calm=True) == 0
    assert [scale_rounds(1400, n, is_first=False, is_calm=True) for n in (25_000, 60_000)] == [1, 2]
    assert all(scale_rounds(p, 3_000, is_first=True, is_calm=False) == 1 for p in (45, 1400))
    assert scale_rounds(45, 3_000, is_first=False, is_calm=True) == 11
    turns = [term for joint in (2, 3) for term in own_axis(arm.chain, joint, highest=16)]
    terms, angles = [*constants(arm.chain, free=()), *turns], poses(arm, 150, rng, half_width=2.0)
    scales = {term.group: 0.1 * i for i, term in enumerate(turns)}
    points, fits = seen(arm, terms, drawn(terms, rng, scales=scales), angles, rng), []
    for n in (0, 20):
        monkeypatch.setattr(rounds, "scale_rounds", lambda *_, is_first, n=n, **__: n or int(is_first))
        fits.append(found(arm, angles, points, terms))
    state = ArmState(arm.chain, poses(arm, 200, rng, half_width=2.0))
    std = [np.sqrt(np.trace(fit.tip_covariance(state), axis1=1, axis2=2)) for fit in fits]
    assert (np.linalg.norm(fits[0].tips(state) - fits[1].tips(state), axis=1) / std[1]).max() < 0.02
    np.testing.assert_allclose(std[0], std[1], rtol=0.02)


def test_noise_that_settles_without_a_linearisation_saves_one_and_gives_the_same_arm(arm, rng, monkeypatch):
    """A step again after a straight one: tips within a hundredth of u."""
    turns = [term for joint in (2, 3) for term in own_axis(arm.chain, joint, highest=16)]
    terms, angles = [*constants(arm.chain, free=()), *turns], poses(arm, 100, rng, half_width=2.0)
    scales = {term.group: 0.1 * i for i, term in enumerate(turns)}
    points, fits, counts = seen(arm, terms, drawn(terms, rng, scales=scales), angles, rng), [], []
    monkeypatch.setattr(rounds, "MANY_COEFFICIENTS", 1)
    for straight in (0.0, rounds.STRAIGHT_STEP):
        monkeypatch.setattr(rounds, "STRAIGHT_STEP", straight)
        places = []
        monkeypatch.setattr(rounds, "linearised", lambda *of, seen=places: seen.append(of[1]) or linearised(*of))
        fits.append(found(arm, angles, points, terms))
        counts.append(len(places))
    assert counts[1] < counts[0]
    state = ArmState(arm.chain, poses(arm, 200, rng, half_width=2.0))
    std = [np.sqrt(np.trace(fit.tip_covariance(state), axis1=1, axis2=2)) for fit in fits]
    assert (np.linalg.norm(fits[0].tips(state) - fits[1].tips(state), axis=1) / std[0]).max() < 0.01
    np.testing.assert_allclose(std[0], std[1], rtol=1e-3)


def test_noise_of_residuals_that_parameters_determine_settles_by_linearisations(arm, rng, monkeypatch):
    """Of five readings: without the parameters that a smaller noise determines it would fall to nothing."""
    terms, angles = constants(arm.chain, free=()), poses(arm, 5, rng, half_width=2.0)
    points, noise = seen(arm, terms, drawn(terms, rng), angles, rng), []
    monkeypatch.setattr(rounds, "MANY_COEFFICIENTS", 1)
    for straight in (0.0, rounds.STRAIGHT_STEP):
        monkeypatch.setattr(rounds, "STRAIGHT_STEP", straight)
        noise.append(found(arm, angles, points, terms).references[0].noise_std)
    assert noise[0] == noise[1] > 1e-3


def test_the_step_that_remains_leads_to_the_minimum_of_the_scales_of_the_fit(arm, rng, monkeypatch):
    """Not to that of raised scales, which the covariance has: of converged rounds nothing remains."""
    terms, angles = constants(arm.chain, free=()), poses(arm, 15, rng, half_width=2.0)
    points = seen(arm, terms, drawn(terms, rng), angles, rng)
    monkeypatch.setattr(rounds, "SETTLED_STEP_OF_FEW", 1e-6)
    part = found(arm, angles, points, terms).references[0]
    assert np.abs(part.to_minimum).max() < 1e-5 * part.noise_std


def test_few_of_many_readings_are_excluded_and_come_back_by_one_step(arm, rng, monkeypatch):
    """Of 2000 readings three are excluded, two of them wrong, and one comes back: to a 500th of u."""
    terms, rows = constants(arm.chain, free=()), np.arange(2000)
    angles = poses(arm, 2000, rng)
    points = seen(arm, terms, drawn(terms, rng), angles, rng)
    points[[4, 31]] += [[0.4, 0, 0], [0, 3.0, 0]]
    state, references = ArmState(arm.chain, angles), [Points(rows, points)]
    monkeypatch.setattr(rounds, "SETTLED_STEP_OF_FEW", 1e-4)  # what the rounds leave is not what is compared
    before = found(arm, angles, points, terms, reading_weights=np.where(rows == 7, 0.0, 1.0))
    weights = np.where(np.isin(rows, [4, 31, 99]), 0.0, 1.0)
    assert identification.with_few_changed(before, state, references, weights) is None  # two in 1000
    monkeypatch.setattr(identification, "MOST_CHANGED", 0.003)
    quick = identification.with_few_changed(before, state, references, weights)
    plain = found(arm, angles, points, terms, reading_weights=weights, start=before)
    std = np.sqrt(plain.covariance.diagonal())
    assert np.abs((before.coefficients - plain.coefficients) / std).max() > 0.05
    np.testing.assert_allclose(quick.coefficients / std, plain.coefficients / std, rtol=0, atol=0.002)
    # Weights follow the noise, of which four in 2000 readings are a share.
    for name, tolerance in (("residuals", 1e-3 * NOISE), ("robust_weight", 5e-3)):
        quick_one, plain_one = (getattr(fit.references[0], name) for fit in (quick, plain))
        np.testing.assert_allclose(quick_one, plain_one, rtol=0, atol=tolerance)
    np.testing.assert_allclose(quick.covariance.diagonal(), std**2, rtol=0.01)  # three of 2000 and their noise
    weights[5] = 0.5  # as by Student's distribution
    assert identification.with_few_changed(before, state, references, weights) is None


def test_rough_normal_equations_of_all_readings_are_the_exact_ones(arm, rng):
    terms = (*constants(arm.chain, free=()), *own_axis(arm.chain, 2, highest=20))
    angles = poses(arm, 90, rng)
    x = drawn(terms, rng)
    points = Points(np.arange(90), seen(arm, terms, x, angles, rng, noise=0.1))
    problem = SmallMotionProblem(PerturbedChain(arm.chain, terms), ArmState(arm.chain, angles), (points,))
    weights, residuals = rng.uniform(5, 20, (3, 90)), problem.residuals(0.9 * x)[0]
    _, exact = linearised(problem, 0.9 * x, [weights])
    rough = roughly_linearised(problem, 0.9 * x, weights, residuals, np.arange(90))
    for name in ("cost", "gradient", "head"):
        of_exact = getattr(exact, name)
        np.testing.assert_allclose(getattr(rough, name), of_exact, rtol=1e-9, atol=1e-12 * np.abs(of_exact).max())
    weights[:, 1::2] = weights[:, ::2]  # the matrix of one half stands for both, by their weights
    half = roughly_linearised(problem, 0.9 * x, weights, residuals, np.arange(0, 90, 2))
    np.testing.assert_allclose(half.gradient, linearised(problem, 0.9 * x, [weights])[1].gradient, rtol=1e-9)
    of_half = SmallMotionProblem(
        problem.perturbed_chain,
        problem.state.rows(np.arange(0, 90, 2)),
        (replace(points.select(np.arange(0, 90, 2)), rows=np.arange(45)),),
    )
    head = linearised(of_half, 0.9 * x, [weights[:, ::2]])[1].head
    np.testing.assert_allclose(half.head, 2 * head, rtol=1e-9, atol=1e-12 * np.abs(head).max())


def test_no_direction_of_a_tip_is_known_better_than_perfectly(arm, rng):
    """Where all that is uncertain cancels out, what is left is rounding: as a variance it must not be below zero."""
    perturbed_chain = PerturbedChain(arm.chain, tuple(constants(arm.chain, free=())))
    state = ArmState(arm.chain, poses(arm, 8, rng))
    p = perturbed_chain.n_coefficients
    J = np.concatenate([columns for _, _, columns in perturbed_chain.derivatives(state, np.zeros(p))], axis=2)
    along = J[:, :, :4].reshape(p, 12)
    root = rng.normal(size=(p, p)) * np.concatenate([term.prior_stds for term in perturbed_chain.terms])
    covariance = root.T @ root
    cancelling = np.eye(p) - along @ np.linalg.pinv(along)  # moves none of the first four tips
    for spread in (covariance, cancelling @ covariance @ cancelling):
        spread = (spread + spread.T) / 2
        found = IdentificationResult(
            perturbed_chain, np.zeros(p), spread, np.ones(p), (), (), converged=True, rounds=1
        ).tip_covariance(state)
        expected = np.einsum("pin,pq,qjn->nij", J, spread, J)
        # mm^2: p roundings of what cancels out, if every coefficient moved the tip the same way.
        reach = np.einsum("pin,p->ni", np.abs(J), np.sqrt(spread.diagonal()))
        rounding = p * np.finfo(float).eps * reach[:, :, None] * reach[:, None, :]
        assert (np.abs(found - expected) <= rounding).all()
        assert (np.abs(found - found.transpose(0, 2, 1)) <= rounding).all()
        assert np.einsum("nii->ni", found).min() >= 0
        assert np.linalg.eigvalsh(found).min() >= -10 * np.finfo(float).eps * np.abs(found).max()
