"""Laws of the selection: updates are exact, textbook designs come out, exchange is never worse than greedy."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.wings.planning.designs.exchange import (
    OPTIMAL,
    DesignProblem,
    DOptimality,
    IOptimality,
    _Posterior,
    factor_of,
    fedorov_exchange,
    greedy,
    moment_matrix,
    project_out,
    select_candidates,
    stack_factors,
)

CRITERIA = [IOptimality(), DOptimality()]


def made_up(seed=0, *, n=12, k=2, p=5, prior=1.0):
    """Candidates of unlike worth, columns of unlike size."""
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-1, 1, p)
    factors = rng.standard_normal((n, k, p)) * 10 ** rng.uniform(-0.5, 0.5, (n, 1, 1)) * scale
    target = moment_matrix(rng.standard_normal((20, 3, p)) * scale)
    return DesignProblem(factors, prior * np.diag(scale**2), target)


def polynomial(copies):
    """A parabola y = a + b x + c x^2 on [-1, 1] with next to no prior, every x on a grid `copies` times."""

    def terms(x):
        return np.stack([np.ones_like(x), x, x**2], axis=-1)[:, None]

    grid = np.repeat(np.linspace(-1, 1, 9), copies)
    return grid, DesignProblem(terms(grid), 1e-6 * np.eye(3), moment_matrix(thrice(terms(np.linspace(-1, 1, 2001)))))


def thrice(J):
    """Rows that a target wants in threes; its value is then three times that of one row."""
    return np.repeat(J, 3, axis=1)


# --- textbook designs ---


def test_the_d_optimal_design_of_a_parabola_is_a_third_at_each_end_and_in_the_middle():
    """Fedorov 1972, section 2.3; the determinant of p = 3 observations is greatest at -1, 0, 1."""
    grid, problem = polynomial(copies=4)
    chosen = select_candidates(problem, 9, strategy="d-optimal")
    assert sorted(grid[chosen]) == [-1] * 3 + [0] * 3 + [1] * 3


def test_the_i_optimal_design_of_a_parabola_is_a_half_in_the_middle():
    """Quarter, half, quarter.

    A parabola through three means is a sum of Lagrange's polynomials, whose squares have the means 2/15, 8/15, 2/15
    over [-1, 1]: with weights w, 1 - 2 w, w the mean variance is (4/15) / w + (8/15) / (1 - 2 w), least at w = 1/4.
    """
    grid, problem = polynomial(copies=8)
    chosen = select_candidates(problem, 8)
    assert sorted(grid[chosen]) == [-1] * 2 + [0] * 4 + [1] * 2
    # 1e-3: the target's grid of 2001 points, and the prior.
    assert problem.variance(chosen) == pytest.approx(3 * 32 / 15 / 8, rel=1e-3)


def test_i_optimality_cares_for_the_target_only():
    """Of two parameters measured by different candidates only one matters."""
    factors = np.array([[[10.0, 0.0]], [[0.0, 1.0]], [[9.0, 0.0]]])
    problem = DesignProblem(factors, np.eye(2), np.diag([0.0, 1.0]))
    assert select_candidates(problem, 1).tolist() == [1]
    assert select_candidates(problem, 1, strategy="d-optimal").tolist() == [0]
    assert problem.course([1]) == pytest.approx([1.0, 0.5])


# --- updates against plain inverses ---


@given(st.integers(0, 10_000), st.sampled_from([1.0, 1e-4, 1e-8, 1e-12]))
@settings(max_examples=40)
def test_updates_are_exact(seed, prior):
    """Adding and leaving out, with priors up to a million times as wide as what the readings leave."""
    problem = made_up(seed, prior=prior)
    posterior = _Posterior(problem, [])
    for row in (3, 5, 0, 7, 9):
        posterior.refresh()
        posterior.add(row)
    posterior.refresh()
    posterior = posterior.without(5)
    posterior.refresh()
    rows = posterior.rows
    assert sorted(rows) == [0, 3, 7, 9]
    C = np.linalg.inv(problem.information(rows))
    J = problem.factors
    S, T = J @ C @ J.transpose(0, 2, 1), J @ (C @ problem.target @ C) @ J.transpose(0, 2, 1)
    np.testing.assert_allclose(posterior.S, S, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(posterior.T, T, rtol=1e-6, atol=1e-6 * np.abs(T).max())


@given(st.integers(0, 10_000), st.sampled_from([1.0, 1e-3, 1e-6]), st.sampled_from(CRITERIA))
@settings(max_examples=40)
def test_a_drop_is_the_difference_of_the_criterion(seed, prior, criterion):
    problem = made_up(seed, prior=prior)
    before = criterion.value(problem, [1, 4])
    after = np.array([criterion.value(problem, [1, 4, row]) for row in range(problem.n_candidates)])
    drops = _Posterior(problem, [1, 4]).drops(criterion)
    assert drops == pytest.approx(before - after, rel=1e-6, abs=1e-8 * abs(before))


def test_leaving_out_the_only_reading_of_a_parameter_is_exact():
    factors = np.array([[[1e6, 0.0]], [[0.0, 1e6]], [[1e6, 1e6]]])
    problem = DesignProblem(factors, np.eye(2), np.eye(2))
    posterior = _Posterior(problem, [0, 1]).without(0)
    # A variance of 1 returns from 1e-12: by an update, rounding would leave four digits of it.
    np.testing.assert_allclose(posterior.C, np.diag([1.0, 1e-12]), rtol=1e-11)


def test_variance_and_determinant_by_plain_algebra():
    problem = made_up(1)
    A = problem.prior_precision + sum(problem.factors[row].T @ problem.factors[row] for row in (2, 6))
    assert problem.variance([2, 6]) == pytest.approx(np.trace(problem.target @ np.linalg.inv(A)))
    assert problem.log_det([2, 6]) == pytest.approx(np.log(np.linalg.det(A)))
    assert problem.course([2, 6]) == pytest.approx(
        [problem.variance([]), problem.variance([2]), problem.variance([2, 6])]
    )


# --- greedy and exchange ---


@given(st.integers(0, 10_000), st.integers(1, 11), st.sampled_from(CRITERIA))
@settings(max_examples=40)
def test_exchange_ends_where_no_swap_helps_and_is_never_worse_than_greedy(seed, n, criterion):
    problem = made_up(seed, prior=1e-2)
    start = greedy(problem, n, criterion)
    best = fedorov_exchange(problem, start, criterion)
    assert len(set(best.tolist())) == n
    value = criterion.value(problem, best)
    assert value <= criterion.value(problem, start)
    for place in range(n):
        for other in set(range(12)) - set(best.tolist()):
            swapped = np.concatenate([np.delete(best, place), [other]])
            # 2e-6: swaps that gain less than a millionth are not made.
            assert criterion.value(problem, swapped) >= value - 2e-6 * max(abs(value), 1)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_greedy_takes_the_best_each_time(criterion):
    problem = made_up(2)
    taken: list[int] = []
    for row in greedy(problem, 5, criterion).tolist():
        values = {other: criterion.value(problem, [*taken, other]) for other in set(range(12)) - set(taken)}
        assert row == min(values, key=values.__getitem__)
        taken.append(row)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_against_all_choices(criterion):
    """A swap at a time finds the best of all 495 choices nearly always, and one not far from it else."""
    missed = 0
    for seed in range(20):
        problem = made_up(seed, prior=1e-2)
        best = fedorov_exchange(problem, greedy(problem, 4, criterion), criterion)
        truth = min(criterion.value(problem, rows) for rows in combinations(range(12), 4))
        excess = criterion.value(problem, best) - truth
        missed += excess > 1e-9
        assert excess <= 0.2 * abs(truth)
    assert missed <= 2


def test_exchange_mends_a_bad_start():
    problem = made_up(3)
    worst = max(combinations(range(12), 4), key=problem.variance)
    best = fedorov_exchange(problem, worst, IOptimality())
    assert problem.variance(best) < 0.7 * problem.variance(worst)


@pytest.mark.parametrize("strategy", OPTIMAL)
def test_every_strategy_repeats_and_each_reading_helps(strategy):
    problem = made_up(4)
    chosen = select_candidates(problem, 6, strategy=strategy)
    assert (select_candidates(problem, 6, strategy=strategy) == chosen).all()
    assert len(set(chosen.tolist())) == 6
    assert (np.diff(problem.course(chosen)) < 0).all()


def test_equal_candidates_are_taken_in_order():
    problem = DesignProblem(np.ones((5, 1, 1)), np.eye(1), np.eye(1))
    assert select_candidates(problem, 3).tolist() == [0, 1, 2]


@pytest.mark.parametrize("strategy", ["i-optimal", "d-optimal"])
def test_the_choice_does_not_depend_on_the_parameters_units(strategy):
    problem = made_up(5)
    mixed = np.random.default_rng(0).standard_normal((5, 5)) * 10.0 ** np.array([3, -3, 0, 1, -2])
    other = DesignProblem(
        problem.factors @ mixed, mixed.T @ problem.prior_precision @ mixed, mixed.T @ problem.target @ mixed
    )
    chosen = select_candidates(problem, 5, strategy=strategy)
    assert (select_candidates(other, 5, strategy=strategy) == chosen).all()
    assert other.variance(chosen) == pytest.approx(problem.variance(chosen), rel=1e-6)


def test_progress_is_told():
    told = []
    select_candidates(made_up(7), 4, progress=lambda what, done, of: told.append((what, done, of)))
    assert told[:4] == [("choose", count, 4) for count in (1, 2, 3, 4)]
    assert told[-4:] == [("exchange", count, 4) for count in (1, 2, 3, 4)]


def test_candidates_that_help_only_together_are_found():
    """Two poses in a seat of unknown place tell one parameter of the arm, one of them tells nothing.

    One at a time, nobody would start with the seat, whose parameter matters, but with poses that matter little.
    """
    factors = np.array([[[1.0, 0.0, 1.0]], [[-1.0, 0.0, 1.0]], [[0.0, 0.1, 0.0]], [[0.0, 0.1, 0.0]]]) * 10
    problem = DesignProblem(factors, np.diag([1.0, 1.0, 1e-12]), np.diag([1.0, 0.01, 0.0]))
    assert greedy(problem, 2, IOptimality()).tolist() == [2, 3]
    assert fedorov_exchange(problem, [2, 3], IOptimality()).tolist() == [2, 3]
    assert sorted(select_candidates(problem, 2).tolist()) == [0, 1]


# --- the target ---


def test_an_error_that_a_frame_takes_up_is_none():
    rng = np.random.default_rng(11)
    tips = rng.uniform(-500, 500, (30, 3))
    turn = np.cross([0.3, -0.2, 0.5], tips)[:, :, None]
    shift = np.broadcast_to([[1.0], [2.0], [3.0]], (30, 3, 1))
    scale = tips[:, :, None] - tips.mean(axis=0)[:, None]
    J = np.concatenate([turn, shift, scale], axis=2)
    # 1e-18 of the squares: rounding.
    assert np.abs(moment_matrix(J, tips)[:2]).max() < 1e-18 * (J**2).sum()
    assert moment_matrix(J, tips)[2, 2] == pytest.approx((scale**2).sum() / 30)
    assert moment_matrix(J)[0, 0] == pytest.approx((turn**2).sum() / 30)


# --- groups of readings ---


def test_groups_of_unlike_size_are_filled_up_with_zeros():
    rng = np.random.default_rng(8)
    factors = [rng.standard_normal((k, 4)) for k in (1, 3, 9)]
    together = stack_factors(factors)
    assert together.shape == (3, 4, 4)
    for factor, place in zip(factors, together, strict=True):
        assert place.T @ place == pytest.approx(factor.T @ factor)


@given(st.integers(0, 10_000), st.integers(1, 3))
@settings(max_examples=30)
def test_eliminated_unknowns_leave_the_schur_complement(seed, q):
    rng = np.random.default_rng(seed)
    J, B = rng.standard_normal((8, 5)), rng.standard_normal((8, q))
    left = project_out(J, B)
    assert left.shape == (8 - q, 5)
    schur = J.T @ J - J.T @ B @ np.linalg.solve(B.T @ B, B.T @ J)
    assert left.T @ left == pytest.approx(schur, abs=1e-9)
    # An unknown told twice, or not at all, is no further unknown.
    again = project_out(J, np.concatenate([B, B, np.zeros((8, 1))], axis=1))
    assert again.T @ again == pytest.approx(schur, abs=1e-9)


def test_a_seat_touched_k_times_tells_how_far_the_tips_lie_apart():
    """Eliminating the seat's point is the same as taking the mean off."""
    J = np.random.default_rng(9).standard_normal((4, 3, 6))
    left = project_out(J.reshape(12, 6), np.tile(np.eye(3), (4, 1)))
    assert left.shape == (9, 6)
    apart = (J - J.mean(axis=0)).reshape(12, 6)
    assert left.T @ left == pytest.approx(apart.T @ apart)


def test_the_posterior_with_shared_unknowns_is_that_of_the_whole_problem():
    """Two seats and a length between them: eliminated, or carried along as parameters without a target."""
    rng = np.random.default_rng(10)
    J = np.concatenate([rng.standard_normal((12, 5)), np.zeros((1, 5))])
    B = np.zeros((13, 6))
    B[:6, :3] = B[6:12, 3:] = np.tile(np.eye(3), (2, 1))
    B[12] = 50 * np.array([0, 0, 1, 0, 0, -1])
    alone = DesignProblem(project_out(J, B)[None], np.eye(5), np.eye(5))
    prior = np.diag([1.0] * 5 + [1e-10] * 6)
    whole = DesignProblem(np.concatenate([J, B], axis=1)[None], prior, np.diag([1.0] * 5 + [0.0] * 6))
    # 1e-6: the seats' own prior, wide but there.
    assert whole.variance([0]) == pytest.approx(alone.variance([0]), rel=1e-6)


@given(st.integers(0, 10_000), st.integers(1, 5))
@settings(max_examples=30)
def test_a_factor_has_the_information_it_was_made_from(seed, rank):
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-4, 4, 5)
    rows = rng.standard_normal((rank, 5)) * units
    factor = factor_of(rows.T @ rows)
    assert factor.shape == (rank, 5)
    assert (factor.T @ factor) / np.outer(units, units) == pytest.approx((rows.T @ rows) / np.outer(units, units))


# --- bad input ---


def test_a_problem_is_checked():
    good = made_up()
    J, prior, target = good.factors, good.prior_precision, good.target
    for factors in (J[0], J[:0], np.where(J.max() == J, np.nan, J)):
        refuses("factors", DesignProblem, factors, prior, target)
    for bad, why in (
        (np.eye(4), "shape"),
        (np.full((5, 5), np.nan), "finite"),
        (np.triu(np.ones((5, 5))), "symmetric"),
        (np.zeros((5, 5)), "positive definite"),
        (-np.eye(5), "positive definite"),
    ):
        refuses(f"prior.precision.*{why}", DesignProblem, J, bad, target)
    refuses(r"target.*below zero", DesignProblem, J, prior, np.diag([1.0, 1, 1, 1, -1]))


@pytest.mark.parametrize(
    ("options", "why"),
    [({"strategy": "A-optimal"}, "expected a strategy among"), ({"n": 0}, "1 to 12"), ({"n": 13}, "1 to 12")],
)
def test_a_choice_is_checked(options, why):
    refuses(why, select_candidates, made_up(), **{"n": 2, **options})
