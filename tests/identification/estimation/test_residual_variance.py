"""What a model cannot explain, from readings held out: by hand, its order statistic, planted variances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from truearm.identification.estimation.residual_variance import FLOOR_MM2, HeldOutReadings, conformal_residual_variance

RADIUS = float(chi2.ppf(0.95, 3))  # 7.81


def held_out(deviations, covariance=None, *, group=None, freedom=None):
    m = len(deviations)
    return HeldOutReadings(
        np.arange(m),
        np.arange(m) if group is None else np.asarray(group),
        np.asarray(deviations, dtype=float),
        np.zeros((m, 3, 3)) if covariance is None else covariance,
        np.ones(m) if freedom is None else np.asarray(freedom, dtype=float),
    )


def along_x(lengths):
    return np.asarray(lengths, dtype=float)[:, None] * [1.0, 0, 0]


@pytest.mark.parametrize(
    ("m", "rank"), [(4, 4), (18, 18), (19, 19), (20, 20), (38, 38), (39, 38), (59, 57), (99, 95), (100, 96)]
)
def test_the_order_statistic_is_number_ceil_of_level_times_one_more(m, rank):
    """Of lengths 1 to m without covariance, the variance puts number `rank` on the ellipsoid."""
    found = conformal_residual_variance(held_out(along_x(np.random.default_rng(0).permutation(m) + 1)))
    assert found == pytest.approx(rank**2 / RADIUS, rel=1e-5)


def test_with_a_covariance_by_hand():
    """Ten of length 5, variances 1 or 2 along them: the longest are those of 25 / (1 + v)."""
    covariance = np.tile(np.diag([2.0, 100, 100]), (10, 1, 1))
    covariance[5:, 0, 0] = 1.0
    found = conformal_residual_variance(held_out(along_x(np.full(10, 5.0)), covariance))
    assert found == pytest.approx(25 / RADIUS - 1, rel=1e-5)


def test_directions_count_by_their_own_variance():
    """A deviation of 30 where the variance is 9, of 10 where it is 0.5: 900 / (9 + v) + 100 / (0.5 + v) = 7.81."""
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    covariance = np.tile(turn @ np.diag([9.0, 0.5, 1.0]) @ turn.T, (4, 1, 1))
    deviations = np.tile(turn @ [30.0, 10, 0], (4, 1))
    v = conformal_residual_variance(held_out(deviations, covariance))
    assert 900 / (9 + v) + 100 / (0.5 + v) == pytest.approx(RADIUS, rel=1e-5)


def test_a_seat_of_two_readings_shows_half_of_each_ones_variance():
    """Each deviates from their mean by half their difference, whose variance is twice that of one."""
    alone = conformal_residual_variance(held_out(along_x([1.0, 2, 3, 4])))
    halved = conformal_residual_variance(
        held_out(along_x(np.array([1.0, 2, 3, 4]) / np.sqrt(2)), freedom=np.full(4, 0.5))
    )
    assert halved == pytest.approx(alone, rel=1e-5)


def test_where_covariances_say_all_nothing_is_unexplained():
    found = conformal_residual_variance(held_out(along_x([1.0, 2, 3]), np.tile(9 * np.eye(3), (3, 1, 1))))
    assert found == FLOOR_MM2
    assert conformal_residual_variance(held_out(np.zeros((5, 3)))) == FLOOR_MM2


@settings(max_examples=80)
@given(st.integers(0, 10**6), st.integers(1, 60), st.sampled_from([1e-6, 1.0, 1e3]))
def test_the_covered_share_is_the_requested_level(seed, m, size):
    """With v as many ellipsoids hold their deviation as the order statistic says; with less, one fewer does."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(m, 3, 3)) * rng.choice([0, 0.1, 1], (m, 1, 1))
    covariance = size**2 * half @ half.transpose(0, 2, 1)
    readings = held_out(size * rng.normal(size=(m, 3)) * 2, covariance, freedom=rng.choice([0.5, 0.9, 1], m))
    level = float(rng.choice([0.5, 0.9, 0.95]))
    v = conformal_residual_variance(readings, level=level)

    def lengths(variance):
        whole = covariance + (variance * readings.freedom)[:, None, None] * np.eye(3)
        return np.einsum(
            "ni,ni->n", readings.deviations, np.linalg.solve(whole, readings.deviations[..., None])[..., 0]
        )

    rank = min(int(np.ceil((m + 1) * level)), m)
    radius = chi2.ppf(level, 3)
    assert (lengths(v * (1 + 1e-4)) <= radius).sum() >= rank
    if v > FLOOR_MM2:
        assert (lengths(v * (1 - 1e-4)) <= radius).sum() < rank


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.floats(1e-3, 1e3))
def test_the_unit_does_not_matter(seed, factor):
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(12, 3, 3))
    covariance, deviations = half @ half.transpose(0, 2, 1), 10 * rng.normal(size=(12, 3))
    one = conformal_residual_variance(held_out(deviations, covariance))
    other = conformal_residual_variance(held_out(factor * deviations, factor**2 * covariance))
    assert other == pytest.approx(factor**2 * one, rel=1e-4)


@pytest.mark.parametrize("outliers", [0, 40])
def test_a_planted_variance_is_recovered(outliers, rng):
    """4000 deviations of covariance C + 0.05^2; one gross error in a hundred moves the order statistic by little."""
    half = 0.03 * rng.normal(size=(4000, 3, 3))
    covariance = half @ half.transpose(0, 2, 1)
    deviations = np.einsum("nij,nj->ni", half, rng.normal(size=(4000, 3))) + 0.05 * rng.normal(size=(4000, 3))
    deviations[:outliers] *= 1000
    found = np.sqrt(conformal_residual_variance(held_out(deviations, covariance)))
    # The quantile of 4000 stands to 0.0034 in probability: 2 % of the length; 1 % of outliers make 95 % be 96 %.
    assert found == pytest.approx(0.05, rel=0.06 if outliers == 0 else 0.12)


def test_coverage_of_new_readings_is_the_level(rng):
    """Sized on 60 readings held out, ellipsoids hold 95 % of new ones on average, whatever their distribution."""
    shares = []
    for _ in range(300):
        every = rng.standard_t(4, size=(160, 3))
        v = conformal_residual_variance(held_out(every[:60]))
        shares.append(((every[60:] ** 2).sum(axis=1) <= RADIUS * v).mean())
    assert 0.945 < np.mean(shares) < 0.975  # the level or a little more; the mean of 300 stands to 0.0017


def test_parts_and_multiples_keep_the_axes_of_their_covariances(rng):
    """Axes that are known already are those that are worked out from the part or the multiple, to rounding."""
    root = rng.normal(size=(30, 3, 3))
    whole = held_out(rng.normal(size=(30, 3)), root @ root.transpose(0, 2, 1))
    known = [whole.scaled(covariance=0.3, freedom=rng.uniform(0.5, 1, 30)), whole.select(rng.random(30) < 0.5)]
    for one in (*known, known[0].select(np.array([4, 2, 9]))):
        again = HeldOutReadings(one.rows, one.group, one.deviations, one.covariance, one.freedom)
        for found, expected in zip(one.along_axes, again.along_axes, strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-13)


def test_readings_that_others_do_not_know_judge_nothing():
    """Of own variance 0.04, known to some of it, to ten times it, and in one direction not at all."""
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    covariance = np.stack([np.diag([0.01, 0.02, 0]), 0.4 * np.eye(3), turn @ np.diag([0.01, 0.02, 1e6]) @ turn.T])
    readings = held_out(along_x([0.1, 0.2, 0.3]), covariance, group=[4, 5, 5], freedom=[1, 0.5, 1])
    judging = readings.select_informative(np.full(3, 0.04))
    for name in ("rows", "group", "deviations", "covariance", "freedom"):
        np.testing.assert_array_equal(getattr(judging, name), getattr(readings, name)[:2])
    assert readings.select_informative(np.array([0.04, 0.04, 1e6])).rows.tolist() == [0, 1, 2]


def test_mean_error_and_its_scatter_between_groups():
    """Single readings: the standard deviation over the root of their number. Twice the same readings say no more."""
    errors = np.array([1.0, 2, 4, 7])
    single = held_out(along_x(errors))
    assert single.mean_mm == 3.5
    assert single.standard_error_mm == pytest.approx(np.std(errors, ddof=1) / 2)
    twice = held_out(along_x(np.repeat(errors, 2)), group=np.repeat([7, 3, 90, 8], 2))  # numbers need not follow
    assert twice.mean_mm == 3.5
    assert twice.standard_error_mm == pytest.approx(single.standard_error_mm)
    # One group alone has no scatter between groups: its readings' stands in.
    assert held_out(along_x(errors), group=np.zeros(4, int)).standard_error_mm == single.standard_error_mm


def test_errors_in_a_seat_are_those_of_a_seat_of_many_readings():
    found = held_out(along_x([3.0, -3.0]), freedom=[0.5, 0.5], group=[0, 0]).errors_mm
    np.testing.assert_allclose(found, 3 * np.sqrt(2))
